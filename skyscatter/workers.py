"""Threads for compiled loops, which nothing can stop from outside: an interruption leaves them behind."""

from __future__ import annotations

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


@contextmanager
def steady_algebra() -> Iterator[None]:
    """The library of linear algebra uses one thread in the body: with several the last digits of its products differ.

    They would depend on the machine, and on whether threads or processes do the work.  Our own threads use the
    processors.  May be used as a decorator.
    """
    from threadpoolctl import threadpool_limits

    with _Algebra.lock:
        _Algebra.wanted += 1
        if _Algebra.wanted == 1:
            _Algebra.limit = threadpool_limits(1, "blas")
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
