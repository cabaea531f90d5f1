"""How deep the lights of a scene lie for its walks, and a word before they start where that is too deep."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.diffusion import mean_cosines
from skyscatter.solvers.guide import guided_columns

if TYPE_CHECKING:
    from skyscatter.kernels.volume import VolumeTable
    from skyscatter.solvers.base import Rays

Array = NDArray[np.float64]

#: Depths from which on the error bars of few walks are too small (benchmarks/coverage_nebula.py): transport free paths
#: and scatterings forward in nearly white media, e-foldings of the light in others.
MOST_FREE_PATHS, MOST_FORWARD, MOST_FOLDS = 25.0, 7.0, 120.0
#: Exponent in the depths below which a medium is nearly white, and mean cosine from which on it scatters forward.
NEARLY_WHITE, FORWARD = 0.2, 0.5
#: Rays that are looked at, and the share of them that may be too deep.
LOOKED_AT, ALLOWED = 4096, 0.05


def warn_of_depths(table: VolumeTable, rays: Rays, names: tuple[str, ...]) -> None:
    """Warn where light comes to the rays through more than walks can follow."""
    if not len(table.power):
        return
    columns = _columns(table, rays)
    onward = table.sigma_s * mean_cosines(table.phase)
    white = table.decay < NEARLY_WHITE
    depth = columns @ table.sigma_t
    ahead = columns @ onward
    forward = white & (onward.sum(axis=0) > FORWARD * table.sigma_s.sum(axis=0))
    _judge(np.where(white, depth - ahead, 0.0), MOST_FREE_PATHS, "transport free paths", columns, table, names)
    _judge(np.where(forward, ahead, 0.0), MOST_FORWARD, "scatterings forward", columns, table, names)
    _judge(depth * table.decay, MOST_FOLDS, "e-foldings", columns, table, names)


def _judge(depth: Array, most: float, what: str, columns: Array, table: VolumeTable, names: tuple[str, ...]) -> None:
    """Warn where too many of the depths (ray, wavelength) exceed the most that walks follow surely."""
    share = float(np.mean(depth.max(axis=1) > most))
    if share <= ALLOWED:
        return
    ray, wavelength = np.unravel_index(np.argmax(depth), depth.shape)
    thickest = names[int(np.argmax(columns[ray] * table.sigma_t[:, wavelength]))]
    warnings.warn(
        f"light comes through {depth[ray, wavelength]:.3g} {what} of {thickest!r} (more than {most:g} for {share:.0%} "
        "of the rays): few walks find it, and the standard error of fewer than 1000 walks a ray is too small; raise "
        "samples, lower the extinction, or, with lights outside the medium, choose the sampling 'delta'",
        stacklevel=4,
    )


def _columns(table: VolumeTable, rays: Rays) -> Array:
    """Least columns (ray, component) from where rays enter the medium to a light, from the table of the guide."""
    space = table.space
    step = max(len(rays.origins) // LOOKED_AT, 1)
    origins, directions = rays.origins[::step], rays.directions[::step]
    low, size = space.bound_low, space.bound_step * space.cells
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (low - origins) / directions, (low + size - origins) / directions
    near = np.nanmax(np.where(np.isfinite(one), np.minimum(one, two), -np.inf), axis=1)
    points = origins + np.maximum(np.where(np.isfinite(near), near, 0.0), 0.0)[:, None] * directions
    # A ray that misses the medium counts as one that touches it.
    found = guided_columns(table, np.clip(points, low, low + size))
    # The light that is easiest to reach.
    depth = found @ table.sigma_t.mean(axis=1)
    return found[np.argmin(depth, axis=0), np.arange(len(points))]
