"""Interstellar dust: extinction, albedo and phase function by wavelength, as tabulated for the Milky Way.

The mixtures of carbonaceous and silicate grains of Weingartner & Draine (2001), ApJ 548, 296, with the abundances of
Draine (2003), ARA&A 41, 241, from Draine's own tables (`data/README.md`).
"""

from __future__ import annotations

from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.optics.base import Array, Coefficients, OpticalModel
from skyscatter.optics.phase import Draine, HenyeyGreenstein, draine_mean_cosine
from skyscatter.spectra.table import SpectralTable
from skyscatter.units import Extinction, MassDensity, NonNegative, NumberDensity, OptionalNumber, default

_TABLE = "dust_draine2003.csv"

VISUAL_WAVELENGTH = 550.0  #: where A_V counts [nm]
MAGNITUDE = 2.5 / np.log(10.0)  #: magnitudes of extinction in one optical depth, 1.0857

#: Range of the shape parameter of Draine's phase function: up to the dipole's; beyond 1 a lobe straight back, stronger
#: than any small grain's, would appear.  Down to where it stays clear of zero at right angles to the light.
_ALPHA_LOW, _ALPHA_HIGH = -0.5, 1.0


class DustMass(NamedTuple):
    """What the headers of Draine's tables say of a mixture besides its optics."""

    column: str  #: name of its columns in the table
    per_hydrogen: float  #: mass of dust per hydrogen nucleon [kg]
    gas_to_dust: float  #: mass of gas (hydrogen and 0.096 helium atoms per hydrogen) over mass of dust


MIXTURES = {
    "milky-way-3.1": DustMass("3.1", 1.870e-29, 123.6),
    "milky-way-4.0": DustMass("4.0", 1.969e-29, 117.4),
    "milky-way-5.5": DustMass("5.5", 2.199e-29, 105.1),
}


class DustProperties(NamedTuple):
    """Optics of a mixture per wavelength; each of shape (wavelength,)."""

    cross_section: Array  #: extinction per hydrogen nucleon [m2]
    albedo: Array
    mean_cosine: Array
    mean_squared_cosine: Array


def dust_properties(mixture: str, wavelengths_nm: ArrayLike) -> DustProperties:
    """Optics of a mixture of dust.

    Between the 251 rows of the table the logarithm of the extinction, the albedo and both moments are linear in the
    logarithm of the wavelength.

    Parameters
    ----------
    mixture : {"milky-way-3.1", "milky-way-4.0", "milky-way-5.5"}
        The number is R_V = A_V / E(B - V).
    wavelengths_nm : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], 91.2 to 10000.

    Returns
    -------
    DustProperties

    Raises
    ------
    DomainError
        For an unknown mixture or a wavelength outside the table.
    """
    if mixture not in MIXTURES:
        raise DomainError("mixture", mixture, f"known mixtures are {', '.join(MIXTURES)}")
    table, name = read_table(_TABLE), MIXTURES[mixture].column
    nodes = table["wavelength_nm"]
    wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
    outside = wl[(wl < nodes[0]) | (wl > nodes[-1])]
    if outside.size:
        raise DomainError("wavelength", float(outside[0]), f"dust is tabulated from {nodes[0]:g} to {nodes[-1]:g} nm")
    x, at = np.log(nodes), np.log(wl)
    section = np.exp(np.interp(at, x, np.log(table[f"extinction_{name}"])))
    return DustProperties(section, *(np.interp(at, x, table[f"{key}_{name}"]) for key in ("albedo", "g", "cos2")))


def draine_mean_square(g: ArrayLike, alpha: ArrayLike) -> Array:
    """Mean squared cosine of Draine's phase function, from the moments of Henyey-Greenstein's up to the fourth."""
    g, alpha = np.asarray(g, float), np.asarray(alpha, float)
    second, fourth = (1 + 2 * g**2) / 3, (7 + 20 * g**2 + 8 * g**4) / 35
    mean: Array = (second + alpha * fourth) / (1 + alpha * second)
    return mean


def draine_parameters(mean_cosine: ArrayLike, mean_squared_cosine: ArrayLike) -> tuple[Array, Array]:
    """Parameters g and alpha of Draine's phase function with given moments of the cosine.

    The mean cosine is always matched.  The mean squared cosine is matched where alpha then lies between -0.5 and 1, and
    else approached as nearly as this range allows.

    Parameters
    ----------
    mean_cosine, mean_squared_cosine : array_like, shape (wavelength,)

    Returns
    -------
    g, alpha : ndarray, shape (wavelength,)
    """
    first = np.atleast_1d(np.asarray(mean_cosine, float))
    second = np.atleast_1d(np.asarray(mean_squared_cosine, float))
    # At a fixed mean cosine the mean square rises with alpha, so that one bisection inside the other finds the pair.
    low, high = np.full(first.shape, _ALPHA_LOW), np.full(first.shape, _ALPHA_HIGH)
    for _ in range(44):
        alpha = 0.5 * (low + high)
        more = draine_mean_square(_g_of_mean(first, alpha), alpha) < second
        low, high = np.where(more, alpha, low), np.where(more, high, alpha)
    alpha = 0.5 * (low + high)
    return _g_of_mean(first, alpha), alpha


