"""Polarisation carried along by walks.

A walk's value for the whole Stokes vector is its scalar value times a 4 x 4 matrix M: light with the Stokes vector S on
the current leg reaches the camera as value * M S.  Everything that does not turn the light (transmittance, scattering
coefficients, chances, roulette) is in the scalar value; M starts as the identity, takes  R(chi) F / a1  at every
scattering, and at a depolarising ground all but its first column is lost.

S is referred to a unit vector v across the leg, M's rows to the camera's meridian.  With d the direction of the walk
(the light travels along -d) and l = v x d, the vectors (v, l, -d) are right-handed, and R(chi) turns a Stokes vector
referred to p = v cos(chi) + l sin(chi) into one referred to v:

    Q_v = Q_p cos(2 chi) - U_p sin(2 chi),    U_v = Q_p sin(2 chi) + U_p cos(2 chi)

(Hovenier & van der Mee 1983, Astron. Astrophys. 128, 1).  At a scattering from d to e the normal n of the plane d, e is
the l of both legs: p = d x n before, and v = e x n on the new leg.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.optics import mix_components, weigh_phase
from skyscatter.kernels.tabulated import angle_cell

#: Elements of the scattering matrix in its tables.
A1, A2, A3, A4, B1, B2 = range(6)
#: Squared sine of an angle so small that the plane of scattering is not defined.
_STRAIGHT = 1e-24


@by_address
class Polar(NamedTuple):
    """Polarisation of the walks of one tile; `None` stands in its place where nobody asks for it."""

    tables: np.ndarray  #: (component, 6, angle, wavelength) scattering matrices [sr-1], angles as in the phase table
    matrix: np.ndarray  #: (4, 4, wavelength) M
    across: np.ndarray  #: (3,) v of the current leg
    gain: np.ndarray  #: (wavelength,) Q, referred to the plane of the Sun, of sunlight scattered into the current leg
    turn: np.ndarray  #: (2,) cosine and sine of twice the angle from v to that plane
    element: np.ndarray  #: (6, wavelength) of the mixture at a point [m-1 sr-1]
    phase: np.ndarray  #: (component, wavelength) one element at an angle [sr-1]
    weighted: np.ndarray  #: (component, wavelength) the same times scattering per unit density [m-1 sr-1]
    batch: np.ndarray  #: (1,) int64, number of the sums to which the walk belongs
    sums: np.ndarray  #: (3, batch, wavelength) Q, U, V
    frame: np.ndarray  #: (ray, 3) v at the camera
    mean: np.ndarray  #: (ray, 3, wavelength) Q, U, V, output
    error: np.ndarray  #: (ray, 3, wavelength) their standard errors, output


def make_polar(tables: np.ndarray, frame: np.ndarray, sums: int) -> Polar:
    """Scratch and output for rays whose meridians are given by `frame` (ray, 3)."""
    components, wavelengths = tables.shape[0], tables.shape[3]
    return Polar(
        tables, np.zeros((4, 4, wavelengths)), np.zeros(3), np.zeros(wavelengths), np.zeros(2),
        np.zeros((6, wavelengths)), np.zeros((components, wavelengths)), np.zeros((components, wavelengths)),
        np.zeros(1, np.int64), np.zeros((3, sums, wavelengths)), np.array(frame, order="C"),
        np.zeros((len(frame), 3, wavelengths)), np.zeros((len(frame), 3, wavelengths)),
    )  # fmt: skip


@kernel
def mix_element(polar, e, cos_theta, sigma_s, density):
    """Element e of the mixture's matrix times its scattering coefficient, into ``polar.element[e]``."""
    weigh_element(polar, e, cos_theta, sigma_s)
    mix_components(density, polar.weighted, polar.element[e])


@kernel
def weigh_element(polar, e, cos_theta, sigma_s):
    """Element e times scattering per unit density of every component, into ``polar.weighted``; see `phase_at`."""
    tables, out = polar.tables, polar.phase
    k, w = angle_cell(cos_theta, tables.shape[2] - 1)
    for c in range(out.shape[0]):
        for i in range(out.shape[1]):
            low, high = tables[c, e, k, i], tables[c, e, k + 1, i]
            out[c, i] = low + w * (high - low)
    weigh_phase(polar.phase, sigma_s, polar.weighted)


@inlined
def plane(v, dx, dy, dz, ex, ey, ez):
    """Cosine and sine of twice the angle from v to the plane of d and e, and the normal of that plane."""
    nx, ny, nz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    square = nx * nx + ny * ny + nz * nz
    lx, ly, lz = v[1] * dz - v[2] * dy, v[2] * dx - v[0] * dz, v[0] * dy - v[1] * dx
    if square < _STRAIGHT:
        return 1.0, 0.0, lx, ly, lz
    norm = 1.0 / math.sqrt(square)
    nx, ny, nz = nx * norm, ny * norm, nz * norm
    px, py, pz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    cosine = px * v[0] + py * v[1] + pz * v[2]
    sine = px * lx + py * ly + pz * lz
    return cosine * cosine - sine * sine, 2.0 * cosine * sine, nx, ny, nz


