"""Sources with one file a band, of different resolutions, on a common grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.flags import Flag, mark
from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import NODATA, SATURATED, RasterBand, RasterSource, calibrate
from skyscatter.dehaze.rasters.handles import DatasetPool
from skyscatter.errors import DomainError, MissingDataError

#: Of Sentinel-2 and Landsat products of level 1.
NODATA_NUMBER = 0


class _OnGrid:
    """Numbers on pixels `coarser` times as wide as those of the grid."""

    coarser: int

    def native(self, row0: int, row1: int, col0: int, col1: int) -> tuple[int, int, int, int]:
        """The coarser pixels in which a window of the grid lies."""
        n = self.coarser
        return row0 // n, -(-row1 // n), col0 // n, -(-col1 // n)

    def repeated(self, values: NDArray[Any], row0: int, row1: int, col0: int, col1: int) -> NDArray[Any]:
        """Those coarser pixels on the window of the grid."""
        n = self.coarser
        rows, cols = np.arange(row0, row1) // n - row0 // n, np.arange(col0, col1) // n - col0 // n
        return values if n == 1 else values[rows][:, cols]


@dataclass(frozen=True)
class BandFile(_OnGrid):
    """File of one band, of coarser pixels than the grid, or of `finer` times as many."""

    pool: DatasetPool
    coarser: int = 1
    finer: int = 1

    def numbers(self, row0: int, row1: int, col0: int, col1: int) -> NDArray[Any]:
        """Numbers of the file's first layer in a window of its own pixels."""
        with self.pool.reading() as dataset:
            found: NDArray[Any] = dataset.read(1, window=((row0, row1), (col0, col1)))
        return found

    def close(self) -> None:
        """Close the file."""
        self.pool.close()


@dataclass(frozen=True)
class Drawn(_OnGrid):
    """Numbers that were drawn rather than read, shape (row, column)."""

    pixels: NDArray[Any]
    coarser: int = 1

    def numbers(self, row0: int, row1: int, col0: int, col1: int) -> NDArray[Any]:
        """Those of a window of its own pixels."""
        return self.pixels[row0:row1, col0:col1]

    def close(self) -> None:
        """Nothing to close."""


@dataclass(frozen=True)
class Quality:
    """What the product itself says of its pixels: numbers on a grid, and what they mean."""

    layer: BandFile | Drawn
    meaning: Callable[[NDArray[Any]], dict[Flag, NDArray[np.bool_]]]

    def mark(self, flags: NDArray[np.uint8], row0: int, row1: int, col0: int, col1: int) -> None:
        """Set its flags in those of a window, in place, where there are data."""
        window = row0, row1, col0, col1
        numbers = self.layer.repeated(self.layer.numbers(*self.layer.native(*window)), *window)
        there = (flags & np.uint8(NODATA)) == 0
        for flag, where in self.meaning(numbers).items():
            mark(flags, where & there, flag)


