"""How much light the facets of a rough surface throw on no other facet."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Cosines at which the share is tabulated, even from 0 to 1.
NODES = 65
#: Points of the quadrature, along each of two numbers.
_POINTS = 96
#: A mean loss below this is not made up for.
_NEGLIGIBLE = 1e-4


def _lambda(alpha: float, cosine: Array) -> Array:
    """Smith's Lambda of GGX (Heitz 2014, JCGT 3, 48, equation 72)."""
    return 0.5 * (np.sqrt(1 + alpha**2 * (1 - cosine**2) / cosine**2) - 1)


def single_share(alpha: float, cosines: Array) -> Array:
    """Share of light that a lossless mirror with GGX slopes reflects once and no more, shape (cosine,).

    The mean of (1 + Lambda) / (1 + Lambda + Lambda') over normals as they are seen (Heitz 2018, JCGT 7, 1).
    """
    u, v = (x.ravel() for x in np.meshgrid(*[(np.arange(_POINTS) + 0.5) / _POINTS] * 2))
    r, turn = np.sqrt(u), 2 * np.pi * v
    result = np.empty(cosines.size)
    for k, c in enumerate(cosines):
        sine = np.sqrt(1 - c * c)
        # The stretched view, and a point of the half disk that is seen from there.
        across = np.hypot(alpha * sine, c)
        x, z = alpha * sine / across, c / across
        p, q = r * np.cos(turn), r * np.sin(turn)
        q = 0.5 * ((1 - z) * np.sqrt(1 - p * p) + (1 + z) * q) + 0 * p
        w = np.sqrt(np.maximum(1 - p * p - q * q, 0))
        # Axes across the view: y, and -z x + x z.
        mx, my, mz = alpha * (w * x - q * z), alpha * p, np.maximum(w * z + q * x, 0)
        length = np.sqrt(mx**2 + my**2 + mz**2)
        towards = (mx * sine + mz * c) / length
        out = 2 * towards * mz / length - c
        up = out > 1e-9
        here, there = _lambda(alpha, np.array(c)), _lambda(alpha, np.clip(out[up], None, 1.0))
        result[k] = ((1 + here) / (1 + here + there)).sum() / out.size
    return result


@lru_cache(maxsize=64)
def kept_table(alpha: float) -> tuple[Array, float]:
    """Share at `NODES` even cosines, not less than the true one in between, and its mean over directions.

    What is made up for is what is missing from the table: so it never comes to more than what came.
    """
    if alpha == 0:
        return np.ones(NODES), 1.0
    nodes = np.maximum(np.arange(NODES) / (NODES - 1), 1e-5)
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    kept = single_share(alpha, nodes)
    short = single_share(alpha, middles) - 0.5 * (kept[1:] + kept[:-1])
    lift = np.maximum(short, 0)
    kept = kept + np.maximum(np.append(lift, 0), np.append(0, lift)) + 1e-4
    kept = np.minimum(kept, 1.0)
    kept.flags.writeable = False
    # 2 c times a line, integrated over each cell.
    low, high, a, b = nodes[:-1], nodes[1:], kept[:-1], kept[1:]
    mean = ((high - low) * (a * (2 * low + high) + b * (low + 2 * high))).sum() / 3
    return (kept, float(mean)) if mean < 1 - _NEGLIGIBLE else (np.ones(NODES), 1.0)
