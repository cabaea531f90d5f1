"""Sensors and bands: what they say of themselves, quadratures, and which band of a file is which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyscatter.dehaze.bands import Band, Sensor, load_sensor, sensor_names
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.spectra.solar import solar_irradiance

ALL = [(name, band.name) for name in sensor_names() for band in load_sensor(name).bands]


@pytest.mark.parametrize(("sensor", "name"), ALL)
def test_band_is_what_it_says(sensor: str, name: str) -> None:
    """Centre and width as given are those of the response, whether measured or made."""
    band = load_sensor(sensor).band(name)
    wl, response = np.array(band.wavelengths), np.array(band.response)
    above = wl[response >= 0.5 * response.max()]
    assert np.ptp(above) == pytest.approx(band.width_nm, abs=2.0)  # nodes are up to 1 nm apart, at both edges
    assert np.trapezoid(wl * response, wl) / np.trapezoid(response, wl) == pytest.approx(band.centre_nm, abs=0.01)
    assert band.approximate == (not sensor.startswith("landsat"))
    assert band.note


# Landsat 8 Data Users Handbook (USGS), table of centre wavelengths and band edges (full width at half maximum) [nm].
OLI = {
    "B1": (443.0, 434.97, 450.95), "B2": (482.6, 452.02, 512.06), "B3": (561.3, 532.74, 590.07),
    "B4": (654.6, 635.85, 673.32), "B5": (864.6, 850.54, 878.79), "B6": (1609.1, 1566.50, 1651.22),
    "B7": (2201.2, 2107.40, 2294.06), "B8": (591.7, 503.30, 675.70), "B9": (1373.5, 1363.24, 1383.63),
}  # fmt: skip


@pytest.mark.parametrize("name", OLI)
def test_landsat_8_against_its_handbook(name: str) -> None:
    band = load_sensor("landsat-8").band(name)
    _, low, high = OLI[name]
    assert band.width_nm == pytest.approx(high - low, abs=1.0)
    centre = 0.5 * (low + high)  # the handbook's centres are those of the edges
    assert band.centre_nm == pytest.approx(centre, abs=0.02 * band.width_nm + 0.5)


def test_landsat_9_is_landsat_8s_twin() -> None:
    for eight, nine in zip(load_sensor("landsat-8").bands, load_sensor("landsat-9").bands, strict=True):
        assert nine.effective_wavelength == pytest.approx(eight.effective_wavelength, abs=2.5)
        assert nine.response != eight.response


@pytest.mark.parametrize(("sensor", "name"), ALL)
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_quadrature_is_exact_for_polynomials(sensor: str, name: str, n: int) -> None:
    band = load_sensor(sensor).band(name)
    wl, weights = band.nodes(n)
    fine, shares = band.samples()
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert np.all(weights > 0)
    assert np.all(np.diff([fine[0], *wl, fine[-1]]) > 0)
    x, t = (wl - band.centre_nm) / band.width_nm, (fine - band.centre_nm) / band.width_nm
    for degree in range(2 * n):
        expected = shares @ t**degree
        assert weights @ x**degree == pytest.approx(expected, abs=1e-12 * (shares @ np.abs(t) ** degree))
    # One degree more is not exact: the quadrature is no finer sum in disguise.
    assert abs(weights @ x ** (2 * n) - shares @ t ** (2 * n)) > 1e-9


def test_samples_are_the_suns_light_through_the_response() -> None:
    """A band within one cell of the Sun's table, by closed form: both curves linear."""
    band = Band.from_table("x", np.array([2000.0, 2002.0, 2004.0]), np.array([0.0, 1.0, 0.0]))
    fine = np.linspace(2000.0, 2004.0, 400001)
    response, sun = 1 - np.abs(fine - 2002.0) / 2.0, solar_irradiance(fine, band="point")
    wl, weights = band.samples()
    step = 0.1  # 41 samples at least: the trapezoid of a parabola is off by step^2 / 12 of its curvature
    mean = np.trapezoid(fine * response * sun, fine) / np.trapezoid(response * sun, fine)
    assert weights @ wl == pytest.approx(mean, abs=step**2)
    assert band.solar_irradiance == pytest.approx(np.trapezoid(response * sun, fine) / 2.0, rel=1e-4)
    assert band.effective_wavelength == pytest.approx(weights @ wl, abs=1e-9)


