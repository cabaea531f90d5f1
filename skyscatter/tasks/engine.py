"""One door for long work: `Engine.submit` takes a task, and whatever stands behind it runs the task.

Threads of this process, processes of this machine, any `concurrent.futures.Executor` (that of mpi4py, for instance) or
a client of dask.  Which one it is changes nothing in the numbers: tasks are pure, and whoever submits them puts the
results together in the order of their numbers.

What tasks share is packed once.  Processes of this machine read it from a file that is gone when the engine is; dask
carries it to each worker; through other executors a worker asks for it when it meets the first task that needs it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import Executor, Future, wait
from functools import partial
from types import TracebackType
from typing import Any, Self

from skyscatter.tasks.task import Task
from skyscatter.workers import Workers, steady_algebra

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
                for future in sorted(finished, key=_failed):  # what is done is handed out before an error ends this
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


def _failed(future: Future[Any]) -> bool:
    return future.cancelled() or future.exception() is not None
