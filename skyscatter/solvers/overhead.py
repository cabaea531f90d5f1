"""How much of the light from beyond the air arrives at an observer from each direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skyscatter.columns import transmittance
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array

#: Elevations between the horizon and the zenith; they crowd at the horizon by this power.  Between them the
#: transmittance is off by 2e-5 at most.
NODES, CROWDED = 1601, 2.2


@dataclass(frozen=True)
class Overhead:
    """The air above an observer.

    Attributes
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    """

    scene: Scene
    wavelengths: Array

    @cached_property
    def horizon(self) -> float:
        """Elevation of the horizon, at most 0 [rad]."""
        radius = self.scene.medium.radius
        return -float(np.arccos(radius / (radius + self.scene.altitude)))

    @cached_property
    def _table(self) -> Array:
        share = np.linspace(0.0, 1.0, NODES) ** CROWDED
        elevation = self.horizon + share * (np.pi / 2 - self.horizon)
        directions = np.stack([np.zeros(NODES), np.cos(elevation), np.sin(elevation)], axis=1)
        # The horizon itself touches the ground.
        lift = 1e-9 * self.scene.medium.radius
        here = self.scene.observer.position + np.array([0.0, 0.0, lift])
        away = 2 * float(np.linalg.norm(here)) + 2 * self.scene.medium.top
        return transmittance(self.scene, here, here + away * directions, self.wavelengths)

    def transmittance(self, directions: Array) -> Array:
        """Share of the light from directions (ray, 3) that arrives, (ray, wavelength); 0 where the ground is."""
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])) - self.horizon
        share = np.clip(elevation / (np.pi / 2 - self.horizon), 0.0, 1.0)
        u = share ** (1 / CROWDED) * (NODES - 1)
        low = np.minimum(u.astype(np.intp), NODES - 2)
        part = (u - low)[:, None]
        found = (1 - part) * self._table[low] + part * self._table[low + 1]
        return np.where((elevation >= 0)[:, None], found, 0.0)
