"""One door for long work: `Engine.submit` takes a task, and whatever stands behind it runs the task.

Threads of this process, processes of this machine, any `concurrent.futures.Executor` (that of mpi4py, for instance) or
a client of dask.  Which one it is changes nothing in the numbers: tasks are pure, and whoever submits them puts the
results together in the order of their numbers.

What tasks share is packed once.  Processes of this machine read it from a file that is gone when the engine is; dask
carries it to each worker; through other executors a worker asks for it when it meets the first task that needs it.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from skyscatter.errors import DomainError, SkyscatterError
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
                while more and len(waiting) < most and (room is None or room() > 0 or not waiting):
                    task = next(source, None)
                    more = task is not None
                    if task is not None:
                        future = self.submit(task)
                        waiting[future] = task
                        if kept is not None:
                            future.add_done_callback(partial(kept, task))
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
                answer.set_exception(explained(error))
            return
        inner.add_done_callback(lambda done: self._answered(done, task, answer, tries))

    def _send(self, task: Task, gift: Any) -> Future[Any]:
        key = None if task.shared is None else task.shared.key
        if gift is None and task.shared is not None:
            gift = self._gift(task.shared)
        return self._executor.submit(worker.run, _Packed.of(task.call), task.arguments, key, gift)

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
                answer.set_exception(explained(error))
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


class _Packed:
    """A function of a user's, packed by value where it has no place in a module: closures travel, too."""

    def __init__(self, packed: bytes) -> None:
        self.packed = packed
        self.call: Callable[..., Any] | None = None

    @classmethod
    def of(cls, call: Callable[..., Any]) -> Callable[..., Any]:
        module, name = (getattr(call, attribute, "<") or "<" for attribute in ("__module__", "__qualname__"))
        if "<" not in name and module.partition(".")[0] in ("skyscatter", "builtins"):
            return call
        import cloudpickle

        return cls(cloudpickle.dumps(call))

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
    """

    def __init__(self, workers: int) -> None:
        self._lock = threading.Lock()
        self._folder = tempfile.TemporaryDirectory(prefix="skyscatter-")
        super().__init__(_processes(workers), workers)

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
                self._executor = _processes(self.workers)
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


def _processes(workers: int) -> Executor:
    # Unlike those of the standard library they need no guard in the script that begins them.
    from loky import ProcessPoolExecutor

    pool: Executor = ProcessPoolExecutor(workers, timeout=None, initializer=_settle)
    return pool


def _settle() -> None:
    """In a new process: Ctrl-C is the business of the one that began it."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)


def broken(executor: Any) -> bool:
    """Whether a pool of processes has lost one, and takes no tasks any more."""
    return getattr(executor, "_flags", None) is not None and executor._flags.broken is not None


class Dask(Elsewhere):
    """Workers of dask; the scheduler replaces those that die, and carries what tasks share to each of them once.

    Parameters
    ----------
    client : distributed.Client
        Stays open when the engine is closed.
    """

    #: Messages go in batches, some tens of milliseconds from door to door.
    ahead = 16

    def __init__(self, client: Any) -> None:
        workers = sum(info["nthreads"] for info in client.scheduler_info(n_workers=-1)["workers"].values())
        super().__init__(client.get_executor(pure=False), max(workers, 1))
        self._client, self._asked = client, time.monotonic()
        self._lock = threading.Lock()
        self._scattered: dict[str, Any] = {}

    @property
    def room(self) -> int:
        """Tasks that should be waiting or running; workers come and go."""
        now = time.monotonic()
        if now - self._asked > SLICE:  # asking the scheduler takes milliseconds
            self._asked = now
            known = self._client.scheduler_info(n_workers=-1)["workers"].values()
            self.workers = max(sum(info["nthreads"] for info in known), 1)
        return super().room

    def _gift(self, shared: Shared) -> Any:
        with self._lock:
            gift = self._scattered.get(shared.key)
            if gift is None or gift.status in ("cancelled", "lost", "error"):
                self.sent += len(shared.packed)
                gift = self._client.scatter(shared.packed, hash=True, broadcast=True)
                self._scattered[shared.key] = gift
        return gift

    def _survive(self, error: BaseException, task: Task, answer: Future[Any], tries: int) -> bool:
        if tries <= 1 or not (isinstance(error, CancelledError) or type(error).__name__ == "KilledWorker"):
            return False
        self._try(task, answer, tries - 1, None)
        return True


def explained(error: BaseException) -> BaseException:
    """An error of workers as one line; those of the tasks themselves as they are."""
    if "un-serialize" in str(error):
        return SkyscatterError("executor: a worker cannot read its task; let it call what is in a module it can import")
    if isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "CancelledError"):
        words = " ".join(str(error).split())[:200] or type(error).__name__
        return SkyscatterError(
            f"workers: one ended before its task did, {MOST_TRIES} times where it could be tried again ({words}); "
            "give them more memory, or take fewer"
        )
    return error


def engine_for(executor: Any = None, threads: int | None = None) -> Engine:
    """The engine for what a user has given.

    Parameters
    ----------
    executor : None, int, concurrent.futures.Executor or distributed.Client
        Threads of this process, so many processes of this machine, an executor, or a client of dask.
    threads : int, optional
        Of this process; all processors when not given.

    Returns
    -------
    Engine
        Use it with ``with``.

    Raises
    ------
    DomainError
        For anything else.

    Examples
    --------
    >>> from skyscatter.tasks import engine_for
    >>> with engine_for(threads=3) as engine:
    ...     engine.workers, engine.local
    (3, True)
    """
    if executor is None:
        return Engine(processors() if threads is None else threads)
    if isinstance(executor, int) and not isinstance(executor, bool):
        if executor < 1:
            raise DomainError("executor", executor, "a number of processes is at least 1")
        return Processes(executor)
    if hasattr(executor, "scheduler_info") and hasattr(executor, "scatter"):
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
