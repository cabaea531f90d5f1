"""The veil of each region relative to the others: the regions of a scene are more alike than pictures at large.

What a veil does to a region is a certain change of several numbers together: the dark end rises, contrast and
saturation fall.  Under the right depths all regions of a scene have dark ends, contrasts and saturations that scatter
about common values; which values, and how far they scatter, is found with the depths themselves, in turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.picture.evidence import BLACK, DEPTHS, MEAN_DEPTH, NO_VEIL, Features, judge
from skyscatter.dehaze.picture.transfer import Transfer, encode

Floats = NDArray[np.float64]

GRID = np.concatenate([[0.0], DEPTHS])
LEAST_SCATTER = np.array([0.05, 0.35, 0.35])
"""Scatter of regions of any scene, at least: dark end, logarithms of contrast and of saturation."""
GENERAL = 0.5
"""Weight of what pictures at large look like, of which the scene's own values repeat a part."""
SURFACE_DEPTH = 0.12
"""Error of a region's depth from its surfaces, which a single region does not show: dark ends that differ by 0.05 of
the scale seem to be veils that differ by 0.05 / A in depth."""
NOTHING_DARK, PALE = 0.15, 0.3
"""Share of regions without a dark object, and how far above those of others their dark ends then lie."""
TURNS = 8


@dataclass(frozen=True)
class RelativeDepths:
    """Depths of regions and their standard deviations, (regions,)."""

    depth: Floats
    sigma: Floats


def relative_depths(regions: list[Features], ratio: Floats, airlight: Floats, transfer: Transfer) -> RelativeDepths:
    """Depths of regions under a veil of known colour.

    Parameters
    ----------
    regions : list of Features
        At least one.
    ratio, airlight : (bands,) float
        Depths of the bands over that at 550 nm, and light of the opaque veil.
    transfer : Transfer
        How light is shown.
    """
    t, a = np.exp(-ratio[:, None] * GRID), np.repeat(airlight[:, None], len(GRID), axis=1)
    traits = np.array([_traits(found, t, a, transfer) for found in regions])
    step = np.gradient(GRID)
    prior = np.where(GRID == 0.0, NO_VEIL, (1.0 - NO_VEIL) * np.exp(-GRID / MEAN_DEPTH) / MEAN_DEPTH * step)
    general = np.log(prior) - 0.5 * (np.minimum(traits[:, 0], 0.0) / BLACK) ** 2
    alone = np.array([judge(found, t, a, transfer) for found in regions])
    weight = _normalised(general + alone)
    for _ in range(TURNS):
        means = (weight[:, None] * traits).sum(axis=-1)
        centre = np.median(means, axis=0)
        scatter = np.maximum(1.4826 * np.median(np.abs(means - centre), axis=0), LEAST_SCATTER[: traits.shape[1]])
        alike = _alike(traits - centre[:, None], scatter)
        weight = _normalised(general + GENERAL * alone + alike)
    depth = weight @ GRID
    variance = np.maximum(weight @ GRID**2 - depth**2, 0.0)
    return RelativeDepths(depth, np.sqrt(variance + SURFACE_DEPTH**2))


def _alike(difference: Floats, scatter: Floats) -> Floats:
    """Log-density of differences (regions, traits, depths) from the common values; a region may hold nothing dark."""
    common = np.log(1.0 - NOTHING_DARK) - 0.5 * (difference[:, 0] / scatter[0]) ** 2
    pale = np.log(NOTHING_DARK * scatter[0] / PALE) - 0.5 * (difference[:, 0] / PALE) ** 2
    rest = -0.5 * ((difference[:, 1:] / scatter[1:, None]) ** 2).sum(axis=1)
    return np.where(difference[:, 0] > 0.0, np.logaddexp(common, pale), common) + rest


def _traits(found: Features, t: Floats, a: Floats, transfer: Transfer) -> Floats:
    """Dark end, logarithm of the contrast and, of colours, of the saturation, (traits, depths)."""
    dark = encode((a + (found.dark[:, None] - a) / t).min(axis=0), transfer)
    spread, mean = found.spread[:, None] / t, a + (found.mean[:, None] - a) / t
    shown = encode(mean + spread, transfer) - encode(mean, transfer)
    traits = [dark, np.log(np.maximum(shown.mean(axis=0), 1e-4))]
    if len(mean) == 3:
        inner = t.mean(axis=0)
        top = encode(mean.max(axis=0) + (found.brightest - found.mean.max()) / inner, transfer)
        bottom = encode(mean.min(axis=0) - (found.mean.min() - found.darkest) / inner, transfer)
        traits.append(np.log(np.clip((top - bottom) / np.maximum(top, 1e-3), 0.02, 1.0)))
    return np.stack(traits)


def _normalised(logs: Floats) -> Floats:
    weight = np.exp(logs - logs.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)
