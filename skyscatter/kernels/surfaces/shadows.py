"""What of a lamp's light reaches a point: shadow rays through media and what only separates them."""

from __future__ import annotations

import numpy as np

from skyscatter.kernels.codes.surfaces import DIELECTRIC, INTERFACE
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.surfaces.flights import MOST, ORDER, weigh_vertex
from skyscatter.kernels.surfaces.media import current_medium, pull, push, transmit
from skyscatter.kernels.surfaces.rays import blocked, closest_hit, next_hit
from skyscatter.kernels.surfaces.shapes import item_body


@inlined
def copy_stack(source, target):
    """Copy a stack of media."""
    for k in range(source.size):
        target[k] = source[k]


@inlined
def cross(shapes, body, entering, stack):
    """The stack of a ray after it has crossed the boundary of a body."""
    m = shapes.inside[body]
    if m >= 0:
        if entering:
            push(stack, m)
        else:
            pull(stack, m)


@inlined
def passes(kind, here, there):
    """Whether a boundary of that kind lets light pass as if it were not there."""
    return kind == INTERFACE or (kind == DIELECTRIC and here == there)


@kernel
def reaches(table, x, d, distance, skip, goal, stack, s):
    """Whether light comes straight from `distance` to x, and with what transmittance, into ``s.light`` (wavelength,).

    Boundaries that are no obstacle are passed, and the stack goes along.  `goal` is the item that is to be met, which
    is no obstacle either.  The chances with which a walk would have gone on at all boundaries under each hero go to
    ``s.onward``.
    """
    shapes, media = table.shapes, table.media
    for i in range(s.onward.size):
        s.onward[i] = 1.0
    if stack[0] < 0 and not shapes.passable:
        # Outside of everything no boundary is without effect.
        if blocked(shapes, x, d, distance, skip, goal):
            return False
        transmit(media, np.int64(0), x, d, distance, s.media, s.light)
        return True
    copy_stack(stack, s.shadow_stack)
    for i in range(s.light.size):
        s.light[i] = 1.0
    near, hit, place = 0.0, s.shadow_hit, s.shadow_place
    item = closest_hit(shapes, x, d, distance, skip, hit)
    while True:
        end = hit[0] if item >= 0 else distance
        here = current_medium(media, s.shadow_stack)
        for n in range(3):
            place[n] = x[n] + near * d[n]
        if media.first[here + 1] > media.first[here]:
            transmit(media, here, place, d, end - near, s.media, s.piece)
            for i in range(s.light.size):
                s.light[i] *= s.piece[i]
        if item < 0:
            return True
        if item != goal:
            body = item_body(shapes, item)
            cross(shapes, body, d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3] < 0.0, s.shadow_stack)
            there = current_medium(media, s.shadow_stack)
            row = shapes.material[body]
            if not passes(table.materials.kind[row], here, there):
                return False
            if table.guide.scatters[here] and s.at[ORDER] + 1 < s.at[MOST]:
                for i in range(s.spare.size):
                    s.spare[i] = 1.0 - s.piece[i]
                weigh_vertex(media, table.materials, here, row, s.media.along, s.spare, s.piece, s.spare)
                for i in range(s.spare.size):
                    s.onward[i] *= 1.0 - s.spare[i]
        near = end
        item = next_hit(shapes, x, d, near, item, distance, hit)
