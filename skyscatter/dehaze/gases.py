"""What gases take from a band's light on its way from the Sun to the ground and up to the sensor.

    T_gas = T_ozone T_other T_water

Ozone lies above nearly all that scatters, so that its factor multiplies everything the sensor sees, the path
reflectance too; so, near enough, does that of the mixed gases (O2, CO2, CH4, N2O, CO).  Water vapour lies in and below
the haze: its factor belongs to the light from the ground; air scatters mostly above it, and what aerosols scatter has
crossed about half of it, for which there is `GasTransmittance.water_half` (as 6S does: Vermote et al. 1997, IEEE Trans.
Geosci. Remote Sensing 35, 675).

Each factor is the mean over response times solar irradiance, taken one after the other, so that their product is the
mean of the product.  Ozone and NO2 come from their cross sections; water vapour and the mixed gases from a band model
in intervals of 10 cm-1 (data/gas_bands.csv, fitted to 6SV 1.1) with the law of Malkmus (1967, J. Opt. Soc. Am. 57,
323),

    -ln T = (2 k / c) (sqrt(1 + c x) - 1),    x the amount along the way.

Against runs of 6SV 1.1 with Sentinel-2A's own responses (water vapour 1.4 and 4 g cm-2, Sun at 30 and 60 degrees)
water vapour and mixed gases are within 0.002 in all window bands; in B08 the shape instead of the response adds up to
0.010; B09 is off by 0.008 of 0.1 to 0.3.  Ozone departs from 6S on purpose: its Chappuis band is that of Brion et al.
1998, 8 % deeper at 560 nm (0.006 to 0.008 in B03) and not cut off beyond 750 nm (0.005 in B07).

What that is worth: the lines behind the band model date from the 1980s, the mixing ratio of CO2 too (0.003 in the
bands at 1.6 um), and a water column is seldom known to better than 10 %, which is 0.003 to 0.005 in B08.  Pressure
scales the amount of the mixed gases, not the width of their lines.  Within strong bands the ground is nearly out of
sight: of the light at 945 nm a third remains, and a tenth more water takes 6 % of that; such a band measures the
water rather than the ground.  At 1375 nm less than a percent remains: a cirrus band sees what floats above the
vapour, and no ground reflectance can be had from it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.dehaze.passband import Band
from skyscatter.errors import DomainError
from skyscatter.optics.absorption import DOBSON_UNIT, cross_section

Array = NDArray[np.float64]

STANDARD_PRESSURE = 1013.25  #: [hPa]
LARGEST_ZENITH = 85.0  #: of Sun and view [degrees]

_EARTH_RADIUS = 6371.0  # [km]
#: Heights [km] of the absorbers: exponential ones by their scale height, ozone by the middle and width of its layer.
_WATER_SCALE, _AIR_SCALE = 2.0, 8.0
_OZONE_MIDDLE, _OZONE_WIDTH = 22.0, 5.0
_OZONE_TEMPERATURE, _NO2_TEMPERATURE = 228.0, 250.0  # effective ones [K]


class GasTransmittance(NamedTuple):
    """Two-way transmittances of a band; each of the shape of the angles."""

    ozone: Array
    other: Array  #: mixed gases and NO2
    water: Array
    water_half: Array  #: of half the water-vapour column; not a factor of `total`

    @property
    def total(self) -> Array:
        """Transmittance of all gases together."""
        return self.ozone * self.other * self.water


def gas_transmittance(
    band: Band,
    sun_zenith: ArrayLike,
    view_zenith: ArrayLike,
    *,
    ozone_du: float = 300.0,
    water_vapour: float = 1.5,
    pressure_hpa: float = STANDARD_PRESSURE,
    no2_du: float = 0.0,
) -> GasTransmittance:
    """Mean transmittance of a band from the Sun to the ground and up to a sensor above the atmosphere.

    Parameters
    ----------
    band : Band
    sun_zenith, view_zenith : array_like
        Zenith angles at the ground [degrees], 0 to 85, broadcast against each other.
    ozone_du : float
        Vertical ozone column [Dobson units].
    water_vapour : float
        Vertical water-vapour column above the ground [g cm-2].
    pressure_hpa : float
        At the ground [hPa]; scales the mixed gases.
    no2_du : float
        Vertical NO2 column [Dobson units]; clean air has about 0.1, cities up to 1.

    Returns
    -------
    GasTransmittance

    Raises
    ------
    DomainError
        For an angle or an amount out of range.
    """
    for name, value, low, high in (
        ("ozone_du", ozone_du, 0.0, 1000.0),
        ("water_vapour", water_vapour, 0.0, 10.0),
        ("pressure_hpa", pressure_hpa, 0.0, 1100.0),
        ("no2_du", no2_du, 0.0, 10.0),
    ):
        if not low <= value <= high:
            raise DomainError(name, value, f"between {low:g} and {high:g}")
    sun, view = (_checked(name, z) for name, z in (("sun_zenith", sun_zenith), ("view_zenith", view_zenith)))
    ozone, water, air = (f(sun) + f(view) for f in (ozone_air_mass, water_air_mass, mixed_air_mass))
    wl, shares = band.samples()
    row, spectra = _rows(wl), read_table("gas_bands.csv")
    t_ozone = np.exp(-_depth("o3", wl, ozone_du, _OZONE_TEMPERATURE) * ozone[..., None])
    t_other = np.exp(-_depth("no2", wl, no2_du, _NO2_TEMPERATURE) * air[..., None])
    t_other *= _malkmus(spectra["mixed_k"], spectra["mixed_c"], row, air * pressure_hpa / STANDARD_PRESSURE)
    t_water, t_half = (
        _malkmus(spectra["water_k"], spectra["water_c"], row, share * water_vapour * water) for share in (1.0, 0.5)
    )
    first = t_ozone @ shares
    second = (t_ozone * t_other) @ shares
    third, half = ((t_ozone * t_other * t) @ shares for t in (t_water, t_half))
    return GasTransmittance(first, second / first, third / second, half / second)


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
    row, spectra = _rows(np.atleast_1d(np.asarray(wavelengths_nm, float))), read_table("gas_bands.csv")
    gases = _malkmus(spectra["mixed_k"], spectra["mixed_c"], row, np.asarray(mixed, float))
    return gases * _malkmus(spectra["water_k"], spectra["water_c"], row, np.asarray(water, float))


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
    sine = np.sin(np.radians(_checked("zenith", zenith)))[..., None]
    return np.asarray(1.0 / np.sqrt(1.0 - (sine / (1.0 + heights_km / _EARTH_RADIUS)) ** 2) @ (weights / weights.sum()))


def _checked(name: str, zenith: ArrayLike) -> Array:
    z = np.asarray(zenith, dtype=float)
    if not np.all((z >= 0.0) & (z <= LARGEST_ZENITH)):
        raise DomainError(name, zenith, f"angles from 0 to {LARGEST_ZENITH:g} degrees")
    return z


def _depth(species: str, wl: Array, column_du: float, temperature: float) -> Array:
    """Vertical optical depth of a gas with a cross section."""
    if column_du == 0.0:
        return np.zeros_like(wl)
    return cross_section(species, wl, temperature) * column_du * DOBSON_UNIT


def _rows(wl: Array) -> Array:
    """Row of the interval that holds each wavelength, -1 outside the table."""
    wavenumber = 1e7 / read_table("gas_bands.csv")["wavelength_nm"]  # descending, centres of equal intervals
    step = float(wavenumber[0] - wavenumber[-1]) / (wavenumber.size - 1)
    row = np.floor((wavenumber[0] - 1e7 / wl) / step + 0.5).astype(int)
    return np.where((row >= 0) & (row < wavenumber.size), row, -1)


def _malkmus(k: Array, c: Array, row: Array, amount: Array) -> Array:
    """Transmittance of each sample, shape of `amount` and (sample,); 1 outside the table."""
    k_here, c_here = (np.append(column, 0.0)[row] for column in (k, c))
    x = np.asarray(amount)[..., None]
    # 2 (sqrt(1 + c x) - 1) / c, without the loss of digits, and x where c is 0.
    return np.exp(-2.0 * k_here * x / (1.0 + np.sqrt(1.0 + c_here * x)))
