"""Pictures written strip by strip are, number by number and card by card, those that are written at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from astropy.io import fits

import skyscatter
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.image import strips
from skyscatter.image.fitsstrips import checksum_text
from skyscatter.image.strips import Whole, save

WAVELENGTHS = [400.0, 475.0, 550.0, 625.0, 710.0]


def picture(height: int = 53, width: int = 7, hole: bool = False, sky: bool = True) -> skyscatter.SpectralImage:
    rng = np.random.default_rng(1)
    cube = rng.uniform(0.0, 1.0, (height, width, 5))
    if hole:
        cube[height // 2, 3] = np.nan
    frame = skyscatter.SkyFrame(ra_deg=83.6, dec_deg=22.0, pixel_scale_deg=0.01, name="Nebula") if sky else None
    return skyscatter.SpectralImage(
        cube, WAVELENGTHS, 0.1 * cube, recipe={"solver": "path"}, layers={"direct": 0.5 * cube}, sky=frame
    )


@pytest.fixture(autouse=True)
def few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strips, "STRIP", 20 * 8 * 7 * 5)  # of 20 rows, and of 16 in EXR files


def same(one: skyscatter.SpectralImage, two: skyscatter.SpectralImage) -> None:
    np.testing.assert_array_equal(one.radiance, two.radiance)
    assert one.error is not None
    assert two.error is not None
    np.testing.assert_array_equal(one.error, two.error)
    assert list(one.layers) == list(two.layers)
    for name in one.layers:
        np.testing.assert_array_equal(one.layers[name], two.layers[name])
    assert (one.recipe, one.sky) == (two.recipe, two.sky)
    np.testing.assert_array_equal(one.wavelengths, two.wavelengths)


@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.parametrize("extension", [".fits", ".exr", ".nc", ".zarr"])
def test_the_same_as_at_once(extension: str, hole: bool, tmp_path: Path) -> None:
    image = picture(hole=hole)
    image.save(tmp_path / f"whole{extension}")
    save(Whole(image), tmp_path / f"strips{extension}")
    found, wanted = (skyscatter.SpectralImage.load(tmp_path / f"{name}{extension}") for name in ("strips", "whole"))
    same(found, wanted)
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"strips{extension}", f"whole{extension}"]


@pytest.mark.parametrize("dtype", [None, "float32"])
def test_fits_headers_and_sums(dtype: Any, tmp_path: Path) -> None:
    image = picture()
    image.save(tmp_path / "whole.fits", dtype=dtype)
    save(Whole(image), tmp_path / "strips.fits", dtype=dtype)
    with fits.open(tmp_path / "strips.fits", checksum=True) as ours, fits.open(tmp_path / "whole.fits") as wanted:
        assert [hdu.name for hdu in ours] == [hdu.name for hdu in wanted]
        for one, two in zip(ours, wanted, strict=True):
            assert one.verify_checksum() == 1  # astropy's own sums, which stand beside ours
            assert one.verify_datasum() == 1
            assert one.header["DATASUM"] == two.header["DATASUM"]
            cards = [{str(card) for card in hdu.header.cards if card.keyword not in ("CHECKSUM", "DATASUM", "DATE")}
                     for hdu in (one, two)]  # fmt: skip
            assert cards[0] == cards[1]


def test_checksums_sum_up() -> None:
    rng = np.random.default_rng(2)
    for value in [0, 1, 2**32 - 1, *(int(v) for v in rng.integers(0, 2**32, 200))]:
        text = checksum_text(value)
        assert text.isalnum()
        words = np.frombuffer((text[1:] + text[0]).encode(), ">u4").astype(np.int64) - 0x30303030
        assert int(words.sum()) % (2**32 - 1) == value % (2**32 - 1)


def test_exr_files_are_read_by_others(tmp_path: Path) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    save(Whole(picture()), tmp_path / "a.exr", scale=2.0)
    picture().save(tmp_path / "b.exr", scale=2.0)
    one, two = (oiio.ImageBuf(str(tmp_path / name)) for name in ("a.exr", "b.exr"))
    assert one.spec().channelnames == two.spec().channelnames
    np.testing.assert_array_equal(one.get_pixels(oiio.FLOAT), two.get_pixels(oiio.FLOAT))


@pytest.mark.parametrize("chunks", [None, {}])
@pytest.mark.parametrize("extension", [".nc", ".zarr"])
def test_labels_for_xarray_and_dask(extension: str, chunks: Any, tmp_path: Path) -> None:
    image = picture()
    save(Whole(image), tmp_path / f"cube{extension}", dtype="float32")
    opened = xarray.open_zarr if extension == ".zarr" else xarray.open_dataset
    with opened(tmp_path / f"cube{extension}", chunks=chunks) as found:  # dask's arrays with {}
        assert found["radiance"].dims == ("y", "x", "wavelength")
        assert set(found.coords) == {"wavelength", "ra", "dec", "solid_angle"}
        for name, wanted in image.dataset.variables.items():
            variable = found.variables[str(name)]
            assert {k: v for k, v in variable.attrs.items()} == dict(wanted.attrs), name
            kind = np.float32 if name in image.dataset.data_vars else float
            np.testing.assert_array_equal(variable.values, wanted.values.astype(kind))
        mean = found["radiance"].mean("wavelength")
        assert (mean.chunks is not None) == (chunks is not None)
        np.testing.assert_allclose(mean.values, image.radiance.mean(axis=-1), rtol=1e-6)  # single precision


def test_moments_of_skies(tmp_path: Path) -> None:
    scene = skyscatter.load_model("earth-simple").scene_at(48.0, 11.0, "2026-06-21T12:00Z")
    image = skyscatter.render(scene, skyscatter.Panorama(width=8, height=4), [550], solver="single")
    image.save(tmp_path / "sky.zarr")
    image.save(tmp_path / "sky.zarr")  # in place of the first
    with xarray.open_zarr(tmp_path / "sky.zarr") as found, image.dataset as wanted:
        assert found["time"].values == wanted["time"].values
        np.testing.assert_array_equal(found["elevation"].values, wanted["elevation"].values)
    np.testing.assert_array_equal(skyscatter.SpectralImage.load(tmp_path / "sky.zarr").radiance, image.radiance)


def test_what_cannot_be_written_so_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Whole(picture())
    with pytest.raises(DomainError, match="larger than memory"):
        save(source, tmp_path / "a.png")
    with pytest.raises(DomainError, match="unit"):
        save(source, tmp_path / "a.fits", unit="Jy")
    (tmp_path / "mine.zarr").mkdir()
    (tmp_path / "mine.zarr" / "thesis.txt").write_text("years of work")
    with pytest.raises(DomainError, match="no picture of skyscatter's"):
        save(source, tmp_path / "mine.zarr")
    assert (tmp_path / "mine.zarr" / "thesis.txt").exists()
    monkeypatch.setattr(strips.shutil, "disk_usage", lambda folder: type("Disk", (), {"free": 1000}))
    for extension in (".fits", ".exr", ".nc", ".zarr"):
        with pytest.raises(SkyscatterError, match="make room"):
            save(source, tmp_path / f"a{extension}")
    assert [p.name for p in tmp_path.iterdir()] == ["mine.zarr"]
