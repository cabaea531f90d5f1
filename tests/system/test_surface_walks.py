"""Walks among surfaces, media and lamps against what is known in closed form, and against other solvers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from plane_parallel import IsotropicLayers
from scipy import integrate
from significance import assert_agrees, over_seeds
from walk_scenes import WAVELENGTHS, directions, fog, look, medium, room, spectrum

import skyscatter
from skyscatter import SurfaceScene
from skyscatter.errors import DomainError
from skyscatter.media.shapes import GaussianSphere
from skyscatter.media.structures import Box as BoxField
from skyscatter.surfaces.lamps import AreaLamp, ParallelLamp, PointLamp, SpotLamp, Surroundings
from skyscatter.surfaces.materials import Dielectric, Interface, Lambert, Mirror
from skyscatter.surfaces.scene import Body, SurfaceMedium, Viewpoint
from skyscatter.surfaces.shapes import Box, Disk, Plane, Rectangle, Sphere

#: Scenes with mirrors and point lamps, judged where `path` finds all there is.
pytestmark = pytest.mark.filterwarnings("ignore:path does not find")
ALBEDO = np.array([0.2, 0.4, 0.6])
INSIDE = (0.2, 0.1, -0.3)
#: Phase functions are tabulated and made to integrate to 1 as such: straight lines over 0.2 degrees.
TABLES = 2e-4


def furnace_error(answer: skyscatter.Answer, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over rays of the radiance over what is expected, and its standard error."""
    rays = answer.radiance.reshape(-1, 3)
    return rays.mean(axis=0) / expected, np.sqrt((answer.standard_error.reshape(-1, 3) ** 2).sum(axis=0)) / (
        len(rays) * expected
    )


# --- white furnaces -----------------------------------------------------------------------------------------------


AIR = fog(spectrum(0.5, 1.0, 2.0), 1.0, 0.7)
PUFF = fog(spectrum(2.0, 1.0, 0.5), 1.0, 0.5, GaussianSphere(width=0.4))
BALL = Body(name="ball", shape=Sphere(position=(0, 0, -0.2), radius=0.5), material=Interface(), inside="ball")
#: Kernels are compiled once for media that are the same everywhere, and once more for fields.
FIELDS = pytest.mark.slow
DENSE = fog(spectrum(3.0, 1.0, 0.5), 1.0, 0.3)
FURNACES = {
    "empty": ((medium("air"),), ()),
    "fog": ((medium("air", AIR),), ()),
    "a puff": ((medium("air", PUFF),), ()),
    "fog within fog": (
        (medium("air", AIR), medium("ball", DENSE, priority=1)),
        (BALL,),
    ),
    "a puff within fog": ((medium("air", AIR), medium("ball", PUFF, priority=1)), (BALL,)),
}


@pytest.mark.parametrize("sampling", [None, "angular"])
@pytest.mark.parametrize("filling", [pytest.param(name, marks=FIELDS) if "puff" in name else name for name in FURNACES])
def test_white_furnace(filling: str, sampling: str | None) -> None:
    """Walls that all shine alike see E / (1 - a) everywhere; fog that absorbs nothing changes nothing."""
    media, bodies = FURNACES[filling]
    scene = SurfaceScene(media=media, bodies=(*room(1.0, spectrum(*ALBEDO), 2.0), *bodies))
    answer = look(scene, INSIDE, directions(16), samples=1024, sampling=sampling)
    mean, error = furnace_error(answer, 2.0 / (1.0 - ALBEDO))
    assert_agrees(mean, np.ones(3), error)
    assert np.all(error < 0.01)


