"""The Sun's disk in pictures: its light averaged over pixels, however large, with exact edges.

The plane of the picture is cut into cells, and those that the edge of the disk or the horizon crosses are halved until
they are small beside the disk: a quadtree that costs the same whether the disk is a thousandth of a pixel or thousands
of them.  The light of all cells of a pixel, divided by its solid angle, is its radiance; so the radiance of a picture
times the solid angles of its pixels sums to the irradiance that comes straight from the Sun.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.direct import disk_light, shine
from skyscatter.solvers.eclipse import eclipse_of, moon_drawn

#: Cells across a picture at first: 5 degrees for a panorama, small enough to judge a cell by its corners.
FIRST_ACROSS, FIRST_DOWN = 72, 36
#: Cells are larger than the distance from their middles to the corners says, by curvature: at most by this factor.
MARGIN = 1.1
#: Largest half diagonal of a cell as a share of the disk's radius: within the disk; on an edge, for edges are straight
#: within a cell, which misses a^2 / 6 of the light; and between them, as a share of the distance from the edge, from
#: which the light rises as a root.
WITHIN, ON_EDGE, RISE = 1 / 12, 1 / 120, 1 / 4
#: The same in an eclipse, as a share of the width of what is seen of the Sun, and at least as a share of its radius.
OF_CRESCENT, FINEST = 1 / 12, 1 / 2000
#: A pixel smaller than its limit by this factor is as bright as along its middle.
EVEN = 1 / 3
#: Cells at most.  Only a picture of the whole sky whose rim, one point of the sky, meets the Sun asks for more.
MOST_CELLS = 100_000
#: Side of a cell on an edge [pixel] at most, so that edges look smooth.
EDGE_SIDE = 0.25

#: Rings and azimuths over which the disk is summed to a lamp.
LAMP_RINGS, LAMP_TURNS = 64, 256

#: Gauss-Legendre rule of 2 points on [0, 1], over the height of a cell on an edge.
GAUSS = tuple(0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(2), (1.0, 0.0), strict=True))


#: Points along each side of a cell at which one looks for what stands before the disk.
VEIL_POINTS = 4
#: What is left of light from directions (ray, 3), (ray, wavelength).
Veil = Callable[[Array], Array]


def no_veil(directions: Array) -> Array:
    """That of a sky that holds nothing but air."""
    return np.ones((len(directions), 1))


class Cells(NamedTuple):
    """Rectangles of a picture's plane, and how they lie beside the Sun."""

    start: Array  #: (cell, 2) lowest x and y [pixel]
    side: Array  #: (cell, 2) widths and heights [pixel]
    middle: Array  #: (cell, 3) direction
    across: Array  #: (cell, 2, 3) change of direction along x and y
    half: Array  #: (cell,) half diagonal, with its margin [rad]
    solid_angle: Array  #: (cell,) [sr]
    distance: Array  #: (cell,) from the middle of the disk [rad]
    height: Array  #: (cell,) above the horizon [rad]
    moon: Array  #: (cell,) distance from the Moon's limb, negative behind the Moon [rad]
    from_moon: Array  #: (cell, 3) direction away from its middle, of any length


class Sight(NamedTuple):
    """What is looked at, from where and how."""

    camera: Any
    observer: Any
    sun: Array  #: (3,) direction
    radius: float  #: of the disk [rad]
    horizon: float  #: elevation of the horizon, at most 0 [rad]
    moon: Array | None = None  #: (3,) direction of the Moon in an eclipse
    moon_radius: float = 0.0  #: of its disk [rad]
    edge: float = ON_EDGE  #: largest half diagonal of cells on an edge, as a share of the Sun's radius


