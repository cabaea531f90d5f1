"""Solver ``photons``: bidirectional stochastic ray tracing, in passes.

Walks from the camera leave visibility points; photons are traced from the lamps, and what passes near the points, or
is scattered there, is gathered.  Every pass has walks, points and photons of its own, and nothing of it is kept but the
radiance of its rays.  The radius of gathering falls from pass to pass, so that bias and noise vanish together (Knaus &
Zwicker 2011, ACM Trans. Graph. 30, 25).  After Zhdanov et al. (2013, 2015); see docs/theory/photons.md.

Memory: in every thread at most `MOST_POINTS` visibility points in media and as many on surfaces, 8 (29 + components +
wavelengths) bytes each, the cells around them (`kernels.surfaces.neighbours`), and one radiance per ray; photons are
not stored.  Where the rays have more points, they are taken in bunches that meet the same photons: with others pictures
would have seams, for a photon lights many pixels.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.kernels.codes.surfaces import LAMBERT, PARALLEL_LAMP, PLANE, SURROUNDINGS
from skyscatter.kernels.surfaces.camera import MOST_LEGS, leave_points
from skyscatter.kernels.surfaces.gather import PATHS, POINTS
from skyscatter.kernels.surfaces.gathering import WalkTable
from skyscatter.kernels.surfaces.nearlight import light_points, make_near_scratch
from skyscatter.kernels.surfaces.neighbours import make_cells
from skyscatter.kernels.surfaces.photons import PhotonScratch, make_photon_scratch, trace_photons
from skyscatter.kernels.surfaces.points import Points, make_points
from skyscatter.kernels.surfaces.polarised import PhotonPolar, make_photon_polar
from skyscatter.kernels.surfaces.tables import MaterialTable, MediaTable, PeakTable, SurfaceTable
from skyscatter.memory import check_fits, photon_bytes
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.compile import phase_cosines
from skyscatter.solvers.far_lamps import warn_of_far_lamps
from skyscatter.solvers.options import USUAL_PASSES, USUAL_PHOTONS, Photons
from skyscatter.solvers.surface_path import guided

if TYPE_CHECKING:
    from collections.abc import Callable

#: This solver works in passes, see `skyscatter.solvers.passes`.
PASSES = True
DEFAULT_SAMPLES = USUAL_PASSES
#: Where ``noise`` decides, no more passes than this.
MOST_SAMPLES = 1 << 14
DEFAULT_PHOTONS = USUAL_PHOTONS
#: Tolerance of what pictures add beside the solver: single scattering averaged over the pixels around stars.
DEFAULT_TOLERANCE = 5e-3
#: Ways to gather.
ESTIMATORS = {"points": POINTS, "paths": PATHS, "both": POINTS | PATHS}
#: Points of a ray's walks on a leg through a medium: as many as make this of all rays together, within limits.
EVENTS, LEAST_EVENTS, MOST_EVENTS = 1 << 14, 2, 32
#: Walks of a ray in a pass: as many as make this of all rays together, within limits.
LOOKS, MOST_LOOKS = 1 << 13, 16
#: Points in memory at once.
MOST_POINTS = 1 << 18
#: Walks past mirrors and glass whose matrices are in memory at once, 128 bytes each for every wavelength.
MOST_CHAINS = 1 << 14
#: Share of the squared radius (cubed, where points alone are gathered) that is kept from pass to pass, see `radius_of`.
ALPHA = 2 / 3
#: First radius in parts of the extent of what is seen, and in mean free paths at most.
OF_EXTENT, OF_FREE_PATH = 0.02, 0.25
#: Where phase functions are cut [sr-1], see `kernels.surfaces.peaks`: at a few times the isotropic one.
CUT = 4 / (4 * np.pi)
#: Rays by which the extent is found, and number of them below which it may be that of the way to what they see.
SCOUTS, FEW_RAYS = 4096, 64
#: Scattered or reflected more often than this is left out when nothing else is said: roulette ends walks long before.
MOST_ORDERS = 100_000
#: Streams of photons are numbered from here, those of rays from 0.
PHOTON_STREAMS, NEAR_STREAMS = 1 << 62, 1 << 61


class Context(NamedTuple):
    """What passes need."""

    table: WalkTable
    peaks: PeakTable
    first_radius: float  #: of the first pass [m]
    matrix: Array | None  #: scattering matrices, with ``stokes``


def check(asked: Asked[Photons]) -> None:
    """Refuse what means nothing here."""
    asked.refuse("photons", "parts")


def passes(asked: Asked[Photons]) -> int:
    """Passes to make at most."""
    if asked.how.noise is not None:
        return MOST_SAMPLES
    return DEFAULT_SAMPLES if asked.how.samples is None else int(asked.how.samples)


def photons_for(asked: Asked[Photons]) -> int:
    """Photons of a pass."""
    return DEFAULT_PHOTONS if asked.how.photons is None else int(asked.how.photons)


def prepare(
    scene: Any,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Photons],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene, and the first radius."""
    from skyscatter.solvers.surfaces import compile_matrices, compile_surfaces

    n, layers = len(rays.origins), asked.orders + 3 * bool(asked.stokes)
    points = media_room(n) + floor_room(n)
    check_fits(
        photon_bytes(n, points, wavelengths.size, layers, threads), "wavelengths", wavelengths.size,
        f"{threads} threads with their photons take", "give fewer wavelengths, a smaller picture, or fewer threads",
    )  # fmt: skip
    matrix = compile_matrices(scene, wavelengths) if asked.stokes else None
    return prepare_table(compile_surfaces(scene, wavelengths), rays, asked, matrix)


