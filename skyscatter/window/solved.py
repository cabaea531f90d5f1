"""Light of a solved sky at nodes of the Sun's elevation and of directions, as XYZ.

As in `skyscatter.solvers.skytable`, light scattered once is the sunlight that a component sends on, which is smooth,
times its phase function, which is not.  A phase function that changes with the wavelength is split among bands, between
which it goes evenly: what it is at a band's middle times the light of that band.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.scene import Sun
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.field import solve_once
from skyscatter.solvers.orders import window_of
from skyscatter.solvers.skytable import angle_cells, lost_peaks
from skyscatter.solvers.sweeps import Solution, view
from skyscatter.window.colours import ENDS, EVERY, Colours, colours_of
from skyscatter.workers import Workers, steady_algebra

if TYPE_CHECKING:
    from skyscatter.kernels.optics import SceneTable
    from skyscatter.scene import Scene
    from skyscatter.solvers.grid import Grid

Array = NDArray[np.float64]
Progress = Callable[[float], None]

#: Elevations of the Sun that a table is made for [degree].
SUNS = (-14.0, 90.0)
#: What a phase function may miss between the middles of bands, as a share, and how many bands it has at most.
BAND_MISSED, MOST_BANDS = 0.004, 5
#: Light is held to this share of the smooth light of its place; what is fainter counts as so much.
FAINTEST = 2.0**-24
#: Angles from the Sun in which a table has its phase functions, and elevations in which it has the Sun's disk.
ANGLES, DISK_PLACES, DISK_CROWDED = 513, 96, 2.0
#: Powers by which nodes crowd at the horizon and towards the Sun.
CROWDED, BENT = 2.2, 1.5
#: Scale of nodes just below the horizon [rad].
NEAREST = (math.radians(0.02), math.radians(1.0))
#: Rings of the disk, over the squared distance from its middle.
RINGS = 65


@dataclass(frozen=True)
class Fineness:
    """How fine a table is.

    Attributes
    ----------
    tolerance : float
        Of the solution.
    degree : int, optional
        To which it keeps phase functions; one that suits the tolerance when not given.
    wavelengths : int
    suns : tuple of float
        Elevations of the Sun [degree], rising.
    below, above : int
        Nodes of elevation on either side of the horizon, which crowd there.
    turns : int
        Nodes of azimuth from the Sun over 180 degrees.
    """

    tolerance: float
    wavelengths: int
    suns: tuple[float, ...]
    below: int
    above: int
    turns: int
    degree: int | None = None

    def elevations(self, horizon: float) -> Array:
        """Nodes of elevation, rising; the first `below` of them below the horizon [rad]."""
        hair = 1e-7  # so that it is clear on which side of the horizon a node lies
        up = horizon + (math.pi / 2 - horizon) * np.linspace(0, 1, self.above) ** CROWDED
        # Ground comes nearer as one over its depth below the horizon: what lies before it goes by ratios of that.
        near = min(max(-horizon, NEAREST[0]), NEAREST[1])
        steps = math.asinh((math.pi / 2 + horizon) / near) * np.linspace(0, 1, self.below) ** 1.4
        down = horizon - near * np.sinh(steps)
        up[0], down[0] = horizon + hair, horizon - hair
        return np.concatenate([down[::-1], up])

    def azimuths(self) -> Array:
        """Nodes of azimuth from the Sun, rising [rad]."""
        return np.asarray(math.pi * np.linspace(0, 1, self.turns) ** BENT)


class Disk(NamedTuple):
    """The Sun as it is seen through the air."""

    elevation: Array  #: (place,) rising, from the horizon up [rad]
    light: Array  #: (place, 3) mean radiance of the disk as XYZ [cd m-2]
    rings: Array  #: (ring, 3) radiance over the squared distance from the middle, 0 to 1, in units of the mean
    radius: float  #: [rad]


class Lights(NamedTuple):
    """A sky's light at nodes; a term is what a band of a component scatters once, for an even phase function of 1."""

    terms: Array  #: (sun, term, 3, elevation, turn) XYZ [cd m-2 sr]
    smooth: Array  #: (sun, 3, elevation, turn) XYZ of all other light [cd m-2]
    phase: Array  #: (term, angle) phase function [sr-1]
    near: Array  #: (term, elevation, angle) what is lost of it close to the Sun, for the first angles [sr-1]
    disk: Disk

    def logarithms(self) -> Array:
        """Binary logarithms of terms and, last, the smooth light, (sun, block, 3, elevation, turn)."""
        luminance = self.smooth[:, None, 1:2]
        floor = FAINTEST * np.maximum(luminance, 1e-6 * luminance.max(axis=(3, 4), keepdims=True))
        return np.log2(np.maximum(np.concatenate([self.terms, self.smooth[:, None]], axis=1), np.maximum(floor, 1e-30)))


