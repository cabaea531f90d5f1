"""Making what the kernels of particles read: the tree, and particles spread over the cells of a grid."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import entry, inlined
from skyscatter.kernels.particles import spline


@inlined
def select(points, order, a, b, middle, axis):
    """Reorder rows a to b - 1 so that those before `middle` do not lie above it along an axis (Hoare 1961)."""
    b -= 1
    while a < b:
        pivot = points[(a + b) >> 1, axis]
        i, j = a, b
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    points[i, k], points[j, k] = points[j, k], points[i, k]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            b = j
        elif middle >= i:
            a = i
        else:
            return


@entry
def sort_into_tree(points, order, levels):
    """Order particles so that those of every node of the tree follow each other.

    Every node is cut at its middle particle, across its longest side.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Reordered.
    order : ndarray, shape (n,), int64
        Reordered with them.
    levels : int
        Of the tree; leaf k of the 2^levels holds the particles from k n // 2^levels on.
    """
    number = points.shape[0]
    for level in range(levels):
        nodes = 1 << level
        for k in range(nodes):
            a, b = k * number // nodes, (k + 1) * number // nodes
            axis, longest = 0, -1.0
            for x in range(3):
                low, high = math.inf, -math.inf
                for n in range(a, b):
                    low, high = min(low, points[n, x]), max(high, points[n, x])
                if high - low > longest:
                    axis, longest = x, high - low
            select(points, order, a, b, (2 * k + 1) * number // (2 * nodes), axis)


@entry
def box_nodes(points, radius, levels, boxes):
    """Boxes around the spheres of the particles of every node, into `boxes` (2^(levels + 1), 6)."""
    number = points.shape[0]
    leaves = 1 << levels
    for k in range(leaves):
        for x in range(3):
            low, high = math.inf, -math.inf
            for n in range(k * number // leaves, (k + 1) * number // leaves):
                low, high = min(low, points[n, x] - radius[n]), max(high, points[n, x] + radius[n])
            # Rounded outwards: the numbers are kept in single precision, of a frame of size 1.
            boxes[leaves + k, x], boxes[leaves + k, 3 + x] = low - 1.5e-7, high + 1.5e-7
    for k in range(leaves - 1, 0, -1):
        for x in range(3):
            boxes[k, x] = min(boxes[2 * k, x], boxes[2 * k + 1, x])
            boxes[k, 3 + x] = max(boxes[2 * k, 3 + x], boxes[2 * k + 1, 3 + x])


@inlined
def splat_extent(x, radius, n):
    """First and last cell, of n, whose middle can be within a radius of x [cell]."""
    return max(math.ceil(x - radius - 0.5), 0), min(math.floor(x + radius - 0.5), n - 1)


@entry
def splat(points, lengths, masses, out):
    """Spread particles over the cells of a grid, each by the spline at the cells' middles, its mass exactly.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        [cell] from the grid's corner; spheres of radius 2 h that stick out of the grid lose nothing, for the mass goes
        to the cells that are there.
    lengths : ndarray, shape (n,)
        Smoothing lengths [cell], at least 1: then the middle of some cell is well within every sphere.
    masses : ndarray, shape (n,)
    out : ndarray, shape (x, y, z)
        Mass in each cell; added to.
    """
    for n in range(points.shape[0]):
        x, y, z, h = points[n, 0], points[n, 1], points[n, 2], lengths[n]
        x0, x1 = splat_extent(x, 2.0 * h, out.shape[0])
        y0, y1 = splat_extent(y, 2.0 * h, out.shape[1])
        z0, z1 = splat_extent(z, 2.0 * h, out.shape[2])
        scale, whole = 1.0 / (h * h), 0.0
        for turn in range(2):
            # First the sum of the weights, then shares of the mass.
            share = masses[n] / whole if turn == 1 else 0.0
            for i in range(x0, x1 + 1):
                for j in range(y0, y1 + 1):
                    across = ((i + 0.5 - x) ** 2 + (j + 0.5 - y) ** 2) * scale
                    if across >= 4.0:
                        continue
                    for k in range(z0, z1 + 1):
                        q2 = across + (k + 0.5 - z) ** 2 * scale
                        if q2 < 4.0:
                            weight = spline(q2)
                            if turn == 0:
                                whole += weight
                            else:
                                out[i, j, k] += share * weight
