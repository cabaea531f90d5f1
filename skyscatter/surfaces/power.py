"""How much light a lamp gives, and of which colour: watts per nanometre, or a total with the shape of a spectrum."""

from __future__ import annotations

from functools import cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.record import Record, nearest
from skyscatter.spectra.cells import cell_means
from skyscatter.spectra.table import (
    LampSpectrum,
    OptionalLamp,
    OptionalSpectral,
    SpectralPower,
    SpectralTable,
    bounds,
    evaluate,
)
from skyscatter.units import Lumens, OptionalNumber, Watts, default

Array = NDArray[np.float64]

#: Luminous efficacy of light of 540 THz [lm W-1], by definition (SI brochure, 9th edition, section 2.3.1).
EFFICACY = 683.0
_LAMPS = "lamps.csv"
#: Name of the Sun's spectrum above the atmosphere (ASTM G173-03, 280 to 4000 nm).
_SUN = "sun"


def lamp_names() -> tuple[str, ...]:
    """Names of the shipped spectra of lamps, and of the Sun's.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> from skyscatter import surfaces
    >>> [name for name in surfaces.lamp_names() if name.startswith("led")]
    ['led-2700k', 'led-4000k']
    """
    return (*(name for name in read_table(_LAMPS) if name != "wavelength_nm"), _SUN)


def lamp_spectrum(name: str) -> SpectralTable:
    """A spectrum of a lamp by its name, in any unit per nm; origins of shipped ones are in data/README.md.

    Parameters
    ----------
    name : str
        One of `lamp_names`, or an illuminant of colour-science: "D55", "FL4", "LED-RGB1".

    Returns
    -------
    SpectralTable
        From 380 to 780 nm with an integral of 1; of "sun" the irradiance above the atmosphere [W m-2 nm-1] from 280 to
        4000 nm (ASTM G173-03).

    Raises
    ------
    DomainError
        For a name that is neither.

    Examples
    --------
    Where a lamp of low-pressure sodium shines:

    >>> from skyscatter import surfaces
    >>> table = surfaces.lamp_spectrum("low-pressure-sodium")
    >>> table.wavelengths[table.values.index(max(table.values))]  # nm
    589.0
    """
    if name not in lamp_names():
        return _illuminant(name)
    table, column = (read_table("solar_astm_g173.csv"), "irradiance") if name == _SUN else (read_table(_LAMPS), name)
    return SpectralTable(wavelengths=tuple(table["wavelength_nm"].tolist()), values=tuple(table[column].tolist()))


@cache
def _illuminant(name: str) -> SpectralTable:
    """An illuminant of colour-science from 380 to 780 nm, with an integral of 1; it takes a second to load."""
    from skyscatter.spectra.library import colour_science

    illuminants = colour_science().SDS_ILLUMINANTS

    known = {key.lower(): key for key in illuminants}
    if name.lower() not in known:
        raise DomainError("spectrum", name, f"{nearest(name, lamp_names())}, or an illuminant of colour-science")
    found = illuminants[known[name.lower()]]
    nodes = np.arange(380.0, 781.0, 1.0)
    values = np.interp(nodes, found.wavelengths, found.values)
    values /= np.trapezoid(values, nodes)
    return SpectralTable(wavelengths=tuple(nodes.tolist()), values=tuple(values.tolist()))


def spectrum_shape(spectrum: SpectralTable, wavelengths_nm: ArrayLike) -> Array:
    """A spectrum divided by its integral [nm-1], zero beyond its ends; means over the cells of the grid.

    Spectra of lamps have lines, of which points on a coarse grid would miss some and overrate others; means keep the
    power.  A single wavelength gives the table's value there.
    """
    nodes, values = np.asarray(spectrum.wavelengths), np.asarray(spectrum.values)
    return cell_means(nodes, values, wavelengths_nm) / np.trapezoid(values, nodes)


