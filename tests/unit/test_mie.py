"""Mie aerosols: single spheres, limits, averages over sizes, tables."""

from __future__ import annotations

import csv
from pathlib import Path

import miepython
import numpy as np
import pytest

from skyscatter.errors import DomainError
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.phase import Rayleigh
from skyscatter.spectra.table import SpectralTable

VISIBLE = np.linspace(380.0, 780.0, 32)
DUST_K = SpectralTable(wavelengths=(380.0, 440.0, 550.0, 670.0, 780.0), values=(0.013, 0.0118, 0.006, 0.003, 0.0026))


def single(x: float, index: complex, wavelength: float = 500.0) -> MieAerosol:
    """One size of the given size parameter, one particle per cubic metre."""
    mode = LogNormalMode(median_radius=x * wavelength * 1e-9 / (2 * np.pi), geometric_standard_deviation=1.0)
    return MieAerosol(
        modes=(mode,), refractive_index_real=index.real, refractive_index_imag=index.imag, number_density=1.0
    )


def mars_dust() -> MieAerosol:
    return MieAerosol(
        modes=(LogNormalMode.from_effective(1.6e-6, 0.35),),
        refractive_index_real=1.5,
        refractive_index_imag=DUST_K,
        optical_depth=0.5,
    )


@pytest.mark.parametrize("index", [1.33 + 0j, 1.5 + 0.01j, 1.75 + 0.5j])
@pytest.mark.parametrize("x", [0.3, 1.0, 7.0, 60.0])
def test_single_sphere_against_miepython(x: float, index: complex) -> None:
    qext, qsca, _, g = miepython.efficiencies_mx(index.conjugate(), x)
    extinction, albedo, asymmetry = single(x, index).optical_properties([500.0])
    area = np.pi * (x * 500e-9 / (2 * np.pi)) ** 2
    # The same series summed in another order.
    assert extinction[0] / area == pytest.approx(qext, rel=1e-9)
    assert albedo[0] == pytest.approx(qsca / qext, rel=1e-9)
    assert asymmetry[0] == pytest.approx(g, rel=1e-8)


@pytest.mark.parametrize("x", [1.0, 7.0, 30.0])
def test_single_sphere_phase_function(x: float) -> None:
    cosines, _, values = single(x, 1.5 + 0.01j).phase_table([500.0])
    expected = miepython.i_unpolarized(1.5 - 0.01j, x, cosines, norm="one")
    # Ours is normalised as a linear interpolant: its chords lie off the curve by up to 0.1 %.
    np.testing.assert_allclose(values[:, 0], expected, rtol=2e-3)


@pytest.mark.parametrize("index", [1.5 + 0.01j, 1.33 + 0j, 1.75 + 0.5j])
@pytest.mark.parametrize("x", [0.3, 1.0, 7.0, 30.0])
def test_single_sphere_scattering_matrix(x: float, index: complex) -> None:
    model = single(x, index)
    cosines = model.phase_table([500.0])[0]
    a1, a2, a3, a4, b1, b2 = model.phase_function([500.0]).matrix(cosines, [500.0])[:, :, 0]
    theirs = miepython.phase_matrix(index.conjugate(), x, cosines, norm="one")
    for mine, (i, j) in ((a1, (0, 0)), (b1, (0, 1)), (b1, (1, 0)), (a2, (1, 1)), (a3, (2, 2)), (a4, (3, 3))):
        # Ours is normalised as a linear interpolant, as above.
        np.testing.assert_allclose(mine / theirs[0, 0], theirs[i, j] / theirs[0, 0], rtol=0, atol=2e-3)
    # Their amplitudes are those of n - ik, conjugate to Bohren & Huffman's; the formula for the matrix is the same.
    # So their V turns the other way round, and with it the sign of b2.
    np.testing.assert_allclose(b2 / theirs[0, 0], -theirs[2, 3] / theirs[0, 0], rtol=0, atol=2e-3)
    np.testing.assert_allclose(-b2 / theirs[0, 0], -theirs[3, 2] / theirs[0, 0], rtol=0, atol=2e-3)


