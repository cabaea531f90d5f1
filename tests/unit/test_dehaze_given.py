"""Haze that the user knows, with its error or as a map; what files say of their making; windows without a trace."""

from __future__ import annotations

import json

import numpy as np
import pytest
from dehaze_tables import Atmosphere, bands_of, ground, made_up_table, seen_from_above

import skyscatter
from skyscatter.dehaze import physical
from skyscatter.dehaze.flags import MEANINGS, Flag
from skyscatter.dehaze.lattice import at_pixels, linear_weights
from skyscatter.dehaze.options import DehazeOptions, split_options
from skyscatter.dehaze.rasters.handles import quiet
from skyscatter.dehaze.table import Angles
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError

rasterio = pytest.importorskip("rasterio")

NAMES = ("B02", "B04", "B8A")
TOLD = {"sensor": "sentinel-2a", "sun_zenith_deg": 35.0, "quantity": "reflectance", "adjacency": False}
UTM = {"crs": "EPSG:32632", "transform": rasterio.Affine(60.0, 0.0, 4e5, 0.0, -60.0, 5e6)}
HEIGHT, WIDTH = 50, 70


@pytest.fixture(autouse=True)
def closed_forms(monkeypatch):
    """Tables in closed form."""
    monkeypatch.setattr(physical, "build_table", made_up_table)


def image(aod=0.25):
    bands = bands_of(*NAMES)
    table = made_up_table(Atmosphere(aerosol="continental"), bands, Angles.spanned(35.0, 0.0, 0.0))
    return seen_from_above(table, ground(bands, HEIGHT, WIDTH), aod, 35.0).astype(np.float32)


def dehazed(aod, values=None, **more):
    given = {**TOLD, "aerosol": "continental", "aod": aod, **more}
    return skyscatter.dehaze(image() if values is None else values, bands=NAMES, **given)


def write(path, values, **place):
    values = np.asarray(values, np.float32)
    layout = {"driver": "GTiff", "count": len(values), "height": values.shape[1], "width": values.shape[2]}
    with quiet(), rasterio.open(path, "w", dtype="float32", **layout, **place) as file:
        file.write(values)
        if len(values) == len(NAMES):
            for number, name in enumerate(NAMES, start=1):
                file.set_band_description(number, name)
    return path


@pytest.mark.parametrize("text", ["0.25±0.05", "0.25+-0.05", " 0.25 +/- 5e-2", "2.5e-1 ± .05"])
def test_a_depth_with_its_error_as_people_write_it(text):
    options = DehazeOptions(aod=text)
    assert (options.aod, options.aod_sigma, options.aod_map) == (0.25, 0.05, None)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"aod": "0.25±much"}, "aod_sigma = 'much': give a number"),
        ({"aod": "9±0.1"}, "aod = '9': give a number from 0 to 5"),
        ({"aod": "0.2±0.1±0.1"}, "give a number"),
        ({"aod": "0.2±0.1", "aod_sigma": 0.1}, "says it already"),
        ({"aod_sigma": 0.1}, "needs the depth as well"),
        ({"aod": 0.2, "aod_map": "aod.tif"}, "leave one of them out"),
        ({"aod": "aod.tif", "aerosol": "none"}, "leave one of them out"),
        ({"aod": "aod.tif", "aod_map": "more.tif"}, "leave one of them out"),
    ],
)
def test_depths_that_contradict_themselves(options, words):
    with pytest.raises(DomainError) as caught:
        split_options(options)
    assert words in str(caught.value)


