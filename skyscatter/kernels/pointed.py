"""Tables that kernels read through an address.

A named tuple of arrays is handed to a function number by number: a scene with surfaces and its scratch are a thousand
of them, at every call that is not inlined, and compilers take minutes over such functions.  A `Pointed` table lies in
memory once; what is passed is where.  Its fields are read when they are asked for, by the same dotted names, nested
tables too.  The fields never change (only what is in the arrays does), and the compiler is told so.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

#: Bytes of a number; flags take as many.
WORD = 8


class PointedType(types.Type):
    """Numba's type of a table that is read through its address."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner
        super().__init__(name=f"Pointed({inner})")


class Pointed:
    """A named tuple of arrays, numbers and such tuples, laid down for kernels."""

    def __init__(self, table: Any) -> None:
        self.table = table  # its arrays must live as long as their addresses
        self.type = PointedType(typeof(table))
        words: list[int] = []
        _lay(table, words)
        self._memory = np.array(words, np.uint64)
        self.address = self._memory.ctypes.data


def _lay(value: Any, words: list[int]) -> None:
    """Append a value as words: of an array its address, its shape and its strides."""
    if isinstance(value, tuple):
        for part in value:
            _lay(part, words)
    elif isinstance(value, np.ndarray):
        words.extend([value.ctypes.data, *value.shape, *(s % 2**64 for s in value.strides)])
    elif value is None:
        words.append(0)
    elif isinstance(value, (bool, int, np.integer, np.bool_)):
        words.append(int(value) % 2**64)
    else:
        words.append(ctypes.c_uint64.from_buffer(ctypes.c_double(value)).value)


def words_of(kind: Any) -> int:
    """Words that a value of a Numba type takes."""
    if isinstance(kind, types.BaseTuple):
        return sum(words_of(part) for part in kind)
    return 1 + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def place_of(kind: Any, name: str) -> tuple[int, Any]:
    """Place [words] and type of a field of a named tuple."""
    at = kind.fields.index(name)
    parts = list(kind)
    return sum(words_of(part) for part in parts[:at]), parts[at]


@typeof_impl.register(Pointed)
def _type_of(value: Pointed, context: Any) -> PointedType:
    return value.type


@register_model(PointedType)
class _Model(models.PrimitiveModel):
    """An address as a number."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.IntType(64))


@unbox(PointedType)
def _unbox(kind: Any, value: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_ulonglong(number)
    c.pyapi.decref(number)
    return NativeValue(address, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@infer_getattr
class _Fields(AttributeTemplate):
    key = PointedType

    def generic_resolve(self, kind: PointedType, name: str) -> Any:
        if name not in kind.inner.fields:
            return None
        part = place_of(kind.inner, name)[1]
        return PointedType(part) if isinstance(part, types.BaseNamedTuple) else part


def _word(builder: Any, address: Any, at: int, kind: Any) -> Any:
    """The word at a place, as a value of that type of LLVM."""
    place = builder.add(address, ir.Constant(ir.IntType(64), WORD * at))
    loaded = builder.load(builder.inttoptr(place, ir.PointerType(kind)), typ=kind)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


def _read(context: Any, builder: Any, kind: Any, address: Any, at: int) -> Any:
    """The value of a Numba type at a place."""
    word = ir.IntType(64)
    if isinstance(kind, types.BaseTuple):
        parts, n = [], at
        for part in kind:
            parts.append(_read(context, builder, part, address, n))
            n += words_of(part)
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        target = array.data.type
        array.data = builder.inttoptr(_word(builder, address, at, word), target)
        shape = [_word(builder, address, at + 1 + n, word) for n in range(kind.ndim)]
        strides = [_word(builder, address, at + 1 + kind.ndim + n, word) for n in range(kind.ndim)]
        array.shape = cgutils.pack_array(builder, shape, ty=word)
        array.strides = cgutils.pack_array(builder, strides, ty=word)
        count = ir.Constant(word, 1)
        for side in shape:
            count = builder.mul(count, side)
        array.nitems = count
        array.itemsize = ir.Constant(word, kind.dtype.bitwidth // 8 if kind.dtype != types.boolean else 1)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if kind == types.boolean:
        return builder.trunc(_word(builder, address, at, word), ir.IntType(1))
    return _word(builder, address, at, context.get_value_type(kind))


@lower_getattr_generic(PointedType)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    at, part = place_of(kind.inner, name)
    if isinstance(part, types.BaseNamedTuple):
        return builder.add(value, ir.Constant(ir.IntType(64), WORD * at))
    return _read(context, builder, part, value, at)


@intrinsic
def whole(typingctx, table):
    """The table itself, for a function that is compiled for such; a table that is not pointed stays as it is."""
    inner = table.inner if isinstance(table, PointedType) else table

    def codegen(context, builder, signature, args):
        if isinstance(signature.args[0], PointedType):
            return _read(context, builder, inner, args[0], 0)
        return args[0]

    return inner(table), codegen


