"""Polarisation of photons and of the walks that look for them.

A photon at wavelength i carries value_i (1, q_i, u_i, v_i): its power and the Stokes vector relative to it, referred to
a unit vector v across its way; l = k x v, with k the direction of flight, makes (v, l, k) right-handed.  Where it is
scattered from k into k', n being the normal of both, the vectors p = n x k and p' = n x k' are those of the scattering
matrix, whose rows are (a1, b1, 0, 0), (b1, a2, 0, 0), (0, 0, a3, b2), (0, 0, -b2, a4).  The azimuth is drawn by the
hero's a1 + b1 q, so that photons stay as strong as they were; value and chances take the factor 1 + q b1 / a1.

A walk from the camera takes a matrix M along, as in `kernels.polar`: light that travels against it on the current leg
with the Stokes vector S arrives as value M S.  M changes at mirrors and smooth glass alone; the points of a leg share
one copy of it, number 0 standing for M = 1.

`None` stands in the place of `PhotonPolar` where nobody asks for polarisation.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.codes.surfaces import CONDUCTOR, DELTA, MIRROR, REFLECTED
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.path import rebalance
from skyscatter.kernels.polar import A1, A2, A3, A4, B1, B2, follow, multiply, plane
from skyscatter.kernels.random import uniform
from skyscatter.kernels.surfaces.bsdf import frame_of
from skyscatter.kernels.tabulated import angle_cell


@by_address
class PhotonPolar(NamedTuple):
    """Polarisation of the photons and walks of a pass."""

    tables: np.ndarray  #: (component, 6, angle, wavelength) scattering matrices [sr-1], angles as in the phase table
    photon: np.ndarray  #: (3, wavelength) q, u, v of the photon
    matrix: np.ndarray  #: (4, 4, wavelength) M of the walk from the camera
    across: np.ndarray  #: (3,) v of the photon or of the walk
    before: np.ndarray  #: (3,) direction of a photon before it is scattered
    element: np.ndarray  #: (6, wavelength) of the mixture's matrix at a point [m-1 sr-1]
    seen: np.ndarray  #: (4, wavelength) what a point sends to the camera of light of power 1
    frame: np.ndarray  #: (ray, 3) v at the camera
    chain: np.ndarray  #: (chain, 4, 4, wavelength) copies of M, number 0 the identity
    chains: np.ndarray  #: (2,) int64: copies in use, and which is the current leg's, -1 where none has been made
    link: np.ndarray  #: (2, point) int64, copy of M that belongs to a point in media and on surfaces
    at_point: np.ndarray  #: (point, 3) v of the walk at points in media
    sums: np.ndarray  #: (3, ray, wavelength) Q, U, V of the rays, output


def make_photon_polar(tables: np.ndarray, frame: np.ndarray, points: int, chains: int) -> PhotonPolar:
    """Scratch and output for rays whose meridians are given by `frame` (ray, 3)."""
    wavelengths = tables.shape[3]
    chain = np.zeros((chains, 4, 4, wavelengths))
    chain[0] = np.eye(4)[:, :, None]
    return PhotonPolar(
        tables, np.zeros((3, wavelengths)), np.zeros((4, 4, wavelengths)), np.zeros(3), np.zeros(3),
        np.zeros((6, wavelengths)), np.zeros((4, wavelengths)), np.array(frame, order="C"), chain,
        np.array([1, 0]), np.zeros((2, points), np.int64), np.zeros((points, 3)),
        np.zeros((3, len(frame), wavelengths)),
    )  # fmt: skip


# --- photons ------------------------------------------------------------------------------------------------------


@inlined
def begin_plain(polar, d):
    """A photon that flies along d and is not polarised."""
    if polar is not None:
        polar.photon[:] = 0.0
        polar.across[0], polar.across[1], polar.across[2], _, _, _ = frame_of(d[0], d[1], d[2])


@inlined
def remember_direction(polar, d):
    """Before a photon is scattered."""
    if polar is not None:
        polar.before[0], polar.before[1], polar.before[2] = d[0], d[1], d[2]


@inlined
def scatter_polarised(polar, media, m, hero, density, walk):
    """After a photon was scattered as if it were not polarised: its azimuth, q, u and v; False if it ends there."""
    if polar is None:
        return True
    else:
        return _scatter(polar, media.first[m], media.first[m + 1], media.sigma_s, hero, density, walk)


@kernel
def mix_matrix(tables, first, last, density, sigma_s, cosine, out):
    """Matrix elements of a mixture times its scattering coefficient, into `out` (6, wavelength) [m-1 sr-1]."""
    k, w = angle_cell(cosine, tables.shape[2] - 1)
    for e in range(6):
        for i in range(out.shape[1]):
            out[e, i] = 0.0
        for c in range(first, last):
            n = density[c]
            if n > 0.0:
                for i in range(out.shape[1]):
                    low, high = tables[c, e, k, i], tables[c, e, k + 1, i]
                    out[e, i] += n * sigma_s[c, i] * (low + w * (high - low))


@kernel
def _scatter(polar, first, last, sigma_s, hero, density, walk):
    k, d, f, s = polar.before, walk.direction, polar.element, polar.photon
    cosine = min(max(k[0] * d[0] + k[1] * d[1] + k[2] * d[2], -1.0), 1.0)
    mix_matrix(polar.tables, first, last, density, sigma_s, cosine, f)
    share = f[B1, hero] / max(f[A1, hero], 1e-300)
    while True:
        c2, s2, nx, ny, nz = plane(polar.across, -k[0], -k[1], -k[2], -d[0], -d[1], -d[2])
        # No factor is larger than 2: the azimuth is drawn again until its own is reached.
        if 2.0 * uniform(walk.state) < 1.0 + share * (s[0, hero] * c2 + s[1, hero] * s2):
            break
        d[0], d[1], d[2] = k[0], k[1], k[2]
        turn(d, cosine, 2.0 * math.pi * uniform(walk.state))
    for i in range(walk.value.size):
        a1 = max(f[A1, i], 1e-300)
        q, u, v = s[0, i] * c2 + s[1, i] * s2, s[1, i] * c2 - s[0, i] * s2, s[2, i]
        factor = 1.0 + q * f[B1, i] / a1
        walk.value[i] *= factor
        walk.chance[i] *= factor
        norm = 1.0 / max(a1 * factor, 1e-300)
        s[0, i] = (f[B1, i] + f[A2, i] * q) * norm
        s[1, i] = (f[A3, i] * u + f[B2, i] * v) * norm
        s[2, i] = (f[A4, i] * v - f[B2, i] * u) * norm
    follow(polar.across, nx, ny, nz, d[0], d[1], d[2])
    return rebalance(walk)


# --- surfaces -----------------------------------------------------------------------------------------------------


@inlined
def fresnel_terms(kind, reflected, cosine, index, absorption):
    """Elements b1 / a1, a3 / a1 and b2 / a1 of what a smooth surface does; a2 = a1 and a4 = a3.

    From the amplitude coefficients (Born & Wolf 1999, eqs. 1.5.20, 1.5.21 and section 14.2; fields exp(-i omega t))
    for the relative index m = index + i absorption, with root = sqrt(m^2 - sin^2), of positive imaginary part: the
    light beyond a surface that reflects all of it fades away.
    """
    if kind == MIRROR:
        # An ideal conductor: r_p = 1, r_s = -1.
        return 0.0, -1.0, 0.0
    square = complex(index, absorption) * complex(index, absorption)
    root = cmath.sqrt(square - (1.0 - cosine) * (1.0 + cosine))
    across = (cosine - root) / (cosine + root)
    along = (square * cosine - root) / (square * cosine + root)
    s = across.real * across.real + across.imag * across.imag
    p = along.real * along.real + along.imag * along.imag
    real = along.real * across.real + along.imag * across.imag
    imaginary = along.imag * across.real - along.real * across.imag
    if not reflected:
        # Both coefficients of transmission are real and positive.
        s, p, imaginary = max(1.0 - s, 0.0), max(1.0 - p, 0.0), 0.0
        real = math.sqrt(s * p)
    a1 = max(0.5 * (s + p), 1e-300)
    return 0.5 * (p - s) / a1, real / a1, imaginary / a1


@entry
def fresnel_rows(kind, reflected, cosines, index, absorption, out):
    """`fresnel_terms` for many angles, into `out` (angle, 3)."""
    for j in range(cosines.size):
        out[j, 0], out[j, 1], out[j, 2] = fresnel_terms(kind, reflected, cosines[j], index, absorption)


@inlined
def bounce_polarised(polar, materials, k, event, photon, normal, towards, walk, index_here, index_there):
    """Polarisation after a surface, `towards` being minus the direction before it; photons or walks of the camera."""
    if polar is not None:
        if event & DELTA:
            _bounce(polar, materials, k, event, photon, normal, towards, walk, index_here, index_there)
        else:
            # Only surfaces that depolarise are let in.
            begin_plain(polar, walk.direction)


@kernel
def _bounce(polar, materials, k, event, photon, normal, towards, walk, index_here, index_there):
    d, f = walk.direction, polar.element
    sign = -1.0 if photon else 1.0
    # Of a photon's directions the opposite ones: `plane` looks against the light.
    c2, s2, nx, ny, nz = plane(
        polar.across, sign * -towards[0], sign * -towards[1], sign * -towards[2], sign * d[0], sign * d[1], sign * d[2]
    )
    reflected = (event & REFLECTED) != 0
    cosine = min(abs(normal[0] * towards[0] + normal[1] * towards[1] + normal[2] * towards[2]), 1.0)
    for i in range(walk.value.size):
        here, index, absorption = index_here[i], index_there[i] / index_here[i], 0.0
        if materials.kind[k] == CONDUCTOR:
            index, absorption = materials.index[k, i] / here, materials.absorption[k, i] / here
        f[B1, i], f[A3, i], f[B2, i] = fresnel_terms(materials.kind[k], reflected, cosine, index, absorption)
        f[A2, i], f[A4, i] = 1.0, f[A3, i]
    if photon:
        _reflect_photon(polar, walk, c2, s2)
    else:
        polar.chains[1] = -1
        multiply(polar.matrix, f, c2, s2)
    follow(polar.across, nx, ny, nz, -sign * d[0], -sign * d[1], -sign * d[2])


@inlined
def _reflect_photon(polar, walk, c2, s2):
    f, s = polar.element, polar.photon
    for i in range(walk.value.size):
        q, u, v = s[0, i] * c2 + s[1, i] * s2, s[1, i] * c2 - s[0, i] * s2, s[2, i]
        factor = max(1.0 + q * f[B1, i], 0.0)
        walk.value[i] *= factor
        norm = 1.0 / max(factor, 1e-300)
        s[0, i], s[1, i] = (f[B1, i] + q) * norm, (f[A3, i] * u + f[B2, i] * v) * norm
        s[2, i] = (f[A3, i] * v - f[B2, i] * u) * norm


# --- walks from the camera ----------------------------------------------------------------------------------------


@inlined
def begin_look(polar, ray):
    """A new walk of a ray: M is the identity, v the camera's."""
    if polar is not None:
        for r in range(4):
            for c in range(4):
                for i in range(polar.matrix.shape[2]):
                    polar.matrix[r, c, i] = 1.0 if r == c else 0.0
        for n in range(3):
            polar.across[n] = polar.frame[ray, n]
        polar.chains[1] = 0


