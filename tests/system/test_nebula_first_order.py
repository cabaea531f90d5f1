"""Light scattered once: the power that walks find, in every way to a transmittance, against the exact integral."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from asking import asked
from nebulae import GREY, Array, component

import skyscatter
from skyscatter.lights import PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import PowerLaw, Sphere
from skyscatter.media.structures import Cone
from skyscatter.media.turbulence import Turbulence
from skyscatter.media.voxels import VoxelGrid
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View

WAYS = ("quadrature", "ratio", "residual-ratio")
#: Shipped nebulae in which a star lights dust.
NEBULAE = ("dusty-disk", "hii-region", "reflection-nebula", "ring-nebula", "star-in-dust", "turbulent-pillar")
WAVELENGTH = (550.0,)
#: Runs of scenes that need more than 16: three errors from the spread of those are exceeded by one case in a hundred.
SEEDS = {"clumpy": 64}


def hollow(depth: float) -> SpaceScene:
    """Star-in-dust in small and in voxels: dust that falls outwards, a cleared double cone, a star at its tip."""
    ball = PowerLaw(core=0.3, exponent=2.0, cut=1.0)
    cone = Cone(half_angle_deg=28.0, length=1.2, both_sides=True, axis=(0.2, 0.5, 1.0))
    return lit(VoxelGrid.from_field(ball.carved_by(cone), 48), depth / 0.3)


def clumpy(depth: float) -> SpaceScene:
    """A ball of turbulent dust around a star."""
    return lit(Sphere(radius=1.0) * Turbulence(outer_scale=0.7, inner_scale=0.1, modes=32, deviation=0.6), depth)


def lit(field: object, extinction: float) -> SpaceScene:
    medium = Medium(components=(component(field, extinction, 0.6, 0.5),))
    return SpaceScene(medium=medium, stars=(PointStar(spectrum=GREY),), view=View(distance=100.0))


@cache
def scene_of(name: str) -> SpaceScene:
    own = {"hollow": hollow(4.0), "clumpy": clumpy(3.0)}
    return own[name] if name in own else skyscatter.load_model(name).scene()


def parallel(scene: SpaceScene, n: int, share: float) -> tuple[Array, Array]:
    """Origins and directions of n x n rays, slanting, one in every cell of a square over a share of the medium."""
    low, high = (np.array(edge) for edge in zip(*(field.bounds for field in scene.medium.fields), strict=True))
    low, high = low.min(axis=0), high.max(axis=0)
    size = float((high - low).max())
    d = np.array([0.3, 0.5, -0.8]) / np.linalg.norm([0.3, 0.5, -0.8])
    across = np.cross(d, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    cell = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2)
    u = ((cell + np.random.default_rng(1).random(cell.shape)) / n - 0.5) * share * size
    # Around the star, of which the light is.
    middle = np.array(scene.stars[0].position) if scene.stars else 0.5 * (low + high)
    middle = np.clip(middle, low, high)
    origins = middle + u[:, :1] * across + u[:, 1:] * np.cross(d, across) - 3 * size * d
    return origins, np.broadcast_to(d, origins.shape)


def check_first_order(name: str, way: str, samples: int, n: int, share: float, most: float = 0.005) -> None:
    scene = scene_of(name)
    rays = parallel(scene, n, share)
    exact = float(radiance(scene, *rays, WAVELENGTH, solver="single", parts=True).layers["scattered"].sum())
    options = {"samples": samples, "max_order": 1, "parts": True, "transmittance": way}
    runs = np.array(
        [
            radiance(scene, *rays, WAVELENGTH, **asked("path", seed=seed, **options)).layers["scattered"].sum()
            for seed in range(SEEDS.get(name, 16))
        ]
    )
    value, error = runs.mean() / exact, runs.std(ddof=1) / np.sqrt(len(runs)) / exact
    print(f"{name} {way}: {value:.5f} +- {error:.5f} of the exact integral")
    # Small enough to see half a per cent, and within three standard errors of it, by the spread of the runs.
    assert error < most
    assert abs(value - 1) < 3 * error


@pytest.mark.parametrize(
    ("name", "way", "samples"),
    [
        ("hollow", "quadrature", 64),
        pytest.param("hollow", "ratio", 1024, marks=pytest.mark.slow),
        pytest.param("hollow", "residual-ratio", 1024, marks=pytest.mark.slow),
        pytest.param("star-in-dust", "quadrature", 128, marks=pytest.mark.slow),
    ],
)
def test_first_order_of_walks_is_the_exact_integral(name: str, way: str, samples: int) -> None:
    check_first_order(name, way, samples, 10, 0.6)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["clumpy", *NEBULAE])
def test_first_order_of_shipped_nebulae(name: str, way: str) -> None:
    """In the dusty disk to 3 %: light reaches a skin of its inner rim that is thinner than any stratum of a ray."""
    samples = {"star-in-dust": 2048, "dusty-disk": 1024}.get(name, 256)
    check_first_order(name, way, samples, 10, 0.6, 0.03 if name == "dusty-disk" else 0.005)


@pytest.mark.parametrize("name", ["dusty-disk", pytest.param("star-in-dust", marks=pytest.mark.slow)])
def test_light_that_the_guide_does_not_resolve_is_found(name: str) -> None:
    """Single rays past the hole around the star, of 25 au in the disk: cells of the guide are wider than its lit rim.

    They were 15 to 65 % too low in every run, with a spread of 5 %.
    """
    scene = scene_of(name)
    origins, directions = parallel(scene, 10, 0.6)
    exact = radiance(scene, origins, directions, WAVELENGTH, solver="single", parts=True).layers["scattered"][:, 0]
    chosen = np.argsort(-exact)[:8]
    rays = origins[chosen], directions[chosen]
    options = {"samples": 1024, "max_order": 1, "parts": True}
    answers = [radiance(scene, *rays, WAVELENGTH, **asked("path", seed=seed, **options)) for seed in range(8)]
    runs = np.array([answer.layers["scattered"][:, 0] for answer in answers]) / exact[chosen]
    print(f"{name}: {runs.mean(axis=0)}, spread {runs.std(axis=0, ddof=1)}")
    assert np.all(runs.std(axis=0, ddof=1) < 0.3)
    # The mean of eight, by their own spread: |t| of 8 rays with 7 degrees of freedom is below 4.5 in 98 % of cases.
    assert np.all(np.abs(runs.mean(axis=0) - 1) < 4.5 * runs.std(axis=0, ddof=1) / np.sqrt(8))
