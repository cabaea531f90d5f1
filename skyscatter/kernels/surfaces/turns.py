"""Turns of camera walks: at a vertex in a medium, at a surface; and the roulette that follows."""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.surfaces import ABSORBED, DELTA, DIELECTRIC, REFLECTED, TRANSMITTED
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.random import keeps, uniform
from skyscatter.kernels.surfaces.bsdf import evaluate_bsdf, is_delta, sample_bsdf
from skyscatter.kernels.surfaces.emptysky import middle_light
from skyscatter.kernels.surfaces.flights import (
    BEFORE,
    FADED,
    IN,
    ITEM,
    KNOWN,
    LAST,
    LENGTH,
    NEARBY,
    OFTEN,
    ORDER,
    SCALE,
    SKIP,
    STRAIGHT,
    VERTEX,
    look_at,
)
from skyscatter.kernels.surfaces.gathering import MEDIUM, NO_AIM, REFLECTED_ONCE, SCATTERED, SURFACE, number
from skyscatter.kernels.surfaces.lamps import pick
from skyscatter.kernels.surfaces.media import scattering
from skyscatter.kernels.surfaces.past import PASSING, density_past, draw_direction, draw_past, shares_from_wall
from skyscatter.kernels.surfaces.shadows import copy_stack
from skyscatter.kernels.surfaces.splits import split, wanted_weight
from skyscatter.kernels.surfaces.walkpolar import scattering_terms, surface_terms, turn_walk

#: From these orders on at most these shares of the walks go on, whatever they carry: none is endless.
LONG, LONG_SHARE, ENDLESS, ENDLESS_SHARE = 128, 0.99, 1024, 0.9
#: How much more a walk is worth where a lamp fills all of the view.
CLOSE_WORTH = 100.0
#: Of walks that are scattered for the first time at least this share goes on, however thin the medium is: where nothing
#: else is seen, or what else is seen is dark, theirs is all the light.  From there on roulette begins lower.
FIRST_SHARE = 0.1
#: Candidates for directions that surfaces turn light to under a known sky, and the golden ratio less 1.
LIT_CANDIDATES, GOLDEN = 8, 0.6180339887498949
#: What counts for a direction beside the light that is known to come from there, in parts of what is typical.
LIT_MORE = 0.1
#: What comes next: a leg, a vertex in the medium, what lies behind the leg, nothing.
LEG, TURN, BEHIND, OVER = 0, 1, 2, 3


@inlined
def balance(walk):
    """Divide value and chances by the mean chance, which is returned; 0 when the walk is worth nothing."""
    mean = 0.0
    for i in range(walk.chance.size):
        mean += walk.chance[i]
    mean /= walk.chance.size
    if mean > 0.0:
        scale = 1.0 / mean
        for i in range(walk.chance.size):
            walk.chance[i] *= scale
            walk.value[i] *= scale
    return mean


@inlined
def brightest(walk):
    """The largest of the walk's values."""
    largest = 0.0
    for i in range(walk.value.size):
        largest = max(largest, walk.value[i])
    return largest


@inlined
def survives(walk, order, level):
    """Russian roulette; survivors carry the weight of the fallen."""
    q = min(brightest(walk) / level, 1.0) if level > 0.0 else 1.0
    if order >= LONG:
        q = min(q, LONG_SHARE if order < ENDLESS else ENDLESS_SHARE)
    if q < 1.0:
        if not uniform(walk.state) < q:
            return False
        for i in range(walk.value.size):
            walk.value[i] /= q
    return True


