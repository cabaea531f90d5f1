"""Successive orders of scattering: the diffuse light of an atmosphere on a grid, order by order.

The radiance that reaches a node from every direction is kept as moments (`moments.py`).  The first order comes from
sunlight, each later one from the moments of the one before (`series.py` adds them up).
Lenoble (1985), Radiative Transfer in Scattering and Absorbing Atmospheres, section 2.5; delta-M: Wiscombe (1977),
J. Atmos. Sci. 34, 1408.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.kernels.bundle import Field
from skyscatter.kernels.course import Diffuse
from skyscatter.kernels.lookup import ColumnTable
from skyscatter.kernels.optics import SceneTable
from skyscatter.kernels.orders import look, make_sweep_scratch, refine, sweep_heights
from skyscatter.scene import Scene
from skyscatter.solvers import grid as grids
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.estimate import error_share, levelness
from skyscatter.solvers.moments import MomentTable, expand, moment_table, take_moments

Array = NDArray[np.float64]

#: Degrees to which phase functions may be kept, each with the tolerances below which it may be chosen, and no lower one
#: may; what is more forward-peaked is cut off (delta-M).
DEGREES = ((6, 1.0, 1.0), (8, 1.0, 0.01), (12, 0.02, 0.003), (16, 0.02, 0.001), (24, 0.002, 0.0))
#: Optical depth from above beyond which what lies beneath is not seen.
SEEN_DEPTH = 1.0
#: Optical depth of the cut peaks that is good enough, in units of the tolerance.
PEAK_SHARE = 1.5
#: What cut peaks may take, in units of the tolerance and at most, from sunlight that comes in nearly level.  Delta-M
#: lets it go on as if it had not been scattered; but where its way is long, a few degrees lead out of a layer.
LEVEL_PEAK_SHARE, MOST_LEVEL_PEAK = 10.0, 0.05
#: The first of these shrinks to one as the Sun sinks under a scale height: what lies in shadow is lit by light that was
#: turned by a few degrees, once or several times.  A veil in clear air then leaves out six times what it cuts.
#: Where more than the first number below, in units of the tolerance, is cut from level light, be it sunlight or what is
#: seen, a solution that tells the error keeps fewer degrees: the highest of these that is within the second number's
#: share or no more than the third.
TOLD_PEAK, TOLD_DEGREES, TOLD_LEAST = 0.1, 0.6, 8
#: The solution whose difference tells the error is coarser by this factor of the tolerance, that is half as fine.
COARSER = 4.0
#: Coefficients below this count as zero.
LEAST_COEFFICIENT = 2e-4
#: A coefficient this small beyond the kept degrees is no forward peak but a table's rounding.
LEAST_PEAK = 1e-4
#: Degrees to which cut forward peaks are followed: the first of these at which they have ended; and what may be left
#: of a peak at the last one, beyond which it is refused.
PEAK_DEGREES, PEAK_LEFT = (300, 700, 1500), 2e-3
#: They fade out over the last degrees, one in so many.
PEAK_FADES = 3.0
#: Largest angle at the planet's centre that a cell spans [rad], and its largest optical depth.
CELL_ANGLE, CELL_DEPTH = np.radians(0.6), 1.0
#: Altitudes at which a medium is looked at before its grid is made: even ones, and those within a cell of its table.
EVEN_SAMPLES, CELL_SAMPLES = 2001, 4
#: Shares of the tolerance for which directions, and positions of the Sun in twilight, are chosen where the Sun may be
#: below the horizon, and where it may be far below.  Light then comes from one side, low above the horizon: of what
#: rules of few points miss of it one order, the next misses as much again.  Directions for more than the last number
#: miss what several grids miss alike.
DUSK_DIRECTIONS, DUSK_SUNS = 0.5, 1.0
DEEP_DIRECTIONS, DEEP_SUNS, MOST_DEEP = 0.25, 0.5, 0.00125
#: What is far, in units of the angle under which a scale height sinks below the horizon: for directions, for Suns.
DEEP = 3.5, 4.5
#: Radiances that count as none; the share of the brightest about which more and more may be missing relatively, a
#: hundredth of what is left of the day's light at the end of astronomical twilight; and that which is not promised.
FLOOR, DIM, FAINTEST = 1e-35, 1e-10, 1e-13
#: Share of the tolerance below which a moment, against all light at its place, is left out of the orders that follow;
#: and the slowest decay from order to order that is reckoned with.
LEAST_STRENGTH, SLOWEST = 0.1, 0.99
#: The same for a moment at one point, against the isotropic part of the source there.
LEAST_SHARE = 0.05
#: Distance of stations in units of the least distance between two Sun nodes.
STATION = 0.45
#: Sine of the angle from the vertical below which a direction has no meridian plane of its own.
HAIR = 1e-6
#: Shares of the heights that a thread sweeps, one after the other.
SHARES = 4
#: Rays whose lines agree to this share of the planet's radius share a course; and so many of them at most.
SAME_COURSE, MOST_RAYS = 1e-10, 512


@dataclass(frozen=True)
class Problem:
    """All that the sweeps need: tables, grid and moments."""

    table: SceneTable
    diffuse: Diffuse
    grid: grids.Grid
    moments: MomentTable
    cut: Array  #: phase function (and b1) times scattering, without its peak; (use, component, angle, wavelength)
    whole: Array  #: the same with its peak
    stokes: int  #: Stokes parameters: 1, 3 or 4
    tolerance: float  #: for which the grid was made
    level_peaks: Array  #: share of level sunlight that delta-M takes for unscattered; (wavelength,)
    view_peaks: Array  #: the same of light that is seen along level rays; (wavelength,)
    degree: int  #: to which phase functions are kept
    coarser_degree: int | None  #: to which a solution that tells the error keeps phase functions; None: as it likes

    @property
    def seen(self) -> Problem:
        """The same as rays to an observer meet it: with more rows under a low Sun."""
        rows = self.grid.seen
        return replace(self, grid=replace(self.grid, rows=rows), diffuse=self.diffuse._replace(shell=rows))


def stated_share(fine: Problem, coarse: Problem) -> Array:
    """Share of the difference of two solutions that is stated as the finer one's error; (wavelength,) or a number."""
    if fine.view_peaks.max() > LEVEL_PEAK_SHARE * fine.tolerance:
        return error_share(fine.tolerance, fine.view_peaks, coarse.view_peaks)
    return error_share(fine.tolerance)


