"""Which way to a transmittance costs least at equal error: columns, ratio tracking or residual ratio tracking.

Columns have no noise; tracking has, and its cost is the number of its tentative collisions.  What counts is the walk:
its time is that of its legs and of the transmittances on them, its variance its own and, multiplied, theirs.  Both are
judged on the same segments, from where light is scattered to where it comes from, by counting evaluations of the
density, so that the choice is the same on every machine.

Measured on the shipped nebulae (16 x 16 pixels, 16 walks, 5 seeds, 3 wavelengths; seconds of processor, and root mean
square of the noise over the mean radiance of all but the six brightest pixels; `benchmarks/transmittances.py`):

| model             | quadrature    | ratio         | residual ratio |
|-------------------|---------------|---------------|----------------|
| dusty-disk        | 0.72 s, 3.9   | 3.32 s, 4     | 3.83 s, 4.1    |
| hii-region        | 0.91 s, 0.53  | 2.17 s, 0.58  | 2.16 s, 0.54   |
| reflection-nebula | 0.46 s, 0.47  | 0.53 s, 0.5   | 0.52 s, 0.51   |
| ring-nebula       | 0.40 s, 0.092 | 0.41 s, 0.096 | 0.41 s, 0.095  |
| star-in-dust      | 1.72 s, 0.93  | 1.70 s, 1.5   | 1.67 s, 1.3    |
| turbulent-pillar  | 0.38 s, 0.72  | 0.55 s, 0.5   | 0.60 s, 0.56   |

The square of the median noise times the time is least by quadrature in each of them.  In dark-globule no light comes
from a star.
"""

from __future__ import annotations

import numpy as np

from skyscatter.kernels.codes.space import CELLS, CLOSED_FORM, PIECES, TRANSPARENT, TURBULENCE
from skyscatter.kernels.gridwalk import make_walker
from skyscatter.kernels.path import make_walk
from skyscatter.kernels.tracking import QUADRATURE, RATIO, RESIDUAL, fill_tracked
from skyscatter.kernels.volume import VolumeTable, make_volume_work
from skyscatter.kernels.volume_walks import LEG_STRATA, LIT_POINTS
from skyscatter.solvers.base import Array
from skyscatter.solvers.guide import guided_columns

#: Segments on which the ways are compared, times that each is tracked, and points from which they are chosen.
SEGMENTS, REPEATS, CANDIDATES = 48, 32, 4096
#: Cost of one crossed cell of a grid, in evaluations of its density (some 30 ns).
CELL_COST = 0.5
#: Cost of a tentative collision beside and in terms of its densities: they are far from each other in memory.
LOOK = 2.0
#: Evaluations that a column in closed form is worth.
CLOSED = 2.0
#: Evaluations of a component's column that still count as few.
CHEAP = 8.0
#: Evaluations of a panel of the quadrature.
PANEL = 15
#: Modes of turbulence that take the time of one evaluation of another shape.
MODES = 16
#: What a leg costs beside columns, in evaluations: guesses of the light, candidates for its direction.
LEG = 400.0


def has_cheap_columns(table: VolumeTable) -> bool:
    """Whether quadrature of the first order, hundreds of columns a ray, is worth its time."""
    return _column_cost(table) <= CHEAP * len(table.sigma_t)


def cheapest(table: VolumeTable) -> int:
    """Code of the way that costs least at equal error, for the walks of this scene."""
    column = _column_cost(table)
    # Nothing is cheaper than a closed form.
    if column <= CLOSED * len(table.space.method) or not len(table.power):
        return QUADRATURE
    points, lights = _lit_points(table)
    if not len(points):
        return QUADRATURE
    leg, fetched = LEG + _column_cost(table, LEG_STRATA), LIT_POINTS * len(table.power)
    costs = {QUADRATURE: leg + fetched * column}
    for way in (RATIO, RESIDUAL):
        looks, noise = _tracking(table, points, lights, way == RESIDUAL)
        # Walks differ by about their mean light; noise of the transmittance adds to that.
        costs[way] = (leg + fetched * looks) * (1.0 + noise)
    return min(costs, key=lambda way: costs[way])


