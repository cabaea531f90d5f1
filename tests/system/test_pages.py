"""What pages tell readers to type: commands are what the program takes, Python runs from top to bottom of a page."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer.main

from skyscatter.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "docs" / "gallery" / "README.md"]
#: Fences of languages, and blocks that are indented.
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^    (skyscatter .*(?:\\\n.*)*)", re.MULTILINE)


def names(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def commands(page: Path) -> list[str]:
    """Lines that call the program, put together where they go on, without what a shell does around them."""
    text = page.read_text(encoding="utf-8")
    blocks = [body for language, body in FENCE.findall(text) if language in ("sh", "console", "bash")]
    lines = [line for body in blocks for line in body.replace("\\\n", " ").splitlines()]
    lines += [match.replace("\\\n", " ") for match in INDENTED.findall(FENCE.sub("", text))]
    calls = (re.split(r"\s(?:&&|\||>|;)\s|;\s", line.removeprefix("$ "))[-1].strip() for line in lines)
    return [call for call in calls if call.startswith("skyscatter ")]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=names)
def test_its_commands_are_understood(page: Path) -> None:
    for call in commands(page):
        command = typer.main.get_command(app)
        words = [word for word in shlex.split(call, comments=True)[1:] if not word.startswith("$")]
        context = command.make_context("skyscatter", list(words), resilient_parsing=True)
        while hasattr(command, "commands"):
            rest = [*context._protected_args, *context.args] if hasattr(context, "_protected_args") else context.args
            if not rest or rest[0] in ("--version", "--help"):
                break
            assert rest[0] in command.commands, call
            command, words = command.commands[rest[0]], rest[1:]
            context = command.make_context(rest[0], list(words), resilient_parsing=True)
        known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        used = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert used <= {*known, "--help", "-h", "--version"}, call


def python(page: Path) -> list[str]:
    """What is to be typed into Python, but for what Blender's own runs (`test_domes.py` looks at what that reads)."""
    fences = FENCE.findall(page.read_text(encoding="utf-8"))
    return [body for language, body in fences if language == "python" and "import bpy" not in body]


# Warnings of libraries are no errors for those who read.
@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("page", [page for page in PAGES if python(page)], ids=names)
def test_its_python_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {"__name__": "__main__"}
    for body in python(page):
        exec(compile(body, str(page), "exec"), space)
