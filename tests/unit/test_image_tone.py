"""Exposure, gamut mapping, tone and encoding: bounded, monotonic, and true to the hue."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage, channels, glare, tone
from skyscatter.image.colour import SPACES, luminance_weights, rgb_to_xyz_matrix, xyz_to_rgb

DISPLAYS = ["srgb", "display-p3", "rec2020"]


def spectral_colours(space: str) -> np.ndarray:
    """Linear RGB of nearly monochromatic lights, most of them outside every display's gamut."""
    wavelengths = np.arange(390.0, 721.0, 2.0)
    centres = np.arange(410.0, 691.0, 5.0)
    lines = np.exp(-0.5 * ((wavelengths - centres[:, None]) / 4.0) ** 2)
    return SpectralImage(lines[None], wavelengths).rgb(space)[0]


def chromaticity(rgb: np.ndarray, space: str) -> np.ndarray:
    xyz = rgb @ rgb_to_xyz_matrix(SPACES[space]).T
    return xyz[..., :2] / xyz.sum(axis=-1, keepdims=True)


def oklab(rgb: np.ndarray, space: str) -> np.ndarray:
    """Oklab from its definition, XYZ with D65 in, without the package's own helper."""
    first = np.linalg.inv(
        [[1.2270138511, -0.5577999807, 0.2812561490], [-0.0405801784, 1.1122568696, -0.0716766787],
         [-0.0763812845, -0.4214819784, 1.5861632204]]
    )  # fmt: skip
    second = [[0.2104542553, 0.793617785, -0.0040720468], [1.9779984951, -2.428592205, 0.4505937099],
              [0.0259040371, 0.7827717662, -0.808675766]]  # fmt: skip
    return np.cbrt(rgb @ rgb_to_xyz_matrix(SPACES[space]).T @ first.T) @ np.transpose(second)


@pytest.mark.parametrize("space", DISPLAYS)
def test_gamut_mapping_keeps_luminance_and_dominant_wavelength(space: str) -> None:
    colours = spectral_colours(space)
    assert (colours.min(axis=-1) < 0).mean() > 0.9  # the test is about colours outside
    mapped = tone.map_gamut(colours, space)
    assert mapped.min() >= 0.0
    weights = luminance_weights(SPACES[space])
    np.testing.assert_allclose(mapped @ weights, colours @ weights, rtol=1e-10)  # rounding
    white = np.array(SPACES[space].white)
    before, after = chromaticity(colours, space) - white, chromaticity(mapped, space) - white
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    # On one ray from white (cross product zero up to rounding), on the same side, and closer to it.
    np.testing.assert_allclose(cross, 0.0, atol=1e-12)
    assert np.all(np.sum(before * after, axis=1) > 0.0)
    assert np.all(np.linalg.norm(after, axis=1) <= np.linalg.norm(before, axis=1) + 1e-12)


def test_gamut_mapping_leaves_colours_inside_alone() -> None:
    inside = np.random.default_rng(1).random((100, 3))
    np.testing.assert_array_equal(tone.map_gamut(inside), inside)
    np.testing.assert_array_equal(tone.map_gamut([[0.0, 0.0, 0.0], [-1.0, 0.1, 0.0]]), np.zeros((2, 3)))


@pytest.mark.parametrize("kind", tone.TONES)
@pytest.mark.parametrize("space", DISPLAYS)
def test_brighter_never_looks_darker_and_nothing_leaves_the_display(kind: str, space: str) -> None:
    colours = np.concatenate(
        [tone.map_gamut(spectral_colours(space), space), np.eye(3), 1 - np.eye(3), np.ones((1, 3))]
    )
    colours /= colours.max(axis=-1, keepdims=True)
    weights = luminance_weights(SPACES[space])
    steps = np.stack([tone.apply_tone(colours * level, kind, space) for level in np.geomspace(1e-4, 1e6, 400)])
    assert steps.min() >= 0.0
    assert steps.max() <= 1.0 + 1e-12  # rounding
    assert np.diff(steps @ weights, axis=0).min() >= -1e-12  # rounding


def test_linear_tone_keeps_the_chromaticity_of_overexposed_colours() -> None:
    orange = np.array([5.0, 2.0, 0.5])
    np.testing.assert_allclose(tone.apply_tone(orange, "linear"), orange / 5.0, rtol=1e-15)  # rounding
    np.testing.assert_allclose(tone.apply_tone(orange / 10, "linear"), orange / 10, rtol=1e-15)  # rounding


@pytest.mark.parametrize("colour", [(0.1, 0.3, 1.0), (1.0, 0.45, 0.05), (0.05, 0.05, 1.0), (1.0, 0.1, 0.05)])
@pytest.mark.parametrize("space", DISPLAYS)
def test_filmic_highlights_keep_their_hue_on_the_way_to_white(colour: tuple[float, ...], space: str) -> None:
    levels = np.geomspace(0.05, 40.0, 30)[:, None]
    shown = tone.apply_tone(np.array(colour) * levels, "filmic", space)
    lab = oklab(shown, space)
    hue = np.unwrap(np.arctan2(lab[:, 2], lab[:, 1]))
    # 0.02 rad: pure blue leaves the gamut by up to 8e-4 on its way and is brought back at its dominant wavelength
    np.testing.assert_allclose(hue, hue[0], atol=0.02)
    np.testing.assert_allclose(tone.apply_tone(np.array(colour) * 1e5, "filmic", space), 1.0, atol=1e-9)  # rounding


