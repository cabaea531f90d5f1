"""Where the texels of precomputed atmospheric scattering lie, and how a shader looks them up.

Light that is scattered towards an observer depends on four numbers: r, his distance from the planet's centre, mu and
mu_s, cosines of the zenith angles of the line of sight and of the Sun, and nu, the cosine of the angle between these.
The mappings between them and textures are those of Bruneton & Neyret (2008), Comput. Graph. Forum 27, 1079, as revised
in Bruneton's implementation of 2017; sizes are those that three-atmosphere has.  Lengths in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

R_SIZE, MU_SIZE, MU_S_SIZE, NU_SIZE = 32, 128, 32, 8
TRANSMITTANCE_SIZE = (64, 256)  #: (r, mu)
IRRADIANCE_SIZE = (16, 64)  #: (r, mu_s)
#: Cosines nu of the texels.
NU = np.linspace(-1.0, 1.0, NU_SIZE)


def rayleigh(nu: ArrayLike) -> Array:
    """Rayleigh's phase function [sr-1]."""
    return np.asarray(3 / (16 * np.pi) * (1 + np.square(nu)))


def cornette_shanks(g: float, nu: ArrayLike) -> Array:
    """Phase function of Cornette & Shanks (1992), Appl. Opt. 31, 3152 [sr-1]."""
    x = np.asarray(nu, float)
    scale = 3 / (8 * np.pi) * (1 - g * g) / (2 + g * g)
    return np.asarray(scale * (1 + x * x) / (1 + g * g - 2 * g * x) ** 1.5)


def between_nodes(x: ArrayLike, size: int) -> tuple[NDArray[np.int64], Array]:
    """Lower of the two texels around a share x, 0 to 1, of a texture, and the weight of the upper one."""
    place = np.clip(np.asarray(x, float), 0.0, 1.0) * (size - 1)
    low = np.minimum(place.astype(np.int64), size - 2)
    return low, place - low


def lookup(texture: Array, shares: tuple[Array, ...]) -> Array:
    """Linear between the texels of a texture (..., channel) at shares, one array (n,) an axis; (n, channel)."""
    out = np.zeros((shares[0].size, texture.shape[-1]))
    cells = [between_nodes(x, size) for x, size in zip(shares, texture.shape, strict=False)]
    for corner in np.ndindex(*(2,) * len(cells)):
        index = tuple(low + up for (low, _), up in zip(cells, corner, strict=True))
        weights = [part if up else 1 - part for (_, part), up in zip(cells, corner, strict=True)]
        out += np.prod(weights, axis=0)[:, None] * texture[index]
    return out


