"""Shapes that rays meet: what every one has to keep, and hostile cases."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray
from surface_bases import (
    SHAPE_TESTS,
    ShapeContract,
    blocked,
    crossings,
    direction,
    pack,
    shoot,
    sphere_points,
    unit,
)

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.kernels.codes.surfaces import STACK
from skyscatter.media.shapes import axis_rotation
from skyscatter.surfaces import packing
from skyscatter.surfaces.materials import Interface, Lambert
from skyscatter.surfaces.meshes import Mesh, Shape, Turned
from skyscatter.surfaces.packing import body_items, bounding_sphere, pack_shapes, starting_stack
from skyscatter.surfaces.shapes import Box, Disk, Plane, Rectangle, Sphere

Array = NDArray[np.float64]


def icosphere(rounds: int) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of an icosahedron whose triangles are divided into four several times, on the unit sphere."""
    g = (1 + 5**0.5) / 2
    vertices = [(a, b, 0.0) for a in (-1.0, 1.0) for b in (-g, g)]
    vertices = [tuple(np.roll(v, k)) for k in range(3) for v in vertices]
    points = np.array(vertices) / np.hypot(1, g)
    near = np.linalg.norm(points[:, None] - points, axis=2) < 1.2
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]]
    )
    outward = np.linalg.det(points[faces]) > 0
    faces[~outward] = faces[~outward][:, ::-1]
    for _ in range(rounds):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        pairs, place = np.unique(edges, axis=0, return_inverse=True)
        middles = points[pairs].sum(axis=1)
        ab, bc, ca = (place.reshape(3, -1) + len(points)).astype(int)
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        a, b, c = faces.T
        faces = np.concatenate([np.column_stack(x) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return points, faces


def mesh_area(points: Array, faces: Any) -> float:
    """Sum over its triangles [m2]."""
    a, b, c = (points[np.asarray(faces)[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


class TestSphere(ShapeContract):
    """A ball."""

    shape = Sphere(position=(0.3, -0.2, 0.9), radius=0.7)
    lengths = ("position", "radius")
    area = 4 * np.pi * 0.7**2

    def residual(self, points: Array) -> Array:
        return np.linalg.norm(points - np.array(self.shape.position), axis=1) - self.shape.radius


class TestBox(ShapeContract):
    """A box that stands askew."""

    shape = Box(position=(0.3, -0.2, 0.4), size=(0.4, 0.9, 1.3), axis=(1.0, 2.0, -0.5), turn_deg=33.0)
    lengths = ("position", "size")
    area = 2 * (0.4 * 0.9 + 0.9 * 1.3 + 1.3 * 0.4)

    def residual(self, points: Array) -> Array:
        local = (points - np.array(self.shape.position)) @ axis_rotation(self.shape.axis, self.shape.turn_deg)
        return (np.abs(local) - 0.5 * np.array(self.shape.size)).max(axis=1)


def off_flat(points: Array, position: Array, normal: Array, outside: Any) -> Array:
    """Signed distance from a flat shape; large where the foot is not on it."""
    height = (points - position) @ normal
    foot = points - height[:, None] * normal
    return np.where(outside(foot - position) > 1e-12, 1e3, height)


class TestRectangle(ShapeContract):
    """By its middle."""

    shape = Rectangle(position=(0.2, 0.1, -0.3), normal=(1.0, 0.5, 2.0), size=(0.8, 1.7), up=(0.0, 1.0, 1.0))
    lengths = ("position", "size")
    area = 0.8 * 1.7

    def residual(self, points: Array) -> Array:
        normal = unit(1.0, 0.5, 2.0)
        up = np.array([0.0, 1.0, 1.0]) - (np.array([0.0, 1.0, 1.0]) @ normal) * normal
        up /= np.linalg.norm(up)
        across = np.cross(up, normal)

        def outside(foot: Array) -> Array:
            return np.maximum(np.abs(foot @ across) - 0.4, np.abs(foot @ up) - 0.85)

        return off_flat(points, np.array(self.shape.position), normal, outside)


class TestRectangleByCorner(ShapeContract):
    """By a corner and two edges."""

    shape = Rectangle(corner=(0.1, 0.2, 0.3), first_edge=(1.0, 1.0, 0.0), second_edge=(-0.5, 0.5, 1.0))
    lengths = ("corner", "first_edge", "second_edge")
    area = np.sqrt(2.0) * np.sqrt(1.5)

    def residual(self, points: Array) -> Array:
        a, b = np.array(self.shape.first_edge), np.array(self.shape.second_edge)

        def outside(foot: Array) -> Array:
            return np.maximum(np.abs(foot @ a / 2.0 - 0.5), np.abs(foot @ b / 1.5 - 0.5)) - 0.5

        return off_flat(points, np.array(self.shape.corner), np.cross(a, b) / np.sqrt(3.0), outside)


class TestDisk(ShapeContract):
    """A ring."""

    shape = Disk(position=(0.2, 0.1, -0.3), normal=(-1.0, 0.5, 0.2), radius=0.9, inner_radius=0.4)
    lengths = ("position", "radius", "inner_radius")
    area = np.pi * (0.9**2 - 0.4**2)

    def residual(self, points: Array) -> Array:
        def outside(foot: Array) -> Array:
            r = np.linalg.norm(foot, axis=1)
            return np.maximum(r - 0.9, 0.4 - r)

        return off_flat(points, np.array(self.shape.position), unit(-1.0, 0.5, 0.2), outside)


class TestMesh(ShapeContract):
    """A tetrahedron: all faces in closed form."""

    corners = np.array([[0.1, 0.2, 0.0], [1.3, 0.0, 0.1], [0.3, 1.1, 0.2], [0.4, 0.4, 1.2]])
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))
    shape = Mesh(vertices=corners, faces=faces, position=(0.2, -0.1, 0.3), axis=(0.1, 0.2, 1.0), turn_deg=20.0)
    lengths = ("scale", "position")
    area = mesh_area(corners, faces)

    def residual(self, points: Array) -> Array:
        local = (points - np.array(self.shape.position)) @ axis_rotation(self.shape.axis, self.shape.turn_deg)
        heights = []
        for a, b, c in self.faces:
            normal = np.cross(self.corners[b] - self.corners[a], self.corners[c] - self.corners[a])
            heights.append((local - self.corners[a]) @ normal / np.linalg.norm(normal))
        return np.max(heights, axis=0)


class TestTurned(ShapeContract):
    """A double cone of twelve facets, whose own area and planes are known."""

    sides, radius, low, high = 12, 0.8, -0.5, 0.7
    shape = Turned(
        profile=((0.0, low), (radius, 0.0), (0.0, high)), segments=sides, position=(0.2, -0.1, 0.3),
        axis=(0.3, -0.2, 1.0), turn_deg=10.0,
    )  # fmt: skip
    lengths = ("scale", "position")
    inner = radius * math.cos(math.pi / sides)
    area = sides * radius * math.sin(math.pi / sides) * (math.hypot(inner, low) + math.hypot(inner, high))

    def residual(self, points: Array) -> Array:
        local = (points - np.array(self.shape.position)) @ axis_rotation(self.shape.axis, self.shape.turn_deg)
        middle = 2 * np.pi * (np.arange(self.sides) + 0.5) / self.sides
        out = local[:, :1] * np.cos(middle) + local[:, 1:2] * np.sin(middle) - self.inner
        up = local[:, 2:]
        high = (out * self.high + up * self.inner) / math.hypot(self.inner, self.high)
        low = (-out * self.low - up * self.inner) / math.hypot(self.inner, self.low)
        return np.maximum(high, low).max(axis=1)


class TestMeshWithTree(ShapeContract):
    """Many triangles: a ball once more, but for the height of its arcs."""

    points, triangles = icosphere(2)
    shape = Mesh(vertices=points, faces=triangles, position=(0.2, -0.1, 0.3))
    lengths = ("scale", "position")
    area = mesh_area(points, triangles)

    def residual(self, points: Array) -> Array:
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return ((points - np.array(self.shape.position)) @ normals.T - (a * normals).sum(axis=1)).max(axis=1)


def test_plane() -> None:
    """Met from both sides, endless, never again by who starts on it."""
    table = pack(Plane(position=(0.0, 0.0, 2.0), normal=(1.0, 0.0, 2.0)))
    rng = np.random.default_rng(1)
    origins, directions = rng.uniform(-1e3, 1e3, (5000, 3)), sphere_points(rng, 5000)
    hit = shoot(table, origins, directions)
    normal = unit(1.0, 0.0, 2.0)
    height = (origins - [0.0, 0.0, 2.0]) @ normal
    np.testing.assert_array_equal(hit.item >= 0, height * (directions @ normal) < 0)
    met = hit.item >= 0
    points = origins[met] + hit.distance[met, None] * directions[met]
    # Grazing rays go far: the error is that of the distance.
    assert (np.abs((points - [0.0, 0.0, 2.0]) @ normal) < 1e-15 * (5e3 + hit.distance[met])).all()
    assert (shoot(table, points, directions[met], skip=0).item == -1).all()
    assert np.isinf(packing.item_areas(table)).all()


def test_every_shape_is_tested() -> None:
    """A new kind without a test is noticed; a plane, without an area, has its own."""
    assert set(get_args(Shape)) <= {*SHAPE_TESTS, Plane}


@pytest.mark.parametrize("height", [2.0, 1e-3, 1e5])
def test_a_camera_above_a_planet(height: float) -> None:
    """Distances to a sphere of 6400 km against 50 digits; the only error is that of coordinates of 6.4e6 m."""
    radius = 6.4e6
    table = pack(Sphere(position=(0.0, 0.0, -radius), radius=radius))
    horizon = np.arccos(radius / (radius + height))
    dips = np.concatenate([horizon * np.array([0.9, 1.001, 1.1, 2.0, 10.0]), [0.5, np.pi / 2]])
    dips = dips[dips <= np.pi / 2]
    directions = np.column_stack([np.cos(dips), np.zeros(len(dips)), -np.sin(dips)])
    hit = shoot(table, np.tile([0.0, 0.0, height], (len(dips), 1)), directions)
    assert hit.item[0] == -1
    assert (hit.item[1:] == 0).all()
    for d, t in zip(directions[1:], hit.distance[1:], strict=True):
        with localcontext() as context:
            context.prec = 50
            f = [Decimal(0), Decimal(0), Decimal(height) + Decimal(radius)]
            e = [Decimal(float(x)) for x in d]
            norm = sum((x * x for x in e), Decimal(0)).sqrt()
            b = -sum((x * y for x, y in zip(f, e, strict=True)), Decimal(0)) / norm
            root = (b * b - f[2] * f[2] + Decimal(radius) ** 2).sqrt()
            expected, slope = float((b - root) / norm), float(root) / radius
        # A coordinate's last digit, 1e-9 m, over the slope of the ray.
        assert abs(t - expected) < 2e-9 / slope


def test_boxes_along_the_axes() -> None:
    """Rays along the axes and within faces: a slab that is parallel to a ray does not divide by zero."""
    table = pack(Box(size=(2.0, 2.0, 2.0)))
    origins = np.array([[-3.0, 0.2, 0.3], [0.1, -3.0, 0.0], [0.0, 0.0, 3.0], [-3.0, 1.5, 0.0], [0.0, 0.0, 0.0]])
    directions = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [1.0, 0, 0], [0, 0, 1.0]])
    hit = shoot(table, origins, directions)
    np.testing.assert_array_equal(hit.item, [0, 0, 0, -1, 0])
    np.testing.assert_array_equal(hit.distance[[0, 1, 2, 4]], [2.0, 2.0, 2.0, 1.0])
    np.testing.assert_array_equal(hit.normal[[0, 1, 2, 4]], [[-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, 1]])


@pytest.mark.parametrize("rounds", [1, 4])
def test_no_leak_through_edges_and_corners(rounds: int) -> None:
    """Rays aimed at edges and corners of a closed mesh, from outside and from inside: every one counts right."""
    points, faces = icosphere(rounds)
    table = pack(Mesh(vertices=points, faces=faces), inside=1)
    rng = np.random.default_rng(7)
    n = 20_000
    a, b = points[faces[rng.integers(len(faces), size=n)][:, :2]].transpose(1, 0, 2)
    share = rng.choice([0.0, 0.5, 1.0], size=(n, 1))
    share = np.where(rng.random((n, 1)) < 0.5, share, rng.random((n, 1)))
    target = share * a + (1 - share) * b
    for origins in (3 * sphere_points(rng, n), 0.3 * sphere_points(rng, n), np.zeros((n, 3))):
        directions = target - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        found = crossings(table, origins, directions)
        assert (np.linalg.norm(origins, axis=1) > 1).all() or (found == [0, 1]).all()
        np.testing.assert_array_equal(found[:, 1] - found[:, 0], np.linalg.norm(origins, axis=1) < 1)


def test_tree_and_list_find_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A crowd of all shapes, a plane among them: item, distance, normal to the last bit, and what is blocked."""
    rng = np.random.default_rng(8)

    def place() -> tuple[float, ...]:
        return tuple(rng.uniform(-3, 3, 3))

    shapes: list[Any] = [Plane(position=(0.0, 0.0, -3.0)), Plane(position=(9.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))]
    for _ in range(40):
        axis, turn = tuple(sphere_points(rng, 1)[0]), float(rng.uniform(0, 360))
        shapes += [
            Sphere(position=place(), radius=rng.uniform(0.05, 0.4)),
            Box(position=place(), size=tuple(rng.uniform(0.05, 0.5, 3)), axis=axis, turn_deg=turn),
            Box(position=tuple(np.round(place())), size=(0.5, 0.5, 0.5)),
            Disk(position=place(), normal=axis, radius=0.4),
            Rectangle(position=place(), normal=axis, size=(0.3, 0.8)),
            Rectangle(position=tuple(np.round(place())), normal=(0.0, 0.0, 1.0), size=(1.0, 1.0)),
        ]
    shapes.append(Mesh(vertices=icosphere(2)[0], faces=icosphere(2)[1], scale=0.5))
    monkeypatch.setattr(packing, "TREE_FROM", 10**9)
    listed = pack(*shapes)
    monkeypatch.setattr(packing, "TREE_FROM", 1)
    planted = pack(*shapes)
    assert listed.order.size == 0
    assert planted.loose.size == 2
    assert np.array_equal(np.sort(np.concatenate([planted.loose, planted.order])), listed.loose)
    origins, directions = rng.uniform(-4, 4, (20_000, 3)), sphere_points(rng, 20_000)
    # Some along the axes, through faces and corners of those that stand on whole numbers.
    origins[:3000] = np.round(4 * origins[:3000]) / 4
    directions[:3000] = np.eye(3)[rng.integers(3, size=3000)] * rng.choice([-1.0, 1.0], size=(3000, 1))
    one, two = shoot(listed, origins, directions), shoot(planted, origins, directions)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
    far = rng.uniform(0, 5, 20_000)
    np.testing.assert_array_equal(blocked(listed, origins, directions, far), blocked(planted, origins, directions, far))
    np.testing.assert_array_equal(
        crossings(listed, origins[:3000], directions[:3000]), crossings(planted, origins[:3000], directions[:3000])
    )


def test_coincident_surfaces() -> None:
    """Of items at the same place that of the lowest number is met, with a tree and without; both are counted."""
    for count in (2, 40):
        table = pack(*[Rectangle(normal=(0.0, 0.0, 1.0), size=(1.0, 1.0))] * count)
        assert (table.order.size > 0) == (count == 40)
        origins, directions = np.array([[0.1, 0.2, 1.0]]), np.array([[0.0, 0.0, -1.0]])
        assert shoot(table, origins, directions).item[0] == 0
        np.testing.assert_array_equal(crossings(table, origins, directions), [[count, 0]])
        # A start on the first one finds the second only where it really lies beyond.
        assert shoot(table, np.array([[0.1, 0.2, 0.0]]), directions, skip=0).item[0] == -1


def test_many_items_at_one_place() -> None:
    """A tree over boxes that cannot be told apart still ends, and finds the first."""
    table = pack(*[Sphere(position=(1.0, 2.0, 3.0))] * 3000)
    assert shoot(table, np.array([[5.0, 2.0, 3.0]]), np.array([[-1.0, 0.0, 0.0]])).item[0] == 0


def test_triangles_without_area_are_dropped() -> None:
    """Needles and points do not disturb, neither the tree nor whether a mesh is closed."""
    points, faces = icosphere(1)
    extra = np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])
    mesh = Mesh(vertices=points, faces=extra)
    assert mesh.triangles.dropped == 2
    mesh.check_volume()
    needle = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    with pytest.raises(DomainError, match="area"):
        pack(Mesh(vertices=needle, faces=[[0, 1, 2]]))


def test_corners_that_differ_by_rounding_are_one() -> None:
    """A mesh whose triangles each bring their own corners, rounded differently, is closed."""
    points, faces = icosphere(3)
    rng = np.random.default_rng(1)
    own = points[faces].reshape(-1, 3) * (1 + 1e-15 * rng.integers(-4, 5, (3 * len(faces), 3)))
    mesh = Mesh(vertices=own, faces=np.arange(len(own)).reshape(-1, 3), position=(10.0, 0.0, 0.0))
    mesh.check_volume()
    assert len(mesh.triangles.normals) == len(faces)
    assert len(np.unique(mesh.triangles.corners.reshape(-1, 3), axis=0)) == len(points)
    # What is smaller than the rounding of the place where it is put has no area left.
    with pytest.raises(DomainError, match="area"):
        pack(Mesh(vertices=points, faces=faces, scale=1e-10, position=(6.4e6, 6.4e6, 6.4e6)))


def test_a_mesh_is_written_and_read() -> None:
    """A small one with its numbers; of a large one only the digest, which is refused with the remedy."""
    points, faces = icosphere(0)
    small = Mesh(vertices=points, faces=faces)
    again = Mesh.model_validate_json(small.model_dump_json())
    assert again == small
    np.testing.assert_array_equal(again.triangles.corners, small.triangles.corners)
    points, faces = icosphere(4)
    large = Mesh(vertices=points, faces=faces)
    assert hash(large) == hash(Mesh(vertices=points, faces=faces))
    with pytest.raises(ValueError, match="save the mesh to a file"):
        Mesh.model_validate_json(large.model_dump_json())


def test_meshes_that_hold_no_volume() -> None:
    """Open, twisted, inside out: each is told with its remedy; without a medium inside all are allowed."""
    points, faces = icosphere(1)
    cases = {
        "3 open edges": faces[1:],
        "3 edges between triangles wound": np.concatenate([faces[:1, ::-1], faces[1:]]),
        "inside_out = true": faces[:, ::-1],
    }
    for word, some in cases.items():
        pack(Mesh(vertices=points, faces=some))
        with pytest.raises(DomainError, match=word):
            pack(Mesh(vertices=points, faces=some), inside=1)
    pack(Mesh(vertices=points, faces=faces[:, ::-1], inside_out=True), inside=1)
    for flat in (Rectangle(size=(1.0, 1.0)), Disk()):
        with pytest.raises(DomainError, match="holds no volume"):
            pack(flat, inside=1)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb", "off"])
def test_mesh_files(ending: str, tmp_path: Any) -> None:
    """Written by trimesh and read again: closed, in place, and with the same area to the digits of the format."""
    import trimesh

    points, faces = icosphere(2)
    path = tmp_path / f"ball.{ending}"
    trimesh.Trimesh(points, faces, process=False).export(path)
    mesh = Mesh(file=str(path), scale=0.01, position=("1 m", 0.0, 0.0))
    mesh.check_volume()
    assert len(mesh.triangles.normals) == len(faces)
    area = packing.item_areas(pack(mesh)).sum()
    np.testing.assert_allclose(
        area, 1e-4 * packing.item_areas(pack(Mesh(vertices=points, faces=faces))).sum(), rtol=1e-6
    )
    np.testing.assert_allclose(mesh.bounds[0][0], 1 - 0.01 * np.abs(points[:, 0]).max(), atol=1e-8)


@pytest.mark.parametrize("far", [2.0**63, 1e300])
@pytest.mark.parametrize("every", [False, True])
def test_vertices_too_far_away(far: float, every: bool) -> None:
    """One of them or all: metres would be lost in the rounding."""
    points, faces = icosphere(1)
    points = far * points if every else np.concatenate([[[far, 0.0, 0.0]], points[1:]])
    with pytest.raises(DomainError, match=r"vertices lie within 1e\+12 m of the origin"):
        pack(Mesh(vertices=points, faces=faces))


@pytest.mark.parametrize("ending", ["stl", "ply"])
def test_binary_mesh_files_that_were_cut_short(ending: str, tmp_path: Any) -> None:
    """Anywhere: refused in words, never read as a smaller mesh."""
    import trimesh

    points, faces = icosphere(1)
    path = tmp_path / f"whole.{ending}"
    trimesh.Trimesh(points, faces, process=False).export(path)
    data = path.read_bytes()
    for size in np.random.default_rng(5).integers(1, len(data), 40):
        (tmp_path / f"{size}.{ending}").write_bytes(data[:size])
        with pytest.raises(MissingDataError, match=r"not a mesh that can be read|cut short"):
            _ = Mesh(file=str(tmp_path / f"{size}.{ending}")).triangles


def test_what_a_reader_of_meshes_says_is_cut_short(tmp_path: Any) -> None:
    """It may repeat all of a file that it does not understand."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
    (tmp_path / "a.ply").write_text(head + "[" * 5000 + "y\nend_header\n0 0\n")
    with pytest.raises(MissingDataError) as caught:
        _ = Mesh(file=str(tmp_path / "a.ply")).triangles
    assert len(str(caught.value)) < 600


@pytest.mark.slow
def test_a_million_triangles() -> None:
    """Every ray aimed at a fine ball hits it where the ball is, in and out again."""
    points, faces = icosphere(8)
    table = pack(Mesh(vertices=points, faces=faces), inside=1)
    rng = np.random.default_rng(9)
    origins = 3 * sphere_points(rng, 100_000)
    directions = 0.9 * sphere_points(rng, 100_000) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hit = shoot(table, origins, directions)
    assert (hit.item >= 0).all()
    radius = np.linalg.norm(origins + hit.distance[:, None] * directions, axis=1)
    # The plane of a triangle whose circumscribed circle has the radius rho lies sqrt(1 - rho^2) from the middle.
    corners = points[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    depth = 1 - np.sqrt(1 - (sides.prod(axis=1) / (4 * area)).max() ** 2)
    assert radius.max() < 1 + 1e-14
    assert depth < 1e-5
    assert radius.min() > 1 - depth - 1e-14
    np.testing.assert_array_equal(crossings(table, origins, directions), 1)


def nest(*radii: float) -> Any:
    """Spheres one in another, medium k + 1 in the k-th."""
    bodies = [(Sphere(radius=r), 0, k + 1, -1) for k, r in enumerate(radii)]
    return pack_shapes(bodies, [Interface()])


def test_starting_stacks() -> None:
    """The media around a point, as entered; a plane is a half space; a start on a lamp's surface looks outward."""
    table = nest(3.0, 2.0, 1.0)
    for x, expected in ((0.5, [1, 2, 3]), (1.5, [1, 2]), (2.5, [1]), (3.5, [])):
        stack = starting_stack(table, (x, 0.0, 0.0))
        np.testing.assert_array_equal(stack, expected + [-1] * (STACK - len(expected)))
    # On the innermost one, as seen from outside of it.
    stack = starting_stack(table, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), skip=2)
    np.testing.assert_array_equal(stack[:3], [1, 2, -1])
    sea = pack_shapes([(Plane(), 0, 4, -1), (Sphere(), 0, 2, -1), (Box(position=(5.0, 0, 0)), 0, 3, -1)], [Lambert()])
    for z, expected in ((-0.5, [4, 2]), (0.5, [2, -1]), (-1.5, [4, -1]), (1.5, [-1, -1])):
        np.testing.assert_array_equal(starting_stack(sea, (0.0, 0.0, z))[:2], expected)
    np.testing.assert_array_equal(starting_stack(sea, (-3.0, 0.0, 0.1), (1.0, 0.0, 0.0))[:1], [-1])
    points, faces = icosphere(2)
    mesh = pack_shapes([(Mesh(vertices=points, faces=faces), 0, 1, -1)], [Lambert()])
    for target in points[:50]:
        assert starting_stack(mesh, (0.0, 0.0, 0.0), target)[0] == 1
        assert starting_stack(mesh, 3 * direction(0.5, 1.0), target - 3 * direction(0.5, 1.0))[0] == -1


def test_too_many_media() -> None:
    """A word where a stack cannot hold them."""
    starting_stack(nest(*np.linspace(9, 1, STACK)), (0.0, 0.0, 0.0))
    with pytest.raises(DomainError, match="one in another"):
        starting_stack(nest(*np.linspace(9, 1, STACK + 1)), (0.0, 0.0, 0.0))


def test_lists_of_a_table() -> None:
    """Items of a body, and the ball around all that has an end."""
    points, faces = icosphere(0)
    shapes = [Sphere(), Mesh(vertices=points, faces=faces, position=(5.0, 0.0, 0.0)), Plane(), Disk()]
    table = pack(*shapes)
    np.testing.assert_array_equal(body_items(table, 0), [0])
    np.testing.assert_array_equal(body_items(table, 1), 3 + np.arange(20))
    np.testing.assert_array_equal(body_items(table, 3), [2])
    middle, radius = bounding_sphere(shapes)
    assert np.linalg.norm(np.array([-1.0, 0, 0]) - middle) <= radius
    assert bounding_sphere([Plane()])[1] == 0


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Sphere(radius=0.0), "radius"),
        (lambda: Sphere(radius=float("nan")), "finite"),
        (lambda: Sphere(position=(float("inf"), 0, 0)), "finite"),
        (lambda: Plane(normal=(0.0, 0.0, 0.0)), "normal"),
        (lambda: Box(size=(1.0, 0.0, 1.0)), "size"),
        (lambda: Box(axis=(0.0, 0.0, 0.0)), "axis"),
        (lambda: Rectangle(), "give position, normal, size"),
        (lambda: Rectangle(size=(1.0, -1.0)), "size"),
        (lambda: Rectangle(size=(1.0, 1.0), corner=(0.0, 0.0, 0.0)), "give position"),
        (lambda: Rectangle(size=(1.0, 1.0), normal=(0, 0, 1.0), up=(0, 0, 2.0)), "along the normal"),
        (lambda: Rectangle(corner=(0, 0, 0), first_edge=(1, 0, 0), second_edge=(1, 1, 0)), "right angle"),
        (lambda: Disk(inner_radius=2.0), "inner_radius"),
        (lambda: Disk.model_validate({"radis": 2.0}), "radius"),
        (lambda: Mesh(), "give either a file"),
        (lambda: Mesh(file="a.stl", vertices=np.eye(3), faces=[[0, 1, 2]]), "give either a file"),
        (lambda: Mesh(vertices=np.eye(3)), "give either a file"),
        (lambda: Mesh(vertices=np.eye(4), faces=[[0, 1, 2]]), "shape"),
        (lambda: Mesh(vertices=np.eye(3), faces=[[0, 1, 3]]), "0 to 2"),
        (lambda: Mesh(vertices=np.eye(3), faces=[[0, 1, 1.5]]), "whole numbers"),
        (lambda: Mesh(vertices=[[0, 0, np.nan]] * 3, faces=[[0, 1, 2]]), "finite"),
        (lambda: Mesh(vertices=np.eye(3), faces=[[0, 1, 2]], scale=-1.0), "scale"),
        (lambda: Mesh(file="/nowhere/a.stl").triangles, "cannot be read"),
        (lambda: Turned(profile=((0.0, 0.0),)), "two corners"),
        (lambda: Turned(profile=((0.0, 0.0), (-1.0, 1.0))), "never negative"),
    ],
)
def test_refuses(make: Any, word: str) -> None:
    """One line that names the field and the remedy."""
    with pytest.raises((ValueError, OSError), match=word):
        make()


def test_a_turned_glass_is_closed_and_an_open_one_holds_no_medium() -> None:
    glass = ((0.0, 0.0), (0.03, 0.0), (0.035, 0.1), (0.033, 0.1), (0.028, 0.003), (0.0, 0.003))
    table = pack(Turned(profile=glass, segments=64), inside=1)
    assert len(table.triangle) == 2 * 64 * 4
    for x, inside in (((0.0, 0.0, 0.001), True), ((0.0, 0.0, 0.05), False), ((0.031, 0.0, 0.05), True)):
        assert (packing.starting_stack(table, np.array(x))[0] == 1) == inside, x
    with pytest.raises(DomainError, match="open edges"):
        pack(Turned(profile=glass[1:]), inside=1)
