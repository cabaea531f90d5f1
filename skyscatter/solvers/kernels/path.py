"""All orders of scattering by backward random walks that carry the whole spectrum.

A walk starts where the camera's ray is scattered and goes from vertex to vertex.  Every leg between two vertices is
*marched*: the path is cut into a few strata, a random point is taken in each, and from the exact transmittance to that
point follow two things at once,

- the light that reaches the walk along this leg after one more scattering of sunlight (next-event estimation at every
  point: an unbiased, stratified estimate of the integral), by emission, from the ground and from outside;
- the chance of each point to become the next vertex.

So a point in sunlit air high above a dark observer is reached because the march passes it, and no walk depends on the
luck of one free flight.  Given the points, choosing a vertex is a discrete draw with known chances, which differ from
wavelength to wavelength.  One wavelength, the hero, drives the draws; the walk counts for all of them with the balance
heuristic (Wilkie et al. 2014, Computer Graphics Forum 33, 123): value(lambda) / mean over heroes of their chances of
this walk.  In the code F is the walk's value and P its chance under each hero, both divided by the mean chance, so that
F alone is the weighted throughput.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skyscatter.solvers.kernels.jit import entry, inlined, kernel
from skyscatter.solvers.kernels.lookup import (
    columns_along,
    columns_to_light,
    densities,
    outward_columns,
    sort_few,
    start_columns,
    trace_line,
)
from skyscatter.solvers.kernels.optics import (
    mix_components,
    phase_at,
    sample_cosine,
    transmittance,
    weigh_phase,
)
from skyscatter.solvers.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.solvers.kernels.work import make_work

#: Strata of a leg of a walk, and of the camera's ray.
LEG_STRATA, CAMERA_STRATA = 8, 24
#: Share of the vertex draw that does not ask whether a point is sunlit: the dark scatters light of higher orders.
DARK_SHARE = 0.25
#: Independent batches from whose spread the standard error is computed.
BATCHES = 16
#: What a walk finds at the end of a leg.
NOTHING, AIR, GROUND = 0, 1, 2
#: Floor of the guide's zenith cosine: it draws by 1 / (cosine + floor), as the air mass grows towards the horizon.
GUIDE_FLOOR = 0.15
GUIDE_LOG = math.log((1.0 + GUIDE_FLOOR) / GUIDE_FLOOR)
#: Share of the directions drawn by an isotropic phase function; the guide draws the rest.
LEAST_PHASE_SHARE = 0.1
#: Cosine of the Sun's zenith angle below which no direction is drawn around it.
LOWEST_SUN = -0.05
#: Legs on which vertices and directions are chosen with an eye to where the light is.  Each such choice spreads the
#: weight of the walk; the first ones carry most of the light and are worth it.
GUIDED_LEGS = 2
#: Russian roulette begins at this vertex.
FIRST_ROULETTE = 3
#: Throughput, relative to that after the first vertex, below which it begins.
ROULETTE_LEVEL = 0.3


class Leg(NamedTuple):
    """A marched leg: points, and for each point and wavelength what it would hand on to a next vertex."""

    edge: np.ndarray  #: (stratum + 1,) distances t of the strata [m]
    point: np.ndarray  #: (stratum,) chosen distances t [m]
    weight: np.ndarray  #: (stratum + 1, wavelength) width x transmittance x scattering; the last row is the ground
    chance: np.ndarray  #: (stratum + 1, wavelength) chance of the draw under each hero
    total: np.ndarray  #: (wavelength,) sum of the chances before they are divided by it


class Walk(NamedTuple):
    """State of one walk."""

    position: np.ndarray  #: (3,)
    direction: np.ndarray  #: (3,)
    value: np.ndarray  #: (wavelength,) F
    chance: np.ndarray  #: (wavelength,) P
    gain: np.ndarray  #: (wavelength,) sunlight scattered or reflected into the current leg
    escape: np.ndarray  #: (wavelength,) light that enters the leg unscattered: emission, light from outside
    even: np.ndarray  #: (EVEN_DIMENSIONS,) evenly spread numbers of this walk
    state: np.ndarray  #: (1,) uint64 random stream


def make_leg(strata: int, wavelengths: int) -> Leg:
    """An empty leg."""
    return Leg(
        np.zeros(strata + 1), np.zeros(strata), np.zeros((strata + 1, wavelengths)),
        np.zeros((strata + 1, wavelengths)), np.zeros(wavelengths),
    )  # fmt: skip


def make_walk(wavelengths: int) -> Walk:
    """An empty walk."""
    return Walk(
        np.zeros(3), np.zeros(3), np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths), np.zeros(EVEN_DIMENSIONS), np.zeros(1, np.uint64),
    )  # fmt: skip


@kernel
def cut_strata(line, sigma, edge):
    """Cut a line into strata: half of the cuts by geometry, half by extinction.

    Air is dense where the line is lowest, so distances from there grow as the power 2.5 of the stratum's number; and
    light comes from within a mean free path 1 / sigma of the start.  Any cuts give an unbiased march; these make it
    quiet.
    """
    strata = edge.size - 1
    length = line.leave - line.enter
    half = strata // 2
    # The lowest point splits the line; each side gets its share of the geometric cuts.
    low = min(max(0.0, line.enter), line.leave)
    before, after = low - line.enter, line.leave - low
    n_before = int(round(half * math.sqrt(before) / (math.sqrt(before) + math.sqrt(after)))) if before > 0.0 else 0
    n_after = half - n_before
    n = 0
    for k in range(n_before):
        edge[n] = low - before * ((k + 0.5) / (n_before + 0.5)) ** 2.5 if n_after == 0 else (
            low - before * (k / n_before) ** 2.5
        )
        n += 1
    for k in range(1, n_after + 1):
        edge[n] = low + after * (k / (n_after + 1.0)) ** 2.5
        n += 1
    depth = min(sigma * length, 50.0)
    cuts = strata - 1 - n
    for k in range(1, cuts + 1):
        x = k / (cuts + 1.0)
        share = -math.log(1.0 - x * (1.0 - math.exp(-depth))) / depth if depth > 1e-3 else x
        edge[n] = line.enter + length * share
        n += 1
    edge[n], edge[n + 1] = line.enter, line.leave
    sort_few(edge, n + 2)


@kernel
def mean_extinction(scene, h, work):
    """Extinction coefficient [m-1] at altitude h, averaged over the wavelengths."""
    densities(scene.columns, h, work.density)
    total = 0.0
    for c in range(work.density.size):
        for i in range(scene.optics.sigma_t.shape[1]):
            total += work.density[c] * scene.optics.sigma_t[c, i]
    return total / scene.optics.sigma_t.shape[1]


@inlined
def light_at(scene, r, x_sun, work):
    """Transmittance towards one direction to the Sun, into ``work.sun``; False in the shadow."""
    mu_s = min(max(x_sun / r, -1.0), 1.0)
    if not columns_to_light(scene.columns, r, mu_s, work.spare, work.to_sun):
        return False
    transmittance(work.to_sun, scene.optics.sigma_t, work.sun)
    return True


@kernel
def pick_sun(optics, u):
    """Number of a point of the solar disk, drawn by its share of the irradiance."""
    below = 0.0
    for m in range(optics.sun_chance.size - 1):
        below += optics.sun_chance[m]
        if u < below:
            return m
    return optics.sun_chance.size - 1


@kernel
def march(scene, line, node, u, guided, leg, work, walk):
    """March a leg: its light into ``walk.gain`` and ``walk.escape``, the candidates for the next vertex into `leg`.

    The points lie at the same fraction `u` of every stratum.  Sunlight comes from the one point `node` of the solar
    disk, drawn by its share and so standing for the whole.  On a `guided` leg sunlit candidates are preferred.
    """
    optics = scene.optics
    wavelengths = optics.albedo.size
    s = optics.sun_direction[node]
    x, d = walk.position, walk.direction
    a = d[0] * s[0] + d[1] * s[1] + d[2] * s[2]
    q = x[0] * s[0] + x[1] * s[1] + x[2] * s[2]
    phase_at(optics.phase, a, work.phase)
    weigh_phase(work.phase, optics.sigma_s, work.weighted)
    walk.gain[:] = 0.0
    walk.escape[:] = 0.0
    leg.total[:] = 0.0
    preference = 1.0 if guided else 0.0
    start_columns(scene.columns, line, work.from_start, work.across)
    for k in range(leg.point.size):
        width = leg.edge[k + 1] - leg.edge[k]
        t = leg.edge[k] + width * u
        leg.point[k] = t
        r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
        transmittance(work.along, optics.sigma_t, work.through)
        densities(scene.columns, r - scene.columns.radius, work.density)
        if not light_at(scene, r, q + (t - line.start) * a, work):
            work.sun[:] = 0.0
        mix_components(work.density, optics.sigma_s, work.scattering)
        mix_components(work.density, work.weighted, work.towards)
        for i in range(wavelengths):
            reach = width * work.through[i]
            leg.weight[k, i] = reach * work.scattering[i]
            leg.chance[k, i] = leg.weight[k, i] * (DARK_SHARE + preference * work.sun[i])
            walk.gain[i] += reach * work.towards[i] * work.sun[i]
            leg.total[i] += leg.chance[k, i]
        if optics.emits:
            mix_components(work.density, optics.emission, work.emitted)
            for i in range(wavelengths):
                walk.escape[i] += width * work.through[i] * work.emitted[i]
    for i in range(wavelengths):
        walk.gain[i] *= optics.sun_irradiance[node, i] / optics.sun_chance[node]
    _march_end(scene, line, node, q + (line.leave - line.start) * a, preference, leg, work, walk)


@kernel
def _march_end(scene, line, node, x_sun, preference, leg, work, walk):
    """The end of a marched leg: reflected sunlight or light from outside, and the ground as a candidate."""
    optics = scene.optics
    last = leg.point.size
    columns_along(scene.columns, line, line.leave, work.from_start, work.across, work.along)
    transmittance(work.along, optics.sigma_t, work.through)
    if not line.hits_ground:
        for i in range(optics.albedo.size):
            walk.escape[i] += work.through[i] * optics.background[i]
            leg.weight[last, i] = 0.0
            leg.chance[last, i] = 0.0
        return
    mu_s = x_sun / scene.columns.radius
    if mu_s <= 0.0 or not light_at(scene, scene.columns.radius, x_sun, work):
        work.sun[:] = 0.0
    for i in range(optics.albedo.size):
        reach = work.through[i] * optics.albedo[i]
        irradiance = work.sun[i] * mu_s * optics.sun_irradiance[node, i] / optics.sun_chance[node]
        walk.gain[i] += reach * irradiance / math.pi
        leg.weight[last, i] = reach
        leg.chance[last, i] = reach * (DARK_SHARE + preference * work.sun[i])
        leg.total[i] += leg.chance[last, i]


@kernel
def finish_chances(leg):
    """Divide the chances by their sum."""
    for k in range(leg.chance.shape[0]):
        for i in range(leg.total.size):
            leg.chance[k, i] = leg.chance[k, i] / leg.total[i] if leg.total[i] > 0.0 else 0.0


@kernel
def draw_candidate(leg, hero, u):
    """Index of a candidate drawn with the hero's chances, and where u fell within its share (0 to 1)."""
    last = leg.chance.shape[0] - 1
    below = 0.0
    choice, share = -1, 0.0
    for k in range(last + 1):
        c = leg.chance[k, hero]
        if c > 0.0:
            choice, share = k, min((u - below) / c, 1.0)
            below += c
            if u < below:
                break
    return choice, share


