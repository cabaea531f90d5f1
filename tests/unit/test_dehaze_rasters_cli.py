"""The command dehaze: what it refuses and how, and what it hands to the engine (a stand-in here)."""

from __future__ import annotations

import json
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

rasterio = pytest.importorskip("rasterio")

from PIL import Image  # noqa: E402

from skyscatter.cli.main import main  # noqa: E402
from skyscatter.dehaze.rasters.windows import for_each_window  # noqa: E402

UTM = {"crs": "EPSG:32632", "transform": rasterio.Affine(10.0, 0.0, 4e5, 0.0, -10.0, 5e6)}
PIXELS = np.random.default_rng(5).integers(1, 255, (20, 30, 3), dtype=np.uint8)
SUN = ("--sun-zenith", "30", "--sensor", "sentinel-2a", "--scale", "1e-4", "--offset", "-0.1")


class Summary:
    def to_json(self):
        return {
            "kind": "surface reflectance",
            "aod": {"source": "estimated", "mean": 0.25, "sigma": 0.03},
            "aerosol": {"model": "continental"},
            "remarks": ["a remark"],
        }


@pytest.fixture
def engine(monkeypatch):
    """An engine that halves the image and says in the maps that it did."""
    calls = SimpleNamespace(options=None, source=None, sinks=None, fail=None)

    def dehaze_raster(source, sinks, options, progress, executor=None):
        calls.options, calls.source, calls.sinks = options, source, sorted(sinks)

        def work(row0, col0, values, flags):
            count = sinks["sigma"].count if "sigma" in sinks else 1
            maps = {"haze_map": np.full((1, *flags.shape), 0.25, np.float32), "mask": flags}
            return {"result": 0.5 * values, "sigma": np.full((count, *flags.shape), 0.01, np.float32), **maps}

        for_each_window(
            source, sinks, work, flags=True, size=options.window, threads=options.threads, progress=progress
        )
        if calls.fail is not None:
            raise calls.fail
        return Summary()

    module = ModuleType("skyscatter.dehaze.engine")
    module.dehaze_raster = dehaze_raster
    monkeypatch.setitem(sys.modules, "skyscatter.dehaze.engine", module)
    return calls


@pytest.fixture
def picture(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "in.png")
    return tmp_path / "in.png"


@pytest.fixture
def raster(tmp_path):
    path = tmp_path / "in.tif"
    layout = {**UTM, "driver": "GTiff", "count": 3, "height": 20, "width": 30, "photometric": "MINISBLACK"}
    with rasterio.open(path, "w", dtype="uint16", **layout) as file:
        for number, name in enumerate(("B02", "B03", "B04"), start=1):
            file.set_band_description(number, name)
        file.write(10 * PIXELS.transpose(2, 0, 1).astype(np.uint16) + 1000)
    return path


def said(capsys):
    return capsys.readouterr().err.strip().splitlines()


def test_a_raster_with_all_that_can_be_written(engine, raster, tmp_path, capsys):
    files = {name: tmp_path / f"{name}.tif" for name in ("haze-map", "sigma", "mask")}
    more = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    physics = ["--aod", "0.3", "--aerosol", "maritime", "--ozone", "320", "--water-vapour", "1.5", "--no-adjacency"]
    view = [
        "--view-zenith",
        "5",
        "--relative-azimuth",
        "100",
        "--ground-height",
        "120",
        "--window",
        "16",
        "--threads",
        "1",
    ]
    wanted = ["-o", str(tmp_path / "out.tif"), "--quicklook", str(tmp_path / "look.png"), "--json"]
    assert main(["dehaze", str(raster), *SUN, *more, *physics, *view, *wanted]) == 0
    assert engine.sinks == ["haze_map", "mask", "result", "sigma"]
    options = engine.options
    assert (options.aod, options.aerosol, options.ozone_du, options.water_vapour_g_cm2) == (0.3, "maritime", 320.0, 1.5)
    assert (options.adjacency, options.ground_height_m, options.window, options.threads) == (False, 120.0, 16, 1)
    summary = json.loads(capsys.readouterr().out)
    assert summary["aod"]["mean"] == 0.25
    assert summary["geometry"] == {"sun_zenith_deg": 30.0, "view_zenith_deg": 5.0, "relative_azimuth_deg": 100.0}
    assert summary["bands"] == ["B02", "B03", "B04"]
    with rasterio.open(tmp_path / "out.tif") as file, rasterio.open(raster) as before:
        # Half of the reflectance in numbers that stand for it with an offset; scale and offset are those given.
        np.testing.assert_array_equal(file.read(), np.rint((before.read() * 1e-4 - 0.1) * 0.5 / 1e-4 + 1000))
        assert (file.scales[0], file.offsets[0]) == (1e-4, -0.1)
    with rasterio.open(files["sigma"]) as file:
        assert file.descriptions == ("sigma_B02", "sigma_B03", "sigma_B04")
    with rasterio.open(files["haze-map"]) as file:
        assert file.descriptions == ("aod_550",)
    with Image.open(tmp_path / "look.png") as look:
        assert look.size == (30 + 8 + 30, 20)


