"""From spectra to colour: CIE XYZ, linear RGB, correlated colour temperature, dominant wavelength.

XYZ are absolute: Y is the luminance in cd m-2 (683 lm W-1 at the peak of the observer, CIE 015:2018, eq. 7.1).  Linear
RGB carries the same scale: a white of 1 cd m-2 is R = G = B = 1.
"""

from __future__ import annotations

import re
from difflib import get_close_matches
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.datafiles import data_path
from skyscatter.errors import DomainError

Array = NDArray[np.float64]

LUMINOUS_EFFICACY = 683.0  #: [lm W-1], CIE 015:2018
_C2 = 1.438776877e7  # second radiation constant h c / k [nm K], exact in the SI of 2019
_D65 = (0.3127, 0.3290)


class ColourSpace(NamedTuple):
    """Primaries and white of an RGB space (CIE 1931 x, y); `cicp`: its code in ITU-T H.273 if it has one."""

    name: str
    red: tuple[float, float]
    green: tuple[float, float]
    blue: tuple[float, float]
    white: tuple[float, float]
    cicp: int | None


#: sRGB: IEC 61966-2-1; Display P3: SMPTE EG 432-1 with D65; Rec.2020: ITU-R BT.2020-2; ACEScg: AMPAS S-2014-004.
SPACES: dict[str, ColourSpace] = {
    space.name: space
    for space in (
        ColourSpace("srgb", (0.64, 0.33), (0.30, 0.60), (0.15, 0.06), _D65, 1),
        ColourSpace("display-p3", (0.68, 0.32), (0.265, 0.69), (0.15, 0.06), _D65, 12),
        ColourSpace("rec2020", (0.708, 0.292), (0.17, 0.797), (0.131, 0.046), _D65, 9),
        ColourSpace("acescg", (0.713, 0.293), (0.165, 0.83), (0.128, 0.044), (0.32168, 0.33767), None),
    )
}

