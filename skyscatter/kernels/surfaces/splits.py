"""Splitting of walks that come near to lamps through media in which light diffuses.

Of walks through dense fog few come to a lamp, and those bring nearly all of the light: the sum of some hundred is far
from normal, and error bars are too small where it is too low.  So a walk carries the less weight the more it is worth:
it is split where it comes closer to a lamp than it began, and its parts, which find their ways by themselves, end by
roulette where they have gone away again.  This is a weight window (Booth & Hendricks 1984, Nuclear Technology/Fusion
5, 90) whose guess of the worth is the fluence of the lamps in vacuum, dimmed as diffuse light is.  The sums keep
their means, whatever the guess.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, SURROUNDINGS
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.surfaces.flights import BEGUN, IN, KNOWN, LENGTH, ORDER, SPLITS, VERTEX
from skyscatter.kernels.surfaces.shadows import copy_stack
from skyscatter.kernels.surfaces.walkpolar import keep_part, take_part

#: Least weight that is wanted, parts of a walk at most, and how far above the wanted weight it is split.
LEAST_WEIGHT, MOST_PARTS, SPLIT_ABOVE = 1.0 / 1024.0, 16, 2.0
#: Transport mean free paths from the rim of a lamp within which walks are all worth the same.  Of 0.02, 0.1 and 0.3 it
#: had the least noise at equal time over rooms with fog of optical depths from 1 to 20 taken together.
CLOSE = 0.1


@kernel
def worth_at(table, m, x):
    """Fluence that may be expected at x but for what is close to lamps; 0 where light does not diffuse."""
    guide, kind = table.guide, table.lamps.kind
    if not guide.drift[m] > 0.0:
        return 0.0
    worth = guide.everywhere
    for k in range(kind.size):
        if kind[k] != PARALLEL_LAMP and kind[k] != SURROUNDINGS:
            p, close = guide.middle[k], guide.size[k] + CLOSE / guide.drift[m]
            square = (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2
            dimmed = fast_exp(-guide.fade[m] * math.sqrt(square))
            worth += guide.power[k] * guide.typical[k] * dimmed / max(square, close * close)
    return worth


@inlined
def wanted_weight(table, m, x, s):
    """Weight that the walk should have at x in medium m, 1 at most: by what it is worth there and where it began.

    It begins with the first leg through a medium in which light diffuses; ``s.start`` is that of its leg.
    """
    worth = worth_at(table, m, x)
    if not worth > 0.0:
        return 1.0
    if not s.far[BEGUN] > 0.0:
        s.far[BEGUN] = worth_at(table, m, s.start)
    return min(max(s.far[BEGUN] / worth, LEAST_WEIGHT), 1.0)


@kernel
def split(wanted, s):
    """Split the walk, which is at the vertex of its leg, into parts of the wanted weight; whether it was."""
    value, n = s.walk.value, s.at[SPLITS]
    largest = 0.0
    for i in range(value.size):
        largest = max(largest, value[i])
    # The number must not depend on the hero, nor does the value.  A walk that is worth no more than where it began
    # keeps what roulette or the index of refraction has given it.
    if not wanted < 1.0 or not largest > SPLIT_ABOVE * wanted or n >= s.parts.shape[0]:
        return False
    parts = min(int(largest / wanted), MOST_PARTS)
    for i in range(value.size):
        value[i] /= parts
        s.parted_spectra[n, 0, i], s.parted_spectra[n, 1, i] = value[i], s.walk.chance[i]
        s.parted_spectra[n, 2, i], s.parted_spectra[n, 3, i] = s.event[i], s.lost[i]
    for j in range(3):
        s.parted[n, j], s.parted[n, 3 + j] = s.start[j], s.walk.direction[j]
    s.parted[n, 6], s.parted[n, 7] = s.far[LENGTH], s.far[VERTEX]
    s.parts[n, 0], s.parts[n, 1], s.parts[n, 2] = parts - 1, s.at[ORDER], s.at[IN]
    copy_stack(s.stack, s.parted_stack[n])
    keep_part(s.polar, n)
    s.at[SPLITS] = n + 1
    return True


@kernel
def next_part(s):
    """Take up the next part of the walk that was split last, at its vertex."""
    n = s.at[SPLITS] - 1
    for i in range(s.lost.size):
        s.walk.value[i], s.walk.chance[i] = s.parted_spectra[n, 0, i], s.parted_spectra[n, 1, i]
        s.event[i], s.lost[i] = s.parted_spectra[n, 2, i], s.parted_spectra[n, 3, i]
    for j in range(3):
        s.start[j], s.walk.direction[j] = s.parted[n, j], s.parted[n, 3 + j]
    s.far[LENGTH], s.far[VERTEX] = s.parted[n, 6], s.parted[n, 7]
    # Light diffuses in bodies alone, where no light of a sky is known.
    s.at[ORDER], s.at[IN], s.at[KNOWN] = s.parts[n, 1], s.parts[n, 2], 0
    copy_stack(s.parted_stack[n], s.stack)
    take_part(s.polar, n)
    s.parts[n, 0] -= 1
    if s.parts[n, 0] == 0:
        s.at[SPLITS] = n
