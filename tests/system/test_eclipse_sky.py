"""Skies in eclipses of the Sun: closed forms, a quadrature of its own, plain walks, and nodes against walks."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from worlds import BURIED

import skyscatter
from skyscatter import Component, Ground, Medium, Scene, Star
from skyscatter.kernels.eclipse import INNER, OUTER, EclipseTable
from skyscatter.kernels.jit import entry
from skyscatter.kernels.surfaces.lamps import aim
from skyscatter.media.fields import Exponential
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers import eclipsed, path, single
from skyscatter.solvers.base import Answer, Asked, Rays, Tables, prepare_tables
from skyscatter.solvers.eclipse import eclipse_of, eclipse_table
from skyscatter.solvers.options import Orders, Path
from skyscatter.solvers.worldlights import eclipsed as before_moon
from skyscatter.solvers.worldlights import tables as world_tables
from skyscatter.solvers.worldscene import as_surfaces
from skyscatter.surfaces import Body, Box, Lambert

Array = NDArray[np.float64]

WL = np.array([420.0, 550.0, 680.0])
PLACE, TOTAL, PARTIAL = (42.85, -106.32), "2017-08-21T17:43:50Z", "2017-08-21T17:20:00Z"
EARTH = 6371e3


def direction(elevation: float, azimuth: float) -> list[float]:
    e, a = np.radians([elevation, azimuth])
    return [float(np.cos(e) * np.sin(a)), float(np.cos(e) * np.cos(a)), float(np.sin(e))]


SKY = np.array([direction(*at) for at in ((90, 0), (40, 200), (10, 60), (2, 300), (-20, 140))])


@lru_cache
def scene(time: str, model: str = "earth-simple") -> Scene:
    return skyscatter.load_model(model).scene_at(*PLACE, time)


def rays_of(it: Scene, directions: Array = SKY) -> Rays:
    d = np.array(directions, float)
    return Rays(np.tile(it.observer.position, (len(d), 1)), d, np.arange(len(d), dtype=np.int64))


def tables_of(it: Scene, eclipse: EclipseTable | None = None) -> Tables:
    tables = prepare_tables(it, rays_of(it), WL, Asked(Path()), 1, None)
    return tables if eclipse is None else tables._replace(scene=tables.scene._replace(eclipse=eclipse))


def even(it: Scene, share: float) -> EclipseTable:
    """A Moon a hundred times the Sun's size that lets a share of the light pass, the same all over the sky."""
    sun, place = it.sun.direction, it.observer.position
    shares = np.full((3, INNER + OUTER + 1, WL.size), share)
    # 27 degrees wide, so that all points have it before the Sun
    return EclipseTable(
        shares, np.array([50.0, 100.0, 150.0]), place + 1.5e11 * sun, place + 4e8 * sun, 6.96e8, 1.8e8, 1.0
    )


def z_of(one: Answer, other: Answer, parts: tuple[float, float] = (1.0, 1.0)) -> Array:
    return (one.radiance - other.radiance) / np.hypot(parts[0] * one.error, parts[1] * other.error)


def test_an_even_share_scales_the_light() -> None:
    it = scene("2017-08-22T17:43:50Z")  # no eclipse
    rays, share = rays_of(it), 0.37
    plain, dimmed = tables_of(it), tables_of(it, even(it, share))
    once = [single.single_parts(t.scene, t.ground, rays, 1e-4) for t in (plain, dimmed)]
    for full, part in zip(once[0][:2], once[1][:2], strict=True):
        np.testing.assert_allclose(part, share * full, rtol=1e-12)  # the last digits of a product
    flights = Asked(Path(samples=2000, sampling="free-flight"))
    free = [path.solve(t, rays, flights) for t in (plain, dimmed)]
    # the same walks to the last one: their draws do not ask for sunlight
    np.testing.assert_allclose(free[1].radiance, share * free[0].radiance, rtol=1e-11)
    walks = [path.solve(t, rays, Asked(Path(samples=4096, seed=n))) for n, t in enumerate((plain, dimmed))]
    scaled = Answer(share * walks[0].radiance, share * walks[0].error)
    # 15 numbers, of which neighbouring wavelengths go together: 4 standard errors by 16 batches are one in 1000
    assert np.abs(z_of(walks[1], scaled)).max() < 4.0


