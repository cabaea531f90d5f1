"""Images of voxels that are constant within cells, as codes on cells show them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nebulae import GREY, WAVELENGTH, component, lines_through
from scipy.integrate import dblquad

from skyscatter.errors import DomainError
from skyscatter.inversion.multiple import with_density
from skyscatter.inversion.tomography import reconstruct
from skyscatter.inversion.views import ImageView
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import (
    VoxelFrame,
    VoxelLights,
    VoxelOptics,
    henyey_greenstein_tables,
    mean_inverse_square,
)
from skyscatter.inversion.voxelwalks import multiple_scattering
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Medium
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View

CELLS, RAYS = 6, 60


def model(**changed: Any) -> VoxelModel:
    """Two components, two wavelengths, a star at a corner of cells, one outside, a distant light."""
    rng = np.random.default_rng(3)
    s = rng.random((2, 2))
    optics = VoxelOptics(s, s + 0.5, 0.1 * rng.random((2, 2)), henyey_greenstein_tables(rng.uniform(0, 0.5, (2, 2)))[0])
    place = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 0.3], [0.0, 0.6, 0.8]])
    lights = VoxelLights(place, np.array([False, False, True]), rng.random((3, 2)), np.zeros(3))
    return VoxelModel(
        VoxelFrame.cube(CELLS, 1.0), optics, lights, np.array([0.1, 0.2]), **{"interpolation": "nearest", **changed}
    )


def test_mean_inverse_square_against_another_integral() -> None:
    # Over a cube from its corner, in spherical coordinates: the length of the way through it, over solid angle.
    def length(z: float, turn: float) -> float:
        x, y = np.sqrt(1 - z * z) * np.array([np.cos(turn), np.sin(turn)])
        return float(1 / max(x, y, z))

    # The way is the same function in each of the six parts in which x, y and z have one order.
    def edge(turn: float) -> float:
        return float(np.cos(turn) / np.sqrt(1 + np.cos(turn) ** 2))

    part, _ = dblquad(length, 0.0, np.pi / 4, 0.0, edge, epsabs=1e-10)
    above, _ = dblquad(length, 0.0, np.pi / 4, edge, 1.0, epsabs=1e-10)
    whole = 2 * (part + above)
    edges = np.array([-1.0, 0.0, 1.0])
    np.testing.assert_allclose(mean_inverse_square(edges, edges, edges), whole, rtol=1e-8)
    # Beside and far off: a point lies anywhere within a cell, on its face, or at 40 cells' distance.
    x = np.array([-0.3, 0.7])
    near = mean_inverse_square(x, np.array([0.0, 1.0]), np.array([-0.4, 0.6]))
    halves = [
        mean_inverse_square(np.array(p), np.array([0.0, 1.0]), np.array([-0.4, 0.6])) for p in ([-0.3, 0], [0, 0.7])
    ]
    assert near[0, 0, 0] == pytest.approx(0.3 * halves[0][0, 0, 0] + 0.7 * halves[1][0, 0, 0], rel=1e-6)
    far = mean_inverse_square(np.array([40.0, 41.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    exact = np.mean([1 / (x**2 + y**2 + z**2) for x in _gauss(40.5) for y in _gauss(0.5) for z in _gauss(0.5)])
    assert far[0, 0, 0] == pytest.approx(exact, rel=1e-7)  # the fourth derivative


def _gauss(middle: float) -> Any:
    """The two Gauss-Legendre nodes of a unit interval: exact for cubics."""
    return middle + np.array([-0.5, 0.5]) / np.sqrt(3)


def test_thin_cells_in_parallel_light_are_those_of_single() -> None:
    rng, frame = np.random.default_rng(4), VoxelFrame.cube(CELLS, 1.0)
    dust = component(frame.grid(np.ones(frame.shape)), 1e-5, g=0.4)
    light = ParallelLight(direction=(0.0, 0.6, 0.8), irradiance=2.0)
    scene = SpaceScene(medium=Medium(components=(dust,)), parallel=(light,), view=View(distance=1000.0))
    density = rng.random((1, *frame.shape))
    origins, directions = lines_through(rng, RAYS)
    found = VoxelModel.from_scene(scene, WAVELENGTH, frame, interpolation="nearest").image(density, origins, directions)
    constant = with_density(scene, frame, density, "nearest")
    there = radiance(constant, origins, directions, WAVELENGTH, solver="single").radiance
    # `single` feels its way along jumps of the density, to its tolerance of 1e-4 of the whole ray.
    np.testing.assert_allclose(found, there, rtol=1e-3, atol=1e-4 * there.max())


def test_all_the_light_of_a_cell_at_a_star_arrives() -> None:
    # One thin cell, seen along an axis, with pixels that cut it into 3 x 3: the light of the image is what it scatters.
    frame, cell = VoxelFrame.cube(CELLS, 1.0), 1 / 3
    density = np.zeros(frame.shape)
    density[3, 3, 3] = 1.0
    lights = VoxelLights.stars([[0.0, 0.0, 0.0]], [[1.0]])
    thin = VoxelModel(frame, VoxelOptics.make(1e-6, 1e-6), lights, np.zeros(1), interpolation="nearest")
    view = ImageView.parallel(np.zeros((18, 18)), 1.0, [0, 0, 1], [1, 0, 0], 1.0)
    image = thin.image(density, view.origins.reshape(-1, 3), view.directions.reshape(-1, 3))
    edges = np.array([0.0, 1.0])
    mean = mean_inverse_square(edges, edges, edges)[0, 0, 0] / cell**2
    scattered = 1e-6 * mean / (4 * np.pi) * cell**3  # of 1 W nm-1
    assert image.sum() * (2 / 18) ** 2 * 4 * np.pi == pytest.approx(scattered, rel=1e-5)  # half the depth of 1e-6 / 3


def test_derivatives_are_those_of_the_image() -> None:
    rng, here = np.random.default_rng(1), model()
    rays, density = lines_through(rng, RAYS), rng.random(here.shape)
    weights, direction = rng.normal(size=(RAYS, 2)), rng.normal(size=here.shape)
    image, slope = here.gradient(density, rays[0], rays[1], weights)
    np.testing.assert_array_equal(image, here.image(density, *rays))
    exact, h = float(np.sum(slope.density * direction)), 1e-4
    high, low = (here.image(density + s * h * direction, *rays) for s in (1, -1))
    assert np.sum((high - low) * weights) / (2 * h) == pytest.approx(exact, rel=1e-7)
    assert np.sum(here.tangent(density, direction, *rays)[1] * weights) == pytest.approx(exact, rel=1e-12)


def test_rays_along_axes_and_through_corners_pass_every_cell_once() -> None:
    frame, density = VoxelFrame.cube(CELLS, 1.0), np.random.default_rng(2).random((CELLS,) * 3)
    columns = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1), interpolation="nearest")
    middle = -1 + (np.arange(CELLS) + 0.5) / 3
    origins = np.array([[x, y, 9.0] for x in middle for y in middle])
    found = columns.image(density, origins, [[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(found[:, 0], density.sum(axis=2).ravel() / 3, rtol=1e-12)
    diagonal = columns.image(density, [[9.0, 9.0, 9.0]], -np.ones((1, 3)) / np.sqrt(3))
    assert diagonal[0, 0] == pytest.approx(np.sqrt(3) / 3 * np.einsum("iii", density), rel=1e-6)
    assert columns.image(density, [[1.01, 0.0, 9.0]], [[0.0, 0.0, -1.0]])[0, 0] == 0.0


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(DomainError, match="fine"):
        model(fine=2)
    with pytest.raises(DomainError, match="interpolation"):
        model(interpolation="cubic")
    view = ImageView.parallel(np.ones((4, 4, 2)), 1.0, [0, 0, 1], [1, 0, 0], 1.0)
    with pytest.raises(DomainError, match="source"):
        reconstruct([view], model(), interpolation="nearest")
    with pytest.raises(DomainError, match="interpolation"):
        multiple_scattering(model(), np.ones(model().shape), *lines_through(np.random.default_rng(1), 4), samples=64)


def test_images_on_cells_are_told_by_a_model_on_cells() -> None:
    # Blocks of dust at a star, seen from three sides without noise: a model that is trilinear cannot show them.
    frame = VoxelFrame.cube(8, 1.0)
    truth = np.zeros(frame.shape)
    truth[2:4, 3:6, 2:5], truth[4:6, 2:4, 4:7] = 1.0, 0.6
    scene = SpaceScene(
        medium=Medium(components=(component(frame.grid(truth), 0.3),)),
        stars=(PointStar(spectrum=GREY),),
        view=View(distance=1000.0),
    )
    here, views = VoxelModel.from_scene(scene, WAVELENGTH, interpolation="nearest"), []
    for towards, right in ([0, 0, 1], [1, 0, 0]), ([0, 1, 0], [0, 0, 1]), ([1, 0.5, 0.7], [-0.5, 1, 0]):
        view = ImageView.parallel(np.zeros((22, 22)), 1.0, towards, right, 1.2)
        image = here.image(truth, view.origins.reshape(-1, 3), view.directions.reshape(-1, 3)).reshape(22, 22)
        views.append(ImageView.make(image, 0.02 * np.maximum(image, image.mean()), view.origins, view.directions))
    error = {}
    for name in ("nearest", "linear"):
        found = reconstruct(views, scene, WAVELENGTH, interpolation=name, coarsest=8, target=0.1)
        error[name] = np.linalg.norm(found.density[0] - truth) / np.linalg.norm(truth)
    assert error["nearest"] < 0.5 * error["linear"]
