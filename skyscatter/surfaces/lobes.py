"""Lobes: how the light of a lamp is spread over directions.

A lobe is a radiant intensity per unit of power [sr-1] over the cosine of the angle from the lamp's axis.  Whatever its
formula, it is used as a table that is linear between nodes and zero outside of them, and normalised as such: 2 pi
times the integral of the table is 1 to rounding, so that no power is lost or made.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from skyscatter import units
from skyscatter.errors import DomainError
from skyscatter.record import Record
from skyscatter.tablefile import TableRecord, Wanted
from skyscatter.units import Angles, Degrees, Intensities, Share, default

Array = NDArray[np.float64]

#: Nodes of lobes that are curves: linear between them to 1e-4 of the peak.
NODES = 257


class LobeTable(NamedTuple):
    """A lobe as the kernels see it."""

    cosine: Array  #: (node,) rising
    value: Array  #: (node,) [sr-1]
    cdf: Array  #: (node,) 0 ... 1, share of the power below a cosine


def lobe_table(cosine: ArrayLike, value: ArrayLike) -> LobeTable:
    """A table normalised to 1 over the sphere, from values in any unit at rising cosines."""
    mu, v = np.asarray(cosine, float), np.asarray(value, float)
    cells = np.pi * (v[1:] + v[:-1]) * np.diff(mu)
    total = float(cells.sum())
    cdf = np.concatenate([[0.0], np.cumsum(cells)]) / total
    cdf[-1] = 1.0
    return LobeTable(np.ascontiguousarray(mu), v / total, cdf)


class Lobe(Record):
    """Radiant intensity over the angle from a lamp's axis."""

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        raise NotImplementedError

    def value(self, cosine: ArrayLike) -> Array:
        """Intensity per unit of power [sr-1] at cosines of the angle from the axis; shape of the input."""
        nodes, values, _ = self.table()
        return np.interp(np.asarray(cosine, float), nodes, values, left=0.0, right=0.0)


class IsotropicLobe(Lobe):
    """The same in all directions.

    Examples
    --------
    >>> from skyscatter import surfaces
    >>> round(float(surfaces.IsotropicLobe().value(1.0)), 4)  # sr-1, 1 / (4 pi)
    0.0796
    """

    kind: Literal["isotropic"] = "isotropic"

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        return lobe_table([-1.0, 1.0], [1.0, 1.0])


class LambertLobe(Lobe):
    """As the cosine of the angle: what a surface of equal radiance from all sides sends out.

    Examples
    --------
    On the axis, 60 degrees from it, and backwards:

    >>> from skyscatter import surfaces
    >>> surfaces.LambertLobe().value([1.0, 0.5, -0.5]).round(4).tolist()  # sr-1, 1 / pi on the axis
    [0.3183, 0.1592, 0.0]
    """

    kind: Literal["lambert"] = "lambert"

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        return lobe_table([0.0, 1.0], [0.0, 1.0])


class CosinePowerLobe(Lobe):
    """cos^m of the angle, m = -ln 2 / ln cos(half angle): the plain model of an LED's lobe.

    Moreno & Sun (2008), Optics Express 16, 1808, eq. 1.

    Parameters
    ----------
    half_angle_deg : float
        Angle from the axis at which the intensity is half of that on the axis [degree]; 60 is Lambert's lobe.

    Examples
    --------
    The intensity 0, 20 and 40 degrees from the axis, relative to that on the axis:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> lobe = surfaces.CosinePowerLobe(half_angle_deg=20)
    >>> (lobe.value(np.cos(np.radians([0, 20, 40]))) / lobe.value(1.0)).round(2).tolist()
    [1.0, 0.5, 0.05]
    """

    kind: Literal["cosine-power"] = "cosine-power"
    half_angle_deg: Degrees = default(60.0)

    @model_validator(mode="after")
    def _check(self) -> CosinePowerLobe:
        if not 0.05 <= self.half_angle_deg < 90:
            raise DomainError("half_angle_deg", self.half_angle_deg, "from 0.05 to below 90 degrees")
        return self

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        half = np.radians(self.half_angle_deg)
        power = -np.log(2.0) / np.log(np.cos(half))
        # Nodes as dense as the lobe is narrow near the axis, and ever wider apart away from it.
        angle = half * np.sinh(np.linspace(np.arcsinh(0.5 * np.pi / half), 0.0, NODES))
        cosine = np.cos(angle)
        cosine[0], cosine[-1] = 0.0, 1.0
        return lobe_table(cosine, cosine**power)


