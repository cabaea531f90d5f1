"""Optics by looks: the colour of a thick piece of the substance, and how far light gets in it.

The colour is the diffuse albedo A of a half space of the medium under diffuse light, without a refracting surface.  Van
de Hulst (1980, Multiple Light Scattering, vol. 2, section 14.1) found it to depend on the single-scattering albedo
omega and the asymmetry g through the similarity parameter gamma alone, as nearly as (docs/theory/surfaces-scene.md)

    gamma = sqrt((1 - omega) / (1 - g omega)),     A = (1 - gamma) (1 - 0.139 gamma) / (1 + 1.17 gamma).      (65)

Solved for gamma this is the inversion of Kulla & Conty Estevez (2017), Revisiting Physically Based Shading at
Imageworks, SIGGRAPH course notes, which artists use:

    gamma = 4.09712 + 4.20863 A - sqrt(9.59217 + 41.6808 A + 17.7126 A^2),                                    (66)
    omega = (1 - gamma^2) / (1 - g gamma^2).                                                                  (67)

Its colour is met to 0.0021 for isotropic scattering (against the H function).  The fit to Monte Carlo of Chiang, Kutz &
Burley (2016, SIGGRAPH talks, Practical and Controllable Subsurface Scattering for Production Path Tracing) agrees with
it within 0.006 up to an albedo of 0.8 and ends at 0.93 where white is asked for.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.spectra.surfaces import check_albedo, spectrum_of
from skyscatter.spectra.table import Albedo, SpectralLength, evaluate
from skyscatter.units import Number, default

Array = NDArray[np.float64]

#: Coefficients of van de Hulst's formula (65).
_B, _C = 0.139, 1.17


def diffuse_albedo(single_scattering_albedo: ArrayLike, g: ArrayLike = 0.0) -> Array:
    """Albedo of a half space under diffuse light by (65), from 0 to 1; shape of the inputs."""
    omega, g = np.asarray(single_scattering_albedo, float), np.asarray(g, float)
    gamma = np.sqrt((1 - omega) / (1 - g * omega))
    albedo: Array = (1 - gamma) * (1 - _B * gamma) / (1 + _C * gamma)
    return albedo


def single_scattering_albedo(diffuse: ArrayLike, g: ArrayLike = 0.0) -> Array:
    """The single-scattering albedo of which a half space has this albedo, by (66) and (67); shape of the inputs."""
    a, g = np.asarray(diffuse, float), np.asarray(g, float)
    # The smaller root of B gamma^2 - (1 + B + C A) gamma + 1 - A, written without differences of like numbers.
    half = 0.5 * (1 + _B + _C * a)
    gamma = (1 - a) / (half + np.sqrt(half**2 - _B * (1 - a)))
    omega: Array = (1 - gamma**2) / (1 - g * gamma**2)
    return omega


class ArtistMedium(OpticalModel):
    """A substance by its colour and the mean distance between its scatterers; see the module for the equations.

    Parameters
    ----------
    colour : float or SpectralTable or str
        Albedo, 0 to 1, of a thick piece of it under diffuse light; or the name of a surface of the shipped table.  A
        dielectric surface around it makes it darker.
    distance : length, or SpectralTable [m]
        Mean free path of light where the density is 1: 1 / (sigma_s + sigma_a).
    g : float
        Asymmetry of its Henyey-Greenstein phase function, above -1 and below 1.
    """

    kind: Literal["artist"] = "artist"
    colour: Albedo
    distance: SpectralLength
    g: Number = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> ArtistMedium:
        check_albedo(self.colour)
        if not -1 < self.g < 1:
            raise DomainError("g", self.g, "lies above -1 and below 1")
        return self

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`."""
        omega = single_scattering_albedo(spectrum_of(self.colour, wavelengths_nm), self.g)
        extinction = 1 / evaluate(self.distance, wavelengths_nm)
        return Coefficients(omega * extinction, (1 - omega) * extinction, np.zeros_like(omega))

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        """Henyey-Greenstein's, or isotropic."""
        from skyscatter.optics.phase import HenyeyGreenstein, Isotropic

        return HenyeyGreenstein(g=self.g) if self.g else Isotropic()
