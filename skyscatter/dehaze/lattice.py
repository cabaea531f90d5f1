"""The cells on which an image is judged: aligned to its own pixels, so that windows have no influence.

Small cells hold mean reflectances, by which the surroundings of a pixel are known; larger ones, a whole number of small
cells on a side, hold the haze, for it takes many pixels to find a dark one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]
Single = NDArray[np.float32]

MOST_SMALL, MOST_LARGE = 512, 128  #: cells on a side of the image, at most
#: A small cell need not be smaller [m]: nine tenths of what haze scatters into a pixel come from further away.
FINE_ENOUGH = 100.0
LEAST_LARGE = 16  #: pixels on a side of a large cell, at least


@dataclass(frozen=True)
class Lattice:
    """Cells of an image.

    Attributes
    ----------
    height, width : int
        Of the image [pixel].
    small : int
        Pixels on a side of a small cell.
    group : int
        Small cells on a side of a large one.
    """

    height: int
    width: int
    small: int
    group: int

    @classmethod
    def of(cls, height: int, width: int, pixel_m: float | None = None) -> Lattice:
        """The lattice for an image of that many rows and columns, with pixels of that size [m] where it is known."""
        if min(height, width) < 1:
            raise DomainError("image", f"{height} x {width}", "has no pixels")
        longest = max(height, width)
        small = -(-longest // MOST_SMALL)
        if pixel_m is not None:
            small = max(small, min(int(FINE_ENOUGH / pixel_m), LEAST_LARGE))
        large = max(LEAST_LARGE, -(-longest // MOST_LARGE))
        return cls(height, width, small, -(-large // small))

    @property
    def large(self) -> int:
        """Pixels on a side of a large cell."""
        return self.small * self.group

    @property
    def small_shape(self) -> tuple[int, int]:
        """Rows and columns of small cells."""
        return -(-self.height // self.small), -(-self.width // self.small)

    @property
    def large_shape(self) -> tuple[int, int]:
        """Rows and columns of large cells."""
        return -(-self.height // self.large), -(-self.width // self.large)

    def small_centres(self) -> tuple[Array, Array]:
        """Pixel coordinates of the centres of the rows and columns of small cells."""
        return centres(self.small_shape, self.small)

    def large_centres(self) -> tuple[Array, Array]:
        """Pixel coordinates of the centres of the rows and columns of large cells."""
        return centres(self.large_shape, self.large)

    def at_pixels(self, cells: NDArray[np.floating], row0: int, col0: int, shape: tuple[int, ...]) -> Single:
        """Values of small cells (small row, small column) at the pixels of a window, bilinear; see `at_pixels`."""
        return at_pixels(cells, self.small, row0, col0, shape)

    def to_small(self, values: Array) -> Array:
        """Values at the centres of large cells (..., large row, large column), bilinear at those of small ones."""
        along = [
            linear_weights(fine, coarse)
            for fine, coarse in zip(self.small_centres(), self.large_centres(), strict=True)
        ]
        out: Array = np.einsum("yi,...ij,xj->...yx", along[0], values, along[1], optimize=True)
        return out


def at_pixels(
    cells: NDArray[np.floating], size: int, row0: int, col0: int, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Values of cells at the pixels of a window, bilinear between their centres.

    Pixel by pixel: in a product of matrices the order of the sums, and so the last bit, would hang on the window.

    Parameters
    ----------
    cells : ndarray, shape (row, column)
    size : int
        Pixels on a side of a cell.
    row0, col0 : int
        First row and column of the window.
    shape : (int, int)
        Of the window.
    """
    low, high, share = [], [], []
    for start, n, count in zip((row0, col0), shape, cells.shape, strict=True):
        place = np.clip((start + np.arange(n) + 0.5) / size - 0.5, 0.0, count - 1.0)
        low.append(place.astype(np.int64))
        high.append(np.minimum(low[-1] + 1, count - 1))
        share.append(place - low[-1])
    f, s = share[0][:, None], share[1]
    values = cells.astype(float)
    rows = [
        values[index[:, None], low[1]] * (1 - s) + values[index[:, None], high[1]] * s for index in (low[0], high[0])
    ]
    return np.asarray(rows[0] * (1 - f) + rows[1] * f, np.float32)


def centres(shape: tuple[int, int], size: int) -> tuple[Array, Array]:
    """Pixel coordinates of the centres of rows and columns of cells."""
    return tuple((np.arange(n) + 0.5) * size for n in shape)  # type: ignore[return-value]


def linear_weights(points: ArrayLike, nodes: Array) -> Array:
    """Weights (point, node) of linear interpolation between rising nodes, constant beyond the first and the last."""
    at = np.clip(np.asarray(points, float), nodes[0], nodes[-1])
    weights = np.zeros((at.size, nodes.size))
    if nodes.size == 1:
        weights[:] = 1.0
        return weights
    low = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, nodes.size - 2)
    share = (at - nodes[low]) / (nodes[low + 1] - nodes[low])
    rows = np.arange(at.size)
    weights[rows, low] = 1 - share
    weights[rows, low + 1] = share
    return weights
