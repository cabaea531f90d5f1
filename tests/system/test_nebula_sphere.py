"""A uniform dusty sphere with a star in its centre, against its integrals, and conservation of light."""

from __future__ import annotations

import numpy as np
import pytest
from nebulae import WAVELENGTH, Array, dusty_sphere, escaping_luminosity, parallel_rays
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad
from significance import assert_agrees

from skyscatter.lights import PointStar
from skyscatter.solvers.options import Path
from skyscatter.solvers.run import radiance
from skyscatter.spectra.table import SpectralTable

#: Scattered light that escapes, as a share of the luminosity: albedo 0.6, isotropic, star in the centre.  Solution of
#: the integral equation of the sphere, to the digits given.
ESCAPES = {0.1: 5.5115e-2, 1.0: 0.25193, 10.0: 7.129e-4}
DEPTHS = tuple(ESCAPES)


def single_profile(b: float, tau: float, albedo: float) -> float:
    """Radiance of light that was scattered once, at the distance b from the centre, of a sphere of radius 1 m.

    The integral along the line of sight of (albedo tau / 4 pi) exp(-tau (h - t)) exp(-tau r) / (4 pi r^2), r^2 = b^2
    + t^2.
    """
    h = np.sqrt(1 - b * b)

    def integrand(t: float) -> float:
        r2 = b * b + t * t
        return float(np.exp(-tau * (h - t + np.sqrt(r2))) / r2)

    value, _ = quad(
        integrand, -h, h, points=[-3 * b, 0.0, 3 * b] if 3 * b < h else [0.0], epsabs=0, epsrel=1e-11, limit=500
    )
    return float(albedo * tau / (4 * np.pi) ** 2 * value)


@pytest.mark.parametrize("tau", [1e-4, 0.1, 1.0, 10.0, 30.0, 100.0])
def test_single_scattering_profile(tau: float) -> None:
    b = np.array([1e-5, 1e-3, 0.03, 0.1, 0.3, 0.6, 0.9, 0.99, 0.9999])
    if tau == 100.0:
        # A ray ends at an optical depth of 80, so that of 1e-44 the part from near the star is left out.
        b = b[b >= 0.3]
    answer = radiance(dusty_sphere(tau), *parallel_rays(b), WAVELENGTH, solver="single", parts=True)
    expected = np.array([single_profile(x, tau, 0.6) for x in b])
    error = np.abs(answer.layers["scattered"][:, 0] / expected - 1)
    print(f"tau {tau:g}: largest difference from the integral {error.max():.1e}")
    assert error.max() < 1e-4


def check_escape(tau: float, rays: int, samples: int, most: float) -> None:
    """The escaping share agrees with the integral equation within 3 standard errors, which are at most `most` of it."""
    share, error, _ = escaping_luminosity(dusty_sphere(tau), rays, samples=samples)
    z = (share[0] - ESCAPES[tau]) / error[0]
    print(
        f"tau {tau:g}: {share[0]:.6g} +- {error[0]:.2g} ({error[0] / share[0]:.3%}), expected {ESCAPES[tau]:g}, z {z:+.2f}"  # noqa: E501
    )
    assert error[0] < most * ESCAPES[tau]
    # Half a unit of the last digit of the table is not an error of the walks.
    rounding = {0.1: 5e-7, 1.0: 5e-6, 10.0: 5e-8}[tau]
    assert abs(share[0] - ESCAPES[tau]) < 3 * error[0] + rounding


