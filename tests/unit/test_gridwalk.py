"""The walk through the grid of bounds, against cutting the line at every face."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from skyscatter.kernels.gridwalk import enter_cells, make_walker, next_cell
from skyscatter.media.shapes import GaussianSphere
from skyscatter.media.spacetables import pack_space
from skyscatter.media.voxels import VoxelGrid

LOW, CELLS = np.array([-2.0, 1.0, 0.5]), np.array([32, 20, 8])
HIGH = LOW + CELLS * 0.25


@pytest.fixture(scope="module")
def table():
    return pack_space([VoxelGrid(values=np.ones((2, 2, 2)), low=tuple(LOW), high=tuple(HIGH), interpolation="nearest")])


def walk(table, origin, direction, t=0.0):
    """Cells (n,), distances at which they are entered and left."""
    walker = make_walker()
    begin = enter_cells(table, *origin, *direction, t, walker)
    cells, ends = [], []
    for _ in range(20000):
        cell, end = next_cell(walker)
        if cell < 0:
            break
        cells.append(cell)
        ends.append(end)
    else:
        raise AssertionError("the walk does not end")
    return np.array(cells, int), np.array([begin, *ends[:-1]])[: len(ends)], np.array(ends)


def brute_force(origin, direction, t):
    """The same, from all crossings with all faces in order: the middle of every piece says which cell it is in."""
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = [((LOW[k] + 0.25 * np.arange(CELLS[k] + 1)) - origin[k]) / direction[k] for k in range(3)]
    cuts = np.unique(np.concatenate([[t], *faces]))
    cuts = cuts[np.isfinite(cuts) & (cuts >= t)]
    place = (origin + 0.5 * (cuts[1:] + cuts[:-1])[:, None] * direction - LOW) / 0.25
    # The upper face of the grid belongs to its last cells.
    cell = np.where(place == CELLS, CELLS - 1, np.floor(place)).astype(int)
    inside = ((cell >= 0) & (cell < CELLS)).all(axis=1) & (np.diff(cuts) > 1e-12)
    return np.ravel_multi_index(cell[inside].T, CELLS), cuts[:-1][inside], cuts[1:][inside]


def check(table, origin, direction, t=0.0):
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    cells, begin, end = walk(table, origin, direction, t)
    # Pieces of length zero are those that rounding leaves at the end.
    long = end - begin > 1e-12
    expected = brute_force(np.asarray(origin, float), direction, t)
    assert cells[long].tolist() == expected[0].tolist()
    np.testing.assert_allclose(begin[long], expected[1], rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(end[long], expected[2], rtol=1e-13, atol=1e-12)
    return cells.size


def test_the_grid_is_the_expected_one(table):
    np.testing.assert_array_equal(table.cells, CELLS)
    np.testing.assert_array_equal(table.bound_wrap, 0)
    np.testing.assert_allclose(table.bound_step, 0.25)


def test_random_rays_from_inside_and_outside(table):
    rng = np.random.default_rng(3)
    crossed = 0
    for _ in range(300):
        origin = rng.uniform(LOW - 4, HIGH + 4)
        target = rng.uniform(LOW, HIGH)
        direction = target - origin if rng.random() < 0.8 else rng.normal(size=3)
        crossed += check(table, origin, direction, rng.uniform(0, 2))
    assert crossed > 3000


def test_rays_along_axes_faces_edges_and_through_corners(table):
    """All directions of -1, 0 and 1, from corners, middles of faces, and middles of cells, inside and outside."""
    crossed = 0
    starts = [LOW, HIGH, LOW + 1.0, LOW + 0.125, LOW - 0.25, HIGH + 0.25]
    starts += [LOW + np.array([0.5, 0.125, 0.625]), LOW + np.array([1.0, -1.0, 0.5])]
    for direction in itertools.product((-1, 0, 1), repeat=3):
        if any(direction):
            for start in starts:
                crossed += check(table, start, direction)
    assert crossed > 500


def test_a_ray_from_afar_loses_nothing(table):
    direction = np.array([1.0, 0.3, -0.2]) / np.linalg.norm([1.0, 0.3, -0.2])
    origin = 0.5 * (LOW + HIGH) - 1e6 * direction
    cells, begin, end = walk(table, origin, direction)
    near = brute_force(0.5 * (LOW + HIGH) - 10 * direction, direction, 0.0)
    # 1e6 from the grid places are known to 1e-10, and so are the cells but for those shorter than that.
    long = end - begin > 1e-8
    assert cells[long].tolist() == near[0].tolist()
    np.testing.assert_allclose(end[long] - 1e6, near[2] - 10, atol=1e-8)


def test_rays_that_miss_or_have_passed(table):
    assert walk(table, HIGH + 1, np.array([1.0, 0, 0]))[0].size == 0
    assert walk(table, HIGH + 1, np.array([0, -1.0, 0]))[0].size == 0
    assert walk(table, 0.5 * (LOW + HIGH), np.array([0, 1.0, 0]), 100.0)[0].size == 0
    walker = make_walker()
    assert enter_cells(table, *(HIGH + 1), 1.0, 0.0, 0.0, 0.0, walker) == np.inf


def test_a_repeating_grid_is_walked_as_its_copies_would_be():
    values = np.random.default_rng(5).uniform(0.5, 2.0, (8, 4, 6))
    layer = VoxelGrid(
        values=values, low=(0, 0, 0), high=(8, 4, 3), periodic=(True, True, False), interpolation="nearest"
    )
    table = pack_space([layer])
    np.testing.assert_array_equal(table.bound_wrap, [1, 1, 0])
    rng = np.random.default_rng(6)
    for _ in range(50):
        origin, direction = rng.uniform(-30, 30, 3) * [1, 1, 0] + [0, 0, 3.5], rng.normal(size=3) * [1, 1, 0.1]
        direction[2] = -abs(direction[2]) - 0.01
        direction /= np.linalg.norm(direction)
        cells, begin, end = walk(table, origin, direction)
        assert end[-1] - begin[0] == pytest.approx(3.0 / -direction[2], rel=1e-9)
        middle = origin + 0.5 * (begin + end)[:, None] * direction
        number = np.floor(np.mod((middle - table.bound_low) / table.bound_step, np.where([1, 1, 0], table.cells, 1e9)))
        long = end - begin > 1e-9
        assert cells[long].tolist() == np.ravel_multi_index(number[long].astype(int).T, table.cells).tolist()
        density = layer.density(middle[long])
        assert np.all(density <= table.upper[cells[long], 0] * (1 + 1e-6))
        assert np.all(density >= table.lower[cells[long], 0] * (1 - 1e-6))


def test_fields_of_different_periods_share_a_grid_that_does_not_repeat():
    layer = VoxelGrid(values=np.ones((2, 2, 2)), low=(0, 0, 0), high=(1, 1, 1), periodic=(True, False, False))
    np.testing.assert_array_equal(pack_space([layer, GaussianSphere(width=0.1)]).bound_wrap, [0, 0, 0])
