"""Smooth curves through tables of the sky, and look-up between the nodes of regular grids."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]


def unit_vectors(name: str, directions: ArrayLike) -> Array:
    """Directions as an array of unit vectors.

    Parameters
    ----------
    name : str
        For errors.
    directions : array_like, shape (..., 3)
        Of any length but zero; NaN stays NaN.

    Returns
    -------
    ndarray, shape (..., 3)

    Raises
    ------
    DomainError
        If the last axis has not three entries, or a vector has no length.
    """
    given = np.asarray(directions, dtype=float)
    if given.ndim == 0 or given.shape[-1] != 3:
        raise DomainError(name, given.shape, "is an array of vectors: its last axis has 3 entries")
    length = np.sqrt(np.einsum("...i,...i->...", given, given))
    if np.any(length == 0.0):
        raise DomainError(name, [0.0, 0.0, 0.0], "a direction has a length above zero")
    return np.asarray(given / length[..., None])


def flat_spline(nodes: Array, values: Array, points: Array) -> Array:
    """Cubic spline with a slope of zero at both ends, along the first axis.

    Parameters
    ----------
    nodes : ndarray, shape (node,)
        Increasing.
    values : ndarray, shape (node, ...)
    points : ndarray, shape (point,)
        Within the nodes.

    Returns
    -------
    ndarray, shape (point, ...)
    """
    # Slopes at the nodes from the continuity of the second derivative (any text on splines), as a dense system:
    # a few dozen nodes.
    step = np.diff(nodes)
    rise = np.diff(values, axis=0) / step.reshape(-1, *[1] * (values.ndim - 1))
    system, right = np.eye(len(nodes)), np.zeros(values.shape)
    for k in range(1, len(nodes) - 1):
        system[k, k - 1 : k + 2] = 1.0 / step[k - 1], 2.0 / step[k - 1] + 2.0 / step[k], 1.0 / step[k]
        right[k] = 3.0 * (rise[k - 1] / step[k - 1] + rise[k] / step[k])
    slope = np.linalg.solve(system, right.reshape(len(nodes), -1)).reshape(values.shape)
    i = np.clip(np.searchsorted(nodes, points, side="right") - 1, 0, len(step) - 1)
    width = step[i]
    t = (points - nodes[i]) / width
    weights = ((1 + 2 * t) * (1 - t) ** 2, t * t * (3 - 2 * t), t * (1 - t) ** 2 * width, t * t * (t - 1) * width)
    ends = (values[i], values[i + 1], slope[i], slope[i + 1])
    return np.asarray(sum(w.reshape(-1, *[1] * (values.ndim - 1)) * e for w, e in zip(weights, ends, strict=True)))


def bilinear(table: NDArray[np.floating], row: Array, column: Array) -> Array:
    """A table on a grid, linear between its nodes in both directions.

    Parameters
    ----------
    table : ndarray, shape (row, column, ...)
    row, column : ndarray, shape (point,)
        Places in units of nodes, from 0 to one less than their number; outside of it the edge counts.  NaN gives NaN.

    Returns
    -------
    ndarray, shape (point, ...)
    """
    i, u = _cell(row, table.shape[0])
    j, v = _cell(column, table.shape[1])
    flat = table.reshape(table.shape[0] * table.shape[1], *table.shape[2:])
    first, wide = i * table.shape[1] + j, table.shape[1]
    u, v = (part.reshape(-1, *[1] * (table.ndim - 2)) for part in (u, v))
    near = flat[first] * (1 - v) + flat[first + 1] * v
    far = flat[first + wide] * (1 - v) + flat[first + wide + 1] * v
    return np.asarray(near * (1 - u) + far * u)


def _cell(place: Array, count: int) -> tuple[NDArray[np.intp], Array]:
    """Cell of each place, and how far it is within."""
    inside = np.clip(place, 0.0, count - 1.0)
    cell = np.minimum(np.nan_to_num(inside).astype(np.intp), count - 2)
    return cell, inside - cell
