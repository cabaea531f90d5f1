"""What was known of a number before the measurement, as a map from a standard normal variable.

Every prior is written as v = q(Phi(z)), with z standard normal, Phi its distribution function and q the quantile
function of the prior.  So any of them is represented exactly, bounds can never be crossed whatever z is, and in z every
prior is the same: N(0, 1).  Estimation and sampling work in z throughout (the state vector of Rodgers 2000, with
x_a = 0 and S_a = I).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skyscatter.errors import DomainError

#: Beyond so many standard deviations double precision knows no more of 1 - Phi; states are kept within.
FARTHEST = 8.0


@dataclass(frozen=True)
class Distribution:
    """A prior; `value` and `state` are inverses of each other."""

    def value(self, z: float) -> float:
        """The number at a state z."""
        raise NotImplementedError

    def state(self, value: float) -> float:
        """The state of a number."""
        raise NotImplementedError

    def slope(self, z: float) -> float:
        """Derivative of the value with respect to z."""
        raise NotImplementedError

    @property
    def support(self) -> tuple[float, float]:
        """Between which values it lies."""
        return -math.inf, math.inf

    def holds(self, value: float) -> bool:
        """Whether a value lies inside the support, its ends excluded."""
        low, high = self.support
        return low < value < high


def _phi(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def _density(z: float) -> float:
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def _quantile(p: float) -> float:
    from scipy.special import ndtri

    return float(ndtri(p))


def _clip(z: float) -> float:
    return min(max(z, -FARTHEST), FARTHEST)


def _share(z: float, width: float) -> float:
    """`width` times Phi(z), counted from the nearer end so that no digits are lost."""
    return width * _phi(z)


def _number(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise DomainError(name, value, "a finite number")


@dataclass(frozen=True)
class Uniform(Distribution):
    """Any value between `low` and `high` is as likely as another.

    Parameters
    ----------
    low, high : float
        Bounds, which the number never reaches.

    Examples
    --------
    Values two standard deviations below the middle, in it, and above it:

    >>> from skyscatter.inversion import Uniform
    >>> prior = Uniform(0.0, 2.0)
    >>> [round(prior.value(z), 2) for z in (-2, 0, 2)]
    [0.05, 1.0, 1.95]
    >>> prior.holds(2.5)
    False
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _number("low", self.low)
        _number("high", self.high)
        if not self.low < self.high:
            raise DomainError(
                "prior", f"{self.low:g}:{self.high:g}", "the lower bound comes first and is below the other"
            )

    @property
    def support(self) -> tuple[float, float]:
        """Its bounds."""
        return self.low, self.high

    def value(self, z: float) -> float:
        """Low + (high - low) Phi(z)."""
        width, z = self.high - self.low, _clip(z)
        return self.low + _share(z, width) if z <= 0 else self.high - _share(-z, width)

    def state(self, value: float) -> float:
        """Phi^-1 of the share of the interval below the value."""
        share = (value - self.low) / (self.high - self.low)
        return _clip(_quantile(share) if share <= 0.5 else -_quantile((self.high - value) / (self.high - self.low)))

    def slope(self, z: float) -> float:
        """(high - low) phi(z)."""
        return (self.high - self.low) * _density(_clip(z))

    def __str__(self) -> str:
        return f"uniform({self.low:g}, {self.high:g})"


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Any order of magnitude between `low` and `high` is as likely as another.

    Parameters
    ----------
    low, high : float
        Bounds above 0.

    Examples
    --------
    The middle of 0.01 and 1 is 0.1:

    >>> from skyscatter.inversion import LogUniform
    >>> prior = LogUniform(0.01, 1.0)
    >>> [round(prior.value(z), 2) for z in (-1, 0, 1)]
    [0.02, 0.1, 0.48]
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0 < self.low < self.high < math.inf:
            raise DomainError("prior", f"{self.low:g}:{self.high:g}", "two bounds above 0, the lower one first")

    @property
    def support(self) -> tuple[float, float]:
        """Its bounds."""
        return self.low, self.high

    @property
    def _log(self) -> Uniform:
        return Uniform(math.log(self.low), math.log(self.high))

    def value(self, z: float) -> float:
        """The exponential of a uniform variable."""
        return math.exp(self._log.value(z))

    def state(self, value: float) -> float:
        """See `Uniform.state`."""
        return self._log.state(math.log(value))

    def slope(self, z: float) -> float:
        """By the chain rule."""
        return self.value(z) * self._log.slope(z)

    def __str__(self) -> str:
        return f"loguniform({self.low:g}, {self.high:g})"


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal with a mean and a standard deviation, cut off at bounds where physics has some.

    Parameters
    ----------
    mean, sigma : float
        Of the distribution before it is cut off.
    low, high : float
        Bounds; none when not given.

    Examples
    --------
    An albedo of 0.9 +- 0.1 that never exceeds 1: one standard deviation up is no longer as far as down.

    >>> from skyscatter.inversion import Normal
    >>> prior = Normal(0.9, 0.1, high=1.0)
    >>> [round(prior.value(z), 2) for z in (-1, 0, 1)]
    [0.79, 0.88, 0.95]
    """

    mean: float
    sigma: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        _number("mean", self.mean)
        if not 0 < self.sigma < math.inf:
            raise DomainError("prior", f"{self.mean:g}~{self.sigma:g}", "the standard deviation must be above 0")
        if not self.low < self.high or self._mass < 1e-12:
            rule = f"leaves nothing between {self.low:g} and {self.high:g}, where the parameter has to lie"
            raise DomainError("prior", f"{self.mean:g}~{self.sigma:g}", rule)

    @property
    def support(self) -> tuple[float, float]:
        """Its bounds."""
        return self.low, self.high

    @property
    def _below(self) -> float:
        return _phi((self.low - self.mean) / self.sigma) if self.low > -math.inf else 0.0

    @property
    def _mass(self) -> float:
        above = _phi((self.mean - self.high) / self.sigma) if self.high < math.inf else 0.0
        return 1.0 - self._below - above

    @property
    def _whole(self) -> bool:
        """No bound within reach of any state: the map is a straight line."""
        reach = (FARTHEST + 1) * self.sigma
        return self.low < self.mean - reach and self.high > self.mean + reach

    def value(self, z: float) -> float:
        """Mean + sigma z, or its quantile between the bounds."""
        z = _clip(z)
        if self._whole:
            return self.mean + self.sigma * z
        p = self._below + self._mass * _phi(z)
        inside = self.mean + self.sigma * _clip(_quantile(min(max(p, 1e-300), 1 - 1e-16)))
        return min(max(inside, self.low), self.high)

    def state(self, value: float) -> float:
        """The inverse of `value`."""
        x = (value - self.mean) / self.sigma
        if self._whole:
            return _clip(x)
        return _clip(_quantile(min(max((_phi(x) - self._below) / self._mass, 1e-300), 1 - 1e-16)))

    def slope(self, z: float) -> float:
        """Ratio of the densities of z and of the value."""
        z = _clip(z)
        if self._whole:
            return self.sigma
        x = (self.value(z) - self.mean) / self.sigma
        return self.sigma * self._mass * _density(z) / max(_density(x), 1e-300)

    def __str__(self) -> str:
        low = "" if self.low == -math.inf else f" from {self.low:g}"
        high = "" if self.high == math.inf else f" up to {self.high:g}"
        return f"normal({self.mean:g}, {self.sigma:g}){low}{high}"


@dataclass(frozen=True)
class LogNormal(Distribution):
    """exp of a normal variable: `median` times exp(`sigma` z); sigma 0.5 is a factor of 1.65 either way.

    Parameters
    ----------
    median : float
        Above 0.
    sigma : float
        Standard deviation of the logarithm.

    Examples
    --------
    Water vapour of 1.5 g cm-2, known to a factor of 1.65:

    >>> from skyscatter.inversion import LogNormal
    >>> prior = LogNormal(1.5, 0.5)
    >>> [round(prior.value(z), 2) for z in (-1, 0, 1)]
    [0.91, 1.5, 2.47]
    >>> round(prior.state(1.5), 2)
    0.0
    """

    median: float
    sigma: float

    def __post_init__(self) -> None:
        if not (0 < self.median < math.inf and 0 < self.sigma < math.inf):
            raise DomainError("prior", f"{self.median:g}, {self.sigma:g}", "median and sigma must be above 0")

    @property
    def support(self) -> tuple[float, float]:
        """All positive numbers."""
        return 0.0, math.inf

    def value(self, z: float) -> float:
        """Median exp(sigma z)."""
        return self.median * math.exp(self.sigma * _clip(z))

    def state(self, value: float) -> float:
        """ln(value / median) / sigma."""
        return _clip(math.log(value / self.median) / self.sigma)

    def slope(self, z: float) -> float:
        """Sigma times the value."""
        return self.sigma * self.value(z)

    def __str__(self) -> str:
        return f"lognormal({self.median:g}, {self.sigma:g})"


KINDS = {"uniform": Uniform, "loguniform": LogUniform, "normal": Normal, "lognormal": LogNormal}


def to_json(prior: Distribution) -> dict[str, float | str]:
    """The prior as plain values."""
    kind = next(name for name, cls in KINDS.items() if type(prior) is cls)
    return {"kind": kind} | {name: value for name, value in vars(prior).items() if abs(value) < math.inf}


def from_json(content: dict[str, float | str]) -> Distribution:
    """The prior that `to_json` wrote."""
    values = {name: float(value) for name, value in content.items() if name != "kind"}
    return KINDS[str(content["kind"])](**values)
