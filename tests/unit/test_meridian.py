"""The meridian frame: perpendicular, upright, right-handed with the light, defined everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.geometry.meridian import meridian_frame
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

R = 6371e3


def test_frame_is_orthonormal_and_right_handed_with_the_light() -> None:
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(200, 3)) * R
    sights = rng.normal(size=(200, 3))
    sights /= np.linalg.norm(sights, axis=-1, keepdims=True)
    v, left = meridian_frame(origins, sights)
    np.testing.assert_allclose(np.linalg.norm(v, axis=-1), 1.0, atol=1e-14)
    for a, b in ((v, sights), (left, sights), (v, left)):
        np.testing.assert_allclose(np.sum(a * b, axis=-1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(v, left), -sights, atol=1e-12)
    # In the meridian plane, on the upper side.
    up = origins / np.linalg.norm(origins, axis=-1, keepdims=True)
    assert np.all(np.sum(v * up, axis=-1) > 0)
    np.testing.assert_allclose(np.sum(left * up, axis=-1), 0.0, atol=1e-12)


def test_left_is_left() -> None:
    """Looking north, west is to the left; looking west, south is."""
    sights = direction_from_azimuth_elevation([0.0, 270.0], 20.0)
    _, left = meridian_frame([0.0, 0.0, R], sights)
    np.testing.assert_allclose(left, [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], atol=1e-12)


def test_straight_up_and_down_north_is_upright() -> None:
    v, left = meridian_frame([0.0, 0.0, R], [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(v, [[0, 1, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(left, [[1, 0, 0], [-1, 0, 0]], atol=1e-15)
    # The limit of looking up ever more steeply in the south.
    near, _ = meridian_frame([0.0, 0.0, R], direction_from_azimuth_elevation(180.0, 89.9999))
    np.testing.assert_allclose(near, [0, 1, 0], atol=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_where_north_itself_is_vertical(sign: float) -> None:
    v, left = meridian_frame([0.0, sign * R, 0.0], [0.0, sign, 0.0])
    np.testing.assert_allclose(v, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(left), 1.0)
