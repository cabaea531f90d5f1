"""Photons: traced from the lamps through media and surfaces, and gathered on their way.

A photon carries the power of its lamp at all wavelengths.  Its hero draws: the free path by its extinction, scattering
or absorption by its albedo, the new direction by its phase function; value and chances follow as in `kernels.path`.
So a photon weighs nearly the same all its way and ends where its hero is absorbed or leaves the scene.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import ABSORBED, DELTA, STACK, SURROUNDINGS, TRANSMITTED
from skyscatter.kernels.gridwalk import Walker, make_walker
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.path import Walk, make_walk, rebalance
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.surfaces.bsdf import is_delta, sample_bsdf
from skyscatter.kernels.surfaces.clearance import BallScratch, make_ball_scratch
from skyscatter.kernels.surfaces.emit import emit_photon
from skyscatter.kernels.surfaces.gather import (
    PATHS,
    POINTS,
    gather_arrival,
    gather_event,
    gather_segment,
)
from skyscatter.kernels.surfaces.media import (
    MediaWork,
    current_medium,
    fly,
    make_media_work,
    scatter_walk,
)
from skyscatter.kernels.surfaces.mosaics import tile
from skyscatter.kernels.surfaces.points import AMBIENT, DIRECT, FOCUSED, SCATTERED
from skyscatter.kernels.surfaces.polarised import (
    begin_plain,
    bounce_polarised,
    remember_direction,
    scatter_polarised,
)
from skyscatter.kernels.surfaces.rays import nearest
from skyscatter.kernels.surfaces.shadows import copy_stack, cross, passes
from skyscatter.kernels.surfaces.shapes import NO_MORE, item_body

#: Encounters with surfaces and media after which a photon is given up, and counted as such.
MOST_EVENTS = 100_000
#: What became of photons.
ESCAPED, ABSORBED_BY_MEDIA, ABSORBED_BY_SURFACES, LEFT = 0, 1, 2, 3


@by_address
class PhotonScratch(NamedTuple):
    """Scratch arrays of a thread, for walks from the camera and from lamps."""

    walk: Walk
    work: MediaWork
    walker: Walker
    ball: BallScratch
    stack: np.ndarray  #: (STACK,) int64, media that the walk is inside of
    there: np.ndarray  #: (STACK,) int64, the same behind a surface
    first: np.ndarray  #: (STACK,) int64, the same at the camera
    origin: np.ndarray  #: (3,) where the walk last turned
    place: np.ndarray  #: (6,) point and normal on a lamp
    hit: np.ndarray  #: (4,) distance and outward normal of what a ray meets
    other_hit: np.ndarray  #: (4,)
    towards: np.ndarray  #: (3,)
    arriving: np.ndarray  #: (3,)
    value: np.ndarray  #: (wavelength,) F at the start of a flight
    chance: np.ndarray  #: (wavelength,) P at the start of a flight
    factor: np.ndarray  #: (wavelength,) what a surface does to F
    density: np.ndarray  #: (wavelength,) and to P
    light: np.ndarray  #: (wavelength,)
    light_through: np.ndarray  #: (wavelength,)
    shift: np.ndarray  #: (EVEN_DIMENSIONS,) uint32, of the even numbers of a pass
    power: np.ndarray  #: (1,) total of F over the wavelengths at the lamp
    found: np.ndarray  #: (3,) int64, how often events, flights and arrivals were gathered


def make_photon_scratch(components: int, wavelengths: int) -> PhotonScratch:
    """Scratch arrays for a scene of that size."""
    return PhotonScratch._make([
        make_walk(wavelengths), make_media_work(components, wavelengths), make_walker(),
        make_ball_scratch(),
        *(np.zeros(STACK, np.int64) for _ in range(3)), np.zeros(3), np.zeros(6), np.zeros(4), np.zeros(4), np.zeros(3),
        np.zeros(3), *(np.zeros(wavelengths) for _ in range(6)), np.zeros(EVEN_DIMENSIONS, np.uint32), np.zeros(1),
        np.zeros(3, np.int64),
    ])  # fmt: skip


@inlined
def meet(shapes, origin, d, near, last, skip, hit):
    """The item that a ray meets after `last`, at the distance `near` from its origin; -1 without one.

    A ray that has passed nothing yet has NO_MORE for `last`, and may start on the item `skip`.
    """
    return nearest(
        shapes.kind, shapes.parameters, shapes.triangle, shapes.loose, shapes.node_box, shapes.node_link, shapes.order,
        origin, d, near, last, math.inf, skip, hit,
    )  # fmt: skip


@merged
def media_behind(scene, s, body):
    """Media behind a surface that the walk has met, into ``s.there``; the number of the current one there."""
    d = s.walk.direction
    copy_stack(s.stack, s.there)
    cross(scene.shapes, body, d[0] * s.hit[1] + d[1] * s.hit[2] + d[2] * s.hit[3] < 0.0, s.there)
    return current_medium(scene.media, s.there)


@kernel
def bounce(scene, body, m, beyond, hero, adjoint, s, polar):
    """A walk that has met a surface is reflected, refracted or absorbed; the event, see `sample_bsdf`."""
    walk, media = s.walk, scene.media
    d, normal, material = walk.direction, s.hit[1:], tile(scene.materials, scene.shapes.material[body], walk.position)
    for n in range(3):
        s.towards[n] = -d[n]
    event = sample_bsdf(
        scene.materials, material, hero, normal, s.towards, uniform(walk.state),
        uniform(walk.state), uniform(walk.state), uniform(walk.state), uniform(walk.state), media.index[m],
        media.index[beyond], media.dispersive[m] or media.dispersive[beyond], adjoint, d, s.factor, s.density,
    )  # fmt: skip
    if event == ABSORBED:
        return event
    for i in range(walk.value.size):
        walk.value[i] *= s.factor[i]
        walk.chance[i] *= s.density[i]
    bounce_polarised(
        polar, scene.materials, material, event, adjoint, normal, s.towards, walk, media.index[m],
        media.index[beyond],
    )  # fmt: skip
    if not rebalance(walk):
        return ABSORBED
    if event & TRANSMITTED:
        copy_stack(s.there, s.stack)
    return event


@merged
def survive(hero, s):
    """Scattering or absorption of a photon by the hero's albedo, at an event; False where it is absorbed."""
    walk, total = s.walk, s.work.total
    for i in range(walk.chance.size):
        # ``s.light`` holds the scattering coefficient, ``total`` the extinction.
        s.density[i] = s.light[i] / total[i] if total[i] > 0.0 else 0.0
    if uniform(walk.state) >= s.density[hero]:
        return False
    for i in range(walk.chance.size):
        walk.chance[i] *= s.density[i]
    return rebalance(walk)


