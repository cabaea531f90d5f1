"""The judge of rooms, judged: view factors by quadrature, identities and published values; rooms by their balances."""

from __future__ import annotations

import numpy as np
import plain_rooms
import pytest
import radiosity
from radiosity import Piece
from significance import assert_agrees

WALLS = ("x-", "x+", "y-", "y+", "z-", "z+")
SIZE = (3.0, 2.0, 2.5)
LAMP = (1.0, 0.6, 2.0, 1.4)


def grey_room(albedo: float = 0.5, lamp: tuple[float, float, float, float] | None = LAMP) -> tuple[Piece, ...]:
    return radiosity.room(SIZE, dict.fromkeys((*WALLS, "lamp"), albedo), lamp, [1.0])


def one(low: tuple[float, float], high: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(low), np.array(high)


def gauss(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(24)
    return low + (high - low) * (nodes + 1) / 2, weights * (high - low) / 2


def by_quadrature(one: Piece, two: Piece) -> float:
    """A_1 F_12 as the fourfold integral of cos cos / (pi r^2); converges for rectangles that are apart."""
    x, weight = [], []
    for piece in (one, two):
        (u, wu), (v, wv) = (gauss(piece.low[k], piece.high[k]) for k in range(2))
        points = np.empty((u.size, v.size, 3))
        others = [k for k in range(3) if k != piece.axis]
        points[..., piece.axis] = piece.at
        points[..., others[0]], points[..., others[1]] = u[:, None], v[None]
        x.append(points.reshape(-1, 3))
        weight.append((wu[:, None] * wv[None]).ravel())
    between = x[1][None] - x[0][:, None]
    square = (between**2).sum(axis=-1)
    cosines = np.abs(between[..., one.axis] * between[..., two.axis]) / square
    return float(weight[0] @ (cosines / (np.pi * square)) @ weight[1])


def piece(axis: int, at: float, low: tuple[float, float], high: tuple[float, float]) -> Piece:
    return Piece(axis, at, 1, low, high, np.zeros(1), np.zeros(1))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (piece(2, 0.0, (0.1, 0.2), (1.0, 0.7)), piece(2, 1.3, (-0.5, 0.6), (0.4, 2.0))),
        (piece(0, 0.0, (0.0, 0.0), (1.0, 2.0)), piece(0, 2.0, (3.0, -1.0), (4.0, 0.5))),
        (piece(1, 0.5, (0.0, 0.0), (1.0, 1.0)), piece(1, -0.6, (0.2, 0.3), (0.4, 0.5))),
        (piece(2, 0.0, (0.4, 0.2), (1.0, 0.7)), piece(0, 0.0, (-0.5, 0.5), (0.4, 2.0))),
        (piece(1, 0.0, (0.3, 0.7), (1.0, 1.1)), piece(2, 0.0, (1.5, 0.3), (2.0, 2.0))),
        (piece(0, 1.0, (0.5, 0.0), (1.0, 1.0)), piece(1, 0.0, (1.5, 0.2), (2.5, 0.9))),
    ],
)
def test_view_factors_at_any_offset_are_their_integrals(first: Piece, second: Piece) -> None:
    patches = radiosity.cut((first, second), 10.0)
    # 24 Gauss nodes in each of four dimensions, rectangles at least half their size apart: error below 1e-10.
    assert radiosity.exchange(patches)[0, 1] == pytest.approx(by_quadrature(first, second), rel=1e-9)


def test_published_view_factors() -> None:
    # Howell's catalogue and the library of EES, which gives four digits.
    square = one((0.0, 0.0), (1.0, 1.0))
    assert radiosity.parallel_exchange(*square, *square, 1.0) == pytest.approx(0.199825, abs=5e-7)
    tenth = one((0.0, 0.0), (0.1, 0.1))
    assert radiosity.parallel_exchange(*tenth, *tenth, 0.05) / 0.01 == pytest.approx(0.4153, abs=5e-5)
    wide = one((0.0, 0.0), (1.0, 1.5))
    assert radiosity.parallel_exchange(*wide, *wide, 0.5) / 1.5 == pytest.approx(0.4756, abs=5e-5)
    unit = (np.array(0.0), np.array(1.0))
    assert radiosity.perpendicular_exchange(unit, unit, unit, unit) == pytest.approx(0.200044, abs=5e-7)


@pytest.mark.parametrize(("height", "width"), [(0.3, 2.0), (1.0, 1.0), (4.0, 0.25)])
def test_perpendicular_rectangles_with_a_common_edge(height: float, width: float) -> None:
    # Configuration C-14 of Howell's catalogue, in units of the common edge.
    h, w, s = height, width, height**2 + width**2
    logs = np.log((1 + w * w) * (1 + h * h) / (1 + s))
    logs += w * w * np.log(w * w * (1 + s) / ((1 + w * w) * s)) + h * h * np.log(h * h * (1 + s) / ((1 + h * h) * s))
    angles = w * np.arctan(1 / w) + h * np.arctan(1 / h) - np.sqrt(s) * np.arctan(1 / np.sqrt(s))
    expected = (angles + logs / 4) / np.pi
    zero = np.array(0.0)
    edge = (zero, np.array(1.0))
    found = radiosity.perpendicular_exchange(edge, (zero, np.array(width)), edge, (zero, np.array(height)))
    assert found == pytest.approx(expected, rel=1e-12)


