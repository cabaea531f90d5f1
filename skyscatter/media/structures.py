"""Analytic density fields with an axis: disks, cones, lobes, slabs and boxes."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import BOX, CONE, DISK
from skyscatter.media.shapes import GAUSSIAN_CUT, Leaf, Shape, Shell, radii
from skyscatter.media.space import Array, FieldTerm
from skyscatter.units import HalfAngle, NonNegativeMetres, OptionalNumber, PositiveMetres, Share, Sizes, default

#: Half width of a slab without sides, in half thicknesses.
ENDLESS = 1e4


class FlaredDisk(Shape):
    """(R / radius)^-exponent exp(-z^2 / 2 h^2) with h = height (R / radius)^flaring, R the distance from the axis.

    The reference column goes through the disk at `radius` on its own x axis; the density there is 1.

    Parameters
    ----------
    radius : length
        Where the next two hold [m].
    height : length
        Scale height h there [m].
    inner, outer : length
        Where it begins and ends [m].
    exponent : float
        Of the density in the middle plane.
    flaring : float
        Of the scale height: 1 is a wedge, above 1 it flares.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A disk around a young star.  At `radius` the column across it is sqrt(2 pi) scale heights; at twice that distance
    the density in the middle plane is 2^-2.25 of that at `radius`:

    >>> from skyscatter import fields
    >>> disk = fields.FlaredDisk(radius="100 AU", height="10 AU", inner="1 AU", outer="400 AU")
    >>> round(disk.reference_column() / disk.height, 3)
    2.507
    >>> round(float(disk.density([2 * disk.radius, 0, 0])), 3)
    0.21
    """

    kind: Literal["flared-disk"] = "flared-disk"
    radius: PositiveMetres
    height: PositiveMetres
    inner: PositiveMetres
    outer: PositiveMetres
    exponent: float = 2.25
    flaring: float = 1.25

    @model_validator(mode="after")
    def _check(self) -> FlaredDisk:
        if not self.inner < self.outer:
            raise DomainError("inner", self.inner, "must lie below the outer radius")
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return np.array(self.position) + self.rotation @ np.array([self.radius * np.array(self.axes)[0], 0.0, 0.0])

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        inner, outer, height = self.inner / self.radius, self.outer / self.radius, self.height / self.radius
        thickest = GAUSSIAN_CUT * height * max(inner**self.flaring, outer**self.flaring)
        reach = np.array([[-outer, -outer, -thickest], [outer, outer, thickest]])
        return Leaf(DISK, self.radius, reach, outer, (self.exponent, self.flaring, height, inner, outer, GAUSSIAN_CUT))

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame: both factors at their extremes."""
        alpha, beta, h, inner, outer, cut = self.leaf().parameters
        (near, far), (z_near, z_far) = radii(low[:, :2], high[:, :2]), radii(low[:, 2:], high[:, 2:])
        within = np.array([np.clip(near, inner, outer), np.clip(far, inner, outer)])
        plane, height = within**-alpha, h * within**beta
        thin, thick = z_far / height.min(axis=0), z_near / height.max(axis=0)
        lowest = np.where(
            (near >= inner) & (far <= outer) & (thin <= cut), plane.min(axis=0) * np.exp(-0.5 * thin**2), 0.0
        )
        highest = np.where(
            (far >= inner) & (near <= outer) & (thick <= cut), plane.max(axis=0) * np.exp(-0.5 * thick**2), 0.0
        )
        return lowest, highest


