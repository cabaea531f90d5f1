"""Solver ``orders``: all orders of scattering by a deterministic solution on a grid; no noise.

For spherically symmetric atmospheres.  The first order is computed along every ray, with the whole phase function; the
rest is gathered from a field that is solved once for all rays (`sweeps.py`).  The reported error is estimated from a
second, coarser solution; for another accuracy give another ``tolerance``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.scene import Scene
from skyscatter.solvers.base import Answer, Array, Options, Rays
from skyscatter.solvers.field import DEFAULT_TOLERANCE, RadianceField, needed_zenith, reach, scattering_top, solve_range
from skyscatter.solvers.kernels.optics import SceneTable

#: Rays in a tile at most: those of a picture's row share their geometry.
TILE_RAYS = 1024
#: Tiles of a picture at least, whatever the threads: rays of a tile share work, and so their last digits depend on it.
TILES = 16


class Context(NamedTuple):
    """What is shared by all rays."""

    field: RadianceField
    table: SceneTable


def check(options: Options) -> None:
    """Refuse what means nothing here."""
    options.refuse("orders", "samples", "noise", "sampling", "transmittance", "orders")
    if options.tolerance is not None and options.tolerance < 1e-4:
        raise DomainError("tolerance", options.tolerance, "at least 1e-4 for solver orders")


def prepare(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    options: Options,
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """Solve the field for the positions of the Sun that the rays can see."""
    from skyscatter.solvers.compile import compile_scene

    medium = scene.medium
    table = compile_scene(scene, wavelengths)
    top = scattering_top(table)
    low, high = needed_zenith(rays.origins, rays.directions, scene.sun.direction, medium.radius, top)
    if low != low:  # not a number: every ray passes by
        low = high = 0.0
    # Beyond what the rays see, light that is scattered twice comes from there: by day from near by, in twilight from
    # where the Sun shines; and little from where it is darker.
    margin = reach(medium.radius, top)
    twilight = float(np.clip((np.degrees(high) - 80) / 10, 0, 1))
    zenith = (low - margin * (0.5 + 0.5 * twilight), high + 0.25 * margin)
    tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
    field = solve_range(scene, wavelengths, zenith, tolerance, options.stokes, options.max_order, threads, progress)
    return Context(field, table)


def solve(context: Context, rays: Rays, options: Options) -> Answer:
    """Radiance of all orders; see `skyscatter.radiance`."""
    return context.field.look(context.table, rays.origins, rays.directions, options.parts)
