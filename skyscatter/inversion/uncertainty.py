"""Standard deviations of voxels: samples of the posterior about the estimate (Laplace's approximation).

With the images linear about the estimate, and the prior as curved as it is there, the posterior is Gaussian with the
inverse Hessian H^-1 = (J^T W J + weight R'')^-1 as its covariance.  The solution of H s = J^T W^1/2 e + weight^1/2 n,
with e standard normal and n of covariance R'', is a sample of it (Papandreou & Yuille 2010): perturb data and
prior, then optimise.  Each costs one solution by conjugate gradients of tangent and adjoint passes.

Densities that touch zero are treated as if they could go below: their deviations are upper bounds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.problem import Problem

Array = NDArray[np.float64]

#: Residual, relative to the right side, at which a solution is good enough beside the spread of a few samples.
SOLVED = 1e-2
MOST_STEPS = 200


def posterior_samples(problem: Problem, x: Array, weight: float, stretch: Array, count: int, seed: int) -> list[Array]:
    """Samples of (density - estimate), in units of the typical density, each of the shape of x."""
    if count < 4:
        raise DomainError("deviation", count, "at least 4 samples; they tell a deviation to 1 / sqrt(2 samples)")
    rng, root, frame = np.random.default_rng(seed), np.sqrt(problem.weight), problem.model.frame

    def hessian(v: Array) -> Array:
        bend = np.stack([problem.prior.curvature(a, b, frame) for a, b in zip(x, v, strict=True)])
        return problem.pull(x, problem.weight * problem.push(x, v)) + weight * bend

    samples = []
    for _ in range(count):
        right = problem.pull(x, root * rng.normal(size=root.shape))
        right += np.sqrt(weight) * np.stack([problem.prior.noise(part, rng, frame) for part in x])
        samples.append(_solve(hessian, right, stretch))
    return samples


def posterior_deviation(problem: Problem, x: Array, weight: float, stretch: Array, count: int, seed: int) -> Array:
    """Root mean square of `posterior_samples`; its own relative error is 1 / sqrt(2 count)."""
    samples = posterior_samples(problem, x, weight, stretch, count, seed)
    deviation: Array = np.sqrt(np.mean(np.square(samples), axis=0))
    return deviation


def degrees_of_freedom(problem: Problem, x: Array, weight: float, stretch: Array, seed: int) -> float:
    """How many data the estimate follows: the trace of J H^-1 J^T W (Wahba 1983, J. R. Stat. Soc. B 45, 133).

    From one vector of random signs z, as z^T W^1/2 J H^-1 J^T W^1/2 z (Hutchinson 1990, Commun. Stat. Simul. 19, 433):
    its relative error is below sqrt(2 / trace).  Densities that touch zero follow no data.
    """
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], problem.weight.shape)
    root, frame, loose = np.sqrt(problem.weight), problem.model.frame, (x > 0).astype(float)

    def hessian(v: Array) -> Array:
        v = loose * v
        bend = np.stack([problem.prior.curvature(a, b, frame) for a, b in zip(x, v, strict=True)])
        return loose * (problem.pull(x, problem.weight * problem.push(x, v)) + weight * bend)

    right = loose * problem.pull(x, root * signs)
    return float(np.sum(right * _solve(hessian, right, stretch)))


def _solve(hessian: object, right: Array, stretch: Array) -> Array:
    """Conjugate gradients in unknowns scaled by `stretch`."""
    from scipy.sparse.linalg import LinearOperator, cg

    def scaled(y: Array) -> Array:
        return (hessian(y.reshape(right.shape) * stretch) * stretch).ravel()  # type: ignore[operator]

    operator = LinearOperator((right.size, right.size), matvec=scaled, dtype=float)
    found, _ = cg(operator, (right * stretch).ravel(), rtol=SOLVED, maxiter=MOST_STEPS)
    return np.asarray(found.reshape(right.shape) * stretch)
