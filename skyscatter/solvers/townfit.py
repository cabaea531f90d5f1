"""Noise taken off what walks found of a lamp's light at nodes over the sky, which is smooth.

The logarithm s of the light at the nodes minimises

    sum ((s - y) / sigma)^2 + lambda_e sum (second differences over the elevation)^2
                            + lambda_a sum (second differences over the azimuth)^2,

with y the logarithm of what was found and sigma its relative standard error (Wahba 1990, Spline Models for
Observational Data).  The two strengths are those of the least generalised cross-validation over all wavelengths: what
neighbours do not confirm is noise.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from skyscatter.solvers.base import Array

#: Strengths that are tried, in variances of the logarithm to the minus one.
STRENGTHS = 10.0 ** np.arange(-1.0, 5.1, 1.0)
#: Rounds in which the fit becomes one of the light itself: the mean of noisy logarithms is too dark.
ROUNDS = 5
#: Relative standard error that no node is better than, so that none decides alone.
LEAST = 0.01
#: And that of nodes where no walk found light though it is found all around: nothing is known of them, neither the
#: light nor, from a spread of nothing, its error.  Neighbours tell what is there.
UNMET = 100.0
#: The strengths are found from the same noise, and that of walks is skewed: without this factor 88 % of values lie
#: within two of the errors where walks have 30 % of noise; with it 97 %, and 99 % where they have 10 %.
WIDER = 1.25
#: How firmly all azimuths are one at the zenith.
FIRM = 1e6


class Penalties(NamedTuple):
    """Squares of differences as matrices (node, node)."""

    elevation: Array  #: of second differences over the elevation
    azimuth: Array  #: and over the azimuth
    zenith: Array  #: of first ones over the azimuth where all azimuths meet

    def of(self, strengths: tuple[float, float]) -> Array:
        """All of them, the first two with their strengths."""
        return np.asarray(strengths[0] * self.elevation + strengths[1] * self.azimuth + self.zenith)


class Smooth(NamedTuple):
    """Light at the nodes without most of its noise, of the shape that was given."""

    logarithm: Array
    relative: Array  #: its standard error


def smoothed(mean: Array, error: Array) -> Smooth:
    """Light at nodes, smooth over elevation and azimuth.

    Parameters
    ----------
    mean, error : ndarray, shape (elevation, azimuth, wavelength)
        Of walks, not negative; elevations from the horizon to the zenith or nadir, azimuths from the lamp's to the one
        opposite.
    """
    elevations, azimuths, wavelengths = mean.shape
    found, noise = (part.reshape(-1, wavelengths) for part in (mean, error))
    penalties = _penalties(elevations, azimuths)
    strengths = _strengths(found, noise, penalties)
    logarithm, relative = np.empty((2, *found.shape))
    for i in range(wavelengths):
        logarithm[:, i], relative[:, i] = _solved(found[:, i], noise[:, i], penalties.of(strengths))[:2]
    return Smooth(logarithm.reshape(mean.shape), relative.reshape(mean.shape))


def _penalties(elevations: int, azimuths: int) -> Penalties:
    """The penalties for so many nodes, elevation by elevation."""
    over_elevation = np.diff(np.eye(elevations), 2, axis=0)
    # The light is even about the azimuth of the lamp and about the one opposite.
    beyond = np.concatenate([[1], np.arange(azimuths), [azimuths - 2]])
    over_azimuth = np.diff(np.eye(azimuths)[beyond], 2, axis=0)
    zenith = np.zeros((elevations, elevations))
    zenith[-1, -1] = 1.0
    step = np.diff(np.eye(azimuths), 1, axis=0)
    return Penalties(
        np.asarray(np.kron(over_elevation.T @ over_elevation, np.eye(azimuths))),
        np.asarray(np.kron(np.eye(elevations), over_azimuth.T @ over_azimuth)),
        np.asarray(np.kron(zenith, FIRM * step.T @ step)),
    )


def _strengths(found: Array, noise: Array, penalties: Penalties) -> tuple[float, float]:
    """The strengths of the least generalised cross-validation, for the light of all wavelengths."""
    light = found / np.maximum(found.mean(axis=0), 1e-300)
    own = noise / np.maximum(found.mean(axis=0), 1e-300)
    # Walks carry all wavelengths: their noise is common, and the mean has hardly less of it.
    mean, error = light.mean(axis=1), own.mean(axis=1)
    met = np.count_nonzero(_met(mean))

    def missed(strengths: tuple[float, float]) -> float:
        _, _, rest, freedom = _solved(mean, error, penalties.of(strengths))
        return rest * met / max(met - freedom, 1e-3) ** 2

    return min(product(STRENGTHS, STRENGTHS), key=missed)


def _met(mean: Array) -> Array:
    """Nodes that tell of their light: where walks found some; all, where they found it nowhere."""
    lit = mean > 0
    return np.asarray(lit | ~lit.any())


def _solved(mean: Array, error: Array, penalty: Array) -> tuple[Array, Array, float, float]:
    """Logarithm and its standard error; sum of the squares that remain, in variances, and degrees of freedom."""
    met = _met(mean)
    usual = np.median(mean[met])
    level = np.where(met, np.maximum(mean, 1e-3 * usual + 1e-300), usual + 1e-300)
    logarithm = np.log(level)
    for number in range(ROUNDS):
        # Errors that walks state go with what they found; those of what is smooth do not.
        stated = error / level
        relative = np.where(met, np.hypot(np.maximum(stated, np.median(stated[met])), LEAST), UNMET)
        weight = relative**-2
        matrix = np.diag(weight) + penalty
        step = np.where(met, np.clip((mean - level) / level, -1.0, 3.0), 0.0) if number else 0.0
        logarithm = np.linalg.solve(matrix, weight * (logarithm + step))
        level = np.exp(logarithm)
    inverse = np.linalg.inv(matrix)
    freedom = float(np.sum((np.diag(inverse) * weight)[met]))
    rest = float(np.sum((weight * (mean / level - 1.0) ** 2)[met]))
    wider = max(rest / max(np.count_nonzero(met) - freedom, 1.0), 1.0)
    return logarithm, WIDER * np.sqrt(np.diag(inverse) * wider), rest, freedom
