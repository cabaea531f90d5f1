"""Stars as pictures show them: points, dimmed and reddened by what lies before them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.solvers.base import Array, Rays
from skyscatter.solvers.volume import compile_volume

if TYPE_CHECKING:
    from skyscatter.space import SpaceScene

#: Pixels around a star in which the light scattered once is averaged over the pixel, and rays along its sides.
CLOSE, SUBPIXELS = 2.5, 8


def dimmed(scene: SpaceScene, points: Array, wl: Array) -> Array:
    """Transmittance from the observer to points (n, 3) [m]; shape (n, wavelength)."""
    from skyscatter.solvers.kernels.space import fill_columns, make_space_work

    table = compile_volume(scene, tuple(float(w) for w in wl))
    columns = np.zeros((len(points), len(table.sigma_t)))
    observer = np.broadcast_to(scene.view.position, points.shape)
    # Copies: a broadcast array would be another type, for which kernels are compiled anew.
    fill_columns(table.space, np.array(observer, order="C"), np.array(points, order="C"), make_space_work(), columns)
    return np.asarray(np.exp(-columns @ table.sigma_t))


def star_images(scene: SpaceScene, camera: Any, wl: Array) -> Array:
    """Radiance (y, x, wavelength) that the stars add to the pixels of a picture [W m-2 sr-1 nm-1].

    A star's flux is divided between the four pixels around it so that its place is kept.  Stars of the field behind are
    as far away as the telescope's picture is wide: behind everything.
    """
    picture = np.zeros((camera.height, camera.width, wl.size))
    per_pixel = camera.pixel_solid_angle(scene.view)
    for star in scene.stars:
        offset = np.asarray(star.position) - scene.view.position
        distance = float(np.linalg.norm(offset))
        flux = star.spectral_luminosity(wl, scene.view.distance) / (4 * np.pi * distance**2)
        through = dimmed(scene, np.array([star.position], float), wl)
        x, y = camera.pixel(offset[None, :] / distance, scene.view)
        _splat(picture, x, y, flux * through)
    if scene.star_field is not None:
        _add_field(picture, scene, camera, wl)
    return picture / per_pixel[..., None]


def _add_field(picture: Array, scene: SpaceScene, camera: Any, wl: Array) -> None:
    scale = camera.pixel_scale_deg
    stars = scene.star_field.stars((camera.width * scale, camera.height * scale)) if scene.star_field else None
    if stars is None or not stars.x_deg.size:
        return
    view = scene.view
    plane = np.radians(np.stack([stars.x_deg, stars.y_deg], axis=1))
    direction = view.forward + plane @ np.stack([view.right, view.up])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    low, high = (np.array(edge) for edge in zip(*(field.bounds for field in scene.medium.fields), strict=True))
    behind = view.distance + 4 * float(np.abs([low.min(), high.max()]).max())
    through = dimmed(scene, view.position + behind * direction, wl)
    x, y = camera.pixel(direction, view)
    _splat(picture, x, y, stars.fluxes(wl) * through)


def _splat(picture: Array, x: Array, y: Array, flux: Array) -> None:
    """Divide fluxes (n, wavelength) at fractional pixels between the four around each."""
    seen = np.isfinite(x) & np.isfinite(y)
    x, y, flux = x[seen], y[seen], flux[seen]
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    height, width = picture.shape[:2]
    for across in (0, 1):
        for down in (0, 1):
            share = (x - i if across else 1 - x + i) * (y - j if down else 1 - y + j)
            inside = (i + across >= 0) & (i + across < width) & (j + down >= 0) & (j + down < height)
            at = (j[inside] + down, i[inside] + across)
            np.add.at(picture, at, share[inside, None] * flux[inside])


def close_correction(scene: SpaceScene, camera: Any, wl: Array, tolerance: float) -> tuple[Any, Array] | None:
    """Pixels near a star, and what averaging the light scattered once over them adds to that along their middle.

    That light rises as 1 / distance towards a star in the dust: finite for every pixel, but not along every ray.
    """
    from skyscatter.solvers.volume_single import single_parts

    near = np.zeros((camera.height, camera.width), bool)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    for star in scene.stars:
        offset = np.asarray(star.position) - scene.view.position
        x, y = camera.pixel(offset[None, :] / np.linalg.norm(offset), scene.view)
        if np.isfinite(x[0]):
            near |= (rows - y[0]) ** 2 + (columns - x[0]) ** 2 < CLOSE**2
    if not near.any():
        return None
    fine = camera.model_copy(
        update={
            "width": camera.width * SUBPIXELS,
            "height": camera.height * SUBPIXELS,
            "pixel_scale_deg": camera.pixel_scale_deg / SUBPIXELS,
        }
    )
    table = compile_volume(scene, tuple(float(w) for w in wl))
    j, i = np.nonzero(near)
    inner = np.arange(SUBPIXELS)
    every = (j[:, None, None] * SUBPIXELS + inner[:, None], i[:, None, None] * SUBPIXELS + inner)
    directions = np.concatenate(
        [_towards(fine, scene, *every).reshape(-1, 3), _towards(camera, scene, j, i).reshape(-1, 3)]
    )
    origins = np.tile(scene.view.position, (len(directions), 1))
    rays = Rays(origins, directions, np.arange(len(directions)))
    light = single_parts(table, rays, tolerance)[0]
    mean = light[: -len(j)].reshape(len(j), -1, wl.size).mean(axis=1)
    return near, mean - light[-len(j) :]


def _towards(camera: Any, scene: SpaceScene, rows: Any, columns: Any) -> Array:
    """Directions through some pixels, without those of all the others."""
    view, step = scene.view, np.radians(camera.pixel_scale_deg)
    rows, columns = np.broadcast_arrays(rows, columns)
    a = (columns - (camera.width - 1) / 2) * step
    b = ((camera.height - 1) / 2 - rows) * step
    d = view.forward + a[..., None] * view.right + b[..., None] * view.up
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))
