"""Kernels that a wheel carries as machine code: found by the types of their arguments, called without the compiler.

A folder `machine` beside this file, or one that the variable SKYSCATTER_MACHINE_CODE names, holds a shared library for
each level of x86-64 (or for whatever else the building machine was), and one list of what is in it: entry, kinds of
arguments, name of the symbol, kinds of the result.  It is tied to the sources: where a single kernel's source differs
from what the library was made of, none of it is used, and numba compiles as it does without one.  The same holds where
the list, the library or the processor does not fit.

A symbol takes the address of its arguments, laid out in words as `skyscatter.kernels.byaddress` does for tables, and
the address of the words of its result.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import platform
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from skyscatter.kernels.byaddress import WORD, lay_out

#: Where libraries and their list lie; the variable that names another folder, or with "0" none.
FOLDER = Path(__file__).parent / "machine"
LIST = "list.json"
SWITCH = "SKYSCATTER_MACHINE_CODE"

#: Levels of x86-64 from the highest down, with the features that tell them (names as in /proc/cpuinfo).
LEVELS = {
    "x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": {"avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"},
    "x86-64": set[str](),
}

#: How words of a result are unpacked.
WORDS = {"f": "d", "i": "q", "b": "?xxxxxxx"}


def sources_stamp(root: Path) -> str:
    """Hash of all sources below a folder of kernels."""
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def features() -> set[str]:
    """What the processor can do, by the names that Linux gives it; empty where that is not told."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return set()
    line = next((line for line in text.splitlines() if line.startswith("flags")), "")
    return set(line.partition(":")[2].split())


def levels() -> list[str]:
    """Names of the code that this processor runs, the best first."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return [platform.machine()]
    has = features()
    higher = [name for name, needed in LEVELS.items() if needed and needed <= has and LEVELS["x86-64-v3"] <= has]
    return [*higher, "x86-64"]


class Machine(NamedTuple):
    """A library that is in use."""

    level: str
    library: ctypes.CDLL
    listed: dict[str, dict[str, tuple[str, str]]]  #: symbol and kinds of result by entry and by kinds of arguments


@cache
def machine() -> Machine | str:
    """The library for this processor, or in a few words why there is none."""
    chosen = os.environ.get(SWITCH, "")
    if chosen == "0":
        return f"switched off by {SWITCH}"
    folder = Path(chosen) if chosen else FOLDER
    try:
        said = json.loads((folder / LIST).read_text(encoding="utf-8"))
        sources, there, entries = said["sources"], said["levels"], said["entries"]
    except OSError:
        return f"none in {chosen}" if chosen else "none in this installation"
    except (ValueError, KeyError, TypeError):
        return f"{folder / LIST} cannot be read"
    if sources != sources_stamp(Path(__file__).parent):
        return f"that of {folder} is made of other sources" if chosen else "made of other sources"
    level = next((level for level in levels() if level in there), None)
    if level is None:
        return f"none for {levels()[0]}"
    try:
        return Machine(level, ctypes.CDLL(str((folder / f"{level}.so").resolve())), entries)
    except OSError as error:  # such as another C library
        return f"cannot be loaded: {error}"


def find(entry: str, kinds: str) -> Callable[[bytes], Any] | None:
    """What calls an entry with arguments of these kinds, given their words; None where the library has no such."""
    loaded = machine()
    if isinstance(loaded, str):
        return None
    symbol, result = loaded.listed.get(entry, {}).get(kinds, (None, ""))
    if symbol is None:
        return None
    try:
        function = loaded.library[symbol]
    except AttributeError:  # another library by that name: what it has not is compiled
        return None
    function.argtypes, function.restype = (ctypes.c_char_p, ctypes.c_void_p), None
    return _caller(function, result)


def _caller(function: Any, result: str) -> Callable[[bytes], Any]:
    """A function of the words of the arguments; its result is None, a number, or a tuple in brackets."""
    if not result:
        return lambda words: function(words, None)
    form, size = "".join(WORDS[kind] for kind in result.strip("()")), WORD * len(result.strip("()"))

    def call(words: bytes) -> Any:
        room = ctypes.create_string_buffer(size)
        function(words, ctypes.addressof(room))
        values = struct.unpack(form, room)
        return values if result[0] == "(" else values[0]

    return call


class Caller:
    """Calls an entry by machine code that is there, or else as `other` does."""

    def __init__(self, entry: str, other: Callable[..., Any]) -> None:
        self.entry, self.other = entry, other
        self._known: dict[str, Callable[[bytes], Any] | None] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Call it."""
        laid = lay_out(arguments)
        if laid is None:
            return self.other(*arguments)
        kinds, words = laid
        if kinds not in self._known:
            self._known[kinds] = find(self.entry, kinds)
        call = self._known[kinds]
        return self.other(*arguments) if call is None else call(words)
