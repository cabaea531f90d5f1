"""Collisions and transmittances by tracking: unbiased for any field that knows its bounds, without any column.

Tentative collisions come at the rate of a local majorant, constant within each cell of the grid of bounds:

- delta tracking (Woodcock et al. 1965) makes each of them real with probability sigma_t / majorant;
- ratio tracking (Novak, Selle & Jarosz 2014, ACM Trans. Graph. 33, 179) multiplies a transmittance by
  1 - sigma_t / majorant at each;
- residual ratio tracking (same place) integrates the lower bound in closed form and tracks only what exceeds it.

The majorant is one for all wavelengths, so the chances of tentative collisions are the same for every hero and cancel;
only the decision between real and null differs between heroes.

A tracked transmittance T at the rate mu has the relative variance exp(int sigma_t^2 / mu dt) - 1 <= exp(tau sigma_t /
mu) - 1: at the rate of the majorant it is 0 nearly always once the light is deep, and its error bar with it.  So the
rate is raised with the depth (`raised`) until the noise is that of one walk.

All of this needs bounds that hold.  Above a bound that is not 0 weights keep the result unbiased and make it noisy;
where the bound is 0 the light passes as if there were nothing.  So every density that is looked up is held against its
bound, and what is above it is counted in ``work.excess`` for the solver to report.
"""

from __future__ import annotations

import math

from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.gridwalk import enter_cells, next_cell, start_axis
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.random import uniform
from skyscatter.kernels.space import space_densities
from skyscatter.kernels.volume import depth_at, face_light, guide_columns, light_arriving

#: How transmittances towards lights are found.
QUADRATURE, RATIO, RESIDUAL = 0, 1, 2
#: Optical depth beyond which no noise of a transmittance matters any more.
DEEP = 16.0
#: Excess over a bound that is rounding, and share of a cell on both sides of a face that belongs to both its cells:
#: twice `media.spacetables` RIM.
TIGHT, RIM = 1.0 + 1e-6, 2e-9


@inlined
def majorant(v, cell):
    """Rate of tentative collisions in a cell [m-1]: no extinction at any wavelength exceeds it."""
    rate = 0.0
    for c in range(v.rate.size):
        rate += v.space.upper[cell, c] * v.rate[c]
    return rate


@kernel
def note_excess(v, cell, c, x, y, z, work):
    """Count that component c is denser at a point than its bound in a cell allows, unless the point is in a face."""
    for k in range(3):
        p = x if k == 0 else (y if k == 1 else z)
        u = (p - v.space.bound_low[k]) / v.space.bound_step[k]
        if abs(u - math.floor(u + 0.5)) < RIM:
            return
    bound = v.space.upper[cell, c]
    work.excess[c, 0] += 1.0
    work.excess[c, 1] = max(work.excess[c, 1], work.density[c] / bound if bound > 0.0 else math.inf)


@inlined
def watch_bounds(v, cell, x, y, z, work):
    """Hold ``work.density``, found at a point of a cell, against its bounds."""
    for c in range(work.density.size):
        if work.density[c] > TIGHT * v.space.upper[cell, c]:
            note_excess(v, cell, c, x, y, z, work)


@inlined
def watch_point(v, x, y, z, work):
    """`watch_bounds` where the cell is not known: also finds what is where tracking sees nothing."""
    cell = 0
    for k in range(3):
        p = x if k == 0 else (y if k == 1 else z)
        u = (p - v.space.bound_low[k]) / v.space.bound_step[k]
        place, _, _, _ = start_axis(u, 0.0, v.space.cells[k], v.space.bound_wrap[k] != 0)
        cell = cell * v.space.cells[k] + place
    watch_bounds(v, cell, x, y, z, work)


