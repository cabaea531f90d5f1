"""Legs of walks in three dimensions: strata, what each of them should hand on, and points drawn from them.

See `kernels.volume_walks` for what they are for, and docs/theory/nebulae.md, equations 44 and 48.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.lookup import sort_few
from skyscatter.kernels.optics import mix_components, transmittance
from skyscatter.kernels.space import space_columns, space_densities
from skyscatter.kernels.volume import (
    INSIDE,
    SHY,
    correct_guess,
    depth_at,
    forwardness,
    guess_light,
    guessed_forwardness,
    least_depth,
    nearest_star,
    open_light,
    transport_length,
)

#: Optical depth at the most transparent wavelength at which a leg ends.
DARK = 40.0
#: Depth of the first stratum beyond which a dark leg is cut anew, and of any beyond which the camera's ray is.
COARSE = 1.0
#: Free paths from which on the steps of a leg through dense matter grow.
FINE = 0.35
#: Share of the points that are drawn as if no medium were before the lights: the grid of the guess may be coarser than
#: a hole around a star, and see none of the light in it.
PLAIN = 0.05
#: How much more an evenly dense stratum would hold than it does, from which on the medium ends within it.
BLUNT = 1.02
#: How often a stratum is halved to find where in it light is emitted.
HALVINGS = 5
#: No stratum's values differ by more than exp(this) from edge to edge as far as the draw is concerned.
STEEPEST = 40.0


@by_address
class VolumeLeg(NamedTuple):
    """A leg with its strata."""

    edge: np.ndarray  #: (stratum + 1,) distances [m]
    column: np.ndarray  #: (stratum + 1, component) columns from the start of the leg [m]
    star: np.ndarray  #: (2,) where the main light is nearest, and its height over the leg [m], 0 without one
    angle: np.ndarray  #: (stratum + 1,) of the edges, as `angle_of` tells
    vertex: np.ndarray  #: (stratum, wavelength) chance that the next vertex lies in a stratum, under each hero
    light: np.ndarray  #: (stratum, wavelength) the same for the points at which light is fetched
    vertex_rim: np.ndarray  #: (stratum + 1, wavelength) transmittance times guess of all light
    light_rim: np.ndarray  #: (stratum + 1, wavelength) transmittance times guess of the direct light, over the angle
    plain: np.ndarray  #: (stratum, wavelength) chances by the lights as they would be with no medium before them
    plain_rim: np.ndarray  #: (stratum + 1, wavelength) transmittance times light without a medium before it
    escape: np.ndarray  #: (wavelength,) emission along the leg and background at its end
    total: np.ndarray  #: (3, wavelength) sums of `light`, `vertex` and `plain` before they were made chances
    draw: np.ndarray  #: (wavelength,) density [m-1] of a drawn point under each hero
    ahead: np.ndarray  #: (1,) how far ahead of the next vertex lies what the direction is worth [m]


def make_volume_leg(strata: int, components: int, wavelengths: int) -> VolumeLeg:
    """An empty leg."""
    return VolumeLeg(
        np.zeros(strata + 1), np.zeros((strata + 1, components)), np.zeros(2), np.zeros(strata + 1),
        np.zeros((strata, wavelengths)), np.zeros((strata, wavelengths)), np.zeros((strata + 1, wavelengths)),
        np.zeros((strata + 1, wavelengths)), np.zeros((strata, wavelengths)), np.zeros((strata + 1, wavelengths)),
        np.zeros(wavelengths), np.zeros((3, wavelengths)), np.zeros(wavelengths), np.zeros(1),
    )  # fmt: skip


@kernel
def main_light(v, x, d, start, end):
    """The point light that should shine brightest on a line, and the distance at which the line is nearest to it."""
    best, chosen, place, apart = 0.0, -1, 0.0, 0.0
    for k in range(v.power.shape[0]):
        if v.distant[k]:
            continue
        a, b, c = v.place[k, 0] - x[0], v.place[k, 1] - x[1], v.place[k, 2] - x[2]
        near = min(max(a * d[0] + b * d[1] + c * d[2], start), end)
        a, b, c = a - near * d[0], b - near * d[1], c - near * d[2]
        q = math.sqrt(a * a + b * b + c * c)
        # Irradiance integrated along a line goes as 1 / distance.
        bright = v.share[k] / max(q, v.size[k], 1e-9 * (end - start))
        if bright > best:
            best, chosen, place, apart = bright, k, a * d[0] + b * d[1] + c * d[2] + near, q
    return chosen, place, max(apart, 1e-6 * (end - start))


@inlined
def angle_of(near, height, t):
    """Angle in which the main light sees the distance t along a leg; the distance itself where there is no height.

    A star lights equal angles alike: over the angle its light has no peak, however near to it the leg passes.
    """
    return math.atan((t - near) / height) if height > 0.0 else t


@inlined
def distance_of(near, height, angle):
    """The distance along a leg at an angle."""
    return near + height * math.tan(angle) if height > 0.0 else angle


@inlined
def per_angle(near, height, t):
    """Distance per angle [m] at the distance t along a leg."""
    return height + (t - near) ** 2 / height if height > 0.0 else 1.0


@inlined
def grown(share, length, path):
    """Where on a leg of some length its steps end that grow from a part of a free path on, or from nothing."""
    fine = FINE * path
    return min(length * share * share, fine * math.sinh(share * math.asinh(length / fine)))


@kernel
def cut_leg(v, x, d, start, end, path, leg):
    """Edges of the strata of a leg: equal angles around the main light, and steps that are equal or grow.

    They grow from the free `path` [m] on, and are equal where it is 0.
    """
    edge = leg.edge
    strata = edge.size - 1
    chosen, near, apart = main_light(v, x, d, start, end)
    leg.star[0], leg.star[1] = near, apart if chosen >= 0 else 0.0
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
        edge[n] = start + (grown(share, end - start, path) if path > 0.0 else (end - start) * share)
        n += 1
    edge[n], edge[n + 1] = start, end
    sort_few(edge, n + 2)
    for k in range(strata + 1):
        leg.angle[k] = angle_of(leg.star[0], leg.star[1], edge[k])


@inlined
def coarsest_step(v, leg):
    """Optical depth of the deepest stratum of a leg whose columns are known, and of the whole of it."""
    middle, before, coarsest = leg.draw.size // 2, 0.0, 0.0
    for k in range(1, leg.edge.size):
        depth = depth_at(v, leg.column[k], middle)
        coarsest, before = max(coarsest, depth - before), depth
    return coarsest, before


@kernel
def recut_by_depth(v, leg):
    """Put the equal steps of a leg whose columns are known where its depth grows from a part of one on.

    False where they are fine already.  A step that is many free paths deep promises at its front what it does not hold.
    """
    edge, middle, last = leg.edge, leg.draw.size // 2, leg.edge.size - 1
    coarsest, whole = coarsest_step(v, leg)
    if not coarsest > COARSE:
        return False
    steps = last // 2 if leg.star[1] > 0.0 else last
    # Straight lines between the old edges; what `plain_rim` holds is filled later.
    found, k = leg.plain_rim[:, 0], 0
    for n in range(1, steps):
        wanted = FINE * math.sinh(n / (steps + 0.0) * math.asinh(whole / FINE))
        while k < last - 1 and depth_at(v, leg.column[k + 1], middle) < wanted:
            k += 1
        low, high = depth_at(v, leg.column[k], middle), depth_at(v, leg.column[k + 1], middle)
        share = min((wanted - low) / (high - low), 1.0) if high > low else 1.0
        found[n] = edge[k] + share * (edge[k + 1] - edge[k])
    low, high, turns = leg.angle[0], leg.angle[last], last - steps + 1
    for n in range(1, steps):
        edge[n] = found[n]
    for n in range(1, turns):
        t = distance_of(leg.star[0], leg.star[1], low + (high - low) * n / turns)
        edge[steps - 1 + n] = min(max(t, edge[0]), edge[last])
    sort_few(edge, last)
    for n in range(last + 1):
        leg.angle[n] = angle_of(leg.star[0], leg.star[1], edge[n])
    return True


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
def fill_clear_columns(v, x, d, leg, work):
    """Columns of what emits and dims no light, which nothing before has asked for, to the edges of a leg's strata."""
    for c in range(work.to_light.size):
        work.to_light[c] = 0.0
    for k in range(1, leg.edge.size):
        before, t = leg.edge[k - 1], leg.edge[k]
        space_columns(v.clear, x[0], x[1], x[2], d[0], d[1], d[2], before, t, work.space, work.to_light)
        for c in range(work.to_light.size):
            leg.column[k, c] += work.to_light[c]


