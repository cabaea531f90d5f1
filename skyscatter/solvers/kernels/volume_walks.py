"""All orders of scattering in three dimensions by backward random walks that carry the whole spectrum.

The camera's ray is a *leg*, and so is every flight between two scatterings.  A leg is cut into strata: half take equal
angles as seen from the star that matters most (equi-angular sampling: Kulla & Fajardo 2012, Computer Graphics
Forum 31, 1519), half equal steps.  Columns to their edges, and the guide's guess of the light there, say how much each
stratum would hand on.  From these chances come

- a few points at which the light of every star is fetched (next-event estimation), by the guess of direct light;
- the next vertex, which always lies inside the medium (forced scattering), by the guess of all light.  As the guess
  rises towards the stars, flights in their direction are stretched and others shortened: the bias towards the source
  that optically deep media need (exponential transform; Dwivedi 1982, Ann. Nucl. Energy 9, 359).

Within a stratum the point is drawn from the exponential that joins the values at both edges.  Directions come from the
phase function, uniformly in the angle from a star (which takes away the last singularity of the light near stars), and
for deep vertices by Dwivedi's law 1 / (nu_0 - mu); the density of a direction is the sum of all three.

One wavelength, the hero, drives the draws and all of them count by the balance heuristic, as in `kernels.path`: there
and here F is the walk's value, P its chance under each hero, both divided by the mean chance.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skyscatter.solvers.kernels.gridwalk import Walker, make_walker
from skyscatter.solvers.kernels.jit import entry, inlined, kernel, merged
from skyscatter.solvers.kernels.lookup import sort_few
from skyscatter.solvers.kernels.optics import mix_components, phase_at, sample_cosine, transmittance
from skyscatter.solvers.kernels.path import (
    BATCHES,
    Walk,
    make_walk,
    rebalance,
    relative_noise,
    statistics,
    turn,
)
from skyscatter.solvers.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.solvers.kernels.space import clip_to_space, space_columns, space_densities
from skyscatter.solvers.kernels.tracking import QUADRATURE, light_reaching
from skyscatter.solvers.kernels.volume import (
    VolumeTable,
    VolumeWork,
    depth_at,
    face_light,
    guess_light,
    guide_columns,
    least_depth,
    make_volume_work,
)

#: Strata of the camera's ray and of a leg of a walk; even numbers.
CAMERA_STRATA, LEG_STRATA = 32, 8
#: Points of a leg at which the light of the stars is fetched.
LIT_POINTS = 2
#: Optical depth at the most transparent wavelength at which a leg ends.
DARK = 40.0
#: Exponent of the light in the depths below which flights are exact.
SLOW = 0.4
#: Depth of its first stratum beyond which a dark leg is cut anew.
COARSE = 1.0
#: Optical depth at which a star is deep; shares of the guess of directions that are uniform in the angle from a star
#: near it, and by Dwivedi's law where it is deep.  The rest is isotropic.
DEEP, STAR_SHARE, DEEP_SHARE = 4.0, 0.6, 0.9
#: Candidates from which a direction is chosen.
CANDIDATES = 8
#: Roulette begins where a walk promises less than this share of what it did at its first vertex.
ROULETTE_LEVEL = 0.3
#: No stratum's values differ by more than exp(this) from edge to edge as far as the draw is concerned.
STEEPEST = 40.0


class VolumeLeg(NamedTuple):
    """A leg with its strata."""

    edge: np.ndarray  #: (stratum + 1,) distances [m]
    column: np.ndarray  #: (stratum + 1, component) columns from the start of the leg [m]
    vertex: np.ndarray  #: (stratum, wavelength) chance that the next vertex lies in a stratum, under each hero
    light: np.ndarray  #: (stratum, wavelength) the same for the points at which light is fetched
    vertex_rim: np.ndarray  #: (stratum + 1, wavelength) transmittance times guess of all light
    light_rim: np.ndarray  #: (stratum + 1, wavelength) transmittance times guess of the direct light
    escape: np.ndarray  #: (wavelength,) emission along the leg and background at its end
    total: np.ndarray  #: (2, wavelength)
    draw: np.ndarray  #: (wavelength,) density [m-1] of a drawn point under each hero


class WalkScratch(NamedTuple):
    """Scratch arrays of `volume_path_rays`."""

    work: VolumeWork
    walker: Walker | None  #: None where transmittances come from columns
    camera: VolumeLeg
    leg: VolumeLeg
    lights: np.ndarray  #: (light, 4) direction to a light and its share of the direct light
    walk: Walk
    sums: np.ndarray  #: (batch, wavelength)
    shift: np.ndarray  #: (batch, dimension) uint32


def make_volume_leg(strata: int, components: int, wavelengths: int) -> VolumeLeg:
    """An empty leg."""
    return VolumeLeg(
        np.zeros(strata + 1), np.zeros((strata + 1, components)), np.zeros((strata, wavelengths)),
        np.zeros((strata, wavelengths)), np.zeros((strata + 1, wavelengths)), np.zeros((strata + 1, wavelengths)),
        np.zeros(wavelengths), np.zeros((2, wavelengths)), np.zeros(wavelengths),
    )  # fmt: skip


def make_walk_scratch(components: int, wavelengths: int, lights: int, samples: int, tracked: bool) -> WalkScratch:
    """Scratch arrays of `volume_path_rays`; a thread needs its own."""
    batches = min(samples, BATCHES)
    return WalkScratch(
        make_volume_work(components, wavelengths), make_walker() if tracked else None,
        make_volume_leg(CAMERA_STRATA, components, wavelengths),
        make_volume_leg(LEG_STRATA, components, wavelengths), np.zeros((lights, 4)), make_walk(wavelengths),
        np.zeros((batches, wavelengths)), np.zeros((batches, EVEN_DIMENSIONS), np.uint32),
    )  # fmt: skip


@kernel
def main_light(v, x, d, start, end):
    """The point light that should shine brightest on a line, and the distance at which the line is nearest to it."""
    best, chosen, place, apart = 0.0, -1, 0.0, 0.0
    middle = v.power.shape[1] // 2
    for k in range(v.power.shape[0]):
        if v.distant[k]:
            continue
        a, b, c = v.place[k, 0] - x[0], v.place[k, 1] - x[1], v.place[k, 2] - x[2]
        near = min(max(a * d[0] + b * d[1] + c * d[2], start), end)
        a, b, c = a - near * d[0], b - near * d[1], c - near * d[2]
        q = math.sqrt(a * a + b * b + c * c)
        # Irradiance integrated along a line goes as 1 / distance.
        bright = v.power[k, middle] / max(q, v.size[k], 1e-9 * (end - start))
        if bright > best:
            best, chosen, place, apart = bright, k, a * d[0] + b * d[1] + c * d[2] + near, q
    return chosen, place, max(apart, 1e-6 * (end - start))


@kernel
def cut_leg(v, x, d, start, end, uniformly, edge):
    """Edges of the strata of a leg: equal angles around the main light, and steps that are equal or grow."""
    strata = edge.size - 1
    chosen, near, apart = main_light(v, x, d, start, end)
    n = 0
    steps = strata
    if chosen >= 0:
        steps = strata // 2
        low, high = math.atan((start - near) / apart), math.atan((end - near) / apart)
        for k in range(1, strata - steps + 1):
            t = near + apart * math.tan(low + (high - low) * k / (strata - steps + 1.0))
            edge[n] = min(max(t, start), end)
            n += 1
    for k in range(1, steps):
        share = k / (steps + 0.0)
        edge[n] = start + (end - start) * (share if uniformly else share * share)
        n += 1
    edge[n], edge[n + 1] = start, end
    sort_few(edge, n + 2)


@kernel
def visible_end(v, x, d, start, end, work):
    """Where a leg ends: at the edge of the medium, or where even the most transparent wavelength is gone."""
    step, t = (end - start) / 64.0, start
    for c in range(work.along.size):
        work.along[c] = 0.0
    while True:
        onward = min(t + step, end)
        space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], t, onward, work.space, work.along)
        t = onward
        if t >= end or least_depth(v, work.along) > DARK:
            return t
        step *= 2.0


@kernel
def fill_columns_of_leg(v, x, d, leg, work):
    """Columns from the start of a leg to the edges of its strata."""
    for c in range(work.along.size):
        work.along[c] = 0.0
    for k in range(leg.edge.size):
        if k > 0:
            before, t = leg.edge[k - 1], leg.edge[k]
            space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], before, t, work.space, work.along)
        for c in range(work.along.size):
            leg.column[k, c] = work.along[c]


@kernel
def prepare_volume_leg(v, x, d, start, end, camera, u, leg, work):
    """Cut a leg and fill its columns, chances and, for later legs, its escaping light; False if it meets nothing."""
    last = leg.edge.size - 1
    wavelengths = leg.draw.size
    cut_leg(v, x, d, start, end, camera, leg.edge)
    fill_columns_of_leg(v, x, d, leg, work)
    if least_depth(v, leg.column[1]) > COARSE and least_depth(v, leg.column[last]) > DARK:
        # The leg goes on in the dark for long: its strata belong to where there is light.
        cut_leg(v, x, d, start, visible_end(v, x, d, start, end, work), camera, leg.edge)
        fill_columns_of_leg(v, x, d, leg, work)
    for i in range(wavelengths):
        leg.total[0, i], leg.total[1, i], leg.escape[i] = 0.0, 0.0, 0.0
    for k in range(last + 1):
        t = leg.edge[k]
        transmittance(leg.column[k], v.sigma_t, work.through)
        guess_light(
            v, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work, leg.light_rim[k], leg.vertex_rim[k]
        )  # fmt: skip
        for i in range(wavelengths):
            leg.light_rim[k, i] *= work.through[i]
            leg.vertex_rim[k, i] *= work.through[i]
        if k > 0:
            weigh_stratum(v, k - 1, leg)
    if v.glows and not camera:
        gather_escape(v, x, d, u, leg, work)
    found = 0.0
    for i in range(wavelengths):
        found += leg.total[1, i]
        low, high = 1.0 / max(leg.total[0, i], 1e-300), 1.0 / max(leg.total[1, i], 1e-300)
        for k in range(last):
            leg.light[k, i] *= low
            leg.vertex[k, i] *= high
    return found > 0.0


@inlined
def weigh_stratum(v, k, leg):
    """Chances of stratum k: the scattering on it times the logarithmic mean of the values at its edges."""
    for i in range(leg.draw.size):
        scattering = 0.0
        for c in range(leg.column.shape[1]):
            scattering += (leg.column[k + 1, c] - leg.column[k, c]) * v.sigma_s[c, i]
        # Carlson (1972), Am. Math. Mon. 79, 615: (2 geometric + arithmetic) / 3 is close to the logarithmic mean.
        a, b = leg.light_rim[k, i], leg.light_rim[k + 1, i]
        leg.light[k, i] = scattering * (2.0 * math.sqrt(a * b) + 0.5 * (a + b)) / 3.0
        leg.total[0, i] += leg.light[k, i]
        a, b = leg.vertex_rim[k, i], leg.vertex_rim[k + 1, i]
        leg.vertex[k, i] = scattering * (2.0 * math.sqrt(a * b) + 0.5 * (a + b)) / 3.0
        leg.total[1, i] += leg.vertex[k, i]


@kernel
def gather_escape(v, x, d, u, leg, work):
    """Emission along a leg, one point at the fraction u of every stratum, and the background at its end."""
    last = leg.edge.size - 1
    for c in range(work.along.size):
        work.along[c] = leg.column[last, c]
    transmittance(work.along, v.sigma_t, work.through)
    for i in range(leg.escape.size):
        leg.escape[i] = v.background[i] * work.through[i]
    if not v.emits:
        return
    for k in range(last):
        width = leg.edge[k + 1] - leg.edge[k]
        t = leg.edge[k] + u * width
        for c in range(work.along.size):
            work.along[c] = leg.column[k, c]
        space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], leg.edge[k], t, work.space, work.along)
        space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
        transmittance(work.along, v.sigma_t, work.through)
        mix_components(work.density, v.emission, work.towards)
        for i in range(leg.escape.size):
            leg.escape[i] += width * work.through[i] * work.towards[i]


@inlined
def steepness(low, high):
    """Logarithm of the fall from one edge to the other, within limits."""
    if low <= 0.0 or high <= 0.0:
        return 0.0 if low <= high else STEEPEST
    return min(max(math.log(low / high), -STEEPEST), STEEPEST)


@kernel
def draw_point(chance, rim, edge, hero, u, density):
    """A distance along a leg drawn with the hero's chances; its density [m-1] under every hero into `density`.

    Returns the distance and the stratum; the stratum is -1 when the hero finds nothing.
    """
    last = chance.shape[0]
    below, k, share = 0.0, -1, 0.0
    for j in range(last):
        c = chance[j, hero]
        if c > 0.0:
            k, share = j, min((u - below) / c, 1.0)
            below += c
            if u < below:
                break
    if k < 0:
        return 0.0, k
    a = steepness(rim[k, hero], rim[k + 1, hero])
    width = edge[k + 1] - edge[k]
    s = share if abs(a) < 1e-6 else -math.log1p(share * math.expm1(-a)) / a
    s = min(max(s, 0.0), 1.0)
    for i in range(density.size):
        a = steepness(rim[k, i], rim[k + 1, i])
        fall = 1.0 if abs(a) < 1e-6 else -a * math.exp(-a * s) / math.expm1(-a)
        density[i] = chance[k, i] * fall / width
    return edge[k] + s * width, k


@inlined
def columns_to(v, x, d, leg, k, t, work):
    """Columns from the start of a leg to the distance t in stratum k, into ``work.along``."""
    for c in range(work.along.size):
        work.along[c] = leg.column[k, c]
    space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], leg.edge[k], t, work.space, work.along)


@kernel
def fetch_light(v, hero, u, leg, work, walker, walk):
    """Light of all stars that is scattered into the leg, from a few points on it, into ``walk.gain``."""
    x, d = walk.position, walk.direction
    for i in range(walk.gain.size):
        walk.gain[i] = 0.0
    if v.power.shape[0] == 0:
        return
    for m in range(LIT_POINTS):
        t, k = draw_point(leg.light, leg.light_rim, leg.edge, hero, (m + u) / LIT_POINTS, leg.draw)
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
            phase_at(v.phase, d[0] * a + d[1] * b + d[2] * c, work.phase)
            for i in range(walk.gain.size):
                work.towards[i] = 0.0
            for j in range(work.density.size):
                for i in range(walk.gain.size):
                    work.towards[i] += work.density[j] * v.sigma_s[j, i] * work.phase[j, i]
            for i in range(walk.gain.size):
                walk.gain[i] += work.through[i] * work.towards[i] * work.arriving[i] / mean


@kernel
def invert_column(v, i, wanted, low, high, first, x, d, work):
    """Distance between low and high at which the optical depth at wavelength number i is `wanted`.

    Newton's steps within a bracket; `first` holds the columns at `low`.
    """
    begin, t, width = low, 0.5 * (low + high), high - low
    for _ in range(60):
        for c in range(work.along.size):
            work.along[c] = first[c]
        space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], begin, t, work.space, work.along)
        miss = depth_at(v, work.along, i) - wanted
        if miss < 0.0:
            low = t
        else:
            high = t
        if abs(miss) < 1e-10 * (1.0 + wanted) or high - low < 1e-13 * width:
            break
        space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
        sigma = depth_at(v, work.density, i)
        t = t - miss / sigma if sigma > 0.0 else 0.5 * (low + high)
        if not low < t < high:
            t = 0.5 * (low + high)
    return t


@kernel
def fly_forced(v, hero, u, leg, work, walk):
    """A free flight that ends on the leg, its density [m-1] under every hero, and its stratum, -1 if there is none."""
    x, d = walk.position, walk.direction
    last = leg.edge.size - 1
    lost = -math.expm1(-depth_at(v, leg.column[last], hero))
    if not lost > 0.0:
        return 0.0, -1
    wanted = -math.log1p(-u * lost)
    k = 0
    while k < last - 1 and depth_at(v, leg.column[k + 1], hero) < wanted:
        k += 1
    t = invert_column(v, hero, wanted, leg.edge[k], leg.edge[k + 1], leg.column[k], x, d, work)
    columns_to(v, x, d, leg, k, t, work)
    transmittance(work.along, v.sigma_t, work.through)
    space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
    for i in range(leg.draw.size):
        whole = -math.expm1(-depth_at(v, leg.column[last], i))
        leg.draw[i] = depth_at(v, work.density, i) * work.through[i] / max(whole, 1e-300)
    return t, k


@kernel
def go_to_vertex(v, hero, u, leg, work, walk):
    """Move the walk to its next vertex; False if there is none.

    Where light falls slowly the guess of it has little to add, and over many orders the small errors of a leg's strata
    would multiply: there the flight is exact.
    """
    x, d = walk.position, walk.direction
    if v.decay[v.decay.size // 2] < SLOW:
        t, k = fly_forced(v, hero, u, leg, work, walk)
    else:
        t, k = draw_point(leg.vertex, leg.vertex_rim, leg.edge, hero, u, leg.draw)
    if k < 0:
        return False
    columns_to(v, x, d, leg, k, t, work)
    transmittance(work.along, v.sigma_t, work.through)
    for i in range(walk.value.size):
        walk.value[i] *= work.through[i]
        walk.chance[i] *= leg.draw[i]
    for n in range(3):
        x[n] += t * d[n]
    return rebalance(walk)


@kernel
def promise(v, work, walk, spare):
    """What a walk at a vertex may still bring in: its value times the guess of the light, averaged over wavelengths."""
    x = walk.position
    guess_light(v, x[0], x[1], x[2], work, work.through, spare)
    total = 0.0
    for i in range(spare.size):
        total += walk.value[i] * spare[i]
    return total / spare.size


@kernel
def face_lights(v, x, work, lights):
    """Directions, optical depths and shares of the point lights as seen from a vertex, into `lights`.

    Returns the mean optical depth to them, negative where no point light shines.
    """
    middle = v.power.shape[1] // 2
    total, depth = 0.0, 0.0
    for k in range(lights.shape[0]):
        a, b, c, d, fall = face_light(v, k, x[0], x[1], x[2])
        lights[k, 0], lights[k, 1], lights[k, 2], lights[k, 3] = a, b, c, 0.0
        if v.distant[k]:
            continue
        guide_columns(v, k, x[0], x[1], x[2], d, work.to_light)
        tau = 0.0
        for n in range(work.to_light.size):
            tau += work.to_light[n] * v.sigma_t[n, middle]
        lights[k, 3] = v.power[k, middle] * fall * (0.1 + tau) * math.exp(-v.decay[middle] * tau)
        total += lights[k, 3]
        depth += lights[k, 3] * tau
    if not total > 0.0:
        return -1.0
    for k in range(lights.shape[0]):
        lights[k, 3] /= total
    return depth / total


@inlined
def direction_law(v, d, lights, around, deep):
    """Density of directions by the guess of the light that comes from there [sr-1]."""
    law = (1.0 - around - deep) / (4.0 * math.pi)
    if around + deep > 0.0:
        last = v.shape.size - 1
        for k in range(lights.shape[0]):
            mu = d[0] * lights[k, 0] + d[1] * lights[k, 1] + d[2] * lights[k, 2]
            sine = max(math.sqrt(max((1.0 - mu) * (1.0 + mu), 0.0)), 1e-7)
            place = 0.5 * (min(max(mu, -1.0), 1.0) + 1.0) * last
            j = min(int(place), last - 1)
            shape = v.shape[j] + (place - j) * (v.shape[j + 1] - v.shape[j])
            law += lights[k, 3] * (around / (2.0 * math.pi * math.pi * sine) + deep * shape)
    return law


@inlined
def draw_depth_cosine(v, u):
    """Cosine to the direction of the light, drawn from the shape of light in the depths."""
    low, high = 0, v.shape.size - 1
    last = high
    while high - low > 1:
        middle = (low + high) >> 1
        if v.shape_cdf[middle] <= u:
            low = middle
        else:
            high = middle
    p0, p1 = v.shape[low], v.shape[high]
    share = 0.5 * (p0 + p1) * (u - v.shape_cdf[low]) / max(v.shape_cdf[high] - v.shape_cdf[low], 1e-300)
    s = 2.0 * share / (p0 + math.sqrt(max(p0 * p0 + 2.0 * (p1 - p0) * share, 0.0)))
    return 2.0 * (low + min(s, 1.0)) / last - 1.0


@kernel
def draw_by_law(v, d, u, w, lights, around, deep, state):
    """Direction from `direction_law`, into `d`."""
    if u >= around + deep:
        d[0], d[1], d[2] = 0.0, 0.0, 1.0
        cosine = 1.0 - 2.0 * (u - around - deep) / (1.0 - around - deep)
    else:
        rest = uniform(state)
        for k in range(lights.shape[0]):
            if lights[k, 3] > 0.0:
                d[0], d[1], d[2] = lights[k, 0], lights[k, 1], lights[k, 2]
                if rest < lights[k, 3]:
                    break
                rest -= lights[k, 3]
        if u < around:
            cosine = math.cos(math.pi * u / around)
        else:
            cosine = draw_depth_cosine(v, (u - around) / deep)
    turn(d, min(max(cosine, -1.0), 1.0), 2.0 * math.pi * w)


@inlined
def mean_phase(v, i, cosine, density):
    """Phase function [sr-1] of the mixture at wavelength number i."""
    last = v.phase.shape[1] - 1
    k = min(int(math.sqrt(max(0.5 * (1.0 - cosine), 0.0)) * last), last - 1)
    scale = 2.0 / (last * last)
    w = min(max((1.0 - scale * k * k - cosine) / (scale * (2 * k + 1)), 0.0), 1.0)
    scattering, towards = 0.0, 0.0
    for c in range(density.size):
        s = density[c] * v.sigma_s[c, i]
        scattering += s
        towards += s * (v.phase[c, k, i] + w * (v.phase[c, k + 1, i] - v.phase[c, k, i]))
    return towards / max(scattering, 1e-300)


@kernel
def turn_at_vertex(v, u, w, work, lights, walk):
    """New direction at a vertex; the value takes the phase functions.  False if nothing is scattered there.

    The wanted density is the phase function times the guess of the light that comes from a direction.  Candidates are
    drawn from both of these alone, and one of them is kept by its weight (importance resampling: Talbot, Cline &
    Egbert 2005, Eurographics Symposium on Rendering).  The draw is the same for every hero, so chances stay.
    """
    x, d = walk.position, walk.direction
    middle = walk.value.size // 2
    space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
    old_x, old_y, old_z = d[0], d[1], d[2]
    depth = face_lights(v, x, work, lights)
    share = min(max(depth, 0.0) / DEEP, 1.0)
    around = 0.0 if depth < 0.0 else STAR_SHARE * (1.0 - share)
    deep = 0.0 if depth < 0.0 else DEEP_SHARE * share
    total, kept, chosen = 0.0, 0.0, False
    best_x, best_y, best_z = 0.0, 0.0, 0.0
    for n in range(CANDIDATES):
        z = (n + u) / CANDIDATES
        if z < 0.5:
            draw_by_law(v, d, 2.0 * z, uniform(walk.state), lights, around, deep, walk.state)
        else:
            d[0], d[1], d[2] = old_x, old_y, old_z
            if not draw_by_phase(v, middle, 2.0 * z - 1.0, uniform(walk.state), work, walk):
                return False
        phase = mean_phase(v, middle, old_x * d[0] + old_y * d[1] + old_z * d[2], work.density)
        law = direction_law(v, d, lights, around, deep)
        weight = phase * law / (0.5 * (phase + law))
        total += weight
        # Reservoir of one: the number is used again, stretched, after every decision.
        if weight > 0.0 and w * total < weight:
            chosen, kept = True, phase * law
            best_x, best_y, best_z = d[0], d[1], d[2]
            w = w * total / weight
        elif total > 0.0:
            w = (w * total - weight) / max(total - weight, 1e-300)
    if not chosen:
        return False
    d[0], d[1], d[2] = best_x, best_y, best_z
    phase_at(v.phase, old_x * d[0] + old_y * d[1] + old_z * d[2], work.phase)
    factor = total / (CANDIDATES * kept)
    for i in range(walk.value.size):
        towards = 0.0
        for c in range(work.density.size):
            towards += work.density[c] * v.sigma_s[c, i] * work.phase[c, i]
        walk.value[i] *= towards * factor
    return True


@kernel
def draw_by_phase(v, hero, u, w, work, walk):
    """Direction by the phase function of a component that the hero is scattered by; False if there is none."""
    total = 0.0
    for c in range(work.density.size):
        total += work.density[c] * v.sigma_s[c, hero]
    if total <= 0.0:
        return False
    rest, chosen, part = u * total, 0, 1.0
    for c in range(work.density.size):
        s = work.density[c] * v.sigma_s[c, hero]
        if s > 0.0:
            chosen, part = c, s
            if rest < s:
                break
            rest -= s
    # What is left of the number after the choice is as good as a new one.
    share = min(max(rest / part, 0.0), 1.0 - 1e-16)
    turn(walk.direction, sample_cosine(v, chosen, hero, share), 2.0 * math.pi * w)
    return True


@inlined
def next_number(walk, order, k):
    """Number k of the six that a leg needs: evenly spread for the first vertex and leg, from the stream later."""
    return walk.even[2 + k] if order == 1 else uniform(walk.state)


@kernel
def look_along_ray(v, hero, camera, work, walker, walk, total, by_order, apart):
    """Light that the camera's ray sees unscattered and scattered once, from a few points on it."""
    if v.glows:
        gather_escape(v, walk.position, walk.direction, walk.even[7], camera, work)
        for i in range(total.size):
            total[i] += camera.escape[i]
            apart[0, i] += camera.escape[i]
    fetch_light(v, hero, walk.even[8], camera, work, walker, walk)
    for i in range(total.size):
        total[i] += walk.gain[i]
        apart[1, i] += walk.gain[i]
        if by_order.shape[0] > 0:
            by_order[0, i] += walk.gain[i]


