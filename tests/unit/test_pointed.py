"""Tables that kernels read through an address."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skyscatter.kernels.jit import entry, kernel
from skyscatter.kernels.pointed import Pointed, whole


class Inner(NamedTuple):
    flag: bool
    bits: np.ndarray
    words: np.ndarray


class Outer(NamedTuple):
    grid: np.ndarray
    inner: Inner
    number: float
    whole: int
    last: np.ndarray


@kernel
def first_of(inner):  # type: ignore[no-untyped-def]
    return inner.words[0]


@entry
def read(table, out):  # type: ignore[no-untyped-def]
    out[0] = table.grid[1, 2]
    out[1] = 1.0 if table.inner.flag else 0.0
    out[2] = 1.0 if table.inner.bits[1] else 0.0
    out[3] = first_of(whole(table.inner)) + first_of(table.inner)
    out[4] = table.number
    out[5] = table.whole
    out[6] = table.grid.shape[0] * 100 + table.grid.size
    row = table.grid[1]
    total = 0.0
    for k in range(row.size):
        total += row[k]
    out[7] = total
    table.last[2] = table.last[1] + 1


def test_a_pointed_table_reads_like_the_table() -> None:
    grid = np.arange(6.0).reshape(2, 3)
    bits, words = np.array([False, True]), np.array([7, 8], np.int64)
    for flag in (True, False):
        plain = Outer(grid, Inner(flag, bits, words), 2.5, -3, np.array([1, 2, 3], np.uint64))
        out, expected = np.zeros(8), np.zeros(8)
        read(plain, expected)
        assert plain.last[2] == 3
        plain.last[2] = 0
        read(Pointed(plain), out)
        np.testing.assert_array_equal(out, expected)
        np.testing.assert_array_equal(out, [5.0, float(flag), 1.0, 14.0, 2.5, -3.0, 206.0, 12.0])
        assert plain.last[2] == 3
