"""From scenes of surfaces, or of nebulae, and wavelengths to the tables that the kernels of surfaces read."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.shells import LINEAR
from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, POINT_LAMP, STACK, SURFACE_LAMP, SURROUNDINGS
from skyscatter.kernels.eclipse import NO_ECLIPSE
from skyscatter.kernels.lookup import ColumnTable, build_column_table
from skyscatter.kernels.surfaces.tables import LampTable, MediaTable, ShapeTable, SurfaceTable
from skyscatter.media.fields import FieldRow
from skyscatter.media.medium import Medium
from skyscatter.media.planets import AroundPlanet
from skyscatter.media.tables import pack_rows
from skyscatter.solvers.compile import DISK_RINGS, PHASE_CELLS, matrix_tables, medium_optics
from skyscatter.solvers.environment import cell_cdf, environment, sphere_mean
from skyscatter.space import SpaceScene
from skyscatter.surfaces.indices import refractive_index
from skyscatter.surfaces.lobes import IsotropicLobe, LobeTable, lobe_table
from skyscatter.surfaces.packing import (
    body_items,
    bounding_sphere,
    item_areas,
    pack_materials,
    pack_shapes,
    starting_stack,
    unfolded,
)
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.workers import in_parts

if TYPE_CHECKING:
    from skyscatter.media.medium import Component
    from skyscatter.surfaces.meshes import AnyShape

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Points of a lamp's surface around which the media are looked at.
LAMP_POINTS = 16


def compile_surfaces(scene: SurfaceScene | SpaceScene, wavelengths: ArrayLike) -> SurfaceTable:
    """Tables of a scene at wavelengths [nm]; kept between calls.

    A `SpaceScene` becomes one medium without surfaces: its stars are point lamps, its parallel lights and its
    background light from outside.

    Raises
    ------
    DomainError
        For lamps of no extent, lamps across a boundary of media, and optics that the scene gives no meaning.
    """
    return _compiled(scene, tuple(float(w) for w in np.atleast_1d(np.asarray(wavelengths, float))))


@lru_cache(maxsize=8)
def _compiled(scene: SurfaceScene | SpaceScene, wavelengths: tuple[float, ...]) -> SurfaceTable:
    wl, bodies, records = np.array(wavelengths), _bodies(scene), scene_media(scene)
    if isinstance(scene, SpaceScene):
        lamps, viewpoint = space_lamps(scene, wl), None
    else:
        lamps, viewpoint = free_lamps(scene, wl), np.array(scene.viewpoint.position)
    media, names = compile_media(records, wavelengths), [medium.name for medium in records]
    inside = [-1 if body.inside is None else names.index(body.inside) for body in bodies]
    kinds = tuple(dict.fromkeys(body.material for body in bodies))
    materials, first = unfolded(kinds)
    rows = [first[kinds.index(body.material)] for body in bodies]
    shining = [k for k, body in enumerate(bodies) if body.lamp is not None]
    lamp = [shining.index(k) if k in shining else -1 for k in range(len(bodies))]
    parts = list(zip((body.shape for body in bodies), rows, inside, lamp, strict=True))
    shapes = pack_shapes(parts, materials)
    lamps = [surface_lamp(shapes, k, bodies[k], wl) for k in shining] + lamps
    centre, radius = everything(tuple(body.shape for body in bodies), media, lamps, viewpoint)
    table = pack_lamps(shapes, media, lamps, centre, radius)
    return SurfaceTable(shapes, pack_materials(materials, wl), media, table)


def _bodies(scene: SurfaceScene | SpaceScene) -> tuple[Body, ...]:
    return () if isinstance(scene, SpaceScene) else scene.bodies


# --- media --------------------------------------------------------------------------------------------------------


def compile_media(media: tuple[SurfaceMedium, ...], wavelengths: tuple[float, ...]) -> MediaTable:
    """Media at wavelengths [nm]."""
    from skyscatter.media.everywhere import Everywhere
    from skyscatter.media.spacetables import medium_table

    wl = np.array(wavelengths)
    components = own_components(media)
    first = np.cumsum([0, *(len(medium.components) for medium in media)])
    sigma_s, sigma_t, emission, phase, cdf = _optics(components, wavelengths)
    endless = np.array([isinstance(component.density, Everywhere) for component in components], bool)
    density = endless.astype(float)
    air, planet = shells_of(components)
    in_shells = np.array([shell is not None for shell in air], bool)
    others = tuple(
        Everywhere() if shell is not None else component.density
        for component, shell in zip(components, air, strict=True)
    )
    owners = [slice(a, b) for a, b in pairwise(first)]
    constant = np.array([bool(endless[own].all()) for own in owners])
    index = np.array([refractive_index(medium.index, wl) for medium in media])
    return MediaTable(
        first=first.astype(np.int64),
        priority=np.array([medium.priority for medium in media], np.int64),
        index=index,
        dispersive=np.ptp(index, axis=1) > 0,
        constant=constant,
        extinction=np.array([c * (density[own] @ sigma_t[own]) for c, own in zip(constant, owners, strict=True)]),
        scattering=np.array([c * (density[own] @ sigma_s[own]) for c, own in zip(constant, owners, strict=True)]),
        space=None if (endless | in_shells).all() else medium_table(others),
        shells=None if planet is None else shell_table(air, planet.radius),
        centre=np.zeros(3) if planet is None else np.array(planet.position, float),
        density=density,
        sigma_s=sigma_s,
        sigma_t=sigma_t,
        emission=emission,
        phase=phase,
        phase_cdf=cdf,
        rate=sigma_t.max(axis=1, initial=0.0),
    )


def shells_of(components: list[Component]) -> tuple[list[FieldRow | None], AroundPlanet | None]:
    """Which components are shells around the first planet among them, as rows of a table, and a field around it.

    Shells that are turned, stretched, or around another planet stay fields of three dimensions.
    """
    around = (component.density for component in components)
    planet = next((field for field in around if isinstance(field, AroundPlanet) and field.is_round), None)
    return [_row_around(planet, component.density) for component in components], planet


def _row_around(planet: AroundPlanet | None, density: Any) -> FieldRow | None:
    """A density as a row of a table of shells around a planet; None where it is none of those."""
    if planet is None or not isinstance(density, AroundPlanet):
        return None
    same = density == planet.model_copy(update={"profile": density.profile})
    return density.profile.row() if same else None


@lru_cache(maxsize=8)
def _shell_table(rows: tuple[FieldRow, ...], radius: float) -> ColumnTable:
    return build_column_table(pack_rows(rows, radius), in_parts=in_parts)


def shell_table(rows: list[FieldRow | None], radius: float) -> ColumnTable:
    """Columns of shells; an empty one for each component that is none."""
    top = max(row.top for row in rows if row is not None)
    nothing = FieldRow(LINEAR, (), top, (0.0, top), (0.0, 0.0), (top,))
    return _shell_table(tuple(row or nothing for row in rows), radius)


def compile_matrices(scene: SurfaceScene | SpaceScene, wavelengths: ArrayLike) -> Array:
    """Scattering matrices of the components of a scene in the order of its `MediaTable`.

    Returns
    -------
    ndarray, shape (component, 6, angle, wavelength)
        As `skyscatter.solvers.compile.matrix_tables`.
    """
    wl = tuple(float(w) for w in np.atleast_1d(np.asarray(wavelengths, float)))
    components = own_components(scene_media(scene))
    if not components:
        return np.zeros((0, 6, PHASE_CELLS + 1, len(wl)))
    return matrix_tables(Medium(components=tuple(components)), wl)


def scene_media(scene: SurfaceScene | SpaceScene) -> tuple[SurfaceMedium, ...]:
    """The media of a scene; space is one."""
    if isinstance(scene, SpaceScene):
        return (SurfaceMedium(name="space", components=scene.medium.components),)
    return scene.media


def own_components(media: tuple[SurfaceMedium, ...]) -> list[Component]:
    """Components of all media, with names that no two of them share."""
    return [
        component.model_copy(update={"name": f"{medium.name}: {component.name}"})
        for medium in media
        for component in medium.components
    ]


def _optics(components: list[Component], wavelengths: tuple[float, ...]) -> tuple[Array, Array, Array, Array, Array]:
    """`medium_optics` of components, of which there may be none."""
    if not components:
        none, angles = np.zeros((0, len(wavelengths))), np.zeros((0, PHASE_CELLS + 1, len(wavelengths)))
        return none, none.copy(), none.copy(), angles, np.zeros((0, len(wavelengths), PHASE_CELLS + 1))
    optics = medium_optics(Medium(components=tuple(components)), wavelengths)
    for k, component in enumerate(components):
        if not all(np.all(np.isfinite(values[k])) for values in optics[:3]):
            rule = "by optical depth has no meaning where the density has no end; give coefficients"
            raise DomainError("optics", component.name, rule)
    return optics


# --- lamps --------------------------------------------------------------------------------------------------------


class Lamp(NamedTuple):
    """A lamp on its way into the table."""

    name: str
    kind: int
    power: Array  #: (wavelength,)
    position: Array  #: (3,)
    axis: Array  #: (3,)
    lobe: LobeTable
    items: Integers  #: (n,)
    areas: Array  #: (n,) [m2]
    points: Array  #: (n, 3) where the media around it are looked at; none for light from outside
    towards: Array  #: (n, 3) a direction into the medium that is asked for
    skip: Integers  #: (n,) item on which the point lies, or -1
    disk: float = 0.0  #: sine of the angular radius of parallel light
    limb: Array | None = None  #: (ring, wavelength) radiance of its disk over the mean
    around: Array | None = None  #: (row, column, wavelength) radiance over directions, see `LampTable.around`


#: No round numbers: a ray along edges and faces is met more often than chance would have it.
_ASKEW = np.array([0.2717, 0.1911, 0.3815])
_NO_ITEMS, _NO_POINTS, _UP = np.zeros(0, np.int64), np.zeros((0, 3)), np.array([0.0, 0.0, 1.0])
_WHOLE = IsotropicLobe().table()
#: Stand-in for the lobes of light from outside, which have none.
_NO_LOBE = lobe_table([-1.0, 1.0], [1.0, 1.0])
#: Where light from outside comes in, as long as no more is known.
_FROM_OUTSIDE = (_NO_LOBE, _NO_ITEMS, np.zeros(0), _NO_POINTS, _NO_POINTS, _NO_ITEMS)


def point_lamp(name: str, power: Array, position: ArrayLike, axis: Array, lobe: LobeTable) -> Lamp:
    """A lamp without extent."""
    place = np.asarray(position, float)
    beside = (place[None], _ASKEW[None], np.array([-1]))
    return Lamp(name, POINT_LAMP, power, place, axis, lobe, _NO_ITEMS, np.zeros(0), *beside)


def parallel_lamp(name: str, irradiance: Array, towards: Array, disk: float = 0.0, limb: Array | None = None) -> Lamp:
    """Light from one direction, or from a disk around it."""
    return Lamp(name, PARALLEL_LAMP, irradiance, towards, -towards, *_FROM_OUTSIDE, disk, limb)


def surroundings(name: str, radiance: Array, around: Array | None = None) -> Lamp:
    """Light from all around; by a map its `radiance` is the mean."""
    return Lamp(name, SURROUNDINGS, radiance, np.zeros(3), _UP, *_FROM_OUTSIDE, around=around)


def surface_lamp(shapes: ShapeTable, number: int, body: Body, wl: Array) -> Lamp:
    """A body that shines."""
    name, lamp = body.name, body.lamp
    assert lamp is not None
    items = body_items(shapes, number)
    areas = item_areas(shapes)[items]
    items, areas = items[areas > 0], areas[areas > 0]
    area = float(areas.sum())
    if not area > 0:
        raise DomainError("lamp", name, "its surface has no area; give it some, or use a point lamp")
    power, lobe = lamp.spectral_power(wl, area), lamp.lobe.table()
    points, normals, chosen = points_on(shapes, items, areas)
    return Lamp(name, SURFACE_LAMP, power, points.mean(axis=0), _UP, lobe, items, areas, points, normals, chosen)


def points_on(shapes: ShapeTable, items: Integers, areas: Array) -> tuple[Array, Array, Integers]:
    """Points (n, 3) spread over the items of a lamp by their areas, the normals there, and the items."""
    from skyscatter.kernels.surfaces.rays import sample_items

    # Points of Hammersley's set: even over the surface, whatever the number.
    even = (np.arange(LAMP_POINTS) + 0.5) / LAMP_POINTS
    chosen = items[np.searchsorted(np.cumsum(areas) / areas.sum(), even).clip(max=len(items) - 1)]
    out = np.zeros((LAMP_POINTS, 6))
    sample_items(shapes, chosen, even, np.array([_reversed(k) for k in range(LAMP_POINTS)]), out)
    return out[:, :3], out[:, 3:], chosen


def _reversed(k: int) -> float:
    """The number of four binary digits as a fraction with its digits in reverse."""
    return int(f"{k:04b}"[::-1], 2) / 16 + 1 / 32


def free_lamps(scene: SurfaceScene, wl: Array) -> list[Lamp]:
    """The lamps of a scene that are no bodies."""
    lamps = []
    for lamp in scene.lamps:
        if lamp.kind == "environment":
            around = environment(lamp, tuple(wl))
            lamps.append(surroundings(lamp.name, sphere_mean(around), around))
            continue
        amount = lamp.spectral_amount(wl)
        if lamp.kind == "parallel":
            disk = float(np.sin(np.radians(lamp.angular_radius_deg)))
            limb = lamp.limb(np.sqrt(1 - np.linspace(0.0, 1.0, DISK_RINGS)), wl) if disk > 0 else None
            lamps.append(parallel_lamp(lamp.name, amount, lamp.towards, disk, limb))
        elif lamp.kind == "surroundings":
            lamps.append(surroundings(lamp.name, amount))
        else:
            lobe = lamp.distribution.table()
            lamps.append(point_lamp(lamp.name, amount, np.array(lamp.position), lamp.direction, lobe))
    return lamps


def space_lamps(scene: SpaceScene, wl: Array) -> list[Lamp]:
    """Lights of a nebula."""
    lamps = [
        point_lamp(star.name, star.spectral_luminosity(wl, scene.view.distance), star.position, _UP, _WHOLE)
        for star in scene.stars
    ]
    lamps += [parallel_lamp(light.name, light.spectral_irradiance(wl), light.towards) for light in scene.parallel]
    background = scene.background_radiance(wl)
    if np.any(background > 0):
        lamps.append(surroundings("background", background))
    return lamps


def everything(
    shapes: tuple[AnyShape, ...], media: MediaTable, lamps: list[Lamp], viewpoint: Array | None
) -> tuple[Array, float]:
    """Centre (3,) and radius [m] of a sphere around all that is finite: shapes, fields, lamps, and who looks on."""
    middle, reach = bounding_sphere(shapes)
    points = [lamp.points for lamp in lamps if len(lamp.points)]
    if media.space is not None:
        points.append(np.array([media.space.low, media.space.high]))
    if media.shells is not None:
        edge = media.shells.radius + media.shells.top
        points.append(media.centre + np.concatenate([np.eye(3), -np.eye(3)]) * edge)
    if viewpoint is not None:
        points.append(viewpoint[None])
    if reach > 0:
        points.append(middle + reach * np.array([[-1.0], [1.0]]))
    if not points:
        return np.zeros(3), 1.0
    cloud = np.concatenate(points)
    centre = 0.5 * (cloud.min(axis=0) + cloud.max(axis=0))
    # Of the shapes' own sphere nothing sticks out that is nearer than its far side; its box would be larger.
    cloud = np.concatenate(points[: len(points) - (reach > 0)] or [middle[None]])
    radius = max(float(np.linalg.norm(cloud - centre, axis=1).max()), float(np.linalg.norm(middle - centre)) + reach)
    # A rounding error wider; where all is in one point, any size will do.
    return centre, radius * (1 + 1e-9) if radius > 0 else 1.0


def pack_lamps(shapes: ShapeTable, media: MediaTable, lamps: list[Lamp], centre: Array, radius: float) -> LampTable:
    """Lamps as a table."""
    wavelengths = media.index.shape[1]
    endless = bool(media.constant[0] and np.any(media.extinction[0] > 0))
    for lamp in lamps:
        if endless and lamp.kind in (PARALLEL_LAMP, SURROUNDINGS):
            rule = "comes from outside, where the first medium has no end and lets no light through; bound that medium"
            raise DomainError("lamps", lamp.name, rule)
    power = np.array([lamp.power for lamp in lamps], float).reshape(-1, wavelengths)
    through = {PARALLEL_LAMP: np.pi * radius**2, SURROUNDINGS: 4 * np.pi**2 * radius**2}
    total = power * np.array([through.get(lamp.kind, 1.0) for lamp in lamps]).reshape(-1, 1)
    share = (total / np.maximum(total.sum(axis=0), 1e-300)).mean(axis=1)
    # Half of the photons go by power, half evenly: of a night sky around a whole planet next to nothing is seen.
    share = 0.5 * share + 0.5 * (share > 0) / max(int((share > 0).sum()), 1)
    item_cdf = [np.cumsum(lamp.areas) / lamp.areas.sum() for lamp in lamps if len(lamp.areas)]
    for cdf in item_cdf:
        cdf[-1] = 1.0
    stacks = [lamp_stack(shapes, lamp, centre, radius) for lamp in lamps]
    limbs = [lamp.limb for lamp in lamps if lamp.limb is not None]
    rows = np.cumsum([lamp.limb is not None for lamp in lamps]) - 1
    mapped = next((k for k, lamp in enumerate(lamps) if lamp.around is not None), -1)
    around = None if mapped < 0 else lamps[mapped].around
    return LampTable(
        kind=np.array([lamp.kind for lamp in lamps], np.int64),
        power=power,
        position=np.array([lamp.position for lamp in lamps], float).reshape(-1, 3),
        axis=np.array([lamp.axis for lamp in lamps], float).reshape(-1, 3),
        lobe_first=_starts([len(lamp.lobe.cosine) for lamp in lamps]),
        lobe_cosine=_joined([lamp.lobe.cosine for lamp in lamps]),
        lobe_value=_joined([lamp.lobe.value for lamp in lamps]),
        lobe_cdf=_joined([lamp.lobe.cdf for lamp in lamps]),
        item_first=_starts([len(lamp.items) for lamp in lamps]),
        item=np.concatenate([_NO_ITEMS, *(lamp.items for lamp in lamps)]),
        item_cdf=_joined(item_cdf),
        area=np.array([lamp.areas.sum() for lamp in lamps], float),
        share=share / share.sum() if share.sum() > 0 else share,
        stack=np.array(stacks, np.int64).reshape(-1, STACK),
        limb_row=np.array([-1 if lamp.limb is None else row for lamp, row in zip(lamps, rows, strict=True)], np.int64),
        disk=np.array([lamp.disk for lamp in lamps], float),
        limb=np.array(limbs, float).reshape(len(limbs), DISK_RINGS, wavelengths),
        centre=centre,
        radius=radius,
        mapped=mapped,
        around=np.zeros((0, 0, wavelengths)) if around is None else around,
        around_cdf=np.zeros(0) if around is None else cell_cdf(around),
        eclipsed=-1,
        moon=NO_ECLIPSE,
    )


def lamp_stack(shapes: ShapeTable, lamp: Lamp, centre: Array, radius: float) -> Integers:
    """Media (STACK,) around a lamp.

    Raises
    ------
    DomainError
        If it lies across a boundary: photons would not know in which medium they start.
    """
    points, towards, skip = lamp.points, lamp.towards + _ASKEW, lamp.skip
    if lamp.kind in (PARALLEL_LAMP, SURROUNDINGS):
        sides = lamp.position[None] if lamp.kind == PARALLEL_LAMP else np.concatenate([np.eye(3), -np.eye(3)])
        points, towards, skip = centre + 1.001 * radius * sides, sides + _ASKEW, np.full(len(sides), -1)
    rays = zip(points, towards, skip, strict=True)
    stacks = np.array([starting_stack(shapes, point, d, int(item)) for point, d, item in rays])
    if not (stacks == stacks[0]).all():
        rule = "lies across a boundary of media; move it, or make one lamp for each side"
        if lamp.kind == SURROUNDINGS:
            rule = "come from more than one medium; bound the media, with a box in place of a plane for instance"
        raise DomainError("lamp", lamp.name, rule)
    return np.asarray(stacks[0])


def _starts(counts: list[int]) -> Integers:
    return np.cumsum([0, *counts]).astype(np.int64)


def _joined(parts: list[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts])
