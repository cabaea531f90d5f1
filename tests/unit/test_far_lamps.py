"""Warnings of lamps that walks and photons meet too seldom."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from walk_scenes import WAVELENGTHS, fog, medium, room

from skyscatter.solvers import photons, surface_path
from skyscatter.solvers.base import Asked, Rays
from skyscatter.solvers.far_lamps import share_by_glass, share_through_fog, warn_of_far_lamps, warn_of_small_lamps
from skyscatter.solvers.options import Path, Photons
from skyscatter.solvers.surfaces import compile_surfaces
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Dielectric, Interface, Lambert
from skyscatter.surfaces.scene import Body, SurfaceScene
from skyscatter.surfaces.shapes import Box, Rectangle, Sphere


def lit_room(extinction: float, albedo: float = 0.99, size: float = 0.6, more: tuple[Any, ...] = ()) -> SurfaceScene:
    """A cube of half side 1 in fog, a lamp in its ceiling, and more bodies."""
    shape = Rectangle(position=(0, 0, 0.9), normal=(0, 0, -1), size=(size, size))
    lamp = Body(name="lamp", shape=shape, material=Lambert(albedo=0.3), lamp=AreaLamp(power=1.0))
    media = (medium("air", fog(extinction, albedo)), medium("glass", index=1.5))
    return SurfaceScene(media=media, bodies=(*room(1.0, 0.5), lamp, *more))


def table(scene: SurfaceScene) -> Any:
    return surface_path.guided(compile_surfaces(scene, WAVELENGTHS))


PLACE = np.array([0.0, 0.0, -0.9])


def test_shares_follow_diffusion() -> None:
    """exp(-k t) / (1 + t) of a lamp 1.8 m away, less its radius; thin fog hides nothing."""
    t = 30.0 * (1.8 - 0.3 * np.sqrt(2))
    expected = np.exp(-np.sqrt(0.03) * t) / (1 + t)
    # The lamp's middle and size are found from points of it: to some per cent of 0.4 m in 1.4.
    assert share_through_fog(table(lit_room(30.0)), PLACE) == pytest.approx(expected, rel=0.5)
    assert share_through_fog(table(lit_room(0.01)), PLACE) > 0.98
    assert share_through_fog(table(lit_room(30.0, 0.5)), PLACE) < 1e-9 * expected


def test_a_small_body_of_fog_hides_no_lamp() -> None:
    """Only as far as the medium at the viewpoint goes."""
    block = Body(name="fog", shape=Box(position=(0, 0, -0.9), size=(0.1, 0.1, 0.1)), material=Interface(), inside="fog")
    media = (medium("air"), medium("fog", fog(30.0, 0.5)))
    scene = lit_room(0.0).model_copy(update={"media": media, "bodies": (*lit_room(0.0).bodies, block)})
    assert share_through_fog(table(scene), PLACE) > 1e-5


@pytest.mark.parametrize("solver", [surface_path, photons])
def test_dense_fog_is_warned_of_before_the_run(solver: Any) -> None:
    rays = Rays(PLACE[None], np.array([[0.0, 0.0, 1.0]]), np.arange(1))
    asked: Asked[Any] = Asked(Photons(radius=0.1) if solver is photons else Path())
    for extinction, warned in ((30.0, True), (0.5, False)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            solver.prepare(lit_room(extinction, 0.9), rays, WAVELENGTHS, asked, 1, None)
        assert any("so dense" in str(w.message) for w in caught) == warned


def test_small_lamps_and_glass() -> None:
    """A ball of glass under a lamp of 2 cm; none of it under a large one, or with walks enough, or without glass."""
    ball = Body(name="ball", shape=Sphere(radius=0.3), material=Dielectric(), inside="glass")
    small, large = (table(lit_room(0.0, size=size, more=(ball,))) for size in (0.02, 1.6))
    assert share_by_glass(small) < 1e-4 < 1e-2 < share_by_glass(large)
    assert share_by_glass(table(lit_room(0.0, size=0.02))) == 1.0
    with pytest.warns(UserWarning, match="photons"):
        warn_of_small_lamps(small, 16)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_small_lamps(small, 1 << 20)
        warn_of_small_lamps(large, 16)
        warn_of_far_lamps(small, PLACE[None], 16, "")
