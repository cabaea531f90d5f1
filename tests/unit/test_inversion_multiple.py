"""Light scattered more than once, as it is taken off the data of a reconstruction."""

from __future__ import annotations

import numpy as np
import pytest
from nebulae import GREY

from skyscatter.errors import DomainError
from skyscatter.inversion.multiple import with_density
from skyscatter.inversion.voxelscene import VoxelFrame
from skyscatter.lights import PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.optics.dust import Dust
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Isotropic
from skyscatter.solvers.compile import medium_optics
from skyscatter.space import SpaceScene

FRAME = VoxelFrame.cube(4, 1.0)
OPTICS = {
    "coefficient": Particles(extinction=0.7, phase=Isotropic()),
    "depth": Particles(optical_depth=2.0, phase=Isotropic()),
    "visual extinction": Dust(visual_extinction=3.0),
}


def scene(name: str, **more: object) -> SpaceScene:
    grid = FRAME.grid(np.random.default_rng(1).random(FRAME.shape))
    component = Component(name="dust", density=grid, optics=OPTICS[name], weight=1.5, **more)
    return SpaceScene(medium=Medium(components=(component,)), stars=(PointStar(spectrum=GREY),))


@pytest.mark.parametrize("name", OPTICS)
def test_a_unit_of_another_density_does_the_same(name: str) -> None:
    """Also where the optics are stated by a depth through the whole component."""
    density = 3.0 + np.random.default_rng(2).random((1, *FRAME.shape))
    before, after = scene(name), with_density(scene(name), FRAME, density)
    for one, other in zip(*(medium_optics(s.medium, (450.0, 700.0))[:2] for s in (before, after)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    np.testing.assert_allclose(after.medium.components[0].density.cube, density[0], rtol=1e-12)


def test_what_shines_and_is_stated_by_a_depth_is_refused() -> None:
    with pytest.raises(DomainError, match=r"emission.*coefficients"):
        with_density(scene("depth", emission=1.0), FRAME, np.full((1, *FRAME.shape), 3.0))
