"""Media between surfaces: stacks, flights, transmittances, scattering."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats
from surface_tables import Filling, Stuff, henyey_greenstein, media_table

from skyscatter.kernels.codes.surfaces import STACK
from skyscatter.kernels.jit import entry
from skyscatter.kernels.path import make_walk
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.surfaces.media import (
    current_medium,
    fly,
    make_media_work,
    pull,
    push,
    scatter_walk,
    scattering,
    transmit,
)
from skyscatter.kernels.surfaces.tables import MediaTable
from skyscatter.media.shapes import GaussianSphere, Sphere

HAZE = Stuff((0.3, 0.1), (0.0, 0.05), g=0.6)
SMOKE = Stuff((0.0, 0.0), (0.2, 0.4))
GLOW = Stuff((0.0, 0.0), (0.0, 0.0), emission=1.0)
BALL = Stuff((0.5, 0.2), (0.1, 0.1), Sphere(radius=2.0))
PUFF = Stuff((1.0, 0.5), (0.0, 0.3), GaussianSphere(width=1.0))
START, AHEAD = np.array([-4.0, 0.3, 0.2]), np.array([1.0, 0.0, 0.0])
#: Media of one table, so that each must leave the others' components alone.
VACUUM, THIN, DARK, SHINING, CLOUD, MIXED = range(6)


@entry
def transmit_once(media, m, x, d, far, work, out):  # type: ignore[no-untyped-def]
    transmit(media, m, x, d, far, work, out)


@entry
def scattering_once(media, m, density, cosine, work, out):  # type: ignore[no-untyped-def]
    scattering(media, m, density, cosine, work, out)


@entry
def stack_work(media, stack, m, enter):  # type: ignore[no-untyped-def]
    """Enter or leave a medium; what the ray is in then, -1 if that failed."""
    done = push(stack, m) if enter else pull(stack, m)
    return current_medium(media, stack) if done else -1


@entry
def many_flights(media, m, x, d, far, walk, work, distance, value, chance):  # type: ignore[no-untyped-def]
    """Flights under all heroes in turn, and a scattering where there is something to scatter."""
    for n in range(distance.size):
        start_stream(walk.state, 5, m, n)
        for i in range(walk.value.size):
            walk.value[i], walk.chance[i] = 1.0, 1.0
        t, hit = fly(media, m, n % walk.value.size, x, d, far, uniform(walk.state), walk, work)
        distance[n] = t if hit else np.inf
        for i in range(walk.value.size):
            value[n, i], chance[n, i] = walk.value[i], walk.chance[i]


@entry
def many_turns(media, m, x, walk, work, cosine, value, chance):  # type: ignore[no-untyped-def]
    """Scatterings of a walk at x whose densities are those there, whoever the hero."""
    for n in range(cosine.size):
        start_stream(walk.state, 6, m, n)
        walk.direction[0], walk.direction[1], walk.direction[2] = 0.0, 0.6, 0.8
        for i in range(walk.value.size):
            walk.value[i], walk.chance[i] = 1.0, 1.0
        scatter_walk(media, m, n % walk.value.size, uniform(walk.state), uniform(walk.state), work, walk)
        cosine[n] = 0.6 * walk.direction[1] + 0.8 * walk.direction[2]
        for i in range(walk.value.size):
            value[n, i], chance[n, i] = walk.value[i], walk.chance[i]


@pytest.fixture(scope="module")
def media() -> MediaTable:
    fillings = [
        Filling(), Filling((HAZE,), 1), Filling((SMOKE,), 1), Filling((GLOW,), 3), Filling((BALL, PUFF), 2),
        Filling((PUFF, SMOKE), 2),
    ]  # fmt: skip
    return media_table(fillings, 2)


def depth(m: int, t: float) -> np.ndarray:
    """Optical depth from the start to t by quadrature over the definitions."""
    stuff = {VACUUM: [], THIN: [HAZE], DARK: [SMOKE], SHINING: [GLOW], CLOUD: [BALL, PUFF], MIXED: [PUFF, SMOKE]}[m]
    total = np.zeros(2)
    for s in stuff:
        sigma = np.array(s.scattering) + s.absorption
        if s.where is None:
            total += sigma * t
        elif t > 0:
            end = min(t, 20.0)
            points = [START[0] + 4.0, 4 - math.sqrt(4 - 0.13), 4 + math.sqrt(4 - 0.13)]
            column, _ = integrate.quad(
                lambda q, s=s: float(s.where.density(START + q * AHEAD)), 0, end, points=points, epsabs=1e-12, limit=200
            )
            total += sigma * column
    return total


def test_the_medium_of_highest_priority_is_met(media: MediaTable) -> None:
    stack = np.full(STACK, -1, np.int64)
    steps = [(THIN, True, THIN), (DARK, True, DARK), (SHINING, True, SHINING), (CLOUD, True, SHINING)]
    steps += [(SHINING, False, CLOUD), (THIN, False, CLOUD), (CLOUD, False, DARK), (DARK, False, VACUUM)]
    for m, enter, expected in steps:
        assert stack_work(media, stack, m, enter) == expected
    assert np.all(stack == -1)


def test_a_stack_neither_overflows_nor_leaves_what_was_not_entered(media: MediaTable) -> None:
    stack = np.full(STACK, -1, np.int64)
    for _ in range(STACK):
        assert stack_work(media, stack, THIN, True) == THIN
    assert stack_work(media, stack, DARK, True) == -1
    assert stack_work(media, stack, DARK, False) == -1
    assert np.all(stack == THIN)


@pytest.mark.parametrize("m", [VACUUM, THIN, DARK, SHINING, CLOUD, MIXED])
@pytest.mark.parametrize("far", [0.0, 2.5, 7.0])
def test_transmittance_against_quadrature(media: MediaTable, m: int, far: float) -> None:
    out = np.empty(2)
    transmit_once(media, m, START, AHEAD, far, make_media_work(7, 2), out)
    # Columns are good to 1e-6 of the depth, the exponential to 3e-10.
    np.testing.assert_allclose(out, np.exp(-depth(m, far)), rtol=3e-6 * max(depth(m, far).max(), 1e-3))


def test_transmittance_to_infinity(media: MediaTable) -> None:
    work, out = make_media_work(7, 2), np.empty(2)
    for m in range(6):
        transmit_once(media, m, START, AHEAD, math.inf, work, out)
        absorbing = m in (THIN, DARK, MIXED)
        expected = np.zeros(2) if absorbing else np.exp(-depth(m, 1e9))
        np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-300)


@pytest.mark.parametrize("m", [THIN, DARK, CLOUD, MIXED])
@pytest.mark.parametrize("far", [3.0, math.inf])
@pytest.mark.slow
def test_flights_follow_the_extinction_of_their_hero(media: MediaTable, m: int, far: float) -> None:
    n, walk, work = 4000, make_walk(2), make_media_work(7, 2)
    distance, value, chance = np.empty(n), np.empty((n, 2)), np.empty((n, 2))
    many_flights(media, np.int64(m), START, AHEAD, far, walk, work, distance, value, chance)
    np.testing.assert_allclose(chance.mean(axis=1), 1, rtol=1e-12)
    for hero in range(2):
        flown = np.sort(distance[hero::2])
        ends = np.isfinite(flown)
        # Optical depths of events are those of an exponential distribution, cut off where the way ends.
        depths = np.array([depth(m, t)[hero] for t in flown[ends][::20]])
        most = depth(m, min(far, 1e6))[hero]
        assert np.all(depths <= most * (1 + 1e-6))
        assert stats.kstest(depths, lambda q, most=most: np.expm1(-q) / np.expm1(-most)).pvalue > 1e-3
        assert stats.binomtest(int(ends.sum()), flown.size, min(-math.expm1(-most), 1.0)).pvalue > 1e-3
    # What arrives without an event is the transmittance at every wavelength, whoever drew the flight.
    if far < math.inf:
        through = np.where(np.isinf(distance)[:, None], value, 0.0)
        error = through.std(axis=0, ddof=1) / math.sqrt(n)
        assert np.all(np.abs(through.mean(axis=0) - np.exp(-depth(m, far))) < 4.0 * error)


def test_nothing_stops_a_flight_through_what_only_shines(media: MediaTable) -> None:
    walk, work = make_walk(2), make_media_work(7, 2)
    distance, value, chance = np.empty(16), np.empty((16, 2)), np.empty((16, 2))
    for m in (VACUUM, SHINING):
        for far in (5.0, math.inf):
            many_flights(media, np.int64(m), START, AHEAD, far, walk, work, distance, value, chance)
            assert np.all(np.isinf(distance))
            np.testing.assert_array_equal(value, 1.0)


def test_scattering_adds_the_components_of_its_medium_alone(media: MediaTable) -> None:
    work, out = make_media_work(7, 2), np.empty(2)
    density = np.array([9.0, 9.0, 9.0, 0.5, 2.0, 9.0, 9.0])
    scattering_once(media, CLOUD, density, 0.3, work, out)
    expected = (0.5 * np.array(BALL.scattering) + 2.0 * np.array(PUFF.scattering)) / (4 * np.pi)
    np.testing.assert_allclose(out, expected, rtol=1e-5)
    np.testing.assert_allclose(work.total, expected * 4 * np.pi, rtol=1e-5)
    scattering_once(media, THIN, density, 0.3, work, out)
    # The phase function is tabulated: straight lines between cells of 0.2 degrees.
    np.testing.assert_allclose(out, 9.0 * np.array(HAZE.scattering) * henyey_greenstein(0.6, np.array(0.3)), rtol=1e-4)


def test_scattered_directions_follow_the_phase_function(media: MediaTable) -> None:
    n, walk, work = 20000, make_walk(2), make_media_work(7, 2)
    cosine, value, chance = np.empty(n), np.empty((n, 2)), np.empty((n, 2))
    work.density[:] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    many_turns(media, np.int64(THIN), START, walk, work, cosine, value, chance)
    error = cosine.std(ddof=1) / math.sqrt(n)
    assert abs(cosine.mean() - 0.6) < 4 * error + 1e-4
    # One phase function at both wavelengths: weights are the scattering coefficients and all chances alike.
    np.testing.assert_allclose(value, np.broadcast_to(HAZE.scattering, (n, 2)), rtol=1e-9)
    np.testing.assert_allclose(chance, 1.0, rtol=1e-9)


def test_what_only_absorbs_ends_a_walk(media: MediaTable) -> None:
    walk, work = make_walk(2), make_media_work(7, 2)
    cosine, value, chance = np.empty(4), np.empty((4, 2)), np.empty((4, 2))
    work.density[:] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    walk.chance[:] = 1.0
    many_turns(media, np.int64(DARK), START, walk, work, cosine, value, chance)
    np.testing.assert_allclose(cosine, 1.0)  # not turned
