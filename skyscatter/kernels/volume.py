"""A scene in three dimensions as the solvers' kernels see it: fields, optics, lights, and what arrives from them.

Every light is either a point, whose irradiance falls as 1 / d^2, or so distant that its rays are parallel.  What
reaches a point is power (x 1 / d^2) x transmittance; the transmittance comes from columns (closed forms and quadrature)
or from ratio tracking, unbiased both.

Beside this exact light there is the *guide*: columns towards every light, tabulated on a coarse grid as the mean
density along the way.  It decides where walks look for light and never what they find there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.optics import transmittance
from skyscatter.kernels.space import SpaceTable, SpaceWork, clip_to_space, make_space_work, space_columns

#: Part of the distance to a star that one looks ahead at most.
SHY = 0.3
#: Part of the way to the edge of the medium that one looks ahead at most: what lies outside tells nothing.
INSIDE = 0.5
#: Mean cosine of scattering beyond which the guess of light does not go.
MOST_FORWARD = 0.97
#: Share of scattered light that is guessed to come from all around, however forward: lobes know nothing of sharp turns.
WIDE = 0.1
#: Scatterings on the way to a light that are guessed at least.
FEW = 0.05


@by_address
class MeanPhase(NamedTuple):
    """Scattering averaged over the wavelengths, as tables of one: directions are drawn by it, whatever the hero."""

    sigma_s: np.ndarray  #: (component, 1) mean scattering per unit density [m-1]
    phase: np.ndarray  #: (component, angle, 1) phase function of the scattered light of all wavelengths [sr-1]
    phase_cdf: np.ndarray  #: (component, 1, angle) its distribution function


@by_address
class VolumeTable(NamedTuple):
    """Everything about a scene; components in the order of the fields, the wavelength always last."""

    space: SpaceTable  #: without columns of what dims no light
    clear: SpaceTable  #: the same with columns of nothing but what emits and dims no light
    sigma_s: np.ndarray  #: (component, wavelength) scattering per unit density [m-1]
    sigma_t: np.ndarray  #: (component, wavelength) extinction per unit density [m-1]
    emission: np.ndarray  #: (component, wavelength) [W m-3 sr-1 nm-1]
    phase: np.ndarray  #: (component, angle, wavelength) [sr-1], at cos_theta = 1 - 2 (k / n)^2
    phase_cdf: np.ndarray  #: (component, wavelength, angle) probability of an angle nearer to forward
    mean: MeanPhase
    place: np.ndarray  #: (light, 3) position [m], or direction to a distant light
    distant: np.ndarray  #: (light,) bool
    size: np.ndarray  #: (light,) distance [m] below which the light does not grow any more: the star's radius
    power: np.ndarray  #: (light, wavelength) radiant intensity [W sr-1 nm-1], or irradiance of a distant light
    share: np.ndarray  #: (light,) share of the lights' power, averaged over wavelengths: whose light the walks look for
    background: np.ndarray  #: (wavelength,) uniform radiance from outside [W m-2 sr-1 nm-1]
    emits: bool  #: whether any component shines by itself
    glows: bool  #: whether there is light other than the lights': emission or background
    decay: np.ndarray  #: (wavelength,) exponent with which light in the depths falls per optical depth
    shape: np.ndarray  #: (cosine,) density of directions in the depths [sr-1], from -1 to +1, towards the light
    shape_cdf: np.ndarray  #: (cosine,) its distribution function over the cosine
    around: np.ndarray  #: (angle,) density of the angle from a near star in which light comes [rad-1], 0 to pi
    around_cdf: np.ndarray  #: (angle,) its distribution function
    floor: np.ndarray  #: (wavelength,) irradiance that the guide takes for granted everywhere [W m-2 nm-1]
    rate: np.ndarray  #: (component,) greatest extinction of any wavelength per unit density [m-1], for tracking
    tracking: int  #: how walks find transmittances to lights, see `kernels.tracking`
    onward: np.ndarray  #: (component,) scattering times mean cosine per unit density at the middle wavelength [m-1]
    recall: float  #: share of the scattered light of distant lights that knows their direction where it enters
    #: (x, y, z, wavelength) logarithm of what the guess of all light is to be multiplied by; empty where it is good
    correction: np.ndarray
    guide: np.ndarray  #: (light, x, y, z, component) mean density towards a point light, column to a distant one
    #: (light, axis, 2) where on an axis the guide's nodes crowd, from 0 to 1, and the node there; -1 for even nodes
    focus: np.ndarray


@by_address
class VolumeWork(NamedTuple):
    """Scratch arrays of a thread."""

    space: SpaceWork
    density: np.ndarray  #: (component,) at the current point
    along: np.ndarray  #: (component,) columns along a line [m]
    to_light: np.ndarray  #: (component,) columns to a light [m]
    phase: np.ndarray  #: (component, wavelength) [sr-1]
    arriving: np.ndarray  #: (wavelength,) irradiance, or transmittance
    through: np.ndarray  #: (wavelength,)
    towards: np.ndarray  #: (wavelength,)
    spare: np.ndarray  #: (wavelength,)
    promised: np.ndarray  #: (wavelength,) light that a walk may bring in, as it seemed at its first vertex
    looks: np.ndarray  #: (2,) densities looked up by tracked transmittances, and cells crossed
    excess: np.ndarray  #: (component, 2) densities that tracking found above their bounds: how many, worst ratio


def make_volume_work(components: int, wavelengths: int) -> VolumeWork:
    """Scratch arrays for a scene of that size; a thread needs its own."""
    return VolumeWork(
        make_space_work(), np.zeros(components), np.zeros(components), np.zeros(components),
        np.zeros((components, wavelengths)), np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(wavelengths),
        np.zeros(wavelengths), np.zeros(wavelengths), np.zeros(2), np.zeros((components, 2)),
    )  # fmt: skip


@inlined
def face_light(v, k, x, y, z):
    """Unit vector from a point to light k, its distance [m], and the factor 1 / d^2 (1 for a distant light)."""
    if v.distant[k]:
        return v.place[k, 0], v.place[k, 1], v.place[k, 2], math.inf, 1.0
    a, b, c = v.place[k, 0] - x, v.place[k, 1] - y, v.place[k, 2] - z
    d = math.sqrt(a * a + b * b + c * c)
    near = max(d, v.size[k])
    if d <= 0.0:
        return 0.0, 0.0, 1.0, 0.0, 1.0 / (near * near)
    return a / d, b / d, c / d, d, 1.0 / (near * near)


@inlined
def columns_ahead(v, x, y, z, a, b, c, far, work, out):
    """Columns [m] of every component from a point in a direction as far as `far`, into `out` (component,)."""
    for n in range(out.size):
        out[n] = 0.0
    start, end = clip_to_space(v.space, x, y, z, a, b, c)
    end = min(end, far)
    if end > start:
        space_columns(v.space, x, y, z, a, b, c, start, end, work.space, out)


@inlined
def sum_at(columns, sigma, i):
    """Sum of columns (component,) times `sigma` (component, wavelength) at wavelength number i."""
    total = 0.0
    for c in range(columns.size):
        total += columns[c] * sigma[c, i]
    return total


@inlined
def depth_at(v, columns, i):
    """Optical depth of columns at wavelength number i (or extinction of densities)."""
    return sum_at(columns, v.sigma_t, i)


@inlined
def scattering_at(v, columns, i):
    """Optical depth of columns by scattering at wavelength number i (or scattering of densities)."""
    return sum_at(columns, v.sigma_s, i)


@inlined
def least_depth(v, columns):
    """Optical depth of columns at the most transparent wavelength."""
    least = math.inf
    for i in range(v.sigma_t.shape[1]):
        least = min(least, depth_at(v, columns, i))
    return least


@kernel
def light_arriving(v, k, x, y, z, work):
    """Irradiance of light k at a point into ``work.arriving`` [W m-2 nm-1]; returns the unit vector towards it."""
    a, b, c, d, fall = face_light(v, k, x, y, z)
    columns_ahead(v, x, y, z, a, b, c, d, work, work.to_light)
    transmittance(work.to_light, v.sigma_t, work.arriving)
    for i in range(work.arriving.size):
        work.arriving[i] *= v.power[k, i] * fall
    return a, b, c


@inlined
def guide_place(v, k, axis, x, nodes):
    """Where a coordinate lies on one axis of light k's guide, in cells; the guide repeats as the medium does.

    Around a star, where a hole in the dust may be small, cells grow with the square of their number: the root of the
    distance counts.
    """
    space, last = v.space, nodes - 1
    u = (x - space.bound_low[axis]) / (space.bound_step[axis] * space.cells[axis])
    if space.bound_wrap[axis] != 0:
        u -= math.floor(u)
    u = min(max(u, 0.0), 1.0)
    middle, node = v.focus[k, axis, 0], v.focus[k, axis, 1]
    if node < 0.0:
        return u * last
    if u < middle:
        return node - node * math.sqrt((middle - u) / middle)
    return node + (last - node) * math.sqrt((u - middle) / max(1.0 - middle, 1e-300))


@inlined
def guide_columns(v, k, x, y, z, d, out):
    """Columns towards light k, at distance `d`, from the table of the guide, into `out` (component,)."""
    shape = v.guide.shape
    u = guide_place(v, k, 0, x, shape[1])
    s = guide_place(v, k, 1, y, shape[2])
    t = guide_place(v, k, 2, z, shape[3])
    i, j, m = min(int(u), shape[1] - 2), min(int(s), shape[2] - 2), min(int(t), shape[3] - 2)
    u, s, t = u - i, s - j, t - m
    g = v.guide
    scale = 1.0 if v.distant[k] else d
    for c in range(out.size):
        near = (1.0 - s) * g[k, i, j, m, c] + s * g[k, i, j + 1, m, c]
        far = (1.0 - s) * g[k, i, j, m + 1, c] + s * g[k, i, j + 1, m + 1, c]
        first = (1.0 - t) * near + t * far
        near = (1.0 - s) * g[k, i + 1, j, m, c] + s * g[k, i + 1, j + 1, m, c]
        far = (1.0 - s) * g[k, i + 1, j, m + 1, c] + s * g[k, i + 1, j + 1, m + 1, c]
        out[c] = scale * ((1.0 - u) * first + u * ((1.0 - t) * near + t * far))


@inlined
def forward_gain(g, cosine):
    """What scattering by an angle counts for over its mean: the phase function of Henyey & Greenstein times 4 pi."""
    b = 1.0 + g * (g - 2.0 * cosine)
    return (1.0 - g * g) / (b * math.sqrt(b))


@inlined
def turned_lobes(g, scatterings):
    """Lobes of light that was scattered at least once on a straight way: share of the first, mean cosine of the second.

    How often it was goes by Poisson's law about so many `scatterings`, and each of them multiplies the mean cosine by
    g.  The first lobe, of mean cosine g, is that of light scattered once.
    """
    m = max(scatterings, FEW)
    none = math.exp(-m)
    once, more = m * none, 1.0 - none - m * none
    return once / (once + more), none * (math.exp(m * g) - 1.0 - m * g) / more


@inlined
def turned_gain(v, k, g, then, columns, cosine):
    """What a direction counts for over the mean in light of light number k that was scattered in `columns` before it.

    Multiply by the mean cosine `then` of what it is scattered by next.  Parallel light forgets its direction as it
    diffuses, and what has diffused comes back to where it enters.
    """
    if g < 1e-3:
        return 1.0
    middle, known = v.power.shape[1] // 2, 1.0 - WIDE
    m = scattering_at(v, columns, middle)
    if v.distant[k]:
        known *= v.recall * math.exp((1.0 - v.decay[middle]) * (g - 1.0) * m)
    once, rest = turned_lobes(g, m)
    lobes = once * forward_gain(then * g, cosine) + (1.0 - once) * forward_gain(then * rest, cosine)
    return 1.0 + known * (lobes - 1.0)


@inlined
def guess_light(v, x, y, z, d, g, work, direct, diffuse):
    """Guesses of the light that is scattered at a point against the direction d, each (wavelength,): straight, and all.

    Multiply scattered light of a point falls about as (1 + tau) exp(-kappa tau) / d^2 with the exponent kappa of
    diffusion, which is 1 for black and 0 for white media.  It counts by the angle too, with the mean cosine g of one
    scattering where it comes straight, and else as `turned_gain` has it at the middle wavelength.  Over all directions
    that is one.
    """
    for i in range(direct.size):
        direct[i] = 1e-6 * v.floor[i]
        diffuse[i] = v.floor[i]
    for k in range(v.power.shape[0]):
        a, b, c, far, fall = face_light(v, k, x, y, z)
        cosine = a * d[0] + b * d[1] + c * d[2]
        guide_columns(v, k, x, y, z, far, work.to_light)
        straight, turned = forward_gain(g, cosine), turned_gain(v, k, g, g, work.to_light, cosine)
        for i in range(direct.size):
            work.spare[i] = 0.0
        for c in range(work.to_light.size):
            for i in range(direct.size):
                work.spare[i] += work.to_light[c] * v.sigma_t[c, i]
        for i in range(direct.size):
            tau = work.spare[i]
            light = v.power[k, i] * fall
            direct[i] += light * straight * fast_exp(-tau)
            diffuse[i] += light * turned * (0.1 + tau) * fast_exp(-v.decay[i] * tau)


@inlined
def open_light(v, x, y, z, out):
    """Light that would reach a point if no medium were before the lights, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    for k in range(v.power.shape[0]):
        _, _, _, _, fall = face_light(v, k, x, y, z)
        for i in range(out.size):
            out[i] += v.power[k, i] * fall


