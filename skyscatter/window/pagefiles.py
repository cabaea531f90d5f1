"""The files of the page, all of which come with the package."""

from __future__ import annotations

from functools import cache
from pathlib import Path

ASSETS = Path(__file__).parent / "assets"
#: What is served, by the ending of its name; nothing else is.
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


@cache
def _served() -> dict[str, Path]:
    """The files of the page by their path in the address."""
    files = {f"/{path.name}": path for path in sorted(ASSETS.iterdir()) if path.suffix in KINDS}
    return {**files, "/": ASSETS / "index.html"}


def page_file(route: str) -> tuple[bytes, str] | None:
    """The content and the media type of a file of the page; None where there is no such file."""
    path = _served().get(route)
    return None if path is None else (path.read_bytes(), KINDS[path.suffix])


def asset_text(name: str) -> str:
    """The text of a file of the page."""
    return (ASSETS / name).read_text(encoding="utf-8")
