"""Light scattered out of a field of moments into the rays of a bundle.

It is put together at stations (`stations.py`), and from there given to the rays.  Between nodes of the Sun's zenith
angle the logarithm of its size is a cubic, for in twilight light falls by orders of magnitude, and so is everything
else in units of that.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.bundle import place_rays, sun_reach, turn_rays
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.rows import (
    add_product,
    add_products,
    add_products_to_four,
    add_scaled,
    add_turns_of_four,
    clear,
    set_exponentials,
    set_scaled,
    set_turns,
)
from skyscatter.kernels.stations import (
    OPEN,
    first_station,
    lay_stations,
    reach_of_open,
    station_number,
    station_place,
    station_weight,
)

#: Light that counts as none.
DARKEST = np.float32(1e-37)


@merged
def _fill_functions(recurrence, mu, polarised, functions):
    """Angular functions of all degrees and orders at a zenith cosine; see `skyscatter.solvers.moments.wigner`."""
    degrees, orders = functions.shape[1], functions.shape[2]
    half_plus, half_minus = math.sqrt(0.5 * max(1.0 + mu, 0.0)), math.sqrt(0.5 * max(1.0 - mu, 0.0))
    for d in range(degrees):
        for m in range(orders):
            functions[0, d, m] = 0.0
    # d_m0 begins at l = m with a power of the sine; the table holds its factor.
    power = 1.0
    for m in range(min(orders, degrees)):
        functions[0, m, m] = recurrence[0, 2, m, m] * power
        power *= half_plus * half_minus
    for d in range(degrees - 1):
        before = max(d - 1, 0)  # at degree 0 its coefficient is zero
        for m in range(min(d + 1, orders)):
            functions[0, d + 1, m] = (
                recurrence[0, 0, d, m] * mu * functions[0, d, m] - recurrence[0, 1, d, m] * functions[0, before, m]
            )
    if polarised:
        for m in range(orders):
            low = max(m, 2)
            for side in range(2):
                n = 2 if side == 0 else -2
                for d in range(degrees):
                    functions[1 + side, d, m] = 0.0
                if low < degrees:
                    start = recurrence[1, 2, low, m] * half_minus ** abs(m - n) * half_plus ** abs(m + n)
                    # The sign of the first function (Mishchenko et al. 2002, eq. B.16).
                    functions[1 + side, low, m] = -start if n < m and (m - n) % 2 == 1 else start
                for d in range(low, degrees - 1):
                    last = functions[1 + side, d - 1, m] if d > low else 0.0
                    shift = m * n / (d * (d + 1.0))
                    functions[1 + side, d + 1, m] = (
                        recurrence[1, 0, d, m] * (mu - shift) * functions[1 + side, d, m]
                        - recurrence[1, 1, d, m] * last
                    )
            for d in range(degrees):
                plus, minus = functions[1, d, m], functions[2, d, m]
                functions[1, d, m], functions[2, d, m] = 0.5 * (plus + minus), 0.5 * (plus - minus)


@kernel
def _weigh_degrees(diffuse, share, bundle):
    """Weights of the moments at a point, from the shares (component, wavelength) of what scatters there.

    Into ``bundle.weight``; what the mean radiance makes of the point at least into ``bundle.size``, and in units of
    that the greatest weight of every degree into ``bundle.relative``.  Weights of a parabola have either sign, and
    those of one degree may cancel; all do not.
    """
    weight = bundle.weight
    blocks, degrees, wavelengths = weight.shape
    for b in range(blocks):
        for d in range(degrees):
            for i in range(wavelengths):
                total = 0.0
                for c in range(share.shape[0]):
                    total += share[c, i] * diffuse.greek[b, c, d, i]
                weight[b, d, i] = np.float32(total)
    for i in range(wavelengths):
        bundle.size[i] = DARKEST
    for d in range(degrees):
        per_moment = np.float32(1.0 / (2 * d + 1))
        for i in range(wavelengths):
            bundle.size[i] = max(bundle.size[i], abs(weight[0, d, i]) * per_moment)
    for i in range(wavelengths):
        bundle.shared[i] = np.float32(1.0) / bundle.size[i]
    for b in range(blocks):
        for d in range(degrees):
            most = np.float32(0.0)
            for i in range(wavelengths):
                most = max(most, abs(weight[b, d, i]) * bundle.shared[i])
            bundle.relative[b, d] = most


@inlined
def _moments_at(field, row, other, functions, relative, active, begins):
    """Numbers of the moments that matter between two rows, into `active`; returns how many, and how many Fourier parts.

    Those of Fourier part m are from ``begins[m]`` to ``begins[m + 1]``.
    """
    n, a, orders = 0, 0, begins.size - 1
    for m in range(orders):
        begins[m] = n
        least = field.least if m == 0 else 0.5 * field.least
        while a < field.by_order.size and field.order[field.by_order[a]] == m:
            k = field.by_order[a]
            d, g = field.degree[k], field.gives[k]
            share = relative[g[0, 0], d] * abs(functions[g[0, 1], d, m])
            for u in range(1, g.shape[0]):
                share = max(share, relative[g[u, 0], d] * abs(functions[g[u, 1], d, m]))
            active[n] = k
            n += 1 if share * max(field.bound[row, k], field.bound[other, k]) > least or k == 0 else 0
            a += 1
    while orders > 1 and begins[orders - 1] == n:
        orders -= 1
    begins[orders] = n
    return n, orders


@kernel
def _fill_factors(field, moments, share, bundle):
    """What a share of the moments of a row gives to the Fourier parts of a point's source, into ``bundle.factor``."""
    uses, wavelengths = bundle.factor.shape[1], bundle.factor.shape[2]
    for a in range(moments):
        k = bundle.active[a]
        d, m = field.degree[k], field.order[k]
        for u in range(uses):
            g = field.gives[k, u]
            f = share * g[2] * bundle.functions[g[1], d, m] * (1.0 if m == 0 else 2.0)
            set_scaled(
                bundle.factor, (k * uses + u) * wavelengths, np.float32(f),
                bundle.weight, (g[0] * bundle.weight.shape[1] + d) * wavelengths, wavelengths,
            )  # fmt: skip