@inlined
def forget_walks(polar):
    """No points are left: all copies of M but the identity are free."""
    if polar is not None:
        polar.chains[0] = 1


@inlined
def full(polar, legs):
    """Whether a walk of so many legs might find no room for its matrices."""
    if polar is None:
        return False
    else:
        return polar.chains[0] + legs > polar.chain.shape[0]


@inlined
def note_matrix(polar, p, on_surface):
    """Keep M and v for point p."""
    if polar is not None:
        if polar.chains[1] < 0:
            polar.chains[1] = polar.chains[0]
            polar.chains[0] += 1
            copy = polar.chain[polar.chains[1]]
            for r in range(4):
                for c in range(4):
                    for i in range(copy.shape[2]):
                        copy[r, c, i] = polar.matrix[r, c, i]
        polar.link[on_surface, p] = polar.chains[1]
        if on_surface == 0:
            for n in range(3):
                polar.at_point[p, n] = polar.across[n]


@inlined
def add_seen(polar, ray, i, light, sums):
    """Unpolarised light (W m-2 sr-1 nm-1) that the walk of a ray meets, at wavelength number i."""
    if polar is None:
        sums[ray, i] += light
    else:
        sums[ray, i] += polar.matrix[0, 0, i] * light
        for r in range(3):
            polar.sums[r, ray, i] += polar.matrix[r + 1, 0, i] * light


