"""Tasks by processes of this machine, whose memory is stated and may be capped."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import threading
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from typing import Any

from skyscatter.errors import DomainError
from skyscatter.memory import IDLE_WORKER, format_bytes
from skyscatter.progress import remark
from skyscatter.tasks import worker
from skyscatter.tasks.elsewhere import Elsewhere
from skyscatter.tasks.task import Shared, Task


class Processes(Elsewhere):
    """Processes of this machine; those that die are replaced, and their tasks run again.

    Parameters
    ----------
    workers : int
    memory : int, optional
        That each may take [byte]; a task that needs more ends with an error.

    Raises
    ------
    DomainError
        Where the system does not cap the memory of a process.
    """

    def __init__(self, workers: int, memory: int | None = None) -> None:
        if memory is not None:
            check_cap(memory)
        self._lock = threading.Lock()
        self._folder = tempfile.TemporaryDirectory(prefix="skyscatter-")
        super().__init__(_processes(workers, memory), workers)
        self.memory = memory
        self._stated: set[str | None] = set()

    def submit(self, task: Task) -> Future[Any]:
        """As `Engine.submit`; before the first task of a job it is said what a worker takes, and whether that is there.

        Raises
        ------
        DomainError
            Where it is more than a worker may take.
        """
        key = None if task.shared is None else task.shared.key
        if key not in self._stated:
            self._stated.add(key)
            state_memory(task, self.memory)
        return super().submit(task)

    def _gift(self, shared: Shared) -> Any:
        path = Path(self._folder.name, shared.key)
        with self._lock:
            if not path.exists():
                path.write_bytes(shared.packed)
                self.sent += len(shared.packed)
        return worker.InFile(str(path))

    def _send(self, task: Task, gift: Any) -> Future[Any]:
        with self._lock:
            executor = self._executor
        if broken(executor):
            executor = self._renewed(executor)
        return super()._send(task, gift)

    def _renewed(self, executor: Executor) -> Executor:
        with self._lock:
            if self._executor is executor:
                self._executor = _processes(self.workers, self.memory)
                executor.shutdown(wait=False)
            return self._executor

    def _survive(self, error: BaseException, task: Task, answer: Future[Any], tries: int) -> bool:
        if not isinstance(error, BrokenExecutor) or tries <= 1 or "un-serialize" in str(error):
            return False
        self._try(task, answer, tries - 1, None)  # which renews what is broken
        return True

    def close(self, wait: bool = True) -> None:
        """End the processes."""
        kwargs: dict[str, Any] = {"kill_workers": not wait}
        self._executor.shutdown(wait=wait, **kwargs)
        with contextlib.suppress(OSError):
            self._folder.cleanup()


def _processes(workers: int, memory: int | None) -> Executor:
    # Unlike those of the standard library they need no guard in the script that begins them.
    from loky import ProcessPoolExecutor

    pool: Executor = ProcessPoolExecutor(workers, timeout=None, initializer=worker.settle, initargs=(memory,))
    return pool


def broken(executor: Any) -> bool:
    """Whether a pool of processes has lost one, and takes no tasks any more."""
    return getattr(executor, "_flags", None) is not None and executor._flags.broken is not None


def state_memory(task: Task, most: int | None) -> int:
    """Say what memory a worker takes with a task [byte]; refuse it where that is more than it may take.

    Raises
    ------
    DomainError
    """
    # What is shared is unpacked from a file, so that for a moment it is there twice.
    shared = 0 if task.shared is None else 2 * len(task.shared.packed)
    needed = IDLE_WORKER + shared + task.memory
    if most is not None and needed > most:
        rule = f"a worker takes some {format_bytes(needed)} here; give more, or fewer wavelengths or smaller windows"
        raise DomainError("worker_memory", format_bytes(most), rule)
    remark(f"some {format_bytes(needed)} of memory for each worker")
    return needed


def check_cap(memory: int) -> None:
    """Refuse to cap the memory of workers where that cannot be done, or below what they take when idle.

    Raises
    ------
    DomainError
    """
    if not sys.platform.startswith("linux"):
        rule = "only Linux caps the memory of a process; leave it out"
        raise DomainError("worker_memory", format_bytes(memory), rule)
    if memory < IDLE_WORKER:
        rule = f"a worker takes {format_bytes(IDLE_WORKER)} before its first task; give more"
        raise DomainError("worker_memory", format_bytes(memory), rule)