@dataclass(frozen=True)
class Sums:
    """The sum of all orders on the grid.

    Attributes
    ----------
    moments : (node, sun, moment, wavelength)
    flux : (node, 2, sun, wavelength)
        Diffuse, upward and downward [W m-2 nm-1].
    orders : int
        How many were computed before the rest was summed.
    """

    moments: Array
    flux: Array
    orders: int


def matrices(scene: Scene, table: SceneTable, wavelengths: Array, stokes: bool) -> Array:
    """Scattering matrices, or phase functions alone, of the components; (component, block, angle, wavelength)."""
    if not stokes:
        return table.optics.phase[:, None]
    from skyscatter.solvers.compile import matrix_tables

    return matrix_tables(scene.medium, tuple(float(w) for w in wavelengths))


def kept_degree(chi: Array, depth: Array, tolerance: float, level: Array | float = 0.0, shadow: float = 0.0) -> int:
    """Degree to which phase functions are kept.

    Parameters
    ----------
    chi : (component, block, l, wavelength)
        Coefficients of the phase functions.
    depth : (component, wavelength)
        Vertical optical depths of scattering.
    tolerance : float
    level : (component, wavelength), optional
        Share of level sunlight that is scattered on its way.
    shadow : float, optional
        How far a scale height lies in the planet's shadow, 0 to 1.

    Returns
    -------
    int
        The first of `DEGREES` beyond which forward peaks scatter less than a few times the tolerance; or less, where
        the phase functions have less.
    """
    largest = np.abs(chi[:, 0]).max(axis=(0, 2))
    needed = int(np.flatnonzero(largest > LEAST_COEFFICIENT).max(initial=0))
    least = max(degree for degree, _, must in DEGREES if tolerance < must)
    allowed = [degree for degree, may, _ in DEGREES if tolerance < may and degree >= least]
    for degree in allowed:
        peak = np.abs(chi[:, 0, degree + 1])
        most = min(LEVEL_PEAK_SHARE ** (1 - shadow) * tolerance, MOST_LEVEL_PEAK)
        level_enough = (peak * level).sum(axis=0).max() < most
        if level_enough and (peak * depth).sum(axis=0).max() < PEAK_SHARE * tolerance:
            return max(min(needed, degree), 2)
    return max(min(needed, allowed[-1]), 2)


