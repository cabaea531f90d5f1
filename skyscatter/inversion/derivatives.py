"""Derivatives of radiances with respect to the parameters of a scene, by any solver.

The scene and copies of it in which one parameter is a little larger or smaller are solved together as further channels
of the spectrum (`skyscatter.inversion.stack`): on the same grids and, with ``path``, along the same walks.  So the
symmetric difference of two copies is free of all that finite differences suffer from.  For Monte Carlo it is an
unbiased estimate: a walk drawn with the density p counts f / p in every copy, whose expectation is that copy's
radiance; the difference is that of f along one and the same walk, as in the replay of Vicini, Speierer & Jakob (2021),
ACM Trans. Graph. 40, 108.  What is left is the truncation of the symmetric difference, step^2 / 6 times the third
derivative, and the rounding of the solver over the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.stack import AnyScene, differences_forbid, stack
from skyscatter.solvers.options import Path, Solver, record_of
from skyscatter.solvers.run import radiance

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

#: Channels that are solved together at most; their tables take some 100 kB each.
MOST_CHANNELS = 512
#: Walks per ray in all, where nothing is said.
DEFAULT_SAMPLES = 256
#: Independent runs of a Monte Carlo solver, from whose spread the standard errors come.
RUNS = 16


@dataclass(frozen=True, repr=False)
class Derivatives(Brief):
    """Radiances and how they change with each parameter.

    Attributes
    ----------
    value : ndarray, shape (..., wavelength)
        Radiance [W m-2 sr-1 nm-1].
    standard_error : ndarray, shape (..., wavelength)
        As of `skyscatter.radiance`.
    jacobian : ndarray, shape (parameter, ..., wavelength)
        Derivatives of the radiance, per unit of the parameter.
    jacobian_error : ndarray, shape (parameter, ..., wavelength)
        Standard errors of those by Monte Carlo; 0 where the solver is deterministic.

    Examples
    --------
    Numbers of two parameters along two rays, as a solver would find them, with names:

    >>> import numpy as np
    >>> from skyscatter.inversion import Derivatives
    >>> value, jacobian = np.array([[0.02], [0.03]]), np.array([[[0.05], [0.04]], [[0.1], [0.2]]])
    >>> found = Derivatives(value, np.zeros_like(value), jacobian, np.zeros_like(jacobian))
    >>> labelled = found.to_xarray([550], ["haze", "ground"])
    >>> dict(labelled["derivative"].sizes)
    {'parameter': 2, 'ray': 2, 'wavelength': 1}
    >>> float(labelled["derivative"].sel(parameter="ground", wavelength=550)[1])
    0.2
    """

    value: Array
    standard_error: Array
    jacobian: Array
    jacobian_error: Array

    def to_xarray(
        self, wavelengths: ArrayLike, parameters: Sequence[str] | None = None, dims: Sequence[str] | None = None
    ) -> xarray.Dataset:
        """Label radiances and derivatives.

        Parameters
        ----------
        wavelengths : array_like, shape (wavelength,)
            Those that were asked for [nm].
        parameters : sequence of str, optional
            Names in the order of theta; their numbers when not given.
        dims : sequence of str, optional
            Names of the axes of the rays; ``ray``, or ``ray_0``, ``ray_1``, ..., when not given.

        Returns
        -------
        xarray.Dataset
            ``radiance`` and ``radiance_error``, (..., wavelength); ``derivative`` and ``derivative_error``,
            (parameter, ..., wavelength), of the radiance per unit of the parameter.

        Raises
        ------
        DomainError
            If the numbers of wavelengths, names or axes do not fit.
        """
        import xarray

        rays = self.value.ndim - 1
        names = list(range(len(self.jacobian))) if parameters is None else list(parameters)
        axes = ["ray"] * rays if rays < 2 else [f"ray_{k}" for k in range(rays)]
        axes = axes if dims is None else list(dims)
        wl = np.atleast_1d(np.asarray(wavelengths, float))
        if wl.shape != self.value.shape[-1:]:
            raise DomainError("wavelengths", wl.shape, f"the {self.value.shape[-1]} that were asked for")
        if len(names) != len(self.jacobian):
            raise DomainError("parameters", names, f"one name for each of {len(self.jacobian)} parameters")
        if len(axes) != rays or len({*axes, "wavelength", "parameter"}) != rays + 2:
            raise DomainError("dims", axes, f"different names for the {rays} axes of the rays")
        unit = "W m-2 sr-1 nm-1"
        of, slope = (*axes, "wavelength"), ("parameter", *axes, "wavelength")
        each = {"units": unit, "comment": "per unit of the parameter"}
        radiance = {"units": unit, "long_name": "spectral radiance per wavelength"}
        return xarray.Dataset(
            {
                "radiance": (of, self.value, {**radiance, "ancillary_variables": "radiance_error"}),
                "radiance_error": (of, self.standard_error, {"units": unit, "long_name": "error of the radiance"}),
                "derivative": (slope, self.jacobian, {**each, "long_name": "derivative of the radiance"}),
                "derivative_error": (slope, self.jacobian_error, {**each, "long_name": "standard error of it"}),
            },
            coords={
                "wavelength": ("wavelength", wl, {"units": "nm", "standard_name": "radiation_wavelength"}),
                "parameter": ("parameter", names),
            },
        )


def differentiate(
    scenes: Callable[[Array], AnyScene],
    theta: ArrayLike,
    steps: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    wavelengths: ArrayLike,
    *,
    solver: str | Solver = "orders",
    threads: int | None = None,
    executor: Any = None,
    progress: Callable[[float], None] | None = None,
) -> Derivatives:
    """Radiances along rays, and their derivatives with respect to parameters.

    Parameters
    ----------
    scenes : callable
        Makes the scene for parameters of shape (parameter,).
    theta : array_like, shape (parameter,)
        Where to differentiate.
    steps : array_like, shape (parameter,)
        Steps to either side.  The error of a derivative is steps^2 / 6 times the third one; a thousandth of the range
        over which the radiance changes is good with every solver.
    origins, directions, wavelengths
        As for `skyscatter.radiance`.
    solver : str or Orders or Path or Single
        As for `skyscatter.radiance`.  With ``path`` the walks of a ray, 256 when not given, are shared out among `RUNS`
        runs.
    threads, executor
        As for `skyscatter.radiance`.
    progress : callable, optional
        Called with the finished share, 0 to 1.

    Returns
    -------
    Derivatives

    Raises
    ------
    DomainError
        For steps that are not positive, for walks whose number is up to their noise, and for parameters at which a
        scene cannot be made.

    Notes
    -----
    Parameters that move something (the Sun, the observer, a star) cannot share paths with the others; their copies are
    solved by themselves, with the same seed.

    Examples
    --------
    The sky through the middle of a dark globule, per magnitude of its extinction: ln(10) / 2.5 of the light.

    >>> import skyscatter
    >>> from skyscatter import fields, inversion
    >>> dust = skyscatter.Component(
    ...     name="dust", density=fields.Plummer(radius="0.3 pc"), optics=skyscatter.Dust(visual_extinction=1)
    ... )
    >>> def scene(theta):
    ...     optics = skyscatter.Dust(visual_extinction=theta[0])
    ...     medium = skyscatter.Medium(components=(dust.model_copy(update={"optics": optics}),))
    ...     return skyscatter.SpaceScene(medium=medium, background=1e-9)
    >>> view = scene([1.0]).view
    >>> found = inversion.differentiate(scene, [1.0], [0.01], view.position, view.forward, [550], solver="single")
    >>> found.jacobian.shape  # parameter, wavelength
    (1, 1)
    >>> round(float(found.jacobian[0, 0] / found.value[0]), 2)
    -0.92
    """
    at, step = np.atleast_1d(np.asarray(theta, float)), np.atleast_1d(np.asarray(steps, float))
    if at.ndim != 1 or step.shape != at.shape:
        raise DomainError("steps", step.shape, f"one for each parameter, shape {at.shape}")
    if not np.all(step > 0):
        raise DomainError("steps", float(step.min()), "must be positive")
    base = scenes(at)
    pairs = [tuple(scenes(at + sign * row) for sign in (1, -1)) for row in np.diag(step)]
    rays: tuple[ArrayLike, ArrayLike] = (origins, directions)
    solvers = _runs(record_of(solver))
    groups = _groups(base, pairs, np.size(np.asarray(wavelengths)))
    done = 0

    def solve(copies: Sequence[AnyScene], how: Solver) -> tuple[Array, Array]:
        nonlocal done
        found = _solve_together(copies, rays, wavelengths, solver=how, threads=threads, executor=executor)
        done += 1
        if progress is not None:
            progress(done / (len(solvers) * len(groups)))
        return found

    runs = []
    for how in solvers:
        parts = [solve(copies, how) for copies, _ in groups]
        slopes: list[Any] = [None] * at.size
        for (values, _), (_, members) in zip(parts, groups, strict=True):
            first = 1 if len(values) % 2 else 0
            for place, number in enumerate(members):
                plus, minus = values[first + 2 * place], values[first + 2 * place + 1]
                slopes[number] = (plus - minus) / (2 * step[number])
        value, error = parts[0][0][0], parts[0][1][0]
        runs.append((value, error, np.stack(slopes) if slopes else np.zeros((0, *value.shape))))
    return _joined(runs)


def _runs(solver: Solver) -> list[Solver]:
    """The solver of each independent run: of walks several that share the samples, with seeds of their own."""
    if not isinstance(solver, Path):
        return [solver]
    if solver.noise is not None:
        raise DomainError("noise", solver.noise, "derivatives take a number of walks; give samples in its place")
    seeds = np.random.SeedSequence(solver.seed).generate_state(RUNS, np.uint64)
    wanted = DEFAULT_SAMPLES if solver.samples is None else int(solver.samples)
    samples = max(-(-wanted // RUNS), 2)  # fewer than two tell no error
    return [replace(solver, samples=samples, seed=int(seed) >> 1) for seed in seeds]


def _groups(
    base: AnyScene, pairs: Sequence[Sequence[AnyScene]], wavelengths: int
) -> list[tuple[list[AnyScene], list[int]]]:
    """Copies that are solved together, and the parameters that they belong to; the first group begins with the base."""
    groups: list[tuple[list[AnyScene], list[int]]] = [([base], [])]
    apart = []
    for number, pair in enumerate(pairs):
        if any(differences_forbid(base, copy) for copy in pair):
            apart.append(([*pair], [number]))
            continue
        if (len(groups[-1][0]) + 2) * wavelengths > MOST_CHANNELS and len(groups[-1][0]) > 1:
            # The base goes along, so that walks are shared with it in every group.
            groups.append(([base], []))
        groups[-1][0].extend(pair)
        groups[-1][1].append(number)
    return groups + apart


def _solve_together(
    copies: Sequence[AnyScene],
    rays: tuple[ArrayLike, ArrayLike],
    wavelengths: ArrayLike,
    **how: Any,
) -> tuple[Array, Array]:
    """Radiances and standard errors (copy, ..., wavelength), of copies with one geometry or of a pair without."""
    if any(differences_forbid(copies[0], other) for other in copies[1:]):
        answers = [radiance(copy, rays[0], rays[1], wavelengths, **how) for copy in copies]
        return np.stack([a.radiance for a in answers]), np.stack([a.standard_error for a in answers])
    stacked = stack(copies, wavelengths)
    answer = radiance(stacked.scene, rays[0], rays[1], stacked.channels.numbers, **how)
    return stacked.channels.split(answer.radiance), stacked.channels.split(answer.standard_error)


def _joined(runs: Sequence[tuple[Array, Array, Array]]) -> Derivatives:
    """Means over independent runs, with standard errors from their spread."""
    if len(runs) == 1:
        value, error, slopes = runs[0]
        return Derivatives(value, error, slopes, np.zeros_like(slopes))
    values, slopes = np.stack([r[0] for r in runs]), np.stack([r[2] for r in runs])
    root = np.sqrt(len(runs))
    return Derivatives(
        values.mean(axis=0), values.std(axis=0, ddof=1) / root, slopes.mean(axis=0), slopes.std(axis=0, ddof=1) / root
    )
