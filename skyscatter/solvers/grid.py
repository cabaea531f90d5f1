"""Where a field is computed: heights, positions of the Sun, directions; as fine as the asked accuracy wants."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import factorial, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.kernels.bundle import SUN_REFINEMENT

Array = NDArray[np.float64]

#: Relative accuracy for which the spacings below were chosen; the methods are of second order and better.
BASE_TOLERANCE = 0.002
#: Node spacing in units of the local scale height, at the ground; it grows by the second number per scale height.
HEIGHT_STEP, HEIGHT_GROWTH = 0.4, 0.15
#: Optical depth between two node heights at the top and at the ground; within it grows by the second number per optical
#: depth away from both, up to the third.  Deep inside a medium that absorbs little the light changes evenly, whatever
#: its slant: up to the first of the next, and to the second over the rate at which it fades with optical depth.
DEPTH_STEP, DEPTH_GROWTH, DEPTH_MOST = 0.03, 0.12, 0.25
EVEN_STEP, FADING_STEP = 0.5, 0.05
#: Optical depth from node to node beyond which a sweep does not see what lies between, at any tolerance.
MOST_GAP = 1.0
#: Cosine of the Sun's zenith angle below which steps shrink with it, and how far; the last for those in height at dusk.
STEEP_SUN, LEAST_SLANT, LEAST_RISE = 0.7, 0.6, 0.75
#: Spacing of the Sun's zenith angles in twilight, in units of the angle under which a scale height sinks below the
#: horizon; by day, and by night beyond the fourth number of such angles, it grows by the second number per degree away
#: from there, up to the third [degree].
TWILIGHT_STEP, DAY_GROWTH, DAY_STEP, NIGHT = 0.3, 0.25, 5.0, 12.0
#: What it grows by at most, at any tolerance: so the sizes of a cubic's weights, 1.6 in all between even nodes at most,
#: stay below 2.6.
MOST_GROWTH = 0.4
#: Twilight's spacing at most [degree]: on a small planet with deep air a scale height sinks within 12 degrees, and yet
#: light changes over fewer, for phase functions are as narrow as elsewhere.
MOST_TWILIGHT = 2.4
#: Directions above the horizontal and on the ground, at the base tolerance.
DIRECTIONS = 11, 6
#: Directions between the horizontal and the horizon, per angle under which a scale height sinks; the second from sunset
#: on, when a band along the horizon lights the high air; and up to how many of these that is counted: near the
#: ground next to nothing is seen there, and from above all air the same band.
BETWEEN, BETWEEN_AT_DUSK, LEAST_BETWEEN, COUNTED = 2.3, 3.5, 2, 2.8
#: Azimuths over half a turn at the base tolerance.
AZIMUTHS = 7
#: Steps between node heights, fewest and most; breaks that become nodes, at most; and how much longer than wanted the
#: steps between two breaks may be, in all.
LEAST_NODES, MOST_NODES, MOST_BREAKS, SPARE = 6, 160, 12, 0.2
#: Rows between two node heights, at least; and how far apart those are at most along which rays are seen under level
#: sunlight, in units of the local scale height: a limb above the planet's shadow is lit over a part of it.
ROW_REFINEMENT, SEEN_STEP = 2, 0.13
#: Sum of the absolute weights of a cubic beyond which it is none: 1.6 at most for even nodes, 4 beside a gap of 3 to 1.
WILDEST = 8.0
#: Steps in the table of Sun nodes over the Sun's zenith angle.
INDEX_STEPS = 8192
#: Range of the Sun's zenith angles [rad] below which there is one Sun for all.
ONE_SUN = 1e-4


@dataclass(frozen=True)
class Grid:
    """Nodes of a field.

    Attributes
    ----------
    altitudes : (node,) heights at which moments are computed, from the ground to the top [m].
    rows : (row,) heights to which they are interpolated, the nodes among them [m].
    seen : (row,) the same, as rays to an observer read them [m].
    sun_zenith : (sun,) zenith angles of the Sun at the nodes [rad], rising.
    fine_sun_zenith : (fine sun,) those at which sunlight is computed for the first order [rad].
    index : (step,) number of the Sun node, with fraction, over the Sun's zenith angle from 0 to pi.
    between : (node,) how many of the directions are between the horizontal and the horizon.
    directions : (node, direction, 2) zenith cosines and weights; weights sum to 2.
    azimuths : (angle,) midpoints of equal steps over half a turn [rad].
    angular : tolerance for which directions and azimuths were chosen.
    """

    altitudes: Array
    rows: Array
    seen: Array
    sun_zenith: Array
    fine_sun_zenith: Array
    index: Array
    between: NDArray[np.int64]
    directions: Array
    azimuths: Array
    angular: float


def fineness(tolerance: float) -> float:
    """Factor on every spacing: the square root of the tolerance, between 1/4 and 6.5."""
    return float(np.clip(sqrt(tolerance / BASE_TOLERANCE), 0.25, 6.5))


def scale_heights(altitude: Array, depth: Array, slope: Array) -> Array:
    """Local scale heights [m] at altitudes (sample,), from optical depths above and their slopes (sample, wavelength).

    The least among the wavelengths, between a fiftieth and a fifth of the atmosphere.
    """
    scale = np.where(slope > 0, depth / np.where(slope > 0, slope, 1.0), np.inf).min(axis=1)
    return np.asarray(np.clip(scale, altitude[-1] / 50, altitude[-1] / 5))


def height_nodes(
    altitude: Array,
    depth: Array,
    breaks: Array,
    lowest_sun: float,
    tolerance: float,
    night: bool = False,
    fading: ArrayLike = np.inf,
) -> Array:
    """Node heights [m].

    Parameters
    ----------
    altitude : (sample,)
        Dense altitudes from the ground to the top [m].
    depth : (sample, wavelength)
        Vertical optical depth above them.
    breaks : (break,)
        Altitudes at which a density or its slope jumps; they become nodes unless there are many.
    lowest_sun : float
        Cosine of the largest zenith angle of the Sun: a slanting beam fades over less height.
    tolerance : float
    night : bool, optional
        Whether what is seen may lie deep in the planet's shadow.
    fading : float or (wavelength,), optional
        Rate at which light fades with optical depth deep inside, where it diffuses.
    """
    f = fineness(tolerance)
    top = altitude[-1]
    slope = -np.gradient(depth, altitude, axis=0)
    scale = scale_heights(altitude, depth, slope)
    slant = float(np.clip(lowest_sun / STEEP_SUN, LEAST_SLANT, 1.0))
    step = f * max(slant, LEAST_SLANT if night else LEAST_RISE) * HEIGHT_STEP * (scale + HEIGHT_GROWTH * altitude)
    inside = np.minimum(depth, depth[0] - depth)
    even = np.clip(FADING_STEP / np.maximum(fading, 1e-9), slant * DEPTH_MOST, EVEN_STEP)
    by_depth = f * np.minimum(slant * (DEPTH_STEP + DEPTH_GROWTH * inside), even)
    by_depth = np.minimum(by_depth, MOST_GAP / (1 + SPARE))
    density = np.maximum(1 / step, np.max(slope / by_depth, axis=1))
    number = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(altitude))])
    number *= np.clip(number[-1], LEAST_NODES, MOST_NODES) / number[-1]
    inner = breaks[(breaks > 1e-6 * top) & (breaks < (1 - 1e-6) * top)]
    if inner.size > MOST_BREAKS:
        inner = inner[:0]
    # Between two breaks as many steps as are wanted there: none is much longer than it should be.
    ends = np.interp(np.unique(np.concatenate([[0.0], inner, [top]])), altitude, number)
    parts = [np.linspace(a, b, max(int(np.ceil(b - a - SPARE)), 1), endpoint=False) for a, b in pairwise(ends)]
    nodes = np.interp(np.append(np.concatenate(parts), number[-1]), number, altitude)
    for b in inner:  # to the last digit
        nodes[np.argmin(np.abs(nodes - b))] = b
    return nodes


def rows_between(nodes: Array, wanted: ArrayLike = 0.0) -> Array:
    """Rows: the nodes, and evenly spaced ones between them: in each gap (gap,) about as many steps as are `wanted`.

    Their number is even, for light is integrated along parabolas through pairs of steps, which no node should part.
    """
    pairs = np.rint(0.5 * np.asarray(wanted)).astype(int)
    parts = np.maximum(np.broadcast_to(2 * pairs, nodes.size - 1), ROW_REFINEMENT)
    lower = np.repeat(np.arange(nodes.size - 1), parts)
    share = (np.arange(lower.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[lower]
    return np.append(nodes[lower] + np.diff(nodes)[lower] * share, nodes[-1])


def seen_rows(nodes: Array, altitude: Array, depth: Array, level: float, tolerance: float) -> Array:
    """Rows along which rays are seen, where a share of the sunlight comes in level.

    `altitude` and `depth` are those of `height_nodes`.
    """
    scale = scale_heights(altitude, depth, -np.gradient(depth, altitude, axis=0))
    density = level / (SEEN_STEP * fineness(tolerance) * scale)
    number = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(altitude))])
    return rows_between(nodes, np.diff(np.interp(nodes, altitude, number)))


def sun_nodes(
    low: float, high: float, sinking: float, tolerance: float, twilight: float = 1.0, at_horizon: float = np.inf
) -> tuple[Array, Array, Array]:
    """Zenith angles of the Sun at the nodes, the fine ones, and the table from the Sun's cosine to their numbers.

    Parameters
    ----------
    low, high : float
        Range of zenith angles to cover [rad].
    sinking : float
        Angle at the planet's centre after which a horizontal line has risen by a scale height [rad].
    tolerance : float
    twilight : float
        Share of the tolerance that twilight is given.
    at_horizon : float
        The same angle for whatever changes over less height when the Sun sets there, such as the top of a cloud.
    """
    low, high = max(low, 0.0), min(high, np.pi)
    f = fineness(tolerance)
    angle = np.linspace(low, high, 4001)
    dusk = min(fineness(twilight * tolerance) * TWILIGHT_STEP * sinking, f * np.radians(MOST_TWILIGHT))
    growth = min(f * DAY_GROWTH, MOST_GROWTH)
    away = np.maximum(np.pi / 2 - 2 * sinking - angle, angle - np.pi / 2 - NIGHT * sinking)
    step = dusk + growth * np.maximum(away, 0.0)
    if at_horizon < sinking:  # the sky lights it as well, which changes less: the mean of both angles
        away = np.maximum(np.abs(angle - np.pi / 2) - 2 * at_horizon, 0.0)
        step = np.minimum(step, dusk * np.sqrt(at_horizon / sinking) + growth * away)
    step = np.minimum(step, f * np.radians(DAY_STEP))
    number = np.concatenate([[0.0], np.cumsum(0.5 * (1 / step[1:] + 1 / step[:-1]) * np.diff(angle))])
    if high - low < ONE_SUN:  # a flat world: one Sun for all
        middle = np.full(1, 0.5 * (low + high))
        return middle, np.repeat(middle, 4), np.zeros(INDEX_STEPS + 1)
    count = max(int(np.ceil(number[-1])), 4)
    coarse = np.interp(np.linspace(0, number[-1], count + 1), number, angle)
    fine = np.interp(np.linspace(0, number[-1], SUN_REFINEMENT * count + 1), number, angle)
    table = np.linspace(0, np.pi, INDEX_STEPS + 1)
    return coarse, fine, np.interp(table, fine, np.arange(fine.size) / SUN_REFINEMENT)


def sun_cubics(coarse: Array, fine: Array) -> Array:
    """What Lagrange's cubic through four Sun nodes needs, for `skyscatter.kernels.bundle.sun_cubic`.

    Parameters
    ----------
    coarse, fine : (sun,), (fine sun,)
        Zenith angles of the nodes [rad], rising, four at least; or one Sun for all.

    Returns
    -------
    ndarray, shape (2, fine sun - 3, 8)
        Of the coarse nodes and the fine ones, from each on four angles and one over the products of the differences of
        one and the others.  There are fewer coarse ones: the last row goes on.
    """
    if coarse.size == 1:  # light is the same at all four, wherever they are taken to be
        coarse = fine = coarse + np.arange(4)
    out = np.empty((2, fine.size - 3, 8))
    for rows, nodes in zip(out, (coarse, fine), strict=True):
        four = np.lib.stride_tricks.sliding_window_view(nodes, 4)
        apart = four[:, :, None] - four[:, None, :] + np.eye(4)
        known = np.concatenate([four, 1 / apart.prod(axis=2)], axis=1)
        rows[:] = known[np.minimum(np.arange(len(rows)), len(known) - 1)]
    return out


def cubic_weights(nodes: Array, points: ArrayLike) -> tuple[NDArray[np.int64], Array]:
    """Four nodes around each point and the weights of Lagrange's cubic through them; (point, 4) each.

    With fewer than four nodes the nearest is taken.  Beside a thin layer, whose nodes lie together, a cubic would go
    on over a wide gap as it bends within a narrow one: there the two nodes around the point are joined by a line.
    """
    points = np.asarray(points, float)
    if nodes.size < 4:
        nearest = np.argmin(np.abs(points[:, None] - nodes), axis=1)
        weights = np.zeros((points.size, 4))
        weights[:, 0] = 1.0
        return np.repeat(nearest[:, None], 4, axis=1).astype(np.int64), weights
    first = np.clip(np.searchsorted(nodes, points, side="right") - 2, 0, nodes.size - 4)
    number = first[:, None] + np.arange(4)
    x = nodes[number]
    weights = np.ones((points.size, 4))
    for a in range(4):
        for b in range(4):
            if a != b:
                weights[:, a] *= (points - x[:, b]) / (x[:, a] - x[:, b])
    wild = np.abs(weights).sum(axis=1) > WILDEST
    below = np.clip(np.searchsorted(nodes, points, side="right") - 1, 0, nodes.size - 2)
    v = np.clip((points - nodes[below]) / (nodes[below + 1] - nodes[below]), 0.0, 1.0)
    here = (below - first)[:, None]
    line = np.where(np.arange(4) == here, 1 - v[:, None], 0.0) + np.where(np.arange(4) == here + 1, v[:, None], 0.0)
    weights[wild] = line[wild]
    return number.astype(np.int64), weights


@cache
def _gauss(count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes between 0 and 1, and their weights; asked for at every height."""
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1), 0.5 * w


