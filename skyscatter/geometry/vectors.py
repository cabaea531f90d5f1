"""Directions in the observer's frame (x east, y north, z up) and their azimuth and elevation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
