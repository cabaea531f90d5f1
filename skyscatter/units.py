"""The boundary between what a user writes and what a kernel reads.

Inside skyscatter every length is in metres, every angle in radians unless a name says degrees, every wavelength in
vacuum nanometres.  A user may give a bare number in the documented unit, a string such as ``"8 km"`` or ``"30%"``, or
an astropy Quantity, in a model file, in Python and on the command line alike.  The conversion happens once, here.
Units that people use are tabulated; astropy is imported only for others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Generic, Protocol, TypeVar

from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from skyscatter.errors import DomainError, UnitsError

_AU = 149597870700.0
PARSEC = 648000 / 3.141592653589793 * _AU  #: [m], IAU 2015 resolution B2
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBER_AND_UNIT = re.compile(rf"\s*({_NUMBER})\s*(\S.*?)?\s*")


@dataclass(frozen=True)
class Measure:
    """A sort of quantity: how it is written, in which unit it is kept, and between which bounds it lies.

    As an annotation of a record's field, ``Annotated[float, LENGTH]``, it reads what a user gives for the field.

    Parameters
    ----------
    noun : str
        What it is, such as "length".
    house : str
        Unit in which it is kept, and in which bare numbers are; empty for pure numbers.
    units : mapping of str to float
        How much one of a unit is in the unit of the house.
    example : str
        As a user may write it.
    low, high : float
        Bounds, in the unit of the house.
    above, below : bool
        Whether `low` and `high` themselves are refused.
    """

    noun: str
    house: str
    units: Mapping[str, float] = field(hash=False)
    example: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    below: bool = False

    def within(
        self, low: float = -math.inf, high: float = math.inf, *, above: bool = False, below: bool = False
    ) -> Measure:
        """The same sort of quantity between bounds; `above` the lower one, or `below` the higher one."""
        return replace(self, low=low, high=high, above=above, below=below)

    def read(self, value: Any, name: str) -> float:
        """The value in the unit of the house.

        Parameters
        ----------
        value : number, str or Quantity
        name : str
            What errors call it.

        Raises
        ------
        UnitsError
            For something of another dimension, or no number at all.
        DomainError
            For a value outside the bounds.
        """
        number = self._convert(value, name)
        self.check(number, name, value)
        return number

    def check(self, number: float, name: str, shown: Any = None) -> None:
        """Refuse a number in the unit of the house that lies outside the bounds; errors show `shown`."""
        inside = self.low <= number <= self.high
        at_end = (self.above and number == self.low) or (self.below and number == self.high)
        if math.isnan(number) or (inside and not at_end):  # what is no number is refused by the record
            return
        raise DomainError(name, number if shown is None else shown, self.rule)

    @property
    def range(self) -> str:
        """The bounds in words, such as "above 0"; empty if there are none."""
        if math.isinf(self.low) and math.isinf(self.high):
            return ""
        if math.isinf(self.high):
            return f"above {self.low:g}" if self.above else f"{self.low:g} or above"
        return f"{'above ' if self.above else ''}{self.low:g} to {'below ' if self.below else ''}{self.high:g}"

    @property
    def rule(self) -> str:
        """What errors say of a value outside the bounds."""
        unit = f" {self.house}" if self.house and self.low != 0 else ""
        if math.isinf(self.high):
            if self.low == 0:
                sort = "must be above 0" if self.noun == "number" else f"must be a positive {self.noun}"
                return sort if self.above else "is never negative"
            return f"must be {'above' if self.above else 'at least'} {self.low:g}{unit}"
        unit = f" {self.house}" if self.house else ""
        if self.above or self.below:
            low, high = "above" if self.above else "at least", "below" if self.below else "at most"
            return f"must be {low} {self.low:g} and {high} {self.high:g}{unit}"
        return f"lies between {self.low:g} and {self.high:g}{unit}"

    def _convert(self, value: Any, name: str) -> float:
        if isinstance(value, bool):
            raise UnitsError(name, value, self._expected)
        if isinstance(value, (int, float)):
            return float(value)
        if isinstance(value, str):
            match = _NUMBER_AND_UNIT.fullmatch(value)
            factor = self.factor(match[2] or "") if match else None
            if match is None or factor is None:
                raise UnitsError(name, value, self._expected)
            # 95 * 0.01 is not 0.95 to the last bit.
            return float(match[1]) / 100 if match[2] == "%" and factor == 0.01 else float(match[1]) * factor
        try:
            return float(value.to_value(self._astropy)) if hasattr(value, "to_value") else float(value)
        except Exception as error:
            raise UnitsError(name, str(value), self._expected) from error

    def factor(self, unit: str) -> float | None:
        """How much one of a unit is in the unit of the house; None for what is no such unit."""
        if unit == "" or unit == self.house:
            return 1.0
        known = self.units.get(unit)
        return _astropy_factor(unit, self._astropy) if known is None else known

    @property
    def _astropy(self) -> str:
        return _ASTROPY.get(self.house, self.house)

    @property
    def _expected(self) -> str:
        bare = f"; bare numbers are {self.house}" if self.house else ""
        if not self.units:
            return f'a {self.noun}, such as "{self.example}"'
        return f'a {self.noun}, such as "{self.example}" (units: {", ".join(self.units)}{bare})'

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read the value before it is validated as the number it is kept as."""
        return core_schema.with_info_before_validator_function(
            lambda value, info: self.read(value, info.field_name or self.noun),
            handler(source),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A number within the bounds, or text with a unit."""
        return {"anyOf": self.json_schema()}

    def json_schema(self) -> list[dict[str, Any]]:
        """The ways to write it, as JSON schemas."""
        number: dict[str, Any] = {"type": "number"}
        if not math.isinf(self.low):
            number["exclusiveMinimum" if self.above else "minimum"] = self.low
        if not math.isinf(self.high):
            number["exclusiveMaximum" if self.below else "maximum"] = self.high
        return [number, {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*(\S.*)?$", "examples": [self.example]}]


class _Relative(Measure):
    """Values of which only the ratios count, in whatever unit."""

    def factor(self, unit: str) -> float | None:
        """Any unit will do."""
        return 1.0


#: Units of the house whose names are not astropy's.
_ASTROPY = {"Lsun": "solLum", "au": "AU", "": "", "lx": "lx", "ppm": ""}


@lru_cache(maxsize=256)
def _astropy_factor(unit: str, house: str) -> float | None:
    """How much one of a unit is in another one, as astropy has it; None if it has not."""
    import warnings

    from astropy import units

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return float(units.Unit(unit).to(units.Unit(house)))
    except (ValueError, TypeError, units.UnitConversionError):
        return None


def _powers(factors: Mapping[str, float], power: int) -> dict[str, float]:
    """Units of a power of a length, as in cm-3 and 1/cm3."""
    digit = "" if power == -1 else str(-power)
    written = {f"{unit}{power}": factor**power for unit, factor in factors.items()}
    return written | {f"1/{unit}{digit}": factor**power for unit, factor in factors.items()}


def _per_nm(watts: str) -> dict[str, float]:
    """Spectral units: so many watts by nanometre or micrometre."""
    return {f"{watts} nm-1": 1.0, f"{watts} um-1": 1e-3}


_LENGTHS = {
    "m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "au": _AU, "AU": _AU,
    "Rsun": 6.957e8, "ly": 9460730472580800.0, "pc": PARSEC, "kpc": 1e3 * PARSEC, "Mpc": 1e6 * PARSEC,
}  # fmt: skip
_ANGLES = {
    "deg": 1.0, "°": 1.0, "arcmin": 1 / 60, "arcsec": 1 / 3600, "mas": 1 / 3600e3, "rad": 180 / math.pi,
}  # fmt: skip
_WATTS = {"W": 1.0, "kW": 1e3, "mW": 1e-3, "MW": 1e6}

LENGTH = Measure("length", "m", _LENGTHS, "8 km")
ASTRONOMICAL = Measure(
    "length", "au", {unit: (1.0 if metres == _AU else metres / _AU) for unit, metres in _LENGTHS.items()}, "0.3 AU"
)
#: Wavelengths that may be asked of anything [nm]: from far beyond light on both sides, where numbers stay numbers.
WAVELENGTHS = (1e-6, 1e9)
WAVELENGTH = Measure(
    "wavelength", "nm", {"nm": 1.0, "um": 1e3, "µm": 1e3, "m": 1e9, "angstrom": 0.1, "Angstrom": 0.1}, "0.55 um"
)
ANGLE = Measure("angle", "deg", _ANGLES, "30 deg")
TEMPERATURE = Measure("temperature", "K", {"K": 1.0, "kK": 1e3}, "4000 K", low=0.0, above=True)
TIME = Measure("time", "s", {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "d": 86400.0}, "20 min")
NUMBER = Measure("number", "", {"%": 0.01}, "30%")
RELATIVE = _Relative("value in any unit", "", {}, "1")
RELATIVE_AMOUNT = _Relative("value in any unit", "", {}, "1", low=0.0)
SPEED = Measure("speed", "m s-1", {"m s-1": 1.0, "m/s": 1.0, "km/h": 1 / 3.6}, "5 m/s", low=0.0)
SHARE = Measure("share", "", {"%": 0.01}, "30%", low=0.0, high=1.0)
EXTINCTION = Measure("coefficient", "m-1", _powers({"m": 1.0, "km": 1e3, "cm": 1e-2, "Mm": 1e6}, -1), "0.02 km-1")
AREA = Measure("cross section", "m2", {"m2": 1.0, "cm2": 1e-4, "um2": 1e-12, "nm2": 1e-18}, "1e-20 cm2")
NUMBER_DENSITY = Measure("number density", "m-3", _powers({"m": 1.0, "cm": 1e-2}, -3), "100 cm-3")
MASS_DENSITY = Measure(
    "mass density", "kg m-3", {"kg m-3": 1.0, "kg/m3": 1.0, "g cm-3": 1e3, "g/cm3": 1e3}, "1e-22 kg m-3"
)
COLUMN = Measure("column", "m-2", _powers({"m": 1.0, "cm": 1e-2}, -2), "8e18 cm-2")
DOBSON = Measure("column", "DU", {"DU": 1.0}, "300 DU")
PARTS = Measure("mixing ratio", "ppm", {"ppm": 1.0, "ppb": 1e-3, "%": 1e4}, "420 ppm")
MAGNITUDE = Measure("magnitude", "mag", {"mag": 1.0}, "7.4 mag")
LUMINOSITY = Measure("luminosity", "Lsun", {"Lsun": 1.0, "W": 1 / 3.828e26}, "3300 Lsun")
RATE = Measure("rate", "s-1", {"s-1": 1.0, "1/s": 1.0}, "1e49 s-1")
POWER = Measure("power", "W", _WATTS, "40 W")
LUMENS = Measure("luminous flux", "lm", {"lm": 1.0}, "800 lm")
LUX = Measure("illuminance", "lx", {"lx": 1.0, "klx": 1e3}, "500 lx")
CANDELA = Measure("luminance", "cd m-2", {"cd m-2": 1.0, "cd/m2": 1.0}, "2e-4 cd m-2")
WATTS_PER_AREA = Measure("irradiance", "W m-2", {"W m-2": 1.0, "W/m2": 1.0}, "1361 W m-2")
WATTS_PER_AREA_SR = Measure("radiance", "W m-2 sr-1", {"W m-2 sr-1": 1.0}, "10 W m-2 sr-1")
SPECTRAL_POWER = Measure("spectral power", "W nm-1", _per_nm("W"), "0.1 W nm-1")
IRRADIANCE = Measure("spectral irradiance", "W m-2 nm-1", _per_nm("W m-2"), "1.5 W m-2 nm-1")
RADIANCE = Measure("spectral radiance", "W m-2 sr-1 nm-1", _per_nm("W m-2 sr-1"), "0.1 W m-2 sr-1 nm-1")
EMISSION = Measure("spectral emission", "W m-3 sr-1 nm-1", _per_nm("W m-3 sr-1"), "1e-9 W m-3 sr-1 nm-1")


def metres(value: Any, name: str = "length") -> float:
    """Length [m] from a number in metres, a string such as ``"8 km"``, or a Quantity."""
    return LENGTH.read(value, name)


def nanometres(value: Any, name: str = "wavelength") -> float:
    """Vacuum wavelength [nm] from a number in nm, a string such as ``"0.55 um"``, or a Quantity."""
    return WAVELENGTH.read(value, name)


def degrees(value: Any, name: str = "angle") -> float:
    """Angle [degree] from a number in degrees, a string such as ``"0.5 rad"``, or a Quantity."""
    return ANGLE.read(value, name)


def starts_as_number(text: str) -> bool:
    """Whether a text is a number with or without a unit, rather than a name."""
    return _NUMBER_AND_UNIT.fullmatch(text) is not None


def default(value: Any) -> Any:
    """A field's default, for a type checker of any type: it takes fields for descriptors."""
    return value


def _listed(value: Any) -> Any:
    """Arrays, with or without a unit, as the lists that records take."""
    return list(value) if getattr(value, "ndim", 0) > 0 else value


_Sort = TypeVar("_Sort")
_Kept = TypeVar("_Kept", covariant=True)
_Written = TypeVar("_Written", contravariant=True)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    # For type checkers a field is a descriptor: it is set with a text or a Quantity as well, and read as a number.

    class _Quantity(Protocol):
        def to_value(self, unit: Any) -> Any: ...

    Amount = float | str | _Quantity
    Amounts = Sequence[Amount] | NDArray[Any] | _Quantity

    class Given(Generic[_Kept, _Written]):
        """A field that is read as one type and may be given as others."""

        def __get__(self, instance: object, owner: Any) -> _Kept: ...
        def __set__(self, instance: object, value: _Written) -> None: ...

    class OptionalNumber(Given[float | None, Amount | None], Generic[_Sort]):
        """A number, or none."""

    class OptionalTriple(Given[tuple[float, float, float] | None, Amounts | None], Generic[_Sort]):
        """Three numbers, or none."""

    class OptionalPair(Given[tuple[float, float] | None, Amounts | None], Generic[_Sort]):
        """Two numbers, or none."""

    Metres = Given[float, Amount]
    PositiveMetres = Given[float, Amount]
    NonNegativeMetres = Given[float, Amount]
    AstronomicalUnits = Given[float, Amount]
    PositiveNanometres = Given[float, Amount]
    Degrees = Given[float, Amount]
    Turn = Given[float, Amount]
    Elevation = Given[float, Amount]
    LowElevation = Given[float, Amount]
    AngularRadius = Given[float, Amount]
    HighElevation = Given[float, Amount]
    RightAscension = Given[float, Amount]
    HalfAngle = Given[float, Amount]
    Kelvin = Given[float, Amount]
    StarTemperature = Given[float, Amount]
    Number = Given[float, Amount]
    PositiveNumber = Given[float, Amount]
    NonNegative = Given[float, Amount]
    Share = Given[float, Amount]
    WindSpeed = Given[float, Amount]
    Coefficient = Given[float, Amount]
    NumberDensity = Given[float, Amount]
    MassDensity = Given[float, Amount]
    ColumnDensity = Given[float, Amount]
    DobsonUnits = Given[float, Amount]
    PartsPerMillion = Given[float, Amount]
    Magnitude = Given[float, Amount]
    Extinction = Given[float, Amount]
    Luminosity = Given[float, Amount]
    PhotonRate = Given[float, Amount]
    Watts = Given[float, Amount]
    Lumens = Given[float, Amount]
    Lux = Given[float, Amount]
    Candela = Given[float, Amount]
    WattsPerArea = Given[float, Amount]
    WattsPerAreaAndAngle = Given[float, Amount]
    Place = Given[tuple[float, float, float], Amounts]
    Sizes = Given[tuple[float, float, float], Amounts]
    Triple = Given[tuple[float, float, float], Amounts]
    Radii = Given[tuple[float, ...], Amounts]
    Altitudes = Given[tuple[float, ...], Amounts]
    Wavelengths = Given[tuple[float, ...], Amounts]
    Angles = Given[tuple[float, ...], Amounts]
    Numbers = Given[tuple[float, ...], Amounts]
    Densities = Given[tuple[float, ...], Amounts]
    Intensities = Given[tuple[float, ...], Amounts]
    Size = Given[tuple[float, float], Amounts]
    Places = Given[tuple[tuple[float, float, float], ...], Sequence[Amounts] | NDArray[Any] | _Quantity]
    Profile = Given[tuple[tuple[float, float], ...], Sequence[Amounts] | NDArray[Any] | _Quantity]
    Rows = Given[tuple[tuple[float, ...], ...], Sequence[Amounts] | NDArray[Any] | _Quantity]
else:

    class OptionalNumber:
        """A number, or none."""

        def __class_getitem__(cls, sort: Any) -> Any:
            return sort | None

    OptionalTriple = OptionalPair = OptionalNumber
    Metres = Annotated[float, LENGTH]
    PositiveMetres = Annotated[float, LENGTH.within(0.0, above=True)]
    NonNegativeMetres = Annotated[float, LENGTH.within(0.0)]
    AstronomicalUnits = Annotated[float, ASTRONOMICAL.within(0.0, above=True)]
    PositiveNanometres = Annotated[float, WAVELENGTH.within(*WAVELENGTHS)]
    Degrees = Annotated[float, ANGLE]
    Turn = Annotated[float, ANGLE.within(-360.0, 360.0)]
    Elevation = Annotated[float, ANGLE.within(-90.0, 90.0)]
    LowElevation = Annotated[float, ANGLE.within(-90.0, 90.0, below=True)]
    AngularRadius = Annotated[float, ANGLE.within(0.0, 5.0)]
    HighElevation = Annotated[float, ANGLE.within(-90.0, 90.0, above=True)]
    RightAscension = Annotated[float, ANGLE.within(0.0, 360.0, below=True)]
    HalfAngle = Annotated[float, ANGLE.within(0.0, 90.0, above=True, below=True)]
    Kelvin = Annotated[float, TEMPERATURE]
    StarTemperature = Annotated[float, TEMPERATURE.within(1000.0, 100000.0)]
    Number = Annotated[float, NUMBER]
    PositiveNumber = Annotated[float, NUMBER.within(0.0, above=True)]
    NonNegative = Annotated[float, NUMBER.within(0.0)]
    Share = Annotated[float, SHARE]
    WindSpeed = Annotated[float, SPEED.within(0.0, 20.0)]
    Coefficient = Annotated[float, EXTINCTION.within(0.0)]
    NumberDensity = Annotated[float, NUMBER_DENSITY.within(0.0)]
    MassDensity = Annotated[float, MASS_DENSITY.within(0.0)]
    ColumnDensity = Annotated[float, COLUMN.within(0.0)]
    DobsonUnits = Annotated[float, DOBSON.within(0.0)]
    PartsPerMillion = Annotated[float, PARTS.within(0.0, 1e5, below=True)]
    Magnitude = Annotated[float, MAGNITUDE]
    Extinction = Annotated[float, MAGNITUDE.within(0.0)]
    Luminosity = Annotated[float, LUMINOSITY.within(0.0, above=True)]
    PhotonRate = Annotated[float, RATE.within(0.0, above=True)]
    Watts = Annotated[float, POWER.within(0.0)]
    Lumens = Annotated[float, LUMENS.within(0.0)]
    Lux = Annotated[float, LUX.within(0.0)]
    Candela = Annotated[float, CANDELA.within(0.0)]
    WattsPerArea = Annotated[float, WATTS_PER_AREA.within(0.0)]
    WattsPerAreaAndAngle = Annotated[float, WATTS_PER_AREA_SR.within(0.0)]
    Place = Annotated[tuple[Metres, Metres, Metres], BeforeValidator(_listed)]
    Sizes = Annotated[tuple[PositiveMetres, PositiveMetres, PositiveMetres], BeforeValidator(_listed)]
    Radii = Annotated[tuple[PositiveMetres, ...], BeforeValidator(_listed)]
    Triple = Annotated[tuple[float, float, float], BeforeValidator(_listed)]
    Altitudes = Annotated[tuple[NonNegativeMetres, ...], BeforeValidator(_listed)]
    Wavelengths = Annotated[tuple[PositiveNanometres, ...], BeforeValidator(_listed)]
    Angles = Annotated[tuple[Annotated[float, ANGLE.within(0.0, 180.0)], ...], BeforeValidator(_listed)]
    Numbers = Annotated[tuple[float, ...], BeforeValidator(_listed)]
    Densities = Annotated[tuple[NonNegative, ...], BeforeValidator(_listed)]
    Intensities = Annotated[tuple[NonNegative, ...], BeforeValidator(_listed)]
    Size = Annotated[tuple[PositiveMetres, PositiveMetres], BeforeValidator(_listed)]
    Places = Annotated[tuple[Place, ...], BeforeValidator(_listed)]
    Profile = Annotated[tuple[tuple[Metres, Metres], ...], BeforeValidator(_listed)]
    Rows = Annotated[tuple[Annotated[tuple[Metres, ...], BeforeValidator(_listed)], ...], BeforeValidator(_listed)]
