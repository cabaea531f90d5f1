"""Cells of an image: where they lie, what is gathered in them, the map of the haze, and what is applied to pixels."""

from __future__ import annotations

import numpy as np
import pytest
from dehaze_tables import bands_of

from skyscatter.dehaze import masks
from skyscatter.dehaze.flagcount import FlagCount
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.gather import ENOUGH, Gathered, at_dark_pixels, look
from skyscatter.dehaze.hazemap import ROUNDED, curvature, neighbours, regularised
from skyscatter.dehaze.lattice import LEAST_LARGE, MOST_LARGE, MOST_SMALL, Lattice, linear_weights
from skyscatter.dehaze.rasters.windows import windows
from skyscatter.errors import DomainError
from skyscatter.kernels.raster.correct import correct, spread

BANDS = bands_of("B02", "B03", "B04", "B08", "B11")


@pytest.mark.parametrize("shape", [(1, 1), (17, 5), (513, 512), (3000, 77), (10980, 10980)])
def test_cells_cover_the_image_and_nest(shape):
    lattice = Lattice.of(*shape)
    assert lattice.large % lattice.small == 0
    assert lattice.large >= LEAST_LARGE
    assert max(lattice.small_shape) <= MOST_SMALL
    assert max(lattice.large_shape) <= MOST_LARGE
    for cells, size in ((lattice.small_shape, lattice.small), (lattice.large_shape, lattice.large)):
        for count, pixels in zip(cells, shape, strict=True):
            assert (count - 1) * size < pixels <= count * size
    assert lattice.small_centres()[0][0] == 0.5 * lattice.small
    assert lattice.large_centres()[1][0] == 0.5 * lattice.large


def test_the_sizes_of_cells():
    assert (Lattice.of(1, 1).small, Lattice.of(1, 1).large) == (1, 16)
    assert (Lattice.of(17, 5).small_shape, Lattice.of(17, 5).large_shape) == ((17, 5), (2, 1))
    full = Lattice.of(10980, 10980)
    assert (full.small, full.large, full.small_shape, full.large_shape) == (22, 88, (500, 500), (125, 125))
    with pytest.raises(DomainError, match="has no pixels"):
        Lattice.of(0, 5)


def test_to_small_keeps_planes_within_the_outer_centres():
    lattice = Lattice.of(1100, 700)
    rows, cols = lattice.large_centres()
    plane = 0.3 + 2e-4 * rows[:, None] - 1e-4 * cols
    y, x = lattice.small_centres()
    inside = [np.clip(points, nodes[0], nodes[-1]) for points, nodes in ((y, rows), (x, cols))]
    expected = 0.3 + 2e-4 * inside[0][:, None] - 1e-4 * inside[1]
    np.testing.assert_allclose(lattice.to_small(plane), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(linear_weights(y, rows).sum(axis=1), 1.0, rtol=0, atol=1e-12)


def gathered(values, clear, lattice, size):
    seen = Gathered.empty(lattice, len(values))
    for window in windows(*values.shape[1:], size, lattice.large):
        part = values[:, window.row0 : window.row1, window.col0 : window.col1]
        found = look(part.copy(), clear[window.row0 : window.row1, window.col0 : window.col1], [0, 1, 2], lattice)
        seen.put(window.row0, window.col0, found)
    return seen


def noisy(shape, seed=0):
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.02, 0.4, (4, *shape)).astype(np.float32)
    clear = rng.uniform(size=shape) > 0.2
    values[:, rng.uniform(size=shape) > 0.9] = np.nan
    values[1, rng.uniform(size=shape) > 0.97] = np.nan
    return values, clear & np.isfinite(values).all(axis=0)


@pytest.mark.parametrize(("shape", "sizes"), [((150, 90), (16, 33, 64, 4096)), ((37, 9001), (16, 700, 2048, 20000))])
def test_windows_of_any_size_gather_the_same_bits(shape, sizes):
    values, clear = noisy(shape)
    lattice = Lattice.of(*shape)
    first, *others = (gathered(values, clear, lattice, size) for size in sizes)
    assert np.isfinite(first.dark).any()
    for other in others:
        for name in ("mean", "dark", "pixels", "where"):
            np.testing.assert_array_equal(getattr(first, name), getattr(other, name))