def test_radiance_in_glass_is_that_outside_times_the_index_squared() -> None:
    """Dispersive glass, with fog in it: light that is trapped at first gets in by scattering."""
    index = np.array([1.4, 1.5, 1.7])
    glass = Body(name="glass", shape=Sphere(radius=0.5), material=Dielectric(), inside="glass")
    media = (medium("air"), medium("glass", fog(0.4, 1.0), index=spectrum(*index)))
    scene = SurfaceScene(media=media, bodies=(glass,), lamps=(Surroundings(radiance=3.0),))
    mean, error = furnace_error(look(scene, (0.1, 0.0, 0.05), directions(16), samples=2048), 3.0 * index**2)
    assert_agrees(mean, np.ones(3), error)
    assert np.all(error < 0.02)
    outside = look(scene, (0.0, -3.0, 0.0), (0.05, math.sqrt(1 - 0.05**2), 0.0), samples=4096)
    assert_agrees(outside.radiance, 3.0, outside.standard_error)


@pytest.mark.slow
def test_furnace_through_nested_media() -> None:
    """Of glass around water each has its own n^2, wherever the camera is."""
    scene = SurfaceScene(
        media=(medium("air"), medium("glass", index=1.5), medium("water", fog(1.0, 1.0), index=1.33, priority=1)),
        bodies=(
            Body(name="glass", shape=Sphere(radius=1.0), material=Dielectric(), inside="glass"),
            Body(name="water", shape=Sphere(radius=0.6), material=Dielectric(), inside="water"),
        ),
        lamps=(Surroundings(radiance=1.0),),
    )
    for place, index in (((0.1, 0.0, 0.0), 1.33), ((0.62, 0.0, 0.0), 1.5), ((2.0, 0.0, 0.0), 1.0)):
        towards = -np.array(place) / np.linalg.norm(place)
        answer = look(scene, place, towards, samples=4096)
        # Seen straight through there is nothing left to chance but the last digits.
        assert_agrees(answer.radiance, index**2, answer.standard_error, slack=1e-9)
        assert np.all(answer.standard_error < 0.05 * index**2)


# --- media that nest ----------------------------------------------------------------------------------------------


def fresnel(here: float, there: float, cosine: float) -> float:
    """Reflectance of unpolarised light (Born & Wolf 1999, Principles of Optics, section 1.5.2)."""
    beyond = math.sqrt(1 - (here / there) ** 2 * (1 - cosine**2))
    across = (here * cosine - there * beyond) / (here * cosine + there * beyond)
    along = (there * cosine - here * beyond) / (there * cosine + here * beyond)
    return 0.5 * (across**2 + along**2)


def through_stack(indices: list[float], depths: list[float], sine: float) -> float:
    """Share of the light that passes plane layers, all reflections between them counted, phases not.

    `sine` is that in the first medium times its index; layers are joined one by one (Stokes 1862, Proc. R. Soc. 11,
    545).
    """
    reflected, back, passed = 0.0, 0.0, 1.0
    for k in range(len(indices) - 1):
        r = fresnel(indices[k], indices[k + 1], math.sqrt(1 - (sine / indices[k]) ** 2))
        between = 1 - back * r
        reflected, passed, back = (
            reflected + passed**2 * r / between,
            passed * (1 - r) / between,
            r + (1 - r) ** 2 * back / between,
        )
        if k + 1 < len(indices) - 1:
            t = math.exp(-depths[k] / math.sqrt(1 - (sine / indices[k + 1]) ** 2))
            passed, back = passed * t, back * t * t
    return passed


def test_the_medium_of_highest_priority_fills_the_overlap() -> None:
    """Glass that reaches into water of higher priority begins at the water's surface: as layers that fit."""
    lamp = Body(
        name="lamp", shape=Disk(position=(0, 0, -3), radius=9.0), material=Lambert(albedo=0.0),
        lamp=AreaLamp(radiance=1.0),
    )  # fmt: skip
    media = (
        medium("air"), medium("water", fog(0.5, 0.0), index=1.33, priority=1), medium("glass", fog(0.3, 0.0), index=1.6)
    )  # fmt: skip
    bodies = (
        Body(name="water", shape=Box(position=(0, 0, -0.5), size=(40, 40, 1)), material=Dielectric(), inside="water"),
        Body(name="glass", shape=Box(position=(0, 0, 0.2), size=(40, 40, 1.6)), material=Dielectric(), inside="glass"),
        lamp,
    )
    scene = SurfaceScene(media=media, bodies=bodies)
    for sine in (0.0, 0.5):
        towards = (sine, 0.0, -math.sqrt(1 - sine**2))
        answer = look(scene, (-1.0, 0.1, 3.0), towards, samples=4096)
        expected = through_stack([1.0, 1.6, 1.33, 1.0], [0.3, 0.5], sine)
        assert_agrees(answer.radiance, expected, answer.standard_error)
        assert np.all(answer.standard_error < 0.02)


