"""Rough boundaries: mirrors too small to see, turned at random (Walter et al. 2007, EGSR, 195; "GGX").

All vectors are unit vectors; `n` is the normal on the side of `wo`, so n . wo > 0.  The lobes are those of a single
reflection or refraction: what a facet throws onto another one comes back by `kernels.surfaces.facets`.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined


@inlined
def smith_lambda(alpha, cosine):
    """Smith's Lambda: mean number of facets in the way of a direction (Heitz 2014, JCGT 3, 48, equation 72)."""
    tan2 = (1.0 - cosine) * (1.0 + cosine) / (cosine * cosine)
    # (sqrt(1 + x) - 1) / 2 without cancellation.
    x = alpha * alpha * max(tan2, 0.0)
    return 0.5 * x / (math.sqrt(1.0 + x) + 1.0)


@inlined
def slopes(alpha, nx, ny, nz, hx, hy, hz):
    """Distribution of normals D [sr-1] at the direction of a vector h of any length."""
    z = hx * nx + hy * ny + hz * nz
    px, py, pz = hx - z * nx, hy - z * ny, hz - z * nz
    a2 = alpha * alpha
    # cos^4 (1 + tan^2 / alpha^2)^2, from the part across n, so that no digits are lost where alpha is small.
    spread = (z * z + (px * px + py * py + pz * pz) / a2) / (hx * hx + hy * hy + hz * hz)
    return 1.0 / (math.pi * a2 * spread * spread)


@inlined
def reflected_lobe(alpha, n, side, wo, wi):
    """Reflection without Fresnel's factor: BRDF times cosine, and the cosine on the facet.

    Walter et al. equation 20 with the height-correlated shadowing 1 / (1 + Lambda + Lambda') (Heitz 2014, equation 99).
    Normals drawn as seen from `wo` have the density with 1 / (1 + Lambda) (Heitz 2018, JCGT 7, 1, equation 17): of
    them the share (1 + Lambda) / (1 + Lambda + Lambda') meets no other facet.  `side` n is the normal.
    """
    nx, ny, nz = side * n[0], side * n[1], side * n[2]
    cos_o = nx * wo[0] + ny * wo[1] + nz * wo[2]
    cos_i = nx * wi[0] + ny * wi[1] + nz * wi[2]
    if not (cos_o > 0.0 and cos_i > 0.0):
        return 0.0, 0.0
    hx, hy, hz = wo[0] + wi[0], wo[1] + wi[1], wo[2] + wi[2]
    facet = (hx * wo[0] + hy * wo[1] + hz * wo[2]) / math.sqrt(hx * hx + hy * hy + hz * hz)
    lobe = slopes(alpha, nx, ny, nz, hx, hy, hz) / (4.0 * cos_o)
    here, there = smith_lambda(alpha, cos_o), smith_lambda(alpha, cos_i)
    return lobe / (1.0 + here + there), min(facet, 1.0)


@inlined
def refracted_lobe(alpha, n, side, wo, wi, here, there):
    """Refraction without Fresnel's factor: BTDF times cosine for photons, and the cosine on the facet.

    Walter et al. equations 16, 17 and 21 with shadowing by the product of both sides: of the normals that are seen the
    share 1 / (1 + Lambda') meets no other facet.  Multiply by (here / there)^2 for radiance that arrives from `wi`.
    """
    nx, ny, nz = side * n[0], side * n[1], side * n[2]
    cos_o = nx * wo[0] + ny * wo[1] + nz * wo[2]
    cos_i = -(nx * wi[0] + ny * wi[1] + nz * wi[2])
    if not (cos_o > 0.0 and cos_i > 0.0) or here == there:
        return 0.0, 0.0
    hx, hy, hz = here * wo[0] + there * wi[0], here * wo[1] + there * wi[1], here * wo[2] + there * wi[2]
    if hx * nx + hy * ny + hz * nz < 0.0:
        hx, hy, hz = -hx, -hy, -hz
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    if length == 0.0:
        return 0.0, 0.0
    near = (hx * wo[0] + hy * wo[1] + hz * wo[2]) / length
    beyond = -(hx * wi[0] + hy * wi[1] + hz * wi[2]) / length
    if not (near > 0.0 and beyond > 0.0):
        return 0.0, 0.0
    # `length` is |here (wo . m) + there (wi . m)|: it is the projection of h on its own direction m.
    jacobian = there * there * beyond / (length * length)
    lobe = slopes(alpha, nx, ny, nz, hx, hy, hz) * near / cos_o * jacobian / (1.0 + smith_lambda(alpha, cos_o))
    return lobe / (1.0 + smith_lambda(alpha, cos_i)), min(near, 1.0)


@inlined
def draw_normal(alpha, ox, oy, oz, u, v):
    """A facet's normal as seen from (ox, oy, oz) in a frame whose z axis is the normal (Heitz 2018, listing 1)."""
    x, y, z = alpha * ox, alpha * oy, oz
    norm = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * norm, y * norm, z * norm
    across = math.sqrt(x * x + y * y)
    ax, ay = (-y / across, x / across) if across > 0.0 else (1.0, 0.0)
    bx, by, bz = -z * ay, z * ax, x * ay - y * ax
    r = math.sqrt(u)
    p, q = r * math.cos(2.0 * math.pi * v), r * math.sin(2.0 * math.pi * v)
    s = 0.5 * (1.0 + z)
    q = (1.0 - s) * math.sqrt(max(1.0 - p * p, 0.0)) + s * q
    w = math.sqrt(max(1.0 - p * p - q * q, 0.0))
    mx, my, mz = p * ax + q * bx + w * x, p * ay + q * by + w * y, q * bz + w * z
    mx, my, mz = alpha * mx, alpha * my, max(mz, 0.0)
    norm = math.sqrt(mx * mx + my * my + mz * mz)
    if norm == 0.0:
        return 0.0, 0.0, 1.0
    return mx / norm, my / norm, mz / norm
