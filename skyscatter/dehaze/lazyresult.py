"""Labelled arrays of dask's chunks: the haze is found once over all of them, and its correction stays lazy."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import DehazeOptions, SourceOptions, entrance
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.result import DehazeResult

if TYPE_CHECKING:
    import xarray

Values = NDArray[np.float32]
Progress = Callable[[float], object]
#: What corrects a window: (row0, col0, values, flags, wanted) to arrays by name.
Correct = Callable[[int, int, Values, NDArray[np.uint8], frozenset[str]], dict[str, NDArray[Any]]]


def dehaze_lazy(
    array: xarray.DataArray, reading: SourceOptions, options: DehazeOptions, progress: Progress | None = None
) -> DehazeResult:
    """As `skyscatter.dehaze.engine.dehaze`, with arrays that are computed when they are asked for.

    To find the haze all chunks are read once, now.  Each array of the result is a graph of its own over the chunks of
    the image; pixels are the same as those of an array in memory.  Flags are not counted, for none is set yet.

    Parameters
    ----------
    array : xarray.DataArray
        Of dask chunks.
    reading, options
    progress : callable, optional
        Of the search for the haze.
    """
    from skyscatter.dehaze.rasters.arrays import XarraySource
    from skyscatter.dehaze.rasters.lazy import apply_dask

    source = XarraySource(array, reading)
    correct, report = found(source, options, progress or (lambda share: None))
    bands = [band.name for band in source.bands]

    def layer(name: str, names: list[str]) -> xarray.DataArray:
        wanted = frozenset((name,))

        def work(row0: int, col0: int, values: Values, flags: NDArray[np.uint8]) -> NDArray[Any]:
            return correct(row0, col0, values, flags, wanted)[name]

        # Without a name of the image's, dask would give it one of its own.
        return apply_dask(array, work, reading, names=names, flags=True).rename(array.name)

    mask = layer("mask", ["flags"])
    # Bits are exact in the float32 of the windows.
    return DehazeResult(
        layer("result", bands), layer("sigma", bands), layer("haze_map", ["haze"]), mask.astype(np.uint8), report
    )


def found(source: RasterSource, options: DehazeOptions, progress: Progress) -> tuple[Correct, dict[str, Any]]:
    """What corrects the windows of an image, from one look at all of it, and the report."""
    if entrance(source, options) == "physical":
        from skyscatter.dehaze.physical import prepare

        return prepare(source, options, progress)
    from skyscatter.dehaze import plain

    places = plain.shown_bands(source)
    veil = plain.fit(source, plain.picture_options(source, options, places), places, options, progress)

    def clean(
        row0: int, col0: int, values: Values, flags: NDArray[np.uint8], wanted: frozenset[str]
    ) -> dict[str, NDArray[Any]]:
        return plain.cleaned(veil, places, options.strength, row0, col0, values, flags, wanted)

    return clean, plain.summary(source, veil, places, options)
