"""Solver ``path`` for media of three dimensions: all orders of scattering by backward Monte Carlo.

Where columns are cheap the first order comes from ``single``, without noise; walks with forced scattering add the rest.
Through voxels, particles and turbulence the walks bring in all of it.  Two plain ways remain
to test it by: ``sampling="free-flight"`` inverts the column along every leg, ``sampling="delta"`` finds collisions by
delta tracking with local majorants; both take all orders from the walks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.kernels.path import BATCHES
from skyscatter.kernels.tracking import QUADRATURE, RATIO, RESIDUAL
from skyscatter.kernels.volume import VolumeTable
from skyscatter.kernels.volume_flight import make_flight_scratch, volume_flight_rays
from skyscatter.kernels.volume_walks import scratch_of, volume_path_rays
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Walks
from skyscatter.solvers.bounds import check_bounds, check_excess
from skyscatter.solvers.depths import warn_of_depths
from skyscatter.solvers.options import SPACE_TOLERANCE, Path
from skyscatter.solvers.path import MOST_ORDERS, walks_for
from skyscatter.solvers.transmittance import cheapest, has_cheap_columns
from skyscatter.solvers.volume_single import prepare as prepare_single
from skyscatter.solvers.volume_single import single_parts, without_lights

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyscatter.space import SpaceScene

__all__ = ["check", "prepare", "solve"]

#: Tolerance of the first order: a disagreement of the rules, a hundred times the error of the finer one.
DEFAULT_TOLERANCE = SPACE_TOLERANCE
SAMPLINGS = ("march", "free-flight", "delta")
#: Ways to find transmittances towards lights, and their codes in the kernels.
TRANSMITTANCES = {"auto": -1, "quadrature": QUADRATURE, "ratio": RATIO, "residual-ratio": RESIDUAL}


class Context(NamedTuple):
    """What is prepared once for all rays."""

    table: VolumeTable
    names: tuple[str, ...]  #: of the components


def check(asked: Asked[Path]) -> None:
    """Refuse what contradicts itself."""
    if asked.how.sampling is not None and asked.how.sampling not in SAMPLINGS:
        raise DomainError("sampling", asked.how.sampling, f"choose from {', '.join(SAMPLINGS)}")
    if asked.how.sampling in ("free-flight", "delta"):
        asked.refuse(f"path with {asked.how.sampling} sampling", "noise", "tolerance")


def prepare(
    scene: SpaceScene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Path],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Context:
    """The tables of a scene, and how transmittances are found."""
    table = prepare_single(scene, rays, wavelengths, asked, threads, progress)
    # Delta tracking is there to test what is made of columns: it uses none, unless told to.
    usual = "ratio" if asked.how.sampling == "delta" else "auto"
    wanted = TRANSMITTANCES[asked.how.transmittance or usual]
    table = table._replace(tracking=cheapest(table) if wanted < 0 else wanted)
    names = tuple(component.name for component in scene.medium.components)
    warn_of_depths(table, rays, names, asked)
    if asked.how.sampling == "delta" or table.tracking != QUADRATURE:
        check_bounds(scene.medium)
    return Context(table, names)


def no_walks(context: Context, rays: int, asked: Asked[Path]) -> Walks:
    """The sums with which walks begin; those of light that is not scattered, and once, are told apart."""
    return Walks.none(rays, 1, min(walks_for(asked), BATCHES), asked.orders + 2, context.table.sigma_s.shape[1])


def solve(context: Context, rays: Rays, asked: Asked[Path], walks: Walks | None = None) -> Answer:
    """Radiance of all orders, see `skyscatter.radiance`; `walks` that were made before are gone on with."""
    table = context.table
    n, (components, wavelengths) = len(rays.origins), table.sigma_s.shape
    mean, error = np.empty((n, wavelengths)), np.empty((n, wavelengths))
    by_order = np.empty((n, asked.orders, wavelengths))
    used = np.empty(n, np.int64)
    count = walks_for(asked)
    max_order = MOST_ORDERS if asked.how.max_order is None else int(asked.how.max_order)
    tolerance = asked.how.tolerance or DEFAULT_TOLERANCE
    scattered = direct = np.zeros_like(mean)
    if asked.how.sampling in ("free-flight", "delta"):
        direct = single_parts(without_lights(table), rays, tolerance)[1]
        flights = make_flight_scratch(components, wavelengths)
        volume_flight_rays(
            table, asked.how.sampling == "delta", rays.origins, rays.directions, rays.numbers, np.int64(asked.how.seed),
            count, max_order, flights, mean, error, by_order, used,
        )  # fmt: skip
        check_excess(flights.work.excess, context.names)
    else:
        walked, walks = not has_cheap_columns(table), walks or no_walks(context, n, asked)
        orders, apart = (np.ascontiguousarray(part) for part in np.split(walks.marked, [asked.orders], axis=1))
        if not walked:
            scattered, direct = single_parts(table, rays, tolerance)
        scratch = scratch_of(table, count)
        volume_path_rays(
            table, rays.origins, rays.directions, rays.numbers, scattered, walked, np.int64(asked.how.seed), count,
            walks.done, walks.sums, asked.how.noise or 0.0, max_order, scratch, mean, error, orders, apart, used,
        )  # fmt: skip
        walks.done, walks.marked = count // walks.sums.shape[2], np.concatenate([orders, apart], axis=1)
        by_order, apart = np.split(walks.mean(slice(None), used), [asked.orders], axis=1)
        check_excess(scratch.work.excess, context.names)
        if walked:
            direct, scattered = apart[:, 0], apart[:, 1]
            mean = mean - direct - scattered
            by_order[:, :1] -= scattered[:, None]
    layers = {}
    if asked.parts:
        # Plain walks do not tell the first order from the others.
        plain = asked.how.sampling in ("free-flight", "delta")
        layers = {"direct": direct, "multiple": mean} | ({} if plain else {"scattered": scattered})
    if asked.orders:
        by_order[:, 0] += scattered
        layers |= {f"order{k + 1}": by_order[:, k] for k in range(asked.orders)}
    return Answer(scattered + direct + mean, error, layers, used)
