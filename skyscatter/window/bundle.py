"""The page as one text, for where no server gives out its files: notebooks, and pages of the documentation."""

from __future__ import annotations

import base64
import gzip
import json
import re
from typing import Any

from skyscatter.window.pagefiles import asset_text

#: How a module of the page names another one.
_IMPORT = re.compile(r'from "\./([a-z]+\.js)"')
#: Modules become addresses within the page, those that are imported first; they may name each other by these only.
_LOADER = """\
const texts = %s;
const urls = {};
for (const [name, text] of texts) {
  const linked = text.replace(/from "\\.\\/([a-z]+\\.js)"/g, (_, other) => `from "${urls[other]}"`);
  urls[name] = URL.createObjectURL(new Blob([linked], { type: "text/javascript" }));
}
"""
_WIDGET = """\
export default {
  async render({ model, el }) {
    const [page, link] = await Promise.all([import(urls["page.js"]), import(urls["link.js"])]);
    return page.embed(el, model, new link.Kernel(model));
  },
};
"""
_LIVE = """\
const [page, link] = await Promise.all([import(urls["page.js"]), import(urls["link.js"])]);
const packed = Uint8Array.from(atob(document.getElementById("table").textContent.trim()), c => c.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const table = await new Response(unpacked).arrayBuffer();
page.start(document.querySelector(".skyscatter"), new link.Alone(table, %s));
"""
#: A page of the documentation loads nothing at all.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' blob:; style-src 'unsafe-inline'; img-src data: blob:; "
    "base-uri 'none'; form-action 'none'"
)


def modules(name: str = "page.js") -> list[tuple[str, str]]:
    """A module of the page and all that it imports, as names and texts; those that are imported come first."""
    found: dict[str, str] = {}

    def visit(name: str) -> None:
        text = asset_text(name)
        for other in _IMPORT.findall(text):
            if other not in found:
                visit(other)
        found[name] = text

    visit(name)
    return list(found.items())


def _loader() -> str:
    texts = dict(modules("page.js")) | dict(modules("link.js"))
    return _LOADER % json.dumps(list(texts.items()))


def markup() -> str:
    """The fields and the canvas of the page."""
    text = asset_text("index.html")
    return text.partition("<!-- the window -->")[2].partition("<!-- end of the window -->")[0].strip()


def widget_module() -> str:
    """The module that a notebook loads."""
    return _loader() + _WIDGET


def live_page(table: bytes, facts: dict[str, Any]) -> str:
    """A page that draws one sky without any solver behind it, in a single file that loads nothing.

    Parameters
    ----------
    table : bytes
        The table of the sky.
    facts : dict
        What a page has to know of the sky, see `skyscatter.window.questions.shipped`.
    """
    # "</" would end the script; no module and no fact needs it.
    script = (_loader() + _LIVE % json.dumps(facts)).replace("</", "<\\/")
    packed = base64.b64encode(gzip.compress(table, 9, mtime=0)).decode()
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>A sky</title>\n'
        f"<style>\n{asset_text('window.css')}</style>\n</head>\n<body>\n{markup()}\n"
        f'<script type="application/base64" id="table">{packed}</script>\n'
        f'<script type="module">\n{script}</script>\n</body>\n</html>\n'
    )
