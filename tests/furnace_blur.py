"""What spheres and disks of photons blur in a furnace of white fog, by quadrature: a judge without any photon.

In a closed cube of grey walls that shine with what they keep all light is 1.  Rays to lamps find the light that comes
straight from walls; of the rest, 1 less that, photons tell the mean over a sphere or a disk.  What they do wrong is
thus the mean over sphere or disk of  (1 - albedo) exp(-extinction s)  against its value at the point, with the distance
s of the wall in every direction.  Nothing else is approximate: a furnace by photons is 1 plus this.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import qmc
from surface_bases import pack
from walk_scenes import room

from skyscatter.kernels.surfaces.clearance import empty_balls, make_ball_scratch

Array = Any
#: Half side of the cube [m].
HALF = 1.0
#: What the solver says of itself (docs/theory/photons.md): spheres in free paths at most, and disks in corners.
OF_FREE_PATH, OF_DISK = 0.5, 0.4
#: Points on a ray, and draws at each: 288 rays know the blur to 1e-4 (halved and doubled).
DEPTH, DRAWS = 12, 256


def wall_distance(x: Array, d: Array) -> Array:
    """Distance (...) from x (..., 3) along d (..., 3) to the walls of the cube; 0 from outside."""
    with np.errstate(divide="ignore"):
        way = (np.copysign(HALF, d) - x) / d
    return np.maximum(np.where(d == 0, np.inf, way).min(axis=-1), 0.0)


def across(d: Array) -> tuple[Array, Array]:
    """Two unit vectors across d (..., 3) and each other."""
    side = np.where(np.abs(d[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(d, side)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(d, first)


def on_disk(a: Array, b: Array, square: Array, turn: Array) -> Array:
    """Places on a unit disk that a and b (..., 3) span, by two even numbers of [0, 1)."""
    angle, out = 2 * np.pi * turn, np.sqrt(square)
    return (out * np.cos(angle))[..., None] * a + (out * np.sin(angle))[..., None] * b


def media_blur(extinction: float, radius: float, origins: Array, d: Array) -> Array:
    """Mean over all sides of exp(-extinction s) in spheres less that at their points, along rays (ray, 3); (ray,)."""
    u = np.random.default_rng(5).random((len(d), DEPTH, 1, 5)) + qmc.Sobol(5, seed=1).random(DRAWS)
    u %= 1.0
    lost = -np.expm1(-extinction * wall_distance(origins, d))
    t = -np.log1p(-lost[:, None] * (np.arange(DEPTH) + 0.5) / DEPTH) / extinction
    x = origins[:, None] + t[..., None] * d[:, None]
    flat, centre, reach = x.reshape(-1, 3), np.zeros((t.size, 3)), np.zeros(t.size)
    table = pack(*(body.shape for body in room(HALF, 0.0)))
    empty_balls(table, flat, min(radius, OF_FREE_PATH / extinction), make_ball_scratch(), centre, reach)
    centre, reach = centre.reshape(*x.shape[:2], 1, 3), reach.reshape(*x.shape[:2], 1)
    z = 2 * u[..., 0] - 1
    w = np.stack([*(np.sqrt(1 - z * z) * f(2 * np.pi * u[..., 1]) for f in (np.cos, np.sin)), z], axis=-1)
    a, b = across(w)
    disk = centre + reach[..., None] * on_disk(a, b, u[..., 2], u[..., 3])
    up = 2 * u[..., 4] - 1
    ball = on_disk(a, b, 1 - up * up, u[..., 3]) + up[..., None] * w
    ball = centre + (reach * np.cbrt(u[..., 2]))[..., None] * ball
    points = 4 / 3 * reach * extinction  # weight of points against that of paths
    blurred = np.exp(-extinction * wall_distance(disk, w)) + points * np.exp(-extinction * wall_distance(ball, w))
    change = blurred / (1 + points) - np.exp(-extinction * wall_distance(x[:, :, None], w))
    return lost * change.mean(axis=(1, 2))


def wall_blur(extinction: float, radius: float, origins: Array, d: Array) -> Array:
    """The same of what falls on the walls that rays end on, in disks; (ray,)."""
    u = np.random.default_rng(6).random((len(d), 1, 4)) + qmc.Sobol(4, seed=2).random(8 * DRAWS)
    u %= 1.0
    far = wall_distance(origins, d)
    p = origins + far[:, None] * d
    axis = np.argmax(np.abs(p), axis=1)
    n = -np.sign(p) * (np.arange(3) == axis[:, None])
    room_left = np.where(n != 0, np.inf, HALF - np.abs(p)).min(axis=1)
    reach = np.clip(room_left, OF_DISK * radius, radius)
    a, b = (v[:, None] for v in across(n))
    y = p[:, None] + reach[:, None, None] * on_disk(a, b, u[..., 0], u[..., 1])
    w = np.sqrt(1 - u[..., 2, None]) * n[:, None] + on_disk(a, b, u[..., 2], u[..., 3])
    change = np.exp(-extinction * wall_distance(y, w)) - np.exp(-extinction * wall_distance(p[:, None], w))
    on_wall = np.all(np.abs(y) <= HALF * (1 + 1e-12), axis=-1)
    return np.exp(-extinction * far) * np.average(change, axis=1, weights=on_wall)


def furnace_blur(albedo: float, extinction: float, radius: float, origins: Array, d: Array) -> float:
    """Mean over rays (ray, 3) of what photons make of 1, less 1."""
    blur = media_blur(extinction, radius, origins, d) + albedo * wall_blur(extinction, radius, origins, d)
    return -(1 - albedo) * float(blur.mean())
