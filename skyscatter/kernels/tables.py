"""What numba has to know of tables in memory: their type, how Python hands one over, how a field is read."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.pythonapi import NativeValue
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import lower_getattr_generic, models, register_model, typeof_impl, unbox
from numba.np.numpy_support import from_dtype

from skyscatter.kernels.byaddress import MARKED, WORD, pack

#: How the kind of an array is written.
_ARRAY = re.compile(r"([<>|=][a-z]\d+)([CFA])(\d+)(r?)(u?)")

_INT64, _BYTE = ir.IntType(64), ir.IntType(8)


class Table(types.Type):
    """Numba's type of a marked class whose fields have these types."""

    def __init__(self, cls: type, members: tuple[Any, ...]) -> None:
        self.cls, self.members = cls, members
        self.names: tuple[str, ...] = cls._fields  # type: ignore[attr-defined]
        # Names of types are part of the names of functions: a digest keeps those short.
        said = hashlib.sha256(f"{cls.__module__}:{members}".encode()).hexdigest()[:16]
        super().__init__(name=f"{cls.__name__}_{said}")

    def member(self, name: str) -> tuple[Any, int]:
        """Type of a field, and the word at which it begins."""
        k = self.names.index(name)
        return self.members[k], sum(words(member) for member in self.members[:k])


def register(cls: Any) -> None:
    """Let numba know a class that is marked."""

    @typeof_impl.register(cls)
    def type_of(value: Any, context: Any) -> Table:
        members = tuple(typeof_impl(item, context) for item in value)
        for name, member in zip(cls._fields, members, strict=True):
            if not _can_be_laid_out(member):
                raise TypeError(f"{cls.__name__}.{name} is {member}, which a table in memory cannot hold")
        return Table(cls, members)


def _can_be_laid_out(kind: Any) -> bool:
    return isinstance(kind, (Table, types.Array, types.NoneType, types.Boolean, types.Integer, types.Float))


def words(kind: Any) -> int:
    """Words that a value of a type takes."""
    if isinstance(kind, (Table, types.BaseTuple)):
        return sum(words(member) for member in members(kind))
    if isinstance(kind, types.Array):
        return 2 + 2 * kind.ndim
    return 0 if isinstance(kind, types.NoneType) else 1


def parse(kinds: str) -> tuple[Any, ...]:
    """Numba's types of values whose kinds are written as `skyscatter.kernels.byaddress.Words` does."""
    return tuple(_parsed(iter(kinds.split())))


def _parsed(marks: Iterator[str]) -> Iterator[Any]:
    """Types, one after the other, up to the end or to the bracket that closes them."""
    for mark in marks:
        if mark == ")":
            return
        if mark.endswith("("):
            yield _of_members(mark[:-1], tuple(_parsed(marks)))
        elif found := _ARRAY.fullmatch(mark):
            dtype, layout, ndim, locked, astray = found.groups()
            number = from_dtype(np.dtype(dtype))
            yield types.Array(number, int(ndim), layout, readonly=bool(locked), aligned=not astray)
        else:
            yield {"n": types.none, "b": types.boolean}.get(mark) or from_dtype(np.dtype(mark))


def _of_members(name: str, held: tuple[Any, ...]) -> Any:
    """Type of a table or a tuple of that class, which is none for a plain tuple."""
    if not name:
        return types.BaseTuple.from_types(held)
    module, _, cls = name.rpartition(".")
    known = getattr(import_module(module), cls)
    return Table(known, held) if known in MARKED else types.BaseTuple.from_types(held, known)


def members(kind: Any) -> tuple[Any, ...]:
    """Types of what a table or a tuple holds."""
    return kind.members if isinstance(kind, Table) else tuple(kind)


register_model(Table)(models.OpaqueModel)


