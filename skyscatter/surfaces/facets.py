"""How much light the facets of a rough surface throw on no other facet."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Points of the golden lattice, the quadrature over facets: shares are right to 7e-4.
_LATTICE, _GOLDEN = 2048, 0.5 * (5**0.5 - 1)
#: Places of the table: by the indices of both sides, see `ratio_nodes`, and by the root of the cosine.
RATIOS, ANGLES = 129, 49
#: A mean loss below this is not made up for.
_NEGLIGIBLE = 1e-4


def _lambda(alpha: float, cosine: Array) -> Array:
    """Smith's Lambda of GGX (Heitz 2014, JCGT 3, 48, equation 72)."""
    return 0.5 * (np.sqrt(1 + alpha**2 * (1 - cosine**2) / cosine**2) - 1)


def _seen_normals(alpha: float, cosine: float, u: Array, v: Array) -> tuple[Array, Array]:
    """Of normals as they are seen: the cosine between each and the view, and that from the surface's normal.

    From pairs of even numbers by Heitz (2018, JCGT 7, 1).
    """
    r, turn = np.sqrt(u), 2 * np.pi * v
    sine = np.sqrt(1 - cosine * cosine)
    # The stretched view, and a point of the half disk that is seen from there.
    across = np.hypot(alpha * sine, cosine)
    x, z = alpha * sine / across, cosine / across
    p, q = r * np.cos(turn), r * np.sin(turn)
    q = 0.5 * ((1 - z) * np.sqrt(1 - p * p) + (1 + z) * q)
    w = np.sqrt(np.maximum(1 - p * p - q * q, 0))
    # Axes across the view: y, and -z x + x z.
    mx, my, mz = alpha * (w * x - q * z), alpha * p, np.maximum(w * z + q * x, 0)
    length = np.sqrt(mx**2 + my**2 + mz**2)
    return (mx * sine + mz * cosine) / length, mz / length


def ratio_nodes() -> Array:
    """Places (here - there) / (here + there) of the indices in the table: squares of even numbers, with their sign.

    Total reflection sets in with the root of that number: by its root nothing is steep.
    """
    even = np.linspace(-1, 1, RATIOS)
    return np.asarray(np.sign(even) * even**2)


def single_share(alpha: float, cosine: float, ratios: Array, points: int = _LATTICE) -> Array:
    """Share of light that a rough boundary reflects or refracts once and no more, (ratio,); ratios here / there.

    The mean over normals as they are seen: reflected light is seen with (1 + Lambda) / (1 + Lambda + Lambda'), what is
    refracted with 1 / (1 + Lambda'), as in `kernels.surfaces.ggx`.
    """
    number = np.arange(points)
    u, v = np.asarray((number + 0.5) / points), np.asarray(number * _GOLDEN % 1)
    towards, upright = _seen_normals(alpha, cosine, u, v)
    r = ratios[:, None]
    inside = 1 - r**2 * (1 - towards**2)
    beyond = np.sqrt(np.maximum(inside, 0))
    across, along = (r * towards - beyond) / (r * towards + beyond), (towards - r * beyond) / (towards + r * beyond)
    share = np.where(inside > 0, 0.5 * (across**2 + along**2), 1.0)
    back, through = 2 * towards * upright - cosine, r * cosine - (r * towards - beyond) * upright
    here = _lambda(alpha, np.array(cosine))
    seen_back = np.where(back > 1e-9, (1 + here) / (1 + here + _lambda(alpha, np.clip(back, 1e-9, 1))), 0)
    seen_through = np.where(through > 1e-9, 1 / (1 + _lambda(alpha, np.clip(through, 1e-9, 1))), 0)
    return np.asarray((share * seen_back + (1 - share) * seen_through).mean(axis=1))


@lru_cache(maxsize=64)
def lost_table(alpha: float) -> tuple[Array, Array]:
    """Share of light that a rough boundary throws on other facets, (ratio, angle), and its mean over angles (ratio,).

    Cosines are the squares of even numbers, so that grazing light is told apart.
    """
    lost = np.zeros((RATIOS, ANGLES))
    if alpha > 0:
        place = ratio_nodes()
        ratios = (1 + place) / np.maximum(1 - place, 1e-9)
        roots = np.maximum(np.linspace(0, 1, ANGLES), 3e-3)
        lost = np.maximum(np.stack([1 - single_share(alpha, c, ratios) for c in roots**2], axis=1), 0)
    # 2 c dc = 4 s^3 ds with the root s of the cosine; Gauss's rule of three points is exact for s^3 times a line.
    points, weights = np.polynomial.legendre.leggauss(3)
    step, mean = 1 / (ANGLES - 1), np.zeros(RATIOS)
    for x, w in zip(0.5 * (points + 1), 0.5 * weights, strict=True):
        s = (np.arange(ANGLES - 1) + x) * step
        mean += w * step * (4 * s**3 * (lost[:, :-1] + x * (lost[:, 1:] - lost[:, :-1]))).sum(axis=1)
    if mean.max() < _NEGLIGIBLE:
        lost, mean = np.zeros_like(lost), np.zeros_like(mean)
    for table in (lost, mean):
        table.flags.writeable = False
    return lost, mean
