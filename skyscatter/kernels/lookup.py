"""Columns to the edge of the atmosphere by table lookup, and the geometry of a straight path through it.

For a field f the slant column from altitude h outward under the zenith cosine mu >= 0 is V_f(h) / B_f(h, mu): V is
the vertical column, and B (the reciprocal of the air mass) is a smooth function between 0 and 1 that equals mu in a
flat atmosphere.  Rays that go down first are two outward columns from their lowest point.

Both are tabulated once per medium, so that a lookup costs the same for every kind of field and calls no exponential:
density and V as cubics within each altitude cell (cells end where a field has a break, so that kinks are kept), B
linearly in h and mu.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.shells import CHAPMAN, GAUSSIAN
from skyscatter.kernels.columns import FieldTable, density, vertical_column
from skyscatter.kernels.jit import entry, inlined, kernel

#: Nodes of altitude that are tabulated in one go.
NODES_AT_ONCE = 16
#: Gauss-Legendre rule of 4 points on [0, 1].
GAUSS_POINTS, GAUSS_WEIGHTS = (
    0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(4), (1.0, 0.0), strict=True)
)


@by_address
class ColumnTable(NamedTuple):
    """Density, vertical column and reciprocal air mass of every field; few arrays, because each costs at every call."""

    cell: np.ndarray  #: (cell, 2 + 8 field): altitude of its foot [m], 1 / height [m-1], cubics of density and column
    value: np.ndarray  #: (node, angle, field) reciprocal air mass; node n is the foot of cell n, the last one the top
    angle: np.ndarray  #: (angle, 2): zenith cosine, 1 / difference to the next; rising from 0 to 1
    guess: np.ndarray  #: (g,) int64, cell at the altitude top * (index / g)^2
    bend: float  #: a in the numbering of angles, x = mu (1 + a) / (mu + a)
    radius: float  #: of the planet [m]
    top: float  #: altitude of the top [m]


class Line(NamedTuple):
    """A straight ray inside the atmosphere, in the distance t from its point nearest to the planet's centre."""

    p: float  #: distance of the line from the centre [m]
    start: float  #: t of the ray's origin [m]
    enter: float  #: t where the ray starts to see the atmosphere [m]
    leave: float  #: t where it ends, on the ground or at the top [m]
    hits_ground: bool


@inlined
def place_points(radius, low, foot, high, p, t, at, length):
    """Four Gauss points on the lines (j,) from the altitude `low` to the top `high` of the cell that begins at `foot`.

    Filled are their places in the cell ``at[k, j]``, from 0 to 1, and the lengths of line ``length[k, j]`` that they
    stand for; `t` goes on to where the lines leave the cell.
    """
    height, r_next = high - foot, radius + high
    for j in range(p.size):
        t_next = math.sqrt(max((r_next - p[j]) * (r_next + p[j]), t[j] * t[j]))
        step = t_next - t[j]
        for k in range(GAUSS_POINTS.size):
            s = t[j] + step * GAUSS_POINTS[k]
            rise = (s - t[j]) * (s + t[j]) / (radius + low + math.sqrt(p[j] * p[j] + s * s))
            at[k, j] = (low - foot + rise) / height
            length[k, j] = step * GAUSS_WEIGHTS[k]
        t[j] = t_next


@inlined
def add_cell(cubic, at, length, column):
    """Add what the lines cross of a field in a cell, where its density is this cubic, to its columns (j,)."""
    a, b, c, d = cubic[0], cubic[1], cubic[2], cubic[3]
    for j in range(column.size):
        total = column[j]
        for k in range(GAUSS_POINTS.size):
            v = at[k, j]
            total += length[k, j] * (a + v * (b + v * (c + v * d)))
        column[j] = total


@entry
def fill_reciprocal_air_mass(radius, altitude, cubic, mu, first_node, end_node, work, value):
    """Fill ``value[node, angle, field]`` with V / K for some of the nodes; `work` (10 + field, angle) is scratch.

    K is summed outward cell by cell, all lines and fields at once, by 4 Gauss points in the distance along the line:
    within a cell the density is a cubic, and as a function of that distance it is smooth even for a horizontal line.
    """
    p, t, at, length, column = work[0], work[1], work[2:6], work[6:10], work[10:]
    for i in range(first_node, end_node):
        # The top has no column; the ratio a little below it is the one to continue with.
        h_start = altitude[i] if i < altitude.size - 1 else altitude[i] - 1e-3 * (altitude[i] - altitude[i - 1])
        first = min(i, altitude.size - 2)
        r, low = radius + h_start, h_start
        for j in range(mu.size):
            p[j], t[j] = r * math.sqrt((1.0 - mu[j]) * (1.0 + mu[j])), r * mu[j]
        column[:] = 0.0
        for c in range(first, altitude.size - 1):
            place_points(radius, low, altitude[c], altitude[c + 1], p, t, at, length)
            for f in range(cubic.shape[1]):
                add_cell(cubic[c, f], at, length, column[f])
            low = altitude[c + 1]
        u_start = (h_start - altitude[first]) / (altitude[first + 1] - altitude[first])
        for f in range(cubic.shape[1]):
            a = cubic[first, f]
            vertical = a[4] + u_start * (a[5] + u_start * (a[6] + u_start * a[7]))
            for j in range(mu.size):
                # Above a field there is no column; the ratio of a thin shell keeps the interpolation in order.
                there = column[f, j] > 0.0 and vertical > 0.0
                value[i, j, f] = vertical / column[f, j] if there else max(mu[j], 1e-3)


