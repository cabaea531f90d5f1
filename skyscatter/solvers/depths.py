"""How hard the light of a scene is to find for its walks, and a word before they start where that is too hard.

The bounds are those beyond which error bars of 32 walks cover too little (benchmarks/coverage_nebula.py).
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.diffusion import mean_cosines
from skyscatter.solvers.guide import guided_columns
from skyscatter.solvers.path import FEW_WALKS, walks_for

if TYPE_CHECKING:
    from skyscatter.kernels.space import SpaceTable
    from skyscatter.kernels.volume import VolumeTable
    from skyscatter.solvers.base import Asked, Rays
    from skyscatter.solvers.options import Path

Array = NDArray[np.float64]

#: From what on the error bars of few walks are too small: transport free paths and scatterings forward in nearly white
#: media, e-foldings of the light in others, and scatterings forward by which light is turned towards the observer; the
#: last for plain walks too, which know nothing of where it comes from.
MOST_FREE_PATHS, MOST_FORWARD, MOST_FOLDS, MOST_TURNS, PLAIN_TURNS = 25.0, 40.0, 120.0, 10.0, 5.5
#: Exponent in the depths below which a medium is nearly white, and mean cosine from which on it scatters forward.
NEARLY_WHITE, FORWARD = 0.2, 0.5
#: Part of a half turn by which light is turned at least, whatever the way to it, and optical depth of scattering from
#: which on there is enough light that was turned more than once.
LEAST_TURN, TURNING = 0.4, 0.3
#: Plain walks of a ray that are to come through to the light, and e-foldings through which it comes unscattered.
ENOUGH, NEAR_FOLDS = 10, 4.0
#: Rays that are looked at, and the share of them that may be too deep.
LOOKED_AT, ALLOWED = 4096, 0.05


def warn_of_depths(table: VolumeTable, rays: Rays, names: tuple[str, ...], asked: Asked[Path]) -> None:
    """Warn where light comes to the rays through more than so few walks can follow."""
    plain = asked.how.sampling in ("free-flight", "delta")
    walks = walks_for(asked)
    if not len(table.power) or (asked.how.noise is None and walks >= FEW_WALKS and not plain):
        return
    ways = Ways(table, rays)
    onward = table.sigma_s * mean_cosines(table.phase)
    cosine = onward.sum(axis=0) / np.maximum(table.sigma_s.sum(axis=0), 1e-300)
    forward = cosine > FORWARD
    # Light is turned by one scattering in 1 / (1 - g).
    turns = ways.turn[:, None] * cosine / np.maximum(1.0 - cosine, 1e-9)
    enough = ways.through @ table.sigma_s > TURNING
    bound = PLAIN_TURNS if plain else MOST_TURNS
    turned = (np.where(enough & forward, turns, 0.0), bound, "scatterings forward that turn it to the observer")
    depth, ahead = ways.columns @ table.sigma_t, ways.columns @ onward
    if plain:
        most = max(float(np.log(max(walks / ENOUGH, 1.0))), NEAR_FOLDS)
        bounds = [turned, (depth * table.decay, most, "e-foldings")]
        few, remedy = f"as few as {walks}", "leave sampling out, or raise samples"
    else:
        white = table.decay < NEARLY_WHITE
        bounds = [
            (np.where(white, depth - ahead, 0.0), MOST_FREE_PATHS, "transport free paths"),
            (np.where(white & forward, ahead, 0.0), MOST_FORWARD, "scatterings forward"),
            turned,
            (depth * table.decay, MOST_FOLDS, "e-foldings"),
        ]
        few, remedy = f"fewer than {FEW_WALKS}", "raise samples, or lower the extinction"
    for found, most, what in bounds:
        _judge(found, most, what, f"{few} walks a ray is too small; {remedy}", ways, table, names)


class Ways:
    """What lies between the rays and the light that is easiest to reach, by the table of the guide.

    Attributes
    ----------
    columns : (ray, component)
        Least columns from where the rays enter the medium to the light [m].
    through : (ray, component)
        Columns along the rays [m].
    turn : (ray,)
        Part of a half turn from the light's direction there to the observer's.
    """

    def __init__(self, table: VolumeTable, rays: Rays) -> None:
        from skyscatter.kernels.space import fill_columns, make_space_work

        step = max(len(rays.origins) // LOOKED_AT, 1)
        origins, directions = rays.origins[::step], rays.directions[::step]
        enter, leave = box_ends(table.space, origins, directions)
        self.through = np.zeros((len(origins), len(table.sigma_t)))
        fill_columns(table.space, enter, leave, make_space_work(), self.through)
        found = guided_columns(table, enter)
        chosen = np.argmin(found @ table.sigma_t.mean(axis=1), axis=0)
        self.columns = found[chosen, np.arange(len(enter))]
        towards = table.place[chosen] - np.where(table.distant[chosen, None], 0.0, enter)
        towards /= np.maximum(np.linalg.norm(towards, axis=1), 1e-300)[:, None]
        self.turn = np.maximum(0.5 * (1.0 - np.sum(towards * directions, axis=1)), LEAST_TURN)


def box_ends(space: SpaceTable, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Where rays enter the box of the medium and leave it; where they miss it, one point on it that they pass."""
    low, size = space.bound_low, space.bound_step * space.cells
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (low - origins) / directions, (low + size - origins) / directions
    near = np.nanmax(np.where(np.isfinite(one), np.minimum(one, two), -np.inf), axis=1)
    far = np.nanmin(np.where(np.isfinite(one), np.maximum(one, two), np.inf), axis=1)
    enter = np.maximum(np.where(np.isfinite(near), near, 0.0), 0.0)
    leave = np.maximum(np.where(np.isfinite(far), far, 0.0), enter)
    points = [np.clip(origins + t[:, None] * directions, low, low + size) for t in (enter, leave)]
    return np.ascontiguousarray(points[0]), np.ascontiguousarray(points[1])


def _judge(
    found: Array, most: float, what: str, then: str, ways: Ways, table: VolumeTable, names: tuple[str, ...]
) -> None:
    """Warn where too much of something lies before too many of the rays: `found` (ray, wavelength) above the `most`."""
    share = float(np.mean(found.max(axis=1) > most))
    if share <= ALLOWED:
        return
    ray, wavelength = np.unravel_index(np.argmax(found), found.shape)
    columns = ways.columns[ray] if ways.columns[ray].any() else ways.through[ray]
    thickest = names[int(np.argmax(columns * table.sigma_t[:, wavelength]))]
    warnings.warn(
        f"light comes through {found[ray, wavelength]:.3g} {what} of {thickest!r} (more than {most:.3g} for "
        f"{share:.0%} of the rays): few walks find it, and the standard error of {then}",
        stacklevel=4,
    )
