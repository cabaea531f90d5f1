"""The source that suits a path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.errors import DomainError, MissingDataError

_PICTURES = (".png", ".jpg", ".jpeg")
_PRODUCTS = (".zip", ".tar", ".safe")


def open_raster(path: str | Path, options: SourceOptions | None = None) -> RasterSource:
    """Open an image: a raster, a picture, or a Sentinel-2 or Landsat product.

    Parameters
    ----------
    path : path-like
        GeoTIFF or any other raster of one file; PNG, JPEG; SAFE folder or its .zip; Landsat folder or its .tar; or the
        metadata file of such a product.
    options : SourceOptions, optional

    Returns
    -------
    RasterSource
        To be closed after use: a ``with`` block does.  ``read(row0, row1, col0, col1)`` gives a window.

    Raises
    ------
    MissingDataError, DomainError
        One line with the remedy.
    SkyscatterError
        If rasterio is not installed.

    Examples
    --------
    A picture file, as light from 0 to 1 (its numbers over 255):

    >>> import pathlib
    >>> import tempfile
    >>> import numpy as np
    >>> from PIL import Image
    >>> from skyscatter.dehaze import open_raster
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "grey.png"
    ...     Image.fromarray(np.full((20, 30, 3), 51, dtype=np.uint8)).save(path)
    ...     with open_raster(path) as source:
    ...         values = source.read(0, 20, 0, 30)  # rows 0 to 19, columns 0 to 29
    >>> source.quantity, values.shape, values.dtype.name
    ('display', (3, 20, 30), 'float32')
    >>> round(float(values[0, 0, 0]), 2)
    0.2
    """
    options = options or SourceOptions()
    place = Path(path)
    if not place.exists():
        raise MissingDataError(path, "there is no such file or folder; check the path")
    if place.is_dir() or place.suffix.lower() in _PRODUCTS or place.name.startswith("MTD_MSI") or "_MTL." in place.name:
        return _open_product(str(path), options)
    if options.resolution is not None:
        raise DomainError("resolution", options.resolution, "is for Sentinel-2 products; leave it out")
    if place.suffix.lower() in _PICTURES:
        from skyscatter.dehaze.rasters.pictures import PictureSource

        return PictureSource(str(path), options)
    from skyscatter.dehaze.rasters.geotiff import GeoTiffSource

    return GeoTiffSource(str(path), options)


def as_source(image: Any, options: SourceOptions | None = None) -> RasterSource:
    """The source of whatever holds an image.

    Parameters
    ----------
    image : path-like, array_like, xarray.DataArray or RasterSource
        Arrays are (band, y, x), or (y, x) for one band; labelled ones have rows y and columns x in any order.
    options : SourceOptions, optional
        Not for a RasterSource, which has been told.
    """
    from skyscatter.dehaze.rasters.arrays import ArraySource, XarraySource

    if isinstance(image, RasterSource):
        if options is not None and options != SourceOptions():
            raise DomainError("image", image.name, "is open already; give its options where it is opened")
        return image
    if isinstance(image, (str, Path)):
        return open_raster(image, options)
    if hasattr(image, "data_vars"):
        rule = "give one of its arrays, dataset['name'], or all of them as bands, dataset.to_dataarray('band')"
        raise DomainError("image", type(image).__name__, rule)
    if hasattr(image, "dims") and hasattr(image, "coords"):
        return XarraySource(image, options)
    return ArraySource(image, options)


def _open_product(path: str, options: SourceOptions) -> RasterSource:
    from skyscatter.dehaze.rasters.containers import Container
    from skyscatter.dehaze.rasters.landsat import LandsatSource, is_landsat
    from skyscatter.dehaze.rasters.sentinel2 import Sentinel2Source, is_sentinel2

    box = Container(path)
    if is_sentinel2(box):
        return Sentinel2Source(path, options)
    if is_landsat(box):
        return LandsatSource(path, options)
    raise MissingDataError(path, "holds neither a Sentinel-2 (MTD_MSIL1C.xml) nor a Landsat (_MTL.txt) product")
