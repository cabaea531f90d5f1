"""Fewer wavelengths for the costly solution: between them it is carried by the coarse one, which knows all.

What a finer grid changes of a coarse solution is little, and changes slowly with the wavelength.  So the fine solution
is made at some wavelengths; at each of the others its mean radiance is the coarse one's times their ratio, and every
other moment, in units of the mean, the coarse one's plus their difference, ratio and difference being cubics in the
wavelength.  The wavelengths are those from which the coarse solution itself, without any such help, follows well.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

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
MISSED = 10.0
#: Share of the wavelengths beyond which all are solved for.
MOST = 0.7
#: Values of the coarse solution that are looked at, for each wavelength.
LOOKED_AT = 2000


def needed(coarse: Solution, wavelengths: Array, tolerance: float) -> Numbers:
    """Numbers of the wavelengths from which those between follow; all of them where they do not.

    One after the other the wavelength is taken that follows worst from those that have been taken.
    """
    count = wavelengths.size
    if count <= FEW or not coarse.sums.moments.any():
        return np.arange(count)
    pattern = _pattern(coarse)
    chosen = np.unique(np.linspace(0, count - 1, FIRST).astype(int))
    while chosen.size < MOST * count:
        apart = np.abs(_between(pattern[:, chosen], wavelengths[chosen], wavelengths) - pattern)
        missed = (apart / (1 + np.abs(pattern))).max(axis=0)
        # Kernels take eight at a time: some cost as much as eight.
        if missed.max() < MISSED * tolerance and chosen.size % FEW == 0:
            return chosen
        chosen = np.union1d(chosen, np.argmax(missed))
    return np.arange(count)


def _pattern(coarse: Solution) -> Array:
    """What the solution looks like at each wavelength, whatever the star's spectrum, (value, wavelength)."""
    moments = coarse.sums.moments
    level = np.log(np.maximum(moments[:, :, 0], FLOOR)).reshape(-1, moments.shape[3])
    seen = level > level.max(axis=0) - 20.0
    level = level - np.where(seen, level, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    rest = (moments[:, :, 1:] / np.maximum(moments[:, :, :1], FLOOR)).reshape(-1, moments.shape[3])
    both = np.concatenate([level[seen.all(axis=1)], np.clip(rest, -1.0, 1.0)])
    return np.asarray(both[:: max(len(both) // LOOKED_AT, 1)])


def _between(values: Array, known: Array, wavelengths: Array) -> Array:
    """Values (..., known) at other wavelengths, (..., wavelength)."""
    return _over(values, *cubic_weights(known, wavelengths))


def at_some(problem: Problem, scene: Scene, wavelengths: Array, chosen: Numbers) -> Problem:
    """A problem for some of its wavelengths, on the same grid and with the same moments."""
    diffuse = problem.diffuse
    spectral = ("sigma_t", "greek", "peaks", "emission", "light", "share")
    some: dict[str, Any] = {name: np.ascontiguousarray(getattr(diffuse, name)[..., chosen]) for name in spectral}
    return dataclasses.replace(
        problem, table=compile_scene(scene, wavelengths[chosen]), diffuse=diffuse._replace(**some),
        cut=np.ascontiguousarray(problem.cut[..., chosen]), whole=np.ascontiguousarray(problem.whole[..., chosen]),
        level_peaks=problem.level_peaks[chosen],
    )  # fmt: skip


def some_of(solution: Solution, scene: Scene, wavelengths: Array, chosen: Numbers) -> Solution:
    """A solution at some of its wavelengths."""
    whole = solution.sums
    moments, flux = (np.ascontiguousarray(values[..., chosen]) for values in (whole.moments, whole.flux))
    sums = Sums(moments, flux, whole.orders)
    return Solution(at_some(solution.problem, scene, wavelengths, chosen), sums)


def at_all(
    some: Sums, problem: Problem, coarse: Solution, wavelengths: Array, chosen: Numbers, threads: int = 1
) -> Sums:
    """Sums on the grid of a problem at all wavelengths, from those at some and a coarse solution."""
    way = Transfer.between(coarse.problem, problem)
    guides = way.known(Light(coarse.sums.moments, coarse.sums.flux))
    many = wavelengths.size
    out = Light(np.empty((*some.moments.shape[:3], many)), np.empty((*some.flux.shape[:3], many)))
    between = cubic_weights(wavelengths[chosen], wavelengths)

    def at(suns: slice) -> None:
        guide = way.moved(guides, suns)
        known = pattern(Light(some.moments[:, suns], some.flux[:, :, suns]))
        known.moments[:, :, way.there] -= guide.moments[..., chosen]
        flux = _over(known.flux - guide.flux[..., chosen], *between) + guide.flux
        moments = _over(known.moments, *between)
        moments[:, :, way.there] += guide.moments
        out.moments[:, suns], out.flux[:, :, suns] = light_of(Light(moments, flux))

    with Workers(max_workers=threads) as pool:
        way.by_sun(pool, at)
    return Sums(*out, some.orders)


def _over(values: Array, number: Numbers, weight: Array) -> Array:
    """Values (..., known) at other wavelengths, of which number and weight (wavelength, 4) are as in `blended`."""
    out = values[..., number[:, 0]] * weight[:, 0]
    for k in range(1, number.shape[1]):
        out += values[..., number[:, k]] * weight[:, k]
    return out
