"""Drawings of models (matplotlib, without a display)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.units import PARSEC

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


def nebula_figure(model: Any, pixels: int = 160) -> Figure:
    """Maps of a nebula's components as seen in the sky, north up and east left.

    Parameters
    ----------
    model : NebulaModel
        As `skyscatter.load_model` returns it.
    pixels : int
        Along a side of a map.

    Returns
    -------
    matplotlib.figure.Figure
        A panel for each component: its optical depth at 550 nm, or, where it only shines, its column of unit density
        [pc]; both on a logarithmic scale over four decades.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    count = len(model.components)
    figure = Figure(figsize=(4.6 * count, 4.2), layout="constrained")
    for axes, component in zip(figure.subplots(1, count, squeeze=False)[0], model.components, strict=True):
        half, columns = _sky_columns(component.density, model.view, pixels)
        wavelength = np.array([PHASE_WAVELENGTH])
        coefficients = component.optics.coefficients(wavelength, component.density.reference_column())
        extinction = component.weight * float(coefficients.scattering[0] + coefficients.absorption[0])
        values = columns * extinction if extinction > 0 else columns / PARSEC
        label = f"optical depth at {PHASE_WAVELENGTH:g} nm" if extinction > 0 else "column of unit density [pc]"
        angle = np.degrees(half / model.view.distance) * 60
        unit, angle = ("arcmin", angle) if angle >= 1 else ("arcsec", 60 * angle)
        peak = float(values.max())
        norm = LogNorm(1e-4 * peak, peak) if peak > 0 else None
        drawn = axes.imshow(values, extent=(angle, -angle, -angle, angle), origin="lower", norm=norm, cmap="magma")
        axes.set_facecolor("k")
        axes.set(title=component.name, xlabel=f"east [{unit}]", ylabel=f"north [{unit}]")
        figure.colorbar(drawn, ax=axes, label=label, shrink=0.85)
    figure.suptitle(model.name)
    return figure


def _sky_columns(field: Any, view: Any, pixels: int) -> tuple[float, NDArray[np.float64]]:
    """Half width [m] of a map that holds a field, and columns [m] along parallel lines, shape (north, west)."""
    low, high = field.bounds
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    half = float(np.abs(corners @ np.stack([view.right, view.up]).T).max())
    reach = float(np.linalg.norm(corners, axis=1).max())
    steps = half * (2 * (np.arange(pixels) + 0.5) / pixels - 1)
    points = steps[:, None, None] * view.up + steps[:, None] * view.right
    return half, field.column(points - reach * view.forward, points + reach * view.forward)


def plot_model(model: Any, path: str | os.PathLike[str]) -> None:
    """Draw a model into a file: ``.png``, ``.svg`` or ``.pdf`` by its extension."""
    if model.command == "render":
        raise DomainError("plot", str(path), "scenes of surfaces have no drawing; make a picture: skyscatter render")
    figure = model_figure(model) if hasattr(model, "planet") else nebula_figure(model)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120, format=Path(path).suffix.lower().removeprefix("."))
