"""Densities and columns of media between surfaces, in code that is only there where it is needed.

Fields in three dimensions of every kind are much to compile, and most rooms hold none.  ``MediaTable.space`` is None
where all media are the same everywhere, and ``MediaTable.shells`` where there is no air around a planet; these
functions, which are handed the one or the other by itself, then compile to nothing.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import kernel
from skyscatter.kernels.space import clip_to_space, space_columns, space_densities
from skyscatter.kernels.surfaces.shells import add_shell_columns, add_shell_densities, clip_to_shells


@kernel
def add_field_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
    """`space_columns`, or nothing without fields."""
    if space is not None:
        space_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out)


@kernel
def add_air_columns(shells, centre, x, d, ta, tb, work, out):
    """`add_shell_columns`, or nothing without shells."""
    if shells is not None:
        add_shell_columns(shells, centre, x, d, ta, tb, work.outward, work.beyond, out)


@kernel
def field_densities(space, x, y, z, work, out):
    """`space_densities`, or zeros without fields."""
    if space is not None:
        space_densities(space, x, y, z, work, out)
    else:
        for k in range(out.size):
            out[k] = 0.0


@kernel
def add_air_densities(shells, centre, x, y, z, work, out):
    """`add_shell_densities`, or nothing without shells."""
    if shells is not None:
        add_shell_densities(shells, centre, x, y, z, work.outward, out)


@kernel
def clip_to_fields(space, ox, oy, oz, dx, dy, dz):
    """`clip_to_space`, or never without fields."""
    if space is not None:
        return clip_to_space(space, ox, oy, oz, dx, dy, dz)
    return math.inf, -math.inf


@kernel
def clip_to_air(shells, centre, x, d):
    """`clip_to_shells`, or never without shells."""
    if shells is not None:
        return clip_to_shells(shells, centre, x, d)
    return math.inf, -math.inf
