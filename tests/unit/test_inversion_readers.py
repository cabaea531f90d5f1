"""Data from files, the command line around a fit, and results that are kept."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion import FitResult, Normal, limb_profile, radiance_table, read_observation, sky_image
from skyscatter.inversion.observations import Run
from skyscatter.inversion.parameters import Subject

AZIMUTH, ELEVATION = (a.ravel() for a in np.meshgrid([190.0, 220.0, 270.0, 350.0], [15.0, 40.0, 70.0]))
WAVELENGTHS = np.array([450.0, 650.0])


def sky(depth: float = 0.3) -> Any:
    """Radiances (ray, wavelength) by single scattering: quick, and its inversion is as good a test."""
    subject = Subject(skyscatter.load_model("earth-hazy"))
    from skyscatter.inversion.parameters import resolve

    model = resolve("haze.optical_depth", None, subject).put(subject, depth).model
    scene = model.scene(sun_elevation_deg=35.0, altitude=100.0)
    look = direction_from_azimuth_elevation(AZIMUTH, ELEVATION)
    return skyscatter.radiance(scene, scene.observer.position, look, WAVELENGTHS, "single").radiance


def write(path: Path, text: str) -> Path:
    """A file with that text."""
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table of radiances with noise of 1 %."""
    values = sky() * (1 + 0.01 * np.random.default_rng(1).standard_normal((12, 2)))
    lines = ["# made for a test", "azimuth_deg,elevation_deg,wavelength_nm,radiance,sigma,sun_elevation_deg,altitude_m"]
    for k in range(12):
        for j in range(2):
            row = (AZIMUTH[k], ELEVATION[k], WAVELENGTHS[j], values[k, j], 0.01 * values[k, j], 35.0, 100.0)
            lines.append(",".join(map(repr, map(float, row))))
    lines.append("0,30,450,,,35,100")  # not measured
    return write(tmp_path_factory.mktemp("data") / "sky.csv", "\n".join(lines))


def test_a_table_is_read_as_it_was_measured(csv: Path, tmp_path: Path) -> None:
    """CSV and netCDF alike; the prediction at the truth is what was measured but for its noise."""
    import xarray

    data = read_observation(csv)
    assert data.values.size == 24
    assert data.sun == {"elevation_deg": 35.0, "azimuth_deg": 180.0}
    subject = Subject(skyscatter.load_model("earth-hazy"))
    from skyscatter.inversion.parameters import resolve

    subject = resolve("haze.optical_depth", None, subject).put(subject, 0.3)
    off = (data.predict(subject, Run(skyscatter.Single())).value - data.values) / data.sigma
    assert np.abs(off).max() < 4
    assert 0.5 < off.std() < 1.5
    columns = {name: ("datum", v) for name, v in data.coordinates().items()}
    table = xarray.Dataset({**columns, "radiance": ("datum", data.values), "sigma": ("datum", data.sigma)})
    table.to_netcdf(tmp_path / "sky.nc", engine="h5netcdf")
    again = read_observation(tmp_path / "sky.nc")
    np.testing.assert_array_equal(again.values, data.values)
    np.testing.assert_array_equal(again.coordinates()["azimuth_deg"], data.coordinates()["azimuth_deg"])


