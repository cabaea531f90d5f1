"""Three filters as red, green and blue: narrow-band palettes, and the asinh pictures of Lupton et al. (2004).

Levels.  Each plane L becomes x = (L - black) / (white - black), not below 0.  By default black is the plane's 1st
percentile (not below 0), white the 99.5th percentile of those values that lie above black.  A palette of lines takes
them from each plane by itself, for lines differ in strength and their balance is taste; filters named one by one, and
palettes of broad bands, share the lowest black and the highest white, so that equal radiance is grey.

Tone.  ``"lupton"``: with I the mean of the three x,

    rgb = x f(I) / I,      f(I) = asinh(softening I / stretch) / softening

(Lupton et al. 2004, PASP 116, 133, whose α is 1 / stretch and whose Q is the softening), taken as display values as in
their pictures; where the largest exceeds 1, all three are divided by it.  So the ratios of a pixel's three values are
those of the planes, in highlights too.  `stretch` is the I at which the straight line of a softening near 0 reaches
white.  A pixel whose largest x is m I is just at white with a stretch of ``softening I / sinh(softening / m)``; the
default is the 99.5th percentile of that over the pixels that have light.  ``"linear"`` takes x as linear light on the
display, stopped at white in the same way.

Continuum.  The light of stars, and of dust that scatters it, falls into narrow bands too, and levels of its own for
each plane give every star the same loud colour.  ``"subtract"`` takes it off as observers do, by what is seen beside
the lines, in `CLEAR`: between two wavelengths there ln(λ⁵ L) is a straight line over 1 / λ, as by Wien's law for black
bodies of any temperature, and beyond the last it is as there.  ``"natural"`` gives it back in its own colours: L at
460, 540 and 615 nm as blue, green and red, its 99.9th percentile as bright as the white of the lines; where a pixel is
stopped at white its part of it turns white, as stars do that overexpose.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.image.filterimage import FilterImage, through
from skyscatter.image.filters import FilterCurve, filter_curve
from skyscatter.image.tone import encode

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]
Levels = Sequence[Sequence[float]]

TONES = ("lupton", "linear")
SOFTENING = 8.0  #: Q of the asinh curve by default, as in the program of Lupton et al.
_BLACK, _WHITE, _STARS = 1.0, 99.5, 99.9  # percentiles
#: What becomes of the light between the lines.
CONTINUA = ("keep", "subtract", "natural")
#: Bands without bright lines of nebulae [nm, vacuum].
CLEAR = ((440.0, 475.0), (510.0, 570.0), (600.0, 625.0), (684.0, 725.0))
_NATURAL = (615.0, 540.0, 460.0)  # red, green, blue [nm]


class Palette(NamedTuple):
    """Filters shown as red, green and blue; whether each has levels of its own."""

    red: str
    green: str
    blue: str
    own_levels: bool


PALETTES = {
    "sho": Palette("sii", "halpha", "oiii", True),
    "hubble": Palette("sii", "halpha", "oiii", True),  # the same: made known by the Hubble Heritage pictures
    "hos": Palette("halpha", "oiii", "sii", True),
    "hoo": Palette("halpha", "oiii", "oiii", True),
    "rvb": Palette("R", "V", "B", False),
}


class Planes(NamedTuple):
    """Display-encoded picture (y, x, 3), where it is opaque (y, x), and how it was made."""

    picture: Array
    opaque: NDArray[np.bool_]
    made: dict[str, Any]


def three_filters(palette: str | None, filters: str | Iterable[Any] | None) -> tuple[list[Any], bool]:
    """Filters for red, green and blue, and whether each has levels of its own.

    Raises
    ------
    DomainError
        For an unknown palette, for both a palette and filters, and for other than three filters.
    """
    if palette is not None and filters is not None:
        raise DomainError("filters", filters, f"the palette {palette} names its own; leave one of the two out")
    if palette is not None:
        if palette not in PALETTES:
            raise DomainError("palette", palette, f"one of {', '.join(PALETTES)}")
        *names, own = PALETTES[palette]
        return list(names), bool(own)
    words: list[Any] = (
        [word.strip() for word in filters.split(",")] if isinstance(filters, str) else list(filters or ())
    )
    if len(words) != 3:
        raise DomainError("filters", filters, "a picture needs three: for red, green and blue, for instance R,V,B")
    return words, False


def auto_levels(planes: ArrayLike, own: bool) -> list[tuple[float, float]]:
    """Black and white [W m-2 sr-1 nm-1] of planes (y, x, 3), as the module's text says."""
    cube = np.asarray(planes, dtype=float)
    pairs = [_plane_levels(cube[..., number]) for number in range(cube.shape[2])]
    if own:
        return pairs
    return [(min(black for black, _ in pairs), max(white for _, white in pairs))] * len(pairs)


