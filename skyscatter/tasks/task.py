"""A task: a function of its own arguments and of what it shares with others, and a name that tells it from all else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any


def key_of(recipe: Mapping[str, Any]) -> str:
    """The name of a piece of work: a hash of all that its result depends on.

    Parameters
    ----------
    recipe : mapping
        Whatever JSON can say.

    Examples
    --------
    >>> from skyscatter.tasks.task import key_of
    >>> key_of({"seed": 1, "size": [4, 2]}) == key_of({"size": (4, 2), "seed": 1})
    True
    """
    text = json.dumps(recipe, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


class Shared:
    """What all tasks of a job need, such as a solved field: it goes to a worker once, and is kept there.

    Parameters
    ----------
    value : object
        Must not be changed by any task.

    Examples
    --------
    >>> from skyscatter.tasks import Shared
    >>> Shared([1, 2]).value
    [1, 2]
    """

    def __init__(self, value: Any) -> None:
        self.value = value

    @cached_property
    def packed(self) -> bytes:
        """The value as other processes get it."""
        import cloudpickle

        packed: bytes = cloudpickle.dumps(self.value)
        return packed

    @cached_property
    def key(self) -> str:
        """The name under which a worker keeps it."""
        return hashlib.sha256(self.packed).hexdigest()


@dataclass(frozen=True)
class Task:
    """A call that may run anywhere and any number of times, with the same result.

    Attributes
    ----------
    call : callable
        ``call(*arguments)``, or ``call(shared, *arguments)``.
    arguments : tuple
    shared : Shared, optional
        What goes before the arguments.
    number : int
        Tells the tasks of a job apart.
    memory : int
        That it takes beside what it shares [byte], about; 0 where that is not worth a word.

    Examples
    --------
    >>> from skyscatter.tasks import Shared, Task
    >>> task = Task(pow, (3,), Shared(2))
    >>> task.run()
    8
    """

    call: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    shared: Shared | None = field(default=None)
    number: int = 0
    memory: int = 0

    def run(self) -> Any:
        """Run it here."""
        return self.call(*(() if self.shared is None else (self.shared.value,)), *self.arguments)
