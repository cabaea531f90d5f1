"""Tasks by executors whose workers are other processes, here or on other machines."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.memory import format_bytes
from skyscatter.tasks import worker
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.task import Shared, Task
from skyscatter.workers import processors

#: Times that a task is given to other workers when the one that had it has died.
MOST_TRIES = 3


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


def explained(error: BaseException, memory: int | None = None) -> BaseException:
    """An error of workers as one line; those of the tasks themselves as they are."""
    if "un-serialize" in str(error) and not isinstance(error, MemoryError):
        return SkyscatterError("executor: a worker cannot read its task; let it call what is in a module it can import")
    dead = isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "CancelledError")
    if memory is not None and (dead or isinstance(error, MemoryError)):
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
