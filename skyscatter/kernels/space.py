"""Density fields in three dimensions as data, and the three questions that solvers ask of them.

A component's density is a sum of *terms*.  A term is a small postfix program over leaves (a sphere, a voxel grid, a set
of particles) and operations (product, carving, warping); every leaf carries its own affine map from the model's frame
to the frame in which its shape is simplest, so moving, turning and scaling cost nothing extra.

- `space_densities`: the density of every component at a point;
- `space_columns`: the column of every component along a piece of a line, in closed form where the term has one,
  cell by cell through voxels, and by Gauss-Legendre quadrature between the term's sharp edges elsewhere;
- `clip_to_space`: the piece of a line on which there can be anything at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.space import (
    AROUND,
    BONNOR_EBERT,
    BOX,
    CELLS,
    CLOSED_FORM,
    CONE,
    DISK,
    FILAMENT,
    FRAMES,
    FRONT,
    GATE,
    GAUSSIAN_SHELL,
    GAUSSIAN_SPHERE,
    LAST_SHAPE,
    PARTICLES,
    PIECES,
    POWER,
    POWER_LAW,
    PRODUCT,
    SCALE,
    SHELL,
    SPHERE,
    STACK,
    SUM,
    TRANSPARENT,
    TURBULENCE,
    UNWARP,
    VOXELS,
    WARP,
)
from skyscatter.kernels.edges import shape_edges
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.particles import particle_column, particle_density
from skyscatter.kernels.shapecolumns import (
    box_column,
    gaussian_column,
    power_law_column,
    shell_column,
    sphere_column,
)
from skyscatter.kernels.shapes import (
    around_planet,
    bonnor_ebert,
    cone,
    disk,
    displacement,
    filament_distance,
    front,
    gaussian_shell,
    gaussian_sphere,
    power_law,
    tube_profile,
    turbulence,
)
from skyscatter.kernels.voxels import voxel_column, voxel_density

#: Kronrod's extension of the 7-point Gauss rule on [-1, 1]: nodes, weights, and the Gauss weights inside it.
_X = (0.991455371120812639206854697526329, 0.949107912342758524526189684047851, 0.864864423359769072789712788640926,
      0.741531185599394439863864773280788, 0.586087235467691130294144691693013, 0.405845151377397166906606412076961,
      0.207784955007898467600689403773245)  # fmt: skip
_W = (0.022935322010529224963732008058970, 0.063092092629978553290700663189204, 0.104790010322250183839876322541518,
      0.140653259715525918745189590510238, 0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
      0.204432940075298892414161999234649)  # fmt: skip
_G = (0.0, 0.129484966168869693270611432679082, 0.0, 0.279705391489276667901467771423780, 0.0,
      0.381830050505118944950369775488975, 0.0)  # fmt: skip
KRONROD_X = np.array([*(-x for x in _X), 0.0, *_X[::-1]])
KRONROD_W = np.array([*_W, 0.209482141084727828012999174891714, *_W[::-1]])
GAUSS_W = np.array([*_G, 0.417959183673469387755102040816327, *_G[::-1]])
#: A second coarser rule, of all nodes but three: both agree with the finer one by chance less often than one.
_KEPT = np.setdiff1d(np.arange(15), (3, 7, 11))
OTHER_W = np.zeros(15)
OTHER_W[_KEPT] = np.linalg.solve(np.polynomial.legendre.legvander(KRONROD_X[_KEPT], 11).T, 2.0 * (np.arange(12) == 0))
#: Lagrange weights that carry the values at the nodes on to an end of the panel, a hair within it.
END = 1.0 - 1e-9
TO_END = np.array([np.prod([(END - y) / (x - y) for y in KRONROD_X if y != x]) for x in KRONROD_X])
#: Error of a column by quadrature relative to it, and halvings of a panel at most: a jump is found to 1e-7 of it.
TOLERANCE, DEPTH = 1e-6, 24
#: Numbers of a leaf's affine map, row by row: local = A (x, y, z, 1).
AFFINE = 12


@by_address
class SpaceTable(NamedTuple):
    """The fields of a medium."""

    term_start: np.ndarray  #: (component + 1,) int64, first term of each component
    code_start: np.ndarray  #: (term + 1,) int64, first instruction of each term
    method: np.ndarray  #: (term,) int64: CLOSED_FORM, CELLS or QUADRATURE
    factor: np.ndarray  #: (term,) weight of the term within its component
    box: np.ndarray  #: (term, 2, 3) lowest and highest corner of where the term is not zero [m]
    scale: np.ndarray  #: (term,) longest panel of the quadrature [m]
    code: np.ndarray  #: (instruction, 3) int64: operation, offset in `parameters`, offset in `index`
    parameters: np.ndarray  #: float64: affine maps and shapes
    data: np.ndarray  #: float32: voxels, particles, modes
    index: np.ndarray  # type: ignore[assignment]  #: int64: shapes of grids, lists of particles
    low: np.ndarray  #: (3,) lowest corner of everything [m]
    high: np.ndarray  #: (3,) highest corner
    cells: np.ndarray  #: (3,) int64, cells of the grid of bounds along each axis
    upper: np.ndarray  #: (cell, component) density that is not exceeded in a cell, cells in C order
    lower: np.ndarray  #: (cell, component) density that is reached everywhere in a cell
    bound_low: np.ndarray  #: (3,) lowest corner of the grid of bounds [m]: `low`, where it does not repeat
    bound_step: np.ndarray  #: (3,) sides of its cells [m]
    bound_wrap: np.ndarray  #: (3,) int64, 1 where the grid of bounds repeats, as the medium does


@by_address
class SpaceWork(NamedTuple):
    """Scratch arrays of the fields' kernels."""

    stack: np.ndarray  #: (depth,) values of a running program
    cuts: np.ndarray  #: (n,) distances at which quadrature stops
    frames: np.ndarray  #: (depth, 6) points, or origins and directions of lines, outside of warps
    panels: np.ndarray  #: (n, 4) start, length, integral and error of panels of the quadrature