@inlined
def _add_intensities(field, row, low, high, orders, bundle):
    """Add the moments of a row, times their factors, to the source of a point without polarisation."""
    suns, wavelengths = field.moments.shape[1], field.moments.shape[3]
    step, block = field.moments.shape[2] * wavelengths, bundle.fourier.shape[1] * wavelengths
    alone = high + 1 - (high + 1 - low) % 4  # the first Sun that is left when four by four have been taken
    for j in range(low, alone, 4):
        for m in range(orders):
            first = bundle.begins[m]
            add_products_to_four(
                bundle.fourier, j * block + m * wavelengths, block, bundle.active, first, bundle.begins[m + 1] - first,
                bundle.factor, field.moments, (row * suns + j) * step, step, wavelengths,
            )  # fmt: skip
    for j in range(alone, high + 1):
        for m in range(orders):
            first = bundle.begins[m]
            add_products(
                bundle.fourier, j * block + m * wavelengths, bundle.active, first, bundle.begins[m + 1] - first,
                bundle.factor, field.moments, (row * suns + j) * step, wavelengths,
            )  # fmt: skip


@inlined
def _add_stokes(field, row, low, high, moments, bundle):
    """The same with polarisation: a moment gives to several Stokes parameters."""
    suns, wavelengths = field.moments.shape[1], field.moments.shape[3]
    uses, stokes = field.gives.shape[1], bundle.fourier.shape[2]
    step, block = field.moments.shape[2] * wavelengths, bundle.fourier.shape[1] * stokes * wavelengths
    for j in range(low, high + 1):
        for a in range(moments):
            k = bundle.active[a]
            for u in range(uses):
                channel = field.gives[k, u, 3]
                if channel < stokes:
                    add_product(
                        bundle.fourier, j * block + (field.order[k] * stokes + channel) * wavelengths,
                        bundle.factor, (k * uses + u) * wavelengths,
                        field.moments, (row * suns + j) * step + k * wavelengths, wavelengths,
                    )  # fmt: skip