@kernel
def rebalance(walk):
    """Divide value and chances by the mean chance over the heroes; False when the walk is worth nothing."""
    mean = 0.0
    for i in range(walk.chance.size):
        mean += walk.chance[i]
    mean /= walk.chance.size
    if mean <= 0.0:
        return False
    for i in range(walk.chance.size):
        walk.chance[i] /= mean
        walk.value[i] /= mean
    return True


@kernel
def turn(direction, cosine, azimuth):
    """Rotate a unit vector by the angle with that cosine, around itself by `azimuth`."""
    x, y, z = direction[0], direction[1], direction[2]
    sine = math.sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0))
    # A frame without a singularity: Duff et al. (2017), JCGT 6, 1.
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u, v = sine * math.cos(azimuth), sine * math.sin(azimuth)
    direction[0] = cosine * x + u * (1.0 + sign * x * x * a) + v * b
    direction[1] = cosine * y + u * sign * b + v * (sign + y * y * a)
    direction[2] = cosine * z - u * sign * x - v * y
    norm = math.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    for d in range(3):
        direction[d] /= norm


@inlined
def guide_weights(scene, h, work):
    """Rough brightness above and below altitude h: 1 - exp(-2 tau) of the air on either side, and the ground's."""
    optics = scene.optics
    middle = optics.albedo.size // 2
    outward_columns(scene.columns, h, 1.0, work.spare)
    above, all_of_it = 0.0, 0.0
    for c in range(work.spare.size):
        above += work.spare[c] * optics.sigma_t[c, middle]
        all_of_it += scene.columns.cell[0, 6 + 8 * c] * optics.sigma_t[c, middle]
    up = 1.0 - math.exp(-2.0 * above)
    down = 1.0 - math.exp(-2.0 * max(all_of_it - above, 0.0)) + optics.albedo[middle]
    total = max(up + down, 1e-12)
    return up / total * 0.9 + 0.05, down / total * 0.9 + 0.05


