"""Pages that live outside of ``docs`` (README, change log, benchmarks), brought in with their links set right."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from reference import write
from sphinx.application import Sphinx

#: Files of the repository and the pages of the site that they become, in ``more``.
PAGES = {
    "README.md": "tour",
    "CONTRIBUTING.md": "contributing",
    "CODE_OF_CONDUCT.md": "conduct",
    "CHANGELOG.md": "changelog",
    "VISION.md": "vision",
    "benchmarks/README.md": "benchmarks",
    "benchmarks/RESULTS.md": "results",
    "data/README.md": "data",
    "examples/README.md": "examples",
}
FOLDER = "more"
#: A link or a picture of Markdown to something that is no address on the web.
LINK = re.compile(r"(\]\()(?!https?:|mailto:|#)([^)#\s]+)((?:#[^)\s]*)?\))")


def retarget(text: str, home: Path, page: Path, root: Path) -> str:
    """Set the links right of a text that was written in folder `home` and is read from `page`."""

    def link(match: re.Match[str]) -> str:
        target = Path(os.path.normpath(home / match[2]))
        if not target.is_relative_to(root):
            return match[0]
        inside = target.relative_to(root).as_posix()
        if inside in PAGES:
            target = root / "docs" / FOLDER / f"{PAGES[inside]}.md"
        elif target.parent == root / "examples" and target.suffix == ".ipynb":
            target = root / "docs" / "notebooks" / target.name
        return match[1] + os.path.relpath(target, page.parent) + match[3]

    return LINK.sub(link, text)


def bring(app: Sphinx) -> None:
    """Write the pages from outside."""
    source = Path(app.srcdir)
    root = source.parent
    for name, stem in PAGES.items():
        page = source / FOLDER / f"{stem}.md"
        text = (root / name).read_text(encoding="utf-8")
        text = text.replace("# skyscatter\n", "# The tour\n", 1) if stem == "tour" else text
        write(page, retarget(text, (root / name).parent, page, root))


def inside(app: Sphinx, docname: str, content: list[str]) -> None:
    """Set the links right of a page of ``docs`` to files outside of it."""
    page = Path(app.env.doc2path(docname))
    if page.suffix == ".md" and page.parent.name != FOLDER:
        content[0] = retarget(content[0], page.parent, page, Path(app.srcdir).parent)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write before anything is read; mend links while pages are read."""
    app.connect("builder-inited", bring)
    app.connect("source-read", inside)
    return {"parallel_read_safe": True, "version": "1"}
