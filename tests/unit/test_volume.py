"""What the walks in three dimensions stand on: the guide, tracked transmittances, and the choice between ways."""

from __future__ import annotations

import numpy as np
import pytest
from asking import asked
from nebulae import component, dusty_sphere, flat
from numpy.typing import NDArray
from scipy.stats import poisson

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.kernels.gridwalk import make_walker
from skyscatter.kernels.jit import entry
from skyscatter.kernels.path import make_walk
from skyscatter.kernels.tracking import QUADRATURE, fill_tracked
from skyscatter.kernels.volume import VolumeTable, forward_gain, guess_light, make_volume_work
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import GaussianSphere, Sphere
from skyscatter.media.voxels import VoxelGrid
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers.guide import guided_columns
from skyscatter.solvers.transmittance import cheapest, has_cheap_columns
from skyscatter.solvers.volume import compile_volume
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]
ONE = (550.0,)
RAY = ([[0.3, 0.2, 10.0]], [[0.0, 0.0, -1.0]])


def lumpy(depth: float = 2.0) -> SpaceScene:
    medium = Medium(
        components=(
            component(Sphere(radius=1.0), depth, name="wide"),
            component(GaussianSphere(width=0.2, position=(0.3, 0.1, 0.0)), 3.0 * depth, 0.9, name="core"),
        )
    )
    stars = (PointStar(spectrum=flat(1.0)), PointStar(spectrum=flat(0.5), position=(0.0, 1.5, 0.0)))
    light = ParallelLight(direction=(1, 0, 0), irradiance=0.1)
    return SpaceScene(medium=medium, stars=stars, parallel=(light,), view=View(distance=100.0))


@entry
def gains(g, cosines, out):
    """`forward_gain` at cosines (n,)."""
    for n in range(cosines.size):
        out[n] = forward_gain(g, cosines[n])


@entry
def guesses(v, points, directions, g, work, direct, diffuse):
    """`guess_light` at points and directions (n, 3), into (n, wavelength)."""
    for n in range(points.shape[0]):
        p = points[n]
        guess_light(v, p[0], p[1], p[2], directions[n], g, work, direct[n], diffuse[n])


@pytest.mark.parametrize("g", [0.0, 0.5, 0.8])
def test_what_an_angle_counts_for_is_one_over_all_directions(g: float) -> None:
    cosines, weights = np.polynomial.legendre.leggauss(64)
    out = np.empty(64)
    gains(g, cosines, out)
    # 64 points leave (2 g / (1 + g^2))^128 and less of a pole so near: 1e-5 at 0.8.
    assert out @ weights / 2 == pytest.approx(1.0, rel=1e-4)
    assert out @ (weights * cosines) / 2 == pytest.approx(g, abs=1e-4)


def poisson_lobes(g: float, m: float, cosines: Array) -> Array:
    """What directions count for where light was scattered once here and n >= 1 times before, as Poisson tells."""
    n = np.arange(1, 200)
    once_more = g ** (n[:, None] + 1)
    lobes = (1 - once_more**2) / (1 + once_more**2 - 2 * once_more * cosines) ** 1.5
    return (poisson.pmf(n, m) / poisson.sf(0, m)) @ lobes


def guessed(table: VolumeTable, x: float, cosines: Array, weights: Array) -> Array:
    """What directions at angles from +x count for in the guess of scattered light at a place, over their mean."""
    directions = np.stack([cosines, np.sqrt(1.0 - cosines**2), np.zeros_like(cosines)], axis=1)
    points = np.tile([x, 0.0, 0.0], (len(cosines), 1))
    direct, diffuse = np.zeros((2, len(cosines), 1))
    guesses(table, points, directions, 0.8, make_volume_work(1, 1), direct, diffuse)
    return diffuse[:, 0] / (weights @ diffuse[:, 0] / 2.0)


@pytest.mark.parametrize("albedo", [0.5, 1.0])
@pytest.mark.parametrize("scatterings", [0.2, 2.0, 10.0])
@pytest.mark.parametrize("parallel", [False, True])
def test_the_guess_of_light_knows_how_often_it_was_scattered(albedo: float, scatterings: float, parallel: bool) -> None:
    """Towards a star or a parallel light: two lobes are like Poisson's sum of all, and a tenth is from all around.

    Less is known of parallel light where it diffuses: in a sphere of 8 transport free paths, or of 4 with half of that.
    """
    lights = {"stars": (), "parallel": (ParallelLight(direction=(1.0, 0.0, 0.0), irradiance=1.0),)}
    table = compile_volume(dusty_sphere(20.0, albedo, 0.8, **(lights if parallel else {})), ONE)
    away = scatterings / (20.0 * albedo)
    x = 1.0 - away if parallel else -away
    # The guide's cells are 1.25 free paths wide, so that near a rim it tells other depths; they are held elsewhere.
    m = float(guided_columns(table, np.array([[x, 0.0, 0.0]]))[0, 0] @ table.sigma_s[:, 0])
    known, goes_on = 0.9, 1.0 - table.decay[0]
    if parallel:
        known *= np.exp(-0.2 * goes_on * m) / (1.0 + 8.0 * albedo * goes_on)
    cosines, weights = np.polynomial.legendre.leggauss(64)
    lobes = poisson_lobes(0.8, m, cosines)
    # One lobe for two and more scatterings is up to 4 % off where the sum of their lobes is pointed.
    np.testing.assert_allclose(guessed(table, x, cosines, weights), 1.0 + known * (lobes - 1.0), rtol=0.05)


