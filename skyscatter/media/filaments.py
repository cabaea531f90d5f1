"""Filaments: density around a curve."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import FILAMENT
from skyscatter.media.shapes import GAUSSIAN_CUT, Leaf, Shape
from skyscatter.media.space import Array
from skyscatter.units import OptionalNumber, Places, PositiveMetres, PositiveNumber, default

#: Straight pieces between two points of a smooth filament.
PIECES_PER_SPAN = 8


class Filament(Shape):
    """Density around a curve through points, depending on the distance d from its nearest point.

    Parameters
    ----------
    points : tuple of three lengths each
        The curve's course in its own frame [m]; two or more.
    width : length
        w [m].
    profile : str
        ``"gaussian"``: exp(-d^2 / 2 w^2), cut at 1e-8; ``"plummer"``: (1 + d^2 / w^2)^(-exponent / 2).
    exponent : float
        Of the second; 2 is typical of observed filaments (Arzoumanian et al. 2011, A&A 529, L6), 4 of an isothermal
        cylinder (Ostriker 1964, ApJ 140, 1056).
    cut : length, optional
        Distance beyond which there is nothing [m]; 10 widths for ``"plummer"`` when not given.
    smooth : bool
        A Catmull-Rom (1974) spline through the points, in 8 straight pieces between two of them; else straight lines.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A bent filament.  Its course goes through the points, and the column across it is sqrt(2 pi) widths:

    >>> from skyscatter import fields
    >>> filament = fields.Filament(points=((-1, 0, 0), (0, 0.2, 0), (1, 0, 0)), width=0.05)
    >>> float(filament.density([0, 0.2, 0]))
    1.0
    >>> round(float(filament.column([0, 0.2, -1], [0, 0.2, 1])) / filament.width, 3)
    2.507
    """

    kind: Literal["filament"] = "filament"
    points: Places
    width: PositiveMetres
    profile: Literal["gaussian", "plummer"] = "gaussian"
    exponent: PositiveNumber = default(2.0)
    cut: OptionalNumber[PositiveMetres] = default(None)
    smooth: bool = True

    @model_validator(mode="after")
    def _check(self) -> Filament:
        if len(self.points) < 2:
            raise DomainError("points", len(self.points), "a filament needs two points or more")
        if (np.linalg.norm(np.diff(self.points, axis=0), axis=1) == 0).any():
            raise DomainError("points", "one twice in a row", "leave out the second")
        return self

    def curve(self) -> Array:
        """Nodes of the chain of straight pieces (node, 3) [m], in its own frame."""
        p = np.array(self.points)
        if not self.smooth or len(p) < 3:
            return p
        ends = np.vstack([2 * p[0] - p[1], p, 2 * p[-1] - p[-2]])
        f = (np.arange(PIECES_PER_SPAN) / PIECES_PER_SPAN)[:, None]
        spans = [
            0.5 * (2 * b + f * (c - a) + f**2 * (2 * a - 5 * b + 4 * c - d) + f**3 * (3 * b - a - 3 * c + d))
            for a, b, c, d in zip(ends, ends[1:], ends[2:], ends[3:], strict=False)
        ]
        return np.vstack([*spans, p[-1:]])

    @property
    def reach(self) -> float:
        """Distance beyond which there is nothing, in widths."""
        if self.cut is not None:
            return self.cut / self.width
        return GAUSSIAN_CUT if self.profile == "gaussian" else 10.0

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes: half-way along the chain's nodes."""
        curve = self.curve()
        return np.array(self.position) + self.rotation @ (curve[len(curve) // 2] * self.axes)

    def at_distance(self, distance: Array) -> Array:
        """Density at distances from the curve [m]."""
        x = np.asarray(distance) / self.width
        gaussian = self.profile == "gaussian"
        value = np.exp(-0.5 * x**2) if gaussian else (1 + x**2) ** (-0.5 * self.exponent)
        return np.where(x <= self.reach, value, 0.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        curve = self.curve() / self.width
        vector = np.diff(curve, axis=0)
        chain = np.column_stack([curve[:-1], vector, 1.0 / (vector**2).sum(axis=1)])
        head = (float(self.profile == "plummer"), 0.5 * self.exponent, self.reach**2, float(len(chain)))
        box = np.array([curve.min(axis=0) - self.reach, curve.max(axis=0) + self.reach])
        return Leaf(FILAMENT, self.width, box, 4.0, (*head, *chain.ravel()))

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame: no point is farther from the middle than a corner."""
        middle, half = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)
        distance = np.full(len(low), np.inf)
        for start, vector, inverse in ((r[:3], r[3:6], r[6]) for r in np.reshape(self.leaf().parameters[4:], (-1, 7))):
            s = np.clip((middle - start) @ vector * inverse, 0.0, 1.0)
            distance = np.minimum(distance, np.linalg.norm(middle - start - s[:, None] * vector, axis=1))
        near, far = np.maximum(distance - half, 0.0) * (1 - 1e-12), (distance + half) * (1 + 1e-12)
        return self.at_distance(far * self.width), self.at_distance(near * self.width)
