"""Before and after, side by side, with the same stretch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.rasters.handles import environment
from skyscatter.dehaze.rasters.opening import open_raster
from skyscatter.dehaze.rasters.outputs import PICTURE_SUFFIXES
from skyscatter.dehaze.rasters.picturesink import PictureSink
from skyscatter.errors import DomainError
from skyscatter.image.tone import encode

#: Pixels on the longer side of each of the two pictures.
SIZE = 1024
#: Between the two [pixel].
_GAP = 8
#: Share of the values of both pictures that lie below white: what is brighter are clouds.
_WHITE_SHARE = 0.99
#: White where the image is darker than that [reflectance]: a dark sea shall not be shown as snow.
_LEAST_WHITE = 0.05


def write_quicklook(path: str | Path, before: RasterSource, after: str | Path, size: int = SIZE) -> None:
    """Write a PNG with a source on the left and its result on the right.

    Display values are shown as they are.  Reflectance is shown with one white for both pictures and the transfer curve
    of sRGB (IEC 61966-2-1).

    Parameters
    ----------
    path : path-like
        .png.
    before : RasterSource
    after : path-like
        The result, as `open_result` wrote it: the same bands in the same order.
    size : int
        Pixels on the longer side of each.

    Raises
    ------
    DomainError
        If the source does not say which bands are red, green and blue.
    """
    bands = shown_bands(before)
    with environment(), open_result_source(before, after) as result:
        # Pictures in files hold red, green and blue in that order, whatever the order in the source.
        picture = Path(after).suffix.lower() in PICTURE_SUFFIXES
        same = tuple(range(len(set(bands)))) if picture and len(set(bands)) == 3 else bands
        left = before.thumbnail(size, bands)[0].astype(np.float64)
        right = result.thumbnail(size, same)[0].astype(np.float64)
    if before.quantity != "display":
        left, right = _stretched(left, right)
    both = _side_by_side(left, right)
    with PictureSink(path, *both.shape[1:]) as sink:
        sink.write(0, 0, both.astype(np.float32))


def shown_bands(source: RasterSource) -> tuple[int, ...]:
    """Places of red, green and blue, or of the only band three times."""
    rgb = source.rgb()
    if rgb is not None:
        return rgb
    if len(source.bands) == 1:
        return 0, 0, 0
    names = ", ".join(band.name for band in source.bands)
    raise DomainError("bands", names, "a quicklook needs red, green and blue; say which they are: red=3,green=2,blue=1")


def open_result_source(before: RasterSource, after: str | Path) -> RasterSource:
    """Open a result of `open_result`."""
    return open_raster(after, SourceOptions(quantity="display" if before.quantity == "display" else "reflectance"))


def _stretched(left: NDArray[np.float64], right: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    both = np.concatenate([left.ravel(), right.ravel()])
    both = both[np.isfinite(both)]
    white = max(float(np.quantile(both, _WHITE_SHARE)) if both.size else 1.0, _LEAST_WHITE)
    shown = []
    for picture in (left, right):
        shown.append(encode(np.clip(picture / white, 0.0, 1.0)))
    return tuple(shown)


def _side_by_side(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    if left.shape != right.shape:
        raise DomainError("quicklook", right.shape, f"the result must be as large as the source, {left.shape}")
    gap = np.ones((3, left.shape[1], _GAP))
    return np.nan_to_num(np.clip(np.concatenate([left, gap, right], axis=2), 0.0, 1.0))
