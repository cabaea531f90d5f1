"""Towns on the ground of a planet: disks of lamps that shine upwards."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.surfaces.lobes import AnyLobe, CityLobe, Lobe
from skyscatter.surfaces.power import Powered
from skyscatter.units import Elevation, NonNegativeMetres, OptionalNumber, PositiveMetres, Turn, default

#: Luminous flux of a town's lamps for each of its inhabitants [lm]: Garstang (1986), PASP 98, 364, section III.
LUMENS_A_HEAD = 1000.0


def check_lobe(lobe: Lobe) -> None:
    """Refuse a lobe that shines into the ground."""
    if lobe.table().cosine[0] < 0:
        rule = "shines below the horizon, into the ground; take city, lambert, or a table that ends at 90 degrees"
        raise DomainError("lobe", getattr(lobe, "kind", "own"), rule)


class Town(Powered):
    """A town: a disk on the ground, evenly filled with lamps that shine upwards alike.

    Give its place by latitude and longitude, for scenes of a place on Earth, or by its distance and azimuth from the
    observer; and one of power, watts or lumens.

    Parameters
    ----------
    name : str
        How lists and errors call it.
    latitude_deg, longitude_deg : float, optional
        Of its middle, north and east positive [degree].
    distance : length, optional
        Of its middle from the observer, along the ground [m].
    azimuth_deg : float, optional
        Of its middle from the observer, from north through east [degree].
    radius : length
        Of the disk [m]; 0 makes it a point.
    lobe : lobe
        How its light is spread over zenith angles, by kind; Garstang's city when not given.  Houses and trees are left
        out but for what the lobe says of them.

    Other Parameters
    ----------------
    power, watts, lumens, spectrum
        One of power [W nm-1], watts or lumens that leave the town upwards; the last two with a `spectrum`.

    Examples
    --------
    A town of 100000 people, 20 km to the north: of the 1000 lm a head 28 % go upwards.

    >>> from skyscatter.surfaces import Town
    >>> town = Town.of_people(100_000, distance="20 km", azimuth_deg=0, radius="3 km", spectrum="high-pressure-sodium")
    >>> round(town.lumens / 1e6, 1)  # million lm
    27.7
    """

    kind: Literal["town"] = "town"
    name: str = "town"
    latitude_deg: OptionalNumber[Elevation] = default(None)
    longitude_deg: OptionalNumber[Turn] = default(None)
    distance: OptionalNumber[PositiveMetres] = default(None)
    azimuth_deg: OptionalNumber[Turn] = default(None)
    radius: NonNegativeMetres = default(1000.0)
    lobe: AnyLobe = CityLobe()

    @classmethod
    def of_people(cls, people: float, *, lobe: CityLobe | None = None, **fields: object) -> Self:
        """A town by its inhabitants: 1000 lm each, of which the share `CityLobe.escaping` goes upwards.

        Parameters
        ----------
        people : float
        lobe : CityLobe, optional
        **fields
            The others.

        Examples
        --------
        >>> from skyscatter.surfaces import Town
        >>> town = Town.of_people(1e6, latitude_deg=48.14, longitude_deg=11.58, spectrum="led-4000k")
        >>> round(town.lumens / 1e6, 1)  # million lm
        277.5
        """
        lobe = lobe or CityLobe()
        lumens = LUMENS_A_HEAD * people * lobe.escaping
        return cls.model_validate({"lumens": lumens, "lobe": lobe, **fields})

    @model_validator(mode="after")
    def _check(self) -> Self:
        place = self.latitude_deg, self.longitude_deg, self.distance, self.azimuth_deg
        given = [value is not None for value in place]
        if given not in ([True, True, False, False], [False, False, True, True]):
            rule = "give either latitude_deg and longitude_deg, or distance and azimuth_deg"
            raise DomainError(f"{self.name}, its place", "unclear" if any(given) else None, rule)
        check_lobe(self.lobe)
        return self

    @property
    def on_earth(self) -> bool:
        """Whether its place is given by latitude and longitude."""
        return self.latitude_deg is not None
