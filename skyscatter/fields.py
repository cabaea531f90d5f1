"""Density fields in three dimensions, all in one place: shapes, grids, particles, and what can be made of them.

Fields are records, ``fields.Sphere(radius="1 pc")``, and combine: ``a + b``, ``2 * a``, ``a * b``, ``a**2``,
``a.moved(...)``, ``a.rotated(...)``, ``a.scaled(...)``, ``a.carved_by(b)``, ``a.warped(...)``.

Examples
--------
Columns through the middle of a ball of density 1, of one of density 2, and of one with a hollow [pc].

>>> from skyscatter import fields
>>> ball, hole = fields.Sphere(radius="1 pc"), fields.Sphere(radius="0.5 pc")
>>> pc = 3.0857e16  # m
>>> start, end = [[0, 0, -2 * pc]], [[0, 0, 2 * pc]]
>>> [round(float(field.column(start, end)[0] / pc), 2) for field in (ball, 2 * ball, ball.carved_by(hole))]
[2.0, 4.0, 1.0]
"""

from __future__ import annotations

from skyscatter.media.everywhere import Everywhere
from skyscatter.media.filaments import Filament
from skyscatter.media.fronts import Front
from skyscatter.media.nebular import IonisedGas, IonisingSource, Sampled
from skyscatter.media.operations import Carved, Moved, Power, Product, Rotated, Scaled, Sum, Warped
from skyscatter.media.particles import ParticleSet
from skyscatter.media.planets import AroundPlanet
from skyscatter.media.shapes import (
    BonnorEbert,
    GaussianShell,
    GaussianSphere,
    King,
    Plummer,
    PowerLaw,
    Shell,
    Sphere,
)
from skyscatter.media.space import SpatialField
from skyscatter.media.structures import BipolarLobes, Box, Cone, FlaredDisk, Slab
from skyscatter.media.turbulence import Turbulence
from skyscatter.media.voxels import VoxelGrid

__all__ = [
    "AroundPlanet",
    "BipolarLobes",
    "BonnorEbert",
    "Box",
    "Carved",
    "Cone",
    "Everywhere",
    "Filament",
    "FlaredDisk",
    "Front",
    "GaussianShell",
    "GaussianSphere",
    "IonisedGas",
    "IonisingSource",
    "King",
    "Moved",
    "ParticleSet",
    "Plummer",
    "Power",
    "PowerLaw",
    "Product",
    "Rotated",
    "Sampled",
    "Scaled",
    "Shell",
    "Slab",
    "SpatialField",
    "Sphere",
    "Sum",
    "Turbulence",
    "VoxelGrid",
    "Warped",
]
