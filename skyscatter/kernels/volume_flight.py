"""Plain random walks in three dimensions, against which the forced walks are tested.

The distance to the next collision is drawn from exp(-tau) of the hero wavelength, either by inverting the column along
the leg (closed-form or tabulated flight) or by delta tracking.  At every collision one estimate of the light of every
star is made.  Nothing is forced, stretched or guided.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.gridwalk import Walker, make_walker
from skyscatter.kernels.jit import entry, kernel, merged
from skyscatter.kernels.optics import phase_at, transmittance
from skyscatter.kernels.path import Walk, make_walk, rebalance
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.space import clip_to_space, space_columns, space_densities
from skyscatter.kernels.tracking import delta_flight, light_reaching, watch_point
from skyscatter.kernels.volume import VolumeWork, depth_at, make_volume_work
from skyscatter.kernels.volume_legs import invert_column
from skyscatter.kernels.volume_turns import draw_by_phase

#: The first step of a free flight as a share of its leg, and the factor by which steps grow.
FIRST_STEP, GROWTH = 1.0 / 2048.0, 1.6
#: Below this largest throughput roulette begins.
ROULETTE_BELOW = 0.1


@by_address
class FlightScratch(NamedTuple):
    """Scratch arrays of `volume_flight_rays`."""

    work: VolumeWork
    walker: Walker  #: for delta tracking
    to_lights: Walker  #: for tracked transmittances
    walk: Walk
    start: np.ndarray  #: (component,) columns at the start of a step
    total: np.ndarray  #: (wavelength,) light of one walk
    square: np.ndarray  #: (wavelength,)


def make_flight_scratch(components: int, wavelengths: int) -> FlightScratch:
    """Scratch arrays; a thread needs its own."""
    return FlightScratch(
        make_volume_work(components, wavelengths), make_walker(), make_walker(),
        make_walk(wavelengths), np.zeros(components),
        np.zeros(wavelengths), np.zeros(wavelengths),
    )  # fmt: skip


@kernel
def column_flight(v, hero, shines, s):
    """Fly to where the optical depth of the hero is that of a free path; infinity when the walk leaves the medium."""
    work, walk = s.work, s.walk
    x, d = walk.position, walk.direction
    start, end = clip_to_space(v.space, x[0], x[1], x[2], d[0], d[1], d[2])
    for c in range(work.along.size):
        work.along[c] = 0.0
    t = start
    found = False
    if end > start:
        wanted = -math.log(1.0 - uniform(walk.state))
        step = (end - start) * FIRST_STEP
        while t < end and not found:
            onward = min(t + step, end)
            for c in range(work.along.size):
                s.start[c] = work.along[c]
            space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], t, onward, work.space, work.along)
            if depth_at(v, work.along, hero) >= wanted:
                t = invert_column(v, hero, wanted, t, onward, s.start, x, d, work)
                found = True
            else:
                t = onward
                step *= GROWTH
        if shines:
            gather_on_flight(v, start, t, s)
        for c in range(work.along.size):
            work.along[c] = 0.0
        space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], start, t, work.space, work.along)
    transmittance(work.along, v.sigma_t, work.through)
    if found:
        space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
    for i in range(walk.value.size):
        walk.value[i] *= work.through[i]
        walk.chance[i] *= work.through[i] * (depth_at(v, work.density, i) if found else 1.0)
    if not rebalance(walk) or not found:
        return math.inf
    return t


@kernel
def gather_on_flight(v, start, end, s):
    """What the medium emits along a flight, from one point on it, into ``walk.escape``, times the walk's value."""
    work, walk = s.work, s.walk
    x, d = walk.position, walk.direction
    t = start + uniform(walk.state) * (end - start)
    for c in range(work.along.size):
        work.along[c] = 0.0
    space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], start, t, work.space, work.along)
    transmittance(work.along, v.sigma_t, work.through)
    space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
    mean = 0.0
    for i in range(walk.value.size):
        mean += walk.chance[i] * work.through[i]
    mean /= walk.value.size
    for i in range(walk.value.size):
        light = 0.0
        for c in range(work.density.size):
            light += work.density[c] * v.emission[c, i]
        if mean > 0.0:
            walk.escape[i] += (end - start) * walk.value[i] * work.through[i] * light / mean


