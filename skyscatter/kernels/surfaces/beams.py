"""Directions from beside the beam of a lamp into it.

What haze scatters out of a narrow beam reaches a place at the height h over its axis from a band of directions that few
turns by chance meet.  Seen from there the beam stands along a great circle, from the lamp to where the axis goes.  A
stretch ds of the axis at the distance r sends light as ds / r^2 over its own width, which is dphi / h with phi the
angle along the great circle: so directions are even in phi, and even across the beam, which is as wide as the cone is
at its axis there.  In the coordinates (phi, z), z the sine of the angle across, solid angle is dphi dz.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined, kernel

#: Half the width of the band across at least, as a sine: next to the lamp the beam has none.
LEAST_WIDTH = 1e-7
#: Share of the vertices of a leg that are drawn by where it passes a beam, and how far beyond, in distances from the
#: lamp.
TO_BEAM, REACH = 0.5, 3.0
#: Squared sine between a ray and a beam at least, and how near it comes at least, in distances from the lamp.
LEAST_SQUARE, NEAREST = 1e-9, 1e-6


@inlined
def place_beside(guide, k, x):
    """Place along the axis of lamp k's beam and height over the axis [m]; the height is 0 within the beam.

    So it is of lamps that have no narrow beam.
    """
    slope = guide.slope[k]
    if slope <= 0.0:
        return 0.0, 0.0
    p, a = guide.middle[k], guide.axis[k]
    dx, dy, dz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    along = dx * a[0] + dy * a[1] + dz * a[2]
    height = math.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
    return along, (height if height > slope * along else 0.0)


@inlined
def to_beam(along, height):
    """Distance [m] to the axis of a beam, which begins at its lamp."""
    return height if along >= 0.0 else math.sqrt(along * along + height * height)


@inlined
def half_width(along, height, phi, slope):
    """Sine of half the width of the beam where the direction at the angle phi meets its axis."""
    return min(max(slope * (along / height * math.cos(phi) + math.sin(phi)), LEAST_WIDTH), 1.0)


@inlined
def axes_beside(guide, k, x, along, height):
    """Unit vectors from x to the axis of the beam and across both, each as three numbers."""
    p, a = guide.middle[k], guide.axis[k]
    ux = (p[0] + along * a[0] - x[0]) / height
    uy = (p[1] + along * a[1] - x[1]) / height
    uz = (p[2] + along * a[2] - x[2]) / height
    return ux, uy, uz, uy * a[2] - uz * a[1], uz * a[0] - ux * a[2], ux * a[1] - uy * a[0]


@kernel
def draw_to_beam(guide, k, x, along, height, u, v, d):
    """A direction from x into the beam of lamp k, into `d` (3,); place and height are those of `place_beside`."""
    a = guide.axis[k]
    ux, uy, uz, nx, ny, nz = axes_beside(guide, k, x, along, height)
    first = math.atan2(-along, height)
    phi = first + u * (0.5 * math.pi - first)
    z = (2.0 * v - 1.0) * half_width(along, height, phi, guide.slope[k])
    level = math.sqrt((1.0 - z) * (1.0 + z))
    c, s = level * math.cos(phi), level * math.sin(phi)
    d[0], d[1], d[2] = c * ux + s * a[0] + z * nx, c * uy + s * a[1] + z * ny, c * uz + s * a[2] + z * nz


@kernel
def density_to_beam(guide, k, x, along, height, d):
    """Density of `draw_to_beam` [sr-1] in direction d."""
    a = guide.axis[k]
    ux, uy, uz, nx, ny, nz = axes_beside(guide, k, x, along, height)
    first = math.atan2(-along, height)
    phi = math.atan2(d[0] * a[0] + d[1] * a[1] + d[2] * a[2], d[0] * ux + d[1] * uy + d[2] * uz)
    half = half_width(along, height, phi, guide.slope[k])
    if not first <= phi <= 0.5 * math.pi or abs(d[0] * nx + d[1] * ny + d[2] * nz) > half:
        return 0.0
    return 0.5 / (half * (0.5 * math.pi - first))


@inlined
def past_beam(p, a, slope, x, d):
    """How a ray from x along d passes a beam from p along a: where, how near, and the sine between both.

    How near is at least the radius of the beam there: within it light is even.
    """
    rx, ry, rz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    by_ray, by_axis = d[0] * rx + d[1] * ry + d[2] * rz, a[0] * rx + a[1] * ry + a[2] * rz
    cosine = d[0] * a[0] + d[1] * a[1] + d[2] * a[2]
    square = max((1.0 - cosine) * (1.0 + cosine), LEAST_SQUARE)
    t, s = (cosine * by_axis - by_ray) / square, (by_axis - cosine * by_ray) / square
    if s < 0.0:
        # Nearest to the lamp itself.
        t, s, square = -by_ray, 0.0, 1.0
    x, y, z = rx + t * d[0] - s * a[0], ry + t * d[1] - s * a[1], rz + t * d[2] - s * a[2]
    far = math.sqrt(rx * rx + ry * ry + rz * rz)
    return t, max(math.sqrt(x * x + y * y + z * z), slope * s, NEAREST * far), math.sqrt(square), far


@kernel
def aim_at_beam(guide, x, d, length):
    """Where on a leg from x along d the beam lies that should be brightest there.

    Returns
    -------
    share : of the vertices that are drawn by it; 0 where there is no beam
    middle, scale : where the leg passes the beam, and the length over which the height over its axis doubles [m]
    low, high : what `draw_near_beam` draws evenly from
    """
    best, middle, scale, end = 0.0, 0.0, 1.0, 0.0
    if guide.beamed:
        for k in range(guide.slope.size):
            if guide.slope[k] > 0.0:
                t, gap, sine, far = past_beam(guide.middle[k], guide.axis[k], guide.slope[k], x, d)
                if guide.power[k] / gap > best:
                    best, middle, scale, end = guide.power[k] / gap, t, gap / sine, max(t, 0.0) + REACH * far
    if not best > 0.0 or not length > 0.0:
        return 0.0, 0.0, 1.0, 0.0, 0.0
    low, high = math.asinh(-middle / scale), math.asinh((min(end, length) - middle) / scale)
    return (TO_BEAM if high > low else 0.0), middle, scale, low, high


@inlined
def draw_near_beam(middle, scale, low, high, u):
    """A distance along the leg by one over the height over the beam's axis."""
    return middle + scale * math.sinh(low + u * (high - low))


@inlined
def density_near_beam(middle, scale, low, high, t):
    """Density of `draw_near_beam` [m-1]."""
    u = (t - middle) / scale
    return 1.0 / (scale * math.sqrt(1.0 + u * u) * (high - low)) if low <= math.asinh(u) <= high else 0.0
