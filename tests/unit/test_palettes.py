"""Three filters as red, green and blue: levels, hues, and the asinh curve against astropy's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from astropy.visualization import make_lupton_rgb

from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage
from skyscatter.image.palettes import PALETTES, auto_levels, auto_stretch, lupton, plane_picture
from skyscatter.image.png import read_png
from skyscatter.image.tone import encode

WL = np.arange(380.0, 781.0, 5.0)


def nebula(faint: float = 1e-9) -> SpectralImage:
    """A bright core and a dim rim on black; the lines of the narrow bands differ by a factor of 100 in all."""
    y, x = np.mgrid[-1:1:40j, -1:1:50j]
    r = np.hypot(x, y)
    cube = np.zeros((40, 50, WL.size))
    for line, strength in ((656.46, 1.0), (500.82, 0.3), (672.55, 0.01)):
        cell = np.argmin(np.abs(WL - line))
        cube[..., cell] += strength * np.exp(-((r / 0.3) ** 2) * line / 500.0)
    cube[0, 0] = np.nan
    return SpectralImage(faint * cube, WL, recipe={"model": "ring"})


def test_asinh_curve_is_that_of_astropy() -> None:
    planes = np.random.default_rng(0).random((30, 40, 3)) * np.geomspace(1e-3, 1.0, 40)[:, None]
    stretch, softening = 0.5, 8.0
    theirs = make_lupton_rgb(*np.moveaxis(planes, -1, 0), minimum=0.0, stretch=stretch, Q=softening, output_dtype=float)
    # astropy scales the paper's curve such that its slope changes least with Q, by this constant
    scale = 0.1 * softening / np.arcsinh(0.1 * softening)
    ours = lupton(planes, stretch, softening)
    unclipped = theirs.max(axis=-1) < 0.999
    assert unclipped.mean() > 0.5
    np.testing.assert_allclose(theirs[unclipped], scale * ours[unclipped], rtol=1e-5)  # float32 within astropy


def test_highlights_keep_their_hue() -> None:
    colour = np.array([0.9, 0.3, 0.05])
    shown = lupton(colour * np.geomspace(1e-4, 1e6, 50)[:, None], 0.1, 8.0)
    np.testing.assert_allclose(shown / shown[:, :1], np.tile(colour / colour[0], (50, 1)), rtol=1e-12)  # rounding
    assert shown.max() <= 1.0
    assert np.all(np.diff(shown[:, 0]) >= 0.0)
    np.testing.assert_array_equal(lupton(np.zeros((2, 3)), 1.0, 8.0), 0.0)
    # a softening near 0 is a straight line to white at the stretch
    np.testing.assert_allclose(lupton(np.full((1, 3), 0.05), 0.1, 1e-6), 0.5, rtol=1e-9)


def test_light_of_stars_turns_white_where_it_is_overexposed() -> None:
    """The brighter, the whiter: the middle of a star is no hole in what is around it."""
    blue = np.array([0.4, 0.6, 1.0])
    shown = lupton(blue * np.geomspace(1e-4, 1e6, 200)[:, None], 0.1, 8.0, pale=1.0)
    assert np.all(np.diff(shown, axis=0) > -1e-12)
    below = shown.max(axis=1) < 1.0
    np.testing.assert_allclose(shown[below] / shown[below, 2:], np.tile(blue, (below.sum(), 1)), rtol=1e-12)
    assert 0.8 < shown[-1].min() < shown.max() == 1.0
    # half of it: half the way to white
    half, none = (lupton(blue * 1e6, 0.1, 8.0, pale=pale) for pale in (0.5, 0.0))
    np.testing.assert_allclose(half, (none + shown[-1]) / 2, rtol=1e-12)


def test_levels_are_percentiles_of_each_plane_or_of_all() -> None:
    planes = np.linspace(0.0, 1.0, 1001)[None, :, None] * np.array([1.0, 2.0, 4.0]) + 1.0
    own = auto_levels(planes, own=True)
    # 1st percentile, and the 99.5th of the 990 values above it; one value is 1e-3
    np.testing.assert_allclose(own[0], (1.01, 1.99505), atol=1e-3)
    np.testing.assert_allclose(own[2], (1.04, 4.9802), atol=4e-3)
    assert auto_levels(planes, own=False) == [(own[0][0], own[2][1])] * 3
    assert auto_levels(-planes, own=True)[0][0] == 0.0
    assert auto_levels(np.full((2, 2, 3), np.nan), own=True) == [(0.0, 0.0)] * 3


@pytest.mark.parametrize(
    ("palette", "channels"), [("sho", (2, 0, 1)), ("hubble", (2, 0, 1)), ("hos", (0, 1, 2)), ("hoo", (0, 1, 1))]
)
def test_palettes_of_lines(palette: str, channels: tuple[int, ...]) -> None:
    made = nebula()
    shown = plane_picture(made, palette)
    # Each line has levels of its own: the faintest, 100 times fainter, is as bright as the others.
    assert shown.picture[20, 25].min() > 0.95
    assert shown.made["filters"] == [("halpha", "oiii", "sii")[n] for n in channels]
    whites = [white for _, white in shown.made["levels"]]
    bands = made.through("halpha,oiii,sii").radiance
    # the 99.5th percentile of what is above black, the first percentile
    planes = [bands[..., n][np.isfinite(bands[..., n])] for n in channels]
    expected = [np.percentile(plane[plane > np.percentile(plane, 1.0)], 99.5) for plane in planes]
    np.testing.assert_allclose(whites, expected, rtol=1e-12)
    assert not shown.opaque[0, 0]
    np.testing.assert_array_equal(shown.picture[0, 0], 0.0)
    assert shown.picture[20, 0].max() < 0.2  # black stays black


def test_equal_radiance_is_grey_in_broad_bands() -> None:
    flat = SpectralImage(np.linspace(0.1, 1.0, 12).reshape(3, 4, 1) * np.ones(WL.size), WL)
    for options in ({"palette": "rvb"}, {"filters": ["R", "V", "B"]}, {"filters": "oiii,V,halpha", "tone": "linear"}):
        picture = plane_picture(flat, **options).picture  # type: ignore[arg-type]
        np.testing.assert_allclose(picture, np.repeat(picture[..., :1], 3, axis=-1), rtol=1e-9, atol=1e-12)  # rounding
        assert np.ptp(picture) > 0.9


def test_brightness_as_told() -> None:
    flat = SpectralImage(np.full((1, 1, WL.size), 0.25), WL)
    levels = [(0.05, 1.05)] * 3
    linear = plane_picture(flat, "rvb", tone="linear", levels=levels).picture
    np.testing.assert_allclose(linear, encode(0.2), rtol=1e-9)  # rounding
    curve = plane_picture(flat, "rvb", stretch=0.5, softening=3.0, levels=levels).picture
    np.testing.assert_allclose(curve, np.arcsinh(3.0 * 0.2 / 0.5) / 3.0, rtol=1e-9)
    # by default the curve reaches white at the white level
    white = plane_picture(flat, "rvb", levels=[(0.0, 0.25)] * 3).picture
    np.testing.assert_allclose(white, 1.0, rtol=1e-9)


def test_few_pixels_are_white_by_default() -> None:
    rng = np.random.default_rng(1)
    planes = rng.random((200, 100, 3)) ** 4 * rng.choice([1e-3, 1.0], (200, 100, 1))
    for softening in (0.1, 5.0, 20.0):
        stretch = auto_stretch(planes, softening)
        mean = planes.mean(axis=-1)
        peak = planes.max(axis=-1) * np.arcsinh(softening * mean / stretch) / softening / mean
        # by the definition of a percentile, to one pixel of 2e4
        assert (peak > 1.0).mean() == pytest.approx(0.005, abs=1e-4)
    assert auto_stretch(np.zeros((2, 2, 3)), 5.0) == pytest.approx(5.0 / np.sinh(5.0))


def test_png_of_a_palette(tmp_path: Path) -> None:
    made = nebula()
    made.save(tmp_path / "a.png", palette="sho", bits=16)
    back = read_png(tmp_path / "a.png")
    shown = plane_picture(made, "sho")
    np.testing.assert_array_equal(back.pixels[..., :3], np.rint(shown.picture * 65535))
    np.testing.assert_array_equal(back.pixels[..., 3] > 0, shown.opaque)
    told = json.loads(back.texts["skyscatter-picture"])
    assert (told["palette"], told["tone"], told["softening"]) == ("sho", "lupton", 8.0)
    # what the file states makes the same picture again
    again = {name: told[name] for name in ("filters", "levels", "tone", "stretch", "softening")}
    made.save(tmp_path / "b.png", bits=16, **again)
    np.testing.assert_array_equal(read_png(tmp_path / "b.png").pixels, back.pixels)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"palette": "loud"}, "sho, hubble, hos, hoo, rvb"),
        ({"palette": "sho", "filters": "R,V,B"}, "names its own"),
        ({"filters": "R,V"}, "three"),
        ({"filters": "U,V,B"}, "needs light"),
        ({"tone": "lupton"}, "palette or three filters"),
        ({"palette": "sho", "tone": "filmic"}, "lupton or linear"),
        ({"palette": "sho", "tone": "linear", "stretch": 2.0}, "nothing to the tone linear"),
        ({"palette": "sho", "exposure": 3.0}, "exposure"),
        ({"palette": "sho", "space": "srgb"}, "space"),
        ({"palette": "sho", "show": "degree"}, "show"),
        ({"palette": "sho", "softening": 0.0}, "above 0"),
        ({"palette": "sho", "stretch": float("nan")}, "above 0"),
        ({"palette": "sho", "levels": [(1.0, 0.5)] * 3}, "three pairs"),
        ({"palette": "sho", "levels": "high"}, "three pairs"),
        ({"stretch": 1.0}, "natural colour"),
        ({"levels": "auto"}, "natural colour"),
        ({"show": "degree", "softening": 1.0}, "colours are fixed"),
    ],
)
def test_refusals(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        nebula().save(tmp_path / "a.png", **options)
    assert list(tmp_path.iterdir()) == []


def test_every_palette_names_filters_that_exist() -> None:
    for name in PALETTES:
        assert plane_picture(nebula(), name).picture.shape == (40, 50, 3)


@pytest.mark.parametrize("faint", [1e-3, 1e-9, 1e-15])
def test_natural_colour_of_faint_light(tmp_path: Path, faint: float) -> None:
    """However faint, the automatic exposure finds the nebula on its black background."""
    made = nebula(faint)
    made.save(tmp_path / "a.png")
    pixels = read_png(tmp_path / "a.png").pixels[..., :3]
    bright = pixels.max(axis=-1)
    assert bright[20, 25] > 200
    assert bright[20, 0] < 40
    # the same picture at any level of light
    np.testing.assert_allclose(bright, np.rint(nebula(1.0).picture().max(axis=-1) * 255), atol=1)
    assert abs(made.auto_exposure()) < 100
