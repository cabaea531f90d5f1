"""Images of voxels: against the solver `single`, and their derivatives against finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nebulae import GREY, dust, flat, lines_through

from skyscatter.errors import DomainError
from skyscatter.inversion.adjoint import (
    spreading_map,
    through_map,
    through_parameters,
)
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import (
    VoxelFrame,
    VoxelLights,
    VoxelOptics,
    henyey_greenstein_tables,
    scene_densities,
)
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.voxels import VoxelGrid
from skyscatter.solvers.options import Single
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View

CELLS, COMPONENTS, WAVELENGTHS, RAYS = 7, 2, 3, 40
G = np.random.default_rng(5).uniform(-0.3, 0.6, (COMPONENTS, WAVELENGTHS))
NUMBERS: dict[str, Any] = {
    "sigma_s": np.random.default_rng(6).random((COMPONENTS, WAVELENGTHS)),
    "sigma_t": 1 + np.random.default_rng(7).random((COMPONENTS, WAVELENGTHS)),
    "emission": 0.1 * np.random.default_rng(8).random((COMPONENTS, WAVELENGTHS)),
    "g": G,
    "power": np.random.default_rng(9).random((3, WAVELENGTHS)),
    "background": 0.1 * np.random.default_rng(10).random(WAVELENGTHS),
}


def model(**changed: Any) -> VoxelModel:
    """Two components, three wavelengths; a star among the voxels, one outside, a distant light."""
    n = NUMBERS | changed
    place = np.array([[0.1, 0.05, -0.2], [2.0, 1.0, 0.3], [0.0, 0.6, 0.8]])
    lights = VoxelLights(place, np.array([False, False, True]), n["power"], np.zeros(3))
    optics = VoxelOptics(n["sigma_s"], n["sigma_t"], n["emission"], henyey_greenstein_tables(n["g"])[0])
    return VoxelModel(VoxelFrame.cube(CELLS, 1.0), optics, lights, n["background"], threads=n.get("threads"))


@pytest.fixture(scope="module")
def case() -> dict[str, Any]:
    """Densities, rays, weights, and what one backward pass says of them."""
    rng = np.random.default_rng(1)
    origins, directions = lines_through(rng, RAYS)
    density = rng.random((COMPONENTS, CELLS, CELLS, CELLS))
    weights = rng.normal(size=(RAYS, WAVELENGTHS))
    slopes = henyey_greenstein_tables(G)[1]
    image, slope = model().gradient(density, origins, directions, weights, optics=True, phase_slope=slopes)
    rays = (origins, directions)
    return {"rays": rays, "density": density, "weights": weights, "image": image, "slope": slope}


def test_gradient_of_all_voxels_against_finite_differences_with_a_step_study(case: dict[str, Any]) -> None:
    direction = np.random.default_rng(2).normal(size=case["density"].shape)
    exact = float(np.sum(case["slope"].density * direction))
    here, steps = model(), 10.0 ** -np.arange(1, 8)
    error = []
    for h in steps:
        high, low = (here.image(case["density"] + s * h * direction, *case["rays"]) for s in (1, -1))
        error.append(abs(float(np.sum((high - low) * case["weights"])) / (2 * h) / exact - 1))
    # Truncation falls with the square of the step as long as rounding, about 1e-16 over the step, is below it.
    np.testing.assert_allclose(np.array(error[:3]) / error[1:4], 100.0, rtol=0.05)
    assert min(error) < 1e-9
    assert error[-1] > min(error)  # rounding rises again: the V is whole


def test_every_single_voxel_against_finite_differences(case: dict[str, Any]) -> None:
    here, h = model(), 1e-4
    rng = np.random.default_rng(3)
    scale = np.abs(case["slope"].density).max()
    for index in zip(*(rng.integers(0, n, 12) for n in case["density"].shape), strict=True):
        moved = np.zeros_like(case["density"])
        moved[index] = h
        high, low = (here.image(case["density"] + s * moved, *case["rays"]) for s in (1, -1))
        found = float(np.sum((high - low) * case["weights"])) / (2 * h)
        assert found == pytest.approx(case["slope"].density[index], rel=1e-5, abs=1e-9 * scale)


@pytest.mark.parametrize("name", ["sigma_s", "sigma_t", "emission", "g", "power", "background"])
def test_optics_and_lights_against_finite_differences(case: dict[str, Any], name: str) -> None:
    direction = np.random.default_rng(4).normal(size=NUMBERS[name].shape)
    exact = float(np.sum(getattr(case["slope"], "phase" if name == "g" else name) * direction))
    found = {}
    for h in (1e-3, 1e-5):
        high, low = (
            model(**{name: NUMBERS[name] + s * h * direction}).image(case["density"], *case["rays"]) for s in (1, -1)
        )
        found[h] = abs(float(np.sum((high - low) * case["weights"])) / (2 * h) / exact - 1)
    assert found[1e-5] < 1e-8
    assert found[1e-3] < 1e-4


def test_extinction_albedo_and_luminosity_follow_by_the_chain_rule(case: dict[str, Any]) -> None:
    h, optics = 1e-5, model().optics
    extinction, albedo = case["slope"].extinction_albedo(optics)
    omega = NUMBERS["sigma_s"] / NUMBERS["sigma_t"]

    def loss(**numbers: Any) -> float:
        return float(np.sum(model(**numbers).image(case["density"], *case["rays"]) * case["weights"]))

    value = [loss(sigma_t=NUMBERS["sigma_t"] * f, sigma_s=NUMBERS["sigma_s"] * f) for f in (1 + h, 1 - h)]
    assert (value[0] - value[1]) / (2 * h) == pytest.approx(np.sum(extinction * NUMBERS["sigma_t"]), rel=1e-7)
    value = [loss(sigma_s=(omega + s * h) * NUMBERS["sigma_t"]) for s in (1, -1)]
    assert (value[0] - value[1]) / (2 * h) == pytest.approx(np.sum(albedo), rel=1e-7)
    luminosity = case["slope"].luminosity
    np.testing.assert_allclose(luminosity[:2] * 4 * np.pi, case["slope"].power[:2])
    np.testing.assert_allclose(luminosity[2], case["slope"].power[2])


def test_tangent_and_adjoint_are_transposes(case: dict[str, Any]) -> None:
    change = np.random.default_rng(12).normal(size=case["density"].shape)
    image, moved = model().tangent(case["density"], change, *case["rays"])
    np.testing.assert_array_equal(image, case["image"])
    left, right = np.sum(moved * case["weights"]), np.sum(change * case["slope"].density)
    assert left == pytest.approx(right, rel=1e-12)  # rounding of some 1e5 terms


def test_the_misfit_of_data_is_weighted_in_the_same_pass(case: dict[str, Any]) -> None:
    rng = np.random.default_rng(13)
    data, weights = case["image"] + rng.normal(size=case["image"].shape), rng.random(case["image"].shape)
    _, fused = model().gradient(case["density"], *case["rays"], weights, data=data)
    _, plain = model().gradient(case["density"], *case["rays"], weights * (case["image"] - data))
    np.testing.assert_array_equal(fused.density, plain.density)


def test_threads_do_not_change_a_bit(case: dict[str, Any]) -> None:
    for threads in (1, 3):
        _, slope = model(threads=threads).gradient(case["density"], *case["rays"], case["weights"])
        np.testing.assert_array_equal(slope.density, case["slope"].density)


def scene(*stars: PointStar, **more: Any) -> tuple[SpaceScene, Any]:
    """A bumpy ball on voxels, and its densities."""
    frame = VoxelFrame((10, 12, 8), (-1.0, -1.0, -0.8), (1.0, 1.0, 0.8))
    r = np.linalg.norm(frame.middles(), axis=-1)
    values = np.exp(-3 * r**2) * np.random.default_rng(0).uniform(0.7, 1.3, r.shape)
    part = Component(name="dust", density=frame.grid(values, factor=1.5), optics=dust(1.0, 0.6, 0.4))
    glow = Component(name="gas", density=frame.grid(values**2), optics=dust(0.3, 0.1), emission=flat(0.01))
    given: dict[str, Any] = {"stars": stars, "background": 0.01, "view": View(distance=100.0)}
    made = SpaceScene(**({"medium": Medium(components=(part, glow))} | given | more))
    return made, scene_densities(made)


@pytest.mark.parametrize("place", [(0.1, 0.05, -0.2), (2.0, 0.5, -0.2)])
def test_the_image_is_that_of_the_solver_single(place: tuple[float, float, float]) -> None:
    light = ParallelLight(direction=(0.0, 1.0, 1.0), irradiance=0.03)
    made, density = scene(PointStar(position=place, spectrum=GREY), parallel=(light,))
    origins, directions = lines_through(np.random.default_rng(0), 100)
    exact = radiance(made, origins, directions, [550.0], solver=Single(tolerance=1e-6)).radiance
    error = []
    for fine in (1, 2, 4):
        here = VoxelModel.from_scene(made, [550.0], step=0.5 / fine, near=0.25 / fine, fine=fine)
        error.append(float(np.sqrt(np.mean((here.image(density, origins, directions) / exact - 1) ** 2))))
    # A midpoint rule that steps over a share q = 1/4 of the distance to the star misses q^2 / 24 where curvature is 1.
    # Second order: four times better each time; corners of the interpolation make it somewhat less.
    assert error[0] < 0.25**2 / 24
    assert error[1] < error[0] / 2.5
    assert error[2] < error[1] / 2.5


def test_columns_depths_and_transmittances_are_special_cases() -> None:
    made, density = scene()
    dark_medium = Medium(components=tuple(c.model_copy(update={"emission": 0.0}) for c in made.medium.components))
    made = made.model_copy(update={"medium": dark_medium, "background": 1.0})
    frame, origins, directions = VoxelFrame.of(made.medium.fields[0]), *lines_through(np.random.default_rng(1), 20)
    dark = VoxelLights.none(1)
    exact = -np.log(radiance(made, origins, directions, [550.0], solver=Single(tolerance=1e-6)).radiance[:, 0])
    sigma_t = VoxelModel.from_scene(made, [550.0]).optics.sigma_t
    depths = VoxelModel(frame, VoxelOptics.depths(sigma_t), dark, np.zeros(1), step=0.1).image(
        density, origins, directions
    )
    np.testing.assert_allclose(depths[:, 0], exact, rtol=2e-3)  # second order in a tenth of a cell
    through = VoxelModel(frame, VoxelOptics.transmittances(sigma_t), dark, np.ones(1), step=0.1)
    np.testing.assert_allclose(through.image(density, origins, directions), np.exp(-depths), rtol=1e-12)
    columns = VoxelModel(frame, VoxelOptics.columns(), dark, np.zeros(1), step=0.1)
    parts = [columns.image(rho, origins, directions) for rho in density]
    np.testing.assert_allclose(sum(s * p for s, p in zip(sigma_t, parts, strict=True)), depths, rtol=1e-12)


def test_thin_media_scatter_what_their_columns_say() -> None:
    frame = VoxelFrame.cube(8, 1.0)
    density = np.random.default_rng(2).random(frame.shape)
    optics, tiny = VoxelOptics.make(0.6, 1.0), 1e-7
    light = VoxelLights(np.array([[0.0, 0.0, 1.0]]), np.array([True]), np.ones((1, 1)), np.zeros(1))
    rays = lines_through(np.random.default_rng(3), 20)
    image = VoxelModel(frame, optics, light, np.zeros(1)).image(tiny * density, *rays)
    column = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1)).image(tiny * density, *rays)
    # Isotropic scattering of irradiance 1; optical depths are below 1e-6.
    np.testing.assert_allclose(image, 0.6 / (4 * np.pi) * column, rtol=1e-6)


def test_a_star_on_a_ray_and_rays_that_miss() -> None:
    frame = VoxelFrame.cube(6, 1.0)
    here = VoxelModel(frame, VoxelOptics.make(0.6, 1.0), VoxelLights.stars([[0.0, 0, 0]], [[1.0]]), np.zeros(1))
    origins = np.array([[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [1e-3, 0.0, 3.0], [2e-3, 0.0, 3.0]])
    image = here.image(np.ones(frame.shape), origins, np.array([[0.0, 0.0, -1.0]]))[:, 0]
    assert np.isfinite(image).all()
    assert image[1] == 0.0
    # Close to a star in a uniform medium the light goes as pi / distance.
    assert image[2] / image[3] == pytest.approx(2.0, rel=0.02)


def test_weights_of_particles_and_analytic_parameters_by_the_chain_rule() -> None:
    frame, rng = VoxelFrame.cube(6, 1.0), np.random.default_rng(4)
    slope = rng.normal(size=frame.shape)
    spread = spreading_map(frame, rng.uniform(-0.7, 0.7, (9, 3)))
    np.testing.assert_allclose(np.asarray(spread.sum(axis=0)).ravel() * frame.volume, 1.0)
    weights, change, h = rng.random(9), rng.normal(size=9), 1e-3
    both = [np.sum(slope.ravel() * (spread @ (weights + s * h * change))) for s in (1, -1)]
    assert through_map(slope, spread) @ change == pytest.approx((both[0] - both[1]) / (2 * h), rel=1e-10)

    def ball(mass: float, width: float) -> Any:
        return mass * np.exp(-np.sum(frame.middles() ** 2, axis=-1) / (2 * width**2))

    found = through_parameters(slope, ball, {"mass": 2.0, "width": 0.5})
    r2 = np.sum(frame.middles() ** 2, axis=-1)
    assert found["mass"] == pytest.approx(np.sum(slope * ball(1.0, 0.5)), rel=1e-8)
    assert found["width"] == pytest.approx(np.sum(slope * ball(2.0, 0.5) * r2 / 0.5**3), rel=1e-8)


def test_bad_input_is_named() -> None:
    with pytest.raises(DomainError, match="density"):
        model().image(np.ones((1, 2, 2, 2)), np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(DomainError, match="directions"):
        model().image(np.ones((2, CELLS, CELLS, CELLS)), np.zeros((1, 3)), np.ones((1, 3)))
    with pytest.raises(DomainError, match="interpolation"):
        VoxelFrame.of(VoxelGrid(values=np.ones((2, 2, 2)), spacing=1.0, interpolation="nearest"))
    with pytest.raises(DomainError, match="g ="):
        henyey_greenstein_tables(1.0)


def test_scattering_beyond_extinction_is_refused() -> None:
    with pytest.raises(DomainError, match="sigma_s = 2"):
        VoxelOptics.make(sigma_s=2.0, sigma_t=1.0)


def test_steps_may_be_thick() -> None:
    """What absorbs as much as it shines: S (1 - exp(-tau)) whatever the density, and however deep a step is."""
    frame = VoxelFrame.cube(6, 1.0)
    density = np.random.default_rng(4).random(frame.shape)
    origins, directions = lines_through(np.random.default_rng(5), 12, radius=0.8, spread=0.3)
    columns = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1), step=1.0)
    column = columns.image(density, origins, directions)
    for depth in (0.01, 3.0, 100.0):
        optics = VoxelOptics.make(0.0, depth, emission=2.0 * depth)
        model = VoxelModel(frame, optics, VoxelLights.none(1), np.zeros(1), step=1.0)
        light, slope = model.gradient(density, origins, directions, np.ones((12, 1)), optics=True)
        np.testing.assert_allclose(light, -2.0 * np.expm1(-depth * column), rtol=1e-9)
        # Both coefficients changed together: 2 d(1 - exp(-depth column)) / d depth.
        total = slope.sigma_t[0, 0] + 2.0 * slope.emission[0, 0]
        assert total == pytest.approx(float(np.sum(2.0 * column * np.exp(-depth * column))), rel=1e-7, abs=1e-9)
