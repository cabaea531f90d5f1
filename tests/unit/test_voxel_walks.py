"""Walks through voxels: light of many scatterings beside the solver `path`, derivatives beside its own, and seeds."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from significance import assert_agrees

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.inversion import differentiate
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame
from skyscatter.inversion.voxelwalks import BATCHES, multiple_scattering
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]
FRAME = VoxelFrame.cube(6, 1.0)
WAVELENGTHS = (450.0, 650.0)
ORIGINS = np.array([[x, y, 10.0] for x in (-0.4, 0.1, 0.5) for y in (-0.3, 0.3)])
DIRECTIONS = np.broadcast_to([0.0, 0.0, -1.0], ORIGINS.shape)
WEIGHTS = np.linspace(0.5, 1.5, 12).reshape(6, 2)


@cache
def cloud() -> Array:
    """Two components, lumpy."""
    far = np.linalg.norm(FRAME.middles(), axis=-1)
    return np.exp(-2 * far**2) * (0.5 + np.random.default_rng(1).random((2, *FRAME.shape)))


def scene(density: Array) -> skyscatter.SpaceScene:
    """A mixture beside a star: one component scatters forward, and both more in the blue."""
    components = []
    for name, values, g, albedo in zip("ab", density, (0.5, 0.0), (0.8, 0.5), strict=True):
        extinction = SpectralTable(wavelengths=(400.0, 700.0), values=(3.0, 1.5))
        optics = Particles(extinction=extinction, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
        components.append(skyscatter.Component(name=name, density=FRAME.grid(values), optics=optics))
    star = skyscatter.PointStar(position=(1.5, 0.2, 0.1), spectrum=SpectralTable(wavelengths=(500.0,), values=(1.0,)))
    return skyscatter.SpaceScene(
        medium=skyscatter.Medium(components=tuple(components)), stars=(star,), view=skyscatter.View(distance=50.0)
    )


def model(**more: Any) -> VoxelModel:
    return VoxelModel.from_scene(scene(cloud()), WAVELENGTHS, **({"step": 0.2, "fine": 2} | more))


@pytest.mark.slow
def test_light_is_that_of_path() -> None:
    found = multiple_scattering(model(), cloud(), ORIGINS, DIRECTIONS, samples=20_000, seed=3)
    expected = skyscatter.radiance(
        scene(cloud()), ORIGINS, DIRECTIONS, WAVELENGTHS, solver=skyscatter.Path(samples=16384), parts=True
    )
    error = np.hypot(found.light_error, expected.standard_error)
    # Eight batches and sixteen; steps of a fifth of a cell miss 0.5 % of the light at most.
    assert_agrees(found.light, expected.layers["multiple"], error, freedom=BATCHES - 1, slack=0.005)
    assert np.median(found.light_error / found.light) < 0.02
    assert not found.density.any()


@pytest.mark.slow
def test_derivatives_are_those_of_path() -> None:
    """Along directions in the space of densities: one component as a whole, and noise."""
    noise = np.random.default_rng(2).standard_normal(cloud().shape) * cloud()
    ways = np.stack([cloud() * np.array([1.0, 0.0])[:, None, None, None], noise])

    def moved(theta: Array) -> skyscatter.SpaceScene:
        return scene(cloud() + np.tensordot(theta, ways, 1))

    rays = ORIGINS, DIRECTIONS, WAVELENGTHS
    walked = differentiate(moved, [0.0, 0.0], [1e-3, 1e-3], *rays, solver=skyscatter.Path(samples=16384))
    once = differentiate(moved, [0.0, 0.0], [1e-3, 1e-3], *rays, solver="single")
    expected = np.sum(WEIGHTS * (walked.jacobian - once.jacobian), axis=(1, 2))
    noise_of_it = np.sqrt(np.sum((WEIGHTS * walked.jacobian_error) ** 2, axis=(1, 2)))
    runs = np.array([
        [np.sum(multiple_scattering(model(), cloud(), ORIGINS, DIRECTIONS, WEIGHTS, samples=400, seed=k).density * way)
         for way in ways]
        for k in range(24)
    ])  # fmt: skip
    error = np.hypot(runs.std(axis=0, ddof=1) / np.sqrt(len(runs)), noise_of_it)
    assert_agrees(runs.mean(axis=0), expected, error, freedom=len(runs) - 1, slack=0.005)
    assert error[0] < 0.03 * abs(expected[0])


@pytest.mark.slow
def test_a_little_more_where_there_is_nothing() -> None:
    """Walks go through empty places too: what scattering there would bring is all of their derivative."""
    filled = cloud() * (FRAME.middles()[..., 0] > 0)
    empty = np.where(filled > 0, 0.0, 1.0) * np.array([1.0, 0.0])[:, None, None, None]

    def moved(theta: Array) -> skyscatter.SpaceScene:
        return scene(filled + theta[0] * empty)

    # Densities are never negative: the derivative a little above zero, where second orders are 0.2 % of it.
    rays, at = (ORIGINS, DIRECTIONS, WAVELENGTHS), ([2e-3], [1e-3])
    walked = differentiate(moved, *at, *rays, solver=skyscatter.Path(samples=65536))
    once = differentiate(moved, *at, *rays, solver="single")
    expected = np.sum(WEIGHTS * (walked.jacobian - once.jacobian))
    noise_of_it = np.sqrt(np.sum((WEIGHTS * walked.jacobian_error) ** 2))
    runs = np.array([
        np.sum(empty * multiple_scattering(model(), filled, ORIGINS, DIRECTIONS, WEIGHTS, samples=2000, seed=k).density)
        for k in range(16)
    ])  # fmt: skip
    error = np.hypot(runs.std(ddof=1) / np.sqrt(len(runs)), noise_of_it)
    assert_agrees(runs.mean(), expected, error, freedom=len(runs) - 1, slack=0.01)
    assert error < 0.05 * abs(expected)


def test_every_voxel_is_within_its_error() -> None:
    """Two runs of other seeds: differences over their errors are as wide as errors of eight batches make them."""
    one, two = (
        multiple_scattering(model(), cloud(), ORIGINS, DIRECTIONS, WEIGHTS, samples=800, seed=k) for k in (1, 2)
    )
    z = (one.density - two.density) / np.hypot(one.density_error, two.density_error)
    # Student's t of 14 degrees of freedom has the variance 14 / 12; 432 voxels, whose neighbours share walks.
    assert np.mean(z**2) == pytest.approx(14 / 12, rel=0.3)
    assert np.all(one.density_error > 0)


def test_same_seed_same_numbers_whatever_the_threads() -> None:
    one, two = (
        multiple_scattering(model(threads=n), cloud(), ORIGINS, DIRECTIONS, WEIGHTS, samples=64, seed=9) for n in (1, 2)
    )
    for name in ("light", "density", "density_error"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_an_empty_grid_scatters_nothing() -> None:
    found = multiple_scattering(model(), 0 * cloud(), ORIGINS, DIRECTIONS, WEIGHTS, samples=8)
    assert not found.light.any()
    assert not found.density.any()


@pytest.mark.parametrize(("name", "more"), [("samples", {"samples": 4}), ("weights", {"weights": np.ones((5, 2))})])
def test_bad_input(name: str, more: dict[str, Any]) -> None:
    with pytest.raises(DomainError, match=name):
        multiple_scattering(model(), cloud(), ORIGINS, DIRECTIONS, **more)
