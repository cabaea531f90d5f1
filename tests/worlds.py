"""Skies that hold something, and rays through them, that several tests share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter.solvers import surface_path, world
from skyscatter.surfaces import Body, Box, Lambert, Mosaic

WAVELENGTHS = [450.0, 550.0, 650.0]
#: Out of sight and out of the way of all light, so that the sky stays as it is.
BURIED = Body(name="buried", shape=Box(position=(0, 0, "-10 km"), size=(1, 1, 1)), material=Lambert())
#: Azimuths and elevations [degree] of rays, none of which meets the Sun in the south.
RAYS = np.array(
    [
        [180, 75],
        [180, 45],
        [180, 12],
        [150, 30],
        [90, 60],
        [90, 20],
        [90, 5],
        [30, 30],
        [0, 80],
        [0, 20],
        [0, 4],
        [0, -30],
    ]
)


def directions(angles: Any = RAYS) -> Any:
    """Unit vectors (ray, 3)."""
    a, e = np.radians(np.asarray(angles, float)).T
    return np.stack([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)], axis=-1)


def sky(model: str, sun: float, altitude: float = 2.0, **held: Any) -> skyscatter.Scene:
    """A shipped sky, that may hold something."""
    whole: Any = skyscatter.load_model(model)
    return whole.model_copy(update=held).scene(sun_elevation_deg=sun, altitude=altitude)


def look(scene: skyscatter.Scene, solver: str = "path", d: Any = None, **options: Any) -> Any:
    """Light at the observer."""
    d = directions() if d is None else d
    return skyscatter.radiance(scene, scene.observer.position, d, WAVELENGTHS, **asked(solver, **options))


#: A box of 4 m in the north of the observer, its south face 10 m away.
HOUSE = Body(name="house", shape=Box(position=(0, 12, 2), size=(4, 4, 4)), material=Lambert(albedo=0.6))


def lead_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on walks are led neither around parallel light nor to the glitter on a sea."""
    monkeypatch.setattr(surface_path, "SUNWARD", 0.0)
    monkeypatch.setattr(world, "Sea", Mosaic)  # no ground is known as a sea: none is aimed at