@inlined
def cell_place(space, axis, x, cells):
    """The cell whose centre lies before a coordinate on one axis, the next, and how far on between them it is."""
    u = (x - space.bound_low[axis]) / (space.bound_step[axis] * space.cells[axis])
    wraps = space.bound_wrap[axis] != 0
    if wraps:
        u = (u - math.floor(u)) * cells - 0.5
        i = int(math.floor(u))
        return (i + cells) % cells, (i + 1) % cells, u - i
    u = min(max(u * cells - 0.5, 0.0), cells - 1.0)
    i = min(int(u), max(cells - 2, 0))
    return i, min(i + 1, cells - 1), u - i


@inlined
def correct_guess(v, x, y, z, diffuse):
    """Multiply a guess of all light (wavelength,) by its correction."""
    table = v.correction
    if table.shape[0] == 0:
        return
    i0, i1, u = cell_place(v.space, 0, x, table.shape[0])
    j0, j1, s = cell_place(v.space, 1, y, table.shape[1])
    k0, k1, t = cell_place(v.space, 2, z, table.shape[2])
    for n in range(diffuse.size):
        low = (1.0 - s) * table[i0, j0, k0, n] + s * table[i0, j1, k0, n]
        high = (1.0 - s) * table[i0, j0, k1, n] + s * table[i0, j1, k1, n]
        first = (1.0 - t) * low + t * high
        low = (1.0 - s) * table[i1, j0, k0, n] + s * table[i1, j1, k0, n]
        high = (1.0 - s) * table[i1, j0, k1, n] + s * table[i1, j1, k1, n]
        diffuse[n] *= fast_exp((1.0 - u) * first + u * ((1.0 - t) * low + t * high))


