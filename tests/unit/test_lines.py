"""Emission lines: strengths against published tables, and their light on any wavelength grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bases import complaint
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from skyscatter.media.fields import Uniform
from skyscatter.media.medium import AnyOptics, Component, Medium
from skyscatter.optics.lines import WAVELENGTHS, GasLines, LineRatios, effective_recombination, photon_energy
from skyscatter.solvers.compile import medium_optics
from skyscatter.spectra.cells import cell_edges

FULL = GasLines(electron_density=1e8, ratios=LineRatios(oiii_5007=3.0, nii_6583=0.6, sii_6716=0.03, sii_6731=0.05))
#: Storey & Hummer (1995), case B, 100 cm-3: temperature K, 4 pi j(H-beta) / n_e n_p [erg cm3 s-1], H-alpha / H-beta.
STOREY_HUMMER = [(5000.0, 2.20e-25, 3.04), (10000.0, 1.235e-25, 2.86), (20000.0, 6.58e-26, 2.75)]


@pytest.mark.parametrize(("temperature", "hbeta", "decrement"), STOREY_HUMMER)
def test_recombination_against_the_published_table(temperature: float, hbeta: float, decrement: float) -> None:
    gas = GasLines(electron_density=1e6, temperature=temperature)  # 1 cm-3
    ours = 4 * np.pi * gas.line_emissivity("hbeta") * 10.0  # W m-3 in erg s-1 cm-3
    assert ours == pytest.approx(hbeta, rel=0.01)  # the fit is that good
    ratio = gas.line_emissivity("halpha") / gas.line_emissivity("hbeta")
    assert ratio == pytest.approx(decrement, rel=0.01)


def test_decrement_at_ten_thousand_kelvin() -> None:
    assert FULL.line_emissivity("halpha") / FULL.line_emissivity("hbeta") == pytest.approx(2.86, abs=0.005)


def test_luminosity_of_a_uniform_sphere() -> None:
    """L(H-beta) = alpha_eff h nu n^2 V, Osterbrock & Ferland (2006), section 4.2: 1.24e-25 erg cm3 s-1 n^2 V."""
    volume = 4 / 3 * np.pi * 3e16**3
    luminosity = 4 * np.pi * FULL.line_emissivity("hbeta") * volume
    assert luminosity == pytest.approx(effective_recombination("hbeta", 1e4) * photon_energy("hbeta") * 1e16 * volume)
    assert luminosity == pytest.approx(1.24e-25 * 1e4 * volume * 1e6 * 1e-7, rel=0.005)  # three printed digits


def test_emissivity_grows_as_density_squared() -> None:
    for name in FULL.line_names:
        double = FULL.model_copy(update={"electron_density": 2e8}).line_emissivity(name)
        assert double == pytest.approx(4 * FULL.line_emissivity(name), rel=1e-14)


def test_ratios_and_doublets() -> None:
    def relative(name: str) -> float:
        return FULL.line_emissivity(name) / FULL.line_emissivity("hbeta")

    assert [relative(name) for name in ("oiii_5007", "nii_6583", "sii_6716", "sii_6731")] == pytest.approx(
        [3.0, 0.6, 0.03, 0.05], rel=1e-14
    )
    assert relative("oiii_5007") / relative("oiii_4959") == pytest.approx(2.98, rel=1e-14)
    assert relative("nii_6583") / relative("nii_6548") == pytest.approx(3.05, rel=1e-14)


def test_names_of_the_lines_that_shine() -> None:
    assert GasLines(electron_density=1e8).line_names == ("hbeta", "halpha")
    assert FULL.line_names == tuple(WAVELENGTHS)
    assert list(WAVELENGTHS.values()) == sorted(WAVELENGTHS.values())
    only = GasLines(electron_density=1e8, hydrogen=False, ratios=LineRatios(oiii_5007=10.0))
    assert only.line_names == ("oiii_4959", "oiii_5007")
    assert only.line_emissivity("oiii_5007") == pytest.approx(10 * FULL.line_emissivity("hbeta"), rel=1e-14)


def test_vacuum_wavelengths() -> None:
    """The names are wavelengths in air; the index of air there is 1.000276 to 1.000279 (Edlen)."""
    air = {"hbeta": 486.133, "halpha": 656.279, "oiii_4959": 495.8911, "oiii_5007": 500.6843, "nii_6548": 654.805}
    air |= {"nii_6583": 658.345, "sii_6716": 671.644, "sii_6731": 673.0816}
    for name, value in WAVELENGTHS.items():
        assert value / air[name] == pytest.approx(1.000277, abs=4e-6)


@pytest.mark.parametrize("step", [0.005, 0.03, 1.0, 10.0, 50.0])
def test_sum_over_any_grid_is_the_light_of_the_lines(step: float) -> None:
    wl = np.arange(450.0 if step > 0.01 else 480.0, 700.0, step) + 0.137
    low, high = cell_edges(wl)
    scattering, absorption, emission = FULL.coefficients(wl, 1.0)
    assert not np.any(scattering)
    assert not np.any(absorption)
    total = sum(FULL.line_emissivity(name) for name in FULL.line_names)
    assert np.sum(emission * (high - low)) == pytest.approx(total, rel=1e-12)  # rounding


@given(st.lists(st.floats(400.0, 800.0), min_size=2, max_size=40, unique_by=lambda x: round(x, 3)))
def test_any_order_of_any_grid(wavelengths: list[float]) -> None:
    """The light between the outer edges, whatever lies between them and in whatever order."""
    wl = np.array(wavelengths)
    low, high = cell_edges(wl)
    narrow = FULL.model_copy(update={"line_width": 1e-6})
    inside = [n for n, x in WAVELENGTHS.items() if low.min() + 1e-4 < x < high.max() - 1e-4]
    near = [n for n, x in WAVELENGTHS.items() if min(abs(x - low.min()), abs(x - high.max())) <= 1e-4]
    expected = sum(FULL.line_emissivity(name) for name in inside)
    total = float(np.sum(narrow.coefficients(wl, 1.0).emission * (high - low)))
    slack = sum(FULL.line_emissivity(name) for name in near)
    # Edges of neighbours in floating point differ by rounding, 1e-13 nm against a line of 1e-6 nm.
    assert expected * (1 - 1e-6) <= total <= (expected + slack) * (1 + 1e-6) + 1e-40


def test_a_component_glows() -> None:
    wl = np.arange(480.0, 670.0, 10.0)
    component = Component(name="gas", density=Uniform(top=1e16), optics=FULL, weight=2.0)
    _, extinction, emission, *_ = medium_optics(Medium(planet_radius=1e18, components=(component,)), tuple(wl))
    assert not np.any(extinction)
    np.testing.assert_allclose(emission[0], 2 * FULL.coefficients(wl, 1e16).emission, rtol=1e-14)
    assert np.sum(emission > 0) == 4  # H-beta; both of [O III]; 654.8 to the left of an edge; the rest


def test_profile_of_a_resolved_line() -> None:
    gas = GasLines(electron_density=1e8, line_width=0.5)
    wl = np.linspace(485.0, 488.0, 601)
    emission = gas.coefficients(wl, 1.0).emission
    assert wl[emission.argmax()] == pytest.approx(WAVELENGTHS["hbeta"], abs=0.0026)  # half a step
    above = wl[emission > 0.5 * emission.max()]
    assert np.ptp(above) == pytest.approx(0.5, abs=0.011)  # two steps


def test_one_wavelength_stands_for_one_nanometre() -> None:
    emission = FULL.coefficients([486.0], 1.0).emission
    assert emission[0] == pytest.approx(FULL.line_emissivity("hbeta"), rel=1e-12)
    assert FULL.coefficients([487.0], 1.0).emission[0] < 1e-6 * emission[0]


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({}, "electron_density is missing"),
        ({"electron_density": -1.0}, "electron_density = -1.0"),
        ({"electron_density": 1.0, "temperature": 100.0}, "temperature = 100.0"),
        ({"electron_density": 1.0, "line_width": 0.0}, "line_width = 0.0"),
        ({"electron_density": 1.0, "ratios": {"oiii_5007": -1.0}}, "oiii_5007"),
        ({"electron_density": 1.0, "ratios": {"oiii_4959": 1.0}}, "no such field"),
    ],
)
def test_refuses(fields: dict[str, Any], word: str) -> None:
    assert word in complaint(lambda: GasLines(**fields))


def test_unknown_lines_list_the_known() -> None:
    assert "hbeta" in complaint(lambda: FULL.line_emissivity("hgamma"))
    assert "halpha" in complaint(lambda: effective_recombination("oiii_5007", 1e4))


def test_written_and_read_back() -> None:
    again = TypeAdapter(AnyOptics).validate_python(FULL.model_dump(mode="json", exclude_none=True))
    assert again == FULL
    assert hash(again) == hash(FULL)
    assert again.phase_function([500.0]).mean_cosine([500.0])[0] == 0.0
