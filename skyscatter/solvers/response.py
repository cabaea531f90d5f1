"""What the air makes of light from any part of the sky: one solved field serves every light beyond the atmosphere.

The solution of `skyscatter.solvers.field` is linear in the light that comes in, and holds for every elevation of a
distant light.  So the diffuse radiance D in a direction (e, a) under a sky that shines with L(e', a') from outside is

    D(e, a) = ∫∫ R(e, e', a - a') L(e', a') cos e' de' da'                                          (1)

where R is the diffuse radiance of a distant light per unit of its irradiance.  Over the azimuth this is a convolution,
a product of Fourier coefficients; over the elevation it is summed by Gauss-Legendre quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skyscatter.solvers.base import Array
from skyscatter.solvers.estimate import error_share
from skyscatter.solvers.field import RadianceField
from skyscatter.solvers.sweeps import Solution, diffuse_light, view
from skyscatter.workers import in_parts, steady_algebra

#: Elevations at which one looks, above the horizon and below it; they crowd at the horizon by this power.
ABOVE, BELOW, CROWDED = 28, 12, 2.2
#: Nodes of azimuth over 180 degrees at which a light is looked at; they stand at squares, close to each other at it.
AZIMUTHS = 33
#: Highest Fourier order over the azimuth, and azimuths at which answers are kept.
MODES, TURNS = 36, 180
#: High Fourier orders fade as exp(-FADE (order / MODES)^FADING), so that what is brighter around a point of light than
#: they can follow is blurred by some 5 degrees and does not ring across the sky.  The fifth order loses 3e-4.
FADE, FADING = 36.0, 6
#: Elevations between which lights are summed [degree], beside the lowest, and Gauss points of each piece.
PIECES = ((-3.0, 4), (3.0, 6), (15.0, 8), (45.0, 12), (90.0, 12))
#: Lights so far below the observer's horizon reach no air that matters [degree].
DEEPEST = 12.0
#: Elevations of lights that a thread does at once.
TOGETHER = 2
#: Finer steps between nodes of elevation, for what is joined linearly.
FINER = 6


@dataclass(frozen=True)
class Glow:
    """Radiance over elevation and azimuth in an observer's sky, smooth but for the horizon.

    Attributes
    ----------
    nodes : ViewNodes
    values : ndarray, shape (elevation, azimuth, wavelength)
        [W m-2 sr-1 nm-1]
    """

    nodes: ViewNodes
    values: Array

    def at(self, directions: Array) -> Array:
        """Radiance in directions (ray, 3) of the observer's frame; (ray, wavelength)."""
        from scipy.sparse import csr_array

        count, turns, wavelengths = self.values.shape
        row, high = self.nodes.place(directions)
        turn = np.arctan2(directions[:, 0], directions[:, 1]) / (2 * np.pi) * turns % turns
        left = turn.astype(np.int64) % turns
        part = turn - np.floor(turn)
        weights = np.stack([(1 - high) * (1 - part), (1 - high) * part, high * (1 - part), high * part], axis=1)
        cells = np.stack([row, row, row + 1, row + 1], axis=1) * turns
        cells += np.stack([left, (left + 1) % turns] * 2, axis=1)
        start = np.arange(0, 4 * len(directions) + 1, 4)
        table = csr_array((weights.ravel(), cells.ravel(), start), shape=(len(directions), count * turns))
        return np.asarray(table @ self.values.reshape(count * turns, wavelengths))