def test_published_amplitudes(reference: Path) -> None:
    """Wiscombe's MIEV0 case of a strongly absorbing sphere, through all ratios of matrix elements."""
    rows = np.genfromtxt(reference / "mie" / "amplitudes_m1.5-1i_x1.csv", delimiter=",", names=True)
    # Given for n - ik; conjugate to the time factor of Bohren & Huffman.
    s1, s2 = rows["S1_re"] - 1j * rows["S1_im"], rows["S2_re"] - 1j * rows["S2_im"]
    model = single(1.0, 1.5 + 1j)
    a1, _, a3, _, b1, b2 = model.phase_function([500.0]).matrix(np.cos(np.radians(rows["theta_deg"])), [500.0])[:, :, 0]
    whole = (np.abs(s1) ** 2 + np.abs(s2) ** 2) / 2
    # Chords of one degree, on a curve whose second derivative is of its own size: 1e-4.
    assert np.abs(b2 / a1).max() > 0.01
    np.testing.assert_allclose(a3 / a1, (s1 * s2.conj()).real / whole, atol=2e-4)
    np.testing.assert_allclose(b1 / a1, (np.abs(s2) ** 2 - np.abs(s1) ** 2) / 2 / whole, atol=2e-4)
    np.testing.assert_allclose(b2 / a1, (s2 * s1.conj()).imag / whole, atol=2e-4)
    np.testing.assert_allclose(a1 / a1[0], whole / whole[0], rtol=2e-4)