def test_filmic_curve() -> None:
    x = np.concatenate([[0.0], np.geomspace(1e-6, 1e9, 2000)])
    y = tone.filmic_curve(x)
    assert y[0] == 0.0
    assert y[-1] == 1.0
    assert np.all(np.diff(y) >= 0.0)
    # Narkowicz (2015): x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), by hand at 1 (rounding)
    assert tone.filmic_curve(1.0) == pytest.approx(2.54 / 3.16, rel=1e-14)


def test_encoding_is_that_of_srgb() -> None:
    # IEC 61966-2-1, to the digits of the worked values: 0.18 -> 0.4614, 0.5 -> 0.7354
    np.testing.assert_allclose(tone.encode([0.0, 0.001, 0.18, 0.5, 1.0]), [0, 0.01292, 0.46136, 0.73536, 1], atol=1e-5)


def test_metering() -> None:
    # The "sunny 16" rule is EV 15: ISO 2720 with K = 12.5 meters 4096 cd m-2 there; both are exact.
    assert tone.metered_luminance(15.0) == 4096.0
    # what is metered lies 0.7 stops above mid grey: a sky is lighter than what is below it
    assert tone.auto_ev100(np.full((4, 4), 4096.0)) == pytest.approx(15.0 - 0.7, abs=1e-12)  # rounding


def test_automatic_exposure_does_not_burn_a_nebula_out() -> None:
    """A bright core in faint gas: by its average alone the core would be far beyond white."""
    faint = np.full((100, 100), 0.01)
    faint[:20, :25] = np.geomspace(1.0, 5.0, 500).reshape(20, 25)  # 5 % of the picture
    ev100 = tone.auto_ev100(faint)
    shown = tone.filmic_curve(tone.MID_GREY * faint / tone.metered_luminance(ev100))
    assert shown[:20, :25].max() < 1.0
    assert shown[:20, :25].min() > 0.5
    average = tone.filmic_curve(tone.MID_GREY * faint / 0.01)
    assert average[:20, :25].min() == 1.0  # what it would have been


def test_automatic_exposure_ignores_sun_shadow_space_and_what_is_outside() -> None:
    sky = np.full((100, 100), 3000.0)
    plain = tone.auto_ev100(sky)
    odd = sky.copy()
    odd[0, :20] = 1e9  # the Sun's disk
    odd[1:50] = 0.0  # black space
    odd[50:60] = np.nan  # outside a fisheye
    odd[60:70] = 1e-3  # the faint upper rim of an atmosphere
    assert tone.auto_ev100(odd) == pytest.approx(plain, abs=1e-12)  # rounding
    assert tone.auto_ev100(np.zeros((3, 3))) == 0.0
    few = tone.auto_ev100([4000.0, 4200.0])  # of which none lies between the others
    assert tone.auto_ev100([4000.0] * 9) < few < tone.auto_ev100([4200.0] * 9)
    assert tone.auto_ev100(np.full((3, 3), np.nan)) == 0.0


@given(stops=st.floats(-20.0, 20.0))
def test_automatic_exposure_follows_the_light(stops: float) -> None:
    scene = np.geomspace(10.0, 1000.0, 500)
    shifted = tone.auto_ev100(scene * 2.0**stops)
    assert shifted == pytest.approx(tone.auto_ev100(scene) + stops, abs=0.02)  # a value may cross a percentile's edge


def test_mid_grey() -> None:
    grey = xyz_to_rgb(tone.metered_luminance(12.0) * np.array([0.3127 / 0.329, 1.0, 0.3583 / 0.329]))
    picture = tone.develop(grey, "srgb", 12.0, "linear")
    np.testing.assert_allclose(picture, tone.encode(0.18), rtol=1e-10)  # rounding


@pytest.mark.parametrize("exposure", ["bright", float("nan"), float("inf"), 1e9])
def test_wrong_exposure(exposure: object) -> None:
    with pytest.raises(DomainError, match="exposure"):
        tone.exposure_value(exposure, np.ones(3))  # type: ignore[arg-type]


def test_wrong_tone() -> None:
    with pytest.raises(DomainError, match="filmic, linear"):
        tone.apply_tone(np.ones(3), "loud")


