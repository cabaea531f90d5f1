"""Phase functions.

Every closed form here is a member of one family, Draine (2003), ApJ 598, 1017,

    p(mu) = (1 - g^2) / (4 pi N) * (1 + alpha mu^2) / (1 + g^2 - 2 g mu)^(3/2),   N = 1 + alpha (1 + 2 g^2) / 3,

with mu the cosine of the scattering angle (forward = +1).  Henyey-Greenstein is alpha = 0, Cornette-Shanks is
alpha = 1, (depolarised) Rayleigh is g = 0, isotropic is both zero.  So there is one value, one mean cosine and one
sampler; the named classes only say which parameters they mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from skyscatter.errors import DomainError, UnitsError
from skyscatter.optics.base import Array, PhaseFunction
from skyscatter.registry import open_to
from skyscatter.spectra.table import SpectralNumber, SpectralShare, bounds, evaluate
from skyscatter.tablefile import TableRecord, Wanted, column_names, with_columns
from skyscatter.units import ANGLE, RELATIVE_AMOUNT, WAVELENGTH, Numbers, Wavelengths, default
from skyscatter.workers import steady_algebra

#: Wavelength of a table that holds for all [nm].
DESIGN_NM = 550.0
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

    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Scattering matrix (see `PhaseFunction.matrix`): all polarisation is lost, a1 alone differs from zero."""
        a1 = self.value(cos_theta, wavelengths_nm)
        elements = np.zeros((6, *a1.shape))
        elements[0] = a1
        return elements