@pytest.mark.parametrize("star", [(0.0, 0.0, 0.0), (0.5, -0.3, 0.02), (0.9, 0.0, 0.0)])
def test_the_guide_is_fine_around_a_star(star: tuple[float, float, float]) -> None:
    """Depths to a star in a dense core of a thirtieth of the radius; with even cells they were 2.5 to 6 % off."""
    core = component(GaussianSphere(width=0.03, position=star), 30.0, name="core")
    wide = component(Sphere(radius=1.0), 1e-3, name="wide")
    scene = dusty_sphere(1.0).model_copy(
        update={"medium": Medium(components=(wide, core)), "stars": (PointStar(spectrum=flat(1.0), position=star),)}
    )
    table = compile_volume(scene, ONE)
    rng = np.random.default_rng(3)
    away = rng.standard_normal((200, 3))
    away *= rng.uniform(0.03, 0.3, (200, 1)) / np.linalg.norm(away, axis=1)[:, None]
    points = np.clip(np.array(star) + away, -0.999, 0.999)
    depth = guided_columns(table, points)[0] @ table.sigma_t[:, 0]
    exact = -np.log(skyscatter.transmittance(scene, points, np.broadcast_to(star, points.shape), [550.0])[:, 0])
    print(f"star at {star}: depths off by {np.abs(depth - exact).mean():.3f} of {exact.mean():.3f}")
    assert np.abs(depth - exact).mean() < 0.02 * exact.mean()


@pytest.mark.parametrize("residual", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_tracked_transmittances_are_unbiased(residual: bool) -> None:
    scene = lumpy()
    table = compile_volume(scene, ONE)
    points = np.random.default_rng(5).uniform(-0.5, 0.5, (12, 3))
    work, walker, walk = make_volume_work(2, 1), make_walker(), make_walk(1)
    for light, place in enumerate([(0, 0, 0), (0, 1.5, 0), None]):
        drawn = np.empty((4000, len(points), 1))
        for n in range(len(drawn)):
            fill_tracked(table, light, points, residual, np.uint64(n + 1), work, walker, walk, drawn[n])
        there = points + np.array([10.0, 0, 0]) if place is None else np.array(place, float)
        far = np.broadcast_to(there, points.shape)
        fall = 0.1 if place is None else table.power[light, 0] / np.sum((far - points) ** 2, axis=1)
        expected = fall * skyscatter.transmittance(scene, points, far, [550.0])[:, 0]
        error = drawn[:, :, 0].std(axis=0) / np.sqrt(len(drawn))
        # 36 comparisons in each run: the largest of so many normal deviates passes 4.2 once in a thousand.
        assert np.abs((drawn[:, :, 0].mean(axis=0) - expected) / error).max() < 4.2


def test_closed_forms_are_cheap_and_grids_are_not() -> None:
    assert cheapest(compile_volume(dusty_sphere(1.0), ONE)) == QUADRATURE
    assert has_cheap_columns(compile_volume(lumpy(), ONE))
    grid = VoxelGrid.from_field(GaussianSphere(width=0.3), (64, 64, 64))
    scene = dusty_sphere(1.0).model_copy(update={"medium": Medium(components=(component(grid, 1.0),))})
    assert not has_cheap_columns(compile_volume(scene, ONE))


def test_costly_media_take_the_first_order_from_the_walks() -> None:
    field = GaussianSphere(width=0.4)
    walked = dusty_sphere(1.0).model_copy(
        update={
            "medium": Medium(components=(component(VoxelGrid.from_field(field, (48, 48, 48)), 1.0, emission=0.02),)),
            "background": 0.01,
        }
    )
    origins = np.array([[x, 0.1, 10.0] for x in (0.1, 0.4, 0.8)])
    rays = (origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape))
    one = skyscatter.radiance(walked, *rays, [550.0], solver="single", parts=True)
    all_ = skyscatter.radiance(walked, *rays, [550.0], solver=skyscatter.Path(samples=1024), parts=True, orders=40)
    total = sum(all_.layers[name] for name in ("direct", "scattered", "multiple"))
    np.testing.assert_allclose(total, all_.radiance, rtol=1e-12)
    # Parts have no error of their own; the whole's, which is larger, stands for it.
    for name in ("direct", "scattered"):
        assert np.all(np.abs(all_.layers[name] - one.layers[name]) < 4 * all_.standard_error)
    # The albedo of 0.6 leaves less than 0.6^40 = 1e-9 to higher orders.
    orders = sum(all_.layers[f"order{k + 1}"] for k in range(40))
    np.testing.assert_allclose(all_.layers["direct"] + orders, all_.radiance, rtol=1e-8)


