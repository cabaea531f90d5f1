"""How long a newcomer waits: install, import, --help, the first pictures and the second ones.

A fresh virtual environment is made with the running Python and the checkout is installed into it (downloads included;
with --pip-cache pip may use what it downloaded before), or the wheel that --wheel names, such as one with machine code.
Every first picture has an empty compiler cache of its own.  Pictures are made before a terminal: seconds count to the
first byte of progress that it shows, and to the end of the command.
"""

from __future__ import annotations

import os
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
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


def watched(command: Sequence[str | Path], folder: Path, **environment: str) -> tuple[float, float]:
    """Run a command whose stderr is a terminal; seconds to the first byte there and to its end."""
    reader, terminal = os.openpty()
    began, first, said = time.perf_counter(), 0.0, b""
    with subprocess.Popen(
        [str(word) for word in command], cwd=folder, env=os.environ | {"TERM": "xterm"} | environment,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=terminal,
    ) as process:  # fmt: skip
        os.close(terminal)
        while words := _read(reader):
            first, said = first or time.perf_counter() - began, said + words
    whole = time.perf_counter() - began
    os.close(reader)
    if process.returncode:
        raise SystemExit(f"{shlex.join(map(str, command))} failed:\n{said.decode(errors='replace')}")
    return first, whole


def _read(reader: int) -> bytes:
    """What a terminal has been told; nothing once all who could tell it something have ended."""
    try:
        return os.read(reader, 1 << 16)
    except OSError:
        return b""


def pictures(commands: Sequence[str], program: Path, folder: Path, repeats: int) -> list[list[object]]:
    """Rows of first pictures and of the same again."""
    rows: list[list[object]] = []
    for k, picture in enumerate(commands):
        words = [program, *shlex.split(picture), "-o", f"{k}.png"]
        cache = {"NUMBA_CACHE_DIR": str(folder / f"kernels {k}")}
        rows.append([f"first `skyscatter {picture}`", *watched(words, folder, **cache)])
        again = [watched(words, folder, **cache) for _ in range(max(repeats, 1))]
        rows.append(["the same again", *(statistics.median(times) for times in zip(*again, strict=True))])
    return rows


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
            taken, programs = seconds(lambda: install(folder, given.pip_cache, (given.wheel or ROOT).resolve()))
            rows.append(["virtual environment and pip install", "", taken])
        python, command = programs / "python", programs / "skyscatter"
        call([python, "-c", "import skyscatter"], folder)  # the files are read from the disk once
        for label, words in (
            ("Python alone", [python, "-c", "pass"]),
            ("import skyscatter", [python, "-c", "import skyscatter"]),
            ("skyscatter --help", [command, "--help"]),
        ):
            taken, _ = median_seconds(lambda w=words: call(w, folder), given.repeats)
            rows.append([label, "", taken])
        rows += pictures(given.picture or PICTURES, command, folder, given.repeats)
    blocks = [table(["step", "first progress [s]", "end [s]"], rows)]
    if given.wheel is not None:
        blocks.insert(0, f"Installed from {given.wheel.name}, {given.wheel.stat().st_size / 1e6:.1f} MB.")
    packages = versions("skyscatter", "numba", "numpy", "pip")
    name = "startup-wheel" if given.wheel else "startup"
    report(name, where, packages, blocks, ["startup.py", *sys.argv[1:]], given.write)


if __name__ == "__main__":
    main()
