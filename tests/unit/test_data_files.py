"""Shipped tables: they are found, read, and say what their sources say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from skyscatter.datafiles import data_path, models_dir, read_table
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.spectra.surfaces import surface_albedo, surface_names

ROOT = Path(__file__).resolve().parents[2]


def test_missing_table_is_named() -> None:
    with pytest.raises(MissingDataError, match=r"nothing\.csv"):
        data_path("nothing.csv")


def test_models_stand_beside_the_data() -> None:
    assert models_dir().parent == data_path("ussa1976.csv").parent.parent


def test_tables_are_cached_and_read_only() -> None:
    table = read_table("ussa1976.csv")
    assert read_table("ussa1976.csv") is table
    with pytest.raises(ValueError, match="read-only"):
        table["altitude"][0] = 1.0


@pytest.mark.parametrize(
    "name", sorted(path.relative_to(ROOT / "data").as_posix() for path in (ROOT / "data").rglob("*.csv"))
)
def test_every_table_is_documented_and_rises(name: str) -> None:
    own = ROOT / "data" / f"{Path(name).stem}.md"
    assert own.is_file() or name in (ROOT / "data" / "README.md").read_text(encoding="utf-8")
    columns = read_table(name)
    first = next(iter(columns.values()))
    assert np.all(np.diff(first) > 0)
    assert all(np.all(np.isfinite(column)) for column in columns.values())


# Printed values of NOAA-S/T 76-1562, table I: altitude m, temperature K, pressure Pa.
USSA = [
    (5000.0, 255.676, 54048.0),
    (11000.0, 216.774, 22700.0),
    (20000.0, 216.650, 5529.3),
    (30000.0, 226.509, 1197.0),
    (50000.0, 270.650, 79.779),
    (70000.0, 219.585, 5.2209),
    (100000.0, 195.08, 3.2011e-2),
]


@pytest.mark.parametrize(("altitude", "temperature", "pressure"), USSA)
def test_standard_atmosphere_against_print(altitude: float, temperature: float, pressure: float) -> None:
    table = read_table("ussa1976.csv")
    row = np.flatnonzero(table["altitude"] == altitude)[0]
    # Rounding of the last printed digit: five digits in pressure, 0.005 K at 100 km.
    assert table["temperature"][row] == pytest.approx(temperature, abs=0.006)
    assert table["pressure"][row] == pytest.approx(pressure, rel=5e-5)


def test_standard_atmosphere_column() -> None:
    """The number column is surface pressure over weight: p / (m g), g falling with height."""
    table = read_table("ussa1976.csv")
    z, n = table["altitude"], table["number_density"]
    slope = np.log(n[:-1] / n[1:]) / np.diff(z)
    column = np.sum((n[:-1] - n[1:]) / slope)
    gravity = 9.80665 * (6356766.0 / (6356766.0 + z)) ** 2
    w = n * gravity
    weight = np.sum((w[:-1] - w[1:]) / (np.log(w[:-1] / w[1:]) / np.diff(z))) * 0.0289644 / 6.022169e23
    assert weight == pytest.approx(101325.0, rel=3e-4)  # log-linear cells of 500 m: up to 1e-4 each, one sign
    assert column == pytest.approx(2.153e29, rel=2e-3)  # Bodhaine et al. 1999: 2.1504e29 at 45 degrees' gravity


def test_standard_atmosphere_interpolates() -> None:
    """Half-way between rows, the logarithm is linear to 1e-3: compare every second row with its neighbours."""
    table = read_table("ussa1976.csv")
    z, n = table["altitude"], table["number_density"]
    grid = (z % 1000 == 0) & (z < 86e3)
    predicted = np.exp(np.interp(z, z[grid], np.log(n[grid])))
    smooth = (z % 1000 == 500) & (z < 85e3)
    kinks = [11019.0, 20063.0, 32162.0, 47350.0, 51413.0, 71802.0]
    for kink in kinks:  # cells with a kink inside are the reason for the extra rows
        smooth &= np.abs(z - kink) > 1000.0
    # Doubling the step makes the error four times larger, so this bounds the shipped grid by 2.5e-4.
    assert np.max(np.abs(predicted[smooth] / n[smooth] - 1)) < 1e-3


def test_standard_atmosphere_against_afgl(reference: Path) -> None:
    """AFGL's U.S. Standard profile follows the same standard, rounded to about three digits."""
    afgl = np.loadtxt(reference / "atmosphere_profiles" / "afglus.dat")
    z, pressure = afgl[:, 0] * 1e3, afgl[:, 1] * 100
    ours = np.exp(np.interp(z, read_table("ussa1976.csv")["altitude"], np.log(read_table("ussa1976.csv")["pressure"])))
    low = z <= 80e3
    assert np.max(np.abs(ours[low] / pressure[low] - 1)) < 0.01  # its printed digits, and small known differences


def test_surfaces() -> None:
    assert {"vegetation", "sand", "water", "snow", "mars"} <= set(surface_names())
    for name in surface_names():
        albedo = surface_albedo(name, np.arange(250.0, 1200.0, 7.0))
        assert np.all((albedo >= 0) & (albedo <= 1))
    green, red, infrared = surface_albedo("vegetation", [540.0, 650.0, 800.0])
    assert red < green < infrared  # chlorophyll: green hump, red edge
    assert surface_albedo("water", [800.0])[0] == 0.0
    assert surface_albedo("snow", [200.0]) == surface_albedo("snow", [300.0])  # constant beyond the ends


def test_unknown_surface_lists_the_known() -> None:
    with pytest.raises(DomainError, match="vegetation"):
        surface_albedo("cheese", [500.0])


def test_every_licence_of_shipped_data_is_told() -> None:
    """Who has compiled a table under a licence that must be passed on stands in NOTICES, with that table."""
    notices = (ROOT / "NOTICES").read_text(encoding="utf-8")
    told = {title for title in re.findall(r"^== (.*) ==$", notices, re.MULTILINE)}
    rows = [line.split("|") for line in (ROOT / "data" / "README.md").read_text(encoding="utf-8").splitlines()]
    rows = [row for row in rows if len(row) > 5 and re.search("BSD|MIT|Apache", row[4])]
    assert len(rows) >= 8
    for row in rows:
        (source,) = re.findall(r"(?:as shipped by|data in|compiled in) ([\w-]+)", row[4])
        for file in re.findall("`([^`]+)`", row[1]):
            assert any(source in title and file in title for title in told), (source, file)
    licence = (ROOT / "data" / "cie1931.md").read_text(encoding="utf-8")
    assert "colour-science is distributed under the BSD-3-Clause" in licence
    assert any("colour-science" in title and "cie1931.csv" in title for title in told)
