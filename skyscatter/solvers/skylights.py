"""The lights of the sky beside the Sun in pictures: Moon, planets, stars, Milky Way, zodiacal light and airglow.

What comes straight from them is dimmed by the air along the line of sight.  What the air and the ground scatter of them
is taken from one solved field: of the Moon exactly as of the Sun, of all others by the response of the air to distant
light (`skyscatter.solvers.response`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.celestial.heavens import SPREAD, Heavens
from skyscatter.celestial.moon import Moon, moon_irradiance
from skyscatter.errors import DomainError
from skyscatter.progress import say
from skyscatter.scene import Scene, Sun
from skyscatter.solvers.base import Array
from skyscatter.solvers.checks import worker_count
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.field import RadianceField, solve_range
from skyscatter.solvers.orders import window_of
from skyscatter.solvers.overhead import Overhead
from skyscatter.solvers.response import Response, lowest_light
from skyscatter.solvers.state import RenderState

#: Accuracy that is aimed at in the field of the faint lights, whose own brightness is known to some 10 %.
TOLERANCE = 0.008
#: Rays whose light is added at once.
BLOCK = 1 << 16
#: The Sun is left out below this elevation, for an observer on the ground [degree]: its light is less than a thousandth
#: of the night's own.
SUN_LOWEST = -20.0
#: Moonlight that the air scatters counts while the Sun stands below this [degree]: above, it is less than 1e-4 of it.
MOON_SCATTERS = -2.0
#: Share of the light of all points from which on one of them is solved by itself, and the most of those.  The others
#: share Fourier orders over the azimuth, which blur the brightness around each by 5 degrees.
BRIGHT, MOST_BRIGHT = 0.05, 4
#: Where all that is seen already is so many times as bright as a point's light, sent evenly into all directions, what
#: surrounds the point is drowned in it.
DROWNED = 1e4
#: Rays begin at the observer if they do so to this share of its distance from the planet's centre.
SAME_PLACE = 1e-9
#: Points on the radius of the Moon's disk, at least and for each pixel.
FACE_POINTS, FACE_FINER = 48, 4


def all_added(scene: Scene) -> bool:
    """Whether all light of a scene is added to rays that a solver leaves dark: that of a night in air alone."""
    return scene.lights is not None and not scene.world and not sun_shines(scene)


def sun_shines(scene: Scene) -> bool:
    """Whether the Sun is among the lights of a scene, and high enough to matter."""
    if scene.lights is None:
        return True
    dip = np.degrees(np.arccos(scene.medium.radius / (scene.medium.radius + scene.altitude)))
    return "sun" in scene.lights.shine and scene.sun.elevation_deg > SUN_LOWEST - 2 * dip


def heavens_of(scene: Scene, wavelengths: Array) -> Heavens | None:
    """What shines on a scene; None where that is its Sun alone."""
    sight = scene.sight
    if scene.lights is None or sight is None or not set(scene.lights.shine) - {"sun", "towns"}:
        return None
    return Heavens(scene.lights, sight, wavelengths)


@dataclass(frozen=True)
class LitAir:
    """A solved air around an observer, for the lights of one night or of many.

    Attributes
    ----------
    field : RadianceField
        It covers all lights.
    altitude : float
        Of the observer [m].
    """

    field: RadianceField
    altitude: float

    @cached_property
    def response(self) -> Response:
        """What the air makes of light from everywhere."""
        return Response(self.field, self.altitude)


@dataclass
class Picture:
    """Arrays of a picture, or of rays, to which lights are added.

    Attributes
    ----------
    radiance, error : ndarray, shape (..., wavelength)
    layers : dict
    directions : ndarray, shape (..., 3)
        Through the middles of the pixels; NaN outside of the field.
    camera : Camera or None
        None for rays, which have no width: they meet the Moon's face, but no points of light.
    parts : bool
        Keep each light as a layer.
    """

    radiance: Array
    error: Array | None
    layers: dict[str, NDArray[Any]]
    directions: Array
    camera: Any
    parts: bool = False

    def add(self, name: str, where: Any, light: Array, error: Array | None = None) -> None:
        """Add a light in some pixels, by their numbers in reading order."""
        if len(where) and where[-1] - where[0] == len(where) - 1:
            where = slice(int(where[0]), int(where[-1]) + 1)  # whole rows; in half the time
        self.radiance.reshape(-1, self.radiance.shape[-1])[where] += light
        if error is not None and self.error is not None:
            self.error.reshape(-1, self.error.shape[-1])[where] += error
        if self.parts:
            layer = self.layers.setdefault(name, np.where(np.isnan(self.radiance), np.nan, 0.0))
            layer.reshape(-1, layer.shape[-1])[where] += light

    def blocks(self) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Numbers and directions of pixels in the field, some at a time."""
        flat = self.directions.reshape(-1, 3)
        inside = np.flatnonzero(np.isfinite(flat[:, 0]))
        for k in range(0, inside.size, BLOCK):
            yield inside[k : k + BLOCK], np.ascontiguousarray(flat[inside[k : k + BLOCK]])