@kernel
def add_stars(v, order, s, by_order):
    """Light of every star that is scattered at the walk's position towards where it came from."""
    work, walk = s.work, s.walk
    x, d = walk.position, walk.direction
    for k in range(v.power.shape[0]):
        a, b, c = light_reaching(v, k, x[0], x[1], x[2], work, s.to_lights, walk)
        # Tracking leaves other densities behind.
        space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
        if s.to_lights is not None:
            watch_point(v, x[0], x[1], x[2], work)
        phase_at(v.phase, d[0] * a + d[1] * b + d[2] * c, work.phase)
        for i in range(walk.value.size):
            towards = 0.0
            for n in range(work.density.size):
                towards += work.density[n] * v.sigma_s[n, i] * work.phase[n, i]
            light = walk.value[i] * towards * work.arriving[i]
            s.total[i] += light
            if order <= by_order.shape[0]:
                by_order[order - 1, i] += light


@kernel
def scatter_freely(v, hero, s):
    """New direction by the phase function; False if nothing is scattered."""
    work, walk = s.work, s.walk
    d = walk.direction
    old_x, old_y, old_z = d[0], d[1], d[2]
    if not draw_by_phase(v, hero, uniform(walk.state), uniform(walk.state), work, walk):
        return False
    phase_at(v.phase, old_x * d[0] + old_y * d[1] + old_z * d[2], work.phase)
    for i in range(walk.value.size):
        scattering, towards = 0.0, 0.0
        for c in range(work.density.size):
            sigma = work.density[c] * v.sigma_s[c, i]
            scattering += sigma
            towards += sigma * work.phase[c, i]
        walk.value[i] *= towards
        walk.chance[i] *= towards / max(scattering, 1e-300)
    return rebalance(walk)


@merged
def fly_through(v, delta, max_order, s, by_order):
    """One walk from the camera to its end."""
    walk = s.walk
    hero = min(int(uniform(walk.state) * walk.value.size), walk.value.size - 1)
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    # The leg after the last scattering only looks for emission and light from outside.
    for order in range(1, max_order + 2):
        # What the camera sees unscattered is known without noise.
        shines = v.emits and order > 1
        for i in range(walk.value.size):
            walk.escape[i] = 0.0
        if delta:
            t = delta_flight(v, hero, shines, s.work, s.walker, walk)
        else:
            t = column_flight(v, hero, shines, s)
        for i in range(walk.value.size):
            light = walk.escape[i] + (walk.value[i] * v.background[i] if t == math.inf else 0.0)
            if order > 1:
                s.total[i] += light
                if order - 1 <= by_order.shape[0]:
                    by_order[order - 2, i] += light
        if t == math.inf or order > max_order:
            return
        for n in range(3):
            walk.position[n] += t * walk.direction[n]
        add_stars(v, order, s, by_order)
        if not scatter_freely(v, hero, s):
            return
        largest = 0.0
        for i in range(walk.value.size):
            largest = max(largest, abs(walk.value[i]))
        if largest < ROULETTE_BELOW:
            chance = max(largest / ROULETTE_BELOW, 0.05)
            if uniform(walk.state) >= chance:
                return
            for i in range(walk.value.size):
                walk.value[i] /= chance


@entry
def volume_flight_rays(v, delta, origins, directions, ids, seed, samples, max_order, s, mean, error, by_order, used):
    """Light of all orders along many rays, with plain statistics over walks; arguments as for `volume_path_rays`."""
    for ray in range(origins.shape[0]):
        for i in range(mean.shape[1]):
            mean[ray, i], s.square[i] = 0.0, 0.0
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] = 0.0
        for n in range(samples):
            start_stream(s.walk.state, seed, ids[ray], n)
            for k in range(3):
                s.walk.position[k], s.walk.direction[k] = origins[ray, k], directions[ray, k]
            for i in range(mean.shape[1]):
                s.total[i] = 0.0
            fly_through(v, delta, max_order, s, by_order[ray])
            for i in range(mean.shape[1]):
                mean[ray, i] += s.total[i]
                s.square[i] += s.total[i] * s.total[i]
        for i in range(mean.shape[1]):
            mean[ray, i] /= samples
            spread = max(s.square[i] / samples - mean[ray, i] ** 2, 0.0)
            error[ray, i] = math.sqrt(spread / (samples - 1.0)) if samples > 1 else math.inf
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] /= samples
        used[ray] = samples
