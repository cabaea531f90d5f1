"""The first look at an image: what its cells hold, gathered window by window.

Of every small cell the mean reflectance of each band; of every large cell the mean spectrum of its
darkest clear pixels, which the haze cannot be thicker than.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

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


class Found(NamedTuple):
    """The cells of one window; see `Gathered`."""

    mean: Values
    dark: Values
    pixels: NDArray[np.int64]
    where: NDArray[np.int64]


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
    where : ndarray of int64, shape (small row, small column)
        How many of the darkest pixels lie in a small cell.
    """

    lattice: Lattice
    mean: Values
    dark: Values
    pixels: NDArray[np.int64]
    where: NDArray[np.int64]

    @classmethod
    def empty(cls, lattice: Lattice, bands: int) -> Gathered:
        """Nothing seen yet."""
        return cls(
            lattice,
            np.full((bands, *lattice.small_shape), np.nan, np.float32),
            np.full((bands, *lattice.large_shape), np.nan, np.float32),
            np.zeros(lattice.large_shape, np.int64),
            np.zeros(lattice.small_shape, np.int64),
        )

    def put(self, row0: int, col0: int, found: Found) -> None:
        """Enter what `look` found in a window that starts at that pixel."""
        small, large = self.lattice.small, self.lattice.large
        enter(self.mean, row0 // small, col0 // small, found.mean)
        enter(self.where, row0 // small, col0 // small, found.where)
        enter(self.dark, row0 // large, col0 // large, found.dark)
        enter(self.pixels, row0 // large, col0 // large, found.pixels)


def at_dark_pixels(gathered: Gathered, values: Array) -> Array:
    """Means over the darkest pixels of large cells of values that small cells have (band, small row, small column)."""
    group, (rows, cols) = gathered.lattice.group, gathered.lattice.large_shape

    def summed(cells: Array) -> Array:
        padded = np.zeros((rows * group, cols * group))
        padded[: cells.shape[0], : cells.shape[1]] = cells
        total: Array = padded.reshape(rows, group, cols, group).sum(axis=(1, 3))
        return total

    number = summed(gathered.where.astype(float))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([summed(np.where(gathered.where > 0, band * gathered.where, 0.0)) / number for band in values])


def enter(whole: NDArray[Any], row: int, col: int, part: NDArray[Any]) -> None:
    """Put cells in their place among all, (..., row, column)."""
    whole[..., row : row + part.shape[-2], col : col + part.shape[-1]] = part


def look(values: Values, clear: NDArray[np.bool_], visible: list[int], lattice: Lattice) -> Found:
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
    mean = cell_means(values, lattice.small)
    step = max(1, int(np.ceil(lattice.large / np.sqrt(MOST_LOOKED_AT))))
    # Of each large cell the same pixels, wherever the window begins.
    rows, cols = (
        np.flatnonzero(np.arange(n) % lattice.large % step == step // 2 if step > 1 else np.ones(n, bool))
        for n in values.shape[1:]
    )
    sample = values[:, rows[:, None], cols]
    sample[:, ~clear[rows[:, None], cols]] = np.nan
    dark, pixels, chosen = darkest(sample, rows // lattice.large, cols // lattice.large, visible)
    where = np.zeros(mean.shape[1:], np.int64)
    np.add.at(where, (rows[chosen[0]] // lattice.small, cols[chosen[1]] // lattice.small), 1)
    return Found(mean, dark, pixels, where)


def cell_means(values: Values, size: int) -> Values:
    """Means over cells (band, row, column) of pixels that hold data in all bands; NaN where there are none."""
    bands, height, width = values.shape
    known = np.isfinite(values).all(axis=0)
    whole = bool(known.all())
    if size == 1:
        return values.copy() if whole else np.where(known, values, np.float32(np.nan))
    rows, cols = np.arange(0, height, size), np.arange(0, width, size)
    count = np.add.reduceat(np.add.reduceat(known, rows, axis=0, dtype=np.int64), cols, axis=1)
    out = np.empty((bands, rows.size, cols.size), np.float32)
    for k in range(bands):
        filled = values[k] if whole else np.where(known, values[k], np.float32(0))
        # Rows of cells first: that runs along memory.
        total = np.add.reduceat(np.add.reduceat(filled, rows, axis=0), cols, axis=1, dtype=float)
        out[k] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def darkest(
    sample: Values, row_cell: NDArray[Any], col_cell: NDArray[Any], visible: list[int]
) -> tuple[Values, NDArray[np.int64], tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Mean spectra of the darkest pixels of large cells, how many there were to choose from, and which they are."""
    shape = (int(row_cell[-1]) + 1, int(col_cell[-1]) + 1)
    brightness = sample[visible].sum(axis=0)
    dark = np.full((len(sample), *shape), np.nan, np.float32)
    pixels = np.zeros(shape, np.int64)
    rows = np.searchsorted(row_cell, np.arange(shape[0] + 1))
    cols = np.searchsorted(col_cell, np.arange(shape[1] + 1))
    places: list[NDArray[np.int64]] = [np.zeros((2, 0), np.int64)]
    for y in range(shape[0]):
        for x in range(shape[1]):
            bright = brightness[rows[y] : rows[y + 1], cols[x] : cols[x + 1]]
            good = np.flatnonzero(np.isfinite(bright))
            pixels[y, x] = good.size
            if good.size < ENOUGH:
                continue
            count = max(FEWEST, int(DARKEST * good.size))
            chosen = np.sort(good[np.argpartition(bright.ravel()[good], count - 1)[:count]])
            y_in, x_in = np.unravel_index(chosen, bright.shape)
            place = np.stack([y_in + rows[y], x_in + cols[x]])
            dark[:, y, x] = sample[:, place[0], place[1]].mean(axis=1)
            places.append(place)
    every = np.concatenate(places, axis=1)
    return dark, pixels, (every[0], every[1])
