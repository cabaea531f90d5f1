"""Plain judges of the glow of towns: photons from the lamp in numpy, and an integral by scipy.

They share no line with the package: the air has exponential densities, haze scatters by Henyey & Greenstein, gas by
Rayleigh without depolarisation's small change, and the lamp is a point on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlainAir:
    """Gas and haze about a sphere, at one wavelength; lengths in metres."""

    gas: float  #: scattering coefficient at the ground [m-1]
    haze: float  #: extinction coefficient at the ground [m-1]
    gas_height: float = 8e3
    haze_height: float = 1.5e3
    haze_albedo: float = 0.95
    g: float = 0.68
    albedo: float = 0.2
    radius: float = 6371e3
    top: float = 80e3
    haze_top: float = 15e3

    def densities(self, h: Array) -> tuple[Array, Array]:
        """Extinction of gas and haze at heights [m-1]."""
        inside = (h >= 0) & (h < self.top)
        gas = np.where(inside, self.gas * np.exp(-h / self.gas_height), 0.0)
        return gas, np.where(inside & (h < self.haze_top), self.haze * np.exp(-h / self.haze_height), 0.0)

    def through(self, h: Array) -> Array:
        """Transmittance of the vertical way from the ground to heights."""
        gas = self.gas * self.gas_height * -np.expm1(-h / self.gas_height)
        haze = self.haze * self.haze_height * -np.expm1(-np.minimum(h, self.haze_top) / self.haze_height)
        return np.asarray(np.exp(-gas - haze))

    def phase(self, cosine: Array) -> tuple[Array, Array]:
        """Phase functions of gas and haze [sr-1]."""
        rayleigh = 3 / (16 * np.pi) * (1 + cosine**2)
        return rayleigh, (1 - self.g**2) / (4 * np.pi * (1 + self.g**2 - 2 * self.g * cosine) ** 1.5)


def turned(directions: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Directions turned by angles, about themselves by chance."""
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(directions, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(directions, side)
    angle, sine = rng.uniform(0, 2 * np.pi, len(cosine)), np.sqrt(np.maximum(1 - cosine**2, 0.0))
    found = cosine[:, None] * directions
    found += sine[:, None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def zenith_by_photons(
    air: PlainAir, lobe: tuple[Array, Array], distance: float, photons: int, seed: int, orders: int = 40
) -> tuple[Array, Array]:
    """Radiance at the zenith over the lamp's power [m-2 sr-1], and its standard error.

    Of light that is scattered once, and of all light: shape (2,) each.  Photons fly from the lamp by delta tracking.
    What each collision in a ring about the lamp, 5 % of the distance to either side, sends straight down is counted.
    Within the ring the light changes by 25 %, but its mean is that of the middle to 0.2 % where it falls as the power
    -2.5 of the distance.
    """
    rng = np.random.default_rng(seed)
    near, far = 0.95 * distance / air.radius, 1.05 * distance / air.radius
    batches = np.array([_batch(air, lobe, near, far, photons // 20, rng, orders) for _ in range(20)])
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(20)


def _batch(
    air: PlainAir, lobe: tuple[Array, Array], near: float, far: float, count: int, rng: np.random.Generator, orders: int
) -> Array:
    mu = np.linspace(0, 1, 20001)
    cdf = np.cumsum(np.interp(mu, *lobe))
    cosine = np.interp(rng.uniform(size=count), cdf / cdf[-1], mu)
    position = np.tile([0.0, 0.0, air.radius + 1e-3], (count, 1))
    direction = turned(np.tile([0.0, 0.0, 1.0], (count, 1)), cosine, rng)
    weight, order = np.ones(count), np.zeros(count, int)
    most = air.gas + air.haze
    found = np.zeros(2)
    while len(weight):
        position = position + direction * (-np.log(rng.uniform(1e-300, 1, len(weight))) / most)[:, None]
        height = np.linalg.norm(position, axis=1) - air.radius
        below = height < 0
        _reflect(air, position, direction, weight, order, below, rng)
        height = np.maximum(np.linalg.norm(position, axis=1) - air.radius, 0.0)
        gas, haze = air.densities(height)
        hit = ~below & (rng.uniform(size=len(weight)) * most < gas + haze)  # the ground ends a flight
        found += _scored(air, position, direction, weight, order, height, hit, near, far) / count
        scattering = gas + air.haze_albedo * haze
        weight = np.where(hit, weight * scattering / np.maximum(gas + haze, 1e-300), weight)
        _scatter(air, direction, hit, gas / np.maximum(scattering, 1e-300), rng)
        order = order + hit
        alive = (height < air.top) & (order < orders) & (weight > 0)
        faint = alive & (weight < 0.05)
        kept = rng.uniform(size=len(weight)) < weight / 0.05
        weight = np.where(faint, 0.05, weight)
        alive &= ~faint | kept
        position, direction, weight, order = position[alive], direction[alive], weight[alive], order[alive]
    return found


def _reflect(
    air: PlainAir, position: Array, direction: Array, weight: Array, order: Array, below: Array,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Put photons that flew into the ground back on it, with a new direction by the cosine; in place."""
    x, d = position[below], direction[below]
    along = np.sum(x * d, axis=1)
    back = along + np.sqrt(np.maximum(along**2 - np.sum(x * x, axis=1) + air.radius**2, 0.0))
    x = x - back[:, None] * d
    x *= ((air.radius + 1e-3) / np.linalg.norm(x, axis=1))[:, None]
    position[below] = x
    normal = x / np.linalg.norm(x, axis=1, keepdims=True)
    direction[below] = turned(normal, np.sqrt(rng.uniform(size=len(x))), rng)
    weight[below] *= air.albedo
    order[below] += 1


def _scored(
    air: PlainAir, position: Array, direction: Array, weight: Array, order: Array, height: Array, hit: Array,
    near: float, far: float,
) -> Array:  # fmt: skip
    """What collisions in the ring send straight down, over its area on the ground."""
    angle = np.arctan2(np.hypot(position[:, 0], position[:, 1]), position[:, 2])
    seen = hit & (angle > near) & (angle < far)
    x, d, h = position[seen], direction[seen], height[seen]
    gas, haze = air.densities(h)
    p_gas, p_haze = air.phase(-np.sum(x * d, axis=1) / np.linalg.norm(x, axis=1))
    sent = (gas * p_gas + air.haze_albedo * haze * p_haze) / np.maximum(gas + haze, 1e-300)
    # A column of air over a piece of ground widens with the height.
    area = 2 * np.pi * air.radius**2 * (np.cos(near) - np.cos(far)) * ((air.radius + h) / air.radius) ** 2
    light = weight[seen] * sent * air.through(h) / area
    return np.array([light[order[seen] == 0].sum(), light.sum()])


def _scatter(air: PlainAir, direction: Array, hit: Array, by_gas: Array, rng: np.random.Generator) -> None:
    """New directions after collisions, in place."""
    count = int(hit.sum())
    u = rng.uniform(size=count)
    q = 4 * u - 2  # Rayleigh's law: cos^3 + 3 cos = 2 (4 u - 2)
    root = np.cbrt(q + np.sqrt(q * q + 1))
    rayleigh = root - 1 / root
    term = (1 - air.g**2) / (1 - air.g + 2 * air.g * u)
    haze = (1 + air.g**2 - term**2) / (2 * air.g)
    cosine = np.where(rng.uniform(size=count) < by_gas[hit], rayleigh, haze)
    direction[hit] = turned(direction[hit], np.clip(cosine, -1.0, 1.0), rng)


def thin_layer(sigma: float, height: float, radius: float, distance: float, elevation: float, azimuth: float) -> float:
    """Light of a lamp of power 1 that shines evenly up, scattered once and evenly by a uniform layer [m-2 sr-1].

    I = 1 / (2 pi), J(t) = sigma / (4 pi) I exp(-sigma (t + D)) / D^2: within the layer every way is straight and of one
    density, and above it there is nothing.
    """
    lamp = radius * np.array([0.0, np.sin(distance / radius), np.cos(distance / radius)])
    ray = np.array([
        np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)
    ])  # fmt: skip
    end = -radius * ray[2] + np.sqrt((radius * ray[2]) ** 2 + height * (2 * radius + height))

    def source(t: float) -> float:
        away = np.array([0.0, 0.0, radius]) + t * ray - lamp
        if away @ lamp <= 0:
            return 0.0
        square = float(away @ away)
        return float(np.exp(-sigma * (t + np.sqrt(square))) / square)

    nearest = float((lamp - [0.0, 0.0, radius]) @ ray)
    places = sorted(p for p in {0.5 * nearest, nearest, 1.5 * nearest} if 0 < p < end)
    return sigma / (8 * np.pi**2) * quad(source, 0.0, end, points=places, limit=400, epsabs=0, epsrel=1e-9)[0]
