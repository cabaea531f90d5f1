"""Grids of solver orders: heights, positions of the Sun, directions; bundles of rays; the solar disk in two points."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
import pytest

import skyscatter
from skyscatter.media.fields import Exponential, Tent, Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers import grid as grids
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.cycles import all_orders
from skyscatter.solvers.sweeps import MOST_RAYS, Sweeper, _disk, bundles, kept_degree, make_problem
from skyscatter.workers import Workers

R = 6.371e6
AIR = skyscatter.Component(
    name="air", density=Exponential(scale_height=8e3), optics=RayleighPowerLaw(coefficient=1.2e-5)
)


def scene(*components: skyscatter.Component, radius: float = 6.957e8) -> skyscatter.Scene:
    return skyscatter.Scene(
        medium=skyscatter.Medium(planet_radius=R, components=components or (AIR,)),
        star=skyscatter.Star(spectrum=1.0, radius=radius),
    )


def profile(depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Altitudes up to 100 km and the optical depth above them, scale height 8 km, at two wavelengths."""
    altitude = np.linspace(0, 1e5, 2001)
    return altitude, depth * np.exp(-altitude / 8e3)[:, None] * np.array([1.0, 0.2])


@pytest.mark.parametrize("tolerance", [0.02, 0.005, 0.0005])
@pytest.mark.parametrize("depth", [1e-4, 0.3, 30.0])
def test_heights_increase_and_fill_the_atmosphere(depth: float, tolerance: float) -> None:
    altitude, above = profile(depth)
    nodes = grids.height_nodes(altitude, above, np.array([1e4, 2.5e4]), 0.5, tolerance)
    assert nodes[0] == 0
    assert nodes[-1] == 1e5
    assert np.all(np.diff(nodes) > 0)
    assert {1e4, 2.5e4} <= set(nodes)
    rows = grids.rows_between(nodes)
    assert np.all(np.diff(rows) > 0)
    np.testing.assert_array_equal(rows[:: grids.ROW_REFINEMENT], nodes)


def test_rows_are_close_in_height_where_a_limb_is_seen_under_a_low_sun() -> None:
    altitude, above = profile(0.3)
    nodes = grids.height_nodes(altitude, above, np.zeros(0), 0.0, 0.005)
    by_day, at_dusk = (grids.seen_rows(nodes, altitude, above, level, 0.005) for level in (0.0, 1.0))
    np.testing.assert_array_equal(by_day, grids.rows_between(nodes))
    assert set(nodes) <= set(at_dusk)
    step, high = np.diff(at_dusk), at_dusk[1:] > 3e4
    # By rounding there are up to a third fewer than wanted.
    assert np.all(step[high & (at_dusk[1:] < 8e4)] < 1.34 * grids.SEEN_STEP * grids.fineness(0.005) * 8e3)
    assert np.diff(by_day).max() > 2 * step.max()


def test_many_breaks_are_left_out_and_those_at_the_ends_too() -> None:
    altitude, above = profile(0.3)
    plain = grids.height_nodes(altitude, above, np.zeros(0), 0.5, 0.005)
    many = np.linspace(1e3, 9.9e4, 40)
    np.testing.assert_array_equal(grids.height_nodes(altitude, above, many, 0.5, 0.005), plain)
    np.testing.assert_array_equal(grids.height_nodes(altitude, above, np.array([0.0, 1e5]), 0.5, 0.005), plain)


def test_breaks_leave_no_step_longer_than_wanted() -> None:
    """A layer of fog on the ground, or a tent aloft, must not take nodes away from the air beside it."""
    altitude, above = profile(0.3)
    plain = grids.height_nodes(altitude, above, np.zeros(0), 0.5, 0.005)
    rng = np.random.default_rng(1)
    for breaks in ([50.0], [plain[2] + 1.0], [9302.0, 12948.0, 16595.0], *np.sort(rng.uniform(0, 4e4, (50, 3)))):
        nodes = grids.height_nodes(altitude, above, np.array(breaks), 0.5, 0.005)
        assert set(breaks) <= set(nodes)
        number = np.interp(nodes, plain, np.arange(plain.size))
        assert np.diff(number).max() < 1.25
        assert nodes.size <= plain.size + len(breaks) + 1


