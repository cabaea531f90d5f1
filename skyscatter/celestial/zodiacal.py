"""Zodiacal light: sunlight that dust between the planets scatters, with the gegenschein.

Brightness at 500 nm is table 17 of Leinert et al. (1998, A&AS 127, 1), over the longitude from the Sun and the ecliptic
latitude, for an observer at 1 au.  The table is even in both; what it leaves out of reality is the tilt of the dust's
plane by some 2 degrees and the course of a year (up to 10 % or so).

Between its nodes the logarithm of brightness, freed of the rise towards the Sun,

    q = ln(I sin(e / 2)^2.45),   cos e = cos(longitude - Sun's) cos(latitude),

is a smooth function of the sphere, joined by cubic splines.  In the ecliptic brightness falls with the elongation e
as e^-2.45 between 3 and 30 degrees (Hahn et al. 2002, Icarus 158, 360).  The eight cells next to the Sun that the
table has no value for take q from the tabulated cells on the same side of the Sun, so that they follow this power law;
towards the Sun the isophotes become round, as those of the F corona do.  Within 1 degree of the Sun brightness is that
at 1 degree: the corona itself, its electrons above all, is not part of this.

The spectrum is the Sun's, reddened by 1 + k lg(wavelength / 500 nm) (equation 22 of the same): k = 1.2 below and 0.8
above 500 nm at elongations of 30 degrees and less, 0.9 and 0.6 from 90 degrees on, linear between.  That holds from 220
to 2500 nm; beyond, the dust's own heat takes over.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.celestial.grids import bilinear, flat_spline, unit_vectors
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.solar import solar_irradiance

Array = NDArray[np.float64]

#: Radiance at 500 nm of one star of V = 10 and of solar type per square degree [W m-2 sr-1 nm-1]: Leinert et al.
#: (1998), table 2 (1.28e-8 W m-2 sr-1 um-1).
S10_SUN = 1.28e-11
#: Brightness in V of one star of V = 10 per square degree [mag arcsec-2]: 10 + 2.5 lg(3600^2).
S10_MAGNITUDE = 27.78
RISE = 2.45  #: fall of brightness with the elongation in the ecliptic (Hahn et al. 2002)
NEAREST = 1.0  #: elongation within which brightness does not rise further [degree]
_REFERENCE = 500.0  # [nm]
_SMOOTH = 20.0  # width over which the Sun's lines at 500 nm are evened out [nm]
_ELONGATIONS = 30.0, 90.0  # between which the reddening changes [degree]
_REDDENING = ((1.2, 0.8), (0.9, 0.6))  # at each of them, below and above 500 nm
_LONGEST = 2500.0  # [nm]


def zodiacal_radiance(ecliptic: ArrayLike, sun_longitude_deg: float, wavelengths_nm: ArrayLike) -> Array:
    """Spectral radiance of the zodiacal light outside the air.

    It is `zodiacal_parts` times `zodiacal_spectra`, which cost less memory where one can go on with them.

    Parameters
    ----------
    ecliptic : array_like, shape (..., 3)
        Directions: vectors in the ecliptic frame of J2000, x to the equinox, z to the north pole of the ecliptic.
    sun_longitude_deg : float
        Ecliptic longitude of the Sun [degree] in the same frame.
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 280 to 2500; sunlight is averaged over their cells.

    Returns
    -------
    ndarray, shape (..., wavelength)
        Radiance [W m-2 sr-1 nm-1]; NaN where the direction is NaN.

    Raises
    ------
    DomainError
        For vectors without length and wavelengths out of range.

    Examples
    --------
    Half a right angle from the Sun in the ecliptic, and at the pole of the ecliptic, in stars of tenth magnitude per
    square degree:

    >>> from skyscatter.celestial.zodiacal import S10_SUN, zodiacal_radiance
    >>> light = zodiacal_radiance([[2**-0.5, 2**-0.5, 0], [0, 0, 1]], 0.0, [500.0])
    >>> (light / S10_SUN).round(-1).tolist()
    [[700.0], [60.0]]
    """
    return np.asarray(zodiacal_parts(ecliptic, sun_longitude_deg) @ zodiacal_spectra(wavelengths_nm))


def zodiacal_parts(ecliptic: ArrayLike, sun_longitude_deg: float) -> Array:
    """Radiance at 500 nm [W m-2 sr-1 nm-1], divided between the spectra of `zodiacal_spectra`.

    Parameters
    ----------
    ecliptic : array_like, shape (..., 3)
        As for `zodiacal_radiance`.
    sun_longitude_deg : float
        Ecliptic longitude of the Sun [degree].

    Returns
    -------
    ndarray, shape (..., 2)
        Of the spectrum near the Sun, and of that far from it; neither is negative.

    Examples
    --------
    >>> from skyscatter.celestial.zodiacal import zodiacal_parts
    >>> near, far = zodiacal_parts([1, 0, 0], 180.0)  # the gegenschein
    >>> float(near), round(float(far) * 1e9, 2)
    (0.0, 2.3)
    """
    if not np.isfinite(sun_longitude_deg):
        raise DomainError("sun_longitude_deg", sun_longitude_deg, "must be a number of degrees")
    x, y, z = np.moveaxis(unit_vectors("ecliptic", ecliptic), -1, 0)
    sun = np.radians(sun_longitude_deg)
    towards, across = x * np.cos(sun) + y * np.sin(sun), y * np.cos(sun) - x * np.sin(sun)
    off = np.hypot(across, z)
    longitude = np.degrees(np.arctan2(np.abs(across), towards))
    latitude = np.degrees(np.arctan2(np.abs(z), np.hypot(towards, across)))
    elongation = np.arctan2(off, towards)
    q = bilinear(_smooth(), longitude.ravel(), latitude.ravel()).reshape(elongation.shape)
    half = np.sin(0.5 * np.maximum(elongation, np.radians(NEAREST)))
    brightness = np.exp(q) * half**-RISE
    low, high = np.radians(_ELONGATIONS)
    share = np.clip((elongation - low) / (high - low), 0.0, 1.0)
    return np.stack([brightness * (1.0 - share), brightness * share], axis=-1)


def zodiacal_spectra(wavelengths_nm: ArrayLike) -> Array:
    """Spectra of the zodiacal light near the Sun and far from it, 1 at 500 nm without the Sun's lines.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 280 to 2500.

    Returns
    -------
    ndarray, shape (2, wavelength)
        At elongations of 30 degrees and less, and of 90 degrees and more.

    Raises
    ------
    DomainError
        For wavelengths out of range.

    Examples
    --------
    >>> from skyscatter.celestial.zodiacal import zodiacal_spectra
    >>> zodiacal_spectra([400.0, 500.0, 600.0]).round(2).tolist()  # redder near the Sun
    [[0.64, 1.0, 0.96], [0.67, 1.0, 0.95]]
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if wl.size and not wl.max() <= _LONGEST:
        raise DomainError(
            "wavelength", float(wl.max()), "zodiacal light is known up to 2500 nm, where dust's heat begins"
        )
    whole = solar_irradiance([_REFERENCE], band=_SMOOTH)[0]
    decades = np.log10(wl / _REFERENCE)
    red = [1.0 + np.where(decades < 0, below, above) * decades for below, above in _REDDENING]
    return np.asarray(solar_irradiance(wl) / whole * np.stack(red))


