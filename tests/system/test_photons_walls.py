"""Photons beside walls, in corners, slits and doors: rooms in which all shines alike, and dark rooms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked
from furnace_blur import furnace_blur
from significance import assert_mean_of_runs, runs_of_power
from walk_scenes import WAVELENGTHS, directions, fog, medium, room

import skyscatter
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.scene import Body, SurfaceScene
from skyscatter.surfaces.shapes import Rectangle, Sphere

Array = Any
GREEN = WAVELENGTHS[1:2]


def shining(name: str, shape: Any, albedo: float) -> Body:
    """A body that shines with as much as it keeps: 1 everywhere, where all are such."""
    return Body(name=name, shape=shape, material=Lambert(albedo=albedo), lamp=AreaLamp(radiance=1.0 - albedo))


def in_fog(bodies: Any, extinction: float | None) -> SurfaceScene:
    """Bodies in white fog, or in a vacuum."""
    return SurfaceScene(media=(medium("air", fog(extinction)) if extinction else medium("air"),), bodies=tuple(bodies))


def closed_room(albedo: float) -> list[Body]:
    return room(1.0, albedo, 1.0 - albedo)


def wall(x: float, low: float, high: float, albedo: float) -> Body:
    """A thin wall across the x axis, from one y to the other and from floor to ceiling."""
    shape = Rectangle(corner=(x, low, -1), first_edge=(0, high - low, 0), second_edge=(0, 0, 2))
    return Body(name=f"wall {x} {low}", shape=shape, material=Lambert(albedo=albedo))


def both_sides(x: float, low: float, high: float, albedo: float) -> list[Body]:
    """A wall of two rectangles back to back that shine to either side.

    They are 1 um apart: of 1 mm the dark between them is seen from a door, 1.5 % of what is there (`path` agrees).
    """
    tall, across = (0.0, 0.0, 2.0), (0.0, high - low, 0.0)
    shapes = (
        Rectangle(corner=(x - 5e-7, low, -1), first_edge=tall, second_edge=across),
        Rectangle(corner=(x + 5e-7, low, -1), first_edge=across, second_edge=tall),
    )
    return [shining(f"wall {x} {low} {k}", s, albedo) for k, s in enumerate(shapes)]


def assert_one(scene: SurfaceScene, origin: Any, d: Array, power: float = 1e-3, **options: Any) -> None:
    """Mean radiance over rays of 1, by a test that sees 3 times the `power`."""
    given = {"samples": 2, "photons": 1 << 14} | options
    o = np.atleast_2d(np.asarray(origin, float))

    def run(seed: int) -> float:
        return float(skyscatter.radiance(scene, o, d, GREEN, **asked("photons", seed=seed, **given)).radiance.mean())

    runs = runs_of_power(run, power)
    print(f"{runs.mean():.5f} +- {runs.std(ddof=1) / np.sqrt(len(runs)):.5f} ({len(runs)} runs)")
    assert_mean_of_runs(runs, 1.0, power)


def places(count: int) -> Array:
    """Points in the room of half side 1: in its middle, 6 cm from a wall and 6 cm from three of them; (3, count, 3).

    Each stands for all that symmetry makes of it: photons that one of them finds are not found by the next, so that the
    mean over them is known far better than the light at one.
    """
    rng = np.random.default_rng(3)
    middle, wall, corner = rng.uniform(-0.5, 0.5, (count, 3)), rng.uniform(-0.6, 0.6, (count, 3)), np.empty((count, 3))
    wall[:, 0], corner[:] = 0.94, 0.94
    both = np.stack([middle, wall, corner]) * rng.choice([-1.0, 1.0], (3, count, 3))
    return rng.permuted(both, axis=2)


def sights(rays: int = 96) -> tuple[Array, Array]:
    """Places (3, ray, 3) and the directions (ray, 3) from there."""
    # Neighbours do not look the same way.
    return places(rays), np.concatenate([directions(rays)[k::3] for k in range(3)])


def assert_white_fog(albedo: float, extinction: float, power: Any, expected: Any = 1.0, **options: Any) -> None:
    """Mean radiance of 1 in the middle of a closed room, beside walls and in corners, each known to the `power`."""
    scene, (origins, d) = in_fog(closed_room(albedo), extinction), sights()

    def run(seed: int) -> Array:
        answer = skyscatter.radiance(scene, origins, d, GREEN, **asked("photons", seed=seed, **options))
        return answer.radiance.mean(axis=(1, 2))

    runs = runs_of_power(run, power)
    print(f"{runs.mean(axis=0)} +- {runs.std(axis=0, ddof=1) / np.sqrt(len(runs))} ({len(runs)} runs)")
    assert_mean_of_runs(runs, expected, power)


def test_fog_beside_walls() -> None:
    """Black walls of radiance 1 around white fog, spheres of 0.1 m: 0.6 % (wall) to 2 % (corner) were missing once."""
    assert_white_fog(0.0, 0.5, 1e-3, samples=2, photons=1 << 14, radius=0.1, direct=False)


@pytest.mark.slow
def test_rays_to_walls_that_shine_are_no_noisier_than_photons() -> None:
    """Beside a wall that is a lamp: with rays to points of it the noise was 70 times that of photons alone."""
    scene, options = in_fog(closed_room(0.3), 1.5), {"samples": 16, "photons": 1 << 12, "radius": 0.1}
    noise = [
        skyscatter.radiance(
            scene, [(0.94, 0.1, 0.2)], directions(64), GREEN, **asked("photons", direct=direct, **options)
        )
        for direct in (True, False)
    ]
    by_rays, by_photons = (np.sqrt((answer.standard_error**2).mean()) for answer in noise)
    # Rays have noise of their own, and photons less to find: half as much again is what is let pass.
    assert by_rays < 1.5 * by_photons


def test_no_light_through_a_thin_wall() -> None:
    """A wall without thickness between a bright room and a dark one: in the dark not one photon is found."""
    bright = [b for b in room(1.0, 0.5) if "0 -1" not in b.name]
    lamp = shining("lamp", Rectangle(position=(-1, 0, 0), normal=(1, 0, 0), size=(2, 2)), 0.0)
    scene = in_fog([*bright, lamp, wall(0.0, -1.0, 1.0, 0.5)], 2.0)
    d = directions(200)
    options: dict[str, Any] = {"samples": 4, "photons": 1 << 13, "radius": 0.3}
    for direct in (True, False):
        answer = skyscatter.radiance(
            scene, [[0.02, 0.0, -0.95]], d, GREEN, **asked("photons", direct=direct, **options)
        )
        assert not answer.radiance.any()
    lit = skyscatter.radiance(scene, [[-0.02, 0.0, -0.95]], d, GREEN, **asked("photons", **options))
    assert (lit.radiance > 0).all()


def hood(albedo: float) -> list[Body]:
    """A box without a bottom on the floor; only its outside shines, so that beneath it is less light."""
    low, high = np.array([0.15, 0.1, -1.0]), np.array([0.65, 0.5, -0.6])
    bodies = []
    for axis in range(3):
        for side, corner in ((-1, low), (1, high)):
            if axis == 2 and side < 0:
                continue
            u, v = (np.eye(3)[k] * (high - low)[k] for k in range(3) if k != axis)
            start = np.where(np.arange(3) == axis, corner, low)
            if np.cross(u, v)[axis] * side < 0:
                u, v = v, u
            shape = Rectangle(corner=tuple(start), first_edge=tuple(u), second_edge=tuple(v))
            bodies.append(shining(f"hood {axis} {side}", shape, albedo))
    return bodies


def crowded(albedo: float) -> list[Body]:
    """A closed room with a hood on its floor, a ball that touches it, and a thin wall across it."""
    ball = shining("ball", Sphere(position=(-0.3, 0.5, -0.699), radius=0.3), albedo)
    return [*closed_room(albedo), *hood(albedo), ball, *both_sides(-0.2, -1.0, 0.1, albedo)]


def towards_floor(count: int) -> Array:
    """Rays from above to places of the floor beside what stands there."""
    rng = np.random.default_rng(4)
    x = np.stack([rng.uniform(-0.35, 0.75, count), rng.uniform(-0.4, 0.6, count), np.full(count, -1.0)], axis=1)
    d = x - np.array([0.1, 0.2, 0.9])
    return d / np.linalg.norm(d, axis=1)[:, None]


@pytest.mark.slow
def test_floor_beside_what_stands_on_it() -> None:
    """Nothing in the air; disks of 0.1 m on the floor and on what stands there are cut off."""
    scene = in_fog(crowded(0.6), None)
    assert_one(scene, (0.1, 0.2, 0.9), towards_floor(400), power=1.5e-3, photons=1 << 15, radius=0.1, direct=False)


# --- at length ----------------------------------------------------------------------------------------------------


#: The radii are 1 to 5 times that of the first pass if none is given.
RADII, EXTINCTIONS = (0.2, 0.1, 0.05), (0.5, 1.5, 5.0)


def blurred(extinction: float, radius: float) -> Array:
    """What photons make of the furnace of grey walls, by quadrature: in its middle, beside walls and in corners."""
    origins, d = sights()
    return 1.0 + np.array([furnace_blur(0.3, extinction, radius, o, d) for o in origins])


@pytest.mark.slow
@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("extinction", EXTINCTIONS)
def test_blur_in_fog_is_small(extinction: float, radius: float) -> None:
    """Light that has met something is not even beside walls: its blur is 0.3 % at most, 1.4 % in corners once.

    No noise: quadrature over the spheres and disks in which photons are counted.
    """
    assert np.abs(blurred(extinction, radius) - 1.0).max() < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("extinction", EXTINCTIONS)
def test_furnace_in_fog(extinction: float, radius: float) -> None:
    """Three extinctions and three radii to 0.3 %, 0.6 % where light comes through 5 free paths; grey walls.

    The judge is 1 and what spheres and disks blur, 0.3 % of it at most (`test_blur_in_fog_is_small`).
    """
    deep = 2e-3 if extinction == 5 else 1e-3
    options = {"samples": 2, "photons": 1 << 14, "radius": radius}
    assert_white_fog(0.3, extinction, (deep, 1e-3, 1e-3), expected=blurred(extinction, radius), **options)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["points", "paths", "both"])
def test_furnace_among_things(way: str) -> None:
    """Spheres of 0.1 m in a slit 8 cm wide, beside a door that is ajar by 5 cm, above a hood and a ball."""
    slit = [*both_sides(0.3, -1.0, -0.3, 0.3), *both_sides(0.38, -1.0, -0.3, 0.3)]
    scene = in_fog([*closed_room(0.3), *slit, *both_sides(0.38, -0.25, 1.0, 0.3)], 1.5)
    options: dict[str, Any] = {"radius": 0.1, "estimator": way, "power": 1.5e-3}
    for place in ((0.34, -0.5, 0.0), (0.36, -0.27, 0.0)):
        assert_one(scene, place, directions(256), **options)
    assert_one(in_fog(crowded(0.3), 1.5), (0.1, 0.2, 0.9), towards_floor(256), **options)
