"""Parameters, a subject and observations put together: data as a function of the state z."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.inversion import elsewhere
from skyscatter.inversion.datumunits import refuse_implausible
from skyscatter.inversion.observations import Linearisation, Observation, Prediction, Run
from skyscatter.inversion.parameters import Parameter, Subject, apply

if TYPE_CHECKING:
    from skyscatter.tasks.engine import Engine

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Forward:
    """The model of all data together.

    Attributes
    ----------
    parameters : sequence of Parameter
    subject : Subject
        Into which they are written.
    observations : sequence of Observation
    run : Run
    model_error : float, optional
        Relative standard deviation of the model in the place of what the solver states.
    """

    parameters: Sequence[Parameter]
    subject: Subject
    observations: Sequence[Observation]
    run: Run
    model_error: float | None = None
    #: Called with the number of predictions that a call is worth, after it.
    tick: Callable[[float], None] | None = None
    #: What runs the model for states, and for parts of the data, that do not depend on each other.
    engine: Engine | None = None

    @property
    def y(self) -> Array:
        """All data (datum,)."""
        return np.concatenate([o.values for o in self.observations])

    @property
    def sigma(self) -> Array:
        """Standard deviation of their noise (datum,), as it came with the data."""
        return np.concatenate([o.sigma for o in self.observations])

    def noise_variance(self, value: Array) -> Array:
        """Variance of the noise (datum,) where the model says `value` (datum,)."""
        ends = np.cumsum([o.values.size for o in self.observations])[:-1]
        parts = np.split(value, ends)
        return np.concatenate([o.noise_at(v) ** 2 for o, v in zip(self.observations, parts, strict=True)])

    def refuse_other_units(self, value: Array) -> None:
        """Refuse data whose unit nobody has stated, where the model's first guess `value` (datum,) is far from them."""
        ends = np.cumsum([o.values.size for o in self.observations])[:-1]
        for observation, guess in zip(self.observations, np.split(value, ends), strict=True):
            if not observation.stated:
                refuse_implausible(observation.values, guess, observation.unit)

    def values(self, z: Array) -> Array:
        """Values of the parameters (parameter,) at a state."""
        return np.array([p.prior.value(float(x)) for p, x in zip(self.parameters, z, strict=True)])

    def slopes(self, z: Array) -> Array:
        """Derivatives of the values by the state (parameter,)."""
        return np.array([p.prior.slope(float(x)) for p, x in zip(self.parameters, z, strict=True)])

    def state(self, values: Sequence[float]) -> Array:
        """State (parameter,) of values."""
        return np.array([p.prior.state(float(v)) for p, v in zip(self.parameters, values, strict=True)])

    def start(self) -> Array:
        """The model's own numbers where their priors hold them, the middle of the prior elsewhere."""
        own = [p.get(self.subject) for p in self.parameters]
        held = [p.prior.holds(v) for p, v in zip(self.parameters, own, strict=True)]
        return np.array(
            [
                np.clip(p.prior.state(v), -2.0, 2.0) if h else 0.0
                for p, v, h in zip(self.parameters, own, held, strict=True)
            ]
        )

    def subject_at(self, z: Array) -> Subject:
        """Model, Sun and nuisance parameters at a state."""
        return apply(self.parameters, self.subject, self.values(z).tolist())

    def predict(self, z: Array) -> Prediction:
        """All data at a state, and the model's error."""
        if self.engine is None:
            subject = self.subject_at(z)
            parts = [o.predict(subject, self.run) for o in self.observations]
        else:
            parts = elsewhere.by_parts(self, elsewhere.predict_part, z)
        self._tell(1.0)
        value = np.concatenate([p.value for p in parts])
        return Prediction(value, self._error(value, np.concatenate([p.error for p in parts])))

    def predictions(self, states: Array) -> Iterator[Prediction]:
        """All data at each of many states (state, parameter), in their order."""
        if self.engine is None:
            yield from (self.predict(z) for z in states)
            return
        for found in elsewhere.by_states(self, states):
            self._tell(1.0)
            yield found

    def linearise(self, z: Array, steps: Array) -> Linearisation:
        """All data at a state and their derivatives by it."""
        active = [not p.nuisance for p in self.parameters]
        if self.engine is None:
            parts = [o.linearise(self.subject_at, z, steps, active, self.run) for o in self.observations]
        else:
            parts = elsewhere.by_parts(self, elsewhere.linearise_part, z, steps, active)
        self._tell(2.0 * z.size + 1)
        value = np.concatenate([p.value for p in parts])
        error = self._error(value, np.concatenate([p.error for p in parts]))
        return Linearisation(value, error, np.concatenate([p.jacobian for p in parts]))

    def _error(self, value: Array, stated: Array) -> Array:
        return stated if self.model_error is None else self.model_error * np.abs(value)

    def _tell(self, work: float) -> None:
        if self.tick is not None:
            self.tick(work)
