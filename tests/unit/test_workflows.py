"""Workflows under .github: what they name is there, and no folder of tests is left out."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_extras_and_paths_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = {name for words in re.findall(r"'\.\[([\w,]+)\]'", text) for name in words.split(",")}
    assert named <= extras.keys()
    files = set(re.findall(r"(?<![\w/])((?:tests|docs|tools)/[\w/.]+|\.ci/\w+)", text))
    assert [name for name in files if not (ROOT / name).exists()] == []


def test_slow_tests_of_every_folder_run_by_night() -> None:
    nightly = (ROOT / ".github" / "workflows" / "nightly.yml").read_text(encoding="utf-8")
    parts = re.search(r"part: \[(.*)\]", nightly)
    assert parts is not None
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    assert folders == set(re.findall(r"tests/(\w+)", parts.group(1)))
