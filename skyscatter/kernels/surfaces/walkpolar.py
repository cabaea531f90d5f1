"""Polarisation of camera walks among surfaces.

A walk takes the matrix M and the vector v along, see `kernels.polar`: light with the Stokes vector S on the current leg
reaches the camera as value M S.  Lamps and media shine unpolarised.  What a medium scatters, or a surface turns, into
the leg is told by the elements of its matrix relative to the first, which the scalar walk has: both what lamps send
there and the walk itself are turned by them.

Facets of the sea, of rough glass and of rough metal are small mirrors or prisms, whose plane is that of both directions
(Mishchenko & Travis 1997, J. Geophys. Res. 102, 16989, section 2); light that has met several of them, foam, what
comes up from the water, land and Lambertian surfaces are not polarised.

`None` stands in the place of `WalkPolar` where nobody asks for polarisation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import CONDUCTOR, DIELECTRIC, SEA
from skyscatter.kernels.jit import kernel
from skyscatter.kernels.path import copy_sums, statistics
from skyscatter.kernels.polar import A1, A2, A3, A4, B1, B2, follow, multiply, plane
from skyscatter.kernels.surfaces.bsdf import as_radiance, dot, is_delta
from skyscatter.kernels.surfaces.fresnel import fresnel_conductor, fresnel_dielectric
from skyscatter.kernels.surfaces.ggx import reflected_lobe, refracted_lobe
from skyscatter.kernels.surfaces.grounds import cosines, mirror_lobe
from skyscatter.kernels.surfaces.polarised import fresnel_terms, mix_matrix
from skyscatter.kernels.tabulated import angle_cell

#: Elements of light that is not polarised.
NONE = (0.0, 0.0, 0.0)
#: Cosine from the vertical beyond which a look has no meridian: 0.5 minutes of arc.
VERTICAL = 1.0 - 1e-8


@by_address
class WalkPolar(NamedTuple):
    """Polarisation of the walks of a tile."""

    tables: np.ndarray  #: (component, 6, angle, wavelength) scattering matrices [sr-1], angles as in the phase table
    matrix: np.ndarray  #: (4, 4, wavelength) M
    across: np.ndarray  #: (3,) v of the current leg
    element: np.ndarray  #: (6, wavelength) of what turns the light, relative to the first
    light: np.ndarray  #: (3, wavelength) Q, U, V at the camera of light that is about to be added
    parted_matrix: np.ndarray  #: (split + 1, 4, 4, wavelength) M of walks that have parts left
    parted_across: np.ndarray  #: (split + 1, 3) v of the same
    up: np.ndarray  #: (3,) direction from the planet's centre
    at: np.ndarray  #: (2,) int64, numbers of the ray and of the sums to which the walk belongs
    frame: np.ndarray  #: (ray, 3) v at the camera
    sums: np.ndarray  #: (3, batch, wavelength) Q, U, V
    mean: np.ndarray  #: (ray, 3, wavelength) Q, U, V, output
    error: np.ndarray  #: (ray, 3, wavelength) their standard errors, output


def make_walk_polar(tables: np.ndarray, frame: np.ndarray, splits: int, batches: int) -> WalkPolar:
    """Scratch and output for rays whose meridians are given by `frame` (ray, 3)."""
    rays, wavelengths = len(frame), tables.shape[3]
    return WalkPolar(
        tables, np.zeros((4, 4, wavelengths)), np.zeros(3), np.zeros((6, wavelengths)), np.zeros((3, wavelengths)),
        np.zeros((splits + 1, 4, 4, wavelengths)), np.zeros((splits + 1, 3)), np.zeros(3), np.zeros(2, np.int64),
        np.array(frame, order="C"), np.zeros((3, batches, wavelengths)), np.zeros((rays, 3, wavelengths)),
        np.zeros((rays, 3, wavelengths)),
    )  # fmt: skip


# --- the walk -----------------------------------------------------------------------------------------------------


@kernel
def begin(polar, ray, batch):
    """A new walk of a ray: M is the identity, v the camera's."""
    if polar is None:
        return
    polar.at[0], polar.at[1] = ray, batch
    polar.matrix[:] = 0.0
    for i in range(polar.matrix.shape[2]):
        for r in range(4):
            polar.matrix[r, r, i] = 1.0
    for n in range(3):
        polar.across[n] = polar.frame[ray, n]


