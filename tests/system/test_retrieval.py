"""Retrievals from what another solver made: the truth where the error bars say it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import skyscatter
from skyscatter import fields
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion import flux_table, nebula_image, radiance_table, with_values
from skyscatter.inversion.fitting import free_parameters
from skyscatter.inversion.forward import Forward
from skyscatter.inversion.observations import Run
from skyscatter.inversion.parameters import Subject, apply, resolve

NOISE = 0.03
TRUTH = {"haze.optical_depth": 0.3, "haze.single_scattering_albedo": 0.92, "haze.asymmetry": 0.65, "ground.albedo": 0.2}
WAVELENGTHS = np.array([440.0, 870.0])
AZIMUTH, ELEVATION = (a.ravel() for a in np.meshgrid([190.0, 240.0, 350.0], [12.0, 35.0, 70.0], indexing="ij"))


@pytest.fixture(scope="module")
def walked() -> Any:
    """Radiances by walks, (datum,): 9 rays, 2 wavelengths, a standard error below a tenth of the noise in the mean."""
    subject = Subject(skyscatter.load_model("earth-hazy"))
    parameters = [resolve(name, None, subject) for name in TRUTH]
    scene = apply(parameters, subject, list(TRUTH.values())).model.scene(sun_elevation_deg=40.0)
    look = direction_from_azimuth_elevation(AZIMUTH, ELEVATION)
    answer = skyscatter.radiance(
        scene, scene.observer.position, look, WAVELENGTHS, solver=skyscatter.Path(samples=8192, seed=1)
    )
    assert np.median(answer.standard_error / answer.radiance) < 0.2 * NOISE
    return answer.radiance.ravel()


def observation(radiance: Any) -> Any:
    """The table of a radiometer."""
    return radiance_table(
        np.repeat(AZIMUTH, 2), np.repeat(ELEVATION, 2), np.tile(WAVELENGTHS, 9), radiance, NOISE * np.abs(radiance),
        sun_elevation_deg=40.0,
    )  # fmt: skip


@pytest.mark.slow
def test_the_truth_is_inside_its_region_as_often_as_stated(walked: Any) -> None:
    """1000 draws of noise on radiances by ``path``; retrieval by ``orders``, linear about the truth.

    93 to 97 % are allowed: three standard deviations of chance are 2 %, the walks' own error moves the mean by 1 %.
    What the linear answer is worth is told by one that is not, below; benchmarks/retrieval_coverage.py iterates all.
    """
    data = observation(walked)
    parameters, subject = free_parameters(skyscatter.load_model("earth-hazy"), dict.fromkeys(TRUTH), [data])
    forward = Forward(parameters, subject, [data], Run(skyscatter.Orders(tolerance=0.01)))
    truth = forward.state(list(TRUTH.values()))
    linear = forward.linearise(truth, np.full(4, 0.01))
    variance = data.sigma**2 + linear.error**2
    inverse = linear.jacobian.T @ (linear.jacobian / variance[:, None]) + np.eye(4)
    rng = np.random.default_rng(7)
    y = walked + data.sigma * rng.standard_normal((1000, walked.size))
    gradient = (y - linear.value) / variance @ linear.jacobian - truth
    off = np.linalg.solve(inverse, gradient.T).T
    distance = np.einsum("di,ij,dj->d", off, inverse, off)
    inside = float(np.mean(distance < chi2.ppf(0.95, 4)))
    assert 0.93 <= inside <= 0.97
    # A region that is a fifth too narrow would be found out.
    assert np.mean(distance < 0.64 * chi2.ppf(0.95, 4)) < 0.93


@pytest.mark.slow
def test_one_draw_all_the_way(walked: Any) -> None:
    """Optimal estimation from other numbers than the true ones: within the 99.9 % region, and the residual is noise."""
    noisy = walked * (1 + NOISE * np.random.default_rng(3).standard_normal(walked.size))
    start = {"haze.optical_depth": 0.25, "haze.asymmetry": 0.68, "ground.albedo": 0.15}
    model = with_values(skyscatter.load_model("earth-hazy"), start)
    result = skyscatter.fit(model, observation(noisy), dict.fromkeys(TRUTH), solver=skyscatter.Orders(tolerance=0.01))
    assert result.converged
    assert result.distance(TRUTH) < chi2.ppf(0.999, 4)
    assert result.degrees_of_freedom > 3.5
    assert 1e-3 < result.probability < 1 - 1e-3
    np.testing.assert_allclose(
        result.noise_covariance + result.smoothing_covariance, result.covariance, atol=1e-6 * result.covariance.max()
    )


def test_a_nebula_in_three_bands() -> None:
    """A_V, albedo, asymmetry, size, and the star's temperature from an image with 3 % noise: 99.9 % region."""
    dust = skyscatter.Component(
        name="dust", density=fields.GaussianSphere(width="0.1 pc"), optics=skyscatter.Dust(visual_extinction=2.0)
    )
    star = skyscatter.PointStar(position=("0.02 pc", "0.05 pc", "0.05 pc"), temperature=15000, luminosity=500)
    model = skyscatter.NebulaModel(
        name="blob", view=skyscatter.View(distance="400 pc"), components=(dust,), stars=(star,)
    )
    camera = skyscatter.Telescope.from_field_of_view(32, 32, 0.08)
    image = skyscatter.render(model.scene(), camera, [440, 550, 650], solver="single")
    noise = 1 + 0.03 * np.random.default_rng(2).standard_normal(image.radiance.shape)
    noisy = skyscatter.SpectralImage(image.radiance * noise, image.wavelengths, recipe=image.recipe, sky=image.sky)
    data = nebula_image(noisy, noise=0.03, pixels=120)
    free = {
        "dust.extinction": (0, 20), "dust.albedo": None, "dust.asymmetry": None, "star.temperature": None,
        "dust.width": None,
    }  # fmt: skip
    result = skyscatter.fit(model, data, free, solver="single")
    at_550 = Subject(model)
    truth = {name: resolve(name, prior, at_550).get(at_550) for name, prior in free.items()}
    assert result.converged
    assert result.distance(truth) < chi2.ppf(0.999, len(truth))
    assert 1e-3 < result.probability < 1 - 1e-3


