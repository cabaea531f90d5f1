"""Phase functions: each against its formula, by quadrature and by chi-square (see `bases.PhaseFunctionBase`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from bases import PHASE_TESTS, PhaseFunctionBase, check_chi_square, members
from scipy.special import eval_jacobi, eval_legendre

from skyscatter.optics.phase import (
    AnyPhase,
    CornetteShanks,
    DoubleHenyeyGreenstein,
    Draine,
    GreekPhase,
    HenyeyGreenstein,
    Isotropic,
    Rayleigh,
    TabulatedPhase,
    wigner_d2,
)
from skyscatter.spectra.table import SpectralTable, evaluate

Array = np.ndarray
#: 0.9 at 400 nm, 0.5 at 700 nm.
G_TABLE = SpectralTable(wavelengths=(400.0, 700.0), values=(0.9, 0.5))


def at(value: Any, wavelength: float) -> float:
    return float(evaluate(value, [wavelength])[0])


def henyey(mu: Array, g: float) -> Array:
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * mu) ** 1.5)


class TestIsotropic(PhaseFunctionBase):
    phase_class = Isotropic
    examples = (Isotropic(),)
    refused = ()

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        return np.full_like(mu, 1 / (4 * np.pi))

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        return 0.0

    def expected_matrix(self, phase: Any, mu: Array, wavelength: float) -> Array:
        return np.zeros((5, mu.size))


class TestRayleigh(PhaseFunctionBase):
    phase_class = Rayleigh
    examples = (
        Rayleigh(),
        Rayleigh(depolarisation=0.0279),
        Rayleigh(depolarisation=SpectralTable(wavelengths=(400.0, 700.0), values=(0.03, 0.5))),
    )
    refused = (({"depolarisation": -0.1}, "depolarisation = -0.1"), ({"depolarisation": 1.0}, "depolarisation = 1.0"))

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        rho = at(phase.depolarisation, wavelength)
        gamma = rho / (2 - rho)  # Bucholtz (1995), eqs. 12 and 13
        return 3 / (16 * np.pi * (1 + 2 * gamma)) * ((1 + 3 * gamma) + (1 - gamma) * mu**2)

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        return 0.0

    def expected_matrix(self, phase: Any, mu: Array, wavelength: float) -> Array:
        # Chandrasekhar (1950), chapter I, eqs. 258 and 259, in I, Q, U, V: gamma of the isotropic remainder.
        gamma = at(phase.depolarisation, wavelength) / (2 - at(phase.depolarisation, wavelength))
        scale = 3 / (16 * np.pi * (1 + 2 * gamma)) * (1 - gamma)
        circular = 3 / (16 * np.pi * (1 + 2 * gamma)) * 2 * (1 - 3 * gamma)
        return np.array([scale * (1 + mu**2), 2 * scale * mu, circular * mu, scale * (mu**2 - 1), 0 * mu])

    def test_degree_of_polarisation_at_right_angles(self) -> None:
        """(1 - rho) / (1 + rho): how the depolarisation factor is defined."""
        for rho in (0.0, 0.03, 0.4):
            a1, _, _, _, b1, _ = Rayleigh(depolarisation=rho).matrix([0.0], [500.0])[:, 0, 0]
            assert -b1 / a1 == pytest.approx((1 - rho) / (1 + rho), rel=1e-14)

    def test_dipole_at_right_angles(self) -> None:
        assert Rayleigh().value([0.0, 1.0], [500.0])[:, 0] == pytest.approx(
            [3 / (16 * np.pi), 6 / (16 * np.pi)], rel=1e-15
        )


class TestHenyeyGreenstein(PhaseFunctionBase):
    phase_class = HenyeyGreenstein
    examples = tuple(HenyeyGreenstein(g=g) for g in (0.0, 0.05, 0.7, -0.6, 0.95, G_TABLE))
    refused = (({"g": 1.0}, "g = 1.0"), ({"g": -1.5}, "g = -1.5"), ({}, "g is missing"))
    # Linear between 1024 nodes: the forward lobe of g = 0.95 is 3 degrees wide, the nodes 0.1.
    table_error = 1.5e-3

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        return henyey(mu, at(phase.g, wavelength))

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        return at(phase.g, wavelength)

    def test_names_the_wavelength_extreme(self) -> None:
        with pytest.raises(ValueError, match=r"g = 1\.2"):
            HenyeyGreenstein(g=SpectralTable(wavelengths=(400.0, 700.0), values=(0.5, 1.2)))


class TestCornetteShanks(PhaseFunctionBase):
    phase_class = CornetteShanks
    examples = tuple(CornetteShanks(g=g) for g in (0.0, 0.08, 0.76, -0.4, G_TABLE))
    refused = (({"g": 1.0}, "g = 1.0"),)
    table_error = 5e-4  # as above, for g = 0.9

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        g = at(phase.g, wavelength)  # Cornette & Shanks (1992), eq. 8
        return 3 / (8 * np.pi) * (1 - g * g) / (2 + g * g) * (1 + mu**2) / (1 + g * g - 2 * g * mu) ** 1.5

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        g = at(phase.g, wavelength)  # their eq. 9
        return g * 3 * (4 + g * g) / (5 * (2 + g * g))


class TestDraine(PhaseFunctionBase):
    phase_class = Draine
    examples = tuple(
        Draine(g=g, alpha=a) for g, a in ((0.6, 0.5), (0.3, 5.0), (-0.5, 0.2), (0.5, -0.9), (G_TABLE, 1.0))
    )
    refused = (({"g": 2.0}, "g = 2.0"), ({"g": 0.1, "alpha": -1.5}, "alpha = -1.5"))
    # As above; besides, alpha = -0.9 nearly vanishes at both ends, where a relative error says little.
    table_error = 5e-4

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        g, alpha = at(phase.g, wavelength), at(phase.alpha, wavelength)  # Draine (2003), eq. 9
        return henyey(mu, g) * (1 + alpha * mu**2) / (1 + alpha * (1 + 2 * g * g) / 3)

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        g, alpha = at(phase.g, wavelength), at(phase.alpha, wavelength)
        return g * (1 + alpha * (3 + 2 * g * g) / 5) / (1 + alpha * (1 + 2 * g * g) / 3)

    def test_limits_of_the_family(self) -> None:
        mu, wl = np.linspace(-1, 1, 101), [500.0]
        for special, general in (
            (Isotropic(), Draine(g=0.0, alpha=0.0)),
            (Rayleigh(), Draine(g=0.0, alpha=1.0)),
            (HenyeyGreenstein(g=0.7), Draine(g=0.7, alpha=0.0)),
            (CornetteShanks(g=0.7), Draine(g=0.7, alpha=1.0)),
        ):
            np.testing.assert_allclose(general.value(mu, wl), special.value(mu, wl), rtol=1e-14)  # rounding
            u = np.linspace(0, 0.999, 50)
            np.testing.assert_allclose(general.sample(u, 500.0), special.sample(u, 500.0), atol=1e-12)

    @pytest.mark.parametrize("alpha", [0.0, 1.0, 3.0])
    def test_sampler_is_continuous_where_its_formula_changes(self, alpha: float) -> None:
        """Quadrature below |g| = 0.1, an antiderivative above."""
        u = np.linspace(0, 0.999, 200)
        below, above = (Draine(g=0.1 * (1 + s * 1e-9), alpha=alpha).sample(u, 500.0) for s in (-1, 1))
        # The antiderivative divides by g^2: it has lost four digits there; the step of g itself moves 1e-10.
        np.testing.assert_allclose(below, above, atol=1e-9)


class TestDoubleHenyeyGreenstein(PhaseFunctionBase):
    phase_class = DoubleHenyeyGreenstein
    examples = (
        DoubleHenyeyGreenstein(g_forward=0.8, g_backward=-0.4, forward_fraction=0.9),
        DoubleHenyeyGreenstein(g_forward=0.7, g_backward=0.1, forward_fraction=1.0),
        DoubleHenyeyGreenstein(g_forward=0.7, g_backward=-0.5, forward_fraction=0.0),
        DoubleHenyeyGreenstein(g_forward=G_TABLE, g_backward=-0.3, forward_fraction=0.7),
    )
    refused = (
        ({"g_forward": 1.0, "g_backward": 0.0, "forward_fraction": 0.5}, "g_forward = 1.0"),
        ({"g_forward": 0.5, "g_backward": -1.0, "forward_fraction": 0.5}, "g_backward = -1.0"),
        ({"g_forward": 0.5, "g_backward": 0.0, "forward_fraction": 1.5}, "forward_fraction = 1.5"),
    )
    table_error = 5e-4  # as above

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        f = at(phase.forward_fraction, wavelength)
        forward, backward = at(phase.g_forward, wavelength), at(phase.g_backward, wavelength)
        return f * henyey(mu, forward) + (1 - f) * henyey(mu, backward)

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        f = at(phase.forward_fraction, wavelength)
        return f * at(phase.g_forward, wavelength) + (1 - f) * at(phase.g_backward, wavelength)


_MU = (-1.0, -0.5, 0.2, 0.9, 1.0)
_PAIR = {"cos_theta": (-1.0, 1.0), "wavelengths": (5.0,), "values": ((1.0,), (1.0,))}


class TestTabulatedPhase(PhaseFunctionBase):
    phase_class = TabulatedPhase
    examples = (
        TabulatedPhase(cos_theta=(-1.0, 1.0), wavelengths=(500.0,), values=((1.0,), (3.0,))),
        TabulatedPhase(cos_theta=_MU, wavelengths=(400.0, 700.0), values=((1, 2), (0.5, 0.5), (1, 3), (3, 1), (9, 4))),
        TabulatedPhase(cos_theta=_MU, wavelengths=(500.0,), values=((1.0,), (0.0,), (0.0,), (2.0,), (2.0,))),
        TabulatedPhase(
            cos_theta=(-1.0, 0.0, 1.0),
            wavelengths=(400.0, 700.0),
            values=((2, 3), (1, 1), (2, 5)),
            polarisation=(
                ((2, 2), (1, 0.9), (2, 5)),
                ((-2, -2), (0, 0.1), (2, 5)),
                ((-2, -1), (0, 0), (2, 5)),
                ((0, 0), (-0.9, -0.5), (0, 0)),
                ((0, 0), (0.1, -0.2), (0, 0)),
            ),
        ),
    )
    refused = (
        ({"cos_theta": (-1.0, 0.9), "wavelengths": (5.0,), "values": ((1.0,), (1.0,))}, "cos_theta"),
        ({"cos_theta": (-1.0, 1.0), "wavelengths": (5.0, 5.0), "values": ((1, 1), (1, 1))}, "wavelengths"),
        ({"cos_theta": (-1.0, 1.0), "wavelengths": (5.0,), "values": ((1.0,),)}, "values"),
        ({"cos_theta": (-1.0, 1.0), "wavelengths": (5.0,), "values": ((-1.0,), (1.0,))}, "values = -1.0"),
        (_PAIR | {"polarisation": (((1.0,), (1.0,)),)}, "polarisation = 1: five"),
        (_PAIR | {"polarisation": (((1.0,), (1.0,)),) * 4 + (((1.0,),),)}, "polarisation = 5: five"),
        (_PAIR | {"polarisation": (((1.0,), (1.1,)),) + (((0.0,), (0.0,)),) * 4}, "polarisation = 'bounds broken"),
    )

    def expected_matrix(self, phase: Any, mu: Array, wavelength: float) -> Array:
        if phase.polarisation is None:
            return super().expected_matrix(phase, mu, wavelength)
        nodes, tables = np.array(phase.cos_theta), np.array(phase.polarisation, float)
        tables = tables / (2 * np.pi * np.trapezoid(np.array(phase.values, float), nodes, axis=0))
        columns = [[np.interp(wavelength, phase.wavelengths, row) for row in table] for table in tables]
        return np.array([np.interp(mu, nodes, column) for column in columns])

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        nodes, values = np.array(phase.cos_theta), np.array(phase.values, float)
        # First normalised at every wavelength, then linear in wavelength.
        values = values / (2 * np.pi * np.trapezoid(values, nodes, axis=0))
        column = [np.interp(wavelength, phase.wavelengths, row) for row in values]
        return np.interp(mu, nodes, column)

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        mu = np.unique(np.concatenate([np.linspace(-1, 1, 4001), phase.cos_theta]))
        p = self.expected(phase, mu, wavelength)
        # Simpson on every cell is exact for a linear function times the cosine.
        middle = 0.5 * (mu[1:] + mu[:-1])
        both = mu[1:] * p[1:] + mu[:-1] * p[:-1] + 4 * middle * 0.5 * (p[1:] + p[:-1])
        return float(2 * np.pi * np.sum(np.diff(mu) / 6 * both))

    def cuts(self, phase: Any) -> list[float]:
        return list(phase.cos_theta)

    def test_kernel_table_against_closed_form(self) -> None:
        """A kink of the user's table inside a cell of ours is cut: an absolute, not a relative, error."""
        from bases import WAVELENGTHS, _scene, kernel_phases

        from skyscatter.solvers.compile import compile_scene

        mu = np.linspace(-1, 1, 20001)
        for phase in self.examples:
            out = np.empty((mu.size, 1, len(WAVELENGTHS)))
            kernel_phases(compile_scene(_scene(phase), np.array(WAVELENGTHS)).optics.phase, mu, out)
            # Cells are at most 4 / 1024 wide in the cosine; slopes of these tables are below 7 sr-1.
            expected = phase.value(mu, WAVELENGTHS)
            np.testing.assert_allclose(out[:, 0], expected, atol=1e-3 * expected.max())

    def test_gap_is_never_drawn(self) -> None:
        drawn = self.examples[2].sample(np.linspace(0, 1 - 1e-9, 2001), 500.0)
        assert not np.any((drawn > -0.5 + 1e-6) & (drawn < 0.2 - 1e-6))

    def test_tabulated_from_a_closed_form(self) -> None:
        mu = np.sort(np.cos(np.linspace(0, np.pi, 1801)))
        mu[0], mu[-1] = -1.0, 1.0
        values = HenyeyGreenstein(g=0.7).value(mu, [500.0])
        table = TabulatedPhase(cos_theta=tuple(mu), wavelengths=(500.0,), values=tuple(map(tuple, values)))
        # Chords of 0.1 degree.
        assert table.mean_cosine([500.0])[0] == pytest.approx(0.7, abs=1e-5)
        check_chi_square(HenyeyGreenstein(g=0.7), 500.0, table.sample(np.random.default_rng(3).random(50_000), 500.0))


