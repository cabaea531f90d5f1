"""Which engine runs tasks: by what a user has given."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from skyscatter.errors import DomainError
from skyscatter.tasks.elsewhere import Elsewhere
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.processes import Processes
from skyscatter.workers import processors


def engine_for(executor: Any = None, threads: int | None = None, memory: int | None = None) -> Engine:
    """The engine for what a user has given.

    Parameters
    ----------
    executor : None, int, concurrent.futures.Executor or distributed.Client
        Threads of this process, so many processes of this machine, an executor, or a client of dask.
    threads : int, optional
        Of this process; all processors when not given.
    memory : int, optional
        That each process may take [byte], where `executor` is a number of them.

    Returns
    -------
    Engine
        Use it with ``with``.

    Raises
    ------
    DomainError
        For anything else, and for a cap on the memory of what is no process of this engine's.

    Examples
    --------
    >>> from skyscatter.tasks import engine_for
    >>> with engine_for(threads=3) as engine:
    ...     engine.workers, engine.local
    (3, True)
    """
    if memory is not None and (not isinstance(executor, int) or isinstance(executor, bool)):
        raise DomainError("worker_memory", memory, "is for a number of processes; others have limits of their own")
    if executor is None:
        return Engine(processors() if threads is None else threads)
    if isinstance(executor, int) and not isinstance(executor, bool):
        if executor < 1:
            raise DomainError("executor", executor, "a number of processes is at least 1")
        return Processes(executor, memory)
    if hasattr(executor, "scheduler_info") and hasattr(executor, "scatter"):
        from skyscatter.tasks.daskengine import Dask

        return Dask(executor)
    if hasattr(executor, "submit"):
        return Elsewhere(executor)
    rule = "give None, a number of processes, an executor as of concurrent.futures, or a client of dask"
    raise DomainError("executor", executor, rule)


@contextlib.contextmanager
def opened(executor: Any = None, threads: int | None = None) -> Iterator[Engine]:
    """The same, ended with the body; an engine that was given stays open, for its owner's next work."""
    if isinstance(executor, Engine):
        yield executor
        return
    with engine_for(executor, threads) as engine:
        yield engine
