"""A veil that was fitted to a picture, and the picture without it.

Fitted once for the whole image, on a lattice of cells at absolute positions; taken off pixel by pixel, so that any
window of the image gives the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.flags import Flag, mark
from skyscatter.dehaze.picture.evidence import (
    DARK_END,
    DEPTHS,
    Candidates,
    Weights,
    candidates,
    dark_end,
    features,
    weigh,
)
from skyscatter.dehaze.picture.lattice import Lattice, new_lattice, saturation_of
from skyscatter.dehaze.picture.options import PictureOptions
from skyscatter.dehaze.picture.relative import relative_depths
from skyscatter.dehaze.picture.transfer import decode, encode, encode_slope, tables
from skyscatter.dehaze.picture.veilmap import depth_moments, find_regions, heterogeneity, smooth, spread_map
from skyscatter.errors import DomainError

Floats = NDArray[np.float64]

KNEE = 0.9
"""Light from which on the bright end is compressed where the gain would carry it beyond 1."""
UNCERTAIN_DEPTH = 0.4
"""Standard deviation of the depth from which on a pixel is flagged; that of the prior is 0.52."""
PALE = DARK_END[0] + 2.0 * DARK_END[1]
"""Dark end of a band, without the veil, from which on the picture is flagged: pale ground, or a veil that was left."""


@dataclass(frozen=True)
class Veil:
    """A veil: light is A + (J - A) exp(-τ r) with J the clear picture.

    Attributes
    ----------
    depth, depth_sigma : (rows, columns) float
        Optical depth τ at 550 nm at the centres of the lattice's cells, and its standard deviation.
    ratio : (bands,) float
        Optical depth of the bands over that at 550 nm.
    airlight, airlight_sigma : (bands,) float
        The light A of the veil where it is opaque, 0 to 1 of the picture's scale, and its standard deviation.
    alpha, alpha_sigma : float
        Exponent of τ ~ λ^-α and its standard deviation.
    probability : float
        That there is a veil, on the picture or on the part of it that looks veiled.
    misfit : float
        Root mean square over the bands of ln(A / mean A): colour of the veil that no α explains.
    floor : (bands,) float
        Dark ends of the picture without the veil, 0 to 1 of the picture's scale.  What of them lies above those of
        most pictures is ground without anything dark, or what was left of the veil in that band.
    cell : int
        Edge of a cell, pixels.
    options : PictureOptions
        How the picture is read.
    """

    depth: Floats
    depth_sigma: Floats
    ratio: Floats
    airlight: Floats
    airlight_sigma: Floats
    alpha: float
    alpha_sigma: float
    probability: float
    misfit: float
    floor: Floats
    cell: int
    options: PictureOptions

    @property
    def pale(self) -> bool:
        """Whether nothing is dark in red or in blue, so that a veil, or its colour, may have been left on the picture.

        Green leaves are not dark in green.
        """
        return bool(encode(self.floor[[0, -1]], self.options.transfer).max() > PALE)

    def _left(self, clear: Floats) -> Floats:
        """What a veil that was left would have added to the light (band, h, w), should the ground not be pale.

        To the dark ends what they lie above where they mostly lie, and to all else less the nearer it is to the
        airlight.
        """
        usual = decode(np.array(DARK_END[0]), self.options.transfer)
        lifted, room = np.maximum(self.floor - usual, 0.0), np.maximum(self.airlight - self.floor, 0.1)
        share = np.minimum(np.abs(clear - self.airlight[:, None, None]) / room[:, None, None], 1.0)
        left: Floats = lifted[:, None, None] * share
        return left

    def gains(self, strength: float = 1.0) -> NDArray[np.float32]:
        """Gain 1 / t of the bands at the centres of the cells, (bands, rows, columns)."""
        return np.exp(strength * self.ratio[:, None, None] * self.depth).astype(np.float32)

    def apply(
        self, window: NDArray[np.floating], row0: int = 0, col0: int = 0, strength: float = 1.0
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """A window of the picture without the veil.

        Parameters
        ----------
        window : (bands, h, w) float
            Values 0 to 1; NaN where nothing was measured.
        row0, col0 : int
            Its corner in the image, pixels.
        strength : float
            Share of the veil's optical depth that is taken off, 0 (nothing) to 1 (all).

        Returns
        -------
        clean : (bands, h, w) float32
            Values 0 to 1 on the scale of the picture: relative, not reflectance.
        flags : (h, w) uint8
            Bits of `skyscatter.dehaze.flags`.

        Raises
        ------
        DomainError
            If the strength is not from 0 to 1, or the bands are not those of the veil.
        """
        from skyscatter.kernels.raster.picture import take_off

        if not 0.0 <= strength <= 1.0:
            raise DomainError("strength", strength, "from 0 (nothing is taken off) to 1 (the whole veil)")
        window = np.ascontiguousarray(window, dtype=np.float32)
        if window.ndim != 3 or len(window) != len(self.ratio):
            raise DomainError("window", window.shape, f"({len(self.ratio)}, rows, columns)")
        gains = self.gains(strength)
        decoding, encoding = tables(self.options.transfer)
        out, flags = np.empty_like(window), np.empty(window.shape[1:], np.uint8)
        marks = np.array([Flag.NODATA, Flag.SATURATED, Flag.CLOUD, Flag.WATER, Flag.CLIPPED], np.uint8)
        take_off(
            window, row0, col0, self.cell, gains, self.airlight.astype(np.float32), decoding, encoding,
            self.options.transfer != "linear", np.float32(KNEE), np.float32(saturation_of(self.options)),
            np.empty((len(window), gains.shape[2]), np.float32), out, flags, marks,
        )  # fmt: skip
        if strength == 0.0 or not self.depth.any():
            # Decoding and encoding again would cost a rounding.
            out = window.copy()
            flags &= np.uint8(255 - Flag.CLIPPED)
        doubtful = self._at((self.depth_sigma > UNCERTAIN_DEPTH) | self.pale, row0, col0, flags.shape)
        mark(flags, doubtful & (flags & np.uint8(Flag.NODATA) == 0), Flag.UNCERTAIN)
        return out, flags

    def _at(self, field: NDArray, row0: int, col0: int, shape: tuple[int, ...]) -> NDArray:
        """Values of the cells that the pixels of a window lie in."""
        r = (row0 + np.arange(shape[0])) // self.cell
        c = (col0 + np.arange(shape[1])) // self.cell
        return field[r[:, None], c]

    def depth_at(self, row0: int, col0: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Optical depth at 550 nm at the pixels of a window, bilinear between the cells."""
        from skyscatter.dehaze.lattice import at_pixels

        return at_pixels(self.depth, self.cell, row0, col0, shape)

    def uncertainty(self, window: NDArray[np.floating], row0: int = 0, col0: int = 0) -> NDArray[np.float32]:
        """Standard deviation of what `apply` returns at full strength, (bands, h, w).

        From those of the veil's depth and of its airlight, what may have been left of it where nothing is dark, and
        the rounding of the picture to its levels.
        """
        window = np.asarray(window, dtype=np.float64)
        transfer, pixels = self.options.transfer, window.shape[1:]
        gain = np.exp(self.ratio[:, None, None] * self._at(self.depth, row0, col0, pixels))
        a = self.airlight[:, None, None]
        light = decode(np.clip(window, 0.0, 1.0), transfer)
        clear = a + (light - a) * gain
        rounding = 1.0 / (np.sqrt(12.0) * (self.options.levels - 1)) / encode_slope(light, transfer)
        variance = ((clear - a) * self.ratio[:, None, None] * self._at(self.depth_sigma, row0, col0, pixels)) ** 2
        variance += self._left(clear) ** 2
        variance += ((gain - 1.0) * self.airlight_sigma[:, None, None]) ** 2 + (gain * rounding) ** 2
        return (np.sqrt(variance) * encode_slope(np.clip(clear, 0.0, 1.0), transfer)).astype(np.float32)

    def transmittance(self) -> Floats:
        """Transmittance of the veil at 550 nm at the centres of the cells, (rows, columns)."""
        return np.exp(-self.depth)

    def diagnostics(self) -> dict[str, object]:
        """What was found, in plain numbers."""
        return {
            "kind": "relative",
            "probability": round(self.probability, 4),
            "alpha": round(self.alpha, 3),
            "alpha_sigma": round(self.alpha_sigma, 3),
            "airlight": [round(float(a), 4) for a in self.airlight],
            "airlight_sigma": [round(float(a), 4) for a in self.airlight_sigma],
            "colour_misfit": round(self.misfit, 4),
            "dark_end": [round(float(v), 4) for v in encode(self.floor, self.options.transfer)],
            "depth_mean": round(float(self.depth.mean()), 4),
            "depth_range": [round(float(self.depth.min()), 4), round(float(self.depth.max()), 4)],
            "depth_sigma": round(float(self.depth_sigma.mean()), 4),
        }


