"""Fluxes and other integrals over directions of a solved field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.kernels.lookup import ColumnTable
from skyscatter.solvers import grid as grids
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.estimate import level_error, stated_error
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import Problem, Solution, view

Array = NDArray[np.float64]

#: Directions over which fluxes are integrated: above the horizontal, between it and the horizon, and on the ground, at
#: the base tolerance; and azimuths over half a turn beyond the degree to which phase functions are kept.
DIRECTIONS, BETWEEN, MORE_AZIMUTHS = (28, 20), 48, 8
#: Zenith offsets that stand for the Sun's disk in the direct beam, which sets edge first.
DISK_NODES = 8
#: Rays looked along together.
RAYS = 4096
#: Relative error of the optical depth of tabulated columns, with caution (see `build_column_table`).
COLUMN_ERROR = 1e-3


class Fluxes(NamedTuple):
    """Spectral fluxes [W m-2 nm-1], each (..., wavelength), and their estimated errors in the same units.

    Examples
    --------
    On the ground below clear air, with the Sun at 50 degrees: the share of the light that comes from the sky.

    >>> import skyscatter
    >>> field = skyscatter.solve(skyscatter.load_model("earth-simple").scene(), [550], sun_elevations_deg=(50, 50))
    >>> fluxes = field.fluxes(0.0, sun_elevation_deg=50)
    >>> bool(0.05 < fluxes.diffuse_down[0] / (fluxes.direct[0] + fluxes.diffuse_down[0]) < 0.2)
    True
    """

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


@dataclass
class Work:
    """How far integrals have come: told, and kept in a checkpoint.

    Attributes
    ----------
    progress : callable or None
        Called with the finished share, 0 to 1.
    checkpoint : Checkpoint or None
    share : float
        Of the work, of the integrals that are made next: the finer ones take longer.
    """

    progress: Callable[[float], None] | None = None
    checkpoint: Checkpoint | None = None
    share: float = 0.8
    before: float = 0.0

    def begun(self, name: str, altitude: Array, zenith: Array, empty: Array) -> tuple[Array, int]:
        """Integrals so far and the number of finished points, where they were begun for these points."""
        kept = {} if self.checkpoint is None else self.checkpoint.part(name)
        same = kept and all(np.array_equal(kept[k], a) for k, a in (("altitude", altitude), ("zenith", zenith)))
        return (kept["out"].copy(), int(kept["done"])) if same else (empty, 0)

    def keep(self, name: str, altitude: Array, zenith: Array, out: Array, done: int) -> None:
        """So many points are finished."""
        if self.checkpoint is not None:
            arrays = {"altitude": altitude, "zenith": zenith, "out": out.copy(), "done": np.array(float(done))}
            self.checkpoint.put(name, arrays)
        if self.progress is not None:
            self.progress(self.before + self.share * done / altitude.size)
        if done == altitude.size:
            self.before, self.share = self.before + self.share, 1.0 - self.before - self.share


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


def integrals(
    solution: Solution, altitude: Array, zenith: Array, work: Work | None = None, name: str = ""
) -> Integrals:
    """Integrals of the field's own radiances over all directions, at points (point,) [m], [rad].

    The rays are those of `view`, so that fluxes agree with radiances; nothing is interpolated between nodes.  What is
    finished of them is told to `work`, by a name.
    """
    heights, place = np.unique(altitude, return_inverse=True)
    problem = _smooth(solution.problem)
    degree = problem.diffuse.greek.shape[2] - 1
    between = np.where(heights > 0, int(np.ceil(BETWEEN / grids.fineness(problem.tolerance))), 0)
    rules = grids.directions(heights, problem.table.columns.radius, degree, problem.tolerance, between, DIRECTIONS)
    azimuths = max(problem.grid.azimuths.size, degree + MORE_AZIMUTHS)
    points, share = np.argsort(place, kind="stable"), max(RAYS // (rules.shape[1] * azimuths), 1)
    out, done = np.zeros((3, altitude.size, problem.diffuse.sigma_t.shape[1])), 0
    if work is not None:
        out, done = work.begun(name, altitude, zenith, out)
    for first in range(done, points.size, share):
        chunk = points[first : first + share]
        out[:, chunk] = _at_points(solution, problem, altitude[chunk], zenith[chunk], rules[place[chunk]], azimuths)
        if work is not None:
            work.keep(name, altitude, zenith, out, min(first + share, points.size))
    return Integrals(*out)


def _at_points(
    solution: Solution, problem: Problem, altitude: Array, zenith: Array, rule: Array, azimuths: int
) -> Array:
    """Rows of `Integrals` at a few points with rules (point, direction, 2) of cosines and weights."""
    sun = problem.table.optics.disk_axis
    side = np.cross(sun, [0.0, 0.0, 1.0] if abs(sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(side, sun)
    phi = np.pi * (np.arange(azimuths) + 0.5) / azimuths
    up = np.cos(zenith)[:, None] * sun + np.sin(zenith)[:, None] * other
    toward = np.sin(zenith)[:, None] * sun - np.cos(zenith)[:, None] * other
    mu, weight = rule[..., 0], rule[..., 1]
    sine = np.sqrt((1 - mu) * (1 + mu))
    level = np.cos(phi)[:, None] * toward[:, None] + np.sin(phi)[:, None] * side
    d = mu[:, :, None, None] * up[:, None, None] + sine[:, :, None, None] * level[:, None]
    o = np.broadcast_to(((problem.table.columns.radius + altitude)[:, None] * up)[:, None, None], d.shape)
    seen = np.broadcast_to((weight > 0)[..., None], d.shape[:-1])
    parts = view(problem, solution.loaded, problem.table, o[seen], d[seen])
    light = np.zeros((*d.shape[:-1], problem.diffuse.sigma_t.shape[1]))
    light[seen] = parts[0][:, 0] + parts[1][:, 0] + parts[2] + parts[3]
    ring = light.mean(axis=2) * (2 * np.pi * weight)[..., None]
    over = (np.maximum(mu, 0.0), np.maximum(-mu, 0.0), np.ones_like(mu))
    return np.stack([np.einsum("pk,pkw->pw", f, ring) for f in over])


def fluxes(
    solution: Solution,
    altitude: Array,
    zenith: Array,
    other: Solution | None = None,
    work: Work | None = None,
    name: str = "fluxes",
) -> Fluxes:
    """Fluxes at altitudes [m] under zenith angles of the Sun [rad]; arrays of one shape (...).

    Their errors are estimated from another, coarser solution, as those of radiances are; nan without one.
    """
    h, z = altitude.ravel(), zenith.ravel()
    problem = solution.problem
    fine = integrals(solution, h, z, work, name)
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
        coarse = fluxes(other, h, z, None, work, f"{name}, coarser")
        other_values, solid_angle = (coarse.diffuse_down, coarse.diffuse_up, coarse.actinic), (np.pi, np.pi, 4 * np.pi)
        level = level_error(z, problem.level_peaks)
        errors += [
            stated_error(value, rough, problem.tolerance) + level * np.abs(value) + angle * solution.unseen
            for value, rough, angle in zip(values[1:], other_values, solid_angle, strict=True)
        ]
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
