"""Eclipses of the Sun in scenes: which scenes are in one, and the table of it for kernels."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from skyscatter.celestial.coverage import uncovered_area, uncovered_light
from skyscatter.celestial.earthshadow import EARTH_RADIUS
from skyscatter.celestial.eclipse import REACH, SUN_RADIUS, Eclipse, solar_eclipse
from skyscatter.celestial.frames import Array, Sight
from skyscatter.celestial.moon import MOON_RADIUS
from skyscatter.kernels.eclipse import INNER, NO_ECLIPSE, OUTER, EclipseTable
from skyscatter.kernels.optics import OpticsTable
from skyscatter.scene import Scene, Site

#: How far the Sun of a scene may stand from where its place and time put it [rad]: further off somebody has moved it,
#: and the Moon does not follow.
MOVED = 1e-4
#: How far the radius of a planet may be from the Earth's [its share], to be the Earth; places and times mean Earth.
ROUND = 0.01
#: Points over the radius and the circumference by which the middle of what is free is found, at a wavelength [nm].
FREE_POINTS, FREE_WAVELENGTH = 400, [550.0]
#: Margin of the Moon's apparent radii in a table.
MARGIN = 1e-3


def eclipse_of(scene: Scene) -> Eclipse | None:
    """The eclipse of the Sun that dims the air of a scene, if any.

    Parameters
    ----------
    scene : Scene
        Place and time are those of the Sun's `site`; a Sun without one, or one that was moved since, is not eclipsed.

    Returns
    -------
    Eclipse or None
        None where no air or ground within sight of the observer, or near it, lies in the Moon's shadow.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter.solvers.eclipse import eclipse_of
    >>> earth = skyscatter.load_model("earth")
    >>> eclipse_of(earth.scene_at(42.85, -106.32, "2017-08-21T17:43:50Z")).kind
    'total'
    >>> eclipse_of(earth.scene_at(42.85, -106.32, "2017-08-22T17:43:50Z")) is None
    True
    """
    site = scene.sun.site
    if site is None or abs(scene.medium.radius / EARTH_RADIUS - 1.0) > ROUND:
        return None
    eclipse = _eclipse_at(site, scene.altitude, scene.medium.radius, scene.medium.top)
    if eclipse is None or float(np.linalg.norm(eclipse.sun_direction - scene.sun.direction)) > MOVED:
        return None
    return eclipse


def sight_reach(altitude: float, radius: float, top: float) -> float:
    """Distance of the furthest air that an observer sees [m]; heights and the planet's radius [m]."""
    outer = radius + top
    return math.sqrt(outer**2 - radius**2) + math.sqrt((radius + altitude) ** 2 - radius**2)


@lru_cache(maxsize=64)
def _eclipse_at(site: Site, altitude: float, radius: float, top: float) -> Eclipse | None:
    """The eclipse within sight of a place and time."""
    sight = site.sight(altitude)
    if not isinstance(sight, Sight):  # the moons of Mars hide a tenth of the Sun at most
        return None
    eclipse = solar_eclipse(sight, min(sight_reach(altitude, radius, top), REACH))
    if eclipse is None or not eclipse.reaches([0.0, 0.0, -radius - altitude], radius + top):
        return None
    return eclipse


def eclipse_table(scene: Scene, wavelengths: Array) -> EclipseTable:
    """The table of a scene's eclipse for kernels.

    Parameters
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm]

    Returns
    -------
    EclipseTable
        Without any share where there is no eclipse.  What is read between its entries is within 1e-5 of the share.

    Notes
    -----
    A table over the distance of the middles for three radii of the Moon, between which it changes linearly: its size
    differs by 0.3 per cent all over an observer's sky.  One of the three is the Sun's own radius where that is among
    them, for there total eclipses turn into annular ones.
    """
    eclipse = eclipse_of(scene)
    if eclipse is None:
        return NO_ECLIPSE
    position = scene.observer.position
    ratio = _ratios(eclipse, scene)
    apart = np.stack([separations(float(k)) for k in ratio])
    if scene.star.limb_darkening:
        share = uncovered_light(apart, ratio[:, None], wavelengths)
    else:
        share = np.repeat(uncovered_area(apart, ratio[:, None])[..., None], wavelengths.size, axis=-1)
    share[(apart <= ratio[:, None] - 1.0)] = 0.0
    sun, moon = eclipse.vectors
    return EclipseTable(
        np.ascontiguousarray(np.clip(share, 0.0, 1.0)), ratio, position + sun, position + moon, SUN_RADIUS, MOON_RADIUS,
        scene.star.radius / SUN_RADIUS,
    )  # fmt: skip


