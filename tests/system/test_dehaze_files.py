"""Products and rasters through the command, from files to files: what is kept, what is written, what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import satellite_products as made
from dehaze_tables import Atmosphere, bands_of, ground, made_up_table, seen_from_above

rasterio = pytest.importorskip("rasterio")

from PIL import Image  # noqa: E402

from skyscatter.cli.main import main  # noqa: E402
from skyscatter.dehaze import physical  # noqa: E402
from skyscatter.dehaze.bands import load_sensor  # noqa: E402
from skyscatter.dehaze.rasters.opening import open_raster  # noqa: E402
from skyscatter.dehaze.sensing import sense  # noqa: E402
from skyscatter.dehaze.table import Angles  # noqa: E402
from skyscatter.errors import DomainError  # noqa: E402

AOD, SUN = 0.2, 30.0
LAND = tuple(name for name in made.S2_BANDS if name != "B10")
UTM = {"crs": "EPSG:32632", "transform": rasterio.Affine(10.0, 0.0, 4e5, 0.0, -10.0, 5e6)}
TOLD = ("--sun-zenith", "30", "--sensor", "sentinel-2a", "--scale", "1e-4", "--offset", "0", "--aod", "0.2")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Tables in closed form, of which there can be many, and few walks."""
    monkeypatch.setattr(physical, "build_table", made_up_table)
    monkeypatch.setattr(physical, "WALKS", 2000)


def scene(bands, height, width):
    """Surface and what a satellite sees of it under haze, each pixel its own surroundings."""
    table = made_up_table(Atmosphere(aerosol="urban"), bands, Angles.spanned(SUN, 0.0, 0.0))
    surface = ground(bands, height, width)
    return surface, seen_from_above(table, surface, AOD, SUN)


@pytest.fixture(scope="module")
def safe(tmp_path_factory):
    """A granule whose pixels of all sizes show the same fields of 60 m; a corner without data; no cirrus."""
    surface, toa = scene(bands_of(*LAND), 40, 40)
    numbers = {"B10": np.full((40, 40), 1008, np.uint16)}
    for name, band in zip(LAND, toa, strict=True):
        n = 60 // made.S2_RESOLUTIONS[name]
        numbers[name] = np.rint(1000 + 1e4 * band).astype(np.uint16).repeat(n, 0).repeat(n, 1)
    for name, band in numbers.items():
        n = 60 // made.S2_RESOLUTIONS[name]
        band[: 5 * n, : 3 * n] = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(made, "S2_NUMBERS", {name: numbers[name] for name in made.S2_BANDS})
        return made.write_safe(tmp_path_factory.mktemp("safe")), surface


@pytest.fixture(scope="module")
def landsat(tmp_path_factory):
    sensor = load_sensor("landsat-8")
    numbers = (1, 2, 3, 4, 5, 6, 7)
    surface, toa = scene(tuple(sensor.band(f"B{k}") for k in numbers), *made.LANDSAT_SHAPE)
    cosine = np.cos(np.radians(made.landsat_angles()["SZA"]))
    files = {k: np.rint((band * cosine + 0.1) / 2e-5).astype(np.uint16) for k, band in zip(numbers, toa, strict=True)}
    files[9] = np.full(made.LANDSAT_SHAPE, 5020, np.uint16)
    for band in files.values():
        band[:8, :9] = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(made, "LANDSAT_NUMBERS", files)
        return made.write_landsat(tmp_path_factory.mktemp("landsat")), surface


def outputs(folder):
    files = {name: folder / f"{name}.tif" for name in ("out", "haze", "sigma", "mask")}
    files |= {"look": folder / "look.png"}
    words = ["-o", files["out"], "--haze-map", files["haze"], "--sigma", files["sigma"], "--mask", files["mask"]]
    return files, [str(word) for word in (*words, "--quicklook", files["look"], "--json", "--quiet")]


def check_maps(files, surface, bands, note):
    with rasterio.open(files["haze"]) as file:
        assert file.descriptions == ("aod_550",)
        haze = file.read(1)
    with rasterio.open(files["sigma"]) as file:
        assert file.descriptions == tuple(f"sigma_{name}" for name in bands)
        sigma = file.read()
    with rasterio.open(files["mask"]) as file:
        mask = file.read(1)
        assert file.dtypes == ("uint8",)
    with Image.open(files["look"]) as look:
        assert look.size[0] > 2 * min(surface.shape[1:])
    assert note["kind"] == "surface reflectance"
    assert note["bands"] == list(bands)
    assert note["flags"]["nodata"] == pytest.approx(((mask & 1) != 0).mean(), abs=1e-6)
    assert len(note["outputs"]) == 5
    return haze, sigma, mask


