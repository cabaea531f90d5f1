"""Images in memory, and labelled arrays of xarray, lazy ones too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.base import RasterBand, RasterProfile, RasterSource, calibrate, finite_number
from skyscatter.dehaze.rasters.names import BandWords, choose_bands, describe_bands
from skyscatter.dehaze.rasters.scaling import check_dtype, resolve_scaling
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    import xarray

_ROWS = ("y", "lat", "latitude", "row", "rows", "northing")
_COLS = ("x", "lon", "longitude", "col", "cols", "column", "columns", "easting")
#: What attributes say of the numbers of the input; the result's are other numbers.
_NUMBERS = ("scale_factor", "add_offset", "_FillValue", "missing_value", "units", "valid_range", "dtype")


class ArraySource(RasterSource):
    """An image in memory.

    Parameters
    ----------
    array : array_like, shape (band, y, x) or (y, x)
        Numbers; NaN where there are no data.
    options : SourceOptions, optional
        Scale and offset are needed for integers that are reflectance.
    names : sequence of str, optional
        Of the bands: ``B02``, ``red``.
    nodata : float, optional
        Number that stands where there are no data.
    alpha : array_like, shape (y, x), optional
        0 where there are no data.
    bands : sequence of RasterBand, optional
        In place of `names`, with scales and offsets.
    profile : RasterProfile, optional
        Georeference and names to carry on.
    name : str
        In messages.

    Raises
    ------
    DomainError
        If the array is not of real numbers, has no pixels or bands, or no scale where it needs one.
    """

    def __init__(
        self,
        array: ArrayLike,
        options: SourceOptions | None = None,
        *,
        names: Sequence[str] | None = None,
        nodata: float | None = None,
        alpha: ArrayLike | None = None,
        bands: Sequence[RasterBand] | None = None,
        profile: RasterProfile | None = None,
        name: str = "array",
    ) -> None:
        options = options or SourceOptions()
        # Lazy arrays (dask) stay as they are.
        numbers: Any = array if hasattr(array, "dtype") and hasattr(array, "ndim") else np.asarray(array)
        cube: Any = numbers[np.newaxis] if numbers.ndim == 2 else numbers
        if cube.ndim != 3:
            raise DomainError("array", f"shape {cube.shape}", "must be (band, y, x), or (y, x) for one band")
        if min(cube.shape) == 0:
            raise DomainError("array", f"shape {cube.shape}", "has no bands or no pixels; give at least one of each")
        dtype = check_dtype(name, cube.dtype)
        self.name, self._cube = name, cube
        self.height, self.width = cube.shape[1:]
        every = list(bands) if bands is not None else _named(names, cube.shape[0], options.sensor)
        chosen = choose_bands(every, options.bands)
        self._places = [place for place, _ in chosen]
        self._nodata, self._alpha = nodata, None if alpha is None else np.asarray(alpha)
        scaling = resolve_scaling(name, dtype, [band for _, band in chosen], options, self._sample)
        self.quantity, self.bands, scaled, self.notes = scaling
        self.sensor, self.geometry = options.sensor, options.geometry()
        whole = profile or RasterProfile(dtype=dtype, nodata=nodata)
        if not whole.descriptions:
            texts = tuple(band.description for band in every)
            colours = tuple(band.role if band.role in ("red", "green", "blue") else "undefined" for band in every)
            whole = replace(whole, descriptions=texts, colours=colours)
        if whole.alpha is None:
            self.profile = replace(whole.select(self._places), scaled=scaled)
        else:
            self.profile = replace(whole.select([*self._places, whole.alpha], alpha=len(self._places)), scaled=scaled)

    def read_with_flags(
        self, row0: int, row1: int, col0: int, col1: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Values and flags of a window; see `RasterSource`."""
        self._window(row0, row1, col0, col1)
        return self._load(slice(row0, row1), slice(col0, col1), self._indexes(bands))

    def thumbnail(
        self, size: int, bands: Sequence[int | str] | None = None
    ) -> tuple[NDArray[np.float32], tuple[float, float]]:
        """Every n-th pixel; see `RasterSource`."""
        step = max(1, -(-max(self.height, self.width) // size))
        values, _ = self._load(slice(step // 2, None, step), slice(step // 2, None, step), self._indexes(bands))
        return values, (float(step), float(step))

    def read_alpha(self, row0: int, row1: int, col0: int, col1: int) -> NDArray[Any] | None:
        """The alpha band as it was given; None if there is none."""
        if self._alpha is None:
            return None
        self._window(row0, row1, col0, col1)
        return self._alpha[row0:row1, col0:col1]

    def _numbers(self, places: list[int], rows: slice, cols: slice) -> NDArray[Any]:
        """Numbers of some bands; lazy arrays are computed here, for the window only."""
        return np.stack([np.asarray(self._cube[place, rows, cols]) for place in places])

    def _load(self, rows: slice, cols: slice, indexes: list[int]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        together = self.quantity == "display" and self._nodata is not None
        taken = list(range(len(self.bands))) if together else indexes
        numbers = self._numbers([self._places[index] for index in taken], rows, cols)
        valid = self.valid(numbers)
        if self._alpha is not None:
            opaque = (self._alpha[rows, cols] != 0)[np.newaxis]
            valid = opaque if valid is None else valid & opaque
        if together:
            numbers = numbers[indexes]
        return calibrate(numbers, valid, [self.bands[index] for index in indexes])

    @property
    def places(self) -> list[int]:
        """Places of the bands among all of the array, from 0."""
        return list(self._places)

    def valid(self, numbers: NDArray[Any]) -> NDArray[np.bool_] | None:
        """Where numbers (band, y, x) are not nodata; of a picture, in any of its bands: black in one is a colour.

        Returns
        -------
        ndarray of bool or None
            Shape (band, y, x), or (1, y, x) for all bands together; None if all are data.
        """
        if self._nodata is None:
            return None
        there: NDArray[np.bool_] = np.asarray(numbers != self._nodata)
        return np.logical_or.reduce(there, axis=0, keepdims=True) if self.quantity == "display" else there

    def _sample(self) -> NDArray[Any]:
        step = max(1, max(self.height, self.width) // 256)
        numbers = self._numbers(self._places, slice(None, None, step), slice(None, None, step))
        return numbers if self._nodata is None else numbers[numbers != self._nodata]


def _named(names: Sequence[str] | None, count: int, sensor: str | None) -> list[RasterBand]:
    if names is not None and len(names) != count:
        raise DomainError("names", ",".join(names), f"the array has {count} bands; give one name for each")
    texts: Sequence[str | None] = names if names is not None else [None] * count
    return describe_bands([BandWords(text, "undefined", {}) for text in texts], sensor)


class XarraySource(ArraySource):
    """A labelled array: bands from its coordinates, georeference from what rioxarray keeps.

    Parameters
    ----------
    array : xarray.DataArray
        Of two or three dimensions in any order, rows called y or lat, columns x or lon; chunks are computed
        window by window.
    options : SourceOptions, optional

    Raises
    ------
    DomainError
        If rows and columns cannot be told by their names; and as for `ArraySource`.
    """

    def __init__(self, array: xarray.DataArray, options: SourceOptions | None = None) -> None:
        options = options or SourceOptions()
        rows, cols, band = image_dims(array)
        self._template = array.transpose(*([band] if band else []), rows, cols)
        cube = self._template.data
        count = 1 if band is None else self._template.sizes[band]
        words = _labels(self._template, band, count)
        bands = [
            replace(one, wavelength_nm=centre or one.wavelength_nm, scale=scale, offset=offset)
            for one, centre, scale, offset in zip(
                describe_bands([BandWords(text, "undefined", {}) for text in words], options.sensor),
                _centres(self._template, band, count),
                _per_band(array.attrs, "scale_factor", 1.0, count),
                _per_band(array.attrs, "add_offset", 0.0, count),
                strict=True,
            )
        ]
        nodata = finite_number(array.attrs.get("_FillValue"))
        super().__init__(
            cube,
            options,
            nodata=nodata,
            bands=bands,
            profile=_georeference(array, str(cube.dtype), nodata),
            name=str(array.name or "array"),
        )

    def wrap(self, values: Any, names: Sequence[str] | None = None) -> xarray.DataArray:
        """A result with the coordinates, georeference and attributes of the image.

        Parameters
        ----------
        values : array, shape (band, y, x)
            numpy or dask.
        names : sequence of str, optional
            Of the bands; those of the image if not given.
        """
        import xarray

        rows, cols, band = image_dims(self._template)
        labels = [one.name for one in self.bands] if names is None else list(names)
        kept = {
            key: value
            for key, value in self._template.coords.items()
            if band is None or (key != band and band not in value.dims)
        }
        dim = band or "band"
        attrs = {key: value for key, value in self._template.attrs.items() if key not in (*_NUMBERS, "long_name")}
        return xarray.DataArray(
            values, dims=(dim, rows, cols), coords={**kept, dim: labels}, attrs=attrs, name=self._template.name
        )


def image_dims(array: xarray.DataArray) -> tuple[str, str, str | None]:
    """Names of the dimensions of rows, columns and bands (None for one band)."""
    dims = [str(dim) for dim in array.dims]
    rows = [dim for dim in dims if dim.lower() in _ROWS]
    cols = [dim for dim in dims if dim.lower() in _COLS]
    others = [dim for dim in dims if dim not in (*rows, *cols)]
    if len(rows) != 1 or len(cols) != 1 or len(others) > 1:
        raise DomainError("dims", ", ".join(dims), "name them band, y and x (rename), and select all others away")
    return rows[0], cols[0], others[0] if others else None


def _labels(array: xarray.DataArray, band: str | None, count: int) -> list[str | None]:
    """What the array calls its bands: string coordinates along them, else the names that rioxarray keeps."""
    if band is not None:
        for key in (band, "name", "common_name", "description"):
            if key in array.coords and array.coords[key].dims == (band,) and array.coords[key].dtype.kind in "UOT":
                return [str(text) for text in array.coords[key].values]
    names = array.attrs.get("long_name")
    if isinstance(names, str):
        names = [names] if count == 1 else None
    if isinstance(names, Sequence) and len(names) == count:
        return [str(text) for text in names]
    return [None] * count


def _centres(array: xarray.DataArray, band: str | None, count: int) -> list[float | None]:
    """Centres [nm] from a coordinate called wavelength that says its unit."""
    coordinate = array.coords.get("wavelength") if band is not None else None
    if coordinate is None or coordinate.dims != (band,):
        return [None] * count
    units = {"nm": 1.0, "nanometer": 1.0, "um": 1e3, "µm": 1e3, "micrometer": 1e3}
    factor = units.get(coordinate.attrs.get("units", ""))
    return [None] * count if factor is None else [factor * float(value) for value in coordinate.values]


def _per_band(attrs: Mapping[Any, Any], key: str, default: float, count: int) -> list[float]:
    values = np.atleast_1d(np.asarray(attrs.get(key, default), dtype=np.float64))
    if values.size not in (1, count) or not np.all(np.isfinite(values)):
        raise DomainError(key, attrs.get(key), f"must be one number, or one for each of {count} bands")
    return [float(value) for value in np.broadcast_to(values, count)]


def _georeference(array: xarray.DataArray, dtype: str, nodata: float | None) -> RasterProfile:
    """Coordinate system and transform as rioxarray keeps them, in the coordinate spatial_ref."""
    attrs = array.coords["spatial_ref"].attrs if "spatial_ref" in array.coords else {}
    words = [finite_number(word) for word in str(attrs.get("GeoTransform", "")).split()]
    numbers = [word for word in words if word is not None]
    transform = None
    if len(words) == len(numbers) == 6:
        try:
            from affine import Affine
        except ImportError:  # comes with rasterio, without which no file is written
            transform = None
        else:
            transform = Affine.from_gdal(*numbers)
    crs = attrs.get("crs_wkt") or attrs.get("spatial_ref")
    return RasterProfile(dtype=dtype, crs=crs, transform=transform, nodata=nodata, tags=MappingProxyType({}))
