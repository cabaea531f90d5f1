"""Particles given by numbers: optical depth or extinction, Angstrom law, albedo."""

from __future__ import annotations

import numpy as np
import pytest
from bases import complaint

from skyscatter import Component, Medium, Scene, optical_depth
from skyscatter.media.fields import Exponential, Gaussian, UsStandard1976
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.spectra.table import SpectralTable

WL = np.array([400.0, 550.0, 800.0])
EARTH = 6371e3


def test_angstrom_law_and_albedo() -> None:
    model = Particles(
        extinction=1e-5, angstrom_exponent=1.3, wavelength="0.55 um", single_scattering_albedo=0.9, phase=Isotropic()
    )
    scattering, absorption, emission = model.coefficients(WL, 123.0)
    expected = 1e-5 * (WL / 550.0) ** -1.3
    np.testing.assert_allclose(scattering, 0.9 * expected, rtol=1e-14)  # rounding
    np.testing.assert_allclose(absorption, 0.1 * expected, rtol=1e-14)
    assert not emission.any()


def test_tables_over_wavelength() -> None:
    table = SpectralTable(wavelengths=(400.0, 800.0), values=(0.2, 0.1))
    albedo = SpectralTable(wavelengths=(400.0, 800.0), values=(1.0, 0.5))
    model = Particles(optical_depth=table, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=0.7))
    scattering, absorption, _ = model.coefficients([400.0, 600.0, 800.0], 1000.0)
    np.testing.assert_allclose(scattering + absorption, np.array([0.2, 0.15, 0.1]) / 1000, rtol=1e-14)
    np.testing.assert_allclose(scattering / (scattering + absorption), [1.0, 0.75, 0.5], rtol=1e-14)


@pytest.mark.parametrize(
    "field", [Exponential(scale_height=2e3, top=30e3), Gaussian(peak=5e3, width=2e3), UsStandard1976()]
)
def test_optical_depth_is_what_was_asked_for(field) -> None:
    """Whatever the density field, its vertical optical depth is the stated one."""
    optics = Particles(optical_depth=0.3, angstrom_exponent=1.0, phase=Isotropic())
    medium = Medium(planet_radius=EARTH, components=(Component(name="haze", density=field, optics=optics),))
    ground = np.array([0, 0, EARTH])
    tau = optical_depth(Scene(medium=medium), ground, np.add(ground, [0, 0, 2e5]), WL)
    np.testing.assert_allclose(tau, 0.3 * 550.0 / WL, rtol=1e-9)  # accuracy of columns


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, ["optical_depth", "exactly one"]),
        ({"optical_depth": 0.1, "extinction": 1e-5}, ["optical_depth = 0.1", "exactly one"]),
        ({"optical_depth": -0.1}, ["optical_depth = -0.1", "never negative"]),
        ({"extinction": -1e-5}, ["extinction = -1e-05", "never negative"]),
        (
            {"optical_depth": 0.1, "single_scattering_albedo": 1.2},
            ["single_scattering_albedo = 1.2", "between 0 and 1"],
        ),
        ({"optical_depth": 0.1, "single_scattering_albedo": -0.2}, ["single_scattering_albedo = -0.2"]),
        ({"optical_depth": 0.1, "size": 3}, ["size = 3", "no such field"]),
        ({"optical_depth": float("nan")}, ["optical_depth"]),
        (
            {"optical_depth": SpectralTable(wavelengths=(400, 700), values=(0.5, 0.2)), "angstrom_exponent": 1.2},
            ["angstrom_exponent = 1.2", "table"],
        ),
    ],
)
def test_refuses(arguments, words) -> None:
    message = complaint(lambda: Particles(phase=Isotropic(), **arguments))
    assert all(word in message for word in words), message