def solve_air(
    scene: Scene,
    heavens: Heavens,
    directions: Array,
    *,
    stokes: bool = False,
    tolerance: float | None = None,
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
) -> LitAir | None:
    """Solve the air for the lights beside the Sun, along rays from the observer; None where none is scattered."""
    window = light_window(scene, heavens, directions)
    if window is None:
        return None
    if progress is not None:
        say("light of the night")
    return LitAir(
        solve_range(scene, heavens.wavelengths, window, tolerance or TOLERANCE, stokes, None, threads, progress),
        scene.altitude,
    )


def light_window(scene: Scene, heavens: Heavens, directions: Array) -> tuple[float, float] | None:
    """Zenith angles [rad] of the lights beside the Sun whose scattered light counts; None where there are none."""
    lowest = lowest_light(scene.medium.radius, scene.altitude)
    if night_shines(scene) and (heavens.spread_names or heavens.points_names):
        return 0.0, float(np.radians(90.0 - lowest))
    if heavens.moon is None or not moon_scatters(scene, heavens.moon):
        return None
    moon = scene.model_copy(update={"sun": sun_towards(heavens.moon.direction)})
    origins = np.ascontiguousarray(np.broadcast_to(scene.observer.position, directions.shape))
    return window_of(moon, compile_scene(moon, heavens.wavelengths), origins, directions)


def night_shines(scene: Scene) -> bool:
    """Whether what the air scatters of the night's own light counts."""
    from skyscatter.celestial.lights import NIGHT_BELOW

    return not sun_shines(scene) or scene.sun.elevation_deg <= NIGHT_BELOW


def moon_scatters(scene: Scene, moon: Moon) -> bool:
    """Whether moonlight in the air counts."""
    if sun_shines(scene) and scene.sun.elevation_deg > MOON_SCATTERS:
        return False
    return _elevation(moon.direction) > lowest_light(scene.medium.radius, scene.altitude)


