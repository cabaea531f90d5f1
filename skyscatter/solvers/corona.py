"""The Sun's corona around the Moon in total eclipses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.eclipse import eclipse_of
from skyscatter.solvers.overhead import Overhead
from skyscatter.solvers.skylights import FACE_FINER, disk_grid, onto_pixels

#: Baumbach's law: terms of the radiance over the Sun's mean, a coefficient and a power of the distance in radii of the
#: Sun (Baumbach 1937, Astron. Nachr. 263, 121, with the coefficients of Allen 1973, Astrophysical Quantities, 85).
TERMS = ((0.0532e-6, 2.5), (1.425e-6, 7.0), (2.565e-6, 17.0))
#: How far it is drawn [radii of the Sun], and points on that distance at least.
FURTHEST, POINTS = 5.0, 300


def corona_light(distance: ArrayLike) -> Array:
    """Radiance of the corona relative to that of the Sun's disk.

    Parameters
    ----------
    distance : array_like, any shape
        From the Sun's middle, in its radii, 1 and more.

    Returns
    -------
    ndarray
        White, for electrons scatter all light alike.  The corona's shape and its brightness, which changes by a factor
        of two over the Sun's cycle, are left out.

    Examples
    --------
    >>> from skyscatter.solvers.corona import corona_light
    >>> [f"{light:.1e}" for light in corona_light([1.05, 1.5, 3.0])]
    ['2.2e-06', '1.0e-07', '4.1e-09']
    """
    r = np.asarray(distance, dtype=float)
    return np.asarray(sum(factor * r**-power for factor, power in TERMS))


def corona_pixels(
    scene: Scene, table: Any, camera: Any, wavelengths: Array
) -> tuple[NDArray[np.intp], Array] | None:
    """Pixels with the corona, in total eclipses.

    Parameters
    ----------
    scene : Scene
    table : SceneTable
        Of that scene.
    camera : Camera
    wavelengths : ndarray, shape (wavelength,)
        [nm]

    Returns
    -------
    (pixel,) int, (pixel, wavelength)
        Numbers of the pixels in reading order and what it adds to them [W m-2 sr-1 nm-1], dimmed by the air; None where
        some of the Sun outshines it.
    """
    eclipse = eclipse_of(scene)
    if eclipse is None or eclipse.kind != "total":
        return None
    optics, observer = table.optics, scene.observer
    solid_angle = camera.pixel_solid_angle(observer)
    smallest = float(np.sqrt(solid_angle[solid_angle > 0].min(initial=1.0)))
    reach = FURTHEST * float(optics.disk_radius)
    points, area = disk_grid(optics.disk_axis, reach, max(POINTS, int(FACE_FINER * reach / smallest) + 1))
    moon = eclipse.vectors[1] / np.linalg.norm(eclipse.vectors[1])
    away = np.linalg.norm(np.cross(points, optics.disk_axis), axis=1) / np.sin(optics.disk_radius)
    free = (np.linalg.norm(np.cross(points, moon), axis=1) > np.sin(eclipse.moon_radius)) & (away >= 1.0)
    above = Overhead(scene, wavelengths)
    points, away = points[free], away[free]
    whole = optics.sun_irradiance.sum(axis=0) / (np.pi * np.sin(optics.disk_radius) ** 2)
    light = corona_light(away)[:, None] * whole * above.transmittance(points) * area
    return onto_pixels(camera, observer, points, light)