def between_counts(altitudes: Array, radius: float, sink: float, tolerance: float, dusk: bool) -> NDArray[np.int64]:
    """How many directions there are between the horizontal and the horizon at every height, on the ground none.

    Parameters
    ----------
    altitudes : (height,)
        [m]
    radius : float
        Of the planet [m].
    sink : float
        Angle under which a scale height sinks below the horizon [rad].
    tolerance : float
    dusk : bool
        Whether the Sun may be below the horizon.
    """
    dip = np.arccos(radius / (radius + altitudes))
    wanted = np.ceil((BETWEEN_AT_DUSK if dusk else BETWEEN) / fineness(tolerance) * np.minimum(dip / sink, COUNTED))
    return np.where(dip > 0, np.maximum(wanted, LEAST_BETWEEN), 0).astype(np.int64)


def directions(
    altitudes: Array,
    radius: float,
    degree: int,
    tolerance: float,
    between: NDArray[np.int64],
    counts: tuple[int, int] = DIRECTIONS,
) -> Array:
    """Quadrature over the zenith cosine at every height: above, `between` horizontal and horizon, on the ground.

    Gauss-Legendre on each; above, cosines go as the square of the variable, since the light of a thin atmosphere
    changes fastest near the horizontal.  Shape (height, direction, 2): cosines and weights, the latter 0 where there
    are fewer directions than elsewhere.
    """
    f = fineness(tolerance)
    above, below = (int(np.ceil(n / f)) for n in counts)
    # Above the horizontal, where the aureole is, the light is as uneven as the moments that it is taken into.
    above, below = max(above, degree // 2 + 4, degree), max(below, degree // 2 + 3)

    out = np.zeros((len(altitudes), above + int(between.max()) + below, 2))
    for h, count, rule in zip(altitudes, between, out, strict=True):
        ratio = radius / (radius + h)
        dip = sqrt(max((1 - ratio) * (1 + ratio), 0.0))
        x, w = _gauss(above)
        rule[:above] = np.stack([x * x, 2 * x * w], axis=-1)
        x, w = _gauss(below)
        rule[above : above + below] = np.stack([-(dip + (1 - dip) * x), (1 - dip) * w], axis=-1)
        if count:
            x, w = _gauss(count)
            rule[above + below : above + below + count] = np.stack([-dip * x, dip * w], axis=-1)
    return out


def azimuths(degree: int, tolerance: float, fewest: float = AZIMUTHS) -> Array:
    """Midpoints of equal steps over half a turn [rad], for moments up to a degree."""
    count = max(int(np.ceil(fewest / fineness(tolerance))), degree + 3)
    return np.asarray(np.pi * (np.arange(count) + 0.5) / count)


def recurrence(degree: int, orders: int) -> Array:
    """Coefficients of the upward recurrence of d_m0 and d_m,+-2, and the factor of its first function.

    Mishchenko et al. (2002), eq. B.22, divided by the factor of d^(s+1); shape (2, 3, degree, order).
    """
    out = np.zeros((2, 3, degree + 1, orders + 1))
    for side, n in enumerate((0, 2)):
        for m in range(orders + 1):
            low = max(m, n)
            if low <= degree:
                sign = (-1) ** m if n == 0 else 1
                out[side, 2, low, m] = sign * sqrt(factorial(2 * low) / (factorial(abs(m - n)) * factorial(m + n)))
            for s in range(low, degree):
                root, next_root = (sqrt((k * k - m * m) * (k * k - n * n)) for k in (s, s + 1))
                out[side, 0, s, m] = (2 * s + 1) * (s + 1) / next_root
                out[side, 1, s, m] = (s + 1) * root / (s * next_root) if s > 0 else 0.0
    return out