def test_finer_tolerances_make_finer_grids() -> None:
    altitude, above = profile(0.3)
    sizes = [len(grids.height_nodes(altitude, above, np.zeros(0), 0.5, t)) for t in (0.02, 0.005, 0.001)]
    assert sizes == sorted(sizes)
    assert len(set(sizes)) == 3
    suns = [grids.sun_nodes(0.0, np.pi, 0.035, t)[0].size for t in (0.02, 0.005, 0.001)]
    assert suns == sorted(suns)
    assert len(set(suns)) == 3


@pytest.mark.parametrize("tolerance", [0.0015, 0.005, 0.02, 0.08, 0.3])
def test_cubics_of_the_sun_weigh_gently_at_any_tolerance(tolerance: float) -> None:
    for low, high, sinking, horizon in [(0, 130, 2.9, 90), (0, 180, 2.9, 0.6), (10, 96, 12, 90), (60, 110, 2.9, 0.3)]:
        given = (*np.radians([low, high, sinking]), tolerance, 1.0, np.radians(horizon))
        coarse, fine, _ = grids.sun_nodes(*given)
        for nodes in (coarse, fine):
            weights = grids.cubic_weights(nodes, np.linspace(nodes[0], nodes[-1], 2000))[1]
            assert np.abs(weights).sum(axis=1).max() < 2.65


@pytest.mark.parametrize(("low", "high"), [(-0.2, np.pi + 0.2), (0.0, 0.3), (1.5, 1.8), (2.5, np.pi)])
def test_sun_nodes_cover_their_range_and_are_found_again(low: float, high: float) -> None:
    coarse, fine, index = grids.sun_nodes(low, high, 0.035, 0.005)
    assert coarse[0] == fine[0] == max(low, 0.0)
    assert coarse[-1] == fine[-1] == min(high, np.pi)
    assert np.all(np.diff(coarse) > 0)
    assert np.all(np.diff(fine) > 0)
    np.testing.assert_allclose(fine[:: grids.SUN_REFINEMENT], coarse, rtol=1e-9)
    assert index.size == grids.INDEX_STEPS + 1
    # A table of 8192 steps says about where each Sun is.
    angle = np.linspace(coarse[0], coarse[-1], 20001)
    expected = np.interp(angle, fine, np.arange(fine.size) / grids.SUN_REFINEMENT)
    found = np.interp(angle, np.linspace(0, np.pi, index.size), index)
    np.testing.assert_allclose(found, expected, atol=0.01)
    # And cubics are cubics of the angle, though steps grow.
    for nodes, rows in zip((coarse, fine), grids.sun_cubics(coarse, fine), strict=True):
        j = len(nodes) // 2 - 2
        np.testing.assert_array_equal(rows[j, :4], nodes[j : j + 4])
        x = np.linspace(nodes[j], nodes[j + 3], 7)
        others = [np.prod(x[:, None] - np.delete(nodes[j : j + 4], k), axis=1) for k in range(4)]
        read = sum(rows[j, 4 + k] * others[k] * (nodes[j + k] - 1) ** 3 for k in range(4))
        np.testing.assert_allclose(read, (x - 1) ** 3, atol=1e-12)
        assert rows[-1, 3] == nodes[-1]


def test_a_single_sun_has_four_nodes_of_the_same_light() -> None:
    coarse, fine, index = grids.sun_nodes(1.0, 1.0, 0.035, 0.005)
    rows = grids.sun_cubics(coarse, fine)
    assert coarse.size == 1
    assert not index.any()
    assert rows.shape == (2, 1, 8)
    others = [np.prod(0.3 - np.delete(np.arange(4.0), k)) for k in range(4)]
    assert np.dot(rows[0, 0, 4:], others) == pytest.approx(1.0)