#: Edges of a term along a line.
CUTS = 512


def make_space_work() -> SpaceWork:
    """Scratch arrays; a thread needs its own."""
    return SpaceWork(np.zeros(STACK), np.zeros(CUTS), np.zeros((FRAMES, 6)), np.zeros((128, 4)))


@inlined
def local_point(p, at, x, y, z):
    """A point in the local frame of the leaf whose affine map begins at `at`."""
    return (
        p[at] * x + p[at + 1] * y + p[at + 2] * z + p[at + 3],
        p[at + 4] * x + p[at + 5] * y + p[at + 6] * z + p[at + 7],
        p[at + 8] * x + p[at + 9] * y + p[at + 10] * z + p[at + 11],
    )


@inlined
def local_direction(p, at, x, y, z):
    """A direction in the local frame of the leaf whose affine map begins at `at`."""
    return (
        p[at] * x + p[at + 1] * y + p[at + 2] * z,
        p[at + 4] * x + p[at + 5] * y + p[at + 6] * z,
        p[at + 8] * x + p[at + 9] * y + p[at + 10] * z,
    )


@inlined
def leaf_density(space, row, x, y, z):
    """Density of one leaf at a point of the model's frame."""
    kind, p, at = space.code[row, 0], space.parameters, space.code[row, 1]
    if kind == VOXELS:
        return voxel_density(p, space.index, space.data, at, space.code[row, 2], x, y, z)
    if kind == PARTICLES:
        return particle_density(p, space.index, space.data, at, space.code[row, 2], x, y, z)
    a, b, c = local_point(p, at, x, y, z)
    return shape_density(space, row, kind, p, at + AFFINE, a, b, c)


@inlined
def shape_density(space, row, kind, p, at, a, b, c):
    """Density of an analytic shape at a point of its own frame."""
    m = a * a + b * b + c * c
    value = 0.0
    if kind == SPHERE:
        value = 1.0 if m <= 1.0 else 0.0
    elif kind == GAUSSIAN_SPHERE:
        value = gaussian_sphere(p, at, m)
    elif kind == POWER_LAW:
        value = power_law(p, at, m)
    elif kind == BONNOR_EBERT:
        value = bonnor_ebert(p, at, m)
    elif kind == SHELL:
        value = 1.0 if p[at] <= m <= 1.0 else 0.0
    elif kind == GAUSSIAN_SHELL:
        value = gaussian_shell(p, at, m)
    elif kind == DISK:
        value = disk(p, at, a, b, c)
    elif kind == CONE:
        value = cone(p, at, m, c)
    elif kind == BOX:
        value = 1.0 if max(abs(a), abs(b), abs(c)) <= 1.0 else 0.0
    elif kind == FILAMENT:
        value = tube_profile(p, at, filament_distance(p, at + 3, a, b, c))
    elif kind == TURBULENCE:
        i = space.code[row, 2]
        value = turbulence(p, at, space.data, space.index[i], space.index[i + 1], a, b, c)
    elif kind == FRONT:
        value = front(p, at, a, b, c)
    elif kind == AROUND:
        value = around_planet(p, at, m)
    return value


