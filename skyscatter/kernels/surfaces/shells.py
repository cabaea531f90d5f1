"""Air in shells around a planet as one of the media between surfaces: densities, and columns along pieces of rays.

The tables are those of skies, see `kernels.lookup`.  Long pieces of a ray are differences of two columns to the edge
of the air.  Short ones, of which a difference would leave few digits, are summed cell by cell, with 4 Gauss points in
the distance along the ray: within a cell the density is a cubic in the altitude.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.lookup import GAUSS_POINTS, GAUSS_WEIGHTS, altitude_cell, densities, outward_columns

#: Cells of altitude on a piece of a ray from which on it is a difference of two columns.
LONG = 4


@inlined
def foot_of(centre, x, d):
    """Distance p of a line from the planet's centre, and t of x from the point nearest to it [m]."""
    a, b, c = x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]
    # The cross product keeps the digits of p that |x|^2 - (x.d)^2 would lose.
    u, v, w = b * d[2] - c * d[1], c * d[0] - a * d[2], a * d[1] - b * d[0]
    return math.sqrt(u * u + v * v + w * w), a * d[0] + b * d[1] + c * d[2]


@kernel
def add_shell_densities(table, centre, x, y, z, spare, out):
    """Add the densities of all shells at a point to `out` (component,); zero inside of the planet."""
    a, b, c = x - centre[0], y - centre[1], z - centre[2]
    h = math.sqrt(a * a + b * b + c * c) - table.radius
    # A point on the ground is a rounding error below it as often as above.
    if h >= -1e-9 * table.radius:
        densities(table, h, spare)
        for f in range(out.size):
            out[f] += spare[f]


@inlined
def clip_to_shells(table, centre, x, d):
    """Distances at which a ray enters and leaves the ball of the shells; the second is less where it misses it."""
    p, t = foot_of(centre, x, d)
    outer = table.radius + table.top
    if p >= outer:
        return math.inf, -math.inf
    half = math.sqrt((outer - p) * (outer + p))
    return -half - t, half - t


@kernel
def add_cells(table, p, near, far, first, last, out):
    """Add the columns from the distance `near` to `far` from the lowest point of a line, cell by cell."""
    r, t = table.radius, near
    for i in range(first, last + 1):
        end = far
        if i < last:
            rim = r + table.cell[i + 1, 0]
            end = min(max(math.sqrt(max((rim - p) * (rim + p), 0.0)), t), far)
        foot, step = table.cell[i, 0], end - t
        low = math.sqrt(p * p + t * t) - r - foot
        for k in range(GAUSS_POINTS.size):
            s = t + step * GAUSS_POINTS[k]
            rise = (s - t) * (s + t) / (r + foot + low + math.sqrt(p * p + s * s))
            v = min(max((low + rise) * table.cell[i, 1], 0.0), 1.0)
            for f in range(out.size):
                n = 2 + 8 * f
                c = table.cell
                out[f] += step * GAUSS_WEIGHTS[k] * (c[i, n] + v * (c[i, n + 1] + v * (c[i, n + 2] + v * c[i, n + 3])))
        t = end


@kernel
def add_half(table, p, near, far, outward, beyond, out):
    """Add the columns between two distances from the lowest point of a line, on one side of it."""
    r_near, r_far = math.sqrt(p * p + near * near), math.sqrt(p * p + far * far)
    first, _ = altitude_cell(table, r_near - table.radius)
    last, _ = altitude_cell(table, r_far - table.radius)
    if last - first < LONG:
        add_cells(table, p, near, far, first, last, out)
        return
    outward_columns(table, r_near - table.radius, min(near / r_near, 1.0), outward)
    outward_columns(table, r_far - table.radius, min(far / r_far, 1.0), beyond)
    for f in range(out.size):
        out[f] += max(outward[f] - beyond[f], 0.0)


@kernel
def add_shell_columns(table, centre, x, d, start, end, outward, beyond, out):
    """Add the columns of all shells along x + d t from `start` to `end` [m], which may be endless, to `out`.

    `outward` and `beyond` (component,) are scratch.  Within the planet there is nothing.
    """
    p, t = foot_of(centre, x, d)
    outer = table.radius + table.top
    if p >= outer:
        return
    half = math.sqrt((outer - p) * (outer + p))
    # The planet lies between -ground and ground.
    ground = math.sqrt((table.radius - p) * (table.radius + p)) if p < table.radius else 0.0
    low, high = max(t + start, -half), min(t + end, half)
    if low < min(high, -ground):
        add_half(table, p, -min(high, -ground), -low, outward, beyond, out)
    if high > max(low, ground):
        add_half(table, p, max(low, ground), high, outward, beyond, out)
