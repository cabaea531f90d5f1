"""Operations on density fields; each is a field again.

``a + b``, ``2 * a``, ``a * b``, ``a ** 2``, ``a.moved(...)``, ``a.rotated(...)``, ``a.scaled(...)``, ``a.carved_by(b)``
and ``a.warped(...)`` write the same records as files do.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import FRAMES, STACK, WARP, WARP_MODES
from skyscatter.media.filaments import Filament
from skyscatter.media.fronts import Front
from skyscatter.media.nebular import IonisedGas, Sampled
from skyscatter.media.particles import ParticleSet
from skyscatter.media.planets import AroundPlanet
from skyscatter.media.programs import carve_term, depths, map_boxes, map_term, multiply_terms, raise_terms, warp_term
from skyscatter.media.shapes import (
    BonnorEbert,
    GaussianShell,
    GaussianSphere,
    King,
    Plummer,
    PowerLaw,
    Shell,
    Sphere,
    axis_rotation,
)
from skyscatter.media.space import OPERATIONS, Array, FieldTerm, Instruction, SpatialField
from skyscatter.media.structures import BipolarLobes, Box, Cone, FlaredDisk, Slab
from skyscatter.media.turbulence import Turbulence, random_directions
from skyscatter.media.voxels import VoxelGrid
from skyscatter.registry import open_to
from skyscatter.units import Degrees, OptionalNumber, Place, PositiveMetres, PositiveNumber, Triple, default


def _bounded(terms: tuple[FieldTerm, ...], kind: str) -> tuple[FieldTerm, ...]:
    """The same terms, unless their programs are too deep for the kernels."""
    values, warps = np.max([depths(term.program) for term in terms], axis=0)
    if values > STACK or warps > FRAMES:
        allowed = f"holds operations within operations too deep: at most {STACK} values and {FRAMES} warps at one time"
        raise DomainError(kind, f"{values} values, {warps} warps", allowed)
    return terms


class _Mapped(SpatialField):
    """A field in other coordinates."""

    field: AnySpatialField

    def _map(self) -> tuple[Array, Array]:
        """Matrix (3, 3) and offset (3,) [m] that take a point of the field to where it comes to lie."""
        raise NotImplementedError

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes: the image of the field's."""
        matrix, offset = self._map()
        return matrix @ self.field.centre + offset

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        return tuple(map_term(term, *self._map()) for term in self.field.terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        matrix, offset = self._map()
        back = np.linalg.inv(matrix).astype(float)
        return self.field.extremes(*map_boxes(low, high, back, -back @ offset))


class Moved(_Mapped):
    """A field moved by a vector [m].

    Parameters
    ----------
    field : field
        What is moved.
    by : three lengths
        [m]

    Examples
    --------
    >>> from skyscatter import fields
    >>> cloud = fields.Sphere(radius="1 km").moved((0, 0, "5 km"))
    >>> type(cloud).__name__, cloud.centre.tolist()  # m
    ('Moved', [0.0, 0.0, 5000.0])
    >>> cloud.density([[0, 0, 0], [0, 0, 5500]]).tolist()
    [0.0, 1.0]
    """

    kind: Literal["move"] = "move"
    by: Place

    def _map(self) -> tuple[Array, Array]:
        return np.eye(3), np.array(self.by)


class Rotated(_Mapped):
    """A field turned about a point: about the z axis by `turn_deg`, then with z towards `axis` on the shortest way.

    Parameters
    ----------
    field : field
        What is turned.
    axis : three numbers
        Direction that its z axis takes, of any length.
    turn_deg : float
        Rotation about z before that [degree].
    about : three lengths
        Point that stays [m].

    Examples
    --------
    A layer that lies across z, turned so that it lies across x:

    >>> from skyscatter import fields
    >>> layer = fields.Slab(half_thickness=1, half_width=10)
    >>> wall = layer.rotated(axis=(1, 0, 0))
    >>> [round(float(field.column([0, 0, -50], [0, 0, 50])), 3) for field in (layer, wall)]  # m, along z
    [2.0, 20.0]
    """

    kind: Literal["rotate"] = "rotate"
    axis: Triple = default((0.0, 0.0, 1.0))
    turn_deg: Degrees = default(0.0)
    about: Place = default((0.0, 0.0, 0.0))

    @model_validator(mode="after")
    def _check(self) -> Rotated:
        if not np.linalg.norm(self.axis) > 0:
            raise DomainError("axis", self.axis, "must point somewhere: one of its numbers is not 0")
        return self

    def _map(self) -> tuple[Array, Array]:
        matrix = axis_rotation(self.axis, self.turn_deg)
        return matrix, np.array(self.about) - matrix @ np.array(self.about)


class Scaled(_Mapped):
    """A field stretched by factors along x, y and z about a point; its densities stay.

    Parameters
    ----------
    field : field
        What is stretched.
    factors : three numbers
        Along x, y and z, each above 0.
    about : three lengths
        Point that stays [m].

    Examples
    --------
    A ball stretched to a cigar.  The columns grow with it, the densities do not:

    >>> from skyscatter import fields
    >>> cigar = fields.Sphere(radius=1).scaled((1, 1, 3))
    >>> round(cigar.reference_column(), 3)  # m, along z
    6.0
    >>> float(cigar.density([0, 0, 2.9]))
    1.0
    """

    kind: Literal["scale"] = "scale"
    factors: Triple
    about: Place = default((0.0, 0.0, 0.0))

    @model_validator(mode="after")
    def _check(self) -> Scaled:
        if min(self.factors) <= 0:
            raise DomainError("factors", self.factors, "must be three factors above 0")
        return self

    def _map(self) -> tuple[Array, Array]:
        matrix = np.diag(self.factors)
        return matrix, np.array(self.about) - matrix @ np.array(self.about)


class Product(SpatialField):
    """Product of fields; the reference column goes through the centre of the first.

    Put the field that is quickest to compute first: where it is zero, the others are not asked.

    Parameters
    ----------
    fields : tuple of fields
        The factors; at least one.

    Examples
    --------
    A Gaussian cloud with a sharp edge at two widths: the column is sqrt(2 pi) erf(sqrt 2).

    >>> from skyscatter import fields
    >>> cloud = fields.Sphere(radius=2) * fields.GaussianSphere(width=1)
    >>> round(cloud.reference_column(), 3)  # m
    2.393
    >>> cloud.density([[0, 0, 0], [0, 0, 2.1]]).tolist()
    [1.0, 0.0]
    """

    kind: Literal["product"] = "product"
    fields: tuple[AnySpatialField, ...]

    @model_validator(mode="after")
    def _check(self) -> Product:
        if not self.fields:
            raise DomainError("fields", 0, "a product needs at least one field")
        if not self._terms():
            raise DomainError("fields", len(self.fields), "do not overlap: their product is zero everywhere")
        _bounded(self._terms(), self.kind)
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.fields[0].centre

    def _terms(self) -> tuple[FieldTerm, ...]:
        terms = self.fields[0].terms()
        for field in self.fields[1:]:
            pairs = [multiply_terms(a, b) for a in terms for b in field.terms()]
            terms = tuple(pair for pair in pairs if pair is not None)
        return terms

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels: products of the terms, one by one."""
        return self._terms()

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        lowest, highest = (bound.copy() for bound in self.fields[0].extremes(low, high))
        for field in self.fields[1:]:
            # Where there is nothing already, the others need not be bounded.
            some = highest > 0
            bounds = field.extremes(low[some], high[some])
            lowest[some] *= bounds[0]
            highest[some] *= bounds[1]
        return lowest, highest


class Sum(SpatialField):
    """Weighted sum of fields, exactly linear; the reference column goes through the centre of the first.

    Parameters
    ----------
    fields : tuple of fields
        The summands; at least one.
    factors : tuple of float, optional
        One for each, 0 or above; all 1 when not given.

    Examples
    --------
    A cloud with a denser core:

    >>> from skyscatter import fields
    >>> cloud = fields.Sphere(radius=2) + 3 * fields.Sphere(radius=1)
    >>> cloud.factors
    (1.0, 3.0)
    >>> cloud.density([[0, 0, 0], [0, 0, 1.5]]).tolist()
    [4.0, 1.0]
    >>> round(cloud.reference_column(), 3)  # m, 4 + 3 x 2
    10.0
    """

    kind: Literal["sum"] = "sum"
    fields: tuple[AnySpatialField, ...]
    factors: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Sum:
        if not self.fields:
            raise DomainError("fields", 0, "a sum needs at least one field")
        if self.factors is not None and len(self.factors) != len(self.fields):
            raise DomainError("factors", len(self.factors), f"give one for each of the {len(self.fields)} fields")
        if min(self._weights()) < 0:
            raise DomainError("factors", min(self._weights()), "must be 0 or above; densities are not negative")
        return self

    def _weights(self) -> tuple[float, ...]:
        return (1.0,) * len(self.fields) if self.factors is None else self.factors

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.fields[0].centre

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        pairs = zip(self.fields, self._weights(), strict=True)
        return tuple(term._replace(factor=term.factor * weight) for field, weight in pairs for term in field.terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        bounds = np.array([field.extremes(low, high) for field in self.fields])
        lowest, highest = np.tensordot(self._weights(), bounds, axes=1)
        return lowest, highest


class Carved(SpatialField):
    """A field with another cut out of it.

    Parameters
    ----------
    field : field
        a.
    by : field
        b.
    level : float, optional
        The density is a where b is below the level, and zero elsewhere; when not given it is a max(1 - b, 0).

    Examples
    --------
    A ball with a hollow, and a Gaussian cloud of which only the outskirts are left:

    >>> from skyscatter import fields
    >>> ball = fields.Sphere(radius=2).carved_by(fields.Sphere(radius=1))
    >>> round(ball.reference_column(), 3)  # m
    2.0
    >>> cloud = fields.GaussianSphere(width=1)
    >>> cloud.carved_by(cloud, level=0.5).density([[0, 0, 1], [0, 0, 2]]).round(3).tolist()
    [0.0, 0.135]
    """

    kind: Literal["carve"] = "carve"
    field: AnySpatialField
    by: AnySpatialField
    level: OptionalNumber[PositiveNumber] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Carved:
        _bounded(self.terms(), self.kind)
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.field.centre

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        carver = self.by.terms()
        return tuple(carve_term(term, carver, self.level) for term in self.field.terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        (lowest, highest), (b_low, b_high) = self.field.extremes(low, high), self.by.extremes(low, high)
        if self.level is None:
            return lowest * np.maximum(1 - b_high, 0), highest * np.maximum(1 - b_low, 0)
        return np.where(b_high < self.level, lowest, 0.0), np.where(b_low < self.level, highest, 0.0)


class Power(SpatialField):
    """A power of a field's density, such as the square that recombination lines follow.

    Parameters
    ----------
    field : field
        What is raised.
    exponent : float
        Above 0.

    Examples
    --------
    The square of the density, as hydrogen lines follow it, is narrower by sqrt(2) for a Gaussian cloud:

    >>> from skyscatter import fields
    >>> cloud = fields.GaussianSphere(width=1)
    >>> round((cloud**2).reference_column() / cloud.reference_column(), 3)
    0.707
    """

    kind: Literal["power"] = "power"
    field: AnySpatialField
    exponent: PositiveNumber

    @model_validator(mode="after")
    def _check(self) -> Power:
        _bounded(self.terms(), self.kind)
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.field.centre

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        return raise_terms(self.field.terms(), self.exponent)

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        lowest, highest = self.field.extremes(low, high)
        return lowest**self.exponent, highest**self.exponent


@lru_cache(maxsize=32)
def warp_modes(seed: int) -> Array:
    """Modes (3, 8, 4) of a smooth vector noise: wave vector in turns per scale, and phase in turns."""
    random = np.random.default_rng(seed)
    count = 3 * WARP_MODES
    k = 2.0 ** random.random(count)
    vectors = k[:, None] * random_directions(random, count)
    return np.column_stack([vectors, random.random(count)]).reshape(3, WARP_MODES, 4)


class Warped(SpatialField):
    """A field seen through displaced coordinates: the density at x is the field's at x + v(x).

    Each component of v is a sum of 8 random waves between half the scale and the scale.

    Parameters
    ----------
    field : field
        What is seen through them.
    amplitude : length
        Root mean square of each component of v [m]; none is ever above 4 times that.
    scale : length
        Longest wave of v [m].
    seed : int
        Of the waves.

    Examples
    --------
    A ball of 1 m with a ragged edge: nothing moves by more than 0.4 m along an axis, and on the old edge a share of the
    points is still inside.

    >>> import numpy as np
    >>> from skyscatter import fields
    >>> ball = fields.Sphere(radius=1).warped(amplitude="10 cm", scale="1 m")
    >>> angle = np.linspace(0, 2 * np.pi, 360)
    >>> circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    >>> [round(float(ball.density(radius * circle).mean()), 1) for radius in (0.5, 1.0, 1.5)]
    [1.0, 0.4, 0.0]
    """

    kind: Literal["warp"] = "warp"
    field: AnySpatialField
    amplitude: PositiveMetres
    scale: PositiveMetres
    seed: int = 0

    @model_validator(mode="after")
    def _check(self) -> Warped:
        if self.seed < 0:
            raise DomainError("seed", self.seed, "must be 0 or above")
        _bounded(self.terms(), self.kind)
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.field.centre

    @property
    def _wave(self) -> float:
        """Amplitude of one wave [m]: `WARP_MODES` of them add to the root mean square asked for."""
        return self.amplitude * float(np.sqrt(2 / WARP_MODES))

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        affine = np.column_stack([np.eye(3) / self.scale, np.zeros(3)])
        modes = warp_modes(self.seed)
        step = Instruction(WARP, affine, (self._wave / self.scale, *modes.ravel()))
        reach = WARP_MODES * self._wave
        return tuple(warp_term(term, step, reach, 0.5 * self.scale) for term in self.field.terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`.

        The displacement of a box is that of its middle, and what the waves can change from there to a corner.
        """
        modes = warp_modes(self.seed)
        middle, half = 0.5 * (low + high) / self.scale, 0.5 * (high - low) / self.scale
        shift, change = np.empty_like(low), np.empty_like(low)
        for i in range(3):
            k, phase = modes[i, :, :3], modes[i, :, 3]
            shift[:, i] = self._wave * np.cos(2 * np.pi * (middle @ k.T + phase)).sum(axis=1)
            change[:, i] = self._wave * np.minimum(2 * np.pi * half @ np.abs(k).T, 2.0).sum(axis=1)
        # A rounding error more than that, and more than the error of the kernel's cosine.
        change += 1e-8 * self._wave
        return self.field.extremes(low + shift - change, high + shift + change)


def sum_of(a: SpatialField, b: SpatialField) -> Sum:
    """A + b, sums in one level."""
    parts = [(x.fields, x._weights()) if isinstance(x, Sum) else ((x,), (1.0,)) for x in (a, b)]
    return Sum(fields=parts[0][0] + parts[1][0], factors=parts[0][1] + parts[1][1])


def multiple_of(a: SpatialField, factor: float) -> Sum:
    """Factor a."""
    fields, weights = (a.fields, a._weights()) if isinstance(a, Sum) else ((a,), (1.0,))
    return Sum(fields=fields, factors=tuple(factor * weight for weight in weights))


def product_of(a: SpatialField, b: SpatialField) -> Product:
    """A b, products in one level."""
    return Product(fields=tuple(part for x in (a, b) for part in (x.fields if isinstance(x, Product) else (x,))))


#: Every field of three dimensions that a file can name.
Spatial = (
    Sphere | GaussianSphere | Plummer | King | PowerLaw | BonnorEbert | Shell | GaussianShell
    | FlaredDisk | Cone | BipolarLobes | Slab | Box | Filament | Turbulence | Front | AroundPlanet
    | VoxelGrid | ParticleSet
    | Moved | Rotated | Scaled | Product | Sum | Carved | Power | Warped | IonisedGas | Sampled
)  # fmt: skip
AnySpatialField = Annotated[Spatial, Field(discriminator="kind"), *open_to(SpatialField)]

for _record in (Moved, Rotated, Scaled, Product, Sum, Carved, Power, Warped, IonisedGas, Sampled):
    _record.model_rebuild(_types_namespace={"AnySpatialField": AnySpatialField})

OPERATIONS.update(
    sum=sum_of, multiple=multiple_of, product=product_of, power=Power, moved=Moved, rotated=Rotated, scaled=Scaled,
    carved=Carved, warped=Warped,
)  # fmt: skip
