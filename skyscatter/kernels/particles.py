"""Sets of particles: the density at a point, the exact column along a line, and bounds within boxes.

Every particle is a cubic spline of radius 2 h (Monaghan & Lattanzio 1985, A&A 149, 135),

    W = [ (2 - q)+^3 / 4 - (1 - q)+^3 ] / (pi h^3),   q = r / h,

whose integral along a line has a closed form.  The particles lie in a complete binary tree: node k has the children 2 k
and 2 k + 1, the root is 1, and every node stores a box around the whole spheres of its particles, so that a node that a
point or line misses is passed by with all that is below it.  A particle is in one leaf only: nothing is counted twice,
and smoothing lengths may differ by any factor.  Going on to the next node needs no stack: k + 1, and upwards from there
as long as that is a first child.

A leaf `PARTICLES` has, after its affine map, the parameter `largest weight`, and the integers `place of the data,
number of particles, levels of the tree`.  Its data are the boxes, 6 numbers a node (low, high), then the leaves.  A
leaf has room for 16 particles: 16 numbers each for x, y, z relative to the leaf's middle, 1 / h, and the weight
m / (pi h^3) over the largest, then that middle (3, and one unused); weights of empty places are zero.  Relative
places keep single precision enough for particles of any size, and numbers side by side are added up in vector
registers.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.space import ROOM
from skyscatter.kernels.jit import entry, inlined, kernel, summing

#: Numbers of a node, places in a leaf, numbers of a leaf.
NODE = 6
LEAF = 5 * ROOM + 4


@inlined
def spline(q2):
    """The cubic spline times pi h^3, at the square of q < 2."""
    q = math.sqrt(q2)
    outer = 2.0 - q
    inner = max(1.0 - q, 0.0)
    return 0.25 * outer * outer * outer - inner * inner * inner


@summing
def leaf_sum(data, n, a, b, c, u, v, w):
    """Sum over the leaf that begins at n, over the largest weight.

    The place a, b, c, relative to the leaf's middle, is taken farther from every particle by u, v, w along the axes: 0
    gives the density there; minus and plus half the sides of a box, an upper and a lower bound in the box around it.
    """
    total = np.float32(0.0)
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    # Unsigned numbers of places: signed ones are asked whether they count from the end.
    x = np.uint64(n)
    y, z = x + np.uint64(ROOM), x + np.uint64(2 * ROOM)
    lengths, weights = x + np.uint64(3 * ROOM), x + np.uint64(4 * ROOM)
    for m in range(np.uint64(ROOM)):
        e, f, g = abs(a - data[x + m]) + u, abs(b - data[y + m]) + v, abs(c - data[z + m]) + w
        e, f, g = (e if e > zero else zero), (f if f > zero else zero), (g if g > zero else zero)
        # Without branches; beyond the sphere both parts are zero.
        q = math.sqrt(e * e + f * f + g * g) * data[lengths + m]
        outer, inner = two - q, one - q
        outer = outer if outer > zero else zero
        inner = inner if inner > zero else zero
        total += data[weights + m] * (np.float32(0.25) * outer * outer * outer - inner * inner * inner)
    return total


@inlined
def next_node(k):
    """The node that follows k and all below it; 1 after the last."""
    k += 1
    while k & 1 == 0:
        k >>= 1
    return k


@inlined
def cube_integral(edge, s, b2):
    """Integral of (edge - q)^3 from 0 to s, with q^2 = b2 + s^2."""
    q = math.sqrt(b2 + s * s)
    mixed = b2 * math.asinh(s / math.sqrt(b2)) if b2 > 1e-30 else 0.0
    first = 0.5 * (s * q + mixed)
    second = s * (b2 + s * s / 3.0)
    third = 0.25 * s * q * q * q + 0.375 * b2 * (s * q + mixed)
    return edge * edge * edge * s - 3.0 * edge * edge * first + 3.0 * edge * second - third


@kernel
def spline_integral(b2, sa, sb):
    """Integral of the spline times pi h^3 along a line from sa to sb, at the square b2 of the impact parameter.

    All lengths in h; s counts from the point nearest to the middle.
    """
    total = 0.0
    if b2 < 4.0:
        half = math.sqrt(4.0 - b2)
        a, b = max(sa, -half), min(sb, half)
        if a < b:
            total += 0.25 * (cube_integral(2.0, b, b2) - cube_integral(2.0, a, b2))
    if b2 < 1.0:
        half = math.sqrt(1.0 - b2)
        a, b = max(sa, -half), min(sb, half)
        if a < b:
            total -= cube_integral(1.0, b, b2) - cube_integral(1.0, a, b2)
    return total


# Whole chords are tabulated: nearly all particles are crossed from end to end.
_CHORDS = 512


def _chord(b2):
    """`spline_integral` over the whole line, in numpy."""
    total = np.zeros_like(b2)
    for edge, weight in ((2.0, 0.25), (1.0, -1.0)):
        b = np.sqrt(np.maximum(b2, 1e-300))
        s = np.sqrt(np.maximum(edge * edge - b2, 0.0))
        mixed = b2 * np.arcsinh(s / b)
        first, second = 0.5 * (s * edge + mixed), s * (b2 + s * s / 3.0)
        third = 0.25 * s * edge**3 + 0.375 * b2 * (s * edge + mixed)
        whole = edge**3 * s - 3.0 * edge * edge * first + 3.0 * edge * second - third
        total += 2.0 * weight * np.where(b2 < edge * edge, whole, 0.0)
    return total


def _chord_table():
    """Coefficients (interval, 4) of cubics in the fraction of an interval of b2 from 0 to 4."""
    nodes = np.arange(4) / 3.0
    values = _chord((np.arange(_CHORDS)[:, None] + nodes) * (4.0 / _CHORDS))
    return np.ascontiguousarray(np.linalg.solve(np.vander(nodes, increasing=True), values.T).T)


_CHORD_TABLE = _chord_table()


@inlined
def chord_integral(b2):
    """Integral of the spline times pi h^3 along a whole line; to 1e-9 of its largest value."""
    x = b2 * (_CHORDS / 4.0)
    k = min(int(x), _CHORDS - 1)
    f = x - k
    return _CHORD_TABLE[k, 0] + f * (_CHORD_TABLE[k, 1] + f * (_CHORD_TABLE[k, 2] + f * _CHORD_TABLE[k, 3]))


@inlined
def leaf_middle(data, n):
    """The point to which the places in the leaf that begins at n are relative."""
    n += 5 * ROOM
    return np.float64(data[n]), np.float64(data[n + 1]), np.float64(data[n + 2])


@kernel
def particle_density(p, i, data, at, j, x, y, z):
    """Density of a particle leaf at a point of the model's frame."""
    u = p[at] * x + p[at + 1] * y + p[at + 2] * z + p[at + 3]
    v = p[at + 4] * x + p[at + 5] * y + p[at + 6] * z + p[at + 7]
    w = p[at + 8] * x + p[at + 9] * y + p[at + 10] * z + p[at + 11]
    leaves = 1 << i[j + 2]
    boxes, bodies = i[j], i[j] + 2 * leaves * NODE
    total, k = 0.0, 1
    while True:
        n = boxes + NODE * k
        if data[n] <= u <= data[n + 3] and data[n + 1] <= v <= data[n + 4] and data[n + 2] <= w <= data[n + 5]:
            if k < leaves:
                k *= 2
                continue
            x, y, z = leaf_middle(data, bodies + LEAF * (k - leaves))
            a, b, c, zero = np.float32(u - x), np.float32(v - y), np.float32(w - z), np.float32(0.0)
            total += leaf_sum(data, bodies + LEAF * (k - leaves), a, b, c, zero, zero, zero)
        k = next_node(k)
        if k == 1:
            return total * p[at + 12]


