"""Solver ``path`` for scenes with surfaces: the full rendering equation in media by backward Monte Carlo.

``sampling="area"`` finds lamps that are surfaces only by aiming at points on them (the equation in its area form),
``sampling="angular"`` only by rays that meet them (its angular form); without it both are combined, which is never much
worse than the better one.  The surroundings are met in any case; a lamp without extent can only be aimed at.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.kernels.codes.surfaces import (
    CONDUCTOR,
    DIELECTRIC,
    MIRROR,
    PARALLEL_LAMP,
    POINT_LAMP,
    STACK,
    SURFACE_LAMP,
    SURROUNDINGS,
)
from skyscatter.kernels.path import BATCHES
from skyscatter.kernels.surfaces.flights import MOST_SPLITS, make_scratch
from skyscatter.kernels.surfaces.gathering import ANGULAR, AREA, BOTH, WalkTable
from skyscatter.kernels.surfaces.lamps import LampGuide
from skyscatter.kernels.surfaces.rays import sample_items
from skyscatter.kernels.surfaces.tables import MediaTable, SurfaceTable
from skyscatter.kernels.surfaces.walkpolar import make_walk_polar
from skyscatter.kernels.surfaces.walks import surface_path_rays
from skyscatter.solvers.base import Answer, Asked, Rays, Walks
from skyscatter.solvers.compile import phase_cosines
from skyscatter.solvers.far_lamps import diffusion, warn_of_far_lamps, warn_of_small_lamps
from skyscatter.solvers.options import Path
from skyscatter.solvers.path import MOST_ORDERS, walks_for

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyscatter.space import SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene

__all__ = ["Context", "check", "forwardness", "guided", "no_walks", "prepare", "solve"]

Array = NDArray[np.float64]

SAMPLINGS = {None: BOTH, "area": AREA, "angular": ANGULAR}
#: The zenith among surfaces.
UP = np.array([0.0, 0.0, 1.0])
#: Nodes of the integral of the phase function over the angle.
ANGLES = 513
#: Share of it that takes scattering as equal in all directions.
EVEN_SHARE = 0.1
#: Share of the points on legs that are drawn by where the lamp is near, points on the camera's first leg, and the
#: throughput below which roulette begins.  The answer is the same whatever they are.  Of 0, 0.6, 0.9; 1, 3; 0.1, 0.3,
#: 1 these had the least noise at equal time over rooms with fog of optical depths from 0.1 to 10 taken together.
NEAR_SHARE, FIRST_POINTS, ROULETTE_LEVEL = 0.6, 1, 0.3
#: Share of the directions around parallel light where all light is scattered straight on.  Of 0, 0.3 and 0.6 it had
#: the least noise: on Mars with the Sun at 5 degrees 0.8 of the variance of 0 in pixels, 0.7 in their mean.
SUNWARD = 0.3
#: Cosine of half the angle of a beam from which on it is narrow: walks are sent into it from beside.
NARROW = 0.966
#: Points from which the middle and the size of a lamp with a surface are found.
POINTS = 256


class Context(NamedTuple):
    """What is prepared once for all rays."""

    table: WalkTable
    matrix: Array | None = None  #: scattering matrices, with ``stokes``


def check(asked: Asked[Path]) -> None:
    """Refuse what contradicts itself."""
    asked.refuse("path with surfaces", "tolerance", "transmittance")
    if asked.how.sampling not in SAMPLINGS:
        raise DomainError("sampling", asked.how.sampling, "choose area or angular, or leave it out for both")


def prepare(
    scene: SurfaceScene | SpaceScene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene, and where its light is."""
    from skyscatter.solvers.surfaces import compile_matrices, compile_surfaces

    table = compile_surfaces(scene, tuple(float(w) for w in wavelengths))
    if asked.how.sampling == "angular" and np.any(without_extent(table)):
        rule = "finds no lamp without extent, and there is one; leave it out, or make it a body that shines"
        raise DomainError("sampling", asked.how.sampling, rule)
    if out_of_reach(table):
        warnings.warn(
            "path does not find the light of lamps without extent that comes through smooth glass or off mirrors, and "
            "that of disks by chance only; make the lamps bodies that shine, give the surfaces a roughness, or choose "
            "the solver photons",
            stacklevel=2,
        )
    walks = guided(table)
    warn_of_far_lamps(walks, rays.origins, walks_for(asked), "choose the solver photons, or give more samples")
    warn_of_small_lamps(walks, walks_for(asked))
    return Context(walks, compile_matrices(scene, wavelengths) if asked.stokes else None)


