"""Looks are names for options; asinh keeps the hue; a palette without, or with natural, light between the lines."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.image import SkyFrame, SpectralImage, tone
from skyscatter.image.looks import LOOKS, expanded
from skyscatter.image.palettes import plane_picture
from skyscatter.image.png import read_png
from skyscatter.lights import blackbody_exitance

WL = np.union1d(np.arange(380.0, 781.0, 10.0), [500.82, 656.46, 672.55])
SKY = SkyFrame(ra_deg=10.0, dec_deg=20.0, pixel_scale_deg=1.0 / 3600.0)
HOT, COOL = (6, 8), (18, 25)


def field() -> SpectralImage:
    """A nebula of lines, a hot and a cool star in front of black."""
    y, x = np.mgrid[-1:1:30j, -1:1:40j]
    cube = np.zeros((30, 40, WL.size))
    for line, strength in ((656.46, 1.0), (500.82, 0.5), (672.55, 0.2)):
        cube[..., np.argmin(np.abs(WL - line))] += strength * np.exp(-((x / 0.6) ** 2) - (y / 0.6) ** 2)
    for place, kelvin in ((HOT, 20000.0), (COOL, 3500.0)):
        black = blackbody_exitance(WL, kelvin)
        cube[place] += 5.0 * black / black.mean()
    return SpectralImage(1e-6 * cube, WL, sky=SKY)


def told(path: Path) -> dict:
    return json.loads(read_png(path).texts["skyscatter-picture"])


@pytest.mark.parametrize("look", LOOKS)
def test_a_look_is_its_options(look: str, tmp_path: Path) -> None:
    image = field()
    image.save(tmp_path / "look.png", look=look)
    image.save(tmp_path / "options.png", **LOOKS[look])
    first, second = read_png(tmp_path / "look.png"), read_png(tmp_path / "options.png")
    np.testing.assert_array_equal(first.pixels, second.pixels)
    made = told(tmp_path / "look.png")
    assert made.pop("look") == look
    assert made == told(tmp_path / "options.png")
    assert {name: made[name] for name in LOOKS[look]} == LOOKS[look]


def test_every_look_is_another_picture(tmp_path: Path) -> None:
    pictures = []
    for look in LOOKS:
        field().save(tmp_path / "a.png", look=look)
        pictures.append(read_png(tmp_path / "a.png").pixels.tobytes())
    assert len(set(pictures)) == len(LOOKS)


def test_what_is_given_beside_a_look_wins() -> None:
    assert expanded("deep", {"tone": "filmic", "exposure": None}) == {"tone": "filmic", "glare": "none"}
    assert expanded("hubble", {"palette": "hoo"}) == {**LOOKS["hubble"], "palette": "hoo"}
    of_filters = expanded("hubble", {"filters": "R,V,B"})
    assert "palette" not in of_filters
    assert of_filters["tone"] == "lupton"
    # a palette takes the place of natural colours, and so of their curve
    assert expanded("eye", {"palette": "sho"}) == {"palette": "sho"}
    assert expanded(None, {"tone": "eye", "glare": None}) == {"tone": "eye"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"look": "hubbel"}, "did you mean hubble"),
        ({"look": "loud"}, "there are eye, photograph"),
        ({"look": "hubble", "exposure": 3.0}, "exposure"),
        ({"look": "hubble", "tone": "filmic"}, "lupton or linear"),
        ({"look": "eye", "show": "degree"}, "look"),
        ({"glare": "loud"}, "gaussian"),
        ({"palette": "sho", "glare": "lens"}, "natural colour"),
        ({"continuum": "subtract"}, "natural colour"),
        ({"palette": "sho", "continuum": "double"}, "keep, subtract, natural"),
    ],
)
def test_refusals(options: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(DomainError, match=message):
        field().save(tmp_path / "a.png", **options)
    assert list(tmp_path.iterdir()) == []


def test_diffraction_needs_a_place_in_the_sky_and_the_continuum_wavelengths(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match="SkyFrame"):
        SpectralImage(np.ones((2, 2, WL.size)), WL).save(tmp_path / "a.png", glare="hubble")
    lines = SpectralImage(np.ones((2, 2, 3)), [500.82, 656.46, 672.55])
    with pytest.raises(DomainError, match="between the lines"):
        plane_picture(lines, "sho", continuum="subtract")


def test_asinh_keeps_hue_and_order() -> None:
    colour = np.array([0.9, 0.3, 0.05])
    levels = np.geomspace(1e-5, 1e5, 80)[:, None]
    shown = tone.apply_tone(colour * levels, "asinh")
    np.testing.assert_allclose(shown / shown[:, :1], np.tile(colour / colour[0], (80, 1)), rtol=1e-12)  # rounding
    assert np.all(np.diff(shown[:, 0]) >= 0.0)
    assert shown.max() <= 1.0
    # where filmic has gone to white a star still has its colour
    white = tone.apply_tone(colour * 1e3, "filmic")
    assert np.ptp(white) < 1e-6
    assert np.ptp(tone.apply_tone(colour * 1e3, "asinh")) > 0.9


def test_asinh_is_the_curve_that_it_says() -> None:
    x = np.geomspace(1e-6, 16.0, 50)
    shown = tone.encode(tone.asinh_curve(x))
    expected = np.arcsinh(x / tone.BEND) / np.arcsinh(tone.ASINH_WHITE / tone.BEND)
    np.testing.assert_allclose(shown, expected, atol=2e-7)  # the pieces of the encoding meet to seven digits
    assert tone.asinh_curve(tone.MID_GREY) == pytest.approx(tone.filmic_curve(tone.MID_GREY), rel=5e-3)  # as its text
    x = np.linspace(0.0, 1.0, 1001)
    np.testing.assert_allclose(tone.decode(tone.encode(x)), x, atol=1e-7)  # the same


def test_stars_go_with_the_light_between_the_lines() -> None:
    image = field()
    kept, bare = (plane_picture(image, "sho", continuum=how).picture for how in ("keep", "subtract"))
    for place in (HOT, COOL):
        assert kept[place].max() > 0.9
        around = bare[place[0], [place[1] - 1, place[1] + 1]].mean(axis=0)
        # Wien's law is 0.14 % off for the hot one, which is 18 times as bright as white in [S II]
        np.testing.assert_allclose(bare[place], around, atol=0.08)
    # the nebula itself is what it was without stars
    lines = np.asarray(image.radiance).copy()
    clear = ~np.isin(WL, [500.82, 656.46, 672.55])
    assert np.abs(lines[15, 20, clear]).max() == 0.0
    np.testing.assert_allclose(bare[15, 20], 1.0, atol=0.1)


def test_stars_in_their_own_colours() -> None:
    shown = plane_picture(field(), "sho", continuum="natural")
    assert shown.made["continuum"] == "natural"
    hot, cool = shown.picture[HOT], shown.picture[COOL]
    assert hot[2] > hot[0]  # blue
    assert cool[0] > 1.2 * cool[2]  # orange
    assert hot.min() > 0.5  # pale, as stars are: no hole in a bright nebula
    assert min(hot.max(), cool.max()) > 0.8


def test_diffraction_of_a_picture_with_a_palette_and_without(tmp_path: Path) -> None:
    for options in ({}, {"palette": "sho"}):
        stars = SpectralImage(np.where(np.arange(30)[:, None, None] == HOT[0], field().radiance, 0.0), WL, sky=SKY)
        stars.save(tmp_path / "sharp.png", glare="none", **options)
        stars.save(tmp_path / "wide.png", glare="airy:10cm", **options)
        sharp, wide = (read_png(tmp_path / name).pixels[..., :3].astype(int) for name in ("sharp.png", "wide.png"))
        y, x = HOT
        assert wide[y + 1, x].max() > sharp[y + 1, x].max() + 20  # no light was there
        assert told(tmp_path / "wide.png")["glare"] == "airy:10cm"


def test_a_lens_may_be_put_on_and_taken_off(tmp_path: Path) -> None:
    cube = np.full((40, 40, 3), 1e-6)
    cube[20, 20] = 1.0
    image = SpectralImage(cube, [450.0, 550.0, 650.0])

    def beside(**options: object) -> int:
        image.save(tmp_path / "a.png", exposure=3.0, **options)
        return int(read_png(tmp_path / "a.png").pixels[20, 24].max())

    assert beside() == beside(glare="lens") > 2 * beside(glare="none")
    assert beside(tone="filmic", glare="lens") > 2 * beside(tone="filmic")


@pytest.mark.parametrize("command", ["sky", "render"])
def test_skies_and_rooms_take_natural_looks(command: str, monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    seen = SimpleNamespace(png=None)
    monkeypatch.setattr(f"skyscatter.cli.{command}.run", lambda request, *rest: setattr(seen, "png", request.png) or 0)
    model = {"sky": "earth", "render": "fog-room"}[command]
    assert main([command, model, "--look", "deep", "--exposure", "5", "-o", "a.png"]) == 0
    assert seen.png == {"look": "deep", "tone": "asinh", "glare": "none", "exposure": 5.0, "space": "srgb"}
    assert main([command, model, "--glare", "none", "-o", "a.png"]) == 0
    assert seen.png == {"exposure": "auto", "tone": "photograph", "space": "srgb", "glare": "none"}
    for words, expected in (
        (["--look", "hubble"], "is for nebulae; choose one of eye, photograph, film, deep"),
        (["--look", "hubbel"], "did you mean hubble?"),
        (["--glare", "hubble"], "choose none or lens"),
    ):
        assert main([command, model, *words, "-o", "a.png"]) == 2
        error = capsys.readouterr().err
        assert expected in error
        assert error.count("\n") == 1
    assert main([command, model, "--look", "eye", "-o", "a.exr"]) == 2
    assert "is for PNG files" in capsys.readouterr().err


def test_nebulae_take_every_look(monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    seen = SimpleNamespace(request=None)
    monkeypatch.setattr("skyscatter.cli.nebula.run", lambda request, *rest: setattr(seen, "request", request) or 0)
    for look, options in LOOKS.items():
        assert main(["nebula", "ring-nebula", "--look", look, "-o", "a.png"]) == 0
        assert seen.request.png == {**options, "look": look}
        # a palette of lines has wavelengths at them
        assert (500.82 in seen.request.wavelengths) == ("palette" in options)
    for words, expected in (
        (["--look", "loud"], "there are eye"),
        (["--look", "hubble", "--exposure", "3"], "exposure"),
        (["--look", "hubble", "--wavelengths", "498,501,504,655,656.46,658,667,670,672.55,675,678"], "continuum"),
        (["--glare", "airy:wide"], "airy:2.4m"),
    ):
        assert main(["nebula", "ring-nebula", *words, "-o", "a.png"]) == 2
        error = capsys.readouterr().err
        assert expected in error, error
        assert error.count("\n") == 1