def free_middle(scene: Scene) -> Array:
    """How far the middle of the light that passes the Moon lies from the Sun's own, a vector (3,) between unit vectors.

    Seen by the observer; 0 where there is no eclipse, and where nothing passes.  Of a smaller star it is smaller.

    Examples
    --------
    Some twenty minutes before totality a third of the light passes, by the edge opposite to the Moon.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.solvers.eclipse import free_middle
    >>> scene = skyscatter.load_model("earth").scene_at(42.85, -106.32, "2017-08-21T17:20:00Z")
    >>> f"{np.degrees(np.linalg.norm(free_middle(scene))):.3f} degrees"
    '0.139 degrees'
    """
    eclipse = eclipse_of(scene)
    if eclipse is None:
        return np.zeros(3)
    sun, moon = (v / np.linalg.norm(v) for v in eclipse.vectors)
    towards = moon - sun
    towards /= max(float(np.linalg.norm(towards)), 1e-300)
    # Rings of equal area, in radii of the Sun.
    square = (np.arange(FREE_POINTS) + 0.5) / FREE_POINTS
    angle = 2 * np.pi * square[:, None]
    x, y = np.sqrt(square) * np.cos(angle), np.sqrt(square) * np.sin(angle)
    free = np.hypot(x - eclipse.separation / eclipse.sun_radius, y) > eclipse.moon_radius / eclipse.sun_radius
    light = free * scene.star.limb(np.sqrt(1 - square), FREE_WAVELENGTH)[:, 0]
    passed = float(light.sum())
    apart = float((x * light).sum()) / passed if passed > 0 else 0.0
    return towards * apart * eclipse.sun_radius * scene.star.radius / SUN_RADIUS


def light_axis(optics: OpticsTable) -> Array:
    """Direction (3,) to the middle of the points of the disk that shine, as `skyscatter.kernels.single` takes it."""
    towards = optics.sun_direction.sum(axis=0)
    return np.asarray(towards / np.linalg.norm(towards))


def moon_drawn(eclipse: Eclipse, axis: Array, radius: float) -> tuple[Array, float]:
    """Direction (3,) and radius [rad] of the Moon before a Sun that is drawn with a radius [rad] about an axis.

    The nominal Sun is smaller by 0.07 per cent than that which times of eclipses tell; a ring that is drawn with one
    and covered by the other would be off by a hundredth of its light.
    """
    scale = radius / eclipse.sun_radius
    moon = eclipse.vectors[1] / np.linalg.norm(eclipse.vectors[1])
    drawn = axis + scale * (moon - axis)
    return drawn / np.linalg.norm(drawn), scale * eclipse.moon_radius


def separations(ratio: float) -> Array:
    """Distances of the middles in a table, in radii of the Sun; as `skyscatter.kernels.eclipse.dim` looks them up."""
    within = abs(1.0 - ratio)
    inner = within * np.sin(0.5 * np.pi * np.arange(INNER) / INNER)
    outer = within + (1.0 + ratio - within) * 0.5 * (1.0 - np.cos(np.pi * np.arange(OUTER + 1) / OUTER))
    return np.concatenate([inner, outer])


def _ratios(eclipse: Eclipse, scene: Scene) -> Array:
    """Three apparent radii of the Moon, in those of the Sun, between the least and the greatest that matter."""
    medium = scene.medium
    reach, centre = sight_reach(scene.altitude, medium.radius, medium.top), np.zeros(3)
    if reach > medium.radius + medium.top:
        reach, centre = medium.radius + medium.top, -scene.observer.position
    _, moon = eclipse.vectors
    towards = (moon - centre) / np.linalg.norm(moon - centre)
    low, high = (float(eclipse.disks(centre + way * reach * towards)[1]) for way in (-1.0, 1.0))
    low, high = low * (1.0 - MARGIN), high * (1.0 + MARGIN)
    return np.array([low, 1.0 if low < 1.0 < high else 0.5 * (low + high), high])
