"""The forms in which entries are called: what can be compiled before it is needed, into a wheel or into the cache.

They are listed in a file beside this one, which `tools/record_forms.py` makes by running everything.  A form that is
not listed is compiled when it is first called.

    python -m skyscatter.kernels.forms      # compiles the forms whose symbols it reads, a line each, into the cache
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
import time
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

FILE = Path(__file__).with_suffix(".json")

#: Families of the entries of a folder; the others belong to what the caller is about to do, by a solver's name.
OF_FOLDERS = {"raster": "dehaze", "adjoint": "inversion"}
_expected = "other"


class Form(NamedTuple):
    """An entry and the kinds of its arguments, as `skyscatter.kernels.byaddress.lay_out` writes them."""

    entry: str
    kinds: str

    @property
    def symbol(self) -> str:
        """Name for it in libraries."""
        return "sk_" + hashlib.sha256(f"{self.entry} {self.kinds}".encode()).hexdigest()[:16]


def expect(family: str) -> None:
    """Say which solver is about to run: where it must be compiled, other processes then compile a part of it."""
    global _expected
    _expected = family


def family_of(entry: str) -> str:
    """What an entry is being called for."""
    return next((family for folder, family in OF_FOLDERS.items() if f".kernels.{folder}." in entry), _expected)


@cache
def listed() -> dict[str, tuple[Form, ...]]:
    """Forms by family, in the order in which they are first called."""
    content = json.loads(FILE.read_text(encoding="utf-8"))
    forms = [Form(*pair) for pair in content["forms"]]
    return {family: tuple(forms[k] for k in numbers) for family, numbers in content["families"].items()}


def every() -> list[Form]:
    """All forms that are listed."""
    return sorted({form for forms in listed().values() for form in forms})


def write(families: dict[str, list[Form]]) -> None:
    """List these."""
    forms = sorted({form for each in families.values() for form in each})
    numbers = {family: [forms.index(form) for form in families[family]] for family in sorted(families)}
    rows = ",\n".join(json.dumps(form) for form in forms)
    lists = ",\n".join(f"{json.dumps(family)}: {json.dumps(each)}" for family, each in numbers.items())
    FILE.write_text(f'{{"forms": [\n{rows}\n], "families": {{\n{lists}\n}}}}\n', encoding="utf-8")


def dispatcher(form: Form) -> Any:
    """Numba's dispatcher of the entry."""
    module, _, name = form.entry.partition(":")
    return getattr(import_module(module), name).compiled


def can_be_kept(form: Form) -> bool:
    """Whether there is a folder for what is compiled."""
    return hasattr(dispatcher(form)._cache, "_cache_file")


def compile_form(form: Form) -> Any:
    """Compile an entry for arguments of these kinds, or load what has been compiled; numba's dispatcher of it."""
    from skyscatter.kernels.tables import parse

    found = dispatcher(form)
    found.compile(parse(form.kinds))
    return found


def _end_with(parent: int) -> None:
    """End this process when the one that started it has ended."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def main() -> None:
    """Compile what is asked for, and say of each when it is done."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    known = {form.symbol: form for form in every()}
    for line in sys.stdin:
        compile_form(known[line.strip()])
        print(line.strip(), flush=True)


if __name__ == "__main__":
    main()
