"""Tables of media by hand, for tests that look at kernels alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skyscatter.kernels.space import SpaceTable
from skyscatter.kernels.surfaces.tables import MediaTable
from skyscatter.media.space import SpatialField
from skyscatter.media.spacetables import pack_space
from skyscatter.solvers.compile import phase_cosines

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stuff:
    """One component: scattering and absorption [m-1] by wavelength, where it is, and how forward it scatters."""

    scattering: tuple[float, ...]
    absorption: tuple[float, ...]
    where: SpatialField | None = None  #: everywhere if None
    g: float = 0.0
    emission: float = 0.0


@dataclass(frozen=True)
class Filling:
    """One medium."""

    stuff: tuple[Stuff, ...] = ()
    priority: int = 0
    index: tuple[float, ...] = field(default=(1.0,))


def henyey_greenstein(g: float, cosine: Array) -> Array:
    """Phase function [sr-1]."""
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def space_of(stuff: list[Stuff]) -> SpaceTable:
    """Terms of the components that are not the same everywhere."""
    fields = [s.where for s in stuff if s.where is not None]
    if fields:
        table = pack_space(fields, 1)
        counts = iter(np.diff(table.term_start))
        steps = [0 if s.where is None else int(next(counts)) for s in stuff]
        return table._replace(term_start=np.concatenate([[0], np.cumsum(steps)]).astype(np.int64))
    none, corner = np.zeros(0), np.zeros(3)
    return SpaceTable(
        np.zeros(len(stuff) + 1, np.int64), np.zeros(1, np.int64), np.zeros(0, np.int64), none, np.zeros((0, 2, 3)),
        none, np.zeros((0, 3), np.int64), none, np.zeros(0, np.float32), np.zeros(0, np.int64), corner, corner.copy(),
        np.ones(3, np.int64), np.zeros((1, len(stuff))), np.zeros((1, len(stuff))), corner.copy(), np.ones(3),
        np.zeros(3, np.int64),
    )  # fmt: skip


def media_table(fillings: list[Filling], wavelengths: int) -> MediaTable:
    """Media with so many wavelengths."""
    stuff = [s for f in fillings for s in f.stuff]

    def rows(values: list[object]) -> Array:
        return np.array([np.broadcast_to(np.asarray(v, float), wavelengths) for v in values], float).reshape(
            -1, wavelengths
        )

    first = np.cumsum([0] + [len(f.stuff) for f in fillings])
    sigma_s = rows([s.scattering for s in stuff])
    sigma_t = sigma_s + rows([s.absorption for s in stuff])
    density = np.array([1.0 if s.where is None else 0.0 for s in stuff])
    constant = np.array([all(s.where is None for s in f.stuff) for f in fillings], bool)
    mu = phase_cosines()
    phase = np.array([np.repeat(henyey_greenstein(s.g, mu)[:, None], wavelengths, 1) for s in stuff]).reshape(
        len(stuff), mu.size, wavelengths
    )
    cell = np.pi * (phase[:, 1:] + phase[:, :-1]) * (mu[:-1] - mu[1:])[None, :, None]
    cdf = np.concatenate([np.zeros((len(stuff), 1, wavelengths)), np.cumsum(cell, axis=1)], axis=1)
    phase = phase / cdf[:, -1:]
    sums = [(slice(a, b), c) for a, b, c in zip(first[:-1], first[1:], constant, strict=True)]
    return MediaTable(
        first=first.astype(np.int64),
        priority=np.array([f.priority for f in fillings], np.int64),
        index=rows([f.index for f in fillings]),
        dispersive=np.array([np.ptp(f.index) > 0 for f in fillings], bool),
        constant=constant,
        extinction=np.array([sigma_t[part].sum(axis=0) * ok for part, ok in sums]),
        scattering=np.array([sigma_s[part].sum(axis=0) * ok for part, ok in sums]),
        space=space_of(stuff),
        shells=None,
        centre=np.zeros(3),
        density=density,
        sigma_s=sigma_s,
        sigma_t=sigma_t,
        emission=rows([s.emission for s in stuff]),
        phase=phase,
        phase_cdf=np.ascontiguousarray(np.moveaxis(cdf / cdf[:, -1:], 1, 2)),
        rate=sigma_t.max(axis=1) if len(stuff) else np.zeros(0),
    )
