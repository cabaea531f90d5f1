"""The Sun: spectrum, cell means, black bodies, limb darkening."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.solar import (
    SOLAR_RADIUS,
    blackbody_irradiance,
    disk_mean,
    limb_darkening,
    solar_irradiance,
)


def test_single_wavelength_is_the_table() -> None:
    assert solar_irradiance([550.0])[0] == 1.863  # ASTM G173-03
    assert solar_irradiance(400.0).shape == (1,)


def test_total_irradiance() -> None:
    wl = np.arange(280.5, 3999.6, 1.0)
    # ASTM G173 extraterrestrial integrates to 1348 W m-2 from 280 to 4000 nm (its printed total).
    assert np.sum(solar_irradiance(wl)) == pytest.approx(1348.0, rel=2e-3)


@pytest.mark.parametrize("step", [2.5, 5.0, 12.9])
def test_cells_keep_the_energy(step: float) -> None:
    wl = np.arange(385.0, 775.0, step)
    fine = np.arange(wl[0] - step / 2, wl[-1] + step / 2, 0.05)
    expected = np.trapezoid(solar_irradiance(fine, band="point"), fine)
    # The fine trapezoid cuts corners at the kinks of the table: (0.05 nm)^2 over features of 1 nm.
    assert np.sum(solar_irradiance(wl)) * step == pytest.approx(expected, rel=2e-4)


def test_cells_in_any_order_and_uneven() -> None:
    wl = np.array([500.0, 420.0, 433.0, 610.0])
    order = np.argsort(wl)
    np.testing.assert_array_equal(solar_irradiance(wl)[order], solar_irradiance(wl[order]))
    # The cell of 433 nm reaches from 426.5 to 466.5 nm.
    fine = np.linspace(426.5, 466.5, 4001)  # holds every node of the 1 nm table: the trapezoid is exact
    expected = np.trapezoid(solar_irradiance(fine, band="point"), fine) / 40
    assert solar_irradiance(wl)[2] == pytest.approx(expected, rel=1e-12)  # rounding


def test_fixed_band_does_not_depend_on_the_grid() -> None:
    both = solar_irradiance([500.0, 600.0], band=10.0)
    assert both[0] == solar_irradiance([500.0], band=10.0)[0]


@pytest.mark.parametrize(
    ("wl", "options", "word"),
    [
        ([200.0], {}, "280"),
        ([500.0, 500.0], {}, "twice"),
        ([500.0], {"band": -1.0}, "band"),
        ([500.0], {"band": "wide"}, "band"),
        ([500.0], {"name": "sirius"}, "astm-g173"),
    ],
)
def test_wrong_input(wl: list[float], options: dict[str, object], word: str) -> None:
    with pytest.raises(DomainError, match=word):
        solar_irradiance(wl, **options)  # type: ignore[arg-type]


def test_against_gueymard_2004(reference: Path) -> None:
    nm, milliwatt = np.loadtxt(reference / "solar_spectra" / "NewGuey2003.dat", comments="#", unpack=True)[:2]
    wl = np.arange(400.0, 780.0, 20.0)
    fine = np.arange(390.0, 790.0, 0.5)
    theirs = np.interp(fine, nm, milliwatt) * 1e-3
    means = np.array([theirs[(fine >= w - 10) & (fine < w + 10)].mean() for w in wl])
    # Absolute spectra of the Sun differ: this pair by up to 4 % (G173 is lower in the blue), by 1 % on the whole.
    ours = solar_irradiance(wl, band=20.0)
    np.testing.assert_allclose(ours, means, rtol=0.05)
    assert ours.mean() == pytest.approx(means.mean(), rel=0.015)


def test_table_is_astm_g173(reference: Path) -> None:
    """An independent copy of the standard, row by row: the table keeps all printed digits."""
    nm, irradiance = np.loadtxt(reference / "clear_sky_kider" / "astm-g173.txt", unpack=True)[:2]
    np.testing.assert_allclose(solar_irradiance(nm, band="point"), irradiance, rtol=1e-5)


def test_blackbody_obeys_stefan_boltzmann_and_wien() -> None:
    wl = np.geomspace(50.0, 3e5, 20001)
    star = blackbody_irradiance(wl, 5772.0, SOLAR_RADIUS, 149597870700.0)
    expected = 5.670374419e-8 * 5772.0**4 * (SOLAR_RADIUS / 149597870700.0) ** 2
    assert np.trapezoid(star, wl) == pytest.approx(expected, rel=1e-5)  # light beyond 0.3 mm: 1e-6
    assert wl[np.argmax(star)] == pytest.approx(2.897771955e6 / 5772.0, rel=1e-3)  # grid step 4e-4
    assert blackbody_irradiance([1.0], 3000.0, 1.0, 2.0)[0] == 0.0  # no overflow in the Wien tail


def test_blackbody_refuses_to_stand_inside_the_star() -> None:
    with pytest.raises(DomainError, match="distance_m"):
        blackbody_irradiance([500.0], 5000.0, 2.0, 1.0)


def test_limb_darkening_disk_mean_against_the_published_column() -> None:
    table = read_table("solar_limb_darkening.csv")
    # Four printed digits; the table's own mean is over the measurements, not over the fit.
    np.testing.assert_allclose(disk_mean(table["wavelength_nm"]), table["disk_mean"], atol=6e-4)


def test_disk_mean_is_the_integral() -> None:
    for wl in (310.0, 555.0, 1500.0):
        expected = quad(lambda mu, w=wl: 2 * mu * limb_darkening(mu, [w])[0], 0, 1)[0]
        assert disk_mean([wl])[0] == pytest.approx(expected, rel=1e-12)  # a polynomial


def test_limb_darkening_shape_and_sense() -> None:
    mu = np.linspace(0, 1, 21)
    value = limb_darkening(mu, [400.0, 550.0, 900.0])
    assert value.shape == (21, 3)
    np.testing.assert_allclose(value[-1], 1.0, rtol=1e-12)  # normalised to the centre; rounding
    assert np.all(np.diff(value[1:], axis=0) > 0)  # brightens inwards
    assert np.all(np.diff(value[1:-1], axis=1) > 0)  # the limb is reddened
    with pytest.raises(DomainError, match="mu"):
        limb_darkening(1.2, [500.0])
