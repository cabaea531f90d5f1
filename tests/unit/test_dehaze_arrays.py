"""Arrays, labelled arrays and dask: names, scales, gaps, and the same bits as from a file."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.arrays import ArraySource, XarraySource
from skyscatter.dehaze.rasters.base import NODATA, SATURATED
from skyscatter.dehaze.rasters.opening import as_source
from skyscatter.dehaze.rasters.sinks import ArraySink
from skyscatter.dehaze.rasters.windows import for_each_window
from skyscatter.errors import DomainError, MissingDataError

NUMBERS = np.random.default_rng(3).integers(0, 9000, (3, 40, 50), dtype=np.uint16)
NUMBERS[:, 5:9, 5:9] = 0


def labelled(**attrs):
    return xr.DataArray(
        NUMBERS,
        dims=("band", "y", "x"),
        coords={"band": ["blue", "green", "red"], "y": np.arange(40.0)[::-1], "x": np.arange(50.0)},
        attrs={"scale_factor": 1e-4, "add_offset": -0.1, "_FillValue": 0, "title": "made up", **attrs},
        name="scene",
    )


def mean_of_nine(row0, col0, values):
    padded = np.pad(np.nan_to_num(values), ((0, 0), (1, 1), (1, 1)), mode="edge")
    rows, cols = values.shape[1:]
    total = sum(padded[:, i : i + rows, j : j + cols] for i in range(3) for j in range(3))
    return total + np.float32(1e-3) * (row0 + np.arange(rows, dtype=np.float32))[:, None]


def test_an_array_of_reflectance():
    values = np.random.default_rng(1).random((2, 20, 30)).astype(np.float32)
    values[0, 3, 4] = np.nan
    values[:, 7, 8] = np.nan
    values[1, 9, 9] = np.inf
    source = ArraySource(values, SourceOptions(sun_zenith_deg=30.0), names=["B02", "B03"])
    assert source.quantity == "reflectance"
    assert source.geometry.to_json()["sun_zenith_deg"] == 30.0
    read, flags = source.read_with_flags(2, 20, 1, 30)
    expected = np.where(np.isinf(values), np.nan, values)[:, 2:, 1:]
    np.testing.assert_array_equal(read, expected)
    assert np.argwhere(flags).tolist() == [[5, 7]]
    np.testing.assert_array_equal(
        source.read(0, 20, 0, 30, bands=["B03"])[0], np.where(np.isinf(values[1]), np.nan, values[1])
    )


def test_an_array_of_numbers_needs_a_scale():
    with pytest.raises(DomainError, match="give scale and offset"):
        ArraySource(NUMBERS, SourceOptions(quantity="reflectance"))
    told = ArraySource(NUMBERS, SourceOptions(scale=1e-4, offset=-0.1), nodata=0)
    assert told.quantity == "reflectance"
    expected = np.where(NUMBERS == 0, np.nan, NUMBERS * 1e-4 - 0.1)
    np.testing.assert_allclose(told.read(0, 40, 0, 50), expected, rtol=0, atol=2e-7)  # float32
    assert "taken as 0" in ArraySource(NUMBERS, SourceOptions(scale=1e-4)).notes[0]
    with pytest.raises(DomainError, match="in the middle"):
        ArraySource(NUMBERS.astype(np.float32), SourceOptions(sun_zenith_deg=30.0))


def test_a_picture_runs_from_0_to_1_and_black_in_one_band_is_a_colour():
    pixels = np.array([[[0, 0, 255]], [[0, 7, 255]], [[0, 0, 255]]], dtype=np.uint8)
    source = ArraySource(pixels, nodata=0)
    assert source.quantity == "display"
    read, flags = source.read_with_flags(0, 1, 0, 3)
    np.testing.assert_array_equal(flags, [[NODATA, 0, SATURATED]])
    np.testing.assert_allclose(read[:, 0, 1:], np.array([[0, 255], [7, 255], [0, 255]]) / 255, rtol=1e-6)
    assert np.all(np.isnan(read[:, 0, 0]))
    np.testing.assert_array_equal(source.read(0, 1, 0, 3, bands=[0])[0], read[0])


@pytest.mark.parametrize(
    ("array", "options", "message"),
    [
        (np.zeros((2, 3, 4), np.complex64), {}, "complex"),
        (np.zeros((2, 3, 4), np.int64), {}, "convert it to one of"),
        (np.zeros((0, 3, 4), np.float32), {}, "no bands"),
        (np.zeros((3, 0, 4), np.float32), {}, "no pixels"),
        (np.zeros(4, np.float32), {}, "must be"),
        (np.zeros((2, 3, 4), np.int16), {}, "no white"),
        (np.zeros((2, 3, 4), np.float32), {"bands": ("3",)}, "numbered from 1 to 2"),
        (np.zeros((2, 3, 4), np.float32), {"bands": ("1", "red=1")}, "named twice"),
    ],
)
def test_bad_arrays_say_what_is_wrong(array, options, message):
    with pytest.raises(DomainError, match=message):
        ArraySource(array, SourceOptions(**options))


def test_whatever_holds_an_image_becomes_a_source():
    assert isinstance(as_source(labelled()), XarraySource)
    source = as_source([[0.1, 0.2], [0.3, 0.4]], SourceOptions(sun_zenith_deg=30.0))
    assert source.read(0, 2, 0, 2).shape == (1, 2, 2)
    assert as_source(source) is source
    with pytest.raises(DomainError, match="is open already"):
        as_source(source, SourceOptions(scale=1.0))
    with pytest.raises(MissingDataError, match="no such file"):
        as_source("nowhere.tif")


def test_windows_outside_of_the_image_are_refused():
    source = ArraySource(np.zeros((1, 3, 4), np.float32))
    with pytest.raises(DomainError, match="must lie inside"):
        source.read(0, 4, 0, 4)


@pytest.mark.parametrize("order", [("band", "y", "x"), ("y", "x", "band"), ("x", "band", "y")])
def test_labelled_arrays_in_any_order(order):
    source = XarraySource(labelled().transpose(*order))
    assert [band.name for band in source.bands] == ["blue", "green", "red"]
    assert source.rgb() == (2, 1, 0)
    expected = np.where(NUMBERS == 0, np.nan, NUMBERS * 1e-4 - 0.1)
    np.testing.assert_allclose(source.read(0, 40, 0, 50), expected, rtol=0, atol=2e-7)
    result = source.wrap(source.read(0, 40, 0, 50))
    assert result.dims == ("band", "y", "x")
    assert result.attrs == {"title": "made up"}
    np.testing.assert_array_equal(result.y, labelled().y)
    assert source.wrap(np.zeros((1, 40, 50)), ["aod"]).band.values.tolist() == ["aod"]


def test_labelled_arrays_without_bands_or_with_names_in_attributes():
    one = labelled().isel(band=0, drop=True)
    assert XarraySource(one).read(0, 40, 0, 50).shape == (1, 40, 50)
    array = labelled(long_name=("B02", "B03", "B04")).drop_vars("band")
    source = XarraySource(array, SourceOptions(sensor="sentinel-2a", bands=("red", "B02")))
    assert [(band.name, band.role) for band in source.bands] == [("B04", "red"), ("B02", "blue")]
    with pytest.raises(DomainError, match="rename"):
        XarraySource(array.rename(y="up"))


@pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")  # rioxarray's own
def test_labelled_arrays_of_rioxarray_keep_their_place(tmp_path):
    rioxarray = pytest.importorskip("rioxarray")
    rasterio = pytest.importorskip("rasterio")
    path = tmp_path / "in.tif"
    layout = {
        "crs": "EPSG:32632",
        "transform": rasterio.Affine(10, 0, 4e5, 0, -10, 5e6),
        "nodata": 0,
        "dtype": "uint16",
    }
    with rasterio.open(path, "w", driver="GTiff", height=40, width=50, count=3, **layout) as file:
        file.scales, file.offsets = [1e-4] * 3, [-0.1] * 3
        for number, name in enumerate(("B02", "B03", "B04"), start=1):
            file.set_band_description(number, name)
        file.write(NUMBERS)
    with rioxarray.open_rasterio(path) as array:
        source = XarraySource(array)
        assert [band.name for band in source.bands] == ["B02", "B03", "B04"]
        assert source.profile.transform == layout["transform"]
        assert source.wrap(source.read(0, 40, 0, 50)).rio.crs.to_epsg() == 32632
        expected = np.where(NUMBERS == 0, np.nan, NUMBERS * 1e-4 - 0.1)
        np.testing.assert_allclose(source.read(0, 40, 0, 50), expected, rtol=0, atol=2e-7)


@pytest.mark.parametrize("chunks", [(16, 50), (13, 17), (40, 50)])
def test_dask_gives_the_bits_of_the_windows_and_stays_lazy(chunks):
    pytest.importorskip("dask")
    from skyscatter.dehaze.rasters.lazy import apply_dask

    source = XarraySource(labelled())
    sink = ArraySink(40, 50, 3)
    for_each_window(source, sink, mean_of_nine, size=64, overlap=1)
    computed = []

    def noted(row0, col0, values):
        computed.append((row0, col0))
        return mean_of_nine(row0, col0, values)

    lazy = labelled().chunk({"band": 1, "y": chunks[0], "x": chunks[1]})
    answer = apply_dask(lazy, noted, overlap=1)
    assert computed == []
    assert answer.chunks[1:] == lazy.chunks[1:]
    np.testing.assert_array_equal(answer.compute(scheduler="synchronous").values, sink.array)
    assert len(computed) == len(lazy.chunks[1]) * len(lazy.chunks[2])


def test_dask_with_flags_and_other_bands():
    pytest.importorskip("dask")
    from skyscatter.dehaze.rasters.lazy import apply_dask

    def empty(row0, col0, values, flags):
        return (flags & NODATA)[np.newaxis]

    answer = apply_dask(labelled().chunk({"y": 7}), empty, names=["empty"], flags=True)
    np.testing.assert_array_equal(answer.sel(band="empty").values, (NUMBERS == 0).all(axis=0))
    with pytest.raises(DomainError, match="is not lazy"):
        apply_dask(labelled(), empty)


def test_lazy_arrays_are_read_window_by_window():
    dask_array = pytest.importorskip("dask.array")
    seen = []

    def block(numbers, block_info=None):
        seen.append(block_info[0]["chunk-location"])
        return numbers

    lazy = labelled().copy(data=dask_array.from_array(NUMBERS, chunks=(3, 10, 50)).map_blocks(block, dtype=np.uint16))
    seen.clear()
    source = XarraySource(lazy)
    values = source.read(12, 18, 0, 50)
    assert {place[1] for place in seen} == {1}
    np.testing.assert_allclose(values[0], NUMBERS[0, 12:18] * 1e-4 - 0.1, rtol=0, atol=2e-7)


def test_the_accessor_delegates(monkeypatch):
    import skyscatter.dehaze.xarray

    calls = []
    monkeypatch.setattr(
        skyscatter.dehaze, "dehaze", lambda *what, **how: calls.append((what, how)) or "result", raising=False
    )
    array = labelled()
    assert array.skyscatter.dehaze(aod=0.3) == "result"
    assert calls[0][0][0] is array
    assert calls[0][1] == {"aod": 0.3}


def test_the_source_modules_load_nothing_heavy():
    code = (
        "import sys, skyscatter.dehaze.options, skyscatter.dehaze.geometry, skyscatter.dehaze.rasters.opening,"
        "skyscatter.dehaze.rasters.windows, skyscatter.dehaze.rasters.outputs, skyscatter.dehaze.rasters.arrays;"
        "print([name for name in ('rasterio', 'xarray', 'PIL', 'dask', 'numba', 'astropy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_missing_libraries_are_named(monkeypatch):
    from skyscatter.dehaze.rasters.handles import require_rasterio
    from skyscatter.errors import SkyscatterError

    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(SkyscatterError, match="pip install rasterio"):
        require_rasterio()
