"""Pictures with a plane for each filter."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.image.filters import FilterCurve, filter_curves

if TYPE_CHECKING:
    from skyscatter.image.photometry import Counts
    from skyscatter.image.skyframe import SkyFrame
    from skyscatter.image.spectral import SpectralImage


class FilterImage:
    """Band-averaged radiance, a plane for each filter.

    Parameters
    ----------
    radiance : array_like, shape (y, x, filter)
        Band averages [W m-2 sr-1 nm-1]; see `skyscatter.image.filters`.  NaN outside the camera's field.
    filters : sequence of FilterCurve, name or path
        In the order of the planes.
    standard_error : array_like, shape (y, x, filter), optional
        In the same unit.
    coverage : sequence of float, optional
        Share of each filter that the wavelengths of the spectral image covered; 1 by default.
    sky : SkyFrame, optional
        Where the picture stands in the sky.
    recipe : mapping, optional
        How to make the image again.
    layers : mapping of str to array_like, shape (y, x, filter), optional
        Named parts of the radiance, as in `SpectralImage`.

    Raises
    ------
    DomainError
        If shapes do not fit or a value is infinite.

    Examples
    --------
    A spectrum that grows as the wavelength does, through two bands.

    >>> import numpy as np
    >>> import skyscatter
    >>> wavelengths = np.arange(380, 751, 10)
    >>> cube = np.broadcast_to(1e-5 * wavelengths, (4, 6, wavelengths.size))
    >>> bands = skyscatter.SpectralImage(cube, wavelengths).through("B,V")
    >>> bands.names, bands.plane("V").shape
    (('B', 'V'), (4, 6))
    >>> [f"{bands.plane(name)[0, 0]:.2e}" for name in bands.names]  # W m-2 sr-1 nm-1
    ['4.42e-03', '5.51e-03']
    """

    def __init__(
        self,
        radiance: ArrayLike,
        filters: str | Iterable[Any],
        standard_error: ArrayLike | None = None,
        *,
        coverage: Iterable[float] | None = None,
        sky: SkyFrame | None = None,
        recipe: Mapping[str, Any] | None = None,
        layers: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        self.filters: tuple[FilterCurve, ...] = filter_curves(filters)
        self.radiance = _checked("radiance", radiance, len(self.filters))
        self.standard_error = (
            None if standard_error is None else _checked("standard_error", standard_error, len(self.filters))
        )
        if self.standard_error is not None and self.standard_error.shape != self.radiance.shape:
            raise DomainError("standard_error", self.standard_error.shape, "must have the shape of the radiance")
        self.coverage = (1.0,) * len(self.filters) if coverage is None else tuple(float(share) for share in coverage)
        if len(self.coverage) != len(self.filters):
            raise DomainError("coverage", self.coverage, "needs one share for each filter")
        self.sky = sky
        self.recipe: dict[str, Any] = dict(recipe or {})
        planes = len(self.filters)
        self.layers = {name: _checked(f"layer {name}", cube, planes) for name, cube in (layers or {}).items()}
        for name, cube in self.layers.items():
            if cube.shape != self.radiance.shape:
                raise DomainError(f"layer {name}", cube.shape, "must have the shape of the radiance")

    def __repr__(self) -> str:
        y, x, _ = self.radiance.shape
        return f"FilterImage({x} x {y} pixels, filters: {', '.join(self.names)})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the filters, in the order of the planes."""
        return tuple(curve.name for curve in self.filters)

    def plane(self, name: str) -> NDArray[Any]:
        """Band average through one filter [W m-2 sr-1 nm-1], shape (y, x)."""
        if name not in self.names:
            raise DomainError("filter", name, f"one of {', '.join(self.names)}")
        return self.radiance[..., self.names.index(name)]

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        dtype: str | None = None,
        compress: bool = False,
        unit: str | Counts | None = None,
    ) -> None:
        """Write a ``.fits`` file with a cube (filter, y, x), its standard error and the filters.

        Parameters
        ----------
        path : path-like
        dtype : {"float32", "float64"}, optional
            Of the arrays in the file; as they are when not given.
        compress : bool
            Compress tiles of the image, without loss.
        unit : str or Counts, optional
            Brightness in another unit than W m-2 sr-1 nm-1, such as ``"ABmag arcsec-2"``; see
            `skyscatter.image.photometry`.  Layers are left out then.
        """
        if Path(path).suffix.lower() != ".fits":
            raise DomainError("output file", str(path), "pictures with a plane per filter go to .fits files")
        importlib.import_module("skyscatter.image.filterfits").write(self, Path(path), dtype, compress, unit)

    @staticmethod
    def load(path: str | os.PathLike[str], filters: str | Iterable[Any] | None = None) -> FilterImage:
        """Read a ``.fits`` file that `save` wrote, or a picture of two axes through one filter.

        Parameters
        ----------
        path : path-like
            Of a picture of two axes the card ``FILTER`` names the filter; ``BUNIT`` may be any unit of spectral
            radiance that astropy knows, such as ``MJy/sr``, and is ours where it is absent.
        filters : str or iterable, optional
            Filters in place of those that the file names, as for `SpectralImage.through`.

        Raises
        ------
        MissingDataError, DomainError
            If there is no such file, or it holds no planes of filters.
        """
        if not Path(path).is_file():
            raise MissingDataError(path, "there is no such file; check the path")
        image: FilterImage = importlib.import_module("skyscatter.image.filterfits").read(Path(path), filters)
        return image


def through(
    image: SpectralImage, filters: str | Iterable[Any], errors: Literal["correlated", "independent"] = "correlated"
) -> FilterImage:
    """Look at a spectral image through filters; see `SpectralImage.through`."""
    curves = filter_curves(filters)
    if errors not in ("correlated", "independent"):
        raise DomainError("errors", errors, "choose correlated or independent")
    found = [curve.weights(image.wavelengths) for curve in curves]
    weights = np.stack([share for share, _ in found], axis=1)

    def averaged(cube: NDArray[Any], deviation: bool) -> NDArray[Any]:
        if deviation and errors == "independent":
            return np.asarray(np.sqrt(np.square(cube, dtype=float) @ weights**2))
        return np.asarray(cube @ weights)

    deviation = None if image.standard_error is None else averaged(image.standard_error, True)
    return FilterImage(
        image.radiance @ weights,
        curves,
        deviation,
        coverage=[share for _, share in found],
        sky=image.sky,
        recipe=image.recipe,
        layers={name: averaged(cube, name.endswith("_error")) for name, cube in image.layers.items()},
    )


def _checked(name: str, values: ArrayLike, planes: int) -> NDArray[Any]:
    cube = np.asarray(values)
    cube = np.ascontiguousarray(cube, dtype=np.float32 if cube.dtype == np.float32 else np.float64)
    if cube.ndim != 3 or cube.size == 0 or cube.shape[2] != planes:
        raise DomainError(name, f"shape {cube.shape}", f"must be (y, x, filter) with {planes} filters")
    if np.isinf(cube).any():
        raise DomainError(name, "infinite", "must be finite, or NaN outside the camera's field")
    return cube
