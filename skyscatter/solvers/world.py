"""Solver ``path`` for skies that hold more than shells of air: bodies, clouds, lamps, and grounds of any material.

A `Scene` becomes a `SurfaceScene`: the planet a sphere of its ground's material, shells fields around it, the star a
parallel lamp with its disk; then walks go as among surfaces.  The frame is that of the ground below the observer: x
east, y north, z up, the planet's centre at (0, 0, -R).  Where there is nothing but shells over Lambertian ground the
walks of `skyscatter.solvers.path` serve, which are made for that and much faster.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from skyscatter.columns import transmittance
from skyscatter.errors import DomainError
from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP
from skyscatter.kernels.surfaces.gathering import WalkTable
from skyscatter.media.planets import AroundPlanet
from skyscatter.scene import Scene
from skyscatter.solvers import surface_path
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Walks
from skyscatter.solvers.emptysky import KnownSky, is_knowable, known_sky
from skyscatter.solvers.options import Path
from skyscatter.spectra.table import SpectralTable, evaluate
from skyscatter.surfaces.grounds import Sea
from skyscatter.surfaces.lamps import ParallelLamp, Surroundings
from skyscatter.surfaces.materials import AnyMaterial, Lambert, Mosaic
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Sphere

__all__ = ["as_surfaces", "check", "no_walks", "prepare", "solve"]

#: Throughput below which roulette begins: of what a dark ground reflects much of a sky's light is made.  Of 0.3, 0.1,
#: 0.03, 0.01 these had the least noise at equal time over clear and hazy skies together.
ROULETTE_LEVEL = 0.1
#: Mean cosine of the air, and transmittance from the ground to the Sun, beyond which stated errors are too small: on
#: Mars (0.78) with the Sun at 4 degrees 86 % of runs of 1024 walks lie within two of them, on Titan (0.68) 82 %, but on
#: the hazy Earth (0.55) 95 %, and on Mars with the Sun at 25 degrees 92 %.
FORWARD, DIM_SUN = 0.6, 0.05
#: Elevation of the Sun [degree] below which walks find its light too rarely for their error bars.
TWILIGHT = 0.0


def as_surfaces(scene: Scene, wavelengths: Array) -> SurfaceScene:
    """A sky as a scene of surfaces, in metres from the ground below the observer.

    Parameters
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm], at which its light is told.

    Raises
    ------
    DomainError
        For what such a scene cannot have beside its bodies: towns, lights of a place, an eclipse.
    """
    check_scene(scene)
    radius = scene.medium.radius
    centre = (0.0, 0.0, -radius)
    shells = (
        component.model_copy(
            update={"density": AroundPlanet(position=centre, radius=radius, profile=component.density)}
        )
        for component in scene.medium.components
    )
    air = SurfaceMedium(name="air", components=(*shells, *scene.fields))
    ground = Body(name="ground", shape=Sphere(position=centre, radius=radius), material=_ground(scene))
    return SurfaceScene(
        media=(air, *scene.media),
        bodies=(ground, *scene.bodies),
        lamps=(*_sky_lamps(scene, wavelengths), *scene.lamps),
        viewpoint=Viewpoint(position=(0.0, 0.0, scene.altitude), target=(0.0, 1.0, scene.altitude)),
    )


def _ground(scene: Scene) -> AnyMaterial:
    """What the ground does to light; of a map each cell is Lambertian, on the observer's side of the planet."""
    ground, picture = scene.ground, scene.ground.map
    if ground.material is not None:
        return ground.material
    rest = Lambert(albedo=ground.albedo)
    if picture is None:
        return rest
    cells = tuple(Lambert(albedo=albedo) for albedo in picture.albedos)
    return Mosaic(
        classes=picture.classes, materials=cells, rest=rest, cell_size=picture.cell_size, lowest=-scene.medium.radius
    )


def _sky_lamps(scene: Scene, wl: Array) -> list[ParallelLamp | Surroundings]:
    """The star, and light from all around where there is some."""

    def table(values: Array) -> SpectralTable | float:
        if wl.size == 1:
            return float(values[0])
        return SpectralTable(wavelengths=tuple(wl), values=tuple(float(v) for v in values))

    distance, star = scene.star_distance, scene.star
    sun = ParallelLamp(
        name="star",
        direction=tuple(float(v) for v in scene.sun.direction),
        irradiance=table(star.irradiance(wl, distance)),
        angular_radius_deg=float(np.degrees(np.arcsin(star.radius / distance))),
        limb_darkening=star.limb_darkening and star.radius > 0,
    )
    background = evaluate(scene.background, wl)
    lamps: list[ParallelLamp | Surroundings] = [] if is_night(scene) else [sun]
    return [*lamps, Surroundings(name="background", radiance=table(background))] if np.any(background > 0) else lamps


def is_night(scene: Scene) -> bool:
    """Whether no air that the observer may see is sunlit: the star then is left out.

    Air is seen as far as a line of sight that grazes the planet runs through it, and is lit as far as a ray that does.
    """
    radius, observer = scene.medium.radius, scene.observer
    seen, lit = (np.arccos(radius / (radius + h)) for h in (observer.altitude, observer.atmosphere_top))
    return bool(-np.radians(scene.sun.elevation_deg) > seen + 2 * lit + scene.star.radius / scene.star_distance)