@pytest.mark.slow
def test_fluxes_tell_the_aerosol() -> None:
    """Direct and diffuse irradiance at two wavelengths and three Suns, made at another tolerance, noise 1 %."""
    model = skyscatter.load_model("earth-hazy")
    elevation, wl = (a.ravel() for a in np.meshgrid([20.0, 35.0, 60.0], [440.0, 870.0], indexing="ij"))
    made = skyscatter.solve(model.scene(), [440, 870], sun_elevations_deg=(15, 65), tolerance=0.003)
    fluxes = made.fluxes(0.0, sun_elevation_deg=[20.0, 35.0, 60.0])
    rng = np.random.default_rng(4)
    y = np.concatenate([fluxes.direct.ravel(), fluxes.diffuse_down.ravel()])
    y = y * (1 + 0.01 * rng.standard_normal(y.size))
    data = flux_table(
        np.tile(elevation, 2), ["direct"] * 6 + ["diffuse"] * 6, y, noise=0.01, wavelength_nm=np.tile(wl, 2)
    )
    names = ["haze.optical_depth", "haze.angstrom_exponent", "haze.single_scattering_albedo"]
    result = skyscatter.fit(model, data, dict.fromkeys(names), solver=skyscatter.Orders(tolerance=0.01))
    subject = Subject(model)
    assert result.distance({name: resolve(name, None, subject).get(subject) for name in names}) < chi2.ppf(0.999, 3)


def test_the_sum_over_the_spectrum_beside_the_standard() -> None:
    """Sunlight through nothing, and through vapour.

    Without an atmosphere the sum is the sunlight of the band.  Vapour takes, by the formula of Lacis & Hansen (1974, J.
    Atmos. Sci. 31, 118, eq. 22), 12 % of all sunlight with 1.42 g cm-2 at an air mass of 1.5: what our band model takes
    below 2490 nm, and between nothing and all of the 3 % beyond.
    """
    from skyscatter.inversion.broadband import Broadband
    from skyscatter.spectra.solar import solar_irradiance

    band, star = Broadband(), skyscatter.Star()
    ratio, elevation = np.ones((1, band.wavelengths.size)), np.array([41.8])
    steps = 0.5
    within, beyond = (np.sum(solar_irradiance(np.arange(*r, steps))) * steps for r in ((290, 2490), (2490, 4000)))
    # Mixed gases alone take about 1 %.
    dry = band.total(ratio, elevation, 0.0, star)[0]
    assert 0.97 * within < dry < 0.998 * within
    taken = dry - band.total(ratio, elevation, 1.42, star)[0]
    y = 1.42 * 1.5
    lacis = 2.9 * y / ((1 + 141.5 * y) ** 0.635 + 5.925 * y)
    assert taken < lacis * (within + beyond) < taken + beyond
