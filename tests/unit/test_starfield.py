"""Background stars: how many, how bright, where, and the same ones again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bases import complaint

from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK
from skyscatter.starfield import StarField, Stars

FIELD = StarField(count_per_square_degree=20000.0, limiting_magnitude=19.0, seed=4)


def rows(stars: Stars) -> set[tuple[float, ...]]:
    return set(zip(*(column.tolist() for column in stars), strict=True))


@pytest.mark.parametrize("view", [(1.0, 1.0), (0.37, 1.9)])
def test_count(view: tuple[float, float]) -> None:
    expected = 20000 * view[0] * view[1]
    count = FIELD.stars(view).magnitude.size
    assert abs(count - expected) < 4 * np.sqrt(expected)  # Poisson: four standard deviations, fixed seed


def test_slope_of_the_counts() -> None:
    for slope in (0.3, 0.6):
        stars = FIELD.model_copy(update={"slope": slope}).stars((1.5, 1.5))
        below = FIELD.limiting_magnitude - stars.magnitude
        assert below.min() >= 0
        # Exponential in magnitude: its mean is 1 / (slope ln 10), known to 1 / sqrt(N).
        mean = 1 / (slope * np.log(10))
        assert below.mean() == pytest.approx(mean, rel=4 / np.sqrt(below.size))
        ratio = np.sum(below > 2) / below.size
        assert ratio == pytest.approx(10 ** (-2 * slope), rel=4 / np.sqrt(ratio * below.size))


def test_uniform_over_the_field() -> None:
    stars = FIELD.stars((2.0, 1.0))
    counts, *_ = np.histogram2d(stars.x_deg, stars.y_deg, bins=(8, 4), range=[[-1, 1], [-0.5, 0.5]])
    expected = counts.mean()
    # Poisson counts in 32 cells: chi-square of 31 degrees of freedom, below 61 in 999 of 1000.
    assert np.sum((counts - expected) ** 2) / expected < 61.1


def test_temperatures() -> None:
    log = np.log10(FIELD.stars((1.0, 1.0)).temperature)
    assert log.mean() == pytest.approx(np.log10(5250.0), abs=4 * 0.1 / np.sqrt(log.size))
    assert log.std() == pytest.approx(0.1, rel=0.03)  # cut at three standard deviations: 1.3 % less; 0.7 % noise
    single = FIELD.model_copy(update={"temperature_spread": 0.0}).stars((0.2, 0.2))
    np.testing.assert_allclose(single.temperature, 5250.0)


def test_same_seed_same_sky_and_a_wider_view_keeps_it() -> None:
    narrow, again, wide = FIELD.stars((0.3, 0.2)), FIELD.stars((0.3, 0.2)), FIELD.stars((0.8, 0.31))
    assert rows(narrow) == rows(again)
    assert rows(narrow) < rows(wide)
    within = (np.abs(wide.x_deg) <= 0.15) & (np.abs(wide.y_deg) <= 0.1)
    assert within.sum() == narrow.x_deg.size


def test_other_seed_other_sky() -> None:
    other = FIELD.stars((0.3, 0.2), seed=5)
    assert not rows(other) & rows(FIELD.stars((0.3, 0.2)))
    assert rows(other) == rows(FIELD.model_copy(update={"seed": 5}).stars((0.3, 0.2)))


def test_cells_are_independent() -> None:
    """No star of one cell comes back, shifted, in another."""
    stars = FIELD.stars((1.0, 1.0))
    assert np.unique(stars.magnitude).size == stars.magnitude.size


def test_density_on_the_sky_of_a_wide_field() -> None:
    """The tangent plane stretches: within 40 degrees of the centre lie 2 pi (1 - cos 40) of the sky."""
    field = StarField(count_per_square_degree=5.0, limiting_magnitude=12.0)
    edge = np.degrees(np.tan(np.radians(40.0)))
    stars = field.stars((2 * edge, 2 * edge))
    count = np.sum(np.hypot(stars.x_deg, stars.y_deg) <= edge)
    expected = 5.0 * 2 * np.pi * (1 - np.cos(np.radians(40.0))) * np.degrees(1.0) ** 2
    assert abs(count - expected) < 4 * np.sqrt(expected)


def test_brightest_first_and_bounded() -> None:
    stars = FIELD.model_copy(update={"brightest_magnitude": 14.0}).stars((1.0, 1.0))
    assert np.all(np.diff(stars.magnitude) >= 0)
    assert stars.magnitude[0] >= 14.0
    every = FIELD.stars((1.0, 1.0))
    assert rows(stars) == {row for row in rows(every) if row[2] >= 14.0}
    assert every.magnitude[0] < 14.0


def test_fluxes() -> None:
    stars = FIELD.stars((0.1, 0.1))
    wl = np.array([440.0, 550.0, 800.0])
    flux = stars.fluxes(wl)
    assert flux.shape == (stars.magnitude.size, 3)
    np.testing.assert_allclose(flux[:, 1], 3.631e-11 * 10 ** (-0.4 * stars.magnitude), rtol=1e-12)
    x = PLANCK * LIGHT / (wl * 1e-9 * BOLTZMANN * stars.temperature[:, None])
    shape = 1 / (wl**5 * np.expm1(x))
    np.testing.assert_allclose(flux / flux[:, 1:2], shape / shape[:, 1:2], rtol=1e-12)


def test_an_empty_field_is_empty() -> None:
    stars = StarField(count_per_square_degree=1e-6, limiting_magnitude=3.0).stars((0.01, 0.01))
    assert stars.magnitude.size == 0
    assert stars.fluxes([500.0, 600.0]).shape == (0, 2)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"limiting_magnitude": 19.0}, "count_per_square_degree is missing"),
        ({"count_per_square_degree": 0.0, "limiting_magnitude": 19.0}, "count_per_square_degree"),
        ({"count_per_square_degree": 1.0, "limiting_magnitude": 19.0, "slope": 0.0}, "slope"),
        (
            {"count_per_square_degree": 1.0, "limiting_magnitude": 9.0, "brightest_magnitude": 9.0},
            "brightest_magnitude",
        ),
        ({"count_per_square_degree": 1.0, "limiting_magnitude": 9.0, "temperature_spread": 3.0}, "temperature_spread"),
    ],
)
def test_refuses(fields: dict[str, Any], word: str) -> None:
    assert word in complaint(lambda: StarField(**fields))


def test_refuses_fields_of_view() -> None:
    assert "width = 0.0" in complaint(lambda: FIELD.stars((0.0, 1.0)))
    assert "at most 5e6" in complaint(lambda: FIELD.stars((60.0, 60.0)))
