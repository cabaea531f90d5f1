"""Voxel grids: values and columns against independent interpolation and quadrature, convergence, files, bounds."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from field_bounds import assert_bounds_hold
from pydantic import ValidationError
from scipy.interpolate import RegularGridInterpolator

from skyscatter import NebulaModel, PointStar, View, load_model
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.media.arrays import FrozenArray
from skyscatter.media.medium import Component
from skyscatter.media.shapes import GaussianSphere
from skyscatter.media.spacetables import pack_space
from skyscatter.media.voxels import VoxelGrid
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Isotropic

SHAPE, LOW, HIGH = (5, 6, 7), np.array([-1.0, 2.0, 0.0]), np.array([4.0, 5.0, 10.5])
VALUES = np.random.default_rng(11).uniform(0.1, 1.0, SHAPE).astype(np.float32).astype(float)
KINDS = [
    {},
    {"edge": "sharp"},
    {"interpolation": "nearest"},
    {"periodic": (True, False, True)},
    {"periodic": (False, True, False), "edge": "sharp"},
    {"periodic": (True, True, False), "interpolation": "nearest"},
]


def grid(**options):
    return VoxelGrid(values=VALUES, low=tuple(LOW), high=tuple(HIGH), **options)


def expected(points, interpolation="linear", edge="falling", periodic=(False, False, False)):
    """The density by scipy's interpolator over a copy of the grid that is large enough."""
    pad = [3 * n if repeats else 1 for n, repeats in zip(SHAPE, periodic, strict=True)]
    values = VALUES
    for k in range(3):
        width = [(0, 0)] * 3
        width[k] = (pad[k], pad[k])
        linear = "edge" if edge == "sharp" and interpolation == "linear" else "constant"
        values = np.pad(values, width, mode="wrap" if periodic[k] else linear)
    cell = (HIGH - LOW) / SHAPE
    axes = [LOW[k] + (np.arange(values.shape[k]) - pad[k] + 0.5) * cell[k] for k in range(3)]
    result = RegularGridInterpolator(axes, values, method=interpolation, bounds_error=False, fill_value=0.0)(points)
    if edge == "sharp" or interpolation == "nearest":
        inside = [(points[:, k] >= LOW[k]) & (points[:, k] <= HIGH[k]) | periodic[k] for k in range(3)]
        result = np.where(np.all(inside, axis=0), result, 0.0)
    return result


def cuts(start, end):
    """Fractions of a segment at which the density may have a kink: every half cell, within three periods."""
    cell = (HIGH - LOW) / SHAPE
    planes = [LOW[k] + 0.5 * cell[k] * np.arange(-6 * SHAPE[k], 8 * SHAPE[k] + 1) for k in range(3)]
    every = np.concatenate([(planes[k] - start[k]) / (end[k] - start[k]) for k in range(3)])
    return np.unique(np.concatenate([[0.0, 1.0], every[(every > 0) & (every < 1)]]))


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_values_are_those_of_an_independent_interpolator(options):
    points = np.random.default_rng(1).uniform(LOW - 4, HIGH + 4, (4000, 3))
    np.testing.assert_allclose(grid(**options).density(points), expected(points, **options), rtol=0, atol=3e-7)


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_columns_are_exact(options):
    """Against Gauss-Legendre with 2 points, exact for a cubic, on every piece between possible kinks."""
    rng = np.random.default_rng(2)
    field = grid(**options)
    node, weight = np.polynomial.legendre.leggauss(2)
    for _ in range(40):
        start, end = rng.uniform(LOW - 4, HIGH + 4, (2, 3))
        at = cuts(start, end)
        s = 0.5 * (at[1:] + at[:-1])[:, None] + 0.5 * np.diff(at)[:, None] * node
        density = expected(start + s.reshape(-1, 1) * (end - start), **options).reshape(s.shape)
        column = np.linalg.norm(end - start) * np.sum(0.5 * np.diff(at) * (density @ weight))
        # The kernels' values are in single precision, 6e-8 of the largest.
        assert field.column(start, end) == pytest.approx(column, rel=2e-7, abs=1e-7)


