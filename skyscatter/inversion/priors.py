"""What is held of a density before it is seen: smooth, in pieces of one value, or flat.

Each prior is a number R(x) of a density x (x, y, z) in units of a typical one, written as an integral over the box in
units of its size, so that its weight means the same on grids of any fineness.  Minus the weight times R is the
logarithm of the prior probability.  `curvature` is its second derivative (for total variation, the part that is never
negative) applied to a vector; `noise` a random vector with that covariance, for samples of the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.voxelscene import VoxelFrame

Array = NDArray[np.float64]


def _steps(x: Array) -> list[Array]:
    """Differences of neighbours along each axis."""
    return [np.diff(x, axis=k) for k in range(3)]


def _steps_back(parts: list[Array], shape: tuple[int, ...]) -> Array:
    """Transpose of `_steps`."""
    out = np.zeros(shape)
    for k, part in enumerate(parts):
        high = [slice(None)] * 3
        low = [slice(None)] * 3
        high[k], low[k] = slice(1, None), slice(None, -1)
        out[tuple(high)] += part
        out[tuple(low)] -= part
    return out


@dataclass(frozen=True)
class Prior:
    """Base of all priors."""

    #: Whether another unit of density only changes the weight.
    scale_free: ClassVar[bool] = False

    def value(self, x: Array, frame: VoxelFrame) -> tuple[float, Array]:
        """R and its derivative."""
        raise NotImplementedError

    def curvature(self, x: Array, v: Array, frame: VoxelFrame) -> Array:
        """Second derivative at x, applied to v."""
        raise NotImplementedError

    def noise(self, x: Array, rng: np.random.Generator, frame: VoxelFrame) -> Array:
        """A random vector with the second derivative as its covariance."""
        raise NotImplementedError

    def diagonal(self, x: Array, frame: VoxelFrame) -> Array:
        """Diagonal of the second derivative."""
        raise NotImplementedError


def _pair_weights(frame: VoxelFrame) -> Array:
    """Weights (3,) that turn sums of squared differences into the integral of |grad x|^2, times the size of the box."""
    size = float(np.prod(frame.cell * frame.shape)) ** (1 / 3)
    weights: Array = frame.volume / size / frame.cell**2
    return weights


@dataclass(frozen=True)
class Tikhonov(Prior):
    """Smooth: half the integral of the squared gradient (Tikhonov 1963).  The value at the edges is left free.

    Examples
    --------
    A step between two halves of a box counts more than the same rise in even steps: what is sought is smooth.

    >>> import numpy as np
    >>> from skyscatter.inversion import Tikhonov, VoxelFrame
    >>> frame = VoxelFrame.cube(4, 1.0)
    >>> step, ramp = (np.array(rise)[:, None, None] * np.ones(frame.shape) for rise in ([0, 0, 1, 1], [0, 1/3, 2/3, 1]))
    >>> round(Tikhonov().value(step, frame)[0], 2), round(Tikhonov().value(ramp, frame)[0], 2)
    (2.0, 0.67)
    """

    scale_free: ClassVar[bool] = True

    def value(self, x: Array, frame: VoxelFrame) -> tuple[float, Array]:
        """R and its derivative."""
        slope = self.curvature(x, x, frame)
        return 0.5 * float(np.sum(x * slope)), slope

    def curvature(self, x: Array, v: Array, frame: VoxelFrame) -> Array:
        """Second derivative, the same everywhere, applied to v."""
        parts = [w * step for w, step in zip(_pair_weights(frame), _steps(v), strict=True)]
        return _steps_back(parts, v.shape)

    def noise(self, x: Array, rng: np.random.Generator, frame: VoxelFrame) -> Array:
        """A random vector with the second derivative as its covariance."""
        weights = _pair_weights(frame)
        parts = [np.sqrt(w) * rng.normal(size=s.shape) for w, s in zip(weights, _steps(x), strict=True)]
        return _steps_back(parts, x.shape)

    def diagonal(self, x: Array, frame: VoxelFrame) -> Array:
        """Diagonal of the second derivative."""
        return _neighbours([w * np.ones_like(s) for w, s in zip(_pair_weights(frame), _steps(x), strict=True)], x.shape)


def _neighbours(parts: list[Array], shape: tuple[int, ...]) -> Array:
    """Diagonal of D^T diag(parts) D."""
    out = np.zeros(shape)
    for k, part in enumerate(parts):
        high = [slice(None)] * 3
        low = [slice(None)] * 3
        high[k], low[k] = slice(1, None), slice(None, -1)
        out[tuple(high)] += part
        out[tuple(low)] += part
    return out


@dataclass(frozen=True)
class TotalVariation(Prior):
    """In pieces of one value: the integral of the gradient's length (Rudin et al. 1992), rounded off at zero.

    Parameters
    ----------
    rounding : float
        Difference between neighbours, in typical densities, below which steps count as smooth.

    Examples
    --------
    A step between two halves of a box counts next to the same as an even rise: edges may stay.

    >>> import numpy as np
    >>> from skyscatter.inversion import TotalVariation, VoxelFrame
    >>> frame = VoxelFrame.cube(4, 1.0)
    >>> step, ramp = (np.array(rise)[:, None, None] * np.ones(frame.shape) for rise in ([0, 0, 1, 1], [0, 1/3, 2/3, 1]))
    >>> round(TotalVariation().value(step, frame)[0], 2), round(TotalVariation().value(ramp, frame)[0], 2)
    (0.98, 0.94)
    """

    rounding: float = 0.02

    def __post_init__(self) -> None:
        if not self.rounding > 0:
            raise DomainError("rounding", self.rounding, "must be positive")

    def _lengths(self, x: Array, frame: VoxelFrame) -> tuple[list[Array], Array, float]:
        """Weighted forward differences (zero at the last cells), their rounded length, and the cells' weight."""
        size = float(np.prod(frame.cell * frame.shape)) ** (1 / 3)
        shortest = float(frame.cell.min())
        total = np.full(x.shape, self.rounding**2)
        for k, step in enumerate(_steps(x)):
            at = [slice(None)] * 3
            at[k] = slice(None, -1)
            total[tuple(at)] += (step * shortest / frame.cell[k]) ** 2
        return _steps(x), np.sqrt(total), frame.volume / shortest / size**2

    def _parts(self, x: Array, frame: VoxelFrame) -> list[Array]:
        """Weights of the squared differences: one over the length of the gradient, as it is now."""
        _, length, weight = self._lengths(x, frame)
        shortest, parts = float(frame.cell.min()), []
        for k in range(3):
            at = [slice(None)] * 3
            at[k] = slice(None, -1)
            parts.append(weight * (shortest / frame.cell[k]) ** 2 / length[tuple(at)])
        return parts

    def value(self, x: Array, frame: VoxelFrame) -> tuple[float, Array]:
        """R and its derivative."""
        steps, length, weight = self._lengths(x, frame)
        slope = _steps_back([p * s for p, s in zip(self._parts(x, frame), steps, strict=True)], x.shape)
        return weight * float(np.sum(length - self.rounding)), slope

    def curvature(self, x: Array, v: Array, frame: VoxelFrame) -> Array:
        """Second derivative with the lengths held fixed (Vogel & Oman 1996), applied to v."""
        return _steps_back([p * s for p, s in zip(self._parts(x, frame), _steps(v), strict=True)], v.shape)

    def noise(self, x: Array, rng: np.random.Generator, frame: VoxelFrame) -> Array:
        """A random vector with the second derivative as its covariance."""
        return _steps_back([np.sqrt(p) * rng.normal(size=p.shape) for p in self._parts(x, frame)], x.shape)

    def diagonal(self, x: Array, frame: VoxelFrame) -> Array:
        """Diagonal of the second derivative."""
        return _neighbours(self._parts(x, frame), x.shape)


