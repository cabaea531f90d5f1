"""PNG and JPEG out: gathered in memory, written whole."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.rasters.encoding import Encoding
from skyscatter.dehaze.rasters.handles import environment, first_line, quiet, raster_errors, require_rasterio
from skyscatter.dehaze.rasters.sinks import PendingFile, RasterSink
from skyscatter.errors import DomainError, SkyscatterError

#: Of JPEG, with colours at full resolution: what is lost is below one step of 8 bits nearly everywhere.
JPEG_QUALITY = 95
Alpha = Callable[[int, int, int, int], NDArray[Any] | None]


class PictureSink(RasterSink):
    """A PNG with 8 or 16 bits a channel, or a JPEG.

    Parameters
    ----------
    path : path-like
        .png, .jpg or .jpeg.
    height, width : int
    count : int
        Bands that are written to it.
    order : sequence of int
        Places, from 0, of the one or three bands that the picture shows.
    bits : {8, 16}
    alpha : callable, optional
        ``alpha(row0, row1, col0, col1)`` gives opacity, in numbers of its own type.
    icc, exif : bytes, optional
        Colour profile and notes of the camera to carry on.
    """

    def __init__(
        self,
        path: str | Path,
        height: int,
        width: int,
        count: int = 3,
        *,
        order: tuple[int, ...] = (0, 1, 2),
        bits: int = 8,
        alpha: Alpha | None = None,
        icc: bytes | None = None,
        exif: bytes | None = None,
    ) -> None:
        super().__init__(height, width, count)
        self._jpeg = Path(path).suffix.lower() != ".png"
        if bits not in (8, 16) or (self._jpeg and bits != 8):
            raise DomainError("bits", bits, "a JPEG has 8 bits a channel, a PNG 8 or 16")
        self._order, self._alpha, self._icc, self._exif = order, alpha, icc, exif
        dtype = np.dtype(f"uint{bits}")
        white = float(np.iinfo(dtype).max)
        shown = len(order)
        self._encoding = Encoding(str(dtype), (1.0 / white,) * shown, (0.0,) * shown)
        self.pixels: NDArray[Any] = np.zeros((height, width, shown + (alpha is not None)), dtype=dtype)
        self._file = PendingFile(path)

    def write(self, row0: int, col0: int, values: NDArray[Any]) -> None:
        """Write a window; see `RasterSink`.  Display values from 0 to 1; black where there are no data."""
        cube = self._checked(row0, col0, values)
        row1, col1 = row0 + cube.shape[1], col0 + cube.shape[2]
        part = self.pixels[row0:row1, col0:col1]
        numbers = self._encoding.encode(cube[list(self._order)], masked=True)
        part[:, :, : len(self._order)] = np.moveaxis(numbers, 0, 2)
        if self._alpha is not None:
            part[:, :, -1] = self._opacity(self._alpha(row0, row1, col0, col1))

    def _opacity(self, given: NDArray[Any] | None) -> Any:
        white = np.iinfo(self.pixels.dtype).max
        if given is None:
            return white
        if given.dtype == self.pixels.dtype:
            return given
        own = 1.0 if given.dtype.kind == "f" else float(np.iinfo(given.dtype).max)
        return np.rint(given / own * float(white)).astype(self.pixels.dtype)

    def prepare(self) -> None:
        """Write the picture under its temporary name."""
        try:
            if self.pixels.dtype == np.uint16:
                self._write_deep()
            else:
                self._write_shallow()
        except OSError as error:
            raise self._file.explained(error) from error

    def _write_shallow(self) -> None:
        from PIL import Image
        from PIL.PngImagePlugin import PngInfo

        pixels = self.pixels[:, :, 0] if self.pixels.shape[2] == 1 else self.pixels
        kept = {"icc_profile": self._icc, "exif": self._exif}
        more: dict[str, Any] = {key: value for key, value in kept.items() if value}
        if self._jpeg:
            Image.fromarray(pixels).save(self._file.path, "JPEG", quality=JPEG_QUALITY, subsampling=0, **more)
            return
        texts = PngInfo()
        for key, value in self.tags.items():
            texts.add_itxt(key[:79], value)
        Image.fromarray(pixels).save(self._file.path, "PNG", pnginfo=texts, **more)

    def _write_deep(self) -> None:
        rasterio = require_rasterio()
        layout: dict[str, Any] = {"dtype": "uint16", "count": self.pixels.shape[2]}
        if self._icc:
            layout["SOURCE_ICC_PROFILE"] = base64.b64encode(self._icc).decode()
        try:
            with (
                environment(writing=True),
                quiet(),
                rasterio.open(
                    self._file.path, "w", driver="PNG", height=self.height, width=self.width, **layout
                ) as dataset,
            ):
                dataset.write(np.moveaxis(self.pixels, 2, 0))
        except raster_errors() as error:
            text = f"{first_line(error)}; is the disk full? free some space or choose another disk"
            raise SkyscatterError(f"{self._file.shown}: cannot be written: {text}") from error

    def commit(self) -> None:
        """Move the file into place."""
        self._file.commit()

    def abort(self) -> None:
        """Leave nothing behind."""
        self._file.abort()


def picture_sink(path: str | Path, source: RasterSource, dtype: str | None = None) -> PictureSink:
    """The picture that shows the display values of a source, with its alpha and colour profile.

    Raises
    ------
    DomainError
        If the source is no picture, or does not say which bands are red, green and blue.
    """
    if source.quantity != "display":
        rule = f"a picture cannot hold {source.quantity}; write a .tif, and ask for a quicklook to look at"
        raise DomainError("output", str(path), rule)
    rgb = source.rgb()
    order = rgb if rgb is not None else (0,) if len(source.bands) == 1 else None
    if order is None:
        names = ", ".join(band.name for band in source.bands)
        raise DomainError("bands", names, "say which are red, green and blue: red=1,green=2,blue=3")
    jpeg = Path(path).suffix.lower() != ".png"
    own = source.profile.dtype if source.profile.dtype in ("uint8", "uint16") else "uint16"
    wanted = dtype or ("uint8" if jpeg else own)
    if wanted not in ("uint8", "uint16") or (jpeg and wanted != "uint8"):
        raise DomainError("dtype", wanted, "a JPEG has uint8, a PNG uint8 or uint16")
    transparent = source.profile.alpha is not None
    if transparent and jpeg:
        raise DomainError("output", str(path), "a JPEG cannot hold the alpha band; write a .png or a .tif")
    return PictureSink(
        path,
        source.height,
        source.width,
        len(source.bands),
        order=order,
        bits=8 if wanted == "uint8" else 16,
        alpha=source.read_alpha if transparent else None,
        icc=source.profile.icc,
        exif=source.profile.exif,
    )
