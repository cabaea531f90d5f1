"""Walks from the camera that leave visibility points on their way.

A walk goes through media, past INTERFACE surfaces and along reflections and refractions without spread, to the first
surface that spreads light; there it leaves its last point.  On every leg through a medium it leaves a few points,
*forced* to lie on the leg: half of them drawn by the hero's free path, cut off at the end of the leg, half evenly over
the angle under which a lamp sees the leg (Kulla & Fajardo 2012, Computer Graphics Forum 31, 1519).  With F and P as in
`kernels.path` a point at the distance t counts  F_i tau_i(t) / mean_h(P_h p_h(t)),  where p_h is the mean of
tau_h sigma_h / (1 - tau_h(end)) and of the density by angle; the walk itself goes on with the leg's transmittance, or
from a vertex on the leg, scattered by the peak of a phase function (`kernels.surfaces.peaks`).
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.codes.surfaces import ABSORBED, DIELECTRIC, POINT_LAMP, SURFACE_LAMP, SURROUNDINGS
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.path import rebalance
from skyscatter.kernels.random import start_stream, uniform
from skyscatter.kernels.surfaces.bsdf import is_delta
from skyscatter.kernels.surfaces.clearance import empty_ball
from skyscatter.kernels.surfaces.lamps import brightness, disk_light, shade
from skyscatter.kernels.surfaces.media import (
    current_medium,
    medium_density,
    reach,
    spectral_depth,
    transmit,
)
from skyscatter.kernels.surfaces.mosaics import tile
from skyscatter.kernels.surfaces.peaks import chances_of_peak, scatter_by_peak
from skyscatter.kernels.surfaces.photons import bounce, media_behind, meet
from skyscatter.kernels.surfaces.points import AMBIENT, DIRECT, FOCUSED, SCATTERED
from skyscatter.kernels.surfaces.polarised import add_seen, begin_look, forget_walks, full, note_matrix
from skyscatter.kernels.surfaces.rays import fill_stack
from skyscatter.kernels.surfaces.rims import disk_in_sight, share_on_surface
from skyscatter.kernels.surfaces.shadows import copy_stack, passes
from skyscatter.kernels.surfaces.shapes import NO_MORE, item_body

#: Legs of a walk at most: as many boundaries and mirrors as can be looked through.
MOST_LEGS = 64
#: Share of the events that are placed by the angle from a lamp.
ANGLE_SHARE = 0.5
#: Radius of a sphere in mean free paths at most, whatever is asked for: beyond, it blurs what it is to find.
OF_FREE_PATH = 0.5
#: Share of its first value below which a walk is given up by roulette.
WEAK = 0.05
#: Legs after which roulette begins, and the chance to go on: 64 legs are reached by one walk in a million.
EARLY_LEGS, GO_ON = 8, 0.78


@inlined
def note_point(points, ray, x, d, m, beyond, body, order, accepts, stack):
    """A new visibility point; its number."""
    p = points.count[0]
    points.count[0] = p + 1
    for n in range(3):
        points.place[p, n], points.centre[p, n], points.direction[p, n] = x[n], x[n], d[n]
    points.ray[p], points.medium[p], points.beyond[p], points.body[p] = ray, m, beyond, body
    points.order[p], points.accepts[p], points.item[p] = order, accepts, -1
    copy_stack(stack, points.stack[p])
    return p


@merged
def nearest_lamp(lamps, guide, x, d, u):
    """The lamp of finite distance that should shine most on a line, drawn by power over distance from the line.

    Returns its number (-1 without any), the distance along the line at which it is nearest, and how near it is [m].
    """
    total = 0.0
    for sweep in range(2):
        rest = u * total
        for k in range(lamps.kind.size):
            if lamps.kind[k] == POINT_LAMP or lamps.kind[k] == SURFACE_LAMP:
                m = guide.middle[k]
                a, b, c = m[0] - x[0], m[1] - x[1], m[2] - x[2]
                along = max(a * d[0] + b * d[1] + c * d[2], 0.0)
                a, b, c = a - along * d[0], b - along * d[1], c - along * d[2]
                apart = max(math.sqrt(a * a + b * b + c * c), 0.5 * guide.size[k], 1e-9 * along)
                bright = guide.power[k] / max(apart, 1e-300)
                if sweep == 0:
                    total += bright
                elif bright > 0.0:
                    if rest < bright:
                        return np.int64(k), along, max(apart, 1e-300)
                    rest -= bright
    return np.int64(-1), 0.0, 1.0


@merged
def place_event(media, m, x, d, far, hero, lost, u, near, apart, low, high, s):
    """Distance of an event with u in [0, 1): by angle, where there is one, or by free path."""
    share = ANGLE_SHARE if high > low else 0.0
    if u < share:
        t = near + apart * math.tan(low + (high - low) * u / share)
    else:
        # A hero that loses nothing on the leg has no event there.
        wanted = -math.log1p(-(u - share) / (1.0 - share) * lost) if lost > 0.0 else math.inf
        if media.constant[m]:
            t = wanted / media.extinction[m, hero] if media.extinction[m, hero] > 0.0 else math.inf
        elif wanted == math.inf:
            t = math.inf
        else:
            t = reach(media, m, hero, x, d, far, wanted, s.work)
    return t


@inlined
def widest(ball, extinction):
    """Radius [m] of a sphere where the medium has this extinction (wavelength,) [m-1], `OF_FREE_PATH` at most."""
    total = 0.0
    for i in range(extinction.size):
        total += extinction[i]
    return min(ball, OF_FREE_PATH * extinction.size / total) if total > 0.0 else ball


@kernel
def leave_events(scene, points, ray, m, hero, far, events, part, parts, accepts, order, ball, s, polar):
    """Events on a leg; the transmittance of the whole leg into ``s.light_through``.

    Walks that share a leg each take their `part` of so many of every stratum of it.
    """
    walk, media, work = s.walk, scene.media, s.work
    x, d, whole, through = walk.position, walk.direction, s.light_through, s.light
    transmit(media, m, x, d, far, work, whole)
    lost, dims = 1.0 - whole[hero], False
    for i in range(whole.size):
        dims = dims or whole[i] < 1.0
    if not (dims and scene.guide.scatters[m]):
        return
    k, near, apart = nearest_lamp(scene.lamps, scene.guide, x, d, uniform(walk.state))
    low = math.atan(-near / apart) if k >= 0 else 0.0
    high = (math.atan((far - near) / apart) if far < math.inf else 0.5 * math.pi) if k >= 0 else 0.0
    share = ANGLE_SHARE if high > low else 0.0
    for n in range(events):
        u = (n + (part + uniform(walk.state)) / parts) / events
        t = place_event(media, m, x, d, far, hero, lost, u, near, apart, low, high, s)
        if not 0.0 <= t < far:
            continue
        for j in range(3):
            s.place[j] = x[j] + t * d[j]
        transmit(media, m, x, d, t, work, through)
        medium_density(media, m, s.place[0], s.place[1], s.place[2], work)
        spectral_depth(media, m, work.density, work.total)
        by_angle, mean = 0.0, 0.0
        if share > 0.0:
            by_angle = share * apart / ((high - low) * (apart * apart + (t - near) * (t - near)))
        for i in range(through.size):
            # Chances of wavelengths that lose nothing on this leg: their free path ends nowhere on it.
            forced = through[i] * work.total[i] / (1.0 - whole[i]) if whole[i] < 1.0 else 0.0
            mean += walk.chance[i] * ((1.0 - share) * forced + by_angle)
        mean /= through.size
        if mean > 0.0:
            p = note_point(points, ray, s.place, d, m, m, -1, order, accepts, s.stack)
            note_matrix(polar, p, 0)
            points.reach[p] = empty_ball(scene.shapes, s.place, widest(ball, work.total), s.ball, points.centre[p])
            for c in range(work.density.size):
                points.density[p, c] = work.density[c]
            for i in range(through.size):
                points.weight[p, i] = walk.value[i] * through[i] / (mean * events)


@kernel
def leave_surface_point(shapes, surfaces, ray, m, beyond, body, item, order, accepts, disk, opaque, s, polar):
    """The last point of a walk, on a surface that spreads light."""
    p = note_point(surfaces, ray, s.walk.position, s.walk.direction, m, beyond, body, order, accepts, s.stack)
    note_matrix(polar, p, 1)
    surfaces.item[p] = item
    x, d, normal = s.walk.position, s.walk.direction, s.hit[1:]
    if opaque:
        surfaces.reach[p], surfaces.area[p], surfaces.crowded[p] = disk_in_sight(
            shapes, item, x, normal, d, disk, uniform(s.walk.state), s.ball
        )  # fmt: skip
    else:
        # Light comes from both sides, and not the same of them is in sight.
        surfaces.area[p], surfaces.crowded[p] = share_on_surface(shapes, item, x, normal, disk), False
        surfaces.reach[p] = disk
    for n in range(3):
        surfaces.normal[p, n] = s.hit[1 + n]
    for i in range(s.walk.value.size):
        surfaces.weight[p, i] = s.walk.value[i]


@kernel
def see_light(ray, order, s, sums, by_order, polar):
    """Light (wavelength,) in ``s.light`` that the walk meets, after so many reflections and refractions."""
    for i in range(s.light.size):
        add_seen(polar, ray, i, s.walk.value[i] * s.light[i], sums)
    if 0 < order <= by_order.shape[0]:
        for i in range(s.light.size):
            by_order[order - 1, ray, i] += s.walk.value[i] * s.light[i]


@merged
def see_lamp(lamps, k, ray, order, s, sums, by_order, polar):
    """Light of a lamp's own surface that the walk has met from outside."""
    d, hit = s.walk.direction, s.hit
    cosine = -(d[0] * hit[1] + d[1] * hit[2] + d[2] * hit[3])
    if cosine > 0.0:
        bright = brightness(lamps, k, min(cosine, 1.0))
        for i in range(s.walk.value.size):
            s.light[i] = lamps.power[k, i] * bright
        see_light(ray, order, s, sums, by_order, polar)