@inlined
def mixture_cosine(optics, work):
    """Mean cosine of the mixture at a point, at the middle wavelength, between 0 and 0.9."""
    middle = optics.albedo.size // 2
    forward, total = 0.0, 0.0
    for c in range(work.density.size):
        scattering = work.density[c] * optics.sigma_s[c, middle]
        total += scattering
        forward += scattering * optics.mean_cosine[c]
    return min(max(forward / max(total, 1e-300), 0.0), 0.9)


@inlined
def mean_phase(optics, cosine, work, out):
    """Phase function of the mixture at a point [sr-1], into `out` (wavelength,)."""
    phase_at(optics.phase, min(max(cosine, -1.0), 1.0), work.phase)
    weigh_phase(work.phase, optics.sigma_s, work.weighted)
    mix_components(work.density, work.weighted, out)
    for i in range(out.size):
        out[i] /= max(work.scattering[i], 1e-300)


@kernel
def turn_by_phase(optics, hero, u, v, work, direction):
    """Turn a direction by the phase function of a component by which the hero is scattered at this point."""
    total = 0.0
    for c in range(work.density.size):
        total += work.density[c] * optics.sigma_s[c, hero]
    rest, chosen = u * total, 0
    for c in range(work.density.size):
        part = work.density[c] * optics.sigma_s[c, hero]
        if part > 0.0:
            chosen = c
            if rest < part:
                u = rest / part
                break
            rest -= part
    turn(direction, sample_cosine(optics, chosen, hero, min(u, 1.0)), 2.0 * math.pi * v)


