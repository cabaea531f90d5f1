"""When a Monte Carlo number counts as wrong: thresholds that follow from how its error bar was made.

The error of the marching ``path`` is the spread of 16 batches, so a deviation over its standard error follows
Student's t with 15 degrees of freedom.  All seeds are fixed: a test that passes goes on passing until numbers change.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from skyscatter.solvers.base import Answer

Array = NDArray[np.float64]

#: Batches of the marching path less one.
BATCH_FREEDOM = 15
#: Chance that a right solver fails a whole comparison.
FALSE_ALARM = 1e-3


def largest_t(count: int, freedom: float = BATCH_FREEDOM) -> float:
    """Bound that the largest of `count` values of |t| exceeds with chance `FALSE_ALARM` (Bonferroni)."""
    return float(stats.t.isf(0.5 * FALSE_ALARM / count, freedom))


def assert_agrees(
    value: ArrayLike, expected: ArrayLike, error: ArrayLike, freedom: float = BATCH_FREEDOM, slack: float = 0.0
) -> None:
    """Fail if any value lies further from what is expected than chance allows.

    `slack` is the known relative error of the numbers that are no Monte Carlo (quadrature, tables); each caller says
    where it comes from.
    """
    value, expected, error = np.broadcast_arrays(np.asarray(value), np.asarray(expected), np.asarray(error))
    allowed = largest_t(value.size, freedom) * error + slack * np.abs(expected)
    worst = int(np.argmax(np.abs(value - expected) - allowed))
    deviation = np.abs(value - expected)
    assert np.all(deviation <= allowed), (
        f"{np.sum(deviation > allowed)} of {value.size} differ; the worst is {value.flat[worst]:.6g} +- "
        f"{error.flat[worst]:.2g} where {expected.flat[worst]:.6g} is expected"
    )


def over_seeds(solve: Callable[[int], Answer], seeds: int) -> tuple[Answer, dict[str, tuple[Array, Array]]]:
    """Run `solve(seed)` for many seeds; the first answer, and mean and standard error of the radiance and every layer.

    The errors come from the spread alone: Student's t with ``seeds - 1`` degrees of freedom, whatever the solver says.
    """
    answers = [solve(1000 + seed) for seed in range(seeds)]
    result = {}
    for name in ("radiance", *answers[0].layers):
        runs = np.array([a.radiance if name == "radiance" else a.layers[name] for a in answers])
        result[name] = (runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(seeds))
    return answers[0], result


def runs_of_power(solve: Callable[[int], ArrayLike], power: ArrayLike, least: int = 16, most: int = 4096) -> Array:
    """Results of `solve(seed)`, (run, ...), as many as make the standard error of each mean `power` of it.

    For what shares its random numbers, such as rays their photons: only whole runs are independent of each other.
    """
    runs: list[Array] = []
    count = least
    while len(runs) < count:
        runs += [np.asarray(solve(1000 + k), float) for k in range(len(runs), count)]
        spread = np.std(runs, axis=0, ddof=1) / np.abs(np.mean(runs, axis=0))
        count = int(np.ceil(np.max(spread / np.asarray(power)) ** 2)) + 1
        assert count <= most, f"{count} runs would be needed"
    return np.array(runs)


def assert_mean_of_runs(runs: Array, expected: ArrayLike, power: ArrayLike, error: ArrayLike = 0.0) -> None:
    """Fail if means of runs (run, ...) are not as `expected` with its `error`, or not known to the relative `power`."""
    mean, own = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    # An eighth: `power` is of the runs' own mean, which may be off by what the test is to find.
    assert np.all(own < 1.125 * np.asarray(power) * np.abs(expected)), own / expected
    assert_agrees(mean, expected, np.hypot(own, error), freedom=len(runs) - 1)
