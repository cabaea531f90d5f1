"""Short names and options in code type stay on one line: `--sun-elevation -4` is not torn apart at a hyphen."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

#: Letters up to which a literal is kept together: half the width of a page on a telephone.
SHORT = 24


class Together(SphinxPostTransform):
    """Give short literals a class, whose style is in `_static/skyscatter.css`."""

    default_priority = 900

    def run(self, **kwargs: Any) -> None:
        """Mark the short ones of a page."""
        for literal in self.document.findall(nodes.literal):
            if len(literal.astext()) <= SHORT:
                literal["classes"].append("short")


def setup(app: Sphinx) -> dict[str, bool]:
    """Mark them in every page that is written."""
    app.add_post_transform(Together)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
