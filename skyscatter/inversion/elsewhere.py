"""The forward model of a fit by an engine: tasks are states, or parts of the data under one Sun each.

Every task gives the numbers that it would give here; they are put together in the order of the data and of the states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.inversion.observations import Linearisation, Prediction
from skyscatter.tasks.task import Shared, Task

if TYPE_CHECKING:
    from skyscatter.inversion.forward import Forward

Array = NDArray[np.float64]


def plain(forward: Forward) -> Forward:
    """The model as it goes to a worker, where it has one thread unless a number was given."""
    run = forward.run
    return replace(forward, tick=None, engine=None, run=replace(run, threads=run.threads or 1))


def predict_part(forward: Forward, place: tuple[int, int], z: Array) -> Prediction:
    """A part of the data at a state."""
    _, part = forward.observations[place[0]].parts()[place[1]]
    return part.predict(forward.subject_at(z), forward.run)


def linearise_part(
    forward: Forward, place: tuple[int, int], z: Array, steps: Array, active: Sequence[bool]
) -> Linearisation:
    """A part of the data and its derivatives at a state."""
    _, part = forward.observations[place[0]].parts()[place[1]]
    return part.linearise(forward.subject_at, z, steps, active, forward.run)


def predict_state(forward: Forward, z: Array) -> Prediction:
    """All data at a state."""
    return forward.predict(z)


def by_parts(forward: Forward, call: Callable[..., Any], *arguments: Any) -> list[Any]:
    """What ``call(forward, place, *arguments)`` gives for each observation, its parts joined."""
    engine = forward.engine
    assert engine is not None
    parts = [[rows for rows, _ in observation.parts()] for observation in forward.observations]
    places = [(k, n) for k, observed in enumerate(parts) for n in range(len(observed))]
    shared = Shared(plain(forward))
    tasks = (Task(call, (place, *arguments), shared, number) for number, place in enumerate(places))
    found = {places[task.number]: result for task, result in engine.results(tasks)}
    return [_joined([(rows, found[k, n]) for n, rows in enumerate(observed)]) for k, observed in enumerate(parts)]


def by_states(forward: Forward, states: Array) -> Iterator[Prediction]:
    """All data at each state, in the order of the states."""
    engine = forward.engine
    assert engine is not None
    shared = Shared(plain(forward))
    tasks = (Task(predict_state, (z,), shared, number) for number, z in enumerate(states))
    held: dict[int, Prediction] = {}
    following = 0
    for task, result in engine.results(tasks):
        held[task.number] = result
        while following in held:
            yield held.pop(following)
            following += 1


def _joined(found: Sequence[tuple[NDArray[np.int64], Any]]) -> Any:
    """Parts of an observation as a whole, each array by the rows of its data."""
    if len(found) == 1:
        return found[0][1]
    kind, size = type(found[0][1]), sum(rows.size for rows, _ in found)
    arrays = []
    for field in range(len(found[0][1])):
        whole = np.empty((size, *found[0][1][field].shape[1:]))
        for rows, part in found:
            whole[rows] = part[field]
        arrays.append(whole)
    return kind(*arrays)
