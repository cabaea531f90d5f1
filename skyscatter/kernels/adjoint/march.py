"""Light along rays through voxels: the image, its change with the densities (tangent) and the way back (adjoint).

Where the nodes of the quadrature lie depends on the rays, the grid and the stars alone, never on the densities.  The
image is therefore a smooth function of the densities, and the derivatives below are those of the sums as they are
computed, exact to rounding.  A ray is walked once; what the way back needs is kept in `Scratch`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, inlined

#: Distance within which a place is on the face of a cell [cell].
ON_FACE = 1e-8


@by_address
class MarchTable(NamedTuple):
    """Grid, optics and lights.  Sizes: node, column node, component (c), star (s), wavelength (w), angle."""

    density: np.ndarray  #: (node, c) at the padded nodes, x slowest
    toward: np.ndarray  #: (column node, s, c) mean density towards a star, or the column [m] to a distant one
    shape: np.ndarray  #: (3,) padded nodes along each axis
    fine: int  #: cells of the column grid along a side of a cell
    low: np.ndarray  #: (3,) place of the first padded node [m]
    inverse: np.ndarray  #: (3,) one over the sides of a cell [m-1]
    sigma_s: np.ndarray  #: (c, w) [m-1]
    sigma_t: np.ndarray  #: (c, w)
    emission: np.ndarray  #: (c, w)
    phase: np.ndarray  #: (c, angle, w) at cos = 1 - 2 (k / n)^2
    power: np.ndarray  #: (s, w) radiant intensity, or irradiance of a distant light
    place: np.ndarray  #: (s, 3) where the star is, or the direction to a distant one
    distant: np.ndarray  #: (s,) bool
    size: np.ndarray  #: (s,) distance within which light stops growing [m]
    background: np.ndarray  #: (w,)
    step: float  #: longest step [m]
    emits: bool  #: whether emission, or its derivative, is wanted
    near: float  #: longest step as a share of the distance to the nearest star
    constant: bool  #: densities and light are constant within cells
    spread: np.ndarray  #: (node, s) mean of 1 / distance^2 over the cell of a node [m-2], where they are constant


@by_address
class Scratch(NamedTuple):
    """What is kept of a ray, node by node (n)."""

    at: np.ndarray  #: (n, 3) place in cells
    length: np.ndarray  #: (n,) [m]
    rho: np.ndarray  #: (n, c)
    toward: np.ndarray  #: (n, s, c)
    far: np.ndarray  #: (n, s) distance to the star [m]; 1 for a distant one
    angle: np.ndarray  #: (n, s) place in the phase table
    seen: np.ndarray  #: (n, w) length times transmittance to the observer
    lit: np.ndarray  #: (n, s, w) geometry times transmittances to star and observer
    column: np.ndarray  #: (c,)
    through: np.ndarray  #: (w,) transmittance of the whole ray
    closest: np.ndarray  #: (s, 2) place along the ray that is closest to a star, and its distance [m]
    by_c: np.ndarray  #: (c,)
    by_sc: np.ndarray  #: (s, c)
    by_w: np.ndarray  #: (4, w)


@by_address
class Slopes(NamedTuple):
    """Derivatives of a number with respect to everything, summed over rays."""

    density: np.ndarray  #: (node, c)
    toward: np.ndarray  #: (column node, s, c)
    sigma_s: np.ndarray  #: (c, w)
    sigma_t: np.ndarray  #: (c, w)
    emission: np.ndarray  #: (c, w)
    phase: np.ndarray  #: (c, w) parameter of the phase function
    power: np.ndarray  #: (s, w)
    background: np.ndarray  #: (w,)


@inlined
def nearest(u, count):
    """Node of the cell around a place; rounding may lead a ray's ends out of the cells proper by a hair."""
    return min(max(int(u + 0.5), 1), count - 2)


@inlined
def corner(u, v, w, n0, n1, n2, constant):
    """Number of the lowest node around a place in cells, and the place within the cell.

    Where densities are `constant` within cells, the node whose cell it is: the place there does not matter.
    """
    if constant:
        i, j, k = nearest(u, n0), nearest(v, n1), nearest(w, n2)
        return (i * n1 + j) * n2 + k, 0.0, 0.0, 0.0
    i, j, k = min(max(int(u), 0), n0 - 2), min(max(int(v), 0), n1 - 2), min(max(int(w), 0), n2 - 2)
    return (i * n1 + j) * n2 + k, u - i, v - j, w - k


