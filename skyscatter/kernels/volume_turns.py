"""New directions of walks in three dimensions: the phase function times a guess of the light that comes from there.

See docs/theory/nebulae.md, equation 47.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.optics import phase_at, sample_cosine
from skyscatter.kernels.random import keeps, uniform
from skyscatter.kernels.space import clip_to_space, space_densities
from skyscatter.kernels.tabulated import angle_cell
from skyscatter.kernels.volume import (
    INSIDE,
    SHY,
    depth_at,
    forwardness,
    guessed_forwardness,
    middle_guess,
    nearest_star,
    scattering_at,
    transport_length,
)
from skyscatter.kernels.volume_aims import DEEP, beams_ahead, beams_here, direction_law, draw_by_law, take_aim

#: What a direction counts for that leads out of the medium at once into the dark, over one that leads deep into it.
OPEN = 0.2
#: Candidates from which a direction is chosen.
CANDIDATES = 8
#: Turn from one candidate to the next: with even cosines they cover the sphere evenly (golden section).
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@inlined
def mean_phase(v, cosine, density):
    """Phase function [sr-1] of the mixture for the light of all wavelengths; `v` is a `MeanPhase`."""
    k, w = angle_cell(cosine, v.phase.shape[1] - 1)
    scattering, towards = 0.0, 0.0
    for c in range(density.size):
        s = density[c] * v.sigma_s[c, 0]
        scattering += s
        towards += s * (v.phase[c, k, 0] + w * (v.phase[c, k + 1, 0] - v.phase[c, k, 0]))
    return towards / max(scattering, 1e-300)


@inlined
def way_ahead(v, x, d, far, extinction, work):
    """How far one looks ahead in a direction [m], at most `far`, and the optical depth of the medium in it.

    As if the medium were everywhere as dense as at the vertex, where its `extinction` [m-1] is, up to where it ends.
    """
    _, end = clip_to_space(v.space, x[0], x[1], x[2], d[0], d[1], d[2])
    on, depth = min(far, INSIDE * end), extinction * end
    space_densities(v.space, x[0] + on * d[0], x[1] + on * d[1], x[2] + on * d[2], work.space, work.along)
    there = depth_at(v, work.along, v.power.shape[1] // 2) / extinction
    if there < 0.5:
        on *= 0.5 * (1.0 + there)
        depth = extinction * on
    return on, depth


@kernel
def turn_at_vertex(v, u, w, work, aim, walk):
    """New direction at a vertex; the value takes the phase functions.  False if nothing is scattered there.

    ``work.density`` holds the densities at the vertex.
    The wanted density is the phase function times the guess of the light that comes from a direction.  Candidates are
    drawn from both of these alone, and one of them is kept by its weight (importance resampling: Talbot, Cline &
    Egbert 2005, Eurographics Symposium on Rendering).  The draw is the same for every hero, so chances stay.
    """
    x, d, middle = walk.position, walk.direction, v.power.shape[1] // 2
    old_x, old_y, old_z = d[0], d[1], d[2]
    depth = take_aim(v, x, work, aim)
    extinction = max(depth_at(v, work.density, middle), 1e-300)
    by_law, far, diffuse, here = 0.5, 1.0 / extinction, 0.0, 1.0
    g, glow = guessed_forwardness(v, work.density), 4.0 * math.pi * v.background[middle]
    if v.correction.shape[0] > 0:
        # How far light counts as diffusing: near a star inside the medium it does not.
        diffuse = 1.0 if depth < 0.0 else min(depth / DEEP, 1.0)
        # Never as far as a star, where the guess knows no bounds.
        far = min(transport_length(v, work.density), SHY * nearest_star(v, x[0], x[1], x[2]))
        here = middle_guess(v, x[0], x[1], x[2], d, 0.0, work)
        # The more directions are kept in scattering, the less is left for the guess to choose, but for straight light.
        by_law *= 1.0 - diffuse * forwardness(v, work.density) * here / (here + beams_here(v, aim))
    total, kept, chosen = 0.0, 0.0, False
    first = uniform(walk.state)
    best_x, best_y, best_z = 0.0, 0.0, 0.0
    for n in range(CANDIDATES):
        z = (n + u) / CANDIDATES
        azimuth = (first + GOLDEN * n) % 1.0
        if z < by_law:
            draw_by_law(v, d, z / by_law, azimuth, aim, walk.state)
        else:
            d[0], d[1], d[2] = old_x, old_y, old_z
            if not draw_by_phase(v.mean, np.int64(0), (z - by_law) / (1.0 - by_law), azimuth, work, walk):
                return False
        phase = mean_phase(v.mean, old_x * d[0] + old_y * d[1] + old_z * d[2], work.density)
        law = direction_law(v, d, aim)
        on, depth = way_ahead(v, x, d, far, extinction, work)
        hidden = -math.expm1(-depth)
        wanted = law * (hidden + (1.0 if glow > 0.0 else OPEN) * (1.0 - hidden))
        if diffuse > 0.0:
            ahead = middle_guess(v, x[0] + on * d[0], x[1] + on * d[1], x[2] + on * d[2], d, g, work)
            ahead = ahead * hidden + beams_ahead(v, d, aim, depth) + glow * (1.0 - hidden)
            wanted += diffuse * (ahead / (4.0 * math.pi * here) - wanted)
        wanted *= phase
        weight = wanted / (by_law * law + (1.0 - by_law) * phase)
        total += weight
        keep, w = keeps(w, weight, total)
        if keep:
            chosen, kept = True, wanted
            best_x, best_y, best_z = d[0], d[1], d[2]
    if not chosen:
        return False
    d[0], d[1], d[2] = best_x, best_y, best_z
    phase_at(v.phase, old_x * d[0] + old_y * d[1] + old_z * d[2], work.phase)
    factor = total / (CANDIDATES * kept)
    for i in range(walk.value.size):
        towards = 0.0
        for c in range(work.density.size):
            towards += work.density[c] * v.sigma_s[c, i] * work.phase[c, i]
        walk.value[i] *= towards * factor
    return True


@kernel
def draw_by_phase(v, hero, u, w, work, walk):
    """Direction by the phase function of a component that the hero is scattered by; False if there is none.

    `v` is a `VolumeTable`, or with hero 0 its `MeanPhase`.
    """
    total = scattering_at(v, work.density, hero)
    if total <= 0.0:
        return False
    rest, chosen, part = u * total, 0, 1.0
    for c in range(work.density.size):
        s = work.density[c] * v.sigma_s[c, hero]
        if s > 0.0:
            chosen, part = c, s
            if rest < s:
                break
            rest -= s
    # What is left of the number after the choice is as good as a new one.
    share = min(max(rest / part, 0.0), 1.0 - 1e-16)
    turn(walk.direction, sample_cosine(v, chosen, hero, share), 2.0 * math.pi * w)
    return True
