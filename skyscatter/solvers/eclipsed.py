"""What stands in for the solver ``orders`` in an eclipse of the Sun: light scattered once, and walks for the rest.

`orders` holds light that is symmetric about the Sun, and in the Moon's shadow none is.  Light scattered once comes from
``single``, without noise; of the rest walks are made at nodes over the observer's sky
(`skyscatter.solvers.eclipsesky`).  Few rays, rays from several places and those of observers far above the ground have
walks of their own.  The stated error is that of the walks, and of what is missed between nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.progress import say
from skyscatter.scene import Scene
from skyscatter.solvers import path
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Tables, prepare_tables
from skyscatter.solvers.eclipsesky import EclipsedSky, sky_of
from skyscatter.solvers.options import ECLIPSE_TOLERANCE, Orders, Path
from skyscatter.solvers.single import single_parts
from skyscatter.solvers.skyfit import NODES, RINGS_ABOVE

#: Relative accuracy that is aimed at if nothing is said, and the noise of a node and of a ray by itself in units of it.
#: A fit over the sky leaves a third of the noise of its nodes.
DEFAULT_TOLERANCE, NODE_NOISE = ECLIPSE_TOLERANCE, 2.5
#: Walks of a ray by itself, at least.
FIRST_WALKS = 128
#: Rays from which on nodes are worth it.
FEWEST = 2 * NODES * RINGS_ABOVE
#: Height above which observers look down on the shadow, which is not smooth then [m].
ALOFT = 20e3
#: Rays within so many radii of the Sun's disk may see it.
DISK = 2.0


class Context(NamedTuple):
    """What is shared by all rays."""

    tables: Tables
    sky: EclipsedSky | None  #: None where every ray has its own walks


def check(asked: Asked[Orders]) -> None:
    """Refuse what means nothing here."""
    asked.refuse("orders", "orders")
    if asked.stokes:
        raise DomainError("stokes", True, "in an eclipse of the Sun polarised light takes the solver path")
    tolerance = asked.how.tolerance
    if tolerance is not None and tolerance < 1e-3:
        raise DomainError("tolerance", tolerance, "at least 1e-3 in an eclipse of the Sun, where walks decide")


def walking(asked: Asked[Orders]) -> Asked[Path]:
    """What is asked of the walks."""
    noise = NODE_NOISE * (asked.how.tolerance or DEFAULT_TOLERANCE)
    return Asked(Path(noise=noise, seed=asked.how.seed, max_order=asked.how.max_order), asked.parts)


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Orders],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene, and where they will do the nodes of its sky."""
    tables = prepare_tables(scene, rays, wavelengths, asked, threads, progress)
    optics, position = tables.scene.optics, scene.observer.position
    one_place = len(rays.origins) >= FEWEST and np.array_equal(np.ptp(rays.origins, axis=0), np.zeros(3))
    if not one_place or scene.altitude > ALOFT or optics.emits or optics.background.any():
        return Context(tables, None)
    if not np.allclose(rays.origins[0], position, rtol=0.0, atol=1e-3):
        return Context(tables, None)
    if progress is not None:
        say("nodes over the sky")

    def tick(share: float) -> None:
        if progress is not None:
            progress(share)

    return Context(tables, sky_of(tables, position, rays.directions, walking(asked), threads, tick))


def _walked(tables: Tables, rays: Rays, asked: Asked[Path]) -> Answer:
    """Every ray by walks of its own; some at first in any case, for the error of very few says little."""
    kept = path.no_walks(tables, len(rays.origins), asked)
    few = replace(asked, how=replace(asked.how, noise=None, samples=FIRST_WALKS))
    path.solve(tables, rays, few, kept)
    return path.solve(tables, rays, asked, kept)


def solve(context: Context, rays: Rays, asked: Asked[Orders]) -> Answer:
    """Radiance of all orders; see `skyscatter.radiance`."""
    tables, sky = context
    if sky is None:
        return _walked(tables, rays, walking(asked))
    first, direct = None, np.zeros((len(rays.origins), tables.scene.optics.albedo.size))
    if sky.once is None:
        scattered, ground, direct = single_parts(tables.scene, tables.ground, rays, path.DEFAULT_TOLERANCE)
        first = scattered, ground
    else:
        optics = tables.scene.optics
        beside = np.linalg.norm(rays.directions - optics.disk_axis, axis=1) < DISK * np.sin(optics.disk_radius)
        some = np.flatnonzero(beside)
        if some.size:
            origins, directions = (np.ascontiguousarray(a[some]) for a in (rays.origins, rays.directions))
            near = Rays(origins, directions, rays.numbers[some])
            direct[some] = single_parts(tables.scene, tables.ground, near, path.DEFAULT_TOLERANCE)[2]
    look = sky.look(rays.directions, first)
    layers = {}
    if asked.parts:
        names = ("direct", "scattered", "ground", "multiple")
        layers = dict(zip(names, (direct, look.scattered, look.ground, look.multiple), strict=True))
    radiance = look.scattered + look.ground + look.multiple + direct
    return Answer(radiance, look.error, layers, np.zeros(len(radiance), np.int64))