@inlined
def box_chord(data, n, ox, oy, oz, ix, iy, iz, ta, tb):
    """Whether a line with reciprocal direction (ix, iy, iz) is in the box of node data n between ta and tb."""
    x0, x1 = (data[n] - ox) * ix, (data[n + 3] - ox) * ix
    y0, y1 = (data[n + 1] - oy) * iy, (data[n + 4] - oy) * iy
    z0, z1 = (data[n + 2] - oz) * iz, (data[n + 5] - oz) * iz
    near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), ta))
    far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), tb))
    return near <= far


@inlined
def reciprocal(d):
    """1 / d, finite: a line that does not move along an axis is in a box for ever or never."""
    return 1.0 / d if abs(d) > 1e-30 else 1e30


@kernel
def particle_column(p, i, data, at, j, ox, oy, oz, dx, dy, dz, ta, tb):
    """Column of a particle leaf along the line o + d t from ta to tb; exact."""
    ox, oy, oz = ox + ta * dx, oy + ta * dy, oz + ta * dz
    u = p[at] * ox + p[at + 1] * oy + p[at + 2] * oz + p[at + 3]
    v = p[at + 4] * ox + p[at + 5] * oy + p[at + 6] * oz + p[at + 7]
    w = p[at + 8] * ox + p[at + 9] * oy + p[at + 10] * oz + p[at + 11]
    du = p[at] * dx + p[at + 1] * dy + p[at + 2] * dz
    dv = p[at + 4] * dx + p[at + 5] * dy + p[at + 6] * dz
    dw = p[at + 8] * dx + p[at + 9] * dy + p[at + 10] * dz
    speed = math.sqrt(du * du + dv * dv + dw * dw)
    du, dv, dw = du / speed, dv / speed, dw / speed
    length = (tb - ta) * speed
    ru, rv, rw = reciprocal(du), reciprocal(dv), reciprocal(dw)
    number, levels = i[j + 1], i[j + 2]
    leaves = 1 << levels
    boxes, bodies = i[j], i[j] + 2 * leaves * NODE
    total, k = 0.0, 1
    while True:
        n = boxes + NODE * k
        if box_chord(data, n, u, v, w, ru, rv, rw, 0.0, length):
            if k < leaves:
                k *= 2
                continue
            x, y, z = leaf_middle(data, bodies + LEAF * (k - leaves))
            a, b, c = u - x, v - y, w - z
            # From the point of the line that is nearest to the middle of the leaf.
            here = -(a * du + b * dv + c * dw)
            a, b, c = a + here * du, b + here * dv, c + here * dw
            first = np.uint64(bodies + LEAF * (k - leaves))
            count = ((k - leaves + 1) * number >> levels) - ((k - leaves) * number >> levels)
            for m in range(first, first + np.uint64(count)):
                e = a - data[m]
                f = b - data[m + np.uint64(ROOM)]
                g = c - data[m + np.uint64(2 * ROOM)]
                h = data[m + np.uint64(3 * ROOM)]
                s = e * du + f * dv + g * dw
                b2 = (e * e + f * f + g * g - s * s) * h * h
                if b2 < 4.0:
                    b2 = max(b2, 0.0)
                    sa = (s - here) * h
                    sb = sa + length * h
                    if sa <= -2.0 and sb >= 2.0:
                        column = chord_integral(b2)
                    else:
                        column = spline_integral(b2, sa, sb)
                    total += data[m + np.uint64(4 * ROOM)] * column / h
        k = next_node(k)
        if k == 1:
            return total * p[at + 12] / speed


