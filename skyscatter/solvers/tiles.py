"""How the rays of a picture are cut into tiles, whoever solves them and wherever they are kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Rays in a tile at most: enough to hide the cost of handing it out, few enough for Ctrl-C and progress.
TILE_RAYS = 128
#: Tiles of a picture at least, as far as there are rays; whatever runs them, so that a store fits every run.
TILES = 64
#: Tiles of a picture at most; a tile of a larger one has more rays, where these are independent.
MOST_TILES = 16384
#: The golden section: its multiples spread evenly, however many.
GOLDEN = 0.6180339887498949


def spread(tiles: int) -> NDArray[np.intp]:
    """An order in which tiles are spread over the picture from the first on."""
    return np.argsort(np.arange(tiles) * GOLDEN % 1, kind="stable")


def tiles_of(module: Any, rays: int) -> list[slice]:
    """The tiles of a picture, whoever solves them."""
    count = getattr(module, "TILES", TILES)
    size = min(max(rays // count, 1), getattr(module, "TILE_RAYS", TILE_RAYS))
    if not hasattr(module, "TILES"):
        size = max(size, -(-rays // MOST_TILES))
    return [slice(k, min(k + size, rays)) for k in range(0, rays, size)]
