"""Running a solver over many rays: tiles in a pool of threads, progress, interruption, and going on later."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errorkind import kind_of
from skyscatter.errors import DomainError
from skyscatter.kernels.forms import expect
from skyscatter.memory import tile_bytes
from skyscatter.progress import say
from skyscatter.scene import Scene
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.checks import check_rays, check_wavelengths, is_space, worker_count
from skyscatter.solvers.options import Solver, record_of
from skyscatter.solvers.passes import solve_passes
from skyscatter.solvers.state import Checkpoint, RenderState
from skyscatter.solvers.stored import StoredPasses, StoredTiles, solve_tiles_stored, stored_context
from skyscatter.solvers.tiles import spread, tiles_of
from skyscatter.solvers.townlamps import check_towns, towns_shine
from skyscatter.tasks.door import opened
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.store import Store
from skyscatter.tasks.task import Shared, Task
from skyscatter.workers import GRACE, steady_algebra

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage
    from skyscatter.space import SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene

    AnyScene = Scene | SpaceScene | SurfaceScene

#: Seconds after which the finished rays of a tile are kept, and the rays by which the pace is found.
SLICE, FIRST_RAYS = 1.0, 4
#: The modules of the solvers, by the sort of medium.
SHELLS = {"orders": "orders", "path": "path", "single": "single"}
WORLDS = {"path": "world"}
#: What is added where only the ground is not Lambertian.
GROUNDS = {"single": "single_ground"}
VOLUMES = {"path": "volume_path", "single": "volume_single", "photons": "photons"}
SURFACES = {"path": "surface_path", "photons": "photons"}
SOLVERS = tuple(SHELLS)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a render.

    Attributes
    ----------
    partial : SpectralImage
        What was finished; NaN elsewhere.
    state : RenderState
        To be saved and given back as ``resume``.
    """

    def __init__(self, partial: SpectralImage, state: RenderState) -> None:
        self.partial, self.state = partial, state
        super().__init__("render interrupted")


def load_solver(name: str, scene: AnyScene, stokes: bool = False) -> Any:
    """The module of a solver for a scene, whose light may be polarised."""
    if isinstance(scene, Scene) and scene.world:
        modules = WORLDS | (GROUNDS if scene.world == "ground.material" else {})
        if name in SHELLS and name not in modules:
            rule = f"knows shells of air over Lambertian ground only, and this scene has {scene.world}; take path"
            if name in GROUNDS:
                rule = f"knows shells of air over ground only, and this scene has {scene.world}; take path"
            raise DomainError("solver", name, rule)
    else:
        modules = SHELLS if isinstance(scene, Scene) else VOLUMES if is_space(scene) else SURFACES
        if stokes and is_space(scene):
            modules = modules | {"path": "volume_stokes"}
    if name not in modules:
        raise DomainError("solver", name, f"choose from {', '.join(modules)}")
    if name == "orders" and isinstance(scene, Scene) and _eclipsed(scene):
        expect("path")
        return import_module("skyscatter.solvers.eclipsed")
    expect(modules[name])
    return import_module(f"skyscatter.solvers.{modules[name]}")


def _eclipsed(scene: Scene) -> bool:
    """Whether a scene is in an eclipse of the Sun; nothing is loaded for scenes without a place and a time."""
    if scene.sun.site is None:
        return False
    from skyscatter.solvers.eclipse import eclipse_of

    return eclipse_of(scene) is not None


