"""Columns from the nodes of a grid to the stars, and the transpose of that linear map.

A column to a star is kept as the mean density along the way: it has a limit at the star, where the column itself has a
corner that interpolation between nodes would miss.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.jit import entry, inlined


@inlined
def way_to_light(x, y, z, low, inverse, shape, place, distant, step):
    """Begin and length of a step in cells (6 numbers), its length [m] over that of the way, and their number."""
    a, b, c = place[0], place[1], place[2]
    length = np.inf
    if not distant:
        a, b, c = a - x, b - y, c - z
        length = math.sqrt(a * a + b * b + c * c)
        if length == 0.0:
            u, v, w = (x - low[0]) * inverse[0], (y - low[1]) * inverse[1], (z - low[2]) * inverse[2]
            return u, v, w, 0.0, 0.0, 0.0, 1.0, 1
        a, b, c = a / length, b / length, c / length
    start, end = 0.0, length
    for k in range(3):
        p = ((x, y, z)[k] - low[k]) * inverse[k]
        q = (a, b, c)[k] * inverse[k]
        top = float(shape[k] - 1)
        if q > 0.0:
            start, end = max(start, -p / q), min(end, (top - p) / q)
        elif q < 0.0:
            start, end = max(start, (top - p) / q), min(end, -p / q)
    if not end > start:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    count = math.ceil((end - start) / step)
    h = (end - start) / count
    u = (x + start * a - low[0]) * inverse[0]
    v = (y + start * b - low[1]) * inverse[1]
    w = (z + start * c - low[2]) * inverse[2]
    share = h if distant else h / length
    return u, v, w, h * a * inverse[0], h * b * inverse[1], h * c * inverse[2], share, count


@entry
def columns_to_lights(density, shape, fine, low, inverse, place, distant, step, first, last, out):
    """Mean densities towards stars, columns [m] to distant ones, at the column nodes first to last: (node, s, c)."""
    n1, n2 = shape[1], shape[2]
    m1, m2 = (n1 - 1) * fine + 1, (n2 - 1) * fine + 1
    for node in range(first, last):
        i, j, k = node // (m1 * m2), node // m2 % m1, node % m2
        x, y, z = low[0] + i / fine / inverse[0], low[1] + j / fine / inverse[1], low[2] + k / fine / inverse[2]
        for s in range(place.shape[0]):
            u, v, w, du, dv, dw, share, count = way_to_light(
                x, y, z, low, inverse, shape, place[s], distant[s], step
            )  # fmt: skip
            for c in range(density.shape[1]):
                out[node, s, c] = 0.0
            for n in range(count):
                a, b, e = u + (n + 0.5) * du, v + (n + 0.5) * dv, w + (n + 0.5) * dw
                p = min(max(int(a), 0), shape[0] - 2)
                q = min(max(int(b), 0), n1 - 2)
                r = min(max(int(e), 0), n2 - 2)
                f, g, h = a - p, b - q, e - r
                at = (p * n1 + q) * n2 + r
                for c in range(density.shape[1]):
                    near = (1 - g) * ((1 - h) * density[at, c] + h * density[at + 1, c])
                    near += g * ((1 - h) * density[at + n2, c] + h * density[at + n2 + 1, c])
                    nxt = at + n1 * n2
                    far = (1 - g) * ((1 - h) * density[nxt, c] + h * density[nxt + 1, c])
                    far += g * ((1 - h) * density[nxt + n2, c] + h * density[nxt + n2 + 1, c])
                    out[node, s, c] += share * ((1 - f) * near + f * far)


@entry
def columns_back(slope, shape, fine, low, inverse, place, distant, step, first, last, out):
    """Transpose of `columns_to_lights`: add the slopes (column node, s, c) up at the nodes of the densities."""
    n1, n2 = shape[1], shape[2]
    m1, m2 = (n1 - 1) * fine + 1, (n2 - 1) * fine + 1
    for node in range(first, last):
        i, j, k = node // (m1 * m2), node // m2 % m1, node % m2
        x, y, z = low[0] + i / fine / inverse[0], low[1] + j / fine / inverse[1], low[2] + k / fine / inverse[2]
        for s in range(place.shape[0]):
            some = False
            for c in range(slope.shape[2]):
                some = some or slope[node, s, c] != 0.0
            if not some:  # no ray passes here
                continue
            u, v, w, du, dv, dw, share, count = way_to_light(
                x, y, z, low, inverse, shape, place[s], distant[s], step
            )  # fmt: skip
            for n in range(count):
                a, b, e = u + (n + 0.5) * du, v + (n + 0.5) * dv, w + (n + 0.5) * dw
                p = min(max(int(a), 0), shape[0] - 2)
                q = min(max(int(b), 0), n1 - 2)
                r = min(max(int(e), 0), n2 - 2)
                f, g, h = a - p, b - q, e - r
                at = (p * n1 + q) * n2 + r
                for c in range(slope.shape[2]):
                    amount = share * slope[node, s, c]
                    for d in range(2):
                        part = amount * (f if d else 1 - f)
                        base = at + d * n1 * n2
                        out[base, c] += (1 - g) * (1 - h) * part
                        out[base + 1, c] += (1 - g) * h * part
                        out[base + n2, c] += g * (1 - h) * part
                        out[base + n2 + 1, c] += g * h * part
