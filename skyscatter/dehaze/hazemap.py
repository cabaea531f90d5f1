"""From what single cells say of the haze to a map of it: smooth where nothing speaks against it, with edges.

The map minimises

    sum_c (a_c - m_c)^2 / s_c^2 + sum_c (a_c - A)^2 / S^2 + 2 sum_<cd> h(a_c - a_d) / t ,

m_c and s_c what a cell says and how surely, A and S the image's haze and how far it may vary, and h the absolute value,
rounded below a small step (total variation: Rudin, Osher & Fatemi 1992, Physica D 60, 259; rounded so that iteratively
reweighted least squares solve it).  A front of haze costs its height, however sharp it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

ITERATIONS = 30
#: Step of optical depth below which differences count by their square.
ROUNDED = 0.004
#: t: a step of that height between two cells costs as much as two errors of one standard deviation.
STEP = 0.08
BLURRED = 5  #: cells over which such variances are averaged
APART = 12  #: cells between those whose variances are asked for together


def regularised(said: Array, sigma: Array, mean: float, spread: float, step: float = STEP) -> tuple[Array, Array]:
    """The map and its standard deviation.

    Parameters
    ----------
    said, sigma : array, shape (row, column)
        What cells say, and its standard deviation; infinite where a cell says nothing.
    mean, spread : float
        Haze of the image, and how far it may vary within.
    step : float
        Smoothness: smaller is smoother.

    Returns
    -------
    map, sigma : array, shape (row, column)
        The latter by the curvature of the minimised sum.
    """
    shape = said.shape
    first, second = neighbours(shape)
    precision = np.where(np.isfinite(sigma), 1 / np.maximum(sigma, 1e-6) ** 2, 0.0).ravel()
    target = np.where(precision > 0, said.ravel(), mean)
    hold = 1 / spread**2
    right = precision * target + hold * mean
    a = np.full(said.size, mean)
    for _ in range(ITERATIONS):
        weight = 1 / (step * np.sqrt((a[first] - a[second]) ** 2 + ROUNDED**2))
        matrix = curvature(precision + hold, first, second, weight)
        factor = splu(matrix)
        new = factor.solve(right)
        moved = float(np.abs(new - a).max())
        a = new
        if moved < 1e-5:
            break
    return np.maximum(a, 0.0).reshape(shape), np.sqrt(diagonal_of_inverse(factor, shape))


def neighbours(shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of cells side by side, by number."""
    number = np.arange(int(np.prod(shape))).reshape(shape)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return first, second


def curvature(diagonal: Array, first: NDArray[np.int64], second: NDArray[np.int64], weight: Array) -> csc_matrix:
    """Half of the second derivative of the sum: a diagonal, and weighted differences between neighbours."""
    n = diagonal.size
    apart = coo_matrix((weight, (first, second)), shape=(n, n))
    whole = diagonal + np.bincount(first, weight, n) + np.bincount(second, weight, n)
    return csc_matrix(diags(whole) - apart - apart.T)


def diagonal_of_inverse(factor: object, shape: tuple[int, ...]) -> Array:
    """Diagonal of the inverse of a factored matrix of cells, by probes (Tang & Saad 2012, Numer. Linear Algebra Appl.
    19, 485): cells far apart are asked for together, for they have next to nothing to do with each other.

    They have something where the map is smooth, so that single variances are off by a third; means over neighbours are
    not.  Exact on lattices of no more than `APART` cells on a side.
    """
    random = np.random.default_rng(20070101)
    diagonal = np.empty(shape)
    for row in range(min(APART, shape[0])):
        for col in range(min(APART, shape[1])):
            probe = np.zeros(shape)
            asked = probe[row::APART, col::APART]
            # With random signs, what little is left of the others cancels on the average.
            signs = random.choice([-1.0, 1.0], asked.shape)
            asked[:] = signs
            answer = factor.solve(probe.ravel()).reshape(shape)  # type: ignore[attr-defined]
            diagonal[row::APART, col::APART] = signs * answer[row::APART, col::APART]
    if max(shape) > APART:
        # The noise of probes side by side is independent; variances hardly change within so few cells.
        diagonal = uniform_filter(diagonal, BLURRED, mode="nearest")
    return np.maximum(diagonal, 1e-2 * float(np.median(diagonal)))
