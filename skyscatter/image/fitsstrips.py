"""FITS files written strip by strip: headers first, then the rows of all planes where they belong.

The sums of FITS (DATASUM and CHECKSUM) are sums of 32-bit words modulo 2^32 - 1, in any order: they grow with the
strips, and nothing is read again.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.image import fits as whole
from skyscatter.image.strips import Outline, Source, check_room, rows_of, strips

#: Bytes of a block of a FITS file, and what the sums are taken modulo.
_BLOCK, _MODULO = 2880, 2**32 - 1
#: Characters that a checksum may not contain.
_FORBIDDEN = frozenset((*range(0x3A, 0x41), *range(0x5B, 0x61)))


class _Image:
    """An image extension in the file: its header, where its data begin, and the sum over them."""

    def __init__(self, hdu: Any, height: int) -> None:
        self.header = hdu.header.copy()
        self.header["NAXIS2"] = height
        self.planes, _, self.width = hdu.data.shape
        self.height, self.kind = height, hdu.data.dtype.newbyteorder(">")
        self.sum = 0
        self.header["CHECKSUM"] = ("0" * 16, "HDU checksum")
        self.header["DATASUM"] = ("4294967295", "data unit checksum")  # as long as one can be
        self.begins = self.data = 0

    @property
    def size(self) -> int:
        """Of the data."""
        return int(self.planes * self.height * self.width * self.kind.itemsize)

    @property
    def head(self) -> bytes:
        """The header as it stands in the file."""
        return self.header.tostring().encode("ascii")

    def place(self, begins: int) -> int:
        """Stand there in the file; where it ends."""
        self.begins, self.data = begins, begins + len(self.head)
        return self.data + -(-self.size // _BLOCK) * _BLOCK

    def put(self, file: BinaryIO, first: int, last: int, values: NDArray[Any]) -> None:
        """Write rows of the picture (plane, row from the bottom, column)."""
        words = np.ascontiguousarray(values, self.kind)
        self.sum = (self.sum + _sum(words)) % _MODULO
        row = self.width * self.kind.itemsize
        for k, plane in enumerate(words):
            file.seek(self.data + (k * self.height + self.height - last) * row)
            file.write(plane.data)

    def finish(self, file: BinaryIO) -> None:
        """Write the header with its sums."""
        # Modulo 2^32 - 1 there is no word of ones alone; data that are not all zero never sum up to 0.
        self.header["DATASUM"] = (str(self.sum), "data unit checksum")
        total = (_sum(np.frombuffer(self.head, np.uint8)) + self.sum) % _MODULO
        self.header["CHECKSUM"] = (checksum_text(~total & 0xFFFFFFFF), "HDU checksum")
        file.seek(self.begins)
        file.write(self.head)


def _sum(values: NDArray[Any]) -> int:
    """Sum of the 32-bit words, most significant byte first."""
    words = values.reshape(-1).view(">u4")
    return int(words.sum(dtype=np.uint64)) % _MODULO


def checksum_text(value: int) -> str:
    """Sixteen characters whose words sum up to a 32-bit value (FITS standard 4.0, appendix J).

    Parameters
    ----------
    value : int
    """
    columns = []
    for shift in (24, 16, 8, 0):
        byte = (value >> shift) & 0xFF
        four = [byte // 4 + (byte % 4 if k == 0 else 0) + 0x30 for k in range(4)]
        while _FORBIDDEN.intersection(four):
            for k in (0, 2):  # pairs are moved against each other, which leaves the sum as it is
                if _FORBIDDEN.intersection(four[k : k + 2]):
                    four[k], four[k + 1] = four[k] + 1, four[k + 1] - 1
        columns.append(four)
    text = "".join(chr(columns[byte][k]) for k in range(4) for byte in range(4))
    return text[-1] + text[:-1]  # the card's text begins in the last byte of a word


def write(source: Source, path: Path, dtype: str | None = None) -> None:
    """Write a FITS file, as `skyscatter.image.fits` does with a picture in memory."""
    height, rows = source.shape[0], rows_of(source.shape)
    images: list[_Image] = []
    with atomic_path(path) as temporary, temporary.open("r+b") as file:
        for first, last, strip in strips(source, rows):
            outline = Outline(source.shape, source.sky, strip.recipe)
            hdus = whole.pack(whole.images(strip, None, outline), dtype, compress=False)
            if first == 0:
                images = [_Image(hdu, height) for hdu in hdus]
                end = 0
                for image in images:
                    end = image.place(end)
                check_room(path, end)
                file.truncate(end)
                file.seek(end)
                file.write(_tables(strip))
            for image, hdu in zip(images, hdus, strict=True):
                image.put(file, first, last, hdu.data)
        for image in images:
            image.finish(file)


def _tables(image: Any) -> bytes:
    """The extensions that are no images, as they stand in the file."""
    from astropy.io import fits

    kept = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), *whole.tables(image)]).writeto(kept, checksum=True)
    return kept.getvalue()[_BLOCK:]
