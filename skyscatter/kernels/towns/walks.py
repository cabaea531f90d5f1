"""Light of a lamp on the ground that is scattered or reflected more than once, by backward random walks.

The walks are those of `skyscatter.kernels.path` but for where they look for light: at points of every leg the lamp is
looked at.  Two sets of points share the work by the balance heuristic: one in each stratum of the leg, and some that
crowd where the leg is near the lamp, evenly in the angle under which it sees the leg.  Directions are drawn by the
phase function, and around the lamp: light that a lamp sends into the air around it is seen to grow as one over the
angle from it, or faster where it is far (Georgiev et al. 2013, ACM Transactions on Graphics 32, 164).  Together they
leave no pole of the order 1 / D^2.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.lookup import densities, trace_line
from skyscatter.kernels.optics import mix_components
from skyscatter.kernels.path import (
    AIR,
    BATCHES,
    CAMERA_STRATA,
    FIRST_ROULETTE,
    GUIDED_LEGS,
    NOTHING,
    choose,
    depart,
    draw,
    lift_to_ground,
    make_leg,
    make_walk,
    mean_phase,
    mixture_cosine,
    prepare_leg,
    rebalance,
    reflect,
    statistics,
    survives,
    turn_by_phase,
)
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.towns.first import lamp_source, nearest
from skyscatter.kernels.work import make_work

#: Strata of a leg, and points of it that crowd at the lamp.
LEG_STRATA, NEAR_POINTS = 6, 4
#: Share of the draw of vertices that does not ask whether the lamp's light comes through to a point.
DARK_SHARE = 0.05
#: Distance [m] from the lamp within which the guide of the vertices takes the air as evenly lit.
NEAR = 1000.0
#: Angle from the lamp [rad] below which the guide of directions takes the lamp's light as growing as one over it.
EVEN_ANGLE = 0.1
ANGLE_LOG = math.log((math.pi + EVEN_ANGLE) / EVEN_ANGLE)
#: Share of the directions drawn by an isotropic phase function, and what it grows by with the mean cosine.
PHASE_SHARE, PHASE_GROWTH = 0.25, 0.35


@inlined
def near_density(middle, near, first, last, t):
    """Density [m-1] of a point that is drawn evenly in the angle under which the lamp sees the leg."""
    return near / (max(last - first, 1e-300) * (near * near + (t - middle) * (t - middle)))


@kernel
def march_to_lamp(scene, line, lobe, lamp, u, v, guided, leg, work, walk):
    """March a prepared leg: the lamp's light into ``walk.gain``, if `guided` the chances of its strata."""
    x, d = walk.position, walk.direction
    strata = leg.edge.size - 1
    middle, near = nearest(line, x, d, lamp)
    first, last = math.atan((line.enter - middle) / near), math.atan((line.leave - middle) / near)
    for i in range(walk.gain.size):
        walk.gain[i], leg.total[i] = 0.0, 0.0
    for n in range(strata + NEAR_POINTS):
        k = n
        if n < strata:
            t = leg.edge[k] + u * (leg.edge[k + 1] - leg.edge[k])
        else:
            t = middle + near * math.tan(first + (last - first) * ((n - strata + v) / NEAR_POINTS))
            t = min(max(t, line.enter), line.leave)
            k = 0
            while k < strata - 1 and leg.edge[k + 1] <= t:
                k += 1
        width = leg.edge[k + 1] - leg.edge[k]
        square = lamp_source(scene, line, x, d, t, lobe, lamp, work)
        crowd = NEAR_POINTS * near_density(middle, near, first, last, t)
        share = width / (1.0 + width * crowd) / square
        for i in range(walk.gain.size):
            walk.gain[i] += share * work.source[i]
        if guided and n < strata:
            mix_components(work.density, scene.optics.sigma_s, work.scattering)
            lit = width / (math.sqrt(square) + NEAR)
            for i in range(walk.gain.size):
                leg.chance[k, i] = lit * work.through[i] * work.scattering[i] * (DARK_SHARE + work.sun[i])
                leg.total[i] += leg.chance[k, i]
    if guided:
        _share_out(line, lamp, leg, walk)


