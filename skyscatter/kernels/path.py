"""All orders of scattering by backward random walks that carry the whole spectrum.

A walk starts where the camera's ray is scattered and goes from vertex to vertex.  Every leg is *marched*: the path is
cut into a few strata, and from the exact transmittance to a point in each follows the light that reaches the walk along
this leg after one more scattering of sunlight (next-event estimation at every point: an unbiased, stratified estimate
of the integral), by emission, from the ground and from outside.

The next vertex is drawn by free flight: the column along the leg is inverted, no collision is rejected, and a walk
whose leg ends in space is made to collide before.  On the first legs half of the vertices are drawn from the march,
uniformly within a stratum chosen by what it would hand on and by how sunlit it is; so sunlit air high above a dark
observer is reached.  The density of a vertex is the sum of both, whichever drew it.

One wavelength, the hero, drives the draws; the walk counts for all of them with the balance heuristic (Wilkie et al.
2014, Computer Graphics Forum 33, 123): value(lambda) / mean over heroes of their chances of this walk.  In the code F
is the walk's value and P its chance under each hero, both divided by the mean chance, so that F alone is the weighted
throughput.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.directions import turn
from skyscatter.kernels.eclipse import dim
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.lookup import (
    columns_along,
    columns_to_light,
    densities,
    outward_columns,
    sort_few,
    start_columns,
    trace_line,
)
from skyscatter.kernels.optics import (
    ground_row,
    mix_components,
    phase_at,
    sample_cosine,
    transmittance,
    weigh_phase,
)
from skyscatter.kernels.polar import (
    arriving,
    begin,
    depolarise,
    face_sun,
    gather,
    light_up,
    polarise,
    tally_polarisation,
)
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.work import make_work

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
#: Share of the directions drawn around the Sun by a phase function that only goes forward; after the ground.
SUN_SHARE, GROUND_SUN_SHARE = 0.22, 0.5
#: Cosine of the Sun's zenith angle below which no direction is drawn around it.
LOWEST_SUN = -0.05
#: Share of the vertices that are drawn from the march on those legs.
MARCHED_SHARE = 0.5
#: Legs on which vertices and directions are chosen with an eye to where the light is.  Each such choice spreads the
#: weight of the walk; the first ones carry most of the light and are worth it.
GUIDED_LEGS = 2
#: Squared deviation of the highest of 16 batches, in variances, that normal ones exceed in two of five cases.
STANDS_OUT = 3.6
#: Russian roulette begins at this vertex.
FIRST_ROULETTE = 3
#: Share of plain walks that come as far from the first vertex below which it begins.
ROULETTE_LEVEL = 0.3


@by_address
class Leg(NamedTuple):
    """A marched leg."""

    edge: np.ndarray  #: (stratum + 1,) distances t of the strata [m]
    chance: np.ndarray  #: (stratum + 1, wavelength) chance of a stratum, and of the ground, under each hero
    total: np.ndarray  #: (wavelength,) sum of the chances before they are divided by it
    through: np.ndarray  #: (wavelength,) transmittance of the whole leg
    lost: np.ndarray  #: (wavelength,) what is scattered or absorbed on it, 1 - through without loss of digits
    ground: np.ndarray  #: (wavelength,) chance that a free flight goes on to the ground
    albedo: np.ndarray  #: (wavelength,) of the ground where the leg meets it; zero if it does not


@by_address
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
    worth: np.ndarray  #: (1,) share of plain walks that would have come as far from the first vertex


def make_leg(strata: int, wavelengths: int) -> Leg:
    """An empty leg."""
    return Leg(
        np.zeros(strata + 1), np.zeros((strata + 1, wavelengths)), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
    )  # fmt: skip


def make_walk(wavelengths: int) -> Walk:
    """An empty walk."""
    return Walk(
        np.zeros(3), np.zeros(3), np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths), np.zeros(EVEN_DIMENSIONS), np.zeros(1, np.uint64),
        np.zeros(1),
    )  # fmt: skip


@inlined
def depth_at(scene, line, t, i, work):
    """Optical depth at wavelength number i from the entry of the line to t."""
    columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    tau = 0.0
    for c in range(work.along.size):
        tau += work.along[c] * scene.optics.sigma_t[c, i]
    return tau


@kernel
def fly(scene, line, i, tau, work):
    """Distance t at which the optical depth at wavelength number i reaches tau: Newton's steps within a bracket."""
    low, high = line.enter, line.leave
    t = low
    for _ in range(60):
        miss = depth_at(scene, line, t, i, work) - tau
        if miss < 0.0:
            low = t
        else:
            high = t
        if abs(miss) < 1e-9 * (1.0 + tau) or high - low < 1e-12 * (line.leave - line.enter):
            break
        densities(scene.columns, math.sqrt(line.p * line.p + t * t) - scene.columns.radius, work.density)
        sigma = 0.0
        for c in range(work.density.size):
            sigma += work.density[c] * scene.optics.sigma_t[c, i]
        t = t - miss / sigma if sigma > 0.0 else high
        if not low < t < high:
            t = 0.5 * (low + high)
    return t


