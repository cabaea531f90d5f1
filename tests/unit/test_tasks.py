"""Tasks give the same results wherever they run, survive the death of workers, and get what they share once."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cloudpickle
import pytest

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.tasks import Engine, Shared, Task, engine_for
from skyscatter.tasks.door import opened
from skyscatter.tasks.elsewhere import Elsewhere
from skyscatter.tasks.processes import Processes
from skyscatter.tasks.task import key_of

# Workers do not find the modules of tests.
cloudpickle.register_pickle_by_value(sys.modules[__name__])


def add(shared: list[int], number: int) -> int:
    return sum(shared) + number


def tasks(shared: Shared, count: int = 20) -> list[Task]:
    return [Task(add, (k,), shared, k) for k in range(count)]


def results(engine: Engine, made: list[Task]) -> list[Any]:
    found = {task.number: result for task, result in engine.results(made)}
    return [found[k] for k in range(len(made))]


def test_threads_and_processes_agree() -> None:
    shared = Shared([1, 2, 3])
    wanted = [6 + k for k in range(20)]
    with engine_for(threads=3) as engine:
        assert results(engine, tasks(shared)) == wanted
    with engine_for(2) as engine:
        assert results(engine, tasks(shared)) == wanted
        assert engine.sent == len(shared.packed), "what tasks share is written once, for all workers"  # type: ignore[attr-defined]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool, engine_for(pool) as engine:
        assert results(engine, tasks(shared)) == wanted
        # A worker that has it keeps it.  What one asks for may reach the other, which has it: how often is chance.
        assert engine.sent < len(shared.packed) * len(wanted)  # type: ignore[attr-defined]


def test_what_is_done_is_handed_out_before_an_error() -> None:
    """Of many that end together, one with an error."""

    class AtOnce(Engine):
        def submit(self, task: Task) -> Future[Any]:
            answer: Future[Any] = Future()
            if task.number == 2:
                answer.set_exception(ValueError("task 2"))
            else:
                answer.set_result(task.number)
            return answer

    with AtOnce(8) as engine:
        results = engine.results(Task(pow, (1, 1), None, k) for k in range(5))
        assert sorted(next(results)[1] for _ in range(4)) == [0, 1, 3, 4]
        with pytest.raises(ValueError, match="task 2"):
            next(results)


def test_another_executor_is_asked_once_by_each_worker() -> None:
    """One worker, one task at a time: it lacks what is shared once, and once more for what is shared next."""

    class Counting(Executor):
        def __init__(self, pool: Executor) -> None:
            self.pool, self.gifts = pool, 0

        def submit(self, call: Any, /, *arguments: Any, **more: Any) -> Future[Any]:
            self.gifts += arguments[-1] is not None
            return self.pool.submit(call, *arguments, **more)

    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        counting = Counting(pool)
        engine = Elsewhere(counting, 1)
        for shared in (Shared([1]), Shared([2])):
            for task in tasks(shared, 5):
                assert engine.submit(task).result() == sum(shared.value) + task.number
        assert counting.gifts == 2


def test_closures_travel() -> None:
    factor = 3
    with engine_for(1) as engine:
        assert engine.submit(Task(lambda n: factor * n, (5,))).result() == 15


def fail(number: int) -> int:
    raise ValueError(f"task {number}")


def test_errors_of_tasks_arrive_as_they_are() -> None:
    for executor in (None, 1):
        with engine_for(executor) as engine, pytest.raises(ValueError, match="task 4"):
            engine.submit(Task(fail, (4,))).result()


def die_once(folder: str, number: int) -> int:
    """The first that comes by ends its process."""
    mark = Path(folder, "dead")
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return number
    os.kill(os.getpid(), signal.SIGKILL)
    return -1


def test_a_worker_that_is_killed_is_replaced(tmp_path: Path) -> None:
    with engine_for(2) as engine:
        made = [Task(die_once, (str(tmp_path), k), None, k) for k in range(12)]
        assert results(engine, made) == list(range(12))


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_tasks_that_kill_every_worker_are_given_up() -> None:
    with engine_for(1) as engine, pytest.raises(SkyscatterError, match="more memory, or take fewer"):
        engine.submit(Task(die, (1,))).result()


def test_few_tasks_wait_at_a_time() -> None:
    done, lock, most = [0], threading.Lock(), [0]

    def source() -> Any:
        for k in range(50):
            with lock:  # a thread may stand still for as long as it likes
                most[0] = max(most[0], k + 1 - done[0])
            yield Task(work, (k,), None, k)

    def work(number: int) -> int:
        with lock:
            done[0] += 1
        return number

    with engine_for(threads=2) as engine:
        assert sorted(result for _, result in engine.results(source())) == list(range(50))
        assert most[0] <= engine.room + 1


def test_an_engine_stays_open_for_its_owner() -> None:
    with Processes(1) as engine:
        with opened(engine) as same:
            assert same is engine
        assert engine.submit(Task(pow, (2, 3))).result() == 8


@pytest.mark.parametrize("executor", [0, True, "two", object()])
def test_what_is_no_executor_is_refused(executor: Any) -> None:
    with pytest.raises(DomainError, match="executor"):
        engine_for(executor)


def test_keys_tell_recipes_apart() -> None:
    assert key_of({"a": 1, "b": [1, 2]}) == key_of({"b": (1, 2), "a": 1})
    assert key_of({"a": 1}) != key_of({"a": 2})


def test_cost_of_a_task() -> None:
    """Below 2 ms in a process, as measured over many; the benchmark has the number of a quiet machine."""
    with engine_for(1) as engine:
        engine.submit(Task(pow, (1, 1))).result()
        began = time.perf_counter()
        assert len(list(engine.results(Task(pow, (2, 1), None, k) for k in range(300)))) == 300
        assert (time.perf_counter() - began) / 300 < 0.02  # ten times that: other programs may be running


class StandIn:
    """What the engine asks of a client of dask, with threads behind it; some groups end as if their worker had died."""

    def __init__(self, deaths: int = 0) -> None:
        self.pool, self.groups, self.deaths = ThreadPoolExecutor(2), [0], deaths

    def scheduler_info(self, n_workers: int) -> Any:
        return {"workers": {k: {"nthreads": 1} for k in "ab"}}

    def scatter(self, value: Any, **_: Any) -> Any:
        raise AssertionError("nothing is shared here")

    def get_executor(self, pure: bool) -> Any:
        return self

    def submit(self, call: Any, calls: Any, key: Any, gift: Any) -> Future[Any]:
        self.groups.append(len(calls))
        if self.deaths:
            self.deaths -= 1
            dead: Future[Any] = Future()
            dead.set_exception(CancelledError("its worker has died"))
            return dead
        return self.pool.submit(call, calls, key, gift)


def test_short_tasks_go_to_dask_in_groups() -> None:
    client = StandIn()
    with engine_for(client) as engine:
        assert results(engine, [Task(abs, (-k,), None, k) for k in range(600)]) == list(range(600))
    assert sum(client.groups) == 600
    # The first ones go alone, two workers with 16 ahead each; then 64 at a time.
    assert len(client.groups) < 2 * 17 + 600 / 64 + 10


def test_long_tasks_go_to_dask_alone() -> None:
    client = StandIn()
    with engine_for(client) as engine:
        list(engine.results(Task(time.sleep, (0.21,), None, k) for k in range(4)))
        assert engine.size == 1
    assert max(client.groups) == 1


def test_an_error_in_a_group_is_that_of_its_task() -> None:
    with engine_for(StandIn()) as engine:
        engine.size = 3
        futures = [engine.begin(Task(call, (k,))) for k, call in ((1, abs), (4, fail), (-2, abs))]
        assert futures[0].result() == 1
        with pytest.raises(ValueError, match="task 4"):
            futures[1].result()
        assert futures[2].result() == 2


@pytest.mark.parametrize(("deaths", "survives"), [(1, True), (99, False)])
def test_groups_of_workers_that_die_are_tried_again(deaths: int, survives: bool) -> None:
    client = StandIn(deaths)
    with engine_for(client) as engine:
        engine.size = 2
        futures = [engine.begin(Task(abs, (-k,))) for k in (1, 2)]
        if survives:
            assert [future.result() for future in futures] == [1, 2]
            assert client.groups[1:] == [2, 1, 1], "each by itself: one of them may have killed it"
        else:
            with pytest.raises(SkyscatterError, match="3 times"):
                futures[0].result()