@kernel
def multiply(m, f, c2, s2):
    """M R F into M: F by its elements relative to the first, c2 and s2 of twice the angle from v to its plane."""
    for r in range(4):
        for i in range(m.shape[2]):
            q, u = m[r, 1, i] * c2 + m[r, 2, i] * s2, m[r, 2, i] * c2 - m[r, 1, i] * s2
            lead, v = m[r, 0, i], m[r, 3, i]
            m[r, 0, i] = lead + q * f[B1, i]
            m[r, 1, i] = lead * f[B1, i] + q * f[A2, i]
            m[r, 2, i] = u * f[A3, i] - v * f[B2, i]
            m[r, 3, i] = u * f[B2, i] + v * f[A4, i]


@inlined
def follow(across, nx, ny, nz, kx, ky, kz):
    """The vector v = n x k after light was turned in a plane with the normal n, k being its way."""
    across[0], across[1], across[2] = ny * kz - nz * ky, nz * kx - nx * kz, nx * ky - ny * kx


@inlined
def begin(polar, ray, batch):
    """A new walk of a ray: M is the identity, v the camera's."""
    if polar is not None:
        polar.matrix[:] = 0.0
        for r in range(4):
            for i in range(polar.gain.size):
                polar.matrix[r, r, i] = 1.0
        for k in range(3):
            polar.across[k] = polar.frame[ray, k]
        polar.batch[0] = batch


@inlined
def polarise(polar, sigma_s, density, dx, dy, dz, e):
    """M and v after scattering from the direction d into e."""
    if polar is not None:
        _scatter(polar, sigma_s, density, dx, dy, dz, e)


@kernel
def _scatter(polar, sigma_s, density, dx, dy, dz, e):
    c2, s2, nx, ny, nz = plane(polar.across, dx, dy, dz, e[0], e[1], e[2])
    cosine = min(max(dx * e[0] + dy * e[1] + dz * e[2], -1.0), 1.0)
    f, m = polar.element, polar.matrix
    for k in range(6):
        mix_element(polar, k, cosine, sigma_s, density)
    for i in range(polar.gain.size):
        share = 1.0 / max(f[A1, i], 1e-300)
        for k in range(A2, B2 + 1):
            f[k, i] *= share
    multiply(m, f, c2, s2)
    follow(polar.across, nx, ny, nz, -e[0], -e[1], -e[2])


@inlined
def depolarise(polar, e):
    """M and v after a Lambertian reflection into e: what arrives polarised leaves as plain light."""
    if polar is not None:
        polar.matrix[:, 1:] = 0.0
        # Any vector across e will do: no polarisation is left that it could turn.
        sign = math.copysign(1.0, e[2])
        a = -1.0 / (sign + e[2])
        polar.across[0] = 1.0 + sign * e[0] * e[0] * a
        polar.across[1] = sign * e[0] * e[1] * a
        polar.across[2] = -sign * e[0]


@inlined
def face_sun(polar, sigma_s, direction, s, cos_theta):
    """Before a leg is marched: the plane of its direction and the Sun, and b1 at the angle between them."""
    if polar is not None:
        c2, s2, _, _, _ = plane(polar.across, direction[0], direction[1], direction[2], s[0], s[1], s[2])
        polar.turn[0], polar.turn[1] = c2, s2
        weigh_element(polar, B1, cos_theta, sigma_s)
        for i in range(polar.gain.size):
            polar.gain[i] = 0.0


@inlined
def gather(polar, density, width, through, sun):
    """At a point of a leg: add Q of the sunlight scattered there."""
    if polar is not None:
        mix_components(density, polar.weighted, polar.element[B1])
        for i in range(polar.gain.size):
            polar.gain[i] += width * through[i] * polar.element[B1, i] * sun[i]


@inlined
def light_up(polar, irradiance, node, chance):
    """After a leg is marched: the irradiance that was left out so far."""
    if polar is not None:
        for i in range(polar.gain.size):
            polar.gain[i] *= irradiance[node, i] / chance


@inlined
def arriving(polar, row, i, unpolarised, sunlit):
    """A row of M times the light of a leg at wavelength number i; `sunlit` 0 leaves out the light scattered into it."""
    if polar is None:
        return unpolarised
    else:
        m = polar.matrix
        q = m[row, 1, i] * polar.turn[0] + m[row, 2, i] * polar.turn[1]
        return m[row, 0, i] * unpolarised + sunlit * q * polar.gain[i]


@inlined
def note(polar, value, i, unpolarised, sunlit):
    """Add Q, U and V of light as in `arriving` to the sums of the walk's batch."""
    if polar is not None:
        b = polar.batch[0]
        for k in range(3):
            polar.sums[k, b, i] += value * arriving(polar, k + 1, i, unpolarised, sunlit)


@inlined
def tally_polarisation(polar, walk, sunlit):
    """Add Q, U and V of the current leg to the sums of the walk's batch."""
    if polar is not None:
        for i in range(polar.gain.size):
            note(polar, walk.value[i], i, walk.escape[i] + sunlit * walk.gain[i], sunlit)
