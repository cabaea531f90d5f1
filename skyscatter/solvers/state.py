"""What a run has done so far, and how it is kept to go on later."""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.solvers.base import Answer, Array

#: Seconds between two times at which a run is kept.
EVERY = 180.0


@dataclass
class RenderState:
    """Finished rays of a render, and the recipe that they belong to."""

    recipe: dict[str, Any]
    done: NDArray[np.bool_]  #: (ray,)
    radiance: Array  #: (ray, wavelength), zero where not done
    standard_error: Array
    samples: NDArray[np.int64]
    layers: dict[str, Array] = field(default_factory=dict)
    sums: dict[str, Array] = field(default_factory=dict)  #: over passes, of solvers that work in passes
    passes: int = 0  #: in those sums
    total: int = 0  #: passes that were to be made; 0 where rays are solved one by one
    #: What all rays share, of solvers that have such: arrays of named parts, ``part.array``.
    shared: dict[str, Array] = field(default_factory=dict)

    @classmethod
    def empty(cls, recipe: dict[str, Any], rays: int, wavelengths: int) -> RenderState:
        """A state in which nothing is done."""
        zero = np.zeros((rays, wavelengths))
        return cls(recipe, np.zeros(rays, bool), zero, zero.copy(), np.zeros(rays, np.int64))

    @property
    def share(self) -> float:
        """Finished share of the work, 0 to 1."""
        if self.total:
            return self.passes / self.total
        return float(self.done.mean()) if self.done.size else 0.0

    def has(self, rays: slice) -> bool:
        """Whether some rays are finished."""
        return bool(self.done[rays].all())

    def put(self, rays: slice, answer: Answer) -> None:
        """Keep the answer for some rays."""
        self.radiance[rays], self.standard_error[rays] = answer.radiance, answer.standard_error
        self.samples[rays] = answer.samples
        for name, values in answer.layers.items():
            self.layers.setdefault(name, np.zeros_like(self.radiance))[rays] = values
        self.done[rays] = True

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the state to an .npz file, whole or not at all."""
        more: dict[str, Any] = {f"layer_{name}": values for name, values in self.layers.items()}
        more |= {f"sum_{name}": values for name, values in self.sums.items()}
        more |= {f"shared_{name}": values for name, values in self.shared.items()}
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez(
                file, recipe=np.array(json.dumps(self.recipe, sort_keys=True)), done=self.done, radiance=self.radiance,
                standard_error=self.standard_error, samples=self.samples, passes=np.array(self.passes),
                total=np.array(self.total), **more,
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | os.PathLike[str], recipe: dict[str, Any]) -> RenderState:
        """Read a state back and check that it belongs to `recipe`."""
        if not Path(path).is_file():
            raise MissingDataError(path, "no such checkpoint; check the path or start anew without it")
        try:
            with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                content = {name: file[name] for name in file.files}
            found = json.loads(str(content["recipe"]))
            layers, sums, shared = (
                {name.removeprefix(kind): v for name, v in content.items() if name.startswith(kind)}
                for kind in ("layer_", "sum_", "shared_")
            )
            state = cls(
                found, content["done"], content["radiance"], content["standard_error"], content["samples"], layers,
                sums, int(content["passes"]), int(content["total"]), shared,
            )  # fmt: skip
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise SkyscatterError(f"{path}: not a checkpoint of an interrupted run; start anew without it") from error
        for name in sorted(set(found) | set(recipe)):
            if found.get(name) != json.loads(json.dumps(recipe.get(name))):
                raise DomainError("resume", str(path), f"was begun with other {name}; repeat the command as it was")
        state.recipe = recipe
        return state


class Checkpoint:
    """The file in which a run is kept while it goes on, so that little is lost however it ends.

    Parameters
    ----------
    path : path-like
    every : float
        Seconds between two times at which it is written.

    Attributes
    ----------
    state : RenderState or None
        Of the run that it belongs to; None before that has begun.
    written : bool
        Whether the file is one of this run.
    """

    def __init__(self, path: str | os.PathLike[str], every: float = EVERY) -> None:
        if not every > 0:
            raise DomainError("checkpoint_every", every, "a time above 0 [s]")
        self.path, self.every = Path(path), float(every)
        self.state: RenderState | None = None
        self.written = False
        #: Held by whoever changes the state, and while it is written.
        self.lock = threading.RLock()
        self._last = time.monotonic()
        self._share = 0.0
        self._news = False

    def begin(self, state: RenderState) -> None:
        """Belong to a run from now on."""
        self.state, self._share, self._last = state, state.share, time.monotonic()

    def due_in(self) -> float:
        """Seconds until it is to be written."""
        return max(self._last + self.every - time.monotonic(), 0.0)

    def tick(self) -> None:
        """Write it if it is time to; a disk that is full does not end the run."""
        if self.due_in() == 0.0:
            self.save()

    def save(self) -> bool:
        """Write what is finished; whether the file holds it.  Nothing is written where there is nothing new."""
        with self.lock:
            self._last = time.monotonic()
            if self.state is None or (self.state.share <= 0.0 and not self.state.shared):
                return False
            if self.state.share <= self._share and not self._news and self.path.is_file():
                return True
            try:
                self.state.save(self.path)
            except SkyscatterError as error:
                logging.getLogger("skyscatter").warning("the finished part could not be kept: %s", error)
                return False
            self._share, self._news, self.written = self.state.share, False, True
            return True

    def part(self, name: str) -> dict[str, Array]:
        """Arrays of a part of what all rays share, as far as it had come; empty where it had not been begun."""
        shared = {} if self.state is None else self.state.shared
        return {key.removeprefix(f"{name}."): a for key, a in shared.items() if key.startswith(f"{name}.")}

    def put(self, name: str, arrays: Mapping[str, Array]) -> None:
        """Keep such a part, in place of what it was before; the arrays must not be changed any more."""
        if self.state is None:
            return
        with self.lock:
            others = {key: a for key, a in self.state.shared.items() if not key.startswith(f"{name}.")}
            self.state.shared = others | {f"{name}.{key}": a for key, a in arrays.items()}
            self._news = True
        self.tick()

    def remove(self) -> None:
        """Take the file away: the run has come to its end."""
        with suppress(FileNotFoundError):
            self.path.unlink()


def checkpoint_of(given: Checkpoint | str | os.PathLike[str] | None) -> Checkpoint | None:
    """A checkpoint from what was given: one, or the path of one."""
    return given if given is None or isinstance(given, Checkpoint) else Checkpoint(given)
