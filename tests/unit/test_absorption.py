"""Absorbers: cross sections, amounts, tables of the user's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skyscatter.errors import DomainError
from skyscatter.optics.absorption import (
    DOBSON_UNIT,
    GasAbsorption,
    TabulatedAbsorption,
    cross_section,
    temperature_range,
)
from skyscatter.spectra.table import SpectralTable


def test_chappuis_peak() -> None:
    wl = np.arange(450.0, 750.0, 1.0)
    sigma = cross_section("o3", wl, 228.0)
    assert wl[np.argmax(sigma)] == pytest.approx(602.0, abs=2.0)
    assert sigma.max() == pytest.approx(5.2e-25, rel=0.02)  # 5.1-5.2e-21 cm2 in the literature


def test_ozone_against_molina_and_molina(reference: Path) -> None:
    nm, c0, c1, c2 = np.loadtxt(reference / "ozone_cross_section" / "crs_o3_mol_cf.dat", comments="#", unpack=True)
    for temperature in (228.0, 243.0, 295.0):
        dt = temperature - 273.13
        theirs = (c0 + c1 * dt + c2 * dt * dt) * 1e-24
        # Hartley band: smooth, laboratories agree to 2-3 %; the wing beyond 300 nm is as sensitive to 0.1 nm.
        inside = (nm > 252) & (nm < 300)
        np.testing.assert_allclose(cross_section("o3", nm[inside], temperature), theirs[inside], rtol=0.04)


def test_huggins_bands_weaken_in_the_cold() -> None:
    wl = np.arange(310.0, 340.0, 1.0)
    cold, warm = (cross_section("o3", wl, t).mean() for t in (218.0, 295.0))
    assert 0.6 < cold / warm < 0.9


def test_temperature_is_linear_between_columns() -> None:
    wl = [315.0, 325.0]
    middle = 0.5 * (cross_section("o3", wl, 228.0) + cross_section("o3", wl, 243.0))
    np.testing.assert_allclose(cross_section("o3", wl, 235.5), middle, rtol=1e-12)  # rounding


def test_no2_against_jpl() -> None:
    # JPL 06-2: 400 nm, 294 K and 220 K.
    assert cross_section("no2", [400.0], 294.0)[0] == pytest.approx(6.44e-23)
    assert cross_section("no2", [400.0], 220.0)[0] == pytest.approx(6.40e-23)


def test_column_makes_the_optical_depth() -> None:
    gas = GasAbsorption(species="o3", column_du=300.0)
    wl = [320.0, 602.0]
    column = 11000.0
    scattering, absorption, emission = gas.coefficients(wl, column)
    np.testing.assert_allclose(absorption * column, 300 * DOBSON_UNIT * cross_section("o3", wl, 228.0), rtol=1e-12)
    assert not np.any(scattering)
    assert not np.any(emission)
    # Chappuis maximum for 300 DU: about 0.042.
    assert absorption[1] * column == pytest.approx(0.042, rel=0.02)


def test_three_ways_to_say_how_much() -> None:
    by_du = GasAbsorption(species="no2", column_du=0.2, temperature=230.0)
    by_number = GasAbsorption(species="no2", column_m2=0.2 * DOBSON_UNIT, temperature=230.0)
    by_density = GasAbsorption(species="no2", number_density=0.2 * DOBSON_UNIT / 5000.0, temperature=230.0)
    expected = by_du.coefficients([400.0], 5000.0).absorption
    for other in (by_number, by_density):
        np.testing.assert_allclose(other.coefficients([400.0], 5000.0).absorption, expected, rtol=1e-12)


def test_phase_function_is_isotropic() -> None:
    value = GasAbsorption(species="o3", column_du=1.0).phase_function([500.0]).value([-0.5, 1.0], [500.0])
    np.testing.assert_allclose(value, 1 / (4 * np.pi), rtol=1e-12)


def test_ranges() -> None:
    assert temperature_range("o3")[0] == 218.0
    assert cross_section("o3", [900.0], 228.0)[0] == 0.0
    with pytest.raises(DomainError, match="250"):
        cross_section("o3", [240.0], 228.0)
    with pytest.raises(DomainError, match="218 to 295"):
        cross_section("o3", [500.0], 150.0)
    with pytest.raises(DomainError, match="o3, no2"):
        cross_section("so2", [500.0], 250.0)
    with pytest.raises(DomainError, match="column"):
        GasAbsorption(species="o3", column_du=300.0).coefficients([500.0], 0.0)


@pytest.mark.parametrize(
    "fields",
    [
        {"species": "o3"},
        {"species": "o3", "column_du": 300.0, "number_density": 1e18},
        {"species": "o3", "column_du": -1.0},
        {"species": "o3", "column_du": 300.0, "temperature": 100.0},
        {"species": "h2o", "column_du": 300.0},
        {"species": "o3", "column_du": 300.0, "colour": "blue"},
    ],
)
def test_gas_refuses(fields: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"exactly one|never negative|tabulated|'o3' or 'no2'|no such field"):
        GasAbsorption.model_validate(fields)


def test_gas_is_written_back() -> None:
    gas = GasAbsorption(species="o3", column_du=300.0)
    assert GasAbsorption.model_validate(gas.model_dump()) == gas


def test_inline_tables() -> None:
    table = SpectralTable(wavelengths=(400.0, 600.0), values=(1e-25, 3e-25))
    by_section = TabulatedAbsorption(cross_section=table, column_m2=2e24)
    np.testing.assert_allclose(by_section.coefficients([500.0], 1000.0).absorption, [4e-4], rtol=1e-12)
    by_coefficient = TabulatedAbsorption(coefficient=2e-5)
    np.testing.assert_array_equal(by_coefficient.coefficients([500.0, 600.0], 1000.0).absorption, [2e-5, 2e-5])


def test_file(tmp_path: Path) -> None:
    path = tmp_path / "gas.csv"
    path.write_text("# remark\nwavelength_nm,cross_section_m2\n400,1e-25\n600,3e-25\n")
    model = TabulatedAbsorption(file=str(path), number_density=1e20)
    np.testing.assert_allclose(model.coefficients([450.0], 1.0).absorption, [1.5e-5], rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    ["", "a,b\n1,2\n", "wavelength_nm,coefficient_per_m\n500,x\n", "wavelength_nm,coefficient_per_m\n5,1\n5,1\n"],
)
def test_bad_file_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"bad\.csv"):
        TabulatedAbsorption(file=str(path))


def test_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"absent\.csv"):
        TabulatedAbsorption(file=str(tmp_path / "absent.csv"))


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"coefficient": 1.0, "cross_section": 1.0},
        {"cross_section": 1e-25},
        {"coefficient": 1e-5, "column_du": 3.0},
        {"coefficient": -1e-5},
    ],
)
def test_table_refuses(fields: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"exactly one|go with|negative"):
        TabulatedAbsorption.model_validate(fields)
