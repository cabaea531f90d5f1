"""Successive orders of scattering in spherical shells: sunlight scattered once, and the gathering of later orders.

Everything is done for a *bundle* of rays that share one course (`course.py`), for all wavelengths together.  A ray of
a bundle is three numbers: with o its origin, d its direction and s the direction to the Sun,

    q = o . s,   nu = d . s,   w = o . (s x d),

from which the Sun's zenith cosine, the azimuth from the Sun and the plane of scattering follow at every point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.solvers.kernels.course import (
    Course,
    Diffuse,
    lay_gauss,
    lay_points,
    make_course,
    put_gauss,
    weigh_cells,
)
from skyscatter.solvers.kernels.fastexp import fast_exp
from skyscatter.solvers.kernels.jit import entry, inlined, kernel, merged
from skyscatter.solvers.kernels.lookup import columns_along, columns_to_light, start_columns, trace_line
from skyscatter.solvers.kernels.optics import disk_radiance, phase_at, transmittance
from skyscatter.solvers.kernels.work import Work, make_work

#: Cosine of the Sun's zenith angle above which the disk acts as its middle.
HIGH_SUN = 0.12
#: Spacing in the Sun's cosine of the table of sunlight for a large bundle: in units of 1, near the horizon, and what
#: it grows by with the cosine's distance from there; and the most entries of that table.
SMOOTH_STEP, SMOOTH_GROWTH, MOST_SUNS = 0.002, 0.05, 128
#: Cosines of the angle from the Sun down to which the widening of forward peaks counts in full, and where it ends.
AUREOLE_FULL, AUREOLE_END = math.cos(math.radians(30.0)), math.cos(math.radians(60.0))
#: Degrees with less than this share of the isotropic part of a source are left out of it.
LEAST_SHARE = 1e-3
#: Halvings with which the edge of the planet's shadow is found within a cell.
EDGE_STEPS = 12


class Field(NamedTuple):
    """A field of moments to gather from; single precision, for it is the bulk of the work."""

    moments: np.ndarray  #: (row, sun, moment, wavelength)
    ground: np.ndarray  #: (sun, wavelength) radiance of the ground
    degree: np.ndarray  #: (moment,) int64
    order: np.ndarray  #: (moment,) int64
    gives: np.ndarray  #: (moment, use, 4) int64; see `skyscatter.solvers.moments`
    recurrence: np.ndarray  #: (2, order, degree, 3) coefficients of the angular functions, for d_m0 and d_m2


class Bundle(NamedTuple):
    """Scratch for a bundle of rays; a thread needs its own."""

    q: np.ndarray  #: (ray,)
    nu: np.ndarray  #: (ray,)
    w: np.ndarray  #: (ray,)
    sun: np.ndarray  #: (ray,) int64 first of the four Sun nodes around a point's
    part: np.ndarray  #: (ray, 6) float32: weights of the four nodes, cosine and sine of the azimuth from the Sun
    gathered: np.ndarray  #: (ray, stokes, wavelength) float32 light of all but the first order
    scattered: np.ndarray  #: (ray, stokes, wavelength) sunlight scattered once
    reflected: np.ndarray  #: (ray, wavelength) sunlight reflected once
    spread: np.ndarray  #: (component, degree, wavelength) float32 what forward peaks lose by widening
    here: np.ndarray  #: (wavelength,) float32 irradiance at a ray
    step: np.ndarray  #: (component, wavelength) float32 what a Gauss point makes of it
    many_lit: np.ndarray  #: (ray, component, wavelength) float32 sunlight on the way, by what scatters it
    sunlight: np.ndarray  #: (sun, wavelength) float32 irradiance at a Gauss point
    phase: np.ndarray  #: (component, wavelength)
    functions: np.ndarray  #: (3, order, degree) angular functions at a point
    active: np.ndarray  #: (moment,) int64 numbers of the moments that matter at a point
    factor: np.ndarray  #: (moment, use, wavelength) float32
    fourier: np.ndarray  #: (sun, order, stokes, wavelength) float32 source at a point


Scratch = tuple[Work, Course, Bundle, np.ndarray]


def make_bundle(rays: int, suns: int, field: Field, stokes: int, components: int, peaks: int) -> Bundle:
    """An empty bundle for a field."""
    moments, wavelengths = field.moments.shape[2:]
    orders, degrees = field.recurrence.shape[1:3]
    return Bundle(
        np.zeros(rays), np.zeros(rays), np.zeros(rays), np.zeros(rays, np.int64), np.zeros((rays, 6), np.float32),
        np.zeros((rays, stokes, wavelengths), np.float32), np.zeros((rays, stokes, wavelengths)),
        np.zeros((rays, wavelengths)), np.zeros((components, peaks, wavelengths), np.float32),
        np.zeros(wavelengths, np.float32),
        np.zeros((components, wavelengths), np.float32),
        np.zeros((rays, components, wavelengths), np.float32),
        np.zeros((max(suns, MOST_SUNS), wavelengths), np.float32),
        np.zeros((components, wavelengths)),
        np.zeros((3, orders, degrees)), np.zeros(moments, np.int64),
        np.zeros((moments, field.gives.shape[1], wavelengths), np.float32),
        np.zeros((suns, orders, stokes, wavelengths), np.float32),
    )  # fmt: skip


@inlined
def _tilted(mu, cosine, sine):
    """Cosine of a zenith angle that is larger by a small angle."""
    return mu * cosine - math.sqrt(max((1.0 - mu) * (1.0 + mu), 0.0)) * sine


@inlined
def _disk_nodes(diffuse, mu):
    """Range of the zenith offsets that stand for the Sun: its middle, or where it is low the two of its disk."""
    if mu > HIGH_SUN or diffuse.tilt[1, 1] == 0.0:
        return 0, 1
    return 1, 3


@kernel
def _add_sunlight(columns, diffuse, r, mu, node, q, course, lit, work):
    """Add what Gauss point number q scatters of the light of one node of the disk, per component, to `lit`."""
    if columns_to_light(columns, r, mu, work.spare, work.to_sun):
        transmittance(work.to_sun, diffuse.sigma_t, work.sun)
        for i in range(work.sun.size):
            work.sun[i] *= diffuse.share[node, i]
        for c in range(lit.shape[0]):
            for i in range(work.sun.size):
                lit[c, i] += course.source[q, c, i] * work.sun[i]


@kernel
def _half_lit_cell(columns, diffuse, line, s, q, nu, node, first_lit, course, lit, work):
    """Sunlight in a cell that the edge of the planet's shadow crosses: two Gauss points on the lit part."""
    lit_end, dark_end = (course.t[s], course.t[s + 1]) if first_lit else (course.t[s + 1], course.t[s])
    a, b = lit_end, dark_end
    for _ in range(EDGE_STEPS):
        t = 0.5 * (a + b)
        r = math.sqrt(line.p * line.p + t * t)
        ratio = columns.radius / r
        mu = _tilted((q + (t - line.start) * nu) / r, diffuse.tilt[node, 0], diffuse.tilt[node, 1])
        if mu + math.sqrt(max((1.0 - ratio) * (1.0 + ratio), 0.0)) >= 0.0:
            a = t
        else:
            b = t
    spare_point = course.gauss.shape[0] - 1
    for g in range(2):
        t = lit_end + (a - lit_end) * (0.21132486540518713 if g == 0 else 0.7886751345948129)
        put_gauss(columns, diffuse, line, t, 0.5 * abs(a - lit_end), spare_point, course, work)
        r = course.gauss[spare_point, 1]
        mu = _tilted((q + (t - line.start) * nu) / r, diffuse.tilt[node, 0], diffuse.tilt[node, 1])
        _add_sunlight(columns, diffuse, r, mu, node, spare_point, course, lit, work)


