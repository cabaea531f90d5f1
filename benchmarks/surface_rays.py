"""What a ray costs: nanoseconds to the nearest hit among shapes and triangles, and from when on a tree pays.

Rays along isotropic lines through a ball around everything, one thread, processor time.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from common import machine, parser, report, seconds, table, versions

from skyscatter.kernels.surfaces import rays
from skyscatter.surfaces import packing
from skyscatter.surfaces.materials import Lambert
from skyscatter.surfaces.meshes import Mesh
from skyscatter.surfaces.shapes import Box, Rectangle, Sphere


def ball(triangles: int) -> Mesh:
    """A unit ball of at least so many triangles, in rings."""
    rings = max(int(np.ceil(np.sqrt(triangles / 4))), 3)
    around = 2 * rings
    polar = np.pi * np.arange(rings + 1) / rings
    azimuth = 2 * np.pi * np.arange(around) / around
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    vertices = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine + 0 * azimuth], axis=-1).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rings), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate([np.column_stack([a, a + around, b]), np.column_stack([b, a + around, b + around])])
    return Mesh(vertices=vertices, faces=faces)


def room() -> list[Any]:
    """Five walls, a lamp, two boxes and two balls: ten items."""
    walls = [
        Rectangle(position=p, normal=n, size=(2.0, 2.0))
        for p, n in (
            ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)),
            ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)),
            ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
            ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
            ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)),
        )
    ]
    return [
        *walls,
        Rectangle(position=(0.0, 0.0, 0.99), normal=(0.0, 0.0, -1.0), size=(0.5, 0.5)),
        Box(position=(-0.4, 0.4, -0.4), size=(0.6, 0.6, 1.2), turn_deg=20.0),
        Box(position=(0.4, -0.2, -0.7), size=(0.6, 0.6, 0.6), turn_deg=-17.0),
        Sphere(position=(0.4, -0.2, -0.2), radius=0.2),
        Sphere(position=(-0.5, -0.5, -0.8), radius=0.2),
    ]


def crowd(count: int) -> list[Any]:
    """Small balls here and there."""
    rng = np.random.default_rng(count)
    return [Sphere(position=tuple(rng.uniform(-1, 1, 3)), radius=0.5 * count ** (-1 / 3)) for _ in range(count)]


def lines(count: int, radius: float) -> tuple[Any, Any]:
    """Isotropic lines through a ball."""
    rng = np.random.default_rng(1)
    starts, turn = rng.normal(size=(2, count, 3))
    starts /= np.linalg.norm(starts, axis=1, keepdims=True)
    directions = turn / np.linalg.norm(turn, axis=1, keepdims=True) - starts
    return radius * starts, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def processor_seconds(function: Callable[[], Any], repeats: int) -> float:
    """Median of the processor time [s] of several calls."""
    runs = []
    for _ in range(max(repeats, 1)):
        start = time.process_time()
        function()
        runs.append(time.process_time() - start)
    return statistics.median(runs)


def measure(shapes: list[Any], count: int, repeats: int, tree_from: int | None = None) -> tuple[float, float, float]:
    """Nanoseconds a ray to the nearest hit, and whether anything is in the way; time to build the table [s]."""
    usual = packing.TREE_FROM
    packing.TREE_FROM = usual if tree_from is None else tree_from
    built, made = seconds(lambda: packing.pack_shapes([(s, 0, -1, -1) for s in shapes], [Lambert()]))
    packing.TREE_FROM = usual
    middle, radius = packing.bounding_sphere(shapes)
    origins, directions = lines(count, radius)
    origins += middle
    far, none = np.full(count, np.inf), np.full(count, -1)
    items, hits, result = np.zeros(count, np.int64), np.zeros((count, 4)), np.zeros(count, bool)
    few = slice(2)
    rays.closest_hits(made, origins[few], directions[few], far, none, items, hits)
    rays.are_blocked(made, origins[few], directions[few], far, none, none, result)
    near = processor_seconds(lambda: rays.closest_hits(made, origins, directions, far, none, items, hits), repeats)
    any_ = processor_seconds(lambda: rays.are_blocked(made, origins, directions, far, none, none, result), repeats)
    return 1e9 * near / count, 1e9 * any_ / count, built


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--rays", type=int, default=200_000)
    given = options.parse_args()
    where = machine()
    rows = []
    scenes: dict[str, list[Any]] = {
        "a sphere": [Sphere()],
        "a turned box": [Box(turn_deg=30.0)],
        "a room of ten items": room(),
        "a mesh of 1,000 triangles": [ball(1000)],
        "a mesh of 100,000 triangles": [ball(100_000)],
        "a mesh of 1,000,000 triangles": [ball(1_000_000)],
    }
    packing.pack_shapes([(ball(20), 0, -1, -1)], [Lambert()])  # loads the kernel that builds trees
    for name, shapes in scenes.items():
        near, any_, built = measure(shapes, given.rays, given.repeats)
        rows.append([name, int(near), int(any_), built])
    crossing = []
    for count in (4, 8, 12, 16, 24, 32, 64):
        balls = crowd(count)
        listed, _, _ = measure(balls, given.rays, given.repeats, 10**9)
        planted, _, _ = measure(balls, given.rays, given.repeats, 1)
        crossing.append([count, int(listed), int(planted), listed / planted])
    blocks = [
        table(["scene", "nearest hit [ns]", "anything in the way [ns]", "table built [s]"], rows),
        "Balls here and there, one by one and through the tree; the tree is used from "
        f"{packing.TREE_FROM} items with an end on:",
        table(["balls", "one by one [ns]", "tree [ns]", "ratio"], crossing),
    ]
    report(
        "surface-rays", where, versions("skyscatter", "numba", "numpy"), blocks, ["surface_rays.py", *sys.argv[1:]],
        given.write,
    )  # fmt: skip


if __name__ == "__main__":
    main()
