"""Machine code of kernels for a wheel: objects by LLVM, a shared library by the C compiler, and a list of both.

`skyscatter.kernels.ahead` finds and calls what is made here.

    python -m skyscatter.kernels.export FOLDER [LEVEL ...]
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types

from skyscatter.kernels import forms
from skyscatter.kernels.ahead import LEVELS, LIST, sources_stamp
from skyscatter.kernels.byaddress import WORD
from skyscatter.kernels.crew import HELPER
from skyscatter.kernels.forms import Form, compile_form
from skyscatter.kernels.processors import processors
from skyscatter.kernels.tables import parse, read, words

#: What numba calls by names of its own, in C; what else kernels call is in the mathematical library.
HELPERS = """
#include <math.h>
double numba_ldexp(double x, int n) { return ldexp(x, n); }
float numba_ldexpf(float x, int n) { return ldexpf(x, n); }
double numba_frexp(double x, int *n) { return frexp(x, n); }
float numba_frexpf(float x, int *n) { return frexpf(x, n); }
"""

#: Code of a result by its type.
RESULTS = ((types.Float, "f"), (types.Boolean, "b"), (types.Integer, "i"))


def result_kind(kind: Any) -> str:
    """A result as the list names it: nothing, a number, or numbers in brackets."""
    if isinstance(kind, types.NoneType):
        return ""
    if isinstance(kind, types.BaseTuple):
        return f"({''.join(result_kind(item) for item in kind)})"
    return next(code for known, code in RESULTS if isinstance(kind, known))


def make(form: Form, level: str) -> tuple[bytes, str]:
    """Object code of a form for a processor, and the kind of its result."""
    arguments = parse(form.kinds)
    result = compile_form(form).overloads[arguments]
    module = llvm.parse_assembly(result.library.get_llvm_str())
    module.link_in(llvm.parse_assembly(str(_door(result, form.symbol))))
    _hide_all_but(module, form.symbol)
    return _target(level).emit_object(module), result_kind(result.signature.return_type)


def _door(result: Any, symbol: str) -> ir.Module:
    """The function that takes words, hands them to the compiled function and keeps its result as words."""
    context, signature = result.target_context, result.signature
    module = context.codegen()._create_empty_module(symbol)
    pointer = ir.IntType(8).as_pointer()
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [pointer, pointer]), symbol)
    builder = ir.IRBuilder(function.append_basic_block())
    at, values = 0, []
    for kind in signature.args:
        values.append(read(context, builder, kind, at, function.args[0]))
        at += words(kind)
    native = context.declare_function(module, result.fndesc)
    kind = signature.return_type
    _, value = context.call_conv.call_function(builder, native, kind, signature.args, values)
    if isinstance(kind, types.BaseTuple):
        parts = [builder.extract_value(value, k) for k in range(len(kind))]
        for k, (part, item) in enumerate(zip(parts, kind, strict=True)):
            _keep(builder, function.args[1], k, item, part)
    elif not isinstance(kind, types.NoneType):
        _keep(builder, function.args[1], 0, kind, value)
    builder.ret_void()
    return module


def _keep(builder: Any, pointer: Any, k: int, kind: Any, value: Any) -> None:
    """Write a number to the k-th word."""
    if isinstance(kind, types.Float):
        word, value = ir.DoubleType(), builder.fpext(value, ir.DoubleType()) if kind.bitwidth < 64 else value
    else:
        word = ir.IntType(64)
        widen = builder.sext if getattr(kind, "signed", False) else builder.zext
        value = value if value.type == word else widen(value, word)
    place = builder.gep(pointer, [ir.Constant(ir.IntType(64), WORD * k)], source_etype=ir.IntType(8))
    builder.store(value, builder.bitcast(place, word.as_pointer()), align=WORD)


def _hide_all_but(module: Any, symbol: str) -> None:
    """Leave one name to be seen, and no code that it does not need (Python's wrapper is not called)."""
    for item in (*module.functions, *module.global_variables):
        if not item.is_declaration and item.name != symbol:
            item.linkage = llvm.Linkage.internal
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(_target(""), llvm.PipelineTuningOptions()))


