"""Gain and offset of every small cell: the model of a pixel, solved for the surface.

    rho = [(rho_toa / T_above - T_half rho_path) (1 - S rho_env) / T_water - T_down t_dif rho_env] / (T_down t_dir)

is linear in rho_toa once the surroundings rho_env are known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
#: Probability of a model below which its own surroundings are not worth their time.
SLIGHT = 0.05


@dataclass
class Coefficients:
    """What `skyscatter.kernels.raster.correct` takes.

    Attributes
    ----------
    gain, offset, bend : (band, small row, small column)
    haze : (2, band, small row, small column)
    model : (model, 2, band, small row, small column)
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
        self, table: TermsTable, others: Sequence[tuple[TermsTable, float]] | None, haze: HazeEstimate
    ) -> Coefficients:
        """Coefficients of the aerosol models' mean, with what the haze and the models may change.

        Parameters
        ----------
        table : TermsTable
            Of the best model.
        others : sequence of (TermsTable, float), optional
            Of the other models, and the probabilities that they are right.
        haze : HazeEstimate
        """
        others = others or ()
        best = 1.0 - sum(share for _, share in others)
        models = [(table, best), *others]
        # Each model sees another amount of haze in the same dark pixels.
        own = max(haze.depths[haze.aerosol], 1e-6)
        scales = [haze.depths[t.atmosphere.aerosol] / own for t, _ in models]
        terms = [self._terms(t, scale * haze.aod)[0] for (t, _), scale in zip(models, scales, strict=True)]
        # A model of little probability would change the surroundings by less than is known of them.
        around = self._around(terms[0])
        shares = np.array([share for _, share in models])
        solved = [np.stack(gain_and_offset(t, self.above, around if s < SLIGHT else self._around(t)))
                  for t, s in zip(terms, shares, strict=True)]  # fmt: skip
        mean = np.asarray(np.tensordot(shares, np.stack(solved), (0, 0)))
        apart = [np.sqrt(share) * (one - mean) for share, one in zip(shares, solved, strict=True) if share < 1]
        sigma = self.lattice.to_small(haze.sigma)
        by_haze = self._slope(table, haze, solved[0]) * sigma
        through = terms[0][..., DIRECT] + terms[0][..., DIFFUSE]
        contrast = np.nanstd(self.mean / self.above, axis=(1, 2))[:, None, None] / through
        scattered_in = AROUND_ERROR * terms[0][..., DIFFUSE] / terms[0][..., DIRECT] * contrast
        floor = np.hypot(np.hypot(table.error, PATH_ERROR * terms[0][..., PATH]) / through, scattered_in)
        none = np.zeros((len(through), 0, 0))
        bends = none if self.surroundings is not None else np.tensordot(shares, [t[..., BACK] for t in terms], (0, 0))
        by_model = two_rows(np.stack(apart)) if apart else np.zeros((0, *mean.shape))
        relative = np.hypot(self.gases.relative, WAY_ERROR)
        aod = float(shares @ scales) * self.lattice.to_small(haze.aod)
        return Coefficients(
            *(single(a) for a in (mean[0], mean[1], bends, by_haze, by_model, floor, relative, aod, sigma))
        )

    def _terms(self, table: TermsTable, aod: Array) -> list[Array]:
        """Terms of small cells, and their slopes over the haze, with the water vapour in them."""
        return [self._fine(t) for t in with_water(table.at(aod.ravel(), *self.angles, clip=True), self.gases)]

    def _slope(self, table: TermsTable, haze: HazeEstimate, solved: Array) -> Array:
        """Change of gain and offset per optical depth.

        By a finite step: the haze changes the surroundings too, of which a derivative would know nothing.
        """
        step = 0.01
        terms, slopes = self._terms(table, haze.aod)
        more = terms + step * slopes
        changed = np.stack(gain_and_offset(more, self.above, self._around(more)))
        return (changed - solved) / step

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


def two_rows(apart: Array) -> Array:
    """Deviations (model, 2, band, row, column) of factor and constant, as two that come to the same for any value.

    The square of a deviation is a quadratic form of the value: three numbers, whatever the number of models.
    """
    factor = np.sqrt((apart[:, 0] ** 2).sum(axis=0))
    constant = (apart[:, 1] ** 2).sum(axis=0)
    along = (apart[:, 0] * apart[:, 1]).sum(axis=0) / np.maximum(factor, 1e-12)
    return np.stack([
        np.stack([factor, along]), np.stack([np.zeros_like(factor), np.sqrt(np.maximum(constant - along**2, 0.0))]),
    ])  # fmt: skip


def single(values: Array) -> Single:
    """In the precision of the kernels."""
    return np.ascontiguousarray(values, np.float32)
