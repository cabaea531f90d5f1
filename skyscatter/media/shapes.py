"""Analytic density fields in three dimensions."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.media.space import Array, FieldTerm, Instruction, SpatialField
from skyscatter.units import Metres

# The kinds of `kernels.space`, repeated as plain numbers so that describing a field does not load the compiler.
SPHERE, GAUSSIAN_SPHERE = 0, 1
CLOSED_FORM = 0


class _Round(SpatialField):
    """A field that depends on the distance from its centre alone."""

    position: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)

    def _affine(self, length: float) -> Array:
        return np.hstack([np.eye(3), -np.array(self.position)[:, None]]) / length

    def _box(self, radius: float) -> Array:
        return np.array(self.position) + np.array([[-radius], [radius]]) * np.ones(3)

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]; never rising."""
        raise NotImplementedError

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        centre = np.array(self.position)
        near = np.linalg.norm(np.maximum(np.maximum(low - centre, centre - high), 0.0), axis=1)
        far = np.linalg.norm(np.maximum(np.abs(low - centre), np.abs(high - centre)), axis=1)
        return self.profile(far), self.profile(near)


class Sphere(_Round):
    """Density 1 within a radius."""

    kind: Literal["sphere"] = "sphere"
    radius: Metres

    @model_validator(mode="after")
    def _check(self) -> Sphere:
        if not self.radius > 0:
            raise DomainError("radius", self.radius, "must be a positive length")
        return self

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        return np.where(radius <= self.radius, 1.0, 0.0)

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        leaf = Instruction(SPHERE, self._affine(self.radius))
        return (FieldTerm((leaf,), CLOSED_FORM, 1.0, self._box(self.radius), self.radius),)


class GaussianSphere(_Round):
    """exp(-r^2 / 2 width^2), cut where it has fallen below 1e-8 of the middle."""

    kind: Literal["gaussian-sphere"] = "gaussian-sphere"
    width: Metres

    @model_validator(mode="after")
    def _check(self) -> GaussianSphere:
        if not self.width > 0:
            raise DomainError("width", self.width, "must be a positive length")
        return self

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        return np.exp(-0.5 * (radius / self.width) ** 2)

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        leaf = Instruction(GAUSSIAN_SPHERE, self._affine(self.width))
        return (FieldTerm((leaf,), CLOSED_FORM, 1.0, self._box(6.07 * self.width), self.width),)
