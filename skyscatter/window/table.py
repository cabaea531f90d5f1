"""A compact table of a sky for one observer and all Suns, of which a browser or another engine draws it at once.

Light is held as logarithms at nodes of the Sun's elevation, of elevation and of azimuth from the Sun, and joined by
cubics; phase functions stand beside it, over the angle from the Sun.  docs/howto-sky-table.md describes the file.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter import __version__
from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.solvers.checks import worker_count
from skyscatter.solvers.grid import cubic_weights
from skyscatter.window.changes import LAWS, Changes, no_changes, solve_changes
from skyscatter.window.layout import packed, unpacked
from skyscatter.window.settings import SkySettings
from skyscatter.window.solved import Fineness, Lights, Progress, horizon_of, solve_lights

if TYPE_CHECKING:
    from skyscatter.scene import Scene

__all__ = ["SkySettings", "SkyTableFile", "default_table", "make_table"]

Array = NDArray[np.float64]

#: The shipped table of the model earth with all settings as they are, for an observer at 2 m.
DEFAULT = Path(__file__).resolve().parent / "data" / "earth.sky.gz"

#: Elevations of the Sun [degree]: half a degree apart about the horizon, and at most a degree and a half in twilight.
SUNS = (
    *(-14.0, -12.5, -11.0, -9.5, -8.0, -6.75, -5.5, -4.5, -3.5, -2.5, -1.75, -1.0, -0.5, 0.0, 0.5, 1.0, 1.75, 2.5),
    *(3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 38.0, 50.0, 64.0, 78.0, 90.0),
)
#: Share of the time that the light itself takes.
SHARE = 0.8
# The light itself asks for a fine angular resolution more than for a close tolerance: twilight over Mars misses ten
# times as much with phase functions to degree 8.
GOOD = Fineness(tolerance=0.02, degree=16, wavelengths=16, suns=SUNS, below=16, above=34, turns=15)
QUICK = Fineness(tolerance=0.04, degree=12, wavelengths=8, suns=(*SUNS[::2], 90.0), below=15, above=24, turns=11)


def make_table(
    settings: SkySettings, progress: Progress | None = None, quick: bool = False, threads: int | None = None
) -> SkyTableFile:
    """Solve a sky for all Suns from 90 to -14 degrees and tabulate what its observer sees.

    Parameters
    ----------
    settings : SkySettings
    progress : callable, optional
        Called with the finished share, 0 to 1.
    quick : bool
        A coarse table, several times sooner; without derivatives for changes.
    threads : int, optional
        All processors when not given.

    Returns
    -------
    SkyTableFile

    Examples
    --------
    >>> from skyscatter.window.table import SkySettings, make_table
    >>> table = make_table(SkySettings("earth-simple"), quick=True)
    >>> zenith = table.xyz([0, 0, 1], sun_elevation_deg=30, sun_azimuth_deg=180)
    >>> bool(1000 < zenith[1] < 5000)  # luminance [cd m-2]
    True
    """
    scene, fineness, workers = settings.scene(), QUICK if quick else GOOD, worker_count(threads)
    share = None if progress is None else (lambda done: progress(SHARE * done))
    lights = solve_lights(scene, fineness, workers, share).lights
    changes = no_changes() if quick else solve_changes(settings, workers)
    if progress is not None:
        progress(1.0)
    return _filed(settings, scene, fineness, lights, changes)


def default_table() -> bytes:
    """The shipped table of `SkySettings` as they are: the model earth.

    Examples
    --------
    >>> from skyscatter.window.table import SkyTableFile, default_table
    >>> SkyTableFile.from_bytes(default_table()).settings.model
    'earth'
    """
    if not DEFAULT.is_file():
        raise MissingDataError(DEFAULT, "no such shipped table; reinstall skyscatter")
    return gzip.decompress(DEFAULT.read_bytes())


@dataclass(frozen=True)
class SkyTableFile:
    """A table of a sky: its header and its arrays as they stand in a file.

    Attributes
    ----------
    header : dict
    arrays : dict of ndarray

    Examples
    --------
    The shipped sky by night falling: the luminance of the zenith [cd m-2] under four Suns.

    >>> from skyscatter.window.table import SkyTableFile, default_table
    >>> table = SkyTableFile.from_bytes(default_table())
    >>> [f"{table.xyz([0, 0, 1], elevation, 180)[1]:.1g}" for elevation in (30, 0, -6, -12)]
    ['1e+03', '1e+02', '0.4', '0.0009']
    """

    header: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    @property
    def settings(self) -> SkySettings:
        """What the table was made for."""
        return SkySettings(**self.header["settings"])

    def to_bytes(self) -> bytes:
        """The table as one message; see `skyscatter.window.layout`."""
        return packed(self.header, self.arrays)

    @classmethod
    def from_bytes(cls, data: bytes) -> SkyTableFile:
        """Read what `to_bytes` made.

        Raises
        ------
        DomainError
            For anything else.
        """
        return cls(*unpacked(data))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table to a file, whole or not at all; docs/howto-sky-table.md says how other programs read it.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> from skyscatter.window.table import SkyTableFile, default_table
        >>> table = SkyTableFile.from_bytes(default_table())
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     table.save(pathlib.Path(folder) / "sky.bin")
        ...     again = SkyTableFile.load(pathlib.Path(folder) / "sky.bin")
        >>> again.to_bytes() == table.to_bytes()
        True
        """
        with atomic_path(path) as temporary:
            temporary.write_bytes(self.to_bytes())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SkyTableFile:
        """Read a file that `save` wrote."""
        if not Path(path).is_file():
            raise MissingDataError(path, "no such file; check the path")
        return cls.from_bytes(Path(path).read_bytes())

    @cached_property
    def _logarithms(self) -> Array:
        """Binary logarithms of the light, (sun, block, 3, elevation, turn)."""
        low, step = (self.arrays[name].astype(float)[..., None, None] for name in ("light_low", "light_step"))
        return np.asarray(low + step * self.arrays["light"])

    def xyz(
        self,
        directions: ArrayLike,
        sun_elevation_deg: float,
        sun_azimuth_deg: float,
        disk: bool = True,
        change: Mapping[str, float] | None = None,
    ) -> Array:
        """Colours of the sky.

        Parameters
        ----------
        directions : array_like, shape (..., 3)
            Unit vectors in which to look (east, north, up).
        sun_elevation_deg, sun_azimuth_deg : float
            Of the Sun [degree]; azimuth from north through east.  Elevations beyond the table's count as its ends.
        disk : bool
            Whether the Sun's disk is seen.
        change : mapping, optional
            Factors on the haze, ozone and ground albedo of the table, to first order.

        Returns
        -------
        ndarray, shape (..., 3)
            XYZ [cd m-2].
        """
        seen = np.asarray(directions, float)
        flat = seen.reshape(-1, 3)
        elevation = np.arctan2(flat[:, 2], np.hypot(flat[:, 0], flat[:, 1]))
        sun = direction_from_azimuth_elevation(sun_azimuth_deg, sun_elevation_deg)
        azimuth = np.arctan2(flat[:, 0], flat[:, 1]) - np.radians(sun_azimuth_deg)
        turn = np.abs((azimuth + np.pi) % (2 * np.pi) - np.pi)
        light = self._joined(self._under(sun_elevation_deg, change or {}), elevation, turn)
        cosine = np.clip(flat @ sun, -1.0, 1.0)
        found = light[:, -1] + np.einsum("nt,ntc->nc", self._phases(cosine, elevation), light[:, :-1])
        if disk:
            found += self.disk(flat, sun, change or {})
        return np.asarray(found.reshape(seen.shape))

    def _under(self, sun_elevation_deg: float, change: Mapping[str, float]) -> Array:
        """Logarithms under a Sun, (block, 3, elevation, turn)."""
        nodes = self.arrays["sun"].astype(float)
        number, weight = cubic_weights(nodes, [np.clip(sun_elevation_deg, nodes[0], nodes[-1])])
        found = np.einsum("k,k...->...", weight[0], self._logarithms[number[0]])
        for k, step in self._steps(change):
            found += step * self._derivative(k, sun_elevation_deg)
        return np.asarray(found)

    def _steps(self, change: Mapping[str, float]) -> list[tuple[int, float]]:
        """Numbers of the derivatives that a change asks for, and what to multiply them with."""
        known = [entry["name"] for entry in self.header["changes"]]
        for name in change:
            if name not in known:
                raise DomainError("change", name, f"this table knows changes of {', '.join(known) or 'nothing'}")
        laws = [LAWS[entry["law"]] for entry in self.header["changes"]]
        return [(k, laws[k](float(change[name]))) for k, name in enumerate(known) if change.get(name, 1.0) != 1.0]

    def _derivative(self, k: int, sun_elevation_deg: float) -> Array:
        """Derivatives of the logarithms at the nodes under a Sun, by lines between coarser nodes."""
        found = float(self.header["change_step"]) * self.arrays["change"][k].astype(float)
        found = _on_lines(found, 0, self.arrays["change_sun"], np.array([sun_elevation_deg]))[0]
        for axis, name in ((2, "elevation"), (3, "turn")):
            found = _on_lines(found, axis, self.arrays[f"change_{name}"], self.arrays[name])
        return found

    def _joined(self, logarithms: Array, elevation: Array, turn: Array) -> Array:
        """Light along rays, (ray, block, 3)."""
        rows, across = self._rows(elevation)
        nodes = self.arrays["turn"].astype(float)
        last = nodes.size - 1
        mirrored = np.concatenate([[-nodes[1]], nodes, [2 * np.pi - nodes[-2]]])
        columns, along = cubic_weights(mirrored, turn)
        columns = np.abs(columns - 1)
        columns = np.where(columns > last, 2 * last - columns, columns)
        near = logarithms[:, :, rows[:, :, None], columns[:, None, :]]  # (block, 3, ray, 4, 4)
        return np.exp2(np.einsum("bcnij,ni,nj->nbc", near, across, along))

    def _rows(self, elevation: Array) -> tuple[NDArray[np.int64], Array]:
        """Nodes of elevation and their weights; nothing is joined across the horizon."""
        nodes, below = self.arrays["elevation"].astype(float), int(self.header["below"])
        rows, weights = np.empty((elevation.size, 4), np.int64), np.empty((elevation.size, 4))
        down = elevation < self.header["horizon"]
        for part, chosen, first in ((nodes[:below], down, 0), (nodes[below:], ~down, below)):
            number, weights[chosen] = cubic_weights(part, np.clip(elevation[chosen], part[0], part[-1]))
            rows[chosen] = number + first
        return rows, weights

    def _phases(self, cosine: Array, elevation: Array) -> Array:
        """Phase functions of the terms along rays, (ray, term) [sr-1]."""
        phase, near = self.arrays["phase"].astype(float), self.arrays["near"].astype(float)
        at = np.sqrt(0.5 * (1.0 - cosine)) * (phase.shape[1] - 1)
        cell = np.minimum(at.astype(int), phase.shape[1] - 2)
        share = _place(cosine, cell, phase.shape[1] - 1)
        found = (1 - share) * phase[:, cell] + share * phase[:, cell + 1]
        close = np.flatnonzero(cell + 1 < near.shape[2])
        if close.size:
            rows, across = self._rows(elevation[close])
            low, high = (near[:, rows, cell[close, None] + k] for k in (0, 1))
            lost = (1 - share[close, None]) * low + share[close, None] * high
            found[:, close] -= np.einsum("tnk,nk->tn", lost, across)
        return np.asarray(found.T)

    def disk(self, directions: Array, sun: Array, change: Mapping[str, float]) -> Array:
        """Light of the Sun's disk along rays (ray, 3); zero beside it [cd m-2]."""
        radius, rings = float(self.header["sun_radius"]), self.arrays["disk_rings"].astype(float)
        found = np.zeros((len(directions), 3))
        if radius <= 0:
            return found
        square = (np.linalg.norm(np.cross(directions, sun), axis=1) / np.sin(radius)) ** 2
        elevation = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
        seen = (square <= 1) & (directions @ sun > 0) & (elevation >= self.header["horizon"])
        ring = square[seen] * (len(rings) - 1)
        k = np.minimum(ring.astype(int), len(rings) - 2)
        share = (ring - k)[:, None]
        places, light = (self.arrays[name].astype(float) for name in ("disk_elevation", "disk_light"))
        for k, _ in self._steps(change):
            light += (change[self.header["changes"][k]["name"]] - 1.0) * self.arrays["disk_change"][k]
        through = np.stack([np.exp2(np.interp(elevation[seen], places, column)) for column in light.T], axis=1)
        found[seen] = through * ((1 - share) * rings[k] + share * rings[k + 1])
        return found


