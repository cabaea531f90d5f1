"""Densities of voxels from images: emission, absorption and scattered light.

The estimate is the one that is likeliest under the noise of the data and a prior whose weight is the largest with which
the data are still explained: chi^2 equal to their number (Morozov 1966).  It is sought from coarse to fine cells and
from strong to weak priors, each from where the last one ended.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.inversion.multiple import multiple_light, with_density
from skyscatter.inversion.priors import Prior, prior_of
from skyscatter.inversion.problem import Best, Problem
from skyscatter.inversion.reconstruction import Reconstruction
from skyscatter.inversion.views import ImageView, Stack
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame

if TYPE_CHECKING:
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]

#: Cells along the shortest side of the coarsest grid at least.
COARSEST = 12
#: Share of what a round finds anew of multiple scattering that is taken on, after the first.
DAMPING = 0.7
#: Factor by which the prior's weight falls from one minimisation to the next.
COOLING = 4.0
#: Weights tried on one grid at most.
MOST_WEIGHTS = 12
#: A weaker prior that takes less than this share off chi^2 does not help any more.
STANDSTILL = 0.03
#: How near chi^2 is brought to the number of data: its own standard deviation is sqrt(2 / number).
NEAR_TARGET = 0.02
#: Times that the degrees of freedom are counted again, for they grow as the prior becomes weaker.
COUNTS = 3


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a tomography; `partial` is the `Reconstruction` as far as it got."""

    def __init__(self, partial: Reconstruction) -> None:
        self.partial = partial
        super().__init__("tomography interrupted")


@dataclass(frozen=True)
class Settings:
    """How a reconstruction goes about it; see `reconstruct`."""

    target: float = 1.0
    freedom: bool = False
    weight: float | None = None
    iterations: int = 40
    stop: float = 3e-4
    rounds: int = 0
    samples: int = 64
    seed: int = 0

    def check(self) -> None:
        """Refuse what cannot be done."""
        for name, low in (("iterations", 1), ("rounds", 0), ("samples", 8), ("seed", 0)):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or value < low:
                raise DomainError(name, value, f"a whole number, at least {low}")
        for name in ("target", "stop"):
            if not getattr(self, name) > 0:
                raise DomainError(name, getattr(self, name), "must be positive")
        if self.weight is not None and not self.weight >= 0:
            raise DomainError("prior_weight", self.weight, "a number that is not negative")


