"""What gases take from a band's light on its way from the Sun to the ground and up to the sensor.

    T_gas = T_ozone T_other T_water

Ozone lies above nearly all that scatters, so that its factor multiplies everything the sensor sees, the path
reflectance too; so, near enough, does that of the mixed gases (O2, CO2, CH4, N2O, CO).  Water vapour lies in and below
the haze: its factor belongs to the light from the ground; air scatters mostly above it, and what aerosols scatter has
crossed about half of it, for which there is `GasTransmittance.water_half` (as 6S does: Vermote et al. 1997, IEEE Trans.
Geosci. Remote Sensing 35, 675).

Each factor is the mean over response times solar irradiance, taken one after the other, so that their product is the
mean of the product.  Ozone and NO2 come from their cross sections; water vapour and the mixed gases from the band model
of `optics.gasbands`.

Against runs of 6SV 1.1 with Sentinel-2A's own responses (water vapour 1.4 and 4 g cm-2, Sun at 30 and 60 degrees)
water vapour and mixed gases are within 0.002 in all window bands; in B08 the shape instead of the response adds up to
0.010; B09 is off by 0.008 of 0.1 to 0.3.  Ozone departs from 6S on purpose: its Chappuis band is that of Brion et al.
1998, 8 % deeper at 560 nm (0.006 to 0.008 in B03) and not cut off beyond 750 nm (0.005 in B07).

What that is worth: a water column is seldom known to better than 10 %, which is 0.003 to 0.005 in B08.  Pressure
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
from skyscatter.optics.gasbands import (
    STANDARD_PRESSURE,
    checked_zenith,
    malkmus,
    mixed_air_mass,
    ozone_air_mass,
    table_rows,
    water_air_mass,
)

Array = NDArray[np.float64]

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
    sun, view = (checked_zenith(name, z) for name, z in (("sun_zenith", sun_zenith), ("view_zenith", view_zenith)))
    ozone, water, air = (f(sun) + f(view) for f in (ozone_air_mass, water_air_mass, mixed_air_mass))
    wl, shares = band.samples()
    row, spectra = table_rows(wl), read_table("gas_bands.csv")
    t_ozone = np.exp(-_depth("o3", wl, ozone_du, _OZONE_TEMPERATURE) * ozone[..., None])
    t_other = np.exp(-_depth("no2", wl, no2_du, _NO2_TEMPERATURE) * air[..., None])
    t_other *= malkmus(spectra["mixed_k"], spectra["mixed_c"], row, air * pressure_hpa / STANDARD_PRESSURE)
    t_water, t_half = (
        malkmus(spectra["water_k"], spectra["water_c"], row, share * water_vapour * water) for share in (1.0, 0.5)
    )
    first = t_ozone @ shares
    second = (t_ozone * t_other) @ shares
    third, half = ((t_ozone * t_other * t) @ shares for t in (t_water, t_half))
    return GasTransmittance(first, second / first, third / second, half / second)


def _depth(species: str, wl: Array, column_du: float, temperature: float) -> Array:
    """Vertical optical depth of a gas with a cross section."""
    if column_du == 0.0:
        return np.zeros_like(wl)
    return cross_section(species, wl, temperature) * column_du * DOBSON_UNIT
