"""Radiances along rays as data: tables of sky radiance, sky images, limb scans; anything that solvers are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion.derivatives import differentiate
from skyscatter.inversion.distributions import Distribution, Normal
from skyscatter.inversion.observations import (
    Array,
    Linearisation,
    Observation,
    Prediction,
    Run,
    checked_data,
    noise_of,
)
from skyscatter.inversion.parameters import Subject
from skyscatter.solvers.run import check_wavelengths, radiance

Integers = NDArray[np.int64]

#: A radiometer's scale is seldom known better than to some per cent.
CALIBRATION: Mapping[str, tuple[float, Distribution]] = {"calibration": (1.0, Normal(1.0, 0.05, low=0.0))}
#: Decimals of degrees, and of metres, to which Suns, directions and heights are told apart.
_DECIMALS = 6


@dataclass(frozen=True)
class Look:
    """Rays under one Sun from one place, and which of their radiances were measured.

    Attributes
    ----------
    sun : mapping
        Fields of `skyscatter.Sun`.
    altitude : float
        Of the observer [m].
    directions : ndarray, shape (ray, 3)
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    ray, band : ndarray of int, shape (datum,)
        What each datum is.
    rows : ndarray of int, shape (datum,)
        Where it stands among all data of the observation.
    response : ndarray, shape (band, wavelength), optional
        Bands as weighted sums of wavelengths; without it each wavelength is a band.
    """

    sun: Mapping[str, float]
    altitude: float
    directions: Array
    wavelengths: Array
    ray: Integers
    band: Integers
    rows: Integers
    response: Array | None = None

    def scene(self, subject: Subject) -> Any:
        """The scene that is looked at."""
        sun = {**self.sun, **subject.sun}
        arguments = {f"sun_{name}": value for name, value in sun.items()}
        return subject.model.scene(**arguments, altitude=self.altitude)

    def rays(self, subject: Subject) -> tuple[Array, Array]:
        """Origins and directions, each (ray, 3)."""
        position = self.scene(subject).observer.position
        return np.broadcast_to(position, self.directions.shape), self.directions

    def pick(self, values: Array) -> Array:
        """From (..., ray, wavelength) to (..., datum)."""
        bands = values if self.response is None else values @ self.response.T
        return np.asarray(bands[..., self.ray, self.band])

    def pick_error(self, errors: Array) -> Array:
        """The same for standard errors, taken as fully correlated between the wavelengths of a band."""
        bands = errors if self.response is None else errors @ np.abs(self.response).T
        return np.asarray(bands[self.ray, self.band])


@dataclass(frozen=True)
class Radiances(Observation):
    """Spectral radiances [W m-2 sr-1 nm-1] along rays; made by `radiance_table`, `sky_image` and the like."""

    looks: tuple[Look, ...]
    values: Array
    sigma: Array
    kind: str = "sky radiance"
    unit: str = "W m-2 sr-1 nm-1"
    labels: Mapping[str, Array] = field(default_factory=dict)
    nuisances: Mapping[str, tuple[float, Distribution]] = field(default_factory=lambda: dict(CALIBRATION))

    @property
    def sun(self) -> dict[str, float]:
        """The Sun of all looks, if it is one."""
        suns = [dict(look.sun) for look in self.looks]
        return suns[0] if all(sun == suns[0] for sun in suns) else {}

    def coordinates(self) -> dict[str, Array]:
        """Azimuth, elevation, wavelength, ..., each (datum,)."""
        return dict(self.labels)

    def predict(self, subject: Subject, run: Run) -> Prediction:
        """Radiances of the model, times the calibration."""
        value, error = np.empty(self.values.size), np.empty(self.values.size)
        for look in self.looks:
            scene, (origins, directions) = look.scene(subject), look.rays(subject)
            answer = radiance(
                scene, origins, directions, look.wavelengths, run.solver, threads=run.threads, **run.options
            )
            value[look.rows] = look.pick(answer.radiance)
            error[look.rows] = look.pick_error(answer.standard_error)
        scale = subject.nuisance.get("calibration", 1.0)
        return Prediction(scale * value, scale * error)

    def linearise(
        self, subjects: Callable[[Array], Subject], z: Array, steps: Array, active: Sequence[bool], run: Run
    ) -> Linearisation:
        """See `Observation.linearise`: by `differentiate`, all parameters of the model in one solution."""
        here = subjects(z)
        chosen = np.flatnonzero(active)
        value, error = np.empty(self.values.size), np.empty(self.values.size)
        jacobian = np.zeros((self.values.size, z.size))

        def moved(part: Array) -> Array:
            there = z.copy()
            there[chosen] = part
            return there

        for look in self.looks:
            origins, directions = look.rays(here)
            found = differentiate(
                lambda part, look=look: look.scene(subjects(moved(part))),  # type: ignore[misc]
                z[chosen], steps[chosen], origins, directions, look.wavelengths,
                solver=run.solver, threads=run.threads, **run.options,
            )  # fmt: skip
            value[look.rows] = look.pick(found.value)
            error[look.rows] = look.pick_error(found.standard_error)
            jacobian[np.ix_(look.rows, chosen)] = look.pick(found.jacobian).T
        scale = here.nuisance.get("calibration", 1.0)
        jacobian *= scale
        for k in np.flatnonzero(~np.asarray(active)):
            ends = []
            for sign in (1.0, -1.0):
                there = z.copy()
                there[k] += sign * steps[k]
                ends.append(subjects(there).nuisance.get("calibration", 1.0))
            jacobian[:, k] += value * (ends[0] - ends[1]) / (2 * steps[k])
        return Linearisation(scale * value, scale * error, jacobian)


def radiance_table(
    azimuth_deg: ArrayLike,
    elevation_deg: ArrayLike,
    wavelength_nm: ArrayLike,
    radiance: ArrayLike,
    sigma: ArrayLike | None = None,
    *,
    noise: float | None = None,
    sun_elevation_deg: ArrayLike,
    sun_azimuth_deg: ArrayLike = 180.0,
    altitude: ArrayLike = 0.0,
) -> Radiances:
    """Sky radiances in directions and at wavelengths, one datum a row.

    Parameters
    ----------
    azimuth_deg, elevation_deg : array_like, shape (datum,)
        Line of sight [degree], azimuth from north through east.
    wavelength_nm : array_like, shape (datum,)
        Vacuum wavelengths [nm].
    radiance : array_like, shape (datum,)
        [W m-2 sr-1 nm-1]
    sigma : array_like, optional
        Standard deviation of the noise [the same].  Without it give `noise`.
    noise : float, optional
        Standard deviation as a share of the radiance.
    sun_elevation_deg, sun_azimuth_deg : array_like
        Where the Sun stood [degree], once or for each datum.
    altitude : array_like
        Of the observer above the ground [m], once or for each datum.

    Returns
    -------
    Radiances

    Raises
    ------
    DomainError
        For data that are not finite, noise that is not above 0, angles out of range.
    """
    columns = {
        "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "wavelength_nm": wavelength_nm,
        "sun_elevation_deg": sun_elevation_deg, "sun_azimuth_deg": sun_azimuth_deg, "altitude_m": altitude,
    }  # fmt: skip
    values = np.asarray(radiance, float).ravel()
    table = {name: _column(name, column, values.size) for name, column in columns.items()}
    values, deviation = checked_data(values, noise_of(values, sigma, noise, "radiance"), "radiance")
    for name in ("elevation_deg", "sun_elevation_deg"):
        if np.abs(table[name]).max() > 90:
            raise DomainError(name, float(np.abs(table[name]).max()), "lies between -90 and 90 degrees")
    direction = direction_from_azimuth_elevation(table["azimuth_deg"], table["elevation_deg"])
    looks = [
        _look(
            {"elevation_deg": float(key[0]), "azimuth_deg": float(key[1])},
            float(key[2]), direction, table["wavelength_nm"], rows,
        )
        for key, rows in groups(table["sun_elevation_deg"], table["sun_azimuth_deg"], table["altitude_m"])
    ]  # fmt: skip
    return Radiances(tuple(looks), values, deviation, labels=table)


def _column(name: str, column: Any, size: int) -> Array:
    try:
        values = np.broadcast_to(np.asarray(column, float).ravel() if np.ndim(column) else float(column), (size,))
    except (TypeError, ValueError):
        raise DomainError(name, np.shape(column), f"one number, or one for each of the {size} data") from None
    if not np.all(np.isfinite(values)):
        raise DomainError(name, float(values[~np.isfinite(values)][0]), "must be finite")
    return np.array(values)


def groups(*columns: Array) -> list[tuple[Array, Integers]]:
    """Rows that agree in all columns: the common values, and where they are."""
    keys, which = np.unique(np.round(np.stack(columns, axis=1), _DECIMALS), axis=0, return_inverse=True)
    which = which.ravel()
    return [(key, np.flatnonzero(which == k)) for k, key in enumerate(keys)]


def _look(sun: Mapping[str, float], altitude: float, direction: Array, wavelength: Array, rows: Integers) -> Look:
    """Rows of one Sun as the rays and wavelengths that they need, each once."""
    rounded = np.round(direction[rows], 9)
    _, first, ray = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    wl, band = np.unique(wavelength[rows], return_inverse=True)
    directions = np.ascontiguousarray(direction[rows][first])
    return Look(sun, altitude, directions, check_wavelengths(wl), ray.ravel(), band.ravel(), rows)
