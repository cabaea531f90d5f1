"""New directions at vertices in a medium: by its phase function, or past a lamp that is near.

Of a lamp that a leg passes at the height h it gathers light as 1 / h.  Drawn by the phase function alone, directions
near to that of a small lamp are rare, and so bright that the light has no variance.  So a tenth is spread evenly over
the angle from the lamp, with the density 1 / (2 pi^2 sin(angle)) per solid angle, which bounds the light: fewer beyond
a free path from the lamp, and none where it is as large as it is far.  More of them would help beside a lamp, but what
scatters forward would lose by it: the weights of walks would spread with every turn.

Around parallel light the sky is bright in the same way where the air scatters forward: there a share of the directions
is spread around it that goes with the mean cosine (`solvers.surface_path.SUNWARD`).
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, SURROUNDINGS
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.random import uniform
from skyscatter.kernels.surfaces.lamps import face, guess_in_medium, pick
from skyscatter.kernels.surfaces.media import depth_of, draw_scattered

#: Largest share of the directions that pass lamps.
PASSING = 0.1
#: Sine of the least angle from a lamp.
LEAST_SINE = 1e-7


@kernel
def shares_past(table, m, x, s):
    """Shares of the directions from a vertex that pass each lamp, into ``s.chance`` (lamp,); returns their sum.

    ``s.media.density`` holds the densities at the vertex.
    """
    lamps, guide, total = table.lamps, table.guide, 0.0
    sigma = depth_of(table.media, m, s.media.density, s.light.size // 2)
    guess_in_medium(lamps, guide, x, s.chance)
    for k in range(s.chance.size):
        share = 0.0
        if lamps.kind[k] == PARALLEL_LAMP:
            share = guide.size[k] * s.chance[k]
        elif lamps.kind[k] != SURROUNDINGS:
            p, size = guide.middle[k], guide.size[k]
            square = (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2
            if square > size * size:
                share = PASSING * s.chance[k] * (1.0 - size * size / square) / (1.0 + sigma * sigma * square)
        s.chance[k] = share
        total += share
    return total


@inlined
def face_lamp(table, k, x, d):
    """Unit vector from x towards lamp k, into `d` (3,)."""
    if table.lamps.kind[k] == PARALLEL_LAMP:
        for n in range(3):
            d[n] = table.guide.middle[k, n]
    else:
        face(x, table.guide.middle[k], d)


@inlined
def density_past(table, x, d, share, to):
    """Density of directions that pass lamps times their shares [sr-1]; `to` (3,) is scratch."""
    density = 0.0
    for k in range(share.size):
        if share[k] > 0.0:
            face_lamp(table, k, x, to)
            a, b, c = to[1] * d[2] - to[2] * d[1], to[2] * d[0] - to[0] * d[2], to[0] * d[1] - to[1] * d[0]
            density += share[k] / max(math.sqrt(a * a + b * b + c * c), LEAST_SINE)
    return density / (2.0 * math.pi * math.pi)


@kernel
def draw_direction(table, m, hero, x, u, v, s, d):
    """Turn d at a vertex, and leave the shares of the directions that pass each lamp in ``s.chance``.

    Returns
    -------
    turned : bool
        False where nothing is scattered.
    past : float
        Sum of the shares.
    """
    past = shares_past(table, m, x, s)
    if past > 0.0:
        choice = uniform(s.walk.state)
        if choice < past:
            face_lamp(table, pick(s.chance, choice), x, d)
            turn(d, math.cos(math.pi * u), 2.0 * math.pi * v)
            return True, past
    return draw_scattered(table.media, m, hero, u, v, s.media, d), past
