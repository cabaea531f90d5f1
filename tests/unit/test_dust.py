"""Dust: Draine's table, its amount, its phase functions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bases import PhaseFunctionBase, complaint
from pydantic import TypeAdapter
from scipy.integrate import quad

from skyscatter.datafiles import read_table
from skyscatter.media.fields import Exponential
from skyscatter.media.medium import AnyOptics, Component, Medium
from skyscatter.optics.dust import MIXTURES, Dust, draine_mean_square, draine_parameters, dust_properties
from skyscatter.optics.phase import Draine, draine_mean_cosine, draine_value
from skyscatter.solvers.compile import medium_optics
from skyscatter.spectra.table import evaluate

Array = np.ndarray
PC = 3.0856775814913673e16


def draine_table(reference: Path) -> Array:
    """Rows lambda [nm], albedo, <cos>, C_ext/H [cm2], K_abs [cm2/g], <cos^2> from 0.09 to 10 micron, rising."""
    text = (reference / "dust_wd01_d03" / "kext_albedo_WD_MW_3.1_60_D03.dat").read_text()
    lines = text.split("-----------")[-1].splitlines()[1:]
    rows = np.array([[float(cell) for cell in line.split()[:6]] for line in lines if line.strip()])
    rows = rows[(rows[:, 0] >= 0.09) & (rows[:, 0] <= 10.0)]
    rows[:, 0] *= 1e3
    return rows[np.argsort(rows[:, 0])]


def test_every_digit_of_draines_table(reference: Path) -> None:
    rows = draine_table(reference)
    ours = dust_properties("milky-way-3.1", rows[:, 0])
    assert len(rows) == read_table("dust_draine2003.csv")["wavelength_nm"].size == 251
    np.testing.assert_allclose(ours.cross_section, rows[:, 3] * 1e-4, rtol=1e-12)  # rounding of exp and log
    np.testing.assert_allclose(ours.albedo, rows[:, 1], rtol=1e-12)
    np.testing.assert_allclose(ours.mean_cosine, rows[:, 2], atol=1e-15)
    np.testing.assert_allclose(ours.mean_squared_cosine, rows[:, 5], rtol=1e-12)


def test_mass_of_dust_is_the_one_of_the_table(reference: Path) -> None:
    """Absorption per mass of dust, a column of the table that is not shipped."""
    rows = draine_table(reference)
    metre_kg = 10.0  # cm2/g in m2/kg, the other way round: K [cm2/g] = 10 K [m2/kg]
    absorption = Dust(dust_density=1.0).coefficients(rows[:, 0], 1.0).absorption * metre_kg
    # Albedos have four decimals, of which an absorption (1 - albedo) of 0.3 keeps three digits.
    np.testing.assert_allclose(absorption, rows[:, 4], rtol=1e-3)


@pytest.mark.parametrize(
    ("mixture", "micron", "albedo", "g", "section", "square"),
    [
        # Rows as printed by Draine, 17 December 2003.
        ("milky-way-3.1", 0.549541, 0.6737, 0.5374, 4.866e-22, 0.53152),
        ("milky-way-4.0", 0.549541, 0.7114, 0.5675, 5.756e-22, 0.55470),
        ("milky-way-5.5", 0.549541, 0.7609, 0.5992, 6.686e-22, 0.57835),
        ("milky-way-4.0", 0.194984, 0.4572, 0.6115, 1.231e-21, 0.62619),
        ("milky-way-5.5", 2.13796, 0.5539, 0.2159, 7.832e-23, 0.41682),
    ],
)
def test_printed_rows(mixture: str, micron: float, albedo: float, g: float, section: float, square: float) -> None:
    ours = dust_properties(mixture, [micron * 1e3])
    for value, printed in zip(ours, (section * 1e-4, albedo, g, square), strict=True):
        assert value[0] == pytest.approx(printed, rel=1e-12)


def test_printed_values_between_the_rows() -> None:
    """Spot values that go with the table: H-beta, V, H-alpha, K."""
    wl = [486.1, 549.5, 656.2, 2166.0]
    ours = dust_properties("milky-way-3.1", wl)
    # The last printed digit, plus a step of at most 0.05 nm in the wavelength.
    np.testing.assert_allclose(ours.albedo, [0.665, 0.6737, 0.6741, 0.4425], atol=6e-4)
    np.testing.assert_allclose(ours.mean_cosine, [0.556, 0.5374, 0.4967, 0.134], atol=6e-4)
    np.testing.assert_allclose(ours.cross_section[1:3], [4.866e-26, 3.801e-26], rtol=1e-3)


@pytest.mark.parametrize(("mixture", "ratio"), [("milky-way-3.1", 3.1), ("milky-way-4.0", 4.0), ("milky-way-5.5", 5.5)])
def test_ratio_of_total_to_selective_extinction(mixture: str, ratio: float) -> None:
    """R_V = A_V / (A_B - A_V); grains were fitted to the curves of Cardelli et al. (1989), R_V being their input."""
    blue, visual = dust_properties(mixture, [440.0, 550.0]).cross_section
    assert visual / (blue - visual) == pytest.approx(ratio, rel=0.03)  # 440 and 550 nm stand for the bands


def test_interpolation_is_logarithmic() -> None:
    table = read_table("dust_draine2003.csv")
    x, section, albedo = (table[name][60:62] for name in ("wavelength_nm", "extinction_5.5", "albedo_5.5"))
    ours = dust_properties("milky-way-5.5", [np.sqrt(x[0] * x[1])])
    assert ours.cross_section[0] == pytest.approx(np.sqrt(section[0] * section[1]), rel=1e-12)
    assert ours.albedo[0] == pytest.approx(albedo.mean(), rel=1e-12)


def test_against_an_independent_mie_calculation(reference: Path) -> None:
    """Robitaille's recomputation of the same model; its authors warn that the smallest grains are treated otherwise."""
    folder = reference / "dust_wd01_d03"
    micron, albedo, g, chi = (
        np.loadtxt(folder / f"hyperion_d03_3.1_6.0_A.{name}").ravel() for name in ("wav", "alb", "g", "chi")
    )
    inside = (micron > 0.0915) & (micron < 10.0)
    micron, albedo, g, chi = (column[inside] for column in (micron, albedo, g, chi))
    ours = dust_properties("milky-way-3.1", micron * 1e3)
    # Scattering is the work of the large grains, which both treat alike: the same mean cosine to 0.007 throughout ...
    np.testing.assert_allclose(ours.mean_cosine, g, atol=0.007)
    # ... and the same colour of the scattered light to 5 % (the mass per hydrogen differs, hence relative to 550 nm).
    scattering = ours.albedo * ours.cross_section / (albedo * chi)
    optical = (micron > 0.1) & (micron < 1.0)
    np.testing.assert_allclose(scattering[optical] / np.interp(0.55, micron, scattering), 1.0, atol=0.05)
    # Small grains absorb: PAHs and their 217.5 nm feature are not in the recomputation.
    np.testing.assert_allclose(ours.albedo, albedo, atol=0.07)
    ratio = ours.cross_section / MIXTURES["milky-way-3.1"].per_hydrogen * 10 / chi
    # The mass per hydrogen, which differs, moves all of it by one factor: 0.8, to 0.03 where no small grains absorb.
    # Where they do the factor is nearer to 1: their absorption adds up to a third of what is left, and to no more.
    infrared = (micron > 1.0) & (micron < 5.0)
    np.testing.assert_allclose(ratio[infrared], 0.81, rtol=0, atol=0.03)
    assert ratio.min() > 0.78
    assert ratio.max() < 1.15


