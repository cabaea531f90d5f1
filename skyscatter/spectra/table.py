"""A number that may depend on wavelength."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, WithJsonSchema, model_validator
from pydantic_core import CoreSchema, core_schema

from skyscatter import units
from skyscatter.errors import DomainError
from skyscatter.record import nearest
from skyscatter.tablefile import TableRecord, Wanted, with_columns
from skyscatter.units import Measure, Numbers, OptionalNumber, Wavelengths

if TYPE_CHECKING:
    from skyscatter.units import Amount, Given

_WAVELENGTH = Wanted(("wavelength", "wl", "lambda"), units.WAVELENGTH.within(0.0, above=True), rising=True)


class SpectralTable(TableRecord):
    """Values over vacuum wavelength [nm], linear between the nodes and constant beyond the ends.

    Parameters
    ----------
    wavelengths : tuple of float, shape (wavelength,)
        Rising, above 0 [nm].
    values : tuple of float, shape (wavelength,)
        In the unit of the field that the table stands for.
    file : str, optional
        CSV or netCDF file with the columns instead; in a model file the path counts from its folder.
    column : str, optional
        Which column of the file has the values, where there are several.

    Examples
    --------
    >>> import skyscatter
    >>> soil = skyscatter.SpectralTable(wavelengths=(400, 700), values=(0.1, 0.4))
    >>> skyscatter.Ground(albedo=soil).reflectance([350, 550, 700]).round(2)  # constant beyond the ends
    array([0.1 , 0.25, 0.4 ])
    """

    columns: ClassVar[dict[str, Wanted]] = {"wavelengths": _WAVELENGTH, "values": Wanted(("value",), units.RELATIVE)}

    wavelengths: Wavelengths
    values: Annotated[Numbers, WithJsonSchema({"type": "array", "items": {"type": ["number", "string"]}})]

    @model_validator(mode="after")
    def _check(self) -> SpectralTable:
        if len(self.wavelengths) != len(self.values) or len(self.values) == 0:
            counts = f"{len(self.wavelengths)} wavelengths, {len(self.values)} values"
            raise DomainError("values", counts, "wavelengths and values need the same length, at least 1")
        if np.any(np.diff(self.wavelengths) <= 0):
            raise DomainError("wavelengths", self.wavelengths, "wavelengths must increase")
        return self


Spectral = float | SpectralTable


@dataclass(frozen=True)
class SpectralMeasure:
    """How a field that may depend on wavelength is written: a number with a unit, a table, or one of some names.

    Parameters
    ----------
    measure : Measure
        What the numbers are.
    names : tuple of str
        Accepted names.
    named : bool
        Whether any name is, to be checked by the record itself.
    """

    measure: Measure
    names: tuple[str, ...] = ()
    named: bool = False

    def read(self, value: Any, field: str) -> Any:
        """The number in the unit of the house, the table, or the name."""
        if isinstance(value, SpectralTable):
            for number in value.values:
                self.measure.check(number, field)
            return value
        if isinstance(value, Mapping):
            return SpectralTable.model_validate(self._table(value, field))
        if isinstance(value, str) and (self.named or self.names) and not units.starts_as_number(value):
            if self.names and value not in self.names:
                raise DomainError(field, value, nearest(value, self.names))
            return value
        return self.measure.read(value, field)

    def _table(self, value: Mapping[str, Any], field: str) -> Mapping[str, Any]:
        if value.get("file") is not None:
            last = Wanted((field, "values", "value"), self.measure)
            return with_columns(value, {"wavelengths": _WAVELENGTH, "values": last})
        values = value.get("values")
        if not isinstance(values, (list, tuple)):
            return value
        return {**value, "values": [self.measure.read(one, field) for one in values]}

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read the value before its type is looked at."""
        return core_schema.with_info_before_validator_function(
            lambda value, info: None if value is None else self.read(value, info.field_name or self.measure.noun),
            handler(source),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A number, text with a unit, a table, or a name."""
        number, text = self.measure.json_schema()
        ways = [way for way in handler(schema).get("anyOf", ()) if "$ref" in way]
        names = [{"enum": list(self.names)}] if self.names else []
        return {"anyOf": [number, {"type": "string"} if self.named else text, *ways, *names]}


_Sort = TypeVar("_Sort")

if TYPE_CHECKING:
    SpectralAmount = Amount | SpectralTable | Mapping[str, Any]

    class OptionalSpectral(Given[Spectral | None, SpectralAmount | None], Generic[_Sort]):
        """A number or a table, or none."""

    class OptionalLamp(Given[SpectralTable | str | None, SpectralAmount | None], Generic[_Sort]):
        """A table or a name, or none."""

    SpectralNumber = Given[Spectral, SpectralAmount]
    SpectralPositive = Given[Spectral, SpectralAmount]
    SpectralNonNegative = Given[Spectral, SpectralAmount]
    SpectralShare = Given[Spectral, SpectralAmount]
    SpectralExponent = Given[Spectral, SpectralAmount]
    SpectralAsymmetry = Given[Spectral, SpectralAmount]
    SpectralExtinction = Given[Spectral, SpectralAmount]
    SpectralArea = Given[Spectral, SpectralAmount]
    SpectralLength = Given[Spectral, SpectralAmount]
    SpectralPower = Given[Spectral, SpectralAmount]
    Irradiance = Given[Spectral, SpectralAmount]
    Radiance = Given[Spectral, SpectralAmount]
    Emission = Given[Spectral, SpectralAmount]
    Background = Given[Spectral | str, SpectralAmount]
    StarSpectrum = Given[Spectral | str, SpectralAmount]
    Albedo = Given[Spectral | str, SpectralAmount]
    Index = Given[Spectral | str, SpectralAmount]
    Albedos = Given[tuple[Spectral | str, ...], Sequence[SpectralAmount]]
    LampSpectrum = Given[SpectralTable | str, SpectralAmount]
else:
    OptionalSpectral = OptionalLamp = OptionalNumber
    #: Fields of records, by what their numbers are.
    SpectralNumber = Annotated[Spectral, SpectralMeasure(units.NUMBER)]
    SpectralPositive = Annotated[Spectral, SpectralMeasure(units.NUMBER.within(0.0, above=True))]
    SpectralNonNegative = Annotated[Spectral, SpectralMeasure(units.NUMBER.within(0.0))]
    SpectralShare = Annotated[Spectral, SpectralMeasure(units.SHARE)]
    SpectralExponent = Annotated[Spectral, SpectralMeasure(units.NUMBER.within(0.0, 2.0, above=True))]
    SpectralAsymmetry = Annotated[Spectral, SpectralMeasure(units.NUMBER.within(-1.0, 1.0, above=True, below=True))]
    SpectralExtinction = Annotated[Spectral, SpectralMeasure(units.EXTINCTION.within(0.0))]
    SpectralArea = Annotated[Spectral, SpectralMeasure(units.AREA.within(0.0))]
    SpectralLength = Annotated[Spectral, SpectralMeasure(units.LENGTH.within(0.0, above=True))]
    SpectralPower = Annotated[Spectral, SpectralMeasure(units.SPECTRAL_POWER.within(0.0))]
    Irradiance = Annotated[Spectral, SpectralMeasure(units.IRRADIANCE.within(0.0))]
    Radiance = Annotated[Spectral, SpectralMeasure(units.RADIANCE.within(0.0))]
    Background = Annotated[
        Spectral | Literal["interstellar"], SpectralMeasure(units.RADIANCE.within(0.0), names=("interstellar",))
    ]
    StarSpectrum = Annotated[
        Spectral | Literal["astm-g173", "blackbody"],
        SpectralMeasure(units.IRRADIANCE.within(0.0), names=("astm-g173", "blackbody")),
    ]
    #: Share of the light that a surface throws back, or its name.
    Albedo = Annotated[Spectral | str, SpectralMeasure(units.SHARE, named=True)]
    Albedos = tuple[Albedo, ...]
    #: Refractive index, or the name of a substance.
    Index = Annotated[Spectral | str, SpectralMeasure(units.NUMBER.within(0.1, 10.0, above=True), named=True)]
    #: Shape of a lamp's spectrum: a table in any unit per nm, or a name.
    LampSpectrum = Annotated[SpectralTable | str, SpectralMeasure(units.RELATIVE, named=True)]
    Emission = Annotated[Spectral, SpectralMeasure(units.EMISSION.within(0.0))]


def evaluate(value: Any, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """Value of a number or a `SpectralTable` at each wavelength [nm]; shape (wavelength,)."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if isinstance(value, SpectralTable):
        return np.interp(wl, value.wavelengths, value.values)
    return np.full(wl.shape, float(value))


def bounds(value: Any) -> tuple[float, float]:
    """Smallest and largest value that a number or a table takes."""
    if isinstance(value, SpectralTable):
        return min(value.values), max(value.values)
    return float(value), float(value)
