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

from skyscatter.solvers.kernels.jit import entry, inlined, kernel
from skyscatter.solvers.kernels.particles import particle_column, particle_density
from skyscatter.solvers.kernels.voxels import voxel_column, voxel_density

#: Leaves.
SPHERE, GAUSSIAN_SPHERE = 0, 1
VOXELS, PARTICLES = 50, 51
#: Operations on the values below them.
PRODUCT = 100
#: How a term's column is found.
CLOSED_FORM, CELLS, QUADRATURE = 0, 1, 2
#: Numbers of a leaf's affine map, row by row: local = A (x, y, z, 1).
AFFINE = 12


class SpaceTable(NamedTuple):
    """The fields of a medium."""

    term_start: np.ndarray  #: (component + 1,) int64, first term of each component
    code_start: np.ndarray  #: (term + 1,) int64, first instruction of each term
    method: np.ndarray  #: (term,) int64: CLOSED_FORM, CELLS or QUADRATURE
    factor: np.ndarray  #: (term,) weight of the term within its component
    box: np.ndarray  #: (term, 2, 3) lowest and highest corner of where the term is not nought [m]
    scale: np.ndarray  #: (term,) longest panel of the quadrature [m]
    code: np.ndarray  #: (instruction, 3) int64: operation, offset in `parameters`, offset in `index`
    parameters: np.ndarray  #: float64: affine maps and shapes
    data: np.ndarray  #: float32: voxels, particles, modes
    index: np.ndarray  #: int64: shapes of grids, lists of particles
    low: np.ndarray  #: (3,) lowest corner of everything [m]
    high: np.ndarray  #: (3,) highest corner
    cells: np.ndarray  #: (3,) int64, cells of the grid of bounds along each axis
    upper: np.ndarray  #: (cell, component) density that is not exceeded in a cell, cells in C order
    lower: np.ndarray  #: (cell, component) density that is reached everywhere in a cell
    bound_low: np.ndarray  #: (3,) lowest corner of the grid of bounds [m]: `low`, where it does not repeat
    bound_step: np.ndarray  #: (3,) sides of its cells [m]
    bound_wrap: np.ndarray  #: (3,) int64, 1 where the grid of bounds repeats, as the medium does


class SpaceWork(NamedTuple):
    """Scratch arrays of the fields' kernels."""

    stack: np.ndarray  #: (depth,) values of a running program
    cuts: np.ndarray  #: (n,) distances at which quadrature stops


def make_space_work() -> SpaceWork:
    """Scratch arrays; a thread needs its own."""
    return SpaceWork(np.zeros(16), np.zeros(64))


@inlined
def local_point(p, at, x, y, z):
    """A point in the local frame of the leaf whose affine map begins at `at`."""
    return (
        p[at] * x + p[at + 1] * y + p[at + 2] * z + p[at + 3],
        p[at + 4] * x + p[at + 5] * y + p[at + 6] * z + p[at + 7],
        p[at + 8] * x + p[at + 9] * y + p[at + 10] * z + p[at + 11],
    )


@kernel
def leaf_density(space, row, x, y, z):
    """Density of one leaf at a point of the model's frame."""
    kind, at, place = space.code[row, 0], space.code[row, 1], space.code[row, 2]
    if kind == VOXELS:
        return voxel_density(space.parameters, space.index, space.data, at, place, x, y, z)
    if kind == PARTICLES:
        return particle_density(space.parameters, space.index, space.data, at, place, x, y, z)
    a, b, c = local_point(space.parameters, at, x, y, z)
    m = a * a + b * b + c * c
    if kind == SPHERE:
        return 1.0 if m <= 1.0 else 0.0
    return math.exp(-0.5 * m)


@kernel
def term_density(space, term, x, y, z, work):
    """Density of one term at a point."""
    top = 0
    for row in range(space.code_start[term], space.code_start[term + 1]):
        if space.code[row, 0] == PRODUCT:
            top -= 1
            work.stack[top - 1] *= work.stack[top]
        else:
            work.stack[top] = leaf_density(space, row, x, y, z)
            top += 1
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
    kind, at = space.code[row, 0], space.code[row, 1]
    p = space.parameters
    a, b, c = local_point(p, at, ox, oy, oz)
    u = p[at] * dx + p[at + 1] * dy + p[at + 2] * dz
    v = p[at + 4] * dx + p[at + 5] * dy + p[at + 6] * dz
    w = p[at + 8] * dx + p[at + 9] * dy + p[at + 10] * dz
    # In the local frame the line is (a, b, c) + t (u, v, w); s counts from its point nearest to the middle.
    speed = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / speed, v / speed, w / speed
    s0 = a * u + b * v + c * w
    e, f, g = b * w - c * v, c * u - a * w, a * v - b * u
    q = e * e + f * f + g * g
    sa, sb = s0 + ta * speed, s0 + tb * speed
    if kind == SPHERE:
        if q >= 1.0:
            return 0.0
        half = math.sqrt(1.0 - q)
        return max(min(sb, half) - max(sa, -half), 0.0) / speed
    root = math.sqrt(0.5)
    return math.exp(-0.5 * q) * math.sqrt(0.5 * math.pi) * (math.erf(sb * root) - math.erf(sa * root)) / speed


@kernel
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
            b = space.box[term]
            t0, t1 = clip_to_box(b[0], b[1], ox, oy, oz, dx, dy, dz, ta, tb)
            if t1 > t0:
                row = space.code_start[term]
                if space.method[term] == CELLS:
                    column = cell_column(space, row, ox, oy, oz, dx, dy, dz, t0, t1)
                else:
                    column = closed_column(space, row, ox, oy, oz, dx, dy, dz, t0, t1)
                out[c] += space.factor[term] * column


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
