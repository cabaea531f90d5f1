"""Fields of random Fourier modes: log-normal turbulence, and the noise that warps coordinates."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import TURBULENCE
from skyscatter.media.shapes import Leaf, Shape
from skyscatter.media.space import Array
from skyscatter.units import OptionalTriple, PositiveMetres, PositiveNumber, Sizes, default

#: Half size of a turbulent field without sides, in outer scales.
ENDLESS = 1e3
#: Boxes into which `Turbulence.extremes` cuts the boxes it is asked for, all in all, at most.
BOUND_BOXES = 2_200_000
#: Modes are summed eight at a time.
LANES = 8


def random_directions(random: np.random.Generator, count: int) -> Array:
    """Unit vectors (count, 3), isotropic."""
    vectors = random.standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@lru_cache(maxsize=32)
def turbulent_modes(field: Turbulence) -> NDArray[np.float32]:
    """Modes (5, n) of a field: wave vector in turns per outer scale, phase in turns, amplitude in ln n.

    Wave numbers are drawn one from each of n equal intervals of ln k.  A power spectrum k^(-slope - 2) in three
    dimensions leaves k^(-slope) dk = k^(1 - slope) dln k in each, which half the squared amplitude follows.
    """
    random = np.random.default_rng(field.seed)
    n = field.modes
    span = np.log(field.outer_scale / field.inner_scale)
    k = np.exp(span * (np.arange(n) + random.random(n)) / n)
    modes = np.zeros((5, -(-n // LANES) * LANES), np.float32)
    modes[:3, :n] = (k[:, None] * random_directions(random, n)).T
    modes[3, :n] = random.random(n)
    power = k ** (1 - field.slope)
    modes[4, :n] = field.deviation * np.sqrt(2 * power / power.sum())
    return modes


class Turbulence(Shape):
    """exp(sum of random cosines): a log-normal density with a power-law spectrum, 1 on average.

    A sum of Fourier modes, so it has a value at every point, the same for any resolution of pictures and grids.  Its
    mean over all space is 1 exactly: the mean of exp(a cos x) is the Bessel function I0(a), and modes are independent.

    Parameters
    ----------
    outer_scale, inner_scale : length
        Longest and shortest wave [m].
    deviation : float
        Standard deviation of ln n over all space.
    slope : float
        The power spectrum of ln n in three dimensions goes as k^(-slope - 2); 5/3 is Kolmogorov's (1941).
    seed : int
        Of the random wave vectors and phases.
    modes : int
        Number of waves.
    half_sizes : three lengths, optional
        Of a box outside which there is nothing [m]; 1000 outer scales, in place of none, when not given.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    Mean density and scatter of ln n over a volume much wider than the longest wave:

    >>> import numpy as np
    >>> from skyscatter import fields
    >>> gas = fields.Turbulence(outer_scale=1, inner_scale=0.1, deviation=0.8, seed=1)
    >>> density = gas.density(np.random.default_rng(0).uniform(-50, 50, (20_000, 3)))
    >>> f"{density.mean():.1f} {np.log(density).std():.1f}"
    '1.0 0.8'
    """

    kind: Literal["turbulence"] = "turbulence"
    outer_scale: PositiveMetres
    inner_scale: PositiveMetres
    deviation: PositiveNumber = default(1.0)
    slope: float = 5 / 3
    seed: int = 0
    modes: int = 200
    half_sizes: OptionalTriple[Sizes] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Turbulence:
        if not self.inner_scale < self.outer_scale:
            raise DomainError("inner_scale", self.inner_scale, "must lie below the outer scale")
        if not 8 <= self.modes <= 4096:
            raise DomainError("modes", self.modes, "must lie from 8 to 4096")
        if self.seed < 0:
            raise DomainError("seed", self.seed, "must be 0 or above")
        return self

    def _half(self) -> Array:
        half = (ENDLESS * self.outer_scale,) * 3 if self.half_sizes is None else self.half_sizes
        return np.array(half) / self.outer_scale

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        modes, half = turbulent_modes(self), self._half()
        offset = -float(np.log(np.i0(modes[4].astype(float))).sum())
        # A panel holds two of the shortest waves, the weakest ones; where that is too few it is halved.
        scale = 2 * self.inner_scale / self.outer_scale
        return Leaf(
            TURBULENCE, self.outer_scale, np.array([-half, half]), scale, (offset, *half), modes, (modes.shape[1],)
        )

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        from skyscatter.kernels.shapes import fill_mode_bounds

        half = self._half()
        lowest, highest = np.empty(len(low)), np.empty(len(low))
        # Outside its own box there is nothing to bound, and bounds of a smaller box are tighter.
        a, b = np.clip(low, -half, half), np.clip(high, -half, half)
        parts = int(np.clip((BOUND_BOXES / max(len(low), 1)) ** (1 / 3), 1, 8))
        modes = turbulent_modes(self)
        fill_mode_bounds(modes, np.ascontiguousarray(a), np.ascontiguousarray(b), parts, lowest, highest)
        offset = self.leaf().parameters[0]
        meets = (low <= half).all(axis=1) & (high >= -half).all(axis=1)
        inside = (low >= -half).all(axis=1) & (high <= half).all(axis=1)
        return np.where(inside, np.exp(lowest + offset), 0.0), np.where(meets, np.exp(highest + offset), 0.0)
