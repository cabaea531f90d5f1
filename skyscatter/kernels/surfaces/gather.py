"""Light of photons gathered at visibility points.

With F the power that a photon carries, P its chance under each hero, both at the start of a flight, tau and sigma
transmittance and extinction of each wavelength, the fluence rate at a visibility point y follows from

- the *points* at which photons are scattered or absorbed within the sphere of radius R around y:
  phi_i = F_i tau_i / mean_h(P_h tau_h sigma_h) / (4/3 pi R^3);
- the *paths* whose foot, the place nearest to y, lies in the sphere: phi_i = F_i tau_i / mean_h(P_h tau_h) / (pi R^2),
  where tau reaches to the foot and the photon has not had its event before.

*Both* are weighted by the balance heuristic.  The density with which a photon is found by the one way is to that of the
other as  A = 4/3 R mean_h(P_h tau_h sigma_h)  to  B = mean_h(P_h tau_h),  with the extinction at y; the weights are
A / (A + B) and B / (A + B).  See docs/theory/photons.md.
"""

from __future__ import annotations

import math

from skyscatter.kernels.gridwalk import enter_cells, next_cell
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.surfaces.bsdf import bsdf_value
from skyscatter.kernels.surfaces.clearance import SAME_SIDE
from skyscatter.kernels.surfaces.media import transmit
from skyscatter.kernels.surfaces.mosaics import tile
from skyscatter.kernels.surfaces.neighbours import cell_at
from skyscatter.kernels.surfaces.polarised import add_rest, scatter_to_camera, send_plain
from skyscatter.kernels.surfaces.rims import in_sight
from skyscatter.kernels.tabulated import angle_cell

#: Ways to gather: one bit each.
POINTS, PATHS = 1, 2


@inlined
def wanted(points, p, kind, order, most):
    """Whether point p takes photons of this kind that something happened to `order` times."""
    return (points.accepts[p] & kind) != 0 and points.order[p] + order + 1 <= most


@inlined
def add_to_ray(points, p, factor, light, order, sums, by_order):
    """Add light (wavelength,) times a factor and the point's weight to its ray."""
    ray = points.ray[p]
    for i in range(light.size):
        sums[ray, i] += factor * points.weight[p, i] * light[i]
    n = points.order[p] + order
    if n < by_order.shape[0]:
        for i in range(light.size):
            by_order[n, ray, i] += factor * points.weight[p, i] * light[i]


@kernel
def mix_phase(first, last, density, sigma_s, phase, cos_theta, out):
    """Scattering coefficient times phase function of components `first` to `last`, into `out` [m-1 sr-1]."""
    k, w = angle_cell(cos_theta, phase.shape[1] - 1)
    for i in range(out.size):
        out[i] = 0.0
    for c in range(first, last):
        n = density[c]
        if n > 0.0:
            for i in range(out.size):
                low, high = phase[c, k, i], phase[c, k + 1, i]
                out[i] += n * sigma_s[c, i] * (low + w * (high - low))


@inlined
def look_up(media, phase, points, p, dx, dy, dz, out):
    """What point p scatters of light that flies along (dx, dy, dz) towards the camera, into `out` [m-1 sr-1].

    `phase` (component, angle, wavelength) is the whole phase function, or its broad part.
    """
    e, m = points.direction[p], points.medium[p]
    cos_theta = -(dx * e[0] + dy * e[1] + dz * e[2])
    mix_phase(media.first[m], media.first[m + 1], points.density[p], media.sigma_s, phase, cos_theta, out)


@inlined
def look_towards(media, phase, points, p, dx, dy, dz, out, polar):
    """`look_up`, or with polarisation the I that arrives at the camera, see `scatter_to_camera`."""
    if polar is None:
        look_up(media, phase, points, p, dx, dy, dz, out)
    else:
        scatter_to_camera(polar, media, points, p, dx, dy, dz, out)


@inlined
def add_scattered(media, phase, points, p, flux, factor, d, order, s, sums, by_order, polar):
    """Light of a fluence rate `flux` (wavelength,) that flies along d, scattered at p towards the camera."""
    look_towards(media, phase, points, p, d[0], d[1], d[2], s.light, polar)
    add_rest(polar, points, p, flux, factor)
    for i in range(s.light.size):
        s.light[i] *= flux[i]
    add_to_ray(points, p, factor, s.light, order, sums, by_order)


@inlined
def extinction_density(media, points, p, through, s):
    """mean_h(P_h tau_h sigma_h) with the extinction at point p."""
    m, total = points.medium[p], 0.0
    for c in range(media.first[m], media.first[m + 1]):
        n = points.density[p, c]
        if n > 0.0:
            for h in range(through.size):
                total += n * media.sigma_t[c, h] * s.chance[h] * through[h]
    return total / through.size


@inlined
def survival_density(through, s):
    """mean_h(P_h tau_h)."""
    total = 0.0
    for h in range(through.size):
        total += s.chance[h] * through[h]
    return total / through.size


