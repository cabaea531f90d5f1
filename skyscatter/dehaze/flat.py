"""A flat atmosphere of a few layers, unpolarised, by adding and doubling: quick, for differences between aerosols.

The terms of a pixel (`skyscatter.dehaze.forward`) of hundreds of atmospheres in a second.  What is left out, roundness
and polarisation, changes those of two aerosols nearly alike.  Multiple scattering is taken as the azimuth's
mean with phase functions cut at the degree of twice the directions of a hemisphere (Wiscombe 1977, J. Atmos. Sci. 34,
1408), light scattered once with the whole phase function (Nakajima & Tanaka 1988, J. Quant. Spectrosc. Radiat.
Transfer 40, 51).  Adding: Hansen & Travis 1974, Space Sci. Rev. 16, 527, eqs. 53 to 57.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONS = 6  #: of a hemisphere
DEGREE = 2 * DIRECTIONS
THINNEST = 1e-4  #: optical depth at which doubling starts, at most
#: Heights [m] between layers, and scale heights of air and aerosol: enough for both to keep their order.
BETWEEN = (4600.0, 1400.0)
AIR_HEIGHT, AEROSOL_HEIGHT = 8000.0, 2000.0


class Haze(NamedTuple):
    """Optics of haze; the first axes (...) are any.

    Attributes
    ----------
    extinction, albedo : (...)
        Optical depth, and share of it that scatters.
    moments : (..., DEGREE + 1)
        Of the phase function, Legendre, the first of them 1.
    phase : (..., angle)
        The phase function, 1 on the average over the sphere, at the scattering angles of the places asked for.
    """

    extinction: Array
    albedo: Array
    moments: Array
    phase: Array


class _Layer(NamedTuple):
    """Diffuse reflection and transmission from above and below (..., out, in), and what goes straight (..., in)."""

    up: Array
    down: Array
    up_below: Array
    down_below: Array
    straight: Array


class FlatTerms(NamedTuple):
    """Dimensionless: path (..., angle), through (..., cosine) from Sun to ground or ground to sensor, back (...)."""

    path: Array
    through: Array
    back: Array


def rayleigh_moments() -> Array:
    """Of the phase function 3/4 (1 + cos^2)."""
    moments = np.zeros(DEGREE + 1)
    moments[[0, 2]] = 1.0, 0.1
    return moments


def solve_flat(air: Array, haze: Haze, cosines: Array, sun: NDArray[np.int64], view: NDArray[np.int64],
               scattering: Array) -> FlatTerms:  # fmt: skip
    """Terms of atmospheres (...).

    Parameters
    ----------
    air : array, shape (...)
        Rayleigh optical depth.
    haze : Haze
    cosines : array, shape (cosine,)
        Of zenith angles.
    sun, view : array of int, shape (angle,)
        Which of `cosines` the places asked for have.
    scattering : array, shape (angle,)
        Cosines of their scattering angles.
    """
    nodes, weights = leggauss(DIRECTIONS)
    mu = np.concatenate([0.5 * (nodes + 1), cosines])
    w = np.concatenate([0.5 * weights, np.zeros(len(cosines))]) * 2 * mu
    edges = [np.inf, *BETWEEN, 0.0]
    slant = 1 / cosines[sun] + 1 / cosines[view]
    whole: _Layer | None = None
    once = np.zeros((*air.shape, len(scattering)))
    above = np.zeros(air.shape)
    single = np.zeros((*air.shape, mu.size, mu.size))
    pairs = 1 / mu[:, None] + 1 / mu
    for high, low in pairwise(edges):
        parts = [np.exp(-low / h) - np.exp(-high / h) for h in (AIR_HEIGHT, AEROSOL_HEIGHT)]
        molecules, aerosol = parts[0] * air, parts[1] * haze.extinction
        by_aerosol = aerosol * haze.albedo
        moments = molecules[..., None] * rayleigh_moments() + by_aerosol[..., None] * haze.moments
        cut = moments[..., DEGREE]
        depth = molecules + aerosol - cut
        kept = (moments - cut[..., None])[..., :DEGREE]  # per layer, not normalised
        layer, first = _doubled(depth, kept, mu, w)
        whole = layer if whole is None else _added(whole, layer, w)
        rays = 0.75 * (1 + scattering**2) * molecules[..., None] + haze.phase * by_aerosol[..., None]
        gone = -np.expm1(-depth[..., None] * slant) / depth[..., None]
        once += rays * gone * np.exp(-above[..., None] * slant) / (4 * slant * (cosines[sun] * cosines[view]))
        inner = -np.expm1(-depth[..., None, None] * pairs) / depth[..., None, None]
        single += first * inner * np.exp(-above[..., None, None] * pairs) / (4 * pairs * mu[:, None] * mu)
        above = above + depth
    assert whole is not None
    n = DIRECTIONS
    multiple = (whole.up - single)[..., n + view, n + sun]
    through = whole.straight[..., n:] + np.einsum("i,...ij->...j", w, whole.down)[..., n:]
    back = np.einsum("i,...ij,j->...", w, whole.up_below, w)
    return FlatTerms(once + multiple, through, back)


def _doubled(depth: Array, moments: Array, mu: Array, w: Array) -> tuple[_Layer, Array]:
    """A uniform layer, and the azimuth's mean of its phase function backwards times what it scatters."""
    legendre = legvander(mu, moments.shape[-1] - 1)
    degree = np.arange(moments.shape[-1])
    each = (2 * degree + 1) * moments
    forward = np.einsum("...l,il,jl->...ij", each, legendre, legendre, optimize=True)
    backward = np.einsum("...l,il,jl->...ij", each * (-1.0) ** degree, legendre, legendre, optimize=True)
    times = int(np.ceil(np.log2(max(float(depth.max()) / THINNEST, 1.0))))
    share = 0.5**times
    thin = (depth * share)[..., None, None]
    straight = np.exp(-thin[..., 0] / mu)
    # What is scattered once in a layer that is thin for all but grazing rays.
    pairs, product = 1 / mu[:, None] + 1 / mu, 4 * mu[:, None] * mu
    up = share * backward / product * -np.expm1(-thin * pairs) / (thin * pairs)
    down = share * forward / product * np.exp(-thin * 0.5 * pairs)
    layer = _Layer(up, down, up, down, straight)
    for _ in range(times):
        layer = _added(layer, layer, w)
    return layer, backward


