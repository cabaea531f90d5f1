"""Rasters and pictures as they come: names, scales and gaps; pictures upright; bad files say what is wrong."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

rasterio = pytest.importorskip("rasterio")

from PIL import Image, ImageCms, ImageOps  # noqa: E402
from rasterio.enums import ColorInterp  # noqa: E402

from skyscatter.dehaze.options import SourceOptions  # noqa: E402
from skyscatter.dehaze.rasters.arrays import ArraySource  # noqa: E402
from skyscatter.dehaze.rasters.base import NODATA, SATURATED  # noqa: E402
from skyscatter.dehaze.rasters.handles import environment  # noqa: E402
from skyscatter.dehaze.rasters.opening import open_raster  # noqa: E402
from skyscatter.dehaze.rasters.outputs import open_result  # noqa: E402
from skyscatter.dehaze.rasters.quicklook import write_quicklook  # noqa: E402
from skyscatter.dehaze.rasters.windows import for_each_window  # noqa: E402
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError  # noqa: E402

UTM = {"crs": "EPSG:32632", "transform": rasterio.Affine(10.0, 0.0, 4e5, 0.0, -10.0, 5e6)}
REFLECTANCE = SourceOptions(sensor="sentinel-2a", sun_zenith_deg=30.0)


def unchanged(row0, col0, values):
    return values


def tiff(path, numbers, names=(), colours=None, **profile):
    count, height, width = numbers.shape
    layout = {**UTM, "driver": "GTiff", "count": count, "height": height, "width": width, **profile}
    with rasterio.open(path, "w", dtype=numbers.dtype, **layout) as file:
        for number, name in enumerate(names, start=1):
            file.set_band_description(number, name)
        if colours:
            file.colorinterp = [ColorInterp[colour] for colour in colours]
        file.write(numbers)
    return path


def test_bands_are_told_by_what_the_file_says_and_not_by_position(tmp_path):
    numbers = np.stack([np.full((4, 5), value, np.uint8) for value in (10, 20, 30, 200)])
    path = tiff(tmp_path / "a.tif", numbers, colours=["blue", "green", "red", "alpha"], photometric="MINISBLACK")
    with open_raster(path) as source:
        assert [band.name for band in source.bands] == ["blue", "green", "red"]
        assert source.rgb() == (2, 1, 0)
        np.testing.assert_array_equal(source.read_alpha(0, 4, 0, 5), 200)
    path = tiff(tmp_path / "b.tif", numbers, names=["Band 8A", "B4 - Red", "B02", "nir"], photometric="MINISBLACK")
    with open_raster(path, SourceOptions(sensor="sentinel-2b", scale=1e-3, offset=0.0)) as source:
        assert [band.name for band in source.bands] == ["B8A", "B04", "B02", "nir"]
        assert [band.role for band in source.bands] == ["nir-narrow", "red", "blue", "nir"]
    with open_raster(path, SourceOptions(bands=("green=4", "3"))) as source:
        assert [(band.name, band.role) for band in source.bands] == [("green", "green"), ("B02", None)]
        np.testing.assert_allclose(source.read(0, 4, 0, 5)[:, 0, 0], [200 / 255, 30 / 255], rtol=1e-6)


def test_an_alpha_band_in_the_middle_keeps_its_place(tmp_path):
    numbers = np.random.default_rng(1).integers(1, 255, (4, 20, 30), dtype=np.uint8)
    numbers[1, :5] = 0
    path = tiff(tmp_path / "a.tif", numbers, colours=["red", "alpha", "green", "blue"], photometric="MINISBLACK")
    out = tmp_path / "out.tif"
    with open_raster(path) as source, open_result(out, source) as sink:
        for_each_window(source, sink, unchanged, size=16)
    with rasterio.open(out) as file:
        assert [colour.name for colour in file.colorinterp] == ["red", "alpha", "green", "blue"]
        np.testing.assert_array_equal(file.read(2), numbers[1])
        np.testing.assert_array_equal(file.read()[:, 5:], numbers[:, 5:])


def test_bits_in_use_set_the_white(tmp_path):
    numbers = np.array([[[0, 2048, 4095]]], dtype=np.uint16)
    path = tiff(tmp_path / "a.tif", numbers, NBITS=12)
    with open_raster(path) as source:
        values, flags = source.read_with_flags(0, 1, 0, 3)
    np.testing.assert_allclose(values[0, 0], [0.0, 2048 / 4095, 1.0], rtol=1e-6)
    assert flags.tolist() == [[0, 0, SATURATED]]


def test_scale_comes_from_the_file_the_options_or_not_at_all(tmp_path):
    numbers = np.full((1, 3, 3), 3000, np.uint16)
    path = tiff(tmp_path / "plain.tif", numbers)
    with pytest.raises(DomainError, match=r"plain\.tif holds uint16 and does not say what they mean; give scale and"):
        open_raster(path, REFLECTANCE)
    with pytest.raises(DomainError, match="give scale and offset"):
        open_raster(path, SourceOptions(sun_zenith_deg=30.0, offset=-0.1))
    told = SourceOptions(sun_zenith_deg=30.0, scale=1e-4, offset=-0.1)
    with open_raster(path, told) as source:
        assert source.quantity == "reflectance"
        np.testing.assert_allclose(source.read(0, 3, 0, 3), 0.2, rtol=1e-6)
    with open_raster(tiff(tmp_path / "signed.tif", numbers.astype(np.int16)), told) as source:
        np.testing.assert_allclose(source.read(0, 3, 0, 3), 0.2, rtol=1e-6)
    with pytest.raises(DomainError, match="signed numbers have no white"):
        open_raster(tmp_path / "signed.tif")
    with pytest.raises(DomainError, match="holds reflectance of 3000 in the middle"):
        open_raster(tiff(tmp_path / "floats.tif", numbers.astype(np.float32)), REFLECTANCE)


def test_every_band_of_reflectance_has_gaps_of_its_own(tmp_path):
    numbers = np.full((2, 3, 4), 3000, np.uint16)
    numbers[0, 0, 0] = 0
    numbers[:, 1, 1] = 0
    numbers[1, 2, 2] = 65535
    path = tiff(tmp_path / "a.tif", numbers, nodata=0)
    with open_raster(path, SourceOptions(sun_zenith_deg=1.0, scale=1e-4, offset=0.0)) as source:
        values, flags = source.read_with_flags(0, 3, 0, 4)
        assert np.argwhere(np.isnan(values)).tolist() == [[0, 0, 0], [0, 1, 1], [1, 1, 1]]
        assert flags[1, 1] == NODATA
        assert flags[0, 0] == 0
        assert np.argwhere(source.read_saturated(0, 3, 0, 4)).tolist() == [[2, 2]]


def test_black_in_one_band_of_a_picture_is_a_colour(tmp_path):
    numbers = np.array([[[0, 0, 9]], [[0, 7, 0]], [[0, 200, 0]]], dtype=np.uint8)
    with open_raster(tiff(tmp_path / "a.tif", numbers, nodata=0)) as source:
        values, flags = source.read_with_flags(0, 1, 0, 3)
        np.testing.assert_array_equal(flags, [[NODATA, 0, 0]])
        np.testing.assert_allclose(values[:, 0, 1:], numbers[:, 0, 1:] / 255, rtol=1e-6)
        np.testing.assert_array_equal(source.read(0, 1, 0, 3, bands=["red"])[0], values[0])


def test_what_stands_in_a_file_beside_the_raster_is_read(tmp_path):
    """GDAL's .aux.xml, as other programs write it for formats that hold no scale."""
    numbers = np.array([[[1000, 3000]]], dtype=np.uint16)
    path = tiff(tmp_path / "a.img", numbers, driver="ENVI")
    path.with_name("a.img.aux.xml").write_text(
        "<PAMDataset><PAMRasterBand band='1'><Offset>-0.1</Offset><Scale>0.0001</Scale></PAMRasterBand></PAMDataset>"
    )
    for context in (nullcontext(), environment()):
        with context, open_raster(path) as source:
            np.testing.assert_allclose(source.read(0, 1, 0, 2)[0, 0], [0.0, 0.2], rtol=0, atol=1e-7)


