"""Densities of analytic shapes at a point of their own frame.

Every function takes the point (a, b, c) in the frame in which the shape is simplest (its length is the unit, its axis
is c), the table's `parameters`, and the place `at` where the shape's own numbers begin.  Every shape is zero outside
a support of its own: no box has to be known to evaluate it.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.shells import CHAPMAN, EXPONENTIAL, GAUSSIAN, LINEAR
from skyscatter.kernels.codes.space import GAUSSIAN_PROFILE, WARP_MODES
from skyscatter.kernels.jit import entry, inlined, kernel, merged, reduction
from skyscatter.kernels.tabulated import cell_of


@inlined
def gaussian_sphere(p, at, m):
    """exp(-m / 2) at the squared radius m, within the squared radius p[at]."""
    return math.exp(-0.5 * m) if m <= p[at] else 0.0


@inlined
def power_law(p, at, m):
    """(1 + m)^-h with h = p[at], within the squared radius p[at + 1]."""
    return (1.0 + m) ** -p[at] if m <= p[at + 1] else 0.0


@inlined
def bonnor_ebert(p, at, m):
    """exp(-psi): cubics of psi over ln(1 + xi^2 / 6), in which it is nearly a straight line.

    p[at]: squared outer radius; p[at + 1]: width of a cell; then values and slopes times width at the nodes.
    """
    if m > p[at]:
        return 0.0
    u = math.log1p(m / 6.0) / p[at + 1]
    k = int(u)
    f = u - k
    j = at + 2 + 2 * k
    y0, d0, y1, d1 = p[j], p[j + 1], p[j + 2], p[j + 3]
    rise = y1 - y0
    return math.exp(-(y0 + f * (d0 + f * (3.0 * rise - 2.0 * d0 - d1 + f * (d0 + d1 - 2.0 * rise)))))


@inlined
def gaussian_shell(p, at, m):
    """Gaussian of the radius around 1, of width p[at], within p[at + 1] widths."""
    x = (math.sqrt(m) - 1.0) / p[at]
    return math.exp(-0.5 * x * x) if abs(x) <= p[at + 1] else 0.0


@inlined
def disk(p, at, a, b, c):
    """R^-alpha exp(-c^2 / 2 h^2) with h = h0 R^beta; p: alpha, beta, h0, inner and outer R, cut in h."""
    big = math.sqrt(a * a + b * b)
    if big < p[at + 3] or big > p[at + 4]:
        return 0.0
    x = c / (p[at + 2] * big ** p[at + 1])
    return big ** -p[at] * math.exp(-0.5 * x * x) if abs(x) <= p[at + 5] else 0.0


@inlined
def cone(p, at, m, c):
    """(r / inner)^-exponent within a cone; p: cosine of the half angle, inner radius, exponent, 1 if on both sides."""
    r = math.sqrt(m)
    height = abs(c) if p[at + 3] > 0.0 else c
    if r > 1.0 or r < p[at + 1] or height < p[at] * r:
        return 0.0
    return 1.0 if p[at + 2] == 0.0 else (r / p[at + 1]) ** -p[at + 2]


@inlined
def tube_profile(p, at, m):
    """Profile of a filament at the squared distance m; p: profile, half exponent, squared distance where it ends."""
    if m > p[at + 2]:
        return 0.0
    return math.exp(-0.5 * m) if p[at] == GAUSSIAN_PROFILE else (1.0 + m) ** -p[at + 1]


@kernel
def filament_distance(p, at, a, b, c):
    """Squared distance from a chain of segments.

    p[at]: number of segments, then for each its start, its vector, and its reciprocal squared length.
    """
    nearest = math.inf
    for k in range(int(p[at])):
        j = at + 1 + 7 * k
        x, y, z = a - p[j], b - p[j + 1], c - p[j + 2]
        u, v, w = p[j + 3], p[j + 4], p[j + 5]
        s = min(max((x * u + y * v + z * w) * p[j + 6], 0.0), 1.0)
        x, y, z = x - s * u, y - s * v, z - s * w
        nearest = min(nearest, x * x + y * y + z * z)
    return nearest


@kernel
def around_planet(p, at, m):
    """Density over the altitude h = radius (sqrt(m) - 1), zero below the ground.

    p[at]: radius, kind of the profile as in `kernels.columns`, its two numbers, top, number of nodes, number of breaks,
    altitudes of the nodes, densities there, breaks; last the longest panel.
    """
    h = p[at] * (m - 1.0) / (math.sqrt(m) + 1.0)
    if h < 0.0 or h >= p[at + 4]:
        return 0.0
    kind, a, b = int(p[at + 1]), p[at + 2], p[at + 3]
    if kind == EXPONENTIAL:
        return math.exp(-h / a)
    if kind == GAUSSIAN:
        return math.exp(-0.5 * ((h - a) / b) ** 2)
    if kind == CHAPMAN:
        z = (h - a) / b
        return math.exp(1.0 - z - math.exp(-z))
    first, count = at + 7, int(p[at + 5])
    if h < p[first]:
        return 0.0
    i = cell_of(p, first, first + count - 1, h)
    w = (h - p[i]) / (p[i + 1] - p[i])
    n0, n1 = p[i + count], p[i + count + 1]
    if kind == LINEAR:
        return n0 + w * (n1 - n0)
    return n0 * math.exp(w * math.log(n1 / n0))


@merged
def cosine_of_turns(x):
    """cos(2 pi x), branch-free; error below 2e-9.

    With r the distance of x from the nearest whole number it is sin(2 pi q), q = 1/4 - r, |q| <= 1/4: Taylor's series
    up to the power 13, whose next term is (pi/2)^15 / 15! < 7e-10.
    """
    q = 6.283185307179586 * (0.25 - abs(x - math.floor(x + 0.5)))
    s = q * q
    return q * (
        1.0 + s * (-1 / 6 + s * (1 / 120 + s * (-1 / 5040 + s * (1 / 362880 + s * (-1 / 39916800 + s / 6227020800)))))
    )


@reduction
def sum_of_modes(data, start, count, a, b, c):
    """Sum of amplitude cos(2 pi (k . x + phase)); data: kx, ky, kz, phase and amplitude, each (count,)."""
    # Slices, whose indices are plainly not negative: a test of the sign would keep the loop from being vectorised.
    kx, ky, kz = data[start : start + count], data[start + count :], data[start + 2 * count :]
    phase, amplitude = data[start + 3 * count :], data[start + 4 * count :]
    total = 0.0
    for i in range(count):
        total += amplitude[i] * cosine_of_turns(kx[i] * a + ky[i] * b + kz[i] * c + phase[i])
    return total


@inlined
def turbulence(p, at, data, start, count, a, b, c):
    """Exp of a sum of modes, within a box; p: minus the logarithm of the mean, half sizes of the box."""
    if abs(a) > p[at + 1] or abs(b) > p[at + 2] or abs(c) > p[at + 3]:
        return 0.0
    return math.exp(p[at] + sum_of_modes(data, start, count, a, b, c))


@kernel
def front_radius(p, at, a, b, c, r):
    """Radius of a star-shaped surface in the direction of (a, b, c), bilinear over polar angle and azimuth.

    p[at]: rows over the polar angle, p[at + 1]: columns over the azimuth, p[at + 2]: polar angle of the last row,
    which goes on beyond; then the radii.
    """
    rows, columns = int(p[at]), int(p[at + 1])
    if r == 0.0:
        return p[at + 3]
    u = min(math.acos(min(max(c / r, -1.0), 1.0)) / p[at + 2], 1.0) * (rows - 1)
    v = math.atan2(b, a) / (2.0 * math.pi)
    v = (v + 1.0 if v < 0.0 else v) * columns
    i, j = min(int(u), rows - 2), int(v)
    f, g = u - i, v - j
    j = j % columns
    j1 = (j + 1) % columns
    q = at + 3 + i * columns
    upper = p[q + j] + g * (p[q + j1] - p[q + j])
    lower = p[q + columns + j] + g * (p[q + columns + j1] - p[q + columns + j])
    return upper + f * (lower - upper)


@kernel
def front(p, at, a, b, c):
    """erfc((r - R) / sqrt(2) width) / 2 with R the radius of the surface; zero outside its cone.

    p[at]: width, p[at + 1]: cut in widths; then as `front_radius` has it.
    """
    r = math.sqrt(a * a + b * b + c * c)
    if p[at + 4] < 3.14 and c < r * math.cos(p[at + 4]):
        return 0.0
    beyond = r - front_radius(p, at + 2, a, b, c, r)
    if p[at] == 0.0:
        return 1.0 if beyond <= 0.0 else 0.0
    x = beyond / p[at]
    if abs(x) > p[at + 1]:
        return 1.0 if x < 0.0 else 0.0
    return 0.5 * math.erfc(x * math.sqrt(0.5))


@kernel
def displacement(p, at, a, b, c):
    """Displacement of a point by smooth noise; p[at]: amplitude, then kx, ky, kz, phase of each component's modes."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(WARP_MODES):
        j = at + 1 + 4 * k
        x += cosine_of_turns(p[j] * a + p[j + 1] * b + p[j + 2] * c + p[j + 3])
        j += 4 * WARP_MODES
        y += cosine_of_turns(p[j] * a + p[j + 1] * b + p[j + 2] * c + p[j + 3])
        j += 4 * WARP_MODES
        z += cosine_of_turns(p[j] * a + p[j + 1] * b + p[j + 2] * c + p[j + 3])
    return p[at] * x, p[at] * y, p[at] * z


