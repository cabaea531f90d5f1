"""One door for long work: `Engine.submit` takes a task, and whatever stands behind it runs the task.

Threads of this process, processes of this machine, any `concurrent.futures.Executor` (that of mpi4py, for instance) or
a client of dask.  Which one it is changes nothing in the numbers: tasks are pure, and whoever submits them puts the
results together in the order of their numbers.

What tasks share is packed once.  Processes of this machine read it from a file that is gone when the engine is; dask
carries it to each worker; through other executors a worker asks for it when it meets the first task that needs it.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.progress import remark
from skyscatter.tasks import worker
from skyscatter.tasks.task import Shared, Task
from skyscatter.workers import Workers, processors, steady_algebra

#: Times that a task is given to other workers when the one that had it has died.
MOST_TRIES = 3
#: Seconds between two looks at what goes on.
SLICE = 1.0


class Engine:
    """Runs tasks in threads of this process, and is what all engines look like.

    Parameters
    ----------
    workers : int
        Tasks that run at the same time.

    Examples
    --------
    >>> from skyscatter.tasks import Task, engine_for
    >>> with engine_for(2) as engine:  # two processes
    ...     [engine.submit(Task(pow, (2, n))).result() for n in range(4)]
    [1, 2, 4, 8]
    """

    #: Whether tasks share this process: what they change is seen here, and they may be asked to stop.
    local = True
    #: Tasks that wait at the door for each worker, so that none of them is idle.
    ahead = 2
    #: Tasks that go to a worker together.
    size = 1

    def __init__(self, workers: int) -> None:
        self.workers = workers
        #: Futures of the tasks that wait or run, while results are asked for.
        self.running: dict[Future[Any], Task] = {}
        self._pool: Executor = Workers(workers)
        self._steady = contextlib.ExitStack()
        self._steady.enter_context(steady_algebra())

    def submit(self, task: Task) -> Future[Any]:
        """Have a task run; its result or its error comes with the future."""
        return self._pool.submit(task.run)

    def begin(self, task: Task) -> Future[Any]:
        """As `submit`, where more tasks may follow before `flush` is called."""
        return self.submit(task)

    def flush(self) -> None:
        """No more tasks follow at this moment."""

    def results(
        self,
        tasks: Iterable[Task],
        tick: Callable[[], object] | None = None,
        kept: Callable[[Task, Future[Any]], object] | None = None,
        room: Callable[[], int] | None = None,
    ) -> Iterator[tuple[Task, Any]]:
        """Run many tasks, of which few wait at a time; results come as they are ready.

        Parameters
        ----------
        tasks : iterable of Task
            Taken as room for them comes, so that they may be made one by one.
        tick : callable, optional
            Called at least once a second, by who asks for the results.
        kept : callable, optional
            ``kept(task, future)`` is called by the thread that learns of the end of a task, which Ctrl-C never strikes.
        room : callable, optional
            How many more tasks may begin, where there is a reason to begin fewer.

        Yields
        ------
        task : Task
        result : object
        """
        waiting: dict[Future[Any], Task] = {}
        self.running = waiting
        source, more = iter(tasks), True
        try:
            while more or waiting:
                most = self.room if more else 0
                if waiting and most - len(waiting) < self.size:  # until there is room for as many as go together
                    most = 0
                while more and len(waiting) < most and (room is None or room() > 0 or not waiting):
                    task = next(source, None)
                    more = task is not None
                    if task is not None:
                        future = self.begin(task)
                        waiting[future] = task
                        if kept is not None:
                            future.add_done_callback(partial(kept, task))
                self.flush()
                finished, _ = wait(waiting, SLICE, return_when=FIRST)
                for future in finished:
                    yield waiting.pop(future), future.result()
                if tick is not None:
                    tick()
        finally:
            for future in tuple(waiting):
                future.cancel()

    @property
    def room(self) -> int:
        """Tasks that should be waiting or running."""
        return self.workers * (1 + self.ahead)

    def close(self, wait: bool = True) -> None:
        """End the workers that are its own; without `wait` they are left behind."""
        self._pool.shutdown(wait=wait, cancel_futures=not wait)
        self._steady.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(wait=kind is None or issubclass(kind, Exception))


class Elsewhere(Engine):
    """Runs tasks through an executor whose workers are other processes, here or on other machines.

    Parameters
    ----------
    executor : concurrent.futures.Executor
        Stays open when the engine is closed.
    """

    local = False
    #: That each worker may take [byte], where the engine caps it.
    memory: int | None = None

    def __init__(self, executor: Executor, workers: int | None = None) -> None:
        self.running = {}
        self.workers = workers or getattr(executor, "_max_workers", None) or processors()
        self._executor = executor
        #: Bytes of shared values that went with tasks.
        self.sent = 0

    def submit(self, task: Task) -> Future[Any]:
        """As `Engine.submit`; a worker that dies is replaced where the executor can do that."""
        answer: Future[Any] = Future()
        self._try(task, answer, MOST_TRIES, None)
        return answer

    def _try(self, task: Task, answer: Future[Any], tries: int, gift: Any) -> None:
        try:
            inner = self._send(task, gift)
        except BaseException as error:
            if not self._survive(error, task, answer, tries):
                answer.set_exception(explained(error, self.memory))
            return
        inner.add_done_callback(lambda done: self._answered(done, task, answer, tries))

    def _send(self, task: Task, gift: Any) -> Future[Any]:
        key = None if task.shared is None else task.shared.key
        if gift is None and task.shared is not None:
            gift = self._gift(task.shared)
        return self._executor.submit(worker.run, packed_call(task.call), task.arguments, key, gift)

    def _gift(self, shared: Shared) -> Any:
        """What goes with every task; None where workers keep what they once have, and ask."""
        return None

    def _answered(self, done: Future[Any], task: Task, answer: Future[Any], tries: int) -> None:
        """Called in a thread of the executor."""
        if answer.cancelled():
            answer.set_running_or_notify_cancel()
            return
        try:
            found = done.result()
        except BaseException as error:
            if not self._survive(error, task, answer, tries):
                answer.set_exception(explained(error, self.memory))
            return
        if isinstance(found, worker.Missing) and task.shared is not None:
            self.sent += len(task.shared.packed)
            self._try(task, answer, tries, task.shared.packed)
        elif answer.set_running_or_notify_cancel():
            answer.set_result(found)

    def _survive(self, error: BaseException, task: Task, answer: Future[Any], tries: int) -> bool:
        """Try once more after an error that was the worker's and not the task's; whether that was done."""
        return False

    def close(self, wait: bool = True) -> None:
        """Nothing: who made the executor ends it."""


def packed_call(call: Callable[..., Any]) -> Callable[..., Any]:
    """A function as it goes to other processes."""
    module, name = (getattr(call, attribute, "<") or "<" for attribute in ("__module__", "__qualname__"))
    if "<" not in name and module.partition(".")[0] in ("skyscatter", "builtins"):
        return call
    import cloudpickle

    return _Packed(cloudpickle.dumps(call))


class _Packed:
    """A function of a user's, packed by value where it has no place in a module: closures travel, too."""

    def __init__(self, packed: bytes) -> None:
        self.packed = packed
        self.call: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self.call is None:
            import pickle

            self.call = pickle.loads(self.packed)
        return self.call(*arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Packed, (self.packed,)


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


def explained(error: BaseException, memory: int | None = None) -> BaseException:
    """An error of workers as one line; those of the tasks themselves as they are."""
    if "un-serialize" in str(error) and not isinstance(error, MemoryError):
        return SkyscatterError("executor: a worker cannot read its task; let it call what is in a module it can import")
    dead = isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "CancelledError")
    if memory is not None and (dead or isinstance(error, MemoryError)):
        from skyscatter.solvers.memory import format_bytes

        what = "workers have ended, it seems for want of it" if dead else "is too little for a task"
        rule = f"{what}; give more, or fewer wavelengths or smaller windows"
        return DomainError("worker_memory", format_bytes(memory), rule)
    if dead:
        words = " ".join(str(error).split())[:200] or type(error).__name__
        return SkyscatterError(
            f"workers: one ended before its task did, {MOST_TRIES} times where it could be tried again ({words}); "
            "give them more memory, or take fewer"
        )
    return error


def state_memory(task: Task, most: int | None) -> int:
    """Say what memory a worker takes with a task [byte]; refuse it where that is more than it may take.

    Raises
    ------
    DomainError
    """
    from skyscatter.solvers.memory import IDLE_WORKER, format_bytes

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
    from skyscatter.solvers.memory import IDLE_WORKER, format_bytes

    if not sys.platform.startswith("linux"):
        rule = "only Linux caps the memory of a process; leave it out"
        raise DomainError("worker_memory", format_bytes(memory), rule)
    if memory < IDLE_WORKER:
        rule = f"a worker takes {format_bytes(IDLE_WORKER)} before its first task; give more"
        raise DomainError("worker_memory", format_bytes(memory), rule)


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
