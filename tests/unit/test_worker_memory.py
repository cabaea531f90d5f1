"""Memory of workers: stated before the first task, capped where that is asked for, and told in one line."""

from __future__ import annotations

import sys
from typing import Any

import cloudpickle
import numpy as np
import pytest

from skyscatter.cli.main import main
from skyscatter.cli.parse import parse_bytes
from skyscatter.errors import DomainError
from skyscatter.memory import IDLE_WORKER
from skyscatter.tasks import Shared, Task, engine_for
from skyscatter.tasks.processes import state_memory

# Workers do not find the modules of tests.
cloudpickle.register_pickle_by_value(sys.modules[__name__])
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is capped on Linux")


@linux
def test_a_task_that_does_not_fit_is_told_and_the_next_one_runs() -> None:
    with engine_for(1, memory=IDLE_WORKER + 50_000_000) as engine:
        assert engine.submit(Task(np.ones, (1000,))).result().sum() == 1000
        with pytest.raises(DomainError, match=r"worker_memory = '370 MB': is too little for a task"):
            engine.submit(Task(np.ones, (100_000_000,))).result()
        assert engine.submit(Task(pow, (2, 3))).result() == 8


@linux
def test_what_is_known_not_to_fit_is_not_begun() -> None:
    with engine_for(1, memory=IDLE_WORKER + 10_000_000) as engine:
        with pytest.raises(DomainError, match="a worker takes some 520 MB here"):
            engine.submit(Task(pow, (2, 3), None, 0, 200_000_000))
        assert not engine._executor._processes  # type: ignore[attr-defined]


def test_what_is_shared_counts() -> None:
    shared = Shared(np.zeros(1_000_000))
    plain = state_memory(Task(pow, (2, 3)), None)
    assert state_memory(Task(pow, (), shared), None) == pytest.approx(plain + 16e6, rel=1e-4)  # and some labels


@linux
@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["--workers", "2", "--worker-memory", "100MB"], "worker_memory = '100 MB': a worker takes 320 MB"),
        (["--worker-memory", "1GB"], "worker_memory = '1GB': caps the --workers"),
        (["--workers", "2", "--worker-memory", "1 potato"], "worker_memory = '1 potato': give a number with its unit"),
    ],
)
def test_the_command_refuses(words: list[str], name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sky", "earth-simple", *words, "--json"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"skyscatter: error: {name}")
    assert error.count("\n") == 1


@pytest.mark.parametrize("executor", [None, True])
def test_others_are_not_capped(executor: Any) -> None:
    with pytest.raises(DomainError, match="worker_memory"):
        engine_for(executor, memory=10**9)


@pytest.mark.parametrize(("text", "count"), [("1GB", 10**9), ("1.5 GiB", 3 * 2**29), ("500mb", 5 * 10**8)])
def test_bytes(text: str, count: int) -> None:
    assert parse_bytes(text, "worker_memory") == count
