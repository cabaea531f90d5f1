"""Pictures without their noise, and how far off they are.

A denoiser makes a picture D of the raw one, N.  It has a bias, which no number of samples takes away, so that what is
given out lies between the two:

    R = N + w (D - N).

Let A and B be independent halves of the samples, N their mean, D the mean of the pictures D_A and D_B that the denoiser
makes of each alone, and angle brackets means over pixels around.  As the noise of B knows nothing of D_A,

    v = <(A - B)^2> / 4                      is the variance of N,
    c = <(D_A - D_B) (A - B)> / 4            the covariance of N and D,
    m = <(D_A - B)^2 + (D_B - A)^2 - (A - B)^2> / 2 - <(D_A - D_B)^2> / 4

the mean squared error of D, all of them without bias and without the truth.  The least squared error has

    w = (v - c) / (v + m - 2 c),     (1 - w)^2 v + w^2 m + 2 w (1 - w) c.

With c = 0 this is the weight var / (var + mse) of estimators that are combined; halves that judge each other take the
place of the two buffers of Rousselle, Knaus and Zwicker (2012).  Half the difference of D_A and D_B is no error: it
lacks the bias.

Two or three such pictures are made, at full and at half the resolution, and with what the pixels see first where that
is known, and mixed before, one by one: D = D1 + u (D2 - D1) with

    u = <E_A (2 B - D1_A - D1_B) + E_B (2 A - D1_A - D1_B)> / <(E_A + E_B)^2>,    E = D2 - D1,

the least squares for D in which no half is compared with itself.

The denoiser is given the light of large patches back where it has lost more than chance explains, and the picture as a
whole keeps its light within a standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.image import denoisers

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Layers with the two halves of what is noisy in a picture.
HALVES = ("half_a", "half_b")
#: Layers that a denoised picture has in their place: the radiance as it was, and its standard error.
RAW, RAW_ERROR = "raw", "raw_error"
#: Side of the square over which means are taken, twice over, and how many pixels that is worth.
WINDOW = 11
WORTH = (1.5 * WINDOW) ** 2
#: How much shares of two denoised pictures differ from place to place.
SHARES = 0.5
#: Side of the tiles of which the error is stated.
TILE = 32
#: Standard deviation of the mean by which large patches of light are kept [pixel], and how many standard errors of it
#: are taken for chance.
WIDE, CHANCE = 12.0, 2.0
#: By which share of the light around a denoiser may be off where noise hides by how much it is.
PLAUSIBLE = 0.3
#: Squared chance, in units of that in the middle of the picture, beyond which a place says nothing of others.
OUTLYING = 100.0
#: Side of the square over which the level of the light is a median [pixel], and the least of it over the mean.
MEDIAN, DARKEST = 5, 0.01
#: How many times brighter than its surroundings, in both halves, is what stands out, and what it is joined by; medians
#: of every so many pixels.
BRIGHT, JOINED, COARSE = 30.0, 10.0, 4
#: It has sharp edges, within medians of so many pixels, or is known, with its neighbours, to this relative error.
SMALL, KNOWN = 15, 0.15


class Moments(NamedTuple):
    """What the halves say about picture and denoised picture, each (y, x, wavelength).

    Attributes
    ----------
    variance : ndarray
        Of the raw picture.
    spread : ndarray
        Variance of the denoised one.
    shared : ndarray
        Covariance of both.
    bias : ndarray
        Squared bias of the denoised one; negative by chance.
    """

    variance: Array
    spread: Array
    shared: Array
    bias: Array

    def error(self, weight: Array) -> Array:
        """Mean squared error of a picture between both."""
        denoised = self.spread + self.bias
        return np.asarray(
            (1 - weight) ** 2 * self.variance + weight**2 * denoised + 2 * weight * (1 - weight) * self.shared
        )

    def weight(self) -> Array:
        """Of the denoised picture, by which the error is least."""
        gain = self.variance - self.shared
        whole = gain + self.spread + self.bias - self.shared
        return np.clip(np.divide(gain, whole, out=np.zeros_like(gain), where=whole > 0), 0.0, 1.0)


def moments(a: Array, b: Array, clean_a: Array, clean_b: Array) -> Moments:
    """Moments of single pixels, from two halves and what the denoiser makes of each."""
    difference, denoised = a - b, clean_a - clean_b
    crossed = ((clean_a - b) ** 2 + (clean_b - a) ** 2 - difference**2) / 2
    return Moments(difference**2 / 4, denoised**2 / 4, denoised * difference / 4, crossed - denoised**2 / 2)


def local_mean(values: Array, mask: Mask) -> Array:
    """Means over the pixels around that are in the mask; 0 where there are none."""
    from scipy.ndimage import uniform_filter

    def spread(cube: Array) -> Array:
        for _ in range(2):
            cube = uniform_filter(cube, (WINDOW, WINDOW, 0), mode="constant")
        return cube

    share = spread(mask[..., None].astype(float))
    return np.where(share > 1e-9, spread(np.where(mask[..., None], values, 0.0)) / np.maximum(share, 1e-9), 0.0)


def around(values: Array, mask: Mask) -> Array:
    """Means over a pixel of the mask and its neighbours in it."""
    from scipy.ndimage import convolve1d

    def summed(cube: Array) -> Array:
        # No running sums: beside a lamp their rounding is more than a dark pixel has.
        for axis in (0, 1):
            cube = convolve1d(cube, np.ones(3), axis=axis, mode="constant")
        return cube

    share = summed(mask[..., None].astype(float))
    return summed(np.where(mask[..., None], values, 0.0)) / np.maximum(share, 1.0)


def togetherness(a: Array, b: Array, mask: Mask) -> float:
    """How many pixels share their noise: 1 where each has its own, many where a photon lights many.

    By it the squared noise of local means is greater than that of as many independent pixels.
    """
    half = (a - b) / 2
    alone = local_mean(half**2, mask)
    lit = mask[..., None] & (alone > 0)
    return max(float(np.mean(WORTH * local_mean(half, mask)[lit] ** 2 / alone[lit])), 1.0) if lit.any() else 1.0


def middle(values: Array, lit: Mask) -> Array:
    """Medians over the pixels of a mask (y, x, wavelength), shape (wavelength,); 0 where there are none."""
    return np.array([np.median(some[here]) if here.any() else 0.0 for some, here in zip(values.T, lit.T, strict=True)])


def steadied(single: Moments, mask: Mask, together: float = 1.0) -> tuple[Moments, Array, Array]:
    """Local moments; the squared bias, which is known worst, is drawn towards that of the whole picture.

    It is taken relative to the variance of the raw picture.  Local values whose spread is no greater than chance makes
    it say nothing, and are replaced by the common one; the greater their spread, the more they count (the estimate of
    James and Stein, in Efron and Morris 1973, J. Am. Stat. Assoc. 68, 117; 1972, ibid. 67, 130, for its limit).  Also
    returned are the standard deviation of what is found, and how much of it is more than chance; so many pixels as are
    `together` have their noise in common.
    """
    local = Moments(*(local_mean(part, mask) for part in single))
    variance = np.maximum(local.variance, 1e-150)
    ratio = local.bias / variance
    chance = np.maximum(local_mean(single.bias**2, mask) - local.bias**2, 0.0) * together / WORTH / variance**2
    lit = mask[..., None] & (local.variance > 0)
    # What is known far worse than most, as along a lamp's beam, tells nothing of the rest of the picture.
    outlying = chance > OUTLYING * middle(chance, lit)
    lit &= ~outlying
    count = np.maximum(lit.sum(axis=(0, 1)), 1)

    def mean(values: Array) -> Array:
        return np.asarray(np.where(lit, values, 0.0).sum(axis=(0, 1)) / count)

    common = np.maximum(mean(ratio), 0.0)
    real = np.maximum(mean((ratio - common) ** 2 - chance), 0.0)
    share = real / np.maximum(real + chance, 1e-300)
    drawn = np.maximum(share * ratio + (1 - share) * common, 0.0)
    # Limited translation: no place is drawn further down than chance explains.
    least = ratio - CHANCE * np.sqrt(chance)
    common_doubt = share * chance + (1 - share) ** 2 * mean(chance) * WORTH / count
    doubt = np.sqrt(np.where(outlying | (least > drawn), chance, common_doubt))
    bias = np.maximum(drawn, least) * variance
    found = Moments(variance, np.maximum(local.spread, 0.0), local.shared, bias)
    return found, doubt * variance, np.maximum(least, 0.0) * variance


def mixed(
    a: Array, b: Array, first: tuple[Array, Array], second: tuple[Array, Array], mask: Mask, together: float = 1.0
) -> tuple[Array, ...]:
    """Of two pictures of each half the mixture with the least squared error, one share for both halves.

    Returns
    -------
    a, b : ndarray
    flattered : ndarray
        What the squared error looks less than it is: a share that is fitted to so many pixels brings down what is seen
        of it by variance / pixels, and raises the true one by as much (Mallows 1973, Technometrics 15, 661).
    """
    step_a, step_b = second[0] - first[0], second[1] - first[1]
    along = local_mean(step_a * (2 * b - first[0] - first[1]) + step_b * (2 * a - first[0] - first[1]), mask)
    square = local_mean((step_a + step_b) ** 2, mask)
    # Where both pictures differ by less than chance the share is that of the whole picture.
    noise = np.maximum(local_mean((a - b) ** 2, mask), 0.0) * together / WORTH
    chance = noise / SHARES**2
    common = np.clip(along.sum(axis=(0, 1)) / np.maximum(square.sum(axis=(0, 1)), 1e-300), 0.0, 1.0)
    share = np.clip((along + chance * common) / np.maximum(square + chance, 1e-300), 0.0, 1.0)
    fitted = square / np.maximum(square + chance, 1e-300)
    return first[0] + share * step_a, first[1] + share * step_b, fitted**2 * noise / 2


def wide_mean(values: Array) -> Array:
    """Means over large patches."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, (WIDE, WIDE, 0), mode="nearest", truncate=3.0))


