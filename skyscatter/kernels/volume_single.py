"""Light that is scattered at most once in a medium of three dimensions, by adaptive quadrature along every ray.

The integral along a ray is cut at the sharp edges of the medium and, growing geometrically, around the points nearest
to the stars, where the light rises as 1 / d^2.  Each piece is bisected until the Kronrod rule of 15 points and the
Gauss rule of 7 within it agree.  Columns from the ray's start are summed from node to node, so a piece costs one pass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, kernel
from skyscatter.kernels.lookup import sort_few
from skyscatter.kernels.optics import phase_at, transmittance
from skyscatter.kernels.space import (
    clip_to_box,
    clip_to_space,
    space_columns,
    space_densities,
    term_cuts,
)
from skyscatter.kernels.volume import VolumeWork, light_arriving, make_volume_work

#: Kronrod's rule of 15 points on [-1, 1] (Piessens et al. 1983, QUADPACK, qk15), from the left.
_X = (
    0.991455371120812639206854697526329, 0.949107912342758524526189684047851, 0.864864423359769072789712788640926,
    0.741531185599394439863864773280788, 0.586087235467691130294144838258730, 0.405845151377397166906606412076961,
    0.207784955007898467600689403773245,
)  # fmt: skip
_W = (
    0.022935322010529224963732008058970, 0.063092092629978553290700663189204, 0.104790010322250183839876322541518,
    0.140653259715525918745189590510238, 0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
    0.204432940075298892414161999234649,
)  # fmt: skip
_G = (0.129484966168869693270611432679082, 0.279705391489276667901467771423780, 0.381830050505118944950369775488975)
NODES = np.array([-x for x in _X] + [0.0] + list(_X[::-1]))
KRONROD = np.array([*_W, 0.209482141084727828012999174891714, *_W[::-1]])
GAUSS = np.zeros(15)
GAUSS[1::2] = [*_G, 0.417959183673469387755102040816327, *_G[::-1]]
#: Factor by which the pieces around a star grow.
GROWTH = 5.0
#: Cuts of a ray at most, and bisections of a piece at most.
MOST_CUTS, MOST_LEVELS = 512, 40


@by_address
class SingleScratch(NamedTuple):
    """Scratch arrays of `volume_single_rays`."""

    work: VolumeWork
    cuts: np.ndarray  #: (MOST_CUTS,)
    ends: np.ndarray  #: (MOST_LEVELS,) right ends of the pieces that wait
    kronrod: np.ndarray  #: (2, wavelength) scattered and emitted light of a piece
    gauss: np.ndarray  #: (2, wavelength)
    first: np.ndarray  #: (piece, 4, wavelength) both rules' light of the pieces, unrefined
    first_column: np.ndarray  #: (piece, component) columns at their ends
    rough: np.ndarray  #: (wavelength,) light of the whole ray, unrefined
    column: np.ndarray  #: (component,) columns at the start of a piece
    running: np.ndarray  #: (component,) columns at the current node


def make_single_scratch(components: int, wavelengths: int) -> SingleScratch:
    """Scratch arrays for a scene of that size; a thread needs its own."""
    return SingleScratch(
        make_volume_work(components, wavelengths), np.zeros(MOST_CUTS), np.zeros(MOST_LEVELS),
        np.zeros((2, wavelengths)), np.zeros((2, wavelengths)), np.zeros((MOST_CUTS, 4, wavelengths)),
        np.zeros((MOST_CUTS, components)), np.zeros(wavelengths), np.zeros(components), np.zeros(components),
    )  # fmt: skip


@kernel
def add_source(v, x, y, z, d, through, kronrod_weight, gauss_weight, s):
    """Add what a point sends back along the ray, dimmed by `through`, to the two rules' sums."""
    work = s.work
    space_densities(v.space, x, y, z, work.space, work.density)
    something = False
    for c in range(work.density.size):
        something = something or work.density[c] > 0.0
    if not something:
        return
    for k in range(v.power.shape[0]):
        a, b, e = light_arriving(v, k, x, y, z, work)
        phase_at(v.phase, d[0] * a + d[1] * b + d[2] * e, work.phase)
        for i in range(through.size):
            work.towards[i] = 0.0
        for c in range(work.density.size):
            n = work.density[c]
            for i in range(through.size):
                work.towards[i] += n * v.sigma_s[c, i] * work.phase[c, i]
        for i in range(through.size):
            light = through[i] * work.arriving[i] * work.towards[i]
            s.kronrod[0, i] += kronrod_weight * light
            s.gauss[0, i] += gauss_weight * light
    if v.emits:
        for c in range(work.density.size):
            n = work.density[c]
            for i in range(through.size):
                light = through[i] * n * v.emission[c, i]
                s.kronrod[1, i] += kronrod_weight * light
                s.gauss[1, i] += gauss_weight * light


@kernel
def integrate_piece(v, o, d, a, b, s):
    """Both rules over [a, b]; ``s.running`` goes from the columns at a to those at b."""
    half, middle = 0.5 * (b - a), 0.5 * (a + b)
    for j in range(2):
        for i in range(s.rough.size):
            s.kronrod[j, i], s.gauss[j, i] = 0.0, 0.0
    if not b > a:
        return
    last = a
    for n in range(NODES.size):
        t = middle + half * NODES[n]
        space_columns(v.space, o[0], o[1], o[2], d[0], d[1], d[2], last, t, s.work.space, s.running)
        last = t
        transmittance(s.running, v.sigma_t, s.work.through)
        add_source(
            v, o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2], d, s.work.through, half * KRONROD[n],
            half * GAUSS[n], s,
        )  # fmt: skip
    space_columns(v.space, o[0], o[1], o[2], d[0], d[1], d[2], last, b, s.work.space, s.running)


