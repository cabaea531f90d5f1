"""Whether densities keep to the bounds that tracking trusts: asked before walks begin, and watched on their way.

Tracking sees nothing where the bound of a density is 0 (see `kernels.tracking`), so a field whose bounds are wrong
makes light that is wrong and looks sure.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.solvers.base import Array

if TYPE_CHECKING:
    from skyscatter.media.medium import Medium
    from skyscatter.media.space import SpatialField

#: What to do about it.
_REMEDY = 'the bounds of its field are wrong; use transmittance = "quadrature", which needs none, and report the field'


def check_bounds(medium: Medium) -> None:
    """Look up one density in every cell of the grid of bounds.

    Raises
    ------
    DomainError
        If one lies outside its bounds; names the component.
    """
    for part, (above, point) in zip(medium.components, excesses(medium.fields), strict=True):
        if above > 0:
            place = ", ".join(f"{x:.6g}" for x in point)
            message = f"outside its bounds in {above} cells, one of them at ({place}) m: {_REMEDY}"
            raise DomainError(f"density of {part.name!r}", part.density.kind, message)


@lru_cache(maxsize=32)
def excesses(fields: tuple[SpatialField, ...]) -> tuple[tuple[int, tuple[float, ...]], ...]:
    """Of every field the cells with a density outside its bounds, and the last such point; kept between calls."""
    from skyscatter.kernels.space import fill_densities, make_space_work
    from skyscatter.kernels.tracking import TIGHT
    from skyscatter.media.spacetables import medium_table

    space = medium_table(fields)
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in space.cells), indexing="ij"), axis=-1).reshape(-1, 3)
    # Away from faces, which belong to two cells.
    share = np.random.default_rng(8).uniform(1e-6, 1 - 1e-6, corners.shape)
    points = space.bound_low + (corners + share) * space.bound_step
    density = np.empty((len(points), len(fields)))
    fill_densities(space, points, make_space_work(), density)
    wrong = (density > TIGHT * space.upper) | (TIGHT * density < space.lower)
    last = [points[np.flatnonzero(row)[-1]] if row.any() else np.zeros(3) for row in wrong.T]
    return tuple((int(row.sum()), tuple(point)) for row, point in zip(wrong.T, last, strict=True))


def check_excess(excess: Array, names: tuple[str, ...]) -> None:
    """Refuse light that was found by tracking through densities above their bounds.

    Parameters
    ----------
    excess : ndarray, shape (component, 2)
        How many densities were above, and the worst ratio to the bound.
    names : tuple of str
        Of the components.

    Raises
    ------
    DomainError
        If there were any; names the component.
    """
    for name, (count, worst) in zip(names, excess, strict=True):
        if count > 0:
            size = "where its bound is 0" if np.isinf(worst) else f"up to {worst:.3g} times its bound"
            raise DomainError(f"density of {name!r}", size, f"met {count:.0f} times by tracking: {_REMEDY}")