def disk_correction(
    scene: Scene, table: Any, camera: Any, grid: Array, veil: Veil = no_veil
) -> tuple[NDArray[np.intp], Array] | None:
    """Pixels that the Sun's disk touches, and what averaging it over them adds to the radiance along their middle.

    Parameters
    ----------
    scene : Scene
    table : SceneTable
        Of its air.
    camera : Camera
    grid : ndarray, shape (y, x, 3)
        Directions through the middles of the pixels, NaN outside the field.
    veil : callable
        What is left of light from directions (ray, 3) by what stands or floats in the air, (ray, wavelength).

    Returns
    -------
    (pixel,) int, (pixel, wavelength)
        Numbers of the pixels in reading order and radiance [W m-2 sr-1 nm-1]; None where the disk is not seen.
    """
    radius = float(table.optics.disk_radius)
    if radius <= 0:
        return None
    position = np.asarray(scene.observer.position)
    dip = math.acos(min(table.columns.radius / float(np.linalg.norm(position)), 1.0))
    sight = _sight(scene, camera, table.optics.disk_axis, radius, -dip)
    cells = cut_cells(sight)
    # A pixel that lies within the disk is as bright as along its middle.
    pixels, kept = _pixels(sight, cells, np.isfinite(grid[..., 0]))
    kept &= ~_whole(sight, cells)
    pixels, cells = pixels[kept], _chosen(cells, kept)
    if not pixels.size:
        return None
    order = np.argsort(pixels, kind="stable")
    touched, first = np.unique(pixels[order], return_index=True)
    cells = _chosen(cells, order)
    light = np.add.reduceat(_light(sight, cells, table, position) * _veiled(cells, veil), first, axis=0)
    light /= camera.pixel_solid_angle(scene.observer).ravel()[touched, None]
    middles = grid.reshape(-1, 3)[touched]
    along = disk_light(table, position, middles) * veil(middles)
    return touched, light - along * ~_behind_moon(sight, middles)[:, None]


def _sight(scene: Scene, camera: Any, sun: Array, radius: float, horizon: float) -> Sight:
    """What is looked at; in an eclipse with the Moon."""
    eclipse = eclipse_of(scene)
    if eclipse is None:
        return Sight(camera, scene.observer, sun, radius, horizon)
    moon, moon_radius = moon_drawn(eclipse, sun, radius)
    # Of the crescent, or of the ring where it is narrowest.
    sign = -1.0 if eclipse.kind == "annular" else 1.0
    width = eclipse.sun_radius - eclipse.moon_radius + sign * eclipse.separation
    edge = float(np.clip(OF_CRESCENT * width / eclipse.sun_radius, FINEST, ON_EDGE))
    return Sight(camera, scene.observer, sun, radius, horizon, moon, moon_radius, edge)


def _behind_moon(sight: Sight, directions: Array) -> NDArray[np.bool_]:
    """Which directions the Moon is in the way of."""
    if sight.moon is None:
        return np.zeros(len(directions), bool)
    sine = np.linalg.norm(np.cross(directions, sight.moon), axis=1)
    return (sine < math.sin(sight.moon_radius)) & (directions @ sight.moon > 0)


def disk_along(scene: Scene, table: Any, grid: Array, wavelengths: Array) -> tuple[NDArray[np.intp], Array] | None:
    """Pixels whose middles may see the Sun's disk, and its radiance there, without the light of the background.

    Asked of the kernel that all solvers take direct light from, so that next to nothing is left where it is taken away.
    """
    from skyscatter.columns import transmittance
    from skyscatter.solvers.run import radiance

    directions, position = grid.reshape(-1, 3), np.asarray(scene.observer.position)
    with np.errstate(invalid="ignore"):
        beside = np.linalg.norm(directions - table.optics.disk_axis, axis=1) <= 2 * math.sin(table.optics.disk_radius)
    pixels = np.flatnonzero(beside)
    if not pixels.size:
        return None
    seen = directions[pixels]
    if scene.world:
        from skyscatter.solvers.worldlights import sun_along

        return pixels, sun_along(scene, wavelengths, seen)
    light = radiance(scene, position, seen, wavelengths, "single", parts=True).layers["direct"]
    if table.optics.background.any():
        away = 2 * float(np.linalg.norm(position)) + 2 * scene.medium.top
        light = light - table.optics.background * transmittance(scene, position, position + away * seen, wavelengths)
    return pixels, light


