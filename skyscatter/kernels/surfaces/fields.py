"""Densities and columns of media between surfaces, in code that is only there where it is needed.

Fields in three dimensions of every kind are much to compile, and most rooms hold none.  ``MediaTable.space`` is None
where all media are the same everywhere; these functions then compile to nothing.
"""

from __future__ import annotations

import math

from numba import types
from numba.extending import overload

from skyscatter.kernels.pointed import whole
from skyscatter.kernels.space import clip_to_space, space_columns, space_densities

_COMPILED = {"nogil": True, "_nrt": False, "error_model": "numpy"}


def add_field_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
    """`space_columns`, or nothing without fields."""
    if space is not None:
        space_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out)


def field_densities(space, x, y, z, work, out):
    """`space_densities`, or zeros without fields."""
    if space is not None:
        space_densities(space, x, y, z, work, out)
    else:
        out[:] = 0.0


def clip_to_fields(space, ox, oy, oz, dx, dy, dz):
    """`clip_to_space`, or never without fields."""
    return (math.inf, -math.inf) if space is None else clip_to_space(space, ox, oy, oz, dx, dy, dz)


@overload(add_field_columns, jit_options=_COMPILED)
def _add_field_columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
    if isinstance(space, types.NoneType):

        def nothing(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
            pass

        return nothing

    def columns(space, ox, oy, oz, dx, dy, dz, ta, tb, work, out):
        space_columns(whole(space), ox, oy, oz, dx, dy, dz, ta, tb, whole(work), out)

    return columns


@overload(field_densities, jit_options=_COMPILED)
def _field_densities(space, x, y, z, work, out):
    if isinstance(space, types.NoneType):

        def zeros(space, x, y, z, work, out):
            for c in range(out.size):
                out[c] = 0.0

        return zeros

    def densities(space, x, y, z, work, out):
        space_densities(whole(space), x, y, z, whole(work), out)

    return densities


@overload(clip_to_fields, jit_options=_COMPILED)
def _clip_to_fields(space, ox, oy, oz, dx, dy, dz):
    if isinstance(space, types.NoneType):

        def never(space, ox, oy, oz, dx, dy, dz):
            return math.inf, -math.inf

        return never

    def clip(space, ox, oy, oz, dx, dy, dz):
        return clip_to_space(whole(space), ox, oy, oz, dx, dy, dz)

    return clip
