"""Pictures of the night as an eye and as a camera see them, and maps of the sky's brightness."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.image.colour import xyz_weights
from skyscatter.image.nightvision import BALANCE, adaptation, as_the_eye, balanced, scotopic_luminance
from skyscatter.image.photometry import VEGA_ZERO
from skyscatter.image.skybrightness import contours, magnitudes, painted

WAVELENGTHS = np.arange(380.0, 781.0, 10.0)
ARCSEC2 = (np.pi / 648000.0) ** 2


def image_of(radiance):
    return skyscatter.SpectralImage(np.asarray(radiance, float), WAVELENGTHS)


def test_scotopic_efficiency_by_its_known_points() -> None:
    """CIE 1951: highest at 507 nm, 0.455 at 450 nm, 0.1212 at 580 nm; 1700 lm/W there, 683 at 555 nm by definition."""
    table = read_table("scotopic.csv")
    at = dict(zip(table["wavelength_nm"].tolist(), table["efficiency"].tolist(), strict=True))
    assert (at[450.0], at[580.0]) == pytest.approx((0.455, 0.1212), abs=5e-4)  # printed to so many digits
    best = max(at, key=lambda nm: at[nm])
    assert abs(best - 507.0) <= 5.0  # steps of the table
    assert at[555.0] * 1699.0 == pytest.approx(683.0, rel=0.005)


def test_luminance_of_an_even_spectrum() -> None:
    table = read_table("scotopic.csv")
    whole = 1699.0 * np.trapezoid(table["efficiency"], table["wavelength_nm"])
    # Cells of 10 nm, and what lies outside of 380 to 780 nm: 1e-3 each.
    assert scotopic_luminance(np.ones(WAVELENGTHS.size), WAVELENGTHS) == pytest.approx(whole, rel=3e-3)
    assert scotopic_luminance(np.ones(1), np.array([550.0])) == pytest.approx(whole)


def test_adaptation_solves_its_equation() -> None:
    photopic = np.geomspace(1e-5, 100.0, 30)
    scotopic = 2.3 * photopic
    m, mesopic = adaptation(photopic, scotopic)
    ratio = 683.0 / 1699.0
    np.testing.assert_allclose((m * photopic + (1 - m) * scotopic * ratio) / (m + (1 - m) * ratio), mesopic, rtol=2e-3)
    between = (m > 0) & (m < 1)
    assert between.sum() > 10
    np.testing.assert_allclose(m[between], 0.7670 + 0.3334 * np.log10(mesopic[between]), atol=2e-3)
    # Recommended limits: rods alone below 0.005, cones alone from 5 cd m-2 on.
    assert m[mesopic < 0.005].max(initial=0.0) < 0.01
    assert m[mesopic > 5.0].min() > 0.99
    np.testing.assert_allclose(mesopic[m == 1.0], photopic[m == 1.0])


def test_the_eye_loses_colours_in_the_dark_and_keeps_them_by_day() -> None:
    red = np.exp(-0.5 * ((WAVELENGTHS - 640.0) / 10.0) ** 2)
    xyz = red @ xyz_weights(WAVELENGTHS)
    rods = scotopic_luminance(red, WAVELENGTHS)
    for light, coloured in ((1e5 / xyz[1], True), (1e-4 / xyz[1], False)):
        seen = as_the_eye(light * xyz, light * rods)
        chromaticity = seen[:2] / seen.sum()
        expected = xyz[:2] / xyz.sum() if coloured else [0.25, 0.25]
        np.testing.assert_allclose(chromaticity, expected, atol=2e-3)
    dim = as_the_eye(1e-4 / xyz[1] * xyz, 1e-4 / xyz[1] * rods)
    assert dim[1] < 0.2e-4  # Purkinje: red is dark for rods


def test_white_balance_begins_by_night_only() -> None:
    rng = np.random.default_rng(1)
    xyz = rng.uniform(0.5, 1.5, (8, 8, 1)) * np.array([1.3, 1.0, 0.5])
    assert balanced(xyz, BALANCE[0] + 0.1) is xyz
    half, full = balanced(xyz, -3.5), balanced(xyz, -6.0)

    def warmth(picture):
        return float((picture[..., 0] / picture[..., 2]).mean())

    assert warmth(xyz) > warmth(half) > warmth(full) > 1.0


def test_magnitudes_of_known_brightness() -> None:
    curve = VEGA_ZERO["V"] * 10 ** (-0.4 * 21.5) / ARCSEC2
    image = image_of(np.full((2, 3, WAVELENGTHS.size), curve))
    np.testing.assert_allclose(magnitudes(image), 21.5, atol=1e-9)
    np.testing.assert_allclose(
        magnitudes(image, "B"), 21.5 - 2.5 * np.log10(VEGA_ZERO["V"] / VEGA_ZERO["B"]), atol=1e-9
    )
    with pytest.raises(DomainError, match="filters = 'K'"):
        magnitudes(image, "K")


def test_no_light_has_no_magnitude() -> None:
    cube = np.zeros((1, 2, WAVELENGTHS.size))
    cube[0, 1] = 1e-9
    found = magnitudes(image_of(cube))
    assert np.isnan(found[0, 0])
    assert np.isfinite(found[0, 1])
    with pytest.raises(DomainError, match="no light"):
        painted(image_of(np.zeros((1, 2, WAVELENGTHS.size))))


def test_contours_lie_between_their_values() -> None:
    values = np.tile(np.linspace(20.05, 21.95, 20), (5, 1))
    lines = contours(values, 0.5)
    columns = np.flatnonzero(lines.any(axis=0))
    assert lines[:, columns].all()
    # On the brighter side of 20.5, 21.0 and 21.5.
    assert values[0, columns] == pytest.approx([20.45, 20.95, 21.45])


def test_a_map_is_bright_where_the_sky_is() -> None:
    ramp = 10 ** (-0.4 * np.linspace(0, 2, 40))[None, :, None] * np.ones((30, 1, WAVELENGTHS.size)) * 1e-7
    picture, defined, made = painted(image_of(ramp))
    assert defined.all()
    assert made["contours"] == 0.2  # the finest step with at most 12
    light = picture.sum(axis=2)[15]
    plain = light[~contours(magnitudes(image_of(ramp)), 0.2)[15]]
    assert np.all(np.diff(plain) <= 1e-12)


def test_the_command_says_what_shines_and_makes_a_map(tmp_path, capsys) -> None:
    words = ["sky", "earth-simple", "--place", "-24.6,-70.4", "--time", "2026-04-18T07:00Z", "--view", "fisheye"]
    words += ["--size", "16x16", "--wavelengths", "480:640:20", "--lights", "starlight,zodiacal,airglow", "--without"]
    words += ["airglow", "--show", "magnitudes", "-o", str(tmp_path / "map.png"), "--json", "-q"]
    assert main(words) == 0
    assert '"lights": ["starlight", "zodiacal"]' in capsys.readouterr().out
    assert (tmp_path / "map.png").stat().st_size > 100


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--lights", "moon,lamps"], "lights = lamps"),
        (["--without", "sonne"], "without = sonne"),
        (["--solar-flux", "1000"], "solar_flux = 1000"),
        (["--stars", "none.csv"], "stars = none.csv"),
        (["--show", "magnitudes", "--wavelengths", "380:440:10"], "wavelengths"),
    ],
)
def test_wrong_wishes_are_refused_in_a_line(words, said, capsys) -> None:
    command = ["sky", "--place", "48.9,2.3", "--time", "2026-04-18T23:00Z", "-o", "never.png", *words]
    assert main(command) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0].replace("'", "")


def test_lights_without_a_place_are_refused(capsys) -> None:
    assert main(["sky", "--lights", "moon", "-o", "never.png"]) == 2
    assert "needs --place and --time" in capsys.readouterr().err


def test_a_dome_by_night_has_a_dark_sun(tmp_path) -> None:
    words = ["sky", "earth-simple", "--place", "46.5,7.9", "--time", "2026-01-03T22:00Z", "--size", "16x8", "--no-sun"]
    assert main([*words, "--wavelengths", "450,550,650", "-o", str(tmp_path / "dome.exr"), "-q"]) == 0
    lamp = json.loads((tmp_path / "dome.sun.json").read_text())
    assert lamp["sun"]["illuminance_lx"] == 0.0
    assert lamp["sun"]["elevation_deg"] < -18