@inlined
def rim_behind(v, x, d, leg, k, n, work):
    """Where a medium that is as dense as at edge k of a leg would end, all of it lying between there and edge n."""
    middle = leg.draw.size // 2
    t = leg.edge[k]
    space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
    sigma = depth_at(v, work.density, middle)
    depth = abs(depth_at(v, leg.column[n], middle) - depth_at(v, leg.column[k], middle))
    way = leg.edge[n] - t
    if not abs(way) * sigma > BLUNT * depth:
        return leg.edge[n]
    return t + math.copysign((1.0 + 1e-9) * depth / sigma, way)


@kernel
def column_at(v, x, d, leg, k, t, work):
    """Columns from the start of a leg to the distance t behind edge k, into ``work.along``; their optical depth."""
    for c in range(work.along.size):
        work.along[c] = leg.column[k, c]
    space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], leg.edge[k], t, work.space, work.along)
    return depth_at(v, work.along, leg.draw.size // 2)


@inlined
def move_edge(leg, k, t, work):
    """Put edge k of a leg at the distance t, to which ``work.along`` holds the columns."""
    leg.edge[k], leg.angle[k] = t, angle_of(leg.star[0], leg.star[1], t)
    for c in range(work.along.size):
        leg.column[k, c] = work.along[c]


@kernel
def trim_leg(v, x, d, camera, leg, work):
    """Put an edge of a leg where the medium ends, and on the camera's ray one where it begins.

    A stratum that lies in part outside would draw points where nothing is scattered, and those inside count the more.
    No edge is moved that others have put within the medium.
    """
    last, middle = leg.edge.size - 1, leg.draw.size // 2
    whole = depth_at(v, leg.column[last], middle)
    if not whole > 0.0:
        return
    least, k = 1e-9 * whole, last - 1
    while k > 0 and whole - depth_at(v, leg.column[k], middle) <= least:
        k -= 1
    t = rim_behind(v, x, d, leg, k, k + 1, work)
    if t < leg.edge[k + 1] and whole - column_at(v, x, d, leg, k, t, work) <= least:
        move_edge(leg, k + 1, t, work)
    if camera:
        k = 0
        while k < last - 1 and depth_at(v, leg.column[k + 1], middle) <= least:
            k += 1
        t = rim_behind(v, x, d, leg, k + 1, k, work)
        if t > leg.edge[k] and column_at(v, x, d, leg, k, t, work) <= least:
            move_edge(leg, k, t, work)


@kernel
def look_ahead(v, x, d, leg, k, t, depth):
    """How far ahead of the distance t in stratum k of a leg lies what its direction is worth [m].

    In diffusing light that is what lies where it leads, as far as scattering remembers it; elsewhere nothing.  `depth`
    is the optical depth from the leg's start to t.
    """
    last, middle = leg.edge.size - 1, leg.draw.size // 2
    whole = leg.column[last]
    total = depth_at(v, whole, middle)
    onward = forwardness(v, whole) * transport_length(v, whole) * total
    if v.correction.shape[0] == 0 or not onward > 0.0:
        return 0.0
    wanted = depth + min(onward, INSIDE * (total - depth))
    k = min(k, last - 1)
    while k < last - 1 and depth_at(v, leg.column[k + 1], middle) < wanted:
        k += 1
    low, high = depth_at(v, leg.column[k], middle), depth_at(v, leg.column[k + 1], middle)
    share = min(max((wanted - low) / (high - low), 0.0), 1.0) if high > low else 0.0
    place = leg.edge[k] + share * (leg.edge[k + 1] - leg.edge[k])
    near = nearest_star(v, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2])
    return max(min(place - t, SHY * near), 0.0)