def reconstruct(
    views: Sequence[ImageView],
    source: SpaceScene | VoxelModel,
    wavelengths: ArrayLike | None = None,
    *,
    frame: VoxelFrame | None = None,
    free: Sequence[str] | None = None,
    prior: Prior | str = "tikhonov",
    prior_weight: float | None = None,
    target: float = 1.0,
    freedom: bool = False,
    multiple: bool | int = False,
    samples: int = 64,
    deviation: bool | int = False,
    start: ArrayLike | None = None,
    iterations: int = 40,
    stop: float = 3e-4,
    step: float = 1.0,
    interpolation: Literal["linear", "nearest"] = "linear",
    coarsest: int = COARSEST,
    seed: int = 0,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: str | os.PathLike[str] | None = None,
) -> Reconstruction:
    """Density of voxels from images.

    Parameters
    ----------
    views : sequence of ImageView
        Images with their rays and standard deviations, all at the same wavelengths.
    source : SpaceScene or VoxelModel
        Optics and lights: a scene, the densities of whose `free` components are replaced, or a model by numbers.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm]; with a scene only.
    frame : VoxelFrame
        Cells of the result; with a scene only (those of its own voxels when not given).
    free : sequence of str, optional
        Components of the scene that are sought; all when not given.  The others stay as they are.
    prior : {"tikhonov", "total-variation", "entropy"} or Prior
    prior_weight : float, optional
        Weight of the prior; sought by the discrepancy when not given.
    target : float
        chi^2 that is aimed at, over the number of data.
    freedom : bool
        Over the number of data less the degrees of freedom that the estimate has taken of them: what noise leaves over
        when the estimate follows part of it.  Sharper where bright parts are few; costs a few solutions more.
    multiple : bool or int
        Rounds in which the light scattered more than once is found for the estimate and taken off the data; True is 3.
        With a scene only.
    samples : int
        Walks per pixel for it; see `multiple.multiple_light`.
    deviation : bool or int
        Compute the standard deviation of every voxel from so many samples of the posterior; True is 16.
    start : array_like, shape (component, x, y, z), optional
        Densities to begin with on the finest grid; nothing coarser is then tried.
    iterations, stop : int, float
        Of each minimisation at most, and the share of a gain below which it stops.
    step : float
        Step along rays [cell]; see `VoxelModel`.  With a scene only.
    interpolation : {"linear", "nearest"}
        Densities trilinear, or constant within cells, as for images by codes on the same cells; see `VoxelModel`.
        With a scene only.
    coarsest : int
        Cells along the shortest side of the first grid at least; grids double from there.
    seed : int
        Of the walks and of the samples.
    threads : int, optional
        Results do not depend on it.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What follows the walks of `multiple`, view by view in tiles; as for `skyscatter.render`.
    progress : callable, optional
        Called with the share that is done, 0 to 1 (a guess until the last grid).
    checkpoint : path, optional
        .npz file in which the best estimate, and all that was found on the way to it, is kept after every minimisation.
    resume : path, optional
        Such a file, to go on from to the same bits; or a result of the same problem, as a start.

    Returns
    -------
    Reconstruction

    Raises
    ------
    Interrupted
        On Ctrl-C; it carries the best estimate so far.
    DomainError
        For views, scene and options that do not fit together.

    Examples
    --------
    A round cloud from its columns along three axes, with the integral of its density [m3] before and after:

    >>> import numpy as np
    >>> from skyscatter.inversion import ImageView, VoxelFrame, VoxelLights, VoxelModel, VoxelOptics, reconstruct
    >>> frame = VoxelFrame.cube(8, 1.0)
    >>> model = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1))
    >>> truth = np.exp(-4 * (frame.middles() ** 2).sum(axis=-1))
    >>> image = truth.sum(axis=2) * frame.cell[2]  # the same from all sides
    >>> x, y, z = np.eye(3)
    >>> views = [ImageView.parallel(image, 0.02, *axes, half_width=1.0) for axes in ((x, y), (y, z), (z, x))]
    >>> found = reconstruct(views, model)
    >>> found.density.shape  # component, x, y, z
    (1, 8, 8, 8)
    >>> f"{truth.sum() * frame.volume:.1f} {found.total():.1f}"
    '0.7 0.7'
    """
    stack, began = Stack(views), time.monotonic()
    settings = Settings(target, bool(freedom), prior_weight, iterations, stop, _rounds(multiple), samples, seed)
    settings.check()
    scene = None if isinstance(source, VoxelModel) else source
    model, wl, names, mask = _model(source, wavelengths, frame, free, step, interpolation, threads)
    if stack.data.shape[1] != model.background.size:
        raise DomainError("views", stack.data.shape[1], f"need data at {model.background.size} wavelengths")
    if settings.rounds and scene is None:
        raise DomainError("multiple", multiple, "needs a scene, whose light the solver path can follow")
    search = Search(model, stack, prior_of(prior), mask, settings, scene, wl, names, progress, checkpoint, began)
    search.executor = executor
    first = None if start is None else np.asarray(start, float).reshape(model.shape)
    search.recipe = _recipe(search, first, coarsest, deviation)
    if resume is not None:
        taken = search.take_up(resume)
        first = first if taken is None else taken
    try:
        search.run(_shapes(model.frame.shape, coarsest) if first is None else [model.frame.shape], first)
        if deviation:
            search.deviate(16 if deviation is True else int(deviation))
    except KeyboardInterrupt:
        raise Interrupted(search.result("interrupted")) from None
    return search.result(search.reason)


class Record:
    """What the long steps of a search have found, in their order.

    All else is quick and follows from them: a search that goes on takes them from here until they end, and so comes to
    the same bits.
    """

    def __init__(self, steps: Sequence[Mapping[str, Array]] = ()) -> None:
        self.steps = list(steps)
        self.next = 0

    def step(self, work: Callable[[], Mapping[str, Any]]) -> tuple[Mapping[str, Array], bool]:
        """What a step finds, and whether it was made just now."""
        new = self.next == len(self.steps)
        if new:
            self.steps.append({name: np.array(value) for name, value in work().items()})
        self.next += 1
        return self.steps[self.next - 1], new


