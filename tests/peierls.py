"""The transport equation in a uniform sphere around a star, solved without any walk.

Isotropic scattering of albedo c, optical depth tau of the radius 1.  The fluence of scattered light phi, times the
radius and continued as an odd function s(r) = r phi(r), obeys Peierls' equation of a slab (Case & Zweifel 1967, Linear
Transport Theory, section 2.7),

    s(r) = s1(r) + (c tau / 2) int_{-1}^{1} E1(tau |r - r'|) s(r') dr',

with s1 that of light scattered once.  s is a line between nodes, against which the kernel is integrated in closed form.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import exp1

Array = NDArray[np.float64]


def _nodes(tau: float, count: int) -> Array:
    """Radii from 0 to 1: equal steps, and more of them close to the star and to the surface."""
    plain = np.linspace(0.0, 1.0, count + 1)
    fine = np.geomspace(1e-3 / (count * max(tau, 1.0)), 1.0 / max(tau, 4.0), count // 3)
    nodes = np.unique(np.concatenate([plain, fine, 1 - fine]))
    # Nodes that rounding alone holds apart make elements without a slope.
    return nodes[np.concatenate([[True], np.diff(nodes) > 1e-9 / max(tau, 1.0)])]


def _moments(x: Array, tau: float) -> tuple[Array, Array]:
    """Integrals of E1(tau |y|) and of y E1(tau |y|) from 0 to x."""
    a = np.maximum(tau * np.abs(x), 1e-300)
    e = exp1(a)
    # int_0^a E1 = a E1(a) + 1 - exp(-a);  int_0^a t E1 = (a^2 E1(a) + 1 - (1 + a) exp(-a)) / 2.
    zero = (a * e - np.expm1(-a)) / tau
    one = 0.5 * (a * a * e - np.expm1(-a) - a * np.exp(-a)) / tau**2
    return np.sign(x) * zero, one


def _between(low: Array, high: Array, tau: float) -> tuple[Array, Array]:
    """Integrals of E1(tau |y|) and of (y - low) E1(tau |y|) from low to high, which are on one side of 0.

    Closed forms near the singularity; Gauss's rule where their differences would be lost in rounding.
    """
    zero_low, one_low = _moments(low, tau)
    zero_high, one_high = _moments(high, tau)
    zero, one = zero_high - zero_low, one_high - one_low - low * (zero_high - zero_low)
    away = np.minimum(np.abs(low), np.abs(high)) > np.abs(high - low)
    x, w = leggauss(5)
    y, width = low[away, None] + (high - low)[away, None] * 0.5 * (x + 1), (high - low)[away]
    kernel = exp1(tau * np.abs(y)) * 0.5 * w
    zero[away] = width * kernel.sum(axis=1)
    one[away] = width * (kernel * (y - low[away, None])).sum(axis=1)
    return zero, one


def _matrix(r: Array, tau: float) -> Array:
    """Integrals of the kernel with the linear elements of the nodes, shape (node, node)."""
    n = r.size
    matrix = np.zeros((n, n))
    for sign in (1.0, -1.0):
        low, high = r[None, :-1] - sign * r[:, None], r[None, 1:] - sign * r[:, None]
        zero, one = _between(low, high, tau)
        rise = one / (high - low)
        matrix[:, 1:] += sign * rise
        matrix[:, :-1] += sign * (zero - rise)
    return matrix


def _scattered_once(r: Array, tau: float, albedo: float) -> Array:
    """Radius times the fluence of light scattered once, from exp(-tau r') / (4 pi r'^2)."""
    x, w = leggauss(40)
    out = np.zeros_like(r)
    for i, here in enumerate(r):
        if here <= 0.0:
            continue
        total = 0.0
        # Both ends of each piece may be singular (1 / r', ln |r - r'|): powers of the distance make them smooth.
        edges = [0.0, 0.5 * here, here, min(2 * here, 0.5 * (1 + here)), 1.0]
        for k, (low, high) in enumerate(pairwise(edges)):
            if not high > low:
                continue
            u = (0.5 * (x + 1)) ** 4
            step = 0.5 * w * 4 * (0.5 * (x + 1)) ** 3
            y = high - (high - low) * u if k == 1 else low + (high - low) * u
            kernel = exp1(np.maximum(tau * np.abs(here - y), 1e-300)) - exp1(tau * (here + y))
            total += (high - low) * float(np.sum(step * kernel * np.exp(-tau * y) / (4 * np.pi * y)))
        out[i] = 0.5 * albedo * tau * total
    return out


def escaping_share(tau: float, albedo: float, count: int = 120) -> float:
    """Scattered light that leaves the sphere, as a share of the luminosity of the star in its centre.

    The elements are of the second order, so two solutions tell what finer ones would give.
    """
    coarse, fine = (_escaping_share(tau, albedo, n) for n in (count, 2 * count))
    return fine * (fine / coarse) ** (1 / 3)


def _escaping_share(tau: float, albedo: float, count: int) -> float:
    """The same with so many elements; all terms are positive, so that small shares are as accurate as large ones."""
    r = _nodes(tau, count)
    first = _scattered_once(r, tau, albedo)
    s = np.linalg.solve(np.eye(r.size) - 0.5 * albedo * tau * _matrix(r, tau), first)
    x, w = leggauss(24)
    y, v = leggauss(200)
    share = 0.0
    edges = np.concatenate([[0.0], np.geomspace(1e-4 / max(tau, 1.0), 0.5, 30)])
    edges = np.unique(np.concatenate([edges, 1 - edges]))
    for low, high in pairwise(edges):
        radius = 0.5 * (low + high) + 0.5 * (high - low) * x
        # Chance to leave unscattered; the square-root behaviour at the tangent is inside the substitution mu = cos.
        mu = np.cos(0.5 * np.pi * (y + 1))
        weight = v * 0.5 * np.pi * np.sin(0.5 * np.pi * (y + 1))
        length = -radius[:, None] * mu + np.sqrt(1 - (1 - mu**2) * radius[:, None] ** 2)
        leaves = 0.5 * np.exp(-tau * length) @ weight
        direct = np.exp(-tau * radius)
        scattered = 4 * np.pi * radius * np.interp(radius, r, s)
        share += float(0.5 * (high - low) * np.sum(w * albedo * tau * (direct + scattered) * leaves))
    return share