def level_share(table: SceneTable) -> Array:
    """Share of level sunlight that every component scatters on its way; (component, wavelength)."""
    longest = outward_profile(table.columns, sample_altitudes(table.columns), 0.0).max(axis=0)
    return np.asarray(-np.expm1(-longest[:, None] * table.optics.sigma_s))


def sinking(columns: ColumnTable, altitude: Array, depth: Array, visible: float = SEEN_DEPTH) -> float:
    """Angle under which a scale height sinks below the horizon [rad], from vertical optical depths above altitudes.

    Of the two decades from the ground, or from the depth that is `visible` from above: haze near the ground says little
    of where light comes from after sunset, and what lies beneath a cloud says nothing.
    """
    lowest = min(depth[0], visible)
    low, high = np.interp([-lowest, -0.01 * lowest], -depth, altitude)
    scale = float(high - low) / np.log(100) if lowest > 0 else columns.top
    return float(np.arccos(columns.radius / (columns.radius + scale)))


def shadow_share(table: SceneTable, darkest: float) -> float:
    """How far a scale height lies in the planet's shadow, 0 to 1, for a zenith angle of the Sun [rad]."""
    if darkest <= np.pi / 2:
        return 0.0
    altitude = sample_altitudes(table.columns)
    depth = (outward_profile(table.columns, altitude) @ table.optics.sigma_t).mean(axis=1)
    return min((darkest - np.pi / 2) / sinking(table.columns, altitude, depth), 1.0)


def reach(radius: float, top: float) -> float:
    """Angle at the planet's centre between the ground and where its horizontal leaves the atmosphere [rad]."""
    return float(np.arccos(radius / (radius + top)))


def make_problem(
    scene: Scene,
    wavelengths: Array,
    sun_zenith: tuple[float, float],
    tolerance: float,
    stokes: bool = False,
    ground_radiance: float = 0.0,
    degree: int | None = None,
    cut_peaks: bool = True,
    grid: grids.Grid | None = None,
    darkest: float | None = None,
) -> Problem:
    """Tables and grid for a scene with the Sun between two zenith angles [rad].

    Without `cut_peaks` forward peaks stay where they are: right for the first order alone.  A grid that is given must
    have been made for the same top, Suns and degree.  What is seen is lit best by a Sun at the zenith angle `darkest`
    [rad] or higher; if that is not given, by one that is two reaches of the horizon above the lowest.
    """
    if scene.ground.map is not None:
        raise DomainError("ground.map", "a map", "the solver orders knows a uniform ground only; use solver path")
    table = compile_scene(scene, wavelengths)
    optics = table.optics
    matrix = matrices(scene, table, wavelengths, stokes)
    most = DEGREES[-1][0] if degree is None else degree
    chi = expand(matrix, most + 1)
    scatters = np.asarray((optics.sigma_s > 0).any(axis=1))
    chi = chi * scatters[:, None, None, None]
    column = outward_profile(table.columns)[0]
    if darkest is None:
        darkest = sun_zenith[1] - 2 * reach(table.columns.radius, table.columns.top)
    level, shadow = level_share(table), shadow_share(table, darkest)
    sunlit = float(levelness(sun_zenith[1])) * level
    depth = column[:, None] * optics.sigma_s
    kept = kept_degree(chi, depth, tolerance, sunlit, shadow) if degree is None else degree
    told = _told_degree(kept, kept_degree(chi, depth, COARSER * tolerance, sunlit, shadow)) if degree is None else None
    peak = chi[:, 0, kept + 1]
    peak = np.where((peak > LEAST_PEAK) & cut_peaks, np.minimum(peak, 0.999), 0.0)
    identity = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])[: chi.shape[1]]
    chi = chi[:, :, : kept + 1] - peak[:, None, None] * identity[None, :, None, None]
    chi[:, 1:4, :2] *= np.array([0.0, 0.0, 1.0])[None, : chi.shape[1] - 1, None, None]  # a2 and a3 begin at degree 2
    moments = moment_table(chi, kept, LEAST_COEFFICIENT)
    greek = chi * optics.sigma_s[:, None, None, :] * ((2 * np.arange(kept + 1) + 1) / (4 * np.pi))[:, None]
    sigma_t = optics.sigma_t - peak * optics.sigma_s
    whole, cut = _first_tables(matrix, greek, optics.sigma_s)
    fading = fading_rate(column, sigma_t, greek)
    grid = grid or make_grid(scene, table, sigma_t, sun_zenith, kept, tolerance, darkest, fading)
    light = np.stack([optics.background, np.full(wavelengths.size, ground_radiance), optics.albedo])
    tilt, share = _disk(optics)
    peaks = _peaks(matrix[:, :1], np.where(scatters[:, None], peak, 0.0), kept) * optics.sigma_s[:, None]
    diffuse = Diffuse(
        sigma_t=sigma_t, scatters=scatters, greek=np.ascontiguousarray(np.moveaxis(greek, 1, 0)),
        emission=optics.emission,
        light=light, peaks=np.ascontiguousarray(peaks),
        tilt=tilt, share=share, shell=grid.rows, sun_index=grid.index,
        sun_cubics=grids.sun_cubics(grid.sun_zenith, grid.fine_sun_zenith),
        max_angle=CELL_ANGLE * grids.fineness(tolerance), max_depth=CELL_DEPTH * grids.fineness(tolerance),
    )  # fmt: skip
    kinds = 1 if not stokes else 4 if 3 in moments.kind else 3
    level_peaks, view_peaks = ((peak * share).sum(axis=0) for share in (sunlit, level))
    coarser = told if view_peaks.max() > TOLD_PEAK * tolerance else None
    return Problem(table, diffuse, grid, moments, cut, whole, kinds, tolerance, level_peaks, view_peaks, kept, coarser)