def test_columns_along_axes_and_faces():
    field = grid(interpolation="nearest")
    cell = (HIGH - LOW) / SHAPE
    for i, j in np.ndindex(SHAPE[0], SHAPE[1]):
        middle = LOW[:2] + (np.array([i, j]) + 0.5) * cell[:2]
        column = field.column([*middle, LOW[2] - 1], [*middle, HIGH[2] + 1])
        assert column == pytest.approx(VALUES[i, j].sum() * cell[2], rel=2e-7)
        # In the face towards the lower neighbours: the cell above it.
        edge = LOW[:2] + np.array([i, j]) * cell[:2]
        assert field.column([*edge, HIGH[2] + 1], [*edge, LOW[2] - 1]) == pytest.approx(column, rel=1e-12)
    # The upper face belongs to the last cells; beside the grid there is nothing.
    top = field.column([HIGH[0], HIGH[1], LOW[2]], [HIGH[0], HIGH[1], HIGH[2]])
    assert top == pytest.approx(VALUES[-1, -1].sum() * cell[2], rel=2e-7)
    assert field.column([HIGH[0] + 1e-9, 3, 0], [HIGH[0] + 1e-9, 3, 10]) == 0.0
    linear = grid(edge="sharp")
    on_node = linear.column([*(LOW[:2] + 0.5 * cell[:2]), -5], [*(LOW[:2] + 0.5 * cell[:2]), 50])
    assert on_node == pytest.approx(VALUES[0, 0].sum() * cell[2], rel=2e-7)


def test_a_column_is_the_sum_of_its_parts_and_the_same_backwards():
    field, rng = grid(), np.random.default_rng(4)
    a, b = rng.uniform(LOW - 2, HIGH + 2, (2, 200, 3))
    middle = a + rng.uniform(0, 1, (200, 1)) * (b - a)
    np.testing.assert_allclose(field.column(a, middle) + field.column(middle, b), field.column(a, b), rtol=1e-12)
    np.testing.assert_allclose(field.column(b, a), field.column(a, b), rtol=1e-12)
    direction = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    near, far = field.column(a - 20 * direction, b), field.column(a - 1e8 * direction, b)
    np.testing.assert_allclose(far, near, rtol=0, atol=1e-7)


@pytest.mark.parametrize("options", KINDS[:3], ids=str)
def test_the_integral_is_the_sum_of_the_cells(options):
    """Columns along z through a lattice, exact for a piecewise linear density by the midpoint rule on half cells."""
    field, cell = grid(**options), (HIGH - LOW) / SHAPE
    x = LOW[0] + cell[0] * (np.arange(-2, 2 * SHAPE[0] + 2) + 0.5) / 2
    y = LOW[1] + cell[1] * (np.arange(-2, 2 * SHAPE[1] + 2) + 0.5) / 2
    start = np.stack(np.meshgrid(x, y, [LOW[2] - 9], indexing="ij"), axis=-1)
    columns = field.column(start, start + np.array([0, 0, 40]))
    assert columns.sum() * cell[0] * cell[1] / 4 == pytest.approx(VALUES.sum() * cell.prod(), rel=2e-7)


def test_a_voxelised_gaussian_converges_at_second_order():
    original, rng = GaussianSphere(width=1.0), np.random.default_rng(7)
    points, directions = rng.uniform(-2, 2, (4000, 3)), rng.normal(size=(4000, 3))
    directions *= 20 / np.linalg.norm(directions, axis=1)[:, None]
    errors = []
    for cells in (24, 48, 96):
        voxels = VoxelGrid.from_field(original, cells, low=[-5] * 3, high=[5] * 3)
        value = voxels.density(points) - original.density(points)
        column = voxels.column(points - directions, points + directions)
        column -= original.column(points - directions, points + directions)
        errors.append([np.sqrt(np.mean(value**2)), np.sqrt(np.mean(column**2))])
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, 2.0, atol=0.1)


