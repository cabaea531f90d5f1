"""Walks from the camera that leave visibility points on their way.

A walk goes through media, past INTERFACE surfaces and along reflections and refractions without spread, to the first
surface that spreads light; there it leaves its last point.  On every leg through a medium it leaves a few points,
*forced* to lie on the leg: drawn by the hero's free path, cut off at the end of the leg, evenly in its distribution.
With F and P as in `kernels.path` a point at the distance t counts  F_i tau_i(t) / mean_h(P_h p_h(t)),  where
p_h = tau_h sigma_h / (1 - tau_h(end)); the walk itself goes on with the transmittance of the leg.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.solvers.kernels.jit import entry, kernel, merged
from skyscatter.solvers.kernels.path import rebalance
from skyscatter.solvers.kernels.random import start_stream, uniform
from skyscatter.solvers.kernels.surfaces.bsdf import is_delta
from skyscatter.solvers.kernels.surfaces.media import current_medium, fly, transmit
from skyscatter.solvers.kernels.surfaces.photons import bounce, media_behind
from skyscatter.solvers.kernels.surfaces.points import DIRECT, FOCUSED, SCATTERED
from skyscatter.solvers.kernels.surfaces.rays import closest_hit, fill_stack, next_hit
from skyscatter.solvers.kernels.surfaces.shapes import item_body
from skyscatter.solvers.kernels.surfaces.tables import ABSORBED, DIELECTRIC, INTERFACE, SURROUNDINGS

#: Legs of a walk at most: as many boundaries and mirrors as can be looked through.
MOST_LEGS = 64
#: Value below which walks between mirrors are given up by roulette.
WEAK = 0.05


@kernel
def note_point(points, ray, x, d, m, beyond, body, order, accepts):
    """A new visibility point; its number."""
    p = points.count[0]
    points.count[0] = p + 1
    for n in range(3):
        points.place[p, n], points.direction[p, n] = x[n], d[n]
    points.ray[p], points.medium[p], points.beyond[p], points.body[p] = ray, m, beyond, body
    points.order[p], points.accepts[p] = order, accepts
    return p


@merged
def leave_events(scene, points, ray, m, hero, far, events, accepts, order, s):
    """Forced events on a leg; the transmittance of the whole leg into ``s.light_through``."""
    walk, media = s.walk, scene.media
    x, d, whole = walk.position, walk.direction, s.light_through
    transmit(media, m, x, d, far, s.work, whole)
    lost = 1.0 - whole[hero]
    if not lost > 0.0:
        return
    for i in range(walk.value.size):
        s.value[i], s.chance[i] = walk.value[i], walk.chance[i]
    for k in range(events):
        t, hit = fly(media, m, hero, x, d, far, (k + uniform(walk.state)) / events * lost, walk, s.work)
        for i in range(walk.value.size):
            walk.chance[i] = walk.chance[i] / (1.0 - whole[i]) if whole[i] < 1.0 else 0.0
        if hit and rebalance(walk):
            for n in range(3):
                s.place[n] = x[n] + t * d[n]
            p = note_point(points, ray, s.place, d, m, m, -1, order, accepts)
            for c in range(s.work.density.size):
                points.density[p, c] = s.work.density[c]
            for i in range(walk.value.size):
                points.weight[p, i] = walk.value[i] / events
        for i in range(walk.value.size):
            walk.value[i], walk.chance[i] = s.value[i], s.chance[i]


@merged
def leave_surface_point(surfaces, ray, m, beyond, body, order, accepts, s):
    """The last point of a walk, on a surface that spreads light."""
    p = note_point(surfaces, ray, s.walk.position, s.walk.direction, m, beyond, body, order, accepts)
    for n in range(3):
        surfaces.normal[p, n] = s.hit[1 + n]
    for i in range(s.walk.value.size):
        surfaces.weight[p, i] = s.walk.value[i]


@kernel
def lobe_at(lamps, k, cosine):
    """Lobe of lamp k [sr-1] at the cosine of an angle from its axis, nought outside of its nodes."""
    first, last = lamps.lobe_first[k], lamps.lobe_first[k + 1] - 1
    if not lamps.lobe_cosine[first] <= cosine <= lamps.lobe_cosine[last]:
        return 0.0
    low, high = first, last
    while high - low > 1:
        middle = (low + high) >> 1
        if lamps.lobe_cosine[middle] <= cosine:
            low = middle
        else:
            high = middle
    width = lamps.lobe_cosine[high] - lamps.lobe_cosine[low]
    w = (cosine - lamps.lobe_cosine[low]) / width if width > 0.0 else 0.0
    return lamps.lobe_value[low] + w * (lamps.lobe_value[high] - lamps.lobe_value[low])


@merged
def see_lamp(lamps, k, ray, s, sums):
    """Light of a lamp's own surface that the walk has met from outside."""
    d, hit = s.walk.direction, s.hit
    cosine = -(d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3])
    if cosine > 0.0:
        bright = lobe_at(lamps, k, min(cosine, 1.0)) / (cosine * lamps.area[k])
        for i in range(s.walk.value.size):
            sums[ray, i] += s.walk.value[i] * lamps.power[k, i] * bright


