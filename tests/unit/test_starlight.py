"""Stars in pictures: flux, place, dimming, and the pixels around them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nebulae import component, dusty_sphere, flat
from scipy.integrate import quad

import skyscatter
from skyscatter.geometry.telescope import Telescope
from skyscatter.lights import PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import Sphere
from skyscatter.solvers.starlight import beside_stars, close_correction, star_images
from skyscatter.space import SpaceScene, View
from skyscatter.starfield import StarField

WL = np.array([500.0, 600.0])


def flux(picture: Any, camera: Telescope, view: View) -> Any:
    """Light of a whole picture [W m-2 nm-1]."""
    return np.einsum("yxw,yx->w", picture, camera.pixel_solid_angle(view))


@pytest.mark.parametrize("width", [32, 33])
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.31, -0.22, 0.1)])
def test_a_star_keeps_its_flux_and_its_place(width: int, place: tuple[float, float, float]) -> None:
    scene = dusty_sphere(0.7, stars=(PointStar(spectrum=flat(2.0), position=place),))
    camera = Telescope.from_length(width, width, 3.0, 100.0)
    picture = star_images(scene, camera, WL)
    offset = np.array(place) - scene.view.position
    distance = np.linalg.norm(offset)
    inside = scene.medium.fields[0].column(place, scene.view.position)
    expected = 2.0 / (4 * np.pi * distance**2) * np.exp(-0.7 * inside)
    assert flux(picture, camera, scene.view) == pytest.approx([expected, expected], rel=1e-9)
    x, y = camera.pixel(offset[None] / distance, scene.view)
    weight = picture[..., 0] * camera.pixel_solid_angle(scene.view)
    rows, columns = np.mgrid[:width, :width]
    assert np.sum(weight * columns) / weight.sum() == pytest.approx(x[0], abs=1e-6)
    assert np.sum(weight * rows) / weight.sum() == pytest.approx(y[0], abs=1e-6)


@pytest.mark.parametrize("across", [-7.95, -7.6, 7.5, 7.99])
def test_a_star_at_the_border_keeps_its_flux(across: float) -> None:
    """It is seen as far as the edge of the last pixel, 8 from the middle; what lies beyond is not in the picture."""
    camera = Telescope.from_length(16, 16, 16.0, 1e5)
    star = PointStar(spectrum=flat(1.0), position=(across, 0.0, 2.0))
    scene = dusty_sphere(1.0, stars=(star,), view=View(distance=1e5))
    seen = flux(star_images(scene, camera, WL), camera, scene.view) * 4 * np.pi * 1e10
    assert seen == pytest.approx([1.0, 1.0], rel=1e-4)  # 2 m nearer than the middle, and pixels seen obliquely: 4e-5


def test_a_star_in_front_is_not_dimmed_and_one_behind_is() -> None:
    camera = Telescope.from_length(16, 16, 3.0, 100.0)
    found = []
    for z in (2.0, -2.0):
        scene = dusty_sphere(1.0, stars=(PointStar(spectrum=flat(1.0), position=(0, 0, z)),))
        found.append(flux(star_images(scene, camera, WL), camera, scene.view)[0] * 4 * np.pi * (100 - z) ** 2)
    assert found == pytest.approx([1.0, np.exp(-2.0)], rel=1e-9)


def test_background_stars_are_reddened_by_the_dust_before_them() -> None:
    field = StarField(count_per_square_degree=2000.0, limiting_magnitude=18.0, seed=3)
    clear = SpaceScene(
        medium=Medium(components=(component(Sphere(radius=10.0), 0.0),)), star_field=field, view=View(distance=100.0)
    )
    dusty = clear.model_copy(update={"medium": Medium(components=(component(Sphere(radius=10.0), 0.1),))})
    camera = Telescope.from_length(64, 64, 1.0, 100.0)
    plain, dimmed = star_images(clear, camera, WL), star_images(dusty, camera, WL)
    assert np.count_nonzero(plain[..., 0]) > 100
    # The sphere is so wide that every line of sight takes nearly its diameter of optical depth 2; at the corners, where
    # lines pass 0.07 of the radius from the middle, 0.5 % less light is lost.
    ratio = dimmed[plain > 0] / plain[plain > 0]
    assert ratio == pytest.approx(np.full(ratio.shape, np.exp(-2.0)), rel=6e-3)


def test_pixels_near_a_star_are_averaged_over() -> None:
    scene = dusty_sphere(0.2)
    # An even size: the star stands on the corner of four pixels, whose middles lie half a pixel's diagonal away.
    camera = Telescope.from_length(16, 16, 1.6, 100.0)
    grid = beside_stars(scene, camera, camera.directions(scene.view))
    correction = close_correction(scene, camera, grid, WL, 1e-4)
    assert correction is not None
    near, change = correction
    assert near.sum() == 16
    middle = skyscatter.render(scene, camera, WL, solver="single", parts=True).layers["scattered"]

    def line(b: float) -> float:
        half = np.sqrt(1 - b * b)

        def light(t: float) -> float:
            return np.exp(-0.2 * (half - t) - 0.2 * np.hypot(b, t)) * 0.6 * 0.2 / (16 * np.pi**2 * (b * b + t * t))

        return float(quad(light, -half, half, points=[0.0], epsrel=1e-9, limit=200)[0])

    # Over the pixel, in polar coordinates about the star, 1 / b is cancelled by the area's b.
    side = 0.1
    angles = (np.arange(40) + 0.5) / 40 * np.pi / 4
    total = 0.0
    for angle in angles:
        reach = side / np.cos(angle)
        total += 2 * quad(lambda b: b * line(b), 0, reach, epsrel=1e-6)[0] * (np.pi / 4 / 40)
    # Light times distance changes by 1 % over a part of a pixel, and its mean is taken at the middle.
    assert middle[7, 7, 0] == pytest.approx(total / side**2, rel=1e-3)
    assert np.all(change[:, 0] > 0)


def test_a_star_on_the_middle_of_a_pixel_is_no_firefly() -> None:
    scene, wl = dusty_sphere(0.5), [500.0]
    odd, fine = (
        skyscatter.render(scene, Telescope.from_length(n, n, 1.5, 100.0), wl, solver="single", parts=True)
        for n in (15, 30)
    )
    # The middle pixel of the one picture is four of the other's, which are half as wide.
    one, four = odd.layers["scattered"][7, 7, 0], fine.layers["scattered"][14:16, 14:16, 0].mean()
    assert one == pytest.approx(four, rel=2e-3)


def test_no_star_no_correction() -> None:
    scene = dusty_sphere(0.2, stars=(PointStar(spectrum=flat(1.0), position=(50.0, 0, 0)),))
    camera = Telescope.from_length(8, 8, 2.0, 100.0)
    assert close_correction(scene, camera, camera.directions(scene.view), WL, 1e-3) is None
