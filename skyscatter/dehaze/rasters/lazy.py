"""The same windows through dask: chunks stay lazy, and come out as the windows of a file would."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.arrays import XarraySource, image_dims
from skyscatter.dehaze.rasters.base import Window, calibrate
from skyscatter.dehaze.rasters.windows import cropped, grown
from skyscatter.errors import DomainError, SkyscatterError

if TYPE_CHECKING:
    import xarray


def is_lazy(array: Any) -> bool:
    """Whether an array is made of dask's chunks."""
    return hasattr(getattr(array, "data", array), "dask")


def apply_dask(
    array: xarray.DataArray,
    function: Callable[..., Any],
    options: SourceOptions | None = None,
    *,
    names: Sequence[str] | None = None,
    overlap: int = 0,
    flags: bool = False,
) -> xarray.DataArray:
    """Apply a function to the chunks of a lazy labelled array; nothing is computed yet.

    Parameters
    ----------
    array : xarray.DataArray
        Of dask chunks; a chunk holds all bands in the end.
    function : callable
        As in `map_windows`: ``function(row0, col0, values)`` or, with `flags`, ``function(row0, col0, values, flags)``;
        returns an array (band, y, x) as large as what it was given.
    options : SourceOptions, optional
        How to read the array.
    names : sequence of str, optional
        Of the bands that the function returns; those of the image if not given.
    overlap : int
        Pixels around a chunk that the function needs to see.
    flags : bool
        Whether the function is given the flags too.

    Returns
    -------
    xarray.DataArray
        Lazy, float32, with the coordinates of `array` and its chunks along rows and columns.
    """
    try:
        from dask.array.core import map_blocks  # type: ignore[import-not-found,unused-ignore]
        from dask.array.overlap import overlap as share  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise SkyscatterError("dask is not installed: pip install 'dask[array]'") from error
    if not is_lazy(array):
        raise DomainError("array", type(array.data).__name__, "is not lazy; chunk it first: array.chunk({'y': 1024})")
    source = XarraySource(array, options)
    rows, cols, band = image_dims(array)
    cube = array.transpose(*([band] if band else []), rows, cols).data
    if band is None:
        cube = cube[np.newaxis]
    cube = cube[source.places].rechunk({0: -1})
    row_chunks, col_chunks = cube.chunks[1:]
    count = len(source.bands) if names is None else len(names)

    def work(block: NDArray[Any], block_info: Any = None) -> NDArray[np.float32]:
        place = block_info[0]["chunk-location"]
        inner = Window(*_span(row_chunks, place[1]), *_span(col_chunks, place[2]))
        outer = grown(inner, overlap, source.height, source.width)
        values, seen = calibrate(block, source.valid(block), source.bands)
        result = function(outer.row0, outer.col0, values, *((seen,) if flags else ()))
        return cropped(np.asarray(result, dtype=np.float32), outer, inner)

    # At the edges of the image nothing is made up: the function sees it as it is.
    depth = {0: 0, 1: overlap, 2: overlap}
    shared = share(cube, depth=depth, boundary="none") if overlap else cube
    answer = map_blocks(
        work,
        shared,
        dtype=np.float32,
        chunks=((count,), row_chunks, col_chunks),
        meta=np.empty((0, 0, 0), dtype=np.float32),
    )
    return source.wrap(answer, names)


def _span(chunks: Sequence[int], number: int) -> tuple[int, int]:
    """First row of a chunk, and the first one after it."""
    start = int(sum(chunks[:number]))
    return start, start + int(chunks[number])
