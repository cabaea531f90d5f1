"""Derivatives of radiances: closed forms, finite differences of separate solutions, other solvers, and seeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from asking import asked
from nebulae import GREY, WAVELENGTH, component, dusty_sphere, parallel_rays
from numpy.typing import NDArray
from significance import assert_agrees, largest_t

from skyscatter import Component, Ground, Medium, Scene, Sun, radiance
from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion.derivatives import RUNS, differentiate
from skyscatter.inversion.stack import stack
from skyscatter.lights import PointStar
from skyscatter.media.fields import Exponential
from skyscatter.media.shapes import Sphere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.scene import Star
from skyscatter.solvers.options import Orders, Path
from skyscatter.space import SpaceScene
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]
WAVELENGTHS = (450.0, 650.0)
RADIUS = 6371e3
NAMES = ("haze.weight", "haze.scale_height", "haze.g", "haze.albedo", "ground.albedo")
HAZY = np.array([1.0, 1500.0, 0.6, 0.9, 0.3])
STEPS = np.array([1e-3, 1.5, 1e-3, 1e-3, 1e-3])


def hazy(theta: Array) -> Scene:
    """Air and haze over a grey ground."""
    weight, height, g, albedo, ground = theta
    optics = Particles(extinction=1e-4, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g))
    air = Component(name="air", density=Exponential(scale_height=8000.0), optics=RayleighPowerLaw(coefficient=1.2e-5))
    haze = Component(name="haze", density=Exponential(scale_height=height), optics=optics, weight=weight)
    medium = Medium(components=(air, haze), planet_radius=RADIUS)
    return Scene(medium=medium, ground=Ground(albedo=ground), sun=Sun(elevation_deg=40.0))


def sky_rays() -> tuple[Array, Array]:
    directions = np.array([direction_from_azimuth_elevation(a, e) for a, e in ((90, 12), (180, 50), (0, 80))])
    return np.broadcast_to([0.0, 0.0, RADIUS], directions.shape), directions


def separately(scenes: Callable[[Array], Any], theta: Array, row: Array, *args: Any, **options: Any) -> Array:
    """The symmetric difference of two solutions that know nothing of each other."""
    plus, minus = (radiance(scenes(theta + s * row), *args, **asked(**options)).radiance for s in (1, -1))
    return (plus - minus) / (2 * np.abs(row).sum())


# Closed forms


def test_extinction_and_albedo_of_a_shell_that_only_absorbs() -> None:
    """Light from outside through a column: I = B exp(-w tau), dI/dw = -tau I; rounding is 1e-10 of the step."""

    def scene(theta: Array) -> Scene:
        gas = Particles(extinction=2e-5, single_scattering_albedo=0.0, phase=HenyeyGreenstein(g=0.0))
        shell = Component(name="gas", density=Exponential(scale_height=8000.0), optics=gas, weight=float(theta[0]))
        return Scene(
            medium=Medium(components=(shell,), planet_radius=RADIUS), background=2.0, sun=Sun(elevation_deg=-60.0)
        )

    found = differentiate(scene, [1.3], [1e-3], *sky_rays(), WAVELENGTHS, solver="single")
    tau = np.log(2.0 / found.value) / 1.3
    # Truncation of the difference: (tau step)^2 / 6 < 1e-6 at tau = 0.8.
    np.testing.assert_allclose(found.jacobian[0], -tau * found.value, rtol=1e-6)
    assert np.all(found.jacobian_error == 0)


def test_asymmetry_of_light_scattered_once() -> None:
    """One component: I is in proportion to p, so dI/dg = I dp/dg / p."""

    def scene(theta: Array) -> SpaceScene:
        return dusty_sphere(0.5, 0.7, float(theta[0]))

    g, offsets = 0.5, np.array([0.3, 0.8])
    found = differentiate(scene, [g], [1e-3], *parallel_rays(offsets), WAVELENGTH, solver="single")
    both = separately(scene, np.array([g]), np.array([1e-3]), *parallel_rays(offsets), WAVELENGTH, solver="single")
    np.testing.assert_allclose(found.jacobian[0], both, rtol=1e-9)

    def parallel(theta: Array) -> SpaceScene:
        from skyscatter.lights import ParallelLight

        light = ParallelLight(direction=(0.6, 0.0, 0.8), irradiance=1.0)
        return dusty_sphere(0.5, 0.7, float(theta[0]), stars=(), parallel=(light,))

    found = differentiate(parallel, [g], [1e-3], *parallel_rays(offsets), WAVELENGTH, solver="single")
    mu = -0.8 * -1.0 * -1.0  # light travels along -direction, and then along +z to the observer
    slope = -2 * g / (1 - g * g) - 3 * (g - mu) / (1 + g * g - 2 * g * mu)
    # Truncation: step^2 / 6 times the third derivative, some ten times the first here.
    np.testing.assert_allclose(found.jacobian[0], slope * found.value, rtol=1e-5)


def test_luminosity_counts_in_proportion_in_every_solver() -> None:
    def scene(theta: Array) -> SpaceScene:
        stars = tuple(PointStar(spectrum=flat(v), position=(0, 0, z)) for v, z in zip(theta, (0.0, 2.0), strict=True))
        return dusty_sphere(0.5, 0.7, 0.3, stars=stars)

    def flat(value: float) -> SpectralTable:
        return SpectralTable(wavelengths=GREY.wavelengths, values=(float(value),))

    for solver, more in (("single", {}), ("path", {"samples": 64})):
        found = differentiate(
            scene, [1.0, 3.0], [0.01, 0.01], *parallel_rays(np.array([0.4])), WAVELENGTH, **asked(solver, **more)
        )
        # Radiance is a sum over the stars, each in proportion to its luminosity.
        total = found.jacobian[0] + 3.0 * found.jacobian[1]
        np.testing.assert_allclose(total, found.value, rtol=1e-9)


# Against finite differences


@pytest.mark.slow
def test_against_finite_differences_with_a_step_study() -> None:
    """Differences of separate solutions miss by step^2 until their noise takes over."""
    rays, options = (*sky_rays(), WAVELENGTHS), {"solver": "single"}
    found = differentiate(hazy, HAZY, 0.03 * STEPS, *rays, **asked(**options))
    for number in range(4):
        scale = np.abs(found.jacobian[number]).max()
        miss = []
        for factor in (100.0, 10.0, 1.0):
            row = np.eye(len(HAZY))[number] * STEPS * factor
            miss.append(np.abs(separately(hazy, HAZY, row, *rays, **options) - found.jacobian[number]).max() / scale)
        assert miss[2] < 1e-5
        if miss[0] > 1e-4:  # a parameter that the light is not in proportion to
            assert miss[0] / miss[1] == pytest.approx(100.0, rel=0.2)
    # Light once scattered knows a ground below the horizon only.
    assert np.all(found.jacobian[4] == 0)


def test_stacked_values_are_those_of_the_scene() -> None:
    scenes = [hazy(HAZY), hazy(HAZY * [1.1, 1.2, 0.9, 0.8, 2.0])]
    together = stack(scenes, WAVELENGTHS)
    for solver, tolerance in (("single", 1e-7), ("orders", 5e-3)):
        answer = radiance(together.scene, *sky_rays(), together.channels.numbers, solver)
        for scene, values in zip(scenes, together.channels.split(answer.radiance), strict=True):
            # Columns are tabulated up to the higher of two tops; grids of `orders` are made for all copies together,
            # so that its own tolerance counts.
            np.testing.assert_allclose(
                values, radiance(scene, *sky_rays(), WAVELENGTHS, solver).radiance, rtol=tolerance
            )


# Monte Carlo


@pytest.mark.slow
def test_walks_against_the_deterministic_solution() -> None:
    """All orders of scattering: `path` within its standard errors of `orders`, for every parameter."""
    rays = (*sky_rays(), WAVELENGTHS)
    smooth = differentiate(hazy, HAZY, 3 * STEPS, *rays, solver=Orders(tolerance=0.002))
    walked = differentiate(hazy, HAZY, STEPS, *rays, solver=Path(samples=1024, seed=3))
    assert walked.jacobian.shape == (5, 3, 2)
    # The tolerance of `orders`, on the whole of the light for derivatives that are differences of large parts.
    scale = np.abs(smooth.jacobian).max(axis=(1, 2), keepdims=True)
    slack = 0.005 * scale
    allowed = largest_t(walked.jacobian.size, RUNS - 1) * walked.jacobian_error + slack
    assert np.all(np.abs(walked.jacobian - smooth.jacobian) < allowed)
    # Noise is small enough to say something for the light of many orders: the ground's.
    assert np.all(walked.jacobian_error[4] < 0.1 * np.abs(walked.jacobian[4]))


@pytest.mark.slow
def test_errors_and_bias_over_seeds_in_three_dimensions() -> None:
    """Scattered many times in a sphere: means of many seeds against plain walks, and the spread against the error."""

    def scene(theta: Array) -> SpaceScene:
        medium = Medium(components=(component(Sphere(radius=1.0), float(theta[0]), float(theta[1]), 0.4),))
        return dusty_sphere(1.0).model_copy(update={"medium": medium})

    theta, steps, rays = [1.0, 0.8], [1e-3, 1e-3], (*parallel_rays(np.array([0.5])), WAVELENGTH)
    runs = [differentiate(scene, theta, steps, *rays, solver=Path(samples=64, seed=k)) for k in range(400)]
    slopes = np.array([r.jacobian[:, 0, 0] for r in runs])
    errors = np.array([r.jacobian_error[:, 0, 0] for r in runs])
    plain = differentiate(scene, theta, steps, *rays, solver=Path(sampling="free-flight", samples=100_000, seed=5))
    mean, spread = slopes.mean(axis=0), slopes.std(axis=0, ddof=1)
    error = np.hypot(spread / np.sqrt(len(runs)), plain.jacobian_error[:, 0, 0])
    assert_agrees(mean, plain.jacobian[:, 0, 0], error)
    # The logarithm of the spread of n runs is known to sqrt((kurtosis - 1) / 4 n): 3.5 % for 400 Gaussian ones.
    kurtosis = np.mean((slopes - mean) ** 4, axis=0) / np.mean((slopes - mean) ** 2, axis=0) ** 2
    known = np.sqrt((kurtosis - 1) / (4 * len(runs)))
    assert np.all(known < 0.06)
    assert np.all(np.abs(np.log(np.sqrt(np.mean(errors**2, axis=0)) / spread)) < 4 * known)


def test_same_seed_same_numbers_whatever_the_threads() -> None:
    one, two = (
        differentiate(hazy, HAZY[:5], STEPS, *sky_rays(), WAVELENGTHS, solver=Path(samples=32, seed=9), threads=n)
        for n in (1, 2)
    )
    np.testing.assert_array_equal(one.jacobian, two.jacobian)


def test_fewer_walks_than_runs_still_have_an_error() -> None:
    few = differentiate(hazy, HAZY[:5], STEPS, *sky_rays(), WAVELENGTHS, solver=Path(samples=5, seed=9))
    assert np.all(few.jacobian_error[0] > 0)


# What moves, and what cannot be asked


def test_parameters_that_move_the_sun_are_solved_apart() -> None:
    def scene(theta: Array) -> Scene:
        moved = hazy(HAZY * [theta[1], 1, 1, 1, 1])
        return moved.model_copy(update={"sun": Sun(elevation_deg=float(theta[0]))})

    rays = (*sky_rays(), WAVELENGTHS)
    found = differentiate(scene, [40.0, 1.0], [0.01, 1e-3], *rays, solver="single")
    row = np.array([0.01, 0.0])
    np.testing.assert_allclose(
        found.jacobian[0], separately(scene, np.array([40.0, 1.0]), row, *rays, solver="single"), rtol=1e-12
    )
    alone = differentiate(lambda t: scene(np.array([40.0, t[0]])), [1.0], [1e-3], *rays, solver="single")
    np.testing.assert_allclose(found.jacobian[1], alone.jacobian[0], rtol=1e-9)


def test_many_parameters_are_solved_in_groups() -> None:
    """More channels than one solution holds: the derivatives are the same."""

    def scene(theta: Array) -> Scene:
        # A spectrum of numbers: the measured Sun's is a mean over the cells between the wavelengths.
        return hazy(theta).model_copy(update={"star": Star(spectrum=1.5)})

    wavelengths = np.linspace(400, 700, 120)
    rays = sky_rays()[0][:1], sky_rays()[1][:1]
    found = differentiate(scene, HAZY, STEPS, *rays, wavelengths, solver="single")
    few = differentiate(scene, HAZY, STEPS, *rays, wavelengths[::60], solver="single")
    # The adaptive quadrature looks at all channels, so it may stop elsewhere: its own tolerance.
    np.testing.assert_allclose(found.jacobian[:, :, ::60], few.jacobian, rtol=1e-4)


@pytest.mark.parametrize(("steps", "field"), [([1.0, 2.0], "steps"), ([0.0], "steps")])
def test_bad_steps(steps: list[float], field: str) -> None:
    with pytest.raises(DomainError, match=field):
        differentiate(lambda t: dusty_sphere(float(t[0])), [1.0], steps, *parallel_rays(np.array([0.4])), WAVELENGTH)


def test_scenes_of_other_geometry_are_not_stacked() -> None:
    with pytest.raises(DomainError, match="sun"):
        stack([hazy(HAZY), hazy(HAZY).model_copy(update={"sun": Sun(elevation_deg=10.0)})], WAVELENGTHS)