def _told_degree(kept: int, by_tolerance: int) -> int | None:
    """Degree of a solution that tells what one of the degree `kept` cuts off; None if there is no lower one.

    It tells too little where it is close to that, or where a tolerance as coarse as its own keeps fewer still.
    """
    lower = [degree for degree, _, _ in DEGREES if degree < kept]
    far = [degree for degree in lower if degree <= max(TOLD_DEGREES * kept, TOLD_LEAST)]
    return min(max(far), by_tolerance) if far else None


def _peaks(phase: Array, peak: Array, kept: int) -> Array:
    """(2 l + 1) / (4 pi) r_l of what delta-M cuts off, (component, l, wavelength); no degrees where nothing is cut.

    r_l is the cut share up to the kept degree, and the phase function's own coefficient beyond.
    """
    if not (peak > 0).any():
        return np.zeros((len(phase), 0, phase.shape[3]))
    cut = peak > 0
    for degrees in PEAK_DEGREES:
        beyond = expand(phase, degrees)[:, 0]
        left = np.where(cut, beyond[:, -1], 0.0)
        if np.all(left < LEAST_PEAK):
            break
    if np.any(left > PEAK_LEFT):
        component = int(np.argmax(left.max(axis=1)))
        raise DomainError(
            f"components[{component}].optics", f"a forward peak narrower than {180 / PEAK_DEGREES[-1]:.2g} degrees",
            "one that the solver orders can follow; use solver path",
        )  # fmt: skip
    beyond[:, : kept + 1] = peak[:, None]
    beyond = np.where(cut[:, None], np.maximum(beyond, 0.0), 0.0)
    last = int(np.flatnonzero((beyond > LEAST_PEAK).any(axis=(0, 2))).max())
    degree = np.arange(last + 1)
    # A sum that is broken off rings: it is faded out instead.
    fade = np.cos(0.5 * np.pi * np.clip(1.0 + PEAK_FADES * (degree / max(last, 1) - 1.0), 0.0, 1.0)) ** 2
    return beyond[:, : last + 1] * (fade * (2 * degree + 1) / (4 * np.pi))[:, None]


def _first_tables(matrix: Array, greek: Array, sigma_s: Array) -> tuple[Array, Array]:
    """Whole and cut phase functions (and b1) times scattering per unit density, (use, component, angle, wavelength)."""
    from skyscatter.solvers.moments import B1, wigner

    cells = matrix.shape[2] - 1
    mu = 1 - 2 * (np.arange(cells + 1) / cells) ** 2
    blocks = [0] if matrix.shape[1] == 1 else [0, B1]
    whole = np.stack([matrix[:, b] * sigma_s[:, None] for b in blocks])
    degree = greek.shape[2] - 1
    cut = np.stack(
        [np.einsum("clw,lk->ckw", greek[:, b], wigner(degree, 0, 2 if b else 0, mu), optimize=True) for b in blocks]
    )
    return np.ascontiguousarray(whole), np.ascontiguousarray(cut)


