"""Options of pictures that several commands share: what the first picture of a model gets where nothing is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, parse
from skyscatter.errors import DomainError

Smooth = Annotated[
    bool | None,
    typer.Option(
        "--smooth/--no-smooth",
        help="For PNG: take noise off as --denoise does; files with data keep it.  Pictures of no stated size are "
        "smoothed where the number of walks is even.",
    ),
]
Look = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="For PNG, options by a name: eye, photograph, film, deep (asinh); of nebulae also hubble and bicolour.  "
        "What is given beside it wins.",
    ),
]
Glare = Annotated[
    str | None,
    typer.Option(
        metavar="WHAT",
        help="For PNG, around bright lights: none or lens; in the sky also diffraction: hubble, eye, airy:DIAMETER.",
    ),
]
#: Of pictures of nebulae [nm]: the lines of hydrogen, oxygen, nitrogen and sulphur lie at nodes, and so have their
#: own colours.
NEBULA_WAVELENGTHS = "410,434,460,486,500,520,545,570,595,620,640,656.5,672,700"
#: Of pictures of rooms [nm].
ROOM_WAVELENGTHS = "400:700:20"


def natural_look(look: str | None, given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of pictures in natural colours, of an image without a place in the sky: those given, and of the look."""
    from skyscatter.image.looks import LOOKS, expanded, is_of_planes

    options = expanded(look, given)
    if is_of_planes(options):
        names = [name for name, own in LOOKS.items() if not is_of_planes(own)]
        raise DomainError("look", look, f"is for nebulae; choose one of {', '.join(names)}")
    if options.get("glare") not in (None, "none", "lens"):
        raise DomainError("glare", options["glare"], "choose none or lens; diffraction is for nebulae")
    return options


def natural_options(look: str | None, given: Mapping[str, Any]) -> dict[str, Any]:
    """The same as the PNG writer takes them, with those that nobody named."""
    options = natural_look(look, given)
    if "exposure" in options:
        options["exposure"] = parse.parse_exposure(options["exposure"])
    named = {} if look is None else {"look": look}
    return {"exposure": "auto", "tone": common.DEFAULT_TONE, "space": "srgb", **options, **named}


def wavelengths(given: str | None, outputs: Sequence[Path], picture: str, data: str) -> str:
    """Wavelengths of a run: those that were typed; few where nothing but pictures is made, more for files with data."""
    if given is not None:
        return given
    pictures = bool(outputs) and all(path.suffix.lower() in (".png", *parse.FILMS) for path in outputs)
    return picture if pictures else data


def check_smooth(smooth: bool | None, denoise: bool, outputs: list[Path], solver: str) -> None:
    """Refuse smoothing that nothing would get."""
    if not smooth:
        return
    if denoise:
        raise DomainError("smooth", True, "is what --denoise does too, with an error of its own; leave one out")
    if not common.has_suffix(outputs, ".png"):
        raise DomainError("smooth", True, "is for PNG files; name one with -o, or leave this out")
    if solver == "single":
        raise DomainError("smooth", True, "means nothing to the solver single, which has no noise; leave it out")


def evened(image: Any) -> Any:
    """The picture as .png files show it that are smoothed: denoised; as it is where it has no halves."""
    from skyscatter.image.denoising import HALVES

    if any(name not in image.layers for name in HALVES):
        return image
    clean = image.denoised()
    recipe = {name: value for name, value in clean.recipe.items() if name != "denoising"}
    recipe["smoothed"] = clean.recipe["denoising"]
    return type(image)(clean.radiance, clean.wavelengths, recipe=recipe, sky=image.sky)


def unhalved(image: Any) -> Any:
    """The picture as data have it: without the halves by which it is smoothed."""
    from skyscatter.image.denoising import HALVES

    layers = {name: values for name, values in image.layers.items() if name not in HALVES}
    return type(image)(
        image.radiance, image.wavelengths, image.error, recipe=image.recipe, layers=layers, sky=image.sky
    )
