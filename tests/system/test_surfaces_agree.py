"""`path` and both estimators of `photons` agree, wavelength by wavelength: a room in fog, a star in dust, a slab.

Photons are gathered in spheres of finite radius R; their bias begins with R^2 where light is smooth, and with R where
walls or the edge of a medium cut spheres off.  So they are run at three radii and extrapolated to none, linearly in
R, for every scene here has such edges; what is compared is the mean light over many rays, whose error is found from
runs with other seeds (all rays share the photons of a run, so that the errors of rays are not independent).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import plain_rooms
import pytest
import radiosity
from asking import asked
from nebulae import flat, parallel_rays
from numpy.typing import NDArray
from plain_rooms import Fog
from radiosity import Piece
from significance import assert_agrees
from surface_rooms import fog_medium, rays_around, room_scene

import skyscatter
from skyscatter.lights import PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.shapes import Sphere
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.space import SpaceScene, View
from skyscatter.surfaces.lamps import PointLamp
from skyscatter.surfaces.materials import Interface, Lambert
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.surfaces.shapes import Box, Rectangle

Array = NDArray[np.float64]
WAVELENGTHS = np.array([450.0, 550.0, 650.0])
#: Extinction as the wavelength to the power -1, so that the spectrum of a walk is not that of its hero.
REDDENING = {"wavelength": 550.0, "angstrom_exponent": 1.0}


@dataclass(frozen=True)
class Case:
    """A scene, rays (ray, 3), and radii of the spheres [m]."""

    scene: Any
    origins: Array
    directions: Array
    radii: tuple[float, float, float]


def fog(extinction: float, albedo: float = 0.9, g: float = 0.7) -> Particles:
    return Particles(
        extinction=extinction, single_scattering_albedo=albedo, phase=HenyeyGreenstein(g=g), **REDDENING
    )  # fmt: skip


def foggy_room() -> Case:
    albedo: dict[str, Any] = dict.fromkeys(("x-", "x+", "y-", "y+", "z-", "z+"), 0.6) | {"x-": (0.1, 0.4, 0.8)}
    pieces = radiosity.room((3.0, 2.0, 2.5), albedo, (1.0, 0.6, 2.0, 1.4), [1.0, 1.0, 1.0])
    origins, directions = rays_around((1.2, 1.0, 1.1), 60)
    _, _, piece = radiosity.hit_walls(pieces, origins, directions)
    dark = piece != len(pieces) - 1
    return Case(room_scene(pieces, WAVELENGTHS, fog(0.6)), origins[dark], directions[dark], (0.3, 0.2, 0.1))


def star_in_dust() -> Case:
    dust = Component(name="dust", density=Sphere(radius=1.0), optics=fog(2.0, 0.7, 0.5))
    star = PointStar(spectrum=flat(1.0))
    scene = SpaceScene(medium=Medium(components=(dust,)), stars=(star,), view=View(distance=100.0))
    return Case(scene, *parallel_rays(np.linspace(0.25, 0.85, 40)), (0.12, 0.08, 0.04))


def slab() -> Case:
    """A slab of fog, 1 m thick, over a floor, under a lamp; all of it bounded by an interface."""
    bodies = (
        Body(name="fog", shape=Box(position=(0, 0, 0.5), size=(6, 6, 1)), material=Interface(), inside="fog"),
        Body(name="floor", shape=Rectangle(position=(0, 0, -0.01), size=(6, 6)), material=Lambert(albedo=0.5)),
    )
    lamp = PointLamp(position=(0.0, 0.0, 2.0), power=1.0)
    scene = SurfaceScene(media=(SurfaceMedium(name="air"), fog_medium("fog", fog(2.0))), bodies=bodies, lamps=(lamp,))
    origins, directions = parallel_rays(np.linspace(-1.2, 1.2, 40))
    return Case(scene, origins, directions, (0.24, 0.16, 0.08))


CASES = {"room": foggy_room, "star": star_in_dust, "slab": slab}


def means(case: Case, solver: str, seeds: int, first: int = 0, **options: Any) -> Array:
    """Mean light over the rays of each run (run, wavelength)."""
    rays = case.origins, case.directions
    runs = [asked(solver, seed=first + seed, **options) for seed in range(seeds)]
    return np.array([skyscatter.radiance(case.scene, *rays, WAVELENGTHS, **run).radiance.mean(axis=0) for run in runs])


def extrapolated(case: Case, estimator: str, seeds: int, **options: Any) -> tuple[Array, Array, Array]:
    """Mean light at no radius, its standard error, and the mean at the largest radius; (wavelength,) each."""
    values = [
        means(case, "photons", seeds, 1000 * k, estimator=estimator, radius=radius, **options)
        for k, radius in enumerate(case.radii)
    ]
    value = np.array([runs.mean(axis=0) for runs in values])
    error = np.array([runs.std(axis=0, ddof=1) for runs in values]) / np.sqrt(seeds)
    # A straight line over R by weighted least squares; all radii but for noise on it.
    weight = 1.0 / (error**2).mean(axis=1)
    design = np.stack([np.ones(3), np.array(case.radii)], axis=1)
    solve = np.linalg.inv(design.T @ (weight[:, None] * design)) @ (design.T * weight)
    return solve[0] @ value, np.sqrt((solve[0] ** 2) @ error**2), value[0]


def agree(
    case: Case, walks: int, seeds: int, samples: int, photons: int, least: float,
    ways: tuple[str, ...] = ("points", "paths", "both"),
) -> None:  # fmt: skip
    """All ways agree within their errors, which are below `least` of the light (three times that for photons)."""
    path = means(case, "path", seeds, samples=walks)
    expected, error = path.mean(axis=0), path.std(axis=0, ddof=1) / np.sqrt(seeds)
    assert np.all(error < least * expected), error / expected
    for estimator in ways:
        value, own, _ = extrapolated(case, estimator, seeds, samples=samples, photons=photons)
        assert np.all(own < 3 * least * expected), (estimator, own / expected)
        assert_agrees(value, expected, np.hypot(own, error), freedom=seeds - 1)


def test_walks_and_photons_agree_in_a_room_of_fog() -> None:
    agree(foggy_room(), walks=64, seeds=8, samples=4, photons=2000, least=0.03, ways=("both",))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seeds"), [("room", 16), ("star", 16), ("slab", 32)])
def test_walks_and_both_estimators_agree_finely(name: str, seeds: int) -> None:
    # Few photons reach the slab: with 16 runs the error of points is as large as is allowed.
    agree(CASES[name](), walks=1024, seeds=seeds, samples=32, photons=20_000, least=0.004)


def test_path_in_a_room_of_fog_agrees_with_plain_walks() -> None:
    # A large lamp, for the plain walks only meet it by chance; grey fog and walls.
    albedo: dict[str, Any] = dict.fromkeys(("x-", "x+", "y-", "y+", "z-", "z+", "lamp"), 0.5)
    pieces: tuple[Piece, ...] = radiosity.room((3.0, 2.0, 2.5), albedo, (0.5, 0.4, 2.5, 1.6), [1.0])
    origins, directions = rays_around((1.2, 1.0, 1.1), 24)
    grey = Fog(0.7, 0.95, 0.6)
    value, error = plain_rooms.walk(pieces, grey, origins, directions, 0, 12_000, 1)
    scene = room_scene(pieces, [550.0], grey)
    answer = skyscatter.radiance(scene, origins, directions, [550.0], solver=skyscatter.Path(samples=1024, seed=2))
    both = np.hypot(answer.standard_error[:, 0], error)
    assert_agrees(answer.radiance[:, 0], value, both)
    ratio = answer.radiance.sum() / value.sum()
    spread = np.sqrt((both**2).sum()) / value.sum()
    assert spread < 0.01
    assert_agrees(ratio, 1.0, spread)


@pytest.mark.slow
def test_star_in_dust_is_the_same_among_surfaces_and_in_space() -> None:
    # The same walks in two worlds: `path` of nebulae, and `path` among surfaces with an interface around the dust.
    case = star_in_dust()
    from skyscatter.surfaces.shapes import Sphere as Ball

    ball = Body(name="dust", shape=Ball(radius=1.0), material=Interface(), inside="dust")
    scene = SurfaceScene(
        media=(SurfaceMedium(name="space"), fog_medium("dust", fog(2.0, 0.7, 0.5))),
        bodies=(ball,),
        lamps=(PointLamp(position=(0.0, 0.0, 0.0), power=1.0),),
    )
    other = Case(scene, case.origins, case.directions, case.radii)
    one, two = (means(c, "path", 16, samples=n) for c, n in ((case, 1024), (other, 4096)))
    error = np.sqrt((one.var(axis=0, ddof=1) + two.var(axis=0, ddof=1)) / 16)
    assert np.all(error < 0.004 * one.mean(axis=0))
    assert_agrees(two.mean(axis=0), one.mean(axis=0), error, freedom=15)
