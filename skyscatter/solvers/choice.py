"""Which solver a scene of surfaces is rendered with when nobody says.

Measured (docs/validation-surfaces.md): walks from the camera are the better ones without fog and in thin fog, photons
from an optical depth of some 0.4 across the scene on, and wherever glass or mirrors hide lamps from walks.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.solvers.base import Array

#: Scattering optical depth across the scene from which on photons are better.
DEEP = 0.4


def preferred_solver(scene: Any, wavelengths: Array) -> str:
    """``path`` or ``photons`` for a scene at wavelengths [nm]."""
    from skyscatter.solvers.photons import check_table
    from skyscatter.solvers.surface_path import out_of_reach
    from skyscatter.solvers.surfaces import compile_surfaces

    middle = np.atleast_1d(wavelengths)[len(np.atleast_1d(wavelengths)) // 2]
    table = compile_surfaces(scene, [float(middle)])
    try:
        check_table(table)
    except DomainError:  # what photons cannot do
        return "path"
    media = table.media
    size = np.full(len(media.priority), 2 * table.lamps.radius)
    for body, inside in zip(scene.bodies, table.shapes.inside, strict=True):
        if inside >= 0:
            low, high = body.shape.bounds
            size[inside] = min(size[inside], float(np.linalg.norm(high - low)))
    deep = bool(np.any(media.scattering[:, 0] * size > DEEP))
    return "photons" if deep or out_of_reach(table) else "path"
