"""Sentinel-2 and Landsat products: numbers, angles and names from their metadata, and what is refused."""

from __future__ import annotations

import shutil
import tarfile

import numpy as np
import pytest
import satellite_products as made

rasterio = pytest.importorskip("rasterio")

from skyscatter.dehaze.flags import Flag  # noqa: E402
from skyscatter.dehaze.options import SourceOptions  # noqa: E402
from skyscatter.dehaze.rasters.base import NODATA, SATURATED  # noqa: E402
from skyscatter.dehaze.rasters.opening import open_raster  # noqa: E402
from skyscatter.dehaze.rasters.outputs import open_result  # noqa: E402
from skyscatter.dehaze.rasters.windows import for_each_window  # noqa: E402
from skyscatter.errors import DomainError, MissingDataError  # noqa: E402

#: Reflectances are float32 near 1, made by two operations.
ROUNDING = 3e-7


@pytest.fixture(scope="module")
def safe(tmp_path_factory):
    return made.write_safe(tmp_path_factory.mktemp("safe"))


@pytest.fixture(scope="module")
def landsat(tmp_path_factory):
    return made.write_landsat(tmp_path_factory.mktemp("landsat"))


def s2_reflectance(name, offset=-1000.0):
    numbers = made.S2_NUMBERS[name].astype(float)
    return np.where(numbers == 0, np.nan, (numbers + offset) / 10000.0)


def test_sentinel2_says_what_it_is(safe):
    with open_raster(safe) as source:
        assert [band.name for band in source.bands] == list(made.S2_BANDS)
        assert (source.height, source.width, source.quantity) == (made.S2_SIZE, made.S2_SIZE, "reflectance")
        assert source.sensor == "sentinel-2a"
        assert source.acquired.isoformat() == "2022-06-01T10:10:31.024000+00:00"
        assert source.sun_distance_au == pytest.approx(0.97**-0.5, rel=1e-12)
        assert source.rgb() == (3, 2, 1)
        blue = source.bands[source.band_index("blue")]
        assert (blue.name, blue.wavelength_nm, blue.resolution, blue.solar_irradiance) == ("B02", 470.0, 10.0, 1800.0)
        assert str(source.profile.crs) == "EPSG:32632"
        assert source.profile.transform == rasterio.Affine(10, 0, 399960, 0, -10, 5000040)


def test_sentinel2_bands_of_all_resolutions_meet_on_the_finest_grid(safe):
    with open_raster(safe) as source:
        values, flags = source.read_with_flags(0, 240, 0, 240)
    for place, name in enumerate(made.S2_BANDS):
        n = made.S2_RESOLUTIONS[name] // 10
        expected = s2_reflectance(name).repeat(n, axis=0).repeat(n, axis=1)
        np.testing.assert_allclose(values[place], expected, rtol=0, atol=7 * ROUNDING)
    assert np.all(flags[:30, :18] == NODATA)
    saturated = np.zeros((240, 240), dtype=bool)
    saturated[200, 100] = True
    saturated[180:186, 210:216] = True
    np.testing.assert_array_equal((flags & SATURATED) != 0, saturated)


