"""From scene-linear RGB to what a display shows: exposure, gamut, tone, encoding; all of them keep the hue.

No step clips one channel by itself.  Exposure and the tone curve scale a colour as a whole, the gamut mapping mixes it
with grey in linear light: both keep its dominant wavelength.  Highlights that fade to white, and colours that are made
stronger, do so at constant *perceived* hue, because a blue mixed with white in linear light looks purple and an orange
looks pink (Abney effect).

Colours look stronger in bright light than on a display that shows the same chromaticities (Hunt effect), and so film
and cameras strengthen them.  `colourfulness` has the factor from the model of colour appearance CIECAM02.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.image.channels import largest, least
from skyscatter.image.colour import colour_space, display_space, luminance_weights, rgb_to_xyz_matrix
from skyscatter.image.glare import with_glare
from skyscatter.kernels.processors import processors
from skyscatter.workers import Workers, steady_algebra

Array = NDArray[np.float64]

#: `apply_tone` has the curves.
TONES = ("photograph", "eye", "asinh", "filmic", "linear")
MID_GREY = 0.18  #: linear value that the metered luminance is given
LIFT = 0.7  #: stops above mid grey that automatic exposure gives to the average: skies are lighter than the world below
#: The curve of "asinh": exposed value from which on it grows as a logarithm, and the value that is white, 6.5 stops
#: above mid grey.  Mid grey then looks as with `filmic_curve`, 0.55 of the way from black to white.
BEND, ASINH_WHITE = 1.38e-3, 16.0
PART = 65536  #: colours that a thread changes at a time
#: What automatic exposure makes of nebulae: so many stops above mid grey lie the brightest `OBJECT` per cent of them.
SPACE_LIFT, OBJECT = 1.2, 10.0
HEADROOM = 3.5  #: stops above mid grey that it leaves to the brightest 2 %, 1.8 below the curve's white
DAYLIGHT = 1000.0  #: luminance to which the eye is adapted in the open by day [cd m-2]: grey under some 16 000 lx
DISPLAY = 20.0  #: the same before a display whose white has 100 cd m-2
_METER = 12.5  # reflected-light meter constant K [cd m-2 s], ISO 2720:1974

# Oklab (Ottosson 2020): cone-like responses of XYZ, and lightness and two opponent axes of their cube roots.
_OKLAB_LMS = np.array(
    [
        [0.8189330101, 0.3618667424, -0.1288597137],
        [0.0329845436, 0.9293118715, 0.0361456387],
        [0.0482003018, 0.2643662691, 0.6338517070],
    ]
)
_OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def metered_luminance(ev100: float) -> float:
    """Luminance [cd m-2] that becomes mid grey at exposure value EV (ISO 100): ``2**EV * 12.5 / 100`` (ISO 2720)."""
    return float(2.0**ev100 * _METER / 100.0)


def auto_ev100(luminance: ArrayLike) -> float:
    """Exposure value (ISO 100) that suits a picture with these luminances [cd m-2].

    Their log-average comes to lie `LIFT` stops above mid grey, unless the 98th percentile would then lie more than
    `HEADROOM` above it: a small bright object in faint surroundings is not burnt out.

    Only finite, positive luminances count.  Those darker than a thousandth of the 99th percentile (space around a
    planet, deep shadow) are left out, and from the average the brightest and the darkest 5 %, so that neither the Sun's
    disk nor the black margin of a fisheye moves the exposure.  A picture without light has EV 0.
    """
    values = np.asarray(luminance, dtype=float).ravel()
    values = values[np.isfinite(values) & (values > 0.0)]
    if values.size == 0:
        return 0.0
    values = values[values >= 1e-3 * np.percentile(values, 99.0)]
    low, high, brightest = np.percentile(values, [5.0, 95.0, 98.0])
    inner = values[(values >= low) & (values <= high)]
    values = inner if inner.size else values  # of two there is none between
    grey = max(float(np.mean(np.log2(values))) - LIFT, float(np.log2(brightest)) - HEADROOM)
    return float(grey - np.log2(metered_luminance(0.0)))


def space_ev100(luminance: ArrayLike) -> float:
    """Exposure value (ISO 100) for a bright object in the dark, a nebula: its surroundings stay dark.

    The brightest tenth of what has light (more than a thousandth of the 99.5th percentile) begins `SPACE_LIFT` stops
    above mid grey, so that what is brighter keeps its forms, and the average of a dim halo does not count.  A picture
    without light has EV 0.
    """
    values = np.asarray(luminance, dtype=float).ravel()
    values = values[np.isfinite(values) & (values > 0.0)]
    if values.size == 0:
        return 0.0
    values = values[values >= 1e-3 * np.percentile(values, 99.5)]
    return float(np.log2(np.percentile(values, 100.0 - OBJECT) / metered_luminance(0.0)) - SPACE_LIFT)


def dusk_ev100(ev100: float) -> float:
    """Exposure value for a sky whose average would be mid grey with `ev100`: by night it looks dark.

    The key of a scene of luminance L is 1.03 - 2 / (2 + lg(L + 1)), from 0.03 in the dark on (Krawczyk, Myszkowski &
    Seidel 2005, Proc. SCCG, 195, eq. 11); where that is below mid grey the exposure falls in proportion.
    """
    key = 1.03 - 2.0 / (2.0 + np.log10(metered_luminance(ev100) + 1.0))
    return float(ev100 + max(np.log2(MID_GREY / key), 0.0))


def exposure_value(exposure: float | Literal["auto"], luminance: ArrayLike) -> float:
    """EV (ISO 100) from a user's word: "auto" or a number."""
    if isinstance(exposure, str):
        if exposure == "auto":
            return auto_ev100(luminance)
        raise DomainError("exposure", exposure, "'auto' or an exposure value (EV at ISO 100) as a number")
    value = float(exposure)
    if not np.isfinite(value) or abs(value) > 100.0:
        raise DomainError("exposure", exposure, "an exposure value between -100 and 100 EV, or 'auto'")
    return value


