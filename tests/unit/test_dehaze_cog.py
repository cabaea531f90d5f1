"""Results as Cloud-Optimised GeoTIFF: what is carried on, that windows leave no trace, nor do failures."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

rasterio = pytest.importorskip("rasterio")

from rasterio.control import GroundControlPoint  # noqa: E402
from rasterio.enums import ColorInterp  # noqa: E402
from rasterio.rpc import RPC  # noqa: E402

from skyscatter.dehaze.options import SourceOptions  # noqa: E402
from skyscatter.dehaze.rasters.encoding import Encoding, result_encoding  # noqa: E402
from skyscatter.dehaze.rasters.geotiff import GeoTiffSource  # noqa: E402
from skyscatter.dehaze.rasters.handles import DatasetPool, environment  # noqa: E402
from skyscatter.dehaze.rasters.outputs import open_layer, open_result  # noqa: E402
from skyscatter.dehaze.rasters.sinks import ArraySink, together  # noqa: E402
from skyscatter.dehaze.rasters.windows import for_each_window, map_windows, windows  # noqa: E402
from skyscatter.errors import DomainError, SkyscatterError  # noqa: E402

UTM = {"crs": "EPSG:32632", "transform": rasterio.Affine(10.0, 0.0, 4e5, 0.0, -10.0, 5e6)}


def unchanged(row0, col0, values):
    return values


def write_tiff(path, numbers, *, colours=None, names=None, scale=None, offset=None, tags=None, mask=None, **profile):
    count, height, width = numbers.shape
    layout = {**UTM, **profile}
    with rasterio.open(
        path, "w", driver="GTiff", height=height, width=width, count=count, dtype=numbers.dtype, **layout
    ) as file:
        if colours:
            file.colorinterp = [ColorInterp[colour] for colour in colours]
        for number, name in enumerate(names or (), start=1):
            file.set_band_description(number, name)
            file.update_tags(number, origin=f"of {name}")
        if scale is not None:
            file.scales, file.offsets = [scale] * count, [offset] * count
        file.update_tags(**(tags or {}))
        file.write(numbers)
        if mask is not None:
            file.write_mask(mask)
    return path


@pytest.fixture
def scaled(tmp_path):
    """Reflectance of four bands as uint16 with scale, offset, nodata, names and tags."""
    numbers = np.random.default_rng(1).integers(1, 9000, (4, 150, 170), dtype=np.uint16)
    numbers[:, :20, :30] = 0
    numbers[2, 40, 50] = 0
    return write_tiff(
        tmp_path / "scaled.tif",
        numbers,
        nodata=0,
        names=["B02", "B03", "B04", "B08"],
        colours=["blue", "green", "red", "nir"],
        scale=1e-4,
        offset=-0.1,
        tags={"MISSION": "none", "AREA_OR_POINT": "Point"},
        photometric="MINISBLACK",
    )


def passed(source_path, out, options=None, **window):
    with GeoTiffSource(str(source_path), options or SourceOptions()) as source, open_result(out, source) as sink:
        for_each_window(source, sink, unchanged, **window)
    return out


def assert_same_place(before, after):
    """All that says where, what and how, and every number."""
    with rasterio.open(before) as a, rasterio.open(after) as b:
        for field in ("crs", "transform", "nodatavals", "descriptions", "colorinterp", "dtypes", "scales", "offsets"):
            assert getattr(a, field) == getattr(b, field), field
        assert a.units == b.units
        assert a.tags() == b.tags()
        for number in a.indexes:
            kept = {key: value for key, value in a.tags(number).items() if not key.startswith("STATISTICS_")}
            assert kept == b.tags(number)
        assert b.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        np.testing.assert_array_equal(a.read_masks(), b.read_masks())
        there = a.dataset_mask() != 0  # what lies under an alpha of zero is not kept: zero where nothing was
        np.testing.assert_array_equal(np.where(there, a.read(), 0), b.read())


def test_a_raster_passes_through_with_all_that_it_says(scaled, tmp_path):
    assert_same_place(scaled, passed(scaled, tmp_path / "out.tif", size=64))


@pytest.mark.parametrize("name", ["RGB.byte.tif", "RGBA.uint16.tif"])
def test_published_rasters_pass_through_with_all_that_they_say(reference, tmp_path, name):
    path = reference / "imagery" / name
    assert_same_place(path, passed(path, tmp_path / "out.tif", size=200, threads=2))


def test_a_file_without_georeference_passes_through(tmp_path):
    numbers = np.arange(3 * 40 * 50, dtype=np.uint8).reshape(3, 40, 50)
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        path = write_tiff(tmp_path / "plain.tif", numbers, crs=None, transform=None)
    out = passed(path, tmp_path / "out.tif")
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        file = rasterio.open(out)
    with file:
        assert file.crs is None
        assert file.transform.is_identity
        np.testing.assert_array_equal(file.read(), numbers)


def test_control_points_pass_through(tmp_path):
    places = ((0, 0), (0, 40), (30, 5), (30, 40))
    points = [GroundControlPoint(row, col, 4e5 + 9 * col, 5e6 - 9 * row, 0.0) for row, col in places]
    path = write_tiff(tmp_path / "gcps.tif", np.full((1, 30, 40), 7, np.uint8), transform=None, gcps=points)
    with rasterio.open(passed(path, tmp_path / "out.tif")) as file:
        kept, crs = file.gcps
        assert crs.to_epsg() == 32632
        for before, after in zip(points, kept, strict=True):
            assert (before.row, before.col, before.x, before.y) == (after.row, after.col, after.x, after.y)


def test_rational_polynomials_pass_through(tmp_path):
    one, other = [1.0] + [0.0] * 19, [0.0, 1.0] + [0.0] * 18
    centre = {"height_off": 0.0, "lat_off": 45.0, "long_off": 9.0, "line_off": 15.0, "samp_off": 20.0}
    span = {"height_scale": 500.0, "lat_scale": 0.1, "long_scale": 0.1, "line_scale": 15.0, "samp_scale": 20.0}
    coefficients = {"line_num_coeff": other, "line_den_coeff": one, "samp_num_coeff": other, "samp_den_coeff": one}
    rpc = RPC(**centre, **span, **coefficients, err_bias=1.0, err_rand=2.0)
    path = write_tiff(tmp_path / "rpc.tif", np.full((1, 30, 40), 7, np.uint8), crs=None, transform=None, rpcs=rpc)
    with rasterio.open(passed(path, tmp_path / "out.tif")) as file:
        assert file.rpcs.to_dict() == rpc.to_dict()


def test_a_mask_of_its_own_passes_through(tmp_path):
    mask = np.ones((60, 70), dtype=bool)
    mask[10:30, 5:20] = False
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
        path = write_tiff(tmp_path / "masked.tif", np.full((3, 60, 70), 90, np.uint8), mask=mask)
    with GeoTiffSource(str(path), SourceOptions()) as source:
        np.testing.assert_array_equal(np.isnan(source.read(0, 60, 0, 70)[0]), ~mask)
    out = tmp_path / "out.tif"
    with GeoTiffSource(str(path), SourceOptions()) as source, open_result(out, source) as sink:
        sink.write(0, 0, source.read(0, 60, 0, 70))
    assert sorted(one.name for one in tmp_path.iterdir()) == ["masked.tif", "out.tif"]
    with rasterio.open(out) as file:
        np.testing.assert_array_equal(file.dataset_mask() != 0, mask)
        np.testing.assert_array_equal(file.read()[:, mask], 90)


def local_function(row0, col0, values):
    """A mean over 3 x 3 pixels: needs one pixel around, and the image's edge where it is."""
    padded = np.pad(np.nan_to_num(values, nan=0.5), ((0, 0), (1, 1), (1, 1)), mode="edge")
    rows, cols = values.shape[1:]
    total = sum(padded[:, i : i + rows, j : j + cols] for i in range(3) for j in range(3))
    place = np.arange(row0, row0 + rows)[:, None] + 0.001 * np.arange(col0, col0 + cols)
    return (total / 9.0 + 1e-3 * place + 0.0 * values).astype(np.float32)


