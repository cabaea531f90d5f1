"""The Moon's face: how its light is spread over the disk, and the Earth's light on its dark part."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import AU, Array
from skyscatter.celestial.lunareclipse import near_shadow, sunlight_on_moon
from skyscatter.celestial.lunarplace import MOON_RADIUS, Moon
from skyscatter.celestial.rolo import FIRST_PHASE, moon_reflectance, sunlit_irradiance
from skyscatter.spectra.solar import solar_irradiance

EARTH_RADIUS = 6.371e6  #: [m]
#: Albedo of the sphere by Lambert's law that would send the Moon as much light as the Earth does: mean of what is seen
#: in earthshine at phase angles from 45 to 135 degrees, 400 to 700 nm (Goode et al. 2001, Geophys. Res. Lett. 28,
#: 1671).
EARTH_ALBEDO = 0.297
#: Colour of the Earth from afar: its albedos in U, B, V, R_C and I_C over that in V (Mallama et al. 2017, Icarus 282,
#: 19), by wavelength [nm].  Rayleigh scattering makes the Earth 0.18 mag bluer in B - V than the Sun; Franklin 1967 (J.
#: Geophys. Res. 72, 2963) saw 0.17.
EARTH_COLOUR = ((360.0, 436.0, 549.0, 641.0, 798.0), (1.585, 1.180, 1.0, 0.903, 0.912))
#: Points by latitude and longitude for the integral over the lit face.
_POINTS = 64


def moon_radiance(moon: Moon, directions: ArrayLike, wavelengths: ArrayLike) -> Array:
    """Radiance of the Moon's face outside the atmosphere.

    Parameters
    ----------
    moon : Moon
    directions : array_like, shape (..., 3)
        Unit vectors (east, north, up); NaN counts as outside.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm]; sunlight is averaged over their cells.

    Returns
    -------
    ndarray, shape (..., wavelength)
        [W m-2 sr-1 nm-1], 0 outside the disk.

    Notes
    -----
    Where the Sun shines the radiance goes as cos i / (cos i + cos e), the law of Lommel and Seeliger with the angles of
    incidence i and emission e on a sphere at its true distance, scaled such that the integral over the disk is
    `moon_irradiance`.  So the full Moon is evenly bright up to its limb, and light fades out at the terminator.  Maria
    and mountains are not shown.  In the Earth's shadow each point has its share of sunlight, bent and reddened by the
    Earth's air (`skyscatter.celestial.lunareclipse.sunlight_on_moon`).

    Where no Sun shines there is the Earth's light: that of a sphere by Lambert's law with `EARTH_ALBEDO` and the
    Earth's phase, bluer than sunlight by `EARTH_COLOUR`, reflected evenly by the disk as the full Moon reflects
    sunlight.

    Examples
    --------
    The mean radiance of a Moon near full, and the darkness beside it.

    >>> import numpy as np
    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import moon_at, moon_radiance
    >>> moon = moon_at(Sight(-24.6, -70.4, "2026-04-02T02:00Z"))
    >>> beside = moon.direction + [0.0, 0.01, 0.0]
    >>> face = moon_radiance(moon, [moon.direction, beside / np.linalg.norm(beside)], [550.0])
    >>> face[:, 0].round(3)
    array([0.075, 0.   ])
    """
    d = np.asarray(directions, dtype=float)
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    result = np.zeros((*d.shape[:-1], wl.size))
    along = d @ moon.direction
    on_disk = along > math.cos(moon.angular_radius)
    if not on_disk.any():
        return result
    law, lit, normal = _face(moon, d[on_disk])
    whole = _integral(moon)
    scale = sunlit_irradiance(moon, wl) / whole if whole > 0.0 else np.zeros(wl.size)
    light = law[:, None] * scale
    if near_shadow(moon):
        light *= sunlight_on_moon(moon, MOON_RADIUS * normal, wl)
    result[on_disk] = np.where(lit[:, None], light, earthshine(moon, wl))
    return result


def earthshine(moon: Moon, wavelengths: ArrayLike) -> Array:
    """Radiance of the part of the Moon that only the Earth lights.

    Parameters
    ----------
    moon : Moon
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    ndarray, shape (wavelength,)
        [W m-2 sr-1 nm-1]; how it is found `moon_radiance` says.

    Examples
    --------
    Two days before new Moon it is 18 000 times fainter than the full Moon.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import earthshine, moon_at
    >>> moon = moon_at(Sight(-24.6, -70.4, "2026-04-15T10:00Z"))
    >>> (earthshine(moon, [450.0, 550.0, 650.0]) * 1e6).round(2)
    array([4.05, 4.07, 3.55])
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    # The angle between the Sun and the Moon as the Earth sees them: 0 where the Earth is full for the Moon.
    to_earth = moon.earth_distance * moon.earth_direction
    to_sun = moon.sun_distance * moon.sun_direction - to_earth
    cosine = -to_earth @ to_sun / (moon.earth_distance * np.linalg.norm(to_sun))
    angle = math.acos(min(max(float(cosine), -1.0), 1.0))
    lambert = 2.0 / 3.0 * (math.sin(angle) + (math.pi - angle) * math.cos(angle)) / math.pi
    size = (EARTH_RADIUS / moon.earth_distance) ** 2
    light = solar_irradiance(wl) * (AU / float(np.linalg.norm(to_sun))) ** 2
    light = light * EARTH_ALBEDO * np.interp(wl, *EARTH_COLOUR) * lambert * size
    # Who looks from the Earth stands beside the lamp: the reflectance at the least phase angle of the model.
    facing = replace(moon, phase_angle_deg=FIRST_PHASE, sun_longitude_deg=moon.observer_longitude_deg)
    return np.asarray(light * moon_reflectance(facing, wl) / math.pi)