class ConeLobe(Lobe):
    """The same within a cone, falling to zero over a soft edge around it, linearly in the cosine: a spot.

    Parameters
    ----------
    half_angle_deg : float
        From the axis to the middle of the edge [degree].
    edge_deg : float
        Width of the edge [degree]; 0 makes it sharp.

    Examples
    --------
    Within a sharp cone the intensity is one over its solid angle, 2 pi (1 - cos 20 degrees):

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> lobe = surfaces.ConeLobe(half_angle_deg=20)
    >>> lobe.value(np.cos(np.radians([0, 19, 21]))).round(2).tolist()  # sr-1
    [2.64, 2.64, 0.0]
    """

    kind: Literal["cone"] = "cone"
    half_angle_deg: Degrees = default(20.0)
    edge_deg: Degrees = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> ConeLobe:
        if not 0 < self.half_angle_deg <= 180:
            raise DomainError("half_angle_deg", self.half_angle_deg, "above 0 and up to 180 degrees")
        widest = 2 * min(self.half_angle_deg, 180 - self.half_angle_deg)
        if not 0 <= self.edge_deg <= widest:
            rule = f"0 or above, and at most {widest:g} degrees around a half angle of {self.half_angle_deg:g}"
            raise DomainError("edge_deg", self.edge_deg, rule)
        return self

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        outer, inner = np.cos(np.radians(self.half_angle_deg + 0.5 * self.edge_deg * np.array([1.0, -1.0])))
        if not inner > outer:
            return lobe_table([outer, 1.0], [1.0, 1.0])
        if not inner < 1.0:
            return lobe_table([outer, 1.0], [0.0, 1.0])
        return lobe_table([outer, inner, 1.0], [0.0, 1.0, 1.0])


class TabulatedLobe(TableRecord, Lobe):
    """A measured lobe, linear in the cosine between its angles and zero outside of them.

    Parameters
    ----------
    angles_deg : tuple of float
        Angles from the axis, rising, 0 to 180 [degree].
    intensities : tuple of float
        In any unit, never negative.
    file : str, optional
        CSV or netCDF file with the columns instead, such as ``angle [deg],intensity``; in a model file the path counts
        from its folder.
    column : str, optional
        Which column of the file has the intensities, where there are several.

    Examples
    --------
    Three measured angles, in any unit; the lobe is normalised to a power of 1:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> lobe = surfaces.TabulatedLobe(angles_deg=(0, 30, 60), intensities=(100, 80, 0))
    >>> lobe.value(np.cos(np.radians([0, 30, 60]))).round(2).tolist()  # sr-1
    [0.6, 0.48, 0.0]
    """

    columns: ClassVar[dict[str, Wanted]] = {
        "angles_deg": Wanted(("angle", "angles", "theta"), units.ANGLE.within(0.0, 180.0), rising=True),
        "intensities": Wanted(("intensity",), units.RELATIVE_AMOUNT),
    }

    kind: Literal["tabulated"] = "tabulated"
    angles_deg: Angles
    intensities: Intensities

    @model_validator(mode="after")
    def _check(self) -> TabulatedLobe:
        if len(self.angles_deg) != len(self.intensities) or len(self.angles_deg) < 2:
            raise DomainError("angles_deg", len(self.angles_deg), "at least 2 angles, as many as intensities")
        if np.any(np.diff(self.angles_deg) <= 0) or self.angles_deg[0] < 0 or self.angles_deg[-1] > 180:
            raise DomainError("angles_deg", self.angles_deg, "must rise from 0 or above to at most 180 degrees")
        if min(self.intensities) < 0 or max(self.intensities) <= 0:
            raise DomainError("intensities", min(self.intensities), "never negative, nor zero everywhere")
        return self

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        cosine = np.cos(np.radians(self.angles_deg))
        # A right angle is one: what shines up to the horizon does not shine a hair below it.
        cosine[np.asarray(self.angles_deg) == 90.0] = 0.0
        return lobe_table(cosine[::-1], np.asarray(self.intensities)[::-1])


class CityLobe(Lobe):
    """Light that a city sends upwards: 2 G (1 - F) cos z + 0.554 F z^4 over the zenith angle z [rad].

    Garstang (1986), PASP 98, 364, eq. 1: of the light of its lamps the share F goes upwards at low elevations, the rest
    falls on a ground of albedo G.  Together G (1 - F) + F of all light leaves the city upwards, see `escaping`; a
    lamp's power is that part alone.

    Parameters
    ----------
    ground_albedo : float
        G; Garstang took 0.15.
    direct_share : float
        F; Garstang took 0.15.

    Examples
    --------
    The share of its light that a city sends upwards, and how that is spread over zenith angles of 0, 60 and 85 degrees:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> city = surfaces.CityLobe(ground_albedo=0.15, direct_share=0.15)
    >>> f"{city.escaping:.0%}"
    '28%'
    >>> city.value(np.cos(np.radians([0, 60, 85]))).round(2).tolist()  # sr-1
    [0.15, 0.13, 0.24]
    """

    kind: Literal["city"] = "city"
    ground_albedo: Share = default(0.15)
    direct_share: Share = default(0.15)

    @model_validator(mode="after")
    def _check(self) -> CityLobe:
        if not self.escaping > 0:
            raise DomainError("ground_albedo", self.ground_albedo, "no light leaves this city upwards")
        return self

    @property
    def escaping(self) -> float:
        """Share of the lamps' light that leaves the city upwards."""
        return self.ground_albedo * (1 - self.direct_share) + self.direct_share

    def table(self) -> LobeTable:
        """The lobe, normalised to a power of 1."""
        z = np.linspace(0.5 * np.pi, 0.0, NODES)
        cosine = np.cos(z)
        cosine[0] = 0.0
        return lobe_table(
            cosine, 2 * self.ground_albedo * (1 - self.direct_share) * cosine + 0.554 * self.direct_share * z**4
        )


AnyLobe = Annotated[
    IsotropicLobe | LambertLobe | CosinePowerLobe | ConeLobe | TabulatedLobe | CityLobe,
    Field(discriminator="kind"),
]