@kernel
def gather_event(scene, phase, points, grid, how, m, kind, order, most, s, sums, by_order, polar):
    """An extinction event of a photon, where its walk is: light for all points within whose spheres it lies."""
    x, media = s.walk.position, scene.media
    cell = cell_at(grid, x[0], x[1], x[2])
    if cell < 0 or grid.start[cell] == grid.start[cell + 1]:
        return
    through = s.work.through
    survival = survival_density(through, s)
    for n in range(grid.start[cell], grid.start[cell + 1]):
        p = grid.entry[n]
        radius = points.reach[p]
        a, b, c = points.centre[p, 0] - x[0], points.centre[p, 1] - x[1], points.centre[p, 2] - x[2]
        if a * a + b * b + c * c < radius * radius and points.medium[p] == m and wanted(points, p, kind, order, most):
            factor = 0.75 / (math.pi * radius**3)
            if how & PATHS:
                density = 4.0 / 3.0 * radius * extinction_density(media, points, p, through, s)
                factor *= density / (density + survival)
            add_scattered(
                media, phase, points, p, s.walk.value, factor, s.walk.direction, order, s, sums, by_order, polar
            )
            s.found[0] += 1


@kernel
def gather_segment(scene, phase, points, grid, how, m, kind, order, most, length, s, sums, by_order, polar):
    """A photon's flight of a length from where its walk is: light for all points whose foot on it is near enough."""
    x, d, media, through = s.walk.position, s.walk.direction, scene.media, s.light_through
    t = enter_cells(grid, x[0], x[1], x[2], d[0], d[1], d[2], 0.0, s.walker)
    cell = -1
    if t < length:
        cell, leave = next_cell(s.walker)
    while cell >= 0 and t < length:
        end = min(leave, length)
        for n in range(grid.start[cell], grid.start[cell + 1]):
            p = grid.entry[n]
            radius = points.reach[p]
            a, b, c = points.centre[p, 0] - x[0], points.centre[p, 1] - x[1], points.centre[p, 2] - x[2]
            foot = a * d[0] + b * d[1] + c * d[2]
            if t <= foot < end:
                a, b, c = a - foot * d[0], b - foot * d[1], c - foot * d[2]
                near = a * a + b * b + c * c < radius * radius
                if near and points.medium[p] == m and wanted(points, p, kind, order, most):
                    transmit(media, m, x, d, foot, s.work, through)
                    density = survival_density(through, s)
                    if how & POINTS:
                        density += 4.0 / 3.0 * radius * extinction_density(media, points, p, through, s)
                    if density > 0.0:
                        for i in range(through.size):
                            through[i] *= s.value[i]
                        factor = 1.0 / (math.pi * radius * radius * density)
                        add_scattered(media, phase, points, p, through, factor, d, order, s, sums, by_order, polar)
                        s.found[1] += 1
        t = leave
        cell, leave = next_cell(s.walker)


@kernel
def gather_arrival(scene, points, grid, body, kind, order, most, s, sums, by_order, polar):
    """A photon that arrives on a surface, where its walk is: light for all points on it within the disk around them."""
    x, d, normal, light = s.walk.position, s.walk.direction, s.hit, s.light
    cell = cell_at(grid, x[0], x[1], x[2])
    if cell < 0:
        return
    for n in range(grid.start[cell], grid.start[cell + 1]):
        p = grid.entry[n]
        radius = points.reach[p]
        a, b, c = points.centre[p, 0] - x[0], points.centre[p, 1] - x[1], points.centre[p, 2] - x[2]
        if points.body[p] != body or not a * a + b * b + c * c < radius * radius:
            continue
        q = points.normal[p]
        same = q[0] * normal[1] + q[1] * normal[2] + q[2] * normal[3]
        cosine = abs(q[0] * d[0] + q[1] * d[1] + q[2] * d[2])
        if same < SAME_SIDE or cosine < 1e-6 or not wanted(points, p, kind, order, most):
            continue
        if points.crowded[p] and not in_sight(
            scene.shapes, points.item[p], points.place[p], x, q, points.direction[p], radius, s.ball
        ):
            continue
        for k in range(3):
            s.towards[k], s.arriving[k] = -points.direction[p, k], -d[k]
        here, beyond = scene.media.index[points.medium[p]], scene.media.index[points.beyond[p]]
        material = tile(scene.materials, scene.shapes.material[body], points.place[p])
        bsdf_value(scene.materials, material, q, s.towards, s.arriving, here, beyond, False, light)
        for i in range(light.size):
            light[i] *= s.walk.value[i] / cosine
        factor = 1.0 / (math.pi * radius * radius * points.area[p])
        send_plain(polar, points, p, factor, light)
        add_to_ray(points, p, factor, light, order, sums, by_order)
        s.found[2] += 1
