"""The first look at an image: what its cells hold, gathered window by window.

Of every small cell the mean reflectance of each band over clear pixels; of every large cell the mean spectrum of its
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
        Mean reflectance above the atmosphere; NaN where nothing is clear.
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
        for target, size, part in zip(
            (self.mean, self.dark, self.pixels), (self.lattice.small, self.lattice.large, self.lattice.large), found,
            strict=True,
        ):  # fmt: skip
            y, x = row0 // size, col0 // size
            target[..., y : y + part.shape[-2], x : x + part.shape[-1]] = part


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
    mean = cell_means(masked, lattice.small)
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
