"""One leg of a camera walk through one medium: what is lost on it, what shines on it, where it may be scattered.

Every leg has two ends: a *vertex* in the medium, always on the leg (forced scattering), and the surface or the depth
behind it.  A walk takes one of them; its first time, and beyond mirrors where the leg is thin, both.  The chance of the
vertex is

    q = w (1 - T) / (w (1 - T) + r T)

with w the albedo of the leg's medium, T its transmittance and r the reflectance of what is behind it: nothing is spent
on media that only absorb nor on black walls.  Vertices have the density s T(t) / (1 - T), s being the extinction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import INTERFACE, LAMBERT, MIRROR, STACK
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import kernel, merged
from skyscatter.kernels.path import Walk, make_walk
from skyscatter.kernels.random import EVEN_DIMENSIONS, uniform
from skyscatter.kernels.surfaces.beams import aim_at_beam, density_near_beam, draw_near_beam
from skyscatter.kernels.surfaces.media import (
    MediaWork,
    add_columns,
    clip_to_media,
    dim_constant,
    make_media_work,
    medium_density,
    reach,
    spectral_depth,
    transmit,
)
from skyscatter.kernels.surfaces.walkpolar import WalkPolar

#: Numbers in ``Scratch.at``: interactions so far; what the last was; what the vertex before was; the item that ends the
#: leg, -1 where it does not end; the item on which the ray starts; the leg's medium; whether the walk has been divided
#: or may be; the most interactions; how many splits have parts left, see `kernels.surfaces.splits`; whether the empty
#: sky's light is counted already, see `kernels.surfaces.emptysky`; and whether nothing but mirrors and smooth glass has
#: turned the walk.
ORDER, LAST, BEFORE, ITEM, SKIP, IN, DIVIDED, WHOLE, MOST, SPLITS, KNOWN, STRAIGHT = range(12)
#: Numbers in ``Scratch.far``: where on the ray the leg begins; its length; what the chances kept were divided by since,
#: inverted; the vertex that was drawn on the leg; how much of the view lamps fill at the vertex turned at; what
#: the walk was worth where it began, 0 before; how much more often a vertex is drawn than by free flight alone; what
#: the level of roulette is multiplied by, see `kernels.surfaces.turns`.
NEAR, LENGTH, SCALE, VERTEX, NEARBY, BEGUN, OFTEN, FADED = 0, 1, 2, 3, 4, 5, 6, 7
#: Splits of a walk that may have parts left.
MOST_SPLITS = 12


@by_address
class Scratch(NamedTuple):
    """Scratch arrays of a thread."""

    walk: Walk
    media: MediaWork
    at: np.ndarray  #: (12,) int64 state of the walk, see `ORDER` and so on
    far: np.ndarray  #: (8,) state of the walk, see `NEAR` and so on
    first_stack: np.ndarray  #: (STACK,) media in which the camera's ray begins
    stack: np.ndarray  #: (STACK,) media that the walk is inside of
    other_stack: np.ndarray  #: (STACK,) beyond a surface
    saved_stack: np.ndarray  #: (STACK,) where the first leg was divided
    shadow_stack: np.ndarray  #: (STACK,)
    start: np.ndarray  #: (3,) of the leg
    place: np.ndarray  #: (3,) on it
    aside: np.ndarray  #: (3,) direction towards a lamp
    back: np.ndarray  #: (3,) direction back along the leg
    normal: np.ndarray  #: (3,) of a surface
    shadow_place: np.ndarray  #: (3,)
    hit: np.ndarray  #: (4,)
    saved_hit: np.ndarray  #: (4,)
    shadow_hit: np.ndarray  #: (4,)
    point: np.ndarray  #: (6,) on a lamp
    kept: np.ndarray  #: (3, 3) what is known of the vertex before, see `kernels.surfaces.gathering`
    saved: np.ndarray  #: (3, 3) ray on which the walk was divided, and the distance from which its leg began
    chance: np.ndarray  #: (lamp,) of the lamps
    through: np.ndarray  #: (wavelength,) T of the leg
    lost: np.ndarray  #: (wavelength,) 1 - T without loss of digits
    event: np.ndarray  #: (wavelength,) q
    free: np.ndarray  #: (wavelength,) density of a vertex at a point [m-1]
    halfway: np.ndarray  #: (wavelength,) transmittance to that point
    light: np.ndarray  #: (wavelength,) transmittance to a lamp
    onward: np.ndarray  #: (wavelength,) chance to pass all boundaries on the way there
    piece: np.ndarray  #: (wavelength,)
    spare: np.ndarray  #: (wavelength,)
    factor: np.ndarray  #: (wavelength,) of a surface, or emission
    density: np.ndarray  #: (wavelength,) of a direction at a surface
    kept_chance: np.ndarray  #: (wavelength,) the walk's chances at the vertex before
    kept_free: np.ndarray  #: (wavelength,) the same times the density of the vertex
    kept_phase: np.ndarray  #: (wavelength,) density of the direction that was drawn there, by what scatters [sr-1]
    saved_value: np.ndarray  #: (wavelength,)
    saved_chance: np.ndarray  #: (wavelength,)
    parts: np.ndarray  #: (split, 3) int64 parts of the walk that are left, their order and medium
    parted_stack: np.ndarray  #: (split, STACK) media that they are inside of
    parted: np.ndarray  #: (split, 8) start, direction, length and vertex of their leg
    parted_spectra: np.ndarray  #: (split, 4, wavelength) value, chances, q, 1 - T
    joined: np.ndarray  #: (component + 4, wavelength) of the empty sky's light
    sums: np.ndarray  #: (batch, wavelength)
    shift: np.ndarray  #: (batch, dimension) uint32
    polar: WalkPolar | None


def make_scratch(
    components: int, wavelengths: int, lamps: int, batches: int, polar: WalkPolar | None = None
) -> Scratch:
    """Scratch arrays for a scene of that size; a thread needs its own."""
    spectra = [np.zeros(wavelengths) for _ in range(16)]
    stacks = [np.full(STACK, -1, np.int64) for _ in range(5)]
    points = [np.zeros(3) for _ in range(6)]
    hits = [np.zeros(4) for _ in range(3)]
    return Scratch._make([
        make_walk(wavelengths), make_media_work(components, wavelengths), np.zeros(12, np.int64), np.zeros(8), *stacks,
        *points, *hits, np.zeros(6), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(lamps), *spectra,
        np.zeros((MOST_SPLITS, 3), np.int64), np.full((MOST_SPLITS, STACK), -1, np.int64), np.zeros((MOST_SPLITS, 8)),
        np.zeros((MOST_SPLITS, 4, wavelengths)),
        np.zeros((components + 4, wavelengths)),
        np.zeros((batches, wavelengths)),
        np.zeros((batches, EVEN_DIMENSIONS), np.uint32),
        polar,
    ])  # fmt: skip


@kernel
def measure_leg(media, m, x, d, far, s):
    """Transmittance of the leg into ``s.through`` and what it loses into ``s.lost``."""
    if media.constant[m]:
        dim_constant(media.extinction[m], far, s.through)
        for i in range(s.lost.size):
            tau = media.extinction[m, i] * far if media.extinction[m, i] > 0.0 else 0.0
            s.lost[i] = 1.0 - s.through[i] if tau > 1e-4 else tau * (1.0 - 0.5 * tau)
        return
    along = s.media.along
    for c in range(along.size):
        along[c] = 0.0
    add_columns(media, m, x, d, 0.0, far, s.media, along)
    spectral_depth(media, m, along, s.lost)
    for i in range(s.lost.size):
        tau = s.lost[i]
        s.through[i] = fast_exp(-tau)
        s.lost[i] = 1.0 - s.through[i] if tau > 1e-4 else tau * (1.0 - 0.5 * tau)


@kernel
def weigh_vertex(media, materials, m, row, columns, lost, through, event):
    """Chance q of the vertex of a leg under each hero, into `event`; `row` of the material behind, -1 for none.

    Of a medium that is not the same everywhere the albedo is that of the columns.
    """
    kind = materials.kind[row] if row >= 0 else INTERFACE
    told = kind in (LAMBERT, MIRROR) and materials.mosaic[row] < 0
    for i in range(event.size):
        bright, all_of_it = 0.0, 0.0
        for c in range(media.first[m], media.first[m + 1]):
            n = media.density[c] if media.constant[m] else min(columns[c], 1e300)
            bright += n * media.sigma_s[c, i]
            all_of_it += n * media.sigma_t[c, i]
        scattered = lost[i] * bright / all_of_it if all_of_it > 0.0 else 0.0
        behind = 0.0
        if row >= 0:
            behind = through[i] * materials.reflectance[row, i] if told else through[i]
        event[i] = scattered / (scattered + behind) if scattered > 0.0 else 0.0


@kernel
def draw_vertex(table, m, hero, x, d, far, u, s):
    """Distance [m] of a vertex on a measured leg by the hero's extinction; negative if the hero loses nothing there.

    Where a lamp has a narrow beam, a share of the vertices is drawn by where the leg passes it.
    """
    media, lost = table.media, s.lost[hero]
    if not lost > 0.0:
        return -1.0
    share, middle, scale, low, high = aim_at_beam(table.guide, x, d, far)
    if u < share:
        return min(max(draw_near_beam(middle, scale, low, high, u / share), 0.0), far)
    u = (u - share) / (1.0 - share)
    wanted = -math.log1p(-u * lost)
    if media.constant[m]:
        return min(wanted / media.extinction[m, hero], far)
    t = reach(media, m, hero, x, d, far, wanted, s.media)
    return t if t < math.inf else -1.0


@kernel
def look_at(table, m, x, d, far, t, s):
    """Transmittance to t on a measured leg, density of a vertex there, densities of the components there.

    Into ``s.halfway``, ``s.free`` and ``s.media.density``.
    """
    media = table.media
    transmit(media, m, x, d, t, s.media, s.halfway)
    medium_density(media, m, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], s.media)
    spectral_depth(media, m, s.media.density, s.free)
    share, middle, scale, low, high = aim_at_beam(table.guide, x, d, far)
    near = share * density_near_beam(middle, scale, low, high, t) if share > 0.0 else 0.0
    s.far[OFTEN] = 1.0
    for i in range(s.free.size):
        # Thinner than 1e-12 a leg is evenly lossy to the last digit.
        sure = s.lost[i] > 1e-12
        s.free[i] = s.free[i] * s.halfway[i] / s.lost[i] if sure else (1.0 / far if s.lost[i] > 0.0 else 0.0)
        if share > 0.0 and s.lost[i] > 0.0:
            plain = s.free[i]
            s.free[i] = (1.0 - share) * plain + near
            if i == s.free.size // 2 and plain > 0.0:
                s.far[OFTEN] = s.free[i] / plain


@merged
def gather_emission(media, m, x, d, far, s):
    """What the medium itself shines along a measured leg, into ``s.factor`` (wavelength,) [W m-2 sr-1 nm-1]."""
    out, walk = s.factor, s.walk
    for i in range(out.size):
        out[i] = 0.0
    if media.constant[m]:
        for c in range(media.first[m], media.first[m + 1]):
            for i in range(out.size):
                out[i] += media.density[c] * media.emission[c, i]
        for i in range(out.size):
            # Where nothing is lost the leg is as long as it is.
            sigma = media.extinction[m, i]
            out[i] *= s.lost[i] / sigma if s.lost[i] > 0.0 else (far if out[i] > 0.0 else 0.0)
        return
    start, end = clip_to_media(media, x, d)
    start, end = max(start, 0.0), min(end, far)
    for c in range(media.first[m], media.first[m + 1]):
        if media.density[c] > 0.0 and far < math.inf:
            start, end = 0.0, far
    if not end > start:
        return
    t = start + uniform(walk.state) * (end - start)
    transmit(media, m, x, d, t, s.media, s.halfway)
    medium_density(media, m, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], s.media)
    for c in range(media.first[m], media.first[m + 1]):
        for i in range(out.size):
            out[i] += s.media.density[c] * media.emission[c, i]
    for i in range(out.size):
        out[i] *= s.halfway[i] * (end - start)
