"""Density and column of spherically symmetric fields: the geometry that is done once for all wavelengths.

A field is a row of `FieldTable`: a kind, four parameters, and a stretch of the shared node arrays.  `density` and
`vertical_column` hold the one switch over kinds; every column along a slant path is built from these two.

Symbols: r radius [m], h altitude above the planet's radius [m], mu cosine of the zenith angle, p distance of the line
from the planet's centre [m], t distance along the line from its point nearest to the centre [m].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.shells import CHAPMAN, EXPONENTIAL, GAUSSIAN, LINEAR
from skyscatter.kernels.jit import entry, kernel
from skyscatter.kernels.tabulated import cell_of

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(16)
#: Rule for the Chapman function's integral over z in [0, 1] (see `chapman_outward`).
_CHAPMAN_X, _CHAPMAN_W = (0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(40), (1.0, 0.0), strict=True))


@by_address
class FieldTable(NamedTuple):
    """Density fields as data.  Field f owns nodes ``start[f] : start[f] + size[f]``."""

    kind: np.ndarray  #: (field,) int64, one of the constants above
    parameters: np.ndarray  #: (field, 4): the meaning depends on the kind
    top: np.ndarray  #: (field,) altitude above which there is nothing [m]
    start: np.ndarray  #: (field,) int64
    size: np.ndarray  #: (field,) int64
    node_altitude: np.ndarray  #: (node,) [m]
    node_density: np.ndarray  #: (node,)
    node_column: np.ndarray  #: (node,) vertical column above the node [m]
    breaks: np.ndarray  #: (break,) altitudes at which some field or its slope jumps, rising, the top included [m]
    radius: float  #: of the planet [m]


@kernel
def _expm1_over(x):
    """(e^x - 1) / x, 1 at x = 0."""
    return math.expm1(x) / x if abs(x) > 1e-12 else 1.0 + 0.5 * x


@entry
def density(fields, f, h):
    """Density of field f at altitude h [m]; dimensionless."""
    if h >= fields.top[f]:
        return 0.0
    kind, a, b = fields.kind[f], fields.parameters[f, 0], fields.parameters[f, 1]
    if kind == EXPONENTIAL:
        return math.exp(-h / a)
    if kind == GAUSSIAN:
        return math.exp(-0.5 * ((h - a) / b) ** 2)
    if kind == CHAPMAN:
        z = (h - a) / b
        return math.exp(1.0 - z - math.exp(-z))
    start = fields.start[f]
    if h < fields.node_altitude[start]:
        # Rounding may put a point on the ground a hair below it.
        return fields.node_density[start] if fields.node_altitude[start] <= 0.0 else 0.0
    i = cell_of(fields.node_altitude, start, start + fields.size[f] - 1, h)
    h0, h1 = fields.node_altitude[i], fields.node_altitude[i + 1]
    n0, n1 = fields.node_density[i], fields.node_density[i + 1]
    w = (h - h0) / (h1 - h0)
    if kind == LINEAR:
        return n0 + w * (n1 - n0)
    return n0 * math.exp(w * math.log(n1 / n0))


@entry
def vertical_column(fields, f, h):
    """Column of field f from altitude h straight up to its top [m]; closed form for every kind."""
    top = fields.top[f]
    if h >= top:
        return 0.0
    kind, a, b = fields.kind[f], fields.parameters[f, 0], fields.parameters[f, 1]
    if kind == EXPONENTIAL:
        return -a * math.exp(-h / a) * math.expm1(-(top - h) / a)
    if kind == GAUSSIAN:
        u, v = (h - a) / (b * math.sqrt(2.0)), (top - a) / (b * math.sqrt(2.0))
        return b * math.sqrt(0.5 * math.pi) * (math.erfc(u) - math.erfc(v))
    if kind == CHAPMAN:
        u, v = math.exp(-(h - a) / b), math.exp(-(top - a) / b)
        return -b * math.e * math.exp(-v) * math.expm1(v - u)
    start = fields.start[f]
    if h <= fields.node_altitude[start]:
        below = (fields.node_altitude[start] - h) * density(fields, f, h)
        return fields.node_column[start] + below
    i = cell_of(fields.node_altitude, start, start + fields.size[f] - 1, h)
    h1, n1 = fields.node_altitude[i + 1], fields.node_density[i + 1]
    n = density(fields, f, h)
    if kind == LINEAR:
        return fields.node_column[i + 1] + 0.5 * (h1 - h) * (n + n1)
    return fields.node_column[i + 1] + (h1 - h) * n1 * _expm1_over(math.log(n / n1))


@entry
def chapman_outward(x, mu):
    r"""Column of an exponential shell from a point outward to infinity, in units of density times scale height.

    With X = r / H and the path s = t / H from the point, the density falls as exp(-y),
    y = (2 X mu s + s^2) / (X + sqrt(X^2 + 2 X mu s + s^2)): a form without a difference of large numbers and without
    exponentials of large arguments, as Huestis (2001, JQSRT 69, 709) asks of a Chapman function.  The change of
    variable y = z^2 + 2 b z, b^2 = X mu^2 / 2, removes the square root at the horizon:

        C(X, mu) = sqrt(2 X) Int_0^oo exp(-y) (1 + y / X) / sqrt(1 + y^2 / (2 X (z + b)^2)) dz,

    whose integrand is smooth for every X and mu >= 0; 40 Gauss-Legendre points give 1e-10 (tested).

    Parameters
    ----------
    x : float
        Radius over scale height.
    mu : float
        Cosine of the zenith angle, 0 to 1.
    """
    b = mu * math.sqrt(0.5 * x)
    # The weight has fallen to exp(-36) = 2e-16 at z_max: z^2 + 2 b z = 36.
    z_max = 36.0 / (b + math.sqrt(b * b + 36.0))
    total = 0.0
    for k in range(_CHAPMAN_X.size):
        # Nodes crowd towards the point, where the integrand is largest: z = z_max v^2.
        v = _CHAPMAN_X[k]
        z = z_max * v * v
        y = z * (z + 2.0 * b)
        slope = z * (z + 2.0 * b) / (z + b) if z + b > 0.0 else 0.0
        weight = _CHAPMAN_W[k] * 2.0 * v * z_max
        total += weight * math.exp(-y) * (1.0 + y / x) / math.sqrt(1.0 + slope * slope / (2.0 * x))
    return math.sqrt(2.0 * x) * total


@kernel
def _rise(fields, p, h0, t0, t):
    """Altitude at t of a line that is at altitude h0 at t0: r - R without the loss of a difference of radii."""
    r0 = fields.radius + h0
    return h0 + (t - t0) * (t + t0) / (r0 + math.sqrt(p * p + t * t))


@kernel
def _smooth_piece(fields, f, p, h0, t0, t1):
    """Column from t0 to t1 on one side of the tangent point, where the field is smooth.

    Gauss-Legendre in the distance t along the line, where even a grazing path has no square root.
    """
    total = 0.0
    for k in range(_GAUSS_X.size):
        t = 0.5 * (t0 + t1) + 0.5 * (t1 - t0) * _GAUSS_X[k]
        total += _GAUSS_W[k] * density(fields, f, _rise(fields, p, h0, t0, t))
    return 0.5 * (t1 - t0) * total


@kernel
def _panel_height(fields, f):
    """Altitude step over which a smooth field changes by no more than 16 Gauss points can follow."""
    kind = fields.kind[f]
    if kind == EXPONENTIAL:
        return 4.0 * fields.parameters[f, 0]
    if kind == GAUSSIAN or kind == CHAPMAN:
        return fields.parameters[f, 1]
    return 1e300


@kernel
def _smooth_until(fields, f, h):
    """Altitude up to which a field that is smooth at h can be followed by 16 Gauss points."""
    high = fields.top[f]
    start, count = fields.start[f], fields.size[f]
    if count > 0:
        if h < fields.node_altitude[start]:
            high = fields.node_altitude[start]
        else:
            high = fields.node_altitude[cell_of(fields.node_altitude, start, start + count - 1, h) + 1]
    return min(high, h + _panel_height(fields, f))


@kernel
def _outward_quadrature(fields, f, p, h0, t0, t1):
    """Column from t0 to t1 >= t0 >= 0, any field, one smooth piece after the other; h0 is the altitude at t0."""
    total = 0.0
    while t0 < t1:
        high = _smooth_until(fields, f, h0)
        if high <= h0:
            break
        r = fields.radius + high
        t = min(t1, math.sqrt(max((r - p) * (r + p), 0.0)))
        total += _smooth_piece(fields, f, p, h0, t0, max(t, t0))
        h0, t0 = high, max(t, t0)
    return total


@kernel
def _outward_column(fields, f, p, h0, t0, t1):
    """Column from t0 to t1 >= t0 >= 0 of a line at distance p from the centre; h0 is the altitude at t0."""
    h1 = _rise(fields, p, h0, t0, t1)
    scale = fields.parameters[f, 0]
    # Short pieces by quadrature: the difference of two Chapman columns would lose their leading digits.
    if fields.kind[f] != EXPONENTIAL or h1 - h0 < scale:
        return _outward_quadrature(fields, f, p, h0, t0, t1)
    r0, r1 = fields.radius + h0, fields.radius + h1
    low = math.exp(-h0 / scale) * chapman_outward(r0 / scale, t0 / r0)
    return scale * (low - math.exp(-h1 / scale) * chapman_outward(r1 / scale, t1 / r1))


@entry
def exact_column(fields, f, r, mu, length):
    """Column of field f along a straight segment, to about 1e-9 [m].

    Parameters
    ----------
    r, mu : float
        Radius [m] of the start and cosine of the zenith angle of the direction there.
    length : float
        Length of the segment [m]; may be infinite.
    """
    radius = fields.radius
    top = radius + fields.top[f]
    p = r * math.sqrt(max((1.0 - mu) * (1.0 + mu), 0.0))
    if p >= top:
        return 0.0
    start, t_top = r * mu, math.sqrt((top - p) * (top + p))
    t0, t1 = max(start, -t_top), min(start + length, t_top)
    if t1 <= t0:
        return 0.0
    h0 = fields.top[f] if t0 > start else r - radius
    if t0 >= 0.0:
        return _outward_column(fields, f, p, h0, t0, t1)
    h1 = fields.top[f] if t1 == t_top else _rise(fields, p, h0, t0, t1)
    if t1 <= 0.0:
        return _outward_column(fields, f, p, h1, -t1, -t0)
    return _outward_column(fields, f, p, p - radius, 0.0, -t0) + _outward_column(fields, f, p, p - radius, 0.0, t1)


@entry
def exact_columns(fields, r, mu, length, out):
    """`exact_column` of every field for every segment; out has shape (segment, field)."""
    for i in range(r.size):
        for f in range(fields.kind.size):
            out[i, f] = exact_column(fields, f, r[i], mu[i], length[i])
