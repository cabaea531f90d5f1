"""Where along a line the density of a shape has an edge or a peak: the places at which quadrature must stop.

A line is (a, b, c) + t (u, v, w) in the shape's own frame, t in metres.  Cuts go unsorted into an array of which the
first `n` places are taken; every function returns the new `n`.  Cuts outside ]0, length[ are dropped, and so are
those that no longer fit: quadrature then finds an edge by halving.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.space import (
    AROUND,
    BONNOR_EBERT,
    BOX,
    CONE,
    DISK,
    FILAMENT,
    FRONT,
    GAUSSIAN_SHELL,
    GAUSSIAN_SPHERE,
    POWER_LAW,
    SHELL,
    SPHERE,
    TURBULENCE,
)
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.shapes import filament_distance

#: Ratio of the distances of successive cuts from a peak.
GRADE = 4.0


@inlined
def put_cut(cuts, n, t, length):
    """One more cut."""
    if 0.0 < t < length and n < cuts.size:
        cuts[n] = t
        return n + 1
    return n


@kernel
def put_peak(cuts, n, t, width, length):
    """Cuts at a peak and at growing distances from it: panels shrink towards it."""
    n = put_cut(cuts, n, t, length)
    step = width
    while step > 0.0 and (t + step < length or t - step > 0.0) and step < 1e9 * width:
        n = put_cut(cuts, n, t - step, length)
        n = put_cut(cuts, n, t + step, length)
        step *= GRADE
    return n


@kernel
def put_roots(cuts, n, a, b, c, length):
    """Cuts at the roots of a t^2 + 2 b t + c."""
    square = b * b - a * c
    if square < 0.0:
        return n
    far = -(b + math.copysign(math.sqrt(square), b))
    if a != 0.0:
        n = put_cut(cuts, n, far / a, length)
    if far != 0.0:
        n = put_cut(cuts, n, c / far, length)
    return n


@kernel
def box_edges(cuts, n, a, b, c, u, v, w, x, y, z, length):
    """Cuts where a line crosses the planes of a box of half sizes x, y, z."""
    for o, d, h in ((a, u, x), (b, v, y), (c, w, z)):
        if d != 0.0:
            n = put_cut(cuts, n, (h - o) / d, length)
            n = put_cut(cuts, n, (-h - o) / d, length)
    return n


@kernel
def disk_edges(p, at, cuts, n, a, b, c, u, v, w, length):
    """Cylinders at the inner and the outer radius, the middle plane, and the way past the axis."""
    across, along, square = u * u + v * v, a * u + b * v, a * a + b * b
    n = put_roots(cuts, n, across, along, square - p[at + 3] * p[at + 3], length)
    n = put_roots(cuts, n, across, along, square - p[at + 4] * p[at + 4], length)
    speed = math.sqrt(across + w * w)
    if across > 0.0:
        t = -along / across
        near = math.sqrt(max(square - along * along / across, 0.0))
        n = put_peak(cuts, n, t, max(near, 0.25 * p[at + 3]) / math.sqrt(across), length)
    if w != 0.0:
        t = -c / w
        x, y = a + u * t, b + v * t
        big = min(max(math.sqrt(x * x + y * y), p[at + 3]), p[at + 4])
        height = p[at + 2] * big ** p[at + 1]
        n = put_peak(cuts, n, t, height / max(abs(w), height / big * speed), length)
    return n


@kernel
def joint_edge(p, j, reach, cuts, n, a, b, c, u, v, w, speed, length):
    """A cut where a line crosses the plane between a part of a filament and the part before: there its density kinks.

    p[j]: the part, 7 numbers; the plane goes through the joint, across the mean direction of both.
    """
    here, there = math.sqrt(p[j + 6]), math.sqrt(p[j - 1])
    x, y, z = p[j + 3] * here + p[j - 4] * there, p[j + 4] * here + p[j - 3] * there, p[j + 5] * here + p[j - 2] * there
    slope = u * x + v * y + w * z
    if slope != 0.0:
        t = ((p[j] - a) * x + (p[j + 1] - b) * y + (p[j + 2] - c) * z) / slope
        x, y, z = a + t * u - p[j], b + t * v - p[j + 1], c + t * w - p[j + 2]
        if x * x + y * y + z * z < reach:
            n = put_cut(cuts, n, t / speed, length)
    return n


@inlined
def widen(first, last, a, b, c):
    """The interval [first, last] with the roots of a t^2 + 2 b t + c."""
    square = b * b - a * c
    if square < 0.0 or a <= 0.0:
        return first, last
    root = math.sqrt(square)
    return min(first, (-b - root) / a), max(last, (-b + root) / a)


@kernel
def capsule(p, j, reach, a, b, c, u, v, w):
    """Where a line of unit direction enters and leaves the points within a distance (squared: reach) of a part."""
    first, last = math.inf, -math.inf
    e, f, g = p[j + 3], p[j + 4], p[j + 5]
    for end in range(2):
        x, y, z = a - p[j] - end * e, b - p[j + 1] - end * f, c - p[j + 2] - end * g
        first, last = widen(first, last, 1.0, x * u + y * v + z * w, x * x + y * y + z * z - reach)
    # Across the part: vectors less what they have along it.
    x, y, z, inverse = a - p[j], b - p[j + 1], c - p[j + 2], p[j + 6]
    s, r = (x * e + y * f + z * g) * inverse, (u * e + v * f + w * g) * inverse
    x, y, z, u, v, w = x - s * e, y - s * f, z - s * g, u - r * e, v - r * f, w - r * g
    t0, t1 = widen(math.inf, -math.inf, u * u + v * v + w * w, x * u + y * v + z * w, x * x + y * y + z * z - reach)
    if t0 < t1:
        if 0.0 <= s + r * t0 <= 1.0:
            first = min(first, t0)
        if 0.0 <= s + r * t1 <= 1.0:
            last = max(last, t1)
    return first, last


@kernel
def filament_rim(p, at, cuts, n, a, b, c, u, v, w, speed, length):
    """Cuts where a line enters or leaves all that is near a filament: not where the parts of it only overlap."""
    reach = p[at + 2]
    for k in range(int(p[at + 3])):
        first, last = capsule(p, at + 4 + 7 * k, reach, a, b, c, u, v, w)
        for t in (first, last):
            near = filament_distance(p, at + 3, a + t * u, b + t * v, c + t * w) if 0.0 < t < length * speed else 0.0
            if near > reach * (1.0 - 1e-9):
                n = put_cut(cuts, n, t / speed, length)
    return n


@kernel
def filament_edges(p, at, cuts, n, a, b, c, u, v, w, length):
    """Where a line comes nearest to the whole filament, and near to any part of it; p[at + 2]: its squared reach."""
    speed = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / speed, v / speed, w / speed
    best, best_t, before, before_t, falling = math.inf, 0.0, math.inf, 0.0, True
    for k in range(int(p[at + 3])):
        j = at + 4 + 7 * k
        x, y, z, e, f, g = a - p[j], b - p[j + 1], c - p[j + 2], p[j + 3], p[j + 4], p[j + 5]
        mixed, from_line, from_part = u * e + v * f + w * g, x * u + y * v + z * w, x * e + y * f + z * g
        # The nearest points of two straight lines, the second within its ends (Ericson 2005, section 5.1.9).
        slant = 1.0 / p[j + 6] - mixed * mixed
        s = min(max((from_part - mixed * from_line) / slant, 0.0), 1.0) if slant > 0.0 else 0.5
        t = s * mixed - from_line
        x, y, z = x + t * u - s * e, y + t * v - s * f, z + t * w - s * g
        m = x * x + y * y + z * z
        if m < best:
            best, best_t = m, t
        if m > before and falling and before < p[at + 2]:
            n = put_cut(cuts, n, before_t / speed, length)
        falling, before, before_t = m < before, m, t
        if k > 0:
            n = joint_edge(p, j, p[at + 2], cuts, n, a, b, c, u, v, w, speed, length)
    if before < p[at + 2] and falling:
        n = put_cut(cuts, n, before_t / speed, length)
    if best < p[at + 2]:
        n = put_peak(cuts, n, best_t / speed, math.sqrt(1.0 + best) / speed, length)
        n = filament_rim(p, at, cuts, n, a, b, c, u, v, w, speed, length)
    return n


@kernel
def sphere_edges(kind, p, at, cuts, n, along, square, m, length):
    """Edges of the round shapes; square: squared speed; along: its product with the time past the nearest point."""
    nearest, speed = -along / square, math.sqrt(square)
    q = max(m - along * along / square, 0.0)
    if kind == SPHERE:
        return put_roots(cuts, n, square, along, m - 1.0, length)
    if kind == SHELL:
        n = put_roots(cuts, n, square, along, m - 1.0, length)
        return put_roots(cuts, n, square, along, m - p[at], length)
    if kind == GAUSSIAN_SPHERE:
        n = put_roots(cuts, n, square, along, m - p[at], length)
        return put_peak(cuts, n, nearest, 1.0 / speed, length)
    if kind == POWER_LAW:
        n = put_roots(cuts, n, square, along, m - p[at + 1], length)
        return put_peak(cuts, n, nearest, math.sqrt(1.0 + q) / speed, length)
    if kind == BONNOR_EBERT:
        n = put_roots(cuts, n, square, along, m - p[at], length)
        return put_peak(cuts, n, nearest, math.sqrt(1.0 + q) / speed, length)
    # A Gaussian shell: its ridge, its flanks and its ends.
    n = put_cut(cuts, n, nearest, length)
    for x in (-p[at + 1], -2.0, 0.0, 2.0, p[at + 1]):
        r = max(1.0 + x * p[at], 0.0)
        n = put_roots(cuts, n, square, along, m - r * r, length)
    return n


@kernel
def planet_edges(p, at, cuts, n, along, square, m, length):
    """The ground, the breaks and the top of a planet's air, and the point nearest to its middle."""
    nodes, breaks = int(p[at + 5]), int(p[at + 6])
    n = put_roots(cuts, n, square, along, m - 1.0, length)
    first = at + 7 + 2 * nodes
    for k in range(breaks):
        r = 1.0 + p[first + k] / p[at]
        n = put_roots(cuts, n, square, along, m - r * r, length)
    r = 1.0 + p[at + 4] / p[at]
    n = put_roots(cuts, n, square, along, m - r * r, length)
    return put_peak(cuts, n, -along / square, p[first + breaks] / math.sqrt(square), length)


