"""All orders of scattering in three dimensions by backward random walks that carry the whole spectrum.

The camera's ray is a *leg*, and so is every flight between two scatterings.  A leg is cut into strata: half take equal
angles as seen from the star that matters most (equi-angular sampling: Kulla & Fajardo 2012, Computer Graphics
Forum 31, 1519), half equal steps.  Columns to their edges, and the guide's guess of the light there, say how much each
stratum would hand on.  From these chances come

- a few points at which the light of every star is fetched (next-event estimation), by the guess of direct light;
- the next vertex, which always lies inside the medium (forced scattering), by the guess of all light.  As the guess
  rises towards the stars, flights in their direction are stretched and others shortened: the bias towards the source
  that optically deep media need (exponential transform; Dwivedi 1982, Ann. Nucl. Energy 9, 359).

Within a stratum the point is drawn from the exponential that joins the values at both edges, where starlight is fetched
over the angle around the star.  Directions are kept from
a few candidates by phase function times a guess of the light that comes from there (`kernels.volume_turns`).

One wavelength, the hero, drives the draws and all of them count by the balance heuristic, as in `kernels.path`: there
and here F is the walk's value, P its chance under each hero, both divided by the mean chance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.gridwalk import Walker, make_walker
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.optics import phase_at, transmittance
from skyscatter.kernels.path import BATCHES, Walk, copy_sums, make_walk, rebalance, relative_noise, statistics
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.space import clip_to_space, space_densities
from skyscatter.kernels.tracking import QUADRATURE, light_reaching, watch_point
from skyscatter.kernels.volume import VolumeTable, VolumeWork, depth_at, make_volume_work
from skyscatter.kernels.volume_aims import Aim, make_aim
from skyscatter.kernels.volume_legs import (
    PLAIN,
    VolumeLeg,
    columns_to,
    draw_point,
    fly_forced,
    gather_escape,
    look_ahead,
    make_volume_leg,
    prepare_volume_leg,
)
from skyscatter.kernels.volume_turns import turn_at_vertex
from skyscatter.kernels.volume_windows import Waiting, expect, make_waiting, pass_window, promise, take_waiting

#: Strata of the camera's ray and of a leg of a walk; even numbers.
CAMERA_STRATA, LEG_STRATA = 32, 8
#: Points of a leg at which the light of the stars is fetched.
LIT_POINTS = 2
#: Walks of each batch before the noise is judged first, and before a ray may count as dark.
FIRST_WALKS, SURE_WALKS = 4, 32


@by_address
class WalkScratch(NamedTuple):
    """Scratch arrays of `volume_path_rays`."""

    work: VolumeWork
    walker: Walker  #: for tracked transmittances
    camera: VolumeLeg
    leg: VolumeLeg
    aim: Aim
    waiting: Waiting
    walk: Walk
    sums: np.ndarray  #: (batch, wavelength)
    shift: np.ndarray  #: (batch, dimension) uint32


def make_walk_scratch(components: int, wavelengths: int, lights: int, samples: int) -> WalkScratch:
    """Scratch arrays of `volume_path_rays`; a thread needs its own."""
    batches = min(samples, BATCHES)
    return WalkScratch(
        make_volume_work(components, wavelengths), make_walker(),
        make_volume_leg(CAMERA_STRATA, components, wavelengths),
        make_volume_leg(LEG_STRATA, components, wavelengths), make_aim(lights), make_waiting(wavelengths),
        make_walk(wavelengths),
        np.zeros((batches, wavelengths)), np.zeros((batches, EVEN_DIMENSIONS), np.uint32),
    )  # fmt: skip


@kernel
def fetch_light(v, hero, u, leg, work, walker, walk):
    """Light of all stars that is scattered into the leg, from a few points on it, into ``walk.gain``."""
    x, d = walk.position, walk.direction
    for i in range(walk.gain.size):
        walk.gain[i] = 0.0
    if v.power.shape[0] == 0:
        return
    for m in range(LIT_POINTS):
        t, k = draw_point(leg.light, leg.light_rim, True, leg, PLAIN, hero, (m + u) / LIT_POINTS, leg.draw)
        if k < 0:
            return
        mean = 0.0
        for i in range(walk.gain.size):
            mean += walk.chance[i] * leg.draw[i]
        mean *= LIT_POINTS / walk.gain.size
        columns_to(v, x, d, leg, k, t, work)
        transmittance(work.along, v.sigma_t, work.through)
        px, py, pz = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
        for n in range(v.power.shape[0]):
            a, b, c = light_reaching(v, n, px, py, pz, work, walker, walk)
            # Tracking leaves other densities behind.
            space_densities(v.space, px, py, pz, work.space, work.density)
            if v.tracking != QUADRATURE:
                watch_point(v, px, py, pz, work)
            phase_at(v.phase, d[0] * a + d[1] * b + d[2] * c, work.phase)
            for i in range(walk.gain.size):
                work.towards[i] = 0.0
            for j in range(work.density.size):
                for i in range(walk.gain.size):
                    work.towards[i] += work.density[j] * v.sigma_s[j, i] * work.phase[j, i]
            for i in range(walk.gain.size):
                walk.gain[i] += work.through[i] * work.towards[i] * work.arriving[i] / mean


@kernel
def go_to_vertex(v, hero, u, leg, work, walk):
    """Move the walk to its next vertex, where ``work.density`` then holds the densities; False if there is none.

    Without lights the guess has nothing to add, and over the many orders of a nearly white medium the small errors of
    a leg's strata would multiply: there the flight is exact.
    """
    x, d = walk.position, walk.direction
    if v.power.shape[0] == 0 and v.correction.shape[0] > 0:
        t, k = fly_forced(v, hero, u, leg, work, walk)
    else:
        # Light that diffuses fills what the guess does not resolve, and is followed over too many orders to lose any.
        plain = 0.0 if v.correction.shape[0] > 0 else PLAIN
        t, k = draw_point(leg.vertex, leg.vertex_rim, False, leg, plain, hero, u, leg.draw)
    if k < 0:
        return False
    columns_to(v, x, d, leg, k, t, work)
    leg.ahead[0] = look_ahead(v, x, d, leg, k, t, depth_at(v, work.along, walk.value.size // 2))
    transmittance(work.along, v.sigma_t, work.through)
    for i in range(walk.value.size):
        walk.value[i] *= work.through[i]
        walk.chance[i] *= leg.draw[i]
    for n in range(3):
        x[n] += t * d[n]
    space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
    return rebalance(walk)


@inlined
def next_number(walk, order, k):
    """Number k of the six that a leg needs: evenly spread for the first vertex and leg, from the stream later."""
    return walk.even[2 + k] if order == 1 else uniform(walk.state)


@kernel
def look_along_ray(v, hero, camera, work, walker, walk, total, by_order, apart):
    """Light that the camera's ray sees unscattered and scattered once, from a few points on it."""
    if v.glows:
        gather_escape(v, walk.position, walk.direction, np.bool_(True), walk.even[7], camera, work)
        for i in range(total.size):
            total[i] += camera.escape[i]
            apart[0, i] += camera.escape[i]
    fetch_light(v, hero, walk.even[8], camera, work, walker, walk)
    for i in range(total.size):
        total[i] += walk.gain[i]
        apart[1, i] += walk.gain[i]
        if by_order.shape[0] > 0:
            by_order[0, i] += walk.gain[i]


