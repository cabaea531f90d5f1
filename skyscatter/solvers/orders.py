"""Solver ``orders``: all orders of scattering by a deterministic solution on a grid; no noise.

For spherically symmetric atmospheres.  The first order is computed along every ray, with the whole phase function; the
rest is gathered from a field that is solved once for all rays (`sweeps.py`).  The reported error is estimated from a
second, coarser solution; for another accuracy give another ``tolerance``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skyscatter.geometry.seen import needed_zenith, seen_zenith
from skyscatter.kernels.optics import SceneTable
from skyscatter.progress import say
from skyscatter.scene import Scene
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.field import (
    DEFAULT_TOLERANCE,
    RadianceField,
    highest_sight,
    scattering_top,
    solve_range,
)
from skyscatter.solvers.options import Orders
from skyscatter.solvers.skytable import SkyTable
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import reach

#: Rays in a tile at most.  Those of a picture's row share their geometry, and few rows shall be cut in two: tiles of
#: 1024 rays took a third more for a picture 1280 pixels wide.
TILE_RAYS = 8192
#: Tiles of a picture at least, whatever the threads: rays of a tile share work, and so their last digits depend on it.
TILES = 16
#: What is prepared for all rays takes long, and is kept in the checkpoint.
KEEPS = True

#: Rays, about, from which it is found where the Sun stands that they see.
WINDOW_RAYS = 20011
#: Share of the height of what scatters above which a ray's lowest point makes it a limb.
LIMB = 0.3
#: Zenith angle of the Sun [rad] from which a field begins in twilight.
SUNLIT = np.radians(86.0)


class Context(NamedTuple):
    """What is shared by all rays."""

    field: RadianceField
    table: SceneTable
    sky: SkyTable | None = None  #: where rays are joined from nodes


#: The solver, in words, where it makes no walks.
WITHOUT_CHANCE = "orders without an eclipse of the Sun"


def check(asked: Asked[Orders]) -> None:
    """Refuse what means nothing here."""
    asked.refuse("orders", "orders")
    asked.refuse(WITHOUT_CHANCE, "seed")


def window(low: float, high: float, reach: float, aloft: float = 0.0) -> tuple[float, float]:
    """Zenith angles of the Sun for which a field is solved, where rays see the Sun at `low` to `high` [rad].

    Light that is scattered twice and more comes from beyond what the rays see.  By day it comes from near by, and where
    the field ends its last value goes on.  In twilight it comes from where the Sun shines, however far that is, and so
    the field begins there; and little comes from where it is darker.

    Parameters
    ----------
    low, high : float
    reach : float
        Angle at the planet's centre between the ground and where its horizontal leaves the atmosphere [rad].
    aloft : float
        The same for the highest air that rays see without any below it, such as a limb: as far as that its light comes
        from the ground and the air beneath.
    """
    twilight = float(np.clip((np.degrees(high) - 80) / 10, 0, 1))
    first = low - max(reach * (0.5 + 0.5 * twilight), aloft)
    return (min(first, SUNLIT) if high > SUNLIT else first), high + max(0.25 * reach, aloft)


def window_of(scene: Scene, table: SceneTable, origins: Array, directions: Array) -> tuple[float, float]:
    """Zenith angles of the Sun [rad] for which a field is solved, for rays in a scene."""
    medium, top = scene.medium, scattering_top(table)
    above = highest_sight(origins, directions, medium.radius, medium.top)
    if above > LIMB * top:  # a limb is seen where there is next to nothing, too
        top = medium.top
    low, high = needed_zenith(origins, directions, scene.sun.direction, medium.radius, top)
    if low != low:  # not a number: every ray passes by
        low = high = 0.0
    return window(low, high, reach(medium.radius, top), reach(medium.radius, above))


def darkest_sun(scene: Scene, table: SceneTable, origins: Array, directions: Array) -> float:
    """Zenith angle of the Sun [rad] in the best lit air along the ray that sees the darkest; 0 if none sees air."""
    top = scattering_top(table)
    best, _ = seen_zenith(origins, directions, scene.sun.direction, scene.medium.radius, top)
    return float(np.max(best, initial=0.0, where=best == best))


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Orders],
    threads: int,
    progress: Callable[[float], None] | None,
    checkpoint: Checkpoint | None = None,
) -> Context:
    """Solve the field for the positions of the Sun that the rays can see."""
    from skyscatter.solvers.compile import compile_scene

    table = compile_scene(scene, wavelengths)
    some = slice(None, None, max(len(rays.origins) // WINDOW_RAYS, 1))
    seen = scene, table, rays.origins[some], rays.directions[some]
    tolerance = DEFAULT_TOLERANCE if asked.how.tolerance is None else asked.how.tolerance
    field = solve_range(
        scene, wavelengths, window_of(*seen), tolerance, asked.stokes, asked.how.max_order, threads, progress,
        checkpoint, darkest_sun(*seen),
    )  # fmt: skip
    if progress is not None:
        say("nodes over the sky")
    return Context(field, table, field.sky_table(table, rays.origins, rays.directions, threads))


def solve(context: Context, rays: Rays, asked: Asked[Orders]) -> Answer:
    """Radiance of all orders; see `skyscatter.radiance`."""
    return context.field.look(context.table, rays.origins, rays.directions, asked.parts, context.sky)
