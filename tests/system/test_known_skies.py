"""Walks among bodies and clouds that begin with the light of the empty sky, against walks that know nothing of it."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from significance import assert_agrees
from worlds import BURIED, HOUSE, directions, look, sky

import skyscatter
from skyscatter import fields
from skyscatter.kernels.surfaces.emptysky import empty_lights
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers.emptysky import known_sky
from skyscatter.solvers.sweeps import view
from skyscatter.surfaces import Body, Box, Lambert, Rpv, Sea

#: A wall in the north, 3 km away, 800 m wide and 400 m high.
WALL = Body(
    name="wall", shape=Box(position=(0, "3 km", "200 m"), size=("800 m", 20, "400 m")), material=Lambert(albedo=0.3)
)
#: Azimuths and elevations [degree]: the house or the wall and above it, their ground, sky beside and opposite.
RAYS = np.array([[0, 1], [0, 5], [0, 9], [0, 40], [20, 12], [180, 30], [90, 4], [0, -4], [8, -8], [180, -5], [270, 60]])


#: Rays with which the table of light is judged.
RANDOM = 16000


def slow(*values: Any) -> Any:
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("body", "sun"),
    [(HOUSE, 25.0), slow(WALL, 5.0), slow(HOUSE, 60.0), slow(HOUSE, 5.0), slow(WALL, 60.0), slow(WALL, 25.0)],
    ids=["house-25", "wall-5", "house-60", "house-5", "wall-60", "wall-25"],
)
def test_bodies_under_a_known_sky(body: Body, sun: float) -> None:
    """The same light with and without, in haze, and less noise in the sky."""
    scene, d = sky("earth-hazy", sun, bodies=(body,)), directions(RAYS)
    known = look(scene, d=d, samples=4560, seed=1)
    march = look(scene, d=d, samples=8192, seed=2, sampling="march")
    # What orders and the table state of themselves is in the error; it is an estimate, not a standard error.
    assert_agrees(known.radiance, march.radiance, np.hypot(known.error, march.error))
    assert np.all(known.error < 0.03 * known.radiance)


def test_an_empty_sky_has_no_noise() -> None:
    """Nothing is met, so nothing is left to chance."""
    scene, d = sky("earth-hazy", 25.0, bodies=(BURIED,)), directions(RAYS)
    known, orders = look(scene, d=d, samples=5120), look(sky("earth-hazy", 25.0), "orders", d)
    # Both are good to the tolerance of orders, on grids for other ranges of the Sun.
    np.testing.assert_allclose(known.radiance, orders.radiance, rtol=5e-3)
    assert np.all(known.error <= 0.02 * known.radiance)


LAND, SEA = Rpv(amplitude=0.2, exponent=0.8, asymmetry=-0.2), Sea(wind_speed=6.0)


@pytest.mark.parametrize(
    ("material", "sun", "most"),
    [slow(LAND, 10.0, 0.6), slow(LAND, 50.0, 0.8), slow(SEA, 3.0, 0.75), slow(SEA, 40.0, 1.4)],
    ids=["land-10", "land-50", "sea-3", "sea-40"],
)
def test_ground_that_orders_cannot_have(material: Any, sun: float, most: float) -> None:
    """It counts as a body under a sky whose ground spreads light evenly.

    Beside a house the median noise was 0.43, 0.61, 0.57 and 1.09 of that of walks alone.
    """
    scene, d = sky("earth-simple", sun, bodies=(HOUSE,)), directions(RAYS)
    scene = scene.model_copy(update={"ground": skyscatter.Ground(material=material)})
    known, again = (look(scene, d=d, samples=4560, seed=seed) for seed in (1, 3))
    march = look(scene, d=d, samples=4560, seed=2, sampling="march")
    assert_agrees(known.radiance, march.radiance, np.hypot(known.error, march.error))
    # Half of all values of a normal deviate lie within 0.674; what orders states of itself is no noise.
    spread = np.median(np.abs(known.radiance - again.radiance) / march.standard_error) / (0.674 * np.sqrt(2))
    assert spread < most


@pytest.mark.slow
def test_a_cloud_under_a_known_sky() -> None:
    ball = fields.Sphere(position=(0, "3 km", "1.5 km"), radius="600 m")
    cloud = skyscatter.Component(
        name="cloud",
        density=ball,
        optics=skyscatter.Particles(extinction="5 km-1", phase=HenyeyGreenstein(g=0.7)),
    )
    scene, d = sky("earth-simple", 40.0, fields=(cloud,)), directions([[0, 27], [0, 20], [0, 45], [90, 30], [0, -10]])
    known = look(scene, d=d, samples=10240, seed=1)
    march = look(scene, d=d, samples=10240, seed=2, sampling="march")
    assert_agrees(known.radiance, march.radiance, np.hypot(known.error, march.error))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "sun", "material"),
    [("earth", 50.0, None), ("earth", 8.0, None), ("earth-maritime", 30.0, None), ("earth-simple", 20.0, SEA)],
    ids=["earth-50", "earth-8", "maritime-30", "sea-20"],
)
def test_polarised_light_of_a_known_sky(model: str, sun: float, material: Any) -> None:
    """I, Q, U and V are those of walks alone, and the same again but for little: Mie's V, both sides of the Sun."""
    scene, d = sky(model, sun, bodies=(HOUSE,)), directions(RAYS)
    if material is not None:
        scene = scene.model_copy(update={"ground": skyscatter.Ground(material=material)})
    known, again = (look(scene, d=d, samples=4560, seed=seed, stokes=True) for seed in (1, 3))
    march = look(scene, d=d, samples=1 << 15, seed=2, sampling="march", stokes=True)
    assert_agrees(known.stokes, march.stokes, np.hypot(known.stokes_error, march.stokes_error))
    linear = np.hypot(march.layers["Q"], march.layers["U"]) / march.radiance
    assert linear.max() > 0.2
    # What orders and the table state of themselves is no noise; of the sky all is known.
    if material is None:
        above = d[:, 2] > np.sin(np.radians(10.0))
        noise = np.abs(known.stokes - again.stokes)[above] / known.radiance[above][..., None]
        assert np.median(noise) < 2e-3


