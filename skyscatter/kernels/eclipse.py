"""Sunlight in the Moon's shadow: its share at any point, looked up in a table of the geometry."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, kernel

#: Steps of the table from where the disks are concentric to where one touches the other from within, and on to where
#: they touch from outside; evenly in angles whose cosines are the distance, for the light sets in there as a power 3/2.
INNER, OUTER = 128, 512


@by_address
class EclipseTable(NamedTuple):
    """The Moon before the Sun."""

    share: np.ndarray  #: (ratio, step, wavelength) of the sunlight that passes; of no ratio where there is no eclipse
    ratio: np.ndarray  #: (3,) apparent radii of the Moon, rising, in those of the Sun
    sun: np.ndarray  #: (3,) from the planet's centre [m]
    moon: np.ndarray  #: (3,) from the planet's centre [m]
    sun_radius: float  #: [m]
    moon_radius: float  #: [m]
    scale: float  #: radius of the disk that is drawn, in the Sun's


@kernel
def dim(eclipse, x, y, z, light):
    """Multiply sunlight (wavelength,) by the share of it that passes the Moon at a point [m]."""
    sx, sy, sz = eclipse.sun[0] - x, eclipse.sun[1] - y, eclipse.sun[2] - z
    mx, my, mz = eclipse.moon[0] - x, eclipse.moon[1] - y, eclipse.moon[2] - z
    if sx * mx + sy * my + sz * mz <= 0.0:
        return
    far, near = math.sqrt(sx * sx + sy * sy + sz * sz), math.sqrt(mx * mx + my * my + mz * mz)
    # The cross product keeps the digits of small angles.
    cx, cy, cz = sy * mz - sz * my, sz * mx - sx * mz, sx * my - sy * mx
    sine = math.sqrt(cx * cx + cy * cy + cz * cz) / (far * near)
    radius = math.asin(eclipse.sun_radius / far)
    apart = math.asin(min(sine, 1.0)) / radius
    ratio = math.asin(eclipse.moon_radius / near) / radius
    if apart >= 1.0 + ratio:
        return
    within = abs(1.0 - ratio)
    if apart > within:
        step = INNER + OUTER * math.acos(1.0 - 2.0 * (apart - within) / (1.0 + ratio - within)) / math.pi
    else:
        step = INNER * math.asin(apart / within) * 2.0 / math.pi if within > 0.0 else float(INNER)
    k = min(int(step), INNER + OUTER - 1)
    v = step - k
    j = 0 if ratio < eclipse.ratio[1] else 1
    w = (ratio - eclipse.ratio[j]) / (eclipse.ratio[j + 1] - eclipse.ratio[j])
    share = eclipse.share
    for i in range(light.size):
        low = (1.0 - v) * share[j, k, i] + v * share[j, k + 1, i]
        high = (1.0 - v) * share[j + 1, k, i] + v * share[j + 1, k + 1, i]
        light[i] *= (1.0 - w) * low + w * high


@kernel
def behind_moon(eclipse, axis, x, y, z, dx, dy, dz):
    """Whether the Moon's disk lies in a direction, as seen from a point [m].

    The scene's Sun, about `axis`, may be drawn in another size than that which covers and is covered; the Moon follows.
    """
    mx, my, mz = eclipse.moon[0] - x, eclipse.moon[1] - y, eclipse.moon[2] - z
    near = math.sqrt(mx * mx + my * my + mz * mz)
    ex = dx - axis[0] - eclipse.scale * (mx / near - axis[0])
    ey = dy - axis[1] - eclipse.scale * (my / near - axis[1])
    ez = dz - axis[2] - eclipse.scale * (mz / near - axis[2])
    return math.sqrt(ex * ex + ey * ey + ez * ez) < eclipse.scale * eclipse.moon_radius / near


@entry
def dim_points(eclipse, points, light):
    """`dim` at many points (point, 3) [m]; `light` (point, wavelength) is changed."""
    for k in range(points.shape[0]):
        dim(eclipse, points[k, 0], points[k, 1], points[k, 2], light[k])


#: The table where no Moon is in the way.
NO_ECLIPSE = EclipseTable(np.zeros((0, 0, 0)), np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 0.0, 1.0)
