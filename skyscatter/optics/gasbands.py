"""Absorption by mixed gases and water vapour along the Sun's way, by a band model.

Intervals of 10 cm-1 (data/gas_bands.csv, fitted to 6SV 1.1) with the law of Malkmus (1967, J. Opt. Soc. Am. 57, 323),

    -ln T = (2 k / c) (sqrt(1 + c x) - 1),    x the amount along the way.

The lines behind it date from the 1980s, the mixing ratio of CO2 too (0.003 in the bands at 1.6 um).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError

Array = NDArray[np.float64]

STANDARD_PRESSURE = 1013.25  #: [hPa]
LARGEST_ZENITH = 85.0  #: of Sun and view [degrees]

_EARTH_RADIUS = 6371.0  # [km]
#: Heights [km] of the absorbers: exponential ones by their scale height, ozone by the middle and width of its layer.
_WATER_SCALE, _AIR_SCALE = 2.0, 8.0
_OZONE_MIDDLE, _OZONE_WIDTH = 22.0, 5.0


def gas_bands(wavelengths_nm: ArrayLike, mixed: ArrayLike, water: ArrayLike) -> Array:
    """Transmittance of mixed gases and water vapour by the band model, without their weak absorption elsewhere.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Inside the intervals of the table, 555 to 2497 nm; 1 outside.
    mixed : array_like
        Slant amount of the mixed gases, 1 for one vertical column at standard pressure.
    water : array_like
        Slant column of water vapour [g cm-2], of the shape of `mixed`.

    Returns
    -------
    ndarray, shape (..., wavelength)
    """
    row, spectra = table_rows(np.atleast_1d(np.asarray(wavelengths_nm, float))), read_table("gas_bands.csv")
    gases = malkmus(spectra["mixed_k"], spectra["mixed_c"], row, np.asarray(mixed, float))
    return gases * malkmus(spectra["water_k"], spectra["water_c"], row, np.asarray(water, float))


def ozone_air_mass(zenith: ArrayLike) -> Array:
    """Slant over vertical column of the ozone layer (a Gaussian at 22 km, 5 km wide) in spherical shells."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(6)
    return _air_mass(zenith, _OZONE_MIDDLE + _OZONE_WIDTH * nodes, weights)


def water_air_mass(zenith: ArrayLike) -> Array:
    """Slant over vertical column of water vapour (scale height 2 km) in spherical shells."""
    nodes, weights = np.polynomial.laguerre.laggauss(16)
    return _air_mass(zenith, _WATER_SCALE * nodes, weights)


def mixed_air_mass(zenith: ArrayLike) -> Array:
    """Slant over vertical column of well mixed gases (scale height 8 km) in spherical shells, without refraction."""
    nodes, weights = np.polynomial.laguerre.laggauss(16)
    return _air_mass(zenith, _AIR_SCALE * nodes, weights)


def _air_mass(zenith: ArrayLike, heights_km: Array, weights: Array) -> Array:
    """Mean over heights of the secant at which a straight line, at `zenith` on the ground, crosses the shell there."""
    sine = np.sin(np.radians(checked_zenith("zenith", zenith)))[..., None]
    return np.asarray(1.0 / np.sqrt(1.0 - (sine / (1.0 + heights_km / _EARTH_RADIUS)) ** 2) @ (weights / weights.sum()))


def checked_zenith(name: str, zenith: ArrayLike) -> Array:
    """Zenith angles [degrees] from 0 to `LARGEST_ZENITH`, or a refusal that names them."""
    z = np.asarray(zenith, dtype=float)
    if not np.all((z >= 0.0) & (z <= LARGEST_ZENITH)):
        raise DomainError(name, zenith, f"angles from 0 to {LARGEST_ZENITH:g} degrees")
    return z


def table_rows(wl: Array) -> Array:
    """Row of the interval that holds each wavelength, -1 outside the table."""
    wavenumber = 1e7 / read_table("gas_bands.csv")["wavelength_nm"]  # descending, centres of equal intervals
    step = float(wavenumber[0] - wavenumber[-1]) / (wavenumber.size - 1)
    row = np.floor((wavenumber[0] - 1e7 / wl) / step + 0.5).astype(int)
    return np.where((row >= 0) & (row < wavenumber.size), row, -1)


def malkmus(k: Array, c: Array, row: Array, amount: Array) -> Array:
    """Transmittance of each sample, shape of `amount` and (sample,); 1 outside the table."""
    k_here, c_here = (np.append(column, 0.0)[row] for column in (k, c))
    x = np.asarray(amount)[..., None]
    # 2 (sqrt(1 + c x) - 1) / c, without the loss of digits, and x where c is 0.
    return np.exp(-2.0 * k_here * x / (1.0 + np.sqrt(1.0 + c_here * x)))
