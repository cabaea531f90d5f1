"""Gases and other absorbers that take light away without scattering it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.spectra.table import OptionalSpectral, SpectralArea, SpectralExtinction, SpectralTable, evaluate
from skyscatter.tablefile import column_names
from skyscatter.units import ColumnDensity, DobsonUnits, Kelvin, NumberDensity, OptionalNumber, default

Array = NDArray[np.float64]

DOBSON_UNIT = 2.6867e20  #: molecules per square metre in one Dobson unit [m-2]

#: Columns of a user's own table.
_TABULATED = ("coefficient", "cross_section")
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
    """How many molecules there are, in one of three ways.

    Parameters
    ----------
    column_du : float, optional
        Vertical column [Dobson units].
    column_m2 : float, optional
        Vertical column [m-2].
    number_density : float, optional
        Molecules per volume where the density is 1 [m-3].
    """

    column_du: OptionalNumber[DobsonUnits] = default(None)
    column_m2: OptionalNumber[ColumnDensity] = default(None)
    number_density: OptionalNumber[NumberDensity] = default(None)

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
    temperature: OptionalNumber[Kelvin] = default(None)

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
        CSV or netCDF file with a column ``wavelength`` and one called ``coefficient`` or ``cross_section``, such as
        ``wavelength [nm],cross_section [cm2]``; in a model file the path counts from its folder.
    """

    kind: Literal["absorption-table"] = "absorption-table"
    coefficient: OptionalSpectral[SpectralExtinction] = default(None)
    cross_section: OptionalSpectral[SpectralArea] = default(None)
    file: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.get("file") is None:
            return data
        found = [name for name in column_names(data["file"]) if name.lower() in _TABULATED]
        if len(found) != 1 or any(data.get(name) is not None for name in _TABULATED):
            rule = f"give the file, with one column of {' or '.join(_TABULATED)}, or these fields"
            raise DomainError("file", data["file"], rule)
        rest = {name: value for name, value in data.items() if name != "file"}
        return rest | {found[0].lower(): {"file": data["file"], "column": found[0]}}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.coefficient is None) == (self.cross_section is None):
            raise ValueError("give exactly one of coefficient, cross_section, file")
        per_molecule, _ = self._values()
        if per_molecule and self.amounts_given() != 1:
            raise ValueError("cross sections need exactly one of column_du, column_m2, number_density")
        if not per_molecule and self.amounts_given() != 0:
            raise ValueError("column_du, column_m2 and number_density go with cross sections, not with coefficients")
        return self

    def _values(self) -> tuple[bool, float | SpectralTable]:
        if self.coefficient is not None:
            return False, self.coefficient
        return True, 0.0 if self.cross_section is None else self.cross_section

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Absorption per unit density; see `OpticalModel.coefficients`."""
        per_molecule, values = self._values()
        absorption = evaluate(values, wavelengths_nm)
        if per_molecule:
            absorption = absorption * self.molecules_per_volume(column_m)
        zero = np.zeros_like(absorption)
        return Coefficients(zero, absorption, zero)