@unbox(Table)
def _unbox(kind: Table, value: Any, c: Any) -> NativeValue:
    maker = c.pyapi.unserialize(c.pyapi.serialize_object(pack))
    packed = c.pyapi.call_function_objargs(maker, (value,))
    c.pyapi.decref(maker)
    pointer = cgutils.alloca_once_value(c.builder, ir.Constant(c.context.get_value_type(kind), None))
    with cgutils.if_likely(c.builder, cgutils.is_not_null(c.builder, packed)):
        number = c.pyapi.object_getattr_string(packed, "address")
        address = c.pyapi.long_as_voidptr(number)
        c.pyapi.decref(number)
        c.builder.store(address, pointer)
    failed = cgutils.is_null(c.builder, packed)
    return NativeValue(c.builder.load(pointer), is_error=failed, cleanup=lambda: c.pyapi.decref(packed))


@infer_getattr
class _Members(AttributeTemplate):
    key = Table

    def generic_resolve(self, kind: Table, name: str) -> Any:
        return kind.member(name)[0] if name in kind.names else None


@lower_getattr_generic(Table)
def _read_field(context: Any, builder: Any, kind: Table, pointer: Any, name: str) -> Any:
    return read(context, builder, *kind.member(name), pointer)


def read(context: Any, builder: Any, kind: Any, word: int, pointer: Any) -> Any:
    """A value of a type that begins at a word of what lies at an address."""
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.BaseTuple):
        places = itertools.accumulate(map(words, kind), initial=word)
        values = [read(context, builder, member, place, pointer) for member, place in zip(kind, places, strict=False)]
        return context.make_tuple(builder, kind, values)
    at = builder.gep(pointer, [ir.Constant(_INT64, WORD * word)], source_etype=_BYTE)
    if isinstance(kind, Table):
        return at
    return builder.call(_reader(context, builder.module, kind), [at])


def _reader(context: Any, module: Any, member: Any) -> ir.Function:
    """Function that reads a value from memory: one call in the text that LLVM parses, and it puts the loads in."""
    result = context.get_value_type(member)
    name = f"skyscatter.read.{hashlib.sha256(f'{result} {member}'.encode()).hexdigest()[:16]}"
    if name in module.globals:
        return module.globals[name]
    function = ir.Function(module, ir.FunctionType(result, [_BYTE.as_pointer()]), name)
    function.linkage = "linkonce_odr"
    function.attributes.add("alwaysinline")
    builder = ir.IRBuilder(function.append_basic_block())
    word = _word_reader(builder, function.args[0])
    if isinstance(member, types.Array):
        builder.ret(_array(context, builder, member, word))
    elif isinstance(member, types.Float):
        builder.ret(builder.fptrunc(word(0, ir.DoubleType()), result) if member.bitwidth < 64 else word(0, result))
    else:
        number = word(0, _INT64)
        builder.ret(builder.trunc(number, result) if result != _INT64 else number)
    return function


def _word_reader(builder: Any, pointer: Any) -> Callable[[int, Any], Any]:
    """Reads of words that never change."""
    constant = builder.module.add_metadata([])

    def word(k: int, kind: Any) -> Any:
        at = builder.gep(pointer, [ir.Constant(_INT64, WORD * k)], source_etype=_BYTE)
        load = builder.load(builder.bitcast(at, kind.as_pointer()), align=WORD)
        load.set_metadata("invariant.load", constant)
        return load

    return word


def _array(context: Any, builder: Any, kind: Any, word: Callable[[int, Any], Any]) -> Any:
    """Numba's view of an array: data, number of items, shape and strides; no owner, as kernels count no references."""
    array = context.make_array(kind)(context, builder)
    dimensions = range(kind.ndim)
    shape = [word(2 + k, _INT64) for k in dimensions]
    strides = [word(2 + kind.ndim + k, _INT64) for k in dimensions]
    nothing = ir.Constant(_BYTE.as_pointer(), None)
    array.meminfo, array.parent = nothing, nothing
    array.nitems = word(1, _INT64)
    array.itemsize = ir.Constant(_INT64, kind.dtype.bitwidth // 8 if hasattr(kind.dtype, "bitwidth") else 1)
    array.data = word(0, array.data.type)
    array.shape = cgutils.pack_array(builder, shape, ty=_INT64)
    array.strides = cgutils.pack_array(builder, strides, ty=_INT64)
    return array._getvalue()


for _cls in MARKED:
    register(_cls)
