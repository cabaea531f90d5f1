"""Light on one grid, taken over to another."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.grid import cubic_weights
from skyscatter.solvers.sweeps import FLOOR, Problem

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Greatest ratio of a moment to the mean radiance that is believed.
MOST_RATIO = 2.0
#: A flux counts as this share of the mean radiance times 4 pi at least.
LEAST_FLUX = 1e-6
EVERY = slice(None)


class Light(NamedTuple):
    """Light on a grid, or its pattern."""

    moments: Array  #: (node, sun, moment, wavelength)
    flux: Array  #: (node, 2, sun, wavelength), upward and downward


def added(light: Light, other: tuple[Array, Array]) -> Light:
    """Both together."""
    return Light(light.moments + other[0], light.flux + other[1])


def less(light: Light, other: tuple[Array, Array]) -> Light:
    """What is left of a light without another."""
    return Light(light.moments - other[0], light.flux - other[1])


def pattern(light: Light) -> Light:
    """What is smooth over heights, Suns and wavelengths, even in twilight.

    That is the logarithms of the mean radiance (moment 0) and of fluxes, and the ratios of other moments to the mean.
    """
    mean = np.maximum(light.moments[:, :, :1], FLOOR)
    shape = np.clip(light.moments / mean, -MOST_RATIO, MOST_RATIO)
    shape[:, :, :1] = np.log(mean)
    # From above comes next to nothing at the top, whose logarithm would say nothing.
    least = np.moveaxis(LEAST_FLUX * mean, 2, 1)
    return Light(shape, np.log(np.maximum(light.flux, least)))


def light_of(pattern: Light) -> Light:
    """The light that has this pattern."""
    mean = np.exp(pattern.moments[:, :, :1])
    moments = pattern.moments * mean
    moments[:, :, :1] = mean
    return Light(moments, np.exp(pattern.flux))


def blended(values: Array, number: Numbers, weight: Array) -> Array:
    """Values (node, ...) at points, of which number and weight (point, 4) are those of `cubic_weights`."""
    out = np.zeros((len(number), *values.shape[1:]))
    for k in range(number.shape[1]):
        out += values[number[:, k]] * weight[:, k].reshape(-1, *[1] * (values.ndim - 1))
    return out


@dataclass(frozen=True)
class Transfer:
    """The way from one grid to another, by cubics over heights and Suns, of the moments that both have."""

    heights: tuple[Numbers, Array]
    suns: tuple[Numbers, Array]
    here: Numbers  #: numbers of those moments on the one grid; the mean radiance is the first
    there: Numbers  #: and on the other

    @classmethod
    def between(cls, one: Problem, other: Problem) -> Transfer:
        """From the grid of one problem to that of another."""
        known = {key: k for k, key in enumerate(_keys(one))}
        both = [(known[key], k) for k, key in enumerate(_keys(other)) if key in known]
        here, there = np.array(both).T
        return cls(
            cubic_weights(one.grid.altitudes, other.grid.altitudes),
            cubic_weights(one.grid.sun_zenith, other.grid.sun_zenith), here, there,
        )  # fmt: skip

    def known(self, light: Light) -> Light:
        """The pattern of a light on the one grid, of the moments that both have."""
        return pattern(Light(light.moments[:, :, self.here], light.flux))

    def moved(self, pattern: Light, suns: slice = EVERY) -> Light:
        """Such a pattern on the other grid, at some of its Suns."""
        flux = self.carried(pattern.flux.swapaxes(1, 2), suns)
        return Light(self.carried(pattern.moments, suns), flux.swapaxes(1, 2))

    def carried(self, values: Array, suns: slice = EVERY) -> Array:
        """Values (node, sun, ...) on the other grid, at some of its Suns."""
        number, weight = self.suns
        return blended(blended(values.swapaxes(0, 1), number[suns], weight[suns]).swapaxes(0, 1), *self.heights)

    def by_sun(self, pool: Executor, work: Callable[[slice], object]) -> None:
        """Do something for each Sun of the other grid: its numbers stay in the cache, and threads share in it."""
        suns = len(self.suns[0])
        for _ in pool.map(work, [slice(k, k + 1) for k in range(suns)]):
            pass


def _keys(problem: Problem) -> list[tuple[int, int, int]]:
    """Kind, degree and order of the moments."""
    table = problem.moments
    return [(int(a), int(b), int(c)) for a, b, c in zip(table.kind, table.degree, table.order, strict=True)]
