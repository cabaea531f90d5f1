"""Workers by what a command was told: processes of this machine, or those of a dask scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.tasks.door import engine_for

#: Seconds in which a scheduler has to answer.
PATIENCE = 20


@contextmanager
def executor_of(workers: int | None = None, scheduler: str | None = None, memory: int | None = None) -> Iterator[Any]:
    """What `executor` shall be; the connection to a scheduler ends with the body.

    Parameters
    ----------
    workers : int, optional
        Processes of this machine.
    scheduler : str, optional
        Address of a dask scheduler, or the file in which it wrote that.
    memory : int, optional
        That each of the processes may take [byte].

    Yields
    ------
    None, int, skyscatter.tasks.Engine or distributed.Client

    Raises
    ------
    SkyscatterError
        If dask is not installed, or nobody answers.
    """
    if memory is not None:
        with engine_for(workers, memory=memory) as engine:
            yield engine
        return
    if scheduler is None:
        yield workers
        return
    client = _connected(scheduler)
    try:
        yield client
    finally:
        client.close()


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise SkyscatterError("scheduler: dask.distributed is not installed: pip install dask distributed") from None
    where = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
    try:
        client: Any = Client(timeout=PATIENCE, **where)
    except (OSError, ValueError, TypeError) as error:
        rule = f"no dask scheduler answers there within {PATIENCE} s; start one with: dask scheduler"
        raise DomainError("scheduler", address, rule) from error
    return client
