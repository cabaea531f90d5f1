"""Sums of rows as vector code: the numbers of numpy, bit for bit, whatever their length and place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from skyscatter.kernels import rows
from skyscatter.kernels.jit import entry

F = np.float32


@entry
def product(out: Any, to: int, one: Any, at_one: int, two: Any, at_two: int, count: int) -> None:
    rows.add_product(out, to, one, at_one, two, at_two, count)


@entry
def scaled(out: Any, to: int, factor: Any, row: Any, at: int, count: int, adds: bool) -> None:
    if adds:
        rows.add_scaled(out, to, factor, row, at, count)
    else:
        rows.set_scaled(out, to, factor, row, at, count)


@entry
def four(out: Any, to: int, v: Any, row: Any, at: int, step: int, count: int) -> None:
    rows.add_sum_of_four(out, to, v[0], v[1], v[2], v[3], row, at, step, count)


@entry
def exponentials(out: Any, to: int, v: Any, row: Any, at: int, step: int, count: int) -> None:
    rows.set_exponentials(out, to, v[0], v[1], v[2], v[3], row, at, step, count)


@entry
def many(out: Any, to: int, factors: Any, first: int, terms: int, row: Any, at: int, step: int, count: int) -> None:
    rows.add_rows(out, to, factors, first, terms, row, at, step, count)


@entry
def products(out: Any, to: int, numbers: Any, first: int, terms: int, one: Any, two: Any, at: int, count: int) -> None:
    rows.add_products(out, to, numbers, first, terms, one, two, at, count)


@entry
def products_of_four(
    out: Any, to: int, to_step: int, numbers: Any, terms: int, one: Any, two: Any, at: int, step: int, count: int
) -> None:
    rows.add_products_to_four(out, to, to_step, numbers, 0, terms, one, two, at, step, count)


@entry
def turned(
    out: Any, to: int, v: Any, row: Any, at: int, step: int, part: int, factors: Any, factor_step: int, terms: int,
    count: int,
) -> None:  # fmt: skip
    rows.add_turns_of_four(out, to, v[0], v[1], v[2], v[3], row, at, step, part, factors, 1, factor_step, terms, count)


@entry
def turns(out: Any, azimuth: Any, at: int, count: int, room: int, orders: int) -> None:
    rows.set_turns(out, azimuth, at, azimuth.shape[1] + at, count, room, orders)


@entry
def cleared(out: Any, to: int, count: int) -> None:
    rows.clear(out, to, count)


def random(*shape: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).normal(size=shape).astype(F)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 16, 23, 32, 41])
def test_rows_are_summed_as_numpy_does(count: int) -> None:
    start, to, at = random(200), 5, 11
    there = slice(to, to + count)
    one, two, table = random(300, seed=1), random(20, 15, seed=2), random(30, count, seed=3)

    def check(expected: Any, function: Any, *given: Any) -> None:
        out = start.copy()
        function(out, to, *given)
        np.testing.assert_array_equal(out[there], expected)
        np.testing.assert_array_equal(
            np.delete(out, np.arange(to, to + count)), np.delete(start, np.arange(to, to + count))
        )

    flat = two.ravel()
    check(start[there] + one[at : at + count] * flat[3 : 3 + count], product, one, at, two, 3, count)
    check(start[there] + F(0.3) * flat[3 : 3 + count], scaled, F(0.3), two, 3, count, True)
    check(F(0.3) * flat[3 : 3 + count], scaled, F(0.3), two, 3, count, False)
    v = random(4, seed=4)
    terms = [v[k] * one[at + 50 * k : at + 50 * k + count] for k in range(4)]
    total = (terms[0] + terms[1]) + (terms[2] + terms[3])
    check(start[there] + total, four, v, one, at, 50, count)
    expected = start[there].copy()
    for k in range(6):
        expected = expected + v[k % 4] * one[at + 45 * k : at + 45 * k + count]
    check(expected, many, np.tile(v, 3), 4, 6, one, at, 45, count)
    numbers = np.array([9, 9, 3, 0, 7], np.int64)
    expected = start[there].copy()
    for k in numbers[2:]:
        expected = expected + table[k] * random(30 * count + 2, seed=5)[2 + k * count : 2 + (k + 1) * count]
    check(expected, products, numbers, 2, 3, table, random(30 * count + 2, seed=5), 2, count)
    check(np.zeros(count, F), cleared, count)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 13, 16, 24])
def test_products_of_four_rows_are_those_of_each(count: int) -> None:
    numbers, one, two = np.array([3, 0, 7], np.int64), random(8 * count + 1, seed=1), random(4 * 250, seed=2)
    together = random(4 * 30, seed=3)
    alone = together.copy()
    products_of_four(together, 1, 30, numbers, 3, one, two, 2, 250, count)
    for k in range(4):
        products(alone, 1 + 30 * k, numbers, 0, 3, one, two, 2 + 250 * k, count)
    np.testing.assert_array_equal(together, alone)
    assert count == 0 or np.any(together != random(4 * 30, seed=3))


@pytest.mark.parametrize("count", [0, 1, 7, 8, 13, 16, 24])
def test_fourier_parts_of_four_rows_are_added_up_at_an_azimuth(count: int) -> None:
    v, row, factors, out = random(4, seed=1), random(4 * 200, seed=2), random(40, seed=3), random(30, seed=4)
    expected = out.copy()
    for m in range(5):
        terms = [v[k] * row[2 + 200 * k + 30 * m :][:count] for k in range(4)]
        expected[3 : 3 + count] += factors[1 + 7 * m] * ((terms[0] + terms[1]) + (terms[2] + terms[3]))
    turned(out, 3, v, row, 2, 200, 30, factors, 7, 5, count)
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("count", [1, 7, 8, 13, 16])
def test_multiples_of_azimuths(count: int) -> None:
    phi = np.random.default_rng(1).uniform(-np.pi, np.pi, 20)
    out, azimuth = np.full((19, 2, 16), 9.0, F), np.stack([np.cos(phi), np.sin(phi)]).astype(F)
    turns(out, azimuth, 4, count, 16, 18)
    m = np.arange(18)[:, None]
    expected = np.stack([np.cos(m * phi[4 : 4 + count]), np.sin(m * phi[4 : 4 + count])], axis=1)
    # Single precision of the azimuth itself, 6e-8, grows with its multiple.
    np.testing.assert_allclose(out[:18, :, :count], expected, atol=3e-6)
    assert np.all(out[18:] == 9.0)
    assert np.all(out[:, :, count:] == 9.0)


@pytest.mark.parametrize("count", [1, 8, 13])
def test_exponentials_are_those_of_numpy_and_stay_between_their_four(count: int) -> None:
    row, out = (40.0 * random(4 * 50, seed=1)).clip(-85, 80), np.zeros(60, F)
    four_rows = row.reshape(4, 50)[:, 3 : 3 + count]
    for v in (np.array([0.1, 0.2, 0.3, 0.4], F), np.array([-3.0, 5.0, -2.0, 1.0], F)):
        exponentials(out, 2, v, row, 3, 50, count)
        # Single precision of a sum of some tens is 4e-6 of it, and so is what is made of it, relatively.
        expected = np.exp(np.clip(v.astype(float) @ four_rows, four_rows.min(axis=0), four_rows.max(axis=0)))
        np.testing.assert_allclose(out[2 : 2 + count], expected, rtol=4e-5 if v[0] < 0 else 1.2e-5)
    np.testing.assert_array_equal(np.delete(out, np.arange(2, 2 + count)), 0.0)


def test_an_exponential_of_what_is_dark_is_as_good_as_zero() -> None:
    out = np.zeros(9, F)
    exponentials(out, 0, np.array([1.0, 0.0, 0.0, 0.0], F), np.full(36, -500.0, F), 0, 9, 9)
    assert np.all((out >= 0) & (out < 1e-36))
