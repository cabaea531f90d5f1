"""What compiling costs: seconds for each entry, Python's part (numba) and LLVM's apart, family by family.

Each family is compiled as a first run does it, one entry after the other in one process with an empty cache; functions
that entries share count for the first of them.  With ``--list`` the seconds go into the list of forms, from which the
program foretells how long a first run will take.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time

from common import machine, parser, report, table, versions

from skyscatter.kernels import forms
from skyscatter.kernels.crew import HELPER
from skyscatter.kernels.forms import Form

#: Compiles the forms of a family and prints for each the seconds in all and those in LLVM.
CHILD = """
import json, sys, time
from llvmlite import binding
from skyscatter.kernels import forms

inside = 0.0

def timed(owner, name):
    plain = getattr(owner, name)
    def call(*arguments, **options):
        global inside
        began = time.perf_counter()
        try:
            return plain(*arguments, **options)
        finally:
            inside += time.perf_counter() - began
    setattr(owner, name, call)

import numba
timed(binding, "parse_assembly")
timed(binding.ModulePassManager, "run")
timed(binding.ExecutionEngine, "finalize_object")
timed(binding.ModuleRef, "link_in")
for form in forms.listed()[sys.argv[1]]:
    inside, began = 0.0, time.perf_counter()
    forms.compile_form(form)
    print(json.dumps([time.perf_counter() - began, inside]), flush=True)
"""


def measure(family: str) -> list[tuple[float, float]]:
    """Seconds in all and in LLVM for the forms of a family, in the order in which they are first called."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, HELPER: "1", "NUMBA_CACHE_DIR": cache}
        done = subprocess.run(
            [sys.executable, "-c", CHILD, family], env=environment, check=True, capture_output=True, text=True
        )
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def main() -> None:
    """Measure, print, and write if asked."""
    options = parser(__doc__)
    options.add_argument("--list", action="store_true", help="write the seconds into the list of forms")
    chosen = options.parse_args()
    before, taken, rows = machine(), dict[str, dict[Form, float]](), []
    began = time.perf_counter()
    for family, listed in forms.listed().items():
        found = measure(family)
        taken[family] = {form: whole for form, (whole, _) in zip(listed, found, strict=True)}
        names = [form.entry.removeprefix("skyscatter.kernels.") for form in listed]
        rows += [[family, name, whole - llvm, llvm, whole] for name, (whole, llvm) in zip(names, found, strict=True)]
        whole, llvm = (sum(each[k] for each in found) for k in (0, 1))
        rows.append([f"**{family}**", f"{len(listed)} entries", whole - llvm, llvm, whole])
    text = table(["family", "entry", "Python [s]", "LLVM [s]", "in all [s]"], rows)
    packages = versions("skyscatter", "numba", "llvmlite")
    report("compiling", before, packages, [text], sys.argv, chosen.write)
    print(f"{time.perf_counter() - began:.0f} s")
    if chosen.list:
        forms.write({family: list(listed) for family, listed in forms.listed().items()}, taken)


if __name__ == "__main__":
    main()