def test_what_is_covered_and_what_is_not_make_the_whole() -> None:
    it = scene(TOTAL)
    table = eclipse_table(it, WL)
    rays = rays_of(it)
    masks = (table, table._replace(share=1.0 - table.share), tables_of(scene("2017-08-22T17:43:50Z")).scene.eclipse)
    tables = [tables_of(it, mask) for mask in masks]
    once = [single.single_parts(t.scene, t.ground, rays, 1e-5) for t in tables]
    for shaded, rest, whole in zip(once[0][:2], once[1][:2], once[2][:2], strict=True):
        # three quadratures of 1e-5 each; beyond 3500 km, where no Moon is before the Sun, no air is in sight
        np.testing.assert_allclose(shaded + rest, whole, rtol=1e-4, atol=1e-12)
    walks = [path.solve(t, rays, Asked(Path(samples=4096, seed=n))) for n, t in enumerate(tables)]
    total = Answer(walks[0].radiance + walks[1].radiance, np.hypot(walks[0].error, walks[1].error))
    assert np.abs(z_of(total, walks[2])).max() < 4.0  # as above


H, TOP, SCATTERING = 8e3, 100e3, 1.2e-5


def simple(time: str) -> Scene:
    """Exponential air under a point Sun over black ground."""
    air = Component(
        name="air",
        density=Exponential(scale_height=H, top=TOP),
        optics=RayleighPowerLaw(coefficient=SCATTERING, wavelength=550.0),
    )
    sun = scene(time).sun
    return Scene(
        medium=Medium(planet_radius=EARTH, components=(air,)), ground=Ground(albedo=0.0),
        star=Star(spectrum=1.0, radius=0.0), sun=sun,
    )  # fmt: skip