def test_narrow_bands_see_the_lines_where_they_are() -> None:
    """Sunlight at 430 nm through 1 nm is that of the spectrum, not of a cell hundreds of nm wide."""
    from skyscatter.spectra.solar import solar_irradiance

    model = Subject(skyscatter.load_model("earth"))
    common: dict[str, Any] = {"noise": 0.01, "sun_elevation_deg": 30.0}
    wide = (
        radiance_table([200, 200], [30, 30], [430.5, 700], [1, 1], **common)
        .predict(model, Run(skyscatter.Single()))
        .value
    )
    thin = radiance_table([200, 200], [30, 30], [430.5, 700], [1, 1], **common, bandwidth_nm=1.0)
    share = solar_irradiance([430.5, 700], band=1.0) / solar_irradiance([430.5, 700])
    assert abs(share[0] - 1) > 0.1
    np.testing.assert_allclose(thin.predict(model, Run(skyscatter.Single())).value, wide * share, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("azimuth_deg,elevation_deg,wavelength_nm,radiance\n1,2,500,1", {"noise": 0.1}, "--sun-elevation"),
        ("azimuth_deg,elevation_deg,wavelength_nm,radiance\n1,2,500,1", {"sun_elevation_deg": 3}, "no column sigma"),
        ("azimuth_deg,elevation_deg,wavelenght_nm,radiance\n1,2,500,1", {}, "did you mean wavelength_nm?"),
        ("azimuth_deg,elevation_deg,wavelength_nm,radiance\n1,2,500", {}, "row 1 has 3 cells"),
        ("azimuth_deg,elevation_deg,wavelength_nm,radiance\n1,2,500,much", {}, "is no number"),
        ("azimuth_deg,elevation_deg,wavelength_nm,radiance\n1,92,500,1", {"noise": 0.1, "sun_elevation_deg": 3}, "-90"),
        ("colour,taste\n1,2", {}, "needs the columns azimuth_deg"),
        ("azimuth_deg", {}, "at least one row"),
        ("tangent_height_m,wavelength_nm,radiance\n2e4,500,1", {"noise": 0.1, "sun_elevation_deg": 3}, "--altitude"),
        ("time,global\n2013-05-27T13:00Z,500", {"noise": 0.1}, "--place"),
        ("sun_elevation_deg,flux\n30,500", {"noise": 0.1}, "column quantity"),
        ("sun_elevation_deg,quantity,flux\n30,gobal,500", {"noise": 0.1}, "did you mean global?"),
        ("sun_elevation_deg,global\n30,500", {"noise": 0.1, "pixels": 3}, "means nothing to"),
    ],
)
def test_files_that_cannot_be_understood(tmp_path: Path, text: str, options: Any, words: str) -> None:
    """One line that names the file or the option, and the remedy."""
    with pytest.raises(DomainError) as caught:
        read_observation(write(tmp_path / "data.csv", text), **options)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    """Nor of a kind that is read."""
    with pytest.raises(MissingDataError):
        read_observation(tmp_path / "none.csv")
    with pytest.raises(DomainError, match=r"\.csv"):
        read_observation(write(tmp_path / "data.txt", "x"))


def test_a_limb_is_seen_at_its_tangent_heights() -> None:
    """The lowest point of each line of sight, by geometry."""
    data = limb_profile([1e4, 3e4], 500.0, [1.0, 1.0], noise=0.1, altitude=5e5, sun_elevation_deg=20.0)
    origins, directions = data.looks[0].rays(Subject(skyscatter.load_model("earth")))
    along = np.sum(origins * directions, axis=1)
    height = np.sqrt(np.sum(origins**2, axis=1) - along**2) - 6371e3
    np.testing.assert_allclose(np.sort(height), [1e4, 3e4], atol=1e-3)
    with pytest.raises(DomainError, match="above all tangent points"):
        limb_profile([1e4], 500.0, [1.0], noise=0.1, altitude=5e3, sun_elevation_deg=20.0)


def test_a_sky_image_predicts_itself(tmp_path: Path) -> None:
    """From a file, with fewer wavelengths than it has: its sunlight is that of its own cells."""
    scene = skyscatter.load_model("earth-hazy").scene(sun_elevation_deg=35, altitude="1 km")
    image = skyscatter.render(scene, skyscatter.Fisheye(width=12, height=12), [430, 500, 570, 640], solver="single")
    image.save(tmp_path / "sky.nc")
    data = read_observation(tmp_path / "sky.nc", noise=0.01, wavelengths=[430, 640], pixels=40)
    predicted = data.predict(Subject(skyscatter.load_model("earth-hazy")), Run(skyscatter.Single()))
    np.testing.assert_allclose(predicted.value, data.values, rtol=1e-12)
    assert 40 <= data.values.size <= 80
    with pytest.raises(DomainError, match="noise"):
        sky_image(image)
    with pytest.raises(DomainError, match="nothing is left"):
        sky_image(image, noise=0.1, mask=np.ones((12, 12), bool))


