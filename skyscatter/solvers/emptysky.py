"""The light of a sky without what stands or floats in it, by ``orders``, for the walks among that.

Walks begin with what they would see in the empty sky and find differences alone, see `kernels.surfaces.emptysky`.
Along the rays that are asked for the known light is that of ``orders``; where walks come to later it is looked up
between nodes, which are compared with ``orders`` at places of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skyscatter.errors import SkyscatterError
from skyscatter.geometry.meridian import meridian_turns
from skyscatter.ground import Ground
from skyscatter.kernels.optics import SceneTable
from skyscatter.kernels.surfaces.emptysky import EmptySky, empty_lights
from skyscatter.progress import say
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array, Asked, Rays
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.field import DEFAULT_TOLERANCE, scattering_top, solve_range
from skyscatter.solvers.options import Path
from skyscatter.solvers.orders import Context, darkest_sun, window_of
from skyscatter.solvers.path import walks_for
from skyscatter.solvers.skytable import angle_cells, frame_of, weighted
from skyscatter.solvers.sweeps import Solution, diffuse_light, view
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.grounds import RossLi, Rpv
from skyscatter.surfaces.materials import Lambert, Mosaic
from skyscatter.workers import Workers

__all__ = ["KnownSky", "empty", "known_sky"]

#: Nodes of height, of the way to the ground, of elevation above the horizon, and of azimuth from the star.
HEIGHTS, BELOW, ABOVE, TURNS = 20, 24, 28, 17
#: Way to the ground that counts as short, and height of the lowest node [m].
SHORT, LOWEST = 300.0, 1.0
#: Zenith angles of the star beside that of the observer for which light is known [degree]; the observer's alone where
#: the table would have more numbers.
SUNS, MOST = (-2.0, 0.0, 2.0), 50_000_000
#: Rays that are solved at once, those by which the table is compared, and the angle around the star of half of them.
TOGETHER, COMPARED, BESIDE_STAR = 4096, 2048, np.radians(25.0)
#: Walks in all from which on the empty sky is solved first: a second of walks, about, for two or three of its solution.
WORTH = 50_000
#: Elevation of the Sun [degree] below which walks find its light too rarely for their error bars.
TWILIGHT = 0.0
#: Rays of which `orders` tells the error, and the share of these whose error is not above that of all.
JUDGED, MOST_OF = 64, 0.9
#: Height up to which light is known with the Sun where it stands [m].
LOW_AIR = 2000.0
#: Least angle of nodes from the vertical [rad], above that below which `orders` takes a meridian of its own.
HAIR = 1e-4
#: Rays of a picture that tell where the field is needed.
LOOKED_AT = 2048


class KnownSky(NamedTuple):
    """The empty sky, solved."""

    context: Context  #: for the rays that were asked for
    table: EmptySky  #: in the frame of the ground below the observer
    share: Array  #: (wavelength,) relative error of `orders` along those rays
    error: Array  #: (wavelength,) of the table over the mean light

    def along(self, rays: Rays) -> tuple[Array, Array]:
        """Diffuse light along rays from the planet's centre, and its error, (ray, wavelength) each."""
        field, table, sky = self.context
        if not field.stokes:
            return field.diffuse(table, rays.origins, rays.directions, self.share, sky)
        light = _looked_up(self.table, rays.origins, rays.directions)
        return light, (self.share + self.error) * np.abs(light)


def empty(scene: Scene, wavelengths: Array) -> Scene:
    """The same sky without bodies, clouds and lamps, over ground that spreads light evenly."""
    material, ground = scene.ground.material, Ground(albedo=scene.ground.albedo)
    material = material.rest if isinstance(material, Mosaic) else material
    if isinstance(material, Lambert):
        ground = Ground(albedo=material.albedo)
    elif isinstance(material, (Rpv, RossLi)):
        # As bright under an even sky: the less is left for walks to find.
        rising = np.unique(wavelengths)
        ground = Ground(albedo=SpectralTable(wavelengths=rising, values=np.minimum(material.albedo(rising), 1.0)))
    elif material is not None:
        ground = Ground(albedo=0.0)
    return scene.model_copy(update={"fields": (), "bodies": (), "media": (), "lamps": (), "ground": ground})


def is_even(ground: Ground) -> bool:
    """Whether the ground spreads light evenly, as that of the empty sky does."""
    return ground.map is None and (ground.material is None or isinstance(ground.material, Lambert))


def is_knowable(scene: Scene, rays: int, asked: Asked[Path]) -> bool:
    """Whether the light of the empty sky is worth to be known for so many rays, and can be taken for part of theirs.

    In twilight walks alone hardly find it.
    """
    whole = not asked.parts and not asked.orders and asked.how.max_order is None
    many = asked.how.noise is not None or rays * walks_for(asked) >= WORTH or scene.sun.elevation_deg < TWILIGHT
    return bool(whole and many and asked.how.sampling is None)


