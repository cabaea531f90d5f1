"""The two contracts of optics: what one unit of density does to light, and where it sends it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.record import Record
from skyscatter.registry import contract

Array = NDArray[np.float64]


class Coefficients(NamedTuple):
    """What one unit of (dimensionless) density does, per wavelength; each of shape (wavelength,)."""

    scattering: Array  #: [m-1]
    absorption: Array  #: [m-1]
    emission: Array  #: [W m-3 sr-1 nm-1]


@contract
class PhaseFunction(Record):
    """Distribution of the scattering angle; integrates to 1 over the sphere; forward is ``cos_theta = +1``."""

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        raise NotImplementedError

    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Elements a1, a2, a3, a4, b1, b2 of the scattering matrix [sr-1], shape (6, angle, wavelength).

        With the Stokes vector (I, Q, U, V) referred to the scattering plane the matrix of a mirror-symmetric medium is

            [[a1, b1, 0, 0], [b1, a2, 0, 0], [0, 0, a3, b2], [0, 0, -b2, a4]]

        (van de Hulst 1957, Light Scattering by Small Particles, section 5.22), a1 being `value`.  A phase function that
        knows nothing of polarisation makes none (b1 = b2 = 0), keeps it in forward scattering and treats it as symmetry
        demands in backward scattering: a2 = a1 (1 + mu^2) / 2, a3 = a4 = a1 mu, which for the dipole's a1 is exact.
        """
        mu = np.atleast_1d(np.asarray(cos_theta, float))[:, None]
        a1 = self.value(cos_theta, wavelengths_nm)
        zero = np.zeros_like(a1)
        return np.stack([a1, 0.5 * a1 * (1 + mu * mu), a1 * mu, a1 * mu, zero, zero])

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter, shape (wavelength,)."""
        raise NotImplementedError

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines of scattering angles drawn by `value` from uniform numbers `u` in [0, 1); shape of `u`."""
        raise NotImplementedError

    def pdf(self, cos_theta: ArrayLike, wavelength_nm: float) -> Array:
        """Density per solid angle [sr-1] with which `sample` draws; equals `value` where sampling is exact."""
        return self.value(cos_theta, [wavelength_nm])[:, 0]


@contract
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
