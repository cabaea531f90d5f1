"""Where results that took long to compute are kept between runs."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import SkyscatterError

VARIABLE = "SKYSCATTER_CACHE"  #: environment variable that names the folder


def cache_folder() -> Path:
    """The folder of kept results: that of `VARIABLE`, else the platform's place for such files."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "skyscatter"


def file_of(kind: str, description: str) -> Path:
    """Path of a kept result, named after a digest of all that it depends on."""
    digest = hashlib.sha256(description.encode()).hexdigest()[:32]
    return cache_folder() / kind / f"{digest}.npz"


def load(path: Path) -> dict[str, NDArray[np.float64]] | None:
    """Arrays of a kept result; None where there is none or it cannot be read, for it can be computed again."""
    try:
        # Opened here, for numpy leaves a broken archive open.
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):
        return None


def save(path: Path, arrays: dict[str, Any]) -> bool:
    """Keep arrays; False where the folder cannot be written, which costs time later but is no failure."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **arrays)
    except (OSError, SkyscatterError):
        return False
    return True
