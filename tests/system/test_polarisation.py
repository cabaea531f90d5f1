"""Polarised light through ``single`` and ``path``: closed forms, published tables, symmetries, honest errors."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from coulson_tables import cds
from numpy.typing import NDArray
from plane_parallel import Slab
from scipy import stats
from scipy.optimize import brentq
from significance import assert_agrees, largest_t, over_seeds

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.media.fields import Exponential, Uniform
from skyscatter.optics.absorption import TabulatedAbsorption
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import AnyPhase, GreekPhase, HenyeyGreenstein, Isotropic, Rayleigh
from skyscatter.optics.rayleigh import RayleighPowerLaw

Array = NDArray[np.float64]
SLOW = pytest.mark.slow
R = 6371e3
WAVELENGTHS = np.array([400.0, 550.0, 700.0])
#: Azimuth and elevation of sights: around the Sun, beside it, opposite, steep.
SIGHTS = ((10.0, 3.0), (80.0, 5.0), (-35.0, 35.0), (170.0, 60.0), (40.0, 85.0))

AIR = skyscatter.Component(
    name="air", density=Exponential(scale_height=8e3), optics=RayleighPowerLaw(coefficient=1.2e-5, wavelength=550)
)
#: Small absorbing spheres: b2 is as large as b1, so that there is circular polarisation.
SPHERES = skyscatter.Component(
    name="spheres",
    density=Exponential(scale_height=2e3),
    optics=MieAerosol(
        modes=(LogNormalMode(median_radius=1.2e-7, geometric_standard_deviation=1.6, max_radius=2e-6),),
        refractive_index_real=1.6, refractive_index_imag=0.05, optical_depth=0.4,
    ),
)  # fmt: skip


def scene_of(
    *components: Any, sun: float = 30.0, azimuth: float = 0.0, albedo: float = 0.2, radius: float = 0.0
) -> skyscatter.Scene:
    return skyscatter.Scene(
        medium=skyscatter.Medium(planet_radius=R, components=components),
        ground=skyscatter.Ground(albedo=albedo),
        star=skyscatter.Star(spectrum=1.0, radius=radius),
        sun=skyscatter.Sun(elevation_deg=sun, azimuth_deg=azimuth),
    )


def look(
    scene: skyscatter.Scene, sights: Any = SIGHTS, wavelengths: Any = WAVELENGTHS, solver: str = "path", **options: Any
) -> Any:
    azimuth, elevation = np.array(sights).T
    sight = direction_from_azimuth_elevation(azimuth, elevation)
    return skyscatter.radiance(
        scene, scene.observer.position, sight, wavelengths, stokes=True, **asked(solver, **options)
    )


def bearing_to_sun(sights: Any, sun: float, azimuth: float) -> Array:
    """Angle from upright to the Sun at each point of the sky, anticlockwise, by spherical trigonometry."""
    a, e = np.radians(np.array(sights)).T
    s, turn = np.radians(sun), np.radians(azimuth) - a
    rightwards = np.arctan2(np.cos(s) * np.sin(turn), np.sin(s) * np.cos(e) - np.cos(s) * np.sin(e) * np.cos(turn))
    return np.asarray(-rightwards)


# First order


@pytest.mark.parametrize("sun", [60.0, 5.0, 0.0, -4.0])
def test_single_rayleigh_scattering_is_polarised_across_the_plane_of_scattering(sun: float) -> None:
    """Degree (1 - mu^2) / (1 + mu^2), everywhere on the sky; E at right angles to the Sun."""
    scene = scene_of(AIR, sun=sun, azimuth=25.0, albedo=0.0)
    sights = [(a, e) for a in range(0, 360, 15) for e in (1.0, 20.0, 45.0, 75.0, 89.0)]
    vector = look(scene, sights, solver="single").stokes
    d = direction_from_azimuth_elevation(*np.array(sights).T)
    mu = d @ scene.sun.direction
    lit = vector[:, 0, 0] > 0  # in twilight some lines of sight end in the planet's shadow
    assert lit.all() if sun >= 0 else 0.7 < lit.mean() < 1
    assert not vector[~lit].any()
    d, mu = d[lit], mu[lit]
    i, q, u, v = np.moveaxis(vector[lit], -1, 0)
    assert not v.any()
    # b1 and a1 are tabulated alike; each quadrature is good to 1e-4.
    expected = (1 - mu**2) / (1 + mu**2)
    np.testing.assert_allclose(np.hypot(q, u) / i, np.repeat(expected[:, None], 3, axis=1), rtol=3e-4, atol=1e-6)
    chi = 0.5 * np.arctan2(u, q)[:, 0]
    up, left = meridian_frame(scene.observer.position, d)
    field = np.cos(chi)[:, None] * up + np.sin(chi)[:, None] * left
    np.testing.assert_allclose(field @ scene.sun.direction, 0.0, atol=1e-7)


@pytest.mark.parametrize("sun", [50.0, 2.0])
def test_thin_mixture_against_the_closed_form(sun: float) -> None:
    """A layer too thin to dim anything: I, Q, U are columns times matrix elements, turned by the bearing of the Sun."""
    spheres = MieAerosol(
        modes=(LogNormalMode(median_radius=2e-7, geometric_standard_deviation=1.6, max_radius=2e-6),),
        refractive_index_real=1.5, refractive_index_imag=0.0, optical_depth=3e-7, wavelength=550.0,
    )  # fmt: skip
    parts: dict[float, Any] = {
        4e-7: Rayleigh(depolarisation=0.05), 2e-7: HenyeyGreenstein(g=0.6), 3e-7: spheres.phase_function([550.0]),
    }  # fmt: skip
    components = [
        skyscatter.Component(
            name=f"part{k}", density=Uniform(top=1000.0), optics=Particles(optical_depth=tau, phase=phase)
        )
        for k, (tau, phase) in enumerate(parts.items())
    ]
    scene = scene_of(*components, sun=sun, azimuth=110.0, albedo=0.0)
    sights = [(a, e) for a in (0, 70, 111, 200, 290) for e in (3.0, 20.0, 45.0, 75.0, 89.0)]
    d = direction_from_azimuth_elevation(*np.array(sights).T)
    mu = d @ scene.sun.direction
    a1, _, _, _, b1, _ = sum(tau * phase.matrix(mu, [550.0])[:, :, 0] for tau, phase in parts.items())
    p = R * np.cos(np.radians([e for _, e in sights]))
    length = np.sqrt((R + 1000.0) ** 2 - p**2) - R * np.sin(np.radians([e for _, e in sights]))
    chi = bearing_to_sun(sights, sun, 110.0)
    expected = np.stack([a1, b1 * np.cos(2 * chi), b1 * np.sin(2 * chi), 0 * a1], axis=-1) * length[:, None] / 1000.0
    found = look(scene, sights, [550.0], solver="single").stokes[:, 0]
    # Extinction of 1e-6 times the air mass, and chords of the phase table where spheres send light straight back.
    assert np.max(np.abs(expected[:, 2]) / expected[:, 0]) > 0.2
    assert np.all(np.abs(found - expected) < 2e-4 * expected[:, :1])


def test_zenith_is_referred_to_north() -> None:
    for azimuth in (0.0, 30.0, 100.0):
        i, q, u, _ = look(scene_of(AIR, sun=0.5, azimuth=azimuth), [(0.0, 90.0)], solver="single").stokes[0, 0]
        turned = 2 * np.radians(azimuth)  # east is to the left of who looks up with north upright
        first = look(scene_of(AIR, sun=0.5, albedo=0.0), [(0.0, 90.0)], solver="single").stokes[0, 0]
        np.testing.assert_allclose([i, q, u], [first[0], first[1] * np.cos(turned), first[1] * np.sin(turned)], 1e-9)


def test_emission_and_ground_add_light_but_no_polarisation() -> None:
    plain_air = look(scene_of(AIR, albedo=0.0), SIGHTS, solver="single")
    shining = AIR.model_copy(update={"emission": 1e-7})
    bright = look(scene_of(shining, albedo=0.9), [*SIGHTS, (20.0, -30.0)], solver="single")
    assert np.all(bright.radiance[:5] > 1.01 * plain_air.radiance)
    np.testing.assert_allclose(bright.stokes[:5, :, 1:], plain_air.stokes[:, :, 1:], rtol=1e-12)
    assert np.hypot(bright.layers["Q"], bright.layers["U"])[5].max() < 0.2 * bright.radiance[5].min()


# All orders: published tables


def compare_with_cds(
    reference: Path, tau: str, albedo: int, sun: int, upwards: bool, samples: int
) -> tuple[Array, ...]:
    """Stokes vectors, expected ones and errors at four zenith angles and four azimuths, shape (mu, phi, 3)."""
    chosen_mu, chosen_phi = [1, 5, 9, 13], [0, 2, 3, 5]
    mu0, mu, _ = cds(reference, "I", upwards, tau)
    # The tables' Q and U are ours with the other sign: their r is upright.
    signs = {"I": 1.0, "Q": -1.0, "U": -1.0}
    values = [sign * cds(reference, name, upwards, tau)[2][albedo, sun] for name, sign in signs.items()]
    expected = np.stack(values, axis=-1)[chosen_mu][:, chosen_phi]
    slab = Slab(float(tau), 1.0, Rayleigh(), mu0[sun], ground_albedo=(0.0, 0.25, 0.8)[albedo])
    travel = mu[chosen_mu] if upwards else -mu[chosen_mu]
    phi = np.radians(30.0 * np.array(chosen_phi))
    answer = slab.radiance(0.0 if upwards else float(tau), travel[:, None], phi, samples=samples, stokes=True)
    return answer.stokes[..., 0, :3], expected, answer.stokes_error[..., 0, :3]


@pytest.mark.parametrize("upwards", [pytest.param(True, marks=pytest.mark.slow), False])
@pytest.mark.parametrize(
    ("tau", "albedo", "sun"),
    [("0.25", 1, 1), *(pytest.param(*p, marks=pytest.mark.slow) for p in (("1", 0, 3), ("1", 2, 1)))],
)
def test_rayleigh_slabs_against_corrected_coulson_tables(
    tau: str, albedo: int, sun: int, upwards: bool, reference: Path
) -> None:
    found, expected, error = compare_with_cds(reference, tau, albedo, sun, upwards, 4096)
    # Tolerance of `single` in `path`, 5e-5, and of the column table.
    assert_agrees(found, expected, error, slack=1e-4)
    # All directions together are known ten times better: Q and U to a few 0.1 % of I.
    scale = expected[..., :1]
    mean, spread = np.mean((found - expected) / scale, axis=(0, 1)), np.sqrt(np.sum((error / scale) ** 2, axis=(0, 1)))
    assert np.all(np.abs(mean) < 4 * spread / 16 + 1e-4)


@SLOW
@pytest.mark.parametrize("upwards", [True, False])
@pytest.mark.parametrize(
    ("tau", "albedo", "sun", "samples"), [("0.05", 0, 1, 2**13), ("0.25", 1, 3, 2**16), ("1", 0, 5, 2**18)]
)
def test_rayleigh_slabs_to_a_thousandth(
    tau: str, albedo: int, sun: int, samples: int, upwards: bool, reference: Path
) -> None:
    found, expected, error = compare_with_cds(reference, tau, albedo, sun, upwards, samples)
    assert np.median(error[..., 0] / expected[..., 0]) < 1.2e-3
    assert_agrees(found, expected, error, slack=1e-4)
    off = np.abs(found - expected) / expected[..., :1]
    print(f"tau {tau}: largest difference {off.max(axis=(0, 1))} of I, median {np.median(off, axis=(0, 1))}")
    assert np.all(np.median(off, axis=(0, 1)) < 1e-3)


def greek(reference: Path) -> GreekPhase:
    """Randomly oriented spheroids of Kuik, de Haan & Hovenier (1992), as Siewert (2000) used them in problem IIA."""
    rows = {}
    for line in (reference / "siewert2000_problem_IIA" / "greek_coefficients.csv").read_text().splitlines()[1:]:
        name, *values = line.split(",")
        rows[name.split("(")[0]] = tuple(float(v) for v in values)
    return GreekPhase(**rows)


@pytest.mark.parametrize("samples", [pytest.param(n, marks=SLOW) for n in (4096, 2**16)])
@pytest.mark.parametrize(
    ("azimuth", "tables"),
    [(0, ("table2_I", "table3_Q")), pytest.param(180, ("table8_I", "table9_Q"), marks=SLOW)],
)
def test_siewert_problem_2a(azimuth: int, tables: tuple[str, str], samples: int, reference: Path) -> None:
    """Spheroids, for which a2 differs from a1 and a4 from a3, in an absorbing slab of thickness 1."""
    folder = reference / "siewert2000_problem_IIA"
    i, q = (np.loadtxt(folder / f"{name}_az{azimuth}.csv", delimiter=",", skiprows=1) for name in tables)
    slab = Slab(1.0, 0.973527, greek(reference), 0.6)
    for column, tau, side in ((1, 0.0, -1), (4, 0.5, 1), (7, 1.0, 1)):
        # Rows are cosines of travel, positive downwards; beside the beam and the vertical, where no plane is defined.
        rows = np.flatnonzero((side * i[:, 0] > 0.05) & (side * i[:, 0] < 0.95) & (np.abs(i[:, 0] - 0.6) > 0.05))
        answer = slab.radiance(tau, -i[rows, 0], np.radians(azimuth), samples=samples, stokes=True)
        found, error = answer.stokes[:, 0, :2], answer.stokes_error[:, 0, :2]
        expected = np.stack([i[rows, column], q[rows, column]], axis=-1)
        # Six digits; `single` in `path`, the column table and chords of the phase table leave 1e-4 of I.
        allowed = largest_t(expected.size) * error + 2e-4 * expected[:, :1]
        assert np.all(np.abs(found - expected) < allowed)
        assert np.median(error[:, 0] / expected[:, 0]) < 2 / np.sqrt(samples)


# All orders: consistency


@cache
def hazy(sun: float, azimuth: float = 0.0) -> skyscatter.Scene:
    return scene_of(AIR, SPHERES, sun=sun, azimuth=azimuth)


@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")  # the spread over 16 seeds is what is judged by
@pytest.mark.parametrize("sun", [30.0, pytest.param(0.0, marks=SLOW)])
@pytest.mark.slow
def test_marched_and_free_walks_agree(sun: float) -> None:
    _, marched = over_seeds(lambda seed: look(hazy(sun), samples=256, seed=seed), 16)
    _, free = over_seeds(lambda seed: look(hazy(sun), samples=2000, sampling="free-flight", seed=seed), 16)
    for name in ("radiance", "Q", "U", "V"):
        error = np.hypot(marched[name][1], free[name][1])
        scale = 2e-4 * marched["radiance"][0]  # what both share, and the quadrature of the first order
        allowed = largest_t(error.size) * error + scale
        assert np.all(np.abs(marched[name][0] - free[name][0]) < allowed), name
    # There is circular polarisation, and it is seen.
    assert np.max(np.abs(marched["V"][0]) / marched["V"][1]) > 8


@pytest.mark.filterwarnings("ignore:sampling = 'free-flight'")  # the spread over 16 seeds is what is judged by
@pytest.mark.parametrize("sampling", ["march", pytest.param("free-flight", marks=SLOW)])
@pytest.mark.parametrize("sun", [pytest.param(sun, marks=SLOW) for sun in (30.0, -4.0)])
def test_every_wavelength_alone_agrees_with_all_together(sun: float, sampling: str) -> None:
    samples = 256 if sampling == "march" else 4000
    _, together = over_seeds(lambda seed: look(hazy(sun), samples=samples, sampling=sampling, seed=seed), 16)
    for k, wavelength in enumerate(WAVELENGTHS):
        _, alone = over_seeds(
            lambda seed, w=wavelength: look(hazy(sun), SIGHTS, [w], samples=samples, sampling=sampling, seed=seed), 16
        )
        for name in ("radiance", "Q", "U", "V"):
            mean, error = together[name][0][:, k], np.hypot(together[name][1][:, k], alone[name][1][:, 0])
            # The first order may differ by the tolerance of its steps, which are chosen for all wavelengths at once.
            slack = 2e-4 * together["radiance"][0][:, k]
            assert np.all(np.abs(mean - alone[name][0][:, 0]) < largest_t(mean.size) * error + slack), name


@pytest.mark.slow
def test_stated_errors_are_the_spread_over_seeds() -> None:
    seeds = 60
    answers = [look(hazy(30.0), samples=256, seed=seed) for seed in range(seeds)]
    spread = np.var([a.stokes for a in answers], axis=0, ddof=1)
    stated = np.mean([a.stokes_error**2 for a in answers], axis=0)
    # As in test_path_statistics: chi-square of 59 degrees of freedom, with room for heavier tails than normal ones.
    low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], seeds - 1) / (seeds - 1)
    ratio = spread / stated
    assert ratio.min() > 0.9 * low
    assert ratio.max() < 1.1 * high
    assert np.mean(ratio, axis=(0, 1)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (5 * (seeds - 1))))


@pytest.mark.slow
def test_free_flights_state_their_errors() -> None:
    seeds = 60
    answers = [look(hazy(30.0), samples=500, sampling="free-flight", seed=seed) for seed in range(seeds)]
    ratio = np.var([a.stokes for a in answers], axis=0, ddof=1) / np.mean([a.stokes_error**2 for a in answers], axis=0)
    assert np.mean(ratio, axis=(0, 1)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (5 * (seeds - 1))))


def test_mirror_symmetry_about_the_plane_of_the_sun() -> None:
    left, right = (
        over_seeds(lambda seed, s=side: look(hazy(20.0), [(s * a, e) for a, e in SIGHTS], samples=512, seed=seed), 16)[
            1
        ]
        for side in (-1, 1)
    )
    for name, parity in (("radiance", 1), ("Q", 1), ("U", -1), ("V", -1)):
        error = np.hypot(left[name][1], right[name][1])
        assert_agrees(left[name][0], parity * right[name][0], error, slack=1e-9)
    assert np.max(np.abs(left["U"][0]) / left["U"][1]) > 20
    assert np.max(np.abs(left["V"][0]) / left["V"][1]) > 8


@pytest.mark.parametrize("solver", ["single", "path"])
def test_turning_sun_and_camera_together_changes_nothing(solver: str) -> None:
    options = {"samples": 1024} if solver == "path" else {}
    one = look(hazy(10.0), solver=solver, **options)
    two = look(hazy(10.0, 77.0), [(a + 77.0, e) for a, e in SIGHTS], solver=solver, **options)
    error = np.hypot(one.stokes_error, two.stokes_error)
    allowed = largest_t(error.size) * error + 1e-9 * one.radiance[..., None]
    assert np.all(np.abs(one.stokes - two.stokes) < allowed)


def test_orders_add_up() -> None:
    answer = look(hazy(30.0), samples=64, max_order=3, orders=3, parts=True)
    total = sum(answer.layers[f"order{k}"] for k in (1, 2, 3))
    np.testing.assert_allclose(total, answer.radiance, rtol=1e-12)
    once, single = look(hazy(30.0), samples=64, max_order=1), look(hazy(30.0), solver="single", tolerance=5e-4)
    np.testing.assert_allclose(once.stokes, single.stokes, rtol=1e-12, atol=1e-18)


def test_isotropic_scattering_is_scalar_but_for_rounding() -> None:
    """It loses all polarisation: the same walks, the same radiance, no Q, U, V."""
    fog = skyscatter.Component(
        name="fog", density=Uniform(top=1000.0), optics=Particles(optical_depth=2.0, phase=Isotropic())
    )
    scene = scene_of(fog)
    polarised = look(scene, samples=64)
    d = direction_from_azimuth_elevation(*np.array(SIGHTS).T)
    scalar = skyscatter.radiance(scene, scene.observer.position, d, WAVELENGTHS, solver=skyscatter.Path(samples=64))
    # Two variants of the kernel may round differently: 2^-53 for each of a walk's some hundred factors.
    np.testing.assert_allclose(polarised.radiance, scalar.radiance, rtol=1e-13)
    # The error is a root of squared differences between batches, here some hundredths of the mean: 100 times that.
    np.testing.assert_allclose(polarised.standard_error, scalar.standard_error, rtol=1e-11)
    assert not polarised.stokes[..., 1:].any()


@pytest.mark.parametrize("solver", ["single", "path"])
def test_black_medium_sends_nothing(solver: str) -> None:
    soot = skyscatter.Component(
        name="soot",
        density=Uniform(top=1000.0),
        optics=TabulatedAbsorption(coefficient=skyscatter.SpectralTable(wavelengths=(400, 700), values=(1e-3, 1e-3))),
    )
    answer = look(scene_of(soot, albedo=0.0), solver=solver)
    assert not answer.stokes.any()
    assert not answer.stokes_error.any()


@pytest.mark.slow
def test_scalar_light_misses_the_radiance() -> None:
    """Mishchenko, Lacis & Travis (1994), JQSRT 51, 491: up to 10 % in Rayleigh slabs, of either sign."""
    slab = Slab(1.0, 1.0, Rayleigh(), 0.6)
    mu, phi = -np.array([0.1, 0.4, 0.8])[:, None], np.array([0.3, np.pi / 2, 2.8])
    polarised = slab.radiance(1.0, mu, phi, samples=4096, stokes=True)
    scalar = slab.radiance(1.0, mu, phi, samples=4096)
    ratio = scalar.radiance / polarised.radiance
    assert ratio.max() > 1.03
    assert ratio.min() < 0.97


# What one sees


def meridian_q(scene: skyscatter.Scene, angle: float, samples: int) -> float:
    """Q / I on the solar meridian at an angle from the horizon below the Sun, 180 being opposite; 450 nm."""
    vector = look(scene, [(0.0, angle)], [450.0], samples=samples).stokes[0, 0]
    return float(vector[1] / vector[0])


@SLOW
@pytest.mark.parametrize("sun", [0.0, 35.0])
def test_neutral_points_of_a_clear_sky(sun: float) -> None:
    """Babinet's and Brewster's points 10 to 25 degrees above and below the Sun, Arago's above the antisolar point.

    Coulson (1988), Polarization and Intensity of Light in the Atmosphere, chapter 5: on the solar meridian light is
    polarised across the plane of scattering (Q < 0) but between these points, where twofold scattering wins.
    """
    scene = scene_of(AIR, sun=sun, albedo=0.15)
    samples = 2**14
    crossings = {"Babinet": (sun + 3.0, sun + 45.0)}
    if sun > 0:
        crossings["Brewster"] = (sun - 3.0, 3.0)
    else:
        crossings["Arago"] = (177.0, 145.0)
    for name, (inside, outside) in crossings.items():
        start = sun if name != "Arago" else 180.0 - sun
        assert meridian_q(scene, inside, samples) > 0 > meridian_q(scene, outside, samples), name
        # The same seed and ray number at every call: the walks change smoothly with the angle.
        zero = brentq(lambda angle: meridian_q(scene, angle, samples), inside, outside, xtol=0.3)
        print(f"{name}: {abs(zero - start):.1f} degrees")
        assert 9.0 < abs(zero - start) < 26.0, name
    across = look(scene, [(0.0, sun + 60.0)], [450.0], samples=samples)
    assert abs(across.layers["U"][0, 0]) < 4 * across.layers["U_error"][0, 0]
    assert across.layers["Q"][0, 0] < 0


# Asking for it


def test_answers_without_polarisation_say_so() -> None:
    scene = hazy(30.0)
    answer = skyscatter.radiance(scene, scene.observer.position, [0.0, 0.0, 1.0], WAVELENGTHS, "single")
    with pytest.raises(DomainError, match="stokes=True"):
        _ = answer.stokes
    with pytest.raises(DomainError, match="stokes=True"):
        _ = answer.stokes_error
    assert answer.layers == {}


def test_pictures_carry_the_layers_through_interruption(tmp_path: Path) -> None:
    from skyscatter.solvers.render import render
    from skyscatter.solvers.run import Interrupted

    scene, camera = hazy(30.0), skyscatter.Panorama(width=24, height=12)
    options: dict[str, Any] = {"solver": "path", "samples": 16, "stokes": True, "threads": 1}
    whole = render(scene, camera, WAVELENGTHS, **asked(**options))
    assert set(whole.layers) == {"Q", "U", "V", "Q_error", "U_error", "V_error"}
    assert whole.recipe["options"]["stokes"] is True

    def stop(share: float) -> None:
        if share > 0.4:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        render(scene, camera, WAVELENGTHS, progress=stop, **asked(**options))
    caught.value.state.save(tmp_path / "state.zarr")
    again = render(scene, camera, WAVELENGTHS, resume=tmp_path / "state.zarr", **asked(**options))
    for name in whole.layers:
        assert np.array_equal(whole.layers[name], again.layers[name], equal_nan=True)
    with pytest.raises(DomainError, match="begun with other options"):
        render(
            scene, camera, WAVELENGTHS, solver=skyscatter.Path(samples=16), resume=tmp_path / "state.zarr", threads=1
        )


def test_noise_stops_polarised_walks_too() -> None:
    answer = look(hazy(30.0), noise=0.05)
    assert np.all((answer.standard_error / answer.radiance).mean(axis=-1) <= 0.05)
    assert answer.samples.max() < 2**20


def test_every_phase_function_polarises_as_its_matrix_says() -> None:
    """A thin layer of each kind at right angles to the Sun: Q / I = -b1 / a1 in the horizon's frame."""
    phases: tuple[AnyPhase, ...] = (Isotropic(), Rayleigh(depolarisation=0.1), HenyeyGreenstein(g=0.3))
    for phase in phases:
        layer = skyscatter.Component(
            name="layer", density=Uniform(top=1000.0), optics=Particles(optical_depth=1e-7, phase=phase)
        )
        found = look(scene_of(layer, sun=0.0, albedo=0.0), [(90.0, 30.0)], [550.0], solver="single").stokes[0, 0]
        a1, _, _, _, b1, _ = phase.matrix([0.0], [550.0])[:, 0, 0]
        # The Sun lies sideways: the plane of scattering is at right angles to the meridian.
        np.testing.assert_allclose(found[1:3] / found[0], [-b1 / a1, 0.0], atol=1e-6)
