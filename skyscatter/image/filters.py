"""Filters: curves over wavelength, and pictures with a plane for each filter.

A filter averages the spectral radiance L over its band,

    L_band = ∫ L(λ) R(λ) w(λ) dλ / ∫ R(λ) w(λ) dλ,

with w = λ where R is a response per photon (CCDs and all modern instruments: ``weighting = "photon"``) and w = 1 where
it is one per energy (``"energy"``; the passbands of Bessell 1990).  Both are the averages of Bessell & Murphy (2012,
PASP 124, 140).  L_band is in W m-2 sr-1 nm-1 either way.

Each sampled wavelength stands for its cell, half-way to its neighbours (1 nm for a single one), in which L is constant.
So the light of a spectral line counts in full where its cell lies within the filter, and shared out over the cell where
the cell is wider than the filter: for narrow filters the wavelengths need cells no wider than they, as
`with_narrow_bands` makes them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationError, model_validator

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.record import Record, nearest
from skyscatter.spectra.cells import cell_edges
from skyscatter.spectra.table import SpectralTable

Array = NDArray[np.float64]

#: Least share of a filter's weight that a picture's wavelengths must cover.
COVERAGE = 0.9

#: Ideal narrow bands: centre and full width [nm, vacuum], a box.  Centres are those of Hα, Hβ, [O III] 5007,
#: [N II] 6583 and the middle of the doublet [S II] 6716, 6731; widths follow the filters F656N, F487N, F502N, F658N
#: and, narrower, F673N of the camera WFC3 of the Hubble Space Telescope, such that no band holds a line of another.
NARROW = {
    "halpha": (656.46, 2.0),
    "hbeta": (486.27, 6.0),
    "oiii": (500.82, 6.0),
    "nii": (658.53, 2.0),
    "sii": (672.55, 6.0),
}
BROAD = ("U", "B", "V", "R", "I")


class FilterCurve(Record):
    """Response of a filter: linear between its nodes, zero outside them.

    Parameters
    ----------
    name : str
        Letters, digits and ``_ . + -``, 40 at most.
    wavelengths : tuple of float
        Nodes, rising [nm, vacuum]; two at least.
    response : tuple of float
        At each node; the scale does not matter to averages.
    weighting : {"photon", "energy"}
        Whether the response counts photons or energy; see `skyscatter.image.filters`.

    Raises
    ------
    ValidationError
        For nodes that do not rise or a response that is negative, or zero everywhere; it is a ValueError.

    Examples
    --------
    >>> import skyscatter
    >>> curve = skyscatter.FilterCurve(name="green", wavelengths=(500, 550, 600), response=(0, 1, 0))
    >>> round(curve.centre, 2), round(curve.pivot, 2)  # nm
    (550.76, 549.62)
    >>> weights, coverage = curve.weights([500, 550, 600])  # for the average of a spectrum with these wavelengths
    >>> weights.round(2), coverage
    (array([0.12, 0.75, 0.13]), 1.0)
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,39}$")]
    wavelengths: tuple[float, ...]  #: [nm, vacuum]
    response: tuple[float, ...]
    weighting: Literal["photon", "energy"] = "photon"

    @model_validator(mode="after")
    def _check(self) -> FilterCurve:
        if len(self.wavelengths) != len(self.response) or len(self.wavelengths) < 2:
            raise ValueError("wavelengths and response need the same length, at least 2")
        if np.any(np.diff(self.wavelengths) <= 0) or self.wavelengths[0] <= 0:
            raise ValueError("wavelengths must be positive and increase")
        if min(self.response) < 0 or max(self.response) <= 0:
            raise ValueError("the response must not be negative, nor zero everywhere")
        return self

    @classmethod
    def box(cls, name: str, centre_nm: float, width_nm: float) -> FilterCurve:
        """Band of a centre and a full width [nm] with the response 1 inside."""
        if not 0.0 < width_nm < 2.0 * centre_nm:
            raise DomainError("width_nm", width_nm, f"a width above 0 and below twice the centre of {centre_nm:g} nm")
        return cls(name=name, wavelengths=(centre_nm - width_nm / 2, centre_nm + width_nm / 2), response=(1.0, 1.0))

    @classmethod
    def from_table(
        cls, name: str, table: SpectralTable, weighting: Literal["photon", "energy"] = "photon"
    ) -> FilterCurve:
        """Filter from a table over wavelength."""
        return cls(name=name, wavelengths=table.wavelengths, response=table.values, weighting=weighting)

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str]) -> FilterCurve:
        """Filter from a file with two columns, wavelength [nm] and response per photon; its name is the file's.

        Columns stand apart by commas or blanks; ``#`` starts a remark, and one line of column names may come first.
        """
        file = Path(path)
        if not file.is_file():
            raise MissingDataError(path, "there is no such filter file; check the path")
        lines = [line.split("#")[0].replace(",", " ").split() for line in file.read_text(encoding="utf-8").splitlines()]
        rows = [line for line in lines if line]
        try:
            if rows and not _is_number(rows[0][0]):
                rows = rows[1:]
            table = np.array(rows, dtype=float)
            if table.ndim != 2 or table.shape[1] != 2:
                raise ValueError("not two columns")
            return cls(name=file.stem, wavelengths=tuple(table[:, 0]), response=tuple(table[:, 1]))
        except ValueError as error:
            problem = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            remedy = f"needs two columns, wavelength [nm] and response ({problem})"
            raise DomainError("filter file", str(path), remedy) from error

    @property
    def centre(self) -> float:
        """Mean wavelength [nm], weighted as the filter weights light."""
        power = 1 if self.weighting == "photon" else 0
        low, high = np.array(self.wavelengths[:1]), np.array(self.wavelengths[-1:])
        return float((_integral(self, low, high, power + 1) / _integral(self, low, high, power))[0])

    @property
    def pivot(self) -> float:
        """Pivot wavelength [nm]: ``∫ T λ dλ / ∫ T / λ dλ`` is its square, T the share of photons that pass."""
        power = 1 if self.weighting == "photon" else 0
        return float(np.sqrt(_moment(self, power) / _moment(self, power - 2)))

    @property
    def photon_width(self) -> float:
        """``∫ T λ dλ`` [nm2]; a response per energy counts as one per photon that agrees at the pivot wavelength."""
        return _moment(self, 1) if self.weighting == "photon" else self.pivot * _moment(self, 0)

    def weights(self, wavelengths_nm: ArrayLike) -> tuple[Array, float]:
        """Share of each wavelength's cell in the band average, and the share of the filter that the cells cover.

        Returns
        -------
        weights : ndarray, shape (wavelength,)
            Sum 1, so that a flat spectrum keeps its value also where a part of the filter lies beyond the ends.
        coverage : float

        Raises
        ------
        DomainError
            If the cells cover less than 90 % of the filter.
        """
        low, high = cells(wavelengths_nm)
        power = 1 if self.weighting == "photon" else 0
        parts = _integral(self, low, high, power)
        whole = _integral(self, np.array(self.wavelengths[:1]), np.array(self.wavelengths[-1:]), power)[0]
        coverage = float(parts.sum() / whole)
        if coverage < COVERAGE:
            band, have = self._span(), f"{low[0]:g} to {high[-1]:g} nm"
            remedy = f"needs light from {band}; the wavelengths cover {have}, {100 * coverage:.0f} % of it"
            raise DomainError("filter", self.name, remedy)
        return parts / parts.sum(), min(coverage, 1.0)

    def _span(self) -> str:
        lit = np.flatnonzero(np.array(self.response) > 0)
        first, last = max(lit[0] - 1, 0), min(lit[-1] + 1, len(self.wavelengths) - 1)
        return f"{self.wavelengths[first]:g} to {self.wavelengths[last]:g} nm"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _integral(curve: FilterCurve, low: Array, high: Array, power: int) -> Array:
    """``∫ R(λ) λ**power dλ`` from each `low` to each `high` [nm]; exact for powers up to 2."""
    nodes = np.array(curve.wavelengths)
    start, stop = np.clip(low, nodes[0], nodes[-1]), np.clip(high, nodes[0], nodes[-1])
    grid = np.unique(np.concatenate([nodes, start, stop]))
    middle = 0.5 * (grid[1:] + grid[:-1])

    def value(x: Array) -> Array:
        return np.interp(x, nodes, curve.response) * x**power

    # Simpson's rule is exact for the cubic that a linear response makes with λ².
    pieces = np.diff(grid) / 6.0 * (value(grid[:-1]) + 4.0 * value(middle) + value(grid[1:]))
    total = np.concatenate([[0.0], np.cumsum(pieces)])
    return total[np.searchsorted(grid, stop)] - total[np.searchsorted(grid, start)]


