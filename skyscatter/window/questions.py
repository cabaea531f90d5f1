"""All that a page may ask, and what it is told at first."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from skyscatter.errors import DomainError
from skyscatter.models.files import load_model, model_names
from skyscatter.models.nebula import NebulaModel
from skyscatter.models.sky import Model
from skyscatter.space import width_of_all
from skyscatter.units import PARSEC
from skyscatter.window.nebulae import Nebulae
from skyscatter.window.skies import Skies, base_name
from skyscatter.window.work import Answering, Message, Send, Told, Work

#: Planets whose Sun a place and a time settle.
WITH_PLACES = ("earth", "mars")


class Questions:
    """What pages may ask about the models that are offered.

    Parameters
    ----------
    model : str
        Name or file of the model that is shown at first; the others are those that come with the package.

    Raises
    ------
    DomainError
        For a model of surfaces, which has no window.
    """

    def __init__(self, model: str = "earth") -> None:
        self.model, self._lock = model, threading.Lock()
        self._known: dict[str, Message | None] = {model: _facts(model, load_model(model))}
        if self._known[model] is None:
            rule = "is a scene of surfaces, which has no window yet; use skyscatter render"
            raise DomainError("model", model, rule)

    def facts(self) -> list[Message]:
        """What a page has to know of the models, the first one first; they are read when somebody asks."""
        with self._lock:
            for name in model_names():
                if name not in self._known:
                    self._known[name] = _facts(name, load_model(name))
        return [facts for facts in self._known.values() if facts is not None]

    def work(self, send: Send) -> Work:
        """The work of a page."""
        sky, nebula = Skies(lambda: self._names("sky")), Nebulae(lambda: self._names("nebula"))
        answering: dict[str, Answering] = {
            "facts": self._all, "first": _first, "table": sky.table, "sun": sky.sun, "sky-point": sky.point,
            "sky-command": sky.command, "picture": nebula.picture, "nebula-point": nebula.point,
            "nebula-command": nebula.command,
        }  # fmt: skip
        return Work(send, answering)

    def _names(self, kind: str) -> tuple[str, ...]:
        return tuple(facts["name"] for facts in self.facts() if facts["kind"] == kind)

    def _all(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        yield {"what": "facts", "model": self.model, "models": self.facts()}, None


def shipped() -> tuple[bytes, Message]:
    """The table that comes with the package, and what a page has to know that has nothing else."""
    from skyscatter.window.table import GOOD, default_table

    facts = _facts("earth", load_model("earth"))
    return default_table(), {"model": "earth", "models": [facts], "tolerance": GOOD.tolerance}


def _first(question: Message, told: Told) -> Iterator[tuple[Message, bytes]]:
    """The table that comes with the package."""
    table, facts = shipped()
    yield {"what": "table", "quick": False, "tolerance": facts["tolerance"]}, table


def _facts(name: str, model: Any) -> Message | None:
    """What a page has to know of a model; None for one that it cannot show."""
    facts: Message = {"name": name, "title": base_name(name), "description": model.description.strip()}
    if isinstance(model, Model):
        from skyscatter.window.table import SkySettings

        places = model.planet.name.lower() in WITH_PLACES
        names = SkySettings(model=name).names()
        return {**facts, "kind": "sky", "changes": sorted(names), "places": places, "top": model.top}
    if isinstance(model, NebulaModel):
        view = model.view
        width = (model.picture_width or width_of_all(model.scene(), 1.0)) / PARSEC
        side = {"inclination": view.inclination_deg, "turn": view.azimuth_deg, "fieldWidth": width}
        return {**facts, "kind": "nebula", **side}
    return None
