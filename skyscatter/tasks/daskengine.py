"""Tasks by dask: short ones go to workers in groups, for a message costs as long as many of them take.

A group is as many tasks as take a fifth of a second, by the times that workers tell: what it costs to hand it out is
little beside that, and so is what is lost with a worker.
"""

from __future__ import annotations

import threading
import time
from concurrent.futures import CancelledError, Future
from typing import Any

from skyscatter.tasks import worker
from skyscatter.tasks.elsewhere import MOST_TRIES, Elsewhere, explained, packed_call
from skyscatter.tasks.engine import SLICE
from skyscatter.tasks.task import Shared, Task

#: Seconds that a group should take, and tasks in it at most.
GROUP, MOST = 0.2, 64


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
        self._group: list[tuple[Task, Future[Any]]] = []

    @property
    def room(self) -> int:
        """Tasks that should be waiting or running; workers come and go."""
        now = time.monotonic()
        if now - self._asked > SLICE:  # asking the scheduler takes milliseconds
            self._asked = now
            known = self._client.scheduler_info(n_workers=-1)["workers"].values()
            self.workers = max(sum(info["nthreads"] for info in known), 1)
        # Of groups fewer wait: two for each worker are as long as their messages, ten times over.
        return max(super().room, self.workers * (1 + 2) * self.size)

    def begin(self, task: Task) -> Future[Any]:
        """Have a task run, with the others that come before the next `flush`."""
        if self._group and _key(self._group[0][0]) != _key(task):
            self.flush()
        answer: Future[Any] = Future()
        self._group.append((task, answer))
        if len(self._group) >= self.size:
            self.flush()
        return answer

    def flush(self) -> None:
        """Send the group off."""
        group, self._group = self._group, []
        if group:
            self._start(group, MOST_TRIES)

    def _start(self, group: list[tuple[Task, Future[Any]]], tries: int) -> None:
        """Have a group run."""
        shared = group[0][0].shared
        calls = [(packed_call(task.call), task.arguments) for task, _ in group]
        try:
            gift = None if shared is None else self._gift(shared)
            inner = self._executor.submit(worker.run_group, calls, _key(group[0][0]), gift)
        except BaseException as error:
            self._failed(group, error, tries)
            return
        inner.add_done_callback(lambda done: self._ended(done, group, tries))

    def _ended(self, done: Future[Any], group: list[tuple[Task, Future[Any]]], tries: int) -> None:
        """Hand the results of a group out; called in a thread of dask's."""
        try:
            seconds, found = done.result()
        except BaseException as error:
            self._failed(group, error, tries)
            return
        self.size = int(min(max(GROUP / max(seconds, 1e-9), 1), MOST))
        for (_, answer), value in zip(group, found, strict=True):
            if not answer.set_running_or_notify_cancel():
                continue
            if isinstance(value, worker.Failed):
                answer.set_exception(explained(value.error))
            else:
                answer.set_result(value)

    def _failed(self, group: list[tuple[Task, Future[Any]]], error: BaseException, tries: int) -> None:
        """Try the tasks of a group once more, each by itself, or end them."""
        again = tries > 1 and (isinstance(error, CancelledError) or type(error).__name__ == "KilledWorker")
        for task, answer in group:
            if answer.cancelled():
                answer.set_running_or_notify_cancel()
            elif again:
                self._start([(task, answer)], tries - 1)
            else:
                answer.set_exception(explained(error))

    def _gift(self, shared: Shared) -> Any:
        with self._lock:
            gift = self._scattered.get(shared.key)
            if gift is None or gift.status in ("cancelled", "lost", "error"):
                self.sent += len(shared.packed)
                gift = self._client.scatter(shared.packed, hash=True, broadcast=True)
                self._scattered[shared.key] = gift
        return gift

    def submit(self, task: Task) -> Future[Any]:
        """As `Engine.submit`, by itself."""
        answer: Future[Any] = Future()
        self._start([(task, answer)], MOST_TRIES)
        return answer


def _key(task: Task) -> str | None:
    return None if task.shared is None else task.shared.key
