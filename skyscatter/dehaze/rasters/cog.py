"""Cloud-Optimised GeoTIFF: tiles of a plain GeoTIFF first, in any order, then laid out by GDAL's COG driver."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.rasters.base import RasterProfile
from skyscatter.dehaze.rasters.encoding import Encoding
from skyscatter.dehaze.rasters.handles import environment, first_line, quiet, require_rasterio
from skyscatter.dehaze.rasters.sinks import PendingFile, RasterSink
from skyscatter.errors import DomainError, SkyscatterError

COMPRESSIONS = ("deflate", "zstd", "lzw", "none")
_TILE = 512
Alpha = Callable[[int, int, int, int], NDArray[Any] | None]


class CogSink(RasterSink):
    """A Cloud-Optimised GeoTIFF.

    Parameters
    ----------
    path : path-like
    height, width : int
    profile : RasterProfile
        Georeference, names, tags and colours that the file carries on; with the alpha band among them, if there is one.
    encoding : Encoding
        One scale and offset a band, alpha left out.
    alpha : callable, optional
        ``alpha(row0, row1, col0, col1)`` gives the numbers of the alpha band, if the profile has one.
    compression : {'deflate', 'zstd', 'lzw', 'none'}
    flags : bool
        Whether the numbers are bits, of which no means may be taken in overviews.
    threads : int, optional
        Of the compression; all processors if not given.

    Raises
    ------
    SkyscatterError
        If the file cannot be written: one line with the remedy, now or when it is finished.
    """

    def __init__(
        self,
        path: str | Path,
        height: int,
        width: int,
        profile: RasterProfile,
        encoding: Encoding,
        *,
        alpha: Alpha | None = None,
        compression: str = "deflate",
        flags: bool = False,
        threads: int | None = None,
    ) -> None:
        super().__init__(height, width, len(encoding.scales))
        if compression not in COMPRESSIONS:
            raise DomainError("compression", compression, f"choose one of {', '.join(COMPRESSIONS)}")
        self.profile, self.encoding, self._alpha = profile, encoding, alpha
        self._options = _cog_options(compression, flags, threads)
        self._lock = threading.Lock()
        self._file = PendingFile(path)
        self._work = self._file.path.with_name(f"{self._file.path.stem}.work.tif")
        try:
            with environment(writing=True), quiet(), self._create() as dataset:
                dataset.update_tags(**profile.tags)
                self._name_bands(dataset)
        except BaseException as error:
            said = self._said(error)
            self.abort()
            raise said from error

    @property
    def _bands(self) -> int:
        return self.count + (self.profile.alpha is not None)

    def _create(self) -> Any:
        rasterio = require_rasterio()
        profile, rgb = self.profile, self.profile.colours[:3] == ("red", "green", "blue")
        layout: dict[str, Any] = {"photometric": "RGB" if rgb and self._bands >= 3 else "MINISBLACK"}
        if profile.gcps is None and profile.transform is not None:
            layout["transform"] = profile.transform
        if profile.gcps is not None:
            layout["gcps"], layout["crs"] = list(profile.gcps[0]), profile.gcps[1]
        elif profile.crs is not None:
            layout["crs"] = profile.crs
        if profile.rpcs is not None:
            layout["rpcs"] = profile.rpcs
        if self.encoding.nodata is not None:
            layout["nodata"] = self.encoding.nodata
        return rasterio.open(
            self._work,
            "w",
            driver="GTiff",
            width=self.width,
            height=self.height,
            count=self._bands,
            dtype=self.encoding.dtype,
            tiled=True,
            blockxsize=_TILE,
            blockysize=_TILE,
            BIGTIFF="IF_SAFER",
            **layout,
        )

    @contextmanager
    def _changed(self) -> Iterator[Any]:
        """The plain GeoTIFF open for a change, and on the disk behind it.

        GDAL lets another thread that reads put a waiting block on the disk just when this one takes up the old block
        from there; what was written last is lost then.  So nothing waits.
        """
        rasterio = require_rasterio()
        with self._lock, environment(writing=True):
            with quiet():  # holds up all threads that open a file: not for longer than this
                dataset = rasterio.open(self._work, "r+")
            with dataset:
                yield dataset

    def _name_bands(self, dataset: Any) -> None:
        from rasterio.enums import ColorInterp

        profile = self.profile
        if profile.colours:
            dataset.colorinterp = [ColorInterp[colour] for colour in profile.colours]
        for number, text in enumerate(profile.descriptions, start=1):
            if text:
                dataset.set_band_description(number, text)
        for number, unit in enumerate(profile.units, start=1):
            if unit:
                dataset.set_band_unit(number, unit)
        for number, tags in enumerate(profile.band_tags, start=1):
            if tags:
                dataset.update_tags(number, **tags)
        if self.encoding.tagged:
            dataset.scales = _with_alpha(self.encoding.scales, profile.alpha, 1.0)
            dataset.offsets = _with_alpha(self.encoding.offsets, profile.alpha, 0.0)

    def write(self, row0: int, col0: int, values: NDArray[Any]) -> None:
        """Write a window; see `RasterSink`."""
        cube = self._checked(row0, col0, values)
        masked = self.profile.alpha is not None or self.profile.mask
        numbers = self.encoding.encode(cube, masked=masked)
        row1, col1 = row0 + cube.shape[1], col0 + cube.shape[2]
        window = ((row0, row1), (col0, col1))
        if self.profile.alpha is not None:
            numbers = np.insert(numbers, self.profile.alpha, self._opacity(row0, row1, col0, col1, cube), axis=0)
        try:
            with self._changed() as dataset:
                dataset.write(numbers, window=window)
                if self.profile.mask:
                    dataset.write_mask(~np.isnan(cube).all(axis=0), window=window)
        except Exception as error:
            raise self._said(error) from error

    def _opacity(self, row0: int, row1: int, col0: int, col1: int, cube: NDArray[Any]) -> NDArray[Any]:
        """Alpha as the source has it; opaque where there are data if it has none of the same type."""
        given = None if self._alpha is None else self._alpha(row0, row1, col0, col1)
        if given is not None and given.dtype == np.dtype(self.encoding.dtype):
            return given
        opaque = 1.0 if self.encoding.dtype.startswith("float") else float(np.iinfo(self.encoding.dtype).max)
        if given is not None:
            share = given / (1.0 if given.dtype.kind == "f" else float(np.iinfo(given.dtype).max))
            opaque_part = share * opaque
            return (opaque_part if opaque == 1.0 else np.rint(opaque_part)).astype(self.encoding.dtype)
        return np.where(np.isnan(cube).all(axis=0), 0.0, opaque).astype(self.encoding.dtype)

    def prepare(self) -> None:
        """Lay the file out as a COG under its temporary name."""
        from rasterio.shutil import copy

        try:
            with self._changed() as dataset:
                dataset.update_tags(**self.tags)
            with environment(writing=True), quiet():
                self._check_work()
                copy(self._work, self._file.path, driver="COG", **self._options)
                self._check_result()
            self._work.unlink()
        except Exception as error:
            raise self._said(error) from error

    def commit(self) -> None:
        """Move the file into place."""
        self._file.commit()

    def abort(self) -> None:
        """Leave nothing behind."""
        self._file.abort()

    def _check_work(self) -> None:
        """Writes that GDAL put off may fail when a file is closed, where some versions do not say so."""
        needed = self.height * self.width * self._bands * np.dtype(self.encoding.dtype).itemsize
        if self._work.stat().st_size < needed:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _check_result(self) -> None:
        rasterio = require_rasterio()
        with rasterio.open(self._file.path) as dataset:
            if (dataset.height, dataset.width, dataset.count) != (self.height, self.width, self._bands):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            last = (self.height - 1, self.height), (self.width - 1, self.width)
            dataset.read(window=last)

    def _said(self, error: BaseException) -> BaseException:
        """The error as one line with the remedy, if it is one of writing."""
        if isinstance(error, SkyscatterError) or not isinstance(error, Exception):
            return error
        if isinstance(error, OSError) and error.errno is not None:
            return self._file.explained(error)
        text = first_line(error)
        if "No space left" in text or self._disk_is_full():
            return self._file.explained(OSError(errno.ENOSPC, text))
        # GDAL loses the reason, which hardly ever is another one.
        return SkyscatterError(
            f"{self._file.shown}: cannot be written: {text}; is the disk full? free some space or choose another disk"
        )

    def _disk_is_full(self) -> bool:
        try:
            free = os.statvfs(self._file.path.parent)
        except (OSError, AttributeError):  # not on every system
            return False
        return free.f_bavail * free.f_frsize < 1 << 20


def _with_alpha(values: tuple[float, ...], alpha: int | None, own: float) -> list[float]:
    every = list(values)
    if alpha is not None:
        every.insert(alpha, own)
    return every


def _cog_options(compression: str, flags: bool, threads: int | None) -> dict[str, Any]:
    options: dict[str, Any] = {
        "COMPRESS": compression.upper(),
        "BLOCKSIZE": _TILE,
        "BIGTIFF": "IF_SAFER",
        "NUM_THREADS": threads or "ALL_CPUS",
        "OVERVIEW_RESAMPLING": "NEAREST" if flags else "AVERAGE",
        "STATISTICS": "NO",
    }
    if compression != "none":
        options["PREDICTOR"] = "YES"
    return options


def layer_profile(profile: RasterProfile, names: tuple[str, ...], units: str | None = None) -> RasterProfile:
    """The profile of maps of the same place as an image: its georeference, their own names."""
    count = len(names)
    return replace(
        profile,
        dtype="float32",
        nodata=None,
        tags={key: value for key, value in profile.tags.items() if key == "AREA_OR_POINT"},
        band_tags=(),
        descriptions=names,
        colours=("gray", *("undefined",) * (count - 1)),
        units=(units,) * count,
        alpha=None,
        mask=False,
        scaled=False,
    )
