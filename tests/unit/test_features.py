"""What a camera sees first, by which a denoiser tells edges from noise."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from nebulae import component
from worlds import HOUSE, directions, sky

import skyscatter
from skyscatter import Medium, SpaceScene, fields
from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage
from skyscatter.solvers.base import Rays
from skyscatter.solvers.features import SOFT, first_sight
from skyscatter.surfaces import Body, Interface, Lambert, Mosaic, Rectangle, Sphere, SurfaceScene, Viewpoint

WL = np.array([550.0])
BALL = Body(name="ball", shape=Sphere(position=(0, 5, 0), radius=2), material=Lambert(albedo=0.4))


def seen(scene: Any, d: Any, origin: Any = None) -> Any:
    """What rays from the observer see first."""
    d = np.atleast_2d(np.asarray(d, float))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    origins = np.broadcast_to(scene.observer.position if origin is None else origin, d.shape)
    return first_sight(scene, Rays(origins, d, np.arange(len(d))), WL)


def room(*bodies: Body, **more: Any) -> SurfaceScene:
    return SurfaceScene(bodies=bodies, viewpoint=Viewpoint(position=(0, 0, 0), target=(0, 1, 0)), **more)


def test_a_ball_and_nothing_beside_it() -> None:
    found = seen(room(BALL), [[0, 1, 0], [0.3, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(found[0], [0.4, 0, -1, 0], atol=1e-7)
    # The near one of the two points in which a line meets the ball.
    d = np.array([0.3, 1, 0]) / np.hypot(0.3, 1)
    t = 5 * d[1] - np.sqrt((5 * d[1]) ** 2 - 21)
    np.testing.assert_allclose(found[1], [0.4, *(t * d - [0, 5, 0]) / 2], atol=1e-6)
    assert not found[2].any()


def test_fog_hides_what_lies_in_it_and_an_interface_nothing() -> None:
    """Through 3 m of fog of 0.2 per metre exp(-0.6) is left of a ball, whatever bounds the fog."""
    fog = skyscatter.Component(
        name="fog",
        density={"kind": "everywhere"},
        optics={"kind": "particles", "extinction": 0.2, "phase": {"kind": "isotropic"}},
    )
    media = (skyscatter.SurfaceMedium(name="fog", components=(fog,)),)
    around = Body(name="room", shape=Sphere(position=(0, 0, 0), radius=50), material=Interface(), inside="fog")
    # Another ball of the same fog on the way: its boundary is none.
    pane = Body(name="pane", shape=Sphere(position=(0, 1.5, 0), radius=0.5), material=Interface(), inside="fog")
    found = seen(room(BALL, around, pane, media=media), [0, 1, 0])
    np.testing.assert_allclose(found[0], np.exp(-0.6) * np.array([0.4, 0, -1, 0]), rtol=1e-6, atol=1e-7)


def test_a_mosaic_by_its_cells_and_a_sheet_from_either_side() -> None:
    tiles = Mosaic(classes=[[0, 1]], materials=(Lambert(albedo=0.1), Lambert(albedo=0.8)), rest=Lambert(), cell_size=4)
    floor = Body(name="floor", shape=Rectangle(position=(0, 0, -2), size=(16, 16)), material=tiles)
    found = seen(room(floor), [[-1, 0, -1], [1, 0, -1]])
    np.testing.assert_allclose(found[:, 0], [0.1, 0.8], atol=1e-7)
    np.testing.assert_allclose(np.abs(found[:, 3]), 1.0)
    below = seen(room(floor), [0, 0, 1], origin=np.array([0.0, 0.0, -5.0]))
    np.testing.assert_allclose(below[0, 1:], -found[0, 1:], atol=1e-7)


@pytest.mark.parametrize("depth", [0.1, 20.0])
def test_a_globule_faces_where_its_density_falls(depth: float) -> None:
    """As bright as what it scatters of what it stops; facing the eye in its middle, away from its axis beside it."""
    dust = component(fields.GaussianSphere(width=1.0), depth / np.sqrt(2 * np.pi), albedo=0.6)
    scene = SpaceScene(medium=Medium(components=(dust,)), background=1.0)
    found = seen(scene, [[20, 0, 0], [20, 0, 1.2]], np.array([-20.0, 0.0, 0.0]))
    shown, lengths = found[:, 0] / 0.6, np.linalg.norm(found[:, 1:], axis=1)
    beside = 1.2 / np.hypot(20, 1.2) * 20
    np.testing.assert_allclose(shown, -np.expm1(-depth * np.exp(-0.5 * np.array([0, beside]) ** 2)), rtol=2e-3)
    np.testing.assert_allclose(lengths, SOFT * shown, rtol=1e-5)
    assert found[1, 3] > (0.9 if depth < 1 else 0.3) * lengths[1]
    if depth > 1:
        assert found[0, 1] < -0.99 * lengths[0]


def test_a_cloud_before_the_ground_under_a_sky() -> None:
    """Bodies and ground as under no sky; a cloud in the way of the ground counts by what it stops."""
    cloud = skyscatter.Component(
        name="cloud",
        density=fields.Sphere(radius=50.0, position=(0, 1000.0, 500.0)),
        optics={"kind": "particles", "extinction": 0.02, "phase": {"kind": "henyey-greenstein", "g": 0.85}},
    )
    scene = sky("earth-simple", 30.0, altitude=1000.0, fields=(cloud,), ground=skyscatter.Ground(albedo=0.3))
    found = seen(scene, [[0, 1000, -500], [0, -1000, -500], [0, 1000, 500]])
    np.testing.assert_allclose(found[0, 0], 0.3 * np.exp(-2) - np.expm1(-2), rtol=1e-3)
    np.testing.assert_allclose(found[1], [0.3, 0, 0, 1], atol=1e-3)
    assert not found[2].any()
    np.testing.assert_allclose(
        seen(sky("earth-simple", 30.0, bodies=(HOUSE,)), [0, 1, 0])[0], [0.6, 0, -1, 0], atol=1e-6
    )
    assert seen(sky("earth-simple", 30.0), directions()) is None


def test_pictures_have_it_whose_noise_is_to_be_taken_off() -> None:
    scene, camera = room(BALL), skyscatter.Perspective(width=9, height=7, elevation_deg=0, azimuth_deg=0, fov_deg=70)
    walks = skyscatter.Path(samples=4, seed=1)
    image = skyscatter.render(scene, camera, WL, solver=walks, halves=True, threads=2)
    assert image.features is not None
    assert image.features.shape == (7, 9, 4)
    np.testing.assert_allclose(image.features[3, 4], [0.4, 0, -1, 0], atol=1e-6)
    assert skyscatter.render(scene, camera, WL, solver=walks).features is None
    with pytest.raises(DomainError, match="features"):
        SpectralImage(image.radiance, WL, features=np.zeros((7, 9, 3)))


@pytest.mark.skipif(find_spec("pyoidn") is None, reason="pyoidn is not installed")
def test_an_edge_is_found_in_noise_where_the_scene_has_one() -> None:
    """A step of a fifth under noise of seven tenths of the light: the error beside it is less where the scene tells."""
    truth = np.ones((96, 96, 3))
    truth[:, 48:] = 0.8
    error = np.full(truth.shape, 0.7 / np.sqrt(2))
    features = np.zeros((96, 96, 4))
    features[..., 0], features[..., 2] = 0.5, -1.0
    features[:, 48:, 1:] = [1.0, 0.0, 0.0]
    left = np.zeros(2)
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        a, b = (truth + 0.7 * (rng.gamma(1.0, size=(96, 96, 1)) - 1) for _ in range(2))
        for k, known in enumerate((None, features)):
            halves = {"half_a": a, "half_b": b}
            image = SpectralImage((a + b) / 2, [450, 550, 650], error, layers=halves, features=known)
            left[k] += np.mean((image.denoised("oidn").radiance - truth)[:, 40:56] ** 2)
    assert left[1] < 0.6 * left[0]  # 0.35 to 0.45 of the squared error
