"""How much of a disk around a point of a surface lies on the surface and in sight of the point.

Light is gathered on the disk and divided by its area; without this share walls would be dark along their edges, where
the disk sticks out, and beside what stands on them, and light would leak beneath thin walls.  Rims are known of
rectangles, faces of boxes and, taken as straight, of disks; elsewhere the surface is taken as endless.  What stands on
the surface is found by rays along it.

A disk that is cut by what stands there has its middle beside the point, and light changes towards a corner: the error
would be of the first order in the radius.  So the disk is made smaller until nothing stands on it, or it is `SMALL`.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import BOX, DISK, RECTANGLE
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.surfaces.bsdf import frame_of
from skyscatter.kernels.surfaces.clearance import clearance, free_way

#: Points of the midpoint rule over the angle: the share is right to 2e-3.
POINTS = 24
#: Rays along the surface where something stands on it: of a straight wall the share is right to 1e-3.
RAYS = 24
#: No disk is taken as smaller than this share of itself.
LEAST_SHARE = 0.05
#: Part of its radius down to which a disk is made smaller where something stands on it.
SMALL = 0.4
#: Height above the surface at which they run, in radii of the disk: what is lower is no obstacle.
LIFT = 1e-3


@kernel
def share_of_disk(left, right, down, up, radius):
    """Share of a disk that lies between straight rims at four distances from its middle, none of them negative."""
    if min(left, right, down, up) >= radius or not radius > 0.0:
        return 1.0
    low, high = -math.asin(min(left / radius, 1.0)), math.asin(min(right / radius, 1.0))
    total, step = 0.0, (high - low) / POINTS
    for k in range(POINTS):
        chord = math.cos(low + (k + 0.5) * step)
        total += chord * (min(chord, up / radius) + min(chord, down / radius))
    return min(max(total * step / math.pi, LEAST_SHARE), 1.0)


@inlined
def rims_around(shapes, item, x, n):
    """Distances [m] of the point x with normal n of an item from up to four straight rims; infinite where not known."""
    left = right = down = up = math.inf
    if item < shapes.kind.size:
        p, kind = shapes.parameters[item], shapes.kind[item]
        a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
        if kind == RECTANGLE:
            # From one corner along both edges, in parts of them.
            u, v = (a * p[3] + b * p[4] + c * p[5]) * p[12], (a * p[6] + b * p[7] + c * p[8]) * p[13]
            left, right = u / math.sqrt(p[12]), (1.0 - u) / math.sqrt(p[12])
            down, up = v / math.sqrt(p[13]), (1.0 - v) / math.sqrt(p[13])
        elif kind == BOX:
            face, steepest = 0, 0.0
            for k in range(3):
                along = abs(n[0] * p[6 + 3 * k] + n[1] * p[7 + 3 * k] + n[2] * p[8 + 3 * k])
                if along > steepest:
                    face, steepest = k, along
            i, j = (face + 1) % 3, (face + 2) % 3
            u = a * p[6 + 3 * i] + b * p[7 + 3 * i] + c * p[8 + 3 * i]
            v = a * p[6 + 3 * j] + b * p[7 + 3 * j] + c * p[8 + 3 * j]
            left, right, down, up = p[3 + i] + u, p[3 + i] - u, p[3 + j] + v, p[3 + j] - v
        elif kind == DISK:
            out = math.sqrt(a * a + b * b + c * c)
            left, right = p[6] - out, (out - p[7] if p[7] > 0.0 else math.inf)
    return max(left, 0.0), max(right, 0.0), max(down, 0.0), max(up, 0.0)


@kernel
def share_on_surface(shapes, item, x, n, radius):
    """Share of the disk of a radius [m] around the point x with normal n of an item that lies on this item."""
    left, right, down, up = rims_around(shapes, item, x, n)
    return share_of_disk(left, right, down, up, radius)


@kernel
def room_on_surface(shapes, item, x, n, d, radius, b):
    """Distance [m] from x to what stands on the surface, at most the radius; arguments as for `disk_in_sight`.

    From the inside of a box its other faces do, and its rims are where they begin.
    """
    room = radius
    if item < shapes.kind.size and shapes.kind[item] == BOX and n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0.0:
        left, right, down, up = rims_around(shapes, item, x, n)
        room = min(room, left, right, down, up)
    lift_above(x, n, d, radius, b.place)
    return clearance(shapes, b.place, room, item, n, b.other, b.nearest)


@inlined
def way_out(place, rate, half):
    """Distance to the nearer of two rims at -half and +half along one axis, of what moves at a rate from a place."""
    if rate == 0.0:
        return math.inf
    return max(((half if rate > 0.0 else -half) - place) / rate, 0.0)


@kernel
def rim_along(shapes, item, x, n, d):
    """Distance from x along a unit vector d in the surface of an item to the item's rim; infinite where not known."""
    if item >= shapes.kind.size:
        return math.inf
    p, kind = shapes.parameters[item], shapes.kind[item]
    a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    best = math.inf
    if kind == RECTANGLE:
        for k in range(2):
            at, scale = 3 + 3 * k, p[12 + k]
            place = (a * p[at] + b * p[at + 1] + c * p[at + 2]) * scale - 0.5
            rate = (d[0] * p[at] + d[1] * p[at + 1] + d[2] * p[at + 2]) * scale
            best = min(best, way_out(place, rate, 0.5))
    elif kind == BOX:
        for k in range(3):
            at = 6 + 3 * k
            # Not across the face itself, along which rounding alone moves.
            if abs(n[0] * p[at] + n[1] * p[at + 1] + n[2] * p[at + 2]) < 0.5:
                place = a * p[at] + b * p[at + 1] + c * p[at + 2]
                rate = d[0] * p[at] + d[1] * p[at + 1] + d[2] * p[at + 2]
                best = min(best, way_out(place, rate, p[3 + k]))
    elif kind == DISK:
        middle = a * d[0] + b * d[1] + c * d[2]
        square = a * a + b * b + c * c - middle * middle
        best = max(math.sqrt(max(p[6] * p[6] - square, 0.0)) - middle, 0.0)
        if middle < 0.0 and square < p[7] * p[7]:
            best = max(-middle - math.sqrt(p[7] * p[7] - square), 0.0)
    return best


