"""Machine code of kernels for a wheel: objects by LLVM, a shared library by the C compiler, and a list of both.

`skyscatter.kernels.ahead` finds and calls what is made here.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types

from skyscatter.kernels import jit
from skyscatter.kernels.ahead import LIST, sources_stamp
from skyscatter.kernels.byaddress import WORD
from skyscatter.kernels.tables import kinds, read, words

#: Code of a result by its type.
RESULTS = ((types.Float, "f"), (types.Boolean, "b"), (types.Integer, "i"))


class Form(NamedTuple):
    """An entry with arguments of certain types."""

    entry: str
    arguments: tuple[Any, ...]

    @property
    def kinds(self) -> str | None:
        """Text by which a call finds it; None where a call's arguments have no words."""
        each = [kinds(kind) for kind in self.arguments]
        return None if None in each else " ".join(map(str, each))

    @property
    def symbol(self) -> str:
        """Name in the library."""
        return "sk_" + hashlib.sha256(f"{self.entry} {self.kinds}".encode()).hexdigest()[:16]


def compiled() -> Iterator[Form]:
    """The forms of all entries that this process has compiled so far."""
    for name, kernel in jit.entries().items():
        for arguments in kernel.forms:
            form = Form(name, arguments)
            if form.kinds is not None:
                yield form


def result_kind(kind: Any) -> str:
    """A result as the list names it: nothing, a number, or numbers in brackets."""
    if isinstance(kind, types.NoneType):
        return ""
    if isinstance(kind, types.BaseTuple):
        return f"({''.join(result_kind(item) for item in kind)})"
    return next(code for known, code in RESULTS if isinstance(kind, known))


def make(form: Form, level: str) -> tuple[bytes, str]:
    """Object code of a form for a processor, and the kind of its result."""
    made = jit.entries()[form.entry].compiled
    made.compile(form.arguments)
    result = made.overloads[form.arguments]
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
    command = [os.environ.get("CC", "cc"), "-shared", "-o", str(library), *map(str, objects), "-lm"]
    subprocess.run([*command, "-Wl,-s", "-Wl,--no-undefined"], check=True)


def write_list(folder: Path, levels: Iterable[str], entries: dict[str, dict[str, tuple[str, str]]]) -> None:
    """Write down what the libraries in a folder hold and which sources they are made of."""
    said = {"sources": sources_stamp(Path(__file__).parent), "levels": list(levels), "entries": entries}
    (folder / LIST).write_text(json.dumps(said, indent=0, sort_keys=True), encoding="utf-8")


def own_level() -> str:
    """What code is made for where there are no levels to choose from."""
    return platform.machine()
