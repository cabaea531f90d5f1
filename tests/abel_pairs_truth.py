"""Densities whose projections are known in closed form, all within the radius 1 or falling off fast enough."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Pair(NamedTuple):
    """A density f(r) and its projection F(y)."""

    name: str
    density: Callable[[Array], Array]
    projection: Callable[[Array], Array]
    smooth: bool  #: without jumps and kinks


def _chord(y: Array, radius: float) -> Array:
    return 2 * np.sqrt(np.maximum(radius**2 - y**2, 0.0))


def _power(y: Array, radius: float, k: int) -> Array:
    """Integral of r^k along the chord within a radius, k even, by (Gradshteyn & Ryzhik 2.271)."""
    if k == 0:
        return _chord(y, radius)
    half = 0.5 * _chord(y, radius)
    return (2 * radius**k * half + k * y**2 * _power(y, radius, k - 2)) / (k + 1)


def gaussian(width: float) -> Pair:
    """exp(-r^2 / 2 w^2), which at 1 must be small."""
    return Pair(
        f"gaussian {width:g}",
        lambda r: np.exp(-0.5 * (r / width) ** 2),
        lambda y: width * np.sqrt(2 * np.pi) * np.exp(-0.5 * (y / width) ** 2),
        True,
    )


def hollow(wide: float, narrow: float) -> Pair:
    """A Gaussian less a narrower one: a thick, smooth shell."""
    a, b = gaussian(wide), gaussian(narrow)
    return Pair(
        f"hollow {wide:g} {narrow:g}",
        lambda r: a.density(r) - b.density(r),
        lambda y: a.projection(y) - b.projection(y),
        True,
    )


def parabola() -> Pair:
    """1 - r^2."""
    return Pair("parabola", lambda r: 1 - r**2, lambda y: _power(y, 1.0, 0) - _power(y, 1.0, 2), True)


def quartic() -> Pair:
    """(1 - r^2) (1 + 3 r^2) / 4 * 3."""
    return Pair(
        "quartic",
        lambda r: 0.75 * (1 - r**2) * (1 + 3 * r**2),
        lambda y: 0.75 * (_power(y, 1.0, 0) + 2 * _power(y, 1.0, 2) - 3 * _power(y, 1.0, 4)),
        True,
    )


def plummer(core: float) -> Pair:
    """(1 + r^2 / a^2)^(-5/2) within 1."""

    def projection(y: Array) -> Array:
        # The antiderivative along the line of sight is elementary: u / s (1 - u^2 / 3), u = l / sqrt(s^2 + l^2).
        square = core**2 + y**2
        along = 0.5 * _chord(y, 1.0)
        u = along / np.sqrt(square + along**2)
        return 2 * core**5 / square**2 * (u - u**3 / 3)

    return Pair(f"plummer {core:g}", lambda r: (1 + (r / core) ** 2) ** -2.5, projection, True)


def ball(radius: float) -> Pair:
    """1 within a radius."""
    return Pair(f"ball {radius:g}", lambda r: np.where(r < radius, 1.0, 0.0), lambda y: _chord(y, radius), False)


def shell(inner: float, outer: float) -> Pair:
    """1 between two radii."""
    return Pair(
        f"shell {inner:g} {outer:g}",
        lambda r: np.where((r > inner) & (r < outer), 1.0, 0.0),
        lambda y: _chord(y, outer) - _chord(y, inner),
        False,
    )


def cone() -> Pair:
    """1 - r, which has a peak in the middle."""

    def projection(y: Array) -> Array:
        half = 0.5 * _chord(y, 1.0)
        log = np.log((1 + half) / np.where(y > 0, y, 1.0))
        return half - np.where(y > 0, y**2 * log, 0.0)

    return Pair("cone", lambda r: 1 - r, projection, False)


TRAINING = (
    gaussian(0.25), gaussian(0.1), hollow(0.25, 0.15), hollow(0.2, 0.16), parabola(), quartic(), plummer(0.15), cone(),
    ball(0.5), shell(0.4, 0.7),
)  # fmt: skip
"""What the settings of the inversion were judged on; the reference pairs are none of them."""
