"""Light that comes straight from lamps to visibility points, by rays to the lamps.

Photons that have not yet met anything bring the same light; where rays are sent, those photons are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skyscatter.solvers.kernels.jit import entry, merged
from skyscatter.solvers.kernels.random import start_stream, uniform
from skyscatter.solvers.kernels.surfaces.bsdf import bsdf_value
from skyscatter.solvers.kernels.surfaces.gather import add_to_ray, look_towards
from skyscatter.solvers.kernels.surfaces.lamps import aim, guess_at_point, lobe_value, pick, share_out
from skyscatter.solvers.kernels.surfaces.media import MediaWork, current_medium, make_media_work, transmit
from skyscatter.solvers.kernels.surfaces.points import DIRECT
from skyscatter.solvers.kernels.surfaces.polarised import add_rest, begin_plain, send_plain
from skyscatter.solvers.kernels.surfaces.rays import closest_hit, next_hit
from skyscatter.solvers.kernels.surfaces.shadows import copy_stack, cross, passes
from skyscatter.solvers.kernels.surfaces.shapes import item_body
from skyscatter.solvers.kernels.surfaces.tables import PARALLEL_LAMP, POINT_LAMP, STACK, SURROUNDINGS


class NearScratch(NamedTuple):
    """Scratch arrays of a thread."""

    media: MediaWork
    light: np.ndarray  #: (wavelength,)
    piece: np.ndarray  #: (wavelength,)
    flux: np.ndarray  #: (wavelength,)
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
        make_media_work(components, wavelengths), *(np.zeros(wavelengths) for _ in range(3)),
        np.zeros(STACK, np.int64), np.zeros(4), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(6), np.zeros(lamps),
        np.zeros(1, np.uint64),
    ])  # fmt: skip


@merged
def guess_in_medium(lamps, guide, x, chance):
    """Chances to look for each lamp from a point in a medium, into `chance` (lamp,): by what would arrive in vacuum."""
    for k in range(chance.size):
        guess = guide.power[k]
        if lamps.kind[k] != PARALLEL_LAMP and lamps.kind[k] != SURROUNDINGS:
            m, a = guide.middle[k], guide.axis[k]
            dx, dy, dz = x[0] - m[0], x[1] - m[1], x[2] - m[2]
            square = max(dx * dx + dy * dy + dz * dz, 1e-300)
            cosine = (a[0] * dx + a[1] * dy + a[2] * dz) / square**0.5
            guess *= lobe_value(lamps, k, cosine) if lamps.kind[k] == POINT_LAMP else guide.typical[k]
            guess /= max(square, guide.size[k] * guide.size[k])
        chance[k] = guess
    share_out(guide, chance)


@merged
def shines_through(table, x, d, distance, skip, goal, stack, s):
    """Whether light comes straight from `distance` to x, and with what transmittance, into ``s.light`` (wavelength,).

    Boundaries that are no obstacle are passed as photons pass them; `goal` is the lamp's own item.
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
            return True
        body = item_body(shapes, item)
        cross(shapes, body, d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3] < 0.0, s.shadow_stack)
        if not passes(table.materials.kind[shapes.material[body]], here, current_medium(media, s.shadow_stack)):
            return False
        near = end
        item = next_hit(shapes, x, d, near, item, distance, hit)


@merged
def fetch(table, points, p, skip, s):
    """Irradiance of a lamp at point p across the way to it, over all chances, into ``s.flux``; False if dark."""
    x = points.place[p]
    k = pick(s.chance, uniform(s.state))
    if k < 0:
        return False
    chance = s.chance[k]
    distance, item, density, light = aim(
        table.shapes, table.lamps, k, x, uniform(s.state), uniform(s.state), s.towards, s.point
    )
    if not light > 0.0 or not shines_through(table, x, s.towards, distance, skip, item, points.stack[p], s):
        return False
    factor = light / (chance * (density if item >= 0 else 1.0))
    for i in range(s.flux.size):
        s.flux[i] = factor * table.lamps.power[k, i] * s.light[i]
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
        if not fetch(table, points, p, points.item[p], s):
            continue
        if on_surface:
            here, beyond = media.index[points.medium[p]], media.index[points.beyond[p]]
            material = table.shapes.material[points.body[p]]
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
