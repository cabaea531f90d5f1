"""What shines on a sky that holds bodies and clouds: the Sun, or by night the Moon in its place, and all other lights.

What air, ground, bodies and clouds scatter of it is found by walks (`skyscatter.solvers.world`).  The Sun and the Moon
are parallel lamps, the brightest planets and stars too; all that is faint or spread over the sky is a map of radiance
that walks meet when they leave the air.  What comes straight from lights beyond the air is added afterwards, as to
skies of air alone, and here what bodies and clouds let through of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from skyscatter.celestial.heavens import Heavens
from skyscatter.celestial.moon import Moon, moon_irradiance
from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP
from skyscatter.kernels.surfaces.tables import LampTable
from skyscatter.scene import Scene, Star, Sun
from skyscatter.solvers import skylights
from skyscatter.solvers.base import Array, Asked, Rays
from skyscatter.solvers.eclipse import eclipse_table
from skyscatter.solvers.emptysky import empty
from skyscatter.solvers.options import Path
from skyscatter.solvers.overhead import Overhead
from skyscatter.solvers.response import lowest_light
from skyscatter.solvers.surface_path import Context, guided, solve
from skyscatter.solvers.surfaces import compile_surfaces
from skyscatter.solvers.townlamps import LEAST, lamps_and_towns, towns_shine
from skyscatter.solvers.townseen import LIFT, lamps_seen
from skyscatter.solvers.worldscene import as_surfaces, spectrum, star_shines
from skyscatter.surfaces.lamps import AnyLamp, AreaLamp, ParallelLamp, PointLamp
from skyscatter.surfaces.scene import SurfaceScene
from skyscatter.workers import in_parts

#: Nodes of the map of faint light over elevation and azimuth, and points along each side of the cell around a node of
#: which it has the mean.
ROWS, COLUMNS, FINER = 91, 180, 2
#: Rows and columns of the map over which a faint star is spread.
BAND, TURN = 5, 10
#: Light is taken to come at least so high above the horizon [rad].
HAIR = 1e-6
#: Lamps of towns count as one within rings of distances that grow by this factor, and within so many sectors.  Of 1.25
#: and 36, 1.1 and 144, 1.05 and 360 the first are 8 to 10 % too bright right above a town at 15 and 40 km, and the
#: others agree.
STEP, SECTORS = 1.1, 144
#: Rays that a thread follows at once.
TOGETHER = 4096


class Lit(NamedTuple):
    """What shines on a scene from outside.

    Attributes
    ----------
    scene : Scene
        With the brighter of Sun and Moon as its star; with a dark star where neither shines.
    star : str
        What its star is.
    lamps : list of lamp
        Other lights that come from one direction, and towns.
    around : ndarray, shape (row, column, wavelength)
        The rest, see `skyscatter.kernels.surfaces.tables.LampTable`; no rows where there is none.
    """

    scene: Scene
    star: str
    lamps: list[AnyLamp]
    around: Array


def lit(scene: Scene, wavelengths: Array) -> Lit:
    """What shines on a scene at wavelengths [nm]."""
    towns = town_lamps(scene, wavelengths) if towns_shine(scene) else []
    found = Lit(scene, "Sun", towns, np.zeros((0, 0, wavelengths.size)))
    heavens, shines = skylights.heavens_of(scene, wavelengths), skylights.sun_shines(scene)
    if not shines:
        found = found._replace(scene=_starless(scene))
    moon = None if heavens is None else heavens.moon
    if moon is not None and skylights.moon_scatters(scene, moon):
        if shines:
            light = moon_irradiance(moon, wavelengths)
            found.lamps.append(_lamp("Moon", moon.direction, light, wavelengths, moon.angular_radius))
        else:
            found = found._replace(scene=_under(moon, scene, wavelengths), star="Moon")
    if heavens is not None and skylights.night_shines(scene):
        points, around = _night(scene, heavens)
        found = found._replace(lamps=[*found.lamps, *points], around=around)
    return found


def _under(moon: Moon, scene: Scene, wavelengths: Array) -> Scene:
    """A scene with the Moon as its star."""
    star = Star(
        spectrum=spectrum(moon_irradiance(moon, wavelengths), wavelengths),
        radius=float(np.sin(moon.angular_radius)) * moon.distance,
        distance=moon.distance,
        limb_darkening=False,
    )
    return scene.model_copy(update={"star": star, "sun": skylights.sun_towards(moon.direction), "lights": None})


def _lamp(name: str, towards: Array, light: Array, wavelengths: Array, radius: float = 0.0) -> ParallelLamp:
    return ParallelLamp(
        name=name,
        direction=tuple(float(v) for v in towards),
        irradiance=spectrum(light, wavelengths),
        angular_radius_deg=float(np.degrees(radius)),
    )


def _night(scene: Scene, heavens: Heavens) -> tuple[list[AnyLamp], Array]:
    """Planets and stars that cast shadows, and a map of all others and of what is spread over the sky."""
    horizon = np.sin(Overhead(scene, heavens.wavelengths).horizon + HAIR)
    around = _spread(heavens, horizon)
    lamps: list[AnyLamp] = []
    if heavens.points_names:
        points = map(heavens.points, heavens.points_names)
        towards, light = (np.concatenate(arrays) for arrays in zip(*points, strict=True))
        bright = skylights.brightest(towards, light, lowest_light(scene.medium.radius, scene.altitude))
        lamps = [_lamp("point", towards[k], light[k], heavens.wavelengths) for k in np.flatnonzero(bright)]
        around += _blurred(towards[~bright], light[~bright])
    return lamps, around


def _spread(heavens: Heavens, horizon: float) -> Array:
    """The map of what is spread over the sky; below a horizon, by its sine, what is seen there."""
    inner = (np.arange(FINER) + 0.5) / FINER - 0.5
    elevation = np.pi * ((np.arange(ROWS)[:, None] + inner).ravel() / (ROWS - 1) - 0.5)
    azimuth = 2 * np.pi * (np.arange(COLUMNS)[:, None] + inner).ravel() / COLUMNS
    up = np.clip(np.sin(np.clip(elevation, -np.pi / 2, np.pi / 2)), horizon, 1.0)[:, None]
    flat = np.sqrt(1 - up**2)
    sky = np.stack(np.broadcast_arrays(flat * np.sin(azimuth), flat * np.cos(azimuth), up), axis=-1)
    light = np.zeros((*sky.shape[:2], heavens.wavelengths.size))
    for name in heavens.spread_names:
        light += heavens.radiance(name, sky)
    weight = np.cos(elevation).clip(1e-9).reshape(ROWS, FINER, 1, 1, 1)
    cells = (light.reshape(ROWS, FINER, COLUMNS, FINER, -1) * weight).sum(axis=1) / weight.sum(axis=1)
    return np.asarray(cells.mean(axis=2))


def _blurred(towards: Array, light: Array) -> Array:
    """The map of points of light (point, 3), (point, wavelength), each spread over its cell."""
    elevation = np.arcsin(np.clip(towards[:, 2], -1.0, 1.0))
    row = np.rint((elevation / np.pi + 0.5) * (ROWS - 1)).astype(np.int64)
    column = np.rint(np.arctan2(towards[:, 0], towards[:, 1]) / (2 * np.pi) * COLUMNS).astype(np.int64) % COLUMNS
    cells = np.zeros((-(-ROWS // BAND), COLUMNS // TURN, light.shape[1]))
    np.add.at(cells, (row // BAND, column // TURN), light)
    edges = np.pi * (np.clip(np.arange(ROWS + 1) - 0.5, 0, ROWS - 1) / (ROWS - 1) - 0.5)
    bands = np.add.reduceat(np.diff(np.sin(edges)), np.arange(0, ROWS, BAND)) * 2 * np.pi * TURN / COLUMNS
    spread = cells / bands[:, None, None]
    return np.asarray(spread.repeat(BAND, axis=0)[:ROWS].repeat(TURN, axis=1))


def town_lamps(scene: Scene, wavelengths: Array) -> list[AnyLamp]:
    """The lamps of towns, those together that the observer sees close to each other."""
    found: list[AnyLamp] = []
    radius, count = scene.medium.radius * (1 + LIFT), 0
    for lamps, town in lamps_and_towns(scene, wavelengths):
        ring = np.rint(np.log(lamps.distance / LEAST) / np.log(STEP))
        sector = np.rint(lamps.azimuth / (2 * np.pi) * SECTORS) % SECTORS
        _, cell = np.unique(ring * SECTORS + sector, return_inverse=True)
        weight = np.bincount(cell, lamps.weight)
        angle = lamps.distance / scene.medium.radius
        flat = np.sin(angle)
        places = np.stack([flat * np.sin(lamps.azimuth), flat * np.cos(lamps.azimuth), np.cos(angle)])
        middle = np.stack([np.bincount(cell, lamps.weight * x) for x in places], axis=1)
        middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        for up, share in zip(middle[weight > 0], weight[weight > 0], strict=True):
            found.append(
                PointLamp(
                    name=f"{town.name} {count + 1}",
                    position=tuple(float(v) for v in radius * up - [0.0, 0.0, scene.medium.radius]),
                    axis=tuple(float(v) for v in up),
                    lobe=town.lobe,
                    power=spectrum(share * lamps.spectrum, wavelengths),
                )
            )
            count += 1
    return found


# --- what comes straight ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Veiled(Overhead):
    """The air above an observer, and the clouds and bodies before it.

    Attributes
    ----------
    scene, wavelengths
        The air alone.
    held : Scene
        With all that it holds.
    """

    held: Scene

    @classmethod
    def over(cls, scene: Scene, wavelengths: Array) -> Veiled:
        """That of a scene."""
        return cls(empty(scene, wavelengths), wavelengths, scene)

    def transmittance(self, directions: Array) -> Array:
        """Share of the light from directions (ray, 3) that arrives, (ray, wavelength)."""
        return super().transmittance(directions) * self.veil(directions)

    def veil(self, directions: Array) -> Array:
        """What clouds and bodies let through of light from outside, or from the ground, (ray, wavelength)."""
        if not (self.held.bodies or self.held.fields):
            return np.ones((len(directions), 1))
        return straight(self._walks, self.held, directions)

    @cached_property
    def _walks(self) -> Context:
        """Tables of the scene in which sky and ground have a radiance of 1, and shells of air let it pass."""
        bodies = tuple(body.model_copy(update={"lamp": None}) for body in self.held.bodies)
        even = _dark(self.held).model_copy(update={"bodies": bodies, "lamps": (), "background": 1.0})
        surfaces = as_surfaces(even, self.wavelengths)
        ground = surfaces.bodies[0].model_copy(update={"lamp": AreaLamp(radiance=1.0)})
        table = tables(surfaces.model_copy(update={"bodies": (ground, *bodies)}), self.wavelengths).table
        shells = slice(len(self.held.medium.components))
        media = table.media._replace(
            sigma_s=table.media.sigma_s.copy(), sigma_t=table.media.sigma_t.copy(), rate=table.media.rate.copy()
        )
        media.sigma_s[shells], media.sigma_t[shells], media.rate[shells] = 0.0, 0.0, 0.0
        nowhere = np.zeros_like(table.guide.shines)
        guide = table.guide._replace(shines=nowhere, scatters=nowhere)
        return Context(table._replace(media=media, guide=guide))


def tables(surfaces: SurfaceScene, wavelengths: Array) -> Context:
    """Tables for walks, without a word of warning."""
    return Context(guided(compile_surfaces(surfaces, tuple(float(w) for w in wavelengths))))


def eclipsed(lamps: LampTable, scene: Scene, wavelengths: Array) -> LampTable:
    """Lamps of a scene, with the Moon before its star where it is in an eclipse."""
    moon = eclipse_table(scene, wavelengths)
    if not moon.share.size or not star_shines(scene, wavelengths):
        return lamps
    down = np.array([0.0, 0.0, -scene.medium.radius])
    return lamps._replace(eclipsed=star_lamp(lamps), moon=moon._replace(sun=moon.sun + down, moon=moon.moon + down))


def star_lamp(lamps: LampTable) -> int:
    """Number of the star among the lamps of a scene: the first parallel one, for bodies that shine come before it."""
    return int(np.flatnonzero(lamps.kind == PARALLEL_LAMP)[0])


def straight(walks: Context, scene: Scene, directions: Array) -> Array:
    """What comes straight to the observer of a scene, (ray, wavelength)."""
    origins = np.zeros_like(directions) + np.array([0.0, 0.0, scene.altitude])
    rays = Rays(origins, np.ascontiguousarray(directions), np.arange(len(directions)))
    light = np.empty((len(directions), walks.table.media.index.shape[1]))
    asked = Asked(Path(samples=2, max_order=1), parts=True)

    def work(some: slice) -> None:
        light[some] = solve(walks, rays.part(some), asked).layers["direct"]

    in_parts(work, len(directions), TOGETHER)
    return light


def sun_along(scene: Scene, wavelengths: Array, directions: Array) -> Array:
    """What comes straight from the Sun's disk to the observer, as the walks find it, (ray, wavelength)."""
    plain = scene.model_copy(update={"lights": None, "towns": None})
    lit, dark = (tables(as_surfaces(one, wavelengths), wavelengths) for one in (plain, _dark(scene)))
    lit = Context(lit.table._replace(lamps=eclipsed(lit.table.lamps, scene, wavelengths)))
    return straight(lit, scene, directions) - straight(dark, scene, directions)