@merged
def volume_wander(
    v, camera, origin, direction, walked, max_order, leg, work, walker, lights, walk, total, by_order, apart
):  # fmt: skip
    """Follow a walk from the camera to its end and add up its light."""
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
    reference = promise(v, work, walk, leg.draw)
    for order in range(1, last + 1):
        if order > 1:
            level = ROULETTE_LEVEL * reference
            now = promise(v, work, walk, leg.draw)
            if now < level:
                chance = max(now / level, 0.05)
                if uniform(walk.state) >= chance:
                    return
                for i in range(wavelengths):
                    walk.value[i] /= chance
        if not turn_at_vertex(v, next_number(walk, order, 0), next_number(walk, order, 1), work, lights, walk):
            return
        start, end = clip_to_space(v.space, x[0], x[1], x[2], d[0], d[1], d[2])
        if end <= start:
            return
        found = prepare_volume_leg(
            v, x, d, start, end, np.bool_(False), next_number(walk, order, 2), leg, work
        )  # fmt: skip
        if order < max_order:
            fetch_light(v, hero, next_number(walk, order, 3), leg, work, walker, walk)
        for i in range(wavelengths):
            unscattered = walk.value[i] * leg.escape[i]
            scattered = walk.value[i] * walk.gain[i] if order < max_order else 0.0
            total[i] += unscattered + scattered
            if order <= by_order.shape[0]:
                by_order[order - 1, i] += unscattered
            if order + 1 <= by_order.shape[0]:
                by_order[order, i] += scattered
        if not found or not go_to_vertex(v, hero, next_number(walk, order, 4), leg, work, walk):
            return


