"""Shapes that light meets: spheres, planes, rectangles, boxes, disks.

Normals point out of a shape; the inside of a plane, a rectangle, a disk is the side from which the normal points away.
Spheres, boxes and closed meshes hold a volume, a plane bounds a half space; rectangles and disks bound nothing.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.media.shapes import axis_rotation
from skyscatter.record import Record
from skyscatter.units import (
    Degrees,
    NonNegativeMetres,
    OptionalPair,
    OptionalTriple,
    Place,
    PositiveMetres,
    Size,
    Sizes,
    Triple,
    default,
)

Array = NDArray[np.float64]

#: Sides of a rectangle that are this close to a right angle (cosine) are at one.
SQUARE = 1e-9


class Surface(Record):
    """What all shapes have in common."""

    #: Whether the shape bounds a volume, so that a medium can be inside.
    holds_volume: ClassVar[bool] = True

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) [m] of a box around it; infinite for a plane."""
        raise NotImplementedError

    def check_volume(self) -> None:
        """Refuse a shape that holds no volume: no medium can be inside of it."""
        if not self.holds_volume:
            kind = type(self).__name__.lower()
            raise DomainError("inside", kind, "holds no volume: give a sphere, a box, a plane, a turned or meshed body")


def _unit(name: str, vector: tuple[float, float, float]) -> Array:
    """A direction of unit length."""
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise DomainError(name, vector, "must point somewhere: one of its numbers is not 0")
    return np.array(vector) / length


def _around(points: Array) -> tuple[Array, Array]:
    return points.min(axis=0), points.max(axis=0)


class Sphere(Surface):
    """A sphere.

    Parameters
    ----------
    position : three lengths
        Its middle [m].
    radius : length
        [m]

    Examples
    --------
    >>> from skyscatter import surfaces
    >>> ball = surfaces.Sphere(position=(0, 0, "1 m"), radius="10 cm")
    >>> [corner.round(3).tolist() for corner in ball.bounds]  # m
    [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]]
    """

    kind: Literal["sphere"] = "sphere"
    position: Place = default((0.0, 0.0, 0.0))
    radius: PositiveMetres = default(1.0)

    @model_validator(mode="after")
    def _check(self) -> Sphere:
        return self

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        return np.array(self.position) - self.radius, np.array(self.position) + self.radius


class Plane(Surface):
    """An endless plane.  A medium inside of it fills the half space from which the normal points away.

    Parameters
    ----------
    position : three lengths
        Any of its points [m].
    normal : three numbers
        Of any length.

    Examples
    --------
    A slope that rises towards +y, 20 degrees from the horizontal:

    >>> import math
    >>> from skyscatter import surfaces
    >>> slope = surfaces.Plane(normal=(0, -math.tan(math.radians(20)), 1))
    >>> slope.unit_normal.round(3).tolist()
    [0.0, -0.342, 0.94]
    """

    kind: Literal["plane"] = "plane"
    position: Place = default((0.0, 0.0, 0.0))
    normal: Triple = default((0.0, 0.0, 1.0))

    @model_validator(mode="after")
    def _check(self) -> Plane:
        _unit("normal", self.normal)
        return self

    @property
    def unit_normal(self) -> Array:
        """The normal (3,) with length 1."""
        return _unit("normal", self.normal)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        return np.full(3, -np.inf), np.full(3, np.inf)