@inlined
def gather(values, first, f, g, h, n1, n2, out):
    """Trilinear interpolation of values (node, c) in the cell whose lowest node is `first`."""
    x, y = n1 * n2, n2
    for c in range(out.size):
        a = (1 - h) * values[first, c] + h * values[first + 1, c]
        b = (1 - h) * values[first + y, c] + h * values[first + y + 1, c]
        d = (1 - h) * values[first + x, c] + h * values[first + x + 1, c]
        e = (1 - h) * values[first + x + y, c] + h * values[first + x + y + 1, c]
        out[c] = (1 - f) * ((1 - g) * a + g * b) + f * ((1 - g) * d + g * e)


@inlined
def scatter(values, first, f, g, h, n1, n2, amount):
    """Transpose of `gather`: add an amount (c,) to the eight nodes."""
    x, y = n1 * n2, n2
    for c in range(amount.size):
        p, q = (1 - f) * amount[c], f * amount[c]
        a, b, d, e = (1 - g) * p, g * p, (1 - g) * q, g * q
        values[first, c] += (1 - h) * a
        values[first + 1, c] += h * a
        values[first + y, c] += (1 - h) * b
        values[first + y + 1, c] += h * b
        values[first + x, c] += (1 - h) * d
        values[first + x + 1, c] += h * d
        values[first + x + y, c] += (1 - h) * e
        values[first + x + y + 1, c] += h * e


@entry
def clip(m, o, d):
    """Where a ray enters and leaves the box of the padded nodes, or that of the cells proper."""
    start, end, edge = 0.0, np.inf, 0.5 if m.constant else 0.0
    for k in range(3):
        a, b = (o[k] - m.low[k]) * m.inverse[k] - edge, d[k] * m.inverse[k]
        top = float(m.shape[k] - 1) - 2.0 * edge
        if b == 0.0:
            if a <= 0.0 or a >= top:
                return 0.0, 0.0
        else:
            p, q = -a / b, (top - a) / b
            start, end = max(start, min(p, q)), min(end, max(p, q))
    return start, end


@inlined
def depth_within(x):
    """Optical depth into a step of depth x at which its light is seen on average, -log((1 - exp(-x)) / x)."""
    if x < 0.5:
        y = x * x
        return 0.5 * x - y * (1 / 24 - y * (1 / 2880 - y * (1 / 181440 - y / 9676800)))
    return -math.log(-math.expm1(-x) / x)


@inlined
def slope_within(x):
    """Derivative of `depth_within`."""
    if x < 0.5:
        y = x * x
        return 0.5 - x * (1 / 12 - y * (1 / 720 - y * (1 / 30240 - y / 1209600)))
    return 1.0 / x - 1.0 / math.expm1(x)


@inlined
def visit(m, o, d, t, h, n, s, light):
    """One node in the middle of the step from t to t + h: read the densities, add its light."""
    middle = t + 0.5 * h
    u = (o[0] + middle * d[0] - m.low[0]) * m.inverse[0]
    v = (o[1] + middle * d[1] - m.low[1]) * m.inverse[1]
    w = (o[2] + middle * d[2] - m.low[2]) * m.inverse[2]
    s.at[n, 0], s.at[n, 1], s.at[n, 2], s.length[n] = u, v, w, h
    first, e, f, g = corner(u, v, w, m.shape[0], m.shape[1], m.shape[2], m.constant)
    rho = s.rho[n]
    gather(m.density, first, e, f, g, m.shape[1], m.shape[2], rho)
    depth, count = s.by_w[0], m.background.size
    within = s.by_w[1]
    for i in range(count):
        depth[i] = 0.0
        within[i] = 0.0
        s.seen[n, i] = 0.0
    for c in range(rho.size):
        column, own = s.column[c], h * rho[c]
        s.column[c] += own
        for i in range(count):
            depth[i] += column * m.sigma_t[c, i]
            within[i] += own * m.sigma_t[c, i]
            s.seen[n, i] += rho[c] * m.emission[c, i]
    for i in range(count):
        depth[i] += depth_within(within[i])
    if m.emits:
        for i in range(count):
            emitted, s.seen[n, i] = s.seen[n, i], h * math.exp(-depth[i])
            light[i] += emitted * s.seen[n, i]
    if m.place.shape[0] == 0:
        return
    n1, n2 = (m.shape[1] - 1) * m.fine + 1, (m.shape[2] - 1) * m.fine + 1
    n0 = (m.shape[0] - 1) * m.fine + 1
    first, e, f, g = corner(u * m.fine, v * m.fine, w * m.fine, n0, n1, n2, m.constant)
    for k in range(m.place.shape[0]):
        gather(m.toward[:, k], first, e, f, g, n1, n2, s.toward[n, k])
        geometry = fill(m, d, h, n, k, s) if m.constant else illuminate(m, o, d, t, h, n, k, s)
        last, share = phase_cell(s.angle[n, k], m.phase.shape[1])
        for i in range(count):
            tau, source = depth[i], 0.0
            for c in range(rho.size):
                tau += s.far[n, k] * s.toward[n, k, c] * m.sigma_t[c, i]
                p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
                source += rho[c] * m.sigma_s[c, i] * p
            s.lit[n, k, i] = geometry * math.exp(-tau)
            light[i] += m.power[k, i] * s.lit[n, k, i] * source


