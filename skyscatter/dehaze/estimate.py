"""How much haze there is over an image, of which kind, where, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from skyscatter.dehaze.dark import ANYTHING, TELLING, cover_spectra, log_likelihood
from skyscatter.dehaze.hazemap import regularised
from skyscatter.dehaze.sensing import Gases, with_water
from skyscatter.dehaze.table import TermsTable

Array = NDArray[np.float64]

TRIALS = 48  #: amounts of haze tried, denser where there is little
#: Prior of the optical depth: median and spread of its logarithm, after the distribution over land of satellite and
#: ground network records (medians of 0.1 to 0.2, factors of 2 to 3 between quartiles and extremes).
PRIOR_MEDIAN, PRIOR_SPREAD = 0.14, 0.9
#: Correlation of what the dark ground of two cells is mistaken by: leaves here are like leaves there.  It keeps a
#: thousand cells from being as sure as a thousand independent witnesses.
CORRELATION = 0.3
#: What the optics of a named model, its profile and the covers leave open anyhow: a part of the depth, and a little
#: more.
MODEL_SPREAD, MODEL_SPREAD_AT_LEAST = 0.07, 0.01
#: The part where many aerosols are judged side by side, whose optics are told by their differences: the profile's.  By
#: 6SV 1.1 a scale height of 1 or 4 km in place of 2 km does to the path reflectance what 1.5 % of the depth would (root
#: mean square over four aerosols, two geometries and the bands from 443 to 665 nm; 5 % at most).
PROFILE_SPREAD = 0.02
#: How far the haze may vary within an image: a part of it, and a little more.
VARIES, VARIES_AT_LEAST = 0.5, 0.03
#: Width of the law under which cells are asked whether the haze varies by more, and the part of the tried range beyond
#: which it has not been found.
FREELY, NEAR_THE_END = 0.7, 0.85
#: How usual the models are: over land the single-scattering albedo is mostly near the continental one (0.9), and
#: the soot of the urban one (0.65) is rare (Dubovik et al. 2002, J. Atmos. Sci. 59, 590).  Dark ground hardly tells
#: how much an aerosol absorbs, so this matters.
USUALNESS = {"continental": 0.65, "maritime": 0.25, "urban": 0.10}
#: How probable it is beforehand that haze is like that of one of the twelve places of `aerosols.site_names`, each as
#: usual as the next, rather than like one of the models above: nothing is known of that.
ELSEWHERE = 0.5
#: Cells by which aerosols that are not solved for are judged, at most: their haze is that of the image.
FEW_CELLS = 256
#: A cell whose ground is probably unknown says nothing that can be relied on.
UNKNOWN = 0.5


@dataclass(frozen=True)
class HazeEstimate:
    """What was found.

    Attributes
    ----------
    aod, sigma : ndarray, shape (large row, large column)
        Optical depth at 550 nm and its standard deviation.
    mean, mean_sigma : float
        Of the whole image; the latter with what the models disagree by.
    aerosol : str
        The most probable model.
    probabilities : dict of str to float
        Of the models that were tried, and of the others that were judged.
    depths : dict of str to float
        The image's optical depth under each of them.
    uncertain : ndarray of bool, shape (large row, large column)
        Where nothing dark was found and neighbours or the prior stand in.
    notes : tuple of str
    solved : tuple of str
        The models that were tried.
    """

    aod: Array
    sigma: Array
    mean: float
    mean_sigma: float
    aerosol: str
    probabilities: dict[str, float]
    depths: dict[str, float]
    uncertain: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
    solved: tuple[str, ...] = ()


def trial_depths(greatest: float) -> Array:
    """Optical depths to try, from nearly zero up, evenly spaced in log(1 + aod / 0.1)."""
    depths: Array = 0.1 * np.expm1(np.linspace(0.0, np.log1p(greatest / 0.1), TRIALS))
    return depths


def log_prior(aod: Array) -> Array:
    """Logarithm of the prior density of optical depths."""
    x = np.log(np.maximum(aod, 1e-3) / PRIOR_MEDIAN) / PRIOR_SPREAD
    density: Array = -0.5 * x**2 - np.log(np.maximum(aod, 1e-3))
    return density


def moments(aod: Array, log_density: Array) -> tuple[Array, Array, Array]:
    """Mean and standard deviation of densities (..., trial), and the logarithm of their integral."""
    width = np.gradient(aod)
    weight = log_density + np.log(width)
    total = logsumexp(weight, axis=-1, keepdims=True)
    share = np.exp(weight - total)
    mean = share @ aod
    spread = np.sqrt(np.maximum(share @ aod**2 - mean**2, (0.3 * width.min()) ** 2))
    return mean, spread, total[..., 0]


class _Judged:
    """What one aerosol model makes of the dark cells."""

    def __init__(self, table: TermsTable, observed: Array, around: Array, angles: Array, gas: Gases) -> None:
        self.table = table
        self.depths = trial_depths(float(table.aod[-1]))
        (terms,) = with_water(table.at(self.depths, *(a[:, None] for a in angles), clip=True)[:1], gas)
        self.likelihood, covers = log_likelihood(observed, around, terms, cover_spectra(table.bands))
        local = self.likelihood + log_prior(self.depths)
        weight = np.exp(local - logsumexp(local, axis=-1, keepdims=True))
        self.unknown = (weight * covers[ANYTHING]).sum(axis=-1)
        self.telling = (weight * covers[TELLING].sum(axis=0)).sum(axis=-1)
        # Cells of unknown ground bound the haze from above and vote no further.
        known = np.maximum(1 - self.unknown, 0.02)
        count = known.sum()
        effective = count / (1 + (count - 1) * CORRELATION) if count > 1 else count
        pooled = (known @ self.likelihood) * (effective / count)
        self.mean, self.sigma, _ = moments(self.depths, pooled + log_prior(self.depths))

    def evidence(self, telling: Array) -> float:
        """Logarithm of the evidence for the model, by cells of that weight.

        What leaves or water really look like is the same question in every cell: as evidence for one model of the
        aerosol, whose colour it competes with, all cells are one witness, and none where there is neither.
        """
        one = (telling @ self.likelihood) / max(float(telling.sum()), 1.0)
        return float(moments(self.depths, one + log_prior(self.depths))[2])

    def local(self, centre: float, varies: float) -> tuple[Array, Array]:
        """What cells say by themselves, and how surely: normal laws that turn the image's haze into theirs.

        A cell's density times that of the image's haze, which varies by `varies` about `centre`, has a mean and a
        variance; divided by the latter's normal law they are the cell's own.  Infinite variance where a cell only says
        what was known.
        """
        image = -0.5 * ((self.depths - centre) / varies) ** 2
        # Of the law as far as it lies within the depths that are tried.
        before, before_spread, _ = moments(self.depths, image)
        mean, spread, _ = moments(self.depths, self.likelihood + image)
        precision = 1 / spread**2 - 1 / before_spread**2
        tells = (precision > 0.05 / before_spread**2) & (self.unknown < UNKNOWN)
        safe = np.where(tells, precision, 1.0)
        said = np.where(tells, (mean / spread**2 - before / before_spread**2) / safe, centre)
        return said, np.where(tells, 1 / np.sqrt(safe), np.inf)

    def variation(self) -> tuple[float, float]:
        """About what, and by how much, the haze varies within the image.

        By a part of itself, unless the cells, each for itself, differ by more than they err: then by that, about their
        mean, since one depth for all would follow the clearer ones.
        """
        usual = VARIES * float(self.mean) + VARIES_AT_LEAST
        said, spread = self.local(float(self.mean), FREELY)
        known = np.isfinite(spread)
        if known.sum() < 4:
            return float(self.mean), usual
        weight = 1 / (spread[known] ** 2 + usual**2)
        centre = float(weight @ said[known] / weight.sum())
        scatter = float(weight @ (said[known] - centre) ** 2 / weight.sum())
        between = np.sqrt(max(scatter - float(np.median(spread[known] ** 2)), 0.0))
        return (centre, float(between)) if between > usual else (float(self.mean), usual)


def estimate(
    tables: Sequence[TermsTable],
    observed: Array,
    around: Array | Sequence[Array],
    angles: Array,
    gas: Gases,
    vary: bool = True,
    others: Sequence[TermsTable] = (),
) -> HazeEstimate:
    """Haze by the darkest pixels of all cells, under any of some aerosol models.

    Parameters
    ----------
    tables : sequence of TermsTable
        One for each aerosol model, of the same bands and angles.
    observed : array, shape (band, large row, large column)
        Dark spectra above the scattering air (ozone and mixed gases divided out); NaN where there is nothing to judge.
    around : array or sequence of array, shape (band, large row, large column)
        The same of what lies around, as the air of each model spreads it; one for all of them where it hardly differs.
    angles : array, shape (3, large row, large column)
        Zenith angles of Sun and view, relative azimuth [degree].
    gas : Gases
        At all large cells, row by row.
    vary : bool
        Whether the haze may vary over the image.
    others : sequence of TermsTable
        Of aerosols that it may be as well, of which none is the one that is reported.
    """
    shape = observed.shape[1:]
    near_by = [around] * len(tables) if isinstance(around, np.ndarray) else list(around)
    seen = np.isfinite(observed).all(axis=0) & np.isfinite(near_by).all(axis=(0, 1))
    names = [table.atmosphere.aerosol for table in tables]
    if not seen.any():
        return from_prior(names, [t.atmosphere.aerosol for t in others], shape)
    near = seen.ravel()
    here = Gases(gas.above[near], gas.water[near], gas.half[near], gas.relative)
    judged = [
        _Judged(table, observed[:, seen].T, lit[:, seen].T, angles[:, seen], here)
        for table, lit in zip(tables, near_by, strict=True)
    ]
    telling = np.mean([j.telling for j in judged], axis=0)
    evidence = np.array([j.evidence(telling) for j in judged])
    means = np.array([float(j.mean) for j in judged])
    number = int((evidence + np.log(usualness(names)[: len(names)])).argmax())
    best = judged[number]
    if others:
        more = _elsewhere(others, best, near_by[number][:, seen].T, observed[:, seen].T, angles[:, seen], here, telling)
        evidence, means = np.append(evidence, evidence[number] + more[0]), np.append(means, best.mean * more[1])
    every = [*names, *(t.atmosphere.aerosol for t in others)]
    weight = evidence + np.log(usualness(names, len(others)))
    shares = np.exp(weight - logsumexp(weight))
    notes = []
    dark = best.unknown < UNKNOWN
    # A single model was named, and is taken at its word; others besides it differ in its phase function alone.
    left_open = PROFILE_SPREAD if others and len(tables) > 1 else MODEL_SPREAD
    mean = float(best.mean)
    mean_sigma = float(np.sqrt(best.sigma**2 + (left_open * mean) ** 2 + MODEL_SPREAD_AT_LEAST**2))
    uncertain = np.ones(shape, bool)
    uncertain[seen] = ~dark
    if not dark.any():
        notes.append("nothing dark was recognised: the haze is little more than the prior's")
    if mean > NEAR_THE_END * best.depths[-1]:
        uncertain[:] = True
        notes.append(f"haze at the end of the range that is tried, {best.depths[-1]:g}: too thick, or snow everywhere")
    if vary:
        centre, varies = best.variation()
        said, spread = np.full(shape, centre), np.full(shape, np.inf)
        said[seen], spread[seen] = best.local(centre, varies)
        aod, local = regularised(said, spread, centre, varies)
        mean = float(aod.mean())
    else:
        aod, local = np.full(shape, mean), np.zeros(shape)
    apart = float(np.sqrt(shares @ (means - shares @ means) ** 2))
    # What is told of the whole image is the mean over the models; the map is that of the best.
    mean *= float(shares @ means) / max(float(best.mean), 1e-6)
    return HazeEstimate(
        aod, np.hypot(local, mean_sigma), mean, float(np.hypot(mean_sigma, apart)), names[number],
        named(every, shares), named(every, means), uncertain, tuple(notes), tuple(names),
    )  # fmt: skip


def usualness(tried: Sequence[str], others: int = 0) -> Array:
    """Probabilities beforehand of models that are tried, and of others."""
    usual = np.array([USUALNESS.get(name, min(USUALNESS.values())) for name in tried])
    if not others:
        return np.asarray(usual / usual.sum())
    return np.append((1 - ELSEWHERE) * usual / usual.sum(), np.full(others, ELSEWHERE / others))


def _elsewhere(
    tables: Sequence[TermsTable], best: _Judged, around: Array, observed: Array, angles: Array, gas: Gases,
    telling: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """What aerosols have more of evidence than the best model, and of haze in proportion, by some of the cells."""
    few = np.unique(np.linspace(0, len(observed) - 1, FEW_CELLS).astype(int))
    here = Gases(gas.above[few], gas.water[few], gas.half[few], gas.relative)

    def judged(table: TermsTable) -> tuple[float, float]:
        one = _Judged(table, observed[few], around[few], angles[:, few], here)
        return one.evidence(telling[few]), float(one.mean)

    known, mean = judged(best.table)
    found = np.array([judged(table) for table in tables])
    return found[:, 0] - known, found[:, 1] / max(mean, 1e-6)


def from_prior(names: Sequence[str], others: Sequence[str], shape: tuple[int, ...]) -> HazeEstimate:
    """The haze that is expected where nothing can be seen of it."""
    mean = float(PRIOR_MEDIAN * np.exp(0.5 * PRIOR_SPREAD**2))
    sigma = float(mean * np.sqrt(np.expm1(PRIOR_SPREAD**2)))
    note = "no cell has enough clear pixels: the haze is the prior's"
    found = as_given(names, np.full(shape, mean), np.full(shape, sigma), np.ones(shape, bool), others)
    return replace(found, notes=(note,))


def as_given(
    names: Sequence[str], depth: Array, sigma: Array, missing: NDArray[np.bool_], others: Sequence[str] = ()
) -> HazeEstimate:
    """A known amount of haze (large row, large column), of models, and of others, as probable as they are usual.

    Its error `sigma` is taken to be one and the same everywhere, as that of an instrument is; where it is `missing` the
    haze is called uncertain.
    """
    shares, every = usualness(names, len(others)), [*names, *others]
    return HazeEstimate(
        depth, sigma, float(depth.mean()), float(sigma.mean()), names[int(shares[: len(names)].argmax())],
        named(every, shares), dict.fromkeys(every, float(depth.mean())), missing, solved=tuple(names),
    )  # fmt: skip


def named(names: Sequence[str], values: Array) -> dict[str, float]:
    """Numbers by name."""
    return {name: float(value) for name, value in zip(names, values, strict=True)}