def add_to(
    picture: Picture,
    scene: Scene,
    wavelengths: Array,
    stokes: bool = False,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Solve for the lights beside the Sun and add them to a picture's radiance, error and layers, in place."""
    heavens = heavens_of(scene, wavelengths)
    if heavens is None:
        return
    flat = picture.directions[np.isfinite(picture.directions[..., 0])]
    air = solve_air(
        scene,
        heavens,
        np.ascontiguousarray(flat),
        stokes=stokes,
        threads=worker_count(threads),
        progress=progress,
    )
    add_lights(picture, scene, heavens, air, threads)


def check_place(scene: Scene, origins: Array) -> None:
    """Refuse rays that do not begin at the observer of a scene."""
    here = scene.observer.position
    away = np.linalg.norm(origins - here, axis=-1)
    if np.any(away > SAME_PLACE * here[2]):
        rule = "lights of the sky are those that the scene's observer sees; begin at scene.observer.position"
        raise DomainError("origins", f"{away.max():.6g} m away", rule)


def dark(state: RenderState, stokes: bool, parts: bool, orders: int) -> RenderState:
    """The state as it is where the Sun is left out: all done, with layers of zeros."""
    names = ["Q", "U", "V", "Q_error", "U_error", "V_error"] if stokes else []
    names += ["direct", "scattered", "ground", "multiple"] if parts else []
    names += [f"order{k + 1}" for k in range(orders)]
    state.layers = {name: np.zeros_like(state.radiance) for name in names}
    state.done[:] = True
    return state


def add_lights(
    picture: Picture,
    scene: Scene,
    heavens: Heavens,
    air: LitAir | None,
    threads: int | None = None,
    above: Overhead | None = None,
) -> None:
    """Add all lights but the Sun to a picture.

    Parameters
    ----------
    picture : Picture
    scene : Scene
    heavens : Heavens
    air : LitAir or None
        Of `solve_air`; without it what comes straight alone.
    threads : int, optional
    above : Overhead, optional
        What dims the lights, where that is not the air alone.
    """
    above = above or Overhead(scene, heavens.wavelengths)
    if heavens.moon is not None:
        _add_moon_face(picture, scene, heavens.moon, above)
        if air is not None and moon_scatters(scene, heavens.moon):
            light = moon_irradiance(heavens.moon, heavens.wavelengths)
            _add_as_sun(picture, scene, "moon", heavens.moon.direction, light, air, threads)
    others = [*heavens.points_names, *heavens.spread_names]
    for names in [[name] for name in others] if picture.parts else [others]:
        _add_night(picture, scene, heavens, names, above, air if night_shines(scene) else None, threads)


def _add_as_sun(
    picture: Picture, scene: Scene, label: str, towards: Array, irradiance: Array, air: LitAir, threads: int | None
) -> None:
    """What air and ground scatter of one light, from the field of the Sun in its place: exact for the Moon, whose disk
    is as wide, and for points but for a blur of half a degree.
    """
    place = sun_towards(towards)
    # The field's own Sun, at its distance: by its irradiance the field's light is scaled.
    table = air.field.at(air.field.sun(place.elevation_deg, place.azimuth_deg))
    whole = table.optics.sun_irradiance.sum(axis=0)
    # The disk itself is none of it.
    table = table._replace(optics=table.optics._replace(disk_radiance=np.zeros_like(table.optics.disk_radiance)))
    share = np.divide(irradiance, whole, out=np.zeros_like(whole), where=whole > 0)
    here = scene.observer.position
    flat = picture.directions.reshape(-1, 3)
    flat = np.ascontiguousarray(flat[np.isfinite(flat[:, 0])])
    sky = air.field.sky_table(table, np.broadcast_to(here, flat.shape), flat, worker_count(threads))
    for pixels, directions in picture.blocks():
        origins = np.ascontiguousarray(np.broadcast_to(here, directions.shape))
        found = air.field.along(origins, directions, table, False, threads, sky)
        picture.add(label, pixels, found.radiance * share, found.standard_error * share)
        for name in "QUV":
            if name in picture.layers and name in found.layers:
                layer = picture.layers[name]
                layer.reshape(-1, layer.shape[-1])[pixels] += found.layers[name] * share


def _add_moon_face(picture: Picture, scene: Scene, moon: Moon, above: Overhead) -> None:
    """The Moon's disk, averaged over pixels: points of it that fall into each, each with its solid angle.

    So the light of the disk is kept whatever the size of the pixels.
    """
    from skyscatter.celestial.moon import moon_radiance

    camera, observer = picture.camera, scene.observer
    if _elevation(moon.direction) < np.degrees(above.horizon - 2 * moon.angular_radius):
        return
    if camera is None:
        for rays, directions in picture.blocks():
            light = moon_radiance(moon, directions, above.wavelengths) * above.transmittance(directions)
            picture.add("moon", rays, light)
        return
    solid_angle = camera.pixel_solid_angle(observer).ravel()
    smallest = float(np.sqrt(solid_angle[solid_angle > 0].min(initial=1.0)))
    count = max(FACE_POINTS, int(FACE_FINER * moon.angular_radius / smallest) + 1)
    points, area = disk_grid(moon.direction, moon.angular_radius, count)
    for k in range(0, len(points), BLOCK):
        some = points[k : k + BLOCK]
        light = moon_radiance(moon, some, above.wavelengths) * above.transmittance(some) * area
        picture.add("moon", *onto_pixels(camera, observer, some, light))


def onto_pixels(camera: Any, observer: Any, points: Array, light: Array) -> tuple[NDArray[np.intp], Array]:
    """Points of light as radiance of the pixels that they fall into.

    Parameters
    ----------
    camera : Camera
    observer : Observer
    points : ndarray, shape (point, 3)
        Directions.
    light : ndarray, shape (point, wavelength)
        Irradiances [W m-2 nm-1].

    Returns
    -------
    (pixel,) int, (pixel, wavelength)
        Numbers of the pixels in reading order, rising, and radiances [W m-2 sr-1 nm-1].
    """
    x, y = camera.pixel(points, observer)
    seen = np.isfinite(x) & np.isfinite(y)
    column = np.minimum(np.floor(x[seen] + 0.5).astype(np.intp), camera.width - 1)
    row = np.minimum(np.floor(y[seen] + 0.5).astype(np.intp), camera.height - 1)
    pixels, member = np.unique(row * camera.width + column, return_inverse=True)
    total = np.zeros((pixels.size, light.shape[1]))
    np.add.at(total, member, light[seen])
    solid_angle = camera.pixel_solid_angle(observer).ravel()[pixels]
    kept = solid_angle > 0
    return pixels[kept], total[kept] / solid_angle[kept, None]


def disk_grid(axis: Array, radius: float, count: int) -> tuple[Array, float]:
    """Points of a small disk on a square grid, `count` on its radius, and the solid angle of each.

    Returns
    -------
    points : ndarray, shape (point, 3)
        Unit vectors.
    area : float
        Such that all together have the solid angle of the disk [sr].
    """
    side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    side /= np.linalg.norm(side)
    up = np.cross(axis, side)
    step = (np.arange(2 * count) + 0.5) / count - 1.0
    a, b = (values.ravel() for values in np.meshgrid(step, step))
    within = a * a + b * b < 1.0
    offset = np.sin(radius) * (a[within, None] * side + b[within, None] * up)
    points = axis * np.sqrt(1.0 - np.sum(offset**2, axis=1, keepdims=True)) + offset
    return points, float(2 * np.pi * (1.0 - np.cos(radius)) / len(points))


def _add_night(
    picture: Picture, scene: Scene, heavens: Heavens, names: list[str], above: Overhead, air: LitAir | None,
    threads: int | None,
) -> None:  # fmt: skip
    """Lights that are points or spread over the sky: straight, and what air and ground scatter of them."""
    spread = [name for name in names if name in SPREAD]
    points = [heavens.points(name) for name in names if name not in SPREAD]
    label = names[0] if names else ""

    def sky(directions: Array) -> Array:
        return np.asarray(sum(heavens.radiance(name, directions) for name in spread))

    glow = None
    if points:
        directions, irradiance = (np.concatenate(arrays) for arrays in zip(*points, strict=True))
        _draw(picture, scene, label, directions, irradiance, above)
        if air is not None:
            seen = picture.radiance.sum(axis=-1)
            seen = seen[np.isfinite(seen)]
            # A layer of its own is for itself.
            least = 4 * np.pi * float(np.median(seen)) / DROWNED if seen.size and not picture.parts else 0.0
            bright = brightest(directions, irradiance, air.response.lowest, least)
            for k in np.flatnonzero(bright):
                _add_as_sun(picture, scene, label, directions[k], irradiance[k], air, threads)
            glow = air.response.glow(sky if spread else None, (directions[~bright], irradiance[~bright]))
    elif spread and air is not None:
        glow = air.response.glow(sky)
    for pixels, rays in picture.blocks() if spread or glow is not None else ():
        light = np.zeros((len(rays), heavens.wavelengths.size)) if glow is None else glow.at(rays)
        error = None if glow is None or air is None else light * air.response.error
        open_sky = np.flatnonzero(rays[:, 2] > np.sin(above.horizon))
        if spread and open_sky.size:
            light[open_sky] += sky(rays[open_sky]) * above.transmittance(rays[open_sky])
        picture.add(label, pixels, light, error)


def brightest(directions: Array, irradiance: Array, lowest: float, least: float = 0.0) -> NDArray[np.bool_]:
    """Points that light the air so much that what surrounds them is seen: each is solved by itself.

    They stand above an elevation [degree] and have more irradiance than `least`, summed over the wavelengths.
    """
    total = irradiance.sum(axis=1)
    total[directions[:, 2] < np.sin(np.radians(lowest))] = 0.0
    order = np.argsort(-total)[:MOST_BRIGHT]
    bright = np.zeros(len(total), bool)
    bright[order] = total[order] > max(BRIGHT * total.sum(), least)
    return bright


def _draw(picture: Picture, scene: Scene, label: str, directions: Array, irradiance: Array, above: Overhead) -> None:
    """Draw points of light that stand above the horizon, dimmed by the air, all of their light kept."""
    if picture.camera is None:
        return
    seen = directions[:, 2] > np.sin(above.horizon)
    add_points(picture, scene, label, directions[seen], irradiance[seen] * above.transmittance(directions[seen]))


def add_points(picture: Picture, scene: Scene, label: str, directions: Array, irradiance: Array) -> None:
    """Draw points of light (point, 3) by what arrives of each (point, wavelength); nothing where rays have no width."""
    from skyscatter.celestial.points import draw_points

    if picture.camera is None or not len(directions):
        return
    drawn = draw_points(picture.camera, scene.observer, directions, irradiance).reshape(-1, irradiance.shape[1])
    lit = np.flatnonzero(drawn.any(axis=1))
    picture.add(label, lit, drawn[lit])


def sun_towards(direction: Array) -> Sun:
    """A Sun in the place of another light."""
    azimuth = float(np.degrees(np.arctan2(direction[0], direction[1])) % 360.0)
    return Sun(elevation_deg=_elevation(direction), azimuth_deg=azimuth)


def _elevation(direction: Array) -> float:
    return float(np.degrees(np.arcsin(np.clip(direction[2], -1.0, 1.0))))
