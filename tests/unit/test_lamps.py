"""Lamps: lobes hold the power they are given, spectra their watts and lumens, and refusals say what would do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bases import complaint, members
from scipy.integrate import quad

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.spectra.cells import cell_edges, cell_means
from skyscatter.spectra.table import SpectralTable
from skyscatter.surfaces.lamps import AreaLamp, Led, ParallelLamp, PointLamp, SpotLamp, Surroundings
from skyscatter.surfaces.lobes import (
    AnyLobe,
    CityLobe,
    ConeLobe,
    CosinePowerLobe,
    IsotropicLobe,
    LambertLobe,
    Lobe,
    TabulatedLobe,
)
from skyscatter.surfaces.power import lamp_names, lamp_spectrum, luminous_efficacy, spectrum_shape

LOBES: tuple[Lobe, ...] = (
    IsotropicLobe(),
    LambertLobe(),
    CosinePowerLobe(half_angle_deg=60.0),
    CosinePowerLobe(half_angle_deg=15.0),
    CosinePowerLobe(half_angle_deg=0.5),
    ConeLobe(half_angle_deg=20.0),
    ConeLobe(half_angle_deg=20.0, edge_deg=10.0),
    ConeLobe(half_angle_deg=5.0, edge_deg=10.0),
    ConeLobe(half_angle_deg=180.0),
    TabulatedLobe(angles_deg=(0.0, 30.0, 90.0), intensities=(1.0, 2.0, 0.0)),
    TabulatedLobe(angles_deg=(40.0, 60.0), intensities=(1.0, 1.0)),
    CityLobe(),
    CityLobe(ground_albedo=0.3, direct_share=0.0),
)


def test_every_lobe_is_here() -> None:
    assert members(AnyLobe) == {type(lobe) for lobe in LOBES}


@pytest.mark.parametrize("lobe", LOBES, ids=lambda lobe: lobe.kind)
def test_lobes_hold_the_power(lobe: Lobe) -> None:
    cosine, value, cdf = lobe.table()
    assert np.all(np.diff(cosine) > 0)
    assert -1 <= cosine[0] < cosine[-1] == 1 or cosine[-1] == np.cos(np.radians(40.0))
    assert np.all(value >= 0)
    # 2 pi times the integral of what is linear between the nodes, summed with another rule (Simpson's, exact for it).
    middle = lobe.value(0.5 * (cosine[1:] + cosine[:-1]))
    power = 2 * np.pi * np.sum(np.diff(cosine) / 6 * (value[1:] + 4 * middle + value[:-1]))
    assert power == pytest.approx(1.0, abs=1e-12)
    assert cdf[0] == 0
    assert cdf[-1] == 1
    np.testing.assert_allclose(np.diff(cdf), np.pi * (value[1:] + value[:-1]) * np.diff(cosine), atol=1e-14)


def _ratio(lobe: Lobe, shape: Any) -> float:
    """Largest difference of a lobe from a formula, relative to the formula's peak."""
    angle = np.radians(np.linspace(0.0, 89.99, 4001))
    norm = 2 * np.pi * quad(lambda z: shape(z) * np.sin(z), 0, 0.5 * np.pi, epsabs=1e-13, limit=200)[0]
    expected = shape(angle) / norm
    return float(abs(lobe.value(np.cos(angle)) - expected).max() / expected.max())


def test_lobes_are_what_their_formulae_say() -> None:
    # 257 nodes: the second difference of the curve over a cell, 1/8 (step)^2 f''.
    assert _ratio(CosinePowerLobe(half_angle_deg=60.0), np.cos) < 1e-12  # Lambert's, which is linear
    for half in (40.0, 10.0):
        power = np.log(0.5) / np.log(np.cos(np.radians(half)))
        assert _ratio(CosinePowerLobe(half_angle_deg=half), lambda z, m=power: np.cos(z) ** m) < 3e-4
    for g, f in ((0.15, 0.15), (0.1, 0.05), (0.0, 1.0)):
        lobe = CityLobe(ground_albedo=g, direct_share=f)
        shape = lambda z, g=g, f=f: 2 * g * (1 - f) * np.cos(z) + 0.554 * f * z**4  # noqa: E731
        assert _ratio(lobe, shape) < 3e-4


def test_a_city_sends_up_what_garstang_says() -> None:
    """I / (L / 2 pi) integrates to G (1 - F) + F within the three digits of 0.554."""
    city = CityLobe()
    assert city.escaping == pytest.approx(0.15 * 0.85 + 0.15)
    up, _ = quad(lambda z: (2 * 0.15 * 0.85 * np.cos(z) + 0.554 * 0.15 * z**4) * np.sin(z), 0, 0.5 * np.pi)
    assert up == pytest.approx(city.escaping, rel=1e-3)


