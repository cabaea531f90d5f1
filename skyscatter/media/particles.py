"""Densities given by particles, as from smoothed particle hydrodynamics."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.kernels.codes.space import CELLS, PARTICLES, ROOM
from skyscatter.media.arrays import ArrayField, ArrayRecord, FrozenArray, read_arrays
from skyscatter.media.space import Array, FieldTerm, Instruction
from skyscatter.media.voxels import VoxelGrid
from skyscatter.units import PositiveMetres, default

#: What a particle has.
NAMES: tuple[str, ...] = ("positions", "masses", "smoothing_lengths")
#: Cells along the longest side of the grid that `resolution = "auto"` makes, at most.
AUTO_CELLS = 256


class Particles(NamedTuple):
    """Particles in metres, in the order of the tree or of the file."""

    positions: Array  #: (n, 3) [m]
    masses: Array  #: (n,)
    lengths: Array  #: (n,) smoothing lengths h [m]


class ParticleSet(ArrayRecord):
    """Sum of the cubic splines of particles (Monaghan & Lattanzio 1985, A&A 149, 135).

    Density = factor * sum of m W(r, h), where W falls to zero at r = 2 h and its integral is 1.

    Parameters
    ----------
    positions : array_like, shape (n, 3)
        [length_unit]
    masses : array_like, shape (n,), optional
        In any unit; 1 each when not given.
    smoothing_lengths : array_like, shape (n,), optional
        h [length_unit]; half the distance to the `neighbours`-th nearest particle when not given.
    file : str
        Instead of the arrays: .npz or a FITS binary table with `positions` (or `x`, `y`, `z`), and perhaps `masses` and
        `smoothing_lengths`.  Read when first needed.
    length_unit : length
        Of the positions and smoothing lengths, such as "1 pc" [m].
    factor : float
        Density that one unit of mass in a cubic metre stands for.
    neighbours : int
        See `smoothing_lengths`.
    resolution : "auto" or int
        0: all particles, exactly.  A number: through a grid of so many cells along the longest side (`resampled`),
        which has the same mass, is faster, and whose error is stated there.  "auto": cells of half the median smoothing
        length, of up to the whole of it where more than 256 along a side would be needed, and exactly if those do not
        do.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: if shapes do not agree, a number is not finite, a mass is negative or a smoothing length
        is not above 0.
    MissingDataError
        When the file is first needed, if it cannot be read.

    Examples
    --------
    Two particles that do not touch.  The density in the middle of the first is m / (pi h^3):

    >>> from skyscatter import fields
    >>> places = [[0, 0, 0], [4, 0, 0]]
    >>> gas = fields.ParticleSet(positions=places, masses=[2, 1], smoothing_lengths=[1, 1], resolution=0)
    >>> gas.mass  # integral of the density [m3]
    3.0
    >>> gas.density([[0, 0, 0], [2, 0, 0]]).round(4).tolist()
    [0.6366, 0.0]
    """

    kind: Literal["sph-particles"] = "sph-particles"
    positions: ArrayField = None
    masses: ArrayField = None
    smoothing_lengths: ArrayField = None
    file: str | None = None
    length_unit: PositiveMetres = default(1.0)
    factor: float = Field(default=1.0, gt=0)
    neighbours: int = Field(default=32, ge=1)
    resolution: Literal["auto"] | int = "auto"

    @model_validator(mode="after")
    def _check(self) -> ParticleSet:
        given = [name for name in NAMES if getattr(self, name) is not None]
        if ("positions" in given) == (self.file is not None) or (self.file is not None and given):
            raise DomainError("positions", given, "give positions (and masses, smoothing_lengths), or a file, not both")
        if not self.length_unit > 0:
            raise DomainError("length_unit", self.length_unit, "must be a positive length")
        if self.resolution != "auto" and self.resolution < 0:
            raise DomainError("resolution", self.resolution, 'must be "auto", 0 for exact, or a number of cells')
        if given:
            _check_particles({name: getattr(self, name).array for name in given})
        return self

    @cached_property
    def particles(self) -> Particles:
        """The particles in metres, with smoothing lengths."""
        if self.file is None:
            given = {name: getattr(self, name).array for name in NAMES if getattr(self, name) is not None}
        else:
            given = _read(self.file)
        positions = np.asarray(given["positions"], float) * self.length_unit
        masses = np.asarray(given.get("masses", np.ones(len(positions))), float)
        if "smoothing_lengths" in given:
            lengths = np.asarray(given["smoothing_lengths"], float) * self.length_unit
        else:
            lengths = 0.5 * neighbour_distances(positions, self.neighbours)
        return Particles(positions, masses, lengths)

    @property
    def mass(self) -> float:
        """Integral of the density over space [m3]."""
        return self.factor * float(self.particles.masses.sum())

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) [m] of where the density is not zero."""
        if self.cells:
            return self.grid.bounds
        positions, _, lengths = self.particles
        return (positions - 2 * lengths[:, None]).min(axis=0), (positions + 2 * lengths[:, None]).max(axis=0)

    @cached_property
    def cells(self) -> int:
        """Cells along the longest side of the grid that stands for the particles; 0 for none."""
        if self.resolution != "auto":
            return self.resolution
        positions, _, lengths = self.particles
        side = ((positions + 2 * lengths[:, None]).max(axis=0) - (positions - 2 * lengths[:, None]).min(axis=0)).max()
        wanted = math.ceil(2 * side / float(np.median(lengths)))
        return min(wanted, AUTO_CELLS) if wanted <= 2 * AUTO_CELLS else 0

    @cached_property
    def grid(self) -> VoxelGrid:
        """The grid that stands for the particles."""
        return self.resampled(self.cells)

    def resampled(self, cells: int) -> VoxelGrid:
        """The particles spread over a grid of cubic cells; their mass is kept to rounding.

        Each particle goes to the cells by its spline at their middles, scaled to its mass; smoothing lengths below a
        cell's side are raised to it.  The error is that of linear interpolation and falls with the square of the side:
        for particles at random places with 32 neighbours and cells of half a smoothing length, the density at a point
        is within 5 % (root mean square) of the exact one, columns through many particles within 0.8 %.

        Parameters
        ----------
        cells : int
            Along the longest side of the box around all spheres.
        """
        from skyscatter.kernels.splats import splat

        if cells < 1:
            raise DomainError("cells", cells, "must be positive")
        positions, masses, lengths = self.particles
        reach = 2 * lengths[:, None]
        side = float(((positions + reach).max(axis=0) - (positions - reach).min(axis=0)).max()) / cells
        reach = 2 * np.maximum(lengths, side)[:, None]
        low, high = (positions - reach).min(axis=0), (positions + reach).max(axis=0)
        shape = np.ceil((high - low) / side - 1e-9).astype(int)
        # The last cells along each axis stick out a little; half of that goes to either side.
        low = 0.5 * (low + high - shape * side)
        content = np.zeros(shape)
        splat((positions - low) / side, np.maximum(lengths / side, 1.0), masses / masses.max(), content)
        peak = float(content.max())
        values = (content / peak).astype(np.float32)
        # What the grid loses in single precision is given back.
        factor = self.mass / (float(values.sum(dtype=np.float64)) * side**3)
        values.flags.writeable = False
        corners = {"low": tuple(map(float, low)), "high": tuple(map(float, low + shape * side))}
        return VoxelGrid.model_validate({"values": FrozenArray(values), "factor": factor, **corners})

    @cached_property
    def tree(self) -> tuple[Instruction, float]:
        """The particles as the kernels read them, and the largest weight m / (pi h^3) times `factor`."""
        from skyscatter.kernels.splats import box_nodes, sort_into_tree

        positions, masses, lengths = self.particles
        number = len(positions)
        levels = max(math.ceil(math.log2(number / ROOM)), 0)
        leaves = 1 << levels
        reach = 2 * lengths[:, None]
        low, high = (positions - reach).min(axis=0), (positions + reach).max(axis=0)
        middle, size = 0.5 * (low + high), float((high - low).max())
        points, order = (positions - middle) / size, np.arange(number)
        sort_into_tree(points, order, levels)
        h, mass = lengths[order] / size, masses[order]
        boxes = np.zeros((2 * leaves, 6))
        # Single precision makes spheres larger by 1e-7 at most.
        box_nodes(points, 2.000001 * h, levels, boxes)
        boxes = boxes.astype(np.float32)
        leaf = np.arange(leaves + 1) * number >> levels
        owner = np.repeat(np.arange(leaves), np.diff(leaf))
        centre = (np.add.reduceat(points, leaf[:-1]) / np.diff(leaf)[:, None]).astype(np.float32)
        weight = (mass / mass.max()) / (math.pi * h**3)
        peak = float(weight.max())
        bodies = np.zeros((leaves, 5, ROOM), np.float32)
        rows = np.column_stack([points - centre[owner], 1 / h, weight / peak])
        bodies[owner, :, np.arange(number) - leaf[owner]] = rows
        blocks = np.column_stack([bodies.reshape(leaves, -1), centre, np.zeros(leaves, np.float32)])
        data = np.concatenate([boxes.ravel(), blocks.ravel()])
        affine = np.hstack([np.eye(3), -middle[:, None]]) / size
        return Instruction(PARTICLES, affine, (1.0,), data, (number, levels)), self.factor * mass.max() * peak / size**3

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        if self.cells:
            return self.grid.terms()
        leaf, factor = self.tree
        return (FieldTerm((leaf,), CELLS, factor, np.array(self.bounds), float(np.median(self.particles.lengths))),)

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`.

        Every particle counts as near to, or as far from, a box as it can be.  Boxes are cut until the upper bound is at
        most twice a density that is reached in the box (or they have been cut 16 times).
        """
        if self.cells:
            return self.grid.extremes(low, high)
        leaf, factor = self.tree
        affine = np.asarray(leaf.affine)
        a, b = low @ affine[:, :3].T + affine[:, 3], high @ affine[:, :3].T + affine[:, 3]
        parts = [slice(n, n + 4096) for n in range(0, len(a), 4096)]
        pairs = [_refined_bounds(leaf, a[part], b[part]) for part in parts]
        lowest, highest = (np.concatenate([pair[k] for pair in pairs]) for k in range(2))
        # Bounds hold to the single precision of the particles.
        return factor * lowest * (1 - 1e-5), factor * highest * (1 + 1e-5)


def _refined_bounds(leaf: Instruction, low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds, over the largest weight, within boxes (n, 3) in the frame of the tree; see `ParticleSet.extremes`."""
    from skyscatter.kernels.particles import particle_bounds

    lowest, highest, reached = np.full(len(low), np.inf), np.zeros(len(low)), np.zeros(len(low))
    owner = np.arange(len(low))
    for turn in range(17):
        least, sample, most = np.empty((3, len(owner)))
        particle_bounds(leaf.data, leaf.index[1], low, high, least, sample, most)
        np.maximum.at(reached, owner, sample)
        done = (most <= 2.0 * reached[owner]) | (most <= highest[owner]) | (turn == 16)
        np.maximum.at(highest, owner[done], most[done])
        np.minimum.at(lowest, owner[done], least[done])
        if done.all():
            break
        low, high, parents = _halved(low[~done], high[~done])
        owner = owner[~done][parents]
    return lowest, highest


def _halved(low: Array, high: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Boxes (n, 3) cut in half across their long sides: low and high corners of the parts, and of which box each is.

    Sides of less than half the longest stay whole: of a needle cut across all of them, four parts would be as one.
    """
    size = high - low
    long = size > 0.5 * size.max(axis=1, keepdims=True)
    size = np.where(long, 0.5 * size, size)
    steps = np.stack(np.meshgrid(*3 * [[0.0, 1.0]], indexing="ij"), axis=-1).reshape(-1, 3)
    parents, step = np.nonzero(((steps == 0.0) | long[:, None]).all(axis=2))
    low = low[parents] + steps[step] * size[parents]
    return low, low + size[parents], parents


def neighbour_distances(positions: Array, neighbours: int) -> Array:
    """Distance of every particle (n, 3) to its k-th nearest neighbour (the farthest one when there are fewer)."""
    from scipy.spatial import cKDTree

    from skyscatter.kernels.splats import sort_into_tree

    count = min(neighbours, len(positions) - 1)
    if count < 1:
        raise DomainError("smoothing_lengths", None, "a single particle has no neighbours; give its smoothing length")
    # Neighbours asked for one after the other find their part of the tree in the cache: twice as fast.
    points, order = np.array(positions), np.arange(len(positions))
    sort_into_tree(points, order, (len(positions) // 16).bit_length())
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    distances = np.empty(len(positions))
    distances[order] = tree.query(points, k=[count + 1], workers=-1)[0][:, 0]
    if not distances.min() > 0:
        remedy = f"more than {neighbours} particles in one place; give smoothing_lengths"
        raise DomainError("positions", "equal", remedy)
    return distances


def _check_particles(given: dict[str, NDArray[Any]]) -> None:
    positions = given["positions"]
    if positions.ndim != 2 or positions.shape[1] != 3 or not len(positions):
        raise DomainError("positions", positions.shape, "needs the shape (particles, 3), with at least one particle")
    for name, values in given.items():
        if len(values) != len(positions) or (name != "positions" and values.ndim != 1):
            raise DomainError(name, values.shape, f"needs one number for each of the {len(positions)} particles")
        if not np.isfinite(values).all():
            raise DomainError(name, "not a number or infinite", "every particle needs finite numbers")
    if "masses" in given and not (given["masses"].min() >= 0 and given["masses"].max() > 0):
        raise DomainError("masses", float(given["masses"].min()), "never negative, nor zero for all particles")
    if "smoothing_lengths" in given and not given["smoothing_lengths"].min() > 0:
        raise DomainError("smoothing_lengths", float(given["smoothing_lengths"].min()), "must be positive lengths")


def _read(path: str) -> dict[str, NDArray[Any]]:
    columns = read_arrays(path, (*NAMES, "x", "y", "z"))
    given = {name: columns[name] for name in NAMES if name in columns}
    if "positions" not in given:
        if not {"x", "y", "z"} <= set(columns):
            raise MissingDataError(path, "holds no positions; name the column `positions`, or three `x`, `y`, `z`")
        given["positions"] = np.column_stack([columns["x"], columns["y"], columns["z"]])
    _check_particles(given)
    return given