@pytest.mark.parametrize("tau", DEPTHS)
def test_escaping_light(tau: float) -> None:
    check_escape(tau, 500, 64, 1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(("tau", "samples"), [(0.1, 64), (1.0, 128), (10.0, 512)])
def test_escaping_light_to_a_thousandth(tau: float, samples: int) -> None:
    check_escape(tau, 4000, samples, 1e-3)


@pytest.mark.parametrize(
    ("tau", "rays", "samples", "most"),
    [
        (0.1, 500, 64, 1e-4),
        (1.0, 500, 64, 5e-3),
        pytest.param(1.0, 4000, 128, 1e-3, marks=pytest.mark.slow),
        pytest.param(10.0, 4000, 128, 1e-2, marks=pytest.mark.slow),
    ],
)
def test_nothing_is_lost_without_absorption(tau: float, rays: int, samples: int, most: float) -> None:
    """What is scattered out and what comes straight out, exp(-tau), are the luminosity."""
    share, error, _ = escaping_luminosity(dusty_sphere(tau, albedo=1.0), rays, samples=samples)
    total = share + np.exp(-tau)
    print(f"tau {tau:g}: {total[0]:.6f} +- {error[0]:.1g}")
    assert error[0] < most
    # The rule over the offset itself is good to 1 / rays^1.5.
    assert abs(total[0] - 1) < 3 * error[0] + rays**-1.5


def gauss_legendre(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Nodes and weights between two bounds."""
    x, w = leggauss(count)
    return 0.5 * (low + high) + 0.5 * (high - low) * x, 0.5 * (high - low) * w


@pytest.mark.parametrize("tau", [0.1, 1.0, pytest.param(10.0, marks=pytest.mark.slow)])
def test_absorbed_and_escaping_light_are_the_luminosity(tau: float) -> None:
    """Absorption by the mean intensity inside, which rays that begin there measure, closes the balance.

    Light straight from the star is absorbed by (1 - albedo) (1 - exp(-tau)); of scattered light the shell at r absorbs
    (1 - albedo) tau 4 pi J(r) 4 pi r^2 dr.  J falls as 1 / r near the star, so that r^2 J is smooth.
    """
    albedo = 0.6
    scene = dusty_sphere(tau, albedo)
    escaping, escaping_error, _ = escaping_luminosity(scene, 500, samples=64)
    r, weight = gauss_legendre(0.0, 1.0, 12)
    # Cosine to the star = cos(angle): radiance rises as 1 / sin(angle) near it, so the angle is the smooth variable.
    angle, spread = gauss_legendre(0.0, np.pi, 24)
    r_grid, angle_grid = np.meshgrid(r, angle, indexing="ij")
    origins = np.stack([np.zeros_like(r_grid), np.zeros_like(r_grid), r_grid], axis=-1)
    directions = np.stack([np.sin(angle_grid), np.zeros_like(r_grid), -np.cos(angle_grid)], axis=-1)
    answer = radiance(scene, origins, directions, WAVELENGTH, solver=Path(samples=128), parts=True)
    scattered = answer.radiance[..., 0] - answer.layers["direct"][..., 0]
    each = (1 - albedo) * tau * 4 * np.pi * (weight * r * r)[:, None] * 2 * np.pi * spread * np.sin(angle_grid)
    absorbed = np.sum(each * scattered) + (1 - albedo) * (1 - np.exp(-tau))
    error = np.hypot(np.sqrt(np.sum((each * answer.standard_error[..., 0]) ** 2)), escaping_error[0])
    total = escaping[0] + np.exp(-tau) + absorbed
    print(
        f"tau {tau:g}: escaping {escaping[0] + np.exp(-tau):.5f}, absorbed {absorbed:.5f}, sum {total:.5f} +- {error:.1g}"  # noqa: E501
    )
    assert error < 5e-3
    # With 24 radii and 48 angles the absorbed light of the first order, free of noise, differs by 4e-5.
    assert abs(total - 1) < 3 * error + 1e-4


@pytest.mark.parametrize("sampling", ["march", "free-flight", "delta"])
@pytest.mark.parametrize("tau", [0.1, 1.0, 10.0])
def test_white_furnace(tau: float, sampling: str) -> None:
    """White dust before a background of 1 looks like the background, along every ray and at every wavelength."""
    scene = dusty_sphere(tau, albedo=1.0, g=0.5, stars=(), background=1.0)
    b = (np.arange(40) + 0.5) / 40
    samples = 256 if sampling == "march" else 512
    answer = radiance(scene, *parallel_rays(b), (450.0, 650.0), solver=Path(samples=samples, sampling=sampling))
    error = answer.standard_error
    if sampling != "march":
        # Of a plain walk comes 1 if it is scattered at all, else nothing: the error is known better than it is seen.
        unscattered = np.exp(-2 * tau * np.sqrt(1 - b * b))[:, None]
        error = np.broadcast_to(np.sqrt(unscattered * (1 - unscattered) / samples), answer.radiance.shape)
    mean, mean_error = answer.radiance.mean(axis=0), np.sqrt((error**2).sum(axis=0)) / b.size
    print(f"{sampling}, tau {tau:g}: {mean} +- {mean_error}")
    assert mean_error.max() < 0.02
    assert_agrees(mean, 1.0, mean_error, freedom=np.inf)
    if sampling == "march":
        assert_agrees(answer.radiance, 1.0, error)
    else:
        assert_agrees(answer.radiance, 1.0, error + 1.0 / samples, freedom=np.inf)


def test_orders_add_up_to_the_furnace() -> None:
    scene = dusty_sphere(0.5, albedo=1.0, stars=(), background=1.0)
    answer = radiance(
        scene, *parallel_rays(np.array([0.1, 0.5, 0.9])), WAVELENGTH, solver=Path(samples=1024), parts=True, orders=12
    )
    b = np.array([0.1, 0.5, 0.9])
    np.testing.assert_allclose(answer.layers["direct"][:, 0], np.exp(-2 * 0.5 * np.sqrt(1 - b * b)), rtol=1e-9)
    orders = sum(answer.layers[f"order{k}"] for k in range(1, 13))
    # Of light scattered more than 12 times less than the thirteenth power of the chance to be scattered again is left.
    again = 1 - np.exp(-1.0)
    np.testing.assert_allclose(answer.layers["direct"] + orders, answer.radiance, atol=again**13, rtol=1e-12)
    assert_agrees(answer.radiance, 1.0, answer.standard_error)


def test_luminosity_of_the_star_is_what_scatters() -> None:
    """Twice the star, twice the light: the walks' draws do not depend on the unit of the luminosity."""
    bright = PointStar(spectrum=SpectralTable(wavelengths=(500.0,), values=(2e26,)))
    rays = parallel_rays(np.array([0.2, 0.7]))
    one = radiance(dusty_sphere(3.0), *rays, WAVELENGTH, solver=Path(samples=64))
    many = radiance(dusty_sphere(3.0, stars=(bright,)), *rays, WAVELENGTH, solver=Path(samples=64))
    np.testing.assert_allclose(many.radiance, 2e26 * one.radiance, rtol=1e-9)