def column(start: Array, towards: Array, length: Array, nodes: int = 200) -> Array:
    """Density integrated along lines, by Gauss-Legendre points that crowd at the start."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    u, weight = 0.5 * (x + 1.0), 0.5 * w
    t = length[:, None] * u**3
    points = start[:, None, :] + t[..., None] * towards
    density = np.exp(-(np.linalg.norm(points, axis=-1) - EARTH) / H)
    return np.asarray((density * 3.0 * u**2 * weight).sum(axis=1) * length)


def to_top(start: Array, towards: Array) -> Array:
    along = start @ towards
    return np.asarray(-along + np.sqrt(along**2 + (EARTH + TOP) ** 2 - np.sum(start**2, axis=-1)))


@pytest.mark.parametrize("time", [TOTAL, PARTIAL])
@pytest.mark.parametrize("at", [(90.0, 0.0), (12.0, 60.0), (2.0, 250.0)])
def test_first_order_against_a_quadrature(time, at) -> None:
    it = simple(time)
    eclipse = eclipse_of(it)
    assert eclipse is not None
    ray, sun, place = np.array(direction(*at)), it.sun.direction, it.observer.position
    # The ray in 400 pieces with 6 Gauss points, finer near by.
    edges = to_top(place[None], ray)[0] * np.linspace(0.0, 1.0, 401) ** 2
    x, w = np.polynomial.legendre.leggauss(6)
    t = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x).ravel()
    weight = (0.5 * np.diff(edges)[:, None] * w).ravel()
    points = place + t[:, None] * ray
    depth = column(np.tile(place, (t.size, 1)), ray, t) + column(points, sun, to_top(points, sun))
    sigma = SCATTERING * (550.0 / WL) ** 4
    cosine = float(ray @ sun)
    phase = 3.0 / (16.0 * np.pi) * (1.0 + cosine**2)
    density = np.exp(-(np.linalg.norm(points, axis=1) - EARTH) / H)[:, None]
    shares = eclipse.light_at(points - place, WL)
    expected = weight @ (density * sigma * phase * np.exp(-depth[:, None] * sigma) * shares)
    expected *= (it.star.distance / it.star_distance) ** 2
    found = skyscatter.radiance(it, place, ray, WL, solver=skyscatter.Single(tolerance=1e-5)).radiance
    # the solver's tolerance and its tables; the share between entries is off by 5e-6, of the 1e-2 at the end of a low
    # ray in totality a thousandth; at the zenith there shares of 1e-5 are all that is
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-5 * 5.0 * sigma.max() * H * phase)


def test_walks_against_plain_ones_in_totality() -> None:
    it = scene(TOTAL, "earth")
    rays, tables = rays_of(it), tables_of(it)
    marched = path.solve(tables, rays, Asked(Path(samples=8192)))
    free = path.solve(tables, rays, Asked(Path(samples=200_000, sampling="free-flight")))
    # 15 numbers, correlated over wavelengths; the bar of 3 standard errors, of a t distribution of 15 degrees
    assert np.abs(z_of(marched, free)).max() < 4.0
    assert np.sqrt(np.mean(z_of(marched, free) ** 2)) < 1.6  # five independent rays: one in 100 has more
    assert (marched.error < 0.2 * marched.radiance).all()
    assert (free.error < 0.1 * free.radiance).all()


def test_how_dark_totality_is() -> None:
    """Three to four orders of magnitude darker at the zenith (Emde & Mayer 2007), less towards the horizon."""
    it = scene(TOTAL, "earth")
    full = it.model_copy(update={"sun": it.sun.model_copy(update={"site": None})})
    dark, bright = (path.solve(tables_of(of), rays_of(of), Asked(Path(samples=4096))) for of in (it, full))
    ratio = dark.radiance / bright.radiance
    assert (ratio[0] > 1e-4).all()
    assert (ratio[0] < 1e-3).all()
    # the horizon all around is the brightest: beneath 2 degrees ten times as much is left of the red as at the zenith
    assert ratio[3, 2] > 5.0 * ratio[0, 2]
    # and redder than it was, where the light has come a long way through the air
    assert ratio[3, 2] > 1.2 * ratio[3, 0]


@pytest.mark.parametrize("time", [pytest.param(TOTAL, marks=pytest.mark.slow), PARTIAL])
def test_nodes_agree_with_walks(time) -> None:
    """What is joined over the sky, against rays that have walks of their own, in units of the stated errors."""
    it = scene(time)
    camera = skyscatter.Fisheye(width=40, height=40)
    grid = camera.directions(it.observer).reshape(-1, 3)
    rays = rays_of(it, grid[np.isfinite(grid[:, 0])])
    options = Asked(Orders(tolerance=0.06), parts=True)
    context = eclipsed.prepare(it, rays, WL, options, 1, None)
    assert context.sky is not None
    assert context.sky.once is not None
    # By day nodes with phase functions about the middle of the Sun, not of the crescent, miss 2e-3.
    assert time == TOTAL or context.sky.once.missed.max() < 2e-4
    joined = eclipsed.solve(context, rays, options)
    some = np.arange(7, len(rays.origins), len(rays.origins) // 24)
    own = Rays(rays.origins[some].copy(), rays.directions[some].copy(), rays.numbers[some] + 10**6)
    walked = path.solve(context.tables, own, Asked(Path(samples=2048), parts=True))
    found = Answer(joined.radiance[some], joined.error[some])
    z = z_of(found, walked)
    assert np.sqrt(np.mean(z**2)) < 1.4  # 25 rays, neighbours in part by the same nodes
    assert np.abs(z).max() < 4.5
    assert np.median(found.error / found.radiance) < 0.07
    for name in ("scattered", "ground"):
        # cubics between nodes, which the error holds; in totality light scattered once is nothing at the zenith
        scale = walked.layers[name].max(axis=0)
        np.testing.assert_allclose(joined.layers[name][some], walked.layers[name], rtol=1e-2, atol=3e-3 * scale.max())


def test_few_rays_have_walks_of_their_own() -> None:
    it = scene(TOTAL)
    found = skyscatter.radiance(
        it, it.observer.position, SKY[:2], WL, solver=skyscatter.Orders(tolerance=0.1, max_order=3), parts=True
    )
    assert found.error_kind == "estimated"
    assert (found.error > 0.0).all()
    assert (found.samples > 0).all()
    full = path.solve(tables_of(it), rays_of(it, SKY[:2]), Asked(Path(samples=4096, max_order=3)))
    assert np.abs(z_of(found, full)).max() < 4.0  # as above


def test_a_picture_of_a_partial_phase_is_dimmed_evenly() -> None:
    """Far from totality the sky keeps its look: it is dimmed as the Sun is, but for the slope of the shadow."""
    it = scene(PARTIAL)
    full = it.model_copy(update={"sun": it.sun.model_copy(update={"site": None})})
    camera = skyscatter.Fisheye(width=24, height=24)
    dim, bright = (skyscatter.render(of, camera, WL, solver=skyscatter.Orders(tolerance=0.02)) for of in (it, full))
    eclipse = eclipse_of(it)
    assert eclipse is not None
    ratio = dim.radiance / bright.radiance / eclipse.light(WL)
    # 100 km of air on each side, over which the share of 0.3 changes by 0.03 each way; noise of 2 %
    assert np.nanmin(ratio) > 0.8
    assert np.nanmax(ratio) < 1.25
    assert dim.error is not None


def test_polarised_walks_follow_the_shadow() -> None:
    it = scene(TOTAL)
    here, sky = it.observer.position, SKY[:3]
    marched = skyscatter.radiance(it, here, sky, WL, solver=skyscatter.Path(samples=4096), stokes=True)
    free = skyscatter.radiance(
        it, here, sky, WL, solver=skyscatter.Path(samples=60_000, sampling="free-flight", seed=1), stokes=True
    )
    z = (marched.stokes - free.stokes)[..., :3] / np.hypot(marched.stokes_error, free.stokes_error)[..., :3]
    # 27 numbers, neighbouring wavelengths alike: 4.5 by 16 batches are one in 2000
    assert np.abs(z).max() < 4.5
    # light at 40 degrees comes from the bright horizon all around and is polarised, but less than by day
    degree = np.hypot(free.layers["Q"], free.layers["U"]) / free.radiance
    assert degree[1].max() > 0.05


@pytest.mark.slow
def test_other_seeds_lie_within_the_stated_error() -> None:
    it = scene(TOTAL)
    camera = skyscatter.Fisheye(width=30, height=30)
    one, other = (
        skyscatter.render(it, camera, WL, solver=skyscatter.Orders(tolerance=0.1, seed=seed)) for seed in (1, 2)
    )
    assert one.error is not None
    z = (one.radiance - other.radiance) / np.hypot(one.error, other.error)
    # neighbouring pixels go together: some 60 independent numbers a wavelength
    assert 0.5 < np.sqrt(np.nanmean(z**2)) < 1.4
    again = skyscatter.render(it, camera, WL, solver=skyscatter.Orders(tolerance=0.1, seed=1), threads=2)
    assert np.array_equal(one.radiance, again.radiance, equal_nan=True)


def test_from_space_the_shadow_is_a_spot() -> None:
    it = skyscatter.load_model("earth-simple").scene_at(*PLACE, TOTAL, altitude="36000 km")
    camera = skyscatter.PlanetView(width=24, height=24)
    grid = camera.directions(it.observer)
    image = skyscatter.render(it, camera, WL[1:2], "single")
    down = -grid[..., 2]
    middle = image.radiance[..., 0][down >= np.sort(down[np.isfinite(down)])[-4]]
    around = image.radiance[..., 0][(down > np.cos(np.radians(6.0))) & (down < np.cos(np.radians(4.0)))]
    # pixels of 700 km in the middle of a shadow that is 3500 km wide on each side
    assert middle.max() < 0.3 * np.median(around)


def test_the_command_shows_totality_by_itself(tmp_path) -> None:
    from skyscatter.cli.main import main

    place, size = ["--place", "42.85,-106.32"], ["--size", "48x24", "--view", "landscape:143,360"]
    made = {}
    for time in (TOTAL, "2017-08-22T17:43:50Z"):
        out = tmp_path / f"sky{len(made)}.nc"
        more = ["--wavelengths", "450,550,650", "--tolerance", "0.1", "-o", str(out), "-q"]
        assert main(["sky", "earth-simple", *place, "--time", time, *size, *more]) == 0
        made[time] = skyscatter.SpectralImage.load(out)
    dark, bright = (image.radiance for image in made.values())
    assert np.median(dark[:12] / bright[:12]) < 2e-3
    # a sunset all around: above the horizon redder than high up in every direction
    red = dark[..., 2] / dark[..., 0]
    horizon = int(np.argmax(dark[..., 2].mean(axis=1)))
    assert (red[horizon] > 1.5 * np.median(red[:3])).all()
    exposures = [image.auto_exposure() for image in made.values()]
    assert 6.0 < exposures[1] - exposures[0] < 14.0  # 10 stops are a factor of a thousand


def test_the_sky_in_an_eclipse_of_the_moon() -> None:
    model = skyscatter.load_model("earth-simple")
    camera = skyscatter.Fisheye(width=12, height=12)
    images = [
        skyscatter.render(
            model.scene_at(40.0, -100.0, time, lights=("moon",)), camera, WL, solver=skyscatter.Orders(tolerance=0.05)
        )
        for time in ("2025-03-14T03:30Z", "2025-03-14T06:58Z")
    ]
    full, eclipsed = (np.nansum(image.radiance, axis=(0, 1)) for image in images)
    ratio = eclipsed / full
    # an eclipsed Moon has 1e-5 to 1e-3 of its light; it stands higher than before the eclipse, too
    assert (ratio > 1e-6).all()
    assert (ratio < 3e-3).all()
    assert ratio[2] > 5.0 * ratio[0]


def holding(time: str, *bodies: Body) -> Scene:
    """The same sky with bodies in it."""
    return scene(time).model_copy(update={"bodies": bodies})


def test_light_scattered_once_among_bodies() -> None:
    """By walks among surfaces, whose light comes from points of the crescent, against the quadrature of `single`.

    With all light from the middle of the Sun's disk the latter is off by 0.5 % at the zenith, and by 0.2 % elsewhere.
    """
    it = scene(PARTIAL)
    place, up = it.observer.position, SKY[:3]
    found = skyscatter.radiance(holding(PARTIAL, BURIED), place, up, WL, solver=Path(samples=2048, max_order=1, seed=1))
    once = skyscatter.radiance(it, place, up, WL, solver="single")
    off = np.abs(found.radiance / once.radiance - 1)
    assert off.max() < 3e-4 + 4 * (found.error / found.radiance).max()
    assert (found.error / found.radiance).max() < 5e-4


def test_all_orders_among_bodies_are_those_of_the_sky() -> None:
    it = scene(PARTIAL)
    d = np.array([direction(*at) for at in ((90, 0), (40, 200), (54, 135), (10, 300))])
    found, sky = (
        skyscatter.radiance(one, it.observer.position, d, WL, solver=Path(samples=4096, seed=n))
        for n, one in enumerate((holding(PARTIAL, BURIED), it))
    )
    # 12 numbers, of which neighbouring wavelengths go together: 4 standard errors by 16 batches are one in 1000.
    assert np.abs(z_of(found, sky)).max() < 4.0


@entry
def aim_often(shapes, lamps, k, x, numbers, point, out):
    for n in range(len(numbers)):
        aim(shapes, lamps, k, x, numbers[n, 0], numbers[n, 1], out[n], point)


@pytest.mark.parametrize("time", [PARTIAL, "2017-08-21T17:42:20Z"])
def test_lamps_are_looked_for_where_the_moon_leaves_the_disk_free(time: str) -> None:
    it = holding(time, BURIED)
    table = world_tables(as_surfaces(it, WL), WL).table
    lamps, eclipse = before_moon(table.lamps, it, WL), eclipse_of(it)
    assert eclipse is not None
    found, n = np.empty((20_000, 3)), 20_000
    x = it.observer.position - [0.0, 0.0, it.medium.radius]
    aim_often(table.shapes, lamps, lamps.eclipsed, x, np.random.default_rng(1).random((n, 2)), np.zeros(6), found)
    sun, moon = (v / np.linalg.norm(v) for v in eclipse.vectors)
    away = np.linalg.norm(found - moon, axis=1) / eclipse.moon_radius
    assert np.mean(away < 1 - 1e-3) < 2e-3  # the disk that is drawn is smaller by 0.07 %
    assert (np.linalg.norm(found - sun, axis=1) / eclipse.sun_radius).max() < 1.001
    # Even over what is free, by its area: along the crescent and across it.
    u = (np.arange(2000) + 0.5) / 2000
    ring, turn = np.sqrt(u)[:, None], 2 * np.pi * u
    v = (moon - sun) / np.linalg.norm(moon - sun)
    w = np.cross(sun, v)
    points = (
        eclipse.sun_radius * (ring * np.cos(turn))[..., None] * v
        + eclipse.sun_radius * (ring * np.sin(turn))[..., None] * w
    )
    free = points[np.linalg.norm(points + sun - moon, axis=-1) > eclipse.moon_radius]
    for axis in (v, w):
        seen, true = (found - sun) @ axis / eclipse.sun_radius, free @ axis / eclipse.sun_radius
        # Beside chance the disk that is drawn is smaller by 0.07 %.
        assert abs(seen.mean() - true.mean()) < 2.5 * true.std() / np.sqrt(n) + 7e-4
        assert abs(seen.std() / true.std() - 1) < 0.02


def test_a_small_hole_throws_an_image_of_the_crescent() -> None:
    """A roof with a hole: on the ground below it each place sees a point of the Sun, if the Moon is not before it."""
    it, high, hole = scene(PARTIAL), 40.0, 0.06
    sun = it.sun.direction
    sides = [
        Box(position=(*(np.array(at) + sun[:2] / sun[2] * high).tolist(), high), size=(*size, 0.01))
        for at, size in (
            ((-10.0, 0.0), (20 - hole, 20)), ((10.0, 0.0), (20 - hole, 20)),
            ((0.0, -10.0), (hole, 20 - hole)), ((0.0, 10.0), (hole, 20 - hole)),
        )
    ]  # fmt: skip
    roof = [Body(name=f"roof {n}", shape=side, material=Lambert(albedo=0.0)) for n, side in enumerate(sides)]
    held = holding(PARTIAL, *roof)
    eclipse = eclipse_of(it)
    assert eclipse is not None
    towards, moon = (v / np.linalg.norm(v) for v in eclipse.vectors)
    v = (moon - towards) / np.linalg.norm(moon - towards)
    from_hole = np.array([sun[0] / sun[2] * high, sun[1] / sun[2] * high, high])
    lit = []
    for share in (-0.7, 0.7):  # of the Sun's radius: the free side, and that of the Moon
        ray = sun + share * eclipse.sun_radius * v
        foot = from_hole - ray * (from_hole[2] / ray[2])
        origin = foot + np.array([0.0, 0.0, it.medium.radius + 1.0])
        found = skyscatter.radiance(
            held, origin, [0, 0, -1], WL, solver=Path(samples=4096, max_order=1, seed=3), parts=True
        )
        lit.append(found.layers["reflected"])
    assert np.all(lit[0] > 20 * lit[1])
