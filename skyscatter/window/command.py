"""The command that makes the picture of the page, to the last word."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from skyscatter.models.sky import Model
    from skyscatter.window.table import SkySettings


class Shown(NamedTuple):
    """What of a picture of a sky is not in its settings."""

    sun_elevation: float
    sun_azimuth: float
    view: str
    size: tuple[int, int]
    exposure: float | None


def sky_command(settings: SkySettings, shown: Shown) -> tuple[str, tuple[str, str] | None]:
    """The words of ``skyscatter sky``, and the name and the text of the model file that they need, if any.

    The command line has no options for what is in the air: a changed model is a file.
    """
    from skyscatter.geometry.camera import camera_from_view

    camera_from_view(shown.view, *shown.size, observer=settings.scene().observer)  # refuses a view that is none
    base, file = settings.model, None
    if changes := changed(settings):
        name = f"{Path(settings.model).stem}-{'-'.join(changes)}"
        base, file = f"{name}.toml", (f"{name}.toml", changed_model(settings, name).to_toml())
    words = ["skyscatter", "sky", base, "--sun-elevation", f"{shown.sun_elevation:.6g}"]
    words += ["--sun-azimuth", f"{shown.sun_azimuth:.6g}", "--altitude", f"{settings.altitude_m:g}m"]
    words += ["--view", shown.view, "--size", "{}x{}".format(*shown.size)]
    if shown.exposure is not None:
        words += ["--exposure", f"{shown.exposure:.6g}"]
    return shlex.join([*words, "-o", "sky.png"]), file


def changed(settings: SkySettings) -> list[str]:
    """What was changed of the model, as parts of the name of a file."""
    found = [f"{name}{value:g}" for name in ("haze", "ozone") if (value := getattr(settings, name)) != 1.0]
    return found if settings.ground is None else [*found, f"ground{settings.ground:g}"]


def changed_model(settings: SkySettings, name: str) -> Model:
    """The model with the changes, as a file holds it."""
    from skyscatter.models.files import load_model
    from skyscatter.models.sky import Model

    model, scene = load_model(settings.model), settings.scene()
    assert isinstance(model, Model)  # the settings have refused others
    said = f"{model.description} Changed: {', '.join(changed(settings))}."
    update = {"name": name, "description": said, "components": scene.medium.components, "ground": scene.ground}
    return model.model_copy(update=update)
