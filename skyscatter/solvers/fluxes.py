"""Fluxes and other integrals over directions of a solved field."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers import grid as grids
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.estimate import level_error, stated_error
from skyscatter.solvers.kernels.lookup import ColumnTable
from skyscatter.solvers.sweeps import Problem, Solution, view

Array = NDArray[np.float64]

#: Directions over which fluxes are integrated: above the horizontal, between it and the horizon, and on the ground, at
#: the base tolerance; and azimuths over half a turn beyond the degree to which phase functions are kept.
DIRECTIONS, MORE_AZIMUTHS = (28, 48, 20), 8
#: Zenith offsets that stand for the Sun's disk in the direct beam, which sets edge first.
DISK_NODES = 8
#: Rays looked along together.
RAYS = 4096
#: Relative error of the optical depth of tabulated columns, with caution (see `build_column_table`).
COLUMN_ERROR = 1e-3


class Fluxes(NamedTuple):
    """Spectral fluxes [W m-2 nm-1], each (..., wavelength), and their estimated errors in the same units."""

    direct: Array  #: sunlight never scattered, downward through a horizontal plane; negative where it passes upward
    diffuse_down: Array  #: everything else downward
    diffuse_up: Array  #: upward, but for the direct beam
    actinic: Array  #: radiance integrated over all directions, direct sunlight included
    direct_error: Array
    diffuse_down_error: Array
    diffuse_up_error: Array
    actinic_error: Array

    @property
    def net(self) -> Array:
        """Downward minus upward."""
        return self.direct + self.diffuse_down - self.diffuse_up

    @property
    def net_error(self) -> Array:
        """Of `net`, as if the errors of its parts had one sign."""
        return self.direct_error + self.diffuse_down_error + self.diffuse_up_error


class Beam(NamedTuple):
    """The direct beam [W m-2 nm-1], each (..., wavelength)."""

    true: Array  #: irradiance normal to the Sun of what was never scattered
    cut: Array  #: together with what delta-M's forward peaks scatter
    true_flux: Array  #: of `true`, downward through a horizontal plane; negative where it passes upward
    cut_flux: Array


class Integrals(NamedTuple):
    """Integrals of the radiance without the beam and its forward peaks, each (..., wavelength) [W m-2 nm-1]."""

    down: Array
    up: Array
    mean: Array  #: over all directions, unweighted


def direct_beam(columns: ColumnTable, problem: Problem, altitude: Array, zenith: Array | float) -> Beam:
    """Direct sunlight at altitudes [m] under zenith angles of the Sun [rad]; arrays of one shape.

    Over the zenith angle a uniform disk weighs as a semicircle, whose rules are Gauss-Chebyshev's of the second kind.
    """
    diffuse, sigma_t = problem.diffuse, problem.table.optics.sigma_t
    h, angle = np.broadcast_arrays(np.asarray(altitude, float), np.asarray(zenith, float))
    # The rule of two nodes has them at half the radius.
    radius = 2 * float(np.arcsin(abs(diffuse.tilt[1, 1])))
    node = np.arange(1, DISK_NODES + 1) * np.pi / (DISK_NODES + 1)
    offsets, weights = radius * np.cos(node), 2 / (DISK_NODES + 1) * np.sin(node) ** 2
    out = np.zeros((4, h.size, sigma_t.shape[1]))
    for k, (height, z) in enumerate(zip(h.ravel(), angle.ravel(), strict=True)):
        for offset, weight in zip(offsets, weights, strict=True) if radius > 0 else ((0.0, 1.0),):
            mu = float(np.cos(z + offset))
            column = slant_columns(columns, float(height), mu)
            if column is not None:
                for row, sigma in ((0, sigma_t), (1, diffuse.sigma_t)):
                    light = weight * diffuse.share[0] * np.exp(-column @ sigma)
                    out[row, k] += light
                    out[row + 2, k] += light * mu
    return Beam(*out.reshape(4, *h.shape, -1))


def _smooth(problem: Problem) -> Problem:
    """The problem with delta-M's forward peaks left out of the first order too, as fluxes want it.

    The peaks' light travels with the beam; along rays it would need directions beside the Sun.
    """
    diffuse = problem.diffuse
    optics = problem.table.optics._replace(disk_radius=0.0)
    return replace(
        problem,
        table=problem.table._replace(optics=optics),
        diffuse=diffuse._replace(peaks=np.ascontiguousarray(diffuse.peaks[:, :0])),
        whole=problem.cut,
    )


def integrals(solution: Solution, altitude: Array, zenith: Array) -> Integrals:
    """Integrals of the field's own radiances over all directions, at points (point,) [m], [rad].

    The rays are those of `view`, so that fluxes agree with radiances; nothing is interpolated between nodes.
    """
    problem = _smooth(solution.problem)
    grid, diffuse = problem.grid, problem.diffuse
    radius, sun = problem.table.columns.radius, problem.table.optics.disk_axis
    side = np.cross(sun, [0.0, 0.0, 1.0] if abs(sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(side, sun)
    count = max(grid.azimuths.size, diffuse.greek.shape[2] - 1 + MORE_AZIMUTHS)
    phi = np.pi * (np.arange(count) + 0.5) / count
    heights, place = np.unique(altitude, return_inverse=True)
    rules = grids.directions(heights, radius, diffuse.greek.shape[2] - 1, problem.tolerance, DIRECTIONS)
    out = np.zeros((3, altitude.size, diffuse.sigma_t.shape[1]))
    share = max(RAYS // (rules.shape[1] * count), 1)
    points = np.argsort(place, kind="stable")
    for chunk in (points[k : k + share] for k in range(0, points.size, share)):
        z, rule = zenith[chunk], rules[place[chunk]]
        up = np.cos(z)[:, None] * sun + np.sin(z)[:, None] * other
        toward = np.sin(z)[:, None] * sun - np.cos(z)[:, None] * other
        mu, weight = rule[..., 0], rule[..., 1]
        sine = np.sqrt((1 - mu) * (1 + mu))
        level = np.cos(phi)[:, None] * toward[:, None] + np.sin(phi)[:, None] * side
        d = mu[:, :, None, None] * up[:, None, None] + sine[:, :, None, None] * level[:, None]
        o = np.broadcast_to(((radius + altitude[chunk])[:, None] * up)[:, None, None], d.shape)
        seen = np.broadcast_to((weight > 0)[..., None], d.shape[:-1])
        parts = view(problem, solution.loaded, problem.table, o[seen], d[seen])
        light = np.zeros((*d.shape[:-1], out.shape[2]))
        light[seen] = parts[0][:, 0] + parts[1][:, 0] + parts[2] + parts[3]
        ring = light.mean(axis=2) * (2 * np.pi * weight)[..., None]
        for row, f in enumerate((np.maximum(mu, 0.0), np.maximum(-mu, 0.0), np.ones_like(mu))):
            out[row, chunk] = np.einsum("pk,pkw->pw", f, ring)
    return Integrals(*out)


def fluxes(solution: Solution, altitude: Array, zenith: Array, other: Solution | None = None) -> Fluxes:
    """Fluxes at altitudes [m] under zenith angles of the Sun [rad]; arrays of one shape (...).

    Their errors are estimated from another, coarser solution, as those of radiances are; nan without one.
    """
    h, z = altitude.ravel(), zenith.ravel()
    problem = solution.problem
    fine = integrals(solution, h, z)
    beam = direct_beam(problem.table.columns, problem, h, z)
    # Delta-M's beam takes the light of the forward peaks along, which counts as diffuse.
    peaks = beam.cut_flux - beam.true_flux
    down, up = fine.down + np.maximum(peaks, 0.0), fine.up - np.minimum(peaks, 0.0)
    # What the ground sends up is its albedo's share of what falls on it, to the last digit, and what it shines itself.
    own, albedo = problem.diffuse.light[1], problem.diffuse.light[2]
    from_ground = albedo * (down + np.maximum(beam.true_flux, 0.0)) + np.pi * own
    up = np.where((h == 0.0)[:, None], from_ground, up)
    values = (beam.true_flux, down, up, fine.mean + beam.cut)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.nan_to_num(-np.log(beam.true / problem.diffuse.share[0]), nan=0.0, posinf=0.0)
    errors = [COLUMN_ERROR * depth * np.abs(beam.true_flux)]
    if other is None:
        errors += [np.full_like(fine.down, np.nan)] * 3
    else:
        coarse = fluxes(other, h, z)
        pairs = zip(values[1:], (coarse.diffuse_down, coarse.diffuse_up, coarse.actinic), strict=True)
        level = level_error(z, problem.level_peaks)
        errors += [stated_error(value, rough, problem.tolerance) + level * np.abs(value) for value, rough in pairs]
    shape = (*altitude.shape, fine.down.shape[-1])
    return Fluxes(*(np.reshape(a, shape) for a in (*values, *errors)))


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
