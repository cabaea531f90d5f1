"""Kinds of densities over altitude, and one of them as data."""

from __future__ import annotations

from typing import NamedTuple

EXPONENTIAL, LINEAR, LOGARITHMIC, GAUSSIAN, CHAPMAN = 0, 1, 2, 3, 4


class FieldRow(NamedTuple):
    """One field as the kernels see it."""

    kind: int
    parameters: tuple[float, ...]
    top: float
    altitudes: tuple[float, ...]
    densities: tuple[float, ...]
    breaks: tuple[float, ...]