class Rayleigh(_DraineFamily):
    """Rayleigh scattering, p = 3 / (16 pi (1 + 2 gamma)) [1 + 3 gamma + (1 - gamma) mu^2], gamma = rho / (2 - rho).

    Chandrasekhar (1950), chapter I, eq. 255, as written by Bucholtz (1995), eqs. 12 and 13.

    Parameters
    ----------
    depolarisation : float or SpectralTable
        Depolarisation factor rho of unpolarised light; 0 gives the dipole 3 / (16 pi) (1 + mu^2), air has about 0.028.
    """

    kind: Literal["rayleigh"] = "rayleigh"
    depolarisation: SpectralNumber = default(0.0)

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

    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Scattering matrix, see `PhaseFunction.matrix`: Hansen & Travis (1974), Space Sci. Rev. 16, 527, eq. 2.15.

        A share Delta = (1 - rho) / (1 + rho / 2) is a dipole's, the rest isotropic and unpolarised.
        """
        rho = evaluate(self.depolarisation, wavelengths_nm)
        delta, circular = (1 - rho) / (1 + 0.5 * rho), (1 - 2 * rho) / (1 + 0.5 * rho)
        mu = np.atleast_1d(np.asarray(cos_theta, float))[:, None]
        dipole = 3 / (16 * np.pi)
        a2 = dipole * delta * (1 + mu * mu)
        return np.stack([
            self.value(cos_theta, wavelengths_nm), a2, 2 * dipole * delta * mu, 2 * dipole * circular * mu,
            dipole * delta * (mu * mu - 1), np.zeros_like(a2),
        ])  # fmt: skip


class HenyeyGreenstein(_DraineFamily):
    """Henyey & Greenstein (1941), ApJ 93, 70: one parameter, the mean cosine `g`.

    Parameters
    ----------
    g : float or SpectralTable
        Mean cosine, above -1 and below 1.
    """

    kind: Literal["henyey-greenstein"] = "henyey-greenstein"
    g: SpectralNumber

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

    Parameters
    ----------
    g : float or SpectralTable
        Parameter g, above -1 and below 1.
    """

    kind: Literal["cornette-shanks"] = "cornette-shanks"
    g: SpectralNumber

    @model_validator(mode="after")
    def _check(self) -> CornetteShanks:
        _check_g("g", self.g)
        return self

    def _parameters(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        g = evaluate(self.g, wavelengths_nm)
        return g, np.ones_like(g)


class Draine(_DraineFamily):
    """Draine (2003), ApJ 598, 1017: between Henyey-Greenstein (alpha 0) and Cornette-Shanks (alpha 1).

    Parameters
    ----------
    g : float or SpectralTable
        Parameter g, above -1 and below 1.
    alpha : float or SpectralTable
        Weight of mu^2, at least -1.
    """

    kind: Literal["draine"] = "draine"
    g: SpectralNumber
    alpha: SpectralNumber = default(1.0)

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

    Parameters
    ----------
    g_forward, g_backward : float or SpectralTable
        Mean cosines of the lobes, above -1 and below 1.
    forward_fraction : float or SpectralTable
        Share of the forward lobe.
    """

    kind: Literal["double-henyey-greenstein"] = "double-henyey-greenstein"
    g_forward: SpectralNumber
    g_backward: SpectralNumber
    forward_fraction: SpectralShare

    @model_validator(mode="after")
    def _check(self) -> DoubleHenyeyGreenstein:
        _check_g("g_forward", self.g_forward)
        _check_g("g_backward", self.g_backward)
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


def _wavelength_columns(file: Any) -> dict[str, float]:
    """Columns of a file whose names are wavelengths with a unit, and these [nm], rising."""
    found = {}
    for name in column_names(file) if isinstance(file, (str, Path)) else ():
        if name[0].isdigit() and name[-1].isalpha():
            with suppress(UnitsError):
                found[name] = WAVELENGTH.read(name, "file")
    return dict(sorted(found.items(), key=lambda column: column[1]))


class TabulatedPhase(TableRecord, PhaseFunction):
    """Phase function as a table, linear in the cosine and in wavelength (constant beyond the end wavelengths).

    In a file there is a column of scattering angles from 0 to 180 degrees and one of values, for all wavelengths; or
    several, whose headers are the wavelengths: ``angle [deg],450 nm,550 nm``.

    Parameters
    ----------
    cos_theta : tuple of float, shape (angle,)
        Rising from -1 to 1, ends included.
    wavelengths : tuple of float, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    values : tuple of tuple of float, shape (angle, wavelength)
        Proportional to the phase function; normalised on reading.
    polarisation : five such tables, optional
        Elements a2, a3, a4, b1, b2 of the scattering matrix on the scale of `values` (which are a1); see `matrix`.
    file : str, optional
        CSV or netCDF file with the columns instead; in a model file the path counts from its folder.
    column : str, optional
        Which column of the file has the values, where there are several and their headers are no wavelengths.
    """

    columns: ClassVar[dict[str, Wanted]] = {
        "cos_theta": Wanted(("angle", "angles", "theta"), ANGLE.within(0.0, 180.0), rising=True),
        "wavelengths": Wanted((), WAVELENGTH),  # in the headers
        "values": Wanted(("value", "p", "p11"), RELATIVE_AMOUNT),
    }

    kind: Literal["phase-table"] = "phase-table"
    cos_theta: Numbers
    wavelengths: Wavelengths
    values: tuple[tuple[float, ...], ...]
    polarisation: tuple[tuple[tuple[float, ...], ...], ...] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.get("file", data.get("column")) is None:
            return data
        angle, value = cls.columns["cos_theta"], cls.columns["values"]
        of_wavelengths = {} if "column" in data else _wavelength_columns(data.get("file"))
        wanted = {name: Wanted((name,), value.measure) for name in of_wavelengths} or {"values": value}
        read = with_columns(data, {"cos_theta": angle, **wanted}, cls.columns)
        # Angles rise as their cosines fall.
        cosines = tuple(np.cos(np.radians(read.pop("cos_theta")))[::-1].tolist())
        rows = tuple(zip(*(read.pop(name)[::-1] for name in wanted), strict=True))
        wavelengths = tuple(of_wavelengths.values()) or (DESIGN_NM,)
        return {**read, "cos_theta": cosines, "wavelengths": wavelengths, "values": rows}

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
        if self.polarisation is not None:
            self._check_polarisation(self.polarisation)
        return self

    def _check_polarisation(self, tables: tuple[tuple[tuple[float, ...], ...], ...]) -> None:
        shape = (len(self.cos_theta), len(self.wavelengths))
        if len(tables) != 5 or any(len(t) != shape[0] or any(len(row) != shape[1] for row in t) for t in tables):
            raise DomainError("polarisation", len(tables), "five tables a2, a3, a4, b1, b2, each shaped as values")
        _check_matrix("polarisation", np.concatenate([np.asarray(self.values)[None], np.asarray(tables)]))

    def _table(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        """Nodes and normalised values at the asked wavelengths, shapes (angle,) and (angle, wavelength)."""
        mu, values = np.asarray(self.cos_theta), np.asarray(self.values)
        return mu, self._at_wavelengths(normalise(mu, values), wavelengths_nm)

    def _at_wavelengths(self, values: Array, wavelengths_nm: ArrayLike) -> Array:
        """Values (angle, node) at the asked wavelengths."""
        wl = np.clip(np.atleast_1d(np.asarray(wavelengths_nm, float)), self.wavelengths[0], self.wavelengths[-1])
        if len(self.wavelengths) == 1:
            return np.repeat(values, wl.size, axis=1)
        i = np.clip(np.searchsorted(self.wavelengths, wl) - 1, 0, len(self.wavelengths) - 2)
        nodes = np.asarray(self.wavelengths)
        w = (wl - nodes[i]) / (nodes[i + 1] - nodes[i])
        return values[:, i] * (1 - w) + values[:, i + 1] * w

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        return _at_angles(*self._table(wavelengths_nm), cos_theta)

    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Scattering matrix, linear between the nodes as `value` is; see `PhaseFunction.matrix`."""
        if self.polarisation is None:
            return super().matrix(cos_theta, wavelengths_nm)
        mu, values = np.asarray(self.cos_theta), np.asarray(self.values)
        scale = 1 / (2 * np.pi * np.trapezoid(values, mu, axis=0))
        tables = [self._at_wavelengths(scale * np.asarray(t), wavelengths_nm) for t in (values, *self.polarisation)]
        return np.stack([_at_angles(mu, table, cos_theta) for table in tables])

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


class GreekPhase(PhaseFunction):
    """Scattering matrix as coefficients of generalised spherical functions, the same at all wavelengths.

    After Siewert (2000), J. Quant. Spectrosc. Radiat. Transfer 64, 227, and de Rooij & van der Stap (1984), Astron.
    Astrophys. 131, 237, with Wigner's functions d^l_mn of the scattering angle:

        4 pi a1 = sum alpha1_l P_l,                 4 pi a4 = sum alpha4_l P_l,
        4 pi (a2 + a3) = sum (alpha2_l + alpha3_l) d^l_22,    4 pi b1 = sum beta1_l d^l_02,
        4 pi (a2 - a3) = sum (alpha2_l - alpha3_l) d^l_2,-2,  4 pi b2 = sum beta2_l d^l_02.

    Authors differ in the signs of beta1 (as of d^l_02) and of beta2 (as of V); here the dipole is alpha1 = (1, 0, 1/2),
    alpha2 = (0, 0, 3), alpha4 = (0, 3/2, 0), beta1 = (0, 0, -sqrt(6) / 2).

    Parameters
    ----------
    alpha1, alpha2, alpha3, alpha4, beta1, beta2 : tuple of float, shape (l,)
        From l = 0, all of the same length; the first of alpha1 is 1.
    """

    kind: Literal["greek"] = "greek"
    alpha1: tuple[float, ...]
    alpha2: tuple[float, ...]
    alpha3: tuple[float, ...]
    alpha4: tuple[float, ...]
    beta1: tuple[float, ...]
    beta2: tuple[float, ...]

    @model_validator(mode="after")
    def _check(self) -> GreekPhase:
        if not self.alpha1 or abs(self.alpha1[0] - 1) > 1e-12:
            raise DomainError("alpha1", self.alpha1[:1], "starts with 1, so that the phase function is normalised")
        for name in ("alpha2", "alpha3", "alpha4", "beta1", "beta2"):
            if len(getattr(self, name)) != len(self.alpha1):
                raise DomainError(name, len(getattr(self, name)), f"as many coefficients as alpha1, {len(self.alpha1)}")
        elements = self.matrix(np.cos(np.linspace(0, np.pi, 8 * len(self.alpha1) + 1)), [500.0])
        if elements[0].min() < 0:
            raise DomainError("alpha1", float(elements[0].min()), "a phase function is never negative")
        _check_matrix("alpha2", elements)
        return self

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Phase function [sr-1], shape (angle, wavelength)."""
        mu = np.atleast_1d(np.asarray(cos_theta, float))
        series = np.polynomial.legendre.legval(mu, self.alpha1) / (4 * np.pi)
        return np.repeat(series[:, None], np.size(wavelengths_nm), axis=1)

    @steady_algebra()
    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Scattering matrix; see `PhaseFunction.matrix`."""
        mu = np.atleast_1d(np.asarray(cos_theta, float))
        legendre = np.polynomial.legendre.legvander(mu, len(self.alpha1) - 1).T
        d02, d22, d2m2 = (wigner_d2(mu, len(self.alpha1), k) for k in (0, 2, -2))
        alpha2, alpha3 = np.asarray(self.alpha2), np.asarray(self.alpha3)
        together, apart = (alpha2 + alpha3) @ d22, (alpha2 - alpha3) @ d2m2
        elements = np.stack([
            np.asarray(self.alpha1) @ legendre, 0.5 * (together + apart), 0.5 * (together - apart),
            np.asarray(self.alpha4) @ legendre, np.asarray(self.beta1) @ d02, np.asarray(self.beta2) @ d02,
        ])  # fmt: skip
        return np.repeat(elements[:, :, None] / (4 * np.pi), np.size(wavelengths_nm), axis=2)

    def mean_cosine(self, wavelengths_nm: ArrayLike) -> Array:
        """Asymmetry parameter, shape (wavelength,)."""
        return np.full(np.size(wavelengths_nm), self.alpha1[1] / 3 if len(self.alpha1) > 1 else 0.0)

    def sample(self, u: ArrayLike, wavelength_nm: float) -> Array:
        """Cosines drawn by `value`: the distribution function, a Legendre series too, inverted by bisection."""
        cumulative = 0.5 * np.polynomial.legendre.legint(self.alpha1, lbnd=-1)
        u = np.asarray(u, float)
        low, high = np.full(u.shape, -1.0), np.full(u.shape, 1.0)
        for _ in range(54):  # each step is one bit of the result
            middle = 0.5 * (low + high)
            below = np.polynomial.legendre.legval(middle, cumulative) < u
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return 0.5 * (low + high)


def wigner_d2(mu: Array, count: int, n: int) -> Array:
    """Wigner's functions d^l_2n (n = 0, 2 or -2) of the angle with cosine `mu`, l = 0 .. count - 1, shape (l, mu).

    Recurrence over l at fixed indices (Varshalovich, Moskalev & Khersonskii 1988, Quantum Theory of Angular Momentum,
    section 4.8) from d^2_20 = sqrt(6) / 4 (1 - mu^2) and d^2_2,+-2 = ((1 +- mu) / 2)^2.
    """
    d = np.zeros((max(count, 3), mu.size))
    d[2] = np.sqrt(6) / 4 * (1 - mu * mu) if n == 0 else (0.5 * (1 + np.sign(n) * mu)) ** 2
    for k in range(2, count - 1):
        down, up = (np.sqrt((j * j - 4) * (j * j - n * n)) / j for j in (k, k + 1))
        d[k + 1] = ((2 * k + 1) * (mu - 2 * n / (k * (k + 1))) * d[k] - down * d[k - 1]) / up
    return d[:count]


def _at_angles(nodes: Array, table: Array, cos_theta: ArrayLike) -> Array:
    """A table (node, wavelength) read as linear in the cosine, shape (angle, wavelength)."""
    mu = np.atleast_1d(np.asarray(cos_theta, float))
    i = np.clip(np.searchsorted(nodes, mu) - 1, 0, nodes.size - 2)
    w = ((mu - nodes[i]) / (nodes[i + 1] - nodes[i]))[:, None]
    value: Array = table[i] * (1 - w) + table[i + 1] * w
    return value


def matrix_excess(elements: Array) -> float:
    """By how much elements (6, ...) of a scattering matrix break the bounds that every one obeys, relative to a1.

    Hovenier, van de Hulst & van der Mee (1986), Astron. Astrophys. 157, 301: a sum of pure scatterers fulfils
    (a3 + a4)^2 + 4 b2^2 <= (a1 + a2)^2 - 4 b1^2, |a3 - a4| <= a1 - a2 and |a2 - b1|, |a2 + b1| no more than a1 -+ b1.
    """
    a1, a2, a3, a4, b1, b2 = elements
    # Squares would take half the digits of a tolerance: roots are compared.
    pair = np.hypot(np.hypot(a3 + a4, 2 * b2), 2 * b1) - (a1 + a2)
    broken = [0.5 * pair, np.abs(a3 - a4) - (a1 - a2), np.abs(a2 - b1) - (a1 - b1), np.abs(a2 + b1) - (a1 + b1)]
    return float(np.max(np.max(broken, axis=0) / np.maximum(a1, 1e-300)))


def _check_matrix(name: str, elements: Array) -> None:
    # Printed coefficients and interpolated tables break the bounds by their last digits.
    excess = matrix_excess(np.where(elements[0] > 0, elements, 0.0))
    if excess > 1e-3 or np.any((elements[0] <= 0) & np.any(elements != 0, axis=0)):
        raise DomainError(
            name, f"bounds broken by {excess:.2g}", "no particles scatter so: polarised light exceeds all light"
        )


def normalise(cos_theta: Array, values: Array) -> Array:
    """Scale `values` (angle, ...) so that their linear interpolant integrates to 1 over the sphere."""
    integral = 2 * np.pi * np.trapezoid(values, cos_theta, axis=0)
    scaled: Array = values / integral
    return scaled


AnyPhase = Annotated[
    Isotropic
    | Rayleigh
    | HenyeyGreenstein
    | DoubleHenyeyGreenstein
    | CornetteShanks
    | Draine
    | TabulatedPhase
    | GreekPhase,
    Field(discriminator="kind"),
    *open_to(PhaseFunction),
]

__all__ = [
    "AnyPhase",
    "CornetteShanks",
    "DoubleHenyeyGreenstein",
    "Draine",
    "GreekPhase",
    "HenyeyGreenstein",
    "Isotropic",
    "Rayleigh",
    "TabulatedPhase",
    "draine_mean_cosine",
    "draine_value",
    "matrix_excess",
    "normalise",
    "wigner_d2",
]