@pytest.mark.parametrize(("size", "multiple", "threads"), [(16, 1, 2), (37, 12, 2), (64, 64, 1), (999, 5, 3)])
def test_windows_of_any_size_give_the_same_bits(scaled, size, multiple, threads):
    with GeoTiffSource(str(scaled), SourceOptions()) as source:
        whole = local_function(0, 0, source.read(0, 150, 0, 170))
        sink = ArraySink(150, 170, 4)
        for_each_window(source, sink, local_function, size=size, multiple=multiple, overlap=1, threads=threads)
    np.testing.assert_array_equal(sink.array, whole)


def test_windows_tile_the_image_on_the_lattice():
    tiles = list(windows(100, 70, 30, multiple=8))
    seen = np.zeros((100, 70), dtype=int)
    for row0, row1, col0, col1 in tiles:
        seen[row0:row1, col0:col1] += 1
        assert row0 % 8 == 0
        assert col0 % 8 == 0
    assert np.all(seen == 1)
    assert tiles[0].shape == (32, 32)


def test_no_more_windows_than_threads_and_one_are_held(scaled):
    lock, held, most = threading.Lock(), 0, 0

    def hold(row0, col0, values):
        nonlocal held, most
        with lock:
            held += 1
            most = max(most, held)
        return values

    with GeoTiffSource(str(scaled), SourceOptions()) as source:
        shares = []
        for _ in map_windows(source, hold, size=20, threads=2, progress=shares.append):
            with lock:
                most = max(most, held)
                held -= 1
    assert 1 < most <= 3
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_failing_function_leaves_the_old_file_and_nothing_else(scaled, tmp_path):
    out = tmp_path / "out.tif"
    out.write_text("old")
    before = sorted(tmp_path.iterdir())

    def fail(row0, col0, values):
        if row0 > 64:
            raise KeyboardInterrupt
        return values

    source = GeoTiffSource(str(scaled), SourceOptions())
    with source, pytest.raises(KeyboardInterrupt), open_result(out, source) as sink:
        for_each_window(source, sink, fail, size=64)
    assert out.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == before