def prepare_table(table: SurfaceTable, rays: Rays, asked: Asked[Photons], matrix: Array | None = None) -> Context:
    """The same from tables; `matrix` (component, 6, angle, wavelength) where light is polarised."""
    check_table(table)
    if matrix is not None:
        refuse_rough(table.materials)
    # Photons bring all of its light: no ray is aimed at a picture around the scene.
    walks = guided(table._replace(lamps=table.lamps._replace(around_cdf=np.zeros(0))))
    warn_of_far_lamps(walks, rays.origins, photons_for(asked) * passes(asked), "give more photons or samples")
    # A walk would have to take the matrix of a peak along; polarised light is gathered with the whole phase function.
    peaks = split_peaks(table.media, CUT if matrix is None else np.inf)
    context = Context(walks, peaks, asked.how.radius or 0.0, matrix)
    return context if asked.how.radius else context._replace(first_radius=scout_radius(context, rays, asked))


def check_table(table: SurfaceTable) -> None:
    """Refuse what photons cannot do.

    Raises
    ------
    DomainError
    """
    if np.any(table.media.emission):
        rule = "media that shine by themselves cannot send out photons; choose the solver path"
        raise DomainError("solver", "photons", rule)
    outside = np.isin(table.lamps.kind, (PARALLEL_LAMP, SURROUNDINGS)) & np.any(table.lamps.power > 0, axis=1)
    if outside.any() and np.any(table.shapes.kind == PLANE):
        rule = "photons from outside cannot cover an endless plane; give a large rectangle, or choose the solver path"
        raise DomainError("bodies", "plane", rule)


def refuse_rough(materials: MaterialTable) -> None:
    """Facets of glass and metal polarise light in a way that is not modelled."""
    rough = materials.roughness[materials.kind != LAMBERT]
    if np.any(rough > 0):
        rule = "is 0 where photons are polarised: smooth glass or metal, Lambertian surfaces; or take the solver path"
        raise DomainError("roughness", float(rough.max()), rule)


def split_peaks(media: MediaTable, cut: float = CUT) -> PeakTable:
    """Phase functions as a broad part and a peak; what little rises above the cut is no peak."""
    mu = phase_cosines()
    broad = np.minimum(media.phase, cut)
    peak = media.phase - broad
    cell = np.pi * (peak[:, 1:] + peak[:, :-1]) * (mu[:-1] - mu[1:])[None, :, None]
    cdf = np.concatenate([np.zeros_like(peak[:, :1]), np.cumsum(cell, axis=1)], axis=1)
    share = cdf[:, -1].copy()
    cdf = np.ascontiguousarray(np.moveaxis(cdf / np.where(share > 0, share, 1.0)[:, None], 1, 2))
    scattered = share * media.sigma_s / np.where(media.sigma_t > 0, media.sigma_t, 1.0)
    most = [scattered[a:b].max(axis=0, initial=0.0) for a, b in pairwise(media.first)]
    return PeakTable(broad, peak, cdf, share, np.array(most))