def test_a_plain_picture(engine, picture, tmp_path, capsys):
    out = tmp_path / "out.png"
    plain = ["--strength", "0.7", "--alpha", "1.5", "--transfer", "gamma"]
    assert main(["dehaze", str(picture), "-o", str(out), *plain]) == 0
    assert (engine.options.strength, engine.options.alpha, engine.options.transfer) == (0.7, 1.5, "gamma")
    assert (engine.options.aod, engine.options.adjacency) == ("auto", True)
    assert engine.source.quantity == "display"
    with Image.open(out) as result:
        np.testing.assert_allclose(np.asarray(result), PIXELS / 2, rtol=0, atol=0.501)
    assert f"wrote {out}" in said(capsys)[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "output = '': nothing would be kept"),
        (["-o", "out.gif"], "the extension must be one of"),
        (["-o", "no/out.tif"], "there is no folder"),
        (["-o", "in.tif"], "is the image itself"),
        (["-o", "out.tif", "--mask", "out.tif"], "is the file of --output"),
        (["-o", "out.tif", "--mask", "mask.png"], "the extension must be one of .tif"),
        (["--json", "--quicklook", "look.png"], "needs the result"),
        (["--json", "--dtype", "uint8"], "needs the result"),
        (["--json", "--compression", "lzw"], "is for .tif files"),
        (["-o", "out.tif", "--compression", "best"], "choose one of deflate"),
        (["-o", "out.tif", "--dtype", "complex"], "choose one of uint8"),
        (["-o", "out.tif", "--aod", "9"], "aod = '9': give a number from 0 to 5, or auto"),
        (["-o", "out.tif", "--aod", "much"], "give a number from 0 to 5, or auto"),
        (["-o", "out.tif", "--strength", "2"], "strength = '2': give a number from 0 to 1"),
        (["-o", "out.tif", "--transfer", "log"], "transfer = 'log'"),
        (["-o", "out.tif", "--window", "3"], "16 or more"),
        (["-o", "out.tif", "--threads", "0"], "1 or more"),
        (["-o", "out.tif", "--pressure", "1000", "--ground-height", "0"], "not both"),
        (["-o", "out.tif", "--sun-zenith", "x"], "sun_zenith_deg = 'x'"),
        (["-o", "out.tif", "--sun-zenith", "95"], "below the horizon"),
        (["-o", "out.tif", "--sun-zenith", "86"], "from 0 to 85 degrees"),
        (["-o", "out.tif", "--view-zenith", "5"], "needs the Sun as well"),
        (["-o", "out.tif", *SUN, "--view-zenith", "5"], "needs relative_azimuth_deg"),
        (["-o", "out.tif", "--quantity", "colour"], "quantity = 'colour'"),
        (["-o", "out.tif", "--scale", "-1"], "give a number above 0"),
        (["-o", "out.tif", "--resolution", "20"], "is for Sentinel-2 products"),
        (["-o", "out.tif", "--bands", "B99"], "no such band"),
        (["-o", "out.tif", "--aod", "0.2"], "means nothing to a plain picture"),
        (["-o", "out.tif", "--no-adjacency"], "means nothing to a plain picture"),
        (["-o", "out.tif", *SUN, "--alpha", "1"], "is for plain pictures"),
        (["-o", "out.tif", "--sensor", "sentinel-2a", "--scale", "1e-4"], "give --sun-zenith"),
        (["-o", "out.tif", "--sun-zenith", "30"], "give scale and offset"),
        (["-o", "out.png", *SUN], "a picture cannot hold reflectance"),
        (["-o", "out.tif", "--quicklook", "look.png", "--bands", "1,2"], "a quicklook needs red, green and blue"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(engine, raster, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(raster.parent)
    assert main(["dehaze", "in.tif", *arguments]) == 2
    lines = said(capsys)
    assert len(lines) == 1
    assert message in lines[0]
    assert [one.name for one in raster.parent.iterdir()] == ["in.tif"]


def test_a_missing_image_is_named(engine, tmp_path, capsys):
    assert main(["dehaze", str(tmp_path / "no.tif"), "-o", str(tmp_path / "out.tif")]) == 2
    assert "there is no such image" in said(capsys)[0]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ZeroDivisionError("x")])
def test_a_run_that_stops_leaves_nothing(engine, raster, tmp_path, capsys, error):
    engine.fail = error
    arguments = ["-o", str(tmp_path / "out.tif"), "--mask", str(tmp_path / "mask.tif")]
    assert main(["dehaze", str(raster), *SUN, *arguments]) == (130 if isinstance(error, KeyboardInterrupt) else 1)
    assert [one.name for one in tmp_path.iterdir()] == ["in.tif"]