class Solved(NamedTuple):
    """The light of a sky, and what it was solved with."""

    lights: Lights
    colours: Colours
    grid: Grid


def horizon_of(scene: Scene) -> float:
    """Elevation of the horizon [rad]."""
    observer = scene.observer
    return -math.acos(observer.planet_radius / (observer.planet_radius + observer.altitude))


def zenith_of(scene: Scene, wavelengths: Array) -> tuple[float, float]:
    """Zenith angles of the Sun [rad] for which a table's field is solved."""
    table = compile_scene(scene, wavelengths)
    levels = np.degrees(horizon_of(scene)) + np.array([-1.0, 0.01, 2.0, 10.0, 90.0])
    rays = direction_from_azimuth_elevation(np.linspace(0, 180, 13), np.minimum(levels, 90.0)[:, None]).reshape(-1, 3)
    lowest = scene.model_copy(update={"sun": Sun(elevation_deg=SUNS[0], azimuth_deg=0.0)})
    origins = np.tile(scene.observer.position, (len(rays), 1))
    return 0.0, min(window_of(lowest, table, origins, rays)[1], math.pi)


@steady_algebra()
def solve_lights(
    scene: Scene, fineness: Fineness, threads: int, progress: Progress | None = None, like: Solved | None = None
) -> Solved:
    """Solve a scene and look at it from its observer; with `like` by the colours and on the grid of that solution."""
    colours = colours_of(scene, fineness.wavelengths) if like is None else like.colours
    share = None if progress is None else (lambda done: progress(0.7 * done))
    zenith = zenith_of(scene, colours.wavelengths)
    grid = None if like is None else like.grid
    solution = solve_once(
        scene, colours.wavelengths, zenith, fineness.tolerance, False, None, threads, share,
        degree=fineness.degree, grid=grid,
    )  # fmt: skip
    lights = seen_lights(scene, solution, colours, fineness, threads, progress)
    return Solved(lights, colours, solution.problem.grid)


def seen_lights(
    scene: Scene, solution: Solution, colours: Colours, fineness: Fineness, threads: int, progress: Progress | None
) -> Lights:
    """The light of a solution at all nodes."""
    observer, horizon = scene.observer, horizon_of(scene)
    elevation, turn = fineness.elevations(horizon), fineness.azimuths()
    kept = np.flatnonzero(solution.problem.diffuse.scatters)
    table = compile_scene(scene, colours.wavelengths)
    lost = lost_peaks(solution, _straight(table, observer.altitude, elevation, fineness.below), kept)
    per_density = table.optics.sigma_s[kept]
    phase = [solution.problem.whole[0, c] / per_density[k] for k, c in enumerate(kept)]
    bands = [_bands(scene, int(c), colours.wavelengths) for c in kept]
    number = sum(len(band) for band in bands)
    terms = np.empty((len(fineness.suns), number, 3, elevation.size, turn.size))
    smooth = np.empty((len(fineness.suns), 3, elevation.size, turn.size))
    directions = direction_from_azimuth_elevation(np.degrees(turn), np.degrees(elevation)[:, None]).reshape(-1, 3)
    looked = _Looked(scene, solution, colours, directions, lost, kept, bands, per_density)

    def work(k: int) -> None:
        light, rest = looked.at(fineness.suns[k])
        terms[k] = np.moveaxis(light.reshape(number, elevation.size, turn.size, 3), -1, 1)
        smooth[k] = np.moveaxis(rest.reshape(elevation.size, turn.size, 3), -1, 0)

    _ = solution.loaded  # not in threads
    with Workers(threads) as pool:
        for k, done in enumerate([pool.submit(work, k) for k in range(len(fineness.suns))]):
            done.result()
            if progress is not None:
                progress(0.7 + 0.3 * (k + 1) / len(fineness.suns))
    split, near = _phases(phase, lost / per_density[:, None, None], bands)
    return Lights(terms, smooth, split, near, _disk(scene, colours, horizon))