def test_of_several_files_none_is_moved_before_all_are_whole(scaled, tmp_path):
    class Broken(ArraySink):
        def prepare(self):
            raise DomainError("sink", "broken", "must fail")

    with GeoTiffSource(str(scaled), SourceOptions()) as source:
        sinks = {"result": open_result(tmp_path / "out.tif", source), "map": Broken(150, 170, 4)}
        with pytest.raises(DomainError), together(sinks):
            for_each_window(source, sinks, lambda row0, col0, values: {"result": values, "map": values})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scaled.tif"]


def test_a_file_that_is_being_read_is_closed_when_that_is_done(scaled):
    """GDAL crashes where one thread closes what another reads, as after a sink that failed."""
    pool = DatasetPool(str(scaled), "scaled.tif")
    begun, go_on = threading.Event(), threading.Event()

    def read() -> bool:
        with pool.reading() as dataset:
            begun.set()
            go_on.wait(60.0)
            return dataset.closed

    with ThreadPoolExecutor(2) as threads:
        reads = threads.submit(read)
        begun.wait(60.0)
        closes = threads.submit(pool.close)
        with pytest.raises(TimeoutError):
            closes.result(0.2)
        go_on.set()
        assert not reads.result(60.0)
        closes.result(60.0)


LIMITED = """
    import resource, signal, sys
    from skyscatter.dehaze.rasters.opening import open_raster
    from skyscatter.dehaze.rasters.outputs import open_result
    from skyscatter.dehaze.rasters.windows import for_each_window
    from skyscatter.errors import SkyscatterError
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    name, out, limit, options = sys.argv[1], sys.argv[2], int(sys.argv[3]), eval(sys.argv[4])
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    try:
        with open_raster(name) as source, open_result(out, source, **options) as sink:
            for_each_window(source, sink, lambda row0, col0, values: values, size=256)
    except SkyscatterError as error:
        print(error)
        sys.exit(2)
"""


