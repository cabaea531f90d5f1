"""Deep, nearly white clouds: light that is scattered very often is neither lost nor sure of itself."""

from __future__ import annotations

import time
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from nebulae import GREY, WAVELENGTH, component, dusty_sphere, escaping_luminosity, parallel_rays
from peierls import escaping_share
from significance import assert_agrees

from skyscatter import Telescope, load_model, render
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import Sphere
from skyscatter.media.structures import Box, Slab
from skyscatter.media.voxels import VoxelGrid
from skyscatter.solvers.diffusion import Cells, guess_correction
from skyscatter.solvers.options import Path
from skyscatter.solvers.run import radiance
from skyscatter.solvers.volume import compile_volume
from skyscatter.space import SpaceScene, View


def check_escape(tau: float, albedo: float, g: float, rays: int, samples: int, most: float) -> None:
    """What escapes is what transport says, or for a white cloud, whatever its phase function, all of it."""
    share, error, _ = escaping_luminosity(dusty_sphere(tau, albedo, g), rays, samples=samples)
    expected = -np.expm1(-tau) if albedo == 1.0 else escaping_share(tau, albedo, max(120, int(4 * tau)))
    print(f"tau {tau:g} albedo {albedo:g} g {g:g}: {share[0] / expected:.4f} +- {error[0] / expected:.2g}")
    # The bar of the error, too, is a measure: at most so much, or the comparison says nothing.
    assert error[0] < most * expected
    # Two hundred rays and more: the error of the sum is as good as Gaussian.  The slack is that of the rule over the
    # offset, 1 / rays^1.5, and of the elements of the judge, by halving them (2e-2 at depth 100, below 2e-3 at 30).
    slack = rays**-1.5 + (0.0 if albedo == 1.0 else 2e-2 * (tau / 100) ** 2)
    assert_agrees(share[0], expected, error[0], freedom=np.inf, slack=slack)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:light comes through")
@pytest.mark.parametrize(
    ("tau", "albedo", "g"),
    [(20.0, 1.0, 0.0), (10.0, 1.0, 0.0), (30.0, 0.99, 0.0)],
)
def test_nothing_is_lost_in_the_depths(tau: float, albedo: float, g: float) -> None:
    check_escape(tau, albedo, g, 200, 16, 0.06)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:light comes through")
@pytest.mark.parametrize("albedo", [0.3, 0.6, 0.9, 0.99, 0.999, 1.0])
@pytest.mark.parametrize("tau", [3.0, 10.0, 30.0])
def test_escaping_light_of_every_albedo_and_depth(tau: float, albedo: float) -> None:
    check_escape(tau, albedo, 0.0, 400, 32, 0.08)


@pytest.mark.filterwarnings("ignore:light comes through")
@pytest.mark.parametrize(
    ("tau", "g"),
    [
        (10.0, 0.85),
        *(
            pytest.param(*p, marks=pytest.mark.slow)
            for p in ((3.0, 0.6), (3.0, 0.85), (10.0, 0.6), (30.0, 0.6), (30.0, 0.85))
        ),
    ],
)
def test_white_clouds_lose_nothing_whatever_their_phase_function(tau: float, g: float) -> None:
    # Eight runs of depth 10 and 30 at g = 0.85 have 0.02 to 0.03; where the guess of light knows no angle 0.05 to 0.36.
    check_escape(tau, 1.0, g, 400, 32, 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.9, 0.99, 0.999])
def test_depth_100(albedo: float) -> None:
    with pytest.warns(UserWarning, match="free paths") if albedo > 0.98 else nullcontext():
        check_escape(100.0, albedo, 0.0, 150, 16, 0.4)


def lit(shape: Any, tau: float, albedo: float, g: float, towards: tuple[float, float, float]) -> SpaceScene:
    """Dust of optical depth `tau` per metre under parallel light; it is seen from (0, 0, 1)."""
    medium = Medium(components=(component(shape, tau, albedo, g),))
    return SpaceScene(medium=medium, parallel=(ParallelLight(direction=towards, irradiance=1.0),))


SLAB, BEHIND, BESIDE, BEFORE = Box(half_sizes=(10.0, 10.0, 1.0)), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.3, 0.0, 1.0)