def _plane_levels(plane: Array) -> tuple[float, float]:
    values = plane[np.isfinite(plane)]
    if values.size == 0:
        return 0.0, 0.0
    black = max(float(np.percentile(values, _BLACK)), 0.0)
    above = values[values > black]
    return black, float(np.percentile(above, _WHITE)) if above.size else black


def _check_levels(levels: Levels) -> list[tuple[float, float]]:
    try:
        pairs = [(float(black), float(white)) for black, white in levels]
    except (TypeError, ValueError):
        pairs = []
    if len(pairs) != 3 or not all(np.isfinite(pair).all() and pair[0] < pair[1] for pair in pairs):
        raise DomainError(
            "levels", levels, "'auto', or three pairs (black, white) in W m-2 sr-1 nm-1 with black < white"
        )
    return pairs


def lupton(planes: ArrayLike, stretch: float, softening: float, pale: ArrayLike = 0.0) -> Array:
    """Display values in [0, 1] of non-negative planes (..., 3); the curve and its source are in the module's text.

    Of each pixel's light the share `pale` (..., 1) turns white where it is stopped at white.
    """
    x = np.asarray(planes, dtype=float)
    mean = x.mean(axis=-1, keepdims=True)
    shown = np.arcsinh(softening * mean / stretch) / softening
    return _stopped(x * np.divide(shown, mean, out=np.zeros_like(mean), where=mean > 0.0), pale)


def _stopped(rgb: Array, pale: ArrayLike) -> Array:
    """Values (..., 3) stopped at white with their ratios, but for the share `pale` that turns white beyond it."""
    peak = np.maximum(rgb.max(axis=-1, keepdims=True), 1.0)
    return np.asarray(rgb / peak + (1.0 - rgb / peak) * pale * (1.0 - 1.0 / peak))


def auto_stretch(planes: ArrayLike, softening: float) -> float:
    """Stretch with which 99.5 % of the pixels that have light stay below white; planes (..., 3), not negative."""
    x = np.asarray(planes, dtype=float).reshape(-1, 3)
    mean = x.mean(axis=1)
    x, mean = x[mean > 0.0], mean[mean > 0.0]
    if mean.size == 0:
        return softening / float(np.sinh(softening))
    return float(np.percentile(softening * mean / np.sinh(softening * mean / x.max(axis=1)), _WHITE))


def _positive(name: str, value: float, highest: float) -> float:
    if not 0.0 < float(value) <= highest:
        raise DomainError(name, value, f"a number above 0 and at most {highest:g}")
    return float(value)


def plane_picture(
    image: SpectralImage,
    palette: str | None = None,
    filters: str | Iterable[Any] | None = None,
    tone: str | None = None,
    stretch: float | None = None,
    softening: float | None = None,
    levels: Levels | Literal["auto"] | None = None,
    continuum: str | None = None,
) -> Planes:
    """Show three filters as red, green and blue.

    Parameters
    ----------
    image : SpectralImage
    palette : {"sho", "hubble", "hos", "hoo", "rvb"}, optional
        Lines: [S II], Hα, [O III] (``hubble`` is the same); Hα, [O III], [S II]; Hα, [O III], [O III].  ``rvb``: the
        broad bands R, V, B.
    filters : str or sequence, optional
        Three filters for red, green and blue in place of a palette.
    tone : {"lupton", "linear"}, optional
    stretch, softening : float, optional
        Of the asinh curve; `stretch` as a share of the white level.
    levels : "auto" or three pairs (black, white) [W m-2 sr-1 nm-1], optional
    continuum : {"keep", "subtract", "natural"}, optional
        What becomes of the light between the lines; see the module's text.

    Raises
    ------
    DomainError
        For options out of range, and where the wavelengths do not cover a filter.
    """
    words, own = three_filters(palette, filters)
    tone = "lupton" if tone is None else tone
    if tone not in TONES:
        raise DomainError("tone", tone, f"pictures of three filters take {' or '.join(TONES)}")
    for name, value in (("stretch", stretch), ("softening", softening)):
        if tone != "lupton" and value is not None:
            raise DomainError(name, value, f"means nothing to the tone {tone}; leave it out")
    soft = SOFTENING if softening is None else _positive("softening", softening, 100.0)
    curves = [filter_curve(word) for word in words]
    planes = np.stack([_plane(image, curve) for curve in curves], axis=-1)
    between = _between(image, "keep" if continuum is None else continuum)
    if between is not None:
        planes = planes - np.stack([between.through(curve, image.wavelengths) for curve in curves], axis=-1)
    pairs = auto_levels(planes, own) if levels is None or levels == "auto" else _check_levels(levels)
    black, span = np.array([low for low, _ in pairs]), np.array([high - low for low, high in pairs])
    opaque = np.asarray(np.isfinite(planes).all(axis=-1))
    x = np.maximum(np.where(opaque[..., None], planes, 0.0) - black, 0.0)
    x = np.divide(x, span, out=np.zeros_like(x), where=span > 0.0)
    made: dict[str, Any] = {
        "filters": [curve.name for curve in curves],
        "levels": [list(p) for p in pairs],
        "tone": tone,
    }
    if palette is not None:
        made["palette"] = palette
    pale: Array | float = 0.0
    if between is not None:
        made["continuum"] = continuum
    if between is not None and continuum == "natural":
        natural = _natural(between)
        x = x + natural
        whole = x.sum(axis=-1, keepdims=True)
        pale = np.divide(natural.sum(axis=-1, keepdims=True), whole, out=np.zeros_like(whole), where=whole > 0.0)
    if tone == "linear":
        return Planes(encode(_stopped(x, pale)), opaque, made)
    straight = auto_stretch(x, soft) if stretch is None else _positive("stretch", stretch, 1e6)
    return Planes(lupton(x, straight, soft, pale), opaque, {**made, "stretch": straight, "softening": soft})


