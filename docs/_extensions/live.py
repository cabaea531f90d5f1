"""The live sky of the documentation: the window's page in one file, with the table that comes with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from skyscatter.window.bundle import live_page
from skyscatter.window.questions import shipped

#: Where the page stands in the site.
PLACE = "_static/live-sky.html"


def write(app: Sphinx, failed: Exception | None) -> None:
    """Write the page into a site that has been built."""
    if failed is None and app.builder.format == "html":
        (Path(app.outdir) / PLACE).write_text(live_page(*shipped()), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Write it when all else is done."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True, "version": "1"}
