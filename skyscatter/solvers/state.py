"""What a run has done so far, and how it is kept to go on later."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.solvers.base import Answer, Array
from skyscatter.tasks.store import Store, discard, read_attributes

#: Seconds between two times at which a run is kept.
EVERY = 180.0
#: Rays that it keeps together.
BLOCK = 8192


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
    sort: str = "field"  #: of scene; of a field that has no rays when not given

    @classmethod
    def empty(cls, recipe: dict[str, Any], rays: int, wavelengths: int) -> RenderState:
        """A state in which nothing is done."""
        # Not one array and its copy: pages of zeros take no time before something is put there.
        radiance, error = np.zeros((rays, wavelengths)), np.zeros((rays, wavelengths))
        return cls(recipe, np.zeros(rays, bool), radiance, error, np.zeros(rays, np.int64))

    @property
    def share(self) -> float:
        """Finished share of the work, 0 to 1."""
        if self.total:
            return self.passes / self.total
        return float(np.count_nonzero(self.done)) / self.done.size if self.done.size else 0.0

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
        """Keep the state in a folder, from which a run with the same recipe goes on."""
        checkpoint = Checkpoint(path)
        checkpoint.begin(self)
        checkpoint.write()

    def take(self, store: Store, tiles: list[slice] | None = None, rays: slice | None = None) -> None:
        """Take over what a store has.

        Parameters
        ----------
        store : skyscatter.tasks.store.Store
        tiles : list of slice, optional
            Rays of its tasks; those of a checkpoint when not given.
        rays : slice, optional
            Which of them this state is of; all when not given.
        """
        rays = slice(0, len(self.done)) if rays is None else rays
        for number, tile in enumerate(blocks(rays.stop) if tiles is None else tiles):
            first, last = max(tile.start, rays.start), min(tile.stop, rays.stop)
            found = store.get(number, tile.stop - tile.start) if first < last else None
            if found is not None:
                part, here = slice(first - tile.start, last - tile.start), slice(first - rays.start, last - rays.start)
                values = {name: array[part] for name, array in found[1].items()}
                self.put(here, answer_of(values))
                if "done" in values:
                    self.done[here] = values["done"][:, 0] > 0

    def take_passes(self, store: Store) -> None:
        """Take over the sums over passes that a store has, where there are more than here."""
        for slot in (0, 1):
            found = store.get(slot, len(self.done))
            if found is not None and found[0] > self.passes:
                self.sums = {name: np.ascontiguousarray(values) for name, values in found[1].items()}
                self.passes = found[0]

    def put_passes(self, store: Store) -> None:
        """Keep the sums over passes, in two chunks by turns."""
        store.put(self.passes % 2, self.passes, self.sums, 2, len(self.done))

    def put_blocks(self, store: Store, kept: NDArray[np.int64]) -> None:
        """Keep the blocks of rays of which more is finished than of each was `kept`, which is told how much it is."""
        numbers = blocks(len(self.done))
        for number, block in enumerate(numbers):
            finished = int(self.done[block].sum())
            if finished > kept[number]:
                values = {
                    "done": self.done[block, None].astype(float), "radiance": self.radiance[block],
                    "standard_error": self.standard_error[block], "samples": self.samples[block, None].astype(float),
                }  # fmt: skip
                values |= {f"layer_{name}": layer[block] for name, layer in self.layers.items()}
                store.put(number, finished, values, len(numbers), min(BLOCK, len(self.done)))
                kept[number] = finished


def blocks(rays: int) -> list[slice]:
    """The parts in which a checkpoint keeps so many rays."""
    return [slice(k, min(k + BLOCK, rays)) for k in range(0, rays, BLOCK)]


def answer_of(values: Mapping[str, Array]) -> Answer:
    """The answer of rays as a store keeps it."""
    layers = {name[6:]: array for name, array in values.items() if name.startswith("layer_")}
    return Answer(values["radiance"], values["standard_error"], layers, values["samples"][:, 0].astype(np.int64))


def is_checkpoint(path: str | os.PathLike[str]) -> bool:
    """Whether a folder is that of an interrupted run."""
    try:
        return "block" in read_attributes(path)
    except DomainError:
        return False


def _left(path: str | os.PathLike[str], recipe: Mapping[str, Any]) -> Store:
    """The folder of an interrupted run of a recipe."""
    if not os.path.exists(path):
        raise MissingDataError(path, "no such checkpoint; check the path or start anew without it")
    if not is_checkpoint(path):
        raise DomainError("resume", str(path), "not a checkpoint of an interrupted run; start anew without it")
    return Store(path, recipe, option="resume", patience=0.0, hurried=True)


class Checkpoint:
    """The folder in which a run is kept while it goes on, so that little is lost however it ends.

    It is a store whose tasks are blocks of rays, finished or not, or the sums over passes.  What all rays share, such
    as a solved field, is kept in parts with names.

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
        Whether the folder is one of this run.
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
        self._store: Store | None = None
        self._source: Store | None = None  #: of parts that have not been asked for
        self._parts: dict[str, Mapping[str, Array]] = {}
        self._news: set[str] = set()
        self._kept = np.zeros(0, np.int64)
        self._passes = 0

    @classmethod
    def of(cls, store: Store) -> Checkpoint:
        """Keep the parts of a run in a store that it has anyway."""
        checkpoint = cls(store.path)
        checkpoint._store = checkpoint._source = store
        checkpoint.state = RenderState.empty(store.attributes["recipe"], 0, 0)
        return checkpoint

    def begin(self, state: RenderState, resume: str | os.PathLike[str] | None = None) -> None:
        """Belong to a run from now on, and take over into its state what is in the folder `resume`.

        Raises
        ------
        DomainError
            For a folder of another run, and a path at which something else is.
        """
        if self.path.exists() and not is_checkpoint(self.path):
            rule = "is no checkpoint; move it away, or choose another name"
            raise DomainError("checkpoint", str(self.path), rule)
        self.state, self._last = state, time.monotonic()
        self._kept = np.zeros(len(blocks(len(state.done))), np.int64)
        if resume is None:
            return
        self._source = _left(resume, state.recipe)
        if "samples" in self._source.columns():
            state.take(self._source)
        else:
            state.take_passes(self._source)
        if os.path.realpath(resume) == os.path.realpath(self.path):
            self._store, self._passes = self._source, state.passes
            self._kept[:] = [state.done[block].sum() for block in blocks(len(state.done))]
        else:
            for name in self._source.parts():
                self.part(name)
            self._news = set(self._parts)

    def due_in(self) -> float:
        """Seconds until it is to be written."""
        return max(self._last + self.every - time.monotonic(), 0.0)

    def tick(self) -> None:
        """Write it if it is time to; a disk that is full does not end the run."""
        if self.due_in() == 0.0:
            self.save()

    def save(self) -> bool:
        """Write what is finished; whether the folder holds it.  Nothing is written where there is nothing new."""
        with self.lock:
            self._last = time.monotonic()
            if self.state is None or (self.state.share <= 0.0 and not self._parts and self._source is None):
                return False
            try:
                self.write()
            except SkyscatterError as error:
                logging.getLogger("skyscatter").warning("the finished part could not be kept: %s", error)
                return False
            self.written = True
            return True

    def write(self) -> None:
        """Write what is new.

        Raises
        ------
        SkyscatterError
            If it cannot be written.
        """
        state = self.state
        if state is None:
            return
        store = self._opened(state)
        for name in sorted(self._news):
            store.keep(name, self._parts[name])
            self._news.discard(name)
        if not state.passes:
            state.put_blocks(store, self._kept)
        elif state.passes > self._passes:
            state.put_passes(store)
            self._passes = state.passes

    def _opened(self, state: RenderState) -> Store:
        """The folder, made anew where it is that of an earlier run."""
        if self._store is None or not self.path.is_dir():
            discard(self.path)
            about = {"sort": state.sort, "block": BLOCK}
            self._store = Store(self.path, state.recipe, (), about, patience=0.0, hurried=True)
            self._news, self._passes = set(self._parts), 0
            self._kept[:] = 0
        return self._store

    def part(self, name: str) -> dict[str, Array]:
        """Arrays of a part of what all rays share, as far as it had come; empty where it had not been begun."""
        if name not in self._parts and self._source is not None:
            found = self._source.kept(name)
            if found:
                self._parts[name] = found
        return dict(self._parts.get(name, {}))

    def put(self, name: str, arrays: Mapping[str, Array]) -> None:
        """Keep such a part, in place of what it was before; the arrays must not be changed any more."""
        if self.state is None:
            return
        with self.lock:
            self._parts[name] = dict(arrays)
            self._news.add(name)
        self.tick()

    def remove(self) -> None:
        """Take the folder away: the run has come to its end."""
        discard(self.path)


def checkpoint_of(given: Checkpoint | str | os.PathLike[str] | None) -> Checkpoint | None:
    """A checkpoint from what was given: one, or the path of one."""
    return given if given is None or isinstance(given, Checkpoint) else Checkpoint(given)
