"""How often error bars cover the truth: statistics that the studies of coverage share.

A study runs a solver with many seeds and hands over the estimates, the standard errors that were stated with them, and
a reference with an error of its own.  An error bar is right where 68.3 % of the estimates lie within one of them and
95.4 % within two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

#: Shares of a normal distribution within one and two standard deviations.
EXPECTED = (0.6827, 0.9545)


class Coverage(NamedTuple):
    """What a study found; shares are of all estimates."""

    count: int  #: estimates
    within: tuple[float, float]  #: shares within one and two standard errors
    counting: tuple[float, float]  #: standard errors of these shares, were they what is expected
    bias: float  #: mean of the estimates over the reference, less one
    bias_error: float  #: its standard error, from the spread of the estimates and the error of the reference
    ratio: float  #: root of the mean squared stated error over the true spread of the estimates
    beyond: float  #: share beyond three standard errors
    worst: float  #: largest deviation in standard errors


def coverage(values: ArrayLike, errors: ArrayLike, reference: float, reference_error: float = 0.0) -> Coverage:
    """Share of estimates that lie within one and two stated errors of the truth.

    Parameters
    ----------
    values, errors : array_like, shape (seed,)
        Independent estimates of one quantity, and the standard errors that were stated with them.
    reference, reference_error : float
        What is true, and its standard error; it is added to each stated error in squares.
    """
    x, stated = np.asarray(values, float).ravel(), np.asarray(errors, float).ravel()
    total = np.hypot(stated, reference_error)
    gap = np.abs(x - reference)
    # Exactly right without an error is covered; wrong without an error is infinitely far off.
    off = np.where(gap == 0.0, 0.0, gap / np.maximum(total, 1e-300))
    spread = float(x.std(ddof=1))
    scale = abs(reference) if reference else 1.0
    inside = tuple(float(np.mean(off <= k)) for k in (1.0, 2.0))
    return Coverage(
        x.size,
        (inside[0], inside[1]),
        _counting(x.size),
        float((x.mean() - reference) / scale),
        float(np.hypot(spread / np.sqrt(x.size), reference_error) / scale),
        float(np.sqrt(np.mean(stated**2)) / max(spread, 1e-300)),
        float(np.mean(off > 3.0)),
        float(off.max()),
    )


def _counting(count: int) -> tuple[float, float]:
    """Standard errors of the shares of so many estimates."""
    one, two = (float(np.sqrt(p * (1 - p) / count)) for p in EXPECTED)
    return one, two


def pooled(studies: list[Coverage]) -> Coverage:
    """Several studies of equally many estimates as one, e.g. all pixels of a picture."""
    count = sum(s.count for s in studies)

    def mean(values: list[float]) -> float:
        return float(np.mean(values))

    return Coverage(
        count,
        (mean([s.within[0] for s in studies]), mean([s.within[1] for s in studies])),
        _counting(count),
        mean([s.bias for s in studies]),
        float(np.sqrt(np.sum([s.bias_error**2 for s in studies])) / len(studies)),
        mean([s.ratio for s in studies]),
        mean([s.beyond for s in studies]),
        max(s.worst for s in studies),
    )


HEADER = (
    "| scene | estimates | within 1 | within 2 | beyond 3 | worst | stated over true spread | bias |\n"
    "|---|---|---|---|---|---|---|---|"
)


def table_row(name: str, found: Coverage) -> str:
    """A line of the table under `HEADER`."""
    one, two = (f"{100 * p:.1f} ± {100 * e:.1f} %" for p, e in zip(found.within, found.counting, strict=True))
    return (
        f"| {name} | {found.count} | {one} | {two} | {100 * found.beyond:.1f} % | {found.worst:.1f} | "
        f"{found.ratio:.2f} | {100 * found.bias:+.2f} ± {100 * found.bias_error:.2f} % |"
    )
