"""Polarised light on the command line: the option, and what the summaries say of it."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import typer

from skyscatter.cli import common
from skyscatter.errors import DomainError

Stokes = Annotated[
    bool,
    typer.Option("--stokes", help="Polarised light: Stokes Q, U, V in .exr, .fits, .nc; the summary has the degree."),
]


def summary(image: Any, wavelength: float | None = None) -> dict[str, float | None] | None:
    """Mean and greatest degree of linear polarisation over the pixels that have light; None for unpolarised images.

    Of one wavelength [nm], or over all of them weighted by luminous efficiency; null if none of them is visible.
    """
    if not image.polarised:
        return None
    from skyscatter.image.polarisation import band_degree

    try:
        degree = band_degree(image, wavelength)
    except DomainError:
        degree = np.full(1, np.nan)
    lit = degree[np.isfinite(degree)]
    return {
        "mean_degree": float(lit.mean()) if lit.size else None,
        "maximum_degree": float(lit.max()) if lit.size else None,
        "wavelength_nm": wavelength,
    }


def described(found: dict[str, float | None] | None) -> str:
    """The same for people; empty where nothing is known."""
    if found is None or found["mean_degree"] is None or found["maximum_degree"] is None:
        return ""
    mean, most = common.percent(found["mean_degree"]), common.percent(found["maximum_degree"])
    return f"; degree of linear polarisation {mean} on average, {most} at most"
