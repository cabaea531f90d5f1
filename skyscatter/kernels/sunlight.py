"""Sunlight scattered or reflected once, along the rays of a bundle."""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.bundle import SUN_REFINEMENT, cubic, place_rays, sun_reach
from skyscatter.kernels.course import put_gauss
from skyscatter.kernels.fastexp import fast_exp, fast_expm1_over
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.lookup import columns_to_light
from skyscatter.kernels.optics import phase_at, transmittance
from skyscatter.kernels.rows import add_product, add_sum_of_four, clear
from skyscatter.kernels.stations import (
    OPEN,
    first_station,
    lay_stations,
    reach_of_open,
    station_number,
    station_place,
    station_weight,
)

#: Cosine of the Sun's zenith angle above which the disk acts as its middle.
HIGH_SUN = 0.12
#: Halvings with which the edge of the planet's shadow is found within a cell.
EDGE_STEPS = 12
#: Spacing in the Sun's cosine of the table of sunlight for a large bundle: in units of 1, near the horizon, and what
#: it grows by with the cosine's distance from there.
SMOOTH_STEP, SMOOTH_GROWTH = 0.002, 0.05
#: Cosines of the angle from the Sun down to which the widening of forward peaks counts in full, and where it ends.
AUREOLE_FULL, AUREOLE_END = math.cos(math.radians(30.0)), math.cos(math.radians(60.0))
#: Degree times angle [rad] at which the sum over the degrees of the peaks ends; it fades out from half of it on.
AUREOLE_WAVES = 60.0


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
def _sunlit_cell(columns, diffuse, line, s, q, nu, course, lit, work):
    """Add the sunlight that one ray receives in cell s, on its lit side of the edge of the shadow."""
    mu_0 = (q + (course.t[s] - line.start) * nu) / course.place[s, 0]
    mu_1 = (q + (course.t[s + 1] - line.start) * nu) / course.place[s + 1, 0]
    first, last = _disk_nodes(diffuse, min(mu_0, mu_1))
    height_0, height_1 = mu_0 + course.place[s, 2], mu_1 + course.place[s + 1, 2]
    edge = 2.0 * abs(diffuse.tilt[1, 1])
    if first == 1 and min(height_0, height_1) < edge and max(height_0, height_1) > -edge:
        first, last = 3, 7  # the disk sets within the cell or near it
    for node in range(first, last):
        cosine, sine = diffuse.tilt[node, 0], diffuse.tilt[node, 1]
        lit_0 = _tilted(mu_0, cosine, sine) + course.place[s, 2] >= 0.0
        lit_1 = _tilted(mu_1, cosine, sine) + course.place[s + 1, 2] >= 0.0
        if lit_0 and lit_1:
            for k in range(2 * s, 2 * s + 2):
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
        cubic(f - j, ray, bundle.part)
    _add_interpolated(diffuse, k, rays, course, bundle)


@kernel
def light_bundle(columns, diffuse, line, n, rays, course, bundle, work):
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
        edge = 2.0 * abs(diffuse.tilt[1, 1])
        if max(high_0 + course.place[s, 2], high_1 + course.place[s + 1, 2]) < -edge:
            continue  # night
        above = min(low_0 + course.place[s, 2], low_1 + course.place[s + 1, 2])
        width = max(high_0 - low_0, high_1 - low_1)
        count = max(int(width / (SMOOTH_STEP + SMOOTH_GROWTH * max(above, 0.0))) + 2, 4)
        if above > edge and 2 * count <= rays and count <= bundle.sunlight.shape[0]:
            for g in range(2):
                _smooth_point(columns, diffuse, line, 2 * s + g, rays, count, course, bundle, work)
        else:
            for ray in range(rays):
                _sunlit_cell(
                    columns, diffuse, line, s, bundle.q[ray], bundle.nu[ray], course, bundle.many_lit[ray], work
                )


@kernel
def _open_lit(diffuse, line, stations, b, suns, rays, bundle):
    """Make room for the sunlight at station b."""
    t, r = station_place(stations, line, b)
    low, high = sun_reach(diffuse, line, t, r, SUN_REFINEMENT, suns, rays, bundle)
    to = b % OPEN
    bundle.reach[to, 0], bundle.reach[to, 1] = low, high
    components, wavelengths = bundle.lit.shape[2:]
    block = components * wavelengths
    clear(bundle.lit, (to * bundle.lit.shape[1] + low) * block, (high - low + 1) * block)


