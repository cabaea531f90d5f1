"""The wheel with machine code: SKYSCATTER_COMPILE=1 python -m build --wheel.

Instead of 1 the variable may name levels of processors, with commas between (x86-64-v3).  Without it the wheel is one
for every machine, and kernels are compiled when they are first called.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = "skyscatter/kernels/machine"
VARIABLE = "SKYSCATTER_COMPILE"


def is_wanted() -> bool:
    """Whether machine code shall be made."""
    return os.environ.get(VARIABLE, "0") not in ("", "0")


class MachineCode(BuildHookInterface[Any]):
    """Compiles the kernels into the tree before the wheel is packed, and takes them out again."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """What an isolated build needs to have."""
        needed = ("numba", "numpy")  # kernels import nothing else
        return [name for name in self.metadata.core.dependencies if name.startswith(needed)] if is_wanted() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the libraries; the wheel is then one for this sort of machine."""
        if not is_wanted() or version == "editable":
            return
        environment = {**os.environ, "PYTHONPATH": self.root, "PYTHONDONTWRITEBYTECODE": "1"}
        folder = Path(self.root) / FOLDER
        levels = [level for level in os.environ[VARIABLE].split(",") if level != "1"]
        command = [sys.executable, "-m", "skyscatter.kernels.export", str(folder), *levels]
        subprocess.run(command, env=environment, check=True)
        build_data["artifacts"] += [f"/{FOLDER}/*"]
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Leave the tree as it was."""
        folder = Path(self.root) / FOLDER
        for file in folder.glob("*") if is_wanted() else ():
            file.unlink()
        if folder.is_dir() and is_wanted():
            folder.rmdir()
