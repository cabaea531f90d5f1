"""Radiances along rays as data: tables of sky radiance, sky images, limb scans; anything that solvers are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.inversion.datumunits import RADIANCE, factors
from skyscatter.inversion.derivatives import differentiate
from skyscatter.inversion.distributions import Distribution, Normal
from skyscatter.inversion.looks import Integers, LimbLook, Look
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
from skyscatter.solvers.checks import check_wavelengths
from skyscatter.solvers.run import radiance

#: A radiometer's scale is seldom known better than to some per cent.
CALIBRATION: Mapping[str, tuple[float, Distribution]] = {"calibration": (1.0, Normal(1.0, 0.05, low=0.0))}
#: Decimals of degrees, and of metres, to which Suns, directions and heights are told apart.
_DECIMALS = 6


@dataclass(frozen=True)
class Radiances(Observation):
    """Spectral radiances [W m-2 sr-1 nm-1] along rays; made by `radiance_table`, `sky_image` and the like."""

    looks: tuple[Look, ...]
    values: Array
    sigma: Array
    relative: bool = False
    kind: str = "sky radiance"
    unit: str = RADIANCE
    stated: bool = True
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

    def parts(self) -> list[tuple[Integers, Observation]]:
        """See `Observation.parts`: each look by itself."""
        if len(self.looks) < 2:
            return super().parts()
        return [
            (
                look.rows,
                replace(
                    self, looks=(replace(look, rows=np.arange(look.rows.size)),), values=self.values[look.rows],
                    sigma=self.sigma[look.rows], labels={},
                ),
            )
            for look in self.looks
        ]  # fmt: skip

    def predict(self, subject: Subject, run: Run) -> Prediction:
        """Radiances of the model, times the calibration."""
        value, error = np.empty(self.values.size), np.empty(self.values.size)
        for look in self.looks:
            answer = _answer(look, subject, run)
            value[look.rows] = look.pick(look.sunlit(subject, answer.radiance))
            error[look.rows] = look.pick_error(look.sunlit(subject, answer.standard_error))
        scale = subject.nuisance.get("calibration", 1.0)
        return Prediction(scale * value, scale * error)

    def linearise(
        self, subjects: Callable[[Array], Subject], z: Array, steps: Array, active: Sequence[bool], run: Run
    ) -> Linearisation:
        """See `Observation.linearise`: by `differentiate`, all parameters of the model in one solution.

        Parameters that turn the rays themselves (of a nebula's view, of a planet's radius) are differenced one by one.
        """
        here = subjects(z)
        value, error = np.empty(self.values.size), np.empty(self.values.size)
        jacobian = np.zeros((self.values.size, z.size))
        for look in self.looks:
            rays = look.rays(here)
            chosen = [k for k in np.flatnonzero(active).tolist() if _still(look, rays, subjects, z, steps, k)]

            def scene_at(part: Array, look: Look = look, chosen: Sequence[int] = chosen) -> Any:
                there = z.copy()
                there[chosen] = part
                return look.scene(subjects(there))

            found = differentiate(
                scene_at, z[chosen], steps[chosen], *rays, look.wavelengths, solver=run.solver, threads=run.threads
            )
            value[look.rows] = look.pick(look.sunlit(here, found.value))
            error[look.rows] = look.pick_error(look.sunlit(here, found.standard_error))
            jacobian[np.ix_(look.rows, np.array(chosen, int))] = look.pick(look.sunlit(here, found.jacobian)).T
            for k in set(np.flatnonzero(active).tolist()) - set(chosen):
                ends = [_answer(look, subjects(_moved(z, k, sign * steps[k])), run).radiance for sign in (1, -1)]
                jacobian[look.rows, k] = look.pick(look.sunlit(here, (ends[0] - ends[1]) / (2 * steps[k])))
        scale = here.nuisance.get("calibration", 1.0)
        jacobian *= scale
        for k in np.flatnonzero(~np.asarray(active)).tolist():
            ends = [subjects(_moved(z, k, sign * steps[k])).nuisance.get("calibration", 1.0) for sign in (1, -1)]
            jacobian[:, k] = value * (ends[0] - ends[1]) / (2 * steps[k])
        return Linearisation(scale * value, scale * error, jacobian)


def _moved(z: Array, k: int, by: float) -> Array:
    there = z.copy()
    there[k] += by
    return there


def _still(
    look: Look, rays: tuple[Array, Array], subjects: Callable[[Array], Subject], z: Array, steps: Array, k: int
) -> bool:
    """Whether a parameter leaves the rays where they are."""
    other = look.rays(subjects(_moved(z, k, steps[k])))
    return all(np.array_equal(a, b) for a, b in zip(rays, other, strict=True))


def _answer(look: Look, subject: Subject, run: Run) -> Any:
    return radiance(look.scene(subject), *look.rays(subject), look.wavelengths, run.solver, threads=run.threads)


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
    bandwidth_nm: float | None = None,
    units: str | None = None,
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
    bandwidth_nm : float, optional
        Width of the instrument's bands [nm].  Without it each wavelength stands for its cell, half-way to its
        neighbours (docs/conventions.md), as in what `skyscatter.radiance` gives for a list of wavelengths; for a
        radiometer with a few narrow bands say how narrow.
    units : str, optional
        Of `radiance` and `sigma`, such as ``"uW cm-2 sr-1 nm-1"``; [W m-2 sr-1 nm-1] is taken when not given, and
        doubted by `skyscatter.fit` where the model says something else altogether.

    Returns
    -------
    Radiances

    Raises
    ------
    DomainError
        For data that are not finite, noise that is not above 0, angles out of range.

    Examples
    --------
    A sky radiometer's scan in its own unit, three directions under one Sun:

    >>> from skyscatter import inversion
    >>> data = inversion.radiance_table(
    ...     [180, 180, 90], [20, 45, 20], 550, [5, 4, 6], noise=0.03, sun_elevation_deg=30, units="uW cm-2 sr-1 nm-1"
    ... )
    >>> data.values, data.unit
    (array([0.05, 0.04, 0.06]), 'W m-2 sr-1 nm-1')
    >>> data.sun
    {'elevation_deg': 30.0, 'azimuth_deg': 180.0}
    """
    columns = {
        "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "wavelength_nm": wavelength_nm,
        "sun_elevation_deg": sun_elevation_deg, "sun_azimuth_deg": sun_azimuth_deg, "altitude_m": altitude,
    }  # fmt: skip
    values, sigma = _in_house(radiance, sigma, wavelength_nm, units)
    table = {name: _column(name, column, values.size) for name, column in columns.items()}
    values, deviation = checked_data(values, noise_of(values, sigma, noise, "radiance"), "radiance")
    for name in ("elevation_deg", "sun_elevation_deg"):
        if np.abs(table[name]).max() > 90:
            raise DomainError(name, float(np.abs(table[name]).max()), "lies between -90 and 90 degrees")
    direction = direction_from_azimuth_elevation(table["azimuth_deg"], table["elevation_deg"])
    looks = [
        _look(
            {"elevation_deg": float(key[0]), "azimuth_deg": float(key[1])},
            float(key[2]), direction, table["wavelength_nm"], rows, bandwidth_nm,
        )
        for key, rows in groups(table["sun_elevation_deg"], table["sun_azimuth_deg"], table["altitude_m"])
    ]  # fmt: skip
    return Radiances(tuple(looks), values, deviation, noise is not None, stated=units is not None, labels=table)