@lru_cache(maxsize=1)
def _smooth() -> Array:
    """ln(I sin(e / 2)^2.45) for every degree of longitude from the Sun, 0 to 180, and of latitude, 0 to 90."""
    table = read_table("zodiacal.csv")
    longitude = table["longitude_deg"]
    names = [name for name in table if name.startswith("latitude_")]
    latitude = np.array([float(name.partition("_")[2]) for name in names])
    brightness = np.stack([table[name] for name in names], axis=1) * 1e-11  # to W m-2 sr-1 nm-1
    cosine = np.cos(np.radians(longitude))[:, None] * np.cos(np.radians(latitude))
    known = brightness > 0
    q = np.log(np.where(known, brightness, 1.0)) + 0.5 * RISE * np.log(np.maximum(0.5 - 0.5 * cosine, 1e-12))
    q = _filled(longitude, latitude, q, known)
    rows = flat_spline(longitude, q, np.arange(181.0))
    # Along a great circle over the pole the curve of one longitude goes on in that of the opposite one.
    circle = np.concatenate([latitude, 180.0 - latitude[-2::-1]])
    over = np.concatenate([rows, rows[::-1, -2::-1]], axis=1)
    return np.ascontiguousarray(flat_spline(circle, over.T, np.arange(91.0)).T)


def _filled(longitude: Array, latitude: Array, q: Array, known: NDArray[np.bool_]) -> Array:
    """The cells next to the Sun, from the first known cells around them by the angle about the Sun."""
    rows, columns = np.flatnonzero(~known.all(axis=1)), np.flatnonzero(~known.all(axis=0))
    edge = {(int(i), int(np.argmax(known[i]))) for i in rows}
    edge |= {(int(np.argmax(known[:, j])), int(j)) for j in columns}
    angles, values = np.array(sorted((np.arctan2(latitude[j], longitude[i]), q[i, j]) for i, j in edge)).T
    filled = q.copy()
    for i, j in np.argwhere(~known):
        filled[i, j] = np.interp(np.arctan2(latitude[j], longitude[i]), angles, values)
    filled[0, 0] = values[0]  # the ecliptic's: its power law holds down to 3 degrees
    return filled
