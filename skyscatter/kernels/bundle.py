"""Bundles of rays that share one course through the atmosphere, and the field that they look at.

A ray of a bundle is three numbers: with o its origin, d its direction and s the direction to the Sun,

    q = o . s,   nu = d . s,   w = o . (s x d),

from which the Sun's zenith cosine, the azimuth from the Sun and the plane of scattering follow at every point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.stations import OPEN, cubic_weight

#: Positions of the Sun for which sunlight is tabulated for a large bundle, at most.
MOST_SUNS = 128
#: Rays that a station's light is given to together.
AT_ONCE = 16
#: Positions of the Sun for which the first order's sunlight is known, for each node of the field.
SUN_REFINEMENT = 2


@by_address
class Field(NamedTuple):
    """A field of moments to gather from; single precision, for it is the bulk of the work."""

    moments: np.ndarray  #: (row, sun, moment, wavelength)
    ground: np.ndarray  #: (sun, wavelength) radiance of the ground
    degree: np.ndarray  #: (moment,) int64
    order: np.ndarray  #: (moment,) int64
    by_order: np.ndarray  #: (moment,) int64 numbers of the moments, rising in order
    gives: np.ndarray  #: (moment, use, 4) int64; see `skyscatter.solvers.moments`
    bound: np.ndarray  #: (row, moment) greatest magnitude in units of the mean radiance at its place
    recurrence: np.ndarray  #: (2, 3, degree, order) coefficients of the angular functions, for d_m0 and d_m2
    station: float  #: angle at the planet's centre between two places at which a course's light is put together [rad]
    least: float  #: share of the isotropic part of a source below which others are left out


@by_address
class Bundle(NamedTuple):
    """Scratch for a bundle of rays; a thread needs its own."""

    q: np.ndarray  #: (ray,)
    nu: np.ndarray  #: (ray,)
    w: np.ndarray  #: (ray,)
    sun: np.ndarray  #: (ray,) int64 first of the four Sun nodes around a point's
    part: np.ndarray  #: (ray, 4) float32 weights of the four nodes
    azimuth: np.ndarray  #: (2, ray) float32 cosine and sine of the azimuth from the Sun
    gathered: np.ndarray  #: (ray, stokes, wavelength) float32 light of all but the first order
    scattered: np.ndarray  #: (ray, stokes, wavelength) sunlight scattered once
    reflected: np.ndarray  #: (ray, wavelength) sunlight reflected once
    spread: np.ndarray  #: (component, degree, wavelength) float32 what forward peaks lose by widening
    here: np.ndarray  #: (wavelength,) float32 irradiance at a ray
    step: np.ndarray  #: (component, wavelength) float32 what a Gauss point makes of it
    many_lit: np.ndarray  #: (ray, component, wavelength) float32 sunlight on the way, by what scatters it
    sunlight: np.ndarray  #: (sun, wavelength) float32 irradiance at a Gauss point
    lit: np.ndarray  #: (station, fine sun, component, wavelength) float32 sunlight at open stations, by what scatters
    phase: np.ndarray  #: (component, wavelength)
    functions: np.ndarray  #: (3, degree, order) angular functions at a point
    active: np.ndarray  #: (moment + 1,) int64 numbers of the moments that matter at a point, and one that may not
    begins: np.ndarray  #: (order + 1,) int64 where among those the ones of every order begin
    factor: np.ndarray  #: (moment, use, wavelength) float32
    weight: np.ndarray  #: (block, degree, wavelength) float32 of the moments at a point
    size: np.ndarray  #: (wavelength,) float32 weight of a point without regard to signs
    shared: np.ndarray  #: (wavelength,) float32 the part of it that comes from one row
    relative: np.ndarray  #: (block, degree) float32 greatest weight of a degree at a point, in units of that
    mean: np.ndarray  #: (sun, wavelength) float32 size of the source at a point
    fourier: np.ndarray  #: (sun, order, stokes, wavelength) float32 source at a point
    level: np.ndarray  #: (station, sun, wavelength) float32 size of the source at open stations, or its logarithm
    source: np.ndarray  #: (station, sun, order, stokes, wavelength) float32 source at open stations
    reach: np.ndarray  #: (station, 3) int64 first and last Sun node of a station, number of its orders
    turns: np.ndarray  #: (order, 2, some rays) float32 cosines and sines of multiples of their azimuths
    sum: np.ndarray  #: (stokes, wavelength) float32 source of a station in the direction of a ray


def make_bundle(rays: int, field: Field, stokes: int, components: int, blocks: int, degrees: int, peaks: int) -> Bundle:
    """An empty bundle for a field and courses with weights of so many blocks and degrees."""
    suns = field.moments.shape[1]
    moments, wavelengths = field.moments.shape[2:]
    known, orders = field.recurrence.shape[2:]
    return Bundle(
        np.zeros(rays), np.zeros(rays), np.zeros(rays), np.zeros(rays, np.int64), np.zeros((rays, 4), np.float32),
        np.zeros((2, rays), np.float32),
        np.zeros((rays, stokes, wavelengths), np.float32), np.zeros((rays, stokes, wavelengths)),
        np.zeros((rays, wavelengths)), np.zeros((components, peaks, wavelengths), np.float32),
        np.zeros(wavelengths, np.float32),
        np.zeros((components, wavelengths), np.float32),
        np.zeros((rays, components, wavelengths), np.float32),
        np.zeros((max(SUN_REFINEMENT * suns, MOST_SUNS), wavelengths), np.float32),
        np.zeros((OPEN, SUN_REFINEMENT * suns, components, wavelengths), np.float32),
        np.zeros((components, wavelengths)),
        np.zeros((3, known, orders)), np.zeros(moments + 1, np.int64), np.zeros(orders + 1, np.int64),
        np.zeros((moments, field.gives.shape[1], wavelengths), np.float32),
        np.zeros((blocks, degrees, wavelengths), np.float32),
        np.zeros(wavelengths, np.float32), np.zeros(wavelengths, np.float32), np.zeros((blocks, degrees), np.float32),
        np.zeros((suns, wavelengths), np.float32), np.zeros((suns, orders, stokes, wavelengths), np.float32),
        np.zeros((OPEN, suns, wavelengths), np.float32),
        np.zeros((OPEN, suns, orders, stokes, wavelengths), np.float32),
        np.zeros((OPEN, 3), np.int64), np.zeros((orders, 2, AT_ONCE), np.float32),
        np.zeros((stokes, wavelengths), np.float32),
    )  # fmt: skip


@inlined
def cubic(v, ray, part):
    """Weights of Lagrange's cubic through nodes 0, 1, 2, 3 at v, into ``part[ray]``."""
    for k in range(4):
        part[ray, k] = np.float32(cubic_weight(v, k))


