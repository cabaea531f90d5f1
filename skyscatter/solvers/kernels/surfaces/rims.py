"""How much of a disk around a point of a surface lies on the surface: near a rim it sticks out.

Light is gathered on the disk and divided by its area; without this share walls would be dark along their edges.  It
is known for rectangles, faces of boxes and, the rim taken as straight, for disks; elsewhere it is taken as 1.
"""

from __future__ import annotations

import math

from skyscatter.solvers.kernels.jit import kernel
from skyscatter.solvers.kernels.surfaces.tables import BOX, DISK, RECTANGLE

#: Points of the midpoint rule over the angle: the share is right to 2e-3.
POINTS = 24


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
    return min(max(total * step / math.pi, 0.05), 1.0)


@kernel
def share_on_surface(shapes, item, x, n, radius):
    """Share of the disk of a radius [m] around the point x with normal n of an item that lies on this item."""
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
    return share_of_disk(max(left, 0.0), max(right, 0.0), max(down, 0.0), max(up, 0.0), radius)
