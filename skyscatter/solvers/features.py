"""What a camera sees first along its rays, without chance: by it a denoiser tells edges from noise.

Four numbers a ray: how bright what is seen is by itself, its albedo, and which way it faces, a unit vector.  Of a
surface these are its reflectance and its normal.  A cloud or a nebula faces where its density falls, at an optical
depth of a half, or half its own where that is less than 1; it counts by the share of the light that it scatters or
swallows, and what stands behind it by the rest.  All at the middle one of the wavelengths.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.kernels.codes.surfaces import CONDUCTOR, DIELECTRIC
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array, Rays
from skyscatter.solvers.checks import is_space
from skyscatter.solvers.depths import box_ends
from skyscatter.solvers.far_lamps import current_medium
from skyscatter.surfaces.packing import starting_stack
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.kernels.space import SpaceTable
    from skyscatter.kernels.surfaces.tables import MaterialTable, SurfaceTable

#: Halvings by which a depth is found: to a four thousandth of the way through the medium.
HALVINGS = 12
#: Optical depth at which a medium is looked at, and share of its own where that is less than 1.
DEPTH = 0.5
#: Share of what is seen below which a medium counts as nothing.
FAINT = 0.005
#: Free paths over which a density's fall is taken, but no more than this share of the way through the medium; and how
#: much its direction counts.  Light is blurred in a medium: with more, a network drew folds where there is noise.
FALL, MOST, SOFT = 1.5, 0.125, 0.3
#: Rays that are looked along at a time.
PART = 32768
#: Bodies without a surface of their own that a ray goes through at most.
THROUGH = 8


class Fields(NamedTuple):
    """Densities in three dimensions, and what they do to light at one wavelength."""

    space: SpaceTable
    extinction: Array  #: (component,) per unit density [m-1]
    scattering: Array  #: (component,)


class Sight(NamedTuple):
    """What there is to be seen."""

    surfaces: SurfaceTable | None
    fog: float  #: extinction [m-1] of a medium that is the same everywhere, in which the rays begin
    fields: Fields | None  #: those in the medium in which the rays begin
    lift: float  #: how far the frame lies above that of the rays [m]


def first_sight(scene: Any, rays: Rays, wavelengths: Array, threads: int = 1) -> NDArray[np.float32] | None:
    """Albedo and the way that faces, shape (ray, 4), of what rays see first; None in a sky of nothing but shells.

    Parameters
    ----------
    scene : Scene, SpaceScene or SurfaceScene
    rays : Rays
        All from one place.
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    threads : int

    Examples
    --------
    >>> import numpy as np
    >>> from skyscatter.solvers.base import Rays
    >>> from skyscatter.solvers.features import first_sight
    >>> from skyscatter.surfaces import Body, Lambert, Sphere, SurfaceScene, Viewpoint
    >>> ball = Body(name="ball", shape=Sphere(position=(0, 5, 0), radius=1), material=Lambert(albedo=0.5))
    >>> scene = SurfaceScene(bodies=(ball,), viewpoint=Viewpoint(position=(0, 0, 0), target=(0, 1, 0)))
    >>> ahead = Rays(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]), np.zeros(1, np.int64))
    >>> first_sight(scene, ahead, np.array([550.0])).tolist()
    [[0.5, 0.0, -1.0, 0.0]]
    """
    if isinstance(scene, Scene) and not scene.world:
        return None
    sight = _prepared(scene, rays, wavelengths)
    parts = [rays.part(slice(k, k + PART)) for k in range(0, len(rays.origins), PART)]
    with Workers(max(threads, 1)) as pool:
        found = [*pool.map(partial(_seen, sight), parts)]
    return np.concatenate(found).astype(np.float32)


def picture_sight(
    scene: Any, grid: Array, wavelengths: Array, threads: int | None = None
) -> NDArray[np.float32] | None:  # fmt: skip
    """`first_sight` of a picture's pixels, (y, x, 4), whose rays are `grid` (y, x, 3); NaN where there is no ray."""
    from skyscatter.kernels.processors import processors

    inside = np.isfinite(grid[..., 0])
    directions = grid[inside]
    origins = np.broadcast_to(scene.observer.position, directions.shape)
    rays = Rays(origins, directions, np.arange(len(directions)))
    found = first_sight(scene, rays, wavelengths, threads or processors())
    if found is None:
        return None
    features = np.full((*inside.shape, found.shape[1]), np.nan, np.float32)
    features[inside] = found
    return features


