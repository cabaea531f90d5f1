"""Density fields of spherical symmetry: dimensionless density over altitude.

A field says how much of something there is relative to a reference of 1; the optical model of its component says what
one unit of it does per metre.  Every field has a top above which there is nothing, a closed-form vertical column, and
a row in the kernels' `FieldTable`.  A new field is one class here and one branch in `kernels.columns`.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter import units
from skyscatter.errors import DomainError
from skyscatter.kernels.codes.shells import CHAPMAN, EXPONENTIAL, GAUSSIAN, LINEAR, LOGARITHMIC, FieldRow
from skyscatter.record import Record
from skyscatter.registry import contract, open_to
from skyscatter.tablefile import TableRecord, Wanted
from skyscatter.units import Altitudes, Densities, Metres, NonNegativeMetres, OptionalNumber, PositiveMetres, default


@contract
class DensityField(Record):
    """Dimensionless density as a function of altitude above the planet's radius."""

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        raise NotImplementedError

    @property
    def top_altitude(self) -> float:
        """Altitude above which the density is zero [m]."""
        return self.row().top

    def density(self, altitude: ArrayLike) -> NDArray[np.float64]:
        """Density at altitudes [m]; dimensionless, shape of the input."""
        return self._evaluate(altitude, "density")

    def vertical_column(self, altitude: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Column from altitudes [m] straight up to the top [m of unit density], shape of the input."""
        return self._evaluate(altitude, "vertical_column")

    def reference_column(self) -> float:
        """Vertical column above the ground [m of unit density], by which optical depths are meant."""
        return float(self.vertical_column(0.0))

    def _evaluate(self, altitude: ArrayLike, function: str) -> NDArray[np.float64]:
        from skyscatter.kernels import columns
        from skyscatter.media.tables import pack_rows

        table = pack_rows([self.row()], radius=1e7)
        h = np.asarray(altitude, float)
        values = [getattr(columns, function)(table, 0, x) for x in h.ravel()]
        return np.array(values, float).reshape(h.shape)


class Exponential(DensityField):
    """exp(-h / H): density 1 on the ground, falling by e every scale height.

    Parameters
    ----------
    scale_height : length
        H [m].
    top : length, optional
        Altitude where the shell ends [m]; 16 scale heights (density 1e-7) when not given.
    """

    kind: Literal["exponential"] = "exponential"
    scale_height: PositiveMetres
    top: OptionalNumber[PositiveMetres] = default(None)

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        top = 16 * self.scale_height if self.top is None else self.top
        return FieldRow(EXPONENTIAL, (self.scale_height,), top, (), (), (top,))


class Uniform(DensityField):
    """Density 1 between two altitudes: a slab, or a shell of fog.

    Parameters
    ----------
    base, top : length
        Altitudes between which the density is 1 [m]; the base lies below the top.
    """

    kind: Literal["uniform"] = "uniform"
    base: NonNegativeMetres = default(0.0)
    top: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> Uniform:
        if not 0 <= self.base < self.top:
            raise DomainError("base", self.base, "must lie between 0 and the top")
        return self

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        return FieldRow(LINEAR, (), self.top, (self.base, self.top), (1.0, 1.0), (self.base, self.top))


class Tent(DensityField):
    """Rising linearly from `base` to 1 at `peak`, falling linearly to `top`: the plainest ozone layer.

    Parameters
    ----------
    base, peak, top : length
        Altitudes of the foot, of the tip, where the density is 1, and of the upper end [m]; they rise.
    """

    kind: Literal["tent"] = "tent"
    base: NonNegativeMetres
    peak: PositiveMetres
    top: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> Tent:
        if not 0 <= self.base < self.peak < self.top:
            raise DomainError("peak", self.peak, "needs 0 <= base < peak < top")
        return self

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        nodes = (self.base, self.peak, self.top)
        return FieldRow(LINEAR, (), self.top, nodes, (0.0, 1.0, 0.0), nodes)


class Gaussian(DensityField):
    """exp(-(h - peak)^2 / 2 width^2), cut at `top` (6 widths above the peak when not given) and at the ground.

    Parameters
    ----------
    peak : length
        Altitude where the density is 1 [m].
    width : length
        Standard deviation [m].
    top : length, optional
        Altitude above which there is nothing [m]; 6 widths above the peak when not given.
    """

    kind: Literal["gaussian"] = "gaussian"
    peak: Metres
    width: PositiveMetres
    top: OptionalNumber[PositiveMetres] = default(None)

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        top = self.peak + 6 * self.width if self.top is None else self.top
        return FieldRow(GAUSSIAN, (self.peak, self.width), top, (), (), (top,))


class ChapmanLayer(DensityField):
    """exp(1 - z - exp(-z)) with z = (h - peak) / H: a layer made by sunlight in an exponential atmosphere.

    Chapman (1931), Proc. Phys. Soc. 43, 26, for the Sun in the zenith; 1 at the peak.

    Parameters
    ----------
    peak : length
        Altitude where the density is 1 [m].
    scale_height : length
        H [m].
    top : length, optional
        Altitude above which there is nothing [m]; 16 scale heights above the peak when not given.
    """

    kind: Literal["chapman"] = "chapman"
    peak: Metres
    scale_height: PositiveMetres
    top: OptionalNumber[PositiveMetres] = default(None)

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        top = self.peak + 16 * self.scale_height if self.top is None else self.top
        return FieldRow(CHAPMAN, (self.peak, self.scale_height), top, (), (), (top,))


class Tabulated(TableRecord, DensityField):
    """A profile given at altitudes, interpolated in the density or in its logarithm; nothing outside the nodes.

    Parameters
    ----------
    altitudes : tuple of length
        Rising altitudes of the nodes [m].
    densities : tuple of float
        Density at the nodes, never negative (positive for logarithmic interpolation).
    interpolation : {"logarithmic", "linear"}
        Of the logarithm of the density, or of the density itself.
    file : str, optional
        CSV or netCDF file with the columns instead, such as ``altitude [km],density``; in a model file the path counts
        from its folder.
    column : str, optional
        Which column of the file has the densities, where there are several.
    """

    columns: ClassVar[dict[str, Wanted]] = {
        "altitudes": Wanted(("altitude", "height", "z"), units.LENGTH.within(0.0), rising=True),
        "densities": Wanted(("density",), units.RELATIVE_AMOUNT),
    }

    kind: Literal["tabulated"] = "tabulated"
    altitudes: Altitudes
    densities: Densities
    interpolation: Literal["logarithmic", "linear"] = "logarithmic"

    @model_validator(mode="after")
    def _check(self) -> Tabulated:
        if len(self.altitudes) != len(self.densities) or len(self.altitudes) < 2:
            raise DomainError("altitudes", len(self.altitudes), "needs at least 2 nodes, as many as densities")
        if np.any(np.diff(self.altitudes) <= 0) or self.altitudes[0] < 0:
            raise DomainError("altitudes", self.altitudes, "must start at or above 0 and increase")
        if min(self.densities) < 0 or max(self.densities) <= 0:
            raise DomainError("densities", min(self.densities), "a density is never negative, nor zero everywhere")
        if self.interpolation == "logarithmic" and min(self.densities) <= 0:
            raise DomainError("densities", min(self.densities), 'must be positive, or set interpolation = "linear"')
        return self

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        kind = LINEAR if self.interpolation == "linear" else LOGARITHMIC
        kinks = _kinks(kind, np.asarray(self.altitudes), np.asarray(self.densities))
        return FieldRow(kind, (), self.altitudes[-1], self.altitudes, self.densities, kinks)


def _kinks(kind: int, h: NDArray[np.float64], n: NDArray[np.float64]) -> tuple[float, ...]:
    """Nodes at which quadrature must stop: both ends, and those where the slope changes so much that it shows.

    A change of the slope by s over a cell of height d bends the density by about s d; below 2 % of the density there,
    as in finely tabulated profiles, rules that step over a node still see a smooth curve.
    """
    curve = n if kind == LINEAR else np.log(n)
    change = np.abs(np.diff(np.diff(curve) / np.diff(h))) * np.minimum(np.diff(h)[1:], np.diff(h)[:-1])
    scale = np.maximum(n[1:-1], 1e-6 * n.max()) if kind == LINEAR else np.ones(n.size - 2)
    return (float(h[0]), *(float(x) for x in h[1:-1][change > 0.02 * scale]), float(h[-1]))


class UsStandard1976(DensityField):
    """Air of the U.S. Standard Atmosphere 1976 (NOAA-S/T 76-1562): number density relative to the ground's."""

    kind: Literal["us-standard-1976"] = "us-standard-1976"

    def row(self) -> FieldRow:
        """The field as data for the kernels."""
        from skyscatter.datafiles import read_table

        table = read_table("ussa1976.csv")
        altitudes = tuple(float(h) for h in table["altitude"])
        number = table["number_density"]
        relative = number / number[0]
        kinks = _kinks(LOGARITHMIC, table["altitude"], relative)
        return FieldRow(LOGARITHMIC, (), altitudes[-1], altitudes, tuple(relative), kinks)


Profile = Exponential | Uniform | Tent | Gaussian | ChapmanLayer | Tabulated | UsStandard1976
AnyField = Annotated[Profile, Field(discriminator="kind"), *open_to(DensityField)]