@kernel
def follow_leg(v, hero, order, max_order, leg, work, walker, aim, walk, total, by_order):
    """Turn a walk at its vertex, add the light along its next leg, and go to the vertex there; False at its end."""
    x, d = walk.position, walk.direction
    if not turn_at_vertex(v, next_number(walk, order, 0), next_number(walk, order, 1), work, aim, walk):
        return False
    start, end = clip_to_space(v.space, x[0], x[1], x[2], d[0], d[1], d[2])
    if end <= start:
        return False
    found = prepare_volume_leg(
        v, x, d, start, end, np.bool_(False), order == 1, next_number(walk, order, 2), leg, work
    )  # fmt: skip
    if order < max_order:
        fetch_light(v, hero, next_number(walk, order, 3), leg, work, walker, walk)
    for i in range(walk.value.size):
        unscattered = walk.value[i] * leg.escape[i]
        scattered = walk.value[i] * walk.gain[i] if order < max_order else 0.0
        total[i] += unscattered + scattered
        if order <= by_order.shape[0]:
            by_order[order - 1, i] += unscattered
        if order + 1 <= by_order.shape[0]:
            by_order[order, i] += scattered
    return found and go_to_vertex(v, hero, next_number(walk, order, 4), leg, work, walk)


@merged
def volume_wander(
    v, camera, origin, direction, walked, max_order, number, base, leg, work, walker, aim, waiting, walk, total,
    by_order, apart
):  # fmt: skip
    """Follow a walk from the camera, and all that it is split into, to the end and add up the light.

    It is the walk of that `number`, from 1 on, whose light is added to `total`; `base` is what the ray sees besides.
    """
    wavelengths = walk.value.size
    last = max_order if v.glows else max_order - 1
    hero = min(int(walk.even[0] * wavelengths), wavelengths - 1)
    for i in range(wavelengths):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    x, d = walk.position, walk.direction
    for n in range(3):
        x[n], d[n] = origin[n], direction[n]
    if walked:
        look_along_ray(v, hero, camera, work, walker, walk, total, by_order, apart)
    if max_order < 2 and not v.glows:
        return
    if not go_to_vertex(v, hero, walk.even[1], camera, work, walk):
        return
    promise(v, True, work, walk, camera.ahead[0], leg.draw)
    order, legs = 1, 0
    while order > 0:
        alive = order <= last and follow_leg(
            v, hero, order, max_order, leg, work, walker, aim, walk, total, by_order
        )  # fmt: skip
        if alive:
            order, legs = order + 1, legs + 1
            expect(number, base, total, work.promised)
            alive = pass_window(promise(v, False, work, walk, leg.ahead[0], leg.draw), legs, order, walk, waiting)
        if not alive:
            order = take_waiting(v, work, walk, waiting)


