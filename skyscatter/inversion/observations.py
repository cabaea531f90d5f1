"""What the estimation asks of data: measured numbers with their noise, and a model of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.distributions import Distribution
from skyscatter.inversion.parameters import Subject
from skyscatter.solvers.options import Orders, Solver

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """How the forward model is run."""

    solver: Solver = field(default_factory=Orders)
    threads: int | None = None


class Prediction(NamedTuple):
    """What a model says that would be measured, each (datum,)."""

    value: Array
    error: Array  #: of the model itself: stated by the solver


class Linearisation(NamedTuple):
    """A prediction and its derivative with respect to the state z."""

    value: Array  #: (datum,)
    error: Array  #: (datum,)
    jacobian: Array  #: (datum, parameter)


class Observation:
    """Measured numbers; subclasses say what they are."""

    values: Array  #: (datum,)
    sigma: Array  #: standard deviation of independent noise (datum,)
    #: Whether the noise was stated as a share: then it is one of what should have been measured, not of what was.
    relative: bool = False
    #: Whether somebody has said in which unit the data are; else the first look at the model may doubt it.
    stated: bool = True
    unit: str
    kind: str  #: in words, for tables and plots
    #: Nuisance parameters: name -> (neutral value, usual prior).
    nuisances: Mapping[str, tuple[float, Distribution]]

    def parts(self) -> list[tuple[NDArray[np.int64], Observation]]:
        """Parts whose predictions do not depend on each other, and where their data stand: (datum,), observation."""
        return [(np.arange(self.values.size), self)]

    @property
    def sun(self) -> dict[str, float]:
        """Where the Sun stood, if all data have the same; else empty."""
        return {}

    def noise_at(self, value: Array) -> Array:
        """Standard deviation of the noise (datum,) where a model says `value` (datum,).

        A share of the measured value would give the lowest readings the greatest weight, and lead every estimate astray
        by the square of the share.
        """
        if not self.relative:
            return self.sigma
        floor = least_value(self.values)
        return np.asarray(self.sigma * np.maximum(np.abs(value), floor) / np.maximum(np.abs(self.values), floor))

    def coordinates(self) -> dict[str, Array]:
        """What tells the data apart, by name, each (datum,)."""
        raise NotImplementedError

    def predict(self, subject: Subject, run: Run) -> Prediction:
        """The data as a subject would make them."""
        raise NotImplementedError

    def linearise(
        self, subjects: Callable[[Array], Subject], z: Array, steps: Array, active: Sequence[bool], run: Run
    ) -> Linearisation:
        """Prediction and Jacobian at a state.

        Parameters
        ----------
        subjects : callable
            State (parameter,) -> subject.
        z, steps : ndarray, shape (parameter,)
            Where, and how far to go either way.
        active : sequence of bool
            Which parameters change the model (the others are nuisance parameters of the data).
        run : Run
        """
        return central_differences(lambda x: self.predict(subjects(x), run), z, steps)


def central_differences(predict: Callable[[Array], Prediction], z: Array, steps: Array) -> Linearisation:
    """Prediction and Jacobian of anything, by central differences, two predictions for each parameter."""
    middle = predict(z)
    jacobian = np.empty((middle.value.size, z.size))
    for k, step in enumerate(steps):
        ends = []
        for sign in (1.0, -1.0):
            there = z.copy()
            there[k] += sign * step
            ends.append(predict(there).value)
        jacobian[:, k] = (ends[0] - ends[1]) / (2 * step)
    return Linearisation(middle.value, middle.error, jacobian)


def model_of(subject: Subject, planet: bool, kind: str) -> Any:
    """The subject's model, which must be that of a planet for data of its sky, and of a nebula for a nebula's."""
    if subject.model.command != ("sky" if planet else "nebula"):
        sort = "a planet" if planet else "a nebula"
        raise DomainError("model", subject.model.name, f"the data are {kind}; give the model of {sort}")
    return subject.model


def common_sun(observations: Sequence[Observation]) -> dict[str, float]:
    """The Sun of all observations, where it is one."""
    suns = [observation.sun for observation in observations]
    return dict(suns[0]) if suns and all(sun == suns[0] for sun in suns) else {}


def checked_data(values: Any, sigma: Any, name: str) -> tuple[Array, Array]:
    """Measured values and their standard deviations as arrays of one shape; finite, and deviations above 0."""
    v = np.asarray(values, float).ravel()
    try:
        s = np.broadcast_to(np.asarray(sigma, float), v.shape).astype(float)
    except ValueError:
        raise DomainError("sigma", np.shape(sigma), f"one for each {name}, or one for all of them") from None
    if v.size == 0:
        raise DomainError(name, 0, "there are no data")
    if not np.all(np.isfinite(v)):
        raise DomainError(name, float(v[~np.isfinite(v)][0]), "data must be finite; leave out what was not measured")
    wrong = ~(np.isfinite(s) & (s > 0))
    if wrong.any():
        raise DomainError("sigma", float(s[wrong][0]), f"the standard deviation of a {name} is a number above 0")
    return v, s


def noise_of(values: Array, sigma: Any, noise: float | None, name: str) -> Array:
    """Standard deviations: those that the data came with, or a share of each value."""
    if sigma is not None and noise is not None:
        raise DomainError("noise", noise, "the data bring their own sigma; leave noise out")
    if sigma is not None:
        return np.asarray(sigma, float)
    if noise is None:
        raise DomainError("noise", None, f"the data have no column sigma; say how noisy each {name} is, such as 0.02")
    if not 0 < noise < 1:
        raise DomainError("noise", noise, "a relative standard deviation between 0 and 1, such as 0.02")
    return noise * np.maximum(np.abs(values), least_value(values))


def least_value(values: Array) -> float:
    """Below this a share of a value is taken of this instead: one next to nothing would be the surest of all."""
    return 1e-2 * float(np.nanmedian(np.abs(values)))