@dataclass(frozen=True)
class _Looked:
    """What the observer sees along rays (ray, 3) under any Sun at azimuth 0."""

    scene: Scene
    solution: Solution
    colours: Colours
    directions: Array
    lost: Array
    kept: NDArray[np.int64]
    bands: list[Array]
    per_density: Array  #: scattering (kept component, wavelength) [m-1]

    def at(self, sun_elevation_deg: float) -> tuple[Array, Array]:
        """Terms (term, ray, 3) and smooth light (ray, 3)."""
        problem = self.solution.problem
        sun = Sun(elevation_deg=sun_elevation_deg, azimuth_deg=0.0)
        table = compile_scene(self.scene.model_copy(update={"sun": sun}), self.colours.wavelengths)
        rays, count = len(self.directions), self.colours.wavelengths.size
        origins = np.tile(self.scene.observer.position, (rays, 1))
        lit = np.empty((rays, len(table.optics.sigma_s), count), np.float32)
        scattered, multiple, ground, _ = view(
            problem, self.solution.loaded, table, origins, np.ascontiguousarray(self.directions), lit
        )
        rest = scattered[:, 0].copy()
        last = problem.whole.shape[2] - 1
        cell, share = angle_cells(self.directions @ sun.direction, last)
        elevation = np.repeat(np.arange(self.lost.shape[1]), rays // self.lost.shape[1])
        for k, c in enumerate(self.kept):
            rest -= lit[:, c] * _chance(problem.whole[0, c], self.lost[k], elevation, cell, share)
        smooth = (np.maximum(multiple[:, 0], 0.0) + ground + rest) @ self.colours.weights
        terms = [
            (lit[:, c] * self.per_density[k] * hat) @ self.colours.weights
            for k, (c, hats) in enumerate(zip(self.kept, self.bands, strict=True))
            for hat in hats
        ]
        return np.stack(terms), smooth


def _straight(table: SceneTable, altitude: float, elevation: Array, below: int) -> Array:
    """Columns along rays above the horizon, (node, component, 1): those of light that runs straight on.

    What chains of scatterings under some other Sun lose beside them is joined with the rest.
    """
    up = [slant_columns(table.columns, altitude, float(np.sin(e))) for e in elevation[below:]]
    none = np.zeros(table.optics.sigma_s.shape[0])
    return np.array([none] * below + [none if c is None else c for c in up])[:, :, None]


def _chance(phase: Array, lost: Array, elevation: NDArray[np.int64], cell: NDArray[np.int64], share: Array) -> Array:
    """Phase function (angle, wavelength) along rays, without what is lost of it; (ray, wavelength)."""
    found = share[:, :1] * phase[cell[:, 0]] + share[:, 1:] * phase[cell[:, 1]]
    near = np.flatnonzero(cell[:, 1] < lost.shape[1])
    for j in range(2):
        found[near] -= share[near, j, None] * lost[elevation[near], cell[near, j]]
    return np.asarray(found)


def _bands(scene: Scene, component: int, wavelengths: Array) -> Array:
    """Hats (band, wavelength) that add up to 1, as few as a component's phase function needs.

    Their number depends on the scene alone, so that the terms of tables of any fineness are the same.
    """
    every = EVERY[np.clip(EVERY, *ENDS) == EVERY]
    phase = compile_scene(scene, every).optics.phase[component]
    for count in range(1, MOST_BANDS + 1):
        hats = _hats(every, count)
        missed = _split(phase, hats) @ hats - phase
        if np.abs(missed / phase.mean(axis=1, keepdims=True)).max() < BAND_MISSED:
            break
    return _hats(wavelengths, count)


def _hats(wavelengths: Array, count: int) -> Array:
    middles = np.linspace(*ENDS, count)
    return np.stack([np.interp(wavelengths, middles, row) for row in np.eye(count)])


def _split(phase: Array, hats: Array) -> Array:
    """Phase functions (..., wavelength) at the middles of bands, (..., band)."""
    return np.asarray(phase @ np.linalg.pinv(hats))


def _phases(phase: list[Array], lost: Array, bands: list[Array]) -> tuple[Array, Array]:
    """Phase functions of terms (term, angle), and what they lose close to the Sun (term, elevation, angle)."""
    step = (len(phase[0]) - 1) // (ANGLES - 1)
    split = [_split(whole, hats).T[:, ::step] for whole, hats in zip(phase, bands, strict=True)]
    near = [np.moveaxis(_split(part[:, ::step], hats), -1, 0) for part, hats in zip(lost, bands, strict=True)]
    return np.concatenate(split), np.concatenate(near)


def _disk(scene: Scene, colours: Colours, horizon: float) -> Disk:
    """The Sun's disk over its elevation."""
    table = compile_scene(scene, colours.wavelengths)
    optics, columns = table.optics, table.columns
    elevation = horizon + (math.pi / 2 - horizon) * np.linspace(0, 1, DISK_PLACES) ** DISK_CROWDED
    elevation[0] = horizon + 1e-7
    along = [slant_columns(columns, scene.altitude, math.sin(float(place))) for place in elevation]
    depth = np.array([column for column in along if column is not None]) @ optics.sigma_t
    radiance = optics.disk_radiance[:: (len(optics.disk_radiance) - 1) // (RINGS - 1)]
    rings = radiance @ colours.weights
    mean = (0.5 * (rings[1:] + rings[:-1])).mean(axis=0)  # rings are of equal area
    light = (np.exp(-depth) * optics.sun_irradiance.sum(axis=0)) @ colours.weights
    solid = math.pi * math.sin(optics.disk_radius) ** 2 if optics.disk_radius > 0 else 1.0
    return Disk(elevation, light / solid, rings / mean, float(optics.disk_radius))