def test_half_angles_are_where_the_light_is_half() -> None:
    for half in (5.0, 15.0, 45.0):
        lobe = CosinePowerLobe(half_angle_deg=half)
        assert lobe.value(np.cos(np.radians(half))) / lobe.value(1.0) == pytest.approx(0.5, abs=1e-3)


def test_soft_edges_are_linear_and_around_the_half_angle() -> None:
    lobe = ConeLobe(half_angle_deg=20.0, edge_deg=10.0)
    inner, outer = np.cos(np.radians([15.0, 25.0]))
    assert lobe.value(outer - 1e-9) == 0
    assert lobe.value(inner) == lobe.value(1.0)
    assert lobe.value(0.5 * (inner + outer)) / lobe.value(1.0) == pytest.approx(0.5)


# --- spectra ------------------------------------------------------------------------------------------------------


def test_cell_means_keep_the_power() -> None:
    nodes, values = np.array([400.0, 410.0, 411.0, 500.0]), np.array([0.0, 5.0, 1.0, 2.0])
    wl = np.arange(395.0, 511.0, 7.0)
    low, high = cell_edges(wl)
    means = cell_means(nodes, values, wl)
    assert np.sum(means * (high - low)) == pytest.approx(np.trapezoid(values, nodes), rel=1e-13)
    fine = np.linspace(low[3], high[3], 100001)
    assert means[3] == pytest.approx(np.trapezoid(np.interp(fine, nodes, values), fine) / (high[3] - low[3]), rel=1e-6)
    assert cell_means(nodes, values, [410.0]) == [5.0]


@pytest.mark.parametrize("name", lamp_names())
def test_shipped_spectra_hold_their_watts(name: str) -> None:
    spectrum = lamp_spectrum(name)
    wl = np.arange(spectrum.wavelengths[0], spectrum.wavelengths[-1] + 1, 4.0)
    low, high = cell_edges(wl)
    assert np.sum(spectrum_shape(spectrum, wl) * (high - low)) == pytest.approx(1.0, rel=2e-3)  # the ends of the grid


def test_efficacies_of_light() -> None:
    """Monochromatic light of 555 nm has 683 lm/W by definition, sodium's D lines 0.77 of it (CIE: V(589) = 0.769)."""
    narrow = SpectralTable(wavelengths=(554.0, 555.0, 556.0), values=(0.0, 1.0, 0.0))
    assert luminous_efficacy(narrow) == pytest.approx(683.0, rel=1e-3)
    assert luminous_efficacy(lamp_spectrum("low-pressure-sodium")) / 683.0 == pytest.approx(0.769, abs=0.008)
    # Of the visible part alone: white LEDs 300 to 350 lm/W, an incandescent lamp 150 to 200 (380 to 780 nm).
    assert 300 < luminous_efficacy(lamp_spectrum("led-4000k")) < 350
    assert 150 < luminous_efficacy(lamp_spectrum("incandescent")) < 200


def test_colours_of_the_shipped_spectra() -> None:
    """Chromaticities x, y as the CIE states them for its illuminants (CIE 15:2018, tables 10.1 to 12)."""
    stated = {
        "high-pressure-sodium": (0.5330, 0.4150),
        "fluorescent": (0.3721, 0.3751),
        "triphosphor": (0.3805, 0.3769),
        "led-2700k": (0.4560, 0.4078),
        "led-4000k": (0.3756, 0.3723),
        "incandescent": (0.4476, 0.4074),
    }
    eye = read_table("cie1931.csv")
    for name, (x, y) in stated.items():
        shape = spectrum_shape(lamp_spectrum(name), eye["wavelength_nm"])
        tristimulus = np.array(
            [np.trapezoid(shape * eye[c], eye["wavelength_nm"]) for c in ("x_bar", "y_bar", "z_bar")]
        )
        assert tristimulus[:2] / tristimulus.sum() == pytest.approx((x, y), abs=1.5e-3), name


def test_watts_and_lumens() -> None:
    wl = np.arange(380.0, 781.0, 10.0)
    low, high = cell_edges(wl)
    watts = PointLamp(position=(0, 0, 0), watts=20.0, spectrum="led-2700k")
    assert np.sum(watts.spectral_amount(wl) * (high - low)) == pytest.approx(20.0, rel=2e-3)
    lumens = PointLamp(position=(0, 0, 0), lumens=1000.0, spectrum="led-2700k")
    efficacy = luminous_efficacy(lamp_spectrum("led-2700k"))
    np.testing.assert_allclose(lumens.spectral_amount(wl) * efficacy, watts.spectral_amount(wl) * 50.0, rtol=1e-12)
    sunlight = ParallelLamp(elevation_deg=20.0, azimuth_deg=0.0, lux=1e5, spectrum="sun")
    # 1361 W/m2 of sunlight are about 133 klx outside of the air.
    assert 900 < np.trapezoid(sunlight.spectral_amount(np.arange(280.0, 4000.0)), np.arange(280.0, 4000.0)) < 1100


