"""Small scenes of surfaces for tests of walks."""

from __future__ import annotations

from typing import Any

import numpy as np
from asking import asked
from numpy.typing import NDArray

import skyscatter
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium
from skyscatter.surfaces.shapes import Rectangle

Array = NDArray[np.float64]

#: Wavelengths [nm] of most tests: three, so that every wavelength has heroes beside its own.
WAVELENGTHS = np.array([450.0, 550.0, 650.0])


def spectrum(*values: float) -> SpectralTable:
    """Values at `WAVELENGTHS`."""
    return SpectralTable(wavelengths=tuple(WAVELENGTHS), values=tuple(map(float, values)))


def fog(extinction: Any, albedo: Any = 1.0, g: float = 0.0, where: Any = None, **more: Any) -> skyscatter.Component:
    """A component, everywhere if not told where."""
    optics = Particles(extinction=extinction, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
    return skyscatter.Component(name="fog", density=where or Everywhere(), optics=optics, **more)


def medium(name: str, *components: skyscatter.Component, **more: Any) -> SurfaceMedium:
    """A medium."""
    return SurfaceMedium(name=name, components=components, **more)


def room(half: float, albedo: Any, radiance: Any = None) -> list[Body]:
    """A cube of six diffuse rectangles that look inwards, with so long half sides; all of them shine, or none."""
    bodies = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal, middle = np.zeros(3), np.zeros(3)
            normal[axis], middle[axis] = -side, side * half
            shape = Rectangle(position=tuple(middle), normal=tuple(normal), size=(2 * half, 2 * half))
            lamp = None if radiance is None else AreaLamp(radiance=radiance)
            bodies.append(Body(name=f"wall {axis} {side:g}", shape=shape, material=Lambert(albedo=albedo), lamp=lamp))
    return bodies


def directions(count: int, seed: int = 3) -> Array:
    """Unit vectors (count, 3) in all directions."""
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def look(scene: Any, origin: Any, towards: Any, **options: Any) -> skyscatter.Answer:
    """Radiance at `WAVELENGTHS` by walks."""
    return skyscatter.radiance(scene, origin, towards, WAVELENGTHS, **asked("path", **options))
