"""Point spread functions and photon noise: shapes and fluxes in closed form, the statistics of Poisson."""

from __future__ import annotations

import numpy as np
import pytest
from astropy import constants, units
from scipy.integrate import dblquad

from skyscatter.errors import DomainError
from skyscatter.image import SkyFrame, SpectralImage
from skyscatter.image.instrument import observe, photons_per_radiance
from skyscatter.image.psf import blurred, point_spread
from skyscatter.spectra.table import SpectralTable

SKY = SkyFrame(ra_deg=10.0, dec_deg=20.0, pixel_scale_deg=0.5 / 3600.0)  # half an arc second
WL = np.array([450.0, 500.0, 650.0])


def point(size: int = 101) -> SpectralImage:
    cube = np.zeros((size, size, 3))
    cube[size // 2, size // 2] = [1.0, 2.0, 3.0]
    return SpectralImage(cube, WL, sky=SKY, recipe={"seed": 5})


def flat(value: float = 1e-6, size: int = 60, error: float | None = None) -> SpectralImage:
    cube = np.full((size, size, 3), value)
    return SpectralImage(cube, WL, None if error is None else error * cube, sky=SKY)


PHOTONS = {"photon_noise": True, "collecting_area_m2": 4.0, "exposure_s": 100.0, "throughput": 0.5}


@pytest.mark.parametrize("psf", ["gaussian:3.0", "moffat:3.0:4.765", "moffat:1.0:2.5"])
def test_blur_keeps_the_light(psf: str) -> None:
    made = observe(point(), psf)
    # a sum of 1e4 pixels through a Fourier transform: rounding
    np.testing.assert_allclose(made.radiance.sum(axis=(0, 1)), [1.0, 2.0, 3.0], rtol=1e-12)
    assert made.radiance.min() >= 0.0
    np.testing.assert_allclose(made.radiance[..., 1], 2.0 * made.radiance[..., 0], atol=1e-16)
    np.testing.assert_allclose(made.radiance, made.radiance[::-1, ::-1], atol=1e-15)  # centred
    assert made.recipe["observation"]["psf"]["fwhm_arcsec"] == float(psf.split(":")[1])
    assert (made.recipe["seed"], made.sky) == (5, SKY)


@pytest.mark.parametrize("psf", ["gaussian:6.0", "moffat:6.0:2.5", "moffat:6.0:4.765"])
def test_width_is_measured_back(psf: str) -> None:
    line = observe(point(), psf).radiance[50, :, 0]
    half = np.interp(-line.max() / 2, -line[50:], np.arange(51.0))
    # 12 pixels: averaging over pixels widens by (1 / 12) / sigma^2 / 2 or so, linear interpolation as much
    assert 2 * half * 0.5 == pytest.approx(6.0, rel=5e-3)


@pytest.mark.parametrize(("psf", "width"), [("gaussian:1.0", 1.0), ("moffat:1.0:2.5", 1.0), ("moffat:0.3:3.0", 0.3)])
def test_pixels_hold_the_integral_of_the_profile(psf: str, width: float) -> None:
    spread = point_spread(psf)
    kernel = spread.kernel(1.0, 200)

    def gaussian(y: float, x: float) -> float:
        return 4 * np.log(2) / np.pi / width**2 * np.exp(-4 * np.log(2) * (x * x + y * y) / width**2)

    def moffat(y: float, x: float) -> float:
        assert spread.beta is not None
        a = width / (2 * np.sqrt(2 ** (1 / spread.beta) - 1))
        return (spread.beta - 1) / np.pi / a**2 * (1 + (x * x + y * y) / a**2) ** -spread.beta

    profile = gaussian if spread.kind == "gaussian" else moffat
    n = kernel.shape[0] // 2
    for j, i in ((0, 0), (0, 1), (1, 1), (2, 0)):
        # a quarter of the middle pixel four times: its peak is at a corner of the range
        if (j, i) == (0, 0):
            expected = 4 * dblquad(profile, 0, 0.5, 0, 0.5)[0]
        else:
            expected = dblquad(profile, i - 0.5, i + 0.5, j - 0.5, j + 0.5)[0]
        # less than 1e-4 of the light lies beyond the kernel and is given back
        assert kernel[n + j, n + i] == pytest.approx(expected, rel=2e-4, abs=1e-9)


def test_nothing_comes_in_over_the_edge() -> None:
    made = observe(flat(1.0), "gaussian:3.0").radiance[..., 0]
    assert made[30, 30] == pytest.approx(1.0, rel=1e-12)  # rounding
    # an edge pixel's middle stands half a pixel inside: 0.5 + erf(0.5 / (sigma sqrt 2)) / 2 = 0.577 for sigma 2.548
    kernel = point_spread("gaussian:3.0").kernel(0.5, 60)
    n = kernel.shape[0] // 2
    assert made[30, 0] == pytest.approx(kernel.sum(axis=0)[n:].sum(), rel=1e-12)
    assert 0.5 < made[30, 0] < 0.6


def test_kernels_larger_than_the_picture() -> None:
    cube = np.zeros((5, 9, 1))
    cube[2, 4] = 1.0
    kernel = point_spread("moffat:8.0:2.0").kernel(1.0, 9)
    assert kernel.shape == (19, 19)
    np.testing.assert_allclose(blurred(cube, [kernel])[..., 0], kernel[7:12, 5:14], atol=1e-15)


def test_holes_stay_holes() -> None:
    cube = np.ones((20, 20, 3))
    cube[:, :5] = np.nan
    made = observe(SpectralImage(cube, WL, sky=SKY), "gaussian:1.0", **PHOTONS)  # type: ignore[arg-type]
    assert np.isnan(made.radiance[:, :5]).all()
    assert np.isfinite(made.radiance[:, 5:]).all()
    assert made.standard_error is not None
    assert np.isnan(made.standard_error[:, :5]).all()


def test_errors_pass_the_blur_as_independent() -> None:
    made = observe(flat(1.0, error=0.2), "gaussian:2.0")
    kernel = point_spread("gaussian:2.0").kernel(0.5, 60)
    assert made.standard_error is not None
    np.testing.assert_allclose(made.standard_error[30, 30], 0.2 * np.sqrt((kernel**2).sum()), rtol=1e-9)
    layered = SpectralImage(np.ones((60, 60, 3)), WL, layers={"order-1": np.full((60, 60, 3), 0.5)}, sky=SKY)
    np.testing.assert_allclose(observe(layered, "gaussian:2.0").layers["order-1"][30, 30], 0.5, rtol=1e-12)


def test_photons_by_hand() -> None:
    """Against the same product in astropy's units."""
    count = photons_per_radiance(flat(), 4.0, 100.0, 0.5)[30, 30, 1]
    energy = constants.h * constants.c / (500 * units.nm)
    cell = 100.0 * units.nm  # from 475 to 575
    light = 1 * units.Unit("W m-2 sr-1 nm-1") * 4 * units.m**2 * 100 * units.s * 0.5 * (0.5 * units.arcsec) ** 2 * cell
    # the tangent plane's pixel is smaller than half an arc second squared by 1e-9 of itself
    assert count == pytest.approx((light / energy).to_value("", units.dimensionless_angles()), rel=1e-7)
    half = photons_per_radiance(flat(), 4.0, 100.0, SpectralTable(wavelengths=(450.0, 650.0), values=(1.0, 0.6)))
    assert half[0, 0, 1] == pytest.approx(2 * 0.9 * count, rel=1e-7)


@pytest.mark.parametrize("mean", [3.0, 1e4])
def test_noise_is_that_of_poisson(mean: float) -> None:
    value = mean / photons_per_radiance(flat(), 4.0, 100.0, 0.5)[0, 0, 1]
    made = observe(flat(value, size=150), seed=7, **PHOTONS)  # type: ignore[arg-type]
    counts = made.radiance[..., 1] * photons_per_radiance(made, 4.0, 100.0, 0.5)[..., 1]
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-8 * mean)  # whole photons; rounding
    n = counts.size
    # four standard errors: of a mean, and of a variance whose fourth moment is 3 mean^2 + mean
    assert counts.mean() == pytest.approx(mean, abs=4 * np.sqrt(mean / n))
    assert counts.var() == pytest.approx(mean, abs=4 * np.sqrt((2 * mean**2 + mean) / n))
    assert made.standard_error is not None
    np.testing.assert_allclose(made.standard_error[..., 1], value / np.sqrt(mean), rtol=1e-6)