@pytest.mark.parametrize("way", ["quadrature", "ratio", "residual-ratio", "auto"])
def test_every_way_to_a_transmittance_gives_the_same_light(way: str) -> None:
    scene = lumpy()
    rays = (np.array([[0.3, 0.2, 10.0], [-0.5, 0.4, 10.0]]), np.broadcast_to([0.0, 0.0, -1.0], (2, 3)))
    plain = skyscatter.radiance(scene, *rays, [550.0], solver=skyscatter.Path(samples=4096, seed=1))
    other = skyscatter.radiance(scene, *rays, [550.0], solver=skyscatter.Path(samples=4096, seed=2, transmittance=way))
    error = np.hypot(plain.standard_error, other.standard_error)
    assert np.all(np.abs(plain.radiance - other.radiance) < 4 * error)


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"solver": "orders"}, "solver"),
        ({"solver": "path", "sampling": "guess"}, "sampling"),
        ({"solver": "path", "transmittance": "guess"}, "transmittance"),
        ({"solver": "path", "stokes": True, "sampling": "delta"}, "sampling"),
        ({"solver": "single", "stokes": True}, "stokes"),
        ({"solver": "path", "sampling": "delta", "noise": 0.1}, "noise"),
        ({"solver": "single", "orders": 2}, "orders"),
        ({"solver": "path", "sampling": "area"}, "sampling = 'area': choose from march, free-flight, delta"),
    ],
)
def test_options_without_meaning_are_refused(more: dict[str, object], word: str) -> None:
    with pytest.raises(DomainError, match=word):
        skyscatter.radiance(dusty_sphere(1.0), *RAY, [550.0], **asked(**more))


def test_shells_refuse_what_is_for_space() -> None:
    scene = skyscatter.load_model("earth").scene()
    with pytest.raises(DomainError, match="transmittance"):
        skyscatter.radiance(scene, [0, 0, 6371e3], [0, 0, 1.0], [550.0], solver=skyscatter.Path(transmittance="ratio"))


def test_one_medium_has_one_sort_of_fields() -> None:
    with pytest.raises(ValueError, match="planet_radius"):
        Medium(components=(component(Sphere(radius=1.0), 1.0),), planet_radius=6e6)
    with pytest.raises(DomainError, match="no planet"):
        _ = Medium(components=(component(Sphere(radius=1.0), 1.0),)).radius


def test_same_seed_same_numbers_whatever_the_threads() -> None:
    scene = lumpy()
    origins = np.random.default_rng(2).uniform(-0.8, 0.8, (40, 3)) + np.array([0, 0, 10.0])
    rays = (origins, np.broadcast_to([0.0, 0.0, -1.0], origins.shape))
    a, b = (
        skyscatter.radiance(scene, *rays, [500.0, 600.0], solver=skyscatter.Path(samples=16, seed=7), threads=n)
        for n in (1, 2)
    )
    np.testing.assert_array_equal(a.radiance, b.radiance)
    np.testing.assert_array_equal(a.standard_error, b.standard_error)


def test_optical_depths_by_component() -> None:
    scene = lumpy()
    tau = skyscatter.optical_depth(scene, [0, 0, -5.0], [0, 0, 5.0], [400.0, 700.0], by_component=True)
    assert tau.shape == (2, 2)
    assert tau[0] == pytest.approx([4.0, 4.0])
    air = scene.medium.components[0].model_copy(update={"optics": RayleighPowerLaw(coefficient=0.1, wavelength=550)})
    blue, red = skyscatter.optical_depth(
        scene.model_copy(update={"medium": Medium(components=(air,))}), [0, 0, -5.0], [0, 0, 5.0], [400.0, 700.0]
    )
    assert blue / red == pytest.approx((700 / 400) ** 4)


def test_a_middle_wavelength_at_which_nothing_scatters_hides_nothing() -> None:
    # Directions and strata are chosen for all wavelengths together; once they asked the middle one alone.
    table = SpectralTable(wavelengths=(500, 549, 550, 551, 600), values=(0.9, 0.9, 0.0, 0.9, 0.9))
    scene = dusty_sphere(2.0, table, 0.3)
    three = skyscatter.radiance(scene, *RAY, [500.0, 550.0, 600.0], solver=skyscatter.Path(samples=1024))
    two = skyscatter.radiance(scene, *RAY, [500.0, 600.0], solver=skyscatter.Path(samples=1024, seed=1))
    assert three.radiance[0, 1] == 0
    error = np.hypot(three.standard_error[0, ::2], two.standard_error[0])
    assert np.all(np.abs(three.radiance[0, ::2] - two.radiance[0]) < 4 * error)
