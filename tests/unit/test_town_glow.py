"""The glow of towns against integrals, photons and walks that share no line with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plain_towns import PlainAir, thin_layer, zenith_by_photons

import skyscatter
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.townlamps import lamps_of
from skyscatter.solvers.townlight import Lamplight
from skyscatter.solvers.towns import rings_of, town_glow
from skyscatter.solvers.townseen import lamps_seen
from skyscatter.solvers.townsky import TURNS, cell_rule
from skyscatter.surfaces import CityLobe, PointLamp, Town

EARTH = 6371e3
CITY = np.ascontiguousarray(np.stack(CityLobe().table()[:2]))
GREEN = np.array([550.0])
AIR = {
    "name": "air",
    "density": {"kind": "exponential", "scale_height": "8 km", "top": "80 km"},
    "optics": {"kind": "rayleigh-air"},
}
HAZE = {
    "name": "haze",
    "density": {"kind": "exponential", "scale_height": "1.5 km", "top": "15 km"},
    "optics": {
        "kind": "particles", "optical_depth": 0.12, "angstrom_exponent": 1.3, "single_scattering_albedo": 0.95,
        "phase": {"kind": "henyey-greenstein", "g": 0.68},
    },
}  # fmt: skip


def scene(*towns: Any, altitude: float = 0.0, components: Any = (AIR, HAZE), albedo: float = 0.2) -> skyscatter.Scene:
    """Night over a city's air: that of the model city-skyglow, whose ground here is grey."""
    model = skyscatter.Model(
        name="own", planet={"name": "Earth", "radius": EARTH}, ground={"albedo": albedo}, components=components,
        towns=towns or None,
    )  # fmt: skip
    return model.scene(sun_elevation_deg=-90, altitude=altitude)


def rays(elevation_deg: Any, azimuth_deg: Any) -> Any:
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack(np.broadcast_arrays(np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)), axis=-1)


def glowing(night: skyscatter.Scene, directions: Any, **options: Any) -> Any:
    """Radiance and its error along rays, (ray, 1) each."""
    glow = town_glow(night, GREEN, **options)
    assert glow is not None
    return glow.at(directions)


ELEVATIONS, AZIMUTHS = [2.0, 10.0, 30.0, 90.0, 30.0, 10.0], [0.0, 0.0, 30.0, 0.0, 120.0, 180.0]


@pytest.mark.parametrize("distance", [5e3, 20e3, 60e3])
def test_first_order_in_a_uniform_layer_by_scipy(distance: float) -> None:
    """A layer of 20 km whose ways are all closed forms."""
    layer = {
        "name": "layer", "density": {"kind": "uniform", "base": "0 m", "top": "20 km"},
        "optics": {"kind": "particles", "optical_depth": 0.2, "single_scattering_albedo": 1.0, "angstrom_exponent": 0,
                   "phase": {"kind": "isotropic"}},
    }  # fmt: skip
    night = scene(components=(layer,), albedo=0.0)
    even = np.array([[0.0, 1.0], [1.0, 1.0]]) / [[1.0], [2 * np.pi]]
    elevation, azimuth = np.radians([0.5, 3, 20, 60, 90, 20, 3]), np.radians([0, 5, 40, 10, 0, 150, 180])
    found = Lamplight(night, GREEN, even).once(distance, rays(np.degrees(elevation), np.degrees(azimuth)))[:, 0]
    sigma = 0.2 / 20e3
    expected = [thin_layer(sigma, 20e3, EARTH, distance, e, a) for e, a in zip(elevation, azimuth, strict=True)]
    # The rules of the quadrature agree to 1e-3, and the finer one is as a rule ten times better; tables add 2e-5 of
    # the depth of a horizontal way, which is 5.
    assert found == pytest.approx(expected, rel=5e-4)


