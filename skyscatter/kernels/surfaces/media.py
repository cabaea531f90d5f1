"""Media between surfaces: which one a ray is in, flights through it, transmittances, scattering.

A ray carries a stack of the media it is inside of.  The one of highest priority is met, where several are equal the one
entered last (simple nested dielectrics: Schmidt & Budge 2002, J. Graphics Tools 7, 1), and medium 0 outside of all.

Media that are the same everywhere are treated in closed form.  In others the column along the ray is found and
inverted (`kernels.space`), with no collision rejected.  All of a walk's wavelengths go the same way: the hero draws,
and ``walk.chance`` takes what each of them would have drawn it with, see `kernels.path`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.directions import turn
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.optics import sample_cosine
from skyscatter.kernels.path import rebalance
from skyscatter.kernels.space import SpaceWork, make_space_work
from skyscatter.kernels.surfaces.fields import (
    add_air_columns,
    add_air_densities,
    add_field_columns,
    clip_to_air,
    clip_to_fields,
    field_densities,
)
from skyscatter.kernels.tabulated import angle_cell

#: Optical depth is inverted to this, in parts of 1 + depth.
INVERTED = 1e-10


@by_address
class MediaWork(NamedTuple):
    """Scratch arrays of a thread."""

    space: SpaceWork
    density: np.ndarray  #: (component,) at an event; zero of components of other media
    along: np.ndarray  #: (component,) columns along a ray [m]
    first: np.ndarray  #: (component,) the same to a nearer point
    outward: np.ndarray  #: (component,) columns of shells to the edge of the air [m], or densities
    beyond: np.ndarray  #: (component,) the same from further out [m]
    through: np.ndarray  #: (wavelength,) transmittance of the last flight
    towards: np.ndarray  #: (wavelength,) scattering coefficient times phase function [m-1 sr-1]
    total: np.ndarray  #: (wavelength,) scattering coefficient [m-1]


class Phases(NamedTuple):
    """What `sample_cosine` reads: a whole table of media, copied at every call, would cost more than the draw."""

    phase: np.ndarray  #: (component, angle, wavelength)
    phase_cdf: np.ndarray  #: (component, wavelength, angle)


def make_media_work(components: int, wavelengths: int) -> MediaWork:
    """Scratch arrays for media with so many components in all; a thread needs its own."""
    return MediaWork(
        make_space_work(), *(np.zeros(components) for _ in range(5)), *(np.zeros(wavelengths) for _ in range(3))
    )  # fmt: skip


@inlined
def current_medium(media, stack):
    """Number of the medium that a ray with this stack is in."""
    m = np.int64(0)
    if stack[0] >= 0:
        m = stack[0]
        for k in range(1, stack.size):
            if stack[k] >= 0 and media.priority[stack[k]] >= media.priority[m]:
                m = stack[k]
    return m


@inlined
def push(stack, m):
    """Enter medium m; False if the ray is inside of too many media to remember one more."""
    k = 0
    while k < stack.size and stack[k] >= 0:
        k += 1
    if k == stack.size:
        return False
    stack[k] = m
    return True


@inlined
def pull(stack, m):
    """Leave medium m, where it was entered last; False if the ray was not inside of it (a surface with holes)."""
    k = stack.size - 1
    while k >= 0 and stack[k] != m:
        k -= 1
    if k < 0:
        return False
    for j in range(k, stack.size - 1):
        stack[j] = stack[j + 1]
    stack[stack.size - 1] = -1
    return True


@kernel
def medium_density(media, m, x, y, z, work):
    """Densities of the components of medium m at a point, those of other media zero, into ``work.density``."""
    density = work.density
    if media.constant[m]:
        for c in range(density.size):
            density[c] = 0.0
    else:
        field_densities(media.space, x, y, z, work.space, density)
        add_air_densities(media.shells, media.centre, x, y, z, work, density)
    for c in range(density.size):
        density[c] = density[c] + media.density[c] if media.first[m] <= c < media.first[m + 1] else 0.0


@kernel
def clip_to_media(media, x, d):
    """Where a ray enters and leaves the region outside of which no medium changes; never without any that does."""
    start, end = clip_to_fields(media.space, x[0], x[1], x[2], d[0], d[1], d[2])
    enter, leave = clip_to_air(media.shells, media.centre, x, d)
    if not leave > enter:
        return start, end
    # Of a region that is missed nothing counts, not even where it would lie.
    return (min(start, enter), max(end, leave)) if end > start else (enter, leave)


@kernel
def add_columns(media, m, x, d, start, end, work, out):
    """Add the columns of medium m along x + d t from start to end [m] to `out` (component,)."""
    if not end > start:
        return
    add_field_columns(media.space, x[0], x[1], x[2], d[0], d[1], d[2], start, end, work.space, out)
    add_air_columns(media.shells, media.centre, x, d, start, end, work, out)
    for c in range(out.size):
        if not media.first[m] <= c < media.first[m + 1]:
            out[c] = 0.0
        elif media.density[c] > 0.0:
            out[c] += media.density[c] * (end - start)


@inlined
def depth_of(media, m, columns, i):
    """Optical depth of columns at wavelength number i, or extinction of densities."""
    tau = 0.0
    for c in range(media.first[m], media.first[m + 1]):
        # An endless column of what dims no light is no depth.
        if media.sigma_t[c, i] > 0.0:
            tau += columns[c] * media.sigma_t[c, i]
    return tau


@inlined
def spectral_depth(media, m, columns, out):
    """Optical depth of columns, or extinction of densities, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    for c in range(media.first[m], media.first[m + 1]):
        if columns[c] == math.inf:
            for i in range(out.size):
                out[i] += math.inf if media.sigma_t[c, i] > 0.0 else 0.0
        else:
            for i in range(out.size):
                out[i] += columns[c] * media.sigma_t[c, i]