def test_interfaces_and_hidden_boundaries_only_change_the_medium() -> None:
    """What absorbs dims by the way through it, exactly; a boundary in a medium of higher priority is not there."""
    bodies = (
        Body(name="smoke", shape=Sphere(radius=1.0), material=Interface(), inside="smoke"),
        Body(name="soot", shape=Box(position=(1.0, 0, 0), size=(1.0, 1, 1)), material=Interface(), inside="soot"),
        Body(name="hidden", shape=Sphere(position=(-0.5, 0, 0), radius=0.2), material=Dielectric(), inside="glass"),
    )
    media = (
        medium("air"), medium("smoke", fog(spectrum(0.1, 0.2, 0.4), 0.0), priority=1),
        medium("soot", fog(spectrum(0.7, 0.6, 0.5), 0.0), priority=2), medium("glass", index=1.5),
    )  # fmt: skip
    scene = SurfaceScene(media=media, bodies=bodies, lamps=(Surroundings(radiance=2.0),))
    answer = look(scene, (-4.0, 0.0, 0.0), (1.0, 0.0, 0.0), samples=16)
    depth = 1.5 * np.array([0.1, 0.2, 0.4]) + 1.0 * np.array([0.7, 0.6, 0.5])
    # One boundary after the other and nothing to choose: no noise, but that of exponentials good to 3e-10.
    np.testing.assert_allclose(answer.radiance, 2.0 * np.exp(-depth), rtol=1e-8)
    inside = look(scene, (-0.5, 0.05, 0.0), (1.0, 0.0, 0.0), samples=16)
    np.testing.assert_allclose(inside.radiance, 2.0 * np.exp(-depth + 0.5 * np.array([0.1, 0.2, 0.4])), rtol=1e-8)


def test_dispersion_sends_wavelengths_apart() -> None:
    """Through a wedge each wavelength comes from where Snell's law sends it, and from nowhere else."""
    index = np.array([1.3, 1.5, 1.7])
    # One face of a large turned box stands across the ray, the other at an angle: a wedge of 30 degrees.
    wedge = Body(
        name="wedge", shape=Box(size=(10.0, 10.0, 10.0), position=(5.0, 0.0, 0.0)), material=Dielectric(),
        inside="glass",
    )  # fmt: skip
    sine = math.sin(math.radians(40.0))
    towards = (math.sqrt(1 - sine**2), sine, 0.0)
    bent = np.arcsin(sine / index)
    # A lamp in the glass, where light of the middle wavelength comes from, too small for the others.
    far = 4.0
    lamp = Body(
        name="lamp", shape=Sphere(position=(far * math.cos(bent[1]), far * math.sin(bent[1]), 0.0), radius=0.1),
        material=Lambert(albedo=0.0), lamp=AreaLamp(radiance=1.0),
    )  # fmt: skip
    scene = SurfaceScene(media=(medium("air"), medium("glass", index=spectrum(*index))), bodies=(wedge, lamp))
    start = -2.0 * np.array(towards)
    answer = look(scene, start, towards, samples=4096)
    share = 1 - fresnel(1.0, 1.5, towards[0])
    assert_agrees(answer.radiance[1], share / 1.5**2, answer.standard_error[1])
    np.testing.assert_array_equal(answer.radiance[[0, 2]], 0.0)


# --- lamps in closed form -----------------------------------------------------------------------------------------