def test_sentinel2_finer_bands_are_averaged_on_a_coarser_grid(safe):
    options = SourceOptions(resolution=20, bands=("B02", "B11", "B09"))
    with open_raster(safe, options) as source:
        assert source.profile.transform.a == 20.0
        values = source.read(0, 120, 0, 120)
    fine = s2_reflectance("B02").reshape(120, 2, 120, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(values[0], fine, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(values[1], s2_reflectance("B11"), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(values[2], s2_reflectance("B09").repeat(3, 0).repeat(3, 1), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("resolution", [10, 20])
def test_sentinel2_windows_of_any_place_hold_the_same_bits(safe, resolution):
    with open_raster(safe, SourceOptions(resolution=resolution)) as source:
        size = source.height
        whole, seen = source.read_with_flags(0, size, 0, size)
        for row0, row1, col0, col1 in ((0, 7, 0, 5), (13, 61, 29, 30), (size - 11, size, 17, size)):
            values, flags = source.read_with_flags(row0, row1, col0, col1)
            np.testing.assert_array_equal(values, whole[:, row0:row1, col0:col1])
            np.testing.assert_array_equal(flags, seen[row0:row1, col0:col1])


def test_sentinel2_before_the_offset(tmp_path):
    safe = made.write_safe(tmp_path, baseline="03.01", offset=None)
    with open_raster(safe, SourceOptions(bands=("red",))) as source:
        expected = s2_reflectance("B04", offset=0.0)
        np.testing.assert_allclose(source.read(0, 240, 0, 240)[0], expected, rtol=0, atol=7 * ROUNDING)


def test_sentinel2_angles_at_the_nodes(safe):
    (sun_zenith, sun_azimuth), left, right = made.s2_angles()
    with open_raster(safe) as source:
        geometry = source.geometry
    nodes = 8.0 * np.arange(23)  # 80 m apart, pixels of 10 m
    np.testing.assert_array_equal(geometry.rows, nodes)
    found = geometry.at(nodes, nodes)
    # Angles are written with four digits.
    np.testing.assert_allclose(found.sun_zenith_deg, sun_zenith, rtol=0, atol=1e-4)
    for columns, (view_zenith, view_azimuth) in ((slice(0, 12), left), (slice(13, 23), right)):
        np.testing.assert_allclose(found.view_zenith_deg[:, columns], view_zenith[:, columns], rtol=0, atol=1e-4)
        relative = np.abs((view_azimuth - sun_azimuth + 180.0) % 360.0 - 180.0)
        np.testing.assert_allclose(found.relative_azimuth_deg[:, columns], relative[:, columns], rtol=0, atol=1e-3)
    # In the column that both detectors see: the mean of azimuths 358 and 6 is 2, and not 182.
    middle = np.abs(2.0 - sun_azimuth[:, 12])
    np.testing.assert_allclose(found.relative_azimuth_deg[:, 12], middle, rtol=0, atol=1e-3)


def test_sentinel2_zipped_is_the_same(safe, tmp_path):
    archive = shutil.make_archive(str(tmp_path / "product"), "zip", safe.parent, safe.name)
    with open_raster(archive) as zipped, open_raster(safe) as plain, open_raster(safe / "MTD_MSIL1C.xml") as named:
        expected = plain.read(20, 90, 10, 70)
        np.testing.assert_array_equal(zipped.read(20, 90, 10, 70), expected)
        np.testing.assert_array_equal(named.read(20, 90, 10, 70), expected)


def test_sentinel2_results_keep_numbers_place_and_names(safe, tmp_path):
    out = tmp_path / "out.tif"
    with open_raster(safe) as source, open_result(out, source) as sink:
        for_each_window(source, sink, lambda row0, col0, values: values, size=100, threads=2)
    with rasterio.open(out) as file:
        assert file.descriptions == made.S2_BANDS
        assert file.nodata == 0.0
        assert file.scales[0] == pytest.approx(1e-4, rel=1e-12)
        assert file.offsets[0] == pytest.approx(-0.1, rel=1e-12)
        assert [colour.name for colour in file.colorinterp][1:4] == ["blue", "green", "red"]
        assert file.tags()["PROCESSING_BASELINE"] == "04.00"
        np.testing.assert_array_equal(file.read(4), made.S2_NUMBERS["B04"])
        np.testing.assert_array_equal(file.read(1), made.S2_NUMBERS["B01"].repeat(6, 0).repeat(6, 1))


def landsat_reflectance(number, sun_zenith):
    numbers = made.LANDSAT_NUMBERS[number].astype(float)
    return np.where(numbers == 0, np.nan, (2e-5 * numbers - 0.1) / np.cos(np.radians(sun_zenith)))


def test_landsat_reflectance_with_the_sun_at_each_pixel(landsat):
    with open_raster(landsat) as source:
        assert [band.name for band in source.bands] == ["B1", "B2", "B3", "B4", "B5", "B6", "B7", "B9"]
        assert [band.role for band in source.bands][1:5] == ["blue", "green", "red", "nir"]
        assert source.sensor == "landsat-8"
        assert source.acquired.isoformat() == "2022-06-01T10:04:05+00:00"
        assert source.sun_distance_au == 1.0140411
        values, flags = source.read_with_flags(0, 90, 0, 110)
        part = source.read(17, 40, 50, 93)
    np.testing.assert_array_equal(part, values[:, 17:40, 50:93])
    sun_zenith = made.landsat_angles()["SZA"]
    for place, number in enumerate(made.LANDSAT_NUMBERS):
        # Angles are in hundredths: half of one is 1e-4 of the cosine at 33 degrees, for reflectances up to 0.6.
        expected = landsat_reflectance(number, sun_zenith)
        np.testing.assert_allclose(values[place], expected, rtol=1e-4, atol=ROUNDING)
    assert np.all(flags[:8, :9] == NODATA)
    assert np.argwhere(flags & SATURATED).tolist() == [[50, 60]]


def test_landsat_clouds_and_shadows_of_the_product(tmp_path):
    place = made.write_landsat(tmp_path)
    quality = np.full(made.LANDSAT_SHAPE, 1 << 6, np.uint16)  # clear
    quality[30:40, 30:60], quality[40:44, 30:60], quality[50:55, 10:20] = 1 << 3, 1 << 1, 1 << 4
    with rasterio.open(next(place.glob("*_B4.TIF"))) as file:
        layout = file.profile
    path = place / next(place.glob("*_B4.TIF")).name.replace("_B4", "_QA_PIXEL")
    with rasterio.open(path, "w", **{**layout, "dtype": "uint16"}) as file:
        file.write(quality, 1)
    with open_raster(place) as source:
        assert any("QA_PIXEL" in note for note in source.notes)
        whole = source.read_with_flags(0, source.height, 0, source.width)[1]
        part = source.read_with_flags(35, 60, 15, 50)[1]
    there = (whole & Flag.NODATA) == 0
    assert np.array_equal((whole & Flag.CLOUD) != 0, ((quality & 0b1010) != 0) & there)
    assert np.array_equal((whole & Flag.SHADOW) != 0, ((quality & 0b10000) != 0) & there)
    assert (whole & Flag.CLOUD).any()
    assert (whole & Flag.SHADOW).any()
    assert np.array_equal(part, whole[35:60, 15:50])
    with rasterio.open(path, "w", **{**layout, "dtype": "uint16", "height": 7}) as file:
        file.write(quality[:7], 1)
    with pytest.raises(MissingDataError, match="QA_PIXEL"), open_raster(place):
        pass


@pytest.mark.parametrize("resolution", [10, 20, 60])
def test_sentinel2_clouds_of_the_product(tmp_path, resolution):
    """Opaque clouds from a raster of 60 m, on every grid; its cirrus is measured elsewhere."""
    safe = made.write_safe(tmp_path)
    with open_raster(safe, SourceOptions(resolution=60.0)) as source:
        height, width = source.height, source.width
        assert not any("MSK_CLASSI" in note for note in source.notes)
    classes = np.zeros((3, height, width), np.uint8)
    classes[0, 2:5, 3:9], classes[1, 6:8, 3:9], classes[2, :2] = 1, 1, 1
    folder = next(safe.glob("GRANULE/*")) / "QI_DATA"
    folder.mkdir()
    place = {"crs": "EPSG:32632", "transform": rasterio.Affine(60, 0, 399960, 0, -60, 5000040)}
    layout = {"driver": "JP2OpenJPEG", "count": 3, "dtype": "uint8", "QUALITY": 100, "REVERSIBLE": "YES", **place}
    with rasterio.open(folder / "MSK_CLASSI_B00.jp2", "w", height=height, width=width, **layout) as file:
        file.write(classes)
    with open_raster(safe, SourceOptions(resolution=float(resolution), bands=("B02", "B04"))) as source:
        assert any("MSK_CLASSI" in note for note in source.notes)
        whole = source.read_with_flags(0, source.height, 0, source.width)[1]
        part = source.read_with_flags(7, source.height - 1, 5, source.width - 2)[1]
    n = 60 // resolution
    expected = classes[0].astype(bool).repeat(n, 0).repeat(n, 1) & ((whole & Flag.NODATA) == 0)
    assert expected.any()
    assert np.array_equal((whole & Flag.CLOUD) != 0, expected)
    assert not (whole & Flag.CIRRUS).any()
    assert np.array_equal(part, whole[7:-1, 5:-2])
    with rasterio.open(folder / "MSK_CLASSI_B00.jp2", "w", height=2, width=width, **layout) as file:
        file.write(classes[:, :2])
    with pytest.raises(MissingDataError, match="MSK_CLASSI"), open_raster(safe):
        pass


OUTLINES = """<eop:Mask xmlns:eop="http://www.opengis.net/eop/2.0" xmlns:gml="http://www.opengis.net/gml/3.2">
 <eop:maskMembers>{features}</eop:maskMembers></eop:Mask>"""
OUTLINE = """<eop:MaskFeature><eop:maskType codeSpace="urn:gs2:S2PDGS:maskType">{kind}</eop:maskType><eop:extentOf>
 <gml:Polygon>{rings}</gml:Polygon></eop:extentOf></eop:MaskFeature>"""


def outlined(kind, *rings):
    """A feature with an outer ring and holes: lists of (column, row) on the grid of 60 m."""
    sides = ["exterior"] + ["interior"] * (len(rings) - 1)
    lists = (" ".join(f"{399960 + 60 * x} {5000040 - 60 * y}" for x, y in ring) for ring in rings)
    texts = (
        f'<gml:{side}><gml:LinearRing><gml:posList srsDimension="2">{points}</gml:posList></gml:LinearRing>'
        f"</gml:{side}>"
        for side, points in zip(sides, lists, strict=True)
    )
    return OUTLINE.format(kind=kind, rings="".join(texts))


def box(x0, y0, x1, y1):
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]


@pytest.mark.parametrize("resolution", [10, 20, 60])
def test_sentinel2_outlines_of_clouds(tmp_path, resolution):
    """Before baseline 04.00: polygons, of which those of cirrus are left to the band that measures it."""
    safe = made.write_safe(tmp_path, baseline="02.14", offset=None)
    path = next(safe.glob("GRANULE/*")) / "QI_DATA" / "MSK_CLOUDS_B00.gml"
    path.parent.mkdir()
    clouds = outlined("OPAQUE", box(3, 5, 16, 17), box(6, 8, 9, 12)) + outlined("OPAQUE", box(25, 30, 29, 33))
    path.write_text(OUTLINES.format(features=clouds + outlined("CIRRUS", box(20, 3, 30, 10))))
    coarse = np.zeros((40, 40), bool)
    coarse[5:17, 3:16] = coarse[30:33, 25:29] = True
    coarse[8:12, 6:9] = False
    with open_raster(safe, SourceOptions(resolution=float(resolution), bands=("B02", "B04"))) as source:
        assert any("MSK_CLOUDS" in note for note in source.notes)
        whole = source.read_with_flags(0, source.height, 0, source.width)[1]
        part = source.read_with_flags(7, source.height - 1, 5, source.width - 2)[1]
    n = 60 // resolution
    expected = coarse.repeat(n, 0).repeat(n, 1) & ((whole & Flag.NODATA) == 0)
    assert np.array_equal((whole & Flag.CLOUD) != 0, expected)
    assert np.array_equal(part, whole[7:-1, 5:-2])


def test_sentinel2_outlines_none_and_damaged(tmp_path):
    safe = made.write_safe(tmp_path, baseline="02.14", offset=None)
    path = next(safe.glob("GRANULE/*")) / "QI_DATA" / "MSK_CLOUDS_B00.gml"
    path.parent.mkdir()
    path.write_text(OUTLINES.format(features=""))
    with open_raster(safe, SourceOptions(resolution=60.0, bands=("B02",))) as source:
        assert not (source.read_with_flags(0, source.height, 0, source.width)[1] & Flag.CLOUD).any()
    path.write_text(OUTLINES.format(features=outlined("OPAQUE", box(3, 5, 16, 17)[:3])))
    with pytest.raises(MissingDataError, match=r"MSK_CLOUDS.*closed ring"), open_raster(safe):
        pass


def test_landsat_angles_cross_the_zenith_smoothly(landsat):
    angles = made.landsat_angles()
    with open_raster(landsat) as source:
        found = source.geometry.at(np.arange(90) + 0.5, np.arange(110) + 0.5)
    # Interpolated between nodes 1.7 pixels apart, from hundredths of a degree; the swath's corner has no angles.
    np.testing.assert_allclose(found.view_zenith_deg[10:], angles["VZA"][10:], rtol=0, atol=0.02)
    turned = np.abs((angles["VAA"] - angles["SAA"] + 180.0) % 360.0 - 180.0)
    away = np.abs(np.arange(110) - 55) > 3
    np.testing.assert_allclose(found.relative_azimuth_deg[10:, away], turned[10:, away], rtol=0, atol=1.0)


@pytest.mark.parametrize("form", ["txt", "json", "xml"])
def test_landsat_without_angle_bands_says_so(tmp_path, form):
    place = made.write_landsat(tmp_path, angles=False, form=form)
    with open_raster(place, SourceOptions(bands=("B4", "blue"))) as source:
        assert "view from the zenith" in source.notes[0]
        assert source.geometry.to_json()["sun_zenith_deg"] == pytest.approx(30.0)
        values = source.read(0, 90, 0, 110)
    np.testing.assert_allclose(values[0], landsat_reflectance(4, 30.0), rtol=0, atol=2 * ROUNDING)
    np.testing.assert_allclose(values[1], landsat_reflectance(2, 30.0), rtol=0, atol=2 * ROUNDING)


def test_landsat_radiance_and_angles_on_request(landsat):
    with open_raster(landsat, SourceOptions(quantity="radiance", bands=("B3",))) as source:
        numbers = made.LANDSAT_NUMBERS[3].astype(float)
        expected = np.where(numbers == 0, np.nan, 0.03 * numbers - 150.0)
        # float32 numbers up to 900 before the offset, whose last digit is 6e-5
        np.testing.assert_allclose(source.read(0, 90, 0, 110)[0], expected, rtol=0, atol=2e-4)
    told = SourceOptions(bands=("B3",), sun_zenith_deg=60.0)
    with open_raster(landsat, told) as source:
        np.testing.assert_allclose(source.read(0, 90, 0, 110)[0], landsat_reflectance(3, 60.0), rtol=0, atol=1e-6)


def test_landsat_in_a_tar_and_its_result(landsat, tmp_path):
    archive = tmp_path / "product.tar"
    with tarfile.open(archive, "w") as tar:
        tar.add(landsat, arcname=".")
    out = tmp_path / "out.tif"
    with open_raster(archive) as source, open_result(out, source) as sink, open_raster(landsat) as plain:
        np.testing.assert_array_equal(source.read(0, 90, 0, 110), plain.read(0, 90, 0, 110))
        for_each_window(source, sink, lambda row0, col0, values: values, size=33)
        written = source.read(0, 90, 0, 110)
    with rasterio.open(out) as file:
        assert file.tags()["AREA_OR_POINT"] == "Point"
        assert file.transform == rasterio.Affine(30, 0, 399885, 0, -30, 5000015)
        numbers = file.read()
        back = np.where(numbers == 0, np.nan, 2e-5 * numbers - 0.1)
    # Half a step of 2e-5; the saturated pixel is brighter than 16 bits can say and becomes the greatest number.
    np.testing.assert_allclose(back, np.minimum(written, 2e-5 * 65535 - 0.1), rtol=0, atol=1.01e-5)


def broken(folder, change):
    safe = made.write_safe(folder)
    change(safe)
    return safe


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda safe: (safe / "MTD_MSIL1C.xml").write_text("<a><b></a>"), "is not whole XML"),
        (lambda safe: (safe / "MTD_MSIL1C.xml").unlink(), "holds neither"),
        (lambda safe: next(safe.rglob("MTD_TL.xml")).unlink(), "has 0 granules"),
        (lambda safe: next(safe.rglob("*_B03.jp2")).unlink(), r"_B03.jp2: is missing"),
        (lambda safe: next(safe.rglob("*_B03.jp2")).write_bytes(b"nonsense"), "cannot be opened as a raster"),
        (
            lambda safe: shutil.copy(next(safe.rglob("*_B05.jp2")), next(safe.rglob("*_B03.jp2"))),
            "band B03 covers",
        ),
    ],
)
def test_broken_sentinel2_products_say_what_is_wrong(tmp_path, change, message):
    safe = broken(tmp_path, change)
    with pytest.raises(MissingDataError, match=message) as caught:
        open_raster(safe)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("product", "error", "message"),
    [
        ({"offset": None}, MissingDataError, "has no RADIO_ADD_OFFSET"),
        ({"offset": "x"}, MissingDataError, "RADIO_ADD_OFFSET = 'x'"),
        ({"level": "Level-2A"}, DomainError, "not of Level 1C"),
        ({"sun_zenith": 91.0}, DomainError, "below the horizon"),
        ({"sun_zenith": 86.0}, DomainError, "from 0 to 85 degrees"),
    ],
)
def test_unusable_sentinel2_products_say_what_is_wrong(tmp_path, product, error, message):
    safe = made.write_safe(tmp_path, **product)
    with pytest.raises(error, match=message):
        open_raster(safe)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale": 1e-4}, "stands in the metadata"),
        ({"quantity": "display"}, "gives reflectance"),
        ({"sensor": "landsat-8"}, "the metadata say sentinel-2a"),
        ({"resolution": 15.0}, "choose one of 10, 20, 60 m"),
        ({"bands": ("B15",)}, "no such band"),
    ],
)
def test_options_that_contradict_a_product_are_refused(safe, options, message):
    with pytest.raises(DomainError, match=message):
        open_raster(safe, SourceOptions(**options))


