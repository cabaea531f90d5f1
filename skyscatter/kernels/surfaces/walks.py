"""Light along rays among surfaces, media and lamps, by backward random walks that carry the whole spectrum.

A walk goes leg by leg, each from one boundary to the next through one medium (`kernels.surfaces.flights`).  On every
leg it gathers (`kernels.surfaces.gathering`)

- the light of the lamp, or of the surroundings, that is met at its end, and what the medium itself shines, both
  dimmed by the transmittance, whether or not the walk will get there;
- the light of lamps that is scattered into the leg at one point, which is drawn by the free flight or by where the
  lamp is near (`kernels.surfaces.legs`), and at a surface that of lamps that is turned into it;

and goes on either from a vertex in the medium or from the surface behind.  The first time that there is a choice the
walk is divided and does both.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.surfaces import DIELECTRIC
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.path import BATCHES, copy_sums, statistics
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.surfaces.bsdf import is_delta
from skyscatter.kernels.surfaces.emptysky import empty_light, meets_fields
from skyscatter.kernels.surfaces.flights import (
    BEFORE,
    BEGUN,
    DIVIDED,
    FADED,
    IN,
    ITEM,
    KNOWN,
    LAST,
    LENGTH,
    MOST,
    MOST_SPLITS,
    NEAR,
    ORDER,
    SCALE,
    SKIP,
    SPLITS,
    STRAIGHT,
    VERTEX,
    WHOLE,
    draw_vertex,
    measure_leg,
    weigh_vertex,
)
from skyscatter.kernels.surfaces.gathering import (
    ANGULAR,
    NO_AIM,
    REFLECTED_ONCE,
    SCATTERED,
    Sums,
    add_light,
    glow,
    light_end,
    light_leg,
    light_surface,
    number,
)
from skyscatter.kernels.surfaces.media import current_medium
from skyscatter.kernels.surfaces.mosaics import tile
from skyscatter.kernels.surfaces.rays import closest_hit, fill_stack, next_hit
from skyscatter.kernels.surfaces.shadows import copy_stack, cross, passes
from skyscatter.kernels.surfaces.shapes import item_body
from skyscatter.kernels.surfaces.splits import next_part
from skyscatter.kernels.surfaces.turns import BEHIND, LEG, OVER, TURN, balance, scatter_at, turn_at_surface
from skyscatter.kernels.surfaces.walkpolar import begin, end_sums, keep_part, see_sky, take_part, take_up_sums

#: Walks of each batch before the noise is judged first, and before a ray may count as quiet.
FIRST_WALKS, SURE_WALKS = 4, 32
#: What a leg loses where it counts as thin.
THIN = 0.1


@inlined
def noise_of(error, mean):
    """Relative standard error, averaged over wavelengths where there is light."""
    noise, n = 0.0, 0
    for i in range(mean.size):
        if mean[i] > 0.0:
            noise += error[i] / mean[i]
            n += 1
    return noise / max(n, 1)


@merged
def find_leg(table, s):
    """The next leg of the ray: where it begins and ends, in which medium, and what it lets through."""
    x, d, hit, at, media = s.walk.position, s.walk.direction, s.hit, s.at, table.media
    if at[ITEM] < 0:
        s.far[NEAR] = 0.0
        at[ITEM] = closest_hit(table.shapes, x, d, math.inf, at[SKIP], hit)
    else:
        s.far[NEAR] = hit[0]
        at[ITEM] = next_hit(table.shapes, x, d, s.far[NEAR], at[ITEM], math.inf, hit)
    if at[ITEM] < 0:
        hit[0] = math.inf
    s.far[LENGTH] = hit[0] - s.far[NEAR]
    m = current_medium(media, s.stack)
    at[IN] = m
    for n in range(3):
        s.start[n] = x[n] + s.far[NEAR] * d[n]
    if media.first[m + 1] > media.first[m]:
        measure_leg(media, m, s.start, d, s.far[LENGTH], s)
    else:
        for i in range(s.through.size):
            s.through[i], s.lost[i] = 1.0, 0.0


@inlined
def divide(s):
    """Remember the ray, so that the walk goes on from what lies behind when it has ended."""
    s.at[WHOLE], s.at[DIVIDED] = 0, 1
    copy_stack(s.stack, s.saved_stack)
    for n in range(4):
        s.saved_hit[n] = s.hit[n]
    for n in range(3):
        s.saved[0, n], s.saved[1, n] = s.walk.position[n], s.walk.direction[n]
    s.saved[2, 0], s.saved[2, 1], s.saved[2, 2] = s.at[ITEM], s.at[KNOWN], s.at[ORDER]
    keep_part(s.polar, MOST_SPLITS)
    for i in range(s.through.size):
        s.saved_value[i] = s.walk.value[i] * s.through[i]
        s.saved_chance[i] = s.walk.chance[i]


@inlined
def go_back(s):
    """Take up the other part of a divided walk."""
    s.at[DIVIDED], s.at[BEFORE], s.at[STRAIGHT], s.far[FADED] = 0, NO_AIM, 1, 1.0
    s.at[ITEM], s.at[KNOWN], s.at[ORDER] = np.int64(s.saved[2, 0]), np.int64(s.saved[2, 1]), np.int64(s.saved[2, 2])
    s.at[LAST] = SCATTERED if s.at[ORDER] == 0 else REFLECTED_ONCE
    take_part(s.polar, MOST_SPLITS)
    copy_stack(s.saved_stack, s.stack)
    for n in range(4):
        s.hit[n] = s.saved_hit[n]
    for n in range(3):
        s.walk.position[n], s.walk.direction[n] = s.saved[0, n], s.saved[1, n]
    for i in range(s.through.size):
        s.walk.value[i], s.walk.chance[i] = s.saved_value[i], s.saved_chance[i]


@kernel
def choose_end(table, hero, s):
    """Which end of the leg the walk goes to: TURN or BEHIND; in ``s.event`` the chances of the first."""
    walk, media, m = s.walk, table.media, s.at[IN]
    lossy = 0.0
    for i in range(s.lost.size):
        lossy += s.lost[i] / s.lost.size
    # Whether it is divided must not depend on the hero.  Behind mirrors it is where hardly any would be scattered.
    first = s.at[WHOLE] == 1 and s.at[ORDER] == 0
    both = lossy > 0.0 and (first or (s.at[STRAIGHT] == 1 and lossy < THIN))
    coming = BEHIND
    if both:
        for i in range(s.event.size):
            s.event[i] = 1.0
        coming = TURN
    else:
        row = table.shapes.material[item_body(table.shapes, s.at[ITEM])] if s.at[ITEM] >= 0 else np.int64(-1)
        weigh_vertex(media, table.materials, m, row, s.media.along, s.lost, s.through, s.event)
        if uniform(walk.state) < s.event[hero]:
            coming = TURN
    s.far[VERTEX] = -1.0
    if coming == TURN or not media.constant[m]:
        u = number(walk, s.at[ORDER], 5)
        s.far[VERTEX] = draw_vertex(table, m, hero, s.start, walk.direction, s.far[LENGTH], u, s)
    if both:
        divide(s)
    return coming


@inlined
def add_known(factor, s, sums):
    """Add light of the empty sky in ``s.factor`` (wavelength,) times a factor."""
    for i in range(s.factor.size):
        s.factor[i] *= s.walk.value[i]
    add_light(s.polar, s.factor, factor, s.at[ORDER], s.at[LAST], sums)


@kernel
def leave_sky(sky, body, s, sums):
    """Take off what lies behind the body that the walk has come to, if it is counted: from here all light is new."""
    if sky is not None and s.at[KNOWN] == 1 and (body != 0 or sky.ground == 0):
        s.at[KNOWN] = 0
        for n in range(3):
            s.place[n] = s.walk.position[n] + s.hit[0] * s.walk.direction[n]
        empty_light(sky, s.place, s.walk.direction, s.joined, s.factor)
        see_sky(s.polar, sky, s.place, s.walk.direction, s.joined, s.walk.value, s.factor)
        add_known(-1.0, s, sums)


@kernel
def enter_sky(table, sky, s, sums):
    """Add what the next leg sees of the empty sky where that is not counted, or take it off on a leg through clouds.

    False where all that shines at the leg's end is known.
    """
    walk, before = s.walk, s.at[KNOWN] == 1
    if sky is None or s.at[IN] != 0:
        return True
    d, body = walk.direction, item_body(table.shapes, s.at[ITEM]) if s.at[ITEM] >= 0 else np.int64(0)
    cloudy = meets_fields(sky, table.media, s.media.along)
    s.at[KNOWN] = 0 if cloudy else 1
    if cloudy == before:
        if not cloudy and body == 0 and s.at[ORDER] == 0 and s.far[NEAR] == 0.0 and sums.seen.size > 0:
            for i in range(s.factor.size):
                s.factor[i] = sums.seen[i]
        else:
            empty_light(sky, s.start, d, s.joined, s.factor)
            see_sky(s.polar, sky, s.start, d, s.joined, walk.value, s.factor)
        add_known(-1.0 if cloudy else 1.0, s, sums)
    return not before or cloudy or body != 0 or table.guide.open


@kernel
def take_leg(table, hero, sampling, s, sums):
    """Gather the light of the next leg and choose its end."""
    walk = s.walk
    find_leg(table, s)
    if enter_sky(table, table.sky, s, sums):
        light_end(table, sampling, s, sums)
    scatters = table.guide.scatters[s.at[IN]] and s.at[ORDER] < s.at[MOST]
    coming = choose_end(table, hero, s) if scatters else BEHIND
    if table.guide.shines[s.at[IN]]:
        glow(table, s, sums)
    if scatters:
        points = table.guide.points if s.at[ORDER] == 0 else 1
        for n in range(points if sampling != ANGULAR else 0):
            if light_leg(table, hero, sampling, n == 0, s):
                add_light(s.polar, s.light, 1.0 / points, s.at[ORDER] + 1, SCATTERED, sums)
        if coming == TURN:
            return TURN if s.far[VERTEX] >= 0.0 else OVER
        for i in range(walk.chance.size):
            walk.chance[i] *= 1.0 - s.event[i]
    for i in range(walk.value.size):
        walk.value[i] *= s.through[i]
    return BEHIND


@kernel
def meet(table, hero, sampling, s, sums):
    """What happens behind the leg; LEG, or OVER if the walk ends."""
    walk, shapes, at, hit, d = s.walk, table.shapes, s.at, s.hit, s.walk.direction
    if at[ITEM] < 0:
        return OVER
    mean = balance(walk)
    if not mean > 0.0:
        return OVER
    s.far[SCALE] /= mean
    body = item_body(shapes, at[ITEM])
    row = shapes.material[body]
    leave_sky(table.sky, body, s, sums)
    copy_stack(s.stack, s.other_stack)
    cross(shapes, body, d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3] < 0.0, s.other_stack)
    here, there = current_medium(table.media, s.stack), current_medium(table.media, s.other_stack)
    if passes(table.materials.kind[row], here, there):
        copy_stack(s.other_stack, s.stack)
        return LEG
    if at[ORDER] >= at[MOST]:
        return OVER
    facing = 1.0 if d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3] < 0.0 else -1.0
    for n in range(3):
        walk.position[n] += hit[0] * d[n]
        s.back[n], s.normal[n] = -d[n], hit[1 + n]
        s.kept[0, n], s.kept[1, n] = walk.position[n], facing * hit[1 + n]
    row = tile(table.materials, row, walk.position)
    delta = is_delta(table.materials, row)
    both_sides = table.materials.kind[row] == DIELECTRIC
    s.kept[2, 0] = 1.0 if both_sides else 0.0
    if sampling != ANGULAR and not delta and light_surface(table, row, both_sides, here, there, sampling, s):
        add_light(s.polar, s.light, 1.0, at[ORDER] + 1, REFLECTED_ONCE, sums)
    return turn_at_surface(table, row, hero, here, there, s)


@merged
def wander(table, max_order, sampling, s, sums):
    """Follow a walk from the camera to its end, and add up its light."""
    walk, at = s.walk, s.at
    wavelengths = walk.value.size
    hero = min(int(walk.even[0] * wavelengths), wavelengths - 1)
    for i in range(wavelengths):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    at[ORDER], at[LAST], at[BEFORE], at[ITEM], at[SKIP] = 0, SCATTERED, NO_AIM, -1, -1
    at[DIVIDED], at[WHOLE], at[MOST] = 0, 1, max_order
    at[SPLITS], at[KNOWN] = 0, 0
    s.at[STRAIGHT] = 1
    s.far[SCALE], s.far[BEGUN], s.far[FADED] = 1.0, 0.0, 1.0
    coming, part = LEG, False
    while True:
        if coming == LEG:
            coming = take_leg(table, hero, sampling, s, sums)
        elif coming == TURN:
            coming, part = scatter_at(table, hero, part, s), False
        elif coming == BEHIND:
            coming = meet(table, hero, sampling, s, sums)
        elif at[SPLITS] > 0:
            next_part(s)
            coming, part = TURN, True
        elif at[DIVIDED] == 1:
            go_back(s)
            coming = BEHIND
        else:
            return


@merged
def walk_once(table, origin, direction, max_order, sampling, s, sums):
    """One walk along a ray; its numbers have been drawn and ``s.saved_stack`` told from where it starts."""
    for n in range(3):
        s.walk.position[n], s.walk.direction[n] = origin[n], direction[n]
    wander(table, max_order, sampling, s, sums)


@entry
def surface_path_rays(
    table, origins, directions, ids, seen, seed, samples, first, kept, noise, max_order, sampling, s, mean, error,
    by_order, apart, used,
):  # fmt: skip
    """Light of all orders along many rays.

    Parameters
    ----------
    table : WalkTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers of the rays, by which their random streams are chosen.
    seen : (ray, wavelength)
        Diffuse light that they would see in the empty sky; without wavelengths where it is not told.
    seed : int
    samples : int
        Walks per ray, at most; a multiple of `BATCHES`, or fewer than that.
    first : int
        Walks of each batch that were made before, whose sums are in `kept`, `by_order` and `apart`.
    kept : (ray, 1, batch, wavelength)
        Sums over the walks, of polarised light those of Q, U and V as well (ray, 4, ...); added to.
    noise : float
        Stop when the relative standard error is below this; 0 to use all samples.
    max_order : int
        Highest number of interactions.
    sampling : int
        BOTH, AREA or ANGULAR.
    s : Scratch
        With ``s.polar``, its output too where polarisation is asked for; `mean` then is that of polarised light.
    mean, error : (ray, wavelength), output
    by_order : (ray, order, wavelength), output
        Sum over the walks by number of interactions from 1 on, as far as there is room.
    apart : (ray, 3, wavelength), output
        What of that sum comes straight, was scattered once by a medium, or turned once by a surface.
    used : (ray,) int64, output
        Walks; -1 where a ray starts inside of more media than a stack holds.
    """
    batches, walk = s.sums.shape[0], s.walk
    first_goal = samples // batches if noise <= 0.0 else min(FIRST_WALKS, samples // batches)
    for ray in range(origins.shape[0]):
        for i in range(mean.shape[1]):
            mean[ray, i], error[ray, i] = 0.0, 0.0
        used[ray] = -1
        if fill_stack(table.shapes, origins[ray], directions[ray], np.int64(-1), s.first_stack, s.hit) < 0:
            continue
        for b in range(batches):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                s.shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
        copy_sums(kept[ray, 0], s.sums)
        take_up_sums(s.polar, kept[ray])
        done, goal, quiet = first, max(first, first_goal), False
        while True:
            # Walk by walk over the batches: walks that are added later come after all that were made before.
            for n in range(done, goal):
                for b in range(batches):
                    sums = Sums(s.sums[b], by_order[ray], apart[ray], seen[ray])
                    start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                    even_point(s.shift[b], n, walk.even)
                    copy_stack(s.first_stack, s.stack)
                    begin(s.polar, ray, b)
                    walk_once(table, origins[ray], directions[ray], max_order, sampling, s, sums)
            done = goal
            statistics(s.sums, batches, done, mean[ray], error[ray])
            # Few walks may agree by chance, and nothing found is no sign of darkness: quiet twice, and not too early.
            before = quiet
            quiet = noise_of(error[ray], mean[ray]) <= noise
            if done >= samples // batches or (quiet and before and done >= SURE_WALKS):
                break
            goal = min(2 * done, samples // batches)
        used[ray] = done * batches
        copy_sums(s.sums, kept[ray, 0])
        end_sums(s.polar, ray, batches, done, kept[ray])