def _added(a: _Layer, b: _Layer, w: Array) -> _Layer:
    """Layer a above layer b."""
    alike = a is b
    up, down = _from_one_side(a.up, a.down, a.up_below, a.down_below, a.straight, b.up, b.down, b.straight, w)
    if alike:
        return _Layer(up, down, up, down, a.straight * b.straight)
    up_below, down_below = _from_one_side(
        b.up_below, b.down_below, b.up, b.down, b.straight, a.up_below, a.down_below, a.straight, w
    )
    return _Layer(up, down, up_below, down_below, a.straight * b.straight)


def _from_one_side(
    up_a: Array, down_a: Array, up_below_a: Array, down_below_a: Array, straight_a: Array, up_b: Array, down_b: Array,
    straight_b: Array, w: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Reflection and transmission of both layers, lit from the side of the first."""
    there = up_b * straight_a[..., None, :]
    again = (up_below_a * w) @ up_b
    between = np.linalg.solve(
        np.eye(len(w)) - again * w, down_a + again * straight_a[..., None, :]
    )  # downwards between the layers
    back = there + (up_b * w) @ between
    up = up_a + straight_a[..., :, None] * back + (down_below_a * w) @ back
    down = straight_b[..., :, None] * between + down_b * straight_a[..., None, :] + (down_b * w) @ between
    return up, down
