"""Light along many rays of one sky, joined between the nodes of a table; see `skyscatter.solvers.skytable`."""

from __future__ import annotations

import math

from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import entry, inlined
from skyscatter.kernels.tabulated import angle_cell, cell_of


@inlined
def _cubic(nodes, first, last, x, number, weight):
    """Four of the nodes from `first` to before `last` around a place, and their weights in the cubic through them."""
    n = min(max(cell_of(nodes, first, last - 1, x) - 1, first), last - 4)
    for k in range(4):
        above, below = 1.0, 1.0
        for j in range(4):
            if j != k:
                above *= x - nodes[n + j]
                below *= nodes[n + k] - nodes[n + j]
        number[k], weight[k] = n + k, above / below


#: Share of the elevation in `below_place`: of low observers, whose way to the ground is short, nodes need some of it;
#: and the second, of those above the air, for whom the way hardly changes over most of the planet.
UPRIGHT, UPRIGHT_ABOVE = 0.2, 2.0


@inlined
def below_place(elevation, slant):
    """What light from below the horizon is smooth in: the logarithm of the way to the ground, and some of the angle.

    Over the elevation it is not: the way grows like the root of the angle to the horizon there, and by many times
    within a degree or two where the observer stands low.  The angle is that in the air: from afar a planet is small,
    and yet its middle is seen from above and its rim from the side.

    Parameters
    ----------
    elevation : float
        Below the horizon [rad].
    slant : (4,)
        Distance from the planet's centre r [m], r^2 less the ground's square, r^2 less that of the top of the air or 0
        where the observer is within [m2], and the way through air that counts as short [m].
    """
    down, way = -slant[0] * math.sin(elevation), 0.0
    if down > 0.0:
        way = slant[1] / (down + math.sqrt(max(down * down - slant[1], 0.0)))
        way -= slant[2] / (down + math.sqrt(max(down * down - slant[2], 0.0)))
    upright = UPRIGHT * elevation
    if slant[2] > 0.0:
        beside = slant[0] * math.cos(elevation) / math.sqrt(slant[0] * slant[0] - slant[2])
        upright = -UPRIGHT_ABOVE * math.acos(min(beside, 1.0))
    return math.log(1.0 + way / slant[3]) + upright


@entry
def place_rays(directions, axes, places, low, top, below, horizon, slant, turns, last,
               row, across, column, along, odd, cell, share, high):  # fmt: skip
    """Where rays lie between the nodes of a table over the sky; nothing is joined across the horizon.

    Parameters
    ----------
    directions : (ray, 3)
    axes : (4, 3)
        The vertical, the horizontal direction towards the Sun, that to its left, and the direction of the Sun.
    places : (node,)
        Of the elevations, rising: `below_place` of the first `below` nodes, which look below the horizon, and for the
        others the elevation itself [rad].
    low, top : float
        Elevations of the first node and of the last [rad].
    below : int
    horizon : float
    slant : (4,)
        As for `below_place`.
    turns : (turn + 2,)
        Nodes of the azimuth from the Sun, 0 to pi, and one more beyond either end.
    last : int
        Number of the last angle of the phase functions.
    row, column : (ray, 4) int64, output
        Nodes of the elevation and of the azimuth beside each ray.
    across, along : (ray, 4), output
        Their weights.
    odd : (ray, 4), output
        Those of the azimuth for what changes its sign from one side of the Sun to the other, known on its left.
    cell : (ray, 2) int64, output
        Nodes of the angle from the Sun.
    share : (ray, 2), output
        Their weights.
    high : (ray,), output
        Elevation [rad].
    """
    nodes, most = places.size, turns.size - 3
    for ray in range(directions.shape[0]):
        d = directions[ray]
        x = d[0] * axes[0, 0] + d[1] * axes[0, 1] + d[2] * axes[0, 2]
        y = d[0] * axes[1, 0] + d[1] * axes[1, 1] + d[2] * axes[1, 2]
        z = d[0] * axes[2, 0] + d[1] * axes[2, 1] + d[2] * axes[2, 2]
        high[ray] = math.atan2(x, math.hypot(y, z))
        height = min(max(high[ray], low), top)
        if below == nodes or (below > 0 and height < horizon):
            _cubic(places, 0, below, below_place(height, slant), row[ray], across[ray])
        else:
            _cubic(places, below, nodes, height, row[ray], across[ray])
        _cubic(turns, 0, turns.size, math.atan2(abs(z), y), column[ray], along[ray])
        for k in range(4):  # the light is the same on both sides of the Sun
            turn = abs(column[ray, k] - 1)
            beyond = column[ray, k] < 1 or turn > most
            odd[ray, k] = -along[ray, k] if beyond != (z < 0.0) else along[ray, k]
            column[ray, k] = turn if turn <= most else 2 * most - turn
        k, w = angle_cell(d[0] * axes[3, 0] + d[1] * axes[3, 1] + d[2] * axes[3, 2], last)
        cell[ray, 0], cell[ray, 1], share[ray, 0], share[ray, 1] = k, k + 1, 1.0 - w, w


