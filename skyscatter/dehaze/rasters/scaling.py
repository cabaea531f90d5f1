"""What the numbers of a plain raster mean: scale and offset from the file or the user, never guessed in silence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import QUANTITIES, Quantity, RasterBand
from skyscatter.errors import DomainError

#: Types of number that a source may hold.
DTYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")
#: Half of a reflectance image is never brighter than this; half of an image of digital numbers nearly always is.
_BRIGHTEST_MEDIAN = 2.0


class Scaling(NamedTuple):
    """What came out: the quantity, bands with scale and offset, whether the file had them, and remarks."""

    quantity: Quantity
    bands: tuple[RasterBand, ...]
    scaled: bool
    notes: tuple[str, ...]


def check_dtype(name: str, dtype: Any) -> str:
    """Name of the type of number, if it is one of real numbers of up to 32 bits or of floats.

    Raises
    ------
    DomainError
        For complex numbers, integers of 64 bits and all else.
    """
    text = str(np.dtype(dtype)) if not isinstance(dtype, str) else dtype
    if text.startswith("complex"):
        raise DomainError("dtype", text, f"{name} holds complex numbers (radar?); give reflectance or a picture")
    if text not in DTYPES:
        raise DomainError("dtype", text, f"{name}: convert it to one of {', '.join(DTYPES)}")
    return text


def resolve_scaling(
    name: str,
    dtype: str,
    bands: Sequence[RasterBand],
    options: SourceOptions,
    sample: Callable[[], NDArray[Any]],
    bits: int | None = None,
) -> Scaling:
    """Settle what numbers mean.

    Without a quantity in `options`, a raster with a sensor, a geometry, or a scale is reflectance, any other a picture.

    Parameters
    ----------
    name : str
        The file as the user knows it.
    dtype : str
    bands : sequence of RasterBand
        With scale and offset as in the file; 1 and 0 where it has none.
    options : SourceOptions
    sample : callable
        Gives some numbers of the file, NaN or left out where there are no data; called for floats without a scale.
    bits : int, optional
        Bits in use, where fewer than the type has.

    Raises
    ------
    DomainError
        If the scale is missing, naming the options that give it.
    """
    scaled = any(band.scale != 1.0 or band.offset != 0.0 for band in bands)
    told = options.scale is not None or options.offset is not None
    known = options.sensor is not None or options.sun_zenith_deg is not None
    quantity: Quantity = options.quantity or ("reflectance" if known or scaled or told else "display")
    if quantity not in QUANTITIES:
        raise DomainError("quantity", quantity, f"choose one of {', '.join(QUANTITIES)}")
    floating = dtype.startswith("float")
    white = None if floating else float(2**bits - 1 if bits else np.iinfo(dtype).max)
    bands = tuple(replace(band, saturation=white) for band in bands)
    if scaled or told:
        if not scaled and options.scale is None and not floating:
            raise _missing_scale(name, dtype, quantity)
        bands = tuple(_told(band, options) for band in bands)
        notes: tuple[str, ...] = ()
        if not scaled and options.offset is None and not floating and quantity != "display":
            notes = (f"{name} has no offset and none was given: it is taken as 0",)
        return Scaling(quantity, bands, scaled, notes)
    if floating:
        _check_floats(name, quantity, sample())
        return Scaling(quantity, bands, False, ())
    if quantity != "display":
        raise _missing_scale(name, dtype, quantity)
    if dtype.startswith("int") or white is None:
        remedy = f"{name} holds {dtype} without a scale, and signed numbers have no white; give scale (1 / its white)"
        raise DomainError("scale", None, remedy)
    return Scaling(quantity, tuple(replace(band, scale=1.0 / white) for band in bands), False, ())


def _told(band: RasterBand, options: SourceOptions) -> RasterBand:
    return replace(
        band,
        scale=band.scale if options.scale is None else options.scale,
        offset=band.offset if options.offset is None else options.offset,
    )


def _missing_scale(name: str, dtype: str, quantity: str) -> DomainError:
    return DomainError(
        "scale",
        None,
        f"{name} holds {dtype} and does not say what they mean; give scale and offset, "
        f"{quantity} = scale * number + offset (Sentinel-2 since baseline 04.00: 0.0001 and -0.1)",
    )


def _check_floats(name: str, quantity: str, numbers: NDArray[Any]) -> None:
    """Floats without a scale are taken as they are, unless they plainly are something else."""
    finite = numbers[np.isfinite(numbers)]
    if quantity == "radiance" or finite.size == 0:
        return
    middle = float(np.median(finite))
    if abs(middle) > _BRIGHTEST_MEDIAN:
        remedy = f"{name} holds {quantity} of {middle:.4g} in the middle, where up to 1 is expected; give scale, offset"
        raise DomainError("scale", None, remedy)