@kernel
def find_albedo(ground, x, y, z, out):
    """Albedo of mapped ground at a point, into `out` (wavelength,)."""
    row = ground_row(ground, x, y, z)
    for i in range(out.size):
        out[i] = ground.albedo[row, i]


@merged
def prepare_leg(scene, ground, line, walk, leg, work):
    """Transmittance of the leg on which a walk sets out, the chances of a free flight along it, and its strata."""
    optics, middle = scene.optics, scene.optics.albedo.size // 2
    for i in range(leg.albedo.size):
        leg.albedo[i] = optics.albedo[i] if line.hits_ground else 0.0
    if ground.cells.size > 0 and line.hits_ground:
        x, d, t = walk.position, walk.direction, line.leave - line.start
        find_albedo(ground, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], leg.albedo)
    start_columns(scene.columns, line, work.from_start, work.across)
    columns_along(scene.columns, line, line.leave, work.from_start, work.across, work.along)
    transmittance(work.along, optics.sigma_t, leg.through)
    mix_components(work.along, optics.sigma_t, leg.lost)
    depth = leg.lost[middle]
    for i in range(leg.lost.size):
        tau = leg.lost[i]
        leg.lost[i] = 1.0 - leg.through[i] if tau > 1e-4 else tau * (1.0 - 0.5 * tau)
        onward = leg.through[i] * leg.albedo[i]
        leg.ground[i] = onward / max(onward + leg.lost[i], 1e-300)
    cut_strata(scene, line, depth, middle, leg.edge, work)