def siewert_coefficients() -> dict[str, tuple[float, ...]]:
    """Spheres of Siewert (2000), problem IIA: a Legendre-type series of twelve terms, six printed digits."""
    return {
        "alpha1": (1.0, 2.104031, 2.095158, 1.414939, 0.703593, 0.235001, 0.064039, 0.012837),
        "alpha2": (0.0, 0.0, 3.726079, 2.202868, 1.190694, 0.391203, 0.105556, 0.020484),
        "alpha3": (0.0, 0.0, 3.615946, 2.240516, 1.139473, 0.365605, 0.082779, 0.013649),
        "alpha4": (0.915207, 2.095727, 2.008624, 1.436545, 0.706244, 0.238475, 0.056448, 0.009703),
        "beta1": (0.0, 0.0, -0.116688, -0.20937, -0.227137, -0.144524, -0.05264, -0.0124),
        "beta2": (0.0, 0.0, 0.065456, 0.221658, 0.097752, 0.052458, 0.009239, 0.001411),
    }


DIPOLE = {
    "alpha1": (1.0, 0.0, 0.5), "alpha2": (0.0, 0.0, 3.0), "alpha3": (0.0, 0.0, 0.0), "alpha4": (0.0, 1.5, 0.0),
    "beta1": (0.0, 0.0, -math.sqrt(1.5)), "beta2": (0.0, 0.0, 0.0),
}  # fmt: skip
NOTHING = dict.fromkeys(("alpha2", "alpha3", "alpha4", "beta1", "beta2"), (0.0,))


