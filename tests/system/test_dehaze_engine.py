"""Images through the whole of `skyscatter.dehaze`: surface reflectance back, the same in any windows, lazy or not."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from dehaze_tables import Atmosphere, bands_of, ground, made_up_table, seen_from_above

import skyscatter
from skyscatter.dehaze import physical
from skyscatter.dehaze.adjacency import environment, spread_function
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.table import Angles, build_table
from skyscatter.errors import DomainError

SUN, AOD = 35.0, 0.2
NAMES = ("B02", "B04", "B8A")
ALL = ("B02", "B03", "B04", "B8A", "B11", "B12")
KNOWN = {"sensor": "sentinel-2a", "sun_zenith_deg": SUN, "quantity": "reflectance"}
PARTS = ("reflectance", "sigma", "haze_map", "mask")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SKYSCATTER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def quick(monkeypatch):
    """Tables in closed form, of which there can be many, and few walks."""
    monkeypatch.setattr(physical, "build_table", made_up_table)
    monkeypatch.setattr(physical, "WALKS", 2000)


def solved(aerosol, aod):
    return build_table(Atmosphere(aerosol=aerosol), bands_of(*NAMES), Angles.spanned(SUN, 0.0, 0.0), aod=aod)


def test_the_solvers_own_image_gives_its_surface_back(cache):
    """Forward with the polarised solution, gases and vapour in; back by the function: within 1e-4 everywhere."""
    surface = ground(bands_of(*NAMES), 70, 50)
    columns = {"ozone_du": 310.0, "water_vapour": 2.0}
    toa = seen_from_above(solved("urban", AOD), surface, AOD, SUN, **columns)
    options = {"ozone_du": 310.0, "water_vapour_g_cm2": 2.0, "aerosol": "urban", "aod": AOD, "adjacency": False}
    result = skyscatter.dehaze(toa.astype(np.float32), bands=NAMES, **KNOWN, **options)
    np.testing.assert_allclose(result.reflectance, surface, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(result.haze_map, np.float32(AOD))
    assert np.all(result.sigma > 0)
    assert not result.is_relative
    assert result.aerosol["model"] == "urban"
    assert result.diagnostics["aod"] == {"source": "given", "mean": AOD, "sigma": 0.0, "least": AOD, "greatest": AOD}
    assert result.diagnostics["flags"]["clipped"] == 0.0
    assert result.diagnostics["flags"]["uncertain"] == 0.0


def test_uniform_ground_comes_back_with_surroundings_too(cache):
    surface = np.array([0.05, 0.1, 0.3])[:, None, None] * np.ones((40, 40))
    toa = seen_from_above(solved("urban", AOD), surface, AOD, SUN)
    result = skyscatter.dehaze(toa, bands=NAMES, **KNOWN, aerosol="urban", aod=AOD, pixel_size_m=100.0)
    np.testing.assert_allclose(result.reflectance, surface, rtol=0, atol=1e-4)


def test_the_light_of_the_surroundings_is_taken_off(quick):
    """A dark square in a bright plain, made with the spread function itself: most of that light is found."""
    bands = bands_of(*NAMES)
    surface = np.full((3, 48, 48), 0.4)
    surface[:, 18:30, 18:30] = 0.03
    table = made_up_table(Atmosphere(aerosol="none"), bands, Angles.spanned(SUN, 0.0, 0.0))
    wavelengths = np.array([band.effective_wavelength for band in bands])
    spread = spread_function(Atmosphere(aerosol="none").medium(0.0), wavelengths, 0.0, walks=2000)
    toa = seen_from_above(table, surface, 0.0, SUN, environment(surface, 200.0, spread))
    given = {**KNOWN, "bands": NAMES, "aerosol": "none", "aod": 0.0}
    without = skyscatter.dehaze(toa, **given, adjacency=False).reflectance - surface
    found = skyscatter.dehaze(toa, **given, pixel_size_m=200.0).reflectance - surface
    inside = (slice(None), slice(20, 28), slice(20, 28))
    assert np.all(np.abs(without[inside]).max(axis=(1, 2)) > 5 * np.abs(found[inside]).max(axis=(1, 2)))
    # Surroundings are told from the image as it is seen, whose contrasts the air has lessened by its diffuse share.
    assert np.abs(found).max() < 0.003


def hazy(height=150, width=210, cloud=True):
    """An image of six bands under haze that grows to the right, with a cloud, a hole, and a saturated corner."""
    bands = bands_of(*ALL)
    table = made_up_table(Atmosphere(aerosol="continental"), bands, Angles.spanned(SUN, 0.0, 0.0))
    aod = np.linspace(0.15, 0.35, width) * np.ones((height, 1))
    toa = seen_from_above(table, ground(bands, height, width), aod, SUN).astype(np.float32)
    if cloud:
        toa[:, 30:50, 40:80] = np.array([0.6, 0.6, 0.6, 0.6, 0.5, 0.45], np.float32)[:, None, None]
    toa[:, 100:110, :30] = np.nan
    toa[2, 60, 60] = np.nan
    return toa


def same(one, other):
    for name in PARTS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.diagnostics == other.diagnostics


@pytest.mark.parametrize("aod", [pytest.param("auto", marks=pytest.mark.slow), 0.25])
def test_neither_windows_nor_threads_change_a_bit(quick, aod):
    toa = hazy(115, 130)
    given = {**KNOWN, "bands": ALL, "aod": aod, "pixel_size_m": 60.0}
    whole = skyscatter.dehaze(toa, **given, window=4096, threads=1)
    for window, threads in ((64, 2), (100, 1)):
        same(whole, skyscatter.dehaze(toa, **given, window=window, threads=threads))


def test_the_haze_is_found_and_flags_are_set(quick):
    toa = hazy()
    result = skyscatter.dehaze(toa, bands=ALL, **KNOWN)  # pixels of unknown size: their own surroundings, as made
    aod, mask = result.diagnostics["aod"], result.mask[0]
    assert aod["source"] == "estimated"
    # The darkest pixels of every cell are darker than their cover is as a rule; that is worth some 0.05.
    assert abs(aod["mean"] - 0.25) < 2 * aod["sigma"] + 0.05
    slope = result.haze_map[0, :, 150:].mean() - result.haze_map[0, :, :60].mean()
    assert slope > 0.03
    assert np.all(mask[30:50, 40:80] & Flag.CLOUD)
    assert not np.any(mask[60:90, 100:] & Flag.CLOUD)
    assert np.all(mask[100:110, :30] & Flag.NODATA)
    assert np.isnan(result.reflectance[:, 100:110, :30]).all()
    assert np.isnan(result.sigma[:, 100:110, :30]).all()
    assert np.isnan(result.reflectance[2, 60, 60])
    assert np.isfinite(result.reflectance[[0, 1, 3, 4, 5], 60, 60]).all()
    seen = np.isfinite(toa)
    assert np.all(np.isfinite(result.reflectance) == seen)
    assert np.all(result.reflectance[seen] >= 0)
    flags = result.diagnostics["flags"]
    for flag in Flag:
        assert flags[flag.name.lower()] == pytest.approx(((mask & flag) != 0).mean(), abs=1e-6)
    assert flags["nodata"] == pytest.approx(300 / toa[0].size, abs=1e-6)
    assert flags["water"] > 0.02


def test_flags_are_counted_for_pictures():
    rng = np.random.default_rng(3)
    picture = rng.integers(20, 200, (3, 64, 80), dtype=np.uint8)
    result = skyscatter.dehaze(picture, bands=("red", "green", "blue"), window=32)
    assert result.is_relative
    for flag in Flag:
        share = ((result.mask & flag) != 0).mean()
        assert result.diagnostics["flags"][flag.name.lower()] == pytest.approx(share, abs=1e-6)


def test_no_aerosol_is_no_haze(quick):
    surface = ground(bands_of(*ALL), 40, 40)
    table = made_up_table(Atmosphere(aerosol="none"), bands_of(*ALL), Angles.spanned(SUN, 0.0, 0.0))
    toa = seen_from_above(table, surface, 0.0, SUN)
    result = skyscatter.dehaze(toa, bands=ALL, **KNOWN, aerosol="none", adjacency=False)
    np.testing.assert_allclose(result.reflectance, surface, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(result.haze_map, 0.0)


def test_radiance_and_reflectance_are_the_same_image(quick):
    """With cirrus on the right, which is told by its own band and taken off."""
    names = (*ALL, "B10")
    toa = np.concatenate([hazy(64, 64, cloud=False), np.full((1, 64, 64), 0.001, np.float32)])
    toa[:, :, 40:] += 0.02
    given = {"bands": names, "aod": 0.25, "sensor": "sentinel-2a", "sun_zenith_deg": SUN, "adjacency": False}
    expected = skyscatter.dehaze(toa, quantity="reflectance", **given)
    irradiance = 1e3 * np.array([band.solar_irradiance for band in bands_of(*names)])[:, None, None]
    radiance = toa * np.cos(np.radians(SUN)) * irradiance / np.pi
    found = skyscatter.dehaze(radiance.astype(np.float32), quantity="radiance", **given)
    np.testing.assert_allclose(found.reflectance[:-1], expected.reflectance[:-1], rtol=0, atol=2e-6)
    cirrus = (found.mask[0] & Flag.CIRRUS) != 0
    np.testing.assert_array_equal(cirrus, (expected.mask[0] & Flag.CIRRUS) != 0)
    assert cirrus[:, 40:].all()
    assert not cirrus[:, :40].any()
    assert any("the date is unknown" in note for note in found.diagnostics["remarks"])


@pytest.mark.parametrize(
    ("toa", "more", "message"),
    [
        (np.full((6, 20, 20), np.nan), {}, "has no clear pixel"),
        (np.full((6, 20, 20), 0.6), {}, "has no clear pixel"),
        (np.full((6, 20, 20), 0.6), {"aod": 0.2}, "has no clear pixel"),
        (np.full((6, 20, 20), 0.1 + 0.1j), {}, "complex"),
        (np.zeros((0, 20, 20)), {}, "has no bands or no pixels"),
        (np.full((6, 20, 20), 0.1), {"sun_zenith_deg": 91.0}, "below the horizon"),
        (np.full((6, 20, 20), 0.1), {"sun_zenith_deg": None}, "does not say where the Sun was"),
        (np.full((6, 20, 20), 0.1), {"sensor": "sentinel-2c"}, "sentinel-2a or sentinel-2b"),
        (np.full((6, 20, 20), 0.1), {"aerosol": "smoke"}, "aerosol"),
        (np.full((6, 20, 20), 0.1), {"aerosol": "none", "aod": 0.3}, "there is no haze where aerosol is none"),
        (np.full((6, 20, 20), 0.1), {"window": "big"}, "window = 'big'"),
        (np.full((6, 20, 20), 0.1), {"strength": 0.5}, "means nothing to an image of reflectance"),
        (np.full((6, 20, 20), 0.1), {"windows": 3}, "no such option; did you mean window"),
    ],
)
def test_what_cannot_be_dehazed_is_refused_in_one_line(quick, toa, more, message):
    with pytest.raises(DomainError, match=message) as caught:
        skyscatter.dehaze(toa, **{**KNOWN, "bands": ALL, **more})
    assert "\n" not in str(caught.value)


# --- labelled and lazy arrays


def labelled(toa):
    xarray = pytest.importorskip("xarray")
    height, width = toa.shape[1:]
    coords = {"band": list(ALL), "y": 5e6 - 60.0 * np.arange(height), "x": 4e5 + 60.0 * np.arange(width), "orbit": 65}
    attrs = {"title": "a field", "units": "1"}
    return xarray.DataArray(toa, dims=("band", "y", "x"), coords=coords, attrs=attrs, name="reflectance")


def test_labelled_arrays_keep_their_labels(quick):
    pytest.importorskip("xarray")
    import skyscatter.dehaze.xarray

    array = labelled(hazy(80, 90))
    result = array.skyscatter.dehaze(**KNOWN, aod=0.25, adjacency=False)
    plain = skyscatter.dehaze(array.values, **KNOWN, bands=ALL, aod=0.25, adjacency=False)
    for name in PARTS:
        np.testing.assert_array_equal(getattr(result, name).values, getattr(plain, name))
        for dim in ("y", "x", "orbit"):
            assert getattr(result, name).coords[dim].equals(array.coords[dim])
    assert result.reflectance.coords["band"].values.tolist() == list(ALL)
    assert result.reflectance.attrs["title"] == "a field"
    assert result.mask.dtype == np.uint8
    turned = array.transpose("x", "band", "y").skyscatter.dehaze(**KNOWN, aod=0.25, adjacency=False)
    np.testing.assert_array_equal(turned.reflectance.transpose(*array.dims).values, plain.reflectance)


@pytest.mark.parametrize(
    ("aod", "chunks"),
    [pytest.param("auto", {"y": 40, "x": 50}, marks=pytest.mark.slow), (0.25, {"band": 1, "y": 33})],
)
def test_lazy_arrays_give_the_same_and_stay_lazy(quick, chunks, aod):
    pytest.importorskip("dask")
    array = labelled(hazy(80, 90))
    given = {**KNOWN, "aod": aod, "pixel_size_m": 60.0}
    lazy, plain = skyscatter.dehaze(array.chunk(chunks), **given), skyscatter.dehaze(array, **given)
    for name in PARTS:
        found = getattr(lazy, name)
        assert hasattr(found.data, "dask")
        assert found.dtype == getattr(plain, name).dtype
        np.testing.assert_array_equal(found.values, getattr(plain, name).values, err_msg=name)
        assert found.coords["x"].equals(array.coords["x"])
    assert lazy.diagnostics == {k: v for k, v in plain.diagnostics.items() if k != "flags"}
    # A part asks only for the chunks that it lies in, and is the same part.
    part = lazy.reflectance.isel(y=slice(5, 20), x=slice(60, 80))
    np.testing.assert_array_equal(part.values, plain.reflectance.isel(y=slice(5, 20), x=slice(60, 80)).values)


def test_lazy_pictures():
    pytest.importorskip("dask")
    xarray = pytest.importorskip("xarray")
    numbers = np.random.default_rng(5).integers(30, 220, (3, 70, 60), dtype=np.uint8)
    array = xarray.DataArray(numbers, dims=("band", "y", "x"), coords={"band": ["red", "green", "blue"]})
    lazy, plain = skyscatter.dehaze(array.chunk({"y": 32})), skyscatter.dehaze(array)
    for name in PARTS:
        np.testing.assert_array_equal(getattr(lazy, name).values, getattr(plain, name).values)


@pytest.mark.parametrize(
    ("imports", "there"),
    [
        ("import xarray, skyscatter.dehaze", True),
        ("import skyscatter.dehaze, skyscatter.dehaze.xarray", True),
        ("import skyscatter.dehaze", None),
    ],
)
def test_the_accessor_comes_with_xarray_and_never_brings_it(imports, there):
    pytest.importorskip("xarray")
    code = (
        f"import sys; {imports}; x = sys.modules.get('xarray'); "
        "print(None if x is None else hasattr(x.DataArray, 'skyscatter'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(there)


def test_masked_pixels_of_an_array_are_no_data(quick):
    masked = np.ma.masked_array(np.full((6, 20, 20), 0.1), mask=np.zeros((6, 20, 20), bool))
    masked.mask[:, :3, :5] = True
    found = skyscatter.dehaze(masked, bands=ALL, aod=AOD, aerosol="urban", **KNOWN)
    assert np.isnan(found.reflectance[:, :3, :5]).all()
    assert (found.mask[0, :3, :5] & int(Flag.NODATA)).all()
    assert np.isfinite(found.reflectance[:, 3:, 5:]).all()


def test_bands_of_a_plain_array_are_never_guessed(quick):
    image = np.full((6, 20, 24), 0.1)
    with pytest.raises(DomainError, match="does not say which bands"):
        skyscatter.dehaze(image, **KNOWN)
    with pytest.raises(DomainError, match="moveaxis"):
        skyscatter.dehaze(np.moveaxis(image, 0, -1), bands=ALL, **KNOWN)
