"""Pictures of a fit: the corner plot of its posterior, and data beside model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from skyscatter.inversion.fitresult import FitResult

Array = NDArray[np.float64]

LEVELS = (0.68, 0.95)  #: shares of the posterior that the contours hold
_DRAWS = 40_000  # from the normal posterior of an optimal estimation
_BINS = 40
_INK, _FILL, _TRUTH = "#1f3b57", ("#cfdcea", "#6f98c2"), "#c0392b"


def corner(
    result: FitResult, path: str | os.PathLike[str] | None = None, truth: Mapping[str, float] | None = None
) -> Figure:
    """Distributions of all parameters and of all pairs of them.

    Parameters
    ----------
    result : FitResult
    path : path-like, optional
        Where to write the picture (.png, .svg, .pdf).
    truth : mapping, optional
        Values to mark, by name.

    Returns
    -------
    matplotlib Figure
    """
    for name in truth or {}:
        if name not in result.names:
            raise DomainError("truth", name, f"is none of the parameters {', '.join(result.names)}")
    draws = _draws(result)
    n = len(result.names)
    figure, axes = _subplots(n, n, 1.0 + 1.75 * n, 1.0 + 1.75 * n)
    low, high = np.quantile(draws, [0.0015, 0.9985], axis=0)
    margin = 0.05 * (high - low)
    spans = list(zip(low - margin, high + margin, strict=True))
    for row in range(n):
        for column in range(n):
            ax = axes[row, column]
            if column > row:
                ax.axis("off")
                continue
            if column == row:
                _one(ax, draws[:, row], spans[row])
            else:
                _two(ax, draws[:, column], draws[:, row], spans[column], spans[row])
            _mark(ax, result.names[column], result.names[row] if column < row else None, truth or {})
            _labels(ax, result, row, column, n)
    figure.align_labels()
    return _written(figure, path)


def residual(result: FitResult, path: str | os.PathLike[str] | None = None) -> Figure:
    """Data beside model, and their difference in standard deviations, over the number of the datum; by observation."""
    parts = result.coordinates or ({"kind": "data", "unit": "", "size": result.measured.size},)
    figure, axes = _subplots(2, len(parts), 2.0 + 5.0 * len(parts), 5.2)
    begin = 0
    for column, part in enumerate(parts):
        rows = slice(begin, begin + int(part["size"]))
        begin = rows.stop
        _one_residual(axes[0, column], axes[1, column], result, rows, part)
    return _written(figure, path)


def _one_residual(above: Any, below: Any, result: FitResult, rows: slice, part: Mapping[str, Any]) -> None:
    colours, label = _colours(part, rows)
    # Neighbours in the plot belong together: by wavelength first where there are several.
    order = np.lexsort((np.arange(colours.size), colours))
    place = np.arange(colours.size)
    measured, fitted = result.measured[rows][order], result.fitted[rows][order]
    total = np.hypot(result.noise, result.model_error)[rows][order]
    above.errorbar(place, measured, yerr=result.noise[rows][order], fmt=".", ms=3, lw=0.6, color=_INK, label="measured")
    above.plot(place, fitted, lw=1.0, color=_TRUTH, label="fitted", drawstyle="steps-mid")
    positive = measured[measured > 0]
    if positive.size == measured.size and positive.max() > 30 * positive.min():
        above.set_yscale("log")
    above.set_ylabel(f"{part['kind']}\n[{part['unit']}]")
    above.legend(frameon=False, fontsize=8)
    points = below.scatter(place, (measured - fitted) / total, c=colours[order], s=9, cmap="viridis")
    for level in (-2, 0, 2):
        below.axhline(level, lw=0.6, color="0.6", ls="-" if level == 0 else ":")
    below.set_xlabel("number of datum" + (f", sorted by {label}" if label else ""))
    below.set_ylabel("(measured - fitted) / σ")
    largest = float(np.abs((measured - fitted) / total).max(initial=3.0))
    below.set_ylim(-1.1 * largest, 1.1 * largest)
    if label:
        below.figure.colorbar(points, ax=(above, below), label=label, fraction=0.04, pad=0.02)


def _colours(part: Mapping[str, Any], rows: slice) -> tuple[Array, str]:
    """What colours the residuals: the first coordinate of the data that varies, wavelength before all."""
    size = rows.stop - rows.start
    names = [name for name in part if name not in ("kind", "unit", "size")]
    names.sort(key=lambda name: name != "wavelength_nm")
    for name in names:
        values = np.asarray(part[name], float)
        if values.shape == (size,) and np.ptp(values) > 0:
            unit = {"nm": "nm", "deg": "°", "m": "m"}.get(name.rpartition("_")[2], "")
            return values, name.rpartition("_")[0].replace("_", " ") + f" [{unit}]" if unit else name
    return np.zeros(size), ""


def _draws(result: FitResult) -> Array:
    """Samples in the parameters' own units: those of the posterior, or of the normal one in the state."""
    if result.samples_z.size:
        return result.samples
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky(result.covariance_z)
    states = result.z + rng.standard_normal((_DRAWS, len(result.names))) @ root.T
    # The maps of priors are smooth: a few hundred exact values stand for all of them in a picture.
    columns = []
    for prior, z in zip(result.priors, states.T, strict=True):
        nodes = np.linspace(z.min(), z.max(), 400)
        columns.append(np.interp(z, nodes, [prior.value(float(x)) for x in nodes]))
    return np.stack(columns, axis=1)