@inlined
def sun_node(diffuse, angle, refinement, suns):
    """The first of the four of so many Sun nodes that are around a zenith angle of the Sun [rad].

    A table over the angle says about which: over the cosine none follows it near the zenith.
    """
    cubics = diffuse.sun_cubics[refinement - 1]
    guess = refinement * diffuse.sun_index[int(angle * ((diffuse.sun_index.size - 1) / math.pi))]
    j = min(max(int(guess) - 1, 0), suns - 4)
    while j < suns - 4 and angle >= cubics[j, 2]:
        j += 1
    while j > 0 and angle < cubics[j, 1]:
        j -= 1
    return j


@inlined
def sun_cubic(cubics, j, angle, ray, part):
    """Weights of Lagrange's cubic through Sun nodes j to j + 3 for a zenith angle [rad], into ``part[ray]``.

    Through the angles themselves, as `skyscatter.solvers.grid.sun_cubics` has them: where light is scattered a hundred
    times, and each time read a little away from where it is, that adds up.  Beyond the nodes the last one goes on.
    """
    x = min(max(angle, cubics[0, 0]), cubics[cubics.shape[0] - 1, 3])
    a, b, c, d = x - cubics[j, 0], x - cubics[j, 1], x - cubics[j, 2], x - cubics[j, 3]
    part[ray, 0] = np.float32(b * c * d * cubics[j, 4])
    part[ray, 1] = np.float32(a * c * d * cubics[j, 5])
    part[ray, 2] = np.float32(a * b * d * cubics[j, 6])
    part[ray, 3] = np.float32(a * b * c * cubics[j, 7])


@inlined
def sun_cosine(along, per_r, ray, bundle):
    """Cosine of the Sun's zenith angle on a ray, so far along it, at one over a radius.

    All that ask for it have the same bits: a ray that stands on a node finds no other nodes than `sun_reach` does.
    """
    return min(max((bundle.q[ray] + along * bundle.nu[ray]) * per_r, -1.0), 1.0)


@kernel
def sun_reach(diffuse, line, t, r, refinement, suns, rays, bundle):
    """The lowest and the highest Sun node that the rays need at distance t, of four around each; as `place_rays`."""
    low, high = 1.0, -1.0
    per_r, along = 1.0 / r, t - line.start
    for ray in range(rays):
        x = sun_cosine(along, per_r, ray, bundle)
        low, high = min(low, x), max(high, x)
    return sun_node(diffuse, math.acos(high), refinement, suns), sun_node(diffuse, math.acos(low), refinement, suns) + 3


@kernel
def place_rays(diffuse, line, t, r, refinement, suns, rays, bundle):
    """Sun nodes of every ray at distance t; there are so many, `refinement` for each of the field's."""
    per_r, along = 1.0 / r, t - line.start
    for ray in range(rays):
        angle = math.acos(sun_cosine(along, per_r, ray, bundle))
        j = sun_node(diffuse, angle, refinement, suns)
        bundle.sun[ray] = j
        sun_cubic(diffuse.sun_cubics[refinement - 1], j, angle, ray, bundle.part)


@kernel
def turn_rays(line, t, r, rays, bundle):
    """Azimuth from the Sun of every ray at distance t."""
    per_r, along = 1.0 / r, t - line.start
    mu, sine = t * per_r, line.p * per_r
    for ray in range(rays):
        x = sun_cosine(along, per_r, ray, bundle)
        norm = sine * math.sqrt((1.0 - x) * (1.0 + x))
        norm = 1.0 / norm if norm > 1e-12 else 0.0
        bundle.azimuth[0, ray] = np.float32(min(max((bundle.nu[ray] - mu * x) * norm, -1.0), 1.0))
        bundle.azimuth[1, ray] = np.float32(min(max(bundle.w[ray] * per_r * norm, -1.0), 1.0))
