"""Scattering matrices as sums of generalised spherical functions, and the bookkeeping of a field's moments.

In the angles of one place (zenith cosine mu, azimuth phi from the Sun) the radiance of a spherically symmetric
atmosphere is a sum of moments, each even or odd in phi,

    L_lm = Int L(omega) f_lm(mu) cos(m phi) domega,

and scattering multiplies every degree l by a number: the radiance scattered by a unit of density is

    J(omega) = sum_lm (2 - delta_m0) sigma_s (2 l + 1) / (4 pi) chi_l L_lm f_lm(mu) cos(m phi).

For intensity alone f is the normalised associated Legendre function.  With polarisation there are four kinds of
moments: I, the two parities E and B of linear polarisation (Q and U, through f built of d^l_m2 and d^l_m,-2), and V.
Hovenier, van der Mee & Domke (2004), Transfer of Polarized Light, chapters 2 and 4; Mishchenko et al. (2002),
Scattering, Absorption and Emission of Light by Small Particles, appendix B.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Blocks of the scattering matrix: a1, a2, a3, a4, b1, b2.
A1, A2, A3, A4, B1, B2 = range(6)
#: Kinds of moments, and the Stokes parameters they add up to.
I_KIND, E_KIND, B_KIND, V_KIND = range(4)
#: Angular functions: d_m0, and half the sum and the difference of d_m2 and d_m,-2.
D_ZERO, D_SUM, D_DIFFERENCE = range(3)

#: What a moment of each kind gives, in the meridian frame: (block, angular function, sign, Stokes parameter).
_GIVES = {
    I_KIND: ((A1, D_ZERO, 1, 0), (B1, D_SUM, 1, 1), (B1, D_DIFFERENCE, 1, 2)),
    E_KIND: ((B1, D_ZERO, 1, 0), (A2, D_SUM, 1, 1), (A2, D_DIFFERENCE, 1, 2)),
    B_KIND: ((A3, D_DIFFERENCE, 1, 1), (A3, D_SUM, 1, 2), (B2, D_ZERO, -1, 3)),
    V_KIND: ((B2, D_DIFFERENCE, 1, 1), (B2, D_SUM, 1, 2), (A4, D_ZERO, 1, 3)),
}
#: How a moment of each kind is taken from I, Q, U, V: (angular function, Stokes parameter).
_TAKES = {
    I_KIND: ((D_ZERO, 0),),
    E_KIND: ((D_SUM, 1), (D_DIFFERENCE, 2)),
    B_KIND: ((D_DIFFERENCE, 1), (D_SUM, 2)),
    V_KIND: ((D_ZERO, 3),),
}


def wigner(degree: int, m: int, n: int, mu: ArrayLike) -> Array:
    """Wigner functions d^l_mn(arccos mu) for l = 0 ... `degree`, shape (l, angle).

    Mishchenko et al. (2002), eqs. B.4, B.5 and B.22: upward recurrence in l from l = max(|m|, |n|).
    """
    x = np.atleast_1d(np.asarray(mu, float))
    d = np.zeros((degree + 1, x.size))
    low = max(abs(m), abs(n))
    if low > degree:
        return d
    sign = 1 if n >= m else (-1) ** (m - n)
    scale = sign * 2.0**-low * np.sqrt(factorial(2 * low) / (factorial(abs(m - n)) * factorial(abs(m + n))))
    d[low] = scale * (1 - x) ** (abs(m - n) / 2) * (1 + x) ** (abs(m + n) / 2)
    for s in range(low, degree):
        root, next_root = (np.sqrt((k * k - m * m) * (k * k - n * n)) for k in (s, s + 1))
        if s == 0:
            d[1] = x * d[0]
        else:
            d[s + 1] = ((2 * s + 1) * (s * (s + 1) * x - m * n) * d[s] - (s + 1) * root * d[s - 1]) / (s * next_root)
    return d


def angular_functions(degree: int, orders: int, mu: ArrayLike) -> Array:
    """The three angular functions, shape (3, m, l, angle), m = 0 ... `orders`."""
    x = np.atleast_1d(np.asarray(mu, float))
    out = np.empty((3, orders + 1, degree + 1, x.size))
    for m in range(orders + 1):
        plus, minus = wigner(degree, m, 2, x), wigner(degree, m, -2, x)
        out[D_ZERO, m] = wigner(degree, m, 0, x)
        out[D_SUM, m], out[D_DIFFERENCE, m] = (plus + minus) / 2, (plus - minus) / 2
    return out


@lru_cache(maxsize=8)
def _expansion_weights(degree: int, cells: int, scalar: bool) -> Array:
    """Weights with which tabulated functions are integrated against d_00, d_02, d_22 and d_2-2; (4, l, angle).

    The table's nodes are mu = 1 - 2 (k / cells)^2, and between them it is linear in mu, as the kernels read it; three
    Gauss points in a cell integrate that exactly but for the curvature of d over a cell (degree 100: 1e-8).
    """
    node = 1 - 2 * (np.arange(cells + 1) / cells) ** 2
    x, w = np.polynomial.legendre.leggauss(3)
    width = node[:-1] - node[1:]
    share = (x + 1) / 2
    mu = (node[:-1, None] - width[:, None] * share).ravel()
    functions = ((0, 0), (0, 2), (2, 2), (2, -2))[: 1 if scalar else 4]
    weights = np.empty((len(functions), degree + 1, cells + 1))
    for k, (m, n) in enumerate(functions):
        d = wigner(degree, m, n, mu).reshape(degree + 1, cells, 3) * (np.pi * width[:, None] * w)
        weights[k] = 0.0
        weights[k, :, :-1] += d @ (1 - share)
        weights[k, :, 1:] += d @ share
    return weights


def expand(matrix: Array, degree: int) -> Array:
    """Coefficients chi_l of scattering matrices, shape (component, block, l, wavelength).

    Parameters
    ----------
    matrix : (component, block, angle, wavelength)
        One block (the phase function) or six, on the nodes of the phase tables [sr-1].
    degree : int
        Highest l.

    Returns
    -------
    ndarray
        chi_l = 2 pi Int a(mu) d^l(mu) dmu: of a1 and a4 with d_00, of b1 and b2 with d_02; those of a2 and a3 from the
        sums and differences with d_22 and d_2-2.  The coefficients of the literature are (2 l + 1) times these.
    """
    weights = _expansion_weights(degree, matrix.shape[2] - 1, matrix.shape[1] == 1)

    def moments(function: int, values: Array) -> Array:
        return np.einsum("lk,ckw->clw", weights[function], values, optimize=True)

    chi = np.zeros((matrix.shape[0], matrix.shape[1], degree + 1, matrix.shape[3]))
    chi[:, A1] = moments(0, matrix[:, A1])
    if matrix.shape[1] == 6:
        total, difference = moments(2, matrix[:, A2] + matrix[:, A3]), moments(3, matrix[:, A2] - matrix[:, A3])
        chi[:, A2], chi[:, A3] = (total + difference) / 2, (total - difference) / 2
        chi[:, A4] = moments(0, matrix[:, A4])
        chi[:, B1], chi[:, B2] = moments(1, matrix[:, B1]), moments(1, matrix[:, B2])
    return chi


class MomentTable(NamedTuple):
    """Which moments a field keeps, and how they are made and used; all int64."""

    degree: np.ndarray  #: (moment,) l
    order: np.ndarray  #: (moment,) m
    kind: np.ndarray  #: (moment,)
    gives: np.ndarray  #: (moment, use, 4): block, angular function, sign, Stokes parameter


def moment_table(chi: Array, orders: int, least: float = 1e-7) -> MomentTable:
    """The moments that scattering with coefficients `chi` (component, block, l, wavelength) keeps alive.

    Degrees whose coefficients all vanish are left out, and so are kinds: air needs I of degree 0 and 2, with
    polarisation E of degree 2 as well.
    """
    largest = np.abs(chi).max(axis=(0, 3))  # (block, l)
    needs = {I_KIND: (A1,), E_KIND: (A2, B1), B_KIND: (A3, B2), V_KIND: (A4, B2)}
    polarised = len(largest) == 6
    circular = polarised and bool((largest[B2] > least).any())
    kinds = [I_KIND] + [E_KIND, B_KIND] * polarised + [V_KIND] * circular
    rows = []
    for kind in kinds:
        for degree in range(0 if kind in (I_KIND, V_KIND) else 2, chi.shape[2]):
            blocks = (*needs[kind], B1) if kind == I_KIND and polarised else needs[kind]
            # The mean radiance stays, even where nothing scatters.
            if (kind, degree) != (I_KIND, 0) and not any(largest[block, degree] > least for block in blocks):
                continue
            # B and V are odd in the azimuth from the Sun and have no part without it.
            first = 0 if kind in (I_KIND, E_KIND) else 1
            rows += [(degree, m, kind) for m in range(first, min(degree, orders) + 1)]
    table = np.array(rows, np.int64)
    uses = 3 if polarised else 1
    gives = np.array([[_GIVES[kind][u] for u in range(uses)] for kind in table[:, 2]], np.int64)
    degrees, orders_of, kinds_of = (np.ascontiguousarray(table[:, k]) for k in range(3))
    return MomentTable(degrees, orders_of, kinds_of, gives)


def take_moments(table: MomentTable, stokes: int, mu: ArrayLike) -> Array:
    """Factors by which the Fourier parts of I (Q, U, V) give the moments, shape (angle, moment, stokes)."""
    mu = np.atleast_1d(np.asarray(mu, float))
    functions = angular_functions(int(table.degree.max()), int(table.order.max()), mu)
    factors = np.zeros((mu.size, table.degree.size, stokes))
    for k, (degree, order, kind) in enumerate(zip(table.degree, table.order, table.kind, strict=True)):
        for function, parameter in _TAKES[int(kind)]:
            if parameter < stokes:
                factors[:, k, parameter] += functions[function, order, degree]
    return factors