def _target(level: str) -> Any:
    """LLVM's description of a processor; of the one that runs this without a name."""
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=level, features="", opt=3, reloc="pic", codemodel="default")


def link(objects: Iterable[Path], library: Path) -> None:
    """Make a shared library of objects, with the C compiler that CC names."""
    command = [os.environ.get("CC", "cc"), "-O2", "-fPIC", "-shared", "-o", str(library), *map(str, objects)]
    options = ["-x", "c", "-", "-lm", "-Wl,-s", "-Wl,--no-undefined"]
    subprocess.run([*command, *options], input=HELPERS, text=True, check=True)


def export(folder: Path, workers: int, wanted: Sequence[Form] = (), levels: Sequence[str] = ()) -> None:
    """Fill a folder with a library for each level of this sort of machine, and the list of what they hold.

    Numba makes code for one processor in a process, so each level has processes of its own, which share out the forms.

    Parameters
    ----------
    folder : Path
    workers : int
        Processes at a time.
    wanted : sequence of Form, optional
        All that are listed, if none.
    levels : sequence of str, optional
        Of those that `skyscatter.kernels.ahead.LEVELS` names; all, if none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    is_x86 = platform.machine() in ("x86_64", "AMD64")
    levels = levels or (list(LEVELS) if is_x86 else [platform.machine()])
    chosen = list(wanted) or forms.every()
    entries: dict[str, dict[str, tuple[str, str]]] = {}
    with tempfile.TemporaryDirectory() as place:
        tasks = [(level, chosen[part::workers]) for level in levels for part in range(workers)]
        with ThreadPoolExecutor(workers) as pool:
            made = list(pool.map(lambda task: _run_part(Path(place), *task), tasks))
        for form, result in sorted(item for results in made for item in results.items()):
            entries.setdefault(form.entry, {})[form.kinds] = (form.symbol, result)
        for level in levels:
            link(sorted((Path(place) / level).glob("*.o")), folder / f"{level}.so")
    said = {"sources": sources_stamp(Path(__file__).parent), "levels": list(levels), "entries": entries}
    (folder / LIST).write_text(json.dumps(said, indent=0, sort_keys=True), encoding="utf-8")


def _run_part(place: Path, level: str, part: Sequence[Form]) -> dict[Form, str]:
    """Make the objects of some forms in a process of its own; the kinds of their results."""
    (place / level).mkdir(exist_ok=True)
    # What is read from a cache has no text that could be compiled again.
    environment = {**os.environ, HELPER: "1", "NUMBA_CACHE_DIR": tempfile.mkdtemp(dir=place)}
    if level in LEVELS:
        environment |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
    command = [sys.executable, "-m", "skyscatter.kernels.export", "--part", level, str(place / level)]
    said = subprocess.run(
        command, env=environment, input=json.dumps(part), check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    return {Form(entry, kinds): result for entry, kinds, result in json.loads(said)}


def make_part(level: str, part: Iterable[Form], place: Path) -> list[tuple[str, str, str]]:
    """Write the objects of forms; the kinds of their results."""
    results = []
    for form in part:
        code, result = make(form, level if level in LEVELS else "")
        (place / f"{form.symbol}.o").write_bytes(code)
        results.append((form.entry, form.kinds, result))
    return results


def main() -> None:
    """Fill the folder that the command names, or make a part of it."""
    if len(sys.argv) < 2 or (sys.argv[1].startswith("-") and sys.argv[1] != "--part"):
        raise SystemExit(f"usage: python -m skyscatter.kernels.export FOLDER [{' | '.join(LEVELS)}] ...")
    if sys.argv[1] == "--part":
        part = [Form(*pair) for pair in json.load(sys.stdin)]
        print(json.dumps(make_part(sys.argv[2], part, Path(sys.argv[3]))))
    else:
        export(Path(sys.argv[1]), processors(), levels=sys.argv[2:])


if __name__ == "__main__":
    main()
