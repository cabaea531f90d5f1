"""The sky of an observer in an eclipse of the Sun, at nodes: light scattered once, and walks for the rest.

What the Moon's shadow leaves of the light is no longer symmetric about the Sun's azimuth, nor the same all over a
height; but it is smooth over an observer's sky.  Light scattered once is joined from nodes as sunlight on each sort of
particles, whose phase functions are then exact.  Of light scattered more often walks are made at nodes, many at each,
and a smooth function of the direction is fitted to them: cubics over the elevation, a few Fourier terms over the
azimuth.  Its error is that of the walks, carried through the fit, and what the fit misses beyond their noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skyscatter.solvers import path
from skyscatter.solvers.base import Array, Asked, Rays, Tables
from skyscatter.solvers.eclipse import light_axis
from skyscatter.solvers.options import Path
from skyscatter.solvers.response import TURNS, Glow, ViewNodes
from skyscatter.solvers.single import single_parts
from skyscatter.solvers.skyfit import NODES, Side, fit
from skyscatter.solvers.skytable import angle_cells
from skyscatter.workers import Workers

#: Azimuths at which light scattered once is found.
ONCE_TURNS = 60
#: Rays of a picture that are compared with light scattered once without nodes, and what may be missed by it.
COMPARED, MISSED = 64, 0.01
#: Rays that a thread does at once.
TOGETHER = 64
#: Walks of a node, at first and at most.
FIRST_WALKS, MOST_WALKS = 512, 1 << 17


class Look(NamedTuple):
    """Light along rays, (ray, wavelength) each [W m-2 sr-1 nm-1]."""

    scattered: Array
    ground: Array
    multiple: Array
    error: Array


@dataclass(frozen=True)
class Once:
    """Light scattered or reflected once, at nodes.

    Attributes
    ----------
    lit : tuple of Glow
        For each component that scatters, without its phase function.
    ground : Glow
    phase : ndarray, shape (component, angle, wavelength)
    sun : ndarray, shape (3,)
    missed : ndarray, shape (wavelength,)
        Relative root mean square of what is missed between nodes.
    """

    lit: tuple[Glow, ...]
    ground: Glow
    phase: Array
    sun: Array
    missed: Array

    def at(self, directions: Array) -> tuple[Array, Array]:
        """Scattered, and reflected by the ground; (ray, wavelength) each."""
        cell, share = angle_cells(directions @ self.sun, self.phase.shape[1] - 1)
        scattered = np.zeros((len(directions), self.phase.shape[2]))
        for lit, phase in zip(self.lit, self.phase, strict=True):
            chance = share[:, :1] * phase[cell[:, 0]] + share[:, 1:] * phase[cell[:, 1]]
            scattered += np.maximum(lit.at(directions), 0.0) * chance
        return scattered, np.maximum(self.ground.at(directions), 0.0)


@dataclass(frozen=True)
class EclipsedSky:
    """The sky of one observer.

    Attributes
    ----------
    once : Once or None
        None where it has to be found ray by ray.
    multiple, error : Glow
        Light of higher orders and its error.
    """

    once: Once | None
    multiple: Glow
    error: Glow

    def look(self, directions: Array, first: tuple[Array, Array] | None = None) -> Look:
        """Light along rays (ray, 3); `first` is light scattered and reflected once, where that is known."""
        if first is None:
            assert self.once is not None
            scattered, ground = self.once.at(directions)
            missed = self.once.missed * (scattered + ground)
        else:
            (scattered, ground), missed = first, np.zeros(1)
        multiple = np.maximum(self.multiple.at(directions), 0.0)
        return Look(scattered, ground, multiple, np.hypot(self.error.at(directions), missed))


def sky_of(
    tables: Tables,
    position: Array,
    directions: Array,
    asked: Asked[Path],
    threads: int,
    tick: Callable[[float], None],
) -> EclipsedSky:
    """Solve the sky of an observer at nodes.

    Parameters
    ----------
    tables : Tables
        Without emission and background.
    position : ndarray, shape (3,)
        Of the observer, on the z axis [m].
    directions : ndarray, shape (ray, 3)
        That are asked for: some of them are compared, and whether any looks below the horizon counts.
    asked : Asked
        Of the walks.
    threads : int
    tick : callable
        Called with the finished share.
    """
    horizon = -float(np.arccos(min(tables.scene.columns.radius / float(position[2]), 1.0)))
    nodes = ViewNodes(horizon)
    with Workers(threads) as pool:
        once = _once(tables, nodes, position, directions, pool)
        low = float(directions[:, 2].min(initial=1.0)) < np.sin(horizon)
        sides = [Side(horizon, 1), *([Side(horizon, -1)] if low else [])]
        rays = np.concatenate([side.rays for side in sides])
        mean, error = _walked(tables, position, rays, asked, pool, tick)
    shape = (len(nodes.fine), TURNS, mean.shape[1])
    values, errors = np.zeros(shape), np.zeros(shape)
    fine = _fine_rays(nodes)
    start = 0
    for side in sides:
        some = slice(start, start + len(side.rays))
        start = some.stop
        rows = side.of(nodes.fine)
        fitted, relative = fit(side, mean[some], error[some], fine[rows].reshape(-1, 3))
        values[rows] = np.maximum(fitted, 0.0).reshape(-1, *shape[1:])
        errors[rows] = values[rows] * relative.reshape(-1, *shape[1:])
    return EclipsedSky(once, Glow(nodes, values), Glow(nodes, errors))


def _walked(
    tables: Tables,
    position: Array,
    directions: Array,
    asked: Asked[Path],
    pool: Workers,
    tick: Callable[[float], None],
) -> tuple[Array, Array]:
    """Light of higher orders at nodes and its standard error; (node, wavelength) each.

    Each ring has as many walks as it needs for the noise that is asked for, twice as many from time to time; so the
    noise of all its nodes decides, and what one node happened to find says little.
    """
    noise = asked.how.noise or 1.0
    rays = _rays(position, directions)
    rings = [rays.part(slice(k, k + NODES)) for k in range(0, len(directions), NODES)]

    def ring(some: Rays) -> tuple[Array, Array]:
        samples, kept = FIRST_WALKS, None
        while True:
            now = Asked(Path(samples=samples, seed=asked.how.seed, max_order=asked.how.max_order), parts=True)
            kept = kept or path.no_walks(tables, NODES, now)
            answer = path.solve(tables, some, now, kept)
            lit = answer.radiance - answer.layers["direct"]
            reached = np.mean(answer.error / np.maximum(lit, 1e-300)) if lit.any() else 0.0
            if reached <= noise or samples >= MOST_WALKS:
                return answer.layers["multiple"], answer.error
            samples *= 2

    answers = []
    for k, done in enumerate([pool.submit(ring, some) for some in rings]):
        answers.append(done.result())
        tick((k + 1) / len(rings))
    mean, error = (np.concatenate(values) for values in zip(*answers, strict=True))
    return mean, error


def _once(tables: Tables, nodes: ViewNodes, position: Array, directions: Array, pool: Workers) -> Once | None:
    """Light scattered once at nodes; None where it misses too much between them, or there is a map on the ground."""
    if tables.ground.cells.size > 0:
        return None
    optics = tables.scene.optics
    kept = [c for c in range(len(optics.sigma_s)) if optics.sigma_s[c].any()]
    rays = _node_rays(nodes)
    shape = (rays.shape[0], rays.shape[1], -1)
    lit, ground = [], np.zeros(0)
    for c in kept:
        even = np.zeros_like(optics.phase)
        even[c] = 1.0
        some = tables._replace(scene=tables.scene._replace(optics=optics._replace(phase=even)))
        light, ground = single_along(some, position, rays.reshape(-1, 3), pool)
        lit.append(_refined(nodes, light.reshape(shape)))
    once = Once(
        tuple(lit), _refined(nodes, ground.reshape(shape)), optics.phase[kept], light_axis(optics),
        np.zeros(optics.sigma_s.shape[1]),
    )  # fmt: skip
    tested = directions[np.linspace(0, len(directions) - 1, min(COMPARED, len(directions))).astype(int)]
    exact = sum(single_along(tables, position, tested, pool))
    joined = sum(once.at(tested))
    scale = np.maximum(exact, 1e-3 * np.max(exact, axis=0))
    missed = np.sqrt(np.mean(((joined - exact) / np.maximum(scale, 1e-300)) ** 2, axis=0))
    if np.max(missed) > MISSED:
        return None
    return Once(once.lit, once.ground, once.phase, once.sun, missed)


def single_along(tables: Tables, position: Array, directions: Array, pool: Workers) -> tuple[Array, Array]:
    """Light scattered and reflected once along rays from one place, (ray, wavelength) each."""
    rays = _rays(position, directions)
    parts = [slice(k, min(k + TOGETHER, len(directions))) for k in range(0, len(directions), TOGETHER)]
    found = [
        pool.submit(single_parts, tables.scene, tables.ground, rays.part(part), path.DEFAULT_TOLERANCE)
        for part in parts
    ]
    answers = [done.result() for done in found]
    return np.concatenate([answer[0] for answer in answers]), np.concatenate([answer[1] for answer in answers])


def _rays(position: Array, directions: Array) -> Rays:
    origins = np.broadcast_to(position, directions.shape)
    return Rays(origins, directions, np.arange(len(directions), dtype=np.int64))


def _node_rays(nodes: ViewNodes) -> Array:
    return _grid_rays(nodes.coarse, ONCE_TURNS)


def _fine_rays(nodes: ViewNodes) -> Array:
    return _grid_rays(nodes.fine, TURNS)


def _grid_rays(elevation: Array, turns: int) -> Array:
    """Directions (elevation, turn, 3), turns from north through east."""
    e, a = np.meshgrid(elevation, 2 * np.pi * np.arange(turns) / turns, indexing="ij")
    return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1)


def _refined(nodes: ViewNodes, values: Array) -> Glow:
    """Values at the nodes (elevation, turn, wavelength) on the finer grid: Fourier over the azimuth, then splines."""
    turned = np.fft.irfft(np.fft.rfft(values, axis=1), n=TURNS, axis=1) * (TURNS / ONCE_TURNS)
    return Glow(nodes, nodes.refined(turned))
