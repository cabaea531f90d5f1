"""Sunlight that comes straight through the atmosphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.kernels.lookup import ColumnTable, outward_columns, outward_columns_at
from skyscatter.kernels.optics import SceneTable
from skyscatter.solvers.base import Array

#: Zenith cosines over which columns are tabulated across the disk: seen through a planet's air from space, they change
#: by a factor of 20 there.
DISK_STEPS = 193


def outward_profile(columns: ColumnTable, altitudes: ArrayLike = (0.0,), mu: float = 1.0) -> Array:
    """Columns [m] from altitudes (altitude,) [m] to the top under a zenith cosine, straight up if not said.

    Returns
    -------
    ndarray, shape (altitude, component)
    """
    height = np.ascontiguousarray(altitudes, float)
    out = np.zeros((height.size, columns.value.shape[2]))
    outward_columns_at(columns, height, float(mu), out)
    return out


def slant_columns(columns: ColumnTable, altitude: float, mu: float) -> Array | None:
    """Columns [m] from an altitude, inside or above the atmosphere, towards a distant light at zenith cosine mu.

    Returns
    -------
    ndarray, shape (component,)
        Or None where the planet is in the way.
    """
    radius = columns.radius + altitude
    out = np.zeros(columns.value.shape[2])
    outward_columns(columns, altitude, abs(mu), out)
    if mu >= 0:
        return out
    low = radius * np.sqrt((1 - mu) * (1 + mu))
    if low <= columns.radius:
        return None
    across = np.zeros_like(out)
    outward_columns(columns, float(low - columns.radius), 0.0, across)
    return np.maximum(2 * across - out, 0.0)


def disk_light(table: SceneTable, position: Array, directions: Array) -> Array:
    """Radiance of the Sun's disk, dimmed by the atmosphere, along rays from one position; 0 outside the disk.

    Parameters
    ----------
    table : SceneTable
    position : (3,)
        From the planet's centre [m].
    directions : (ray, 3)
        Unit vectors.

    Returns
    -------
    ndarray, shape (ray, wavelength)
        [W m-2 sr-1 nm-1].
    """
    optics, columns = table.optics, table.columns
    light = np.zeros((len(directions), optics.albedo.size))
    if optics.disk_radius <= 0:
        return light
    sine = np.linalg.norm(np.cross(directions, optics.disk_axis), axis=1)
    square = (sine / np.sin(optics.disk_radius)) ** 2
    radius = float(np.linalg.norm(position))
    mu = directions @ (position / radius)
    hidden = -np.sqrt(max(1 - (columns.radius / radius) ** 2, 0.0))
    seen = (square <= 1) & (directions @ optics.disk_axis > 0) & (mu >= hidden)
    light[seen] = shine(table, position, square[seen], mu[seen])
    return light


def shine(table: SceneTable, position: Array, square: Array, mu: Array) -> Array:
    """Radiance of points of the Sun's disk, dimmed by the atmosphere, as seen from one position.

    Parameters
    ----------
    table : SceneTable
    position : (3,)
        From the planet's centre [m].
    square : (point,)
        Squared distance from the middle of the disk, as a share of its radius.
    mu : (point,)
        Cosine of the zenith angle; the planet is not in the way.

    Returns
    -------
    ndarray, shape (point, wavelength)
        [W m-2 sr-1 nm-1].
    """
    rings = table.optics.disk_radiance
    ring = np.clip(square, 0.0, 1.0) * (len(rings) - 1)
    k = np.minimum(ring.astype(int), len(rings) - 2)
    w = (ring - k)[:, None]
    return np.asarray(((1 - w) * rings[k] + w * rings[k + 1]) * np.exp(-_depths(table, position, mu)))


def _depths(table: SceneTable, position: Array, mu: Array) -> Array:
    """Optical depths towards zenith cosines that differ little, shape (point, wavelength)."""
    columns = table.columns
    radius = float(np.linalg.norm(position))
    if not mu.size:
        return np.zeros((0, table.optics.albedo.size))
    hidden = -np.sqrt(max(1 - (columns.radius / radius) ** 2, 0.0))
    low = max(float(mu.min()), float(hidden) + 1e-12)
    steps = np.linspace(low, max(float(mu.max()), low), DISK_STEPS)
    known = np.array([slant_columns(columns, radius - columns.radius, float(cosine)) for cosine in steps])
    along = np.stack([np.interp(mu, steps, column) for column in known.T], axis=1)
    return np.asarray(along @ table.optics.sigma_t)
