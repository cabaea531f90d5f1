"""Filters: averages against integrals in closed form, planes of filters in FITS files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from pydantic import ValidationError
from scipy.integrate import quad

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.image import FilterImage, SpectralImage
from skyscatter.image.filters import BROAD, NARROW, FilterCurve, cells, filter_curve, filter_curves, with_narrow_bands
from skyscatter.image.skyframe import SkyFrame
from skyscatter.spectra.solar import blackbody_irradiance
from skyscatter.spectra.table import SpectralTable

SKY = SkyFrame(ra_deg=83.82, dec_deg=-5.39, pixel_scale_deg=7.0 / 3600.0, distance="414 pc", name="M 42")
WL = np.arange(380.0, 781.0, 10.0)


def image(spectrum: np.ndarray, error: float | None = 0.1, wavelengths: np.ndarray = WL) -> SpectralImage:
    cube = np.broadcast_to(spectrum, (2, 3, wavelengths.size)) * np.arange(1.0, 7.0).reshape(2, 3, 1)
    return SpectralImage(cube, wavelengths, None if error is None else error * cube, sky=SKY, recipe={"seed": 1})


def test_cells_meet_half_way() -> None:
    low, high = cells([400.0, 410.0, 440.0])
    np.testing.assert_array_equal(low, [395.0, 405.0, 425.0])
    np.testing.assert_array_equal(high, [405.0, 425.0, 455.0])
    assert cells([550.0]) == (np.array([549.5]), np.array([550.5]))


@pytest.mark.parametrize("name", [*BROAD, *NARROW])
def test_a_flat_spectrum_keeps_its_value(name: str) -> None:
    wavelengths = np.arange(300.0, 921.0, 5.0)
    weights, coverage = filter_curve(name).weights(wavelengths)
    assert weights.sum() == pytest.approx(1.0, rel=1e-13)  # rounding
    assert coverage == pytest.approx(1.0, rel=1e-12)  # rounding
    assert np.all(weights >= 0.0)


@pytest.mark.parametrize("weighting", ["photon", "energy"])
def test_averages_are_the_integrals(weighting: str) -> None:
    """A parabola through a triangular filter: the grid's cells converge to the integral at second order."""
    curve = FilterCurve(name="t", wavelengths=(500, 540, 620), response=(0, 0.7, 0), weighting=weighting)

    def spectrum(wl: float) -> float:
        return 1.0 + ((wl - 500.0) / 100.0) ** 2

    def integral(f: object) -> float:
        return quad(lambda wl: f(wl) * np.interp(wl, (500, 540, 620), (0, 0.7, 0)) * wl**power, 500, 620, points=[540])[
            0
        ]

    power = 1 if weighting == "photon" else 0
    expected = integral(spectrum) / integral(lambda wl: 1.0)
    misses = []
    for step in (4.0, 2.0, 1.0):
        wl = np.arange(480.0, 640.1, step)
        misses.append(float(curve.weights(wl)[0] @ spectrum(wl)) - expected)
    assert abs(misses[2]) < 1e-4
    # halving the cells quarters the error
    assert misses[0] / misses[1] == pytest.approx(4.0, rel=0.05)
    assert misses[1] / misses[2] == pytest.approx(4.0, rel=0.05)
    assert curve.centre == pytest.approx(integral(lambda wl: wl) / integral(lambda wl: 1.0), rel=1e-9)  # quadrature


def test_a_line_within_the_filter_counts_in_full() -> None:
    """A line's radiance is spread over its cell; the band of 2 nm averages it over 2 nm."""
    wavelengths = np.arange(650.46, 664.0, 0.5)
    spectrum = np.zeros(wavelengths.size)
    spectrum[12] = 3.0 / 0.5  # 3 W m-2 sr-1 in the cell at 656.46
    mean = image(spectrum, wavelengths=wavelengths).through("halpha").radiance[0, 0, 0]
    # weighted by photons: the line stands at the middle of the band, where the weight is the mean
    assert mean == pytest.approx(3.0 / 2.0, rel=1e-6)


def test_bessell_bands() -> None:
    """Effective wavelengths for an A0 star (Bessell, Castelli & Plez 1998, A&A 333, 231, table A2), without U.

    A black body of Vega's temperature stands for the star: it has neither lines nor the Balmer jump, which fills U.
    """
    wl = np.arange(300.0, 921.0, 1.0)
    light = blackbody_irradiance(wl, 9550.0, 1.0, 1.0)
    published = {"B": 438.0, "V": 545.0, "R": 641.0, "I": 798.0}
    for name, expected in published.items():
        weights = filter_curve(name).weights(wl)[0]
        # 4 nm: between 9550 and 15000 K, the temperatures of that star's continuum, R alone moves by 3.5 nm
        assert (weights * light) @ wl / (weights @ light) == pytest.approx(expected, abs=4.0)
    assert all(filter_curve(name).weighting == "energy" for name in BROAD)