@merged
def see_surroundings(lamps, ray, order, s, sums, by_order, polar):
    """Light from outside that the walk meets when it leaves the scene."""
    for k in range(lamps.kind.size):
        if lamps.kind[k] == SURROUNDINGS:
            for i in range(s.light.size):
                s.light[i] = lamps.power[k, i]
            shade(lamps, k, s.origin, s.walk.direction, s.light, s.light_through)
            see_light(ray, order, s, sums, by_order, polar)


@merged
def weaken(leg, weak, s):
    """Roulette for walks that have become long, or weaker than `weak`; False where one ends."""
    walk, largest = s.walk, 0.0
    if leg >= EARLY_LEGS:
        if uniform(walk.state) >= GO_ON:
            return False
        for i in range(walk.value.size):
            walk.value[i] /= GO_ON
    for i in range(walk.value.size):
        largest = max(largest, walk.value[i])
    if largest < weak:
        if uniform(walk.state) * weak >= largest:
            return False
        for i in range(walk.value.size):
            walk.value[i] *= weak / largest
    return True


@merged
def end_leg(scene, peaks, m, hero, far, s):
    """Whether the walk is scattered by a peak on its leg: the distance, or -1 where it goes on to the leg's end."""
    walk, media, whole = s.walk, scene.media, s.light_through
    chances_of_peak(peaks, m, whole, s.density)
    if s.density[hero] > 0.0 and uniform(walk.state) < s.density[hero]:
        t = place_event(
            media, m, walk.position, walk.direction, far, hero, 1.0 - whole[hero], uniform(walk.state), 0.0, 1.0, 0.0,
            0.0, s,
        )  # fmt: skip
        return min(t, far) if t < math.inf else -1.0
    for i in range(walk.value.size):
        walk.value[i] *= whole[i]
        walk.chance[i] *= 1.0 - s.density[i]
    rebalance(walk)
    return -1.0


