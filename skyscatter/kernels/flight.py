"""Plain random walks with free flights, against which the marching walks are tested.

The distance to the next event is drawn from exp(-tau) at the hero wavelength by inverting the column along the line:
no event is rejected.  At every event one estimate of the sunlight is made.  Value and chance of the walk under every
hero wavelength are kept as in `kernels.path`, and combined by the same balance heuristic.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skyscatter.kernels.directions import turn
from skyscatter.kernels.eclipse import dim
from skyscatter.kernels.jit import entry, kernel
from skyscatter.kernels.lookup import columns_along, densities, start_columns, trace_line
from skyscatter.kernels.optics import (
    ground_row,
    mix_components,
    phase_at,
    sample_cosine,
    transmittance,
    weigh_phase,
)
from skyscatter.kernels.path import (
    depart,
    depth_at,
    fly,
    lift_to_ground,
    light_at,
    make_walk,
    move,
    pick_sun,
    rebalance,
    reflect,
)
from skyscatter.kernels.polar import arriving, begin, depolarise, face_sun, gather, light_up, note, polarise
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.work import make_work

#: Below this largest throughput roulette begins.
ROULETTE_BELOW = 0.1


@kernel
def add_sunlight(scene, ground, r, at_ground, order, work, walk, polar, total, by_order):
    """One next-event estimate at the walk's position: a point of the solar disk, seen from there."""
    optics = scene.optics
    node = pick_sun(optics, uniform(walk.state))
    s, x, d = optics.sun_direction[node], walk.position, walk.direction
    x_sun = x[0] * s[0] + x[1] * s[1] + x[2] * s[2]
    if (at_ground and x_sun <= 0.0) or not light_at(scene, r, x_sun, work):
        return
    if scene.eclipse.share.size > 0:
        dim(scene.eclipse, x[0], x[1], x[2], work.sun)
    if not at_ground:
        phase_at(optics.phase, d[0] * s[0] + d[1] * s[1] + d[2] * s[2], work.phase)
        weigh_phase(work.phase, optics.sigma_s, work.weighted)
        mix_components(work.density, optics.sigma_s, work.scattering)
        mix_components(work.density, work.weighted, work.towards)
        work.source[:] = 1.0  # transmittance from the event to itself
        face_sun(polar, optics.sigma_s, d, s, d[0] * s[0] + d[1] * s[1] + d[2] * s[2])
        gather(polar, work.density, 1.0, work.source, work.sun)
        light_up(polar, optics.sun_irradiance, node, optics.sun_chance[node])
    polarising = 0.0 if at_ground else 1.0
    row = ground_row(ground, x[0], x[1], x[2]) if at_ground else 0
    for i in range(total.size):
        towards = ground.albedo[row, i] * (x_sun / r) / math.pi if at_ground else work.towards[i]
        light = towards * work.sun[i] * optics.sun_irradiance[node, i] / optics.sun_chance[node]
        note(polar, walk.value[i], i, light, polarising)
        light = walk.value[i] * arriving(polar, 0, i, light, polarising)
        total[i] += light
        if order <= by_order.shape[0]:
            by_order[order - 1, i] += light


@kernel
def turn_by_phase(scene, hero, work, walk, polar):
    """New direction by the phase function of a component that the hero is scattered by."""
    optics = scene.optics
    total = 0.0
    for c in range(work.density.size):
        total += work.density[c] * optics.sigma_s[c, hero]
    rest, chosen = uniform(walk.state) * total, 0
    for c in range(work.density.size):
        part = work.density[c] * optics.sigma_s[c, hero]
        if part > 0.0:
            chosen = c
            if rest < part:
                break
            rest -= part
    d = walk.direction
    old_x, old_y, old_z = d[0], d[1], d[2]
    cosine = sample_cosine(optics, chosen, hero, uniform(walk.state))
    turn(walk.direction, cosine, 2.0 * math.pi * uniform(walk.state))
    phase_at(optics.phase, cosine, work.phase)
    weigh_phase(work.phase, optics.sigma_s, work.weighted)
    mix_components(work.density, optics.sigma_s, work.scattering)
    mix_components(work.density, work.weighted, work.towards)
    for i in range(walk.value.size):
        # The value takes scattering times phase function; each hero's chance its own mean phase function.
        walk.value[i] *= work.towards[i]
        walk.chance[i] *= work.towards[i] / max(work.scattering[i], 1e-300)
    polarise(polar, optics.sigma_s, work.density, old_x, old_y, old_z, d)


@kernel
def add_background(scene, order, walk, polar, total, by_order):
    """Light from outside, at the end of a walk."""
    for i in range(total.size):
        note(polar, walk.value[i], i, scene.optics.background[i], 0.0)
        light = walk.value[i] * arriving(polar, 0, i, scene.optics.background[i], 0.0)
        total[i] += light
        if 1 <= order <= by_order.shape[0]:
            by_order[order - 1, i] += light


