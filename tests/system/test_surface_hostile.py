"""Scenes that ask for trouble: each gives the right picture, or one clear line about what is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asking import asked
from bases import complaint
from numpy.typing import NDArray
from plain_rooms import Fog
from significance import assert_agrees
from surface_rooms import fog_medium, rays_around

import skyscatter
from skyscatter.errors import DomainError
from skyscatter.solvers.base import Answer
from skyscatter.surfaces.lamps import AreaLamp, PointLamp, Surroundings
from skyscatter.surfaces.materials import Dielectric, Interface, Lambert
from skyscatter.surfaces.meshes import Mesh
from skyscatter.surfaces.scene import Body, SurfaceMedium, SurfaceScene
from skyscatter.surfaces.shapes import Box, Plane, Rectangle, Sphere

Array = NDArray[np.float64]
WAVELENGTHS = np.array([450.0, 650.0])
AIR = SurfaceMedium(name="air")
GLASS = SurfaceMedium(name="glass", index=1.5)
#: Light from all around: with nothing that absorbs, every ray of a scene sees 1 (times the index squared).
AROUND = (Surroundings(radiance=1.0),)
WHITE = Fog(2.0, 1.0, 0.6)


def solve(scene: SurfaceScene, rays: tuple[Array, Array], solver: str = "path", **options: Any) -> Answer:
    return skyscatter.radiance(scene, *rays, WAVELENGTHS, **asked(solver, **{"samples": 64, "seed": 1, **options}))


def check_furnace(scene: SurfaceScene, rays: tuple[Array, Array], expected: float = 1.0, **options: Any) -> None:
    """Every ray sees the same, and the errors that are stated are small enough to tell."""
    answer = solve(scene, rays, **options)
    assert np.all(answer.standard_error < 0.1 * expected)
    # Where nothing is left to chance the error is 0: then rounding, and phase functions from tables (1e-4).
    assert_agrees(answer.radiance, expected, answer.standard_error, slack=2e-4)


def test_camera_inside_glass_inside_fog() -> None:
    ball = Body(name="ball", shape=Sphere(radius=1.0), material=Dielectric(), inside="glass")
    cloud = Body(name="cloud", shape=Sphere(radius=1.5), material=Interface(), inside="fog")
    glass = SurfaceMedium(name="glass", index=1.5, priority=1)
    scene = SurfaceScene(media=(AIR, fog_medium("fog", WHITE), glass), bodies=(cloud, ball), lamps=AROUND)
    # Within radius / index of the middle no ray is caught by total reflection.  Radiance goes with the index squared.
    check_furnace(scene, rays_around((0.3, 0.0, 0.2), 12), expected=1.5**2)
    # And from the fog, where glass is a window like any other.
    check_furnace(scene, rays_around((1.2, 0.0, 0.0), 12))


def test_light_caught_in_glass_for_ever() -> None:
    # From the corner of a glass cube three total reflections send every ray back: with no end but the walk's own.
    cube = Body(name="cube", shape=Box(size=(1, 1, 1)), material=Dielectric(), inside="glass")
    scene = SurfaceScene(media=(AIR, GLASS), bodies=(cube,), lamps=AROUND)
    diagonal = np.ones((1, 3)) / np.sqrt(3.0)
    answer = solve(scene, (np.array([[0.1, 0.05, 0.0]]), diagonal))
    assert np.all(answer.radiance == 0.0)


def test_faces_that_coincide() -> None:
    # A block of fog and a block of glass on a white floor, touching each other.
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=1.0))
    block = Body(name="block", shape=Box(position=(0.5, 0, 0.5), size=(1, 1, 1)), material=Interface(), inside="fog")
    brick = Body(
        name="brick", shape=Box(position=(-0.5, 0, 0.5), size=(1, 1, 1)), material=Dielectric(), inside="glass"
    )
    media = (AIR, fog_medium("fog", WHITE), GLASS)
    down = np.array([0.2, 0.1, -1.0]) / np.linalg.norm([0.2, 0.1, -1.0])
    origins = np.array([[x, 0.0, 3.0] for x in (-1.4, -0.9, -0.6, 0.0, 0.3, 1.3)])
    rays = origins, np.broadcast_to(down, origins.shape)
    check_furnace(SurfaceScene(media=media, bodies=(floor, block), lamps=AROUND), rays)
    lit = SurfaceScene(media=media, bodies=(floor, block, brick), lamps=AROUND)
    answer = solve(lit, rays, samples=256)
    # Light may be caught in the brick: never more than the furnace, and not much less.
    assert np.all(answer.radiance <= 1 + 5 * answer.standard_error + 1e-9)
    assert np.all(answer.radiance > 0.5)


def test_two_walls_in_one_place() -> None:
    # Either colour may be seen, but one of them, and no light comes through.
    walls = tuple(
        Body(name=name, shape=Rectangle(size=(4, 4)), material=Lambert(albedo=albedo))
        for name, albedo in (("dark", 0.2), ("bright", 0.6))
    )
    rays = np.array([[0.1, 0.2, 2.0]]), np.array([[0.0, 0.0, -1.0]])
    seen = solve(SurfaceScene(bodies=walls, lamps=AROUND), rays, samples=1024)
    nearest = min((0.2, 0.6), key=lambda albedo: abs(albedo - seen.radiance[0, 0]))
    assert_agrees(seen.radiance, nearest, seen.standard_error)
    lamp = PointLamp(position=(0.0, 0.0, -1.0), power=1.0)
    assert np.all(solve(SurfaceScene(bodies=walls, lamps=(lamp,)), rays).radiance == 0.0)


@pytest.mark.parametrize("direction", [(0.3, 0.0, 1.0), (0.3, 0.0, -1.0)])
def test_camera_exactly_on_a_surface(direction: tuple[float, float, float]) -> None:
    d = np.array([direction]) / np.linalg.norm(direction)
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    scene = SurfaceScene(bodies=(floor,), lamps=AROUND)
    on = solve(scene, (np.array([[0.2, 0.1, 0.0]]), d), samples=256)
    # Who looks down from there sees the floor, or, being half in it, what is below: nothing between.
    seen = min((1.0,) if direction[2] > 0 else (0.5, 1.0), key=lambda value: abs(value - on.radiance[0, 0]))
    assert_agrees(on.radiance, seen, on.standard_error, slack=1e-9)


def test_camera_exactly_on_glass() -> None:
    ball = Body(name="ball", shape=Sphere(radius=1.0), material=Dielectric(), inside="glass")
    scene = SurfaceScene(media=(AIR, GLASS), bodies=(ball,), lamps=AROUND)
    origin = np.array([[0.0, 0.0, 1.0]])
    outwards, inwards = np.array([[0.1, 0.0, 1.0]]), np.array([[0.1, 0.0, -1.0]])
    seen = solve(scene, (origin, outwards / np.linalg.norm(outwards)))
    np.testing.assert_allclose(seen.radiance, 1.0, rtol=1e-12)
    inner = solve(scene, (origin, inwards / np.linalg.norm(inwards)), samples=256)
    # The eye is in the air, or in the glass, where radiance goes with the index squared.
    nearest = min((1.0, 2.25), key=lambda value: abs(value - inner.radiance[0, 0]))
    assert_agrees(inner.radiance, nearest, inner.standard_error, slack=1e-9)


@pytest.mark.parametrize("solver", ["path", "photons"])
def test_lamp_in_a_closed_opaque_box(solver: str) -> None:
    case = Body(name="case", shape=Box(size=(1, 1, 1)), material=Lambert(albedo=0.9))
    floor = Body(name="floor", shape=Plane(position=(0, 0, -1)), material=Lambert(albedo=0.5))
    scene = SurfaceScene(bodies=(case, floor), lamps=(PointLamp(position=(0.1, 0, 0), power=1.0),))
    options = {"photons": 2000, "samples": 4} if solver == "photons" else {}
    answer = solve(scene, rays_around((0.0, 0.0, 3.0), 12), solver, **options)
    assert np.all(answer.radiance == 0.0)
    assert np.all(answer.standard_error == 0.0)


@pytest.mark.parametrize("solver", ["path", "photons"])
def test_no_lamp_at_all(solver: str) -> None:
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    answer = solve(SurfaceScene(bodies=(floor,)), rays_around((0.0, 0.0, 1.0), 4), solver, samples=4)
    assert np.all(answer.radiance == 0.0)
    assert np.all(answer.standard_error == 0.0)


@pytest.mark.parametrize("solver", ["path", "photons"])
def test_lamp_behind_the_camera(solver: str) -> None:
    wall = Body(name="wall", shape=Rectangle(normal=(0, -1, 0), size=(40, 40)), material=Lambert(albedo=0.6))
    scene = SurfaceScene(bodies=(wall,), lamps=(PointLamp(position=(1.0, -5.0, 0.5), power=4.0 * np.pi),))
    x = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.0], [-3.0, 0.0, 2.0]])
    eye = np.array([0.0, -2.0, 0.0])
    directions = (x - eye) / np.linalg.norm(x - eye, axis=1)[:, None]
    options = {"photons": 1000, "samples": 4} if solver == "photons" else {}
    seen = solve(scene, (np.tile(eye, (3, 1)), directions), solver, **options)
    towards = np.array([1.0, -5.0, 0.5]) - x
    distance = np.linalg.norm(towards, axis=1)
    expected = 0.6 / np.pi * -towards[:, 1] / distance**3  # intensity 1 W sr-1 nm-1
    # There is no other light, and photons need not look for it: light straight from a point is found exactly.
    np.testing.assert_allclose(seen.radiance, expected[:, None] * np.ones(2), rtol=1e-9)


@pytest.mark.parametrize("size", [(0.0, 1.0), (0.0, 0.0)])
def test_lamp_of_no_area(size: tuple[float, float]) -> None:
    assert "size" in complaint(lambda: Rectangle(size=size))


def test_tiny_lamp_is_a_point() -> None:
    # 1 um across at 1 m: as a point of the same power with Lambert's lobe.
    floor = Body(name="floor", shape=Plane(), material=Lambert(albedo=0.5))
    shape = Rectangle(position=(0, 0, 1), normal=(0, 0, -1), size=(1e-6, 1e-6))
    lamp = Body(name="lamp", shape=shape, material=Lambert(albedo=0.0), lamp=AreaLamp(power=1.0))
    rays = np.array([[0.3, 0.0, 0.5]]), np.array([[0.0, 0.0, -1.0]])
    seen = solve(SurfaceScene(bodies=(floor, lamp)), rays)
    square = 0.3**2 + 1.0
    expected = 0.5 / np.pi * (1.0 / np.pi) / square**2
    assert_agrees(seen.radiance, expected, seen.standard_error, slack=1e-5)


def octahedron() -> tuple[Array, NDArray[np.int64]]:
    """Vertices, and faces with their front outside."""
    vertices = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return vertices, np.array(faces)


def round_mesh(times: int) -> tuple[Array, NDArray[np.int64]]:
    """The octahedron, every triangle cut into four so many times, its corners moved onto the unit sphere."""
    corners = octahedron()[0][octahedron()[1]]
    for _ in range(times):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    points = corners.reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1)[:, None]
    return points, np.arange(len(points)).reshape(-1, 3)


@pytest.mark.parametrize("material", [Interface(), Dielectric()])
def test_open_mesh_cannot_bound_a_medium(material: Any) -> None:
    vertices, faces = octahedron()
    shape = Mesh(vertices=vertices, faces=faces[1:])
    body = Body(name="pot", shape=shape, material=material, inside="fog")
    scene = SurfaceScene(media=(AIR, fog_medium("fog", WHITE, index=1.3)), bodies=(body,), lamps=AROUND)
    with pytest.raises(DomainError, match=r"closed|open|hole") as caught:
        solve(scene, rays_around((0.0, 0.0, 3.0), 2))
    assert len(str(caught.value).splitlines()) == 1
    # As a mere surface it is welcome.
    sheet = Body(name="pot", shape=shape, material=Lambert(albedo=1.0))
    check_furnace(SurfaceScene(bodies=(sheet,), lamps=AROUND), rays_around((0.1, 0.1, 3.0), 6))


def test_closed_mesh_of_glass_in_a_mesh_of_fog() -> None:
    vertices, faces = octahedron()
    cloud = Body(
        name="cloud", shape=Mesh(vertices=vertices, faces=faces, scale=2.0), material=Interface(), inside="fog"
    )
    gem = Body(name="gem", shape=Mesh(vertices=vertices, faces=faces), material=Dielectric(), inside="ice")
    media = (AIR, fog_medium("fog", WHITE), SurfaceMedium(name="ice", index=1.05, priority=1))
    scene = SurfaceScene(media=media, bodies=(cloud, gem), lamps=AROUND)
    origins = np.array([[0.02, 0.01, 4.0], [0.9, 0.3, 4.0], [0.3, -0.2, 4.0]])
    check_furnace(scene, (origins, np.tile([0.0, 0.0, -1.0], (3, 1))), samples=128)


def test_degenerate_mesh_as_a_lamp() -> None:
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float)
    shape = Mesh(vertices=line, faces=np.array([[0, 1, 2]]))
    body = Body(name="rod", shape=shape, material=Lambert(albedo=0.0), lamp=AreaLamp(power=1.0))
    with pytest.raises(DomainError, match=r"area|triangle") as caught:
        solve(SurfaceScene(bodies=(body,)), rays_around((0.0, 0.0, 3.0), 2))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.slow
def test_a_million_triangles() -> None:
    vertices, faces = round_mesh(9)
    assert len(faces) > 2_000_000
    ball = Body(name="ball", shape=Mesh(vertices=vertices, faces=faces), material=Lambert(albedo=0.6))
    rng = np.random.default_rng(1)
    directions = np.tile([0.0, 0.0, -1.0], (4000, 1))
    origins = np.concatenate([rng.uniform(-0.9, 0.9, (4000, 2)), np.full((4000, 1), 3.0)], axis=1)
    inside = np.hypot(*origins[:, :2].T) < 0.999
    seen = solve(SurfaceScene(bodies=(ball,), lamps=AROUND), (origins, directions), samples=16)
    # A convex body among even light: its albedo, everywhere.  Nothing comes through, and nothing is missed.
    hit = seen.radiance[inside]
    assert_agrees(hit.mean(axis=0), 0.6, np.sqrt((seen.standard_error[inside] ** 2).sum(axis=0)) / len(hit), slack=1e-3)
    assert np.all(hit < 0.99)
    outside = np.hypot(*origins[:, :2].T) > 1.0
    np.testing.assert_allclose(seen.radiance[outside], 1.0, rtol=1e-12)
