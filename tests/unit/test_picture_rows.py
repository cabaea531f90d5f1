"""Long rows of a picture are joined from nodes: what that costs, against every ray solved by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.solvers.rows import FEWEST, MISSED, view_rows
from skyscatter.solvers.sequence import field_for
from skyscatter.solvers.sweeps import view

WAVELENGTHS = [400, 550, 700]
#: That of the rows, the default; the fields are solved coarsely, which is quick and changes nothing here.
TOLERANCE = 5e-3
CAMERA = skyscatter.Panorama(width=360, height=24)


def parts(model: str, elevation: float, altitude: float = 0.0) -> tuple[Any, Any]:
    scene = skyscatter.load_model(model).scene(sun_elevation_deg=elevation, sun_azimuth_deg=137, altitude=altitude)
    field = field_for([scene], CAMERA, WAVELENGTHS, tolerance=0.02)
    table = field.at(scene.sun)
    directions = CAMERA.directions(scene.observer).reshape(-1, 3)
    origins = np.tile(scene.observer.position, (len(directions), 1))
    arguments = (field.fine.problem, field.fine.loaded, table, origins, directions)
    return view_rows(*arguments, TOLERANCE), view(*arguments)


QUICK = (("earth-simple", -5.0), ("earth-simple", 60.0))
SLOW = [(m, e) for m in ("earth-simple", "earth-hazy", "mars", "titan") for e in (-5.0, 0.0, 4.0, 60.0, 90.0)]


@pytest.mark.parametrize(
    ("model", "elevation"), [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in SLOW]
)
def test_rows_are_as_rays_by_themselves(model: str, elevation: float) -> None:
    """No more than every other node may miss where the light has an edge, a twentieth of that in the mean square."""
    quick, slow = parts(model, elevation)
    one, other = (part[0][:, 0] + part[1][:, 0] + part[2] for part in (quick, slow))
    off = np.abs(one - other) / np.where(other > 1e-6 * other.max(), other, np.inf)
    assert off.max() < MISSED * TOLERANCE
    assert np.sqrt(np.mean(off**2)) < MISSED * TOLERANCE / 20


@pytest.mark.parametrize("elevation", [pytest.param(0.1, marks=pytest.mark.slow), 30.0])
def test_the_disk_has_its_edge(elevation: float) -> None:
    quick, slow = parts("earth-simple", elevation)
    np.testing.assert_allclose(quick[3], slow[3], rtol=1e-6, atol=1e-12 * slow[3].max())


@pytest.mark.slow
def test_from_orbit() -> None:
    quick, slow = parts("earth-simple", 20.0, altitude=400e3)
    one, other = (part[0][:, 0] + part[1][:, 0] + part[2] for part in (quick, slow))
    assert np.abs(one - other).max() < 1e-4 * other.max()


def test_short_rows_and_other_places_are_solved_as_they_are() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=20)
    field = field_for([scene], CAMERA, WAVELENGTHS, tolerance=0.02)
    directions = CAMERA.directions(scene.observer)[3, : FEWEST - 1]
    apart = CAMERA.directions(scene.observer)[3]
    origins = np.tile(scene.observer.position, (len(apart), 1))
    moved = origins + np.linspace(0, 9, len(apart))[:, None] * [0.0, 0.0, 1.0]
    for places, rays in ((origins[: len(directions)], directions), (moved, apart)):
        table, places = field.at(scene.sun), np.ascontiguousarray(places)
        arguments = (field.fine.problem, field.fine.loaded, table, places, rays.copy())
        for quick, slow in zip(view_rows(*arguments, TOLERANCE), view(*arguments), strict=True):
            np.testing.assert_array_equal(quick, slow)
