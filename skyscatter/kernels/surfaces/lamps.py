"""Lamps as walks look for them: which one, where on it, and how likely the same ray would have been another way.

A lamp is chosen by its power and by a guess of how much of it arrives; a tenth of the choices asks for no guess, so
that none can be wrong by more than that.  On a surface a point is drawn by area, on a sphere that is seen from outside
within the cone that it fills: densities per solid angle p = d^2 / (A cos) and 1 / (2 pi (1 - cos a)).  Parallel lamps
and points cannot be met by chance, but for the disks of the former by rays from where no lamp can be aimed at;
the surroundings are met by every ray that escapes, and are not looked for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, POINT_LAMP, SPHERE, SURROUNDINGS
from skyscatter.kernels.directions import turn
from skyscatter.kernels.eclipse import behind_moon, dim
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.random import mix
from skyscatter.kernels.surfaces.beams import place_beside, to_beam
from skyscatter.kernels.surfaces.shapes import sample_item
from skyscatter.kernels.tabulated import cell_of, first_above

#: Share of the choices of a lamp that do not ask how much of its light arrives.
BLIND_SHARE = 0.1
#: Points of an eclipsed disk that are tried; what makes integers of numbers in [0, 1); and the number of 32-bit words.
TRIES, SCRAMBLED, WORDS = 64, 2.0**53, 2.0**32


@by_address
class LampGuide(NamedTuple):
    """Where the light is, roughly: it decides how often walks look where, and never what they find there."""

    middle: np.ndarray  #: (lamp, 3) [m], or direction to a parallel lamp
    size: np.ndarray  #: (lamp,) radius [m] of a sphere around it; of parallel light the share of directions around it
    power: np.ndarray  #: (lamp,) mean over the wavelengths
    axis: np.ndarray  #: (lamp, 3) middle of the lobe of a point or of a flat surface
    lowest: np.ndarray  #: (lamp,) cosine around the axis below which nothing shines; -1 where light goes everywhere
    typical: np.ndarray  #: (lamp,) radiant intensity over power, evenly spread over where it shines [sr-1]
    slope: np.ndarray  #: (lamp,) tangent of half the angle of a point lamp's narrow beam; 0 of others
    beamed: bool  #: whether any lamp has one
    open: bool  #: whether light comes from the surroundings
    placed: bool  #: whether there are lamps with a place
    background: np.ndarray  #: (wavelength,) their radiance, without that of a map
    blind: np.ndarray  #: (lamp,) chance of every lamp that can be looked for; they sum to 1
    scatters: np.ndarray  #: (medium,) bool
    shines: np.ndarray  #: (medium,) bool
    extinction: np.ndarray  #: (medium,) mean over the wavelengths of constant media, 0 of others [m-1]
    drift: np.ndarray  #: (medium,) extinction that turns light, of media in which it diffuses; 0 of others [m-1]
    fade: np.ndarray  #: (medium,) rate at which diffuse light falls with the distance [m-1]
    everywhere: float  #: fluence of what shines from far away
    near: float  #: share of the points on legs that are drawn by where the lamp is near
    points: int  #: of the camera's first leg at which lamps are looked for
    level: float  #: throughput below which roulette begins
    gathered: np.ndarray  #: (medium, angle) integral of the mean phase function over the angle up to pi (k / n)^2
    halo: np.ndarray  #: (medium, angle) share of the light around a point lamp that is seen within such an angle of it
    sea: float  #: radius of the planet on which a sea lies, centred below the frame's origin [m]; 0 where none is


@inlined
def lobe_value(lamps, k, cosine):
    """Radiant intensity over power of lamp k [sr-1] at the cosine of an angle from its axis."""
    low, high = lamps.lobe_first[k], lamps.lobe_first[k + 1] - 1
    c = lamps.lobe_cosine
    value = 0.0
    # A scalar product of unit vectors may exceed 1 by its last digit.
    cosine = min(max(cosine, -1.0), 1.0)
    if high > low and c[low] <= cosine <= c[high]:
        n = cell_of(c, low, high, cosine)
        w = (cosine - c[n]) / (c[n + 1] - c[n])
        value = lamps.lobe_value[n] + w * (lamps.lobe_value[n + 1] - lamps.lobe_value[n])
    return value


@inlined
def brightness(lamps, k, cosine):
    """Radiance over power [m-2 sr-1] of a surface lamp that is seen under an angle from its normal."""
    return lobe_value(lamps, k, cosine) / (lamps.area[k] * cosine) if cosine > 0.0 else 0.0


@inlined
def point_on_disk(lamps, k, u, v, d):
    """Unit vector towards a point of the disk of a parallel lamp, even over it, into `d` (3,)."""
    for n in range(3):
        d[n] = lamps.position[k, n]
    if lamps.limb_row[k] >= 0:
        turn(d, math.sqrt(1.0 - u * lamps.disk[k] ** 2), 2.0 * math.pi * v)


@kernel
def past_moon(lamps, k, x, u, v, d):
    """Unit vector from x to a point of the disk of lamp k that the Moon leaves free, even over that, into `d` (3,).

    Points are drawn until one is free, between the limb and the circle within which all is hidden, by numbers that
    follow from the two that are given.  The edge that is next to come out stands for a crescent that none meets.
    """
    p, moon = lamps.position[k], lamps.moon
    a, b, c = moon.moon[0] - x[0], moon.moon[1] - x[1], moon.moon[2] - x[2]
    near = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / near - p[0], b / near - p[1], c / near - p[2]
    apart, size = math.sqrt(a * a + b * b + c * c), lamps.disk[k]
    hidden = (moon.moon_radius / near - apart) * moon.scale / size if size > 0.0 else 0.0
    hidden = min(max(hidden, 0.0), 1.0) ** 2
    state = mix(np.uint64(u * SCRAMBLED) ^ mix(np.uint64(v * SCRAMBLED)))
    for _ in range(TRIES):
        point_on_disk(lamps, k, hidden + u * (1.0 - hidden), v, d)
        if not behind_moon(moon, p, x[0], x[1], x[2], d[0], d[1], d[2]):
            return
        state = mix(state)
        u, v = (state >> np.uint64(32)) / WORDS, (state & np.uint64(0xFFFFFFFF)) / WORDS
    along, flat = a * p[0] + b * p[1] + c * p[2], math.sqrt(1.0 - size * size)
    a, b, c = a - along * p[0], b - along * p[1], c - along * p[2]
    back = size / math.sqrt(max(a * a + b * b + c * c, 1e-300))
    d[0], d[1], d[2] = flat * p[0] - back * a, flat * p[1] - back * b, flat * p[2] - back * c


@inlined
def ring_of(lamps, k, d):
    """Squared fractional radius at which a direction meets the disk of parallel lamp k; more than 1 beside it."""
    a = lamps.position[k]
    if lamps.limb_row[k] < 0 or d[0] * a[0] + d[1] * a[1] + d[2] * a[2] <= 0.0:
        return 2.0
    x, y, z = d[1] * a[2] - d[2] * a[1], d[2] * a[0] - d[0] * a[2], d[0] * a[1] - d[1] * a[0]
    return (x * x + y * y + z * z) / lamps.disk[k] ** 2


@inlined
def darken(lamps, k, square, light):
    """Multiply light (wavelength,) by the radiance over its mean at a squared fractional radius of lamp k's disk."""
    row, last = lamps.limb_row[k], lamps.limb.shape[1] - 1
    at = min(square, 1.0) * last
    n = min(int(at), last - 1)
    w = at - n
    for i in range(light.size):
        light[i] *= lamps.limb[row, n, i] + w * (lamps.limb[row, n + 1, i] - lamps.limb[row, n, i])


