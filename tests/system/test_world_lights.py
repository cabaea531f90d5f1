"""What shines on skies with bodies and clouds: the Sun's disk in pictures, and all lights of the night."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from significance import assert_agrees
from worlds import BURIED, RAYS, WAVELENGTHS, directions, sky

import skyscatter
from skyscatter import fields
from skyscatter.celestial.heavens import Heavens
from skyscatter.celestial.moon import moon_at, moon_irradiance, moon_radiance
from skyscatter.cli.main import main
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.spectral import SpectralImage
from skyscatter.solvers import skylights
from skyscatter.solvers.townseen import lamps_seen
from skyscatter.solvers.worldlights import lit
from skyscatter.surfaces import Body, Box, Lambert, Mirror, Town

WL = np.array(WAVELENGTHS)
QUICK = skyscatter.Path(samples=2, max_order=1)
#: The Alps under a Moon in its first quarter, and Paranal without one.
ALPS, QUARTER = (46.0, 8.0), "2026-11-18T20:00Z"
PARANAL, DARK = (-24.6, -70.4), "2026-04-18T07:00Z"
DUSK = "2026-11-18T16:30Z"


def straight(image: Any, observer: Any, camera: Any, layer: str = "direct") -> Any:
    """Irradiance [W m-2 nm-1] of what comes straight, over the picture."""
    return (image.layers[layer] * camera.pixel_solid_angle(observer)[..., None]).sum(axis=(0, 1))


def night(place: Any, time: str, lights: Any = "auto", **held: Any) -> skyscatter.Scene:
    model: Any = skyscatter.load_model("earth-simple")
    return model.model_copy(update=held).scene_at(*place, time, 2.0, lights)


# --- the Sun's disk -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sun", [40.0, 0.1])
def test_the_sun_in_pixels_of_any_size(sun: float) -> None:
    """A disk of half a degree, in pixels of five degrees and of a quarter, half set as well: that of the air alone."""
    plain, held = sky("earth-simple", sun), sky("earth-simple", sun, bodies=(BURIED,))
    wide = skyscatter.Panorama(width=72, height=36)
    fine = skyscatter.Perspective(width=16, height=16, azimuth_deg=180, elevation_deg=sun, fov_deg=4)
    for camera in (wide, fine):
        found = skyscatter.render(held, camera, WL, QUICK, parts=True)
        known = skyscatter.render(plain, camera, WL, "single", parts=True)
        # Two tables of the same columns.
        np.testing.assert_allclose(*(straight(one, held.observer, camera) for one in (found, known)), rtol=2e-5)


@pytest.mark.parametrize("edge", [0.0, *(pytest.param(e, marks=pytest.mark.slow) for e in (0.4, -0.7))])
def test_a_wall_before_part_of_the_sun(edge: float) -> None:
    """Its vertical edge stands so many of the Sun's radii from the middle: what is seen, of a limb-darkened disk."""
    sun = np.radians(30.0)
    radius = np.arcsin(skyscatter.Star().radius / skyscatter.Star().distance)
    east = np.tan(edge * radius) / np.cos(sun) * 1000.0
    wall = Body(name="wall", shape=Box(position=(east - 5e3, -1000.5, 1e3), size=(1e4, 1, 2e3)), material=Lambert())
    plain, held = sky("earth-simple", 30.0), sky("earth-simple", 30.0, bodies=(wall,))
    x, y = np.meshgrid(*[(np.arange(2000) + 0.5) / 1000 - 1] * 2)
    inside = x * x + y * y < 1
    limb = plain.star.limb(np.sqrt(1 - (x * x + y * y)[inside]), WL)
    seen = limb[x[inside] > edge].sum(axis=0) / limb.sum(axis=0)
    for camera in (
        skyscatter.Panorama(width=36, height=18),
        skyscatter.Perspective(width=40, height=40, azimuth_deg=180, elevation_deg=30, fov_deg=2),
    ):
        found = skyscatter.render(held, camera, WL, QUICK, parts=True)
        whole = skyscatter.render(plain, camera, WL, "single", parts=True)
        share = straight(found, held.observer, camera) / straight(whole, held.observer, camera)
        # One looks at a wall every 1/34 of the Sun's radius; the disk is at most 2 radii high there, of pi in all.
        np.testing.assert_allclose(share, seen, atol=2 / np.pi / 34)


