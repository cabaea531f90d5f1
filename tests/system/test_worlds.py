"""Skies by the general walk among surfaces, against the sky's own solvers and against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats
from significance import assert_agrees
from worlds import BURIED, HOUSE, RAYS, WAVELENGTHS, directions, lead_none, look, sky

import skyscatter
from skyscatter import fields
from skyscatter.solvers.world import glitters
from skyscatter.surfaces import Body, Box, Dielectric, Lambert, Mosaic, PointLamp, RossLi, Rpv, Sea


@pytest.mark.parametrize(
    ("model", "sun"),
    [
        ("earth-simple", 60.0),
        ("earth-hazy", 5.0),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (("earth-simple", 25.0), ("earth-simple", 5.0))),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (("earth-hazy", 60.0), ("earth-hazy", 25.0))),
    ],
)
def test_a_plain_sky(model: str, sun: float) -> None:
    """A dozen directions, by the general walk against the sky's own walks and against orders."""
    walks = 8192 if model == "earth-simple" else 4096
    found = look(sky(model, sun, bodies=(BURIED,)), samples=walks, seed=3, sampling="march")
    marched = look(sky(model, sun), samples=walks, seed=4)
    solved = look(sky(model, sun), "orders")
    assert_agrees(found.radiance, marched.radiance, np.hypot(found.error, marched.error), slack=2e-4)  # two tables
    # What orders states of itself is no standard error: three of it, for it is an estimate, beside chance.
    slack = 3 * (solved.error / solved.radiance).max()
    assert_agrees(found.radiance, solved.radiance, found.error, slack=slack)


def test_stated_errors_cover() -> None:
    """Thirty seeds: deviations over stated errors follow Student's t, as far as thirty seeds can tell."""
    scene, d = sky("earth-simple", 25.0, bodies=(BURIED,)), directions(RAYS[[0, 3, 5, 9, 11]])
    truth = look(sky("earth-simple", 25.0), "path", d, samples=1 << 16, seed=1)
    runs = [look(scene, "path", d, samples=1024, seed=10 + k) for k in range(30)]
    z = np.array([(run.radiance - truth.radiance) / np.hypot(run.error, truth.error) for run in runs])
    inside = np.mean(np.abs(z) < 2.0)
    # 94 % for 15 degrees of freedom; of 150 independent rays, whose wavelengths go together, 5 standard deviations.
    expected = 1 - 2 * stats.t.sf(2.0, 15)
    assert inside > expected - 5 * np.sqrt(expected * (1 - expected) / 150), inside
    mean = np.mean([run.radiance for run in runs], axis=0)
    spread = np.std([run.radiance for run in runs], axis=0, ddof=1) / np.sqrt(30)
    assert_agrees(mean, truth.radiance, np.hypot(spread, truth.error), freedom=29, slack=2e-4)


def test_the_same_numbers_whatever_the_threads() -> None:
    scene = sky("earth-simple", 25.0, bodies=(BURIED,))
    one, two = (look(scene, samples=32, threads=n).radiance for n in (1, 2))
    np.testing.assert_array_equal(one, two)


def sunlight(scene: skyscatter.Scene, plain: skyscatter.Scene, point: Any) -> Any:
    """Irradiance [W m-2 nm-1] across sunlight at a point in metres from the ground, by columns alone."""
    start = np.array([0.0, 0.0, scene.medium.radius]) + point
    passed = skyscatter.transmittance(plain, start, start + 3e6 * scene.sun.direction, WAVELENGTHS)
    return passed * scene.star.irradiance(np.array(WAVELENGTHS), scene.star_distance)


