"""Which of its materials a mosaic has at a point: a picture of them, seen along the z axis."""

from __future__ import annotations

from skyscatter.kernels.jit import entry, inlined
from skyscatter.kernels.optics import cell_below


@inlined
def tile(materials, k, x):
    """Row of the material at a point x (3,) of a surface of material k: k itself but on a mosaic.

    Materials of a mosaic follow the one that lies around it.
    """
    mosaic = materials.mosaic[k]
    if mosaic < 0:
        return k
    place, shape = materials.mosaic_place[mosaic], materials.mosaic_shape[mosaic]
    cell = cell_below(shape[1], shape[2], place[2], x[0] - place[0], x[1] - place[1])
    return k + materials.mosaic_cells[shape[0] + cell] if cell >= 0 and x[2] >= place[3] else k


@entry
def tiles(materials, rows, points, out):
    """`tile` of many points (n, 3) of materials of some rows (n,), into `out` (n,)."""
    for n in range(rows.size):
        out[n] = tile(materials, rows[n], points[n])
