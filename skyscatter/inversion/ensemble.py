"""Many fits of one model, each to data of its own: the same results whatever runs them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.fitresult import FitResult
from skyscatter.inversion.fitting import fit
from skyscatter.tasks.door import opened
from skyscatter.tasks.task import Shared, Task


def fit_each(
    model: Any,
    data: Sequence[Any],
    free: Mapping[str, Any] | Sequence[str],
    *,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> list[FitResult | ConvergenceError]:
    """Fit a model to every one of many sets of data, each by itself.

    Parameters
    ----------
    model : Model or NebulaModel or str or path
        As for `skyscatter.fit`.
    data : sequence
        For each fit what `skyscatter.fit` takes as its data.
    free : mapping or sequence of str
        As for `skyscatter.fit`.
    threads : int, optional
        Of each fit: all processors where they follow each other here, one with an `executor`, when not given.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        What runs the fits, as for `skyscatter.radiance`; one after the other when not given.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    **options
        Others of `skyscatter.fit`, but for ``resume``.

    Returns
    -------
    list of FitResult or ConvergenceError
        In the order of the data; in the place of a fit that could not lower its misfit the error that says so.

    Raises
    ------
    DomainError
        As `skyscatter.fit`.

    Examples
    --------
    The same zenith seen twice through different haze.

    >>> import skyscatter
    >>> from skyscatter.inversion import fit_each, radiance_table, with_values
    >>> def seen(depth):
    ...     truth = with_values(skyscatter.load_model("earth-simple"), {"aerosol.optical_depth": depth})
    ...     scene = truth.scene(sun_elevation_deg=30, sun_azimuth_deg=90)
    ...     light = skyscatter.radiance(scene, scene.observer.position, [0, 0, 1], [650], solver="single").radiance
    ...     return radiance_table([0], [90], [650], light, noise=0.02, sun_elevation_deg=30, sun_azimuth_deg=90)
    >>> found = fit_each(
    ...     "earth-simple", [seen(0.05), seen(0.1)], {"aerosol.optical_depth": (0.0, 0.5)}, solver="single"
    ... )
    >>> [f"{result.estimate['aerosol.optical_depth']:.2f}" for result in found]
    ['0.05', '0.10']
    """
    if "resume" in options:
        raise DomainError("resume", str(options["resume"]), "belongs to one fit; leave it out")
    if executor is None:
        found = {}
        for number, some in enumerate(data):
            found[number] = _one((model, free, {**options, "threads": threads}), some)
            if progress is not None:
                progress((number + 1) / len(data))
        return [found[number] for number in range(len(data))]
    shared = Shared((model, free, {**options, "threads": threads or 1}))
    found = {}
    with opened(executor) as engine:
        for task, result in engine.results(Task(_one, (some,), shared, k) for k, some in enumerate(data)):
            found[task.number] = result
            if progress is not None:
                progress(len(found) / len(data))
    return [found[number] for number in range(len(data))]


def _one(what: tuple[Any, Any, dict[str, Any]], data: Any) -> FitResult | ConvergenceError:
    """One of the fits."""
    model, free, options = what
    try:
        return fit(model, data, free, **options)
    except ConvergenceError as error:
        return error
