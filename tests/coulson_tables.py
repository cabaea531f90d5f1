"""Corrected tables of Coulson, Dave & Sekera (Natraj et al. 2009): light that leaves a slab of Rayleigh scatterers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cds(reference: Path, parameter: str, upwards: bool, tau: str) -> tuple[Array, Array, Array]:
    """One Stokes parameter: mu0 (7,), mu (16,), values (albedo, mu0, mu, phi), phi in steps of 30 degrees.

    The tables' Q and U are ours with the other sign: their r is upright.
    """
    path = reference / "rayleigh_slab_cds" / f"{parameter}_{'UP' if upwards else 'DN'}_TAU_{tau}.txt"
    lines = [line.split() for line in path.read_text().splitlines()]
    rows = np.array([[float(w) for w in words] for words in lines if len(words) == 9 and words[0] != "mu0"])
    rows = rows.reshape(3, 7, 16, 9)
    return rows[0, :, 0, 0], rows[0, 0, :, 1], rows[..., 2:]