@kernel
def prepare_volume_leg(v, x, d, start, end, camera, early, u, leg, work):
    """Cut a leg and fill its columns, chances and, for later legs, its escaping light; False if it meets nothing.

    Of an `early` leg what it emits is known by columns.
    ``work.density`` holds the densities where a leg that is no `camera`'s begins.
    """
    last = leg.edge.size - 1
    wavelengths = leg.draw.size
    path = 0.0 if camera else 1.0 / max(depth_at(v, work.density, wavelengths // 2), 1e-300)
    cut_leg(v, x, d, start, end, path, leg)
    fill_columns_of_leg(v, x, d, leg, work)
    if least_depth(v, leg.column[1]) > COARSE and least_depth(v, leg.column[last]) > DARK:
        # The leg goes on in the dark for long: its strata belong to where there is light.
        cut_leg(v, x, d, start, visible_end(v, x, d, start, end, work), path, leg)
        fill_columns_of_leg(v, x, d, leg, work)
    if camera and recut_by_depth(v, leg):
        fill_columns_of_leg(v, x, d, leg, work)
    trim_leg(v, x, d, camera, leg, work)
    if v.emits and early:
        fill_clear_columns(v, x, d, leg, work)
    for i in range(wavelengths):
        leg.total[0, i], leg.total[1, i], leg.total[2, i], leg.escape[i] = 0.0, 0.0, 0.0, 0.0
    g = guessed_forwardness(v, leg.column[last])
    for k in range(last + 1):
        t = leg.edge[k]
        transmittance(leg.column[k], v.sigma_t, work.through)
        a, b, c = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
        guess_light(v, a, b, c, d, g, work, leg.light_rim[k], leg.vertex_rim[k])
        open_light(v, a, b, c, leg.plain_rim[k])
        shift = look_ahead(v, x, d, leg, k, t, depth_at(v, leg.column[k], wavelengths // 2))
        if shift > 0.0:
            a, b, c = a + shift * d[0], b + shift * d[1], c + shift * d[2]
            guess_light(v, a, b, c, d, g, work, leg.draw, leg.vertex_rim[k])
        correct_guess(v, a, b, c, leg.vertex_rim[k])
        stretch = per_angle(leg.star[0], leg.star[1], t)
        for i in range(wavelengths):
            leg.light_rim[k, i] *= work.through[i] * stretch
            leg.vertex_rim[k, i] *= work.through[i]
            leg.plain_rim[k, i] *= work.through[i]
        if k > 0:
            weigh_stratum(v, k - 1, leg)
    if v.glows and not camera:
        gather_escape(v, x, d, early, u, leg, work)
    found = 0.0
    for i in range(wavelengths):
        found += leg.total[1, i]
        low, high = 1.0 / max(leg.total[0, i], 1e-300), 1.0 / max(leg.total[1, i], 1e-300)
        plain = 1.0 / max(leg.total[2, i], 1e-300)
        for k in range(last):
            leg.light[k, i] *= low
            leg.vertex[k, i] *= high
            leg.plain[k, i] *= plain
    return found > 0.0


@inlined
def logarithmic_mean(a, b):
    """(a - b) / ln(a / b), to 2 % for a ratio of 1000.

    That of the roots times their mean; there (2 geometric + arithmetic) / 3 is close to it (Carlson 1972, Am. Math.
    Mon. 79, 615).
    """
    a, b = math.sqrt(a), math.sqrt(b)
    return 0.5 * (a + b) * (2.0 * math.sqrt(a * b) + 0.5 * (a + b)) / 3.0


@inlined
def weigh_stratum(v, k, leg):
    """Chances of stratum k: the scattering on it times the logarithmic mean of the values at its edges."""
    width, turned = leg.edge[k + 1] - leg.edge[k], leg.angle[k + 1] - leg.angle[k]
    turned = turned / width if width > 0.0 else 0.0
    for i in range(leg.draw.size):
        scattering = 0.0
        for c in range(leg.column.shape[1]):
            scattering += (leg.column[k + 1, c] - leg.column[k, c]) * v.sigma_s[c, i]
        a, b = leg.light_rim[k, i], leg.light_rim[k + 1, i]
        leg.light[k, i] = scattering * turned * logarithmic_mean(a, b)
        leg.total[0, i] += leg.light[k, i]
        a, b = leg.vertex_rim[k, i], leg.vertex_rim[k + 1, i]
        leg.vertex[k, i] = scattering * logarithmic_mean(a, b)
        leg.total[1, i] += leg.vertex[k, i]
        leg.plain[k, i] = scattering * 0.5 * (leg.plain_rim[k, i] + leg.plain_rim[k + 1, i])
        leg.total[2, i] += leg.plain[k, i]


@kernel
def gather_escape(v, x, d, early, u, leg, work):
    """Emission along a leg, and the background at its end."""
    transmittance(leg.column[leg.edge.size - 1], v.sigma_t, work.through)
    for i in range(leg.escape.size):
        leg.escape[i] = v.background[i] * work.through[i]
    if v.emits and early:
        gather_emission(v, x, d, u, leg, work)
    elif v.emits:
        sample_emission(v, x, d, u, leg, work)


@kernel
def sample_emission(v, x, d, u, leg, work):
    """Add emission along a leg, from one point at the fraction u of every stratum."""
    for k in range(leg.edge.size - 1):
        width = leg.edge[k + 1] - leg.edge[k]
        t = leg.edge[k] + u * width
        columns_to(v, x, d, leg, k, t, work)
        space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
        transmittance(work.along, v.sigma_t, work.through)
        mix_components(work.density, v.emission, work.towards)
        for i in range(leg.escape.size):
            leg.escape[i] += width * work.through[i] * work.towards[i]


@kernel
def gather_emission(v, x, d, u, leg, work):
    """Add emission along a leg of whose strata the columns say what they emit.

    All that a stratum emits is let through by as much as what comes from its far edge.  What more comes through is
    found at one point, drawn with the number u by how much it may be.
    """
    transmittance(leg.column[0], v.sigma_t, work.through)
    chosen, chance, unsure = -1, 0.0, 0.0
    for k in range(leg.edge.size - 1):
        more = add_emission(v, k, leg, work)
        unsure += more
        share = more / unsure if more > 0.0 else 0.0
        if u < share:
            chosen, chance, u = k, more, u / share
        elif share < 1.0:
            u = (u - share) / (1.0 - share)
    if chosen >= 0:
        correct_emission(v, x, d, u, chosen, chance / unsure, leg, work)


@inlined
def add_emission(v, k, leg, work):
    """Add what comes through at least of what stratum k emits, and tell how much more it may be.

    ``work.through`` goes from its first edge to its second.
    """
    transmittance(leg.column[k + 1], v.sigma_t, work.towards)
    for c in range(work.density.size):
        work.density[c] = leg.column[k + 1, c] - leg.column[k, c]
    mix_components(work.density, v.emission, work.arriving)
    unsure = 0.0
    for i in range(leg.escape.size):
        leg.escape[i] += work.arriving[i] * work.towards[i]
        unsure += work.arriving[i] * (work.through[i] - work.towards[i])
        work.through[i] = work.towards[i]
    return unsure


@kernel
def correct_emission(v, x, d, u, k, chance, leg, work):
    """Add what comes through of the emission of stratum k beyond what was taken, from a point that is drawn.

    It is drawn nearly as the emission goes: in the half of the stratum, of that half and so on in which what is emitted
    is found by chance, and evenly there.
    """
    transmittance(leg.column[k], v.sigma_t, work.through)
    transmittance(leg.column[k + 1], v.sigma_t, work.spare)
    whole = 0.0
    for c in range(work.density.size):
        work.along[c], work.density[c] = leg.column[k, c], 0.0
        for i in range(leg.escape.size):
            work.density[c] += v.emission[c, i] * (work.through[i] - work.spare[i])
        whole += work.density[c] * (leg.column[k + 1, c] - leg.column[k, c])
    low, high = leg.edge[k], leg.edge[k + 1]
    for _ in range(HALVINGS):
        middle, left = 0.5 * (low + high), 0.0
        for c in range(work.density.size):
            work.to_light[c] = work.along[c]
        space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], low, middle, work.space, work.to_light)
        space_columns(v.clear, x[0], x[1], x[2], d[0], d[1], d[2], low, middle, work.space, work.to_light)
        for c in range(work.density.size):
            left += work.density[c] * (work.to_light[c] - work.along[c])
        share = min(left / whole, 1.0) if whole > 0.0 else 0.5
        if u < share:
            high, whole, chance, u = middle, left, chance * share, u / share
        else:
            low, whole, chance, u = middle, whole - left, chance * (1.0 - share), (u - share) / (1.0 - share)
            for c in range(work.density.size):
                work.along[c] = work.to_light[c]
    t = low + u * (high - low)
    space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], low, t, work.space, work.along)
    space_densities(v.space, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work.space, work.density)
    transmittance(work.along, v.sigma_t, work.through)
    mix_components(work.density, v.emission, work.towards)
    for i in range(leg.escape.size):
        leg.escape[i] += (high - low) / chance * work.towards[i] * (work.through[i] - work.spare[i])


