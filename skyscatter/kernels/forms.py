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
from collections.abc import Container, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

FILE = Path(__file__).with_suffix(".json")

#: Families of the entries of a folder; the others belong to what the caller is about to do, by a solver's name.
OF_FOLDERS = {"raster": "dehaze", "adjoint": "inversion"}
_expected = "other"
#: Seconds that a form takes to compile of which that is not listed.
USUAL_SECONDS = 3.0


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


@cache
def always() -> dict[str, tuple[Form, ...]]:
    """Forms of which every command of a family has need, in the order in which they are first called."""
    content = json.loads(FILE.read_text(encoding="utf-8"))
    forms = [Form(*pair) for pair in content["forms"]]
    return {family: tuple(forms[k] for k in numbers) for family, numbers in content["always"].items()}


@cache
def seconds(family: str) -> dict[Form, float]:
    """What the forms of a family take to compile one after the other, as `benchmarks/compiling.py` found [s]."""
    known = json.loads(FILE.read_text(encoding="utf-8")).get("seconds", {}).get(family, [])
    forms = listed().get(family, ())
    return dict(zip(forms, [*known, *[USUAL_SECONDS] * (len(forms) - len(known))], strict=True))


def every() -> list[Form]:
    """All forms that are listed."""
    return sorted({form for forms in listed().values() for form in forms})


def write(
    families: Mapping[str, Sequence[Form]],
    taken: Mapping[str, Mapping[Form, float]] | None = None,
    needed: Mapping[str, Sequence[Form]] | None = None,
) -> None:
    """List these, the seconds that they were seen to take, and what is always needed; what was known, if not given."""
    taken = taken or {family: seconds(family) for family in families}
    if needed is None:
        needed = {family: [form for form in known if form in families[family]] for family, known in always().items()}
    forms = sorted({form for each in families.values() for form in each})
    names = sorted(families)
    rows = ",\n".join(json.dumps(form) for form in forms)
    lists = _rows({family: [forms.index(form) for form in families[family]] for family in names})
    times = _rows({f: [round(taken[f].get(form, USUAL_SECONDS), 1) for form in families[f]] for f in names})
    calls = _rows({family: [forms.index(form) for form in needed[family]] for family in sorted(needed)})
    text = (
        f'{{"forms": [\n{rows}\n], "families": {{\n{lists}\n}}, "always": {{\n{calls}\n}}, '
        f'"seconds": {{\n{times}\n}}}}\n'
    )
    FILE.write_text(text, encoding="utf-8")


def _rows(lists: dict[str, list[Any]]) -> str:
    return ",\n".join(f"{json.dumps(name)}: {json.dumps(each)}" for name, each in lists.items())


def dispatcher(form: Form) -> Any:
    """Numba's dispatcher of the entry."""
    module, _, name = form.entry.partition(":")
    return getattr(import_module(module), name).compiled


def can_be_kept(form: Form) -> bool:
    """Whether there is a folder for what is compiled."""
    return hasattr(dispatcher(form)._cache, "_cache_file")


def is_kept(form: Form) -> bool:
    """Whether the cache has the form's machine code for this processor."""
    from numba.core.registry import cpu_target

    from skyscatter.kernels.tables import parse

    held = dispatcher(form)._cache
    if not hasattr(held, "_cache_file"):
        return False
    kept: Container[Any] = ()
    with held._guard_against_spurious_io_errors():
        kept = held._cache_file._load_index()
    return held._index_key(parse(form.kinds), cpu_target.target_context.codegen()) in kept


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
