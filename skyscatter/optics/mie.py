"""Spherical particles: log-normal size distributions through Mie theory.

Efficiencies, asymmetry and scattering matrix follow from the Mie coefficients a_n, b_n by Bohren & Huffman 1983
(Absorption and Scattering of Light by Small Particles), equations 4.61, 4.62, 4.77 and the asymmetry formula of section
4.5; `spheres` computes the coefficients of all sizes together.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from skyscatter import units
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.optics.spheres import coefficients, scattering_elements, series_length
from skyscatter.record import Record
from skyscatter.spectra.table import OptionalSpectral, SpectralNonNegative, SpectralPositive, evaluate
from skyscatter.tablefile import TableRecord, Wanted
from skyscatter.units import (
    Densities,
    NonNegative,
    NumberDensity,
    OptionalNumber,
    PositiveMetres,
    PositiveNanometres,
    PositiveNumber,
    Radii,
    default,
)
from skyscatter.workers import steady_algebra

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MATERIALS = {"water": "water_refractive_index.csv"}

_NARROW = 1.2  # below this geometric standard deviation resonances survive: no interpolation over wavelength
_NODE_STEP = 0.08  # ratio of neighbouring wavelength nodes minus 1, in the logarithm
_SIZE_STEP = 0.01  # step of the size quadrature in the logarithm of the radius
_WINDOW = 4.5  # half width of the size quadrature in standard deviations
#: Standard deviations of ln r from the median beyond which there is nothing of a mode: one particle in 1e197.
_NO_TAIL = 30.0
#: Radius of the smallest atom [m]: sizes far below it have powers that are no numbers any more.
_ATOM = 1e-11
#: Largest size parameters, outside and inside the spheres, that are summed within a minute and a gigabyte.
_LARGEST, _LARGEST_NARROW, _LARGEST_INSIDE = 20_000.0, 2_000.0, 100_000.0


class LogNormalMode(Record):
    """One log-normal mode, dN/dln r = N exp(-ln(r / median)^2 / (2 s^2)) / (s sqrt(2 pi)), s = ln of `geometric_...`.

    Parameters
    ----------
    median_radius : float
        Median (by number) radius [m].
    geometric_standard_deviation : float
        At least 1; exactly 1 means a single size.
    fraction : float
        Number of particles relative to the other modes.
    min_radius, max_radius : float, optional
        Particles outside do not exist [m].  `fraction` and a number density count the mode before this cut.
    """

    median_radius: PositiveMetres
    geometric_standard_deviation: float = Field(ge=1.0, le=5.0)
    fraction: PositiveNumber = default(1.0)
    min_radius: OptionalNumber[PositiveMetres] = default(None)
    max_radius: OptionalNumber[PositiveMetres] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        low, high = self.min_radius or 0.0, self.max_radius or np.inf
        if low >= high or (self.geometric_standard_deviation == 1.0 and not low <= self.median_radius <= high):
            raise ValueError("min_radius and max_radius leave no particles")
        deviation = np.log(self.geometric_standard_deviation)
        for cut, side in ((self.max_radius, -1.0), (self.min_radius, 1.0)):
            if cut is not None and side * np.log(cut / self.median_radius) > _NO_TAIL * deviation:
                raise ValueError("min_radius and max_radius leave no particles")
        return self

    @classmethod
    def from_effective(cls, effective_radius: float, effective_variance: float, fraction: float = 1.0) -> Self:
        """Mode with the given effective radius [m] and variance (Hansen & Travis 1974, equations 2.53 and 2.54).

        For a log-normal, variance = exp(s^2) - 1 and radius = median exp(5 s^2 / 2).
        """
        s2 = np.log1p(effective_variance)
        return cls(
            median_radius=float(effective_radius * np.exp(-2.5 * s2)),
            geometric_standard_deviation=float(np.exp(np.sqrt(s2))),
            fraction=fraction,
        )

    @property
    def effective_radius(self) -> float:
        """Third over second moment of the radius before any cut [m]."""
        return float(self.median_radius * np.exp(2.5 * np.log(self.geometric_standard_deviation) ** 2))

    def sizes(self, wavelength_m: float) -> tuple[Array, Array]:
        """Radii [m] and numbers of the size quadrature (a trapezoid in ln r; the numbers sum to at most 1).

        The window is centred on the geometric cross section, e^(2 s^2) above the median, and reaches up to the sixth
        moment as long as particles there are small against the wavelength.
        """
        s = float(np.log(self.geometric_standard_deviation))
        if s == 0.0:
            return np.array([self.median_radius]), np.array([1.0])
        middle = np.log(self.median_radius)
        rayleigh_top = max(np.log(wavelength_m / 2.0), middle + 2 * s * s + _WINDOW * s)
        low = middle + 2 * s * s - _WINDOW * s
        high = min(middle + 6 * s * s + _WINDOW * s, rayleigh_top)
        low = max(low, np.log(self.min_radius)) if self.min_radius else low
        high = min(high, np.log(self.max_radius)) if self.max_radius else high
        if high <= low:  # the cuts leave only a far tail
            low, high = (np.log(v) if v else low for v in (self.min_radius, self.max_radius))
        count = int(np.ceil((high - low) / min(_SIZE_STEP, s / 8.0))) + 1
        x = np.linspace(low, high, max(count, 3))
        weight = np.exp(-0.5 * ((x - middle) / s) ** 2) / (s * np.sqrt(2 * np.pi)) * (x[1] - x[0])
        weight[[0, -1]] *= 0.5
        return np.exp(x), weight


class SizeTable(TableRecord):
    """A size distribution as a table, dN/dln r at radii, linear in ln r between them and zero outside.

    Parameters
    ----------
    radii : tuple of length
        Rising [m]; at least 2.
    numbers : tuple of float
        dN/dln r at the radii in any unit, never negative; normalised on reading.
    fraction : float
        Number of particles relative to the other modes, above 0.
    file : str, optional
        CSV or netCDF file with the columns instead, such as ``radius [um],dn_dlnr``; in a model file the path counts
        from its folder.
    column : str, optional
        Which column of the file has the numbers, where there are several.
    """

    columns: ClassVar[dict[str, Wanted]] = {
        "radii": Wanted(("radius", "r"), units.LENGTH.within(0.0, above=True), rising=True),
        "numbers": Wanted(("number", "dn_dlnr", "dn/dlnr", "dndlnr"), units.RELATIVE_AMOUNT),
    }

    radii: Radii
    numbers: Densities
    fraction: PositiveNumber = default(1.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.radii) != len(self.numbers) or len(self.radii) < 2:
            raise DomainError("radii", len(self.radii), "needs at least 2 radii, as many as numbers")
        if np.any(np.diff(self.radii) <= 0):
            raise DomainError("radii", self.radii, "must increase")
        if not max(self.numbers) > 0:
            raise DomainError("numbers", max(self.numbers), "must not be zero everywhere")
        return self

    @property
    def geometric_standard_deviation(self) -> float:
        """Exponential of the standard deviation of ln r."""
        radius, number = self.sizes(500e-9)
        x = np.log(radius)
        return float(np.exp(np.sqrt(number @ (x - number @ x) ** 2)))

    def sizes(self, wavelength_m: float) -> tuple[Array, Array]:
        """Radii [m] and numbers of the size quadrature (a trapezoid in ln r; the numbers sum to 1)."""
        nodes = np.log(self.radii)
        pieces = [np.linspace(a, b, int(np.ceil((b - a) / _SIZE_STEP)) + 1)[:-1] for a, b in pairwise(nodes)]
        x = np.concatenate([*pieces, nodes[-1:]])
        cells = np.diff(x)
        weight = 0.5 * (np.append(cells, 0.0) + np.append(0.0, cells)) * np.interp(x, nodes, self.numbers)
        return np.exp(x), weight / weight.sum()


class _NodeOptics(NamedTuple):
    """Optics at one wavelength, averaged over sizes."""

    extinction: float  # m2 per particle
    scattering: float  # m2 per particle
    asymmetry: float
    matrix: Array  # sr-1, shape (4, angle): a1 = a2 (the phase function), a3 = a4, b1, b2


def _sort_of_mode(value: Any) -> str:
    """Which sort of mode a table means, by the fields that only one has."""
    given = value if isinstance(value, Mapping) else getattr(type(value), "model_fields", {})
    return "table" if not {"radii", "numbers", "file"}.isdisjoint(given) else "log-normal"


Mode = LogNormalMode | SizeTable
AnyMode = Annotated[
    Annotated[LogNormalMode, Tag("log-normal")] | Annotated[SizeTable, Tag("table")], Discriminator(_sort_of_mode)
]


class MieAerosol(OpticalModel):
    """Homogeneous spheres with a sum of size modes, log-normal or tabulated, and one refractive index.

    Extinction, single-scattering albedo, asymmetry and phase function are computed at wavelengths 8 % apart
    (550 nm among them) and interpolated: cross sections in the logarithm, the phase function linearly.  For modes as
    wide as 1.6 (geometric standard deviation) that is good to some 0.1 % in the cross sections and 1 % in the phase
    function, with a refractive index that is smooth on that scale.  Where a mode is narrower than 1.2 the asked
    wavelengths themselves are computed.  The cost grows with the square of the largest size parameter: give modes
    of coarse particles a `max_radius` (from 380 to 780 nm 10 um takes a third of a second, 30 um some two seconds).

    Give exactly one of `optical_depth` and `number_density`; give `material`, or both parts of the refractive index.

    Parameters
    ----------
    modes : tuple of LogNormalMode or SizeTable
        Size distributions; at least one.
    refractive_index_real, refractive_index_imag : float or SpectralTable, optional
        n and k of n + ik, k >= 0 (absorption).
    material : {"water"}, optional
        A tabulated refractive index (water: Segelstein 1981, 200 to 2500 nm).
    optical_depth : float, optional
        Vertical extinction optical depth at `wavelength`.
    wavelength : float
        Reference wavelength [nm] of `optical_depth`.
    number_density : float, optional
        Particles per volume where the density field is 1 [m-3], all modes together, before their cuts.
    """

    kind: Literal["mie"] = "mie"
    modes: Annotated[tuple[AnyMode, ...], Field(min_length=1)]
    refractive_index_real: OptionalSpectral[SpectralPositive] = default(None)
    refractive_index_imag: OptionalSpectral[SpectralNonNegative] = default(None)
    material: Literal["water"] | None = None
    optical_depth: OptionalNumber[NonNegative] = default(None)
    wavelength: PositiveNanometres = default(550.0)
    number_density: OptionalNumber[NumberDensity] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.optical_depth is None) == (self.number_density is None):
            raise ValueError("give exactly one of optical_depth and number_density")
        parts = (self.refractive_index_real, self.refractive_index_imag)
        if self.material is not None and parts != (None, None):
            raise ValueError("give material, or refractive_index_real and refractive_index_imag, not both")
        if self.material is None and None in parts:
            raise ValueError("give refractive_index_real and refractive_index_imag, or material")
        return self

    def refractive_index(self, wavelengths_nm: ArrayLike) -> Complex:
        """Refractive index n + ik, shape (wavelength,)."""
        if self.material is None:
            imaginary = evaluate(self.refractive_index_imag, wavelengths_nm)
            return evaluate(self.refractive_index_real, wavelengths_nm) + 1j * imaginary
        table = read_table(MATERIALS[self.material])
        wl, nodes = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float)), table["wavelength_nm"]
        if wl.size and not (nodes[0] <= wl.min() and wl.max() <= nodes[-1]):
            allowed = f"{self.material} is tabulated from {nodes[0]:g} to {nodes[-1]:g} nm"
            raise DomainError("wavelength", (wl.min(), wl.max()), allowed)
        # k spans decades: interpolate its logarithm.
        return np.interp(wl, nodes, table["real"]) + 1j * np.exp(np.interp(wl, nodes, np.log(table["imaginary"])))

    def optical_properties(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array, Array]:
        """Extinction cross section [m2 per particle], single-scattering albedo, asymmetry; shape (wavelength,) each."""
        wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
        nodes, optics = self._nodes(wl)
        x = np.log(nodes)
        extinction = np.exp(np.interp(np.log(wl), x, np.log([o.extinction for o in optics])))
        scattering = np.exp(np.interp(np.log(wl), x, np.log([o.scattering for o in optics])))
        # Linear in wavelength as the phase function is, so that both have the same mean cosine.
        asymmetry = np.interp(wl, nodes, [o.asymmetry for o in optics])
        return extinction, scattering / extinction, asymmetry

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        """Scattering and absorption per unit density; see `OpticalModel.coefficients`."""
        extinction, albedo, _ = self.optical_properties(wavelengths_nm)
        if self.number_density is not None:
            total = self.number_density * extinction
        else:
            if not column_m > 0:
                raise DomainError("column", column_m, "a density field with a positive vertical column")
            reference = self.optical_properties([self.wavelength])[0][0]
            total = (self.optical_depth or 0.0) / column_m * extinction / reference
        return Coefficients(total * albedo, total * (1.0 - albedo), np.zeros_like(total))

    def phase_table(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array, Array]:
        """Cosines (angle,), node wavelengths [nm] (node,) and phase function [sr-1] (angle, node).

        Every column integrates to 1 over the sphere when read as linear in the cosine.
        """
        cosines, nodes, elements = self._matrix_table(wavelengths_nm)
        return cosines, nodes, elements[0]

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        """The scattering-weighted mean over sizes as a `TabulatedPhase`, matrix included, for the wavelengths."""
        from skyscatter.optics.phase import TabulatedPhase

        cosines, nodes, elements = self._matrix_table(wavelengths_nm)
        a1, a3, b1, b2 = (tuple(tuple(row) for row in element.tolist()) for element in elements)
        return TabulatedPhase(
            cos_theta=tuple(cosines.tolist()),
            wavelengths=tuple(nodes.tolist()),
            values=a1,
            polarisation=(a1, a3, a3, b1, b2),  # spheres: a2 = a1, a4 = a3
        )

    def _matrix_table(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array, Array]:
        """Cosines (angle,), node wavelengths [nm] (node,) and a1, a3, b1, b2 [sr-1] (4, angle, node)."""
        nodes, optics = self._nodes(np.atleast_1d(np.asarray(wavelengths_nm, dtype=float)))
        return _cosines(self.modes), nodes, np.stack([o.matrix for o in optics], axis=2)

    def _nodes(self, wl: Array) -> tuple[Array, list[_NodeOptics]]:
        """Wavelengths [nm] that are computed for a request, ascending, and their optics."""
        if wl.size == 0 or not np.all(wl > 0):
            raise DomainError("wavelengths", wl.tolist(), "at least one, all positive")
        self.refractive_index(wl)  # refuses what the material's table does not hold, before nodes are cut to it
        if min(mode.geometric_standard_deviation for mode in self.modes) < _NARROW:
            nodes = np.unique(wl)
        else:
            low, high = (np.log(v / 550.0) / _NODE_STEP for v in (wl.min(), wl.max()))
            k = np.arange(np.floor(low + 1e-9), np.ceil(high - 1e-9) + 1)
            nodes = 550.0 * np.exp(_NODE_STEP * k)
            if self.material is not None:  # do not step over the end of the material's table
                nodes = np.unique(np.clip(nodes, *read_table(MATERIALS[self.material])["wavelength_nm"][[0, -1]]))
        index = self.refractive_index(nodes)
        return nodes, [_node(self.modes, float(w), complex(m)) for w, m in zip(nodes, index, strict=True)]


@lru_cache(maxsize=1024)
@steady_algebra()
def _node(modes: tuple[Mode, ...], wavelength_nm: float, index: complex) -> _NodeOptics:
    """Average over sizes at one wavelength."""
    wavelength = wavelength_nm * 1e-9
    pairs = [mode.sizes(wavelength) for mode in modes]
    total = sum(mode.fraction for mode in modes)
    radius = np.concatenate([r for r, _ in pairs])
    number = np.concatenate([w * mode.fraction / total for mode, (_, w) in zip(modes, pairs, strict=True)])
    order = np.argsort(radius)
    radius, number = radius[order], number[order]
    wavenumber = 2 * np.pi / wavelength
    _check_size(modes, float(radius[-1]), wavelength, index)
    a, b = coefficients(index, wavenumber * radius)
    n = np.arange(1, a.shape[1] + 1)
    to_area = number * 2 * np.pi / wavenumber**2
    extinction = to_area @ ((a + b).real @ (2 * n + 1.0))
    scattering = to_area @ ((np.abs(a) ** 2 + np.abs(b) ** 2) @ (2 * n + 1.0))
    next_a, next_b = (np.pad(c[:, 1:], ((0, 0), (0, 1))) for c in (a, b))
    forward = (a * next_a.conj() + b * next_b.conj()).real @ (n * (n + 2) / (n + 1.0))
    forward = forward + (a * b.conj()).real @ ((2 * n + 1) / (n * (n + 1.0)))
    asymmetry = 2.0 * (to_area @ forward) / scattering
    cosines = _cosines(modes)
    elements = scattering_elements(a, b, cosines, number, series_length(wavenumber * radius))
    matrix = elements / (2 * np.pi * np.trapezoid(elements[0], cosines))
    matrix.flags.writeable = False
    return _NodeOptics(float(extinction), float(scattering), float(asymmetry), matrix)


def _check_size(modes: tuple[Mode, ...], radius: float, wavelength: float, index: complex) -> None:
    """Refuse atoms, and what takes hours: the largest radius [m] or the refractive index beside the wavelength [m]."""
    if not radius >= _ATOM:
        rule = f'no particle is smaller than an atom, {_ATOM:g} m; write units, as in "0.2 um"'
        raise DomainError("modes", f"radii up to {radius:.3g} m", rule)
    narrow = min(mode.geometric_standard_deviation for mode in modes) < _NARROW
    allowed = (_LARGEST_NARROW if narrow else _LARGEST) * wavelength / (2 * np.pi)
    beside = f"beside a wavelength of {wavelength * 1e9:g} nm"
    if not radius <= allowed:
        rule = f'{beside} the modes may reach up to {allowed:.2g} m; write units, as in "0.2 um", or give a max_radius'
        raise DomainError("modes", f"radii up to {radius:.3g} m", rule)
    steepest = _LARGEST_INSIDE * wavelength / (2 * np.pi * radius)
    if not abs(index) <= steepest:
        rule = f"{beside} and for radii up to {radius:.2g} m its absolute value must not exceed {steepest:.3g}"
        raise DomainError("refractive_index", f"{index.real:g} + {index.imag:g}i", rule)


@lru_cache(maxsize=64)
def _cosines(modes: tuple[Mode, ...]) -> Array:
    """Cosines from -1 to 1, crowded where the largest particles diffract and where the glory stands.

    The first step is a fraction of the diffraction angle, 1 over the size parameter at 300 nm of the radius below
    which 95 % of the forward intensity (fourth moment) arises; steps grow by 8 % to one degree, or stay at that
    fraction where a narrow mode leaves interference fringes over all angles.
    """
    largest = 0.0
    for mode in modes:
        radius, number = mode.sizes(300e-9)
        share = np.cumsum(number * radius**4)
        largest = max(largest, float(radius[np.searchsorted(share, 0.95 * share[-1])]))
    first = min(0.25 * 300e-9 / (2 * np.pi * largest), np.radians(1.0))
    narrow = min(mode.geometric_standard_deviation for mode in modes) < _NARROW
    coarsest = first if narrow else np.radians(1.0)
    forward = _growing(first, coarsest, np.pi / 2)
    backward = _growing(min(2.0 * first, coarsest), coarsest, np.pi / 2)
    cosines = np.concatenate([-np.cos(backward), np.cos(forward[-2::-1])])
    cosines[[0, -1]] = -1.0, 1.0
    cosines.flags.writeable = False
    return cosines


def _growing(first: float, coarsest: float, end: float) -> Array:
    """Angles from 0 to `end` whose steps grow by 8 % from `first` to `coarsest`."""
    angles = [0.0]
    step = first
    while angles[-1] < end:
        angles.append(angles[-1] + step)
        step = min(step * 1.08, coarsest)
    return np.array(angles) * (end / angles[-1])
