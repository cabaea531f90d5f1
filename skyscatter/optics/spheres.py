"""Light scattered by many homogeneous spheres at once: Mie coefficients and sums over sizes and angles.

Equations of Bohren & Huffman 1983 (Absorption and Scattering of Light by Small Particles), chapter 4.  miepython
computes one sphere at a time; a size distribution takes a thousand, so here every recurrence runs over all of them
together, each sphere leaving when its own series ends.  tests/unit/test_mie.py holds both side by side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_GUARD = 16  # a downward recurrence may start from anything this many orders, and 8 cube roots, above its argument
_BLOCK = 1.25  # sizes whose series are of the same length within this factor share one matrix product


def series_length(x: Array) -> NDArray[np.int64]:
    """Number of terms x + 4 x^(1/3) + 2 (Wiscombe 1980, Applied Optics 19, 1505) for each size parameter."""
    return (x + 4.05 * np.cbrt(x) + 2.0).astype(np.int64)


def coefficients(index: complex, x: Array) -> tuple[Complex, Complex]:
    """Mie coefficients a_n and b_n, n = 1, 2, ... (Bohren & Huffman, equation 4.88).

    Parameters
    ----------
    index : complex
        Refractive index n + ik of the spheres, k >= 0 absorbs.
    x : ndarray, shape (size,)
        Size parameters, ascending.

    Returns
    -------
    a, b : ndarray of complex, shape (size, order)
        Zero beyond the end of each series.
    """
    length = series_length(x)
    orders = int(length[-1])
    inner = _log_derivative(np.asarray(index * x, dtype=complex), np.maximum(length, _start(np.abs(index) * x)), orders)
    ratio = _psi_ratio(x, np.maximum(length, _start(x)), orders)
    first = np.searchsorted(length, np.arange(orders + 1))  # spheres from here on have this order
    a, b = np.zeros((2, x.size, orders), dtype=complex)
    psi, chi_before, chi = np.sin(x), -np.sin(x), np.cos(x)  # orders 0, -1, 0
    psi_1 = np.sin(x) / x - np.cos(x)
    # psi_0 vanishes at multiples of pi: start from whichever of the first two orders is larger.
    psi = np.where(np.abs(psi) >= np.abs(psi_1), psi, psi_1 / ratio[:, 0])
    for n in range(1, orders + 1):
        part = slice(first[n], None)
        nx = n / x[part]
        psi_before = psi[part].copy()
        psi[part] = psi_before * ratio[part, n - 1]
        following = (2 * n - 1) / x[part] * chi[part] - chi_before[part]
        chi_before[part], chi[part] = chi[part], following
        xi, xi_before = psi[part] - 1j * chi[part], psi_before - 1j * chi_before[part]
        d = inner[part, n - 1]
        electric, magnetic = d / index + nx, d * index + nx
        a[part, n - 1] = (electric * psi[part] - psi_before) / (electric * xi - xi_before)
        b[part, n - 1] = (magnetic * psi[part] - psi_before) / (magnetic * xi - xi_before)
    return a, b


def _start(argument: Array) -> NDArray[np.int64]:
    """Order so far above the argument that what a downward recurrence starts from has no effect below it."""
    return (argument + 8.0 * np.cbrt(argument)).astype(np.int64) + _GUARD


def _log_derivative(z: Complex, start: NDArray[np.int64], orders: int) -> Complex:
    """D_n(z) = psi_n'(z) / psi_n(z) for n = 1 ... `orders`, downward from `start` (equation 4.89)."""
    result = np.zeros((z.size, orders), dtype=complex)
    now = np.zeros_like(z)
    first = np.searchsorted(start, np.arange(start[-1] + 1))
    for n in range(int(start[-1]), 1, -1):
        part = slice(first[n], None)
        nz = n / z[part]
        now[part] = nz - 1.0 / (now[part] + nz)  # D_{n-1}
        if n - 1 <= orders:
            result[part, n - 2] = now[part]
    return result


def _psi_ratio(x: Array, start: NDArray[np.int64], orders: int) -> Array:
    """psi_n / psi_{n-1} for n = 1 ... `orders`, downward: stable where the upward recurrence cancels (n > x)."""
    result = np.ones((x.size, orders))
    first = np.searchsorted(start, np.arange(start[-1] + 1))
    now = x / (2.0 * start + 3.0)  # psi_{n+1} / psi_n where n is far above x
    for n in range(int(start[-1]), 0, -1):
        part = slice(first[n], None)
        now[part] = 1.0 / ((2 * n + 1) / x[part] - now[part])
        if n <= orders:
            result[part, n - 1] = now[part]
    return result


def scattering_elements(a: Complex, b: Complex, cosines: Array, number: Array, length: NDArray[np.int64]) -> Array:
    """Elements a1, a3, b1, b2 of the scattering matrix summed over sizes, shape (4, angle).

    Bohren & Huffman, equation 4.77.  The coefficients are those of their time factor exp(-i omega t), for n + ik.
    Their vectors (perpendicular, parallel, ray) are right-handed and V > 0 turns clockwise, seen against the light;
    here (parallel, perpendicular, ray) are and V > 0 turns anticlockwise.  Both U and V change sign, b2 does not.

    Parameters
    ----------
    a, b : ndarray, shape (size, order)
    cosines : ndarray, shape (angle,)
    number : ndarray, shape (size,)
        Weight of each size.
    length : ndarray of int, shape (size,)
        Terms of each size's series, ascending.
    """
    pi, tau = _angular_functions(a.shape[1], cosines)
    both, difference = pi + tau, pi - tau
    elements = np.zeros((4, cosines.size))
    begin = 0
    while begin < length.size:
        end = int(np.searchsorted(length, _BLOCK * length[begin] + 2, side="right"))
        part, n = slice(begin, end), int(length[end - 1])
        plus = _product(a[part, :n] + b[part, :n], both[:n])  # S1 + S2
        minus = _product(a[part, :n] - b[part, :n], difference[:n])  # S1 - S2
        square_plus, square_minus = plus.real**2 + plus.imag**2, minus.real**2 + minus.imag**2
        product = plus * minus.conj()
        w = number[part]
        elements[0] += w @ (square_plus + square_minus)  # (|S1|^2 + |S2|^2) / 2
        elements[1] += w @ (square_plus - square_minus)  # Re S1 S2*
        elements[2] -= 2 * (w @ product.real)  # (|S2|^2 - |S1|^2) / 2
        elements[3] += 2 * (w @ product.imag)  # Im S2 S1*
        begin = end
    return 0.25 * elements


def _product(left: Complex, right: Array) -> Complex:
    """Matrix product of a complex and a real matrix; numpy's own would make the real one complex first."""
    result = np.empty((left.shape[0], right.shape[1]), dtype=complex)
    result.real = left.real @ right
    result.imag = left.imag @ right
    return result


def _angular_functions(orders: int, cosines: Array) -> tuple[Array, Array]:
    """(2n + 1) / (n (n + 1)) times pi_n and tau_n, by upward recurrence (Bohren & Huffman, equation 4.47)."""
    pi, tau = np.zeros((2, orders, cosines.size))
    before, now = np.zeros_like(cosines), np.ones_like(cosines)
    for n in range(1, orders + 1):
        scale = (2 * n + 1) / (n * (n + 1))
        pi[n - 1], tau[n - 1] = scale * now, scale * (n * cosines * now - (n + 1) * before)
        before, now = now, ((2 * n + 1) * cosines * now - (n + 1) * before) / n
    return pi, tau
