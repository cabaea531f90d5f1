"""Profiles, aerosols and lamps from CSV and netCDF files that a model names."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from skyscatter import SpectralTable, load_model
from skyscatter.cli.main import main
from skyscatter.errors import TableFileError
from skyscatter.media.fields import Tabulated
from skyscatter.models.files import parse_model
from skyscatter.optics.mie import LogNormalMode, MieAerosol, SizeTable
from skyscatter.optics.phase import HenyeyGreenstein, TabulatedPhase
from skyscatter.surfaces.lamps import PointLamp
from skyscatter.surfaces.lobes import TabulatedLobe
from skyscatter.tablefile import Wanted, read_columns
from skyscatter.units import LENGTH, NUMBER

PROFILE = "# a sounding\naltitude [km],density [cm-3],temperature [K]\n10,1e18,220\n5,5e18,250\n0,2e19,288\n"
AEROSOL = "wavelength [um];ext (km-1);ssa;g\n0.4;0.2;95%;0.7\n0.7;0.1;0.9;0.6\n"
MODEL = """
name = "x"
planet = { name = "x", radius = "6371 km" }
[[components]]
name = "air"
density = { kind = "tabulated", file = "data/profile.csv" }
optics = { kind = "rayleigh-air" }
[[components]]
name = "haze"
density = { kind = "exponential", scale_height = "2 km" }
[components.optics]
kind = "particles"
extinction = { file = "data/aerosol.csv", column = "ext" }
single_scattering_albedo = { file = "data/aerosol.csv", column = "ssa" }
phase = { kind = "henyey-greenstein", g = { file = "data/aerosol.csv", column = "g" } }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "profile.csv").write_text(PROFILE, encoding="utf-8")
    (tmp_path / "data" / "aerosol.csv").write_text(AEROSOL.replace("95%", "0.95"), encoding="utf-8")
    (tmp_path / "x.toml").write_text(MODEL, encoding="utf-8")
    return tmp_path


def test_files_count_from_the_model_and_the_model_keeps_their_numbers(folder: Path, monkeypatch: Any) -> None:
    model = load_model(folder / "x.toml")
    air, haze = model.components
    assert air.density == Tabulated(altitudes=(0, 5e3, 10e3), densities=(2e19, 5e18, 1e18))
    assert haze.optics.extinction == SpectralTable(wavelengths=(400, 700), values=(2e-4, 1e-4))
    assert haze.optics.single_scattering_albedo.values == (0.95, 0.9)
    assert haze.optics.phase.g.values == (0.7, 0.6)
    monkeypatch.chdir(folder)
    assert load_model("x.toml") == model
    assert parse_model(tomllib.loads(model.to_toml()), "x") == model


def test_netcdf_says_the_same(tmp_path: Path) -> None:
    data = xarray.Dataset(
        {"o3": ("level", np.array([1.0, 3.0, 2.0]), {"units": "m-3"}), "no2": ("level", np.ones(3))},
        coords={"height": ("level", np.array([30.0, 20.0, 10.0]), {"units": "km"})},
    )
    data.to_netcdf(tmp_path / "profile.nc")
    made = Tabulated(file=str(tmp_path / "profile.nc"), column="o3")
    assert made == Tabulated(altitudes=(10e3, 20e3, 30e3), densities=(2, 3, 1))
    with pytest.raises(ValueError, match=r"2 columns that densities could be \(o3, no2\); .* column = \"o3\""):
        Tabulated(file=str(tmp_path / "profile.nc"))