@pytest.mark.slow
def test_polarised_twilight_is_that_of_orders() -> None:
    scene, d = sky("earth-simple", -4.0, bodies=(WALL,)), directions([[180, 30], [90, 10], [270, 60], [200, 89.99]])
    known = look(scene, d=d, samples=17024, seed=1, stokes=True)
    orders = look(sky("earth-simple", -4.0), "orders", d, stokes=True)
    assert_agrees(known.stokes, orders.stokes, known.stokes_error)
    assert np.median(np.hypot(orders.layers["Q"], orders.layers["U"]) / orders.radiance) > 0.5


def test_twilight_is_found() -> None:
    """Walks alone do not find it, and say so; beside a far wall the sky is that without it."""
    scene, d = sky("earth-simple", -4.0, bodies=(WALL,)), directions([[180, 30], [90, 10], [270, 60]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        known = look(scene, d=d, samples=17024, seed=1)
    with pytest.warns(UserWarning, match="in twilight"):
        look(scene, d=d, samples=16, sampling="march")
    orders = look(sky("earth-simple", -4.0), "orders", d)
    assert_agrees(known.radiance, orders.radiance, known.error)


@pytest.mark.parametrize(
    ("model", "sun", "most"), [("earth-simple", 40.0, 0.006), slow("earth-hazy", 25.0, 0.01), slow("mars", 10.0, 0.03)]
)
def test_the_light_between_nodes(model: str, sun: float, most: float) -> None:
    """Looked up where no node is, beside orders, near the Sun and the horizon too; the stated error is of that size."""
    scene = sky(model, sun)
    wl = np.array([450.0, 550.0, 650.0])
    rays: Any = skyscatter.solvers.base.Rays(
        np.array([scene.observer.position]), np.array([[0.0, 0.0, 1.0]]), np.arange(1)
    )
    known = known_sky(scene, rays, wl, 0, 1, None)
    assert known is not None
    rng = np.random.default_rng(7)
    d = rng.standard_normal((RANDOM, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    start = np.array([0.0, 0.0, known.table.radius]) + (2000 * rng.random(RANDOM) ** 2 + 2)[:, None] * np.array(
        [0, 0, 1]
    )
    fine = known.context.field.fine
    scattered, multiple, ground, _ = view(fine.problem, fine.loaded, known.context.table, start, d)
    exact = scattered[:, 0] + np.maximum(multiple[:, 0], 0.0) + ground
    found = np.empty_like(exact)
    empty_lights(known.table, start + known.table.centre, d, np.empty((known.table.light.shape[4], 3)), found)
    miss = np.abs(found - exact) / exact.mean(axis=0)
    missed, chance = miss.mean(axis=0), miss.std(axis=0) / np.sqrt(len(miss))
    print(f"{model} {sun:g}: {missed} +- {chance} of the light, stated {known.error}")
    assert np.all(missed < most)
    # The stated one is of other rays, as many and chosen with more care.
    assert np.all(np.abs(known.error - missed) < 3 * np.sqrt(2) * chance)


def test_what_is_known_is_not_asked_for_in_parts() -> None:
    """Layers are those of the walk alone, and come with it."""
    scene, d = sky("earth-simple", 40.0, bodies=(HOUSE,)), directions(RAYS[[0, 5]])
    whole = look(scene, d=d, samples=25600, seed=3, parts=True)
    alone = look(scene, d=d, samples=25600, seed=3, sampling="march")
    np.testing.assert_array_equal(whole.radiance, alone.radiance)
