"""Light of a lamp on the ground that is scattered once, along rays, by adaptive quadrature.

Along a ray of the distance t the source is

    J(t) = sum_c n_c sigma_s,c p_c(angle)  I(z) T_lamp / D^2,                                                  (1)

with D the distance to the lamp, I its radiant intensity over its power under the zenith angle z, and T_lamp the
transmittance between them.  With t = t_0 + D_0 tan(a), t_0 where the ray is nearest to the lamp and D_0 how near,
dt / D^2 = da / D_0: what is left has no pole, however close the ray passes (Kulla & Fajardo 2012, Computer Graphics
Forum 31, 1519).  A lamp stands on the sphere itself: the planet is in the way exactly where it would shine below its
horizon.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.lookup import (
    columns_along,
    densities,
    outward_columns,
    sort_few,
    start_columns,
    trace_line,
)
from skyscatter.kernels.optics import SceneTable, mix_components, phase_at, transmittance, weigh_phase
from skyscatter.kernels.single import GAUSS_W, KRONROD_W, KRONROD_X, STACK
from skyscatter.kernels.tabulated import cell_of
from skyscatter.kernels.work import make_work

#: Rays pass lamps no closer than this [m]: a lamp has some extent.
CLOSEST = 1.0


@inlined
def lobe_at(lobe, cosine):
    """Radiant intensity over power [sr-1] of a lobe (2, node) at the cosine of a zenith angle."""
    last = lobe.shape[1] - 1
    value = 0.0
    if lobe[0, 0] <= cosine:
        k = cell_of(lobe[0], 0, last, min(cosine, lobe[0, last]))
        w = (min(cosine, lobe[0, last]) - lobe[0, k]) / (lobe[0, k + 1] - lobe[0, k])
        value = lobe[1, k] + w * (lobe[1, k + 1] - lobe[1, k])
    return value


@kernel
def lamp_source(scene, line, origin, direction, t, lobe, lamp, work):
    """What a point of a ray sends on of the lamp's light over its power [m-3 sr-1], times D^2, into ``work.source``.

    The density and the transmittances to the start of the line and to the lamp are left in `work`.

    Returns
    -------
    square : float
        D^2 [m2]
    """
    columns, optics = scene.columns, scene.optics
    r = columns_along(columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, optics.sigma_t, work.through)
    densities(columns, r - columns.radius, work.density)
    s = t - line.start
    x, y, z = origin[0] + s * direction[0], origin[1] + s * direction[1], origin[2] + s * direction[2]
    a, b, c = x - lamp[0], y - lamp[1], z - lamp[2]
    square = max(a * a + b * b + c * c, CLOSEST * CLOSEST)
    far = math.sqrt(square)
    cosine = (a * lamp[0] + b * lamp[1] + c * lamp[2]) / (columns.radius * far)
    intensity = lobe_at(lobe, cosine) if cosine > 0.0 else 0.0
    if not intensity > 0.0:
        for i in range(work.source.size):
            work.source[i], work.sun[i] = 0.0, 0.0
        return square
    outward_columns(columns, 0.0, min(cosine, 1.0), work.to_sun)
    mu = min(max((a * x + b * y + c * z) / (r * far), 0.0), 1.0)
    outward_columns(columns, r - columns.radius, mu, work.spare)
    for f in range(work.spare.size):
        work.to_sun[f] = max(work.to_sun[f] - work.spare[f], 0.0)
    transmittance(work.to_sun, optics.sigma_t, work.sun)
    angle = -(a * direction[0] + b * direction[1] + c * direction[2]) / far
    phase_at(optics.phase, min(max(angle, -1.0), 1.0), work.phase)
    weigh_phase(work.phase, optics.sigma_s, work.weighted)
    mix_components(work.density, work.weighted, work.towards)
    for i in range(work.source.size):
        work.source[i] = intensity * work.through[i] * work.towards[i] * work.sun[i]
    return square


@inlined
def nearest(line, origin, direction, lamp):
    """Place t on a line nearest to a lamp, and how near they are [m]."""
    a, b, c = lamp[0] - origin[0], lamp[1] - origin[1], lamp[2] - origin[2]
    along = a * direction[0] + b * direction[1] + c * direction[2]
    a, b, c = a - along * direction[0], b - along * direction[1], c - along * direction[2]
    return line.start + along, max(math.sqrt(a * a + b * b + c * c), CLOSEST)


@merged
def _cut_points(scene, line, origin, direction, lamp, cuts):
    """Places t where (1) may have a kink, rising, both ends included; returns their number."""
    radius = scene.columns.radius
    cuts[0], cuts[1] = line.enter, line.leave
    n = 2
    if line.enter < 0.0 < line.leave:
        cuts[n] = 0.0
        n += 1
    for b in scene.breaks:
        if radius + b > line.p:
            t = math.sqrt((radius + b - line.p) * (radius + b + line.p))
            for sign in (-1.0, 1.0):
                if line.enter < sign * t < line.leave:
                    cuts[n] = sign * t
                    n += 1
    # The lamp's horizontal plane: it shines above.
    slope = lamp[0] * direction[0] + lamp[1] * direction[1] + lamp[2] * direction[2]
    height = lamp[0] * origin[0] + lamp[1] * origin[1] + lamp[2] * origin[2] - radius * radius
    if slope != 0.0 and line.enter < line.start - height / slope < line.leave:
        cuts[n] = line.start - height / slope
        n += 1
    middle, near = nearest(line, origin, direction, lamp)
    for k in range(-1, 2):
        if line.enter < middle + k * near < line.leave:
            cuts[n] = middle + k * near
            n += 1
    sort_few(cuts, n)
    return n


@merged
def _integrate(scene, line, origin, direction, a, b, middle, near, lobe, lamp, work):
    """Both rules of Gauss and Kronrod over angles [a, b], into ``work.fine`` and ``work.coarse``."""
    for i in range(work.fine.size):
        work.fine[i], work.coarse[i] = 0.0, 0.0
    half = 0.5 * (b - a)
    for k in range(KRONROD_X.size):
        t = middle + near * math.tan(0.5 * (a + b) + half * KRONROD_X[k])
        lamp_source(scene, line, origin, direction, min(max(t, line.enter), line.leave), lobe, lamp, work)
        for i in range(work.fine.size):
            work.fine[i] += half / near * KRONROD_W[k] * work.source[i]
            work.coarse[i] += half / near * GAUSS_W[k] * work.source[i]


@kernel
def _agrees(total, fine, coarse, tolerance):
    """Whether the rules agree, measured by what has been found so far."""
    worst = 0.0
    for i in range(total.size):
        worst = max(worst, abs(fine[i] - coarse[i]) - tolerance * (total[i] + fine[i]))
    return worst <= 0.0


@entry
def first_rays(scene, lobe, lamps, origins, directions, tolerance, scratch, out):
    """Light of one lamp for each ray, scattered once.

    Parameters
    ----------
    scene : SceneTable
    lobe : (2, node)
        Rising cosines of the zenith angle, and radiant intensities over the power [sr-1].
    lamps : (ray, 3)
        On the ground, from the planet's centre [m].
    origins, directions : (ray, 3)
    tolerance : float
        Largest difference of the two rules on a piece, relative to what has been found on the ray.
    scratch : tuple
        Made by `make_first_scratch`.
    out : (ray, wavelength), output
        Radiance over the lamp's power [m-2 sr-1].
    """
    work, cuts, stack = scratch
    for ray in range(origins.shape[0]):
        o, d, lamp = origins[ray], directions[ray], lamps[ray]
        for i in range(out.shape[1]):
            out[ray, i] = 0.0
        line = trace_line(scene.columns, o[0], o[1], o[2], d[0], d[1], d[2])
        if line.leave <= line.enter:
            continue
        start_columns(scene.columns, line, work.from_start, work.across)
        pieces = _cut_points(scene, line, o, d, lamp, cuts) - 1
        middle, near = nearest(line, o, d, lamp)
        for k in range(pieces):
            stack[0, 0] = math.atan((cuts[k] - middle) / near)
            stack[0, 1] = math.atan((cuts[k + 1] - middle) / near)
            shortest, waiting = 1e-6 * (stack[0, 1] - stack[0, 0]), 1
            while waiting > 0:
                waiting -= 1
                a, b = stack[waiting, 0], stack[waiting, 1]
                _integrate(scene, line, o, d, a, b, middle, near, lobe, lamp, work)
                small = b - a <= shortest or waiting + 2 > stack.shape[0]
                if small or _agrees(out[ray], work.fine, work.coarse, tolerance):
                    for i in range(out.shape[1]):
                        out[ray, i] += work.fine[i]
                else:
                    stack[waiting, 0], stack[waiting, 1] = 0.5 * (a + b), b
                    stack[waiting + 1, 0], stack[waiting + 1, 1] = a, 0.5 * (a + b)
                    waiting += 2


def make_first_scratch(scene: SceneTable) -> tuple[Any, ...]:
    """Scratch arrays of `first_rays`; a thread needs its own."""
    components, wavelengths = scene.optics.sigma_s.shape
    return make_work(components, wavelengths), np.zeros(8 + 2 * scene.breaks.size), np.zeros((STACK, 2))