def _plane(image: SpectralImage, curve: Any) -> Array:
    looked: FilterImage = through(image, [curve])
    return np.asarray(looked.radiance[..., 0], dtype=float)


class _Continuum(NamedTuple):
    """Wavelengths [nm] between the lines, and radiance (y, x, wavelength) there."""

    nodes: Array
    light: Array

    def at(self, wavelength: float) -> Array:
        """Radiance (y, x) of the continuum at a wavelength [nm]."""
        if len(self.nodes) == 1 or not self.nodes[0] < wavelength < self.nodes[-1]:
            return np.asarray(self.light[..., 0 if wavelength <= self.nodes[0] else -1])
        right = int(np.searchsorted(self.nodes, wavelength))
        low, high = self.light[..., right - 1], self.light[..., right]
        first, last = self.nodes[right - 1] / wavelength, self.nodes[right] / wavelength
        share = (1.0 - 1.0 / first) / (1.0 / last - 1.0 / first)
        both = (low > 0.0) & (high > 0.0)
        wien = (np.where(both, low, 1.0) * first**5) ** (1.0 - share) * (np.where(both, high, 1.0) * last**5) ** share
        return np.where(both, wien, (1.0 - share) * low + share * high)

    def through(self, curve: FilterCurve, wavelengths: Array) -> Array:
        """Its average (y, x) over a filter, at the wavelengths that stand for their cells [nm]."""
        weights, _ = curve.weights(wavelengths)
        shares = [weight * self.at(nm) for nm, weight in zip(wavelengths, weights, strict=True) if weight > 0.0]
        return np.asarray(sum(shares))


def _between(image: SpectralImage, continuum: str) -> _Continuum | None:
    """The light between the lines; None where it is kept."""
    if continuum not in CONTINUA:
        raise DomainError("continuum", continuum, f"choose one of {', '.join(CONTINUA)}")
    if continuum == "keep":
        return None
    wavelengths = image.wavelengths
    clear = np.any([(wavelengths >= low) & (wavelengths <= high) for low, high in CLEAR], axis=0)
    if not clear.any():
        bands = ", ".join(f"{low:g} to {high:g}" for low, high in CLEAR)
        raise DomainError("continuum", continuum, f"needs wavelengths between the lines, within {bands} nm")
    return _Continuum(wavelengths[clear], np.asarray(image.radiance, dtype=float)[..., clear])


def _natural(between: _Continuum) -> Array:
    """The continuum in its own colours (y, x, 3), in the scale of levels.

    Planes are shown as display values; so that colours are no stronger than they are, their ratios are encoded.
    """
    colours = np.nan_to_num(np.stack([between.at(wavelength) for wavelength in _NATURAL], axis=-1))
    lit = colours.mean(axis=-1)
    bright = float(np.percentile(lit[lit > 0.0], _STARS)) if (lit > 0.0).any() else 0.0
    peak = np.maximum(colours.max(axis=-1, keepdims=True), 0.0)
    ratios = encode(np.maximum(np.divide(colours, peak, out=np.zeros_like(colours), where=peak > 0.0), 0.0))
    return np.asarray(ratios * (peak / bright)) if bright > 0.0 else np.zeros_like(colours)