@dataclass(frozen=True)
class ViewNodes:
    """Elevations at which one looks, on both sides of the horizon.

    Attributes
    ----------
    horizon : float
        Elevation of the horizon, at most 0 [rad].
    """

    horizon: float

    @cached_property
    def coarse(self) -> Array:
        """Elevations at which light is computed, falling from the horizon, then rising from it [rad]."""
        return np.concatenate([self._side(BELOW, -1), self._side(ABOVE, 1)])

    @cached_property
    def fine(self) -> Array:
        """Elevations at which it is kept [rad]."""
        return np.concatenate([self._side(FINER * (BELOW - 1) + 1, -1), self._side(FINER * (ABOVE - 1) + 1, 1)])

    def _side(self, count: int, sign: int) -> Array:
        share = np.linspace(0, 1, count) ** CROWDED
        # Just beside the horizon, so that it is clear whether a ray ends on the ground.
        return self.horizon + sign * np.maximum(share * (np.pi / 2 - sign * self.horizon), 1e-7)

    def refined(self, values: Array) -> Array:
        """Values at `coarse` (elevation, ...) at `fine`, by splines on either side of the horizon."""
        from scipy.interpolate import CubicSpline

        sides = []
        for part, count in ((values[:BELOW], BELOW), (values[BELOW:], ABOVE)):
            at = np.linspace(0, 1, FINER * (count - 1) + 1)
            sides.append(CubicSpline(np.linspace(0, 1, count), part, axis=0)(at))
        return np.concatenate(sides)

    def place(self, directions: Array) -> tuple[Any, Array]:
        """Number of the finer node beneath each direction, and the share of the next one."""
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])) - self.horizon
        below, above = FINER * (BELOW - 1), FINER * (ABOVE - 1)
        up = elevation >= 0
        size = np.where(up, above, below)
        width = np.where(up, np.pi / 2 - self.horizon, np.pi / 2 + self.horizon)
        u = np.minimum((np.abs(elevation) / width) ** (1 / CROWDED), 1.0) * size
        cell = np.minimum(u.astype(np.int64), size - 1)
        return cell + np.where(up, below + 1, 0), u - cell


def source_rule(lowest: float) -> tuple[Array, Array]:
    """Elevations of lights [rad] from `lowest` [degree] on, and weights for an integral over solid angle."""
    edges = [lowest] + [e for e, _ in PIECES if e > lowest]
    counts = [n for e, n in PIECES if e > lowest]
    places, weights = [], []
    for low, high, count in zip(edges[:-1], edges[1:], counts, strict=True):
        x, w = np.polynomial.legendre.leggauss(count)
        half = np.radians(high - low) / 2
        places.append(np.radians((low + high) / 2) + half * x)
        weights.append(half * w)
    elevation = np.concatenate(places)
    return elevation, np.concatenate(weights) * np.cos(elevation)


