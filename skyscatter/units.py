"""The boundary between what a user writes and what a kernel reads.

Inside skyscatter every length is in metres, every angle in radians unless a name says degrees, every wavelength in
vacuum nanometres.  A user may give a bare number in the documented unit, a string such as ``"8 km"``, or an astropy
Quantity.  The conversion happens once, here; astropy itself is never imported for it.
"""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator

from skyscatter.errors import UnitsError

_AU = 149597870700.0
PARSEC = 648000 / 3.141592653589793 * _AU  #: [m], IAU 2015 resolution B2
_LENGTH = {
    "m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "au": _AU, "Rsun": 6.957e8,
    "ly": 9460730472580800.0, "pc": PARSEC, "kpc": 1e3 * PARSEC, "Mpc": 1e6 * PARSEC,
}  # fmt: skip
_WAVELENGTH = {"nm": 1.0, "um": 1e3, "µm": 1e3, "m": 1e9, "angstrom": 0.1}
_NUMBER_AND_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµ]*)\s*")


def _convert(value: Any, name: str, table: dict[str, float], house: str) -> float:
    if isinstance(value, bool):
        raise UnitsError(name, value, f"a number in {house}")
    if isinstance(value, (int, float)):
        return float(value)
    if hasattr(value, "to_value"):
        try:
            return float(value.to_value(house))
        except Exception as error:
            raise UnitsError(name, str(value), f"a scalar quantity convertible to {house}") from error
    if isinstance(value, str):
        match = _NUMBER_AND_UNIT.fullmatch(value)
        if match and (match[2] == "" or match[2] in table):
            return float(match[1]) * (table[match[2]] if match[2] else 1.0)
        raise UnitsError(name, value, f"a number with one of the units {', '.join(table)} (bare numbers are {house})")
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise UnitsError(name, value, f"a number in {house}") from error


def metres(value: Any, name: str = "length") -> float:
    """Length [m] from a number in metres, a string such as ``"8 km"``, or a Quantity."""
    return _convert(value, name, _LENGTH, "m")


def nanometres(value: Any, name: str = "wavelength") -> float:
    """Vacuum wavelength [nm] from a number in nm, a string such as ``"0.55 um"``, or a Quantity."""
    return _convert(value, name, _WAVELENGTH, "nm")


Metres = Annotated[float, BeforeValidator(metres)]
Nanometres = Annotated[float, BeforeValidator(nanometres)]
