"""Gain and offset of every small cell: the model of a pixel, solved for the surface.

    rho = [(rho_toa / T_above - T_half rho_path) (1 - S rho_env) / T_water - T_down t_dif rho_env] / (T_down t_dir)

is linear in rho_toa once the surroundings rho_env are known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze.estimate import HazeEstimate
from skyscatter.dehaze.forward import BACK, DIFFUSE, DIRECT, PATH, surface_reflectance
from skyscatter.dehaze.lattice import Lattice
from skyscatter.dehaze.sensing import Gases, with_water
from skyscatter.dehaze.table import TermsTable

Array = NDArray[np.float64]
Single = NDArray[np.float32]

#: Relative error of the path reflectance: of the solver, of optics and profile of a model that is otherwise right.
PATH_ERROR = 0.006
#: Relative error of the way down and up: of the same.
WAY_ERROR = 0.005
#: Part of the contrast between surroundings that is not known of what lies around a pixel: beyond the image, under
#: clouds, and in the spread function.
AROUND_ERROR = 0.1


@dataclass
class Coefficients:
    """What `skyscatter.dehaze.kernels.correct` takes.

    Attributes
    ----------
    gain, offset, bend : (band, small row, small column)
    haze, model : (2, band, small row, small column)
    floor : (band, small row, small column)
    relative : (band,)
    aod, aod_sigma : (small row, small column)
    """

    gain: Single
    offset: Single
    bend: Single
    haze: Single
    model: Single
    floor: Single
    relative: Single
    aod: Single
    aod_sigma: Single


def gain_and_offset(terms: Array, above: Array, around: Array | None) -> tuple[Array, Array]:
    """Solution for the surface, (band, ...), from terms (band, ..., term) and gases above (band, ...).

    Without surroundings (`around` is None) the pixel stands for them, and the result is rho / (1 - S rho).
    """
    if around is None:
        gain = 1 / (terms[..., DIRECT] + terms[..., DIFFUSE])
        return gain / above, -gain * terms[..., PATH]
    back = 1 - terms[..., BACK] * around
    gain = back / terms[..., DIRECT]
    offset = -(gain * terms[..., PATH] + terms[..., DIFFUSE] * around / terms[..., DIRECT])
    return gain / above, offset


class Corrector:
    """Makes the coefficients of an image.

    Parameters
    ----------
    lattice : Lattice
    angles : array, shape (3, large row, large column)
        [degree].
    gases : Gases
        At the centres of large cells.
    mean : array, shape (band, small row, small column)
        Mean reflectance above the atmosphere, NaN where unknown.
    surroundings : callable or None
        From cell reflectances (band, small row, small column) to those of the surroundings; None to leave them out.
    """

    def __init__(
        self, lattice: Lattice, angles: Array, gases: Gases, mean: Single, surroundings: Callable[[Array], Array] | None
    ) -> None:
        self.lattice, self.angles, self.gases = lattice, angles.reshape(3, -1), gases
        self.mean, self.surroundings = mean.astype(float), surroundings
        self.above = self._fine(gases.above)

    def coefficients(
        self, table: TermsTable, other: tuple[TermsTable, float] | None, haze: HazeEstimate
    ) -> Coefficients:
        """Coefficients under the best aerosol model, with what the haze and another model may change.

        Parameters
        ----------
        table : TermsTable
        other : (TermsTable, float), optional
            The next best model and the probability that it is right.
        haze : HazeEstimate
        """
        terms, slopes = (self._fine(t) for t in with_water(table.at(haze.aod.ravel(), *self.angles), self.gases))
        gain, offset = gain_and_offset(terms, self.above, self._around(terms))
        sigma = self.lattice.to_small(haze.sigma)
        # A finite step: the haze changes the surroundings too, of which a derivative would know nothing.
        step = 0.01
        more = terms + step * slopes
        changed = gain_and_offset(more, self.above, self._around(more))
        by_haze = np.stack([(c - was) / step * sigma for c, was in zip(changed, (gain, offset), strict=True)])
        by_model = np.zeros_like(by_haze)
        if other is not None:
            theirs = self._fine(with_water(other[0].at(haze.aod.ravel(), *self.angles), self.gases)[0])
            changed = gain_and_offset(theirs, self.above, self._around(theirs))
            share = np.sqrt(other[1])
            by_model = np.stack([share * (c - was) for c, was in zip(changed, (gain, offset), strict=True)])
        through = terms[..., DIRECT] + terms[..., DIFFUSE]
        contrast = np.nanstd(self.mean / self.above, axis=(1, 2))[:, None, None] / through
        scattered_in = AROUND_ERROR * terms[..., DIFFUSE] / terms[..., DIRECT] * contrast
        floor = np.hypot(np.hypot(table.error, PATH_ERROR * terms[..., PATH]) / through, scattered_in)
        bend = terms[..., BACK] if self.surroundings is None else np.zeros((len(gain), 0, 0))
        aod = self.lattice.to_small(haze.aod)
        return Coefficients(
            *(
                single(a)
                for a in (
                    gain,
                    offset,
                    bend,
                    by_haze,
                    by_model,
                    floor,
                    np.hypot(self.gases.relative, WAY_ERROR),
                    aod,
                    sigma,
                )
            )
        )

    def _fine(self, values: Array) -> Array:
        """From large cells (place, band, ...) to small ones (band, row, column, ...)."""
        shaped = values.reshape(*self.lattice.large_shape, *values.shape[1:])
        moved = np.moveaxis(shaped, (0, 1), (-2, -1))
        fine = self.lattice.to_small(moved)
        return np.ascontiguousarray(np.moveaxis(fine, 1, -1)) if fine.ndim == 4 else fine

    def _around(self, terms: Array) -> Array | None:
        """Reflectance of the surroundings of cells; None if pixels stand for their own."""
        if self.surroundings is None:
            return None
        own = surface_reflectance(terms, self.mean / self.above)
        known = np.isfinite(own)
        around = self.surroundings(np.where(known, np.clip(own, 0.0, 1.0), np.nan))
        middle = np.array([np.median(band[k]) if k.any() else 0.1 for band, k in zip(own, known, strict=True)])
        return np.clip(np.where(np.isfinite(around), around, middle[:, None, None]), 0.0, 1.0)


def single(values: Array) -> Single:
    """In the precision of the kernels."""
    return np.ascontiguousarray(values, np.float32)
