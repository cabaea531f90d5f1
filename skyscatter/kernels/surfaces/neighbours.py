"""Which visibility points are near: a regular grid of cells over the spheres around them.

A point is listed in every cell that the box around its sphere meets.  So whatever lies within the sphere finds the
point in the one cell in which it lies itself, and a segment finds it in the cell of its foot; nothing is found twice.
Cells are as wide as a sphere, so that a point is listed in 8 of them at most, or wider where more than `MOST_CELLS`
would be needed: memory is bounded by 8 numbers for each point and one for each cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, inlined

#: Cells of the grid at most: 4 bytes each.
MOST_CELLS = 1 << 21
#: Spheres are listed as if they were larger by this share, so that rounding loses none.
_HAIR = 1e-9


@by_address
class Cells(NamedTuple):
    """The grid; the first fields are those that `kernels.gridwalk` reads."""

    low: np.ndarray  #: (3,) [m]
    high: np.ndarray  #: (3,) [m]
    cells: np.ndarray  #: (3,) int64
    bound_low: np.ndarray  #: (3,) the same as `low`
    bound_step: np.ndarray  #: (3,) sides of a cell [m]
    bound_wrap: np.ndarray  #: (3,) int64, zero: nothing repeats
    start: np.ndarray  #: (cell + 1,) int32, first entry of each cell, cells in C order
    entry: np.ndarray  #: (n,) int32, numbers of points, cell by cell


def make_cells(place: np.ndarray, radius: float, side: float = 2.0) -> Cells:
    """Grid over spheres of one radius around `place` (point, 3) [m].

    Parameters
    ----------
    place : ndarray, shape (point, 3)
    radius : float
        Of the spheres [m].
    side : float
        Least side of a cell in radii.
    """
    if not len(place):
        zero = np.zeros(3)
        ones = np.ones(3)
        return Cells(
            zero, zero - 1.0, np.ones(3, np.int64), zero, ones, np.zeros(3, np.int64), np.zeros(2, np.int32),
            np.zeros(0, np.int32),
        )  # fmt: skip
    low, high = place.min(axis=0), place.max(axis=0)
    reach = radius * (1.0 + _HAIR) + _HAIR * np.abs(place).max()
    low, high = low - reach, high + reach
    extent = high - low
    width = side * reach  # not of the radius: one lost in the rounding of places would fill all cells with each point
    while np.prod(np.ceil(extent / width)) > MOST_CELLS:
        width *= 1.1
    cells = np.ceil(extent / width).astype(np.int64)
    step = extent / cells
    start = np.zeros(int(np.prod(cells)) + 1, np.int32)
    count_entries(place, reach, low, 1.0 / step, cells, start)
    np.cumsum(start, out=start)
    listed = np.empty(int(start[-1]), np.int32)
    list_entries(place, reach, low, 1.0 / step, cells, start, listed)
    return Cells(low, high, cells, low, step, np.zeros(3, np.int64), start, listed)


@inlined
def cell_span(x, reach, low, inverse, n):
    """First and last cell along one axis that an interval around x meets."""
    first = np.int64(math.floor((x - reach - low) * inverse))
    last = np.int64(math.floor((x + reach - low) * inverse))
    return max(first, np.int64(0)), min(last, n - 1)


@entry
def count_entries(place, reach, low, inverse, cells, start):
    """Number of entries of every cell, into ``start[cell + 1]``."""
    for p in range(place.shape[0]):
        a0, a1 = cell_span(place[p, 0], reach, low[0], inverse[0], cells[0])
        b0, b1 = cell_span(place[p, 1], reach, low[1], inverse[1], cells[1])
        c0, c1 = cell_span(place[p, 2], reach, low[2], inverse[2], cells[2])
        for a in range(a0, a1 + 1):
            for b in range(b0, b1 + 1):
                for c in range(c0, c1 + 1):
                    start[(a * cells[1] + b) * cells[2] + c + 1] += np.int32(1)


@entry
def list_entries(place, reach, low, inverse, cells, start, listed):
    """Numbers of the points of every cell; `start` is moved on and put back."""
    for p in range(place.shape[0]):
        a0, a1 = cell_span(place[p, 0], reach, low[0], inverse[0], cells[0])
        b0, b1 = cell_span(place[p, 1], reach, low[1], inverse[1], cells[1])
        c0, c1 = cell_span(place[p, 2], reach, low[2], inverse[2], cells[2])
        for a in range(a0, a1 + 1):
            for b in range(b0, b1 + 1):
                for c in range(c0, c1 + 1):
                    cell = (a * cells[1] + b) * cells[2] + c
                    listed[start[cell]] = p
                    start[cell] += np.int32(1)
    for cell in range(start.size - 1, 0, -1):
        start[cell] = start[cell - 1]
    start[0] = np.int32(0)


@inlined
def cell_at(grid, x, y, z):
    """Number of the cell in which a point lies, -1 outside of the grid."""
    if not (grid.low[0] <= x < grid.high[0] and grid.low[1] <= y < grid.high[1] and grid.low[2] <= z < grid.high[2]):
        return np.int64(-1)
    a = min(np.int64((x - grid.low[0]) / grid.bound_step[0]), grid.cells[0] - 1)
    b = min(np.int64((y - grid.low[1]) / grid.bound_step[1]), grid.cells[1] - 1)
    c = min(np.int64((z - grid.low[2]) / grid.bound_step[2]), grid.cells[2] - 1)
    return (a * grid.cells[1] + b) * grid.cells[2] + c