def check_scene(scene: Scene) -> None:
    """Refuse what walks among surfaces do not know of a sky."""
    held = scene.world
    shine = [] if scene.lights is None else [name for name in scene.lights.shine if name != "sun"]
    towns = [town.name for town in scene.towns or ()]
    for name, given in {"lights": ", ".join(shine), "towns": ", ".join(towns)}.items():
        if given:
            raise DomainError(name, given, f"cannot shine yet in a scene with {held}; leave one of them out")
    if scene.sun.site is not None:
        from skyscatter.solvers.eclipse import eclipse_of

        if eclipse_of(scene) is not None:
            raise DomainError(
                "time", scene.sun.site.time, f"is in an eclipse, which scenes with {held} cannot have yet"
            )
    if np.degrees(np.arcsin(min(scene.star.radius / scene.star_distance, 1.0))) > 5.0:
        raise DomainError("radius", scene.star.radius, f"fills more than 10 degrees of the sky of a scene with {held}")


def check(asked: Asked[Path]) -> None:
    """Refuse what contradicts itself, or means nothing here."""
    given = asked.how.given
    for name in ("sampling", "tolerance", "transmittance"):
        if given.get(name) not in (None, "march" if name == "sampling" else None):
            rule = "means nothing to walks in skies that hold bodies, fields, lamps or another ground; leave it out"
            raise DomainError(name, given[name], rule)
    surface_path.check(among_surfaces(asked))


def among_surfaces(asked: Asked[Path]) -> Asked[Path]:
    """What is asked of walks among surfaces, to whom ``sampling="march"`` means nothing."""
    return replace(asked, how=replace(asked.how, sampling=None))


class World(NamedTuple):
    """Tables of a scene, how far its frame lies above that of its rays [m], and what is known of its empty sky."""

    walks: surface_path.Context
    lift: float
    known: KnownSky | None = None


def local(rays: Rays, lift: float) -> Rays:
    """Rays from the planet's centre in the frame of the ground below the observer."""
    return Rays(rays.origins - np.array([0.0, 0.0, lift]), rays.directions, rays.numbers)


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> World:
    """The tables of a scene, with the light of its empty sky where that is worth its while."""
    surfaces, lift = as_surfaces(scene, wavelengths), scene.medium.radius
    walks = surface_path.prepare(surfaces, local(rays, lift), wavelengths, among_surfaces(asked), threads, progress)
    ground = scene.ground.material
    sea = lift if isinstance(ground.rest if isinstance(ground, Mosaic) else ground, Sea) else 0.0
    table = walks.table._replace(guide=walks.table.guide._replace(level=ROULETTE_LEVEL, sea=sea))
    if not is_night(scene) and is_knowable(scene, len(rays.origins), asked):
        # The star is the first parallel lamp; bodies that shine come before it.
        star = int(np.flatnonzero(table.lamps.kind == PARALLEL_LAMP)[0])
        known = known_sky(scene, rays, wavelengths, star, threads, progress, asked.stokes)
        if known is not None:
            return World(walks._replace(table=table._replace(sky=known.table)), lift, known)
    warn_of_the_sun(scene, wavelengths, table)
    return World(walks._replace(table=table), lift)


def warn_of_the_sun(scene: Scene, wavelengths: Array, table: WalkTable) -> None:
    """A word where walks that know nothing of the sky find too little of its light for their error bars."""
    if scene.sun.elevation_deg < TWILIGHT and not is_night(scene):
        warnings.warn(
            f"sun_elevation_deg = {scene.sun.elevation_deg:g}: in twilight walks among bodies and fields rarely find "
            "the light, and their standard error is too small; raise the Sun, or take the sky without them by orders",
            stacklevel=2,
        )
    if (
        scene.sun.elevation_deg >= 0
        and surface_path.forwardness(table.media) > FORWARD
        and sun_is_dim(scene, wavelengths)
    ):
        warnings.warn(
            f"sun_elevation_deg = {scene.sun.elevation_deg:g}: through air that scatters forward walks rarely find the "
            "bright sky around so low a Sun, and the standard error of few of them is too small; raise samples",
            stacklevel=2,
        )


def sun_is_dim(scene: Scene, wavelengths: Array) -> bool:
    """Whether next to nothing comes straight from the star to the ground below the observer, but for clouds."""
    air = scene.model_copy(update={"fields": (), "bodies": (), "media": (), "lamps": ()})
    start = np.array([0.0, 0.0, scene.medium.radius])
    end = start + 4 * (scene.medium.radius + scene.medium.top) * scene.sun.direction
    return bool(np.any(transmittance(air, start, end, wavelengths) < DIM_SUN))


def no_walks(world: World, rays: int, asked: Asked[Path]) -> Walks:
    """The sums with which walks begin."""
    return surface_path.no_walks(world.walks, rays, among_surfaces(asked))


def solve(world: World, rays: Rays, asked: Asked[Path], walks: Walks | None = None) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`."""
    known, here, asked = world.known, local(rays, world.lift), among_surfaces(asked)
    if known is None:
        return surface_path.solve(world.walks, here, asked, walks, up=rays.origins)
    seen, unsure = known.along(rays)
    if asked.stokes:
        found = surface_path.solve(world.walks, here, asked, walks, up=rays.origins)
    else:
        found = surface_path.solve(world.walks, here, asked, walks, seen)
    # What a ray sees of bodies is light that was looked up between nodes.
    unsure += known.error * np.minimum(np.abs(found.radiance), np.abs(found.radiance - seen))
    layers = {name: np.hypot(value, unsure) for name, value in found.layers.items() if name.endswith("_error")}
    return replace(found, standard_error=np.hypot(found.standard_error, unsure), layers=found.layers | layers)
