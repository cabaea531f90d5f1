"""Simulated satellite images: the light of a mapped ground above the atmosphere, all orders, by Monte Carlo.

The walks are those of the solver `path`; one walk serves all pixels, see `skyscatter.kernels.raster.simulate`.  So the
noise is that of the whole image's walks in every pixel, and nearly the same in all of them.  Nothing here knows the
correction terms by which images are dehazed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.ground import GroundMap
    from skyscatter.kernels.raster.simulate import Landscape, Sums
    from skyscatter.scene import Scene

Array = NDArray[np.float64]

#: Batches from whose spread the standard error is computed.
BATCHES = 16
#: Orders of scattering that are followed: roulette ends all walks long before.
MOST_ORDERS = 100_000


@dataclass(frozen=True)
class SimulatedImage:
    """What a sensor in orbit sees of mapped ground, and what is there.

    Attributes
    ----------
    reflectance, standard_error : ndarray, shape (band, y, x)
        At the top of the atmosphere: pi L / (E cos(Sun's zenith angle)).  The error has a part that all pixels share.
    surface : ndarray, shape (band, y, x)
        Albedo of the ground.
    """

    reflectance: Array
    standard_error: Array
    surface: Array


def simulate(
    scene: Scene,
    wavelengths: ArrayLike,
    size: tuple[int, int],
    *,
    view_zenith_deg: float = 0.0,
    view_azimuth_deg: float = 0.0,
    walks: int = 1 << 16,
    stokes: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> SimulatedImage:
    """Image of the middle part of a scene's ground map, a pixel for each cell, as a sensor in orbit sees it.

    Every pixel is seen along one ray through the middle of its cell, all pixels under the same angles to the sensor
    and to the Sun; the observer's altitude plays no part.

    Parameters
    ----------
    scene : Scene
        With a ground map; the star's disk and polarisation are treated as in `skyscatter.radiance`.
    wavelengths : array_like, shape (band,)
        Vacuum wavelengths [nm], rising; each stands for a narrow band.
    size : (int, int)
        Pixels along y and x; with the map's margin around them, half of it on either side.
    view_zenith_deg, view_azimuth_deg : float
        Direction from the ground to the sensor: zenith angle, azimuth from north through east [degree].
    walks : int
        Random walks for the whole image; rounded up to a multiple of 16.
    stokes : bool
        Treat light as polarised.
    seed : int
        Same seed, same numbers.
    progress : callable, optional
        Called with the finished share, 0 to 1.

    Returns
    -------
    SimulatedImage

    Raises
    ------
    DomainError
        For a scene without a map, a Sun that is down, light that is not the Sun's, angles or sizes out of range.
    """
    from skyscatter.dehaze.adjacency import line_of_sight
    from skyscatter.geometry.meridian import meridian_frame
    from skyscatter.ground import Ground
    from skyscatter.kernels.optics import GroundTable
    from skyscatter.kernels.polar import make_polar
    from skyscatter.kernels.raster.simulate import make_simulate_scratch, simulate_batch
    from skyscatter.solvers.checks import check_wavelengths
    from skyscatter.solvers.compile import compile_scene, matrix_tables
    from skyscatter.solvers.single import single_parts

    wl = check_wavelengths(wavelengths)
    picture = _check(scene, size, view_zenith_deg, walks)
    medium = scene.medium
    target = np.array([0.0, 0.0, medium.radius])
    origin, direction = line_of_sight(medium.radius, medium.top, view_zenith_deg, view_azimuth_deg)
    table = compile_scene(scene.model_copy(update={"ground": Ground(albedo=0.0)}), wl)
    if table.optics.glows:
        raise DomainError("background", "emission", "simulated images hold sunlight only; leave out other light")
    land, albedo = _landscape(scene, picture, size, wl)
    table = table._replace(optics=table.optics._replace(albedo=albedo))
    plain = GroundTable(albedo[None], np.zeros((0, 0), np.uint8), 1.0)
    scattered, reflected, _ = single_parts(table, plain, _ray(origin, direction), 1e-5)
    polar = None
    if stokes:
        frame = meridian_frame(origin[None], direction[None])[0]
        polar = make_polar(matrix_tables(medium, tuple(float(w) for w in wl)), frame, 1)
    per_batch = -(-walks // BATCHES)
    batches = np.empty((BATCHES, wl.size, *size))
    scratch = make_simulate_scratch(len(medium.components), wl.size)
    for b in range(BATCHES):
        sums = _empty_sums(picture, size, wl.size)
        simulate_batch(
            table, plain, land, target, origin, direction, np.int64(seed), np.int64(b), np.int64(per_batch),
            np.int64(MOST_ORDERS), scratch, polar, sums,
        )  # fmt: skip
        batches[b] = _gather(sums, land, size) / per_batch
        if progress is not None:
            progress((b + 1) / BATCHES)
    shown = _shown(land, size)
    scale = np.pi / (scene.star.irradiance(wl, scene.star_distance) * scene.sun.direction[2])[:, None, None]
    first = scattered[0][:, None, None] + reflected[0][:, None, None] * shown
    error = batches.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    return SimulatedImage(
        scale * (first + batches.mean(axis=0)), scale * error, shown * albedo[:, None, None]
    )  # fmt: skip


def _check(scene: Scene, size: tuple[int, int], view_zenith_deg: float, walks: int) -> GroundMap:
    """The map, after all has been looked at."""
    picture = scene.ground.map
    if picture is None:
        raise DomainError("ground.map", None, "an image needs mapped ground; give the ground a GroundMap")
    height, width = picture.classes.array.shape
    if not (1 <= size[0] <= height and 1 <= size[1] <= width):
        raise DomainError("size", size, f"from (1, 1) to that of the map, {(height, width)}")
    if not 0 <= view_zenith_deg < 90:
        raise DomainError("view_zenith_deg", view_zenith_deg, "lies between 0 and 90 degrees, 90 excluded")
    if scene.sun.elevation_deg <= 0:
        raise DomainError("sun_elevation_deg", scene.sun.elevation_deg, "the Sun must stand above the horizon")
    if walks < 2 * BATCHES:
        raise DomainError("walks", walks, f"at least {2 * BATCHES}")
    return picture


def _landscape(scene: Scene, picture: GroundMap, size: tuple[int, int], wl: Array) -> tuple[Landscape, Array]:
    """The map relative to a uniform ground of its mean albedo, and that albedo (wavelength,)."""
    from skyscatter.kernels.raster.simulate import Landscape

    rows = picture.rows
    albedos = np.concatenate([scene.ground.reflectance(wl)[None], picture.reflectance(wl)])
    share = np.bincount(rows.ravel(), minlength=len(albedos)) / rows.size
    # Black cells in black surroundings would leave nothing to draw by where other cells are bright.
    albedo = np.maximum(share @ albedos, 0.2 * albedos.max(axis=0))
    ratio = albedos / np.where(albedo > 0, albedo, 1.0)
    first = np.array([(n - m) // 2 for n, m in zip(rows.shape, size, strict=True)], np.int64)
    return Landscape(rows, np.ascontiguousarray(ratio), first, float(picture.cell_size)), albedo


def _ray(origin: Array, direction: Array) -> Any:
    from skyscatter.solvers.base import Rays

    return Rays(origin[None], direction[None], np.zeros(1, np.int64))


def _empty_sums(picture: GroundMap, size: tuple[int, int], bands: int) -> Sums:
    from skyscatter.kernels.raster.simulate import Sums

    height, width = picture.classes.array.shape
    # From any pixel to any cell of the map.
    offset = np.zeros((2 * height + 1, 2 * width + 1, bands))
    return Sums(np.zeros(bands), offset, np.zeros(bands), np.zeros((*size, bands)), np.ones((*size, bands)))


def _shown(land: Landscape, size: tuple[int, int]) -> Array:
    """Ratio of every pixel's own cell, shape (wavelength, y, x)."""
    y, x = land.first
    return np.moveaxis(land.ratio[land.rows[y : y + size[0], x : x + size[1]]], -1, 0)


def _gather(sums: Sums, land: Landscape, size: tuple[int, int]) -> Array:
    """The picture (wavelength, y, x) of a batch from its sums."""
    from scipy.signal import fftconvolve

    height, width = land.rows.shape
    y, x = land.first
    out = np.moveaxis(sums.picture, -1, 0) + (sums.air + sums.outside * land.ratio[0])[:, None, None]
    for k in range(len(out)):
        # Around the map lies what is outside, as far as any offset reaches.
        ground = np.full((3 * height, 3 * width), land.ratio[0, k])
        ground[height : 2 * height, width : 2 * width] = land.ratio[land.rows, k]
        met = ground[y : y + 2 * height + size[0], x : x + 2 * width + size[1]]
        out[k] += fftconvolve(met, sums.offset[::-1, ::-1, k], "valid")
    return out