@dataclass(frozen=True)
class Response:
    """The diffuse radiance that an observer sees under lights in every direction, from a solved field.

    Attributes
    ----------
    field : RadianceField
        It covers the zenith angles from 0 to 90 degrees - `lowest`.
    altitude : float
        Of the observer [m].

    Notes
    -----
    Lights count as infinitely far.  Airglow is not; but what it lights lies far below it.
    """

    field: RadianceField
    altitude: float

    @property
    def lowest(self) -> float:
        """Elevation below which lights are left out [degree]."""
        return lowest_light(self.field.scene.medium.radius, self.altitude)

    @cached_property
    def nodes(self) -> ViewNodes:
        """Where the observer looks."""
        radius = self.field.scene.medium.radius
        return ViewNodes(-float(np.arccos(radius / (radius + self.altitude))))

    @cached_property
    def sources(self) -> tuple[Array, Array]:
        """Elevations of lights and their weights, see `source_rule`."""
        return source_rule(self.lowest)

    @cached_property
    def modes(self) -> Array:
        """Fourier coefficients of R [sr-1], shape (light, view, order, wavelength)."""
        return self._modes(self.field.fine)

    @cached_property
    def error(self) -> Array:
        """Estimated relative error of the diffuse light of an even sky, shape (wavelength,)."""
        fine, coarse = (self._even(m) for m in (self.modes, self._modes(self.field.coarse)))
        return np.asarray(
            error_share(self.field.tolerance)
            * np.abs(fine - coarse).mean(axis=0)
            / np.maximum(fine.mean(axis=0), 1e-300)
        )

    def _even(self, modes: Array) -> Array:
        return 2 * np.pi * np.einsum("s,svw->vw", self.sources[1], modes[:, :, 0])

    @steady_algebra()
    def _modes(self, solution: Solution) -> Array:
        elevations = self.sources[0]
        azimuth = np.pi * (np.arange(AZIMUTHS) / (AZIMUTHS - 1)) ** 2
        directions = self._rays(azimuth)
        origin = np.array([0.0, 0.0, self.field.scene.medium.radius + self.altitude])
        origins = np.broadcast_to(origin, directions.shape).copy()
        transform = _cosine_transform(azimuth)
        found = np.empty((elevations.size, ABOVE + BELOW, MODES + 1, self.field.wavelengths.size))

        def work(part: slice) -> None:
            for s in range(part.start, part.stop):
                table = self.field.at(self.field.sun(float(np.degrees(elevations[s])), 0.0))
                light = diffuse_light(*view(solution.problem, solution.loaded, table, origins, directions))[:, 0]
                light /= table.optics.sun_irradiance.sum(axis=0)
                found[s] = transform @ light.reshape(ABOVE + BELOW, AZIMUTHS, -1)

        in_parts(work, elevations.size, TOGETHER)
        return found

    def _rays(self, azimuth: Array) -> Array:
        e, a = np.meshgrid(self.nodes.coarse, azimuth, indexing="ij")
        return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1).reshape(-1, 3)

    @steady_algebra()
    def glow(self, sky: Callable[[Array], Array] | None, points: tuple[Array, Array] | None = None) -> Glow:
        """Diffuse radiance under a sky that shines, and under points of light.

        Parameters
        ----------
        sky : callable, optional
            Unit vectors of the observer's frame (..., 3) -> radiance from outside (..., wavelength)
            [W m-2 sr-1 nm-1].
        points : (ndarray (point, 3), ndarray (point, wavelength)), optional
            Directions, and irradiances on planes that face them, outside the air [W m-2 nm-1].
        """
        power = np.zeros((self.sources[0].size, MODES + 1, self.field.wavelengths.size), complex)
        if sky is not None:
            power += self._spread(sky)
        if points is not None:
            power += self._pointed(*points)
        # (1), order by order; the answer is real, and orders above 0 count for their conjugates too.
        orders = np.einsum("svmw,smw->vmw", self.modes, power)
        orders *= np.exp(-FADE * (np.arange(MODES + 1) / MODES) ** FADING)[:, None]
        values = self.nodes.refined(np.fft.irfft(orders, n=TURNS, axis=1) * TURNS)
        return Glow(self.nodes, np.maximum(values, 0.0))

    def _spread(self, sky: Callable[[Array], Array]) -> Array:
        """Fourier coefficients over the azimuth of an even sky's irradiance, (light, order, wavelength)."""
        elevation, weight = self.sources
        turn = 2 * np.pi * np.arange(TURNS) / TURNS
        e, a = np.meshgrid(elevation, turn, indexing="ij")
        light = sky(np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1))
        coefficients = np.fft.rfft(light, axis=1)[:, : MODES + 1] / TURNS
        return np.asarray(2 * np.pi * weight[:, None, None] * coefficients)

    def _pointed(self, directions: Array, irradiance: Array) -> Array:
        """The same for points, each shared by the two elevations beside it."""
        elevation, _ = self.sources
        own = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1]))
        kept = own >= np.radians(self.lowest)
        own, d, light = own[kept], directions[kept], irradiance[kept]
        upper = np.clip(np.searchsorted(elevation, own), 1, elevation.size - 1)
        share = np.clip((own - elevation[upper - 1]) / (elevation[upper] - elevation[upper - 1]), 0.0, 1.0)
        turn = np.exp(-1j * np.arctan2(d[:, 0], d[:, 1])[:, None] * np.arange(MODES + 1))
        found = np.zeros((elevation.size, MODES + 1, irradiance.shape[1]), complex)
        for s in range(elevation.size):
            amount = np.where(upper == s, share, 0.0) + np.where(upper == s + 1, 1 - share, 0.0)
            near = amount > 0
            found[s] = (turn[near] * amount[near, None]).T @ light[near]
        return found


def lowest_light(radius: float, altitude: float) -> float:
    """Elevation [degree] of the lowest lights that an observer's sky needs."""
    dip = float(np.degrees(np.arccos(radius / (radius + altitude))))
    return max(-2 * dip - DEEPEST, -90.0)


def _cosine_transform(azimuth: Array) -> Array:
    """From values at azimuths in 0 to pi of an even function to its Fourier coefficients; (order, azimuth)."""
    from scipy.interpolate import CubicSpline

    steps = 720
    even = np.pi * (np.arange(steps) + 0.5) / steps
    spline = CubicSpline(azimuth, np.eye(azimuth.size), bc_type="clamped")(even)
    return np.asarray(np.cos(np.arange(MODES + 1)[:, None] * even) @ spline / steps)
