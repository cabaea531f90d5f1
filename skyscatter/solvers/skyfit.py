"""A smooth function of the direction for what walks found at nodes over an observer's sky.

Nodes stand in rings of even heights, closer at the horizon, above which and below which the sky is fitted by itself:
cubics over the elevation, a few Fourier terms over the azimuth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from skyscatter.solvers.base import Array
from skyscatter.solvers.response import CROWDED

#: Rings of nodes for walks above the horizon and below it, and nodes in each.
RINGS_ABOVE, RINGS_BELOW, NODES = 14, 6, 20
#: Fourier orders over the azimuth, and the degrees of their polynomials over the elevation.
DEGREES = ((1, 5), (2, 4), (3, 3), (4, 2), (5, 1))
#: Nodes that are twice as close miss less of what cubics leave by this factor, were they smooth 16.
TWICE = 8.0


@dataclass(frozen=True)
class Side:
    """Nodes for walks on one side of the horizon.

    Attributes
    ----------
    horizon : float
        [rad]
    sign : int
        1 above, -1 below.
    """

    horizon: float
    sign: int

    @property
    def rings(self) -> Array:
        """Places of the rings between the horizon, 0, and the zenith or nadir, 1; closer at both ends."""
        count = RINGS_ABOVE if self.sign > 0 else RINGS_BELOW
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count))

    @property
    def rays(self) -> Array:
        """Directions of the nodes, ring after ring; (node, 3)."""
        rings = self.rings
        elevation = self.horizon + self.sign * rings**CROWDED * self._width
        turn = 2 * np.pi * (np.arange(NODES) + 0.5 * (np.arange(rings.size) % 2)[:, None]) / NODES
        level = np.cos(elevation)[:, None]
        up = np.broadcast_to(np.sin(elevation)[:, None], turn.shape)
        return np.stack([level * np.sin(turn), level * np.cos(turn), up], axis=-1).reshape(-1, 3)

    @property
    def _width(self) -> float:
        return 0.5 * np.pi - self.sign * self.horizon

    def of(self, elevation: Array) -> NDArray[np.intp]:
        """Which elevations [rad] are on this side."""
        return np.flatnonzero(self.sign * (elevation - self.horizon) > 0)

    def place(self, directions: Array) -> Array:
        """Where directions lie, as `rings` counts."""
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1]))
        share = np.clip(self.sign * (elevation - self.horizon) / self._width, 0.0, 1.0)
        return np.asarray(share ** (1.0 / CROWDED))

    def basis(self, directions: Array) -> Array:
        """The functions over the azimuth that are fitted, at directions; (ray, function).

        Where all azimuths meet, those of Fourier order m fade as the cosine of the elevation or its square.
        """
        place = 2.0 * self.place(directions) - 1.0
        level = np.hypot(directions[:, 0], directions[:, 1])
        turn = np.arctan2(directions[:, 0], directions[:, 1])
        columns = []
        for m, degree in DEGREES:
            part = np.polynomial.chebyshev.chebvander(place, degree) * (level ** min(m, 2))[:, None]
            columns += [part * np.cos(m * turn)[:, None], part * np.sin(m * turn)[:, None]]
        return np.concatenate(columns, axis=1)


def fit(side: Side, mean: Array, error: Array, directions: Array) -> tuple[Array, Array]:
    """A smooth function of the direction for what walks found at the nodes of a side.

    Parameters
    ----------
    side : Side
    mean, error : ndarray, shape (node, wavelength)
    directions : ndarray, shape (ray, 3)

    Returns
    -------
    (ray, wavelength), (ray, wavelength)
        Fitted values, and their relative error.

    Notes
    -----
    Over the elevation go cubics through the logarithms of the means of rings; what remains, relative to these means, is
    fitted by the functions of `Side.basis`.  Nodes count by the mean of their ring, not by their own errors, which are
    small where walks happened to find little: such weights would make the fit too dark.
    """
    rings, wavelengths = side.rings, mean.shape[1]
    known, asked, place = side.basis(side.rays), side.basis(directions), side.place(directions)
    level = np.maximum(mean.reshape(rings.size, NODES, wavelengths).mean(axis=1), 1e-300)
    share = mean / np.repeat(level, NODES, axis=0)
    noise = error / np.repeat(level, NODES, axis=0)
    solved = np.linalg.pinv(known)
    ring = np.kron(np.eye(rings.size), np.full((NODES, NODES), 1.0 / NODES))
    onto = ring + known @ solved @ (np.eye(len(ring)) - ring)  # from what was found to what is fitted
    # What the residuals hold beyond the noise that is left in them.
    rest = np.eye(len(onto)) - onto
    misfit = np.maximum(((rest @ share) ** 2 - rest**2 @ noise**2).mean(axis=0), 0.0)
    own = (onto**2 @ noise**2).reshape(rings.size, NODES, wavelengths).mean(axis=1)
    own = own + misfit + between(rings, np.log(level), noise) ** 2
    values = np.exp(CubicSpline(rings, np.log(level))(np.clip(place, rings[0], rings[-1])))
    values = values * (1.0 + asked @ (solved @ (share - 1.0)))
    relative = np.stack([np.interp(place, rings, np.sqrt(own[:, i])) for i in range(wavelengths)], axis=1)
    return values, relative


def between(rings: Array, logarithm: Array, noise: Array) -> Array:
    """What cubics miss between rings (wavelength,): a share of what they miss with every other ring, beyond noise."""
    odd = np.arange(1, rings.size - 1, 2)
    kept = np.setdiff1d(np.arange(rings.size), odd)
    off = CubicSpline(rings[kept], logarithm[kept])(rings[odd]) - logarithm[odd]
    expected = 2.0 * (noise**2).mean(axis=0) / NODES
    return np.asarray(np.sqrt(np.maximum((off**2).mean(axis=0) - expected, 0.0)) / TWICE)