def test_the_error_of_a_given_depth_is_in_sigma():
    """What the depth's error adds in quadrature is what that error changes, in every band."""
    sure, unsure = dehazed(0.25), dehazed("0.25±0.05")
    low, high = dehazed(0.20), dehazed(0.30)
    np.testing.assert_array_equal(sure.reflectance, unsure.reflectance)
    added = np.sqrt(unsure.sigma.astype(float) ** 2 - sure.sigma.astype(float) ** 2)
    changed = np.abs(low.reflectance - high.reflectance) / 2
    free = (low.reflectance > 0) & (high.reflectance > 0) & (changed > 1e-3)
    assert free.mean() > 0.5
    # Sigma leaves out that the albedo of the sky S, too, changes with the haze: rho^2 dS/dtau sigma, which is
    # 0.33^2 * 0.075 * 0.05 = 4.1e-4 at 865 nm over the brightest ground here.
    np.testing.assert_allclose(added[free], changed[free], rtol=0.0, atol=4.5e-4)
    assert np.median(changed[free]) > 5e-3
    assert unsure.diagnostics["aod"]["sigma"] == 0.05
    none = dehazed("0±0.05")
    assert np.all(none.sigma > dehazed(0.0).sigma)


def test_a_map_in_other_coordinates_is_resampled(tmp_path):
    """A plane over longitude and latitude comes back at the pixels; a second band is the error."""
    from rasterio.warp import transform, transform_bounds

    west, south, east, north = transform_bounds(UTM["crs"], "EPSG:4326", 4e5, 5e6 - 60 * HEIGHT, 4e5 + 60 * WIDTH, 5e6)
    step = (east - west) / 12
    place = {"crs": "EPSG:4326", "transform": rasterio.Affine(step, 0, west - 3 * step, 0, -step, north + 3 * step)}
    lon = west + step * (np.arange(20) - 2.5)
    lat = north - step * (np.arange(20) - 2.5)

    def plane(x, y):
        return 0.2 + 2.0 * (x - west) - 1.5 * (y - south)

    depths = plane(lon, lat[:, None])
    path = write(tmp_path / "aod.tif", [depths, np.full_like(depths, 0.04)], **place)
    scene = write(tmp_path / "scene.tif", image(), **UTM)
    found = skyscatter.dehaze(scene, **TOLD, aerosol="continental", aod=path)
    rows, cols = np.mgrid[8 : HEIGHT - 10, 8 : WIDTH - 14]  # beyond the outer cells' centres the map is constant
    x, y = transform(UTM["crs"], "EPSG:4326", 4e5 + 60 * (cols.ravel() + 0.5), 5e6 - 60 * (rows.ravel() + 0.5))
    np.testing.assert_allclose(
        found.haze_map[0, rows, cols].ravel(), plane(np.array(x), np.array(y)), rtol=0, atol=2e-3
    )
    assert found.diagnostics["aod"]["source"] == "map"
    assert found.diagnostics["aod"]["sigma"] == pytest.approx(0.04, abs=1e-4)


def test_a_map_of_one_depth_is_that_depth_and_holes_are_told(tmp_path):
    scene = write(tmp_path / "scene.tif", image(), **UTM)
    path = write(tmp_path / "aod.tif", np.full((1, HEIGHT, WIDTH), 0.25), **UTM)
    given = {**TOLD, "aerosol": "continental"}
    whole = skyscatter.dehaze(scene, **given, aod=str(path), aod_sigma=0.05)
    plain = skyscatter.dehaze(scene, **given, aod="0.25±0.05")
    np.testing.assert_allclose(whole.reflectance, plain.reflectance, rtol=0, atol=2e-4)
    np.testing.assert_allclose(whole.sigma, plain.sigma, rtol=0.02)
    depths = np.linspace(0.2, 0.3, WIDTH) * np.ones((1, HEIGHT, 1))
    depths[:, :, :32] = np.nan
    holed = skyscatter.dehaze(scene, **given, aod=str(write(tmp_path / "aod.tif", depths, **UTM)))
    assert np.all(holed.mask[0, :, :32] & Flag.UNCERTAIN)
    assert not np.any(holed.mask[0, :, 48:] & Flag.UNCERTAIN)
    assert np.isfinite(holed.reflectance).all()
    # A raster without a georeference may lie on the pixels of an image without one.
    array = dehazed(str(write(tmp_path / "plain.tif", np.full((1, HEIGHT, WIDTH), 0.25))))
    np.testing.assert_allclose(array.haze_map, 0.25, rtol=1e-6)


