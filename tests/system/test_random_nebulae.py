"""Identities that hold in any nebula: star and eye that change places, and light that white dust only turns round."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nebulae import GREY, WAVELENGTH, component
from scipy.spatial.transform import Rotation
from significance import assert_agrees

from skyscatter.columns import transmittance
from skyscatter.lights import PointStar
from skyscatter.media.medium import Medium
from skyscatter.media.shapes import GaussianShell, Plummer, PowerLaw, Shell, Sphere
from skyscatter.media.structures import Box, Cone
from skyscatter.media.turbulence import Turbulence
from skyscatter.media.voxels import VoxelGrid
from skyscatter.solvers.options import Path
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View

Array = Any
#: All matter lies within the cube from -1 to 1 m, and so within this radius.
REACH = 1.75
#: Quick scenes, and the hundred.
COUNTS = [4, pytest.param(100, marks=pytest.mark.slow)]


def cloud(rng: np.random.Generator) -> Any:
    """A density in the cube: a shape, one that is carved, turbulent or of two, or voxels."""
    turn = {"axis": tuple(rng.normal(size=3))}
    shapes = (
        Sphere(radius=rng.uniform(0.4, 1)),
        PowerLaw(core=rng.uniform(0.1, 0.3), exponent=2.0, cut=1.0),
        Plummer(radius=0.3, cut=1.0),
        Shell(inner=rng.uniform(0.2, 0.8), outer=1.0),
        GaussianShell(radius=0.6, width=0.05),
        Box(half_sizes=tuple(rng.uniform(0.2, 0.55, 3)), **turn),
    )
    kind, whole = int(rng.integers(5)), shapes[int(rng.integers(len(shapes)))]
    if kind == 1:
        return whole.carved_by(Cone(half_angle_deg=rng.uniform(15, 60), length=2.0, both_sides=True, **turn))
    if kind == 2:
        seed = int(rng.integers(99))
        return whole * Turbulence(outer_scale=0.7, inner_scale=0.15, modes=24, deviation=0.6, seed=seed)
    if kind == 3:
        return Sphere(radius=0.5, position=(0.3, 0.0, -0.3)) * rng.uniform(0.2, 2) + Sphere(radius=0.6)
    if kind == 4:
        values = rng.gamma(0.4, size=(8, 7, 9)) * (rng.random((8, 7, 9)) < 0.7)
        return VoxelGrid(
            values=values, low=(-1, -1, -1), high=(1, 1, 1), interpolation=str(rng.choice(["linear", "nearest"]))
        )
    return whole


def nebula(seed: int, white: bool, star: Array) -> SpaceScene:
    """One or two kinds of dust; its mean depth along lines through the cube's middle is 0.1 to 4."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(int(rng.integers(1, 3))):
        field = cloud(rng)
        ends = REACH * Rotation.random(200, random_state=seed).apply([0.0, 0.0, 1.0])
        extinction = 10 ** rng.uniform(-1, 0.6) / field.column(ends, -ends).mean()
        albedo = 1.0 if white else rng.uniform(0.4, 0.95)
        parts.append(component(field, extinction, albedo, rng.uniform(-0.3, 0.75), name=f"dust-{number}"))
    return SpaceScene(
        medium=Medium(components=tuple(parts)),
        stars=(PointStar(spectrum=GREY, position=tuple(star)),),
        view=View(distance=100.0),
    )


def scattered(scene: SpaceScene, origins: Array, directions: Array, seed: int) -> tuple[float, float]:
    """Mean radiance of scattered light over independent rays, and its standard error, from their spread."""
    answer = radiance(scene, origins, directions, WAVELENGTH, solver=Path(samples=8, seed=seed), parts=True)
    rays = (answer.radiance - answer.layers["direct"])[:, 0]
    return float(rays.mean()), float(rays.std(ddof=1) / np.sqrt(rays.size))


def around(axis: Array, least: float, rng: np.random.Generator, count: int) -> Array:
    """Directions (count, 3), even over the cap in which the cosine to the axis is `least` and more."""
    cosine = 1 - (1 - least) * (np.arange(count) + rng.random(count)) / count
    sine, phi = np.sqrt(1 - cosine**2), rng.uniform(0, 2 * np.pi, count)
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    across = np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(axis, side)
    return cosine[:, None] * axis + sine[:, None] * across


@pytest.mark.slow
@pytest.mark.parametrize("scenes", COUNTS)
def test_star_and_eye_change_places(scenes: int) -> None:
    """A point gathers from all around as much of a star's light as the star's place would of its own (Helmholtz)."""
    rays, ratios, errors = 6000, [], []
    for seed in range(scenes):
        places = 2.5 * Rotation.random(2, random_state=1000 + seed).apply([0.0, 0.0, 1.0])
        there = []
        for star, eye in (places, places[::-1]):
            rng = np.random.default_rng([seed, int(star[0] > eye[0])])
            directions = around(-eye / np.linalg.norm(eye), np.sqrt(1 - (REACH / 2.5) ** 2), rng, rays)
            there.append(scattered(nebula(seed, False, star), np.broadcast_to(eye, directions.shape), directions, seed))
        (forth, a), (back, b) = there
        ratios.append(forth / back)
        errors.append(forth / back * np.hypot(a / forth, b / back))
    check(ratios, errors, rays)


@pytest.mark.parametrize("scenes", COUNTS)
@pytest.mark.slow
def test_what_a_star_sends_out_leaves_white_dust(scenes: int) -> None:
    """Straight, which is an integral, or scattered: over random lines through a sphere around all."""
    rays, shares, errors = 6000, [], []
    for seed in range(scenes):
        rng = np.random.default_rng([seed, 7])
        star = rng.uniform(-0.5, 0.5, 3)
        scene = nebula(seed, True, star)
        out = around(np.array([0.0, 0.0, 1.0]), -1.0, rng, 4000)
        straight = transmittance(scene, star, star + 4 * out, WAVELENGTH)[:, 0]
        # Lines: even over directions, and over the disk of their own across it.
        directions = around(np.array([0.0, 0.0, 1.0]), -1.0, rng, rays)
        side = np.cross(directions, rng.normal(size=directions.shape))
        side /= np.linalg.norm(side, axis=1)[:, None]
        offset = REACH * np.sqrt(rng.permutation((np.arange(rays) + rng.random(rays)) / rays))
        light, error = scattered(scene, offset[:, None] * side - 4 * directions, directions, seed)
        area = 4 * np.pi * np.pi * REACH**2
        shares.append(straight.mean() + area * light)
        errors.append(np.hypot(straight.std() / np.sqrt(len(out)), area * error))
    check(shares, errors, rays)


def check(values: Any, errors: Any, rays: int) -> None:
    """Each is 1 within its error, and their mean is, which sees what the single ones cannot."""
    print(np.round(values, 4), np.round(errors, 4))
    assert_agrees(values, 1.0, errors, freedom=rays - 1)
    mean, error = np.mean(values), np.sqrt(np.mean(np.square(errors)) / len(values))
    print(f"mean {mean:.4f} +- {error:.4f}")
    assert error < (0.04 if len(values) < 10 else 7e-3)
    assert_agrees(mean, 1.0, error, freedom=rays - 1)
