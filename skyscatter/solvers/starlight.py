"""Stars as pictures show them: points, dimmed and reddened by what lies before them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.base import Array, Rays
from skyscatter.solvers.volume import compile_volume

if TYPE_CHECKING:
    from skyscatter.space import SpaceScene

#: Pixels around a star in which the light scattered once is averaged over the pixel, and rays along its sides.
CLOSE, SUBPIXELS = 2.5, 8
#: Pixel coordinates of a star, fractional (x, y) and whole (row, column), and its number.
Place = tuple[float, float, int, int, int]
#: Distance from a star [pixel] below which a ray is moved to its side.
LEAST_OFFSET = 0.2


def dimmed(scene: SpaceScene, points: Array, wl: Array) -> Array:
    """Transmittance from the observer to points (n, 3) [m]; shape (n, wavelength)."""
    from skyscatter.kernels.space import fill_columns, make_space_work

    table = compile_volume(scene, tuple(float(w) for w in wl))
    columns = np.zeros((len(points), len(table.sigma_t)))
    observer = np.broadcast_to(scene.view.position, points.shape)
    # Copies: a broadcast array would be another type, for which kernels are compiled anew.
    fill_columns(table.space, np.array(observer, order="C"), np.array(points, order="C"), make_space_work(), columns)
    return np.asarray(np.exp(-columns @ table.sigma_t))


class StarLight(NamedTuple):
    """Light of some stars in a picture.

    Attributes
    ----------
    x, y : ndarray, shape (star,)
        Fractional pixel coordinates.
    flux : ndarray, shape (star, wavelength)
        Before the telescope [W m-2 nm-1].
    """

    x: Array
    y: Array
    flux: Array


def star_light(scene: SpaceScene, camera: Any, wl: Array) -> list[StarLight]:
    """Where the stars stand in a picture, and how much of their light arrives.

    Stars of the field behind are as far away as the telescope's picture is wide: behind everything.
    """
    found = []
    for star in scene.stars:
        offset = np.asarray(star.position) - scene.view.position
        distance = float(np.linalg.norm(offset))
        flux = star.spectral_luminosity(wl, scene.view.distance) / (4 * np.pi * distance**2)
        through = dimmed(scene, np.array([star.position], float), wl)
        x, y = camera.pixel(offset[None, :] / distance, scene.view)
        found.append(StarLight(x, y, flux * through))
    field = None if scene.star_field is None else _field_light(scene, camera, wl)
    return found if field is None else [*found, field]


def star_images(
    scene: SpaceScene, camera: Any, wl: Array, rows: slice = slice(None), light: list[StarLight] | None = None
) -> Array:
    """Radiance (y, x, wavelength) that the stars add to the pixels of a picture [W m-2 sr-1 nm-1].

    A star's flux is divided between the four pixels around it so that its place is kept.

    Parameters
    ----------
    scene : SpaceScene
    camera : Telescope
    wl : ndarray, shape (wavelength,)
        [nm]
    rows : slice
        Of the picture, those that are wanted.
    light : list of StarLight, optional
        What `star_light` has found, where it is known.
    """
    first, last, _ = rows.indices(camera.height)
    picture = np.zeros((last - first, camera.width, wl.size))
    for some in star_light(scene, camera, wl) if light is None else light:
        _splat(picture, some, first, camera.height)
    return np.asarray(picture / camera.pixel_solid_angle(scene.view, rows)[..., None])


def _field_light(scene: SpaceScene, camera: Any, wl: Array) -> StarLight | None:
    scale = camera.pixel_scale_deg
    stars = scene.star_field.stars((camera.width * scale, camera.height * scale)) if scene.star_field else None
    if stars is None or not stars.x_deg.size:
        return None
    view = scene.view
    plane = np.radians(np.stack([stars.x_deg, stars.y_deg], axis=1))
    direction = view.forward + plane @ np.stack([view.right, view.up])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    low, high = (np.array(edge) for edge in zip(*(field.bounds for field in scene.medium.fields), strict=True))
    behind = view.distance + 4 * float(np.abs([low.min(), high.max()]).max())
    through = dimmed(scene, view.position + behind * direction, wl)
    x, y = camera.pixel(direction, view)
    return StarLight(x, y, stars.fluxes(wl) * through)


def _splat(picture: Array, light: StarLight, first: int, height: int) -> None:
    """Divide fluxes at fractional pixels between the four around each; none goes beyond the border of the picture.

    `picture` has the rows from the `first` one on of a picture that is so many rows high.
    """
    seen = np.isfinite(light.x) & np.isfinite(light.y)
    x, y, flux = light.x[seen], light.y[seen], light.flux[seen]
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    rows, width = picture.shape[:2]
    for across in (0, 1):
        for down in (0, 1):
            share = (x - i if across else 1 - x + i) * (y - j if down else 1 - y + j)
            row, column = np.clip(j + down, 0, height - 1) - first, np.clip(i + across, 0, width - 1)
            here = (row >= 0) & (row < rows)
            np.add.at(picture, (row[here], column[here]), share[here, None] * flux[here])


def beside_stars(scene: SpaceScene, camera: Any, grid: Array, first: int = 0) -> Array:
    """The directions of the rows of a picture from the `first` on, those that meet a star moved a little to its side.

    A ray through the star itself sees the dust in front of its surface, millions of times brighter than the pixel.
    """
    moved = grid.copy()
    for x, y, row, column, _ in _star_pixels(scene, camera):
        near = np.hypot(x - column, y - row) < LEAST_OFFSET
        if 0 <= row - first < len(grid) and 0 <= column < camera.width and near:
            moved[row - first, column] = camera.through(x + LEAST_OFFSET, y, scene.view)
    return moved


def _star_pixels(scene: SpaceScene, camera: Any) -> list[Place]:
    """Pixel coordinates of the stars that the camera sees, fractional and whole, and their numbers."""
    found = []
    for number, star in enumerate(scene.stars):
        offset = np.asarray(star.position) - scene.view.position
        x, y = (float(v[0]) for v in camera.pixel(offset[None, :] / np.linalg.norm(offset), scene.view))
        if np.isfinite(x):
            found.append((x, y, round(y), round(x), number))
    return found


def close_correction(
    scene: SpaceScene, camera: Any, grid: Array, wl: Array, tolerance: float, first: int = 0
) -> tuple[NDArray[np.bool_], Array] | None:
    """Pixels near a star, and what averaging the light scattered once over them adds to that along their ray.

    That light rises as 1 / distance towards a star in the dust: finite for every pixel, but not along every ray.  Each
    part of a pixel takes its ray's light times distance, which is smooth, and the mean of 1 / distance over the part.

    Parameters
    ----------
    scene : SpaceScene
    camera : Telescope
    grid : ndarray, shape (y, x, 3)
        Directions that were rendered; see `beside_stars`.
    wl : ndarray, shape (wavelength,)
        [nm]
    tolerance : float
        Of the solver that made the picture, so that the light along the ray is the same.
    first : int
        Row of the picture at which `grid` begins.
    """
    from skyscatter.solvers.volume_single import single_parts

    near = np.zeros(grid.shape[:2], bool)
    rows, columns = np.ogrid[first : first + len(grid), : camera.width]
    places = _star_pixels(scene, camera)
    for x, y, *_ in places:
        near |= (rows - y) ** 2 + (columns - x) ** 2 < CLOSE**2
    if not near.any():
        return None
    j, i = np.nonzero(near)
    inner = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    down, across = np.broadcast_arrays(first + j[:, None, None] + inner[:, None], i[:, None, None] + inner)
    across = _off_stars(across, down, places)
    directions = np.concatenate([camera.through(across, down, scene.view).reshape(-1, 3), grid[near]])
    origins = np.tile(scene.view.position, (len(directions), 1))
    table = compile_volume(scene, tuple(float(w) for w in wl))
    # Only light that is scattered next to the star rises towards it; around one in a cavity it is smooth.
    lit = np.array([any(field.density(star.position) > 0 for field in scene.medium.fields) for star in scene.stars])
    rays = Rays(origins, np.ascontiguousarray(directions), np.arange(len(directions)))
    light = single_parts(table, rays, tolerance)[0]
    parts = light[: -len(j)].reshape(*down.shape, wl.size) * _singular_mean(across, down, places, lit)[..., None]
    return near, parts.mean(axis=(1, 2)) - light[-len(j) :]


def _off_stars(x: Array, y: Array, places: list[Place]) -> Array:
    """The coordinates x of parts of pixels, those that meet a star moved by a tenth of a part."""
    for star_x, star_y, *_ in places:
        x = np.where(np.hypot(x - star_x, y - star_y) < 0.1 / SUBPIXELS, star_x + 0.1 / SUBPIXELS, x)
    return x


def _singular_mean(x: Array, y: Array, places: list[Place], lit: NDArray[np.bool_]) -> Array:
    """Distance of (x, y) from the nearest star times the mean of 1 / distance over the part of a pixel around it.

    1 where the nearest star does not stand in the dust.
    """
    stars = np.array([place[:2] for place in places])
    nearest = np.argmin((x[..., None] - stars[:, 0]) ** 2 + (y[..., None] - stars[:, 1]) ** 2, axis=-1)
    a, b, half = x - stars[nearest, 0], y - stars[nearest, 1], 0.5 / SUBPIXELS

    def corner(u: Array, v: Array) -> Array:
        # The integral of 1 / sqrt(u^2 + v^2) over both.
        tiny = 1e-12
        return u * np.arcsinh(v / np.maximum(np.abs(u), tiny)) + v * np.arcsinh(u / np.maximum(np.abs(v), tiny))

    whole = sum(su * sv * corner(a + su * half, b + sv * half) for su in (-1, 1) for sv in (-1, 1))
    return np.where(lit[[place[4] for place in places]][nearest], np.hypot(a, b) * whole / (2 * half) ** 2, 1.0)