class TestGreekPhase(PhaseFunctionBase):
    phase_class = GreekPhase
    examples = (GreekPhase(**siewert_coefficients()), GreekPhase(**DIPOLE), GreekPhase(alpha1=(1.0,), **NOTHING))
    refused = (
        (NOTHING | {"alpha1": (2.0,)}, "alpha1 = (2.0,)"),
        (NOTHING | {"alpha1": (1.0, 0.1)}, "alpha2 = 1: "),
        (DIPOLE | {"alpha1": (1.0, 2.0, 0.0)}, "alpha1 = -0.079"),
        (DIPOLE | {"beta1": (0.0, 0.0, -2.0)}, "alpha2 = 'bounds broken"),
    )
    matrix_slack = 1e-4  # the series of eight terms and six digits ends where a1 is a tenth of its mean

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        return sum(a * eval_legendre(k, mu) for k, a in enumerate(phase.alpha1)) / (4 * np.pi)

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        return sum(phase.alpha1[1:2]) / 3

    def expected_matrix(self, phase: Any, mu: Array, wavelength: float) -> Array:
        def series(coefficients: Any, n: int) -> Array:
            return sum((c * wigner_by_jacobi(k, n, mu) for k, c in enumerate(coefficients)), np.zeros_like(mu))

        alpha2, alpha3 = np.array(phase.alpha2), np.array(phase.alpha3)
        together, apart = series(alpha2 + alpha3, 2), series(alpha2 - alpha3, -2)
        a4 = sum(a * eval_legendre(k, mu) for k, a in enumerate(phase.alpha4))
        b1, b2 = series(phase.beta1, 0), series(phase.beta2, 0)
        return np.array([(together + apart) / 2, (together - apart) / 2, a4, b1, b2]) / (4 * np.pi)

    def test_dipole_is_rayleigh(self) -> None:
        mu = np.linspace(-1, 1, 101)
        expected = Rayleigh().matrix(mu, [500.0])
        np.testing.assert_allclose(GreekPhase(**DIPOLE).matrix(mu, [500.0]), expected, atol=1e-15)  # rounding