def test_a_box_in_the_sun() -> None:
    """Its lit face, the ground in the sun, and its shadow, in closed form; and the shadow is blue, not black."""
    scene, plain = sky("earth-simple", 40.0, bodies=(HOUSE,)), sky("earth-simple", 40.0)
    eye, sun = np.array([0.0, 0.0, 2.0]), scene.sun.direction
    face, lawn = np.array([0.5, 10.0, 2.5]), np.array([6.0, 14.0, 0.0])
    shade = np.array([0.0, 15.0, 0.0])  # 4 m high at 40 degrees: 4.8 m of shadow
    above = np.array([0.0, 15.0, 30.0])
    targets = (
        (eye, face, 0.6 / np.pi * sun @ [0.0, -1.0, 0.0]),
        (eye + np.array([6.0, 0.0, 0.0]), lawn, 0.1 / np.pi * sun[2]),
        (above, shade, 0.0),
    )
    for start, target, factor in targets:
        way = target - start
        origin = start + np.array([0.0, 0.0, scene.medium.radius])
        d = way / np.linalg.norm(way)
        seen = skyscatter.radiance(
            scene, origin, d, WAVELENGTHS, solver=skyscatter.Path(samples=4096, seed=5), parts=True
        )
        between = skyscatter.transmittance(plain, origin, origin + way, WAVELENGTHS)
        expected = factor * sunlight(scene, plain, target) * between
        # Columns by tables; without chance but for the point on the disk, over which the cosine hardly changes.
        np.testing.assert_allclose(seen.layers["reflected"], expected, rtol=1e-3)
        multiple = seen.layers["multiple"]
        assert multiple[0] > multiple[2] > 0, "lit by the blue sky as well"


def test_a_box_darkens_the_haze() -> None:
    """Light scattered once along a ray over shaded ground is what the lit part of the ray scatters."""
    tower = Body(name="tower", shape=Box(position=(0, -100, "250 m"), size=("2 km", 20, "500 m")), material=Lambert())
    scene, plain = sky("earth-hazy", 30.0, bodies=(tower,)), sky("earth-hazy", 30.0)
    d = np.array([0.0, 0.0, 1.0])
    start = scene.observer.position
    # The tower's edge is at the height 500 m, 90 to 110 m south: the ray is lit from where the Sun clears it.
    lit = 500.0 - 90.0 * np.tan(np.radians(30.0))
    found = skyscatter.radiance(scene, start, d, WAVELENGTHS, solver=skyscatter.Path(samples=4096, seed=6), parts=True)
    high = np.array([0.0, 0.0, scene.medium.radius + lit])
    above = skyscatter.radiance(plain, high, d, WAVELENGTHS, "single", parts=True)
    dimmed = above.layers["scattered"] * skyscatter.transmittance(plain, start, high, WAVELENGTHS)
    whole = skyscatter.radiance(plain, start, d, WAVELENGTHS, "single", parts=True).layers["scattered"]
    # The tower hides none of the ray; the penumbra is 4 m.  Chance: 1 / sqrt(4096) of what a leg scatters.
    np.testing.assert_allclose(found.layers["scattered"], dimmed, rtol=0.02)
    assert (dimmed < 0.9 * whole).all()


@pytest.mark.slow
def test_a_map_of_the_ground() -> None:
    """Beside a body it is what it is without one: cells, what lies around them, and their light in the haze."""
    painted = skyscatter.GroundMap(classes=[[0, 1, 0], [1, 0, 1], [0, 0, 1]], albedos=[0.05, "snow"], cell_size="700 m")
    ground = skyscatter.Ground(albedo=0.3, map=painted)
    # Into each cell but one, past their edges, and up.
    d = directions(
        [[315, -70], [10, -75], [45, -65], [275, -80], [80, -70], [225, -60], [185, -70], [90, -30], [0, 50]]
    )
    held, bare = (
        sky("earth-hazy", 40.0, altitude=2500.0, ground=ground, **more) for more in ({"bodies": (BURIED,)}, {})
    )
    found, known = look(held, d=d, samples=1024, seed=1), look(held, d=d, samples=6144, seed=2)
    other = look(bare, d=d, samples=4096, seed=3)
    for one in (found, known):
        assert_agrees(one.radiance, other.radiance, np.hypot(one.error, other.error))
    brightest = other.radiance[1:8, 1].max()
    assert brightest > 2 * other.radiance[1:8, 1].min(), "cells differ"