@kernel
def fly_leg(scene, ground, order, max_order, hero, work, walk, polar, total, by_order):
    """One free flight and the event at its end; False when the walk leaves the atmosphere."""
    optics, x, d = scene.optics, walk.position, walk.direction
    line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
    t = line.leave
    if line.leave > line.enter:
        start_columns(scene.columns, line, work.from_start, work.across)
        tau = -math.log(1.0 - uniform(walk.state))
        if depth_at(scene, line, line.leave, hero, work) > tau:
            t = fly(scene, line, hero, tau, work)
        columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    else:
        for c in range(work.along.size):
            work.along[c] = 0.0
    transmittance(work.along, optics.sigma_t, work.through)
    r = math.sqrt(line.p * line.p + t * t)
    at_end = t >= line.leave
    if not at_end:
        densities(scene.columns, r - scene.columns.radius, work.density)
    for i in range(total.size):
        extinction = 1.0
        if not at_end:
            extinction = 0.0
            for c in range(work.density.size):
                extinction += work.density[c] * optics.sigma_t[c, i]
        walk.value[i] *= work.through[i]
        walk.chance[i] *= work.through[i] * extinction
    if not rebalance(walk):
        return False
    if at_end and not line.hits_ground:
        # The camera's own ray to the outside is deterministic and not counted here.
        if order > 1:
            add_background(scene, order - 1, walk, polar, total, by_order)
        return False
    if order > max_order:
        return False
    move(walk, t - line.start)
    if at_end:
        lift_to_ground(scene, walk)
        add_sunlight(scene, ground, scene.columns.radius, True, order, work, walk, polar, total, by_order)
        row = ground_row(ground, x[0], x[1], x[2])
        for i in range(total.size):
            walk.value[i] *= ground.albedo[row, i]
        reflect(walk, uniform(walk.state), uniform(walk.state))
        depolarise(polar, d)
        return True
    if optics.emits:
        add_emission(scene, order, work, walk, polar, total, by_order)
    add_sunlight(scene, ground, r, False, order, work, walk, polar, total, by_order)
    turn_by_phase(scene, hero, work, walk, polar)
    return rebalance(walk)


@kernel
def add_emission(scene, order, work, walk, polar, total, by_order):
    """Light that the medium gives off at an event."""
    for i in range(total.size):
        for c in range(work.density.size):
            light = work.density[c] * scene.optics.emission[c, i]
            note(polar, walk.value[i], i, light, 0.0)
            light = walk.value[i] * arriving(polar, 0, i, light, 0.0)
            total[i] += light
            # What reaches the camera unscattered counts with the first order, as it does where `single` finds it.
            if max(order - 1, 1) <= by_order.shape[0]:
                by_order[max(order - 1, 1) - 1, i] += light


@kernel
def walk_freely(scene, ground, max_order, work, walk, polar, total, by_order):
    """One walk from the camera to its end."""
    hero = min(int(uniform(walk.state) * total.size), total.size - 1)
    for i in range(total.size):
        walk.value[i] = 1.0
        walk.chance[i] = 1.0
    # The leg after the last scattering only looks for light from outside.
    for order in range(1, max_order + 2):
        if not fly_leg(scene, ground, order, max_order, hero, work, walk, polar, total, by_order):
            return
        largest = 0.0
        for i in range(total.size):
            largest = max(largest, walk.value[i])
        if largest < ROULETTE_BELOW:
            if uniform(walk.state) >= largest / ROULETTE_BELOW:
                return
            for i in range(total.size):
                walk.value[i] *= ROULETTE_BELOW / largest


@entry
def flight_rays(
    scene, ground, origins, directions, ids, seed, samples, max_order, scratch, polar, mean, error, by_order, used
):  # fmt: skip
    """Light of all orders along many rays, with plain statistics over walks; arguments as for `path_rays`.

    In the place of batches `polar` holds the sums of one walk, of all walks, and of their squares.
    """
    work, walk, total, square = scratch
    wavelengths = total.size
    for ray in range(origins.shape[0]):
        for i in range(wavelengths):
            mean[ray, i], square[i] = 0.0, 0.0
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] = 0.0
        if polar is not None:
            polar.sums[:] = 0.0
        for n in range(samples):
            begin(polar, ray, 0)
            start_stream(walk.state, seed, ids[ray], n)
            depart(walk, origins[ray], directions[ray])
            for i in range(wavelengths):
                total[i] = 0.0
            walk_freely(scene, ground, max_order, work, walk, polar, total, by_order[ray])
            if polar is not None:
                for k in range(3):
                    for i in range(wavelengths):
                        light = polar.sums[k, 0, i]
                        polar.sums[k, 0, i] = 0.0
                        polar.sums[k, 1, i] += light
                        polar.sums[k, 2, i] += light * light
            for i in range(wavelengths):
                mean[ray, i] += total[i]
                square[i] += total[i] * total[i]
        for i in range(wavelengths):
            mean[ray, i] /= samples
            spread = max(square[i] / samples - mean[ray, i] ** 2, 0.0)
            error[ray, i] = math.sqrt(spread / (samples - 1.0)) if samples > 1 else math.inf
            if polar is not None:
                for k in range(3):
                    middle = polar.sums[k, 1, i] / samples
                    spread = max(polar.sums[k, 2, i] / samples - middle * middle, 0.0)
                    polar.mean[ray, k, i] = middle
                    polar.error[ray, k, i] = math.sqrt(spread / (samples - 1.0)) if samples > 1 else math.inf
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] /= samples
        used[ray] = samples


def make_flight_scratch(components: int, wavelengths: int) -> tuple[Any, ...]:
    """Scratch arrays of `flight_rays`; a thread needs its own."""
    return make_work(components, wavelengths), make_walk(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths)
