"""Gases and other absorbers that take light away without scattering it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.spectra.table import SpectralTable, bounds, evaluate

Array = NDArray[np.float64]

DOBSON_UNIT = 2.6867e20  #: molecules per square metre in one Dobson unit [m-2]

_TABLES = {"o3": "o3_cross_section.csv", "no2": "no2_cross_section.csv"}
#: Effective temperatures [K] where a model names none: the ozone layer of middle latitudes, stratospheric NO2.
_DEFAULT_TEMPERATURE = {"o3": 228.0, "no2": 220.0}


def cross_section(species: str, wavelengths_nm: ArrayLike, temperature: float) -> Array:
    """Absorption cross section of one molecule.

    Linear in wavelength and in temperature between tabulated values.  Ozone: 250 to 829 nm, 218 to 295 K (beyond
    345 nm measured at 295 K only and used at every temperature).  NO2: 251.6 to 660 nm, 220 to 294 K, in steps of
    5 nm, without a row between 440 and 485 nm.  Zero at longer wavelengths than the table holds.

    Parameters
    ----------
    species : {"o3", "no2"}
    wavelengths_nm : array_like, shape (wavelength,)
    temperature : float
        Temperature [K], inside the tabulated range.

    Returns
    -------
    ndarray, shape (wavelength,)
        Cross section [m2].

    Raises
    ------
    DomainError
        For an unknown species, a temperature outside the table, or a wavelength below it.
    """
    if species not in _TABLES:
        raise DomainError("species", species, f"known species are {', '.join(_TABLES)}")
    table = read_table(_TABLES[species])
    temperatures = temperature_range(species)
    if not temperatures[0] <= temperature <= temperatures[-1]:
        allowed = f"{species} is tabulated from {temperatures[0]:g} to {temperatures[-1]:g} K"
        raise DomainError("temperature", temperature, allowed)
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    nodes = table["wavelength_nm"]
    if wl.size and wl.min() < nodes[0]:
        raise DomainError("wavelength", float(wl.min()), f"{species} is tabulated from {nodes[0]:g} nm upwards")
    upper = int(np.clip(np.searchsorted(temperatures, temperature), 1, len(temperatures) - 1))
    t0, t1 = temperatures[upper - 1], temperatures[upper]
    share = (temperature - t0) / (t1 - t0)
    values = (1.0 - share) * table[f"{t0:g}K"] + share * table[f"{t1:g}K"]
    return np.interp(wl, nodes, values, right=0.0)


def temperature_range(species: str) -> tuple[float, ...]:
    """Temperatures [K] at which a species is tabulated, ascending."""
    return tuple(float(name[:-1]) for name in read_table(_TABLES[species]) if name.endswith("K"))


class _PureAbsorber(OpticalModel):
    """An absorber scatters nothing; its phase function is isotropic and never used."""

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        """Isotropic: nothing is scattered."""
        from skyscatter.optics.phase import Isotropic

        return Isotropic()


class _Amount(_PureAbsorber):
    """How many molecules there are, in one of three ways."""

    column_du: float | None = Field(default=None, ge=0.0)  #: vertical column [Dobson units]
    column_m2: float | None = Field(default=None, ge=0.0)  #: vertical column [m-2]
    number_density: float | None = Field(default=None, ge=0.0)  #: molecules per volume at unit density [m-3]

    def amounts_given(self) -> int:
        """How many of the three fields are set."""
        return sum(value is not None for value in (self.column_du, self.column_m2, self.number_density))

    def molecules_per_volume(self, column_m: float) -> float:
        """Number density [m-3] where the density field is 1, whose vertical column is `column_m` [m]."""
        if self.number_density is not None:
            return self.number_density
        if not column_m > 0:
            raise DomainError("column", column_m, "a density field with a positive vertical column")
        column = self.column_m2 if self.column_m2 is not None else (self.column_du or 0.0) * DOBSON_UNIT
        return column / column_m


class GasAbsorption(_Amount):
    """Absorption by a named gas with a tabulated cross section.

    Give exactly one of `column_du`, `column_m2` and `number_density`.

    Parameters
    ----------
    species : {"o3", "no2"}
        Ozone (Malicet et al. 1995, Brion et al. 1998) or nitrogen dioxide (JPL 06-2, Sander et al. 2006).
    temperature : float, optional
        Effective temperature [K]; 228 K for ozone and 220 K for NO2 by default.
    """

    kind: Literal["gas-absorption"] = "gas-absorption"
    species: Literal["o3", "no2"]
    temperature: float | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.amounts_given() != 1:
            raise ValueError("give exactly one of column_du, column_m2, number_density")
        low, *_, high = temperature_range(self.species)
        if not low <= self.effective_temperature <= high:
            allowed = f"{self.species} is tabulated from {low:g} to {high:g} K"
            raise DomainError("temperature", self.temperature, allowed)
        return self

    @property
    def effective_temperature(self) -> float:
        """Temperature in use [K]."""
        return _DEFAULT_TEMPERATURE[self.species] if self.temperature is None else self.temperature

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Absorption N sigma per unit density; see `OpticalModel.coefficients`."""
        sigma = cross_section(self.species, wavelengths_nm, self.effective_temperature)
        zero = np.zeros_like(sigma)
        return Coefficients(zero, self.molecules_per_volume(column_m) * sigma, zero)


