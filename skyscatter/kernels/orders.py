"""Successive orders of scattering in spherical shells.

Everything is done for a bundle of rays (`bundle.py`) that share one course (`course.py`), for all wavelengths
together: sunlight scattered once (`sunlight.py`), and the gathering of later orders (`gather.py`).
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.bundle import Bundle, Field, make_bundle
from skyscatter.kernels.course import (
    Course,
    Diffuse,
    lay_gauss,
    lay_halves,
    lay_points,
    make_course,
    weigh_cells,
)
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.gather import gather
from skyscatter.kernels.jit import entry, kernel
from skyscatter.kernels.lookup import columns_along, start_columns, trace_line
from skyscatter.kernels.optics import disk_radiance, transmittance
from skyscatter.kernels.rows import add_rows, clear
from skyscatter.kernels.sunlight import (
    AUREOLE_END,
    chain_columns,
    light_bundle,
    light_node,
    narrow_aureole,
    scatter_once,
    spread_peaks,
)
from skyscatter.kernels.work import Work, make_work

#: Distance of stations for sunlight, which has edges, in units of that for other light.
SUNLIT_STATION = 0.5

Scratch = tuple[Work, Course, Bundle, np.ndarray]


@kernel
def _node_rays(r, mu, sun_mu, azimuth, bundle):
    """The rays of a node height in one zenith direction: every Sun node, every azimuth; returns their number."""
    sine = math.sqrt((1.0 - mu) * (1.0 + mu))
    n = 0
    for j in range(sun_mu.size):
        sun_sine = math.sqrt(max((1.0 - sun_mu[j]) * (1.0 + sun_mu[j]), 0.0))
        for a in range(azimuth.shape[0]):
            bundle.q[n] = r * sun_mu[j]
            bundle.nu[n] = min(max(sine * azimuth[a, 0] * sun_sine + mu * sun_mu[j], -1.0), 1.0)
            bundle.w[n] = r * sun_sine * sine * azimuth[a, 1]
            n += 1
    return n


@kernel
def _project(field, suns, mu, weight, take, turns, kept, bundle, fourier, moments, flux):
    """Add the light of one zenith direction to the moments, those that are `kept`, and fluxes of a node height.

    `fourier` (order, stokes, wavelength) is scratch.
    """
    angles, orders, stokes = turns.shape[2], fourier.shape[0], fourier.shape[1]
    wavelengths = fourier.shape[2]
    step = 2.0 * math.pi / angles * weight
    for j in range(suns):
        clear(fourier, 0, orders * stokes * wavelengths)
        for m in range(orders):
            for channel in range(stokes):
                add_rows(
                    fourier, (m * stokes + channel) * wavelengths, turns, (2 * m + (channel >> 1)) * angles, angles,
                    bundle.gathered, (j * angles * stokes + channel) * wavelengths, stokes * wavelengths, wavelengths,
                )  # fmt: skip
        for k in range(field.order.size):
            for channel in range(stokes):
                f = step * take[k, channel]
                if f != 0.0:
                    for i in range(wavelengths):
                        moments[j, kept[k], i] += f * fourier[field.order[k], channel, i]
        side = 1 if mu > 0.0 else 0
        for i in range(wavelengths):
            flux[side, j, i] += step * abs(mu) * fourier[0, 0, i]


@entry
def sweep_heights(columns, diffuse, first, field, altitudes, heights, directions, take, sun_mu, fine_mu, azimuth, turns,
                  kept, is_first, scratch, moments, flux):  # fmt: skip
    """One order of scattering at some of the node heights.

    Parameters
    ----------
    columns : ColumnTable
    diffuse : Diffuse
    first : (use, component, angle, wavelength)
        As for `scatter_once`, with the forward peaks cut off.
    field : Field
        The order before; not used if `is_first`.
    altitudes : (node,)
        Of the nodes [m].
    heights : (some,) int64
        Numbers of those that are meant.
    directions : (node, direction, 2)
        Zenith cosines and weights of the quadrature there.
    take : (node, direction, kept moment, stokes)
    sun_mu, fine_mu : (sun,), (fine sun,)
        Zenith cosines of the Sun at the nodes, and those at which a field to gather from is known.
    azimuth : (angle, 2)
        Cosine and sine of the angles phi of the quadrature over half a turn.
    turns : (order, 2, angle) float32
        cos(m phi) and sin(m phi).
    kept : (kept moment,) int64
        Numbers of the moments of the field among all.
    is_first : bool
        Whether to compute the first order from sunlight, instead of gathering.
    scratch : tuple
        Made by `make_sweep_scratch`.
    moments : (node, sun, moment, wavelength), flux : (node, 2, sun, wavelength), output
        Zeros to begin with.  Fluxes are upward and downward [W m-2 nm-1].
    """
    for h in heights:
        _sweep_height(
            columns, diffuse, first, field, altitudes[h], directions[h], take[h], sun_mu, fine_mu, azimuth, turns, kept,
            is_first, scratch, moments[h], flux[h],
        )  # fmt: skip


@kernel
def _sweep_height(columns, diffuse, first, field, altitude, directions, take, sun_mu, fine_mu, azimuth, turns, kept,
                  is_first, scratch, moments, flux):  # fmt: skip
    """The same at one of them."""
    work, course, bundle, fourier = scratch
    r = columns.radius + altitude
    for k in range(directions.shape[0]):
        mu = directions[k, 0]
        if directions[k, 1] <= 0.0:  # no sky between the horizontal and the horizon, on the ground
            continue
        line = trace_line(columns, 0.0, 0.0, r, math.sqrt((1.0 - mu) * (1.0 + mu)), 0.0, mu)
        n = lay_points(columns, diffuse, line, course, work)
        weigh_cells(diffuse, line.hits_ground, n, course, work)
        rays = _node_rays(r, mu, sun_mu, azimuth, bundle)
        if is_first:
            lay_halves(columns, diffuse, line, n, course, work)
            light_node(columns, diffuse, fine_mu, SUNLIT_STATION * field.station, line, n, rays, course, bundle, work)
            for ray in range(rays):
                scatter_once(columns, diffuse, first, line, n, ray, bundle.many_lit[ray], course, bundle, work)
                for channel in range(bundle.gathered.shape[1]):
                    for i in range(course.glow.size):
                        extra = bundle.reflected[ray, i] + course.glow[i] if channel == 0 else 0.0
                        bundle.gathered[ray, channel, i] = np.float32(bundle.scattered[ray, channel, i] + extra)
        else:
            gather(diffuse, field, line, n, rays, course, bundle)
        _project(field, sun_mu.size, mu, directions[k, 1], take[k], turns, kept, bundle, fourier, moments, flux)


@entry
def refine(packed, row_node, row_weight, low, high, moments):
    """Interpolate a field from its nodes to the rows at which it is gathered.

    Cubic, of the logarithm of the mean radiance (moment 0), which falls by orders of magnitude in twilight, and of the
    ratios of the other moments to it.

    Parameters
    ----------
    packed : (node, sun, moment, wavelength)
        The logarithm, and the ratios.
    row_node, row_weight : (row, 4)
        Four nodes and their weights.
    low, high : int
        Range of Sun nodes to fill; beyond those of `packed` the last is repeated.
    moments : (row, sun, moment, wavelength) float32, output
    """
    count, wavelengths = packed.shape[2], packed.shape[3]
    for j in range(low, high):
        sun = min(j, packed.shape[1] - 1)
        for row in range(moments.shape[0]):
            n, f = row_node[row], row_weight[row]
            for k in range(count):
                for i in range(wavelengths):
                    moments[row, j, k, i] = np.float32(
                        f[0] * packed[n[0], sun, k, i] + f[1] * packed[n[1], sun, k, i]
                        + f[2] * packed[n[2], sun, k, i] + f[3] * packed[n[3], sun, k, i]
                    )  # fmt: skip
            for i in range(wavelengths):
                p, q = packed[n[0], sun, 0, i], packed[n[1], sun, 0, i]
                r, s = packed[n[2], sun, 0, i], packed[n[3], sun, 0, i]
                # Where light ends abruptly, at the edge of night, a cubic would swing beyond its nodes.
                mean = fast_exp(min(max(moments[row, j, 0, i], min(p, q, r, s)), max(p, q, r, s)))
                moments[row, j, 0, i] = np.float32(mean)
                for k in range(1, count):
                    moments[row, j, k, i] *= np.float32(mean)


@entry
def look(columns, diffuse, optics, first, field, origins, directions, group, scratch,
         scattered, reflected, multiple, direct, lit, chain):  # fmt: skip
    """Radiance along rays from a solved field.

    Parameters
    ----------
    columns : ColumnTable
    diffuse : Diffuse
    optics : OpticsTable
    first : (use, component, angle, wavelength)
        Phase function times scattering per unit density, and b1 times it; whole, with its forward peak.
    field : Field
        Sum of all orders.
    origins, directions : (ray, 3)
    group : (group + 1,) int64
        Rays ``group[g]`` to ``group[g + 1]`` share one course; no more of them than the bundle holds.
    scratch : tuple
        Made by `make_sweep_scratch`.
    scattered, multiple : (ray, stokes, wavelength), reflected, direct : (ray, wavelength), output
        Scattered once, scattered or reflected more often, reflected once by the ground, unscattered (the disk of the
        Sun, emission, light from outside) [W m-2 sr-1 nm-1].
    lit : (ray, component, wavelength), output
        Sunlight that is scattered once, without the phase function, see `light_bundle`; empty where nobody asks.
    chain : (ray, component, wavelength), output
        Columns [m] along which peaks widen, see `chain_columns`; empty where nobody asks, else zeros to begin with.
    """
    work, course, bundle, _ = scratch
    s = optics.disk_axis
    stokes, wavelengths = scattered.shape[1], scattered.shape[2]
    for g in range(group.size - 1):
        begin, rays = group[g], group[g + 1] - group[g]
        o, d = origins[begin], directions[begin]
        line = trace_line(columns, o[0], o[1], o[2], d[0], d[1], d[2])
        n = 0
        if line.leave > line.enter or line.hits_ground:
            n = lay_points(columns, diffuse, line, course, work)
            weigh_cells(diffuse, line.hits_ground, n, course, work)
            lay_gauss(columns, diffuse, line, n, course, work)
            for ray in range(rays):
                o, d = origins[begin + ray], directions[begin + ray]
                bundle.q[ray] = o[0] * s[0] + o[1] * s[1] + o[2] * s[2]
                bundle.nu[ray] = min(max(d[0] * s[0] + d[1] * s[1] + d[2] * s[2], -1.0), 1.0)
                bundle.w[ray] = (
                    o[0] * (s[1] * d[2] - s[2] * d[1])
                    + o[1] * (s[2] * d[0] - s[0] * d[2])
                    + o[2] * (s[0] * d[1] - s[1] * d[0])
                )
            light_bundle(columns, diffuse, line, n, rays, course, bundle, work)
            for ray in range(rays):
                scatter_once(columns, diffuse, first, line, n, ray, bundle.many_lit[ray], course, bundle, work)
            widens = diffuse.peaks.shape[1] > 0 and not line.hits_ground
            if widens and chain_columns(columns, diffuse, s, origins[begin], directions[begin], line, n, course, work):
                nearest = bundle.nu[0]
                for ray in range(1, rays):
                    nearest = max(nearest, bundle.nu[ray])
                if nearest > AUREOLE_END:
                    spread_peaks(diffuse, work.weighted, nearest, bundle)
                for ray in range(rays):
                    narrow_aureole(diffuse, ray, bundle)
                    if chain.shape[0] > 0:
                        for c in range(chain.shape[1]):
                            for i in range(wavelengths):
                                chain[begin + ray, c, i] = work.weighted[c, i]
            gather(diffuse, field, line, n, rays, course, bundle)
        for ray in range(rays):
            to = begin + ray
            for i in range(wavelengths):
                for channel in range(stokes):
                    scattered[to, channel, i] = bundle.scattered[ray, channel, i] if n > 0 else 0.0
                    multiple[to, channel, i] = bundle.gathered[ray, channel, i] if n > 0 else 0.0
                reflected[to, i] = bundle.reflected[ray, i] if n > 0 else 0.0
                direct[to, i] = course.glow[i] if n > 0 else diffuse.light[0, i]
            if lit.shape[0] > 0:
                for c in range(lit.shape[1]):
                    for i in range(wavelengths):
                        lit[to, c, i] = bundle.many_lit[ray, c, i] if n > 0 else 0.0
            d = directions[to]
            if not line.hits_ground and disk_radiance(optics, d[0], d[1], d[2], work.sun):
                for c in range(work.along.size):
                    work.along[c] = 0.0
                if line.leave > line.enter:
                    start_columns(columns, line, work.from_start, work.across)
                    columns_along(columns, line, line.leave, work.from_start, work.across, work.along)
                transmittance(work.along, optics.sigma_t, work.through)
                for i in range(wavelengths):
                    direct[to, i] += work.sun[i] * work.through[i]


def make_sweep_scratch(
    diffuse: Diffuse, field: Field, stokes: int, rays: int
) -> tuple[Work, Course, Bundle, np.ndarray]:
    """Scratch of `sweep_heights` and `look` for bundles of so many rays; a thread needs its own."""
    blocks, components, degrees, wavelengths = diffuse.greek.shape
    orders = field.recurrence.shape[3]
    return (
        make_work(components, wavelengths),
        make_course(diffuse.shell.size, components, wavelengths),
        make_bundle(rays, field, stokes, components, blocks, degrees, diffuse.peaks.shape[1]),
        np.zeros((orders, stokes, wavelengths), np.float32),
    )
