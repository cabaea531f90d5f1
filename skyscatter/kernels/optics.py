"""Optical tables of a scene over its wavelengths, and the phase function looked up in them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.eclipse import EclipseTable
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import entry, inlined, kernel
from skyscatter.kernels.lookup import ColumnTable
from skyscatter.kernels.tabulated import angle_cell, cell_of, draw_in_cell


@by_address
class OpticsTable(NamedTuple):
    """Everything spectral.  Components are in the order of the fields; the wavelength is always the last axis."""

    sigma_s: np.ndarray  #: (component, wavelength) scattering per unit density [m-1]
    sigma_t: np.ndarray  #: (component, wavelength) extinction per unit density [m-1]
    emission: np.ndarray  #: (component, wavelength) [W m-3 sr-1 nm-1]
    phase: np.ndarray  #: (component, angle, wavelength) [sr-1], at cos_theta = 1 - 2 (k / n)^2
    phase_cdf: np.ndarray  #: (component, wavelength, angle) probability of an angle nearer to forward
    mean_cosine: np.ndarray  #: (component,) of the phase function at the middle wavelength
    sun_direction: np.ndarray  #: (node, 3) directions to points on the solar disk
    sun_irradiance: np.ndarray  #: (node, wavelength) share of the irradiance at the top [W m-2 nm-1]
    sun_chance: np.ndarray  #: (node,) share of each of them in the draw of a point on the disk
    disk_axis: np.ndarray  #: (3,) direction to the middle of the disk
    disk_radius: float  #: angular radius [rad]
    disk_radiance: np.ndarray  #: (ring, wavelength) radiance over the squared fractional radius [W m-2 sr-1 nm-1]
    albedo: np.ndarray  #: (wavelength,) of the Lambertian ground; its mean where there is a map
    emits: bool  #: whether any component shines by itself
    glows: bool  #: whether there is light that is not the Sun's: emission or background
    background: np.ndarray  #: (wavelength,) uniform radiance from outside [W m-2 sr-1 nm-1]


@by_address
class GroundTable(NamedTuple):
    """The ground where it matters which one is met.

    It goes beside the `SceneTable`, not in it: its arrays, copied at every call to which a scene is passed, made walks
    slower by half.
    """

    albedo: np.ndarray  #: (row, wavelength) outside the map, then of the map's classes
    cells: np.ndarray  #: (y, x) uint8 row of every cell of the map, north first; none where there is no map
    side: float  #: of a cell [m]


@by_address
class SceneTable(NamedTuple):
    """A scene as the solvers' kernels see it."""

    columns: ColumnTable
    optics: OpticsTable
    breaks: np.ndarray  #: altitudes at which some density or its slope jumps [m]
    eclipse: EclipseTable  #: what the Moon covers of the Sun


@entry
def phase_at(phase, cos_theta, out):
    """Phase function [sr-1] of every component and wavelength at one scattering angle, into `out` (component, wl)."""
    k, w = angle_cell(cos_theta, phase.shape[1] - 1)
    for c in range(out.shape[0]):
        for i in range(out.shape[1]):
            low, high = phase[c, k, i], phase[c, k + 1, i]
            out[c, i] = low + w * (high - low)


@entry
def sample_cosine(optics, c, i, u):
    """Cosine of the scattering angle drawn from the phase function of component c at wavelength i."""
    cdf = optics.phase_cdf[c, i]
    low = cell_of(cdf, 0, cdf.size - 1, u)
    scale = 2.0 / ((cdf.size - 1) * (cdf.size - 1))
    mu = 1.0 - scale * low * low
    width = scale * (2 * low + 1)
    p0, p1 = optics.phase[c, low, i], optics.phase[c, low + 1, i]
    return max(mu - width * draw_in_cell(p0, p1, cdf, low, u), -1.0)


@inlined
def cell_below(rows, columns, side, x, y):
    """Number of the cell of a picture, row by row from north to south, at a place from its middle [m]; -1 outside."""
    row, column = math.floor(0.5 * rows - y / side), math.floor(0.5 * columns + x / side)
    if row < 0 or row >= rows or column < 0 or column >= columns:
        return -1
    return int(row) * columns + int(column)


@inlined
def ground_row(ground, x, y, z):
    """Row of ``ground.albedo`` at a point of the scene's frame [m]."""
    rows, columns = ground.cells.shape
    # The other side of the planet has the same x and y.
    if rows == 0 or z <= 0.0:
        return 0
    cell = cell_below(rows, columns, ground.side, x, y)
    return int(ground.cells[cell // columns, cell % columns]) if cell >= 0 else 0


@entry
def ground_rows(ground, points, out):
    """`ground_row` of many points (point, 3), into `out` (point,)."""
    for i in range(out.size):
        out[i] = ground_row(ground, points[i, 0], points[i, 1], points[i, 2])


@entry
def transmittance(columns, sigma_t, out):
    """exp(-sum of columns times extinction), into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    for c in range(columns.size):
        column = columns[c]
        for i in range(out.size):
            out[i] -= column * sigma_t[c, i]
    for i in range(out.size):
        out[i] = fast_exp(out[i])


@kernel
def weigh_phase(phase, sigma_s, out):
    """Phase functions times scattering per unit density, into `out` (component, wavelength)."""
    for c in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[c, i] = phase[c, i] * sigma_s[c, i]


@kernel
def mix_components(density, per_density, out):
    """Sum of a quantity per unit density over the components, into `out` (wavelength,)."""
    for i in range(out.size):
        out[i] = 0.0
    for c in range(density.size):
        n = density[c]
        for i in range(out.size):
            out[i] += n * per_density[c, i]


@kernel
def disk_radiance(optics, dx, dy, dz, out):
    """Radiance of the solar disk in a direction into `out` (wavelength,); False outside the disk."""
    ax, ay, az = optics.disk_axis[0], optics.disk_axis[1], optics.disk_axis[2]
    if optics.disk_radius <= 0.0 or dx * ax + dy * ay + dz * az <= 0.0:
        return False
    cx, cy, cz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
    square = (cx * cx + cy * cy + cz * cz) / math.sin(optics.disk_radius) ** 2
    if square > 1.0:
        return False
    rings = optics.disk_radiance.shape[0]
    k = min(int(square * (rings - 1)), rings - 2)
    w = square * (rings - 1) - k
    for i in range(out.size):
        out[i] = (1.0 - w) * optics.disk_radiance[k, i] + w * optics.disk_radiance[k + 1, i]
    return True
