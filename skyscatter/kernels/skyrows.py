"""Light along many rays of one sky, joined between the nodes of a table; see `skyscatter.solvers.skytable`."""

from __future__ import annotations

from skyscatter.kernels.jit import entry, inlined


@inlined
def _add_nodes(table, row, across, column, along, out):
    """Add a table (node, turn, wavelength) at a place between four nodes each way, with their weights, to `out`."""
    for a in range(4):
        for b in range(4):
            weight, node = across[a] * along[b], table[row[a], column[b]]
            for i in range(out.size):
                out[i] += weight * node[i]


@entry
def join_rays(row, across, column, along, cell, share, smooth, lit, phase, lost, work, out):
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
    lit : (component, node, turn, wavelength)
    phase : (component, angle, wavelength)
    lost : (component, node, angle, wavelength)
        What is taken off the phase function, for the first angles only.
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
            for i in range(light.size):
                light[i] += near[i] * chance[i]
