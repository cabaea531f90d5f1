"""From a scene's towns to lamps: how far from the observer they are, in which azimuth, and how much they shine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.surfaces.power import spectrum_shape
from skyscatter.surfaces.townmap import AnyTown, TownMap
from skyscatter.surfaces.towns import Town

#: Lamps by which the disk of a town is filled.
POINTS = 600
#: Lamps that are nearer count as at this distance [m].
LEAST = 30.0
#: Height of observers up to which nodes and walks follow what they see [m]: from above lamps look otherwise.
HIGHEST = 20e3
GOLDEN = np.pi * (3 - np.sqrt(5))


class Lamps(NamedTuple):
    """Lamps on the ground that differ in place and amount alone."""

    lobe: Array  #: (2, node) rising cosines of the zenith angle, and radiant intensities over the power [sr-1]
    spectrum: Array  #: (wavelength,) power of one of weight 1 [W nm-1]
    distance: Array  #: (lamp,) along the ground [m]
    azimuth: Array  #: (lamp,) from north through east [rad]
    weight: Array  #: (lamp,)


def towns_shine(scene: Scene) -> bool:
    """Whether towns are among the lights of a scene."""
    return bool(scene.towns) and (scene.lights is None or "towns" in scene.lights.shine)


def check_towns(scene: Scene, stokes: bool = False) -> None:
    """Refuse what towns cannot have in skies of air alone."""
    if scene.world:
        return
    if scene.ground.map is not None and towns_shine(scene):
        raise DomainError("ground.map", "given", "towns light even ground only; leave out the map, or the towns")
    if scene.altitude > HIGHEST and towns_shine(scene):
        rule = f"towns light the skies of observers up to {HIGHEST / 1e3:g} km; leave out --town, or come down"
        raise DomainError("altitude", scene.altitude, rule)
    if stokes and towns_shine(scene):
        raise DomainError("stokes", True, "the light of towns has no polarisation yet; leave out one of them")


def lamps_of(scene: Scene, wavelengths: Array) -> Iterator[Lamps]:
    """The lamps of all towns of a scene, see `lamps_and_towns`."""
    for lamps, _ in lamps_and_towns(scene, wavelengths):
        yield lamps


def lamps_and_towns(scene: Scene, wavelengths: Array) -> Iterator[tuple[Lamps, AnyTown]]:
    """The lamps of all towns of a scene, each with its town.

    Parameters
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    """
    for town in scene.towns or ():
        lobe = np.ascontiguousarray(np.stack(town.lobe.table()[:2]))
        if isinstance(town, Town):
            places, weight = disk(town, scene)
            spectrum = town.spectral_amount(wavelengths)
        else:
            places, weight = pixels(town, scene)
            spectrum = spectrum_shape(town.spectrum_table, wavelengths)
        if weight.size:
            flat = np.hypot(places[:, 0], places[:, 1])
            distance = scene.medium.radius * np.arctan2(flat, places[:, 2])
            azimuth = np.arctan2(places[:, 0], places[:, 1]) % (2 * np.pi)
            yield Lamps(lobe, spectrum, np.maximum(distance, LEAST), azimuth, weight), town


def disk(town: Town, scene: Scene) -> tuple[Array, Array]:
    """Unit vectors (lamp, 3) of the observer's frame from the planet's centre, and equal weights that sum to 1.

    The points are Vogel's spiral (1979, Mathematical Biosciences 44, 179), which fills a disk evenly.
    """
    radius = scene.medium.radius
    if town.distance is not None and town.azimuth_deg is not None:
        angle, azimuth = town.distance / radius, np.radians(town.azimuth_deg)
        middle = np.array([np.sin(angle) * np.sin(azimuth), np.sin(angle) * np.cos(azimuth), np.cos(angle)])
    else:
        middle = towards(scene, np.array([town.latitude_deg]), np.array([town.longitude_deg]))[0]
    count = POINTS if town.radius > 0 else 1
    number = np.arange(count)
    away = np.sqrt((number + 0.5) / count) * town.radius / radius
    side = np.cross(middle, np.eye(3)[int(np.argmin(np.abs(middle)))])
    side /= np.linalg.norm(side)
    other = np.cross(middle, side)
    turn = GOLDEN * number
    level = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    return np.cos(away)[:, None] * middle + np.sin(away)[:, None] * level, np.full(count, 1.0 / count)


def pixels(chart: TownMap, scene: Scene) -> tuple[Array, Array]:
    """The same of the pixels of a map near the observer, with powers in watts as weights."""
    site = scene.sun.site
    assert site is not None  # the scene has seen to it
    latitude, longitude, watts = chart.read(site.latitude_deg, site.longitude_deg, scene.medium.radius)
    return towards(scene, latitude, longitude), watts


def towards(scene: Scene, latitude_deg: Array, longitude_deg: Array) -> Array:
    """Unit vectors (place, 3) from the planet's centre to places, in the observer's frame (east, north, up).

    Latitudes count as those of a sphere: distances on the Earth are off by 0.5 % at most.
    """
    site = scene.sun.site
    assert site is not None
    own, other = np.radians(site.latitude_deg), np.radians(latitude_deg)
    turn = np.radians(np.asarray(longitude_deg) - site.longitude_deg)
    east = np.cos(other) * np.sin(turn)
    north = np.cos(own) * np.sin(other) - np.sin(own) * np.cos(other) * np.cos(turn)
    up = np.sin(own) * np.sin(other) + np.cos(own) * np.cos(other) * np.cos(turn)
    return np.stack([east, north, up], axis=-1)
