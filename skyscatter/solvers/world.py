"""Solver ``path`` for skies that hold more than shells of air: bodies, clouds, lamps, and grounds of any material.

Walks go as among surfaces, see `skyscatter.solvers.worldscene`, lit by what `skyscatter.solvers.worldlights` says.
Where there is nothing but shells over Lambertian ground the walks of `skyscatter.solvers.path` serve, which are made
for that and much faster.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from skyscatter.columns import transmittance
from skyscatter.errors import DomainError
from skyscatter.kernels.surfaces.gathering import WalkTable
from skyscatter.scene import Scene
from skyscatter.solvers import surface_path
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Walks
from skyscatter.solvers.eclipse import eclipse_of
from skyscatter.solvers.emptysky import TWILIGHT, KnownSky, is_knowable, known_sky
from skyscatter.solvers.options import Path
from skyscatter.solvers.worldlights import eclipsed, lit, star_lamp
from skyscatter.solvers.worldscene import as_surfaces, check_scene, star_shines
from skyscatter.surfaces.grounds import Sea
from skyscatter.surfaces.materials import Mosaic

__all__ = ["check", "no_walks", "prepare", "solve"]

#: Throughput below which roulette begins: of what a dark ground reflects much of a sky's light is made.  Of 0.3, 0.1,
#: 0.03, 0.01 these had the least noise at equal time over clear and hazy skies together.
ROULETTE_LEVEL = 0.1
#: Mean cosine of the air, and transmittance from the ground to the Sun, beyond which stated errors are too small: on
#: Mars (0.78) with the Sun at 4 degrees 86 % of runs of 1024 walks lie within two of them, at 12 degrees 87 % of those
#: of 256, on Titan (0.68) 82 %, but on the hazy Earth (0.55) 95 %, and on Mars with the Sun at 25 degrees 92 %.
FORWARD, DIM_SUN = 0.6, 0.12
#: Share of the Sun that is free, below which it is as dark as in totality.
TOTALITY = 1e-3


def check(asked: Asked[Path]) -> None:
    """Refuse what contradicts itself, or means nothing here."""
    given = asked.how.given
    for name in ("sampling", "tolerance", "transmittance"):
        if given.get(name) not in (None, "march" if name == "sampling" else None):
            rule = "means nothing to walks in skies that hold bodies, fields, lamps or another ground; leave it out"
            raise DomainError(name, given[name], rule)
    surface_path.check(among_surfaces(asked))


def among_surfaces(asked: Asked[Path]) -> Asked[Path]:
    """What is asked of walks among surfaces, to whom ``sampling="march"`` means nothing."""
    return replace(asked, how=replace(asked.how, sampling=None))


class World(NamedTuple):
    """Tables of a scene, how far its frame lies above that of its rays [m], and what is known of its empty sky."""

    walks: surface_path.Context
    lift: float
    known: KnownSky | None = None


def local(rays: Rays, lift: float) -> Rays:
    """Rays from the planet's centre in the frame of the ground below the observer."""
    return Rays(rays.origins - np.array([0.0, 0.0, lift]), rays.directions, rays.numbers)


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> World:
    """The tables of a scene, with the light of its empty sky where that is worth its while."""
    check_scene(scene)
    shining, lift = lit(scene, wavelengths), scene.medium.radius
    scene = shining.scene
    surfaces = as_surfaces(scene, wavelengths, shining.lamps)
    walks = surface_path.prepare(surfaces, local(rays, lift), wavelengths, among_surfaces(asked), threads, progress)
    ground, guide = scene.ground.material, walks.table.guide
    sea = lift if any(map(glitters, (ground, *(body.material for body in scene.bodies)))) else 0.0
    guide = guide._replace(level=ROULETTE_LEVEL, sea=sea)
    guide = guide._replace(open=guide.open or bool(shining.around.any()))
    star = star_shines(scene, wavelengths)
    lamps = eclipsed(walks.table.lamps._replace(around=shining.around), scene, wavelengths)
    table = walks.table._replace(guide=guide, lamps=lamps)
    if star and lamps.eclipsed < 0 and is_knowable(scene, len(rays.origins), asked):
        known = known_sky(scene, rays, wavelengths, star_lamp(lamps), threads, progress, asked.stokes)
        if known is not None:
            return World(walks._replace(table=table._replace(sky=known.table)), lift, known)
    if star:
        warn_of_low_light(scene, shining.star, wavelengths, table)
    return World(walks._replace(table=table), lift)


def glitters(material: object) -> bool:
    """Whether a material is a sea, or a mosaic in which one lies: from above it shows an image of the star."""
    if isinstance(material, Mosaic):
        lying = (material.materials[k] for k in np.flatnonzero(np.bincount(material.cells.ravel())))
        return any(map(glitters, (*lying, material.rest)))
    return isinstance(material, Sea)


def warn_of_low_light(scene: Scene, star: str, wavelengths: Array, table: WalkTable) -> None:
    """A word where walks that know nothing of the sky find too little of a star's light for their error bars."""
    elevation = scene.sun.elevation_deg
    where = f"sun_elevation_deg = {elevation:g}" if star == "Sun" else f"the {star} at {elevation:.1f} degrees"
    eclipse = eclipse_of(scene)
    if eclipse is not None and float(eclipse.light(wavelengths).max()) < TOTALITY:
        warnings.warn(
            "in totality walks among bodies and fields rarely find the light, which comes from far away, and their "
            "standard error is too small; raise samples, or take the sky without them by orders",
            stacklevel=2,
        )
    elif elevation < TWILIGHT:
        warnings.warn(
            f"{where}: in twilight walks among bodies and fields rarely find the light, and their standard error is "
            f"too small; raise the {star}, or take the sky without them by orders",
            stacklevel=2,
        )
    elif surface_path.forwardness(table.media) > FORWARD and sun_is_dim(scene, wavelengths):
        warnings.warn(
            f"{where}: through air that scatters forward walks rarely find the bright sky around so low a {star}, and "
            "the standard error of few of them is too small; raise samples",
            stacklevel=2,
        )


def sun_is_dim(scene: Scene, wavelengths: Array) -> bool:
    """Whether next to nothing comes straight from the star to the ground below the observer, but for clouds."""
    air = scene.model_copy(update={"fields": (), "bodies": (), "media": (), "lamps": ()})
    start = np.array([0.0, 0.0, scene.medium.radius])
    end = start + 4 * (scene.medium.radius + scene.medium.top) * scene.sun.direction
    return bool(np.any(transmittance(air, start, end, wavelengths) < DIM_SUN))


def no_walks(world: World, rays: int, asked: Asked[Path]) -> Walks:
    """The sums with which walks begin."""
    return surface_path.no_walks(world.walks, rays, among_surfaces(asked))


def solve(world: World, rays: Rays, asked: Asked[Path], walks: Walks | None = None) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`."""
    known, here, asked = world.known, local(rays, world.lift), among_surfaces(asked)
    if known is None:
        return surface_path.solve(world.walks, here, asked, walks, up=rays.origins)
    seen, unsure = known.along(rays)
    if asked.stokes:
        found = surface_path.solve(world.walks, here, asked, walks, up=rays.origins)
    else:
        found = surface_path.solve(world.walks, here, asked, walks, seen)
    # What a ray sees of bodies is light that was looked up between nodes.
    unsure += known.error * np.minimum(np.abs(found.radiance), np.abs(found.radiance - seen))
    layers = {name: np.hypot(value, unsure) for name, value in found.layers.items() if name.endswith("_error")}
    return replace(found, standard_error=np.hypot(found.standard_error, unsure), layers=found.layers | layers)