def test_a_fit_on_the_command_line(csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Data, names and priors in; JSON, pictures and the fitted model out; the truth within four deviations."""
    out = {name: tmp_path / name for name in ("fit.json", "corner.png", "residual.png", "fitted.toml")}
    status = main([
        "invert", "earth-hazy", "--data", str(csv), "--solver", "single", "--free", "haze.optical_depth=0:2",
        "--free", "haze.asymmetry", "--free", "calibration", "--prior", "calibration=1~0.02",
        "-o", str(out["fit.json"]), "--corner", str(out["corner.png"]), "--residual", str(out["residual.png"]),
        "--save-model", str(out["fitted.toml"]), "--json",
    ])  # fmt: skip
    captured = capsys.readouterr()
    assert status == 0, captured.err
    summary = json.loads(captured.out)
    assert summary["converged"]
    assert "haze.optical_depth" in captured.err
    off = summary["estimate"]["haze.optical_depth"] - 0.3
    assert abs(off) < 4 * summary["standard_deviation"]["haze.optical_depth"] < 0.1
    result = FitResult.load(out["fit.json"])
    assert result.priors[2] == Normal(1.0, 0.02, 0.0)
    assert result.estimate == summary["estimate"]
    np.testing.assert_array_equal(result.covariance.tolist(), np.array(result.covariance))
    truth = {"haze.optical_depth": 0.3, "haze.asymmetry": 0.6997, "calibration": 1.0}
    assert result.distance(truth) < 16.3  # 99.9 % of chi2 with three degrees of freedom
    low, high = result.interval()["haze.optical_depth"]
    assert low < result.estimate["haze.optical_depth"] < high
    assert 0.01 < result.probability < 0.99
    model = skyscatter.load_model(out["fitted.toml"])
    assert model == result.model
    from PIL import Image

    for name in ("corner.png", "residual.png"):
        with Image.open(out[name]) as picture:
            assert min(picture.size) > 300
    assert not list(tmp_path.glob("*.partial.zarr"))
    (tmp_path / "broken.json").write_text("{}")
    with pytest.raises(SkyscatterError, match="not the result of a fit"):
        FitResult.load(tmp_path / "broken.json")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--free", "haze.optical_dept"], "did you mean optical_depth?"),
        ([], "name at least one parameter"),
        (["--free", "haze.g", "--method", "guess"], "choose one of optimal-estimation"),
        (["--free", "haze.g", "--solver", "single", "--samples", "8"], "means nothing to the solver single"),
        (["--free", "haze.optical_depth", "--prior", "haze.asymmetry=0.7~0.1"], "is not free"),
        (["--free", "haze.optical_depth=0:1", "--prior", "haze.optical_depth=0.7~0.1"], "has bounds already"),
        (["--free", "haze.optical_depth", "--steps", "100"], "belongs to the posterior"),
        (["--free", "haze.optical_depth", "--noise", "1%"], "bring their own sigma"),
        (["--free", "haze.optical_depth", "--pixels", "9"], "means nothing to"),
        (["--free", "haze.optical_depth", "-o", "fit.txt"], "the extension must be one of .json"),
        (["--free", "haze.optical_depth", "--resume", "none.zarr"], "there is no such checkpoint"),
        (["--free", "haze.optical_depth", "-q"], "the result would be lost; name a file with -o"),
        (["--free", "haze.optical_depth", "--units", "W m-2 nm-1"], "is a unit of something else"),
        (["--free", "haze.optical_depth", "--units", "brightness"], "is no unit that is understood"),
    ],
)
def test_bad_input_is_one_line_and_exit_status_2(
    csv: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    """Before anything is computed."""
    assert main(["invert", "earth-hazy", "--data", str(csv), *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def scaled(csv: Path, path: Path, factor: float, unit: str = "") -> Path:
    """The table with its radiances, and their deviations, times a number; and a unit after their names."""
    lines = csv.read_text().splitlines()
    names = lines[1].split(",")
    lines[1] = ",".join(f"{name} [{unit}]" if unit and name in ("radiance", "sigma") else name for name in names)
    for k, line in enumerate(lines[2:-1], start=2):
        cells = line.split(",")
        lines[k] = ",".join([*cells[:3], *(repr(float(cell) * factor) for cell in cells[3:5]), *cells[5:]])
    return write(path, "\n".join(lines))


@pytest.mark.parametrize(
    ("unit", "per_house"),
    [("uW cm-2 sr-1 nm-1", 100.0), ("mW m-2 sr-1 nm-1", 1e3), ("W/m^2/sr/um", 1e3), ("µW / (m2 sr nm)", 1e6)],
)
def test_radiances_in_other_units(csv: Path, tmp_path: Path, unit: str, per_house: float) -> None:
    """By the file or by the user, they are the same data; neither is overruled by the other."""
    house = read_observation(csv)
    assert not house.stated
    by_file = read_observation(scaled(csv, tmp_path / "a.csv", per_house, unit))
    by_user = read_observation(scaled(csv, tmp_path / "b.csv", per_house), units=unit)
    for data in (by_file, by_user):
        assert data.stated
        np.testing.assert_allclose(data.values, house.values, rtol=1e-12)
        np.testing.assert_allclose(data.sigma, house.sigma, rtol=1e-12)
    with pytest.raises(DomainError, match="says that they are"):
        read_observation(tmp_path / "a.csv", units="W m-2 sr-1 nm-1")


def test_what_counts_as_another_unit_lies_between_dark_skies_and_units() -> None:
    """As far from how much skies differ as from the least factor between units."""
    from skyscatter.inversion.datumunits import BETWEEN_UNITS, FAR_UNITS, IMPLAUSIBLE, USUAL, factors

    least = min(1 / float(factors(unit, "W m-2 sr-1 nm-1", 550.0)) for unit in FAR_UNITS)
    assert least == pytest.approx(BETWEEN_UNITS)
    assert pytest.approx(BETWEEN_UNITS / IMPLAUSIBLE) == IMPLAUSIBLE / USUAL


def test_units_per_frequency_and_photons() -> None:
    """By h and c, each datum at its own wavelength."""
    from skyscatter.inversion.datumunits import factors

    wl = np.array([400.0, 800.0])
    c, h = 299792458.0, 6.62607015e-34
    np.testing.assert_allclose(factors("W m-2 sr-1 Hz-1", "W m-2 sr-1 nm-1", wl), c / (wl * 1e-9) ** 2 * 1e-9)
    np.testing.assert_allclose(factors("photon s-1 m-2 sr-1 nm-1", "W m-2 sr-1 nm-1", wl), h * c / (wl * 1e-9))


def test_a_netcdf_says_its_units(tmp_path: Path) -> None:
    """Also those of its coordinates, which must be what their names say."""
    import xarray

    rows = {"azimuth_deg": [10.0], "elevation_deg": [30.0], "wavelength_nm": [500.0], "sun_elevation_deg": [30.0]}
    table = xarray.Dataset({name: ("datum", values) for name, values in rows.items()})
    table["radiance"] = ("datum", [50.0], {"units": "mW m-2 sr-1 nm-1"})
    table.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    assert read_observation(tmp_path / "a.nc", noise=0.1).values == pytest.approx([0.05])
    table["wavelength_nm"].attrs["units"] = "um"
    table.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    with pytest.raises(DomainError, match="column wavelength_nm is in 'um'"):
        read_observation(tmp_path / "b.nc", noise=0.1)


@pytest.mark.parametrize("factor", [100.0, 1e3, 1e6, 1e-2])
def test_radiances_in_a_unit_that_nobody_states_are_refused(
    csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], factor: float
) -> None:
    """In one line, after one look at the model; who says that the unit is right is believed, and told of the misfit."""
    data = scaled(csv, tmp_path / "sky.csv", factor)
    arguments = ["invert", "earth-hazy", "--data", str(data), "--solver", "single", "--free", "haze.optical_depth=0:2"]
    assert main([*arguments, "--progress", "none"]) == 2
    error = capsys.readouterr().err
    assert "--units" in error
    assert error.count("\n") == 1
    if factor != 1e3:
        return
    out = tmp_path / "fit.json"
    assert main([*arguments, "--units", "W m-2 sr-1 nm-1", "-o", str(out), "-q", "--max-iterations", "1"]) == 3
    assert "is no estimate" in capsys.readouterr().err
    assert not FitResult.load(out).trusted
    assert main([*arguments, "--units", "mW m-2 sr-1 nm-1", "-o", str(out), "-q"]) == 0
    assert FitResult.load(out).estimate["haze.optical_depth"] == pytest.approx(0.3, abs=0.05)


def test_a_fit_that_has_not_converged_has_an_exit_status(
    csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was found is written, and it is said even where nothing else is."""
    out = tmp_path / "fit.json"
    arguments = ["invert", "earth-hazy", "--data", str(csv), "--solver", "single", "--free", "haze.optical_depth=0:2"]
    assert main([*arguments, "--max-iterations", "1", "-o", str(out), "-q", "--json"]) == 3
    captured = capsys.readouterr()
    assert "has not converged in 1 iterations" in captured.err
    assert not FitResult.load(out).converged
    assert "has not converged" in json.loads(captured.out)["warnings"][0]


def test_a_grey_ground_in_the_place_of_a_spectral_one() -> None:
    """ground.albedo keeps the colours of the model's ground, ground.grey_albedo replaces them."""
    from skyscatter.inversion.parameters import with_values
    from skyscatter.inversion.report import spectral_ground
    from skyscatter.spectra.surfaces import spectrum_of

    model = skyscatter.load_model("earth-hazy")  # vegetation
    wl = [450.0, 550.0, 800.0]
    grey = with_values(model, {"ground.grey_albedo": 0.4})
    np.testing.assert_array_equal(spectrum_of(grey.ground.albedo, wl), 0.4)
    green = spectrum_of(with_values(model, {"ground.albedo": 0.4}).ground.albedo, wl)
    assert green[1] == pytest.approx(0.4)
    assert green[0] < 0.3 < 0.8 < green[2]
    assert spectral_ground(model)
    assert not spectral_ground(grey)


def test_an_interrupted_fit_goes_on(
    csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the second iteration leaves a state from which the rest is found, with the same answer."""
    import skyscatter.inversion.radiances as radiances

    arguments = ["invert", "earth-hazy", "--data", str(csv), "--solver", "single", "--free", "haze.optical_depth=0:4"]
    whole, part = tmp_path / "whole.json", tmp_path / "part.json"
    assert main([*arguments, "-o", str(whole), "-q"]) == 0
    original, calls = radiances.differentiate, []

    def stopping(*given: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return original(*given, **options)

    monkeypatch.setattr(radiances, "differentiate", stopping)
    assert main([*arguments, "-o", str(part)]) == 130
    assert "interrupted before anything" in capsys.readouterr().err
    calls.clear()
    calls.append(1)  # the first one of this run is the second call: let the start be kept
    monkeypatch.setattr(radiances, "differentiate", original)
    monkeypatch.setattr(radiances, "_answer", _raise)
    assert main([*arguments, "-o", str(part)]) == 130
    said = capsys.readouterr().err
    assert "go on with" in said
    state = tmp_path / "part.json.partial.zarr"
    assert state.is_dir()
    monkeypatch.undo()
    assert main([*arguments, "-o", str(part), "--resume", str(state), "-q"]) == 0
    assert not state.exists()
    a, b = (FitResult.load(p) for p in (whole, part))
    assert b.estimate == a.estimate
    np.testing.assert_array_equal(np.array(b.covariance), np.array(a.covariance))


def _raise(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


def test_data_of_a_sky_and_the_model_of_a_nebula_are_refused() -> None:
    data = radiance_table([180.0], [45.0], [550.0], [0.1], sigma=0.01, sun_elevation_deg=40.0)
    with pytest.raises(DomainError, match=r"model = 'reflection-nebula'.*of a sky.*planet"):
        skyscatter.fit("reflection-nebula", data, {"dust.extinction": (0.1, 10.0)})


def test_priors_stay_within_what_has_a_meaning() -> None:
    data = radiance_table([180.0], [45.0], [550.0], [0.1], sigma=0.01, sun_elevation_deg=40.0)
    for free, words in (
        ({"ground.albedo": Normal(1.2, 0.1)}, "ground.albedo=1.2"),
        ({"air.weight": (-1, 2)}, "weight"),
    ):
        with pytest.raises(DomainError, match=words):
            skyscatter.fit("earth", data, free)
