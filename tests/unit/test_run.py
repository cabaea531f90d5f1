"""What the doors `radiance` and `render` accept, and how they refuse."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.media.fields import Exponential
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers.state import Checkpoint, RenderState
from skyscatter.tasks.store import Store


@pytest.fixture(scope="module")
def scene():
    air = skyscatter.Component(
        name="air", density=Exponential(scale_height="8 km"), optics=RayleighPowerLaw(coefficient=1.2e-5)
    )
    return skyscatter.Scene(medium=skyscatter.Medium(components=(air,), planet_radius="6371 km"))


UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wavelengths": []}, "wavelengths"),
        ({"wavelengths": [500, 400]}, "increase"),
        ({"wavelengths": [-1.0]}, "positive"),
        ({"directions": [0, 0, 2.0]}, "unit vectors"),
        ({"directions": [0, 1.0]}, "shape"),
        ({"origins": [0, 0, 6.0e6]}, "inside the planet"),
        ({"solver": "magic"}, "choose from orders, path, single"),
        ({"solver": "path", "samples": 0}, "samples = 0: a whole number, at least 2"),
        ({"solver": "photons", "samples": 1}, "samples"),
        ({"solver": "path", "samples": 8, "noise": 0.1}, "not both"),
        ({"solver": "path", "noise": 2.0}, "noise"),
        ({"solver": skyscatter.Path}, "choose from"),
        ({"solver": "orders", "seed": 3}, "seed = 3: means nothing to the solver orders without an eclipse"),
        ({"max_order": 0}, "max_order"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"seed": -1}, "seed"),
        ({"threads": 0}, "threads"),
        ({"solver": "path", "sampling": "dice"}, "free-flight"),
        ({"solver": "path", "sampling": "free-flight", "noise": 0.1}, "means nothing"),
        ({"orders": 2}, "orders = 2: means nothing to the solver orders"),
        ({"tolerance": 5e-5}, "tolerance = 5e-05: a relative tolerance between 0.0001 and 0.1"),
        ({"solver": "single", "orders": 2}, "means nothing"),
    ],
)
def test_wrong_arguments_are_named(scene, changes, words):
    arguments = {"origins": scene.observer.position, "directions": UP, "wavelengths": [550.0]} | changes
    with pytest.raises(DomainError, match=words) as error:
        skyscatter.radiance(scene, **asked(**arguments))
    assert "\n" not in str(error.value)


def test_shapes_follow_the_rays(scene):
    directions = np.broadcast_to(UP, (2, 3, 3))
    answer = skyscatter.radiance(scene, scene.observer.position, directions, [450, 550], solver="single", parts=True)
    assert answer.radiance.shape == answer.standard_error.shape == (2, 3, 2)
    assert set(answer.layers) == {"direct", "scattered", "ground"}
    assert np.all(answer.standard_error == 0)
    # the same ray gives the same bits wherever it stands
    assert np.all(answer.radiance == answer.radiance[0, 0])


def test_parts_and_orders_sum_to_the_whole(scene):
    answer = skyscatter.radiance(
        scene,
        scene.observer.position,
        UP,
        [450, 550],
        solver=skyscatter.Path(samples=32, max_order=3),
        parts=True,
        orders=3,
    )
    parts = sum(answer.layers[name] for name in ("direct", "scattered", "ground", "multiple"))
    orders = sum(answer.layers[f"order{k}"] for k in (1, 2, 3)) + answer.layers["direct"]
    np.testing.assert_allclose(parts, answer.radiance, rtol=1e-12)  # rounding
    np.testing.assert_allclose(orders, answer.radiance, rtol=1e-12)  # rounding


def test_quantities_and_bare_numbers_agree(scene):
    units = pytest.importorskip("astropy.units")
    bare = skyscatter.radiance(scene, scene.observer.position, UP, [550.0], solver="single")
    unit = skyscatter.radiance(scene, scene.observer.position * units.m, UP, [0.55] * units.um, solver="single")
    np.testing.assert_allclose(bare.radiance, unit.radiance, rtol=1e-9)  # 0.55 um is 550 nm but for rounding


def test_noise_is_reached(scene):
    answer = skyscatter.radiance(scene, scene.observer.position, UP, [450, 550], solver=skyscatter.Path(noise=0.01))
    assert np.mean(answer.standard_error / answer.radiance) <= 0.01
    assert answer.samples > 0


def test_the_solar_disk_keeps_its_light_in_a_picture_of_coarse_pixels(scene):
    up = scene.model_copy(update={"sun": skyscatter.Sun(elevation_deg=40.0, azimuth_deg=180.0)})
    camera = skyscatter.Perspective(width=15, height=15, azimuth_deg=181.0, elevation_deg=39.0, fov_deg=12.0)
    image = skyscatter.render(up, camera, [450, 550, 650], solver="single", parts=True)
    collected = np.einsum("yxw,yx->w", image.layers["direct"], camera.pixel_solid_angle(up.observer))
    far = up.observer.position + up.sun.direction * 1e7
    through = skyscatter.transmittance(up, up.observer.position, far, [450, 550, 650])
    expected = up.star.irradiance([450, 550, 650], up.star_distance) * through
    # A tenth of a per cent is asked for; the air changes over the disk by its second derivative, 1e-5.
    np.testing.assert_allclose(collected, expected, rtol=1e-3)


def test_a_state_of_another_render_is_refused(tmp_path):
    state = RenderState.empty({"solver": "path", "seed": 1}, 4, 2)
    state.save(tmp_path / "a.zarr")
    again, other = (RenderState.empty({"solver": "path", "seed": seed}, 4, 2) for seed in (1, 2))
    Checkpoint(tmp_path / "a.zarr").begin(again, tmp_path / "a.zarr")
    assert not again.done.any()
    with pytest.raises(DomainError, match=r"resume = .* other seed"):
        Checkpoint(tmp_path / "a.zarr").begin(other, tmp_path / "a.zarr")
    with pytest.raises(SkyscatterError, match="no such checkpoint"):
        Checkpoint(tmp_path / "b.zarr").begin(again, tmp_path / "b.zarr")


@pytest.mark.parametrize("kind", ["file", "folder", "store"])
def test_what_is_no_checkpoint_is_neither_read_nor_replaced(kind, tmp_path):
    there = tmp_path / "mine"
    if kind == "file":
        there.write_text("years of work")
    elif kind == "folder":
        there.mkdir()
        (there / "thesis.txt").write_text("years of work")
    else:
        Store(there, {}).keep("solution", {"a": np.ones(2)})
    before = [path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()]
    state = RenderState.empty({}, 4, 2)
    with pytest.raises(DomainError, match="is no checkpoint; move it away"):
        Checkpoint(there).begin(state)
    with pytest.raises(DomainError, match="not a checkpoint of an interrupted run"):
        Checkpoint(tmp_path / "new").begin(state, there)
    assert [path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()] == before


def test_optical_depth_adds_up_and_stops_at_the_planet(scene):
    up = scene.observer.position
    end = up * 1.05
    middle = up * 1.001
    depth = partial(skyscatter.optical_depth, scene, wavelengths=[550.0])
    whole, halves = depth(up, end), depth(up, middle) + depth(middle, end)
    np.testing.assert_allclose(whole, halves, rtol=1e-9)  # accuracy of the columns
    np.testing.assert_allclose(whole, depth(end, up), rtol=1e-9)
    assert np.isinf(depth(end, -end))
    assert skyscatter.transmittance(scene, end, -end, [550.0]) == 0
    with pytest.raises(DomainError, match="inside the planet"):
        depth(up * 0.9, end)


@pytest.mark.parametrize("name", ["earth-simple", "reflection-nebula"])
def test_what_is_struck_at_its_end_goes_on_from_what_was_solved(name, tmp_path):
    """The Sun's disk and the stars are added to a picture last: kept with what was solved they would be twice in it."""
    model = skyscatter.load_model(name)
    if name == "earth-simple":
        scene = model.scene(sun_elevation_deg=10, sun_azimuth_deg=180)
        camera = skyscatter.Perspective(width=8, height=6, azimuth_deg=180, elevation_deg=10, fov_deg=20)
    else:
        scene = model.scene()
        camera = skyscatter.Telescope(width=6, height=6, pixel_scale_deg=0.1)
    kept = Checkpoint(tmp_path / "kept")
    picture = skyscatter.render(scene, camera, [450, 650], "single", checkpoint=kept)
    assert kept.save()  # as a signal does while the picture is finished and written
    again = skyscatter.render(scene, camera, [450, 650], "single", resume=tmp_path / "kept")
    np.testing.assert_array_equal(again.radiance, picture.radiance)