@kernel
def _sunlit_cell(columns, diffuse, line, s, points, q, nu, course, lit, work):
    """Add the sunlight that one ray receives in cell s, with `points` Gauss points and the edge of the shadow."""
    mu_0 = (q + (course.t[s] - line.start) * nu) / course.place[s, 0]
    mu_1 = (q + (course.t[s + 1] - line.start) * nu) / course.place[s + 1, 0]
    first, last = _disk_nodes(diffuse, min(mu_0, mu_1))
    for node in range(first, last):
        cosine, sine = diffuse.tilt[node, 0], diffuse.tilt[node, 1]
        lit_0 = _tilted(mu_0, cosine, sine) + course.place[s, 2] >= 0.0
        lit_1 = _tilted(mu_1, cosine, sine) + course.place[s + 1, 2] >= 0.0
        if lit_0 and lit_1:
            for g in range(points):
                k = s * points + g
                r = course.gauss[k, 1]
                mu = (q + (course.gauss[k, 0] - line.start) * nu) / r
                mu = min(max(_tilted(mu, cosine, sine), -1.0), 1.0)
                _add_sunlight(columns, diffuse, r, mu, node, k, course, lit, work)
        elif lit_0 or lit_1:
            _half_lit_cell(columns, diffuse, line, s, q, nu, node, lit_0, course, lit, work)


