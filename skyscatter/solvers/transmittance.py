"""Which way to a transmittance costs least at equal error: columns, ratio tracking or residual ratio tracking.

Columns have no noise; tracking has, and its cost is the number of its tentative collisions.  Both are judged on the
same segments between points of the medium and its lights, by counting evaluations of the density, so that the choice
is the same on every machine.
"""

from __future__ import annotations

import numpy as np

from skyscatter.solvers.base import Array
from skyscatter.solvers.kernels.gridwalk import make_walker
from skyscatter.solvers.kernels.path import make_walk
from skyscatter.solvers.kernels.space import CELLS, CLOSED_FORM, PIECES, TRANSPARENT
from skyscatter.solvers.kernels.tracking import QUADRATURE, RATIO, RESIDUAL, fill_tracked
from skyscatter.solvers.kernels.volume import VolumeTable, make_volume_work

#: Segments on which the ways are compared, and times that each is tracked.
SEGMENTS, REPEATS = 32, 16
#: Cost of one crossed cell of a grid, in evaluations of its density: two, but next to each other in memory.
CELL_COST = 0.5
#: Evaluations that a column in closed form is worth.
CLOSED = 2.0
#: Evaluations of a component's column that still count as few.
CHEAP = 8.0
#: Evaluations of a panel of the quadrature.
PANEL = 15


def has_cheap_columns(table: VolumeTable) -> bool:
    """Whether quadrature of the first order, hundreds of columns a ray, is worth its time."""
    return _column_cost(table) <= CHEAP * len(table.sigma_t)


def cheapest(table: VolumeTable) -> int:
    """Code of the way that costs least at equal error, for the walks of this scene."""
    costs = {QUADRATURE: _column_cost(table)}
    # Nothing is cheaper than a closed form.
    closed = costs[QUADRATURE] <= CLOSED * len(table.space.method)
    points = np.zeros((0, 3)) if closed or not len(table.power) else _points(table)
    if not len(points):
        return QUADRATURE
    # A walk's own spread is about its mean light; noise of the transmittance adds to it.
    for way in (RATIO, RESIDUAL):
        count, spread = _tracking(table, points, way == RESIDUAL)
        costs[way] = count * (1.0 + spread)
    return min(costs, key=lambda way: costs[way])


def _points(table: VolumeTable) -> Array:
    """Points of the medium, drawn where there is some."""
    from skyscatter.solvers.kernels.space import fill_densities, make_space_work

    rng = np.random.default_rng(20)
    size = table.space.bound_step * table.space.cells
    points = table.space.bound_low + rng.random((64 * SEGMENTS, 3)) * size
    density = np.zeros((len(points), len(table.sigma_t)))
    fill_densities(table.space, points, make_space_work(), density)
    return points[np.any(density * table.rate > 0, axis=1)][:SEGMENTS]


def _column_cost(table: VolumeTable) -> float:
    """Evaluations of the density that a column through half of the medium takes."""
    half = 0.5 * float(np.linalg.norm(table.space.bound_step * table.space.cells))
    cost = 0.0
    for method, scale, box in zip(table.space.method, table.space.scale, table.space.box, strict=True):
        along = min(half, 0.5 * float(np.linalg.norm(box[1] - box[0])))
        if method == TRANSPARENT:
            continue
        if method in (CLOSED_FORM, PIECES):
            cost += CLOSED
        elif method == CELLS:
            cost += CELL_COST * along / max(scale, 1e-300)
        else:
            cost += PANEL * max(along / max(scale, 1e-300), 1.0)
    return cost


def _tracking(table: VolumeTable, points: Array, residual: bool) -> tuple[float, float]:
    """Tentative collisions of a tracked transmittance, and its squared relative standard deviation."""
    components, wavelengths = table.sigma_s.shape
    bound = (table.space.upper - table.space.lower if residual else table.space.upper) @ table.rate
    half = 0.5 * float(np.linalg.norm(table.space.bound_step * table.space.cells))
    occupied = bound[bound > 0]
    count = 1.0 + (float(occupied.mean()) if occupied.size else 0.0) * half
    work, walker, walk = make_volume_work(components, wavelengths), make_walker(), make_walk(wavelengths)
    middle, light = wavelengths // 2, int(np.argmax(table.power[:, wavelengths // 2]))
    drawn = np.empty((REPEATS, len(points), wavelengths))
    for n in range(REPEATS):
        fill_tracked(table, light, points, residual, np.uint64(n + 1), work, walker, walk, drawn[n])
    mean, spread = drawn[:, :, middle].mean(axis=0), drawn[:, :, middle].std(axis=0)
    # What counts is the noise of the light that arrives: bright segments weigh most.
    return count, float(np.sum(spread**2) / max(np.sum(mean**2), 1e-300))
