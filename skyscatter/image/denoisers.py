"""Filters that take noise off pictures with a spectrum in each pixel; what becomes of their answers is `denoising`'s.

- ``oidn``: the network of Open Image Denoise (Intel, Apache-2.0; package ``pyoidn``), on three neighbouring wavelengths
  at a time as if they were red, green and blue, each divided by its mean; told what the pixels see first, or not.
- ``nlm``: non-local means with the variances of the pixels, after Rousselle, Knaus and Zwicker (2012, ACM Trans. Graph.
  31(6), 195, section 4): pixels are averaged whose surroundings look alike within their noise.

The same numbers come on every run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib import metadata
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]
#: A filter: pictures (y, x, wavelength) and variances of the same shape to pictures.
Filter = Callable[[Array, Array], Array]

#: Non-local means: half the side of the patches that are compared and of the square that is searched [pixel], and how
#: many standard deviations apart is alike.  Of Rousselle et al. (2012), with a smaller square.
PATCH, SEARCH, ALIKE = 3, 8, 0.45
#: What the network is told in place of an albedo of 0, of which it keeps the noise; it is told 1 minus that for 1.
DARKEST = 0.1
#: Rows and columns below which no picture of half the resolution is made.
LEAST = 16
#: Groups of wavelengths by which patches are compared.
GROUPS = 3


def chosen(method: str) -> str:
    """The filter that a word stands for: "auto" is ``oidn`` where its package is there.

    Raises
    ------
    DomainError
        For another word, and where the package of a filter is missing.
    """
    if method not in ("auto", "oidn", "nlm"):
        raise DomainError("denoise", method, "choose auto, oidn or nlm")
    there = find_spec("pyoidn") is not None
    if method == "oidn" and not there:
        raise DomainError("denoise", method, "take nlm, or have the package it needs: pip install pyoidn")
    return ("oidn" if there else "nlm") if method == "auto" else method


def filters_of(method: str, features: Array | None, side: int) -> tuple[str, list[Filter]]:
    """What a chosen filter is called in recipes, and its forms of which the best mixture is taken.

    At half the resolution too, where the shorter `side` of the picture has pixels enough; and told by `features`
    (y, x, 4) the albedo of what the pixels see first and the way that faces, where the filter can make use of them.
    """
    if method == "nlm":
        name, plain = "non-local means (Rousselle et al. 2012)", non_local_means
    else:
        name, plain = f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})", oidn
    forms: list[Filter] = [plain]
    if features is not None and method == "oidn":
        forms.append(partial(oidn, features=features))
    if side >= LEAST:
        forms.append(coarsened(plain))
    return name, forms


def triples(wavelengths: int) -> Iterator[tuple[list[int], slice]]:
    """Neighbouring wavelengths, three by three, and which of each three are new; the last ones are filled up."""
    for first in range(0, wavelengths, 3):
        begin = max(min(first, wavelengths - 3), 0)
        indices = [min(begin + k, wavelengths - 1) for k in range(3)]
        yield indices, slice(first - begin, min(first + 3, wavelengths) - begin)


def oidn(picture: Array, variance: Array, features: Array | None = None) -> Array:
    """The picture as the network of Open Image Denoise sees it; negative values are taken as 0."""
    import pyoidn

    found, known = np.empty_like(picture), {}
    if features is not None:
        albedo = DARKEST + (1 - 2 * DARKEST) * features[..., :1]
        normal = np.ascontiguousarray(features[..., 1:], np.float32)
        known = {"albedo": np.repeat(albedo, 3, axis=-1).astype(np.float32), "normal": normal, "clean_aux": True}
    for indices, new in triples(picture.shape[-1]):
        some = np.maximum(picture[..., indices], 0.0)
        scale = some.mean(axis=(0, 1))
        scale[scale <= 0.0] = 1.0
        clean: Any = pyoidn.denoise(np.ascontiguousarray(some / scale, np.float32), hdr=True, **known)
        found[..., indices[new]] = (clean * scale)[..., new]
    return found


def coarsened(denoise: Filter) -> Filter:
    """The filter applied at half the resolution: coarse noise, as of photons that light many pixels, is fine there."""

    def halved(cube: Array) -> Array:
        height, width = cube.shape[:2]
        even = np.pad(cube, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        return np.asarray(even.reshape(-(-height // 2), 2, -(-width // 2), 2, -1).mean(axis=(1, 3)))

    def filtered(picture: Array, variance: Array) -> Array:
        from scipy.ndimage import zoom

        clean = denoise(halved(picture), halved(variance) / 4)
        fine = zoom(clean, (2, 2, 1), order=1, mode="nearest", grid_mode=True)
        return np.asarray(fine[: picture.shape[0], : picture.shape[1]])

    return filtered


def non_local_means(picture: Array, variance: Array) -> Array:
    """Means over pixels whose surroundings are alike within their noise."""
    from scipy.ndimage import uniform_filter

    looks = np.stack(list(_grouped(picture)), axis=-1)
    # Standard deviations of neighbouring wavelengths are added as if they were one: walks carry all at once.
    noise = uniform_filter(np.stack(list(_grouped(np.sqrt(variance))), axis=-1) ** 2, (3, 3, 0), mode="nearest")
    total, weights = np.zeros_like(picture), np.zeros(picture.shape[:2])
    floor = 1e-8 * np.mean(looks**2, axis=(0, 1)) + 1e-300
    size = 2 * PATCH + 1
    border = ((SEARCH, SEARCH), (SEARCH, SEARCH), (0, 0))
    padded = [np.pad(part, border, mode="symmetric") for part in (picture, looks, noise)]
    for down in range(2 * SEARCH + 1):
        for across in range(2 * SEARCH + 1):
            here = slice(down, down + picture.shape[0]), slice(across, across + picture.shape[1])
            other, look, spread = (part[here] for part in padded)
            square = (looks - look) ** 2 - (noise + np.minimum(noise, spread))
            distance = np.mean(square / (floor + ALIKE**2 * (noise + spread)), axis=-1)
            weight = np.exp(-np.maximum(uniform_filter(distance, size, mode="nearest"), 0.0))
            total += weight[..., None] * other
            weights += weight
    return np.asarray(total / weights[..., None])


def _grouped(cube: Array) -> Iterator[Array]:
    """Means over a few groups of neighbouring wavelengths, each (y, x)."""
    for group in np.array_split(np.arange(cube.shape[-1]), min(GROUPS, cube.shape[-1])):
        yield cube[..., group].mean(axis=-1)