def test_a_cloud_dims_the_sun() -> None:
    cloud = skyscatter.Component(
        name="cloud",
        density=fields.Box(position=(0, 0, 1500), half_sizes=(3000, 3000, 500)),
        optics={"kind": "particles", "extinction": 1e-3, "phase": {"kind": "henyey-greenstein", "g": 0.8}},
    )
    plain, held = sky("earth-simple", 50.0), sky("earth-simple", 50.0, fields=(cloud,))
    camera = skyscatter.Panorama(width=36, height=18)
    found = skyscatter.render(held, camera, WL, QUICK, parts=True)
    known = skyscatter.render(plain, camera, WL, "single", parts=True)
    share = straight(found, held.observer, camera) / straight(known, held.observer, camera)
    # 1 km of it, at 50 degrees; over the disk the way is longer and shorter by half a per cent.
    np.testing.assert_allclose(share, np.exp(-1 / np.sin(np.radians(50.0))), rtol=1e-4)


def test_without_the_sun() -> None:
    """What comes straight from its disk is left out to the last digits, and the recipe has the lamp in its place."""
    wall = Body(name="wall", shape=Box(position=(0, -100, 50), size=(10, 1, 100)), material=Lambert())
    plain, held = sky("earth-simple", 60.0), sky("earth-simple", 60.0, bodies=(wall,))
    camera = skyscatter.Perspective(width=24, height=24, azimuth_deg=180, elevation_deg=60, fov_deg=3)
    found = skyscatter.render(held, camera, WL, QUICK, parts=True, sun_disk=False)
    bright = skyscatter.render(held, camera, WL, QUICK, parts=True).layers["direct"].max()
    assert np.abs(found.layers["direct"]).max() < 1e-12 * bright
    known = skyscatter.render(plain, camera, WL, "single", parts=True, sun_disk=False)
    lamps = [np.array(one.recipe["sun_lamp"]["irradiance"]) for one in (found, known)]
    np.testing.assert_allclose(*lamps, rtol=1e-6)
    low = skyscatter.Scene.model_validate(held.model_dump() | {"sun": {"elevation_deg": 30.0}})
    hidden = skyscatter.render(low, camera, WL, QUICK, sun_disk=False)
    assert not any(hidden.recipe["sun_lamp"]["irradiance"]), "the wall is before it"


# --- the lights of the night --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "time", "samples"),
    [
        (ALPS, QUARTER, 1024),  # walks alone
        pytest.param(ALPS, QUARTER, 8192, marks=pytest.mark.slow),  # with what is known of the moonlit air
        pytest.param(PARANAL, DARK, 8192, marks=pytest.mark.slow),
        pytest.param(ALPS, DUSK, 8192, marks=pytest.mark.slow),
    ],
)
def test_a_night_beside_nothing(place: Any, time: str, samples: int) -> None:
    """With a body out of sight it is that of air alone, which another solver finds from a field of all lights."""
    plain, held = night(place, time), night(place, time, bodies=(BURIED,))
    d = directions(RAYS)
    known = skyscatter.radiance(plain, plain.observer.position, d, WL)
    found = skyscatter.radiance(held, held.observer.position, d, WL, skyscatter.Path(samples=samples, seed=3))
    # What the field states is an estimate; so is that of known air.
    slack = float((known.error / known.radiance).max())
    assert_agrees(found.radiance, known.radiance, found.error, slack=slack)
    if samples < 2000:
        assert (found.error < 0.02 * found.radiance).all(), "the comparison has power"


