"""Solvers that work in passes: each pass is an estimate for all rays at once, and the answer is their mean.

Light that is traced from the lamps arrives at all pixels together, so rays cannot be solved one by one.  A module that
works in this way sets ``PASSES = True`` and offers

- ``passes(asked)``: how many passes to make at most;
- ``solve_pass(context, rays, number, asked)``: an `Answer` from pass `number` alone; its standard error is not read.

Passes have their own random streams and their own sums, and workers take one after the other.  What is kept are sums
over passes, added in the order of their numbers: the same digits come whatever the threads, and a checkpoint goes on
where it stopped.  Workers that are ahead wait, so that no more than twice as many answers as workers are in memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skyscatter.memory import tile_bytes
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.state import Checkpoint, RenderState
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.task import Shared, Task
from skyscatter.workers import GRACE

if TYPE_CHECKING:
    from skyscatter.solvers.stored import StoredPasses

#: With ``noise``, the answer is looked at after this many passes and whenever their number has doubled.
FIRST_LOOK = 16
#: Layers whose standard error is wanted beside that of the radiance.
_POLARISED = ("Q", "U", "V")


def add_pass(state: RenderState, answer: Answer) -> None:
    """Add the answer of the next pass to the sums of a state."""
    for name, values in {"radiance": answer.radiance, **answer.layers}.items():
        _add(state.sums, name, values)
        if name == "radiance" or name in _POLARISED:
            _add(state.sums, f"{name}_square", values**2)
    state.passes += 1


def _add(sums: dict[str, Array], name: str, values: Array) -> None:
    if name in sums:
        sums[name] += values
    else:
        sums[name] = values.copy()


def sum_up(state: RenderState) -> None:
    """Means and standard errors from the sums of at least two passes, into the state's answer."""
    n = state.passes
    if n < 2:
        return

    def error_of(name: str) -> Array:
        mean = state.sums[name] / n
        error: Array = np.sqrt(np.maximum(state.sums[f"{name}_square"] / n - mean**2, 0.0) / (n - 1))
        return error

    state.radiance, state.standard_error = state.sums["radiance"] / n, error_of("radiance")
    for name, values in state.sums.items():
        if name != "radiance" and not name.endswith("_square"):
            state.layers[name] = values / n
            if name in _POLARISED:
                state.layers[f"{name}_error"] = error_of(name)
    state.samples[:] = n
    state.done[:] = True


def worst_noise(state: RenderState) -> float:
    """Standard error relative to the radiance, averaged over the wavelengths, of the ray where it is greatest."""
    mean, error = state.radiance.mean(axis=1), state.standard_error.mean(axis=1)
    lit = mean > 0
    return float((error[lit] / mean[lit]).max()) if lit.any() else 0.0


def solve_passes(
    module: Any,
    context: Any,
    rays: Rays,
    asked: Asked[Any],
    state: RenderState,
    engine: Engine,
    progress: Callable[[float], None] | None,
    checkpoint: Checkpoint | StoredPasses | None = None,
) -> bool:
    """Make the passes that `state` lacks; False if interrupted, with all passes before the first unfinished one."""
    series = _Series(module, context, rays, asked, state, checkpoint.lock if checkpoint else threading.RLock())
    tell = progress or (lambda share: None)
    if state.passes:
        tell(series.share)

    def tick() -> None:
        tell(series.share)
        if checkpoint is not None:
            checkpoint.tick()

    def kept(task: Task, done: Future[Any]) -> None:
        if not engine.local and not done.cancelled() and done.exception() is None:
            series.keep(task.number, done.result())

    try:
        for _ in engine.results(series.tasks(engine.local), tick, kept, lambda: series.room(engine.workers)):
            if series.share >= 1.0:
                break
        series.stop.set()
        if engine.local:
            wait(engine.running)
        tell(series.share)
        complete = True
    except KeyboardInterrupt:
        series.stop.set()
        wait(engine.running, GRACE)
        complete = False
    except BaseException:
        series.stop.set()
        raise
    with series.lock:
        series.closed = True
        sum_up(state)
    return complete


class Passing(NamedTuple):
    """What passes share."""

    module: Any
    context: Any
    rays: Rays
    asked: Asked[Any]


def make_pass(passing: Passing, number: int) -> Answer:
    """A pass in a process that knows nothing else."""
    answer: Answer = passing.module.solve_pass(passing.context, passing.rays, number, passing.asked)
    return answer


class _Series:
    """Passes that threads make, and their sums.

    Threads add them up themselves: Ctrl-C strikes the main thread only, and so never half-way through a sum.
    """

    def __init__(
        self, module: Any, context: Any, rays: Rays, asked: Asked[Any], state: RenderState, lock: threading.RLock
    ) -> None:
        self.module, self.context, self.rays, self.asked, self.state = module, context, rays, asked, state
        self.total = state.total = module.passes(asked)
        self.following = state.passes
        self.held: dict[int, Answer] = {}
        self.stop, self.closed, self.lock = threading.Event(), False, lock
        self.share = _share(state, asked, self.total) if state.passes else 0.0

    def room(self, workers: int) -> int:
        """Passes that may be at work: those that are ahead of the sums wait in memory."""
        return max(2 * workers - (self.following - self.state.passes), 0)

    def tasks(self, local: bool) -> Iterator[Task]:
        """The passes that come next, as far as there are any."""
        shared = None if local else Shared(Passing(self.module, self.context, self.rays, self.asked))
        while self.following < self.total and self.share < 1.0:
            number = self.following
            self.following += 1
            memory = tile_bytes(len(self.rays.origins), self.state.radiance.shape[1], self.asked.layers)
            yield Task(self.work if shared is None else make_pass, (number,), shared, number, memory)

    def work(self, number: int) -> None:
        """Make a pass, and keep it."""
        if not self.stop.is_set():
            self.keep(number, self.module.solve_pass(self.context, self.rays, number, self.asked))

    def keep(self, number: int, answer: Answer) -> None:
        """Add up the passes that come next, of which this may be one."""
        with self.lock:
            self.held[number] = answer
            while self.state.passes in self.held and self.share < 1.0 and not self.closed:
                add_pass(self.state, self.held.pop(self.state.passes))
                self.share = max(self.share, _share(self.state, self.asked, self.total))


def _share(state: RenderState, asked: Asked[Any], total: int) -> float:
    """Share of the work that is done, 1 if the passes so far will do; the noise counts after fixed numbers of them."""
    share, n = state.passes / total, state.passes
    if asked.how.noise is not None:
        if n < FIRST_LOOK or n & (n - 1):
            return 0.0
        sum_up(state)
        noise = worst_noise(state)
        share = 1.0 if noise < asked.how.noise or n >= total else min((asked.how.noise / noise) ** 2, 0.99)
    return share
