"""The grid in which photons find the points that gather them."""

from __future__ import annotations

import numpy as np

from skyscatter.kernels.surfaces.neighbours import make_cells


def test_points_in_one_place_share_few_cells() -> None:
    """Spheres that are lost in the rounding of their places: were cells as small, each would fill all of them."""
    cells = make_cells(np.full((50, 3), 3.0), 1e-300)
    assert cells.entry.size <= 8 * 50
