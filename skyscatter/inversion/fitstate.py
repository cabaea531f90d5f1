"""Where a fit stands, on disk, so that an interrupted one goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, SkyscatterError


class FitState:
    """An ``.npz`` file with the recipe of the fit and the arrays of its state; nothing is kept without a path.

    Parameters
    ----------
    path : path-like, optional
    recipe : mapping
        All that decides what the run computes, as plain values; a state of another recipe is refused.
    """

    def __init__(self, path: str | os.PathLike[str] | None, recipe: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.recipe = json.loads(json.dumps(dict(recipe)))

    def load(self) -> dict[str, Any] | None:
        """The arrays that were kept; None if there is no such file yet.

        Raises
        ------
        SkyscatterError
            If it is no such file.
        DomainError
            If it belongs to another fit.
        """
        if self.path is None or not self.path.is_file():
            return None
        try:
            with open(self.path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                content = {name: file[name] for name in file.files}
            recipe = json.loads(str(content.pop("recipe")))
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise SkyscatterError(f"{self.path}: not the state of a fit; start anew without it") from error
        for name in sorted(set(recipe) | set(self.recipe)):
            if recipe.get(name) != self.recipe.get(name):
                raise DomainError("resume", str(self.path), f"was begun with other {name}; repeat the fit as it was")
        return content

    def keep(self, **arrays: Any) -> None:
        """Write the state, whole or not at all."""
        if self.path is None:
            return
        with atomic_path(self.path) as temporary, open(temporary, "wb") as file:
            np.savez(file, recipe=np.array(json.dumps(self.recipe)), **arrays)
