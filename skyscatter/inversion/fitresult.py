"""What a fit found: estimate, covariance, diagnostics, and the forward residual."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.inversion import distributions
from skyscatter.inversion.distributions import Distribution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Version of the file layout.
FILE_VERSION = 1
_ARRAYS = (
    "z", "covariance_z", "averaging_kernel_z", "noise_covariance_z", "smoothing_covariance_z", "measured", "noise",
    "fitted", "model_error", "samples_z",
)  # fmt: skip


@dataclass(frozen=True)
class FitResult:
    """Result of `skyscatter.fit`.

    Arrays whose names end in ``_z`` are in the state of the estimation, in which every prior is a standard normal one;
    without it they are in the parameters' own units, by the slope of the prior's map (first order for covariances).

    Attributes
    ----------
    names, units : tuple of str
    priors : tuple of Distribution
    z : ndarray, shape (parameter,)
        State of least cost, or the mean of the samples.
    covariance_z : ndarray, shape (parameter, parameter)
    averaging_kernel_z, noise_covariance_z, smoothing_covariance_z : ndarray, shape (parameter, parameter)
        See `estimation.Estimate`.
    measured, noise, fitted, model_error : ndarray, shape (datum,)
        Data with the standard deviation of their noise, the model at the estimate with its own.
    chi2 : float
        Of the residual, by both variances.
    iterations : int
    converged : bool
    method, solver : str
    model : Model or NebulaModel
        With the estimate in it.
    samples_z : ndarray, shape (sample, parameter)
        Draws from the posterior; empty for optimal estimation.
    coordinates : sequence of mappings
        For each observation its kind, unit, number of data, and what tells its data apart.
    diagnostics : mapping
        Of the sampling: acceptance, autocorrelation, ...
    settings : mapping
        What the fit was asked.

    Examples
    --------
    A picture of a dark globule, and its extinction [mag] found back from half as much; a solver is asked twice.

    >>> import skyscatter
    >>> from skyscatter import fields, inversion
    >>> dust = skyscatter.Component(
    ...     name="dust", density=fields.Plummer(radius="0.3 pc"), optics=skyscatter.Dust(visual_extinction=1)
    ... )
    >>> model = skyscatter.NebulaModel(
    ...     name="globule", view=skyscatter.View(distance="400 pc"), components=(dust,), background=1e-9
    ... )
    >>> camera = skyscatter.Telescope.from_field_of_view(8, 8, 0.1)  # pixels, degrees
    >>> picture = skyscatter.render(model.scene(), camera, [550], solver="single")
    >>> start = inversion.with_values(model, {"dust.visual_extinction": 0.5})
    >>> data = inversion.nebula_image(picture, noise=0.02)
    >>> found = skyscatter.fit(start, data, {"dust.visual_extinction": (0, 3)}, solver="single")
    >>> f"{found.estimate['dust.visual_extinction']:.2f} +- {found.standard_deviation['dust.visual_extinction']:.2f}"
    '1.00 +- 0.01'
    >>> f"{found.degrees_of_freedom:.1f} number told by {found.measured.size} data"
    '1.0 number told by 64 data'
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    priors: tuple[Distribution, ...]
    z: Array
    covariance_z: Array
    averaging_kernel_z: Array
    noise_covariance_z: Array
    smoothing_covariance_z: Array
    measured: Array
    noise: Array
    fitted: Array
    model_error: Array
    chi2: float
    iterations: int
    converged: bool
    method: str
    solver: str
    model: Any = field(repr=False)
    samples_z: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    coordinates: Sequence[Mapping[str, Any]] = field(default=(), repr=False)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def values_of(self, z: Array) -> Array:
        """Parameters (..., parameter) in their own units from states."""
        z = np.asarray(z, float)
        flat = z.reshape(-1, z.shape[-1])
        out = np.array([[p.value(float(x)) for p, x in zip(self.priors, row, strict=True)] for row in flat])
        return out.reshape(z.shape)

    def states_of(self, values: Sequence[float]) -> Array:
        """States (parameter,) of values in their own units."""
        return np.array([p.state(float(v)) for p, v in zip(self.priors, values, strict=True)])

    @property
    def estimate(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.names, self.values_of(self.z).tolist(), strict=True))

    @property
    def _slopes(self) -> Array:
        return np.array([p.slope(float(x)) for p, x in zip(self.priors, self.z, strict=True)])

    def _scaled(self, matrix: Array) -> Array:
        return np.asarray(matrix * np.outer(self._slopes, self._slopes))

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters in their own units, (parameter, parameter)."""
        if self.samples_z.size:
            return np.atleast_2d(np.cov(self.samples, rowvar=False))
        return self._scaled(self.covariance_z)

    @property
    def standard_deviation(self) -> dict[str, float]:
        """Of each parameter, by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation of the parameters, (parameter, parameter)."""
        deviation = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(deviation, deviation))

    @property
    def noise_covariance(self) -> Array:
        """Part of the covariance that comes from noise (and the model's stated error), (parameter, parameter)."""
        return self._scaled(self.noise_covariance_z)

    @property
    def smoothing_covariance(self) -> Array:
        """Part of the covariance that comes from leaning on the prior, (parameter, parameter)."""
        return self._scaled(self.smoothing_covariance_z)

    @property
    def averaging_kernel(self) -> Array:
        """Derivative of the estimate with respect to the truth, in the parameters' own units."""
        slopes = self._slopes
        return np.asarray(self.averaging_kernel_z * (slopes[:, None] / slopes[None, :]))

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom for signal: how many numbers the data told, of as many as there are parameters."""
        return float(np.trace(self.averaging_kernel_z))

    @property
    def samples(self) -> Array:
        """Draws from the posterior in the parameters' own units, (sample, parameter)."""
        return self.values_of(self.samples_z) if self.samples_z.size else self.samples_z

    @property
    def residual(self) -> Array:
        """Measured minus fitted, (datum,)."""
        return self.measured - self.fitted

    @property
    def reduced_chi2(self) -> float:
        """chi2 over the number of data less the degrees of freedom for signal; near 1 if noise and model are right."""
        return self.chi2 / max(self.measured.size - self.degrees_of_freedom, 1.0)

    @property
    def probability(self) -> float:
        """Chance of so large a chi2 or a larger one if noise and model are right."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, max(self.measured.size - self.degrees_of_freedom, 1.0)))

    @property
    def trusted(self) -> bool:
        """Whether the estimate is one: the method converged, and the data are not missed by ten times their noise."""
        from skyscatter.inversion.report import HOPELESS

        return self.converged and self.reduced_chi2 <= HOPELESS

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the estimate and its deviations, in sentences; empty if nothing does."""
        from skyscatter.inversion.report import warnings

        return warnings(self)

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Ends of the central credible interval of each parameter; it never crosses the prior's bounds."""
        from scipy.special import ndtri

        if not 0 < level < 1:
            raise DomainError("level", level, "a probability between 0 and 1, such as 0.95")
        if self.samples_z.size:
            ends = np.quantile(self.samples_z, [(1 - level) / 2, (1 + level) / 2], axis=0)
        else:
            reach = float(ndtri(0.5 + level / 2)) * np.sqrt(np.diag(self.covariance_z))
            ends = np.stack([self.z - reach, self.z + reach])
        low, high = self.values_of(ends)
        return {name: (float(a), float(b)) for name, a, b in zip(self.names, low, high, strict=True)}

    def distance(self, values: Mapping[str, float]) -> float:
        """Squared distance of a point from the estimate in the metric of the covariance (Mahalanobis), in the state.

        It is below `scipy.stats.chi2.ppf(0.95, n)` for points inside the joint 95 % region.
        """
        missing = [name for name in self.names if name not in values]
        if missing:
            raise DomainError("values", missing[0], "a number for every parameter is needed")
        off = self.states_of([values[name] for name in self.names]) - self.z
        return float(off @ np.linalg.solve(self.covariance_z, off))

    def __str__(self) -> str:
        """A table of priors and estimates, and how well the data are met."""
        from skyscatter.inversion.report import table

        return table(self)

    def corner(self, path: str | os.PathLike[str] | None = None, truth: Mapping[str, float] | None = None) -> Figure:
        """Corner plot of the posterior; see `plots.corner`."""
        from skyscatter.inversion.plots import corner

        return corner(self, path, truth)

    def plot_residual(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Data, model and residual; see `plots.residual`."""
        from skyscatter.inversion.plots import residual

        return residual(self, path)

    def to_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        content: dict[str, Any] = {
            "skyscatter_fit": FILE_VERSION, "names": list(self.names), "units": list(self.units),
            "estimate": self.estimate, "standard_deviation": self.standard_deviation,
            "interval_95": {name: list(ends) for name, ends in self.interval(0.95).items()},
            "correlation": self.correlation.tolist(), "degrees_of_freedom": self.degrees_of_freedom,
            "chi2": self.chi2, "reduced_chi2": self.reduced_chi2, "probability": self.probability,
            "data": int(self.measured.size), "iterations": self.iterations, "converged": self.converged,
            "method": self.method, "solver": self.solver, "priors": [distributions.to_json(p) for p in self.priors],
            "diagnostics": dict(self.diagnostics), "settings": dict(self.settings),
            "coordinates": [
                {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in part.items()}
                for part in self.coordinates
            ],
            "model": self.model.model_dump(mode="json", exclude_none=True),
        }  # fmt: skip
        return content | {name: getattr(self, name).tolist() for name in _ARRAYS}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a ``.json`` file, whole or not at all; `load` reads it back."""
        if Path(path).suffix.lower() != ".json":
            raise DomainError("output", str(path), "the extension must be .json")
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(self.to_json(), allow_nan=False, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FitResult:
        """Read a result that `save` wrote."""
        if not Path(path).is_file():
            raise MissingDataError(path, "no such file; check the path")
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            if content.get("skyscatter_fit") != FILE_VERSION:
                raise ValueError("version")
            return cls(**_fields(content, path))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise SkyscatterError(f"{path}: not the result of a fit of this version") from error


def _fields(content: dict[str, Any], path: Any) -> dict[str, Any]:
    from skyscatter.models.files import parse_model

    arrays = {name: np.array(content[name], float) for name in _ARRAYS}
    plain = ("chi2", "iterations", "converged", "method", "solver", "diagnostics", "settings")
    coordinates = [
        {k: np.array(v, float) if isinstance(v, list) else v for k, v in part.items()}
        for part in content["coordinates"]
    ]
    return {
        "names": tuple(content["names"]), "units": tuple(content["units"]),
        "priors": tuple(distributions.from_json(p) for p in content["priors"]), "coordinates": coordinates,
        "model": parse_model(content["model"], path),
        **arrays, **{name: content[name] for name in plain},
    }  # fmt: skip