@kernel
def _sunlight(columns, diffuse, r, sun_mu, work, out):
    """Irradiance of the Sun's disk at radius r under a zenith cosine of its middle, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = np.float32(0.0)
    first, last = _disk_nodes(diffuse, sun_mu)
    for node in range(first, last):
        mu = min(max(_tilted(sun_mu, diffuse.tilt[node, 0], diffuse.tilt[node, 1]), -1.0), 1.0)
        if columns_to_light(columns, r, mu, work.spare, work.to_sun):
            transmittance(work.to_sun, diffuse.sigma_t, work.sun)
            for i in range(out.size):
                out[i] += np.float32(work.sun[i] * diffuse.share[node, i])


@kernel
def _add_interpolated(diffuse, k, rays, course, bundle):
    """Add what Gauss point k makes of ``bundle.sunlight``, interpolated to every ray, to ``bundle.many_lit``."""
    components, wavelengths = bundle.step.shape[0], bundle.step.shape[1]
    for c in range(components):
        for i in range(wavelengths):
            bundle.step[c, i] = np.float32(course.source[k, c, i])
    for ray in range(rays):
        j = bundle.sun[ray]
        v_0, v_1 = bundle.part[ray, 0], bundle.part[ray, 1]
        v_2, v_3 = bundle.part[ray, 2], bundle.part[ray, 3]
        # Two nodes at a time: the compiler makes SIMD code of two, not of four.
        for i in range(wavelengths):
            bundle.here[i] = v_0 * bundle.sunlight[j, i] + v_1 * bundle.sunlight[j + 1, i]
        for i in range(wavelengths):
            bundle.here[i] += v_2 * bundle.sunlight[j + 2, i] + v_3 * bundle.sunlight[j + 3, i]
        for c in range(components):
            if diffuse.scatters[c]:
                for i in range(wavelengths):
                    bundle.many_lit[ray, c, i] += bundle.step[c, i] * bundle.here[i]


@inlined
def _cubic(v, part):
    """Weights of Lagrange's cubic through nodes 0, 1, 2, 3 at v."""
    part[0] = np.float32((1.0 - v) * (2.0 - v) * (3.0 - v) / 6.0)
    part[1] = np.float32(v * (2.0 - v) * (3.0 - v) / 2.0)
    part[2] = np.float32(v * (v - 1.0) * (3.0 - v) / 2.0)
    part[3] = np.float32(v * (v - 1.0) * (v - 2.0) / 6.0)


@inlined
def _sun_range(line, t, r, rays, bundle):
    """Least and greatest cosine of the Sun's zenith angle on the rays of a bundle at distance t."""
    low, high = 1.0, -1.0
    for ray in range(rays):
        x = (bundle.q[ray] + (t - line.start) * bundle.nu[ray]) / r
        low, high = min(low, x), max(high, x)
    return low, high


@merged
def _smooth_point(columns, diffuse, line, k, rays, count, course, bundle, work):
    """Sunlight at Gauss point k for many rays in full sunlight: interpolated from `count` positions of the Sun."""
    t, r = course.gauss[k, 0], course.gauss[k, 1]
    low, high = _sun_range(line, t, r, rays, bundle)
    spacing = max((high - low) / (count - 1), 1e-9)
    for j in range(count):
        _sunlight(columns, diffuse, r, min(low + j * spacing, 1.0), work, bundle.sunlight[j])
    for ray in range(rays):
        f = ((bundle.q[ray] + (t - line.start) * bundle.nu[ray]) / r - low) / spacing
        j = min(max(int(f) - 1, 0), count - 4)
        bundle.sun[ray] = j
        _cubic(f - j, bundle.part[ray])
    _add_interpolated(diffuse, k, rays, course, bundle)


@kernel
def light_bundle(columns, diffuse, line, n, points, rays, course, bundle, work):
    """Sunlight that reaches the rays' start after one scattering, without the phase function, into ``bundle.many_lit``.

    Int T n_c E dt, per ray and component [m W m-2 nm-1].  Where all rays of a large bundle are in full sunlight, it is
    interpolated from a few positions of the Sun; elsewhere every ray is followed by itself, with the shadow's edge.
    """
    for ray in range(rays):
        for c in range(bundle.step.shape[0]):
            for i in range(bundle.step.shape[1]):
                bundle.many_lit[ray, c, i] = np.float32(0.0)
    low_1, high_1 = _sun_range(line, course.t[0], course.place[0, 0], rays, bundle)
    for s in range(n - 1):
        low_0, high_0 = low_1, high_1
        low_1, high_1 = _sun_range(line, course.t[s + 1], course.place[s + 1, 0], rays, bundle)
        edge = diffuse.tilt[1, 1]
        if max(high_0 + course.place[s, 2], high_1 + course.place[s + 1, 2]) < -edge:
            continue  # night
        above = min(low_0 + course.place[s, 2], low_1 + course.place[s + 1, 2])
        width = max(high_0 - low_0, high_1 - low_1)
        count = max(int(width / (SMOOTH_STEP + SMOOTH_GROWTH * max(above, 0.0))) + 2, 4)
        if above > edge and 2 * count <= rays and count <= bundle.sunlight.shape[0]:
            for g in range(points):
                _smooth_point(columns, diffuse, line, s * points + g, rays, count, course, bundle, work)
        else:
            for ray in range(rays):
                _sunlit_cell(
                    columns, diffuse, line, s, points, bundle.q[ray], bundle.nu[ray], course, bundle.many_lit[ray], work
                )


