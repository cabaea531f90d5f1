"""Lamps: points with a lobe, surfaces that shine, parallel light, and light from all around."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import Directed
from skyscatter.record import Record
from skyscatter.spectra.solar import disk_mean, limb_darkening
from skyscatter.spectra.table import Irradiance, OptionalSpectral, Radiance, evaluate
from skyscatter.surfaces.lobes import AnyLobe, ConeLobe, CosinePowerLobe, IsotropicLobe, LambertLobe, Lobe
from skyscatter.surfaces.power import Powered, Shining
from skyscatter.units import (
    AngularRadius,
    Candela,
    Degrees,
    Elevation,
    Lux,
    OptionalNumber,
    OptionalTriple,
    Place,
    Triple,
    WattsPerArea,
    WattsPerAreaAndAngle,
    default,
)

Array = NDArray[np.float64]


class _PointSource(Powered):
    """A lamp without extent.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    position : three lengths
        [m]
    target : three lengths, optional
        Point [m] towards which its axis points; give this or `axis`.
    axis : three floats, optional
        Direction of its axis, of any length.  Up (0, 0, 1) when neither is given.
    """

    name: str = "lamp"
    position: Place
    target: OptionalTriple[Place] = default(None)
    axis: OptionalTriple[Triple] = default(None)

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if self.target is not None and self.axis is not None:
            raise DomainError("axis", self.axis, "give axis or target, not both")
        if self.axis is not None and not any(self.axis):
            raise DomainError("axis", self.axis, "must point somewhere: one of its numbers is not 0")
        if self.target is not None and self.target == self.position:
            raise DomainError("target", self.target, "is where the lamp is; name another point")
        return self

    @property
    def direction(self) -> Array:
        """Unit vector (3,) of the middle of the lobe."""
        vector = np.array(self.axis or (0.0, 0.0, 1.0), float)
        if self.target is not None:
            vector = np.array(self.target) - np.array(self.position)
        return vector / np.linalg.norm(vector)

    @property
    def distribution(self) -> Lobe:
        """How its light is spread over directions."""
        raise NotImplementedError


class PointLamp(_PointSource):
    """A point that shines, equally into all directions if no `lobe` is given.

    Parameters
    ----------
    lobe : lobe
        How its light is spread over directions, by kind.

    Other Parameters
    ----------------
    name, position, target, axis
        How lists and errors call it; its place [m]; the point [m] or the direction towards which its axis points, up
        (0, 0, 1) when neither is given.
    power, watts, lumens, spectrum
        One of power [W nm-1], watts or lumens, into all directions together; the last two with a `spectrum`.

    Examples
    --------
    A bulb of 800 lm: the illuminance on a surface that faces it 2 m away, and its power in watts of light.

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> bulb = surfaces.PointLamp(position=(0, 0, "2 m"), lumens=800, spectrum="led-4000k")
    >>> round(bulb.lumens * float(bulb.distribution.value(1.0)) / 2**2, 1)  # lx
    15.9
    >>> wavelengths = np.arange(380, 781, 5)
    >>> round(float(np.trapezoid(bulb.spectral_amount(wavelengths), wavelengths)), 1)  # W
    2.5
    """

    kind: Literal["point"] = "point"
    lobe: AnyLobe = IsotropicLobe()

    @property
    def distribution(self) -> Lobe:
        """How its light is spread over directions."""
        return self.lobe


class SpotLamp(_PointSource):
    """A point that shines into a cone, see `ConeLobe`: a spot, a searchlight.

    Parameters
    ----------
    half_angle_deg : float
        From the axis to the middle of the cone's edge [degree], above 0 and up to 180.
    edge_deg : float
        Width of the soft edge [degree]; 0 makes it sharp.

    Other Parameters
    ----------------
    name, position, target, axis
        How lists and errors call it; its place [m]; the point [m] or the direction towards which its axis points, up
        (0, 0, 1) when neither is given.
    power, watts, lumens, spectrum
        One of power [W nm-1], watts or lumens, into all directions together; the last two with a `spectrum`.

    Examples
    --------
    A lamp at the ceiling that shines down into a cone of 20 degrees across, and its intensity within that:

    >>> from skyscatter import surfaces
    >>> spot = surfaces.SpotLamp(
    ...     position=(0, 0, "3 m"), target=(0, 0, 0), half_angle_deg=10, lumens=500, spectrum="led-2700k"
    ... )
    >>> spot.direction.tolist()
    [0.0, 0.0, -1.0]
    >>> round(spot.lumens * float(spot.distribution.value(1.0)))  # cd
    5238
    """

    kind: Literal["spot"] = "spot"
    half_angle_deg: Degrees = default(20.0)
    edge_deg: Degrees = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _ = self.distribution
        return self

    @property
    def distribution(self) -> Lobe:
        """How its light is spread over directions."""
        return ConeLobe(half_angle_deg=self.half_angle_deg, edge_deg=self.edge_deg)


class Led(_PointSource):
    """A light-emitting diode as a point with a lobe by its half angle, see `CosinePowerLobe`.

    Parameters
    ----------
    half_angle_deg : float
        Angle from the axis at which the intensity is half of that on the axis [degree], 0.05 to below 90.

    Other Parameters
    ----------------
    name, position, target, axis
        How lists and errors call it; its place [m]; the point [m] or the direction towards which its axis points, up
        (0, 0, 1) when neither is given.
    power, watts, lumens, spectrum
        One of power [W nm-1], watts or lumens, into all directions together; the last two with a `spectrum`.

    Examples
    --------
    The intensity on the axis, and 30 degrees from it where it is half of that:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> led = surfaces.Led(position=(0, 0, 0), half_angle_deg=30, lumens=100, spectrum="led-4000k")
    >>> (led.lumens * led.distribution.value(np.cos(np.radians([0, 30])))).round(1).tolist()  # cd
    [92.6, 46.3]
    """

    kind: Literal["led"] = "led"
    half_angle_deg: Degrees = default(60.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _ = self.distribution
        return self

    @property
    def distribution(self) -> Lobe:
        """How its light is spread over directions."""
        return CosinePowerLobe(half_angle_deg=self.half_angle_deg)


class AreaLamp(Powered):
    """What makes a body shine: its power, evenly spread over its surface, outwards.

    Parameters
    ----------
    radiance : float or SpectralTable, optional
        Instead of the power: the radiance along the normal [W m-2 sr-1 nm-1].
    lobe : lobe
        About the normal; Lambert's (the same radiance from all sides) when not given.

    Other Parameters
    ----------------
    power, watts, lumens, spectrum
        One of power [W nm-1], watts or lumens, of the whole surface; the last two with a `spectrum`.

    Examples
    --------
    A panel of 2 m2 whose radiance is 1 W m-2 sr-1 nm-1 from all sides sends out pi times its area:

    >>> from skyscatter import surfaces
    >>> panel = surfaces.AreaLamp(radiance=1.0)
    >>> panel.spectral_power([450, 550], area=2.0).round(3).tolist()  # W nm-1
    [6.283, 6.283]
    """

    radiance: OptionalSpectral[Radiance] = default(None)
    lobe: AnyLobe = LambertLobe()

    @classmethod
    def amounts(cls) -> tuple[str, ...]:
        """The fields of which exactly one is given."""
        return *super().amounts(), "radiance"

    @model_validator(mode="after")
    def _check(self) -> Self:
        cosine, value, _ = self.lobe.table()
        if cosine[0] < 0:
            raise DomainError("lobe", self.lobe.kind, "shines into the body; a surface's ends at 90 degrees")
        if cosine[0] == 0 and value[0] > 0:
            rule = "still shines along the surface, where its radiance would have no bounds; use a point lamp"
            raise DomainError("lobe", self.lobe.kind, rule)
        return self

    def spectral_power(self, wavelengths_nm: ArrayLike, area: float) -> Array:
        """Power [W nm-1] of a surface of so many square metres; shape (wavelength,)."""
        if self.radiance is None:
            return self.spectral_amount(wavelengths_nm)
        return evaluate(self.radiance, wavelengths_nm) * area / float(self.lobe.value(1.0))


class ParallelLamp(Directed, Shining):
    """Light from one direction, as of the Sun.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    direction : three floats, optional
        Towards the light, of any length.
    azimuth_deg, elevation_deg : float, optional
        The same as angles [degree]: azimuth in the x-y plane from +y towards +x, elevation above it towards +z.
    irradiance : float or SpectralTable, optional
        On a surface that faces the light [W m-2 nm-1].
    angular_radius_deg : float
        Of the disk from which the light comes, up to 5 [degree]; 0, one direction, when not given.  The Sun's is 0.267.
    limb_darkening : bool
        Darken the disk as the Sun's (Neckel & Labs 1994); a uniform disk otherwise.
    watts_per_m2, lux : float, optional
        The same in all, with a `spectrum`, such as "sun".

    Other Parameters
    ----------------
    spectrum : SpectralTable or str
        Shape of the spectrum that goes with `watts_per_m2` or `lux`: a table in any unit per nm, or a name.

    Examples
    --------
    The Sun 30 degrees above the horizon, towards +x:

    >>> from skyscatter import surfaces
    >>> sun = surfaces.ParallelLamp(azimuth_deg=90, elevation_deg=30, watts_per_m2=1361, spectrum="sun")
    >>> sun.towards.round(3).tolist()
    [0.866, 0.0, 0.5]
    >>> sun.spectral_amount([450, 550, 650]).round(1).tolist()  # W m-2 nm-1
    [1.9, 1.9, 1.6]
    """

    _spectral: ClassVar[str] = "irradiance"
    _radiant: ClassVar[str] = "watts_per_m2"
    _luminous: ClassVar[str] = "lux"

    kind: Literal["parallel"] = "parallel"
    name: str = "light"
    direction: OptionalTriple[Triple] = default(None)
    azimuth_deg: OptionalNumber[Degrees] = default(None)
    elevation_deg: OptionalNumber[Elevation] = default(None)
    angular_radius_deg: AngularRadius = default(0.0)
    limb_darkening: bool = False
    irradiance: OptionalSpectral[Irradiance] = default(None)
    watts_per_m2: OptionalNumber[WattsPerArea] = default(None)
    lux: OptionalNumber[Lux] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.check_direction()
        if self.limb_darkening and self.angular_radius_deg == 0:
            raise DomainError("limb_darkening", True, "is for a disk; give its angular_radius_deg as well")
        return self

    def limb(self, mu: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Radiance of its disk relative to the mean, over the cosine `mu` at the surface of a star; (mu, wl)."""
        if not self.limb_darkening:
            return np.ones((np.size(mu), np.size(wavelengths_nm)))
        return limb_darkening(mu, wavelengths_nm) / disk_mean(wavelengths_nm)