def test_light_that_was_scattered_hundreds_of_times_is_the_same_wherever_the_nodes_of_the_sun_are() -> None:
    optics = Particles(optical_depth=60.0, single_scattering_albedo=1.0, phase=HenyeyGreenstein(g=0.8))
    cloud = skyscatter.Component(name="cloud", density=Uniform(base=0.0, top=1e3), optics=optics)
    light = []
    for low, high in [(76.0, 86.0), (76.0, 89.0), (73.0, 86.0), (72.0, 88.0)]:
        problem = make_problem(scene(cloud), np.array([550.0]), tuple(np.radians([low, high])), 0.005)
        mean = all_orders(Sweeper(problem, 1), 0.005).moments[0, :, 0, 0]
        four, weights = grids.cubic_weights(problem.grid.sun_zenith, np.radians([81.0]))
        light.append(float(np.exp(weights[0] @ np.log(mean[four[0]]))))
    # By cubics of the nodes' numbers these were 3 % apart, and 2 to 5 % below.
    np.testing.assert_allclose(light, light[0], rtol=0.002)


@pytest.mark.parametrize("end", [-1, 0])
def test_under_a_thick_cloud_the_first_and_the_last_sun_are_as_good_as_others(end: int) -> None:
    # Light that is scattered hundreds of times is read from the table of Suns as often.
    optics = Particles(optical_depth=60.0, single_scattering_albedo=1.0, phase=HenyeyGreenstein(g=0.8))
    cloud = skyscatter.Component(name="cloud", density=Uniform(base=0.0, top=1e3), optics=optics)
    whole = (70.0, 88.013) if end else (80.013, 88.0)
    light = []
    for low, high in np.radians([whole, (whole[end] - 0.3, whole[end] + 0.3)]):
        problem = make_problem(scene(cloud), np.array([550.0]), (low, high), 0.02)
        mean = all_orders(Sweeper(problem, 1), 0.02).moments[0, :, 0, 0]
        light.append((problem.grid.sun_zenith, mean))
    (suns, found), (around, right) = light
    expected = np.exp(np.interp(suns[end], around, np.log(right)))
    # Beyond its ends the field goes on as it is there, and light comes from some ten kilometres around.
    spread = np.tan(suns[end]) * np.radians(0.12)
    assert found[end] == pytest.approx(expected, rel=spread)


def test_light_deep_inside_a_cloud_is_known_at_few_heights_whatever_the_sun() -> None:
    altitude = np.linspace(0, 1e3, 2001)
    above = 60.0 * (1 - altitude / 1e3)[:, None]
    nodes_of = partial(grids.height_nodes, altitude, above, np.zeros(0))
    high, low = (nodes_of(cosine, 0.005, fading=0.1) for cosine in (1.0, 0.0))
    inside = [(nodes > 250) & (nodes < 750) for nodes in (high, low)]
    steps = [0.06 * np.diff(nodes[among]) for nodes, among in zip((high, low), inside, strict=True)]
    # In optical depth: 0.5, times the square root of 2.5 for this tolerance; a whole number of some hundred steps.
    np.testing.assert_allclose(np.concatenate(steps), 0.5 * np.sqrt(2.5), rtol=0.01)
    assert np.diff(low)[-1] < 0.7 * np.diff(high)[-1]  # a slanting beam fades near the top
    # Where much is absorbed it fades inside too.
    assert nodes_of(0.0, 0.005, fading=0.5).size > 1.3 * low.size


def test_a_cloud_beneath_the_air_takes_few_suns_more() -> None:
    # A scale height of 8 km sinks within 2.9 degrees, the top tenths of the cloud within 0.6.
    optics = Particles(optical_depth=30.0, single_scattering_albedo=1.0, phase=HenyeyGreenstein(g=0.86))
    cloud = skyscatter.Component(name="cloud", density=Uniform(base=500.0, top=1500.0), optics=optics)
    suns = np.radians([86.0, 101.0])
    clear, cloudy = (
        make_problem(scene(*parts), np.array([550.0]), tuple(suns), 0.005, darkest=suns[0]).grid.sun_zenith
        for parts in ((AIR,), (AIR, cloud))
    )
    assert clear.size < cloudy.size < 2.2 * clear.size
    near = np.abs(np.degrees(cloudy[1:] + cloudy[:-1]) / 2 - 90) < 1
    assert np.diff(cloudy)[near].max() < 0.6 * np.diff(clear).max()  # the Sun sets on its top


