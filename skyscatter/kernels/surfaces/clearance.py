"""How much room there is around a point: the nearest surface, and a ball near the point that no surface cuts.

Light is gathered in balls.  A ball that a surface cuts off misses the light of the part beyond it, and one that reaches
through a thin wall takes light from the wrong side.  A ball that no surface cuts is right wherever light is even, in
corners, slits and beside edges: so `empty_ball` makes it smaller where a surface is near, and moves it away from the
surface before it becomes too small.  What remains is the change of the light over the way that the ball was moved.

Beside a wall that shines, light without that of the wall itself rises steeply: its second derivative goes with one over
the distance.  So a ball beside a surface fills but a part of its room, and what it blurs grows with the square of that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import BOX, DISK, RECTANGLE, SPHERE
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.surfaces.rays import closest_hit, next_hit
from skyscatter.kernels.surfaces.shapes import item_body

#: Part of its radius from which on a ball is moved rather than made smaller still.
SMALL = 0.25
#: Radius of a ball that has not the room it wishes, in parts of this room: the blur is two thirds of that of a ball
#: that touches the surface, the variance half as much again on a layer as wide as the ball.
FILLED = 0.8
#: Moves at most: one from a wall, two out of an edge, three out of a corner; acute ones take more.
MOVES = 6
#: Cosine between normals of a body's surface below which one part of it stands beside the other, round a corner.
SAME_SIDE = 0.7


@by_address
class BallScratch(NamedTuple):
    """Scratch arrays of `empty_ball`."""

    place: np.ndarray  #: (3,) where the ball is now
    nearest: np.ndarray  #: (3,) place of the surface next to it
    other: np.ndarray  #: (3,)
    away: np.ndarray  #: (3,) unit vector
    hit: np.ndarray  #: (4,)


def make_ball_scratch() -> BallScratch:
    """Scratch arrays of a thread."""
    return BallScratch(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(4))


@inlined
def square_to(x, q):
    """Squared distance of two points."""
    a, b, c = x[0] - q[0], x[1] - q[1], x[2] - q[2]
    return a * a + b * b + c * c


@inlined
def along(p, at, a, b, c):
    """Scalar product of three numbers of a row, from `at` on, with a vector."""
    return p[at] * a + p[at + 1] * b + p[at + 2] * c


@inlined
def nearest_of_flat(kind, p, x, q):
    """The point of a plane, a rectangle or a disk next to x, into `q`."""
    a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    if kind == RECTANGLE:
        u = min(max(along(p, 3, a, b, c) * p[12], 0.0), 1.0)
        v = min(max(along(p, 6, a, b, c) * p[13], 0.0), 1.0)
        for n in range(3):
            q[n] = p[n] + u * p[3 + n] + v * p[6 + n]
        return
    height = along(p, 3, a, b, c)
    for n in range(3):
        q[n] = x[n] - height * p[3 + n]
    if kind == DISK:
        out = math.sqrt(square_to(q, p))
        allowed = min(max(out, p[7]), p[6])
        for n in range(3):
            q[n] = p[n] + (allowed * (q[n] - p[n]) / out if out > 0.0 else allowed * p[8 + n])


@inlined
def nearest_of_box(p, x, q):
    """The point of a box's faces next to x, into `q`."""
    a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    inside, face, depth = True, 0, math.inf
    for k in range(3):
        place = along(p, 6 + 3 * k, a, b, c)
        inside = inside and abs(place) < p[3 + k]
        if p[3 + k] - abs(place) < depth:
            face, depth = k, p[3 + k] - abs(place)
        q[k] = min(max(place, -p[3 + k]), p[3 + k])
    if inside:
        q[face] = math.copysign(p[3 + face], q[face])
    u, v, w = q[0], q[1], q[2]
    for n in range(3):
        q[n] = p[n] + u * p[6 + n] + v * p[9 + n] + w * p[12 + n]


@inlined
def part(value, total):
    """A share between 0 and 1."""
    return min(max(value / total, 0.0), 1.0) if total > 0.0 else 0.0


@inlined
def nearest_of_triangle(p, x, q):
    """The point of a triangle next to x, into `q`: by the regions of its plane (Ericson 2005, section 5.1.5)."""
    ux, uy, uz = p[3] - p[0], p[4] - p[1], p[5] - p[2]
    vx, vy, vz = p[6] - p[0], p[7] - p[1], p[8] - p[2]
    a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    d1, d2 = ux * a + uy * b + uz * c, vx * a + vy * b + vz * c
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    # Of the second and the third corner: d3 = d1 - uu and so on.
    d3, d4, d5, d6 = d1 - uu, d2 - uv, d1 - uv, d2 - vv
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s, t = part(d1, uu), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s, t = 0.0, part(d2, vv)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = part(d4 - d3, (d4 - d3) + (d5 - d6))
        s = 1.0 - t
    elif d1 <= 0.0 and d2 <= 0.0:
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    else:
        total = va + vb + vc
        s, t = part(vb, total), part(vc, total)
    q[0], q[1], q[2] = p[0] + s * ux + t * vx, p[1] + s * uy + t * vy, p[2] + s * uz + t * vz