@kernel
def sample_guide(walk, up, u, v):
    """A direction by the guide: above or below, then the zenith cosine m by 1 / (m + GUIDE_FLOOR)."""
    below = u >= up
    u = (u - up) / (1.0 - up) if below else u / up
    cosine = GUIDE_FLOOR * ((1.0 + GUIDE_FLOOR) / GUIDE_FLOOR) ** u - GUIDE_FLOOR
    x, d = walk.position, walk.direction
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for k in range(3):
        d[k] = x[k] / r
    turn(d, -cosine if below else cosine, 2.0 * math.pi * v)


@inlined
def guide_density(walk, up, down):
    """Density per solid angle [sr-1] with which `sample_guide` draws the walk's direction."""
    x, d = walk.position, walk.direction
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    cosine = (x[0] * d[0] + x[1] * d[1] + x[2] * d[2]) / r
    side = up if cosine > 0.0 else down
    return side / (2.0 * math.pi * (abs(cosine) + GUIDE_FLOOR) * GUIDE_LOG)


@kernel
def scatter(scene, hero, u, v, guided, work, walk):
    """New direction of the walk after scattering where it is, drawn in one of three ways.

    - by the phase function around the old direction;
    - by the phase function around the Sun, for that is where the light scattered once more comes from;
    - by a guide that knows that a sky is brightest near the horizon.

    Forward-peaked mixtures (by the mean cosine at the middle wavelength) rely on the first two, air on the third; a walk
    that is no longer `guided` on the first alone, so that its weight does not spread with every leg.
    The value takes the phase function of the mixture (it already holds the scattering coefficient), the chance of each
    hero the sum of the three densities: the choice of the way is integrated out.
    """
    optics, x, d, s = scene.optics, walk.position, walk.direction, scene.optics.disk_axis
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    h = r - scene.columns.radius
    densities(scene.columns, h, work.density)
    mix_components(work.density, optics.sigma_s, work.scattering)
    up, down = guide_weights(scene, h, work)
    g = mixture_cosine(optics, work)
    by_phase = LEAST_PHASE_SHARE + 0.8 * g if guided else 1.0
    by_sun = 0.15 * g if guided and x[0] * s[0] + x[1] * s[1] + x[2] * s[2] > LOWEST_SUN * r else 0.0
    old_x, old_y, old_z = d[0], d[1], d[2]
    if u < by_phase or not guided:
        turn_by_phase(optics, hero, u / by_phase, v, work, d)
    elif u < by_phase + by_sun:
        d[0], d[1], d[2] = s[0], s[1], s[2]
        turn_by_phase(optics, hero, (u - by_phase) / by_sun, v, work, d)
    else:
        sample_guide(walk, up, (u - by_phase - by_sun) / (1.0 - by_phase - by_sun), v)
    guide = (1.0 - by_phase - by_sun) * guide_density(walk, up, down)
    mean_phase(optics, old_x * d[0] + old_y * d[1] + old_z * d[2], work, work.towards)
    if by_sun > 0.0:
        mean_phase(optics, s[0] * d[0] + s[1] * d[1] + s[2] * d[2], work, work.source)
    for i in range(walk.value.size):
        around_sun = by_sun * work.source[i] if by_sun > 0.0 else 0.0
        walk.value[i] *= work.towards[i]
        walk.chance[i] *= by_phase * work.towards[i] + around_sun + guide


