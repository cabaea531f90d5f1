"""A medium: a weighted sum of components, each a density field times an optical model."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.media.everywhere import Everywhere
from skyscatter.media.fields import DensityField, Profile
from skyscatter.media.operations import Spatial
from skyscatter.media.space import SpatialField
from skyscatter.optics.absorption import GasAbsorption, TabulatedAbsorption
from skyscatter.optics.artist import ArtistMedium
from skyscatter.optics.base import OpticalModel
from skyscatter.optics.dust import Dust
from skyscatter.optics.lines import GasLines
from skyscatter.optics.mie import MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.optics.rayleigh import RayleighAir, RayleighPowerLaw
from skyscatter.record import Record
from skyscatter.registry import open_to
from skyscatter.spectra.table import Emission
from skyscatter.units import NonNegative, OptionalNumber, PositiveMetres, default

AnyOptics = Annotated[
    RayleighPowerLaw
    | RayleighAir
    | Particles
    | MieAerosol
    | GasAbsorption
    | TabulatedAbsorption
    | Dust
    | GasLines
    | ArtistMedium,
    Field(discriminator="kind"),
    *open_to(OpticalModel),
]

AnyDensity = Annotated[
    Profile | Spatial | Everywhere, Field(discriminator="kind"), *open_to(DensityField), *open_to(SpatialField)
]


class Component(Record):
    """One constituent of a medium.

    Parameters
    ----------
    name : str
        How it is called; each of a medium has a name of its own.
    density : density field
        Where it is.
    optics : optical model
        What one unit of density does to light.
    weight : float
        Factor on all its coefficients; 0 switches it off, 2 doubles it.
    emission : float or SpectralTable
        Light that one unit of density gives off by itself [W m-3 sr-1 nm-1]; zero for air.

    Examples
    --------
    A layer of ozone, and its optical depth straight up from the ground: small in the blue, largest near 600 nm.

    >>> import skyscatter
    >>> ozone = skyscatter.Component(
    ...     name="ozone",
    ...     density={"kind": "gaussian", "peak": "22 km", "width": "5 km", "top": "60 km"},
    ...     optics={"kind": "gas-absorption", "species": "o3", "column_du": 300},
    ... )
    >>> scene = skyscatter.Scene(medium=skyscatter.Medium(components=(ozone,), planet_radius="6371 km"))
    >>> skyscatter.optical_depth(scene, [0, 0, 6371e3], [0, 0, 6431e3], [450, 600]).round(3)
    array([0.002, 0.041])
    """

    name: str
    density: AnyDensity
    optics: AnyOptics
    weight: NonNegative = default(1.0)
    emission: Emission = default(0.0)


class Medium(Record):
    """Components in spherical shells around a planet, or in three dimensions.

    Parameters
    ----------
    components : tuple of Component
    planet_radius : length, optional
        Radius at which altitudes are 0 [m]; left out where the densities are fields in three dimensions.

    Examples
    --------
    >>> import skyscatter
    >>> air = skyscatter.Component(name="air", density={"kind": "us-standard-1976"}, optics={"kind": "rayleigh-air"})
    >>> haze = skyscatter.Component(
    ...     name="haze",
    ...     density={"kind": "exponential", "scale_height": "1.2 km", "top": "20 km"},
    ...     optics={"kind": "particles", "optical_depth": 0.2, "phase": {"kind": "henyey-greenstein", "g": 0.7}},
    ... )
    >>> medium = skyscatter.Medium(components=(air, haze), planet_radius="6371 km")
    >>> medium.top / 1e3, medium.without("air").top / 1e3  # km
    (120.0, 20.0)
    """

    components: tuple[Component, ...]
    planet_radius: OptionalNumber[PositiveMetres] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Medium:
        if not self.components:
            raise DomainError("components", 0, "a medium needs at least one component")
        for component in self.components:
            if isinstance(component.density, DensityField) != (self.planet_radius is not None):
                rule = "shells need a planet_radius, fields in three dimensions none; a medium has one sort of them"
                raise DomainError("density", component.density.kind, rule)
        names = [component.name for component in self.components]
        for name in names:
            if names.count(name) > 1:
                raise DomainError("components", name, "two components of one name; rename one")
        return self

    @property
    def radius(self) -> float:
        """The planet's radius [m]; refused where there is no planet."""
        if self.planet_radius is None:
            raise DomainError("planet_radius", None, "a medium in space has no planet; this is for atmospheres")
        return self.planet_radius

    @property
    def shells(self) -> tuple[DensityField, ...]:
        """Density fields of an atmosphere; empty in space."""
        return tuple(c.density for c in self.components if isinstance(c.density, DensityField))

    @property
    def fields(self) -> tuple[SpatialField, ...]:
        """Density fields in three dimensions; empty for an atmosphere."""
        return tuple(c.density for c in self.components if isinstance(c.density, SpatialField))

    @property
    def top(self) -> float:
        """Altitude of the top of the highest component [m]."""
        return max(field.top_altitude for field in self.shells)

    def component(self, name: str) -> Component:
        """The component of that name."""
        for component in self.components:
            if component.name == name:
                return component
        raise DomainError("component", name, f"choose from {', '.join(c.name for c in self.components)}")

    def without(self, name: str) -> Medium:
        """The same medium without the component of that name."""
        gone = self.component(name)
        return self.model_copy(update={"components": tuple(c for c in self.components if c is not gone)})