def test_a_town_is_the_sum_of_its_lamps() -> None:
    """Rings, cells of azimuth and nodes of the sky against every lamp by itself, with light scattered once."""
    town = Town(distance="10 km", azimuth_deg=40, radius="3 km", power=1.0)
    night = scene(town)
    lamps = next(iter(lamps_of(night, GREEN)))
    light = Lamplight(night, GREEN, lamps.lobe)
    elevation = np.array([0.3, 1, 2, 5, 10, 30, 60, 85, 3])
    azimuth = np.array([40.0, 50, 40, 25, 45, 70, 160, 220, 63])
    expected = sum(
        w * light.once(float(d), rays(elevation, azimuth - np.degrees(a)))
        for d, a, w in zip(lamps.distance[::3], lamps.azimuth[::3], 3 * lamps.weight[::3], strict=True)
    )
    found, error = glowing(night, rays(elevation, azimuth), max_order=1)
    # Rings 22 % apart leave 0.2 %, every third lamp of a spiral that is seen from 7 km 1 %.
    assert found == pytest.approx(expected, rel=0.01)
    assert error == pytest.approx(0.005 * found, rel=1e-9)  # no walks: what tables and splines may miss


def test_all_light_of_lamps_is_in_the_rings() -> None:
    """Shared by two distances a lamp keeps its place in azimuth, and its light at the power of -2.5."""
    night = scene(Town(distance="8 km", azimuth_deg=350, radius="3 km", power=2.0))
    lamps = list(lamps_of(night, GREEN))
    rings = rings_of(lamps)
    expected = 2.0 * np.sum(lamps[0].weight * lamps[0].distance**-2.5)
    assert len(rings) > 3
    assert sum(ring.worth for ring in rings) == pytest.approx(expected, rel=1e-12)  # rounding
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    middle = np.angle(sum((ring.power[:, 0] * np.exp(1j * turn)).sum() for ring in rings))
    assert np.degrees(middle) == pytest.approx(-10.0, abs=0.1)  # lamps are shared by cells of a quarter of a degree