def test_point_lamp_over_a_plane() -> None:
    """Lambert's plane under a point: a / pi P / 4 pi cos^3 / h^2; nothing is left to chance."""
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=spectrum(*ALBEDO)))
    lamp = PointLamp(position=(0.0, 0.0, 2.0), power=spectrum(1.0, 2.0, 3.0))
    for distance in (0.0, 1.0, 3.0):
        towards = np.array([distance, 0.0, -1.0]) - np.array([0.5, 0.3, 0.0])
        answer = look(
            SurfaceScene(bodies=(floor,), lamps=(lamp,)), (0.5, 0.3, 1.0), towards / np.linalg.norm(towards), samples=16
        )
        cosine = 2.0 / math.hypot(2.0, distance)
        light = np.array([1.0, 2.0, 3.0]) / (4 * np.pi) * cosine**3 / 4.0
        np.testing.assert_allclose(answer.radiance, ALBEDO / np.pi * light, rtol=1e-9)


def test_spot_lamp_lights_its_cone_alone() -> None:
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    lamp = SpotLamp(position=(0.0, 0.0, 2.0), axis=(0.0, 0.0, -1.0), half_angle_deg=20.0, power=1.0)
    scene = SurfaceScene(bodies=(floor,), lamps=(lamp,))
    for angle, lit in ((0.0, True), (19.0, True), (21.0, False), (60.0, False)):
        x = 2.0 * math.tan(math.radians(angle))
        answer = look(scene, (x, 0.0, 1.0), (0.0, 0.0, -1.0), samples=16)
        cosine = math.cos(math.radians(angle))
        intensity = 1.0 / (2 * np.pi * (1 - math.cos(math.radians(20.0))))
        np.testing.assert_allclose(
            answer.radiance, 0.5 / np.pi * intensity * cosine**3 / 4.0 if lit else 0.0, rtol=1e-6
        )


def test_parallel_light_and_mirrors() -> None:
    """A mirror shows a floor that parallel light strikes aslant: rho a / pi E cos."""
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    mirror = Body(
        name="mirror", shape=Rectangle(position=(0, 5, 2), normal=(0, -1, 0), size=(4, 4)),
        material=Mirror(reflectance=spectrum(0.9, 0.8, 0.7)),
    )  # fmt: skip
    lamp = ParallelLamp(direction=(1.0, 0.0, 1.0), irradiance=2.0)
    scene = SurfaceScene(bodies=(floor, mirror), lamps=(lamp,))
    towards = np.array([0.0, 1.0, -0.2]) / math.hypot(1.0, 0.2)
    answer = look(scene, (0.0, 0.0, 2.0), towards, samples=16)
    light = np.array([0.9, 0.8, 0.7]) * 0.5 / np.pi * 2.0 * math.sqrt(0.5)
    np.testing.assert_allclose(answer.radiance, light, rtol=1e-9)


def disk_irradiance(radius: float, height: float) -> float:
    """Irradiance under a Lambertian disk of radiance 1 on its axis: pi r^2 / (r^2 + h^2)."""
    return math.pi * radius**2 / (radius**2 + height**2)


@pytest.mark.parametrize("sampling", [None, "area", "angular"])
def test_disk_over_a_plane_in_area_and_angular_form(sampling: str | None) -> None:
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=spectrum(*ALBEDO)))
    lamp = Body(
        name="lamp", shape=Disk(position=(0, 0, 1.0), normal=(0, 0, -1), radius=1.5), material=Lambert(albedo=0.0),
        lamp=AreaLamp(radiance=2.0),
    )  # fmt: skip
    answer = look(
        SurfaceScene(bodies=(floor, lamp)), (0.6, 0.0, 0.5), np.array([-0.6, 0, -0.5]) / math.hypot(0.6, 0.5),
        samples=4096, sampling=sampling,
    )  # fmt: skip
    assert_agrees(answer.radiance, ALBEDO / math.pi * 2.0 * disk_irradiance(1.5, 1.0), answer.standard_error)
    assert np.all(answer.standard_error < 0.02 * answer.radiance)


