"""Units of measured radiances and fluxes: as a file or a user states them, to those of the house."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]

RADIANCE, SPECTRAL_FLUX, FLUX = "W m-2 sr-1 nm-1", "W m-2 nm-1", "W m-2"
#: How much brighter or darker than the model's first guess unknown haze, ground and calibration make a sky; and the
#: least factor between the units that such data come in (`FAR_UNITS`) and those of the house.  A spectrum per angstrom,
#: a factor of ten, cannot be told from a bright sky.
USUAL, BETWEEN_UNITS = 4.0, 100.0
FAR_UNITS = ("uW cm-2 sr-1 nm-1", "mW m-2 sr-1 nm-1", "W m-2 sr-1 um-1", "erg s-1 cm-2 sr-1 Angstrom-1")
#: Data this many times above or below the first guess, half of them, are in other units: half-way between the two.
IMPLAUSIBLE = (USUAL * BETWEEN_UNITS) ** 0.5


def factors(unit: str, house: str, wavelength_nm: ArrayLike | None, name: str = "units") -> Array:
    """By what numbers in a unit are multiplied to be in that of the house: shape of the wavelengths, or ().

    Parameters
    ----------
    unit : str
        As astropy reads units, such as ``"uW cm-2 sr-1 nm-1"``; per frequency and photons per second do as well.
    house : str
    wavelength_nm : array_like, optional
        Of the data [nm]; without it only units of the same kind can be converted.
    name : str
        Where the unit was said, for the message.

    Raises
    ------
    DomainError
        If it is no unit, or one of something else.

    Examples
    --------
    >>> float(factors("uW cm-2 sr-1 nm-1", "W m-2 sr-1 nm-1", 500.0))
    0.01
    """
    import warnings

    from astropy import units

    wl: Any = None if wavelength_nm is None else np.asarray(wavelength_nm, float)
    rule = f"give a unit such as {house}, or one that can be converted to it"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", units.UnitsWarning)  # several slashes are read from left to right
            given = units.Unit(unit.replace("µ", "u").replace("μ", "u"))
    except (ValueError, TypeError):
        raise DomainError(name, unit, f"is no unit that is understood; {rule}") from None
    try:
        same = [] if wl is None else units.spectral_density(wl * units.nm)
        return np.asarray((np.ones(np.shape(wl)) * given).to_value(units.Unit(house), same), float)
    except units.UnitConversionError:
        raise DomainError(name, unit, f"is a unit of something else; {rule}") from None


def refuse_implausible(measured: Array, first_guess: Array, unit: str) -> None:
    """Refuse data, in units that nobody has stated, that are far from anything the model could say.

    Raises
    ------
    DomainError
        With the ratio, and how to state the unit.
    """
    there = np.abs(first_guess) > 0
    if not there.any():
        return
    ratio = float(np.median(np.abs(measured[there] / first_guess[there])))
    if ratio > 0 and not 1 / IMPLAUSIBLE < ratio < IMPLAUSIBLE:
        rule = (
            f"times what the model says before anything is fitted: are they in another unit than {unit}? Say which "
            f"with --units, such as 'uW cm-2 sr-1 nm-1' (units in Python), or --units '{unit}' if they are in this"
        )
        raise DomainError("data", float(f"{ratio:.3g}"), rule)
