"""What an observer sees of a lamp on the ground, per unit of its power, at the nodes over the sky."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from skyscatter.kernels.towns.first import first_rays, make_first_scratch
from skyscatter.kernels.towns.walks import make_walk_scratch, walk_rays
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.compile import compile_ground, compile_scene
from skyscatter.solvers.townfit import smoothed
from skyscatter.solvers.townsky import (
    ABOVE,
    AZIMUTHS,
    BELOW,
    CROWDED,
    CROWDED_AZIMUTH,
    WALKED_ABOVE,
    WALKED_AZIMUTHS,
    WALKED_BELOW,
    WALKED_CROWDED,
    WALKED_CROWDED_AZIMUTH,
    azimuths,
    elevations,
    joined,
    rays_at,
)
from skyscatter.workers import in_parts

#: Largest difference of the rules of the quadrature, see `first_rays`.
TOLERANCE = 1e-3
#: Rays that a thread does at once.
TOGETHER, WALKED_TOGETHER = 64, 4
MOST_ORDERS = 100_000


@dataclass(frozen=True)
class Lamplight:
    """What an observer sees per unit of a lamp's power, K of (1).

    Attributes
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
    lobe : ndarray, shape (2, node)
        Cosines of the zenith angle, rising, and radiant intensities over the power [sr-1].
    seed : int
    max_order : int
        Highest order of scattering.
    """

    scene: Scene
    wavelengths: Array
    lobe: Array
    seed: int = 0
    max_order: int = MOST_ORDERS
    _tables: dict[float, Array] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def horizon(self) -> float:
        """Elevation of the horizon, at most 0 [rad]."""
        radius = self.scene.medium.radius
        return -float(np.arccos(radius / (radius + self.scene.altitude)))

    def _places(self, distance: float, rays: int) -> tuple[Array, Array]:
        """The lamp in the north and the observer, once for each ray."""
        radius = self.scene.medium.radius
        lamp = radius * np.array([0.0, np.sin(distance / radius), np.cos(distance / radius)])
        return tuple(np.tile(place, (rays, 1)) for place in (lamp, self.scene.observer.position))  # type: ignore[return-value]

    def once(self, distance: float, directions: Array) -> Array:
        """Light that is scattered once, of a lamp so far in the north [m]; (ray, wavelength) [m-2 sr-1]."""
        table = compile_scene(self.scene, self.wavelengths)
        lamps, origins = self._places(distance, len(directions))
        found = np.empty((len(directions), self.wavelengths.size))

        def work(part: slice) -> None:
            first_rays(
                table, self.lobe, lamps[part], origins[part], directions[part], TOLERANCE,
                make_first_scratch(table), found[part],
            )  # fmt: skip

        in_parts(work, len(directions), TOGETHER)
        return found

    def often(self, distance: float, directions: Array, samples: int) -> tuple[Array, Array]:
        """Light that is scattered or reflected more than once, and its standard error."""
        table, land = compile_scene(self.scene, self.wavelengths), compile_ground(self.scene.ground, self.wavelengths)
        lamps, origins = self._places(distance, len(directions))
        mean, error = np.zeros((2, len(directions), self.wavelengths.size))
        numbers = np.arange(len(directions)) + (np.int64(distance) << 20)

        def work(part: slice) -> None:
            walk_rays(
                table, land, self.lobe, lamps[part], origins[part], directions[part], numbers[part],
                np.int64(self.seed), np.int64(samples), np.int64(self.max_order),
                make_walk_scratch(*table.optics.sigma_s.shape), mean[part], error[part],
            )  # fmt: skip

        if self.max_order > 1:
            in_parts(work, len(directions), WALKED_TOGETHER)
        return mean, error

    def table(self, distance: float) -> Array:
        """Light that is scattered once at the nodes, (elevation, azimuth, wavelength)."""
        if distance not in self._tables:
            azimuth = azimuths(AZIMUTHS, CROWDED_AZIMUTH)
            rays = rays_at(elevations(self.horizon, BELOW, ABOVE, CROWDED), azimuth)
            self._tables[distance] = self.once(distance, rays).reshape(BELOW + ABOVE, AZIMUTHS, -1)
        return self._tables[distance]

    def walked(self, distance: float, samples: int) -> tuple[Array, Array, float]:
        """Logarithm of all other light, its relative standard error at the same nodes, and that of the walks alone."""
        sides = [self._side(distance, samples, below) for below in (True, False)]
        logarithm, relative = (np.concatenate(parts) for parts in zip(*(side[:2] for side in sides), strict=True))
        floor = np.log(1e-9) + logarithm.max(axis=(0, 1))  # from black ground nothing comes
        return joined(np.maximum(logarithm, floor), smooth=True), joined(relative, smooth=False), sides[1][2]

    def _side(self, distance: float, samples: int, below: bool) -> tuple[Array, Array, float]:
        """The same at the nodes of walks below the horizon, or above it."""
        azimuth = azimuths(WALKED_AZIMUTHS, WALKED_CROWDED_AZIMUTH)
        elevation = elevations(self.horizon, WALKED_BELOW, WALKED_ABOVE, WALKED_CROWDED)
        elevation = elevation[:WALKED_BELOW] if below else elevation[WALKED_BELOW:]
        shape = (elevation.size, azimuth.size, self.wavelengths.size)
        # Whoever stands on the ground has it at the feet, alike in all directions.
        at_feet = below and self.scene.altitude == 0
        rays = -np.eye(3)[2:] if at_feet else rays_at(elevation, azimuth)
        mean, error = self.often(distance, rays, 4 * samples if at_feet else samples)
        noise = float(np.median(np.divide(error, mean, out=np.zeros_like(mean), where=mean > 0)))
        if at_feet or not np.all(mean.max(axis=0) > 0):
            level = np.maximum(mean.mean(axis=0), 1e-290)
            spread = np.sqrt((error**2).mean(axis=0)) / level
            return np.broadcast_to(np.log(level), shape), np.broadcast_to(spread, shape), noise
        return *smoothed(mean.reshape(shape), error.reshape(shape)), noise