@kernel
def cut_strata(scene, line, depth, middle, edge, work):
    """Cut a line into strata: half of the cuts by geometry, half by optical depth.

    Air is dense where the line is lowest, so distances from there grow as the power 2.5 of the stratum's number; and
    light comes from within an optical depth of 1 from the start, `depth` being that of the line at the middle
    wavelength.  Any cuts give an unbiased march; these make it quiet.
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
    for k in range(1, n_before + 1):
        edge[n] = low - before * (k / (n_before + 1.0)) ** 2.5
        n += 1
    for k in range(1, n_after + 1):
        edge[n] = low + after * (k / (n_after + 1.0)) ** 2.5
        n += 1
    cuts = strata - 1 - n
    lost = 1.0 - math.exp(-depth)
    for k in range(1, cuts + 1):
        x = k / (cuts + 1.0)
        # Thin lines are as good as evenly lit; thick ones are cut where the light has actually gone.
        edge[n] = line.enter + length * x if depth < 0.5 else fly(scene, line, middle, -math.log(1.0 - x * lost), work)
        n += 1
    edge[n], edge[n + 1] = line.enter, line.leave
    sort_few(edge, n + 2)


@inlined
def light_at(scene, r, x_sun, work):
    """Transmittance towards one direction to the Sun, into ``work.sun``; False in the shadow."""
    mu_s = min(max(x_sun / r, -1.0), 1.0)
    if not columns_to_light(scene.columns, r, mu_s, work.spare, work.to_sun):
        return False
    transmittance(work.to_sun, scene.optics.sigma_t, work.sun)
    return True


@kernel
def cover(scene, line, t, walk, work):
    """What the Moon leaves of the sunlight ``work.sun`` at a distance t of the leg on which a walk sets out."""
    x, d, go = walk.position, walk.direction, t - line.start
    dim(scene.eclipse, x[0] + go * d[0], x[1] + go * d[1], x[2] + go * d[2], work.sun)


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
def march(scene, line, node, u, guided, leg, work, walk, polar):
    """March a prepared leg: its light into ``walk.gain`` and ``walk.escape``, if `guided` the chances of its strata.

    The points lie at the same fraction `u` of every stratum.  Sunlight comes from the one point `node` of the solar
    disk, drawn by its share and so standing for the whole.
    """
    optics = scene.optics
    wavelengths = optics.albedo.size
    s = optics.sun_direction[node]
    x, d = walk.position, walk.direction
    a = d[0] * s[0] + d[1] * s[1] + d[2] * s[2]
    q = x[0] * s[0] + x[1] * s[1] + x[2] * s[2]
    phase_at(optics.phase, a, work.phase)
    weigh_phase(work.phase, optics.sigma_s, work.weighted)
    face_sun(polar, optics.sigma_s, d, s, a)
    for i in range(wavelengths):
        walk.gain[i], walk.escape[i], leg.total[i] = 0.0, 0.0, 0.0
    for k in range(leg.edge.size - 1):
        width = leg.edge[k + 1] - leg.edge[k]
        t = leg.edge[k] + width * u
        r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
        transmittance(work.along, optics.sigma_t, work.through)
        densities(scene.columns, r - scene.columns.radius, work.density)
        if not light_at(scene, r, q + (t - line.start) * a, work):
            for i in range(wavelengths):
                work.sun[i] = 0.0
        elif scene.eclipse.share.size > 0:
            cover(scene, line, t, walk, work)
        mix_components(work.density, work.weighted, work.towards)
        for i in range(wavelengths):
            walk.gain[i] += width * work.through[i] * work.towards[i] * work.sun[i]
        gather(polar, work.density, width, work.through, work.sun)
        if guided:
            mix_components(work.density, optics.sigma_s, work.scattering)
            for i in range(wavelengths):
                leg.chance[k, i] = width * work.through[i] * work.scattering[i] * (DARK_SHARE + work.sun[i])
                leg.total[i] += leg.chance[k, i]
        if optics.emits:
            mix_components(work.density, optics.emission, work.emitted)
            for i in range(wavelengths):
                walk.escape[i] += width * work.through[i] * work.emitted[i]
    for i in range(wavelengths):
        walk.gain[i] *= optics.sun_irradiance[node, i] / optics.sun_chance[node]
    light_up(polar, optics.sun_irradiance, node, optics.sun_chance[node])
    _march_end(scene, line, node, q + (line.leave - line.start) * a, guided, leg, work, walk)


@merged
def _march_end(scene, line, node, x_sun, guided, leg, work, walk):
    """The end of a marched leg: reflected sunlight or light from outside, and the chances made to sum to 1."""
    optics = scene.optics
    last = leg.edge.size - 1
    mu_s = x_sun / scene.columns.radius
    if not line.hits_ground:
        for i in range(optics.albedo.size):
            walk.escape[i] += leg.through[i] * optics.background[i]
    elif mu_s <= 0.0 or not light_at(scene, scene.columns.radius, x_sun, work):
        for i in range(optics.albedo.size):
            work.sun[i] = 0.0
    elif scene.eclipse.share.size > 0:
        cover(scene, line, line.leave, walk, work)
    for i in range(optics.albedo.size):
        reach = leg.through[i] * leg.albedo[i]
        irradiance = work.sun[i] * mu_s * optics.sun_irradiance[node, i] / optics.sun_chance[node]
        walk.gain[i] += reach * irradiance / math.pi
        leg.chance[last, i] = reach * (DARK_SHARE + work.sun[i])
        leg.total[i] += leg.chance[last, i]
    if guided:
        for k in range(last + 1):
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
    total = up + down
    above_share = 0.05 + 0.9 * up / total if total > 0.0 else 0.5
    return above_share, 1.0 - above_share


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


@inlined
def sight_of_sun(scene, r, x_sun, work):
    """Fourth root of the transmittance towards the Sun at the middle wavelength.

    A walk that meets the bright sky around the Sun by chance outshines thousands of others, so its directions are drawn
    from the first vertex to the last.  Where the Sun is dim this costs more than it helps: all other directions then
    are drawn too rarely, and over many orders their weights grow.
    """
    if not columns_to_light(scene.columns, r, min(max(x_sun / r, -1.0), 1.0), work.spare, work.to_sun):
        return 0.0
    depth, middle = 0.0, scene.optics.albedo.size // 2
    for c in range(work.to_sun.size):
        depth += work.to_sun[c] * scene.optics.sigma_t[c, middle]
    return math.exp(-0.25 * depth)


@kernel
def scatter(scene, hero, u, v, guided, work, walk, polar):
    """New direction of the walk after scattering where it is, drawn in one of three ways.

    - by the phase function around the old direction;
    - by the phase function around the Sun, for that is where the light scattered once more comes from (on all legs);
    - by a guide that knows that a sky is brightest near the horizon.

    Forward-peaked mixtures (by the mean cosine at the middle wavelength) rely on the first two, air on the third; a
    walk that is no longer `guided` leaves the third out, so that its weight does not spread with every leg.
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
    x_sun = x[0] * s[0] + x[1] * s[1] + x[2] * s[2]
    by_sun = SUN_SHARE * g if x_sun > LOWEST_SUN * r else 0.0
    if by_sun > 0.0 and not guided:
        by_sun *= sight_of_sun(scene, r, x_sun, work)
    by_phase = LEAST_PHASE_SHARE + 0.8 * g if guided else 1.0 - by_sun
    old_x, old_y, old_z = d[0], d[1], d[2]
    if u < by_phase:
        turn_by_phase(optics, hero, u / by_phase, v, work, d)
    elif u < by_phase + by_sun or not guided:
        d[0], d[1], d[2] = s[0], s[1], s[2]
        turn_by_phase(optics, hero, min((u - by_phase) / by_sun, 1.0), v, work, d)
    else:
        sample_guide(walk, up, (u - by_phase - by_sun) / (1.0 - by_phase - by_sun), v)
    guide = (1.0 - by_phase - by_sun) * guide_density(walk, up, down) if guided else 0.0
    mean_phase(optics, old_x * d[0] + old_y * d[1] + old_z * d[2], work, work.towards)
    if by_sun > 0.0:
        mean_phase(optics, s[0] * d[0] + s[1] * d[1] + s[2] * d[2], work, work.source)
    for i in range(walk.value.size):
        around_sun = by_sun * work.source[i] if by_sun > 0.0 else 0.0
        walk.value[i] *= work.towards[i]
        walk.chance[i] *= by_phase * work.towards[i] + around_sun + guide
    polarise(polar, optics.sigma_s, work.density, old_x, old_y, old_z, d)