@pytest.mark.parametrize(
    ("options", "message"),
    [({"bands": ("B8",)}, "15 m of its own"), ({"bands": ("B10",)}, "thermal"), ({"resolution": 15.0}, "30 m")],
)
def test_landsat_bands_of_other_grids_are_refused(landsat, options, message):
    with pytest.raises(DomainError, match=message):
        open_raster(landsat, SourceOptions(**options))


def test_broken_landsat_products_say_what_is_wrong(tmp_path):
    place = made.write_landsat(tmp_path)
    mtl = next(place.glob("*_MTL.txt"))
    text = mtl.read_text()
    for change, message in (
        (text[: len(text) // 2], "cut short"),
        (text.replace("REFLECTANCE_MULT_BAND_2 =", "NOTHING ="), "has no REFLECTANCE_MULT_BAND_2"),
        (text.replace('"LANDSAT_8"', '"LANDSAT_5"'), "landsat-5"),
        (text.replace('"L1TP"', '"L2SP"'), "not of Level 1"),
    ):
        mtl.write_text(change)
        with pytest.raises((MissingDataError, DomainError), match=message):
            open_raster(place)
    mtl.write_text(text)
    next(place.glob("*_B5.TIF")).unlink()
    with pytest.raises(MissingDataError, match=r"_B5.TIF: is missing"):
        open_raster(place)


def test_the_sun_below_the_horizon_is_refused(tmp_path):
    place = made.write_landsat(tmp_path, angles=False, sun_elevation=-3.0)
    with pytest.raises(DomainError, match="below the horizon"):
        open_raster(place)
