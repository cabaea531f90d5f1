"""The plainest field: as much everywhere, without end."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.media.space import Array, FieldTerm, SpatialField


class Everywhere(SpatialField):
    """Density 1 everywhere, for the media of scenes with surfaces: fog in a room, milk in a glass.

    It has no end, and so no column by which an optical depth could be meant: its component's optics are given by
    coefficients.  Kernels know it as a number for each component, not as a term of the table of fields.

    Examples
    --------
    >>> from skyscatter import fields
    >>> fog = fields.Everywhere()
    >>> fog.density([[0, 0, 0], [1e6, 0, 0]]).tolist()
    [1.0, 1.0]
    >>> float(fog.column([0, 0, 0], [3, 4, 0]))  # m, the length of the segment
    5.0
    """

    kind: Literal["everywhere"] = "everywhere"

    def terms(self) -> tuple[FieldTerm, ...]:
        """No terms: see above."""
        return ()

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        return np.ones(len(low)), np.ones(len(low))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Without end."""
        return np.full(3, -np.inf), np.full(3, np.inf)

    @property
    def centre(self) -> Array:
        """The model's origin, as good as any point."""
        return np.zeros(3)

    def density(self, points: ArrayLike) -> Array:
        """1, in the shape of the points (..., 3) without the last axis."""
        return np.ones(np.asarray(points, float).shape[:-1])

    def column(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Length of straight segments [m]."""
        return np.asarray(np.linalg.norm(np.asarray(end, float) - np.asarray(start, float), axis=-1))

    def reference_column(self) -> float:
        """Not a number: a field without end has none."""
        return float("nan")
