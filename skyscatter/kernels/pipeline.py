"""What LLVM does for a kernel, once: as a part of the entries that it is called from.

Numba optimises every function together with all that it calls, and turns that into machine code, at each step from the
innermost loop up to what Python calls.  Of all that work only the last step's is ever run: what lies beneath an entry
is in its module as well, where it is inlined and optimised again.  So kernels that Python cannot call are kept as they
were lowered, and an entry is optimised once instead of twice (Numba's first pass serves reference counts, of which
there are none).  Half of the time of compiling goes, the machine code of the entries keeps its bits.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes

from skyscatter.kernels.signals import postponed

#: How the names of the globals begin that Numba looks up by address in a library.
ENVIRONMENT = "_ZN08NumbaEnv"


class _Entry(JITCodeLibrary):
    """Of a function that Python calls."""

    def _finalize_final_module(self) -> None:
        with postponed():
            super()._finalize_final_module()

    def _optimize_final_module(self) -> None:
        made = self._codegen._module_pass_manager()
        manager, *builder = made if isinstance(made, tuple) else (made,)
        manager.run(self._final_module, *builder)


class _Part(_Entry):
    """Of a function that only compiled functions call: code to be linked, and none to be run."""

    _final_module: Any

    def _optimize_final_module(self) -> None:
        """Left to the entries."""

    def _finalize_final_module(self) -> None:
        whole = self._final_module
        self._finalized = True  # as far as being linked goes
        self._get_module_for_linking()
        self._finalized = False
        self._final_module = _globals_only(whole)
        super()._finalize_final_module()


def _globals_only(whole: Any) -> Any:
    """A module that defines what Numba sets by address in another, and nothing else."""
    lines = [f'target triple = "{whole.triple}"', f'target datalayout = "{whole.data_layout}"']
    names = (variable.name for variable in whole.global_variables)
    lines += [f'@"{name}" = common global i64 0' for name in names if name.startswith(ENVIRONMENT)]
    module = llvm.parse_assembly("\n".join(lines))
    module.name = whole.name
    return module


@register_pass(mutates_CFG=False, analysis_only=True)
class _ChooseLibrary(LoweringPass):
    """Makes the library that the next passes would otherwise make for themselves."""

    _name = "choose_library"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        kind = _Part if state.flags.no_cpython_wrapper else _Entry
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


class _QuickFlags(Flags):
    """Numba's flags, its key at every call that it resolves: compared by what is set, and not one by one."""

    __slots__ = ()
    _HASH = hash(tuple(sorted(Flags.options)))

    def __hash__(self) -> int:
        return self._HASH

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _QuickFlags):
            return bool(super().__eq__(other))
        mine, theirs = self._values, other._values
        if mine == theirs:
            return True
        defaults = {name: self.options[name].default for name in mine.keys() ^ theirs.keys()}
        return bool({**defaults, **mine} == {**defaults, **theirs})


@contextmanager
def _no_collection() -> Iterator[None]:
    """Python's search for cyclic garbage, which finds none worth its time among the compiler's many objects, rests."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


class OnceOptimised(CompilerBase):
    """How all kernels are compiled."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = _QuickFlags(self.state.flags)

    def compile_extra(self, function: Any) -> Any:
        """Compile a function, and with it all that it calls."""
        with _no_collection():
            return super().compile_extra(function)

    def define_pipelines(self) -> list[Any]:
        """Numba's passes, and before the last of them the choice of a library."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_ChooseLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]
