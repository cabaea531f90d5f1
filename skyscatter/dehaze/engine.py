"""The two entrances to dehazing, by what an image says of itself, and the function for arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from typing import Any

import numpy as np

from skyscatter.dehaze.options import DehazeOptions, SourceOptions, entrance, split_options
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.result import DehazeResult, Summary
from skyscatter.errors import DomainError
from skyscatter.tasks.door import opened

Progress = Callable[[float], object]

#: An array of three or four columns and more planes than this has its bands last: no sensor here has so many.
MOST_PLANES = 16


def dehaze_raster(
    source: RasterSource,
    sinks: Mapping[str, Any],
    options: DehazeOptions,
    progress: Progress | None = None,
    executor: Any = None,
) -> Summary:
    """Take the haze off an image window by window.

    Parameters
    ----------
    source : RasterSource
    sinks : mapping of str to RasterSink
        Where to write: ``result``, ``sigma``, ``haze_map``, ``mask``; what is left out is not computed.
    options : DehazeOptions
    progress : callable, optional
        Called with the finished share, 0 to 1.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What corrects the windows: so many processes of this machine, an executor, or a client of dask; threads of this
        process when not given.

    Returns
    -------
    Summary

    Raises
    ------
    DomainError
        Naming the option or the property of the image that is missing or wrong.

    Examples
    --------
    A report on a picture file, without an image: no sinks, nothing to compute for them.

    >>> import pathlib
    >>> import tempfile
    >>> import numpy as np
    >>> from PIL import Image
    >>> from skyscatter.dehaze import DehazeOptions, dehaze_raster, open_raster
    >>> ground = 0.6 * np.random.default_rng(0).random((64, 64, 3)) ** 2
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "clear.png"
    ...     Image.fromarray((255 * ground).astype(np.uint8)).save(path)
    ...     with open_raster(path) as source:
    ...         report = dehaze_raster(source, {}, DehazeOptions()).to_json()
    >>> report["kind"], report["depth_mean"] < 0.1
    ('relative', True)
    """
    say = progress or (lambda share: None)
    # Tables, the first look and the correction by the same workers, which begin once.
    with nullcontext() if executor is None else opened(executor) as engine:
        if entrance(source, options) == "plain":
            from skyscatter.dehaze.plain import dehaze_plain

            summary = dehaze_plain(source, sinks, options, say, engine)
        else:
            from skyscatter.dehaze.physical import dehaze_physical

            summary = dehaze_physical(source, sinks, options, say, engine)
    from skyscatter.dehaze.provenance import tags

    for sink in sinks.values():
        sink.tag(tags(summary))
    return Summary(summary)


def dehaze(image: Any, *, progress: Progress | None = None, executor: Any = None, **options: Any) -> DehazeResult:
    """Take the haze off an image.

    An image whose sensor and geometry are known becomes surface reflectance with an uncertainty; a plain picture
    becomes a picture without its veil.

    Parameters
    ----------
    image : path-like, array_like, xarray.DataArray or RasterSource
        Arrays are (band, y, x): reflectance above the atmosphere, radiance [W m-2 sr-1 um-1] or display values.  Of
        a labelled array of dask's chunks the haze is found at once, and the result stays lazy.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What works on an image window by window, as in `dehaze_raster`; not for arrays of dask's chunks, which dask
        itself works on.
    **options
        Of `skyscatter.dehaze.options.SourceOptions` (sensor, bands, quantity, scale, offset, angles) and
        `skyscatter.dehaze.options.DehazeOptions` (aod, aerosol, pressure_hpa, ozone_du, strength, ...).

    Returns
    -------
    DehazeResult

    Raises
    ------
    DomainError
        Naming the option or the property of the image that is missing or wrong.

    Examples
    --------
    A plain picture, three colours by rows and columns, with a veil that thickens to the right: without it, contrast
    in the last columns is more than twice as high.

    >>> import numpy as np
    >>> import skyscatter
    >>> ground = 0.6 * np.random.default_rng(0).random((3, 64, 64)) ** 2
    >>> picture = 0.7 + (ground - 0.7) * np.exp(-np.linspace(0, 1.2, 64))
    >>> result = skyscatter.dehaze(picture, quantity="display", bands=("red", "green", "blue"))
    >>> bool(result.reflectance[..., -8:].std() > 2 * picture[..., -8:].std())
    True
    """
    from skyscatter.dehaze.rasters.arrays import XarraySource
    from skyscatter.dehaze.rasters.lazy import is_lazy

    reading, doing = split_options(options)
    if hasattr(image, "dims") and is_lazy(image):
        from skyscatter.dehaze.lazyresult import dehaze_lazy

        if executor is not None:
            raise DomainError("executor", executor, "dask works on its own arrays; leave it out")
        return dehaze_lazy(image, reading, doing, progress)
    source = _source(image, reading)
    with source:
        sinks = array_sinks(source)
        summary = dehaze_raster(source, sinks, doing, progress, executor)
    found = {name: sink.array for name, sink in sinks.items()}
    if isinstance(source, XarraySource):
        single = {"haze_map": ["haze"], "mask": ["flags"]}
        found = {name: source.wrap(values, single.get(name)) for name, values in found.items()}
    return DehazeResult(found["result"], found["sigma"], found["haze_map"], found["mask"], summary.to_json())


def _source(image: Any, reading: SourceOptions) -> RasterSource:
    """The source of an image; plain arrays are told their bands' names, and keep their masks."""
    from skyscatter.dehaze.rasters.arrays import ArraySource
    from skyscatter.dehaze.rasters.opening import as_source

    if isinstance(image, (list, tuple)):
        image = np.asarray(image)
    if not isinstance(image, np.ndarray):
        return as_source(image, reading)
    names = checked_names(image, reading)
    opaque = None
    if isinstance(image, np.ma.MaskedArray):
        hidden = np.ma.getmaskarray(image)
        opaque = ~(hidden.any(axis=0) if image.ndim == 3 else hidden)
        image = np.ma.getdata(image)
    if names is not None:
        reading = reading.model_copy(update={"bands": None})
    return ArraySource(image, reading, names=names, alpha=opaque)


