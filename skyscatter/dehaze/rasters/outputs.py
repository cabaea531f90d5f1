"""The sink that suits a path and a source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.rasters.encoding import check_layers, layer_encoding, result_encoding
from skyscatter.dehaze.rasters.sinks import RasterSink
from skyscatter.errors import DomainError

RASTER_SUFFIXES = (".tif", ".tiff")
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")


def open_result(
    path: str | Path,
    source: RasterSource,
    *,
    dtype: str | None = None,
    compression: str = "deflate",
    threads: int | None = None,
) -> RasterSink:
    """A file of the same place, bands and names as a source: a COG, or PNG and JPEG for pictures.

    Parameters
    ----------
    path : path-like
        By extension: .tif, .tiff; .png, .jpg, .jpeg.
    source : RasterSource
        Alpha is read from it while results are written.
    dtype : str, optional
        As in `result_encoding`; for a PNG uint8 or uint16.
    compression : {'deflate', 'zstd', 'lzw', 'none'}
        Of the COG.
    threads : int, optional
        Of the compression.

    Raises
    ------
    DomainError
        If the file cannot hold what the source gives.
    SkyscatterError
        If it cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix in RASTER_SUFFIXES:
        from skyscatter.dehaze.rasters.cog import CogSink

        encoding = result_encoding(source, dtype)
        # Without scale tags and with another nodata the rest of the profile is still that of the source.
        profile = replace(source.profile, dtype=encoding.dtype)
        return CogSink(
            path,
            source.height,
            source.width,
            profile,
            encoding,
            alpha=source.read_alpha,
            compression=compression,
            threads=threads,
        )
    if suffix in PICTURE_SUFFIXES:
        from skyscatter.dehaze.rasters.picturesink import picture_sink

        return picture_sink(path, source, dtype)
    raise DomainError(
        "output", str(path), f"the extension must be one of {', '.join(RASTER_SUFFIXES + PICTURE_SUFFIXES)}"
    )


def open_layer(
    path: str | Path,
    source: RasterSource,
    names: Sequence[str],
    *,
    dtype: str = "float32",
    units: str | None = None,
    compression: str = "deflate",
    threads: int | None = None,
) -> RasterSink:
    """A COG of maps of the same place as a source: haze, uncertainty, or (uint8) a mask of bits.

    Parameters
    ----------
    path : path-like
        .tif or .tiff.
    source : RasterSource
    names : sequence of str
        Of the bands.
    dtype : {'float32', 'uint8'}
        float32 has NaN where there are no data; uint8 holds bits.
    units : str, optional
        Of all bands.
    compression, threads
        As in `open_result`.
    """
    from skyscatter.dehaze.rasters.cog import CogSink, layer_profile

    if Path(path).suffix.lower() not in RASTER_SUFFIXES:
        raise DomainError("output", str(path), f"a map is written as {' or '.join(RASTER_SUFFIXES)}")
    if dtype not in ("float32", "uint8"):
        raise DomainError("dtype", dtype, "a map is float32, or uint8 for bits")
    bands = check_layers(names)
    return CogSink(
        path,
        source.height,
        source.width,
        layer_profile(source.profile, bands, units),
        layer_encoding(len(bands), dtype),
        compression=compression,
        flags=dtype == "uint8",
        threads=threads,
    )
