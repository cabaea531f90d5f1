"""Samples of a Gaussian made non-negative: each replaced by the nearest one, as the Gaussian itself measures distance.

This is what a fit to perturbed data under the constraint f >= 0 gives (Bardsley & Hansen 2020, SIAM J. Sci. Comput. 42,
A1269), so that zeros stay zeros; a posterior that is cut off at nought would push the density away from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TOLERANCE = 1e-6  #: of a standard deviation, by which a value may stay below nought before it is set to it
_JITTER = 1e-9  #: relative variance that keeps neighbours, almost the same number, apart


def project_nonnegative(sample: Array, covariance: Array) -> Array:
    """The vector f >= 0 with the least (f - sample)^T C^-1 (f - sample).

    With multipliers w >= 0 of the constraints f = sample + C w; those in force are found one after the other (Lawson &
    Hanson 1974, Solving Least Squares Problems, ch. 23, for the dual problem), which takes as many steps as the curve
    has points of contact with nought.

    Parameters
    ----------
    sample : ndarray, shape (node,)
    covariance : ndarray, shape (node, node)

    Returns
    -------
    ndarray, shape (node,)
    """
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    slack = _TOLERANCE * spread + 1e-300
    w = np.zeros_like(sample)
    active = np.zeros(len(sample), bool)
    f = sample
    for _ in range(3 * len(sample)):
        deficit = np.where(active, 0.0, -f / slack)
        worst = int(np.argmax(deficit))
        if deficit[worst] <= 1.0:
            break
        active[worst] = True
        w = _solve(sample, covariance, active, w)
        f = sample + covariance[:, active] @ w[active]
    return np.maximum(f, 0.0)


def _solve(sample: Array, covariance: Array, active: NDArray[np.bool_], old: Array) -> Array:
    """Multipliers of the constraints in force, dropping from `active` those that would have to pull downwards."""
    w = old
    while active.any():
        part = covariance[np.ix_(active, active)]
        part = part + np.diag(_JITTER * np.diagonal(part) + 1e-300)
        wanted = np.zeros_like(w)
        wanted[active] = np.linalg.solve(part, -sample[active])
        if (wanted[active] > 0).all():
            return wanted
        falling = active & (wanted <= 0)
        step = np.min(w[falling] / np.maximum(w[falling] - wanted[falling], 1e-300))
        w = w + step * (wanted - w)
        active &= w > 1e-12 * max(w.max(), 1e-300)
        w = np.where(active, w, 0.0)
    return w