def test_land_that_is_lambertian() -> None:
    """k = 1, no asymmetry and no hot spot: the formula is Lambert's, and the whole sky that of orders."""
    land = skyscatter.Ground(material=Rpv(amplitude=0.3, exponent=1.0, asymmetry=0.0, hot_spot=1.0))
    found = look(sky("earth-simple", 35.0, ground=land), samples=8192, seed=7)
    solved = look(sky("earth-simple", 35.0, ground=skyscatter.Ground(albedo=0.3)), "orders")
    assert_agrees(found.radiance, solved.radiance, found.error, slack=3 * (solved.error / solved.radiance).max())


@pytest.mark.parametrize(
    "material",
    [
        Rpv(amplitude=0.15, exponent=0.8, asymmetry=-0.1),
        RossLi(isotropic=0.2, volumetric=0.1, geometric=0.03),
        Sea(wind_speed=7),
        Mosaic(
            classes=[[0, 1], [2, 3]],
            materials=[
                Lambert(albedo=0.6),
                Rpv(amplitude=0.2, exponent=0.7),
                Sea(wind_speed=4),
                Lambert(albedo="snow"),
            ],
            rest=RossLi(isotropic=0.1),
            cell_size=400.0,
        ),
    ],
    ids=["rpv", "ross-li", "sea", "mosaic"],
)
def test_a_ground_in_the_sun(material: Any) -> None:
    """What it reflects of the Sun once, against its formula times the columns."""
    scene = sky("earth-simple", 50.0, ground=skyscatter.Ground(material=material), altitude=500.0)
    plain = sky("earth-simple", 50.0, altitude=500.0)
    d = directions([[181, -60], [179, -45], [20, -55], [100, -70], [290, -65]])
    seen = look(scene, "path", d, samples=1024, parts=True, seed=8)
    for ray, found in zip(d, seen.layers["reflected"], strict=True):
        target = np.array([0, 0, 500.0]) + ray * 500.0 / -ray[2]
        here = material_at(material, *target[:2]) if isinstance(material, Mosaic) else material
        factor = reflectance_factor(here, scene.sun.direction, -ray) / np.pi * scene.sun.direction[2]
        start = scene.observer.position
        between = skyscatter.transmittance(plain, start, start + ray * 500.0 / -ray[2], WAVELENGTHS)
        # Of the disk, over which a steep lobe of waves changes by some per cent, the mean differs by its curvature.
        np.testing.assert_allclose(found, factor * sunlight(scene, plain, target) * between, rtol=5e-3)


def material_at(mosaic: Mosaic, x: float, y: float) -> Any:
    """Of four cells around the middle, and of what lies around them."""
    if max(abs(x), abs(y)) > mosaic.cell_size:
        return mosaic.rest
    return mosaic.materials[(0 if y > 0 else 2) + (1 if x > 0 else 0)]


def reflectance_factor(material: Any, light: Any, viewer: Any) -> Any:
    """pi times the BRDF (wavelength,), written down from the literature once more."""
    if isinstance(material, Lambert):
        return material.reflectance(WAVELENGTHS)
    if isinstance(material, Rpv | RossLi):
        return material.factor(light, viewer, WAVELENGTHS)
    # Cox & Munk (1954), equations 5-9: the slopes that mirror, their probability, Fresnel at half the angle.
    m, n = light[2], viewer[2]
    slope = np.hypot(*(light + viewer)[:2]) / (m + n)
    variance = 0.003 + 0.00512 * material.wind_speed
    probability = np.exp(-(slope**2) / variance) / (np.pi * variance)
    half = 0.5 * np.arccos(light @ viewer)
    index = material.refractive_index(WAVELENGTHS)
    beyond = np.arcsin(np.sin(half) / index)
    fresnel = 0.5 * (
        (np.sin(half - beyond) / np.sin(half + beyond)) ** 2 + (np.tan(half - beyond) / np.tan(half + beyond)) ** 2
    )
    tilt = np.arctan(slope)
    shadow = 1 / (1 + _hidden(m, variance) + _hidden(n, variance))
    mirrors = np.pi * fresnel * probability * shadow / (4 * m * n * np.cos(tilt) ** 4)
    return (1 - material.foam_cover) * mirrors + material.diffuse(WAVELENGTHS)


