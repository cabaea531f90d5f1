"""The notebooks of ``examples``, brought into the site with their links set right; they are kept as they were run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from outside import retarget
from reference import write
from sphinx.application import Sphinx


def bring(app: Sphinx) -> None:
    """Copy the notebooks to ``notebooks``, a folder that git ignores."""
    source = Path(app.srcdir)
    folder = source / "notebooks"
    folder.mkdir(exist_ok=True)
    names = {path.name for path in (source.parent / "examples").glob("*.ipynb")}
    for old in folder.glob("*.ipynb"):
        if old.name not in names:
            old.unlink()
    for name in sorted(names):
        kept, copy = source.parent / "examples" / name, folder / name
        write(copy, retarget(kept.read_text(encoding="utf-8"), kept.parent, copy, source.parent))


def setup(app: Sphinx) -> dict[str, Any]:
    """Copy before anything is read."""
    app.connect("builder-inited", bring)
    return {"parallel_read_safe": True, "version": "1"}
