"""How walks look for lamps: choices, densities, where on a leg."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from walk_scenes import WAVELENGTHS, directions, fog, medium

from skyscatter import SurfaceScene
from skyscatter.kernels.jit import entry
from skyscatter.kernels.surfaces.gathering import WalkTable
from skyscatter.kernels.surfaces.lamps import aim, guess_at_point, meeting_density, pick
from skyscatter.kernels.surfaces.legs import aim_on_leg, density_on_leg, draw_on_leg, within_cone
from skyscatter.kernels.surfaces.past import BRIGHT, GLINT, WAVY, density_past, draw_past
from skyscatter.solvers.surface_path import guided
from skyscatter.solvers.surfaces import compile_surfaces
from skyscatter.surfaces.lamps import AreaLamp, ParallelLamp, PointLamp, SpotLamp, Surroundings
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.scene import Body
from skyscatter.surfaces.shapes import Box, Disk, Rectangle, Sphere


@entry
def aim_often(table, k, x, u, density, other, light, met):  # type: ignore[no-untyped-def]
    """Densities of directions to lamp k by aiming, and by what `meeting_density` says of them."""
    d, point = met[0], met[1]
    for n in range(u.shape[0]):
        distance, item, density[n], light[n] = aim(table.shapes, table.lamps, k, x, u[n, 0], u[n, 1], d[:3], point)
        cosine = 0.0
        if density[n] > 0.0:
            cosine = table.lamps.area[k] / (distance * distance) * density[n]
            cosine = 1.0 / cosine if cosine > 0.0 else 0.0
        other[n] = meeting_density(table.shapes, table.lamps, k, item, x, distance, cosine) if item >= 0 else 0.0


@entry
def on_leg(table, k, x, d, far, u, t, density, kept):  # type: ignore[no-untyped-def]
    """Draws on a leg by where lamp k is near, and their densities."""
    kept[0], along, height, low, high = aim_on_leg(table.lamps, table.guide, 0, k, x, d, far)
    kept[1], kept[2] = low, high
    for n in range(u.size):
        t[n] = draw_on_leg(table.guide.gathered[0], along, height, low, high, u[n])
        density[n] = density_on_leg(table.guide.gathered[0], along, height, low, high, t[n])


@entry
def past_lamp(table, k, x, from_air, u, share, to, d, density):  # type: ignore[no-untyped-def]
    """Directions (draw, 3) that pass lamp k, and their densities."""
    for n in range(u.shape[0]):
        draw_past(table, 0, k, x, from_air, u[n, 0], u[n, 1], d[n])
        density[n] = density_past(table, 0, x, d[n], share, from_air, to)


@entry
def cone(axis, lowest, x, d, start, end, out):  # type: ignore[no-untyped-def]
    out[0], out[1] = within_cone(axis, lowest, x[0], x[1], x[2], d, start, end)


@entry
def choices(table, x, n, chance, u, chosen):  # type: ignore[no-untyped-def]
    guess_at_point(table.lamps, table.guide, x, n, False, chance)
    for k in range(u.size):
        chosen[k] = pick(chance, u[k])


def lit(shape: Any) -> Body:
    return Body(name=shape.kind, shape=shape, material=Lambert(albedo=0.0), lamp=AreaLamp(power=1.0))


@pytest.fixture(scope="module")
def table() -> dict[str, WalkTable]:
    shapes = (
        Sphere(position=(0, 0, 3), radius=0.5), Disk(position=(3, 0, 0), normal=(-1, 0, 0), radius=0.5),
        Rectangle(position=(0, 3, 0), normal=(0, -1, 0.2), size=(1, 0.5)), Box(position=(-3, 0, 0), size=(1, 0.5, 0.2)),
    )  # fmt: skip
    lamps = (
        PointLamp(position=(1, 1, -2), power=1.0),
        SpotLamp(position=(0, -2, 0), target=(0, 0, 0), half_angle_deg=30, power=1.0),
        ParallelLamp(direction=(0, 0, 1), irradiance=0.01), Surroundings(radiance=1.0),
    )  # fmt: skip
    outside = SurfaceScene(media=(medium("fog", fog(0.5, 0.9, 0.7)),), bodies=tuple(map(lit, shapes)), lamps=lamps[:2])
    clear = SurfaceScene(bodies=tuple(map(lit, shapes)), lamps=lamps)
    return {name: guided(compile_surfaces(s, WAVELENGTHS)) for name, s in (("fog", outside), ("clear", clear))}


def test_the_guide_knows_where_lamps_are(table: dict[str, WalkTable]) -> None:
    guide = table["clear"].guide
    places = [(0, 0, 3), (3, 0, 0), (0, 3, 0), (-3, 0, 0), (1, 1, -2), (0, -2, 0)]
    # Middles come from 256 points spread over the surface.
    np.testing.assert_allclose(guide.middle[:6], places, atol=0.05)
    np.testing.assert_allclose(guide.size[:4], [0.5, 0.5, math.hypot(0.5, 0.25), 0.56], atol=0.07)
    np.testing.assert_array_equal(guide.lowest[:5], [-1, 0, 0, -1, -1])
    assert guide.lowest[5] == pytest.approx(math.cos(math.radians(30)), abs=1e-6)
    np.testing.assert_allclose(guide.blind, np.array([1, 1, 1, 1, 1, 1, 1, 0]) / 7)
    assert guide.open
    np.testing.assert_array_equal(guide.background, 1.0)
    assert not table["fog"].guide.open


def test_the_integral_of_the_phase_function_over_the_angle(table: dict[str, WalkTable]) -> None:
    """From 0 to pi: 9 parts Henyey and Greenstein's, one of all directions alike."""
    g, angle = 0.7, np.linspace(0, np.pi, 200001)
    phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.cos(angle)) ** 1.5)
    expected = 0.9 * np.trapezoid(phase, angle) + 0.1 / 4
    assert table["fog"].guide.gathered[0, -1] == pytest.approx(expected, rel=1e-3)
    assert table["fog"].guide.scatters[0]
    assert not table["clear"].guide.scatters[0]


