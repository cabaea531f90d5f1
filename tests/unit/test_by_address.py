"""Tables that kernels read in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, kernel


@by_address
class Inner(NamedTuple):
    flag: bool
    bits: np.ndarray
    words: np.ndarray


@by_address
class Outer(NamedTuple):
    grid: np.ndarray
    nothing: None
    inner: Inner
    number: float
    whole: int
    last: np.ndarray


class Plain(NamedTuple):
    """The same fields, handed over as numbers."""

    grid: np.ndarray
    nothing: None
    inner: Inner
    number: float
    whole: int
    last: np.ndarray


@kernel
def first_of(inner, absent):  # type: ignore[no-untyped-def]
    if absent is not None:
        return absent.words[0]  # compiled only where there is something
    return inner.words[0]


@entry
def read(table, out):  # type: ignore[no-untyped-def]
    out[0] = table.grid[1, 2]
    out[1] = 1.0 if table.inner.flag else 0.0
    out[2] = 1.0 if table.inner.bits[1] else 0.0
    out[3] = first_of(table.inner, table.nothing)
    out[4] = table.number
    out[5] = table.whole
    out[6] = table.grid.shape[0] * 100 + table.grid.size
    row = table.grid[1]
    total = 0.0
    for k in range(row.size):
        total += row[k]
    out[7] = total
    table.last[2] = table.last[1] + 1


@pytest.mark.parametrize("flag", [True, False])
@pytest.mark.parametrize("order", ["C", "F", "A"])
def test_a_table_in_memory_reads_like_the_tuple(flag: bool, order: str) -> None:
    grid = np.arange(6.0).reshape(2, 3)
    grid = np.asfortranarray(grid) if order == "F" else np.repeat(grid, 2, axis=1)[:, ::2] if order == "A" else grid
    inner = Inner(flag, np.array([False, True]), np.array([7, 8], np.int64))
    for kind in (Outer, Plain):
        table = kind(grid, None, inner, 2.5, -3, np.array([1, 2, 3], np.uint64))
        out = np.zeros(8)
        read(table, out)
        np.testing.assert_array_equal(out, [5.0, float(flag), 1.0, 7.0, 2.5, -3.0, 206.0, 12.0])
        assert table.last[2] == 3


def test_a_field_that_cannot_be_laid_out_is_refused_by_name() -> None:
    table = Outer(np.zeros((2, 3)), None, Inner(True, np.zeros(2, bool), np.zeros(2, np.int64)), 1.0, 1, np.zeros(3))
    with pytest.raises(Exception, match=r"Outer.*number.*unicode"):
        read(table._replace(number="one"), np.zeros(8))


def test_a_field_that_does_not_exist_is_named() -> None:
    @entry
    def ask(table):  # type: ignore[no-untyped-def]
        return table.absent

    with pytest.raises(Exception, match="absent"):
        ask(Inner(True, np.zeros(2, bool), np.zeros(2, np.int64)))
