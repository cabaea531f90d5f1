"""Rows of pictures: rays from one place at one height above the horizon, of which few are solved and the rest joined.

Along such a row the diffuse light depends on nothing but the azimuth from the Sun, and evenly to both sides.  It is
solved at nodes between 0 and 180 degrees, close to each other near the Sun, and a cubic spline goes through them.  What
comes straight from the Sun's disk has an edge: rays that may see it are solved themselves.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.base import Array
from skyscatter.solvers.sweeps import Problem, same_course, view

if TYPE_CHECKING:
    from skyscatter.kernels.optics import SceneTable
    from skyscatter.kernels.orders import Field

#: Nodes over 180 degrees of azimuth; they stand at squares, 0.01 degrees apart at the Sun and 2.8 opposite to it.
NODES = 129
#: Rays of a row from which on nodes are worth it.
FEWEST = 2 * NODES
#: What every other node may miss of the light between them, in tolerances of the solution.
MISSED = 0.1
#: Rays this near to the middle of the Sun, in radii of its disk, are solved themselves.
NEAR = 2.0


def view_rows(
    problem: Problem, field: Field, table: SceneTable, origins: Array, directions: Array, tolerance: float
) -> tuple[Array, Array, Array, Array]:
    """`skyscatter.solvers.sweeps.view`, with long rows of rays from one place joined from nodes.

    A row whose odd nodes are not met by a spline through the even ones, as beside the narrow peaks of large grains, is
    solved ray by ray; so is polarised light.
    """
    if problem.stokes > 1 or len(origins) < FEWEST or np.any(origins != origins[0]):
        return view(problem, field, table, origins, directions)
    order, edges = same_course(origins, directions, table.columns.radius)
    wide = np.flatnonzero(np.diff(edges) >= FEWEST)
    if not wide.size:
        return view(problem, field, table, origins, directions)
    rows = [order[edges[k] : edges[k + 1]] for k in wide]
    up, towards, beside = _frame(origins[0], np.asarray(table.optics.disk_axis))
    alone = np.ones(len(origins), bool)
    alone[np.concatenate(rows)] = False
    alone |= np.linalg.norm(directions - table.optics.disk_axis, axis=1) <= NEAR * 2 * math.sin(
        0.5 * float(table.optics.disk_radius)
    )
    plain = np.flatnonzero(alone)
    turn = _turn()
    level = np.cos(turn)[:, None] * towards + np.sin(turn)[:, None] * beside
    nodes = [_at(float(np.mean(directions[row] @ up)), up, level) for row in rows]
    asked = np.concatenate([directions[plain], *nodes])
    found = view(problem, field, table, np.broadcast_to(origins[0], asked.shape).copy(), asked)
    answers = tuple(np.empty((len(origins), *part.shape[1:])) for part in found)
    rough = []
    for k, row in enumerate(rows):
        own = slice(len(plain) + k * NODES, len(plain) + (k + 1) * NODES)
        if not is_smooth(found[0][own, 0] + found[1][own, 0] + found[2][own], tolerance):
            rough.append(row)
            continue
        azimuth = np.arctan2(np.abs(directions[row] @ beside), directions[row] @ towards)
        _join(azimuth, row, [part[own] for part in found], answers)
    for part, answer in zip(found, answers, strict=True):
        answer[plain] = part[: len(plain)]
    if rough:
        rest = np.concatenate(rough)
        for part, answer in zip(view(problem, field, table, origins[rest], directions[rest]), answers, strict=True):
            answer[rest] = part
    return answers[0], answers[1], answers[2], answers[3]


def is_smooth(light: Array, tolerance: float) -> bool:
    """Whether a spline through every other node meets the rest; with all nodes it is nearer, 16 times where smooth."""
    met = _between() @ light[::2]
    return bool(np.all(np.abs(met - light[1::2]) <= MISSED * tolerance * np.abs(light[1::2])))


def _join(azimuth: Array, row: NDArray[np.int64], nodes: list[Array], answers: tuple[Array, ...]) -> None:
    """Fill a row from its nodes; straight light beside the disk is that of the node opposite to the Sun."""
    # Rows of a picture have the same azimuths, but for their last digits.
    weights = _weights(np.round(azimuth, 9).tobytes())
    for part, answer in zip(nodes[:3], answers[:3], strict=True):
        answer[row] = (weights @ part.reshape(NODES, -1)).reshape(len(row), *part.shape[1:])
    answers[3][row] = nodes[3][-1]


def _turn() -> Array:
    return np.asarray(math.pi * (np.arange(NODES) / (NODES - 1)) ** 2)


@lru_cache(maxsize=8)
def _weights(azimuths: bytes) -> Array:
    """What each node counts for at some azimuths, (ray, node)."""
    from scipy.interpolate import CubicSpline

    at = np.minimum(np.frombuffer(azimuths), math.pi)
    return np.ascontiguousarray(CubicSpline(_turn(), np.eye(NODES), bc_type="clamped")(at))


@lru_cache(maxsize=1)
def _between() -> Array:
    """The same for the odd nodes from the even ones."""
    from scipy.interpolate import CubicSpline

    even = _turn()[::2]
    return np.ascontiguousarray(CubicSpline(even, np.eye(even.size), bc_type="clamped")(_turn()[1::2]))


def _frame(origin: Array, sun: Array) -> tuple[Array, Array, Array]:
    """The vertical, the horizontal direction towards the Sun, and that to its left; any two where it is overhead."""
    up = origin / np.linalg.norm(origin)
    level = sun - (sun @ up) * up
    if np.linalg.norm(level) < 1e-9:
        level = np.eye(3)[np.argmin(np.abs(up))]
        level = level - (level @ up) * up
    towards = level / np.linalg.norm(level)
    return up, towards, np.cross(up, towards)


def _at(sine: float, up: Array, level: Array) -> Array:
    """Unit vectors at an elevation."""
    return np.asarray(sine * up + math.sqrt(max(1.0 - sine * sine, 0.0)) * level)