class Search:
    """State of a reconstruction: the best estimate, what is taken off the data, and what was tried."""

    def __init__(
        self, model: VoxelModel, stack: Stack, prior: Prior, mask: NDArray[np.bool_], settings: Settings,
        scene: SpaceScene | None, wavelengths: Array, names: tuple[str, ...],
        progress: Callable[[float], None] | None, checkpoint: str | os.PathLike[str] | None, began: float,
    ) -> None:  # fmt: skip
        self.executor: Any = None
        self.model, self.stack, self.prior, self.mask = model, stack, prior, mask
        self.settings, self.scene, self.wavelengths, self.names = settings, scene, wavelengths, names
        self.progress, self.checkpoint, self.began = progress, checkpoint, began
        self.offset, self.extra = np.zeros_like(stack.data), np.zeros_like(stack.data)
        self.scale = np.ones(model.shape[0])
        self.weight = settings.weight if settings.weight is not None else np.nan
        self.history: list[dict[str, Any]] = []
        self.problem: Problem | None = None
        self.best: Best | None = None
        self.deviation: Array | None = None
        self.record, self.recipe = Record(), ""
        self.reason, self.round, self.share, self.freedom = "", 0, (0.0, 1.0), 0.0

    def run(self, shapes: list[tuple[int, int, int]], first: Array | None) -> None:
        """From the coarsest grid to the finest, with rounds of multiple scattering on each."""
        density = first
        for level, shape in enumerate(shapes):
            # Work goes with the number of cells of the grids to come; the last one is most of it.
            sizes = np.array([float(np.prod(s)) ** (2 / 3) for s in shapes])
            self.share = (float(sizes[:level].sum() / sizes.sum()), float(sizes[: level + 1].sum() / sizes.sum()))
            frame = self.model.frame.with_shape(shape)
            model = replace(self.model, frame=frame)
            if density is None:
                density = self._begin(model)
            elif density.shape[1:] != shape:
                density = np.stack([resampled(part, shape) for part in density])
            self._settle(model, density)
            if level == 0 and first is None and not self.prior.scale_free:
                density = self._measure()
                self._settle(model, density)
            # Light scattered more than once hardly depends on fine detail: the coarser grids find it.
            last = level == len(shapes) - 1
            for _ in range(self.settings.rounds if level == 0 else 1 if self.settings.rounds else 0):
                assert self.problem is not None
                assert self.best is not None
                self.round += 1
                self._add_multiple(self.problem.density(self.best.x))
                self._settle(model, self.problem.density(self.best.x), quick=not last)
            assert self.problem is not None
            assert self.best is not None
            density = self.problem.density(self.best.x)

    def _begin(self, model: VoxelModel) -> Array:
        """Uniform densities, as much of each as the data ask for when it is thin."""
        s, density = self.stack, np.zeros(model.shape)
        weight, fixed = s.weight, self._fixed(model)
        problem = self._problem(model, fixed)
        x = np.zeros((int(self.mask.sum()), *model.frame.shape))
        dark = s.data - problem.images(x)
        density[~self.mask] = fixed[~self.mask]
        for k, c in enumerate(np.flatnonzero(self.mask)):
            unit = np.zeros_like(x)
            unit[k] = 1.0
            column = problem.push(x, unit)
            amount = float(np.sum(weight * dark * column) / max(np.sum(weight * column**2), 1e-300))
            if not amount > 0:
                # Less light than without it, or none: begin with what dims light by a hundredth.
                depth = float(np.max(model.optics.sigma_t[c])) * float(np.max(model.frame.cell * model.frame.shape))
                amount = 0.01 / depth if depth > 0 else 1.0
            self.scale[c] = amount
            density[c] = amount / max(int(self.mask.sum()), 1)
        return density

    def _measure(self) -> Array:
        """Take the mean density of the matter as its unit, and begin anew from the estimate."""
        assert self.problem is not None
        assert self.best is not None
        density = self.problem.density(self.best.x)
        for c in np.flatnonzero(self.mask):
            if density[c].any():
                self.scale[c] = float(np.sum(density[c] ** 2) / np.sum(density[c]))
        self.weight = np.nan if self.settings.weight is None else self.settings.weight
        return density

    def _fixed(self, model: VoxelModel) -> Array:
        fixed = np.zeros(model.shape)
        if self.scene is not None:
            middles = model.frame.middles()
            for c, part in enumerate(self.scene.medium.fields):
                if not self.mask[c]:
                    fixed[c] = part.density(middles.reshape(-1, 3)).reshape(model.frame.shape)
        return fixed

    def _problem(self, model: VoxelModel, fixed: Array) -> Problem:
        return Problem(model, self.stack, self.offset, self.extra, self.prior, self.mask, fixed, self.scale)

    def _add_multiple(self, density: Array) -> None:
        assert self.scene is not None
        assert self.problem is not None
        s, frame = self.settings, self.problem.model.frame
        scene = with_density(self.scene, frame, density, self.model.interpolation)

        def work() -> dict[str, Any]:
            mean, error = multiple_light(
                scene, self.stack, self.wavelengths, samples=s.samples, seed=s.seed + 1000 * self.round,
                threads=self.model.threads, executor=self.executor,
            )  # fmt: skip
            return {"mean": mean, "error": error}

        found, new = self.record.step(work)
        # More dust in one round is less in the next: without damping the rounds swing about where they end.
        share = DAMPING if self.round > 1 else 1.0
        self.offset = self.offset + share * (found["mean"] - self.offset)
        self.extra = (1 - share) ** 2 * self.extra + share**2 * found["error"] ** 2
        self._keep(new)

    def _settle(self, model: VoxelModel, density: Array, quick: bool = False) -> None:
        """Find the estimate on one grid: lower the prior's weight until the data are explained."""
        s = self.settings
        problem = self._problem(model, self._fixed(model))
        x = density[self.mask] / self.scale[self.mask][:, None, None, None]
        self.problem, self.best = problem, Best(x)
        diagonal = problem.data_diagonal(x, s.seed)
        if s.weight is not None:
            self._minimise(x, s.weight, diagonal)
            self.reason = "weight of the prior was given"
            return
        if np.isnan(self.weight):
            # Begin where the prior outweighs the data tenfold.
            self.weight = 10 * float(diagonal.mean() / max(problem.prior_diagonal(x).mean(), 1e-300))
        elif not quick:
            self.weight *= COOLING
        self._cool(x, diagonal, s.target * self.stack.count)
        if s.freedom and not quick and model.frame.shape == self.model.frame.shape:
            self._count_freedom(diagonal)

    def _count_freedom(self, diagonal: Array) -> None:
        """Lower the prior's weight until chi^2 is the number of data less the degrees of freedom."""
        from skyscatter.inversion.uncertainty import degrees_of_freedom

        assert self.problem is not None
        assert self.best is not None
        for _ in range(COUNTS):
            x = self.best.x
            stretch = self.problem.stretch(x, diagonal, self.weight)
            freedom = partial(degrees_of_freedom, self.problem, x, self.weight, stretch, self.settings.seed)
            found, new = self.record.step(partial(_named, "freedom", freedom))
            self.freedom = float(found["freedom"])
            self._keep(new)
            goal = self.settings.target * (self.stack.count - self.freedom)
            if self.best.chi2 <= (1 + NEAR_TARGET) * goal:
                return
            self._cool(x, diagonal, goal)

    def _cool(self, x: Array, diagonal: Array, goal: float) -> None:
        tried: list[tuple[float, float, Array]] = []
        for _ in range(MOST_WEIGHTS):
            best = self._minimise(x, self.weight, diagonal)
            x = best.x
            if tried and best.chi2 > goal and best.chi2 > (1 - STANDSTILL) * tried[-1][1]:
                # A weaker prior explains no more: what is left over is not the density's.
                self.weight, chi2, x = tried[-1]
                best.x, best.chi2 = x, chi2
                self.reason = "a weaker prior explains no more of the data"
                return
            tried.append((self.weight, best.chi2, x))
            if best.chi2 <= goal:
                break
            self.weight /= COOLING
        self.reason = "chi^2 reached its target" if tried[-1][1] <= goal else "the weakest prior that is tried"
        if tried[-1][1] < (1 - NEAR_TARGET) * goal:
            self._back_up(tried, diagonal, goal)

    def _back_up(self, tried: list[tuple[float, float, Array]], diagonal: Array, goal: float) -> None:
        """Too well explained: a stronger prior, by interpolation, or steps up where none was tried."""
        for _ in range(4):
            low = min((t for t in tried if t[1] <= goal), key=lambda t: abs(t[1] - goal))
            above = [t for t in tried if t[1] > goal]
            if above:
                high = min(above, key=lambda t: t[1])
                a, b = np.log([low[1] / goal, high[1] / goal])
                share = float(np.clip(-a / (b - a), 0.1, 0.9))
                self.weight = float(np.exp((1 - share) * np.log(low[0]) + share * np.log(high[0])))
            else:
                self.weight = COOLING * max(t[0] for t in tried)
            best = self._minimise(low[2], self.weight, diagonal)
            tried.append((self.weight, best.chi2, best.x))
            if abs(best.chi2 - goal) < NEAR_TARGET * goal:
                break
        assert self.best is not None
        self.weight, self.best.chi2, self.best.x = min(tried, key=lambda t: abs(np.log(t[1] / goal)))

    def _minimise(self, x: Array, weight: float, diagonal: Array) -> Best:
        assert self.problem is not None
        assert self.best is not None
        self.weight = weight
        problem, best, before = self.problem, self.best, self.best.iterations
        stretch = problem.stretch(x, diagonal, weight)

        def work() -> dict[str, Any]:
            problem.minimise(x, weight, stretch, best, self.settings.iterations, self.settings.stop)
            return vars(best)

        found, new = self.record.step(work)
        best.x, best.value, best.chi2 = found["x"], float(found["value"]), float(found["chi2"])
        best.iterations, best.evaluations = int(found["iterations"]), int(found["evaluations"])
        self.history.append({
            "cells": list(self.problem.model.frame.shape), "weight": weight, "chi2": self.best.chi2,
            "count": self.stack.count, "iterations": self.best.iterations - before, "round": self.round,
            "seconds": time.monotonic() - self.began,
        })  # fmt: skip
        if self.progress is not None:
            done = sum(h["cells"] == self.history[-1]["cells"] for h in self.history)
            low, high = self.share
            self.progress(low + (high - low) * (1 - 0.7**done))
        self._keep(new)
        return self.best

    def _keep(self, new: bool) -> None:
        """Write the checkpoint after a step that was made just now."""
        if self.checkpoint is not None and new:
            steps = {f"step_{k}_{name}": a for k, step in enumerate(self.record.steps) for name, a in step.items()}
            self.result("not finished").save(self.checkpoint, recipe=np.array(self.recipe), **steps)

    def take_up(self, path: str | os.PathLike[str]) -> Array | None:
        """Go on from a checkpoint, or from a result: the densities to begin with on the finest grid."""
        kept = Reconstruction.load(path)
        if kept.frame.low != self.model.frame.low or kept.frame.high != self.model.frame.high:
            raise DomainError("resume", "a checkpoint", "was begun with another frame; repeat the call as it was")
        if kept.names != self.names or kept.count != self.stack.count:
            raise DomainError("resume", "a checkpoint", "was begun with other components or views")
        steps: dict[int, dict[str, Array]] = {}
        with np.load(path, allow_pickle=False) as file:
            if "recipe" in file.files:
                if str(file["recipe"]) != self.recipe:
                    raise DomainError("resume", str(path), "was begun with other data or options; repeat it as it was")
                for name in (one for one in file.files if one.startswith("step_")):
                    _, number, what = name.split("_", 2)
                    steps.setdefault(int(number), {})[what] = file[name]
                self.record = Record([steps[k] for k in sorted(steps)])
                return None
        self.history = list(kept.history)
        self.weight = self.settings.weight if self.settings.weight is not None else kept.prior_weight
        self.scale = np.asarray(kept.diagnostics["scale"], float)
        flat = [m.reshape(-1, m.shape[2]) for m in kept.multiple]
        self.offset = np.concatenate(flat)
        return np.stack([resampled(part, self.model.frame.shape) for part in kept.density])

    def deviate(self, count: int) -> None:
        """Standard deviations by samples of the posterior about the estimate."""
        from skyscatter.inversion.uncertainty import posterior_deviation

        assert self.problem is not None
        assert self.best is not None
        x, s = self.best.x, self.settings
        diagonal = self.problem.data_diagonal(x, s.seed)
        stretch = self.problem.stretch(x, diagonal, self.weight)
        deviation = partial(posterior_deviation, self.problem, x, self.weight, stretch, count, s.seed)
        found = self.record.step(partial(_named, "deviation", deviation))[0]["deviation"]
        self.deviation = np.zeros(self.problem.model.shape)
        self.deviation[self.mask] = found * self.scale[self.mask][:, None, None, None]

    def result(self, reason: str) -> Reconstruction:
        """The best estimate, and what it explains."""
        if self.problem is None or self.best is None:
            raise SkyscatterError("interrupted before the first estimate; nothing is kept")
        fitted = self.problem.images(self.best.x)
        residual = np.sqrt(self.problem.weight) * (self.stack.data - fitted)
        about = {
            "reason": reason, "evaluations": self.best.evaluations, "seconds": time.monotonic() - self.began,
            "scale": self.scale.tolist(), "prior": repr(self.prior), "rounds": self.round,
            "freedom": self.freedom, "multiple_error": float(np.sqrt(self.extra.mean())),
        }  # fmt: skip
        s = self.stack
        return Reconstruction(
            self.problem.model.frame, self.names, self.problem.density(self.best.x), self.deviation,
            tuple(s.split(fitted)), tuple(s.split(residual)), tuple(s.split(self.offset)),
            float(np.sum(residual**2)), s.count, float(self.weight), tuple(self.history), about,
        )  # fmt: skip