# --- gathering ----------------------------------------------------------------------------------------------------


@inlined
def send_plain(polar, points, p, factor, light):
    """Unpolarised light (wavelength,) that leaves surface point p: adds Q, U, V to its ray, and makes I of `light`."""
    if polar is not None:
        link, ray = polar.link[1, p], points.ray[p]
        if link > 0:
            for i in range(light.size):
                for r in range(3):
                    polar.sums[r, ray, i] += factor * points.weight[p, i] * polar.chain[link, r + 1, 0, i] * light[i]
                light[i] *= polar.chain[link, 0, 0, i]


@kernel
def scatter_to_camera(polar, media, points, p, dx, dy, dz, out):
    """What point p scatters of the photon's light that flies along (dx, dy, dz), as it arrives at the camera.

    For light of power 1: I into `out` (wavelength,), all four parameters into ``polar.seen`` [m-1 sr-1].
    """
    e, m, f, s, seen = points.direction[p], points.medium[p], polar.element, polar.photon, polar.seen
    cosine = min(max(-(dx * e[0] + dy * e[1] + dz * e[2]), -1.0), 1.0)
    mix_matrix(polar.tables, media.first[m], media.first[m + 1], points.density[p], media.sigma_s, cosine, f)
    c2, s2, nx, ny, nz = plane(polar.across, -dx, -dy, -dz, e[0], e[1], e[2])
    b2, t2 = angle_to_plane(polar.at_point[p], e, nx, ny, nz)
    for i in range(out.size):
        q, u, v = s[0, i] * c2 + s[1, i] * s2, s[1, i] * c2 - s[0, i] * s2, s[2, i]
        x, y = f[B1, i] + f[A2, i] * q, f[A3, i] * u + f[B2, i] * v
        seen[0, i] = f[A1, i] + f[B1, i] * q
        seen[1, i], seen[2, i] = x * b2 - y * t2, x * t2 + y * b2
        seen[3, i] = f[A4, i] * v - f[B2, i] * u
    link = polar.link[0, p]
    if link > 0:
        chain = polar.chain[link]
        for i in range(out.size):
            a, b, c, d = seen[0, i], seen[1, i], seen[2, i], seen[3, i]
            for r in range(4):
                seen[r, i] = chain[r, 0, i] * a + chain[r, 1, i] * b + chain[r, 2, i] * c + chain[r, 3, i] * d
    for i in range(out.size):
        out[i] = seen[0, i]


@inlined
def angle_to_plane(v, d, nx, ny, nz):
    """Cosine and sine of twice the angle from v to p = d x n, seen along d against the light."""
    px, py, pz = d[1] * nz - d[2] * ny, d[2] * nx - d[0] * nz, d[0] * ny - d[1] * nx
    lx, ly, lz = v[1] * d[2] - v[2] * d[1], v[2] * d[0] - v[0] * d[2], v[0] * d[1] - v[1] * d[0]
    cosine, sine = px * v[0] + py * v[1] + pz * v[2], px * lx + py * ly + pz * lz
    return cosine * cosine - sine * sine, 2.0 * cosine * sine


@inlined
def add_rest(polar, points, p, flux, factor):
    """Add Q, U and V of light of a fluence rate that point p scatters, see `scatter_to_camera`, to its ray."""
    if polar is not None:
        ray = points.ray[p]
        for i in range(flux.size):
            light = factor * points.weight[p, i] * flux[i]
            for r in range(3):
                polar.sums[r, ray, i] += polar.seen[r + 1, i] * light
