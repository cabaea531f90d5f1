"""Light scattered out of a field of moments into the rays of a bundle."""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.bundle import place_rays
from skyscatter.kernels.jit import inlined, kernel, merged

#: Degrees with less than this share of the isotropic part of a source are left out of it.
LEAST_SHARE = 1e-3


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
        low, high = place_rays(diffuse, line, course.t[s], course.place[s, 0], suns, rays, bundle)
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
