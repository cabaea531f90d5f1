"""Room around points: the nearest surface by brute force, and balls that no surface cuts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from surface_bases import pack, sampled, shoot, sphere_points, unit

from skyscatter.kernels.surfaces.clearance import FILLED, SMALL, empty_balls, make_ball_scratch
from skyscatter.kernels.surfaces.tables import ShapeTable
from skyscatter.surfaces.meshes import Mesh, Turned
from skyscatter.surfaces.shapes import Box, Disk, Plane, Rectangle, Sphere

SHAPES = {
    "sphere": (Sphere(position=(0.1, 0.2, -0.1), radius=0.5),),
    "plane": (Plane(position=(0.2, 0, 0), normal=(1, 2, 3)),),
    "rectangle": (Rectangle(position=(0, 0.1, 0), normal=(1, -1, 2), size=(0.7, 0.3)),),
    "disk": (Disk(position=(0, 0.1, 0), normal=(1, -1, 2), radius=0.6, inner_radius=0.2),),
    "box": (Box(position=(0.1, 0, 0), size=(0.5, 0.8, 0.3), turn_deg=30.0),),
    "mesh": (Mesh(vertices=((0, 0, 0), (0.7, 0, 0), (0, 0.5, 0.2), (0.3, 0.2, 0.9)), faces=((0, 1, 2), (0, 3, 1))),),
    "turned": (Turned(profile=((0, -0.4), (0.5, -0.4), (0.3, 0.1), (0, 0.4))),),
    # More items than are tested one by one, so that the tree is walked.
    "many": tuple(Sphere(position=tuple(x), radius=0.1) for x in np.random.default_rng(2).uniform(-1, 1, (40, 3))),
}  # fmt: skip


def balls(table: ShapeTable, places: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    centres, radii = np.zeros_like(places), np.zeros(len(places))
    empty_balls(table, places, radius, make_ball_scratch(), centres, radii)
    return centres, radii


def apart(table: ShapeTable, places: np.ndarray) -> np.ndarray:
    """Distances of places from a cloud of points on all items: never less than the true ones."""
    _, points, _ = sampled(table, np.random.default_rng(3), 400_000)
    return np.asarray(cKDTree(points).query(places)[0])


@pytest.mark.parametrize("name", SHAPES)
def test_no_surface_cuts_a_ball_and_none_lies_between(name: str) -> None:
    table = pack(*SHAPES[name])
    places = np.random.default_rng(1).uniform(-1, 1, (300, 3))
    radius = 0.4
    centres, radii = balls(table, places, radius)
    assert (radii > 0).all()
    assert (radii <= radius).all()
    if name == "plane":
        p = table.parameters[0]
        near = abs((centres - p[:3]) @ p[3:6])
    else:
        near = apart(table, centres)
    assert (radii <= near + 1e-9).all()
    still = np.all(centres == places, axis=1)
    short = still & (radii < radius)
    # Up to 2.5 m2 hold 400 000 points, so that 30 are expected within 0.8 cm of any place, 8 in a quarter of that disk:
    # by the triangle inequality no distance is wrong by more, and where the foot is within a face by its square / 2 h.
    # A ball fills so much of its room, all of it where it would else become too small.
    room = np.maximum(FILLED * near, np.minimum(near, SMALL * radius))
    excess = room[short] - radii[short]
    assert excess.max(initial=0.0) < 0.008
    assert np.median(excess) < 0.008**2 / (2 * SMALL * radius)
    assert (radii[still] >= SMALL * radius * (1 - 1e-6)).mean() > 0.9
    # The way to the centre is free.
    way = centres[~still] - places[~still]
    length = np.linalg.norm(way, axis=1)
    assert (shoot(table, places[~still], way / length[:, None], length).item < 0).mean() > 0.99
    assert length.max(initial=0.0) < 2 * radius


def test_corners_slits_and_edges() -> None:
    """As large as there is room for: all of it in a corner, half of the width in a slit, on the own side of a door."""
    walls = (Plane(normal=(1, 0, 0)), Plane(normal=(0, 1, 0)), Plane(normal=(0, 0, 1)))
    places = np.array([[0.01, 0.02, 0.03], [0.3, 0.001, 0.2], [0.02, 0.4, 0.5]])
    centres, radii = balls(pack(*walls), places, 0.2)
    assert (radii >= SMALL * 0.2 * (1 - 1e-6)).all()
    np.testing.assert_array_equal(np.sort(centres, axis=1)[:, 0] >= radii * (1 - 1e-9), True)
    slit = (Plane(normal=(1, 0, 0)), Plane(position=(0.06, 0, 0), normal=(-1, 0, 0)))
    centres, radii = balls(pack(*slit), np.array([[0.01, 0, 0], [0.055, 0, 0]]), 0.2)
    np.testing.assert_allclose(radii, 0.03, rtol=1e-5)
    np.testing.assert_allclose(centres[:, 0], 0.03, rtol=1e-5)
    door = (Rectangle(normal=(1, 0, 0), size=(1, 1)),)
    places = sphere_points(np.random.default_rng(4), 200) * [0.01, 0.55, 0.45]
    centres, radii = balls(pack(*door), places, 0.2)
    beside = abs(places[:, 1]) < 0.49
    np.testing.assert_array_equal(np.sign(centres[beside, 0]), np.sign(places[beside, 0]))
    assert (radii >= SMALL * 0.2 * (1 - 1e-6)).all()


def test_no_ball_is_smaller_than_where_it_began() -> None:
    """Between planes at 20 degrees a ball cannot be moved out of the edge at once; it stays as large as it was."""
    a = np.radians(10.0)
    wedge = (Plane(normal=unit(np.sin(a), np.cos(a), 0)), Plane(normal=unit(np.sin(a), -np.cos(a), 0)))
    places = np.array([[0.05, 0.0, 0.0], [0.1, 0.01, 0.3]])
    _, radii = balls(pack(*wedge), places, 0.2)
    assert (radii >= places[:, 0] * np.sin(a) - abs(places[:, 1]) * np.cos(a) - 1e-12).all()
