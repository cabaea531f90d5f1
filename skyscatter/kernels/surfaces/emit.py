"""Photons at their lamps: which lamp, from where, in which direction, with which power.

A photon stands for the power of its lamp over the chance of that lamp and the number of photons; place and direction
are drawn exactly as the lamp shines, so that nothing else enters.  Light from outside (parallel or from all around)
starts on a disk across its direction, as wide as the sphere around all that is finite, and one radius before it.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, POINT_LAMP, SURFACE_LAMP
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import kernel, merged
from skyscatter.kernels.surfaces.lamps import darken, point_on_disk, shade
from skyscatter.kernels.surfaces.shapes import sample_item
from skyscatter.kernels.tabulated import cell_of, draw_in_cell, first_above


@kernel
def lobe_cosine(lamps, k, u):
    """Cosine of the angle from the axis drawn from the lobe of lamp k."""
    n = cell_of(lamps.lobe_cdf, lamps.lobe_first[k], lamps.lobe_first[k + 1] - 1, u)
    p0, p1 = lamps.lobe_value[n], lamps.lobe_value[n + 1]
    width = lamps.lobe_cosine[n + 1] - lamps.lobe_cosine[n]
    x = draw_in_cell(p0, p1, lamps.lobe_cdf, n, u)
    return min(lamps.lobe_cosine[n] + width * x, 1.0)


@kernel
def pick_item(lamps, k, u):
    """Place in ``lamps.item`` of an item of lamp k drawn by area, and where u fell within its share (0 to 1)."""
    first, last = lamps.item_first[k], lamps.item_first[k + 1]
    low = first_above(lamps.item_cdf, first, last - 1, u)
    below = lamps.item_cdf[low - 1] if low > first else 0.0
    return low, min((u - below) / max(lamps.item_cdf[low] - below, 1e-300), 1.0)


@merged
def start_on_disk(lamps, walk, u, v):
    """Put a photon that flies in ``walk.direction`` on the disk before everything."""
    d, x, r = walk.direction, walk.position, lamps.radius
    for n in range(3):
        x[n] = d[n]
    # Any direction across: the disk is round.
    turn(x, 0.0, 2.0 * math.pi * v)
    out = r * math.sqrt(u)
    for n in range(3):
        x[n] = lamps.centre[n] - r * d[n] + out * x[n]


@merged
def emit_photon(scene, e, count, s):
    """Start one of `count` photons with the even numbers `e`; its lamp, -1 without any, and the item it leaves."""
    lamps, walk = scene.lamps, s.walk
    x, d = walk.position, walk.direction
    k, rest = -1, e[0]
    for j in range(lamps.share.size):
        if lamps.share[j] > 0.0:
            k = j
            if rest < lamps.share[j]:
                break
            rest -= lamps.share[j]
    if k < 0:
        return k, -1
    skip, kind, scale = -1, lamps.kind[k], 1.0
    if kind == POINT_LAMP:
        for n in range(3):
            x[n], d[n] = lamps.position[k, n], lamps.axis[k, n]
        turn(d, lobe_cosine(lamps, k, e[2]), 2.0 * math.pi * e[3])
    elif kind == SURFACE_LAMP:
        j, u = pick_item(lamps, k, e[4])
        skip = lamps.item[j]
        sample_item(scene.shapes, skip, u, e[5], s.place)
        for n in range(3):
            x[n], d[n] = s.place[n], s.place[3 + n]
        turn(d, lobe_cosine(lamps, k, e[2]), 2.0 * math.pi * e[3])
    elif kind == PARALLEL_LAMP:
        point_on_disk(lamps, k, e[2], e[3], d)
        for n in range(3):
            d[n] = -d[n]
        start_on_disk(lamps, walk, e[4], e[5])
        scale = math.pi * lamps.radius * lamps.radius
    else:
        d[0], d[1], d[2] = 0.0, 0.0, 1.0
        turn(d, 1.0 - 2.0 * e[2], 2.0 * math.pi * e[3])
        start_on_disk(lamps, walk, e[4], e[5])
        # Radiance, the disk's area, and all directions.
        scale = 4.0 * math.pi * math.pi * lamps.radius * lamps.radius
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = scale * lamps.power[k, i] / (lamps.share[k] * count), 1.0
    if lamps.limb_row[k] >= 0:
        darken(lamps, k, e[2], walk.value)
    elif k == lamps.mapped:
        for n in range(3):
            s.place[n] = -d[n]
        shade(lamps, k, walk.position, s.place, walk.value, s.light)
    for n in range(s.stack.size):
        s.stack[n] = lamps.stack[k, n]
    return k, skip
