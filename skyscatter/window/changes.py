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
from skyscatter.window.solved import Fineness, horizon_of, solve_lights

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
    """Solve a sky and what it is changed to."""
    scene = settings.scene()
    first = solve_lights(scene, ROUGH, threads)
    before, disk = first.lights.logarithms(), np.log2(np.maximum(first.lights.disk.light, 1e-30))
    names, light, disks = [], [], []
    for name in settings.names():
        changed, factor = _changed(settings, scene, name)
        if changed is None:
            continue
        after = solve_lights(changed, ROUGH, threads, like=first).lights
        names.append(name)
        light.append((after.logarithms() - before) / LAWS[LAW_OF[name]](factor))
        disks.append((np.log2(np.maximum(after.disk.light, 1e-30)) - disk) / (factor - 1.0))
    horizon = horizon_of(scene)
    return Changes(
        tuple(names), np.array(ROUGH.suns), ROUGH.elevations(horizon), ROUGH.azimuths(),
        np.clip(np.array(light).reshape(-1, *before.shape), -LARGEST, LARGEST),
        np.array(disks).reshape(-1, *disk.shape),
    )  # fmt: skip


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