@kernel
def scatter_at(table, hero, part, s):
    """Move to the vertex on the leg and turn there; LEG, or OVER if the walk ends.

    A `part` of a walk is not split again there.
    """
    walk, d, m, t = s.walk, s.walk.direction, s.at[IN], s.far[VERTEX]
    look_at(table, m, s.start, d, s.far[LENGTH], t, s)
    for n in range(3):
        s.kept[0, n], s.kept[1, n] = s.start[n], d[n]
        walk.position[n] = s.start[n] + t * d[n]
    s.kept[2, 0], s.kept[2, 1], s.kept[2, 2] = m, t, s.far[LENGTH]
    order = s.at[ORDER]
    wanted = wanted_weight(table, m, walk.position, s)
    # Parts have numbers of their own.
    apart = part or split(wanted, s)
    u, v = number(walk, 1 if apart else order, 6), number(walk, 1 if apart else order, 7)
    turned, past = draw_direction(table, m, hero, walk.position, u, v, s, d)
    if not turned:
        return OVER
    passing = density_past(table, m, walk.position, d, s.chance, True, s.aside) if past > 0.0 else 0.0
    cosine = d[0] * s.kept[1, 0] + d[1] * s.kept[1, 1] + d[2] * s.kept[1, 2]
    towards, total, more = s.media.towards, s.media.total, 1.0
    scattering(table.media, m, s.media.density, cosine, s.media, towards)
    scattering_terms(s.polar, table.media, m, s.media.density, cosine)
    turn_walk(s.polar, s.kept[1, 0], s.kept[1, 1], s.kept[1, 2], d)
    for i in range(walk.value.size):
        s.kept_chance[i], s.kept_free[i] = walk.chance[i], walk.chance[i] * s.free[i]
        by_phase = towards[i] / total[i] if total[i] > 0.0 else 0.0
        s.kept_phase[i] = by_phase
        walk.value[i] *= s.halfway[i] * towards[i]
        by_all = (1.0 - past) * by_phase + passing
        walk.chance[i] *= s.free[i] * s.event[i] * by_all
        if i == hero and table.guide.placed:
            more = worth_of(by_all, by_phase, passing) * max(s.far[OFTEN], 1.0)
    more = max(more * (1.0 + CLOSE_WORTH * s.far[NEARBY]), 1.0 / wanted)
    mean = balance(walk)
    if s.at[STRAIGHT] == 1:
        s.far[FADED] = min(brightest(walk) / (FIRST_SHARE * table.guide.level), 1.0)
    s.at[STRAIGHT] = 0
    s.at[ORDER], s.at[LAST], s.at[BEFORE] = order + 1, SCATTERED, MEDIUM
    s.at[ITEM], s.at[SKIP] = -1, -1
    if not mean > 0.0:
        return OVER
    s.far[SCALE] = 1.0 / mean
    return LEG if survives(walk, order + 1, s.far[FADED] * table.guide.level / more) else OVER


@inlined
def worth_of(drawn, plain, passing):
    """How much more a walk is worth for its direction: roulette begins that much lower.

    Else it would make of many dim walks a few bright ones just before they are lit.  A direction is worth as much more
    as it is drawn more often than by what scatters alone, or as it is brighter for the lamps that it passes, however
    it was drawn: a sharp peak goes on to a lamp by itself.
    """
    often = drawn / plain if plain > 0.0 else 1.0
    return max(often, 4.0 * math.pi * passing / PASSING, 1.0)


@merged
def leave_towards(table, row, here, there, s):
    """What a surface does to light that leaves it in the walk's direction, as `sample_bsdf` tells it."""
    d, n, media = s.walk.direction, s.kept[1], table.media
    if not n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0.0:
        return ABSORBED
    evaluate_bsdf(
        table.materials, row, s.normal, s.back, d, media.index[here], media.index[there], np.bool_(False), s.factor,
        s.density,
    )  # fmt: skip
    return REFLECTED


