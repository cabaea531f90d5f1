"""Optimal estimation after Rodgers (2000), Inverse Methods for Atmospheric Sounding.

The state z holds one standard normal variable for each parameter (`distributions`), so that his a priori is x_a = 0 and
S_a = I, exactly.  The cost

    J(z) = (y - F(z))^T S_e^-1 (y - F(z)) + z^T z                                    (his equation 5.3)

is minimised by Gauss-Newton steps in his n-form, damped after Levenberg and Marquardt (5.35), with D the diagonal of
the curvature:

    z' = z + (S^-1 + gamma D)^-1 [K^T S_e^-1 (y - F(z)) - z],        S^-1 = K^T S_e^-1 K + I

S_e is diagonal: the variance of the noise plus that which the solver states for itself.  Where it depends on F
(noise that is a share of the signal) it is that of the latest F, and steps are judged with one S_e for both their ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.inversion.distributions import FARTHEST
from skyscatter.inversion.observations import Linearisation, Prediction

Array = NDArray[np.float64]

#: Steps of the derivatives in z: the standard deviation of the estimate, within these.
LEAST_STEP, LARGEST_STEP = 0.003, 0.03
#: Longest change of one z in one iteration: beyond it the linear model has nothing to say.
LONGEST = 1.5
#: Converged when a step is shorter than this share of n in the metric of the covariance (Rodgers, 5.29: "<< n").
SHORT = 0.01
#: No better cost is found at any damping above this.
MOST_DAMPING = 1e6


class Problem(Protocol):
    """Data and their model in terms of z."""

    @property
    def y(self) -> Array:
        """The data (datum,)."""

    def noise_variance(self, value: Array) -> Array:
        """Variance of their noise (datum,) where the model says `value`."""

    def predict(self, z: Array) -> Prediction:
        """The model at z."""

    def linearise(self, z: Array, steps: Array) -> Linearisation:
        """The model at z and its derivatives."""


class Point(NamedTuple):
    """The linear problem at one state."""

    z: Array
    linear: Linearisation
    variance: Array  #: diagonal of S_e (datum,)
    cost: float
    gradient: Array  #: K^T S_e^-1 (y - F) - z
    inverse: Array  #: S^-1


@dataclass(frozen=True)
class Estimate:
    """The state of least cost, and what is known of it.

    Attributes
    ----------
    z : ndarray, shape (parameter,)
    covariance : ndarray, shape (parameter, parameter)
        S-hat = (K^T S_e^-1 K + I)^-1 (Rodgers 2000, 5.38).
    averaging_kernel : ndarray, shape (parameter, parameter)
        A = S-hat K^T S_e^-1 K, how the estimate answers to the truth (2.78 and 5.39); its trace is the number of
        degrees of freedom for signal (2.80).
    noise_covariance, smoothing_covariance : ndarray, shape (parameter, parameter)
        G S_e G^T and (A - I)(A - I)^T (3.30 and 3.31): what noise does, and what leaning on the prior does.
    value, model_error, variance : ndarray, shape (datum,)
        F at the estimate, what its solver states as its error, and the diagonal of S_e.
    jacobian : ndarray, shape (datum, parameter)
    chi2 : float
        Of the residual alone, by S_e.
    cost : float
        chi2 + z^T z.
    iterations : int
    converged : bool
    """

    z: Array
    covariance: Array
    averaging_kernel: Array
    noise_covariance: Array
    smoothing_covariance: Array
    value: Array
    model_error: Array
    variance: Array
    jacobian: Array
    chi2: float
    cost: float
    iterations: int
    converged: bool


def optimal_estimation(
    problem: Problem,
    start: Array,
    *,
    max_iterations: int = 20,
    kept: Mapping[str, Any] | None = None,
    keep: Callable[[dict[str, Any]], None] | None = None,
    check: Callable[[Array], None] | None = None,
) -> Estimate:
    """Minimise the cost from a start.

    Parameters
    ----------
    problem : Problem
    start : ndarray, shape (parameter,)
        First guess of z.
    max_iterations : int
    kept : mapping, optional
        What `keep` was last called with by an interrupted run, which goes on to the same numbers.
    keep : callable, optional
        Called at the start and after each iteration with all that is needed to go on.
    check : callable, optional
        Called with the model at the start (datum,), before any step; it may refuse to go on.

    Returns
    -------
    Estimate
        ``converged`` is False where `max_iterations` were not enough.

    Raises
    ------
    ConvergenceError
        If the model is not finite, or no step lowers the cost though the gradient says so.
    """
    converged, count, lowered, gamma = False, 0, False, 0.0
    if kept is not None and "at_jacobian" in kept:
        here = _judge(problem, kept["z"], Linearisation(*(kept[f"at_{name}"] for name in Linearisation._fields)))
        converged, count, lowered = bool(kept["converged"]), int(kept["iterations"]), bool(kept["lowered"])
        gamma = float(kept["gamma"])
    else:
        here = _point(problem, np.clip(start, -FARTHEST, FARTHEST), np.full(start.size, LARGEST_STEP))
        if check is not None:
            check(here.linear.value)

    def tell() -> None:
        if keep is not None:
            where = {f"at_{name}": value for name, value in here.linear._asdict().items()}
            state = {"z": here.z, "gamma": gamma, "iterations": count, "lowered": lowered, "converged": converged}
            keep({**state, **where})

    tell()
    while count < max_iterations and not converged:
        # The whole step says how far it is to the minimum; one that damping has shortened would always say: near.
        whole = _step(here, 0.0)
        nearly = float(whole @ here.inverse @ whole) < SHORT * start.size
        there = _try(problem, here, _step(here, gamma), gamma, nearly)
        # By one variance for both, which is that of the slope; it may depend on the state itself.  Within the model's
        # own rounding (solvers state theirs) equal costs are no failure.
        if there is not None and _cost(problem, there.linear.value, there.z, here.variance) <= here.cost + 0.1 * nearly:
            converged = nearly and gamma < 1.0
            here, gamma, lowered = there, (gamma / 10 if gamma > 1e-3 else 0.0), True
        elif nearly:
            converged = True
        else:
            gamma = max(10 * gamma, 0.1)
            if gamma > MOST_DAMPING:
                if lowered:  # as far down as the model's roughness lets it come
                    break
                raise ConvergenceError(
                    "no step lowers the misfit although its slope says so: the forward model is too rough for its "
                    "derivatives; lower the tolerance, or take more samples"
                )
        count += 1
        tell()
    return _estimate(here, problem, count, converged)


def _point(problem: Problem, z: Array, steps: Array) -> Point:
    linear = problem.linearise(z, steps)
    return _judge(problem, z, linear)


def _judge(problem: Problem, z: Array, linear: Linearisation) -> Point:
    if not (np.all(np.isfinite(linear.value)) and np.all(np.isfinite(linear.jacobian))):
        raise ConvergenceError("the forward model is not finite there; narrow the bounds of the parameters")
    variance = problem.noise_variance(linear.value) + linear.error**2
    residual = problem.y - linear.value
    weighted = linear.jacobian / variance[:, None]
    return Point(
        z, linear, variance, _cost(problem, linear.value, z, variance),
        weighted.T @ residual - z, weighted.T @ linear.jacobian + np.eye(z.size),
    )  # fmt: skip


def _cost(problem: Problem, value: Array, z: Array, variance: Array) -> float:
    return float(np.sum((problem.y - value) ** 2 / variance) + z @ z)


def _step(here: Point, gamma: float) -> Array:
    damped = here.inverse + gamma * np.diag(np.diag(here.inverse))
    step = np.asarray(np.linalg.solve(damped, here.gradient), float)
    longest = float(np.abs(step).max(initial=0.0))
    return step if longest <= LONGEST else step * (LONGEST / longest)


def _try(problem: Problem, here: Point, step: Array, gamma: float, nearly: bool) -> Point | None:
    """The point a step further on; None where its cost is higher.

    After a failure the cost is looked at before derivatives are paid for; at the end those of the last point will do.
    """
    z = np.clip(here.z + step, -FARTHEST, FARTHEST)
    if nearly:
        there = problem.predict(z)
        return _judge(problem, z, Linearisation(there.value, there.error, here.linear.jacobian))
    if gamma > 0:
        there = problem.predict(z)
        if not _cost(problem, there.value, z, here.variance) <= here.cost:
            return None
    deviation = np.sqrt(np.diag(np.linalg.inv(here.inverse)))
    return _point(problem, z, np.clip(deviation, LEAST_STEP, LARGEST_STEP))


def _estimate(here: Point, problem: Problem, count: int, converged: bool) -> Estimate:
    inverted = np.linalg.inv(here.inverse)
    covariance = np.asarray(0.5 * (inverted + inverted.T), float)
    information = here.inverse - np.eye(here.z.size)  # K^T S_e^-1 K
    kernel = covariance @ information
    lost = kernel - np.eye(here.z.size)
    residual = problem.y - here.linear.value
    return Estimate(
        z=here.z, covariance=covariance, averaging_kernel=kernel,
        noise_covariance=covariance @ information @ covariance, smoothing_covariance=lost @ lost.T,
        value=here.linear.value, model_error=here.linear.error, variance=here.variance, jacobian=here.linear.jacobian,
        chi2=float(np.sum(residual**2 / here.variance)), cost=here.cost, iterations=count, converged=converged,
    )  # fmt: skip
