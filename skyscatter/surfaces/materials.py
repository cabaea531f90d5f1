"""What surfaces are made of: the light that they throw back, let through or keep."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.media.arrays import ArrayField, check_classes, read_cube
from skyscatter.record import Record
from skyscatter.spectra.surfaces import check_albedo, spectrum_of
from skyscatter.spectra.table import (
    Albedo,
    OptionalSpectral,
    SpectralNonNegative,
    SpectralPositive,
    SpectralShare,
    evaluate,
)
from skyscatter.surfaces.grounds import RossLi, Rpv, Sea
from skyscatter.surfaces.indices import check_metal, metal_index
from skyscatter.units import Metres, Number, OptionalNumber, PositiveMetres, default

Array = NDArray[np.float64]
#: Least GGX alpha of a rough surface: below it the lobe is narrower than anything that could be told from smooth.
LEAST_ROUGHNESS = 1e-3


class Interface(Record):
    """A boundary of a medium that light does not notice: fog in a box, the edge of a cloud.

    Examples
    --------
    A ball of black smoke, 2 m across, under a uniform sky: with a mean free path of 1 m it lets exp(-2) of the light
    through.

    >>> import skyscatter
    >>> from skyscatter import surfaces
    >>> soot = skyscatter.Component(
    ...     name="soot", density={"kind": "everywhere"}, optics={"kind": "artist", "colour": 0.0, "distance": "1 m"}
    ... )
    >>> media = (surfaces.SurfaceMedium(name="air"), surfaces.SurfaceMedium(name="smoke", components=(soot,)))
    >>> ball = surfaces.Body(shape=surfaces.Sphere(radius="1 m"), material=surfaces.Interface(), inside="smoke")
    >>> scene = surfaces.SurfaceScene(media=media, bodies=(ball,), lamps=(surfaces.Surroundings(radiance=1.0),))
    >>> result = skyscatter.radiance(scene, (0, 0, 5), (0, 0, -1), [550], solver=skyscatter.Path(samples=16))
    >>> result.radiance.round(2).tolist()  # W m-2 sr-1 nm-1
    [0.14]
    """

    kind: Literal["interface"] = "interface"


class Lambert(Record):
    """An opaque surface, equally bright from all sides.

    Parameters
    ----------
    albedo : float or SpectralTable or str
        Reflected share of the light, 0 to 1, or the name of a surface of the shipped table (``"snow"``, ...).

    Examples
    --------
    Leaves are greenish, and bright in the near infrared:

    >>> from skyscatter import surfaces
    >>> surfaces.Lambert(albedo="vegetation").reflectance([450, 550, 650, 850]).round(2).tolist()
    [0.08, 0.13, 0.07, 0.53]
    """

    kind: Literal["lambert"] = "lambert"
    albedo: Albedo = default(0.5)

    @model_validator(mode="after")
    def _check(self) -> Lambert:
        check_albedo(self.albedo)
        return self

    def reflectance(self, wavelengths_nm: ArrayLike) -> Array:
        """Albedo per wavelength, shape (wavelength,)."""
        return spectrum_of(self.albedo, wavelengths_nm)


class Mirror(Record):
    """A smooth opaque surface that reflects the same share at every angle.

    Parameters
    ----------
    reflectance : float or SpectralTable
        0 to 1.

    Examples
    --------
    A mirror under a uniform sky shows its share of the sky's radiance:

    >>> import skyscatter
    >>> from skyscatter import surfaces
    >>> floor = surfaces.Body(shape=surfaces.Plane(), material=surfaces.Mirror(reflectance=0.9))
    >>> scene = surfaces.SurfaceScene(bodies=(floor,), lamps=(surfaces.Surroundings(radiance=1.0),))
    >>> result = skyscatter.radiance(scene, (0, 0, 1), (0, 0.8, -0.6), [550], solver=skyscatter.Path(samples=4))
    >>> result.radiance.round(2).tolist()  # W m-2 sr-1 nm-1
    [0.9]
    """

    kind: Literal["mirror"] = "mirror"
    reflectance: SpectralShare = default(1.0)


def _check_roughness(value: float) -> None:
    if value != 0 and not LEAST_ROUGHNESS <= value <= 1:
        raise DomainError("roughness", value, f"is 0 (smooth) or lies between {LEAST_ROUGHNESS} and 1")


class Dielectric(Record):
    """A clear surface: it reflects by Fresnel's equations and refracts the rest.

    The refractive indices are those of the media on both sides, so water, glass, air bubbles are told by what is
    inside of a body and around it.

    Parameters
    ----------
    roughness : float
        Alpha of the GGX distribution of slopes (about the root mean square slope over sqrt 2); 0 for a smooth surface.

    Examples
    --------
    In the middle of a clear ball the sky's radiance is n^2 times that outside:

    >>> import skyscatter
    >>> from skyscatter import surfaces
    >>> media = (surfaces.SurfaceMedium(name="air"), surfaces.SurfaceMedium(name="water", index="water"))
    >>> drop = surfaces.Body(shape=surfaces.Sphere(), material=surfaces.Dielectric(), inside="water")
    >>> scene = surfaces.SurfaceScene(media=media, bodies=(drop,), lamps=(surfaces.Surroundings(radiance=1.0),))
    >>> result = skyscatter.radiance(scene, (0, 0, 0), (0, 0, 1), [589], solver=skyscatter.Path(samples=16))
    >>> result.radiance.round(2).tolist(), (surfaces.refractive_index("water", [589]) ** 2).round(2).tolist()
    ([1.78], [1.78])
    """

    kind: Literal["dielectric"] = "dielectric"
    roughness: Number = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Dielectric:
        _check_roughness(self.roughness)
        return self


class Conductor(Record):
    """A metal: it reflects by Fresnel's equations with a complex index and keeps the rest.

    Parameters
    ----------
    metal : str, optional
        ``"gold"``, ``"silver"``, ``"copper"`` or ``"aluminium"``, with measured indices.
    n, k : float or SpectralTable, optional
        Real and imaginary part of the index, instead of `metal`.
    roughness : float
        As for `Dielectric`.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: if the metal is unknown, or both its name and an index are given.

    Notes
    -----
    Gold, silver and copper: Johnson & Christy (1972), Phys. Rev. B 6, 4370, from 188 to 1937 nm.  Aluminium, without
    oxide: Rakic (1995), Appl. Opt. 34, 4755, from 207 to 2066 nm.  Linear between their wavelengths; `index` raises a
    `DomainError` beyond them.

    Examples
    --------
    Gold at normal incidence keeps the blue and reflects the red:

    >>> from skyscatter import surfaces
    >>> n, k = surfaces.Conductor(metal="gold").index([450, 550, 650])
    >>> (((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)).round(2).tolist()
    [0.41, 0.79, 0.96]
    """

    kind: Literal["conductor"] = "conductor"
    metal: str | None = None
    n: OptionalSpectral[SpectralPositive] = default(None)
    k: OptionalSpectral[SpectralNonNegative] = default(None)
    roughness: Number = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Conductor:
        _check_roughness(self.roughness)
        if self.metal is not None:
            check_metal(self.metal)
            if self.n is not None or self.k is not None:
                raise DomainError("metal", self.metal, "give either the metal's name, or n and k")
        elif self.n is None or self.k is None:
            raise DomainError("metal", None, "give the metal's name, or both n and k")
        return self

    def index(self, wavelengths_nm: ArrayLike) -> tuple[Array, Array]:
        """Its n and k per wavelength, each of shape (wavelength,)."""
        if self.metal is not None:
            return metal_index(self.metal, wavelengths_nm)
        return evaluate(self.n, wavelengths_nm), evaluate(self.k, wavelengths_nm)


Opaque = Lambert | Mirror | Conductor | Rpv | RossLi | Sea
AnyOpaque = Annotated[Opaque, Field(discriminator="kind")]


class Mosaic(Record):
    """A picture of opaque materials that lies on a surface, seen straight from above, along the z axis.

    Row 0 is in the north (y) and column 0 in the west (x), as in every picture.  Give `classes`, or a `file` of them.

    Parameters
    ----------
    classes : array_like of int, shape (y, x)
        Which of `materials` each cell has, counted from 0.
    file : str
        A .npy or .npz file with the classes.
    materials : tuple of material
        Any that lets no light through.
    rest : material
        What lies around the picture.
    cell_size : length
        Side of a cell [m].
    middle : (length, length)
        x and y of the middle of the picture [m].
    lowest : length
        Height z below which there is nothing but the rest [m]; without limit if not given.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: for classes that no material has, or if neither or both of classes and file are given.
    MissingDataError
        When the file is first needed, if it cannot be read.

    Examples
    --------
    A coast: grass in the north, the sea in the south and all around.

    >>> from skyscatter import surfaces
    >>> grass, sea = surfaces.Lambert(albedo="vegetation"), surfaces.Sea(wind_speed=6)
    >>> coast = surfaces.Mosaic(classes=[[1, 1], [0, 0]], materials=[sea, grass], rest=sea, cell_size="2 km")
    >>> coast.cells.tolist()
    [[1, 1], [0, 0]]
    """

    kind: Literal["mosaic"] = "mosaic"
    classes: ArrayField = None
    file: str | None = None
    materials: tuple[AnyOpaque, ...]
    rest: AnyOpaque
    cell_size: PositiveMetres
    middle: tuple[Metres, Metres] = default((0.0, 0.0))
    lowest: OptionalNumber[Metres] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Mosaic:
        if (self.classes is None) == (self.file is None):
            rule = "give either the classes of all cells, or a file of them"
            raise DomainError("classes", None if self.classes is None else "an array", rule)
        if not self.materials:
            raise DomainError("materials", 0, "at least one of them")
        if self.classes is not None:
            check_classes("classes", self.classes.array, len(self.materials), "materials")
        return self

    @property
    def cells(self) -> NDArray[np.int64]:
        """Which of `materials` each cell has, shape (y, x)."""
        values = self.classes.array if self.file is None else read_cube(self.file)
        if self.file is not None:
            check_classes("file", values, len(self.materials), "materials")
        return np.asarray(values, np.int64)


Material = Interface | Lambert | Mirror | Dielectric | Conductor | Rpv | RossLi | Sea | Mosaic
AnyMaterial = Annotated[Material, Field(discriminator="kind")]