@kernel
def reflect(walk, u, v):
    """New direction after a Lambertian reflection: by the cosine, whose chance cancels the reflected share."""
    x, y, z = walk.position[0], walk.position[1], walk.position[2]
    r = math.sqrt(x * x + y * y + z * z)
    walk.direction[0], walk.direction[1], walk.direction[2] = x / r, y / r, z / r
    turn(walk.direction, math.sqrt(max(u, 1e-18)), 2.0 * math.pi * v)


@kernel
def move(walk, distance):
    """Advance the position along the direction."""
    for d in range(3):
        walk.position[d] += distance * walk.direction[d]


@kernel
def depart(walk, origin, direction):
    """Put the walk at the start of the camera's ray."""
    for d in range(3):
        walk.position[d], walk.direction[d] = origin[d], direction[d]


@kernel
def lift_to_ground(scene, walk):
    """Put the position exactly on the ground, which rounding may have missed."""
    r = math.sqrt(walk.position[0] ** 2 + walk.position[1] ** 2 + walk.position[2] ** 2)
    for d in range(3):
        walk.position[d] *= scene.columns.radius / r


@kernel
def choose_first(scene, line, camera, hero, work, walk):
    """Move to the point where the camera's ray is scattered or reflected; returns what is there."""
    k, share = draw_candidate(camera, hero, walk.even[1])
    if k < 0:
        return NOTHING
    if k == camera.point.size:
        move(walk, line.leave - line.start)
        for i in range(walk.value.size):
            walk.value[i], walk.chance[i] = camera.weight[k, i], camera.chance[k, i]
        return GROUND
    width = camera.edge[k + 1] - camera.edge[k]
    t = camera.edge[k] + share * width
    r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, scene.optics.sigma_t, work.through)
    densities(scene.columns, r - scene.columns.radius, work.density)
    mix_components(work.density, scene.optics.sigma_s, work.scattering)
    for i in range(walk.value.size):
        walk.value[i] = work.through[i] * work.scattering[i]
        walk.chance[i] = camera.chance[k, i] / width
    move(walk, t - line.start)
    return AIR