@entry
def fill_samples(fields, altitude, samples):
    """Density and vertical column at four points of every cell, into ``samples[cell, field, 2, 4]``."""
    for i in range(altitude.size - 1):
        height = altitude[i + 1] - altitude[i]
        for f in range(fields.kind.size):
            for k in range(4):
                # A hair inside the cell: at a break the value of this side counts.
                h = altitude[i] + height * min(max(k / 3.0, 1e-9), 1.0 - 1e-9)
                samples[i, f, 0, k] = density(fields, f, h)
                samples[i, f, 1, k] = vertical_column(fields, f, h)


@kernel
def sort_few(values, n):
    """Sort the first n values in place; for a few values insertion is best."""
    for i in range(1, n):
        x, j = values[i], i - 1
        while j >= 0 and values[j] > x:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = x


@inlined
def altitude_cell(table, h):
    """Index of the altitude cell of h, and the position in it from 0 to 1."""
    x = min(max(h, 0.0) / table.top, 1.0)
    i = table.guess[int(math.sqrt(x) * (table.guess.size - 1))]
    while i < table.cell.shape[0] - 1 and table.cell[i + 1, 0] <= h:
        i += 1
    return i, min(max((h - table.cell[i, 0]) * table.cell[i, 1], 0.0), 1.0)


@entry
def densities(table, h, out):
    """Density of every field at altitude h, into `out` (field,)."""
    if h >= table.top:
        for f in range(out.size):
            out[f] = 0.0
        return
    i, v = altitude_cell(table, h)
    for f in range(out.size):
        k = 2 + 8 * f
        c = table.cell
        out[f] = c[i, k] + v * (c[i, k + 1] + v * (c[i, k + 2] + v * c[i, k + 3]))


@entry
def outward_columns(table, h, mu, out):
    """Columns [m] of all fields from altitude h to the top under a zenith cosine mu >= 0, into `out` (field,)."""
    if h >= table.top:
        for f in range(out.size):
            out[f] = 0.0
        return
    i, v = altitude_cell(table, h)
    last = table.angle.shape[0] - 1
    j = min(int(mu * (1.0 + table.bend) / (mu + table.bend) * last), last - 1)
    if table.angle[j, 0] > mu:  # rounding of the cell number at a node
        j -= 1
    w = (mu - table.angle[j, 0]) * table.angle[j, 1]
    for f in range(out.size):
        k = 6 + 8 * f
        c, b = table.cell, table.value
        vertical = c[i, k] + v * (c[i, k + 1] + v * (c[i, k + 2] + v * c[i, k + 3]))
        low = b[i, j, f] + w * (b[i, j + 1, f] - b[i, j, f])
        high = b[i + 1, j, f] + w * (b[i + 1, j + 1, f] - b[i + 1, j, f])
        out[f] = vertical / (low + v * (high - low))


@entry
def outward_columns_at(table, heights, mu, out):
    """Columns [m] from altitudes (altitude,) to the top under a zenith cosine mu >= 0, into `out` (altitude, field)."""
    for k in range(heights.size):
        outward_columns(table, heights[k], mu, out[k])


@inlined
def columns_to_light(table, r, mu, work, out):
    """Columns [m] from radius r towards a distant light at zenith cosine mu; False if the planet is in the way."""
    low = r * math.sqrt((1.0 - mu) * (1.0 + mu))
    if mu < 0.0 and low <= table.radius:
        return False
    outward_columns(table, r - table.radius, abs(mu), out)
    if mu < 0.0:
        # Twice from the lowest point outward, less what lies behind the observer.
        outward_columns(table, low - table.radius, 0.0, work)
        for f in range(out.size):
            out[f] = max(2.0 * work[f] - out[f], 0.0)
    return True


@kernel
def trace_line(table, x, y, z, dx, dy, dz):
    """The `Line` of a ray from (x, y, z) in direction (dx, dy, dz) through the atmosphere of a table."""
    # The cross product keeps the digits of p that |x|^2 - (x.d)^2 would lose.
    cx, cy, cz = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
    p = math.sqrt(cx * cx + cy * cy + cz * cz)
    start = x * dx + y * dy + z * dz
    outer = table.radius + table.top
    if p >= outer:
        return Line(p, start, start, start, False)
    t_top = math.sqrt((outer - p) * (outer + p))
    enter = max(start, -t_top)
    if p < table.radius and start < 0.0:
        ground = -math.sqrt((table.radius - p) * (table.radius + p))
        return Line(p, start, enter, max(ground, enter), True)
    return Line(p, start, enter, max(t_top, enter), False)