def test_a_repeating_grid_repeats():
    rng = np.random.default_rng(8)
    field = grid(periodic=(True, True, False))
    a, b = rng.uniform(LOW, HIGH, (2, 100, 3))
    shift = rng.integers(-900, 900, (100, 3)) * (HIGH - LOW) * [1, 1, 0]
    np.testing.assert_allclose(field.density(a + shift), field.density(a), rtol=0, atol=1e-8)
    np.testing.assert_allclose(field.column(a + shift, b + shift), field.column(a, b), rtol=1e-8)
    period = HIGH[0] - LOW[0]
    one = field.column(a, a + np.array([period, 0, 0]))
    np.testing.assert_allclose(field.column(a, a + np.array([50 * period, 0, 0])), 50 * one, rtol=1e-9)
    assert field.bounds[0][0] < -1e4 * period < 1e4 * period < field.bounds[1][0]
    assert field.bounds[1][2] == pytest.approx(HIGH[2] + 0.75)


@pytest.mark.parametrize("options", KINDS, ids=str)
@pytest.mark.parametrize("size", [0.4, 3.0, 30.0])
def test_extremes_contain_all_values(options, size):
    rng, field = np.random.default_rng(9), grid(**options)
    low = rng.uniform(LOW - 3, HIGH + 2, (300, 3))
    high = low + rng.uniform(0, size, (300, 3))
    lowest, highest = field.extremes(low, high)
    inside = low + rng.uniform(0, 1, (500, 300, 3)) * (high - low)
    density = field.density(inside)
    assert np.all(density >= lowest * (1 - 1e-6))
    assert np.all(density <= highest * (1 + 1e-6))
    assert np.all(highest <= VALUES.max() * (1 + 1e-6))
    if size == 0.4 and options.get("interpolation") == "nearest":
        # Small boxes: the bounds are reached, not only held.
        np.testing.assert_allclose(highest.mean(), density.max(axis=0).mean(), rtol=0.02)


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_bounds_hold_on_faces_nodes_and_edges(options):
    cell = (HIGH - LOW) / SHAPE
    half = np.arange(-2, 2 * max(SHAPE) + 3) / 2
    assert_bounds_hold(grid(**options), special=LOW[:, None] + cell[:, None] * half)


def test_extremes_of_large_grids_are_quick_and_hold():
    """The blocks of many cells, against the numbers themselves; and the time that the grid of bounds takes."""
    values = np.random.default_rng(10).random((100, 130, 70), dtype=np.float32)
    field = VoxelGrid(values=values, spacing=1.0, position=(50, 65, 35), interpolation="nearest")
    rng = np.random.default_rng(12)
    low = rng.integers(0, 30, (100, 3))
    high = low + rng.integers(1, 40, (100, 3))
    # A box that ends in a face holds the cells behind it too.
    lowest, highest = field.extremes(low + 1e-9, high - 1e-9)
    for a, b, least, most in zip(low, high, lowest, highest, strict=True):
        block = values[a[0] : b[0], a[1] : b[1], a[2] : b[2]]
        assert least <= block.min() * (1 + 1e-6)
        assert most >= block.max() * (1 - 1e-6)
        if (b - a).max() <= 16:
            assert (least, most) == pytest.approx((block.min(), block.max()), rel=1e-6)
    big = VoxelGrid(values=FrozenArray(np.ones((256, 256, 256), np.float32)), spacing=1.0)
    corners = np.stack(np.meshgrid(*3 * [np.arange(32) * 8.0 - 128], indexing="ij"), axis=-1).reshape(-1, 3)
    _ = big.nodes
    begin = time.thread_time()
    big.extremes(corners, corners + 8)
    assert time.thread_time() - begin < 1.0


def test_a_grid_that_stands_in_two_terms_is_packed_once():
    field = grid()
    assert pack_space([field, field]).data.size == pack_space([field]).data.size


