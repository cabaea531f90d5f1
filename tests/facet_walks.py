"""Walks between the facets of rough glass: a judge that shares no code with the package.

Light flies through a landscape of GGX slopes whose heights are even and independent of the slopes (Smith's model), is
reflected or refracted by each facet that it meets, and goes on until it leaves (Heitz, Hanika, d'Eon & Dachsbacher
2016, ACM Trans. Graph. 35, 58).  Beneath the surface the same landscape is seen upside down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Facets at most: one walk in a million meets more.
MOST = 100


def smith(alpha: float, cosine: Array) -> Array:
    """Lambda of a direction; below 0 where it goes down."""
    cosine = np.where(np.abs(cosine) > 1e-9, cosine, 1e-9)
    return np.asarray(0.5 * (np.sign(cosine) * np.sqrt(1 + alpha**2 * (1 / cosine**2 - 1)) - 1))


def facets(alpha: float, towards: Array, rng: np.random.Generator) -> Array:
    """Normals (3, n) as seen from directions (3, n), whichever way these go (Heitz 2018, JCGT 7, 1)."""
    z = towards * np.array([[alpha], [alpha], [1.0]])
    z = z / np.linalg.norm(z, axis=0)
    flat = np.hypot(z[0], z[1])
    x = np.where(flat > 1e-12, [-z[1], z[0], 0 * flat], np.array([[1.0], [0.0], [0.0]])) / np.maximum(flat, 1e-12)
    x = x / np.linalg.norm(x, axis=0)
    y = np.cross(z, x, axis=0)
    r, phi, s = np.sqrt(rng.random(flat.size)), 2 * np.pi * rng.random(flat.size), 0.5 * (1 + z[2])
    p, q = r * np.cos(phi), r * np.sin(phi)
    q = (1 - s) * np.sqrt(1 - p * p) + s * q
    m = p * x + q * y + np.sqrt(np.maximum(1 - p * p - q * q, 0)) * z
    m = m * np.array([[alpha], [alpha], [1.0]])
    m[2] = np.maximum(m[2], 0)
    return np.asarray(m / np.linalg.norm(m, axis=0))


def meet(ratio: Array, d: Array, m: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """New directions (3, n) of light that flies along d and meets facets m, and whether it is reflected."""
    c = np.maximum(-(d * m).sum(axis=0), 0)
    beyond = np.emath.sqrt(1 - ratio**2 * (1 - c * c))
    across, along = (ratio * c - beyond) / (ratio * c + beyond), (c - ratio * beyond) / (c + ratio * beyond)
    share = 0.5 * (abs(across) ** 2 + abs(along) ** 2)
    back = rng.random(c.size) < share
    new = np.where(back, d + 2 * c * m, ratio * d + (ratio * c - beyond.real) * m)
    return new / np.linalg.norm(new, axis=0), back


def glass_walks(alpha: float, ratio: float, cosine: float, walks: int, seed: int = 1) -> tuple[float, float]:
    """Shares of light that are reflected and that pass, for an angle and the `ratio` of the indices here / there."""
    rng = np.random.default_rng(seed)
    d = np.repeat([[np.sqrt(1 - cosine * cosine)], [0.0], [-cosine]], walks, axis=1)
    height, above = np.ones(walks), np.ones(walks, bool)
    reflected = passed = 0
    for _ in range(MOST):
        # As the side on which the light flies sees it; `height` is the share of the landscape below.
        lam, u = smith(alpha, d[2]), rng.random(height.size)
        escape = np.where(d[2] > 0, height ** np.maximum(lam, 0), 0.0)
        leaves = u < escape
        reflected, passed = reflected + int((leaves & above).sum()), passed + int((leaves & ~above).sum())
        go = ~leaves
        if not go.any():
            break
        d, height, above, u, lam, escape = d[:, go], height[go], above[go], u[go], lam[go], escape[go]
        height = np.exp(np.clip(np.log(height) - np.log1p(-(u - escape)) / lam, -600, 0))
        d, back = meet(np.where(above, ratio, 1 / ratio), d, facets(alpha, -d, rng), rng)
        # Beyond the facet all is upside down.
        d[2], height = np.where(back, d[2], -d[2]), np.where(back, height, 1 - height)
        above = above == back
    return reflected / walks, passed / walks