class LayeredSource(RasterSource):
    """One file a band; coarser pixels are repeated, finer ones averaged.

    The same pixels come out whatever window is asked for.
    """

    files: tuple[BandFile, ...]
    quality: Quality | None = None
    _dtype: str = "uint16"

    def read_with_flags(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Values and flags of a window; see `RasterSource`."""
        window = self._window(row0, row1, col0, col1)
        indexes = self._indexes(bands)
        values = np.empty((len(indexes), *window.shape), dtype=np.float32)
        saturated = np.zeros(window.shape, dtype=bool)
        for place, index in enumerate(indexes):
            saturated |= self._band(index, *window, out=values[place])
        self._finish(values, np.arange(row0, row1) + 0.5, np.arange(col0, col1) + 0.5)
        flags = np.where(np.isnan(values).all(axis=0), np.uint8(NODATA), np.uint8(0))
        flags[saturated] |= SATURATED
        if self.quality is not None:
            self.quality.mark(flags, *window)
        return values, flags

    def thumbnail(
        self, size: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], tuple[float, float]]:
        """A coarse version of the image; see `RasterSource`."""
        step = max(1.0, max(self.height, self.width) / size)
        shape = max(1, round(self.height / step)), max(1, round(self.width / step))
        down, across = self.height / shape[0], self.width / shape[1]
        parts = []
        for index in self._indexes(bands):
            with self.files[index].pool.reading() as dataset:
                numbers = dataset.read([1], out_shape=(1, *shape))
            parts.append(calibrate(numbers, numbers != NODATA_NUMBER, [self.bands[index]])[0][0])
        values = np.stack(parts)
        self._finish(values, (np.arange(shape[0]) + 0.5) * down, (np.arange(shape[1]) + 0.5) * across)
        return values, (down, across)

    def close(self) -> None:
        """Close all files."""
        for file in self.files:
            file.pool.close()
        if self.quality is not None:
            self.quality.layer.close()

    def _finish(self, values: NDArray[np.float32], rows: NDArray[Any], cols: NDArray[Any]) -> None:
        """What is left to do with values at these pixel coordinates, in place; nothing here."""
        return

    def _band(
        self, index: int, row0: int, row1: int, col0: int, col1: int, out: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Fill in the values of one band; returns where it is saturated."""
        file, band = self.files[index], self.bands[index]
        if file.finer > 1:
            n = file.finer
            values, saturated = self._native(file, band, row0 * n, row1 * n, col0 * n, col1 * n)
            out[...] = _mean_of_blocks(values, n)
            blocks = saturated.reshape(row1 - row0, n, col1 - col0, n)
            return np.logical_or.reduce(blocks, axis=(1, 3))
        window = row0, row1, col0, col1
        values, saturated = self._native(file, band, *file.native(*window))
        out[...] = file.repeated(values, *window)
        return file.repeated(saturated, *window)

    def _native(
        self, file: BandFile, band: RasterBand, row0: int, row1: int, col0: int, col1: int
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        with file.pool.reading() as dataset:
            numbers = dataset.read([1], window=((row0, row1), (col0, col1)))
        values, flags = calibrate(numbers, numbers != NODATA_NUMBER, [band])
        return values[0], (flags & SATURATED) != 0

    def _check_files(self, labels: Sequence[str]) -> None:
        """Refuse band files of another size or type than the metadata say."""
        for label, file in zip(labels, self.files, strict=True):
            dtype = self._check_size(f"band {label}", file)
            if dtype != self._dtype:
                raise MissingDataError(
                    file.pool.shown, f"holds {dtype} instead of {self._dtype}; get the product again"
                )

    def _check_size(self, label: str, file: BandFile) -> str:
        """Refuse a file of another size than the metadata say; its data type."""
        with file.pool.reading() as dataset:
            found = dataset.height * file.coarser // file.finer, dataset.width * file.coarser // file.finer
            dtype = str(dataset.dtypes[0])
        if found != (self.height, self.width):
            remedy = f"{label} covers {found} pixels of the grid where the metadata say "
            raise MissingDataError(file.pool.shown, f"{remedy}{(self.height, self.width)}; get the product again")
        return dtype

    def _heed(self, quality: Quality, note: str) -> None:
        """Take the product's word on its pixels, and say so."""
        self.quality = quality
        if isinstance(quality.layer, BandFile):
            self._check_size("the mask", quality.layer)
        self.notes = (*self.notes, note)


def _mean_of_blocks(values: NDArray[np.float32], n: int) -> NDArray[np.float32]:
    """Mean over n x n pixels of those that have data; NaN where none has."""
    height, width = values.shape[0] // n, values.shape[1] // n
    blocks = values.reshape(height, n, width, n)
    there = ~np.isnan(blocks)
    count = there.sum(axis=(1, 3))
    total = np.where(there, blocks, np.float32(0.0)).sum(axis=(1, 3), dtype=np.float64)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(np.float32)


def refuse_calibration(options: SourceOptions, sensor: str, product: str, quantities: tuple[str, ...]) -> None:
    """Refuse options that say what the product says itself."""
    for name in ("scale", "offset"):
        if getattr(options, name) is not None:
            raise DomainError(name, getattr(options, name), f"stands in the metadata of {product}; leave it out")
    if options.quantity not in (None, *quantities):
        raise DomainError("quantity", options.quantity, f"{product} gives {' or '.join(quantities)}")
    if options.sensor is not None and options.sensor.lower() != sensor:
        raise DomainError("sensor", options.sensor, f"the metadata say {sensor}; leave it out")