def without_extent(table: SurfaceTable) -> NDArray[np.bool_]:
    """Which lamps no ray can meet, (lamp,)."""
    lamps = table.lamps
    return np.asarray((lamps.kind == POINT_LAMP) | ((lamps.kind == PARALLEL_LAMP) & (lamps.limb_row < 0)))


def out_of_reach(table: SurfaceTable) -> bool:
    """Whether there are lamps without extent, and surfaces behind which no ray can be aimed at them."""
    materials = table.materials
    smooth = np.isin(materials.kind, (MIRROR, DIELECTRIC, CONDUCTOR)) & (materials.roughness == 0)
    return bool(smooth.any() and np.isin(table.lamps.kind, (POINT_LAMP, PARALLEL_LAMP)).any())


def no_walks(context: Context, rays: int, asked: Asked[Path]) -> Walks:
    """The sums with which walks begin; what comes straight, was scattered or turned once is told apart."""
    batches, layers = min(walks_for(asked), BATCHES), 1 if context.matrix is None else 4
    return Walks.none(rays, layers, batches, asked.orders + 3, context.table.media.index.shape[1])


def solve(
    context: Context,
    rays: Rays,
    asked: Asked[Path],
    walks: Walks | None = None,
    seen: Array | None = None,
    up: Array = UP,
) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`; `walks` that were made before are gone on with.

    `seen` (ray, wavelength) is the diffuse light of the empty sky along the rays, where the table knows that sky; `up`
    (3,) or (ray, 3) leads to the zenith, which is in the meridian plane.
    """
    table, matrix = context
    n, wavelengths = len(rays.origins), table.media.index.shape[1]
    mean, error = np.empty((n, wavelengths)), np.empty((n, wavelengths))
    used = np.empty(n, np.int64)
    count = walks_for(asked)
    walks = walks or no_walks(context, n, asked)
    orders, apart = (np.ascontiguousarray(part) for part in np.split(walks.marked, [asked.orders], axis=1))
    components, lamps, batches = len(table.media.density), len(table.lamps.kind), min(count, BATCHES)
    polar = None
    if matrix is not None:
        polar = make_walk_polar(matrix, meridian_frame(up, rays.directions)[0], MOST_SPLITS, batches)
    surface_path_rays(
        table, rays.origins, rays.directions, rays.numbers, np.zeros((n, 0)) if seen is None else seen,
        np.int64(asked.how.seed), count, walks.done,
        walks.sums, asked.how.noise or 0.0, MOST_ORDERS if asked.how.max_order is None else int(asked.how.max_order),
        SAMPLINGS[asked.how.sampling], make_scratch(components, wavelengths, lamps, batches, polar), mean, error,
        orders, apart, used,
    )  # fmt: skip
    if np.any(used < 0):
        place = tuple(float(v) for v in rays.origins[int(np.argmin(used))])
        raise DomainError("origins", place, f"lies inside more than {STACK} media; let fewer bodies overlap there")
    walks.done, walks.marked = count // walks.sums.shape[2], np.concatenate([orders, apart], axis=1)
    by_order, apart = np.split(walks.mean(slice(None), used), [asked.orders], axis=1)
    layers = {}
    if polar is not None:
        layers = {name: polar.mean[:, k] for k, name in enumerate("QUV")}
        layers |= {f"{name}_error": polar.error[:, k] for k, name in enumerate("QUV")}
    if asked.parts:
        direct, scattered, reflected = np.moveaxis(apart, 1, 0)
        multiple = mean - direct - scattered - reflected
        layers |= {"direct": direct, "scattered": scattered, "reflected": reflected, "multiple": multiple}
    layers |= {f"order{k + 1}": by_order[:, k] for k in range(asked.orders)}
    return Answer(mean, error, layers, used)


def guided(table: SurfaceTable) -> WalkTable:
    """A scene's tables with a guide to its lamps."""
    lamps, media = table.lamps, table.media
    count = len(lamps.kind)
    mapped = np.arange(count) == lamps.mapped
    middle, size, axis = lamps.position.copy(), np.zeros(count), lamps.axis.copy()
    lowest, typical = np.full(count, -1.0), np.zeros(count)
    for k in range(count):
        nodes = slice(lamps.lobe_first[k], lamps.lobe_first[k + 1])
        cosine, value = lamps.lobe_cosine[nodes], lamps.lobe_value[nodes]
        if lamps.kind[k] == PARALLEL_LAMP or mapped[k]:
            typical[k] = 1 / (4 * np.pi)
        elif lamps.kind[k] == POINT_LAMP:
            lowest[k] = _lowest_cosine(cosine, value)
        elif lamps.kind[k] == SURFACE_LAMP:
            middle[k], size[k], axis[k], flat = _extent(table, k)
            lowest[k] = 0.0 if flat else -1.0
        if lamps.kind[k] in (POINT_LAMP, SURFACE_LAMP):
            typical[k] = 1 / (2 * np.pi * (1 - lowest[k]))
    narrow = (lamps.kind == POINT_LAMP) & (lowest > NARROW)
    even = (lamps.kind == SURROUNDINGS) & ~mapped
    found = ~even & ~(mapped & (lamps.around_cdf.size == 0))
    # Of a map, as of parallel light, the fluence.
    mean = lamps.power.mean(axis=1) * np.where(mapped, 4 * np.pi, 1.0)
    scatters, shines, gathered = _media(table)
    turning, fading = diffusing(media)
    size[lamps.kind == PARALLEL_LAMP] = SUNWARD * max(forwardness(table.media), 0.0)
    guide = LampGuide(
        middle=middle,
        size=size,
        power=mean * found,
        axis=axis,
        lowest=np.where(lowest < 0, -1.0, lowest),
        typical=typical,
        slope=np.where(narrow, np.sqrt(1 - lowest**2) / np.where(narrow, lowest, 1.0), 0.0),
        beamed=bool(narrow.any()),
        open=bool(np.any(lamps.power[lamps.kind == SURROUNDINGS] > 0)),
        placed=bool(np.isin(lamps.kind, (POINT_LAMP, SURFACE_LAMP)).any()),
        background=lamps.power[even].sum(axis=0),
        blind=found / max(found.sum(), 1),
        scatters=scatters,
        shines=shines,
        extinction=media.extinction.mean(axis=1),
        drift=turning * (scatters & ~shines),
        fade=fading,
        everywhere=float(mean[(lamps.kind == PARALLEL_LAMP) | mapped].sum() + 4 * np.pi * mean[even].sum()),
        near=NEAR_SHARE,
        points=FIRST_POINTS,
        level=ROULETTE_LEVEL,
        gathered=gathered,
        halo=halo(gathered),
        sea=0.0,
    )
    return WalkTable(table.shapes, table.materials, media, lamps, guide, None)


def diffusing(media: MediaTable) -> tuple[Array, Array]:
    """Extinction that turns light, and the rate at which diffuse light falls with the distance [m-1], (medium,).

    Means over the wavelengths; 0 where a medium is not the same everywhere, or absorbs so much that the light goes
    straight before it diffuses.
    """
    turning, fading = np.zeros((2, len(media.constant)))
    for m in np.flatnonzero(media.constant):
        g, k = diffusion(media, int(m))
        if k.mean() < 1:
            turning[m], fading[m] = (media.extinction[m] * (1 - g)).mean(), (media.extinction[m] * k).mean()
    return turning, fading


def halo(gathered: Array) -> Array:
    """Share of the light once scattered around a point lamp that is seen within an angle of it, (medium, angle).

    Light of a lamp that a ray passes at the angle a from where it starts is in proportion to the integral of the
    phase function from there on over sin(a), see `kernels.surfaces.legs`.
    """
    angle = np.pi * np.linspace(0, 1, ANGLES) ** 2
    rest = gathered[:, -1:] - gathered
    steps = 0.5 * (rest[:, 1:] + rest[:, :-1]) * np.diff(angle)
    sums = np.concatenate([np.zeros((len(gathered), 1)), np.cumsum(steps, axis=1)], axis=1)
    return np.ascontiguousarray(sums / sums[:, -1:])


def _lowest_cosine(cosine: Array, value: Array) -> float:
    """Cosine below which a lobe is zero, a hair lower; -1 for lobes wider than flat."""
    lit = np.flatnonzero(value > 0)
    if lit.size == 0:
        return -1.0
    # Linear between nodes: there is light from the node before the first that shines.
    low = float(cosine[max(lit[0] - 1, 0)])
    return low - 1e-9 if low > 1e-6 else (0.0 if low >= 0 else -1.0)


def _extent(table: SurfaceTable, k: int) -> tuple[Array, float, Array, bool]:
    """Middle, radius [m], mean normal of a lamp with a surface, and whether it is flat, from points spread over it."""
    lamps = table.lamps
    own = slice(lamps.item_first[k], lamps.item_first[k + 1])
    n = np.arange(POINTS) + 0.5
    # Points of the lattice of Fibonacci, by the golden ratio: all are different, and the corners are come near to.
    u = n / POINTS
    items = lamps.item[own][np.minimum(np.searchsorted(lamps.item_cdf[own], u), own.stop - own.start - 1)]
    points = np.empty((POINTS, 6))
    first, second = n * 0.7548776662466927 % 1, n * 0.5698402909980532 % 1
    sample_items(table.shapes, np.ascontiguousarray(items), first, second, points)
    place, normal = points[:, :3], points[:, 3:]
    middle = place.mean(axis=0)
    mean = normal.mean(axis=0)
    flat = bool(np.all(normal @ normal[0] > 1 - 1e-12)) and bool(
        np.ptp(place @ normal[0]) <= 1e-9 * max(np.ptp(place, axis=0).max(), 1e-300)
    )
    axis = normal[0] if flat else mean / max(float(np.linalg.norm(mean)), 1e-300)
    return middle, float(np.linalg.norm(place - middle, axis=1).max()), axis, flat


def forwardness(media: MediaTable) -> float:
    """Mean cosine of scattering in the outermost medium, where parallel light comes from."""
    mu = phase_cosines()
    own = slice(media.first[0], media.first[1])
    weight = media.sigma_s[own].mean(axis=1)
    if media.shells is not None:
        # Of air what counts is the vertical column: the constant of its cubic in the lowest cell.
        weight = weight * media.shells.cell[0, 6::8][own]
    if not weight.sum() > 0:
        return 0.0
    cosines = -2 * np.pi * np.trapezoid(media.phase[own].mean(axis=2) * mu, mu, axis=1)
    return float(cosines @ weight / weight.sum())


def _media(table: SurfaceTable) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Which media scatter and shine, and the integral of their mean phase functions over the angle."""
    media = table.media
    count = len(media.constant)
    scatters, shines = np.zeros(count, bool), np.zeros(count, bool)
    angle = np.pi * np.linspace(0, 1, ANGLES) ** 2
    gathered = np.empty((count, ANGLES))
    nodes = np.arccos(phase_cosines())
    for m in range(count):
        own = slice(media.first[m], media.first[m + 1])
        scatters[m] = bool(np.any(media.sigma_s[own] > 0))
        shines[m] = bool(np.any(media.emission[own] > 0))
        mean = np.full(ANGLES, 1 / (4 * np.pi))
        if scatters[m]:
            weight = np.where(media.constant[m], media.density[own, None], 1.0) * media.sigma_s[own]
            phase = np.einsum("cw,caw->a", weight / weight.sum(), media.phase[own])
            mean = EVEN_SHARE * mean + (1 - EVEN_SHARE) * np.interp(angle, nodes, phase)
        steps = 0.5 * (mean[1:] + mean[:-1]) * np.diff(angle)
        gathered[m] = np.concatenate([[0.0], np.cumsum(steps)])
    return scatters, shines, gathered