def _dark(scene: Scene) -> Scene:
    """The scene without its star, all that shines in its sky, and towns."""
    return _starless(scene).model_copy(update={"sun": Sun(), "lights": None, "towns": None})


def _starless(scene: Scene) -> Scene:
    return scene.model_copy(update={"star": scene.star.model_copy(update={"spectrum": 0.0})})


def add_straight(picture: skylights.Picture, scene: Scene, wavelengths: Array, threads: int | None = None) -> None:
    """Add what comes straight from the lights beside the Sun and from lamps of towns to a picture, or to rays."""
    above, heavens = Veiled.over(scene, wavelengths), skylights.heavens_of(scene, wavelengths)
    if heavens is not None:
        if heavens.moon is not None and skylights.moon_scatters(scene, heavens.moon):
            _take_off(picture, heavens.moon, above)
        skylights.add_lights(picture, scene, heavens, None, threads, above)
    if picture.camera is not None and towns_shine(scene):
        towards, light = lamps_seen(above.scene, wavelengths)
        skylights.add_points(picture, scene, "towns", towards, light * above.veil(towards))


def _take_off(picture: skylights.Picture, moon: Moon, above: Veiled) -> None:
    """Take the even disk as which walks have seen the Moon off again."""
    light = moon_irradiance(moon, above.wavelengths) / (np.pi * np.sin(moon.angular_radius) ** 2)
    for pixels, rays in picture.blocks():
        met = rays @ moon.direction > np.cos(moon.angular_radius)
        picture.add("moon", pixels[met], -light * above.transmittance(rays[met]))