def test_cells_of_azimuth_cover_the_half_circle_once() -> None:
    at, cell, weight = cell_rule()
    assert at.min() >= 0
    assert at.max() <= np.pi
    assert np.bincount(cell, weight) == pytest.approx(np.ones(TURNS // 2 + 1), rel=1e-12)  # rounding


def test_glow_is_linear_and_even() -> None:
    """Two towns give the sum of each, twice the power twice the light, and left is as right."""
    one = Town(distance="20 km", azimuth_deg=0, radius=0, power=1.0)
    other = one.model_copy(update={"azimuth_deg": 90.0, "power": 3.0})
    directions = rays([2.0, 20, 60, 2, 20, 60], [70.0, 70, 70, -70, -70, -70])
    solved = [glowing(scene(*towns), directions, samples=32)[0] for towns in ((one,), (other,), (one, other))]
    assert solved[0][:3] == pytest.approx(solved[0][3:], rel=1e-9)  # rounding of transforms
    # Logarithms are joined between nodes a quarter of a degree apart, where that of the sum is not the sum's.
    assert solved[2] == pytest.approx(solved[0] + solved[1], rel=2e-4)
    twice = glowing(scene(one.model_copy(update={"power": 2.0})), directions, samples=32)[0]
    assert twice == pytest.approx(2 * solved[0], rel=1e-9)


def test_error_bars_cover() -> None:
    """Twenty seeds at four directions, near and far, on the ground and aloft."""
    within = []
    for distance, altitude in ((5e3, 0.0), (20e3, 0.0), (60e3, 0.0), (20e3, 3000.0)):
        night = scene(altitude=altitude)
        found = [
            Lamplight(night, GREEN, CITY, seed).often(distance, rays([1.0, 10, 45, -60], [10.0, 90, 180, 0]), 256)
            for seed in range(20)
        ]
        mean, error = (np.array(part)[:, :, 0] for part in zip(*found, strict=True))
        truth = mean.mean(axis=0)
        within.append(np.abs(mean - truth) / np.hypot(error, mean.std(axis=0) / np.sqrt(20)) < 2)
    # 95 % of 320 lie within two standard errors; three standard deviations of that share are 4 %.
    assert np.mean(within) > 0.90


@pytest.mark.slow
@pytest.mark.parametrize("distance", [20e3, 60e3])
def test_error_bars_cover_in_haze(distance: float) -> None:
    """Where a far town's light has been scattered many times, by as many walks as there are made then."""
    night = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=-90)
    found = [
        Lamplight(night, GREEN, CITY, seed).often(distance, rays([1.0, 10, 45, -60], [10.0, 90, 180, 0]), 4096)
        for seed in range(20)
    ]
    mean, error = (np.array(part)[:, :, 0] for part in zip(*found, strict=True))
    z = (mean - mean.mean(axis=0)) / np.hypot(error, mean.std(axis=0) / np.sqrt(20))
    assert np.mean(np.abs(z) < 2) > 0.87  # 95 % of 80, less three standard deviations of that share


def test_thick_air_has_more_walks_and_a_warning() -> None:
    night = skyscatter.load_model("earth-hazy").model_copy(
        update={"towns": (Town(distance="60 km", azimuth_deg=0, power=1.0),)}
    )
    with pytest.warns(UserWarning, match="may state too small an error"):
        town_glow(night.scene(sun_elevation_deg=-90), GREEN, samples=16)


def test_walker_s_law() -> None:
    """Brightness over a town falls as its distance to the power -2.5 (Walker 1977, PASP 89, 405), 10 to 50 km."""
    distances = np.array([10e3, 17e3, 30e3, 50e3])
    light = []
    for distance in distances:
        night = scene(Town(distance=distance, azimuth_deg=0, radius="2 km", power=1.0))
        light.append(glowing(night, rays([90.0, 45.0], [0.0, 0.0]), samples=128)[0][:, 0])
    slope = np.polyfit(np.log(distances), np.log(light), 1)[0]
    # Published exponents lie between -2.2 and -2.8, with air and lamps.
    assert np.all(np.abs(slope + 2.5) < 0.3)


def test_curvature_hides_the_lamp_but_not_its_light() -> None:
    """At 150 km air up to 1.8 km lies in the Earth's shadow of the lamp: a low ray sees the glow rise above that."""
    night = scene()
    directions = rays([0.2, 90.0], [0.0, 0.0])
    once = Lamplight(night, GREEN, CITY).once(150e3, directions)
    assert np.all(once > 0)
    # Beyond 2 000 km even the top of the air over the observer is in the shadow of the other's horizon.
    assert not Lamplight(night, GREEN, CITY).once(2.5e6, directions).any()


def test_black_ground_gives_nothing_back() -> None:
    town = Town(distance="20 km", azimuth_deg=0, power=1.0)
    directions = rays([-30.0, 60.0], [0.0, 0.0])
    dark, light = (glowing(scene(town, albedo=a), directions, samples=64)[0][:, 0] for a in (0.0, 0.5))
    assert dark[0] < 1e-6 * light[0]
    assert light[1] > 1.02 * dark[1]  # the sky too is brighter over bright ground


def test_the_sky_has_no_seams() -> None:
    """Neither nodes nor cells are seen: second differences over a tenth of a degree are those of a smooth curve."""
    glow = town_glow(scene(Town(distance="20 km", azimuth_deg=0, radius="3 km", power=1.0)), GREEN, samples=64)
    assert glow is not None
    turn = np.arange(-40.0, 40.0, 0.1)  # across the cell at which the azimuth begins anew
    around = [np.log(glow.at(rays(e, turn))[0][:, 0]) for e in (5.0, 40.0)]
    up = np.arange(2.0, 178.0, 0.1)  # over the zenith and down on the other side
    over = [np.log(glow.at(rays(up, a))[0][:, 0]) for a in (0.0, 70.0)]
    # At 2 degrees the light falls by curvatures of 0.09 per square degree: 9e-4 here, at 5 degrees 1e-4.  Splines
    # through walks with noise bend at the zenith by as much.  A step of 0.1 %, which no eye sees, would be found.
    assert max(np.abs(np.diff(line, 2)).max() for line in (*around, *over)) < 1e-3


def test_lamps_in_sight_keep_their_light() -> None:
    """From 3 km a town 30 km away is seen, from the ground it is not; a picture holds its irradiance."""
    town = Town(distance="30 km", azimuth_deg=20, radius=0, power=2.0)
    night = scene(town, altitude=3000.0)
    directions, irradiance = lamps_seen(night, GREEN)
    lamp = EARTH * np.array([0.0, 0.0, 1.0])
    angle = 30e3 / EARTH
    eye = (EARTH + 3000.0) * np.array([np.sin(angle), 0.0, np.cos(angle)])
    far = float(np.linalg.norm(eye - lamp))
    cosine = float((eye - lamp)[2]) / far
    start = night.observer.position
    through = skyscatter.transmittance(night, start, start + far * (1 - 1e-6) * directions[0], GREEN)
    expected = 2.0 * CityLobe().value(cosine) / far**2 * through
    assert irradiance[0] == pytest.approx(expected, rel=1e-4)  # the way was cut short by a millionth
    assert np.degrees(np.arctan2(directions[0, 0], directions[0, 1])) == pytest.approx(20.0)
    assert not len(lamps_seen(scene(town), GREEN)[0])
    camera = skyscatter.Perspective(azimuth_deg=20, elevation_deg=-5, fov_deg=20, width=32, height=32)
    glow = glowing(night, camera.directions(night.observer).reshape(-1, 3), samples=512)[0].reshape(32, 32, 1)
    image = skyscatter.render(night, camera, GREEN, solver="single")
    drawn = ((image.radiance - glow) * camera.pixel_solid_angle(night.observer)[..., None]).sum()
    assert drawn == pytest.approx(irradiance.sum(), rel=1e-6)  # rounding of a sum of other light


def test_no_town_is_no_light() -> None:
    assert town_glow(scene(), GREEN) is None


@pytest.mark.slow
@pytest.mark.parametrize("distance", [20e3, 60e3])
def test_zenith_by_photons(distance: float) -> None:
    """All orders at the zenith against photons from the lamp, in numpy."""
    night = scene()
    optics = compile_scene(night, GREEN).optics
    air = PlainAir(gas=float(optics.sigma_s[0, 0]), haze=float(optics.sigma_t[1, 0]))
    expected, judge = zenith_by_photons(air, (CITY[0], CITY[1]), distance, 2_000_000, 5)
    light = Lamplight(night, GREEN, CITY)
    once = light.once(distance, rays([90.0], [0.0]))[0, 0]
    often, error = (part[0, 0] for part in light.often(distance, rays([90.0], [0.0]), 16384))
    # The ring of the judge and Rayleigh's law without depolarisation leave 0.5 %.
    assert abs(once - expected[0]) < 3 * judge[0] + 0.005 * once
    assert abs(once + often - expected[1]) < 3 * np.hypot(judge[1], error) + 0.005 * (once + often)
    assert judge[1] < 0.04 * expected[1]


def surface_scene(power: float) -> Any:
    """The same city among surfaces, seen by the package's general walks."""
    found: Any = skyscatter.load_model("city-skyglow").scene()
    body = found.bodies[0]
    body = body.model_copy(update={"material": type(body.material)(albedo=0.2)})
    lamp = PointLamp(position=(0, 0, 1.0), power=power, lobe=CityLobe())
    return found.model_copy(update={"lamps": (lamp,), "bodies": (body,)})


def judged(distance: float, walks: int, max_order: int | None) -> Any:
    """Light by general walks, towards `ELEVATIONS` and `AZIMUTHS`, from an observer south of the city."""
    angle = distance / EARTH
    up = np.array([0.0, -np.sin(angle), np.cos(angle)])
    axes = np.stack([[1.0, 0.0, 0.0], [0.0, np.cos(angle), np.sin(angle)], up])
    origin = (EARTH + 1.0) * up - [0.0, 0.0, EARTH]
    directions = rays(ELEVATIONS, AZIMUTHS) @ axes
    solver = skyscatter.Path(samples=walks, max_order=max_order)
    return skyscatter.radiance(surface_scene(1e6), np.tile(origin, (6, 1)), directions, GREEN, solver=solver)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [5e3, 20e3, 60e3])
def test_glow_against_walks_among_surfaces(distance: float) -> None:
    """The sky that is solved at nodes, to the error of each; the first order alone, and all light.

    At 60 km general walks find the light of many scatterings too rarely for their error bars: at the zenith 65536 of
    them are 20 % dark.  Photons in numpy judge that; here it is compared where the first order rules.
    """
    night = scene(Town(distance=distance, azimuth_deg=0, radius=0, power=1e6))
    directions = rays(ELEVATIONS, AZIMUTHS)
    for max_order, kept in ((1, slice(None)), (None, slice(0, 2) if distance > 30e3 else slice(None))):
        light, error = glowing(night, directions, max_order=max_order, samples=2048)
        walks = judged(distance, 2048 if max_order else 8192, max_order)
        z = (light - walks.radiance) / np.hypot(error, walks.standard_error)
        assert np.all(np.abs(z[kept]) < 3), z