def radius_of(context: Context, number: int, asked: Asked[Photons], dimensions: int) -> float:
    """Radius of a pass [m]: R_(k+1)^n = R_k^n (k + alpha) / (k + 1), with n the `dimensions` of the sphere or disk.

    Knaus & Zwicker (2011), eq. 15 and section 4.2: the variance of the mean over N passes falls as N^-alpha, its bias
    as N^(2 (alpha - 1) / n).
    """
    if asked.how.radius is not None:
        return asked.how.radius
    k = np.arange(1, number + 1)
    return float(context.first_radius * np.prod((k + ALPHA) / (k + 1)) ** (1 / dimensions))


def scout_radius(context: Context, rays: Rays, asked: Asked[Photons]) -> float:
    """First radius from where the rays see something.

    A fixed share of the extent of the visibility points (twice the root of the sum of their variances along the axes),
    of few rays that see surfaces alone at least of their distance; at most a share of the mean free path at the points,
    averaged over them.
    """
    if not len(rays.origins):
        return 1.0
    some = np.unique(np.linspace(0, len(rays.origins) - 1, SCOUTS).astype(int))
    part = Rays(rays.origins[some].copy(), rays.directions[some].copy(), rays.numbers[some].copy())
    table = context.table
    # Of the kind that the passes have: another would be compiled apart.
    room = _Room.for_rays(table, len(part.origins), context.matrix, part.directions)
    room.look(context, part, 0, 0, asked, 0.0, 0.0, np.zeros((0, 1, 1)))
    media, floor = room.in_use
    place = np.concatenate([media.place, floor.place])
    if len(place) < 2:
        return max(table.lamps.radius, 1e-300) * OF_EXTENT
    extent = 2 * float(np.sqrt(place.var(axis=0).sum()))
    if len(part.origins) < FEW_RAYS and not len(media.place):
        # They may all see one point of a surface; then it counts how far away that is.
        distance = float(np.linalg.norm(place - part.origins.mean(axis=0), axis=1).mean())
        extent = max(extent, min(distance, table.lamps.radius))
    radius = OF_EXTENT * extent
    if len(media.place):
        # Not a matrix product: its last digits depend on the threads that the library of linear algebra takes.
        extinction = np.einsum("pc,cw->pw", media.density, table.media.sigma_t).mean(axis=1)
        radius = min(radius, OF_FREE_PATH / float(extinction.mean()))
    return max(radius, 1e-12 * float(np.abs(place).max()), 1e-300)


class _Room(NamedTuple):
    """Scratch of a pass."""

    points: Points
    surfaces: Points
    scratch: PhotonScratch
    sums: Array  #: (ray, wavelength)
    polar: PhotonPolar | None

    @classmethod
    def for_rays(
        cls, table: WalkTable, rays: int, matrix: Array | None = None, directions: Array | None = None
    ) -> _Room:
        components, wavelengths = table.media.sigma_t.shape
        capacity = media_room(rays)
        polar = None
        if matrix is not None and directions is not None:
            # The scene's z axis is up everywhere.
            frame, _ = meridian_frame(np.array([0.0, 0.0, 1.0]), directions)
            looks = looks_for(rays)
            chains = min(MOST_CHAINS, 4 * rays * looks) + looks * MOST_LEGS + 1
            polar = make_photon_polar(matrix, frame, capacity, chains)
        return cls(
            make_points(capacity, components, wavelengths),
            make_points(floor_room(rays), components, wavelengths),
            make_photon_scratch(components, wavelengths),
            np.zeros((rays, wavelengths)),
            polar,
        )

    @property
    def in_use(self) -> tuple[Points, Points]:
        """Those points that have been left."""
        both = (self.points, self.surfaces)
        media, floor = (Points._make([*(a[: p.count[0]] for a in p[:-1]), p.count]) for p in both)
        return media, floor

    def look(
        self, context: Context, rays: Rays, first: int, number: int, asked: Asked[Photons], ball: float, disk: float,
        by_order: Array,
    ) -> int:  # fmt: skip
        """Leave points from ray `first` on; the first ray for which there was no room."""
        most = MOST_ORDERS if asked.how.max_order is None else int(asked.how.max_order)
        self.points.count[0] = self.surfaces.count[0] = 0
        looks, events = looks_for(len(rays.origins)), events_for(len(rays.origins))
        following = leave_points(
            context.table, context.peaks, rays.origins, rays.directions, rays.numbers, first, np.int64(asked.how.seed),
            number, looks, events, most, ball, disk, by_rays(asked), self.points, self.surfaces, self.scratch,
            self.sums, by_order, self.polar,
        )  # fmt: skip
        if following < 0:
            raise DomainError("viewpoint", rays.origins[first].tolist(), "lies inside of too many bodies at once")
        return int(following)


