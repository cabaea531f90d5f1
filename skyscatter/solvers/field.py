"""A solved sky: the diffuse light of an atmosphere, kept and asked for any observer, direction and Sun."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.geometry.seen import needed_zenith, seen_zenith
from skyscatter.kernels.forms import expect
from skyscatter.kernels.optics import SceneTable
from skyscatter.progress import say
from skyscatter.scene import Scene, Sun
from skyscatter.solvers.base import Answer, Array
from skyscatter.solvers.checks import check_rays, check_wavelengths, worker_count
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.cycles import all_orders
from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.effort import check_effort, check_memory
from skyscatter.solvers.estimate import level_error, relative_error, turned
from skyscatter.solvers.fluxes import Fluxes, Work, direct_beam, fluxes, sphere_rule
from skyscatter.solvers.grid import Grid
from skyscatter.solvers.options import ORDERS_TOLERANCE, Orders
from skyscatter.solvers.series import sum_orders
from skyscatter.solvers.skytable import SkyTable, make_table
from skyscatter.solvers.spectral import at_all, at_some, needed, some_of
from skyscatter.solvers.state import Checkpoint, RenderState, checkpoint_of
from skyscatter.solvers.sweeps import (
    COARSER,
    Problem,
    Solution,
    Sums,
    Sweeper,
    bundles,
    diffuse_light,
    make_problem,
    reach,
    stated_share,
    view,
)
from skyscatter.workers import Workers, steady_algebra

if TYPE_CHECKING:
    import xarray

#: Relative accuracy when nothing else is said.
DEFAULT_TOLERANCE = ORDERS_TOLERANCE
#: No grid is coarser than this asks for, but that for its error: less would save nothing.
LOOSEST = 0.015
#: Rays of a bundle on which both solutions are compared, at most.
COMPARED = 4
#: Rays evaluated together: a sixteenth of all, whatever the threads, within these.
CHUNKS, CHUNK = 16, (1024, 8192)
#: Version of the file layout.
FILE_VERSION = 3


def solve_once(
    scene: Scene,
    wavelengths: Array,
    zenith: tuple[float, float],
    tolerance: float,
    stokes: bool,
    max_order: int | None,
    threads: int,
    progress: Callable[[float], None] | None = None,
    ground_radiance: float = 0.0,
    degree: int | None = None,
    orders_tolerance: float | None = None,
    grid: Grid | None = None,
    checkpoint: Checkpoint | None = None,
    name: str = "",
) -> Solution:
    """One solution on one grid.

    Phase functions are kept to a given degree, or to one that suits the tolerance; the sum over the orders stops by a
    tolerance of its own where one is given, and a grid may be given as for `make_problem`.  With a checkpoint it is
    kept there under a name, order by order.
    """
    problem = make_problem(scene, wavelengths, zenith, tolerance, stokes, ground_radiance, degree, max_order != 1, grid)
    goal = orders_tolerance or tolerance
    check_effort(problem, wavelengths, goal, max_order)
    check_memory(problem)
    sweeper, more = Sweeper(problem, threads), (progress, checkpoint, name)
    if max_order is None:
        return Solution(problem, all_orders(sweeper, goal, None, *more), threads)
    return Solution(problem, sum_orders(sweeper, goal, max_order, *more), threads)


def highest_sight(origins: Array, directions: Array, radius: float, top: float) -> float:
    """Greatest altitude [m], up to the top, of the lowest points of rays."""
    along = np.minimum(np.einsum("rk,rk->r", origins, directions), 0.0)
    lowest = np.sqrt(np.maximum(np.einsum("rk,rk->r", origins, origins) - along**2, 0.0)) - radius
    # A ray that passes above the top sees nothing; one that begins there and looks down sees its own lowest point.
    lowest = np.where(lowest < top, np.maximum(lowest, 0.0), 0.0)
    return float(lowest.max(initial=0.0))


def scattering_top(table: SceneTable) -> float:
    """Altitude above which there is a thousandth of what scatters at any wavelength [m]."""
    columns = table.columns
    altitude = np.linspace(0, columns.top, 400)
    depth = outward_profile(columns, altitude) @ table.optics.sigma_s
    matters = (depth > 1e-3 * depth[0]).any(axis=1)
    return float(altitude[min(int(matters.sum()), altitude.size - 1)])


def solve(
    scene: Scene,
    wavelengths: ArrayLike,
    *,
    sun_elevations_deg: tuple[float, float] = (-90.0, 90.0),
    tolerance: float = DEFAULT_TOLERANCE,
    stokes: bool = False,
    max_order: int | None = None,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
    resume: str | os.PathLike[str] | None = None,
    checkpoint: Checkpoint | str | os.PathLike[str] | None = None,
) -> RadianceField:
    """Solve the diffuse light of a scene by successive orders of scattering, once for many questions.

    Parameters
    ----------
    scene : Scene
        Its medium, ground and star; where the Sun and the observer stand is asked for later.  No Moon stands before it:
        in eclipses `skyscatter.radiance` and `skyscatter.render` follow the shadow.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.  Sunlight is averaged over the cell of each, half-way to its neighbours; a
        single one stands for itself.
    sun_elevations_deg : (float, float)
        Elevations of the Sun, as observers inside the atmosphere have it, that will be asked for [degree].  All of them
        when not given, which observers in space need too; a narrow range is solved faster.
    tolerance : float
        Relative accuracy of the radiance that is aimed at; the answers carry an estimate of what was reached.
    stokes : bool
        Solve for polarised light.
    max_order : int, optional
        Leave out light that was scattered or reflected more often than this; scatterings into a cut forward peak do
        not count, unless it is 1.
    threads : int, optional
        All processors when not given.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    resume : path, optional
        Checkpoint of an interrupted solution with the same arguments; also kept there from then on, unless
        `checkpoint` names another folder.
    checkpoint : path or skyscatter.solvers.state.Checkpoint, optional
        Folder in which the orders so far are kept, every three minutes or as often as the `Checkpoint` says, and on
        Ctrl-C.

    Returns
    -------
    RadianceField

    Raises
    ------
    DomainError
        For wavelengths, elevations or a tolerance out of range, and for a checkpoint of another solution.
    ConvergenceError
        If the orders of scattering do not settle: a very thick medium that absorbs nothing.

    Examples
    --------
    Zenith radiance at three elevations of the Sun from one solution.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene()
    >>> field = skyscatter.solve(scene, [550], sun_elevations_deg=(10, 60), tolerance=0.02)
    >>> here = scene.observer.position
    >>> zenith = [field.radiance(here, [0, 0, 1], sun_elevation_deg=e).radiance[0] for e in (60, 30, 10)]
    >>> [f"{radiance:.1e}" for radiance in zenith]  # W m-2 sr-1 nm-1
    ['4.7e-02', '2.0e-02', '1.2e-02']
    """
    from skyscatter import __version__

    wl = check_wavelengths(wavelengths)
    zenith = zenith_range(scene, sun_elevations_deg, tolerance)
    Orders(max_order=max_order)
    workers = worker_count(threads)
    recipe = {
        "skyscatter": __version__,
        "scene": scene.model_dump(mode="json", exclude={"sun", "altitude"}, exclude_none=True),
        "wavelengths_nm": wl.tolist(),
        "sun_elevations_deg": [float(e) for e in sun_elevations_deg],
        "tolerance": float(tolerance),
        "stokes": bool(stokes),
        "max_order": max_order,
    }
    kept = checkpoint_of(checkpoint or resume)
    if kept is not None:
        kept.begin(RenderState.empty(recipe, 0, 0), resume)
    try:
        field = solve_range(scene, wl, zenith, tolerance, stokes, max_order, workers, progress, kept)
    except KeyboardInterrupt:
        if kept is not None:
            kept.save()
        raise
    return field


def zenith_range(scene: Scene, sun_elevations_deg: tuple[float, float], tolerance: float) -> tuple[float, float]:
    """Zenith angles of the Sun [rad] that a solution has to cover for those elevations, after checks of both."""
    low, high = (float(e) for e in sun_elevations_deg)
    if not -90 <= low <= high <= 90:
        raise DomainError("sun_elevations_deg", (low, high), "lowest and highest, between -90 and 90 degrees")
    Orders(tolerance=tolerance)
    margin = 2 * reach(scene.medium.radius, scene.medium.top)
    return max(np.radians(90 - high) - margin, 0.0), min(np.radians(90 - low) + margin, np.pi)


@steady_algebra()
def solve_range(
    scene: Scene,
    wavelengths: Array,
    zenith: tuple[float, float],
    tolerance: float,
    stokes: bool,
    max_order: int | None,
    threads: int,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
    darkest: float | None = None,
) -> RadianceField:
    """As `solve`, for a range of zenith angles of the Sun [rad], wherever it is in the atmosphere.

    `darkest` is as for `make_problem`.
    """
    expect("orders")
    zenith = (max(zenith[0], 0.0), min(zenith[1], np.pi))
    made = _Making(scene, wavelengths, zenith, stokes, max_order, threads, progress, checkpoint, darkest)
    return made.field(min(tolerance, LOOSEST))


@dataclass(frozen=True)
class _Making:
    """How a field is made: a solution from one that is half as fine, which also tells its error."""

    scene: Scene
    wavelengths: Array
    zenith: tuple[float, float]
    stokes: bool
    max_order: int | None
    threads: int
    progress: Callable[[float], None] | None = None
    checkpoint: Checkpoint | None = None
    darkest: float | None = None

    def field(self, tolerance: float, coarse: Solution | None = None) -> RadianceField:
        """The solution to a tolerance, and the coarser one, which may be known already."""
        air = self.scene, self.wavelengths, self.zenith
        problem = make_problem(*air, tolerance, self.stokes, cut_peaks=self.max_order != 1, darkest=self.darkest)
        check_effort(problem, self.wavelengths, tolerance, self.max_order)
        check_memory(problem)
        told = problem.coarser_degree
        if coarse is None or (told is not None and coarse.problem.degree > told):  # what both leave out tells nothing
            if self.progress is not None:
                say("orders of scattering, coarser, for the error")
            coarse = solve_once(
                *air, COARSER * tolerance, self.stokes, self.max_order, self.threads,
                degree=told, checkpoint=self.checkpoint, name="coarse",
            )  # fmt: skip
        if self.progress is not None:
            say("orders of scattering", anew=False)
        return RadianceField(*air, tolerance, self.stokes, self._finer(problem, coarse), coarse, self.max_order)

    def _finer(self, problem: Problem, coarse: Solution) -> Solution:
        """The solution at some of the wavelengths, with the help of the coarser one, carried to all others."""
        chosen = needed(coarse, self.wavelengths, problem.tolerance)
        numbers, more = chosen.numbers, (self.progress, self.checkpoint, "fine")
        sweeper = Sweeper(at_some(problem, self.scene, self.wavelengths, numbers), self.threads)
        if self.max_order is None:
            guide = some_of(coarse, self.scene, self.wavelengths, numbers)
            sums = all_orders(sweeper, problem.tolerance, guide, *more)
        else:
            sums = sum_orders(sweeper, problem.tolerance, self.max_order, *more)
        if numbers.size < self.wavelengths.size:
            sums = at_all(sums, problem, coarse, chosen, self.threads)
        return Solution(problem, sums, self.threads)


def check_coverage(scene: Scene, zenith: tuple[float, float], origins: Array, directions: Array, sun: Sun) -> None:
    """Refuse rays on which the Sun stands outside of those zenith angles [rad]."""
    medium = scene.medium
    low, high = needed_zenith(origins, directions, sun.direction, medium.radius, medium.top)
    if low < zenith[0] - 1e-6 or high > zenith[1] + 1e-6:
        need, have = ((90 - np.degrees(z[1]), 90 - np.degrees(z[0])) for z in ((low, high), zenith))
        raise DomainError(
            "sun_elevation_deg", sun.elevation_deg,
            f"the rays see air with the Sun at {need[0]:.1f} to {need[1]:.1f} degrees and the field covers "
            f"{have[0]:.1f} to {have[1]:.1f}; solve with wider sun_elevations_deg",
        )  # fmt: skip


@dataclass(frozen=True)
class RadianceField:
    """The light of all orders of scattering in a spherical atmosphere, on a grid of heights and Sun elevations.

    Made by `skyscatter.solve`.

    Attributes
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm].
    zenith : (float, float)
        Covered zenith angles of the Sun [rad].
    tolerance : float
    stokes : bool
    fine, coarse : Solution
        The solution, and one of half the fineness from whose difference the error is estimated.
    max_order : int, optional
        Light that was scattered more often was left out.

    Examples
    --------
    Sunlight and skylight on the ground at 450 and 650 nm: the sky's share is larger in the blue.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
    >>> field = skyscatter.solve(scene, [450, 650], sun_elevations_deg=(30, 30), tolerance=0.02)
    >>> fluxes = field.fluxes(0.0)  # on the ground
    >>> fluxes.direct.round(1), fluxes.diffuse_down.round(1)  # W m-2 nm-1
    (array([0.4, 0.6]), array([0.2, 0.1]))
    """

    scene: Scene
    wavelengths: Array
    zenith: tuple[float, float]
    tolerance: float
    stokes: bool
    fine: Solution = field(repr=False)
    coarse: Solution = field(repr=False)
    max_order: int | None = None

    def __post_init__(self) -> None:
        # Loading is not thread-safe; do it before threads ask.
        _ = self.fine.loaded, self.coarse.loaded

    def at(self, sun: Sun) -> SceneTable:
        """Tables of the scene with the Sun elsewhere."""
        return compile_scene(self.scene.model_copy(update={"sun": sun}), self.wavelengths)

    @steady_algebra()
    def refined(self, *, threads: int | None = None, progress: Callable[[float], None] | None = None) -> RadianceField:
        """The field to a quarter of the tolerance, which goes on from what is known: a first answer comes soon.

        Parameters
        ----------
        threads : int, optional
            All processors when not given.
        progress : callable, optional
            Called with the finished share, 0 to 1.

        Returns
        -------
        RadianceField
            What this one knows is the coarser solution that tells its error.

        Raises
        ------
        DomainError
            Where the tolerance would fall below 1e-4, or the work is too much.

        Examples
        --------
        The first answer is good to its stated error, and the second one changes it by less.

        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
        >>> first = skyscatter.solve(scene, [450, 550, 650], sun_elevations_deg=(30, 30), tolerance=0.015)
        >>> better = first.refined()
        >>> first.tolerance, better.tolerance
        (0.015, 0.00375)
        >>> one, two = (field.radiance(scene.observer.position, [0, 0, 1]) for field in (first, better))
        >>> bool((abs(one.radiance - two.radiance) < one.estimated_error).all())
        True
        """
        tolerance = self.tolerance / COARSER
        Orders(tolerance=tolerance)
        how = self.scene, self.wavelengths, self.zenith, self.stokes, self.max_order
        return _Making(*how, worker_count(threads), progress).field(tolerance, self.fine)

    @steady_algebra()
    def radiance(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        sun_elevation_deg: float | None = None,
        sun_azimuth_deg: float | None = None,
        parts: bool = False,
        threads: int | None = None,
    ) -> Answer:
        """Spectral radiance that arrives along rays, and an estimate of its error.

        Parameters
        ----------
        origins : array_like, shape (..., 3)
            Where the rays are observed, from the planet's centre in the scene's frame (east, north, up) [m].
        directions : array_like, shape (..., 3)
            Unit vectors in which to look.  Broadcast against the origins.
        sun_elevation_deg, sun_azimuth_deg : float, optional
            Of the Sun for an observer on the z axis [degree]; the scene's when not given.
        parts : bool
            Return the parts of the radiance as layers: direct, scattered (once), ground (reflected once), multiple.
        threads : int, optional
            All processors when not given.

        Returns
        -------
        Answer
            As of `skyscatter.radiance`; its error is an estimated one.

        Raises
        ------
        DomainError
            For rays inside the planet, or a Sun that the field does not cover.

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
        >>> field = skyscatter.solve(scene, [550], sun_elevations_deg=(20, 40), tolerance=0.02)
        >>> sky = field.radiance(scene.observer.position, [0, 0, 1], parts=True)
        >>> sky.radiance.shape, sorted(sky.layers)
        ((1,), ['direct', 'ground', 'multiple', 'scattered'])
        >>> float((sky.layers["multiple"] / sky.radiance).round(2)[0])  # the share scattered more than once
        0.25
        """
        o, d = check_rays(self.scene, origins, directions)
        sun = self.sun(sun_elevation_deg, sun_azimuth_deg)
        flat_o, flat_d = (np.ascontiguousarray(a.reshape(-1, 3)) for a in (o, d))
        self.check_coverage(flat_o, flat_d, sun)
        found, shape = self.along(flat_o, flat_d, self.at(sun), parts, threads), (*o.shape[:-1], self.wavelengths.size)
        return Answer(
            found.radiance.reshape(shape),
            found.standard_error.reshape(shape),
            {name: values.reshape(shape) for name, values in found.layers.items()},
            np.zeros(shape[:-1], np.int64),
            "estimated",
        )

    def along(
        self,
        origins: Array,
        directions: Array,
        table: SceneTable,
        parts: bool,
        threads: int | None = None,
        sky: SkyTable | None = None,
    ) -> Answer:
        """`radiance` of rays (ray, 3) with the Sun where `table` has it; that the field covers them is not asked again.

        With a `sky_table` of more rays, these are some of them.
        """
        workers = worker_count(threads)
        size = min(max(len(origins) // CHUNKS, CHUNK[0]), CHUNK[1])
        chunks = [slice(k, k + size) for k in range(0, len(origins), size)]
        found = sky or self.sky_table(table, origins, directions, workers)
        with Workers(workers) as pool:
            answers = list(pool.map(lambda s: self.look(table, origins[s], directions[s], parts, found), chunks))
        empty, layers = np.zeros((0, self.wavelengths.size)), answers[0].layers if answers else {}
        return Answer(
            np.concatenate([a.radiance for a in answers] or [empty]),
            np.concatenate([a.standard_error for a in answers] or [empty]),
            {name: np.concatenate([a.layers[name] for a in answers]) for name in layers},
            np.zeros(len(origins), np.int64),
            "estimated",
        )

    def fluxes(
        self,
        altitude: ArrayLike,
        *,
        sun_elevation_deg: ArrayLike | None = None,
        progress: Callable[[float], None] | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Fluxes:
        """Fluxes through a horizontal plane, and the actinic flux, at altitudes inside the atmosphere.

        Parameters
        ----------
        altitude : array_like
            Above the ground, to the top of the atmosphere [m].
        sun_elevation_deg : array_like, optional
            Of the Sun there [degree]; the scene's when not given.  Broadcast against the altitudes.
        progress : callable, optional
            Called with the finished share, 0 to 1.
        checkpoint : skyscatter.solvers.state.Checkpoint, optional
            That with which the field was solved: fluxes are kept there too, and those that it holds are not made again.

        Returns
        -------
        Fluxes
            Each of the broadcast shape with a last axis of wavelengths [W m-2 nm-1].

        Raises
        ------
        DomainError
            Outside the atmosphere, or for a Sun that the field does not cover.

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
        >>> field = skyscatter.solve(scene, [550], sun_elevations_deg=(20, 40), tolerance=0.02)
        >>> found = field.fluxes([0.0, 30e3], sun_elevation_deg=30)
        >>> found.net.shape  # altitude, wavelength
        (2, 1)
        >>> found.net[:, 0].round(2)  # W m-2 nm-1, on the ground and at 30 km
        array([0.73, 0.76])
        """
        elevation = self.scene.sun.elevation_deg if sun_elevation_deg is None else sun_elevation_deg
        if hasattr(altitude, "to_value"):
            altitude = altitude.to_value("m")
        h, e = np.broadcast_arrays(np.asarray(altitude, float), np.asarray(elevation, float))
        top = self.scene.medium.top
        if h.size and not (h.min() >= 0 and h.max() <= top):
            raise DomainError("altitude", float(h.max()), f"lies between 0 and the atmosphere's top, {top:g} m")
        zenith = np.radians(90 - e)
        if h.size and (zenith.min() < self.zenith[0] - 1e-6 or zenith.max() > self.zenith[1] + 1e-6):
            have = tuple(round(90 - float(np.degrees(z)), 1) for z in self.zenith[::-1])
            raise DomainError("sun_elevation_deg", elevation, f"the field covers {have}; solve a wider range")
        return fluxes(self.fine, h, zenith, self.coarse, Work(progress, checkpoint))

    def flux_dataset(
        self,
        altitudes: ArrayLike = 0.0,
        sun_elevations_deg: ArrayLike | None = None,
        *,
        progress: Callable[[float], None] | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> xarray.Dataset:
        """Fluxes at every one of some altitudes under every one of some Suns, as an xarray Dataset.

        Parameters
        ----------
        altitudes : array_like, shape (altitude,)
            Above the ground, to the top of the atmosphere [m].
        sun_elevations_deg : array_like, shape (sun_elevation,), optional
            Of the Sun there [degree]; the scene's when not given.
        progress, checkpoint
            As for `fluxes`.

        Returns
        -------
        xarray.Dataset
            ``direct``, ``diffuse_down``, ``down``, ``up``, ``net`` and ``actinic`` [W m-2 nm-1] and their estimated
            errors (``down_error`` and so on), each (altitude, sun_elevation, wavelength).

        Raises
        ------
        DomainError
            As `fluxes`.

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene()
        >>> field = skyscatter.solve(scene, [450, 650], sun_elevations_deg=(20, 40), tolerance=0.02)
        >>> fluxes = field.flux_dataset([0, 10e3], [20, 30, 40])
        >>> fluxes.net.dims, fluxes.net.shape
        (('altitude', 'sun_elevation', 'wavelength'), (2, 3, 2))
        >>> fluxes.net.sel(altitude=0, wavelength=650).values.round(1)  # W m-2 nm-1
        array([0.4, 0.7, 0.9])
        """
        from skyscatter.solvers.fluxdata import to_dataset

        elevations = self.scene.sun.elevation_deg if sun_elevations_deg is None else sun_elevations_deg
        if hasattr(altitudes, "to_value"):
            altitudes = altitudes.to_value("m")
        h, e = (np.atleast_1d(np.asarray(values, float)) for values in (altitudes, elevations))
        if h.ndim != 1 or e.ndim != 1:
            raise DomainError("altitudes", h.shape, "lists of altitudes and of elevations; for other shapes use fluxes")
        found = self.fluxes(h[:, None], sun_elevation_deg=e, progress=progress, checkpoint=checkpoint)
        return to_dataset(self, found, h, e)

    def irradiance(
        self,
        altitude: float,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        *,
        sun_elevation_deg: float | None = None,
        sun_azimuth_deg: float | None = None,
    ) -> Array:
        """Global spectral irradiance on a plane of any tilt, on the z axis; (wavelength,) [W m-2 nm-1].

        Direct sunlight by the transmittance, all other light by quadrature over the directions in front of the plane.

        Parameters
        ----------
        altitude : float
            Of the plane above the ground [m].
        normal : array_like, shape (3,)
            Unit vector out of the plane's front (east, north, up).
        sun_elevation_deg, sun_azimuth_deg : float, optional
            As for `radiance`.

        Examples
        --------
        A level plane, and a wall that faces south, where the Sun stands.

        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30, sun_azimuth_deg=180)
        >>> field = skyscatter.solve(scene, [550], sun_elevations_deg=(20, 40), tolerance=0.02)
        >>> field.irradiance(0.0).round(1), field.irradiance(0.0, normal=(0, -1, 0)).round(1)
        (array([0.8]), array([1.4]))
        """
        n = np.asarray(normal, float)
        if n.shape != (3,) or abs(np.linalg.norm(n) - 1) > 1e-6:
            raise DomainError("normal", normal, "a unit vector of three numbers")
        sun = self.sun(sun_elevation_deg, sun_azimuth_deg)
        directions, weights = sphere_rule(sun.azimuth_deg)
        weights = weights * np.maximum(directions @ n, 0.0)
        seen = weights > 0
        origin = np.array([0.0, 0.0, self.scene.medium.radius + altitude])
        answer = self.radiance(
            origin, directions[seen], sun_elevation_deg=sun.elevation_deg, sun_azimuth_deg=sun.azimuth_deg, parts=True
        )
        diffuse = np.asarray(weights[seen] @ (answer.radiance - answer.layers["direct"]))
        beam = direct_beam(
            self.at(sun).columns, self.fine.problem, np.array(altitude), np.radians(90 - sun.elevation_deg)
        )
        # Not delta-M's beam, which takes the light of the forward peaks along: the diffuse radiance has that.
        return diffuse + beam.true * max(float(sun.direction @ n), 0.0)

    def export(
        self,
        engine: str,
        folder: str | os.PathLike[str],
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> dict[str, Any]:
        """Write the sky as a real-time engine loads it: from every altitude in the air, under every Sun.

        ``"three"`` is @takram/three-atmosphere for three.js: ``transmittance.exr``, ``scattering.exr``,
        ``single_mie_scattering.exr``, ``higher_order_scattering.exr``, ``irradiance.exr`` and the parameters of that
        package, ``atmosphere.json``.  That takes a minute or two.  See docs/howto-engines.md.

        Parameters
        ----------
        engine : {"three"}
        folder : path-like
            Made where it is not there yet; files of those names are replaced.
        threads : int, optional
            All processors when not given.
        progress : callable, optional
            Called with the finished share, 0 to 1.

        Returns
        -------
        dict
            What ``atmosphere.json`` holds: under ``atmosphere`` radii [m], the Sun's angular radius [rad], factors of
            light; under ``deviations`` relative deviations of the sky in the textures from the field, by altitude [m]
            and elevation of the Sun [degree].

        Raises
        ------
        DomainError
            For another engine, and for a field without all Suns or without the wavelengths of colours.

        Examples
        --------
        >>> import skyscatter
        >>> scene = skyscatter.load_model("mars").scene()
        >>> field = skyscatter.solve(scene, [450, 550, 650], tolerance=0.05)  # doctest: +SKIP
        >>> made = field.export("three", "mars")  # doctest: +SKIP
        """
        if engine != "three":
            raise DomainError("engine", engine, "choose three")
        from skyscatter.solvers.engines.three import export_three

        return export_three(self, folder, worker_count(threads), progress)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field to an .npz file, whole or not at all.

        Parameters
        ----------
        path : path-like
            Name of the file; one of that name is replaced.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene()
        >>> field = skyscatter.solve(scene, [550], sun_elevations_deg=(20, 40), tolerance=0.02)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     field.save(pathlib.Path(folder) / "sky.npz")
        ...     again = skyscatter.RadianceField.load(pathlib.Path(folder) / "sky.npz")
        >>> bool(abs(again.fluxes(0.0).net / field.fluxes(0.0).net - 1) < 1e-12)
        True
        """
        content = {
            "version": FILE_VERSION, "scene": self.scene.model_dump_json(), "zenith": self.zenith,
            "wavelengths": self.wavelengths, "tolerance": self.tolerance, "stokes": self.stokes,
            "max_order": 0 if self.max_order is None else self.max_order,
        }  # fmt: skip
        for name in ("fine", "coarse"):
            solution = getattr(self, name)
            sums, degree = solution.sums, solution.problem.degree
            content |= {f"{name}_moments": sums.moments, f"{name}_flux": sums.flux, f"{name}_orders": sums.orders}
            content[f"{name}_degree"] = degree
        arrays: dict[str, Any] = {name: np.asarray(value) for name, value in content.items()}
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> RadianceField:
        """Read a field that `save` wrote.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        RadianceField

        Raises
        ------
        MissingDataError
            If there is no such file.
        SkyscatterError
            If it holds no field, or one of another version.
        """
        if not Path(path).is_file():
            raise MissingDataError(path, "no such file; check the path")
        wrong = f"{path}: not a radiance field of this version; solve again"
        try:
            with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                content = {name: file[name] for name in file.files}
            if int(content["version"]) != FILE_VERSION:
                raise SkyscatterError(wrong)
            scene = Scene.model_validate_json(str(content["scene"]))
            wl, zenith = content["wavelengths"], (float(content["zenith"][0]), float(content["zenith"][1]))
            tolerance, stokes = float(content["tolerance"]), bool(content["stokes"])
            max_order = int(content["max_order"]) or None
            solutions = []
            for name, factor in (("fine", 1.0), ("coarse", COARSER)):
                degree, air = int(content[f"{name}_degree"]), (scene, wl, zenith, factor * tolerance, stokes)
                problem = make_problem(*air, degree=degree, cut_peaks=max_order != 1)
                sums = Sums(content[f"{name}_moments"], content[f"{name}_flux"], int(content[f"{name}_orders"]))
                grid = problem.grid
                if sums.moments.shape[:3] != (grid.altitudes.size, grid.sun_zenith.size, problem.moments.degree.size):
                    raise SkyscatterError(wrong)
                solutions.append(Solution(problem, sums))
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise SkyscatterError(wrong) from error
        return cls(scene, wl, zenith, tolerance, stokes, solutions[0], solutions[1], max_order)

    def sun(self, elevation_deg: float | None, azimuth_deg: float | None) -> Sun:
        """The scene's Sun, moved."""
        given = {"elevation_deg": elevation_deg, "azimuth_deg": azimuth_deg}
        changed = {name: float(value) for name, value in given.items() if value is not None}
        if not changed:
            return self.scene.sun
        # A Sun that was moved is that of no known place and time.
        return Sun(**(self.scene.sun.model_dump(exclude={"site"}) | changed))

    def check_coverage(self, origins: Array, directions: Array, sun: Sun) -> None:
        """Refuse rays on which the Sun stands where the field was not solved."""
        check_coverage(self.scene, self.zenith, origins, directions, sun)

    def sky_table(self, table: SceneTable, origins: Array, directions: Array, threads: int) -> SkyTable | None:
        """What joins many rays from one place, with the Sun where `table` has it; None where each is solved itself."""
        if len(origins) == 0 or np.any(origins != origins[0]):
            return None
        return make_table(self.fine, self.coarse, table, origins[0], directions, self.tolerance, threads)

    def look(
        self, table: SceneTable, origins: Array, directions: Array, parts: bool, sky: SkyTable | None = None
    ) -> Answer:
        """`radiance` of a few rays, in one thread and without checks; with a table only some of them are solved."""
        if sky is None:
            return self._solved(table, origins, directions, parts)
        found = sky.look(directions, parts)
        diffuse = found.diffuse
        error = np.abs(np.multiply(found.error, diffuse, out=found.error), out=found.error)
        error += self._alike(table, origins, directions, diffuse)
        radiance = diffuse if found.beyond is None else diffuse + found.beyond
        layers = {} if found.polarised is None else _polarised_layers(found.polarised, error)
        if parts:
            direct = np.zeros_like(diffuse) if found.beyond is None else found.beyond
            layers |= {"direct": direct, "scattered": found.scattered, "ground": found.ground}
            layers["multiple"] = found.multiple
        alone = np.flatnonzero(sky.alone(directions))
        if alone.size:
            own = self._solved(table, origins[alone], np.ascontiguousarray(directions[alone]), parts)
            radiance[alone], error[alone] = own.radiance, own.standard_error
            for name, values in layers.items():
                values[alone] = own.layers[name]
        return Answer(radiance, error, layers, np.zeros(len(radiance), np.int64))

    def diffuse(
        self, table: SceneTable, origins: Array, directions: Array, share: Array, sky: SkyTable | None = None
    ) -> tuple[Array, Array]:
        """Diffuse light along rays and its error, (ray, wavelength) each; every ray for itself, whatever the others.

        `share` (wavelength,) is the relative error of those that a table leaves to be solved.
        """
        if sky is None:
            light, error = np.empty((2, len(origins), self.wavelengths.size))
            alone = np.arange(len(origins))
        else:
            found = sky.look(directions, False)
            light, alone = found.diffuse, np.flatnonzero(sky.alone(directions))
            error = np.abs(found.error * light)
        for k in alone:
            light[k] = self._diffuse(self.fine, table, origins[k : k + 1], directions[k : k + 1])[0]
            error[k] = share * np.abs(light[k])
        return light, error + self._alike(table, origins, directions, light)

    def _solved(self, table: SceneTable, origins: Array, directions: Array, parts: bool) -> Answer:
        """Every ray by itself."""
        scattered, multiple, ground, direct = view(self.fine.problem, self.fine.loaded, table, origins, directions)
        # Where there is next to no light, deep in the night, the sum of its moments swings about zero.
        multiple[:, 0] = np.maximum(multiple[:, 0], 0.0)
        stokes = scattered + multiple
        radiance = stokes[:, 0] + ground + direct
        error = self._error(table, origins, directions, stokes[:, 0] + ground)
        layers = _polarised_layers(np.moveaxis(stokes[:, 1:], 1, 0), error) if self.stokes else {}
        if parts:
            layers |= {"direct": direct, "scattered": scattered[:, 0], "ground": ground, "multiple": multiple[:, 0]}
        return Answer(radiance, error, layers, np.zeros(len(radiance), np.int64))

    def _error(self, table: SceneTable, origins: Array, directions: Array, diffuse: Array) -> Array:
        """Estimated error of the diffuse radiance: the difference from the coarser solution, by bundles of rays.

        Where two solutions differ they agree somewhere in between.  So each bundle is compared in several azimuths,
        among them some in which nobody looks if it has few rays of its own.
        """
        order, group = bundles(origins, directions, table.columns.radius)
        own, extra = [], []
        for a, b in pairwise(group):
            own.append(order[np.unique(np.linspace(a, b - 1, min(COMPARED, b - a)).astype(int))])
            first = own[-1][0]
            copies = COMPARED - len(own[-1])
            extra.append(turned(origins[first], directions[first], table.columns.radius, copies))
        chosen = np.concatenate([*own, np.zeros(0, np.int64)])
        o, d = (np.concatenate([a, *parts]) for a, *parts in zip((origins, directions), *extra, strict=True))
        number = len(origins)
        rows = np.concatenate([chosen, np.arange(number, len(o))])
        fine = np.concatenate([diffuse[chosen], self._diffuse(self.fine, table, o[number:], d[number:])])
        coarse = self._diffuse(self.coarse, table, o[rows], d[rows])
        of_own, of_extra = (np.cumsum([0] + [len(x) for x in lot]) for lot in (own, [e[0] for e in extra]))
        error, told = np.empty_like(diffuse), stated_share(self.fine.problem, self.coarse.problem)
        for k, rays in enumerate(own):
            mine = np.arange(of_own[k], of_own[k + 1])
            all_of_it = np.concatenate([mine, len(chosen) + np.arange(of_extra[k], of_extra[k + 1])])
            share = relative_error(fine[all_of_it], coarse[all_of_it], self.tolerance, mine.size, told)
            members = order[group[k] : group[k + 1]]
            error[members] = share * np.abs(diffuse[members])
            error[rays] = np.maximum(error[rays], told * np.abs(coarse[mine] - fine[mine]))
        return np.asarray(error + self._alike(table, origins, directions, diffuse))

    def _alike(self, table: SceneTable, origins: Array, directions: Array, diffuse: Array) -> Array:
        """Error that both solutions have alike: of level sunlight in cut peaks, and of the night that neither sees."""
        error = np.where(diffuse == 0.0, 0.0, self.fine.unseen)
        if not self.fine.problem.level_peaks.any():
            return error
        low, high = seen_zenith(origins, directions, table.optics.disk_axis, table.columns.radius, table.columns.top)
        level = level_error(np.nan_to_num(0.5 * (low + high)), self.fine.problem.level_peaks)
        return np.asarray(level * np.abs(diffuse) + error)

    def _diffuse(self, solution: Solution, table: SceneTable, origins: Array, directions: Array) -> Array:
        """Radiance of all orders but the direct light; (ray, wavelength)."""
        return diffuse_light(*view(solution.problem, solution.loaded, table, origins, directions))[:, 0]


def _polarised_layers(light: Array, error: Array) -> dict[str, Array]:
    """Layers of Q, U and, where there is any, V (channel, ray, wavelength); their error is that of the radiance."""
    layers = dict(zip("QUV", light, strict=False))
    layers.setdefault("V", np.zeros_like(error))
    return layers | {f"{name}_error": error for name in "QUV"}
