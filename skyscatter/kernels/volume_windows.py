"""Roulette and splitting: a walk is worth at every vertex about what it was worth at its first.

What a walk may still bring in is its value times the light that is scattered at its vertex.  The light is guessed
(`guess_light`); where the product falls below the window the walk goes on with a chance only, where it rises above it
the walk becomes several, each of which carries its share (weight windows: Booth & Hendricks 1984, Nucl. Technol. Fusion
5, 90).  Without the second half a walk that has wandered into the light of an opaque cloud, which few do, brings in
all that the others missed at once.

Parts of a walk wait on a stack until the first has ended, and all draw from the walk's one stream.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.random import uniform
from skyscatter.kernels.space import space_densities
from skyscatter.kernels.volume import (
    correct_guess,
    guess_light,
    guessed_forwardness,
    scattering_at,
)

#: The window, in parts of what a walk promised at its first vertex.
LOWEST, HIGHEST = 0.3, 3.0
#: Share of the light that a ray is known to see of which no walk need promise less.
WORTHWHILE = 0.1
#: Parts that wait; a walk that finds the stack full is not split.
WAITING = 64
#: Parts into which a walk is split at once, at most.
MOST_PARTS = 32
#: Legs of a walk and all its parts after which it is hurried to its end: a second's work for some five walks.
PATIENCE = 1 << 15
#: Least chance of a walk to go on.
LEAST_CHANCE = 0.05


@by_address
class Waiting(NamedTuple):
    """Parts of a walk that wait for their turn."""

    place: np.ndarray  #: (part, 6) position and direction
    value: np.ndarray  #: (part, wavelength)
    chance: np.ndarray  #: (part, wavelength)
    order: np.ndarray  #: (part,) int64
    copies: np.ndarray  #: (part,) int64, how many times the part is to be followed
    top: np.ndarray  #: (1,) int64, entries in use


def make_waiting(wavelengths: int) -> Waiting:
    """An empty stack."""
    return Waiting(
        np.zeros((WAITING, 6)), np.zeros((WAITING, wavelengths)), np.zeros((WAITING, wavelengths)),
        np.zeros(WAITING, np.int64), np.zeros(WAITING, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip


@kernel
def promise(v, first, work, walk, shift, spare):
    """What a walk at a vertex may still bring in, over what it did at its `first`: value, scattering, guessed light.

    Averaged over wavelengths, each of which counts by its own share: of the light behind deep dust one may have 1e-9 of
    what another has, and is looked for all the same.  ``work.density`` holds the densities at the vertex; what its
    direction is worth lies `shift` ahead of it [m] (`kernels.volume_legs.look_ahead`).
    """
    p, d = walk.position, walk.direction
    g = guessed_forwardness(v, work.density)
    x, y, z = p[0] + shift * d[0], p[1] + shift * d[1], p[2] + shift * d[2]
    guess_light(v, x, y, z, d, g, work, work.through, spare)
    correct_guess(v, x, y, z, spare)
    total = 0.0
    for i in range(spare.size):
        spare[i] *= walk.value[i] * scattering_at(v, work.density, i)
        if first:
            work.promised[i] = max(spare[i], 1e-290)
        total += spare[i] / work.promised[i]
    return total / spare.size


@inlined
def expect(number, base, total, promised):
    """Raise the `promised` light of a walk to a part of what its ray is known to see.

    That is the `base` and the mean of so many walks, the present one included.  A promise is light from all around, a
    radiance times 4 pi.  Where the guess at the first vertex is far too low, as behind a dense disk, a walk would be
    split over and over for light that is nothing beside what it has brought already.
    """
    for i in range(promised.size):
        promised[i] = max(promised[i], WORTHWHILE * 4.0 * math.pi * (base[i] + total[i] / number))


@kernel
def pass_window(now, legs, order, walk, waiting):
    """Roulette or splitting of a walk that promises `now`, after so many legs of all its parts; False if it ends."""
    # A walk that has had its share of time is split no more, and its parts end the sooner the longer they last.
    late = legs / PATIENCE
    level = LOWEST * (1.0 if late < 1.0 else late**4)
    if now < level:
        chance = max(now / level, LEAST_CHANCE)
        if uniform(walk.state) >= chance:
            return False
        for i in range(walk.value.size):
            walk.value[i] /= chance
    elif now > HIGHEST and late < 1.0 and waiting.top[0] < WAITING:
        parts = int(min(now, MOST_PARTS))
        for i in range(walk.value.size):
            walk.value[i] /= parts
        leave_waiting(order, parts - 1, walk, waiting)
    return True


@inlined
def leave_waiting(order, copies, walk, waiting):
    """Put a walk on the stack."""
    n = waiting.top[0]
    for k in range(3):
        waiting.place[n, k], waiting.place[n, 3 + k] = walk.position[k], walk.direction[k]
    for i in range(walk.value.size):
        waiting.value[n, i], waiting.chance[n, i] = walk.value[i], walk.chance[i]
    waiting.order[n], waiting.copies[n] = order, copies
    waiting.top[0] = n + 1


@inlined
def take_waiting(v, work, walk, waiting):
    """Go on with the part that came last; its order, or 0 if none waits."""
    n = waiting.top[0] - 1
    if n < 0:
        return 0
    for k in range(3):
        walk.position[k], walk.direction[k] = waiting.place[n, k], waiting.place[n, 3 + k]
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = waiting.value[n, i], waiting.chance[n, i]
    waiting.copies[n] -= 1
    if waiting.copies[n] == 0:
        waiting.top[0] = n
    x = walk.position
    space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
    return waiting.order[n]
