"""What a tomography returns."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.voxelscene import VoxelFrame

if TYPE_CHECKING:
    from skyscatter.media.voxels import VoxelGrid

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Reconstruction(Brief):
    """Densities found from images, and how well they explain them.

    Attributes
    ----------
    frame : VoxelFrame
    names : tuple of str
        Of the components.
    density : ndarray, shape (component, x, y, z)
    deviation : ndarray, shape (component, x, y, z), or None
        Standard deviation, if it was asked for.
    fitted, residuals, multiple : tuple of ndarray, each of shape (y, x, wavelength)
        For every view: what the estimate should show, (data - fitted) / sigma, and the light scattered more than once
        that is in `fitted`.
    chi2 : float
        Sum of the squared residuals.
    count : int
        Of data.
    prior_weight : float
    history : tuple of dict
        Every minimisation: cells, weight of the prior, chi^2, iterations, round.
    diagnostics : dict
        Why it stopped, evaluations, seconds.

    Examples
    --------
    Data of 2 % noise are met within it: chi^2 is near their number.  A density goes on as a field.

    >>> import numpy as np
    >>> from skyscatter.inversion import ImageView, VoxelFrame, VoxelLights, VoxelModel, VoxelOptics, reconstruct
    >>> frame = VoxelFrame.cube(8, 1.0)
    >>> model = VoxelModel(frame, VoxelOptics.columns(), VoxelLights.none(1), np.zeros(1))
    >>> image = np.exp(-4 * (frame.middles() ** 2).sum(axis=-1)).sum(axis=2) * frame.cell[2]
    >>> x, y, z = np.eye(3)
    >>> views = [ImageView.parallel(image, 0.02, *axes, half_width=1.0) for axes in ((x, y), (y, z), (z, x))]
    >>> found = reconstruct(views, model)
    >>> found.count, bool(abs(found.chi2 / found.count - 1) < 0.1)
    (192, True)
    >>> found.field().cube.shape
    (8, 8, 8)
    """

    frame: VoxelFrame
    names: tuple[str, ...]
    density: Array
    deviation: Array | None
    fitted: tuple[Array, ...]
    residuals: tuple[Array, ...]
    multiple: tuple[Array, ...]
    chi2: float
    count: int
    prior_weight: float
    history: tuple[dict[str, Any], ...]
    diagnostics: dict[str, Any] = field(default_factory=dict)

    def field(self, component: int | str = 0) -> VoxelGrid:
        """A density as a field, to render it or to go on with."""
        return self.frame.grid(np.array(self.density[self._index(component)]))

    def total(self, component: int | str = 0) -> float:
        """Integral of a density over space [m3]; times what a unit of it weighs, its mass."""
        return float(self.density[self._index(component)].sum() * self.frame.volume)

    def _index(self, component: int | str) -> int:
        if isinstance(component, str):
            if component not in self.names:
                raise DomainError("component", component, f"choose from {', '.join(self.names)}")
            return self.names.index(component)
        if not 0 <= component < len(self.density):
            raise DomainError("component", component, f"from 0 to {len(self.density) - 1}")
        return component

    def save(self, path: str | os.PathLike[str], **more: Array) -> None:
        """Write an .npz file, whole or not at all; with `more` arrays by other names, which `load` leaves out."""
        about = {
            "names": self.names, "shape": self.frame.shape, "low": self.frame.low, "high": self.frame.high,
            "chi2": self.chi2, "count": self.count, "prior_weight": self.prior_weight, "history": self.history,
            "diagnostics": self.diagnostics, "views": len(self.fitted),
        }  # fmt: skip
        arrays: dict[str, Any] = {"density": self.density, **more}
        if self.deviation is not None:
            arrays["deviation"] = self.deviation
        for name in ("fitted", "residuals", "multiple"):
            arrays |= {f"{name}_{k}": image for k, image in enumerate(getattr(self, name))}
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Reconstruction:
        """Read back what `save` wrote."""
        if not Path(path).is_file():
            raise MissingDataError(path, "no such file; check the path")
        try:
            with np.load(path, allow_pickle=False) as file:
                about = json.loads(str(file["about"]))
                fitted, residuals, multiple = (
                    tuple(file[f"{name}_{k}"] for k in range(about["views"]))
                    for name in ("fitted", "residuals", "multiple")
                )
                deviation = file["deviation"] if "deviation" in file.files else None
                frame = VoxelFrame(about["shape"], about["low"], about["high"])
                return cls(
                    frame, tuple(about["names"]), file["density"], deviation, fitted, residuals, multiple,
                    about["chi2"], about["count"], about["prior_weight"], tuple(about["history"]), about["diagnostics"],
                )  # fmt: skip
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise DomainError(
                "reconstruction file", str(path), f"was not written by Reconstruction.save ({error})"
            ) from error
