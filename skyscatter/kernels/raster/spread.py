"""Backward walks from a sensor that looks at a target: where the light that reaches it by scattering left the ground.

The ground is black for the walks and shines with radiance 1 for the count.  A walk is scattered on the sensor's line of
sight (its first flight is drawn so that it collides before the target) and flies on freely.  Every leg that points to
the ground gives what comes through from there, whether the walk itself gets so far or not.  All wavelengths share the
walks by the balance heuristic, as in `skyscatter.kernels.path`.
"""

# Decorated by numba, which is untyped; the arrays are checked by the callers.
# mypy: allow-untyped-defs, allow-untyped-decorators

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skyscatter.kernels.flight import ROULETTE_BELOW, turn_by_phase
from skyscatter.kernels.jit import entry, kernel, merged
from skyscatter.kernels.lookup import columns_along, densities, start_columns, trace_line
from skyscatter.kernels.optics import mix_components, transmittance
from skyscatter.kernels.path import depart, fly, make_walk, move, rebalance
from skyscatter.kernels.polar import begin
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.work import make_work

#: Independent batches from whose spread the standard errors are computed.
BATCHES = 16


@kernel
def collide(scene, line, hero, u, lost, camera, work, walk):
    """Put the walk where it is first scattered, drawn by the hero wavelength among all places before the target."""
    t = fly(scene, line, hero, -math.log1p(-u * lost[hero]), camera)
    r = columns_along(scene.columns, line, t, camera.from_start, camera.across, camera.along)
    transmittance(camera.along, scene.optics.sigma_t, work.through)
    densities(scene.columns, r - scene.columns.radius, work.density)
    mix_components(work.density, scene.optics.sigma_t, work.towards)
    for i in range(walk.value.size):
        walk.value[i] = work.through[i]
        walk.chance[i] = work.through[i] * work.towards[i] / max(lost[i], 1e-300)
    move(walk, t - line.start)


@kernel
def fly_on(scene, hero, work, walk, polar, target, edges, sums):
    """Count what comes from the ground at the end of a leg, and fly to the next scattering; False if there is none."""
    optics, x, d = scene.optics, walk.position, walk.direction
    line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
    start_columns(scene.columns, line, work.from_start, work.across)
    columns_along(scene.columns, line, line.leave, work.from_start, work.across, work.along)
    depth = 0.0
    for c in range(work.along.size):
        depth += work.along[c] * optics.sigma_t[c, hero]
    if line.hits_ground:
        transmittance(work.along, optics.sigma_t, work.through)
        far, square = line.leave - line.start, 0.0
        for k in range(3):
            square += (x[k] + far * d[k] - target[k]) ** 2
        row = np.searchsorted(edges, math.sqrt(square))
        for i in range(walk.value.size):
            light = walk.value[i] * work.through[i]
            sums[row, i] += light if polar is None else light * polar.matrix[0, 0, i]
    tau = -math.log(1.0 - uniform(walk.state))
    if tau >= depth:
        return False
    t = fly(scene, line, hero, tau, work)
    r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, optics.sigma_t, work.through)
    densities(scene.columns, r - scene.columns.radius, work.density)
    mix_components(work.density, optics.sigma_t, work.towards)
    for i in range(walk.value.size):
        walk.value[i] *= work.through[i]
        walk.chance[i] *= work.through[i] * work.towards[i]
    move(walk, t - line.start)
    return True


@kernel
def largest_value(walk):
    """Of all wavelengths."""
    largest = 0.0
    for i in range(walk.value.size):
        largest = max(largest, walk.value[i])
    return largest


@kernel
def survives(walk, least):
    """Russian roulette for walks that have less than `least` left; survivors carry the weight of the fallen."""
    largest = largest_value(walk)
    if largest >= least:
        return True
    if uniform(walk.state) * least >= largest:
        return False
    for i in range(walk.value.size):
        walk.value[i] *= least / largest
    return True


@merged
def wander(scene, line, hero, u, lost, camera, work, walk, polar, target, edges, sums):
    """One walk from the sensor to its end."""
    collide(scene, line, hero, u, lost, camera, work, walk)
    least = 0.0
    while True:
        turn_by_phase(scene, hero, work, walk, polar)
        if not rebalance(walk) or not survives(walk, least):
            return
        # In thin air little light is scattered even once: what counts is how much a walk has lost since.
        if least == 0.0:
            least = ROULETTE_BELOW * largest_value(walk)
        if not fly_on(scene, hero, work, walk, polar, target, edges, sums):
            return


@entry
def spread_walks(scene, target, origin, direction, seed, walks, edges, scratch, polar, direct, sums):
    """Light of the ground that reaches a sensor, by the distance from the target at which it left the ground.

    Parameters
    ----------
    scene : SceneTable
    target : (3,)
        Point on the ground that the sensor looks at [m].
    origin, direction : (3,)
        Of the sensor [m], and from it to the target.
    seed : int
    walks : int
        In every batch; a multiple of the number of wavelengths.
    edges : (edge,)
        Distances that part the bins, rising [m].
    scratch : tuple
        Made by `make_spread_scratch`.
    polar : Polar or None
        Scratch for polarised light.
    direct : (wavelength,), output
        Transmittance from the target to the sensor.
    sums : (batch, edge + 1, wavelength), output
        Radiance that ground of radiance 1 in each of the bins sends to the sensor by scattering; the last bin has no
        end.
    """
    work, camera, walk, lost = scratch
    line = trace_line(scene.columns, origin[0], origin[1], origin[2], direction[0], direction[1], direction[2])
    start_columns(scene.columns, line, camera.from_start, camera.across)
    columns_along(scene.columns, line, line.leave, camera.from_start, camera.across, camera.along)
    transmittance(camera.along, scene.optics.sigma_t, direct)
    mix_components(camera.along, scene.optics.sigma_t, lost)
    for i in range(lost.size):
        lost[i] = -math.expm1(-lost[i])
    sums[:] = 0.0
    for b in range(sums.shape[0]):
        for n in range(walks):
            start_stream(walk.state, seed, b, n)
            # Every wavelength leads as many walks as the others, and spreads the depths of its own evenly.
            hero, k = n % lost.size, n // lost.size
            u = (k + uniform(walk.state)) * lost.size / walks
            depart(walk, origin, direction)
            begin(polar, 0, 0)
            wander(scene, line, hero, u, lost, camera, work, walk, polar, target, edges, sums[b])
        for k in range(sums.shape[1]):
            for i in range(lost.size):
                sums[b, k, i] /= walks


def make_spread_scratch(components: int, wavelengths: int) -> tuple[Any, ...]:
    """Scratch arrays of `spread_walks`; a thread needs its own."""
    work, camera = make_work(components, wavelengths), make_work(components, wavelengths)
    return work, camera, make_walk(wavelengths), np.zeros(wavelengths)
