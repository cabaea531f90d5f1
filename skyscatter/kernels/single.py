"""Single scattering along rays by adaptive quadrature.

Along a ray the source is  J(t) = sum_c n_c sigma_s,c p_c(theta) E_sun T_sun + emission,  and the radiance is
Int T(t) J(t) dt  plus what comes through from the end of the ray.  The path is cut wherever the integrand has a kink
(tops and breaks of the fields, the lowest point, the edge of the planet's shadow), and every piece is integrated by a
Gauss-Kronrod pair of 3 and 7 points, halved until the pair agrees at all wavelengths.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skyscatter.kernels.eclipse import behind_moon, dim
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.lookup import (
    columns_along,
    columns_to_light,
    densities,
    sort_few,
    start_columns,
    trace_line,
)
from skyscatter.kernels.optics import (
    SceneTable,
    disk_radiance,
    mix_components,
    phase_at,
    transmittance,
    weigh_phase,
)
from skyscatter.kernels.work import make_work

#: Kronrod (1965) extension of the 3-point Gauss rule on [-1, 1]: nodes, weights, and the Gauss weights inside it.
KRONROD_X = np.array(
    [-0.9604912687080202, -0.7745966692414834, -0.4342437493468026, 0.0,
     0.4342437493468026, 0.7745966692414834, 0.9604912687080202]
)  # fmt: skip
KRONROD_W = np.array(
    [0.1046562260264673, 0.2684880898683334, 0.4013974147759622, 0.4509165386584741,
     0.4013974147759622, 0.2684880898683334, 0.1046562260264673]
)  # fmt: skip
GAUSS_W = np.array([0.0, 5 / 9, 0.0, 8 / 9, 0.0, 5 / 9, 0.0])

#: Pieces on the stack at most; deeper halving is not followed.
STACK = 256
#: Cosine of the Sun's zenith angle above which its disk acts as its middle (error below 1e-4 of the local source).
HIGH_SUN = 0.3


@kernel
def sunlight(scene, r, x_sun, nodes, work, out):
    """Irradiance [W m-2 nm-1] from the solar disk at radius r, into `out`.

    `x_sun` (node,) holds the position's component towards each point of the disk [m].
    """
    out[:] = 0.0
    for m in range(nodes):
        mu_s = min(max(x_sun[m] / r, -1.0), 1.0)
        if not columns_to_light(scene.columns, r, mu_s, work.spare, work.to_sun):
            continue
        transmittance(work.to_sun, scene.optics.sigma_t, work.sun)
        if nodes == 1:
            for i in range(out.size):
                for k in range(scene.optics.sun_irradiance.shape[0]):
                    out[i] += work.sun[i] * scene.optics.sun_irradiance[k, i]
        else:
            for i in range(out.size):
                out[i] += work.sun[i] * scene.optics.sun_irradiance[m, i]


@merged
def _source(scene, line, o, d, t, origin_sun, along_sun, x_sun, work):
    """T(t) J(t) into ``work.source``."""
    optics = scene.optics
    r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, optics.sigma_t, work.through)
    densities(scene.columns, r - scene.columns.radius, work.density)
    for m in range(x_sun.size):
        x_sun[m] = origin_sun[m] + (t - line.start) * along_sun[m]
    nodes = 1 if x_sun[0] > HIGH_SUN * r else x_sun.size
    sunlight(scene, r, x_sun, nodes, work, work.source)
    if scene.eclipse.share.size > 0:
        go = t - line.start
        dim(scene.eclipse, o[0] + go * d[0], o[1] + go * d[1], o[2] + go * d[2], work.source)
    mix_components(work.density, optics.sigma_s, work.scattering)
    mix_components(work.density, work.weighted, work.towards)
    for i in range(work.source.size):
        work.source[i] *= work.through[i] * work.towards[i]
    if optics.emits:
        mix_components(work.density, optics.emission, work.emitted)
        for i in range(work.source.size):
            work.source[i] += work.through[i] * work.emitted[i]


@merged
def _integrate(scene, line, o, d, a, b, origin_sun, along_sun, x_sun, work):
    """Both rules of the pair over [a, b], into ``work.fine`` and ``work.coarse``."""
    work.fine[:] = 0.0
    work.coarse[:] = 0.0
    half = 0.5 * (b - a)
    for k in range(KRONROD_X.size):
        _source(scene, line, o, d, 0.5 * (a + b) + half * KRONROD_X[k], origin_sun, along_sun, x_sun, work)
        for i in range(work.fine.size):
            work.fine[i] += half * KRONROD_W[k] * work.source[i]
            work.coarse[i] += half * GAUSS_W[k] * work.source[i]


@merged
def _shadow_edges(radius, line, origin_sun, along_sun, p_square, cuts, n):
    """Add the distances t at which the line enters or leaves the planet's shadow to `cuts`; returns their number."""
    for m in range(origin_sun.size):
        # |x|^2 - (x.S)^2 = R^2 with |x|^2 = p^2 + t^2 and x.S = q + a t.
        a = along_sun[m]
        q = origin_sun[m] - line.start * a
        qa, qb, qc = 1.0 - a * a, -q * a, p_square - q * q - radius * radius
        discriminant = qb * qb - qa * qc
        if discriminant <= 0.0 or qa <= 1e-12:
            continue
        root = math.sqrt(discriminant)
        for sign in (-1.0, 1.0):
            t = (-qb + sign * root) / qa
            if line.enter < t < line.leave and q + a * t < 0.0:
                cuts[n] = t
                n += 1
    return n


