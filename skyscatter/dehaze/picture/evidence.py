r"""What a picture says about a veil on it, weighed against what pictures look like.

Nothing in a single picture tells a veil from a pale scene for certain: (J - A) t + A with a larger t and a paler J
shows the same.  So the answer is a distribution: over the veil's transmittance t, its own colour A and the slope of its
optical depth over wavelength, each judged by whether what would lie beneath is a plausible picture.  Evidence is

- the dark end: most scenes hold something nearly black (shadows, water, forest) in every band, and nothing negative;
- contrast: the spread of the light in scenes of many surfaces, and in scenes of a single one (sand, sea);
- colour: a grey veil dilutes the saturation of everything alike, also where nothing is dark;
- the bright end, which must stay within the scale;

and what is known of veils: layers that scatter without absorbing.  If such a layer reflects R, it lets 1 - R through
each way (energy is conserved), and by the adding method light from the ground is dimmed to t = (1 - R)², so that

    A = R / (1 - t) = 1 / (1 + √t),

0.5 of a white surface for a thin veil and 1 for an opaque one (the adding method: van de Hulst, Multiple Light
Scattering, 1980, chapter 4; the light that goes back and forth between the ground and the layer is left out).  The
widths below are wide on purpose: they are what one would say of pictures at large without having seen the one in
question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.picture.lattice import Lattice
from skyscatter.dehaze.picture.options import PictureOptions
from skyscatter.dehaze.picture.transfer import Transfer, encode

Floats = NDArray[np.float64]

REFERENCE = 550.0
"""Wavelength of the optical depths that are reported, nm."""

# Plausible pictures, in displayed values 0 to 1: (centre, standard deviation); those of "log" in natural logarithms.
DARK_END = (0.04, 0.04)  # of the darkest band, in scenes that hold dark objects
DARK_SHARE = 0.9  # how many scenes of many surfaces hold them
DARK_COLOUR = 0.07  # how far the dark ends of the bands lie apart
PALE_END = (0.25, 0.25)  # the dark end of the others
BLACK = 0.012  # how far below zero noise may reach
BRIGHT_END = (0.9, 0.25)
WHITE = 0.04  # how far above one the bright end may reach
MEAN_MANY, MEAN_ONE = (0.42, 0.2), (0.42, 0.3)
LOG_SPREAD_MANY, LOG_SPREAD_ONE = (np.log(0.16), 0.45), (np.log(0.05), 0.7)
LOG_COLOUR_MANY, LOG_COLOUR_ONE = (
    (np.log(0.8), 0.6),
    (np.log(4.0), 0.9),
)  # mean chroma over spread: no grey veil changes it
LOG_FLOORS = (np.log(0.5), 0.5)  # scatter of the logarithm of the dark ends of blocks, in scenes of many surfaces
ONE_SURFACE = 0.3  # share of scenes of a single kind of surface
LOG_SATURATION = (np.log(0.3), 0.5)
MOST_SATURATED = (0.7, 0.1)
LEAF_END = (0.06, 0.05)  # the dark end of a canopy: leaves absorb red and blue light, and shade each other
GREEN = 0.1  # relative excess of green over red and blue from which a scene is taken to be vegetated
# Veils
NO_VEIL = 0.3  # share of pictures without one: who asks for a veil to be taken off mostly sees one
MEAN_DEPTH = 0.8  # of the others, exponential
LOG_AIRLIGHT = 0.15  # exposure and stretch of the picture about A = 1 / (1 + √t)
GREY_VEIL = 0.7  # share of veils without colour; the others alike

DEPTHS = np.linspace(0.04, 2.4, 45)
AIRLIGHTS = np.geomspace(0.3, 1.0, 20)
SLOPES = (
    (0.0, 0.0),
    (0.5, 0.0),
    (1.0, 0.0),
    (1.5, 0.0),
    (2.0, 0.0),
    (3.0, 0.0),
    (4.0, 0.0),
    (0.0, 1.0),
    (0.0, 2.0),
    (0.0, 3.0),
)
"""Colours of veils: the exponent α of τ ~ λ^-α, and β of A ~ λ^β for smoke and dust, which absorb blue light: no α ≥ 0
says so."""


@dataclass(frozen=True)
class Features:
    """A picture, or a region of it, in a few numbers: light, (bands,) each, and means of its pixels' brightest and
    darkest band.

    ``floors`` are the dark ends of blocks, (bands, blocks), for a whole picture.
    """

    dark: Floats
    bright: Floats
    mean: Floats
    spread: Floats
    brightest: float
    darkest: float
    floors: Floats | None = None


EVERYWHERE = (slice(None), slice(None))
BLOCKS = 5
ENDS = 0.02  #: Share of the cells beyond the dark end, and beyond the bright one.


def features(lattice: Lattice, where: tuple[slice, slice] = EVERYWHERE, least: float = 0.25) -> Features | None:
    """Features of a rectangle of cells; None where less than a share of the cells have data, or fewer than four."""
    number = lattice.number[where]
    some = number > 0
    if some.sum() < max(4, least * some.size):
        return None
    weight = number[some] / number[some].sum(dtype=np.float64)
    mean = lattice.mean[:, *where][:, some].astype(np.float64)
    centre = mean @ weight
    variance = (lattice.variance[:, *where][:, some] + (mean - centre[:, None]) ** 2) @ weight
    dark = np.quantile(lattice.low[:, *where][:, some].astype(np.float64), ENDS, axis=1)
    bright = np.quantile(lattice.high[:, *where][:, some].astype(np.float64), 1.0 - ENDS, axis=1)
    tops, bottoms = lattice.brightest[where][some] @ weight, lattice.darkest[where][some] @ weight
    floors = _floors(lattice) if where == EVERYWHERE else None
    return Features(dark, bright, centre, np.sqrt(variance) + 1e-4, float(tops), float(bottoms), floors)


def dark_end(lattice: Lattice, airlight: Floats, gain: Floats) -> Floats:
    """Dark ends of the bands beneath a veil of these airlights and gains 1 / t (band, row, column), (bands,)."""
    beneath = airlight + (lattice.low - airlight) * gain
    found: Floats = np.quantile(beneath[:, lattice.number > 0], ENDS, axis=1)
    return found


def _floors(lattice: Lattice) -> Floats | None:
    """Dark ends of blocks, (bands, blocks); None where fewer than eight have data."""
    rows, columns = lattice.shape
    found = []
    for r in range(BLOCKS):
        for c in range(BLOCKS):
            block = np.s_[
                r * rows // BLOCKS : (r + 1) * rows // BLOCKS, c * columns // BLOCKS : (c + 1) * columns // BLOCKS
            ]
            some = lattice.number[block] > 0
            if some.sum() >= 4:
                found.append(np.quantile(lattice.low[:, *block][:, some], ENDS, axis=1))
    return np.array(found, dtype=np.float64).T if len(found) >= 8 else None


def _normal(x: Floats, prior: tuple[float, float]) -> Floats:
    return -0.5 * ((x - prior[0]) / prior[1]) ** 2 - np.log(prior[1])


def _greenness(mean: Floats) -> Floats:
    """How likely a scene is vegetated: nothing else reflects green best (sand and soil are redder, water is bluer)."""
    if len(mean) != 3:
        return np.full(mean.shape[1:], 1e-6)
    excess = (mean[1] - np.maximum(mean[0], mean[2])) / np.maximum(mean[1], 0.01)
    return 0.9 * np.clip(excess / GREEN, 1e-6, 1.0)


def plausibility(
    dark: Floats,
    bright: Floats,
    mean: Floats,
    spread: Floats,
    chroma: Floats | None = None,
    saturation: Floats | None = None,
    scatter: Floats | None = None,
) -> Floats:
    """Log-density of a clear picture with given features in displayed values; bands along the first axis."""
    lowest = dark.min(axis=0)
    held = np.logaddexp(
        np.log(DARK_SHARE) + _normal(np.maximum(lowest, 0.0), DARK_END),
        np.log(1.0 - DARK_SHARE) + _normal(lowest, PALE_END),
    )
    held = held - 0.5 * ((dark - lowest) ** 2).sum(axis=0) / DARK_COLOUR**2
    level, contrast = mean.mean(axis=0), np.log(np.maximum(spread.mean(axis=0), 1e-5))
    many = held + _normal(contrast, LOG_SPREAD_MANY) + _normal(level, MEAN_MANY) + np.log(1.0 - ONE_SURFACE)
    green = _greenness(mean)
    single = np.logaddexp(np.log(green) + _normal(lowest, LEAF_END), np.log(1.0 - green) + _normal(lowest, PALE_END))
    # Sea or snow may be as smooth as they like: little contrast says less than much.
    smoothness = np.where(contrast < LOG_SPREAD_ONE[0], 0.5, 1.0) * (contrast - LOG_SPREAD_ONE[0])
    one = single + _normal(smoothness, (0.0, LOG_SPREAD_ONE[1])) + _normal(level, MEAN_ONE) + np.log(ONE_SURFACE)
    if chroma is not None:
        # One kind of surface has one colour and little contrast; many kinds differ by more than their common colour.
        log_colour = np.log(np.maximum(chroma, 1e-3)) - contrast
        many = many + _normal(log_colour, LOG_COLOUR_MANY)
        one = one + _normal(np.minimum(log_colour, LOG_COLOUR_ONE[0]), LOG_COLOUR_ONE)
    if scatter is not None:
        # Surfaces vary in proportion to their brightness: a floor that is high and yet the same everywhere is a veil's.
        many = many + _normal(np.log(scatter), LOG_FLOORS)
        one = one + _normal(0.0 * scatter, (0.0, LOG_FLOORS[1]))
    highest = bright.max(axis=0)
    total = np.logaddexp(many, one) + _normal(np.minimum(highest, 1.0), BRIGHT_END)
    total = total - 0.5 * (np.maximum(highest - 1.0, 0.0) / WHITE) ** 2 - 0.5 * (np.minimum(lowest, 0.0) / BLACK) ** 2
    if saturation is not None:
        total = total + _normal(np.log(np.maximum(saturation, 1e-3)), LOG_SATURATION)
        total = total - 0.5 * (np.maximum(saturation - MOST_SATURATED[0], 0.0) / MOST_SATURATED[1]) ** 2
    return total


@dataclass(frozen=True)
class Candidates:
    """Veils that are weighed: transmittance and airlight, (bands, colours, depths, airlights), and prior density."""

    transmittance: Floats
    airlight: Floats
    prior: Floats
    colours: tuple[tuple[float, float], ...]


def candidates(options: PictureOptions) -> Candidates:
    """All veils on the grid of colours, optical depths and airlights."""
    colours = SLOPES if options.alpha is None else ((options.alpha, 0.0),)
    if len(options.wavelengths) == 1:
        colours = ((options.alpha or 0.0, 0.0),)
    ratio = np.array(options.wavelengths)[:, None, None, None] / REFERENCE
    alpha, beta = (np.array([c[k] for c in colours])[:, None, None] for k in (0, 1))
    t = np.exp(-DEPTHS[:, None] * ratio**-alpha)
    a = AIRLIGHTS * ratio**beta * np.ones_like(t)
    t = t * np.ones_like(a)
    middle = np.exp(-DEPTHS)[:, None]
    prior = np.exp(-DEPTHS / MEAN_DEPTH)[:, None] * np.exp(
        -0.5 * (np.log(AIRLIGHTS * (1.0 + np.sqrt(middle))) / LOG_AIRLIGHT) ** 2
    )
    share = np.array(
        [
            1.0 if len(colours) == 1 else GREY_VEIL if c == (0.0, 0.0) else (1 - GREY_VEIL) / (len(colours) - 1)
            for c in colours
        ]
    )
    prior = share[:, None, None] * (prior / prior.sum())
    return Candidates(t, a, prior, colours)


def judge(found: Features, t: Floats, a: Floats, transfer: Transfer) -> Floats:
    """Plausibility of what lies beneath veils (bands, ...)."""
    shape = (-1,) + (1,) * (t.ndim - 1)

    def beneath(light: Floats) -> Floats:
        return a + (light.reshape(shape) - a) / t

    low, high, mean = beneath(found.dark), beneath(found.bright), beneath(found.mean)
    spread = found.spread.reshape(shape) / t
    shown = encode(mean, transfer)
    contrast = 0.5 * (encode(mean + spread, transfer) - encode(np.maximum(mean - spread, 0.0), transfer))
    if transfer == "linear":
        contrast = spread
    chroma = saturation = None
    if len(found.mean) == 3:
        # Exact for grey veils; others shift the bands against each other by the shift of their means.
        inner = t.mean(axis=0)
        top = mean.max(axis=0) + (found.brightest - found.mean.max()) / inner
        bottom = mean.min(axis=0) - (found.mean.min() - found.darkest) / inner
        top, bottom = encode(top, transfer), encode(bottom, transfer)
        chroma = np.maximum(top - bottom, 0.0)
        saturation = chroma / np.maximum(top, 1e-3)
    return plausibility(
        encode(low, transfer),
        encode(high, transfer),
        shown,
        contrast,
        chroma,
        saturation,
        _scatter(found, t, a, transfer),
    )


def _scatter(found: Features, t: Floats, a: Floats, transfer: Transfer) -> Floats | None:
    """Scatter of the logarithm of the dark ends of blocks beneath veils; noise of 0.02 keeps it finite."""
    if found.floors is None:
        return None
    total = square = np.zeros(t.shape[1:])
    for block in found.floors.T:
        lowest = encode((a + (block.reshape((-1,) + (1,) * (t.ndim - 1)) - a) / t).min(axis=0), transfer)
        log_floor = np.log(np.maximum(lowest, 0.0) + 0.02)
        total, square = total + log_floor, square + log_floor**2
    number = found.floors.shape[1]
    return np.sqrt(np.maximum(square / number - (total / number) ** 2, 0.0)) + 0.02


@dataclass(frozen=True)
class Weights:
    """Posterior weights: of the candidates (colours, depths, airlights), and of there being no veil; their sum is one.

    ``log_evidence`` is the logarithm of the common factor that was divided out.
    """

    veil: Floats
    clear: float
    log_evidence: float


def weigh(found: Features, veils: Candidates, transfer: Transfer) -> Weights:
    """Posterior weights of veils on a picture with given features."""
    log_veil = judge(found, veils.transmittance, veils.airlight, transfer)
    one = np.ones((len(found.mean), 1))
    log_clear = float(judge(found, one, 0.5 * one, transfer)[0])
    top = max(float(log_veil.max()), log_clear)
    veil = (1.0 - NO_VEIL) * veils.prior * np.exp(log_veil - top)
    clear = NO_VEIL * float(np.exp(log_clear - top))
    total = float(veil.sum()) + clear
    return Weights(veil / total, clear / total, top + float(np.log(total)))
