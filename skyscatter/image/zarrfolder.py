"""Folders of zarr: the labelled form of a picture in chunks, for xarray and dask."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skyscatter.errors import DomainError
from skyscatter.image import arraystrips
from skyscatter.image.strips import Whole

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage


def write(image: SpectralImage, path: Path, dtype: str | None = None) -> None:
    """Write a picture as a folder; with `dtype` "float32" its pixels at half the size."""
    arraystrips.write(Whole(image), path, dtype)


def read(path: Path) -> SpectralImage:
    """Read a picture that `write` wrote."""
    import xarray

    from skyscatter.image.netcdf import from_dataset

    if not arraystrips.is_picture(path):
        raise DomainError("image file", str(path), "is no picture of skyscatter's in zarr")
    with xarray.open_zarr(path, chunks=None) as dataset:
        return from_dataset(dataset.load())
