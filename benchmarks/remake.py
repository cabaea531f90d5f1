"""Make RESULTS.md and the tables of the validation pages anew: the commands of README.md one after the other.

    python benchmarks/remake.py [--only walks,startup] [--after sasktran_rays] [--list]

Each runs alone on a quiet machine, hours in all.  What each prints goes to a file of its own in the folder for logs;
one that fails is told at the end, and the others run all the same.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def commands() -> dict[str, list[str]]:
    """Command lines of the README that write something, by the script's name, numbered from its second one on."""
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for line in re.findall(r"^ {4}python (benchmarks/\w+\.py .*--write)$", text, re.M):
        words = shlex.split(line)
        name = Path(words[0]).stem
        before = sum(other.partition("-")[0] == name for other in found)
        found[f"{name}-{before + 1}" if before else name] = words
    return found


def chosen(known: dict[str, list[str]], only: str | None, after: str | None) -> list[str]:
    """Names of the commands to run, in the README's order; exits with a line where one is unknown."""
    names = list(known)
    for name in [*(only.split(",") if only else []), *([after] if after else [])]:
        if name not in known:
            sys.exit(f"remake: no command {name}; there are {', '.join(known)}")
    names = names[names.index(after) + 1 :] if after else names
    return [name for name in names if only is None or name in only.split(",")]


def main() -> int:
    """Run them; returns the number of those that failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="names, separated by commas")
    parser.add_argument("--after", help="start behind this one")
    parser.add_argument("--list", action="store_true", help="show the commands and run none")
    parser.add_argument("--logs", type=Path, default=Path("remake-logs"), help="folder for what they print")
    given = parser.parse_args()
    known, failed = commands(), []
    for name in chosen(known, given.only, given.after):
        if given.list:
            print(shlex.join(["python", *known[name]]))
            continue
        given.logs.mkdir(parents=True, exist_ok=True)
        started, load = time.monotonic(), os.getloadavg()[0]
        with (given.logs / f"{name}.log").open("w", encoding="utf-8") as log:
            status = subprocess.run([sys.executable, *known[name]], cwd=ROOT, stdout=log, stderr=log, check=False)
        words = "ok" if status.returncode == 0 else f"FAILED, exit {status.returncode}: {given.logs / name}.log"
        print(f"{name}: {words}, {time.monotonic() - started:.0f} s, load {load:.1f} at its start", flush=True)
        failed += [name] * (status.returncode != 0)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