@entry
def volume_path_rays(
    v, origins, directions, ids, base, walked, seed, samples, noise, max_order, s, mean, error, by_order, apart, used
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
    noise : float
        Stop when the relative standard error is below this; 0 to use all samples.
    max_order : int
        Highest order of scattering.
    s : WalkScratch
    mean, error : (ray, wavelength), output
    by_order : (ray, order, wavelength), output
        Mean by number of scatterings, as far as there is room; order 1 without stars unless it is walked.
    apart : (ray, 2, wavelength), output
        What of the mean is not scattered, and scattered once, where these are walked.
    used : (ray,) int64, output
    """
    batches = s.sums.shape[0]
    walk = s.walk
    first_goal = samples // batches if noise <= 0.0 else 1
    for ray in range(origins.shape[0]):
        o, d = origins[ray], directions[ray]
        used[ray] = 0
        for i in range(mean.shape[1]):
            mean[ray, i], error[ray, i] = 0.0, 0.0
            apart[ray, 0, i], apart[ray, 1, i] = 0.0, 0.0
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] = 0.0
        start, end = clip_to_space(v.space, o[0], o[1], o[2], d[0], d[1], d[2])
        if end <= start:
            if walked:
                for i in range(mean.shape[1]):
                    mean[ray, i], apart[ray, 0, i] = v.background[i], v.background[i]
            continue
        if not prepare_volume_leg(v, o, d, start, end, np.bool_(True), 0.5, s.camera, s.work) and not walked:
            continue
        for b in range(batches):
            start_stream(walk.state, seed, ids[ray], -1 - b)
            for k in range(EVEN_DIMENSIONS):
                s.shift[b, k] = np.uint32(uniform(walk.state) * 4294967296.0)
            for i in range(mean.shape[1]):
                s.sums[b, i] = 0.0
        done, goal = 0, first_goal
        while True:
            for b in range(batches):
                for n in range(done, goal):
                    start_stream(walk.state, seed, ids[ray], b + n * BATCHES)
                    even_point(s.shift[b], n, walk.even)
                    volume_wander(
                        v, s.camera, o, d, walked, max_order, s.leg, s.work, s.walker, s.lights, walk, s.sums[b],
                        by_order[ray], apart[ray]
                    )  # fmt: skip
            done = goal
            statistics(s.sums, batches, done, mean[ray], error[ray])
            if done >= samples // batches or relative_noise(error[ray], mean[ray], base[ray]) <= noise:
                break
            goal = min(2 * done, samples // batches)
        used[ray] = done * batches
        for i in range(mean.shape[1]):
            apart[ray, 0, i] /= used[ray]
            apart[ray, 1, i] /= used[ray]
            for k in range(by_order.shape[1]):
                by_order[ray, k, i] /= used[ray]


def scratch_of(table: VolumeTable, samples: int) -> Any:
    """Scratch arrays for a table."""
    components, wavelengths = table.sigma_s.shape
    return make_walk_scratch(components, wavelengths, len(table.power), samples, table.tracking != QUADRATURE)
