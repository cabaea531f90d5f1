"""An image without sensor or geometry: a picture whose veil is fitted once and taken off window by window."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.flagcount import FlagCount
from skyscatter.dehaze.flags import Flag, mark
from skyscatter.dehaze.options import DehazeOptions
from skyscatter.dehaze.picture.lattice import Lattice, new_lattice
from skyscatter.dehaze.picture.options import CAMERA, PictureOptions
from skyscatter.dehaze.picture.veil import Veil, fit_veil
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.rasters.windows import for_each_window, map_windows
from skyscatter.errors import DomainError

Values = NDArray[np.float32]
Progress = Callable[[float], object]

#: Wavelength that a single band stands for [nm].
GREY = 550.0
#: Exponent of the transfer curve called gamma.
GAMMA = 2.2
#: Share of the work that is done when the veil is known.
AFTER_FIT = 0.4
Flags = NDArray[np.uint8]


def shown_bands(source: RasterSource) -> list[int]:
    """Places of red, green and blue, or of the only band.

    Raises
    ------
    DomainError
        If the image has several bands and does not say which are red, green and blue.
    """
    if len(source.bands) == 1:
        return [0]
    found = source.rgb()
    if found is None:
        have = ", ".join(band.name for band in source.bands)
        rule = (
            f"{source.name} does not say which of {have} are red, green and blue; name the bands, red=1,green=2,blue=3"
        )
        raise DomainError("bands", len(source.bands), rule)
    return list(found)


def picture_options(source: RasterSource, options: DehazeOptions, places: list[int]) -> PictureOptions:
    """How the picture is read: its curve, its bands, its steps."""
    wavelengths = CAMERA if len(places) == 3 else (GREY,)
    levels = {"uint8": 256, "uint16": 65536}.get(source.profile.dtype, 65536)
    curve: Any = GAMMA if options.transfer == "gamma" else options.transfer
    alpha = None if options.alpha == "auto" else float(options.alpha)
    return PictureOptions(transfer=curve, wavelengths=wavelengths, alpha=alpha, levels=levels)


def fit(
    source: RasterSource, reading: PictureOptions, places: list[int], options: DehazeOptions, say: Progress
) -> Veil:
    """The veil of the whole image, from one look at all of it."""
    lattice = new_lattice(source.height, source.width, len(places), reading)

    def gather(row0: int, col0: int, values: Values, flags: Flags) -> None:
        lattice.gather(blank(values, flags), row0, col0, reading)

    found = map_windows(
        source, gather, size=options.window, multiple=lattice.cell, bands=places, flags=True, threads=options.threads,
        progress=say,
    )  # fmt: skip
    for _ in found:
        pass
    check_seen(source, lattice)
    return fit_veil(lattice, reading)


def blank(values: Values, flags: Flags) -> Values:
    """Values with NaN in all bands where nothing was measured."""
    return np.where((flags & np.uint8(Flag.NODATA)) != 0, np.float32(np.nan), values)


def check_seen(source: RasterSource, lattice: Lattice) -> None:
    """Refuse an image in which there is nothing to see."""
    if not lattice.number.any():
        raise DomainError("image", source.name, "has no usable pixel: all are without data, saturated or cloud")


def dehaze_plain(
    source: RasterSource, sinks: Mapping[str, Any], options: DehazeOptions, progress: Progress, executor: Any = None
) -> dict[str, Any]:
    """Take the veil off a picture into sinks (result, sigma, haze_map, mask: those there are); returns the summary."""
    places = shown_bands(source)
    reading = picture_options(source, options, places)
    veil = fit(source, reading, places, options, lambda share: progress(AFTER_FIT * share))
    wanted, count = frozenset(sinks), FlagCount()

    def work(row0: int, col0: int, values: Values, flags: Flags) -> dict[str, NDArray[Any]]:
        return cleaned(veil, places, options.strength, row0, col0, values, flags, wanted)

    for_each_window(
        source, sinks, work, lambda found: count.add(found["mask"]), size=options.window, flags=True,
        threads=options.threads, executor=executor,
        progress=lambda share: progress(AFTER_FIT + (1 - AFTER_FIT) * share),
    )  # fmt: skip
    return {**summary(source, veil, places, options), "flags": count.shares()}


def summary(source: RasterSource, veil: Veil, places: list[int], options: DehazeOptions) -> dict[str, Any]:
    """What a report says."""
    notes = []
    if len(places) < len(source.bands):
        kept = [band.name for k, band in enumerate(source.bands) if k not in places]
        notes.append(f"{', '.join(kept)} passed on as they are: a picture is red, green and blue")
    if veil.pale:
        notes.append(
            "nothing dark is left in some band: the ground is pale or of one colour, or a veil, or its colour, is left;"
            " all is flagged as uncertain and sigma tells how much"
        )
    return {**veil.diagnostics(), "kind": "relative", "strength": options.strength, "remarks": notes}


def cleaned(
    veil: Veil, places: list[int], strength: float, row0: int, col0: int, values: Values, flags: Flags,
    wanted: frozenset[str],
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Arrays (layer, y, x) of a window: result and mask, and sigma and haze_map where wanted."""
    shown = blank(values[places], flags)
    clean, found = veil.apply(shown, row0, col0, strength)
    found |= flags
    empty = (flags & np.uint8(Flag.NODATA)) != 0
    result = values.copy()
    # Where nothing was measured the file's own numbers stay.
    result[places] = np.where(empty, values[places], clean)
    out: dict[str, NDArray[Any]] = {"result": result}
    if "sigma" in wanted:
        sigma = np.full_like(values, np.nan)
        sigma[places] = strength * veil.uncertainty(shown, row0, col0)
        out["sigma"] = sigma
    if "haze_map" in wanted:
        out["haze_map"] = veil.depth_at(row0, col0, empty.shape)[None]
    mark(found, empty, Flag.NODATA)
    out["mask"] = found[None]
    return out