def test_files(tmp_path):
    from astropy.io import fits

    np.save(tmp_path / "a.npy", VALUES)
    np.savez(tmp_path / "a.npz", other=np.zeros(3), values=VALUES)
    fits.PrimaryHDU(VALUES.T).writeto(tmp_path / "a.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(VALUES.T.astype(">f4"))]).writeto(tmp_path / "b.fits")
    points = np.random.default_rng(1).uniform(LOW, HIGH, (100, 3))
    for name in ("a.npy", "a.npz", "a.fits", "b.fits"):
        field = VoxelGrid(file=str(tmp_path / name), low=tuple(LOW), high=tuple(HIGH), factor=3.0)
        np.testing.assert_allclose(field.density(points), 3 * grid().density(points), rtol=1e-6, err_msg=name)
        assert VoxelGrid.model_validate_json(field.model_dump_json()) == field
    with pytest.raises(MissingDataError, match=r"missing\.npy.*check the path"):
        VoxelGrid(file=str(tmp_path / "missing.npy"), spacing=1.0).density([0, 0, 0])
    (tmp_path / "text.fits").write_text("no picture")
    with pytest.raises(MissingDataError, match="neither"):
        VoxelGrid(file=str(tmp_path / "text.fits"), spacing=1.0).density([0, 0, 0])


def test_records_compare_by_content_and_are_written_back():
    one, same, other = grid(), grid(), VoxelGrid(values=VALUES + 1, low=tuple(LOW), high=tuple(HIGH))
    assert one == same
    assert hash(one) == hash(same)
    assert one != other
    assert VoxelGrid.model_validate_json(one.model_dump_json()) == one
    large = VoxelGrid(values=np.ones((40, 40, 40)), spacing="1 pc")
    assert "array of 40x40x40 numbers" in large.model_dump_json()
    with pytest.raises(ValueError, match="read-only"):
        one.cube[0, 0, 0] = 2.0
    middle = VoxelGrid(values=VALUES, spacing=(1.0, 0.5, 1.5), position=(1.5, 3.5, 5.25))
    np.testing.assert_allclose(middle.corners, [LOW, HIGH])
    assert one.reference_column() == pytest.approx(one.column([1.5, 3.5, -99], [1.5, 3.5, 99]), rel=1e-12)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"values": VALUES}, "spacing = None: give either"),
        ({"values": VALUES, "file": "a.npy", "spacing": 1.0}, "give values or file"),
        ({"spacing": 1.0}, "give values or file"),
        ({"values": -VALUES, "spacing": 1.0}, "never negative"),
        ({"values": VALUES[0], "spacing": 1.0}, "needs three axes"),
        ({"values": VALUES * np.inf, "spacing": 1.0}, "finite"),
        ({"values": "cube.npy", "spacing": 1.0}, "the field `file`"),
        ({"values": VALUES, "low": (0, 0, 0), "high": (1, 1, 0)}, "must lie above"),
        ({"values": VALUES, "low": (0, 0, 0), "high": (1, 1, 1), "position": (1, 1, 1)}, "goes with spacing"),
        ({"values": VALUES, "spacing": -1.0}, "positive length"),
        ({"values": VALUES, "spacing": 1.0, "factor": 0.0}, "must be above 0"),
    ],
)
def test_bad_input_is_told_in_one_line(options, text):
    with pytest.raises(ValidationError, match=text):
        VoxelGrid(**options)


def test_a_grid_without_anything_is_nought():
    empty = VoxelGrid(values=np.zeros((2, 2, 2)), spacing=1.0)
    assert empty.column([-5, 0, 0], [5, 0, 0]) == 0.0
    assert empty.density([0, 0, 0]) == 0.0


def test_a_model_with_numbers_that_no_file_holds_is_not_saved(tmp_path: Path) -> None:
    """What would not load again is refused, and the file that was there stays."""
    star = PointStar(temperature=5000, luminosity=1)

    def model(cells: int) -> NebulaModel:
        grid = VoxelGrid(values=np.ones((cells,) * 3), spacing=1.0)
        dust = Component(name="dust", density=grid, optics=Particles(extinction=1.0, phase=Isotropic()))
        return NebulaModel(name="m", components=(dust,), stars=(star,), view=View())

    path = tmp_path / "m.toml"
    model(4).save(path)
    assert load_model(path) == model(4)
    with pytest.raises(DomainError, match=r"values.*17x17x17.*name that in the field `file`"):
        model(17).save(path)
    assert load_model(path) == model(4)