@kernel
def sunlit_ground(columns, diffuse, mu, work, out):
    """Radiance that the ground reflects of direct sunlight at a zenith cosine of the Sun, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    first, last = _disk_nodes(diffuse, mu)
    for node in range(first, last):
        mu_s = min(_tilted(mu, diffuse.tilt[node, 0], diffuse.tilt[node, 1]), 1.0)
        if mu_s > 0.0 and columns_to_light(columns, columns.radius, mu_s, work.spare, work.to_sun):
            transmittance(work.to_sun, diffuse.sigma_t, work.sun)
            for i in range(out.size):
                out[i] += work.sun[i] * diffuse.share[node, i] * mu_s * diffuse.light[2, i] / math.pi


@kernel
def light_node(columns, diffuse, sun_mu, line, n, rays, course, bundle, work):
    """`light_bundle` for the rays of a node, with one Gauss point in a cell, into ``bundle.many_lit``.

    At each Gauss point the irradiance is computed for the field's Sun nodes `sun_mu` and interpolated to the rays:
    its many rays meet the same few Suns.
    """
    for ray in range(rays):
        for c in range(bundle.step.shape[0]):
            for i in range(bundle.step.shape[1]):
                bundle.many_lit[ray, c, i] = np.float32(0.0)
    for s in range(n - 1):
        t, r = course.gauss[s, 0], course.gauss[s, 1]
        low, high = _place_rays(diffuse, line, t, r, sun_mu.size, rays, bundle)
        for j in range(low, high + 1):
            _sunlight(columns, diffuse, r, sun_mu[j], work, bundle.sunlight[j])
        _add_interpolated(diffuse, s, rays, course, bundle)


@kernel
def scatter_once(columns, diffuse, first, line, n, ray, lit, course, bundle, work):
    """Sunlight on a ray, scattered and reflected once, into ``bundle.scattered`` and ``bundle.reflected``.

    `lit` is the sunlight (component, wavelength); `first` (use, component, angle, wavelength) the phase function times
    scattering per unit density, and with polarisation b1 times the same.
    """
    stokes, wavelengths = bundle.scattered.shape[1], bundle.scattered.shape[2]
    q, nu, w = bundle.q[ray], bundle.nu[ray], bundle.w[ray]
    for channel in range(stokes):
        for i in range(wavelengths):
            bundle.scattered[ray, channel, i] = 0.0
    phase_at(first[0], nu, bundle.phase)
    for c in range(lit.shape[0]):
        for i in range(wavelengths):
            bundle.scattered[ray, 0, i] += lit[c, i] * bundle.phase[c, i]
    if stokes > 1:
        # The plane of scattering, from the meridian plane towards the left: see the conventions.
        r, mu = course.place[0, 0], course.place[0, 1]
        along = (q + (course.t[0] - line.start) * nu) / r - mu * nu
        left = -w / r
        norm = along * along + left * left
        cosine = (along * along - left * left) / norm if norm > 0.0 else 1.0
        sine = 2.0 * along * left / norm if norm > 0.0 else 0.0
        phase_at(first[1], nu, bundle.phase)
        for c in range(lit.shape[0]):
            for i in range(wavelengths):
                polarised = lit[c, i] * bundle.phase[c, i]
                bundle.scattered[ray, 1, i] += polarised * cosine
                bundle.scattered[ray, 2, i] += polarised * sine
    for i in range(wavelengths):
        bundle.reflected[ray, i] = 0.0
    if line.hits_ground:
        mu_s = (q + (line.leave - line.start) * nu) / columns.radius
        sunlit_ground(columns, diffuse, mu_s, work, bundle.reflected[ray])
        for i in range(wavelengths):
            bundle.reflected[ray, i] *= course.through[n - 1, i]


@merged
def spread_peaks(diffuse, n, course, bundle):
    """What first-order light in the forward peaks loses, because peaks that follow one another widen.

    Delta-M counts what the peaks scatter as unscattered, and gives all of that the whole phase function once more when
    it is scattered to the observer.  Near the Sun, where the chain of scatterings runs along one line of optical depth
    sum s_c, the moments of the light are exp(A_l) - 1 with A_l = sum s_c r_cl instead of A_l exp(F), F = sum s_c f_c:
    the moments of the peaks count only by (exp(A_l) - 1) / (A_l exp(F)).  To second order in s that is the correction
    of Nakajima & Tanaka (1988), J. Quant. Spectrosc. Radiat. Transfer 40, 51.

    Fills ``bundle.spread`` (component, degree, wavelength) with the lost part.
    """
    wavelengths = course.glow.size
    for d in range(diffuse.peaks.shape[1]):
        for i in range(wavelengths):
            peak, moment = 0.0, 0.0
            for c in range(diffuse.peaks.shape[0]):
                column = course.columns[n - 1, c]
                # Degree 0 belongs to the cut part: there r_l = f.
                peak += column * diffuse.peaks[c, 0, i]
                moment += column * diffuse.peaks[c, d, i] / (2 * d + 1)
            peak *= 4.0 * math.pi
            moment = max(4.0 * math.pi * moment, 1e-12)
            lost = 1.0 - (math.exp(moment - peak) - math.exp(-peak)) / moment
            for c in range(diffuse.peaks.shape[0]):
                bundle.spread[c, d, i] = np.float32(lost * diffuse.peaks[c, d, i])


@merged
def narrow_aureole(diffuse, ray, bundle):
    """Take from a ray's first order what `spread_peaks` found."""
    nu = bundle.nu[ray]
    if nu <= AUREOLE_END:
        return
    # Far from the Sun there is no one line along which the chain runs; the correction is small there, and fades.
    x = min((nu - AUREOLE_END) / (AUREOLE_FULL - AUREOLE_END), 1.0)
    fade = np.float32(x * x * (3.0 - 2.0 * x))
    components, degrees, wavelengths = bundle.spread.shape
    for c in range(components):
        if diffuse.scatters[c]:
            for i in range(wavelengths):
                bundle.here[i] = np.float32(0.0)
            below, legendre = 0.0, 1.0
            for d in range(degrees):
                f = np.float32(legendre)
                for i in range(wavelengths):
                    bundle.here[i] += f * bundle.spread[c, d, i]
                below, legendre = legendre, ((2 * d + 1) * nu * legendre - d * below) / (d + 1)
            for i in range(wavelengths):
                bundle.scattered[ray, 0, i] -= fade * bundle.here[i] * bundle.many_lit[ray, c, i]