@pytest.mark.filterwarnings("ignore:light comes through")
@pytest.mark.parametrize(
    ("scene", "rays", "most"),
    [
        (dusty_sphere(30.0, albedo=1.0), 40, 1.8),
        (lit(SLAB, 10.0, 1.0, 0.8, BEHIND), 100, 1.4),
        (lit(SLAB, 10.0, 1.0, 0.85, BEFORE), 100, 1.0),
        (lit(SLAB, 10.0, 0.6, 0.9, BEFORE), 400, 3.0),
        (lit(Sphere(radius=1.0), 5.0, 0.6, 0.85, BESIDE), 200, 1.0),
        (lit(Sphere(radius=1.0), 10.0, 1.0, 0.6, BESIDE), 100, 0.8),
        (lit(SLAB, 1.5, 0.5, 0.95, BEFORE), 400, 2.4),
        (lit(Sphere(radius=1.0), 3.0, 0.5, 0.93, BESIDE), 400, 0.7),
        (lit(Sphere(radius=1.0), 3.0, 1.0, 0.9, BESIDE), 200, 1.3),
        (dusty_sphere(5.0, 0.6, 0.9), 200, 1.8),
        (dusty_sphere(2.0, 0.6, 0.6, stars=(), background=1.0), 200, 0.45),
    ],
    ids=[
        "ball",
        "behind",
        "before",
        "dark before",
        "dark beside",
        "beside",
        "peak before",
        "peak beside",
        "white beside",
        "star",
        "background",
    ],
)
def test_walks_in_the_depths_are_worth_alike(scene: SpaceScene, rays: int, most: float) -> None:
    """Variance of a single walk, in squares of the mean, known to a quarter from so many rays.

    It is 0.65, 0.5, 0.45, 1.8, 0.55, 0.45, 1.5, 0.42, 0.8, 1 and 0.28.  It was 3.2 and 19 in the first two before
    strata and promises followed the light, and 5, 140, 18 and 2.4 in the next before directions towards distant lights
    were drawn, and before what draws a vertex was what is promised there; in the last 0.6 where the dark was looked for
    as under a star.  While the guess of light had one lobe, it was 9 and 2.4 in both dark ones, then 20, 8, 4 and 4.
    """
    origins = np.broadcast_to([0.3, 0.0, 10.0], (rays, 3))
    found = radiance(scene, origins, [0.0, 0.0, -1.0], WAVELENGTH, solver=Path(samples=16, seed=1), parts=True)
    light = found.layers["multiple"][:, 0]
    assert 16 * light.var(ddof=1) < most * light.mean() ** 2


@pytest.mark.parametrize(
    "scene",
    [
        lit(Sphere(radius=1.0), 3.0, 0.5, 0.93, BESIDE),
        lit(Sphere(radius=1.0), 3.0, 1.0, 0.9, BESIDE),
        dusty_sphere(5.0, 0.6, 0.9),
    ],
    ids=["dark", "white", "star"],
)
def test_error_bars_cover_where_light_goes_on_forward(scene: SpaceScene) -> None:
    """Of 1000 error bars of 32 walks, as many hold the truth twice as wide as Student's t says, less four errors of it.

    In 16 batches 93.6 %, known to 0.77 %.  While the guess of light had one lobe they were 82, 83 and 87 %.
    """

    def light(rays: int, walks: int, seed: int) -> Any:
        origins = np.broadcast_to([0.3, 0.0, 10.0], (rays, 3))
        asked = Path(samples=walks, seed=seed)
        found = radiance(scene, origins, [0.0, 0.0, -1.0], WAVELENGTH, solver=asked, parts=True)
        return found.layers["multiple"][:, 0], found.standard_error[:, 0]

    values, errors = light(1000, 32, 1)
    truth = light(200, 512, 2)[0].mean()
    assert np.mean(np.abs(values - truth) < 2.0 * errors) > 0.936 - 0.031


def test_a_word_before_depths_that_few_walks_reach() -> None:
    scene = dusty_sphere(60.0, 1.0)
    with pytest.warns(UserWarning, match="60 transport free paths of 'dust'"):
        radiance(scene, *parallel_rays(np.array([0.3])), WAVELENGTH, solver=Path(samples=2, max_order=2))
    with pytest.warns(UserWarning, match="85 scatterings forward of 'dust'"):
        radiance(
            dusty_sphere(100.0, 1.0, 0.85),
            *parallel_rays(np.array([0.3])),
            WAVELENGTH,
            solver=Path(samples=2, max_order=2),
        )
    # As deep, but black enough for guided flights: no word, for filters make every warning an error.
    radiance(dusty_sphere(60.0, 0.6), *parallel_rays(np.array([0.3])), WAVELENGTH, solver=Path(samples=2, max_order=2))


@pytest.mark.parametrize(
    ("sampling", "samples", "least", "g", "turns"), [(None, 16, 0.9, 0.95, 19), ("delta", 2048, 0.8, 0.9, 9)]
)
def test_a_word_where_light_is_hard_to_turn(
    sampling: str | None, samples: int, least: float, g: float, turns: int
) -> None:
    """Backwards, narrow peaks turn light by many scatterings; sidewards by fewer, and in thin dust one is enough."""
    rays = np.array([[0.0, 0.0, 10.0]]), np.array([0.0, 0.0, -1.0]), WAVELENGTH
    asked = Path(samples=samples, max_order=2, sampling=sampling)
    with pytest.warns(UserWarning, match=rf"{turns} scatterings forward that turn it to the observer of 'dust'"):
        radiance(lit(SLAB, 10.0, 0.6, g, (0.0, 0.0, 1.0)), *rays, solver=asked)
    radiance(lit(SLAB, 10.0, 0.6, g, BESIDE), *rays, solver=asked)
    radiance(lit(SLAB, 0.1, 0.6, g, (0.0, 0.0, 1.0)), *rays, solver=asked)
    radiance(lit(SLAB, 10.0, 0.6, least, (0.0, 0.0, 1.0)), *rays, solver=asked)