class TabulatedAbsorption(_Amount):
    """Absorption from a table of the user's own.

    Give exactly one of `coefficient`, `cross_section` and `file`; cross sections also need one of `column_du`,
    `column_m2` and `number_density`.  Values are linear between the nodes and constant beyond the ends.

    Parameters
    ----------
    coefficient : float or SpectralTable, optional
        Absorption coefficient per unit density [m-1].
    cross_section : float or SpectralTable, optional
        Absorption cross section of one molecule [m2].
    file : str, optional
        CSV file with a header line ``wavelength_nm,coefficient_per_m`` or ``wavelength_nm,cross_section_m2``;
        lines that start with ``#`` are remarks.  A relative path counts from the working directory.
    """

    kind: Literal["absorption-table"] = "absorption-table"
    coefficient: float | SpectralTable | None = None
    cross_section: float | SpectralTable | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sum(value is not None for value in (self.coefficient, self.cross_section, self.file)) != 1:
            raise ValueError("give exactly one of coefficient, cross_section, file")
        per_molecule, values = self._values()
        if bounds(values)[0] < 0:
            raise ValueError("absorption must not be negative")
        if per_molecule and self.amounts_given() != 1:
            raise ValueError("cross sections need exactly one of column_du, column_m2, number_density")
        if not per_molecule and self.amounts_given() != 0:
            raise ValueError("column_du, column_m2 and number_density go with cross sections, not with coefficients")
        return self

    def _values(self) -> tuple[bool, float | SpectralTable]:
        if self.coefficient is not None:
            return False, self.coefficient
        if self.cross_section is not None:
            return True, self.cross_section
        return read_absorption_file(str(self.file))

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Absorption per unit density; see `OpticalModel.coefficients`."""
        per_molecule, values = self._values()
        absorption = evaluate(values, wavelengths_nm)
        if per_molecule:
            absorption = absorption * self.molecules_per_volume(column_m)
        zero = np.zeros_like(absorption)
        return Coefficients(zero, absorption, zero)


def read_absorption_file(path: str) -> tuple[bool, SpectralTable]:
    """Whether a CSV file holds cross sections [m2] rather than coefficients [m-1], and its table."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MissingDataError(path, f"cannot be read as text ({error.__class__.__name__}); check the path") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    kinds = {"cross_section_m2": True, "coefficient_per_m": False}
    header = [cell.strip() for cell in lines[0].split(",")] if lines else []
    if len(header) != 2 or header[0] != "wavelength_nm" or header[1] not in kinds:
        raise MissingDataError(path, f"needs the header wavelength_nm,{' or wavelength_nm,'.join(kinds)}")
    try:
        rows = [tuple(float(cell) for cell in line.split(",")) for line in lines[1:]]
        wavelengths, values = zip(*rows, strict=True)
        return kinds[header[1]], SpectralTable(wavelengths=wavelengths, values=values)
    except ValueError as error:
        raise MissingDataError(path, f"needs rows of two numbers with increasing wavelengths ({error})") from error