@merged
def look(
    scene, peaks, ray, events, part, parts, weak, most, ball, disk, direct, points, surfaces, s, sums, by_order, polar
):  # fmt: skip
    """One walk from the camera, a `part` of so many."""
    walk, shapes, media, hit = s.walk, scene.shapes, scene.media, s.hit
    x, d = walk.position, walk.direction
    accepts = FOCUSED | SCATTERED | AMBIENT
    if not direct:
        accepts |= DIRECT
    hero = min(int(uniform(walk.state) * walk.value.size), walk.value.size - 1)
    near, last, skip, order, straight = 0.0, NO_MORE, np.int64(-1), np.int64(0), True
    for n in range(3):
        s.origin[n] = x[n]
    for leg in range(MOST_LEGS):
        m = current_medium(media, s.stack)
        item = meet(shapes, s.origin, d, near, last, skip, hit)
        far = hit[0] - near if item >= 0 else math.inf
        if media.first[m + 1] > media.first[m]:
            # Photons are dear, walks are cheap: those that were scattered leave one point a leg.
            leave_events(
                scene, points, ray, m, hero, far, events if straight else 1, part if straight else 0,
                parts if straight else 1, accepts, order, ball, s, polar,
            )  # fmt: skip
            t = end_leg(scene, peaks, m, hero, far, s)
            if t >= 0.0:
                order += 1
                if order >= most:
                    return
                if not scatter_by_peak(peaks, media, m, hero, t, s) or not weaken(leg, weak, s):
                    return
                near, last, skip, straight = 0.0, NO_MORE, np.int64(-1), False
                for n in range(3):
                    s.origin[n] = x[n]
                continue
        if item < 0:
            see_surroundings(scene.lamps, ray, order, s, sums, by_order, polar)
            if straight and scene.lamps.limb.shape[0] > 0 and disk_light(scene.lamps, x, d, s.light, s.light_through):
                see_light(ray, order, s, sums, by_order, polar)
            return
        for n in range(3):
            x[n] += far * d[n]
        body = item_body(shapes, item)
        beyond = media_behind(scene, s, body)
        material = tile(scene.materials, shapes.material[body], x)
        if shapes.lamp[body] >= 0 and straight:
            see_lamp(scene.lamps, shapes.lamp[body], ray, order, s, sums, by_order, polar)
        if passes(scene.materials.kind[material], m, beyond):
            copy_stack(s.there, s.stack)
            near, last, skip = hit[0], item, np.int64(-1)
            continue
        if not is_delta(scene.materials, material):
            # Rays to lamps are sent on the walk's side alone.
            both = scene.materials.kind[material] == DIELECTRIC
            kinds = accepts | DIRECT if both else accepts
            leave_surface_point(shapes, surfaces, ray, m, beyond, body, item, order, kinds, disk, not both, s, polar)
            return
        order += 1
        if order > most:
            return
        if bounce(scene, body, m, beyond, hero, np.bool_(False), s, polar) == ABSORBED or not weaken(leg, weak, s):
            return
        near, last, skip = 0.0, NO_MORE, item
        for n in range(3):
            s.origin[n] = x[n]