def test_seeds() -> None:
    one, same, other = (observe(flat(), seed=seed, **PHOTONS).radiance for seed in (1, 1, 2))  # type: ignore[arg-type]
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.5


def test_both_errors_add_in_squares() -> None:
    plain, noisy = (observe(flat(error=error), **PHOTONS).standard_error for error in (None, 0.3))  # type: ignore[arg-type]
    assert plain is not None
    assert noisy is not None
    np.testing.assert_allclose(noisy**2, plain**2 + (0.3e-6) ** 2, rtol=1e-12)  # rounding
    dark = observe(flat(0.0), **PHOTONS)  # type: ignore[arg-type]
    assert dark.radiance.max() == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "nothing to do"),
        ({"psf": "box:3"}, "gaussian:FWHM"),
        ({"psf": "gaussian"}, "gaussian:FWHM"),
        ({"psf": "gaussian:wide"}, "gaussian:FWHM"),
        ({"psf": "moffat:2"}, "moffat:FWHM:BETA"),
        ({"psf": "gaussian:0"}, "above 0"),
        ({"psf": "moffat:2:1.0"}, "between 1.5 and 20"),
        ({"psf": "gaussian:2", "exposure_s": 3.0}, "for photon noise only"),
        ({"photon_noise": True, "exposure_s": 3.0}, "collecting_area_m2"),
        ({**PHOTONS, "exposure_s": -1.0}, "above 0"),
        ({**PHOTONS, "throughput": 1.5}, "at most 1"),
        ({**PHOTONS, "throughput": 0.0}, "above 0"),
        ({**PHOTONS, "exposure_s": float("inf")}, "above 0"),
    ],
)
def test_refusals(options: dict[str, object], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        observe(flat(), **options)  # type: ignore[arg-type]


def test_pictures_without_a_scale_are_refused() -> None:
    bare = SpectralImage(np.ones((4, 4, 3)), WL)
    with pytest.raises(DomainError, match="pixel scale"):
        observe(bare, "gaussian:2.0")
    with pytest.raises(DomainError, match="pixel scale"):
        observe(bare, **PHOTONS)  # type: ignore[arg-type]


def test_estimates_below_zero_count_as_dark() -> None:
    made = observe(flat(-1e-6), **PHOTONS)  # type: ignore[arg-type]
    np.testing.assert_array_equal(made.radiance, 0.0)


def test_more_photons_than_can_be_drawn() -> None:
    mean = 1e20
    value = mean / photons_per_radiance(flat(), 4.0, 100.0, 0.5)[0, 0, 1]
    made = observe(flat(value, size=100), **PHOTONS)  # type: ignore[arg-type]
    scatter = (made.radiance[..., 1] / value - 1.0) * np.sqrt(mean)
    # four standard errors of a mean and a variance of 1e4 normal deviates; a mean of 1e20 keeps 6 digits of them
    assert abs(scatter.mean()) < 4 / 100
    assert scatter.var() == pytest.approx(1.0, abs=4 * np.sqrt(2) / 100)