def test_two_wavelengths_stand_for_a_band_of_air() -> None:
    """Rayleigh optical depth, ~ wavelength^-4.1, averaged over the widest bands by two nodes."""
    for sensor, name in (("sentinel-2a", "B08"), ("sentinel-2a", "B02"), ("landsat-8", "B8"), ("srgb-camera", "blue")):
        band = load_sensor(sensor).band(name)
        for n, error in ((2, 2e-4), (3, 2e-5)):
            wl, weights = band.nodes(n)
            fine, shares = band.samples()
            # Remainder: (2n)-th derivative over (2n)! times width^(2n), about 1e-4 and 1e-6 for the widest.
            assert weights @ wl**-4.1 == pytest.approx(shares @ fine**-4.1, rel=error)


def test_shapes_have_their_width() -> None:
    for exponent in (2.0, 8.0, 40.0):
        band = Band.from_shape("x", 600.0, 30.0, exponent=exponent)
        assert np.interp([585.0, 615.0], band.wavelengths, band.response) == pytest.approx([0.5, 0.5], abs=0.03)
        assert max(band.response) == 1.0
        assert band.response[0] < 2e-4


def test_roles() -> None:
    assert [b.role for b in load_sensor("sentinel-2b").bands][:5] == ["coastal", "blue", "green", "red", "rededge"]
    for name in sensor_names():
        sensor = load_sensor(name)
        for role in ("red", "green", "blue"):
            assert len(sensor.with_role(role)) == 1
    # Roles presumed from centre and width agree with those given.
    for name in ("sentinel-2a", "landsat-9"):
        for band in load_sensor(name).bands:
            presumed = Band.from_shape("x", band.centre_nm, band.width_nm).role
            assert presumed == band.role.replace("-narrow", "")


S2 = "sentinel-2a"
SPELLINGS = [
    (S2, "B2", "B02"), (S2, "B02", "B02"), (S2, "b8a", "B8A"), (S2, "B08A", "B8A"), (S2, "band 2", "B02"),
    (S2, "Band_12", "B12"), (S2, "T32TMT_20200101T102021_B02_10m.jp2", "B02"), (S2, "blue", "B02"),
    (S2, "B4, central wavelength 665 nm", "B04"), (S2, "B8A, central wavelength 865 nm", "B8A"), (S2, "NIR", "B08"),
    (S2, "near infrared", "B08"), (S2, "Red", "B04"), (S2, "rededge2", "B06"), (S2, "Vegetation Red Edge 3", "B07"),
    (S2, "nir08", "B8A"), (S2, "nir09", "B09"), (S2, "swir16", "B11"), (S2, "SWIR 2", "B12"), (S2, "665 nm", "B04"),
    (S2, "0.865 um", "B8A"), (S2, "coastal", "B01"), (S2, "red edge", None), (S2, "SCL", None), (S2, "AOT", None),
    (S2, "Aerosol Optical Thickness", None), (S2, "B13", None), (S2, "QA60", None), (S2, "", None), (S2, None, None),
    (S2, "400 nm", None), (S2, "cloud probability", None), (S2, "infrared", None),
    ("landsat-8", "SR_B2", "B2"), ("landsat-8", "LC08_L1TP_193024_20200101_B10.TIF", None),
    ("landsat-8", "LC08_L1TP_193024_20200101_20200113_01_T1_B5.TIF", "B5"), ("landsat-9", "nir08", "B5"),
    ("landsat-9", "cirrus", "B9"), ("landsat-9", "pan", "B8"), ("landsat-9", "B01", "B1"), ("landsat-8", "B8A", None),
    ("srgb-camera", "R", "red"), ("srgb-camera", "green", "green"), ("srgb-camera", "alpha", None),
]  # fmt: skip


