"""From reflectance and display values to the numbers of a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.errors import DomainError

#: Types of number that results may be written as.
OUTPUT_DTYPES = ("uint8", "uint16", "int16", "float32")
#: Steps of reflectance that are small beside the accuracy that is aimed at (1e-3): the rounding is half of a step.
COARSEST_STEP = 2e-4
#: Scale, offset and nodata of reflectance in integers where the source does not say; uint16 as in Sentinel-2 products.
_REFLECTANCE = {"uint16": (1e-4, -0.1, 0.0), "int16": (1e-4, 0.0, -32768.0)}


@dataclass(frozen=True)
class Encoding:
    """Numbers of a file: number = (value - offset) / scale, rounded where they are integers.

    Parameters
    ----------
    dtype : str
    scales, offsets : tuple of float
        One a band.
    nodata : float, optional
        Stands where there are no data; None if alpha or a mask says so.
    tagged : bool
        Whether scale and offset are written into the file.
    together : bool
        Whether a pixel is empty only where all bands hold `nodata` (pictures), or each band for itself.
    """

    dtype: str
    scales: tuple[float, ...]
    offsets: tuple[float, ...]
    nodata: float | None = None
    tagged: bool = False
    together: bool = False

    def encode(self, values: NDArray[Any], *, masked: bool = False) -> NDArray[Any]:
        """Numbers of a window.

        Parameters
        ----------
        values : ndarray, shape (band, y, x)
            NaN where there are no data.  Integers of the file's type are taken as they are.
        masked : bool
            Whether alpha or a mask tells where there are no data.

        Raises
        ------
        DomainError
            If there are gaps and the file has no way to say so.
        """
        if values.dtype == np.dtype(self.dtype) and values.dtype.kind in "iu":
            return values
        if self.dtype.startswith("float"):
            return self._floats(values)
        limits = np.iinfo(self.dtype)
        empty = np.isnan(values)
        gaps = bool(empty.any())
        if gaps and self.nodata is None and not masked:
            raise DomainError("nodata", None, f"the result has gaps, which {self.dtype} cannot hold; use float32")
        numbers = np.empty(values.shape, dtype=self.dtype)
        for band in range(values.shape[0]):
            plane = values[band].astype(np.float32)
            if self.offsets[band] != 0.0:
                plane -= np.float32(self.offsets[band])
            if self.scales[band] != 1.0:
                plane /= np.float32(self.scales[band])
            np.rint(plane, out=plane)
            if gaps:
                plane[empty[band]] = 0.0
            # A float32 holds no number between the greatest of 32 bits; integers here have 16 at most.
            numbers[band] = np.clip(plane, limits.min, limits.max, out=plane)
        if self.nodata is not None:
            self._keep_apart(numbers, empty, limits)
        return numbers

    def _floats(self, values: NDArray[Any]) -> NDArray[Any]:
        numbers = values.astype(self.dtype)
        if self.nodata is not None and not np.isnan(self.nodata):
            numbers[np.isnan(numbers)] = self.nodata
        return numbers

    def _keep_apart(self, numbers: NDArray[Any], empty: NDArray[np.bool_], limits: np.iinfo[Any]) -> None:
        """Gaps become nodata; data that happen to be that number move one step beside it."""
        assert self.nodata is not None
        nodata = int(self.nodata)
        beside = nodata + 1 if nodata < limits.max else nodata - 1
        same = (numbers == nodata) & ~empty
        if self.together:
            same &= (numbers == nodata).all(axis=0, keepdims=True)
        numbers[same] = beside
        numbers[empty] = nodata


def result_encoding(source: RasterSource, dtype: str | None = None) -> Encoding:
    """How results of a source are written.

    Pictures keep the type of number that they have.  Reflectance keeps it with scale, offset and nodata if it
    is an integer whose steps are not above 2e-4; otherwise it becomes float32 with NaN where there are no data.  Values
    that an integer cannot hold (a cloud under a low Sun) become its greatest or least number.

    Parameters
    ----------
    source : RasterSource
    dtype : {'uint8', 'uint16', 'int16', 'float32'}, optional
        In place of that choice.
    """
    if dtype is not None and dtype not in OUTPUT_DTYPES:
        raise DomainError("dtype", dtype, f"choose one of {', '.join(OUTPUT_DTYPES)}")
    profile, bands = source.profile, source.bands
    scales = tuple(band.scale for band in bands)
    offsets = tuple(band.offset for band in bands)
    same = dtype in (None, profile.dtype)
    if source.quantity == "display":
        return _display_encoding(source, dtype or profile.dtype, same)
    fine = source.quantity == "reflectance" and max(scales) <= COARSEST_STEP
    if same and profile.dtype in ("uint16", "int16") and (fine or (dtype is not None and len(set(scales)) == 1)):
        return Encoding(profile.dtype, scales, offsets, profile.nodata, tagged=True)
    if same and profile.dtype.startswith("float") and source.quantity == "reflectance":
        return Encoding("float32", *_ones(len(bands)), _float_nodata(profile.nodata))
    if dtype in (None, "float32"):
        return Encoding("float32", *_ones(len(bands)), float("nan"))
    if dtype == "uint8":
        raise DomainError("dtype", dtype, f"too coarse for reflectance; choose {', '.join(OUTPUT_DTYPES[1:])}")
    scale, offset, nodata = _REFLECTANCE[str(dtype)]
    return Encoding(str(dtype), (scale,) * len(bands), (offset,) * len(bands), nodata, tagged=True)


def layer_encoding(count: int, dtype: str = "float32") -> Encoding:
    """Of maps beside the result: float32 with NaN where there are no data, or integers as they are."""
    return Encoding(dtype, *_ones(count), float("nan") if dtype.startswith("float") else None)


def _display_encoding(source: RasterSource, dtype: str, same: bool) -> Encoding:
    profile, count = source.profile, len(source.bands)
    if dtype in ("float64", "float32"):
        return Encoding("float32", *_ones(count), _float_nodata(profile.nodata if same else None))
    if same and dtype in OUTPUT_DTYPES:
        scales = tuple(band.scale for band in source.bands)
        offsets = tuple(band.offset for band in source.bands)
        plain = set(scales) == {1.0 / np.iinfo(dtype).max} and set(offsets) == {0.0}
        return Encoding(dtype, scales, offsets, profile.nodata, tagged=not plain, together=True)
    if dtype not in ("uint8", "uint16"):
        raise DomainError("dtype", dtype, "pictures are written as uint8, uint16 or float32; choose one of these")
    gaps = profile.nodata is not None or (profile.dtype.startswith("float") and profile.alpha is None)
    nodata = 0.0 if gaps and not profile.mask else None
    white = float(np.iinfo(dtype).max)
    return Encoding(dtype, (1.0 / white,) * count, (0.0,) * count, nodata, together=True)


def _ones(count: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return (1.0,) * count, (0.0,) * count


def _float_nodata(nodata: float | None) -> float:
    return float("nan") if nodata is None else float(np.float32(nodata))


def check_layers(names: Sequence[str]) -> tuple[str, ...]:
    """Names of the bands of a map, at least one."""
    if not names:
        raise DomainError("names", "", "a map needs at least one band")
    return tuple(names)
