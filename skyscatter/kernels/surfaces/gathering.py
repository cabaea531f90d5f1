"""The light that a leg of a camera walk gathers.

Lamps with a surface are found in two ways, by aiming at them and by meeting them.  Both are weighed by the balance
heuristic over all heroes and both ways (Veach & Guibas 1995, SIGGRAPH 95, 419; Wilkie et al. 2014, Computer Graphics
Forum 33, 123): with F the walk's value and P_h its chance under hero h, divided by its mean,

    F f L / mean over h of (P_h aimed_h + P_h met_h).

On a leg aiming draws a point of its own, so the densities of that point and of the walk's vertex count too.  What a
walk that meets a lamp could have done instead is kept in ``Scratch.kept``: of a surface the place, the normal, and in
the third row whether light passes through; of a leg its start, its direction, and its medium, the distance of the
vertex, and its length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import DIELECTRIC, INTERFACE, SURFACE_LAMP
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.random import uniform
from skyscatter.kernels.surfaces.bsdf import evaluate_bsdf
from skyscatter.kernels.surfaces.emptysky import EmptySky, changed_starlight
from skyscatter.kernels.surfaces.flights import (
    BEFORE,
    IN,
    ITEM,
    LAST,
    LENGTH,
    ORDER,
    SCALE,
    VERTEX,
    draw_vertex,
    gather_emission,
    look_at,
)
from skyscatter.kernels.surfaces.lamps import (
    LampGuide,
    add_around,
    aim,
    around_density,
    brightness,
    disk_light,
    guess_at_point,
    meeting_density,
    pick,
    shade,
)
from skyscatter.kernels.surfaces.legs import aim_on_leg, density_on_leg, draw_on_leg, guess_on_leg
from skyscatter.kernels.surfaces.media import draw_scattered, scattering
from skyscatter.kernels.surfaces.past import density_past, shares_from_wall, shares_past
from skyscatter.kernels.surfaces.rays import closest_hit, next_hit
from skyscatter.kernels.surfaces.shadows import reaches
from skyscatter.kernels.surfaces.shapes import item_body
from skyscatter.kernels.surfaces.tables import (
    LampTable,
    MaterialTable,
    MediaTable,
    ShapeTable,
)
from skyscatter.kernels.surfaces.walkpolar import (
    add_polarised,
    scattering_terms,
    see_plain,
    see_turned,
    surface_terms,
)

#: How lamps with a surface are found: both ways, only by aiming at them, only by meeting them.
BOTH, AREA, ANGULAR = 0, 1, 2
#: What the vertex before was: one from which no lamp can be aimed at, one on a surface, one in a medium.
NO_AIM, SURFACE, MEDIUM = 0, 1, 2
#: Largest share of the rays from points on legs that are not aimed at a lamp.
MET = 0.5
#: Parts of the light: straight from where it shines, scattered once by a medium, once by a surface.
DIRECT, SCATTERED, REFLECTED_ONCE = 0, 1, 2


@by_address
class WalkTable(NamedTuple):
    """A scene with surfaces, and where its light is, roughly."""

    shapes: ShapeTable
    materials: MaterialTable
    media: MediaTable
    lamps: LampTable
    guide: LampGuide
    sky: EmptySky | None  #: light that is known where nothing but air is met; None where none is


class Sums(NamedTuple):
    """Where light is added up."""

    total: np.ndarray  #: (wavelength,)
    by_order: np.ndarray  #: (order, wavelength) by the number of interactions, from 1 on, as far as there is room
    apart: np.ndarray  #: (3, wavelength) the parts that are not multiply scattered
    seen: np.ndarray  #: (wavelength,) light of the empty sky along the camera's ray; empty where it is not told


@inlined
def number(walk, order, k):
    """Number k of the walk: evenly spread as long as it was not scattered, from the stream later."""
    return walk.even[k] if order == 0 else uniform(walk.state)


@kernel
def add_light(polar, light, factor, order, last, sums):
    """Add light (wavelength,) times a factor after so many interactions, the last of which was a `last`."""
    add_polarised(polar, factor)
    for i in range(light.size):
        sums.total[i] += factor * light[i]
    if 0 < order <= sums.by_order.shape[0]:
        for i in range(light.size):
            sums.by_order[order - 1, i] += factor * light[i]
    if order <= 1:
        part = DIRECT if order == 0 else last
        for i in range(light.size):
            sums.apart[part, i] += factor * light[i]


@kernel
def meeting_weight(table, k, cosine, s):
    """Mean over heroes of the chances of both ways in which lamp k could have been found, over those of the walk."""
    walk, lamps, guide, kept = s.walk, table.lamps, table.guide, s.kept
    # The ray may have passed boundaries since the vertex: its length counts from there, where its start is.
    if k == lamps.mapped:
        density = around_density(lamps, walk.direction)
    else:
        density = meeting_density(table.shapes, lamps, k, s.at[ITEM], walk.position, s.hit[0], cosine)
    if s.at[BEFORE] == SURFACE:
        guess_at_point(lamps, guide, kept[0], kept[1], kept[2, 0] > 0.0, s.chance)
        first, second, met = s.chance[k] * s.far[SCALE], 0.0, 0.0
    else:
        m, t, far = np.int64(kept[2, 0]), kept[2, 1], kept[2, 2]
        guess_on_leg(lamps, guide, m, kept[0], kept[1], far, s.chance)
        _, along, height, low, high = aim_on_leg(lamps, guide, m, k, kept[0], kept[1], far)
        near = table.guide.near if high > low else 0.0
        for n in range(3):
            s.place[n] = kept[0, n] + t * kept[1, n]
        met = share_met(guide, k, s.place)
        weight = s.chance[k] * s.far[SCALE]
        first = weight * near * density_on_leg(guide.gathered[m], along, height, low, high, t)
        second = weight * (1.0 - near)
    mean = 0.0
    for i in range(walk.chance.size):
        aimed = first * s.kept_chance[i] + second * s.kept_free[i]
        mean += walk.chance[i] + aimed * ((1.0 - met) * density + met * s.kept_phase[i])
    return mean / walk.chance.size


@inlined
def share_met(guide, k, x):
    """Share of the rays to lamp k from a point in a medium that go where it scatters to, and may meet the lamp.

    Half where the lamp is near for its size: points drawn on it would count by one over the square of their distance.
    """
    p = guide.middle[k]
    square = (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2
    return MET * min(guide.size[k] * guide.size[k] / max(square, 1e-300), 1.0) ** 2


@kernel
def lamp_ahead(table, k, x, d, s):
    """What of lamp k a ray from x in direction d meets first, as `aim` tells it; whether it gets there is not asked."""
    shapes, hit = table.shapes, s.shadow_hit
    item = closest_hit(shapes, x, d, math.inf, np.int64(-1), hit)
    while item >= 0:
        body = item_body(shapes, item)
        if shapes.lamp[body] == k:
            cosine = -(d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3])
            density = meeting_density(shapes, table.lamps, k, item, x, hit[0], cosine)
            return hit[0], item, density, brightness(table.lamps, k, cosine)
        kind = table.materials.kind[shapes.material[body]]
        if kind != INTERFACE and kind != DIELECTRIC:
            break
        item = next_hit(shapes, x, d, hit[0], item, math.inf, hit)
    return math.inf, np.int64(-1), 0.0, 0.0


@merged
def place_on_leg(table, m, k, hero, first, s):
    """A distance on the leg at which lamp k is looked for, into ``s.place`` the point; how it was drawn.

    Returns the distance, negative if there is none, and of draws by where the lamp is near the share and the density.
    """
    walk, d, far, order = s.walk, s.walk.direction, s.far[LENGTH], s.at[ORDER]
    _, along, height, low, high = aim_on_leg(table.lamps, table.guide, m, k, s.start, d, far)
    near = table.guide.near if high > low else 0.0
    u = number(walk, order, 1) if first else uniform(walk.state)
    if u < near:
        t = draw_on_leg(table.guide.gathered[m], along, height, low, high, u / near)
        t = min(max(t, 0.0), far)
    elif table.media.constant[m]:
        t = draw_vertex(table, m, hero, s.start, d, far, (u - near) / (1.0 - near), s)
    else:
        t = s.far[VERTEX]
    if not 0.0 <= t < math.inf:
        return -1.0, 0.0, 0.0
    for n in range(3):
        s.place[n] = s.start[n] + t * d[n]
    return t, near, near * density_on_leg(table.guide.gathered[m], along, height, low, high, t)


@inlined
def arrives(table, sky, k, x, distance, skip, goal, stack, s):
    """`reaches` for light of lamp k along ``s.aside``; of a star that is counted already what has changed of it."""
    reached = reaches(table, x, s.aside, distance, skip, goal, stack, s)
    return changed_starlight(sky, table.media, k, x, s.aside, reached, s)


@kernel
def light_leg(table, hero, sampling, first, s):
    """Light of a lamp that is scattered into the leg, into ``s.light`` (wavelength,); False if there is none.

    Only the `first` of several draws on a leg takes evenly spread numbers.
    """
    media, lamps, walk, d = table.media, table.lamps, s.walk, s.walk.direction
    m, order = s.at[IN], s.at[ORDER]
    guess_on_leg(lamps, table.guide, m, s.start, d, s.far[LENGTH], s.chance)
    k = pick(s.chance, number(walk, order, 2) if first else uniform(walk.state))
    if k < 0:
        return False
    t, near, drawn = place_on_leg(table, m, k, hero, first, s)
    if t < 0.0:
        return False
    u, v = (number(walk, order, 3), number(walk, order, 4)) if first else (uniform(walk.state), uniform(walk.state))
    near_by = share_met(table.guide, k, s.place) if sampling == BOTH and lamps.kind[k] == SURFACE_LAMP else 0.0
    if near_by > 0.0 and uniform(walk.state) < near_by:
        look_at(table, m, s.start, d, s.far[LENGTH], t, s)
        for n in range(3):
            s.aside[n] = d[n]
        if not draw_scattered(media, m, hero, u, v, s.media, s.aside):
            return False
        distance, goal, density, light = lamp_ahead(table, k, s.place, s.aside, s)
    else:
        distance, goal, density, light = aim(table.shapes, lamps, k, s.place, u, v, s.aside, s.point)
    if not light > 0.0 or not arrives(table, table.sky, k, s.place, distance, np.int64(-1), goal, s.stack, s):
        return False
    look_at(table, m, s.start, d, s.far[LENGTH], t, s)
    cosine = d[0] * s.aside[0] + d[1] * s.aside[1] + d[2] * s.aside[2]
    towards, total = s.media.towards, s.media.total
    scattering(media, m, s.media.density, cosine, s.media, towards)
    chosen, extent = s.chance[k], density if density > 0.0 else 1.0
    met = 1.0 if density > 0.0 and sampling == BOTH else 0.0
    past = shares_past(table, m, s.place, s) if met > 0.0 else 0.0
    passing = density_past(table, m, s.place, s.aside, s.chance, True, s.point) if past > 0.0 else 0.0
    mean = 0.0
    for i in range(walk.chance.size):
        by_phase = towards[i] / total[i] if total[i] > 0.0 else 0.0
        by_flight = met * s.free[i] * s.event[i] * ((1.0 - past) * by_phase + passing) * s.onward[i]
        by_light = chosen * ((1.0 - near_by) * extent + near_by * by_phase)
        mean += walk.chance[i] * (by_light * (drawn + (1.0 - near) * s.free[i]) + by_flight)
    if not mean > 0.0:
        return False
    mean = light * walk.chance.size / mean
    for i in range(walk.value.size):
        s.light[i] *= mean * walk.value[i] * s.halfway[i] * towards[i] * lamps.power[k, i]
    shade(lamps, k, s.place, s.aside, s.light, s.spare)
    scattering_terms(s.polar, media, m, s.media.density, cosine)
    see_turned(s.polar, d, s.aside, s.light)
    return True


@kernel
def light_surface(table, row, both_sides, here, there, sampling, s):
    """Light of a lamp that a surface turns into the leg, into ``s.light`` (wavelength,); False if there is none.

    ``walk.position`` is on the surface, ``s.back`` leads back along the leg, to the side of ``s.kept[1]``; ``s.stack``
    and ``s.other_stack`` are those on this side and beyond.
    """
    lamps, media, walk, n, order = table.lamps, table.media, s.walk, s.kept[1], s.at[ORDER]
    x = walk.position
    guess_at_point(lamps, table.guide, x, n, both_sides, s.chance)
    k = pick(s.chance, uniform(walk.state))
    if k < 0:
        return False
    distance, goal, density, light = aim(
        table.shapes, lamps, k, x, number(walk, order, 10), number(walk, order, 11), s.aside, s.point
    )  # fmt: skip
    cosine = n[0] * s.aside[0] + n[1] * s.aside[1] + n[2] * s.aside[2]
    if not (light > 0.0 and (cosine > 0.0 or both_sides)):
        return False
    evaluate_bsdf(
        table.materials, row, s.normal, s.back, s.aside, media.index[here], media.index[there], np.bool_(False),
        s.factor, s.density,
    )  # fmt: skip
    bright = 0.0
    for i in range(s.factor.size):
        bright += s.factor[i]
    stack = s.stack if cosine > 0.0 else s.other_stack
    if not bright > 0.0 or not arrives(table, table.sky, k, x, distance, s.at[ITEM], goal, stack, s):
        return False
    aimed = s.chance[k] * (density if density > 0.0 else 1.0)
    met = 1.0 if density > 0.0 and sampling == BOTH else 0.0
    past = shares_from_wall(table, here, x, n, s) if met > 0.0 and not both_sides else 0.0
    passing = density_past(table, here, x, s.aside, s.chance, False, s.point) if past > 0.0 else 0.0
    mean = 0.0
    for i in range(walk.chance.size):
        mean += walk.chance[i] * (aimed + met * ((1.0 - past) * s.density[i] + passing) * s.onward[i])
    if not mean > 0.0:
        return False
    mean = light * walk.chance.size / mean
    for i in range(walk.value.size):
        s.light[i] *= mean * walk.value[i] * s.factor[i] * lamps.power[k, i]
    shade(lamps, k, x, s.aside, s.light, s.spare)
    surface_terms(
        s.polar, table.materials, row, s.normal, s.back, s.aside, s.factor, media.index[here], media.index[there]
    )
    see_turned(s.polar, walk.direction, s.aside, s.light)
    return True


@merged
def glow(table, s, sums):
    """Add what the medium of a leg shines."""
    gather_emission(table.media, s.at[IN], s.start, s.walk.direction, s.far[LENGTH], s)
    for i in range(s.factor.size):
        s.factor[i] *= s.walk.value[i]
    see_plain(s.polar, s.factor)
    add_light(s.polar, s.factor, 1.0, s.at[ORDER], s.at[LAST], sums)


@kernel
def light_around(table, sampling, s):
    """Light of the surroundings where a walk leaves, into ``s.factor`` (wavelength,), as far as none aims at it."""
    lamps, d, weight = table.lamps, s.walk.direction, 0.0
    if lamps.around.shape[0] > 0 and (s.at[ORDER] > 0 or lamps.mapped >= 0):
        weight = 1.0
        if lamps.around_cdf.size > 0 and s.at[BEFORE] != NO_AIM and sampling != ANGULAR:
            weight = 1.0 / meeting_weight(table, lamps.mapped, 1.0, s) if sampling == BOTH else 0.0
    for i in range(s.factor.size):
        s.factor[i] = 0.0
    if weight > 0.0:
        add_around(lamps, d, s.factor)
    for i in range(s.factor.size):
        s.factor[i] = table.guide.background[i] + weight * s.factor[i]


@merged
def light_end(table, sampling, s, sums):
    """Add what shines at the end of a leg."""
    walk, lamps, d, hit = s.walk, table.lamps, s.walk.direction, s.hit
    if s.at[ITEM] < 0:
        if table.guide.open:
            light_around(table, sampling, s)
            for i in range(s.factor.size):
                s.factor[i] *= walk.value[i] * s.through[i]
            see_plain(s.polar, s.factor)
            add_light(s.polar, s.factor, 1.0, s.at[ORDER], s.at[LAST], sums)
        # Disks are far smaller than what scatters: they are met only where none of them was aimed at.
        unaimed = sampling == ANGULAR or s.at[BEFORE] == NO_AIM
        if unaimed and lamps.limb.shape[0] > 0 and disk_light(lamps, s.start, d, s.factor, s.spare):
            for i in range(s.factor.size):
                s.factor[i] *= walk.value[i] * s.through[i]
            see_plain(s.polar, s.factor)
            add_light(s.polar, s.factor, 1.0, s.at[ORDER], s.at[LAST], sums)
        return
    k = table.shapes.lamp[item_body(table.shapes, s.at[ITEM])]
    if k < 0 or (sampling == AREA and s.at[BEFORE] != NO_AIM):
        return
    cosine = -(d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3])
    light = brightness(lamps, k, cosine)
    if light > 0.0:
        if sampling == BOTH and s.at[BEFORE] != NO_AIM:
            light /= meeting_weight(table, k, cosine, s)
        for i in range(s.factor.size):
            s.factor[i] = walk.value[i] * s.through[i] * lamps.power[k, i]
        see_plain(s.polar, s.factor)
        add_light(s.polar, s.factor, light, s.at[ORDER], s.at[LAST], sums)