def _disk(optics: Any) -> tuple[Array, Array]:
    """Zenith offsets that stand for the Sun, as cosine and sine, and the irradiance of each: middle, two, four.

    What reaches a point depends on the zenith angle alone.  Over it a uniform disk weighs as a semicircle, whose rules
    are Gauss-Chebyshev's of the second kind: nodes cos(k pi / (n + 1)), weights 2 sin^2(k pi / (n + 1)) / (n + 1).
    They are drawn together by as much as limb darkening lessens the second moment.
    """
    total = optics.sun_irradiance.sum(axis=0)
    square = np.linspace(0, 1, len(optics.disk_radiance))
    radiance = optics.disk_radiance.mean(axis=1)
    bright = np.trapezoid(radiance, square)
    radius = 0.0
    if optics.disk_radius > 0 and bright > 0:
        radius = np.sqrt(2 * np.trapezoid(radiance * square, square) / bright) * optics.disk_radius
    offset, weight = [0.0], [1.0]
    for n in (2, 4):
        angle = np.arange(1, n + 1) * np.pi / (n + 1)
        offset += list(radius * np.cos(angle))
        weight += list(2 / (n + 1) * np.sin(angle) ** 2)
    return np.stack([np.cos(offset), np.sin(offset)], axis=-1), np.array(weight)[:, None] * total


def sample_altitudes(columns: ColumnTable) -> Array:
    """Altitudes that see every layer [m]: even ones, and some within every cell of the table of columns.

    The table's cells end where a density jumps and close in on it, so that a sheet of metres has several.
    """
    foot, height = columns.cell[:, 0], 1 / columns.cell[:, 1]
    inside = foot[:, None] + height[:, None] * np.arange(CELL_SAMPLES) / CELL_SAMPLES
    even = columns.top * np.linspace(0, 1, EVEN_SAMPLES) ** 1.5
    both = np.unique(np.concatenate([even, inside.ravel()]))
    apart = np.diff(both, prepend=-1.0) > 1e-9 * columns.top
    both = both[apart]
    both[-1] = columns.top
    return np.asarray(both)


def fading_rate(column: Array, sigma_t: Array, greek: Array) -> Array:
    """Rate at which light fades with optical depth where it diffuses, sqrt(3 (1 - w) (1 - w g)), (wavelength,).

    With the albedo w and the mean cosine g of the whole column (component,); extinction (component, wavelength) and
    coefficients (component, block, degree, wavelength) per unit density, as in `Diffuse`.
    """
    total = np.maximum(column @ sigma_t, 1e-30)
    albedo, forward = (4 * np.pi / (2 * k + 1) * (column @ greek[:, 0, k]) / total for k in (0, 1))
    return np.asarray(np.sqrt(np.maximum(3 * (1 - albedo) * (1 - forward), 0.0)))


def make_grid(
    scene: Scene, table: SceneTable, sigma_t: Array, sun_zenith: tuple[float, float], degree: int, tolerance: float,
    darkest: float, fading: Array,
) -> grids.Grid:  # fmt: skip
    """The grid for a medium and a range of zenith angles of the Sun; `darkest` as for `make_problem`."""
    columns = table.columns
    altitude = sample_altitudes(columns)
    depth = outward_profile(columns, altitude) @ sigma_t
    sink = sinking(columns, altitude, depth.mean(axis=1))
    whole = sinking(columns, altitude, depth.mean(axis=1), np.inf)
    in_shadow = (darkest - np.pi / 2) / sink > DEEP[1]
    nodes = grids.height_nodes(
        altitude, depth, table.breaks, float(np.cos(sun_zenith[1])), tolerance, bool(in_shadow), fading
    )
    below = (sun_zenith[1] - np.pi / 2) / sink
    deep, night = (below > most for most in DEEP)
    for_directions = DEEP_DIRECTIONS if deep else DUSK_DIRECTIONS if below > 1 else 1.0
    for_suns = DEEP_SUNS if night else DUSK_SUNS if below > 1 else 1.0
    finer = min(tolerance * for_directions, MOST_DEEP if deep else 1.0)
    coarse, fine, index = grids.sun_nodes(*sun_zenith, sink, tolerance, for_suns, whole)
    between = grids.between_counts(nodes, columns.radius, sink, finer, bool(below > 0))
    quadrature = grids.directions(nodes, columns.radius, degree, finer, between)
    seen = grids.seen_rows(nodes, altitude, depth, float(levelness(sun_zenith[1])), tolerance)
    rows, azimuths = grids.rows_between(nodes), grids.azimuths(degree, finer)
    return grids.Grid(nodes, rows, seen, coarse, fine, index, between, quadrature, azimuths, finer)