@kernel
def reflect(walk, u, v):
    """New direction after a Lambertian reflection: by the cosine, whose chance cancels the reflected share."""
    x, y, z = walk.position[0], walk.position[1], walk.position[2]
    r = math.sqrt(x * x + y * y + z * z)
    walk.direction[0], walk.direction[1], walk.direction[2] = x / r, y / r, z / r
    turn(walk.direction, math.sqrt(max(u, 1e-18)), 2.0 * math.pi * v)


@kernel
def leave_ground(scene, hero, u, v, work, walk):
    """New direction after a Lambertian reflection: by the cosine, or around the Sun as the air between scatters.

    Seen from the ground forward-scattering air is brightest around the Sun, and the cosine alone finds that by chance.
    The value takes the share that is reflected, the chance of each hero the sum of both densities.
    """
    optics, x, d, s = scene.optics, walk.position, walk.direction, scene.optics.disk_axis
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    x_sun = x[0] * s[0] + x[1] * s[1] + x[2] * s[2]
    by_sun = sight_of_sun(scene, r, x_sun, work) if x_sun > 0.0 else 0.0
    if by_sun > 0.0:
        for c in range(work.density.size):
            work.density[c] = work.to_sun[c]  # the mixture of the whole way
        by_sun *= GROUND_SUN_SHARE * mixture_cosine(optics, work)
    if u >= by_sun:
        reflect(walk, (u - by_sun) / (1.0 - by_sun), v)
    else:
        d[0], d[1], d[2] = s[0], s[1], s[2]
        turn_by_phase(optics, hero, u / by_sun, v, work, d)
    if by_sun <= 0.0:
        return
    reflected = max(x[0] * d[0] + x[1] * d[1] + x[2] * d[2], 0.0) / (math.pi * r)
    mix_components(work.density, optics.sigma_s, work.scattering)
    mean_phase(optics, s[0] * d[0] + s[1] * d[1] + s[2] * d[2], work, work.source)
    for i in range(walk.value.size):
        walk.value[i] *= reflected
        walk.chance[i] *= (1.0 - by_sun) * reflected + by_sun * work.source[i] if reflected > 0.0 else 0.0


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
def choose(scene, line, leg, hero, u, guided, work, walk):
    """Draw the end of a leg and move there; value and chances take it.  Returns what is there."""
    last = leg.edge.size - 1
    marched = MARCHED_SHARE if guided and leg.total[hero] > 0.0 else 0.0
    k = -1
    if u < marched:
        k, share = draw_candidate(leg, hero, u / marched)
        if k < 0:
            return NOTHING
        t = leg.edge[k] + share * (leg.edge[k + 1] - leg.edge[k]) if k < last else line.leave
    else:
        u = (u - marched) / (1.0 - marched)
        if u < leg.ground[hero]:
            k = last
            t = line.leave
        elif leg.lost[hero] <= 0.0:
            return NOTHING
        else:
            u = (u - leg.ground[hero]) / (1.0 - leg.ground[hero])
            t = fly(scene, line, hero, -math.log1p(-u * leg.lost[hero]), work)

    if k == last:
        for i in range(walk.value.size):
            from_march = MARCHED_SHARE * leg.chance[last, i] if guided and leg.total[i] > 0.0 else 0.0
            flown = 1.0 - MARCHED_SHARE if guided and leg.total[i] > 0.0 else 1.0
            walk.value[i] *= leg.through[i] * leg.albedo[i]
            walk.chance[i] *= from_march + flown * leg.ground[i]
        worth = 0.0
        for i in range(walk.value.size):
            worth = max(worth, leg.lost[i] + leg.through[i] * leg.albedo[i])
        walk.worth[0] *= worth
        move(walk, line.leave - line.start)
        return GROUND

    r = columns_along(scene.columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, scene.optics.sigma_t, work.through)
    densities(scene.columns, r - scene.columns.radius, work.density)
    mix_components(work.density, scene.optics.sigma_s, work.scattering)
    mix_components(work.density, scene.optics.sigma_t, work.towards)
    k = 0
    while k < last - 1 and leg.edge[k + 1] <= t:
        k += 1
    worth = 0.0
    per_width = 1.0 / max(leg.edge[k + 1] - leg.edge[k], 1e-300)
    for i in range(walk.value.size):
        from_march = MARCHED_SHARE * leg.chance[k, i] * per_width if guided and leg.total[i] > 0.0 else 0.0
        flown = 1.0 - MARCHED_SHARE if guided and leg.total[i] > 0.0 else 1.0
        collision = work.through[i] * work.towards[i] / max(leg.lost[i], 1e-300)
        walk.value[i] *= work.through[i] * work.scattering[i]
        walk.chance[i] *= from_march + flown * (1.0 - leg.ground[i]) * collision
        met = leg.lost[i] + leg.through[i] * leg.albedo[i]
        worth = max(worth, met * work.scattering[i] / max(work.towards[i], 1e-300))
    walk.worth[0] *= worth
    move(walk, t - line.start)
    return AIR