@kernel
def nearest_of_item(shapes, item, x, q):
    """The point of an item's surface next to x, into `q` (3,)."""
    count = shapes.kind.size
    if item >= count:
        nearest_of_triangle(shapes.triangle[item - count], x, q)
        return
    kind, p = shapes.kind[item], shapes.parameters[item]
    if kind == SPHERE:
        out = math.sqrt(square_to(x, p))
        for n in range(3):
            q[n] = p[n] + (p[3] * (x[n] - p[n]) / out if out > 0.0 else (p[3] if n == 0 else 0.0))
    elif kind == BOX:
        nearest_of_box(p, x, q)
    else:
        nearest_of_flat(kind, p, x, q)


@inlined
def stands_out(shapes, item, own, normal):
    """Whether an item can stand on the surface of the item `own`: no boundary without effect, no smooth continuation.

    Any item does where `own` is -1.
    """
    if own < 0:
        return True
    body = item_body(shapes, item)
    if item == own or shapes.thin[body]:
        return False
    count = shapes.kind.size
    if item < count or body != item_body(shapes, own):
        return True
    p = shapes.triangle[item - count]
    return p[9] * normal[0] + p[10] * normal[1] + p[11] * normal[2] < SAME_SIDE


@inlined
def square_to_box(box, x):
    """Squared distance of a point from a box of the tree; 0 inside."""
    total = 0.0
    for k in range(3):
        out = max(box[k] - x[k], x[k] - box[3 + k], 0.0)
        total += out * out
    return total


@inlined
def following(node, node_link):
    """The node of the tree that is next where all below `node` is done, -1 at the end: siblings, left ones first."""
    while node > 0 and node & 1 == 1:
        node = node_link[node, 1] >> 4
    return node + 1 if node > 0 else np.int64(-1)


@kernel
def clearance(shapes, x, far, own, normal, q, best_q):
    """Distance [m] from x to the nearest surface of all, its place into `best_q` (3,); `far` where none is nearer.

    With a point of the item `own`, not -1, only what stands on its surface counts, see `stands_out`.
    """
    best = far * far
    for k in range(shapes.loose.size):
        if stands_out(shapes, shapes.loose[k], own, normal):
            nearest_of_item(shapes, shapes.loose[k], x, q)
            square = square_to(x, q)
            if square < best:
                best = square
                best_q[0], best_q[1], best_q[2] = q[0], q[1], q[2]
    node = np.int64(0) if shapes.order.size > 0 else np.int64(-1)
    while node >= 0:
        if square_to_box(shapes.node_box[node], x) < best:
            left = shapes.node_link[node, 0]
            if left >= 0:
                node = left
                continue
            first = -1 - left
            for k in range(first, first + (shapes.node_link[node, 1] & 15)):
                if stands_out(shapes, shapes.order[k], own, normal):
                    nearest_of_item(shapes, shapes.order[k], x, q)
                    square = square_to(x, q)
                    if square < best:
                        best = square
                        best_q[0], best_q[1], best_q[2] = q[0], q[1], q[2]
        node = following(node, shapes.node_link)
    return math.sqrt(best) if best < far * far else far


@merged
def step_away(shapes, c, room, wish, b):
    """Move c from the nearest place, kept in ``b.nearest``, until it has the wish or is half-way to what is opposite.

    False where it cannot be moved.
    """
    if not room > 0.0:
        return False
    for n in range(3):
        b.away[n] = (c[n] - b.nearest[n]) / room
    item = closest_hit(shapes, c, b.away, 2.0 * wish, np.int64(-1), b.hit)
    move = wish - room
    if item >= 0:
        move = min(move, 0.5 * (b.hit[0] - room))
    if not move > 1e-6 * wish:
        return False
    for n in range(3):
        c[n] += move * b.away[n]
    return True


@kernel
def empty_ball(shapes, x, radius, b, centre):
    """A ball near x that no surface cuts, of the radius [m] wherever there is room: its centre, and its radius.

    All of the way from x to the centre is free, so the ball lies on the same side of every surface.

    Parameters
    ----------
    shapes : ShapeTable
    x : (3,)
    radius : float
        [m]
    b : BallScratch
    centre : (3,), output

    Returns
    -------
    float
        Radius [m]; 0 if x lies on a surface to the last bit.
    """
    for n in range(3):
        centre[n] = b.place[n] = x[n]
    wish, far = SMALL * radius, radius / FILLED
    best = room = clearance(shapes, x, far, np.int64(-1), b.away, b.other, b.nearest)
    for _ in range(MOVES):
        if room >= wish or not step_away(shapes, b.place, room, wish, b):
            break
        room = clearance(shapes, b.place, far, np.int64(-1), b.away, b.other, b.nearest)
        if room > best:
            best = room
            for n in range(3):
                centre[n] = b.place[n]
    return min(max(min(best, wish), FILLED * best), radius)


@kernel
def free_way(shapes, x, d, far, own, normal, hit):
    """Distance [m] along d from x, just above the item `own`, to what stands on its surface; `far` where nothing does.

    `normal` is that of the item at the point.
    """
    item = closest_hit(shapes, x, d, far, np.int64(-1), hit)
    while item >= 0:
        if stands_out(shapes, item, own, normal):
            return hit[0]
        item = next_hit(shapes, x, d, hit[0], item, far, hit)
    return far


@entry
def empty_balls(shapes, places, radius, b, centres, radii):
    """`empty_ball` of many points (point, 3): centres (point, 3), radii (point,)."""
    for k in range(places.shape[0]):
        radii[k] = empty_ball(shapes, places[k], radius, b, centres[k])
