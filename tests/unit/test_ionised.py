"""Ionisation by hot stars, against closed forms and published numbers."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from bases import complaint
from scipy.integrate import quad
from scipy.optimize import brentq

from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK, SOLAR_LUMINOSITY, STEFAN_BOLTZMANN
from skyscatter.media.ionised import (
    LYMAN_LIMIT,
    alpha_b,
    case_b_luminosity,
    case_b_photons,
    front_radii,
    ionising_photons,
    stromgren_radius,
)
from skyscatter.optics.lines import GasLines
from skyscatter.units import PARSEC

Array = np.ndarray
Q, N = 1e49, 1e8
UNIFORM = stromgren_radius(Q, N)
RNG = np.random.default_rng(8)
DIRECTIONS = RNG.normal(size=(50, 3))


def fronts(density: Callable[[Array], Array], limit: float = 4 * UNIFORM, **more: Any) -> Array:
    settings: dict[str, Any] = {"position": (0.0, 0.0, 0.0), "directions": DIRECTIONS} | more
    return front_radii(density, hydrogen_density=N, ionising_photons=Q, limit=limit, **settings)


def radius(points: Array) -> Array:
    return np.linalg.norm(points, axis=1)


@pytest.mark.parametrize(("temperature", "printed"), [(5000.0, 4.54e-19), (1e4, 2.59e-19), (2e4, 1.43e-19)])
def test_recombination_coefficient(temperature: float, printed: float) -> None:
    """Osterbrock & Ferland (2006), table 2.1 and Draine (2011), table 14.1: three digits, the fit's 0.7 %."""
    assert alpha_b(temperature) == pytest.approx(printed, rel=0.007)


def test_stromgren_radius_of_the_textbook() -> None:
    """Draine (2011), eq. 15.3: 3.17 pc Q49^(1/3) n2^(-2/3) T4^0.28."""
    assert stromgren_radius(Q, N) / PARSEC == pytest.approx(
        3.17, rel=0.01
    )  # his alpha_B is 2.56e-13 cm3 s-1, ours 2.59e-13
    assert stromgren_radius(8 * Q, N) == pytest.approx(2 * UNIFORM, rel=1e-14)
    assert stromgren_radius(Q, 8 * N) == pytest.approx(UNIFORM / 4, rel=1e-14)


def test_photons_in_are_recombinations() -> None:
    """H-beta of the whole sphere: volume times emissivity is the closed form for an ionisation-bounded region."""
    volume = 4 / 3 * np.pi * UNIFORM**3
    by_volume = 4 * np.pi * GasLines(electron_density=N).line_emissivity("hbeta") * volume
    assert case_b_luminosity(Q) == pytest.approx(by_volume, rel=1e-12)
    # Osterbrock & Ferland (2006), eq. 5.34: alpha_B / alpha_eff(H-beta) = 8.5, one H-alpha for 2.2 recombinations.
    assert Q / case_b_photons(Q) == pytest.approx(8.55, rel=0.01)
    assert Q / case_b_photons(Q, "halpha") == pytest.approx(2.2, rel=0.015)


def test_uniform_gas() -> None:
    # The integrand is a polynomial that the rule integrates exactly.
    np.testing.assert_allclose(fronts(lambda x: np.ones(len(x))), UNIFORM, rtol=1e-10)


def test_density_falling_as_one_over_r() -> None:
    """n = n0 a / r: Q / 4 pi = alpha n0^2 a^2 R."""
    a = 0.3 * UNIFORM
    expected = UNIFORM**3 / (3 * a**2)
    found = fronts(lambda x: a / np.maximum(radius(x), 1e-9 * a), limit=1.5 * expected)
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # the tolerance asked for


def test_exponential_density() -> None:
    """n = n0 exp(-r / H): integral of r^2 exp(-2 r / H) is H^3 / 8 (2 - exp(-u) (u^2 + 2 u + 2)), u = 2 R / H."""
    h = 1.5 * UNIFORM
    wanted = UNIFORM**3 / 3

    def used(r: float) -> float:
        u = 2 * r / h
        return h**3 / 8 * (2 - np.exp(-u) * (u * u + 2 * u + 2)) - wanted

    expected = brentq(used, 0.1 * h, 10 * h, rtol=1e-13)
    np.testing.assert_allclose(fronts(lambda x: np.exp(-radius(x) / h)), expected, rtol=2e-6)  # tolerance, amplified


def test_wall_and_hole() -> None:
    """A cavity of 0.1 of the density out to half the radius, a wall of 50 times it at 0.9: both edges are found."""

    def density(x: Array) -> Array:
        r = radius(x) / UNIFORM
        return np.where(r < 0.5, 0.1, np.where(r < 0.9, 1.0, 50.0))

    left = 1 - 0.01 * 0.5**3 - (0.9**3 - 0.5**3)
    expected = UNIFORM * (0.9**3 + left / 2500) ** (1 / 3)
    np.testing.assert_allclose(fronts(density), expected, rtol=1e-6)


