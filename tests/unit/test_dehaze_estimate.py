"""What dark ground says of the haze, and the coefficients that follow: against the model they are made with."""

from __future__ import annotations

import numpy as np
import pytest
from dehaze_tables import air_of, bands_of, ground, made_up_table, seen_from_above

from skyscatter.dehaze.coefficients import Corrector, gain_and_offset
from skyscatter.dehaze.dark import ANYTHING, COVERS, cover_spectra, log_likelihood
from skyscatter.dehaze.estimate import PRIOR_MEDIAN, HazeEstimate, estimate, log_prior, moments, trial_depths
from skyscatter.dehaze.forward import Atmosphere, reflectance_above
from skyscatter.dehaze.lattice import Lattice
from skyscatter.dehaze.sensing import Gases
from skyscatter.dehaze.table import Angles
from skyscatter.kernels.raster.correct import correct

BANDS = bands_of("B02", "B03", "B04", "B8A", "B11", "B12")
SUN = 35.0


@pytest.fixture(scope="module")
def table():
    return made_up_table(Atmosphere(aerosol="continental"), BANDS, Angles.spanned(SUN, 0.0, 0.0))


@pytest.fixture(scope="module")
def covers():
    return cover_spectra(BANDS)


@pytest.mark.parametrize("cover", [0, 1, 2])
@pytest.mark.parametrize("aod", [0.1, 0.3, 0.8])
def test_a_covers_own_spectrum_is_most_likely_under_the_haze_above_it(table, covers, cover, aod):
    mean = covers.mean[cover]
    trials = trial_depths(2.0)
    _, at = air_of(table, SUN)
    observed = reflectance_above(at(np.array([aod])), mean[None])
    likelihood, kinds = log_likelihood(observed, observed, at(trials[None])[0][None], covers)
    best = int(likelihood[0].argmax())
    # The brightness of the ground gives way as well, and other covers compete: one pixel knows the depth to some 0.1,
    # and the truth lies within two standard deviations, where a normal law is lower by 2.
    assert likelihood[0, np.abs(trials - aod).argmin()] > likelihood[0, best] - 2.0
    assert abs(trials[best] - aod) < 0.3 * aod + 0.1
    assert kinds[ANYTHING, 0, best] < 0.5
    assert COVERS[cover].name in ("leaves", "clear water", "turbid water")


def test_negative_surfaces_are_improbable(table, covers):
    """Under more haze than there is the ground would have to be darker than black: an upper bound."""
    _, at = air_of(table, SUN)
    trials = np.array([0.1, 0.6, 1.2])
    terms = at(trials[None])[0][None]
    black = reflectance_above(at(np.array([0.1])), np.full((1, len(BANDS)), 0.002))
    likelihood, _ = log_likelihood(black, np.full((1, len(BANDS)), 0.05), terms, covers)
    assert likelihood[0, 0] > likelihood[0, 1] + 10
    assert likelihood[0, 1] > likelihood[0, 2] + 10


def test_surroundings_far_darker_than_the_haze_that_is_tried_are_black(covers):
    """Their reflectance has a pole there, where what they throw back would be more than all."""
    thick = np.broadcast_to([0.6, 0.01, 0.05, 0.28], (1, 1, len(BANDS), 4))
    dark = np.full((1, len(BANDS)), 0.05)
    likelihood, kinds = log_likelihood(dark, dark, thick, covers)
    assert np.isfinite(likelihood).all()
    assert np.isfinite(kinds).all()
    assert likelihood[0, 0] < -100


def test_ground_that_is_no_cover_is_said_to_be_unknown(table, covers):
    _, at = air_of(table, SUN)
    bright = np.array([0.45, 0.45, 0.45, 0.45, 0.05, 0.04])  # snow
    observed = reflectance_above(at(np.array([0.1])), bright[None])
    _, kinds = log_likelihood(observed, bright[None], at(np.array([[0.1]]))[0][None], covers)
    assert kinds[ANYTHING, 0, 0] > 0.99


def test_moments_of_a_normal_law():
    depths = trial_depths(2.0)
    mean, spread, total = moments(depths, -0.5 * ((depths - 0.6) / 0.15) ** 2)
    assert mean == pytest.approx(0.6, abs=0.005)
    assert spread == pytest.approx(0.15, rel=0.03)
    assert total == pytest.approx(np.log(0.15 * np.sqrt(2 * np.pi)), abs=0.03)
    mode = depths[np.argmax(log_prior(depths) + np.log(np.maximum(depths, 1e-3)))]
    assert mode == pytest.approx(PRIOR_MEDIAN, rel=0.15)


