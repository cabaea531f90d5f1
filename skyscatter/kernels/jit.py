"""How kernels are marked: each is compiled when it is first called, serial and without the GIL, and kept on disk.

The marks name no compiler, which takes half a second to load: `skyscatter.kernels.compiling` is imported when there is
something to compile or to load.  An entry whose machine code came with the installation (`skyscatter.kernels.ahead`)
never needs it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from skyscatter.kernels import ahead

_one_at_a_time = threading.RLock()


class Kernel:
    """A function that is compiled, with all kernels that it calls, when Python or a compiled function first calls it.

    To numba it is what numba makes of it.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func = function  #: the plain Python twin
        self.targetoptions = options  #: numba's, which its inliner asks for
        self.__name__, self.__qualname__, self.__doc__ = function.__name__, function.__qualname__, function.__doc__
        self.__module__, self.__wrapped__ = function.__module__, function
        self._compiled: Any = None

    @property
    def compiled(self) -> Any:
        """Numba's dispatcher."""
        if self._compiled is None:
            with _one_at_a_time:
                if self._compiled is None:
                    from skyscatter.kernels.compiling import dispatcher

                    self._compiled = dispatcher(self.py_func, self.targetoptions)
        return self._compiled

    @property
    def _numba_type_(self) -> Any:
        return self.compiled._numba_type_

    def __reduce__(self) -> Any:
        return type(self), (self.py_func, self.targetoptions)

    def __repr__(self) -> str:
        return f"<kernel {self.__module__}.{self.__qualname__}>"


class Entry(Kernel):
    """A kernel that Python calls: by machine code that is there for arguments of these kinds, or by the compiler's."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, options)
        self.name = f"{function.__module__}:{function.__qualname__}"
        self._call: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Call it; what it writes, it writes into arrays that are given."""
        if self._call is None:
            has_machine_code = not isinstance(ahead.machine(), str)
            self._call = ahead.Caller(self.name, self._compile_and_call) if has_machine_code else self.compiled
        return self._call(*arguments)

    def _compile_and_call(self, *arguments: Any) -> Any:
        return self.compiled(*arguments)


class Intrinsic:
    """A function whose code is written in LLVM's words, for kernels alone."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        self._type: Any = None

    @property
    def _numba_type_(self) -> Any:
        if self._type is None:
            from skyscatter.kernels.compiling import intrinsic_type

            self._type = intrinsic_type(self.function)
        return self._type


#: Of what only compiled functions call, and of what Python calls too.
_INNER = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_OUTER = {"_nrt": False, "no_cfunc_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile an inner loop; ``.py_func`` keeps the plain Python twin.

    It must not make arrays: Numba's reference counts are switched off, because counting the arrays of a `SceneTable`
    at every call costs more than the arithmetic.  Python cannot call it, not even through another kernel's
    ``.py_func``: the wrappers that would unpack a scene's tables take as long to compile as the function.
    """
    return Kernel(function, _INNER)


def inlined(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for small functions in the innermost loops.

    A table passed to a function that is not inlined is copied, number by number, at every call.
    """
    return Kernel(function, {**_INNER, "forceinline": True})


def summing(function: Callable[..., Any]) -> Any:
    """Like `inlined`, for a sum whose order does not matter, so that it can use vector registers."""
    return Kernel(function, {**_INNER, "forceinline": True, "fastmath": {"reassoc", "nsz", "contract"}})


def reduction(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for a long sum: its terms may be added in any order, and so several at a time."""
    return Kernel(function, {**_INNER, "fastmath": {"reassoc", "contract"}})


def merged(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for what is called from one place or is a line: its body is compiled there, and only there."""
    return Kernel(function, {**_INNER, "inline": "always"})


def entry(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python may call; it too must not make arrays."""
    return Entry(function, _OUTER)


def intrinsic(function: Callable[..., Any]) -> Any:
    """Mark what numba knows by the same name."""
    return Intrinsic(function)
