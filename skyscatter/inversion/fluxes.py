"""Fluxes as data: direct, diffuse and global irradiance on a horizontal plane, spectral or broadband, over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.broadband import PRECIPITABLE_WATER, Broadband
from skyscatter.inversion.datumunits import FLUX, SPECTRAL_FLUX, factors
from skyscatter.inversion.distributions import Distribution, Normal
from skyscatter.inversion.looks import band_share
from skyscatter.inversion.observations import (
    Linearisation,
    Observation,
    Prediction,
    Run,
    checked_data,
    model_of,
    noise_of,
)
from skyscatter.inversion.parameters import Subject
from skyscatter.inversion.radiances import CALIBRATION
from skyscatter.inversion.stack import differences_forbid, stack
from skyscatter.record import nearest
from skyscatter.solvers.checks import worker_count
from skyscatter.solvers.field import LOOSEST, solve_once, zenith_range
from skyscatter.solvers.fluxes import fluxes as fluxes_of
from skyscatter.solvers.options import Orders
from skyscatter.solvers.sweeps import Solution

Array = NDArray[np.float64]

QUANTITIES = ("direct", "diffuse", "global", "up", "net")
#: A clock that is set by hand is right to about a minute.
TIME_OFFSET: Mapping[str, tuple[float, Distribution]] = {"time_offset_s": (0.0, Normal(0.0, 60.0))}
#: Relative error of a reading with the Sun 60 degrees from the zenith, growing as 1 - its cosine: ISO 9060 allows
#: pyranometers 10 to 30 W m-2 of 1000 in the direct beam.
COSINE_ERROR: Mapping[str, tuple[float, Distribution]] = {"cosine_error": (0.0, Normal(0.0, 0.02))}
#: Copies of a scene times wavelengths that are solved together at most.
MOST_CHANNELS = 256
#: The error that the solver's tolerance allows: fits solve once, and so have no estimate of it.
DEFAULT_TOLERANCE = 0.01
#: Offsets of the clock that are provided for, either way [s].
LATEST = 300.0


@dataclass(frozen=True)
class Fluxes(Observation):
    """Irradiances [W m-2 nm-1], or broadband [W m-2]; made by `flux_table`.

    Attributes
    ----------
    elevation : ndarray, shape (datum, 3)
        The Sun's elevation [degree], its rate [degree s-1] and half its second derivative, for clocks that are late.
    quantity : sequence of str, one of `QUANTITIES` for each datum
    wavelength : ndarray, shape (datum,)
        [nm]; NaN is broadband.
    altitude : float
        Of the plane above the ground [m].
    distance_au : float, optional
        Of the Sun; the model's when not given.
    broadband : Broadband, optional
        How the spectrum is summed.
    """

    values: Array
    sigma: Array
    elevation: Array
    quantity: tuple[str, ...]
    wavelength: Array
    altitude: float = 0.0
    distance_au: float | None = None
    broadband: Broadband | None = None
    timed: bool = False
    relative: bool = False
    bandwidth: float | None = None
    kind: str = "irradiance"
    unit: str = SPECTRAL_FLUX
    stated: bool = True
    labels: Mapping[str, Array] = field(default_factory=dict)

    @property
    def nuisances(self) -> Mapping[str, tuple[float, Distribution]]:  # type: ignore[override]
        """Calibration, and what else the data are uncertain in."""
        found = dict(CALIBRATION) | dict(COSINE_ERROR)
        if self.broadband is not None:
            found |= PRECIPITABLE_WATER
        if self.timed:
            found |= TIME_OFFSET
        return found

    def coordinates(self) -> dict[str, Array]:
        """The Sun's elevation, the wavelength where there is one, and what else was given."""
        found = {"sun_elevation_deg": self.elevation[:, 0], **self.labels}
        return found if self.broadband is not None else {"wavelength_nm": self.wavelength, **found}

    @property
    def wavelengths(self) -> Array:
        """Where the spectrum is computed [nm]."""
        nodes = self.wavelength[np.isfinite(self.wavelength)]
        if self.broadband is not None:
            nodes = np.concatenate([nodes, self.broadband.wavelengths])
        return np.unique(nodes)

    def scene(self, subject: Subject) -> Any:
        """The scene; where the Sun stands in it does not matter."""
        planet = model_of(subject, True, "fluxes")
        return planet.scene(sun_elevation_deg=30.0, sun_distance_au=self.distance_au, altitude=self.altitude)

    def predict(self, subject: Subject, run: Run) -> Prediction:
        """Fluxes of the model, through gases and calibration."""
        value = self._measured(self._solved([self.scene(subject)], run)[0], subject)
        return Prediction(value, self._tolerance(run) * np.abs(value))

    def linearise(
        self, subjects: Callable[[Array], Subject], z: Array, steps: Array, active: Sequence[bool], run: Run
    ) -> Linearisation:
        """See `Observation.linearise`: all copies of the scene in few solutions, nuisance parameters from one."""
        shifts = [(k, sign) for k in range(z.size) for sign in (1.0, -1.0)]
        ends = [subjects(z + sign * steps[k] * (np.arange(z.size) == k)) for k, sign in shifts]
        here = subjects(z)
        changing = [n for n, (k, _) in enumerate(shifts) if active[k]]
        solved = self._solved([self.scene(here), *(self.scene(ends[n]) for n in changing)], run)
        by_shift = dict(zip(changing, solved[1:], strict=True))
        values = [
            self._measured(by_shift.get(n, solved[0]), end) for n, end in enumerate(ends)
        ]  # parameters of the data alone change what is made of one and the same field
        jacobian = np.stack([(values[2 * k] - values[2 * k + 1]) / (2 * steps[k]) for k in range(z.size)], axis=1)
        value = self._measured(solved[0], here)
        return Linearisation(value, self._tolerance(run) * np.abs(value), jacobian)

    def _tolerance(self, run: Run) -> float:
        return _accuracy(run)[0] / 2

    def _solved(self, scenes: Sequence[Any], run: Run) -> list[Callable[[Array], dict[str, Array]]]:
        """For each scene a function from the Sun's elevations to fluxes by name, each (datum, wavelength)."""
        wl = self.wavelengths
        size = max(MOST_CHANNELS // wl.size, 1)
        found: list[Callable[[Array], dict[str, Array]]] = []
        for begin in range(0, len(scenes), size):
            part = scenes[begin : begin + size]
            if any(differences_forbid(part[0], other) for other in part[1:]):
                found += [self._field([scene], wl, run)[0] for scene in part]
            else:
                found += self._field(part, wl, run)
        return found

    def _field(self, scenes: Sequence[Any], wl: Array, run: Run) -> list[Callable[[Array], dict[str, Array]]]:
        reach = LATEST * np.abs(self.elevation[:, 1]) if self.timed else 0.0
        low = max(float((self.elevation[:, 0] - reach).min()) - 1.0, -90.0)
        high = min(float((self.elevation[:, 0] + reach).max()) + 1.0, 90.0)
        stacked = stack(scenes, wl)
        tolerance, most = _accuracy(run)
        solution = _solution(tuple(scenes), tuple(wl.tolist()), low, high, tolerance, most, run.threads)

        @lru_cache(maxsize=4)
        def answers(elevation: bytes) -> Any:
            """Of all copies, which ask for the same elevations."""
            zenith = np.radians(90.0 - np.clip(np.frombuffer(elevation), low, high))
            return fluxes_of(solution, np.full(zenith.shape, self.altitude), zenith)

        def of(copy: int) -> Callable[[Array], dict[str, Array]]:
            def fluxes(elevation: Array) -> dict[str, Array]:
                answer = answers(np.ascontiguousarray(elevation, float).tobytes())
                part = {
                    name: stacked.channels.split(getattr(answer, name))[copy]
                    for name in ("direct", "diffuse_down", "diffuse_up")
                }
                return {
                    "direct": part["direct"], "diffuse": part["diffuse_down"], "up": part["diffuse_up"],
                    "global": part["direct"] + part["diffuse_down"],
                    "net": part["direct"] + part["diffuse_down"] - part["diffuse_up"],
                }  # fmt: skip

            return fluxes

        return [of(copy) for copy in range(len(scenes))]

    def _measured(self, fluxes: Callable[[Array], dict[str, Array]], subject: Subject) -> Array:
        """What an instrument reads: the fluxes when its clock said so, summed over its band, on its scale."""
        nuisance, star = subject.nuisance, subject.model.star
        late = nuisance.get("time_offset_s", 0.0)
        elevation = self.elevation @ np.array([1.0, late, late**2])
        spectra = fluxes(elevation)
        wl, value = self.wavelengths, np.empty(self.values.size)
        sunlight = star.irradiance(wl, star.distance)
        for name in set(self.quantity):
            rows = np.flatnonzero(np.array(self.quantity) == name)
            broad = rows[np.isnan(self.wavelength[rows])]
            fine = np.setdiff1d(rows, broad)
            column = np.searchsorted(wl, self.wavelength[fine])
            value[fine] = spectra[name][fine, column]
            if self.bandwidth is not None:
                value[fine] *= band_share(star, wl, self.bandwidth)[column]
            if broad.size and self.broadband is not None:
                columns = np.searchsorted(wl, self.broadband.wavelengths)
                water = nuisance.get("precipitable_water", PRECIPITABLE_WATER["precipitable_water"][0])
                ratio = spectra[name][np.ix_(broad, columns)] / sunlight[columns]
                value[broad] = self.broadband.total(ratio, elevation[broad], water, star)
        slant = 2.0 * (1.0 - np.sin(np.radians(elevation)))
        return nuisance.get("calibration", 1.0) * (1.0 + nuisance.get("cosine_error", 0.0) * slant) * value


def _accuracy(run: Run) -> tuple[float, int | None]:
    """Tolerance, and highest order of scattering, of the one solver that fluxes come from."""
    how = run.solver
    if not isinstance(how, Orders):
        raise DomainError("solver", how.name, "fluxes come from orders alone; leave the solver out")
    return DEFAULT_TOLERANCE if how.tolerance is None else how.tolerance, how.max_order


@lru_cache(maxsize=2)
def _solution(
    scenes: tuple[Any, ...],
    wavelengths: tuple[float, ...],
    low: float,
    high: float,
    tolerance: float,
    max_order: int | None,
    threads: int | None,
) -> Solution:
    """All scenes in one solution, for Suns between two elevations [degree]; kept for other data of the same."""
    stacked = stack(scenes, wavelengths)
    scene: Any = stacked.scene
    zenith = zenith_range(scene, (low, high), tolerance)
    return solve_once(
        scene, stacked.channels.numbers, zenith, min(tolerance, LOOSEST), False, max_order, worker_count(threads)
    )


def flux_table(
    sun_elevation_deg: ArrayLike | None,
    quantity: str | Sequence[str],
    flux: ArrayLike,
    sigma: ArrayLike | None = None,
    *,
    wavelength_nm: ArrayLike | None = None,
    noise: float | None = None,
    altitude: float = 0.0,
    place: tuple[float, float] | None = None,
    times: Sequence[Any] | None = None,
    distance_au: float | None = None,
    broadband: Broadband | None = None,
    bandwidth_nm: float | None = None,
    units: str | None = None,
) -> Fluxes:
    """Irradiances on a horizontal plane, one datum a row.

    Parameters
    ----------
    sun_elevation_deg : array_like, shape (datum,)
        Of the Sun [degree]; None where `place` and `times` say where it stood.
    quantity : {"direct", "diffuse", "global", "up", "net"} or one for each datum
        Direct sunlight through the plane, all other light from above, both, light from below, and global less up.
    flux : array_like, shape (datum,)
        [W m-2 nm-1], or [W m-2] where broadband.
    sigma : array_like, optional
        Standard deviation of the noise.  Without it give `noise`.
    wavelength_nm : array_like, optional
        Vacuum wavelengths [nm]; None or NaN for broadband data.
    noise : float, optional
        Relative standard deviation.
    altitude : float
        Of the plane above the ground [m].
    place : (float, float), optional
        Latitude and longitude [degree].
    times : sequence, optional
        ISO 8601 texts or datetimes, one for each datum; then ``time_offset_s`` may be free: how late the clock was set
        (the Sun is where it stands that much after the time stated).
    distance_au : float, optional
        Of the Sun; from `times` where these are given, else the model's.
    broadband : Broadband, optional
        How a spectrum is summed; the whole solar spectrum through water vapour and mixed gases when not given.

    bandwidth_nm : float, optional
        Of spectral data; see `skyscatter.inversion.radiance_table`.
    units : str, optional
        Of `flux` and `sigma`, such as ``"uW cm-2 nm-1"``; [W m-2 nm-1] or [W m-2] is taken when not given, and doubted
        by `skyscatter.fit` where the model says something else altogether.

    Returns
    -------
    Fluxes

    Raises
    ------
    DomainError
        For data that are not finite, noise that is not above 0, unknown quantities, elevations out of range, and places
        or times that do not go together.

    Examples
    --------
    Global irradiance by a pyranometer at three elevations of the Sun, and what else a fit may take as unknown:

    >>> from skyscatter import inversion
    >>> data = inversion.flux_table([30, 45, 60], "global", [450, 680, 880], noise=0.02)
    >>> data.unit, data.sigma
    ('W m-2', array([ 9. , 13.6, 17.6]))
    >>> sorted(data.nuisances)
    ['calibration', 'cosine_error', 'precipitable_water']

    Where place and times are given, the Sun is found [degree]:

    >>> data = inversion.flux_table(
    ...     None, "direct", [0.8], noise=0.02, wavelength_nm=550, place=(48.9, 2.35), times=["2026-06-21T12:00Z"]
    ... )
    >>> f"{data.elevation[0, 0]:.1f}"
    '64.5'
    """
    raw = np.asarray(flux, float).ravel()
    if units is not None:
        missing = np.isnan(np.asarray([np.nan] if wavelength_nm is None else wavelength_nm, float))
        if missing.any() and not missing.all():
            raise DomainError("units", units, "the data are spectral and broadband; give all in W m-2 (nm-1), without")
        spectral = not missing.any()
        factor = factors(units, SPECTRAL_FLUX if spectral else FLUX, wavelength_nm if spectral else None)
        raw, sigma = raw * factor, None if sigma is None else np.asarray(sigma, float) * factor
    values, deviation = checked_data(raw, noise_of(raw, sigma, noise, "flux"), "flux")
    names = (quantity,) * values.size if isinstance(quantity, str) else tuple(quantity)
    if len(names) != values.size:
        raise DomainError("quantity", len(names), f"one for each of the {values.size} data")
    for name in set(names):
        if name not in QUANTITIES:
            raise DomainError("quantity", name, nearest(name, QUANTITIES))
    wl = np.full(values.size, np.nan)
    if wavelength_nm is not None:
        wl = np.broadcast_to(np.asarray(wavelength_nm, float), values.shape).copy()
    broad = bool(np.isnan(wl).any())
    if broadband is not None and not broad:
        raise DomainError("broadband", "given", "no datum is broadband; leave it out")
    timed = times is not None
    if timed != (place is not None) or timed == (sun_elevation_deg is not None):
        raise DomainError("sun_elevation_deg", sun_elevation_deg, "give either the elevations, or place and times")
    if times is not None and place is not None:
        elevation, distance_au = _elevations(place, times, values.size)
    else:
        e = np.broadcast_to(np.asarray(sun_elevation_deg, float), values.shape)
        if not np.all(np.abs(e) <= 90):
            raise DomainError("sun_elevation_deg", float(np.abs(e).max()), "lies between -90 and 90 degrees")
        elevation = np.stack([e, np.zeros_like(e), np.zeros_like(e)], axis=1)
    one_kind = wl[np.isfinite(wl)].size in (0, values.size)
    return Fluxes(
        values, deviation, elevation, names, wl, float(altitude), distance_au,
        (broadband or Broadband()) if broad else None, timed, noise is not None, bandwidth_nm,
        kind="irradiance" if one_kind else "irradiances",
        unit=FLUX if broad and one_kind else SPECTRAL_FLUX if one_kind else "W m-2 (nm-1)",
        stated=units is not None or not one_kind,
    )  # fmt: skip


def _elevations(place: tuple[float, float], times: Sequence[Any], size: int) -> tuple[Array, float]:
    """Elevation [degree], its rate and half its second derivative (datum, 3), and the Sun's distance [au]."""
    from datetime import timedelta

    from skyscatter.geometry.sun import sun_position

    if len(times) != size:
        raise DomainError("times", len(times), f"one for each of the {size} data")
    moments = [_moment(time) for time in times]
    step = 60.0
    found = np.array(
        [[sun_position(*place, t + timedelta(seconds=s)).elevation_deg for s in (-step, 0.0, step)] for t in moments]
    )
    before, now, after = found.T
    rows = np.stack([now, (after - before) / (2 * step), 0.5 * (after - 2 * now + before) / step**2], axis=1)
    return rows, sun_position(*place, moments[len(moments) // 2]).distance_au


def _moment(time: Any) -> Any:
    from datetime import UTC, datetime

    if isinstance(time, str):
        try:
            time = datetime.fromisoformat(time)
        except ValueError:
            raise DomainError("times", time, "an ISO 8601 text such as 2013-05-27T13:30Z") from None
    return time if time.tzinfo else time.replace(tzinfo=UTC)


__all__: Sequence[str] = ("Fluxes", "flux_table")
