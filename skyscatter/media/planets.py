"""The air of a planet as a field in three dimensions: shells by altitude around any point."""

from __future__ import annotations

from typing import Literal

import numpy as np

from skyscatter.kernels.codes.shells import CHAPMAN, EXPONENTIAL, GAUSSIAN, LINEAR
from skyscatter.kernels.codes.space import AROUND
from skyscatter.media.fields import AnyField, FieldRow
from skyscatter.media.shapes import Leaf, Shape, radii
from skyscatter.media.space import Array
from skyscatter.units import PositiveMetres

#: A box along an axis that holds the shell is wider than it by this share, and bounds of densities by the next.
_ROUNDING = 1e-9


class AroundPlanet(Shape):
    """A profile over altitude around a planet, nothing inside of it: an atmosphere in the frame of a scene in metres.

    For a place on the ground at the origin and z upwards put the middle of the planet at (0, 0, -radius).

    Parameters
    ----------
    position : three lengths
        Middle of the planet [m].
    radius : length
        Of the planet, where altitudes are 0 [m].
    profile : field of spherical symmetry
        Density over altitude, such as ``{ kind = "exponential", scale_height = "8 km" }``.

    Other Parameters
    ----------------
    axis, turn_deg, axes
        As of every shape: the direction of its own z axis, a turn about it [degree] before that, and factors by which
        it is stretched along its own x, y and z.

    Examples
    --------
    The air above a place on the ground.  Towards the horizon its column is 35 times that towards the zenith:

    >>> from skyscatter import fields
    >>> profile = {"kind": "exponential", "scale_height": "8 km"}
    >>> air = fields.AroundPlanet(position=(0, 0, "-6371 km"), radius="6371 km", profile=profile)
    >>> round(air.reference_column())  # m, vertical
    8000
    >>> round(float(air.column([0, 0, 0], [2e6, 0, 0])) / air.reference_column(), 1)
    35.4
    """

    kind: Literal["around-planet"] = "around-planet"
    radius: PositiveMetres
    profile: AnyField

    @property
    def is_round(self) -> bool:
        """Whether its shells are spheres, stretched along no axis."""
        return self.axes == (1.0, 1.0, 1.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame: the planet's radius is 1."""
        row = self.profile.row()
        a, b = (*row.parameters, 0.0, 0.0)[:2]
        counts = (float(len(row.altitudes)), float(len(row.breaks)))
        numbers = (self.radius, float(row.kind), a, b, row.top, *counts, *row.altitudes, *row.densities, *row.breaks)
        # Along the ground the density changes over the way on which the line rises by the scale height.
        scale = np.sqrt(2 * _scale_height(row) / self.radius)
        return Leaf(AROUND, self.radius, 1 + row.top / self.radius, float(scale), (*numbers, float(scale)))

    def reference_column(self) -> float:
        """Vertical column above the ground [m of unit density], by which optical depths are meant."""
        return self.profile.reference_column()

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        row = self.profile.row()
        near, far = (self.radius * (r - 1) for r in radii(low, high))
        ends = [_profile(row, np.clip(h, 0.0, row.top)) for h in (near, far)]
        lowest, highest = np.minimum(*ends), np.maximum(*ends)
        for peak, value in _turns(row):
            inside = (near <= peak) & (peak <= far)
            lowest = np.where(inside, np.minimum(lowest, value), lowest)
            highest = np.where(inside, np.maximum(highest, value), highest)
        first = row.altitudes[0] if row.altitudes else 0.0
        # Where a box sticks out of the shell its lowest density is 0, and where it is all outside the highest too.
        lowest = np.where((near < max(first, 0.0)) | (far >= row.top), 0.0, lowest)
        highest = np.where((far < 0.0) | (near >= row.top), 0.0, highest)
        return lowest * (1 - _ROUNDING), highest * (1 + _ROUNDING)


def _scale_height(row: FieldRow) -> float:
    """A length over which the density changes [m]."""
    if row.kind in (EXPONENTIAL, GAUSSIAN, CHAPMAN):
        return row.parameters[0 if row.kind == EXPONENTIAL else 1]
    return 0.1 * row.top


def _profile(row: FieldRow, h: Array) -> Array:
    """Density at altitudes within the shell, its lower and upper ends taken as part of it."""
    p = row.parameters
    if row.kind == EXPONENTIAL:
        return np.exp(-h / p[0])
    if row.kind == GAUSSIAN:
        return np.exp(-0.5 * ((h - p[0]) / p[1]) ** 2)
    if row.kind == CHAPMAN:
        z = (h - p[0]) / p[1]
        return np.exp(1 - z - np.exp(-z))
    if row.kind == LINEAR:
        return np.interp(h, row.altitudes, row.densities)
    return np.exp(np.interp(h, row.altitudes, np.log(row.densities)))


def _turns(row: FieldRow) -> list[tuple[float, float]]:
    """Altitudes at which the density may be highest or lowest, and its values there."""
    if row.kind in (GAUSSIAN, CHAPMAN):
        return [(row.parameters[0], 1.0)]
    return list(zip(row.altitudes, row.densities, strict=True))