class Surroundings(Shining):
    """Uniform radiance from outside of everything.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    radiance : float or SpectralTable, optional
        [W m-2 sr-1 nm-1]
    watts_per_m2_sr, candela_per_m2 : float, optional
        The same in all, with a `spectrum`.

    Other Parameters
    ----------------
    spectrum : SpectralTable or str
        Shape of the spectrum that goes with `watts_per_m2_sr` or `candela_per_m2`: a table in any unit per nm, or a
        name.

    Examples
    --------
    A white sky of 3000 cd m-2:

    >>> from skyscatter import surfaces
    >>> sky = surfaces.Surroundings(candela_per_m2=3000, spectrum="sun")
    >>> sky.spectral_amount([450, 550, 650]).round(3).tolist()  # W m-2 sr-1 nm-1
    [0.042, 0.042, 0.036]
    """

    _spectral: ClassVar[str] = "radiance"
    _radiant: ClassVar[str] = "watts_per_m2_sr"
    _luminous: ClassVar[str] = "candela_per_m2"

    kind: Literal["surroundings"] = "surroundings"
    name: str = "surroundings"
    radiance: OptionalSpectral[Radiance] = default(None)
    watts_per_m2_sr: OptionalNumber[WattsPerAreaAndAngle] = default(None)
    candela_per_m2: OptionalNumber[Candela] = default(None)


class Environment(Record):
    """Light from all around by a picture of the whole sphere, as a dome of the sky: ``skyscatter sky --no-sun``.

    Directions are those of the picture's camera, azimuths from +y towards +x; it is looked at as it is, and lights what
    is in the scene.  It has half a degree at best: leave the Sun out of a dome and add it as a `ParallelLamp`, whose
    numbers stand in the file beside the dome.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    file : str
        Panorama with spectra [W m-2 sr-1 nm-1] that `skyscatter.SpectralImage` reads; in a model file the path counts
        from its folder.  Its wavelengths hold those of the picture that is made.
    turn_deg : float
        By which azimuths of the picture are turned, from +y towards +x [degree].
    factor : float
        By which all radiances are multiplied.

    Examples
    --------
    >>> from skyscatter import surfaces
    >>> dome = surfaces.Environment(file="dome.exr", turn_deg=90)
    >>> dome.kind
    'environment'
    """

    kind: Literal["environment"] = "environment"
    name: str = "environment"
    file: str
    turn_deg: Degrees = default(0.0)
    factor: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 1.0


AnyLamp = Annotated[PointLamp | SpotLamp | Led | ParallelLamp | Surroundings | Environment, Field(discriminator="kind")]