@inlined
def _add_to_lit(diffuse, k, b, weight, course, bundle):
    """Add what Gauss point k makes of a share of ``bundle.sunlight`` to station b."""
    to = b % OPEN
    components, wavelengths = bundle.lit.shape[2:]
    for c in range(components):
        if diffuse.scatters[c]:
            for i in range(wavelengths):
                bundle.here[i] = np.float32(weight * course.source[k, c, i])
            for j in range(bundle.reach[to, 0], bundle.reach[to, 1] + 1):
                add_product(
                    bundle.lit, ((to * bundle.lit.shape[1] + j) * components + c) * wavelengths,
                    bundle.here, 0, bundle.sunlight, j * wavelengths, wavelengths,
                )  # fmt: skip


@kernel
def _give_lit(diffuse, line, stations, b, suns, rays, bundle):
    """Give the sunlight at station b to the rays."""
    t, r = station_place(stations, line, b)
    place_rays(diffuse, line, t, r, SUN_REFINEMENT, suns, rays, bundle)
    block = bundle.lit.shape[2] * bundle.lit.shape[3]
    first = (b % OPEN) * bundle.lit.shape[1]
    for ray in range(rays):
        add_sum_of_four(
            bundle.many_lit, ray * block,
            bundle.part[ray, 0], bundle.part[ray, 1], bundle.part[ray, 2], bundle.part[ray, 3],
            bundle.lit, (first + bundle.sun[ray]) * block, block, block,
        )  # fmt: skip


@kernel
def light_node(columns, diffuse, sun_mu, distance, line, n, rays, course, bundle, work):
    """`light_bundle` for the rays of a node, on the points of `lay_halves`, into ``bundle.many_lit``.

    At each Gauss point the irradiance is computed for the Suns `sun_mu` and put together at stations, so far apart
    [rad] (`stations.py`): its many rays meet the same few Suns.
    """
    suns = sun_mu.size
    clear(bundle.many_lit, 0, rays * bundle.lit.shape[2] * bundle.lit.shape[3])
    points = 2 * (n - 1)
    if points == 0:
        return
    stations = lay_stations(line, course.gauss[0, 0], course.gauss[points - 1, 0], distance)
    opened = 0
    for k in range(points):
        x = station_number(stations, line, course.gauss[k, 0])
        base = first_station(stations, x)
        while opened < min(base + OPEN, stations.many):
            if opened >= OPEN:
                _give_lit(diffuse, line, stations, opened - OPEN, suns, rays, bundle)
            _open_lit(diffuse, line, stations, opened, suns, rays, bundle)
            opened += 1
        low, high = reach_of_open(bundle.reach, base, stations)
        for j in range(low, high + 1):
            _sunlight(columns, diffuse, course.gauss[k, 1], sun_mu[j], work, bundle.sunlight[j])
        for b in range(base, min(base + OPEN, stations.many)):
            _add_to_lit(diffuse, k, b, station_weight(stations, x - base, b - base), course, bundle)
    for b in range(max(opened - OPEN, 0), opened):
        _give_lit(diffuse, line, stations, b, suns, rays, bundle)


