"""The light of a sky in which there is nothing but air and ground, for walks among what stands or floats in it.

A leg that meets neither a body nor a cloud sees what it would see in the empty sky, but for what bodies and clouds do
to the light around it.  So the light of the empty sky, which is known, is added at once, and from there on the walk
counts differences alone: of starlight what is shaded, and at legs that do meet something the light behind it is taken
off again and all that is seen is counted (a control variate along the walk).  The mean is that of the plain walk as
far as the known light is right; far away from all bodies there is no noise.

Starlight scattered once is kept for each component without its phase function, which is exact where it is looked up;
the rest is smooth.  See docs/theory/worlds.md, equation 171.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.surfaces.fields import add_air_columns
from skyscatter.kernels.surfaces.flights import KNOWN
from skyscatter.kernels.surfaces.media import spectral_depth
from skyscatter.kernels.surfaces.shells import foot_of
from skyscatter.kernels.tabulated import angle_cell, cell_of

#: Optical depth of all fields on a leg up to which it counts as one that meets none.
CLEAR = 1e-6
#: Of starlight, what bodies and clouds may change without being looked at [its share].
UNCHANGED = 1e-12


@by_address
class EmptySky(NamedTuple):
    """Light at nodes over the star's zenith angle, height, elevation and azimuth from the star.

    Of lines of sight that meet the ground what counts is not the elevation but the way there: on it the air's light
    replaces that of the ground.
    """

    shells: int  #: how many components of the air are shells; they come before its fields
    lamp: int  #: number of the star among the lamps
    ground: int  #: 1 if its ground is the scene's own; else that counts as a body, of which nothing is known
    radius: float  #: of the planet [m]
    centre: np.ndarray  #: (3,) [m]
    star: np.ndarray  #: (3,) direction towards it
    zenith: np.ndarray  #: (sun,) rising zenith angles of the star [rad]
    lowest: float  #: height of the lowest node [m]
    top: float  #: that of the highest [m]; nodes are even in the root of the height
    typical: float  #: mean light of low air at the middle wavelength
    below: int  #: nodes of the way to the ground, which come before those of elevation
    short: float  #: way up to which nodes are even, from where on they are so in its logarithm [m]
    longest: float  #: way of the last of them [m]
    whole: np.ndarray  #: (component, angle, wavelength) phase functions times scattering per unit density
    polarised: np.ndarray  #: the same of what polarises, b1; no components where light is not polarised
    #: (sun, height, elevation, turn, component + 1, wavelength) starlight that each component scatters once, without
    #: its phase function, and last the rest of the diffuse light [W m-2 sr-1 nm-1]; of polarised light component + 4,
    #: with the rest of Q, U and V behind, which refer to the meridian at the place
    light: np.ndarray


@inlined
def way_down(radius, r, cosine):
    """Distance [m] to the ground along a line of sight from a distance r from the centre; negative where it misses."""
    along, rest = -r * cosine, (r - radius) * (r + radius)
    square = along * along - rest
    if not (along > 0.0 and square >= 0.0):
        return -1.0
    return max(rest / (along + math.sqrt(square)), 1e-9)


@inlined
def way_place(sky, way):
    """Where a way to the ground lies among the nodes that look down: the node before it, and how far on it is."""
    t = math.log(1.0 + way / sky.short) / math.log(1.0 + sky.longest / sky.short) * (sky.below - 1)
    n = min(int(t), sky.below - 2)
    return n, min(t - n, 1.0)


@inlined
def elevation_place(sky, r, cosine):
    """The same of a line of sight that misses the ground; those nodes crowd at the horizon by the square."""
    dip = math.acos(min(sky.radius / r, 1.0))
    angle = math.asin(min(max(cosine, -1.0), 1.0))
    last = sky.light.shape[2] - 1 - sky.below
    t = math.sqrt(min(max((angle + dip) / (0.5 * math.pi + dip), 0.0), 1.0)) * last
    n = min(int(t), last - 1)
    return n + sky.below, t - n


@inlined
def azimuth_place(sky, cosine, sun, between):
    """The same among those of azimuth from the star, which are even in its root; all three are cosines."""
    sines = math.sqrt(max((1.0 - cosine * cosine) * (1.0 - sun * sun), 0.0))
    turn = math.acos(min(max((between - cosine * sun) / sines, -1.0), 1.0)) if sines > 1e-9 else 0.0
    last = sky.light.shape[3] - 1
    t = math.sqrt(turn / math.pi) * last
    n = min(int(t), last - 1)
    return n, t - n


@inlined
def height_place(sky, r):
    """The same among those of height."""
    last = sky.light.shape[1] - 1
    t = math.sqrt(min(max(r - sky.radius, 0.0) / sky.top, 1.0)) * last
    n = min(int(t), last - 1)
    return n, t - n


@inlined
def sun_place(sky, sun):
    """The same among those of the star's zenith angle; beyond them the last counts on."""
    if sky.zenith.size == 1:
        return np.int64(0), 0.0
    angle = min(max(math.acos(min(max(sun, -1.0), 1.0)), sky.zenith[0]), sky.zenith[sky.zenith.size - 1])
    n = cell_of(sky.zenith, 0, sky.zenith.size - 1, angle)
    return n, (angle - sky.zenith[n]) / (sky.zenith[n + 1] - sky.zenith[n])


