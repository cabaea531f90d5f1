"""The surface of a planet: a Lambertian reflector, uniform or painted with a map, or any other opaque material."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.media.arrays import ArrayField, check_classes
from skyscatter.record import Record
from skyscatter.spectra.surfaces import check_albedo, spectrum_of
from skyscatter.spectra.table import Albedo, Albedos
from skyscatter.surfaces.materials import AnyMaterial
from skyscatter.units import PositiveMetres, default

#: Albedos that a map can tell apart; the kernels number them, and what lies outside, in a byte.
MOST_CLASSES = 255


class GroundMap(Record):
    """A picture of the ground below the observer, made of cells that reflect by one of a few spectra.

    The middle of the map lies straight below the observer, row 0 in the north and column 0 in the west, as in every
    picture.  A point of the ground is found by its coordinates x (east) and y (north) in the scene's frame: on a
    sphere the map is seen from straight above, and at a distance x from its middle distances are shortened by
    x^2 / 6 R^2, a millionth at 15 km on the Earth.

    Parameters
    ----------
    classes : array_like of int, shape (y, x)
        Which of `albedos` each cell has, counted from 0.
    albedos : sequence of float, SpectralTable or str, at most 255
        As for `Ground`.
    cell_size : length
        Side of a cell [m].

    Examples
    --------
    A coast: land in the north, water in the south.

    >>> import skyscatter
    >>> coast = skyscatter.GroundMap(classes=[[1, 1], [0, 0]], albedos=["water", "vegetation"], cell_size="2 km")
    >>> ground = skyscatter.Ground(albedo="vegetation", map=coast)
    >>> coast.reflectance([550, 850]).round(2)  # a row for each class, a column for each wavelength
    array([[0.05, 0.  ],
           [0.13, 0.53]])
    """

    classes: ArrayField
    albedos: Albedos
    cell_size: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> GroundMap:
        if not 1 <= len(self.albedos) <= MOST_CLASSES:
            raise DomainError("albedos", len(self.albedos), f"1 to {MOST_CLASSES} of them")
        check_classes("classes", self.classes.array, len(self.albedos), "albedos")
        for albedo in self.albedos:
            check_albedo(albedo)
        return self

    @property
    def rows(self) -> NDArray[np.uint8]:
        """The cells as the kernels number them: from 1, for 0 is what lies outside the map; shape (y, x)."""
        return (self.classes.array + 1).astype(np.uint8)

    def reflectance(self, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
        """Albedo of every class, shape (class, wavelength)."""
        return np.stack([spectrum_of(albedo, wavelengths_nm) for albedo in self.albedos])


class Ground(Record):
    """The planet's surface, a Lambertian reflector if no material is given.

    Parameters
    ----------
    albedo : float or SpectralTable or str
        Reflected share of the light, 0 to 1, or the name of a surface (``"vegetation"``, ``"snow"``, ...).
    map : GroundMap, optional
        Cells with other albedos around the point below the observer; `albedo` then is that of everything outside
        them.  For the solvers ``path`` and ``single``.
    material : material, optional
        What the ground does to light, in place of `albedo` and `map`: such as `skyscatter.surfaces.Rpv` or
        `skyscatter.surfaces.RossLi` for land, `skyscatter.surfaces.Sea`, and a `skyscatter.surfaces.Mosaic` of
        such.  For the solver ``path``.

    Notes
    -----
    The spectra of named surfaces go from 300 to 1100 nm and are constant beyond.

    Examples
    --------
    Fresh snow in blue light and in the near infrared, and a spectrum of one's own.

    >>> import skyscatter
    >>> skyscatter.Ground(albedo="snow").reflectance([450, 1000]).round(2)
    array([0.99, 0.79])
    >>> skyscatter.Ground(albedo={"wavelengths": [400, 700], "values": [0.1, 0.4]}).reflectance([500]).round(2)
    array([0.2])
    """

    albedo: Albedo = default(0.0)
    map: GroundMap | None = None
    material: AnyMaterial | None = None

    @model_validator(mode="after")
    def _check(self) -> Ground:
        check_albedo(self.albedo)
        if self.material is None:
            return self
        if self.material.kind in ("interface", "dielectric"):
            rule = (
                "lets light into the planet, which holds nothing; take an opaque material, or put a body on the ground"
            )
            raise DomainError("material", self.material.kind, rule)
        for name in ("albedo", "map"):
            if name in self.model_fields_set and getattr(self, name) not in (0.0, None):
                raise DomainError(name, getattr(self, name), "the ground's material says it all; leave one of them out")
        return self

    def reflectance(self, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
        """Albedo outside the map per wavelength, shape (wavelength,)."""
        return spectrum_of(self.albedo, wavelengths_nm)
