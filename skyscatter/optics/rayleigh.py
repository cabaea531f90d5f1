"""Scattering by molecules."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errors import DomainError
from skyscatter.optics.base import Array, Coefficients, OpticalModel
from skyscatter.optics.phase import Rayleigh
from skyscatter.spectra.table import SpectralTable
from skyscatter.units import Coefficient, Number, NumberDensity, PartsPerMillion, PositiveNanometres, default

#: Number density of air at 288.15 K and 1013.25 hPa [m-3], as Bodhaine et al. (1999) use it.
STANDARD_NUMBER_DENSITY = 2.546899e25


class RayleighPowerLaw(OpticalModel):
    """Rayleigh scattering as the plain law sigma_s = coefficient (wavelength / lambda)^4.

    Parameters
    ----------
    coefficient : float
        Scattering coefficient at `wavelength` for density 1 [m-1].
    wavelength : length
        Vacuum wavelength of the coefficient [nm].
    depolarisation : float
        Depolarisation factor of the phase function.
    """

    kind: Literal["rayleigh"] = "rayleigh"
    coefficient: Coefficient
    wavelength: PositiveNanometres = default(550.0)
    depolarisation: Number = default(0.0)

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`."""
        wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
        zero = np.zeros_like(wl)
        return Coefficients(self.coefficient * (self.wavelength / wl) ** 4, zero, zero)

    def phase_function(self, wavelengths_nm: ArrayLike) -> Rayleigh:
        """Dipole scattering with the given depolarisation."""
        return Rayleigh(depolarisation=self.depolarisation)


def refractive_index_bodhaine1999(wavelength_um: ArrayLike, co2_ppm: float) -> Array:
    """Refractive index of dry air at 288.15 K, 1013.25 hPa: Bodhaine et al. (1999), eqs. 18 and 19."""
    s = np.asarray(wavelength_um, float) ** -2
    refractivity_300 = (8060.51 + 2480990 / (132.274 - s) + 17455.7 / (39.32957 - s)) * 1e-8
    index: Array = 1 + refractivity_300 * (1 + 0.54 * (co2_ppm * 1e-6 - 0.0003))
    return index


def king_factor_bodhaine1999(wavelength_um: ArrayLike, co2_ppm: float) -> Array:
    """King factor of air from its gases: Bodhaine et al. (1999), eqs. 5, 6 and 23 (after Bates 1984)."""
    s = np.asarray(wavelength_um, float) ** -2
    nitrogen = 1.034 + 3.17e-4 * s
    oxygen = 1.096 + 1.385e-3 * s + 1.448e-4 * s * s
    co2 = co2_ppm * 1e-4  # parts per hundred by volume, as the formula wants it
    total = 78.084 * nitrogen + 20.946 * oxygen + 0.934 * 1.0 + co2 * 1.15
    factor: Array = total / (78.084 + 20.946 + 0.934 + co2)
    return factor


def cross_section_bodhaine1999(wavelengths_nm: ArrayLike, co2_ppm: float = 420.0) -> Array:
    """Scattering cross section of a molecule of air [m2]: Bodhaine et al. (1999), J. Atmos. Ocean. Tech. 16, eq. 2."""
    wl_m = np.asarray(wavelengths_nm, float) * 1e-9
    n2 = refractive_index_bodhaine1999(wl_m * 1e6, co2_ppm) ** 2
    lorentz = (n2 - 1) / (n2 + 2)
    king = king_factor_bodhaine1999(wl_m * 1e6, co2_ppm)
    section: Array = 24 * np.pi**3 * lorentz**2 * king / (wl_m**4 * STANDARD_NUMBER_DENSITY**2)
    return section


class RayleighAir(OpticalModel):
    """Air after Bodhaine et al. (1999): dispersion, King factor, and the phase function that goes with it.

    Valid from 250 to 1000 nm and beyond: the refractive index is fitted from 230 to 1690 nm; to 2600 nm the formula is
    continued, where its dispersion changes the refractivity by less than 0.1 % and the optical depth is below 0.0015.

    Parameters
    ----------
    number_density : float
        Molecules per volume where the density field is 1 [m-3].
    co2_ppm : float
        Carbon dioxide by volume [ppm].
    """

    kind: Literal["rayleigh-air"] = "rayleigh-air"
    number_density: NumberDensity = default(STANDARD_NUMBER_DENSITY)
    co2_ppm: PartsPerMillion = default(420.0)

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`."""
        wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
        if wl.min() < 230 or wl.max() > 2600:
            outside = wl.min() if wl.min() < 230 else wl.max()
            raise DomainError("wavelength", float(outside), "rayleigh-air holds from 230 to 2600 nm")
        zero = np.zeros_like(wl)
        return Coefficients(self.number_density * cross_section_bodhaine1999(wl, self.co2_ppm), zero, zero)

    def phase_function(self, wavelengths_nm: ArrayLike) -> Rayleigh:
        """Depolarised Rayleigh; the King factor F = (6 + 3 rho) / (6 - 7 rho) gives rho."""
        wl = np.unique(np.asarray(wavelengths_nm, float))
        king = king_factor_bodhaine1999(wl * 1e-3, self.co2_ppm)
        rho = 6 * (king - 1) / (3 + 7 * king)
        return Rayleigh(depolarisation=SpectralTable(wavelengths=tuple(wl), values=tuple(rho)))
