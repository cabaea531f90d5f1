"""A tree of boxes over items, so that a ray asks few of a million triangles.

Nodes come in pairs: the children of a node are 2 k and 2 k + 1, the root is 0 and number 1 stays empty.
`node_link[n, 0]` is the first child, or -1 - f for a leaf whose items are `order[f]`, `order[f + 1]`, ...;
`node_link[n, 1]` is 16 times the parent plus the number of items of a leaf.

Rays walk it without a stack: one bit for every level says whether the sibling of the node on the way down is still to
be visited, and the links lead back (Barringer & Akenine-Moeller 2013, JCGT 2, 1).  So no level may lie deeper than 62.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.jit import entry, inlined, merged

#: Bins along each axis when a node is split.
BINS = 16
#: Items of a leaf, at most; small ones are split further where the surface-area heuristic says that it pays.
LARGEST_LEAF = 8
#: Cost of a step through the tree in tests of an item.
STEP_COST = 1.0
#: From this depth on nodes are halved by number: 2^26 items then stay above level 62.
HALVING_DEPTH = 36
#: Rounding errors of a box test are far below this share of the distance.
SLACK = 1.0 + 1e-14


@inlined
def inverse(rate):
    """1 / rate; a huge number, not infinity, for 0: no NaN for a start on the plane of a box's face.

    The boxes are a little wider than what they hold, so that huge times that little still is very far.
    """
    return 1.0 / rate if abs(rate) > 1e-300 else math.copysign(1e300, rate)


@inlined
def box_entry(box, x, ix, iy, iz, near, best):
    """Distance at which a ray enters a box, infinite if it does not between `near` and `best`; ix ... inverse rates."""
    a, b = (box[0] - x[0]) * ix, (box[3] - x[0]) * ix
    low, high = min(a, b), max(a, b)
    a, b = (box[1] - x[1]) * iy, (box[4] - x[1]) * iy
    low, high = max(low, min(a, b)), min(high, max(a, b))
    a, b = (box[2] - x[2]) * iz, (box[5] - x[2]) * iz
    low, high = max(low, min(a, b)), min(high, max(a, b)) * SLACK
    return low if low <= high and high >= near and low <= best * SLACK else math.inf


@inlined
def climb(node, trail, node_link):
    """The next node to visit once all below `node` is done, and the trail; -1 at the end."""
    if trail == np.uint64(0):
        return np.int64(-1), trail
    while trail & np.uint64(1) == np.uint64(0):
        trail >>= np.uint64(1)
        node = node_link[node, 1] >> 4
    return node ^ 1, trail ^ np.uint64(1)


@inlined
def next_leaf(node, trail, node_box, node_link, x, ix, iy, iz, near, best):
    """The leaf to visit after `node` (-1: the first one) and the trail; -1 at the end."""
    met = False
    if node < 0:
        node = np.int64(0)
    else:
        node, trail = climb(node, trail, node_link)
    while node >= 0:
        leave = not met and box_entry(node_box[node], x, ix, iy, iz, near, best) == math.inf
        if not leave:
            left = node_link[node, 0]
            if left < 0:
                break
            a = box_entry(node_box[left], x, ix, iy, iz, near, best)
            b = box_entry(node_box[left + 1], x, ix, iy, iz, near, best)
            leave = a == math.inf and b == math.inf
            if not leave:
                both = a < math.inf and b < math.inf
                trail = (trail << np.uint64(1)) | (np.uint64(1) if both else np.uint64(0))
                node, met = (left if a <= b else left + 1), True
        if leave:
            node, trail = climb(node, trail, node_link)
            met = False
    return node, trail


@merged
def bound(boxes, order, first, count, out, middles):
    """Bounds of some items and of their middles, each (6,)."""
    for k in range(3):
        out[k] = middles[k] = math.inf
        out[3 + k] = middles[3 + k] = -math.inf
    for j in range(first, first + count):
        box = boxes[order[j]]
        for k in range(3):
            out[k], out[3 + k] = min(out[k], box[k]), max(out[3 + k], box[3 + k])
            middle = 0.5 * (box[k] + box[3 + k])
            middles[k], middles[3 + k] = min(middles[k], middle), max(middles[3 + k], middle)


@inlined
def half_area(ax, ay, az):
    """Half the surface of a box with these sides."""
    return ax * ay + ay * az + az * ax


@inlined
def bin_of(box, k, low, scale):
    """Bin in which the middle of a box falls along an axis."""
    return min(max(int((0.5 * (box[k] + box[3 + k]) - low) * scale), 0), BINS - 1)


@merged
def fill_bins(boxes, order, first, count, k, low, scale, bins):
    """Number and bounds of the items in each bin along one axis, into `bins` (bin, 7)."""
    for b in range(BINS):
        bins[b, 6] = 0.0
        for i in range(3):
            bins[b, i], bins[b, 3 + i] = math.inf, -math.inf
    for j in range(first, first + count):
        box = boxes[order[j]]
        row = bins[bin_of(box, k, low, scale)]
        row[6] += 1.0
        for i in range(3):
            row[i], row[3 + i] = min(row[i], box[i]), max(row[3 + i], box[3 + i])


@merged
def sweep_bins(bins, costs, whole):
    """Best place between bins by the surface-area heuristic, and its cost in tests of an item."""
    costs[:] = 0.0
    for forward in range(2):
        lx = ly = lz = math.inf
        hx = hy = hz = -math.inf
        number = 0.0
        for step in range(BINS - 1):
            b = step if forward == 1 else BINS - 1 - step
            row = bins[b]
            lx, ly, lz = min(lx, row[0]), min(ly, row[1]), min(lz, row[2])
            hx, hy, hz = max(hx, row[3]), max(hy, row[4]), max(hz, row[5])
            number += row[6]
            side = number * half_area(hx - lx, hy - ly, hz - lz) if number > 0.0 else 0.0
            # costs[s]: bins below s on the left, s and above on the right.
            costs[b + 1 if forward == 1 else b] += side if number > 0.0 else math.inf
    best = 1
    for s in range(2, BINS):
        if costs[s] < costs[best]:
            best = s
    return best, STEP_COST + costs[best] / max(whole, 1e-300)


@merged
def find_split(boxes, order, first, count, out, middles, bins, costs):
    """Axis, scale and place of the cheapest split; axis -1 where a leaf is cheaper or the middles coincide."""
    axis, place, scale = -1, 0, 0.0
    cheapest = math.inf
    whole = half_area(out[3] - out[0], out[4] - out[1], out[5] - out[2])
    for k in range(3):
        extent = middles[3 + k] - middles[k]
        if extent > 0.0 and BINS / extent < math.inf:
            fill_bins(boxes, order, first, count, k, middles[k], BINS / extent, bins)
            where, cost = sweep_bins(bins, costs, whole)
            if cost < cheapest:
                axis, place, scale, cheapest = k, where, BINS / extent, cost
    if count <= LARGEST_LEAF and cheapest >= count:
        axis = -1
    return axis, place, scale


@merged
def divide(boxes, order, first, count, axis, place, scale, low):
    """Items whose bin lies below `place` to the front; how many they are."""
    i, j = first, first + count - 1
    while i <= j:
        if bin_of(boxes[order[i]], axis, low, scale) < place:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i - first


@entry
def build_tree(boxes, order, node_box, node_link, todo, bins, costs, middles):
    """Build the tree over boxes with bins and the surface-area heuristic (Wald 2007, Ray Tracing Symposium, 33).

    Parameters
    ----------
    boxes : (n, 6)
        Lowest and highest corner of every item.
    order : (n,) int64
        0 ... n - 1; sorted in place.
    node_box : (2 n + 2, 6), output
    node_link : (2 n + 2, 2) int64, output
        Leaves count into `order`.
    todo, bins, costs, middles
        Scratch: (128, 4) int64, (BINS, 7), (BINS,), (6,).

    Returns
    -------
    int
        Number of nodes used.
    """
    used, waiting = 2, 1
    todo[0, 0], todo[0, 1], todo[0, 2], todo[0, 3] = 0, 0, order.size, 0
    node_link[0, 1] = 0
    node_link[1, 0], node_link[1, 1] = -1, 0
    for k in range(3):
        node_box[1, k], node_box[1, 3 + k] = math.inf, -math.inf
    while waiting > 0:
        waiting -= 1
        node, first, count, depth = todo[waiting]
        bound(boxes, order, first, count, node_box[node], middles)
        axis, place, scale = -1, 0, 0.0
        if count > 1 and depth < HALVING_DEPTH:
            axis, place, scale = find_split(boxes, order, first, count, node_box[node], middles, bins, costs)
        left = 0
        if axis >= 0:
            left = divide(boxes, order, first, count, axis, place, scale, middles[axis])
        elif count > LARGEST_LEAF:
            left = count // 2
        if left == 0 or left == count:
            if count > LARGEST_LEAF:
                left = count // 2
            else:
                node_link[node, 0] = -1 - first
                node_link[node, 1] += count
                continue
        node_link[node, 0] = used
        node_link[used, 1] = node_link[used + 1, 1] = 16 * node
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2], todo[waiting, 3] = used, first, left, depth + 1
        waiting += 1
        todo[waiting, 0], todo[waiting, 1] = used + 1, first + left
        todo[waiting, 2], todo[waiting, 3] = count - left, depth + 1
        waiting += 1
        used += 2
    return used