@pytest.mark.parametrize("k", range(4))
def test_aiming_has_the_density_that_meeting_takes_it_to_have(table: dict[str, WalkTable], k: int) -> None:
    u = np.random.default_rng(k).random((4000, 2))
    density, other, light = np.empty(4000), np.empty(4000), np.empty(4000)
    x = np.array([0.1, 0.2, 0.3])
    aim_often(table["clear"], k, x, u, density, other, light, np.zeros((2, 6)))
    shone = light > 0
    assert shone.mean() > 0.1
    if k > 0:  # by area; the cone of a sphere has no use for the cosine
        np.testing.assert_allclose(other[shone], density[shone], rtol=1e-9)
    else:
        np.testing.assert_allclose(other[shone], density[shone], rtol=1e-12)
    # Irradiance over pi of a Lambertian lamp far away: power / pi / d^2 cos, to the size of the lamp squared.
    solid = np.mean(np.where(shone, light / np.where(shone, density, 1.0), 0.0))
    distance = np.linalg.norm(x - table["clear"].guide.middle[k])
    towards = (x - table["clear"].guide.middle[k]) / distance
    area = {0: 1 / 4, 1: -towards[0], 2: towards @ np.array([0, -1, 0.2]) / math.hypot(1, 0.2)}
    if k in area:
        assert solid == pytest.approx(area[k] / (math.pi * distance**2), rel=0.05)


@pytest.mark.parametrize("k", [0, 1, 4, 5])
@pytest.mark.parametrize("far", [2.0, math.inf])
def test_points_on_legs_have_the_density_that_is_stated(table: dict[str, WalkTable], k: int, far: float) -> None:
    """The mean of f / density over draws is the integral of f, here of 1 / (1 + t^2)."""
    x = np.array([0.2, -0.5, 0.1])
    for d in directions(4, k):
        u = (np.arange(20000) + 0.5) / 20000
        t, density, kept = np.empty(u.size), np.empty(u.size), np.empty(3)
        on_leg(table["fog"], k, x, d, far, u, t, density, kept)
        if kept[2] <= kept[1]:
            continue
        # Draws are at even steps of their distribution: what is left is the rule of the middle, and the cells' edges.
        inside = density > 0
        assert inside.mean() > 0.999
        value = np.mean(np.where(inside, 1 / (1 + t**2) / np.where(inside, density, 1.0), 0.0))
        expected = math.atan(t.max()) - math.atan(t.min())
        assert value == pytest.approx(expected, rel=0.02)
        assert t.min() >= -1e-9
        assert t.max() <= min(far, 8 / 0.5) * (1 + 1e-6)