def faithful(picture: Array, clean: Array, variance: Array, together: float = 1.0) -> Array:
    """The denoised picture, given back what it has lost of large patches of light beyond chance."""
    lost = wide_mean(picture - clean)
    # Of independent pixels the squared weights of a Gaussian add up to 1 / (4 pi sigma^2).
    chance = CHANCE**2 * together * wide_mean(variance) / (4 * np.pi * WIDE**2)
    return np.asarray(clean + lost * np.maximum(1 - chance / np.maximum(lost**2, 1e-300), 0.0))


def denoised(image: SpectralImage, method: str = "auto") -> SpectralImage:
    """The image without its noise; see `skyscatter.SpectralImage.denoised`."""
    if any(name not in image.layers for name in HALVES) or image.error is None:
        rule = "needs two halves of the walks or passes; render with halves=True and the solver path or photons"
        raise DomainError("denoise", f"layers {', '.join(image.layers) or 'none'}", rule)
    inside, sight = image.inside, image.features
    if sight is not None:
        sight = _filled(np.nan_to_num(sight), inside)
    label, filters = denoisers.filters_of(denoisers.chosen(method), sight, min(inside.shape))
    a, b = (_filled(np.asarray(image.layers[name], float), inside) for name in HALVES)
    mask, shown_a, shown_b = set_aside(a, b, noisy_pixels(a, b, inside))
    raw_error = np.asarray(image.error, float)
    if mask.any():
        change, square = _blended(shown_a, shown_b, mask, _filled(raw_error, inside) ** 2, filters)
    else:
        change, square = np.zeros_like(a), np.zeros_like(a)
    known = ~mask[..., None]
    error = np.where(known, raw_error, np.sqrt(square))
    others = {name: values for name, values in image.layers.items() if name not in HALVES}
    errors = (np.where(inside[..., None], values, 0.0) for values in (error, raw_error))
    about = {"method": label, **stated((a + b) / 2, *errors)}
    return type(image)(
        image.radiance + np.where(known, 0.0, change),
        image.wavelengths,
        error,
        recipe={**image.recipe, "denoising": about},
        layers={**others, RAW: image.radiance, RAW_ERROR: image.error},
        sky=image.sky,
    )