@inlined
def _add_row(field, row, share, low, high, moments, orders, bundle):
    """Add a share of a row for Sun nodes `low` ... `high` to the source of a point, and to its size."""
    wavelengths = field.moments.shape[3]
    set_scaled(bundle.shared, 0, np.float32(share), bundle.size, 0, wavelengths)
    for j in range(low, high + 1):
        begin = (row * field.moments.shape[1] + j) * field.moments.shape[2] * wavelengths
        add_product(bundle.mean, j * wavelengths, bundle.shared, 0, field.moments, begin, wavelengths)
    if field.gives.shape[1] == 1:
        _add_intensities(field, row, low, high, orders, bundle)
    else:
        _add_stokes(field, row, low, high, moments, bundle)


@kernel
def _source_at(diffuse, field, course, s, low, high, ends_on_ground, bundle):
    """What point s scatters for Sun nodes `low` ... `high`; returns the number of its Fourier parts.

    Into ``bundle.fourier``, and its size without regard to signs into ``bundle.mean``.
    """
    stokes, wavelengths = bundle.fourier.shape[2], bundle.fourier.shape[3]
    block = bundle.fourier.shape[1] * stokes * wavelengths
    _fill_functions(field.recurrence, course.place[s, 1], field.gives.shape[1] > 1, bundle.functions)
    _weigh_degrees(diffuse, course.share[s], bundle)
    v = course.place[s, 3]
    row = course.row[s] + 1 if v == 1.0 else course.row[s]
    other = course.row[s] if v == 0.0 else course.row[s] + 1
    moments, orders = _moments_at(field, row, other, bundle.functions, bundle.relative, bundle.active, bundle.begins)
    for j in range(low, high + 1):
        clear(bundle.fourier, j * block, orders * stokes * wavelengths)
    clear(bundle.mean, low * wavelengths, (high - low + 1) * wavelengths)
    for side in range(2):
        share = v if side == 1 else 1.0 - v
        if share > 0.0:
            _fill_factors(field, moments, share, bundle)
            _add_row(field, course.row[s] + side, share, low, high, moments, orders, bundle)
    if ends_on_ground:
        for j in range(low, high + 1):
            for i in range(wavelengths):
                light = np.float32(course.through[s, i]) * field.ground[j, i]
                bundle.mean[j, i] += light
                bundle.fourier[j, 0, 0, i] += light
    return orders


@kernel
def _open_station(diffuse, line, stations, b, suns, rays, bundle):
    """Make room for what is put together at station b."""
    t, r = station_place(stations, line, b)
    low, high = sun_reach(diffuse, line, t, r, 1, suns, rays, bundle)
    to = b % OPEN
    bundle.reach[to, 0], bundle.reach[to, 1], bundle.reach[to, 2] = low, high, 1
    wavelengths = bundle.source.shape[4]
    block = bundle.source.shape[2] * bundle.source.shape[3] * wavelengths
    clear(bundle.level, (to * suns + low) * wavelengths, (high - low + 1) * wavelengths)
    clear(bundle.source, (to * suns + low) * block, (high - low + 1) * block)


@inlined
def _add_to_station(b, weight, orders, bundle):
    """Add a share of what a point scatters to station b."""
    to = b % OPEN
    f = np.float32(weight)
    size = abs(f)
    suns, wavelengths = bundle.source.shape[1], bundle.source.shape[4]
    part = bundle.source.shape[3] * wavelengths
    block = bundle.source.shape[2] * part
    bundle.reach[to, 2] = max(bundle.reach[to, 2], orders)
    low, high = bundle.reach[to, 0], bundle.reach[to, 1]
    add_scaled(
        bundle.level, (to * suns + low) * wavelengths, size, bundle.mean, low * wavelengths,
        (high - low + 1) * wavelengths,
    )  # fmt: skip
    for j in range(low, high + 1):
        add_scaled(bundle.source, (to * suns + j) * block, f, bundle.fourier, j * block, orders * part)


@kernel
def _take_logarithms(to, bundle):
    """Divide the source of a station by its size, and make a logarithm of that.

    The size is what the points have put there without regard to any signs, and so never zero.
    """
    low, high = bundle.reach[to, 0], bundle.reach[to, 1]
    for j in range(low, high + 1):
        for i in range(bundle.source.shape[4]):
            size = max(bundle.level[to, j, i], DARKEST)
            bundle.level[to, j, i] = np.float32(math.log(size))
            bundle.mean[j, i] = np.float32(1.0) / size
        for m in range(bundle.reach[to, 2]):
            for channel in range(bundle.source.shape[3]):
                for i in range(bundle.source.shape[4]):
                    bundle.source[to, j, m, channel, i] *= bundle.mean[j, i]


