"""Which of its materials a mosaic has at a point: a picture of them, seen along the z axis."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined


@inlined
def tile(materials, k, x):
    """Row of the material at a point x (3,) of a surface of material k: k itself but on a mosaic.

    Materials of a mosaic follow the one that lies around it.
    """
    mosaic = materials.mosaic[k]
    if mosaic < 0:
        return k
    place, shape = materials.mosaic_place[mosaic], materials.mosaic_shape[mosaic]
    row = math.floor(0.5 * shape[1] - (x[1] - place[1]) / place[2])
    column = math.floor(0.5 * shape[2] + (x[0] - place[0]) / place[2])
    if x[2] < place[3] or row < 0 or row >= shape[1] or column < 0 or column >= shape[2]:
        return k
    return k + materials.mosaic_cells[shape[0] + int(row) * shape[2] + int(column)]
