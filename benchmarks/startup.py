"""How long a newcomer waits: install, import, --help, the first picture (kernels compiled) and the second.

A fresh virtual environment is made with the running Python and the checkout is installed into it (downloads included;
with --pip-cache pip may use what it downloaded before).  The pictures use an empty compiler cache of their own.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

from common import machine, median_seconds, parser, report, seconds, table, versions

ROOT = Path(__file__).resolve().parent.parent


def call(command: Sequence[str | Path], folder: Path, **environment: str) -> None:
    """Run a command quietly; its words appear only when it fails."""
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, env=os.environ | environment, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{shlex.join(map(str, command))} failed:\n{done.stdout}{done.stderr}")


def install(folder: Path, keep_cache: bool) -> Path:
    """Install the checkout into a new environment; returns its folder of programs."""
    venv.create(folder / "venv", with_pip=True)
    programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    cache = [] if keep_cache else ["--no-cache-dir"]
    call([programs / "python", "-m", "pip", "install", "--quiet", *cache, ROOT], folder)
    return programs


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--skip-install", action="store_true", help="use the running Python's environment")
    options.add_argument("--pip-cache", action="store_true", help="let pip use its cache")
    options.add_argument("--picture", default="sky", help="command of the picture, without -o")
    given = options.parse_args()
    where = machine()
    with tempfile.TemporaryDirectory(prefix="skyscatter-startup-") as name:
        folder = Path(name)
        rows: list[list[object]] = []
        if given.skip_install:
            programs = Path(sys.executable).parent
        else:
            time, programs = seconds(lambda: install(folder, given.pip_cache))
            rows.append(["virtual environment and pip install", time])
        python, command = programs / "python", programs / "skyscatter"
        call([python, "-c", "import skyscatter"], folder)  # the files are read from the disk once
        for label, words in (
            ("Python alone", [python, "-c", "pass"]),
            ("import skyscatter", [python, "-c", "import skyscatter"]),
            ("skyscatter --help", [command, "--help"]),
        ):
            time, _ = median_seconds(lambda w=words: call(w, folder), given.repeats)
            rows.append([label, time])
        sky = [command, *shlex.split(given.picture), "-o", "sky.png"]
        cache = {"NUMBA_CACHE_DIR": str(folder / "kernels")}
        time, _ = seconds(lambda: call(sky, folder, **cache))
        rows.append([f"first `skyscatter {given.picture} -o sky.png`, kernels compiled", time])
        time, _ = median_seconds(lambda: call(sky, folder, **cache), given.repeats)
        rows.append(["the same again, kernels cached", time])
    blocks = [
        table(["step", "seconds"], rows),
        "Goal: the first default picture in less than 20 s, compile time included.",
    ]
    packages = versions("skyscatter", "numba", "numpy", "pip")
    report("startup", where, packages, blocks, ["startup.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
