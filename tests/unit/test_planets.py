"""A planet's air as a field in three dimensions, and the field without end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bases import complaint
from space_bases import Array, SpatialFieldBase, own_frame

from skyscatter import Component, Medium, Scene, SpaceScene, fields, optical_depth
from skyscatter.media.fields import ChapmanLayer, Exponential, Gaussian, Tabulated, Tent, Uniform, UsStandard1976
from skyscatter.media.planets import AroundPlanet
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import Isotropic

EARTH = 6371e3
#: Small planets with thick air, so that points at random meet it.
TABLE = Tabulated(altitudes=(0.5, 1.0, 3.0), densities=(1.0, 2.0, 0.1))
LINEAR = Tabulated(altitudes=(0.0, 1.0, 3.0), densities=(0.0, 2.0, 1.0), interpolation="linear")


class TestAroundPlanet(SpatialFieldBase):
    field_class = AroundPlanet
    examples = (
        AroundPlanet(radius=5.0, profile=Exponential(scale_height=1.0, top=5.0)),
        AroundPlanet(radius=4.0, profile=Uniform(base=0.5, top=3.0), position=(1.0, -2.0, 0.5)),
        AroundPlanet(radius=4.0, profile=Gaussian(peak=1.5, width=0.5, top=4.0)),
        AroundPlanet(radius=4.0, profile=ChapmanLayer(peak=1.0, scale_height=0.4, top=3.0)),
        AroundPlanet(radius=4.0, profile=Tent(base=0.0, peak=1.0, top=3.0), position=(0.0, 0.0, -4.0)),
        AroundPlanet(radius=4.0, profile=TABLE),
        AroundPlanet(radius=4.0, profile=LINEAR),
    )
    refused = (
        ({"radius": 0.0, "profile": TABLE}, "radius = 0.0"),
        ({"radius": 1.0, "profile": {"kind": "sphere"}}, "profile"),
        ({"radius": 1.0}, "profile is missing"),
    )
    tolerance = 1e-6  # that of the quadrature

    def expected(self, field: Any, points: Array) -> Array:
        altitude = np.linalg.norm(own_frame(field, points), axis=-1) - field.radius
        return np.where(altitude >= 0, field.profile.density(np.maximum(altitude, 0.0)), 0.0)

    def test_reference_column_goes_through_the_centre(self) -> None:
        """It does not: optical depths are those of the air above the ground, as in an atmosphere."""
        for field in self.examples:
            assert field.reference_column() == field.profile.reference_column()
            low, _ = field.bounds
            x, y, z = field.position
            column = field.column([x, y, low[2]], [x, y, z])
            assert float(column) == pytest.approx(field.reference_column(), rel=1e-6)


@pytest.mark.parametrize("profile", [Exponential(scale_height="8 km"), UsStandard1976()])
def test_columns_through_the_air_of_the_earth(profile: Any) -> None:
    """The same optical depths as through the shells of an atmosphere, from the zenith to the horizon."""
    optics = Particles(optical_depth=1.0, phase=Isotropic())
    shells = Scene(
        medium=Medium(planet_radius=EARTH, components=(Component(name="air", density=profile, optics=optics),))
    )
    field = AroundPlanet(radius=EARTH, position=(0, 0, -EARTH), profile=profile)
    elevation = np.radians([0.0, 0.3, 2.0, 20.0, 90.0])
    ends = 2.2e6 * np.stack([np.cos(elevation), np.zeros(5), np.sin(elevation)], axis=-1)
    # A metre above the ground, so that rounding puts no line below it.
    start = np.array([0.0, 0.0, 1.0])
    columns = field.column(start, start + ends) / field.reference_column()
    origin = np.array([0.0, 0.0, EARTH])
    expected = optical_depth(shells, origin + start, origin + start + ends, [550.0])[:, 0]
    np.testing.assert_allclose(columns, expected, rtol=2e-6)  # the quadrature's 1e-6, and the table's


def test_the_field_without_end() -> None:
    field = fields.Everywhere()
    points = np.array([[0.0, 0, 0], [1e9, -3, 2]])
    assert field.density(points).tolist() == [1.0, 1.0]
    assert field.column([0, 0, 0], [3, 4, 0]) == 5.0
    assert np.isinf(field.bounds).all()
    component = Component(name="fog", density=field, optics=Particles(extinction=0.1, phase=Isotropic()))
    assert Component.model_validate(component.model_dump(exclude_none=True)) == component
    message = complaint(lambda: SpaceScene(medium=Medium(components=(component,))))
    assert "density = 'everywhere': has no end" in message
