"""What all cameras share, and those in which straight lines stay straight."""

from __future__ import annotations

from typing import Annotated, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from skyscatter.record import Record

Array = NDArray[np.float64]
Pixels = Annotated[int, Field(ge=1, le=65536)]


class ObserverLike(Protocol):
    """What a camera may ask of an observer; all in metres."""

    @property
    def altitude(self) -> float:
        """Height above the ground."""

    @property
    def planet_radius(self) -> float:
        """Radius of the ground."""

    @property
    def atmosphere_top(self) -> float:
        """Altitude above which there is vacuum."""


class CameraBase(Record):
    """Size of the picture and what all cameras share.

    Parameters
    ----------
    width, height : int
        Size of the picture [pixel].
    """

    width: Pixels
    height: Pixels

    def through(self, x: ArrayLike, y: ArrayLike, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up) through points (x, y) of the picture's plane [pixel], shape (..., 3).

        The mapping goes on beyond the field as far as it can, and stays at its last direction there.
        """
        raise NotImplementedError

    def directions(self, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up) through the pixel centres, shape (height, width, 3); NaN outside the field."""
        return self.through(np.arange(self.width), np.arange(self.height)[:, None], observer)

    def pixel(self, direction: ArrayLike, observer: ObserverLike | None = None) -> tuple[Array, Array]:
        """Fractional pixel coordinates (x, y) of directions of shape (..., 3); NaN where the camera does not see."""
        raise NotImplementedError

    def pixel_solid_angle(self, observer: ObserverLike | None = None) -> Array:
        """Solid angle of each pixel [sr], shape (height, width); 0 outside the field."""
        raise NotImplementedError

    def _offsets(self, x: ArrayLike | None = None, y: ArrayLike | None = None) -> tuple[Array, Array]:
        """Offsets (a, b) from the middle [pixel] of points of the picture; of all pixel centres when not given."""
        x = np.arange(self.width) if x is None else np.asarray(x)
        y = np.arange(self.height)[:, None] if y is None else np.asarray(y)
        a, b = np.broadcast_arrays(x - (self.width - 1) / 2, (self.height - 1) / 2 - y)
        return a, b

    def _inside(self, a: Array, b: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
        x, y = (self.width - 1) / 2 + a, (self.height - 1) / 2 - b
        with np.errstate(invalid="ignore"):
            seen = seen & (x >= -0.5) & (x <= self.width - 0.5) & (y >= -0.5) & (y <= self.height - 0.5)
        return np.where(seen, x, np.nan), np.where(seen, y, np.nan)


class Pinhole(CameraBase):
    """Straight lines stay straight: ``d ∝ f·forward + a·right + b·up`` with a focal length of f pixels."""

    def _view(self, observer: ObserverLike | None) -> tuple[float, Array, Array, Array]:
        """Focal length [pixel], forward, right, up."""
        raise NotImplementedError

    def focal_length(self, observer: ObserverLike | None = None) -> float:
        """Distance of the picture's plane [pixel]."""
        return float(self._view(observer)[0])

    def through(self, x: ArrayLike, y: ArrayLike, observer: ObserverLike | None = None) -> Array:
        """Unit vectors (east, north, up) through points of the picture's plane, shape (..., 3)."""
        focal, forward, right, up = self._view(observer)
        a, b = self._offsets(x, y)
        d = focal * forward + a[..., None] * right + b[..., None] * up
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))

    def pixel(self, direction: ArrayLike, observer: ObserverLike | None = None) -> tuple[Array, Array]:
        """Fractional pixel coordinates (x, y); NaN behind the camera and outside the frame."""
        focal, forward, right, up = self._view(observer)
        d = np.asarray(direction, dtype=float)
        ahead = d @ forward
        seen = ahead > 0
        scale = focal / np.where(seen, ahead, 1.0)
        return self._inside((d @ right) * scale, (d @ up) * scale, seen)

    def pixel_solid_angle(self, observer: ObserverLike | None = None, rows: slice = slice(None)) -> Array:
        """Solid angle [sr] at the pixel centre: f (f² + a² + b²)^(-3/2), the area of a pixel seen obliquely."""
        focal, *_ = self._view(observer)
        a, b = self._offsets(y=np.arange(self.height)[rows, None])
        square = focal**2 + a**2 + b**2
        return focal / (square * np.sqrt(square))  # a power of 1.5 takes four times as long