@pytest.mark.parametrize("k", [0, 1, 4, 5])
@pytest.mark.parametrize("x", [(0.2, -0.5, 0.1), (0.0, 0.4, 1.9), (2.2, 0.1, -0.2)])
def test_directions_past_lamps_have_the_density_that_is_stated(
    table: dict[str, WalkTable], k: int, x: tuple[float, float, float]
) -> None:
    """The mean of f / density over draws is the integral of f, here of exp(c . d): 4 pi sinh |c| / |c|."""
    u = np.stack(np.meshgrid(*[(np.arange(600) + 0.5) / 600] * 2), axis=-1).reshape(-1, 2)
    d, density, share = np.empty((len(u), 3)), np.empty(len(u)), np.zeros(len(table["fog"].lamps.kind))
    share[k] = 0.25
    past_lamp(table["fog"], k, np.array(x), True, u, share, np.zeros(3), d, density)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, rtol=1e-12)
    for c in ([0.0, 0.0, 1e-6], [2.0, -1.0, 0.5]):
        size = np.linalg.norm(c)
        # Draws are at even steps.  Far behind a lamp hardly any light is seen: few draws stand for much there.
        assert np.mean(np.exp(d @ c) / density) * 0.25 == pytest.approx(4 * math.pi * math.sinh(size) / size, rel=0.01)


@pytest.mark.parametrize("from_air", [True, False])
@pytest.mark.parametrize("x", [(0.0, 0.0, 2.0), (3.0, -1.0, 1.0), (0.0, -40.0, -10.0)])
def test_directions_around_parallel_light_go_to_its_image_too(x: tuple[float, float, float], from_air: bool) -> None:
    """A share of them from air over a sea, here around a ball of 10 m, where the lamp stands above the horizon."""
    lamp = ParallelLamp(direction=(0.0, 0.8, 0.6), irradiance=1.0)
    scene = guided(compile_surfaces(SurfaceScene(lamps=(lamp,)), WAVELENGTHS))
    sea = scene._replace(guide=scene.guide._replace(size=np.array([0.2]), sea=10.0))
    u = np.stack(np.meshgrid(*[(np.arange(600) + 0.5) / 600] * 2), axis=-1).reshape(-1, 2)
    d, density, share = np.empty((len(u), 3)), np.empty(len(u)), np.array([0.25])
    past_lamp(sea, 0, np.array(x), from_air, u, share, np.zeros(3), d, density)
    for c in ([0.0, 0.0, 1e-6], [2.0, -1.0, 0.5]):
        size = np.linalg.norm(c)
        assert np.mean(np.exp(d @ c) / density) * 0.25 == pytest.approx(4 * math.pi * math.sinh(size) / size, rel=0.01)
    # Up on the ball as seen from its middle, and what a level mirror there makes of the light.
    up = np.add(x, [0.0, 0.0, 10.0]) / np.linalg.norm(np.add(x, [0.0, 0.0, 10.0]))
    towards = np.array(lamp.direction) / np.linalg.norm(lamp.direction)
    image = towards - 2 * (towards @ up) * up
    seen = from_air and towards @ up > 0
    mirrored = 0.02 + 0.98 * (1 - towards @ up) ** 5  # after Schlick
    glint = GLINT * mirrored / (mirrored + BRIGHT)
    often = glint / (glint + sea.guide.size[0]) if seen else 0.0
    around = np.mean(d @ image > math.cos(WAVY))
    assert around >= often
    assert around < often + 0.5
    assert seen == (x[2] > 0 and from_air)


def test_where_lines_are_within_cones() -> None:
    """Against many points on the line."""
    rng, t = np.random.default_rng(4), np.linspace(0, 10, 4001)
    found = 0
    for _ in range(200):
        axis, d = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        x, lowest = rng.normal(size=3), float(rng.choice([0.0, 0.3, 0.8, 0.97]))
        out = np.empty(2)
        cone(axis, lowest, x, d, 0.0, 10.0, out)
        points = x + t[:, None] * d
        inside = points @ axis >= lowest * np.linalg.norm(points, axis=1)
        stated = (t >= out[0]) & (t <= out[1])
        # Two points of the line may lie on the edge.
        assert np.sum(inside != stated) <= 2
        found += bool(inside.any())
    assert found > 50


def test_lamps_are_chosen_by_what_arrives_and_none_is_forgotten(table: dict[str, WalkTable]) -> None:
    chance, u = np.empty(8), (np.arange(7000) + 0.5) / 7000
    chosen = np.empty(u.size, np.int64)
    choices(table["clear"], np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]), chance, u, chosen)
    assert chance.sum() == pytest.approx(1.0)
    assert chance[7] == 0.0
    assert np.all(chance[:7] >= 0.1 / 7 * (1 - 1e-12))
    assert np.argmax(chance) == 0  # the ball straight above
    np.testing.assert_allclose(np.bincount(chosen, minlength=8) / u.size, chance, atol=2 / 7000)
