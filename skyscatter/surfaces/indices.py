"""Refractive indices by name: water, glasses, metals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.record import nearest
from skyscatter.spectra.table import Spectral, bounds, evaluate

Array = NDArray[np.float64]

#: Glasses by Sellmeier's formula n^2 - 1 = sum of b w^2 / (w^2 - c), w [um]: pairs (b, c [um2]), range [nm].
#: Fused silica: Malitson 1965, J. Opt. Soc. Am. 55, 1205, whose c are squares.  N-BK7: Schott's data sheet (2017).
#: Both are relative to air; an index against vacuum is larger by 3e-4 of it.
_SELLMEIER: dict[str, tuple[tuple[tuple[float, float], ...], tuple[float, float]]] = {
    "fused-silica": (
        ((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)),
        (210.0, 3710.0),
    ),
    "bk7": (
        ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
        (300.0, 2500.0),
    ),
}
#: Clear substances by name.
SUBSTANCES = ("water", *_SELLMEIER)
#: Metals by name, and the shipped table that has them.
METALS = {"gold": "metals.csv", "silver": "metals.csv", "copper": "metals.csv", "aluminium": "aluminium.csv"}
#: No index of a clear substance or of a metal lies beyond.
_HIGHEST = 10.0


def _check_range(name: str, wavelengths: Array, low: float, high: float) -> None:
    outside = (wavelengths < low) | (wavelengths > high)
    if outside.any():
        allowed = f"the index of {name} is known from {low:g} to {high:g} nm; give a number or a table for others"
        raise DomainError("wavelength", float(wavelengths[outside][0]), allowed)


def check_index(value: Spectral | str, name: str = "index") -> None:
    """Refuse what is no refractive index of a clear substance."""
    if isinstance(value, str):
        if value not in SUBSTANCES:
            raise DomainError(name, value, f"no such substance; {nearest(value, SUBSTANCES)}")
        return
    low, high = bounds(value)
    if not (low > 0.1 and high <= _HIGHEST):
        raise DomainError(name, low if low <= 0.1 else high, f"a refractive index lies between 0.1 and {_HIGHEST:g}")


def refractive_index(value: Spectral | str, wavelengths_nm: ArrayLike) -> Array:
    """Refractive index of a clear substance, shape (wavelength,).

    Parameters
    ----------
    value : float, SpectralTable or str
        ``"water"`` (Segelstein 1981), ``"bk7"``, ``"fused-silica"``, or the index itself.
    wavelengths_nm : array_like, shape (wavelength,)
        In vacuum.

    Returns
    -------
    ndarray, shape (wavelength,)

    Raises
    ------
    DomainError
        If the name is unknown, or a wavelength lies outside the range of a named substance.

    Notes
    -----
    Glasses follow Sellmeier's formula, relative to air: fused silica by Malitson (1965), J. Opt. Soc. Am. 55, 1205,
    from 210 to 3710 nm; N-BK7 by Schott's data sheet (2017), from 300 to 2500 nm.  Water is known from 200 to 2500 nm.

    Examples
    --------
    Glass bends blue light more than red; its Abbe number is (n_d - 1) / (n_F - n_C):

    >>> from skyscatter import surfaces
    >>> blue, yellow, red = surfaces.refractive_index("bk7", [486.1, 587.6, 656.3])
    >>> print(f"{yellow:.4f} {(yellow - 1) / (blue - red):.0f}")
    1.5168 64
    """
    check_index(value)
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    if not isinstance(value, str):
        return evaluate(value, wl)
    if value == "water":
        table = read_table("water_refractive_index.csv")
        _check_range(value, wl, table["wavelength_nm"][0], table["wavelength_nm"][-1])
        return np.interp(wl, table["wavelength_nm"], table["real"])
    terms, (low, high) = _SELLMEIER[value]
    _check_range(value, wl, low, high)
    w2 = (1e-3 * wl) ** 2
    return np.sqrt(1.0 + sum(b * w2 / (w2 - c) for b, c in terms))


def check_metal(name: str) -> None:
    """Refuse an unknown metal."""
    if name not in METALS:
        raise DomainError("metal", name, f"no such metal; {nearest(name, METALS)}")


def metal_index(name: str, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
    """Real and imaginary part, n and k, of a metal's refractive index, each of shape (wavelength,).

    Raises
    ------
    DomainError
        If the name is unknown, or a wavelength lies outside the measured range.
    """
    check_metal(name)
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    table = read_table(METALS[name])
    nodes = table["wavelength_nm"]
    _check_range(name, wl, nodes[0], nodes[-1])
    return np.interp(wl, nodes, table[f"{name}_n"]), np.interp(wl, nodes, table[f"{name}_k"])