@pytest.mark.parametrize(("aod", "size"), [("0.2", 20), ("auto", 60)])
def test_a_safe_folder_becomes_surface_reflectance(safe, tmp_path, aod, size, capsys):
    product, surface = safe
    files, words = outputs(tmp_path)
    assert (
        main(
            [
                "dehaze",
                str(product),
                *words,
                "--aod",
                aod,
                "--aerosol",
                "urban",
                "--no-adjacency",
                "--resolution",
                str(size),
            ]
        )
        == 0
    )
    with rasterio.open(files["out"]) as file:
        assert file.descriptions == made.S2_BANDS
        assert file.crs.to_epsg() == 32632
        assert file.transform == rasterio.Affine(size, 0, 399960, 0, -size, 5000040)
        assert file.nodata == 0.0
        assert file.tags()["PROCESSING_BASELINE"] == "04.00"
        assert [colour.name for colour in file.colorinterp][1:4] == ["blue", "green", "red"]
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        found = np.where(file.read() == 0, np.nan, file.read() * 1e-4 - 0.1)
    note = json.loads(capsys.readouterr().out)
    haze, sigma, mask = check_maps(files, surface, made.S2_BANDS, note)
    n = 60 // size
    assert np.isnan(found[:, : 5 * n, : 3 * n]).all()
    assert np.all(mask[: 5 * n, : 3 * n] & 1)
    assert not np.any(mask[5 * n :] & 1)
    places = [made.S2_BANDS.index(name) for name in LAND]
    assert np.isnan(sigma[made.S2_BANDS.index("B10")]).all()
    error = np.abs(found[places] - surface.repeat(n, 1).repeat(n, 2))[:, 5 * n :]
    assert note["corrected_bands"] == list(LAND)
    assert note["sensor"] == "sentinel-2a"
    if aod == "auto":
        assert note["aod"]["source"] == "estimated"
        assert abs(note["aod"]["mean"] - AOD) < 2 * note["aod"]["sigma"] + 0.05
        return
    # The image was made for the Sun at 30 degrees and a view from the zenith; the product's are up to 0.5 and 6 off.
    assert np.median(error) < 0.001
    assert error.max() < 0.02
    np.testing.assert_allclose(haze[np.isfinite(haze)], AOD, rtol=0, atol=1e-6)


def test_a_landsat_folder_becomes_surface_reflectance(landsat, tmp_path, capsys):
    product, surface = landsat
    files, words = outputs(tmp_path)
    assert main(["dehaze", str(product), *words, "--aod", "0.2", "--aerosol", "urban", "--no-adjacency"]) == 0
    names = ("B1", "B2", "B3", "B4", "B5", "B6", "B7", "B9")
    with rasterio.open(files["out"]) as file:
        assert file.descriptions == names
        assert file.transform == rasterio.Affine(30, 0, 399885, 0, -30, 5000015)
        assert file.tags()["AREA_OR_POINT"] == "Point"
        found = np.where(file.read() == 0, np.nan, file.read() * file.scales[0] + file.offsets[0])
    note = json.loads(capsys.readouterr().out)
    _, sigma, _ = check_maps(files, surface, names, note)
    error = np.abs(found[:7] - surface)[:, 8:]
    # The Sun sinks from 30 to 32.7 degrees down the image, which was made for 30: two percent of the path reflectance.
    assert np.median(error) < 0.003
    assert np.all(sigma[:7, 8:] > 0)
    assert note["sensor"] == "landsat-8"


def test_the_result_of_radiance_is_not_written_with_its_scale(landsat, tmp_path):
    out = tmp_path / "out.tif"
    given = ["--quantity", "radiance", "--aod", "0.2", "--aerosol", "urban", "--no-adjacency", "--bands", "B2,B3,B4"]
    assert main(["dehaze", str(landsat[0]), "-o", str(out), *given, "--quiet"]) == 0
    with open_raster(landsat[0]) as source, rasterio.open(out) as file:
        assert source.profile.dtype == "uint16"
        assert (file.dtypes, file.scales, file.offsets) == (("float32",) * 3, (1.0,) * 3, (0.0,) * 3)
        values = file.read()
    assert np.isnan(values[:, :8, :9]).all()
    assert np.isfinite(values[:, 8:]).all()
    assert values[:, 8:].max() < 2