def test_maps_that_cannot_be_used(tmp_path):
    """One line each, before any work."""
    scene = write(tmp_path / "scene.tif", image(), **UTM)

    def refused(kind, words, aod, image_path=scene):
        with pytest.raises(kind) as caught:
            skyscatter.dehaze(image_path, **TOLD, aod=aod)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)

    refused(MissingDataError, "check the path", "none.tif")
    far = {**UTM, "transform": rasterio.Affine(60.0, 0.0, 9e5, 0.0, -60.0, 5e6)}
    refused(DomainError, "no data where the image is", write(tmp_path / "far.tif", np.full((1, 9, 9), 0.2), **far))
    whole = np.full((1, HEIGHT, WIDTH), 250.0)
    refused(DomainError, "holds 250", write(tmp_path / "scaled.tif", whole, **UTM))
    refused(DomainError, "50 x 70 pixels", write(tmp_path / "bare.tif", np.full((1, 9, 9), 0.2)))
    (tmp_path / "text.tif").write_text("no raster")
    refused(SkyscatterError, "cannot be read as a map", tmp_path / "text.tif")


def test_cells_at_pixels_have_the_same_bits_in_any_window():
    """Also where products of matrices, of other sizes, are summed in another order."""
    cells = np.random.default_rng(4).random((61, 83)).astype(np.float32)
    size, shape = 9, (61 * 9 - 3, 83 * 9 - 5)
    whole = at_pixels(cells, size, 0, 0, shape)
    along = [
        linear_weights(np.arange(n) + 0.5, (np.arange(c) + 0.5) * size) for n, c in zip(shape, cells.shape, strict=True)
    ]
    np.testing.assert_allclose(whole, along[0] @ cells.astype(float) @ along[1].T, rtol=1e-6)
    for window in (1, 37, 128, 256, 511):
        for row, col in ((0, 0), (5, 230), (37, 9)):
            part = at_pixels(cells, size, row, col, (min(window, shape[0] - row), min(window, shape[1] - col)))
            np.testing.assert_array_equal(part, whole[row : row + part.shape[0], col : col + part.shape[1]])


def test_files_say_how_they_were_made(tmp_path, capsys):
    """Version, haze and its error, aerosol and the meaning of the mask's bits, in every file and in the summary."""
    from skyscatter.cli.main import main

    scene = write(tmp_path / "scene.tif", image(), **UTM)
    files = {name: tmp_path / f"{name}.tif" for name in ("output", "sigma", "haze-map", "mask")}
    words = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    words += ["--sensor", "sentinel-2a", "--sun-zenith", "35", "--quantity", "reflectance", "--no-adjacency"]
    assert main(["dehaze", str(scene), *words, "--aod", "0.25±0.05", "--aerosol", "urban", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["mask_bits"] == {str(int(flag)): text for flag, text in MEANINGS.items()}
    assert set(MEANINGS) == set(Flag)
    for path in files.values():
        with rasterio.open(path) as file:
            tags = file.tags()
        assert tags["SKYSCATTER_VERSION"] == skyscatter.__version__
        assert (tags["SKYSCATTER_AOD_550"], tags["SKYSCATTER_AOD_550_SIGMA"]) == ("0.25", "0.05")
        assert (tags["SKYSCATTER_AOD_SOURCE"], tags["SKYSCATTER_AEROSOL"]) == ("given", "urban")
        assert "4 = cloud; 8 = cirrus" in tags["SKYSCATTER_MASK_BITS"]
        assert json.loads(tags["SKYSCATTER_SUMMARY"])["aod"] == summary["aod"]


def test_a_picture_with_its_bands_last_is_refused_with_the_remedy():
    picture = np.zeros((256, 300, 3), np.uint8)
    with pytest.raises(DomainError, match=r"np\.moveaxis\(image, -1, 0\)") as caught:
        skyscatter.dehaze(picture)
    assert len(str(caught.value)) < 200