@merged
def _cut_points(scene, line, origin_sun, along_sun, cuts):
    """Where the integrand may have a kink, rising, both ends included; returns their number."""
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
    n = _shadow_edges(radius, line, origin_sun, along_sun, line.p * line.p, cuts, n)
    sort_few(cuts, n)
    return n


@kernel
def _agree(fine, coarse, limit):
    """Whether the pair of rules agrees within `limit` at every wavelength."""
    worst = 0.0
    for i in range(limit.size):
        worst = max(worst, abs(fine[i] - coarse[i]) - limit[i])
    return worst <= 0.0


@merged
def _scattered(scene, line, o, d, origin_sun, along_sun, tolerance, x_sun, work, first, limit, cuts, stack, out):
    """Singly scattered and emitted radiance along the line, into `out` (wavelength,).

    A first pass over whole pieces gives the scale against which their errors count; the pieces that fail are then
    halved until the pair of rules agrees.
    """
    pieces = _cut_points(scene, line, origin_sun, along_sun, cuts) - 1
    shortest = 1e-9 * (line.leave - line.enter)
    for i in range(out.size):
        out[i], limit[i] = 0.0, 0.0
    k, waiting = 0, 0
    while k < pieces or waiting > 0:
        if k < pieces:
            a, b = cuts[k], cuts[k + 1]
        else:
            waiting -= 1
            a, b = stack[waiting, 0], stack[waiting, 1]
        _integrate(scene, line, o, d, a, b, origin_sun, along_sun, x_sun, work)
        if k < pieces:
            for i in range(out.size):
                first[k, 0, i], first[k, 1, i] = work.fine[i], work.coarse[i]
                limit[i] += tolerance * abs(work.fine[i])  # with b1 in place of a1 the integrand is negative
            k += 1
            if k == pieces:
                waiting = _judge_first(pieces, first, limit, cuts, stack, out)
        elif _agree(work.fine, work.coarse, limit) or waiting + 2 > stack.shape[0] or b - a < shortest:
            for i in range(out.size):
                out[i] += work.fine[i]
        else:
            waiting = _push_halves(a, b, stack, waiting)


@kernel
def _push_halves(a, b, stack, waiting):
    """Put both halves of a piece on the stack; returns its new height."""
    middle = 0.5 * (a + b)
    stack[waiting, 0], stack[waiting, 1] = middle, b
    stack[waiting + 1, 0], stack[waiting + 1, 1] = a, middle
    return waiting + 2


@merged
def _judge_first(pieces, first, limit, cuts, stack, out):
    """Add the pieces on which the rules agree to `out`, and halve the others; returns the height of the stack."""
    waiting = 0
    for k in range(pieces):
        if _agree(first[k, 0], first[k, 1], limit):
            for i in range(out.size):
                out[i] += first[k, 0, i]
        else:
            waiting = _push_halves(cuts[k], cuts[k + 1], stack, waiting)
    return waiting


@kernel
def ground_light(scene, x_sun, work, out):
    """Radiance [W m-2 sr-1 nm-1] that sunlit ground of albedo 1 reflects, into `out`; `x_sun` as for `sunlight`."""
    radius = scene.columns.radius
    optics = scene.optics
    out[:] = 0.0
    for m in range(x_sun.size):
        mu_s = min(x_sun[m] / radius, 1.0)
        if mu_s <= 0.0:
            continue
        columns_to_light(scene.columns, radius, mu_s, work.spare, work.to_sun)
        transmittance(work.to_sun, optics.sigma_t, work.sun)
        for i in range(out.size):
            out[i] += work.sun[i] * mu_s * optics.sun_irradiance[m, i] / math.pi