def solve_rays(
    scene: AnyScene,
    rays: Rays,
    wavelengths: Array,
    asked: Asked[Any],
    state: RenderState,
    threads: int | None,
    progress: Callable[[float], None] | None,
    wrap: Callable[[Any], Any] | None = None,
    checkpoint: Checkpoint | None = None,
    executor: Any = None,
    store: Store | None = None,
) -> bool:
    """Fill `state` tile by tile, or pass by pass; False if interrupted, with all in it that was finished.

    Kernels release the GIL, and each tile depends on nothing but its own rays: the answer is the same for any number
    of threads, and wherever `executor` has the tiles solved; with a `store` each finished part is kept there.  `wrap`
    makes another solver of the one that was named, see `skyscatter.solvers.subpixels`.
    """
    module = load_solver(asked.how.name, scene, asked.stokes)
    if wrap is not None:
        module = wrap(module)
    by_passes = getattr(module, "PASSES", False)
    module.check(asked)
    workers = worker_count(threads)
    if state.done.all() and not by_passes:
        return True
    if progress is not None:
        say("tables")
    prepare = partial(module.prepare, scene, rays, wavelengths, asked, workers, progress)
    keeps = getattr(module, "KEEPS", False)
    try:
        if store is not None:
            context = stored_context(store, prepare, keeps, progress)
        else:
            context = prepare(**({"checkpoint": checkpoint} if keeps else {}))
    except KeyboardInterrupt:
        return False
    if progress is not None:
        say("passes" if by_passes else "rays")
    with opened(executor, workers) as engine:
        if store is not None:
            return _solve_stored(Solving(module, context, asked), rays, state, engine, progress, store)
        if by_passes:
            return solve_passes(module, context, rays, asked, state, engine, progress, checkpoint)
        return _solve_tiles(_Tiles(module, context, rays, asked, state, checkpoint), engine, progress, checkpoint)


def _solve_tiles(
    tiles: _Tiles, engine: Engine, progress: Callable[[float], None] | None, checkpoint: Checkpoint | None
) -> bool:
    """Hand the tiles out; False if interrupted."""

    def tick() -> None:
        if progress is not None:
            progress(tiles.state.share)
        if checkpoint is not None:
            checkpoint.tick()

    def kept(task: Task, done: Future[Any]) -> None:
        if not engine.local and not done.cancelled() and done.exception() is None:
            tiles.keep(task.arguments[1], done.result())

    try:
        for _ in engine.results(tiles.tasks(engine.local), tick, kept):
            pass
        tick()
        return True
    except KeyboardInterrupt:
        tiles.stop.set()
        wait(engine.running, GRACE)
        return False
    except BaseException:
        tiles.stop.set()
        raise
    finally:
        with tiles.lock:
            tiles.closed = True


class Solving(NamedTuple):
    """What the tiles of a picture share."""

    module: Any
    context: Any
    asked: Asked[Any]


def _solve_stored(
    solving: Solving,
    rays: Rays,
    state: RenderState,
    engine: Engine,
    progress: Callable[[float], None] | None,
    store: Store,
) -> bool:
    """Do what the store lacks; False if interrupted."""
    if not getattr(solving.module, "PASSES", False):
        tiles = tiles_of(solving.module, len(rays.origins))
        return solve_tiles_stored(StoredTiles(solving, rays, tiles, state, store), spread(len(tiles)), engine, progress)
    passes = StoredPasses(state, store)
    try:
        passes.begin()
        complete = solve_passes(*solving[:2], rays, solving.asked, state, engine, progress, passes)
        passes.save()
    except KeyboardInterrupt:
        complete = False
    finally:
        passes.end()
    return complete


def solve_tile(solving: Solving, rays: Rays, tile: slice) -> Answer:
    """The rays of a tile in a process that knows nothing else; where they stand among all is for whoever keeps them."""
    answer: Answer = solving.module.solve(solving.context, rays, solving.asked)
    return answer