@pytest.mark.parametrize("mixture", MIXTURES)
def test_visual_extinction_is_the_column(mixture: str) -> None:
    column = 0.3 * PC
    dust = Dust(mixture=mixture, visual_extinction=2.5)
    scattering, absorption, emission = dust.coefficients([550.0, 440.0], column)
    tau = (scattering + absorption) * column
    assert tau[0] == pytest.approx(2.5 * np.log(10) / 2.5, rel=1e-12)
    assert tau[1] > tau[0]
    assert not np.any(emission)
    assert scattering[0] / (scattering[0] + absorption[0]) == pytest.approx(
        dust_properties(mixture, [550.0]).albedo[0], rel=1e-12
    )


def test_a_component_has_its_visual_extinction() -> None:
    """Through the compiled optics of a medium, along the column of a real field."""
    field = Exponential(scale_height=2e16)
    component = Component(name="dust", density=field, optics=Dust(visual_extinction=3.0), weight=0.5)
    scattering, extinction, _, phase, _ = medium_optics(
        Medium(planet_radius=1e18, components=(component,)), (440.0, 550.0)
    )
    assert extinction[0, 1] * float(field.vertical_column(0.0)) == pytest.approx(1.5 * np.log(10) / 2.5, rel=1e-9)
    assert 0.6 < scattering[0, 1] / extinction[0, 1] < 0.7
    assert phase[0, 0, 0] > phase[0, 0, 1]  # dust throws blue light forwards more than yellow


