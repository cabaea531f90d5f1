"""What ``skyscatter models`` says about nebulae."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.cli.wavelengths import SHOWN_WAVELENGTHS
from skyscatter.errors import ModelFileError, SkyscatterError
from skyscatter.units import PARSEC

if TYPE_CHECKING:
    from skyscatter.lights import ParallelLight, PointStar
    from skyscatter.media.medium import Component
    from skyscatter.media.space import SpatialField
    from skyscatter.models.nebula import NebulaModel

#: Of lines, which are narrow, more is looked at.
CHECKED_WAVELENGTHS = np.linspace(380.0, 780.0, 41)


def _field(component: Component) -> SpatialField:
    """The density of a nebula's component, which is a field in three dimensions."""
    return cast("SpatialField", component.density)


def central_optical_depth(component: Component, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """Extinction through a component's centre along the model's z axis, with its weight; shape (wavelength,)."""
    column = _field(component).reference_column()
    coefficients = component.optics.coefficients(np.asarray(wavelengths_nm), column)
    return np.asarray(component.weight * (coefficients.scattering + coefficients.absorption) * column)


def describe_nebula(model: NebulaModel, width: int) -> str:
    """The model as text: place, components with the optical depths through their centres, lights, sources."""
    view = model.view
    heads = "".join(f"{wavelength:8.0f} nm" for wavelength in SHOWN_WAVELENGTHS)
    lines = [
        f"{model.name}: {model.description.strip()}",
        f"RA {view.ra_deg:.4f}, Dec {view.dec_deg:+.4f} degrees, {view.distance / PARSEC:g} pc away",
        f"seen at inclination {view.inclination_deg:g}, azimuth {view.azimuth_deg:g}, position angle "
        f"{view.position_angle_deg:g} degrees",
        "",
        f"{'optical depth through the centre, along z':<54}{heads}",
    ]
    for component in model.components:
        try:
            depth = central_optical_depth(component, SHOWN_WAVELENGTHS)
        except SkyscatterError as error:
            raise ModelFileError(model.name, f"component {component.name}: {error}") from error
        kinds = f"{component.name} ({type(component.density).__name__}, {type(component.optics).__name__})"
        lines.append(f"  {kinds:<52}" + "".join(f"{value:11.4g}" for value in depth))
    lines += ["", "extent along x, y, z"]
    for component in model.components:
        lines.append(f"  {component.name}: {_extent(component, view.distance)}")
    lines += ["", "lights", *(f"  {_light(star)}" for star in model.stars)]
    lines += [f"  {_light(light)}" for light in model.parallel]
    if model.background == "interstellar":
        lines.append("  interstellar radiation from all sides")
    if model.star_field is not None:
        field = model.star_field
        count = f"{field.count_per_square_degree:g} per square degree"
        lines.append(f"  stars behind: {count} to V = {field.limiting_magnitude:g}")
    lines += ["", "sources"]
    for source in model.sources:
        lines += textwrap.wrap(source, width, initial_indent="  - ", subsequent_indent="    ")
    return "\n".join(lines)


def _extent(component: Component, distance: float) -> str:
    low, high = _field(component).bounds
    size = high - low
    unit, name = (PARSEC, "pc") if size.max() > 0.02 * PARSEC else (PARSEC / 648000 * np.pi, "au")
    angle = np.degrees(size.max() / distance) * 60
    shown = f"{angle:.3g} arcmin" if angle >= 1 else f"{60 * angle:.3g} arcsec"
    return f"{', '.join(f'{side / unit:.3g}' for side in size)} {name}; {shown}"


def _light(light: PointStar | ParallelLight) -> str:
    words = [f"{light.name}:"]
    units = {"temperature": "K", "luminosity": "Lsun", "magnitude_v": "mag in V", "dilution": "of its light"}
    for name, unit in units.items():
        value = getattr(light, name, None)
        if value is not None:
            words.append(f"{value:g} {unit}")
    position = getattr(light, "position", None)
    if position is not None:
        words.append("at " + ", ".join(f"{x / PARSEC:.3g}" for x in position) + " pc")
    else:
        words.append("from far away")
    return " ".join(words)


def check_nebula(file: str, model: NebulaModel, tell: Callable[[float], None]) -> str:
    """Evaluate each component once, with the finished share told; returns what to say about a good file."""
    for number, component in enumerate(model.components):
        tell(number / len(model.components))
        column = _field(component).reference_column()
        low, high = _field(component).bounds
        if not np.isfinite([*low, *high]).all():
            raise ModelFileError(file, f"component {component.name}: its extent is not finite")
        if not (np.isfinite(column) and column >= 0):
            raise ModelFileError(file, f"component {component.name}: column {column:g} m; it must be 0 or above")
        values = component.optics.coefficients(CHECKED_WAVELENGTHS, column)
        for field, numbers in zip(("scattering", "absorption", "emission"), values, strict=True):
            if not (np.all(np.isfinite(numbers)) and np.all(np.asarray(numbers) >= 0)):
                raise ModelFileError(file, f"component {component.name}: {field} is negative or not finite")
    for star in model.stars:
        if not np.all(np.isfinite(star.spectral_luminosity(CHECKED_WAVELENGTHS, model.view.distance))):
            raise ModelFileError(file, f"star {star.name}: its light is not finite")
    depth = sum(central_optical_depth(component, [550.0])[0] for component in model.components)
    return (
        f"{file}: good ({len(model.components)} components, {len(model.stars)} stars, {len(model.sources)} sources; "
        f"optical depth {depth:.3g} through the centres at 550 nm)"
    )