@inlined
def transport_length(v, density):
    """Way on which light forgets its direction [m], at the middle wavelength; `density` (component,)."""
    onward = 0.0
    for c in range(density.size):
        onward += density[c] * v.onward[c]
    return 1.0 / max(depth_at(v, density, v.power.shape[1] // 2) - onward, 1e-300)


@inlined
def forwardness(v, density):
    """Mean cosine of the scattering angle at densities (component,), at the middle wavelength."""
    onward = 0.0
    for c in range(density.size):
        onward += density[c] * v.onward[c]
    return onward / max(scattering_at(v, density, v.power.shape[1] // 2), 1e-300)


@inlined
def guessed_forwardness(v, density):
    """`forwardness` as the guess of light goes by it: not below 0, and at most `MOST_FORWARD`."""
    return min(max(forwardness(v, density), 0.0), MOST_FORWARD)


@inlined
def nearest_star(v, x, y, z):
    """Distance from a point to the nearest point light [m]."""
    near = math.inf
    for k in range(v.power.shape[0]):
        if not v.distant[k]:
            _, _, _, d, _ = face_light(v, k, x, y, z)
            near = min(near, d)
    return near


@kernel
def middle_guess(v, x, y, z, d, g, work):
    """The corrected guess of all light at the middle wavelength; ``work.to_light`` is overwritten.

    It is 4 pi times the light that comes from the direction d, or with g = 0 the mean over all directions.
    """
    middle = v.power.shape[1] // 2
    total = v.floor[middle]
    for k in range(v.power.shape[0]):
        a, b, c, far, fall = face_light(v, k, x, y, z)
        guide_columns(v, k, x, y, z, far, work.to_light)
        tau = depth_at(v, work.to_light, middle)
        gain = turned_gain(v, k, g, 1.0, work.to_light, a * d[0] + b * d[1] + c * d[2])
        total += gain * v.power[k, middle] * fall * (0.1 + tau) * fast_exp(-v.decay[middle] * tau)
    table = v.correction
    i0, i1, u = cell_place(v.space, 0, x, table.shape[0])
    j0, j1, s = cell_place(v.space, 1, y, table.shape[1])
    k0, k1, t = cell_place(v.space, 2, z, table.shape[2])
    n = middle
    low = (1.0 - s) * table[i0, j0, k0, n] + s * table[i0, j1, k0, n]
    high = (1.0 - s) * table[i0, j0, k1, n] + s * table[i0, j1, k1, n]
    first = (1.0 - t) * low + t * high
    low = (1.0 - s) * table[i1, j0, k0, n] + s * table[i1, j1, k0, n]
    high = (1.0 - s) * table[i1, j0, k1, n] + s * table[i1, j1, k1, n]
    return max(total * fast_exp((1.0 - u) * first + u * ((1.0 - t) * low + t * high)), 1e-300)


@entry
def fill_guide(v, points, work, out):
    """Mean densities towards every light (columns to distant ones) at its `points` (light, n, 3), into `out`."""
    for k in range(out.shape[0]):
        for n in range(points.shape[1]):
            x, y, z = points[k, n, 0], points[k, n, 1], points[k, n, 2]
            a, b, c, d, _ = face_light(v, k, x, y, z)
            columns_ahead(v, x, y, z, a, b, c, d, work, work.to_light)
            for m in range(out.shape[2]):
                out[k, n, m] = work.to_light[m] if v.distant[k] else work.to_light[m] / max(d, 1e-300)


@entry
def read_guide(v, points, out):
    """Columns [m] towards every light by the guide at `points` (n, 3), into `out` (light, n, component)."""
    for k in range(out.shape[0]):
        for n in range(points.shape[0]):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            _, _, _, d, _ = face_light(v, k, x, y, z)
            guide_columns(v, k, x, y, z, d, out[k, n])