@kernel
def add_edges(space, term, o, d, start, end, work, cuts, n):
    """Add the sharp edges of one term along a line, as far as half of the room goes; the number of cuts."""
    box = space.box[term]
    a, b = clip_to_box(box[0], box[1], o[0], o[1], o[2], d[0], d[1], d[2], start, end)
    if b <= a:
        return n
    edges = term_cuts(space, term, o[0] + a * d[0], o[1] + a * d[1], o[2] + a * d[2], d[0], d[1], d[2], b - a, work)
    for k in range(edges):
        t = a + work.cuts[k]
        if start < t < end and 2 * n < cuts.size:
            cuts[n] = t
            n += 1
    return n


@kernel
def cut_ray(v, o, d, start, end, work, cuts):
    """Where the quadrature must stop: at sharp edges, and at pieces that grow from the points nearest to the stars."""
    cuts[0], cuts[1], n = start, end, np.int64(2)
    for term in range(v.space.box.shape[0]):
        n = add_edges(v.space, term, o, d, start, end, work, cuts, n)
    share = (cuts.size - n) // (2 * max(v.power.shape[0], 1))
    for k in range(v.power.shape[0]):
        if v.distant[k]:
            continue
        a, b, c = v.place[k, 0] - o[0], v.place[k, 1] - o[1], v.place[k, 2] - o[2]
        near = a * d[0] + b * d[1] + c * d[2]
        e, f, g = b * d[2] - c * d[1], c * d[0] - a * d[2], a * d[1] - b * d[0]
        apart = max(math.sqrt(e * e + f * f + g * g), v.size[k], 1e-9 * (end - start))
        for sign in range(2):
            step, t, count = apart, near, 0
            while count < share - 1 and (t < end if sign == 0 else t > start):
                if start < t < end:
                    cuts[n] = t
                    n += 1
                t = near + step if sign == 0 else near - step
                step *= GROWTH
                count += 1
    sort_few(cuts, n)
    return n


@entry
def volume_single_rays(v, origins, directions, tolerance, s, scattered, direct):
    """Light of the lights scattered once, and emission and background unscattered, along many rays.

    Parameters
    ----------
    v : VolumeTable
    origins, directions : (ray, 3)
    tolerance : float
        Largest disagreement of the two rules on a piece, relative to the light of the whole ray.
    s : SingleScratch
    scattered, direct : (ray, wavelength), output
        [W m-2 sr-1 nm-1]
    """
    for ray in range(origins.shape[0]):
        o, d = origins[ray], directions[ray]
        for i in range(s.rough.size):
            scattered[ray, i], direct[ray, i], s.rough[i] = 0.0, 0.0, 0.0
        for c in range(s.column.size):
            s.column[c], s.running[c] = 0.0, 0.0
        start, end = clip_to_space(v.space, o[0], o[1], o[2], d[0], d[1], d[2])
        if end > start:
            n = cut_ray(v, o, d, start, end, s.work.space, s.cuts)
            # Once through, to know how much light there is; then with care where the rules disagree.
            for k in range(n - 1):
                integrate_piece(v, o, d, s.cuts[k], s.cuts[k + 1], s)
                for i in range(s.rough.size):
                    s.rough[i] += s.kronrod[0, i] + s.kronrod[1, i]
                    for j in range(2):
                        s.first[k, j, i] = s.kronrod[j, i]
                        s.first[k, 2 + j, i] = s.gauss[j, i]
                for c in range(s.column.size):
                    s.first_column[k, c] = s.running[c]
            for k in range(n - 1):
                finish_piece(v, o, d, k, tolerance, s, scattered[ray], direct[ray])
        transmittance(s.column, v.sigma_t, s.work.through)
        for i in range(s.rough.size):
            direct[ray, i] += v.background[i] * s.work.through[i]


@kernel
def finish_piece(v, o, d, k, tolerance, s, scattered, direct):
    """Add the light of a piece as it was found first, or, where the rules disagree, bisected."""
    worst = 0.0
    for i in range(s.rough.size):
        miss = abs(s.first[k, 0, i] - s.first[k, 2, i]) + abs(s.first[k, 1, i] - s.first[k, 3, i])
        if miss > 0.0:
            worst = max(worst, miss / max(s.rough[i], 1e-300))
    if worst > tolerance:
        refine_piece(v, o, d, s.cuts[k], s.cuts[k + 1], tolerance, s, scattered, direct)
    else:
        for i in range(s.rough.size):
            scattered[i] += s.first[k, 0, i]
            direct[i] += s.first[k, 1, i]
    for c in range(s.column.size):
        s.column[c] = s.first_column[k, c]


@kernel
def refine_piece(v, o, d, a, b, tolerance, s, scattered, direct):
    """Bisect a piece from the left until both rules agree, and add its light."""
    shortest = 1e-9 * (b - a)
    s.ends[0], waiting = b, 1
    while waiting > 0:
        end = s.ends[waiting - 1]
        for c in range(s.column.size):
            s.running[c] = s.column[c]
        integrate_piece(v, o, d, a, end, s)
        worst = 0.0
        for i in range(s.rough.size):
            miss = abs(s.kronrod[0, i] - s.gauss[0, i]) + abs(s.kronrod[1, i] - s.gauss[1, i])
            have = max(s.rough[i], scattered[i] + direct[i])
            if miss > 0.0:
                worst = max(worst, miss / max(have, 1e-300))
        if worst > tolerance and waiting < s.ends.size and end - a > shortest:
            s.ends[waiting] = 0.5 * (a + end)
            waiting += 1
            continue
        for i in range(s.rough.size):
            scattered[i] += s.kronrod[0, i]
            direct[i] += s.kronrod[1, i]
        for c in range(s.column.size):
            s.column[c] = s.running[c]
        a = end
        waiting -= 1
