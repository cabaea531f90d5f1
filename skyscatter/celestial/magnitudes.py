"""Magnitudes of the planets in V: the formulas of Mallama & Hilton 2018 (Astronomy and Computing 25, 10).

Each takes the distances from the Sun and the observer [au] and the phase angle [degree]; the numbers in comments are
those of the paper's equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable


def _polynomial(x: float, *coefficients: float) -> float:
    return sum(c * x**k for k, c in enumerate(coefficients))


def mercury(phase: float) -> float:
    """At 1 au from both (2)."""
    return _polynomial(phase, -0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12)


def venus(phase: float) -> float:
    """At 1 au from both (3, 4); beyond 163.7 degrees the droplets of its clouds shine forwards."""
    if phase < 163.7:
        return _polynomial(phase, -4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9)
    return _polynomial(phase, 236.05828, -2.81914, 8.39034e-3)


def earth(phase: float) -> float:
    """At 1 au from both (5)."""
    return _polynomial(phase, -3.99, -1.060e-3, 2.054e-4)


def mars(phase: float) -> float:
    """At 1 au from both (6, 7), the mean over its rotation and seasons, which change it by 0.06 and 0.03."""
    if phase <= 50.0:
        return _polynomial(phase, -1.601, 2.267e-2, -1.302e-4)
    return _polynomial(phase, -0.367, -0.02573, 3.445e-4)


def jupiter(phase: float) -> float:
    """At 1 au from both (8, 9)."""
    if phase <= 12.0:
        return _polynomial(phase, -9.395, -3.7e-4, 6.16e-4)
    return -9.428 - 2.5 * math.log10(_polynomial(phase / 180.0, 1.0, -1.507, -0.363, -0.062, 2.809, -1.876))


def saturn(phase: float, sun_latitude: float, observer_latitude: float) -> float:
    """At 1 au from both, with its rings (10); latitudes [degree] of Sun and observer from the plane of the rings.

    Where they stand on different sides the rings are seen from their dark side and do not count.
    """
    product = sun_latitude * observer_latitude
    tilt = math.sin(math.radians(math.sqrt(product))) if product > 0.0 else 0.0
    return -8.914 - 1.825 * tilt + 0.026 * phase - 0.378 * tilt * math.exp(-2.25 * phase)


def uranus(phase: float, sun_latitude: float, observer_latitude: float) -> float:
    """At 1 au from both (14, 15); planetographic latitudes [degree] of Sun and observer."""
    latitude = 0.5 * (abs(sun_latitude) + abs(observer_latitude))
    more = _polynomial(phase, 0.0, 6.587e-3, 1.045e-4) if phase > 3.1 else 0.0
    return -7.110 - 8.4e-4 * latitude + more


def neptune(phase: float, year: float) -> float:
    """At 1 au from both (16, 17): brighter from 1980 to 2000, constant since."""
    more = _polynomial(phase, 0.0, 7.944e-3, 9.617e-5) if phase > 1.9 else 0.0
    return min(max(-6.89 - 0.0054 * (year - 1980.0), -7.00), -6.89) + more


#: Those that need nothing but the phase angle.
PLAIN: dict[str, Callable[[float], float]] = {
    "Mercury": mercury, "Venus": venus, "Earth": earth, "Mars": mars, "Jupiter": jupiter,
}  # fmt: skip