class _Tiles:
    """Rays in parts that workers solve, and what is kept of them.

    It is kept in the threads of the engine: Ctrl-C strikes the main thread only, and so never half-way.
    """

    def __init__(
        self, module: Any, context: Any, rays: Rays, asked: Asked[Any], state: RenderState, kept: Checkpoint | None
    ) -> None:
        self.module, self.context, self.rays, self.asked, self.state = module, context, rays, asked, state
        #: Rays of a tile may share work, and their last digits depend on all of it; where not, it may be cut.
        self.whole = hasattr(module, "TILES")
        self.stop, self.closed = threading.Event(), False
        self.lock = threading.RLock() if kept is None else kept.lock
        self.pace = 0.0  #: rays that a thread solves in a second

    def waiting(self) -> list[slice]:
        """Tiles that are not finished, spread over the picture so that the first ones tell how long all take."""
        tiles = tiles_of(self.module, len(self.rays.origins))
        return [tiles[k] for k in spread(len(tiles)) if not self.state.done[tiles[k]].all()]

    def tasks(self, local: bool) -> Iterator[Task]:
        """The tiles that are not finished as tasks: of this process, which keep them, or of any other."""
        if local:
            yield from (Task(self.work, (tile,)) for tile in self.waiting())
            return
        shared = Shared(Solving(self.module, self.context, self.asked))
        wavelengths, layers = self.state.radiance.shape[1], self.asked.layers
        for tile in self.waiting():
            memory = tile_bytes(tile.stop - tile.start, wavelengths, layers)
            yield Task(solve_tile, (self.rays.part(tile), tile), shared, memory=memory)

    def work(self, tile: slice) -> None:
        """Solve what is not finished of a tile, and keep it part by part."""
        first = tile.start if self.whole else tile.start + int(np.argmin(self.state.done[tile]))
        while first < tile.stop and not self.stop.is_set():
            rays = tile.stop - first if self.whole else max(int(self.pace * SLICE), FIRST_RAYS)
            part = slice(first, min(first + rays, tile.stop))
            began = time.monotonic()
            answer = self.module.solve(self.context, self.rays.part(part), self.asked)
            self.pace = (part.stop - part.start) / max(time.monotonic() - began, 1e-9)
            self.keep(part, answer)
            first = part.stop

    def keep(self, part: slice, answer: Answer) -> None:
        """Keep the answer of some rays, unless all is over."""
        with self.lock:
            if not self.closed:
                self.state.put(part, answer)


