"""A line through the atmosphere, cut into cells, with all that does not depend on where the Sun stands.

Rays of one height and zenith cosine, whatever their azimuth and their Sun, share one course: its points, the
transmittances to them and the weights of the sources there are computed once for all of them.

Along a cell the source per optical depth is taken as a parabola in optical depth, so the attenuation within a cell is
exact and thick cells are as good as thin ones: with x the share of the cell's depth D that lies before a point,

    Int T J dt = T_start sum_c (column_c) beta_c Int S(x) e^(-D x) dx,
    S(x) = S_start (1 - x) + S_end x - S'' x (1 - x) / 2,

where S'' follows from the neighbouring point.

Sunlight that is scattered once changes faster and has Gauss points of its own in every cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.jit import inlined, kernel, merged
from skyscatter.kernels.lookup import columns_along, densities, start_columns
from skyscatter.kernels.optics import transmittance

#: Transmittance below which light that is still to come is left out.
DARK = 1e-8
#: A wavelength asks for shorter cells as long as this much of its light is left.
ALIVE = 1e-3
#: Cells that one gap between two shells is cut into, at most.
MOST_PARTS = 40
#: Share of the gap between two rows within which a point counts as lying on one.
ON_ROW = 1e-5
#: Places of the two Gauss points in a cell, on [0, 1].
GAUSS_X = np.array([0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12)])


@by_address
class Diffuse(NamedTuple):
    """The scene as diffuse light meets it: forward peaks cut off (delta-M), and the rows of the field."""

    sigma_t: np.ndarray  #: (component, wavelength) extinction per unit density without the peaks [m-1]
    scatters: np.ndarray  #: (component,) bool
    greek: np.ndarray  #: (block, component, degree, wavelength) scattering times (2 l + 1) / (4 pi) chi_l [m-1 sr-1]
    peaks: np.ndarray  #: (component, degree, wavelength) scattering times (2 l + 1) / (4 pi) r_l of the forward peaks
    emission: np.ndarray  #: (component, wavelength) [W m-3 sr-1 nm-1]
    light: np.ndarray  #: (3, wavelength): radiance from outside, the ground's own radiance, the ground's albedo
    tilt: np.ndarray  #: (7, 2): cosine and sine of zenith offsets: the Sun's middle; two that stand for its disk; four
    share: np.ndarray  #: (7, wavelength) irradiance that each carries in its rule [W m-2 nm-1]
    shell: np.ndarray  #: (row,) altitudes at which the field is known, rising, from the ground to the top [m]
    sun_index: np.ndarray  #: number of the field's Sun node over the Sun's zenith angle, even from 0 to pi
    sun_cubics: np.ndarray  #: (2, node, 8) four Sun nodes from each on, and what a cubic divides by; also finer
    max_angle: float  #: largest angle at the planet's centre that a cell spans [rad]
    max_depth: float  #: largest optical depth of a cell from which light arrives


@by_address
class Course(NamedTuple):
    """Scratch for one course; a thread needs its own."""

    raw: np.ndarray  #: (point,) distances before they are made denser [m]
    t: np.ndarray  #: (point,) distance from the line's lowest point [m]
    place: np.ndarray  #: (point, 4): radius [m], zenith cosine, sqrt(1 - (R / r)^2), position between two rows
    row: np.ndarray  #: (point,) int64 lower row
    columns: np.ndarray  #: (point, component) from the entry [m]
    through: np.ndarray  #: (point, wavelength) transmittance from the entry
    depth: np.ndarray  #: (point, wavelength) optical depth of the cell that begins there
    bend: np.ndarray  #: (point, wavelength) what the curvature of the source adds to that cell
    share: np.ndarray  #: (point, component, wavelength) what a unit of its scattering there sends to the entry [m]
    gauss: np.ndarray  #: (2 point, 2): distance and radius of the Gauss points [m]
    source: np.ndarray  #: (2 point, component, wavelength): step times transmittance times density [m]
    glow: np.ndarray  #: (wavelength,) light on the line that no scattering sends there [W m-2 sr-1 nm-1]


def make_course(shells: int, components: int, wavelengths: int) -> Course:
    """An empty course."""
    raw = 2 * shells + 4
    points = 2 * raw + 4 * MOST_PARTS
    return Course(
        np.zeros(raw), np.zeros(points), np.zeros((points, 4)), np.zeros(points, np.int64),
        np.zeros((points, components)), np.zeros((points, wavelengths)),
        np.zeros((points, wavelengths)), np.zeros((points, wavelengths)),
        np.zeros((points, components, wavelengths)),
        np.zeros((2 * points, 2)),
        np.zeros((2 * points, components, wavelengths)), np.zeros(wavelengths),
    )  # fmt: skip


@merged
def cross_shells(shell, radius, line, raw):
    """Where the line enters, crosses shells, turns upwards and leaves, into `raw`; returns how many points."""
    # The top lies high enough above rounding at planetary radii, and far below any cell.
    least = 1e-7 * shell[-1]
    raw[0] = line.enter
    n = 1
    if line.enter < 0.0:
        for k in range(shell.size - 1, -1, -1):
            r = radius + shell[k]
            if r <= line.p:
                break
            t = -math.sqrt((r - line.p) * (r + line.p))
            if raw[n - 1] + least < t < min(line.leave, 0.0) - least:
                raw[n] = t
                n += 1
        if line.leave > least and raw[n - 1] < -least:
            raw[n] = 0.0
            n += 1
    if line.leave > 0.0:
        for k in range(shell.size):
            r = radius + shell[k]
            if r > line.p:
                t = math.sqrt((r - line.p) * (r + line.p))
                if raw[n - 1] + least < t < line.leave - least:
                    raw[n] = t
                    n += 1
    if line.leave > raw[n - 1] + least:
        raw[n] = line.leave
        n += 1
    return n


@inlined
def _greatest_depth(diffuse, before, after, through):
    """Largest optical depth of a cell among the wavelengths that still have light."""
    depth = 0.0
    for i in range(through.size):
        tau = 0.0
        for c in range(before.size):
            tau += (after[c] - before[c]) * diffuse.sigma_t[c, i]
        if through[i] > ALIVE:
            depth = max(depth, tau)
    return depth


@kernel
def _put_point(columns, diffuse, line, t, n, course, work):
    """Write down point number n of a course."""
    r = columns_along(columns, line, t, work.from_start, work.across, work.along)
    h = r - columns.radius
    ratio = columns.radius / r
    k = 0
    high = diffuse.shell.size - 2
    while k < high:  # bisection for the row below
        middle = (k + high + 1) >> 1
        if diffuse.shell[middle] <= h:
            k = middle
        else:
            high = middle - 1
    course.t[n] = t
    course.row[n] = k
    course.place[n, 0], course.place[n, 1] = r, t / r
    course.place[n, 2] = math.sqrt(max((1.0 - ratio) * (1.0 + ratio), 0.0))
    v = (h - diffuse.shell[k]) / (diffuse.shell[k + 1] - diffuse.shell[k])
    # Most points lie on a row; to know it halves the work of reading the field there.
    course.place[n, 3] = 0.0 if v < ON_ROW else 1.0 if v > 1.0 - ON_ROW else v
    for c in range(work.along.size):
        course.columns[n, c] = work.along[c]
    transmittance(work.along, diffuse.sigma_t, course.through[n])


@kernel
def lay_points(columns, diffuse, line, course, work):
    """Lay the points of a course; returns how many.  It ends early where no wavelength has light left."""
    raw = course.raw
    gaps = cross_shells(diffuse.shell, columns.radius, line, raw) - 1
    start_columns(columns, line, work.from_start, work.across)
    n, parts = 0, 1
    for k in range(-1, gaps):
        a, b = raw[max(k, 0)], raw[k + 1]
        if k >= 0:  # before the first gap comes the entry itself
            r_b = columns_along(columns, line, b, work.from_start, work.across, work.along)
            depth = _greatest_depth(diffuse, course.columns[n - 1], work.along, course.through[n - 1])
            # The angle at the centre by the sine rule; it is small.
            angle = (b - a) * line.p / (r_b * course.place[n - 1, 0])
            wanted = math.ceil(max(angle / diffuse.max_angle, depth / diffuse.max_depth))
            parts = int(min(max(wanted, 1.0), MOST_PARTS, course.t.size - n - (gaps - k)))
        for j in range(1, parts + 1):
            t = b if j == parts else a + (b - a) * j / parts
            _put_point(columns, diffuse, line, t, n, course, work)
            n += 1
        brightest = 0.0
        for i in range(course.through.shape[1]):
            brightest = max(brightest, course.through[n - 1, i])
        if brightest < DARK:
            break
    return n


@inlined
def _cell_integrals(depth):
    """Integrals over x from 0 to 1 of e^(-D x) (1 - x), e^(-D x) x and e^(-D x) x (1 - x)."""
    d = max(depth, 1e-30)
    e = fast_exp(-d)
    mean = (1.0 - e) / d
    far = (1.0 - (1.0 + d) * e) / (d * d)
    square = (2.0 - (2.0 + d * (2.0 + d)) * e) / (d * d * d)
    if depth < 0.05:  # Taylor series: what is left out is below 1e-9
        mean = 1.0 - d * (1 / 2 - d * (1 / 6 - d * (1 / 24 - d / 120)))
        far = 1 / 2 - d * (1 / 3 - d * (1 / 8 - d * (1 / 30 - d / 144)))
        square = 1 / 3 - d * (1 / 4 - d * (1 / 10 - d * (1 / 36 - d / 168)))
    return mean - far, far, far - square


@kernel
def weigh_cells(diffuse, hits_ground, n, course, work):
    """Shares of the components at the points of a course, and the light that is on the line without scattering."""
    components, wavelengths = course.share.shape[1], course.glow.size
    for s in range(n):
        for c in range(components):
            for i in range(wavelengths):
                course.share[s, c, i] = 0.0
    for i in range(wavelengths):
        course.glow[i] = course.through[n - 1, i] * diffuse.light[1 if hits_ground else 0, i]
    for s in range(n - 1):
        for i in range(wavelengths):
            depth = 0.0
            for c in range(components):
                depth += (course.columns[s + 1, c] - course.columns[s, c]) * diffuse.sigma_t[c, i]
            near, far, bend = _cell_integrals(max(depth, 0.0))
            course.depth[s, i] = max(depth, 1e-30)
            course.bend[s, i] = course.through[s, i] * bend
            work.fine[i] = course.through[s, i] * near
            work.coarse[i] = course.through[s, i] * far
        for c in range(components):
            column = max(course.columns[s + 1, c] - course.columns[s, c], 0.0)
            for i in range(wavelengths):
                course.glow[i] += (work.fine[i] + work.coarse[i]) * column * diffuse.emission[c, i]
                course.share[s, c, i] += work.fine[i] * column
                course.share[s + 1, c, i] += work.coarse[i] * column
    if n < 3:
        return
    for k in range(1, n - n % 2, 2):
        # An odd cell at the end has the point before it in common with the last pair.
        _bend_cells(min(k, n - 2), k - min(k, n - 2), course, work)


@kernel
def _bend_cells(s, first, course, work):
    """Correct the shares for the curvature of the source over the two cells that meet at point s.

    Between its ends the source differs from the straight line by -S'' u (w - u) / 2, with u the optical depth into the
    cell and w its whole depth; S'' is that of the parabola through the three points.  `first` leaves out cell s - 1,
    which has been corrected already.
    """
    for i in range(course.glow.size):
        total = course.depth[s - 1, i] + course.depth[s, i]
        work.fine[i] = course.depth[s - 1, i] / total
        # Very unlike cells say nothing of the curvature.
        alike = 0.15 < work.fine[i] < 0.85
        work.coarse[i] = 1.0 if alike else 0.0
        work.fine[i] = work.fine[i] if alike else 0.5
    for cell in range(first, 2):
        k = s - 1 + cell
        for c in range(course.share.shape[1]):
            column = max(course.columns[k + 1, c] - course.columns[k, c], 0.0)
            for i in range(course.glow.size):
                u = work.fine[i]
                width = u if cell == 0 else 1.0 - u
                f = work.coarse[i] * width * width * course.bend[k, i] * column
                course.share[s - 1, c, i] -= f / u
                course.share[s, c, i] += f / (u * (1.0 - u))
                course.share[s + 1, c, i] -= f / (1.0 - u)


@kernel
def put_gauss(columns, diffuse, line, t, step, q, course, work):
    """Write down Gauss point number q of a course."""
    r = columns_along(columns, line, t, work.from_start, work.across, work.along)
    transmittance(work.along, diffuse.sigma_t, work.through)
    densities(columns, r - columns.radius, work.density)
    course.gauss[q, 0], course.gauss[q, 1] = t, r
    for c in range(work.density.size):
        for i in range(work.through.size):
            course.source[q, c, i] = step * work.density[c] * work.through[i]


@kernel
def lay_gauss(columns, diffuse, line, n, course, work):
    """Two Gauss points in each of the n - 1 cells."""
    for s in range(n - 1):
        width = course.t[s + 1] - course.t[s]
        for g in range(2):
            put_gauss(columns, diffuse, line, course.t[s] + width * GAUSS_X[g], 0.5 * width, 2 * s + g, course, work)


@kernel
def lay_halves(columns, diffuse, line, n, course, work):
    """Two points in each of the n - 1 cells, where the light of either half comes from on average.

    Each takes the attenuation within its half exactly: for sums over many rays, which cells may be long for.
    """
    wavelengths = course.glow.size
    for s in range(n - 1):
        middle = 0.5 * (course.t[s] + course.t[s + 1])
        columns_along(columns, line, middle, work.from_start, work.across, work.along)
        transmittance(work.along, diffuse.sigma_t, work.sun)
        for half in range(2):
            centre = 0.0
            for i in range(wavelengths):
                depth = 0.0
                for c in range(work.along.size):
                    depth += diffuse.sigma_t[c, i] * (
                        work.along[c] - course.columns[s, c] if half == 0 else course.columns[s + 1, c] - work.along[c]
                    )
                near, far, _ = _cell_integrals(max(depth, 0.0))
                work.through[i] = (course.through[s, i] if half == 0 else work.sun[i]) * (near + far)
                centre += far / (near + far)
            t = (course.t[s] if half == 0 else middle) + 0.5 * (course.t[s + 1] - course.t[s]) * centre / wavelengths
            k = 2 * s + half
            course.gauss[k, 0], course.gauss[k, 1] = t, math.sqrt(line.p * line.p + t * t)
            for c in range(work.along.size):
                column = work.along[c] - course.columns[s, c] if half == 0 else course.columns[s + 1, c] - work.along[c]
                for i in range(wavelengths):
                    course.source[k, c, i] = max(column, 0.0) * work.through[i]
