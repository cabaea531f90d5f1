"""Celestial coordinates of pictures: kept by every file, understood by astropy.wcs and reproject."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from astropy import units
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS
from pydantic import ValidationError

from skyscatter.errors import DomainError
from skyscatter.geometry import Telescope
from skyscatter.image import SpectralImage
from skyscatter.image.netcdf import from_dataset
from skyscatter.image.skyframe import SkyFrame
from skyscatter.units import PARSEC

ORION = SkyFrame(ra_deg=83.82, dec_deg=-5.39, pixel_scale_deg=7.0 / 3600.0, distance="414 pc", name="M 42")
PLACES = [
    ORION,
    SkyFrame(ra_deg=359.999, dec_deg=89.95, pixel_scale_deg=0.01),
    SkyFrame(ra_deg=0.0, dec_deg=-90.0, pixel_scale_deg=1.0),
]
GRIDS = {"uniform": [400.0, 500.0, 600.0], "uneven": [400.0, 500.0, 700.0]}


def sample(sky: SkyFrame | None = ORION, grid: str = "uniform", size: tuple[int, int] = (12, 19)) -> SpectralImage:
    radiance = np.random.default_rng(3).random((*size, 3))
    return SpectralImage(
        radiance, GRIDS[grid], 0.1 * radiance, recipe={"seed": 3}, layers={"order-1": radiance / 2}, sky=sky
    )


def same(one: SkyFrame | None, other: SkyFrame | None) -> None:
    assert one is not None
    assert other is not None
    assert (one.name, one.frame, one.distance is None) == (other.name, other.frame, other.distance is None)
    for name in ("ra_deg", "dec_deg", "pixel_scale_deg", "distance", "inclination_deg", "azimuth_deg"):
        if getattr(other, name) is not None:
            # a FITS card has room for 15 digits of a long number
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-13)


@pytest.mark.parametrize("extension", ["fits", "exr", "nc"])
@pytest.mark.parametrize("place", PLACES, ids=["equator", "pole", "south"])
def test_files_keep_the_frame(tmp_path: Path, extension: str, place: SkyFrame) -> None:
    made = sample(place)
    made.save(tmp_path / f"a.{extension}")
    back = SpectralImage.load(tmp_path / f"a.{extension}")
    same(back.sky, place)
    assert back.recipe == made.recipe
    np.testing.assert_allclose(back.radiance, made.radiance, rtol=1e-7)  # float32 of OpenEXR
    sample(None).save(tmp_path / f"b.{extension}")
    assert SpectralImage.load(tmp_path / f"b.{extension}").sky is None


def test_layers_keep_the_frame() -> None:
    assert sample().layer("order-1").sky == ORION


@pytest.mark.parametrize("grid", list(GRIDS))
@pytest.mark.parametrize("place", PLACES, ids=["equator", "pole", "south"])
def test_astropy_finds_every_pixel(tmp_path: Path, grid: str, place: SkyFrame) -> None:
    made = sample(place, grid)
    made.save(tmp_path / "a.fits")
    ra, dec = place.coordinates(19, 12)
    y, x = np.mgrid[:12, :19]
    with fits.open(tmp_path / "a.fits") as hdus:
        for hdu in (hdus[0], hdus["STDERR"], hdus["LAYER1"]):
            wcs = WCS(hdu.header, hdus)
            assert list(wcs.world_axis_physical_types) == ["pos.eq.ra", "pos.eq.dec", "em.wl"]
            world = wcs.wcs_pix2world(np.column_stack([x.ravel(), 11 - y.ravel(), np.ones(x.size)]), 0)
            wavelengths = (world[:, 2] * units.Unit(wcs.world_axis_units[2])).to_value("nm")
            np.testing.assert_allclose(wavelengths, 500.0, rtol=1e-12)  # rounding
            theirs, ours = SkyCoord(world[:, 0], world[:, 1], unit="deg"), SkyCoord(ra.ravel(), dec.ravel(), unit="deg")
            # 15 digits of the pixel scale, and rounding of degrees up to 360
            assert theirs.separation(ours).deg.max() < 1e-12
            middle = wcs.celestial.pixel_to_world(9.0, 5.5)
            assert middle.icrs.separation(SkyCoord(place.ra_deg, place.dec_deg, unit="deg")).deg < 1e-12


def test_frame_of_a_view_and_a_telescope(tmp_path: Path) -> None:
    turned = {"inclination_deg": 35.0, "azimuth_deg": -20.5, "position_angle_deg": 110.0}
    view = SimpleNamespace(ra_deg=83.8, dec_deg=-5.4, distance=3e18, **turned)
    sky = SkyFrame.seen(view, Telescope(width=19, height=12, pixel_scale_deg=0.01), "pillar")
    assert sky.model_dump() == {
        **turned, "ra_deg": 83.8, "dec_deg": -5.4, "distance": 3e18, "pixel_scale_deg": 0.01, "name": "pillar",
        "frame": "icrs",
    }  # fmt: skip
    for extension in ("fits", "exr", "nc"):
        sample(None).placed(sky).save(tmp_path / f"a.{extension}")
        same(SpectralImage.load(tmp_path / f"a.{extension}").sky, sky)
    header = fits.getheader(tmp_path / "a.fits")
    assert (header["INCLINAT"], header["AZIMUTH"], header["POSANGLE"]) == (35.0, -20.5, 110.0)


def test_directions_in_the_sky(tmp_path: Path) -> None:
    ra, dec = ORION.coordinates(19, 12)
    assert ra[5, 0] > ORION.ra_deg > ra[5, 18]  # east is left
    assert dec[0, 9] > ORION.dec_deg > dec[11, 9]  # north is up, the first row the top
    # one pixel is one pixel scale: second order in 7" is 1e-9
    assert dec[5, 9] - dec[6, 9] == pytest.approx(ORION.pixel_scale_deg, rel=1e-8)
    made = sample()
    made.save(tmp_path / "a.fits")
    with fits.open(tmp_path / "a.fits") as hdus:
        column, row = WCS(hdus[0].header).celestial.wcs_world2pix([[ra[2, 4], dec[2, 4]]], 0)[0]
        assert hdus[0].data[1, round(row), round(column)] == made.radiance[2, 4, 1]


def test_header_says_what_and_how_far(tmp_path: Path) -> None:
    sample().save(tmp_path / "a.fits")
    header = fits.getheader(tmp_path / "a.fits")
    assert (header["OBJECT"], header["RADESYS"], header["BUNIT"]) == ("M 42", "ICRS", "W m-2 sr-1 nm-1")
    assert header["DISTANCE"] == pytest.approx(414.0, rel=1e-14)  # rounding
    assert "pc" in header.comments["DISTANCE"]


def test_celestial_headers_by_others(tmp_path: Path) -> None:
    sample().save(tmp_path / "a.fits")
    for change in ({"CRPIX1": 3.0}, {"CDELT1": -1.0}, {"PC1_2": 0.5}, {"CTYPE1": "RA---SIN"}, {"RADESYS": "FK5"}):
        with fits.open(tmp_path / "a.fits") as hdus:
            hdus[0].header.update(change)
            hdus.writeto(tmp_path / "b.fits", overwrite=True)
        back = SpectralImage.load(tmp_path / "b.fits")
        assert back.sky is None, change
        np.testing.assert_array_equal(back.radiance, sample().radiance)


@pytest.mark.parametrize("turned", [False, True])
def test_a_matrix_of_steps_says_the_same(tmp_path: Path, turned: bool) -> None:
    sample().save(tmp_path / "a.fits")
    with fits.open(tmp_path / "a.fits") as hdus:
        header = hdus[0].header
        for axis in "12":
            header[f"CD{axis}_{axis}"] = header.pop(f"CDELT{axis}")
        if turned:
            header["CD1_2"] = 1e-5
        hdus.writeto(tmp_path / "b.fits", overwrite=True)
    back = SpectralImage.load(tmp_path / "b.fits")
    assert (back.sky is None) == turned
    assert turned or back.sky.pixel_scale_deg == pytest.approx(ORION.pixel_scale_deg, rel=1e-13)


def test_dataset_has_celestial_coordinates() -> None:
    made = sample()
    data = made.dataset
    ra, dec = ORION.coordinates(19, 12)
    np.testing.assert_array_equal(data["ra"], ra)
    np.testing.assert_array_equal(data["dec"], dec)
    assert data["radiance"].coords["dec"].attrs["units"] == "degree"
    assert from_dataset(data).sky == ORION
    assert "ra" not in sample(None).dataset.coords
    with pytest.raises(DomainError, match="no celestial frame"):
        from_dataset(data.assign_attrs(sky='{"ra_deg": 1.0}'))


def test_netcdf_keeps_the_coordinates(tmp_path: Path) -> None:
    sample().save(tmp_path / "a.nc")
    with xarray.open_dataset(tmp_path / "a.nc") as data:
        np.testing.assert_array_equal(data["ra"], ORION.coordinates(19, 12)[0])


@pytest.mark.parametrize(
    "change",
    [
        {"ra_deg": 360.0},
        {"dec_deg": 91.0},
        {"pixel_scale_deg": 0.0},
        {"distance": "-1 pc"},
        {"frame": "fk5"},
        {"name": "é"},
    ],
)
def test_frames_that_mean_nothing(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SkyFrame(**{**ORION.model_dump(), **change})
    with pytest.raises(DomainError, match="must be a SkyFrame"):
        sample({"ra_deg": 3.0})  # type: ignore[arg-type]


def test_solid_angles_are_those_of_the_telescope() -> None:
    view = SimpleNamespace(forward=[1.0, 0.0, 0.0], right=[0.0, 1.0, 0.0], up=[0.0, 0.0, 1.0])
    wide = SkyFrame(ra_deg=1.0, dec_deg=2.0, pixel_scale_deg=3.0)
    camera = Telescope(width=19, height=12, pixel_scale_deg=3.0)
    np.testing.assert_allclose(wide.pixel_solid_angle(19, 12), camera.pixel_solid_angle(view), rtol=1e-13)  # rounding


def test_distance_takes_units_of_astronomy() -> None:
    assert ORION.distance == pytest.approx(414 * PARSEC, rel=1e-15)


def blob(ra: np.ndarray, dec: np.ndarray) -> np.ndarray:
    """A smooth surface brightness over the sky, Gaussian with 60 pixels of ORION."""
    width = 60 * ORION.pixel_scale_deg
    across = ((ra - ORION.ra_deg + 180.0) % 360.0 - 180.0) * np.cos(np.radians(ORION.dec_deg))
    return np.exp(-0.5 * (across**2 + (dec - ORION.dec_deg) ** 2) / width**2)


def test_reproject_conserves_surface_brightness(tmp_path: Path) -> None:
    reproject = pytest.importorskip(
        "reproject", reason="reproject, the independent reader of our WCS, is not installed"
    )
    ra, dec = ORION.coordinates(120, 100)
    cube = np.repeat(blob(ra, dec)[..., None], 3, axis=2)
    SpectralImage(cube, GRIDS["uniform"], cube, sky=ORION).save(tmp_path / "a.fits")
    target = WCS(naxis=2)
    target.wcs.ctype, target.wcs.crval = ["RA---TAN", "DEC--TAN"], [ORION.ra_deg + 0.01, ORION.dec_deg - 0.02]
    target.wcs.crpix, target.wcs.cdelt = [30.0, 25.0], [-1.3 * ORION.pixel_scale_deg, 1.3 * ORION.pixel_scale_deg]
    turn = np.radians(25.0)
    target.wcs.pc = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    j, i = np.mgrid[:40, :45]
    where = target.wcs_pix2world(np.column_stack([i.ravel(), j.ravel()]), 0)
    expected = blob(where[:, 0], where[:, 1]).reshape(40, 45)
    with fits.open(tmp_path / "a.fits") as hdus:
        for hdu in (hdus[0], hdus["STDERR"]):
            wcs = WCS(hdu.header, hdus).celestial
            moved, covered = reproject.reproject_interp((hdu.data[1], wcs), target, shape_out=(40, 45))
            column, row = wcs.wcs_world2pix(where, 0).T.reshape(2, 40, 45)
            # beyond the outermost pixel centres there is nothing to interpolate between
            between = (column >= 0) & (column <= 119) & (row >= 0) & (row <= 99)
            assert between.mean() > 0.9
            assert covered[between].min() > 0
            # bilinear interpolation of the Gaussian is off by up to 1 / 8 (1 / 60)^2 for each axis
            np.testing.assert_allclose(moved[between], expected[between], atol=2 / 8 / 60**2)
