"""FITS: exact round trips, and a spectral axis that astropy.wcs understands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.io import fits
from astropy.wcs import WCS

from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage

GRIDS = {
    "uniform": np.linspace(380.0, 780.0, 32),
    "uneven": np.array([380.0, 400.1, 450.7, 600.0, 779.9]),
    "pair": np.array([450.0, 650.0]),
    "single": np.array([550.0]),
}


def sample(grid: str, dtype: type = np.float64) -> SpectralImage:
    wavelengths = GRIDS[grid]
    radiance = np.random.default_rng(3).random((4, 7, wavelengths.size)).astype(dtype)
    radiance[3, 6] = np.nan
    recipe = {"model": "earth", "name": "Größe 'x' & \"y\" " + 200 * "long ", "sun": [1.5, 2]}
    return SpectralImage(
        radiance, wavelengths, 0.1 * radiance, recipe=recipe, layers={"order-1": radiance / 2, "Ground": radiance / 4}
    )


@pytest.mark.parametrize("grid", list(GRIDS))
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_round_trip_is_exact(tmp_path: Path, grid: str, dtype: type) -> None:
    made = sample(grid, dtype)
    made.save(tmp_path / "sky.fits")
    back = SpectralImage.load(tmp_path / "sky.fits")
    assert back.radiance.dtype == dtype
    np.testing.assert_array_equal(back.radiance, made.radiance)
    np.testing.assert_array_equal(back.standard_error, made.standard_error)
    np.testing.assert_array_equal(back.wavelengths, made.wavelengths)
    assert back.recipe == made.recipe
    assert list(back.layers) == list(made.layers)
    for name, cube in made.layers.items():
        np.testing.assert_array_equal(back.layers[name], cube)


def test_an_image_without_extras(tmp_path: Path) -> None:
    SpectralImage(np.ones((2, 3, 2)), [400.0, 500.0]).save(tmp_path / "sky.fits")
    back = SpectralImage.load(tmp_path / "sky.fits")
    assert back.standard_error is None
    assert back.layers == {}
    assert back.recipe == {}


@pytest.mark.parametrize("grid", ["uniform", "uneven", "pair"])
def test_astropy_reads_the_wavelengths_from_the_header(tmp_path: Path, grid: str) -> None:
    made = sample(grid)
    made.save(tmp_path / "sky.fits")
    with fits.open(tmp_path / "sky.fits") as hdus:
        for hdu in (hdus[0], hdus["STDERR"], hdus["LAYER1"]):
            wcs = WCS(hdu.header, hdus)
            assert wcs.world_axis_physical_types[2] == "em.wl"
            axis = wcs.wcs_pix2world(np.column_stack([np.zeros((made.shape[2], 2)), np.arange(made.shape[2])]), 0)[:, 2]
            wavelengths = (axis * units.Unit(wcs.world_axis_units[2])).to_value("nm")
            # 1e-11: a header card has room for 13 digits or so, and the wavelengths come back in metres
            np.testing.assert_allclose(wavelengths, made.wavelengths, rtol=1e-11)


def test_header(tmp_path: Path) -> None:
    made = sample("uniform")
    made.save(tmp_path / "sky.fits")
    with fits.open(tmp_path / "sky.fits", checksum=True) as hdus:  # a wrong checksum would warn, and fail here
        header = hdus[0].header
        assert units.Unit(header["BUNIT"]) == units.Unit("W m-2 sr-1 nm-1")
        assert {"CHECKSUM", "DATASUM", "DATE", "CREATOR"} <= set(header)
        assert hdus[0].data.shape == (32, 4, 7)
        # Row 1 of FITS is the bottom of the picture.
        np.testing.assert_array_equal(hdus[0].data[0, 0], made.radiance[3, :, 0])
        hdus.verify("exception")


def test_cubes_by_others(tmp_path: Path) -> None:
    header = fits.Header({"CTYPE3": "WAVE", "CUNIT3": "m", "CRPIX3": 1, "CRVAL3": 5e-7, "CDELT3": 1e-8})
    fits.PrimaryHDU(np.ones((3, 2, 2), dtype=">f4"), header).writeto(tmp_path / "other.fits")
    image = SpectralImage.load(tmp_path / "other.fits")
    np.testing.assert_allclose(image.wavelengths, [500.0, 510.0, 520.0], rtol=1e-12)  # rounding
    header["CUNIT3"] = "furlong"
    fits.PrimaryHDU(np.ones((3, 2, 2)), header).writeto(tmp_path / "unit.fits")
    with pytest.raises(DomainError, match="m, um, nm or Angstrom"):
        SpectralImage.load(tmp_path / "unit.fits")
    fits.PrimaryHDU(np.ones((3, 2, 2))).writeto(tmp_path / "axis.fits")
    with pytest.raises(DomainError, match="no wavelength axis"):
        SpectralImage.load(tmp_path / "axis.fits")
    fits.PrimaryHDU(np.ones((2, 2))).writeto(tmp_path / "flat.fits")
    with pytest.raises(DomainError, match="no cube"):
        SpectralImage.load(tmp_path / "flat.fits")


def test_damaged_data_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "sky.fits"
    for compress in (False, True):
        sample("uniform").save(path, compress=compress)
        whole = bytearray(path.read_bytes())
        with fits.open(path) as hdus:
            places = [hdu.fileinfo()["datLoc"] + 40 for hdu in hdus if hdu.fileinfo()["datSpan"]]
        assert len(places) >= 5  # radiance, error, two layers, wavelengths, recipe
        for place in places:
            damaged = whole.copy()
            damaged[place] ^= 1
            path.write_bytes(damaged)
            with pytest.raises(DomainError, match="do not match their checksum") as error:
                SpectralImage.load(path)
            assert "\n" not in str(error.value)
        path.write_bytes(whole)
        assert SpectralImage.load(path).shape == (4, 7, 32)


def test_edited_headers_are_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "sky.fits"
    sample("uniform").save(path)
    path.write_bytes(path.read_bytes().replace(b"'simulated'", b"'my camera'", 1))
    assert SpectralImage.load(path).shape == (4, 7, 32)


@pytest.mark.parametrize("grid", ["uniform", "uneven"])
def test_compressed_and_in_single_precision(tmp_path: Path, grid: str) -> None:
    made = sample(grid)
    made.save(tmp_path / "sky.fits", dtype="float32", compress=True)
    back = SpectralImage.load(tmp_path / "sky.fits")
    np.testing.assert_array_equal(back.radiance, made.radiance.astype(np.float32))
    np.testing.assert_array_equal(back.standard_error, made.standard_error.astype(np.float32))
    np.testing.assert_array_equal(back.wavelengths, made.wavelengths)
    assert list(back.layers) == list(made.layers)
    assert back.recipe == made.recipe
    with fits.open(tmp_path / "sky.fits", disable_image_compression=True) as hdus:
        assert hdus[1].header["ZCMPTYPE"] == "GZIP_2"
    made.save(tmp_path / "plain.fits", dtype="float32")
    with fits.open(tmp_path / "plain.fits") as hdus:
        assert {hdu.header["BITPIX"] for hdu in hdus if hdu.is_image} == {-32}
    with pytest.raises(DomainError, match="float32, float64"):
        made.save(tmp_path / "sky.fits", dtype="float16")
    bright = SpectralImage(np.full((1, 1, 1), 1e39), [500.0])
    with pytest.raises(DomainError, match="too large for float32"):
        bright.save(tmp_path / "sky.fits", dtype="float32")