def _face(moon: Moon, directions: Array) -> tuple[Array, Array, Array]:
    """The law of reflection where lines of sight meet the sphere, whether the Sun shines there, and the normals."""
    along = directions @ moon.direction
    # Squares of sines, not 1 - cos^2, keep the digits of so small an angle.
    aside = directions - along[:, None] * moon.direction
    depth = MOON_RADIUS**2 - moon.distance**2 * np.einsum("ij,ij->i", aside, aside)
    root = np.sqrt(np.maximum(depth, 0.0))
    normal = ((moon.distance * along - root)[:, None] * directions - moon.distance * moon.direction) / MOON_RADIUS
    incidence, emission = normal @ moon.sun_direction, root / MOON_RADIUS
    lit = incidence > 0.0
    return np.where(lit, incidence / np.where(lit, incidence + emission, 1.0), 0.0), lit, normal


def _integral(moon: Moon) -> float:
    """Integral of the law over the lit disk [sr].

    On the sphere, in latitude from the plane of Sun, Moon and observer and longitude from the observer's side: at each
    latitude from the terminator to where the line of sight grazes the ground, Gauss-Legendre points in both.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    rim = MOON_RADIUS / moon.distance
    # sin(latitude) = edge sin(t): the limits of longitude have square roots at the ends, which t takes away.
    t = 0.5 * math.pi * nodes
    edge = math.sqrt(1.0 - rim**2)
    sine = edge * np.sin(t)
    cosine = np.sqrt(1.0 - sine**2)
    limb = np.arccos(np.minimum(rim / cosine, 1.0))
    phase = math.radians(moon.phase_angle_deg)
    start = np.maximum(-limb, phase - 0.5 * math.pi)  # the Sun stands at longitude `phase`
    stop = np.minimum(limb, phase + 0.5 * math.pi)
    half = np.maximum(0.5 * (stop - start), 0.0)
    longitude = 0.5 * (start + stop)[:, None] + half[:, None] * nodes
    facing = cosine[:, None] * np.cos(longitude)  # cosine of the angle at the centre to the observer
    incidence = np.maximum(cosine[:, None] * np.cos(longitude - phase), 0.0)
    square = 1.0 + rim**2 - 2.0 * rim * facing  # of the distance from the observer, in units of that of the centre
    emission = np.maximum((facing - rim) / np.sqrt(square), 0.0)
    light = incidence / np.maximum(incidence + emission, 1e-300) * emission * rim**2 / square
    over_longitude = half * (light @ weights)
    return float(0.5 * math.pi * edge * (weights * np.cos(t)) @ over_longitude)
