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
from typing import Any, NamedTuple, TypeVar

import numpy as np

#: Bytes of a word.
WORD = 8

#: The marked classes.
MARKED: set[type] = set()

T = TypeVar("T", bound=type)


def by_address(cls: T) -> T:
    """Mark a class of named tuples: compiled code reads it in memory.

    Kernels may take it and read its fields, and not make one.
    """
    MARKED.add(cls)
    known = sys.modules.get("skyscatter.kernels.tables")
    if known is not None:
        known.register(cls)
    return cls


class _Packed(NamedTuple):
    """A table that lies in memory; it lives as long as this."""

    address: int
    block: np.ndarray
    table: Any  #: whose arrays are meant


class Words:
    """Values laid out one after the other: their kinds as text, how `struct` writes each word, and the words."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.form: list[str] = []
        self.numbers: list[Any] = []

    def add(self, value: Any) -> None:
        """Lay out one value; TypeError where that is not known how."""
        if isinstance(value, np.ndarray):
            self._add_array(value)
        elif isinstance(value, tuple):
            cls = type(value)
            self.kinds.append("(" if cls is tuple else f"{cls.__module__}.{cls.__qualname__}(")
            for item in value:
                self.add(item)
            self.kinds.append(")")
        elif value is None:
            self.kinds.append("n")
        else:
            self._add_number(value)

    def _add_array(self, array: np.ndarray) -> None:
        flags = array.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        locked = "" if flags.writeable else "r"
        self.kinds.append(f"{array.dtype.str}{layout}{array.ndim}{locked}{'' if flags.aligned else 'u'}")
        self.form.append(f"Q{1 + 2 * array.ndim}q")
        self.numbers += (array.__array_interface__["data"][0], array.size, *array.shape, *array.strides)

    def _add_number(self, value: Any) -> None:
        if isinstance(value, (float, np.floating)):
            kind, form = "f4" if isinstance(value, np.float32) else "f8", "d"
        elif isinstance(value, (bool, np.bool_)):
            kind, form, value = "b", "q", int(value)
        else:
            kind, form = value.dtype.str[1:] if isinstance(value, np.integer) else "i8", "q"
            value = operator.index(value)
            if not -(2**63) <= value < 2**63:
                kind, form = "u8", "Q"
        self.kinds.append(kind)
        self.form.append(form)
        self.numbers.append(value)

    def packed(self) -> bytes:
        """The words in memory."""
        return struct.pack("".join(self.form), *self.numbers)


def pack(table: Any) -> _Packed:
    """Lay a table out in memory."""
    words = Words()
    words.add(tuple(table))
    block = np.frombuffer(words.packed(), np.uint8)
    return _Packed(block.__array_interface__["data"][0], block, table)


def lay_out(arguments: tuple[Any, ...]) -> tuple[str, bytes] | None:
    """Kinds and words of the arguments of a call; None where one is nothing that has words."""
    words = Words()
    try:
        for argument in arguments:
            words.add(argument)
        return " ".join(words.kinds), words.packed()
    except (TypeError, struct.error):
        return None