@kernel
def choose_next(line, leg, hero, u, walk):
    """Move to one of the candidates of a marched leg; returns what is there."""
    k, _ = draw_candidate(leg, hero, u)
    if k < 0:
        return NOTHING
    for i in range(walk.value.size):
        walk.value[i] *= leg.weight[k, i]
        walk.chance[i] *= leg.chance[k, i]
    if k == leg.point.size:
        move(walk, line.leave - line.start)
        return GROUND
    move(walk, leg.point[k] - line.start)
    return AIR


@kernel
def survives(walk, reference):
    """Russian roulette against the throughput after the first vertex; survivors carry the weight of the fallen."""
    largest = 0.0
    for i in range(walk.value.size):
        largest = max(largest, walk.value[i])
    q = min(1.0, largest / (ROULETTE_LEVEL * reference))
    if uniform(walk.state) >= q:
        return False
    for i in range(walk.value.size):
        walk.value[i] /= q
    return True


@kernel
def tally(walk, order, max_order, total, by_order):
    """Add the light of the current leg, which is the `order`-th of the walk, to the sums."""
    last = by_order.shape[0]
    for i in range(total.size):
        unscattered = walk.value[i] * walk.escape[i]
        scattered = walk.value[i] * walk.gain[i] if order < max_order else 0.0
        total[i] += unscattered + scattered
        if order <= last:
            by_order[order - 1, i] += unscattered
        if order + 1 <= last:
            by_order[order, i] += scattered


@inlined
def draw(walk, order, k):
    """Number k of the five that a leg needs: evenly spread on the first two legs, from the stream on later ones."""
    return walk.even[5 * order - 3 + k] if order <= 2 else uniform(walk.state)


@kernel
def wander(scene, line, camera, max_order, leg, work, camera_work, walk, total, by_order):
    """Follow a walk from the camera to its end and add up its light."""
    reference = 0.0
    last = max_order if scene.optics.glows else max_order - 1
    hero = min(int(walk.even[0] * walk.value.size), walk.value.size - 1)
    found = choose_first(scene, line, camera, hero, camera_work, walk)
    x, d = walk.position, walk.direction
    for order in range(1, last + 1):
        # Turn at the vertex.
        if found == NOTHING:
            return
        u, v = draw(walk, order, 0), draw(walk, order, 1)
        if found == GROUND:
            lift_to_ground(scene, walk)
            reflect(walk, u, v)
        else:
            scatter(scene, hero, u, v, order <= GUIDED_LEGS, work, walk)
        if not rebalance(walk):
            return
        if order == 1:
            for i in range(walk.value.size):
                reference = max(reference, walk.value[i])
        elif order >= FIRST_ROULETTE and not survives(walk, reference):
            return

        # March to the next.
        line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
        r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        cut_strata(line, mean_extinction(scene, r - scene.columns.radius, work), leg.edge)
        node = pick_sun(scene.optics, draw(walk, order, 2))
        march(scene, line, node, draw(walk, order, 3), order <= GUIDED_LEGS, leg, work, walk)
        tally(walk, order, max_order, total, by_order)
        finish_chances(leg)
        found = choose_next(line, leg, hero, draw(walk, order, 4), walk)


@kernel
def _statistics(sums, batches, walks_per_batch, mean, error):
    """Mean over batches and its standard error, each (wavelength,)."""
    for i in range(mean.size):
        m, square = 0.0, 0.0
        for b in range(batches):
            m += sums[b, i]
        m /= batches
        for b in range(batches):
            square += (sums[b, i] - m) ** 2
        mean[i] = m / walks_per_batch
        error[i] = math.sqrt(square / (batches * (batches - 1.0))) / walks_per_batch if batches > 1 else math.inf


