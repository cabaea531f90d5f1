"""Solvers that work in passes: each pass is an estimate for all rays at once, and the answer is their mean.

Light that is traced from the lamps arrives at all pixels together, so rays cannot be solved one by one.  A module that
works in this way sets ``PASSES = True`` and offers

- ``passes(options)``: how many passes to make at most;
- ``solve_pass(context, rays, number, options)``: an `Answer` from pass `number` alone; its standard error is not read.

Passes have their own random streams and their own sums, and threads take one after the other.  What is kept are sums
over passes, added in the order of their numbers: the same digits come whatever the threads, and a checkpoint goes on
where it stopped.  Threads that are ahead wait, so that no more than twice as many answers as threads are in memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from skyscatter.solvers.base import Answer, Array, Options, Rays
from skyscatter.solvers.state import RenderState

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
    options: Options,
    state: RenderState,
    workers: int,
    progress: Callable[[float], None] | None,
) -> bool:
    """Make the passes that `state` lacks; False if interrupted, with all passes before the first unfinished one."""
    total = module.passes(options)
    stop = threading.Event()
    held: dict[int, Answer] = {}
    jobs: dict[Future[Answer | None], int] = {}

    def work(number: int) -> Answer | None:
        return None if stop.is_set() else module.solve_pass(context, rays, number, options)

    def take(finished: set[Future[Answer | None]]) -> bool:
        """Add what has come in, in order; True when it is enough."""
        for job in finished:
            number, answer = jobs.pop(job), job.result()
            if answer is not None:
                held[number] = answer
        while state.passes in held:
            add_pass(state, held.pop(state.passes))
            if _enough(state, options, total, progress):
                return True
        return False

    state.total = total
    enough = _enough(state, options, total, progress) if state.passes else False
    following = state.passes
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            while not enough:
                while following < min(total, state.passes + 2 * workers):
                    jobs[pool.submit(work, following)] = following
                    following += 1
                enough = take(wait(jobs, return_when=FIRST_COMPLETED).done)
            stop.set()
            complete = True
        except KeyboardInterrupt:
            stop.set()
            take(wait(jobs).done)
            complete = False
        except BaseException:
            stop.set()
            raise
    sum_up(state)
    return complete


def _enough(state: RenderState, options: Options, total: int, progress: Callable[[float], None] | None) -> bool:
    """Whether the passes so far will do; looks at the noise only after fixed numbers of them."""
    share, n = state.passes / total, state.passes
    if options.noise is not None:
        if n < FIRST_LOOK or n & (n - 1):
            return False
        sum_up(state)
        noise = worst_noise(state)
        share = 1.0 if noise < options.noise or n >= total else min((options.noise / noise) ** 2, 0.99)
    if progress is not None:
        progress(min(share, 1.0))
    return share >= 1.0