@merged
def see_surroundings(lamps, ray, s, sums):
    """Light from outside that the walk meets when it leaves the scene."""
    for k in range(lamps.kind.size):
        if lamps.kind[k] == SURROUNDINGS:
            for i in range(s.walk.value.size):
                sums[ray, i] += s.walk.value[i] * lamps.power[k, i]


@merged
def weaken(s):
    """Roulette for walks that have become weak; False where one ends."""
    walk, largest = s.walk, 0.0
    for i in range(walk.value.size):
        largest = max(largest, walk.value[i])
    if largest < WEAK:
        if uniform(walk.state) * WEAK >= largest:
            return False
        for i in range(walk.value.size):
            walk.value[i] *= WEAK / largest
    return True


@kernel
def look(scene, ray, events, direct, points, surfaces, s, sums):
    """One walk from the camera."""
    walk, shapes, media, hit = s.walk, scene.shapes, scene.media, s.hit
    x, d = walk.position, walk.direction
    accepts = (FOCUSED | SCATTERED) if direct else (DIRECT | FOCUSED | SCATTERED)
    hero = min(int(uniform(walk.state) * walk.value.size), walk.value.size - 1)
    near, last, skip, order = 0.0, np.int64(-1), np.int64(-1), 0
    for n in range(3):
        s.origin[n] = x[n]
    for _ in range(MOST_LEGS):
        m = current_medium(media, s.stack)
        if last >= 0:
            item = next_hit(shapes, s.origin, d, near, last, math.inf, hit)
        else:
            item = closest_hit(shapes, x, d, math.inf, skip, hit)
        far = hit[0] - near if item >= 0 else math.inf
        if media.first[m + 1] > media.first[m]:
            leave_events(scene, points, ray, m, hero, far, events, accepts, order, s)
            for i in range(walk.value.size):
                walk.value[i] *= s.light_through[i]
        if item < 0:
            see_surroundings(scene.lamps, ray, s, sums)
            return
        for n in range(3):
            x[n] += far * d[n]
        body = item_body(shapes, item)
        beyond = media_behind(scene, s, body)
        material = shapes.material[body]
        what = scene.materials.kind[material]
        if shapes.lamp[body] >= 0:
            see_lamp(scene.lamps, shapes.lamp[body], ray, s, sums)
        if what == INTERFACE or (what == DIELECTRIC and beyond == m):
            for n in range(s.stack.size):
                s.stack[n] = s.there[n]
            near, last = hit[0], item
            continue
        if not is_delta(scene.materials, material):
            leave_surface_point(surfaces, ray, m, beyond, body, order, accepts, s)
            return
        order += 1
        if bounce(scene, body, m, beyond, hero, False, s) == ABSORBED or not weaken(s):
            return
        near, last, skip = 0.0, np.int64(-1), item
        for n in range(3):
            s.origin[n] = x[n]


@entry
def leave_points(scene, origins, directions, ids, first, seed, stream, events, direct, points, surfaces, s, sums):
    """Walks of the rays from `first` on, until there is no more room for points.

    Parameters
    ----------
    scene : SurfaceTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers by which their random streams are told apart.
    first : int
    seed, stream : int
        Seed, and number of the pass.
    events : int
        Points on every leg through a medium.
    direct : bool
        Whether light that comes straight from lamps is found in another way.
    points, surfaces : Points
        Output: those in media, those on surfaces.
    s : PhotonScratch
    sums : (ray, wavelength)
        What is seen directly is added here: lamps, and light from outside.

    Returns
    -------
    int
        The first ray that is left over; -1 if a point is inside of more media than can be remembered.
    """
    walk = s.walk
    filled = False
    for ray in range(first, origins.shape[0]):
        if points.count[0] + events * MOST_LEGS > points.ray.size or surfaces.count[0] >= surfaces.ray.size:
            return ray
        start_stream(walk.state, seed, ids[ray], stream)
        same = filled
        for n in range(3):
            walk.position[n], walk.direction[n] = origins[ray, n], directions[ray, n]
            same = same and origins[ray, n] == origins[max(ray - 1, 0), n]
        if not same:
            if fill_stack(scene.shapes, walk.position, walk.direction, np.int64(-1), s.first, s.other_hit) < 0:
                return -1
            filled = True
        for n in range(s.stack.size):
            s.stack[n] = s.first[n]
        for i in range(walk.value.size):
            walk.value[i], walk.chance[i] = 1.0, 1.0
        look(scene, ray, events, direct, points, surfaces, s, sums)
    return origins.shape[0]