@dataclass(frozen=True)
class Entropy(Prior):
    """As flat as the data allow: the integral of x ln(x / m) - x + m (Skilling & Bryan 1984), m a default density.

    Parameters
    ----------
    default : float
        In typical densities.
    floor : float
        Added to density and default, so that empty cells have a derivative.

    Examples
    --------
    Nothing is held against a density that is the default everywhere; neighbours do not matter, only values do.

    >>> import numpy as np
    >>> from skyscatter.inversion import Entropy, VoxelFrame
    >>> frame = VoxelFrame.cube(4, 1.0)
    >>> Entropy().value(np.ones(frame.shape), frame)[0]
    0.0
    >>> lone = np.ones(frame.shape)
    >>> lone[1, 2, 3] = 20.0
    >>> round(Entropy().value(lone, frame)[0], 2)
    0.64
    """

    default: float = 1.0
    floor: float = 1e-2

    def __post_init__(self) -> None:
        for name in ("default", "floor"):
            if not getattr(self, name) > 0:
                raise DomainError(name, getattr(self, name), "must be positive")

    def _weight(self, frame: VoxelFrame) -> float:
        return 1 / float(np.prod(frame.shape))

    def value(self, x: Array, frame: VoxelFrame) -> tuple[float, Array]:
        """R and its derivative."""
        y, m, w = np.maximum(x, 0.0) + self.floor, self.default + self.floor, self._weight(frame)
        logarithm = np.log(y / m)
        return w * float(np.sum(y * logarithm - y + m)), w * logarithm

    def curvature(self, x: Array, v: Array, frame: VoxelFrame) -> Array:
        """Second derivative applied to v."""
        return self.diagonal(x, frame) * v

    def noise(self, x: Array, rng: np.random.Generator, frame: VoxelFrame) -> Array:
        """A random vector with the second derivative as its covariance."""
        return np.sqrt(self.diagonal(x, frame)) * rng.normal(size=x.shape)

    def diagonal(self, x: Array, frame: VoxelFrame) -> Array:
        """Diagonal of the second derivative."""
        return self._weight(frame) / (np.maximum(x, 0.0) + self.floor)


PRIORS: dict[str, Any] = {"tikhonov": Tikhonov, "total-variation": TotalVariation, "entropy": Entropy}


def prior_of(given: Prior | str) -> Prior:
    """A prior by its name, or as it is."""
    if isinstance(given, Prior):
        return given
    if given not in PRIORS:
        raise DomainError("prior", given, f"choose from {', '.join(PRIORS)}, or give one of `inversion.priors`")
    made: Prior = PRIORS[given]()
    return made