def test_patches_of_a_room_see_nothing_but_the_room() -> None:
    patches = radiosity.cut(grey_room(), 0.5)
    areas = radiosity.exchange(patches)
    np.testing.assert_allclose(areas, areas.T, rtol=0, atol=1e-15)
    np.testing.assert_allclose(areas.sum(axis=1) / patches.area, 1.0, atol=1e-12)
    assert areas.min() >= -1e-15


def test_an_element_sees_what_a_small_patch_sees() -> None:
    room = grey_room()
    patches = radiosity.cut(room, 0.5)
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(30, 3))
    points, normals, _ = radiosity.hit_walls(room, np.tile([1.3, 0.9, 1.1], (30, 1)), directions)
    for point, normal in zip(points, normals, strict=True):
        axis = int(np.abs(normal).argmax())
        others = [k for k in range(3) if k != axis]
        half = 1e-3
        low, high = (tuple(point[others] + s * half) for s in (-1, 1))
        small = Piece(axis, point[axis], int(normal[axis]), low, high, np.zeros(1), np.zeros(1))
        both = radiosity.cut((small, *room), 0.5)
        of_patch = radiosity.exchange(both)[0, 1:] / (2 * half) ** 2
        away = radiosity.away(patches, point, normal)
        factors = radiosity.element_factors(point[None], normal[None], patches)[0]
        # The mean over the small patch differs by its second derivative, size^2 / 6 over the distance squared.
        np.testing.assert_allclose(factors[away], of_patch[away], atol=2e-6)
        assert factors[away].sum() == pytest.approx(1.0, abs=1e-12)


def test_furnace_with_shining_walls() -> None:
    # E everywhere and albedo rho: E / (1 - rho) everywhere.
    room = tuple(
        Piece(p.axis, p.at, p.facing, p.low, p.high, np.array([0.3, 0.9]), np.array([1.0, 2.0])) for p in grey_room()
    )
    seen = radiosity.look(
        room, np.tile([1.0, 1.0, 1.0], (3, 1)), np.array([[1, 0.2, 0.3], [0, 0, 1], [-1, 2, -3]]), 1.0
    )
    np.testing.assert_allclose(seen.radiance, np.broadcast_to([1 / 0.7, 20.0], (3, 2)) / np.pi, rtol=1e-12)


def test_power_of_the_lamp_ends_in_the_walls() -> None:
    sent, kept = radiosity.solve(grey_room(0.8), 0.5).power_in_and_out()
    np.testing.assert_allclose(kept, sent, rtol=1e-12)
    np.testing.assert_allclose(sent, 0.8, rtol=1e-12)


def test_first_reflection_is_exact_for_any_cut() -> None:
    # Black walls but for one point's own albedo: the light of the lamp alone, by Lambert's factor.
    room = list(grey_room(0.0))
    floor = next(n for n, p in enumerate(room) if p.axis == 2 and p.facing == 1)
    old = room[floor]
    room[floor] = Piece(2, 0.0, 1, old.low, old.high, np.array([0.7]), np.zeros(1))
    origin, down = np.array([[1.5, 1.0, 1.2]]), np.array([[0.0, 0.0, -1.0]])
    seen = radiosity.look(tuple(room), origin, down, 1.0)
    # B-3: element parallel to a rectangle a x b at height h, below its corner; four such quarters.
    a, b = 0.5 / 2.5, 0.4 / 2.5
    u, v = np.hypot(1, a), np.hypot(1, b)
    factor = 4 / (2 * np.pi) * (a / u * np.arctan(b / u) + b / v * np.arctan(a / v))
    assert seen.radiance[0, 0] == pytest.approx(0.7 * factor / np.pi, rel=1e-12)


def test_extrapolation_over_the_patches() -> None:
    room = grey_room(0.8)
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(60, 3))
    origins = np.tile([1.2, 1.0, 1.1], (60, 1))
    coarse, fine = (radiosity.look(room, origins, directions, edge) for edge in (1.0, 0.5))
    # The size of the differences falls, and bounds what is left: judged by patches half as large.
    assert coarse.error > 1.4 * fine.error
    assert fine.error < 8e-3
    left = np.sqrt(((coarse.radiance - fine.radiance) ** 2).mean()) / fine.radiance.mean()
    assert left < coarse.error


def test_plain_walks_find_the_same() -> None:
    room = grey_room(0.6)
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(8, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = np.tile([1.2, 1.0, 1.1], (8, 1))
    seen = radiosity.look(room, origins, directions, 0.5)
    found, error = plain_rooms.walk(room, plain_rooms.Fog(0.0, 0.0, 0.0), origins, directions, 0, 20_000, 1)
    assert_agrees(found, seen.radiance[:, 0], error, freedom=1000, slack=seen.error)