def noisy_pixels(a: Array, b: Array, inside: Mask) -> Mask:
    """Pixels that have noise.

    Halves that agree to the last digit had nothing to differ in, a lamp that is seen or empty space; unless no light
    was found where most pixels around have some.
    """
    from scipy.ndimage import uniform_filter

    differ = (a != b).any(axis=-1) & inside
    crowded = uniform_filter(differ.astype(float), 5, mode="constant") > 0.5
    return np.asarray(differ | (crowded & inside & ~(a.any(axis=-1) | b.any(axis=-1))))


def surroundings(picture: Array) -> Array:
    """How bright it is around each pixel, whatever stands out there, and at least as in the middle of all that is lit.

    Shape (y, x, wavelength).
    """
    from scipy.ndimage import median_filter

    some = median_filter(picture[::COARSE, ::COARSE], (9, 9, 1), mode="nearest")
    height, width = picture.shape[:2]
    wide = some.repeat(COARSE, axis=0).repeat(COARSE, axis=1)[:height, :width]
    return np.maximum(wide, middle(picture, picture > 0))


def set_aside(a: Array, b: Array, mask: Mask) -> tuple[Mask, Array, Array]:
    """The mask without what stands out, and both halves with the light of its surroundings in its place.

    Lamps and beams that are far brighter than all around are known well and stay as they are; a network sees black
    halos about them.  Chance seldom strikes twice: what is so bright in both halves is no speck.  The fainter edges of
    a beam go with it, a horizon that is as faint stays, and so does the bright middle of a nebula, for it is noisy and
    has no edge.
    """
    from scipy.ndimage import binary_propagation, median_filter

    wide = surroundings((a + b) / 2)
    least, lit = np.minimum(a, b), np.ones(mask.shape, bool)
    known = np.sqrt(around((a - b) ** 2, lit)) < KNOWN * around(a + b, lit)
    small = least > JOINED * median_filter((a + b) / 2, (SMALL, SMALL, 1), mode="nearest")
    faint, bright = (np.any((least > times * wide) & (known | small), axis=-1) for times in (JOINED, BRIGHT))
    standing = binary_propagation(bright, np.ones((3, 3)), faint)
    covered = [np.where(standing[..., None], wide, half) for half in (a, b)]
    return mask & ~standing, covered[0], covered[1]