@kernel
def sunlit_ground(columns, diffuse, mu, work, out):
    """Radiance that the ground reflects of direct sunlight at a zenith cosine of the Sun, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    first, last = _disk_nodes(diffuse, mu)
    if first == 1 and mu < 2.0 * abs(diffuse.tilt[1, 1]):
        first, last = 3, 7
    for node in range(first, last):
        mu_s = min(_tilted(mu, diffuse.tilt[node, 0], diffuse.tilt[node, 1]), 1.0)
        if mu_s > 0.0 and columns_to_light(columns, columns.radius, mu_s, work.spare, work.to_sun):
            transmittance(work.to_sun, diffuse.sigma_t, work.sun)
            for i in range(out.size):
                out[i] += work.sun[i] * diffuse.share[node, i] * mu_s * diffuse.light[2, i] / math.pi


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
def chain_columns(columns, diffuse, sun, origin, direction, line, n, course, work):
    """Columns [m] on the way of sunlight to where it is scattered into a ray and from there to the observer.

    Fills ``work.weighted`` (component, wavelength) with the mean over what the peaks scatter.  Of the rays that share a
    course it is the one nearest to the Sun; returns whether that is near enough for `narrow_aureole`.
    """
    r, q, along = 0.0, 0.0, 0.0
    for k in range(3):
        r += origin[k] * origin[k]
        q += origin[k] * sun[k]
        along += origin[k] * direction[k]
    r = math.sqrt(r)
    nu = (q * along + math.sqrt(max((r - q) * (r + q), 0.0) * max((r - along) * (r + along), 0.0))) / (r * r)
    if nu <= AUREOLE_END:
        return False
    chain, total = work.weighted, work.source
    for i in range(total.size):
        total[i] = 1e-300
        for c in range(chain.shape[0]):
            chain[c, i] = 0.0
    for k in range(2 * (n - 1)):
        t, r = course.gauss[k, 0], course.gauss[k, 1]
        mu = min(max((q + (t - line.start) * nu) / r, -1.0), 1.0)
        if columns_to_light(columns, r, mu, work.spare, work.to_sun):
            transmittance(work.to_sun, diffuse.sigma_t, work.sun)
            for i in range(total.size):
                weight = 0.0
                for c in range(chain.shape[0]):
                    weight += course.source[k, c, i] * diffuse.peaks[c, 0, i]
                weight *= work.sun[i]
                total[i] += weight
                for c in range(chain.shape[0]):
                    here = 0.5 * (course.columns[k // 2, c] + course.columns[k // 2 + 1, c])
                    chain[c, i] += weight * (here + work.to_sun[c])
    for c in range(chain.shape[0]):
        for i in range(total.size):
            chain[c, i] /= total[i]
    return True


@inlined
def _degrees_at(nu, degrees):
    """Degrees of the peaks that count at a cosine of the angle from the Sun; what more of them add is noise."""
    return min(degrees, int(AUREOLE_WAVES / max(math.acos(nu), 1e-6)) + 1)


@merged
def spread_peaks(diffuse, chain, nu, bundle):
    """What first-order light in the forward peaks loses, because peaks that follow one another widen.

    Delta-M counts what the peaks scatter as unscattered, and gives all of that the whole phase function once more when
    it is scattered to the observer.  Where the chain of scatterings runs along a way of optical depth sum s_c, from the
    Sun to one of them and on to the observer, the moments of the light are exp(A_l) - 1 with A_l = sum s_c r_cl instead
    of A_l exp(F), F = sum s_c f_c: the moments of the peaks count only by (exp(A_l) - 1) / (A_l exp(F)).  To second
    order in s that is the correction of Nakajima & Tanaka (1988), J. Quant. Spectrosc. Radiat. Transfer 40, 51, who
    take one line for the way.

    `chain` (component, wavelength) are the columns of that way [m].  Fills ``bundle.spread`` (component, degree,
    wavelength) with the lost part, up to the degree that counts at `nu`, the cosine of the least angle from the Sun.
    """
    components, degrees, wavelengths = bundle.spread.shape
    left = bundle.phase[0]
    for i in range(wavelengths):
        left[i] = 0.0
        for c in range(components):
            # Degree 0 belongs to the cut part: there r_l = f.
            left[i] += chain[c, i] * diffuse.peaks[c, 0, i]
        left[i] = fast_exp(-4.0 * math.pi * left[i])
    lost = bundle.here
    for d in range(_degrees_at(nu, degrees)):
        per_moment = 4.0 * math.pi / (2 * d + 1)
        for i in range(wavelengths):
            lost[i] = np.float32(0.0)
        for c in range(components):
            for i in range(wavelengths):
                lost[i] += np.float32(per_moment * chain[c, i] * diffuse.peaks[c, d, i])
        for i in range(wavelengths):
            lost[i] = np.float32(1.0 - left[i] * fast_expm1_over(max(lost[i], np.float32(0.0))))
        for c in range(components):
            for i in range(wavelengths):
                bundle.spread[c, d, i] = lost[i] * np.float32(diffuse.peaks[c, d, i])


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
    angle, degrees = math.acos(nu), _degrees_at(nu, degrees)
    for c in range(components):
        if diffuse.scatters[c]:
            for i in range(wavelengths):
                bundle.here[i] = np.float32(0.0)
            below, legendre = 0.0, 1.0
            for d in range(degrees):
                y = min(max(2.0 * d * angle / AUREOLE_WAVES - 1.0, 0.0), 1.0)
                f = np.float32(legendre * (1.0 - y * y * (3.0 - 2.0 * y)))
                for i in range(wavelengths):
                    bundle.here[i] += f * bundle.spread[c, d, i]
                below, legendre = legendre, ((2 * d + 1) * nu * legendre - d * below) / (d + 1)
            for i in range(wavelengths):
                bundle.scattered[ray, 0, i] -= fade * bundle.here[i] * bundle.many_lit[ray, c, i]