@inlined
def single(half, size):
    """Half the side of a box in single precision, wider by the rounding of distances of up to `size` and itself."""
    return np.float32(half * (1.0 + 4e-7) + 4e-7 * size)


@entry
def particle_bounds(data, levels, low, high, lowest, reached, highest):
    """Bounds of the density within boxes: every particle as far from and as near to the box as it can be.

    Parameters
    ----------
    data : ndarray, float32
        As a leaf's, from its first number on.
    levels : int
        Of the tree.
    low, high : ndarray, shape (box, 3)
        Corners in the frame of the tree.
    lowest, reached, highest : ndarray, shape (box,)
        Lower bound, density in the middle, upper bound; all over the largest weight.
    """
    leaves = 1 << levels
    bodies = 2 * leaves * NODE
    for box in range(low.shape[0]):
        x0, y0, z0 = low[box, 0], low[box, 1], low[box, 2]
        x1, y1, z1 = high[box, 0], high[box, 1], high[box, 2]
        zero = np.float32(0.0)
        least, here, most, k = 0.0, 0.0, 0.0, 1
        while True:
            n = NODE * k
            if (
                data[n] <= x1 and x0 <= data[n + 3]
                and data[n + 1] <= y1 and y0 <= data[n + 4]
                and data[n + 2] <= z1 and z0 <= data[n + 5]
            ):  # fmt: skip
                if k < leaves:
                    k *= 2
                    continue
                first = bodies + LEAF * (k - leaves)
                x, y, z = leaf_middle(data, first)
                a, b = np.float32(0.5 * (x0 + x1) - x), np.float32(0.5 * (y0 + y1) - y)
                c = np.float32(0.5 * (z0 + z1) - z)
                # Wider by more than the single precision of places: near its edge a spline falls by any factor.
                u = single(0.5 * (x1 - x0), abs(a) + (data[n + 3] - data[n]))
                v = single(0.5 * (y1 - y0), abs(b) + (data[n + 4] - data[n + 1]))
                w = single(0.5 * (z1 - z0), abs(c) + (data[n + 5] - data[n + 2]))
                near = leaf_sum(data, first, a, b, c, -u, -v, -w)
                if near > zero:
                    most += near
                    here += leaf_sum(data, first, a, b, c, zero, zero, zero)
                    least += leaf_sum(data, first, a, b, c, u, v, w)
            k = next_node(k)
            if k == 1:
                break
        lowest[box], reached[box], highest[box] = least, here, most
