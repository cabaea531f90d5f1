"""The plainest walks through a room in fog, written for arrays of numpy: a judge that shares no code with the solvers.

No light is looked for: a walk goes on, from the eye backwards, through grey fog (free flights, albedo as a weight, the
phase function of Henyey and Greenstein) and from diffuse wall to diffuse wall until it has gone dark, and counts the
lamp's radiance where it happens to meet the lamp.  Lamps have to be large for that; nothing can be wrong but its few
lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from radiosity import Piece

Array = NDArray[np.float64]

#: Weight below which walks end by chance, and the chance with which they go on.
DARK, SURVIVAL = 0.05, 0.25


@dataclass(frozen=True)
class Fog:
    """Grey fog: extinction [m-1], albedo, mean cosine."""

    extinction: float
    albedo: float
    g: float


def walk(
    pieces: tuple[Piece, ...], fog: Fog, origins: Array, directions: Array, wavelength: int, walks: int, seed: int
) -> tuple[Array, Array]:
    """Radiance [W m-2 sr-1 nm-1] along rays (ray, 3) from inside a room, at one of its wavelengths, and its error.

    `walks` start along each ray; the errors come from their spread.
    """
    rng = np.random.default_rng(seed)
    rays = len(origins)
    ray = np.repeat(np.arange(rays), walks)
    x, d = origins[ray].copy(), directions[ray].copy()
    weight, number = np.ones(len(ray)), np.arange(len(ray))
    light = np.zeros(len(ray))
    while number.size:
        t, piece = _ahead(pieces, x, d)
        flight = rng.exponential(size=number.size) / max(fog.extinction, 1e-300)
        scattered = flight < t
        x += np.where(scattered, flight, t)[:, None] * d
        weight = weight.copy()
        new = np.empty_like(d)
        weight[scattered] *= fog.albedo
        new[scattered] = _turn(d[scattered], _henyey_greenstein(fog.g, rng.random(scattered.sum())), rng)
        for n, wall in enumerate(pieces):
            here = ~scattered & (piece == n)
            light[number[here]] += weight[here] * wall.exitance[wavelength] / np.pi
            weight[here] *= wall.albedo[wavelength]
            normal = np.zeros((here.sum(), 3))
            normal[:, wall.axis] = wall.facing
            new[here] = _turn(normal, np.sqrt(rng.random(here.sum())), rng)
            x[here, wall.axis] = wall.at
        d = new
        dim = weight < DARK
        survives = ~dim | (rng.random(number.size) < SURVIVAL)
        weight = np.where(dim, weight / SURVIVAL, weight)
        survives &= weight > 0
        x, d, weight, number = x[survives], d[survives], weight[survives], number[survives]
    each = light.reshape(rays, walks)
    return each.mean(axis=1), each.std(axis=1, ddof=1) / np.sqrt(walks)


def _ahead(pieces: tuple[Piece, ...], x: Array, d: Array) -> tuple[Array, NDArray[np.int64]]:
    """Distance to the wall ahead and the number of its piece."""
    best, number = np.full(len(x), np.inf), np.full(len(x), -1)
    for n, piece in enumerate(pieces):
        u, v = (k for k in range(3) if k != piece.axis)
        ahead = d[:, piece.axis] * piece.facing < 0
        t = np.where(ahead, (piece.at - x[:, piece.axis]) / np.where(ahead, d[:, piece.axis], 1.0), np.inf)
        t = np.maximum(t, 0.0)
        far = np.where(ahead, t, 0.0)
        a, b = x[:, u] + far * d[:, u], x[:, v] + far * d[:, v]
        # Rounding must let no walk out at the edges: the pieces overlap by next to nothing.
        inside = (a >= piece.low[0] - 1e-9) & (a <= piece.high[0] + 1e-9)
        inside &= (b >= piece.low[1] - 1e-9) & (b <= piece.high[1] + 1e-9)
        nearer = ahead & inside & (t < best)
        best[nearer], number[nearer] = t[nearer], n
    if np.any(number < 0):
        raise ValueError("a walk has left the room")
    return best, number


def _henyey_greenstein(g: float, u: Array) -> Array:
    """Cosines of scattering angles."""
    if abs(g) < 1e-6:
        return 2.0 * u - 1.0
    inner = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
    return np.asarray((1.0 + g * g - inner * inner) / (2.0 * g))


def _turn(axis: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Directions at angles from axes (n, 3), their azimuths by chance."""
    other = np.zeros_like(axis)
    other[np.arange(len(axis)), np.abs(axis).argmin(axis=1)] = 1.0
    first = np.cross(axis, other)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(axis, first)
    phi = 2.0 * np.pi * rng.random(len(axis))
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    turned = cosine[:, None] * axis + (sine * np.cos(phi))[:, None] * first + (sine * np.sin(phi))[:, None] * second
    return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])
