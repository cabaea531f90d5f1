"""What little changes of haze, ozone and ground do to a sky: derivatives of the logarithms of its light.

They are differences between coarse solutions, and so a first answer, until a table of the changed sky is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.spectra.table import SpectralTable
from skyscatter.window.colours import EVERY
from skyscatter.window.settings import MOST, SkySettings
from skyscatter.window.solved import Fineness, Lights, horizon_of, solve_lights
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.scene import Scene

Array = NDArray[np.float64]

#: What derivatives are multiplied with for a factor: haze and ground send light on in proportion, and so logarithms
#: of both sides go together; ozone takes light away in proportion, and only the light's logarithm goes with it.
LAWS: dict[str, Callable[[float], float]] = {
    "power": lambda factor: math.log2(max(factor, 1e-6)),
    "exponential": lambda factor: factor - 1.0,
}
LAW_OF = {"haze": "power", "ozone": "exponential", "ground": "power"}
#: Factor between the solutions that are compared.
FACTOR = 1.25
#: Derivatives beyond this are noise, of light that is next to nothing.
LARGEST = 8.0
#: How coarse the solutions are.
ROUGH = Fineness(
    tolerance=0.04, wavelengths=8, below=5, above=12, turns=6,
    suns=(-14.0, -11.0, -8.0, -5.5, -3.5, -2.0, -1.0, 0.0, 1.0, 2.0, 3.5, 6.0, 10.5, 18.0, 31.0, 48.0, 69.0, 90.0),
)  # fmt: skip


@dataclass(frozen=True)
class Changes:
    """Derivatives at nodes of their own.

    Attributes
    ----------
    names : tuple of str
    sun, elevation, turn : ndarray
        Nodes [degree, rad, rad].
    light : ndarray, shape (name, sun, block, 3, elevation, turn)
        Change of the binary logarithms per unit of the `LAWS`.
    disk : ndarray, shape (name, place, 3)
        Change of the binary logarithms of the disk's light per unit of the factor.
    """

    names: tuple[str, ...]
    sun: Array
    elevation: Array
    turn: Array
    light: Array
    disk: Array

    def filed(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Entries of a table's header, and its arrays."""
        step = max(float(np.abs(self.light).max(initial=0.0)), 1e-6) / 32767
        arrays: dict[str, NDArray[Any]] = {
            f"change_{name}": getattr(self, name).astype(np.float32) for name in ("sun", "elevation", "turn")
        }
        arrays |= {"change": np.rint(self.light / step).astype(np.int16), "disk_change": self.disk.astype(np.float32)}
        return {"changes": [{"name": name, "law": LAW_OF[name]} for name in self.names], "change_step": step}, arrays


def solve_changes(settings: SkySettings, threads: int) -> Changes:
    """Solve a sky and what it is changed to, on the same grid, one in each thread."""
    scene = settings.scene()
    first = solve_lights(scene, ROUGH, threads)
    others = {name: _changed(settings, scene, name) for name in settings.names()}
    known = {name: (other, factor) for name, (other, factor) in others.items() if other is not None}
    with Workers(threads) as pool:
        asked = [pool.submit(solve_lights, other, ROUGH, 1, None, first) for other, _ in known.values()]
        lights = [solved.result().lights for solved in asked]
    before, disk = first.lights.logarithms(), _disk_logarithm(first.lights)
    light = [
        (after.logarithms() - before) / LAWS[LAW_OF[name]](factor)
        for after, (name, (_, factor)) in zip(lights, known.items(), strict=True)
    ]
    disks = [
        (_disk_logarithm(after) - disk) / (factor - 1.0)
        for after, (_, factor) in zip(lights, known.values(), strict=True)
    ]
    horizon = horizon_of(scene)
    return Changes(
        tuple(known), np.array(ROUGH.suns), ROUGH.elevations(horizon), ROUGH.azimuths(),
        np.clip(np.array(light).reshape(-1, *before.shape), -LARGEST, LARGEST),
        np.array(disks).reshape(-1, *disk.shape),
    )  # fmt: skip


def no_changes() -> Changes:
    """Derivatives of nothing, for a table that shall be there at once."""
    nodes = np.zeros(2)
    return Changes((), nodes, nodes, nodes, np.zeros((0, 2, 0, 3, 2, 2)), np.zeros((0, 2, 3)))


def _disk_logarithm(lights: Lights) -> Array:
    return np.asarray(np.log2(np.maximum(lights.disk.light, 1e-30)))


def _changed(settings: SkySettings, scene: Scene, name: str) -> tuple[Scene | None, float]:
    """A scene with more of something, and how much more; none where there is nothing to have more of."""
    if name != "ground":
        amount = getattr(settings, name)
        factor = FACTOR if amount * FACTOR <= MOST else 1.0 / FACTOR
        return (settings.changed(**{name: factor * amount}).scene(), factor) if amount > 0 else (None, 1.0)
    albedo = scene.ground.reflectance(EVERY)
    if not albedo.any():
        return None, 1.0
    factor = FACTOR if albedo.max() * FACTOR <= 1.0 else 1.0 / FACTOR
    other = SpectralTable(wavelengths=tuple(EVERY), values=tuple(factor * albedo))
    return scene.model_copy(update={"ground": scene.ground.model_copy(update={"albedo": other})}), factor
