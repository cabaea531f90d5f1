"""Light in an empty diffuse room, from closed-form view factors and a linear system: no ray is traced here.

The room is the inside of a box; each wall is made of axis-aligned rectangles with an albedo and an own exitance
(wavelength by wavelength).  Every rectangle is cut into patches of constant exitance B [W m-2 nm-1], which obey

    B_i = E_i + rho_i sum_j F_ij B_j

(Goral et al. 1984, SIGGRAPH 18, 213, eq. 8).  The view factors F_ij of rectangles in parallel and in perpendicular
planes are the double contour integral of Sparrow (1963, J. Heat Transfer 85, 81),

    A_1 F_12 = 1 / (2 pi)  oint oint  ln r  dr_1 . dr_2 ,

whose edges are all parallel or perpendicular, so that it is a sum of closed forms over corners (the same numbers as
configurations C-11, C-13 to C-15 of Howell's catalogue and Ehlert & Smith 1993, J. Thermophys. Heat Transfer 7, 173).
The light that reaches a *point* of a wall is summed over the patches with Lambert's exact factor from a surface element
to a polygon (Lambert 1760; Howell's B-3 and B-4 follow from it), so that only the course of the exitance within patches
is approximate; an extrapolation over the number of patches takes that off, and says how large it was.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: A point gathers light from patches cut so many times finer along both sides, see `Solution.irradiance`.
FINER = 4


@dataclass(frozen=True)
class Piece:
    """A rectangle of a wall; `axis` and `at` give its plane, `facing` (+1 or -1) its normal along that axis.

    `low` and `high` bound it along the two other axes, in rising order of axes; albedo and exitance are (wavelength,).
    """

    axis: int
    at: float
    facing: int
    low: tuple[float, float]
    high: tuple[float, float]
    albedo: Array
    exitance: Array


@dataclass(frozen=True)
class Patches:
    """Many rectangles at once: the same as `Piece`, one entry each; `piece` tells where they come from."""

    axis: NDArray[np.int64]
    at: Array
    facing: NDArray[np.int64]
    low: Array  #: (patch, 2)
    high: Array  #: (patch, 2)
    piece: NDArray[np.int64]

    @property
    def area(self) -> Array:
        """[m2]."""
        return np.asarray((self.high - self.low).prod(axis=1))

    def take(self, chosen: NDArray[np.bool_]) -> Patches:
        """Some of them."""
        parts = (self.axis, self.at, self.facing, self.low, self.high, self.piece)
        return Patches(*(part[chosen] for part in parts))  # type: ignore[arg-type]

    def corners(self) -> Array:
        """Corners (patch, 4, 3), anticlockwise as seen from where the normal points to."""
        points = np.empty((self.axis.size, 4, 3))
        for axis in range(3):
            mine = self.axis == axis
            u, v = (k for k in range(3) if k != axis)
            points[mine, :, axis] = self.at[mine, None]
            points[mine, :, u] = np.stack([b[mine, 0] for b in (self.low, self.high, self.high, self.low)], axis=1)
            points[mine, :, v] = np.stack([b[mine, 1] for b in (self.low, self.low, self.high, self.high)], axis=1)
        # (u, v, axis) is right-handed for axes x and z, left-handed for y.
        turned = np.where(self.axis == 1, -1, 1) != self.facing
        points[turned] = points[turned][:, ::-1]
        return points


def room(
    size: ArrayLike, albedo: dict[str, ArrayLike], lamp: tuple[float, float, float, float] | None, exitance: ArrayLike
) -> tuple[Piece, ...]:
    """Walls "x-", "x+", ... of a box from the origin to `size`; the lamp is a rectangle x0, y0, x1, y1 of the ceiling.

    The lamp shines evenly with the diffuse `exitance` [W m-2 nm-1] and reflects with the albedo "lamp", else not.
    """
    size, light = np.asarray(size, float), np.atleast_1d(np.asarray(exitance, float))
    dark, made = np.zeros_like(light), []
    for axis in range(3):
        u, v = (k for k in range(3) if k != axis)
        for sign, at in (("-", 0.0), ("+", float(size[axis]))):
            rho = np.broadcast_to(np.asarray(albedo["xyz"[axis] + sign], float), light.shape)
            facing = 1 if sign == "-" else -1
            spans = [((0.0, 0.0), (float(size[u]), float(size[v])))]
            if axis == 2 and sign == "+" and lamp is not None:
                spans = around(lamp, (float(size[0]), float(size[1])))
            made += [Piece(axis, at, facing, low, high, rho, dark) for low, high in spans]
    if lamp is not None:
        rho = np.broadcast_to(np.asarray(albedo.get("lamp", 0.0), float), light.shape)
        made.append(Piece(2, float(size[2]), -1, (lamp[0], lamp[1]), (lamp[2], lamp[3]), rho, light))
    return tuple(made)


def around(
    hole: tuple[float, float, float, float], size: tuple[float, float]
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The eight rectangles (low, high) that a rectangle from the origin is made of, without a hole in its midst."""
    xs, ys = (0.0, hole[0], hole[2], size[0]), (0.0, hole[1], hole[3], size[1])
    return [((xs[i], ys[j]), (xs[i + 1], ys[j + 1])) for i in range(3) for j in range(3) if (i, j) != (1, 1)]