def sun_lamp(scene: Scene, table: Any, wavelengths: Array, veil: Veil = no_veil) -> dict[str, Any]:
    """The Sun as a lamp beside a picture without its disk, for recipes and other programs.

    Parameters
    ----------
    scene : Scene
    table : SceneTable
        Of its air.
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    veil : callable
        As for `disk_correction`.

    Returns
    -------
    dict
        ``azimuth_deg``, ``elevation_deg``, ``direction`` (east, north, up), ``angular_diameter_deg`` and
        ``irradiance``, on a plane that faces the Sun, after the air [W m-2 nm-1], one number for each wavelength; in an
        eclipse what passes the Moon.
    """
    from skyscatter.geometry.vectors import camera_frame

    sun, radius = scene.sun, float(table.optics.disk_radius)
    # Rings of equal solid angle, so many that a horizon across the disk is met to a thousandth of its light.
    square, turn = (np.arange(LAMP_RINGS) + 0.5) / LAMP_RINGS, 2 * np.pi * (np.arange(LAMP_TURNS) + 0.5) / LAMP_TURNS
    angle = 2 * np.arcsin(np.sqrt(square) * math.sin(radius / 2))[:, None]
    forward, right, up = camera_frame(sun.azimuth_deg, sun.elevation_deg)
    across = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * up
    points = np.cos(angle)[..., None] * forward + np.sin(angle)[..., None] * across
    flat = points.reshape(-1, 3)
    light = disk_light(table, np.asarray(scene.observer.position), flat) * veil(flat)
    weight = 4 * np.pi * math.sin(radius / 2) ** 2 / light.shape[0] * np.repeat(np.cos(angle).ravel(), LAMP_TURNS)
    eclipse = eclipse_of(scene)
    passed = np.ones(wavelengths.size) if eclipse is None else eclipse.light(wavelengths)
    return {
        "azimuth_deg": float(sun.azimuth_deg % 360.0),
        "elevation_deg": float(sun.elevation_deg),
        "direction": [float(x) for x in sun.direction],
        "angular_diameter_deg": math.degrees(2 * radius),
        "irradiance": [float(x) for x in passed * (weight @ light)],
    }


