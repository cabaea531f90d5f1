"""What ``skyscatter models show`` and ``check`` say of scenes of surfaces."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.cli.wavelengths import CHECKED_WAVELENGTHS, SHOWN_WAVELENGTHS
from skyscatter.errors import ModelFileError, SkyscatterError

if TYPE_CHECKING:
    from skyscatter.models.surfaces import SurfaceModel


def length(metres: float) -> str:
    """A length with three digits in the unit that suits it."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if metres >= size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres * 1e6:.3g} um"


def describe_surfaces(model: SurfaceModel, width: int) -> str:
    """The model as text: media with mean free paths, bodies, lamps with their light, sources."""
    from skyscatter.solvers.surfaces import compile_media
    from skyscatter.surfaces.indices import refractive_index

    try:
        table = compile_media(model.media, tuple(SHOWN_WAVELENGTHS))
    except SkyscatterError as error:
        raise ModelFileError(model.name, f"media: {error}") from error
    heads = "".join(f"{wavelength:8.0f} nm" for wavelength in SHOWN_WAVELENGTHS)
    lines = [
        f"{model.name}: {model.description.strip()}",
        "",
        f"{'media: mean free path where density is 1':<54}{heads}",
    ]
    for k, medium in enumerate(model.media):
        index = refractive_index(medium.index, SHOWN_WAVELENGTHS)
        lines.append(f"  {medium.name}{', outside' if k == 0 else ''}: index {index[1]:.4g}")
        for c, component in enumerate(medium.components):
            row = table.sigma_t[table.first[k] + c]
            paths = "".join(f"{length(1 / value) if value > 0 else 'none':>11}" for value in row)
            kinds = f"{component.name} ({type(component.density).__name__}, {type(component.optics).__name__})"
            lines.append(f"    {kinds:<50}" + paths)
    lines += ["", "bodies", *(f"  {_body(body)}" for body in model.bodies), "", "lamps"]
    lines += [f"  {body.name}: {_light(body.lamp)}" for body in model.bodies if body.lamp is not None]
    lines += [f"  {lamp.name} ({lamp.kind}): {_light(lamp)}" for lamp in model.lamps]
    camera, eye = model.camera, model.viewpoint
    place = ", ".join(f"{x:.4g}" for x in eye.position)
    lines += ["", f"seen from {place} m with a {camera.kind} of {camera.width} x {camera.height} pixels", "", "sources"]
    for source in model.sources:
        lines += textwrap.wrap(source, width, initial_indent="  - ", subsequent_indent="    ")
    return "\n".join(lines)


def _body(body: Any) -> str:
    inside = "" if body.inside is None else f", {body.inside} inside"
    return f"{body.name}: {body.shape.kind}, {body.material.kind}{inside}"


def _light(lamp: Any) -> str:
    """The amount of light as it was given."""
    if getattr(lamp, "kind", None) == "environment":
        return f"as in {lamp.file}"
    for name in lamp.amounts():
        value = getattr(lamp, name)
        if value is not None:
            shown = f"{value:g}" if isinstance(value, (int, float)) else "a table of"
            spectrum = lamp.spectrum
            if spectrum is None:
                return f"{shown} {name}"
            return f"{shown} {name}, {spectrum if isinstance(spectrum, str) else 'spectrum of its own'}"
    return "dark"


def held_lines(model: Any) -> list[str]:
    """What a sky holds beside its shells, a line for each."""
    lines = ["", "and"]
    if model.ground.material is not None:
        lines.append(f"  ground: {model.ground.material.kind}")
    lines += [f"  {c.name} ({type(c.density).__name__}, {type(c.optics).__name__})" for c in model.fields]
    lines += [f"  {_body(body)}" for body in model.bodies]
    lines += [f"  {medium.name}: medium" for medium in model.media]
    return lines + [f"  {lamp.name} ({lamp.kind}): {_light(lamp)}" for lamp in model.lamps]


def check_held(file: str, model: Any) -> None:
    """Compile once what a sky holds beside its shells."""
    from skyscatter.solvers.surfaces import compile_surfaces
    from skyscatter.solvers.worldscene import as_surfaces

    try:
        media = compile_surfaces(as_surfaces(model.scene(), CHECKED_WAVELENGTHS), CHECKED_WAVELENGTHS).media
    except SkyscatterError as error:
        raise ModelFileError(file, str(error)) from error
    for name, values in (("scattering", media.sigma_s), ("extinction", media.sigma_t)):
        if not (np.all(np.isfinite(values)) and np.all(values >= 0)):
            raise ModelFileError(file, f"{name} is negative or not finite")


def check_surfaces(file: str, model: SurfaceModel) -> str:
    """Compile the scene once; returns what to say about a good file."""
    from skyscatter.solvers.surfaces import compile_surfaces

    try:
        table = compile_surfaces(model.scene(), CHECKED_WAVELENGTHS)
    except SkyscatterError as error:
        raise ModelFileError(file, str(error)) from error
    media, lamps = table.media, table.lamps
    for name, values in (("scattering", media.sigma_s), ("extinction", media.sigma_t), ("power", lamps.power)):
        if not (np.all(np.isfinite(values)) and np.all(values >= 0)):
            raise ModelFileError(file, f"{name} is negative or not finite")
    if not np.any(lamps.power > 0) and not np.any(media.emission > 0):
        raise ModelFileError(file, "nothing shines; add a lamp")
    return (
        f"{file}: good ({len(model.media)} media, {len(model.bodies)} bodies, {len(lamps.kind)} lamps, "
        f"{len(model.sources)} sources)"
    )
