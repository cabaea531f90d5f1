"""Noise taken off the light of lamps at nodes over the sky."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.solvers.townfit import smoothed

ELEVATION, AZIMUTH = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 8), indexing="ij")
#: Bright at the horizon on the lamp's side, as towns are, and one light at the zenith.
TRUTH = np.exp(-3 * ELEVATION - (1 - ELEVATION) * 4 * AZIMUTH**3.6)[..., None] * np.array([1.0, 0.3])


def noisy(relative: float, seed: int):
    """Means of walks whose errors are skewed as those of walks are."""
    rng = np.random.default_rng(seed)
    width = np.sqrt(np.log1p(relative**2))
    draw = np.exp(width * rng.standard_normal((*TRUTH.shape[:2], 1)) - width**2 / 2)
    return TRUTH * draw, relative * TRUTH * draw


def test_what_has_no_noise_stays() -> None:
    found = smoothed(TRUTH, 1e-4 * TRUTH)
    # Nodes count as known to 1 %; what the smoothing may take of so smooth a light is less.
    np.testing.assert_allclose(np.exp(found.logarithm), TRUTH, rtol=0.01)


@pytest.mark.parametrize("relative", [pytest.param(0.1, marks=pytest.mark.slow), 0.3])
def test_noise_goes_and_the_error_covers(relative: float) -> None:
    seeds = range(30)
    ratio, error = [], []
    for seed in seeds:
        found = smoothed(*noisy(relative, seed))
        ratio.append(np.exp(found.logarithm) / TRUTH)
        error.append(found.relative)
    ratios, errors = np.array(ratio), np.array(error)
    # A third of the noise or less is left in the mean, and no bias beyond a quarter of it.
    assert np.sqrt(np.mean((ratios - 1) ** 2)) < 0.5 * relative
    assert abs(ratios.mean() - 1) < 0.25 * relative
    inside = np.mean(np.abs(ratios - 1) < 2 * errors)
    # 95 % of some 30 times 12 independent numbers, less three standard deviations of that share.
    assert inside > 0.91
    assert errors.mean() < relative


def test_all_azimuths_are_one_at_the_zenith() -> None:
    found = smoothed(*noisy(0.3, 5))
    assert np.ptp(found.logarithm[-1], axis=0) == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("node", [(3, 4), *(pytest.param(n, marks=pytest.mark.slow) for n in ((0, 7), (0, 0), (6, 2)))])
def test_neighbours_tell_of_a_node_where_nothing_was_found(node: tuple[int, int]) -> None:
    """Walks that find nothing state no error either: that is no knowledge of darkness."""
    ratio, error = [], []
    for seed in range(30):
        mean, spread = noisy(0.1, seed)
        mean[node], spread[node] = 0.0, 0.0
        found = smoothed(mean, spread)
        ratio.append(np.exp(found.logarithm[node]) / TRUTH[node])
        error.append(found.relative[node])
    ratios, errors = np.array(ratio), np.array(error)
    # As little bias as nodes that are met may have; taken for dark the node has up to 0.33 of it, and 0 % are covered.
    assert abs(ratios.mean() - 1) < 0.25 * 0.1
    # 95 % of 30 draws, less three standard deviations of that share (both wavelengths have the same noise).
    assert np.mean(np.abs(ratios - 1) < 2 * errors) > 0.83


def test_errors_cover_where_few_walks_find_light() -> None:
    """Three walks a node find light on average, and at 5 % of the nodes none does."""
    inside = []
    for seed in range(30):
        count = np.random.default_rng(seed).poisson(3.0, (*TRUTH.shape[:2], 1))
        found = smoothed(TRUTH * count / 3.0, TRUTH * np.sqrt(count) / 3.0)
        inside.append(np.abs(np.exp(found.logarithm) / TRUTH - 1) < 2 * found.relative)
    # As for other noise above; where nodes without light are taken for dark, 87 %.
    assert np.mean(inside) > 0.91


def test_no_light_at_all_is_no_end() -> None:
    found = smoothed(np.zeros_like(TRUTH), np.zeros_like(TRUTH))
    assert np.all(np.isfinite(found.logarithm))
    assert np.all(np.exp(found.logarithm) < 1e-200)
