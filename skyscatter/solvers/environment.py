"""Light from all around by a picture: its radiance on nodes over elevation and azimuth."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.camera import Panorama
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.surfaces.lamps import Environment

Array = NDArray[np.float64]

#: Most rows and columns of nodes, and points along a side of the cell around each, over which the picture is averaged.
MOST_ROWS, MOST_COLUMNS, FINER = 361, 720, 3
#: Share of the directions aimed at a picture that do not ask how bright it is there.
BLIND = 0.1


@lru_cache(maxsize=4)
def environment(lamp: Environment, wavelengths: tuple[float, ...]) -> Array:
    """Radiance of a lamp at nodes, (row, column, wavelength), as `LampTable.around` has it.

    Raises
    ------
    DomainError
        For a picture that does not show the whole sphere, has gaps, or lacks wavelengths.
    """
    from skyscatter.image.spectral import SpectralImage

    image = SpectralImage.load(lamp.file)
    camera = panorama_of(image, lamp.file)
    have, wl = np.asarray(image.wavelengths, float), np.array(wavelengths)
    if wl[0] < have[0] - 1e-9 or wl[-1] > have[-1] + 1e-9:
        rule = f"is outside of the picture's {have[0]:g} to {have[-1]:g} nm; render it with more wavelengths"
        raise DomainError(f"{lamp.file}, wavelengths", f"{wl[0]:g} to {wl[-1]:g} nm", rule)
    radiance = np.asarray(image.radiance, float)
    if not np.isfinite(radiance).all() or radiance.min() < 0:
        raise DomainError("file", lamp.file, "has pixels without light of their own; give a whole picture")
    rows, columns = min(camera.height, MOST_ROWS - 1) + 1, min(camera.width, MOST_COLUMNS)
    inner = (np.arange(FINER) + 0.5) / FINER - 0.5
    elevation = ((np.arange(rows)[:, None] + inner).ravel() / (rows - 1) - 0.5).clip(-0.5, 0.5) * 180.0
    azimuth = 360.0 * (np.arange(columns)[:, None] + inner).ravel() / columns - lamp.turn_deg
    d = direction_from_azimuth_elevation(azimuth[None, :], elevation[:, None])
    x, y = camera.pixel(d)
    column = np.rint(x).astype(np.int64) % camera.width
    row = np.rint(y).astype(np.int64).clip(0, camera.height - 1)
    weight = np.cos(np.radians(elevation)).clip(1e-9).reshape(rows, FINER, 1, 1)
    mean = np.empty((rows, columns, have.size))
    for k in range(have.size):
        light = radiance[row, column, k].reshape(rows, FINER, columns, FINER)
        mean[..., k] = (light * weight).sum(axis=1).mean(axis=2) / weight.sum(axis=(1, 2, 3))[:, None]
    share = np.interp(wl, have, np.arange(have.size))
    low = np.minimum(share.astype(np.int64), max(have.size - 2, 0))
    high = np.minimum(low + 1, have.size - 1)
    part = share - low
    return np.ascontiguousarray(lamp.factor * ((1 - part) * mean[..., low] + part * mean[..., high]))


def panorama_of(image: Any, file: str) -> Panorama:
    """The camera of a picture of the whole sphere; where it says nothing, south is in its middle."""
    height, width = image.shape[:2]
    told = (image.recipe or {}).get("camera")
    camera = Panorama(width=width, height=height) if told is None else None
    if told is not None and told.get("kind") == "panorama":
        camera = Panorama.model_validate(told)
    if camera is None or camera.elevation_max_deg - camera.elevation_min_deg < 180 or camera.fov_deg < 360:
        raise DomainError("file", file, "does not show the whole sphere; make it with --view panorama")
    return camera


def sphere_mean(around: Array) -> Array:
    """Mean over all directions of a map (row, column, wavelength)."""
    weight = row_weights(len(around))
    return np.asarray(weight @ around.mean(axis=1) / weight.sum())


def row_weights(rows: int) -> Array:
    """Solid angles of rows that are even in the elevation, [4 pi sr]."""
    edges = np.pi * ((np.arange(rows + 1) - 0.5).clip(0, rows - 1) / (rows - 1) - 0.5)
    return np.diff(np.sin(edges)) / 2


def cell_cdf(around: Array) -> Array:
    """Chances (cell,), summed up, to aim at the cells between nodes: by their light, a share of them by their size."""
    light = around.mean(axis=2)
    light = light[1:] + light[:-1]
    light = light + np.roll(light, -1, axis=1)
    size = np.diff(np.sin(np.pi * (np.linspace(0, 1, len(around)) - 0.5)))[:, None] * np.ones_like(light)
    mean = float((light * size).sum() / size.sum())
    cdf = np.cumsum((size * ((1 - BLIND) * light + BLIND * max(mean, 1e-300))).ravel())
    cdf /= cdf[-1]
    cdf[-1] = 1.0
    return cdf