@kernel
def start_columns(table, line, from_start, across):
    """Prepare `columns_along`: columns outward from the entry, and twice those of the lowest point if it is passed."""
    r = math.sqrt(line.p * line.p + line.enter * line.enter)
    outward_columns(table, r - table.radius, min(abs(line.enter) / r, 1.0), from_start)
    if line.enter < 0.0 < line.leave:
        outward_columns(table, line.p - table.radius, 0.0, across)
        for f in range(across.size):
            across[f] *= 2.0


@inlined
def columns_along(table, line, t, from_start, across, out):
    """Columns [m] from the entry of a line to t, into `out` (field,); returns the radius at t."""
    r = math.sqrt(line.p * line.p + t * t)
    outward_columns(table, r - table.radius, min(abs(t) / r, 1.0), out)
    for f in range(out.size):
        if line.enter >= 0.0:
            out[f] = max(from_start[f] - out[f], 0.0)
        elif t <= 0.0:
            out[f] = max(out[f] - from_start[f], 0.0)
        else:
            out[f] = max(across[f] - from_start[f] - out[f], 0.0)
    return r


def table_altitudes(fields: FieldTable, count: int = 200) -> np.ndarray:
    """Altitude nodes: quadratic from the ground, closing in on both sides of every break, and dense within layers."""
    top = float(fields.breaks[-1])
    nodes = set(top * (np.arange(count + 1) / count) ** 2)
    for f in range(fields.kind.size):
        if fields.kind[f] in (GAUSSIAN, CHAPMAN):
            centre, width = fields.parameters[f, :2]
            nodes |= set(centre + width * np.linspace(-4.0, 8.0, 61))
    # Many breaks are those of a table, whose cells are small already.
    refinements = int(np.clip(100 // fields.breaks.size, 1, 9))
    for b in fields.breaks:
        step = 4 * np.sqrt(b * top) / count
        for k in range(refinements):
            nodes |= {b - step * 0.5**k, b + step * 0.5**k}
    # Nodes of tabulated profiles are kept where they are sparser than the grid; those of dense tables add nothing.
    wanted = np.array(sorted(h for h in nodes if 0 <= h <= top))
    spacing = 2 * np.sqrt(np.maximum(fields.node_altitude, 1.0) * top) / count
    nearest = np.min(np.abs(fields.node_altitude[:, None] - wanted), axis=1, initial=np.inf)
    kept = fields.node_altitude[(nearest > 0.4 * spacing) & (fields.node_altitude <= top)]
    # Breaks come first, so that nothing within rounding of one can take its place.
    inside = np.array(sorted(set(wanted) | set(kept)))
    apart = np.min(np.abs(inside[:, None] - fields.breaks), axis=1) > 1e-9 * top
    return np.unique(np.concatenate([inside[apart], fields.breaks[fields.breaks <= top]]))


def build_column_table(
    fields: FieldTable,
    angles: int = 256,
    bend: float = 0.04,
    in_parts: Callable[[Callable[[slice], None], int, int], None] | None = None,
) -> ColumnTable:
    """Tabulate fields over altitude and angle; `in_parts` (`skyscatter.workers`) lets all processors do it.

    Columns of exponential shells, tents and tabulated air are good to 2e-5 of the greatest column through the field,
    those of narrow or sharp-edged layers, grazing within a cell of their edge, to 2e-3 (tested against exact ones).
    """
    altitude = table_altitudes(fields)
    x = np.arange(angles + 1) / angles
    mu = bend * x / (1 + bend - x)
    mu[-1] = 1.0
    samples = np.empty((altitude.size - 1, fields.kind.size, 2, 4))
    fill_samples(fields, altitude, samples)
    to_cubic = np.linalg.inv(np.vander(np.arange(4) / 3, increasing=True))
    cubic = (samples @ to_cubic.T).reshape(altitude.size - 1, fields.kind.size, 8)
    value = np.empty((altitude.size, mu.size, fields.kind.size))

    def some(nodes: slice) -> None:
        work = np.empty((10 + fields.kind.size, mu.size))
        fill_reciprocal_air_mass(fields.radius, altitude, cubic, mu, nodes.start, nodes.stop, work, value)

    if in_parts is None:
        some(slice(0, altitude.size))
    else:
        in_parts(some, altitude.size, NODES_AT_ONCE)
    levels = altitude[-1] * (np.arange(2048) / 2047) ** 2
    guess = np.clip(np.searchsorted(altitude, levels, side="right") - 1, 0, altitude.size - 2).astype(np.int64)
    feet = np.stack([altitude[:-1], 1 / np.diff(altitude)], axis=1)
    cell = np.ascontiguousarray(np.hstack([feet, cubic.reshape(len(feet), -1)]))
    angle = np.stack([mu, np.append(1 / np.diff(mu), 0.0)], axis=1)
    return ColumnTable(cell, value, angle, guess, bend, fields.radius, float(altitude[-1]))
