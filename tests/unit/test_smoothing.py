"""Pictures made even: what is the same is averaged, what is not stays, and no error is stated of what comes out."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.image import SpectralImage
from skyscatter.image.smoothing import smoothed
from skyscatter.image.tone import SPACE_LIFT, metered_luminance, space_ev100

WAVELENGTHS = [450.0, 550.0, 650.0]
NOISE = 0.3


def noisy(truth: np.ndarray, seed: int = 3, wavelengths: list[float] = WAVELENGTHS) -> SpectralImage:
    """Grey light with noise that all wavelengths share, as walks have it."""
    draws = np.random.default_rng(seed).normal(1.0, NOISE, truth.shape)
    cube = np.repeat((truth * draws)[..., None], len(wavelengths), axis=2)
    error = np.repeat((NOISE * truth)[..., None], len(wavelengths), axis=2)
    return SpectralImage(cube, wavelengths, error, recipe={"seed": seed})


def test_an_even_field_loses_its_noise_and_keeps_its_light() -> None:
    image = noisy(np.ones((64, 80)))
    even = smoothed(image)
    # 197 pixels with equal weights would leave 7 %; weights that follow the noise, up to twice as much
    scatter = even.radiance[..., 1].std()
    assert scatter < 0.15 * NOISE
    assert even.radiance.mean() == pytest.approx(image.radiance.mean(), rel=0.01)
    assert even.standard_error is None  # of neighbours that are alike nobody knows it
    assert even.recipe == {"seed": 3, "smoothed": {"reach": 8, "tolerance": 0.5}}


def test_an_edge_stays_where_it_is() -> None:
    truth = np.where(np.arange(64) < 32, 1.0, 10.0) * np.ones((48, 1))
    rows = np.mean([smoothed(noisy(truth, seed)).radiance[..., 1].mean(axis=0) for seed in range(12)], axis=0)
    # Means of 48 rows in 12 draws, unsmoothed, are good to 0.3 / sqrt(576) = 1.25 %: four times that.  A plain average
    # of this reach would leave half the step beside the edge.
    np.testing.assert_allclose(rows[:31], 1.0, rtol=0.05)
    np.testing.assert_allclose(rows[33:], 10.0, rtol=0.05)


def test_a_star_and_what_is_known_are_left_alone() -> None:
    truth = np.ones((40, 40))
    image = noisy(truth)
    cube, error = image.radiance.copy(), image.standard_error.copy()
    cube[20, 20] += 1000.0
    known = smoothed(SpectralImage(cube, WAVELENGTHS, error)).radiance[20, 20]
    assert known == pytest.approx(cube[20, 20], rel=1e-6)
    exact = SpectralImage(cube, WAVELENGTHS, 0.0 * error)
    assert smoothed(exact) is exact
    bare = SpectralImage(cube, WAVELENGTHS)
    assert smoothed(bare) is bare


def test_what_is_outside_the_field_stays_outside_and_adds_nothing() -> None:
    image = noisy(np.ones((40, 40)))
    cube = image.radiance.copy()
    cube[:, :10] = np.nan
    even = smoothed(SpectralImage(cube, WAVELENGTHS, image.standard_error))
    assert np.isnan(even.radiance[:, :10]).all()
    assert np.isfinite(even.radiance[:, 10:]).all()
    assert even.radiance[:, 10:].mean() == pytest.approx(cube[:, 10:].mean(), rel=0.01)


def test_a_nebula_is_exposed_for_its_bright_part() -> None:
    """What is dim around it, and stars in it, do not count: the brightest tenth begins 1.2 stops above mid grey."""
    nebula = np.linspace(0.5, 1.0, 1000)
    dark, star = np.full(5000, 1e-5), [1e3, 1e3]
    found = space_ev100(np.concatenate([nebula, dark, star]))
    stops = np.log2(np.percentile(nebula, 90.0) / metered_luminance(found))
    # 2 stars among 1000 pixels raise the rank by 0.2 %
    assert stops == pytest.approx(SPACE_LIFT, abs=0.01)
    assert space_ev100(np.zeros(5)) == 0.0
    scene = {"view": {}, "medium": {}}
    cube = nebula.reshape(20, 50, 1) * np.ones(3)
    in_space = SpectralImage(cube, WAVELENGTHS, recipe={"scene": scene})
    assert in_space.auto_exposure() > SpectralImage(cube, WAVELENGTHS).auto_exposure() - 0.6
    assert in_space.auto_exposure() == pytest.approx(space_ev100(in_space.luminance()))