def fit_picture(image: NDArray[np.floating], options: PictureOptions | None = None) -> Veil:
    """Fit a veil to a picture that fits into memory.

    Parameters
    ----------
    image : (bands, rows, columns) float
        Values 0 to 1; NaN where nothing was measured.
    options : PictureOptions
        How it is read.

    Raises
    ------
    DomainError
        If the image has not three dimensions, no pixels, or a number of bands that the options do not name.
    """
    options = options or PictureOptions()
    if image.ndim != 3:
        raise DomainError("image", image.shape, "(bands, rows, columns)")
    lattice = new_lattice(image.shape[1], image.shape[2], image.shape[0], options)
    lattice.gather(image, 0, 0, options)
    return fit_veil(lattice, options)


def fit_veil(lattice: Lattice, options: PictureOptions) -> Veil:
    """Fit a veil to the statistics of a picture, gathered window by window."""
    found = features(lattice)
    bands = len(options.wavelengths)
    if found is None:
        none, full, black = np.zeros(lattice.shape), np.full(bands, 0.5), np.zeros(bands)
        return Veil(
            none, none + 0.52, np.ones(bands), full, 0.15 * full, 0.0, 1.2, 0.0, 0.0, black, lattice.cell, options
        )
    veils = candidates(options)
    whole = weigh(found, veils, options.transfer)
    colours, chance = _colours(whole, veils), 1.0 - whole.clear
    depth, sigma = _depths(lattice, whole, colours, options)
    veiled = depth > np.quantile(depth, (0.1, 0.9)).mean()
    if veiled.any():  # not where the depth is the same everywhere
        # The whole picture says little of the colour of a veil that covers a part of it; that part does.
        part = features(replace(lattice, number=np.where(veiled, lattice.number, 0)), least=0.1)
        if part is not None:
            weights = weigh(part, veils, options.transfer)
            chance = max(chance, 1.0 - weights.clear)
            colours = _colours(weights, veils)
            depth, sigma = _depths(lattice, whole, colours, options)
    ratio, airlight, airlight_sigma, alpha, alpha_sigma = colours
    misfit = float(np.sqrt(np.mean(np.log(airlight / airlight.mean()) ** 2)))
    floor = dark_end(lattice, airlight[:, None, None], np.exp(ratio[:, None, None] * depth))
    return Veil(
        depth, sigma, ratio, airlight, airlight_sigma, alpha, alpha_sigma, chance, misfit, floor, lattice.cell, options
    )


