"""Jobs that several programs share by a store: each task is claimed by one of them, and done once."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import Any

from skyscatter.tasks.engine import Engine
from skyscatter.tasks.store import Store
from skyscatter.tasks.task import Task

#: Seconds between two looks at what others work on.
LOOK = 0.5


class Sharing(ABC):
    """The tasks of a job between a store and an engine; what they are is for subclasses to say.

    Parameters
    ----------
    store : Store

    Attributes
    ----------
    failed : Exception or None
        What keeping a task has met.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.failed: Exception | None = None

    @abstractmethod
    def found(self, number: int) -> bool:
        """Whether a task is finished, by whomever; what is known of it is taken over."""

    @abstractmethod
    def begin(self, number: int) -> Task:
        """A task that is to be done."""

    @abstractmethod
    def keep(self, task: Task, result: Any) -> None:
        """Put a result into the store."""

    def results(
        self, numbers: Iterable[int], engine: Engine, tick: Callable[[], object] = lambda: None
    ) -> Iterator[tuple[Task, Any]]:
        """Do what nobody has done; the results of tasks that were done here come as they are ready.

        Parameters
        ----------
        numbers : iterable of int
            Of the tasks, in the order in which they are looked at.
        engine : Engine
        tick : callable, optional
            Called at least once a second.

        Raises
        ------
        Exception
            What keeping a task has met.
        """

        def looked() -> None:
            if self.failed is not None:
                raise self.failed
            tick()

        for task, result in engine.results(self._tasks(numbers, looked), looked, self._kept):
            looked()
            yield task, result
        looked()

    def _tasks(self, numbers: Iterable[int], tick: Callable[[], object]) -> Iterator[Task]:
        """The tasks that nobody has finished and nobody works on; at last those that somebody has left."""
        others: deque[int] = deque()
        for number in map(int, numbers):
            task = self._claimed(number)
            if task is not None:
                yield task
            elif not self.found(number):
                others.append(number)
        while others:
            for _ in range(len(others)):
                number = others.popleft()
                task = self._claimed(number)
                if task is not None:
                    yield task
                elif not self.found(number):
                    others.append(number)
            tick()
            if others:
                time.sleep(LOOK)

    def _claimed(self, number: int) -> Task | None:
        """A task to be done; None where it is finished, or somebody else's."""
        if self.found(number) or not self.store.claims.take(f"{number}"):
            return None
        if self.found(number):  # it may have been finished just before it was claimed
            self.store.claims.give_back(f"{number}")
            return None
        return self.begin(number)

    def _kept(self, task: Task, done: Future[Any]) -> None:
        """Keep what a worker has made; called where Ctrl-C does not strike."""
        try:
            if not done.cancelled() and done.exception() is None and self.failed is None:
                self.keep(task, done.result())
        except Exception as error:
            self.failed = error
        finally:
            self.store.claims.give_back(f"{task.number}")
