"""What can be changed of a model's sky in the window, and the scene that it makes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from skyscatter.errors import DomainError
from skyscatter.models.files import load_model
from skyscatter.models.sky import Model
from skyscatter.optics.absorption import GasAbsorption

if TYPE_CHECKING:
    from skyscatter.media.medium import Component
    from skyscatter.scene import Scene

#: Largest factor on what is in the air.
MOST = 10.0
#: Kinds of optics that are no haze.
GASES = ("rayleigh", "rayleigh-air", "gas-absorption", "absorption-table", "gas-lines")
#: What `names` may hold, in the order of a window's sliders.
CHANGES = ("haze", "ozone", "ground")


@dataclass(frozen=True)
class SkySettings:
    """A model's sky with other amounts of haze and ozone, another ground, and a height to look from.

    Parameters
    ----------
    model : str
        Name of a shipped model of a sky, or path of a model file.
    haze, ozone : float
        Factors on the amounts of the model's aerosols (all that scatters but gases) and of its ozone, 0 to 10.
    ground : float, optional
        Grey albedo, 0 to 1, in place of the model's.
    altitude_m : float
        Of the observer above the ground, within the atmosphere [m].

    Raises
    ------
    DomainError
        For values out of range, and for changes of what the model does not have.

    Examples
    --------
    Twice the haze over snow: the horizon pales.

    >>> from skyscatter.window.settings import SkySettings
    >>> settings = SkySettings("earth", haze=2.0, ground=0.8)
    >>> settings.names()
    ('haze', 'ozone', 'ground')
    >>> settings.scene().ground.albedo
    0.8
    >>> SkySettings("mars").names()
    ('haze', 'ground')
    """

    model: str = "earth"
    haze: float = 1.0
    ozone: float = 1.0
    ground: float | None = None
    altitude_m: float = 2.0

    def __post_init__(self) -> None:
        for name in ("haze", "ozone"):
            value = float(getattr(self, name))
            if not 0.0 <= value <= MOST:
                raise DomainError(name, value, f"a factor between 0 and {MOST:g}")
            if value != 1.0 and name not in self.names():
                raise DomainError(name, value, f"the model {self.model} has none to change; leave it out")
        if self.ground is not None and not 0.0 <= self.ground <= 1.0:
            raise DomainError("ground", self.ground, "an albedo between 0 and 1, or none for the model's own")
        top = self._model.top
        if not (math.isfinite(self.altitude_m) and 0.0 <= self.altitude_m <= top):
            raise DomainError("altitude_m", self.altitude_m, f"within the atmosphere, 0 to {top:g} m")

    @cached_property
    def _model(self) -> Model:
        found = load_model(self.model)
        if not isinstance(found, Model):
            raise DomainError("model", self.model, "is no sky of a planet; see: skyscatter models")
        return found

    def names(self) -> tuple[str, ...]:
        """Which of haze, ozone and ground this model has."""
        parts = {_sort(component) for component in self._model.components}
        return tuple(name for name in CHANGES if name == "ground" or name in parts)

    def scene(self) -> Scene:
        """The model's scene, changed so; its Sun is to be moved."""
        scene = self._model.scene(altitude=self.altitude_m)
        factor = {"haze": self.haze, "ozone": self.ozone}
        parts = tuple(
            component.model_copy(update={"weight": component.weight * factor.get(_sort(component), 1.0)})
            for component in scene.medium.components
        )
        ground = scene.ground if self.ground is None else scene.ground.model_copy(update={"albedo": float(self.ground)})
        medium = scene.medium.model_copy(update={"components": parts})
        return scene.model_copy(update={"medium": medium, "ground": ground})

    def changed(self, **values: float) -> SkySettings:
        """The same settings with other values."""
        return replace(self, **values)  # type: ignore[arg-type]


def _sort(component: Component) -> str:
    """What a component counts as: haze, ozone, or gas."""
    optics = component.optics
    if isinstance(optics, GasAbsorption) and optics.species == "o3":
        return "ozone"
    return "gas" if optics.kind in GASES else "haze"