def media_room(rays: int) -> int:
    """Points in media that a thread has room for."""
    events = looks_for(rays) * events_for(rays)
    return min(MOST_POINTS, rays * events * 2) + events * MOST_LEGS


def floor_room(rays: int) -> int:
    """Points on surfaces that a thread has room for."""
    return min(MOST_POINTS, rays * looks_for(rays))


def looks_for(rays: int) -> int:
    """Walks of a ray in a pass.

    Photons are dear and walks are cheap: few rays should not leave photons with few points to be gathered at.  More
    walks are worth more than more points on each, for each is scattered by peaks towards some other place.
    """
    return int(np.clip(LOOKS // max(rays, 1), 1, MOST_LOOKS))


def events_for(rays: int) -> int:
    """Points of each walk on a leg that leads straight from the camera."""
    return int(np.clip(EVENTS // max(rays, 1), LEAST_EVENTS, MOST_EVENTS)) // looks_for(rays)


def by_rays(asked: Asked[Photons]) -> bool:
    """Whether light straight from lamps is found by rays to them."""
    return True if asked.how.direct is None else asked.how.direct


def solve_pass(context: Context, rays: Rays, number: int, asked: Asked[Photons]) -> Answer:
    """Radiance along the rays from one pass alone."""
    table = context.table
    n, wavelengths = len(rays.origins), table.media.sigma_t.shape[1]
    room = _Room.for_rays(table, n, context.matrix, rays.directions)
    by_order, fates = np.zeros((asked.orders, n, wavelengths)), np.zeros((4, wavelengths))
    most = MOST_ORDERS if asked.how.max_order is None else int(asked.how.max_order)
    how = ESTIMATORS[asked.how.estimator or "both"]
    photons = photons_for(asked)
    ball = radius_of(context, number, asked, 3 if how == POINTS else 2)
    disk = radius_of(context, number, asked, 2)
    plain = rays.part(slice(None))
    near = make_near_scratch(len(table.media.density), wavelengths, len(table.lamps.kind))
    first = bunch = 0
    while first < n:
        first = room.look(context, plain, first, number, asked, ball, disk, by_order)
        media, floor = room.in_use
        trace_photons(
            table, context.peaks, room.points, room.surfaces, make_cells(media.centre, ball),
            make_cells(floor.centre, disk), how, np.int64(asked.how.seed), np.int64(PHOTON_STREAMS + number),
            0, photons, photons, most, room.scratch, room.sums, by_order,
            fates, room.polar,
        )  # fmt: skip
        if by_rays(asked):
            seed, stream = np.int64(asked.how.seed), np.int64(NEAR_STREAMS + number)
            for on_surface, points in enumerate((room.points, room.surfaces)):
                light_points(
                    table, points, bool(on_surface), seed, stream, 2 * bunch + on_surface, most,
                    near, room.sums, by_order, room.polar,
                )  # fmt: skip
        bunch += 1
    layers = {f"order{k + 1}": by_order[k] for k in range(asked.orders)}
    if room.polar is not None:
        layers |= dict(zip("QUV", room.polar.sums, strict=True))
    return Answer(room.sums, np.zeros_like(room.sums), layers, np.full(n, 1))


def photon_fates(table: SurfaceTable, photons: int, seed: int = 0) -> Array:
    """What becomes of the power of photons, shape (fate, wavelength) [W nm-1].

    Rows: escaped, absorbed by media, absorbed by surfaces, given up after too many events.  They add up to the power of
    the lamps (what reaches the sphere around the scene, of light from outside), the second one in the mean.
    """
    room = _Room.for_rays(guided(table), 1)
    none = make_cells(np.zeros((0, 3)), 1.0)
    fates = np.zeros((4, table.media.sigma_t.shape[1]))
    trace_photons(
        guided(table), split_peaks(table.media), room.points, room.surfaces, none, none,
        ESTIMATORS["both"], np.int64(seed), np.int64(PHOTON_STREAMS), 0, photons, photons, MOST_ORDERS,
        room.scratch, room.sums,
        np.zeros((0, 1, fates.shape[1])), fates, None,
    )  # fmt: skip
    return fates