@merged
def mix_scattering(media, m, s):
    """Scattering coefficient at the event, into ``s.light``."""
    for i in range(s.light.size):
        s.light[i] = 0.0
    for c in range(media.first[m], media.first[m + 1]):
        for i in range(s.light.size):
            s.light[i] += s.work.density[c] * media.sigma_s[c, i]


@merged
def roulette(s):
    """Give up photons that surfaces have made weak, so that those that go on are as strong as they were at first."""
    walk, now = s.walk, 0.0
    for i in range(walk.value.size):
        now += walk.value[i]
    chance = min(now / s.power[0], 1.0)
    if uniform(walk.state) >= chance:
        return False
    for i in range(walk.value.size):
        walk.value[i] /= chance
    return True


@merged
def follow(scene, peaks, points, surfaces, grid, floor, how, lamp, skip, hero, most, s, sums, by_order, fates, polar):
    """One photon from its lamp to its end."""
    walk, shapes, media = s.walk, scene.shapes, scene.media
    x, d, hit = walk.position, walk.direction, s.hit
    kind = AMBIENT if scene.lamps.kind[lamp] == SURROUNDINGS else DIRECT
    order, near, last = np.int64(0), 0.0, NO_MORE
    u = walk.even[7]
    for n in range(3):
        s.origin[n] = x[n]
    for _ in range(MOST_EVENTS):
        m = current_medium(media, s.stack)
        item = meet(shapes, s.origin, d, near, last, skip, hit)
        far = hit[0] - near if item >= 0 else math.inf
        flown, event = far, False
        phase = peaks.broad if kind >= SCATTERED else media.phase
        if media.first[m + 1] > media.first[m]:
            for i in range(walk.value.size):
                s.value[i], s.chance[i] = walk.value[i], walk.chance[i]
            flown, event = fly(media, m, hero, x, d, far, u, walk, s.work)
            u = uniform(walk.state)
            if how & PATHS:
                gather_segment(
                    scene, phase, points, grid, how, m, kind, order, most, flown, s, sums, by_order, polar
                )  # fmt: skip
        if not event and item < 0:
            for i in range(walk.value.size):
                fates[ESCAPED, i] += walk.value[i]
            return
        for n in range(3):
            x[n] += flown * d[n]
        if event:
            if how & POINTS:
                gather_event(scene, phase, points, grid, how, m, kind, order, most, s, sums, by_order, polar)
            order += 1
            if order >= most or not scatter_photon(media, m, hero, s, fates, polar):
                return
            kind, near, last, skip = SCATTERED, 0.0, NO_MORE, np.int64(-1)
        else:
            body = item_body(shapes, item)
            beyond = media_behind(scene, s, body)
            material = tile(scene.materials, shapes.material[body], x)
            if passes(scene.materials.kind[material], m, beyond):
                copy_stack(s.there, s.stack)
                near, last, skip = hit[0], item, np.int64(-1)
                continue
            if not is_delta(scene.materials, material):
                gather_arrival(scene, surfaces, floor, body, kind, order, most, s, sums, by_order, polar)
            order += 1
            if order >= most:
                return
            met = meet_surface(scene, body, m, beyond, hero, s, fates, polar)
            if met == ABSORBED:
                return
            kind = max(kind, FOCUSED) if met & DELTA else SCATTERED
            near, last, skip = 0.0, NO_MORE, item
        for n in range(3):
            s.origin[n] = x[n]
    for i in range(walk.value.size):
        fates[LEFT, i] += walk.value[i]


