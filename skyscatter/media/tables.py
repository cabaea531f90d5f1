"""Density fields packed into the arrays that the kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skyscatter.kernels.codes.shells import LINEAR, FieldRow
from skyscatter.kernels.columns import FieldTable


def pack_rows(rows: Sequence[FieldRow], radius: float) -> FieldTable:
    """Pack fields, each as its `row`, over a planet of `radius` [m] into a `FieldTable`."""
    counts = np.array([len(row.altitudes) for row in rows], np.int64)
    parameters = np.zeros((len(rows), 4))
    for i, row in enumerate(rows):
        parameters[i, : len(row.parameters)] = row.parameters
    altitudes = np.array([h for row in rows for h in row.altitudes], float)
    table = FieldTable(
        kind=np.array([row.kind for row in rows], np.int64),
        parameters=parameters,
        top=np.array([row.top for row in rows], float),
        start=np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
        size=counts,
        node_altitude=altitudes,
        node_density=np.array([n for row in rows for n in row.densities], float),
        node_column=np.zeros(altitudes.size),
        breaks=_breaks(rows),
        radius=float(radius),
    )
    for f, row in enumerate(rows):
        table.node_column[table.start[f] : table.start[f] + table.size[f]] = _columns_above_nodes(row)
    return table


def _columns_above_nodes(row: FieldRow) -> np.ndarray:
    """Vertical column above each node [m], the interpolant between nodes integrated in closed form."""
    if not row.altitudes:
        return np.zeros(0)
    h, n = np.asarray(row.altitudes), np.asarray(row.densities)
    if row.kind == LINEAR:
        mean = 0.5 * (n[:-1] + n[1:])
    else:
        fall = np.log(n[:-1] / n[1:])
        small = np.abs(fall) < 1e-12
        mean = n[1:] * np.where(small, 1.0, np.expm1(fall) / np.where(small, 1.0, fall))
    return np.concatenate([np.cumsum((mean * np.diff(h))[::-1])[::-1], [0.0]])


def _breaks(rows: Sequence[FieldRow]) -> np.ndarray:
    inside = {h for row in rows for h in row.breaks if h > 0}
    return np.array(sorted(inside), float)
