"""The two contracts of optics: what one unit of density does to light, and where it sends it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.record import Record

Array = NDArray[np.float64]


class Coefficients(NamedTuple):
    """What one unit of (dimensionless) density does, per wavelength; each of shape (wavelength,)."""

    scattering: Array  #: [m-1]
    absorption: Array  #: [m-1]
    emission: Array  #: [W m-3 sr-1 nm-1]


class PhaseFunction(Record):
    """Distribution of the scattering angle; integrates to 1 over the sphere; forward is ``cos_theta = +1``."""

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        raise NotImplementedError

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter, shape (wavelength,)."""
        raise NotImplementedError

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines of scattering angles drawn by `value` from uniform numbers `u` in [0, 1); shape of `u`."""
        raise NotImplementedError

    def pdf(self, cos_theta: ArrayLike, wavelength_nm: float) -> Array:
        """Density per solid angle [sr-1] with which `sample` draws; equals `value` where sampling is exact."""
        return self.value(cos_theta, [wavelength_nm])[:, 0]


class OpticalModel(Record):
    """Scattering, absorption, emission and phase function of one component, as functions of wavelength."""

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density.

        Parameters
        ----------
        wavelengths_nm : array_like, shape (wavelength,)
            Vacuum wavelengths [nm].
        column_m : float
            Vertical column of the component's density field above the ground [m]; a model given by its optical
            depth divides by it.
        """
        raise NotImplementedError

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        """The phase function of the light scattered by this component (isotropic for pure absorbers)."""
        raise NotImplementedError
