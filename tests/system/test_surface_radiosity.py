"""Walks and photons in empty diffuse rooms against radiosity: closed-form view factors and a linear system."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import radiosity
from radiosity import Piece, Seen
from significance import assert_agrees, largest_t
from surface_rooms import mean_ratio, rays_around, room_scene

import skyscatter

WAVELENGTHS = np.array([450.0, 550.0, 650.0])
#: By wavelength: a red and a blue wall, a dark floor, the rest grey.
ALBEDOS = {
    "x-": (0.1, 0.3, 0.8), "x+": (0.7, 0.4, 0.1), "y-": (0.7, 0.7, 0.7), "y+": (0.7, 0.7, 0.7),
    "z-": (0.2, 0.25, 0.3), "z+": (0.8, 0.8, 0.8), "lamp": (0.1, 0.1, 0.1),
}  # fmt: skip
SIZE, LAMP, EYE = (3.0, 2.0, 2.5), (1.0, 0.6, 2.0, 1.4), (1.2, 1.0, 1.1)


@cache
def room() -> tuple[Piece, ...]:
    return radiosity.room(SIZE, dict(ALBEDOS), LAMP, [1.0, 2.0, 3.0])


@cache
def judged(count: int, edge: float) -> tuple[Any, Any, Seen]:
    """Rays that see no lamp, and what they see."""
    origins, directions = rays_around(EYE, 2 * count)
    _, _, piece = radiosity.hit_walls(room(), origins, directions)
    origins, directions = origins[piece != len(room()) - 1][:count], directions[piece != len(room()) - 1][:count]
    return origins, directions, radiosity.look(room(), origins, directions, edge)


def test_path_agrees_with_radiosity() -> None:
    origins, directions, seen = judged(64, 0.5)
    answer = skyscatter.radiance(
        room_scene(room(), WAVELENGTHS), origins, directions, WAVELENGTHS, solver=skyscatter.Path(samples=2048, seed=3)
    )
    # The judge's own error is that of its patches, largest in corners: a bound in the mean over rays, 4 times for one.
    assert_agrees(answer.radiance, seen.radiance, answer.standard_error, slack=4 * seen.error)
    ratio, error = mean_ratio(answer.radiance, seen.radiance, answer.standard_error)
    assert np.all(largest_t(3, 1000) * error < 0.005), error
    np.testing.assert_allclose(ratio, 1.0, atol=0.005)


@pytest.mark.slow
def test_path_agrees_with_radiosity_finely() -> None:
    # Patches of 0.25 m leave 4e-3.
    origins, directions, seen = judged(200, 1 / 6)
    assert seen.error < 2.5e-3
    answer = skyscatter.radiance(
        room_scene(room(), WAVELENGTHS), origins, directions, WAVELENGTHS, solver=skyscatter.Path(samples=8192, seed=3)
    )
    assert_agrees(answer.radiance, seen.radiance, answer.standard_error, slack=4 * seen.error)
    ratio, error = mean_ratio(answer.radiance, seen.radiance, answer.standard_error)
    assert np.all(largest_t(3, 1000) * error < 0.002), error
    np.testing.assert_allclose(ratio, 1.0, atol=0.002)


@pytest.mark.slow
def test_error_bars_of_path_in_a_room_are_their_spread() -> None:
    origins, directions, _ = judged(16, 0.5)
    scene = room_scene(room(), WAVELENGTHS)
    answers = [
        skyscatter.radiance(scene, origins, directions, WAVELENGTHS, solver=skyscatter.Path(samples=64, seed=s))
        for s in range(60)
    ]
    spread = np.std([a.radiance for a in answers], axis=0, ddof=1)
    stated = np.sqrt(np.mean([a.standard_error**2 for a in answers], axis=0))
    # 60 seeds know a standard deviation to 9 %, and there are 48 of them, alike within a ray.
    np.testing.assert_allclose(np.sqrt(np.mean((stated / spread) ** 2)), 1.0, atol=0.1)
    assert np.all(np.abs(np.log(stated / spread)) < 0.45)


@pytest.mark.slow
def test_photons_agree_with_radiosity() -> None:
    """Disks reach over the edges of walls, so the bias is of the first order in the radius R: 2 L(R / 2) - L(R).

    All rays share the photons of a run: judged is the mean over rays, by its spread over seeds.
    """
    origins, directions, seen = judged(64, 0.25)
    scene, expected = room_scene(room(), WAVELENGTHS), seen.radiance.mean(axis=0)

    def means(radius: float, first: int) -> Any:
        runs = []
        for seed in range(first, first + 18):
            solver = skyscatter.Photons(samples=64, photons=20_000, radius=radius, seed=seed)
            light = skyscatter.radiance(scene, origins, directions, WAVELENGTHS, solver=solver).radiance
            runs.append(light.mean(axis=0) / expected)
        return np.array(runs)

    wide, near = means(0.1, 0), means(0.05, 100)
    runs = 2 * near - wide
    error = runs.std(axis=0, ddof=1) / np.sqrt(18)
    assert np.all(error < 0.005), error
    assert_agrees(runs.mean(axis=0), 1.0, error, freedom=17, slack=seen.error)
