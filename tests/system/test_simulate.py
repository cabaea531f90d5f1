"""Simulated satellite images: every pixel against the solver `path` over the same map, and against closed forms."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from bases import complaint
from significance import assert_agrees

import skyscatter
from skyscatter import Component, Ground, GroundMap, Medium, Scene, SpectralTable, Sun
from skyscatter.dehaze.simulate import SimulatedImage, simulate
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw

RADIUS, CELL, SIZE = 6371e3, 400.0, (6, 8)
WAVELENGTHS = np.array([450.0, 650.0, 850.0])
VIEW = {"view_zenith_deg": 25.0, "view_azimuth_deg": 70.0}


@cache
def painted(depth: float = 0.4) -> Scene:
    """Haze over a map of 10 by 14 cells with black, green and bright ones, in grey surroundings."""
    leaves = SpectralTable(wavelengths=(450.0, 650.0, 850.0), values=(0.03, 0.05, 0.5))
    classes = np.random.default_rng(8).integers(0, 3, (10, 14))
    picture = GroundMap(classes=classes, albedos=(0.0, leaves, 0.8), cell_size=CELL)
    air = Component(
        name="air",
        density=Exponential(scale_height=8e3, top=80e3),
        optics=RayleighPowerLaw(coefficient=0.25 * depth / 8e3, wavelength=550.0),
    )
    haze = Component(
        name="haze",
        density=Exponential(scale_height=1.5e3, top=20e3),
        optics=Particles(optical_depth=depth, single_scattering_albedo=0.95, phase=HenyeyGreenstein(g=0.7)),
    )
    return Scene(
        medium=Medium(planet_radius=RADIUS, components=(air, haze)),
        ground=Ground(albedo=0.2, map=picture),
        sun=Sun(elevation_deg=50.0, azimuth_deg=200.0),
    )


@cache
def image(depth: float = 0.4, walks: int = 1 << 14, stokes: bool = False) -> SimulatedImage:
    return simulate(painted(depth), WAVELENGTHS, SIZE, walks=walks, stokes=stokes, **VIEW)


def pixel_rays() -> tuple[Any, Any]:
    """Rays of the solver's own to the middles of the pixels' cells."""
    x = (np.arange(SIZE[1]) - SIZE[1] / 2 + 0.5) * CELL
    y = (SIZE[0] / 2 - np.arange(SIZE[0]) - 0.5) * CELL
    x, y = np.meshgrid(x, y)
    ground = np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2)], axis=-1)
    theta, phi = (math.radians(angle) for angle in VIEW.values())
    up = np.array([math.sin(theta) * math.sin(phi), math.sin(theta) * math.cos(phi), math.cos(theta)])
    return ground + 300e3 * up, np.broadcast_to(-up, ground.shape)


@pytest.mark.parametrize("stokes", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_pixel_is_what_path_sees_there(stokes: bool) -> None:
    scene, result = painted(), image(stokes=stokes)
    answer = skyscatter.radiance(scene, *pixel_rays(), WAVELENGTHS, solver=skyscatter.Path(samples=512), stokes=stokes)
    scale = np.pi / (scene.star.irradiance(WAVELENGTHS, scene.star_distance) * scene.sun.direction[2])
    expected, error = (np.moveaxis(a * scale, -1, 0) for a in (answer.radiance, answer.standard_error))
    # Pixels 1.6 km from the middle have the Sun and the sensor 0.015 degrees off: less than 1e-3 of any light.
    assert_agrees(result.reflectance, expected, np.hypot(result.standard_error, error), slack=1e-3)
    # Over all pixels chance averages out in `path`, and errors in the sums would not.
    mean, noise = expected.mean(axis=(1, 2)), np.sqrt((error**2).sum(axis=(1, 2))) / error[0].size
    shared = result.standard_error.mean(axis=(1, 2))
    assert_agrees(result.reflectance.mean(axis=(1, 2)), mean, np.hypot(noise, shared), slack=1e-3)


def test_without_air_the_image_is_the_surface() -> None:
    result = image(1e-9, 64)
    # The mean cosine over the Sun's disk is that of its middle but for a quarter of its squared radius, 5e-6.
    np.testing.assert_allclose(result.reflectance, result.surface, rtol=6e-6, atol=1e-8)
    assert result.surface.max() == pytest.approx(0.8)
    rows = painted().ground.map.classes.array[2:8, 3:11]
    np.testing.assert_allclose(result.surface[2], np.array([0.0, 0.5, 0.8])[rows.astype(int)], rtol=1e-12)


def test_same_seed_same_image() -> None:
    one, other = (simulate(painted(), WAVELENGTHS, SIZE, walks=64, seed=s, stokes=False) for s in (1, 2))
    again = simulate(painted(), WAVELENGTHS, SIZE, walks=64, seed=1, stokes=False)
    np.testing.assert_array_equal(one.reflectance, again.reflectance)
    assert not np.array_equal(one.reflectance, other.reflectance)


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"ground": Ground()}, {}, ["ground.map", "GroundMap"]),
        ({"sun": Sun(elevation_deg=0.0)}, {}, ["sun_elevation_deg = 0.0", "above the horizon"]),
        ({"background": 1.0}, {}, ["background", "sunlight only"]),
        ({}, {"size": (11, 8)}, ["size = (11, 8)", "(10, 14)"]),
        ({}, {"view_zenith_deg": 90.0}, ["view_zenith_deg = 90.0", "0 and 90"]),
        ({}, {"walks": 16}, ["walks = 16", "at least 32"]),
    ],
)
def test_refuses(changes: dict[str, Any], options: dict[str, Any], words: list[str]) -> None:
    scene = painted().model_copy(update=changes)
    message = complaint(lambda: simulate(scene, WAVELENGTHS, **{"size": SIZE, **options}))
    assert all(word in message for word in words), message
