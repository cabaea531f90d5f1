"""The veil from place to place: the evidence of overlapping regions, joined under a total-variation prior.

What one region seems to show may come from its surfaces, so a map is only drawn as far as regions differ by more than
their own uncertainty says they would (the method of moments of DerSimonian & Laird, Controlled Clinical Trials 7,
1986, eq. 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.picture.evidence import DEPTHS, Features, Weights, features
from skyscatter.dehaze.picture.lattice import Lattice

Floats = NDArray[np.float64]

REGIONS = 12
"""Regions along the longer edge of an image; each overlaps the next by half."""
FLAT = 0.02
"""Steps of the depth below which the prior is that of a normal distribution."""


@dataclass(frozen=True)
class Regions:
    """Features of overlapping regions, (rows, columns) of them; None where there is too little data.

    ``size`` and ``step`` are their edge and their distance, cells.
    """

    found: list[list[Features | None]]
    size: int
    step: int

    def known(self) -> list[Features]:
        """Features of the regions that have data, row by row."""
        return [f for line in self.found for f in line if f is not None]

    def filled(self, values: Floats, otherwise: float) -> Floats:
        """Values of the known regions on the grid of all, (rows, columns)."""
        mask = np.array([[f is not None for f in line] for line in self.found])
        out = np.full(mask.shape, otherwise)
        out[mask] = values
        return out


def find_regions(lattice: Lattice) -> Regions:
    """Features of the regions of a lattice."""
    rows, columns = lattice.shape
    step = max(3, -(-max(rows, columns) // (REGIONS + 1)))
    size = 2 * step
    starts = [range(0, max(1, n - step), step) for n in (rows, columns)]
    found = [[features(lattice, (slice(r, r + size), slice(c, c + size))) for c in starts[1]] for r in starts[0]]
    return Regions(found, size, step)


def depth_moments(weights: Weights) -> tuple[float, float]:
    """Depth of the posterior mean of the gain, ln E[e^τ], and the standard deviation of the depth."""
    share = weights.veil.sum(axis=(0, 2))
    centre = float(share @ DEPTHS)
    spread = float(share @ DEPTHS**2) - centre**2
    return float(np.log(share @ np.exp(DEPTHS) + weights.clear)), float(np.sqrt(max(spread, 0.0))) + 0.01


def smooth(values: Floats, sigma: Floats, scale: float = 0.1) -> Floats:
    """Most probable map given values with errors and steps between neighbours with a Laplace distribution.

    That prior keeps fronts sharp and lets flat stay flat.  Solved by reweighted least squares; ``scale`` is that of a
    step.
    """
    from scipy.linalg import solveh_banded

    rows, columns = values.shape
    weight = 1.0 / sigma**2
    field = np.full(values.shape, float((weight * values).sum() / weight.sum()))
    # The matrix of a grid, row by row: neighbours in a row are next to each other, those in a column a row apart.
    for _ in range(30):
        across = 1.0 / (scale * np.maximum(np.abs(np.diff(field, axis=1)), FLAT))
        down = 1.0 / (scale * np.maximum(np.abs(np.diff(field, axis=0)), FLAT))
        diagonal = weight.copy()
        diagonal[:, 1:] += across
        diagonal[:, :-1] += across
        diagonal[1:] += down
        diagonal[:-1] += down
        bands = np.zeros((columns + 1, rows, columns))
        bands[columns] = diagonal
        bands[0, 1:] -= down
        bands[columns - 1, :, 1:] -= across
        field = solveh_banded(bands.reshape(columns + 1, -1), (weight * values).ravel()).reshape(rows, columns)
    return field


def heterogeneity(values: Floats, sigma: Floats) -> float:
    """Share of the differences between regions that their errors do not explain, 0 to 1."""
    weight = 1.0 / sigma**2
    total = weight.sum()
    centre = (weight * values).sum() / total
    found = (weight * (values - centre) ** 2).sum()
    free = values.size - 1
    if free < 3:
        return 0.0
    between = (found - free) / (total - (weight**2).sum() / total)
    return float(max(0.0, between / (between + free / total))) if between > 0.0 else 0.0


def spread_map(values: Floats, regions: Regions, shape: tuple[int, int]) -> Floats:
    """Values of regions at the centres of all cells, straight lines between the regions' centres."""
    out = values
    for axis, number in enumerate(shape):
        centres = np.minimum(regions.step * np.arange(values.shape[axis]) + 0.5 * regions.size, number)
        place = np.arange(number) + 0.5
        lines = [np.interp(place, centres, line) for line in np.moveaxis(out, axis, -1)]
        out = np.moveaxis(np.array(lines), -1, axis)
    return out