@merged
def _fill_functions(recurrence, mu, polarised, functions):
    """Angular functions of all degrees and orders at a zenith cosine; see `skyscatter.solvers.moments.wigner`."""
    orders, degrees = functions.shape[1], functions.shape[2]
    half_plus, half_minus = math.sqrt(0.5 * max(1.0 + mu, 0.0)), math.sqrt(0.5 * max(1.0 - mu, 0.0))
    for m in range(orders):
        # d_m0 begins at l = m with a power of the sine; the table holds its factor.
        for d in range(degrees):
            functions[0, m, d] = 0.0
        if m < degrees:
            functions[0, m, m] = recurrence[0, m, m, 2] * (half_plus * half_minus) ** m
        for d in range(m, degrees - 1):
            before = functions[0, m, d - 1] if d > m else 0.0
            functions[0, m, d + 1] = recurrence[0, m, d, 0] * mu * functions[0, m, d] - recurrence[0, m, d, 1] * before
    if polarised:
        for m in range(orders):
            low = max(m, 2)
            for side in range(2):
                n = 2 if side == 0 else -2
                for d in range(degrees):
                    functions[1 + side, m, d] = 0.0
                if low < degrees:
                    start = recurrence[1, m, low, 2] * half_minus ** abs(m - n) * half_plus ** abs(m + n)
                    # The sign of the first function (Mishchenko et al. 2002, eq. B.16).
                    functions[1 + side, m, low] = -start if n < m and (m - n) % 2 == 1 else start
                for d in range(low, degrees - 1):
                    before = functions[1 + side, m, d - 1] if d > low else 0.0
                    shift = m * n / (d * (d + 1.0))
                    functions[1 + side, m, d + 1] = (
                        recurrence[1, m, d, 0] * (mu - shift) * functions[1 + side, m, d]
                        - recurrence[1, m, d, 1] * before
                    )
            for d in range(degrees):
                plus, minus = functions[1, m, d], functions[2, m, d]
                functions[1, m, d], functions[2, m, d] = 0.5 * (plus + minus), 0.5 * (plus - minus)


@kernel
def _place_rays(diffuse, line, t, r, suns, rays, bundle):
    """Sun nodes and azimuth from the Sun of every ray at distance t; returns the lowest and the highest node."""
    mu, sine, shift = t / r, line.p / r, t - line.start
    steps = diffuse.sun_index.size - 1
    low, high = suns - 4, 0
    for ray in range(rays):
        x = min(max((bundle.q[ray] + shift * bundle.nu[ray]) / r, -1.0), 1.0)
        y = (x + 1.0) * 0.5 * steps
        k = min(int(y), steps - 1)
        f = diffuse.sun_index[k] + (y - k) * (diffuse.sun_index[k + 1] - diffuse.sun_index[k])
        j = min(max(int(f) - 1, 0), suns - 4)
        bundle.sun[ray] = j
        low, high = min(low, j), max(high, j)
        _cubic(f - j, bundle.part[ray])
        norm = sine * math.sqrt((1.0 - x) * (1.0 + x))
        norm = 1.0 / norm if norm > 1e-12 else 0.0
        bundle.part[ray, 4] = np.float32(min(max((bundle.nu[ray] - mu * x) * norm, -1.0), 1.0))
        bundle.part[ray, 5] = np.float32(min(max(bundle.w[ray] / r * norm, -1.0), 1.0))
    return low, high + 3