@inlined
def seen_everywhere(mean, camera):
    """Whether the walks have found light at every wavelength that is scattered along the camera's ray."""
    dark = 0
    for i in range(mean.size):
        if mean[i] == 0.0 and camera.total[1, i] > 0.0:
            dark += 1
    return dark == 0


@entry
def volume_path_rays(
    v, origins, directions, ids, base, walked, seed, samples, first, kept, noise, max_order, s, mean, error, by_order,
    apart, used,
):  # fmt: skip
    """Light of the second and higher orders along many rays, and of the first that is no light of stars.

    Parameters
    ----------
    v : VolumeTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers of the rays, by which their random streams are chosen.
    base : (ray, wavelength)
        Radiance that is known already and counts in the relative error.
    walked : bool
        Take the light that is not scattered, or once, from the walks too.
    seed : int
    samples : int
        Walks per ray, at most; a multiple of `BATCHES`, or fewer than that.
    first : int
        Walks of each batch that were made before, whose sums are in `kept`, `by_order` and `apart`.
    kept : (ray, 1, batch, wavelength)
        Sums over the walks; added to.
    noise : float
        Stop when the relative standard error is below this; 0 to use all samples.
    max_order : int
        Highest order of scattering.
    s : WalkScratch
    mean, error : (ray, wavelength), output
    by_order : (ray, order, wavelength), output
        Sum over the walks by number of scatterings, as far as there is room; order 1 without stars unless it is walked.
    apart : (ray, 2, wavelength), output
        What of that sum is not scattered, and scattered once, where these are walked.
    used : (ray,) int64, output
    """
    batches = s.sums.shape[0]
    walk = s.walk
    first_goal = samples // batches if noise <= 0.0 else min(FIRST_WALKS, samples // batches)
    for ray in range(origins.shape[0]):
        o, d = origins[ray], directions[ray]
        used[ray] = 0
        for i in range(mean.shape[1]):
            mean[ray, i], error[ray, i] = 0.0, 0.0
        start, end = clip_to_space(v.space, o[0], o[1], o[2], d[0], d[1], d[2])
        if end <= start:
            if walked:
                for i in range(mean.shape[1]):
                    mean[ray, i], apart[ray, 0, i] = v.background[i], v.background[i]
            continue
        if not prepare_volume_leg(v, o, d, start, end, np.bool_(True), True, 0.5, s.camera, s.work) and not walked:
            continue
        for b in range(batches):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                s.shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
        copy_sums(kept[ray, 0], s.sums)
        done, goal, quiet = first, max(first, first_goal), False
        while True:
            # Walk by walk over the batches: walks that are added later come after all that were made before.
            for n in range(done, goal):
                for b in range(batches):
                    start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                    even_point(s.shift[b], n, walk.even)
                    volume_wander(
                        v, s.camera, o, d, walked, max_order, n + 1, base[ray], s.leg, s.work, s.walker, s.aim,
                        s.waiting, walk, s.sums[b], by_order[ray], apart[ray]
                    )  # fmt: skip
            done = goal
            statistics(s.sums, batches, done, mean[ray], error[ray])
            # Few walks may agree by chance, and nothing found is no sign of darkness: quiet twice, and not too early.
            before = quiet
            quiet = relative_noise(error[ray], mean[ray], base[ray]) <= noise
            sure = done >= SURE_WALKS or seen_everywhere(mean[ray], s.camera)
            if done >= samples // batches or (quiet and before and sure):
                break
            goal = min(2 * done, samples // batches)
        used[ray] = done * batches
        copy_sums(s.sums, kept[ray, 0])


def scratch_of(table: VolumeTable, samples: int) -> Any:
    """Scratch arrays for a table."""
    components, wavelengths = table.sigma_s.shape
    return make_walk_scratch(components, wavelengths, len(table.power), samples)