def cells(table, aod, seed=0, kinds=(0, 1, 3), shape=(6, 7)):
    """Dark spectra of cells under a depth (row, column), as `estimate` takes them, over ground as covers have it."""
    rng = np.random.default_rng(seed)
    spectra = cover_spectra(table.bands)
    kind = rng.choice(kinds, shape)
    bright = 1 + 0.2 * rng.standard_normal(shape)
    own = spectra.own[kind] * rng.standard_normal((*shape, len(table.bands))) * 0.5
    surface = np.clip(np.moveaxis(spectra.mean[kind] * bright[..., None] + own, -1, 0), 0.001, 1.0)
    number = surface[0].size
    around = np.full_like(surface, 0.12)
    sun = np.full(number, SUN)
    gas, at = air_of(table, sun, np.zeros(number), np.zeros(number))
    depth = np.broadcast_to(aod, shape).ravel()
    terms = at(depth)
    lit = reflectance_above(terms, around.reshape(len(surface), -1).T).T.reshape(surface.shape)
    seen = reflectance_above(terms, surface.reshape(len(surface), -1).T, around.reshape(len(surface), -1).T)
    observed = seen.T.reshape(surface.shape) + 0.0005 * rng.standard_normal(surface.shape)
    angles = np.stack([np.full(shape, SUN), np.zeros(shape), np.zeros(shape)])
    return observed, lit, angles, gas


@pytest.mark.parametrize("aod", [0.05, 0.15, 0.4, 1.0])
def test_the_depth_of_an_image_is_found_within_its_error(table, aod):
    found = estimate([table], *cells(table, aod))
    assert abs(found.mean - aod) < 2 * found.mean_sigma
    # An error that means something: far less than that of the prior, a factor of 2.5.
    assert found.mean_sigma < 0.25 * aod + 0.04
    # A map too is right where cells spoke, to two of its errors on the average of them.
    assert np.sqrt((((found.aod - aod) / found.sigma) ** 2).mean()) < 2
    assert found.aerosol == "continental"
    assert not found.uncertain.all()


def test_the_map_follows_a_front(table):
    aod = np.where(np.arange(12) < 6, 0.3, 0.6) * np.ones((10, 1))
    found = estimate([table], *cells(table, aod, shape=(10, 12)))
    left, right = found.aod[:, :6], found.aod[:, 6:]
    # Cells are held back by the haze of the image: half of the step at least is seen, and it lies where it was.
    assert right.mean() - left.mean() > 0.15
    assert np.all(found.aod[:, 6] - found.aod[:, 5] > 0.8 * (right.mean() - left.mean()))
    assert np.abs(left - 0.3).mean() < 0.05
    even = estimate([table], *cells(table, aod, shape=(10, 12)), vary=False)
    assert np.ptp(even.aod) == 0.0
    assert np.all(even.sigma == even.mean_sigma)


def test_the_model_that_made_the_image_is_preferred():
    angles = Angles.spanned(SUN, 0.0, 0.0)
    tables = [made_up_table(Atmosphere(aerosol=name), BANDS, angles) for name in ("continental", "maritime")]
    found = estimate(tables, *cells(tables[1], 0.8, shape=(12, 12)))
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    usual = estimate(tables, *cells(tables[0], 0.8, shape=(12, 12)))
    assert found.probabilities["maritime"] > usual.probabilities["maritime"]


def test_a_named_aerosol_leaves_its_optics_open(table):
    """7 % of the depth; others that stand beside a single model have its optics but for the phase function."""
    seen = cells(table, 0.8, shape=(12, 12))
    named, beside, judged = (
        estimate(tables, *seen, vary=False, others=others)
        for tables, others in (([table], []), ([table], [table]), ([table, table], [table]))
    )
    assert named.sigma.min() > 0.07 * named.mean
    assert beside.sigma == pytest.approx(named.sigma)
    assert named.sigma**2 - judged.sigma**2 == pytest.approx((0.07**2 - 0.02**2) * named.mean**2)


def test_bright_sand_everywhere_is_flagged(table):
    shape = (4, 5)
    bright = np.array([0.18, 0.31, 0.41, 0.48, 0.57, 0.54])[:, None, None] * np.ones(shape)
    _, _, angles, gas = cells(table, 0.1, shape=shape)
    _, at = air_of(table, SUN)
    observed = np.broadcast_to(
        reflectance_above(at(np.array([0.1])), bright[:, 0, 0][None])[0][:, None, None], bright.shape
    )
    found = estimate([table], observed, observed, angles, gas)
    assert found.uncertain.all()
    assert "nothing dark was recognised" in found.notes[0]


def test_no_clear_cell_leaves_the_prior(table):
    observed, around, angles, gas = cells(table, 0.3)
    found = estimate([table], np.full_like(observed, np.nan), around, angles, gas)
    assert found.uncertain.all()
    assert "the haze is the prior's" in found.notes[0]
    assert np.all(found.sigma > 0.1)


def test_cells_without_data_take_what_the_others_say(table):
    observed, around, angles, gas = cells(table, 0.4)
    observed[:, :2] = np.nan
    found = estimate([table], observed, around, angles, gas)
    assert found.uncertain[:2].all()
    assert not found.uncertain[2:].all()
    assert np.all(np.isfinite(found.aod))
    assert found.sigma[0].mean() >= found.sigma[3].mean()


# --- coefficients


