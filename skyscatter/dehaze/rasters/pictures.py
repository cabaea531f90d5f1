"""PNG and JPEG: display values from 0 to 1, upright, with the colour profile that they came with."""

from __future__ import annotations

import warnings
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.arrays import ArraySource
from skyscatter.dehaze.rasters.base import RasterBand, RasterProfile
from skyscatter.dehaze.rasters.handles import DatasetPool, quiet
from skyscatter.errors import MissingDataError, SkyscatterError

_ORIENTATION = 0x0112
#: Modes of Pillow that are taken as they are; others become RGB, or RGBA if they have transparency.
_PLAIN = ("L", "LA", "RGB", "RGBA", "I;16")


class PictureSource(ArraySource):
    """A picture, held in memory in its own type of number.

    Cameras store pictures on their side and note how they were held: they are turned upright.  Colours that a palette
    lists become red, green and blue, as do those for printing.  The profile of the colours is kept and not applied.

    Parameters
    ----------
    path : str
        .png, .jpg or .jpeg.
    options : SourceOptions

    Raises
    ------
    MissingDataError
        If it is not a picture or cut short.
    """

    def __init__(self, path: str, options: SourceOptions) -> None:
        pixels, orientation, icc, exif = _read(path)
        upright = _turned(pixels, orientation)
        channels = upright.shape[2]
        alpha = upright[:, :, -1] if channels in (2, 4) else None
        roles = ("grey",) if channels < 3 else ("red", "green", "blue")
        colours = ("gray",) if channels < 3 else roles
        crs, transform = _georeference(path) if orientation == 1 else (None, None)
        profile = RasterProfile(
            dtype=str(upright.dtype),
            crs=crs,
            transform=transform,
            descriptions=(None,) * channels,
            colours=(*colours, "alpha") if alpha is not None else colours,
            alpha=None if alpha is None else channels - 1,
            icc=icc,
            exif=exif,
        )
        super().__init__(
            np.moveaxis(upright[:, :, : len(roles)], 2, 0),
            options,
            bands=[RasterBand(role, role=role) for role in roles],
            alpha=alpha,
            profile=profile,
            name=path,
        )


def _read(path: str) -> tuple[NDArray[Any], int, bytes | None, bytes | None]:
    """Pixels (y, x, channel) as stored, how they were held (EXIF orientation, 1 to 8), colour profile, other EXIF."""
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError as error:
        raise SkyscatterError("pillow is not installed: pip install pillow") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as picture:
                exif = picture.getexif()
                orientation = int(exif.pop(_ORIENTATION, 1))
                icc = picture.info.get("icc_profile")
                pixels = _deep(path) if _is_deep(path) else _shallow(picture)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise MissingDataError(path, "is too large for a picture that is held in memory; make it a GeoTIFF") from error
    except FileNotFoundError as error:
        raise MissingDataError(path, "there is no such file; check the path") from error
    except UnidentifiedImageError as error:
        raise MissingDataError(path, "is not a picture; give PNG, JPEG or a raster") from error
    except (OSError, SyntaxError, ValueError) as error:
        text = " ".join(str(error).split())
        raise MissingDataError(path, f"is damaged or cut short ({text}); get the file again") from error
    return pixels, orientation if 1 <= orientation <= 8 else 1, icc, exif.tobytes() if len(exif) else None


def _is_deep(path: str) -> bool:
    """Whether it is a PNG with 16 bits a channel, of which Pillow would keep 8."""
    with open(path, "rb") as file:
        head = file.read(26)
    return head.startswith(b"\x89PNG\r\n\x1a\n") and head[24:25] == b"\x10"


def _shallow(picture: Any) -> NDArray[Any]:
    if picture.mode not in _PLAIN or "transparency" in picture.info:
        clear = picture.mode in ("PA", "La", "RGBa") or "transparency" in picture.info
        picture = picture.convert("RGBA" if clear else "L" if picture.mode == "1" else "RGB")
    pixels = np.asarray(picture)
    return pixels[:, :, np.newaxis] if pixels.ndim == 2 else pixels


def _deep(path: str) -> NDArray[Any]:
    pool = DatasetPool(path, path)
    try:
        with pool.reading() as dataset:
            return np.moveaxis(dataset.read(), 0, 2)
    finally:
        pool.close()


def _turned(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Upright pixels from stored ones: the eight cases of EXIF 2.32, 4.6.4 A, Orientation."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    rows = slice(None, None, -1) if orientation in (3, 4, 7, 8) else slice(None)
    cols = slice(None, None, -1) if orientation in (2, 3, 6, 7) else slice(None)
    return pixels[rows, cols]


def _georeference(path: str) -> tuple[Any, Any]:
    """Of a picture with a world file beside it; nothing otherwise."""
    with suppress(SkyscatterError):
        pool = DatasetPool(path, path)
        try:
            with pool.reading() as dataset, quiet():
                transform = dataset.transform
                return dataset.crs, None if transform.is_identity else transform
        finally:
            pool.close()
    return None, None
