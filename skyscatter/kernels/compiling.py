"""What numba makes of a kernel, kept on disk under a stamp of all sources that it is made of."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event
from numba.core.registry import cpu_target
from numba.core.sigutils import normalize_signature
from numba.extending import intrinsic

from skyscatter.kernels import crew, tables  # noqa: F401  (tables: what numba has to know of those in memory)
from skyscatter.kernels.pipeline import OnceOptimised
from skyscatter.kernels.readonly import read_only
from skyscatter.kernels.signals import postponed
from skyscatter.kernels.stamps import PACKAGE, source_stamp


def dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Numba's dispatcher of a function, with these options of numba's."""
    compiled = njit(nogil=True, error_model="numpy", pipeline_class=OnceOptimised, **options)(function)
    file = Path(function.__code__.co_filename)
    stamp = source_stamp(file) if file.is_file() else ""  # of what was typed in there is no file
    try:
        compiled.enable_caching()
        # The index of the cache compares this stamp and starts over when it differs.
        compiled._cache._cache_file._source_stamp = stamp
        unkept = ""
    except RuntimeError:  # no folder that numba knows of may be written to
        unkept = "no folder may be written to"
    others = read_only(function, stamp) if stamp else []
    load, save = compiled._cache.load_overload, compiled._cache.save_overload

    is_entry = not options.get("no_cpython_wrapper")
    name = f"{function.__module__}:{function.__qualname__}"

    def look_up(signature: Any, context: Any) -> Any:
        with postponed():
            found = load(signature, context)
            for other in others if found is None else ():
                found = found or other.load_overload(signature, context)
        return found

    def load_or_be_helped(signature: Any, context: Any) -> Any:
        found = look_up(signature, context)
        if found is None and is_entry:
            with event.trigger_event("numba:compile"):  # as far as those go who listen
                ready = crew.helped(name, normalize_signature(signature)[0])
            if ready:
                return look_up(signature, context)
        return found

    def save_if_possible(signature: Any, data: Any) -> None:
        reason = unkept
        try:
            save(signature, data)
        except OSError as error:  # such as a full disk
            reason = error.strerror or str(error)
        if reason:
            _say_uncached(reason)
        if is_entry:
            crew.finished(name, normalize_signature(signature)[0])

    compiled._cache.load_overload, compiled._cache.save_overload = load_or_be_helped, save_if_possible
    return compiled


@cache
def _say_uncached(reason: str) -> None:
    """Say once why every run will compile anew."""
    remedy = "every run compiles for up to a minute; name a folder for them in NUMBA_CACHE_DIR"
    logging.getLogger(PACKAGE).warning("compiled kernels cannot be kept (%s): %s", reason, remedy)


def intrinsic_type(function: Callable[..., Any]) -> Any:
    """Numba's type of an intrinsic."""
    known = intrinsic(function)
    context = cpu_target.typing_context
    context.refresh()
    return context.resolve_value_type(known)
