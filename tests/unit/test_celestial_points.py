"""Point sources in pictures keep their light and their place, in every camera and at every edge."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.celestial.points import draw_points
from skyscatter.errors import DomainError
from skyscatter.geometry.camera import Fisheye, Panorama, Perspective
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

CAMERAS = [
    Panorama(width=96, height=48),
    Panorama(width=96, height=24, elevation_min_deg=0.0, centre_azimuth_deg=30.0),
    Fisheye(width=65, height=64),
    Fisheye(width=64, height=64, projection="equisolid", fov_deg=120.0),
    Perspective(width=80, height=60, azimuth_deg=200.0, elevation_deg=30.0, fov_deg=70.0),
]


def sources(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, rng.random((count, 4))


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: f"{camera.kind}-{camera.height}")
@pytest.mark.parametrize("fwhm", [0.0, 0.3, 1.5, 6.0])
def test_light_is_kept(camera, fwhm) -> None:
    directions, light = sources()
    # the poles, the horizon, both sides of the cut of a panorama
    special = direction_from_azimuth_elevation(
        [0, 10, 10, 179.999, 180.0, -150.001], [90, 89.9, -89.99, 0.0, 40.0, 20.0]
    )
    directions, light = np.concatenate([directions, special]), np.concatenate([light, np.ones((6, 4))])
    seen = np.isfinite(camera.pixel(directions)[0])
    cube = draw_points(camera, None, directions, light, fwhm)
    total = (cube * camera.pixel_solid_angle()[..., None]).sum(axis=(0, 1))
    # rounding of some hundred terms
    assert total == pytest.approx(light[seen].sum(axis=0), rel=1e-12)
    assert np.all(cube >= 0.0)


def test_each_at_the_rim_keeps_its_light() -> None:
    camera = Fisheye(width=64, height=64)
    rim = direction_from_azimuth_elevation(np.arange(0.0, 360.0, 0.7), np.full(515, 0.02))
    for fwhm in (0.0, 0.2, 1.5):
        for one in rim[::40]:
            cube = draw_points(camera, None, one[None], [[1.0]], fwhm)
            assert (cube[..., 0] * camera.pixel_solid_angle()).sum() == pytest.approx(1.0, rel=1e-12)


def test_image_is_a_gaussian_about_its_place() -> None:
    camera = Perspective(width=81, height=61, azimuth_deg=0.0, elevation_deg=20.0, fov_deg=10.0)
    towards = camera.through(40.3, 29.8)
    light = draw_points(camera, None, towards[None], [[1.0]], 4.0)[..., 0] * camera.pixel_solid_angle()
    rows, columns = np.mgrid[:61, :81]
    # the cut at 0.001 and pixels' sides: some hundredths of a pixel at most
    assert (light * columns).sum() == pytest.approx(40.3, abs=0.01)
    assert (light * rows).sum() == pytest.approx(29.8, abs=0.01)
    spread = np.sqrt((light * (columns - 40.3) ** 2).sum())
    # the Gaussian's sigma and a pixel's own variance of 1/12, less the cut
    assert spread == pytest.approx(np.sqrt((4.0 / 2.3548) ** 2 + 1 / 12), rel=0.01)


def test_panorama_goes_on_at_its_other_side() -> None:
    camera = Panorama(width=36, height=18)
    towards = camera.through(-0.5, 8.0)  # on the cut itself
    light = draw_points(camera, None, towards[None], [[1.0]], 3.0)[..., 0]
    assert light[:, 0] == pytest.approx(light[:, -1])
    assert light[8, 0] == light.max()
    # a picture that does not close is cut
    flat = Perspective(width=36, height=18, azimuth_deg=0.0, elevation_deg=0.0, fov_deg=40.0)
    cut = draw_points(flat, None, flat.through(-0.49, 8.0)[None], [[1.0]], 3.0)[..., 0]
    assert cut[:, -4:].max() == 0.0
    assert (cut * flat.pixel_solid_angle()).sum() == pytest.approx(1.0, rel=1e-12)


def test_what_is_not_seen_is_not_drawn() -> None:
    camera = Perspective(width=40, height=30, azimuth_deg=0.0, elevation_deg=20.0, fov_deg=10.0)
    cube = draw_points(camera, None, [[0.0, -1.0, 0.0]], [[1.0, 2.0]])
    assert cube.shape == (30, 40, 2)
    assert not cube.any()
    assert not draw_points(camera, None, np.zeros((0, 3)), np.zeros((0, 2))).any()


@pytest.mark.parametrize(
    ("directions", "light", "fwhm", "words"),
    [
        ([1.0, 0.0, 0.0], [[1.0]], 1.5, "directions"),
        ([[1.0, 0.0, 0.0]], [[1.0], [2.0]], 1.5, "irradiance"),
        ([[1.0, 0.0, 0.0]], [[1.0]], -1.0, "fwhm_pixels"),
        ([[1.0, 0.0, 0.0]], [[1.0]], np.nan, "fwhm_pixels"),
    ],
)
def test_bad_input_is_named(directions, light, fwhm, words) -> None:
    with pytest.raises(DomainError, match=words):
        draw_points(CAMERAS[0], None, directions, light, fwhm)
