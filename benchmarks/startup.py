"""How long a newcomer waits: install, import, --help, the first pictures and the second ones.

A fresh virtual environment is made with the running Python and the checkout is installed into it (downloads included;
with --pip-cache pip may use what it downloaded before), or the wheel that --wheel names, such as one with machine code.
Every first picture has an empty compiler cache of its own.
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
PICTURES = ("sky", "nebula ring-nebula --size 16x16 --samples 4", "render fog-room --size 32x24 --samples 2")


def call(command: Sequence[str | Path], folder: Path, **environment: str) -> None:
    """Run a command quietly; its words appear only when it fails."""
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, env=os.environ | environment, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{shlex.join(map(str, command))} failed:\n{done.stdout}{done.stderr}")


def install(folder: Path, keep_cache: bool, what: Path) -> Path:
    """Install the checkout or a wheel into a new environment; returns its folder of programs."""
    venv.create(folder / "venv", with_pip=True)
    programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    cache = [] if keep_cache else ["--no-cache-dir"]
    call([programs / "python", "-m", "pip", "install", "--quiet", *cache, what], folder)
    return programs


def main() -> None:
    options = parser(__doc__, repeats=3)
    options.add_argument("--skip-install", action="store_true", help="use the running Python's environment")
    options.add_argument("--pip-cache", action="store_true", help="let pip use its cache")
    options.add_argument("--wheel", type=Path, help="install this and not the checkout")
    options.add_argument(
        "--picture", action="append", help="command of a picture, without -o; by default a sky, a nebula and a room"
    )
    given = options.parse_args()
    where = machine()
    with tempfile.TemporaryDirectory(prefix="skyscatter-startup-") as place:
        folder = Path(place)
        rows: list[list[object]] = []
        if given.skip_install:
            programs = Path(sys.executable).parent
        else:
            time, programs = seconds(lambda: install(folder, given.pip_cache, (given.wheel or ROOT).resolve()))
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
        for k, picture in enumerate(given.picture or PICTURES):
            words = [command, *shlex.split(picture), "-o", f"{k}.png"]
            cache = {"NUMBA_CACHE_DIR": str(folder / f"kernels {k}")}
            time, _ = seconds(lambda w=words, c=cache: call(w, folder, **c))
            rows.append([f"first `skyscatter {picture}`", time])
            time, _ = median_seconds(lambda w=words, c=cache: call(w, folder, **c), given.repeats)
            rows.append(["the same again", time])
    blocks = [table(["step", "seconds"], rows)]
    if given.wheel is not None:
        blocks.insert(0, f"Installed from {given.wheel.name}, {given.wheel.stat().st_size / 1e6:.1f} MB.")
    packages = versions("skyscatter", "numba", "numpy", "pip")
    name = "startup-wheel" if given.wheel else "startup"
    report(name, where, packages, blocks, ["startup.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
