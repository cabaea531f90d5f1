"""Which solver a scene of surfaces is rendered with when nobody says.

Measured (docs/validation-surfaces.md): walks from the camera are the better ones without fog and in thin fog, photons
where the camera or a lamp is in a medium with an optical depth of some 0.4 across, and wherever glass or mirrors hide
lamps from walks.  A small body of a dense medium, seen and lit from outside, is met by few photons: that is for walks.
Where the picture is denoised walks are better in nearly any fog: neighbouring pixels share photons, and blotches stay.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.solvers.base import Array

#: Scattering optical depth across the scene from which on photons are better, as they are and where the picture is
#: denoised: of fogs up to 41 deep walks were the better ones then, of deeper fog nothing is known.
DEEP, DEEP_DENOISED = 0.4, 42.0


def preferred_solver(scene: Any, wavelengths: Array, denoised: bool = False, stokes: bool = False) -> str:
    """``path`` or ``photons`` for a scene at wavelengths [nm]; whether its picture is denoised, its light polarised."""
    from skyscatter.solvers.far_lamps import current_medium
    from skyscatter.solvers.photons import check_table, refuse_rough
    from skyscatter.solvers.surface_path import out_of_reach
    from skyscatter.solvers.surfaces import compile_surfaces
    from skyscatter.surfaces.packing import starting_stack

    middle = np.atleast_1d(wavelengths)[len(np.atleast_1d(wavelengths)) // 2]
    table = compile_surfaces(scene, [float(middle)])
    try:
        check_table(table)
        if stokes:
            refuse_rough(table.materials)
    except DomainError:  # what photons cannot do
        return "path"
    media = table.media
    size = np.full(len(media.priority), 2 * table.lamps.radius)
    for body, inside in zip(scene.bodies, table.shapes.inside, strict=True):
        if inside >= 0:
            low, high = body.shape.bounds
            size[inside] = min(size[inside], float(np.linalg.norm(high - low)))
    stacks = [*table.lamps.stack, starting_stack(table.shapes, scene.viewpoint.position)]
    within = {current_medium(media, stack) for stack in stacks}
    most = DEEP_DENOISED if denoised else DEEP
    deep = any(media.scattering[m, 0] * size[m] > most for m in within)
    return "photons" if deep or out_of_reach(table) else "path"
