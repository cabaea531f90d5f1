"""A third judge for light behind deep dust: plain forward walks, split at planes of the depth.

Nothing is shared with the solvers: particles fly from the star with exponential free paths, are turned by Henyey and
Greenstein's law, and are sent off towards the observer at every collision.  At planes one optical depth apart those
that cross for the first time are drawn anew to a fixed number, by their weight (Kahn & Harris 1951, Natl. Bur. Stand.
Appl. Math. Ser. 12, 27): so there are as many in the depths as at the top.  Unbiased; the error is the spread of
repetitions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class DustBox(NamedTuple):
    """A box of dust below a star that shines with 1 W sr-1, on the axis of the box and above its top."""

    half_width: float  #: in x and y
    top: float  #: z
    bottom: float  #: z
    star: float  #: z
    extinction: float
    albedo: float
    g: float


class Walkers(NamedTuple):
    """Particles: places, directions (n, 3) and weights (n,) [W]."""

    place: Array
    direction: Array
    weight: Array

    def of(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Walkers:
        return Walkers(self.place[chosen], self.direction[chosen], self.weight[chosen])


def light_below(box: DustBox, count: int, repetitions: int, seed: int) -> tuple[float, float]:
    """Scattered light [W sr-1] that leaves straight downwards, and its standard error."""
    random = np.random.default_rng(seed)
    runs = [_run(box, count, random) for _ in range(repetitions)]
    return float(np.mean(runs)), float(np.std(runs, ddof=1) / np.sqrt(repetitions))


def _run(box: DustBox, count: int, random: np.random.Generator) -> float:
    stages = max(int(np.ceil(box.extinction * (box.top - box.bottom))), 1)
    planes = np.linspace(box.top, box.bottom, stages + 1)[1:]
    walkers, light = _from_star(box, count, random), 0.0
    for n, plane in enumerate(planes):
        walkers, gained = _stage(box, walkers, plane, n == stages - 1, random)
        light += gained
        if not len(walkers.weight):
            break
        total = np.cumsum(walkers.weight)
        chosen = np.searchsorted(total, total[-1] * (np.arange(count) + random.random()) / count)
        walkers = walkers.of(np.minimum(chosen, len(total) - 1))._replace(weight=np.full(count, total[-1] / count))
    return light


def _from_star(box: DustBox, count: int, random: np.random.Generator) -> Walkers:
    """Particles that enter through the top, at places drawn uniformly."""
    across = random.uniform(-box.half_width, box.half_width, (count, 2))
    way = np.column_stack([across, np.full(count, box.top - box.star)])
    distance = np.linalg.norm(way, axis=1)
    solid_angle = (box.star - box.top) / distance**3 * (2 * box.half_width) ** 2
    place = np.column_stack([across, np.full(count, box.top)])
    return Walkers(place, way / distance[:, None], solid_angle / count)


def _stage(
    box: DustBox, walkers: Walkers, plane: float, last: bool, random: np.random.Generator
) -> tuple[Walkers, float]:
    """Follow particles until they first reach a plane below or are gone; those that do, and the light [W sr-1]."""
    arrived, light, usual = [], 0.0, float(walkers.weight.mean())
    while len(walkers.weight):
        place, direction, weight = walkers
        t = random.exponential(1 / box.extinction, len(weight))
        with np.errstate(divide="ignore"):
            down = np.where(direction[:, 2] < 0, (plane - place[:, 2]) / direction[:, 2], np.inf)
        crosses = down <= t
        place = place + np.minimum(t, down)[:, None] * direction
        inside = (np.abs(place[:, :2]) <= box.half_width).all(axis=1) & (place[:, 2] <= box.top)
        walkers = Walkers(place, direction, weight)
        if not last:
            arrived.append(walkers.of(crosses & inside))
        place, direction, weight = walkers.of(inside & ~crosses)
        weight = weight * box.albedo
        out = np.exp(-box.extinction * (place[:, 2] - box.bottom))
        light += float(np.sum(weight * _phase(box.g, -direction[:, 2]) * out))
        # Roulette of what absorption has left little of.
        faint = weight < 0.1 * usual
        survives = ~faint | (random.random(len(weight)) < 0.25)
        weight = np.where(faint, 4 * weight, weight)
        walkers = Walkers(place, direction, weight).of(survives)
        walkers = walkers._replace(direction=_turned(walkers.direction, box.g, random))
    if not arrived:
        return walkers, light
    return Walkers(*(np.concatenate(parts) for parts in zip(*arrived, strict=True))), light


def _phase(g: float, cosine: Array) -> Array:
    return np.asarray((1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5))


def _turned(direction: Array, g: float, random: np.random.Generator) -> Array:
    """New directions by Henyey & Greenstein's law."""
    u, phi = random.random(len(direction)), 2 * np.pi * random.random(len(direction))
    cosine = 2 * u - 1 if abs(g) < 1e-3 else (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    # Any two vectors across.
    helper = np.where(np.abs(direction[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(direction, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1), 1e-300)[:, None]
    second = np.cross(direction, first)
    new = cosine[:, None] * direction + sine[:, None] * (np.cos(phi)[:, None] * first + np.sin(phi)[:, None] * second)
    return np.asarray(new / np.maximum(np.linalg.norm(new, axis=1), 1e-300)[:, None])
