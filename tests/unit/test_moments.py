"""Generalised spherical functions, expansions of scattering matrices, and scattering by moments."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss, legval
from numpy.typing import NDArray

from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.phase import HenyeyGreenstein, Isotropic, Rayleigh, normalise
from skyscatter.solvers import moments as mo
from skyscatter.solvers.compile import phase_cosines
from skyscatter.solvers.grid import recurrence

Array = NDArray[np.float64]

MU = np.linspace(-1, 1, 41)
#: Rounding of an upward recurrence over some tens of degrees.
ROUNDING = 1e-12


# Functions


def test_legendre_polynomials_are_the_functions_without_order() -> None:
    found = mo.wigner(30, 0, 0, MU)
    expected = [legval(MU, np.eye(31)[degree]) for degree in range(31)]
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


@pytest.mark.parametrize(
    ("degree", "m", "n", "closed"),
    [
        (1, 0, 1, np.sqrt((1 - MU**2) / 2)),
        (1, 1, 0, -np.sqrt((1 - MU**2) / 2)),
        (2, 1, 1, (2 * MU**2 + MU - 1) / 2),
        (2, 0, 2, np.sqrt(6) / 4 * (1 - MU**2)),
        (2, 2, 2, ((1 + MU) / 2) ** 2),
        (2, 2, -2, ((1 - MU) / 2) ** 2),
        (3, 2, 2, ((1 + MU) / 2) ** 2 * (3 * MU - 2)),
        (3, 2, -2, ((1 - MU) / 2) ** 2 * (3 * MU + 2)),
        (3, 0, 2, np.sqrt(30) / 4 * (1 - MU**2) * MU),
    ],
)
def test_closed_forms(degree: int, m: int, n: int, closed: Array) -> None:
    """Varshalovich et al. (1988), Quantum Theory of Angular Momentum, section 4.3.4."""
    np.testing.assert_allclose(mo.wigner(degree, m, n, MU)[degree], closed, atol=ROUNDING)


@pytest.mark.parametrize(("m", "n"), [(0, 0), (3, 0), (1, 2), (1, -2), (2, 2), (5, 2), (5, -2)])
def test_functions_are_orthogonal(m: int, n: int) -> None:
    degree = 12
    x, w = leggauss(degree + 1)  # exact: products of two functions are polynomials of degree 24
    d = mo.wigner(degree, m, n, x)
    expected = np.diag([2 / (2 * k + 1) if k >= max(m, abs(n)) else 0.0 for k in range(degree + 1)])
    np.testing.assert_allclose((d * w) @ d.T, expected, atol=ROUNDING)


@pytest.mark.parametrize(("m", "n"), [(3, 0), (1, 2), (4, -2)])
def test_symmetries(m: int, n: int) -> None:
    d = mo.wigner(10, m, n, MU)
    np.testing.assert_allclose(d, (-1) ** (m - n) * mo.wigner(10, n, m, MU), atol=ROUNDING)
    np.testing.assert_allclose(d, mo.wigner(10, -n, -m, MU), atol=ROUNDING)
    mirrored = np.array([(-1) ** (degree + m) for degree in range(11)])[:, None] * mo.wigner(10, m, -n, -MU)
    np.testing.assert_allclose(d, mirrored, atol=ROUNDING)


def test_degrees_below_the_order_vanish() -> None:
    assert not mo.wigner(1, 2, 0, MU).any()
    assert not mo.wigner(6, 4, 2, MU)[:4].any()


def test_addition_theorem() -> None:
    """P_l of the angle between two directions is a sum over orders of functions of each."""
    (a, b), phi = (0.35, -0.8), 1.1
    between = a * b + np.sqrt((1 - a * a) * (1 - b * b)) * np.cos(phi)
    one, other = (mo.angular_functions(9, 9, mu)[mo.D_ZERO, ..., 0] for mu in (a, b))
    share = np.where(np.arange(10) > 0, 2.0, 1.0) * np.cos(np.arange(10) * phi)
    np.testing.assert_allclose(
        np.einsum("ml,ml,m->l", one, other, share), mo.wigner(9, 0, 0, between)[:, 0], atol=1e-12
    )


@pytest.mark.parametrize(("side", "n"), [(0, 0), (1, 2), (1, -2)])
def test_coefficients_of_the_kernels_recurrence(side: int, n: int) -> None:
    degree, x = 9, 0.37
    table = recurrence(degree, 9)[side]
    for m in range(10):
        expected = mo.wigner(degree, m, n, x)[:, 0]
        low = max(m, abs(n))
        first = table[2, low, m] * 2.0**-low * (1 - x) ** (abs(m - n) / 2) * (1 + x) ** (abs(m + n) / 2)
        # For n = 2 the factor holds for n >= m; the sign of the rest is (-1)^(m - n).
        sign = (-1) ** (m - n) if n != 0 and m > n else 1
        values = {low - 1: 0.0, low: sign * first}
        for s in range(low, degree):
            tilt = m * n / (s * (s + 1)) if s > 0 else 0.0
            values[s + 1] = table[0, s, m] * (x - tilt) * values[s] - table[1, s, m] * values[s - 1]
        np.testing.assert_allclose([values[k] for k in range(low, degree + 1)], expected[low:], atol=ROUNDING)


# Expansions


def tables(phase: object) -> Array:
    """Six elements on the nodes of the phase tables, (1, 6, angle, 1)."""
    return np.asarray(phase.matrix(phase_cosines()[::-1], [550.0]))[None, :, ::-1]  # type: ignore[attr-defined]


@pytest.mark.parametrize("g", [0.0, 0.3, -0.5, 0.8])
def test_henyey_greenstein_expands_into_powers(g: float) -> None:
    rising = phase_cosines()[::-1]
    table = normalise(rising, HenyeyGreenstein(g=g).matrix(rising, [550.0])[0])[::-1]
    chi = mo.expand(table[None, None], 20)[0, 0, :, 0]
    # A convex function's chords lie above it: 2e-5 of the whole in the wide backward cells, before normalisation.
    np.testing.assert_allclose(chi, g ** np.arange(21), atol=1e-5)


@pytest.mark.parametrize("depolarisation", [0.0, 0.03])
def test_rayleigh_scattering_has_degrees_nought_to_two(depolarisation: float) -> None:
    """Hansen & Travis (1974), Space Sci. Rev. 16, 527, section 2.5; Hovenier et al. (2004), section 2.8."""
    chi = mo.expand(tables(Rayleigh(depolarisation=depolarisation)), 8)[0, :, :, 0]
    delta = (1 - depolarisation) / (1 + depolarisation / 2)
    delta_circular = (1 - 2 * depolarisation) / (1 - depolarisation)
    expected = np.zeros((6, 9))
    expected[mo.A1, [0, 2]] = 1.0, 0.5 * delta / 5
    expected[mo.A2, 2] = 3 * delta / 5
    expected[mo.A4, 1] = 1.5 * delta * delta_circular / 3
    expected[mo.B1, 2] = -np.sqrt(6) / 2 * delta / 5
    # Chords of the table: 1e-6.
    np.testing.assert_allclose(chi, expected, atol=3e-6)


def test_air_keeps_few_moments() -> None:
    chi = mo.expand(tables(Rayleigh(depolarisation=0.03)), 4)
    scalar = mo.moment_table(chi[:, :1], 4, least=1e-5)
    assert sorted(zip(scalar.degree, scalar.order, strict=True)) == [(0, 0), (2, 0), (2, 1), (2, 2)]
    polarised = mo.moment_table(chi, 4, least=1e-5)
    kinds = {kind: int(np.sum(polarised.kind == kind)) for kind in np.unique(polarised.kind)}
    # I of degrees 0 and 2, E of degree 2; a3 vanishes in both sum and difference but for b2, and b2 is zero.
    assert kinds[mo.I_KIND] == 4
    assert kinds[mo.E_KIND] == 3
    assert mo.V_KIND not in kinds


def test_isotropic_scattering_keeps_one_moment() -> None:
    table = mo.moment_table(mo.expand(tables(Isotropic()), 6), 6, least=1e-6)
    assert table.degree.tolist() == table.order.tolist() == table.kind.tolist() == [0]


# Scattering by moments against rotated scattering matrices


def spheres() -> Array:
    """A mixture with circular polarisation: b2 is not zero."""
    mode = LogNormalMode(median_radius=2e-7, geometric_standard_deviation=1.5, max_radius=2e-6)
    optics = MieAerosol(
        modes=(mode,), refractive_index_real=1.5, refractive_index_imag=0.01, optical_depth=0.1, wavelength=550.0
    )
    return 0.6 * tables(Rayleigh(depolarisation=0.03)) + 0.4 * tables(optics.phase_function([550.0]))


def frame(mu: Array, phi: Array) -> tuple[Array, Array, Array]:
    """Line of sight, and the meridian frame: v upwards, l = v x d to the left."""
    s = np.sqrt(1 - mu**2)
    d = np.stack([s * np.cos(phi), s * np.sin(phi), mu], -1)
    v = np.stack([-mu * np.cos(phi), -mu * np.sin(phi), s], -1)
    return d, v, np.cross(v, d)


def field(mu: Array, phi: Array) -> Array:
    """A smooth polarised field, symmetric about the plane phi = 0: I, Q even in phi, U, V odd."""
    s = np.sqrt(1 - mu**2)
    i = 2 + mu + 0.7 * s * np.cos(phi) + 0.5 * s * s * np.cos(2 * phi)
    q = s * s * (0.3 + 0.2 * np.cos(phi) + 0.1 * mu) + 0.2 * (1 + mu**2) * np.cos(2 * phi)
    u = -0.32 * mu * np.sin(2 * phi) + 0.3 * s * np.sin(phi)
    return np.stack([i, q, u, 0.2 * s * np.sin(phi) + 0.1 * mu * s * np.sin(phi)])


def truncated(chi: Array, mu: Array) -> Array:
    """Matrix elements a1, a2, a3, a4, b1, b2 of a series, (6, ...)."""
    degree, shape = chi.shape[1] - 1, mu.shape
    flat = mu.ravel()
    x = chi * (2 * np.arange(degree + 1) + 1) / (4 * np.pi)
    zero, two = mo.wigner(degree, 0, 0, flat), mo.wigner(degree, 0, 2, flat)
    total = (x[mo.A2] + x[mo.A3]) @ mo.wigner(degree, 2, 2, flat)
    difference = (x[mo.A2] - x[mo.A3]) @ mo.wigner(degree, 2, -2, flat)
    parts = [x[mo.A1] @ zero, (total + difference) / 2, (total - difference) / 2, x[mo.A4] @ zero]
    return np.stack([*parts, x[mo.B1] @ two, x[mo.B2] @ two]).reshape(6, *shape)


def angle_towards(d: Array, v: Array, left: Array, other: Array) -> Array:
    """Angle from v to the plane through d and another direction."""
    across = other - np.sum(other * d, -1, keepdims=True) * d
    return np.arctan2(np.sum(across * left, -1), np.sum(across * v, -1))


def scattered_directly(chi: Array, mu: float, phi: float, nodes: tuple[Array, Array, Array]) -> Array:
    """Int L(mu, phi; mu', phi') F L' domega' by quadrature, with both rotations written out."""
    m, p, weight = nodes
    i, q, u, v = field(m, p)
    d1, up1, left1 = frame(m, p)
    d, up, left = (np.broadcast_to(x, d1.shape) for x in frame(np.array(mu), np.array(phi)))
    first, second = angle_towards(d1, up1, left1, d), angle_towards(d, up, left, d1)
    q1, u1 = q * np.cos(2 * first) + u * np.sin(2 * first), u * np.cos(2 * first) - q * np.sin(2 * first)
    a1, a2, a3, a4, b1, b2 = truncated(chi, np.sum(d1 * d, -1))
    i2, q2, u2, v2 = a1 * i + b1 * q1, b1 * i + a2 * q1, a3 * u1 + b2 * v, a4 * v - b2 * u1
    q3, u3 = q2 * np.cos(2 * second) - u2 * np.sin(2 * second), q2 * np.sin(2 * second) + u2 * np.cos(2 * second)
    return np.array([np.sum(weight * x) for x in (i2, q3, u3, v2)])


def scattered_by_moments(chi: Array, mu: float, phi: float, nodes: tuple[Array, Array, Array]) -> Array:
    """The same through `moment_table` and `take_moments`, as the solver does it."""
    degree = chi.shape[1] - 1
    table = mo.moment_table(chi[None, :, :, None], degree, least=1e-12)
    m, p, weight = nodes
    stokes = field(m, p)
    take = mo.take_moments(table, 4, m[:, 0])
    here = mo.angular_functions(degree, degree, mu)[..., 0]
    out = np.zeros(4)
    for k, order in enumerate(table.order):
        turns = np.stack([np.cos(order * p)] * 2 + [np.sin(order * p)] * 2)
        moment = np.einsum("sap,sap,ap,as->", stokes, turns, weight, take[:, k])
        factor = (2 if order else 1) * (2 * table.degree[k] + 1) / (4 * np.pi) * moment
        for block, function, sign, parameter in table.gives[k]:
            turn = np.cos(order * phi) if parameter < 2 else np.sin(order * phi)
            out[parameter] += (
                factor * sign * chi[block, table.degree[k]] * here[function, order, table.degree[k]] * turn
            )
    return out


@pytest.mark.parametrize(("matrix", "degree"), [(tables(Rayleigh()), 2), (spheres(), 9)], ids=["air", "mixture"])
def test_scattering_by_moments_is_scattering_by_matrices(matrix: Array, degree: int) -> None:
    chi = mo.expand(matrix, degree)[0, :, :, 0]
    chi[1:4, :2] *= np.array([0.0, 0.0, 1.0])[:, None]  # as in `sweeps.make_problem`: a2 and a3 begin at degree 2
    x, w = leggauss(16)
    phi = 2 * np.pi * (np.arange(32) + 0.5) / 32
    m, p = np.meshgrid(x, phi, indexing="ij")
    nodes = (m, p, np.broadcast_to(w[:, None] * 2 * np.pi / 32, m.shape))
    for mu, azimuth in ((0.3, 0.5), (-0.6, 2.1), (0.8, 1.2), (-0.2, 3.9)):
        expected = scattered_directly(chi, mu, azimuth, nodes)
        found = scattered_by_moments(chi, mu, azimuth, nodes)
        # The field is of low degree, and both sides share one quadrature, exact for it: rounding remains.
        # Air leaves V to itself: it makes none from I, Q and U, and the solver does not follow it.
        kinds = 3 if degree == 2 else 4
        np.testing.assert_allclose(found[:kinds], expected[:kinds], atol=1e-10)
        assert np.all(np.abs(expected[:kinds]) > 1e-5)  # nothing is compared with zero
