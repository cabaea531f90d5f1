"""Samples of a Gaussian made non-negative: each replaced by the nearest one, as the Gaussian itself measures distance.

This is what a fit to perturbed data under the constraint f >= 0 gives (Bardsley & Hansen 2020, SIAM J. Sci. Comput. 42,
A1269), so that zeros stay zeros; a posterior that is cut off at zero would push the density away from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_TOLERANCE = 1e-6  #: of a standard deviation, by which a value may stay below zero before it is set to it
_PATIENCE = 3  #: tries without fewer violations before constraints are taken one by one
_JITTER = 1e-9  #: relative variance that keeps neighbours, almost the same number, apart


def project_nonnegative(sample: Array, covariance: Array) -> Array:
    """The vector f >= 0 with the least (f - sample)^T C^-1 (f - sample).

    With multipliers w >= 0 of the constraints, f = sample + C w.  Which constraints are in force is found by block
    pivoting (Portugal, Judice & Vicente 1994, Math. Comp. 63, 625), all that are violated changing sides at once; where
    the covariance is so smooth that this leads nowhere, one after the other (Lawson & Hanson 1974, Solving Least
    Squares Problems, ch. 23, for the dual problem), which then takes few steps.

    Parameters
    ----------
    sample : ndarray, shape (node,)
    covariance : ndarray, shape (node, node)

    Returns
    -------
    ndarray, shape (node,)
    """
    variance = np.maximum(np.diagonal(covariance), 0.0)
    jitter, slack = _JITTER * variance + 1e-300, _TOLERANCE * np.sqrt(variance) + 1e-300
    f = _by_blocks(sample, covariance, jitter, slack)
    if f is None:
        f = _one_by_one(sample, covariance, jitter, slack)
    return np.maximum(f, 0.0)


def _multipliers(sample: Array, covariance: Array, jitter: Array, chosen: Indices) -> tuple[Array, Array]:
    """Multipliers of the chosen constraints that make f zero there, and the columns of the covariance they need."""
    columns = covariance[:, chosen]
    part = columns[chosen]
    part[np.diag_indices(len(chosen))] += jitter[chosen]
    return np.asarray(np.linalg.solve(part, -sample[chosen]), float), columns


def _by_blocks(sample: Array, covariance: Array, jitter: Array, slack: Array) -> Array | None:
    active = sample < -slack
    fewest, patience = len(sample) + 1, _PATIENCE
    while patience > 0:
        chosen = np.flatnonzero(active)
        w, columns = _multipliers(sample, covariance, jitter, chosen)
        f: Array = sample + columns @ w
        wrong = ~active & (f < -slack)
        wrong[chosen[w < 0]] = True
        count = int(wrong.sum())
        if count == 0:
            return f
        if count < fewest:
            fewest = count
        else:
            patience -= 1
        active ^= wrong
    return None


def _one_by_one(sample: Array, covariance: Array, jitter: Array, slack: Array) -> Array:
    w = np.zeros_like(sample)
    active = np.zeros(len(sample), bool)
    f = sample
    for _ in range(3 * len(sample)):
        deficit = np.where(active, 0.0, -f / slack)
        worst = int(np.argmax(deficit))
        if deficit[worst] <= 1.0:
            break
        active[worst] = True
        while active.any():
            chosen = np.flatnonzero(active)
            wanted, columns = _multipliers(sample, covariance, jitter, chosen)
            falling = wanted <= 0
            if not falling.any():
                w[chosen] = wanted
                f = sample + columns @ wanted
                break
            # As far towards these as none of them would have to pull down, and those that come to zero are let go.
            old = w[chosen]
            step = np.min(old[falling] / np.maximum(old[falling] - wanted[falling], 1e-300))
            moved = old + step * (wanted - old)
            w[chosen] = np.where(moved > 1e-12 * moved.max(), moved, 0.0)
            active = w > 0
    return f