@merged
def survives(walk):
    """Russian roulette by how many plain walks would have come so far; survivors carry the weight of the fallen.

    Not by the throughput: that is small where directions are drawn more often than they occur, towards the Sun, and
    those walks are the ones that matter.
    """
    q = min(1.0, walk.worth[0] / ROULETTE_LEVEL)
    if uniform(walk.state) >= q:
        return False
    walk.worth[0] /= q
    for i in range(walk.value.size):
        walk.value[i] /= q
    return True


@merged
def tally(walk, polar, order, max_order, total, by_order):
    """Add the light of the current leg, which is the `order`-th of the walk, to the sums."""
    last = by_order.shape[0]
    sunlit = 1.0 if order < max_order else 0.0
    tally_polarisation(polar, walk, sunlit)
    for i in range(total.size):
        unscattered = walk.value[i] * arriving(polar, 0, i, walk.escape[i], 0.0)
        scattered = walk.value[i] * arriving(polar, 0, i, walk.gain[i], 1.0) if order < max_order else 0.0
        total[i] += unscattered + scattered
        if order <= last:
            by_order[order - 1, i] += unscattered
        if order + 1 <= last:
            by_order[order, i] += scattered


@inlined
def draw(walk, order, k):
    """Number k of the five that a leg needs: evenly spread on the first two legs, from the stream on later ones."""
    return walk.even[5 * order - 3 + k] if order <= 2 else uniform(walk.state)