def test_cells_hold_means_and_the_darkest_clear_pixels():
    values = np.full((3, 16, 20), 0.3, np.float32)
    clear = np.ones((16, 20), bool)
    dark = [(2, 3), (5, 15), (9, 0), (15, 7)]
    for k, place in enumerate(dark):
        values[:, place[0], place[1]] = np.array([0.05, 0.04, 0.06]) + 0.001 * k
    values[:, 1, 1], clear[1, 1] = 0.01, False  # darker, and under a cloud
    values[0, 4, 4], clear[4, 4] = np.nan, False
    seen = gathered(values, clear, Lattice.of(16, 20), 64)
    # A fiftieth of 254 pixels is five: the four, and one of the others.
    expected = (4 * np.array([0.0515, 0.0415, 0.0615]) + 0.3) / 5
    np.testing.assert_allclose(seen.dark[:, 0, 0], expected, rtol=0, atol=1e-6)
    assert seen.pixels.tolist() == [[254, 64]]
    assert np.isnan(seen.mean[:, 4, 4]).all()
    assert seen.mean[0, 1, 1] == np.float32(0.01)
    assert seen.where.sum() == 5 + 4
    assert all(seen.where[place] == 1 for place in dark)
    # Of the surroundings too the mean over those pixels.
    picked = at_dark_pixels(seen, np.where(seen.where > 0, 2.0, np.nan)[None])
    np.testing.assert_array_equal(picked, [[[2.0, 2.0]]])


def test_cells_with_few_clear_pixels_are_not_judged():
    values = np.full((3, 16, 16), 0.1, np.float32)
    clear = np.zeros((16, 16), bool)
    clear.ravel()[: ENOUGH - 1] = True
    assert np.isnan(gathered(values, clear, Lattice.of(16, 16), 16).dark).all()
    clear.ravel()[ENOUGH] = True
    np.testing.assert_allclose(gathered(values, clear, Lattice.of(16, 16), 16).dark, 0.1, rtol=1e-6)
    nothing = gathered(np.full_like(values, np.nan), clear & False, Lattice.of(16, 16), 16)
    assert np.isnan(nothing.mean).all()
    assert np.isnan(at_dark_pixels(nothing, nothing.mean.astype(float))).all()


#: Reflectances in `BANDS` above the atmosphere, less the air below: thick cloud, thick haze over leaves, snow, a roof.
AIR = np.array([0.07, 0.04, 0.02, 0.01, 0.0], np.float32)
LOOKS = {
    "cloud": ((0.62, 0.60, 0.60, 0.62, 0.50), True),
    "haze": ((0.25, 0.22, 0.18, 0.30, 0.15), False),
    "snow": ((0.75, 0.75, 0.74, 0.70, 0.08), False),
    "tiles": ((0.36, 0.45, 0.70, 0.75, 0.70), False),
    "nothing": ((np.nan,) * 5, False),
}


@pytest.mark.parametrize("name", LOOKS)
def test_clouds_are_white_and_bright_and_not_snow(name):
    spectrum, expected = LOOKS[name]
    values = np.array(spectrum, np.float32)[:, None, None]
    with np.errstate(invalid="ignore"):
        assert masks.clouds(values, AIR, masks.BandRoles(BANDS))[0, 0] == expected


def test_water_and_shadow():
    surfaces = {
        "lake": (0.03, 0.03, 0.015, 0.004, 0.002),
        "leaves": (0.02, 0.05, 0.03, 0.35, 0.15),
        "shade": (0.004, 0.005, 0.005, 0.03, 0.02),
        "asphalt": (0.08, 0.09, 0.10, 0.12, 0.15),
    }
    values = np.array(list(surfaces.values()), np.float32).T[:, :, None]
    roles = masks.BandRoles(BANDS)
    wet = masks.water(values, roles)
    assert wet[:, 0].tolist() == [True, False, False, False]
    assert masks.shadow(values, roles, wet)[:, 0].tolist() == [False, False, True, False]
    blind = masks.BandRoles(BANDS[:3])  # no infrared: neither can be told
    assert not masks.water(values[:3], blind).any()
    assert not masks.shadow(values[:3], blind, wet).any()


def test_a_narrow_near_infrared_stands_in():
    roles = masks.BandRoles(bands_of("B02", "B03", "B04", "B8A", "B09"))
    assert roles.get("nir") == 3
    assert roles.visible == [0, 1, 2]
    assert roles.get("swir1") is None