def light_level(picture: Array, clean: Array) -> Array:
    """Unit in which errors around each pixel are counted, (y, x, wavelength): the root of how bright it is there.

    In units of the light itself a dark pixel beside a lamp would count as much as the lamp, and in none at all the lamp
    would decide for all that lies within a window of it.  The greater of a median, in which a pixel's own noise has no
    say, and the denoised picture, in which small lamps are left.
    """
    from scipy.ndimage import median_filter

    mean = picture.mean(axis=(0, 1))
    level = np.maximum(median_filter(picture, (MEDIAN, MEDIAN, 1), mode="nearest"), clean)
    return np.asarray(np.sqrt(np.maximum(level / np.where(mean > 0, mean, 1.0), DARKEST)))


def _cleaned(
    halves: tuple[Array, Array], pictures: Sequence[tuple[Array, Array]], level: Array, mask: Mask, variance: Array,
    together: float,
) -> tuple[Array, ...]:  # fmt: skip
    """Both halves denoised, the mixture of the `pictures` that filters make of them, and what that flatters.

    All in units of the `level`.
    """

    def kept(some: tuple[Array, Array]) -> tuple[Array, Array]:
        whole = [faithful(*pair, 2 * variance, together) / level for pair in zip(halves, some, strict=True)]
        return whole[0], whole[1]

    clean, flattered = kept(pictures[0]), np.zeros_like(level)
    for some in pictures[1:]:
        one, two, more = mixed(halves[0] / level, halves[1] / level, clean, kept(some), mask, together)
        clean, flattered = (one, two), flattered + more
    return *clean, flattered


