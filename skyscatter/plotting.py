"""Drawings of models (matplotlib, without a display)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WAVELENGTHS = np.linspace(300.0, 1000.0, 141)
PHASE_WAVELENGTH = 550.0
DASHES = ("-", (0, (6, 2)), (0, (3, 2)), (0, (1, 1.5)))


def vertical_optical_depth(component: Any, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """Vertical extinction optical depth of one component above the ground, with its weight; shape (wavelength,)."""
    column = float(component.density.vertical_column(0.0))
    coefficients = component.optics.coefficients(wavelengths_nm, column)
    depth = (np.asarray(coefficients.scattering) + np.asarray(coefficients.absorption)) * column
    return np.asarray(component.weight * depth)


def model_figure(model: Any) -> Figure:
    """Profiles, vertical optical depths and phase functions of a model's components.

    Parameters
    ----------
    model : Model
        As `skyscatter.load_model` returns it.

    Returns
    -------
    matplotlib.figure.Figure
        Three panels: relative density over altitude, vertical optical depth over wavelength (extinction, and the sum),
        phase functions at 550 nm over the scattering angle, of the components that scatter there.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 4.2), layout="constrained")
    profiles, depths, phases = figure.subplots(1, 3)
    altitude = np.linspace(0.0, model.top, 600)
    angle = np.linspace(0.0, 180.0, 721)
    total = np.zeros(WAVELENGTHS.size)
    smallest = np.inf
    for number, component in enumerate(model.components):
        # Dashes show what lies under a curve that coincides with another.
        style = {"color": f"C{number % 10}", "label": component.name, "linestyle": DASHES[number % len(DASHES)]}
        density = np.asarray(component.density.density(altitude))
        peak = density.max()
        profiles.plot(np.where(density > 0, density / (peak if peak > 0 else 1.0), np.nan), altitude / 1e3, **style)
        depth = vertical_optical_depth(component, WAVELENGTHS)
        total += depth
        smallest = min(smallest, np.min(depth[depth > 0], initial=np.inf))
        depths.plot(WAVELENGTHS, np.where(depth > 0, depth, np.nan), **style)
        wavelength = np.array([PHASE_WAVELENGTH])
        column = float(component.density.vertical_column(0.0))
        if component.weight * component.optics.coefficients(wavelength, column).scattering[0] > 0:
            function = component.optics.phase_function(wavelength)
            phases.plot(angle, function.value(np.cos(np.radians(angle)), wavelength)[:, 0], **style)
    depths.plot(WAVELENGTHS, np.where(total > 0, total, np.nan), color="k", linewidth=0.8, label="all")
    profiles.set(xlabel="density / its maximum", ylabel="altitude [km]", xscale="log", xlim=(1e-6, 2.0))
    depths.set(xlabel="vacuum wavelength [nm]", ylabel="vertical optical depth", yscale="log")
    _floor(depths, smallest, total.max())
    phases.set(xlabel="scattering angle [degree]", ylabel=f"phase function at {PHASE_WAVELENGTH:g} nm [sr$^{{-1}}$]")
    phases.set_yscale("log")
    phases.set_xticks(range(0, 181, 30))
    for axes in (profiles, depths, phases):
        axes.grid(alpha=0.3)
    depths.legend(fontsize="small")
    figure.suptitle(model.name)
    return figure


def _floor(axes: Any, smallest: float, largest: float) -> None:
    """At most six decades, for absorbers fall to nothing between their bands; fewer where nothing is that small."""
    if largest > 0:
        axes.set_ylim(max(1e-6 * largest, 0.5 * smallest), 2.0 * largest)


def plot_model(model: Any, path: str | os.PathLike[str]) -> None:
    """Draw a model into a file: ``.png``, ``.svg`` or ``.pdf`` by its extension."""
    figure = model_figure(model)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120, format=Path(path).suffix.lower().removeprefix("."))
