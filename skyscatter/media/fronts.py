"""Star-shaped surfaces with a smooth edge: ionisation fronts."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import FRONT
from skyscatter.media.shapes import GAUSSIAN_CUT, Leaf, Shape, radii
from skyscatter.media.space import Array
from skyscatter.units import Degrees, NonNegativeMetres, Rows, default


class Front(Shape):
    """Density 1 inside a surface around `position`, 0 outside, with an edge erfc((r - R) / sqrt(2) width) / 2.

    Parameters
    ----------
    radii : tuple of tuples of lengths
        R [m] over direction, bilinear between its nodes: row i of n at the polar angle pi i / (n - 1) from the own z
        axis, column j of m at the azimuth 2 pi j / m from x towards y.  First and last row are the poles, each one
        value m times.
    width : length
        Standard deviation of the edge [m]; 0 is sharp.
    opening_deg : float
        Half angle of a cone about the own z axis that the rows fill instead of all directions, the last one at its rim;
        outside the cone there is nothing.  Above 0 and below 90, or 180.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A surface that lies 2 m from the middle at the poles and 1 m at the equator, with an edge of 5 cm:

    >>> from skyscatter import fields
    >>> front = fields.Front(radii=((2,) * 8, (1,) * 8, (2,) * 8), width="5 cm")
    >>> front.density([[0, 0, 1.8], [1, 0, 0], [1.8, 0, 0]]).round(2).tolist()  # inside, on the edge, outside
    [1.0, 0.5, 0.0]
    """

    kind: Literal["front"] = "front"
    radii: Rows
    width: NonNegativeMetres = default(0.0)
    opening_deg: Degrees = default(180.0)

    @model_validator(mode="after")
    def _check(self) -> Front:
        sizes = {len(row) for row in self.radii}
        if len(self.radii) < 2 or len(sizes) != 1 or 0 in sizes:
            raise DomainError("radii", f"{len(self.radii)} rows", "needs two rows or more, all of one length")
        table = np.array(self.radii)
        if not (table > 0).all():
            raise DomainError("radii", float(table.min()), "must all be above 0")
        if not (0 < self.opening_deg < 90 or self.opening_deg == 180):
            raise DomainError("opening_deg", self.opening_deg, "must lie above 0 and below 90, or be 180")
        for row in (table[0], table[-1]) if self.opening_deg == 180 else table[:1]:
            if np.ptp(row) > 1e-9 * row.max():
                raise DomainError("radii", float(row[0]), "the first and the last row are poles: repeat one value")
        return self

    @property
    def _opening(self) -> float:
        return float(np.radians(self.opening_deg))

    def _table(self) -> Array:
        return np.array(self.radii)

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        table = self._table()
        unit = float(table.max())
        width = self.width / unit
        head = (width, GAUSSIAN_CUT, float(table.shape[0]), float(table.shape[1]), self._opening)
        scale = 0.25 * float(table.min()) / unit
        return Leaf(FRONT, unit, 1.0 + GAUSSIAN_CUT * width, scale, (*head, *(table / unit).ravel()))

    def _steepest(self) -> float:
        """Largest change of the radius with the angle between directions, per radian, in units of the largest."""
        table = self._table() / self._table().max()
        rows, columns = table.shape
        theta = self._opening * np.arange(rows) / (rows - 1)
        down = np.abs(np.diff(table, axis=0)).max() * (rows - 1) / self._opening
        around = np.abs(np.diff(np.hstack([table, table[:, :1]]), axis=1)).max(axis=1) * columns / (2 * np.pi)
        # Towards a pole the change around it and the sine shrink together: the neighbouring row's ratio holds.
        sine = np.sin(theta)
        sine[[0, -1] if self.opening_deg == 180 else [0]] = np.inf
        least = np.minimum(sine[:-1], sine[1:])
        ratios = np.maximum(around[:-1], around[1:]) / least
        return float(np.hypot(down, ratios[np.isfinite(ratios)].max(initial=0.0)))

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        from skyscatter.kernels.shapes import fill_front_radii

        leaf = self.leaf()
        near, far = radii(low, high)
        middle, half = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)
        distance = np.linalg.norm(middle, axis=1)
        radius = np.empty(len(low))
        fill_front_radii(np.array(leaf.parameters[2:]), np.ascontiguousarray(middle), radius)
        # Directions to a box differ from that to its middle by less than the angle of the ball around it.
        outside = distance > half
        sine = np.where(outside, half / np.where(outside, distance, 1.0), 1.0)
        change = np.where(outside, self._steepest() * np.arcsin(sine), np.inf)
        table = self._table() / self._table().max()
        smallest = np.maximum(radius - change, table.min()) * (1 - 1e-12)
        largest = np.minimum(radius + change, table.max()) * (1 + 1e-12)
        lowest, highest = self._edge(far - smallest), self._edge(near - largest)
        if self.opening_deg == 180:
            return lowest, highest
        return self._within_cone(middle, distance, np.where(outside, np.arcsin(sine), np.pi), near, (lowest, highest))

    def _within_cone(
        self, middle: Array, distance: Array, angle: Array, near: Array, bounds: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Bounds of boxes within `angle` of the direction of their middle, where there is nothing outside the cone."""
        theta = np.arccos(np.clip(middle[:, 2] / np.where(distance > 0, distance, 1.0), -1.0, 1.0))
        whole = theta + angle < self._opening * (1 - 1e-9)
        # At the rim the slope of the table says nothing: there the largest radius of all bounds the density.
        highest = np.where(whole, bounds[1], self._edge(near - 1.0 - 1e-12))
        touched = theta - angle <= self._opening * (1 + 1e-9)
        return np.where(whole, bounds[0], 0.0), np.where(touched, highest, 0.0)

    def _edge(self, beyond: Array) -> Array:
        """Density at a distance beyond the surface, in units of the largest radius; never rising."""
        from scipy.special import erfc

        width, cut = self.leaf().parameters[:2]
        if width == 0:
            return np.where(beyond <= 0, 1.0, 0.0)
        x = beyond / width
        return np.where(x < -cut, 1.0, np.where(x > cut, 0.0, 0.5 * erfc(x / np.sqrt(2))))
