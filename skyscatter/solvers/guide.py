"""Columns towards the lights of a nebula on a coarse grid: by them walks know where to look for light.

The grid is finer around a star, for a hole around it may be small (`kernels.volume.guide_place`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from skyscatter.kernels.volume import VolumeTable

Array = NDArray[np.float64]

#: Nodes of the guide along the longest side of the medium.
GUIDE_NODES = 33
#: Its cells along the shortest: across a wide slab light changes as much as it does anywhere.
LEAST_CELLS = 16


def make_guide(table: VolumeTable) -> tuple[Array, Array]:
    """Mean densities towards every light (columns to distant ones) on a grid over the medium, and where that crowds."""
    from skyscatter.kernels.volume import fill_guide, make_volume_work

    # Where the medium repeats, over one period.
    low, size = table.space.bound_low, table.space.bound_step * table.space.cells
    cells = np.maximum(np.rint((GUIDE_NODES - 1) * size / size.max()).astype(int), LEAST_CELLS)
    place = (table.place - low) / size
    inside = ~table.distant & np.all((place > 0) & (place < 1), axis=1)
    crowds = inside[:, None] & (table.space.bound_wrap == 0)
    node = np.rint(place * cells)
    middle = np.where(node == 0, 0.0, np.where(node == cells, 1.0, place))
    focus = np.where(crowds[:, :, None], np.stack([middle, node], axis=-1), -1.0)
    points = np.array([_guide_nodes(low, size, cells, one) for one in focus])
    points = points.reshape(len(focus), int(np.prod(cells + 1)), 3)  # also where there is no light
    components, wavelengths = table.sigma_s.shape
    out = np.zeros((*points.shape[:2], components))
    fill_guide(table, points, make_volume_work(components, wavelengths), out)
    return out.reshape(len(focus), *(cells + 1), components), focus


def _guide_nodes(low: Array, size: Array, cells: NDArray[np.int64], focus: Array) -> Array:
    """Nodes (n, 3) of a light's guide, the inverse of `kernels.volume.guide_place`."""
    axes = []
    for k, (middle, node) in enumerate(focus):
        n = np.arange(cells[k] + 1)
        if node < 0:
            share = n / cells[k]
        else:
            below = middle - middle * (np.maximum(node - n, 0) / max(node, 1)) ** 2
            share = below + (1 - middle) * (np.maximum(n - node, 0) / max(cells[k] - node, 1)) ** 2
        axes.append(low[k] + size[k] * share)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def guided_columns(table: VolumeTable, points: Array) -> Array:
    """Columns [m] towards every light by the guide at points (..., 3), shape (light, ..., component)."""
    from skyscatter.kernels.volume import read_guide

    out = np.zeros((len(table.power), points.size // 3, len(table.sigma_t)))
    read_guide(table, np.ascontiguousarray(points.reshape(-1, 3)), out)
    return out.reshape(len(table.power), *points.shape[:-1], len(table.sigma_t))