@kernel
def lift_above(x, n, d, radius, out):
    """The point x of a surface with normal n just above it, on the side from which a ray along d comes, into `out`."""
    side = LIFT * radius if n[0] * d[0] + n[1] * d[1] + n[2] * d[2] < 0.0 else -LIFT * radius
    for k in range(3):
        out[k] = x[k] + side * n[k]


@kernel
def disk_in_sight(shapes, item, x, n, d, radius, u, b):
    """Disk around x in which light is gathered.

    Parameters
    ----------
    shapes : ShapeTable
    item : int
    x, n : (3,)
        Point and normal of the item.
    d : (3,)
        Direction of a ray that comes to it, to tell the side.
    radius : float
        Radius of the disk where nothing stands on it [m].
    u : float
        Random number by which the rays are turned.
    b : BallScratch

    Returns
    -------
    reach : float
        Its radius [m].
    share : float
        Part of it that lies on the item and in sight of x.
    crowded : bool
        Whether anything stands on it.
    """
    room = room_on_surface(shapes, item, x, n, d, radius, b)
    reach = max(room, SMALL * radius)
    if room >= reach:
        return reach, share_on_surface(shapes, item, x, n, reach), False
    lift_above(x, n, d, reach, b.place)
    tx, ty, tz, bx, by, bz = frame_of(n[0], n[1], n[2])
    total = 0.0
    for k in range(RAYS):
        angle = 2.0 * math.pi * (k + u) / RAYS
        c, s = math.cos(angle), math.sin(angle)
        b.away[0], b.away[1], b.away[2] = c * tx + s * bx, c * ty + s * by, c * tz + s * bz
        way = min(reach, rim_along(shapes, item, x, n, b.away))
        way = free_way(shapes, b.place, b.away, way, item, n, b.hit)
        total += way * way
    return reach, max(total / (RAYS * reach * reach), LEAST_SHARE), True


@kernel
def in_sight(shapes, item, x, y, n, d, radius, b):
    """Whether nothing stands between two points x and y of a surface; other arguments as for `disk_in_sight`."""
    lift_above(x, n, d, radius, b.place)
    length = 0.0
    for k in range(3):
        b.away[k] = y[k] - x[k]
        length += b.away[k] * b.away[k]
    length = math.sqrt(length)
    if not length > 0.0:
        return True
    for k in range(3):
        b.away[k] /= length
    return free_way(shapes, b.place, b.away, length, item, n, b.hit) >= length