def luminous_efficacy(spectrum: SpectralTable) -> float:
    """Lumens per watt of a spectrum [lm W-1] through the CIE 1931 function y-bar."""
    eye = read_table("cie1931.csv")
    nodes, values = np.asarray(spectrum.wavelengths), np.asarray(spectrum.values)
    both = np.union1d(nodes, eye["wavelength_nm"])
    seen = np.interp(both, eye["wavelength_nm"], eye["y_bar"], left=0.0, right=0.0)
    power = np.interp(both, nodes, values, left=0.0, right=0.0)
    return EFFICACY * float(np.trapezoid(seen * power, both) / np.trapezoid(values, nodes))


class Shining(Record):
    """An amount of light: spectral, or a total with a spectrum; give exactly one of the amounts.

    Subclasses name their amounts: `_spectral` is per nm, `_radiant` a total in watts, `_luminous` one in lumens.

    Parameters
    ----------
    spectrum : SpectralTable or str, optional
        Shape of the spectrum of a total: a table in any unit per nm, or the name of a shipped one, such as "led-4000k"
        or "sun".
    """

    _spectral: ClassVar[str] = "power"
    _radiant: ClassVar[str] = "watts"
    _luminous: ClassVar[str] = "lumens"

    @classmethod
    def amounts(cls) -> tuple[str, ...]:
        """The fields of which exactly one is given."""
        return cls._spectral, cls._radiant, cls._luminous

    @model_validator(mode="after")
    def _check_amount(self) -> Self:
        given = [name for name in self.amounts() if getattr(self, name) is not None]
        if len(given) != 1:
            rule = f"give exactly one of {', '.join(self.amounts())}"
            raise DomainError(getattr(self, "name", None) or "lamp", ", ".join(given), rule)
        low, high = bounds(getattr(self, given[0]))
        if low < 0 or not high > 0:
            raise DomainError(given[0], low if low < 0 else high, "a lamp gives light: never negative, and not zero")
        total = given[0] in (self._radiant, self._luminous)
        if total != (self.spectrum is not None):
            rule = f"goes with {self._radiant} or {self._luminous}, which need one; not with other amounts"
            raise DomainError("spectrum", self.spectrum if not total else None, rule)
        if self.spectrum is not None:
            self._check_spectrum(given[0])
        return self

    def _check_spectrum(self, given: str) -> None:
        table = self.spectrum_table
        if min(table.values) < 0 or not max(table.values) > 0 or len(table.values) < 2:
            raise DomainError("spectrum", min(table.values), "at least 2 values, never negative, not zero everywhere")
        if given == self._luminous and not luminous_efficacy(table) > 0:
            raise DomainError(given, getattr(self, given), "this spectrum cannot be seen; give watts")

    @property
    def spectrum_table(self) -> SpectralTable:
        """The spectrum that belongs to a total."""
        spectrum = getattr(self, "spectrum", None)
        if isinstance(spectrum, SpectralTable):
            return spectrum
        return lamp_spectrum(str(spectrum))

    def spectral_amount(self, wavelengths_nm: ArrayLike) -> Array:
        """The amount per nm at wavelengths [nm]; shape (wavelength,)."""
        value = getattr(self, self._spectral)
        if value is not None:
            return evaluate(value, wavelengths_nm)
        table, watts = self.spectrum_table, getattr(self, self._radiant)
        if watts is None:
            watts = getattr(self, self._luminous) / luminous_efficacy(table)
        return watts * spectrum_shape(table, wavelengths_nm)

    spectrum: OptionalLamp[LampSpectrum] = default(None)


class Powered(Shining):
    """The power of a lamp.

    Parameters
    ----------
    power : float or SpectralTable, optional
        [W nm-1], into all directions together.
    watts, lumens : float, optional
        Radiant or luminous flux, with a `spectrum`.
    spectrum : SpectralTable or str, optional
        Its shape: a table in any unit per nm, or the name of a shipped one, such as "led-4000k".
    """

    power: OptionalSpectral[SpectralPower] = default(None)
    watts: OptionalNumber[Watts] = default(None)
    lumens: OptionalNumber[Lumens] = default(None)
