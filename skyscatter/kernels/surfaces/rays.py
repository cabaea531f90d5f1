"""What a ray meets: the nearest item, the next one, whether anything is in between, which media a point is inside of.

All directions are unit vectors.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.surfaces import PLANE, STACK
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.surfaces.shapes import (
    NO_MORE,
    item_area,
    item_body,
    sample_item,
    set_hit,
    shape_distance,
    shear_of,
    triangle_distance,
)
from skyscatter.kernels.surfaces.tree import inverse, next_leaf

#: What `shear_of` gives stands here where there is no triangle.
NO_SHEAR = (np.int64(0), np.int64(1), np.int64(2), 0.0, 0.0, 1.0)


@inlined
def item_distance(kind, parameters, triangle, item, x, d, shear, near, last, skip):
    """Distance to any item, infinite without a crossing that counts."""
    if item >= kind.size:
        return triangle_distance(triangle[item - kind.size], item, x, shear, near, last) if item != skip else math.inf
    return shape_distance(kind[item], parameters[item], item, x, d, near, last, item == skip)


@kernel
def nearest(kind, parameters, triangle, loose, node_box, node_link, order, x, d, near, last, far, skip, hit):
    """First crossing after (`near`, `last`) and before `far`; of crossings at one distance that of the lowest item."""
    shear = shear_of(d) if triangle.shape[0] > 0 else NO_SHEAR
    ix, iy, iz = inverse(d[0]), inverse(d[1]), inverse(d[2])
    best, found = far, np.int64(-1)
    # Runs of items: first the loose ones, then leaf after leaf.
    node, trail = np.int64(-1), np.uint64(0)
    first, stop = np.int64(0), np.int64(loose.size)
    while True:
        for k in range(first, stop):
            item = order[k] if node >= 0 else loose[k]
            t = item_distance(kind, parameters, triangle, item, x, d, shear, near, last, skip)
            if t < best or (t == best and item < found):
                best, found = t, item
        if order.size == 0:
            break
        node, trail = next_leaf(node, trail, node_box, node_link, x, ix, iy, iz, near, best)
        if node < 0:
            break
        first = -1 - node_link[node, 0]
        stop = first + (node_link[node, 1] & 15)
    if found >= 0:
        set_hit(kind, parameters, triangle, found, best, x, d, hit)
    return found


@inlined
def closest_hit(shapes, x, d, far, skip, hit):
    """The item that a ray meets first, -1 without one before `far`.

    Parameters
    ----------
    shapes : ShapeTable
    x, d : (3,)
        Start [m] and direction, a unit vector.
    far : float
        May be infinite.
    skip : int
        Item on which the ray starts, or -1: a flat one is not met again, a sphere or a box only where it is left.
    hit : (4,), output
        Distance, more than 0, and unit normal out of the body; untouched without a hit.
    """
    return nearest(
        shapes.kind, shapes.parameters, shapes.triangle, shapes.loose, shapes.node_box, shapes.node_link, shapes.order,
        x, d, 0.0, NO_MORE, far, np.int64(skip), hit,
    )  # fmt: skip


@inlined
def next_hit(shapes, x, d, near, last, far, hit):
    """The crossing that follows the one with item `last` at the distance `near`, along the same ray.

    Crossings are ordered by distance, then by the number of the item; so none is lost and none comes twice, even where
    items coincide or where the ray goes through an edge of a mesh.  Rays that go straight on should use it instead of
    starting anew from where they crossed.  Arguments as for `closest_hit`.
    """
    return nearest(
        shapes.kind, shapes.parameters, shapes.triangle, shapes.loose, shapes.node_box, shapes.node_link, shapes.order,
        x, d, near, last, far, np.int64(-1), hit,
    )  # fmt: skip


@inlined
def stops(shapes, item, x, d, shear, far, skip, skip_far):
    """Whether an item that is no INTERFACE lies before `far`."""
    if item == skip_far or shapes.thin[item_body(shapes, item)]:
        return False
    t = item_distance(
        shapes.kind, shapes.parameters, shapes.triangle, item, x, d, shear, 0.0, NO_MORE, skip
    )  # fmt: skip
    return t < far


@kernel
def obstructed(shapes, x, d, far, skip, skip_far):
    """See `blocked`."""
    shear = shear_of(d) if shapes.triangle.shape[0] > 0 else NO_SHEAR
    ix, iy, iz = inverse(d[0]), inverse(d[1]), inverse(d[2])
    node, trail = np.int64(-1), np.uint64(0)
    first, stop = np.int64(0), np.int64(shapes.loose.size)
    while True:
        for k in range(first, stop):
            item = shapes.order[k] if node >= 0 else shapes.loose[k]
            if stops(shapes, item, x, d, shear, far, skip, skip_far):
                return True
        if shapes.order.size == 0:
            return False
        node, trail = next_leaf(node, trail, shapes.node_box, shapes.node_link, x, ix, iy, iz, 0.0, far)
        if node < 0:
            return False
        first = -1 - shapes.node_link[node, 0]
        stop = first + (shapes.node_link[node, 1] & 15)


@inlined
def blocked(shapes, x, d, far, skip, skip_far):
    """Whether an item that is no INTERFACE lies before `far`; `skip_far`, where the ray is to end, is left out.

    Other arguments as for `closest_hit`.  A convex item that is a lamp hides its own far side: whoever draws a point
    on it has to look at its normal.
    """
    return obstructed(shapes, x, d, far, np.int64(skip), np.int64(skip_far))


@merged
def find_planes(shapes, x, stack):
    """Media of the half spaces that hold a point, into the front of the stack; their number, -1 if they do not fit."""
    count = 0
    for item in range(shapes.kind.size):
        medium = shapes.inside[shapes.shape_body[item]]
        if shapes.kind[item] == PLANE and medium >= 0:
            p = shapes.parameters[item]
            height = (x[0] - p[0]) * p[3] + (x[1] - p[1]) * p[4] + (x[2] - p[2]) * p[5]
            if height < 0.0:
                if count >= STACK:
                    return -1
                stack[count] = medium
                count += 1
    return count


@entry
def fill_stack(shapes, x, d, skip, stack, hit):
    """Media that a point is inside of: those of the bodies that a ray from it leaves more often than it enters.

    Parameters
    ----------
    shapes : ShapeTable
    x, d : (3,)
        The point [m] and a direction: any where `skip` is -1; away from the side whose media are asked for where the
        point lies on the item `skip`.
    skip : int
    stack : (STACK,) int64, output
        The last entered last: bodies left later were entered earlier.  A plane is a half space, entered before all
        others.  Free slots are -1.
    hit : (4,)
        Scratch.

    Returns
    -------
    int
        How many there are; -1 if there are more than fit, or more bodies one in another on the way.
    """
    planes = find_planes(shapes, x, stack)
    if planes < 0:
        return -1
    low, high = planes, STACK  # media of bodies left, and from the top bodies entered and not left again
    item = closest_hit(shapes, x, d, math.inf, skip, hit)
    while item >= 0:
        body = item_body(shapes, item)
        medium = shapes.inside[body]
        flat = item < shapes.kind.size and shapes.kind[item] == PLANE
        if medium >= 0 and not flat:
            entering = hit[1] * d[0] + hit[2] * d[1] + hit[3] * d[2] < 0.0
            place = high
            while place < STACK and stack[place] != body:
                place += 1
            if not entering and place < STACK:
                for k in range(place, high, -1):
                    stack[k] = stack[k - 1]
                high += 1
            elif low >= high:
                return -1
            elif entering:
                high -= 1
                stack[high] = body
            else:
                stack[low] = medium
                low += 1
        item = next_hit(shapes, x, d, hit[0], item, math.inf, hit)
    # What was left first was entered last.
    a, b = planes, low - 1
    while a < b:
        stack[a], stack[b] = stack[b], stack[a]
        a += 1
        b -= 1
    for k in range(low, STACK):
        stack[k] = -1
    return low


@entry
def closest_hits(shapes, origins, directions, far, skip, items, hits):
    """`closest_hit` of many rays: origins, directions (ray, 3), far, skip, items (ray,), hits (ray, 4)."""
    for ray in range(origins.shape[0]):
        items[ray] = closest_hit(shapes, origins[ray], directions[ray], far[ray], skip[ray], hits[ray])


@entry
def are_blocked(shapes, origins, directions, far, skip, skip_far, result):
    """`blocked` of many rays; result (ray,) bool."""
    for ray in range(origins.shape[0]):
        result[ray] = blocked(shapes, origins[ray], directions[ray], far[ray], skip[ray], skip_far[ray])


@entry
def count_crossings(shapes, origins, directions, crossings, hits):
    """How often many rays enter and leave items, into `crossings` (ray, 2); hits (4,) is scratch."""
    for ray in range(origins.shape[0]):
        x, d = origins[ray], directions[ray]
        crossings[ray, 0] = crossings[ray, 1] = 0
        item = closest_hit(shapes, x, d, math.inf, np.int64(-1), hits)
        while item >= 0:
            leaving = hits[1] * d[0] + hits[2] * d[1] + hits[3] * d[2] > 0.0
            crossings[ray, 1 if leaving else 0] += 1
            item = next_hit(shapes, x, d, hits[0], item, math.inf, hits)


@entry
def sample_items(shapes, items, u, v, points):
    """`sample_item` of many items and numbers: items, u, v (n,), points (n, 6)."""
    for k in range(items.size):
        sample_item(shapes, items[k], u[k], v[k], points[k])


@entry
def item_areas(shapes, areas):
    """Areas [m2] of all items."""
    for item in range(areas.size):
        areas[item] = item_area(shapes, np.int64(item))
