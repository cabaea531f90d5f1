"""Solver ``single`` for media of three dimensions: light of stars scattered once, by adaptive quadrature.

Light from outside and the medium's own are seen through what lies before them, and not scattered: that too is left to
``path``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.kernels.volume_single import make_single_scratch, volume_single_rays
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.options import SINGLE_TOLERANCE, Single
from skyscatter.solvers.volume import compile_volume

if TYPE_CHECKING:
    from skyscatter.kernels.volume import VolumeTable
    from skyscatter.space import SpaceScene

DEFAULT_TOLERANCE = SINGLE_TOLERANCE


def check(asked: Asked[Single]) -> None:
    """Refuse what only Monte Carlo can do, and polarisation."""
    asked.refuse("single", "orders")
    asked.refuse("single in three dimensions", "stokes")


def prepare(
    scene: SpaceScene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Any],
    threads: int,
    progress: Callable[[float], None] | None,
) -> VolumeTable:
    """The tables of a scene."""
    return compile_volume(scene, tuple(float(w) for w in wavelengths))


def without_lights(table: VolumeTable) -> VolumeTable:
    """The same tables in the dark: what shines by itself and from outside remains."""
    return table._replace(
        place=table.place[:0], distant=table.distant[:0], size=table.size[:0], power=table.power[:0],
        share=table.share[:0],
    )  # fmt: skip


def single_parts(table: VolumeTable, rays: Rays, tolerance: float) -> tuple[Array, Array]:
    """Light scattered once, and light not scattered at all, each of shape (ray, wavelength)."""
    components, wavelengths = table.sigma_s.shape
    scattered, direct = (np.empty((len(rays.origins), wavelengths)) for _ in range(2))
    scratch: Any = make_single_scratch(components, wavelengths)
    volume_single_rays(table, rays.origins, rays.directions, tolerance, scratch, scattered, direct)
    return scattered, direct


def solve(table: VolumeTable, rays: Rays, asked: Asked[Single]) -> Answer:
    """Radiance of single scattering, see `skyscatter.radiance`."""
    scattered, direct = single_parts(table, rays, asked.how.tolerance or DEFAULT_TOLERANCE)
    layers = {"direct": direct, "scattered": scattered} if asked.parts else {}
    radiance = scattered + direct
    return Answer(radiance, np.zeros_like(radiance), layers, np.zeros(len(radiance), np.int64))