def _in_house(radiance: ArrayLike, sigma: Any, wavelength_nm: ArrayLike, units: str | None) -> tuple[Array, Any]:
    """Radiances and their deviations [W m-2 sr-1 nm-1]."""
    values = np.asarray(radiance, float).ravel()
    if units is None:
        return values, sigma
    factor = factors(units, RADIANCE, _column("wavelength_nm", wavelength_nm, values.size))
    return values * factor, None if sigma is None else np.asarray(sigma, float) * factor


def limb_profile(
    tangent_height_m: ArrayLike,
    wavelength_nm: ArrayLike,
    radiance: ArrayLike,
    sigma: ArrayLike | None = None,
    *,
    altitude: float,
    sun_elevation_deg: float,
    sun_azimuth_deg: float = 180.0,
    azimuth_deg: ArrayLike = 0.0,
    noise: float | None = None,
    bandwidth_nm: float | None = None,
    units: str | None = None,
) -> Radiances:
    """Radiances of a planet's limb, seen from above its air.

    Parameters
    ----------
    tangent_height_m : array_like, shape (datum,)
        Least height of the straight line of sight above the ground [m].
    wavelength_nm, radiance, sigma, noise, bandwidth_nm, units
        As for `radiance_table`.
    altitude : float
        Of the observer [m].
    sun_elevation_deg, sun_azimuth_deg : float
        Of the Sun at the observer [degree]: above the plane across the vertical there, which is not the limb's horizon.
    azimuth_deg : array_like
        Of the line of sight [degree], once or for each datum.

    Returns
    -------
    Radiances

    Raises
    ------
    DomainError
        For data that are not finite, tangent points below the ground, an observer below one of them.

    Examples
    --------
    A limb scan from an orbit 600 km high, at one wavelength; heights in metres.

    >>> from skyscatter import inversion
    >>> data = inversion.limb_profile(
    ...     [10e3, 20e3, 30e3], 600, [0.1, 0.05, 0.02], noise=0.05, altitude=600e3, sun_elevation_deg=20
    ... )
    >>> data.kind, data.coordinates()["tangent_height_m"] / 1e3
    ('limb radiance', array([10., 20., 30.]))
    """
    raw, sigma = _in_house(radiance, sigma, wavelength_nm, units)
    columns = {"tangent_height_m": tangent_height_m, "azimuth_deg": azimuth_deg, "wavelength_nm": wavelength_nm}
    table = {name: _column(name, column, raw.size) for name, column in columns.items()}
    values, deviation = checked_data(raw, noise_of(raw, sigma, noise, "radiance"), "radiance")
    if table["tangent_height_m"].min() < 0:
        raise DomainError("tangent_height_m", float(table["tangent_height_m"].min()), "a height above the ground")
    if not altitude > table["tangent_height_m"].max():
        raise DomainError("altitude", altitude, "the observer is above all tangent points; say it: --altitude 600km")
    lines = np.stack([table["tangent_height_m"], table["azimuth_deg"]], axis=1)
    tangent, ray = np.unique(np.round(lines, _DECIMALS), axis=0, return_inverse=True)
    wl, band = np.unique(table["wavelength_nm"], return_inverse=True)
    look = LimbLook(
        {"elevation_deg": float(sun_elevation_deg), "azimuth_deg": float(sun_azimuth_deg)}, float(altitude),
        np.zeros((len(tangent), 3)), check_wavelengths(wl), ray.ravel(), band.ravel(), np.arange(values.size),
        bandwidth=bandwidth_nm, tangent=tangent,
    )  # fmt: skip
    return Radiances(
        (look,), values, deviation, noise is not None, kind="limb radiance", stated=units is not None, labels=table
    )


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


def _look(
    sun: Mapping[str, float],
    altitude: float,
    direction: Array,
    wavelength: Array,
    rows: Integers,
    bandwidth: float | None,
) -> Look:
    """Rows of one Sun as the rays and wavelengths that they need, each once."""
    rounded = np.round(direction[rows], 9)
    _, first, ray = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    wl, band = np.unique(wavelength[rows], return_inverse=True)
    directions = np.ascontiguousarray(direction[rows][first])
    return Look(sun, altitude, directions, check_wavelengths(wl), ray.ravel(), band.ravel(), rows, bandwidth=bandwidth)
