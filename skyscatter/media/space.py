"""The contract of density fields in three dimensions.

A field is a dimensionless density over points of the model's frame [m].  Each field writes itself as a sum of terms of
small programs (`FieldTerms`), which `skyscatter.media.spacetables` packs for the kernels; so a new field is one class
here and one branch in `kernels.space`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.record import Record
from skyscatter.registry import contract

Array = NDArray[np.float64]

#: What ``a + b`` and its like make, by name: `media.operations`, which stands on this module, puts them here.
OPERATIONS: dict[str, Callable[..., SpatialField]] = {}


class Instruction(NamedTuple):
    """One step of a term's program."""

    operation: int
    affine: Array | None = None  #: (3, 4) from the model's frame to the leaf's; None for operations
    parameters: tuple[float, ...] = ()
    data: NDArray[np.float32] | None = None  #: float32 numbers of a grid or of particles
    index: tuple[int, ...] = ()  # type: ignore[assignment]  # hides tuple.index, which nobody needs here


class FieldTerm(NamedTuple):
    """One summand of a field."""

    program: tuple[Instruction, ...]
    method: int  #: how its column is found: `kernels.space` CLOSED_FORM, CELLS or QUADRATURE
    factor: float
    box: Array  #: (2, 3) lowest and highest corner of where it is not zero [m]
    scale: float  #: longest panel of the quadrature [m]


@contract
class SpatialField(Record):
    """Dimensionless density as a function of the position in the model's frame.

    Examples
    --------
    What every field can do: densities at points, columns along segments, and arithmetic that makes new fields.

    >>> from skyscatter import fields
    >>> ball = fields.Sphere(radius="1 m")
    >>> pair = ball + 2 * ball.moved((3, 0, 0))
    >>> isinstance(pair, fields.SpatialField)
    True
    >>> pair.density([[0, 0, 0], [3, 0, 0], [0, 0, 2]]).tolist()
    [1.0, 2.0, 0.0]
    >>> round(float(pair.column([-9, 0, 0], [9, 0, 0])), 3)  # m of unit density, 2 + 2 x 2
    6.0
    """

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        raise NotImplementedError

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes: lowest and highest value.

        Parameters
        ----------
        low, high : ndarray, shape (box, 3)
            Corners [m].

        Returns
        -------
        lowest, highest : ndarray, shape (box,)
        """
        raise NotImplementedError

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        low, high = self.bounds
        return 0.5 * (low + high)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) [m] of where the density is not zero."""
        boxes = np.array([term.box for term in self.terms()])
        return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)

    @property
    def periods(self) -> Array:
        """Lengths (3,) [m] after which the field repeats along the model's axes; 0 where it does not."""
        return np.zeros(3)

    def density(self, points: ArrayLike) -> Array:
        """Density at points [m] of shape (..., 3); shape (...)."""
        from skyscatter.media.spacetables import field_densities

        return field_densities(self, np.asarray(points, float))

    def column(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Column along straight segments [m of unit density].

        End points [m] have the shape (..., 3) and are broadcast against each other; the result has the shape (...).
        """
        from skyscatter.media.spacetables import field_columns

        return field_columns(self, np.asarray(start, float), np.asarray(end, float))

    def reference_column(self) -> float:
        """Column through the centre along the model's z axis [m of unit density]."""
        low, high = self.bounds
        x, y, _ = self.centre
        return float(self.column([x, y, low[2]], [x, y, high[2]]))

    def __add__(self, other: Any) -> SpatialField:
        """Sum of two fields."""
        if not isinstance(other, SpatialField):
            return NotImplemented
        return OPERATIONS["sum"](self, other)

    def __mul__(self, other: Any) -> SpatialField:
        """Product with a field or a number."""
        if isinstance(other, SpatialField):
            return OPERATIONS["product"](self, other)
        if isinstance(other, (int, float)):
            return OPERATIONS["multiple"](self, float(other))
        return NotImplemented

    def __rmul__(self, other: Any) -> SpatialField:
        """Product with a number."""
        return self.__mul__(other)

    def __pow__(self, exponent: float) -> SpatialField:
        """Power of the density."""
        return OPERATIONS["power"](field=self, exponent=exponent)

    def moved(self, by: Any) -> SpatialField:
        """The field moved by a vector [m]."""
        return OPERATIONS["moved"](field=self, by=by)

    def rotated(self, axis: Any = (0, 0, 1), turn_deg: float = 0.0, about: Any = (0, 0, 0)) -> SpatialField:
        """The field turned about z, then with its z axis towards `axis`, about a point [m]."""
        return OPERATIONS["rotated"](field=self, axis=axis, turn_deg=turn_deg, about=about)

    def scaled(self, factors: Any, about: Any = (0, 0, 0)) -> SpatialField:
        """The field stretched by a factor, or by one along each axis, about a point [m]."""
        three = (factors,) * 3 if isinstance(factors, (int, float)) else factors
        return OPERATIONS["scaled"](field=self, factors=three, about=about)

    def carved_by(self, other: SpatialField, level: float | None = None) -> SpatialField:
        """The field where the other is below a level, or times what the other lacks to 1."""
        return OPERATIONS["carved"](field=self, by=other, level=level)

    def warped(self, amplitude: Any, scale: Any, seed: int = 0) -> SpatialField:
        """The field seen through smoothly displaced coordinates."""
        return OPERATIONS["warped"](field=self, amplitude=amplitude, scale=scale, seed=seed)