@inlined
def place_around(around, d):
    """Cell of the map in direction d, its row and column, and the place in it, each from 0 to 1."""
    up = (0.5 + math.asin(min(max(d[2], -1.0), 1.0)) / math.pi) * (around.shape[0] - 1)
    turned = (math.atan2(d[0], d[1]) / (2.0 * math.pi) % 1.0) * around.shape[1]
    row, column = min(int(up), around.shape[0] - 2), min(int(turned), around.shape[1] - 1)
    return row, column, up - row, turned - column


@kernel
def add_around(lamps, d, light):
    """Add the radiance of ``lamps.around`` in direction d, linear between its nodes, to `light` (wavelength,)."""
    around = lamps.around
    row, left, v, u = place_around(around, d)
    right = (left + 1) % around.shape[1]
    for i in range(light.size):
        low = (1.0 - u) * around[row, left, i] + u * around[row, right, i]
        high = (1.0 - u) * around[row + 1, left, i] + u * around[row + 1, right, i]
        light[i] += (1.0 - v) * low + v * high


@inlined
def height_of_row(row, rows):
    """Sine of the elevation of a row of the map."""
    return math.sin(math.pi * (row / (rows - 1) - 0.5))


@kernel
def draw_around(lamps, u, v, d):
    """A direction towards the map by the light of its cells, into `d` (3,); its density [sr-1]."""
    rows, columns = lamps.around.shape[0], lamps.around.shape[1]
    cdf = lamps.around_cdf
    low = first_above(cdf, 0, cdf.size - 1, u)
    before = cdf[low - 1] if low > 0 else 0.0
    share = cdf[low] - before
    row, column = low // columns, low % columns
    bottom, top = height_of_row(row, rows), height_of_row(row + 1, rows)
    # What is left of the number is as good as new.
    d[2] = bottom + min(max((u - before) / share, 0.0), 1.0) * (top - bottom)
    azimuth = 2.0 * math.pi * (column + v) / columns
    flat = math.sqrt(max(1.0 - d[2] * d[2], 0.0))
    d[0], d[1] = flat * math.sin(azimuth), flat * math.cos(azimuth)
    return share * columns / (2.0 * math.pi * (top - bottom))


