"""How far a hot star ionises the gas around it, in photoionisation equilibrium with case B recombination.

Along every direction the star's ionising photons are used up by recombinations (Stroemgren 1939, ApJ 89, 526),

    Q / (4 pi) = integral of alpha_B n_H(r)^2 r^2 dr from 0 to R,

with the gas fully ionised inside R and neutral beyond ("on the spot": recombinations to the ground state ionise a
hydrogen atom near by and do not count).  Dust takes no ionising photons here, and helium is left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.constants import BOLTZMANN, ELECTRON_VOLT, LIGHT, PLANCK, STEFAN_BOLTZMANN
from skyscatter.errors import DomainError
from skyscatter.optics.base import Array
from skyscatter.optics.lines import check_temperature, effective_recombination, photon_energy

Indices = NDArray[np.intp]

IONISATION_ENERGY = 13.598434 * ELECTRON_VOLT  #: of hydrogen [J] (NIST)
LYMAN_LIMIT = PLANCK * LIGHT / IONISATION_ENERGY * 1e9  #: longest wavelength that ionises hydrogen [nm]

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(7)
#: Budgets of photons behind whose use no photon comes, whatever a first estimate of them is worth.
BEYOND = 1e3
_DEEPEST = 40  #: halvings of a stretch of a ray; 2^-40 of it is rounding


def alpha_b(temperature: float) -> float:
    """Case B recombination coefficient of hydrogen [m3 s-1].

    Fit of Hui & Gnedin (1997), MNRAS 292, 27, appendix A, to Ferland et al. (1992), good to 0.7 % at all temperatures.

    Parameters
    ----------
    temperature : float
        Of the electrons [K], 3000 to 30000.
    """
    check_temperature(temperature)
    x = 315614.0 / temperature
    return 2.753e-20 * x**1.5 / (1 + (x / 2.74) ** 0.407) ** 2.242


def stromgren_radius(ionising_photons: float, hydrogen_density: float, temperature: float = 1e4) -> float:
    """Radius of the ionised sphere in uniform gas [m], (3 Q / (4 pi alpha_B n^2))^(1/3).

    Parameters
    ----------
    ionising_photons : float
        Q, photons beyond 13.6 eV that the star sends out [s-1].
    hydrogen_density : float
        Hydrogen nuclei per volume [m-3].
    temperature : float
        Of the ionised gas [K].
    """
    _check_source(ionising_photons, hydrogen_density)
    return float((3 * ionising_photons / (4 * np.pi * alpha_b(temperature) * hydrogen_density**2)) ** (1 / 3))


def case_b_photons(ionising_photons: float, line: str = "hbeta", temperature: float = 1e4) -> float:
    """Photons of a hydrogen line [s-1] from a region that uses up all ionising photons, Q alpha_eff / alpha_B."""
    return ionising_photons * effective_recombination(line, temperature) / alpha_b(temperature)


def case_b_luminosity(ionising_photons: float, line: str = "hbeta", temperature: float = 1e4) -> float:
    """Luminosity in a hydrogen line [W] of a region that uses up all ionising photons, whatever its density."""
    return case_b_photons(ionising_photons, line, temperature) * photon_energy(line)


def ionising_photons(
    temperature_K: float, *, luminosity_W: float | None = None, radius_m: float | None = None
) -> float:
    """Photons beyond 13.6 eV that a black sphere sends out [s-1].

    The photons per area are 2 pi / c^2 (k T / h)^3 times the integral of x^2 / (e^x - 1) beyond x = h nu / k T, a
    series of exponentials (Planck's law).  Give exactly one of luminosity and radius.

    Parameters
    ----------
    temperature_K : float
        Effective temperature [K].
    luminosity_W : float, optional
        Bolometric luminosity [W].
    radius_m : float, optional
        Radius [m].
    """
    if not temperature_K > 0:
        raise DomainError("temperature", temperature_K, "must be positive [K]")
    if (luminosity_W is None) == (radius_m is None):
        raise DomainError("radius_m", radius_m, "give exactly one of luminosity_W and radius_m")
    if radius_m is not None:
        area = 4 * np.pi * radius_m**2
    else:
        area = (luminosity_W or 0.0) / (STEFAN_BOLTZMANN * temperature_K**4)
    x = IONISATION_ENERGY / (BOLTZMANN * temperature_K)
    # Terms fall as exp(-n x); when x is small the sum still converges as 1 / n^3 until exp(-n x) ends it.
    n = np.arange(1, max(20, int(40 / x) + 2))
    series = np.sum(np.exp(-n * x) * (x * x / n + 2 * x / n**2 + 2 / n**3.0))
    return float(area * 2 * np.pi / LIGHT**2 * (BOLTZMANN * temperature_K / PLANCK) ** 3 * series)


def _check_source(photons: float, hydrogen_density: float) -> None:
    if not photons >= 0:
        raise DomainError("ionising_photons", photons, "is never negative [s-1]")
    if not hydrogen_density > 0:
        raise DomainError("hydrogen_density", hydrogen_density, "must be positive [m-3]")


class _Rays(NamedTuple):
    """What the integrals along the rays need."""

    density: Callable[[Array], Array]
    origin: Array
    directions: Array


class _Stretches(NamedTuple):
    """Pieces of rays, each of shape (piece,); `value` is the integral of (density r)^2 over the piece."""

    ray: Indices
    start: Array
    end: Array
    value: Array

    def some(self, which: NDArray[np.bool_] | Indices) -> _Stretches:
        """Those of a choice."""
        return _Stretches(self.ray[which], self.start[which], self.end[which], self.value[which])


def _joined(parts: list[_Stretches]) -> _Stretches:
    """All pieces, part by part."""
    ray = np.concatenate([part.ray for part in parts])
    return _Stretches(ray, *(np.concatenate([part[i] for part in parts]) for i in (1, 2, 3)))


class UsedUp(NamedTuple):
    """What gas uses up of a star's ionising photons along rays, out to where none are left; see `used_up`."""

    rays: _Rays
    stretches: list[_Stretches]  #: one after the other outwards: those of the rays that still have photons
    budget: float  #: integral of (relative density)^2 r^2 dr [m3] that the photons of one direction can ionise
    limit: float
    tolerance: float

    def radii(self, share: float = 1.0) -> Array:
        """Distance at which a share of the photons is used up, shape (ray,) [m]; `limit` where more escapes."""
        count, budget = len(self.rays.directions), share * self.budget
        if budget == 0:
            return np.zeros(count)
        radii, used = np.full(count, self.limit), np.zeros(count)
        left = np.ones(count, bool)
        for pieces in self.stretches:
            total = np.bincount(pieces.ray, weights=pieces.value, minlength=count)
            done = left & (used + total >= budget)
            if done.any():
                _find_fronts(self.rays, np.flatnonzero(done), pieces, used, budget, radii, self.tolerance)
            used += total
            left &= ~done
        return radii


def front_radii(
    density: Callable[[Array], Array],
    position: ArrayLike,
    directions: ArrayLike,
    *,
    hydrogen_density: float,
    ionising_photons: float,
    limit: float,
    temperature: float = 1e4,
    steps: int = 64,
    tolerance: float = 1e-6,
) -> Array:
    """Distance of the ionisation front from a star in each direction; takes what `used_up` takes.

    Returns
    -------
    ndarray, shape (ray,)
        Radius of the front [m]; `limit` where photons escape beyond it.
    """
    return used_up(
        density, position, directions, hydrogen_density=hydrogen_density, ionising_photons=ionising_photons,
        limit=limit, temperature=temperature, steps=steps, tolerance=tolerance,
    ).radii()  # fmt: skip


def used_up(
    density: Callable[[Array], Array],
    position: ArrayLike,
    directions: ArrayLike,
    *,
    hydrogen_density: float,
    ionising_photons: float,
    limit: float,
    temperature: float = 1e4,
    steps: int = 64,
    tolerance: float = 1e-6,
) -> UsedUp:
    """What gas uses up of a star's ionising photons in each direction.

    The integral is taken outwards in `steps` stretches of equal length, each halved until two Gauss rules of 7 points
    agree with the one over the whole, and no further than the front.

    Parameters
    ----------
    density : callable
        Density of hydrogen relative to `hydrogen_density` at points of shape (n, 3) [m], returned in shape (n,).
    position : array_like, shape (3,)
        The star [m].
    directions : array_like, shape (ray, 3)
        Directions of any length but zero.
    hydrogen_density : float
        Hydrogen nuclei per volume where the density is 1 [m-3].
    ionising_photons : float
        Q of the star [s-1], sent out alike in all directions.
    limit : float
        Where to stop [m].
    temperature : float
        Of the ionised gas [K].
    steps : int
        Stretches to begin with; a knot of gas much smaller than limit / steps / 14 may be missed.
    tolerance : float
        Error allowed in the photons used up, relative to all of them.
    """
    _check_source(ionising_photons, hydrogen_density)
    for name, value in (("limit", limit), ("steps", steps), ("tolerance", tolerance)):
        if not value > 0:
            raise DomainError(name, value, "must be positive")
    directions = np.atleast_2d(np.asarray(directions, float))
    length = np.linalg.norm(directions, axis=1)
    if directions.shape[1] != 3 or not np.all(length > 0):
        raise DomainError("directions", directions.shape, "of shape (ray, 3), none of them zero")
    rays = _Rays(density, np.asarray(position, float), directions / length[:, None])
    budget = ionising_photons / (4 * np.pi * alpha_b(temperature) * hydrogen_density**2)
    answer = UsedUp(rays, [], float(budget), float(limit), tolerance)
    burning, used = np.arange(len(directions)) if budget else np.arange(0), np.zeros(len(directions))
    for start, end in itertools.pairwise(np.linspace(0.0, limit, int(steps) + 1)):
        if burning.size == 0:
            break
        answer.stretches.append(pieces := _integrate(rays, burning, start, end, tolerance, budget))
        used += np.bincount(pieces.ray, weights=pieces.value, minlength=len(used))
        burning = burning[used[burning] < budget]
    return answer


def _gauss(rays: _Rays, ray: Indices, start: Array, end: Array) -> Array:
    """Integral of (density r)^2 over pieces of rays by one Gauss rule each; shape (piece,)."""
    half = 0.5 * (end - start)
    r = (0.5 * (start + end))[:, None] + half[:, None] * _GAUSS_X
    integrand = (_density(rays, np.repeat(ray, _GAUSS_X.size), r.ravel()).reshape(r.shape) * r) ** 2
    value: Array = half * (integrand @ _GAUSS_W)
    return value


def _density(rays: _Rays, ray: Indices, r: Array) -> Array:
    """Relative density at distances along rays; shape of `r`, which is (n,)."""
    values: Array = np.asarray(rays.density(rays.origin + r[:, None] * rays.directions[ray]), float)
    if values.size and not values.min() >= 0:
        raise DomainError("density", float(values.min()), "is never negative")
    return values


def _integrate(rays: _Rays, ray: Indices, start: float, end: float, tolerance: float, budget: float) -> _Stretches:
    """The pieces of the stretch from `start` to `end` along rays, halved until each is right.

    Right means to the tolerance of its own value, so that the errors of all that is used up, which is the budget, add
    up to no more than the tolerance of the budget.  A piece may err by a millionth of that whatever its value.  What
    lies behind pieces that use up `BEYOND` budgets is left as it is: no photon comes there, and gas that is denser by
    many powers of ten could not be halved until it is right.
    """
    a, b = np.full(ray.size, start), np.full(ray.size, end)
    waiting = _Stretches(ray, a, b, _gauss(rays, ray, a, b))
    finished: list[_Stretches] = []
    # Estimates become better from round to round: what has to wait is looked at again.
    while (reached := _reached(finished, waiting, budget)).any():
        ray, a, b, whole = waiting.some(reached)
        middle = 0.5 * (a + b)
        first, second = _gauss(rays, ray, a, middle), _gauss(rays, ray, middle, b)
        allowed = tolerance * np.maximum(np.minimum(first + second, budget), 1e-6 * budget)
        good = (np.abs(first + second - whole) <= allowed) | (b - a <= (end - start) * 0.5**_DEEPEST)
        halves = [_Stretches(ray, a, middle, first), _Stretches(ray, middle, b, second)]
        finished += [half.some(good) for half in halves]
        waiting = _joined([waiting.some(~reached), *(half.some(~good) for half in halves)])
    finished.append(waiting)
    pieces = _in_order(finished)
    # More than is there cannot be used; sums over rays keep their digits.
    return pieces._replace(value=np.minimum(pieces.value, BEYOND * budget))


def _reached(finished: list[_Stretches], rest: _Stretches, budget: float) -> NDArray[np.bool_]:
    """Which pieces of the rest are not behind others of their ray that use up many budgets."""
    if rest.value.sum() < BEYOND * budget:  # as nearly always
        return np.ones(rest.ray.size, bool)
    ray, start, _, value = _joined([*finished, rest])
    value = np.minimum(value, BEYOND * budget)
    order = np.lexsort((start, ray))
    before = np.concatenate([[0.0], np.cumsum(value[order])])
    before = before[:-1] - before[np.searchsorted(ray[order], ray[order])]
    found = np.empty(ray.size, bool)
    found[order] = before < BEYOND * budget
    return found[ray.size - rest.ray.size :]


def _in_order(parts: list[_Stretches]) -> _Stretches:
    """All pieces, ray by ray and outwards."""
    pieces = _joined(parts)
    return pieces.some(np.lexsort((pieces.start, pieces.ray)))


def _find_fronts(
    rays: _Rays, ray: Indices, pieces: _Stretches, used: Array, budget: float, radii: Array, tolerance: float
) -> None:
    """Write into `radii` where rays that run out of photons within these pieces do so."""
    before = np.concatenate([[0.0], np.cumsum(pieces.value)])
    starts = np.searchsorted(pieces.ray, ray)
    # Pieces stand ray by ray: of each ray the first piece after which what is used reaches the budget.
    wanted = before[starts] + (budget - used[ray])
    last = np.searchsorted(pieces.ray, ray, side="right") - 1
    k = np.clip(np.searchsorted(before[1:], wanted), starts, last)
    rest = wanted - before[k]
    low, high = pieces.start[k].copy(), pieces.end[k].copy()
    left = pieces.start[k]
    r = low + (high - low) * np.clip(rest / np.maximum(pieces.value[k], 1e-300), 0, 1)
    for _ in range(60):
        excess = _gauss(rays, ray, left, r) - rest
        settled = (np.abs(excess) <= 1e-3 * tolerance * budget) | (high - low <= 1e-15 * high)
        if settled.all():
            break
        low, high = np.where(excess < 0, r, low), np.where(excess < 0, high, r)
        with np.errstate(over="ignore"):  # where next to nothing is, Newton's step is beyond all numbers
            newton = r - excess / np.maximum((_density(rays, ray, r) * r) ** 2, 1e-300)
        # Newton's step where it stays inside the bracket, else halve it: never worse than bisection.
        step = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
        r = np.where(settled, r, step)
    radii[ray] = r