def test_sphere_over_a_plane_by_its_visible_cone() -> None:
    """A small bright ball far away is found as well as a point; irradiance pi sin^2 for radiance 1."""
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=1.0))
    lamp = Body(
        name="lamp", shape=Sphere(position=(0, 0, 1000.0), radius=1e-3), material=Lambert(albedo=0.0),
        lamp=AreaLamp(radiance=1.0),
    )  # fmt: skip
    answer = look(SurfaceScene(bodies=(floor, lamp)), (0.1, 0.0, 1.0), (0.0, 0.0, -1.0), samples=64)
    expected = 1e-12
    # What is left to chance is the cosine within the cone: parts in 1e12, and the place a tenth of a metre aside.
    np.testing.assert_allclose(answer.radiance, expected, rtol=2e-8)


def test_integrating_sphere() -> None:
    """Walls of a closed sphere see the same light wherever they are: P a / (1 - a) / (4 pi^2 R^2) besides the lamp."""
    wall = Body(name="wall", shape=Sphere(radius=2.0), material=Lambert(albedo=spectrum(*ALBEDO)))
    scene = SurfaceScene(bodies=(wall,), lamps=(PointLamp(position=(0.0, 0.0, 0.0), power=5.0),))
    answer = look(scene, (0.5, 0.3, 0.1), directions(4), samples=2048, orders=1, parts=True)
    once = 5.0 / (4 * np.pi) / 4.0 * ALBEDO / np.pi
    # All points of the wall are as far from the middle, and see it straight.
    np.testing.assert_allclose(answer.layers["order1"], np.broadcast_to(once, (4, 3)), rtol=1e-9)
    np.testing.assert_allclose(answer.layers["reflected"], answer.layers["order1"], rtol=1e-12)
    expected = np.broadcast_to(once / (1 - ALBEDO), (4, 3))
    assert_agrees(answer.radiance, expected, answer.standard_error, slack=1e-9)
    np.testing.assert_allclose(answer.layers["multiple"], answer.radiance - answer.layers["order1"], rtol=1e-9)


# --- scattering ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [None, pytest.param(BoxField(half_sizes=(60.0, 60.0, 60.0)), marks=FIELDS)])
def test_light_of_a_point_scattered_once_against_quadrature(where: Any) -> None:
    """A point in endless fog: the integral of p T T / d^2 over the line of sight."""
    sigma, albedo, g = np.array([0.2, 0.5, 1.0]), 0.8, 0.6
    air = fog(spectrum(*sigma), albedo, g, where)
    scene = SurfaceScene(media=(medium("fog", air),), lamps=(PointLamp(position=(1.0, 3.0, 0.5), power=4 * np.pi),))
    place, towards = np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    answer = look(scene, place, towards, samples=4096, max_order=1)

    def light(t: float, i: int) -> float:
        way = np.array([1.0, 3.0, 0.5]) - t * towards
        distance = float(np.linalg.norm(way))
        cosine = float(way @ towards) / distance
        phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        return float(albedo * sigma[i] * phase * math.exp(-sigma[i] * (t + distance)) / distance**2)

    expected = [integrate.quad(light, 0, 60, args=(i,), points=[3.0], limit=200)[0] for i in range(3)]
    assert_agrees(answer.radiance, expected, answer.standard_error, slack=TABLES)
    assert np.all(answer.standard_error < 0.01 * answer.radiance)


@pytest.mark.parametrize("where", [None, pytest.param(BoxField(half_sizes=(9, 9, 9)), marks=FIELDS)])
def test_emission_of_media(where: Any) -> None:
    """A glowing medium that absorbs: E / k (1 - exp(-k s)); one that lets through: E s; the same as a field."""
    ball = Body(name="ball", shape=Sphere(radius=1.0), material=Interface(), inside="glow")
    glow = fog(0.7, 0.0, where=where, emission=2.0)
    scene = SurfaceScene(media=(medium("air"), medium("glow", glow)), bodies=(ball,))
    answer = look(scene, (-3.0, 0.0, 0.0), (1.0, 0.0, 0.0), samples=1024)
    assert_agrees(answer.radiance, 2.0 / 0.7 * -math.expm1(-1.4), answer.standard_error, slack=1e-6)
    if where is None:
        clear = SurfaceScene(media=(medium("air"), medium("glow", fog(0.0, 0.0, emission=2.0))), bodies=(ball,))
        light = look(clear, (-3.0, 0.0, 0.0), (1.0, 0.0, 0.0), samples=16).radiance
        np.testing.assert_allclose(light, 4.0, rtol=1e-12)


