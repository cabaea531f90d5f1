"""``skyscatter view``: the window, in a browser on this machine."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from skyscatter.cli import parse
from skyscatter.errors import DomainError

#: Seconds between two looks at whether the window has ended: Ctrl-C is answered in between.
LOOK = 0.2


def view(
    model: Annotated[
        str, typer.Argument(help="Name of a shipped sky or nebula (see: skyscatter models) or a TOML file.")
    ] = "earth",
    port: Annotated[
        str | None, typer.Option(metavar="N", help="Port of this machine, 1 to 65535; else a free one.")
    ] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Print the address and leave it to you to open it.")
    ] = False,
    keep: Annotated[
        bool, typer.Option("--keep", help="Go on when the last page has closed; else end some seconds after that.")
    ] = False,
) -> int:
    """Open the window on a sky or a nebula in a browser.

    Skies are drawn at once and solved behind; nebulae are traced, better and better.  All runs on this machine: the
    page loads nothing from anywhere else, and nobody else is let in.  Ctrl-C ends it, and so does closing the page.
    """
    number = parse.parse_integer(port, "port", 1, "give a number from 1 to 65535") or 0
    if number > 65535:
        raise DomainError("port", port, "give a number from 1 to 65535")
    return run(model, number, not no_open, keep)


def run(model: str, port: int, opens: bool, keep: bool) -> int:
    """Serve until the last page has closed or Ctrl-C; returns the exit status."""
    from skyscatter.window.questions import Questions
    from skyscatter.window.server import Window

    window = Window(Questions(model).work, port, keep)
    window.start()
    try:
        typer.echo(f"skyscatter: the window is at {window.address}")
        with TemporaryDirectory(prefix="skyscatter-") as folder:
            if not (opens and webbrowser.open(leading_to(window.address, Path(folder)))):
                typer.echo("skyscatter: open this address in a browser of this machine; Ctrl-C ends the window")
            while not window.ended.wait(LOOK):
                pass
    finally:
        window.close()
    return 0


def leading_to(address: str, folder: Path) -> str:
    """Address of a file in a private folder that leads on to another: what a browser is started with, all users see."""
    page = folder / "window.html"
    page.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={address}">', encoding="utf-8")
    page.chmod(0o600)
    return page.as_uri()