def test_colours_are_as_strong_as_ciecam02_says() -> None:
    # F_L at 1000 cd m-2 is 0.1 (5000)^(1/3) = 1.710, at 20 cd m-2 0.1 (100)^(1/3) = 0.4642 (CIE 159:2004, k -> 0)
    assert tone.colourfulness("photograph", 3.0) == pytest.approx((1.710 / 0.4642) ** 0.25, rel=1e-3)  # digits
    assert tone.colourfulness("filmic", 3.0) == tone.colourfulness("linear", 3.0) == 1.0
    exposures = [np.log2(level / tone.metered_luminance(0.0)) for level in (1e-4, 1e-2, 1.0, 20.0, 1000.0, 1e4)]
    eye = [tone.colourfulness("eye", float(ev)) for ev in exposures]
    assert np.all(np.diff(eye) > 0.0)
    assert eye[0] < 0.2  # by starlight hardly any colour is left
    assert eye[3] == pytest.approx(1.0, rel=1e-12)  # rounding; as bright as the display
    assert eye[4] == pytest.approx(tone.colourfulness("photograph", 3.0), rel=1e-12)  # rounding


@pytest.mark.parametrize("space", DISPLAYS)
def test_stronger_colours_keep_lightness_and_hue(space: str) -> None:
    colours = np.random.default_rng(2).uniform(0.2, 1.0, (200, 3))
    before, after = (oklab(made, space) for made in (colours, tone._strengthened(colours, 1.4, space)))
    np.testing.assert_allclose(after[:, 0], before[:, 0], rtol=2e-4)  # white is 1e-4 off in the published digits
    turn = np.angle(np.exp(1j * (np.arctan2(*after[:, 2:0:-1].T) - np.arctan2(*before[:, 2:0:-1].T))))
    chroma = np.hypot(before[:, 1], before[:, 2])
    assert np.abs(turn[chroma > 0.05]).max() < 0.02  # as above: what leaves the space is brought back
    gain = np.hypot(after[:, 1], after[:, 2]) / chroma
    assert np.all(gain[chroma > 0.05] > 1.0)
    assert gain[chroma > 0.05].max() < 1.4 + 0.01  # the same white
    grey = np.full((1, 3), 0.3)
    # of the published digits: a grey has a chroma of 4e-8
    np.testing.assert_allclose(tone._strengthened(grey, 1.4, space), grey, rtol=1e-6)


def test_glare_is_a_hundredth_of_the_brightest_light_and_leaves_all_else_alone() -> None:
    picture = np.full((240, 320, 3), 0.2)
    assert glare.with_glare(picture) is picture
    sun = picture.copy()
    sun[120, 160] = [3e4, 2e4, 1e4]
    veil = glare.with_glare(sun) - sun
    # of the light beyond white; a tenth of the veil lies outside the picture, (1 + r^2 / r0^2)^(-1/2) of it beyond r
    assert 0.9 < veil[..., 0].sum() / (0.01 * (3e4 - glare.WHITE)) <= 1.05
    np.testing.assert_allclose(veil[100, 160], veil[140, 160], rtol=1e-6)  # round; rounding of the transforms
    np.testing.assert_allclose(veil[120, 140], veil[140, 160], rtol=1e-6)
    np.testing.assert_allclose(veil[120, 150, 0], veil[120, 150, 2] * 3.0, rtol=1e-6)  # of the light's own colour
    assert 0.0 <= veil.min() < veil[0, 0].max() < 0.01


def test_channels_are_compared_as_numpy_does() -> None:
    colours = np.random.default_rng(3).normal(size=(5, 7, 3))
    colours[2, 3, 1] = np.nan
    np.testing.assert_array_equal(channels.largest(colours), colours.max(axis=-1, keepdims=True))
    np.testing.assert_array_equal(channels.least(colours), colours.min(axis=-1, keepdims=True))


def test_glare_stays_in_the_circle_of_a_fisheye() -> None:
    rgb = np.full((40, 40, 3), 1000.0)
    rgb[20, 20] = 1e9
    rgb[:, :18] = np.nan
    shown = tone.develop(rgb, "srgb", 13.0, "photograph")
    assert not shown[:, :18].any()
    assert shown[20, 22].min() > tone.develop(rgb, "srgb", 13.0, "filmic")[20, 22].min()


def test_a_nebula_is_exposed_for_its_bright_part() -> None:
    """What is dim around it, and stars in it, do not count: the brightest tenth begins 1.2 stops above mid grey."""
    nebula = np.linspace(0.5, 1.0, 1000)
    dark, star = np.full(5000, 1e-5), [1e3, 1e3]
    found = tone.space_ev100(np.concatenate([nebula, dark, star]))
    stops = np.log2(np.percentile(nebula, 90.0) / tone.metered_luminance(found))
    # 2 stars among 1000 pixels raise the rank by 0.2 %
    assert stops == pytest.approx(tone.SPACE_LIFT, abs=0.01)
    assert tone.space_ev100(np.zeros(5)) == 0.0
    scene = {"view": {}, "medium": {}}
    cube = nebula.reshape(20, 50, 1) * np.ones(3)
    in_space = SpectralImage(cube, [450.0, 550.0, 650.0], recipe={"scene": scene})
    assert in_space.auto_exposure() > SpectralImage(cube, [450.0, 550.0, 650.0]).auto_exposure() - 0.6
    assert in_space.auto_exposure() == pytest.approx(tone.space_ev100(in_space.luminance()))