@inlined
def combine(kind, p, at, a, b):
    """An operation on two values."""
    if kind == PRODUCT:
        return a * b
    if kind == SUM:
        return a + b
    # CARVE: below a level, or (no level, written as -1) by what is missing to 1.
    if p[at] >= 0.0:
        return a if b < p[at] else 0.0
    return a * max(1.0 - b, 0.0)


@inlined
def term_density(space, term, x, y, z, work):
    """Density of one term at a point."""
    p, top, depth = space.parameters, 0, 0
    row, end = space.code_start[term], space.code_start[term + 1]
    while row < end:
        kind, at = space.code[row, 0], space.code[row, 1]
        if kind < PRODUCT:
            work.stack[top] = leaf_density(space, row, x, y, z)
            top += 1
        elif kind == GATE:
            if work.stack[top - 1] == 0.0:
                row += space.index[space.code[row, 2]]
        elif kind == SCALE:
            work.stack[top - 1] *= p[at]
        elif kind == POWER:
            work.stack[top - 1] = work.stack[top - 1] ** p[at]
        elif kind == WARP:
            work.frames[depth, 0], work.frames[depth, 1], work.frames[depth, 2] = x, y, z
            depth += 1
            x, y, z = local_point(p, at, x, y, z)
            u, v, w = displacement(p, at + AFFINE, x, y, z)
            x, y, z = x + u, y + v, z + w
        elif kind == UNWARP:
            depth -= 1
            x, y, z = work.frames[depth, 0], work.frames[depth, 1], work.frames[depth, 2]
        else:
            top -= 1
            work.stack[top - 1] = combine(kind, p, at, work.stack[top - 1], work.stack[top])
        row += 1
    return space.factor[term] * work.stack[0]


@entry
def space_densities(space, x, y, z, work, out):
    """Density of every component at a point [m], into `out` (component,)."""
    for c in range(out.size):
        out[c] = 0.0
        for term in range(space.term_start[c], space.term_start[c + 1]):
            b = space.box[term]
            if b[0, 0] <= x <= b[1, 0] and b[0, 1] <= y <= b[1, 1] and b[0, 2] <= z <= b[1, 2]:
                out[c] += term_density(space, term, x, y, z, work)


@inlined
def clip_to_slab(low, high, x, d, ta, tb):
    """The part of [ta, tb] in which x + d t lies between low and high."""
    if d == 0.0:
        return (ta, tb) if low <= x <= high else (math.inf, -math.inf)
    t0, t1 = (low - x) / d, (high - x) / d
    return max(ta, min(t0, t1)), min(tb, max(t0, t1))


@entry
def clip_to_box(low, high, ox, oy, oz, dx, dy, dz, ta, tb):
    """The part of [ta, tb] in which a line is inside a box; empty (first above second) when it misses."""
    ta, tb = clip_to_slab(low[0], high[0], ox, dx, ta, tb)
    ta, tb = clip_to_slab(low[1], high[1], oy, dy, ta, tb)
    return clip_to_slab(low[2], high[2], oz, dz, ta, tb)


@kernel
def closed_column(space, row, ox, oy, oz, dx, dy, dz, ta, tb):
    """Column of one leaf along a piece of a line, in closed form."""
    kind, p, at = space.code[row, 0], space.parameters, space.code[row, 1]
    a, b, c = local_point(p, at, ox, oy, oz)
    u, v, w = local_direction(p, at, dx, dy, dz)
    at += AFFINE
    if kind == BOX:
        return box_column(a, b, c, u, v, w, ta, tb)
    # In the local frame the line is (a, b, c) + t (u, v, w); s counts from its point nearest to the middle.
    speed = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / speed, v / speed, w / speed
    s0 = a * u + b * v + c * w
    e, f, g = b * w - c * v, c * u - a * w, a * v - b * u
    q = e * e + f * f + g * g
    sa, sb = s0 + ta * speed, s0 + tb * speed
    column = 0.0
    if kind == SPHERE:
        column = sphere_column(q, sa, sb)
    elif kind == GAUSSIAN_SPHERE:
        column = gaussian_column(q, p[at], sa, sb)
    elif kind == POWER_LAW:
        column = power_law_column(q, p[at], p[at + 1], sa, sb)
    elif kind == SHELL:
        column = shell_column(q, p[at], sa, sb)
    return column / speed