@merged
def scatter_photon(media, m, hero, s, fates, polar):
    """What becomes of a photon at an event: False where it ends."""
    walk = s.walk
    mix_scattering(media, m, s)
    for i in range(walk.value.size):
        fates[ABSORBED_BY_MEDIA, i] += walk.value[i] * (s.work.total[i] - s.light[i])
    if not survive(hero, s):
        return False
    remember_direction(polar, walk.direction)
    if not scatter_walk(media, m, hero, uniform(walk.state), uniform(walk.state), s.work, walk):
        return False
    return scatter_polarised(polar, media, m, hero, s.work.density, walk)


@merged
def meet_surface(scene, body, m, beyond, hero, s, fates, polar):
    """What becomes of a photon at a surface: the event, ABSORBED where it ends."""
    walk = s.walk
    for i in range(walk.value.size):
        fates[ABSORBED_BY_SURFACES, i] += walk.value[i]
    met = bounce(scene, body, m, beyond, hero, np.bool_(True), s, polar)
    if met == ABSORBED:
        return met
    for i in range(walk.value.size):
        fates[ABSORBED_BY_SURFACES, i] -= walk.value[i]
    return met if roulette(s) else ABSORBED


@entry
def trace_photons(
    scene, peaks, points, surfaces, grid, floor, how, seed, stream, first, last, count, most, s, sums, by_order,
    fates, polar,
):  # fmt: skip
    """Trace photons `first` to `last` of `count` and gather their light.

    Parameters
    ----------
    scene : SurfaceTable
    peaks : PeakTable
        What walks from the camera have followed already, and photons leave out.
    points, surfaces : Points
        Visibility points in media and on surfaces.
    grid, floor : Cells
        Where the ones and the others are.
    how : int
        POINTS, PATHS or both.
    seed, stream : int
        Seed, and number of the streams of this pass.
    most : int
        Light that was scattered more often than this is left out.
    s : PhotonScratch
    sums : (ray, wavelength)
        Radiance of the rays is added here.
    by_order : (order, ray, wavelength)
        The same by orders of scattering.
    fates : (4, wavelength)
        Power of the photons that escaped, were absorbed by media, by surfaces, or given up is added here.
    polar : PhotonPolar or None
        Q, U and V of the rays are added to its sums.
    """
    walk = s.walk
    start_stream(walk.state, seed, stream, -1)
    for n in range(EVEN_DIMENSIONS):
        s.shift[n] = np.uint32(uniform(walk.state) * 4294967296.0)
    for photon in range(first, last):
        start_stream(walk.state, seed, stream, photon)
        even_point(s.shift, photon, walk.even)
        lamp, skip = emit_photon(scene, walk.even, count, s)
        if lamp < 0:
            return
        begin_plain(polar, walk.direction)
        s.power[0] = 0.0
        for i in range(walk.value.size):
            s.power[0] += walk.value[i]
        hero = min(int(walk.even[1] * walk.value.size), walk.value.size - 1)
        follow(
            scene, peaks, points, surfaces, grid, floor, how, lamp, np.int64(skip), hero, most, s, sums, by_order,
            fates, polar,
        )  # fmt: skip