@dataclass(frozen=True)
class Stage:
    """What orders of scattering are computed with: the moments that matter in them, and angles that suit these."""

    kept: NDArray[np.int64]  #: numbers of its moments among those of the problem
    diffuse: Diffuse  #: to the degree of those
    directions: Array  #: (node, direction, 2)
    take: Array  #: (node, direction, moment, stokes)
    azimuth: Array  #: (angle, 2) cosine and sine
    turns: NDArray[np.float32]  #: (order, 2, angle) cos(m phi), sin(m phi)
    field: Field

    @classmethod
    def of(cls, problem: Problem, kept: NDArray[np.int64]) -> Stage:
        """For some of the moments of a problem."""
        grid, all_of_them, diffuse = problem.grid, problem.moments, problem.diffuse
        moments = MomentTable(*(np.ascontiguousarray(column[kept]) for column in all_of_them))
        degree, order = int(moments.degree.max()), int(moments.order.max())
        # As few degrees ask for fewer angles; the grid's own serve all of them.
        directions = grid.directions
        azimuths = grid.azimuths
        if degree < int(all_of_them.degree.max()):
            radius = problem.table.columns.radius
            directions = grids.directions(grid.altitudes, radius, degree, grid.angular, grid.between)
        if order < int(all_of_them.order.max()):
            azimuths = grids.azimuths(order, grid.angular)
        m = np.arange(order + 1)[:, None]
        take = take_moments(moments, problem.stokes, directions[..., 0].ravel())
        # A flat world has one Sun for all; rays look between four.
        suns, wavelengths = max(grid.sun_zenith.size, 4), diffuse.sigma_t.shape[1]
        greek = np.ascontiguousarray(diffuse.greek[:, :, : degree + 1])
        return cls(
            kept, diffuse._replace(greek=greek), directions,
            take.reshape(*directions.shape[:2], *take.shape[1:]),
            np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1),
            np.stack([np.cos(m * azimuths), np.sin(m * azimuths)], axis=1).astype(np.float32),
            Field(
                np.empty((grid.rows.size, suns, kept.size, wavelengths), np.float32),
                np.zeros((suns, wavelengths), np.float32),
                moments.degree, moments.order, np.argsort(moments.order, kind="stable"), moments.gives,
                np.ones((grid.rows.size, kept.size)), grids.recurrence(degree, order),
                STATION * float(np.diff(grid.sun_zenith).min(initial=np.pi)), LEAST_SHARE * problem.tolerance,
            ),
        )  # fmt: skip


def moment_weights(problem: Problem) -> Array:
    """What scattering makes of a unit of each moment at most, in units of what it makes of the mean radiance.

    Shape (moment,); 0 for those that are not scattered at all.
    """
    greek, table = np.abs(problem.diffuse.greek), problem.moments
    scatters = greek[0, :, 0] > 0
    chi = (greek / np.where(scatters, greek[0, :, 0], 1.0)[None, :, None]).max(axis=(1, 3))  # (block, degree)
    gives = chi[table.gives[:, :, 0], table.degree[:, None]].max(axis=1)
    return np.where(table.order == 0, 1.0, 2.0) * gives


def per_light(mean: Array) -> Array:
    """One over a light, by which its changes count; less where it is dim, for deep night does not hold a day up."""
    return np.asarray(1.0 / (np.maximum(mean, 0.0) + max(DIM * float(mean.max()), FLOOR)))


def strengths(problem: Problem, moments: Array, total: Array) -> Array:
    """Greatest share that moments of one order have in the light that all orders so far scatter at a place.

    Parameters
    ----------
    problem : Problem
    moments, total : (node, sun, moment, wavelength)
        Of the order, and of the sum; of the sum the mean radiance counts (moment 0).

    Returns
    -------
    ndarray, shape (moment,)
        0 for those that are not scattered at all.
    """
    mean = total[:, :, 0]
    per_mean = per_light(mean)
    largest = [float(np.max(np.abs(moments[:, :, k]) * per_mean)) for k in range(moments.shape[2])]
    return moment_weights(problem) * largest


