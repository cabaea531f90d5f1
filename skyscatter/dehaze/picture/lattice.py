"""Statistics of a picture on a lattice of cells at absolute positions: all that is kept of a raster beyond memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.picture.options import PictureOptions
from skyscatter.dehaze.picture.transfer import tables
from skyscatter.errors import DomainError

Floats = NDArray[np.float32]

TAIL = 0.02
"""Share of a cell's pixels that lie beyond its low and its high end: single bad pixels do not count in large cells."""

WHITE = 0.85
"""Pixels above this in all bands are taken for clouds: they hide the veil rather than lie beneath it."""


def saturation_of(options: PictureOptions) -> float:
    """The value from which a pixel is saturated: half a step below the end of the scale."""
    return 1.0 - 0.5 / (options.levels - 1)


@dataclass(frozen=True)
class Lattice:
    """Statistics of cells of ``cell`` x ``cell`` pixels, the first at row 0, column 0 of the image.

    Attributes
    ----------
    height, width : int
        Size of the image, pixels.
    cell : int
        Edge of a cell, pixels.
    low, high, mean, variance : (bands, rows, columns) float32
        Low and high end, mean and variance of the light, 0 to 1.
    brightest, darkest : (rows, columns) float32
        Means of a pixel's brightest and darkest band.
    number : (rows, columns) int32
        Pixels that were used: neither without data nor saturated.
    """

    height: int
    width: int
    cell: int
    low: Floats
    high: Floats
    mean: Floats
    variance: Floats
    brightest: Floats
    darkest: Floats
    number: NDArray[np.int32]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return self.number.shape[0], self.number.shape[1]

    def gather(self, window: NDArray[np.floating], row0: int, col0: int, options: PictureOptions) -> None:
        """Fill the cells that a window covers.

        Parameters
        ----------
        window : (bands, h, w) float
            Values 0 to 1; NaN where nothing was measured.
        row0, col0 : int
            Its corner: multiples of ``cell``.  Its far edges are multiples of ``cell`` as well, or those of the image.
        options : PictureOptions
            How the values are read.

        Raises
        ------
        DomainError
            If the window cuts through cells.
        """
        from skyscatter.kernels.raster.picture import BINS, cell_statistics

        bands, height, width = window.shape
        for name, start, length, end in (("row0", row0, height, self.height), ("col0", col0, width, self.width)):
            if start % self.cell or ((start + length) % self.cell and start + length != end) or start + length > end:
                raise DomainError(name, start, f"windows that begin and end at multiples of {self.cell} pixels")
        r, c = row0 // self.cell, col0 // self.cell
        here = (slice(r, r - (-height // self.cell)), slice(c, c - (-width // self.cell)))
        parts = [getattr(self, name)[(slice(None), *here)] for name in ("low", "high", "mean", "variance")]
        parts += [getattr(self, name)[here] for name in ("brightest", "darkest", "number")]
        decoding, _ = tables(options.transfer)
        values = np.ascontiguousarray(window, dtype=np.float32)
        # A single band does not tell clouds from bright ground.
        limits = np.float32(saturation_of(options)), np.float32(WHITE if bands == 3 else 2.0)
        counts = np.empty((bands, BINS), dtype=np.int32)
        cell_statistics(values, decoding, self.cell, TAIL, *limits, counts, *parts)


def new_lattice(height: int, width: int, bands: int, options: PictureOptions) -> Lattice:
    """A lattice without statistics yet, for an image of a size.

    Raises
    ------
    DomainError
        If the image has no pixels, or neither one band nor three.
    """
    if height < 1 or width < 1:
        raise DomainError("size", (height, width), "an image of at least one pixel")
    if bands != len(options.wavelengths):
        raise DomainError("bands", bands, f"{len(options.wavelengths)}, as many as there are wavelengths")
    cell = max(1, -(-max(height, width) // options.cells))
    shape = (-(-height // cell), -(-width // cell))
    low, high, mean, variance = (np.zeros((bands, *shape), np.float32) for _ in range(4))
    brightest, darkest = (np.zeros(shape, np.float32) for _ in range(2))
    number = np.zeros(shape, np.int32)
    return Lattice(height, width, cell, low, high, mean, variance, brightest, darkest, number)
