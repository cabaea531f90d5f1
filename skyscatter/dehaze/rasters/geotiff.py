"""GeoTIFF, and every other raster of one file that GDAL reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import RasterProfile, RasterSource, Window, calibrate
from skyscatter.dehaze.rasters.handles import DatasetPool, quiet
from skyscatter.dehaze.rasters.names import LABELS, BandWords, choose_bands, describe_bands
from skyscatter.dehaze.rasters.scaling import check_dtype, resolve_scaling
from skyscatter.errors import DomainError

#: Rows and columns of the nine windows that the plausibility of a scale is judged by.
_SAMPLE = 64
#: Statistics of the hazy image are not those of the result.
_STALE = ("STATISTICS_",)


class GeoTiffSource(RasterSource):
    """A raster of one file.

    Parameters
    ----------
    path : str
        File, or what GDAL calls one.
    options : SourceOptions
        Sensor, bands, quantity, scale and offset, angles.

    Raises
    ------
    MissingDataError
        If the file is not there, not a raster, or damaged.
    DomainError
        If it has no bands, numbers of an unknown type or scale, or bands that are not samples of light.
    """

    def __init__(self, path: str, options: SourceOptions) -> None:
        self.name = str(path)
        self._pool = DatasetPool(str(path), self.name)
        try:
            with self._pool.reading() as dataset:
                self._describe(dataset, options)
        except BaseException:
            self._pool.close()
            raise

    def _describe(self, dataset: Any, options: SourceOptions) -> None:
        if dataset.count == 0:
            inside = f"; it holds {', '.join(dataset.subdatasets[:3])}" if dataset.subdatasets else ""
            raise DomainError("bands", 0, f"{self.name} has no bands{inside}; name a raster with at least one band")
        self.height, self.width = dataset.height, dataset.width
        if len(set(dataset.dtypes)) > 1:
            raise DomainError("dtype", ", ".join(dataset.dtypes), f"the bands of {self.name} must have one type")
        dtype = check_dtype(self.name, dataset.dtypes[0])
        colours = tuple(colour.name for colour in dataset.colorinterp)
        for number, colour in enumerate(colours, start=1):
            if colour in LABELS:
                remedy = f"band {number} of {self.name} holds {LABELS[colour]}; convert the file to red, green and blue"
                raise DomainError("bands", colour, remedy)
        words = [
            BandWords(text, colour, {**dataset.tags(number), **dataset.tags(number, ns="IMAGERY")})
            for number, (text, colour) in enumerate(zip(dataset.descriptions, colours, strict=True), start=1)
        ]
        every = [
            replace(band, scale=float(scale), offset=float(offset), resolution=abs(dataset.transform.a))
            for band, scale, offset in zip(
                describe_bands(words, options.sensor), dataset.scales, dataset.offsets, strict=True
            )
        ]
        chosen = choose_bands(every, options.bands)
        if not chosen:
            raise DomainError("bands", 0, f"{self.name} has an alpha band and no other")
        self._places = [place for place, _ in chosen]
        self._set_masks(dataset, dtype, colours)
        scaling = resolve_scaling(
            self.name, dtype, [band for _, band in chosen], options, lambda: self._sample(dataset), _bits(dataset)
        )
        self.quantity, self.bands, scaled, self.notes = scaling
        self.sensor, self.geometry = options.sensor, options.geometry()
        self.profile = self._profile(dataset, dtype, colours, scaled)

    def _set_masks(self, dataset: Any, dtype: str, colours: Sequence[str]) -> None:
        from rasterio.enums import MaskFlags

        self._alpha = colours.index("alpha") if "alpha" in colours else None
        flags = dataset.mask_flag_enums[self._places[0]]
        self._mask = MaskFlags.per_dataset in flags and self._alpha is None
        self._nodata = [_representable(dataset.nodatavals[place], dtype) for place in self._places]

    def _profile(self, dataset: Any, dtype: str, colours: Sequence[str], scaled: bool) -> RasterProfile:
        gcps, gcp_crs = dataset.gcps
        with quiet():
            transform = dataset.transform
        whole = RasterProfile(
            dtype=dtype,
            crs=dataset.crs,
            transform=None if transform.is_identity else transform,
            nodata=dataset.nodatavals[self._places[0]],
            tags=MappingProxyType(dict(dataset.tags())),
            band_tags=tuple(_lasting(dataset.tags(number)) for number in dataset.indexes),
            descriptions=tuple(dataset.descriptions),
            colours=tuple(colours),
            units=tuple(dataset.units),
            gcps=(tuple(gcps), gcp_crs) if gcps else None,
            rpcs=dataset.rpcs,
            mask=self._mask,
            scaled=scaled,
        )
        if self._alpha is None:
            return whole.select(self._places)
        # The alpha band keeps its place if it was the last one or all bands are in the order of the file.
        order = sorted([*self._places, self._alpha]) if self._places == sorted(self._places) else None
        order = order or [*self._places, self._alpha]
        return whole.select(order, alpha=order.index(self._alpha))

    def read_with_flags(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Values and flags of a window; see `RasterSource`."""
        window = self._window(row0, row1, col0, col1)
        with self._pool.reading() as dataset:
            return self._load(dataset, window, window.shape, self._indexes(bands))

    def thumbnail(
        self, size: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], tuple[float, float]]:
        """A coarse version of the image; see `RasterSource`."""
        step = max(1.0, max(self.height, self.width) / size)
        shape = max(1, round(self.height / step)), max(1, round(self.width / step))
        with self._pool.reading() as dataset:
            values, _ = self._load(dataset, Window(0, self.height, 0, self.width), shape, self._indexes(bands))
        return values, (self.height / shape[0], self.width / shape[1])

    def read_alpha(self, row0: int, row1: int, col0: int, col1: int) -> NDArray[Any] | None:
        """The alpha band as it is in the file; None if there is none."""
        if self._alpha is None:
            return None
        window = self._window(row0, row1, col0, col1)
        with self._pool.reading() as dataset:
            return dataset.read(self._alpha + 1, window=_ranges(window))

    def close(self) -> None:
        """Close the file in all threads."""
        self._pool.close()

    def _load(
        self, dataset: Any, window: Window, shape: tuple[int, int], indexes: list[int]
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        # Of a picture a pixel is empty only where all bands hold the nodata value: black in one of them is a colour.
        together = self.quantity == "display" and any(value is not None for value in self._nodata)
        taken = list(range(len(self.bands))) if together else indexes
        numbers = dataset.read(
            [self._places[index] + 1 for index in taken], window=_ranges(window), out_shape=(len(taken), *shape)
        )
        valid = self._valid(dataset, window, numbers, taken, together)
        if together and indexes != taken:
            numbers = numbers[indexes]
        return calibrate(numbers, valid, [self.bands[index] for index in indexes])

    def _valid(
        self, dataset: Any, window: Window, numbers: NDArray[Any], taken: list[int], together: bool
    ) -> NDArray[np.bool_] | None:
        valid: NDArray[np.bool_] | None = None
        ranges, shape = _ranges(window), numbers.shape[1:]
        if self._alpha is not None:
            valid = dataset.read([self._alpha + 1], window=ranges, out_shape=(1, *shape)) != 0
        elif self._mask:
            valid = dataset.read_masks([self._places[0] + 1], window=ranges, out_shape=(1, *shape)) != 0
        if any(self._nodata[index] is not None for index in taken):
            there: NDArray[np.bool_] = np.ones(numbers.shape, dtype=bool)
            for place, index in enumerate(taken):
                if self._nodata[index] is not None:
                    np.not_equal(numbers[place], self._nodata[index], out=there[place])
            if together:
                there = np.logical_or.reduce(there, axis=0, keepdims=True)
            valid = there if valid is None else there & valid
        return valid

    def _sample(self, dataset: Any) -> NDArray[Any]:
        """Numbers of nine small windows over the image, without nodata."""
        parts = []
        for row in np.linspace(0, max(0, self.height - _SAMPLE), 3).astype(int):
            for col in np.linspace(0, max(0, self.width - _SAMPLE), 3).astype(int):
                window = Window(row, min(row + _SAMPLE, self.height), col, min(col + _SAMPLE, self.width))
                numbers = dataset.read([place + 1 for place in self._places], window=_ranges(window))
                valid = self._valid(dataset, window, numbers, list(range(len(self._places))), together=False)
                parts.append(numbers[np.broadcast_to(True if valid is None else valid, numbers.shape)])
        return np.concatenate(parts)


def _ranges(window: Window) -> tuple[tuple[int, int], tuple[int, int]]:
    return (window.row0, window.row1), (window.col0, window.col1)


def _representable(nodata: float | None, dtype: str) -> Any:
    """The nodata value as the numbers have it; None if no number can equal it (NaN is found without asking)."""
    if nodata is None or np.isnan(nodata):
        return None
    if dtype.startswith("float"):
        return np.dtype(dtype).type(nodata)
    limits = np.iinfo(dtype)
    return np.dtype(dtype).type(nodata) if float(nodata).is_integer() and limits.min <= nodata <= limits.max else None


def _bits(dataset: Any) -> int | None:
    """Bits in use, where the file says that these are fewer than the type has."""
    text = dataset.tags(1, ns="IMAGE_STRUCTURE").get("NBITS")
    return int(text) if text and not dataset.dtypes[0].startswith("float") else None


def _lasting(tags: Mapping[str, str]) -> Mapping[str, str]:
    return MappingProxyType({key: value for key, value in tags.items() if not key.startswith(_STALE)})
