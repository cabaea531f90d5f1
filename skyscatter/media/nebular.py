"""Gas inside and outside the ionisation fronts of hot stars, and fields kept as voxels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, reduce
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.media.fronts import Front
from skyscatter.media.shapes import axis_rotation, require_positive
from skyscatter.media.space import Array, FieldTerm, SpatialField
from skyscatter.media.voxels import VoxelGrid
from skyscatter.record import Record
from skyscatter.units import (
    Degrees,
    Kelvin,
    Luminosity,
    NonNegativeMetres,
    NumberDensity,
    OptionalNumber,
    OptionalTriple,
    PhotonRate,
    Place,
    default,
)

if TYPE_CHECKING:
    from skyscatter.media.ionised import UsedUp
    from skyscatter.media.operations import AnySpatialField

#: Widest cone about the gas in which a star outside it looks for fronts; beyond, it looks all around.
_WIDEST_CONE = np.radians(85.0)
_STEPS = 64  #: stretches of a ray to begin with


class IonisingSource(Record):
    """A star as ionised gas sees it: give `ionising_photons`, or both `temperature` and `luminosity`.

    Parameters
    ----------
    position : three lengths
        In the model's frame [m].
    ionising_photons : float, optional
        Q, photons beyond 13.6 eV sent out in all directions [s-1].
    temperature : float, optional
        Of a black body [K].
    luminosity : float, optional
        Its bolometric luminosity [nominal solar luminosities].

    Examples
    --------
    A star of type O, from its temperature and luminosity:

    >>> from skyscatter import fields
    >>> star = fields.IonisingSource(temperature="40000 K", luminosity=2e5)
    >>> f"{star.photons:.1e}"  # s-1
    '1.1e+49'
    """

    position: Place = default((0.0, 0.0, 0.0))
    ionising_photons: OptionalNumber[PhotonRate] = default(None)
    temperature: OptionalNumber[Kelvin] = default(None)
    luminosity: OptionalNumber[Luminosity] = default(None)

    @model_validator(mode="after")
    def _check(self) -> IonisingSource:
        black = (self.temperature is not None, self.luminosity is not None)
        if any(black) != all(black) or any(black) == (self.ionising_photons is not None):
            rule = "give either ionising_photons, or temperature and luminosity"
            raise DomainError("ionising_photons", self.ionising_photons, rule)
        return self

    @property
    def photons(self) -> float:
        """Q [s-1]."""
        from skyscatter.constants import SOLAR_LUMINOSITY
        from skyscatter.media.ionised import ionising_photons

        if self.ionising_photons is not None:
            return self.ionising_photons
        power = (self.luminosity or 0.0) * SOLAR_LUMINOSITY
        return ionising_photons(self.temperature or 0.0, luminosity_W=power)


class IonisedGas(SpatialField):
    """A power of a gas density inside the ionisation fronts of stars, or outside of them.

    Along every direction a star ionises the gas out to where recombinations (case B) use up its photons; behind that
    the gas lies in the shadow (`skyscatter.media.ionised`).  Of several stars the union of what each would ionise alone
    counts, 1 - (1 - F1) (1 - F2) ...: an approximation where fronts overlap, for there the stars share the work and
    would reach farther.  Put stars that stand close together into one source.

    With `power` 2 the field is what `GasLines` takes, n_e n_p relative to hydrogen_density^2, and its integral times
    alpha_B hydrogen_density^2 is the photons of a star whose fronts lie within the gas (for an edge narrow against the
    front's radius).  In the edge the emission measure, not the ionised share, falls as the error function does.

    Parameters
    ----------
    gas : field
        Density of hydrogen, ionised or not, relative to `hydrogen_density`.
    hydrogen_density : float
        Hydrogen nuclei per volume where the gas field is 1 [m-3].
    sources : tuple of IonisingSource
        The stars that ionise; at least one.
    front_width : length
        Standard deviation of the fronts' smooth edges [m]; 0 is sharp.
    power : {2, 1}
        2 for the emission measure, 1 for the density.
    inverse : bool
        The gas that stays neutral instead.
    layer : (float, float)
        Only the gas between the surfaces at which these shares of a star's photons are used up: (0, 1) is all that is
        ionised.  Ions that need hard light live in the first part, those that shun it, N+ and S+, in the last.
    gas_temperature : float
        Of the electrons [K], 3000 to 30000.
    resolution_deg : float
        Angle between the directions in which fronts are sought, bilinear between them.  For a star outside the gas they
        fill a cone about it, else all directions.
    tolerance : float
        Error allowed in the photons used up along a direction, relative to all of them.

    Examples
    --------
    Around a star in uniform gas the front is Stroemgren's sphere, here of 3.15 pc in radius:

    >>> from skyscatter import fields
    >>> star = fields.IonisingSource(ionising_photons=1e49)
    >>> cloud = fields.Sphere(radius="5 pc")
    >>> gas = fields.IonisedGas(gas=cloud, hydrogen_density="100 cm-3", sources=(star,), resolution_deg=30)
    >>> parsec = 3.0857e16
    >>> round(gas.fronts()[0].radii[0][0] / parsec, 2)
    3.15
    >>> gas.density([[0, 0, 3 * parsec], [0, 0, 4 * parsec]]).tolist()
    [1.0, 0.0]
    """

    kind: Literal["ionised"] = "ionised"
    gas: AnySpatialField
    hydrogen_density: NumberDensity
    sources: tuple[IonisingSource, ...]
    front_width: NonNegativeMetres = default(0.0)
    power: Literal[1, 2] = 2
    inverse: bool = False
    layer: tuple[float, float] = (0.0, 1.0)
    gas_temperature: Kelvin = default(1e4)
    resolution_deg: Degrees = default(3.0)
    tolerance: float = 1e-4

    @model_validator(mode="after")
    def _check(self) -> IonisedGas:
        from skyscatter.optics.lines import check_temperature

        require_positive(self, "hydrogen_density", "tolerance")
        check_temperature(self.gas_temperature)
        if not self.sources:
            raise DomainError("sources", 0, "ionised gas needs at least one source")
        if not 0 <= self.layer[0] < self.layer[1] <= 1:
            raise DomainError("layer", self.layer, "must be two shares of the photons, 0 <= first < second <= 1")
        if self.inverse and self.layer != (0.0, 1.0):
            raise DomainError("layer", self.layer, "goes with ionised gas; leave it or inverse out")
        if not 0.05 <= self.resolution_deg <= 30:
            raise DomainError("resolution_deg", self.resolution_deg, "must lie from 0.05 to 30 degrees")
        return self

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return self.gas.centre

    def fronts(self, share: float = 1.0) -> tuple[Front, ...]:
        """Where each source alone has used up a share of its photons; kept between calls."""
        same = {"power": 2, "inverse": False, "layer": (0.0, 1.0)}
        return _fronts(self.model_copy(update=same), share)

    def _zones(self) -> list[tuple[Front, ...]]:
        """Of each source its outer surface and, if the layer has one, its inner one."""
        pairs = [self.fronts(share) for share in self.layer[::-1] if share > 0]
        return list(zip(*pairs, strict=True))

    def _body(self) -> SpatialField:
        return self.gas**2 if self.power == 2 else self.gas

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels: a term for each front, less what the earlier ones hold."""
        zones: list[SpatialField] = [_without(outer, inner) for outer, *inner in self._zones()]
        if self.inverse:
            return _without(self._body(), zones).terms()
        parts = [_without(zone, zones[:i]) for i, zone in enumerate(zones)]
        return tuple(term for part in parts for term in (part * self._body()).terms())

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        least, most = self._body().extremes(low, high)
        bounds = np.array([_without(outer, inner).extremes(low, high) for outer, *inner in self._zones()])
        dark_most, dark_least = np.prod(1.0 - bounds, axis=0)
        if self.inverse:
            return least * dark_least, most * dark_most
        return least * (1.0 - dark_most), most * (1.0 - dark_least)


def _without(field: SpatialField, others: Sequence[SpatialField]) -> SpatialField:
    """A field times what each of the others lacks to 1."""
    return reduce(lambda a, b: a.carved_by(b), others, field)


@lru_cache(maxsize=8)
def _fronts(field: IonisedGas, share: float) -> tuple[Front, ...]:
    return tuple(_front(field, source, share) for source in field.sources)


def _front(field: IonisedGas, source: IonisingSource, share: float) -> Front:
    """Where one source has used up a share of its photons."""
    table = _directions(field, source)
    found = _used_up(field, source).radii(share).reshape(table.rows, table.columns)
    # All columns of a pole are one direction; rounding may tell them apart.
    found[0] = found[0, 0]
    if table.opening == np.pi:
        found[-1] = found[-1, 0]
    return Front(
        position=source.position,
        axis=table.axis,
        radii=tuple(tuple(row) for row in found.tolist()),
        width=field.front_width,
        opening_deg=float(np.degrees(table.opening)),
    )


@lru_cache(maxsize=2)  # the layers of a nebula ask one after the other, and a few of these are much memory
def _used_up(field: IonisedGas, source: IonisingSource) -> UsedUp:
    """The source's photons along its table of directions."""
    from skyscatter.media.ionised import used_up

    table = _directions(field, source)
    return used_up(
        field.gas.density, source.position, table.directions, hydrogen_density=field.hydrogen_density,
        ionising_photons=source.photons, limit=table.limit, temperature=field.gas_temperature, steps=_STEPS,
        tolerance=field.tolerance,
    )  # fmt: skip


class _Directions(NamedTuple):
    """A table of directions, rows over the polar angle about the axis and columns over the azimuth."""

    axis: tuple[float, float, float]
    opening: float  #: polar angle of the last row
    rows: int
    columns: int
    directions: Array  #: (rows x columns, 3)
    limit: float  #: distance of the gas's farthest corner [m]


def _directions(field: IonisedGas, source: IonisingSource) -> _Directions:
    """Directions all around a source, or in a cone about the gas."""
    low, high = field.gas.bounds
    star = np.array(source.position)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T - star
    axis, opening = _cone(low - star, high - star, corners)
    step = np.radians(field.resolution_deg)
    rows = max(int(np.ceil(opening / step)), 4) + 1
    columns = max(int(np.ceil(2 * np.pi * np.sin(min(opening, np.pi / 2)) / step)), 8)
    nodes = opening * np.arange(rows) / (rows - 1), 2 * np.pi * np.arange(columns) / columns
    theta, phi = np.meshgrid(*nodes, indexing="ij")
    own = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    turned = own.reshape(-1, 3) @ axis_rotation(axis, 0.0).T
    return _Directions(axis, opening, rows, columns, turned, float(np.linalg.norm(corners, axis=1).max()))


def _cone(low: Array, high: Array, corners: Array) -> tuple[tuple[float, float, float], float]:
    """Axis and half angle of the cone about a box seen from the origin; all directions if it is inside or near."""
    if not ((low > 0) | (high < 0)).any():
        return (0.0, 0.0, 1.0), float(np.pi)
    middle = 0.5 * (low + high)
    cosines = corners @ middle / (np.linalg.norm(corners, axis=1) * np.linalg.norm(middle))
    # A box lies within the convex cone that its corners lie in; a little more, so that rims stay off its edges.
    angle = 1.02 * float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
    if angle > _WIDEST_CONE:
        return (0.0, 0.0, 1.0), float(np.pi)
    x, y, z = (float(v) for v in middle / np.linalg.norm(middle))
    return (x, y, z), angle


class Sampled(SpatialField):
    """Any field kept as voxels, made when first needed: quick where a product of many shapes is slow.

    The density at the middles of cells is the field's own and trilinear between them, so a smooth field is met with an
    error that falls as the square of the cell's side; a jump is spread over one cell.

    Parameters
    ----------
    field : field
        What is sampled.
    cells : int or (int, int, int)
        Along the longest side, the cells being about cubes; or along each axis.
    low, high : (length, length, length), optional
        Corners of what is kept [m]; the field's own when not given.
    edge : {"falling", "sharp"}
        What happens beyond the outermost cells; see `VoxelGrid`.

    Examples
    --------
    The largest error along a line through the cloud falls fourfold where there are twice as many cells along a side:

    >>> import numpy as np
    >>> from skyscatter import fields
    >>> cloud = fields.GaussianSphere(width=1)
    >>> points = np.linspace([0, 0, 0], [3, 2, 1], 200)
    >>> for cells in (32, 64):
    ...     kept = fields.Sampled(field=cloud, cells=cells)
    ...     print(kept.grid().cube.shape, f"{np.abs(kept.density(points) - cloud.density(points)).max():.0%}")
    (32, 32, 32) 5%
    (64, 64, 64) 1%
    """

    kind: Literal["sampled"] = "sampled"
    field: AnySpatialField
    cells: int | tuple[int, int, int] = 128
    low: OptionalTriple[Place] = default(None)
    high: OptionalTriple[Place] = default(None)
    edge: Literal["falling", "sharp"] = "falling"

    @model_validator(mode="after")
    def _check(self) -> Sampled:
        if not 2 <= np.min(self.cells) <= np.max(self.cells) <= 1024:
            raise DomainError("cells", self.cells, "must lie from 2 to 1024 along a side")
        if (self.low is None) != (self.high is None):
            raise DomainError("low", self.low, "give both low and high, or neither")
        corners = zip(self.low or (), self.high or (), strict=True)
        if not all(a < b for a, b in corners):
            raise DomainError("high", self.high, f"must lie above low = {self.low} along every axis")
        return self

    def grid(self) -> VoxelGrid:
        """The voxels; kept between calls."""
        return _sampled(self)

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes: that of the field itself."""
        return self.field.centre

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        return self.grid().terms()

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        return self.grid().extremes(low, high)


@lru_cache(maxsize=8)
def _sampled(field: Sampled) -> VoxelGrid:
    return VoxelGrid.from_field(field.field, field.cells, field.low, field.high, edge=field.edge)