def map_gamut(rgb: ArrayLike, space: str = "srgb") -> Array:
    """Bring colours with negative components into the space, at their own luminance and dominant wavelength.

    The colour is moved in linear light towards the grey of equal luminance, just until its lowest component is zero;
    colours inside stay as they are.  Colours without luminance become black.
    """
    values = np.asarray(rgb, dtype=float)
    grey = (values @ luminance_weights(display_space(space)))[..., None]
    lowest = least(values)
    outside = (lowest < 0.0) & (grey > 0.0)
    share = np.divide(-lowest, grey - lowest, out=np.zeros_like(grey), where=outside)
    mapped = values + share * (grey - values)
    # The lowest component is zero up to rounding: the maximum takes away that rounding and nothing else.
    result: Array = np.where(grey > 0.0, np.maximum(mapped, 0.0), np.where(np.isnan(grey), np.nan, 0.0))
    return result


def filmic_curve(x: ArrayLike) -> Array:
    """Film-like S-curve on [0, inf) to [0, 1]: the rational fit to the ACES reference rendering by Narkowicz (2015).

    Mid grey 0.18 becomes 0.267, and 1 is reached at 7.24, that is 5.3 stops above mid grey.
    """
    value = np.minimum(np.asarray(x, dtype=float), 8.0)  # beyond 7.24 it is 1; the bound keeps the squares finite
    return np.minimum(value * (2.51 * value + 0.03) / (value * (2.43 * value + 0.59) + 0.14), 1.0)


def asinh_curve(x: ArrayLike) -> Array:
    """Linear display value, on [0, inf) to [0, 1], of which the *encoded* value is ``asinh(x / b) / asinh(w / b)``.

    The stretch of astronomers (Lupton, Gunn & Szalay 1999, AJ 118, 1406): straight in the faint, a logarithm in the
    bright, so that both are seen at once; b is `BEND`, w is `ASINH_WHITE`.
    """
    value = np.minimum(np.asarray(x, dtype=float), ASINH_WHITE)
    return decode(np.arcsinh(value / BEND) / np.arcsinh(ASINH_WHITE / BEND))


def colourfulness(tone: str, ev100: float) -> float:
    """Factor by which a tone strengthens colours.

    The colourfulness of CIECAM02 (CIE 159:2004) grows as the fourth root of its luminance-level adaptation factor.  So
    what an eye that is adapted to one luminance sees is shown to one that is adapted to another by the fourth root of
    the ratio of both factors: ``"eye"`` takes the mid grey of the exposure, and by night colours fade; ``"photograph"``
    that of `DAYLIGHT`, whatever the light, as cameras and film do; the others leave colours alone.
    """
    if tone not in ("photograph", "eye"):
        return 1.0
    adapted = DAYLIGHT if tone == "photograph" else metered_luminance(ev100)
    return float((_adaptation(adapted) / _adaptation(DISPLAY)) ** 0.25)


def _adaptation(luminance: float) -> float:
    """Luminance-level adaptation factor F_L of CIECAM02."""
    k = 1.0 / (5.0 * luminance + 1.0)
    return float(0.2 * k**4 * 5.0 * luminance + 0.1 * (1.0 - k**4) ** 2 * np.cbrt(5.0 * luminance))