@inlined
def _moments_at(field, weight, active):
    """Numbers of the moments that matter at a point, into `active`; returns how many, and how many Fourier parts."""
    n, orders = 0, 1
    for k in range(field.degree.size):
        share = 0.0
        for u in range(field.gives.shape[1]):
            b, d = field.gives[k, u, 0], field.degree[k]
            for i in range(weight.shape[2]):
                share = max(share, abs(weight[b, d, i]) - LEAST_SHARE * weight[0, 0, i])
        if share > 0.0 or k == 0:
            active[n] = k
            n += 1
            orders = max(orders, field.order[k] + 1)
    return n, orders


@kernel
def _source_at(field, course, s, low, high, ends_on_ground, bundle):
    """Fourier parts of the source at point s for Sun nodes `low` ... `high`, into ``bundle.fourier``; their number."""
    uses = field.gives.shape[1]
    stokes, wavelengths = bundle.fourier.shape[2], bundle.fourier.shape[3]
    _fill_functions(field.recurrence, course.place[s, 1], uses > 1, bundle.functions)
    moments, orders = _moments_at(field, course.weight[s], bundle.active)
    for a in range(moments):
        k = bundle.active[a]
        d, m = field.degree[k], field.order[k]
        for u in range(uses):
            g = field.gives[k, u]
            f = g[2] * bundle.functions[g[1], m, d] * (1.0 if m == 0 else 2.0)
            for i in range(wavelengths):
                bundle.factor[k, u, i] = np.float32(f * course.weight[s, g[0], d, i])
    v = np.float32(course.place[s, 3])
    rest = np.float32(1.0) - v
    row = course.row[s] + (1 if v == np.float32(1.0) else 0)
    between = np.float32(0.0) < v < np.float32(1.0)
    for j in range(low, high + 1):
        for m in range(orders):
            for channel in range(stokes):
                for i in range(wavelengths):
                    bundle.fourier[j, m, channel, i] = np.float32(0.0)
        for a in range(moments):
            k = bundle.active[a]
            m = field.order[k]
            for u in range(uses):
                channel = field.gives[k, u, 3]
                if channel < stokes:
                    if between:
                        for i in range(wavelengths):
                            value = rest * field.moments[row, j, k, i] + v * field.moments[row + 1, j, k, i]
                            bundle.fourier[j, m, channel, i] += bundle.factor[k, u, i] * value
                    else:
                        for i in range(wavelengths):
                            bundle.fourier[j, m, channel, i] += bundle.factor[k, u, i] * field.moments[row, j, k, i]
        if ends_on_ground:
            for i in range(wavelengths):
                bundle.fourier[j, 0, 0, i] += np.float32(course.through[s, i]) * field.ground[j, i]
    return orders


@kernel
def gather(diffuse, field, line, n, rays, course, bundle):
    """Light scattered out of a field into the rays of a bundle, into ``bundle.gathered``."""
    stokes, wavelengths = bundle.gathered.shape[1], bundle.gathered.shape[2]
    suns = field.moments.shape[1]
    for ray in range(rays):
        for channel in range(stokes):
            for i in range(wavelengths):
                bundle.gathered[ray, channel, i] = np.float32(0.0)
    for s in range(n):
        low, high = _place_rays(diffuse, line, course.t[s], course.place[s, 0], suns, rays, bundle)
        orders = _source_at(field, course, s, low, high, line.hits_ground and s == n - 1, bundle)
        for ray in range(rays):
            j = bundle.sun[ray]
            v_0, v_1 = bundle.part[ray, 0], bundle.part[ray, 1]
            v_2, v_3 = bundle.part[ray, 2], bundle.part[ray, 3]
            cosine, sine = bundle.part[ray, 4], bundle.part[ray, 5]
            # cos(m phi) and sin(m phi), one after the other.
            c, z = np.float32(1.0), np.float32(0.0)
            for m in range(orders):
                for channel in range(stokes):
                    f = c if channel < 2 else z
                    a_0, a_1, a_2, a_3 = f * v_0, f * v_1, f * v_2, f * v_3
                    # Two loops: the compiler makes SIMD code of two nodes, not of four.
                    for i in range(wavelengths):
                        bundle.gathered[ray, channel, i] += (
                            a_0 * bundle.fourier[j, m, channel, i] + a_1 * bundle.fourier[j + 1, m, channel, i]
                        )
                    for i in range(wavelengths):
                        bundle.gathered[ray, channel, i] += (
                            a_2 * bundle.fourier[j + 2, m, channel, i] + a_3 * bundle.fourier[j + 3, m, channel, i]
                        )
                c, z = c * cosine - z * sine, z * cosine + c * sine


