"""Nodes over an observer's sky at which the light of towns is solved, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyscatter.solvers.base import Array

#: Nodes of elevation above the horizon and below it, and of azimuth from a lamp over 180 degrees, at which light is
#: scattered once; they crowd at the horizon and at the lamp by these powers.
ABOVE, BELOW, AZIMUTHS = 36, 20, 41
CROWDED, CROWDED_AZIMUTH = 2.5, 2.6
#: The same of light that is scattered more often.
WALKED_ABOVE, WALKED_BELOW, WALKED_AZIMUTHS = 12, 6, 8
WALKED_CROWDED, WALKED_CROWDED_AZIMUTH = 2.0, 1.8
#: Azimuths at which the sky is kept.
TURNS = 1440
#: Elevation of rays beside the horizon [rad], so that it is clear on which side they are.
HAIR = 1e-7


@dataclass(frozen=True)
class TownGlow:
    """The light of towns over elevation and azimuth in an observer's sky.

    Attributes
    ----------
    horizon : float
        Elevation of the horizon, at most 0 [rad].
    logarithm : ndarray, shape (elevation, azimuth, wavelength)
        Of the radiance [W m-2 sr-1 nm-1], at nodes from the nadir to the horizon and from there to the zenith.
    relative : ndarray, shape (elevation, azimuth, wavelength)
        Its standard error, and what the nodes may miss, over it.
    """

    horizon: float
    logarithm: Array
    relative: Array

    def at(self, directions: Array) -> tuple[Array, Array]:
        """Radiance in directions, and its error.

        Parameters
        ----------
        directions : ndarray, shape (ray, 3)
            Unit vectors of the observer's frame (east, north, up).

        Returns
        -------
        radiance, error : ndarray, shape (ray, wavelength)
            [W m-2 sr-1 nm-1]
        """
        from scipy.sparse import csr_array

        count, turns, wavelengths = self.logarithm.shape
        rows, across = self._rows(directions)
        turn = np.arctan2(directions[:, 0], directions[:, 1]) / (2 * np.pi) * turns % turns
        columns = np.floor(turn).astype(np.int64)[:, None] + np.arange(-1, 3)
        along = smooth_weights(turn - np.floor(turn))
        cells = (rows[:, :, None] * turns + columns[:, None, :] % turns).reshape(len(directions), 16)
        weights = (across[:, :, None] * along[:, None, :]).reshape(len(directions), 16)
        start = np.arange(0, 16 * len(directions) + 1, 16)
        table = csr_array((weights.ravel(), cells.ravel(), start), shape=(len(directions), count * turns))
        radiance = np.exp(np.asarray(table @ self.logarithm.reshape(count * turns, wavelengths)))
        return radiance, radiance * self.relative.reshape(count * turns, wavelengths)[cells[:, 5]]

    def _rows(self, directions: Array) -> tuple[Any, Array]:
        """Four nodes of elevation around each direction and their weights; nothing is joined across the horizon."""
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])) - self.horizon
        up = elevation >= 0
        size = np.where(up, ABOVE - 1, BELOW - 1)
        width = np.where(up, np.pi / 2 - self.horizon, np.pi / 2 + self.horizon)
        u = np.minimum((np.abs(elevation) / width) ** (1 / CROWDED), 1.0) * size
        cell = np.minimum(u.astype(np.int64), size - 1)
        weights = smooth_weights(u - cell)
        # Beyond the first and the last node the logarithm goes on straight.
        for edge, out, last in ((cell == 0, 0, 1), (cell == size - 1, 3, 2)):
            weights[edge, last] += 2 * weights[edge, out]
            weights[edge, 2 if last == 1 else 1] -= weights[edge, out]
            weights[edge, out] = 0.0
        rows = np.clip(cell[:, None] + np.arange(-1, 3), 0, size[:, None])
        return rows + np.where(up, BELOW, 0)[:, None], weights


def smooth_weights(x: Array) -> Array:
    """Weights of four neighbours for a place x from 0 to 1 between the middle two: a cubic with continuous slope.

    Catmull & Rom (1974), in Computer Aided Geometric Design, 317.
    """
    return np.stack(
        [
            0.5 * x * (-1 + x * (2 - x)), 1 + 0.5 * x * x * (3 * x - 5),
            0.5 * x * (1 + x * (4 - 3 * x)), 0.5 * x * x * (x - 1),
        ],
        axis=-1,
    )  # fmt: skip


def _side(horizon: float, count: int, crowded: float, sign: int) -> Array:
    share = np.linspace(0, 1, count) ** crowded
    return horizon + sign * np.maximum(share * (np.pi / 2 - sign * horizon), HAIR)


def elevations(horizon: float, below: int, above: int, crowded: float) -> Array:
    """Elevations on both sides of the horizon, first those below it, each beginning at the horizon [rad]."""
    return np.concatenate([_side(horizon, below, crowded, -1), _side(horizon, above, crowded, 1)])


def azimuths(count: int, crowded: float) -> Array:
    """Azimuths from 0 to pi [rad], which crowd at 0."""
    return np.asarray(np.pi * np.linspace(0, 1, count) ** crowded)


def rays_at(elevation: Array, azimuth: Array) -> Array:
    """Unit vectors (elevation * azimuth, 3), azimuths from north."""
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1).reshape(-1, 3)


def joined(values: Array, smooth: bool) -> Array:
    """Values at the nodes of walks (elevation, azimuth, ...) at those of light scattered once."""
    from scipy.interpolate import CubicSpline, make_interp_spline

    def along(part: Array, old: Array, new: Array, flat: bool) -> Array:
        if smooth:
            ends = "clamped" if flat else "not-a-knot"
            return np.asarray(CubicSpline(old, part, bc_type=ends)(new))
        return np.asarray(make_interp_spline(old, part, k=1)(new))

    # In the numbers of the nodes, which rise evenly where the light changes evenly.
    turned = np.linspace(0, 1, AZIMUTHS) ** (CROWDED_AZIMUTH / WALKED_CROWDED_AZIMUTH)
    values = np.moveaxis(values, 1, 0)
    values = np.moveaxis(along(values, np.linspace(0, 1, WALKED_AZIMUTHS), turned, True), 0, 1)
    sides = []
    for part, count in ((values[:WALKED_BELOW], BELOW), (values[WALKED_BELOW:], ABOVE)):
        at = np.linspace(0, 1, count) ** (CROWDED / WALKED_CROWDED)
        sides.append(along(part, np.linspace(0, 1, len(part)), at, False))
    return np.concatenate(sides)


def cell_rule() -> tuple[Array, Array, Array]:
    """Azimuths at which K is looked up for its means over cells from 0 to pi, the cells, and the weights.

    Cells near the lamp, where K has its peak, have more of them, crowding in the one at the lamp.
    """
    width = 2 * np.pi / TURNS
    x, w = np.polynomial.legendre.leggauss(16)
    x, w = 0.5 * (x + 1), 0.5 * w
    at, cell, weight = [0.5 * width * x**3], [np.zeros(16, np.int64)], [3 * x * x * w]
    for first, last, count in ((1, 12, 8), (12, TURNS // 2 + 1, 2)):
        x, w = np.polynomial.legendre.leggauss(count)
        number = np.arange(first, last)
        at.append((width * (number[:, None] + 0.5 * x)).ravel())
        cell.append(np.repeat(number, count))
        weight.append(np.tile(0.5 * w, number.size))
    folded = np.concatenate(at)
    return np.where(folded > np.pi, 2 * np.pi - folded, folded), np.concatenate(cell), np.concatenate(weight)


def cell_means(values: Array, logarithmic: bool) -> Array:
    """Means over cells of azimuth from 0 to 2 pi of an even function at nodes; (elevation, azimuth, wavelength)."""
    from scipy.interpolate import CubicSpline, make_interp_spline
    from scipy.sparse import csr_array

    at, cell, weight = cell_rule()
    number, place = np.linspace(0, 1, AZIMUTHS), (at / np.pi) ** (1 / CROWDED_AZIMUTH)
    across = np.moveaxis(values, 1, 0)
    if logarithmic:
        floor = 1e-12 * np.maximum(across.max(axis=(0, 1)), 1e-280)
        fine = np.exp(CubicSpline(number, np.log(np.maximum(across, floor)), bc_type="clamped")(place))
    else:
        fine = make_interp_spline(number, across, k=1)(place)
    half = TURNS // 2
    rule = csr_array((weight, (cell, np.arange(at.size))), shape=(half + 1, at.size))
    means = np.asarray(rule @ fine.reshape(at.size, -1)).reshape(half + 1, *fine.shape[1:])
    return np.moveaxis(np.concatenate([means, means[half - 1 : 0 : -1]]), 0, 1)
