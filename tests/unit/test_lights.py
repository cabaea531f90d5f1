"""Stars, parallel light and the light of the Galaxy, against closed forms and published totals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bases import complaint

from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK, SOLAR_LUMINOSITY
from skyscatter.lights import ParallelLight, PointStar, interstellar_radiation
from skyscatter.media.ionised import LYMAN_LIMIT
from skyscatter.scene import AU
from skyscatter.spectra.solar import SOLAR_RADIUS, solar_irradiance
from skyscatter.spectra.table import SpectralTable
from skyscatter.units import PARSEC


def planck(wl: float, temperature: float) -> float:
    """Radiance [W m-2 sr-1 nm-1]."""
    m = wl * 1e-9
    return 2 * PLANCK * LIGHT**2 / m**5 / np.expm1(PLANCK * LIGHT / (m * BOLTZMANN * temperature)) * 1e-9


@pytest.mark.parametrize("temperature", [3000.0, 12000.0, 40000.0])
def test_black_body_has_its_luminosity(temperature: float) -> None:
    star = PointStar(luminosity=900.0, temperature=temperature)
    wl = np.geomspace(1e5 / temperature, 3e9 / temperature, 20001)  # x = h c / lambda k T from 144 to 0.005
    total = np.trapezoid(star.spectral_luminosity(wl) * wl, np.log(wl))
    assert total == pytest.approx(900 * SOLAR_LUMINOSITY, rel=1e-6)  # trapezoids of a smooth bump; tail below 1e-7
    assert star.luminosity_W() == pytest.approx(900 * SOLAR_LUMINOSITY, rel=1e-12)


def test_the_sun_by_radius_and_by_luminosity() -> None:
    """The nominal Sun has 5772 K by definition (IAU 2015 resolution B3, to its four digits)."""
    by_radius = PointStar(radius=SOLAR_RADIUS, temperature=5772.0)
    by_luminosity = PointStar(luminosity=1.0, temperature=5772.0)
    assert by_luminosity.radius_m() == pytest.approx(SOLAR_RADIUS, rel=2e-4)
    wl = np.array([450.0, 550.0, 1500.0])
    ours = by_radius.spectral_luminosity(wl)
    np.testing.assert_allclose(ours, 4 * np.pi**2 * SOLAR_RADIUS**2 * planck(wl, 5772.0), rtol=1e-12)
    sphere = 4 * np.pi * AU**2
    # The nominal solar irradiance, 1361 W m-2 by the same resolution, to its four digits.
    assert by_luminosity.luminosity_W() / sphere == pytest.approx(1361.0, rel=3e-4)
    # The Sun is no black body: fainter by a few per cent of its light where lines crowd, and so brighter elsewhere.  In
    # the red, between lines, both are alike.
    wl = np.array([700.0, 750.0, 800.0])
    np.testing.assert_allclose(
        by_luminosity.spectral_luminosity(wl) / sphere, solar_irradiance(wl, band=50.0), rtol=0.02
    )
    green = by_luminosity.spectral_luminosity([500.0]) / sphere / solar_irradiance([500.0], band=50.0)
    assert 0.91 < green[0] < 0.95


def test_magnitude() -> None:
    star = PointStar(magnitude_v=7.0, temperature=17000.0)
    distance = 360 * PARSEC
    irradiance = star.spectral_luminosity([550.0, 440.0], distance) / (4 * np.pi * distance**2)
    assert irradiance[0] == pytest.approx(3.631e-11 * 10 ** (-0.4 * 7.0), rel=1e-12)
    assert irradiance[1] / irradiance[0] == pytest.approx(planck(440.0, 17000.0) / planck(550.0, 17000.0), rel=1e-12)
    brighter = star.model_copy(update={"magnitude_v": 2.0}).luminosity_W(distance)
    assert brighter == pytest.approx(100 * star.luminosity_W(distance), rel=1e-12)
    assert "distance = None: star has a magnitude" in complaint(lambda: star.spectral_luminosity([550.0]))


def test_absolute_magnitude_of_the_sun() -> None:
    """M_V = 4.81 (Willmer 2018, ApJS 236, 47): a black body of one solar luminosity comes within 0.1 mag."""
    distance = 10 * PARSEC
    at_ten = PointStar(luminosity=1.0, temperature=5772.0).spectral_luminosity([550.0]) / (4 * np.pi * distance**2)
    assert -2.5 * np.log10(at_ten[0] / 3.631e-11) == pytest.approx(4.81, abs=0.1)


def test_tabulated_spectrum() -> None:
    table = SpectralTable(wavelengths=(50.0, 80.0, 600.0), values=(1e27, 3e27, 2e27))
    star = PointStar(spectrum=table, position=("1 pc", 0, "-2 pc"))
    assert star.position == (PARSEC, 0.0, -2 * PARSEC)
    np.testing.assert_allclose(star.spectral_luminosity([65.0, 340.0]), [2e27, 2.5e27], rtol=1e-12)
    wl = np.linspace(50.0, LYMAN_LIMIT, 200001)
    photons = np.trapezoid(np.interp(wl, table.wavelengths, table.values) * wl, wl) * 1e-9 / (PLANCK * LIGHT)
    assert star.ionising_photons() == pytest.approx(photons, rel=1e-8)  # trapezoids across one kink
    optical = PointStar(spectrum=SpectralTable(wavelengths=(300.0, 900.0), values=(1.0, 1.0)))
    assert "begins beyond 91 nm" in complaint(optical.ionising_photons)
    assert "no black body" in complaint(star.luminosity_W)


def test_ionising_photons_of_a_black_body() -> None:
    star = PointStar(luminosity=2e5, temperature=39000.0)
    wl = np.linspace(4.0, LYMAN_LIMIT, 40001)
    photons = np.trapezoid(star.spectral_luminosity(wl) * wl, wl) * 1e-9 / (PLANCK * LIGHT)
    assert star.ionising_photons() == pytest.approx(photons, rel=1e-6)  # trapezoids


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({}, "exactly one of luminosity"),
        ({"luminosity": 1.0, "radius": 1.0, "temperature": 5e3}, "luminosity, radius"),
        ({"luminosity": 1.0}, "temperature = None"),
        ({"luminosity": -1.0, "temperature": 5e3}, "luminosity = -1.0"),
        ({"luminosity": 1.0, "temperature": 0.0}, "temperature = 0.0"),
        ({"spectrum": {"wavelengths": [500.0], "values": [1.0]}, "temperature": 5e3}, "temperature = 5000.0"),
        ({"spectrum": {"wavelengths": [500.0], "values": [-1.0]}}, "spectrum = -1.0"),
        ({"luminosity": 1.0, "temperature": 5e3, "colour": "red"}, "no such field"),
    ],
)
def test_star_refuses(fields: dict[str, Any], word: str) -> None:
    assert word in complaint(lambda: PointStar(**fields))


def test_star_is_written_back() -> None:
    star = PointStar(name="HD 200775", luminosity=1500.0, temperature=17000.0, position=("0.1 pc", 0, 0))
    again = PointStar.model_validate(star.model_dump(mode="json", exclude_none=True))
    assert again == star
    assert hash(again) == hash(star)


def test_parallel_light() -> None:
    by_angle = ParallelLight(azimuth_deg=90.0, elevation_deg=30.0, irradiance=2.0)
    np.testing.assert_allclose(by_angle.towards, [np.sqrt(0.75), 0, 0.5], atol=1e-15)
    by_vector = ParallelLight(direction=(0.0, 3.0, -4.0), temperature=12000.0, dilution=1e-14)
    np.testing.assert_allclose(by_vector.towards, [0, 0.6, -0.8], atol=1e-15)
    np.testing.assert_array_equal(by_angle.spectral_irradiance([400.0, 500.0]), [2.0, 2.0])
    expected = [1e-14 * np.pi * planck(wl, 12000.0) for wl in (400.0, 500.0)]
    np.testing.assert_allclose(by_vector.spectral_irradiance([400.0, 500.0]), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"irradiance": 1.0}, "either direction"),
        ({"irradiance": 1.0, "azimuth_deg": 1.0}, "either direction"),
        ({"irradiance": 1.0, "direction": (0, 0, 1), "azimuth_deg": 1.0, "elevation_deg": 1.0}, "either direction"),
        ({"irradiance": 1.0, "direction": (0, 0, 0)}, "must not be zero"),
        ({"irradiance": 1.0, "azimuth_deg": 1.0, "elevation_deg": 91.0}, "elevation_deg = 91.0"),
        ({"direction": (0, 0, 1)}, "either irradiance"),
        ({"direction": (0, 0, 1), "temperature": 1e4}, "either irradiance"),
        ({"direction": (0, 0, 1), "temperature": 1e4, "dilution": 2.0}, "dilution = 2.0"),
        ({"direction": (0, 0, 1), "irradiance": -1.0}, "irradiance = -1.0"),
    ],
)
def test_parallel_light_refuses(fields: dict[str, Any], word: str) -> None:
    assert word in complaint(lambda: ParallelLight(**fields))


def test_energy_density_of_starlight() -> None:
    """Draine (2011), table 12.1: black bodies 4.29e-13, 3.19e-13, 2.29e-13 and 912 to 2460 A 7.11e-14 erg cm-3."""
    wl = np.geomspace(91.2, 1e5, 60001)
    density = 4 * np.pi / LIGHT * interstellar_radiation(wl) * 10.0  # [erg cm-3 nm-1]
    young = wl < 246.0
    assert np.trapezoid(density[young], wl[young]) == pytest.approx(7.11e-14, rel=0.01)  # three digits
    old = np.trapezoid(density[~young], wl[~young])
    # The black bodies' totals count what they would shine below 246 nm, some 1 % of the hottest.
    assert old == pytest.approx(4.29e-13 + 3.19e-13 + 2.29e-13, rel=0.01)


#: Mathis, Mezger & Panagia (1983), 10 kpc: wavelength [nm], 4 pi J [1e-2 erg cm-2 s-1 micron-1].
MATHIS = [(200.0, 1.04), (216.0, 0.917), (230.0, 0.825), (435.0, 1.50), (550.0, 1.57), (700.0, 1.53), (1200.0, 0.926)]


@pytest.mark.parametrize(("wavelength", "printed"), MATHIS)
def test_starlight_as_first_published(wavelength: float, printed: float) -> None:
    radiance = float(interstellar_radiation([wavelength])[0])
    if wavelength > 246.0:  # Draine raised the dilutions of the cool stars from 4e-13 and 1e-13
        radiance -= 3e-13 * planck(wavelength, 3000.0) + 0.65e-13 * planck(wavelength, 4000.0)
    assert 4 * np.pi * radiance * 1e8 == pytest.approx(printed, rel=0.015)  # three digits, temperatures of two


def test_starlight_ends_and_joins() -> None:
    assert interstellar_radiation([91.0])[0] == 0.0
    # The power laws meet to the digits of their factors; the step to the black bodies is the published fit's own.
    for wavelength, step in ((110.0, 0.01), (134.0, 0.01), (246.0, 0.2)):
        below, above = interstellar_radiation([wavelength - 1e-6, wavelength + 1e-6])
        assert below == pytest.approx(above, rel=step)