def test_what_is_left_out_at_a_height_is_what_is_small_there() -> None:
    # Deep inside a cloud light comes from everywhere; above it from the Sun.
    optics = Particles(optical_depth=20.0, single_scattering_albedo=1.0, phase=HenyeyGreenstein(g=0.8))
    cloud = skyscatter.Component(name="cloud", density=Uniform(base=0.0, top=1e3), optics=optics)
    problem = make_problem(scene(AIR, cloud), np.array([550.0]), (0.9, 1.1), 0.01)
    sweeper = Sweeper(problem, 1)
    with Workers(max_workers=1) as pool:
        light = sweeper.first(pool)
        for _ in range(3):
            light = tuple(a + b for a, b in zip(light, sweeper.next(pool, *light), strict=True))
        field = sweeper.load(pool, *light)
    ratio = np.abs(field.moments / field.moments[:, :, :1]).max(axis=(1, 3))
    assert np.all(ratio[:, 1:] <= 1.001 * field.bound[:, 1:] + 1e-6)
    inside, high = np.searchsorted(problem.grid.rows, [500.0, 1500.0])
    narrow = field.degree == field.degree.max()
    assert field.bound[inside, narrow].max() < 0.1 * field.bound[high, narrow].max()


def test_the_sun_is_followed_closely_in_twilight() -> None:
    coarse = np.degrees(grids.sun_nodes(0.0, np.pi, 0.035, 0.005)[0])
    steps, middle = np.diff(coarse), 0.5 * (coarse[1:] + coarse[:-1])
    twilight = (middle > 88) & (middle < 105)
    assert steps[twilight].max() < 1.3  # 0.3 times 2 degrees, times the square root of 2.5 for this tolerance
    assert steps[(middle > 10) & (middle < 60)].min() > 3


def test_deep_air_around_a_small_planet_does_not_stretch_twilight() -> None:
    coarse = np.degrees(grids.sun_nodes(np.radians(47.0), np.radians(131.0), np.radians(11.8), 0.005)[0])
    # Titan at -10 degrees: steps of 5.5 degrees left 0.5 % out, of 3.8 less than 0.1 %.
    assert np.diff(coarse)[coarse[1:] > 80].max() < 3.9


def test_a_flat_world_has_one_sun() -> None:
    coarse, fine, index = grids.sun_nodes(0.7, 0.7, 1e-4, 0.005)
    assert coarse.tolist() == [0.7]
    assert set(fine) == {0.7}
    assert not index.any()


def test_cubics_are_exact_for_cubics_and_weights_sum_to_one() -> None:
    nodes = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 7.0])
    points = np.linspace(0, 7, 57)
    number, weights = grids.cubic_weights(nodes, points)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    np.testing.assert_allclose((polynomial(nodes)[number] * weights).sum(axis=1), polynomial(points), atol=1e-12)
    number, weights = grids.cubic_weights(np.array([0.0, 1.0]), np.array([0.2, 0.9]))
    assert number[:, 0].tolist() == [0, 1]
    assert weights.sum(axis=1).tolist() == [1.0, 1.0]


def test_beside_a_sheet_what_is_interpolated_keeps_between_its_nodes() -> None:
    nodes = np.array([0.0, 800.0, 801.0, 802.0, 803.0, 2500.0])
    values = np.array([1.0, 1.1, 1.5, 1.2, 1.4, 1.3])
    points = np.linspace(0, 2500, 101)
    number, weights = grids.cubic_weights(nodes, points)
    between = (values[number] * weights).sum(axis=1)
    outside = (points < 790) | (points > 820)
    np.testing.assert_allclose(between[outside], np.interp(points, nodes, values)[outside], atol=0.02)


