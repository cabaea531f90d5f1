"""Peaks of phase functions, which walks from the camera follow, so that photons are not gathered with them.

A photon that happens to fly along a camera's ray would count a thousandfold where droplets scatter into a narrow cone
forwards.  So the phase function is cut at a few times the isotropic one: p = broad + peak, broad = min(p, cut).  Light
that was scattered before is gathered with the broad part alone; the peak's part is what a walk sees that is scattered
by it, as if it were a boundary met by chance, and goes on:

    L = int tau sigma_s [int broad L' + int peak L'] dt + tau(end) L(end).

The first integral is that of the visibility points.  Of the other two terms the walk takes one: with the probability
q_h = 1 - exp(-f_h times the leg's optical depth), f_h the share of light that the peak scatters, it is scattered on
the leg, at a place drawn by free path.  Light of lamps that has not yet been scattered
(straight, or through mirrors and glass) is gathered with the whole phase function, for walks do not find lamps that are
points; therefore a walk that was scattered by a peak no longer counts the lamps it meets.  Light from all around is
treated like scattered light.
"""

from __future__ import annotations

import math

from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import kernel, merged
from skyscatter.kernels.optics import sample_cosine
from skyscatter.kernels.path import rebalance
from skyscatter.kernels.random import uniform
from skyscatter.kernels.surfaces.gather import mix_phase
from skyscatter.kernels.surfaces.media import medium_density, spectral_depth, transmit


@merged
def chances_of_peak(peaks, m, whole, out):
    """Probability q_h that the walk is scattered on a leg with the transmittance `whole`, into `out` (wavelength,)."""
    for i in range(out.size):
        share = peaks.most[m, i]
        out[i] = 0.0
        if share > 0.0:
            out[i] = 1.0 - whole[i] ** share


@merged
def draw_peak(peaks, media, m, hero, u, v, work, direction):
    """Turn a direction by the peak of a component that has one; False if none has."""
    density, total = work.density, 0.0
    for c in range(media.first[m], media.first[m + 1]):
        total += density[c] * media.sigma_s[c, hero] * peaks.share[c, hero]
    if not total > 0.0:
        return False
    rest, chosen, part = u * total, media.first[m], 1.0
    for c in range(media.first[m], media.first[m + 1]):
        s = density[c] * media.sigma_s[c, hero] * peaks.share[c, hero]
        if s > 0.0:
            chosen, part = c, s
            if rest < s:
                break
            rest -= s
    cosine = sample_cosine(peaks, chosen, hero, min(max(rest / part, 0.0), 1.0 - 1e-16))
    turn(direction, cosine, 2.0 * math.pi * v)
    return True


@kernel
def scatter_by_peak(peaks, media, m, hero, t, s):
    """Scatter the walk by the peak at the distance t, drawn by the hero's free path; False if it ends.

    ``s.light_through`` is the transmittance of the whole leg, ``s.density`` what `chances_of_peak` gave.
    """
    walk, work, through = s.walk, s.work, s.light
    x, d, whole = walk.position, walk.direction, s.light_through
    transmit(media, m, x, d, t, work, through)
    for n in range(3):
        x[n] += t * d[n]
        s.arriving[n] = d[n]
    medium_density(media, m, x[0], x[1], x[2], work)
    spectral_depth(media, m, work.density, work.total)
    if not draw_peak(peaks, media, m, hero, uniform(walk.state), uniform(walk.state), work, d):
        return False
    cosine = d[0] * s.arriving[0] + d[1] * s.arriving[1] + d[2] * s.arriving[2]
    mix_phase(media.first[m], media.first[m + 1], work.density, media.sigma_s, peaks.phase, cosine, s.factor)
    for i in range(through.size):
        scattered = 0.0
        for c in range(media.first[m], media.first[m + 1]):
            scattered += work.density[c] * media.sigma_s[c, i] * peaks.share[c, i]
        placed = through[i] * work.total[i] / (1.0 - whole[i]) if whole[i] < 1.0 else 0.0
        walk.value[i] *= through[i] * s.factor[i]
        walk.chance[i] *= s.density[i] * placed * (s.factor[i] / scattered if scattered > 0.0 else 0.0)
    return rebalance(walk)