def test_slab_of_fog_against_an_integral_equation() -> None:
    """A wide slab of isotropic fog under parallel light over a black floor: what leaves its top, of all orders."""
    albedo, depth, sun = 0.9, 1.0, 0.8
    truth = IsotropicLayers.solve([depth], [albedo], sun, math.pi)
    # A box 4000 times as wide as it is deep: what its sides let out does not come back to the middle.
    slab = Body(name="slab", shape=Box(position=(0, 0, -0.5), size=(4000, 4000, 1)), material=Interface(), inside="fog")
    scene = SurfaceScene(
        media=(medium("air"), medium("fog", fog(depth, albedo))), bodies=(slab,),
        lamps=(ParallelLamp(direction=(math.sqrt(1 - sun**2), 0.0, sun), irradiance=math.pi),),
    )  # fmt: skip
    mu = np.array([1.0, 0.7, 0.3])
    towards = np.stack([np.zeros(3), np.sqrt(1 - mu**2), -mu], axis=-1)
    answer = look(scene, -1.5 * towards / mu[:, None], towards, samples=4096)
    assert_agrees(answer.radiance, truth.radiance(0.0, mu)[:, None], answer.standard_error, slack=TABLES)
    assert np.all(answer.standard_error < 0.01 * answer.radiance)


# --- what the solver promises -------------------------------------------------------------------------------------


def foggy_room(lamp: bool = True) -> SurfaceScene:
    """A room in fog with a ball in it, lit by a lamp on the ceiling or by a point."""
    shape = Rectangle(position=(0.0, 0.0, 0.98), normal=(0, 0, -1), size=(0.6, 0.6))
    body = Body(name="lamp", shape=shape, material=Lambert(albedo=0.3), lamp=AreaLamp(power=1.0))
    ball = Body(name="ball", shape=Sphere(position=(0.3, 0.4, -0.6), radius=0.3), material=Dielectric(), inside="glass")
    media = (medium("air", fog(spectrum(0.3, 0.6, 1.2), 0.95, 0.6)), medium("glass", index=1.5))
    point = PointLamp(position=(0.1, 0.2, 0.8), power=1.0)
    bodies = (*room(1.0, spectrum(*ALBEDO)), *((body,) if lamp else ()), ball)
    return SurfaceScene(media=media, bodies=bodies, lamps=() if lamp else (point,))


def test_area_and_angular_form_agree_in_fog() -> None:
    """Lamps found by aiming, by meeting them, or both: three estimates of one number, glass and caustics included."""
    scene, views = foggy_room(), directions(8, 11)
    answers = {
        way: look(scene, INSIDE, views, samples=samples, sampling=way, seed=5)
        for way, samples in ((None, 2048), ("area", 4096), ("angular", 16384))
    }
    both = answers[None]
    for way in ("area", "angular"):
        other = answers[way]
        error = np.hypot(other.standard_error, both.standard_error)
        assert_agrees(other.radiance - both.radiance, 0.0, error)
    # What is combined is at no wavelength much worse at equal walks than the better of the two.
    variance = {way: np.mean(a.standard_error**2) * a.samples[0] for way, a in answers.items()}
    assert variance[None] < 1.5 * min(variance["area"], variance["angular"])