def fingerprint(scene: Scene) -> str:
    """A scene, wherever its Sun is, in few letters: equal for equal ones."""
    # Not the record's own text: in which form it writes a number depends on the release of its library.
    text = json.dumps(scene.model_dump(mode="json", exclude={"sun"}), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _on_lines(values: Array, axis: int, nodes: Array, points: Array) -> Array:
    """Values along an axis at other points, on lines between nodes."""
    first = np.clip(np.searchsorted(nodes, points, side="right") - 1, 0, nodes.size - 2)
    share = np.clip((points - nodes[first]) / (nodes[first + 1] - nodes[first]), 0.0, 1.0)
    share = share.reshape([-1 if k == axis else 1 for k in range(values.ndim)])
    return np.asarray((1 - share) * values.take(first, axis) + share * values.take(first + 1, axis))


def _place(cosine: Array, cell: NDArray[np.int64], last: int) -> Array:
    """Place from 0 to 1 in a cell between the cosines 1 - 2 (k / last)^2."""
    scale = 2.0 / (last * last)
    return np.asarray(np.clip((1.0 - scale * cell * cell - cosine) / (scale * (2 * cell + 1)), 0.0, 1.0))


def _filed(settings: SkySettings, scene: Scene, fineness: Fineness, lights: Lights, changes: Changes) -> SkyTableFile:
    """The table of what was seen."""
    observer, horizon = scene.observer, horizon_of(scene)
    low, step, light = _quantised(lights.logarithms())
    header = {
        "skyscatter": __version__,
        "scene": fingerprint(scene),
        "settings": {name: getattr(settings, name) for name in ("model", "haze", "ozone", "ground", "altitude_m")},
        "horizon": horizon,
        "below": fineness.below,
        "sun_radius": lights.disk.radius,
        "altitude": float(observer.altitude),
        "planet_radius": float(observer.planet_radius),
        "atmosphere_top": float(observer.atmosphere_top),
    }
    single = {
        "sun": np.array(fineness.suns),
        "elevation": fineness.elevations(horizon),
        "turn": fineness.azimuths(),
        "phase": lights.phase,
        "near": lights.near,
        "disk_elevation": lights.disk.elevation,
        "disk_light": np.log2(np.maximum(lights.disk.light, 1e-30)),
        "disk_rings": lights.disk.rings,
        "light_low": low,
        "light_step": step,
    }
    arrays: dict[str, NDArray[Any]] = {name: values.astype(np.float32) for name, values in single.items()}
    listed, derived = changes.filed()
    return SkyTableFile(header | listed, arrays | {"light": light} | derived)


def _quantised(logarithms: Array) -> tuple[Array, Array, NDArray[np.uint16]]:
    """Lowest values and steps (sun, block, 3), and numbers of steps as 16 bits."""
    low, high = logarithms.min(axis=(3, 4)), logarithms.max(axis=(3, 4))
    low = low.astype(np.float32).astype(float)
    step = (np.maximum(high - low, 1e-6) / 65534).astype(np.float32).astype(float)
    number = np.rint((logarithms - low[..., None, None]) / step[..., None, None])
    return low, step, np.clip(number, 0, 65535).astype(np.uint16)
