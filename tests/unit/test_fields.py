"""Density fields: each against its definition and against quadrature (see `bases.DensityFieldBase`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bases import FIELD_TESTS, DensityFieldBase, complaint, members

from skyscatter.datafiles import read_table
from skyscatter.media.fields import (
    AnyField,
    ChapmanLayer,
    Exponential,
    Gaussian,
    Tabulated,
    Tent,
    Uniform,
    UsStandard1976,
)


class TestExponential(DensityFieldBase):
    field_class = Exponential
    table_error = 5e-4  # grazing rays within a cell of the top of the shell that ends at 2 scale heights
    examples = (
        Exponential(scale_height=8e3),
        Exponential(scale_height="1.2 km"),
        Exponential(scale_height=5e3, top=9e3),
    )
    refused = (
        ({"scale_height": -1.0}, "scale_height = -1.0"),
        ({"scale_height": 0.0}, "scale_height = 0.0"),
        ({"scale_height": 1e3, "top": -2.0}, "top = -2.0"),
        ({"scale_height": "8 s"}, "scale_height"),
        ({}, "scale_height is missing"),
    )

    def expected(self, field: Any, h: float) -> float:
        return math.exp(-h / field.scale_height)

    def test_top_is_sixteen_scale_heights(self) -> None:
        assert Exponential(scale_height=8e3).top_altitude == 128e3


class TestUniform(DensityFieldBase):
    field_class = Uniform
    # Grazing rays just under the upper edge: their column goes as the root of the distance to it.
    table_error = 2.5e-3
    examples = (Uniform(top=2e3), Uniform(base="5 km", top="9 km"))
    refused = (
        ({"top": 0.0}, "top = 0.0"),
        ({"base": 5.0, "top": 4.0}, "base = 5.0"),
        ({"base": -1.0, "top": 4.0}, "-1.0"),
    )

    def expected(self, field: Any, h: float) -> float:
        return 1.0 if field.base <= h < field.top else 0.0


class TestTent(DensityFieldBase):
    field_class = Tent
    table_error = 2e-4  # the same, one order smoother
    examples = (Tent(base=10e3, peak=25e3, top=40e3), Tent(base=0, peak=2e3, top=30e3))
    refused = (
        ({"base": 10.0, "peak": 5.0, "top": 40.0}, "peak = 5.0"),
        ({"base": 10.0, "peak": 50.0, "top": 40.0}, "peak = 50.0"),
        ({"base": -1.0, "peak": 5.0, "top": 40.0}, "base = -1.0: is never negative"),
    )

    def expected(self, field: Any, h: float) -> float:
        return float(np.interp(h, [field.base, field.peak, field.top], [0.0, 1.0, 0.0]))


class TestGaussian(DensityFieldBase):
    field_class = Gaussian
    table_error = 2e-4  # linear in altitude over cells of a tenth of the width
    examples = (Gaussian(peak=22e3, width=5e3, top=60e3), Gaussian(peak=3e3, width=2e3), Gaussian(peak=0.0, width=9e3))
    refused = (({"peak": 1e3, "width": 0.0}, "width = 0.0"), ({"peak": 1e3, "width": 1e3, "top": 0.0}, "top = 0.0"))

    def expected(self, field: Any, h: float) -> float:
        return math.exp(-((h - field.peak) ** 2) / (2 * field.width**2))


class TestChapmanLayer(DensityFieldBase):
    field_class = ChapmanLayer
    examples = (ChapmanLayer(peak=25e3, scale_height=5e3), ChapmanLayer(peak=110e3, scale_height=8e3, top=200e3))
    refused = (({"peak": 1e3, "scale_height": -5.0}, "scale_height = -5.0"),)
    # The density falls as exp(-exp) below the peak, and the grid of altitudes is coarse high above the ground.
    table_error = 2e-3
    density_error = 1e-4

    def expected(self, field: Any, h: float) -> float:
        z = (h - field.peak) / field.scale_height
        return math.exp(1 - z - math.exp(-z))

    def cuts(self, field: Any) -> np.ndarray:
        return np.arange(0.0, field.top_altitude, field.scale_height / 2)


class TestTabulated(DensityFieldBase):
    field_class = Tabulated
    density_error = 4e-5  # the cell next to a node may hold its kink
    table_error = 1e-3  # as `Uniform`, with a density that ends at a quarter of its maximum
    examples = (
        Tabulated(altitudes=(0, 2e3, 10e3, 40e3), densities=(1.0, 0.8, 0.3, 0.001)),
        Tabulated(altitudes=(5e3, 8e3, 20e3), densities=(0.0, 2.0, 0.5), interpolation="linear"),
    )
    refused = (
        ({"altitudes": (0, 1), "densities": (1.0,)}, "altitudes = 2"),
        ({"altitudes": (0, 1), "densities": (1.0, -0.5)}, "densities.1 = -0.5: is never negative"),
        ({"altitudes": (0, 1), "densities": (1.0, 0.0)}, 'interpolation = "linear"'),
        ({"altitudes": (1, 1), "densities": (1.0, 1.0)}, "must start at or above 0 and increase"),
        ({"altitudes": (0, 1), "densities": (0.0, 0.0), "interpolation": "linear"}, "zero everywhere"),
    )

    def expected(self, field: Any, h: float) -> float:
        altitudes, densities = np.array(field.altitudes), np.array(field.densities)
        if h < altitudes[0]:
            return 0.0
        if field.interpolation == "linear":
            return float(np.interp(h, altitudes, densities))
        return math.exp(np.interp(h, altitudes, np.log(densities)))

    def test_agrees_with_the_exponential_it_tabulates(self) -> None:
        h = np.linspace(0, 40e3, 9)
        table = Tabulated(altitudes=tuple(h), densities=tuple(np.exp(-h / 8e3)))
        shell = Exponential(scale_height=8e3, top=40e3)
        at = np.linspace(0, 39e3, 50)
        np.testing.assert_allclose(table.density(at), shell.density(at), rtol=1e-12)  # rounding
        np.testing.assert_allclose(table.vertical_column(at), shell.vertical_column(at), rtol=1e-11)


class TestUsStandard1976(DensityFieldBase):
    field_class = UsStandard1976
    density_error = 1e-4  # some of its kinks between 500 m nodes fall inside cells
    examples = (UsStandard1976(),)
    refused = ()

    def expected(self, field: Any, h: float) -> float:
        table = read_table("ussa1976.csv")
        number = table["number_density"]
        return math.exp(np.interp(h, table["altitude"], np.log(number / number[0])))

    def test_is_one_on_the_ground(self) -> None:
        assert UsStandard1976().density(0.0) == 1.0


def test_every_field_has_a_test_class() -> None:
    assert set(FIELD_TESTS) == members(AnyField)


def test_kind_tells_fields_apart() -> None:
    kinds = [field.model_fields["kind"].default for field in members(AnyField)]
    assert len(set(kinds)) == len(kinds)


def test_unknown_kind_is_refused_with_the_known_ones() -> None:
    from pydantic import TypeAdapter

    message = complaint(lambda: TypeAdapter(AnyField).validate_python({"kind": "foam", "top": 3}))
    assert "foam" in message
    assert "exponential" in message
