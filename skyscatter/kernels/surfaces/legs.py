"""Where on a leg through a medium the light of a lamp is looked for.

Light of a point at the height h over the leg's line, at t = a along it, that is scattered once into the leg is the
integral of p(angle) dt / (h^2 + (t - a)^2) = p(angle) d(angle) / h over the angle of scattering, from 0 far before the
lamp to pi far beyond it.  So distances are drawn by the integral of the phase function over the angle: equi-angular
sampling (Kulla & Fajardo 2012, Computer Graphics Forum 31, 1519), which takes the phase function as constant, with the
phase function.  Only those stretches count that the lobe of the lamp can reach.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, SURROUNDINGS
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.surfaces.lamps import share_out
from skyscatter.kernels.tabulated import cell_of

#: Optical depth of a leg beyond which no lamp draws a point; free flights still do.
DEEPEST = 8.0
#: Heights over the line, in sizes of the lamp and of its distance, below which it is not taken as a point.
LEAST_HEIGHT, SMALLEST_HEIGHT = 0.3, 1e-9


@inlined
def gathered_at(gathered, angle):
    """Integral of the phase function over the angle up to `angle`."""
    last = gathered.size - 1
    y = math.sqrt(max(angle, 0.0) / math.pi) * last
    k = min(int(y), last - 1)
    return gathered[k] + (y - k) * (gathered[k + 1] - gathered[k])


@merged
def within_cone(axis, lowest, x, y, z, d, start, end):
    """The part of [start, end] on which (x, y, z) + t d, counted from the tip, lies in a cone, flat at most."""
    along, slope = x * axis[0] + y * axis[1] + z * axis[2], d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2]
    c2 = lowest * lowest
    square = slope * slope - c2
    half = along * slope - c2 * (x * d[0] + y * d[1] + z * d[2])
    rest = along * along - c2 * (x * x + y * y + z * z)
    root = half * half - square * rest
    if lowest <= 0.0:
        # In front of a plane.
        if slope == 0.0:
            return (start, end) if along >= 0.0 else (math.inf, -math.inf)
        t = -along / slope
        return (max(start, t), end) if slope > 0.0 else (start, min(end, t))
    if root <= 0.0 or square == 0.0:
        # It misses the cone, or goes along its side: where not sure, do not cut.
        return (math.inf, -math.inf) if square < 0.0 else (start, end)
    root = math.sqrt(root)
    one, two = (-half - root) / square, (-half + root) / square
    low, high = min(one, two), max(one, two)
    if square < 0.0:
        middle = along + 0.5 * (low + high) * slope
        return (max(start, low), min(end, high)) if middle > 0.0 else (math.inf, -math.inf)
    return (max(start, high), end) if slope > 0.0 else (start, min(end, low))


@kernel
def aim_on_leg(lamps, guide, m, k, x, d, far):
    """How light of lamp k is looked for on a leg from x in direction d through medium m.

    Returns
    -------
    guess : of the light scattered into the leg, for the choice among lamps
    along, height : place and height of the lamp [m]
    low, high : integral of the phase function over the angle at both ends; equal where no point can be drawn
    """
    sigma, p = guide.extinction[m], guide.middle[k]
    if lamps.kind[k] == PARALLEL_LAMP or lamps.kind[k] == SURROUNDINGS:
        reach = min(far, 1.0 / sigma if sigma > 0.0 else 2.0 * lamps.radius)
        return guide.power[k] * guide.typical[k] * reach, 0.0, 0.0, 0.0, 0.0
    wx, wy, wz = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    start, end = 0.0, min(far, DEEPEST / sigma) if sigma > 0.0 else far
    if guide.lowest[k] > -1.0:
        start, end = within_cone(guide.axis[k], guide.lowest[k], wx, wy, wz, d, start, end)
    if not end > start:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    along = -(wx * d[0] + wy * d[1] + wz * d[2])
    fx, fy, fz = wx + along * d[0], wy + along * d[1], wz + along * d[2]
    height = math.sqrt(fx * fx + fy * fy + fz * fz)
    least = max(LEAST_HEIGHT * guide.size[k], SMALLEST_HEIGHT * math.sqrt(wx * wx + wy * wy + wz * wz))
    height = max(height, max(least, 1e-300))
    low = gathered_at(guide.gathered[m], math.atan2(height, along - start))
    high = gathered_at(guide.gathered[m], math.atan2(height, along - end) if end < math.inf else math.pi)
    if not high > low:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    nearest = min(max(along, start), end)
    path = nearest + math.sqrt(height * height + (along - nearest) ** 2)
    guess = guide.power[k] * guide.typical[k] * (high - low) / height * fast_exp(-sigma * path)
    return guess, along, height, low, high


@inlined
def guess_on_leg(lamps, guide, m, x, d, far, chance):
    """Chances to look for each lamp from a leg, into `chance` (lamp,)."""
    for k in range(chance.size):
        chance[k], _, _, _, _ = aim_on_leg(lamps, guide, m, k, x, d, far)
    share_out(guide, chance)


@kernel
def draw_on_leg(gathered, along, height, low, high, u):
    """A distance [m] along the leg by the integral of the phase function."""
    wanted = low + u * (high - low)
    last = gathered.size - 1
    n = cell_of(gathered, 0, last, wanted)
    y = (n + min((wanted - gathered[n]) / (gathered[n + 1] - gathered[n]), 1.0)) / last
    angle = math.pi * y * y
    return along - height * math.cos(angle) / max(math.sin(angle), 1e-300)


@kernel
def density_on_leg(gathered, along, height, low, high, t):
    """Density [m-1] of `draw_on_leg` at the distance t."""
    if not high > low:
        return 0.0
    ahead = along - t
    angle = math.atan2(height, ahead)
    last = gathered.size - 1
    y = math.sqrt(angle / math.pi)
    k = min(int(y * last), last - 1)
    slope = (gathered[k + 1] - gathered[k]) * last
    reached = gathered[k] + (y - k / last) * slope
    if not low <= reached <= high:
        return 0.0
    return slope / (2.0 * math.pi * max(y, 1e-300)) * height / (height * height + ahead * ahead) / (high - low)
