"""The bytes of a table of a sky: a header in JSON and arrays behind it, for any language to read.

    8 bytes   ``SKYTABLE``
    4 bytes   length n of the header, unsigned, little-endian
    n bytes   the header, JSON in UTF-8, with spaces at its end so that the arrays begin at a multiple of 8
    arrays    each at its offset from there, a multiple of 8, little-endian, last axis fastest

The header's ``arrays`` has ``dtype``, ``shape`` and ``offset`` of every array by its name; docs/howto-sky-table.md
says what they mean.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError

MAGIC, VERSION = b"SKYTABLE", 1
_START = len(MAGIC) + 4
#: The number types of arrays, by their names in the header.
DTYPES = {"uint16": "<u2", "int16": "<i2", "float32": "<f4"}


def packed(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    """One message of a header and arrays."""
    listed, parts, offset = {}, [], 0
    for name, array in arrays.items():
        data = np.ascontiguousarray(array, DTYPES[array.dtype.name]).tobytes()
        listed[name] = {"dtype": array.dtype.name, "shape": list(array.shape), "offset": offset}
        parts.append(data + bytes(-len(data) % 8))
        offset += len(parts[-1])
    text = json.dumps({"format": "skyscatter sky table", "version": VERSION, **header, "arrays": listed}).encode()
    text += b" " * (-(_START + len(text)) % 8)
    return b"".join([MAGIC, len(text).to_bytes(4, "little"), text, *parts])


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a message; what is none is refused."""
    if data[: len(MAGIC)] != MAGIC:
        raise DomainError("table", data[: len(MAGIC)], "is no table of a sky; take one that SkyTableFile.save wrote")
    start = _START + int.from_bytes(data[len(MAGIC) : _START], "little")
    try:
        header = json.loads(data[_START:start])
        if header["version"] != VERSION:
            raise DomainError("table", header["version"], f"is of another version; this one reads {VERSION}")
        arrays = {name: _array(data, start, **entry) for name, entry in header.pop("arrays").items()}
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, DomainError):
            raise
        raise DomainError("table", f"{len(data)} bytes", "is damaged or cut short; make it again") from error
    return header, arrays


def _array(data: bytes, start: int, dtype: str, shape: list[int], offset: int) -> NDArray[Any]:
    kind = np.dtype(DTYPES[dtype])
    return np.frombuffer(data, kind, int(np.prod(shape)), start + offset).reshape(shape)
