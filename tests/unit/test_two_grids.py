"""The fine solution corrected on the coarse grid: judged by sweeps of the fine grid alone, repeated to their end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter import Component, Ground, Medium, Scene, Star, Sun
from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.media.fields import Exponential
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Rayleigh
from skyscatter.solvers import cycles, mixing
from skyscatter.solvers.field import LOOSEST, solve_once, zenith_range
from skyscatter.solvers.mixing import settled
from skyscatter.solvers.series import ORDERS_SHARE
from skyscatter.solvers.sweeps import COARSER, Sweeper, make_problem, reach
from skyscatter.solvers.transfer import Light, Transfer, light_of, pattern
from skyscatter.workers import Workers

WAVELENGTHS = np.array([450.0, 650.0])


def swept_to_the_end(sweeper: Sweeper, goal: float) -> Any:
    """Mean radiance of the light that a sweep of the grid leaves as it is."""
    with Workers(max_workers=1) as pool:
        first = sweeper.first(pool)
        light, change = first, np.inf
        while change > goal:
            sweeper.narrow(light[0], light[0], 0.0)  # what that costs is another question
            before, light = light, tuple(a + b for a, b in zip(first, sweeper.next(pool, *light), strict=True))
            mean = light[0][:, :, 0]
            change = np.max(np.abs(mean - before[0][:, :, 0]) / np.maximum(mean, 1e-9 * mean.max()))
    return mean


@pytest.mark.parametrize(
    ("model", "elevation"),
    [
        ("earth-simple", 60.0),
        pytest.param("earth-simple", -3.0, marks=pytest.mark.slow),
        ("earth-hazy", 30.0),
        pytest.param("earth-simple", -18.0, marks=pytest.mark.slow),
        pytest.param("mars", 5.0, marks=pytest.mark.slow),
        pytest.param("earth-hazy", -6.0, marks=pytest.mark.slow),
    ],
)
def test_it_is_the_sum_of_all_orders(model: str, elevation: float) -> None:
    tolerance = 0.01
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=elevation)
    zenith = zenith_range(scene, (elevation, elevation), tolerance)
    guide = solve_once(scene, WAVELENGTHS, zenith, COARSER * tolerance, False, None, 1)
    problem = make_problem(scene, WAVELENGTHS, zenith, tolerance)
    found = cycles.all_orders(Sweeper(problem, 1), tolerance, guide)
    mean, right = found.moments[:, :, 0], swept_to_the_end(Sweeper(problem, 1), 0.01 * tolerance)
    # Rays see the Sun no further than once their reach from where it stands; solutions go twice as far.
    seen = np.abs(problem.grid.sun_zenith - np.radians(90 - elevation)) < reach(scene.medium.radius, scene.medium.top)
    mean, right = mean[:, seen], right[:, seen]
    deviation = np.abs(mean / right - 1)[right > 1e-6 * right.max()]
    # What may be missing of the orders by the solver's own rule.
    assert np.all(np.percentile(deviation, cycles.PLACES) < ORDERS_SHARE * tolerance * cycles.ALLOWED)


def test_a_sun_between_those_of_the_coarse_grid_settles_too() -> None:
    # Above a bright ground in thick air every Sun has light of its own, and the coarse grid does not see every other.
    optics = Particles(optical_depth=0.92, phase=Rayleigh())
    air = Component(name="air", density=Exponential(scale_height=6.5e3), optics=optics)
    scene = Scene(
        medium=Medium(planet_radius=6.371e6, components=(air,)), ground=Ground(albedo=0.48),
        star=Star(spectrum=1.0, radius=0.0), sun=Sun(elevation_deg=-1.84),
    )  # fmt: skip
    tolerance, zenith = 0.005, (np.radians(80.0), np.radians(94.8))
    guide = solve_once(scene, WAVELENGTHS[:1], zenith, COARSER * tolerance, False, None, 1)
    problem = make_problem(scene, WAVELENGTHS[:1], zenith, tolerance)
    found = cycles.all_orders(Sweeper(problem, 1), tolerance, guide)
    right = swept_to_the_end(Sweeper(problem, 1), 0.01 * tolerance)
    deviation = np.abs(found.moments[:, :, 0] / right - 1)
    assert deviation.max() < ORDERS_SHARE * tolerance * cycles.ALLOWED[1]


def test_orders_are_summed_where_cycles_do_not_settle(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=40.0)
    whole = skyscatter.solve(scene, [550.0], sun_elevations_deg=(40, 40), tolerance=0.05)
    monkeypatch.setattr(mixing, "MOST_STEPS", 1)
    summed = skyscatter.solve(scene, [550.0], sun_elevations_deg=(40, 40), tolerance=0.05)
    assert not np.array_equal(whole.fine.sums.moments, summed.fine.sums.moments)
    mean, right = whole.fine.sums.moments[:, :, 0], summed.fine.sums.moments[:, :, 0]
    np.testing.assert_allclose(mean, right, rtol=ORDERS_SHARE * 0.05)


def problem(tolerance: float) -> Any:
    scene = skyscatter.load_model("earth-simple").scene()
    return make_problem(scene, WAVELENGTHS[:1], (0.2, 1.4), tolerance)


def test_a_pattern_that_is_a_cubic_is_carried_exactly() -> None:
    one, other = problem(0.05), problem(0.01)
    way = Transfer.between(one, other)

    def cubic(of: Any) -> Any:
        h, z = of.grid.altitudes[:, None] / 1e5, of.grid.sun_zenith[None, :]
        return ((1 + h - 2 * h**3) * (0.3 + z**2 - z**3))[..., None]

    np.testing.assert_allclose(way.carried(cubic(one)), cubic(other), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(way.carried(cubic(one), slice(1, 2)), way.carried(cubic(one))[:, 1:2])
    assert len(way.here) == len(way.there) == one.moments.degree.size
    assert way.here[0] == way.there[0] == 0


def test_a_light_has_the_pattern_that_it_is_made_of() -> None:
    rng = np.random.default_rng(1)
    moments = rng.uniform(-0.3, 0.3, (3, 4, 5, 2))
    moments[:, :, 0] = rng.uniform(0.5, 2.0, (3, 4, 2))
    light = Light(moments, rng.uniform(0.1, 1.0, (3, 2, 4, 2)))
    for found, expected in zip(light_of(pattern(light)), light, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_slow_step_is_settled_in_a_few() -> None:
    rng = np.random.default_rng(2)
    n = 40
    modes = np.linalg.qr(rng.normal(size=(n, n)))[0]
    # Five modes live on from order to order, by up to 0.99: a thousand orders to the sixth digit.
    rates = np.concatenate([[0.99, 0.95, 0.8, 0.6, 0.4], np.full(n - 5, 0.05)])
    matrix = (modes * rates) @ modes.T
    right = rng.uniform(1.0, 2.0, n)
    source = right - matrix @ right
    steps = 0

    def step(light: Light) -> Light:
        nonlocal steps
        steps += 1
        return Light((source + matrix @ light.moments.ravel()).reshape(light.moments.shape), light.flux)

    flux = np.ones((1, 2, n, 1))
    found, rate = settled(step, Light(right.reshape(1, n, 1, 1) * rng.uniform(0.9, 1.1, (1, n, 1, 1)), flux), 1e-7)
    np.testing.assert_allclose(found.moments.ravel(), right, rtol=1e-5)
    assert steps < 30
    assert 0.9 < rate < 1.0


def test_a_step_that_leads_nowhere_is_told() -> None:
    light = Light(np.ones((1, 3, 1, 1)), np.ones((1, 2, 3, 1)))
    with pytest.raises(ConvergenceError, match="use solver path"):
        settled(lambda u: Light(2.0 * u.moments + 1.0, u.flux), light, 1e-6)


@pytest.mark.parametrize(
    ("model", "elevation"),
    [
        ("earth-simple", 40.0),
        pytest.param("earth-simple", -5.0, marks=pytest.mark.slow),
        pytest.param("mars", 60.0, marks=pytest.mark.slow),
        pytest.param("earth", -12.0, marks=pytest.mark.slow),
        pytest.param("earth-hazy", -12.0, marks=pytest.mark.slow),
        pytest.param("mars", -12.0, marks=pytest.mark.slow),
    ],
)
def test_a_first_answer_knows_its_error_and_goes_on(model: str, elevation: float) -> None:
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=elevation)
    directions = sights()
    first = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(elevation, elevation), tolerance=0.05)
    assert first.tolerance == LOOSEST
    better = first.refined()
    assert better.tolerance == LOOSEST / COARSER
    # What two solutions leave out of a forward peak alike their difference does not tell: at dusk it is solved anew.
    told = better.fine.problem.coarser_degree
    assert told is None or better.coarse.problem.degree <= told < better.fine.problem.degree
    assert (better.coarse is first.fine) == (told is None or first.fine.problem.degree <= told)
    anew = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(elevation, elevation), tolerance=better.tolerance)
    rough, fine, same = (field.radiance(scene.observer.position, directions) for field in (first, better, anew))
    # As `estimate` says: within the stated errors in 95 of 100 values, within twice in nearly all.
    apart = np.abs(rough.radiance - fine.radiance) / np.hypot(rough.estimated_error, fine.estimated_error)
    assert np.mean(apart < 1) > 0.95
    assert apart.max() < 2
    # Another guide for the same grid: what the orders may miss, twice.
    np.testing.assert_allclose(fine.radiance, same.radiance, rtol=2 * ORDERS_SHARE * better.tolerance)


def sights() -> Any:
    """Directions over half the sky, many of them low."""
    elevation, azimuth = np.meshgrid(np.radians([1.0, 5.0, 15.0, 40.0, 75.0]), np.radians(np.arange(0, 181, 30)))
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("max_order", [1, 2, None])
def test_a_field_goes_on_as_it_began_also_from_a_file(max_order: int | None, tmp_path: Path) -> None:
    scene = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=40.0)
    how: dict[str, Any] = {"sun_elevations_deg": (40.0, 40.0), "max_order": max_order}
    first = skyscatter.solve(scene, WAVELENGTHS, tolerance=0.015, **how)
    first.save(tmp_path / "field.npz")
    kept = skyscatter.RadianceField.load(tmp_path / "field.npz")
    assert kept.max_order == max_order
    here = scene.observer.position, sights()
    np.testing.assert_array_equal(kept.radiance(*here).radiance, first.radiance(*here).radiance)
    anew = skyscatter.solve(scene, WAVELENGTHS, tolerance=0.015 / COARSER, **how)
    apart = np.abs(kept.refined().radiance(*here).radiance / anew.radiance(*here).radiance - 1)
    assert apart.max() < 2 * ORDERS_SHARE * anew.tolerance


def test_nothing_is_refined_below_the_least_tolerance() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=40.0)
    field = skyscatter.solve(scene, [550.0], sun_elevations_deg=(40.0, 40.0), tolerance=3e-4, max_order=2)
    with pytest.raises(DomainError, match="tolerance"):
        field.refined()