def _prepared(scene: Any, rays: Rays, wavelengths: Array) -> Sight:
    """The tables of a scene, at the middle one of the wavelengths."""
    from skyscatter.solvers.surfaces import compile_surfaces

    n = wavelengths.size // 2
    if is_space(scene):
        from skyscatter.solvers.volume import compile_volume

        volume = compile_volume(scene, tuple(float(w) for w in wavelengths))
        return Sight(None, 0.0, Fields(volume.space, volume.sigma_t[:, n], volume.sigma_s[:, n]), 0.0)
    lift = 0.0
    if isinstance(scene, Scene):
        from skyscatter.solvers.worldscene import as_surfaces

        lift, wavelengths, n = scene.medium.radius, wavelengths[n : n + 1], 0
        scene = as_surfaces(scene, wavelengths)
    table = compile_surfaces(scene, wavelengths)
    media, place = table.media, rays.origins[0] - np.array([0.0, 0.0, lift])
    m = current_medium(media, starting_stack(table.shapes, place))
    numbers = np.arange(len(media.sigma_t))[:, None]
    own = (media.first[m] <= numbers) & (numbers < media.first[m + 1])
    extinction, scattering = (np.where(own, sigma, 0.0)[:, n] for sigma in (media.sigma_t, media.sigma_s))
    fields = None if media.space is None else Fields(media.space, extinction, scattering)
    return Sight(table, float(media.extinction[m, n]), fields, lift)


def _seen(sight: Sight, rays: Rays) -> Array:
    """What rays see first, (ray, 4)."""
    rays = Rays(rays.origins - np.array([0.0, 0.0, sight.lift]), rays.directions, rays.numbers)
    far, seen = np.full(len(rays.origins), np.inf), np.zeros((len(rays.origins), 4))
    if sight.surfaces is not None:
        far, seen = surfaces_ahead(sight.surfaces, rays)
        seen *= np.exp(-sight.fog * np.where(np.isfinite(far), far, 0.0))[:, None]
    if sight.fields is not None:
        add_fields(sight.fields, rays, far, seen)
    return seen


def surfaces_ahead(table: SurfaceTable, rays: Rays) -> tuple[Array, Array]:
    """How far it is to the surfaces that rays meet [m], infinite without one, and what is seen of them (ray, 4)."""
    from skyscatter.kernels.surfaces.mosaics import tiles
    from skyscatter.kernels.surfaces.rays import closest_hits

    n, shapes = len(rays.origins), table.shapes
    bodies = np.concatenate([shapes.shape_body, shapes.triangle_body])
    places, directions = np.array(rays.origins, float, order="C"), np.array(rays.directions, float, order="C")
    far, skip, seen = np.zeros(n), np.full(n, -1), np.zeros((n, 4))
    going = np.arange(n if len(bodies) else 0)
    for _ in range(THROUGH):
        items, hits, ahead = np.empty(len(going), np.int64), np.zeros((len(going), 4)), np.full(len(going), np.inf)
        closest_hits(shapes, places[going], directions[going], ahead, skip[going], items, hits)
        going, items, hits = going[items >= 0], items[items >= 0], hits[items >= 0]
        far[going] += hits[:, 0]
        places[going] += hits[:, :1] * directions[going]
        skip[going] = items
        stops = ~shapes.thin[bodies[items]]
        here, rows = going[stops], np.empty(int(stops.sum()), np.int64)
        tiles(table.materials, shapes.material[bodies[items[stops]]], places[here], rows)
        seen[here, 0], seen[here, 1:] = albedo(table.materials, rows), hits[stops, 1:]
        going = going[~stops]
        if not going.size:
            break
    seen[np.sum(seen[:, 1:] * directions, axis=1) > 0, 1:] *= -1  # a sheet is seen from either side
    return np.where(seen[:, 1:].any(axis=1), far, np.inf), seen