@kernel
def shape_edges(kind, p, at, cuts, n, a, b, c, u, v, w, length):
    """Cuts of one shape, its numbers at p[at]."""
    square, along, m = u * u + v * v + w * w, a * u + b * v + c * w, a * a + b * b + c * c
    if kind <= GAUSSIAN_SHELL:
        return sphere_edges(kind, p, at, cuts, n, along, square, m, length)
    if kind == AROUND:
        return planet_edges(p, at, cuts, n, along, square, m, length)
    if kind == BOX:
        return box_edges(cuts, n, a, b, c, u, v, w, 1.0, 1.0, 1.0, length)
    if kind == TURBULENCE:
        return box_edges(cuts, n, a, b, c, u, v, w, p[at + 1], p[at + 2], p[at + 3], length)
    if kind == DISK:
        return disk_edges(p, at, cuts, n, a, b, c, u, v, w, length)
    if kind == FILAMENT:
        return filament_edges(p, at, cuts, n, a, b, c, u, v, w, length)
    if kind == CONE:
        n = put_roots(cuts, n, square, along, m - 1.0, length)
        n = put_roots(cuts, n, square, along, m - p[at + 1] * p[at + 1], length)
        # c = cos(half angle) r, squared; the other half of the double cone only adds a harmless cut.
        k = p[at] * p[at]
        n = put_roots(cuts, n, w * w - k * square, c * w - k * along, c * c - k * m, length)
        n = put_cut(cuts, n, -c / w, length) if w != 0.0 else n
    if kind == CONE or kind == FRONT:
        q = max(m - along * along / square, 0.0)
        n = put_peak(cuts, n, -along / square, math.sqrt(q + 1e-6) / math.sqrt(square), length)
    return n