@kernel
def around_density(lamps, d):
    """Density [sr-1] of `draw_around` in a direction."""
    rows, columns = lamps.around.shape[0], lamps.around.shape[1]
    row, column, _, _ = place_around(lamps.around, d)
    cell = row * columns + column
    share = lamps.around_cdf[cell] - (lamps.around_cdf[cell - 1] if cell > 0 else 0.0)
    return share * columns / (2.0 * math.pi * (height_of_row(row + 1, rows) - height_of_row(row, rows)))


@kernel
def shade(lamps, k, x, d, light, spare):
    """Make mean light (wavelength,) of lamp k that which comes to x from direction d of `aim`.

    An eclipsed disk counts as even over what is free: so its light is exact, and bodies cast shadows of the crescent.
    """
    if k == lamps.eclipsed:
        dim(lamps.moon, x[0], x[1], x[2], light)
    elif lamps.limb_row[k] >= 0:
        darken(lamps, k, ring_of(lamps, k, d), light)
    elif k == lamps.mapped:
        for i in range(light.size):
            spare[i] = 0.0
        add_around(lamps, d, spare)
        for i in range(light.size):
            light[i] *= spare[i] / lamps.power[k, i] if lamps.power[k, i] > 0.0 else 0.0


@kernel
def disk_light(lamps, x, d, light, spare):
    """Radiance of the disks of parallel lamps from x in direction d, into `light` (wavelength,); False beside them."""
    found = False
    for k in range(lamps.kind.size):
        square = ring_of(lamps, k, d)
        if square <= 1.0:
            if k == lamps.eclipsed and behind_moon(lamps.moon, lamps.position[k], x[0], x[1], x[2], d[0], d[1], d[2]):
                continue
            if not found:
                for i in range(light.size):
                    light[i] = 0.0
            found = True
            for i in range(light.size):
                spare[i] = lamps.power[k, i] / (math.pi * lamps.disk[k] ** 2)
            darken(lamps, k, square, spare)
            for i in range(light.size):
                light[i] += spare[i]
    return found