class Rectangle(Surface):
    """A rectangle, given in one of two ways.

    Parameters
    ----------
    position : three lengths
        Its middle [m].
    normal : three numbers
        Of any length.
    size : two lengths
        Sides [m]: the first at right angles to `up`, the second along it.
    up : three numbers, optional
        Direction of the second side; only its part across the normal counts.  When not given: z, or y where the
        normal is along z.
    corner, first_edge, second_edge : three lengths each, optional
        Instead of all of the above: a corner and the two edges from it, at right angles; the normal is first x second.

    Examples
    --------
    A panel at the ceiling that looks down, given by its middle and its sides:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> panel = surfaces.Rectangle(position=(0, 0, "2.5 m"), normal=(0, 0, -1), size=("1.2 m", "30 cm"))
    >>> corner, first, second = panel.edges
    >>> round(float(np.cross(first, second)[2]), 3)  # m2; downwards, as the normal
    -0.36
    >>> panel.holds_volume  # no medium can be inside
    False
    """

    holds_volume: ClassVar[bool] = False
    kind: Literal["rectangle"] = "rectangle"
    position: OptionalTriple[Place] = default(None)
    normal: OptionalTriple[Triple] = default(None)
    size: OptionalPair[Size] = default(None)
    up: OptionalTriple[Triple] = default(None)
    corner: OptionalTriple[Place] = default(None)
    first_edge: OptionalTriple[Place] = default(None)
    second_edge: OptionalTriple[Place] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Rectangle:
        by_corner = (self.corner, self.first_edge, self.second_edge)
        by_middle = (self.position, self.normal, self.size, self.up)
        ways = "give position, normal, size (and up), or corner, first_edge and second_edge"
        if any(v is not None for v in by_corner):
            if any(v is None for v in by_corner) or any(v is not None for v in by_middle):
                raise DomainError("rectangle", "mixed", ways)
            a, b = (
                _unit("first_edge", self.first_edge or (0, 0, 0)),
                _unit("second_edge", self.second_edge or (0, 0, 0)),
            )
            if abs(a @ b) > SQUARE:
                raise DomainError("second_edge", self.second_edge, "must be at a right angle to first_edge")
            return self
        if self.size is None:
            raise DomainError("size", None, ways)
        normal = _unit("normal", self.normal or (0.0, 0.0, 1.0))
        if self.up is not None and np.linalg.norm(np.cross(_unit("up", self.up), normal)) < SQUARE:
            raise DomainError("up", self.up, "must not be along the normal")
        return self

    @property
    def edges(self) -> tuple[Array, Array, Array]:
        """Corner and the two edges from it, each (3,) [m]; their cross product is along the normal."""
        if self.corner is not None and self.first_edge is not None and self.second_edge is not None:
            a, b = np.array(self.first_edge), np.array(self.second_edge)
            return np.array(self.corner), a, b - (a @ b) / (a @ a) * a
        assert self.size is not None
        normal = _unit("normal", self.normal or (0.0, 0.0, 1.0))
        upright = (0.0, 1.0, 0.0) if abs(normal[2]) > 1 - SQUARE else (0.0, 0.0, 1.0)
        up = np.array(self.up if self.up is not None else upright, float)
        up -= (up @ normal) * normal
        up /= np.linalg.norm(up)
        first, second = np.cross(up, normal) * self.size[0], up * self.size[1]
        return np.array(self.position or (0.0, 0.0, 0.0)) - 0.5 * (first + second), first, second

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        corner, a, b = self.edges
        return _around(np.array([corner, corner + a, corner + b, corner + a + b]))


class Box(Surface):
    """A box.

    Parameters
    ----------
    position : three lengths
        Its middle [m].
    size : three lengths
        Sides along its own x, y and z [m].
    axis : three numbers
        Direction of its own z axis, of any length; x and y follow on the shortest way (for the opposite of z: about x).
    turn_deg : float
        Rotation about its own z axis before that.

    Examples
    --------
    A cube of 1 m, turned by 45 degrees about the vertical, needs more room:

    >>> from skyscatter import surfaces
    >>> cube = surfaces.Box(size=("1 m", "1 m", "1 m"), turn_deg=45)
    >>> low, high = cube.bounds
    >>> (high - low).round(3).tolist()  # m
    [1.414, 1.414, 1.0]
    """

    kind: Literal["box"] = "box"
    position: Place = default((0.0, 0.0, 0.0))
    size: Sizes = default((1.0, 1.0, 1.0))
    axis: Triple = default((0.0, 0.0, 1.0))
    turn_deg: Degrees = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Box:
        _unit("axis", self.axis)
        return self

    @property
    def axes(self) -> Array:
        """Its own unit axes (axis, 3)."""
        return axis_rotation(self.axis, self.turn_deg).T

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        reach = 0.5 * np.array(self.size) @ np.abs(self.axes)
        return np.array(self.position) - reach, np.array(self.position) + reach


class Disk(Surface):
    """A disk, or a ring.

    Parameters
    ----------
    position : three lengths
        Its middle [m].
    normal : three numbers
        Of any length.
    radius : length
        [m]
    inner_radius : length
        Of the hole; 0 without one.

    Examples
    --------
    A ring that looks towards +y:

    >>> from skyscatter import surfaces
    >>> ring = surfaces.Disk(normal=(0, 1, 0), radius="1 m", inner_radius="60 cm")
    >>> low, high = ring.bounds
    >>> (high - low).round(3).tolist()  # m
    [2.0, 0.0, 2.0]
    >>> ring.holds_volume  # no medium can be inside
    False
    """

    holds_volume: ClassVar[bool] = False
    kind: Literal["disk"] = "disk"
    position: Place = default((0.0, 0.0, 0.0))
    normal: Triple = default((0.0, 0.0, 1.0))
    radius: PositiveMetres = default(1.0)
    inner_radius: NonNegativeMetres = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Disk:
        if not 0 <= self.inner_radius < self.radius:
            raise DomainError("inner_radius", self.inner_radius, f"must be from 0 to below the radius, {self.radius}")
        _unit("normal", self.normal)
        return self

    @property
    def unit_normal(self) -> Array:
        """The normal (3,) with length 1."""
        return _unit("normal", self.normal)

    @property
    def across(self) -> Array:
        """A unit vector (3,) in the disk."""
        normal = self.unit_normal
        other = np.eye(3)[np.argmin(np.abs(normal))]
        across = np.cross(normal, other)
        return across / np.linalg.norm(across)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        reach = self.radius * np.sqrt(np.maximum(1.0 - self.unit_normal**2, 0.0))
        return np.array(self.position) - reach, np.array(self.position) + reach
