"""What messages say to install can be installed as it is said, from where the package itself came or not."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_hints_name_packages_that_the_project_asks_for() -> None:
    """By the names of their own: the package itself may have been installed from a folder, or under no name at all."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists = [project["dependencies"], *project["optional-dependencies"].values()]
    asked = {re.split("[<>=]", word)[0] for words in lists for word in words}
    hints = {}
    for path in (*(ROOT / "skyscatter").rglob("*.py"), *(ROOT / "examples").glob("*.py")):
        for hint in re.findall(r"pip install ([^\"`)]+)", path.read_text(encoding="utf-8")):
            hints[hint.replace("'", "").strip()] = path.name
    assert len(hints) >= 5
    for hint, path in hints.items():
        assert set(hint.split()) <= asked, f"{path}: pip install {hint}"