def test_published_efficiencies(reference: Path) -> None:
    checked = 0
    with (reference / "mie" / "efficiencies.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            n, k, x = float(row["m_real"]), -float(row["m_imag"]), float(row["x"])
            if n == 0 or k < 0 or x > 2000:  # perfect conductors are no aerosol; huge spheres cost seconds
                continue
            extinction, albedo, asymmetry = single(x, complex(n, k)).optical_properties([500.0])
            qext = extinction[0] / (np.pi * (x * 500e-9 / (2 * np.pi)) ** 2)
            for name, value in (("Qext", qext), ("Qsca", qext * albedo[0]), ("g", asymmetry[0])):
                if row[name]:
                    # Printed to 1e-6 absolute; the folder's own note allows 2e-4 relative.
                    assert value == pytest.approx(float(row[name]), rel=2e-4, abs=2e-6), (row["case"], name)
                    checked += 1
    assert checked >= 12


def test_rayleigh_limit() -> None:
    """Tiny spheres: Q_sca = 8/3 x^4 |K|^2, phase 3/(16 pi) (1 + cos^2), no asymmetry."""
    x, index = 0.005, 1.5 + 0j
    extinction, albedo, asymmetry = single(x, index).optical_properties([500.0])
    k2 = abs((index**2 - 1) / (index**2 + 2)) ** 2
    area = np.pi * (x * 500e-9 / (2 * np.pi)) ** 2
    # Next term of the expansion is of relative order x^2 = 2.5e-5.
    assert extinction[0] / area == pytest.approx(8 / 3 * x**4 * k2, rel=1e-4)
    assert albedo[0] == pytest.approx(1.0, rel=1e-6)
    assert abs(asymmetry[0]) < 1e-4
    cosines, _, values = single(x, index).phase_table([500.0])
    np.testing.assert_allclose(values[:, 0], 3 / (16 * np.pi) * (1 + cosines**2), rtol=3e-4)  # chords of 1 degree
    matrix = single(x, index).phase_function([500.0]).matrix(cosines, [500.0])
    np.testing.assert_allclose(matrix, Rayleigh().matrix(cosines, [500.0]), atol=4e-5)


def test_small_particles_follow_the_sixth_moment() -> None:
    """A wide mode of tiny spheres scatters by its sixth moment, far above the cross-section weighted radius."""
    median, spread = 1e-9, 1.6
    model = MieAerosol(
        modes=(LogNormalMode(median_radius=median, geometric_standard_deviation=spread),),
        refractive_index_real=1.5,
        refractive_index_imag=0.0,
        number_density=1.0,
    )
    k = 2 * np.pi / 550e-9
    sixth = median**6 * np.exp(18 * np.log(spread) ** 2)
    k2 = abs((1.5**2 - 1) / (1.5**2 + 2)) ** 2
    # Particles of up to some 40 nm take part: x^2 terms of 1 %.
    assert model.optical_properties([550.0])[0][0] == pytest.approx(8 / 3 * np.pi * k**4 * k2 * sixth, rel=0.02)


def test_large_particles_extinguish_twice_their_shadow() -> None:
    model = MieAerosol(
        modes=(LogNormalMode(median_radius=8e-6, geometric_standard_deviation=1.3),),
        refractive_index_real=1.4,
        refractive_index_imag=0.05,
        number_density=1.0,
    )
    shadow = np.pi * 64e-12 * np.exp(2 * np.log(1.3) ** 2)
    # Q_ext = 2 (1 + about x^(-2/3)), x near 100.
    assert model.optical_properties([550.0])[0][0] / shadow == pytest.approx(2.1, abs=0.06)


def test_size_average_against_plain_quadrature() -> None:
    model = MieAerosol(
        modes=(LogNormalMode(median_radius=2e-7, geometric_standard_deviation=1.5),),
        refractive_index_real=1.45,
        refractive_index_imag=0.005,
        number_density=1.0,
    )
    s = np.log(1.5)
    radius = np.exp(np.linspace(np.log(2e-7) - 6 * s, np.log(2e-7) + 8 * s, 2001))
    number = np.exp(-0.5 * (np.log(radius / 2e-7) / s) ** 2) / (s * np.sqrt(2 * np.pi)) * np.pi * radius**2
    qext, qsca, _, g = miepython.efficiencies_mx(1.45 - 0.005j, 2 * np.pi * radius / 550e-9)
    extinction, scattering, forward = (np.trapezoid(number * q, np.log(radius)) for q in (qext, qsca, qsca * g))
    mine = model.optical_properties([550.0])  # 550 nm is a node: no interpolation over wavelength
    # The window of 4.5 standard deviations drops 1e-5.
    assert mine[0][0] == pytest.approx(extinction, rel=5e-5)
    assert mine[1][0] == pytest.approx(scattering / extinction, rel=5e-5)
    assert mine[2][0] == pytest.approx(forward / scattering, rel=5e-5)


def test_table_integrates_to_one_and_keeps_the_mean_cosine() -> None:
    dust = mars_dust()
    cosines, nodes, values = dust.phase_table(VISIBLE)
    assert nodes[0] <= 380.0
    assert nodes[-1] >= 780.0
    np.testing.assert_allclose(2 * np.pi * np.trapezoid(values, cosines, axis=0), 1.0, rtol=1e-12)  # rounding
    phase = dust.phase_function(VISIBLE)
    # The series for g is exact; the table's linear interpolant is not: its angle grid is made for 1e-3.
    np.testing.assert_allclose(phase.mean_cosine(VISIBLE), dust.optical_properties(VISIBLE)[2], atol=1e-3)


def test_interpolation_over_wavelength() -> None:
    """Between nodes: against the same mode computed exactly there (as a second, constant-index model)."""
    dust = mars_dust()
    for wl in (430.0, 641.0):
        index = dust.refractive_index([wl])[0]
        shift = wl / 550.0  # the same size parameters at 550 nm, which is a node
        mode = dust.modes[0]
        there = MieAerosol(
            modes=(
                LogNormalMode(
                    median_radius=mode.median_radius / shift,
                    geometric_standard_deviation=mode.geometric_standard_deviation,
                ),
            ),
            refractive_index_real=index.real,
            refractive_index_imag=index.imag,
            number_density=1.0,
        )
        exact, mine = there.optical_properties([550.0]), dust.optical_properties([wl])
        # Documented: some 0.1 % in the cross sections with a smooth index (this one has kinks).
        assert mine[0][0] == pytest.approx(exact[0][0] * shift**2, rel=2e-3)
        assert mine[1][0] == pytest.approx(exact[1][0], abs=5e-3)
        assert mine[2][0] == pytest.approx(exact[2][0], abs=5e-3)


def test_optical_depth_and_number_density() -> None:
    dust = mars_dust()
    scattering, absorption, emission = dust.coefficients([550.0], 11100.0)
    assert (scattering + absorption)[0] * 11100.0 == pytest.approx(0.5, rel=1e-12)
    assert emission[0] == 0.0
    counted = dust.model_copy(update={"optical_depth": None, "number_density": 3e6})
    extinction = dust.optical_properties([550.0])[0][0]
    assert sum(counted.coefficients([550.0], 1.0))[0] == pytest.approx(3e6 * extinction, rel=1e-12)


def test_modes_add_by_number() -> None:
    fine = LogNormalMode(median_radius=1e-7, geometric_standard_deviation=1.5, fraction=3.0)
    coarse = LogNormalMode(median_radius=5e-7, geometric_standard_deviation=1.5, fraction=1.0)
    common = {"refractive_index_real": 1.4, "refractive_index_imag": 0.0, "number_density": 1.0}
    both, one, two = (
        MieAerosol(modes=modes, **common).optical_properties([550.0])[0][0]  # type: ignore[arg-type]
        for modes in ((fine, coarse), (fine,), (coarse,))
    )
    assert both == pytest.approx((3 * one + two) / 4, rel=1e-12)  # rounding


def test_cut_removes_large_particles() -> None:
    whole = LogNormalMode(median_radius=4e-7, geometric_standard_deviation=2.0)
    cut = whole.model_copy(update={"max_radius": 1e-6})
    radius, number = cut.sizes(550e-9)
    assert radius.max() == pytest.approx(1e-6)
    assert number.sum() < 1.0
    common = {"refractive_index_real": 1.4, "refractive_index_imag": 0.0, "number_density": 1.0}
    small, large = (MieAerosol(modes=(m,), **common).optical_properties([550.0])[0][0] for m in (cut, whole))  # type: ignore[arg-type]
    # The cut stands 1.3 deviations above the median, cross sections centre 1.4 above it: about half is left.
    assert 0.4 * large < small < 0.6 * large


def test_effective_radius_round_trip() -> None:
    mode = LogNormalMode.from_effective(1.6e-6, 0.35)
    assert mode.effective_radius == pytest.approx(1.6e-6, rel=1e-12)
    assert np.expm1(np.log(mode.geometric_standard_deviation) ** 2) == pytest.approx(0.35, rel=1e-12)


def test_water_and_units() -> None:
    mode = {"median_radius": "0.4 um", "geometric_standard_deviation": 1.8, "max_radius": "5 um"}
    fog = MieAerosol.model_validate(
        {"modes": [mode], "material": "water", "optical_depth": 0.1, "wavelength": "0.55 um"}
    )
    assert fog.refractive_index([550.0])[0].real == pytest.approx(
        1.333, abs=0.004
    )  # Hale & Querry 1973; Segelstein is 0.003 above
    assert fog.optical_properties([550.0])[1][0] == pytest.approx(1.0, abs=1e-5)  # water hardly absorbs
    assert MieAerosol.model_validate(fog.model_dump()) == fog
    with pytest.raises(ValueError, match="200 to 2500"):
        fog.optical_properties([3000.0])


@pytest.mark.parametrize(
    "change",
    [
        {"optical_depth": None},
        {"number_density": 1.0},
        {"material": "water"},
        {"refractive_index_imag": None},
        {"refractive_index_imag": -0.1},
        {"modes": []},
        {"modes": [{"median_radius": 1e-7, "geometric_standard_deviation": 0.9}]},
        {"modes": [{"median_radius": 1e-7, "geometric_standard_deviation": 2, "min_radius": 1e-6, "max_radius": 1e-7}]},
    ],
)
def test_refuses(change: dict[str, object]) -> None:
    fields = mars_dust().model_dump() | change
    with pytest.raises(ValueError, match=r"exactly one|not both|or material|negative|at least|greater|no particles"):
        MieAerosol.model_validate(fields)


@pytest.mark.parametrize("radius", [5e-324, 1e-300, 1e-15])
def test_particles_below_atoms_are_refused(radius: float) -> None:
    mode = LogNormalMode(median_radius=radius, geometric_standard_deviation=1.5)
    aerosol = MieAerosol(
        modes=(mode,), refractive_index_real=1.5, refractive_index_imag=0.0, optical_depth=0.1, wavelength=550.0
    )
    for ask in (aerosol.optical_properties, aerosol.phase_table):
        with pytest.raises(DomainError, match="smaller than an atom"):
            ask([550.0])


@pytest.mark.parametrize("cut", [{"max_radius": 1e-300}, {"max_radius": 1e-25}, {"min_radius": 1e12}])
def test_cuts_that_leave_no_particles_are_refused(cut: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="leave no particles"):
        LogNormalMode(median_radius=1e-7, geometric_standard_deviation=2.0, **cut)
    assert LogNormalMode(median_radius=1e-7, geometric_standard_deviation=2.0, max_radius=1e-12)