class Sweeper:
    """Runs the kernels over the heights of a problem in a pool of threads."""

    def __init__(self, problem: Problem, threads: int) -> None:
        self.problem, self.threads = problem, threads
        grid = problem.grid
        self.row_node, self.row_weight = grids.cubic_weights(grid.altitudes, grid.rows)
        self._begin(Stage.of(problem, np.arange(problem.moments.degree.size)))

    def _begin(self, stage: Stage) -> None:
        """Go on with other moments and angles."""
        self.stage = stage
        self.scratch: SimpleQueue[Any] = SimpleQueue()
        rays = self.problem.grid.sun_zenith.size * stage.azimuth.shape[0]
        for _ in range(self.threads):
            self.scratch.put(make_sweep_scratch(stage.diffuse, stage.field, self.problem.stokes, rays))

    def narrow(self, moments: Array, total: Array, rate: float) -> None:
        """Leave out of the orders to come what has become too small in the last one, and all after it, to matter.

        Light that was scattered often is smooth: after a few orders a few moments are left, and few angles do.

        Parameters
        ----------
        moments, total : (node, sun, moment, wavelength)
            Of the last order, and of the sum.
        rate : float
            By how much orders fall from one to the next: the later ones have rate / (1 - rate) of the last.
        """
        strength = strengths(self.problem, moments, total) / (1 - min(rate, SLOWEST))
        matters = strength[self.stage.kept] > LEAST_STRENGTH * self.problem.tolerance
        matters[0] = True
        if not matters.all():
            self._begin(Stage.of(self.problem, self.stage.kept[matters]))

    @contextmanager
    def _a_scratch(self) -> Iterator[Any]:
        scratch = self.scratch.get()
        try:
            yield scratch
        finally:
            self.scratch.put(scratch)

    def first(self, pool: ThreadPoolExecutor) -> tuple[Array, Array]:
        """Moments and fluxes of the first order."""
        return self._sweep(pool, True)

    def next(self, pool: ThreadPoolExecutor, moments: Array, flux: Array) -> tuple[Array, Array]:
        """Moments and fluxes of the order after the one given."""
        self.load(pool, moments, flux)
        return self._sweep(pool, False)

    def _sweep(self, pool: ThreadPoolExecutor, is_first: bool) -> tuple[Array, Array]:
        p, grid, stage = self.problem, self.problem.grid, self.stage
        nodes, suns, wavelengths = grid.altitudes.size, grid.sun_zenith.size, p.diffuse.sigma_t.shape[1]
        moments = np.zeros((nodes, suns, p.moments.degree.size, wavelengths))
        flux = np.zeros((nodes, 2, suns, wavelengths))
        sun_mu, fine_mu = np.cos(grid.sun_zenith), np.cos(grid.fine_sun_zenith)
        # A call lays out all these tables; heights next to each other cost alike, and so every share has some of all.
        shares = min(SHARES * self.threads, nodes)

        def heights(k: int) -> None:
            with self._a_scratch() as scratch:
                sweep_heights(
                    p.table.columns, stage.diffuse, p.cut, stage.field, grid.altitudes, np.arange(k, nodes, shares),
                    stage.directions, stage.take, sun_mu, fine_mu, stage.azimuth, stage.turns, stage.kept, is_first,
                    scratch, moments, flux,
                )  # fmt: skip

        for _ in pool.map(heights, range(shares)):
            pass
        return moments, flux

    def load(self, pool: ThreadPoolExecutor, moments: Array, flux: Array) -> Field:
        """Interpolate moments and the ground's light into the field from which rays gather."""
        field, nodes, suns = self.stage.field, len(moments), moments.shape[1]
        packed = np.empty((nodes, suns, self.stage.kept.size, moments.shape[3]))
        largest = np.empty((suns, nodes, self.stage.kept.size))

        def pack(sun: int) -> None:
            mean = np.maximum(moments[:, sun, :1], FLOOR)
            shape = np.clip(moments[:, sun, self.stage.kept] / mean, -2.0, 2.0)
            largest[sun] = np.abs(shape).max(axis=2)
            shape[:, :1] = np.log(mean)
            packed[:, sun] = shape

        def spread(sun: int) -> None:
            refine(packed, self.row_node, self.row_weight, sun, sun + 1, field.moments)

        for work, count in ((pack, suns), (spread, field.ground.shape[0])):
            for _ in pool.map(work, range(count)):
                pass
        highest = largest.max(axis=0)
        field.bound[:] = np.einsum("rk,rkm->rm", np.abs(self.row_weight), highest[self.row_node])
        field.bound[:, 0] = 1.0
        field.ground[:] = np.maximum(self.problem.diffuse.light[2] / np.pi * flux[0, 1], FLOOR)
        return field


