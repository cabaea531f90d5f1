"""netCDF-4 by h5netcdf, and never anything else in its place."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import xarray

from skyscatter.cli.parse import check_output
from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage
from skyscatter.image.netcdf import from_dataset


def sample(dtype: type) -> SpectralImage:
    radiance = np.random.default_rng(3).random((4, 7, 3)).astype(dtype)
    radiance[3, 6] = np.nan
    recipe = {"model": "earth", "name": "Größe", "sun": [1.5, 2]}
    layers = {"order-1": radiance / 2, "Ground": radiance / 4}
    return SpectralImage(radiance, [400.1, 500.0, 700.7], 0.1 * radiance, recipe=recipe, layers=layers)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_round_trip_is_exact(tmp_path: Path, dtype: type) -> None:
    made = sample(dtype)
    made.save(tmp_path / "sky.nc")
    assert (tmp_path / "sky.nc").read_bytes().startswith(b"\x89HDF")
    back = SpectralImage.load(tmp_path / "sky.nc")
    assert back.radiance.dtype == dtype
    np.testing.assert_array_equal(back.radiance, made.radiance)
    np.testing.assert_array_equal(back.standard_error, made.standard_error)
    np.testing.assert_array_equal(back.wavelengths, made.wavelengths)
    assert back.recipe == made.recipe
    assert sorted(back.layers) == sorted(made.layers)
    for name, cube in made.layers.items():
        np.testing.assert_array_equal(back.layers[name], cube)
    assert [p.name for p in tmp_path.iterdir()] == ["sky.nc"]


def test_attributes_survive(tmp_path: Path) -> None:
    sample(np.float64).save(tmp_path / "sky.nc")
    with xarray.open_dataset(tmp_path / "sky.nc", engine="h5netcdf") as data:
        assert data.attrs["Conventions"] == "CF-1.11"
        assert data["radiance"].attrs["units"] == "W m-2 sr-1 nm-1"
        assert data["radiance"].attrs["ancillary_variables"] == "radiance_standard_error"
        # What the conventions ask for: who wrote the file, and no value for gaps in coordinates that have none.
        assert "written by skyscatter" in data.attrs["history"]
        assert data["wavelength"].encoding.get("_FillValue") is None


def test_netcdf4_without_its_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sky.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None)
    with pytest.raises(DomainError, match="install h5netcdf"):
        SpectralImage.load(tmp_path / "sky.nc")


def test_without_its_library_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None)
    with pytest.raises(DomainError, match=r"pip install h5netcdf"):
        sample(np.float64).save(tmp_path / "sky.nc")
    with pytest.raises(DomainError, match="needs h5netcdf"):  # before any work
        check_output(tmp_path / "sky.nc")
    assert list(tmp_path.iterdir()) == []


def test_older_files_are_read(tmp_path: Path) -> None:
    made = sample(np.float32)
    made.dataset.to_netcdf(tmp_path / "sky.nc", engine="scipy", format="NETCDF3_64BIT")
    back = SpectralImage.load(tmp_path / "sky.nc")
    np.testing.assert_array_equal(back.radiance, made.radiance)
    assert back.recipe == made.recipe


def test_single_precision_on_request(tmp_path: Path) -> None:
    made = sample(np.float64)
    made.save(tmp_path / "sky.nc", dtype="float32")
    back = SpectralImage.load(tmp_path / "sky.nc")
    np.testing.assert_array_equal(back.radiance, made.radiance.astype(np.float32))
    assert back.radiance.dtype == back.layers["Ground"].dtype == np.float32
    with pytest.raises(DomainError, match="float32 or float64"):
        made.save(tmp_path / "sky.nc", dtype="int8")


def test_datasets_of_another_form() -> None:
    with pytest.raises(DomainError, match="no variable named radiance"):
        from_dataset(xarray.Dataset({"temperature": ("x", [1.0])}))
    flat = xarray.Dataset({"radiance": (("y", "x"), np.ones((2, 2)))}, coords={"wavelength": [500.0]})
    with pytest.raises(DomainError, match="must have the dimensions"):
        from_dataset(flat)
    spoiled = sample(np.float64).dataset.assign_attrs(recipe="{not json")
    with pytest.raises(DomainError, match="must be JSON"):
        from_dataset(spoiled)


def test_dimensions_may_come_in_another_order() -> None:
    made = sample(np.float64)
    turned = made.dataset.transpose("wavelength", "y", "x")
    np.testing.assert_array_equal(from_dataset(turned).radiance, made.radiance)
