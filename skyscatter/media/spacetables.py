"""Fields in three dimensions packed into the arrays that the kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.workers import in_parts

if TYPE_CHECKING:
    from skyscatter.kernels.space import SpaceTable
    from skyscatter.media.space import SpatialField

Array = NDArray[np.float64]

#: Cells of the grid of bounds along the longest side of the medium.
BOUND_CELLS = 32
#: Share of a cell by which it is bounded smaller than it is, on every side: what changes in a face that it shares with
#: a grid of voxels or a box belongs to the neighbour.  Also in `kernels.tracking`.
RIM = 1e-9
#: Points at which a thread looks up densities at a time.
PART = 8192


def pack_space(fields: Sequence[SpatialField], bound_cells: int = BOUND_CELLS) -> SpaceTable:
    """Pack fields, one for each component, into a `SpaceTable`; bounds on so many cells along the longest side."""
    from skyscatter.kernels.space import SpaceTable

    groups = [field.terms() for field in fields]
    terms = [term for group in groups for term in group]
    rows = [step for term in terms for step in term.program]
    parameters, data, index, code = [], [], [], []
    at, at_data, at_index = 0, 0, 0
    places: dict[int, int] = {}
    for step in rows:
        affine = np.zeros(0) if step.affine is None else np.asarray(step.affine, float).ravel()
        block = np.concatenate([affine, np.asarray(step.parameters, float)])
        if step.data is not None and id(step.data) not in places:
            # A grid that stands in several terms is packed once.
            places[id(step.data)] = at_data
            data.append(np.asarray(step.data, np.float32).ravel())
            at_data += data[-1].size
        # A grid's place among the data is the first of its integers.
        numbers = np.array([*([] if step.data is None else [places[id(step.data)]]), *step.index], np.int64)
        code.append((step.operation, at, at_index))
        parameters.append(block)
        index.append(numbers)
        at, at_index = at + block.size, at_index + numbers.size
    boxes = np.array([term.box for term in terms], float).reshape(-1, 2, 3)
    bounded = [field for field, group in zip(fields, groups, strict=True) if group]
    low, high = boxes[:, 0].min(axis=0, initial=np.inf), boxes[:, 1].max(axis=0, initial=-np.inf)
    if not bounded:
        low, high = np.zeros(3), np.ones(3)
    bound_low, bound_high, wrap = bounded_region(bounded, low, high)
    cells, upper, lower = bound_grid(fields, bound_low, bound_high, bound_cells)
    # What has no term is not the table's business: its density is kept elsewhere, by who packs it.
    endless = np.array([not group for group in groups], bool)
    upper[:, endless], lower[:, endless] = 0.0, 0.0
    return SpaceTable(
        term_start=np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(np.int64),
        code_start=np.concatenate([[0], np.cumsum([len(term.program) for term in terms])]).astype(np.int64),
        method=np.array([term.method for term in terms], np.int64),
        factor=np.array([term.factor for term in terms], float),
        box=boxes,
        scale=np.array([term.scale for term in terms], float),
        code=np.array(code, np.int64).reshape(-1, 3),
        parameters=np.concatenate([*parameters, np.zeros(1)]),
        data=np.concatenate([*data, np.zeros(1, np.float32)]),
        index=np.concatenate([*index, np.zeros(1, np.int64)]),
        low=low,
        high=high,
        cells=cells,
        upper=upper,
        lower=lower,
        bound_low=bound_low,
        bound_step=(bound_high - bound_low) / cells,
        bound_wrap=wrap,
    )


def bounded_region(fields: Sequence[SpatialField], low: Array, high: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Corners of the grid of bounds, and along which axes it repeats: there it covers one period of all fields."""
    if not fields:
        return low, high, np.zeros(3, np.int64)
    periods = np.array([field.periods for field in fields])
    wrap = (periods[0] > 0) & (periods == periods[0]).all(axis=0)
    low = np.where(wrap, 0.5 * (low + high) - 0.5 * periods[0], low)
    return low, np.where(wrap, low + periods[0], high), wrap.astype(np.int64)


def bound_grid(
    fields: Sequence[SpatialField], low: Array, high: Array, bound_cells: int = BOUND_CELLS
) -> tuple[Array, Array, Array]:
    """Cells along each axis, and bounds (cell, component) of every field within each cell."""
    size = high - low
    cells = np.maximum(np.ceil(bound_cells * size / size.max() - 1e-9), 1).astype(np.int64)
    if not fields:
        return cells, np.zeros((int(cells.prod()), 0)), np.zeros((int(cells.prod()), 0))
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    step = size / cells
    pairs = [field.extremes(low + (corners + RIM) * step, low + (corners + 1 - RIM) * step) for field in fields]
    return cells, np.stack([p[1] for p in pairs], axis=1), np.stack([p[0] for p in pairs], axis=1)


@lru_cache(maxsize=32)
def medium_table(fields: tuple[SpatialField, ...]) -> SpaceTable:
    """`pack_space` for solvers, kept between calls."""
    return pack_space(fields)


@lru_cache(maxsize=32)
def field_table(fields: tuple[SpatialField, ...]) -> SpaceTable:
    """`pack_space` without a grid of bounds, which densities and columns do not need; kept between calls."""
    return pack_space(fields, bound_cells=1)


def field_densities(field: SpatialField, points: Array) -> Array:
    """Densities of one field at points (..., 3)."""
    from skyscatter.kernels.space import fill_densities, make_space_work

    table = field_table((field,))
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    out = np.empty((len(flat), 1))
    in_parts(lambda part: fill_densities(table, flat[part], make_space_work(), out[part]), len(flat), PART)
    return out[:, 0].reshape(points.shape[:-1])


def field_columns(field: SpatialField, start: Array, end: Array) -> Array:
    """Columns of one field between points (..., 3)."""
    from skyscatter.kernels.space import fill_columns, make_space_work

    table = field_table((field,))
    start, end = np.broadcast_arrays(start, end)
    shape = start.shape[:-1]
    a, b = np.array(start.reshape(-1, 3), order="C"), np.array(end.reshape(-1, 3), order="C")
    out = np.zeros((len(a), 1))
    in_parts(lambda part: fill_columns(table, a[part], b[part], make_space_work(), out[part]), len(a), PART // 8)
    return out[:, 0].reshape(shape)
