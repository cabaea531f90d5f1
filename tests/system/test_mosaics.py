"""Mosaics of materials: each cell is what a surface of its own would be there, to walks and to photons."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked
from numpy.typing import NDArray
from plain_rooms import Fog
from significance import assert_agrees
from surface_rooms import fog_medium

import skyscatter
from skyscatter.errors import MissingDataError
from skyscatter.surfaces import (
    AreaLamp,
    Body,
    Conductor,
    Lambert,
    Mirror,
    Mosaic,
    Rectangle,
    SurfaceScene,
    Viewpoint,
)

WAVELENGTHS = [450.0, 550.0, 650.0]
GRASS, SNOW, STEEL = Lambert(albedo="vegetation"), Lambert(albedo=0.9), Conductor(metal="aluminium", roughness=0.3)
#: Middles of four cells of 2 m around (1, 0), and what they are made of; the rest lies around them.
CELLS = {(0.0, 1.0): GRASS, (2.0, 1.0): SNOW, (0.0, -1.0): Mirror(reflectance=0.8), (2.0, -1.0): STEEL}
PICTURE = Mosaic(
    classes=[[0, 1], [2, 3]], materials=tuple(CELLS.values()), rest=SNOW, cell_size="2 m", middle=("1 m", 0.0)
)


def room(*floor: Body, fog: float) -> SurfaceScene:
    """A lamp over a floor and beside a wall, in fog."""
    panel = Body(
        name="panel",
        shape=Rectangle(position=(1, 0, 3), normal=(0, 0, -1), size=(1, 1)),
        material=Lambert(albedo=0),
        lamp=AreaLamp(lumens=800, spectrum="led-4000k"),
    )
    wall = Body(
        name="wall",
        shape=Rectangle(position=(1, 3, 1.5), normal=(0, -1, 0), size=(6, 3)),
        material=Lambert(albedo=0.7),
    )
    return SurfaceScene(
        media=(fog_medium("air", Fog(extinction=fog, albedo=0.9, g=0.5)),),
        bodies=(*floor, wall, panel),
        viewpoint=Viewpoint(position=(1, -4, 2), target=(1, 0, 0)),
    )


def painted(fog: float) -> SurfaceScene:
    """On a floor of 6 m."""
    shape = Rectangle(position=(1, 0, 0), normal=(0, 0, 1), size=(6, 6))
    return room(Body(name="floor", shape=shape, material=PICTURE), fog=fog)


def laid(fog: float) -> SurfaceScene:
    """The same floor of rectangles without a mosaic."""
    pieces = [((x, y), (2.0, 2.0), material) for (x, y), material in CELLS.items()]
    pieces += [((1.0, y), (6.0, 1.0), SNOW) for y in (-2.5, 2.5)] + [((x, 0.0), (1.0, 4.0), SNOW) for x in (-1.5, 3.5)]
    floor = (
        Body(
            name=f"piece {n}",
            shape=Rectangle(corner=(x - a / 2, y - b / 2, 0), first_edge=(a, 0, 0), second_edge=(0, b, 0)),
            material=material,
        )
        for n, ((x, y), (a, b), material) in enumerate(pieces)
    )
    return room(*floor, fog=fog)


def look(scene: SurfaceScene, solver: str, **options: Any) -> Any:
    """At the middle of each cell, past the picture, at the wall and into the fog."""
    targets = np.array(
        [[0.2, 1.1, 0], [1.9, 0.8, 0], [0.3, -0.9, 0], [2.2, -1.2, 0], [3.4, 0.5, 0], [1, 3, 1], [1, 0, 2]]
    )
    d = targets - scene.viewpoint.position
    d /= np.linalg.norm(d, axis=1)[:, None]
    return skyscatter.radiance(scene, scene.viewpoint.position, d, WAVELENGTHS, **asked(solver, **options))


def test_walks_find_the_cells() -> None:
    """As they find the same materials on surfaces of their own."""
    found, other = look(painted(0.1), "path", samples=4096, seed=1), look(laid(0.1), "path", samples=4096, seed=2)
    assert_agrees(found.radiance, other.radiance, np.hypot(found.standard_error, other.standard_error))
    assert found.radiance[1, 1] > 2 * found.radiance[0, 1], "snow is brighter than grass"


@pytest.mark.slow
@pytest.mark.parametrize("direct", [True, False])
def test_photons_find_the_cells(direct: bool) -> None:
    """As walks find them; disks of 5 cm are far from all edges, and smooth light has no bias over them."""
    found = look(painted(0.1), "photons", photons=50_000, radius=0.05, seed=3, direct=direct)
    other = look(laid(0.1), "path", samples=4096, seed=4)
    # Balls in the fog and disks on the floor: the light over 5 cm, 2 m below a lamp of 1 m, is even to 0.3 %.
    assert_agrees(found.radiance, other.radiance, np.hypot(found.standard_error, other.standard_error), slack=3e-3)


def test_a_mosaic_ends_below(tmp_path: Path) -> None:
    """On a ball, of which the other side is the rest; and its classes come from a file."""
    np.save(tmp_path / "classes.npy", np.zeros((4, 4)))
    paint = Mosaic(
        file=str(tmp_path / "classes.npy"),
        materials=[Lambert(albedo=1.0)],
        rest=Lambert(albedo=0.0),
        cell_size=1,
        lowest=0,
    )
    ball = Body(name="ball", shape={"kind": "sphere", "radius": 1.0}, material=paint)
    scene = SurfaceScene(bodies=(ball,), lamps=(skyscatter.surfaces.Surroundings(radiance=1.0),))
    places, d = np.array([[0.3, 0.2, 5.0], [0.3, 0.2, -5.0]]), np.array([[0.0, 0, -1], [0, 0, 1]])
    seen = skyscatter.radiance(scene, places, d, [550.0], solver=skyscatter.Path(samples=64))
    # A convex white body under an even sky is as bright as the sky; without chance but where walks would meet it again.
    np.testing.assert_allclose(seen.radiance[:, 0], [1.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"classes": [[0, 2]]}, "classes = 2.*whole numbers from 0 to 1"),
        ({"classes": [0, 1]}, r"classes = .shape \(2,\)"),
        ({"classes": None}, "give either the classes of all cells, or a file"),
        ({"materials": ()}, "materials = 0"),
        ({"materials": ({"kind": "dielectric"}, SNOW)}, "dielectric"),
        ({"cell_size": 0}, "cell_size"),
    ],
)
def test_what_no_mosaic_can_be(wrong: dict[str, Any], message: str) -> None:
    """Each is one line that names the field."""
    right: dict[str, Any] = {"classes": [[0, 1]], "materials": (GRASS, SNOW), "rest": SNOW, "cell_size": 1.0}
    Mosaic(**right)
    with pytest.raises(ValueError, match=message):
        Mosaic(**(right | wrong))


def test_files_are_read_when_they_are_needed(tmp_path: Path) -> None:
    """A missing one is named; classes that no material has are refused."""
    paint = {"materials": (GRASS,), "rest": SNOW, "cell_size": 1.0}
    with pytest.raises(MissingDataError, match=r"nowhere\.npy"):
        _ = Mosaic(file=str(tmp_path / "nowhere.npy"), **paint).cells
    many: NDArray[np.float64] = np.ones((2, 2))
    np.save(tmp_path / "many.npy", many)
    with pytest.raises(ValueError, match="file = 1"):
        _ = Mosaic(file=str(tmp_path / "many.npy"), **paint).cells
