"""Unit tests of how the error of a deterministic solution is estimated."""

import numpy as np
import pytest

from skyscatter.solvers.estimate import lowest_point, turned

R = 6.371e6


@pytest.mark.parametrize(
    ("altitude", "elevation", "lowest"),
    [(0.0, 20.0, 0.0), (2.0, -5.0, 0.0), (10e3, 30.0, 10e3), (400e3, -90.0, 0.0), (400e3, -18.5, 50.1e3)],
)
def test_the_lowest_point_of_a_ray(altitude: float, elevation: float, lowest: float) -> None:
    origin = np.array([0.0, 0.0, R + altitude])
    direction = np.array([0.0, np.cos(np.radians(elevation)), np.sin(np.radians(elevation))])
    assert np.linalg.norm(lowest_point(origin, direction, R)) - R == pytest.approx(lowest, rel=0.01, abs=0.01)


@pytest.mark.parametrize("elevation", [30.0, -3.0, -18.0, -60.0])
@pytest.mark.parametrize("altitude", [0.0, 10e3, 400e3])
def test_turned_rays_see_the_same_air_under_the_same_sun(altitude: float, elevation: float) -> None:
    origin = np.array([0.0, 0.0, R + altitude])
    direction = np.array([0.0, np.cos(np.radians(elevation)), np.sin(np.radians(elevation))])
    sun = np.array([0.36, 0.48, 0.8])
    at = lowest_point(origin, direction, R)
    origins, directions = turned(origin, direction, R, 3)
    closest = np.linalg.norm(np.cross(origin, direction))
    for o, d in zip(origins, directions, strict=True):
        np.testing.assert_allclose(np.linalg.norm(o), np.linalg.norm(origin), rtol=1e-15)
        np.testing.assert_allclose(np.linalg.norm(np.cross(o, d)), closest, rtol=1e-12)
        np.testing.assert_allclose(lowest_point(o, d, R) @ sun, at @ sun, rtol=1e-6)
        assert d @ direction < 1 - 1e-3
    assert len(turned(origin, direction, R, 0)[0]) == 0