@inlined
def illuminate(m, o, d, t, h, n, k, s):
    """Distance and scattering angle at a node, and the integral of 1 / distance^2 over its step (h, when distant)."""
    if m.distant[k]:
        s.far[n, k] = 1.0
        mu = d[0] * m.place[k, 0] + d[1] * m.place[k, 1] + d[2] * m.place[k, 2]
        geometry = h
    else:
        before, apart = t - s.closest[k, 0], s.closest[k, 1]
        beyond = before + 0.5 * h
        s.far[n, k] = math.sqrt(apart * apart + beyond * beyond)
        mu = -beyond / s.far[n, k]
        # The angle that the step fills as seen from the star, over the distance of the ray: Kulla & Fajardo (2012).
        x, y = apart * apart + before * (before + h), apart * h
        if 25.0 * y < x:
            q = (y / x) * (y / x)
            geometry = h / x * (1.0 - q * (1 / 3 - q * (1 / 5 - q * (1 / 7 - q * (1 / 9 - q / 11)))))
        else:
            geometry = math.atan2(y, x) / apart
    # Light runs from the star to the node and then against the ray: the cosine is that of d and the star's direction.
    s.angle[n, k] = (m.phase.shape[1] - 1) * math.sqrt(max(0.5 * (1.0 - mu), 0.0))
    return geometry


@inlined
def fill(m, d, h, n, k, s):
    """As `illuminate`, where the light is that of the cell's middle but for its 1 / distance^2, the mean over it."""
    i, j = nearest(s.at[n, 0], m.shape[0]), nearest(s.at[n, 1], m.shape[1])
    last = nearest(s.at[n, 2], m.shape[2])
    if m.distant[k]:
        s.far[n, k] = 1.0
        mu = d[0] * m.place[k, 0] + d[1] * m.place[k, 1] + d[2] * m.place[k, 2]
    else:
        x = m.place[k, 0] - m.low[0] - i / m.inverse[0]
        y = m.place[k, 1] - m.low[1] - j / m.inverse[1]
        z = m.place[k, 2] - m.low[2] - last / m.inverse[2]
        s.far[n, k] = math.sqrt(x * x + y * y + z * z)
        mu = (d[0] * x + d[1] * y + d[2] * z) / s.far[n, k] if s.far[n, k] > 0.0 else 0.0
    s.angle[n, k] = (m.phase.shape[1] - 1) * math.sqrt(max(0.5 * (1.0 - mu), 0.0))
    return h * m.spread[(i * m.shape[1] + j) * m.shape[2] + last, k]


@inlined
def next_face(m, o, d, t, end):
    """Where a ray leaves the cell that it is in at t, at `end` at the latest."""
    after = end
    for k in range(3):
        a, b = (o[k] - m.low[k]) * m.inverse[k] + 0.5, d[k] * m.inverse[k]
        if b > 0.0:
            after = min(after, (math.floor(a + t * b + ON_FACE) + 1.0 - a) / b)
        elif b < 0.0:
            after = min(after, (math.ceil(a + t * b - ON_FACE) - 1.0 - a) / b)
    return after


