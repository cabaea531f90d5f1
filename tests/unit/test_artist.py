"""Optics by looks: a half space of the medium has the colour that was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from bases import complaint
from numpy.typing import NDArray

from skyscatter import Component
from skyscatter.optics.artist import ArtistMedium, diffuse_albedo, single_scattering_albedo
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]

_X, _W = (0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(64), (1.0, 0.0), strict=True))


def half_space_albedo(omega: float) -> float:
    """Spherical albedo of a half space that scatters isotropically, from Chandrasekhar's H function.

    1 / H(mu) = sqrt(1 - omega) + omega / 2 int mu' H(mu') / (mu + mu') dmu' (Chandrasekhar 1960, chapter V, eq. 31);
    the plane albedo is 1 - H(mu) sqrt(1 - omega), the spherical one its mean over 2 mu dmu.
    """
    root, h = np.sqrt(1 - omega), np.ones_like(_X)
    for _ in range(10_000):
        new = 1 / (root + 0.5 * omega * np.sum(_W * _X * h / (_X[:, None] + _X), axis=1))
        if abs(new - h).max() < 1e-12:
            break
        h = 0.5 * (h + new)
    return float(1 - 2 * root * np.sum(_W * _X * h))


@pytest.mark.parametrize("colour", [0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
def test_half_spaces_have_the_colour(colour: float) -> None:
    """Within 0.0025: the largest error of van de Hulst's formula (65) for isotropic scattering is 0.0021."""
    omega = float(single_scattering_albedo(colour))
    assert half_space_albedo(omega) == pytest.approx(colour, abs=0.0025)


def test_the_inversion_is_the_published_one() -> None:
    """Kulla & Conty Estevez (2017) print six digits: gamma is within 2.7e-5, omega within 2 / (1 - g) times that."""
    a = np.linspace(0.0, 1.0, 101)
    for g in (0.0, 0.5, -0.3, 0.9):
        gamma = 4.09712 + 4.20863 * a - np.sqrt(9.59217 + 41.6808 * a + 17.7126 * a**2)
        printed = (1 - gamma**2) / (1 - g * gamma**2)
        np.testing.assert_allclose(single_scattering_albedo(a, g), printed, atol=5.4e-5 / (1 - g))
        np.testing.assert_allclose(diffuse_albedo(single_scattering_albedo(a, g), g), a, atol=1e-12)


def test_coefficients_and_phase_function() -> None:
    wl = np.array([400.0, 700.0])
    colour = SpectralTable(wavelengths=(400.0, 700.0), values=(0.2, 0.8))
    optics = ArtistMedium(colour=colour, distance="2 mm", g=0.4)
    scattering, absorption, emission = optics.coefficients(wl, np.nan)
    np.testing.assert_allclose(scattering + absorption, 500.0)
    np.testing.assert_allclose(scattering / 500.0, single_scattering_albedo([0.2, 0.8], 0.4))
    assert not emission.any()
    assert optics.phase_function(wl) == HenyeyGreenstein(g=0.4)
    assert ArtistMedium(colour=0.5, distance=1.0).phase_function(wl) == Isotropic()
    table = SpectralTable(wavelengths=(400.0, 700.0), values=(0.001, 0.004))
    np.testing.assert_allclose(sum(ArtistMedium(colour="snow", distance=table).coefficients(wl, 1.0)), [1000, 250])


def test_in_a_file_and_refusals() -> None:
    file = {"kind": "artist", "colour": {"wavelengths": [400, 700], "values": [0.1, 0.9]}, "distance": "2 mm"}
    component = Component(name="wax", density={"kind": "everywhere"}, optics=file)
    assert isinstance(component.optics, ArtistMedium)
    assert component.optics.distance == 0.002
    assert Component.model_validate(component.model_dump(mode="json", exclude_none=True)) == component
    assert "colour = 1.5" in complaint(lambda: ArtistMedium(colour=1.5, distance=1.0))
    assert "surface = 'snau'" in complaint(lambda: ArtistMedium(colour="snau", distance=1.0))
    assert "distance = 0.0" in complaint(lambda: ArtistMedium(colour=0.5, distance=0.0))
    assert "g = 1.0" in complaint(lambda: ArtistMedium(colour=0.5, distance=1.0, g=1.0))
