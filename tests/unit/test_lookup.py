"""The table of columns that the solvers read, several fields at once, and lines traced through it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bases import plain, table_columns, table_densities
from numba import njit

from skyscatter.kernels import lookup
from skyscatter.kernels.columns import exact_columns
from skyscatter.media.fields import Exponential, Gaussian, Tent, UsStandard1976
from skyscatter.media.tables import pack_rows

EARTH = 6371e3
FIELDS = (
    UsStandard1976(),
    Exponential(scale_height=1.2e3),
    Gaussian(peak=22e3, width=5e3, top=60e3),
    Tent(base=10e3, peak=25e3, top=40e3),
)


@pytest.fixture(scope="module")
def tables() -> tuple:
    fields = pack_rows([field.row() for field in FIELDS], EARTH)
    return fields, lookup.build_column_table(fields)


@njit
def _line(table, o, d):
    return lookup.trace_line(table, o[0], o[1], o[2], d[0], d[1], d[2])


@njit
def _along(table, o, d, shares, start, across, out):
    line = lookup.trace_line(table, o[0], o[1], o[2], d[0], d[1], d[2])
    lookup.start_columns(table, line, start, across)
    for i in range(shares.size):
        lookup.columns_along(table, line, line.enter + shares[i] * (line.leave - line.enter), start, across, out[i])


@njit
def _to_light(table, r, mu, work, out):
    return lookup.columns_to_light(table, r, mu, work, out)


def exact(fields, r, mu, length) -> np.ndarray:
    out = np.empty((1, len(FIELDS)))
    exact_columns(fields, np.array([float(r)]), np.array([float(mu)]), np.array([float(length)]), out)
    return out[0]


def greatest(fields) -> np.ndarray:
    """Columns of a ray that passes the densest shell horizontally, from end to end, per field."""
    return np.max([exact(fields, EARTH + h, 0.0, np.inf) for h in np.linspace(0, 50e3, 101)], axis=0) * 2


@pytest.mark.parametrize("altitude", [0.0, 2.0, 1e4, 4e5])
def test_columns_along_a_line(tables: tuple, altitude: float) -> None:
    fields, table = tables
    scale = greatest(fields)
    shares = np.array([0.0, 1e-3, 0.1, 0.5, 0.9, 1.0])
    origin = np.array([0, 0, EARTH + altitude])
    for zenith in (0, 60, 89, 90, 91, 95, 108.5, 110, 180):
        angle = math.radians(zenith)
        direction = np.array([math.sin(angle), 0, math.cos(angle)])
        line = _line(table, origin, direction)
        out = np.full((shares.size, len(FIELDS)), np.nan)
        _along(table, origin, direction, shares, np.zeros(len(FIELDS)), np.zeros(len(FIELDS)), out)
        r = math.hypot(line.p, line.enter)
        for share, got in zip(shares, out, strict=True):
            expected = exact(fields, r, line.enter / r if r > 0 else 1.0, share * (line.leave - line.enter))
            # Twice the error of an outward column (see `bases`), and a difference of two.
            assert np.all(np.abs(got - expected) <= 3e-4 * np.maximum(expected, scale)), (zenith, share)
        assert np.all(np.diff(out, axis=0) >= -3e-4 * scale), "columns only grow along a line, but for that error"


def test_line_geometry(tables: tuple) -> None:
    _, table = tables
    top = EARTH + table.top
    up = _line(table, np.array([0, 0, EARTH]), np.array([0.0, 0.0, 1.0]))
    assert (up.p, up.start, up.enter, up.leave, up.hits_ground) == (0.0, EARTH, EARTH, top, False)
    down = _line(table, np.array([0, 0, top + 1e6]), np.array([0.0, 0.0, -1.0]))
    assert (down.start, down.enter, down.leave, down.hits_ground) == (-top - 1e6, -top, -EARTH, True)
    miss = _line(table, np.array([0, 0, top + 1e6]), np.array([1.0, 0.0, 0.0]))
    assert miss.enter == miss.leave
    assert not miss.hits_ground
    away = _line(table, np.array([0, 0, top + 1e6]), np.array([0.0, 0.0, 1.0]))
    assert away.enter >= away.leave
    assert not away.hits_ground
    limb = _line(table, np.array([-1e7, 0, EARTH + 1e4]), np.array([1.0, 0.0, 0.0]))
    assert limb.p == EARTH + 1e4
    assert limb.leave == -limb.enter
    assert not limb.hits_ground


def test_columns_to_light(tables: tuple) -> None:
    fields, table = tables
    work, out = np.zeros(len(FIELDS)), np.zeros(len(FIELDS))
    scale = greatest(fields)
    for altitude in (0.0, 5e3, 5e4):
        horizon = -math.sqrt(1 - (EARTH / (EARTH + altitude)) ** 2)
        for mu in (1.0, 0.3, 0.0, 0.5 * horizon, 0.999 * horizon):
            if not (_to_light(table, EARTH + altitude, mu, work, out) or mu == horizon == 0):
                pytest.fail(f"lit at {altitude} m under {mu}")
            expected = exact(fields, EARTH + altitude, mu, np.inf)
            assert np.all(np.abs(out - expected) <= 3e-4 * np.maximum(expected, scale)), (altitude, mu)
        assert not _to_light(table, EARTH + altitude, horizon - 1e-6, work, out), "the planet is in the way"


def test_above_the_top_there_is_nothing(tables: tuple) -> None:
    _, table = tables
    out = np.full((2, len(FIELDS)), np.nan)
    h = np.array([table.top, 2 * table.top])
    table_columns(table, h, np.array([0.0, 1.0]), out)
    assert np.all(out == 0)
    table_densities(table, h, out)
    assert np.all(out == 0)


def test_breaks_are_nodes_and_altitudes_rise(tables: tuple) -> None:
    fields, table = tables
    altitudes = lookup.table_altitudes(fields)
    assert np.all(np.diff(altitudes) > 0)
    assert altitudes[0] == 0
    assert altitudes[-1] == table.top
    assert set(fields.breaks) <= set(altitudes), "a kink inside a cell would be smoothed away"


def test_more_angles_are_better(tables: tuple) -> None:
    """Interpolation is linear in the angle: half the step, a quarter of the error."""
    fields, _ = tables
    mu = np.linspace(0.003, 0.9, 1500)
    exact_out = np.empty((mu.size, len(FIELDS)))
    exact_columns(fields, np.full(mu.size, EARTH), mu, np.full(mu.size, np.inf), exact_out)
    errors = []
    for angles in (80, 160):
        out = np.empty_like(exact_out)
        table_columns(lookup.build_column_table(fields, angles=angles), np.zeros(mu.size), mu, out)
        errors.append(np.abs(out / exact_out - 1)[:, 1].max())
    # The largest error falls on slightly different places of the two grids.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def test_plain_twins(tables: tuple) -> None:
    _, table = tables
    h, mu = np.array([0.0, 12e3, 59e3]), np.array([1.0, 0.0, 0.2])
    out = np.empty((3, len(FIELDS)))
    table_columns(table, h, mu, out)
    twin = plain(lookup.outward_columns)
    for i in range(3):
        row = np.empty(len(FIELDS))
        twin(table, h[i], mu[i], row)
        np.testing.assert_allclose(row, out[i], rtol=1e-13)  # fused multiply-adds round differently
    o, d = np.array([1e3, 2e3, EARTH + 9e3]), np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(plain(lookup.trace_line)(table, *o, *d), _line(table, o, d), rtol=1e-13)
