"""Directions in the observer's frame (x east, y north, z up) and their azimuth and elevation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]


def direction_from_azimuth_elevation(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Array:
    """Unit vectors (east, north, up) of directions given by azimuth and elevation.

    Parameters
    ----------
    azimuth_deg : array_like
        Azimuth [degree] from north through east.
    elevation_deg : array_like
        Elevation [degree] above the horizontal plane; broadcast against `azimuth_deg`.

    Returns
    -------
    ndarray, shape (..., 3)
        ``(cos e sin A, cos e cos A, sin e)``.
    """
    azimuth, elevation = np.broadcast_arrays(
        np.radians(np.asarray(azimuth_deg, dtype=float)), np.radians(np.asarray(elevation_deg, dtype=float))
    )
    horizontal = np.cos(elevation)
    return np.stack((horizontal * np.sin(azimuth), horizontal * np.cos(azimuth), np.sin(elevation)), axis=-1)


class Directed:
    """What lights from one direction share: `direction`, or `azimuth_deg` and `elevation_deg`, fields of theirs."""

    def check_direction(self: Any) -> None:
        """Refuse none and both, and a direction of no length."""
        angles = (self.azimuth_deg is not None, self.elevation_deg is not None)
        if any(angles) != all(angles) or any(angles) == (self.direction is not None):
            raise DomainError("direction", self.direction, "give either direction, or azimuth_deg and elevation_deg")
        if self.direction is not None and not any(self.direction):
            raise DomainError("direction", self.direction, "must not be zero")

    @property
    def towards(self: Any) -> Array:
        """Unit vector towards the light, shape (3,)."""
        if self.direction is not None:
            vector = np.asarray(self.direction, float)
            return vector / np.linalg.norm(vector)
        return direction_from_azimuth_elevation(self.azimuth_deg or 0.0, self.elevation_deg or 0.0)


def azimuth_elevation_from_direction(direction: ArrayLike) -> tuple[Array, Array]:
    """Azimuth [degree, 0 to 360) and elevation [degree] of directions (east, north, up) of any length.

    Parameters
    ----------
    direction : array_like, shape (..., 3)
        Directions; the azimuth of an exactly vertical one is 0.

    Returns
    -------
    azimuth_deg, elevation_deg : ndarray, shape (...)
        NaN where the direction is NaN.
    """
    east, north, up = np.moveaxis(np.asarray(direction, dtype=float), -1, 0)
    azimuth = np.degrees(np.arctan2(east, north)) % 360.0
    # An angle a rounding error below zero becomes 360 in the remainder, which is outside the stated range.
    azimuth = np.where(azimuth == 360.0, 0.0, azimuth)
    return azimuth, np.degrees(np.arctan2(up, np.hypot(east, north)))


def camera_frame(azimuth_deg: float, elevation_deg: float, roll_deg: float = 0.0) -> tuple[Array, Array, Array]:
    """Forward, right and up unit vectors of a camera.

    Without roll, *up* is the direction in which elevation grows; it stays defined at the zenith and the nadir, where
    it is the limit reached by tilting the camera at the given azimuth.  Roll turns the camera clockwise as seen from
    behind it, so the picture turns anticlockwise.
    """
    a, e, roll = np.radians([azimuth_deg, elevation_deg, roll_deg])
    forward = np.array([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)])
    up = np.array([-np.sin(e) * np.sin(a), -np.sin(e) * np.cos(a), np.cos(e)])
    right = np.cross(forward, up)
    return forward, np.cos(roll) * right - np.sin(roll) * up, np.cos(roll) * up + np.sin(roll) * right