@inlined
def cosine_of_light(points, d):
    """Cosine of the angle between a direction and the middle of the points of the disk that shine, (point, 3)."""
    x, y, z = 0.0, 0.0, 0.0
    for m in range(points.shape[0]):
        x, y, z = x + points[m, 0], y + points[m, 1], z + points[m, 2]
    return (d[0] * x + d[1] * y + d[2] * z) / math.sqrt(x * x + y * y + z * z)


@entry
def single_rays(scene, origins, directions, tolerance, scratch, scattered, ground, direct):
    """Single scattering of many rays.

    Parameters
    ----------
    scene : SceneTable
    origins, directions : (ray, 3)
        From the planet's centre [m]; unit vectors.
    tolerance : float
        Largest difference of the two rules on a piece, relative to the ray's radiance.
    scratch : tuple
        Made by `make_scratch` for this scene.
    scattered, ground, direct : (ray, wavelength), output
        Radiance scattered once by (and emitted from) the medium; reflected once by ground of albedo 1; straight
        from the Sun or the background [W m-2 sr-1 nm-1].
    """
    optics = scene.optics
    work, origin_sun, along_sun, x_sun, first, limit, cuts, stack = scratch
    for ray in range(origins.shape[0]):
        o, d = origins[ray], directions[ray]
        line = trace_line(scene.columns, o[0], o[1], o[2], d[0], d[1], d[2])
        for m in range(x_sun.size):
            s = optics.sun_direction[m]
            origin_sun[m] = o[0] * s[0] + o[1] * s[1] + o[2] * s[2]
            along_sun[m] = d[0] * s[0] + d[1] * s[1] + d[2] * s[2]
        for c in range(work.along.size):
            work.along[c] = 0.0
        for i in range(scattered.shape[1]):
            scattered[ray, i], ground[ray, i], direct[ray, i] = 0.0, 0.0, 0.0
        if line.leave > line.enter:
            start_columns(scene.columns, line, work.from_start, work.across)
            phase_at(optics.phase, cosine_of_light(optics.sun_direction, d), work.phase)
            weigh_phase(work.phase, optics.sigma_s, work.weighted)
            _scattered(
                scene, line, o, d, origin_sun, along_sun, tolerance, x_sun, work, first, limit, cuts, stack,
                scattered[ray],
            )  # fmt: skip
            columns_along(scene.columns, line, line.leave, work.from_start, work.across, work.along)
        transmittance(work.along, optics.sigma_t, work.through)
        if line.hits_ground:
            for m in range(x_sun.size):
                x_sun[m] = origin_sun[m] + (line.leave - line.start) * along_sun[m]
            ground_light(scene, x_sun, work, ground[ray])
            if scene.eclipse.share.size > 0:
                go = line.leave - line.start
                dim(scene.eclipse, o[0] + go * d[0], o[1] + go * d[1], o[2] + go * d[2], ground[ray])
            for i in range(scattered.shape[1]):
                ground[ray, i] *= work.through[i]
            continue
        covered = False
        if scene.eclipse.share.size > 0:
            covered = behind_moon(scene.eclipse, optics.disk_axis, o[0], o[1], o[2], d[0], d[1], d[2])
        if not covered and disk_radiance(optics, d[0], d[1], d[2], work.sun):
            for i in range(scattered.shape[1]):
                direct[ray, i] = work.sun[i] * work.through[i]
        for i in range(scattered.shape[1]):
            direct[ray, i] += optics.background[i] * work.through[i]


def make_scratch(scene: SceneTable) -> tuple[Any, ...]:
    """Scratch arrays of `single_rays`; a thread needs its own."""
    components, wavelengths = scene.optics.sigma_s.shape
    suns = scene.optics.sun_direction.shape[0]
    cuts = np.zeros(8 + 2 * scene.breaks.size + 2 * suns)
    return (
        make_work(components, wavelengths), np.zeros(suns), np.zeros(suns), np.zeros(suns),
        np.zeros((cuts.size, 2, wavelengths)), np.zeros(wavelengths), cuts, np.zeros((STACK, 2)),
    )  # fmt: skip
