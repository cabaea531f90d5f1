"""Threads for compiled loops, which nothing can stop from outside: an interruption leaves them behind."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from types import TracebackType

#: Seconds for which running work is waited for after Ctrl-C, before it is left behind.
GRACE = 2.0


class Workers(ThreadPoolExecutor):
    """A pool of threads whose end waits for them, but not after Ctrl-C."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        wanted = kind is None or issubclass(kind, Exception)
        self.shutdown(wait=wanted, cancel_futures=not wanted)