@inlined
def dim_constant(extinction, far, out):
    """Transmittance of a medium that is the same everywhere, into `out` (wavelength,)."""
    if far == math.inf:
        for i in range(out.size):
            out[i] = 0.0 if extinction[i] > 0.0 else 1.0
    else:
        for i in range(out.size):
            out[i] = fast_exp(-extinction[i] * far)


@kernel
def dim_through(media, m, x, d, far, work, out):
    """Transmittance of any medium from x in direction d over the distance `far`, into `out` (wavelength,)."""
    for c in range(work.along.size):
        work.along[c] = 0.0
    add_columns(media, m, x, d, 0.0, far, work, work.along)
    spectral_depth(media, m, work.along, out)
    for i in range(out.size):
        out[i] = fast_exp(-out[i])


@kernel
def transmit(media, m, x, d, far, work, out):
    """Transmittance of medium m from x in direction d over the distance `far` [m], into `out` (wavelength,).

    `far` may be endless.  Leaves the columns in ``work.along`` if the medium is not the same everywhere.
    """
    if media.constant[m]:
        dim_constant(media.extinction[m], far, out)
    else:
        dim_through(media, m, x, d, far, work, out)


@kernel
def reach(media, m, i, x, d, far, wanted, work):
    """Distance [m] at which the optical depth at wavelength number i is `wanted`; endless if that is beyond `far`.

    Newton's steps within a bracket, whose lower end takes its columns along.
    """
    first, along = work.first, work.along
    for c in range(first.size):
        first[c], along[c] = 0.0, 0.0
    constant = depth_of(media, m, media.density, i)
    start, end = clip_to_media(media, x, d)
    top = far if far < math.inf else (end if end > start else 0.0)
    add_columns(media, m, x, d, 0.0, top, work, along)
    depth = depth_of(media, m, along, i)
    if depth < wanted or not depth > 0.0:
        # Nothing but what is the same everywhere lies beyond.
        return top + (wanted - depth) / constant if far == math.inf and constant > 0.0 else math.inf
    low, high, t = 0.0, top, top * (wanted / depth)
    for _ in range(80):
        for c in range(along.size):
            along[c] = first[c]
        add_columns(media, m, x, d, low, t, work, along)
        miss = depth_of(media, m, along, i) - wanted
        if miss < 0.0:
            low = t
            for c in range(along.size):
                first[c] = along[c]
        else:
            high = t
        if abs(miss) < INVERTED * (1.0 + wanted) or high - low < 1e-14 * top:
            break
        medium_density(media, m, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work)
        sigma = depth_of(media, m, work.density, i)
        t = t - miss / sigma if sigma > 0.0 else 0.5 * (low + high)
        if not low < t < high:
            t = 0.5 * (low + high)
    return t


