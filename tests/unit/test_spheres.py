"""Mie coefficients of many spheres at once, against miepython's one by one and in their limits."""

from __future__ import annotations

import miepython
import numpy as np
import pytest

from skyscatter.optics.spheres import coefficients, scattering_elements, series_length


@pytest.mark.parametrize("index", [1.53 + 0.008j, 1.33 + 1e-9j, 1.75 + 0.44j, 1.38 + 0j, 0.9 + 3j, 2 + 1j])
def test_coefficients_against_miepython(index: complex) -> None:
    # Multiples of pi, where psi_0 vanishes, and exact integers among them; from Rayleigh's region to 25 um in green.
    x = np.sort(np.r_[np.geomspace(1e-3, 300.0, 60), np.pi, 3 * np.pi, 1.0, 60.0])
    a, b = coefficients(index, x)
    for row, value in enumerate(x):
        expected = miepython.coefficients(index, float(value))
        n = min(expected[0].size, a.shape[1])
        largest = np.abs(expected).max()
        # Other recurrences in double precision: rounding grows with the order; below x = 0.01 miepython cancels.
        tolerance = 2e-10 * largest if value > 0.01 else 1e-4 * largest
        np.testing.assert_allclose(a[row, :n], expected[0][:n], rtol=0, atol=tolerance)
        np.testing.assert_allclose(b[row, :n], expected[1][:n], rtol=0, atol=tolerance)


def test_small_spheres() -> None:
    """a_1 -> -i (2 x^3 / 3) (m^2 - 1) / (m^2 + 2) (Bohren & Huffman, section 5.1), sign by their time factor."""
    m, x = 1.5 + 0.1j, np.array([1e-4, 1e-3])
    a, _ = coefficients(m, x)
    limit = -1j * 2 * x**3 / 3 * (m**2 - 1) / (m**2 + 2)
    assert a[:, 0] == pytest.approx(limit, rel=2e-6)  # the next term is smaller by x^2; cancellation 1e-16 / x^2


def test_energy_is_kept() -> None:
    """Without absorption every partial wave scatters what it takes: Re a_n = |a_n|^2."""
    a, b = coefficients(1.4 + 0j, np.geomspace(0.05, 200.0, 50))
    for c in (a, b):
        np.testing.assert_allclose(c.real, np.abs(c) ** 2, rtol=0, atol=1e-10)


def test_forward_scattering_is_extinction() -> None:
    """Optical theorem, S(0) = 1/2 sum (2n + 1)(a_n + b_n), and the scattered sum by quadrature over the sphere."""
    x = np.array([0.5, 3.0, 20.0])
    a, b = coefficients(1.5 + 0.02j, x)
    n = np.arange(1, a.shape[1] + 1)
    nodes, weights = np.polynomial.legendre.leggauss(2 * a.shape[1] + 2)
    for i in range(x.size):
        one = slice(i, i + 1)
        forward = scattering_elements(a[one], b[one], np.array([1.0]), np.ones(1), series_length(x[one]))
        s0 = 0.5 * np.sum((2 * n + 1) * (a[i] + b[i]))
        assert forward[0, 0] == pytest.approx(abs(s0) ** 2, rel=1e-12)
        elements = scattering_elements(a[one], b[one], nodes, np.ones(1), series_length(x[one]))
        scattered = np.sum((2 * n + 1) * (np.abs(a[i]) ** 2 + np.abs(b[i]) ** 2))
        assert weights @ elements[0] == pytest.approx(scattered, rel=1e-12)  # int |S|^2 dmu = sum, equation 4.61


def test_blocks_add_up() -> None:
    """Spheres of very different sizes together are the sum of each alone."""
    x, number = np.array([0.01, 0.2, 1.0, 1.1, 9.0, 80.0]), np.array([5.0, 4.0, 3.0, 2.0, 1.0, 0.5])
    a, b = coefficients(1.6 + 0.01j, x)
    mu, length = np.linspace(-1, 1, 41), series_length(x)
    together = scattering_elements(a, b, mu, number, length)
    parts = [slice(i, i + 1) for i in range(x.size)]
    alone = sum(scattering_elements(a[p], b[p], mu, number[p], length[p]) for p in parts)
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-12)
