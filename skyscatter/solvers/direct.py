"""Sunlight that comes straight through the atmosphere."""

from __future__ import annotations

import numpy as np

from skyscatter.solvers.base import Array
from skyscatter.solvers.kernels.lookup import ColumnTable, outward_columns
from skyscatter.solvers.kernels.optics import SceneTable

#: Zenith cosines over which columns are tabulated across the disk, where they change by little.
DISK_STEPS = 65


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
    light = np.zeros((len(directions), optics.background.size))
    if optics.disk_radius <= 0:
        return light
    sine = np.linalg.norm(np.cross(directions, optics.disk_axis), axis=1)
    square = (sine / np.sin(optics.disk_radius)) ** 2
    inside = (square <= 1) & (directions @ optics.disk_axis > 0)
    if not inside.any():
        return light
    radius = float(np.linalg.norm(position))
    mu = directions[inside] @ (position / radius)
    hidden = -np.sqrt(max(1 - (columns.radius / radius) ** 2, 0.0))
    steps = np.linspace(max(mu.min(), hidden + 1e-9), max(mu.max(), hidden + 2e-9), DISK_STEPS)
    through = np.zeros((DISK_STEPS, optics.background.size))
    for k, cosine in enumerate(steps):
        column = slant_columns(columns, radius - columns.radius, float(cosine))
        if column is not None:
            through[k] = np.exp(-column @ optics.sigma_t)
    ring = square[inside] * (len(optics.disk_radiance) - 1)
    k = np.minimum(ring.astype(int), len(optics.disk_radiance) - 2)
    w = (ring - k)[:, None]
    radiance = (1 - w) * optics.disk_radiance[k] + w * optics.disk_radiance[k + 1]
    place = np.maximum(mu - steps[0], 0.0) / max(steps[-1] - steps[0], 1e-300) * (DISK_STEPS - 1)
    j = np.minimum(place.astype(int), DISK_STEPS - 2)
    v = (place - j)[:, None]
    light[inside] = radiance * ((1 - v) * through[j] + v * through[j + 1]) * (mu >= hidden)[:, None]
    return light