def wigner_by_jacobi(k: int, n: int, mu: Array) -> Array:
    """d^k_2n as a Jacobi polynomial: Varshalovich, Moskalev & Khersonskii (1988), section 4.3.4."""
    if k < 2:
        return np.zeros_like(mu)
    if n == 0:
        scale = math.sqrt(math.factorial(k + 2) * math.factorial(k - 2)) / math.factorial(k)
        return scale * (1 - mu * mu) / 4 * eval_jacobi(k - 2, 2, 2, mu)
    if n == 2:
        return ((1 + mu) / 2) ** 2 * eval_jacobi(k - 2, 0, 4, mu)
    return ((1 - mu) / 2) ** 2 * eval_jacobi(k - 2, 4, 0, mu)


@pytest.mark.parametrize("n", [0, 2, -2])
def test_wigner_functions_against_jacobi_polynomials(n: int) -> None:
    mu = np.linspace(-1, 1, 201)
    expected = [wigner_by_jacobi(k, n, mu) for k in range(60)]
    np.testing.assert_allclose(wigner_d2(mu, 60, n), expected, atol=1e-12)  # rounding over 60 steps
    assert wigner_d2(mu, 1, n).shape == (1, mu.size)


def test_every_phase_function_has_a_test_class() -> None:
    assert set(PHASE_TESTS) == members(AnyPhase)


def test_kind_tells_phase_functions_apart() -> None:
    kinds = [phase.model_fields["kind"].default for phase in members(AnyPhase)]
    assert len(set(kinds)) == len(kinds)


def test_chi_square_notices_a_wrong_sampler() -> None:
    """The judge itself: g off by one in a hundred must not pass."""
    wrong = HenyeyGreenstein(g=0.71).sample(np.random.default_rng(1).random(100_000), 500.0)
    with pytest.raises(AssertionError):
        check_chi_square(HenyeyGreenstein(g=0.70), 500.0, wrong)


def test_mean_cosine_is_forward_positive() -> None:
    """House convention: forward is +1."""
    phase = HenyeyGreenstein(g=0.5)
    assert phase.value([1.0], [500.0]) > phase.value([-1.0], [500.0])
    assert math.isclose(
        phase.sample(np.random.default_rng(2).random(40_000), 500.0).mean(), 0.5, abs_tol=0.01
    )  # 4 sigma
