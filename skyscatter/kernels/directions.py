"""Directions that are turned."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import kernel


@kernel
def turn(direction, cosine, azimuth):
    """Rotate a unit vector by the angle with that cosine, around itself by `azimuth`."""
    x, y, z = direction[0], direction[1], direction[2]
    sine = math.sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0))
    # A frame without a singularity: Duff et al. (2017), JCGT 6, 1.
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u, v = sine * math.cos(azimuth), sine * math.sin(azimuth)
    direction[0] = cosine * x + u * (1.0 + sign * x * x * a) + v * b
    direction[1] = cosine * y + u * sign * b + v * (sign + y * y * a)
    direction[2] = cosine * z - u * sign * x - v * y
    norm = math.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    for d in range(3):
        direction[d] /= norm
