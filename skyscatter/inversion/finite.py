"""Derivatives of radiances by central differences of separate solutions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.run import radiance

Array = NDArray[np.float64]


class Derivatives(NamedTuple):
    """Radiances and their derivatives."""

    value: Array  #: (ray, wavelength)
    standard_error: Array  #: (ray, wavelength)
    jacobian: Array  #: (parameter, ray, wavelength)
    jacobian_error: Array  #: (parameter, ray, wavelength)


def differentiate(
    scenes: Callable[[Array], Any],
    theta: Array,
    steps: Array,
    origins: Array,
    directions: Array,
    wavelengths: Array,
    *,
    solver: str,
    **options: Any,
) -> Derivatives:
    """Radiance and derivatives."""
    middle = radiance(scenes(theta), origins, directions, wavelengths, solver, **options)
    jacobian, error = [], []
    for k, step in enumerate(steps):
        ends = []
        for sign in (1, -1):
            there = theta.copy()
            there[k] += sign * step
            ends.append(radiance(scenes(there), origins, directions, wavelengths, solver, **options))
        jacobian.append((ends[0].radiance - ends[1].radiance) / (2 * step))
        error.append(np.hypot(ends[0].standard_error, ends[1].standard_error) / (2 * step))
    empty = np.zeros((0, *middle.radiance.shape))
    return Derivatives(
        middle.radiance,
        middle.standard_error,
        np.stack(jacobian) if jacobian else empty,
        np.stack(error) if error else empty,
    )