def _moment(curve: FilterCurve, power: int) -> float:
    """``∫ R(λ) λ**power dλ`` over the whole filter, exact for the powers -2 to 1."""
    nodes, response = np.array(curve.wavelengths), np.array(curve.response)
    slope = np.diff(response) / np.diff(nodes)
    start = response[:-1] - slope * nodes[:-1]

    def integral(exponent: int) -> Array:
        if exponent == -1:
            return np.log(nodes[1:] / nodes[:-1])
        return np.diff(nodes ** (exponent + 1.0)) / (exponent + 1.0)

    return float(np.sum(start * integral(power) + slope * integral(power + 1)))


def cells(wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
    """Lower and upper edges [nm] of the cells that sampled wavelengths stand for, each of shape (wavelength,)."""
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    return cell_edges(wl)


def with_narrow_bands(wavelengths_nm: ArrayLike, curves: Iterable[FilterCurve]) -> Array:
    """Wavelengths [nm] with a cell for each narrow band: a node at its middle, and one to each side for the edges.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
    curves : iterable of FilterCurve
        Those of `NARROW` count; of the others nothing is asked.

    Returns
    -------
    ndarray
        Nodes within one and a half widths of a band's middle have given way.  The cell edge between two bands that
        meet, Hα and [N II], lies half-way between their middles.
    """
    bands = [NARROW[curve.name] for curve in curves if curve == _narrow(curve.name)]
    middles = np.array([centre for centre, _ in bands])
    nodes = np.asarray(wavelengths_nm, dtype=float)
    for centre, width in bands:
        nodes = nodes[np.abs(nodes - centre) > 1.5 * width]
    for centre, width in bands:
        sides = np.array([centre - width, centre + width])
        others = [(middle, wide) for middle, wide in bands if middle != centre]
        for middle, wide in others:
            sides = sides[np.abs(sides - middle) > wide / 2]
        nodes = np.concatenate([nodes, sides])
    return np.unique(np.concatenate([nodes, middles]))


def _narrow(name: str) -> FilterCurve | None:
    return FilterCurve.box(name, *NARROW[name]) if name in NARROW else None


def filter_curve(given: Any) -> FilterCurve:
    """Filter from a name, the path of a csv file, or a `FilterCurve`.

    Names are U, B, V, R, I (Bessell 1990, PASP 102, 1181) and those of `NARROW`.

    Raises
    ------
    DomainError
        For an unknown name; the message lists them.
    """
    if isinstance(given, FilterCurve):
        return given
    if isinstance(given, os.PathLike) or (isinstance(given, str) and given.lower().endswith(".csv")):
        return FilterCurve.from_csv(given)
    if given in NARROW:
        return FilterCurve.box(given, *NARROW[given])
    if given in BROAD:
        table = read_table("bessell_ubvri.csv")
        lit = np.flatnonzero(table[given] > 0)
        part = slice(max(lit[0] - 1, 0), lit[-1] + 2)
        nodes, response = tuple(table["wavelength_nm"][part]), tuple(table[given][part])
        return FilterCurve(name=given, wavelengths=nodes, response=response, weighting="energy")
    remedy = nearest(given, (*BROAD, *NARROW)) if isinstance(given, str) else "a name, a .csv file or a FilterCurve"
    raise DomainError("filter", given, f"no such filter; {remedy}")


def filter_curves(given: str | Iterable[Any]) -> tuple[FilterCurve, ...]:
    """Filters, each only once; a text may name several, with commas between them."""
    words: Sequence[Any] = [word.strip() for word in given.split(",")] if isinstance(given, str) else list(given)
    curves = tuple(filter_curve(word) for word in words)
    names = [curve.name for curve in curves]
    for name in names:
        if names.count(name) > 1:
            raise DomainError("filters", name, "is named twice; give each filter once")
    if not curves:
        raise DomainError("filters", given, "name at least one filter")
    return curves