def test_a_raster_of_nothing_but_nodata_is_read_as_nothing(tmp_path):
    path = tiff(tmp_path / "a.tif", np.zeros((3, 20, 30), np.uint8), nodata=0)
    out = tmp_path / "out.tif"
    with open_raster(path) as source, open_result(out, source) as sink:
        values, flags = source.read_with_flags(0, 20, 0, 30)
        assert np.all(np.isnan(values))
        assert np.all(flags == NODATA)
        for_each_window(source, sink, unchanged)
    with rasterio.open(out) as file:
        assert not file.read().any()


def test_a_thumbnail_covers_the_whole_image(tmp_path):
    ramp = np.broadcast_to(np.arange(300, dtype=np.float32) / 300, (1, 200, 300)).copy()
    for source in (open_raster(tiff(tmp_path / "a.tif", ramp)), ArraySource(ramp)):
        with source:
            values, (down, across) = source.thumbnail(100)
            where = (np.arange(values.shape[2]) + 0.5) * across
            assert abs(values.shape[1] * down - 200) < down
            # The pixel nearest to the middle of each block, which is one or two steps of the ramp away at most.
            np.testing.assert_allclose(values[0, 0], where / 300, rtol=0, atol=2 / 300)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda path: path.write_bytes(b"this is no raster"), MissingDataError, "cannot be opened as a raster"),
        (lambda path: None, MissingDataError, "there is no such file"),
        (lambda path: tiff(path, np.zeros((1, 4, 4), np.complex64)), DomainError, "complex numbers"),
        (lambda path: tiff(path, np.zeros((1, 4, 4), np.int64)), DomainError, "convert it to one of"),
        (lambda path: tiff(path, np.zeros((1, 4, 4), np.uint8), photometric="palette"), DomainError, "palette"),
        (lambda path: path.mkdir(), MissingDataError, "holds neither"),
    ],
)
def test_bad_rasters_say_what_is_wrong(tmp_path, make, error, message):
    path = tmp_path / "bad.tif"
    make(path)
    with pytest.raises(error, match=message) as caught:
        open_raster(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("tail", [0.3, 0.9])
def test_a_raster_cut_short_leaves_no_output(tmp_path, tail):
    numbers = np.random.default_rng(4).integers(1, 255, (3, 400, 300), dtype=np.uint8)
    path = tiff(tmp_path / "cut.tif", numbers, compress="deflate")
    path.write_bytes(path.read_bytes()[: int(tail * path.stat().st_size)])
    out = tmp_path / "out.tif"
    with pytest.raises(MissingDataError, match="cut short") as caught:
        passed(path, out)
    assert "\n" not in str(caught.value)
    assert [one.name for one in tmp_path.iterdir()] == ["cut.tif"]


def test_a_file_with_subdatasets_and_no_bands_names_them(tmp_path):
    h5netcdf = pytest.importorskip("h5netcdf")
    path = tmp_path / "two.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"y": 4, "x": 5}
        for name in ("first", "second"):
            file.create_variable(name, ("y", "x"), float)[...] = 1.0
    with pytest.raises(DomainError, match=r"has no bands; it holds .*first"):
        open_raster(path)


PIXELS = np.random.default_rng(5).integers(0, 256, (12, 17, 3), dtype=np.uint8)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pictures_are_turned_upright(tmp_path, orientation):
    path, out = tmp_path / "a.png", tmp_path / "out.png"
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif[0x010F] = "maker"
    Image.fromarray(PIXELS).save(path, exif=exif)
    with Image.open(path) as picture:
        upright = np.asarray(ImageOps.exif_transpose(picture))
    with open_raster(path) as source, open_result(out, source) as sink:
        assert (source.height, source.width) == upright.shape[:2]
        np.testing.assert_array_equal(
            np.rint(255 * source.read(0, *upright.shape[:1], 0, upright.shape[1])), upright.transpose(2, 0, 1)
        )
        for_each_window(source, sink, unchanged, size=16)
    with Image.open(out) as picture:
        assert picture.getexif().get(0x0112, 1) == 1
        assert picture.getexif()[0x010F] == "maker"
        np.testing.assert_array_equal(np.asarray(picture), upright)


def passed(path, out, **options):
    with open_raster(path) as source, open_result(out, source, **options) as sink:
        for_each_window(source, sink, unchanged, size=16)
    return out


def test_colour_profiles_are_kept(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(PIXELS).save(tmp_path / "a.png", icc_profile=profile)
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", icc_profile=profile, quality=95, subsampling=0)
    for name in ("a.png", "a.jpg"):
        for suffix in (".png", ".jpg"):
            with Image.open(passed(tmp_path / name, tmp_path / f"out-{name}{suffix}")) as picture:
                assert picture.info["icc_profile"] == profile
    # The loss is that of one coding with this quality, and no more.
    with Image.open(tmp_path / "out-a.png.jpg") as picture, Image.open(tmp_path / "a.jpg") as once:
        np.testing.assert_array_equal(np.asarray(picture), np.asarray(once))


def test_pictures_of_all_kinds(tmp_path):
    Image.fromarray(PIXELS).convert("P").save(tmp_path / "palette.png")
    Image.fromarray(PIXELS[:, :, 0]).save(tmp_path / "grey.png")
    rgba = np.dstack([PIXELS, np.where(PIXELS[:, :, 0] > 60, 255, 0).astype(np.uint8)])
    Image.fromarray(rgba).save(tmp_path / "rgba.png")
    Image.fromarray(PIXELS).convert("CMYK").save(tmp_path / "print.jpg")
    with open_raster(tmp_path / "palette.png") as source:
        assert source.rgb() == (0, 1, 2)
    with open_raster(tmp_path / "print.jpg") as source:
        assert source.rgb() == (0, 1, 2)
    with Image.open(passed(tmp_path / "grey.png", tmp_path / "out.png")) as picture:
        np.testing.assert_array_equal(np.asarray(picture), PIXELS[:, :, 0])
    with open_raster(tmp_path / "rgba.png") as source:
        np.testing.assert_array_equal(np.isnan(source.read(0, 12, 0, 17)[1]), rgba[:, :, 3] == 0)
        with pytest.raises(DomainError, match="alpha"):
            open_result(tmp_path / "out.jpg", source)
    with Image.open(passed(tmp_path / "rgba.png", tmp_path / "clear.png")) as picture:
        expected = np.where(rgba[:, :, 3:] == 0, 0, rgba)
        np.testing.assert_array_equal(np.asarray(picture), expected)
    out = passed(tmp_path / "rgba.png", tmp_path / "out.tif")
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        file = rasterio.open(out)
    with file:
        assert [colour.name for colour in file.colorinterp] == ["red", "green", "blue", "alpha"]
        np.testing.assert_array_equal(file.read(), expected.transpose(2, 0, 1))


def test_sixteen_bits_stay_sixteen_bits(tmp_path):
    numbers = np.random.default_rng(6).integers(0, 65536, (3, 12, 17), dtype=np.uint16)
    path = tmp_path / "deep.png"
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        tiff(path, numbers, driver="PNG", crs=None, transform=None)
    out = passed(path, tmp_path / "out.png")
    with open_raster(out) as source:
        assert source.profile.dtype == "uint16"
        np.testing.assert_array_equal(np.rint(65535 * source.read(0, 12, 0, 17).astype(float)), numbers)
    shallow = passed(path, tmp_path / "shallow.png", dtype="uint8")
    with Image.open(shallow) as picture:
        np.testing.assert_allclose(np.asarray(picture), numbers.transpose(1, 2, 0) / 257, rtol=0, atol=0.501)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["deep.png", "out.png", "shallow.png"]


def test_a_raster_in_other_order_becomes_a_picture_in_red_green_blue(tmp_path):
    path = tiff(
        tmp_path / "a.tif", PIXELS.transpose(2, 0, 1)[::-1], colours=["blue", "green", "red"], photometric="MINISBLACK"
    )
    with Image.open(passed(path, tmp_path / "out.png")) as picture:
        np.testing.assert_array_equal(np.asarray(picture), PIXELS)
    path = tiff(tmp_path / "b.tif", PIXELS.transpose(2, 0, 1), photometric="MINISBLACK", colours=["undefined"] * 3)
    with open_raster(path) as source, pytest.raises(DomainError, match="red=1,green=2,blue=3"):
        open_result(tmp_path / "no.png", source)


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_bad_pictures_say_what_is_wrong(tmp_path, name):
    path = tmp_path / name
    noise = np.random.default_rng(7).integers(0, 256, (80, 90, 3), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(MissingDataError, match="cut short"):
        open_raster(path)
    path.write_text("nonsense")
    with pytest.raises(MissingDataError, match="is not a picture"):
        open_raster(path)


def test_pictures_that_are_said_to_be_reflectance_need_a_scale(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    with pytest.raises(DomainError, match="give scale and offset"):
        open_raster(tmp_path / "a.png", SourceOptions(sun_zenith_deg=30.0))
    source = open_raster(tmp_path / "a.png", SourceOptions(sun_zenith_deg=30.0, scale=1 / 255, offset=0.0))
    with pytest.raises(DomainError, match="a picture cannot hold reflectance"):
        open_result(tmp_path / "out.png", source)


def test_quicklooks_show_both_with_one_stretch(tmp_path):
    numbers = np.full((3, 40, 60), 2000, np.uint16)
    path = tiff(tmp_path / "a.tif", numbers, names=["B04", "B03", "B02"], nodata=0, photometric="MINISBLACK")
    options = SourceOptions(sensor="sentinel-2a", sun_zenith_deg=30.0, scale=1e-4, offset=0.0)
    out, look = tmp_path / "out.tif", tmp_path / "look.png"
    with open_raster(path, options) as source:
        with open_result(out, source) as sink:
            for_each_window(source, sink, lambda row0, col0, values: 0.25 * values)
        write_quicklook(look, source, out)
    with Image.open(look) as picture:
        pixels = np.asarray(picture)
    assert pixels.shape == (40, 60 + 8 + 60, 3)
    assert np.all(pixels[:, :60] == 255)  # white is the brighter one
    assert np.all(pixels[:, 68:] == round(255 * (1.055 * 0.25 ** (1 / 2.4) - 0.055)))  # a quarter, in the curve of sRGB


def test_quicklooks_of_pictures_show_them_as_they_are(tmp_path):
    path = tiff(
        tmp_path / "a.tif", PIXELS.transpose(2, 0, 1)[::-1], colours=["blue", "green", "red"], photometric="MINISBLACK"
    )
    for name in ("out.tif", "out.png"):
        look = tmp_path / f"look-{name}.png"
        with open_raster(path) as source:
            write_quicklook(look, source, passed(path, tmp_path / name))
        with Image.open(look) as picture:
            np.testing.assert_array_equal(np.asarray(picture)[:, :17], PIXELS)
            np.testing.assert_array_equal(np.asarray(picture)[:, 25:], PIXELS)


def test_one_line_for_a_disk_that_takes_no_picture(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    with open_raster(tmp_path / "a.png") as source, pytest.raises(SkyscatterError, match="directory does not exist"):
        open_result(tmp_path / "no" / "out.png", source)
