"""A sky that holds more than shells of air as a scene of surfaces.

The planet becomes a sphere of its ground's material, shells become fields around it, and the star a parallel lamp with
its disk.  The frame is that of the ground below the observer: x east, y north, z up, the planet's centre at (0, 0, -R).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.media.planets import AroundPlanet
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.spectra.table import SpectralTable, evaluate
from skyscatter.surfaces.lamps import AnyLamp, ParallelLamp, Surroundings
from skyscatter.surfaces.materials import AnyMaterial, Lambert, Mosaic
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Sphere

__all__ = ["as_surfaces", "check_scene", "spectrum", "star_shines"]


def as_surfaces(scene: Scene, wavelengths: Array, lamps: Iterable[AnyLamp] = ()) -> SurfaceScene:
    """A sky as a scene of surfaces, in metres from the ground below the observer.

    Parameters
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm], at which its light is told.
    lamps : iterable of lamp
        What shines beside its star, its background and its own lamps.

    Raises
    ------
    DomainError
        For what such a scene cannot have beside its bodies: an eclipse, a star that fills the sky.
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
        lamps=(*_sky_lamps(scene, wavelengths), *lamps, *scene.lamps),
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
    background = evaluate(scene.background, wl)
    around = [Surroundings(name="background", radiance=spectrum(background, wl))] if np.any(background > 0) else []
    return [_star_lamp(scene, wl), *around] if star_shines(scene, wl) else [*around]


def _star_lamp(scene: Scene, wl: Array) -> ParallelLamp:
    distance, star = scene.star_distance, scene.star
    return ParallelLamp(
        name="star",
        direction=tuple(float(v) for v in scene.sun.direction),
        irradiance=spectrum(star.irradiance(wl, distance), wl),
        angular_radius_deg=float(np.degrees(np.arcsin(star.radius / distance))),
        limb_darkening=star.limb_darkening and star.radius > 0,
    )


def spectrum(values: Array, wavelengths: Array) -> SpectralTable | float:
    """Numbers at wavelengths [nm] as a spectrum."""
    if wavelengths.size == 1:
        return float(values[0])
    return SpectralTable(wavelengths=tuple(wavelengths), values=tuple(float(v) for v in values))


def star_shines(scene: Scene, wavelengths: Array) -> bool:
    """Whether the star lights air that the observer may see; else it is left out.

    Air is seen as far as a line of sight that grazes the planet runs through it, and is lit as far as a ray that does.
    """
    if not np.any(scene.star.irradiance(wavelengths, scene.star_distance) > 0):
        return False
    radius, observer = scene.medium.radius, scene.observer
    seen, lit = (np.arccos(radius / (radius + h)) for h in (observer.altitude, observer.atmosphere_top))
    return bool(-np.radians(scene.sun.elevation_deg) <= seen + 2 * lit + scene.star.radius / scene.star_distance)


def check_scene(scene: Scene) -> None:
    """Refuse what walks among surfaces do not know of a sky."""
    held = scene.world
    if np.degrees(np.arcsin(min(scene.star.radius / scene.star_distance, 1.0))) > 5.0:
        raise DomainError("radius", scene.star.radius, f"fills more than 10 degrees of the sky of a scene with {held}")