@kernel
def _copy(matrix, across, to_matrix, to_across):
    for r in range(4):
        for c in range(4):
            for i in range(matrix.shape[2]):
                to_matrix[r, c, i] = matrix[r, c, i]
    for n in range(3):
        to_across[n] = across[n]


@kernel
def keep_part(polar, number):
    """Keep M and v of a walk that is split, or divided."""
    if polar is None:
        return
    _copy(polar.matrix, polar.across, polar.parted_matrix[number], polar.parted_across[number])


@kernel
def take_part(polar, number):
    """Take up M and v of a part."""
    if polar is None:
        return
    _copy(polar.parted_matrix[number], polar.parted_across[number], polar.matrix, polar.across)


@kernel
def turn_walk(polar, dx, dy, dz, e):
    """M and v after the walk was turned from the direction d into e by ``polar.element``."""
    if polar is None:
        return
    c2, s2, nx, ny, nz = plane(polar.across, dx, dy, dz, e[0], e[1], e[2])
    multiply(polar.matrix, polar.element, c2, s2)
    follow(polar.across, nx, ny, nz, -e[0], -e[1], -e[2])


# --- what turns light ---------------------------------------------------------------------------------------------


@kernel
def scattering_terms(polar, media, m, density, cosine):
    """Elements of the mixture of medium m, into ``polar.element``."""
    if polar is None:
        return
    f = polar.element
    mix_matrix(polar.tables, media.first[m], media.first[m + 1], density, media.sigma_s, cosine, f)
    for i in range(f.shape[1]):
        share = 1.0 / max(f[A1, i], 1e-300)
        for k in range(A2, B2 + 1):
            f[k, i] *= share


@kernel
def surface_terms(polar, materials, k, n, wo, wi, value, index_here, index_there):
    """Elements of a surface whose `evaluate_bsdf` or coefficient is `value`, into ``polar.element``."""
    if polar is None:
        return
    f, kind, alpha = polar.element, materials.kind[k], materials.roughness[k]
    side = 1.0 if dot(n, wo) >= 0.0 else -1.0
    cos_o, cos_i = cosines(side, n, wo, wi)
    smooth, reflected = is_delta(materials, k), cos_i > 0.0
    lobe, facet = 0.0, min(cos_o, 1.0)
    if kind == SEA:
        if reflected:
            lobe, _, facet = mirror_lobe(alpha, side, n, wo, wi, cos_o, cos_i)
    elif reflected and alpha > 0.0:
        lobe, facet = reflected_lobe(alpha, n, side, wo, wi)
    for i in range(value.size):
        here, there, absorption = index_here[i], index_there[i], 0.0
        if kind == CONDUCTOR or kind == SEA:
            there = materials.index[k, i]
            absorption = materials.absorption[k, i] if kind == CONDUCTOR else 0.0
        elif kind == DIELECTRIC and alpha > 0.0 and not reflected:
            lobe, facet = refracted_lobe(alpha, n, side, wo, wi, here, there)
        single = value[i]
        if not smooth:
            single = lobe * by_facet(kind, reflected, facet, here, there, absorption)
            single *= materials.bowl[k, 0, i] if kind == SEA else 1.0
        share = min(single / value[i], 1.0) if value[i] > 0.0 else 0.0
        b1, a3, b2 = fresnel_terms(kind, reflected, facet, there / here, absorption / here) if share > 0.0 else NONE
        f[B1, i], f[A2, i], f[A3, i], f[A4, i], f[B2, i] = share * b1, share, share * a3, share * a3, share * b2


@kernel
def by_facet(kind, reflected, cosine, here, there, absorption):
    """What a facet reflects of unpolarised radiance, or lets through."""
    if kind == CONDUCTOR:
        return fresnel_conductor(cosine, there / here, absorption / here)
    back, _ = fresnel_dielectric(cosine, here, there)
    return back if reflected else (1.0 - back) * as_radiance(here, there, False)


# --- light --------------------------------------------------------------------------------------------------------


