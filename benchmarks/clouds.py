"""A turbulent cloud for the benchmarks of nebulae: log-normal, with the power spectrum of Kolmogorov's turbulence."""

from __future__ import annotations

from typing import Any

import numpy as np

DEVIATION = 1.0  #: standard deviation of the logarithm of the density
OUTER, INNER = 1.0, 1 / 3  #: waves in the cube, more than this; waves in a cell, fewer than this


def turbulent_cloud(cells: int, seed: int = 1) -> Any:
    """Density (x, y, z), float32, on the cube from -1 to 1; 1 in the mean along the middle, 0 beyond radius 1.

    The logarithm is a Gaussian random field whose power falls as the wave number to -11/3 (Kolmogorov 1941), cut off
    where a wave is three cells long; the result falls off towards the sphere as (1 - r^2)^2.
    """
    waves = np.fft.fftfreq(cells, 1 / cells)
    last = np.fft.rfftfreq(cells, 1 / cells)
    number = np.sqrt(waves[:, None, None] ** 2 + waves[None, :, None] ** 2 + last**2)
    number[0, 0, 0] = 1.0
    amplitude = number ** (-11 / 6) * (number < cells * INNER) * (number > OUTER)
    noise = np.random.default_rng(seed).normal(size=(cells,) * 3)
    field = np.fft.irfftn(np.fft.rfftn(noise) * amplitude, s=noise.shape, axes=(0, 1, 2))
    field *= DEVIATION / field.std()
    middles = (np.arange(cells) + 0.5) / cells * 2 - 1
    squared = middles[:, None, None] ** 2 + middles[None, :, None] ** 2 + middles**2
    density = np.exp(field) * np.maximum(1 - squared, 0.0) ** 2
    near = slice(cells // 2 - cells // 16, cells // 2 + cells // 16)
    column = density[near, near].mean(axis=(0, 1)).sum() * 2 / cells
    return (2 / column * density).astype(np.float32)  # a column of 2 along the middle: the mean density there is 1


def particles_of(density: Any, number: int, seed: int = 2) -> Any:
    """Places (number, 3) drawn from a density on the cube from -1 to 1, uniform within cells."""
    random = np.random.default_rng(seed)
    total = np.cumsum(density, dtype=np.float64)
    cell = np.searchsorted(total, random.random(number) * total[-1])
    index = np.stack(np.unravel_index(cell, density.shape), axis=1)
    return (index + random.random((number, 3))) / density.shape[0] * 2 - 1
