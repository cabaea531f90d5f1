"""Light on one grid, taken over to another."""

from __future__ import annotations

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


class Light(NamedTuple):
    """Light on a grid, or its pattern."""

    moments: Array  #: (node, sun, moment, wavelength)
    flux: Array  #: (node, 2, sun, wavelength), upward and downward

    def __add__(self, other: tuple[object, ...]) -> Light:
        """Both together."""
        return Light(self.moments + other[0], self.flux + other[1])

    def __sub__(self, other: Light) -> Light:
        """The difference."""
        return Light(self.moments - other.moments, self.flux - other.flux)


def pattern(light: Light) -> Light:
    """What is smooth over heights, Suns and wavelengths, even in twilight.

    That is the logarithms of the mean radiance (moment 0) and of fluxes, and the ratios of other moments to the mean.
    """
    mean = np.maximum(light.moments[:, :, :1], FLOOR)
    shape = np.clip(light.moments / mean, -MOST_RATIO, MOST_RATIO)
    shape[:, :, :1] = np.log(mean)
    return Light(shape, np.log(np.maximum(light.flux, FLOOR)))


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
    """The way from one grid to another, by cubics over heights and Suns."""

    heights: tuple[Numbers, Array]
    suns: tuple[Numbers, Array]
    moments: Numbers  #: (moment,) numbers of the other grid's moments on the one; -1 where it has none

    @classmethod
    def between(cls, one: Problem, other: Problem) -> Transfer:
        """From the grid of one problem to that of another."""
        there = {key: k for k, key in enumerate(_keys(one))}
        return cls(
            cubic_weights(one.grid.altitudes, other.grid.altitudes),
            cubic_weights(one.grid.sun_zenith, other.grid.sun_zenith),
            np.array([there.get(key, -1) for key in _keys(other)]),
        )

    def moved(self, pattern: Light) -> Light:
        """A pattern on the other grid; moments that this one does not have are 0."""
        known = self._moved(pattern.moments)[:, :, np.maximum(self.moments, 0)]
        known[:, :, self.moments < 0] = 0.0
        return Light(known, self._moved(pattern.flux.swapaxes(1, 2)).swapaxes(1, 2))

    def _moved(self, values: Array) -> Array:
        """(node, sun, ...) on the other grid."""
        return blended(blended(values, *self.heights).swapaxes(0, 1), *self.suns).swapaxes(0, 1)


def _keys(problem: Problem) -> list[tuple[int, int, int]]:
    """Kind, degree and order of the moments."""
    table = problem.moments
    return [(int(a), int(b), int(c)) for a, b, c in zip(table.kind, table.degree, table.order, strict=True)]
