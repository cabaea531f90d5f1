"""Fluxes and derivatives as labelled data, and the command that writes them."""

from __future__ import annotations

import inspect
import io
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.parse import parse_values
from skyscatter.errors import DomainError
from skyscatter.inversion.derivatives import Derivatives
from skyscatter.solvers.fluxdata import QUANTITIES, quantities, to_csv
from skyscatter.solvers.fluxes import Fluxes
from skyscatter.units import metres

ALTITUDES, SUNS, WAVELENGTHS = [0.0, 12e3], [-2.0, 25.0, 60.0], [450.0, 650.0]


@pytest.fixture(scope="module")
def field() -> Any:
    scene = skyscatter.load_model("earth-simple").scene()
    return skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(-2, 60), tolerance=0.05, max_order=2)


def test_the_box_is_labelled_as_it_was_asked_for(field: Any) -> None:
    data = field.flux_dataset(ALTITUDES, SUNS)
    assert dict(data.sizes) == {"altitude": 2, "sun_elevation": 3, "wavelength": 2}
    for h in ALTITUDES:
        for sun in SUNS:
            one, here = field.fluxes(h, sun_elevation_deg=sun), data.sel(altitude=h, sun_elevation=sun)
            for name in ("direct", "diffuse_down", "net", "actinic"):
                # Directions of quadrature are shared by the heights that are asked for together.
                np.testing.assert_allclose(here[name], getattr(one, name), rtol=1e-5, atol=1e-12)
                np.testing.assert_allclose(here[f"{name}_error"], getattr(one, f"{name}_error"), rtol=1e-2, atol=1e-9)
    np.testing.assert_allclose(data["net"], data["down"] - data["up"], rtol=1e-12, atol=1e-15)
    assert data["up"].attrs["standard_name"] == "upwelling_radiative_flux_per_unit_wavelength_in_air"
    assert {data[name].attrs["units"] for name in QUANTITIES} == {"W m-2 nm-1"}
    assert json.loads(data.attrs["recipe"])["tolerance"] == field.tolerance
    # As it is: one altitude, the scene's Sun.
    alone = field.flux_dataset()
    assert (alone["altitude"].values.tolist(), alone["sun_elevation"].values.tolist()) == ([0.0], [30.0])
    with pytest.raises(DomainError, match="for other shapes use fluxes"):
        field.flux_dataset([[0.0, 1.0]])


def test_a_beam_that_passes_upward_counts_as_upward() -> None:
    parts = [np.array([x]) for x in (-2.0, 3.0, 1.0, 9.0, 0.2, 0.3, 0.1, 0.9)]
    found = quantities(Fluxes(*parts))
    assert {name: (value.item(), pytest.approx(error.item())) for name, (value, error) in found.items()} == {
        "direct": (-2.0, 0.2), "diffuse_down": (3.0, 0.3), "down": (3.0, 0.3), "up": (3.0, 0.3), "net": (0.0, 0.6),
        "actinic": (9.0, 0.9),
    }  # fmt: skip


def test_tables_hold_the_same_numbers(field: Any) -> None:
    data = field.flux_dataset(ALTITUDES, SUNS)
    text = to_csv(data)
    table = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    rows = np.genfromtxt(io.StringIO(table), delimiter=",", names=True)
    assert rows.size == 12
    for row in rows:
        keys = {"altitude": "altitude_m", "sun_elevation": "sun_elevation_deg", "wavelength": "wavelength_nm"}
        here = data.sel({dim: row[column] for dim, column in keys.items()})
        for name in QUANTITIES:
            assert row[name] == pytest.approx(float(here[name]), rel=1e-9)
            assert row[f"{name}_error"] == pytest.approx(float(here[f"{name}_error"]), rel=1e-9)