def test_radiance_of_a_surface() -> None:
    """Lambert's: power = pi radiance area; another lobe: radiance along the normal."""
    assert AreaLamp(radiance=2.0).spectral_power([550.0], 3.0) == pytest.approx(6 * np.pi)
    beam = AreaLamp(radiance=2.0, lobe=ConeLobe(half_angle_deg=60.0, edge_deg=20.0))
    power = beam.spectral_power([550.0], 3.0)[0]
    assert power * beam.lobe.value(1.0) / 3.0 == pytest.approx(2.0)


BAD: tuple[tuple[Any, dict[str, Any], str], ...] = (
    (PointLamp, {}, "give exactly one of power, watts, lumens"),
    (PointLamp, {"power": 0.0}, "power = 0.0: a lamp gives light"),
    (PointLamp, {"power": -1.0}, "power = -1.0: is never negative"),
    (PointLamp, {"watts": 0.0, "spectrum": "sun"}, "watts = 0.0"),
    (PointLamp, {"watts": 5.0}, "spectrum = None: goes with watts or lumens"),
    (PointLamp, {"power": 1.0, "spectrum": "sun"}, "spectrum = 'sun': goes with watts or lumens"),
    (PointLamp, {"power": 1.0, "watts": 5.0}, "give exactly one of"),
    (PointLamp, {"watts": 5.0, "spectrum": "led-4000"}, "did you mean led-4000k?"),
    (PointLamp, {"lumens": 5.0, "spectrum": {"wavelengths": [900, 950], "values": [1, 1]}}, "cannot be seen"),
    (PointLamp, {"power": 1.0, "axis": (0, 0, 0)}, "axis = (0.0, 0.0, 0.0): must point somewhere"),
    (PointLamp, {"power": 1.0, "target": (1, 2, 3)}, "target = (1.0, 2.0, 3.0): is where the lamp is"),
    (PointLamp, {"power": 1.0, "axis": (0, 0, 1), "target": (0, 0, 0)}, "give axis or target"),
    (SpotLamp, {"power": 1.0, "half_angle_deg": 0.0}, "half_angle_deg = 0.0"),
    (SpotLamp, {"power": 1.0, "half_angle_deg": 5.0, "edge_deg": 20.0}, "edge_deg = 20.0"),
    (Led, {"power": 1.0, "half_angle_deg": 90.0}, "half_angle_deg = 90.0"),
)


@pytest.mark.parametrize(("lamp", "given", "message"), BAD)
def test_bad_lamps_are_refused_in_one_line(lamp: Any, given: dict[str, Any], message: str) -> None:
    assert message in complaint(lambda: lamp(position=(1, 2, 3), **given))


def test_bad_light_from_outside_and_of_surfaces() -> None:
    assert "give either direction" in complaint(lambda: ParallelLamp(irradiance=1.0))
    assert "elevation_deg = 95" in complaint(lambda: ParallelLamp(irradiance=1.0, azimuth_deg=0, elevation_deg=95))
    assert "exactly one of radiance, watts_per_m2_sr" in complaint(
        lambda: Surroundings(radiance=1.0, watts_per_m2_sr=1)
    )
    assert "shines into the body" in complaint(lambda: AreaLamp(power=1.0, lobe=IsotropicLobe()))
    assert "use a point lamp" in complaint(lambda: AreaLamp(power=1.0, lobe=CityLobe()))
    assert "intensities.1 = -1" in complaint(lambda: TabulatedLobe(angles_deg=(0, 90), intensities=(1, -1)))
    assert "must rise" in complaint(lambda: TabulatedLobe(angles_deg=(0, 0), intensities=(1, 1)))


def test_illuminants_of_colour_science_are_lamps_too() -> None:
    """HP1 is shipped under the name of what it is, on nodes 5 nm apart; others come from the library."""
    for theirs, ours in (("HP1", "high-pressure-sodium"), ("led-b3", "led-4000k")):
        named, shipped = (luminous_efficacy(lamp_spectrum(name)) for name in (theirs, ours))
        assert named == pytest.approx(shipped, rel=1e-3)
    with pytest.raises(DomainError, match="or an illuminant of colour-science"):
        lamp_spectrum("FL99")