def with_responses(safe, unit):
    """The product of another unit, with the responses of one that is shipped."""
    path = safe / "MTD_MSIL1C.xml"
    text = path.read_text(encoding="utf-8").replace("Sentinel-2A", unit)
    for k, (name, band) in enumerate(zip(made.S2_BANDS, load_sensor("sentinel-2b").bands, strict=True)):
        wl = np.arange(np.floor(band.wavelengths[0]), np.ceil(band.wavelengths[-1]) + 1)
        values = " ".join(f"{v:.5f}" for v in np.interp(wl, band.wavelengths, band.response))
        assert name == band.name
        old = f'<MIN unit="nm">{400 + 50 * k}</MIN><MAX unit="nm">{440 + 50 * k}</MAX><CENTRAL unit="nm">{420 + 50 * k}'
        new = f'<MIN unit="nm">{wl[0]:.0f}</MIN><MAX unit="nm">{wl[-1]:.0f}</MAX><CENTRAL unit="nm">{band.centre_nm}'
        assert old in text
        listed = f'<Spectral_Response><STEP unit="nm">1</STEP><VALUES>{values}</VALUES></Spectral_Response>'
        tail = "</CENTRAL></Wavelength>"
        text = text.replace(old + tail, new + tail + listed)
    path.write_text(text, encoding="utf-8")


def test_a_product_brings_its_own_responses(tmp_path):
    safe = made.write_safe(tmp_path)
    with open_raster(safe) as source:
        assert source.responses is None
    with_responses(safe, "Sentinel-2C")
    with open_raster(safe) as source:
        assert source.sensor == "sentinel-2c"
        assert source.responses.name == "sentinel-2c"
        seen = sense(source)
    assert [band.name for band in seen.bands] == list(LAND)
    assert not any(band.approximate for band in seen.bands)
    assert not any("shapes" in note for note in seen.notes)
    twin = load_sensor("sentinel-2b").band("B04")
    assert seen.bands[3].effective_wavelength == pytest.approx(twin.effective_wavelength, abs=0.05)


def test_a_unit_without_responses_is_named(tmp_path, capsys):
    safe = made.write_safe(tmp_path)
    path = safe / "MTD_MSIL1C.xml"
    path.write_text(path.read_text(encoding="utf-8").replace("Sentinel-2A", "Sentinel-2C"), encoding="utf-8")
    with open_raster(safe) as source, pytest.raises(DomainError, match=r"sentinel-2c.*get it again"):
        sense(source)
    assert main(["dehaze", str(safe), "-o", str(tmp_path / "out.tif")]) == 2
    assert "sentinel-2c" in capsys.readouterr().err
    assert not (tmp_path / "out.tif").exists()


# --- bad rasters: one line, status 2, nothing new, and what was there before survives


def write(path, pixels, **more):
    layout = {**UTM, "driver": "GTiff", "count": len(pixels), "height": pixels.shape[1], "width": pixels.shape[2]}
    with rasterio.open(path, "w", dtype=pixels.dtype, **{**layout, **more}) as file:
        for number, name in enumerate(("B02", "B03", "B04", "B8A")[: len(pixels)], start=1):
            file.set_band_description(number, name)
        file.write(pixels)
    return path


def bands(value=1500, dtype="uint16"):
    rng = np.random.default_rng(0)
    return (value + rng.integers(0, 50, (4, 64, 64))).astype(dtype)


def truncated(path):
    write(
        path,
        np.random.default_rng(1).integers(900, 3000, (4, 64, 64), dtype=np.uint16),
        tiled=True,
        blockxsize=16,
        blockysize=16,
    )
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


