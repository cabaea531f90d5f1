"""A quadratic polynomial that stands for a slow forward model near the estimate, and how far it is to be trusted.

    F(z) ~ c + sum_i a_i u_i + sum_{i <= j} b_ij u_i u_j,        u = L^-1 (z - z_hat),   L L^T = S-hat,

fitted by least squares to runs of the model at points u that fill a ball some standard deviations in radius.  The
residuals that each run would have if it were left out tell its error, which is added to the variance of the data; it
is told again at draws of the posterior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.inversion.distributions import FARTHEST
from skyscatter.inversion.estimation import Estimate
from skyscatter.inversion.forward import Forward

Array = NDArray[np.float64]

#: Radius of the ball of runs in standard deviations: sqrt(n) + REACH for n parameters, beyond most of a posterior.
REACH = 2.0
#: Runs for each coefficient of the polynomial.
RUNS_PER_COEFFICIENT = 2


@dataclass(frozen=True)
class Emulator:
    """The polynomial.

    Attributes
    ----------
    middle : ndarray, shape (parameter,)
    root : ndarray, shape (parameter, parameter)
        L.
    coefficients : ndarray, shape (coefficient, datum)
    variance : ndarray, shape (datum,)
        Mean square of the residuals of runs that are left out.
    sigma : ndarray, shape (datum,)
        Standard deviation of the data.
    """

    middle: Array
    root: Array
    coefficients: Array
    variance: Array
    sigma: Array

    @property
    def radius(self) -> float:
        """Of the ball of runs, in standard deviations."""
        return _radius(self.middle.size)

    def distance(self, states: Array) -> Array:
        """How many standard deviations states (state, parameter) are from the middle, (state,)."""
        return np.asarray(np.linalg.norm(_scaled(states, self.middle, self.root), axis=1))

    def __call__(self, states: Array) -> Array:
        """Data (state, datum) at states (state, parameter)."""
        return np.asarray(_terms(_scaled(states, self.middle, self.root)) @ self.coefficients)

    def judge(self, forward: Forward, states: Array) -> dict[str, Any]:
        """How far it is from the model at some states."""
        true = np.array([found.value for found in forward.predictions(states)])
        off = (self(states) - true) / self.sigma
        # What matters is the misfit: its change from what the emulator says to what the model says.
        change = [
            float(np.sum(((forward.y - t) / self.sigma) ** 2) - np.sum(((forward.y - e) / self.sigma) ** 2))
            for t, e in zip(true, self(states), strict=True)
        ]
        return {
            "emulator": "quadratic",
            "emulator_error_in_sigma": float(np.sqrt(np.mean(off**2))),
            "emulator_stated_error_in_sigma": float(np.sqrt(np.mean(self.variance / self.sigma**2))),
            "emulator_change_of_chi2": [round(c - float(np.mean(change)), 4) for c in change],
        }


def build_emulator(
    forward: Forward,
    estimate: Estimate,
    seed: int,
    kept: dict[str, Any],
    keep: Callable[..., None],
    tell: Callable[[float], None],
) -> Emulator:
    """Run the model at the points of the design, which are kept one by one, and fit the polynomial."""
    n = estimate.z.size
    root = np.asarray(np.linalg.cholesky(estimate.covariance), float)
    terms = _terms(np.zeros((1, n))).shape[1]
    design = _ball(n, RUNS_PER_COEFFICIENT * terms, seed) * _radius(n)
    states = np.clip(estimate.z + design @ root.T, -FARTHEST, FARTHEST)
    runs = kept.get("design_values", np.zeros((0, estimate.value.size)))
    for found in forward.predictions(states[len(runs) :]):
        runs = np.concatenate([runs, found.value[None]])
        keep(design_values=runs)
        tell(len(runs) / len(states))
    u = _scaled(states, estimate.z, root)
    u = np.concatenate([np.zeros((1, n)), u])
    values = np.concatenate([estimate.value[None], runs])
    matrix = _terms(u)
    coefficients, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    hat = np.einsum("ij,ji->i", matrix, np.linalg.pinv(matrix))
    left_out = (values - matrix @ coefficients) / np.maximum(1 - hat, 1e-3)[:, None]
    variance = np.mean(left_out**2, axis=0)
    return Emulator(estimate.z, root, coefficients, variance, np.sqrt(estimate.variance))


def _radius(n: int) -> float:
    return float(np.sqrt(n) + REACH)


def _scaled(states: Array, middle: Array, root: Array) -> Array:
    """U (state, parameter) of states."""
    return np.asarray(np.linalg.solve(root, (np.atleast_2d(states) - middle).T).T, float)


def _terms(u: Array) -> Array:
    """1, u_i, u_i u_j with i <= j; (state, coefficient)."""
    n = u.shape[1]
    i, j = np.triu_indices(n)
    return np.concatenate([np.ones((len(u), 1)), u, u[:, i] * u[:, j]], axis=1)


def _ball(n: int, count: int, seed: int) -> Array:
    """Points that fill the unit ball in n dimensions (count, n)."""
    rng = np.random.default_rng([seed, n, count])
    direction = rng.standard_normal((count, n))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.asarray(direction * ((np.arange(count) + 0.5) / count)[:, None] ** (1.0 / n))
