"""Where a fit stands, on disk, so that an interrupted one goes on."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skyscatter.tasks.store import Store

#: The part of the store that holds it.
PART = "fit"


class FitState:
    """A store with the recipe of the fit, and the arrays of its state as its one part; nothing is kept without a path.

    Parameters
    ----------
    path : path-like, optional
        Of the folder.
    recipe : mapping
        All that decides what the run computes, as plain values; a state of another recipe is refused.
    """

    def __init__(self, path: str | os.PathLike[str] | None, recipe: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.recipe = dict(recipe)

    def load(self) -> dict[str, Any] | None:
        """The arrays that were kept; None if there is no such folder yet, or nothing whole in it.

        Raises
        ------
        DomainError
            If it is no such folder, or belongs to another fit.
        """
        if self.path is None or not self.path.exists():
            return None
        return self._store(self.path).kept(PART) or None

    def keep(self, **arrays: Any) -> None:
        """Write the state, whole or not at all."""
        if self.path is not None:
            self._store(self.path).keep(PART, arrays)

    def _store(self, path: Path) -> Store:
        return Store(path, self.recipe, about={"sort": PART}, option="resume", patience=0.0)
