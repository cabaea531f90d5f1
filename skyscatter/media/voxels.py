"""Densities given on a regular grid of cells."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import CELLS, VOXELS
from skyscatter.media.arrays import ArrayField, ArrayRecord, FrozenArray, read_cube
from skyscatter.media.space import Array, FieldTerm, Instruction, SpatialField
from skyscatter.units import Metres, OptionalTriple, Place, PositiveNumber, default

#: A field that repeats is given so many periods to either side.
REPEATS = 10_000
#: Bounds within boxes look at about so many numbers along an axis at most.
_LOOKS = 16


class VoxelGrid(ArrayRecord):
    """Density on a grid of equal cells, read from an array or a file.

    Give `values` or `file`; and either the corners `low` and `high` of the whole grid, or the side of a cell,
    `spacing`, with the middle of the grid, `position`.

    The integral of the density over space is the sum of the values times the volume of a cell, whatever the
    interpolation and the edge.

    Parameters
    ----------
    values : array_like, shape (x, y, z)
        Density of every cell, never negative.
    file : str
        .npy, .npz (its array `values`, else its first one) with axes (x, y, z), or FITS with a cube whose fastest axis,
        NAXIS1, is x.  Read when first needed.
    factor : float
        Multiplies all values.
    low, high : (length, length, length)
        Corners of the grid [m].
    spacing : length or (length, length, length)
        Sides of a cell [m].
    position : (length, length, length)
        Middle of the grid [m]; only with `spacing`.
    interpolation : {"linear", "nearest"}
        Trilinear between the middles of cells, or constant within each.
    edge : {"falling", "sharp"}
        What trilinear interpolation does beyond the middles of the outermost cells: fall to zero at half a cell
        outside the grid, or stay constant up to the grid's face.  Sharp is for a piece cut out of something larger.
    periodic : (bool, bool, bool)
        Along which axes the grid repeats, for a plane-parallel layer; 10 000 times to either side.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: if values are negative or not finite, or the array has not three axes.
    MissingDataError
        When the file is first needed, if it cannot be read.

    Examples
    --------
    Eight cells of 1 m, and the columns through two of them along z:

    >>> import numpy as np
    >>> from skyscatter import fields
    >>> grid = fields.VoxelGrid(values=np.arange(8).reshape(2, 2, 2), spacing="1 m", interpolation="nearest")
    >>> grid.density([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]]).tolist()
    [0.0, 7.0]
    >>> float(grid.column([0.5, 0.5, -2], [0.5, 0.5, 2]).round(3))  # m of unit density, 6 + 7
    13.0
    """

    kind: Literal["voxels"] = "voxels"
    values: ArrayField = None
    file: str | None = None
    factor: PositiveNumber = default(1.0)
    low: OptionalTriple[Place] = default(None)
    high: OptionalTriple[Place] = default(None)
    spacing: Metres | Place | None = None
    position: Place = default((0.0, 0.0, 0.0))
    interpolation: Literal["linear", "nearest"] = "linear"
    edge: Literal["falling", "sharp"] = "falling"
    periodic: tuple[bool, bool, bool] = (False, False, False)

    @model_validator(mode="after")
    def _check(self) -> VoxelGrid:
        if (self.values is None) == (self.file is None):
            raise DomainError("values", None if self.values is None else "an array", "give values or file, not both")
        if self.values is not None:
            _check_values(self.values.array)
        if (self.low is None) != (self.high is None) or (self.low is None) == (self.spacing is None):
            raise DomainError("spacing", self.spacing, "give either spacing, or both low and high")
        if self.low is not None and self.high is not None:
            if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
                raise DomainError("high", self.high, f"must lie above low = {self.low} along every axis")
            if self.position != (0.0, 0.0, 0.0):
                raise DomainError("position", self.position, "goes with spacing; low and high say where the grid is")
        elif not np.all(np.asarray(self.spacing) > 0):
            raise DomainError("spacing", self.spacing, "must be a positive length")
        return self

    @classmethod
    def from_field(
        cls, field: SpatialField, cells: int | tuple[int, int, int], low: Any = None, high: Any = None, **options: Any
    ) -> VoxelGrid:
        """Any field, sampled at the middles of cells.

        The error of a smooth field falls with the square of the side of a cell.

        Parameters
        ----------
        field : SpatialField
        cells : int or (int, int, int)
            Along each axis; one number counts along the longest side, and the cells are about cubes.
        low, high : array_like, shape (3,), optional
            Corners [m]; those of the field when not given.
        **options
            `interpolation`, `edge`, `periodic`.
        """
        a, b = field.bounds
        a, b = np.asarray(a if low is None else low, float), np.asarray(b if high is None else high, float)
        if isinstance(cells, int):
            shape = np.maximum(np.ceil(cells * (b - a) / (b - a).max() - 1e-9), 1).astype(int)
        else:
            shape = np.asarray(cells, int)
        if shape.min() < 1:
            raise DomainError("cells", cells, "must be positive")
        axes = [a[k] + (np.arange(shape[k]) + 0.5) * (b[k] - a[k]) / shape[k] for k in range(3)]
        values = np.empty(shape, np.float32)
        for n, x in enumerate(axes[0]):
            points = np.stack(np.meshgrid(x, axes[1], axes[2], indexing="ij"), axis=-1)[0]
            values[n] = field.density(points)
        values.flags.writeable = False
        corners = {"low": tuple(map(float, a)), "high": tuple(map(float, b))}
        return cls.model_validate({"values": FrozenArray(values), **corners, **options})

    @cached_property
    def cube(self) -> NDArray[Any]:
        """The values (x, y, z), without `factor`."""
        if self.values is not None:
            return self.values.array
        cube = read_cube(str(self.file))
        _check_values(cube)
        return cube

    @property
    def corners(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) [m] of the grid, of one period of it where it repeats."""
        if self.low is not None and self.high is not None:
            return np.array(self.low), np.array(self.high)
        half = 0.5 * np.array(self.cube.shape) * np.asarray(self.spacing)
        return np.array(self.position) - half, np.array(self.position) + half

    @property
    def cell(self) -> Array:
        """Sides (3,) [m] of a cell."""
        low, high = self.corners
        return (high - low) / self.cube.shape

    @property
    def periods(self) -> Array:
        """Lengths (3,) [m] after which the field repeats; 0 where it does not."""
        return np.where(self.periodic, self.cell * self.cube.shape, 0.0)

    @cached_property
    def nodes(self) -> NDArray[np.float32]:
        """What the kernels read: values over the largest, for trilinear interpolation with those beyond the edges."""
        nodes = (self.cube / self.peak).astype(np.float32) if self.peak > 0 else self.cube.astype(np.float32)
        if self.interpolation == "linear":
            beyond: Literal["edge", "constant"] = "edge" if self.edge == "sharp" else "constant"
            for k in range(3):
                width = [(0, 0)] * 3
                width[k] = (0, 1) if self.periodic[k] else (1, 1)
                nodes = np.pad(nodes, width, mode="wrap" if self.periodic[k] else beyond)
        return np.ascontiguousarray(nodes)

    @cached_property
    def bricks(self) -> tuple[NDArray[np.float32], list[NDArray[np.int64]]]:
        """The nodes in bricks of 8 x 8 x 8, within a brick in Morton's order; and the places along each axis."""
        places, whole = _places(self.nodes.shape)
        data = np.zeros(whole, np.float32)
        across = places[1][:, None] + places[2]
        for x, sheet in zip(places[0], self.nodes, strict=True):
            data[x + across] = sheet
        return data, places

    @cached_property
    def peak(self) -> float:
        """Largest value, without `factor`."""
        return float(self.cube.max())

    @property
    def _frame(self) -> tuple[Array, Array, Array]:
        """Corner of the kernels' frame [m], and lowest and highest corner of the support in it [cell]."""
        shape, repeats = np.array(self.cube.shape, float), np.array(self.periodic)
        first = np.zeros(3)
        if self.interpolation == "linear":
            # Node 0 is the middle of the first cell where the grid repeats, else the middle of the cell before it.
            first = np.where(repeats, 0.5, -0.5)
        corner = self.corners[0] + first * self.cell
        beyond = 0.5 if self.interpolation == "linear" and self.edge == "falling" else 0.0
        low, high = -first - beyond, shape - first + beyond
        return corner, np.where(repeats, -np.inf, low), np.where(repeats, np.inf, high)

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        corner, low, high = self._frame
        linear = self.interpolation == "linear"
        affine = np.hstack([np.diag(1.0 / self.cell), (-corner / self.cell)[:, None]])
        walked = np.array(self.nodes.shape) - (1 if linear else 0)
        data, places = self.bricks
        along = [place for axis in places for place in (*axis.tolist(), *([] if linear else [0]))]
        index = (*map(int, walked), *map(int, self.periodic), int(linear), *along)
        leaf = Instruction(VOXELS, affine, (*low, *high), data, index)
        begin, end = self.corners
        far = REPEATS * self.periods
        repeats = np.array(self.periodic)
        box = np.array([np.where(repeats, begin - far, corner + low * self.cell),
                        np.where(repeats, end + far, corner + high * self.cell)])  # fmt: skip
        factor = self.factor * (self.peak if self.peak > 0 else 1.0)
        return (FieldTerm((leaf,), CELLS, factor, box, float(self.cell.min())),)

    @cached_property
    def levels(self) -> dict[int, tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Lowest and highest numbers in blocks of 2^level nodes a side, made when asked for."""
        return {0: (self.nodes, self.nodes)}

    def _blocks(self, level: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        if level not in self.levels:
            lowest, highest = self._blocks(level - 1)
            for k in range(3):
                starts = np.arange(0, lowest.shape[k], 2)
                lowest = np.minimum.reduceat(lowest, starts, axis=k)
                highest = np.maximum.reduceat(highest, starts, axis=k)
            self.levels[level] = np.ascontiguousarray(lowest), np.ascontiguousarray(highest)
        return self.levels[level]

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`.

        They are those of the numbers that the boxes touch; for boxes of many cells, of those in blocks that they touch.
        A face belongs to the cells on both sides of it.
        """
        corner, start, end = self._frame
        # More than the rounding of a point's place in the grid.
        rounding = 1e-14 * (np.maximum(np.abs(low), np.abs(high)) + np.abs(corner)) / self.cell + 1e-12
        a, b = (low - corner) / self.cell - rounding, (high - corner) / self.cell + rounding
        outside = ((a > end) | (b < start)).any(axis=1)
        partly = ((a < start) | (b > end)).any(axis=1)
        shape, repeats = np.array(self.nodes.shape), np.array(self.periodic)
        if self.interpolation == "linear":
            first, last = np.floor(a), np.ceil(b)
        else:
            first, last = np.floor(a), np.floor(b)
        last = np.maximum(last, first)
        period = shape - (1 if self.interpolation == "linear" else 0)
        # A grid that repeats ends too, after its last period.
        beyond = (low < self.corners[0] - REPEATS * self.periods) | (high > self.corners[1] + REPEATS * self.periods)
        partly |= (repeats & beyond).any(axis=1)
        # Where the grid repeats, the first number is brought into the first period; the last may lie in the second one.
        turn = np.where(repeats, np.floor(first / period) * period, 0.0)
        first, last = first - turn, last - turn
        whole = repeats & (last - first >= period)
        first = np.where(whole, 0, np.clip(first, 0, shape - 1)).astype(np.int64)
        last = np.where(whole, shape - 1, np.clip(last, 0, np.where(repeats, 2 * period, shape) - 1)).astype(np.int64)
        lowest, highest = self._look(first, last, shape, period)
        lowest = np.where(partly, np.minimum(lowest, 0.0), lowest)
        lowest, highest = np.where(outside, 0.0, lowest), np.where(outside, 0.0, highest)
        factor = self.factor * (self.peak if self.peak > 0 else 1.0)
        return factor * lowest, factor * highest

    def _look(
        self, first: NDArray[np.int64], last: NDArray[np.int64], shape: NDArray[np.int64], period: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Lowest and highest numbers from first to last (box, 3), which may go on into a second period."""
        from skyscatter.kernels.voxels import box_extremes

        lowest, highest = np.empty(len(first)), np.empty(len(first))
        length = (last - first).max(axis=1) + 1
        level = np.maximum(np.ceil(np.log2(length / _LOOKS)), 0).astype(int)
        for k in np.unique(level):
            chosen = level == k
            low, high = self._blocks(int(k))
            a, b = first[chosen], last[chosen]
            if k > 0:
                # Blocks are not those of the second period: long boxes that reach it take all of the first.
                beyond = b >= shape
                a, b = np.where(beyond, 0, a), np.where(beyond, shape - 1, b)
            a, b = np.ascontiguousarray(a >> k), np.ascontiguousarray(b >> k)
            results = np.empty((2, len(a)))
            box_extremes(low.reshape(-1), high.reshape(-1), np.array(low.shape), period, a, b, *results)
            lowest[chosen], highest[chosen] = results
        return lowest, highest


def _places(shape: tuple[int, ...]) -> tuple[list[NDArray[np.int64]], int]:
    """Places along each axis whose sum is the place of a number in bricks, and how many places there are."""
    bits = [min((n - 1).bit_length(), 3) for n in shape]
    number = [np.arange(n) for n in shape]
    places = [np.zeros(n, np.int64) for n in shape]
    bit = 0
    for k in range(max(bits)):
        # The last axis changes fastest.
        for axis in (2, 1, 0):
            if k < bits[axis]:
                places[axis] += ((number[axis] >> k) & 1) << bit
                bit += 1
    step = 1 << bit
    for axis in (2, 1, 0):
        places[axis] += (number[axis] >> bits[axis]) * step
        step *= ((shape[axis] - 1) >> bits[axis]) + 1
    return places, step


def _check_values(values: NDArray[Any]) -> None:
    if values.ndim != 3 or not values.size:
        raise DomainError("values", values.shape, "needs three axes (x, y, z) with at least one cell each")
    low, high = float(values.min()), float(values.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        raise DomainError("values", "not a number or infinite", "every cell needs a finite density")
    if low < 0:
        raise DomainError("values", low, "a density is never negative")
