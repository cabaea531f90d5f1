"""A veil on a plain picture: fitted once, taken off pixel by pixel; what stays as it was, and what comes off."""

from __future__ import annotations

import numpy as np
import pictures
import pytest
from pydantic import ValidationError

from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.picture.lattice import new_lattice
from skyscatter.dehaze.picture.options import PictureOptions
from skyscatter.dehaze.picture.transfer import decode, encode, tables
from skyscatter.dehaze.picture.veil import Veil, fit_picture, fit_veil
from skyscatter.errors import DomainError


@pytest.fixture(scope="module")
def hazy_city() -> np.ndarray:
    return pictures.veiled(pictures.shown(pictures.city()), "white")


def known_veil(
    shape: tuple[int, int], depth: float | np.ndarray, airlight: float = 0.6, cell: int = 4, **options: object
) -> Veil:
    """A veil that was not fitted."""
    field = np.broadcast_to(np.asarray(depth, float), (-(-shape[0] // cell), -(-shape[1] // cell))).copy()
    a = np.full(3, airlight)
    black = np.zeros(3)
    return Veil(
        field, 0 * field + 0.1, np.ones(3), a, 0.1 * a, 0.0, 0.5, 1.0, 0.0, black, cell, PictureOptions(**options)
    )


def test_strength_zero_returns_the_picture(hazy_city):
    for transfer in ("linear", "srgb", 1.8):
        veil = fit_picture(hazy_city, PictureOptions(transfer=transfer))
        out, _ = veil.apply(hazy_city, strength=0.0)
        np.testing.assert_array_equal(out, hazy_city.astype(np.float32))


def test_strength_takes_off_a_share_of_the_depth(hazy_city):
    veil = fit_picture(hazy_city)
    half, _ = veil.apply(hazy_city, strength=0.5)
    gain = np.exp(0.5 * veil.ratio * veil.depth.mean())[:, None, None]
    expected = veil.airlight[:, None, None] * (1 - gain) + hazy_city * gain
    inside = (expected > 0) & (expected.max(axis=0) < 0.89)
    assert inside.mean() > 0.8
    # single precision: eight steps of 6e-8 at values below 2
    np.testing.assert_allclose(half[inside], expected[inside], atol=1e-6)


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
def test_a_known_veil_comes_off_exactly(transfer):
    light = decode(pictures.shown(pictures.fields(64)) * 0.85, transfer)
    depth = 0.7
    hazy = encode(light * np.exp(-depth) + 0.6 * (1 - np.exp(-depth)), transfer)
    out, _ = known_veil((64, 64), depth, transfer=transfer).apply(hazy)
    # tables of 4097 nodes: 1e-5 of the scale, and twice that through the gain
    np.testing.assert_allclose(out, encode(light, transfer), atol=1e-6 if transfer == "linear" else 5e-5)


@pytest.mark.parametrize("edge", [1, 7, 64, 100])
def test_any_window_gives_the_same_bits(hazy_city, edge):
    field = pictures.veiled(pictures.shown(pictures.city()), "front")
    veil = fit_picture(field)
    assert np.ptp(veil.depth) > 0.2
    whole, flags = veil.apply(field)
    rows = range(0, 30 if edge == 1 else field.shape[1], edge)
    for r in rows:
        for c in rows:
            part, part_flags = veil.apply(field[:, r : r + edge, c : c + edge], r, c)
            np.testing.assert_array_equal(part, whole[:, r : r + edge, c : c + edge])
            np.testing.assert_array_equal(part_flags, flags[r : r + edge, c : c + edge])


def test_statistics_do_not_depend_on_the_windows(hazy_city):
    options = PictureOptions(cells=32)
    whole = new_lattice(192, 192, 3, options)
    whole.gather(hazy_city, 0, 0, options)
    parts = new_lattice(192, 192, 3, options)
    edge = 7 * parts.cell
    for r in reversed(range(0, 192, edge)):
        for c in range(0, 192, edge):
            parts.gather(hazy_city[:, r : r + edge, c : c + edge], r, c, options)
    for name in ("low", "high", "mean", "variance", "brightest", "darkest", "number"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert whole.number.sum() <= 192 * 192
    np.testing.assert_allclose(whole.mean[0, 0, 0], hazy_city[0, : whole.cell, : whole.cell].mean(), rtol=1e-6)
    np.testing.assert_array_equal(fit_veil(parts, options).depth, fit_veil(whole, options).depth)


def test_a_window_that_cuts_cells_is_refused(hazy_city):
    options = PictureOptions(cells=32)
    lattice = new_lattice(192, 192, 3, options)
    with pytest.raises(DomainError, match="multiples of 6"):
        lattice.gather(hazy_city[:, 3:15, :12], 3, 0, options)


def test_grey_things_stay_grey_under_a_grey_veil():
    rng = np.random.default_rng(3)
    grey = pictures.shown(pictures.city()).mean(axis=0)
    picture = np.stack([grey, grey, grey])
    picture[:, :96] = pictures.shown(pictures.city())[:, :96]
    hazy = picture * 0.5 + 0.3 + rng.normal(0, 1e-4, picture.shape)
    out, _ = fit_picture(hazy).apply(hazy)
    part = out[:, 100:]
    # 0.02 of the scale: a step of five in 8 bits, below what is seen as a tint on textured ground
    assert np.abs(part - part.mean(axis=0)).max(axis=0).mean() < 0.02


def test_a_step_has_no_halo():
    """Two surfaces with a straight edge between them, under one veil: each side stays flat up to the edge."""
    rng = np.random.default_rng(4)
    picture = np.empty((3, 192, 192))
    picture[:, :, :96], picture[:, :, 96:] = 0.1, 0.7
    picture += 0.05 * rng.normal(size=(1, 192, 192)) * np.array([1.0, 0.9, 0.8])[:, None, None]
    hazy = np.clip(picture * 0.5 + 0.3, 0, 1)
    veil = fit_picture(hazy)
    out, _ = veil.apply(hazy)
    for side in (out[:, :, :96], out[:, :, 96:]):
        columns = side.mean(axis=(0, 1))
        # noise of a column's mean: 0.05 x 2.5 / sqrt(192) = 0.009 for values clipped or not
        assert np.ptp(columns) < 0.06
    near, far = out[:, :, 88:96].mean(), out[:, :, 40:60].mean()
    assert abs(near - far) < 0.01


@pytest.mark.parametrize("scene", list(pictures.SCENES))
def test_a_clear_picture_stays_as_it_is(scene):
    clear = pictures.shown(pictures.SCENES[scene]())
    out, _ = fit_picture(clear).apply(clear)
    assert np.abs(out - clear).mean() < 0.02


@pytest.mark.parametrize("scene", list(pictures.SCENES))
@pytest.mark.parametrize("veil", ["thin white", "white", "blue haze", "front", "patches"])
def test_a_veil_comes_off(scene, veil):
    clear = pictures.shown(pictures.SCENES[scene]())
    hazy = pictures.veiled(clear, veil)
    out, _ = fit_picture(hazy).apply(hazy)
    assert pictures.psnr(out, clear) > pictures.psnr(hazy, clear) + 2.0


@pytest.mark.parametrize("veil", ["thick white", "air", "brown"])
def test_no_veil_does_harm(veil):
    for scene in pictures.SCENES.values():
        clear = pictures.shown(scene())
        hazy = pictures.veiled(clear, veil)
        out, _ = fit_picture(hazy).apply(hazy)
        assert pictures.psnr(out, clear) > pictures.psnr(hazy, clear) + 0.3


#: Airlights of red, green and blue that no layer has which scatters sunlight without absorbing.
COLOURED = {
    "light blue": (0.55, 0.62, 0.72),
    "yellow": (0.70, 0.60, 0.38),
    "brown": (0.66, 0.58, 0.45),
    "deep blue": (0.35, 0.50, 0.80),
    "blue": (0.45, 0.58, 0.75),
    "orange": (0.75, 0.55, 0.30),
}


@pytest.mark.parametrize(
    ("scenes", "colours", "depths"),
    [
        pytest.param(["city", "fields"], 4, (0.35, 1.0), id="some"),
        pytest.param(list(pictures.SCENES), 6, (0.35, 0.7, 1.2), marks=pytest.mark.slow, id="all"),
    ],
)
def test_colour_that_a_veil_leaves_is_told(scenes, colours, depths):
    """A cast above 10 in a* b* is flagged, and sigma holds what veils leave.

    10 is just above what is left of a thin brown veil (depth 0.35) where cities and seas have dark ends enough to look
    clear; thicker veils are all flagged.  Shares of values within sigma: 0.98 and 0.70 of all, 0.98 and 0.67 of some.
    """
    inside = {"grey": [], "coloured": []}
    for name in scenes:
        clear = pictures.shown(pictures.SCENES[name](128))
        for airlight in [(0.62,) * 3, *COLOURED.values()][: colours + 1]:
            for depth in depths:
                t = np.exp(-depth)
                hazy = np.round((clear * t + np.array(airlight)[:, None, None] * (1.0 - t)) * 255) / 255
                veil = fit_picture(hazy)
                out, flags = veil.apply(hazy)
                kind = "grey" if len(set(airlight)) == 1 else "coloured"
                inside[kind].append((np.abs(out - clear) <= veil.uncertainty(hazy)).mean())
                if kind == "coloured":
                    told = veil.pale and bool(((flags & Flag.UNCERTAIN) != 0).all())
                    assert told or (depth == 0.35 and cast(out, clear) < 10.0), (name, airlight, depth)
    shares = {kind: float(np.mean(found)) for kind, found in inside.items()}
    assert shares["grey"] > 0.9, shares
    assert shares["coloured"] > 0.6, shares


def cast(picture, truth):
    """Mean difference in a* and b*."""
    import colour

    def lab(x):
        shown = np.clip(x[:, ::3, ::3].astype(float), 0.0, 1.0)
        return colour.XYZ_to_Lab(colour.sRGB_to_XYZ(np.moveaxis(shown, 0, -1)))

    return np.hypot(*(lab(picture) - lab(truth))[..., 1:].reshape(-1, 2).mean(axis=0))


@pytest.mark.parametrize("scene", list(pictures.SCENES))
def test_clear_pictures_with_something_dark_are_not_doubted(scene):
    veil = fit_picture(pictures.shown(pictures.SCENES[scene]()))
    assert not veil.pale
    assert veil.diagnostics()["dark_end"] == pytest.approx(list(veil.floor), abs=1e-4)


def test_the_map_follows_a_front():
    size = 192
    hazy = pictures.veiled(pictures.shown(pictures.fields(size)), "front")
    veil = fit_picture(hazy)
    columns = veil.depth.mean(axis=0)
    place = (np.arange(len(columns)) + 0.5) / len(columns)
    assert columns[place < 0.35].max() < 0.25
    assert columns[place > 0.65].min() > 0.6
    assert np.ptp(fit_picture(hazy, PictureOptions(shape="uniform")).depth) == 0.0


def test_blue_air_is_told_from_fog():
    clear = pictures.shown(pictures.city())
    alpha = {name: fit_picture(pictures.veiled(clear, name)).alpha for name in ("white", "blue haze", "air")}
    assert alpha["white"] < 0.3 < alpha["blue haze"] < alpha["air"]
    fixed = fit_picture(pictures.veiled(clear, "air"), PictureOptions(alpha=4.0))
    assert fixed.alpha == pytest.approx(4.0)
    expected = (np.array([600.0, 545.0, 465.0]) / 550.0) ** -4
    # means over the posterior of depths, whose ratios are not those of the mean depth: the second order of its width,
    # some per cent of the excess of the blue
    np.testing.assert_allclose(fixed.ratio, expected, rtol=0.02)


def test_clouds_keep_their_structure_and_are_flagged():
    picture = pictures.shown(pictures.fields())
    y, x = np.mgrid[:192, :192]
    cloud = 0.97 - 0.08 * np.hypot(x - 96, y - 96) / 30
    hazy = pictures.veiled(picture, "white")
    inside = np.hypot(x - 96, y - 96) < 30
    hazy[:, inside] = cloud[inside]
    out, flags = fit_picture(hazy).apply(hazy)
    assert np.all(flags[inside] & (Flag.CLOUD | Flag.SATURATED))
    line = out[0, 96, 97:125]
    assert out.max() <= 1.0
    assert np.all(np.diff(line) < 0)


def test_no_data_and_saturated_pixels_are_flagged_and_left_out(hazy_city):
    plain = fit_picture(hazy_city)
    holed = hazy_city.copy()
    holed[:, :30] = np.nan
    holed[1, 100, 100] = 1.0
    veil = fit_picture(holed)
    out, flags = veil.apply(holed)
    assert np.all(np.isnan(out[:, :30]))
    assert np.all(flags[:30] == Flag.NODATA)
    assert flags[100, 100] & Flag.SATURATED
    assert np.all(np.isfinite(out[:, 30:]))
    assert out[:, 30:].min() >= 0.0
    assert veil.depth[-1].mean() == pytest.approx(plain.depth.mean(), abs=0.15)


@pytest.mark.parametrize("value", [np.nan, 0.0, 0.5, 0.97, 1.0])
def test_pictures_of_nothing_come_back_as_they_are(value):
    flat = np.full((3, 40, 50), value)
    out, flags = fit_picture(flat).apply(flat)
    assert out.shape == flat.shape
    if np.isnan(value):
        assert np.all(flags == Flag.NODATA)
        assert np.all(np.isnan(out))
    else:
        assert np.all((out >= 0.0) & (out <= 1.0))
    if value >= 0.97:
        assert np.all(flags & (Flag.CLOUD | Flag.SATURATED))


@pytest.mark.parametrize("shape", [(1, 1), (2, 300), (3, 5), (257, 130)])
def test_odd_sizes(shape):
    picture = np.random.default_rng(0).uniform(0.3, 0.7, (3, *shape))
    out, flags = fit_picture(picture).apply(picture)
    assert out.shape == (3, *shape)
    assert flags.shape == shape
    assert np.all(np.isfinite(out))


def test_one_band():
    options = PictureOptions(wavelengths=(650.0,))
    clear = pictures.shown(pictures.city())[:1]
    hazy = clear * 0.5 + 0.33
    out, _ = fit_picture(hazy, options).apply(hazy)
    # without colours there is less to go by than in the same picture of three bands
    assert pictures.psnr(out, clear) > pictures.psnr(hazy, clear) + 3.0


def test_uncertainty_covers_the_error():
    """Over scenes and veils: two standard deviations hold most of the errors, and they are not idle."""
    inside = []
    for scene in pictures.SCENES.values():
        clear = pictures.shown(scene(128))
        for name in ("thin white", "white", "blue haze"):
            hazy = pictures.veiled(clear, name)
            veil = fit_picture(hazy)
            error = np.abs(veil.apply(hazy)[0] - clear)
            inside.append((error < 2.0 * veil.uncertainty(hazy)).mean())
    assert np.mean(inside) > 0.8


def test_uncertainty_of_a_certain_veil_is_its_rounding():
    veil = known_veil((8, 8), 0.7)
    certain = Veil(**{**veil.__dict__, "depth_sigma": 0 * veil.depth, "airlight_sigma": np.zeros(3)})
    sigma = certain.uncertainty(np.full((3, 8, 8), 0.5))
    np.testing.assert_allclose(sigma, np.exp(0.7) / 255 / np.sqrt(12), rtol=1e-5)


@pytest.mark.parametrize("transfer", ["srgb", 2.2, 0.5])
def test_transfer_and_its_tables_invert(transfer):
    x = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(encode(decode(x, transfer), transfer), x, atol=1e-7)
    decoding, encoding = tables(transfer)
    nodes = np.linspace(0, 1, len(decoding))
    np.testing.assert_allclose(
        np.interp(x, nodes, decoding), decode(x, transfer), atol=2e-3 if transfer == 0.5 else 1e-6
    )
    np.testing.assert_allclose(np.interp(np.sqrt(x), nodes, encoding), encode(x, transfer), atol=1e-4)


def test_wrong_input_is_named(hazy_city):
    with pytest.raises(ValidationError, match="transfer"):
        PictureOptions(transfer="rec709")
    with pytest.raises(DomainError, match="bands"):
        fit_picture(hazy_city[:2])
    with pytest.raises(DomainError, match="image"):
        fit_picture(hazy_city[0])
    with pytest.raises(DomainError, match="size"):
        fit_picture(np.zeros((3, 0, 4)))
    veil = fit_picture(hazy_city)
    with pytest.raises(DomainError, match="strength"):
        veil.apply(hazy_city, strength=1.5)
    with pytest.raises(DomainError, match="window"):
        veil.apply(hazy_city[:1])


def test_diagnostics_are_plain_numbers(hazy_city):
    import json

    found = fit_picture(hazy_city).diagnostics()
    assert json.loads(json.dumps(found))["kind"] == "relative"
    assert 0.5 < found["probability"] <= 1.0