def _named(name: str, work: Callable[[], Any]) -> dict[str, Any]:
    return {name: work()}


def _recipe(search: Search, first: Array | None, coarsest: int, deviation: bool | int) -> str:
    """A hash of all that decides what is found."""
    digest = hashlib.blake2b(digest_size=16)
    stack, model = search.stack, search.model
    arrays = [stack.data, stack.weight, stack.origins, stack.directions, search.mask, search.wavelengths, first]
    for values in (*arrays, *model.optics, *model.lights, model.background):
        digest.update(b"none" if values is None else np.ascontiguousarray(values).tobytes())
    words = (
        search.settings,
        repr(search.prior),
        model.frame,
        model.interpolation,
        model.step,
        model.near,
        model.fine,
        coarsest,
        deviation,
    )
    digest.update("\n".join(map(repr, words)).encode())
    return digest.hexdigest()


def _rounds(multiple: bool | int) -> int:
    return 3 if multiple is True else int(multiple)


def _model(
    source: SpaceScene | VoxelModel, wavelengths: ArrayLike | None, frame: VoxelFrame | None,
    free: Sequence[str] | None, step: float, interpolation: Literal["linear", "nearest"], threads: int | None,
) -> tuple[VoxelModel, Array, tuple[str, ...], NDArray[np.bool_]]:  # fmt: skip
    """The model on the finest grid, its wavelengths, the names of the components, and which of them are sought."""
    if isinstance(source, VoxelModel):
        if wavelengths is not None or frame is not None or free is not None or interpolation != "linear":
            raise DomainError(
                "source", "VoxelModel", "has its own frame, wavelengths, interpolation; leave them and free out"
            )
        names = tuple(f"component{c}" for c in range(source.shape[0]))
        return replace(source, threads=threads or source.threads), np.zeros(0), names, np.ones(len(names), bool)
    if wavelengths is None:
        raise DomainError("wavelengths", None, "are needed with a scene [nm]")
    names = tuple(c.name for c in source.medium.components)
    for name in free or ():
        source.medium.component(name)
    model = VoxelModel.from_scene(source, wavelengths, frame, step=step, interpolation=interpolation, threads=threads)
    mask = np.array([free is None or name in free for name in names])
    if not mask.any():
        raise DomainError("free", free, f"choose at least one of {', '.join(names)}")
    return model, np.atleast_1d(np.asarray(wavelengths, float)), names, mask


def _shapes(finest: tuple[int, int, int], coarsest: int) -> list[tuple[int, int, int]]:
    """Shapes of the grids, each half as fine as the next."""
    shapes = [finest]
    while min(shapes[0]) >= 2 * coarsest:
        a, b, c = ((n + 1) // 2 for n in shapes[0])
        shapes.insert(0, (a, b, c))
    return shapes


def resampled(values: Array, shape: tuple[int, int, int]) -> Array:
    """Densities on other cells of the same box, trilinear and never negative."""
    from scipy.ndimage import zoom

    factors = [n / m for n, m in zip(shape, values.shape, strict=True)]
    return np.maximum(zoom(values, factors, order=1, mode="nearest", grid_mode=True), 0.0)
