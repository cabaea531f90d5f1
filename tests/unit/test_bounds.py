"""What solvers do about densities that do not keep to their bounds: they say so."""

from __future__ import annotations

import numpy as np
import pytest
from asking import asked
from nebulae import component, parallel_rays

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.lights import PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import Sphere
from skyscatter.media.structures import Cone
from skyscatter.solvers.base import Asked, Rays
from skyscatter.solvers.bounds import check_bounds
from skyscatter.solvers.options import Path
from skyscatter.solvers.volume_path import prepare, solve
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

GREY = SpectralTable(wavelengths=(500.0,), values=(1.0,))
WAVELENGTHS = np.array([550.0])
#: Walks that trust bounds.
TRACKED = (Asked(Path(samples=64, transmittance="ratio")), Asked(Path(samples=64, sampling="delta")))
CONE = Cone(half_angle_deg=30.0, length=1.0, both_sides=True)


def carved() -> SpaceScene:
    """A ball of dust out of which the light of a star has cleared a double cone."""
    dust = (component(Sphere(radius=1.0), 0.2, name="haze"), component(Sphere(radius=1.0).carved_by(CONE), 2.0))
    stars = (PointStar(spectrum=GREY),)
    return SpaceScene(medium=Medium(components=dust), stars=stars, view=View(distance=100.0))


def rays() -> Rays:
    origins, directions = parallel_rays(np.linspace(0.5, 0.9, 4))
    return Rays(origins, np.array(directions, order="C"), np.arange(4))



@pytest.mark.parametrize(
    "more", [{"transmittance": "ratio"}, {"transmittance": "residual-ratio"}, {"sampling": "delta"}]
)
def test_wrong_bounds_are_refused_before_walks_begin(more: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    inside = lambda self, low, high: (np.ones(len(low)), np.ones(len(low)))  # noqa: E731
    monkeypatch.setattr(Cone, "local_extremes", inside)
    # Of its own half angle, so that no table of other tests is found.
    by = CONE.model_copy(update={"half_angle_deg": 31.0})
    scene = carved()
    parts = scene.medium.components
    field = Sphere(radius=1.0).carved_by(by)
    medium = Medium(components=(parts[0], parts[1].model_copy(update={"density": field})))
    wrong = scene.model_copy(update={"medium": medium})
    with pytest.raises(DomainError, match=r"density of 'dust'.*outside its bounds.*quadrature"):
        skyscatter.radiance(wrong, rays().origins, rays().directions, WAVELENGTHS, **asked("path", samples=16, **more))
    columns = Path(samples=16, transmittance="quadrature")
    skyscatter.radiance(wrong, rays().origins, rays().directions, WAVELENGTHS, solver=columns)


@pytest.mark.parametrize("options", TRACKED)
@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_walks_notice_densities_above_their_bounds(factor: float, options: Asked[Path]) -> None:
    """A table whose bounds are too low, also where they are 0 and tracking sees nothing at all."""
    context = prepare(carved(), rays(), WAVELENGTHS, options, 1, None)
    solve(context, rays(), options)
    upper = context.table.space.upper.copy()
    upper[:, 1] *= factor
    space = context.table.space._replace(upper=upper)
    with pytest.raises(DomainError, match=r"density of 'dust'.*bound.*met \d+ times"):
        solve(context._replace(table=context.table._replace(space=space)), rays(), options)


def test_bounds_of_voxels_that_share_faces_with_the_grid_of_bounds() -> None:
    """Rays and points in the faces of voxels lie in both cells: no false alarm."""
    from skyscatter.media.voxels import VoxelGrid

    values = np.random.default_rng(1).random((32, 32, 32)) * (np.indices((32, 32, 32)).sum(axis=0) % 2)
    grid = VoxelGrid(values=values, low=(-1, -1, -1), high=(1, 1, 1), interpolation="nearest")
    medium = Medium(components=(component(grid, 2.0),))
    check_bounds(medium)
    scene = carved().model_copy(update={"medium": medium})
    origins = np.array([[x, y, 10.0] for x in (-0.5, 0.0, 0.25) for y in (0.0, 0.0625)])
    seen = Rays(origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape).copy(), np.arange(len(origins)))
    for options in TRACKED:
        solve(prepare(scene, seen, WAVELENGTHS, options, 1, None), seen, options)