def test_sizes_and_indices_make_the_aerosol_of_their_formulas(tmp_path: Path) -> None:
    radius = np.geomspace(0.01, 2.0, 300)
    number = np.exp(-0.5 * (np.log(radius / 0.1) / np.log(1.6)) ** 2)
    rows = "\n".join(f"{r!r},{n!r}" for r, n in zip(radius.tolist(), number.tolist(), strict=True))
    (tmp_path / "sizes.csv").write_text(f"radius [um],dn_dlnr [cm-3]\n{rows}\n", encoding="utf-8")
    (tmp_path / "index.csv").write_text("wavelength_nm,n,k\n400,1.5,0.01\n800,1.5,0.01\n", encoding="utf-8")
    index = str(tmp_path / "index.csv")
    table = MieAerosol(
        modes=[{"file": str(tmp_path / "sizes.csv")}],
        refractive_index_real={"file": index, "column": "n"},
        refractive_index_imag={"file": index, "column": "k"},
        number_density="1000 cm-3",
    )
    assert isinstance(table.modes[0], SizeTable)
    mode = LogNormalMode(median_radius="0.1 um", geometric_standard_deviation=1.6)
    law = MieAerosol(modes=[mode], refractive_index_real=1.5, refractive_index_imag=0.01, number_density="1000 cm-3")
    for measured, expected in zip(table.optical_properties([550.0]), law.optical_properties([550.0]), strict=True):
        np.testing.assert_allclose(measured, expected, rtol=5e-4)  # the quadratures' steps of 0.01 in ln r