@pytest.mark.parametrize("degree", [2, 8, 16])
@pytest.mark.parametrize("radius", [6.371e6, 1e10], ids=["earth", "flat"])
def test_directions_integrate_polynomials(degree: int, radius: float) -> None:
    altitudes = np.array([0.0, 100.0, 1e4, 1e5])
    between = grids.between_counts(altitudes, radius, np.sqrt(2 * 8e3 / radius), 0.005, True)
    for rule in grids.directions(altitudes, radius, degree, 0.005, between):
        mu, weight = rule.T
        assert np.all(weight >= 0)
        assert np.all((mu > -1) & (mu < 1))
        assert weight.sum() == pytest.approx(2.0, abs=1e-12)
        for power in range(degree + 1):
            # Above, cosines are squares of the variable: n / 2 + 4 Gauss points for powers up to n / 2 of a degree n
            # fall two short of exact for the highest power, which costs 4e-8.
            assert weight @ mu**power == pytest.approx((1 + (-1) ** power) / (power + 1), abs=1e-7)
        assert np.pi * (weight * mu)[mu > 0].sum() * 2 == pytest.approx(np.pi, rel=1e-12)


def test_no_direction_lies_across_the_horizon() -> None:
    altitudes = np.array([0.0, 1e3, 1e5])
    between = grids.between_counts(altitudes, R, 0.05, 0.005, True)
    assert between[0] == 0
    assert 0 < between[1] < between[2]
    for h, rule in zip(altitudes, grids.directions(altitudes, R, 8, 0.005, between), strict=True):
        horizon = -np.sqrt(1 - (R / (R + h)) ** 2)
        mu, weight = rule.T
        assert weight[mu < horizon].sum() == pytest.approx(1 + horizon, rel=1e-9)
        assert weight[mu > 0].sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("limb_darkening", [True, False])
def test_a_few_points_stand_for_the_disk(limb_darkening: bool) -> None:
    """Over zenith angles a uniform disk of radius a has the moments <x^2> = a^2 / 4 and <x^4> = a^4 / 8."""
    it = scene(radius=2e9)
    it = it.model_copy(update={"star": it.star.model_copy(update={"limb_darkening": limb_darkening})})
    tilt, share = _disk(compile_scene(it, np.array([550.0])).optics)
    offset, weight = np.arctan2(tilt[:, 1], tilt[:, 0]), share[:, 0] / share[0, 0]
    a = np.arcsin(2e9 / it.star_distance)
    assert offset[0] == 0
    for nodes in (slice(1, 3), slice(3, 7)):
        x, w = offset[nodes], weight[nodes]
        assert w.sum() == pytest.approx(1.0, rel=1e-12)
        assert w @ x == pytest.approx(0.0, abs=1e-12 * a)
        second, fourth = w @ x**2, w @ x**4
        if limb_darkening:
            assert 0.8 * a**2 / 4 < second < a**2 / 4
            continue
        assert second == pytest.approx(a**2 / 4, rel=2e-4)  # trapezoids over 65 rings
        if x.size == 4:
            assert fourth == pytest.approx(a**4 / 8, rel=4e-4)
    np.testing.assert_allclose(share[0], it.star.irradiance([550.0], it.star_distance), rtol=1e-9)


def haze(g: float) -> skyscatter.Component:
    return skyscatter.Component(
        name="haze",
        density=Tent(base=0.0, peak=1e3, top=3e3),
        optics=Particles(optical_depth=0.3, phase=HenyeyGreenstein(g=g)),
    )


def test_breaks_of_the_medium_are_nodes() -> None:
    layer = skyscatter.Component(
        name="layer",
        density=Uniform(base=5.3e3, top=6.1e3),
        optics=Particles(optical_depth=0.3, phase=HenyeyGreenstein(g=0.5)),
    )
    problem = make_problem(scene(AIR, haze(0.5), layer), np.array([550.0]), (0.0, 1.0), 0.005)
    for height in (1e3, 3e3, 5.3e3, 6.1e3):
        assert np.abs(problem.grid.altitudes - height).min() < 1e-6