def test_the_moon_casts_a_shadow() -> None:
    """Between the lit ground and that in a wall's shadow stands the light of the Moon; both have the sky's, nearly."""
    moon = moon_at(night(ALPS, QUARTER).sight)  # type: ignore[arg-type]
    level = moon.direction * [1, 1, 0] / np.hypot(*moon.direction[:2])
    towards = float(np.degrees(np.arctan2(level[0], level[1])))
    pole = Body(name="pole", shape=Box(position=tuple(12 * level + [0, 0, 5]), size=(3, 3, 30)), material=Lambert())
    scene = night(ALPS, QUARTER, ("moon",), bodies=(pole,))
    plain = night(ALPS, QUARTER, lights=("moon",))
    away = np.array([level * 3, np.array([level[1], -level[0], 0.0]) * 9])
    d = away - [0, 0, 2]
    d /= np.linalg.norm(d, axis=1)[:, None]
    seen = skyscatter.radiance(scene, scene.observer.position, d, WL, skyscatter.Path(samples=4096, seed=1), parts=True)
    ground = np.array([0.0, 0.0, plain.medium.radius + 0.01])
    passed = skyscatter.transmittance(plain, ground, ground + 3e6 * moon.direction, WL)
    once = moon_irradiance(moon, WL) * passed * moon.direction[2] * 0.1 / np.pi
    assert 180 < towards % 360 < 270
    between = skyscatter.transmittance(plain, ground, plain.observer.position, WL)
    # Over the disk the cosine changes by a thousandth; walks are spread evenly over it.
    np.testing.assert_allclose(seen.layers["reflected"][1], once * between, rtol=1e-3)
    assert not seen.layers["reflected"][0].any()
    assert (seen.radiance[0] > 0.02 * once).all(), "moonlit air lights the shadow"


def test_the_face_of_the_moon() -> None:
    """Along rays it is what it is without bodies, its dark part too; and a wall hides it."""
    scene = night(ALPS, QUARTER, bodies=(BURIED,))
    moon = moon_at(scene.sight)  # type: ignore[arg-type]
    side = np.cross(moon.direction, [0, 0, 1])
    side /= np.linalg.norm(side)
    d = moon.direction + np.sin(moon.angular_radius) * np.array([-0.8, -0.3, 0.3, 0.8])[:, None] * side
    d /= np.linalg.norm(d, axis=1)[:, None]
    asked = WL, skyscatter.Path(samples=64)
    seen = skyscatter.radiance(scene, scene.observer.position, d, *asked, parts=True).layers
    air = night(ALPS, QUARTER)
    passed = skyscatter.transmittance(air, air.observer.position, air.observer.position + 3e6 * d, WL)
    expected = moon_radiance(moon, d, WL) * passed
    assert expected[:, 1].max() > 100 * expected[:, 1].min(), "it is half dark"
    # Walks see an even disk, which is taken off again: what is left of that is its rounding and the tables of the air.
    total = sum(seen[name] for name in ("direct", "moon"))
    np.testing.assert_allclose(total, expected, rtol=1e-3, atol=1e-4 * expected.max())
    wall = Body(name="wall", shape=Box(position=(-60, -60, 50), size=(200, 20, 400)), material=Lambert())
    hidden = night(ALPS, QUARTER, bodies=(wall,))
    behind = skyscatter.radiance(hidden, hidden.observer.position, d, *asked, parts=True).layers
    assert np.abs(behind["moon"] + behind["direct"]).max() == 0.0


def test_stars_stand_behind_mountains() -> None:
    """Half of a picture is a wall: no star before it, and beside it all that there are without it.

    A star is drawn over some pixels.
    """
    wall = Body(name="wall", shape=Box(position=(-500, 100, 500), size=(1000, 2, 2000)), material=Lambert())
    camera = skyscatter.Perspective(width=120, height=80, azimuth_deg=0, elevation_deg=40, fov_deg=60)
    images = []
    for scene in (night(PARANAL, DARK, ("stars",), bodies=(one,)) for one in (BURIED, wall)):
        images.append(skyscatter.render(scene, camera, WL, QUICK, parts=True).layers["stars"][..., 1])
    free, walled = images
    assert (free[:, :60] > 0).sum() > 100
    assert not walled[:, :55].any()
    np.testing.assert_array_equal(walled[:, 65:], free[:, 65:])