@dataclass(frozen=True)
class Layout:
    """The mappings for one planet.

    Attributes
    ----------
    bottom, top : float
        Radii of the ground and of the top of the atmosphere [m].
    mu_s_min : float
        Cosine of the zenith angle of the lowest Sun.
    """

    bottom: float
    top: float
    mu_s_min: float

    @property
    def level(self) -> float:
        """Distance from the ground to the top along a level ray [m]."""
        return float(np.sqrt(self.top**2 - self.bottom**2))

    def horizon(self, r: ArrayLike) -> Array:
        """Distance to the horizon [m]."""
        return np.sqrt(np.maximum(np.square(r) - self.bottom**2, 0.0))

    def to_top(self, r: ArrayLike, mu: ArrayLike) -> Array:
        """Distance to the top along rays that do not end on the ground [m]."""
        r, mu = np.asarray(r), np.asarray(mu)
        return np.asarray(np.sqrt(np.maximum((r * mu) ** 2 - r**2 + self.top**2, 0.0)) - r * mu)

    def radii(self, size: int = R_SIZE) -> Array:
        """Radii of the rows of the transmittance and of the slices of scattering [m]: even in distance to horizon."""
        return np.sqrt((self.level * np.linspace(0, 1, size)) ** 2 + self.bottom**2)

    def share_of_radius(self, r: ArrayLike) -> Array:
        """Inverse of `radii`, 0 to 1."""
        return self.horizon(r) / self.level

    def transmittance_mu(self, r: float, size: int = TRANSMITTANCE_SIZE[1]) -> Array:
        """Zenith cosines of a row of the transmittance: even in distance to the top, to the horizon."""
        return self._mu_of_distance(r, np.linspace(0, 1, size))

    def share_of_distance(self, r: Array, mu: Array) -> Array:
        """Inverse of `transmittance_mu`, 0 to 1."""
        shortest = self.top - r
        return (self.to_top(r, mu) - shortest) / (self.horizon(r) + self.level - shortest)

    def _mu_of_distance(self, r: float, share: Array) -> Array:
        shortest, rho = self.top - r, float(self.horizon(r))
        d = shortest + share * (rho + self.level - shortest)
        safe = np.where(d > 0, d, 1.0)
        return np.clip(np.where(d > 0, (self.top**2 - r**2 - d**2) / (2 * r * safe), 1.0), -1.0, 1.0)

    def scattering_mu(self, r: float) -> Array:
        """Zenith cosines of the rows of scattering at a radius: those of the ground upwards, then those of the sky."""
        share = np.linspace(1, 0, MU_SIZE // 2)
        shortest, rho = r - self.bottom, float(self.horizon(r))
        d = shortest + share * (rho - shortest)
        safe = np.where(d > 0, d, 1.0)
        ground = np.where(d > 0, -(rho**2 + d**2) / (2 * r * safe), -1.0)
        return np.concatenate([np.clip(ground, -1.0, 1.0), self._mu_of_distance(r, share[::-1])])

    def share_of_scattering_mu(self, r: Array, mu: Array, ground: NDArray[np.bool_]) -> Array:
        """Inverse of `scattering_mu` in units of the texture, with its rows' halves apart for rays that end on ground.

        Number of the row, from 0, divided by the number of rows less one.
        """
        rho = self.horizon(r)
        d = -r * mu - np.sqrt(np.maximum((r * mu) ** 2 - rho**2, 0.0))
        shortest = r - self.bottom
        down = np.where(rho > shortest, (d - shortest) / np.where(rho > shortest, rho - shortest, 1.0), 0.0)
        up = self.share_of_distance(r, mu)
        half = MU_SIZE // 2 - 1
        row = np.where(ground, half * (1 - np.clip(down, 0, 1)), half + 1 + half * np.clip(up, 0, 1))
        return np.asarray(row / (MU_SIZE - 1))

    def _near(self, mu_s: ArrayLike) -> Array:
        """How far it is from the ground to the top towards the Sun, 0 overhead and 1 for a level one."""
        shortest = self.top - self.bottom
        return (self.to_top(self.bottom, mu_s) - shortest) / (self.level - shortest)

    def sun_cosines(self, share: Array) -> Array:
        """Zenith cosines of the Sun at shares of the columns of scattering: 0 the lowest Sun, 1 one overhead."""
        x, deepest = np.asarray(share, float), float(self._near(self.mu_s_min))
        a = deepest * (1 - x) / (1 + x * deepest)
        shortest = self.top - self.bottom
        d = shortest + np.minimum(a, deepest) * (self.level - shortest)
        return np.clip((self.level**2 - d**2) / (2 * self.bottom * d), -1.0, 1.0)

    def share_of_sun(self, mu_s: ArrayLike) -> Array:
        """Inverse of `sun_cosines`, 0 to 1."""
        a = self._near(mu_s)
        return np.asarray(np.maximum(1 - a / float(self._near(self.mu_s_min)), 0.0) / (1 + a))

    def hits_ground(self, r: Array, mu: Array) -> NDArray[np.bool_]:
        """Whether rays end on the ground."""
        return np.asarray((mu < 0) & ((r * mu) ** 2 - r**2 + self.bottom**2 >= 0))

    def scattering_at(self, texture: Array, r: Array, mu: Array, mu_s: Array, nu: Array) -> Array:
        """What a shader finds in a scattering texture (r, mu, mu_s, nu, channel); (n, channel)."""
        row = self.share_of_scattering_mu(r, mu, self.hits_ground(r, mu))
        return lookup(texture, (self.share_of_radius(r), row, self.share_of_sun(mu_s), (nu + 1) / 2))