@inlined
def steepness(low, high):
    """Logarithm of the fall from one edge to the other, within limits."""
    if low <= 0.0 or high <= 0.0:
        return 0.0 if low <= high else STEEPEST
    return min(max(math.log(low / high), -STEEPEST), STEEPEST)


@inlined
def pick_stratum(chance, hero, u):
    """The stratum in which u falls, by the hero's chances, and where in it; -1 if there is none."""
    below, k, share = 0.0, -1, 0.0
    for j in range(chance.shape[0]):
        c = chance[j, hero]
        if c > 0.0:
            k, share = j, min((u - below) / c, 1.0)
            below += c
            if u < below:
                break
    return k, share


@inlined
def place_in_stratum(rim, k, hero, share):
    """Where in stratum k, from 0 to 1, by the exponential that joins the hero's values at its edges."""
    a = steepness(rim[k, hero], rim[k + 1, hero])
    return share if abs(a) < 1e-6 else min(max(-math.log1p(share * math.expm1(-a)) / a, 0.0), 1.0)


@inlined
def density_in_stratum(rim, k, i, s):
    """Density of `place_in_stratum` at s under hero i."""
    a = steepness(rim[k, i], rim[k + 1, i])
    return 1.0 if abs(a) < 1e-6 else -a * math.exp(-a * s) / math.expm1(-a)


