"""What `orders` leaves out to be quick changes nothing that it states: wavelengths, moments, stations."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter import Component, Medium, Scene
from skyscatter.media.fields import Exponential
from skyscatter.optics.absorption import TabulatedAbsorption
from skyscatter.solvers import field, spectral, sweeps

WAVELENGTHS = np.linspace(400.0, 710.0, 32)
#: Share of the stated error that leaving out may take at any ray: half of that which stands for what two solutions have
#: in common.
SHARE = 0.4


def sights(scene: Scene) -> Any:
    """Directions over the sphere, many of them near the horizon and near the Sun."""
    random = np.random.default_rng(3)
    height = np.concatenate([random.uniform(-1, 1, 12), np.sin(np.radians(random.uniform(-3, 10, 12)))])
    phi = random.uniform(0, 2 * np.pi, height.size)
    across = np.sqrt(1 - height**2)
    directions = np.stack([across * np.cos(phi), across * np.sin(phi), height], axis=-1)
    near = scene.sun.direction + random.normal(0, 0.1, (8, 3))
    both = np.concatenate([directions, near / np.linalg.norm(near, axis=1, keepdims=True)])
    return both[both @ scene.sun.direction < np.cos(np.radians(1))]


def look(scene: Scene, wavelengths: Any = WAVELENGTHS) -> Any:
    return skyscatter.radiance(scene, scene.observer.position, sights(scene), wavelengths)


def assert_as_before(lean: Any, full: Any) -> None:
    apart = np.abs(lean.radiance - full.radiance)
    assert np.all(apart < SHARE * full.standard_error)
    assert 0.9 < np.median(lean.standard_error / full.standard_error) < 1.1


def chosen(monkeypatch: Any) -> list[int]:
    """Numbers of wavelengths for which fine solutions are made from now on."""
    found: list[int] = []
    needed = spectral.needed

    def counted(*given: Any) -> Any:
        taken = needed(*given)
        found.append(taken.numbers.size)
        return taken

    monkeypatch.setattr(field, "needed", counted)
    return found


@pytest.mark.parametrize(
    ("model", "sun"),
    [("earth", 50.0), *(pytest.param(*case, marks=pytest.mark.slow) for case in
     (("earth", -6.0), ("earth-hazy", 10.0), ("earth-hazy", -8.0), ("earth-maritime", 0.0), ("mars", 20.0)))],
)  # fmt: skip
def test_some_wavelengths_carry_the_others(model: str, sun: float, monkeypatch: Any) -> None:
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=sun)
    count = chosen(monkeypatch)
    lean = look(scene)
    monkeypatch.setattr(spectral, "FEW", 1000)
    assert_as_before(lean, look(scene))
    assert count[0] <= 16
    assert count[1] == WAVELENGTHS.size


def test_wavelengths_within_lines_follow_from_those_that_are_alike(monkeypatch: Any) -> None:
    """A gas with lines of all strengths: what is next in wavelength says nothing, what is alike in depth does."""
    air = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30.0)
    strength = np.random.default_rng(5).permutation(np.geomspace(1e-9, 3e-4, WAVELENGTHS.size))
    table = {"wavelengths": WAVELENGTHS.tolist(), "values": strength.tolist()}
    gas = Component(
        name="gas",
        density=Exponential(scale_height=8e3),
        optics=TabulatedAbsorption.model_validate({"coefficient": table}),
    )
    medium = Medium(planet_radius=air.medium.planet_radius, components=(*air.medium.components, gas))
    scene = air.model_copy(update={"medium": medium})
    count = chosen(monkeypatch)
    lean = look(scene)
    monkeypatch.setattr(spectral, "FEW", 1000)
    assert_as_before(lean, look(scene))
    assert count[0] <= 16


@pytest.mark.parametrize(
    ("model", "sun"), [("earth-hazy", 40.0), pytest.param("earth-hazy", -6.0, marks=pytest.mark.slow)]
)
def test_what_matters_no_more_is_left_out(model: str, sun: float, monkeypatch: Any) -> None:
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=sun)
    few = np.array([420.0, 550.0, 700.0])
    lean = look(scene, few)
    kept: list[int] = []
    of = sweeps.Stage.of.__func__  # type: ignore[attr-defined]

    def counted(cls: Any, problem: Any, numbers: Any) -> Any:
        kept.append(numbers.size)
        return of(cls, problem, numbers)

    monkeypatch.setattr(sweeps.Stage, "of", classmethod(counted))
    look(scene, few)
    assert min(kept) < 0.5 * max(kept)
    for name in ("LEAST_STRENGTH", "LEAST_SHARE"):
        monkeypatch.setattr(sweeps, name, 0.0)
    monkeypatch.setattr(sweeps, "STATION", 0.1)
    kept.clear()
    assert_as_before(lean, look(scene, few))
    assert len(set(kept)) <= 2  # one of each solution, and their fields


def test_with_the_sun_in_the_zenith_the_field_is_as_smooth_as_beside_it() -> None:
    """Titan is small beside its air: along a course the Sun moves by many degrees, and between its nodes first of all.

    Light in the zenith's node falls by the square of the Sun's distance from there, as it does in the nodes beside.
    """
    scene = skyscatter.load_model("titan").scene(sun_elevation_deg=90.0)
    problem = sweeps.make_problem(scene, np.array([550.0]), (0.0, np.radians(60.0)), 0.005)
    found = []
    with ThreadPoolExecutor(1) as pool, pytest.MonkeyPatch.context() as patch:
        first = sweeps.Sweeper(problem, 1).first(pool)
        for station in (0.45, 0.1):
            patch.setattr(sweeps, "STATION", station)
            found.append(sweeps.Sweeper(problem, 1).next(pool, *first)[0][:, :, 0, 0])
    # However finely a course is divided: half of the tolerance anywhere, and much less in the zenith.
    np.testing.assert_allclose(found[0], found[1], rtol=2.5e-3)
    np.testing.assert_allclose(found[0][:, 0], found[1][:, 0], rtol=5e-4)
    square = problem.grid.sun_zenith[:3] ** 2
    low = np.log(found[1][:25, :3])  # below the haze that is seen from above
    slopes = np.diff(low, axis=1) / np.diff(square)
    assert np.all(np.abs(slopes[:, 0] / slopes[:, 1] - 1) < 0.06)  # the next power; 0.13 to 0.2 with a kink there
