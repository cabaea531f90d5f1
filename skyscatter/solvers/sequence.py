"""Sequences: many pictures of one air, from one solved field, with an exposure that does not jump."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errors import DomainError
from skyscatter.scene import Scene
from skyscatter.solvers import orders, skylights
from skyscatter.solvers.base import Answer, Array, Asked
from skyscatter.solvers.checks import check_wavelengths, worker_count
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.eclipse import eclipse_of
from skyscatter.solvers.field import DEFAULT_TOLERANCE, RadianceField, solve_range
from skyscatter.solvers.options import Orders, record_of
from skyscatter.solvers.render import render, sun_corrections
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.townlamps import towns_shine
from skyscatter.solvers.towns import add_towns
from skyscatter.tasks.door import opened
from skyscatter.tasks.sharing import Sharing
from skyscatter.tasks.store import Store
from skyscatter.tasks.task import Shared, Task

if TYPE_CHECKING:
    from skyscatter.image.spectral import SpectralImage

#: Rays that are looked at together.
CHUNK = 4096
#: Width of the small pictures from which exposures are found [pixel].
SMALL = 64
#: What a dome without its Sun has beside it: the Sun as a lamp, and for which files.
LAMP, LAMPS = ".sun.json", (".exr", ".hdr")
#: Largest change of exposure from one frame to the next [EV].
STEP = 0.1


def field_for(
    scenes: Sequence[Scene],
    camera: Any,
    wavelengths: ArrayLike,
    *,
    tolerance: float | None = None,
    stokes: bool = False,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> RadianceField:
    """One field for the Suns of all scenes, which differ in nothing else.

    Parameters
    ----------
    scenes : sequence of Scene
    camera : Camera
        Of the frames; smaller ones with the same view will do.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    tolerance, stokes, threads, progress, checkpoint
        As for `skyscatter.solve`.

    Raises
    ------
    DomainError
        For scenes with different air or ground.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter.solvers.sequence import field_for, frame
    >>> model = skyscatter.load_model("earth-simple")
    >>> scenes = [model.scene(sun_elevation_deg=e) for e in (40, 50)]
    >>> camera = skyscatter.Panorama(width=16, height=8)
    >>> field = field_for(scenes, camera, [550], tolerance=0.02)
    >>> low, high = (frame(field, scene, camera).radiance.mean() for scene in scenes)
    >>> bool(low < high)
    True
    """
    wl = check_wavelengths(wavelengths)
    for scene in scenes[1:]:
        if not same_air(scenes[0], scene):
            raise DomainError("scenes", "different air, ground or star", "one field is for one air; solve them apart")
    small = smaller(camera)
    ranges, darkest = [], []
    for scene in scenes:
        directions = small.directions(scene.observer).reshape(-1, 3)
        directions = np.ascontiguousarray(directions[np.isfinite(directions[:, 0])])
        origins = np.ascontiguousarray(np.broadcast_to(scene.observer.position, directions.shape))
        if skylights.sun_shines(scene):
            seen = scene, compile_scene(scene, wl), origins, directions
            ranges.append(orders.window_of(*seen))
            darkest.append(orders.darkest_sun(*seen))
        heavens = skylights.heavens_of(scene, wl)
        window = None if heavens is None else skylights.light_window(scene, heavens, directions)
        ranges += [] if window is None else [window]
    # Where nothing shines that the air could scatter, any field will do.
    zenith = min((low for low, _ in ranges), default=0.0), max((high for _, high in ranges), default=0.1)
    return solve_range(
        scenes[0], wl, zenith, DEFAULT_TOLERANCE if tolerance is None else tolerance, stokes, None,
        worker_count(threads), progress, checkpoint, max(darkest, default=None),
    )  # fmt: skip


def check_seed(seed: int, scenes: Sequence[Scene]) -> None:
    """Refuse a seed where one field serves all frames, and no walks in an eclipse have a use for it."""
    if not any(eclipse_of(scene) is not None for scene in scenes):
        Asked(Orders(seed=seed)).refuse(orders.WITHOUT_CHANCE, "seed")


def same_air(one: Scene, other: Scene) -> bool:
    """Whether one field serves two scenes."""
    apart = {"sun", "altitude", "lights", "towns"}
    return one.model_dump(mode="json", exclude=apart) == other.model_dump(mode="json", exclude=apart)


def smaller(camera: Any, width: int = SMALL) -> Any:
    """The same view with fewer pixels."""
    height = max(round(camera.height * width / camera.width), 1)
    if camera.width <= width:
        return camera
    return type(camera).model_validate({**camera.model_dump(), "width": width, "height": height})


def frame(
    field: RadianceField, scene: Scene, camera: Any, air: skylights.LitAir | None = None, sun_disk: bool = True
) -> SpectralImage:
    """A picture of a scene from a field that covers its Sun, and the other lights that shine on it.

    Parameters
    ----------
    field : RadianceField
    scene : Scene
        Of the same air; its Sun, its lights and its observer count.
    camera : Camera
    air : LitAir, optional
        Of that field and the observer's height; what was found for other frames is not found again.
    sun_disk : bool
        As for `skyscatter.render`.

    Returns
    -------
    SpectralImage
        Without an error; NaN outside of the camera's field.  With layers Q, U and V where the field is of polarised
        light.
    """
    from skyscatter.image.spectral import SpectralImage

    grid = camera.directions(scene.observer)
    table = field.at(scene.sun)
    inside = np.isfinite(grid[..., 0])
    names = ("radiance", *(("Q", "U", "V") if field.stokes else ()))
    cubes = {name: np.full((*inside.shape, field.wavelengths.size), np.nan) for name in names}
    cube = cubes.pop("radiance")
    recipe = {"scene": scene.model_dump(mode="json", exclude_none=True), "camera": camera.model_dump(mode="json")}
    recipe |= {"solver": "orders"} | ({} if sun_disk else {"sun_disk": False})
    if skylights.sun_shines(scene):
        found = looked(field, table, scene, grid[inside])
        cube[inside] = found.radiance
        for name, layer in cubes.items():
            layer[inside] = found.layers[name]
    else:
        for array in (cube, *cubes.values()):
            array[inside] = 0.0
    corrections, recipe = sun_corrections(scene, camera, grid, field.wavelengths, recipe, table)
    for pixels, light in corrections:
        cube.reshape(-1, cube.shape[-1])[pixels] += light
    heavens = skylights.heavens_of(scene, field.wavelengths)
    if heavens is not None:
        lit = air or skylights.LitAir(field, scene.altitude)
        scatters = skylights.light_window(scene, heavens, np.ascontiguousarray(grid[inside])) is not None
        picture = skylights.Picture(cube, None, cubes, grid, camera)
        skylights.add_lights(picture, scene, heavens, lit if scatters else None, 1)
    if towns_shine(scene):
        add_towns(skylights.Picture(cube, None, cubes, grid, camera), scene, field.wavelengths)
    return SpectralImage(cube, field.wavelengths, recipe=recipe, layers=cubes)


def looked(field: RadianceField, table: Any, scene: Scene, directions: Array) -> Answer:
    """Radiance along rays from the observer, and the layers of polarised light, in this thread."""
    origins = np.broadcast_to(scene.observer.position, directions.shape)
    sky = field.sky_table(table, origins, directions, 1)
    found = []
    for k in range(0, len(directions), CHUNK):
        o, d = (np.ascontiguousarray(a[k : k + CHUNK]) for a in (origins, directions))
        found.append(field.look(table, o, d, False, sky))
    none = np.zeros((0, field.wavelengths.size))
    names = ("Q", "U", "V") if field.stokes else ()
    return Answer(
        np.concatenate([part.radiance for part in found] or [none]),
        np.concatenate([part.standard_error for part in found] or [none]),
        {name: np.concatenate([part.layers[name] for part in found] or [none]) for name in names},
    )


def adapted(exposures: ArrayLike, step: float = STEP) -> Array:
    """Exposures that follow others by at most `step` from frame to frame, and overexpose none.

    Parameters
    ----------
    exposures : array_like, shape (frame,)
        What each frame would have by itself [EV].
    step : float
        [EV]

    Examples
    --------
    >>> from skyscatter.solvers.sequence import adapted
    >>> adapted([14.0, 14.0, 10.0, 13.9], 0.1).round(2)
    array([14. , 14. , 13.9, 13.9])
    """
    wanted = np.asarray(exposures, float)
    number = np.arange(wanted.size)
    return np.asarray((wanted[None, :] - step * np.abs(number[:, None] - number[None, :])).max(axis=1))


@dataclass(frozen=True)
class Frames:
    """What the frames of a sequence share.

    Attributes
    ----------
    scenes : tuple of Scene
    camera : Camera
    wavelengths : ndarray
    solved : RadianceField, optional
        For all of them; without it each is rendered by itself.
    options : mapping
        Of `skyscatter.render`, for those; of others ``sun_disk`` counts.
    """

    scenes: tuple[Scene, ...]
    camera: Any
    wavelengths: Array
    solved: RadianceField | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    _airs: dict[float, skylights.LitAir] = field(default_factory=dict, repr=False, compare=False)

    def image(self, number: int, camera: Any = None) -> SpectralImage:
        """One frame."""
        scene = self.scenes[number]
        # A field's light is symmetric about the Sun, in the Moon's shadow none is.
        if self.solved is not None and eclipse_of(scene) is None:
            air = self._airs.setdefault(scene.altitude, skylights.LitAir(self.solved, scene.altitude))
            return frame(self.solved, scene, camera or self.camera, air, self.options.get("sun_disk", True))
        return render(scene, camera or self.camera, self.wavelengths, threads=1, **self.options)

    @property
    def recorded(self) -> dict[str, Any]:
        """The options as files hold them."""
        how = record_of(self.options.get("solver", "orders"))
        return {**self.options, "solver": how.name, **how.recorded}


def own_exposure(frames: Frames, number: int) -> float:
    """The exposure that a frame would have by itself [EV], from a small picture of it."""
    return float(frames.image(number, smaller(frames.camera)).auto_exposure())


def written(frames: Frames, number: int, suffix: str, options: Mapping[str, Any]) -> dict[str, bytes]:
    """The files of a frame by their suffixes, as a worker makes them: one, and the lamp of a dome without its Sun."""
    image = frames.image(number)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"frame{suffix}")
        image.save(path, **options)
        if "sun_lamp" in image.recipe and suffix in LAMPS:
            from skyscatter.image.dome import write_lamp

            write_lamp(image, path.with_suffix(LAMP), options.get("scale", 1.0))
        return {beside.name.removeprefix("frame"): beside.read_bytes() for beside in sorted(Path(folder).iterdir())}


def own_exposures(frames: Frames, executor: Any = None, threads: int | None = None) -> Array:
    """`own_exposure` of all frames."""
    shared, found = Shared(frames), np.zeros(len(frames.scenes))
    with opened(executor, threads) as engine:
        tasks = (Task(own_exposure, (k,), shared, k) for k in range(len(found)))
        for task, exposure in engine.results(tasks):
            found[task.number] = exposure
    return found


class StoredFrames(Sharing):
    """Files of frames between a store and an engine, a part of the store each."""

    def __init__(self, store: Store, task_of: Callable[[int], Task]) -> None:
        super().__init__(store)
        self._task_of = task_of

    def found(self, number: int) -> bool:
        """Whether the files of a frame are there."""
        return bool(self.store.kept(part_of(number)))

    def begin(self, number: int) -> Task:
        """The task that makes a frame."""
        return self._task_of(number)

    def keep(self, task: Task, result: dict[str, bytes]) -> None:
        """Keep the files of a frame."""
        self.store.keep(part_of(task.number), {name: np.frombuffer(file, np.uint8) for name, file in result.items()})

    def files(self, number: int) -> dict[str, bytes]:
        """The files of a frame by their suffixes; empty where it is not finished."""
        return {name: file.tobytes() for name, file in self.store.kept(part_of(number)).items()}


def part_of(number: int) -> str:
    """The name of a frame in a store."""
    return f"frame-{number + 1:06d}"


def files(
    frames: Frames,
    numbers: Sequence[int],
    suffix: str,
    options: Callable[[int], Mapping[str, Any]],
    executor: Any = None,
    threads: int | None = None,
    store: Store | None = None,
) -> Iterator[tuple[int, dict[str, bytes]]]:
    """The files of some frames by their suffixes, as they are ready.

    Parameters
    ----------
    frames : Frames
    numbers : sequence of int
    suffix : str
        Such as ``.png``.
    options : callable
        Number of a frame -> options of `SpectralImage.save`.
    executor, threads
        As for `skyscatter.render`; each frame is a task.
    store : Store, optional
        Frames that it has are not made again, those that are made are kept there, and several programs share the work.
    """
    shared = Shared(frames)

    def task_of(number: int) -> Task:
        return Task(written, (number, suffix, dict(options(number))), shared, number)

    with opened(executor, threads) as engine:
        if store is None:
            for task, content in engine.results(map(task_of, numbers)):
                yield task.number, content
            return
        kept, made = StoredFrames(store, task_of), set()
        for task, content in kept.results(numbers, engine):
            made.add(task.number)
            yield task.number, content
        for number in numbers:
            if number not in made:
                yield number, kept.files(number)