@inlined
def _add_nodes(table, row, across, column, along, out):
    """Add a table (node, turn, wavelength) at a place between four nodes each way, with their weights, to `out`."""
    for a in range(4):
        near = table[row[a]]
        first, second, third, fourth = near[column[0]], near[column[1]], near[column[2]], near[column[3]]
        p, q, r, s = across[a] * along[0], across[a] * along[1], across[a] * along[2], across[a] * along[3]
        for i in range(out.size):  # four nodes at once: what is summed stays in registers
            out[i] += p * first[i] + q * second[i] + r * third[i] + s * fourth[i]


@entry
def join_rays(row, across, column, along, cell, share, smooth, lit, phase, lost, logs, work, out):
    """What is smooth over the sky, and sunlight on each component times its phase function.

    Parameters
    ----------
    row, column : (ray, 4) int64
        Nodes of the elevation and of the azimuth beside each ray.
    across, along : (ray, 4)
        Their weights.
    cell : (ray, 2) int64
        Nodes of the angle from the Sun.
    share : (ray, 2)
        Their weights.
    smooth : (node, turn, wavelength)
        No nodes where there is nothing of that kind.
    lit : (component, node, turn, wavelength)
        Or its logarithm, see `logs`.
    phase : (component, angle, wavelength)
    lost : (component, node, angle, wavelength)
        What is taken off the phase function, for the first angles only.
    logs : int
        1 where `lit` is a logarithm, which is joined instead of the light: across a terminator that falls evenly.
    work : (2, wavelength)
        Scratch.
    out : (ray, wavelength), output
    """
    near, chance = work[0], work[1]
    angles = lost.shape[2]
    for ray in range(out.shape[0]):
        light, k = out[ray], cell[ray]
        for i in range(light.size):
            light[i] = 0.0
        if smooth.shape[0] > 0:
            _add_nodes(smooth, row[ray], across[ray], column[ray], along[ray], light)
        for c in range(lit.shape[0]):
            first, second = phase[c, k[0]], phase[c, k[1]]
            for i in range(light.size):
                near[i] = 0.0
                chance[i] = share[ray, 0] * first[i] + share[ray, 1] * second[i]
            if k[1] < angles:
                for a in range(4):
                    first, second = lost[c, row[ray, a], k[0]], lost[c, row[ray, a], k[1]]
                    for i in range(light.size):
                        chance[i] -= across[ray, a] * (share[ray, 0] * first[i] + share[ray, 1] * second[i])
            _add_nodes(lit[c], row[ray], across[ray], column[ray], along[ray], near)
            if logs == 1:
                for i in range(light.size):
                    near[i] = fast_exp(near[i])
            for i in range(light.size):
                light[i] += near[i] * chance[i]
