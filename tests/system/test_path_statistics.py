"""``path`` against ``single`` and against its own plain twin; honest error bars; the same bits for any threads."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from asking import asked
from scipy import stats
from significance import assert_agrees, over_seeds

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.media.fields import Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein

WAVELENGTHS = np.array([400.0, 480.0, 560.0, 650.0, 760.0])
#: Sun elevations: by day, at sunset, in civil twilight.
SUNS = (30.0, 0.0, -4.0)
#: Of lines of sight: near the horizon towards the Sun and beside it, half way up, near the zenith.
SIGHTS = ((10.0, 3.0), (80.0, 5.0), (0.0, 35.0), (170.0, 60.0), (40.0, 85.0))


@cache
def model(hazy: bool) -> skyscatter.Model:
    """The Earth under a flat spectrum, clear or with ten times its aerosol (optical depth 0.5).

    The shipped solar spectrum is averaged over the steps of the wavelength grid, so that one wavelength alone would get
    other light than the same one among others.
    """
    earth = skyscatter.load_model("earth").model_copy(update={"star": skyscatter.Star(spectrum=1.0)})
    if not hazy:
        return earth
    components = tuple(
        c.model_copy(update={"weight": 10.0}) if isinstance(c.optics, Particles) else c for c in earth.components
    )
    return earth.model_copy(update={"components": components})


def look(
    sun: float, hazy: bool, wavelengths: Any = WAVELENGTHS, solver: str = "path", **options: Any
) -> skyscatter.solvers.base.Answer:
    """Radiance along `SIGHTS` from the ground."""
    scene = model(hazy).scene(sun_elevation_deg=sun, sun_azimuth_deg=0.0)
    sight = direction_from_azimuth_elevation(*np.transpose(SIGHTS))
    return skyscatter.radiance(scene, scene.observer.position, sight, wavelengths, **asked(solver, **options))


@pytest.mark.parametrize("hazy", [False, True], ids=["clear", "hazy"])
@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")  # the spread over 16 seeds is what is judged by
@pytest.mark.parametrize("sun", [30.0, 0.0, pytest.param(-4.0, marks=pytest.mark.slow)])
def test_pure_sampling_at_order_one_agrees_with_the_ray_march(sun: float, hazy: bool) -> None:
    single = look(sun, hazy, solver="single")
    # In twilight a free flight from the dark ground hardly ever ends in sunlit air, and its sample error is as unknown
    # as its mean; the walks that make the spread of 16 seeds meaningful are paid for there.
    samples = 2000 if sun >= 0 else 20000
    _, result = over_seeds(
        lambda seed: look(sun, hazy, samples=samples, sampling="free-flight", max_order=1, seed=seed), 16
    )
    # `single` is good to its tolerance, 5e-5; both share the column tables.
    mean, error = result["radiance"]
    assert_agrees(mean, single.radiance, error, slack=1e-4)


@pytest.mark.parametrize("hazy", [False, True], ids=["clear", "hazy"])
@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")
@pytest.mark.parametrize("sun", [30.0, 0.0, pytest.param(-4.0, marks=pytest.mark.slow)])
def test_marched_and_free_walks_agree_in_every_order(sun: float, hazy: bool) -> None:
    samples = 2000 if sun >= 0 else 10000
    _, marched = over_seeds(lambda seed: look(sun, hazy, samples=256, orders=3, seed=seed), 16)
    _, free = over_seeds(lambda seed: look(sun, hazy, samples=samples, orders=3, sampling="free-flight", seed=seed), 16)
    for name in ("radiance", "order1", "order2", "order3"):
        error = np.hypot(marched[name][1], free[name][1])
        # Both share the column tables; the first order of the march is a quadrature to 1e-4 or better.
        assert_agrees(marched[name][0], free[name][0], error, slack=2e-4)


@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")
@pytest.mark.parametrize("sampling", ["march", pytest.param("free-flight", marks=pytest.mark.slow)])
@pytest.mark.parametrize("sun", [pytest.param(30.0, marks=pytest.mark.slow), -4.0])
def test_every_wavelength_alone_agrees_with_all_together(sun: float, sampling: str) -> None:
    samples = 256 if sampling == "march" else 4000
    _, together = over_seeds(lambda seed: look(sun, True, samples=samples, sampling=sampling, seed=seed), 16)
    for i, wavelength in enumerate(WAVELENGTHS):
        _, alone = over_seeds(
            lambda seed, w=wavelength: look(sun, True, [w], samples=samples, sampling=sampling, seed=seed), 16
        )
        mean, error = together["radiance"][0][:, i], together["radiance"][1][:, i]
        # The first order may differ by the tolerance of its steps, which are chosen for all wavelengths at once.
        assert_agrees(mean, alone["radiance"][0][:, 0], np.hypot(error, alone["radiance"][1][:, 0]), slack=2e-4)


# Plain walks in twilight are left out: rare events rule them, and a sample that has met none states too small an error.
@pytest.mark.parametrize(
    ("sun", "sampling"),
    [
        (0.0, "march"),
        pytest.param(-4.0, "march", marks=pytest.mark.slow),
        (0.0, "free-flight"),
        *(pytest.param(30.0, s, marks=pytest.mark.slow) for s in ("march", "free-flight")),
    ],
)
def test_stated_errors_are_the_spread_over_seeds(sun: float, sampling: str) -> None:
    seeds, samples = 60, 256 if sampling == "march" else 1000
    answers = [look(sun, False, samples=samples, sampling=sampling, seed=seed) for seed in range(seeds)]
    spread = np.var([a.radiance for a in answers], axis=0, ddof=1)
    stated = np.mean([a.standard_error**2 for a in answers], axis=0)
    # (n - 1) spread / variance is chi-square with n - 1 degrees of freedom for a right error bar and normal errors; the
    # stated variance is itself the mean of 60 estimates with 15 degrees of freedom, 5 % uncertain.  Rays are
    # independent, wavelengths are not: each is judged by itself, with room for tails heavier than normal.
    low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], seeds - 1) / (seeds - 1)
    ratio = spread / stated
    assert ratio.min() > 0.9 * low
    assert ratio.max() < 1.1 * high
    # All rays and wavelengths together: 5 independent rays of 59 degrees of freedom, 4 standard errors of their mean.
    assert np.mean(ratio) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (5 * (seeds - 1))))


def test_noise_option_is_kept_by_the_true_error() -> None:
    goal = 0.01
    answers = [look(30.0, False, noise=goal, seed=seed) for seed in range(30)]
    mean = np.mean([a.radiance for a in answers], axis=0)
    scatter = np.std([a.radiance for a in answers], axis=0, ddof=1) / mean
    # Stopping at the first estimate below the goal favours lucky ones; 16 batches guess the error to 18 %.
    assert scatter.mean(axis=-1).max() < 1.5 * goal
    assert all(np.all((a.standard_error / a.radiance).mean(axis=-1) <= goal) for a in answers)


def test_same_seed_same_bits_for_any_number_of_threads() -> None:
    scene = model(False).scene(sun_elevation_deg=5.0)
    camera = skyscatter.Panorama(width=32, height=16)  # 512 rays: four tiles
    one, two = (
        skyscatter.render(scene, camera, WAVELENGTHS[:2], solver=skyscatter.Path(samples=16, seed=7), threads=threads)
        for threads in (1, 2)
    )
    assert np.array_equal(one.radiance, two.radiance, equal_nan=True)
    assert np.array_equal(one.standard_error, two.standard_error, equal_nan=True)
    other = skyscatter.render(scene, camera, WAVELENGTHS[:2], solver=skyscatter.Path(samples=16, seed=8))
    assert not np.array_equal(one.radiance, other.radiance, equal_nan=True)


def test_same_ray_numbers_same_bits_however_rays_are_split() -> None:
    from skyscatter.solvers.base import Asked, Rays
    from skyscatter.solvers.options import Path
    from skyscatter.solvers.path import prepare, solve

    scene = model(True).scene(sun_elevation_deg=5.0)
    sight = direction_from_azimuth_elevation(0.0, np.linspace(2.0, 88.0, 6))
    rays = Rays(np.repeat(scene.observer.position[None], 6, axis=0), sight, np.arange(6))
    options = Asked(Path(samples=32, seed=3))
    table = prepare(scene, rays, WAVELENGTHS, options, 1, None)
    whole = solve(table, rays, options).radiance
    parts = [solve(table, rays.part(piece), options).radiance for piece in (slice(0, 1), slice(1, 4), slice(4, 6))]
    assert np.array_equal(whole, np.concatenate(parts))


def test_walks_from_the_ground_find_the_bright_sky_around_the_sun() -> None:
    """Away from the Sun of a dusty day much of the light was at the ground before: noise of one walk over the light."""
    scene = skyscatter.load_model("mars").scene(sun_elevation_deg=40.0, sun_azimuth_deg=180.0)
    sight, seeds, walks = direction_from_azimuth_elevation(0.0, [5.0, 50.0]), 128, 256
    answer = skyscatter.radiance(
        scene,
        scene.observer.position,
        np.tile(sight, (seeds, 1)),
        [450.0, 650.0],
        solver=skyscatter.Path(samples=walks),
    )
    value = answer.radiance.reshape(seeds, 4)
    # 1.0 to 1.15 with any seed; where the cosine alone finds that sky 1.8 to 3.1, and one run in ten is beyond three
    # of its standard errors.
    assert (np.std(value, axis=0) / np.mean(value, axis=0)).max() * np.sqrt(walks) < 1.4


@pytest.mark.parametrize(
    ("planet", "sun", "sights"), [("mars", 3.0, [(120.0, 10.0), (0.0, 1.0)]), ("mars", 40.0, [(0.0, 5.0), (0.0, 50.0)])]
)
@pytest.mark.slow
def test_error_bars_cover_where_the_sky_is_bright_around_the_sun_only(
    planet: str, sun: float, sights: list[tuple[float, float]]
) -> None:
    """Seen beside it and from behind, where the light has to find its way through that narrow part of the sky."""
    scene = skyscatter.load_model(planet).scene(sun_elevation_deg=sun, sun_azimuth_deg=180.0)
    sight, seeds = direction_from_azimuth_elevation(*np.transpose(sights)), 200
    # Copies of a ray draw numbers of their own: they are runs with other seeds.
    answer = skyscatter.radiance(
        scene, scene.observer.position, np.tile(sight, (seeds, 1)), [450.0, 650.0], solver=skyscatter.Path(samples=1024)
    )
    value, error = (a.reshape(seeds, 4) for a in (answer.radiance, answer.standard_error))
    off = np.abs(value - value.mean(axis=0)) / error
    # 16 batches have 15 degrees of freedom: 66.7 % within one standard error, 93.6 % within two, 0.9 % beyond three.
    # Wavelengths share their walks, so that 400 runs count: 3 standard errors of a share of so many.
    for k in (1.0, 2.0):
        expected = 1 - 2 * stats.t.sf(k, 15)
        assert np.mean(off < k) > expected - 3 * np.sqrt(expected * (1 - expected) / 400)
    # A tail that is heavier than normal remains; before walks knew the Sun on all legs it was a tenth of the runs.
    assert np.mean(off > 3.0) < 0.04


def test_a_word_before_walks_that_cannot_know_their_error() -> None:
    def prepared(scene: skyscatter.Scene, **options: Any) -> None:
        from skyscatter.solvers.base import Asked, Rays
        from skyscatter.solvers.options import Path
        from skyscatter.solvers.path import prepare

        rays = Rays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        prepare(scene, rays, WAVELENGTHS, Asked(Path(**options)), 1, None)

    with pytest.warns(UserWarning, match=r"sampling = 'free-flight' with sun_elevation_deg = -4.*leave sampling out"):
        prepared(model(False).scene(sun_elevation_deg=-4.0), sampling="free-flight")
    with pytest.warns(UserWarning, match=r"sampling = 'free-flight' with sun_elevation_deg = 3"):
        prepared(skyscatter.load_model("mars").scene(sun_elevation_deg=3.0), sampling="free-flight")
    with pytest.warns(UserWarning, match=r"sun_elevation_deg = -3.*take the solver orders"):
        prepared(skyscatter.load_model("mars").scene(sun_elevation_deg=-3.0), samples=1024)
    with pytest.warns(UserWarning, match=r"sun_elevation_deg = 1: by so low a Sun .*take the solver orders"):
        prepared(skyscatter.load_model("mars").scene(sun_elevation_deg=1.0), samples=1024)
    prepared(skyscatter.load_model("mars").scene(sun_elevation_deg=3.0), samples=1024)
    earth = model(True)
    thick = earth.model_copy(
        update={"components": tuple(c.model_copy(update={"weight": 20 * c.weight}) for c in earth.components)}
    ).scene(sun_elevation_deg=30.0)
    with pytest.warns(UserWarning, match=r"samples = 64: light comes through .* transport free paths of .*raise"):
        prepared(thick, samples=64)
    optics = Particles(optical_depth=0.5, phase=HenyeyGreenstein(g=0.8))
    sheet = skyscatter.Component(name="sheet", density=Uniform(base=1000.0, top=1010.0), optics=optics)
    clear = model(False).scene(sun_elevation_deg=30.0)
    components = (*clear.medium.components, sheet)
    foggy = clear.model_copy(update={"medium": clear.medium.model_copy(update={"components": components})})
    with pytest.warns(UserWarning, match=r"layer 'sheet' is at most .* m thick.*free-flight"):
        prepared(foggy, samples=1024)
    prepared(foggy, sampling="free-flight")
    optics = Particles(optical_depth=0.5, phase=HenyeyGreenstein(g=0.3))
    veil = skyscatter.Component(name="veil", density=Uniform(base=5e3, top=8e3), optics=optics)
    medium = clear.medium.model_copy(update={"components": (*clear.medium.components, veil)})
    veiled = clear.model_copy(update={"medium": medium})
    with pytest.warns(UserWarning, match=r"sun_elevation_deg = -4.*a layer aloft, 'veil'.*take the solver orders"):
        prepared(veiled.model_copy(update={"sun": skyscatter.Sun(elevation_deg=-4.0)}), samples=1024)
    prepared(veiled, samples=1024)
    prepared(model(True).scene(sun_elevation_deg=-4.0), samples=16)
    # Neither where walks are many, nor in a clear sky.
    prepared(thick, samples=1024)
    prepared(model(False).scene(sun_elevation_deg=-4.0), samples=16)
    prepared(model(True).scene(sun_elevation_deg=30.0), sampling="free-flight")