def test_faint_light_is_kept_on_its_map() -> None:
    """The integral of the map is the light of stars and sky."""
    scene = night(PARANAL, DARK, bodies=(BURIED,))
    heavens, shining = skylights.heavens_of(scene, WL), lit(scene, WL)
    assert isinstance(heavens, Heavens)
    rows, columns, _ = shining.around.shape
    e, a = np.pi * (np.arange(rows) / (rows - 1) - 0.5), 2 * np.pi * np.arange(columns) / columns
    edges = np.clip(np.append(e, np.inf) - np.pi / (rows - 1) / 2, 0.0, np.pi / 2)
    weight = np.diff(np.sin(edges))[:, None] * 2 * np.pi / columns
    both = (shining.around * weight[..., None]).sum(axis=(0, 1))
    nodes = np.arcsin((np.arange(200) + 0.5) / 200)
    grid = np.stack(np.broadcast_arrays(np.cos(nodes)[:, None] * np.sin(a), np.cos(nodes)[:, None] * np.cos(a),
                                        np.sin(nodes)[:, None]), axis=-1)  # fmt: skip
    spread = sum(heavens.radiance(name, grid) for name in heavens.spread_names)
    expected = 2 * np.pi * np.asarray(spread).mean(axis=(0, 1))
    for name in heavens.points_names:
        towards, light = heavens.points(name)
        expected += light[towards[:, 2] > 0].sum(axis=0)
    apart = np.array([lamp.spectral_amount(WL) for lamp in shining.lamps]).sum(axis=0) if shining.lamps else 0.0
    # Sums over rows of 2 degrees.
    np.testing.assert_allclose(both + apart, expected, rtol=2e-3)


def test_a_mirror_shows_the_sky() -> None:
    """Walks read the map of faint light between its nodes: the glow of the air in a mirror, where one looks down."""
    plate = Body(name="plate", shape=Box(position=(0, 0, 0), size=(100, 100, 1)), material=Mirror(reflectance=0.8))
    scene = night(PARANAL, DARK, ("airglow",), bodies=(plate,))
    heavens = skylights.heavens_of(scene, WL)
    assert isinstance(heavens, Heavens)
    d = direction_from_azimuth_elevation(np.array([10.0, 123.0, 250.0, 300.0]), np.array([-80.0, -33.3, -15.0, -8.0]))
    seen = skyscatter.radiance(scene, scene.observer.position, d, WL, skyscatter.Path(samples=64), parts=True)
    up, air = d * [1, 1, -1], night(PARANAL, DARK)
    passed = skyscatter.transmittance(air, air.observer.position, air.observer.position + 3e6 * up, WL)
    # Linear between nodes of 2 degrees, where the glow rises towards the horizon.
    np.testing.assert_allclose(seen.layers["reflected"], 0.8 * heavens.radiance("airglow", up) * passed, rtol=5e-3)


def test_by_command(tmp_path: Path) -> None:
    """A night with a town over a model that holds a wall; and a dome without its Sun, with the lamp beside it."""
    model: Any = skyscatter.load_model("earth-simple")
    wall = Body(name="wall", shape=Box(position=(0, -100, 20), size=(40, 1, 40)), material=Lambert())
    model.model_copy(update={"name": "walled", "bodies": (wall,)}).save(tmp_path / "walled.toml")
    words = [
        "sky",
        str(tmp_path / "walled.toml"),
        "--size",
        "32x16",
        "--samples",
        "16",
        "--wavelengths",
        "450,650",
        "-q",
    ]
    place = ["--place", "46,8", "--time", QUARTER, "--town", "9km,200,1e5people"]
    assert main([*words, *place, "-o", str(tmp_path / "night.exr")]) == 0
    assert main([*words, "--no-sun", "--view", "panorama", "-o", str(tmp_path / "dome.exr")]) == 0
    night, dome = (SpectralImage.load(tmp_path / name) for name in ("night.exr", "dome.exr"))
    assert set(night.recipe["scene"]["lights"]["shine"]) >= {"moon", "stars", "towns"}
    assert np.nanmedian(night.luminance()) < 1e-4 * np.nanmedian(dome.luminance())
    lamp = json.loads((tmp_path / "dome.sun.json").read_text())["sun"]
    np.testing.assert_allclose(lamp["irradiance_W_m-2_nm-1"], dome.recipe["sun_lamp"]["irradiance"])


