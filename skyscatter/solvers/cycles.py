"""Light of all orders from few sweeps: each is followed by what it still misses, as a cheaper solution tells.

The sum over the orders (`series.py`) takes a sweep for each.  Here a light that is nearly right is swept once, which
rights all but what is smooth; what is smooth is put right by a coarser grid (`twogrid.py`) or, in a thick medium, by
a few harmonics in every column (`synthetic.py`); and several such cycles together tell where all of them lead
(`mixing.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.solvers.effort import check_sum, expected_orders
from skyscatter.solvers.mixing import Parts, Past
from skyscatter.solvers.series import FINE_SHARE, ORDERS_SHARE, finished, is_sum, sum_orders
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import Solution, Sums, Sweeper, per_light
from skyscatter.solvers.synthetic import Harmonics
from skyscatter.solvers.transfer import Light, added
from skyscatter.solvers.twogrid import TwoGrids
from skyscatter.workers import Workers

Array = NDArray[np.float64]

#: What a cycle leaves of what it changed, at least, where the light is rough and the coarse grid cannot see it: a sweep
#: takes away a fifth to a half.
LEAST_LEFT = 0.4
#: Shares of the places [%] that are looked at, and what may be missing there in units of what may be missing: the worst
#: places are at the ends of the range of Suns, where few rays look.
PLACES, ALLOWED = np.array([95.0, 100.0]), np.array([1.0, 3.0])
#: Cycles after which orders are summed instead, and how much each may have of the change before.  Harmonics begin with
#: the first order, and their cycles do not fall evenly.  The first change may be of any size: in the depth of night the
#: coarse solution is wrong by factors somewhere, and yet cycles settle.  A sum of orders misses more there: each is
#: dark beyond its own shadow's edge, which no cubic over the Suns follows, while the light of all of them is smooth.
MOST_CYCLES, SLOWEST, UNEVEN = 40, 0.9, 30.0
#: Orders that are expected from which a medium counts as thick: what the coarse grid cannot see falls by a twentieth
#: there with each sweep, and what is missing is told by each column alone.
THICK = 4.0


def all_orders(
    sweeper: Sweeper,
    tolerance: float,
    guide: Solution | None = None,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
    name: str = "",
) -> Sums:
    """Light of all orders on the grid of a sweeper, the shortest way.

    Parameters
    ----------
    guide : Solution, optional
        A coarser one at the same wavelengths, which helps.

    The others are those of `skyscatter.solvers.series.sum_orders`: here too three tenths of the tolerance may be
    missing.

    Raises
    ------
    ConvergenceError
        If neither this nor the orders settle.
    """
    kept = {} if checkpoint is None else checkpoint.part(name)
    if (whole := finished(kept)) is not None:
        return whole
    found = None
    is_thick = float(expected_orders(sweeper.problem, tolerance).max()) > THICK
    # A thin medium's coarse solution is a sum, whose light is interpolated order by order: it is closer to the fine one
    # than that of cycles, above all in how it changes with wavelength.
    if (is_thick or guide is not None) and not is_sum(kept):
        with Workers(max_workers=sweeper.threads) as pool:
            way = _way(sweeper, guide, tolerance, pool, is_thick)
            found = _cycles(sweeper, way, ORDERS_SHARE * tolerance, pool, progress, checkpoint, name)
    if found is None:
        if checkpoint is not None and not is_sum(kept):
            checkpoint.put(name, {})  # cycles that did not settle are no sum
        check_sum(sweeper.problem, tolerance)
        return sum_orders(Sweeper(sweeper.problem, sweeper.threads), tolerance, None, progress, checkpoint, name)
    light, cycles = found
    if checkpoint is not None:
        checkpoint.put(name, light._asdict() | {"orders": np.array(float(cycles))})
    return Sums(*light, cycles)


class _Way(NamedTuple):
    """How a light is begun, how what a sweep misses is found, and when that has settled."""

    begun: Callable[[Light], Light]  #: from the first order
    corrected: Callable[[Light, Light], Light]  #: from a light and what a sweep made of it
    parts: Parts  #: which moments tell
    slowest: float  #: what a cycle may change at most in units of the one before, before orders are summed instead


def _way(sweeper: Sweeper, guide: Solution | None, tolerance: float, pool: ThreadPoolExecutor, is_thick: bool) -> _Way:
    """By harmonics in a thick medium, by a coarser solution in any other."""
    grids = None if guide is None else TwoGrids(sweeper, guide, tolerance, pool)
    if is_thick:
        # What harmonics do not know, moments of high degree, has to settle by itself.
        harmonics = Harmonics(sweeper.problem)
        begun = harmonics.begun if grids is None else grids.begun
        return _Way(begun, harmonics.corrected, Parts.of(sweeper.problem), UNEVEN)
    assert grids is not None
    parts = Parts.of_the_mean(sweeper.problem.moments.degree.size)
    return _Way(grids.begun, grids.corrected, parts, SLOWEST)


def _cycles(
    sweeper: Sweeper,
    way: _Way,
    goal: float,
    pool: ThreadPoolExecutor,
    progress: Callable[[float], None] | None,
    checkpoint: Checkpoint | None,
    name: str,
) -> tuple[Light, int] | None:
    """Light that has settled and the cycles that it took, or None where it does not."""
    kept = {} if checkpoint is None else checkpoint.part(name)
    if "first_moments" in kept:
        first, light = Light(kept["first_moments"], kept["first_flux"]), Light(kept["moments"], kept["flux"])
        left, changed, cycle = kept["state"].tolist()
        past = Past.of(way.parts, kept)
    else:
        first = Light(*sweeper.first(pool))
        light = way.begun(first)
        left, changed, cycle = np.inf, np.inf, 0
        past = Past(way.parts, np.float32)
    while left > goal:
        if cycle == MOST_CYCLES:
            return None
        if checkpoint is not None:
            state = {"first_moments": first.moments, "first_flux": first.flux, **light._asdict(), **past.kept()}
            checkpoint.put(name, state | {"state": np.array([left, changed, cycle])})
        if progress is not None:
            progress(FINE_SHARE * (0.3 + 0.3 * cycle / (1 + 0.3 * cycle)))
        swept = _swept(sweeper, pool, first, light)
        try:
            found = way.corrected(light, swept)
        except ConvergenceError:
            return None
        changes = np.percentile(_changes(way.parts.weight, light, found), PLACES)
        before, changed = changed, float(np.max(changes / ALLOWED))
        if not changed < way.slowest * before:
            return None
        if cycle > 0:  # one alone does not tell how much is left
            left = max(changed / before, LEAST_LEFT) * changed
        light, cycle = past.mixed(light, found) if left > goal else found, cycle + 1
    return light, int(cycle)


def _swept(sweeper: Sweeper, pool: ThreadPoolExecutor, first: Light, light: Light) -> Light:
    """What sunlight and a sweep make of a light; moments too small to be swept stay, whatever the first order has."""
    sweeper.narrow(light.moments, light.moments, 0.0)
    swept = added(first, sweeper.next(pool, *light))
    small = np.ones(light.moments.shape[2], bool)
    small[sweeper.stage.kept] = False
    swept.moments[:, :, small] = light.moments[:, :, small]
    return swept


def _changes(weight: Array, before: Light, now: Light) -> Array:
    """Greatest change over moments and wavelengths, (node, sun), each by its weight and per light."""
    mean = now.moments[:, :, 0]
    per_mean = per_light(mean)
    out = np.zeros(mean.shape[:2])
    for k in np.flatnonzero(weight):
        change = weight[k] * np.abs(now.moments[:, :, k] - before.moments[:, :, k]) * per_mean
        out = np.maximum(out, change.max(axis=2))
    return out
