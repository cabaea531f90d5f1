"""The fit over an observer's sky: known functions, noise that its error covers, and what it cannot follow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.skyfit import Side, fit

Array = NDArray[np.float64]


def everywhere(count: int = 400) -> Array:
    """Directions above the horizon, evenly over heights and azimuths."""
    elevation = 0.5 * np.pi * ((np.arange(count) + 0.5) / count) ** 2
    turn = 2 * np.pi * (np.arange(count) * 0.618034 % 1.0)
    level = np.cos(elevation)
    return np.stack([level * np.sin(turn), level * np.cos(turn), np.sin(elevation)], axis=1)


def smooth(directions: Array) -> Array:
    """Bright at the horizon, with a bright side, in two colours."""
    x, y, z = directions.T
    glow = 1.0 / (z + 0.1) * (1.0 + 0.3 * x + 0.1 * (y**2 - x**2))
    return np.stack([glow, 2.0 + glow], axis=1)


def test_a_smooth_sky_is_found_again() -> None:
    side = Side(0.0, 1)
    known = smooth(side.rays)
    found, relative = fit(side, known, 1e-6 * known, everywhere())
    expected = smooth(everywhere())
    # cubics through 14 rings over a factor of 11
    np.testing.assert_allclose(found, expected, rtol=5e-3)
    # the error that is stated where there is no noise covers what is missed
    assert np.abs(found / expected - 1.0).max() < 4.0 * relative.max()
    assert relative.max() < 0.01


def test_noise_goes_through_the_fit() -> None:
    side, places = Side(-0.02, 1), everywhere()
    known, expected = smooth(side.rays), smooth(places)
    rng = np.random.default_rng(4)
    off = []
    for _ in range(30):
        noisy = known * (1.0 + 0.05 * rng.standard_normal(known.shape))
        found, relative = fit(side, noisy, 0.05 * known, places)
        off.append((found / expected - 1.0) / relative)
    spread = np.sqrt(np.mean(np.square(off)))
    # 30 fits of some 50 numbers in two colours: 2 per cent by chance; the error of a ring stands for all its azimuths
    assert 0.8 < spread < 1.15
    # a fit of some 50 functions to 280 nodes
    assert relative.mean() < 0.5 * 0.05


def test_what_cannot_be_followed_is_in_the_error() -> None:
    side, places = Side(0.0, 1), everywhere()

    def rough(directions: Array) -> Array:
        turn = np.arctan2(directions[:, 0], directions[:, 1])
        return smooth(directions) * (1.0 + 0.2 * np.cos(8 * turn) * np.hypot(*directions[:, :2].T))[:, None]

    found, relative = fit(side, rough(side.rays), 0.01 * rough(side.rays), places)
    off = found / rough(places) - 1.0
    # waves of 45 degrees and 20 % height, of which nothing is followed: 14 % in the mean
    assert np.sqrt(np.mean(off**2)) > 0.08
    assert np.sqrt(np.mean((off / relative) ** 2)) < 1.5


def test_a_dark_sky_stays_dark() -> None:
    side = Side(0.0, -1)
    dark = np.zeros((len(side.rays), 2))
    found, relative = fit(side, dark, dark, -everywhere())
    assert np.isfinite(relative).all()
    assert np.abs(found).max() < 1e-200