def cut(pieces: Iterable[Piece], edge: float) -> Patches:
    """Cut rectangles into patches with sides of `edge` [m] in the mean at most."""
    return join([lay(piece, number, grid_of(piece, edge)) for number, piece in enumerate(pieces)])


def grid_of(piece: Piece, edge: float) -> tuple[int, int]:
    """Numbers of patches along both axes."""
    u, v = (max(1, math.ceil((piece.high[k] - piece.low[k]) / edge * (1 - 1e-9))) for k in range(2))
    return u, v


def lay(piece: Piece, number: int, shape: tuple[int, int]) -> Patches:
    """A grid of patches on a rectangle, finer towards its edges, where the exitance changes fastest.

    Even steps of the angle a with x = (1 - cos a) / 2: linear interpolation in a is of second order, at edges too.
    """
    steps = [0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count + 1)) for count in shape]
    lines = [piece.low[k] + (piece.high[k] - piece.low[k]) * steps[k] for k in range(2)]
    low = np.stack(np.meshgrid(lines[0][:-1], lines[1][:-1], indexing="ij"), axis=-1).reshape(-1, 2)
    high = np.stack(np.meshgrid(lines[0][1:], lines[1][1:], indexing="ij"), axis=-1).reshape(-1, 2)
    axis, facing, numbers = (np.full(len(low), value) for value in (piece.axis, piece.facing, number))
    return Patches(axis, np.full(len(low), float(piece.at)), facing, low, high, numbers)