def _blended(
    a: Array, b: Array, mask: Mask, variance: Array, filters: Sequence[denoisers.Filter]
) -> tuple[Array, Array]:  # fmt: skip
    """What is added to the raw picture, and the mean squared error of the sum."""
    pictures = [(some(a, 2 * variance), some(b, 2 * variance)) for some in filters]
    level = light_level((a + b) / 2, (pictures[0][0] + pictures[0][1]) / 2)
    part_a, part_b = a / level, b / level
    together = togetherness(part_a, part_b, mask)
    clean_a, clean_b, flattered = _cleaned((a, b), pictures, level, mask, variance, together)
    found, doubt, sure = steadied(moments(part_a, part_b, clean_a, clean_b), mask, together)
    found = found._replace(bias=found.bias + flattered)
    # In doubt nearer to the raw picture, but no further than a denoiser is seen to be off, or may be.
    most = PLAUSIBLE**2 * local_mean(((clean_a + clean_b) / 2) ** 2, mask)
    weight = found._replace(bias=np.maximum(np.minimum(found.bias + doubt, most), sure)).weight()
    change = np.where(mask[..., None], weight * ((clean_a + clean_b) - (part_a + part_b)) / 2, 0.0) * level
    # The picture as a whole keeps its light within a standard error.  What is missing goes where there is noise, but as
    # a share of the light no more than at the median: what a speck has too much is missing all over.
    noise = np.where(mask[..., None], np.sqrt(found.variance), 0.0) / level
    lost, chance = -change.sum(axis=(0, 1)), np.sqrt((found.variance * (mask[..., None] * level) ** 2).sum(axis=(0, 1)))
    excess = np.sign(lost) * np.maximum(np.abs(lost) - chance, 0.0)
    share = level**2 * np.minimum(noise, middle(noise, noise > 0))
    change += share * (excess / np.maximum(share.sum(axis=(0, 1)), 1e-300))
    # How much is left of the noise goes by what lies around, how much there was by the pixel itself and its neighbours.
    left = np.clip(found.error(weight) / found.variance, 0.0, 1.0)
    return change, left * around(variance, mask)


def _filled(cube: Array, inside: Mask) -> Array:
    """The cube with values of the nearest pixels outside the camera's field."""
    if inside.all():
        return cube
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return np.asarray(cube[rows, columns])


def stated(light: Array, error: Array, raw_error: Array) -> dict[str, Any]:
    """Errors of the picture and of its tiles before and after, relative to their mean light."""

    def relative(values: Array, part: tuple[slice, slice]) -> float | None:
        mean = light[part].mean(axis=(0, 1))
        lit = mean > 0
        square = (values[part] ** 2).mean(axis=(0, 1))[lit] / mean[lit] ** 2
        return float(f"{np.sqrt(square.mean()):.4g}") if lit.any() else None

    height, width = light.shape[:2]
    whole = slice(0, height), slice(0, width)
    tiles = [[(slice(j, j + TILE), slice(i, i + TILE)) for i in range(0, width, TILE)] for j in range(0, height, TILE)]
    return {
        "error": relative(error, whole),
        "raw_error": relative(raw_error, whole),
        "tile_pixels": TILE,
        "tile_errors": [[relative(error, tile) for tile in row] for row in tiles],
        "raw_tile_errors": [[relative(raw_error, tile) for tile in row] for row in tiles],
    }


def undenoised(image: SpectralImage) -> SpectralImage:
    """The image as it was before it was denoised."""
    others = {name: values for name, values in image.layers.items() if name not in (RAW, RAW_ERROR)}
    recipe = {name: value for name, value in image.recipe.items() if name != "denoising"}
    if RAW not in image.layers or RAW_ERROR not in image.layers:
        rule = "a denoised image is read with its raw layers, raw and raw_error; take a file that has them"
        raise DomainError("image", f"layers {', '.join(image.layers) or 'none'}", rule)
    raw, error = image.layers[RAW], image.layers[RAW_ERROR]
    return type(image)(raw, image.wavelengths, error, recipe=recipe, layers=others, sky=image.sky)
