"""Where light seems to come from at a vertex of a walk in three dimensions: a density of directions, and its draws.

See docs/theory/nebulae.md, equation 47.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.random import uniform
from skyscatter.kernels.tabulated import cell_of, draw_in_cell
from skyscatter.kernels.volume import (
    depth_at,
    face_light,
    forward_gain,
    guessed_forwardness,
    guide_columns,
    scattering_at,
    turned_lobes,
)

#: Optical depth at which a star is deep.
DEEP = 4.0
#: Shares of the guess of directions by the light of a near star and by the slowest mode: near a star, and where it is
#: deep.  The rest is isotropic.
NEAR_SHARES, DEEP_SHARES = (0.9, 0.0), (0.2, 0.7)
#: The same shares for stars outside the medium, where no ray comes near them.
OUTSIDE_NEAR_SHARES, OUTSIDE_DEEP_SHARES = (0.3, 0.0), (0.0, 0.6)
#: The share by distant lights, of what does not come from elsewhere.
BEAMS = 0.95

#: Columns of `Aim.lights`: the direction is in the first three, then come shares of the light of near and of distant
#: lights, what of a distant light comes straight, the mean cosine by which the rest is turned, and the optical depth.
NEAR, FAR, STRAIGHT, TURNED, DEPTH = 3, 4, 5, 6, 7
#: Entries of `Aim.law`: shares by near stars, by the slowest mode and by distant lights, and the mean cosine of the
#: latter's straight light.
AROUND, MODE, BEAM, COSINE = 0, 1, 2, 3


@by_address
class Aim(NamedTuple):
    """What is known of the lights at a vertex."""

    lights: np.ndarray  #: (light, 8), see `NEAR`
    law: np.ndarray  #: (4,), see `AROUND`


def make_aim(lights: int) -> Aim:
    """An empty one for so many lights."""
    return Aim(np.zeros((lights, 8)), np.zeros(4))


@kernel
def face_lights(v, x, work, lights):
    """Directions, depths and shares of the lights as seen from a vertex, into `lights`.

    Returns the mean optical depth to the near lights, negative where none shines, and the distant lights' share of all,
    emission and background included.
    """
    middle = v.power.shape[1] // 2
    near, far, depth, power = 0.0, 0.0, 0.0, 0.0
    g = guessed_forwardness(v, work.density)
    for k in range(lights.shape[0]):
        a, b, c, d, fall = face_light(v, k, x[0], x[1], x[2])
        lights[k, 0], lights[k, 1], lights[k, 2], lights[k, NEAR], lights[k, FAR] = a, b, c, 0.0, 0.0
        guide_columns(v, k, x[0], x[1], x[2], d, work.to_light)
        tau = depth_at(v, work.to_light, middle)
        power += v.power[k, middle]
        light = v.share[k] * fall * (0.1 + tau) * math.exp(-v.decay[middle] * tau)
        lights[k, DEPTH] = tau
        if v.distant[k]:
            straight = v.share[k] * fall * math.exp(-tau)
            lights[k, FAR] = straight + light
            lights[k, STRAIGHT], lights[k, TURNED] = turned_lobes(g, scattering_at(v, work.to_light, middle))
            far += straight + light
        else:
            lights[k, NEAR] = light
            near += light
            depth += light * tau
    for k in range(lights.shape[0]):
        lights[k, NEAR] /= max(near, 1e-300)
        lights[k, FAR] /= max(far, 1e-300)
    elsewhere = v.floor[middle] / max(power, 1e-300)
    return depth / near if near > 0.0 else -1.0, far / max(near + far + elsewhere, 1e-300)


@inlined
def share_inside(v, lights):
    """Share of the near lights' light that comes from stars inside the medium's box."""
    inside = 0.0
    for k in range(lights.shape[0]):
        p, low, high = v.place[k], v.space.low, v.space.high
        if low[0] < p[0] < high[0] and low[1] < p[1] < high[1] and low[2] < p[2] < high[2]:
            inside += lights[k, NEAR]
    return inside


@kernel
def take_aim(v, x, work, aim):
    """Fill what is known of the lights at a vertex, where ``work.density`` holds the densities.

    Returns the mean optical depth to the near lights, negative where none shines.
    """
    depth, afar = face_lights(v, x, work, aim.lights)
    share = min(max(depth, 0.0) / DEEP, 1.0)
    inside = share_inside(v, aim.lights) if depth >= 0.0 else 0.0
    for n in range(2):
        near = OUTSIDE_NEAR_SHARES[n] + inside * (NEAR_SHARES[n] - OUTSIDE_NEAR_SHARES[n])
        deep = OUTSIDE_DEEP_SHARES[n] + inside * (DEEP_SHARES[n] - OUTSIDE_DEEP_SHARES[n])
        part = near + share * (deep - near) if depth >= 0.0 else 0.0
        if v.correction.shape[0] > 0:
            # Deeper still, light comes from all sides: candidates around the star would only be in the others' way.
            part *= 1.0 - min(max(depth / DEEP - 1.0, 0.0), 1.0)
        aim.law[n] = part * (1.0 - afar)
    aim.law[BEAM] = BEAMS * afar
    aim.law[COSINE] = guessed_forwardness(v, work.density)
    return depth


@inlined
def cosine_to(d, lights, k):
    """Cosine between a direction and that of light k."""
    return d[0] * lights[k, 0] + d[1] * lights[k, 1] + d[2] * lights[k, 2]


@inlined
def direction_law(v, d, aim):
    """Density of directions by the guess of the light that comes from there [sr-1]."""
    lights, law, last = aim.lights, aim.law, v.shape.size - 1
    density = 1.0 - law[AROUND] - law[MODE] - law[BEAM]
    for k in range(lights.shape[0]):
        if lights[k, FAR] > 0.0:
            mu, straight = cosine_to(d, lights, k), lights[k, STRAIGHT]
            gain = straight * forward_gain(law[COSINE], mu) + (1.0 - straight) * forward_gain(lights[k, TURNED], mu)
            density += lights[k, FAR] * law[BEAM] * gain
        elif law[AROUND] + law[MODE] > 0.0:
            mu = cosine_to(d, lights, k)
            sine = max(math.sqrt(max((1.0 - mu) * (1.0 + mu), 0.0)), 1e-7)
            place = 0.5 * (min(max(mu, -1.0), 1.0) + 1.0) * last
            j = min(int(place), last - 1)
            shape = v.shape[j] + (place - j) * (v.shape[j + 1] - v.shape[j])
            place = math.acos(min(max(mu, -1.0), 1.0)) / math.pi * last
            j = min(int(place), last - 1)
            angle = v.around[j] + (place - j) * (v.around[j + 1] - v.around[j])
            density += lights[k, NEAR] * (2.0 * law[AROUND] * angle / sine + 4.0 * math.pi * law[MODE] * shape)
    return density / (4.0 * math.pi)


@inlined
def forward_cosine(g, u):
    """Cosine drawn from the phase function of Henyey & Greenstein."""
    if g < 1e-3:
        return 2.0 * u - 1.0
    a = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
    return (1.0 + g * g - a * a) / (2.0 * g)


@inlined
def draw_from_table(density, cdf, u):
    """Place from 0 to 1, drawn from a density that is linear between equally spaced nodes."""
    last = density.size - 1
    n = cell_of(cdf, 0, last, u)
    return (n + draw_in_cell(density[n], density[n + 1], cdf, n, u)) / last


@inlined
def pick_light(lights, column, rest, d):
    """A light drawn by its share in a column of `lights`; its direction into `d`."""
    chosen = -1
    for k in range(lights.shape[0]):
        if lights[k, column] > 0.0:
            chosen = k
            if rest < lights[k, column]:
                break
            rest -= lights[k, column]
    d[0], d[1], d[2] = lights[chosen, 0], lights[chosen, 1], lights[chosen, 2]
    return chosen


@kernel
def draw_by_law(v, d, u, w, aim, state):
    """Direction from `direction_law`, into `d`."""
    lights, law = aim.lights, aim.law
    near, aimed = law[AROUND] + law[MODE], law[AROUND] + law[MODE] + law[BEAM]
    if u >= aimed:
        d[0], d[1], d[2] = 0.0, 0.0, 1.0
        cosine = 1.0 - 2.0 * (u - aimed) / (1.0 - aimed)
    elif u >= near:
        k = pick_light(lights, FAR, uniform(state), d)
        share, straight = (u - near) / law[BEAM], lights[k, STRAIGHT]
        if share < straight:
            cosine = forward_cosine(law[COSINE], share / straight)
        else:
            cosine = forward_cosine(lights[k, TURNED], (share - straight) / (1.0 - straight))
    else:
        pick_light(lights, NEAR, uniform(state), d)
        if u < law[AROUND]:
            cosine = math.cos(math.pi * draw_from_table(v.around, v.around_cdf, u / law[AROUND]))
        else:
            cosine = 2.0 * draw_from_table(v.shape, v.shape_cdf, (u - law[AROUND]) / law[MODE]) - 1.0
    turn(d, min(max(cosine, -1.0), 1.0), 2.0 * math.pi * w)


@inlined
def beams_ahead(v, d, aim, depth):
    """Light of distant lights that is scattered once on a way of some optical depth, as `middle_guess` counts it."""
    lights, middle, total = aim.lights, v.power.shape[1] // 2, 0.0
    for k in range(lights.shape[0]):
        if v.distant[k]:
            mu = cosine_to(d, lights, k)
            away = max(1.0 - mu, 1e-6)
            way = -math.expm1(-away * depth) / away
            total += v.power[k, middle] * math.exp(-lights[k, DEPTH]) * way * forward_gain(aim.law[COSINE], mu)
    return total


@inlined
def beams_here(v, aim):
    """Irradiance that comes straight from distant lights."""
    middle, total = v.power.shape[1] // 2, 0.0
    for k in range(aim.lights.shape[0]):
        if v.distant[k]:
            total += v.power[k, middle] * math.exp(-aim.lights[k, DEPTH])
    return total