def checked_names(image: Any, reading: SourceOptions) -> tuple[str, ...] | None:
    """Names of all bands of a plain array; None where `bands` chooses among them, or where none are needed."""
    names, count = reading.bands, 1 if image.ndim == 2 else len(image)
    if names is None:
        if image.ndim == 3 and image.shape[-1] in (3, 4) and image.shape[0] > MOST_PLANES:
            rule = "looks like (y, x, band), and axes are (band, y, x): give np.moveaxis(image, -1, 0)"
            raise DomainError("image", f"shape {image.shape}", rule)
        if reading.sensor is not None and image.ndim == 3:
            rule = f"an array does not say which bands of {reading.sensor} it holds; name them, in the array's order"
            raise DomainError("bands", None, rule)
        return None
    if count == 0 or any("=" in word or word.isdecimal() for word in names):
        return None
    if len(names) != count:
        turned = image.ndim == 3 and len(names) == image.shape[-1]
        hint = "; np.moveaxis(image, -1, 0) turns (y, x, band) into it" if turned else ""
        rule = f"the array is (band, y, x) of {count} band{'s' * (count != 1)}; give one name for each{hint}"
        raise DomainError("bands", ", ".join(names), rule)
    return names


def array_sinks(source: RasterSource) -> dict[str, Any]:
    """Arrays for everything that can be asked for."""
    from skyscatter.dehaze.rasters.sinks import ArraySink

    count = len(source.bands)
    return {
        "result": ArraySink(source.height, source.width, count),
        "sigma": ArraySink(source.height, source.width, count),
        "haze_map": ArraySink(source.height, source.width, 1),
        "mask": ArraySink(source.height, source.width, 1, np.dtype(np.uint8).name),
    }