@inlined
def _level_at(to, ray, bundle):
    """Level of a station for a ray, interpolated as logarithm, into ``bundle.here``.

    Where light ends abruptly, at the edge of night, a cubic would swing beyond its nodes.
    """
    suns, wavelengths = bundle.level.shape[1], bundle.level.shape[2]
    set_exponentials(
        bundle.here, 0, bundle.part[ray, 0], bundle.part[ray, 1], bundle.part[ray, 2], bundle.part[ray, 3],
        bundle.level, (to * suns + bundle.sun[ray]) * wavelengths, wavelengths, wavelengths,
    )  # fmt: skip


@inlined
def _source_for(to, ray, turn, orders, bundle):
    """Source of a station in the direction of a ray, whose turns are number `turn`, into ``bundle.sum``."""
    suns, dimension, stokes, wavelengths = bundle.source.shape[1:]
    part, room = stokes * wavelengths, bundle.turns.shape[2]
    block = dimension * part
    clear(bundle.sum, 0, part)
    for channel in range(stokes):
        add_turns_of_four(
            bundle.sum, channel * wavelengths,
            bundle.part[ray, 0], bundle.part[ray, 1], bundle.part[ray, 2], bundle.part[ray, 3],
            bundle.source, (to * suns + bundle.sun[ray]) * block + channel * wavelengths, block, part,
            bundle.turns, (channel >> 1) * room + turn, 2 * room, orders, wavelengths,
        )  # fmt: skip


@kernel
def _give_to_rays(diffuse, line, stations, b, suns, rays, bundle):
    """Give what was put together at station b to the rays."""
    t, r = station_place(stations, line, b)
    place_rays(diffuse, line, t, r, 1, suns, rays, bundle)
    turn_rays(line, t, r, rays, bundle)
    to = b % OPEN
    _take_logarithms(to, bundle)
    orders, at_once = bundle.reach[to, 2], bundle.turns.shape[2]
    stokes, wavelengths = bundle.gathered.shape[1], bundle.gathered.shape[2]
    for ray in range(rays):
        turn = ray % at_once
        if turn == 0:
            set_turns(
                bundle.turns, bundle.azimuth, ray, bundle.azimuth.shape[1] + ray, min(at_once, rays - ray), at_once,
                orders,
            )  # fmt: skip
        _source_for(to, ray, turn, orders, bundle)
        _level_at(to, ray, bundle)
        for channel in range(stokes):
            begin = channel * wavelengths
            add_product(
                bundle.gathered, ray * stokes * wavelengths + begin, bundle.sum, begin, bundle.here, 0, wavelengths
            )


@kernel
def gather(diffuse, field, line, n, rays, course, bundle):
    """Light scattered out of a field into the rays of a bundle, into ``bundle.gathered``."""
    suns = field.moments.shape[1]
    clear(bundle.gathered, 0, rays * bundle.gathered.shape[1] * bundle.gathered.shape[2])
    stations = lay_stations(line, course.t[0], course.t[n - 1], field.station)
    opened = 0
    for s in range(n):
        x = station_number(stations, line, course.t[s])
        base = first_station(stations, x)
        while opened < min(base + OPEN, stations.many):
            if opened >= OPEN:
                _give_to_rays(diffuse, line, stations, opened - OPEN, suns, rays, bundle)
            _open_station(diffuse, line, stations, opened, suns, rays, bundle)
            opened += 1
        low, high = reach_of_open(bundle.reach, base, stations)
        orders = _source_at(diffuse, field, course, s, low, high, line.hits_ground and s == n - 1, bundle)
        for b in range(base, min(base + OPEN, stations.many)):
            _add_to_station(b, station_weight(stations, x - base, b - base), orders, bundle)
    for b in range(max(opened - OPEN, 0), opened):
        _give_to_rays(diffuse, line, stations, b, suns, rays, bundle)
