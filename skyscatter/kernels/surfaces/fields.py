"""Densities and columns of media between surfaces, in code that is only there where it is needed.

Fields in three dimensions of every kind are much to compile, and most rooms hold none.  ``MediaTable.space`` is None
where all media are the same everywhere; these functions then compile to nothing.
"""

from __future__ import annotations

import math

from skyscatter.kernels.jit import kernel
from skyscatter.kernels.space import clip_to_space, space_columns, space_densities


@kernel
def add_field_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
    """`space_columns`, or nothing without fields."""
    if space is not None:
        space_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out)


@kernel
def field_densities(space, x, y, z, work, out):
    """`space_densities`, or zeros without fields."""
    if space is not None:
        space_densities(space, x, y, z, work, out)
    else:
        for k in range(out.size):
            out[k] = 0.0


@kernel
def clip_to_fields(space, ox, oy, oz, dx, dy, dz):
    """`clip_to_space`, or never without fields."""
    if space is not None:
        return clip_to_space(space, ox, oy, oz, dx, dy, dz)
    return math.inf, -math.inf
