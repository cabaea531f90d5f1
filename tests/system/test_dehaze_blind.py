"""A small image of known ground, rendered by random walks, dehazed: what `benchmarks/dehaze_blind.py` does at length.

The walks share nothing with the tables by which haze is taken off but the optics of air and aerosol.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from dehaze_judged import given, judge, with_true_surroundings
from dehaze_scenes import BlindScene, render

pytestmark = pytest.mark.slow

#: What is asked for where the haze is known.
NEAR = 0.002


@cache
def scene() -> dict[str, Any]:
    """Farmland under moderate haze in blue, red, near and short-wave infrared; 5 km wide."""
    return render(
        BlindScene(
            landscape="farmland", aerosol="continental", aod=0.2, sun_zenith_deg=35.0, size=24, cell_size_m=200.0,
            bands=(492.4, 664.6, 832.8, 2202.4), walks=1 << 16, seed=3,
        )
    )  # fmt: skip


def noise() -> np.ndarray:
    """Standard error of the image as it appears on the ground (band,): most of it is common to all pixels."""
    # Less light comes from the ground than arrives: no more than a quarter is lost here on the straight way.
    worst: np.ndarray = scene()["standard_error"].max(axis=(1, 2)) / 0.75
    return worst


def test_the_model_of_a_pixel_with_its_true_haze_and_surroundings() -> None:
    error = with_true_surroundings(scene())
    assert np.all(np.abs(error.mean(axis=(1, 2))) < 0.0005 + 3 * noise())
    assert np.all(np.sqrt((error**2).mean(axis=(1, 2))) < NEAR)
    assert np.mean(np.abs(error) <= NEAR + 3 * noise()[:, None, None]) > 0.99


def test_with_the_haze_given() -> None:
    judged = judge(scene(), **given(scene()))
    # What lies beyond a picture of 5 km is not known: no more can be asked of every pixel than the wider bar.
    assert judged.good.all()
    assert np.all(np.sqrt((judged.error**2).mean(axis=(1, 2))) < 2 * NEAR)
    assert judged.covered(0.95) >= 0.9


def test_with_the_amount_estimated() -> None:
    judged = judge(scene(), aerosol="continental")
    assert judged.good.mean() >= 0.9
    assert abs(judged.aod - judged.true_aod) <= 2 * judged.aod_sigma
    assert judged.aod_sigma < 0.5 * judged.true_aod  # it says something
    assert judged.covered(0.95) >= 0.9


def test_a_wrong_amount_is_found_out() -> None:
    """The bars can fail: with half of the haze left in, hardly a pixel of the blue is good."""
    judged = judge(scene(), aod=0.1, aerosol="continental")
    assert judged.good[0].mean() < 0.5
    assert judged.error[0].mean() > 0.005