# Cone-like responses in which a change of white is a change of gains (Lam 1985, "Bradford").
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def colour_space(name: str) -> ColourSpace:
    """A space by its name: one of the four, or any that colour-science knows, with hyphens for what is no letter.

    Parameters
    ----------
    name : str
        Such as "srgb", "prophoto-rgb" or "adobe-rgb-1998"; capitals, blanks and brackets make no difference.

    Returns
    -------
    ColourSpace

    Raises
    ------
    DomainError
        For a name that neither knows.

    Examples
    --------
    >>> from skyscatter.image.colour import colour_space
    >>> colour_space("Adobe RGB (1998)").green
    (0.21, 0.71)
    """
    if name in SPACES:
        return SPACES[name]
    others = _others()
    found = others.get(_plain(name))
    if found is None:
        near = get_close_matches(_plain(name), others, 1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise DomainError("colour space", name, f"one of {', '.join(SPACES)}, or any of colour-science{meant}")
    return found


def _plain(name: str) -> str:
    """A name in small letters and digits, with hyphens for all else."""
    return re.sub("[^a-z0-9.]+", "-", name.lower()).strip("-")


@cache
def _others() -> dict[str, ColourSpace]:
    """The spaces of colour-science by their plain names; it takes a second to load."""
    from skyscatter.spectra.library import colour_science

    def corner(xy: NDArray[np.float64]) -> tuple[float, float]:
        return float(xy[0]), float(xy[1])

    spaces = {}
    for name, space in colour_science().RGB_COLOURSPACES.items():
        red, green, blue, white = (corner(xy) for xy in (*space.primaries, space.whitepoint))
        spaces[_plain(name)] = ColourSpace(_plain(name), red, green, blue, white, None)
    return spaces


def display_space(name: str) -> ColourSpace:
    """Return the space of that name if pictures for displays can be made in it: if all its primaries are colours."""
    space = colour_space(name)
    if space.name == "acescg" or min(*space.red, *space.green, *space.blue) < 0.0:
        shown = ", ".join(s.name for s in SPACES.values() if s.cicp is not None)
        raise DomainError("colour space", name, f"is scene-linear only, no display has it; for a picture take {shown}")
    return space


def _xy_to_xyz(xy: tuple[float, float]) -> Array:
    return np.array([xy[0] / xy[1], 1.0, (1.0 - xy[0] - xy[1]) / xy[1]])


def _at(xy: tuple[float, float]) -> Array:
    return np.array([xy[0], xy[1], 1.0 - xy[0] - xy[1]])


def rgb_to_xyz_matrix(space: ColourSpace) -> Array:
    """Matrix (3, 3) from linear RGB to XYZ relative to the space's own white (SMPTE RP 177-1993)."""
    # Primaries on whatever scale; some spaces have ones without luminance.
    primaries = np.stack([_xy_to_xyz(xy) if xy[1] else _at(xy) for xy in (space.red, space.green, space.blue)], axis=1)
    matrix: Array = primaries * np.linalg.solve(primaries, _xy_to_xyz(space.white))
    return matrix


def xyz_to_rgb_matrix(space: ColourSpace) -> Array:
    """Matrix (3, 3) from XYZ to linear RGB.

    Pictures are made for a D65 display, so spaces whose white is D65 take XYZ as it is.  Where the white is another,
    D65 is adapted to it by the Bradford transform, so that a D65 grey is R = G = B in every space.
    """
    matrix: Array = np.linalg.inv(rgb_to_xyz_matrix(space)).astype(np.float64)
    if np.allclose(space.white, _D65, atol=1e-4):  # some give it by more digits
        return matrix
    gains = (_BRADFORD @ _xy_to_xyz(space.white)) / (_BRADFORD @ _xy_to_xyz(_D65))
    adapted: Array = matrix @ np.linalg.inv(_BRADFORD) @ (gains[:, None] * _BRADFORD)
    return adapted


def luminance_weights(space: ColourSpace) -> Array:
    """Share of the luminance Y that linear R, G and B each add; shape (3,), sum 1."""
    weights: Array = np.linalg.inv(xyz_to_rgb_matrix(space)).astype(np.float64)[1]
    return weights


@cache
def observer() -> tuple[Array, Array]:
    """CIE 1931 2-degree observer: wavelengths [nm] (471,) and colour-matching functions (471, 3)."""
    table = np.loadtxt(data_path("cie1931.csv"), delimiter=",", skiprows=1)
    table.flags.writeable = False
    return table[:, 0], table[:, 1:]


def xyz_weights(wavelengths_nm: ArrayLike) -> Array:
    """Weights that turn a sampled spectrum into XYZ by one matrix product: ``xyz = radiance @ weights``.

    Parameters
    ----------
    wavelengths_nm : array_like, shape (wavelength,)
        Ascending wavelengths [nm]; any spacing.

    Returns
    -------
    ndarray, shape (wavelength, 3)
        [lm W-1 nm]: radiance in W m-2 sr-1 nm-1 gives XYZ with Y in cd m-2.

    Notes
    -----
    The spectrum is taken as linear between the samples, and each end sample as constant for half an interval more (it
    stands for a full band), the observer as linear between its entries at 1 nm; of these the integral is exact.  What
    lies further outside was not computed and counts as dark.

    A single wavelength carries no colour.  It makes a grey picture: chromaticity D65 and the luminance of a spectrum
    that is flat at that value, wherever it lies (so an infrared image can be looked at, too).
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, dtype=float))
    nodes, functions = observer()
    if wl.size == 1:
        return LUMINOUS_EFFICACY * np.trapezoid(functions[:, 1], nodes) * _xy_to_xyz(_D65)[None, :]
    return LUMINOUS_EFFICACY * sample_weights(wl, nodes, functions)


def sample_weights(wl: Array, nodes: Array, functions: Array) -> Array:
    """Integrals of functions (node, function) at nodes [nm] times a spectrum sampled at `wl`; (wavelength, function).

    Both are linear between their samples; see `xyz_weights`.
    """
    low, high = wl[0] - 0.5 * (wl[1] - wl[0]), wl[-1] + 0.5 * (wl[-1] - wl[-2])
    low, high = max(low, nodes[0]), min(high, nodes[-1])
    if low >= high:
        return np.zeros((wl.size, functions.shape[1]))
    grid = np.unique(np.concatenate([[low, high], nodes, wl]))
    grid = grid[(grid >= low) & (grid <= high)]
    middle = 0.5 * (grid[1:] + grid[:-1])
    step = np.diff(grid)
    weights = np.zeros((wl.size, functions.shape[1]))
    # Simpson's rule is exact for the product of two linear pieces.
    for points, factor in ((grid[:-1], step / 6.0), (middle, step * (4.0 / 6.0)), (grid[1:], step / 6.0)):
        values = np.stack([np.interp(points, nodes, column) for column in functions.T], axis=1)
        _add_hats(weights, wl, points, values * factor[:, None])
    return weights


def _add_hats(weights: Array, wl: Array, points: Array, amounts: Array) -> None:
    """Share `amounts` (point, function) at `points` among the two samples beside, as linear interpolation does."""
    left = np.clip(np.searchsorted(wl, points, side="right") - 1, 0, wl.size - 2)
    share = np.clip((points - wl[left]) / (wl[left + 1] - wl[left]), 0.0, 1.0)[:, None]
    np.add.at(weights, left, (1.0 - share) * amounts)
    np.add.at(weights, left + 1, share * amounts)


def spectrum_to_xyz(radiance: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
    """Absolute XYZ (..., 3) of spectral radiance (..., wavelength) [W m-2 sr-1 nm-1]; Y in cd m-2."""
    return np.asarray(np.asarray(radiance) @ xyz_weights(wavelengths_nm), dtype=np.float64)


def adapted_white(xyz: ArrayLike, white: ArrayLike, degree: float = 1.0) -> Array:
    """XYZ (..., 3) for an eye or a camera that takes a colour for white, by gains of cone-like responses (Bradford).

    Parameters
    ----------
    xyz : array_like, shape (..., 3)
    white : array_like, shape (3,)
        XYZ of what is taken for white; it becomes D65 of the same luminance.
    degree : float
        0 for no adaptation, 1 for a complete one.
    """
    response = _BRADFORD @ (np.asarray(white, float) / np.asarray(white, float)[1])
    gains = 1.0 + degree * (_BRADFORD @ _xy_to_xyz(_D65) / response - 1.0)
    return np.asarray(np.asarray(xyz, float) @ (np.linalg.inv(_BRADFORD) @ (gains[:, None] * _BRADFORD)).T)


def xyz_to_rgb(xyz: ArrayLike, space: str = "srgb") -> Array:
    """Linear RGB (..., 3) on the scale of Y, unbounded: colours outside the space have negative components."""
    return np.asarray(xyz, dtype=float) @ xyz_to_rgb_matrix(colour_space(space)).T


@cache
def _planckian_locus() -> tuple[Array, Array, Array]:
    """Black bodies from infinite temperature to 1000 K: 1 / T [K-1], CIE 1960 u, v (n, 2), unit tangents (n, 2)."""
    inverse = np.arange(0.0, 1001.0) * 1e-6
    nodes, functions = observer()
    x = _C2 * inverse[:, None] / nodes
    # B / T is proportional to lambda^-4 x / (e^x - 1), which stays finite at infinite temperature (Rayleigh-Jeans).
    ratio = np.divide(x, np.expm1(x), out=np.ones_like(x), where=x > 0.0)
    uv = _uv((ratio * (nodes / 560.0) ** -4.0) @ functions)
    tangent = np.gradient(uv, axis=0)
    return inverse, uv, tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def _uv(xyz: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        denominator = xyz[..., 0] + 15.0 * xyz[..., 1] + 3.0 * xyz[..., 2]
        return np.stack([4.0 * xyz[..., 0], 6.0 * xyz[..., 1]], axis=-1) / denominator[..., None]


def cct(xyz: ArrayLike) -> Array:
    """Correlated colour temperature [K] of XYZ (..., 3); shape (...).

    Robertson (1968, J. Opt. Soc. Am. 58, 1528): the temperature of the black body whose isotherm (the normal to the
    Planckian locus in CIE 1960 u, v) passes through the colour, interpolated between isotherms; here one every
    1e-6 K-1 from 1000 K on, computed from the observer itself.

    Infinite for colours bluer than an infinitely hot black body; NaN below 1000 K, further than 0.05 from the locus
    (where CIE 015:2018 gives the notion no meaning), and for black or NaN.
    """
    values = np.asarray(xyz, dtype=float)
    colours = _uv(values).reshape(-1, 2)
    inverse, locus, tangent = _planckian_locus()
    with np.errstate(invalid="ignore"):
        # Signed distance to isotherm i is positive while the colour lies on its cooler side: bisect for its zero.
        low = np.zeros(len(colours), dtype=int)
        high = np.full(len(colours), inverse.size - 1)
        for _ in range(int(np.ceil(np.log2(inverse.size)))):
            mid = (low + high) // 2
            cooler = np.sum((colours - locus[mid]) * tangent[mid], axis=1) > 0.0
            low, high = np.where(cooler, mid, low), np.where(cooler, high, mid)
        low = np.minimum(low, inverse.size - 2)
        before = np.sum((colours - locus[low]) * tangent[low], axis=1)
        after = np.sum((colours - locus[low + 1]) * tangent[low + 1], axis=1)
        share = before / (before - after)
        reciprocal = inverse[low] + share * (inverse[low + 1] - inverse[low])
        nearest = locus[low] + np.clip(share, 0.0, 1.0)[:, None] * (locus[low + 1] - locus[low])
        distance = np.linalg.norm(colours - nearest, axis=1)
        result = np.where(reciprocal > 0.0, 1.0 / np.where(reciprocal > 0.0, reciprocal, 1.0), np.inf)
        valid = (distance <= 0.05) & (reciprocal <= inverse[-1])
    return np.where(valid, result, np.nan).reshape(values.shape[:-1])


def dominant_wavelength(xyz: ArrayLike) -> Array:
    """Wavelength [nm] of the light that, mixed with daylight (D65), makes a colour XYZ (..., 3); shape (...).

    Negative for purples, which no wavelength makes: that of the opposite colour (CIE 017:2020, 17-23-059).  NaN for
    colours within 1e-4 of daylight in CIE 1931 x, y, and for black or NaN.

    Examples
    --------
    >>> from skyscatter.image.colour import dominant_wavelength
    >>> dominant_wavelength([[0.7, 0.8, 1.3], [0.5, 0.2, 0.6]]).round()
    array([ 483., -524.])
    """
    values = np.asarray(xyz, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        away = values[..., :2] / values.sum(axis=-1, keepdims=True) - np.array(_D65)
    nodes, functions = observer()
    seen = (nodes >= 380.0) & (nodes <= 700.0)  # beyond, the locus hardly moves
    locus = functions[seen, :2] / functions[seen].sum(axis=1, keepdims=True) - np.array(_D65)
    turn = np.unwrap(np.arctan2(locus[:, 1], locus[:, 0]))
    order = np.argsort(turn)

    def met(vector: Array) -> Array:
        """Where a ray from daylight meets the locus; NaN on the line of purples."""
        angle = np.arctan2(vector[..., 1], vector[..., 0])
        angle = turn.min() + (angle - turn.min()) % (2.0 * np.pi)
        return np.asarray(np.interp(angle, turn[order], nodes[seen][order], right=np.nan))

    straight = met(away)
    found = np.where(np.isnan(straight), -met(-away), straight)
    return np.where(np.linalg.norm(away, axis=-1) > 1e-4, found, np.nan)