@pytest.mark.parametrize(
    ("out", "limit", "options"),
    [
        ("out.tif", 200_000, {}),  # met by the tiles, of 2.1 MB
        ("out.tif", 2_200_000, {"compression": "none"}),  # met by the finished file
        ("out.png", 200_000, {"dtype": "uint8"}),
        ("out.png", 200_000, {"dtype": "uint16"}),
        ("out.jpg", 200_000, {}),
    ],
)
def test_a_disk_that_takes_no_more_leaves_nothing(tmp_path, out, limit, options):
    """A limit on the size of files stands in for the full disk."""
    numbers = np.random.default_rng(2).integers(1, 60000, (1, 800, 800), dtype=np.uint16)
    write_tiff(tmp_path / "in.tif", numbers)
    command = [sys.executable, "-c", textwrap.dedent(LIMITED), "in.tif", out, str(limit), repr(options)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stdout.startswith(f"{out}: cannot be written: ")
    assert done.stdout.count("\n") == 1
    assert [one.name for one in tmp_path.iterdir()] == ["in.tif"]


STREAMED = """
    import re
    from skyscatter.dehaze.rasters.opening import open_raster
    from skyscatter.dehaze.rasters.outputs import open_result
    from skyscatter.dehaze.rasters.windows import for_each_window
    with open_raster("in.tif") as source, open_result("out.tif", source, compression="none") as sink:
        for_each_window(source, sink, lambda row0, col0, values: values + 0.0, threads=2)
    print(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_raster(tmp_path):
    """Three windows of 50 MB with as much scratch, 256 MB of GDAL's blocks and the libraries; the raster has 1.7 GB."""
    layout = {"height": 12000, "width": 12000, "count": 6, "tiled": True, "blockxsize": 512, "blockysize": 512, **UTM}
    with rasterio.open(tmp_path / "in.tif", "w", driver="GTiff", dtype="uint16", nodata=0, **layout) as file:
        file.scales, file.offsets = [1e-4] * 6, [0.0] * 6
        file.write(np.full((6, 512, 512), 900, np.uint16), window=((5000, 5512), (5000, 5512)))
    command = [sys.executable, "-c", textwrap.dedent(STREAMED)]
    # The peak of this program alone: `ru_maxrss` would begin with that of the process which started it.
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert int(done.stdout) < 900 * 1024


def test_paths_that_cannot_be_written_are_refused_at_once(scaled, tmp_path):
    with GeoTiffSource(str(scaled), SourceOptions()) as source:
        with pytest.raises(SkyscatterError, match="directory does not exist"):
            open_result(tmp_path / "no" / "out.tif", source)
        with pytest.raises(DomainError, match="extension must be one of"):
            open_result(tmp_path / "out.gif", source)


def test_maps_carry_the_place_and_their_own_names(scaled, tmp_path):
    out, mask = tmp_path / "haze.tif", tmp_path / "mask.tif"
    with GeoTiffSource(str(scaled), SourceOptions()) as source:
        haze = open_layer(out, source, ["aod", "sigma"], units="1")
        sinks = {"haze": haze, "mask": open_layer(mask, source, ["flags"], dtype="uint8")}
        with together(sinks):
            haze.tag({"SKYSCATTER": "haze"})
            both = lambda row0, col0, values, flags: {"haze": values[:2], "mask": flags}  # noqa: E731
            for_each_window(source, sinks, both, flags=True, size=64)
        values, flags = source.read_with_flags(0, 150, 0, 170)
    with rasterio.open(scaled) as before, rasterio.open(out) as file, rasterio.open(mask) as bits:
        assert (file.crs, file.transform) == (before.crs, before.transform)
        assert file.descriptions == ("aod", "sigma")
        assert file.tags()["SKYSCATTER"] == "haze"
        assert np.isnan(file.nodata)
        np.testing.assert_array_equal(file.read(), values[:2])
        np.testing.assert_array_equal(bits.read(1), flags)


def test_integers_keep_data_apart_from_nodata():
    encoding = Encoding("uint16", (1e-4,), (0.0,), nodata=0.0)
    numbers = encoding.encode(np.array([[[0.0, np.nan, 0.5, 9.0, -0.2]]], dtype=np.float32))
    np.testing.assert_array_equal(numbers, [[[1, 0, 5000, 65535, 1]]])
    picture = Encoding("uint8", (1 / 255,) * 2, (0.0,) * 2, nodata=0.0, together=True)
    numbers = picture.encode(np.array([[[0.0, 0.0, np.nan]], [[0.0, 0.4, np.nan]]], dtype=np.float32))
    np.testing.assert_array_equal(numbers, [[[1, 0, 0]], [[1, 102, 0]]])


def test_gaps_that_cannot_be_said_are_refused():
    with pytest.raises(DomainError, match="gaps"):
        Encoding("uint8", (1.0,), (0.0,)).encode(np.full((1, 2, 2), np.nan, np.float32))


def test_coarse_integers_of_reflectance_become_floats(tmp_path):
    path = write_tiff(tmp_path / "coarse.tif", np.full((1, 9, 9), 7, np.uint8), nodata=0, scale=1 / 255, offset=0.0)
    with GeoTiffSource(str(path), SourceOptions()) as source:
        assert source.quantity == "reflectance"
        encoding = result_encoding(source)
        assert (encoding.dtype, encoding.tagged) == ("float32", False)
        assert np.isnan(encoding.nodata)
        assert result_encoding(source, "uint16").nodata == 0.0
        with pytest.raises(DomainError, match="too coarse"):
            result_encoding(source, "uint8")


def test_the_cache_of_blocks_holds_more_than_one():
    """It was 256 bytes: every tile was read again for every window, and results lost windows (see below)."""
    from rasterio.env import get_gdal_config

    with environment():
        assert 100e6 < get_gdal_config("GDAL_CACHEMAX") < 1e9


def test_what_is_written_does_not_wait(tmp_path, scaled):
    """A thread that reads may put a waiting block on the disk over what is written next: beside two of them, 8 windows
    of 25 600 lost a band."""
    with GeoTiffSource(str(scaled), SourceOptions()) as source, open_result(tmp_path / "out.tif", source) as sink:
        values = source.read(16, 32, 16, 32)
        sink.write(16, 16, values)
        (work,) = tmp_path.glob("*.work.tif")
        with rasterio.open(work) as file:
            np.testing.assert_array_equal(file.read(window=((16, 32), (16, 32))), sink.encoding.encode(values))