@inlined
def cone_of(p, x):
    """Direction and distance to the middle of a sphere, and 1 - cos of the angle that it fills; 0 from inside."""
    a, b, c = p[0] - x[0], p[1] - x[1], p[2] - x[2]
    distance = math.sqrt(a * a + b * b + c * c)
    opening = 0.0
    if distance > p[3]:
        sine = p[3] / distance
        opening = sine * sine / (1.0 + math.sqrt((1.0 - sine) * (1.0 + sine)))
        a, b, c = a / distance, b / distance, c / distance
    return a, b, c, distance, opening


@inlined
def item_share(lamps, k, n):
    """Chance of the n-th of all lamps' items within its lamp k."""
    return lamps.item_cdf[n] - (lamps.item_cdf[n - 1] if n > lamps.item_first[k] else 0.0)


@kernel
def meeting_density(shapes, lamps, k, item, x, distance, cosine):
    """Density per solid angle [sr-1] with which `aim` at lamp k would draw a direction in which `item` is met.

    `cosine` is that of the angle between the item's outward normal and the way back.
    """
    if not cosine > 0.0:
        return 0.0
    if item < shapes.kind.size and shapes.kind[item] == SPHERE:
        _, _, _, _, opening = cone_of(shapes.parameters[item], x)
        if opening > 0.0:
            share = 4.0 * math.pi * shapes.parameters[item, 3] ** 2 / lamps.area[k]
            return share / (2.0 * math.pi * opening)
    return distance * distance / (lamps.area[k] * cosine)


@kernel
def aim(shapes, lamps, k, x, u, v, d, point):
    """Look from x for lamp k: its direction into `d` (3,); `point` (6,) is scratch.

    Returns
    -------
    distance : [m]; endless to a parallel lamp
    item : that is to be met there, -1 if there is none
    density : per solid angle [sr-1]; 0 of a lamp without extent
    light : its spectral power times this is the radiance [W m-2 sr-1 nm-1], or the irradiance [W m-2 nm-1] of a lamp
        without extent; 0 if nothing shines this way
    """
    if lamps.kind[k] == PARALLEL_LAMP:
        if k == lamps.eclipsed:
            past_moon(lamps, k, x, u, v, d)
        else:
            point_on_disk(lamps, k, u, v, d)
        return math.inf, np.int64(-1), 0.0, 1.0
    if lamps.kind[k] == SURROUNDINGS:
        return math.inf, np.int64(-1), draw_around(lamps, u, v, d), 1.0
    if lamps.kind[k] == POINT_LAMP:
        distance = face(x, lamps.position[k], d)
        a = lamps.axis[k]
        light = lobe_value(lamps, k, -(d[0] * a[0] + d[1] * a[1] + d[2] * a[2])) if distance > 0.0 else 0.0
        return distance, np.int64(-1), 0.0, light / max(distance * distance, 1e-300)
    # An item by its area; what is left of the number is as good as new.
    low = first_above(lamps.item_cdf, lamps.item_first[k], lamps.item_first[k + 1] - 1, u)
    share = item_share(lamps, k, low)
    u = min(max((u - (lamps.item_cdf[low] - share)) / share, 0.0), 1.0)
    item = lamps.item[low]
    if item < shapes.kind.size and shapes.kind[item] == SPHERE:
        p = shapes.parameters[item]
        a, b, c, far, opening = cone_of(p, x)
        if opening > 0.0:
            d[0], d[1], d[2] = a, b, c
            turn(d, 1.0 - u * opening, 2.0 * math.pi * v)
            along = far * (d[0] * a + d[1] * b + d[2] * c)
            # The half chord, by the distance of the ray from the middle.
            height = far * far * u * opening * (2.0 - u * opening)
            half = math.sqrt(max(p[3] * p[3] - height, 0.0))
            distance = along - half
            return distance, item, share / (2.0 * math.pi * opening), brightness(lamps, k, half / p[3])
    sample_item(shapes, item, u, v, point)
    distance = face(x, point, d)
    cosine = -(d[0] * point[3] + d[1] * point[4] + d[2] * point[5])
    if not (cosine > 0.0 and distance > 0.0):
        return distance, item, 0.0, 0.0
    return distance, item, distance * distance / (lamps.area[k] * cosine), brightness(lamps, k, cosine)


