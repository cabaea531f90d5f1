"""The spectrum under a pixel, drawn."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from skyscatter.image.spectral import SpectralImage


def plot_spectrum(
    image: SpectralImage, x: int, y: int, ax: Axes | None = None, path: str | os.PathLike[str] | None = None
) -> Axes:
    """Draw radiance over wavelength for one pixel, with a band of one standard error and a line for each layer.

    Parameters
    ----------
    image : SpectralImage
    x, y : int
        Column from the left and row from the top, from 0.
    ax : matplotlib Axes, optional
        Where to draw; a new figure if none is given.
    path : path-like, optional
        Also save the figure there (any format of matplotlib, by extension).

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    DomainError
        If the pixel is not in the image or lies outside the camera's field, or matplotlib does not know the extension.
    """
    from matplotlib.figure import Figure

    rows, columns, _ = image.shape
    if not 0 <= x < columns or not 0 <= y < rows:
        raise DomainError("pixel", (x, y), f"the image has columns 0 to {columns - 1} and rows 0 to {rows - 1}")
    spectrum = image.radiance[y, x]
    if np.isnan(spectrum).any():
        raise DomainError("pixel", (x, y), "lies outside the camera's field")
    if ax is None:
        ax = Figure(figsize=(6.4, 4.0), layout="constrained").add_subplot()
    marker = "." if spectrum.size < 60 else ""
    (line,) = ax.plot(image.wavelengths, spectrum, marker=marker, label="radiance")
    if image.standard_error is not None:
        error = image.standard_error[y, x]
        ax.fill_between(image.wavelengths, spectrum - error, spectrum + error, color=line.get_color(), alpha=0.3, lw=0)
    for name, cube in image.layers.items():
        ax.plot(image.wavelengths, cube[y, x], lw=1.0, label=name)
    if image.layers:
        ax.legend()
    ax.set_xlabel("vacuum wavelength [nm]")
    ax.set_ylabel(r"spectral radiance [W m$^{-2}$ sr$^{-1}$ nm$^{-1}$]")
    ax.set_title(f"pixel x = {x}, y = {y}")
    if path is not None:
        _save(ax, path)
    return ax


def _save(ax: Axes, path: str | os.PathLike[str]) -> None:
    figure = ax.get_figure(root=True)
    assert figure is not None  # axes that were just drawn on belong to a figure
    extension = os.path.splitext(path)[1].lstrip(".").lower()
    known = figure.canvas.get_supported_filetypes()
    if extension not in known:
        raise DomainError("plot file", str(path), f"the extension must be one of {', '.join(sorted(known))}")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format=extension)
