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
from skyscatter.kernels.space import clip_to_space
from skyscatter.kernels.tabulated import angle_cell, cell_of, draw_in_cell
from skyscatter.kernels.volume import (
    depth_at,
    face_light,
    forwardness,
    guessed_forwardness,
    guide_columns,
    middle_guess,
    nearest_star,
    transport_length,
)

#: Optical depth at which a star is deep.
DEEP = 4.0
#: Shares of the guess of directions by the light of a near star and by the slowest mode: near a star, and where it is
#: deep.  The rest is isotropic.
NEAR_SHARES, DEEP_SHARES = (0.9, 0.0), (0.2, 0.7)
#: The same shares for stars outside the medium, where no ray comes near them.
OUTSIDE_NEAR_SHARES, OUTSIDE_DEEP_SHARES = (0.3, 0.0), (0.0, 0.6)
#: Part of the distance to a star that one looks ahead at most.
SHY = 0.3
#: Part of the way to the edge of the medium's box that one looks ahead at most: what lies outside tells nothing.
INSIDE = 0.5
#: Candidates from which a direction is chosen.
CANDIDATES = 8
#: Turn from one candidate to the next: with even cosines they cover the sphere evenly (golden section).
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@kernel
def face_lights(v, x, work, lights):
    """Directions, optical depths and shares of the point lights as seen from a vertex, into `lights`.

    Returns the mean optical depth to them, negative where no point light shines.
    """
    middle = v.power.shape[1] // 2
    total, depth = 0.0, 0.0
    for k in range(lights.shape[0]):
        a, b, c, d, fall = face_light(v, k, x[0], x[1], x[2])
        lights[k, 0], lights[k, 1], lights[k, 2], lights[k, 3] = a, b, c, 0.0
        if v.distant[k]:
            continue
        guide_columns(v, k, x[0], x[1], x[2], d, work.to_light)
        tau = depth_at(v, work.to_light, middle)
        lights[k, 3] = v.share[k] * fall * (0.1 + tau) * math.exp(-v.decay[middle] * tau)
        total += lights[k, 3]
        depth += lights[k, 3] * tau
    if not total > 0.0:
        return -1.0
    for k in range(lights.shape[0]):
        lights[k, 3] /= total
    return depth / total


@inlined
def share_inside(v, lights):
    """Share of the light that comes from stars inside the medium's box."""
    inside = 0.0
    for k in range(lights.shape[0]):
        p, low, high = v.place[k], v.space.low, v.space.high
        if low[0] < p[0] < high[0] and low[1] < p[1] < high[1] and low[2] < p[2] < high[2]:
            inside += lights[k, 3]
    return inside


@inlined
def direction_law(v, d, lights, around, deep):
    """Density of directions by the guess of the light that comes from there [sr-1]."""
    law = (1.0 - around - deep) / (4.0 * math.pi)
    if around + deep > 0.0:
        last = v.shape.size - 1
        for k in range(lights.shape[0]):
            mu = d[0] * lights[k, 0] + d[1] * lights[k, 1] + d[2] * lights[k, 2]
            sine = max(math.sqrt(max((1.0 - mu) * (1.0 + mu), 0.0)), 1e-7)
            place = 0.5 * (min(max(mu, -1.0), 1.0) + 1.0) * last
            j = min(int(place), last - 1)
            shape = v.shape[j] + (place - j) * (v.shape[j + 1] - v.shape[j])
            place = math.acos(min(max(mu, -1.0), 1.0)) / math.pi * last
            j = min(int(place), last - 1)
            angle = v.around[j] + (place - j) * (v.around[j + 1] - v.around[j])
            law += lights[k, 3] * (around * angle / (2.0 * math.pi * sine) + deep * shape)
    return law


@inlined
def draw_from_table(density, cdf, u):
    """Place from 0 to 1, drawn from a density that is linear between equally spaced nodes."""
    last = density.size - 1
    n = cell_of(cdf, 0, last, u)
    return (n + draw_in_cell(density[n], density[n + 1], cdf, n, u)) / last