def join(parts: Sequence[Patches]) -> Patches:
    """Many sets of patches as one."""
    names = ("axis", "at", "facing", "low", "high", "piece")
    return Patches(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def between(count: int, finer: int) -> Array:
    """Matrix (count * finer, count): from values at cells to those at finer cells, linearly in their number."""
    if count == 1:
        return np.ones((finer, 1))
    where = (np.arange(count * finer) + 0.5) / finer - 0.5
    first = np.clip(np.floor(where).astype(int), 0, count - 2)
    matrix = np.zeros((count * finer, count))
    rows = np.arange(count * finer)
    matrix[rows, first], matrix[rows, first + 1] = 1.0 - (where - first), where - first
    return matrix


def away(patches: Patches, point: Array, normal: Array) -> NDArray[np.bool_]:
    """Those patches that do not lie in the plane of a point and its normal."""
    axis = int(np.abs(normal).argmax())
    return np.asarray((patches.axis != axis) | (np.abs(patches.at - point[axis]) > 1e-9))


def _log(square: Array) -> Array:
    """ln r from r^2; 0 where r = 0, for the factors in front of it vanish there."""
    return np.asarray(0.5 * np.log(np.where(square > 0, square, 1.0)))


def _angle(a: Array, b: Array) -> Array:
    """a b atan(a / b) with b >= 0, and 0 for b = 0."""
    return np.asarray(a * b * np.arctan2(a, b))


def parallel_exchange(low_1: Array, high_1: Array, low_2: Array, high_2: Array, distance: ArrayLike) -> Array:
    """A_1 F_12 [m2] of rectangles that face each other in planes at a distance; bounds (..., 2).

    Only edges along the same axis count.  Summed over both axes, the double integral of ln r is
    s b atan(s / b) + t a atan(t / a) - z^2 ln r  for each pair of corners, with their offsets s and t, b^2 = t^2 + z^2,
    a^2 = s^2 + z^2, r^2 = s^2 + t^2 + z^2; what is linear in s or t cancels in the alternating sum.
    """
    total = np.zeros(np.broadcast_shapes(low_1.shape[:-1], low_2.shape[:-1], np.shape(distance)))
    z = np.asarray(distance)
    for signs, s, t in _corner_pairs(low_1, high_1, low_2, high_2):
        a, b = np.hypot(s, z), np.hypot(t, z)
        total += signs * (_angle(t, a) + _angle(s, b) - z * z * _log(s * s + t * t + z * z))
    return np.asarray(total / (2.0 * np.pi))


def perpendicular_exchange(
    along_1: tuple[Array, Array], across_1: tuple[Array, Array], along_2: tuple[Array, Array],
    across_2: tuple[Array, Array],
) -> Array:  # fmt: skip
    """A_1 F_12 [m2] of rectangles in perpendicular planes.

    `along` are their bounds along the line where their planes meet, `across` their distances from it (>= 0).  Only
    edges along that line are parallel to each other; their double integral is
    t c atan(t / c) + (t^2 - c^2) / 2 ln r  with c^2 = x_1^2 + x_2^2, r^2 = t^2 + c^2.
    """
    shapes = [np.shape(bound) for bounds in (along_1, across_1, along_2, across_2) for bound in bounds]
    total = np.zeros(np.broadcast_shapes(*shapes))
    for i in range(2):
        for j in range(2):
            c = np.hypot(across_1[i], across_2[j])
            for k in range(2):
                for m in range(2):
                    t = along_1[k] - along_2[m]
                    term = _angle(t, c) + 0.5 * (t * t - c * c) * _log(t * t + c * c)
                    total += (-1) ** (i + j + k + m) * term
    return np.asarray(total / (2.0 * np.pi))


def _corner_pairs(low_1: Array, high_1: Array, low_2: Array, high_2: Array) -> Iterable[tuple[int, Array, Array]]:
    """Signs and offsets along both axes of all 16 pairs of corners."""
    ends_1, ends_2 = (low_1, high_1), (low_2, high_2)
    for i in range(2):
        for k in range(2):
            s = ends_1[i][..., 0] - ends_2[k][..., 0]
            for j in range(2):
                for m in range(2):
                    yield (-1) ** (i + j + k + m), s, ends_1[j][..., 1] - ends_2[m][..., 1]


def exchange(patches: Patches) -> Array:
    """A_i F_ij [m2] of all pairs (patch, patch) of a convex room, symmetric."""
    count = patches.axis.size
    result = np.zeros((count, count))
    planes = sorted({(int(a), float(p)) for a, p in zip(patches.axis, patches.at, strict=True)})
    for n, (axis_1, at_1) in enumerate(planes):
        first = (patches.axis == axis_1) & (patches.at == at_1)
        for axis_2, at_2 in planes[n + 1 :]:
            second = (patches.axis == axis_2) & (patches.at == at_2)
            block = _block(patches.take(first), patches.take(second))
            result[np.ix_(first, second)] = block
            result[np.ix_(second, first)] = block.T
    return result


def _block(one: Patches, two: Patches) -> Array:
    """A_i F_ij between the patches of two planes."""
    low_1, high_1, low_2, high_2 = one.low[:, None], one.high[:, None], two.low[None], two.high[None]
    axis_1, axis_2 = int(one.axis[0]), int(two.axis[0])
    if axis_1 == axis_2:
        return parallel_exchange(low_1, high_1, low_2, high_2, np.abs(one.at[0] - two.at[0]))
    line = 3 - axis_1 - axis_2
    return perpendicular_exchange(
        _span(low_1, high_1, axis_1, line), _away(low_1, high_1, axis_1, axis_2, float(two.at[0])),
        _span(low_2, high_2, axis_2, line), _away(low_2, high_2, axis_2, axis_1, float(one.at[0])),
    )  # fmt: skip


def _span(low: Array, high: Array, own: int, axis: int) -> tuple[Array, Array]:
    """Bounds along an axis of rectangles whose plane is normal to the axis `own`."""
    column = [k for k in range(3) if k != own].index(axis)
    return low[..., column], high[..., column]


def _away(low: Array, high: Array, own: int, axis: int, at: float) -> tuple[Array, Array]:
    """The same as distances from a plane at `at`, rising."""
    ends = [np.abs(bound - at) for bound in _span(low, high, own, axis)]
    return np.minimum(*ends), np.maximum(*ends)


def element_factors(points: Array, normals: Array, patches: Patches) -> Array:
    """Share F (point, patch) of the light of surface elements (point, 3) that reaches each patch: Lambert's formula.

    Exact where the patch does not reach below the horizon of the element, as in a convex room.
    """
    offsets = patches.corners()[None] - points[:, None, None]  # (point, patch, corner, 3)
    length = np.linalg.norm(offsets, axis=-1)
    following, length_2 = np.roll(offsets, -1, axis=2), np.roll(length, -1, axis=2)
    normal = np.cross(offsets, following)
    sine = np.linalg.norm(normal, axis=-1)
    angle = np.arctan2(sine, (offsets * following).sum(axis=-1))
    projected = (normal * normals[:, None, None]).sum(axis=-1)
    edges = np.where(sine > 1e-14 * length * length_2, angle * projected / np.where(sine > 0, sine, 1.0), 0.0)
    # Corners run anticlockwise as seen from the room, so clockwise seen along our normals' side: the sign turns.
    return np.asarray(np.maximum(-edges.sum(axis=2), 0.0) / (2.0 * np.pi))


@dataclass(frozen=True)
class Solution:
    """Exitances [W m-2 nm-1] (patch, wavelength) of a room cut into patches."""

    pieces: tuple[Piece, ...]
    edge: float
    patches: Patches
    exitance: Array

    def irradiance(self, points: Array, normals: Array) -> Array:
        """[W m-2 nm-1] (point, wavelength) at points of the walls.

        Each patch counts as `FINER`^2 ones, whose exitance goes linearly from patch to patch.
        """
        parts, values = [], []
        for number, piece in enumerate(self.pieces):
            mine = self.patches.piece == number
            shape = grid_of(piece, self.edge)
            lattice = self.exitance[mine].reshape(*shape, -1)
            rows, columns = (between(count, FINER) for count in shape)
            values.append(np.einsum("iu,jv,uvw->ijw", rows, columns, lattice).reshape(-1, lattice.shape[-1]))
            parts.append(lay(piece, number, (shape[0] * FINER, shape[1] * FINER)))
        fine, exitance = join(parts), np.concatenate(values)
        result = np.empty((len(points), exitance.shape[1]))
        for k in range(len(points)):
            there = away(fine, points[k], normals[k])
            result[k] = element_factors(points[k : k + 1], normals[k : k + 1], fine.take(there))[0] @ exitance[there]
        return result

    def power_in_and_out(self) -> tuple[Array, Array]:
        """Power that the lamps send out and power that walls absorb [W nm-1], (wavelength,) each."""
        own = np.array([piece.exitance for piece in self.pieces])[self.patches.piece]
        rho = np.array([piece.albedo for piece in self.pieces])[self.patches.piece]
        arriving = (exchange(self.patches) @ self.exitance) / self.patches.area[:, None]
        area = self.patches.area[:, None]
        return (own * area).sum(axis=0), ((1 - rho) * arriving * area).sum(axis=0)


def solve(pieces: tuple[Piece, ...], edge: float) -> Solution:
    """Exitances of a room whose walls are cut into patches, see `cut`."""
    patches = cut(pieces, edge)
    factors = exchange(patches) / patches.area[:, None]
    own = np.array([piece.exitance for piece in pieces])[patches.piece]
    rho = np.array([piece.albedo for piece in pieces])[patches.piece]
    exitance = np.empty_like(own)
    for k in range(own.shape[1]):
        exitance[:, k] = np.linalg.solve(np.eye(len(factors)) - rho[:, k, None] * factors, own[:, k])
    return Solution(pieces, edge, patches, exitance)


@dataclass(frozen=True)
class Seen:
    """Radiance [W m-2 sr-1 nm-1] (ray, wavelength), and a bound of its error relative to the mean."""

    radiance: Array
    error: float


def look(pieces: tuple[Piece, ...], origins: Array, directions: Array, edge: float) -> Seen:
    """What rays (ray, 3) from inside the room see: the radiance of the walls, extrapolated over the size of patches.

    The room is solved with patches of `edge` and `edge` / 2 [m], see `cut`.  Averages over patches and the linear
    course between them are of second order in the size, so a third of the difference is added once more.  The bound is
    all of the difference, root mean square over rays: it holds as soon as the order is at least the first.
    """
    points, normals, piece = hit_walls(pieces, origins, directions)
    own = np.array([p.exitance for p in pieces])[piece]
    rho = np.array([p.albedo for p in pieces])[piece]
    coarse, fine = ((own + rho * solve(pieces, size).irradiance(points, normals)) / np.pi for size in (edge, edge / 2))
    change = fine - coarse
    return Seen(np.asarray(fine + change / 3.0), float(np.sqrt((change**2).mean()) / fine.mean()))


def hit_walls(pieces: tuple[Piece, ...], origins: Array, directions: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Where rays (ray, 3) from inside a convex room meet its walls: points, inward normals, and the piece."""
    best = np.full(len(origins), np.inf)
    number = np.full(len(origins), -1)
    for n, piece in enumerate(pieces):
        u, v = (k for k in range(3) if k != piece.axis)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (piece.at - origins[:, piece.axis]) / directions[:, piece.axis]
        x = origins + np.where(np.isfinite(t), t, 0.0)[:, None] * directions
        inside = (x[:, u] >= piece.low[0]) & (x[:, u] <= piece.high[0])
        inside &= (x[:, v] >= piece.low[1]) & (x[:, v] <= piece.high[1])
        nearer = inside & np.isfinite(t) & (t > 1e-9) & (t < best)
        best[nearer], number[nearer] = t[nearer], n
    if np.any(number < 0):
        raise ValueError("a ray leaves the room: its origin is outside")
    points = origins + best[:, None] * directions
    normals = np.zeros_like(points)
    for n, piece in enumerate(pieces):
        normals[number == n, piece.axis] = piece.facing
        points[number == n, piece.axis] = piece.at
    return points, normals, number