def test_star_off_centre_in_a_slab() -> None:
    """A slab |z| < D: directions differ, and photons escape where they cross it."""
    d = 0.4 * UNIFORM
    star = np.array([1e16, -2e16, 0.25 * d])
    found = fronts(lambda x: np.where(np.abs(x[:, 2]) < d, 1.0, 0.0), position=star)
    mu = DIRECTIONS[:, 2] / radius(DIRECTIONS)
    reach = np.where(mu > 0, 0.75 * d, 1.25 * d) / np.abs(mu)
    np.testing.assert_allclose(found, np.where(reach > UNIFORM, UNIFORM, 4 * UNIFORM), rtol=1e-6)
    assert np.any(found < 2 * UNIFORM)


def test_clumpy_gas_against_adaptive_quadrature() -> None:
    def density(x: Array) -> Array:
        return 1 + 0.9 * np.sin(9 * x[:, 0] / UNIFORM) * np.cos(7 * x[:, 1] / UNIFORM + 2 * x[:, 2] / UNIFORM)

    found = fronts(density, directions=DIRECTIONS[:5])
    for direction, front in zip(DIRECTIONS[:5], found, strict=True):
        unit = direction / np.linalg.norm(direction)

        def integrand(s: float, unit: Array = unit) -> float:
            return float(density((s * UNIFORM * unit)[None])[0] ** 2 * s * s)

        used = quad(integrand, 0, front / UNIFORM, epsabs=1e-11, limit=200)[0]
        assert used == pytest.approx(1 / 3, rel=1e-6)  # the tolerance asked for


def test_no_photons_ionise_nothing() -> None:
    out = front_radii(radius, (0, 0, 0), DIRECTIONS, hydrogen_density=N, ionising_photons=0.0, limit=1.0)
    assert not np.any(out)


def test_black_body_by_quadrature() -> None:
    for temperature in (8000.0, 40000.0, 150000.0, 2e6):

        def photons(wl: float, temperature: float = temperature) -> float:
            x = PLANCK * LIGHT / (wl * 1e-9 * BOLTZMANN * temperature)
            return 2 * LIGHT / (wl * 1e-9) ** 4 * np.exp(-x) / -np.expm1(-x) * 1e-9 * np.pi

        pieces = np.concatenate([[0.0001], np.geomspace(0.05, LYMAN_LIMIT, 12)])
        flux = sum(quad(photons, a, b, epsrel=1e-10)[0] for a, b in pairwise(pieces))
        assert ionising_photons(temperature, radius_m=1.0) == pytest.approx(4 * np.pi * flux, rel=1e-7)  # quadrature
        luminosity = 4 * np.pi * STEFAN_BOLTZMANN * temperature**4
        both = ionising_photons(temperature, luminosity_W=luminosity), ionising_photons(temperature, radius_m=1.0)
        assert both[0] == pytest.approx(both[1], rel=1e-12)


def test_all_photons_of_a_very_hot_body() -> None:
    """All photons of a black body: 2 zeta(3) in place of the series; the share below 13.6 eV vanishes as x^2 / 2."""
    temperature = 1e8
    area_rate = 4 * np.pi * 2 * np.pi / LIGHT**2 * (BOLTZMANN * temperature / PLANCK) ** 3
    assert ionising_photons(temperature, radius_m=1.0) == pytest.approx(2 * 1.2020569031595942 * area_rate, rel=1e-5)


def test_an_o_star_is_of_the_known_order() -> None:
    """O6 V of Martins, Schaerer & Hillier (2005), A&A 436, 1049, table 4: 38151 K, 10^5.30 Lsun, 10^48.96 s-1."""
    log_q = np.log10(ionising_photons(38151.0, luminosity_W=10**5.30 * SOLAR_LUMINOSITY))
    assert log_q == pytest.approx(48.96, abs=0.15)  # no star is a black body: line blanketing moves photons


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: alpha_b(10.0), "temperature = 10.0"),
        (lambda: stromgren_radius(-1.0, N), "ionising_photons = -1.0"),
        (lambda: stromgren_radius(Q, 0.0), "hydrogen_density = 0.0"),
        (lambda: fronts(radius, limit=0.0), "limit = 0.0"),
        (lambda: fronts(radius, directions=[[0.0, 0.0, 0.0]]), "directions"),
        (lambda: fronts(lambda x: -radius(x)), "density"),
        (lambda: ionising_photons(4e4), "exactly one"),
        (lambda: ionising_photons(0.0, radius_m=1.0), "temperature = 0.0"),
    ],
)
def test_refuses(call: Callable[[], Any], word: str) -> None:
    assert word in complaint(call)


@pytest.mark.parametrize("times", [1e6, 1e12, 2.0**63])
def test_gas_denser_by_many_powers_of_ten_ends_soon(times):
    """What lies behind a front that is near the star is not halved until its light-years are right to the last atom."""
    asked = []

    def density(points):
        asked.append(len(points))
        r = np.linalg.norm(points, axis=1)
        return times * (1 + 0.9 * np.sin(40 * r) * np.sign(np.sin(317 * points[:, 0])))

    ways = np.random.default_rng(2).normal(size=(12, 3))
    photons = times**2 * 4 * np.pi * alpha_b(1e4) * 1e-12 / 3  # a front at 1e-4 in gas of that density
    found = front_radii(density, (0, 0, 0), ways, hydrogen_density=1.0, ionising_photons=photons, limit=1.0)
    np.testing.assert_allclose(found, 1e-4, rtol=0.01)
    assert sum(asked) < 300_000