def _hidden(cosine: float, variance: float) -> float:
    """Mishchenko & Travis (1997), equation 15, of slopes with half of the variance along each axis."""
    s, cotangent = np.sqrt(variance / 2), cosine / np.sqrt(1 - cosine**2)
    spread = s / cotangent * np.sqrt(2 / np.pi) * np.exp(-(cotangent**2) / (2 * s**2))
    return 0.5 * float(spread - 2 * stats.norm.sf(cotangent / s))


def test_the_albedo_of_the_sea() -> None:
    """Under an even sky: 0.066 without waves (Burt 1954; Cox & Munk 1956), 0.050 to 0.060 with them."""
    rng = np.random.default_rng(2)
    sea = Sea(wind_speed=10, index=1.338, foam=0.0)
    n = 4000
    light, viewer = (_even(rng, n) for _ in range(2))
    factor = [reflectance_factor(sea, a, b)[1] for a, b in zip(light, viewer, strict=True)]
    assert 0.045 < np.mean(factor) < 0.066


def _even(rng: Any, n: int) -> Any:
    """Directions by their cosine."""
    m, a = np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * np.pi, n)
    s = np.sqrt(1 - m**2)
    return np.stack([s * np.cos(a), s * np.sin(a), m], axis=1)


OVERCAST = {"kind": "particles", "optical_depth": 8.0, "phase": {"kind": "henyey-greenstein", "g": 0.75}}


def test_a_wide_cloud_is_a_layer() -> None:
    """Voxels 60 km wide and 500 m thick, of optical depth 8, over a round Earth with air: as the layer of orders."""
    side = 60e3
    # Values at the middles of voxels, nothing beyond the last ones.
    voxels = fields.VoxelGrid(
        values=np.ones((60, 60, 10)), spacing=(side / 60, side / 60, 50.0), position=(0, 0, 1250.0), edge="sharp"
    )
    cloud = skyscatter.Component(
        name="cloud",
        density=voxels,
        optics={"kind": "particles", "extinction": 8.0 / 500.0, "phase": OVERCAST["phase"]},
    )
    layer = skyscatter.Component(
        name="cloud", density={"kind": "uniform", "base": 1000.0, "top": 1500.0}, optics=OVERCAST
    )
    base: Any = skyscatter.load_model("earth-simple")
    d = directions([[180, 60], [90, 40], [0, 80]])
    found = look(sky("earth-simple", 50.0, fields=(cloud,)), "path", d, samples=8192, seed=9)
    solved = look(sky("earth-simple", 50.0, components=(*base.components, layer)), "orders", d)
    # The slab is flat and the layer round: over the 2 km that count that is nothing; the edges are 15 depths away.
    assert_agrees(found.radiance, solved.radiance, found.error, slack=5e-3)


def noise(image: Any) -> float:
    """Root mean square of the relative standard errors of the pixels."""
    return float(np.sqrt(np.mean((image.error / image.radiance) ** 2)))