# --- towns --------------------------------------------------------------------------------------------------------


def with_town(town: Any, altitude: float = 2.0, **held: Any) -> skyscatter.Scene:
    model: Any = skyscatter.load_model("earth-simple")
    return model.model_copy(update={"towns": (town,), **held}).scene(sun_elevation_deg=-40.0, altitude=altitude)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distance", "radius"), [("15 km", 2e3), ("40 km", 5e3), ("1 km", 3e3)]
)  # fmt: skip
def test_the_glow_of_a_town_beside_nothing(distance: str, radius: float) -> None:
    """With a body out of sight it is that of air alone, by quadrature and walks of another kind; right above it too."""
    town = Town.of_people(1e5, distance=distance, azimuth_deg=60, radius=radius, spectrum="led-4000k")
    d = directions([[60, 5], [60, 20], [60, 45], [0, 80], [100, 10], [180, 20], [240, 30], [20, 3]])
    plain, held = with_town(town), with_town(town, bodies=(BURIED,))
    known = skyscatter.radiance(plain, plain.observer.position, d, [550.0])
    found = skyscatter.radiance(held, held.observer.position, d, [550.0], skyscatter.Path(samples=4096, seed=2))
    # Errors of all that is known go together: its rays share walks.
    slack = 2 * float((known.error / known.radiance).max())
    assert_agrees(found.radiance, known.radiance, found.error, slack=slack)
    assert np.median(found.error / found.radiance) < 0.025


def test_lamps_of_a_town_behind_a_wall() -> None:
    """Seen from a tower: half of them stand behind a wall, and the others keep all their light."""
    town = Town(lumens=1e8, distance="8 km", azimuth_deg=0, radius="2 km", spectrum="led-4000k")
    wall = Body(name="wall", shape=Box(position=(-1000, 50, 0), size=(2000, 1, 2000)), material=Lambert())
    camera = skyscatter.Perspective(width=90, height=40, azimuth_deg=0, elevation_deg=-5, fov_deg=45)
    free, half = (
        skyscatter.render(with_town(town, 600.0, bodies=(one,)), camera, WL, QUICK, parts=True).layers["towns"]
        for one in (BURIED, wall)
    )
    omega = camera.pixel_solid_angle(with_town(town, 600.0).observer)[..., None]
    assert (free[:, :40] > 0).any()
    assert not half[:, :40].any()
    np.testing.assert_array_equal(half[:, 50:], free[:, 50:])
    plain = with_town(town, 600.0)
    towards, light = lamps_seen(plain, WL)
    assert len(towards) == 600
    np.testing.assert_allclose((free * omega).sum(axis=(0, 1)), light.sum(axis=0), rtol=0.01)


@pytest.mark.slow
def test_the_light_of_a_town_is_polarised() -> None:
    """I is that of scalar walks within chance; light turned by a right angle near the zenith is polarised the most."""
    town = Town(lumens=1e8, distance="15 km", azimuth_deg=0, radius="1 km", spectrum="led-4000k")
    scene, d = with_town(town, bodies=(BURIED,)), directions([[0, 10], [0, 85], [90, 20], [180, 30]])
    asked = scene.observer.position, d, [550.0]
    found = skyscatter.radiance(scene, *asked, skyscatter.Path(samples=2048, seed=1), stokes=True)
    scalar = skyscatter.radiance(scene, *asked, skyscatter.Path(samples=2048, seed=2))
    # Scalar light misses up to a few per cent of what is scattered again.
    assert_agrees(found.radiance, scalar.radiance, np.hypot(found.error, scalar.error), slack=0.03)
    degree = np.hypot(found.layers["Q"], found.layers["U"])[:, 0] / found.radiance[:, 0]
    assert 0.5 < degree[1] < 0.9
    assert degree[1] > degree[[0, 2, 3]].max()