@merged
def wander(scene, ground, line, camera, max_order, leg, work, camera_work, walk, polar, total, by_order):
    """Follow a walk from the camera to its end and add up its light."""
    last = max_order if scene.optics.glows else max_order - 1
    hero = min(int(walk.even[0] * walk.value.size), walk.value.size - 1)
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    found = choose(scene, line, camera, hero, walk.even[1], GUIDED_LEGS > 0, camera_work, walk)
    x, d = walk.position, walk.direction
    for order in range(1, last + 1):
        # Turn at the vertex.
        if found == NOTHING:
            return
        u, v = draw(walk, order, 0), draw(walk, order, 1)
        if found == GROUND:
            lift_to_ground(scene, walk)
            leave_ground(scene, hero, u, v, work, walk)
            depolarise(polar, d)
        else:
            scatter(scene, hero, u, v, order <= GUIDED_LEGS, work, walk, polar)
        if not rebalance(walk):
            return
        if order == 1:
            walk.worth[0] = 1.0
        elif order >= FIRST_ROULETTE and not survives(walk):
            return

        # March to the next.
        line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
        prepare_leg(scene, ground, line, walk, leg, work)
        guided = order <= GUIDED_LEGS
        node = pick_sun(scene.optics, draw(walk, order, 2))
        march(scene, line, node, draw(walk, order, 3), guided, leg, work, walk, polar)
        tally(walk, polar, order, max_order, total, by_order)
        found = choose(scene, line, leg, hero, draw(walk, order, 4), guided, work, walk)


@merged
def statistics(sums, batches, walks_per_batch, mean, error):
    """Mean over batches and its standard error, each (wavelength,).

    A batch that stands out says that walks like it are rare, and that their share is known no better than by counting:
    what exceeds the spread that even batches have counts twice.
    """
    for i in range(mean.size):
        m, square, highest = 0.0, 0.0, sums[0, i]
        for b in range(batches):
            m += sums[b, i]
            highest = max(highest, sums[b, i])
        m /= batches
        for b in range(batches):
            square += (sums[b, i] - m) ** 2
        if batches > 1:
            square += max((highest - m) ** 2 - STANDS_OUT * square / (batches - 1.0), 0.0)
        mean[i] = m / walks_per_batch
        error[i] = math.sqrt(square / (batches * (batches - 1.0))) / walks_per_batch if batches > 1 else math.inf


