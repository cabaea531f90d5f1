"""Particles described by numbers rather than by their size: extinction, albedo and a phase function."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.optics.phase import AnyPhase
from skyscatter.spectra.table import OptionalSpectral, SpectralExtinction, SpectralNonNegative, SpectralShare, evaluate
from skyscatter.units import PositiveNanometres, default


class Particles(OpticalModel):
    """Extinction by optical depth or coefficient, its Angstrom law, a single-scattering albedo and a phase function.

    sigma_t(lambda) = sigma_t(wavelength) (lambda / wavelength)^(-angstrom_exponent)  (Angstrom 1929); a table over
    wavelength instead of a number has no exponent beside it.

    Parameters
    ----------
    optical_depth : float or SpectralTable, optional
        Vertical optical depth of the component.  Give this or `extinction`.
    extinction : float or SpectralTable, optional
        Extinction coefficient where the density is 1 [m-1].
    wavelength : length
        Where a number is meant [nm].
    angstrom_exponent : float
        Exponent of the law; 0 is grey.
    single_scattering_albedo : float or SpectralTable
        Scattered part of the extinction, 0 to 1.
    phase : phase function
        Where the light goes, by kind.

    Examples
    --------
    Haze of an optical depth of 0.2 at 550 nm, and of more in the blue, here with a reference column of 2 km.

    >>> import skyscatter
    >>> haze = skyscatter.Particles(
    ...     optical_depth=0.2, angstrom_exponent=1.3, phase={"kind": "henyey-greenstein", "g": 0.7}
    ... )
    >>> scattering, absorption, _ = haze.coefficients([450, 550, 650], column_m=2000.0)  # m-1 where the density is 1
    >>> (2000.0 * (scattering + absorption)).round(3)
    array([0.26 , 0.2  , 0.161])
    """

    kind: Literal["particles"] = "particles"
    optical_depth: OptionalSpectral[SpectralNonNegative] = default(None)
    extinction: OptionalSpectral[SpectralExtinction] = default(None)
    wavelength: PositiveNanometres = default(550.0)
    angstrom_exponent: float = 0.0
    single_scattering_albedo: SpectralShare = default(1.0)
    phase: AnyPhase

    @model_validator(mode="after")
    def _check(self) -> Particles:
        if (self.optical_depth is None) == (self.extinction is None):
            raise DomainError("optical_depth", self.optical_depth, "give exactly one of optical_depth and extinction")
        amount = self.extinction if self.optical_depth is None else self.optical_depth
        if self.angstrom_exponent != 0 and not isinstance(amount, (int, float)):
            raise DomainError(
                "angstrom_exponent", self.angstrom_exponent, "a table over wavelength has it; leave it out"
            )
        return self

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`."""
        wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
        if self.optical_depth is not None:
            extinction = evaluate(self.optical_depth, wl) / column_m
        else:
            extinction = evaluate(self.extinction, wl)
        extinction = extinction * (wl / self.wavelength) ** -self.angstrom_exponent
        albedo = evaluate(self.single_scattering_albedo, wl)
        return Coefficients(extinction * albedo, extinction * (1 - albedo), np.zeros_like(wl))

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        """The phase function as given."""
        return self.phase