@steady_algebra()
def add_sky_lights(
    scene: Scene,
    camera: Any,
    directions: Array,
    wavelengths: Array,
    arrays: tuple[Array, Array, dict[str, Array]],
    options: dict[str, Any],
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Add what shines beside the Sun to rays, or to a picture: the other lights of the sky, and towns.

    Parameters
    ----------
    scene : Scene
    camera : Camera or None
        None for rays.
    directions : ndarray, shape (..., 3)
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    arrays : tuple
        Radiance, error and layers, which are added to.
    options : dict
        Of the render: `stokes` and `parts` count.
    """
    from skyscatter.solvers import skylights

    picture = skylights.Picture(*arrays, directions, camera, bool(options.get("parts")))
    if scene.world:
        from skyscatter.solvers.worldlights import add_straight

        add_straight(picture, scene, wavelengths, threads)
        return
    skylights.add_to(picture, scene, wavelengths, bool(options.get("stokes")), threads, progress)
    if towns_shine(scene):
        from skyscatter.solvers.towns import add_towns

        add_towns(picture, scene, wavelengths, progress=progress)


def radiance(
    scene: AnyScene,
    origins: ArrayLike,
    directions: ArrayLike,
    wavelengths: ArrayLike,
    solver: str | Solver = "orders",
    *,
    parts: bool = False,
    orders: int = 0,
    stokes: bool = False,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> Answer:
    """Spectral radiance that arrives along rays, and its error.

    Parameters
    ----------
    scene : Scene, SpaceScene or SurfaceScene
    origins : array_like, shape (..., 3)
        Where the rays are observed [m]: from the planet's centre in the scene's frame (east, north, up), or in the
        frame of the model of a nebula or of surfaces.
    directions : array_like, shape (..., 3)
        Unit vectors in which to look.  Broadcast against the origins.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.  Light of stars and lamps is averaged over the cell of each, half-way to its
        neighbours; a single one stands for itself.
    solver : str or Orders or Path or Single or Photons
        ``"orders"``: all orders of scattering by a deterministic solution (planets only); ``"path"``: all of them by
        Monte Carlo; ``"single"``: the first by quadrature (planets and nebulae); ``"photons"``: all by photons from the
        lamps that are gathered along the rays (nebulae and surfaces).  With options it is `skyscatter.Orders`,
        `skyscatter.Path`, `skyscatter.Single` or `skyscatter.Photons`, such as ``Path(samples=64, seed=1)``.
    parts : bool
        Return the parts of the radiance as layers: direct, scattered (once), ground (reflected once), multiple.
    orders : int
        Return the first so many orders of scattering as layers order1, order2, ... (``path``).
    stokes : bool
        Treat light as polarised: layers Q, U and V beside the radiance I, with their errors Q_error, U_error
        and V_error; `Answer.stokes` puts them together.  They are referred to the meridian plane (see
        `skyscatter.geometry.meridian.meridian_frame`): Q > 0 is upright, U > 0 leans to the left, V > 0 turns
        anticlockwise for the observer (IAU 1974).  Without it multiple scattering is that of scalar light, which
        misses the radiance of a clear sky by up to a few per cent.  In scenes of surfaces and nebulae (``path`` and
        ``photons``) the meridian plane holds the z axis of the scene.  Lambertian surfaces and land depolarise;
        mirrors, glass, metals and the sea follow Fresnel's amplitudes, facet by facet where they are rough, which
        ``photons`` refuse.
    threads : int, optional
        All processors when not given.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What solves the rays: so many processes of this machine, an executor, or a client of dask; threads of this
        process when not given.  The numbers are the same.
    progress : callable, optional
        Called with the finished share, 0 to 1.

    Returns
    -------
    Answer
        ``radiance`` and ``error`` [W m-2 sr-1 nm-1] of shape (..., wavelength), ``error_kind``, ``layers`` and
        ``samples``.  Where a scene has lights beside its Sun (`skyscatter.sky_at`), they are in it but for stars and
        planets themselves, which have no radiance: what the air scatters of them is.

    Raises
    ------
    DomainError
        For rays inside the planet, directions that are not unit vectors, or options out of range or without meaning
        for the solver.

    Examples
    --------
    Light scattered once: the zenith is deep blue, the sky 10 degrees above the southern horizon brighter and paler.

    >>> import numpy as np
    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30, sun_azimuth_deg=270)
    >>> up, low = [0, 0, 1], [0, -np.cos(np.radians(10)), np.sin(np.radians(10))]
    >>> found = skyscatter.radiance(scene, scene.observer.position, [up, low], [450, 650], solver="single")
    >>> found.radiance.round(3)  # W m-2 sr-1 nm-1; a row for each ray
    array([[0.022, 0.008],
           [0.042, 0.022]])
    >>> found.error_kind  # the solver "single" states none, "orders" an estimate and "path" a standard error
    'none'
    """
    wl = check_wavelengths(wavelengths)
    o, d = check_rays(scene, origins, directions)
    shape = o.shape[:-1]
    rays = Rays(o.reshape(-1, 3), d.reshape(-1, 3), np.arange(int(np.prod(shape)), dtype=np.int64))
    asked: Asked[Any] = Asked(record_of(solver), parts, orders, stokes)
    state = RenderState.empty({}, len(rays.origins), wl.size)
    lights: Any = None
    if isinstance(scene, Scene) and (scene.lights is not None or towns_shine(scene)):
        from skyscatter.solvers import skylights

        check_towns(scene, stokes)
        skylights.check_place(scene, rays.origins)
        lights = skylights
    if lights is not None and lights.all_added(scene):
        lights.dark(state, stokes, parts, orders)
    elif not solve_rays(scene, rays, wl, asked, state, threads, progress, executor=executor):
        raise KeyboardInterrupt
    arrays = state.radiance, state.standard_error, state.layers
    if lights is not None and isinstance(scene, Scene):
        wanted = {"stokes": stokes, "parts": parts}
        add_sky_lights(scene, None, rays.directions, wl, arrays, wanted, threads, progress)
    return Answer(
        state.radiance.reshape(*shape, wl.size),
        state.standard_error.reshape(*shape, wl.size),
        {name: values.reshape(*shape, wl.size) for name, values in state.layers.items()},
        state.samples.reshape(shape),
        kind_of(asked.how.name),
    )
