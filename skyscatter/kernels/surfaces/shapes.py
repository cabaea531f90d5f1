"""Where a ray meets an item: distances, normals, areas, points on it.

Parameters of the shapes, row by row of `ShapeTable.parameters`:

- SPHERE: centre, radius;
- PLANE: a point, unit normal;
- RECTANGLE: corner, two edges at right angles, unit normal, the edges' inverse squared lengths;
- BOX: centre, half sides, its three unit axes one after the other;
- DISK: centre, unit normal, radius, inner radius, a unit vector in it.

Directions are unit vectors.  A ray meets a closed item twice, and a flat one once.  Which of the distances count is
said by three numbers: those beyond `near`; those at `near` itself on an item of a higher number than `last`, so that
all crossings along one ray come in one order; and what `skip` leaves of the item that the ray starts on.  No distance
is compared with a small number: a flat item that the ray starts on is not met again, a convex one only at its far side
and only if the ray goes inward.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.surfaces import BOX, DISK, PLANE, RECTANGLE, SPHERE
from skyscatter.kernels.jit import inlined, kernel, merged

#: A number that no item has: with it as `last`, nothing at the distance `near` itself counts.
NO_MORE = np.int64(1) << np.int64(62)


@inlined
def counts(t, item, near, last):
    """Whether a crossing at distance t comes after that with `last` at `near`."""
    return t > near or (t == near and item > last)


@inlined
def sphere_roots(p, x, d):
    """Distance to the foot of the perpendicular and half the chord; a chord of 0 where the ray misses.

    The squared half chord is r^2 - |foot|^2, not b^2 - c: no digits are lost where the sphere is far away or small
    (Haines, Guenther & Akenine-Moeller 2019, Ray Tracing Gems, chapter 7).
    """
    fx, fy, fz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    b = -(fx * d[0] + fy * d[1] + fz * d[2])
    lx, ly, lz = fx + b * d[0], fy + b * d[1], fz + b * d[2]
    foot = math.sqrt(lx * lx + ly * ly + lz * lz)
    half = (p[3] - foot) * (p[3] + foot)
    return b, math.sqrt(half) if half > 0.0 else 0.0


@inlined
def sphere_distance(p, item, x, d, near, last, skipped):
    """Distance to a sphere, see the module; infinite without a crossing that counts."""
    b, s = sphere_roots(p, x, d)
    if s == 0.0:
        return math.inf
    if skipped:
        # The start is on the sphere: b > 0 means inward.
        return b + s if b > 0.0 and counts(b + s, item, near, last) else math.inf
    # The product of the roots is |f|^2 - r^2: the larger root has no cancellation, the smaller follows from it.
    fx, fy, fz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    f = math.sqrt(fx * fx + fy * fy + fz * fz)
    q = b + s if b > 0.0 else b - s
    other = (f - p[3]) * (f + p[3]) / q
    low, high = (other, q) if b > 0.0 else (q, other)
    if not low < high:
        return math.inf
    if counts(low, item, near, last):
        return low
    return high if counts(high, item, near, last) else math.inf


@inlined
def box_span(p, x, d):
    """Where a ray enters and leaves a box: (distance in, distance out, axis in, axis out), by slabs."""
    enter, leave = -math.inf, math.inf
    first, final = 0, 0
    fx, fy, fz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    for k in range(3):
        at = 6 + 3 * k
        place = fx * p[at] + fy * p[at + 1] + fz * p[at + 2]
        rate = d[0] * p[at] + d[1] * p[at + 1] + d[2] * p[at + 2]
        half = p[3 + k]
        if rate == 0.0:
            if abs(place) > half:
                return math.inf, -math.inf, 0, 0
            continue
        near_side = (-half - place) / rate
        far_side = (half - place) / rate
        if near_side > far_side:
            near_side, far_side = far_side, near_side
        if near_side > enter:
            enter, first = near_side, k
        if far_side < leave:
            leave, final = far_side, k
    return enter, leave, first, final


@inlined
def box_distance(p, item, x, d, near, last, skipped):
    """Distance to a box, see the module."""
    enter, leave, _, _ = box_span(p, x, d)
    if skipped:
        # The start is on the box: inward means that the middle of the chord lies ahead.
        return leave if enter + leave > 0.0 and counts(leave, item, near, last) else math.inf
    if not enter < leave:
        return math.inf
    if counts(enter, item, near, last):
        return enter
    return leave if counts(leave, item, near, last) else math.inf


@inlined
def flat_distance(kind, p, item, x, d, near, last):
    """Distance to a plane, a rectangle or a disk, see the module."""
    at = 9 if kind == RECTANGLE else 3
    nx, ny, nz = p[at], p[at + 1], p[at + 2]
    rate = d[0] * nx + d[1] * ny + d[2] * nz
    if rate == 0.0:
        return math.inf
    t = ((p[0] - x[0]) * nx + (p[1] - x[1]) * ny + (p[2] - x[2]) * nz) / rate
    if not counts(t, item, near, last):
        return math.inf
    if kind == PLANE:
        return t
    fx, fy, fz = x[0] + t * d[0] - p[0], x[1] + t * d[1] - p[1], x[2] + t * d[2] - p[2]
    if kind == RECTANGLE:
        u = (fx * p[3] + fy * p[4] + fz * p[5]) * p[12]
        v = (fx * p[6] + fy * p[7] + fz * p[8]) * p[13]
        return t if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0 else math.inf
    r2 = fx * fx + fy * fy + fz * fz
    return t if p[7] * p[7] <= r2 <= p[6] * p[6] else math.inf


@inlined
def shape_distance(kind, p, item, x, d, near, last, skipped):
    """Distance to an analytic shape, see the module."""
    if kind == SPHERE:
        return sphere_distance(p, item, x, d, near, last, skipped)
    if kind == BOX:
        return box_distance(p, item, x, d, near, last, skipped)
    if skipped:
        return math.inf
    return flat_distance(kind, p, item, x, d, near, last)


@inlined
def shear_of(d):
    """Axes and shear that take a direction to the z axis: kx, ky, kz, sx, sy, sz; see `triangle_distance`."""
    kz = np.int64(2)
    if abs(d[0]) > abs(d[1]):
        if abs(d[0]) > abs(d[2]):
            kz = np.int64(0)
    elif abs(d[1]) > abs(d[2]):
        kz = np.int64(1)
    kx = kz + 1 if kz < 2 else np.int64(0)
    ky = kx + 1 if kx < 2 else np.int64(0)
    return kx, ky, kz, d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]


@inlined
def owns(ux, uy, vx, vy):
    """Whether the triangle on the left of the edge from u to v owns the edge; the one on its right does if not."""
    return vy > uy or (vy == uy and vx < ux)


@inlined
def triangle_distance(p, item, x, shear, near, last):
    """Distance to a triangle without holes along shared edges (Woop, Benthin & Wald 2013, JCGT 2, 65).

    Corners are sheared so that the ray is the z axis; signs of three edge functions tell whether it goes through.  Two
    triangles compute the same number for a common edge but for its sign, so rounding cannot send a ray between them.
    A ray through an edge or a corner to the last bit belongs to the triangle to whose left the edge lies after a fixed
    order of the plane: of two triangles that are passed one after the other on the same side just one is met, at a
    silhouette both or none.
    """
    kx, ky, kz, sx, sy, sz = shear
    az, bz, cz = p[kz] - x[kz], p[3 + kz] - x[kz], p[6 + kz] - x[kz]
    ax, ay = p[kx] - x[kx] - sx * az, p[ky] - x[ky] - sy * az
    bx, by = p[3 + kx] - x[kx] - sx * bz, p[3 + ky] - x[ky] - sy * bz
    cx, cy = p[6 + kx] - x[kx] - sx * cz, p[6 + ky] - x[ky] - sy * cz
    u, v, w = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    if (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0):
        return math.inf
    total = u + v + w
    if total == 0.0:
        return math.inf
    if u == 0.0 or v == 0.0 or w == 0.0:
        turned = total < 0.0
        if u == 0.0 and owns(bx, by, cx, cy) == turned:
            return math.inf
        if v == 0.0 and owns(cx, cy, ax, ay) == turned:
            return math.inf
        if w == 0.0 and owns(ax, ay, bx, by) == turned:
            return math.inf
    t = sz * (u * az + v * bz + w * cz) / total
    return t if counts(t, item, near, last) else math.inf


@merged
def set_hit(kind, parameters, triangle, item, t, x, d, hit):
    """Distance and outward unit normal of the crossing with an item, into `hit` (4,)."""
    hit[0] = t
    shapes = kind.size
    if item >= shapes:
        p = triangle[item - shapes]
        hit[1], hit[2], hit[3] = p[9], p[10], p[11]
        return
    p = parameters[item]
    if kind[item] == SPHERE:
        # From the foot of the perpendicular, so that entering and leaving never look alike, however grazing the ray.
        b, s = sphere_roots(p, x, d)
        along = b - s if t < b else b + s
        nx, ny, nz = x[0] - p[0] + along * d[0], x[1] - p[1] + along * d[1], x[2] - p[2] + along * d[2]
        norm = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        hit[1], hit[2], hit[3] = nx * norm, ny * norm, nz * norm
    elif kind[item] == BOX:
        enter, _, first, final = box_span(p, x, d)
        entering = t == enter
        at = 6 + 3 * (first if entering else final)
        forward = d[0] * p[at] + d[1] * p[at + 1] + d[2] * p[at + 2] > 0.0
        sign = -1.0 if forward == entering else 1.0
        hit[1], hit[2], hit[3] = sign * p[at], sign * p[at + 1], sign * p[at + 2]
    else:
        at = 9 if kind[item] == RECTANGLE else 3
        hit[1], hit[2], hit[3] = p[at], p[at + 1], p[at + 2]


@kernel
def item_body(shapes, item):
    """Body that an item belongs to."""
    n = shapes.kind.size
    return shapes.shape_body[item] if item < n else shapes.triangle_body[item - n]


@inlined
def triangle_area(p):
    """Area [m2] of a triangle."""
    ax, ay, az = p[3] - p[0], p[4] - p[1], p[5] - p[2]
    bx, by, bz = p[6] - p[0], p[7] - p[1], p[8] - p[2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return 0.5 * math.sqrt(x * x + y * y + z * z)


@kernel
def item_area(shapes, item):
    """Area [m2] of an item; infinite for a plane."""
    n = shapes.kind.size
    if item >= n:
        return triangle_area(shapes.triangle[item - n])
    kind, p = shapes.kind[item], shapes.parameters[item]
    if kind == SPHERE:
        return 4.0 * math.pi * p[3] * p[3]
    if kind == RECTANGLE:
        return 1.0 / math.sqrt(p[12] * p[13])
    if kind == BOX:
        return 8.0 * (p[3] * p[4] + p[4] * p[5] + p[5] * p[3])
    if kind == DISK:
        return math.pi * (p[6] - p[7]) * (p[6] + p[7])
    return math.inf


@merged
def sample_box(p, u, v, out):
    """A point of a box, see `sample_item`."""
    areas = (p[4] * p[5], p[5] * p[3], p[3] * p[4])
    u *= 2.0 * (areas[0] + areas[1] + areas[2])
    face = 0
    while face < 5 and u >= areas[face >> 1]:
        u -= areas[face >> 1]
        face += 1
    k = face >> 1
    side = 1.0 if face & 1 else -1.0
    a, b = (k + 1) % 3, (k + 2) % 3
    s = (2.0 * min(u / areas[k], 1.0) - 1.0) * p[3 + a]
    t = (2.0 * v - 1.0) * p[3 + b]
    for i in range(3):
        out[i] = p[i] + side * p[3 + k] * p[6 + 3 * k + i] + s * p[6 + 3 * a + i] + t * p[6 + 3 * b + i]
        out[3 + i] = side * p[6 + 3 * k + i]


@merged
def sample_disk(p, u, v, out):
    """A point of a disk, see `sample_item`."""
    r = math.sqrt(p[7] * p[7] + u * (p[6] - p[7]) * (p[6] + p[7]))
    a, b = r * math.cos(2.0 * math.pi * v), r * math.sin(2.0 * math.pi * v)
    out[0] = p[0] + a * p[8] + b * (p[4] * p[10] - p[5] * p[9])
    out[1] = p[1] + a * p[9] + b * (p[5] * p[8] - p[3] * p[10])
    out[2] = p[2] + a * p[10] + b * (p[3] * p[9] - p[4] * p[8])
    out[3], out[4], out[5] = p[3], p[4], p[5]


@kernel
def sample_item(shapes, item, u, v, out):
    """A point of an item, uniform in area: position and outward normal into `out` (6,).

    A plane has no such point: `out` becomes NaN.
    """
    n = shapes.kind.size
    if item >= n:
        p = shapes.triangle[item - n]
        root = math.sqrt(u)
        a, b, c = 1.0 - root, root * (1.0 - v), root * v
        for i in range(3):
            out[i] = a * p[i] + b * p[3 + i] + c * p[6 + i]
            out[3 + i] = p[9 + i]
        return
    kind, p = shapes.kind[item], shapes.parameters[item]
    if kind == SPHERE:
        z = 1.0 - 2.0 * u
        r = 2.0 * math.sqrt(u * (1.0 - u))
        out[3], out[4], out[5] = r * math.cos(2.0 * math.pi * v), r * math.sin(2.0 * math.pi * v), z
        for i in range(3):
            out[i] = p[i] + p[3] * out[3 + i]
    elif kind == RECTANGLE:
        for i in range(3):
            out[i] = p[i] + u * p[3 + i] + v * p[6 + i]
            out[3 + i] = p[9 + i]
    elif kind == BOX:
        sample_box(p, u, v, out)
    elif kind == DISK:
        sample_disk(p, u, v, out)
    else:
        for i in range(6):
            out[i] = math.nan
