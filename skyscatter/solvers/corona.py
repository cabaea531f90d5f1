"""The Sun's corona around the Moon in total eclipses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.eclipse import eclipse_of, moon_drawn
from skyscatter.solvers.overhead import Overhead
from skyscatter.solvers.skylights import FACE_FINER, disk_grid, onto_pixels
from skyscatter.solvers.sundisk import Veil, no_veil

#: Baumbach's law: terms of the radiance over the Sun's mean, a coefficient and a power of the distance in radii of the
#: Sun (Baumbach 1937, Astron. Nachr. 263, 121, with the coefficients of Allen 1973, Astrophysical Quantities, 85).
TERMS = ((0.0532e-6, 2.5), (1.425e-6, 7.0), (2.565e-6, 17.0))
#: How far it is drawn, there a hundredth of the sky in totality, and how far averaged over pixels [radii of the Sun].
FURTHEST, AVERAGED = 40.0, 3.0
#: Points on the radius of what is averaged, at least.
POINTS = 300


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
    scene: Scene, table: Any, camera: Any, grid: Array, wavelengths: Array, veil: Veil = no_veil
) -> tuple[NDArray[np.intp], Array] | None:
    """Pixels with the corona, in total eclipses.

    Parameters
    ----------
    scene : Scene
    table : SceneTable
        Of that scene.
    camera : Camera
    grid : ndarray, shape (y, x, 3)
        Directions through the middles of the pixels, NaN outside the field.
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    veil : callable
        As for `skyscatter.solvers.sundisk.disk_correction`.

    Returns
    -------
    (pixel,) int, (pixel, wavelength)
        Numbers of the pixels in reading order and what it adds to them [W m-2 sr-1 nm-1], dimmed by the air; None where
        some of the Sun outshines it.  Beside the Moon it is averaged over pixels, further out taken at their middles.
    """
    eclipse = eclipse_of(scene)
    if eclipse is None or eclipse.kind != "total":
        return None
    optics, observer = table.optics, scene.observer
    moon, moon_radius = moon_drawn(eclipse, optics.disk_axis, float(optics.disk_radius))
    above = Overhead(scene, wavelengths)
    whole = optics.sun_irradiance.sum(axis=0) / (np.pi * np.sin(optics.disk_radius) ** 2)

    def radiance(directions: Array) -> Array:
        away = np.linalg.norm(np.cross(directions, optics.disk_axis), axis=1) / np.sin(optics.disk_radius)
        covered = np.linalg.norm(np.cross(directions, moon), axis=1) < np.sin(moon_radius)
        seen = np.where(covered | (away < 1.0), 0.0, corona_light(np.maximum(away, 1.0)))
        return np.asarray(seen[:, None] * whole * above.transmittance(directions) * veil(directions))

    flat = grid.reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(flat - optics.disk_axis, axis=1)
    reach = FURTHEST * float(optics.disk_radius)
    near = np.flatnonzero(away < reach)
    sides = np.sqrt(camera.pixel_solid_angle(observer).ravel()[near])
    largest = float(sides.max(initial=0.0))
    inner = max(AVERAGED * float(optics.disk_radius), 3.0 * largest)
    smallest = float(sides[sides > 0].min(initial=1.0))
    # Points beyond the pixels that are averaged, so that these are full.
    points, area = disk_grid(
        optics.disk_axis, inner + 2.0 * largest, max(POINTS, int(FACE_FINER * inner / smallest) + 1)
    )
    pixels, light = onto_pixels(camera, observer, points, radiance(points) * area)
    averaged = away[pixels] < inner
    outer = near[away[near] >= inner]
    return (
        np.concatenate([pixels[averaged], outer]),
        np.concatenate([light[averaged], radiance(np.ascontiguousarray(flat[outer]))]),
    )
