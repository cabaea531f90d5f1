"""`skyscatter.fit`: parameters of a model from data of any kind, with their uncertainties."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion.derivatives import DEFAULT_SAMPLES
from skyscatter.inversion.estimation import Estimate, optimal_estimation
from skyscatter.inversion.fitresult import FitResult
from skyscatter.inversion.fitstate import FitState
from skyscatter.inversion.forward import Forward
from skyscatter.inversion.observations import Observation, Run, common_sun
from skyscatter.inversion.parameters import Parameter, Subject, parse_free, resolve
from skyscatter.inversion.readers import read_observation
from skyscatter.memory import check_fits
from skyscatter.models.files import load_model
from skyscatter.solvers.options import Path, Solver, record_of
from skyscatter.tasks.door import opened

Array = NDArray[np.float64]

METHODS = ("optimal_estimation", "posterior")
#: Arrays of the size of the data, and of their derivatives by a parameter, in memory at once; measured, with caution.
DATA_COPIES, DERIVATIVE_COPIES = 30, 8


def fit(
    model: Any,
    data: Observation | str | os.PathLike[str] | Sequence[Any],
    free: Mapping[str, Any] | Sequence[str],
    *,
    solver: str | Solver = "orders",
    method: str = "optimal_estimation",
    noise: float | None = None,
    model_error: float | None = None,
    max_iterations: int = 20,
    steps: int = 1000,
    emulator: bool | None = None,
    seed: int = 0,
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
    resume: str | os.PathLike[str] | None = None,
) -> FitResult:
    """Fit parameters of a model to data.

    Parameters
    ----------
    model : Model or NebulaModel or str or path
        Or the name of a shipped one, or a model file.  What is not free keeps its number.
    data : Observation or path, or a list of them
        What was measured; see `skyscatter.inversion.read_observation` for files.
    free : mapping or sequence of str
        Name -> prior: two numbers are bounds, else a prior such as `skyscatter.inversion.Normal`, or None for the usual
        one of that name.  Or texts such as ``"haze.optical_depth=0:2"``, as on the command line.  For names see
        `skyscatter.inversion.parameters`.
    solver : str or Orders or Path or Single
        As for `skyscatter.radiance`; ``path`` has 256 walks per ray where nothing is said.
    method : {"optimal_estimation", "posterior"}
        The estimate of least cost with its linear covariance (Rodgers 2000), or a sample of the whole posterior.
    noise : float, optional
        Relative standard deviation of data that come without.
    model_error : float, optional
        Relative standard deviation of the forward model, in the place of the error that the solver states for itself.
    max_iterations : int
        Of the optimal estimation.
    steps : int
        Of each walker through the posterior, at least.
    emulator : bool, optional
        Let a quadratic polynomial, fitted to runs of the model around the estimate and judged by others, stand for
        the model in the posterior's walks (see
        `skyscatter.inversion.emulator`); False walks on the model itself.  True when not given.
    seed : int
        Of the sampling; walks have one of their own, ``Path(seed=...)``.
    threads : int, optional
        All processors when not given; with an `executor` one for each of its workers.
    executor : int, concurrent.futures.Executor or distributed.Client, optional
        As for `skyscatter.radiance`: what runs the model for data of different files, Suns and places at once, and,
        with method ``posterior``, for the states to which the emulator is fitted.  One table under one Sun has nothing
        of that kind for an optimal estimation: leave it to the threads.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    resume : path, optional
        Folder in which the state of the run is kept.  If it exists, the run goes on from it.

    Returns
    -------
    FitResult

    Raises
    ------
    DomainError
        For unknown names, bounds that no such number can have, unsuitable data, and data twenty times above or below
        the model at the start whose unit nobody has stated.
    ConvergenceError
        If the misfit cannot be lowered.

    Examples
    --------
    Radiances of the zenith and of a place near the Sun, made here with haze of an optical depth of 0.08, tell that
    depth.  Light scattered once is enough to show how.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.inversion import radiance_table, with_values
    >>> truth = with_values(skyscatter.load_model("earth-simple"), {"aerosol.optical_depth": 0.08})
    >>> scene = truth.scene(sun_elevation_deg=30, sun_azimuth_deg=90)
    >>> low = [np.cos(np.radians(20)), 0, np.sin(np.radians(20))]  # in the east
    >>> seen = skyscatter.radiance(scene, scene.observer.position, [[0, 0, 1], low], [650], solver="single").radiance
    >>> data = radiance_table(
    ...     [0, 90], [90, 20], [650, 650], seen[:, 0], noise=0.02, sun_elevation_deg=30, sun_azimuth_deg=90
    ... )
    >>> found = skyscatter.fit("earth-simple", data, {"aerosol.optical_depth": (0.0, 0.5)}, solver="single")
    >>> name = "aerosol.optical_depth"
    >>> f"{found.estimate[name]:.2f} +- {found.standard_deviation[name]:.3f}"
    '0.08 +- 0.002'
    """
    if method not in METHODS:
        raise DomainError("method", method, f"choose from {', '.join(METHODS)}")
    if max_iterations < 1:
        raise DomainError("max_iterations", max_iterations, "a whole number, at least 1")
    if model_error is not None and not 0 <= model_error < 1:
        raise DomainError("model_error", model_error, "a relative standard deviation from 0 to below 1, such as 0.005")
    _check_posterior(method, steps, emulator)
    chosen = load_model(os.fspath(model)) if isinstance(model, (str, os.PathLike)) else model
    observations = _observations(data, noise)
    run = Run(_solver(solver), threads)
    parameters, subject = free_parameters(chosen, free, observations)
    _check_memory(Forward(parameters, subject, observations, run, model_error))
    settings: dict[str, Any] = {
        "free": {p.name: str(p.prior) for p in parameters}, "solver": run.solver.name, "method": method, "seed": seed,
        "options": _recorded(run.solver), "model_error": model_error,
    }  # fmt: skip
    walking = method == "posterior"
    if walking:
        settings |= {"steps": steps, "emulator": emulator is not False}
    with nullcontext() if executor is None else opened(executor) as engine:
        forward = Forward(parameters, subject, observations, run, model_error, engine=engine)
        emulated = emulator is not False if walking else None
        return _found(forward, settings, method, max_iterations, steps, emulated, seed, progress, resume)


def _found(
    forward: Forward,
    settings: dict[str, Any],
    method: str,
    max_iterations: int,
    steps: int,
    emulated: bool | None,
    seed: int,
    progress: Callable[[float], None] | None,
    resume: str | os.PathLike[str] | None,
) -> FitResult:
    """The result of a fit; `emulated` is None where no posterior is walked through."""
    state, walking = FitState(resume, {"settings": settings, **_digest(forward)}), emulated is not None
    kept = state.load() or {}
    share = 0.2 if walking else 1.0
    estimate = _estimate(forward, max_iterations, progress and _part(progress, 0.0, share), state, kept)
    if not walking:
        return _result(forward, estimate, method, settings)
    if emulated and not estimate.converged:
        raise ConvergenceError(
            f"the estimate around which the model would be emulated has not converged in {estimate.iterations} "
            "iterations; allow more (max_iterations), or look first at what method optimal_estimation finds"
        )
    from skyscatter.inversion.posterior import sample_posterior

    found = sample_posterior(
        forward, estimate, state, kept, steps=steps, seed=seed, emulated=bool(emulated),
        progress=progress and _part(progress, share, 1.0),
    )  # fmt: skip
    return _sampled(forward, _result(forward, estimate, method, settings), found)


def _check_memory(forward: Forward) -> None:
    """Refuse data whose derivatives memory does not hold."""
    values, free = sum(o.values.size for o in forward.observations), len(forward.parameters)
    check_fits(
        8.0 * values * (DATA_COPIES + DERIVATIVE_COPIES * free), "data", f"{values} values",
        f"with {free} free parameter{'s' * (free != 1)} they take",
        "average pixels (pixels), or leave wavelengths and directions out",
    )  # fmt: skip


def _check_posterior(method: str, steps: int, emulator: bool | None) -> None:
    if method != "posterior":
        if emulator is not None:
            raise DomainError("emulator", emulator, "belongs to method posterior; leave it out")
        return
    if steps < 10:
        raise DomainError("steps", steps, "a whole number, at least 10")
    from skyscatter.inversion.posterior import require_emcee

    require_emcee()  # before any time is spent


def _part(progress: Callable[[float], None], low: float, high: float) -> Callable[[float], None]:
    return lambda share: progress(low + (high - low) * share)


def _solver(solver: str | Solver) -> Solver:
    """The record of a solver, with as many walks as derivatives need where nothing is said."""
    how = record_of(solver)
    plain = isinstance(how, Path) and how.samples is None and how.noise is None
    return replace(how, samples=DEFAULT_SAMPLES) if isinstance(how, Path) and plain else how


def _recorded(how: Solver) -> dict[str, Any]:
    """Options of a solver as results hold them: the seed where there are walks."""
    return {name: value for name, value in how.given.items() if name != "seed" or isinstance(how, Path)}


def _observations(data: Any, noise: float | None) -> list[Observation]:
    items = list(data) if isinstance(data, (list, tuple)) else [data]
    if not items:
        raise DomainError("data", data, "there are no data")
    found = []
    for item in items:
        if isinstance(item, (str, os.PathLike)):
            found.append(read_observation(item, noise=noise))
        elif not isinstance(item, Observation):
            raise DomainError("data", type(item).__name__, "give observations, or paths of files")
        elif noise is not None:
            raise DomainError("noise", noise, "these data bring their own sigma; leave noise out")
        else:
            found.append(item)
    return found


def free_parameters(
    model: Any, free: Mapping[str, Any] | Sequence[str], observations: Sequence[Observation]
) -> tuple[list[Parameter], Subject]:
    """Parameters by their names, and the subject into which they are written."""
    pairs = list(free.items()) if isinstance(free, Mapping) else [parse_free(text) for text in free]
    if not pairs:
        raise DomainError("free", "nothing", "name at least one parameter, for instance haze.optical_depth")
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise DomainError("free", name, "is named twice; give each parameter once")
    nuisances: dict[str, Any] = {}
    for observation in observations:
        nuisances.update(observation.nuisances)
    subject = Subject(model, common_sun(observations))
    parameters = [resolve(name, prior, subject, nuisances) for name, prior in pairs]
    wanted = {name.partition(".")[2] for name in names if name.startswith("sun.")}
    # Only what is free may overrule the Sun that the data state.
    return parameters, Subject(model, {name: value for name, value in subject.sun.items() if name in wanted})


def _digest(forward: Forward) -> dict[str, Any]:
    """What tells models and data apart."""
    return {
        "model": forward.subject.model.model_dump(mode="json", exclude_none=True),
        "data": hashlib.blake2b(forward.y.tobytes() + forward.sigma.tobytes(), digest_size=16).hexdigest(),
    }


def _estimate(
    forward: Forward,
    max_iterations: int,
    progress: Callable[[float], None] | None,
    state: FitState,
    kept: dict[str, Any],
) -> Estimate:
    """The state of least cost; from where an earlier run stood, with what it kept in `kept`."""

    def keep(now: dict[str, Any]) -> None:
        kept.update(now)
        state.keep(**kept)
        if progress is not None:
            progress(min(now["iterations"] / max_iterations, 1.0))

    if "estimate_z" in kept:  # an earlier run came so far
        return Estimate(**{f.name: _plain(kept[f"estimate_{f.name}"]) for f in fields(Estimate)})
    found = optimal_estimation(
        forward, forward.start(), max_iterations=max_iterations, kept=dict(kept), keep=keep,
        check=forward.refuse_other_units,
    )  # fmt: skip
    kept.update({f"estimate_{f.name}": np.asarray(getattr(found, f.name)) for f in fields(Estimate)})
    state.keep(**kept)
    if progress is not None:
        progress(1.0)
    return found


def _plain(value: Array) -> Any:
    """An array from a file, or the number that it holds."""
    return value if value.ndim else value.item()


def _sampled(forward: Forward, plain: FitResult, found: Any) -> FitResult:
    """The result with the posterior's mean and covariance in the place of the linear ones."""
    z = found.samples.mean(axis=0)
    fitted = forward.predict(z)
    noise = forward.noise_variance(fitted.value)
    return replace(
        plain, z=z, covariance_z=np.atleast_2d(np.cov(found.samples, rowvar=False)), samples_z=found.samples,
        diagnostics=found.diagnostics, fitted=fitted.value, model_error=fitted.error,
        noise=np.sqrt(noise),
        chi2=float(np.sum((forward.y - fitted.value) ** 2 / (noise + fitted.error**2))),
        model=forward.subject_at(z).model,
    )  # fmt: skip


def _result(forward: Forward, estimate: Estimate, method: str, settings: Mapping[str, Any]) -> FitResult:
    return FitResult(
        names=tuple(p.name for p in forward.parameters), units=tuple(p.unit for p in forward.parameters),
        priors=tuple(p.prior for p in forward.parameters), z=estimate.z, covariance_z=estimate.covariance,
        averaging_kernel_z=estimate.averaging_kernel, noise_covariance_z=estimate.noise_covariance,
        smoothing_covariance_z=estimate.smoothing_covariance, measured=forward.y,
        noise=np.sqrt(forward.noise_variance(estimate.value)),
        fitted=estimate.value, model_error=estimate.model_error, chi2=estimate.chi2, iterations=estimate.iterations,
        converged=estimate.converged, method=method, solver=forward.run.solver.name,
        model=forward.subject_at(estimate.z).model,
        coordinates=[
            {"kind": o.kind, "unit": o.unit, "size": int(o.values.size), **o.coordinates()}
            for o in forward.observations
        ],
        settings=settings,
    )  # fmt: skip