@kernel
def see_plain(polar, light):
    """Unpolarised light (wavelength,) of the leg as it reaches the camera: I into `light`, the rest is noted."""
    if polar is None:
        return
    m = polar.matrix
    for i in range(light.size):
        for r in range(3):
            polar.light[r, i] = m[r + 1, 0, i] * light[i]
        light[i] *= m[0, 0, i]


@kernel
def see_turned(polar, d, e, light):
    """The same of unpolarised light that comes from e, and was turned into the leg along d by ``polar.element``."""
    if polar is None:
        return
    c2, s2, _, _, _ = plane(polar.across, d[0], d[1], d[2], e[0], e[1], e[2])
    m = polar.matrix
    for i in range(light.size):
        q, u = polar.element[B1, i] * c2, polar.element[B1, i] * s2
        for r in range(3):
            polar.light[r, i] = (m[r + 1, 0, i] + m[r + 1, 1, i] * q + m[r + 1, 2, i] * u) * light[i]
        light[i] *= m[0, 0, i] + m[0, 1, i] * q + m[0, 2, i] * u


@kernel
def see_sky(polar, sky, x, d, joined, value, light):
    """The same of the empty sky, which `empty_light` has left in `joined` and `light`; Q, U and V times `value`.

    Starlight scattered once is referred to its plane of scattering, the rest to the meridian at x.  It is known on one
    side of the star alone: on the other U and V change their signs.
    """
    if polar is None:
        return
    star, count = sky.star, sky.whole.shape[0]
    c2, s2, _, _, _ = plane(polar.across, d[0], d[1], d[2], star[0], star[1], star[2])
    up, r = polar.up, 0.0
    for n in range(3):
        up[n] = x[n] - sky.centre[n]
        r += up[n] * up[n]
    for n in range(3):
        up[n] /= math.sqrt(r)
    # Straight up or down the plane of the star is the meridian, in which such light was looked up.
    cm, sm = c2, s2
    if abs(dot(up, d)) < VERTICAL:
        cm, sm, _, _, _ = plane(polar.across, d[0], d[1], d[2], up[0], up[1], up[2])
    side = (up[1] * star[2] - up[2] * star[1]) * d[0] + (up[2] * star[0] - up[0] * star[2]) * d[1]
    side = math.copysign(1.0, side + (up[0] * star[1] - up[1] * star[0]) * d[2])
    cell, w = angle_cell(d[0] * star[0] + d[1] * star[1] + d[2] * star[2], sky.polarised.shape[1] - 1)
    m = polar.matrix
    for i in range(light.size):
        once = 0.0
        for n in range(count):
            low, high = sky.polarised[n, cell, i], sky.polarised[n, cell + 1, i]
            once += joined[n, i] * (low + w * (high - low))
        qm, um, v = joined[count + 1, i], side * joined[count + 2, i], side * joined[count + 3, i]
        q, u = once * c2 + qm * cm - um * sm, once * s2 + qm * sm + um * cm
        for r in range(3):
            row = m[r + 1, 0, i] * light[i] + m[r + 1, 1, i] * q + m[r + 1, 2, i] * u + m[r + 1, 3, i] * v
            polar.light[r, i] = row * value[i]
        light[i] = m[0, 0, i] * light[i] + m[0, 1, i] * q + m[0, 2, i] * u + m[0, 3, i] * v


@kernel
def add_polarised(polar, factor):
    """Add what `see_plain` or `see_turned` noted, times a factor, to the sums of the walk."""
    if polar is None:
        return
    b = polar.at[1]
    for r in range(3):
        for i in range(polar.light.shape[1]):
            polar.sums[r, b, i] += factor * polar.light[r, i]


@kernel
def take_up_sums(polar, kept):
    """Sums of walks that were made before, kept (4, batch, wavelength)."""
    if polar is None:
        return
    for r in range(3):
        copy_sums(kept[r + 1], polar.sums[r])


@kernel
def end_sums(polar, ray, batches, done, kept):
    """Means and errors of a ray, after so many walks of each batch; its sums into `kept` (4, batch, wavelength)."""
    if polar is None:
        return
    for r in range(3):
        copy_sums(polar.sums[r], kept[r + 1])
        statistics(polar.sums[r], batches, done, polar.mean[ray, r], polar.error[ray, r])
