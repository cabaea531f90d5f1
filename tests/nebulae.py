"""Scenes in space that several tests share, and what their rays should see."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from asking import asked
from numpy.typing import NDArray

from skyscatter.lights import PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.shapes import Sphere
from skyscatter.models.files import load_model
from skyscatter.models.nebula import NebulaModel
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.solvers.base import Answer
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]

#: A star that sends out 1 W nm-1 at every wavelength.
GREY = SpectralTable(wavelengths=(500.0,), values=(1.0,))
WAVELENGTH = (550.0,)
#: Those that come along.
SHIPPED = (
    "dark-globule", "dusty-disk", "hii-region", "reflection-nebula", "ring-nebula", "star-in-dust", "turbulent-pillar"
)  # fmt: skip


@lru_cache(maxsize=6)
def coarse(name: str, cells: int, steps: float) -> NebulaModel:
    """A shipped nebula with so many voxels along a side, and directions that are `steps` times as far apart."""

    def coarser(content: Any) -> Any:
        if isinstance(content, dict):
            small = {"cells": cells, "resolution_deg": steps * content.get("resolution_deg", 0.0), "tolerance": 1e-2}
            return {key: small.get(key) or coarser(value) for key, value in content.items()}
        return [coarser(value) for value in content] if isinstance(content, (list, tuple)) else content

    return NebulaModel.model_validate(coarser(load_model(name).model_dump(mode="json", exclude_none=True)))


def dust(extinction: Any, albedo: Any, g: float = 0.0, **more: Any) -> Particles:
    """Grains by numbers; extinction [m-1] where the density is 1."""
    phase = HenyeyGreenstein(g=g) if g else Isotropic()
    return Particles(extinction=extinction, single_scattering_albedo=albedo, phase=phase, **more)


def flat(value: float) -> SpectralTable:
    """A spectrum that is the same everywhere."""
    return SpectralTable(wavelengths=(500.0,), values=(value,))


def component(density: Any, extinction: Any, albedo: Any = 0.6, g: float = 0.0, **more: Any) -> Component:
    """Dust in a density field; see `dust`."""
    return Component(**{"name": "dust", "density": density, "optics": dust(extinction, albedo, g), **more})


def dusty_sphere(tau: float, albedo: float = 0.6, g: float = 0.0, **scene: Any) -> SpaceScene:
    """Uniform sphere of radius 1 m and optical depth `tau` from the centre, where a star of 1 W nm-1 shines.

    Keyword arguments replace those of the scene.
    """
    medium = Medium(components=(component(Sphere(radius=1.0), tau, albedo, g),))
    given: dict[str, Any] = {"stars": (PointStar(spectrum=GREY),), "view": View(distance=100.0)}
    return SpaceScene(**({"medium": medium} | given | scene))


def parallel_rays(offsets: Array, distance: float = 10.0) -> tuple[Array, Array]:
    """Origins and directions (n, 3) of rays that come along -z, at distances `offsets` from the z axis."""
    origins = np.stack([offsets, np.zeros_like(offsets), np.full_like(offsets, distance)], axis=1)
    return origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape)


def lines_through(
    rng: np.random.Generator, count: int, radius: float = 2.0, spread: float = 0.5
) -> tuple[Array, Array]:
    """Origins on a sphere around the origin and directions to points near its middle, both (count, 3)."""
    origins = rng.normal(size=(count, 3))
    origins *= radius / np.linalg.norm(origins, axis=1)[:, None]
    directions = rng.normal(size=(count, 3)) * spread - origins
    return origins, directions / np.linalg.norm(directions, axis=1)[:, None]


def escaping_luminosity(scene: SpaceScene, rays: int, *, seed: int = 1, **options: Any) -> tuple[Array, Array, Answer]:
    """Scattered luminosity [W nm-1] (wavelength,) that leaves a round scene of radius 1 m, its error, and the answer.

    All directions are alike, so it is 4 pi times the integral of the radiance over one disk, with the offset from the
    centre drawn once in each of `rays` equal intervals.  The strata make the error of the integral over the offset,
    of order 1 / rays^1.5, small beside that of the walks.
    """
    rng = np.random.default_rng(seed)
    b = (np.arange(rays) + rng.random(rays)) / rays
    answer = radiance(scene, *parallel_rays(b), WAVELENGTH, parts=True, **asked("path", **options))
    weight = 4 * np.pi * 2 * np.pi * b[:, None] / rays
    scattered = answer.radiance - answer.layers["direct"]
    return (weight * scattered).sum(axis=0), np.sqrt(((weight * answer.standard_error) ** 2).sum(axis=0)), answer