@inlined
def face(x, to, d):
    """Unit vector from x to a point, into `d` (3,); returns their distance."""
    a, b, c = to[0] - x[0], to[1] - x[1], to[2] - x[2]
    distance = math.sqrt(a * a + b * b + c * c)
    if distance > 0.0:
        d[0], d[1], d[2] = a / distance, b / distance, c / distance
    return distance


@inlined
def sided(guess, blind, total):
    """Chance of a lamp by the guess and without."""
    return (1.0 - BLIND_SHARE) * guess / total + BLIND_SHARE * blind if total > 0.0 else blind


@inlined
def share_out(guide, chance):
    """Make chances of guesses."""
    total = 0.0
    for k in range(chance.size):
        total += chance[k]
    for k in range(chance.size):
        chance[k] = sided(chance[k], guide.blind[k], total)


@inlined
def pick(chance, u):
    """A lamp by its chance; -1 if there is none to look for."""
    chosen = np.int64(-1)
    for k in range(chance.size):
        if chance[k] > 0.0:
            chosen = np.int64(k)
            if u < chance[k]:
                break
            u -= chance[k]
    return chosen


@kernel
def guess_at_point(lamps, guide, x, n, both_sides, chance):
    """Chances to look for each lamp from a point of a surface with normal n, into `chance` (lamp,)."""
    for k in range(chance.size):
        guess = 0.0
        if lamps.kind[k] == PARALLEL_LAMP:
            m = guide.middle[k]
            cosine = n[0] * m[0] + n[1] * m[1] + n[2] * m[2]
            guess = guide.power[k] * (abs(cosine) if both_sides else max(cosine, 0.0))
        elif lamps.kind[k] == SURROUNDINGS:
            guess = 0.25 * guide.power[k]
        else:
            m, a = guide.middle[k], guide.axis[k]
            dx, dy, dz = m[0] - x[0], m[1] - x[1], m[2] - x[2]
            square = max(dx * dx + dy * dy + dz * dz, 1e-300)
            norm = 1.0 / math.sqrt(square)
            # As far as the lamp is extended, its middle does not tell on which side of a plane it is.
            spread = min(guide.size[k] * norm, 1.0)
            cosine = (n[0] * dx + n[1] * dy + n[2] * dz) * norm
            cosine = min(max((abs(cosine) if both_sides else cosine) + spread, 0.0), 1.0)
            from_axis = -(a[0] * dx + a[1] * dy + a[2] * dz) * norm
            if lamps.kind[k] == POINT_LAMP:
                intensity = lobe_value(lamps, k, from_axis)
            else:
                intensity = guide.typical[k] if from_axis + spread >= guide.lowest[k] else 0.0
            guess = guide.power[k] * intensity * cosine / max(square, guide.size[k] * guide.size[k])
        chance[k] = guess
    share_out(guide, chance)


@merged
def guess_in_medium(lamps, guide, x, chance):
    """Chances to look for each lamp from a point in a medium, into `chance` (lamp,): by what would arrive in vacuum."""
    for k in range(chance.size):
        guess = guide.power[k]
        if lamps.kind[k] != PARALLEL_LAMP and lamps.kind[k] != SURROUNDINGS:
            along, height = place_beside(guide, k, x)
            if height > 0.0:
                # A beam beside the point is taken for a lamp that shines evenly from where it is nearest.
                chance[k] = guess / (4.0 * math.pi * to_beam(along, height) ** 2)
                continue
            m, a = guide.middle[k], guide.axis[k]
            dx, dy, dz = x[0] - m[0], x[1] - m[1], x[2] - m[2]
            square = max(dx * dx + dy * dy + dz * dz, 1e-300)
            cosine = (a[0] * dx + a[1] * dy + a[2] * dz) / square**0.5
            guess *= lobe_value(lamps, k, cosine) if lamps.kind[k] == POINT_LAMP else guide.typical[k]
            guess /= max(square, guide.size[k] * guide.size[k])
        chance[k] = guess
    share_out(guide, chance)