@dataclass(frozen=True)
class Solution:
    """One grid with its sum of orders, ready to be looked at."""

    problem: Problem
    sums: Sums
    threads: int = 1  #: that make it ready

    @property
    def unseen(self) -> float:
        """Radiance of which nothing is promised [W m-2 sr-1 nm-1]."""
        return FAINTEST * float(self.sums.moments[:, :, 0].max())

    @cached_property
    def loaded(self) -> Field:
        """Moments on the rows and Sun nodes that `view` reads."""
        sweeper, moments = Sweeper(self.problem.seen, self.threads), self.sums.moments
        sweeper.narrow(moments, moments, 0.0)
        with ThreadPoolExecutor(self.threads) as pool:
            return sweeper.load(pool, moments, self.sums.flux)


def view(
    problem: Problem,
    field: Field,
    table: SceneTable,
    origins: Array,
    directions: Array,
    lit: NDArray[np.float32] | None = None,
    chain: Array | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Radiance along rays from a loaded field, with the Sun where `table` has it.

    `lit` and `chain` (ray, component, wavelength) are filled where they are given.

    Returns
    -------
    scattered, multiple : (ray, stokes, wavelength), reflected, direct : (ray, wavelength)
        See `skyscatter.kernels.orders.look`.
    """
    problem = problem.seen
    if problem.stokes > 1:
        directions = off_vertical(origins, directions)
    order, group = bundles(origins, directions, table.columns.radius)
    rays, wavelengths = len(origins), problem.diffuse.sigma_t.shape[1]
    scattered, multiple = (np.empty((rays, problem.stokes, wavelengths)) for _ in range(2))
    reflected, direct = (np.empty((rays, wavelengths)) for _ in range(2))
    scratch = make_sweep_scratch(problem.diffuse, field, problem.stokes, int(np.diff(group).max(initial=1)))
    sunlit = np.empty((0, 0, 0) if lit is None else lit.shape, np.float32)
    chains = np.zeros((0, 0, 0) if chain is None else chain.shape)
    look(
        table.columns, problem.diffuse, table.optics, problem.whole, field, origins[order], directions[order], group,
        scratch, scattered, reflected, multiple, direct, sunlit, chains,
    )  # fmt: skip
    back = np.empty_like(order)
    back[order] = np.arange(rays)
    if lit is not None:
        lit[:] = sunlit[back]
    if chain is not None:
        chain[:] = chains[back]
    return scattered[back], multiple[back], reflected[back], direct[back]


def diffuse_light(scattered: Array, multiple: Array, reflected: Array, direct: Array) -> Array:
    """All that `view` found but the direct light, (ray, stokes, wavelength).

    Where there is next to no light, deep in the night, the sum of its moments swings about zero.
    """
    found = scattered + multiple
    found[:, 0] = scattered[:, 0] + np.maximum(multiple[:, 0], 0.0) + reflected
    return np.asarray(found)


def off_vertical(origins: Array, directions: Array) -> Array:
    """Directions, with vertical ones tilted by a hair so that their meridian plane is that of the conventions."""
    up = origins / np.linalg.norm(origins, axis=1, keepdims=True)
    vertical = np.linalg.norm(np.cross(up, directions), axis=1) < HAIR
    if not vertical.any():
        return directions
    out = directions.copy()
    v, _ = meridian_frame(origins[vertical], directions[vertical])
    side = np.sign(np.einsum("rk,rk->r", up[vertical], directions[vertical]))[:, None]
    tilted = directions[vertical] - side * HAIR * v
    out[vertical] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return out


def same_course(origins: Array, directions: Array, radius: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """An order of rays in which those that share a course are neighbours, and where the courses begin and end."""
    along = np.einsum("rk,rk->r", origins, directions)
    height = np.linalg.norm(origins, axis=1)
    key = np.round(np.stack([along, height], axis=1) / (SAME_COURSE * radius)).astype(np.int64)
    order = np.lexsort((key[:, 1], key[:, 0])).astype(np.int64)
    sorted_key = key[order]
    first = np.flatnonzero(np.any(np.diff(sorted_key, axis=0) != 0, axis=1)) + 1
    return order, np.concatenate([[0], first, [len(order)]]).astype(np.int64)


def bundles(origins: Array, directions: Array, radius: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The same, in bundles that kernels have room for."""
    order, edges = same_course(origins, directions, radius)
    return order, np.unique(np.concatenate([edges, np.arange(0, len(order), MOST_RAYS)])).astype(np.int64)
