"""Identities that hold in any room: light that is the same everywhere, and lamp and eye that change places."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked
from significance import assert_agrees, assert_mean_of_runs, runs_of_power
from walk_scenes import WAVELENGTHS, directions, fog, medium, room

import skyscatter
from skyscatter.surfaces.lamps import AreaLamp
from skyscatter.surfaces.materials import Conductor, Dielectric, Lambert, Mirror
from skyscatter.surfaces.scene import Body, SurfaceScene
from skyscatter.surfaces.shapes import Box, Rectangle, Sphere

Array = Any
GREEN = WAVELENGTHS[1:2]
#: A metal that keeps nothing.
SILVERY = {"n": 1e-9, "k": 1.0}
#: Walks of glass, metal and mirrors among each other are long: rays that look into all that count every kind.
LOOKS = directions(48)


def things(rng: np.random.Generator) -> tuple[list[Body], float]:
    """Bodies in corners of the room that neither shine nor keep light, and the index of the glass."""
    corners = rng.permutation(8)[:4]
    bodies = []
    for number, corner in enumerate(corners):
        middle = tuple(0.45 * (1 if corner >> k & 1 else -1) for k in range(3))
        size = rng.uniform(0.15, 0.35)
        turn = {"axis": tuple(rng.normal(size=3))}
        shape = Sphere(position=middle, radius=size) if rng.random() < 0.5 else None
        shape = shape or Box(position=middle, size=(1.1 * size, 1.2 * size, size), **turn)
        roughness = float(rng.choice([0.0, 0.1, 0.3, 1.0]))
        material: Any = (
            Dielectric(roughness=roughness), Dielectric(roughness=rng.uniform(0.05, 1.0)), Mirror(),
            Conductor(roughness=roughness, **SILVERY),
        )[number]  # fmt: skip
        inside = {"inside": "glass"} if isinstance(material, Dielectric) else {}
        bodies.append(Body(name=f"thing {number}", shape=shape, material=material, **inside))
    return bodies, float(rng.uniform(1.1, 2.5))


def furnace(seed: int) -> SurfaceScene:
    """Walls that shine with what they keep, white fog, glass, mirrors: the radiance is 1 wherever the index is."""
    rng = np.random.default_rng(seed)
    albedo, (bodies, index) = rng.uniform(0.0, 0.8), things(rng)
    air = medium("air", fog(rng.uniform(0.05, 2.0), 1.0, rng.uniform(-0.3, 0.8)))
    return SurfaceScene(
        media=(air, medium("glass", index=index)), bodies=(*room(1.0, albedo, 1.0 - albedo), *bodies)
    )  # fmt: skip


@pytest.mark.parametrize(("first", "scenes"), [(0, 6), pytest.param(100, 36, marks=pytest.mark.slow)])
def test_furnace_in_random_rooms_by_walks(first: int, scenes: int) -> None:
    """What glass and metal keep of it is below 1e-3 a time (the tables of `surfaces.facets`), of some such a walk."""
    values, errors = [], []
    for seed in range(first, first + scenes):
        answer = skyscatter.radiance(
            furnace(seed), [[0.02, 0.01, 0.03]], LOOKS, GREEN, solver=skyscatter.Path(samples=128, seed=seed)
        )
        values.append(answer.radiance.mean())
        errors.append(np.sqrt((answer.standard_error**2).sum()) / len(LOOKS))
    print(np.round(values, 4), np.round(errors, 4))
    # Rays are 48 independent ones of 16 batches each.
    assert_agrees(values, 1.0, errors, freedom=48 * 15, slack=2e-3)
    mean, error = np.mean(values), np.sqrt(np.sum(np.square(errors))) / scenes
    assert error < (4e-3 if scenes < 10 else 2e-3)
    assert_agrees(mean, 1.0, error, freedom=1000, slack=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(200 + k for k in range(8))])
def test_furnace_in_random_rooms_by_photons(seed: int) -> None:
    """The same; light straight from the walls by photons, for glass has no lamps to aim at."""

    def run(number: int) -> float:
        options: dict[str, Any] = {"samples": 2, "photons": 1 << 13, "radius": 0.1, "direct": False}
        answer = skyscatter.radiance(
            furnace(seed), [[0.02, 0.01, 0.03]], LOOKS, GREEN, **asked("photons", seed=number, **options)
        )
        return float(answer.radiance.mean())

    runs = runs_of_power(run, 3e-3)
    print(runs.mean(), runs.std() / np.sqrt(len(runs)), len(runs))
    assert_mean_of_runs(runs, 1.0, 3e-3, 2e-3)


def exchange(seed: int, back: bool) -> SurfaceScene:
    """A room with two black plates of one size; one of them shines with 1."""
    rng = np.random.default_rng(seed)
    albedo, (bodies, index) = rng.uniform(0.3, 0.8), things(rng)
    air = medium("air", fog(rng.uniform(0.1, 1.5), 0.9, rng.uniform(0.0, 0.8)))
    plates = [
        Body(
            name=f"plate {k}", shape=Rectangle(position=place, normal=normal, size=(0.5, 0.5)),
            material=Lambert(albedo=0.0), lamp=AreaLamp(radiance=1.0) if (k == 1) != back else None,
        )
        for k, (place, normal) in enumerate((((0.1, 0.0, 0.97), (0, 0, -1)), ((0.97, 0.1, 0.0), (-1, 0, 0))))
    ]  # fmt: skip
    return SurfaceScene(
        media=(air, medium("glass", index=index)), bodies=(*room(1.0, albedo), *bodies, *plates)
    )  # fmt: skip


def received(scene: SurfaceScene, plate: int, seed: int, count: int) -> tuple[float, float]:
    """Mean irradiance over pi of a plate, from rays that start on it by the cosine, and its standard error."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-0.25, 0.25, (count, 2))
    d = directions(count, seed + 1)
    normal = np.array([0.0, 0.0, -1.0] if plate == 0 else [-1.0, 0.0, 0.0])
    d = d + normal
    d /= np.linalg.norm(d, axis=1)[:, None]
    place = np.array([0.1, 0.0, 0.97] if plate == 0 else [0.97, 0.1, 0.0])
    across = np.eye(3)[[0, 1] if plate == 0 else [1, 2]]
    # 1 um from the plate: not on it, so that no one asks on which side the ray begins.
    o = place + u @ across + 1e-6 * normal
    answer = skyscatter.radiance(scene, o, d, GREEN, solver=skyscatter.Path(samples=16, seed=seed)).radiance[:, 0]
    return float(answer.mean()), float(answer.std(ddof=1) / np.sqrt(count))


@pytest.mark.slow
@pytest.mark.parametrize(("first", "scenes", "count"), [(0, 3, 4000), (50, 24, 16_000)])
@pytest.mark.filterwarnings("ignore:lamps are so small")
def test_lamp_and_eye_change_places(first: int, scenes: int, count: int) -> None:
    """The flux between two equal plates is the same both ways, whatever lies between (Helmholtz)."""
    forth, back = (
        np.array([received(exchange(seed, way), int(way), seed, count) for seed in range(first, first + scenes)])
        for way in (False, True)
    )
    ratio = forth[:, 0] / back[:, 0]
    error = ratio * np.hypot(forth[:, 1] / forth[:, 0], back[:, 1] / back[:, 0])
    print(np.round(ratio, 3), np.round(error, 3))
    assert_agrees(ratio, 1.0, error, freedom=count)
    whole = np.sqrt(np.mean(error**2) / scenes)
    assert whole < (0.04 if scenes < 10 else 0.01)
    assert_agrees(ratio.mean(), 1.0, whole, freedom=count)