@kernel
def _node_rays(r, mu, sun_mu, azimuth, bundle):
    """The rays of a node height in one zenith direction: every Sun node, every azimuth; returns their number."""
    sine = math.sqrt((1.0 - mu) * (1.0 + mu))
    n = 0
    for j in range(sun_mu.size):
        sun_sine = math.sqrt(max((1.0 - sun_mu[j]) * (1.0 + sun_mu[j]), 0.0))
        for a in range(azimuth.shape[0]):
            bundle.q[n] = r * sun_mu[j]
            bundle.nu[n] = min(max(sine * azimuth[a, 1, 0] * sun_sine + mu * sun_mu[j], -1.0), 1.0)
            bundle.w[n] = r * sun_sine * sine * azimuth[a, 1, 1]
            n += 1
    return n


@kernel
def _project(field, suns, mu, weight, take, azimuth, bundle, fourier, moments, flux):
    """Add the light of one zenith direction to the moments and fluxes of a node height.

    `fourier` (order, stokes, wavelength) is scratch; `azimuth` (angle, order, 2) holds cos(m phi), sin(m phi).
    """
    angles, orders, stokes = azimuth.shape[0], fourier.shape[0], fourier.shape[1]
    wavelengths = fourier.shape[2]
    step = 2.0 * math.pi / angles * weight
    for j in range(suns):
        for m in range(orders):
            for channel in range(stokes):
                for i in range(wavelengths):
                    fourier[m, channel, i] = 0.0
                for a in range(angles):
                    f = step * azimuth[a, m, 0 if channel < 2 else 1]
                    ray = j * angles + a
                    for i in range(wavelengths):
                        fourier[m, channel, i] += f * bundle.gathered[ray, channel, i]
        for k in range(field.order.size):
            for channel in range(stokes):
                f = take[k, channel]
                if f != 0.0:
                    for i in range(wavelengths):
                        moments[j, k, i] += f * fourier[field.order[k], channel, i]
        side = 1 if mu > 0.0 else 0
        for i in range(wavelengths):
            flux[side, j, i] += abs(mu) * fourier[0, 0, i]


@entry
def sweep_height(columns, diffuse, first, field, altitude, directions, take, sun_mu, fine_mu, azimuth, is_first,
                 scratch, moments, flux):  # fmt: skip
    """One order of scattering at one node height.

    Parameters
    ----------
    columns : ColumnTable
    diffuse : Diffuse
    first : (use, component, angle, wavelength)
        As for `scatter_once`, with the forward peaks cut off.
    field : Field
        The order before; not used if `is_first`.
    altitude : float
        Of the node [m].
    directions : (direction, 2)
        Zenith cosines and weights of the quadrature there.
    take : (direction, moment, stokes)
    sun_mu, fine_mu : (sun,), (fine sun,)
        Zenith cosines of the Sun at the nodes, and those at which a field to gather from is known.
    azimuth : (angle, order, 2)
        cos(m phi) and sin(m phi) of the angles of the quadrature over half a turn.
    is_first : bool
        Whether to compute the first order from sunlight, instead of gathering.
    scratch : tuple
        Made by `make_sweep_scratch`.
    moments : (sun, moment, wavelength), flux : (2, sun, wavelength), output
        Fluxes are upward and downward [W m-2 nm-1].
    """
    work, course, bundle, fourier = scratch
    for j in range(moments.shape[0]):
        for i in range(moments.shape[2]):
            for k in range(moments.shape[1]):
                moments[j, k, i] = 0.0
            flux[0, j, i], flux[1, j, i] = 0.0, 0.0
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
            lay_gauss(columns, diffuse, line, n, 1, course, work)
            light_node(columns, diffuse, fine_mu, line, n, rays, course, bundle, work)
            for ray in range(rays):
                scatter_once(columns, diffuse, first, line, n, ray, bundle.many_lit[ray], course, bundle, work)
                for channel in range(bundle.gathered.shape[1]):
                    for i in range(course.glow.size):
                        extra = bundle.reflected[ray, i] + course.glow[i] if channel == 0 else 0.0
                        bundle.gathered[ray, channel, i] = np.float32(bundle.scattered[ray, channel, i] + extra)
        else:
            gather(diffuse, field, line, n, rays, course, bundle)
        _project(field, sun_mu.size, mu, directions[k, 1], take[k], azimuth, bundle, fourier, moments, flux)