def test_the_command(
    field: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    signature, asked = inspect.signature(skyscatter.solve), {}

    def solve(*arguments: Any, **options: Any) -> Any:
        asked.update(signature.bind(*arguments, **options).arguments)
        return field

    monkeypatch.setattr(skyscatter, "solve", solve)
    box = ["--altitude", "0,12km", "--sun-elevation", "20:40:20", "--wavelengths", "450,650"]
    command = ["flux", "earth-simple", *box, "--tolerance", "5%", "--max-order", "2", "-q"]
    assert main([*command, "-o", "flux.nc", "-o", "flux.csv"]) == 0
    assert (asked["wavelengths"].tolist(), asked["sun_elevations_deg"]) == ([450.0, 650.0], (20.0, 40.0))
    assert (asked["tolerance"], asked["max_order"]) == (0.05, 2)
    assert capsys.readouterr().out == ""
    with xarray.open_dataset("flux.nc") as data:
        data.load()
    assert data["net"].shape == (2, 2, 2)
    assert data["altitude"].values.tolist() == [0.0, 12e3]
    assert Path("flux.csv").read_text() == to_csv(data)
    assert main(command) == 0
    assert capsys.readouterr().out == to_csv(data)
    assert main([*command, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(summary["net"], data["net"])
    assert 0 < summary["estimated_error"] < 0.2
    assert main([*command, "--no-clobber", "-o", "flux.csv"]) == 2


def test_a_place_and_a_time_settle_the_sun_and_its_distance(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    found: list[Any] = []

    def solve(scene: Any, *_: Any, sun_elevations_deg: tuple[float, float], **__: Any) -> Any:
        found.append((scene, sun_elevations_deg))
        raise skyscatter.errors.DomainError("x", 1, "is enough")

    monkeypatch.setattr(skyscatter, "solve", solve)
    assert main(["flux", "--place", "52.5,13.4", "--time", "2026-01-04T11:00", "-q"]) == 2
    assert capsys.readouterr().err.endswith("is enough\n")
    ((scene, (low, high)),) = found
    wanted = skyscatter.load_model("earth").scene_at(52.5, 13.4, "2026-01-04T11:00")
    assert (scene, low, high) == (wanted, wanted.sun.elevation_deg, wanted.sun.elevation_deg)
    assert scene.sun.distance_au == pytest.approx(0.9833, abs=1e-4)  # perihelion


@pytest.mark.parametrize("planet", ["earth", "mars"])
def test_a_night_is_told_with_a_remedy_of_this_command(
    planet: str, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The Sun at -67 degrees on both, by day at 66 and 22."""

    def solve(*_: Any, **__: Any) -> Any:
        raise skyscatter.errors.DomainError("x", 1, "is enough")

    monkeypatch.setattr(skyscatter, "solve", solve)
    for place, time, told in (("0,0", "00:00", True), ("0,90", "06:00" if planet == "earth" else "00:00", False)):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            assert main(["flux", planet, "--place", place, "--time", f"2026-01-01T{time}Z"]) == 2
        error = capsys.readouterr().err
        assert ("fluxes of sunlight alone" in error) == ("give another --time" in error) == told
        assert "lights =" not in error
        assert "airglow" not in error


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["earth", "--altitude", "0,x"], "altitude = '0,x': give START:STOP:STEP or a list"),
        (["earth", "--altitude", "0,500km"], "lies between 0 and the top of the air"),
        (["earth", "--altitude=-1m"], "lies between 0 and the top of the air"),
        (["earth", "--sun-elevation", "10:20"], "such as 10:90:10"),
        (["earth", "--sun-elevation", "20:10:5"], "such as 10:90:10"),
        (["earth", "--sun-elevation", ""], "such as 10:90:10"),
        (["earth", "--sun-elevation", "95"], "between -90 and 90 degrees"),
        (["earth", "--sun-elevation", "5,5"], "give each value once"),
        (["earth", "--place", "52.5,13.4"], "needs --time as well"),
        (["--place=52,13", "--time=2026-01-04", "--sun-elevation=3"], "settles where the Sun is; leave out --sun-elev"),
        (["titan", "--place=52,13", "--time=2026-01-04"], "a place and a time mean Earth or Mars"),
        (["earth", "-o", "flux.png"], "must be one of .nc, .csv"),
        (["ring-nebula"], "use skyscatter nebula"),
        (["fog-room"], "use skyscatter render"),
    ],
)
def test_wrong_input_is_refused_in_one_line(options: list[str], word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["flux", *options]) == 2
    captured = capsys.readouterr()
    assert word in captured.err
    assert (captured.out, captured.err.count("\n")) == ("", 1)


def test_lists_of_values() -> None:
    assert parse_values("0:1km:250m", "x", metres, "").tolist() == [0, 250, 500, 750, 1000]
    assert parse_values("10:-10:-10", "x", float, "").tolist() == [10, 0, -10]
    assert parse_values("3, 1,2", "x", float, "").tolist() == [3, 1, 2]
    for text in ("", "1:2", "1:2:0", "nan", "0:inf:1", "1,,2", "0:1e9:1"):
        with pytest.raises(DomainError):
            parse_values(text, "x", float, "0,1")


def test_derivatives_are_labelled() -> None:
    values = np.arange(24.0).reshape(4, 3, 2)
    slopes = np.stack([values, 10 * values])
    found = Derivatives(values, 0.1 * values, slopes, 0.1 * slopes)
    data = found.to_xarray([450.0, 650.0], ["haze.optical_depth", "ground.albedo"], ["azimuth", "elevation"])
    assert data["derivative"].dims == ("parameter", "azimuth", "elevation", "wavelength")
    one = data.sel(parameter="ground.albedo", wavelength=650.0)
    np.testing.assert_array_equal(one["derivative"], slopes[1, ..., 1])
    np.testing.assert_array_equal(one["derivative_error"], 0.1 * slopes[1, ..., 1])
    np.testing.assert_array_equal(one["radiance"], values[..., 1])
    assert found.to_xarray([450.0, 650.0])["radiance"].dims == ("ray_0", "ray_1", "wavelength")
    for wrong in (([450.0],), ([450.0, 650.0], ["a"]), ([450.0, 650.0], None, ["x", "x"])):
        with pytest.raises(DomainError):
            found.to_xarray(*wrong)