@inlined
def phase_cell(angle, nodes):
    """Cell of the phase table and the place in it, linear in the cosine."""
    last = min(int(angle), nodes - 2)
    return last, (angle * angle - last * last) / (2.0 * last + 1.0)


@entry
def trace(m, o, d, s, light):
    """Walk a ray; its light (w,), and how many nodes it has."""
    start, end = clip(m, o, d)
    n, stars = 0, m.place.shape[0]
    for i in range(light.size):
        light[i] = 0.0
    for c in range(s.column.size):
        s.column[c] = 0.0
    if end > start:
        for k in range(stars):
            if not m.distant[k]:
                a, b, c = m.place[k, 0] - o[0], m.place[k, 1] - o[1], m.place[k, 2] - o[2]
                e, f, g = b * d[2] - c * d[1], c * d[0] - a * d[2], a * d[1] - b * d[0]
                s.closest[k, 0] = a * d[0] + b * d[1] + c * d[2]
                s.closest[k, 1] = max(math.sqrt(e * e + f * f + g * g), m.size[k])
        t = start
        while t < end and n < s.length.size:
            if m.constant:
                after = next_face(m, o, d, t, end)
            else:
                h = m.step
                for k in range(stars):
                    if not m.distant[k]:
                        far = t - s.closest[k, 0]
                        h = min(h, m.near * math.sqrt(s.closest[k, 1] * s.closest[k, 1] + far * far))
                after = min(t + h, end)
            visit(m, o, d, t, after - t, n, s, light)
            t, n = after, n + 1
    for i in range(light.size):
        depth = 0.0
        for c in range(s.column.size):
            depth += s.column[c] * m.sigma_t[c, i]
        s.through[i] = math.exp(-depth)
        light[i] += m.background[i] * s.through[i]
    return n


@entry
def turn_back(m, n, s, g, slope, optics, out):
    """Add the derivatives of sum(g light) of the ray just walked; `slope` is that of the phase tables."""
    later, own, part = s.by_w[0], s.by_w[1], s.by_w[2]
    components, count = s.column.size, g.size
    for i in range(count):
        later[i] = g[i] * m.background[i] * s.through[i]
        if optics:
            out.background[i] += g[i] * s.through[i]
            for c in range(components):
                out.sigma_t[c, i] -= s.column[c] * later[i]
    n1, n2 = (m.shape[1] - 1) * m.fine + 1, (m.shape[2] - 1) * m.fine + 1
    for node in range(n - 1, -1, -1):
        rho, h = s.rho[node], s.length[node]
        for i in range(count):
            own[i] = 0.0
        for c in range(components):
            total = 0.0
            for i in range(count):
                weight = g[i] * s.seen[node, i]
                total += weight * m.emission[c, i]
                own[i] += weight * m.emission[c, i] * rho[c]
                if optics:
                    out.emission[c, i] += weight * rho[c]
            s.by_c[c] = total
        for k in range(m.place.shape[0]):
            last, share = phase_cell(s.angle[node, k], m.phase.shape[1])
            for i in range(count):
                part[i] = 0.0
            for c in range(components):
                total = 0.0
                for i in range(count):
                    weight = g[i] * s.lit[node, k, i]
                    p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
                    bright = weight * m.power[k, i] * m.sigma_s[c, i] * p
                    total += bright
                    part[i] += bright * rho[c]
                    if optics:
                        out.power[k, i] += weight * m.sigma_s[c, i] * p * rho[c]
                        out.sigma_s[c, i] += weight * m.power[k, i] * p * rho[c]
                        q = (1 - share) * slope[c, last, i] + share * slope[c, last + 1, i]
                        out.phase[c, i] += weight * m.power[k, i] * m.sigma_s[c, i] * q * rho[c]
                s.by_c[c] += total
            for c in range(components):
                total = 0.0
                for i in range(count):
                    total += m.sigma_t[c, i] * part[i]
                    if optics:
                        out.sigma_t[c, i] -= s.far[node, k] * s.toward[node, k, c] * part[i]
                s.by_sc[k, c] = -s.far[node, k] * total
            for i in range(count):
                own[i] += part[i]
        for i in range(count):
            part[i] = 0.0
            for c in range(components):
                part[i] += h * rho[c] * m.sigma_t[c, i]
            part[i] = slope_within(part[i])
        for c in range(components):
            s.column[c] -= h * rho[c]
            total = 0.0
            for i in range(count):
                total += m.sigma_t[c, i] * (later[i] + part[i] * own[i])
                if optics:
                    out.sigma_t[c, i] -= (s.column[c] + part[i] * h * rho[c]) * own[i]
            s.by_c[c] -= h * total
        for i in range(count):
            later[i] += own[i]
        u, v, w = s.at[node, 0], s.at[node, 1], s.at[node, 2]
        first, a, b, e = corner(u, v, w, m.shape[0], m.shape[1], m.shape[2], m.constant)
        scatter(out.density, first, a, b, e, m.shape[1], m.shape[2], s.by_c)
        if m.place.shape[0] > 0:
            n0 = (m.shape[0] - 1) * m.fine + 1
            first, a, b, e = corner(u * m.fine, v * m.fine, w * m.fine, n0, n1, n2, m.constant)
            for k in range(m.place.shape[0]):
                scatter(out.toward[:, k], first, a, b, e, n1, n2, s.by_sc[k])


