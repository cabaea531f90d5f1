"""Scattering by molecules: coefficients, King factor and depolarisation."""

from __future__ import annotations

import numpy as np
import pytest
from bases import complaint

from skyscatter.optics.rayleigh import (
    RayleighAir,
    RayleighPowerLaw,
    cross_section_bodhaine1999,
    king_factor_bodhaine1999,
    refractive_index_bodhaine1999,
)

WL = np.array([280.0, 350.0, 450.0, 550.0, 700.0, 1000.0])


def test_against_colour_science() -> None:
    import colour.phenomena

    ours = cross_section_bodhaine1999(WL, 300.0) * 1e4
    theirs = colour.phenomena.scattering_cross_section(WL * 1e-7, CO2_concentration=300, temperature=288.15)
    # The same formulas; Avogadro's number differs by 1e-6 and enters squared.
    np.testing.assert_allclose(ours, theirs, rtol=5e-6)


def test_parts_against_colour_science() -> None:
    from colour.phenomena.rayleigh import F_air_Bodhaine1999, air_refraction_index_Bodhaine1999

    for co2 in (300.0, 420.0):
        king = F_air_Bodhaine1999(WL * 1e-3, co2)
        index = air_refraction_index_Bodhaine1999(WL * 1e-3, co2)
        np.testing.assert_allclose(king_factor_bodhaine1999(WL * 1e-3, co2), king, rtol=1e-12)  # rounding
        np.testing.assert_allclose(refractive_index_bodhaine1999(WL * 1e-3, co2) - 1, index - 1, rtol=1e-9)


def test_power_law() -> None:
    model = RayleighPowerLaw(coefficient=1.2e-5, wavelength="0.55 um")
    scattering, absorption, emission = model.coefficients([275.0, 550.0, 1100.0], 1.0)
    np.testing.assert_allclose(scattering, [16 * 1.2e-5, 1.2e-5, 1.2e-5 / 16], rtol=1e-14)  # rounding
    assert not absorption.any()
    assert not emission.any()


def test_air_scatters_steeper_than_the_fourth_power() -> None:
    """Dispersion adds a little: the local exponent is 4.08 at 550 nm (Penndorf 1957: 4.09)."""
    low, high = RayleighAir().coefficients([549.0, 551.0], 1.0).scattering
    assert -np.log(high / low) / np.log(551 / 549) == pytest.approx(4.08, abs=0.02)  # spread of published exponents


def test_coefficients_are_proportional_to_the_number_density() -> None:
    one, two = (RayleighAir(number_density=n).coefficients(WL, 1.0).scattering for n in (1e25, 2e25))
    np.testing.assert_allclose(two, 2 * one, rtol=1e-14)


def test_depolarisation_follows_from_the_king_factor() -> None:
    phase = RayleighAir().phase_function(WL)
    rho = np.array(phase.depolarisation.values)
    np.testing.assert_allclose((6 + 3 * rho) / (6 - 7 * rho), king_factor_bodhaine1999(WL * 1e-3, 420.0), rtol=1e-12)
    # Bates (1984): about 0.028 in the visible.
    assert rho[3] == pytest.approx(0.028, abs=0.0005)


def test_unsorted_and_repeated_wavelengths_are_fine_for_the_phase_function() -> None:
    phase = RayleighAir().phase_function([700.0, 400.0, 400.0])
    assert phase.depolarisation.wavelengths == (400.0, 700.0)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: RayleighPowerLaw(coefficient=-1e-5), ["coefficient = -1e-05", "never negative"]),
        (lambda: RayleighPowerLaw(coefficient=1e-5, wavelength="550 s"), ["wavelength", "550 s", "nm"]),
        (lambda: RayleighAir(number_density=-1.0), ["number_density = -1.0"]),
        (lambda: RayleighAir(co2_ppm=-3.0), ["co2_ppm = -3.0", "below 100000 ppm"]),
        (lambda: RayleighAir().coefficients([150.0], 1.0), ["wavelength = 150.0", "230 to 2600 nm"]),
        (lambda: RayleighAir().coefficients([550.0, 2700.0], 1.0), ["wavelength = 2700.0", "230 to 2600 nm"]),
        (
            lambda: RayleighPowerLaw(coefficient=1e-5, depolarisation=1.5).phase_function([550.0]),
            ["depolarisation = 1.5"],
        ),
    ],
)
def test_refuses(build, words) -> None:
    message = complaint(build)
    assert all(word in message for word in words), message