def test_no_narrow_band_holds_a_line_of_another() -> None:
    lines = {
        "halpha": [656.46], "hbeta": [486.27], "oiii": [500.82], "nii": [658.53], "sii": [671.83, 673.27],
        "": [654.99, 496.03],
    }  # fmt: skip
    for name in NARROW:
        nodes = filter_curve(name).wavelengths
        inside = {other for other, where in lines.items() for wl in where if nodes[0] < wl < nodes[1]}
        assert inside == {name}


@pytest.mark.parametrize("names", ["halpha", "oiii,sii", "halpha,hbeta,oiii,nii,sii"])
def test_wavelengths_with_a_cell_for_each_band(names: str) -> None:
    curves = filter_curves(names)
    wavelengths = with_narrow_bands(WL, (*curves, filter_curve("V")))
    low, high = cells(wavelengths)
    assert wavelengths[0] == 380.0
    assert wavelengths[-1] == 780.0
    assert np.diff(wavelengths).min() > 1.0
    for curve in curves:
        cell = np.flatnonzero(np.isclose(wavelengths, sum(NARROW[curve.name][:1])))[0]
        # between Hα and [N II] the edge is half-way, 0.035 nm off each band's own
        np.testing.assert_allclose((low[cell], high[cell]), curve.wavelengths, atol=0.04)
        weights, coverage = curve.weights(wavelengths)
        assert weights[cell] > 0.98
        assert coverage > 0.99
    np.testing.assert_array_equal(with_narrow_bands(WL, [filter_curve("V")]), WL)
    own = FilterCurve.box("halpha", 500.0, 3.0)  # a name does not make a filter
    np.testing.assert_array_equal(with_narrow_bands(WL, [own]), WL)


def test_errors_of_wavelengths_combine() -> None:
    made = image(np.ones(WL.size))
    whole = made.through(["V"])
    np.testing.assert_allclose(whole.standard_error, 0.1 * whole.radiance, rtol=1e-12)  # a grey error stays
    weights = filter_curve("V").weights(WL)[0]
    independent = made.through(["V"], errors="independent").standard_error
    np.testing.assert_allclose(independent, 0.1 * np.sqrt((weights**2).sum()) * whole.radiance, rtol=1e-12)
    assert image(np.ones(WL.size), None).through("V").standard_error is None
    with pytest.raises(DomainError, match="correlated or independent"):
        made.through("V", errors="none")  # type: ignore[arg-type]


