"""Walks through the cells of regular grids.

The walk of Amanatides & Woo (1987), Eurographics '87, 3: along each axis one knows the distance at which the line next
meets a face, the smallest of the three is where it leaves its cell.  Three things differ from the textbook:

- distances to faces are computed from the number of the face, not by adding steps up, so errors do not grow;
- at an edge or corner all axes step at once: no cell of length zero, and no branch that a processor must guess;
- a grid may repeat: a cell's number wraps around while the face's goes on.

A cell holds both its faces.  A line that runs in the face between two cells is said to be in the upper one, at the
upper face of the whole grid in the last one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, inlined


@by_address
class Walker(NamedTuple):
    """Where a walk through the grid of bounds is; a thread needs its own."""

    place: np.ndarray  #: (15,) int64: cell (3), step (3), number of cells (3), stride (3), whether it repeats (3)
    line: np.ndarray  #: (14,) distances of the next faces (3), their numbers (3), start (3), distance per cell (3), t,
    #: end


def make_walker() -> Walker:
    """Scratch of one walk."""
    return Walker(np.zeros(15, np.int64), np.zeros(14))


@inlined
def start_axis(x, d, n, wrap):
    """Begin a walk along one axis, at x cells from the grid's corner, moving d cells per distance.

    Parameters
    ----------
    x, d : float
        Place and speed [cell, cell per distance].
    n : int
        Number of cells.
    wrap : bool
        Whether the grid repeats.

    Returns
    -------
    cell : int
        Number of the cell, 0 to n - 1.
    face : float
        Lower face of the cell, not wrapped [cell].
    step : int
        -1, 0 or 1.
    inverse : float
        Distance per cell; infinite when the line does not move along this axis.
    """
    face = math.floor(x)
    if wrap:
        cell = np.int64(face - n * math.floor(face / n))
    else:
        cell = np.int64(min(max(face, 0.0), n - 1.0))
        face = float(cell)
    # So slow a line never leaves its cell; its reciprocal would overflow.
    if abs(d) < 1e-280:
        return cell, face, np.int64(0), math.inf
    return cell, face, np.int64(1) if d > 0.0 else np.int64(-1), 1.0 / d


@inlined
def face_distance(face, x, inverse):
    """Distance at which a line that starts at x meets a face; never for one that does not move towards it."""
    return math.inf if inverse == math.inf else (face - x) * inverse


@entry
def enter_cells(space, ox, oy, oz, dx, dy, dz, t, walker):
    """Begin a walk along the line o + d t through the grid of bounds, from distance t on.

    Parameters
    ----------
    space : SpaceTable
    ox, oy, oz, dx, dy, dz : float
        A point of the line [m] and its direction, of length 1.
    t : float
        Distance [m] at which the walk begins; before the grid, within it or behind it.
    walker : Walker
        Is overwritten.

    Returns
    -------
    float
        Distance at which the first cell is entered, t or later; infinite when the line does not meet the grid.
    """
    place, line = walker.place, walker.line
    end = math.inf
    for k in range(3):
        o, d = (ox, dx) if k == 0 else ((oy, dy) if k == 1 else (oz, dz))
        low, high = space.low[k], space.high[k]
        if abs(d) < 1e-280:
            if not low <= o <= high:
                end = -math.inf
        else:
            t0, t1 = (low - o) / d, (high - o) / d
            t, end = max(t, min(t0, t1)), min(end, max(t0, t1))
    line[12], line[13] = t, end
    if not t < end:
        return math.inf
    stride = 1
    for j in range(3):
        k = 2 - j
        o, d = (ox, dx) if k == 0 else ((oy, dy) if k == 1 else (oz, dz))
        n = space.cells[k]
        cell = 1.0 / space.bound_step[k]
        x, speed = (o - space.bound_low[k]) * cell, d * cell
        # The cell is found where the walk begins; the distances to faces count from the line's own origin.
        place[k], face, place[3 + k], inverse = start_axis(x + speed * t, speed, n, space.bound_wrap[k] != 0)
        place[6 + k], place[9 + k], place[12 + k] = n, stride, space.bound_wrap[k]
        stride *= n
        line[3 + k] = face + (1.0 if speed > 0.0 else 0.0)
        line[6 + k], line[9 + k] = x, inverse
        line[k] = face_distance(line[3 + k], x, inverse)
    return t


@entry
def next_cell(walker):
    """The cell that a walk is in, and one step on.

    Returns
    -------
    cell : int
        Flat number, in C order, of the cell (a row of `SpaceTable.upper`); -1 when the walk has left the grid.
    t : float
        Distance [m] at which the line leaves that cell: the next one is entered there.
    """
    place, line = walker.place, walker.line
    t, end = line[12], line[13]
    if not t < end:
        return -1, math.inf
    flat = place[0] * place[9] + place[1] * place[10] + place[2] * place[11]
    leave = max(min(line[0], line[1], line[2]), t)
    for k in range(3):
        if line[k] <= leave:
            cell, n = place[k] + place[3 + k], place[6 + k]
            if cell < 0 or cell >= n:
                cell = n - 1 if cell < 0 else 0
                if place[12 + k] == 0:
                    line[13] = t
            place[k] = cell
            line[3 + k] += place[3 + k]
            line[k] = face_distance(line[3 + k], line[6 + k], line[9 + k])
    leave = min(leave, end)
    line[12] = leave
    return flat, leave
