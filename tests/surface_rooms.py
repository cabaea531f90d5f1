"""Rooms as scenes of surfaces, from the same pieces that the judges take; rays; and averages over rays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from plain_rooms import Fog
from radiosity import Piece

import skyscatter
from skyscatter.media.everywhere import Everywhere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Rectangle

Array = NDArray[np.float64]


def table(wavelengths: Any, values: Any) -> SpectralTable:
    """A spectrum by its values at the wavelengths that are asked for."""
    return SpectralTable(wavelengths=tuple(map(float, wavelengths)), values=tuple(map(float, values)))


def fog_medium(name: str, fog: Fog | Particles | None, **more: Any) -> SurfaceMedium:
    """A medium that is the same everywhere; a vacuum for None."""
    if fog is None:
        return SurfaceMedium(name=name, **more)
    if isinstance(fog, Fog):
        phase: Any = HenyeyGreenstein(g=fog.g) if fog.g else Isotropic()
        fog = Particles(extinction=fog.extinction, single_scattering_albedo=fog.albedo, phase=phase)
    component = skyscatter.Component(name="fog", density=Everywhere(), optics=fog)
    return SurfaceMedium(name=name, components=(component,), **more)


def room_scene(pieces: tuple[Piece, ...], wavelengths: Any, fog: Fog | Particles | None = None) -> SurfaceScene:
    """The scene of a room: one rectangle for each piece, its normal into the room."""
    bodies = []
    for number, piece in enumerate(pieces):
        corner, first, second = np.zeros(3), np.zeros(3), np.zeros(3)
        u, v = (k for k in range(3) if k != piece.axis)
        corner[[piece.axis, u, v]] = piece.at, *piece.low
        first[u], second[v] = np.subtract(piece.high, piece.low)
        if np.cross(first, second)[piece.axis] * piece.facing < 0:
            first, second = second, first
        shape = Rectangle(corner=tuple(corner), first_edge=tuple(first), second_edge=tuple(second))
        lamp = AreaLamp(radiance=table(wavelengths, piece.exitance / np.pi)) if np.any(piece.exitance) else None
        material = Lambert(albedo=table(wavelengths, piece.albedo))
        bodies.append(Body(name=f"wall {number}", shape=shape, material=material, lamp=lamp))
    viewpoint = Viewpoint(position=(1.0, 1.0, 1.0), target=(1.5, 1.3, 1.0))
    return SurfaceScene(media=(fog_medium("air", fog),), bodies=tuple(bodies), viewpoint=viewpoint)


def rays_around(origin: tuple[float, float, float], count: int, seed: int = 1) -> tuple[Array, Array]:
    """Rays (count, 3) from a point into all directions, evenly by chance."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return np.tile(np.asarray(origin, float), (count, 1)), directions


def mean_ratio(value: Array, expected: Array, error: Array) -> tuple[Array, Array]:
    """Mean over rays of `value` over that of what is expected, (wavelength,), and its standard error."""
    whole = expected.sum(axis=0)
    return value.sum(axis=0) / whole, np.sqrt((error**2).sum(axis=0)) / whole
