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

    def to_small(self, values: Array) -> Array:
        """Values at the centres of large cells (..., large row, large column), bilinear at those of small ones."""
        along = [
            linear_weights(fine, coarse)
            for fine, coarse in zip(self.small_centres(), self.large_centres(), strict=True)
        ]
        out: Array = np.einsum("yi,...ij,xj->...yx", along[0], values, along[1], optimize=True)
        return out


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