@pytest.mark.parametrize(("sensor", "said", "expected"), SPELLINGS)
def test_spellings(sensor: str, said: str | None, expected: str | None) -> None:
    (band,) = load_sensor(sensor).match([said])
    assert (band.name if band else None) == expected


@given(st.permutations([band.name for band in load_sensor("sentinel-2a").bands]))
def test_order_tells_nothing(names: list[str]) -> None:
    assert [band.name for band in load_sensor("sentinel-2a").match(names) if band] == names


def test_colours_help_where_names_do_not() -> None:
    sensor = load_sensor("landsat-8")
    found = sensor.match([None, "", "", "mask"], ["red", "green", "blue", "alpha"])
    assert [band.name if band else None for band in found] == ["B4", "B3", "B2", None]
    with pytest.raises(DomainError, match="colour interpretation"):
        sensor.match(["Band 1", "Band 2", "Band 3"], ["red", "green", "blue"])
    with pytest.raises(DomainError, match="both are B4"):
        sensor.match(["B4", "red"])
    with pytest.raises(DomainError, match="colours = 1"):
        sensor.match(["B4", "B3"], ["red"])


def test_user_table(tmp_path: Path) -> None:
    table = tmp_path / "drone.csv"
    table.write_text("# mine\nwavelength_nm,blue,wide nir\n440,0,0\n470,1,0\n500,0,0\n800,0,0\n850,0,1\n900,0,0\n")
    sensor = Sensor.from_csv(table)
    assert sensor.name == "drone"
    assert [band.role for band in sensor.bands] == ["blue", "nir"]
    assert sensor.band("blue").centre_nm == pytest.approx(470.0)
    assert sensor.band("blue").width_nm == pytest.approx(30.0)
    assert not sensor.band("blue").approximate
    found = sensor.match(["Wide NIR", "BLUE"])
    assert [band.name for band in found if band] == ["wide nir", "blue"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "header"),
        ("nm,a\n1,2\n", "header"),
        ("wavelength_nm,a\n500,1,2\n", "3 cells under 2 names"),
        ("wavelength_nm,a\n500,x\n510,1\n", "could not convert"),
        ("wavelength_nm,a\n500,1\n490,1\n", "increase"),
        ("wavelength_nm,a\n500,-1\n510,1\n", "negative"),
        ("wavelength_nm,a\n500,nan\n510,1\n", "finite"),
        ("wavelength_nm,a\n500,0\n510,0\n", "zero everywhere"),
        ("wavelength_nm,a\n100,1\n510,1\n", "280 to 4000|280 and 4000"),
        ("wavelength_nm,a,a\n500,1,1\n510,1,1\n", "two bands of one name"),
        ("wavelength_nm,a\n", "not a table"),
    ],
)
def test_bad_tables_are_named(tmp_path: Path, text: str, problem: str) -> None:
    table = tmp_path / "bad.csv"
    table.write_text(text)
    with pytest.raises(MissingDataError, match=problem) as caught:
        Sensor.from_csv(table)
    assert "bad.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_table(tmp_path: Path) -> None:
    with pytest.raises(MissingDataError, match="check the path"):
        Sensor.from_csv(tmp_path / "none.csv")


def test_shapes_by_numbers() -> None:
    sensor = Sensor.from_shapes("mine", {"green": (560.0, 20.0), "red": (650.0, 20.0)})
    assert [band.role for band in sensor.bands] == ["green", "red"]
    assert all(band.approximate for band in sensor.bands)
    with pytest.raises(DomainError, match="width"):
        Sensor.from_shapes("mine", {"green": (560.0, 0.0)})


def test_unknown_names_are_answered() -> None:
    assert load_sensor("S2A") == load_sensor("sentinel-2a")
    assert load_sensor("Landsat 8").name == "landsat-8"
    with pytest.raises(DomainError, match="landsat-8, landsat-9"):
        load_sensor("landsat-7")
    with pytest.raises(DomainError, match="B12"):
        load_sensor("sentinel-2a").band("B13")
    with pytest.raises(DomainError, match="1 to 20 wavelengths"):
        load_sensor("sentinel-2a").band("B02").nodes(0)