def test_orders_and_parts_add_up() -> None:
    scene, views = foggy_room(False), directions(4)
    whole = look(scene, INSIDE, views, samples=256, max_order=5, orders=5, parts=True, seed=2)
    orders = sum(whole.layers[f"order{k}"] for k in range(1, 6))
    np.testing.assert_allclose(orders + whole.layers["direct"], whole.radiance, rtol=1e-9)
    parts = sum(whole.layers[name] for name in ("direct", "scattered", "reflected", "multiple"))
    np.testing.assert_allclose(parts, whole.radiance, rtol=1e-9)
    np.testing.assert_allclose(whole.layers["scattered"] + whole.layers["reflected"], whole.layers["order1"], rtol=1e-9)
    once = look(scene, INSIDE, views, samples=2048, max_order=1, seed=3)
    again = look(scene, INSIDE, views, samples=2048, orders=1, seed=4)
    error = np.hypot(once.standard_error, again.standard_error)
    assert_agrees(once.radiance - again.layers["order1"], 0.0, error)


def test_stated_error_is_the_spread_over_seeds() -> None:
    first, runs = over_seeds(lambda seed: look(foggy_room(), INSIDE, directions(2), samples=256, seed=seed), 24)
    # Mean square of the stated errors over the spread: 24 values of 15 degrees each against one of 23.
    spread = runs["radiance"][1] * math.sqrt(24)
    stated = np.mean(
        [
            look(foggy_room(), INSIDE, directions(2), samples=256, seed=1000 + seed).standard_error ** 2
            for seed in range(24)
        ],
        axis=0,
    )
    ratio = stated / spread**2
    assert np.all((ratio > 0.3) & (ratio < 3.3))
    assert first.radiance.shape == (2, 3)


def test_the_same_seed_gives_the_same_numbers_whatever_the_threads() -> None:
    scene, views = foggy_room(), directions(12)
    one = look(scene, INSIDE, views, samples=32, threads=1)
    three = look(scene, INSIDE, views, samples=32, threads=3)
    np.testing.assert_array_equal(one.radiance, three.radiance)
    np.testing.assert_array_equal(one.standard_error, three.standard_error)
    other = look(scene, INSIDE, views, samples=32, seed=1)
    assert not np.any(one.radiance == other.radiance)


def test_noise_decides_how_many_walks() -> None:
    scene, views = foggy_room(), directions(3)
    answer = look(scene, INSIDE, views, noise=0.05)
    assert np.all((answer.standard_error / answer.radiance).mean(axis=-1) <= 0.05)
    assert np.all(answer.samples >= 512)


@pytest.mark.parametrize(
    "given",
    [
        {"sampling": "march"}, {"samples": 16, "noise": 0.1}, {"tolerance": 1e-3},
        {"transmittance": "ratio"}, {"sampling": "angular"},
    ],
)  # fmt: skip
def test_options_without_meaning_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(DomainError) as error:
        look(foggy_room(False), INSIDE, (1.0, 0.0, 0.0), **given)
    assert next(iter(given)) in str(error.value)
    assert "\n" not in str(error.value)


def test_black_scenes_are_black() -> None:
    """No lamp at all, and a lamp that is shut away."""
    dark = SurfaceScene(bodies=tuple(room(1.0, 0.5)), media=(medium("air", AIR),))
    answer = look(dark, INSIDE, directions(2), noise=0.01)
    np.testing.assert_array_equal(answer.radiance, 0.0)
    shut = SurfaceScene(bodies=tuple(room(1.0, 0.5)), lamps=(PointLamp(position=(5.0, 0.0, 0.0), power=1.0),))
    np.testing.assert_array_equal(look(shut, INSIDE, directions(2), samples=64).radiance, 0.0)
    assert WAVELENGTHS.size == 3


def test_light_that_walks_do_not_find_is_announced() -> None:
    glass = Body(name="ball", shape=Sphere(position=(0, 0, 2), radius=0.5), material=Dielectric(), inside="glass")
    media = (SurfaceMedium(name="room"), SurfaceMedium(name="glass", index=1.5))
    lamp = PointLamp(position=(0, 0, 5), power=1.0)
    scene = SurfaceScene(media=media, bodies=(glass,), lamps=(lamp,), viewpoint=Viewpoint(target=(1, 0, 0)))
    with pytest.warns(UserWarning, match="through smooth glass"):
        skyscatter.radiance(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), [550.0], solver=skyscatter.Path(samples=2))
