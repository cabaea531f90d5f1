"""Stations of a course: what is put together there is what a cubic makes of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from skyscatter.kernels.jit import entry
from skyscatter.kernels.lookup import Line
from skyscatter.kernels.stations import (
    OPEN,
    first_station,
    lay_stations,
    station_number,
    station_place,
    station_weight,
)

R = 6371e3


@entry
def put_together(line: Any, t: Any, value: Any, distance: float, places: Any, sums: Any) -> int:
    """Values at distances t put together at stations, whose distances and radii are `places`; their number."""
    stations = lay_stations(line, t[0], t[-1], distance)
    for b in range(stations.many):
        places[b, 0], places[b, 1] = station_place(stations, line, b)
    for k in range(t.size):
        x = station_number(stations, line, t[k])
        base = first_station(stations, x)
        for b in range(base, min(base + OPEN, stations.many)):
            sums[b] += value[k] * station_weight(stations, x - base, b - base)
    return stations.many


def line_of(lowest: float, start: float, end: float) -> Line:
    return Line(lowest, start, start, end, False)


@pytest.mark.parametrize(("start", "end"), [(0.0, 1.2e6), (-8e5, 9e5), (2e5, 2.8e5), (2e5, 2.4e5), (1e4, 1.2e4)])
def test_a_cubic_of_the_angle_is_summed_exactly(start: float, end: float) -> None:
    """Sum of values times a cubic at the points is that of what stands at the stations times it there.

    On a course of less than one distance it is a parabola's, on one of less than a quarter a straight line's.
    """
    lowest, distance = R + 2e3, 0.01
    t = np.sort(np.random.default_rng(1).uniform(start, end, 60))
    value = np.random.default_rng(2).normal(size=t.size)
    places, sums = np.zeros((200, 2)), np.zeros(200)
    count = put_together(line_of(lowest, start, end), t, value, distance, places, sums)
    psi, at = np.arctan2(t, lowest), np.arctan2(places[:count, 0], lowest)
    assert np.all(np.diff(at) <= distance * (1 + 1e-9))
    assert at[0] == pytest.approx(psi[0], abs=1e-12)
    assert at[-1] == pytest.approx(psi[-1], abs=1e-12)
    np.testing.assert_allclose(places[:count, 1], np.hypot(places[:count, 0], lowest), rtol=1e-12)
    assert count == (2 if psi[-1] - psi[0] < 0.25 * distance else 3 if psi[-1] - psi[0] < distance else count)
    for k in range(min(count, OPEN)):
        scale = np.abs(psi - psi[0]).max() ** k
        assert np.sum(sums[:count] * (at - psi[0]) ** k) == pytest.approx(
            np.sum(value * (psi - psi[0]) ** k), abs=1e-9 * scale * np.abs(value).sum()
        )


def test_straight_up_one_station_serves_all() -> None:
    t = R + np.linspace(0.0, 1e5, 30)
    places, sums = np.zeros((200, 2)), np.zeros(200)
    assert put_together(line_of(0.0, R, R + 1e5), t, np.ones(30), 0.01, places, sums) == 1
    assert tuple(places[0]) == (R, R)
    assert sums[0] == 30.0