def albedo(materials: MaterialTable, rows: NDArray[np.int64]) -> Array:
    """How bright materials are by themselves; 1 of those that show what lies elsewhere."""
    clear = np.isin(materials.kind[rows], (CONDUCTOR, DIELECTRIC))
    return np.where(clear, 1.0, np.clip(materials.reflectance[rows, materials.reflectance.shape[1] // 2], 0.0, 1.0))


def add_fields(fields: Fields, rays: Rays, far: Array, seen: Array) -> None:
    """Put fields that lie no further than `far` (ray,) before what is `seen` (ray, 4)."""
    directions = np.asarray(rays.directions, float)
    enter, leave = (
        np.sum((p - rays.origins) * directions, axis=1) for p in box_ends(fields.space, rays.origins, rays.directions)
    )
    leave = np.minimum(leave, far)
    inside = np.flatnonzero(leave > enter)
    depth = depths_between(fields, rays, inside, enter[inside], leave[inside])
    shown = -np.expm1(-depth)
    met = shown > FAINT
    inside, shown = inside[met], shown[met]
    at = place_at(fields, rays, inside, enter[inside], leave[inside], DEPTH * np.minimum(depth[met], 1.0))
    points = rays.origins[inside] + at[:, None] * directions[inside]
    here = densities(fields, points)
    extinction = np.maximum(here @ fields.extinction, 1e-300)
    step = np.minimum(FALL / extinction, MOST * (leave - enter)[inside])
    fall = np.stack(
        [
            (densities(fields, points - step[:, None] * axis) - densities(fields, points + step[:, None] * axis))
            @ fields.extinction
            for axis in np.eye(3)
        ],
        axis=1,
    )
    seen[inside] *= 1.0 - shown[:, None]
    seen[inside, 0] += shown * np.clip(here @ fields.scattering / extinction, 0.0, 1.0)
    seen[inside, 1:] += SOFT * shown[:, None] * fall / np.maximum(np.linalg.norm(fall, axis=1), 1e-300)[:, None]


def densities(fields: Fields, points: Array) -> Array:
    """Densities of the components at points (n, 3), shape (n, component)."""
    from skyscatter.kernels.space import fill_densities, make_space_work

    out = np.zeros((len(points), len(fields.extinction)))
    fill_densities(fields.space, np.ascontiguousarray(points), make_space_work(), out)
    return out


def depths_between(fields: Fields, rays: Rays, some: NDArray[np.int64], start: Array, end: Array) -> Array:
    """Optical depths along some of the rays between two distances [m]."""
    from skyscatter.kernels.space import fill_columns, make_space_work

    out = np.zeros((len(some), len(fields.extinction)))
    ends = (np.ascontiguousarray(rays.origins[some] + t[:, None] * rays.directions[some]) for t in (start, end))
    fill_columns(fields.space, *ends, make_space_work(), out)
    return np.asarray(out @ fields.extinction)


def place_at(
    fields: Fields, rays: Rays, some: NDArray[np.int64], start: Array, end: Array, wanted: Array
) -> Array:  # fmt: skip
    """Distances [m] at which some of the rays have come as deep as is wanted."""
    low, high, depth = start.copy(), end.copy(), np.zeros(len(some))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        more = depth + depths_between(fields, rays, some, low, middle)
        before = more < wanted
        low, high, depth = np.where(before, middle, low), np.where(before, high, middle), np.where(before, more, depth)
    return 0.5 * (low + high)
