"""Fluxes and other integrals over directions of a solved field."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers import grid as grids
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.kernels.lookup import ColumnTable
from skyscatter.solvers.sweeps import FLOOR, Problem, Sums

Array = NDArray[np.float64]


class Fluxes(NamedTuple):
    """Spectral fluxes [W m-2 nm-1], each (..., wavelength)."""

    direct: Array  #: sunlight that was never scattered, downward through a horizontal plane
    diffuse_down: Array  #: everything else downward
    diffuse_up: Array  #: upward
    actinic: Array  #: radiance integrated over all directions, direct sunlight included

    @property
    def net(self) -> Array:
        """Downward minus upward."""
        return self.direct + self.diffuse_down - self.diffuse_up


class Beam(NamedTuple):
    """Irradiance normal to the Sun [W m-2 nm-1], each (..., wavelength)."""

    true: Array  #: of what was never scattered
    cut: Array  #: together with what delta-M's forward peaks scatter


def direct_beam(columns: ColumnTable, problem: Problem, altitude: Array, zenith: Array | float) -> Beam:
    """Direct sunlight at altitudes [m] under zenith angles of the Sun [rad]; arrays of one shape."""
    diffuse, sigma_t = problem.diffuse, problem.table.optics.sigma_t
    h, angle = np.broadcast_arrays(np.asarray(altitude, float), np.asarray(zenith, float))
    spread = float(np.arcsin(abs(diffuse.tilt[1, 1])))
    true, cut = np.zeros((h.size, sigma_t.shape[1])), np.zeros((h.size, sigma_t.shape[1]))
    for k, (height, z) in enumerate(zip(h.ravel(), angle.ravel(), strict=True)):
        for offset in (spread, -spread):
            column = slant_columns(columns, float(height), float(np.cos(z + offset)))
            if column is not None:
                true[k] += 0.5 * diffuse.share[0] * np.exp(-column @ sigma_t)
                cut[k] += 0.5 * diffuse.share[0] * np.exp(-column @ diffuse.sigma_t)
    return Beam(true.reshape(*h.shape, -1), cut.reshape(*h.shape, -1))


def interpolate(problem: Problem, values: Array, altitude: Array, zenith: Array) -> Array:
    """Values (node, sun, wavelength) at points (point,) by cubics that keep within their nodes."""
    grid = problem.grid
    number = np.arange(grid.sun_zenith.size, dtype=float)
    place = np.interp(zenith, grid.sun_zenith, number)
    (node, f), (sun, g) = grids.cubic_weights(grid.altitudes, altitude), grids.cubic_weights(number, place)
    at = values[node[:, :, None], sun[:, None, :]]
    between = np.einsum("pa,pb,pabw->pw", f, g, at)
    return np.asarray(np.clip(between, at.min(axis=(1, 2)), at.max(axis=(1, 2))))


def fluxes(problem: Problem, sums: Sums, altitude: Array, zenith: Array) -> Fluxes:
    """Fluxes at altitudes [m] under zenith angles of the Sun [rad]; arrays of one shape (...)."""
    h, z = altitude.ravel(), zenith.ravel()
    # From day to night the mean radiance falls by decades, but never to nought as fluxes do at the edges: it is taken
    # in its logarithm, and they as shares of it.
    mean_at_nodes = np.maximum(sums.moments[:, :, 0], FLOOR)
    mean = np.exp(interpolate(problem, np.log(mean_at_nodes), h, z))
    up, down = (mean * interpolate(problem, sums.flux[:, k] / mean_at_nodes, h, z) for k in (0, 1))
    beam = direct_beam(problem.table.columns, problem, h, z)
    mu = np.maximum(np.cos(z), 0.0)[:, None]
    direct = beam.true * mu
    shape = (*altitude.shape, up.shape[-1])
    diffuse_down = down + (beam.cut - beam.true) * mu
    return Fluxes(*(a.reshape(shape) for a in (direct, diffuse_down, up, mean + beam.cut)))


def sphere_rule(sun_azimuth_deg: float, elevations: int = 64, azimuths: int = 128) -> tuple[Array, Array]:
    """Directions (n, 3) and solid angles (n,) over the sphere, denser near the horizon and around the Sun's azimuth."""
    x, w = np.polynomial.legendre.leggauss(elevations)
    mu, weight = (0.5 * (x + 1)) ** 2, 0.5 * (x + 1) * w
    mu, weight = np.concatenate([mu, -mu]), np.concatenate([weight, weight])
    # A smooth change of variable gathers azimuths near the Sun; the midpoint rule stays spectrally accurate.
    t = 2 * np.pi * (np.arange(azimuths) + 0.5) / azimuths
    azimuth = t - 0.6 * np.sin(t) + np.radians(sun_azimuth_deg)
    step = 2 * np.pi / azimuths * (1 - 0.6 * np.cos(t))
    sine = np.sqrt(1 - mu**2)[:, None]
    directions = np.stack(
        [sine * np.sin(azimuth), sine * np.cos(azimuth), np.broadcast_to(mu[:, None], (mu.size, azimuths))], axis=-1
    )
    return directions.reshape(-1, 3), (weight[:, None] * step).ravel()