@entry
def leave_points(
    scene, peaks, origins, directions, ids, first, seed, stream, looks, events, most, ball, disk, direct, points,
    surfaces, s, sums, by_order, polar,
):  # fmt: skip
    """Walks of the rays from `first` on, until there is no more room for points.

    Parameters
    ----------
    scene : SurfaceTable
    peaks : PeakTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers by which their random streams are told apart.
    first : int
    seed, stream : int
        Seed, and number of the pass.
    looks : int
        Walks of every ray.
    events : int
        Points of each on every leg through a medium.
    most : int
        Light that was scattered, reflected or refracted more often than this is left out.
    ball, disk : float
        Radius of the spheres in media and of the disks on surfaces [m].
    direct : bool
        Whether light that comes straight from lamps is found in another way.
    points, surfaces : Points
        Output: those in media, those on surfaces.
    s : PhotonScratch
    sums : (ray, wavelength)
        What is seen directly is added here: lamps, and light from outside.
    by_order : (order, ray, wavelength)
        The same after 1, 2, ... reflections and refractions.
    polar : PhotonPolar or None

    Returns
    -------
    int
        The first ray that is left over; -1 if a point is inside of more media than can be remembered.
    """
    walk = s.walk
    filled = False
    forget_walks(polar)
    for ray in range(first, origins.shape[0]):
        if points.count[0] + looks * events * MOST_LEGS > points.ray.size:
            return ray
        if surfaces.count[0] + looks > surfaces.ray.size or full(polar, looks * MOST_LEGS):
            return ray
        start_stream(walk.state, seed, ids[ray], stream)
        same = filled
        for n in range(3):
            same = same and origins[ray, n] == origins[max(ray - 1, 0), n]
        if not same:
            if fill_stack(scene.shapes, origins[ray], directions[ray], np.int64(-1), s.first, s.other_hit) < 0:
                return -1
            filled = True
        for part in range(looks):
            copy_stack(s.first, s.stack)
            for n in range(3):
                walk.position[n], walk.direction[n] = origins[ray, n], directions[ray, n]
            for i in range(walk.value.size):
                walk.value[i], walk.chance[i] = 1.0 / looks, 1.0
            begin_look(polar, ray)
            look(
                scene, peaks, ray, events, part, looks, WEAK / looks, most, ball, disk, direct, points, surfaces, s,
                sums, by_order, polar,
            )  # fmt: skip
    return origins.shape[0]