def test_a_forward_peak_is_cut_and_a_smooth_phase_function_is_not() -> None:
    wavelengths, zenith = np.array([450.0, 650.0]), (0.0, 1.0)
    smooth = make_problem(scene(), wavelengths, zenith, 0.005)
    np.testing.assert_allclose(smooth.diffuse.sigma_t, smooth.table.optics.sigma_t, rtol=1e-12)
    assert smooth.diffuse.peaks.shape[1] == 0
    assert smooth.moments.degree.max() == 2
    peaked = make_problem(scene(AIR, haze(0.9)), wavelengths, zenith, 0.005)
    optics = peaked.table.optics
    kept = int(peaked.moments.degree.max())
    # delta-M: the coefficient after the last kept one is the share that is cut (Wiscombe 1977, eq. 15).
    expected = optics.sigma_t[1] - 0.9 ** (kept + 1) * optics.sigma_s[1]
    np.testing.assert_allclose(peaked.diffuse.sigma_t[1], expected, rtol=1e-4)  # chords of the phase table
    np.testing.assert_allclose(peaked.diffuse.sigma_t[0], optics.sigma_t[0], rtol=1e-12)
    # Scattering and extinction lose the same, so that absorption stays: 4 pi greek_0 is the scattering that is left.
    left = 4 * np.pi * peaked.diffuse.greek[0, :, 0]
    np.testing.assert_allclose(peaked.diffuse.sigma_t - left, optics.sigma_t - optics.sigma_s, atol=1e-9 * left.max())


def test_degrees_follow_the_tolerance_the_depth_and_what_is_there() -> None:
    chi, deep = np.zeros((1, 1, 26, 1)), np.full((1, 1), 0.3)
    chi[0, 0, :, 0] = 0.9 ** np.arange(26)
    degrees = [kept_degree(chi, deep, tolerance) for tolerance in (0.02, 0.005, 0.002, 1e-4)]
    assert degrees == sorted(degrees)
    assert degrees[0] < degrees[-1]
    # A peak of hardly any depth needs no more degrees than the tolerance demands.
    assert kept_degree(chi, deep / 1e4, 0.005) < kept_degree(chi, deep, 0.005)
    # Unless sunlight comes in level, through much of it.
    level = np.ones((1, 1))
    assert kept_degree(chi, deep / 1e4, 0.005, level) > kept_degree(chi, deep / 1e4, 0.005)
    # The same little of it matters more in the planet's shadow.
    assert kept_degree(chi, deep / 1e4, 0.005, 0.1 * level, 1.0) > kept_degree(chi, deep / 1e4, 0.005, 0.1 * level)
    chi[0, 0, 4:] = 0.0
    assert kept_degree(chi, deep, 1e-4) == 3
    assert kept_degree(np.zeros((1, 1, 26, 1)), deep, 1e-4) == 2


def test_bundles_hold_each_ray_once_and_only_rays_of_one_course() -> None:
    rng = np.random.default_rng(5)
    elevation = np.radians(rng.choice([10.0, 40.0, -5.0], 500))
    azimuth = rng.uniform(0, 2 * np.pi, 500)
    directions = np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=-1
    )
    origins = np.array([0.0, 0.0, R]) + rng.choice([1e3, 5e3], 500)[:, None] * np.array([0.0, 0.0, 1.0])
    order, edges = bundles(origins, directions, R)
    assert sorted(order) == list(range(500))
    assert edges[0] == 0
    assert edges[-1] == 500
    assert edges.size - 1 == 6
    for a, b in pairwise(edges):
        members = order[a:b]
        assert np.ptp(elevation[members]) == 0
        assert np.ptp(origins[members, 2]) == 0
    many = bundles(np.repeat(origins[:1], 1200, axis=0), np.repeat(directions[:1], 1200, axis=0), R)[1]
    assert many.tolist() == [0, MOST_RAYS, 2 * MOST_RAYS, 1200]
    order, edges = bundles(np.zeros((0, 3)), np.zeros((0, 3)), R)
    assert order.size == 0
    assert edges.tolist() == [0]
