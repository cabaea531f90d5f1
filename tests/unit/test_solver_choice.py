"""Which solver a room is rendered with when nobody says."""

from __future__ import annotations

import numpy as np
import pytest
import radiosity
from plain_rooms import Fog
from surface_rooms import room_scene

from skyscatter.solvers.choice import preferred_solver

SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")


@pytest.mark.parametrize(
    ("extinction", "raw", "denoised"),
    [(0.01, "path", "path"), (1.0, "photons", "path"), (6.0, "photons", "path"), (30.0, "photons", "photons")],
)
def test_fog_is_for_photons_unless_the_picture_is_denoised(extinction: float, raw: str, denoised: str) -> None:
    """Of the deepest fog nothing is known of denoised walks."""
    albedos: dict[str, float] = dict.fromkeys(SIDES, 0.6) | {"lamp": 0.0}
    pieces = radiosity.room((4.0, 5.0, 2.6), albedos, (1.7, 2.7, 2.3, 3.3), [1.0])
    scene = room_scene(pieces, [550.0], Fog(extinction, 0.99, 0.5))
    assert preferred_solver(scene, np.array([550.0])) == raw
    assert preferred_solver(scene, np.array([550.0]), denoised=True) == denoised