@entry
def refine(packed, row_node, row_weight, sun_node, sun_weight, low, high, scratch, moments):
    """Interpolate a field from its nodes to the rows and Sun nodes from which it is gathered.

    Cubic in both directions, of the logarithm of the mean radiance (moment 0), which falls by orders of magnitude in
    twilight, and of the ratios of the other moments to it.

    Parameters
    ----------
    packed : (node, sun, moment, wavelength)
        The logarithm, and the ratios.
    row_node, row_weight : (row, 4); sun_node, sun_weight : (fine sun, 4)
        Four nodes and their weights.
    low, high : int
        Range of fine Sun nodes to fill.
    scratch : (node, moment, wavelength)
    moments : (row, fine sun, moment, wavelength) float32, output
    """
    nodes, count, wavelengths = packed.shape[0], packed.shape[2], packed.shape[3]
    for j in range(low, high):
        for node in range(nodes):
            for k in range(count):
                for i in range(wavelengths):
                    scratch[node, k, i] = 0.0
            for a in range(4):
                f, b = sun_weight[j, a], sun_node[j, a]
                for k in range(count):
                    for i in range(wavelengths):
                        scratch[node, k, i] += f * packed[node, b, k, i]
            # Where light ends abruptly, at the edge of night, a cubic would swing beyond its nodes.
            b = sun_node[j]
            for i in range(wavelengths):
                p, q = packed[node, b[0], 0, i], packed[node, b[1], 0, i]
                r, s = packed[node, b[2], 0, i], packed[node, b[3], 0, i]
                scratch[node, 0, i] = min(max(scratch[node, 0, i], min(p, q, r, s)), max(p, q, r, s))
        for row in range(moments.shape[0]):
            n, f = row_node[row], row_weight[row]
            for k in range(count):
                for i in range(wavelengths):
                    moments[row, j, k, i] = np.float32(
                        f[0] * scratch[n[0], k, i] + f[1] * scratch[n[1], k, i]
                        + f[2] * scratch[n[2], k, i] + f[3] * scratch[n[3], k, i]
                    )  # fmt: skip
            for i in range(wavelengths):
                p, q, r, s = scratch[n[0], 0, i], scratch[n[1], 0, i], scratch[n[2], 0, i], scratch[n[3], 0, i]
                mean = fast_exp(min(max(moments[row, j, 0, i], min(p, q, r, s)), max(p, q, r, s)))
                moments[row, j, 0, i] = np.float32(mean)
                for k in range(1, count):
                    moments[row, j, k, i] *= np.float32(mean)


@entry
def look(columns, diffuse, optics, first, field, origins, directions, group, points, scratch,
         scattered, reflected, multiple, direct):  # fmt: skip
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
    points : int
        Gauss points in a cell for the first order, 1 or 2.
    scratch : tuple
        Made by `make_sweep_scratch`.
    scattered, multiple : (ray, stokes, wavelength), reflected, direct : (ray, wavelength), output
        Scattered once, scattered or reflected more often, reflected once by the ground, unscattered (the disk of the
        Sun, emission, light from outside) [W m-2 sr-1 nm-1].
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
            lay_gauss(columns, diffuse, line, n, points, course, work)
            for ray in range(rays):
                o, d = origins[begin + ray], directions[begin + ray]
                bundle.q[ray] = o[0] * s[0] + o[1] * s[1] + o[2] * s[2]
                bundle.nu[ray] = min(max(d[0] * s[0] + d[1] * s[1] + d[2] * s[2], -1.0), 1.0)
                bundle.w[ray] = (
                    o[0] * (s[1] * d[2] - s[2] * d[1])
                    + o[1] * (s[2] * d[0] - s[0] * d[2])
                    + o[2] * (s[0] * d[1] - s[1] * d[0])
                )
            light_bundle(columns, diffuse, line, n, points, rays, course, bundle, work)
            for ray in range(rays):
                scatter_once(columns, diffuse, first, line, n, ray, bundle.many_lit[ray], course, bundle, work)
            if diffuse.peaks.shape[1] > 0 and not line.hits_ground:
                spread_peaks(diffuse, n, course, bundle)
                for ray in range(rays):
                    narrow_aureole(diffuse, ray, bundle)
            gather(diffuse, field, line, n, rays, course, bundle)
        for ray in range(rays):
            to = begin + ray
            for i in range(wavelengths):
                for channel in range(stokes):
                    scattered[to, channel, i] = bundle.scattered[ray, channel, i] if n > 0 else 0.0
                    multiple[to, channel, i] = bundle.gathered[ray, channel, i] if n > 0 else 0.0
                reflected[to, i] = bundle.reflected[ray, i] if n > 0 else 0.0
                direct[to, i] = course.glow[i] if n > 0 else diffuse.light[0, i]
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
    """Scratch of `sweep_height` and `look` for bundles of so many rays; a thread needs its own."""
    blocks, components, degrees, wavelengths = diffuse.greek.shape
    orders = field.recurrence.shape[1]
    return (
        make_work(components, wavelengths),
        make_course(diffuse.shell.size, blocks, components, degrees, wavelengths),
        make_bundle(rays, field.moments.shape[1], field, stokes, components, diffuse.peaks.shape[1]),
        np.zeros((orders, stokes, wavelengths)),
    )
