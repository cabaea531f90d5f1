"""Emission lines of ionised gas: hydrogen's by recombination (case B), forbidden ones by their ratio to H-beta."""

from __future__ import annotations

from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from skyscatter.constants import LIGHT, PLANCK
from skyscatter.errors import DomainError
from skyscatter.optics.base import Array, Coefficients, OpticalModel
from skyscatter.optics.phase import Isotropic
from skyscatter.record import Record
from skyscatter.spectra.cells import cell_edges
from skyscatter.units import Kelvin, NumberDensity, PositiveNanometres, default

#: Vacuum wavelengths [nm] (NIST Atomic Spectra Database; the names carry the customary angstroms in air).
WAVELENGTHS = {
    "hbeta": 486.2680,
    "oiii_4959": 496.0295,
    "oiii_5007": 500.8240,
    "nii_6548": 654.9850,
    "halpha": 656.4610,
    "nii_6583": 658.5280,
    "sii_6716": 671.8290,
    "sii_6731": 673.2670,
}

#: Weaker line -> stronger line of the same upper level, and how many times brighter the stronger one is.
DOUBLETS = {
    "oiii_4959": ("oiii_5007", 2.98),  # Storey & Zeippen (2000), MNRAS 312, 813
    "nii_6548": ("nii_6583", 3.05),  # the same
}


class _Recombination(NamedTuple):
    """Effective recombination coefficient a T4^(b + c ln T4) [m3 s-1]."""

    a: float
    b: float
    c: float


#: Draine (2011), Physics of the Interstellar and Intergalactic Medium, eqs. 14.8 and 14.9: fits to Storey & Hummer
#: (1995), MNRAS 272, 41, case B, 100 electrons per cm3.
_EFFECTIVE = {"hbeta": _Recombination(3.03e-20, -0.874, -0.058), "halpha": _Recombination(1.17e-19, -0.942, -0.031)}
_COOLEST, _HOTTEST = 3000.0, 30000.0

_WIDTH = 1 / (2 * np.sqrt(2 * np.log(2)))  # standard deviation of a Gaussian over its full width at half maximum


def effective_recombination(line: str, temperature: float) -> float:
    """Case B rate of recombinations that end in a photon of a hydrogen line, per electron and proton.

    Parameters
    ----------
    line : {"hbeta", "halpha"}
    temperature : float
        Of the electrons [K], 3000 to 30000; the fit is within 1 % of Storey & Hummer (1995) from 5000 to 20000 K.

    Returns
    -------
    float
        Effective recombination coefficient [m3 s-1].
    """
    if line not in _EFFECTIVE:
        raise DomainError("line", line, f"recombination lines are {', '.join(_EFFECTIVE)}")
    check_temperature(temperature)
    fit, t4 = _EFFECTIVE[line], temperature / 1e4
    return float(fit.a * t4 ** (fit.b + fit.c * np.log(t4)))


def check_temperature(temperature: float) -> None:
    """Refuse temperatures at which the recombination fits do not hold."""
    if not _COOLEST <= temperature <= _HOTTEST:
        raise DomainError("temperature", temperature, f"ionised gas has {_COOLEST:g} to {_HOTTEST:g} K")


def photon_energy(line: str) -> float:
    """Energy of a photon of the line [J]."""
    return PLANCK * LIGHT / (WAVELENGTHS[line] * 1e-9)


class LineRatios(Record):
    """Energies of the stronger forbidden lines relative to H-beta = 1, before any dust; each zero by default.

    In a bright H II region [O III] 500.7 has some 3, [N II] 658.3 0.6, both lines of [S II] a few 0.01; in a planetary
    nebula [O III] has some 10; in faint H II regions and at ionisation fronts [S II] rivals H-beta.  The weaker lines
    of [O III] and [N II] follow from atomic physics: 1 / 2.98 of 500.7, 1 / 3.05 of 658.3 (Storey & Zeippen 2000).

    Parameters
    ----------
    oiii_5007, nii_6583, sii_6716, sii_6731 : float
        Energy of the line relative to H-beta.
    """

    oiii_5007: float = Field(default=0.0, ge=0.0)
    nii_6583: float = Field(default=0.0, ge=0.0)
    sii_6716: float = Field(default=0.0, ge=0.0)
    sii_6731: float = Field(default=0.0, ge=0.0)

    def ratio(self, name: str) -> float:
        """Energy of any of the forbidden lines relative to H-beta."""
        if name in DOUBLETS:
            stronger, times = DOUBLETS[name]
            return self.ratio(stronger) / times
        return float(getattr(self, name))


