"""The Moon's light as a whole, outside the air: the model of the Robotic Lunar Observatory (ROLO)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.celestial.frames import AU, Array
from skyscatter.celestial.lunareclipse import left_of_moonlight, near_shadow
from skyscatter.celestial.lunarplace import Moon
from skyscatter.datafiles import read_table
from skyscatter.spectra.solar import solar_irradiance

SOLID_ANGLE = 6.4177e-5  #: of the Moon [sr] at the mean distance, as the model takes it
MEAN_DISTANCE = 3.844e8  #: [m]
#: Phase angles [degree] of the observations behind the model.
FIRST_PHASE, LAST_PHASE = 1.55, 97.0
#: Where the mean phase curve gives way to a smooth sphere's [degree].
CRESCENT = 150.0

# The constants that all bands share.
_C = (0.00034115, -0.0013425, 0.00095906, 0.00066229)
_P = (4.06054, 12.8802, -30.5858, 16.7498)


def moon_irradiance(moon: Moon, wavelengths: ArrayLike) -> Array:
    """Irradiance by the Moon on a surface that faces it, outside the atmosphere.

    Parameters
    ----------
    moon : Moon
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm]; sunlight is averaged over their cells.

    Returns
    -------
    ndarray, shape (wavelength,)
        [W m-2 nm-1]

    Notes
    -----
    Reflectance by `moon_reflectance`; Kieffer & Stone 2005, equations 7 and 8.  Their model is consistent to 1 % over
    phases and librations, its scale uncertain by 5 to 10 %: photometers find the Moon brighter by 4 to 9 % (Roman et
    al. 2020, Remote Sens. 12, 1902).  In the Earth's shadow it is dimmed and reddened as the sunlight on it, see
    `skyscatter.celestial.lunareclipse.left_of_moonlight`.

    Examples
    --------
    A Moon that is all but full is 400 000 times fainter than the Sun.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import moon_at, moon_irradiance
    >>> from skyscatter.spectra.solar import solar_irradiance
    >>> moon = moon_at(Sight(-24.6, -70.4, "2026-04-02T02:00Z"))
    >>> ratio = solar_irradiance([550.0]) / moon_irradiance(moon, [550.0])
    >>> round(float(ratio[0]), -4)
    400000.0
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    light = sunlit_irradiance(moon, wl)
    return light * left_of_moonlight(moon, wl) if near_shadow(moon) else light


def sunlit_irradiance(moon: Moon, wavelengths: ArrayLike) -> Array:
    """As `moon_irradiance`, as if no Earth were before the Sun."""
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    nearer = (AU / moon.sun_distance) ** 2 * (MEAN_DISTANCE / moon.distance) ** 2
    return np.asarray(moon_reflectance(moon, wl) * solar_irradiance(wl) * SOLID_ANGLE / math.pi * nearer)


def moon_reflectance(moon: Moon, wavelengths: ArrayLike) -> Array:
    """Disk-equivalent reflectance of the Moon: that of a white disk of its size that faces Sun and observer is 1.

    Parameters
    ----------
    moon : Moon
    wavelengths : array_like, shape (wavelength,)
        [nm]

    Returns
    -------
    ndarray, shape (wavelength,)

    Notes
    -----
    Kieffer & Stone 2005 (Astron. J. 129, 2887), equation 10 with the coefficients of their 32 bands, made smooth over
    wavelength by the spectrum of Apollo samples (``data/rolo.csv``) and linear between bands; beyond 350 and 2384 nm
    it stays constant.  The observations cover phase angles from 1.55 to 97 degrees.  Nearer to full the model's own
    exponentials go on, its opposition surge.  Beyond 97 degrees its value there falls as the mean phase curve of the
    Moon does in V, 0.026 g + 4e-9 g^4 magnitudes with g in degrees (Allen 1976; Krisciunas & Schaefer 1991), and beyond
    150 degrees, which that curve does not know, as the light of a Lommel-Seeliger sphere does, down to nothing.

    Examples
    --------
    The Moon is dark, and red.

    >>> from skyscatter.celestial.frames import Sight
    >>> from skyscatter.celestial.moon import moon_at, moon_reflectance
    >>> moon = moon_at(Sight(-24.6, -70.4, "2026-04-02T02:00Z"))
    >>> moon_reflectance(moon, [400.0, 550.0, 800.0]).round(2)
    array([0.1 , 0.13, 0.16])
    """
    wl = np.atleast_1d(np.asarray(wavelengths, dtype=float))
    nodes = read_table("rolo.csv")["wavelength_nm"]
    inside = min(moon.phase_angle_deg, LAST_PHASE)
    # The Sun's longitude goes with the phase and is taken back as far.
    sun = math.radians(moon.sun_longitude_deg - math.copysign(moon.phase_angle_deg - inside, moon.sun_longitude_deg))
    bands = _bands(inside, sun, moon.observer_longitude_deg, moon.observer_latitude_deg)
    return np.interp(wl, nodes, bands) * _beyond(moon.phase_angle_deg)


def _bands(phase_deg: float, sun: float, longitude_deg: float, latitude_deg: float) -> Array:
    """Reflectance in the 32 bands; of the Sun the longitude [rad], of the observer both [degree]."""
    t = read_table("rolo.csv")
    g = math.radians(phase_deg)
    logarithm = t["a0"] + t["a1"] * g + t["a2"] * g**2 + t["a3"] * g**3
    logarithm = logarithm + t["b1"] * sun + t["b2"] * sun**3 + t["b3"] * sun**5
    logarithm += _C[0] * longitude_deg + _C[1] * latitude_deg + sun * (_C[2] * longitude_deg + _C[3] * latitude_deg)
    logarithm += t["d1"] * math.exp(-phase_deg / _P[0]) + t["d2"] * math.exp(-phase_deg / _P[1])
    logarithm += t["d3"] * math.cos((phase_deg - _P[2]) / _P[3])
    return np.asarray(np.exp(logarithm) * t["apollo"])


def _beyond(phase_deg: float) -> float:
    """Reflectance at a phase angle relative to that at 97 degrees; 1 within the model's range."""
    if phase_deg <= LAST_PHASE:
        return 1.0
    curve = min(phase_deg, CRESCENT)
    magnitudes = 0.026 * (curve - LAST_PHASE) + 4e-9 * (curve**4 - LAST_PHASE**4)
    thin = lommel_seeliger(phase_deg) / lommel_seeliger(CRESCENT) if phase_deg > CRESCENT else 1.0
    return float(10 ** (-0.4 * magnitudes) * thin)


def lommel_seeliger(phase_deg: float) -> float:
    """Light of a sphere that reflects by the law of Lommel and Seeliger, relative to that at full phase.

    1 - sin(g / 2) tan(g / 2) ln cot(g / 4); in terms that keep their digits close to 180 degrees.
    """
    if phase_deg <= 0.0:
        return 1.0
    if phase_deg >= 180.0:
        return 0.0
    half, quarter = math.radians(phase_deg) / 2, math.radians(phase_deg) / 4
    # ln cot(g / 4) = atanh cos(g / 2), and sin tan / cos = sin^2 / cos.
    cosine = math.cos(half)
    if cosine > 0.02:
        return 1.0 - math.sin(half) * math.tan(half) * -math.log(math.tan(quarter))
    return 2.0 * cosine**2 / 3.0 + 2.0 * cosine**4 / 15.0