@kernel
def draw_by_law(v, d, u, w, lights, around, deep, state):
    """Direction from `direction_law`, into `d`."""
    if u >= around + deep:
        d[0], d[1], d[2] = 0.0, 0.0, 1.0
        cosine = 1.0 - 2.0 * (u - around - deep) / (1.0 - around - deep)
    else:
        rest = uniform(state)
        for k in range(lights.shape[0]):
            if lights[k, 3] > 0.0:
                d[0], d[1], d[2] = lights[k, 0], lights[k, 1], lights[k, 2]
                if rest < lights[k, 3]:
                    break
                rest -= lights[k, 3]
        if u < around:
            cosine = math.cos(math.pi * draw_from_table(v.around, v.around_cdf, u / around))
        else:
            cosine = 2.0 * draw_from_table(v.shape, v.shape_cdf, (u - around) / deep) - 1.0
    turn(d, min(max(cosine, -1.0), 1.0), 2.0 * math.pi * w)


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


@kernel
def turn_at_vertex(v, u, w, work, lights, walk):
    """New direction at a vertex; the value takes the phase functions.  False if nothing is scattered there.

    ``work.density`` holds the densities at the vertex.
    The wanted density is the phase function times the guess of the light that comes from a direction.  Candidates are
    drawn from both of these alone, and one of them is kept by its weight (importance resampling: Talbot, Cline &
    Egbert 2005, Eurographics Symposium on Rendering).  The draw is the same for every hero, so chances stay.
    """
    x, d = walk.position, walk.direction
    old_x, old_y, old_z = d[0], d[1], d[2]
    depth = face_lights(v, x, work, lights)
    share = min(max(depth, 0.0) / DEEP, 1.0)
    around, deep = 0.0, 0.0
    if depth >= 0.0:
        inside = share_inside(v, lights)
        near = OUTSIDE_NEAR_SHARES[0] + inside * (NEAR_SHARES[0] - OUTSIDE_NEAR_SHARES[0])
        far = OUTSIDE_DEEP_SHARES[0] + inside * (DEEP_SHARES[0] - OUTSIDE_DEEP_SHARES[0])
        around = near + share * (far - near)
        near = OUTSIDE_NEAR_SHARES[1] + inside * (NEAR_SHARES[1] - OUTSIDE_NEAR_SHARES[1])
        far = OUTSIDE_DEEP_SHARES[1] + inside * (DEEP_SHARES[1] - OUTSIDE_DEEP_SHARES[1])
        deep = near + share * (far - near)
    by_law = 0.5
    corrected = v.correction.shape[0] > 0
    far, here, g = 0.0, 0.0, 0.0
    if corrected:
        share = 1.0 if depth < 0.0 else share
        # Deeper still, light comes from all sides: candidates around the star would only be in the others' way.
        fading = 1.0 - min(max(depth / DEEP - 1.0, 0.0), 1.0)
        around *= fading
        deep *= fading
        # Never as far as a star, where the guess knows no bounds.
        far = min(transport_length(v, work.density), SHY * nearest_star(v, x))
        # The more directions are kept in scattering, the less is left for the guess to choose.
        by_law *= 1.0 - share * forwardness(v, work.density)
        here = 4.0 * math.pi * middle_guess(v, x[0], x[1], x[2], d, 0.0, work)
        g = guessed_forwardness(v, work.density)
    total, kept, chosen = 0.0, 0.0, False
    first = uniform(walk.state)
    best_x, best_y, best_z = 0.0, 0.0, 0.0
    for n in range(CANDIDATES):
        z = (n + u) / CANDIDATES
        azimuth = (first + GOLDEN * n) % 1.0
        if z < by_law:
            draw_by_law(v, d, z / by_law, azimuth, lights, around, deep, walk.state)
        else:
            d[0], d[1], d[2] = old_x, old_y, old_z
            if not draw_by_phase(v.mean, np.int64(0), (z - by_law) / (1.0 - by_law), azimuth, work, walk):
                return False
        phase = mean_phase(v.mean, old_x * d[0] + old_y * d[1] + old_z * d[2], work.density)
        law = direction_law(v, d, lights, around, deep)
        wanted = law
        if corrected and share > 0.0:
            _, end = clip_to_space(v.space, x[0], x[1], x[2], d[0], d[1], d[2])
            on = min(far, INSIDE * end)
            ahead = middle_guess(v, x[0] + on * d[0], x[1] + on * d[1], x[2] + on * d[2], d, g, work)
            wanted += share * (ahead / here - law)
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
    total = 0.0
    for c in range(work.density.size):
        total += work.density[c] * v.sigma_s[c, hero]
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
