"""Streams and evenly spread points of the random walks."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, qmc

from skyscatter.kernels import random


def test_points_are_those_of_the_sobol_sequence():
    n = 64
    ours = {tuple(random.sobol(k, d) / 2**32 for d in range(random.EVEN_DIMENSIONS)) for k in range(n)}
    # scipy walks through the same points in Gray-code order
    theirs = {tuple(x) for x in qmc.Sobol(random.EVEN_DIMENSIONS, scramble=False).random(n)}
    assert ours == theirs


def test_scrambled_points_keep_one_point_in_every_elementary_interval():
    rng = np.random.default_rng(1)
    for seed in rng.integers(0, 2**32, 20, dtype=np.uint32):
        shift = np.full(random.EVEN_DIMENSIONS, seed, np.uint32)
        points = np.array([random_point(shift, k) for k in range(16)])
        for d in range(random.EVEN_DIMENSIONS):
            assert sorted((points[:, d] * 16).astype(int)) == list(range(16))


def random_point(shift, n):
    out = np.zeros(random.EVEN_DIMENSIONS)
    random.even_point(shift, n, out)
    return out


def test_streams_are_uniform_and_do_not_repeat():
    state = np.zeros(1, np.uint64)
    draws = []
    for ray in range(50):
        for walk in range(20):
            random.start_stream(state, np.int64(7), np.int64(ray), np.int64(walk))
            draws += [random.uniform(state) for _ in range(10)]
    draws = np.array(draws)
    assert len(set(draws)) == draws.size
    counts = np.histogram(draws, bins=50, range=(0, 1))[0]
    expected = draws.size / 50
    # chi-square with 49 degrees of freedom; a fixed seed, so a level of 1e-4 says only that nothing is badly wrong
    assert chi2.sf(np.sum((counts - expected) ** 2 / expected), 49) > 1e-4


def test_a_stream_depends_on_seed_ray_and_walk():
    state = np.zeros(1, np.uint64)

    def first(*key):
        random.start_stream(state, *(np.int64(k) for k in key))
        return random.uniform(state)

    assert first(1, 2, 3) == first(1, 2, 3)
    assert len({first(1, 2, 3), first(2, 2, 3), first(1, 3, 3), first(1, 2, 4), first(2, 1, 3)}) == 5