@merged
def _share_out(line, lamp, leg, walk):
    """Add the chance of the ground at the end of a leg, and make the chances sum to 1."""
    strata = leg.edge.size - 1
    s = line.leave - line.start
    square = 0.0
    for n in range(3):
        square += (walk.position[n] + s * walk.direction[n] - lamp[n]) ** 2
    for i in range(leg.total.size):
        leg.chance[strata, i] = 0.3 * leg.through[i] * leg.albedo[i] / (math.sqrt(square) + NEAR)
        leg.total[i] += leg.chance[strata, i]
        for k in range(strata + 1):
            leg.chance[k, i] = leg.chance[k, i] / leg.total[i] if leg.total[i] > 0.0 else 0.0


@kernel
def face_lamp(radius, position, lamp, out):
    """Unit vector into `out` (3,) towards the lamp, or towards the lowest air above it that is in sight."""
    r = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
    cosine = position[0] * lamp[0] + position[1] * lamp[1] + position[2] * lamp[2]
    angle = math.acos(min(max(cosine / (r * radius), -1.0), 1.0)) - math.acos(min(radius / r, 1.0))
    rise = 1.0 / math.cos(min(angle, 0.5)) if angle > 0.0 else 1.0
    norm = 0.0
    for n in range(3):
        out[n] = rise * lamp[n] - position[n]
        norm += out[n] * out[n]
    norm = math.sqrt(max(norm, 1e-6))
    for n in range(3):
        out[n] /= norm


@inlined
def density_near_lamp(d, to_lamp):
    """Density [sr-1] with which `turn_to_lamp` draws a direction."""
    a = d[1] * to_lamp[2] - d[2] * to_lamp[1]
    b = d[2] * to_lamp[0] - d[0] * to_lamp[2]
    c = d[0] * to_lamp[1] - d[1] * to_lamp[0]
    sine = max(math.sqrt(a * a + b * b + c * c), 1e-9)
    angle = math.atan2(sine, d[0] * to_lamp[0] + d[1] * to_lamp[1] + d[2] * to_lamp[2])
    return 1.0 / (2.0 * math.pi * sine * (angle + EVEN_ANGLE) * ANGLE_LOG)


@inlined
def turn_to_lamp(d, to_lamp, u, v):
    """A direction near the lamp: its angle a from it by 1 / (a + EVEN_ANGLE)."""
    d[0], d[1], d[2] = to_lamp[0], to_lamp[1], to_lamp[2]
    turn(d, math.cos(min(EVEN_ANGLE * math.exp(ANGLE_LOG * u) - EVEN_ANGLE, math.pi)), 2.0 * math.pi * v)


@kernel
def scatter_near_lamp(scene, lamp, hero, u, v, work, walk, to_lamp):
    """New direction of the walk after scattering where it is; the choice of the way is integrated out."""
    optics, x, d = scene.optics, walk.position, walk.direction
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    densities(scene.columns, r - scene.columns.radius, work.density)
    mix_components(work.density, optics.sigma_s, work.scattering)
    face_lamp(scene.columns.radius, x, lamp, to_lamp)
    by_phase = PHASE_SHARE + PHASE_GROWTH * mixture_cosine(optics, work)
    old_x, old_y, old_z = d[0], d[1], d[2]
    if u < by_phase:
        turn_by_phase(optics, hero, u / by_phase, v, work, d)
    else:
        turn_to_lamp(d, to_lamp, min((u - by_phase) / (1.0 - by_phase), 1.0), v)
    mean_phase(optics, old_x * d[0] + old_y * d[1] + old_z * d[2], work, work.towards)
    density = (1.0 - by_phase) * density_near_lamp(d, to_lamp)
    for i in range(walk.value.size):
        walk.value[i] *= work.towards[i]
        walk.chance[i] *= by_phase * work.towards[i] + density


