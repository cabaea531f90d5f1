"""Renders that keep every finished part in a store, from which any number of programs go on, today or tomorrow.

A task is a tile of the picture: rays that are solved by themselves.  Of solvers that walk, the sums over the walks are
kept too, so that more of them can be added later, to the same digits as if all had been made at once.  Solvers that
work in passes keep the sums over their passes, in two chunks by turns.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.memory import tile_bytes
from skyscatter.progress import say
from skyscatter.solvers.base import Answer, Array, Asked, Rays, Walks
from skyscatter.solvers.passes import sum_up
from skyscatter.solvers.state import Checkpoint, RenderState, answer_of, blocks, is_checkpoint
from skyscatter.solvers.tiles import tiles_of
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.sharing import LOOK, Sharing
from skyscatter.tasks.store import Store, read_attributes
from skyscatter.tasks.task import Shared, Task
from skyscatter.workers import GRACE

if TYPE_CHECKING:
    from skyscatter.solvers.run import Solving

#: Fewest walks whose sums can be gone on with: a batch has one of each sixteen.
FEWEST = 16
#: Ways to find vertices that have no sums to go on with.
SUMLESS = ("free-flight", "delta")
#: Sorts of stores that hold a picture: those of scenes.
PICTURES = ("shells", "space", "surfaces")
#: Share of the time of passes that may be spent on keeping them.
KEEPING = 0.1


def open_store(path: Any, recipe: dict[str, Any], sort: str) -> Store:
    """The store of a render; samples may grow where sums over them are kept.

    Raises
    ------
    DomainError
        For a folder of another render, and for one of an interrupted run.
    """
    if is_checkpoint(path):
        raise DomainError("store", str(path), "holds an interrupted run; go on with --resume, or choose another folder")
    options = recipe["options"]
    plain = "noise" in options or options.get("sampling") in SUMLESS or options.get("samples", FEWEST) < FEWEST
    walks = recipe["solver"] == "path" and "subpixels" not in recipe and not plain
    return Store(path, recipe, ("samples",) if walks or recipe["solver"] == "photons" else (), {"sort": sort})


def keeps_sums(module: Any, asked: Asked[Any]) -> bool:
    """Whether walks are kept as sums, to which more can be added: not where their number is up to the noise."""
    if not hasattr(module, "no_walks") or asked.how.noise is not None or asked.how.sampling in SUMLESS:
        return False
    from skyscatter.solvers.path import walks_for

    return walks_for(asked) >= FEWEST


def stored_context(
    store: Store, prepare: Callable[..., Any], keeps: bool, progress: Callable[[float], None] | None
) -> Any:
    """What all rays share; where that is kept too, one program solves it and the others wait and read it."""
    if not keeps:
        return prepare()
    ready = store.beside / "solution.ready"
    waits = False
    while not ready.is_file() and not store.claims.take("solution"):
        if not waits and progress is not None:
            say("another program solves what the rays share")
        waits = True
        time.sleep(LOOK)
    try:
        checkpoint = Checkpoint.of(store)
        try:
            context = prepare(checkpoint=checkpoint)
        finally:
            if not ready.is_file():
                checkpoint.save()
        ready.touch()
    finally:
        store.claims.give_back("solution")
    return context


def solve_more(solving: Solving, rays: Rays, before: Walks | None) -> tuple[Answer, Walks | None]:
    """The rays of a tile, with walks that were made before."""
    module, context, asked = solving
    if not keeps_sums(module, asked):
        return module.solve(context, rays, asked), None
    walks = before or module.no_walks(context, len(rays.origins), asked)
    return module.solve(context, rays, asked, walks), walks


class StoredTiles(Sharing):
    """Tiles of a picture between a store and an engine."""

    def __init__(self, solving: Solving, rays: Any, tiles: list[slice], state: Any, store: Store) -> None:
        super().__init__(store)
        self.solving, self.rays, self.tiles, self.state = solving, rays, tiles, state
        self.most = max((tile.stop - tile.start for tile in tiles), default=0)
        self.goal = amount_of(solving.module, solving.asked)
        self.wavelengths = len(store.attributes["recipe"]["wavelengths_nm"])
        self._shared = Shared(solving)

    def found(self, number: int) -> bool:
        """Whether a tile has as many walks as it should; it is put into the picture then."""
        tile = self.tiles[number]
        if self.state.has(tile):
            return True
        found = self._of(number)
        if found is None or found[0] < self.goal:
            return False
        self.state.put(tile, answer_of(found[1]))
        return True

    def begin(self, number: int) -> Task:
        """A tile, with the walks that were made before."""
        tile, found = self.tiles[number], self._of(number)
        before = None if found is None else self._walks(found[0], found[1])
        return Task(solve_more, (self.rays.part(tile), before), self._shared, number, self._bytes(tile))

    def keep(self, task: Task, result: tuple[Answer, Walks | None]) -> None:
        """Keep what a worker has solved."""
        answer, walks = result
        values = {"radiance": answer.radiance, "standard_error": answer.standard_error}
        used = np.broadcast_to(np.asarray(answer.samples, float), len(answer.radiance))
        values["samples"] = used[:, None]
        values |= {f"layer_{name}": layer for name, layer in answer.layers.items()}
        if walks is not None:
            values |= {"sums": walks.sums.reshape(len(walks.sums), -1)}
            values |= {"marked": walks.marked.reshape(len(walks.marked), -1)}
        self.store.put(task.number, self.goal, values, len(self.tiles), self.most)
        self.state.put(self.tiles[task.number], answer)

    def _of(self, number: int) -> tuple[int, dict[str, Array]] | None:
        tile = self.tiles[number]
        return self.store.get(number, tile.stop - tile.start)

    def _bytes(self, tile: slice) -> int:
        """Memory of a task, about."""
        asked = self.solving.asked
        batches = FEWEST * (4 if asked.stokes else 1) if keeps_sums(self.solving.module, asked) else 0
        return tile_bytes(tile.stop - tile.start, self.wavelengths, asked.layers, batches)

    def _walks(self, done: int, values: dict[str, Array]) -> Walks | None:
        module, context, asked = self.solving
        if "sums" not in values or not keeps_sums(module, asked):
            return None
        shape = module.no_walks(context, len(values["sums"]), asked)
        if values["sums"].shape[1] != shape.sums[0].size or values["marked"].shape[1] != shape.marked[0].size:
            return None
        return Walks(
            done, np.ascontiguousarray(values["sums"]).reshape(shape.sums.shape),
            np.ascontiguousarray(values["marked"]).reshape(shape.marked.shape),
        )  # fmt: skip


def amount_of(module: Any, asked: Asked[Any]) -> int:
    """How much work a finished tile has in it: walks of each batch, or 1."""
    if not keeps_sums(module, asked):
        return 1
    from skyscatter.solvers.path import walks_for

    return walks_for(asked) // FEWEST


def solve_tiles_stored(
    tiles: StoredTiles, order: Iterable[int], engine: Engine, progress: Callable[[float], None] | None
) -> bool:
    """Hand the tiles out; False if interrupted."""

    def tick() -> None:
        if progress is not None:
            progress(tiles.state.share)

    try:
        for _ in tiles.results(order, engine, tick):
            pass
        return True
    except KeyboardInterrupt:
        wait(engine.running, GRACE)
        return False


class StoredPasses:
    """The sums over the passes of a picture, in two chunks by turns; one program at a time adds to them."""

    def __init__(self, state: RenderState, store: Store) -> None:
        self.state, self.store = state, store
        #: Held by whoever changes the sums, and while they are written.
        self.lock = threading.RLock()
        self._spent, self._last, self._kept = 0.0, time.monotonic(), 0

    def begin(self) -> None:
        """Wait for whoever is at it, and take over what there is."""
        while not self.store.claims.take("passes"):
            time.sleep(LOOK)
        self.take_over()

    def take_over(self) -> None:
        """Go on from the sums that are kept."""
        self.state.take_passes(self.store)
        self._kept = self.state.passes

    def tick(self) -> None:
        """Keep the sums, as often as costs little."""
        if time.monotonic() - self._last > self._spent / KEEPING:
            self.save()

    def save(self) -> None:
        """Keep the sums where they are new."""
        began = time.monotonic()
        with self.lock:
            if self.state.passes > self._kept:
                self.state.put_passes(self.store)
                self._kept = self.state.passes
        self._last = time.monotonic()
        self._spent = self._last - began

    def end(self) -> None:
        """Let others go on."""
        self.store.claims.give_back("passes")


@contextmanager
def opened_again(path: Any, sorts: tuple[str, ...] | None = PICTURES) -> Iterator[Store]:
    """A store as it is, to be read; one that holds something else than is asked for is refused."""
    attributes = read_attributes(path)
    if sorts is not None and attributes.get("sort") not in sorts:
        raise DomainError("store", str(path), "holds no picture")
    store = Store(path, attributes["recipe"], tuple(attributes["grows"]))
    try:
        yield store
    finally:
        store.close()


def fill(
    state: RenderState,
    store: Store,
    module: Any,
    subpixels: int = 1,
    rays: slice | None = None,
    tiles: list[slice] | None = None,
) -> None:
    """Put what a store has into the state of a picture, or of some of its `rays`; `tiles` where they are known."""
    if getattr(module, "PASSES", False):
        state.take_passes(store)
        sum_up(state)
        return
    rays = slice(0, len(state.done)) if rays is None else rays
    state.take(store, tiles_in(store, module, rays.stop, subpixels) if tiles is None else tiles, rays)


def tiles_in(store: Store, module: Any, rays: int, subpixels: int = 1) -> list[slice]:
    """Which of so many rays each task of a store has: tiles, or blocks of an interrupted run."""
    if "block" in store.attributes:
        return blocks(rays)
    if subpixels > 1:
        from skyscatter.solvers.subpixels import Subpixels

        module = Subpixels(module, np.zeros((0, subpixels**2, 3)), subpixels**2)
    return tiles_of(module, rays)
