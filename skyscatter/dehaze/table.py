"""The terms of an image's geometry, tabulated over angles and the amount of haze, with the error that this makes.

Between nodes the terms are interpolated by polynomials: over each angle through the Chebyshev-Lobatto points of its
range, over the optical depth in the variable log(1 + aod / 0.3), in which they are smoothest.  Both grids are refined
until points between the nodes, solved as well, are met; the difference found last is the table's stated error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.dehaze import cachefile
from skyscatter.dehaze.forward import Atmosphere, BandAverage, SolvedAir, reflectance_above
from skyscatter.dehaze.geometry import MAX_SUN_ZENITH, fold_azimuth
from skyscatter.dehaze.passband import Band
from skyscatter.errors import DomainError
from skyscatter.tasks.door import opened
from skyscatter.tasks.task import Shared, Task

Array = NDArray[np.float64]

#: Reflectance that interpolation may cost (half of it over the angles, half over the haze).
TOLERANCE = 0.0005
#: Surfaces for which the error is judged: black, and bright soil.
JUDGED = (0.0, 0.4)
#: The greatest optical depth of a search for the haze, and the nodes it begins with.
GREATEST_AOD, FIRST_NODES = 2.0, 6
#: Optical depth that divides those to which the light answers in proportion from those in which it saturates.
BENDS_AT = 0.3
MOST_NODES = 17  #: of a range of angles
MOST_SOLUTIONS = 12  #: over the optical depth
GREATEST_ANGLE = MAX_SUN_ZENITH  #: of Sun and view from the zenith [degree]
#: Ranges of angles are widened to whole multiples of this, so that neighbouring scenes share a table [degree].
ROUND_TO = 0.5
FORMAT = 4  #: of the kept files; rises with every change of what they mean


@dataclass(frozen=True)
class Angles:
    """Ranges of angles that an image spans [degree], each (low, high)."""

    sun_zenith: tuple[float, float]
    view_zenith: tuple[float, float]
    relative_azimuth: tuple[float, float] = (0.0, 180.0)

    @classmethod
    def spanned(cls, sun_zenith: ArrayLike, view_zenith: ArrayLike, relative_azimuth: ArrayLike) -> Angles:
        """The rounded ranges of given angles; azimuths are folded to 0 to 180 degrees, for the light is symmetric."""
        ranges = []
        for name, values in (("sun_zenith", sun_zenith), ("view_zenith", view_zenith)):
            low, high = float(np.min(values)), float(np.max(values))
            if not (low >= 0 and high <= GREATEST_ANGLE):
                bad = high if high > GREATEST_ANGLE else low
                raise DomainError(name, bad, f"an angle from the zenith between 0 and {GREATEST_ANGLE:g} degrees")
            ranges.append(rounded(low, high, GREATEST_ANGLE))
        folded = fold_azimuth(relative_azimuth)
        ranges.append(rounded(float(folded.min()), float(folded.max()), 180.0))
        if ranges[1][1] == 0:  # straight down there is no azimuth
            ranges[2] = (0.0, 0.0)
        return cls(*ranges)


def rounded(low: float, high: float, most: float) -> tuple[float, float]:
    """A range widened to multiples of `ROUND_TO`; a single angle stays what it is."""
    if high - low < 1e-9:
        return low, low
    return max(np.floor(low / ROUND_TO) * ROUND_TO, 0.0), min(np.ceil(high / ROUND_TO) * ROUND_TO, most)


def lobatto(low: float, high: float, n: int) -> Array:
    """Chebyshev-Lobatto points of a range, rising; its middle for n = 1."""
    if n == 1:
        return np.array([0.5 * (low + high)])
    points: Array = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(n) / (n - 1))
    return points


def polynomial_weights(nodes: Array, x: ArrayLike) -> Array:
    """Weights (..., node) of the polynomial through the nodes, at points clipped to their range."""
    at = np.clip(np.asarray(x, float), nodes[0], nodes[-1])[..., None]
    if nodes.size == 1:
        return np.ones((*at.shape[:-1], 1))
    gaps = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    barycentric = 1.0 / gaps.prod(axis=1)
    apart = at - nodes
    hit = np.isclose(apart, 0.0, rtol=0.0, atol=1e-12 * max(1.0, abs(nodes[-1])))
    share = barycentric / np.where(hit, 1.0, apart)
    exact = hit.any(axis=-1, keepdims=True)
    share = np.where(exact, hit.astype(float), share)
    weights: Array = share / share.sum(axis=-1, keepdims=True)
    return weights


def depth_weights(nodes: Array, aod: ArrayLike) -> Array:
    """Weights (..., node) of optical depths, clipped to the range of the nodes."""
    return polynomial_weights(np.log1p(nodes / BENDS_AT), np.log1p(np.asarray(aod, float) / BENDS_AT))


def depth_slopes(nodes: Array, aod: ArrayLike) -> Array:
    """Derivatives (..., node) of `depth_weights`; at the ends of the range those just inside."""
    if nodes.size == 1:
        return np.zeros((*np.shape(aod), 1))
    step = 1e-4 * (nodes[-1] - nodes[0])
    at = np.clip(np.asarray(aod, float), nodes[0] + step, nodes[-1] - step)
    slopes: Array = (depth_weights(nodes, at + step) - depth_weights(nodes, at - step)) / (2 * step)
    return slopes


@dataclass(frozen=True)
class TermsTable:
    """Terms of an atmosphere for an image: over haze, Sun, view and azimuth.

    Attributes
    ----------
    bands : tuple of Band
    atmosphere : Atmosphere
    aod, sun_zenith, view_zenith, relative_azimuth : ndarray
        Nodes; angles in degrees.
    values : ndarray, shape (aod, sun, view, azimuth, band, term)
        See `skyscatter.dehaze.forward` for the terms.
    error : float
        Greatest error of interpolation found, in reflectance above the air.

    Examples
    --------
    Clean air above a ground of the reflectance 0.3, seen from above in the red: the air adds its own light, takes away
    some of the ground's, and sends some of it back once more.

    >>> from skyscatter.dehaze import Atmosphere, Band, build_table
    >>> from skyscatter.dehaze.table import Angles
    >>> angles = Angles(sun_zenith=(40.0, 40.0), view_zenith=(0.0, 0.0), relative_azimuth=(0.0, 0.0))
    >>> red = Band.from_shape("red", 665, 15)
    >>> table = build_table(Atmosphere(aerosol="none"), [red], angles, stokes=False, keep=False)
    >>> terms, slopes = table.at(aod=0.0, sun_zenith=40.0, view_zenith=0.0)
    >>> path, direct, diffuse, back = terms[0]
    >>> round(float(path + (direct + diffuse) * 0.3 / (1 - back * 0.3)), 2)
    0.31
    """

    bands: tuple[Band, ...]
    atmosphere: Atmosphere
    aod: Array
    sun_zenith: Array
    view_zenith: Array
    relative_azimuth: Array
    values: Array
    error: float

    def angle_weights(self, sun_zenith: ArrayLike, view_zenith: ArrayLike, relative_azimuth: ArrayLike) -> Array:
        """Weights (place, angle node) for angles (place,) [degree]."""
        sun = polynomial_weights(self.sun_zenith, sun_zenith)
        view = polynomial_weights(self.view_zenith, view_zenith)
        azimuth = polynomial_weights(self.relative_azimuth, fold_azimuth(relative_azimuth))
        joint: Array = np.einsum("ps,pv,pa->psva", sun, view, azimuth)
        return joint.reshape(len(joint), -1)

    def at(
        self,
        aod: ArrayLike,
        sun_zenith: ArrayLike,
        view_zenith: ArrayLike,
        relative_azimuth: ArrayLike = 0.0,
        *,
        clip: bool = False,
    ) -> tuple[Array, Array]:
        """Terms, and their slopes over the optical depth: (..., band, term) each, for arguments that broadcast.

        Angles beyond the table's are taken as its outermost ones; so are optical depths with `clip`, else refused.
        """
        low, high = float(np.min(aod)), float(np.max(aod))
        if not clip and not (low >= self.aod[0] - 1e-9 and high <= self.aod[-1] + 1e-9):
            rule = f"the table covers {self.aod[0]:g} to {self.aod[-1]:g}; build one for it, or give clip=True"
            raise DomainError("aod", high if high > self.aod[-1] else low, rule)
        given = np.broadcast_arrays(*(np.asarray(a, float) for a in (aod, sun_zenith, view_zenith, relative_azimuth)))
        shape = given[0].shape
        depth, *angles = (a.ravel() for a in given)
        flat = self.values.reshape(self.aod.size, -1, *self.values.shape[-2:])
        by_angle = self.angle_weights(*angles)
        out = []
        for weights in (depth_weights(self.aod, depth), depth_slopes(self.aod, depth)):
            terms = np.einsum("pn,pk,nkbt->pbt", weights, by_angle, flat, optimize=True)
            out.append(terms.reshape(*shape, *terms.shape[1:]))
        return out[0], out[1]


def build_table(
    atmosphere: Atmosphere,
    bands: Sequence[Band],
    angles: Angles,
    *,
    aod: float | None = None,
    tolerance: float = TOLERANCE,
    stokes: bool = True,
    keep: bool = True,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> TermsTable:
    """Solve and tabulate, or take what an earlier run has kept.

    Parameters
    ----------
    atmosphere : Atmosphere
    bands : sequence of Band
    angles : skyscatter.dehaze.table.Angles
        Ranges of angles that the table covers.
    aod : float, optional
        The optical depth at 550 nm where it is known: the table covers 0.8 to 1.2 of it; 0 to `GREATEST_AOD` when not
        given.
    tolerance : float
        Wanted error of interpolation, in reflectance.
    stokes : bool
        Polarised, as it should be.
    keep : bool
        Read from and write to the folder of `skyscatter.dehaze.cachefile.cache_folder`.
    threads, progress
        As for `skyscatter.solve`.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What solves the amounts of haze, each a task, once the angles are settled; as for `skyscatter.render`.

    Returns
    -------
    TermsTable

    Raises
    ------
    DomainError
        For an optical depth out of range.

    Notes
    -----
    A table over angles and optical depths takes tens of seconds to minutes; it is kept in a folder of the user's (see
    `keep`) and read from there the next time.

    Examples
    --------
    Path reflectance of clean air at one pair of angles, blue and red:

    >>> from skyscatter.dehaze import Atmosphere, Band, build_table
    >>> from skyscatter.dehaze.table import Angles
    >>> bands = [Band.from_shape("blue", 480, 15), Band.from_shape("red", 665, 15)]
    >>> angles = Angles(sun_zenith=(40.0, 40.0), view_zenith=(0.0, 0.0), relative_azimuth=(0.0, 0.0))
    >>> table = build_table(Atmosphere(aerosol="none"), bands, angles, stokes=False, keep=False)
    >>> table.values.shape  # aod, sun, view, azimuth, band, term
    (1, 1, 1, 1, 2, 4)
    >>> table.values[0, 0, 0, 0, :, 0].round(2)
    array([0.07, 0.02])
    """
    known = None if aod is None else float(aod)
    if known is not None and not 0 <= known <= 5:
        raise DomainError("aod", known, "an optical depth at 550 nm between 0 and 5")
    path = cachefile.file_of("terms", description(atmosphere, bands, angles, known, tolerance, stokes))
    kept = cachefile.load(path) if keep else None
    if kept is None:
        kept = _Builder(atmosphere, bands, angles, tolerance, stokes, threads, progress, executor).build(known)
        if keep:
            cachefile.save(path, kept)
    return TermsTable(
        tuple(bands), atmosphere, kept["aod"], kept["sun_zenith"], kept["view_zenith"], kept["relative_azimuth"],
        kept["values"], float(kept["error"]),
    )  # fmt: skip


def description(
    atmosphere: Atmosphere, bands: Sequence[Band], angles: Angles, aod: float | None, tolerance: float, stokes: bool
) -> str:
    """Everything that a table depends on, in words."""
    medium = atmosphere.medium(1.0).model_dump_json()
    parts = [str(FORMAT), medium, repr(angles), repr(aod), repr(tolerance), repr(stokes)]
    return "\n".join([*parts, *(band.model_dump_json(exclude={"note", "name"}) for band in bands)])


class Settled(NamedTuple):
    """What the solutions for all amounts of haze share, once the angles are known."""

    atmosphere: Atmosphere
    average: BandAverage
    angles: Angles
    stokes: bool
    thickest: SolvedAir
    nodes: tuple[Array, Array, Array]


def terms_for(settled: Settled, aod: float) -> Array:
    """Terms for an amount of haze, on the grid of the thickest: (sun, view, azimuth, band, term)."""
    air = SolvedAir(
        settled.atmosphere, aod, settled.average, settled.angles.sun_zenith, stokes=settled.stokes,
        like=settled.thickest, threads=1,
    )  # fmt: skip
    return air.terms(*np.meshgrid(*settled.nodes, indexing="ij"))


class _Builder:
    """Solves atmospheres and refines both grids."""

    def __init__(
        self,
        atmosphere: Atmosphere,
        bands: Sequence[Band],
        angles: Angles,
        tolerance: float,
        stokes: bool,
        threads: int | None,
        progress: Callable[[float], None] | None,
        executor: Any = None,
    ) -> None:
        self.executor = executor
        self.atmosphere, self.angles, self.tolerance = atmosphere, angles, tolerance
        self.average = BandAverage(bands)
        self.stokes, self.threads = stokes, threads
        self.progress = progress or (lambda share: None)
        self.nodes: tuple[Array, Array, Array] = (np.zeros(1),) * 3
        self.solved: dict[float, SolvedAir] = {}
        self.error = 0.0

    def build(self, aod: float | None) -> dict[str, Array]:
        """Arrays of the finished table."""
        if self.atmosphere.aerosol == "none" or aod == 0:
            wanted = [0.0]
        else:
            first = BENDS_AT * np.expm1(lobatto(0.0, float(np.log1p(GREATEST_AOD / BENDS_AT)), FIRST_NODES))
            wanted = [float(d) for d in first] if aod is None else [0.8 * aod, aod, 1.2 * aod]
        # Whatever the angles: all others are solved on the grid of the thickest.
        self.air(wanted[-1])
        # The thickest haze has the sharpest angles, clear air the brightest limb in the blue.  The thickest comes
        # first, for all others are solved on its grid.
        for depth in dict.fromkeys((wanted[-1], wanted[0])):
            self.refine_angles(depth)
        table = {depth: self.terms(depth) for depth in wanted} if self.executor is None else self.elsewhere(wanted)
        if aod is None and len(wanted) > 1:
            self.refine_depths(table)
        depths = np.array(sorted(table))
        names = ("sun_zenith", "view_zenith", "relative_azimuth")
        self.progress(1.0)
        return {
            "aod": depths,
            **dict(zip(names, self.nodes, strict=True)),
            "values": np.stack([table[d] for d in depths]),
            "error": np.array(self.error),
        }

    def air(self, aod: float) -> SolvedAir:
        """The solution for an amount of haze."""
        if aod not in self.solved:
            self.solved[aod] = SolvedAir(
                self.atmosphere, aod, self.average, self.angles.sun_zenith, stokes=self.stokes,
                like=next(iter(self.solved.values()), None), threads=self.threads,
            )  # fmt: skip
            self.progress(min(len(self.solved) / (FIRST_NODES + 2), 0.95))
        return self.solved[aod]

    def elsewhere(self, wanted: Sequence[float]) -> dict[float, Array]:
        """Terms for all amounts of haze, of which those that are not solved yet are solved by workers."""
        thickest = next(iter(self.solved.values()))
        settled = Settled(self.atmosphere, self.average, self.angles, self.stokes, thickest, self.nodes)
        table = {depth: self.terms(depth) for depth in wanted if depth in self.solved}
        shared = Shared(settled)
        with opened(self.executor) as engine:
            missing = [depth for depth in wanted if depth not in table]
            for task, terms in engine.results(Task(terms_for, (depth,), shared) for depth in missing):
                table[task.arguments[0]] = terms
                self.progress(min(len(table) / (FIRST_NODES + 2), 0.95))
        return {depth: table[depth] for depth in wanted}

    def terms(self, aod: float, nodes: Sequence[Array] | None = None) -> Array:
        """Terms on a grid of angles: (sun, view, azimuth, band, term)."""
        sun, view, azimuth = np.meshgrid(*(nodes or self.nodes), indexing="ij")
        return self.air(aod).terms(sun, view, azimuth)

    def refine_angles(self, aod: float) -> None:
        """More nodes over each angle until those between them are met, for one amount of haze."""
        ranges = (self.angles.sun_zenith, self.angles.view_zenith, self.angles.relative_azimuth)
        count = [max(n.size, 2 if high > low else 1) for n, (low, high) in zip(self.nodes, ranges, strict=True)]
        worst = [0.0, 0.0, 0.0]
        for axis, (low, high) in enumerate(ranges):
            while high > low:
                nodes = [lobatto(*r, n) for r, n in zip(ranges, count, strict=True)]
                # Other angles at their ends and middle; this one half-way between its nodes.
                probe = [n if n.size < 3 else n[[0, n.size // 2, -1]] for n in nodes]
                coarse, fine = list(probe), list(probe)
                coarse[axis], fine[axis] = nodes[axis], 0.5 * (nodes[axis][1:] + nodes[axis][:-1])
                weights = polynomial_weights(nodes[axis], fine[axis])
                guess = np.moveaxis(np.tensordot(weights, self.terms(aod, coarse), (1, axis)), 0, axis)
                worst[axis] = difference(guess, self.terms(aod, fine))
                if worst[axis] < self.tolerance / 6 or count[axis] >= MOST_NODES:
                    break
                count[axis] = count[axis] + 1 if count[axis] < 3 else 2 * count[axis] - 1
        self.nodes = tuple(lobatto(*r, n) for r, n in zip(ranges, count, strict=True))  # type: ignore[assignment]
        self.error = max(self.error, sum(worst))

    def refine_depths(self, table: dict[float, Array]) -> None:
        """More optical depths, where polynomials of all and of fewer nodes differ most, until one is met.

        What is met stays out of the table: nodes that crowd where nothing asks for them, as at the end of the range,
        make the polynomial through all of them swing elsewhere, by up to two hundred times the solutions' errors.
        """
        found, last = np.inf, False
        while not last and len(table) < MOST_SOLUTIONS:
            depths = np.array(sorted(table))
            values = np.stack([table[d] for d in depths])
            # The last look is at thick haze, where the solutions themselves are least smooth.
            last = found < self.tolerance / 2
            probe = 0.5 * float(depths[-1] + depths[-2]) if last else self.doubtful(depths, values)
            guess = np.tensordot(depth_weights(depths, probe), values, (0, 0))
            solved = self.terms(probe)
            off = difference(guess, solved)
            if off >= self.tolerance / 2 and not last:
                table[probe] = solved
            found = max(off, found if last else 0.0)
        self.error += found

    @staticmethod
    def doubtful(depths: Array, values: Array) -> float:
        """The middle of a gap at which leaving out one of the inner nodes changes the polynomial most."""
        middle = BENDS_AT * np.expm1(0.5 * (np.log1p(depths / BENDS_AT)[1:] + np.log1p(depths / BENDS_AT)[:-1]))
        whole = np.tensordot(depth_weights(depths, middle), values, (1, 0))
        doubt = np.zeros(middle.size)
        for left_out in range(1, depths.size - 1):
            keep = np.arange(depths.size) != left_out
            fewer = np.tensordot(depth_weights(depths[keep], middle), values[keep], (1, 0))
            # Only the gaps beside a node learn something from its absence.
            for gap in (left_out - 1, left_out):
                doubt[gap] = max(doubt[gap], difference(whole[gap], fewer[gap]))
        return float(middle[doubt.argmax()])


def difference(one: Array, other: Array) -> float:
    """Greatest difference of the reflectances above the air that two sets of terms give."""
    return max(float(np.abs(reflectance_above(one, r) - reflectance_above(other, r)).max()) for r in JUDGED)
