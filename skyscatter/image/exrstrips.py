"""OpenEXR files written strip by strip: the library packs some rows, and their blocks are put behind each other.

A file of scan lines is a header, a table of where its blocks begin, and the blocks: the number of the first line, the
size, and so many packed lines, which know nothing of each other.
"""

from __future__ import annotations

import struct
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from skyscatter.atomic import atomic_path
from skyscatter.errors import SkyscatterError
from skyscatter.image import exr as whole
from skyscatter.image.strips import Source, check_room, rows_of, strips

#: Lines in a block of the compression that we use, ZIP.
LINES = 16
_WINDOWS = (b"dataWindow", b"displayWindow")


def write(source: Source, path: Path, spectral: bool = True, scale: float = 1.0, half: bool = False) -> None:
    """Write an OpenEXR file, as `skyscatter.image.exr` does with a picture in memory."""
    height, width, _ = source.shape
    rows = max(rows_of(source.shape) // LINES, 1) * LINES
    blocks = -(-height // LINES)
    begins: list[int] = []
    with TemporaryDirectory(dir=path.parent if path.parent.is_dir() else None, prefix=".strips-") as folder:
        part = Path(folder, "strip.exr")
        with atomic_path(path) as temporary, temporary.open("r+b") as file:
            for first, _, strip in strips(source, rows):
                if source.sky is not None:
                    strip = strip.placed(source.sky)
                whole.write(strip, part, spectral, scale, half, opacity=not source.filled)
                with part.open("rb") as made:
                    head = _header(made, width, height)
                    if first == 0:
                        check_room(path, blocks * part.stat().st_size // max(-(-strip.shape[0] // LINES), 1))
                        file.write(head + bytes(8 * blocks))
                        table = len(head)
                    begins += _append(made, file, first, -(-strip.shape[0] // LINES))
            file.seek(table)
            file.write(struct.pack(f"<{blocks}Q", *begins))


def _header(file: BinaryIO, width: int, height: int) -> bytes:
    """The header of a file, with the windows of a picture of another size; the file stands behind it then."""
    head = bytearray(file.read(8))
    while name := _word(file):
        kind = _word(file)
        size = file.read(4)
        value = file.read(struct.unpack("<i", size)[0])
        if name in _WINDOWS:
            value = struct.pack("<4i", 0, 0, width - 1, height - 1)
        head += name + b"\0" + kind + b"\0" + size + value
    return bytes(head + b"\0")


def _word(file: BinaryIO) -> bytes:
    """A text that ends with a zero."""
    found = bytearray()
    while (byte := file.read(1)) not in (b"\0", b""):
        found += byte
    return bytes(found)


def _append(made: BinaryIO, file: BinaryIO, first: int, blocks: int) -> list[int]:
    """Copy the blocks of a file to the end of another one, where its first line is another; where each begins."""
    places = struct.unpack(f"<{blocks}Q", made.read(8 * blocks))
    begins = []
    for place in places:
        made.seek(place)
        line, size = struct.unpack("<ii", made.read(8))
        data = made.read(size)
        if len(data) != size:
            raise SkyscatterError(f"{made.name}: a strip of the picture could not be written; is the disk full?")
        begins.append(file.tell())
        file.write(struct.pack("<ii", first + line, size) + data)
    return begins
