"""Tables: the cell of a number, the cell of a scattering angle, and draws from densities that are linear in cells."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import inlined


@inlined
def cell_of(rising, first, last, x):
    """Number n from `first` to `last` - 1 with rising[n] <= x < rising[n + 1]; beyond both ends the outermost."""
    low, high = first, last
    while high - low > 1:
        middle = (low + high) >> 1
        if rising[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@inlined
def first_above(cdf, first, last, u):
    """Number of the first entry from `first` to `last` of a distribution function above u; the last if none is."""
    low, high = first, last
    while low < high:
        middle = (low + high) >> 1
        if cdf[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@inlined
def angle_cell(cosine, last):
    """Cell of a table at the cosines 1 - 2 (k / last)^2, dense where light goes on, and the place in it from 0 to 1."""
    k = min(int(math.sqrt(max(0.5 * (1.0 - cosine), 0.0)) * last), last - 1)
    scale = 2.0 / (last * last)
    # Nodes fall from +1: mu_k - mu_(k+1) = 2 (2 k + 1) / n^2.
    return k, min(max((1.0 - scale * k * k - cosine) / (scale * (2 * k + 1)), 0.0), 1.0)


@inlined
def draw_in_cell(p0, p1, cdf, n, u):
    """Place from 0 to 1 in cell n of a distribution whose density goes evenly from p0 to p1; u is the random number.

    The solution of p0 x + (p1 - p0) x^2 / 2 = share of the cell, stable for all densities.
    """
    share = 0.5 * (p0 + p1) * (u - cdf[n]) / max(cdf[n + 1] - cdf[n], 1e-300)
    root = math.sqrt(max(p0 * p0 + 2.0 * (p1 - p0) * share, 0.0))
    return min(max(2.0 * share / max(p0 + root, 1e-300), 0.0), 1.0)
