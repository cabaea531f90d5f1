"""Where the Sun stands for the air that rays see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def seen_zenith(origins: Array, directions: Array, sun: Array, radius: float, top: float) -> tuple[Array, Array]:
    """Least and greatest zenith angle of the Sun [rad] at points of every ray, (ray,); nan where it sees none."""
    along = np.einsum("rk,rk->r", origins, directions)
    square = np.einsum("rk,rk->r", origins, origins) - along**2
    outer = radius + top
    inside = (square < outer**2) & (along < np.sqrt(np.maximum(outer**2 - square, 0.0)))
    o, d, along, square = origins[inside], directions[inside], along[inside], square[inside]
    half = np.sqrt(outer**2 - square)
    hits = (square < radius**2) & (along < 0)
    end = np.where(hits, -np.sqrt(np.maximum(radius**2 - square, 0.0)), half)
    start = np.maximum(along, -half)
    share = np.linspace(0, 1, 9)[:, None]
    t = start + share * np.maximum(end - start, 0.0)  # from the point that is nearest to the planet's centre
    mu = (o @ sun + (t - along) * (d @ sun)) / np.sqrt(square + t * t)
    low, high = np.full((2, len(origins)), np.nan)
    low[inside], high[inside] = (np.arccos(np.clip(extreme, -1, 1)) for extreme in (mu.max(axis=0), mu.min(axis=0)))
    return low, high


def needed_zenith(origins: Array, directions: Array, sun: Array, radius: float, top: float) -> tuple[float, float]:
    """Least and greatest zenith angle of the Sun [rad] at points that rays can see; (nan, nan) if they see none."""
    low, high = seen_zenith(origins, directions, sun, radius, top)
    seen = low == low
    return (float(low[seen].min()), float(high[seen].max())) if seen.any() else (float("nan"), float("nan"))
