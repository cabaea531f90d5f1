"""Phase functions.

Every closed form here is a member of one family, Draine (2003), ApJ 598, 1017,

    p(mu) = (1 - g^2) / (4 pi N) * (1 + alpha mu^2) / (1 + g^2 - 2 g mu)^(3/2),   N = 1 + alpha (1 + 2 g^2) / 3,

with mu the cosine of the scattering angle (forward = +1).  Henyey-Greenstein is alpha = 0, Cornette-Shanks is
alpha = 1, (depolarised) Rayleigh is g = 0, isotropic is both nought.  So there is one value, one mean cosine and one
sampler; the named classes only say which parameters they mean.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.optics.base import Array, PhaseFunction
from skyscatter.spectra.table import Spectral, bounds, evaluate

#: Below this |g| the antiderivative of the Draine family loses digits, and quadrature is exact to rounding.
_SMALL_G = 0.1
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(24)


def draine_value(mu: ArrayLike, g: ArrayLike, alpha: ArrayLike) -> Array:
    """Phase function [sr-1] of Draine (2003), ApJ 598, 1017; the arguments broadcast."""
    mu, g, alpha = np.asarray(mu, float), np.asarray(g, float), np.asarray(alpha, float)
    norm = 4 * np.pi * (1 + alpha * (1 + 2 * g * g) / 3)
    value: Array = (1 - g * g) / norm * (1 + alpha * mu * mu) / (1 + g * g - 2 * g * mu) ** 1.5
    return value


def draine_mean_cosine(g: ArrayLike, alpha: ArrayLike) -> Array:
    """Mean cosine of Draine (2003), ApJ 598, 1017."""
    g, alpha = np.asarray(g, float), np.asarray(alpha, float)
    mean: Array = g * (1 + alpha * (3 + 2 * g * g) / 5) / (1 + alpha * (1 + 2 * g * g) / 3)
    return mean


def _draine_cdf(mu: Array, g: float, alpha: float) -> Array:
    """Probability of a cosine below `mu`."""
    if abs(g) < _SMALL_G:
        half = 0.5 * (mu + 1)[:, None]
        nodes = half * (_GAUSS_X + 1) - 1
        cdf: Array = 2 * np.pi * np.sum(half * _GAUSS_W * draine_value(nodes, g, alpha), axis=1)
        return cdf
    a = 1 + g * g

    def antiderivative(s: Any) -> Any:
        return -1 / s + alpha / (4 * g * g) * (-a * a / s - 2 * a * s + s**3 / 3)

    norm = (1 - g * g) / (2 * (1 + alpha * (1 + 2 * g * g) / 3))
    s = np.sqrt(a - 2 * g * mu)
    # mu = (1 + g^2 - s^2) / 2g turns the integral over mu into one over s, with d mu = -s ds / g.
    return -norm / g * (antiderivative(s) - antiderivative(1 + g))


class _DraineFamily(PhaseFunction):
    """Shared arithmetic; a member says its g and alpha per wavelength."""

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        raise NotImplementedError

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        g, alpha = self._parameters(wavelengths_nm)
        return draine_value(np.atleast_1d(np.asarray(cos_theta, float))[:, None], g, alpha)

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter, shape (wavelength,)."""
        return draine_mean_cosine(*self._parameters(wavelengths_nm))

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines drawn by `value`: the distribution function inverted by bisection to the last bit."""
        g, alpha = (float(p[0]) for p in self._parameters([wavelength_nm]))
        u = np.asarray(u, float)
        low, high = np.full(u.shape, -1.0).ravel(), np.full(u.shape, 1.0).ravel()
        for _ in range(54):  # each step is one bit of the result
            middle = 0.5 * (low + high)
            below = _draine_cdf(middle, g, alpha) < u.ravel()
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return (0.5 * (low + high)).reshape(u.shape)


def _check_g(name: str, g: Any) -> None:
    low, high = bounds(g)
    if low <= -1 or high >= 1:
        raise DomainError(name, low if low <= -1 else high, "the mean cosine lies between -1 and 1, ends excluded")


class Isotropic(_DraineFamily):
    """Scattering into all directions alike, p = 1 / (4 pi)."""

    kind: Literal["isotropic"] = "isotropic"

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        zero = np.zeros(np.size(wavelengths_nm))
        return zero, zero


class Rayleigh(_DraineFamily):
    """Rayleigh scattering, p = 3 / (16 pi (1 + 2 gamma)) [1 + 3 gamma + (1 - gamma) mu^2], gamma = rho / (2 - rho).

    Chandrasekhar (1950), chapter I, eq. 255, as written by Bucholtz (1995), eqs. 12 and 13.

    Parameters
    ----------
    depolarisation : float or SpectralTable
        Depolarisation factor rho of unpolarised light; 0 gives the dipole 3 / (16 pi) (1 + mu^2), air has about 0.028.
    """

    kind: Literal["rayleigh"] = "rayleigh"
    depolarisation: Spectral = 0.0

    @model_validator(mode="after")
    def _check(self) -> Rayleigh:
        low, high = bounds(self.depolarisation)
        if low < 0 or high >= 1:
            raise DomainError("depolarisation", self.depolarisation, "between 0 and 1")
        return self

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        rho = evaluate(self.depolarisation, wavelengths_nm)
        gamma = rho / (2 - rho)
        return np.zeros_like(gamma), (1 - gamma) / (1 + 3 * gamma)


class HenyeyGreenstein(_DraineFamily):
    """Henyey & Greenstein (1941), ApJ 93, 70: one parameter, the mean cosine `g`."""

    kind: Literal["henyey-greenstein"] = "henyey-greenstein"
    g: Spectral

    @model_validator(mode="after")
    def _check(self) -> HenyeyGreenstein:
        _check_g("g", self.g)
        return self

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        g = evaluate(self.g, wavelengths_nm)
        return g, np.zeros_like(g)


class CornetteShanks(_DraineFamily):
    """Cornette & Shanks (1992), Appl. Opt. 31, 3152, eq. 8: Henyey-Greenstein with the dipole's (1 + mu^2).

    `g` is the parameter of that equation; the mean cosine is somewhat larger (their eq. 9).
    """

    kind: Literal["cornette-shanks"] = "cornette-shanks"
    g: Spectral

    @model_validator(mode="after")
    def _check(self) -> CornetteShanks:
        _check_g("g", self.g)
        return self

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        g = evaluate(self.g, wavelengths_nm)
        return g, np.ones_like(g)


class Draine(_DraineFamily):
    """Draine (2003), ApJ 598, 1017: between Henyey-Greenstein (alpha 0) and Cornette-Shanks (alpha 1)."""

    kind: Literal["draine"] = "draine"
    g: Spectral
    alpha: Spectral = 1.0

    @model_validator(mode="after")
    def _check(self) -> Draine:
        _check_g("g", self.g)
        if bounds(self.alpha)[0] < -1:
            raise DomainError("alpha", self.alpha, "at least -1, or the phase function turns negative")
        return self

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        return evaluate(self.g, wavelengths_nm), evaluate(self.alpha, wavelengths_nm)


class DoubleHenyeyGreenstein(PhaseFunction):
    """A forward and a backward Henyey-Greenstein lobe: ``forward_fraction`` of `g_forward`, the rest of `g_backward`.

    Kattawar (1975), J. Quant. Spectrosc. Radiat. Transfer 15, 839, eq. 2.
    """

    kind: Literal["double-henyey-greenstein"] = "double-henyey-greenstein"
    g_forward: Spectral
    g_backward: Spectral
    forward_fraction: Spectral

    @model_validator(mode="after")
    def _check(self) -> DoubleHenyeyGreenstein:
        _check_g("g_forward", self.g_forward)
        _check_g("g_backward", self.g_backward)
        low, high = bounds(self.forward_fraction)
        if low < 0 or high > 1:
            raise DomainError("forward_fraction", self.forward_fraction, "between 0 and 1")
        return self

    def _lobes(self) -> tuple[HenyeyGreenstein, HenyeyGreenstein]:
        return HenyeyGreenstein(g=self.g_forward), HenyeyGreenstein(g=self.g_backward)

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        f = evaluate(self.forward_fraction, wavelengths_nm)
        forward, backward = (lobe.value(cos_theta, wavelengths_nm) for lobe in self._lobes())
        return f * forward + (1 - f) * backward

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter, shape (wavelength,)."""
        f = evaluate(self.forward_fraction, wavelengths_nm)
        forward, backward = (lobe.mean_cosine(wavelengths_nm) for lobe in self._lobes())
        return f * forward + (1 - f) * backward

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines drawn by `value`: `u` chooses the lobe and, stretched back to [0, 1), the angle within it."""
        u = np.asarray(u, float)
        f = float(evaluate(self.forward_fraction, [wavelength_nm])[0])
        forward, backward = self._lobes()
        in_forward = u < f
        stretched = np.where(in_forward, u / max(f, 1e-300), (u - f) / max(1 - f, 1e-300))
        return np.where(in_forward, forward.sample(stretched, wavelength_nm), backward.sample(stretched, wavelength_nm))


class TabulatedPhase(PhaseFunction):
    """Phase function as a table, linear in the cosine and in wavelength (constant beyond the end wavelengths).

    Parameters
    ----------
    cos_theta : tuple of float, shape (angle,)
        Rising from -1 to 1, ends included.
    wavelengths : tuple of float, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    values : tuple of tuple of float, shape (angle, wavelength)
        Proportional to the phase function; normalised on reading.
    """

    kind: Literal["phase-table"] = "phase-table"
    cos_theta: tuple[float, ...]
    wavelengths: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _check(self) -> TabulatedPhase:
        mu = np.asarray(self.cos_theta)
        if mu.size < 2 or mu[0] != -1 or mu[-1] != 1 or np.any(np.diff(mu) <= 0):
            raise DomainError("cos_theta", (mu[0], mu[-1]) if mu.size else (), "must rise from -1 to 1, ends included")
        if np.any(np.diff(self.wavelengths) <= 0):
            raise DomainError("wavelengths", self.wavelengths, "must increase")
        if len(self.values) != mu.size or any(len(row) != len(self.wavelengths) for row in self.values):
            raise DomainError("values", f"{len(self.values)} rows", "one row an angle, one number a wavelength")
        if np.min(np.asarray(self.values)) < 0 or np.any(np.max(np.asarray(self.values), axis=0) <= 0):
            raise DomainError("values", float(np.min(np.asarray(self.values))), "a phase function is never negative")
        return self

    def _table(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        """Nodes and normalised values at the asked wavelengths, shapes (angle,) and (angle, wavelength)."""
        mu, values = np.asarray(self.cos_theta), normalise(np.asarray(self.cos_theta), np.asarray(self.values))
        wl = np.clip(np.atleast_1d(np.asarray(wavelengths_nm, float)), self.wavelengths[0], self.wavelengths[-1])
        if len(self.wavelengths) == 1:
            return mu, np.repeat(values, wl.size, axis=1)
        i = np.clip(np.searchsorted(self.wavelengths, wl) - 1, 0, len(self.wavelengths) - 2)
        nodes = np.asarray(self.wavelengths)
        w = (wl - nodes[i]) / (nodes[i + 1] - nodes[i])
        return mu, values[:, i] * (1 - w) + values[:, i + 1] * w

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        nodes, table = self._table(wavelengths_nm)
        mu = np.atleast_1d(np.asarray(cos_theta, float))
        i = np.clip(np.searchsorted(nodes, mu) - 1, 0, nodes.size - 2)
        w = ((mu - nodes[i]) / (nodes[i + 1] - nodes[i]))[:, None]
        value: Array = table[i] * (1 - w) + table[i + 1] * w
        return value

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter of the linear interpolant (exact), shape (wavelength,)."""
        mu, table = self._table(wavelengths_nm)
        width, low, high = np.diff(mu)[:, None], mu[:-1, None], mu[1:, None]
        moment = width / 6 * (table[:-1] * (2 * low + high) + table[1:] * (low + 2 * high))
        mean: Array = 2 * np.pi * np.sum(moment, axis=0)
        return mean

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines drawn exactly by the linear interpolant: a cell by the distribution function, then a quadratic."""
        mu, table = self._table([wavelength_nm])
        p = 2 * np.pi * table[:, 0]
        cdf = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(mu) * (p[:-1] + p[1:]))])
        u = np.asarray(u, float) * cdf[-1]
        i = np.clip(np.searchsorted(cdf, u, side="right") - 1, 0, mu.size - 2)
        slope = (p[i + 1] - p[i]) / (mu[i + 1] - mu[i])
        rest = u - cdf[i]
        root = np.sqrt(np.maximum(p[i] ** 2 + 2 * slope * rest, 0))
        # The stable root of slope/2 x^2 + p x = rest, right for slope 0 too.
        step = 2 * rest / np.maximum(p[i] + root, 1e-300)
        cosines: Array = np.minimum(mu[i] + step, mu[i + 1])
        return cosines


def normalise(cos_theta: Array, values: Array) -> Array:
    """Scale `values` (angle, ...) so that their linear interpolant integrates to 1 over the sphere."""
    integral = 2 * np.pi * np.trapezoid(values, cos_theta, axis=0)
    scaled: Array = values / integral
    return scaled


AnyPhase = Annotated[
    Isotropic | Rayleigh | HenyeyGreenstein | DoubleHenyeyGreenstein | CornetteShanks | Draine | TabulatedPhase,
    Field(discriminator="kind"),
]

__all__ = [
    "AnyPhase",
    "CornetteShanks",
    "DoubleHenyeyGreenstein",
    "Draine",
    "HenyeyGreenstein",
    "Isotropic",
    "Rayleigh",
    "TabulatedPhase",
    "draine_mean_cosine",
    "draine_value",
    "normalise",
]