def test_a_word_where_plain_walks_do_not_come_through() -> None:
    """Of 1024 walks a few come through seven e-foldings, of 32768 ten times as many as are needed."""
    rays = *parallel_rays(np.array([0.3])), WAVELENGTH
    scene = dusty_sphere(10.0, 0.6, 0.5)
    with pytest.warns(UserWarning, match=r"e-foldings of 'dust' .* as few as 1024 walks .* leave sampling out"):
        radiance(scene, *rays, solver=Path(samples=1024, sampling="delta"))
    radiance(scene, *rays, solver=Path(samples=32768, sampling="delta", max_order=2))
    radiance(scene, *rays, solver=Path(samples=16, max_order=2))


def cell_with_star(depth: float, albedo: float) -> SpaceScene:
    """A thin cloud of voxels, and a star in one that is opaque: `depth` from the star to its faces."""
    values = np.full((9, 9, 9), 1 / 9)
    values[4, 4, 4] = depth
    grid = VoxelGrid(values=values, low=(-1, -1, -1), high=(1, 1, 1), interpolation="nearest")
    return SpaceScene(
        medium=Medium(components=(component(grid, 9.0, albedo),)), stars=(PointStar(spectrum=GREY),),
        view=View(distance=100.0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("depth", "albedo"), [(1e4, 1.0), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((100.0, 0.99), (1e4, 0.6)))]
)
def test_a_star_in_an_opaque_cell_ends(depth: float, albedo: float) -> None:
    """No walk takes longer than its patience, some 2^16 legs with what is left when it ends, and a word says so."""
    scene = cell_with_star(depth, albedo)
    with pytest.warns(UserWarning, match="'dust'"):
        answer = radiance(scene, *parallel_rays(np.array([0.02])), WAVELENGTH, solver=Path(samples=2))
    assert np.all(np.isfinite(answer.radiance))


def test_walks_are_not_split_for_light_that_adds_nothing() -> None:
    """Behind a dense disk the guess is ten powers of ten too low where walks begin, and not where they come to.

    Orders beyond the fourth hold 3 % of the light, and took twenty-five times as long as all before.
    """
    scene = load_model("dusty-disk").scene()
    camera = Telescope.from_length(24, 24, "900 AU", scene.view.distance)

    def seconds(most: int) -> float:
        start = time.process_time()
        render(scene, camera, [450.0, 550.0, 650.0], solver=Path(samples=4, seed=1, max_order=most), threads=1)
        return time.process_time() - start

    seconds(2)
    assert seconds(12) < 5 * seconds(4)


@pytest.mark.parametrize("albedo", [0.6, 0.9, 0.97, 0.99, 0.999])
def test_the_guess_follows_the_light_into_the_dark(albedo: float) -> None:
    """Around a star in a dusty sphere it falls as exp(-decay tau) / r, through forty e-foldings and more."""
    depth = 100.0
    table = compile_volume(dusty_sphere(depth, albedo), WAVELENGTH)
    correction = guess_correction(table)[..., 0]
    cells = Cells(table)
    middle = correction.shape[0] // 2
    outward = slice(middle + 2, middle + 3 * correction.shape[0] // 8)
    r = np.linalg.norm(cells.centres[middle, middle, outward] - table.place[0], axis=-1)
    guess = (0.1 + depth * r) * np.exp(-table.decay[0] * depth * r) / r**2
    found = correction[middle, middle, outward] + np.log(guess)
    expected = -table.decay[0] * depth * r - np.log(r)
    fall = expected[0] - expected
    # A twentieth of an e-folding in each, for cells are one to six free paths of diffusion wide; near the star half.
    np.testing.assert_allclose(found[0] - found, fall, rtol=0.05, atol=0.5)


def test_the_guess_is_that_of_diffusion() -> None:
    """Behind a white slab light falls in a straight line to the far side, and not as the guess of point lights."""
    depth = 20.0
    light = ParallelLight(direction=(0.0, 0.0, -1.0), irradiance=1.0)
    medium = Medium(components=(component(Slab(half_thickness=1.0, half_width=20.0), depth / 2, 1.0),))
    table = compile_volume(SpaceScene(medium=medium, parallel=(light,), view=View(distance=100.0)), WAVELENGTH)
    correction = guess_correction(table)
    middle = correction.shape[0] // 2
    assert np.all(np.isfinite(correction))
    assert correction.shape[:3] == tuple(np.array(table.guide.shape[1:4]) - 1)
    along = correction[middle, middle, :, 0]
    # The guess rises with the depth below the lit face, light falls: so does their ratio, all the way.
    assert np.all(np.diff(along) < 0) or np.all(np.diff(along) > 0)