@kernel
def term_cuts(space, term, ox, oy, oz, dx, dy, dz, length, work):
    """Sorted distances, both ends among them, between which the term is smooth; their number.

    Within a warp the edges are where they would be without it: near enough to start from.
    """
    p, cuts, depth = space.parameters, work.cuts, 0
    cuts[0], cuts[1] = 0.0, length
    n = np.int64(2)
    for row in range(space.code_start[term], space.code_start[term + 1]):
        kind, at = space.code[row, 0], space.code[row, 1]
        if kind <= LAST_SHAPE or kind == WARP:
            a, b, c = local_point(p, at, ox, oy, oz)
            u, v, w = local_direction(p, at, dx, dy, dz)
        if kind <= LAST_SHAPE:
            n = shape_edges(kind, p, at + AFFINE, cuts, n, a, b, c, u, v, w, length)
        elif kind == WARP:
            frame = work.frames[depth]
            frame[0], frame[1], frame[2], frame[3], frame[4], frame[5] = ox, oy, oz, dx, dy, dz
            ox, oy, oz, dx, dy, dz = a, b, c, u, v, w
            depth += 1
        elif kind == UNWARP:
            depth -= 1
            frame = work.frames[depth]
            ox, oy, oz, dx, dy, dz = frame[0], frame[1], frame[2], frame[3], frame[4], frame[5]
    for i in range(1, n):
        x, j = cuts[i], i
        while j > 0 and cuts[j - 1] > x:
            cuts[j] = cuts[j - 1]
            j -= 1
        cuts[j] = x
    return n


@kernel
def put_panel(space, term, ox, oy, oz, dx, dy, dz, start, width, panel, work):
    """Gauss-Kronrod integral of a term over a stretch of a line, and its error, into `panel`.

    The pair's difference is the error of the coarser rule; for a smooth integrand the finer one's goes as its power
    of 3/2 (as in QUADPACK, Piessens et al. 1983), for a kink or a jump among the nodes it is as large as itself.
    A jump between an end and the outermost node shows in what the nodes foretell for the end.
    """
    fine, coarse, other, first, last, beyond = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    nodes = KRONROD_X.size
    for k in range(nodes + 2):
        x = KRONROD_X[k] if k < nodes else (END if k == nodes else -END)
        t = start + 0.5 * width * (1.0 + x)
        value = term_density(space, term, ox + t * dx, oy + t * dy, oz + t * dz, work)
        if k < nodes:
            fine += KRONROD_W[k] * value
            coarse += GAUSS_W[k] * value
            other += OTHER_W[k] * value
            last += TO_END[k] * value
            first += TO_END[nodes - 1 - k] * value
        else:
            beyond += abs(value - (last if k == nodes else first))
    apart = max(abs(fine - coarse), abs(fine - other))
    panel[0], panel[1], panel[2] = start, width, 0.5 * width * fine
    panel[3] = panel[2] * min((20.0 * apart / max(fine, 1e-300)) ** 1.5, 1.0)
    panel[3] += 0.5 * width * (apart + (1.0 + KRONROD_X[0]) * beyond)


@kernel
def refined(space, term, ox, oy, oz, dx, dy, dz, panel, allowed, work):
    """Integral over a panel that is halved until every part of it is within the error allowed."""
    start, whole, level, i, total = panel[0], panel[1], 1, 0, 0.0
    while level > 0:
        width = math.ldexp(whole, -level)
        put_panel(space, term, ox, oy, oz, dx, dy, dz, start + i * width, width, panel, work)
        if panel[3] > allowed and level < DEPTH:
            level, i = level + 1, 2 * i
        else:
            total += panel[2]
            i += 1
            while i % 2 == 0 and level > 0:
                level, i = level - 1, i // 2
    return total


