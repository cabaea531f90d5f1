"""Light that comes straight from lamps to visibility points, by rays to the lamps.

Photons that have not yet met anything bring the same light; where rays are sent, those photons are left out.

A ray is aimed at a lamp, or, where a lamp fills much of the view, goes where the point scatters to and may meet one:
beside a wall that shines, points drawn on it would count by one over the square of their distance.  Which of the two is
left to chance, and both count by the density of the whole (Veach & Guibas 1995, SIGGRAPH 95, 419, one sample).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import ABSORBED, STACK, SURFACE_LAMP
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.surfaces.bsdf import bsdf_pdf, bsdf_value, sample_bsdf
from skyscatter.kernels.surfaces.gather import add_to_ray, look_towards
from skyscatter.kernels.surfaces.lamps import (
    aim,
    brightness,
    darken,
    guess_at_point,
    guess_in_medium,
    meeting_density,
    pick,
    ring_of,
)
from skyscatter.kernels.surfaces.media import (
    MediaWork,
    current_medium,
    draw_scattered,
    make_media_work,
    scattering,
    transmit,
)
from skyscatter.kernels.surfaces.mosaics import tile
from skyscatter.kernels.surfaces.points import DIRECT
from skyscatter.kernels.surfaces.polarised import add_rest, begin_plain, send_plain
from skyscatter.kernels.surfaces.rays import closest_hit, next_hit
from skyscatter.kernels.surfaces.shadows import copy_stack, cross, passes
from skyscatter.kernels.surfaces.shapes import item_body

#: Largest share of the rays that are not aimed at a lamp.
MET = 0.5


@by_address
class NearScratch(NamedTuple):
    """Scratch arrays of a thread."""

    media: MediaWork
    light: np.ndarray  #: (wavelength,)
    piece: np.ndarray  #: (wavelength,)
    flux: np.ndarray  #: (wavelength,)
    density: np.ndarray  #: (wavelength,)
    shadow_stack: np.ndarray  #: (STACK,) int64
    shadow_hit: np.ndarray  #: (4,)
    shadow_place: np.ndarray  #: (3,)
    towards: np.ndarray  #: (3,) to the lamp
    back: np.ndarray  #: (3,)
    point: np.ndarray  #: (6,)
    chance: np.ndarray  #: (lamp,)
    state: np.ndarray  #: (1,) uint64


def make_near_scratch(components: int, wavelengths: int, lamps: int) -> NearScratch:
    """Scratch arrays for a scene of that size."""
    return NearScratch._make([
        make_media_work(components, wavelengths), *(np.zeros(wavelengths) for _ in range(4)),
        np.zeros(STACK, np.int64), np.zeros(4), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(6), np.zeros(lamps),
        np.zeros(1, np.uint64),
    ])  # fmt: skip


@kernel
def shines_through(table, x, d, distance, skip, goal, stack, s):
    """What a ray from x meets before a distance, -1 if nothing, and the transmittance up to it into ``s.light``.

    Boundaries that are no obstacle are passed as photons pass them; `goal` is what the ray is to meet, or -1.
    ``s.shadow_hit`` tells the place.
    """
    shapes, media, hit, place = table.shapes, table.media, s.shadow_hit, s.shadow_place
    copy_stack(stack, s.shadow_stack)
    for i in range(s.light.size):
        s.light[i] = 1.0
    near = 0.0
    item = closest_hit(shapes, x, d, distance, skip, hit)
    while True:
        end = hit[0] if item >= 0 else distance
        here = current_medium(media, s.shadow_stack)
        if media.first[here + 1] > media.first[here]:
            for n in range(3):
                place[n] = x[n] + near * d[n]
            transmit(media, here, place, d, end - near, s.media, s.piece)
            for i in range(s.light.size):
                s.light[i] *= s.piece[i]
        if item < 0 or item == goal:
            return item
        body = item_body(shapes, item)
        cross(shapes, body, d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3] < 0.0, s.shadow_stack)
        if not passes(table.materials.kind[shapes.material[body]], here, current_medium(media, s.shadow_stack)):
            return item
        near = end
        item = next_hit(shapes, x, d, near, item, distance, hit)


@inlined
def share_met(lamps, guide, x, chance):
    """Share of the rays that go where the point scatters to: half where lamps are near for their size."""
    total = 0.0
    for k in range(chance.size):
        if lamps.kind[k] == SURFACE_LAMP:
            m = guide.middle[k]
            dx, dy, dz = x[0] - m[0], x[1] - m[1], x[2] - m[2]
            square, size = dx * dx + dy * dy + dz * dz, guide.size[k] * guide.size[k]
            total += chance[k] * (min(size / square, 1.0) if square > 0.0 else 1.0)
    return MET * total


@inlined
def material_at(table, points, p):
    """Row of the material of the surface that point p lies on."""
    return tile(table.materials, table.shapes.material[points.body[p]], points.place[p])


@merged
def scattered_density(table, points, p, on_surface, s):
    """Density [sr-1] with which `scatter_from` draws ``s.towards``, over all heroes."""
    total, media = 0.0, table.media
    if on_surface:
        bsdf_pdf(
            table.materials, material_at(table, points, p), points.normal[p], s.back, s.towards,
            media.index[points.medium[p]], media.index[points.beyond[p]], s.density,
        )  # fmt: skip
        for i in range(s.density.size):
            total += s.density[i]
    else:
        e = points.direction[p]
        cosine = e[0] * s.towards[0] + e[1] * s.towards[1] + e[2] * s.towards[2]
        scattering(media, points.medium[p], points.density[p], cosine, s.media, s.media.towards)
        for i in range(s.density.size):
            total += s.media.towards[i] / s.media.total[i] if s.media.total[i] > 0.0 else 0.0
    return total / s.density.size


@merged
def scatter_from(table, points, p, on_surface, s):
    """A direction ``s.towards`` as the point scatters light from there to the camera; False if none is drawn."""
    media, size = table.media, s.density.size
    hero = min(int(uniform(s.state) * size), size - 1)
    m, beyond = points.medium[p], points.beyond[p]
    u, v, w = uniform(s.state), uniform(s.state), uniform(s.state)
    if on_surface:
        event = sample_bsdf(
            table.materials, material_at(table, points, p), hero, points.normal[p], s.back, u, v, w,
            uniform(s.state), uniform(s.state), media.index[m], media.index[beyond],
            media.dispersive[m] or media.dispersive[beyond], np.bool_(False), s.towards, s.light, s.density,
        )  # fmt: skip
        return event != ABSORBED
    for n in range(3):
        s.towards[n] = points.direction[p, n]
    for c in range(s.media.density.size):
        s.media.density[c] = points.density[p, c]
    return draw_scattered(media, m, hero, u, v, s.media, s.towards)


@merged
def aim_at(table, points, p, on_surface, met, s):
    """A ray that is aimed at a lamp; the lamp, -1 if dark, and its radiance over power and density."""
    x = points.place[p]
    k = pick(s.chance, uniform(s.state))
    if k < 0:
        return k, 0.0
    distance, item, density, light = aim(
        table.shapes, table.lamps, k, x, uniform(s.state), uniform(s.state), s.towards, s.point
    )
    if not light > 0.0:
        return np.int64(-1), 0.0
    found = shines_through(table, x, s.towards, distance, points.item[p], item, points.stack[p], s)
    if found >= 0 and found != item:
        return np.int64(-1), 0.0
    density = (1.0 - met) * s.chance[k] * (density if item >= 0 else 1.0)
    if item >= 0 and met > 0.0:
        density += met * scattered_density(table, points, p, on_surface, s)
    return k, light / density


@merged
def meet_lamp(table, points, p, on_surface, met, s):
    """A ray where the point scatters to; as `aim_at`."""
    x, d, hit, lamps = points.place[p], s.towards, s.shadow_hit, table.lamps
    if not scatter_from(table, points, p, on_surface, s):
        return np.int64(-1), 0.0
    item = shines_through(table, x, d, math.inf, points.item[p], np.int64(-1), points.stack[p], s)
    k = table.shapes.lamp[item_body(table.shapes, item)] if item >= 0 else np.int64(-1)
    if k < 0:
        return k, 0.0
    cosine = -(d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3])
    light = brightness(lamps, k, cosine)
    if not light > 0.0:
        return np.int64(-1), 0.0
    density = (1.0 - met) * s.chance[k] * meeting_density(table.shapes, lamps, k, item, x, hit[0], cosine)
    return k, light / (density + met * scattered_density(table, points, p, on_surface, s))


@merged
def fetch(table, points, p, on_surface, s):
    """Irradiance of a lamp at point p across the way to it, over all chances, into ``s.flux``; False if dark."""
    met = share_met(table.lamps, table.guide, points.place[p], s.chance)
    if uniform(s.state) < met:
        k, factor = meet_lamp(table, points, p, on_surface, met, s)
    else:
        k, factor = aim_at(table, points, p, on_surface, met, s)
    if k < 0:
        return False
    for i in range(s.flux.size):
        s.flux[i] = factor * table.lamps.power[k, i] * s.light[i]
    if table.lamps.limb_row[k] >= 0:
        darken(table.lamps, k, ring_of(table.lamps, k, s.towards), s.flux)
    return True


@merged
def face_camera(points, p, s):
    """Direction to the camera into ``s.back``, normal on its side into ``s.point``."""
    n, e = points.normal[p], points.direction[p]
    side = 1.0 if n[0] * e[0] + n[1] * e[1] + n[2] * e[2] < 0.0 else -1.0
    for k in range(3):
        s.back[k], s.point[k] = -e[k], side * n[k]


@entry
def light_points(table, points, on_surface, seed, stream, bunch, most, s, sums, by_order, polar):
    """Add the light that comes straight from lamps and is scattered at points; arguments as for `trace_photons`."""
    media = table.media
    start_stream(s.state, seed, stream, bunch)
    for p in range(points.count[0]):
        if points.order[p] + 1 > most or points.accepts[p] & DIRECT:
            continue
        if on_surface:
            face_camera(points, p, s)
            guess_at_point(table.lamps, table.guide, points.place[p], s.point, np.bool_(False), s.chance)
        else:
            guess_in_medium(table.lamps, table.guide, points.place[p], s.chance)
        if not fetch(table, points, p, on_surface, s):
            continue
        if on_surface:
            here, beyond = media.index[points.medium[p]], media.index[points.beyond[p]]
            material = material_at(table, points, p)
            bsdf_value(
                table.materials, material, points.normal[p], s.back, s.towards, here, beyond, np.bool_(False), s.light
            )  # fmt: skip
        else:
            d = s.towards
            begin_plain(polar, d)
            look_towards(media, media.phase, points, p, -d[0], -d[1], -d[2], s.light, polar)
            add_rest(polar, points, p, s.flux, 1.0)
        for i in range(s.flux.size):
            s.light[i] *= s.flux[i]
        if on_surface:
            send_plain(polar, points, p, 1.0, s.light)
        add_to_ray(points, p, 1.0, s.light, np.int64(0), sums, by_order)
