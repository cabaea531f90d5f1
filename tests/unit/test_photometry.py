"""Janskys, magnitudes and counts against astropy.units, integrals, and published offsets between magnitude systems."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from astropy import constants, units
from astropy.io import fits
from pydantic import ValidationError
from scipy.integrate import quad

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.image import Counts, FilterCurve, FilterImage, SkyFrame, SpectralImage, photometric
from skyscatter.image.filters import BROAD, NARROW, filter_curve
from skyscatter.image.photometry import AB_ZERO, VEGA_ZERO, conversion

RADIANCE = units.Unit("W m-2 sr-1 nm-1")
SKY = SkyFrame(ra_deg=83.82, dec_deg=-5.39, pixel_scale_deg=7.0 / 3600.0)
WL = np.arange(300.0, 921.0, 2.0)
TRIANGLES = [
    FilterCurve(name=f"t-{weighting}", wavelengths=(480, 520, 620), response=(0, 0.7, 0), weighting=weighting)
    for weighting in ("photon", "energy")
]


def image(spectrum: Any, wavelengths: Any = WL, error: float = 0.01) -> SpectralImage:
    cube = np.broadcast_to(spectrum, (3, 4, len(wavelengths))) * np.linspace(1, 2, 12).reshape(3, 4, 1)
    return SpectralImage(cube, wavelengths, error * cube, sky=SKY, recipe={"solver": "path", "seed": 1})


def transmission(curve: FilterCurve, wl: float) -> float:
    """Share of the photons, to a factor."""
    return float(np.interp(wl, curve.wavelengths, curve.response)) / (1.0 if curve.weighting == "photon" else wl)


def integral(curve: FilterCurve, f: Any) -> float:
    nodes = curve.wavelengths
    parts = (quad(lambda wl: f(wl) * transmission(curve, wl), a, b)[0] for a, b in pairwise(nodes))
    return sum(parts)


@pytest.mark.parametrize("curve", [*TRIANGLES, filter_curve("V"), filter_curve("halpha")], ids=lambda c: c.name)
def test_pivot_wavelengths_are_the_integrals(curve: FilterCurve) -> None:
    expected = np.sqrt(integral(curve, lambda wl: wl) / integral(curve, lambda wl: 1 / wl))
    assert curve.pivot == pytest.approx(expected, rel=1e-9)  # quadrature


@pytest.mark.parametrize("unit", ["Jy sr-1", "MJy/sr"])
def test_spectra_in_janskys(unit: str) -> None:
    made = image(1e-9 * (WL / 500.0))
    data = photometric(made, unit)
    for k in (0, 100, 310):
        truth = (made.radiance[..., k] * RADIANCE).to(unit, units.spectral_density(WL[k] * units.nm)).value
        np.testing.assert_allclose(data["brightness"].values[..., k], truth, rtol=1e-9)
    np.testing.assert_allclose(data["brightness_error"], 0.01 * data["brightness"])
    assert units.Unit(data["brightness"].attrs["units"]) == units.Unit(unit)


@pytest.mark.parametrize("curve", [*TRIANGLES, *map(filter_curve, BROAD)], ids=lambda c: c.name)
def test_a_spectrum_that_is_flat_per_frequency_keeps_its_value(curve: FilterCurve) -> None:
    """By definition of the AB system a flat f_nu has one magnitude through every filter."""
    janskys = 2.5e6  # per sr
    flat = (janskys * units.Jy / units.sr).to(RADIANCE, units.spectral_density(WL * units.nm)).value
    seen = image(flat).through([curve])
    share = np.linspace(1, 2, 12).reshape(3, 4, 1)
    # Each cell of 2 nm counts with its middle.
    np.testing.assert_allclose(photometric(seen, "Jy sr-1").brightness, janskys * share, rtol=1e-4)
    per_area = janskys * share * (units.Jy / units.sr).to(units.Jy / units.arcsec**2)
    truth = (per_area * units.Jy).to(units.ABmag).value  # of a square arc second
    np.testing.assert_allclose(photometric(seen, "ABmag arcsec-2").brightness, truth, rtol=0, atol=2e-4)
    omega = SKY.pixel_solid_angle(4, 3)[..., None]
    truth = (janskys * share * omega * units.Jy).to(units.ABmag).value
    np.testing.assert_allclose(photometric(seen, "ABmag").brightness, truth, rtol=0, atol=2e-4)
    np.testing.assert_allclose(photometric(seen, "Jy").brightness, janskys * share * omega, rtol=1e-4)


def test_zero_points_are_those_of_astropy() -> None:
    assert (0 * units.ABmag).to(units.Jy).value == pytest.approx(AB_ZERO, rel=1e-12)


def test_vega_magnitudes_against_published_offsets() -> None:
    """AB minus Vega by Blanton & Roweis (2007, AJ 133, 734, table 1), with their own spectrum of Vega and curves."""
    published = {"U": 0.79, "B": -0.09, "V": 0.02, "R": 0.21, "I": 0.45}
    seen = image(1e-9 * np.ones(WL.size)).through(",".join(BROAD))
    offsets = photometric(seen, "ABmag/arcsec2").brightness - photometric(seen, "Vegamag/arcsec2").brightness
    found = dict(zip(seen.names, offsets.values[0, 0], strict=True))
    for name, offset in published.items():
        assert found[name] == pytest.approx(offset, abs=0.05), name
    # A star of magnitude 0 in each filter, spread over a square arc second.
    for k, name in enumerate(seen.names):
        zero = VEGA_ZERO[name] * (np.pi / 648000) ** -2
        assert conversion(seen, "Vegamag arcsec-2").value(np.full(5, zero))[k] == pytest.approx(0.0, abs=1e-12)


def test_errors_of_magnitudes() -> None:
    seen = image(1e-9 * np.ones(WL.size)).through("B,V")
    data = photometric(seen, "ABmag arcsec-2")
    np.testing.assert_allclose(data["brightness_error"], 0.01 * 2.5 / np.log(10), rtol=1e-9)
    dark = SpectralImage(np.array([[[0.0, -1.0, 1.0]]]), [400.0, 500.0, 600.0], np.full((1, 1, 3), 0.1))
    found = photometric(dark, "ABmag arcsec-2")
    assert np.isnan(found["brightness"].values).tolist() == [[[True, True, False]]]
    assert np.isnan(found["brightness_error"].values).tolist() == [[[True, True, False]]]


@pytest.mark.parametrize("curve", [*TRIANGLES, filter_curve("oiii")], ids=lambda c: c.name)
def test_counts_through_a_filter(curve: FilterCurve) -> None:
    def spectrum(wl: float) -> float:
        return 1e-9 * (1 + (wl - 500.0) / 300.0)

    fine = np.arange(470.0, 640.0, 0.5)
    seen = image(spectrum(fine), fine).through([curve])
    unit = Counts(collecting_area_m2=4.5, exposure_s=600.0, throughput=0.3)
    found = photometric(seen, unit)["brightness"].values[0, 0, 0]
    # Photons counted by hand; a response per energy is one per photon at the pivot wavelength.
    level = 1.0 if curve.weighting == "photon" else curve.pivot
    light = (
        integral(curve, lambda wl: spectrum(wl) * level * wl)
        * units.Unit("W m-2 sr-1 nm")
        / (constants.h * constants.c)
    )
    telescope = 4.5 * units.m**2 * 600 * units.s * 0.3 * SKY.pixel_solid_angle(4, 3)[0, 0] * units.sr
    assert found == pytest.approx((light * telescope).to_value(""), rel=2e-4)  # cells of half a nanometre


def test_counts_of_spectra_are_those_of_photon_noise() -> None:
    from skyscatter.image.instrument import photons_per_radiance

    made = image(1e-9 * np.ones(WL.size))
    found = photometric(made, Counts(collecting_area_m2=2.0, exposure_s=10.0))["brightness"]
    np.testing.assert_allclose(found, made.radiance * photons_per_radiance(made, 2.0, 10.0), rtol=1e-12)
    with pytest.raises(ValidationError, match="throughput"):
        Counts(collecting_area_m2=2.0, exposure_s=10.0, throughput=1.5)


def test_skies_of_planets_have_pixels_too() -> None:
    scene, camera = skyscatter.load_model("earth-simple").scene(), skyscatter.Fisheye(width=8, height=8)
    recipe = {"scene": scene.model_dump(mode="json", exclude_none=True), "camera": camera.model_dump()}
    made = SpectralImage(np.ones((8, 8, 1)), [500.0], recipe=recipe)
    data = photometric(made, "Jy")
    janskys = (1 * RADIANCE).to("Jy sr-1", units.spectral_density(500 * units.nm)).value
    np.testing.assert_allclose(data["brightness"][..., 0], janskys * camera.pixel_solid_angle(), rtol=1e-9)
    assert {"azimuth", "elevation", "solid_angle"} <= set(data.coords)
    with pytest.raises(DomainError, match="needs the pixel scale"):
        photometric(SpectralImage(np.ones((1, 1, 1)), [500.0]), "Jy")


@pytest.mark.parametrize(
    ("unit", "words"),
    [("mag", "no such unit"), ("Vegamag", "for the filters U, B, V, R, I")],
)
def test_unknown_units(unit: str, words: str) -> None:
    with pytest.raises(DomainError, match=words):
        photometric(image(1e-9 * np.ones(WL.size)), unit)
    for other in (TRIANGLES[0], NARROW and "halpha", FilterCurve.box("V", 550.0, 10.0)):
        with pytest.raises(DomainError, match="no zero point"):
            photometric(image(1e-9 * np.ones(WL.size)).through([other]), "Vegamag")


def test_files(tmp_path: Path) -> None:
    made = image(1e-9 * np.ones(WL.size))
    seen = made.through("B,V")
    truth = photometric(seen, "Vegamag arcsec-2")
    made.save(tmp_path / "mag.fits", filters="B,V", unit="Vegamag/arcsec2", compress=True)
    with fits.open(tmp_path / "mag.fits") as hdus:
        header = hdus[1].header
        assert (header["BUNIT"], header["MAGSYS"], header["FILTER2"]) == ("mag arcsec-2", "Vega", "V")
        assert units.Unit(header["BUNIT"]) == units.mag / units.arcsec**2
        np.testing.assert_array_equal(np.moveaxis(hdus[1].data[:, ::-1], 0, -1), truth["brightness"])
        np.testing.assert_array_equal(np.moveaxis(hdus["STDERR"].data[:, ::-1], 0, -1), truth["brightness_error"])
    with pytest.raises(DomainError, match=r"BUNIT = 'mag arcsec-2'.*read in spectral radiance"):
        FilterImage.load(tmp_path / "mag.fits")
    for unit in ("MJy sr-1", "Jy sr-1"):  # linear ones come back
        seen.save(tmp_path / "flux.fits", unit=unit)
        np.testing.assert_allclose(FilterImage.load(tmp_path / "flux.fits").radiance, seen.radiance, rtol=1e-9)
        made.save(tmp_path / "flux.fits", unit=unit)
        back = SpectralImage.load(tmp_path / "flux.fits")
        np.testing.assert_allclose(back.radiance, made.radiance, rtol=1e-9)
        np.testing.assert_allclose(back.standard_error, made.standard_error, rtol=1e-9)
    made.save(tmp_path / "mag.nc", unit="ABmag arcsec-2")
    with xarray.open_dataset(tmp_path / "mag.nc") as data:
        np.testing.assert_array_equal(data["brightness"], photometric(made, "ABmag arcsec-2")["brightness"])
        assert data["brightness"].attrs["magnitude_system"] == "AB"
    with pytest.raises(DomainError, match="holds brightness"):
        SpectralImage.load(tmp_path / "mag.nc")


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    run = ["sky", "earth-simple", "--size", "6x4", "--view", "fisheye", "--solver", "single"]
    run += ["--wavelengths", "360:720:20", "-q"]
    assert main([*run, "--filters", "B,V", "--unit", "Vegamag/arcsec2", "-o", "a.fits", "-o", "a.nc"]) == 2
    assert "for the filters" in capsys.readouterr().err  # the netCDF file has spectra
    assert main([*run, "--filters", "B,V", "--unit", "Vegamag/arcsec2", "-o", "sky.fits"]) == 0
    with fits.open("sky.fits") as hdus:
        assert hdus[0].header["BUNIT"] == "mag arcsec-2"
        day = hdus[0].data[1][np.isfinite(hdus[0].data[1])]
        assert json.loads(str(hdus["RECIPE"].data["JSON"][0]))["solver"] == "single"
    assert 3 < np.median(day) < 6  # a daylight sky is about 3 to 5 mag arcsec-2
    for options, words in (
        (["--filters", "U", "-o", "a.fits"], "the wavelengths cover"),
        (["--unit", "mag", "-o", "a.fits"], "no such unit"),
        (["--unit", "Jy", "-o", "a.exr"], "is for .fits and .nc files"),
        (["--filters", "V", "-o", "a.nc"], "is for .fits files"),
    ):
        assert main([*run, *options]) == 2
        assert words in capsys.readouterr().err
    assert main(["nebula", "dark-globule", "--unit", "count", "-o", "a.fits"]) == 2
    assert "give --aperture and --exposure-time" in capsys.readouterr().err


def telescope_picture(path: Path, unit: str | None = "MJy/sr", **cards: Any) -> np.ndarray:
    """A picture of two axes, as an observatory writes it."""
    values = np.random.default_rng(2).uniform(1.0, 2.0, (5, 7)).astype(">f4")
    header = fits.Header({
        "FILTER": "V", "CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CUNIT1": "deg", "CUNIT2": "deg", "CRPIX1": 4.0,
        "CRPIX2": 3.0, "CRVAL1": 83.8, "CRVAL2": -5.4, "CDELT1": -1e-3, "CDELT2": 1e-3, **cards,
    })  # fmt: skip
    if unit is not None:
        header["BUNIT"] = unit
    error = fits.ImageHDU(0.1 * values, name="ERR")
    fits.HDUList([fits.PrimaryHDU(values, header), error]).writeto(path, overwrite=True)
    return values[::-1].astype(float)


def test_pictures_through_one_filter_are_read(tmp_path: Path) -> None:
    path = tmp_path / "v.fits"
    values = telescope_picture(path)
    found = FilterImage.load(path)
    assert (found.names, found.radiance.shape) == (("V",), (5, 7, 1))
    at = units.spectral_density(filter_curve("V").pivot * units.nm)
    np.testing.assert_allclose(found.plane("V"), (values * units.Unit("MJy/sr")).to(RADIANCE, at).value, rtol=1e-6)
    np.testing.assert_allclose(found.standard_error[..., 0], 0.1 * found.plane("V"), rtol=1e-6)
    assert found.sky is not None
    assert (found.sky.ra_deg, found.sky.pixel_scale_deg) == (83.8, 1e-3)
    telescope_picture(path, "erg s-1 cm-2 Angstrom-1 arcsec-2")
    per_arcsec2 = (values / units.arcsec**2 * units.Unit("erg s-1 cm-2 Angstrom-1")).to(RADIANCE).value
    np.testing.assert_allclose(FilterImage.load(path).plane("V"), per_arcsec2, rtol=1e-6)
    telescope_picture(path, None)  # ours
    np.testing.assert_allclose(FilterImage.load(path).plane("V"), values, rtol=1e-6)
    np.testing.assert_allclose(FilterImage.load(path, "halpha").plane("halpha"), values, rtol=1e-6)


@pytest.mark.parametrize(
    ("unit", "cards", "words"),
    [
        ("adu", {}, "BUNIT = 'adu'"),
        ("MJy/sr", {"FILTER": ""}, "names no filter; add FILTER"),
        ("MJy/sr", {"FILTER": "F814W"}, "FILTER = 'F814W': no such filter"),
    ],
)
def test_pictures_that_do_not_say_are_refused(tmp_path: Path, unit: str, cards: dict[str, Any], words: str) -> None:
    path = tmp_path / "v.fits"
    telescope_picture(path, unit, **cards)
    with pytest.raises(DomainError, match=words) as error:
        FilterImage.load(path)
    assert "\n" not in str(error.value)
    telescope_picture(path)
    with pytest.raises(DomainError, match="has 1 planes"):
        FilterImage.load(path, "B,V")


def test_such_a_picture_is_data_of_an_inversion(tmp_path: Path) -> None:
    from skyscatter.inversion.readers import read_observation

    telescope_picture(tmp_path / "v.fits")
    data = read_observation(tmp_path / "v.fits", pixels=100)
    assert data.values.shape == (35,)
    np.testing.assert_allclose(data.sigma, 0.1 * data.values, rtol=1e-6)
    assert data.kind == "nebula image"


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("count", "is of a telescope with an area and an exposure"),
        ("counts", "is of a telescope with an area and an exposure"),
        ("ABmags", "did you mean ABmag?"),
        ("abmags", "did you mean ABmag?"),
        ("vegamags", "did you mean Vegamag?"),
    ],
)
def test_units_that_a_sky_cannot_have_are_refused_in_one_line(unit, words, capsys, tmp_path):
    from skyscatter.cli.main import main

    assert main(["sky", "earth", "--unit", unit, "-o", str(tmp_path / "sky.fits")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"skyscatter: error: unit = '{unit}': ")
    assert words in error
    assert error.count("\n") == 1
