"""What is asked of any work with rays, looked at before it begins: wavelengths, rays and threads."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errors import DomainError
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.units import WAVELENGTHS
from skyscatter.workers import processors

if TYPE_CHECKING:
    from skyscatter.space import SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene

    AnyScene = Scene | SpaceScene | SurfaceScene


def worker_count(threads: int | None) -> int:
    """Threads to use: those that were asked for, or all."""
    if threads is None:
        return processors()
    if threads < 1:
        raise DomainError("threads", threads, "at least 1")
    return threads


def is_space(scene: AnyScene) -> TypeGuard[SpaceScene]:
    """Whether a scene is one of space, without loading what such scenes are made of."""
    return hasattr(scene, "star_field")


def check_wavelengths(wavelengths: ArrayLike) -> Array:
    """Vacuum wavelengths [nm] as a rising one-dimensional array; Quantities are converted."""
    if hasattr(wavelengths, "to_value"):
        wavelengths = wavelengths.to_value("nm")
    wl = np.atleast_1d(np.asarray(wavelengths, float))
    if wl.ndim != 1 or wl.size == 0 or not (WAVELENGTHS[0] <= wl.min() and wl.max() <= WAVELENGTHS[1]):
        low, high = WAVELENGTHS
        raise DomainError("wavelengths", wavelengths, f"one or more positive numbers, {low:g} to {high:g} [nm]")
    if np.any(np.diff(wl) <= 0):
        raise DomainError("wavelengths", wavelengths, "must increase, none twice")
    return np.ascontiguousarray(wl)


def check_rays(scene: AnyScene, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Origins [m] and unit directions of one shape (..., 3), broadcast against each other."""
    if hasattr(origins, "to_value"):
        origins = origins.to_value("m")
    o, d = np.asarray(origins, float), np.asarray(directions, float)
    if o.shape[-1:] != (3,) or d.shape[-1:] != (3,):
        raise DomainError("directions", d.shape, "origins and directions are arrays of shape (..., 3)")
    o, d = np.broadcast_arrays(o, d)
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    if d.size and not (np.all(np.isfinite(o)) and np.all(np.abs(length - 1) < 1e-6)):
        raise DomainError("directions", float(length.min()), "must be finite unit vectors; divide by their length")
    scene.check_origins(o)
    return o, d / length