def test_lamps_take_spectra_and_lobes_from_files(tmp_path: Path) -> None:
    (tmp_path / "lamp.csv").write_text("wavelength [nm],power [mW nm-1]\n400,1\n500,3\n700,2\n", encoding="utf-8")
    (tmp_path / "lobe.csv").write_text("angle [deg]\tintensity [cd]\n0\t100\n45\t50\n90\t0\n", encoding="utf-8")
    lamp = PointLamp(
        position=(0, 0, 0), lumens=800, spectrum={"file": str(tmp_path / "lamp.csv")},
        lobe={"kind": "tabulated", "file": str(tmp_path / "lobe.csv")},
    )  # fmt: skip
    assert lamp.spectrum_table.values == (1, 3, 2)
    assert lamp.lobe == TabulatedLobe(angles_deg=(0, 45, 90), intensities=(100, 50, 0))
    power = PointLamp(position=(0, 0, 0), power={"file": str(tmp_path / "lamp.csv")})
    assert power.power == SpectralTable(wavelengths=(400, 500, 700), values=(1e-3, 3e-3, 2e-3))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PROFILE.replace("5e18", "much"), [", line 4, column 2 (density): 'much' is not a finite number"]),
        (PROFILE.replace("5e18", "nan"), [", line 4, column 2 (density): 'nan' is not a finite number"]),
        (PROFILE.replace("5e18", "-5e18"), [", line 4, column 2 (density): -5e18: is never negative"]),
        (PROFILE.replace("\n5,", "\n10,"), [", line 4, column 1 (altitude): 10 breaks the order"]),
        (PROFILE.replace("\n5,", "\n50,"), [", line 5, column 1 (altitude): 0 breaks the order"]),
        (PROFILE.replace("[km]", "[K]"), [", column altitude: the unit K is none of a length; give one of m, km"]),
        (
            PROFILE.replace(" [km]", ""),
            ["column altitude", 'not say the unit of altitude; write it there, such as "altitude [m]"'],
        ),
        (PROFILE.replace("[km]", "[1]"), ["does not say the unit of altitude"]),
        (PROFILE.replace("5e18,250", "5e18"), [", line 4: has 2 cells, the header 3"]),
        (PROFILE.replace("density", "altitude"), [", line 2, column 2 (altitude): each column needs a name"]),
        (PROFILE.replace("density", "o3"), ["2 columns that densities could be (o3, temperature)", 'column = "o3"']),
        (PROFILE.replace("altitude", "lat"), ["has no column altitude or height or z; there are lat, density"]),
        ("altitude\n", ["needs a header line"]),
    ],
)
def test_errors_name_file_line_and_column(folder: Path, text: str, words: list[str], capsys: Any) -> None:
    (folder / "data" / "profile.csv").write_text(text, encoding="utf-8")
    assert main(["models", "check", str(folder / "x.toml")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert f"x.toml: components.0 (air).density: {folder / 'data' / 'profile.csv'}" in lines[0]
    assert all(word in lines[0] for word in words), lines[0]


def test_what_is_no_file_is_said(folder: Path, capsys: Any) -> None:
    (folder / "x.toml").write_text(MODEL.replace("profile.csv", "absent.csv").replace('"ssa"', '"sssa"'))
    assert main(["models", "check", str(folder / "x.toml")]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert "absent.csv: cannot be read (No such file or directory); check the path" in first
    assert "aerosol.csv: has no column sssa; did you mean ssa?" in second
    (folder / "data" / "bad.nc").write_bytes(b"no netCDF")
    with pytest.raises(TableFileError, match="cannot be read as netCDF"):
        read_columns(folder / "data" / "bad.nc", {"x": Wanted(("x",), NUMBER)})
    with pytest.raises(ValueError, match="give either the file or"):
        Tabulated(file=str(folder / "data" / "profile.csv"), densities=(1, 2))
    with pytest.raises(ValueError, match="names a column of a file; give file too"):
        Tabulated(column="o3")


def test_a_file_written_anew_is_read_anew(tmp_path: Path) -> None:
    import os

    path = tmp_path / "a.csv"
    for value in ("1", "2"):
        path.write_text(f"z [km],v\n0,{value}\n1,{value}\n", encoding="utf-8")
        os.utime(path, ns=(0, int(value) * 10**9))
        found = read_columns(path, {"z": Wanted((), LENGTH, rising=True), "v": Wanted((), NUMBER)})
        assert found == {"z": (0.0, 1e3), "v": (float(value),) * 2}


@pytest.mark.parametrize(
    ("header", "wavelengths"), [("theta [deg],p", (550.0,)), ("angle [deg],0.65um,450 nm", (450.0, 650.0))]
)
def test_a_measured_phase_function(tmp_path: Path, header: str, wavelengths: tuple[float, ...]) -> None:
    """Henyey & Greenstein's, in any unit, written by angle; two wavelengths in the other order."""
    angles = np.linspace(0.0, 180.0, 721)
    columns = [7.0 * HenyeyGreenstein(g=g).value(np.cos(np.radians(angles)), 550.0)[:, 0] for g in (0.6, 0.3)]
    rows = np.column_stack([angles, *columns[: len(wavelengths)]])
    lines = [header, *(",".join(f"{number:.17g}" for number in row) for row in rows)]
    (tmp_path / "p.csv").write_text("\n".join(lines), encoding="utf-8")
    found = TabulatedPhase(file=str(tmp_path / "p.csv"))
    assert found.wavelengths == wavelengths
    for wavelength, g in zip(wavelengths, (0.3, 0.6)[-len(wavelengths) :], strict=True):
        expected = HenyeyGreenstein(g=g).value(np.cos(np.radians(angles)), wavelength)
        # Linear between angles of a quarter of a degree: 1e-4 in the integral that normalises.
        np.testing.assert_allclose(found.value(np.cos(np.radians(angles)), wavelength), expected, rtol=2e-4)
    with pytest.raises(ValueError, match="give either the file or cos_theta, wavelengths, values, not both"):
        TabulatedPhase(file=str(tmp_path / "p.csv"), wavelengths=(550,))


def test_columns_of_a_phase_function_are_chosen_by_name(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("angle [deg],mine,yours\n0,1,2\n90,1,1\n180,1,4\n", encoding="utf-8")
    found = TabulatedPhase(file=str(tmp_path / "p.csv"), column="yours")
    assert found.values == ((4.0,), (1.0,), (2.0,))
    assert found.cos_theta[::2] == (-1.0, 1.0)
    with pytest.raises(ValueError, match=r'column = "mine"'):
        TabulatedPhase(file=str(tmp_path / "p.csv"))
    (tmp_path / "p.csv").write_text("angle [deg],p\n0,1\n170,1\n", encoding="utf-8")
    with pytest.raises(ValueError, match="must rise from -1 to 1, ends included"):
        TabulatedPhase(file=str(tmp_path / "p.csv"))
