"""Cubic splines of radius and their projections along straight lines, in closed form.

A spherically symmetric density f(r) that ends at R is seen at the distance y from its centre as

    F(y) = 2 integral of f(r) r / sqrt(r^2 - y^2) dr from y to R     (119 of docs/theory/abel.md)

(Abel 1826, J. reine angew. Math. 1, 153).  On a stretch where f is a cubic the integrals are elementary.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_NODES = 200  #: more are not needed: what is finer than R / 200 no projection with noise can tell


def _primitives(radius: Array, impact: Array) -> Array:
    """Primitives of 2 r^(k + 1) / sqrt(r^2 - y^2), k = 0 to 3, zero at r = y; shape (4, ...).

    With l = sqrt(r^2 - y^2) and q = r l + y^2 ln((r + l) / y): 2 l, q, 2 l^3 / 3 + 2 y^2 l, r^3 l / 2 + 3 y^2 q / 4.
    """
    square = impact**2
    length = np.sqrt(np.maximum(radius**2 - square, 0.0))
    # asinh(l / y) is the logarithm without its cancellation for small l; y^2 times it vanishes at y = 0.
    log = np.arcsinh(np.divide(length, impact, out=np.zeros_like(length), where=impact > 0))
    q = radius * length + square * log
    return np.stack(
        [2 * length, q, 2 * length**3 / 3 + 2 * square * length, radius**3 * length / 2 + 0.75 * square * q]
    )


def spline_pieces(nodes: Array) -> Array:
    """Cubic splines that are 1 at one node and 0 at the others, as powers of r.

    Parameters
    ----------
    nodes : ndarray, shape (node,)
        Increasing radii [any unit], four at least.

    Returns
    -------
    ndarray, shape (4, node - 1, node)
        Coefficient of r^k on each stretch of each spline.
    """
    from scipy.interpolate import CubicSpline

    local = CubicSpline(nodes, np.eye(len(nodes)), bc_type="not-a-knot").c[::-1]  # powers of r - a, lowest first
    a = nodes[:-1, None]
    return np.stack(
        [
            local[0] - a * local[1] + a**2 * local[2] - a**3 * local[3],
            local[1] - 2 * a * local[2] + 3 * a**2 * local[3],
            local[2] - 3 * a * local[3],
            local[3],
        ]
    )


def projection_matrix(nodes: Array, impact: Array) -> Array:
    """Projections, equation 119 of the theory, of the splines that are 1 at one node and 0 at the others.

    Parameters
    ----------
    nodes : ndarray, shape (node,)
        Radii; the density is zero beyond the last one.
    impact : ndarray, shape (point,)
        Distances of the lines of sight from the centre, in the same unit.

    Returns
    -------
    ndarray, shape (point, node)
        Times densities at the nodes: projections, in density times the unit of length.
    """
    return _projection_matrix(nodes.tobytes(), np.ascontiguousarray(impact).tobytes()).copy()


@lru_cache(maxsize=8)
def _projection_matrix(nodes_bytes: bytes, impact_bytes: bytes) -> Array:
    nodes, impact = np.frombuffer(nodes_bytes), np.frombuffer(impact_bytes)
    unit = nodes[-1]  # in units of the edge no power overflows
    pieces = spline_pieces(nodes / unit)
    y = impact / unit
    at_nodes = _primitives(
        np.maximum(nodes[None, :] / unit, y[:, None]), np.broadcast_to(y[:, None], (len(y), len(nodes)))
    )
    matrix: Array = np.einsum("kpi,kij->pj", np.diff(at_nodes, axis=2), pieces, optimize=True) * unit
    return matrix


def spline_values(nodes: Array, radius: Array) -> Array:
    """Values of the same splines at other radii, shape (point, node); zero beyond the last node."""
    from scipy.interpolate import CubicSpline

    inside = radius <= nodes[-1] * (1 + 1e-12)
    values: Array = np.where(
        inside[:, None], CubicSpline(nodes, np.eye(len(nodes)))(np.minimum(radius, nodes[-1])), 0.0
    )
    return values


def nodes_for(radius: Array, edge: float) -> Array:
    """Nodes from 0 to the edge: the radii themselves where they are few enough, else evenly spread."""
    inner = radius[(radius > 0) & (radius < edge)]
    # Radii closer to an end than half their spacing would make a lone narrow stretch.
    gap = edge / max(len(inner) + 1, 1)
    inner = inner[(inner > 0.3 * gap) & (inner < edge - 0.3 * gap)]
    if 2 <= len(inner) <= MOST_NODES and np.diff(np.concatenate([[0.0], inner, [edge]])).max() < 4 * gap:
        return np.concatenate([[0.0], inner, [edge]])
    count = int(np.clip(len(inner) + 2, 16, MOST_NODES + 1))
    return np.linspace(0.0, edge, count)