@entry
def go_on(m, n, s, density, toward, out):
    """Change of the light of the ray just walked when the tables change by `density` and `toward`."""
    components, count = s.column.size, out.size
    n1, n2 = (m.shape[1] - 1) * m.fine + 1, (m.shape[2] - 1) * m.fine + 1
    shade = s.by_w[0]
    for c in range(components):
        s.column[c] = 0.0
    for node in range(n):
        u, v, w = s.at[node, 0], s.at[node, 1], s.at[node, 2]
        h, rho, change = s.length[node], s.rho[node], s.by_c
        first, a, b, e = corner(u, v, w, m.shape[0], m.shape[1], m.shape[2], m.constant)
        gather(density, first, a, b, e, m.shape[1], m.shape[2], change)
        for i in range(count):
            shade[i], more, now, within = 0.0, 0.0, 0.0, 0.0
            for c in range(components):
                within += h * rho[c] * m.sigma_t[c, i]
            within = slope_within(within)
            for c in range(components):
                shade[i] += (s.column[c] + within * h * change[c]) * m.sigma_t[c, i]
                more += change[c] * m.emission[c, i]
                now += rho[c] * m.emission[c, i]
            out[i] += s.seen[node, i] * (more - now * shade[i])
        n0 = (m.shape[0] - 1) * m.fine + 1
        first, a, b, e = corner(u * m.fine, v * m.fine, w * m.fine, n0, n1, n2, m.constant)
        for k in range(m.place.shape[0]):
            gather(toward[:, k], first, a, b, e, n1, n2, s.by_sc[k])
            last, share = phase_cell(s.angle[node, k], m.phase.shape[1])
            for i in range(count):
                dark, more, now = shade[i], 0.0, 0.0
                for c in range(components):
                    p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
                    dark += s.far[node, k] * s.by_sc[k, c] * m.sigma_t[c, i]
                    more += change[c] * m.sigma_s[c, i] * p
                    now += rho[c] * m.sigma_s[c, i] * p
                out[i] += m.power[k, i] * s.lit[node, k, i] * (more - now * dark)
        for c in range(components):
            s.column[c] += h * change[c]
    for i in range(count):
        for c in range(components):
            out[i] -= m.background[i] * s.through[i] * s.column[c] * m.sigma_t[c, i]


@entry
def image_rays(m, origins, directions, s, light):
    """Light (ray, w) along rays."""
    for r in range(origins.shape[0]):
        trace(m, origins[r], directions[r], s, light[r])


@entry
def adjoint_rays(m, origins, directions, s, light, data, weight, fused, slope, optics, out):
    """Light along rays, and the derivatives of sum(weight light), or (`fused`) of sum(weight (light - data)^2) / 2."""
    g = s.by_w[3]
    for r in range(origins.shape[0]):
        n = trace(m, origins[r], directions[r], s, light[r])
        for i in range(g.size):
            g[i] = weight[r, i] * (light[r, i] - data[r, i]) if fused else weight[r, i]
        turn_back(m, n, s, g, slope, optics, out)


@entry
def tangent_rays(m, origins, directions, s, density, toward, light, change):
    """Light along rays and its change with that of the tables."""
    for r in range(origins.shape[0]):
        n = trace(m, origins[r], directions[r], s, light[r])
        go_on(m, n, s, density, toward, change[r])
