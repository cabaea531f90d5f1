"""Solver ``photons`` in small scenes whose answer is known, in closed form or by walks; options, threads, going on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked
from bases import complaint
from significance import assert_agrees
from walk_scenes import WAVELENGTHS, directions, fog, medium, room, spectrum

import skyscatter
from skyscatter.optics.mie import MieAerosol
from skyscatter.solvers import photons
from skyscatter.solvers.base import Asked, Rays
from skyscatter.solvers.options import Photons
from skyscatter.solvers.run import Interrupted
from skyscatter.surfaces.lamps import AreaLamp, ParallelLamp, PointLamp, Surroundings
from skyscatter.surfaces.materials import Interface, Lambert, Mirror
from skyscatter.surfaces.scene import Body, SurfaceScene, Viewpoint
from skyscatter.surfaces.shapes import Disk, Plane, Rectangle, Sphere

Array = Any
EXTINCTION, ALBEDO = np.array([0.5, 1.0, 2.0]), np.array([0.9, 0.8, 0.7])


def gathered(scene: SurfaceScene, o: Array, d: Array, **options: Any) -> skyscatter.Answer:
    return skyscatter.radiance(
        scene, o, d, WAVELENGTHS, **asked("photons", **{"samples": 16, "photons": 2000, **options})
    )


def foggy_room() -> SurfaceScene:
    """A cube of half side 1 in fog, with a lamp in its ceiling."""
    shape = Rectangle(position=(0, 0, 0.9), normal=(0, 0, -1), size=(0.6, 0.6))
    lamp = Body(name="lamp", shape=shape, material=Lambert(albedo=0.3), lamp=AreaLamp(power=1.0))
    air = medium("air", fog(spectrum(*EXTINCTION), spectrum(*ALBEDO), 0.4))
    viewpoint = Viewpoint(position=(-0.3, 0.2, 0.1), target=(1, 0, 0))
    return SurfaceScene(media=(air,), bodies=(*room(1.0, 0.5), lamp), viewpoint=viewpoint)


def test_rays_in_bunches_meet_the_same_photons(monkeypatch: pytest.MonkeyPatch) -> None:
    """With photons of their own bunches of rays would leave seams in a picture; rays to lamps have numbers by bunch."""
    d = directions(60)
    o = np.broadcast_to((-0.3, 0.2, 0.1), d.shape)
    whole = gathered(foggy_room(), o, d, samples=4, direct=False, radius=0.3)
    monkeypatch.setattr(photons, "MOST_POINTS", 64)
    parted = gathered(foggy_room(), o, d, samples=4, direct=False, radius=0.3)
    np.testing.assert_allclose(parted.radiance, whole.radiance, rtol=1e-10)


INSIDE = np.array([[-0.3, 0.2, 0.1]])
CAMERA = skyscatter.Perspective(width=3, height=2, fov_deg=60.0)


def test_floor_under_a_lamp_by_photons_alone() -> None:
    """L = albedo / pi x I cos / r^2 of a lamp 1 m over a floor; over the disk of radius R it changes by some R^2."""
    floor = Body(name="floor", shape=Rectangle(size=(8, 8)), material=Lambert(albedo=spectrum(*ALBEDO)))
    lamp = PointLamp(position=(0, 0, 1), power=spectrum(1.0, 2.0, 3.0))
    scene = SurfaceScene(bodies=(floor,), lamps=(lamp,))
    x = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]])
    o = x + np.array([0.3, 0.1, 0.5])
    d = np.tile([-0.3, -0.1, -0.5] / np.linalg.norm([0.3, 0.1, 0.5]), (3, 1))
    radius = 0.05
    answer = gathered(scene, o, d, radius=radius, direct=False, samples=32, photons=20_000)
    square = (x**2).sum(axis=1) + 1.0
    expected = ALBEDO / np.pi * (np.array([1.0, 2.0, 3.0]) / (4 * np.pi)) * square[:, None] ** -1.5
    # The mean over the disk: E (1 + R^2 / 8 x Laplacian of E over E); of (r^2 + 1)^-1.5 that is at most 6 in size.
    assert_agrees(answer.radiance, expected, answer.standard_error, freedom=31, slack=radius**2)
    assert np.all(answer.standard_error < 0.05 * expected)
    # Rays to the lamp find the same without any error, but for rounding.
    exact = gathered(scene, o, d, photons=10, samples=2)
    np.testing.assert_allclose(exact.radiance, expected, rtol=1e-9)


def test_closed_room_that_shines() -> None:
    """Walls of albedo 0.5 that shine with 1 see 2 everywhere, whatever light goes straight from lamps or by photons."""
    scene = SurfaceScene(bodies=tuple(room(1.0, 0.5, 1.0)))
    # Rays that meet walls further than the radius from their edges, where the disk lies in the wall.
    d = directions(100)
    d /= np.abs(d).max(axis=1)[:, None]
    d = d[np.sort(np.abs(d), axis=1)[:, 1] < 0.8]
    d /= np.linalg.norm(d, axis=1)[:, None]
    for direct in (True, False):
        answer = gathered(scene, [[0.0, 0.0, 0.0]], d, radius=0.15, direct=direct, samples=32, photons=4000)
        # All rays share their photons, so the mean over rays is judged by the spread of its own passes.
        context, rays, options = made(scene, d, radius=0.15, direct=direct, photons=4000)
        means = np.array([photons.solve_pass(context, rays, k, options).radiance.mean(axis=0) for k in range(32)])
        error = means.std(axis=0, ddof=1) / np.sqrt(32)
        np.testing.assert_allclose(means.mean(axis=0), answer.radiance.mean(axis=0), rtol=1e-10)
        assert_agrees(means.mean(axis=0), 2.0, error, freedom=31)
        assert np.all(error < 0.02)


def made(scene: SurfaceScene, d: Array, **given: Any) -> tuple[photons.Context, Rays, Asked[Photons]]:
    """What passes need; rays from the middle."""
    rays = Rays(np.zeros_like(d), d, np.arange(len(d)))
    options = Asked(Photons(**given))
    return photons.prepare(scene, rays, WAVELENGTHS, options, 1, None), rays, options


def test_the_answer_is_the_mean_of_passes_and_no_digit_hangs_on_threads() -> None:
    scene, d = foggy_room(), directions(5)
    one, two = (gathered(scene, [[0.0, 0.0, 0.0]], d, samples=6, radius=0.2, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.radiance, two.radiance)
    np.testing.assert_array_equal(one.standard_error, two.standard_error)
    context, rays, options = made(scene, d, radius=0.2, photons=2000)
    passes = np.array([photons.solve_pass(context, rays, k, options).radiance for k in range(6)])
    np.testing.assert_allclose(one.radiance, passes.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(one.standard_error, passes.std(axis=0, ddof=1) / np.sqrt(6), rtol=1e-6)
    other = gathered(scene, [[0.0, 0.0, 0.0]], d, samples=6, radius=0.2, seed=9)
    assert not np.array_equal(other.radiance, one.radiance)


def test_render_interrupted_goes_on_from_its_checkpoint(tmp_path: Any) -> None:
    given: dict[str, Any] = {"solver": "photons", "samples": 8, "photons": 500, "threads": 1}
    whole = skyscatter.render(foggy_room(), CAMERA, WAVELENGTHS, **asked(**given))

    pressed: list[float] = []

    def stop(share: float) -> None:
        if share >= 0.5 and not pressed:
            pressed.append(share)
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        skyscatter.render(foggy_room(), CAMERA, WAVELENGTHS, progress=stop, **asked(**given))
    assert 2 <= caught.value.state.passes < 8
    assert np.isfinite(np.asarray(caught.value.partial.radiance)).all()
    caught.value.state.save(tmp_path / "state.zarr")
    again = skyscatter.render(foggy_room(), CAMERA, WAVELENGTHS, resume=tmp_path / "state.zarr", **asked(**given))
    np.testing.assert_array_equal(again.radiance, whole.radiance)
    np.testing.assert_array_equal(again.standard_error, whole.standard_error)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"estimator": "beams"}, "estimator"),
        ({"samples": 4, "noise": 0.1}, "samples"),
        ({"parts": True}, "parts"),
        ({"photons": 0}, "photons"),
        ({"radius": 0.0}, "radius"),
    ],
)
def test_options_without_meaning_are_refused(given: dict[str, Any], words: str) -> None:
    message = complaint(
        lambda: skyscatter.radiance(foggy_room(), INSIDE, directions(1), [550.0], **asked("photons", **given))
    )
    assert words in message
    assert len(message.splitlines()) == 1


@pytest.mark.parametrize("lamp", [Surroundings(radiance=1.0), ParallelLamp(direction=(0, 0, 1), irradiance=1.0)])
def test_light_from_outside_on_an_endless_plane_is_refused(lamp: Any) -> None:
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    scene = SurfaceScene(bodies=(floor,), lamps=(lamp,))
    rays = np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, -1.0]])
    message = complaint(lambda: gathered(scene, *rays))
    assert "plane" in message
    assert "path" in message
    # Of the lamps within the scene photons reach all of it.
    inside = SurfaceScene(bodies=(floor,), lamps=(PointLamp(position=(0, 0, 1), power=4 * np.pi),))
    seen = gathered(inside, *rays, samples=2, photons=10)
    np.testing.assert_allclose(seen.radiance, 0.5 / np.pi, rtol=1e-9)


def two_mirrors(lamp: bool) -> SurfaceScene:
    """Two mirrors of 0.5, and what is seen in both: a lamp of radiance 1, or light from outside of radiance 1."""
    half = Mirror(reflectance=0.5)
    bodies = [
        Body(name="down", shape=Rectangle(normal=(0, 0, 1), size=(4, 4)), material=half),
        Body(name="up", shape=Rectangle(position=(2, 0, 1), normal=(-1, 0, 0), size=(4, 4)), material=half),
    ]
    disk = Disk(position=(0, 0, 3), normal=(0, 0, -1), radius=3.0)
    shining = Body(name="lamp", shape=disk, material=Lambert(albedo=0.0), lamp=AreaLamp(radiance=1.0))
    around = () if lamp else (Surroundings(radiance=1.0),)
    return SurfaceScene(bodies=(*bodies, *((shining,) if lamp else ())), lamps=around)


@pytest.mark.parametrize("solver", ["path", "photons"])
@pytest.mark.parametrize("lamp", [True, False])
def test_light_seen_in_mirrors_counts_its_reflections(solver: str, lamp: bool) -> None:
    o, d = np.array([[0.1, 0.0, 1.0]]), np.array([[1.0, 0.0, -1.0]]) / np.sqrt(2)
    given: dict[str, Any] = {"samples": 64, "orders": 2} | ({"photons": 100} if solver == "photons" else {})
    for most, expected in ((1, 0.0), (2, 0.25), (None, 0.25)):
        answer = skyscatter.radiance(two_mirrors(lamp), o, d, WAVELENGTHS, **asked(solver, max_order=most, **given))
        # Roulette between mirrors is all that is left to chance.
        assert_agrees(answer.radiance, expected, answer.standard_error, slack=1e-9)
        np.testing.assert_array_equal(answer.layers["order1"], 0.0)
        np.testing.assert_allclose(answer.layers["order2"], answer.radiance, rtol=1e-12)


def test_wavelength_that_loses_nothing_takes_nothing_from_others() -> None:
    """Heroes for which the fog is not there: each wavelength is as bright as alone, the clear one dark."""
    clear = medium("fog", fog(spectrum(1.0, 0.2, 0.0)))
    ball = Body(name="ball", shape=Sphere(radius=1.0), material=Interface(), inside="fog")
    lamp = PointLamp(position=(0.3, 0.2, 0.1), power=1.0)
    scene = SurfaceScene(media=(medium("outside"), clear), bodies=(ball,), lamps=(lamp,))
    o, d = np.array([[0.0, -5.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    given: dict[str, Any] = {"samples": 64, "photons": 4000, "radius": 0.1}
    together = skyscatter.radiance(scene, o, d, WAVELENGTHS, **asked("photons", **given))
    assert together.radiance[0, 2] == 0.0
    alone = [skyscatter.radiance(scene, o, d, [w], **asked("photons", seed=5, **given)) for w in WAVELENGTHS[:2]]
    value, error = (np.array([getattr(a, name)[0, 0] for a in alone]) for name in ("radiance", "standard_error"))
    assert_agrees(together.radiance[0, :2], value, np.hypot(together.standard_error[0, :2], error), freedom=63)
    assert np.all(together.standard_error[0, :2] < 0.15 * value)


# --- phase functions with a peak ----------------------------------------------------------------------------------


def droplets() -> skyscatter.Component:
    """Droplets of 50 um, which send half of what they scatter into a few tenths of a degree; about 0.9 per m."""
    modes = [{"median_radius": "50 um", "geometric_standard_deviation": 1.2, "max_radius": "90 um"}]
    optics = MieAerosol(material="water", number_density=3e7, modes=modes)
    return skyscatter.Component(name="fog", density={"kind": "everywhere"}, optics=optics)


PEAKED = {"Mie": droplets, "HG": lambda: fog(1.0, 0.95, 0.95)}


@pytest.mark.slow
@pytest.mark.parametrize("name", PEAKED)
def test_peaked_phase_functions_agree_with_walks(name: str) -> None:
    """A small room with a lamp in its ceiling.

    Walls cut spheres off, so that the bias is of the first order in the radius: from two radii to none,
    2 L(R / 2) - L(R).  Rays share the photons of a run: judged is the mean over rays, by its spread over seeds.
    """
    shape = Rectangle(position=(0, 0, 0.9), normal=(0, 0, -1), size=(0.6, 0.6))
    lamp = Body(name="lamp", shape=shape, material=Lambert(albedo=0.3), lamp=AreaLamp(power=1.0))
    scene = SurfaceScene(media=(medium("air", PEAKED[name]()),), bodies=(*room(1.0, 0.5), lamp))
    d = directions(40)
    d = d[d[:, 2] < 0.6]  # none of them to the lamp itself

    def means(solver: str, **given: Any) -> tuple[Array, Array]:
        runs = [
            skyscatter.radiance(scene, INSIDE, d, [550.0], **asked(solver, seed=100 + seed, **given)).radiance.mean()
            for seed in range(12)
        ]
        return np.mean(runs), np.std(runs, ddof=1) / np.sqrt(12)

    expected, error = means("path", samples=256)
    options: dict[str, Any] = {"samples": 16, "photons": 8000}
    (wide, wide_error), (near, near_error) = (means("photons", radius=r, **options) for r in (0.1, 0.05))
    own = np.hypot(2 * near_error, wide_error)
    print(name, "path", expected, error, "0.1", wide, wide_error, "0.05", near, near_error)
    assert_agrees(2 * near - wide, expected, np.hypot(own, error), freedom=11)
    assert own < 0.03 * expected
    assert error < 0.02 * expected