def _one(ax: Any, values: Array, span: tuple[float, float]) -> None:
    ax.hist(values, bins=_BINS, range=span, density=True, color=_FILL[0], histtype="stepfilled", edgecolor=_INK, lw=0.9)
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84])
    for x, style in ((low, ":"), (middle, "-"), (high, ":")):
        ax.axvline(x, lw=0.8, ls=style, color=_INK)
    ax.set_xlim(span)
    ax.set_yticks([])


def _two(ax: Any, x: Array, y: Array, span_x: tuple[float, float], span_y: tuple[float, float]) -> None:
    from scipy.ndimage import gaussian_filter

    counts, edge_x, edge_y = np.histogram2d(x, y, bins=_BINS, range=[span_x, span_y])
    smooth = gaussian_filter(counts.T, 1.0)
    ranked = np.sort(smooth.ravel())[::-1]
    share = np.cumsum(ranked) / ranked.sum()
    heights = sorted({float(ranked[min(int(np.searchsorted(share, level)), ranked.size - 1)]) for level in LEVELS})
    middle_x, middle_y = (0.5 * (e[1:] + e[:-1]) for e in (edge_x, edge_y))
    if len(heights) == len(LEVELS):
        ax.contourf(middle_x, middle_y, smooth, levels=[*heights, ranked[0] * 1.001 + 1e-12], colors=_FILL)
        ax.contour(middle_x, middle_y, smooth, levels=heights, colors=_INK, linewidths=0.7)
    else:
        ax.plot(x[:2000], y[:2000], ",", color=_INK)
    ax.set_xlim(span_x)
    ax.set_ylim(span_y)


def _mark(ax: Any, x: str, y: str | None, truth: Mapping[str, float]) -> None:
    if x in truth:
        ax.axvline(truth[x], color=_TRUTH, lw=1.0)
    if y is not None and y in truth:
        ax.axhline(truth[y], color=_TRUTH, lw=1.0)


def _labels(ax: Any, result: FitResult, row: int, column: int, n: int) -> None:
    from matplotlib.ticker import MaxNLocator

    def text(k: int) -> str:
        name = result.names[k].replace("_", " ").replace(".", "\n", 1)
        return name + (f" [{result.units[k]}]" if result.units[k] else "")

    ax.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
    if row != column:
        ax.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    ax.tick_params(labelsize=7, direction="in")
    if row == n - 1:
        ax.set_xlabel(text(column), fontsize=8)
        ax.tick_params(axis="x", labelrotation=35)
    else:
        ax.set_xticklabels([])
    if column == 0 and row > 0:
        ax.set_ylabel(text(row), fontsize=8)
    elif column != row:
        ax.set_yticklabels([])
    if row == column:
        from skyscatter.inversion.report import rounded

        name = result.names[row]
        s = result.standard_deviation[name]
        ax.set_title(f"{rounded(result.estimate[name], s)} ± {s:.2g}", fontsize=8)


def _subplots(rows: int, columns: int, width: float, height: float) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, np.atleast_2d(figure.subplots(rows, columns, squeeze=False))


def _written(figure: Figure, path: str | os.PathLike[str] | None) -> Figure:
    if path is not None:
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=130)
    return figure