BAD = {
    "truncated": (truncated, TOLD, "in.tif"),
    "not a raster": (lambda path: path.write_bytes(b"II*\0nonsense"), TOLD, "in.tif"),
    "empty file": (lambda path: path.write_bytes(b""), TOLD, "in.tif"),
    "nodata only": (lambda path: write(path, np.zeros((4, 64, 64), np.uint16), nodata=0), TOLD, "no clear pixel"),
    "NaN only": (
        lambda path: write(path, np.full((4, 64, 64), np.nan, np.float32)),
        ("--sun-zenith", "30", "--sensor", "sentinel-2a", "--quantity", "reflectance"),
        "",
    ),
    "all cloud": (lambda path: write(path, bands(7000)), TOLD, "no clear pixel"),
    "complex": (lambda path: write(path, bands(dtype="complex64")), TOLD, "complex"),
    "no bands chosen": (lambda path: write(path, bands()), (*TOLD, "--bands", ","), "bands"),
    "Sun below": (lambda path: write(path, bands()), (*TOLD[2:], "--sun-zenith", "95"), "below the horizon"),
    "unknown bands": (lambda path: write(path, bands()), (*TOLD, "--bands", "B17"), "no such band"),
    "unknown sensor": (lambda path: write(path, bands()), (*TOLD, "--sensor", "spot-9"), "sensor"),
    "unknown unit": (
        lambda path: write(path, bands()),
        (*TOLD, "--sensor", "sentinel-2c"),
        "sentinel-2a or sentinel-2b",
    ),
    "unknown aerosol": (lambda path: write(path, bands()), (*TOLD, "--aerosol", "smoke"), "aerosol = 'smoke'"),
    "no Sun": (lambda path: write(path, bands()), TOLD[2:], "--sun-zenith"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_rasters_are_refused_in_one_line(name, tmp_path, capsys):
    make, options, message = BAD[name]
    make(tmp_path / "in.tif")
    old = {one: f"old {one}".encode() for one in ("out.tif", "mask.tif")}
    for one, content in old.items():
        (tmp_path / one).write_bytes(content)
    words = ["-o", str(tmp_path / "out.tif"), "--mask", str(tmp_path / "mask.tif"), "--sigma", str(tmp_path / "s.tif")]
    assert main(["dehaze", str(tmp_path / "in.tif"), *words, *options, "--quiet"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    assert message in lines[0]
    assert sorted(one.name for one in tmp_path.iterdir()) == ["in.tif", "mask.tif", "out.tif"]
    for one, content in old.items():
        assert (tmp_path / one).read_bytes() == content


def test_a_raster_without_a_place_is_dehazed_all_the_same(tmp_path, capsys):
    _, toa = scene(bands_of("B02", "B03", "B04", "B8A"), 64, 64)
    numbers = np.rint(1e4 * toa).astype(np.uint16)
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        write(tmp_path / "in.tif", numbers, crs=None, transform=None)
    out = ["-o", str(tmp_path / "out.tif"), "--json", "--quiet"]
    assert main(["dehaze", str(tmp_path / "in.tif"), *out, *TOLD]) == 0
    assert any("the size of a pixel is unknown" in remark for remark in json.loads(capsys.readouterr().out)["remarks"])


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to another process")
def test_an_interrupt_in_the_middle_leaves_nothing(tmp_path):
    """Ctrl-C while windows are written: status 130, and only what was there before is there."""
    _, toa = scene(bands_of("B02", "B03", "B04", "B8A"), 64, 64)
    numbers = np.rint(1e4 * toa).astype(np.uint16).repeat(12, 1).repeat(12, 2)
    write(tmp_path / "in.tif", numbers)
    (tmp_path / "out.tif").write_bytes(b"old")
    code = (
        "import os, sys, time; sys.path.insert(0, sys.argv.pop(1))\n"
        "from dehaze_tables import made_up_table\n"
        "from skyscatter.dehaze import physical\n"
        "physical.build_table, physical.WALKS = made_up_table, 2000\n"
        "whole = physical.Correction.__call__\n"
        "def slow(self, *window):\n"
        "    os.write(1, b'at work\\n'); time.sleep(0.2)\n"
        "    return whole(self, *window)\n"
        "physical.Correction.__call__ = slow\n"
        "from skyscatter.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    words = ["dehaze", str(tmp_path / "in.tif"), "-o", str(tmp_path / "out.tif"), "--sigma", str(tmp_path / "s.tif")]
    words += [*TOLD, "--no-adjacency", "--window", "64", "--quiet"]
    command = [sys.executable, "-c", code, os.path.dirname(made.__file__), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        for _ in range(3):
            assert process.stdout.readline() == "at work\n"
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    assert process.returncode == 130, error
    assert "interrupted" in error
    assert sorted(one.name for one in tmp_path.iterdir()) == ["in.tif", "out.tif"]
    assert (tmp_path / "out.tif").read_bytes() == b"old"
