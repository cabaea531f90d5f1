"""Pictures larger than memory: tiles go from workers into a store, and from the store strip by strip into files.

Neither the directions of the pixels nor their light are ever in memory as a whole: a tile makes the rays it needs, and
a strip of the picture reads its tiles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.pinhole import CameraBase
from skyscatter.image import strips
from skyscatter.progress import say
from skyscatter.solvers.base import Answer, Array, Asked, Rays
from skyscatter.solvers.checks import check_wavelengths, is_space, worker_count
from skyscatter.solvers.corrections import Corrections, seen_rows
from skyscatter.solvers.options import Solver, record_of
from skyscatter.solvers.run import Solving, load_solver
from skyscatter.solvers.state import RenderState
from skyscatter.solvers.stored import StoredTiles, fill, open_store, opened_again, solve_tiles_stored, tiles_in
from skyscatter.solvers.tiles import spread, tiles_of
from skyscatter.tasks.door import opened
from skyscatter.tasks.store import Store
from skyscatter.workers import steady_algebra

if TYPE_CHECKING:
    from skyscatter.image.skyframe import SkyFrame
    from skyscatter.image.spectral import SpectralImage
    from skyscatter.space import SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene

#: Rays by which solvers are told where a picture looks, before the first tile.
SOME = 4096


class PixelRays:
    """The rays through the pixels of a picture, made where they are asked for.

    Parameters
    ----------
    scene : SpaceScene or SurfaceScene
    camera : Camera
        One that sees something in every pixel.
    """

    def __init__(self, scene: SpaceScene | SurfaceScene, camera: Any) -> None:
        self.scene, self.camera = scene, camera

    def __len__(self) -> int:
        return int(self.camera.width * self.camera.height)

    def rows(self, first: int, last: int) -> Array:
        """Directions of the pixels of some rows, shape (row, column, 3)."""
        return seen_rows(self.scene, self.camera, first, last)

    def part(self, rays: slice) -> Rays:
        """Some of the rays, in the order of the pixels."""
        width = self.camera.width
        first, last = rays.start // width, -(-rays.stop // width)
        directions = self.rows(first, last).reshape(-1, 3)[rays.start - first * width : rays.stop - first * width]
        return self._rays(directions, np.arange(rays.start, rays.stop))

    def some(self) -> Rays:
        """Rays spread over the picture."""
        step = max(round((len(self) / SOME) ** 0.5), 1)
        y, x = np.arange(0, self.camera.height, step), np.arange(0, self.camera.width, step)
        directions = np.concatenate([self.rows(row, row + 1)[0, ::step] for row in y])
        return self._rays(directions, (y[:, None] * self.camera.width + x).ravel())

    def _rays(self, directions: Array, numbers: NDArray[np.intp]) -> Rays:
        origins = np.tile(np.asarray(self.scene.observer.position, float), (len(directions), 1))
        return Rays(origins, np.array(directions, order="C"), numbers.astype(np.int64))


class _Finished:
    """Which tiles of a picture are finished; their light is in the store alone."""

    def __init__(self, tiles: int) -> None:
        self._tiles = tiles
        self._finished: set[int] = set()

    def has(self, tile: slice) -> bool:
        """Whether a tile is."""
        return tile.start in self._finished

    @property
    def share(self) -> float:
        """Finished share of the work, 0 to 1."""
        return len(self._finished) / self._tiles

    def put(self, tile: slice, answer: Answer) -> None:
        """A tile is."""
        self._finished.add(tile.start)


def check_large(scene: Any, camera: Any, solver: str, subpixels: int = 1) -> None:
    """Refuse pictures that cannot be made in parts.

    Raises
    ------
    DomainError
        For skies of planets, cameras that do not see in every pixel, several rays a pixel, and photons.
    """
    whole = "takes the whole picture at once; "
    if not (is_space(scene) or hasattr(scene, "viewpoint")):
        rule = f"of a planet {whole}make the picture smaller, or with fewer wavelengths"
        raise DomainError("scene", "a sky", rule)
    if type(camera).directions is not CameraBase.directions:
        raise DomainError("camera", camera.kind, f"{whole}choose another one, or make the picture smaller")
    if getattr(load_solver(solver, scene), "PASSES", False):
        raise DomainError("solver", solver, f"{whole}choose path or single, or make the picture smaller")
    if subpixels > 1:
        raise DomainError("subpixels", subpixels, f"{whole}leave it out")


@steady_algebra()
def render_stored(
    scene: SpaceScene | SurfaceScene,
    camera: Any,
    wavelengths: ArrayLike,
    store: Any,
    solver: str | Solver = "path",
    *,
    parts: bool = False,
    orders: int = 0,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> StoredPicture:
    """Render a picture that memory does not hold into a store.

    Parameters
    ----------
    scene : SpaceScene or SurfaceScene
    camera : Camera
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    store : path
        Folder, as for `skyscatter.render`; a render that was interrupted goes on.
    solver : str or Path or Single
    parts, orders, threads, executor, progress
        As for `skyscatter.render`.

    Returns
    -------
    StoredPicture

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; what is finished is in the store.
    DomainError
        For what cannot be made in parts: skies of planets, photons, several rays a pixel.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import skyscatter
    >>> from skyscatter.solvers.large import render_stored
    >>> scene = skyscatter.load_model("reflection-nebula").scene()
    >>> camera = skyscatter.Telescope.from_length(8, 4, "1 pc", scene.view.distance)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     picture = render_stored(scene, camera, [450, 650], pathlib.Path(folder, "run.zarr"), "single")
    ...     picture.save(pathlib.Path(folder, "cube.fits"))
    ...     picture.shape, picture.rows(0, 2).shape, picture.filled
    ((4, 8, 2), (2, 8, 2), True)
    """
    from skyscatter.solvers.render import recipe_of

    wl, asked = check_wavelengths(wavelengths), Asked(record_of(solver), parts, orders)
    check_large(scene, camera, asked.how.name)
    module = load_solver(asked.how.name, scene, asked.stokes)
    module.check(asked)
    rays, count = PixelRays(scene, camera), worker_count(threads)
    folder = open_store(store, recipe_of(scene, camera, wl, asked, 1), "space" if is_space(scene) else "surfaces")
    try:
        if progress is not None:
            say("tables")
        solving = Solving(module, module.prepare(scene, rays.some(), wl, asked, count, progress), asked)
        if progress is not None:
            say("rays")
        tiles = tiles_of(module, len(rays))
        with opened(executor, count) as engine:
            work = StoredTiles(solving, rays, tiles, _Finished(len(tiles)), folder)
            if not solve_tiles_stored(work, spread(len(tiles)), engine, progress):
                raise KeyboardInterrupt
    finally:
        folder.close()
    return StoredPicture(store)


class StoredPicture:
    """A picture in a store, of which parts are read as they are needed.

    Parameters
    ----------
    path : path
        Folder that `render_stored` or `skyscatter.render` was given, of a nebula or of surfaces.
    sky : SkyFrame, optional
        Where it stands in the sky, in place of what the scene says, for instance with a name.

    Raises
    ------
    DomainError
        For other folders, and pictures that cannot be read in parts.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import skyscatter
    >>> from skyscatter.solvers.large import StoredPicture
    >>> scene = skyscatter.load_model("reflection-nebula").scene()
    >>> camera = skyscatter.Telescope.from_length(8, 4, "1 pc", scene.view.distance)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run = pathlib.Path(folder, "run.zarr")
    ...     image = skyscatter.render(scene, camera, [450, 650], solver="single", store=run)
    ...     bool((StoredPicture(run).rows(1, 3).radiance == image.radiance[1:3]).all())
    True
    """

    def __init__(self, path: Any, sky: SkyFrame | None = None) -> None:
        from skyscatter.solvers.render import recorded

        self.path = Path(path)
        with self._opened() as store:
            self.recipe = store.attributes["recipe"]
            self.scene, self.camera, self.wavelengths = recorded(store.attributes)
            stokes = self.recipe["options"].get("stokes", False)
            self.module = load_solver(self.recipe["solver"], self.scene, stokes)
            self._rays = PixelRays(self.scene, self.camera)
            self._tiles = tiles_in(store, self.module, len(self._rays))
            finished = store.numbers()
            found = store.get(finished[0], 1) if finished else None
            #: Whether all of it is finished.
            self.filled = len(finished) == len(self._tiles) and "block" not in store.attributes
        if found is not None and "samples" in self.recipe["options"]:  # it may hold more than it was begun with
            made = int(found[1]["samples"].max())
            self.recipe["options"]["samples"] = max(made, self.recipe["options"]["samples"])
        check_large(self.scene, self.camera, self.recipe["solver"], self.recipe.get("subpixels", 1))
        self._corrections = Corrections(self.scene, self.camera, self.wavelengths)
        self._sky = sky

    @property
    def shape(self) -> tuple[int, int, int]:
        """(y, x, wavelength)."""
        return self.camera.height, self.camera.width, self.wavelengths.size

    @property
    def sky(self) -> SkyFrame | None:
        """Where the whole picture stands in the sky."""
        return self._corrections.sky if self._sky is None else self._sky

    def rows(self, first: int, last: int) -> SpectralImage:
        """The rows from `first` on and before `last`; NaN where nothing is finished."""
        from skyscatter.image.spectral import SpectralImage

        width, wl = self.camera.width, self.wavelengths
        wanted = slice(first * width, last * width)
        state = RenderState.empty(dict(self.recipe), (last - first) * width, wl.size)
        with self._opened() as store:
            fill(state, store, self.module, self.recipe.get("subpixels", 1), wanted, self._tiles)

        def cube(values: Array) -> Array:
            found = values if state.done.all() else np.where(state.done[:, None], values, np.nan)
            return found.reshape(last - first, width, -1)

        radiance, error = cube(state.radiance), cube(state.standard_error)
        layers = {name: cube(values) for name, values in state.layers.items()}
        self._corrections.add(self._rays.rows(first, last), radiance, layers, state.recipe, first)
        return SpectralImage(radiance, wl, error, recipe=state.recipe, layers=layers)

    def save(self, path: Any, **options: Any) -> None:
        """Write it strip by strip: FITS, EXR, netCDF or zarr; see `skyscatter.image.strips.save`."""
        strips.save(self, path, **options)

    @contextmanager
    def _opened(self) -> Iterator[Store]:
        with opened_again(self.path) as store:
            yield store
