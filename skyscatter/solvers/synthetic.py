"""What a sweep of the grid still misses deep inside a thick medium, from the diffusion of light up and down.

A sweep carries light about one free path far, and in a thick medium the sum over the orders grows for hundreds of them.
But what is missing there diffuses.  A sweep makes L' of a light L; of the light that is right L' misses what scattering
makes of L' - L, and all that follows.  In the diffusion approximation that has the scalar irradiance phi (moment 0)
and the net upward irradiance F of

    dF/dz + sigma_a phi = sigma_s r_0,    (1/3) dphi/dz + sigma_tr F = g sigma_s r_1,

r_0 and r_1 being what the sweep changed of both, and sigma_tr = sigma_t - g sigma_s.  No light comes from above, and
from below what the ground of albedo A sends back (Marshak's condition),

    F = phi / 2 at the top,    F = -phi (1 - A) / (2 (1 + A)) at the ground.

Every Sun has its own column: in a thick medium light does not come from afar.  This is diffusion synthetic
acceleration (Alcouffe 1977, Nucl. Sci. Eng. 64, 344; Adams & Larsen 2002, Prog. Nucl. Energy 40, 3); without the first
moment a peaked phase function would leave a share g of what is missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.moments import I_KIND
from skyscatter.solvers.sweeps import Problem
from skyscatter.solvers.transfer import Light

Array = NDArray[np.float64]

#: Optical depth between two nodes below which they are as good as one.
THINNEST = 1e-9
#: What is left of a mean radiance or a flux at least: light is not negative.
LEAST = 0.3


class Diffusion:
    """The diffusion of light in the columns of a problem, cell by cell between its nodes."""

    def __init__(self, problem: Problem) -> None:
        light, altitudes, columns = problem.diffuse, problem.grid.altitudes, problem.table.columns
        middles = 0.5 * (altitudes[1:] + altitudes[:-1])
        at_nodes = outward_profile(columns, altitudes)  # (node, component)
        edges = np.concatenate([at_nodes[:1], outward_profile(columns, middles), at_nodes[-1:]])
        between, around = at_nodes[:-1] - at_nodes[1:], edges[:-1] - edges[1:]
        scattering, forward = 4 * np.pi * light.greek[0, :, 0], 4 * np.pi / 3 * light.greek[0, :, 1]
        #: Optical depths of scattering around a node, (node, wavelength); what conducts between two, and what drives
        #: light from one to the other there, (node - 1, wavelength).
        self.scattering = np.maximum(around @ scattering, 0.0)
        self.conducts = 1.0 / np.maximum(3 * between @ (light.sigma_t - forward), THINNEST)
        self.drives = 3 * between @ forward * self.conducts
        self.answers = self._answers(np.maximum(around @ (light.sigma_t - scattering), 0.0), light.light[2])
        table = problem.moments
        up_and_down = (table.degree == 1) & (table.order == 0) & (table.kind == I_KIND)
        self.current = int(np.argmax(up_and_down)) if up_and_down.any() else None

    def _answers(self, absorbs: Array, albedo: Array) -> Array:
        """Scalar irradiance at nodes for a unit of light that is made at each, (wavelength, node, node)."""
        nodes, wavelengths = absorbs.shape
        system, low, high = np.zeros((wavelengths, nodes, nodes)), np.arange(nodes - 1), np.arange(1, nodes)
        system[:, np.arange(nodes), np.arange(nodes)] = absorbs.T
        for one, other in ((low, high), (high, low)):
            system[:, one, one] += self.conducts.T
            system[:, one, other] -= self.conducts.T
        system[:, -1, -1] += 0.5
        system[:, 0, 0] += 0.5 * (1 - albedo) / (1 + albedo)
        return np.asarray(np.linalg.inv(system))

    def begun(self, first: Light) -> Light:
        """The first order with all others as they diffuse."""
        return self.corrected(Light(np.zeros_like(first.moments), np.zeros_like(first.flux)), first)

    def corrected(self, light: Light, swept: Light) -> Light:
        """What a sweep made of a light, with what it still misses."""
        mean, net = _scalar(swept) - _scalar(light), _net(swept) - _net(light)
        driven = self.drives[:, None] * 0.5 * (net[1:] + net[:-1])
        made = self.scattering[:, None] * mean
        made[:-1] -= driven
        made[1:] += driven
        scalar = np.einsum("wij,jsw->isw", self.answers, made)
        between = driven - self.conducts[:, None] * np.diff(scalar, axis=0)
        current = np.concatenate([between[:1], 0.5 * (between[1:] + between[:-1]), between[-1:]])
        return self._added(swept, scalar, current)

    def _added(self, light: Light, scalar: Array, current: Array) -> Light:
        """A light with more scalar and net upward irradiance, (node, sun, wavelength), and nothing else changed."""
        moments = light.moments.copy()
        moments[:, :, 0] = np.maximum(moments[:, :, 0] + scalar, LEAST * moments[:, :, 0])
        if self.current is not None:  # moments are of where light comes from
            moments[:, :, self.current] = light.moments[:, :, self.current] - current
        more = np.stack([scalar / 4 + current / 2, scalar / 4 - current / 2], axis=1)
        return Light(moments, np.maximum(light.flux + more, LEAST * light.flux))


def _scalar(light: Light) -> Array:
    """Scalar irradiance (node, sun, wavelength)."""
    return light.moments[:, :, 0]


def _net(light: Light) -> Array:
    """Net upward irradiance (node, sun, wavelength)."""
    return light.flux[:, 0] - light.flux[:, 1]
