"""The middle of a round cloud, from one image."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.centre import find_centre
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics

Y, X = np.indices((48, 56))
FORMS = {
    "ball": lambda r: np.exp(-((r / 9) ** 2)),
    "shell": lambda r: np.exp(-(((r - 14) / 3) ** 2)),
    "cusp": lambda r: 1 / (1 + r / 3),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("middle", [(27.3, 22.8), (20.0, 30.0), (3.4, 8.1)])
def test_the_middle_is_found_within_half_a_pixel(form: str, middle: tuple[float, float]) -> None:
    misses = []
    for seed in range(5):
        image = FORMS[form](np.hypot(X - middle[0], Y - middle[1]))
        noisy = image + 0.03 * np.random.default_rng(seed).normal(size=image.shape)
        found = find_centre(noisy, 0.03)
        misses.append(np.array([found.x - middle[0], found.y - middle[1]]) / found.deviation)
        assert np.hypot(found.x - middle[0], found.y - middle[1]) < 0.5
    # Ten numbers: their root mean square is known to 22 %, the profile's cells add a little.
    assert 0.2 < np.sqrt(np.mean(np.square(misses))) < 1.9


def test_scattered_light_of_a_dusty_sphere_seen_from_one_side() -> None:
    frame, place = VoxelFrame.cube(24, 1.0), np.array([0.13, -0.21, 0.1])
    cloud = np.exp(-np.sum((frame.middles() - place) ** 2, axis=-1) / 0.15)
    model = VoxelModel(frame, VoxelOptics.make(0.6, 2.0), VoxelLights.stars([place], [[1.0]]), np.zeros(1))
    a = ((np.arange(48) + 0.5) / 48 * 2 - 1) * 1.2
    origins = np.stack([*np.meshgrid(a, a), np.full((48, 48), 5.0)], axis=-1).reshape(-1, 3)
    image = model.image(cloud, origins, np.array([[0.0, 0.0, -1.0]])).reshape(48, 48)
    sigma = 0.02 * image + 0.01 * image.mean()
    found = find_centre(image + sigma * np.random.default_rng(1).normal(size=image.shape), sigma)
    exact = (place[:2] + 1.2) / 2.4 * 48 - 0.5
    assert np.hypot(found.x - exact[0], found.y - exact[1]) < 0.5


def test_unknown_noise_and_missing_pixels() -> None:
    image: Any = FORMS["ball"](np.hypot(X - 27.3, Y - 22.8))
    noisy = image + 0.02 * np.random.default_rng(0).normal(size=image.shape)
    known = find_centre(noisy, 0.02)
    noisy[10:14, 20:30] = np.nan
    found = find_centre(noisy)
    assert np.hypot(found.x - 27.3, found.y - 22.8) < 0.5
    assert found.deviation == pytest.approx(known.deviation, rel=0.3)


def test_images_without_a_middle_are_refused() -> None:
    with pytest.raises(ConvergenceError, match="no middle"):
        find_centre(np.ones((20, 20)))
    with pytest.raises(DomainError, match="image"):
        find_centre(np.ones((3, 20)))
