"""The first look at an image: what its cells hold, gathered window by window.

Of every small cell the mean reflectance of each band; of every large cell the mean spectrum of its
darkest clear pixels, which the haze cannot be thicker than.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.lattice import Lattice

Array = NDArray[np.float64]
Values = NDArray[np.float32]

#: Share of the clear pixels of a cell that count as its darkest, and how many they are at least: enough to be free of
#: noise and of single wrong pixels, few enough to be dark.
DARKEST, FEWEST = 0.02, 4
#: Clear pixels that a large cell needs to be judged at all.
ENOUGH = 16
#: Pixels of a large cell that are looked at for dark ones, at most; of more, every n-th in both directions.
MOST_LOOKED_AT = 1024


@dataclass
class Gathered:
    """What the cells of an image hold.

    Attributes
    ----------
    lattice : Lattice
    mean : ndarray of float32, shape (band, small row, small column)
        Mean reflectance above the atmosphere, clouds among it, for they light their surroundings too; NaN where there
        are no data.
    dark : ndarray of float32, shape (band, large row, large column)
        Mean of the darkest clear pixels; NaN where too few are clear.
    pixels : ndarray of int64, shape (large row, large column)
        Clear pixels looked at.
    """

    lattice: Lattice
    mean: Values
    dark: Values
    pixels: NDArray[np.int64]

    @classmethod
    def empty(cls, lattice: Lattice, bands: int) -> Gathered:
        """Nothing seen yet."""
        return cls(
            lattice,
            np.full((bands, *lattice.small_shape), np.nan, np.float32),
            np.full((bands, *lattice.large_shape), np.nan, np.float32),
            np.zeros(lattice.large_shape, np.int64),
        )

    def put(self, row0: int, col0: int, found: tuple[Values, Values, NDArray[np.int64]]) -> None:
        """Enter what `look` found in a window that starts at that pixel."""
        small, large = self.lattice.small, self.lattice.large
        mean, dark, pixels = found
        enter(self.mean, row0 // small, col0 // small, mean)
        enter(self.dark, row0 // large, col0 // large, dark)
        enter(self.pixels, row0 // large, col0 // large, pixels)


def surroundings(gathered: Gathered, cells: float) -> Array:
    """Mean reflectances around large cells (band, row, column), blurred by a normal law of that width in cells."""
    from scipy.ndimage import gaussian_filter

    group, (rows, cols) = gathered.lattice.group, gathered.lattice.large_shape
    out = np.empty((len(gathered.mean), rows, cols))
    for band, mean in zip(out, gathered.mean, strict=True):
        padded = np.full((rows * group, cols * group), np.nan)
        padded[: mean.shape[0], : mean.shape[1]] = mean
        known = np.isfinite(padded)
        blocks = np.where(known, padded, 0.0).reshape(rows, group, cols, group).sum(axis=(1, 3))
        number = known.reshape(rows, group, cols, group).sum(axis=(1, 3)).astype(float)
        weight = gaussian_filter(number, cells, mode="nearest", truncate=4)
        total = gaussian_filter(blocks, cells, mode="nearest", truncate=4)
        band[:] = np.where(weight > 1e-6, total / np.maximum(weight, 1e-6), np.nan)
    return out


def enter(whole: NDArray[Any], row: int, col: int, part: NDArray[Any]) -> None:
    """Put cells in their place among all, (..., row, column)."""
    whole[..., row : row + part.shape[-2], col : col + part.shape[-1]] = part


def look(
    values: Values, clear: NDArray[np.bool_], visible: list[int], lattice: Lattice
) -> tuple[Values, Values, NDArray[np.int64]]:
    """Cells of one window that starts on a corner of a large cell.

    Parameters
    ----------
    values : ndarray of float32, shape (band, y, x)
        Reflectance above the atmosphere.
    clear : ndarray of bool, shape (y, x)
        Pixels that show the ground and hold data in all bands.
    visible : list of int
        Bands by whose sum dark is judged.
    lattice : Lattice
    """
    masked = np.where(clear, values, np.float32(np.nan))
    known = np.isfinite(values).all(axis=0)
    mean = cell_means(np.where(known, values, np.float32(np.nan)), lattice.small)
    step = max(1, int(np.ceil(lattice.large / np.sqrt(MOST_LOOKED_AT))))
    # Of each large cell the same pixels, wherever the window begins.
    rows, cols = (
        np.flatnonzero(np.arange(n) % lattice.large % step == step // 2 if step > 1 else np.ones(n, bool))
        for n in values.shape[1:]
    )
    sample = masked[:, rows[:, None], cols]
    dark, pixels = darkest(sample, rows // lattice.large, cols // lattice.large, visible)
    return mean, dark, pixels


def cell_means(values: Values, size: int) -> Values:
    """Means over cells (band, row, column) of what is not NaN; NaN where all is."""
    bands, height, width = values.shape
    if size == 1:
        return values.copy()
    rows, cols = np.arange(0, height, size), np.arange(0, width, size)
    known = np.isfinite(values[0])
    count = np.add.reduceat(np.add.reduceat(known, rows, axis=0, dtype=np.int64), cols, axis=1)
    out = np.empty((bands, rows.size, cols.size), np.float32)
    for k in range(bands):
        filled = np.where(known, values[k], np.float32(0))
        total = np.add.reduceat(np.add.reduceat(filled, rows, axis=0, dtype=float), cols, axis=1)
        out[k] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def darkest(
    sample: Values, row_cell: NDArray[Any], col_cell: NDArray[Any], visible: list[int]
) -> tuple[Values, NDArray[np.int64]]:
    """Mean spectra of the darkest pixels of large cells, and how many pixels were to choose from."""
    shape = (int(row_cell[-1]) + 1, int(col_cell[-1]) + 1)
    brightness = sample[visible].sum(axis=0)
    dark = np.full((len(sample), *shape), np.nan, np.float32)
    pixels = np.zeros(shape, np.int64)
    rows = np.searchsorted(row_cell, np.arange(shape[0] + 1))
    cols = np.searchsorted(col_cell, np.arange(shape[1] + 1))
    for y in range(shape[0]):
        for x in range(shape[1]):
            part = np.s_[rows[y] : rows[y + 1], cols[x] : cols[x + 1]]
            bright = brightness[part].ravel()
            good = np.flatnonzero(np.isfinite(bright))
            pixels[y, x] = good.size
            if good.size < ENOUGH:
                continue
            count = max(FEWEST, int(DARKEST * good.size))
            chosen = good[np.argpartition(bright[good], count - 1)[:count]]
            dark[:, y, x] = sample[(slice(None), *part)].reshape(len(sample), -1)[:, np.sort(chosen)].mean(axis=1)
    return dark, pixels
