"""Misfit and prior of a density as one number with its derivative, and how it is brought down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.inversion.priors import Prior
from skyscatter.inversion.views import Stack
from skyscatter.inversion.voxelimage import VoxelModel

Array = NDArray[np.float64]

#: Random sign vectors from which the diagonal of the Hessian is estimated; it only scales the unknowns.
PROBES = 4
#: Share of its mean below which the diagonal is not let fall: cells that no ray sees move with the others.
LEAST_DIAGONAL = 1e-2


@dataclass
class Best:
    """What a minimisation has reached; kept up to date, so that an interruption loses nothing."""

    x: Array
    value: float = np.inf
    chi2: float = np.inf
    iterations: int = 0
    evaluations: int = 0


@dataclass(frozen=True)
class Problem:
    """chi^2 / 2 + weight * sum of priors, of densities in units of `scale`.

    Attributes
    ----------
    model : VoxelModel
    stack : Stack
    offset : (pixel, wavelength)
        Light that the model leaves out (multiple scattering).
    extra : (pixel, wavelength)
        Variance of `offset`, added to that of the data.
    prior : Prior
        Of each free component.
    free : (component,) bool
        Components that are sought.
    fixed : (component, x, y, z)
        Densities of the others.
    scale : (component,)
        Typical densities.
    """

    model: VoxelModel
    stack: Stack
    offset: Array
    extra: Array
    prior: Prior
    free: NDArray[np.bool_]
    fixed: Array
    scale: Array

    @property
    def weight(self) -> Array:
        """One over the variance (pixel, wavelength)."""
        w = self.stack.weight
        return w / (1 + w * self.extra)

    def density(self, x: Array) -> Array:
        """Densities (component, x, y, z) of the unknowns x (free component, x, y, z)."""
        rho = self.fixed.copy()
        rho[self.free] = x * self.scale[self.free][:, None, None, None]
        return rho

    def images(self, x: Array) -> Array:
        """What the views should show (pixel, wavelength)."""
        light = self.model.image(self.density(x), self.stack.origins, self.stack.directions)
        return self._pixels(light) + self.offset

    def misfit(self, x: Array) -> tuple[float, Array]:
        """chi^2 and the derivative of half of it."""
        s, rho = self.stack, self.density(x)
        target, w = s.data - self.offset, self.weight
        if s.rays == 1:
            light, slope = self.model.gradient(rho, s.origins, s.directions, w, data=target)
            miss = light - target
        else:
            ready = self.model.prepare(rho)
            miss = self._pixels(self.model.image(ready, s.origins, s.directions)) - target
            each = np.repeat(w * miss / s.rays, s.rays, axis=0)
            _, slope = self.model.gradient(ready, s.origins, s.directions, each)
        return float(np.sum(w * miss**2)), self._inward(slope.density)

    def pull(self, x: Array, weights: Array) -> Array:
        """Transpose of the derivative of the images, applied to weights (pixel, wavelength)."""
        s = self.stack
        each = np.repeat(weights / s.rays, s.rays, axis=0)
        return self._inward(self.model.gradient(self.density(x), s.origins, s.directions, each)[1].density)

    def push(self, x: Array, change: Array) -> Array:
        """Derivative of the images along a change of x."""
        s, moved = self.stack, np.zeros_like(self.fixed)
        moved[self.free] = change * self.scale[self.free][:, None, None, None]
        return self._pixels(self.model.tangent(self.density(x), moved, s.origins, s.directions)[1])

    def _inward(self, slope: Array) -> Array:
        return slope[self.free] * self.scale[self.free][:, None, None, None]

    def _pixels(self, light: Array) -> Array:
        n = self.stack.rays
        return light if n == 1 else light.reshape(-1, n, light.shape[1]).mean(axis=1)

    def penalty(self, x: Array) -> tuple[float, Array]:
        """Sum of the priors and its derivative."""
        parts = [self.prior.value(part, self.model.frame) for part in x]
        return sum(p[0] for p in parts), np.stack([p[1] for p in parts])

    def data_diagonal(self, x: Array, seed: int = 0) -> Array:
        """Estimate of the diagonal of the misfit's Gauss-Newton Hessian, like x.

        The mean of (J^T W^1/2 z)^2 over random signs z (Bekas, Kokiopoulou & Saad 2007), smoothed over three cells a
        side, for it varies as slowly as the light.
        """
        from scipy.ndimage import uniform_filter

        rng, root = np.random.default_rng(seed), np.sqrt(self.weight)
        total = np.zeros_like(x)
        for _ in range(PROBES):
            total += self.pull(x, root * rng.choice([-1.0, 1.0], root.shape)) ** 2
        return np.stack([uniform_filter(part, 3, mode="nearest") for part in total / PROBES])

    def prior_diagonal(self, x: Array) -> Array:
        """Diagonal of the priors' second derivative."""
        return np.stack([self.prior.diagonal(part, self.model.frame) for part in x])

    def stretch(self, x: Array, data_diagonal: Array, weight: float) -> Array:
        """Lengths by which unknowns are scaled so that the Hessian has about ones on its diagonal."""
        diagonal = data_diagonal + weight * self.prior_diagonal(x)
        floor = LEAST_DIAGONAL * diagonal.mean(axis=(1, 2, 3), keepdims=True)
        return 1 / np.sqrt(np.maximum(diagonal, np.maximum(floor, 1e-300)))

    def minimise(
        self, x: Array, weight: float, stretch: Array, best: Best, iterations: int, stop: float,
        tick: Callable[[], None] | None = None,
    ) -> Best:  # fmt: skip
        """Bring the sum down from x by a bounded quasi-Newton method (L-BFGS-B, Byrd et al. 1995).

        `best` is filled as it goes on; it stops when a step gains less than the share `stop`.
        """
        from scipy.optimize import minimize

        def value(flat: Array) -> tuple[float, Array]:
            y = flat.reshape(x.shape) * stretch
            chi2, slope = self.misfit(y)
            penalty, bend = self.penalty(y)
            total = 0.5 * chi2 + weight * penalty
            best.evaluations += 1
            if total < best.value:
                best.x, best.value, best.chi2 = y, total, chi2
            if tick is not None:
                tick()
            return total, ((slope + weight * bend) * stretch).ravel()

        best.value = np.inf
        options: dict[str, Any] = {"maxiter": iterations, "ftol": stop, "gtol": 0.0, "maxcor": 12}
        options["maxfun"] = 4 * iterations
        found = minimize(
            value, (x / stretch).ravel(), jac=True, method="L-BFGS-B", bounds=[(0.0, None)] * x.size, options=options
        )
        best.iterations += int(found.nit)
        return best