def test_flags_are_counted_by_pixel():
    mask = np.zeros((10, 10), np.uint8)
    mask[:2] = Flag.CLOUD
    mask[0] |= np.uint8(Flag.SATURATED)
    whole, parts = FlagCount(), FlagCount()
    whole.add(mask)
    for row in mask[::-1]:
        parts.add(row[None])
    assert whole.shares() == parts.shares()
    assert whole.shares() == dict.fromkeys((f.name.lower() for f in Flag), 0.0) | {"cloud": 0.2, "saturated": 0.1}


def test_the_map_without_neighbours_is_the_weighted_mean():
    """Hardly any price on steps: each cell is the mean of what it says and the image's haze, by their variances."""
    rng = np.random.default_rng(1)
    said, sigma = rng.uniform(0.1, 0.5, (5, 7)), rng.uniform(0.02, 0.1, (5, 7))
    said[2, 3], sigma[2, 3] = 0.0, np.inf
    found, error = regularised(said, sigma, 0.3, 0.2, step=1e9)
    precision = 1 / sigma**2
    expected = (precision * said + 0.3 / 0.2**2) / (precision + 1 / 0.2**2)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(error, 1 / np.sqrt(precision + 1 / 0.2**2), rtol=1e-6)


def test_the_error_of_the_map_is_the_curvature_of_the_sum():
    """On a lattice larger than the probes are apart, against the inverse itself."""
    rng = np.random.default_rng(5)
    shape = (30, 25)
    said, sigma = 0.3 + 0.05 * rng.standard_normal(shape), rng.uniform(0.03, 0.2, shape)
    found, error = regularised(said, sigma, 0.3, 0.2, step=0.02)
    first, second = neighbours(shape)
    weight = 1 / (0.02 * np.sqrt((found.ravel()[first] - found.ravel()[second]) ** 2 + ROUNDED**2))
    matrix = curvature((1 / sigma**2 + 1 / 0.2**2).ravel(), first, second, weight).toarray()
    expected = np.sqrt(np.diag(np.linalg.inv(matrix))).reshape(shape)
    # Single variances are off by a third, means of 25 by a fifteenth; at corners they mix what differs by a tenth.
    off = error / expected - 1
    assert np.sqrt((off**2).mean()) < 0.05
    assert np.abs(off).max() < 0.25


def test_one_cell():
    found, error = regularised(np.array([[0.4]]), np.array([[0.1]]), 0.2, 0.1)
    assert found[0, 0] == pytest.approx(0.3, abs=1e-9)
    assert error[0, 0] == pytest.approx(0.1 / np.sqrt(2), rel=1e-9)


def test_a_front_stays_sharp_and_noise_is_smoothed():
    rng = np.random.default_rng(2)
    truth = np.where(np.arange(40) < 20, 0.15, 0.45) * np.ones((40, 1))
    noise = 0.03
    said = truth + noise * rng.standard_normal(truth.shape)
    found, error = regularised(said, np.full(truth.shape, noise), 0.3, 0.3, step=0.02)
    # Two thirds of the noise at least are gone, and of the step of 0.3 no more than that noise.
    assert (found - truth)[:, :19].std() < noise / 3
    jump = found[:, 20] - found[:, 19]
    assert abs(jump.mean() - 0.3) < noise
    assert np.all(error > 0)
    assert np.all(error < noise)


def test_the_error_of_the_map_falls_with_what_is_known():
    said = np.full((12, 12), 0.3)
    sigma = np.full((12, 12), np.inf)
    nothing = regularised(said, sigma, 0.3, 0.1)[1]
    sigma[3:9, 3:9] = 0.05
    some = regularised(said, sigma, 0.3, 0.1)[1]
    more = regularised(said, sigma / 2, 0.3, 0.1)[1]
    assert np.all(nothing > 0)
    assert some[5, 5] < nothing[5, 5]
    assert more[5, 5] < some[5, 5]
    assert some[5, 5] < some[0, 0]
    # The mean of 36 cells at best, and no better.
    assert more[5, 5] > 0.025 / 6
    # What only the image says, bound to neighbours that know no better, is known no better than that.
    assert np.all(nothing <= 0.1 * (1 + 1e-9))