def cut_cells(sight: Sight) -> Cells:
    """Cells of the picture that make up what is seen of the disk."""
    camera = sight.camera
    side = 2.0 ** np.floor(np.log2([camera.width / FIRST_ACROSS, camera.height / FIRST_DOWN]))
    number = [math.ceil(camera.width / side[0]), math.ceil(camera.height / side[1])]
    start = np.stack(np.meshgrid(*(np.arange(n) * s for n, s in zip(number, side, strict=True))), axis=-1) - 0.5
    waiting = _measure(sight, start.reshape(-1, 2), np.broadcast_to(side, (start.size // 2, 2)))
    done = []
    while len(waiting.half):
        near = (waiting.distance - waiting.half < sight.radius) & (waiting.height + waiting.half > sight.horizon)
        waiting = _chosen(waiting, near & (waiting.solid_angle > 0) & (waiting.moon + waiting.half > 0))
        split = _unfinished(sight, waiting) & (len(waiting.half) < MOST_CELLS)
        done.append(_chosen(waiting, ~split))
        waiting = _measure(sight, *_halves(sight, _chosen(waiting, split)))
    return Cells(*(np.concatenate(values) for values in zip(*done, strict=True)))


def _chosen(cells: Cells, which: NDArray[Any]) -> Cells:
    return Cells(*(values[which] for values in cells))


def _measure(sight: Sight, start: Array, side: Array) -> Cells:
    """Cells by their rectangles, cut where the picture ends."""
    end = np.minimum(start + side, np.array([sight.camera.width, sight.camera.height]) - 0.5)
    x, y = np.stack([start[:, 0], end[:, 0]]), np.stack([start[:, 1], end[:, 1]])
    middle = sight.camera.through(x.mean(axis=0), y.mean(axis=0), sight.observer)
    corners = sight.camera.through(x[:, None], y[None, :], sight.observer)  # (x, y, cell, 3)
    across = np.stack([np.diff(corners, axis=0).mean(axis=(0, 1)), np.diff(corners, axis=1).mean(axis=(0, 1))], axis=1)
    half = 2 * np.arcsin(np.minimum(np.linalg.norm(corners - middle, axis=-1).max(axis=(0, 1), initial=0.0) / 2, 1.0))
    diagonals = np.cross(corners[1, 1] - corners[0, 0], corners[1, 0] - corners[0, 1])
    distance = np.arctan2(np.linalg.norm(np.cross(middle, sight.sun), axis=-1), middle @ sight.sun)
    position = np.asarray(sight.observer.position)
    height = np.arcsin(np.clip(middle @ (position / np.linalg.norm(position)), -1.0, 1.0))
    from_moon, moon = np.zeros_like(middle), np.full(len(middle), np.inf)
    if sight.moon is not None:
        from_moon = middle - sight.moon
        moon = 2 * np.arcsin(np.minimum(np.linalg.norm(from_moon, axis=-1) / 2, 1.0)) - sight.moon_radius
    return Cells(
        start, side, middle, across, MARGIN * half, np.linalg.norm(diagonals, axis=-1) / 2, distance, height, moon,
        from_moon,
    )  # fmt: skip


def _on_edge(sight: Sight, cells: Cells) -> NDArray[np.bool_]:
    """Whether the edge of the disk or the horizon may cross a cell."""
    limbs = (cells.distance + cells.half > sight.radius) | (np.abs(cells.moon) < cells.half)
    return np.asarray(limbs | (cells.height - cells.half < sight.horizon))


def _limit(sight: Sight, cells: Cells) -> Array:
    """Largest half diagonal that a cell may have for what it shows [rad]."""
    from_edge = np.minimum(sight.radius - cells.distance, cells.height - sight.horizon) / sight.radius
    share = np.where(_on_edge(sight, cells), sight.edge, np.clip(RISE * from_edge, sight.edge, WITHIN))
    return np.asarray(sight.radius * share)


def _unfinished(sight: Sight, cells: Cells) -> NDArray[np.bool_]:
    """Whether a cell has to be halved: it is wider than a pixel, or coarse for what it shows."""
    widest = np.where(_on_edge(sight, cells), EDGE_SIDE, 1.0)[:, None]
    return (cells.half > _limit(sight, cells)) | (cells.side > widest).any(axis=1)


def _halves(sight: Sight, cells: Cells) -> tuple[Array, Array]:
    """Halves or quarters of cells: all sides that are wide beside the other one, or wider than a pixel."""
    length = np.linalg.norm(cells.across, axis=-1)
    cut = (length > 0.6 * length[:, ::-1]) | (cells.side > 1.0)
    side = np.where(cut, cells.side / 2, cells.side)
    end = np.array([sight.camera.width, sight.camera.height]) - 0.5
    starts, sides = [], []
    for step in np.array([[0, 0], [1, 0], [0, 1], [1, 1]]):
        start = cells.start + step * side
        real = (cut | (step == 0)).all(axis=1) & (start < end).all(axis=1)
        starts.append(start[real])
        sides.append(side[real])
    return np.concatenate(starts), np.concatenate(sides)


def _whole(sight: Sight, cells: Cells) -> NDArray[np.bool_]:
    """Whether a cell is a whole pixel within the disk in which the light is even."""
    even = (cells.half < EVEN * _limit(sight, cells)) & ~_on_edge(sight, cells)
    return even & (cells.side == 1.0).all(axis=1)


def _pixels(sight: Sight, cells: Cells, inside: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Number of the pixel of each cell, and whether it has one.

    At the rim of a round field, cells of pixels whose middles lie outside count for the next pixel inwards.
    """
    camera = sight.camera
    at = cells.start + cells.side / 2
    column, row = np.floor(at + 0.5).astype(int).T
    centre = np.array([camera.width - 1, camera.height - 1]) / 2
    inwards = (centre - at) / np.maximum(np.linalg.norm(centre - at, axis=1, keepdims=True), 1e-300)
    beyond = ~inside[row, column]
    column[beyond], row[beyond] = np.floor(at + inwards + 0.5).astype(int)[beyond].T
    # A part of the cell within the field is enough.
    nearest = (at + inwards * np.hypot(*cells.side.T)[:, None] / 2)[beyond]
    seen = camera.pixel(camera.through(*nearest.T, sight.observer), sight.observer)[0]
    kept = ~beyond
    kept[beyond] = np.isfinite(seen)
    kept &= inside[row, column]
    return row * camera.width + column, kept


def _light(sight: Sight, cells: Cells, table: Any, position: Array) -> Array:
    """Irradiance [W m-2 nm-1] from what a cell shows of the disk, shape (cell, wavelength)."""
    up = position / np.linalg.norm(position)
    edge = _on_edge(sight, cells)
    light = np.empty((len(edge), table.optics.albedo.size))
    for which, points in ((edge, _points_on_edge), (~edge, _points_within)):
        weight, distance, height = points(sight, _chosen(cells, which), up)
        square = np.sin(distance) ** 2 / math.sin(sight.radius) ** 2
        shown = shine(table, position, square.ravel(), np.sin(height).ravel())
        light[which] = np.einsum("pc,pcw->cw", weight, shown.reshape(*weight.shape, -1))
    return light


def _veiled(cells: Cells, veil: Veil) -> Array:
    """Mean of what a veil leaves of the light over each cell, (cell, wavelength)."""
    if veil is no_veil:
        return veil(cells.middle)
    inner = (np.arange(VEIL_POINTS) + 0.5) / VEIL_POINTS - 0.5
    x, y = (values.reshape(-1, 1, 1) for values in np.meshgrid(inner, inner))
    points = cells.middle + x * cells.across[:, 0] + y * cells.across[:, 1]
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    left = veil(points.reshape(-1, 3))
    return np.asarray(left.reshape(*points.shape[:2], -1).mean(axis=0))


def _points_within(sight: Sight, cells: Cells, up: Array) -> tuple[Array, Array, Array]:
    """Two by two Gauss points of cells: weight [sr], distance from the disk's middle and height, (point, cell) each."""
    offsets = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / math.sqrt(12)
    points = cells.middle + np.einsum("pk,ckj->pcj", offsets, cells.across)
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    sine = np.linalg.norm(np.cross(points, sight.sun), axis=-1)
    return np.tile(cells.solid_angle / 4, (4, 1)), np.arcsin(np.minimum(sine, 1.0)), np.arcsin(points @ up)


def _points_on_edge(sight: Sight, cells: Cells, up: Array) -> tuple[Array, Array, Array]:
    """As `_points_within` for the part of cells that is seen: in its middle by distance, at Gauss points by height."""
    upwards = up - cells.middle * (cells.middle @ up)[:, None]
    share, low, high = _below(cells.distance, sight.radius, _width(cells, cells.middle - sight.sun))
    distance = (low + high) / 2
    above, low, high = _below(-cells.height, -sight.horizon, _width(cells, upwards))
    if sight.moon is not None:
        share = share * (1.0 - _below(cells.moon, 0.0, _width(cells, cells.from_moon))[0])
    weight = np.outer(GAUSS[1], cells.solid_angle * share * above)
    return weight, np.broadcast_to(distance, weight.shape), -(low + np.outer(GAUSS[0], high - low))


def _width(cells: Cells, towards: Array) -> Array:
    """Width of cells [rad] in a direction, such that of an edge across it passes over them evenly."""
    unit = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-300)
    # The root of the squares: a square counts as its side, whichever way it is turned.
    return np.asarray(np.linalg.norm(np.einsum("ijk,ik->ij", cells.across, unit), axis=1))


def _below(at: Array, edge: float, width: Array) -> tuple[Array, Array, Array]:
    """Share of cells with middles `at` that lies below an edge, and the ends of that part."""
    low, high = at - width / 2, np.minimum(at + width / 2, edge)
    share = np.clip((edge - at) / np.maximum(width, 1e-300) + 0.5, 0.0, 1.0)
    return share, np.minimum(low, edge), np.maximum(high, np.minimum(low, edge))