@inlined
def places(sky, x, d):
    """Where a ray from x lies among the nodes: of the star, the height and the azimuth, way and height [m]; cosines."""
    a, b, c = x[0] - sky.centre[0], x[1] - sky.centre[1], x[2] - sky.centre[2]
    r = math.sqrt(a * a + b * b + c * c)
    cosine, sun = (a * d[0] + b * d[1] + c * d[2]) / r, (a * sky.star[0] + b * sky.star[1] + c * sky.star[2]) / r
    between = d[0] * sky.star[0] + d[1] * sky.star[1] + d[2] * sky.star[2]
    height = max(r - sky.radius, 0.0)
    way = way_down(sky.radius, sky.radius + height, cosine)
    turn = azimuth_place(sky, cosine, sun, between)
    return sun_place(sky, sun), height_place(sky, r), turn, way, height, cosine, between


@inlined
def slope_place(sky, height, node, way, cosine):
    """Where a line of sight lies among the nodes of elevation at one node of the height."""
    if way > 0.0:
        # From another height, straight down is as far as that is high, and level ways are as long as they are.
        other = max(sky.top * (node / (sky.light.shape[1] - 1.0)) ** 2, sky.lowest)
        return way_place(sky, max(way + (other - height) * min(height / way, 1.0), 0.0))
    return elevation_place(sky, sky.radius + height, cosine)


@kernel
def empty_light(sky, x, d, work, out):
    """Diffuse light of the empty sky that arrives at x against the direction d, into `out` (wavelength,).

    `work` (component + 1 or more, wavelength) is left with what has been joined from the nodes.
    """
    (i, u), (j, v), (m, t), way, height, cosine, between = places(sky, x, d)
    last, rows = sky.whole.shape[0], sky.light.shape[4]
    for n in range(rows):
        for q in range(out.size):
            work[n, q] = 0.0
    for g in range(2):
        k, w = slope_place(sky, height, j + g, way, cosine)
        for corner in range(8):
            p, h, f = corner & 1, (corner >> 1) & 1, corner >> 2
            share = (u if p else 1.0 - u) * (v if g else 1.0 - v) * (w if h else 1.0 - w) * (t if f else 1.0 - t)
            if share > 0.0:
                here = sky.light[i + p, j + g, k + h, m + f]
                for n in range(rows):
                    for q in range(out.size):
                        work[n, q] += share * here[n, q]
    cell, along = angle_cell(between, sky.whole.shape[1] - 1)
    for q in range(out.size):
        out[q] = work[last, q]
    for n in range(last):
        for q in range(out.size):
            low, high = sky.whole[n, cell, q], sky.whole[n, cell + 1, q]
            out[q] += work[n, q] * (low + along * (high - low))


@kernel
def middle_light(sky, x, d):
    """About the same at the middle wavelength, by the nearest nodes."""
    (i, u), (j, v), (m, t), way, height, cosine, between = places(sky, x, d)
    j += 1 if v > 0.5 else 0
    k, w = slope_place(sky, height, j, way, cosine)
    last, q = sky.whole.shape[0], sky.light.shape[5] // 2
    here = sky.light[i + (1 if u > 0.5 else 0), j, k + (1 if w > 0.5 else 0), m + (1 if t > 0.5 else 0)]
    cell, _ = angle_cell(between, sky.whole.shape[1] - 1)
    light = float(here[last, q])
    for n in range(last):
        light += here[n, q] * sky.whole[n, cell, q]
    return max(light, 0.0)


@entry
def empty_lights(sky, origins, directions, work, out):
    """`empty_light` along rays (ray, 3), into `out` (ray, wavelength)."""
    for ray in range(out.shape[0]):
        empty_light(sky, origins[ray], directions[ray], work, out[ray])


@inlined
def meets_fields(sky, media, columns):
    """Whether columns through the air hold anything of its fields."""
    depth = 0.0
    for c in range(sky.shells, media.first[1]):
        depth += columns[c] * media.rate[c]
    return depth > CLEAR


@kernel
def changed_starlight(sky, media, k, x, d, reached, s):
    """Light of lamp k at x, whose transmittance is in ``s.light`` where it `reached` x; False if there is none.

    Of a star whose light is counted already it is what comes less what would come through the empty sky.
    """
    if sky is None:
        return reached
    dimmed = s.spare
    if s.at[KNOWN] == 0 or k != sky.lamp:
        return reached
    p, t = foot_of(sky.centre, x, d)
    if t < 0.0 and p < sky.radius:
        return False  # behind the planet, here as there
    along = s.media.along
    for c in range(along.size):
        along[c] = 0.0
    add_air_columns(media.shells, media.centre, x, d, 0.0, math.inf, s.media, along)
    spectral_depth(media, np.int64(0), along, dimmed)
    changed = 0.0
    for i in range(dimmed.size):
        empty = fast_exp(-dimmed[i])
        s.light[i] = (s.light[i] if reached else 0.0) - empty
        changed = max(changed, abs(s.light[i]) - UNCHANGED * empty)
    return changed > 0.0
