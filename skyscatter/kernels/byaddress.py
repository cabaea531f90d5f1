"""Tables in compiled code: passed by address, read where they are used.

Numba hands a named tuple to a function as all of its numbers, one argument each: an array is seven of them, a scene
some four hundred.  Every call then unpacks and packs them again, which costs time in walks, and most of the time of
compiling.  A class that is marked by `by_address` is laid out in memory instead when Python calls a kernel, and what
kernels hand to one another is a pointer.

The layout is in words of eight bytes, one field after the other: a number is one word; an array is the address of its
data, its number of items, its shape and its strides; a marked class within is its own words.  Nothing changes them
while a kernel runs, which the loads say, so that LLVM keeps what it has read in registers over the stores to arrays.
What numba has to know of it stands in `skyscatter.kernels.tables`.
"""

from __future__ import annotations

import operator
import struct
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np

#: Bytes of a word.
WORD = 8

#: The marked classes.
MARKED: list[type] = []

T = TypeVar("T", bound=type)


def by_address(cls: T) -> T:
    """Mark a class of named tuples: compiled code reads it in memory.

    Kernels may take it and read its fields, and not make one.
    """
    MARKED.append(cls)
    known = sys.modules.get("skyscatter.kernels.tables")
    if known is not None:
        known.register(cls)
    return cls


class _Packed(NamedTuple):
    """A table that lies in memory; it lives as long as this."""

    address: int
    block: np.ndarray
    table: Any  #: whose arrays are meant


def _numbers(value: Any) -> Iterator[tuple[str, Any]]:
    """Words of a value: how `struct` writes each, and what."""
    if isinstance(value, np.ndarray):
        yield "Q", value.__array_interface__["data"][0]
        yield "q", value.size
        for number in (*value.shape, *value.strides):
            yield "q", number
    elif isinstance(value, tuple):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, (float, np.floating)):
        yield "d", value
    elif value is not None:
        yield "q", operator.index(value)


def pack(table: Any) -> _Packed:
    """Lay a table out in memory."""
    kinds, values = zip(*_numbers(table), strict=True)
    block = np.frombuffer(struct.pack("".join(kinds), *values), np.uint8)
    return _Packed(block.__array_interface__["data"][0], block, table)