@kernel
def delta_flight(v, hero, shines, work, walker, walk):
    """Fly to the next real collision; its distance, or infinity when the walk leaves the medium.

    Value and chances take the null collisions on the way.  Where `shines`, what the medium emits is gathered at every
    tentative collision into ``walk.escape``, already multiplied by the walk's value.
    """
    x, d = walk.position, walk.direction
    t = enter_cells(v.space, x[0], x[1], x[2], d[0], d[1], d[2], 0.0, walker)
    if t == math.inf:
        return t
    while True:
        cell, leave = next_cell(walker)
        if cell < 0:
            return math.inf
        rate = majorant(v, cell)
        while rate > 0.0:
            t -= math.log(1.0 - uniform(walk.state)) / rate
            if t >= leave:
                break
            a, b, c = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
            space_densities(v.space, a, b, c, work.space, work.density)
            watch_bounds(v, cell, a, b, c, work)
            if shines:
                for i in range(walk.value.size):
                    light = 0.0
                    for n in range(work.density.size):
                        light += work.density[n] * v.emission[n, i]
                    walk.escape[i] += walk.value[i] * light / rate
            sigma = depth_at(v, work.density, hero)
            real = uniform(walk.state) * (sigma + abs(rate - sigma)) < sigma
            mean = 0.0
            for i in range(walk.value.size):
                sigma = depth_at(v, work.density, i)
                chance = sigma / (sigma + abs(rate - sigma))
                walk.value[i] *= 1.0 / rate if real else 1.0 - sigma / rate
                walk.chance[i] *= chance if real else 1.0 - chance
                mean += walk.chance[i]
            mean /= walk.value.size
            if not mean > 0.0:
                return math.inf
            for i in range(walk.value.size):
                walk.value[i] /= mean
                walk.chance[i] /= mean
            if real:
                return t
        t = leave


@inlined
def raised(v, k, x, y, z, d, work):
    """Factor on the majorant that leaves a tracked transmittance of light k about the noise of one walk.

    That is its depth, by the guide; of a spectrum the most that a wavelength needs at which light still arrives.
    """
    guide_columns(v, k, x, y, z, d, work.to_light)
    deepest, most = 1.0, 0.0
    for n in range(work.to_light.size):
        most += work.to_light[n] * v.rate[n]
    for i in range(work.arriving.size):
        depth = min(depth_at(v, work.to_light, i), DEEP)
        deepest = max(deepest, depth * depth / max(most, depth))
    return deepest


@kernel
def track_light(v, k, x, y, z, residual, work, walker, walk):
    """Irradiance of light k at a point by ratio or residual ratio tracking, into ``work.arriving``; its direction."""
    a, b, c, far, fall = face_light(v, k, x, y, z)
    more = raised(v, k, x, y, z, far, work)
    for i in range(work.arriving.size):
        work.arriving[i] = v.power[k, i] * fall
    t = enter_cells(v.space, x, y, z, a, b, c, 0.0, walker)
    while t < far:
        cell, leave = next_cell(walker)
        if cell < 0:
            break
        leave = min(leave, far)
        work.looks[1] += 1.0
        rate = majorant(v, cell)
        if residual:
            for n in range(v.rate.size):
                rate -= v.space.lower[cell, n] * v.rate[n]
            dim_by_bound(v, cell, leave - t, work)
        rate *= more
        while rate > 0.0:
            t -= math.log(1.0 - uniform(walk.state)) / rate
            if t >= leave:
                break
            space_densities(v.space, x + t * a, y + t * b, z + t * c, work.space, work.density)
            watch_bounds(v, cell, x + t * a, y + t * b, z + t * c, work)
            work.looks[0] += 1.0
            if residual:
                for n in range(v.rate.size):
                    work.density[n] -= v.space.lower[cell, n]
            for i in range(work.arriving.size):
                work.arriving[i] *= 1.0 - depth_at(v, work.density, i) / rate
        t = leave
    return a, b, c


@inlined
def dim_by_bound(v, cell, length, work):
    """Extinction of the lower bound over a length, in closed form."""
    for i in range(work.arriving.size):
        sigma = 0.0
        for n in range(v.rate.size):
            sigma += v.space.lower[cell, n] * v.sigma_t[n, i]
        work.arriving[i] *= fast_exp(-sigma * length)


@inlined
def light_reaching(v, k, x, y, z, work, walker, walk):
    """Irradiance of light k at a point into ``work.arriving``, from columns or tracked, as the table says.

    Returns the direction to it.  ``work.density`` is overwritten by tracking.
    """
    if v.tracking == QUADRATURE:
        return light_arriving(v, k, x, y, z, work)
    return track_light(v, k, x, y, z, v.tracking == RESIDUAL, work, walker, walk)


@entry
def fill_tracked(v, k, points, residual, seed_state, work, walker, walk, out):
    """Irradiance of light k at `points` (n, 3) by tracking, into `out` (n, wavelength)."""
    walk.state[0] = seed_state
    for n in range(points.shape[0]):
        track_light(v, k, points[n, 0], points[n, 1], points[n, 2], residual, work, walker, walk)
        for i in range(out.shape[1]):
            out[n, i] = work.arriving[i]
