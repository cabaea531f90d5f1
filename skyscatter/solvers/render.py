"""Pictures: a camera's rays through a solver into a `SpectralImage`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.memory import check_picture, format_bytes
from skyscatter.progress import remark
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array, Asked, Rays
from skyscatter.solvers.checks import check_wavelengths, is_space
from skyscatter.solvers.corrections import Corrections, seen
from skyscatter.solvers.options import Path, Solver, record_of
from skyscatter.solvers.run import Interrupted, add_sky_lights, load_solver, solve_rays
from skyscatter.solvers.state import Checkpoint, RenderState, checkpoint_of
from skyscatter.solvers.townlamps import check_towns
from skyscatter.workers import steady_algebra

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage
    from skyscatter.space import SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene
    from skyscatter.tasks.store import Store

    AnyScene = Scene | SpaceScene | SurfaceScene


@steady_algebra()
def render(
    scene: AnyScene,
    camera: Any,
    wavelengths: ArrayLike,
    solver: str | Solver = "orders",
    *,
    parts: bool = False,
    orders: int = 0,
    stokes: bool = False,
    subpixels: int = 1,
    sun_disk: bool = True,
    halves: bool = False,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
    resume: str | os.PathLike[str] | None = None,
    checkpoint: Checkpoint | str | os.PathLike[str] | None = None,
    store: str | os.PathLike[str] | None = None,
) -> SpectralImage:
    """Render a picture.

    Each pixel is the radiance along the ray through its middle; the direct light of the solar disk, which is often
    smaller than a pixel, is averaged over the pixel instead: the radiance of all pixels times their solid angles sums
    to the irradiance of the disk to 0.1 %.  In a nebula so is the light scattered once in the pixels
    around a star, and every star adds its own light, dimmed by the dust before it.  Among surfaces, which have edges,
    a pixel may be the mean over several rays; lamps are seen along these rays only, so that one that is smaller than
    the distance between them is missed in most pixels and too bright in others.

    Parameters
    ----------
    scene : Scene, SpaceScene or SurfaceScene
    camera : Camera
        What is seen where; see `skyscatter.geometry.camera`.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    solver, parts, orders, stokes, threads, executor
        As for `skyscatter.radiance`; samples are those of a pixel.  Q, U and V of a nebula are not averaged over the
        pixels around a star as the radiance is.
    subpixels : int
        Send a square of so many by so many rays through each pixel, which share its samples (scenes of surfaces, and
        skies that hold bodies or fields).
    sun_disk : bool
        False leaves out what comes straight from the Sun's disk (skies of planets only), for domes that other programs
        light together with a lamp of their own: the recipe then has that lamp as ``sun_lamp``, its ``direction`` (east,
        north, up) and its ``irradiance`` on a plane that faces it [W m-2 nm-1].
    halves : bool
        Keep two independent halves of the walks or passes as layers ``half_a`` and ``half_b``, which
        `skyscatter.SpectralImage.denoised` needs (``path`` and ``photons``).  They hold what chance decides and nothing
        else; the radiance is the same as without.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    resume : path, optional
        Checkpoint of an interrupted render with the same arguments; also kept there from then on, unless `checkpoint`
        names another folder.
    checkpoint : path or skyscatter.solvers.state.Checkpoint, optional
        Folder in which the finished part is kept, every three minutes or as often as the `Checkpoint` says, and on
        Ctrl-C.  It is a store as well: `picture_of` reads it.
    store : path, optional
        Folder in zarr's format in which every finished part is kept at once, in place of a checkpoint.  What it holds
        is not done again, by whatever program and however the last one ended; several may work on one at a time.
        With more samples than before, walks are added to those that it has.

    Returns
    -------
    SpectralImage
        With standard error, the layers that were asked for, and the recipe; NaN outside the camera's field.

    Raises
    ------
    Interrupted
        On Ctrl-C: it carries the finished part and a state from which to go on.
    DomainError
        For options out of range, for a checkpoint of another render, and for a picture that memory does not hold.

    Examples
    --------
    A small fisheye picture of light scattered once.  The Sun is in its brightest pixel, south of the middle.

    >>> import numpy as np
    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=45, sun_azimuth_deg=180)
    >>> camera = skyscatter.Fisheye(width=16, height=16)
    >>> image = skyscatter.render(scene, camera, [450, 550, 650], solver="single")
    >>> image.shape, int((~image.inside).sum())  # rows, columns, wavelengths; pixels outside the circle
    ((16, 16, 3), 48)
    >>> y, x = np.unravel_index(np.nanargmax(image.luminance()), image.shape[:2])
    >>> at = camera.pixel(scene.sun.direction)  # x, y
    >>> bool(abs(x - at[0]) < 0.6), bool(abs(y - at[1]) < 0.6)
    (True, True)
    """
    wl = check_wavelengths(wavelengths)
    asked: Asked[Any] = Asked(record_of(solver), parts, orders, stokes)
    if isinstance(scene, Scene) and scene.towns:
        check_towns(scene, stokes)
    needed = check_picture(camera.width, camera.height, wl.size, asked.layers + 2 * halves, subpixels**2)
    if progress is not None:
        remark(f"some {format_bytes(needed)} of memory")
    grid = seen(scene, camera)
    wrap = _wrapper(scene, camera, grid, subpixels, halves)
    recipe = recipe_of(scene, camera, wl, asked, subpixels)
    if not sun_disk:
        if not isinstance(scene, Scene):
            raise DomainError("sun_disk", sun_disk, "is for skies of planets; leave it out")
        recipe["sun_disk"] = False
    if halves:
        recipe["halves"] = True
    inside = np.isfinite(grid[..., 0])
    numbers = np.flatnonzero(inside.ravel())
    directions = grid.reshape(-1, 3)[numbers]
    origins = np.broadcast_to(scene.observer.position, directions.shape)
    rays = Rays(origins, directions, numbers.astype(np.int64))
    state = _begun(scene, recipe, numbers.size, wl)
    kept = checkpoint_of(checkpoint or resume)
    if kept is not None:
        kept.begin(state, resume)
    with _opened(store, state, resume or checkpoint) as folder:
        complete = solve_rays(scene, rays, wl, asked, state, threads, progress, wrap, kept, executor, folder)
    if folder is not None and "samples" in recipe["options"] and state.samples.size:
        recipe["options"]["samples"] = max(int(state.samples.max()), recipe["options"]["samples"])  # it may hold more
    if kept is not None and (kept.written or not complete):
        kept.save()
    alone = complete and kept is None  # nobody goes on from this state
    sight = None
    if halves and complete:
        from skyscatter.solvers.features import picture_sight

        sight = picture_sight(scene, grid, wl, threads)
    image = _picture(scene, camera, grid, inside, wl, state, threads, progress, alone, sight)
    if not complete:
        raise Interrupted(image, state)
    return image


@contextmanager
def _opened(store: Any, state: RenderState, other: Any) -> Iterator[Store | None]:
    """The store of a render, where there is to be one."""
    if store is None:
        yield None
        return
    from skyscatter.solvers.stored import open_store

    if other is not None:
        raise DomainError("store", str(store), "keeps what is finished by itself; leave out the checkpoint")
    folder = open_store(store, state.recipe, state.sort)
    try:
        yield folder
    finally:
        folder.close()


def _wrapper(scene: AnyScene, camera: Any, grid: Array, subpixels: int, halves: bool) -> Callable[[Any], Any] | None:
    """What makes a solver of pixels with several rays of one of rays, or one of halves; None where neither is asked."""
    from skyscatter.solvers.halves import Halves
    from skyscatter.solvers.subpixels import Subpixels, check_subpixels, fine_directions

    check_subpixels(subpixels)
    if subpixels == 1:
        return Halves if halves else None
    if (isinstance(scene, Scene) and not scene.world) or is_space(scene):
        raise DomainError("subpixels", subpixels, "is for scenes of surfaces; leave it out, and make a larger picture")
    fine = fine_directions(camera, scene.observer, grid, subpixels).reshape(-1, subpixels**2, 3)
    return lambda module: Subpixels(Halves(module) if halves else module, fine, subpixels**2)


def recipe_of(scene: AnyScene, camera: Any, wl: Array, asked: Asked[Any], subpixels: int) -> dict[str, Any]:
    """All that is needed to make the picture again."""
    from skyscatter import __version__

    wanted = {"parts": asked.parts, "orders": asked.orders, "stokes": asked.stokes}
    given = asked.how.recorded | {name: value for name, value in wanted.items() if value}
    if isinstance(asked.how, Path) and asked.how.noise is None:
        from skyscatter.solvers.path import whole_batches
        from skyscatter.solvers.subpixels import share_of

        given["samples"] = subpixels**2 * whole_batches(share_of(asked.how.samples, subpixels**2))
    return ({"subpixels": int(subpixels)} if subpixels > 1 else {}) | {
        "skyscatter": __version__,
        "scene": scene.model_dump(mode="json", exclude_none=True),
        "camera": camera.model_dump(mode="json"),
        "wavelengths_nm": [float(w) for w in wl],
        "solver": asked.how.name,
        "options": given,
    }


def _begun(scene: AnyScene, recipe: dict[str, Any], rays: int, wl: Array) -> RenderState:
    """The state of a render in which nothing is done; all, where nothing but other lights than the Sun shines."""
    state = RenderState.empty(recipe, rays, wl.size)
    state.sort = "shells" if isinstance(scene, Scene) else "space" if is_space(scene) else "surfaces"
    if isinstance(scene, Scene) and _skylights().all_added(scene):
        options = recipe["options"]
        _skylights().dark(state, options.get("stokes"), options.get("parts"), options.get("orders", 0))
    return state


def _skylights() -> Any:
    from skyscatter.solvers import skylights

    return skylights


def _picture(
    scene: AnyScene,
    camera: Any,
    grid: Array,
    inside: NDArray[np.bool_],
    wl: Array,
    state: RenderState,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
    alone: bool = False,
    sight: NDArray[np.float32] | None = None,
) -> SpectralImage:
    """The picture of a state, with what is added to rays; unless it is `alone` the state stays as it is."""
    from skyscatter.image.spectral import SpectralImage

    def spread(values: Array, changed: bool = True) -> Array:
        if inside.all() and state.done.all():
            cube = values.reshape(*inside.shape, values.shape[-1])
            return cube.copy() if changed and not alone else cube
        cube = np.full((*inside.shape, values.shape[-1]), np.nan)
        cube[inside] = np.where(state.done[:, None], values, np.nan)
        return cube

    def all_layers(changed: bool = True) -> dict[str, Array]:
        return {name: spread(values, changed) for name, values in state.layers.items()}

    if not isinstance(scene, Scene):
        cube, layers = spread(state.radiance), all_layers()
        added = Corrections(scene, camera, wl)
        added.add(grid, cube, layers, state.recipe)
        error = spread(state.standard_error, False)
        return SpectralImage(cube, wl, error, recipe=state.recipe, layers=layers, sky=added.sky, features=sight)
    corrections, recipe = sun_corrections(scene, camera, grid, wl, state.recipe)
    more = bool(state.done.all()) and (scene.lights is not None or bool(scene.towns))
    changed = bool(corrections) or more
    cube, error, layers = spread(state.radiance, changed), spread(state.standard_error, more), all_layers(changed)
    for pixels, light in corrections:
        for values in (cube, *(layers[name] for name in ("direct",) if name in layers)):
            values.reshape(-1, wl.size)[pixels] += light
    if more:
        add_sky_lights(scene, camera, grid, wl, (cube, error, layers), recipe["options"], threads, progress)
    return SpectralImage(cube, wl, error, recipe=recipe, layers=layers, features=sight)


def sun_corrections(
    scene: Scene, camera: Any, grid: Array, wl: Array, recipe: dict[str, Any], table: Any = None
) -> tuple[list[tuple[NDArray[np.intp], Array]], dict[str, Any]]:
    """Pixels with the Sun, and what averaging its disk over them, or leaving it out, adds to the radiance there.

    In a total eclipse its corona too.

    Without the disk the recipe gains the lamp in its place.  `table` is that of its air, where it is known.
    """
    from skyscatter.solvers import sundisk
    from skyscatter.solvers.compile import compile_scene

    with_disk, veil, air = recipe.get("sun_disk", True), sundisk.no_veil, scene
    if scene.world:
        from skyscatter.solvers.worldlights import Veiled

        above = Veiled.over(scene, wl)
        veil, air = above.veil, above.scene
    table = table or compile_scene(air, wl)
    if scene.lights is not None and not _skylights().sun_shines(scene):
        lamp = {} if with_disk else sundisk.sun_lamp(scene, table, wl, veil) | {"irradiance": [0.0] * wl.size}
        return [], recipe | ({"sun_lamp": lamp} if lamp else {})
    if with_disk:
        disk = sundisk.disk_correction(scene, table, camera, grid, veil)
        around = None
        if scene.sun.site is not None:  # no place, no eclipse
            from skyscatter.solvers.corona import corona_pixels

            around = corona_pixels(scene, table, camera, grid, wl, veil)
        return [one for one in (disk, around) if one is not None], recipe
    seen = sundisk.disk_along(scene, table, grid, wl)
    lamp = {**recipe, "sun_lamp": sundisk.sun_lamp(scene, table, wl, veil)}
    return [] if seen is None else [(seen[0], -seen[1])], lamp


def picture_of(store: str | os.PathLike[str]) -> SpectralImage:
    """The picture in a store as far as it is finished, whoever works on it; NaN elsewhere.

    Parameters
    ----------
    store : path
        Folder that `render` was given.

    Returns
    -------
    SpectralImage

    Raises
    ------
    DomainError
        For a folder that is no store of a picture.

    Examples
    --------
    >>> import pathlib
    >>> import tempfile
    >>> import skyscatter
    >>> from skyscatter.solvers.render import picture_of
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=45)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run = pathlib.Path(folder, "run.zarr")
    ...     camera = skyscatter.Panorama(width=8, height=4)
    ...     made = skyscatter.render(scene, camera, [550], solver="single", store=run)
    ...     bool((picture_of(run).radiance == made.radiance).all())
    True
    """
    from skyscatter.solvers.stored import fill, opened_again

    with opened_again(store) as folder:
        recipe = folder.attributes["recipe"]
        scene, camera, wl = recorded(folder.attributes)
        check_picture(camera.width, camera.height, wl.size)
        grid = seen(scene, camera)
        inside = np.isfinite(grid[..., 0])
        state = _begun(scene, recipe, int(inside.sum()), wl)
        module = load_solver(recipe["solver"], scene, recipe["options"].get("stokes", False))
        if not state.done.all():
            fill(state, folder, module, recipe.get("subpixels", 1))
    if "samples" in recipe["options"] and state.samples.size:
        recipe["options"]["samples"] = max(int(state.samples.max()), recipe["options"]["samples"])
    return _picture(scene, camera, grid, inside, wl, state)


def recorded(attributes: dict[str, Any]) -> tuple[Any, Any, Array]:
    """Scene, camera and wavelengths [nm] of what a store says of itself."""
    from pydantic import TypeAdapter

    from skyscatter.geometry.camera import Camera

    recipe = attributes["recipe"]
    scene = _scene_class(attributes["sort"]).model_validate(recipe["scene"])
    camera: Any = TypeAdapter(Camera).validate_python(recipe["camera"])
    return scene, camera, np.asarray(recipe["wavelengths_nm"], float)


def _scene_class(sort: str) -> Any:
    if sort == "shells":
        return Scene
    if sort == "space":
        from skyscatter.space import SpaceScene

        return SpaceScene
    from skyscatter.surfaces.scene import SurfaceScene

    return SurfaceScene
