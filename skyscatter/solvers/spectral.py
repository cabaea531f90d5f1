"""Fewer wavelengths for the costly solution: between them it is carried by the coarse one, which knows all.

What a finer grid changes of a coarse solution is little.  So the fine solution is made at some wavelengths; at each of
the others the change is a sum of the changes at these, that of the mean radiance as a logarithm, that of every other
moment in units of the mean.  The weights are those with which the coarse solution itself follows best from what it is
at these wavelengths: where the air is alike, light is.  Gases have bands, in which what is next in wavelength is not
alike.  Choosing one after the other what follows worst is the way of empirical interpolation (Barrault et al. 2004,
C. R. Acad. Sci. Paris, Ser. I 339, 667).
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.grid import cubic_weights
from skyscatter.solvers.sweeps import FLOOR, Problem, Solution, Sums
from skyscatter.solvers.transfer import Light, Transfer, light_of, pattern
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.scene import Scene

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Wavelengths below which all are solved for; kernels do so many at a time.
FEW = 8
#: Wavelengths that are chosen to begin with, evenly.
FIRST = 4
#: What may be missed of the coarse solution's pattern, in units of the tolerance; what is carried between wavelengths
#: is a few hundredths of that pattern, and more only where light has fallen by many times.
MISSED = 6.0
#: Weights that make up for less than this of the pattern, in units of the tolerance, are not worth their size.
NOISE = 0.3
#: Weight of the rule that a change that is the same at all wavelengths is carried as it is.
SAME = 1e3
#: Share of the wavelengths beyond which all are solved for.
MOST = 0.7
#: Values of the coarse solution that are looked at, for each wavelength.
LOOKED_AT = 2000


class Chosen(NamedTuple):
    """The wavelengths at which is solved, and how those between follow."""

    numbers: Numbers  #: (chosen,)
    weights: Array  #: (chosen, wavelength); at those that are chosen, one of themselves


def needed(coarse: Solution, wavelengths: Array, tolerance: float) -> Chosen:
    """The wavelengths from which those between follow; all of them where they do not.

    One after the other the wavelength is taken that follows worst from those that have been taken.
    """
    count = wavelengths.size
    every = Chosen(np.arange(count), np.eye(count))
    if count <= FEW or not coarse.sums.moments.any():
        return every
    pattern = _pattern(coarse)
    size = 1 + np.abs(pattern)
    numbers = np.unique(np.linspace(0, count - 1, FIRST).astype(int))
    while numbers.size < MOST * count:
        weights = _weights(pattern, numbers, wavelengths, NOISE * tolerance)
        missed = (np.abs(pattern[:, numbers] @ weights - pattern) / size).max(axis=0)
        # Kernels take eight at a time: some cost as much as eight.
        if missed.max() < MISSED * tolerance and numbers.size % FEW == 0:
            return Chosen(numbers, weights)
        missed[numbers] = 0.0
        numbers = np.union1d(numbers, np.argmax(missed))
    return every


def _weights(pattern: Array, numbers: Numbers, wavelengths: Array, noise: float) -> Array:
    """Weights (chosen, wavelength) with which a pattern (value, wavelength) follows from some of its wavelengths.

    They begin as those of cubics over the wavelength; what these miss is made up for by least squares.
    """
    few = numbers.size
    start = np.zeros((few, wavelengths.size))
    for number, weight in zip(*(part.T for part in cubic_weights(wavelengths[numbers], wavelengths)), strict=True):
        start[number, np.arange(wavelengths.size)] += weight
    known = pattern[:, numbers]
    square = known.T @ known / len(pattern) + SAME**2 + noise**2 * np.eye(few)
    return np.asarray(start + np.linalg.solve(square, known.T @ (pattern - known @ start) / len(pattern)))


def _pattern(coarse: Solution) -> Array:
    """What the solution looks like at each wavelength, whatever the star's spectrum, (value, wavelength)."""
    moments = coarse.sums.moments
    level = np.log(np.maximum(moments[:, :, 0], FLOOR)).reshape(-1, moments.shape[3])
    seen = level > level.max(axis=0) - 20.0
    level = level - np.where(seen, level, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    rest = (moments[:, :, 1:] / np.maximum(moments[:, :, :1], FLOOR)).reshape(len(level), -1, moments.shape[3])
    lit = seen.all(axis=1)  # elsewhere moments are rounding
    both = np.concatenate([level[lit], np.clip(rest[lit], -1.0, 1.0).reshape(-1, moments.shape[3])])
    return np.asarray(both[:: max(len(both) // LOOKED_AT, 1)])


def at_some(problem: Problem, scene: Scene, wavelengths: Array, chosen: Numbers) -> Problem:
    """A problem for some of its wavelengths, on the same grid and with the same moments."""
    diffuse = problem.diffuse
    spectral = ("sigma_t", "greek", "peaks", "emission", "light", "share")
    some: dict[str, Any] = {name: np.ascontiguousarray(getattr(diffuse, name)[..., chosen]) for name in spectral}
    return dataclasses.replace(
        problem, table=compile_scene(scene, wavelengths[chosen]), diffuse=diffuse._replace(**some),
        cut=np.ascontiguousarray(problem.cut[..., chosen]), whole=np.ascontiguousarray(problem.whole[..., chosen]),
        level_peaks=problem.level_peaks[chosen], view_peaks=problem.view_peaks[chosen],
    )  # fmt: skip


def some_of(solution: Solution, scene: Scene, wavelengths: Array, chosen: Numbers) -> Solution:
    """A solution at some of its wavelengths."""
    whole = solution.sums
    moments, flux = (np.ascontiguousarray(values[..., chosen]) for values in (whole.moments, whole.flux))
    sums = Sums(moments, flux, whole.orders)
    return Solution(at_some(solution.problem, scene, wavelengths, chosen), sums)


def at_all(some: Sums, problem: Problem, coarse: Solution, chosen: Chosen, threads: int = 1) -> Sums:
    """Sums on the grid of a problem at all wavelengths, from those at some and a coarse solution."""
    way = Transfer.between(coarse.problem, problem)
    guides = way.known(Light(coarse.sums.moments, coarse.sums.flux))
    numbers, weights = chosen
    many = weights.shape[1]
    out = Light(np.empty((*some.moments.shape[:3], many)), np.empty((*some.flux.shape[:3], many)))

    def at(suns: slice) -> None:
        guide = way.moved(guides, suns)
        known = pattern(Light(some.moments[:, suns], some.flux[:, :, suns]))
        known.moments[:, :, way.there] -= guide.moments[..., numbers]
        flux = (known.flux - guide.flux[..., numbers]) @ weights + guide.flux
        moments = known.moments @ weights
        moments[:, :, way.there] += guide.moments
        out.moments[:, suns], out.flux[:, :, suns] = light_of(Light(moments, flux))

    with Workers(max_workers=threads) as pool:
        way.by_sun(pool, at)
    return Sums(*out, some.orders)