class GasLines(OpticalModel):
    """Gas that glows in lines and neither scatters nor absorbs.

    The density field means the product of electrons and protons, n_e n_p, relative to `electron_density` squared: the
    emission measure's integrand, not the gas.  H-beta gives off alpha_eff h nu n_e n_p / (4 pi) in case B, H-alpha its
    own rate (2.86 times H-beta at 10000 K), forbidden lines what `ratios` says.

    Parameters
    ----------
    electron_density : float
        Electrons (and protons) per volume where the density field is 1 [m-3]; 1e8 m-3 are 100 per cm3.
    temperature : float
        Of the electrons [K], 3000 to 30000.
    ratios : LineRatios
        Forbidden lines relative to H-beta.
    hydrogen : bool
        Whether hydrogen's own lines shine; without them the forbidden lines keep their strength, so that gas of
        another distribution can carry them as a component of its own.
    line_width : float
        Full width at half maximum of every line [nm].  The default, 0.05 nm, is hydrogen's thermal width at 10000 K.

    Examples
    --------
    >>> import skyscatter
    >>> gas = skyscatter.GasLines(electron_density="100 cm-3", temperature=8000, ratios={"oiii_5007": 3.0})
    >>> gas.line_names
    ('hbeta', 'oiii_4959', 'oiii_5007', 'halpha')
    >>> f"{gas.line_emissivity('hbeta'):.1e} W m-3 sr-1"
    '1.2e-23 W m-3 sr-1'
    >>> round(gas.line_emissivity("halpha") / gas.line_emissivity("hbeta"), 2)  # the Balmer decrement
    2.91
    """

    kind: Literal["gas-lines"] = "gas-lines"
    electron_density: NumberDensity
    temperature: Kelvin = default(1e4)
    ratios: LineRatios = LineRatios()
    hydrogen: bool = True
    line_width: PositiveNanometres = default(0.05)

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_temperature(self.temperature)
        return self

    @property
    def line_names(self) -> tuple[str, ...]:
        """Names of the lines that shine, by wavelength."""
        return tuple(name for name in WAVELENGTHS if self.line_emissivity(name) > 0)

    def line_emissivity(self, name: str) -> float:
        """Light of one line per unit density, over all its wavelengths [W m-3 sr-1]."""
        if name not in WAVELENGTHS:
            raise DomainError("line", name, f"known lines are {', '.join(WAVELENGTHS)}")
        recombines = name in _EFFECTIVE
        if recombines and not self.hydrogen:
            return 0.0
        source = name if recombines else "hbeta"
        rate = effective_recombination(source, self.temperature) * self.electron_density**2
        ratio = 1.0 if recombines else self.ratios.ratio(name)
        return rate * photon_energy(source) / (4 * np.pi) * ratio

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`.

        The emission is the mean of the Gaussian lines over the cell of each wavelength (`spectra.cells`), so that the
        sum of emission times width of the cells is the line, as far as it falls into the grid, however coarse.
        """
        low, high = cell_edges(wavelengths_nm)
        emission = np.zeros_like(low)
        for name in self.line_names:
            share = self._below(high, name) - self._below(low, name)
            emission += self.line_emissivity(name) * share / (high - low)
        zero = np.zeros_like(emission)
        return Coefficients(zero, zero, emission)

    def _below(self, wavelengths_nm: Array, name: str) -> Array:
        """Share of a line's light at shorter wavelengths."""
        from scipy.special import ndtr

        share: Array = ndtr((wavelengths_nm - WAVELENGTHS[name]) / (_WIDTH * self.line_width))
        return share

    def phase_function(self, wavelengths_nm: ArrayLike) -> Isotropic:
        """Isotropic: nothing is scattered."""
        return Isotropic()