def test_hydrogen_density_and_the_known_ratio_of_column_to_extinction() -> None:
    """N_H / A_V = 1.87e21 cm-2 mag-1, Bohlin, Savage & Drake (1978), R_V = 3.1."""
    dust = Dust(hydrogen_density=1e9)
    extinction = sum(dust.coefficients([550.0], 1.0)[:2])[0]
    per_magnitude = 1e9 / (2.5 / np.log(10) * extinction)
    # 1.90e25 m-2: Draine (2003) chose his abundances so; the observed mean scatters by several per cent.
    assert per_magnitude == pytest.approx(1.87e25, rel=0.03)


def test_three_ways_to_say_how_much() -> None:
    wl, column = [300.0, 550.0, 2000.0], 1e16
    by_gas = Dust(hydrogen_density=3e9)
    expected = by_gas.coefficients(wl, column)
    by_mass = Dust(dust_density=3e9 * 1.870e-29)
    by_depth = Dust(visual_extinction=2.5 / np.log(10) * column * 3e9 * dust_properties("milky-way-3.1", [550.0])[0][0])
    own = Dust(hydrogen_density=3e9, dust_to_gas=1 / 123.6)
    double = Dust(hydrogen_density=1.5e9, dust_to_gas=2 / 123.6)
    for other in (by_mass, by_depth, own, double):
        ours = other.coefficients(wl, column)
        np.testing.assert_allclose(ours.scattering, expected.scattering, rtol=1e-12)
        np.testing.assert_allclose(ours.absorption, expected.absorption, rtol=1e-12)


def test_moments_of_the_draine_family_by_quadrature() -> None:
    for g, alpha in ((0.5, 0.3), (-0.2, 1.0), (0.7, -0.4)):
        moments = [
            quad(lambda mu, n=n, g=g, a=alpha: 2 * np.pi * mu**n * float(draine_value(mu, g, a)), -1, 1)[0]
            for n in (1, 2)
        ]
        assert float(draine_mean_cosine(g, alpha)) == pytest.approx(moments[0], abs=1e-12)
        assert float(draine_mean_square(g, alpha)) == pytest.approx(moments[1], abs=1e-12)


def test_draine_parameters_come_back() -> None:
    g, alpha = np.array([0.5, -0.05, 0.0, 0.72, 0.58]), np.array([0.2, 0.97, 0.5, 0.9, -0.3])
    again = draine_parameters(draine_mean_cosine(g, alpha), draine_mean_square(g, alpha))
    np.testing.assert_allclose(again[0], g, atol=1e-10)  # the bisections end at 1e-13 of alpha; moments amplify it
    np.testing.assert_allclose(again[1], alpha, atol=1e-10)


