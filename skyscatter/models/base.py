"""What all model files have in common: a name, where the numbers come from, and their text."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.media.arrays import unwritten
from skyscatter.record import Record


class ModelFile(Record):
    """What a model file says.

    Parameters
    ----------
    name : str
        How the model is called.
    description : str
        What it is, in a sentence.
    sources : tuple of str
        Where the numbers come from.
    """

    command: ClassVar[str]  #: of the command line, which renders it

    name: str
    description: str = ""
    sources: tuple[str, ...] = ()

    def to_toml(self) -> str:
        """The model as TOML text, which `load_model` reads back to an equal model.

        Raises
        ------
        DomainError
            If the model holds an array that is too large to be written out.
        """
        content = self.model_dump(mode="json", exclude_none=True)
        _check_written(content)
        return tomli_w.dumps(content)

    def save(self, path: str | Path) -> None:
        """Write the model file; an existing one is replaced only when the new one is complete."""
        with atomic_path(path) as temporary:
            temporary.write_text(self.to_toml(), encoding="utf-8")


def _check_written(content: Any) -> None:
    """Refuse what is not written out."""
    if unwritten(content):
        rule = "too large for a model file; write it with numpy.save and name that in the field `file`"
        raise DomainError("values", content, rule)
    parts = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    for part in parts:
        _check_written(part)
