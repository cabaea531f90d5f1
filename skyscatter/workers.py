"""Threads for compiled loops, which nothing can stop from outside: an interruption leaves them behind."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from skyscatter.kernels.processors import processors

#: Seconds for which running work is waited for after Ctrl-C, before it is left behind.
GRACE = 2.0


class Workers(ThreadPoolExecutor):
    """A pool of threads whose end waits for them, but not after Ctrl-C."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        wanted = kind is None or issubclass(kind, Exception)
        self.shutdown(wait=wanted, cancel_futures=not wanted)


class _Algebra:
    """How many want the library of linear algebra to use one thread at this moment."""

    lock = threading.Lock()
    wanted = 0
    limit: Any = None
    #: The libraries that are loaded, which takes a millisecond to find out; and whether scipy's was among them then.
    libraries: Any = None
    with_scipy = False


def _libraries() -> Any:
    """What loaded libraries of linear algebra are told through."""
    with_scipy = "scipy.linalg" in sys.modules
    if _Algebra.libraries is None or with_scipy != _Algebra.with_scipy:
        from threadpoolctl import ThreadpoolController

        _Algebra.libraries, _Algebra.with_scipy = ThreadpoolController(), with_scipy
    return _Algebra.libraries


@contextmanager
def steady_algebra() -> Iterator[None]:
    """The library of linear algebra uses one thread in the body: with several the last digits of its products differ.

    They would depend on the machine, and on whether threads or processes do the work.  Our own threads use the
    processors.  May be used as a decorator.
    """
    with _Algebra.lock:
        _Algebra.wanted += 1
        if _Algebra.wanted == 1:
            _Algebra.limit = _libraries().limit(limits=1, user_api="blas")
    try:
        yield
    finally:
        with _Algebra.lock:
            _Algebra.wanted -= 1
            if _Algebra.wanted == 0:
                _Algebra.limit.restore_original_limits()


def in_parts(work: Callable[[slice], object], count: int, part: int) -> None:
    """Do compiled work on `count` items, at most `part` at a time, on all processors.

    Each item is done alike whatever the parts, so that the numbers do not depend on the processors.
    """
    parts = [slice(start, min(start + part, count)) for start in range(0, count, part)]
    if len(parts) < 2:
        for some in parts:
            work(some)
        return
    with Workers(min(processors(), len(parts))) as pool:
        for done in [pool.submit(work, some) for some in parts]:
            done.result()