def coefficients(rng, bands, cells, bend):
    gain = rng.uniform(1.0, 1.4, (bands, *cells))
    offset = -rng.uniform(0.05, 0.15, (bands, *cells))
    curve = rng.uniform(0.05, 0.25, (bands, *cells)) if bend else np.zeros((bands, 0, 0))
    return [a.astype(np.float32) for a in (gain, offset, curve)]


def pixels_of(cells, shape, size):
    """Bilinear values (band, y, x) of cells, by numpy."""
    along = [
        linear_weights(np.arange(n) + 0.5, (np.arange(c) + 0.5) * size)
        for n, c in zip(shape, cells.shape[1:], strict=True)
    ]
    return np.einsum("yi,bij,xj->byx", along[0], cells.astype(float), along[1])


@pytest.mark.parametrize("bend", [False, True])
@pytest.mark.parametrize(("shape", "size"), [((21, 34), 8), ((5, 7), 1), ((3, 4), 16)])
def test_the_correction_is_that_of_the_formula_in_any_window(bend, shape, size):
    rng = np.random.default_rng(3)
    cells = tuple(-(-n // size) for n in shape)
    gain, offset, curve = coefficients(rng, 2, cells, bend)
    values = rng.uniform(0.02, 0.6, (2, *shape)).astype(np.float32)
    values[0, 0, 1] = np.nan
    net = pixels_of(gain, shape, size) * values + pixels_of(offset, shape, size)
    expected = net / (1 + pixels_of(curve, shape, size) * net) if bend else net
    negative = expected < 0
    out, clipped = np.empty_like(values), np.zeros(shape, bool)
    correct(values, 0, 0, size, gain, offset, curve, out, clipped)
    # float32: a few roundings of numbers up to 1
    np.testing.assert_allclose(out, np.where(negative, 0.0, expected), rtol=0, atol=5e-7)
    np.testing.assert_array_equal(clipped, negative.any(axis=0))
    for row0, col0 in ((1, 0), (2, 3)):
        part = np.ascontiguousarray(values[:, row0:, col0:])
        again, marks = np.empty_like(part), np.zeros(part.shape[1:], bool)
        correct(part, row0, col0, size, gain, offset, curve, again, marks)
        np.testing.assert_array_equal(again, out[:, row0:, col0:])
        np.testing.assert_array_equal(marks, clipped[row0:, col0:])


@pytest.mark.parametrize("bend", [False, True])
def test_the_spread_is_that_of_finite_differences(bend):
    rng = np.random.default_rng(4)
    shape, size, cells = (12, 10), 4, (3, 3)
    gain, offset, curve = coefficients(rng, 2, cells, bend)
    haze = rng.uniform(-0.01, 0.01, (2, 2, *cells)).astype(np.float32)
    models = rng.uniform(-0.01, 0.01, (3, 2, 2, *cells)).astype(np.float32)
    floor, relative = rng.uniform(0, 0.004, (2, *cells)).astype(np.float32), np.array([0.01, 0.03], np.float32)
    values = rng.uniform(0.2, 0.6, (2, *shape)).astype(np.float32)

    def corrected(by=None, extra=0.0):
        g, o = gain.astype(float), offset.astype(float)
        if by is not None:
            g, o = g + 1e-4 * by[0], o + 1e-4 * by[1]
        net = pixels_of(g, shape, size) * values + pixels_of(o, shape, size) + extra
        return net / (1 + pixels_of(curve, shape, size) * net) if bend else net

    usual = corrected()
    parts = [(corrected(by) - usual) / 1e-4 for by in (haze, *models)]
    parts.append((corrected(extra=1e-4 * pixels_of(floor, shape, size)) - usual) / 1e-4)
    net = pixels_of(gain, shape, size) * values + pixels_of(offset, shape, size)
    parts.append((corrected(extra=1e-4 * relative[:, None, None] * net) - usual) / 1e-4)
    expected = np.sqrt(sum(part**2 for part in parts))
    out = np.empty_like(values)
    spread(values, 0, 0, size, gain, offset, curve, haze, models, floor, relative, out)
    # One-sided steps of 1e-4 of what is at most 0.02: second order is below 1e-5 of the result.
    np.testing.assert_allclose(out, expected, rtol=1e-4, atol=1e-8)
    part = np.ascontiguousarray(values[:, 3:, 2:])
    again = np.empty_like(part)
    spread(part, 3, 2, size, gain, offset, curve, haze, models, floor, relative, again)
    np.testing.assert_array_equal(again, out[:, 3:, 2:])
