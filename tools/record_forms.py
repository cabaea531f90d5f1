"""List the forms in which entries are called (skyscatter/kernels/forms.json), by running everything and listening.

    SKYSCATTER_REFERENCE=... python tools/record_forms.py [PYTEST ARGUMENT ...]

Run are small commands for every solver, the digests of all shipped models, and the quick tests (or those that are
named).  Calls from the tests themselves do not count.  What was listed before stays, unless its entry is no more;
--anew forgets it all.  What all commands of a family call is listed apart; --commands ends with them.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import digests  # noqa: E402

from skyscatter.kernels import forms  # noqa: E402
from skyscatter.kernels.byaddress import lay_out  # noqa: E402
from skyscatter.kernels.forms import Form  # noqa: E402
from skyscatter.kernels.jit import Entry  # noqa: E402


def listen(families: dict[str, list[Form]]) -> None:
    """From now on, note the form of every call that comes from the package."""
    call = Entry.__call__

    def noting(self: Entry, *arguments: Any) -> Any:
        caller = sys._getframe(1).f_globals.get("__name__", "")
        laid = lay_out(arguments)
        if not caller.startswith(("test_", "bases")) and self.name.startswith("skyscatter.") and laid is not None:
            known = families.setdefault(forms.family_of(self.name), [])
            form = Form(self.name, laid[0])
            if form not in known:
                known.append(form)
        return call(self, *arguments)

    Entry.__call__ = noting  # type: ignore[method-assign]


def exists(form: Form) -> bool:
    """Whether there is still such an entry."""
    module, _, name = form.entry.partition(":")
    try:
        return isinstance(getattr(import_module(module), name, None), Entry)
    except ModuleNotFoundError:
        return False


def commands(folder: str) -> Iterator[list[str]]:
    """Small pictures by every solver, as users ask for them."""
    out = ["-q", "-o", f"{folder}/picture.png", "-o", f"{folder}/picture.exr"]
    for name in ("earth", "earth-maritime"):
        for solver in ("orders", "single", "path"):
            walks = ["--samples", "2"] if solver == "path" else []
            yield ["sky", name, "--size", "16x8", "--solver", solver, *walks, *out]
            yield ["sky", name, "--size", "16x8", "--solver", solver, "--stokes", *walks, *out]
        yield ["sky", name, "--size", "8x8", "--altitude", "400km", "--view", "planet", *out]
        yield ["flux", name, "--wavelengths", "550", "-q", "-o", f"{folder}/flux.csv"]
    for name in digests.NEBULAE:
        for solver in ("single", "path"):
            walks = ["--samples", "2"] if solver == "path" else []
            yield ["nebula", name, "--size", "8x8", "--solver", solver, *walks, *out]
    for name in digests.ROOMS:
        for walks in (["--solver", "path"], ["--solver", "photons", "--photons", "1000"]):
            yield ["render", name, "--size", "8x6", "--samples", "2", *walks, *out]


#: Runs one command and prints the forms that it calls, in a process of its own: tables are kept by one.
ALONE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import record_forms
from skyscatter.cli.main import main
families = {}
record_forms.listen(families)
assert main(sys.argv[2:]) == 0
print(json.dumps(families))
"""


def alone(command: list[str]) -> dict[str, list[Form]]:
    """Forms by family that a command calls where nothing has been called before."""
    run = [sys.executable, "-c", ALONE, str(ROOT / "tools"), *command]
    done = subprocess.run(run, check=True, capture_output=True, text=True)
    called = json.loads(done.stdout.splitlines()[-1])
    return {family: [Form(*pair) for pair in pairs] for family, pairs in called.items()}


def run_commands(families: dict[str, list[Form]]) -> dict[str, list[Form]]:
    """Run all commands and list what they call; what every command of a family does."""
    always: dict[str, list[Form]] = {}
    with TemporaryDirectory() as folder:
        for command in commands(folder):
            print(*command[:6], flush=True)
            for family, called in alone(command).items():
                known = families.setdefault(family, [])
                known += [form for form in called if form not in known]
                always[family] = [form for form in always.get(family, called) if form in called]
    return always


def main() -> None:
    """Run and list."""
    arguments = [word for word in sys.argv[1:] if word not in ("--anew", "--commands")]
    before = {} if "--anew" in sys.argv or not forms.FILE.exists() else forms.listed()
    families = {name: [form for form in known if exists(form)] for name, known in before.items()}
    always = run_commands(families)
    forms.write(families, needed=always)
    if "--commands" in sys.argv:
        return
    listen(families)
    for name in digests.DIGESTS:
        digests.computed(name)
        print(name, flush=True)
        forms.write(families, needed=always)
    pytest.main(["-q", "-p", "no:cacheprovider", *(arguments or [str(ROOT / "tests")])])
    forms.write(families, needed=always)


if __name__ == "__main__":
    main()