def known_sky(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    lamp: int,
    threads: int,
    progress: Callable[[float], None] | None,
    stokes: bool = False,
) -> KnownSky | None:
    """The empty sky of a scene, or None where `orders` refuses it; rays are from the planet's centre.

    `lamp` is the number of the star among the lamps.  Of polarised light all that is known comes from the table.
    """
    bare = empty(scene, wavelengths)
    table = compile_scene(bare, wavelengths)
    if table.optics.glows:
        return None
    nodes = _Nodes.around(bare, table, stokes)
    step = max(len(rays.origins) // LOOKED_AT, 1)
    origins, directions = nodes.rays(bare)
    # Beyond what the rays and low air see of the Sun its last value goes on: little of that comes back to bodies.
    middle, low = nodes.zenith.size // 2, nodes.height < LOW_AIR
    seen = (
        bare, table,
        np.concatenate([rays.origins[::step], origins[middle, low].reshape(-1, 3)]),
        np.concatenate([rays.directions[::step], directions[middle, low].reshape(-1, 3)]),
    )  # fmt: skip
    if progress is not None:
        say("light of the empty sky")
    window, darkest = window_of(*seen), darkest_sun(*seen)
    try:
        field = solve_range(bare, wavelengths, window, DEFAULT_TOLERANCE, stokes, None, threads, None, None, darkest)
    except SkyscatterError:  # a medium that orders cannot do
        return None
    context = Context(field, table, field.sky_table(table, rays.origins, rays.directions, threads))
    ground = int(is_even(scene.ground))
    known = _tabulated(field.fine, table, nodes, origins, directions, lamp, ground, threads)
    some = slice(None, None, max(len(rays.origins) // JUDGED, 1))
    judged = field.look(table, rays.origins[some], rays.directions[some], False)
    share = np.quantile(judged.standard_error / np.maximum(np.abs(judged.radiance), 1e-300), MOST_OF, axis=0)
    mean, missed = _missed(known, field.fine, table)
    return KnownSky(context, known._replace(typical=float(mean[mean.size // 2])), share, missed / mean)


class _Nodes(NamedTuple):
    """Where light is tabulated, see `kernels.surfaces.emptysky.EmptySky`."""

    zenith: Array  #: (sun,) [rad]
    height: Array  #: [m]

    @classmethod
    def around(cls, scene: Scene, table: SceneTable, stokes: bool) -> _Nodes:
        """Those of a scene."""
        beside = np.array(SUNS)
        components, wavelengths = table.optics.sigma_s.shape
        rows = components + (4 if stokes else 1)
        if beside.size * HEIGHTS * (BELOW + ABOVE) * TURNS * rows * wavelengths > MOST:
            beside = np.zeros(1)
        zenith = np.radians(np.unique(np.clip(90.0 - scene.sun.elevation_deg + beside, 0.5, 179.5)))
        return cls(zenith, np.maximum(scattering_top(table) * np.linspace(0, 1, HEIGHTS) ** 2, LOWEST))

    def rays(self, scene: Scene) -> tuple[Array, Array]:
        """Origins and directions (sun, height, elevation, turn, 3), from the planet's centre."""
        radius, star = scene.medium.radius, scene.sun.direction
        frame = frame_of(np.array([0.0, 0.0, radius]), star)
        turn, longest = np.pi * np.linspace(0, 1, TURNS) ** 2, horizon_way(radius, self.height[-1])
        shape = (self.zenith.size, self.height.size, BELOW + ABOVE, TURNS, 3)
        origins, directions = np.empty(shape), np.empty(shape)
        across = frame.up - (frame.up @ star) * star
        across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-9 else frame.towards
        for i, angle in enumerate(self.zenith):
            up = np.cos(angle) * star + np.sin(angle) * across
            local = frame_of(up, star)
            for j, height in enumerate(self.height):
                origins[i, j] = (radius + height) * up
                directions[i, j] = local.rays(elevations(radius, height, longest), turn)
        return origins, directions


def horizon_way(radius: float, height: float) -> float:
    """Distance to the horizon [m]."""
    return float(np.sqrt(height * (2 * radius + height)))


def elevations(radius: float, height: float, longest: float) -> Array:
    """Nodes of elevation [rad] at a height, as `way_place` and `elevation_place` in `kernels.surfaces.emptysky`."""
    hair = 1e-7  # so that it is clear on which side of the horizon a node lies
    way = SHORT * np.expm1(np.linspace(0, 1, BELOW) * np.log1p(longest / SHORT))
    way = np.clip(way, height, horizon_way(radius, height))
    dip = np.arccos(radius / (radius + height))
    down = -np.arcsin(np.minimum((way**2 + height * (2 * radius + height)) / (2 * way * (radius + height)), 1.0))
    up = -dip + hair + (np.pi / 2 + dip - hair) * np.linspace(0, 1, ABOVE) ** 2
    # A hair from the vertical, so that each azimuth has its own meridian.
    return np.clip(np.concatenate([np.minimum(down, -dip - hair), up]), HAIR - np.pi / 2, np.pi / 2 - HAIR)


def _tabulated(
    fine: Solution, table: SceneTable, nodes: _Nodes, origins: Array, directions: Array, lamp: int, ground: int,
    threads: int,
) -> EmptySky:  # fmt: skip
    """The light at the nodes."""
    kept = np.flatnonzero(fine.problem.diffuse.scatters)
    whole = np.ascontiguousarray(fine.problem.whole[0, kept])
    stokes = fine.problem.stokes
    polarised = np.ascontiguousarray(fine.problem.whole[1, kept]) if stokes > 1 else np.zeros((0, 0, 0))
    components, wavelengths = table.optics.sigma_s.shape
    star = np.asarray(table.optics.disk_axis, float)
    flat_o, flat_d = origins.reshape(-1, 3), directions.reshape(-1, 3)
    light = np.zeros((len(flat_o), kept.size + (1 if stokes == 1 else 4), wavelengths), np.float32)

    def work(start: int) -> None:
        some = slice(start, min(start + TOGETHER, len(flat_o)))
        lit = np.empty((some.stop - start, components, wavelengths), np.float32)
        o, d = np.ascontiguousarray(flat_o[some]), np.ascontiguousarray(flat_d[some])
        found = diffuse_light(*view(fine.problem, fine.loaded, table, o, d, lit))
        rest = found[:, 0]
        cell, share = angle_cells(d @ star, whole.shape[1] - 1)
        for k, c in enumerate(kept):
            rest -= weighted(whole[k], cell, share) * lit[:, c]
            light[some, k] = lit[:, c]
        light[some, kept.size] = rest
        if stokes > 1:
            once = sum(weighted(polarised[k], cell, share) * lit[:, c] for k, c in enumerate(kept))
            light[some, kept.size + 1 : kept.size + stokes] = found[:, 1:]
            light[some, kept.size + 1 : kept.size + 3] -= (
                meridian_turns(o, d, star)[:, :, None] * np.asarray(once)[:, None]
            )

    _ = fine.loaded
    with Workers(threads) as pool:
        for done in [pool.submit(work, start) for start in range(0, len(flat_o), TOGETHER)]:
            done.result()
    return EmptySky(
        shells=components,
        lamp=lamp,
        ground=ground,
        radius=float(table.columns.radius),
        centre=np.array([0.0, 0.0, -float(table.columns.radius)]),
        star=star,
        zenith=nodes.zenith,
        lowest=LOWEST,
        top=float(nodes.height[-1]),
        typical=0.0,
        below=BELOW,
        short=SHORT,
        longest=horizon_way(float(table.columns.radius), float(nodes.height[-1])),
        whole=whole,
        polarised=polarised,
        light=light.reshape(*origins.shape[:4], *light.shape[1:]),
    )


def _missed(known: EmptySky, fine: Solution, table: SceneTable) -> tuple[Array, Array]:
    """Mean light of low air in all directions, and what the table misses of it, (wavelength,).

    Around the star it is bright, and most is missed: half of the rays look there and count by their solid angle.
    """
    rng = np.random.default_rng(1)
    half, lobe = COMPARED // 2, 1 - np.cos(BESIDE_STAR)
    cosine = 1 - np.concatenate([lobe * rng.random(half), lobe + (2 - lobe) * rng.random(half)])
    weight = np.repeat([lobe / 2, 1 - lobe / 2], half) / half
    turn, sine = 2 * np.pi * rng.random(COMPARED), np.sqrt(1 - cosine**2)
    up = np.array([0.0, 0.0, 1.0])
    around = np.stack([cosine, sine * np.cos(turn), sine * np.sin(turn)], axis=1)
    d = np.ascontiguousarray(around @ np.array(frame_of(known.star, up)))
    o = (known.radius + LOWEST + LOW_AIR * rng.random(COMPARED)[:, None] ** 2) * up
    exact = diffuse_light(*view(fine.problem, fine.loaded, table, o, d))[:, 0]
    return weight @ exact, weight @ np.abs(_looked_up(known, o, d) - exact)


def _looked_up(known: EmptySky, origins: Array, directions: Array) -> Array:
    """Light along rays from the planet's centre by the table, (ray, wavelength)."""
    rows, wavelengths = known.light.shape[4:]
    light = np.empty((len(origins), wavelengths))
    empty_lights(known, origins + known.centre, directions, np.empty((rows, wavelengths)), light)
    return light