def led_and_free(scene: Any, camera: Any, walks: Any, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """Pictures by walks that are led to where light is and by those that are not, whose means agree."""
    led = skyscatter.render(scene, camera, [550.0], solver=walks)
    lead_none(monkeypatch)
    free = skyscatter.render(scene, camera, [550.0], solver=walks)
    means, errors = zip(
        *((x.radiance.mean(), np.sqrt((x.error**2).sum()) / x.error.size) for x in (led, free)), strict=True
    )
    assert abs(means[0] - means[1]) < 3 * np.hypot(*errors)
    return led, free


@pytest.mark.parametrize("depth", [5.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_a_cloud_over_the_sea(depth: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Walks that are led to the glitter and around the Sun find what those find that are not, with no more noise.

    When half of the turns in a cloud were led to the sea, weights grew with every turn: the cloud of optical depth 30
    was 25 % too dark where 2.6 % was stated, twice as noisy as without, and that of 5 1.4 times as noisy.
    """
    cloud = skyscatter.Component(
        name="cloud",
        density=fields.Sphere(radius=500.0, position=(0, 2000.0, 1500.0)),
        optics={"kind": "particles", "extinction": depth / 1000, "phase": {"kind": "henyey-greenstein", "g": 0.85}},
    )
    scene = sky("earth-simple", 20.0, fields=(cloud,), ground=skyscatter.Ground(material=Sea(wind_speed=5)))
    camera = skyscatter.Perspective(width=24, height=16, azimuth_deg=0, elevation_deg=25, fov_deg=50)
    walks = skyscatter.Path(samples=256, sampling="march", seed=3)
    led, free = led_and_free(scene, camera, walks, monkeypatch)
    assert noise(led) < 1.05 * noise(free)  # 0.77 and 0.93 of it


def test_air_over_a_lake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walks are led to the glitter of a lake, too, that is part of what covers a body."""
    water, shore = Sea(wind_speed=2), Lambert(albedo=0.1)
    lake = Mosaic(classes=[[1, 0]], materials=(water, shore), rest=shore, cell_size="10 km")
    plate = Body(name="lake", shape=Box(position=(0, 0, 1.0), size=(2e4, 2e4, 2.0)), material=lake)
    scene = sky("earth-simple", 9.0, bodies=(plate,), altitude=60.0)
    camera = skyscatter.Perspective(width=16, height=10, azimuth_deg=0, elevation_deg=12, fov_deg=30)
    walks = skyscatter.Path(samples=256, sampling="march", seed=5)
    led, free = led_and_free(scene, camera, walks, monkeypatch)
    assert noise(led) < 0.8 * noise(free)  # 0.54 of it


def test_glitter_is_where_a_sea_lies() -> None:
    """A sea among the materials of a mosaic shows no image of the Sun while none of the cells is one."""
    water, shore = Sea(wind_speed=2), Lambert(albedo=0.1)
    lies = {"materials": (shore, water), "cell_size": "1 km"}
    assert glitters(Mosaic(classes=[[0, 1]], rest=shore, **lies))
    assert glitters(Mosaic(classes=[[0, 0]], rest=water, **lies))
    assert not glitters(Mosaic(classes=[[0, 0]], rest=shore, **lies))


@pytest.mark.filterwarnings("ignore:path does not find")
def test_black_water_mirrors_the_sky() -> None:
    """A basin of ink with a smooth surface: what is seen in it is the sky by Fresnel's share, as solved by orders."""
    ink = skyscatter.Component(
        name="ink", density={"kind": "everywhere"}, optics={"kind": "artist", "colour": 0.0, "distance": "1 mm"}
    )
    water = skyscatter.SurfaceMedium(name="water", components=(ink,), index=1.33)
    basin = Body(name="basin", shape=Box(position=(0, 6, 0.5), size=(20, 20, 1)), material=Dielectric(), inside="water")
    scene = sky("earth-simple", 40.0, bodies=(basin,), media=(water,))
    seen = look(scene, "path", directions([[0, -20], [20, -45], [340, -10]]), samples=8192, seed=13)
    above = look(sky("earth-simple", 40.0), "orders", directions([[0, 20], [20, 45], [340, 10]]))
    for k, elevation in enumerate((20.0, 45.0, 10.0)):
        half = np.radians(90.0 - elevation)
        beyond = np.arcsin(np.sin(half) / 1.33)
        share = 0.5 * (
            (np.sin(half - beyond) / np.sin(half + beyond)) ** 2 + (np.tan(half - beyond) / np.tan(half + beyond)) ** 2
        )
        slack = 3 * (above.error / above.radiance).max()
        assert_agrees(seen.radiance[k], share * above.radiance[k], seen.error[k], slack=slack)


def test_a_lamp_under_the_sky() -> None:
    """Near a lamp its light on the ground goes by the square of the distance, beside the sky's."""
    lamp = PointLamp(position=(0, 5, 3), power=100.0)
    scene = sky("earth-simple", 20.0, lamps=(lamp,))
    way = np.array([0.0, 5.0, -2.0])
    d = way / np.linalg.norm(way)
    lit = look(scene, "path", d, samples=1024, parts=True, seed=10).layers["reflected"]
    unlit = look(sky("earth-simple", 20.0, bodies=(BURIED,)), "path", d, samples=1024, parts=True, seed=10)
    expected = unlit.layers["reflected"] + 0.1 / np.pi * 100.0 / (4 * np.pi * 9.0)
    np.testing.assert_allclose(lit, expected, rtol=0.02)  # chance chooses between the Sun and the lamp


def test_photons_leave_the_disk_as_walks_find_it() -> None:
    """A ball over a floor in thin fog, lit by a disk of 4 degrees: both sides of the light agree in the penumbra."""
    from skyscatter.surfaces import Interface, ParallelLamp, Rectangle, Sphere

    fog = skyscatter.Component(
        name="fog",
        density={"kind": "everywhere"},
        optics={"kind": "particles", "extinction": 0.05, "phase": {"kind": "rayleigh"}},
    )
    media = (skyscatter.SurfaceMedium(name="air"), skyscatter.SurfaceMedium(name="fog", components=(fog,)))
    floor = Rectangle(position=(0, 0, -0.01), normal=(0, 0, 1), size=(8, 8))
    bodies = (
        Body(name="room", shape=Box(position=(0, 0, 3), size=(10, 10, 8)), material=Interface(), inside="fog"),
        Body(name="floor", shape=floor, material=Lambert(albedo=0.6)),
        Body(name="ball", shape=Sphere(position=(0, 0, 2), radius=0.5), material=Lambert(albedo=0.3)),
    )
    sun = ParallelLamp(direction=(0.3, 0, 1), irradiance=1.0, angular_radius_deg=4.0, limb_darkening=True)
    scene = skyscatter.SurfaceScene(media=media, bodies=bodies, lamps=(sun,))
    eye = np.array([3.0, -3.0, 3.0])
    targets = np.array([[-0.6, 0.0, 0.0], [-0.6, 0.45, 0.0], [-0.2, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 2.5]])
    d = (targets - eye) / np.linalg.norm(targets - eye, axis=1)[:, None]
    walked = skyscatter.radiance(scene, eye, d, WAVELENGTHS, solver=skyscatter.Path(samples=16384, seed=11))
    sent = skyscatter.radiance(
        scene, eye, d, WAVELENGTHS, solver=skyscatter.Photons(samples=32, photons=1 << 16, radius=0.05, seed=11)
    )
    # Light is gathered within 5 cm, over which the penumbra, 28 cm wide, is not straight.  A quarter of the photons
    # would bring two or three from the floor to the ball, and now and then none.
    assert_agrees(sent.radiance, walked.radiance, np.hypot(sent.error, walked.error), slack=0.02)
    all_sent = skyscatter.radiance(
        scene,
        eye,
        d,
        WAVELENGTHS,
        solver=skyscatter.Photons(samples=32, photons=1 << 15, radius=0.08, direct=False, seed=12),
    )
    assert_agrees(all_sent.radiance, walked.radiance, np.hypot(all_sent.error, walked.error), slack=0.04)