@merged
def copy_sums(of, to):
    """Copy sums (batch, wavelength)."""
    for b in range(of.shape[0]):
        for i in range(of.shape[1]):
            to[b, i] = of[b, i]


@merged
def relative_noise(error, mean, base):
    """Relative standard error, averaged over wavelengths where there is light."""
    noise, n = 0.0, 0
    for i in range(mean.size):
        if mean[i] + base[i] > 0.0:
            noise += error[i] / (mean[i] + base[i])
            n += 1
    return noise / max(n, 1)


@entry
def path_rays(
    scene, ground, origins, directions, ids, base, seed, samples, first, kept, noise, max_order, scratch, polar,
    mean, error, by_order, used,
):  # fmt: skip
    """Light of the second and higher orders along many rays (and of the first, of emission and light from outside).

    Parameters
    ----------
    scene : SceneTable
    ground : GroundTable
    origins, directions : (ray, 3)
    ids : (ray,) int64
        Numbers of the rays, by which their random streams are chosen.
    base : (ray, wavelength)
        Radiance that is known already and counts in the relative error.
    seed : int
    samples : int
        Walks per ray, at most; a multiple of `BATCHES`, or fewer than that.
    first : int
        Walks of each batch that were made before, whose sums are in `kept` and `by_order`.
    kept : (ray, 1 or 4, batch, wavelength)
        Sums over the walks, of polarised light those of Q, U and V as well; added to.
    noise : float
        Stop when the relative standard error is below this; 0 to use all samples.
    max_order : int
        Highest order of scattering.
    scratch : tuple
        Made by `make_scratch` for this scene and number of samples.
    polar : Polar or None
        Where polarisation is asked for, its scratch and its output; `mean` then is that of polarised light.
    mean, error : (ray, wavelength), output
    by_order : (ray, order, wavelength), output
        Sum over the walks by number of scatterings and reflections, as far as there is room; order 1 excludes sunlight.
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
        line = trace_line(scene.columns, o[0], o[1], o[2], d[0], d[1], d[2])
        # A ray that starts on the ground and looks down has no length, but light to reflect.
        if line.leave <= line.enter and not line.hits_ground:
            continue

        # The camera's ray is marched once for all its walks, through the middles of its strata.
        depart(walk, o, d)
        prepare_leg(scene, ground, line, walk, camera, camera_work)
        begin(polar, ray, 0)
        march(scene, line, np.int64(0), 0.5, GUIDED_LEGS > 0, camera, camera_work, walk, polar)
        if polar is not None:
            for k in range(3):
                copy_sums(kept[ray, k + 1], polar.sums[k])
        for b in range(batches):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
        copy_sums(kept[ray, 0], sums)

        # Rounds of walks, each doubling their number, until the noise is low enough.
        done, goal = first, max(first, first_goal)
        while True:
            # Walk by walk over the batches: walks that are added later come after all that were made before.
            for n in range(done, goal):
                for b in range(batches):
                    start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                    even_point(shift[b], n, walk.even)
                    depart(walk, o, d)
                    begin(polar, ray, b)
                    wander(
                        scene, ground, line, camera, max_order, leg, work, camera_work, walk, polar, sums[b],
                        by_order[ray],
                    )  # fmt: skip
            done = goal
            statistics(sums, batches, done, mean[ray], error[ray])
            if done >= samples // batches or relative_noise(error[ray], mean[ray], base[ray]) <= noise:
                break
            goal = min(2 * done, samples // batches)
        used[ray] = done * batches
        copy_sums(sums, kept[ray, 0])
        if polar is not None:
            for k in range(3):
                copy_sums(polar.sums[k], kept[ray, k + 1])
                statistics(polar.sums[k], batches, done, polar.mean[ray, k], polar.error[ray, k])


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
