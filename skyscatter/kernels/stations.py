"""Stations along a course, at which light is put together before rays take it.

Along a course the local vertical turns, and with it the Sun's zenith angle and azimuth, by the angle psi at the
planet's centre between a point and the first one: on nothing else do they depend.  So what the points of a course give
is not handed to the rays point by point, but put together at a few stations, even in psi, as a cubic through four of
them takes it, or a parabola through three on short courses.  Where a course climbs steeply they are far fewer than its
points; straight up one serves all.

Points come one after the other, and four stations are open at a time: station b is kept at place b % 4, and given to
the rays when station b + 4 is opened there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from skyscatter.kernels.jit import inlined

#: Division takes longer than multiplication.
SIXTH = 1.0 / 6.0
#: Stations that are open at a time.
OPEN = 4
#: Angle at the planet's centre [rad] below which a course has one station.
NARROW = 1e-7
#: Lengths of a course, in distances of stations, up to which two and three are enough: a parabola through three that
#: stand half as far apart misses what a cubic does.
SHORT, MIDDLE = 0.25, 1.0


class Stations(NamedTuple):
    """The stations of a course."""

    start: float  #: distance of the first from the line's lowest point [m]
    first: float  #: angle between them at the planet's centre [rad]
    step: float  #: angle between two stations [rad]
    many: int


@inlined
def lay_stations(line, start, end, distance):
    """Stations for points of a line between two distances [m], no further apart than an angle [rad]."""
    first = math.atan2(start, line.p)
    width = math.atan2(end, line.p) - first
    count = 1
    if width >= NARROW:
        count = max(int(math.ceil(width / distance)) + 1, OPEN)
        if width < MIDDLE * distance:
            count = 2 if width < SHORT * distance else 3
    return Stations(start, first, width / (count - 1) if count > 1 else 1.0, count)


@inlined
def station_place(stations, line, b):
    """Distance and radius of station b [m]."""
    if b == 0:
        return stations.start, math.sqrt(line.p * line.p + stations.start * stations.start)
    angle = stations.first + b * stations.step
    return line.p * math.tan(angle), line.p / math.cos(angle)


@inlined
def station_number(stations, line, t):
    """Number of the station at distance t, with fraction."""
    return (math.atan2(t, line.p) - stations.first) / stations.step


@inlined
def first_station(stations, x):
    """The first of the stations, four if there are so many, that share what stands at number x."""
    return min(max(int(x) - 1, 0), max(stations.many - OPEN, 0))


@inlined
def cubic_weight(x, k):
    """Weight of node k in Lagrange's cubic through nodes 0, 1, 2, 3 at x."""
    if k == 0:
        return SIXTH * (1.0 - x) * (2.0 - x) * (3.0 - x)
    if k == 1:
        return 0.5 * x * (2.0 - x) * (3.0 - x)
    return 0.5 * x * (x - 1.0) * (3.0 - x) if k == 2 else SIXTH * x * (x - 1.0) * (x - 2.0)


@inlined
def station_weight(stations, x, k):
    """Share of the station k after the first in what stands at x stations from there."""
    if stations.many == 1:
        return 1.0
    if stations.many == 2:
        return 1.0 - x if k == 0 else x
    if stations.many == 3:
        if k == 1:
            return x * (2.0 - x)
        return 0.5 * (1.0 - x) * (2.0 - x) if k == 0 else 0.5 * x * (x - 1.0)
    return cubic_weight(x, k)


@inlined
def reach_of_open(reach, base, stations):
    """First and last Sun node of the open stations from `base` on; ``reach[b % OPEN]`` begins with those of one."""
    low, high = reach[base % OPEN, 0], reach[base % OPEN, 1]
    for b in range(base + 1, min(base + OPEN, stations.many)):
        low, high = min(low, reach[b % OPEN, 0]), max(high, reach[b % OPEN, 1])
    return low, high