def test_filters_beyond_the_wavelengths_are_refused() -> None:
    with pytest.raises(DomainError, match=r"U.*300 to 420 nm.*375 to 785 nm, 29 %"):
        image(np.ones(WL.size)).through("B,U")
    partly = image(np.ones(WL.size)).through("R")
    assert 0.9 < partly.coverage[0] < 0.97
    np.testing.assert_allclose(partly.radiance[..., 0], image(np.ones(WL.size)).radiance[..., 0], rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("Z", "no such filter"),
        ("halfa", "did you mean halpha"),
        ("V,V", "named twice"),
        ([], "at least one"),
        ([3], "a name"),
    ],
)
def test_wrong_filters(given: object, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        filter_curves(given)  # type: ignore[arg-type]


def test_own_filters(tmp_path: Path) -> None:
    table = SpectralTable(wavelengths=(500.0, 510.0, 520.0), values=(0.0, 1.0, 0.0))
    expected = FilterCurve.from_table("mine", table)
    (tmp_path / "mine.csv").write_text("# by hand\nwavelength_nm, response\n500, 0\n510, 1.0  # peak\n520 0\n")
    assert filter_curve(tmp_path / "mine.csv") == expected
    assert filter_curve(str(tmp_path / "mine.csv")) == expected
    for text in ("500 0\n510\n", "a b\nc d\n", "510 1\n500 1\n", "500 -1\n510 1\n", ""):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(DomainError, match="two columns") as caught:
            filter_curve(tmp_path / "bad.csv")
        assert "\n" not in str(caught.value)
    with pytest.raises(MissingDataError, match="no such filter file"):
        filter_curve("none.csv")
    with pytest.raises(DomainError, match="width"):
        FilterCurve.box("w", 500.0, 0.0)
    with pytest.raises(ValidationError, match="at least 2"):
        FilterCurve(name="w", wavelengths=(500.0,), response=(1.0,))


@pytest.mark.parametrize("error", [None, 0.1])
def test_planes_of_filters_in_fits(tmp_path: Path, error: float | None) -> None:
    made = image(np.linspace(1.0, 2.0, WL.size), error)
    made.save(tmp_path / "a.fits", filters="R,V,oiii")
    expected = made.through(["R", "V", "oiii"])
    back = FilterImage.load(tmp_path / "a.fits")
    np.testing.assert_array_equal(back.radiance, expected.radiance)
    assert (back.standard_error is None) == (error is None)
    assert (back.filters, back.coverage, back.recipe) == (expected.filters, expected.coverage, made.recipe)
    assert back.sky is not None
    assert back.sky.name == "M 42"
    np.testing.assert_array_equal(back.plane("V"), expected.radiance[..., 1])
    with fits.open(tmp_path / "a.fits", checksum=True) as hdus:
        for hdu in [hdus[0]] if error is None else [hdus[0], hdus["STDERR"]]:
            assert [hdu.header[f"FILTER{n}"] for n in (1, 2, 3)] == ["R", "V", "oiii"]
            assert hdu.header["BUNIT"] == "W m-2 sr-1 nm-1"
            ra, dec, plane = WCS(hdu.header).wcs_pix2world([[1.0, 0.5, 2.0]], 0)[0]
            np.testing.assert_allclose([ra, dec, plane], [SKY.ra_deg, SKY.dec_deg, 3.0], rtol=1e-12)  # rounding
        np.testing.assert_array_equal(hdus[0].data[1, 1], expected.radiance[0, :, 1])  # the first row is the top
        assert list(hdus["FILTERS"].data["NAME"]) == ["R", "V", "oiii"]
        assert hdus["FILTERS"].data["COVERAGE"][0] < 0.97
        hdus.verify("exception")


def test_layers_pass_the_filters(tmp_path: Path) -> None:
    cube = image(np.ones(WL.size)).radiance
    layers = {"order1": 0.25 * cube, "Q": 0.5 * cube, "U": 0 * cube, "V": 0 * cube, "Q_error": 0.1 * cube}
    made = SpectralImage(cube, WL, layers=layers)
    made.save(tmp_path / "a.fits", filters="V,R")
    back = FilterImage.load(tmp_path / "a.fits")
    assert list(back.layers) == list(layers)
    np.testing.assert_allclose(back.layers["order1"], 0.25 * back.radiance, rtol=1e-12)  # rounding
    weights = filter_curve("V").weights(WL)[0]
    independent = made.through("V", errors="independent").layers
    np.testing.assert_allclose(independent["Q_error"], 0.1 * np.sqrt((weights**2).sum()) * cube[..., :1], rtol=1e-12)
    np.testing.assert_allclose(independent["Q"], 0.5 * cube[..., :1], rtol=1e-12)
    with pytest.raises(DomainError, match="layer a"):
        FilterImage(np.ones((2, 3, 1)), "V", layers={"a": np.ones((3, 2, 1))})


def test_files_of_the_other_kind_say_so(tmp_path: Path) -> None:
    made = image(np.ones(WL.size))
    made.save(tmp_path / "planes.fits", filters="V")
    made.save(tmp_path / "spectra.fits")
    with pytest.raises(DomainError, match=r"FilterImage\.load"):
        SpectralImage.load(tmp_path / "planes.fits")
    with pytest.raises(DomainError, match=r"SpectralImage\.load"):
        FilterImage.load(tmp_path / "spectra.fits")
    with pytest.raises(MissingDataError):
        FilterImage.load(tmp_path / "none.fits")
    with pytest.raises(DomainError, match=r"\.fits files"):
        made.through("V").save(tmp_path / "a.exr")


def test_filter_images_check_their_shapes() -> None:
    with pytest.raises(DomainError, match="with 2 filters"):
        FilterImage(np.ones((2, 3, 1)), "V,R")
    with pytest.raises(DomainError, match="shape of the radiance"):
        FilterImage(np.ones((2, 3, 1)), "V", np.ones((3, 2, 1)))
    with pytest.raises(DomainError, match="finite"):
        FilterImage(np.full((2, 3, 1), np.inf), "V")
    with pytest.raises(DomainError, match="one of V"):
        FilterImage(np.ones((2, 3, 1)), "V").plane("R")


def test_filters_are_given_in_every_way() -> None:
    made = image(np.ones(WL.size))
    names = [[curve.name for curve in made.through(*given).filters] for given in (("B,V",), ("B", "V"), (["B", "V"],))]
    assert names[0] == names[1] == names[2]
    with pytest.raises(DomainError, match="filters"):
        made.through()