@kernel
def draw_point(chance, rim, by_angle, leg, plain, hero, u, density):
    """A distance along a leg drawn with the hero's chances; its density [m-1] under every hero into `density`.

    Within a stratum by the exponential that joins the values of the rim, over the distance or over the angle around
    the main light.  The share `plain` of the points is drawn evenly within strata by the leg's plain chances instead.
    Returns the distance and the stratum; the stratum is -1 when the hero finds nothing.
    """
    plainly = plain if leg.total[2, hero] > 0.0 else 0.0
    if u < plainly:
        k, share = pick_stratum(leg.plain, hero, u / plainly)
    else:
        k, share = pick_stratum(chance, hero, (u - plainly) / (1.0 - plainly))
    if k < 0:
        return 0.0, k
    edge, near, height = leg.angle if by_angle else leg.edge, leg.star[0], leg.star[1] if by_angle else 0.0
    first, last, low, whole = leg.edge[k], leg.edge[k + 1], edge[k], edge[k + 1] - edge[k]
    if u < plainly:
        t = first + share * (last - first)
        s = (angle_of(near, height, t) - low) / max(whole, 1e-300)
    else:
        s = place_in_stratum(rim, k, hero, share)
        t = distance_of(near, height, low + s * whole)
    t, s = min(max(t, first), last), min(max(s, 0.0), 1.0)
    over = 1.0 / max(whole * per_angle(near, height, t), 1e-300)
    for i in range(density.size):
        plainly = plain if leg.total[2, i] > 0.0 else 0.0
        drawn = chance[k, i] * density_in_stratum(rim, k, i, s) * over
        density[i] = (1.0 - plainly) * drawn + plainly * leg.plain[k, i] / max(last - first, 1e-300)
    return t, k


@inlined
def columns_to(v, x, d, leg, k, t, work):
    """Columns from the start of a leg to the distance t in stratum k, into ``work.along``."""
    for c in range(work.along.size):
        work.along[c] = leg.column[k, c]
    space_columns(v.space, x[0], x[1], x[2], d[0], d[1], d[2], leg.edge[k], t, work.space, work.along)


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