def known_haze(lattice, aod, sigma=0.0):
    """The haze as if it had been found so, under one model."""
    shape, name = lattice.large_shape, "continental"
    return HazeEstimate(
        aod=np.full(shape, aod), sigma=np.full(shape, sigma), mean=aod, mean_sigma=sigma, aerosol=name,
        probabilities={name: 1.0}, depths={name: aod}, uncertain=np.zeros(shape, bool),
    )  # fmt: skip


def corrected(table, toa, aod, surroundings, lattice, **columns):
    shape = lattice.large_shape
    angles = np.stack([np.full(shape, a) for a in (SUN, 0.0, 0.0)])
    gas, _ = air_of(table, *(a.ravel() for a in angles), **columns)
    values = toa.astype(np.float32)
    corrector = Corrector(lattice, angles, gas, values, surroundings)
    c = corrector.coefficients(table, None, known_haze(lattice, aod))
    out, clipped = np.empty_like(values), np.zeros(values.shape[1:], bool)
    correct(values, 0, 0, lattice.small, c.gain, c.offset, c.bend, out, clipped)
    assert not clipped.any()
    return out, c


COLUMNS = {"ozone_du": 400.0, "water_vapour": 3.0}


@pytest.mark.parametrize("aod", [0.1, 0.5, 1.3])
@pytest.mark.parametrize("adjacent", [False, True])
def test_the_forward_model_is_inverted(table, aod, adjacent):
    """Textured ground to 1e-4: every pixel its own surroundings, or under surroundings that are known."""
    surface = ground(BANDS, 40, 30)
    lattice = Lattice.of(40, 30)
    around = np.clip(surface[:, ::-1] * 0.5 + 0.05, 0, 1) if adjacent else None
    toa = seen_from_above(table, surface, aod, SUN, around, **COLUMNS)
    found, c = corrected(table, toa, aod, (lambda own: around) if adjacent else None, lattice, **COLUMNS)
    np.testing.assert_allclose(found, surface, rtol=0, atol=1e-4)
    assert c.bend.size == (0 if adjacent else surface.size)
    np.testing.assert_array_equal(c.haze, 0.0)  # the haze is known
    assert np.all(c.floor > 0)


def test_uniform_ground_is_its_own_surroundings(table):
    """With cells by which the surroundings are told, and without, uniform ground comes out alike."""
    surface = np.array([0.04, 0.08, 0.06, 0.3, 0.2, 0.1])[:, None, None] * np.ones((20, 33))
    lattice = Lattice.of(20, 33)
    toa = seen_from_above(table, surface, 0.5, SUN, **COLUMNS)
    for surroundings in (None, lambda own: own):
        found, _ = corrected(table, toa, 0.5, surroundings, lattice, **COLUMNS)
        np.testing.assert_allclose(found, surface, rtol=0, atol=1e-4)


def test_where_surroundings_are_unknown_the_median_stands_in(table):
    surface = np.full((len(BANDS), 20, 20), 0.1)
    toa = seen_from_above(table, surface, 0.3, SUN)
    toa[:, :5] = np.nan
    lattice = Lattice.of(20, 20)
    found, _ = corrected(table, toa, 0.3, lambda own: own, lattice)
    assert np.isnan(found[:, :5]).all()
    np.testing.assert_allclose(found[:, 5:], 0.1, rtol=0, atol=1e-4)


def test_gases_lie_where_the_model_has_them(table):
    _, at = air_of(table, SUN, **COLUMNS)
    terms = np.moveaxis(at(np.array([0.4])), 1, 0)  # (band, place, term)
    above, rho = np.full((len(BANDS), 1), 0.93), np.full((len(BANDS), 1), 0.2)
    toa = above * reflectance_above(terms, rho, 0.4 * rho)
    gain, offset = gain_and_offset(terms, above, 0.4 * rho)
    np.testing.assert_allclose(gain * toa + offset, rho, rtol=1e-12)


def test_the_errors_of_the_haze_are_those_of_a_finite_step(table):
    """Coefficients for a depth with an error: the deviation is what another depth would change, to first order."""
    surface = ground(BANDS, 32, 32)
    lattice = Lattice.of(32, 32)
    toa = seen_from_above(table, surface, 0.4, SUN).astype(np.float32)
    shape = lattice.large_shape
    angles = np.stack([np.full(shape, a) for a in (SUN, 0.0, 0.0)])
    gas, _ = air_of(table, *(a.ravel() for a in angles))
    assert isinstance(gas, Gases)
    corrector = Corrector(lattice, angles, gas, toa, lambda own: np.full_like(own, np.nanmean(own)))

    def solution(aod, sigma=0.0):
        c = corrector.coefficients(table, None, known_haze(lattice, aod, sigma))
        return c, c.gain * toa + c.offset

    c, _ = solution(0.4, 0.05)
    expected = (solution(0.42)[1] - solution(0.38)[1]) / 0.04 * 0.05
    found = c.haze[0] * toa + c.haze[1]
    # A one-sided step of 0.01 against a central one of 0.02, and float32.
    np.testing.assert_allclose(found, expected, rtol=0.05, atol=1e-4)
    assert np.abs(found).max() > 0.005