@entry
def fill_mode_bounds(modes, low, high, parts, lowest, highest):
    """Bounds of a sum of modes (5, n) within boxes (box, 3), each cut into parts^3."""
    cells = parts * parts * parts
    for n in range(low.shape[0]):
        lowest[n], highest[n] = math.inf, -math.inf
        hx, hy = 0.5 * (high[n, 0] - low[n, 0]) / parts, 0.5 * (high[n, 1] - low[n, 1]) / parts
        hz = 0.5 * (high[n, 2] - low[n, 2]) / parts
        for cell in range(cells):
            i, j, k = cell // (parts * parts), cell // parts % parts, cell % parts
            x, y, z = low[n, 0] + (2 * i + 1) * hx, low[n, 1] + (2 * j + 1) * hy, low[n, 2] + (2 * k + 1) * hz
            bottom, top = bound_modes(modes, x, y, z, hx, hy, hz)
            lowest[n], highest[n] = min(lowest[n], bottom), max(highest[n], top)


@reduction
def bound_modes(modes, x, y, z, hx, hy, hz):
    """Bounds of a sum of modes within one box, given by its middle and its half sizes.

    A slow mode is its Taylor series to second order and at most (angle)^3 / 6 more; so slow modes may cancel.  Of a
    fast one no more is said than that it is between plus and minus its amplitude.
    """
    turn = 6.283185307179586
    v, gx, gy, gz, xx, yy, zz, xy, yz, zx, rest = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(modes.shape[1]):
        kx, ky, kz, a = turn * modes[0, m], turn * modes[1, m], turn * modes[2, m], float(modes[4, m])
        phase = modes[0, m] * x + modes[1, m] * y + modes[2, m] * z + modes[3, m]
        angle = abs(kx) * hx + abs(ky) * hy + abs(kz) * hz
        slow = a if angle < 1.8 else 0.0
        rest += slow * angle * angle * angle / 6.0 + (a - slow)
        cosine, sine = slow * cosine_of_turns(phase), slow * cosine_of_turns(phase - 0.25)
        v += cosine
        gx, gy, gz = gx + sine * kx, gy + sine * ky, gz + sine * kz
        xx, yy, zz = xx + cosine * kx * kx, yy + cosine * ky * ky, zz + cosine * kz * kz
        xy, yz, zx = xy + cosine * kx * ky, yz + cosine * ky * kz, zx + cosine * kz * kx
    # The last is more than the error of the cosines.
    even = abs(gx) * hx + abs(gy) * hy + abs(gz) * hz + abs(xy) * hx * hy + abs(yz) * hy * hz + abs(zx) * hz * hx
    even += rest + 1e-6
    bottom = min(-xx, 0.0) * hx * hx + min(-yy, 0.0) * hy * hy + min(-zz, 0.0) * hz * hz
    top = max(-xx, 0.0) * hx * hx + max(-yy, 0.0) * hy * hy + max(-zz, 0.0) * hz * hz
    return v + 0.5 * bottom - even, v + 0.5 * top + even


@entry
def fill_front_radii(p, points, out):
    """`front_radius` in the directions of points (n, 3)."""
    for n in range(points.shape[0]):
        a, b, c = points[n, 0], points[n, 1], points[n, 2]
        out[n] = front_radius(p, 0, a, b, c, math.sqrt(a * a + b * b + c * c))
