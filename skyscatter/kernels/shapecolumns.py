"""Columns of analytic shapes in closed form, along a line of their own frame.

A line is given by its squared distance q from the middle and by the distances sa and sb, counted from its point
nearest to the middle, between which it is asked for.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.jit import inlined, kernel

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(16)
#: Largest whole exponent whose column is evaluated by recurrence.
WHOLE = 16


@inlined
def chord(q, m, sa, sb):
    """The part of [sa, sb] within the sphere of squared radius m; empty when the first is not below the second."""
    half = math.sqrt(max(m - q, 0.0))
    return max(sa, -half), min(sb, half)


@inlined
def sphere_column(q, sa, sb):
    """Length within the unit sphere."""
    lo, hi = chord(q, 1.0, sa, sb)
    return max(hi - lo, 0.0)


@inlined
def shell_column(q, inner, sa, sb):
    """Length between the squared radius `inner` and 1."""
    lo, hi = chord(q, 1.0, sa, sb)
    if hi <= lo:
        return 0.0
    c, d = chord(q, inner, lo, hi)
    return (hi - lo) - max(d - c, 0.0)


@inlined
def gaussian_column(q, cut, sa, sb):
    """Integral of exp(-(q + s^2) / 2) within the squared radius `cut`.

    On one side of the middle it is a difference of complementary error functions, which keeps its digits far out.
    """
    lo, hi = chord(q, cut, sa, sb)
    if hi <= lo:
        return 0.0
    root = math.sqrt(0.5)
    if lo > 0.0:
        area = math.erfc(lo * root) - math.erfc(hi * root)
    elif hi < 0.0:
        area = math.erfc(-hi * root) - math.erfc(-lo * root)
    else:
        area = math.erf(hi * root) - math.erf(lo * root)
    return math.exp(-0.5 * q) * math.sqrt(0.5 * math.pi) * area


@inlined
def cosine_power_integral(n, tangent):
    """Integral of cos^n from 0 to atan(tangent), for a whole n from 0 to `WHOLE`.

    I_k = sin cos^(k-1) / k + (k-1)/k I_(k-2).
    """
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    odd = n % 2
    value = sine if odd == 1 else math.atan(tangent)
    power = cosine * cosine if odd == 1 else cosine
    for k in range(2 + odd, n + 1, 2):
        value = (sine * power + (k - 1) * value) / k
        power *= cosine * cosine
    return value


@kernel
def power_law_integral(half, lo, hi):
    """Integral of (1 + t^2)^-half from lo to hi.

    With t = tan(x) it is an integral of cos^(2 half - 2), elementary for whole 2 half; where that would be a small
    difference of large numbers, and for other exponents, Gauss-Legendre panels over arsinh t, in which the integrand
    cosh^(1 - 2 half) is smooth and has no pole nearer than pi/2 to the real axis.
    """
    n = int(round(2.0 * half)) - 2
    if 0 <= n <= WHOLE and abs(2.0 * half - 2.0 - n) < 1e-14:
        first, last = cosine_power_integral(n, lo), cosine_power_integral(n, hi)
        if abs(last - first) > 1e-4 * max(abs(first), abs(last)):
            return last - first
    u0, u1 = math.asinh(lo), math.asinh(hi)
    panels = int((u1 - u0) * max(0.5, 0.25 * math.sqrt(half))) + 1
    step, total = (u1 - u0) / panels, 0.0
    for i in range(panels):
        for k in range(_GAUSS_X.size):
            total += _GAUSS_W[k] * math.cosh(u0 + step * (i + 0.5 + 0.5 * _GAUSS_X[k])) ** (1.0 - 2.0 * half)
    return 0.5 * step * total


@inlined
def power_law_column(q, half, cut, sa, sb):
    """Integral of (1 + q + s^2)^-half within the squared radius `cut`."""
    lo, hi = chord(q, cut, sa, sb)
    if hi <= lo:
        return 0.0
    root = math.sqrt(1.0 + q)
    return root ** (1.0 - 2.0 * half) * power_law_integral(half, lo / root, hi / root)


@inlined
def box_column(a, b, c, u, v, w, ta, tb):
    """Length, in units of the parameter t, within the cube |x|, |y|, |z| <= 1 of the line (a, b, c) + t (u, v, w)."""
    for x, d in ((a, u), (b, v), (c, w)):
        if d != 0.0:
            middle, half = -x / d, abs(1.0 / d)
            ta, tb = max(ta, middle - half), min(tb, middle + half)
        elif abs(x) > 1.0:
            tb = ta
    return max(tb - ta, 0.0)
