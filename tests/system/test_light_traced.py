"""Walks in a cloud with a star inside, against light that is traced the other way."""

from __future__ import annotations

import numpy as np
import pytest
from light_traced import Lump, traced
from significance import assert_agrees

import skyscatter
from skyscatter import Component, Medium
from skyscatter.lights import PointStar
from skyscatter.media.voxels import VoxelGrid
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

WAVELENGTH, DISTANCE = 700.0, 100.0
RING = 0.002, 0.008  # about the star, seen from there [rad]
POWER = 0.01  # relative error of the judge, by the quick test
FLAT = SpectralTable(wavelengths=(WAVELENGTH,), values=(1.0,))  # power 1


def lump(cells: int = 24) -> Lump:
    """Clumps, mostly thicker and thinner than usual by up to a factor of five; 0.6 to 1.6 deep through the middle."""
    random = np.random.default_rng(3)
    middles = (np.arange(cells) + 0.5) / cells * 2 - 1
    squared = middles[:, None, None] ** 2 + middles[:, None] ** 2 + middles**2
    waves = random.normal(size=(40, 3)) * 5
    phases = np.einsum("wk,kxyz->wxyz", waves, np.stack(np.meshgrid(middles, middles, middles, indexing="ij")))
    field = np.cos(phases + random.uniform(0, 2 * np.pi, 40)[:, None, None, None]).sum(axis=0) / np.sqrt(20)
    density = np.exp(field) * np.maximum(1 - squared, 0.0) ** 2
    return Lump(density / density.max(), 6.0, 0.8, 0.6, np.array([0.15, 0.2, 0.1]))


def scene(dust: Lump) -> SpaceScene:
    optics = Particles(
        extinction=dust.extinction, single_scattering_albedo=dust.albedo, phase=HenyeyGreenstein(g=dust.g)
    )
    field = VoxelGrid(values=dust.density, low=(-1, -1, -1), high=(1, 1, 1))
    return SpaceScene(
        medium=Medium(components=(Component(name="dust", density=field, optics=optics),)),
        stars=(PointStar(position=tuple(dust.star), spectrum=FLAT),), view=View(distance=DISTANCE),
    )  # fmt: skip


def ring_rays(eye: np.ndarray, star: np.ndarray, number: int) -> np.ndarray:
    """Directions in the ring, one by chance in each of number^2 parts of equal solid angle."""
    random = np.random.default_rng(5)
    low, high = np.cos(RING[1]), np.cos(RING[0])
    part = (np.indices((number, number)).reshape(2, -1) + random.random((2, number * number))) / number
    cosine, azimuth = low + (high - low) * part[0], 2 * np.pi * part[1]
    middle = (star - eye) / np.linalg.norm(star - eye)
    side = np.cross(middle, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    across = np.cos(azimuth)[:, None] * side + np.sin(azimuth)[:, None] * np.cross(middle, side)
    return cosine[:, None] * middle + np.sqrt(1 - cosine**2)[:, None] * across


@pytest.mark.parametrize(
    ("photons", "number"), [(60_000, 32), pytest.param(2_000_000, 128, marks=pytest.mark.slow)], ids=["quick", "slow"]
)
def test_walks_see_what_light_traced_from_the_star_brings(photons: int, number: int) -> None:
    """Light scattered once and the rest, in the mean over a ring around the star."""
    dust = lump()
    there = scene(dust)
    eye = np.asarray(there.view.position, float)
    runs = np.array([traced(dust, eye, RING, photons, seed) for seed in range(8)])
    directions = ring_rays(eye, dust.star, number)
    origins = np.broadcast_to(eye, directions.shape).copy()
    found = skyscatter.radiance(there, origins, directions, [WAVELENGTH], solver=skyscatter.Path(samples=64), orders=1)
    once = found.layers["order1"][:, 0]
    rest = found.radiance[:, 0] - once
    for judged, light in zip(runs.T, (once, rest), strict=True):
        error = judged.std(ddof=1) / np.sqrt(len(judged))
        assert error < POWER * light.mean() * np.sqrt(60_000 / photons)
        # What one ray by chance in each part leaves of the mean's error: neighbours differ by no less, walks included.
        of_rays = np.diff(light).std() / np.sqrt(2 * len(light))
        assert_agrees(judged.mean(), light.mean(), np.hypot(error, of_rays), freedom=len(judged) - 1)