def apply_tone(rgb: ArrayLike, tone: str, space: str = "srgb", strength: float | None = None) -> Array:
    """Map exposed, non-negative linear RGB (..., 3) into [0, 1].

    The curve acts on the largest component and the other two keep their ratios to it.  ``"linear"`` stops at 1.
    ``"filmic"`` is `filmic_curve`, and from 1 to 64 (2.5 to 8.5 stops above mid grey) colours go over to white as on
    film, along a line of constant hue in Oklab (Ottosson 2020).  ``"photograph"`` and ``"eye"`` do the same to colours
    that were made stronger before, by a factor `strength` (of daylight if none is given; see `colourfulness`).
    ``"asinh"`` is `asinh_curve`, and highlights keep their colours, as those of stars.
    """
    if tone not in TONES:
        raise DomainError("tone", tone, f"one of {', '.join(TONES)}")
    values = np.asarray(rgb, dtype=float)
    factor = colourfulness(tone, np.log2(DAYLIGHT / metered_luminance(0.0))) if strength is None else strength
    if factor != 1.0:
        values = _strengthened(values, factor, space)
    peak = largest(values)
    ratios = np.divide(values, peak, out=np.zeros_like(values), where=peak > 0.0)
    if tone == "linear":
        return np.asarray(ratios * np.minimum(peak, 1.0))
    if tone == "asinh":
        return asinh_curve(peak) * ratios
    bright = peak[..., 0] > 1.0
    if bright.any():
        fade = np.minimum(np.log2(peak[bright]) / 6.0, 1.0)
        ratios[bright] = _towards_white(ratios[bright], fade * fade * (3.0 - 2.0 * fade), space)
    return filmic_curve(peak) * ratios


def _lms(space: str) -> Array:
    """Matrix (3, 3) from linear RGB to the cone-like responses of Oklab."""
    matrix = _OKLAB_LMS @ rgb_to_xyz_matrix(colour_space(space))
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))  # the published digits leave white 1e-4 off


def _strengthened(rgb: Array, factor: float, space: str) -> Array:
    """Colours (..., 3) with their chroma in Oklab times a factor, at the same lightness and hue.

    A factor above 1 falls to 1 towards the edge of the space, so that strong colours keep their differences.
    """
    to_lms = _lms(space)
    lab = np.cbrt(rgb @ to_lms.T) @ _OKLAB.T
    peak = largest(rgb)[..., 0]
    saturation = 1.0 - np.divide(least(rgb)[..., 0], peak, out=np.ones_like(peak), where=peak > 0.0)
    share = 1.0 - saturation**4 if factor > 1.0 else np.ones_like(saturation)
    lab[..., 1:] *= (1.0 + (factor - 1.0) * share)[..., None]
    return map_gamut((lab @ np.linalg.inv(_OKLAB).T) ** 3 @ np.linalg.inv(to_lms).T, space)


def _towards_white(ratios: Array, share: Array, space: str) -> Array:
    """Move colours (n, 3) whose largest component is 1 by a share (n, 1) of the way to white in Oklab; that stays 1."""
    to_lms = _lms(space)
    lab = np.cbrt(ratios @ to_lms.T) @ _OKLAB.T
    white = _OKLAB.sum(axis=1)
    moved = ((lab + share * (white - lab)) @ np.linalg.inv(_OKLAB).T) ** 3 @ np.linalg.inv(to_lms).T
    inside = map_gamut(moved, space)
    # Oklab is homogeneous: a colour scaled as a whole keeps its hue there, too.
    return inside / largest(inside)


def encode(linear: ArrayLike) -> Array:
    """Display encoding of [0, 1]: the piecewise curve of sRGB (IEC 61966-2-1).

    Display P3 shares it.  Rec.2020 pictures use it too and their files say so: the broadcast curve of BT.2020 is a
    camera's, and displays disagree on its inverse.
    """
    value = np.asarray(linear, dtype=float)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.maximum(value, 0.0031308) ** (1.0 / 2.4) - 0.055)


def decode(encoded: ArrayLike) -> Array:
    """Linear value in [0, 1] of a display encoding: the inverse of `encode`."""
    value = np.asarray(encoded, dtype=float)
    return np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0.0) + 0.055) / 1.055) ** 2.4)


def develop(rgb: ArrayLike, space: str, ev100: float, tone: str, lens: bool | None = None) -> Array:
    """Display-encoded picture (..., 3) in [0, 1] from absolute linear RGB [cd m-2]; NaN becomes black.

    With a `lens` a picture (y, x, 3) has its glare around the Sun and stars; see `skyscatter.image.glare`.  Where
    nothing is said a ``"photograph"`` has it.
    """
    values = np.asarray(rgb, dtype=float)
    scale, strength = MID_GREY / metered_luminance(ev100), colourfulness(tone, ev100)
    exposed = _in_parts(lambda part: map_gamut(np.nan_to_num(part * scale, nan=0.0), space), values)
    if (tone == "photograph" if lens is None else lens) and exposed.ndim == 3:
        exposed = np.where(np.isnan(values), 0.0, with_glare(exposed))
    return _in_parts(lambda part: encode(apply_tone(part, tone, space, strength)), exposed)


def _in_parts(change: Callable[[Array], Array], colours: Array) -> Array:
    """`change` of colours (..., 3), one by one as they are: in parts, which threads share."""
    flat = colours.reshape(-1, colours.shape[-1])
    if len(flat) <= PART:
        return change(colours)
    result = np.empty_like(flat)

    def one(first: int) -> None:
        result[first : first + PART] = change(flat[first : first + PART])

    with steady_algebra(), Workers(processors()) as pool:
        list(pool.map(one, range(0, len(flat), PART)))
    return result.reshape(colours.shape)
