"""Small scenes in space that several tests share."""

from __future__ import annotations

from typing import Any

from skyscatter.lights import PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.shapes import Sphere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable


def flat(value: float) -> SpectralTable:
    """A spectrum that is the same everywhere."""
    return SpectralTable(wavelengths=(500.0,), values=(value,))


def component(density: Any, depth: float, omega: float = 0.6, g: float = 0.0, **more: Any) -> Component:
    """Dust of an extinction per metre of unit density."""
    phase = HenyeyGreenstein(g=g) if g else Isotropic()
    optics = Particles(extinction=depth, single_scattering_albedo=omega, phase=phase)
    return Component(name=more.pop("name", "dust"), density=density, optics=optics, **more)


def dusty_sphere(depth: float, omega: float = 0.6, g: float = 0.0, **more: Any) -> SpaceScene:
    """Sphere of radius 1 m and an optical depth, with a star of 1 W nm-1 in its centre, seen from 100 m."""
    medium = Medium(components=(component(Sphere(radius=1.0), depth, omega, g),))
    usual = {"medium": medium, "stars": (PointStar(spectrum=flat(1.0)),), "view": View(distance=100.0)}
    return SpaceScene(**{**usual, **more})