class Cone(Shape):
    """(r / inner)^-exponent within a cone about the own z axis, with its tip at `position`, between two radii.

    Parameters
    ----------
    half_angle_deg : float
        Between the axis and the side; above 0, below 90.
    length : length
        Outer radius [m].
    inner : length
        Inner radius [m]; above 0 if there is an exponent.
    exponent : float
        How the density falls with the distance from the tip; 0 is uniform.
    both_sides : bool
        Also about the opposite axis: a double cone.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    The width of an outflow 6 m from its tip is 2 x 6 m x tan(30 degrees):

    >>> from skyscatter import fields
    >>> outflow = fields.Cone(half_angle_deg=30, length=10)
    >>> round(float(outflow.column([-9, 0, 6], [9, 0, 6])), 3)  # m
    6.928
    >>> outflow.density([[0, 0, 6], [0, 0, -6]]).tolist()
    [1.0, 0.0]
    """

    kind: Literal["cone"] = "cone"
    half_angle_deg: HalfAngle
    length: PositiveMetres
    inner: NonNegativeMetres = default(0.0)
    exponent: float = 0.0
    both_sides: bool = False

    @model_validator(mode="after")
    def _check(self) -> Cone:
        if not 0 <= self.inner < self.length:
            raise DomainError("inner", self.inner, "must lie between 0 and the length")
        if self.exponent != 0 and self.inner == 0:
            raise DomainError("inner", self.inner, "must be above 0 where the density follows a power of the radius")
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes: on the axis, half-way between the radii."""
        height = 0.5 * (self.inner + self.length) * float(np.array(self.axes)[2])
        return np.array(self.position) + self.rotation @ [0.0, 0.0, height]

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        cosine = float(np.cos(np.radians(self.half_angle_deg)))
        parameters = (cosine, self.inner / self.length, self.exponent, float(self.both_sides))
        side = float(np.sin(np.radians(self.half_angle_deg)))
        reach = np.array([[-side, -side, -1.0 if self.both_sides else 0.0], [side, side, 1.0]])
        return Leaf(CONE, self.length, reach, 1.0, parameters)

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        cosine, inner, exponent, _ = self.leaf().parameters
        r_near, r_far = radii(low, high)
        near, far = radii(low[:, :2], high[:, :2])
        bottom, top = low[:, 2], high[:, 2]
        if self.both_sides:
            bottom, top = radii(low[:, 2:], high[:, 2:])
        # The cosine of the angle with the axis is largest at the top of a box, nearest to the axis if that is above
        # the tip, and farthest if below; smallest at the bottom, the other way round.  In the plane of the tip all
        # points but the tip, which counts as within, have the cosine 0.
        largest = _cosine(top, np.where(top >= 0, near, far))
        smallest = _cosine(bottom, np.where(bottom >= 0, far, near))
        meets = (largest >= cosine) & (r_near <= 1.0) & (r_far >= inner)
        inside = (smallest >= cosine) & (r_near >= inner) & (r_far <= 1.0)
        if exponent == 0.0:
            return inside.astype(float), meets.astype(float)
        falls = np.array([np.clip(r, inner, 1.0) / inner for r in (r_near, r_far)]) ** -exponent
        return np.where(inside, falls.min(axis=0), 0.0), np.where(meets, falls.max(axis=0), 0.0)


def _cosine(height: Array, distance: Array) -> Array:
    """Cosine of the angle with the axis, of the tip itself 1, a rounding error larger."""
    r = np.hypot(height, distance)
    return np.where(r > 0, height / np.where(r > 0, r, 1.0), 1.0)


class BipolarLobes(Shape):
    """Two ellipsoids that touch at `position`, along the own z axis, full or hollow: the lobes of an outflow.

    Parameters
    ----------
    length : length
        Of one lobe [m].
    width : length
        Of a lobe where it is widest, from side to side [m].
    hollow : float
        Size of the empty part of each over its own, about the same middle; from 0 (full) to below 1.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    Hollow lobes, 2 m long and 1 m wide, of which a tenth on either side is wall:

    >>> from skyscatter import fields
    >>> lobes = fields.BipolarLobes(length=2, width=1, hollow=0.8)
    >>> lobes.centre.tolist()  # the middle of the first lobe [m]
    [0.0, 0.0, 1.0]
    >>> round(float(lobes.column([-9, 0, 1], [9, 0, 1])), 3)  # m, across it
    0.2
    """

    kind: Literal["bipolar-lobes"] = "bipolar-lobes"
    length: PositiveMetres
    width: PositiveMetres
    hollow: Share = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> BipolarLobes:
        if not 0 <= self.hollow < 1:
            raise DomainError("hollow", self.hollow, "must lie from 0 to below 1")
        return self

    def _lobes(self) -> tuple[Shell, Shell]:
        half, slim = 0.5 * self.length, self.width / self.length
        own = np.array(self.axes)
        axes = (float(own[0]) * slim, float(own[1]) * slim, float(own[2]))
        shift = self.rotation @ np.array([0.0, 0.0, half * own[2]])
        lobes = [
            Shell(
                position=tuple(float(x) for x in np.array(self.position) + sign * shift),
                axis=self.axis, turn_deg=self.turn_deg, axes=axes, inner=self.hollow * half, outer=half,
            )
            for sign in (1.0, -1.0)
        ]  # fmt: skip
        return lobes[0], lobes[1]

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes: the middle of the first lobe."""
        return np.array(self._lobes()[0].position)

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        return tuple(term for lobe in self._lobes() for term in lobe.terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        (a, b), (c, d) = (lobe.extremes(low, high) for lobe in self._lobes())
        return a + c, b + d


class _Cuboid(Shape):
    """Density 1 within a box about `position`."""

    def _half_sizes(self) -> tuple[float, float, float]:
        raise NotImplementedError

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        return Leaf(BOX, self._half_sizes(), np.array([[-1.0], [1.0]]) * np.ones(3), 2.0)

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        inside = (low >= -1.0).all(axis=1) & (high <= 1.0).all(axis=1)
        meets = (low <= 1.0).all(axis=1) & (high >= -1.0).all(axis=1)
        return inside.astype(float), meets.astype(float)


class Box(_Cuboid):
    """Density 1 within a box.

    Parameters
    ----------
    half_sizes : three lengths
        From its middle to its faces along its own axes [m].

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    >>> from skyscatter import fields
    >>> room = fields.Box(half_sizes=("1 m", "2 m", "3 m"))
    >>> room.reference_column()  # m, along z
    6.0
    >>> round(float(room.column([-2, -2, -2], [2, 2, 2])), 3)  # m, obliquely through its middle
    3.464
    """

    kind: Literal["box"] = "box"
    half_sizes: Sizes

    def _half_sizes(self) -> tuple[float, float, float]:
        return self.half_sizes


class Slab(_Cuboid):
    """Density 1 nearer to the own plane z = 0 than the half thickness.

    Parameters
    ----------
    half_thickness : length
        [m].
    half_width : length, optional
        From the middle to its sides in x and y [m]; 1e4 half thicknesses, in place of none, when not given.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A layer of 2 m, seen vertically and at 60 degrees from its normal:

    >>> import math
    >>> from skyscatter import fields
    >>> layer = fields.Slab(half_thickness=1)
    >>> start = [[0, 0, 2], [-4 * math.sqrt(3), 0, 2]]
    >>> layer.column(start, [0, 0, -2]).round(3).tolist()  # m
    [2.0, 4.0]
    """

    kind: Literal["slab"] = "slab"
    half_thickness: PositiveMetres
    half_width: OptionalNumber[PositiveMetres] = default(None)

    def _half_sizes(self) -> tuple[float, float, float]:
        side = ENDLESS * self.half_thickness if self.half_width is None else self.half_width
        return side, side, self.half_thickness