def _lit_points(table: VolumeTable) -> tuple[Array, Array]:
    """Points (n, 3) of the medium drawn by the direct light that they scatter, and the numbers of the lights."""
    from skyscatter.kernels.space import fill_densities, make_space_work

    rng = np.random.default_rng(20)
    low, size = table.space.bound_low, table.space.bound_step * table.space.cells
    points = low + rng.random((CANDIDATES, 3)) * size
    near = np.flatnonzero(~table.distant)
    volume = np.full(CANDIDATES, float(size.prod()))
    if near.size:
        # Half of them around the stars, as many at every power of ten of the distance.
        half, span = CANDIDATES // 2, float(np.linalg.norm(size))
        radius = span * 10 ** rng.uniform(-4, 0, half)
        away = rng.normal(size=(half, 3))
        away *= (radius / np.linalg.norm(away, axis=1))[:, None]
        points[:half] = table.place[near[rng.integers(near.size, size=half)]] + away
        volume[:half] = 4 * np.pi * radius**3 * np.log(1e4)
    density = np.zeros((CANDIDATES, len(table.sigma_t)))
    fill_densities(table.space, points, make_space_work(), density)
    middle = table.sigma_t.shape[1] // 2
    weight = np.array([_direct_light(table, k, points, middle) for k in range(len(table.power))])
    weight *= volume * (density @ table.sigma_s[:, middle])
    total = np.cumsum(weight.ravel())
    if not total[-1] > 0:
        return np.zeros((0, 3)), np.zeros(0, int)
    chosen = np.searchsorted(total, total[-1] * (np.arange(SEGMENTS) + 0.5) / SEGMENTS)
    return points[chosen % CANDIDATES], chosen // CANDIDATES


def _direct_light(table: VolumeTable, k: int, points: Array, i: int) -> Array:
    """Irradiance of light k at points (n, 3) and wavelength number i, by the guide."""
    columns = guided_columns(table, points)[k]
    distance = np.maximum(np.linalg.norm(points - table.place[k], axis=1), table.size[k])
    fall = 1.0 if table.distant[k] else distance**-2
    return np.asarray(table.power[k, i] * fall * np.exp(-columns @ table.sigma_t[:, i]))


def _column_cost(table: VolumeTable, pieces: int = 1) -> float:
    """Evaluations of the density that a column through half of the medium takes, found in so many pieces."""
    space = table.space
    half = 0.5 * float(np.linalg.norm(space.bound_step * space.cells))
    cost = 0.0
    for term, (method, scale, box) in enumerate(zip(space.method, space.scale, space.box, strict=True)):
        along = min(half, 0.5 * float(np.linalg.norm(box[1] - box[0])))
        if method == TRANSPARENT:
            continue
        if method in (CLOSED_FORM, PIECES):
            cost += CLOSED * pieces
        elif method == CELLS:
            cost += CELL_COST * along / max(scale, 1e-300)
        else:
            cost += PANEL * max(along / max(scale, 1e-300), pieces) * _unit(table, term)
    return cost


def _unit(table: VolumeTable, term: int) -> float:
    """Cost of the density of one term."""
    space = table.space
    rows = space.code[space.code_start[term] : space.code_start[term + 1]]
    modes = sum(float(space.index[row[2] + 1]) for row in rows if row[0] == TURBULENCE)
    return 1.0 + modes / MODES


def _tracking(table: VolumeTable, points: Array, lights: Array, residual: bool) -> tuple[float, float]:
    """Evaluations that a tracked transmittance takes, and its relative variance, averaged over segments."""
    components, wavelengths = table.sigma_s.shape
    work, walker, walk = make_volume_work(components, wavelengths), make_walker(), make_walk(wavelengths)
    middle, noise = wavelengths // 2, 0.0
    for light in np.unique(lights):
        there = np.ascontiguousarray(points[lights == light])
        drawn = np.empty((REPEATS, len(there), wavelengths))
        for n in range(REPEATS):
            fill_tracked(table, light, there, residual, np.uint64(n + 1), work, walker, walk, drawn[n])
        mean, spread = drawn[:, :, middle].mean(axis=0), drawn[:, :, middle].std(axis=0)
        # All segments stand for as much light; where none is found, tracking is as good as blind.
        noise += float(np.where(mean > 0, (spread / np.maximum(mean, 1e-300)) ** 2, REPEATS).sum())
    looks, cells = work.looks / (REPEATS * len(points))
    each = sum(_unit(table, term) for term in range(len(table.space.method)))
    return float(LOOK * (1.0 + each) * looks + CELL_COST * cells), noise / len(points)