def _depths(lattice: Lattice, whole: Weights, colours: Colours, options: PictureOptions) -> tuple[Floats, Floats]:
    """Optical depth and its standard deviation at all cells: the picture's own; as far as they differ its regions'."""
    level, sigma = depth_moments(whole)
    regions = find_regions(lattice)
    parts = relative_depths(regions.known(), colours.ratio, colours.airlight, options.transfer)
    values, errors = regions.filled(parts.depth, level), regions.filled(parts.sigma, 3.0)
    share = heterogeneity(values, errors) if options.shape == "auto" else 0.0
    if share == 0.0:
        return np.full(lattice.shape, level), np.full(lattice.shape, sigma)
    field = spread_map(smooth(values, errors), regions, lattice.shape)
    error = spread_map(np.minimum(errors, 1.0), regions, lattice.shape)
    # Regions tell by how much they differ; whether what they have in common is a veil, only the whole picture does.
    return np.maximum((1.0 - share) * level + share * field, 0.0), np.hypot(share * error, sigma)


class Colours(NamedTuple):
    """What a veil has in common everywhere."""

    ratio: Floats
    airlight: Floats
    airlight_sigma: Floats
    alpha: float
    alpha_sigma: float


def _colours(whole: Weights, veils: Candidates) -> Colours:
    """Relative depths and airlights of the bands, errors of the airlights, α and its error: means over the posterior.

    Weighted by what a veil adds, (1/t - 1), since veils that do nothing have no colour.
    """
    veil = whole.veil
    gain = 1.0 / veils.transmittance
    extra = (veil * (gain - 1.0)).sum(axis=(1, 2, 3))
    airlight = (veil * (gain - 1.0) * veils.airlight).sum(axis=(1, 2, 3)) / extra
    scatter = (veil * (gain - 1.0) * (veils.airlight - airlight[:, None, None, None]) ** 2).sum(axis=(1, 2, 3)) / extra
    depth = np.log1p(extra / veil.sum())
    middle = veil * (np.exp(_reference_depth(veils)) - 1.0)
    ratio = depth / np.log1p(middle.sum() / veil.sum())
    slopes = np.array([c[0] for c in veils.colours])
    share = middle.sum(axis=(1, 2)) / middle.sum()
    alpha = float(share @ slopes)
    alpha_sigma = float(np.sqrt(share @ (slopes - alpha) ** 2))
    return Colours(ratio, np.minimum(airlight, 1.0), np.sqrt(scatter), alpha, alpha_sigma)


def _reference_depth(veils: Candidates) -> Floats:
    """Optical depth at 550 nm of the candidates, to broadcast over (colours, depths, airlights)."""
    return DEPTHS[:, None] * np.ones(veils.prior.shape)