@kernel
def settled(space, term, ox, oy, oz, dx, dy, dz, count, total, work):
    """The running total with the first `count` panels, those refined whose error shows in it."""
    for k in range(count):
        total += work.panels[k, 2]
    allowed, sure = 0.1 * TOLERANCE * total, 0.0
    for k in range(count):
        if work.panels[k, 3] > allowed:
            sure -= work.panels[k, 2]
            sure += refined(space, term, ox, oy, oz, dx, dy, dz, work.panels[k], allowed, work)
    return total + sure


@kernel
def term_column(space, term, ox, oy, oz, dx, dy, dz, length, work):
    """Column of a term from o over a length [m], by quadrature between its edges."""
    cuts = term_cuts(space, term, ox, oy, oz, dx, dy, dz, length, work)
    total, count = 0.0, 0
    for i in range(cuts - 1):
        a, width = work.cuts[i], work.cuts[i + 1] - work.cuts[i]
        if width <= 1e-14 * length:
            continue
        if space.method[term] == PIECES:
            t = a + 0.5 * width
            total += width * term_density(space, term, ox + t * dx, oy + t * dy, oz + t * dz, work)
            continue
        parts = max(int(math.ceil(width / space.scale[term])), 1)
        for j in range(parts):
            if count == work.panels.shape[0]:
                total = settled(space, term, ox, oy, oz, dx, dy, dz, count, total, work)
                count = 0
            step = width / parts
            put_panel(space, term, ox, oy, oz, dx, dy, dz, a + j * step, step, work.panels[count], work)
            count += 1
    return settled(space, term, ox, oy, oz, dx, dy, dz, count, total, work)


@inlined
def cell_column(space, row, ox, oy, oz, dx, dy, dz, ta, tb):
    """Column of voxels or particles along a piece of a line, exact."""
    kind, at, place = space.code[row, 0], space.code[row, 1], space.code[row, 2]
    if kind == VOXELS:
        return voxel_column(space.parameters, space.index, space.data, at, place, ox, oy, oz, dx, dy, dz, ta, tb)
    return particle_column(space.parameters, space.index, space.data, at, place, ox, oy, oz, dx, dy, dz, ta, tb)


@entry
def space_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
    """Add the column of every component [m] along the line o + d t from ta to tb to `out` (component,)."""
    for c in range(out.size):
        for term in range(space.term_start[c], space.term_start[c + 1]):
            if space.method[term] == TRANSPARENT:
                continue
            b = space.box[term]
            t0, t1 = clip_to_box(b[0], b[1], ox, oy, oz, dx, dy, dz, ta, tb)
            if t1 > t0:
                row, method = space.code_start[term], space.method[term]
                if method == CLOSED_FORM:
                    column = closed_column(space, row, ox, oy, oz, dx, dy, dz, t0, t1)
                    out[c] += space.factor[term] * column
                elif method == CELLS:
                    column = cell_column(space, row, ox, oy, oz, dx, dy, dz, t0, t1)
                    out[c] += space.factor[term] * column
                else:
                    # Counted from where the line enters, distances keep their digits for observers far away.
                    x, y, z = ox + t0 * dx, oy + t0 * dy, oz + t0 * dz
                    out[c] += term_column(space, term, x, y, z, dx, dy, dz, t1 - t0, work)


@entry
def clip_to_space(space, ox, oy, oz, dx, dy, dz):
    """Distances [m] between which a ray from o can meet the medium; never if the first is above the second."""
    return clip_to_box(space.low, space.high, ox, oy, oz, dx, dy, dz, 0.0, math.inf)


@entry
def fill_densities(space, points, work, out):
    """Densities at many points (n, 3), into `out` (n, component)."""
    for n in range(points.shape[0]):
        space_densities(space, points[n, 0], points[n, 1], points[n, 2], work, out[n])


@entry
def fill_columns(space, start, end, work, out):
    """Columns between many pairs of points (n, 3), added to `out` (n, component)."""
    for n in range(start.shape[0]):
        dx, dy, dz = end[n, 0] - start[n, 0], end[n, 1] - start[n, 1], end[n, 2] - start[n, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length > 0.0:
            dx, dy, dz = dx / length, dy / length, dz / length
            space_columns(space, start[n, 0], start[n, 1], start[n, 2], dx, dy, dz, 0.0, length, work, out[n])