@kernel
def fly(media, m, hero, x, d, far, u, walk, work):
    """Fly to the next extinction event of the hero, or as far as `far` [m], which may be endless.

    Value and chances of the walk take the transmittance, the chances also the extinction where there is an event; both
    are rebalanced.  Leaves the transmittance in ``work.through`` and, of an event, the densities in ``work.density``.

    Returns
    -------
    t : distance flown [m]
    hit : whether there is an event; the walk itself is not moved
    """
    wanted = -math.log1p(-u)
    if media.constant[m]:
        sigma = media.extinction[m, hero]
        t = wanted / sigma if sigma > 0.0 else math.inf
    else:
        t = reach(media, m, hero, x, d, far, wanted, work)
    hit = t < far
    if not hit:
        t = far
    transmit(media, m, x, d, t, work, work.through)
    for i in range(walk.value.size):
        walk.value[i] *= work.through[i]
        walk.chance[i] *= work.through[i]
    if hit:
        medium_density(media, m, x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2], work)
        spectral_depth(media, m, work.density, work.total)
        for i in range(walk.chance.size):
            walk.chance[i] *= work.total[i]
    rebalance(walk)
    return t, hit


@kernel
def scattering(media, m, density, cos_theta, work, out):
    """Scattering coefficient times phase function at densities (component,), into `out` (wavelength,) [m-1 sr-1].

    The scattering coefficient alone goes to ``work.total`` [m-1].
    """
    k, w = angle_cell(cos_theta, media.phase.shape[1] - 1)
    for i in range(out.size):
        out[i], work.total[i] = 0.0, 0.0
    for c in range(media.first[m], media.first[m + 1]):
        n = density[c]
        for i in range(out.size):
            sigma = n * media.sigma_s[c, i]
            low, high = media.phase[c, k, i], media.phase[c, k + 1, i]
            work.total[i] += sigma
            out[i] += sigma * (low + w * (high - low))


@kernel
def draw_scattered(media, m, hero, u, v, work, direction):
    """Turn a direction by the phase function of a component that scatters the hero; False if there is none."""
    density, total = work.density, 0.0
    for c in range(media.first[m], media.first[m + 1]):
        total += density[c] * media.sigma_s[c, hero]
    if not total > 0.0:
        return False
    rest, chosen, part = u * total, np.int64(0), 1.0
    for c in range(media.first[m], media.first[m + 1]):
        s = density[c] * media.sigma_s[c, hero]
        if s > 0.0:
            chosen, part = c, s  # type: ignore[assignment]
            if rest < s:
                break
            rest -= s
    # What is left of the number after the choice is as good as a new one.
    share = min(max(rest / part, 0.0), 1.0 - 1e-16)
    cosine = sample_cosine(Phases(media.phase, media.phase_cdf), chosen, hero, share)
    turn(direction, cosine, 2.0 * math.pi * v)
    return True


@kernel
def scatter_walk(media, m, hero, u, v, work, walk):
    """New direction of a walk at an event whose densities are in ``work.density``; False if it ends there.

    The value takes the scattering coefficient times the phase function [m-1 sr-1], the chances the phase function
    [sr-1]: with the extinction that `fly` put into the chances, the albedo remains.
    """
    d = walk.direction
    old_x, old_y, old_z = d[0], d[1], d[2]
    if not draw_scattered(media, m, hero, u, v, work, d):
        return False
    scattering(media, m, work.density, old_x * d[0] + old_y * d[1] + old_z * d[2], work, work.towards)
    for i in range(walk.value.size):
        walk.value[i] *= work.towards[i]
        walk.chance[i] *= work.towards[i] / work.total[i] if work.total[i] > 0.0 else 0.0
    return rebalance(walk)
