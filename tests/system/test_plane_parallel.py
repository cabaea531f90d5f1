"""``path`` in flat slabs against an integral equation, van de Hulst's table and the discrete-ordinate test problems.

The references and their limits:

- fluxes of DISORT are sums over its 16 (32, 48) streams.  In the thin slabs of problem 1 they lie 0.9e-3 off the
  integral equation below, so 0.1 % is what they are good for;
- intensities of problems 3 to 5 were computed with truncated phase functions and a correction (delta-M, Nakajima and
  Tanaka), approximate around the beam: only fluxes are judged there;
- van de Hulst's table has five digits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plane_parallel import Slab, isotropic_fluxes, legendre_phase
from significance import assert_agrees, largest_t

from skyscatter.optics.phase import HenyeyGreenstein, Isotropic, Rayleigh

SLOW = pytest.mark.slow
#: Relative error of DISORT's fluxes and intensities: angular quadrature, and single precision.
FLUX_BAR, RADIANCE_BAR = 1e-3, 5e-3


def moments(reference: Path, name: str) -> np.ndarray:
    """Legendre moments chi_l of a tabulated phase function."""
    table = np.genfromtxt(reference / "disort_tests" / name, delimiter=",")
    values = table[np.isfinite(table).all(axis=-1)][:, -1] if table.ndim == 2 else table[np.isfinite(table)]
    return np.asarray(values / (2 * np.arange(values.size) + 1))


def problem(name: str, reference: Path) -> Slab:
    """A DISORT test problem."""
    conservative = 1 - 1e-6
    isotropic, haze = Isotropic(), "legendre_haze_L.csv"
    match name:
        case "1a":
            return Slab(0.03125, 0.2, isotropic, 0.1, np.pi / 0.1)
        case "1c":
            return Slab(0.03125, 0.99, isotropic, 0.1, np.pi / 0.1)
        case "1e":
            return Slab(32.0, conservative, isotropic, 0.1, np.pi / 0.1)
        case "2a":
            return Slab(0.2, 0.5, Rayleigh(), 0.080442)
        case "2c":
            return Slab(5.0, 0.5, Rayleigh(), 0.080442)
        case "3a":
            return Slab(1.0, conservative, HenyeyGreenstein(g=0.75), 1.0)
        case "4a":
            return Slab(1.0, conservative, legendre_phase(moments(reference, haze)), 1.0)
        case "4c":
            return Slab(1.0, 0.9, legendre_phase(moments(reference, haze)), 0.5)
    raise AssertionError(name)


def published(name: str, reference: Path) -> dict[str, np.ndarray]:
    """Results of a problem, depths and azimuths among them."""
    with np.load(reference / "disort_tests" / f"{name}_test.npz") as file:
        return {key: file[key] for key in file.files}


@pytest.mark.parametrize(
    ("optical_thickness", "albedo", "beam_mu"),
    [
        (0.03125, 0.2, 0.1),
        *(pytest.param(*values, marks=SLOW) for values in ((0.5, 1.0, 0.6), (0.03125, 0.99, 0.1), (1, 0.9, 1.0))),
    ],
)
def test_fluxes_of_isotropic_slabs_against_the_integral_equation(
    optical_thickness: float, albedo: float, beam_mu: float
) -> None:
    slab = Slab(optical_thickness, albedo, Isotropic(), beam_mu)
    up, down = isotropic_fluxes(slab)
    for expected, (value, error) in (
        (up, slab.flux(0.0, True, nodes=24, samples=4096)),
        (down, slab.flux(slab.optical_thickness, False, nodes=24, samples=4096)),
    ):
        assert error < 2e-3 * expected
        # Gauss nodes in mu, the mesh of the integral equation, the column table and the tolerance of `single` leave
        # 1e-4 each.
        assert_agrees(value, expected, error, slack=3e-4)


@pytest.mark.parametrize(
    ("name", "samples", "precision"),
    [
        pytest.param("1a", 1024, 5e-4, marks=SLOW),
        ("1c", 4096, 5e-4),
        pytest.param("2a", 2048, 5e-4, marks=SLOW),
        # The rest are noisy: forward peaks, and light that is scattered many times.  Precision: what a minute buys.
        pytest.param("2c", 4096, 3e-2, marks=SLOW),
        pytest.param("3a", 16384, 5e-3, marks=SLOW),
        pytest.param("4a", 16384, 1e-2, marks=SLOW),
        pytest.param("4c", 1024, 1e-2, marks=SLOW),
    ],
)
def test_fluxes_of_discrete_ordinate_problems(name: str, samples: int, precision: float, reference: Path) -> None:
    slab, table = problem(name, reference), published(name, reference)
    azimuths = {"2": 4, "4c": 16}.get(name if name == "4c" else name[0], 1)
    incoming = slab.direct_flux(0.0)
    compared = 0
    for k, tau in enumerate(table["tau_test_arr"]):
        assert slab.direct_flux(tau) == pytest.approx(table["rfldir"][k], rel=2e-6)  # single precision
        for key in ("flup", "rfldn"):
            expected = float(table[key][k])
            if abs(expected) < 1e-5 * incoming:  # zero: below the slab or above it
                continue
            value, error = slab.flux(float(tau), key == "flup", nodes=24, azimuths=azimuths, samples=samples)
            print(f"{name} tau {tau:g} {key}: {value:.6g} +- {error:.2g}, published {expected:.6g}")
            assert error < precision * expected
            assert_agrees(value, expected, error, slack=FLUX_BAR)
            compared += 1
    assert compared >= 2


@pytest.mark.parametrize(
    ("name", "samples", "precision"),
    [
        ("2a", 8192, 2e-3),
        *(pytest.param(*v, marks=SLOW) for v in (("1a", 4096, 2e-3), ("1c", 8192, 2e-3), ("2c", 2**15, 2e-2))),
    ],
)
def test_radiances_of_discrete_ordinate_problems(name: str, samples: int, precision: float, reference: Path) -> None:
    slab, table = problem(name, reference), published(name, reference)
    half = 0.5 * (np.polynomial.legendre.leggauss(len(table["uu"]) // 2)[0] + 1)
    mu = np.concatenate([-half[::-1], half])
    ends = [(0, mu > 0)] if name == "2c" else [(0, mu > 0), (-1, mu < 0)]
    for k, side in ends:
        answer = slab.radiance(
            float(table["tau_test_arr"][k]), mu[side][:, None], table["phi_arr"] - np.pi, samples=samples
        )
        value, error = answer.radiance[..., 0], answer.standard_error[..., 0]
        expected = table["uu"][side, k]
        print(f"{name} {k}: largest difference {np.max(np.abs(value / expected - 1)):.2g}")
        assert np.all(error < precision * expected)
        assert_agrees(value, expected, error, slack=RADIANCE_BAR)


@SLOW
@pytest.mark.parametrize("upwards", [True, False])
def test_a_thick_conservative_slab_by_plain_walks(upwards: bool, reference: Path) -> None:
    """Problem 1e, optical thickness 32: hundreds of scatterings; only free flights keep their weight over so many."""
    slab, table = problem("1e", reference), published("1e", reference)
    value, error = slab.flux(
        0.0 if upwards else 32.0, upwards, nodes=8, samples=512 if upwards else 16384, sampling="free-flight"
    )
    expected = float(table["flup"][0] if upwards else table["rfldn"][1])
    assert error < 0.06 * expected
    # 8 nodes in mu are good to 1e-3 where the radiance is as smooth as over a thick slab.
    assert_agrees(value, expected, error, slack=2e-3)


@pytest.mark.parametrize(("samples", "precision"), [(2**13, 1.5e-2), pytest.param(2**16, 5e-3, marks=SLOW)])
def test_van_de_hulst_table_12(samples: int, precision: float, reference: Path) -> None:
    """R = pi I / (mu0 F) of isotropic scattering with albedo 0.8 in a slab of thickness 2, at mu = 0.5."""
    rows = np.loadtxt(reference / "vandehulst_slab" / "isotropic_a0.8_b2_top.csv", delimiter=",", skiprows=1)
    for albedo, thickness, mu, mu0, expected in rows:
        answer = Slab(thickness, albedo, Isotropic(), mu0, 1.0).radiance(0.0, mu, 1.0, samples=samples)
        value, error = (float(x[0]) * np.pi / mu0 for x in (answer.radiance, answer.standard_error))
        print(f"mu0 {mu0}: {value:.5f} +- {error:.5f}, table {expected}")
        assert error < precision * expected
        # Half a unit of the last digit, the tolerance of `single` and the column table.
        assert abs(value - expected) < largest_t(len(rows)) * error + 5e-6 + 2e-4 * expected