@kernel
def _noise(error, mean, base):
    """Relative standard error, averaged over wavelengths where there is light."""
    noise, n = 0.0, 0
    for i in range(mean.size):
        if mean[i] + base[i] > 0.0:
            noise += error[i] / (mean[i] + base[i])
            n += 1
    return noise / max(n, 1)


@entry
def path_rays(
    scene, origins, directions, ids, base, seed, samples, noise, max_order, scratch, mean, error, by_order, used
):  # fmt: skip
    """Light of the second and higher orders along many rays (and of the first, of emission and light from outside).

    Parameters
    ----------
    scene : SceneTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers of the rays, by which their random streams are chosen.
    base : (ray, wavelength)
        Radiance that is known already and counts in the relative error.
    seed : int
    samples : int
        Walks per ray, at most; a multiple of `BATCHES`, or fewer than that.
    noise : float
        Stop when the relative standard error is below this; 0 to use all samples.
    max_order : int
        Highest order of scattering.
    scratch : tuple
        Made by `make_scratch` for this scene and number of samples.
    mean, error : (ray, wavelength), output
    by_order : (ray, order, wavelength), output
        Mean by number of scatterings and reflections, as far as there is room; order 1 excludes sunlight.
    used : (ray,) int64, output
    """
    work, camera_work, camera, leg, walk, sums, shift = scratch
    batches = sums.shape[0]
    first_goal = samples // batches if noise <= 0.0 else 1
    for ray in range(origins.shape[0]):
        o, d = origins[ray], directions[ray]
        used[ray] = 0
        for i in range(mean.shape[1]):
            mean[ray, i] = 0.0
            error[ray, i] = 0.0
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] = 0.0
        line = trace_line(scene.columns, o[0], o[1], o[2], d[0], d[1], d[2])
        # A ray that starts on the ground and looks down has no length, but light to reflect.
        if line.leave <= line.enter and not line.hits_ground:
            continue

        # The camera's ray is marched once for all its walks, through the middles of its strata.
        r = math.sqrt(line.p * line.p + line.enter * line.enter)
        cut_strata(line, mean_extinction(scene, r - scene.columns.radius, work), camera.edge)
        depart(walk, o, d)
        march(scene, line, np.int64(0), 0.5, True, camera, camera_work, walk)
        finish_chances(camera)
        for b in range(batches):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
            for i in range(mean.shape[1]):
                sums[b, i] = 0.0

        # Rounds of walks, each doubling their number, until the noise is low enough.
        done, goal = 0, first_goal
        while True:
            for b in range(batches):
                for n in range(done, goal):
                    start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                    even_point(shift[b], n, walk.even)
                    depart(walk, o, d)
                    wander(
                        scene, line, camera, max_order, leg, work, camera_work, walk, sums[b], by_order[ray]
                    )  # fmt: skip
            done = goal
            _statistics(sums, batches, done, mean[ray], error[ray])
            if done >= samples // batches or _noise(error[ray], mean[ray], base[ray]) <= noise:
                break
            goal = min(2 * done, samples // batches)
        used[ray] = done * batches
        for k in range(by_order.shape[1]):
            for i in range(mean.shape[1]):
                by_order[ray, k, i] /= used[ray]


def make_scratch(components: int, wavelengths: int, samples: int) -> tuple[Any, ...]:
    """Scratch arrays of `path_rays`; a thread needs its own."""
    batches = min(samples, BATCHES)
    return (
        make_work(components, wavelengths),
        make_work(components, wavelengths),
        make_leg(CAMERA_STRATA, wavelengths),
        make_leg(LEG_STRATA, wavelengths),
        make_walk(wavelengths),
        np.zeros((batches, wavelengths)),
        np.zeros((batches, EVEN_DIMENSIONS), np.uint32),
    )
