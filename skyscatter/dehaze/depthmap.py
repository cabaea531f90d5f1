"""Aerosol optical depths from a raster, at the cells of an image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.lattice import Lattice
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.table import GREATEST_AOD
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError

Array = NDArray[np.float64]


def read_depths(path: str | Path, source: RasterSource, lattice: Lattice) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A map of optical depths, resampled to the large cells of an image.

    Parameters
    ----------
    path : path-like
        GeoTIFF: band 1 the optical depth at 550 nm, band 2, if there is one, its standard deviation; at most 2.
    source : RasterSource
        The image, with a georeference; without one the map must have its rows and columns.
    lattice : Lattice

    Returns
    -------
    aod, sigma : ndarray, shape (large row, large column)
        Cells that the map leaves empty have those of the nearest, and the map's own scatter in the deviation.
    missing : ndarray of bool, shape (large row, large column)
        Which these are.

    Raises
    ------
    MissingDataError, SkyscatterError, DomainError
        If the file is missing, no raster, of other numbers, or of another place.
    """
    from scipy.ndimage import distance_transform_edt

    if not Path(path).is_file():
        raise MissingDataError(path, "there is no such map of the optical depth; check the path")
    layers = _resampled(str(path), source, lattice)
    known = np.asarray(np.isfinite(layers).all(axis=0))
    if not known.any():
        raise DomainError("aod", str(path), "has no data where the image is; give a map of the same place")
    low, high = float(layers[:, known].min()), float(layers[0, known].max())
    if low < 0 or high > GREATEST_AOD:
        rule = (
            f"holds {low if low < 0 else high:.4g}: a map of optical depths at 550 nm goes from 0 to {GREATEST_AOD:g}"
        )
        raise DomainError("aod", str(path), f"{rule}, its scale in the file's tags")
    aod = layers[0]
    sigma = layers[1] if len(layers) > 1 else np.where(known, 0.0, np.nan)
    nearest = tuple(distance_transform_edt(~known, return_distances=False, return_indices=True))
    sigma = np.hypot(sigma[nearest], np.where(known, 0.0, float(aod[known].std())))
    return aod[nearest], sigma, np.logical_not(known)


def _resampled(path: str, source: RasterSource, lattice: Lattice) -> Array:
    """The map's bands (band, large row, large column); NaN where they hold nothing."""
    from skyscatter.dehaze.rasters.handles import environment, first_line, quiet, require_rasterio

    rasterio = require_rasterio()
    from rasterio.enums import Resampling
    from rasterio.warp import reproject

    out = np.full((2, *lattice.large_shape), np.nan)
    try:
        with environment(), quiet(), rasterio.open(path) as file:
            count = min(file.count, 2)
            if np.dtype(file.dtypes[0]).kind == "c":
                raise DomainError("aod", path, "holds complex numbers; give optical depths")
            numbers = file.read(list(range(1, count + 1)), masked=True).astype(float).filled(np.nan)
            scale = np.array([file.scales[:count], file.offsets[:count]])[..., None, None]
            numbers = numbers * scale[0] + scale[1]
            here, there = _places(source, file, path)
            pixel, n = here["transform"], lattice.large
            cells = rasterio.Affine(n * pixel.a, n * pixel.b, pixel.c, n * pixel.d, n * pixel.e, pixel.f)
            # Cells that hold several of the map's pixels have their mean; smaller ones lie between its pixels.
            finer = here["crs"] == there["crs"] and abs(file.transform.a) < abs(cells.a)
            for layer, part in zip(out, numbers, strict=False):
                reproject(
                    part, layer, src_transform=there["transform"], src_crs=there["crs"], src_nodata=np.nan,
                    dst_transform=cells, dst_crs=here["crs"], dst_nodata=np.nan, init_dest_nodata=True,
                    resampling=Resampling.average if finer else Resampling.bilinear,
                )  # fmt: skip
    except rasterio.errors.RasterioError as error:
        raise SkyscatterError(f"{path}: cannot be read as a map of the optical depth: {first_line(error)}") from error
    return out[:count]


def _places(source: RasterSource, file: Any, path: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Where image and map lie, by transform and reference system."""
    profile = source.profile
    if profile.crs is not None and profile.transform is not None and file.crs is not None:
        return {"transform": profile.transform, "crs": profile.crs}, {"transform": file.transform, "crs": file.crs}
    if (file.height, file.width) != (source.height, source.width):
        rule = f"image and map have no georeference in common: give a map of {source.height} x {source.width} pixels"
        raise DomainError("aod", path, f"{rule}, or both with a transform and a reference system")
    from rasterio import Affine
    from rasterio.crs import CRS

    pixels = {"transform": Affine(1.0, 0.0, 5e5, 0.0, -1.0, 5e6), "crs": CRS.from_epsg(32631)}  # any plane will do
    return pixels, pixels