@pytest.mark.parametrize(
    ("mixture", "shortest"), [("milky-way-3.1", 370.0), ("milky-way-4.0", 430.0), ("milky-way-5.5", 465.0)]
)
def test_draine_phase_has_both_moments_of_the_table(mixture: str, shortest: float) -> None:
    wl = np.geomspace(92.0, 9900.0, 300)
    properties = dust_properties(mixture, wl)
    phase = Dust(mixture=mixture, visual_extinction=1.0, phase="draine").phase_function(wl)
    assert isinstance(phase, Draine)
    g, alpha = evaluate(phase.g, wl), evaluate(phase.alpha, wl)
    np.testing.assert_allclose(phase.mean_cosine(wl), properties.mean_cosine, atol=1e-12)
    square = draine_mean_square(g, alpha)
    long = wl >= shortest
    np.testing.assert_allclose(square[long], properties.mean_squared_cosine[long], atol=1e-10)
    # In the ultraviolet the family would need a lobe straight back; there alpha stays at the dipole's 1.
    np.testing.assert_allclose(alpha[wl < 0.9 * shortest], 1.0, atol=1e-10)


class TestDustPhase(PhaseFunctionBase):
    phase_class = Draine
    examples = tuple(
        Dust(mixture=name, visual_extinction=1.0, phase="draine").phase_function([400.0, 550.0, 700.0])
        for name in ("milky-way-3.1", "milky-way-5.5")
    )
    refused = (({"g": 1.0}, "g = 1.0"),)
    table_error = 1e-4

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        g, a = (float(evaluate(p, [wavelength])[0]) for p in (phase.g, phase.alpha))
        norm = 4 * np.pi * (1 + a * (1 + 2 * g * g) / 3)
        return (1 - g * g) / norm * (1 + a * mu**2) / (1 + g * g - 2 * g * mu) ** 1.5

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        mixture = "milky-way-3.1" if phase == self.examples[0] else "milky-way-5.5"
        return float(dust_properties(mixture, [wavelength]).mean_cosine[0])


def test_henyey_greenstein_has_the_tabulated_mean() -> None:
    wl = np.array([2166.0, 300.0, 656.2])
    phase = Dust(hydrogen_density=1.0).phase_function(wl)
    np.testing.assert_allclose(phase.mean_cosine(wl), dust_properties("milky-way-3.1", wl).mean_cosine, rtol=1e-12)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({}, "exactly one of visual_extinction"),
        ({"visual_extinction": 1.0, "dust_density": 1e-20}, "visual_extinction, dust_density"),
        ({"visual_extinction": -1.0}, "visual_extinction = -1.0"),
        ({"visual_extinction": 1.0, "dust_to_gas": 0.01}, "dust_to_gas = 0.01"),
        ({"hydrogen_density": 1.0, "dust_to_gas": -0.01}, "dust_to_gas = -0.01"),
        ({"hydrogen_density": 1.0, "mixture": "moon"}, "milky-way-5.5"),
        ({"hydrogen_density": 1.0, "phase": "mie"}, "henyey-greenstein"),
    ],
)
def test_refuses(fields: dict[str, Any], word: str) -> None:
    assert word in complaint(lambda: Dust(**fields))


def test_refuses_wavelengths_and_columns() -> None:
    assert "wavelength = 90.0: dust is tabulated from 91.2 to 10000 nm" in complaint(
        lambda: Dust(hydrogen_density=1.0).coefficients([500.0, 90.0], 1.0)
    )
    assert "column = 0.0" in complaint(lambda: Dust(visual_extinction=1.0).coefficients([500.0], 0.0))
    assert "mixture = 'moon'" in complaint(lambda: dust_properties("moon", [500.0]))


def test_written_and_read_back() -> None:
    dust = Dust(mixture="milky-way-5.5", hydrogen_density=1e9, dust_to_gas=0.01, phase="draine")
    again = TypeAdapter(AnyOptics).validate_python(dust.model_dump(mode="json", exclude_none=True))
    assert again == dust
    assert hash(again) == hash(dust)