@kernel
def choose_lit(table, sky, row, hero, here, there, past, u, v, s):
    """A direction in which a surface turns light, from a few candidates by the known light that comes from there.

    The share `past` of them is drawn around lamps.  What the choice favours the value is divided by (importance
    resampling: Talbot, Cline & Egbert 2005, Eurographics Symposium on Rendering).
    """
    if sky is None:
        return ABSORBED
    walk, media, d, q = s.walk, table.media, s.walk.direction, s.factor.size // 2
    total, kept, w = 0.0, 0.0, uniform(walk.state)
    for n in range(LIT_CANDIDATES):
        z, turn = (n + u) / LIT_CANDIDATES, (v + n * GOLDEN) % 1.0
        if z < past:
            draw_past(table, here, pick(s.chance, z / past), walk.position, False, uniform(walk.state), turn, d)
        else:
            event = sample_bsdf(
                table.materials, row, hero, s.normal, s.back, (z - past) / (1.0 - past), turn, uniform(walk.state),
                uniform(walk.state), uniform(walk.state), media.index[here], media.index[there], media.dispersive[here],
                np.bool_(False), d, s.factor, s.density,
            )  # fmt: skip
            if event == ABSORBED:
                continue
        if leave_towards(table, row, here, there, s) == ABSORBED:
            continue
        passing = density_past(table, here, walk.position, d, s.chance, False, s.aside) if past > 0.0 else 0.0
        density = (1.0 - past) * s.density[hero] + passing
        light = middle_light(sky, walk.position, d) + LIT_MORE * sky.typical
        bright = s.factor[q] * light / density if density > 0.0 else 0.0
        total += bright
        keep, w = keeps(w, bright, total)
        if keep:
            kept = bright
            for k in range(3):
                s.place[k] = d[k]
    if not kept > 0.0:
        return ABSORBED
    for i in range(walk.value.size):
        walk.value[i] *= total / (LIT_CANDIDATES * kept)
    for k in range(3):
        d[k] = s.place[k]
    return leave_towards(table, row, here, there, s)


@merged
def turn_at_surface(table, row, hero, here, there, s):
    """Turn where a surface was met; LEG, or OVER if the walk ends."""
    walk, media, order = s.walk, table.media, s.at[ORDER]
    u, v = number(walk, order, 8), number(walk, order, 9)
    dispersive = media.dispersive[here] or media.dispersive[there]
    one_side = not is_delta(table.materials, row) and table.materials.kind[row] != DIELECTRIC
    past = shares_from_wall(table, here, walk.position, s.kept[1], s) if one_side else 0.0
    choice = uniform(walk.state) if past > 0.0 else 1.0
    if one_side and s.at[KNOWN] == 0 and table.sky is not None:
        event = choose_lit(table, table.sky, row, hero, here, there, past, u, v, s)
    elif choice < past:
        draw_past(table, here, pick(s.chance, choice), walk.position, False, u, v, walk.direction)
        event = leave_towards(table, row, here, there, s)
    else:
        event = sample_bsdf(
            table.materials, row, hero, s.normal, s.back, u, v, uniform(walk.state), uniform(walk.state),
            uniform(walk.state), media.index[here], media.index[there], dispersive, np.bool_(False), walk.direction,
            s.factor, s.density,
        )  # fmt: skip
    if event == ABSORBED:
        return OVER
    surface_terms(
        s.polar, table.materials, row, s.normal, s.back, walk.direction, s.factor, media.index[here], media.index[there]
    )
    turn_walk(s.polar, -s.back[0], -s.back[1], -s.back[2], walk.direction)
    passing = density_past(table, here, walk.position, walk.direction, s.chance, False, s.aside) if past > 0.0 else 0.0
    more = worth_of((1.0 - past) * s.density[hero] + passing, s.density[hero], passing)
    more = max(more, 1.0 / wanted_weight(table, here, walk.position, s))
    for i in range(walk.value.size):
        s.kept_chance[i] = walk.chance[i]
        walk.value[i] *= s.factor[i]
        walk.chance[i] *= (1.0 - past) * s.density[i] + passing
    mean = balance(walk)
    s.at[ORDER], s.at[LAST] = order + 1, REFLECTED_ONCE
    s.at[BEFORE] = NO_AIM if event & DELTA else SURFACE
    s.at[STRAIGHT] = s.at[STRAIGHT] if event & DELTA else 0
    s.at[SKIP] = s.at[ITEM]
    s.at[ITEM] = -1
    if event & TRANSMITTED:
        copy_stack(s.other_stack, s.stack)
    if not mean > 0.0:
        return OVER
    s.far[SCALE] = 1.0 / mean
    return LEG if survives(walk, order + 1, s.far[FADED] * table.guide.level / more) else OVER