@merged
def wander_to_lamp(scene, ground, lobe, lamp, line, camera, max_order, leg, work, camera_work, walk, to_lamp, total):
    """Follow a walk from the camera to its end and add up the lamp's light of the second and higher orders."""
    hero = min(int(walk.even[0] * walk.value.size), walk.value.size - 1)
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    found = choose(scene, line, camera, hero, walk.even[1], GUIDED_LEGS > 0, camera_work, walk)
    x, d = walk.position, walk.direction
    for order in range(1, max_order):
        if found == NOTHING:
            return
        guided = order <= GUIDED_LEGS
        u, v = draw(walk, order, 0), draw(walk, order, 1)
        if found == AIR:
            scatter_near_lamp(scene, lamp, hero, u, v, work, walk, to_lamp)
        else:
            lift_to_ground(scene, walk)
            reflect(walk, u, v)
        if not rebalance(walk):
            return
        if order == 1:
            walk.worth[0] = 1.0
        elif order >= FIRST_ROULETTE and not survives(walk):
            return
        line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
        if line.leave <= line.enter:
            return
        prepare_leg(scene, ground, line, walk, leg, work)
        march_to_lamp(
            scene, line, lobe, lamp, draw(walk, order, 2), draw(walk, order, 3), guided, leg, work, walk
        )
        for i in range(total.size):
            total[i] += walk.value[i] * walk.gain[i]
        found = choose(scene, line, leg, hero, draw(walk, order, 4), guided, work, walk)


@entry
def walk_rays(
    scene, ground, lobe, lamps, origins, directions, ids, seed, samples, max_order, scratch, mean, error
):  # fmt: skip
    """Light of one lamp for each ray, scattered or reflected twice and more often.

    Parameters
    ----------
    scene : SceneTable
    ground : GroundTable
    lobe, lamps, origins, directions
        As for `skyscatter.kernels.towns.first.first_rays`.
    ids : (ray,) int64
        Numbers of the rays, by which their random streams are chosen.
    seed : int
    samples : int
        Walks per ray, a multiple of `BATCHES`.
    max_order : int
        Highest order of scattering.
    scratch : tuple
        Made by `make_walk_scratch`.
    mean, error : (ray, wavelength), output
        Radiance over the lamp's power [m-2 sr-1], and its standard error.
    """
    work, camera_work, camera, leg, walk, sums, shift, to_lamp = scratch
    for ray in range(origins.shape[0]):
        o, d, lamp = origins[ray], directions[ray], lamps[ray]
        for i in range(mean.shape[1]):
            mean[ray, i], error[ray, i] = 0.0, 0.0
        line = trace_line(scene.columns, o[0], o[1], o[2], d[0], d[1], d[2])
        # A ray that starts on the ground and looks down has no length, but light to reflect.
        if line.leave <= line.enter and not line.hits_ground:
            continue
        depart(walk, o, d)
        prepare_leg(scene, ground, line, walk, camera, camera_work)
        march_to_lamp(scene, line, lobe, lamp, 0.5, 0.5, GUIDED_LEGS > 0, camera, camera_work, walk)
        for b in range(BATCHES):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
            for i in range(mean.shape[1]):
                sums[b, i] = 0.0
            for n in range(samples // BATCHES):
                start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                even_point(shift[b], n, walk.even)
                depart(walk, o, d)
                wander_to_lamp(
                    scene, ground, lobe, lamp, line, camera, max_order, leg, work, camera_work, walk, to_lamp, sums[b]
                )
        statistics(sums, BATCHES, samples // BATCHES, mean[ray], error[ray])


def make_walk_scratch(components: int, wavelengths: int) -> tuple[Any, ...]:
    """Scratch arrays of `walk_rays`; a thread needs its own."""
    return (
        make_work(components, wavelengths),
        make_work(components, wavelengths),
        make_leg(CAMERA_STRATA, wavelengths),
        make_leg(LEG_STRATA, wavelengths),
        make_walk(wavelengths),
        np.zeros((BATCHES, wavelengths)),
        np.zeros((BATCHES, EVEN_DIMENSIONS), np.uint32),
        np.zeros(3),
    )
