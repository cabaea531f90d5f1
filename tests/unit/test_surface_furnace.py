"""Shapes and materials together: a furnace in which smooth glass cannot be seen, and index squared inside of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from surface_bases import shoot, sphere_points

from skyscatter.kernels.codes.surfaces import DELTA, TRANSMITTED
from skyscatter.kernels.surfaces import bsdf
from skyscatter.surfaces.materials import Dielectric, Mirror
from skyscatter.surfaces.packing import pack_materials, pack_shapes, starting_stack
from skyscatter.surfaces.shapes import Box, Sphere

Array = NDArray[np.float64]


class Furnace:
    """Bodies of glass and water in a radiance of 1 from everywhere; whoever walks keeps the list of media by hand."""

    def __init__(self, bodies: list[tuple[Any, int, int]], materials: list[Any], index: list[float]) -> None:
        self.index = np.array(index)
        self.shapes = pack_shapes([(shape, material, inside, -1) for shape, material, inside in bodies], materials)
        self.materials = pack_materials(materials, [550.0])

    def radiance(self, x: Array, d: Array, seed: int) -> float:
        """Of one walk; zero if it is caught by total reflection."""
        inside = [m for m in starting_stack(self.shapes, x) if m >= 0]
        numbers = np.random.default_rng(seed)
        weight, skip = 1.0, -1
        wi, value, chance, event = np.zeros((1, 3)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.int64)
        for _ in range(300):
            hit = shoot(self.shapes, x[None], d[None], skip=skip)
            if hit.item[0] < 0:
                assert inside == []
                return weight
            body, n = hit.item[0], hit.normal[0]
            medium = self.shapes.inside[body]
            here = inside[-1] if inside else 0
            beyond = [*inside, medium] if d @ n < 0 else [m for m in inside if m != medium]
            there = beyond[-1] if beyond else 0
            x, skip = x + hit.distance[0] * d, body
            bsdf.sample_bsdfs(
                self.materials, self.shapes.material[body], 0, n, -d, numbers.random((1, 3)), self.index[[here]],
                self.index[[there]], False, False, wi, value, chance, event,
            )  # fmt: skip
            if event[0] == TRANSMITTED + DELTA:
                inside = beyond
            d = wi[0].copy()
            weight *= value[0, 0] / chance[0, 0]
        return 0.0


@pytest.mark.parametrize("scale", [1e-6, 1.0, 6.4e6])
def test_index_squared_inside(scale: float) -> None:
    """In the middle of water in glass radiance is n^2 of the water; outside of all, with mirrors about, it is 1.

    Every walk has exactly that weight: what is reflected or refracted is drawn with its own probability.
    """
    glass = Sphere(position=(scale, 0.0, 0.0), radius=2 * scale)
    water = Sphere(position=(scale, 0.0, 0.0), radius=scale)
    mirror = Box(position=(-3 * scale, 0.0, 0.0), size=(scale, scale, scale), axis=(1.0, 1.0, 1.0))
    furnace = Furnace(
        [(glass, 0, 1), (water, 0, 2), (mirror, 1, -1)], [Dielectric(), Mirror()], [1.0, 1.5, 1.33]
    )  # fmt: skip
    directions = sphere_points(np.random.default_rng(2), 150)
    for k, d in enumerate(directions):
        inside = furnace.radiance(np.array([scale, 0.3 * scale, 0.0]), d, k)
        assert abs(inside - 1.33**2) < 1e-10
        origin = scale * (np.array([1.0, 0.0, 0.0]) - 5.5 * d)
        aside = d + 0.2 * directions[k - 1]
        outside = furnace.radiance(origin, aside / np.linalg.norm(aside), k)
        assert abs(outside - 1.0) < 1e-10
