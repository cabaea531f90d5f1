"""What every source of an image gives: bands with names and scales, geometry, and windows of values with flags."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.geometry import SceneGeometry
from skyscatter.errors import DomainError
from skyscatter.record import nearest

Quantity = Literal["reflectance", "radiance", "display"]
#: What the numbers of a source may be once scale and offset are applied.
QUANTITIES: tuple[Quantity, ...] = ("reflectance", "radiance", "display")

#: Bits of the mask that a source itself can know; the same as in `skyscatter.dehaze.flags`.
NODATA = 1
SATURATED = 2


class Window(NamedTuple):
    """Rows row0 to row1 and columns col0 to col1 [pixel], ends excluded."""

    row0: int
    row1: int
    col0: int
    col1: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.row1 - self.row0, self.col1 - self.col0


@dataclass(frozen=True)
class RasterBand:
    """One band of a source: value = scale * number in the file + offset.

    Parameters
    ----------
    name : str
        As the user may ask for it: ``B02``, ``red``, ``band1``.
    description : str, optional
        What the file says.
    wavelength_nm : float, optional
        Centre [nm], where the file or the sensor says so.
    scale, offset : float
        From numbers in the file to values.
    role : str, optional
        red, green, blue, coastal, rededge, nir, swir1, swir2, water-vapour, cirrus, pan, grey, or None if unknown.
    resolution : float, optional
        Native size of a pixel, in the unit of the coordinates.
    saturation : float, optional
        Number in the file from which on a pixel is saturated.
    solar_irradiance : float, optional
        Of the band at 1 au [W m-2 um-1], where the metadata has it.
    """

    name: str
    description: str | None = None
    wavelength_nm: float | None = None
    scale: float = 1.0
    offset: float = 0.0
    role: str | None = None
    resolution: float | None = None
    saturation: float | None = None
    solar_irradiance: float | None = None


@dataclass(frozen=True)
class RasterProfile:
    """What a file of the same place must carry on: georeference, nodata, names, tags, colours."""

    dtype: str
    crs: Any = None
    transform: Any = None
    nodata: float | None = None
    tags: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    band_tags: tuple[Mapping[str, str], ...] = ()
    descriptions: tuple[str | None, ...] = ()
    colours: tuple[str, ...] = ()
    units: tuple[str | None, ...] = ()
    gcps: tuple[tuple[Any, ...], Any] | None = None
    rpcs: Any = None
    #: Place of the alpha band among all bands of the file, from 0; None if there is none.
    alpha: int | None = None
    #: Whether the file has a mask of its own, beside nodata and alpha.
    mask: bool = False
    #: Whether scale and offset were written in the file, so that numbers without them would be misread.
    scaled: bool = False
    icc: bytes | None = None
    exif: bytes | None = None

    def select(self, indexes: Sequence[int], *, alpha: int | None = None) -> RasterProfile:
        """The profile of some of its bands, by place from 0; `alpha` says where among them the alpha band is."""

        def pick(values: tuple[Any, ...]) -> tuple[Any, ...]:
            return tuple(values[index] for index in indexes) if values else ()

        return replace(
            self,
            band_tags=pick(self.band_tags),
            descriptions=pick(self.descriptions),
            colours=pick(self.colours),
            units=pick(self.units),
            alpha=alpha,
        )


class RasterSource(ABC):
    """An image that is read window by window.

    Attributes
    ----------
    height, width : int
        Pixels.
    bands : tuple of RasterBand
        Without an alpha band: that is a mask.
    quantity : {'reflectance', 'radiance', 'display'}
        What `read` returns: reflectance of the top of the atmosphere, radiance [W m-2 sr-1 um-1], or display values
        from 0 to 1.
    geometry : SceneGeometry or None
    sensor : str or None
        ``sentinel-2a``, ``landsat-8``, ...
    acquired : datetime or None
    sun_distance_au : float or None
    profile : RasterProfile
    notes : tuple of str
        What had to be assumed or left out, in words for the user.
    name : str
        Of the file.
    """

    name: str = "array"
    height: int
    width: int
    bands: tuple[RasterBand, ...]
    quantity: Quantity
    geometry: SceneGeometry | None = None
    sensor: str | None = None
    acquired: datetime | None = None
    sun_distance_au: float | None = None
    profile: RasterProfile
    notes: tuple[str, ...] = ()

    @abstractmethod
    def read_with_flags(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Values and flags of a window; any thread may ask.

        Parameters
        ----------
        row0, row1, col0, col1 : int
            Rows row0 to row1 - 1, columns col0 to col1 - 1; inside of the image.
        bands : sequence of int or str, optional
            Places (from 0) or names; all bands if not given.

        Returns
        -------
        values : ndarray of float32, shape (band, row1 - row0, col1 - col0)
            NaN where there are no data.
        flags : ndarray of uint8, shape (row1 - row0, col1 - col0)
            NODATA where none of these bands has data, SATURATED where one of them is saturated; CLOUD and SHADOW of
            `skyscatter.dehaze.Flag` where the product says so.
        """

    @abstractmethod
    def thumbnail(
        self, size: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], tuple[float, float]]:
        """The image from every n-th pixel or coarser tables of the file, at most `size` pixels on a side.

        Returns
        -------
        values : ndarray of float32, shape (band, y, x)
        step : (float, float)
            Pixels of the image per pixel of the thumbnail, down and across.
        """

    def read(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> NDArray[np.float32]:
        """Values of a window as `read_with_flags` gives them."""
        return self.read_with_flags(row0, row1, col0, col1, bands)[0]

    def read_saturated(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> NDArray[np.bool_]:
        """Where one of the bands is saturated, shape (row1 - row0, col1 - col0)."""
        return (self.read_with_flags(row0, row1, col0, col1, bands)[1] & SATURATED) != 0

    def read_alpha(self, row0: int, row1: int, col0: int, col1: int) -> NDArray[Any] | None:
        """The alpha band as it is in the file, shape (row1 - row0, col1 - col0); None if there is none."""
        return None

    def band_index(self, band: int | str) -> int:
        """Place of a band, from 0, by place, name or role."""
        return find_band(self.bands, band)

    def rgb(self) -> tuple[int, int, int] | None:
        """Places of the red, green and blue bands; None if the file does not say which they are."""
        places = {band.role: place for place, band in reversed(list(enumerate(self.bands)))}
        if not {"red", "green", "blue"} <= places.keys():
            return None
        return places["red"], places["green"], places["blue"]

    def close(self) -> None:
        """Close the files, if there are any."""
        return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _indexes(self, bands: Sequence[int | str] | None) -> list[int]:
        return list(range(len(self.bands))) if bands is None else [self.band_index(band) for band in bands]

    def _window(self, row0: int, row1: int, col0: int, col1: int) -> Window:
        if not (0 <= row0 < row1 <= self.height and 0 <= col0 < col1 <= self.width):
            rule = f"must lie inside of {self.height} rows and {self.width} columns"
            raise DomainError("window", (row0, row1, col0, col1), rule)
        return Window(row0, row1, col0, col1)


def find_band(bands: Sequence[RasterBand], band: int | str) -> int:
    """Place of a band, from 0, by place, name or role."""
    if isinstance(band, (int, np.integer)):
        if not 0 <= band < len(bands):
            raise DomainError("bands", int(band), f"there are bands 0 to {len(bands) - 1}")
        return int(band)
    wanted = band.strip().lower()
    for key in ("name", "role", "description"):
        found = [place for place, one in enumerate(bands) if (getattr(one, key) or "").lower() == wanted]
        if len(found) == 1:
            return found[0]
    raise DomainError("bands", band, f"no such band; {nearest(band, [one.name for one in bands])}")


def calibrate(
    numbers: NDArray[Any], valid: NDArray[np.bool_] | None, bands: Sequence[RasterBand]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Values and flags from the numbers of a file.

    Parameters
    ----------
    numbers : ndarray, shape (band, y, x)
    valid : ndarray of bool, shape (band, y, x) or (1, y, x), optional
        Where there are data; everywhere if not given.
    bands : sequence of RasterBand
        With scale, offset and saturation.
    """
    values = numbers.astype(np.float32)
    saturated = np.zeros(numbers.shape[1:], dtype=bool)
    floating = numbers.dtype.kind == "f"
    for place, band in enumerate(bands):
        good = None if valid is None else valid[min(place, valid.shape[0] - 1)]
        if band.saturation is not None:
            over = numbers[place] >= band.saturation
            saturated |= over if good is None else over & good
        if band.scale != 1.0:
            values[place] *= np.float32(band.scale)
        if band.offset != 0.0:
            values[place] += np.float32(band.offset)
        if good is not None:
            values[place][~good] = np.nan
        if floating:  # infinities are what divisions by nothing leave behind
            values[place][np.isinf(values[place])] = np.nan
    if floating or valid is not None:
        empty = np.isnan(values).all(axis=0)
    else:
        empty = np.zeros(numbers.shape[1:], dtype=bool)
    flags = np.where(empty, np.uint8(NODATA), np.uint8(0))
    flags[saturated] |= SATURATED
    return values, flags


def finite_number(value: Any) -> float | None:
    """The value as a float if it is a finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None