def _g_of_mean(mean: Array, alpha: Array) -> Array:
    """Parameter g at which Draine's phase function of shape `alpha` has this mean cosine, which rises with g."""
    low, high = np.full(mean.shape, -1.0), np.full(mean.shape, 1.0)
    for _ in range(54):  # each step is one bit of the result
        middle = 0.5 * (low + high)
        below = draine_mean_cosine(middle, alpha) < mean
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


class Dust(OpticalModel):
    """Dust of the Milky Way, its amount given in one of three ways.

    Parameters
    ----------
    mixture : {"milky-way-3.1", "milky-way-4.0", "milky-way-5.5"}
        Weingartner & Draine (2001) with Draine (2003), by R_V: diffuse clouds have 3.1, dense ones about 5.
    visual_extinction : float, optional
        A_V [mag] through the density field's reference column (for a field in space: through its centre along its
        z axis).  The optical depth at 550 nm is A_V / 1.0857.
    hydrogen_density : float, optional
        Hydrogen nucleons per volume where the density is 1 [m-3].
    dust_density : float, optional
        Mass of dust per volume where the density is 1 [kg m-3].
    dust_to_gas : float, optional
        Only with `hydrogen_density`: mass of dust over mass of gas (hydrogen and helium).  The mixture's own
        (1/123.6, 1/117.4, 1/105.1) when not given; twice as much is twice the extinction.
    phase : {"henyey-greenstein", "draine"}
        Henyey-Greenstein with the tabulated mean cosine, or Draine (2003), ApJ 598, 1017, which matches
        the tabulated mean squared cosine too wherever `draine_parameters` can.

    Examples
    --------
    A thousand hydrogen nucleons in a cubic centimetre with their dust: the mean free path of blue and of red light in
    parsec, and the scattered part of the extinction.

    >>> import skyscatter
    >>> dust = skyscatter.Dust(hydrogen_density="1000 cm-3")
    >>> scattering, absorption, _ = dust.coefficients([450, 650], column_m=0.0)  # m-1; the column counts with A_V only
    >>> (1 / (scattering + absorption) / 3.0857e16).round(2)
    array([0.52, 0.84])
    >>> (scattering / (scattering + absorption)).round(2)
    array([0.66, 0.67])
    """

    kind: Literal["dust"] = "dust"
    mixture: str = "milky-way-3.1"
    visual_extinction: OptionalNumber[Extinction] = default(None)
    hydrogen_density: OptionalNumber[NumberDensity] = default(None)
    dust_density: OptionalNumber[MassDensity] = default(None)
    dust_to_gas: OptionalNumber[NonNegative] = default(None)
    phase: Literal["henyey-greenstein", "draine"] = "henyey-greenstein"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.mixture not in MIXTURES:
            raise DomainError("mixture", self.mixture, f"known mixtures are {', '.join(MIXTURES)}")
        amounts = ("visual_extinction", "hydrogen_density", "dust_density")
        given = [name for name in amounts if getattr(self, name) is not None]
        if len(given) != 1:
            raise DomainError("dust", ", ".join(given), f"give exactly one of {', '.join(amounts)}")
        if self.dust_to_gas is not None and self.hydrogen_density is None:
            raise DomainError("dust_to_gas", self.dust_to_gas, "goes with hydrogen_density; leave it out")
        return self

    def hydrogen_per_volume(self, column_m: float) -> float:
        """Hydrogen nucleons [m-3] that would bring the dust of unit density along in the mixture's own proportion.

        Parameters
        ----------
        column_m : float
            The density field's reference column [m]; of use only with `visual_extinction`.
        """
        mass = MIXTURES[self.mixture]
        if self.hydrogen_density is not None:
            relative = 1.0 if self.dust_to_gas is None else self.dust_to_gas * mass.gas_to_dust
            return self.hydrogen_density * relative
        if self.dust_density is not None:
            return self.dust_density / mass.per_hydrogen
        if not column_m > 0:
            raise DomainError("column", column_m, "a density field with a positive column, or another amount than A_V")
        visual = float(dust_properties(self.mixture, [VISUAL_WAVELENGTH]).cross_section[0])
        return (self.visual_extinction or 0.0) / MAGNITUDE / (column_m * visual)

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Coefficients per unit density; see `OpticalModel`."""
        properties = dust_properties(self.mixture, wavelengths_nm)
        extinction = self.hydrogen_per_volume(column_m) * properties.cross_section
        scattering = extinction * properties.albedo
        return Coefficients(scattering, extinction - scattering, np.zeros_like(extinction))

    def phase_function(self, wavelengths_nm: ArrayLike) -> HenyeyGreenstein | Draine:
        """The phase function with its parameters at these wavelengths, linear between them."""
        wl = np.unique(np.asarray(wavelengths_nm, float))
        properties = dust_properties(self.mixture, wl)
        nodes = tuple(wl)
        if self.phase == "henyey-greenstein":
            return HenyeyGreenstein(g=SpectralTable(wavelengths=nodes, values=tuple(properties.mean_cosine)))
        g, alpha = draine_parameters(properties.mean_cosine, properties.mean_squared_cosine)
        return Draine(
            g=SpectralTable(wavelengths=nodes, values=tuple(g)),
            alpha=SpectralTable(wavelengths=nodes, values=tuple(alpha)),
        )
