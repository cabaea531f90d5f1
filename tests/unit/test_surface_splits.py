"""Walks in rooms are split by what they are worth, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.kernels.jit import entry
from skyscatter.kernels.surfaces.flights import SPLITS, make_scratch
from skyscatter.kernels.surfaces.splits import next_part, split


@entry
def split_once(wanted, s):
    """Whether a walk is split."""
    return split(wanted, s)


@entry
def take_part(s):
    """Take up the next part."""
    next_part(s)


@pytest.mark.parametrize("wanted", [1.0, 0.25, 1 / 1024])
def test_a_walk_is_split_where_it_is_worth_more_than_where_it_began(wanted: float) -> None:
    """Not where it carries three times one for another reason: walks in a glass of milk took twice as long."""
    s = make_scratch(1, 2, 1, 1)
    s.walk.value[:] = 3.0, 2.0
    parted = split_once(wanted, s)
    assert parted == (wanted < 1)
    parts = 1
    total = s.walk.value.copy()
    while s.at[SPLITS] > 0:
        take_part(s)
        total += s.walk.value
        parts += 1
    assert parts == {1.0: 1, 0.25: 12, 1 / 1024: 16}[wanted]  # at once sixteen at most
    assert total == pytest.approx(np.array([3.0, 2.0]))
