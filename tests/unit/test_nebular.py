"""Gas inside ionisation fronts against closed forms, and fields kept as voxels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import erfc
from space_bases import Array, SpatialFieldBase

from skyscatter.media.ionised import alpha_b, ionising_photons, stromgren_radius
from skyscatter.media.nebular import IonisedGas, IonisingSource, Sampled
from skyscatter.media.operations import Sum
from skyscatter.media.shapes import GAUSSIAN_CUT, GaussianSphere, Shell, Sphere
from skyscatter.media.structures import Box, Slab
from skyscatter.units import PARSEC

Q, N = 1e49, 1e8
R = stromgren_radius(Q, N)
UNIFORM: dict[str, Any] = {"gas": Sphere(radius=3 * R), "hydrogen_density": N, "resolution_deg": 10, "tolerance": 1e-9}
STAR = {"ionising_photons": Q}


def soft(width: float, radius: float, distance: Array) -> Array:
    """The edge of a front, cut at 6.07 widths to either side."""
    x = (distance - radius) / width
    return np.where(x < -GAUSSIAN_CUT, 1.0, np.where(x > GAUSSIAN_CUT, 0.0, 0.5 * erfc(x / np.sqrt(2))))


class TestIonisedGas(SpatialFieldBase):
    field_class = IonisedGas
    tolerance = 1e-6
    bound_slack = 2e3
    examples = (
        IonisedGas(**UNIFORM, sources=[STAR], front_width=0.05 * R),
        IonisedGas(**UNIFORM, sources=[STAR, {**STAR, "position": (R, 0, 0)}], front_width=0.1 * R, power=1),
        IonisedGas(**UNIFORM, sources=[STAR], front_width=0.1 * R, inverse=True),
        IonisedGas(**UNIFORM, sources=[STAR], front_width=0.05 * R, layer=(0.3, 0.8)),
    )
    refused = (
        ({**UNIFORM, "sources": []}, "sources = 0"),
        ({**UNIFORM, "sources": [{}]}, "ionising_photons = None"),
        ({**UNIFORM, "sources": [{"temperature": 4e4}]}, "temperature and luminosity"),
        ({**UNIFORM, "sources": [{"ionising_photons": -1.0}]}, "ionising_photons = -1.0"),
        ({**UNIFORM, "sources": [STAR], "front_width": -1.0}, "front_width = -1.0"),
        ({**UNIFORM, "sources": [STAR], "hydrogen_density": 0.0}, "hydrogen_density = 0.0"),
        ({**UNIFORM, "sources": [STAR], "layer": (0.5, 0.5)}, "layer = (0.5, 0.5)"),
        ({**UNIFORM, "sources": [STAR], "layer": (0.5, 1.0), "inverse": True}, "goes with ionised gas"),
        ({**UNIFORM, "sources": [STAR], "resolution_deg": 0.0}, "resolution_deg = 0.0"),
        ({**UNIFORM, "sources": [STAR], "gas_temperature": 1.0}, "temperature = 1.0"),
    )

    def expected(self, field: Any, points: Array) -> Array:
        """In uniform gas all surfaces are spheres, of the cube root of the share of the photons."""
        dark = np.ones(len(points))
        for source in field.sources:
            r = np.linalg.norm(points - np.array(source.position), axis=1)
            inner, outer = (R * share ** (1 / 3) for share in field.layer)
            front = soft(field.front_width, outer, r)
            dark *= 1 - front * (1 - soft(field.front_width, inner, r) if inner > 0 else 1.0)
        gas = np.linalg.norm(points, axis=1) <= 3 * R
        return gas * (dark if field.inverse else 1 - dark)


def test_uniform_gas_gives_the_sphere_of_stromgren_and_all_recombinations() -> None:
    field = IonisedGas(gas=Sphere(radius=2 * R), hydrogen_density=N, sources=[STAR])
    (front,) = field.fronts()
    np.testing.assert_allclose(front.radii, R, rtol=1e-4 / 3)  # the tolerance is of the photons, of R^3
    # Columns across a bundle of parallel lines: their sum over the plane is the volume, by Gauss's rule in b^2.
    x, w = np.polynomial.legendre.leggauss(60)
    b = R * np.sqrt(0.5 * (1 + x))
    zero = np.zeros_like(b)
    columns = field.column(np.column_stack([b, zero, zero - 3 * R]), np.column_stack([b, zero, zero + 3 * R]))
    total = 0.5 * np.pi * R**2 * float(w @ columns)
    assert total * alpha_b(1e4) * N**2 == pytest.approx(Q, rel=2e-4)


def test_a_star_outside_a_slab_ionises_its_skin() -> None:
    """Towards the slab R^3 = d^3 + R_0^3 on the axis; slanted rays enter at d / cos and end on the same law."""
    slab = Slab(half_thickness=R, half_width=R)
    field = IonisedGas(gas=slab, hydrogen_density=N, sources=[{**STAR, "position": (0, 0, 2 * R)}], resolution_deg=1)
    (front,) = field.fronts()
    assert 0 < front.opening_deg < 90
    assert front.radii[0][0] == pytest.approx((1 + 1) ** (1 / 3) * R, rel=1e-4)
    theta = np.radians(30.0)
    direction = np.array([np.sin(theta), 0.0, -np.cos(theta)])
    edge = ((1 / np.cos(theta)) ** 3 + 1) ** (1 / 3) * R
    star = np.array([0, 0, 2 * R])
    found = field.density(star + np.multiply.outer([edge * 0.995, edge * 1.005], direction))
    np.testing.assert_array_equal(found, [1.0, 0.0])
    # Behind the star there is no gas, and nothing outside the cone.
    assert field.density(1.05 * star) == 0
    low = np.array([[-R, -R, -R]])
    lowest, highest = field.extremes(low, -low)
    assert (lowest[0], highest[0]) == (0.0, 1.0)


def test_bounds_hold_within_a_cone_of_directions() -> None:
    parts = (Box(half_sizes=(R, R, R)), GaussianSphere(width=0.3 * R, position=(0.5 * R, 0, 0)))
    gas = Sum(fields=parts, factors=(0.5, 2))
    source = {**STAR, "position": (R, -1.5 * R, 3 * R)}
    field = IonisedGas(gas=gas, hydrogen_density=N, sources=[source], front_width=0.05 * R, resolution_deg=3)
    random = np.random.default_rng(2)
    low = random.uniform(-3.5, 3, (400, 3)) * R
    side = random.uniform(0.01, 0.8, (400, 3)) * R
    lowest, highest = field.extremes(low, low + side)
    values = field.density(low[:, None] + side[:, None] * random.random((400, 20, 3)))
    assert (values.max(axis=1) > 0).sum() > 20
    assert (values >= lowest[:, None] * (1 - 1e-7)).all()
    assert (values <= highest[:, None] * (1 + 1e-7)).all()


def test_ionised_and_neutral_gas_are_all_the_gas() -> None:
    gas = GaussianSphere(width=0.7 * R)
    both = [
        IonisedGas(gas=gas, hydrogen_density=N, sources=[STAR], front_width=0.1 * R, power=1, inverse=inverse)
        for inverse in (False, True)
    ]
    points = np.random.default_rng(0).normal(size=(500, 3)) * R
    np.testing.assert_allclose(sum(field.density(points) for field in both), gas.density(points), rtol=1e-12)


def test_a_star_by_temperature_makes_the_photons_of_a_black_body() -> None:
    source = IonisingSource(temperature=39000, luminosity=204000)
    assert source.photons == ionising_photons(39000, luminosity_W=204000 * 3.828e26)
    # O6 V of Martins et al. (2005) has 10^48.96; a black body of this temperature and luminosity is within 0.1 dex.
    assert np.log10(source.photons) == pytest.approx(48.96, abs=0.1)


class TestSampled(SpatialFieldBase):
    field_class = Sampled
    tolerance = 1e-6  # float32 numbers, as of every grid
    examples = (
        Sampled(field=GaussianSphere(width="1 pc"), cells=40),
        Sampled(field=Shell(inner=1.0, outer=2.0), cells=30, low=(-2, -2, 0), high=(2, 2, 2), edge="sharp"),
    )
    refused = (
        ({"field": Sphere(radius=1.0), "cells": 1}, "cells = 1"),
        ({"field": Sphere(radius=1.0), "low": (0, 0, 0)}, "give both low and high"),
        ({"field": Sphere(radius=1.0), "low": (0, 0, 0), "high": (1, 1, 0)}, "must lie above low"),
    )

    def test_extremes_close_in_on_the_value(self) -> None:
        """They stop at what a cell's eight corners say: the steepest of this Gaussian, 12 widths in 40 cells."""
        field = self.examples[0]
        points, step = self.sample(field, 300), 1e-6 * self.size(field)
        lowest, highest = field.extremes(points - step, points + step)
        # The slope along an axis is at most 0.607 per width; three axes with that slope among them, sqrt(3).
        assert (highest - lowest).max() <= 0.607 * np.sqrt(3) * 2 * 12.14 / 40
        assert (highest > lowest).sum() > 50

    def expected(self, field: Any, points: Array) -> Array:
        """Trilinear between the middles of cells, with zero or the outermost values beyond."""
        from scipy.ndimage import map_coordinates

        low, high = field.field.bounds if field.low is None else (np.array(field.low), np.array(field.high))
        shape = np.maximum(np.ceil(field.cells * (high - low) / (high - low).max() - 1e-9), 1).astype(int)
        cell = (high - low) / shape
        axes = [low[k] + (np.arange(shape[k]) + 0.5) * cell[k] for k in range(3)]
        values = field.field.density(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)).astype(np.float32)
        at = ((points - low) / cell - 0.5).T
        if field.edge == "falling":
            return map_coordinates(np.pad(values, 1).astype(float), at + 1, order=1, mode="constant")
        inside = ((points >= low) & (points <= high)).all(axis=1)
        return inside * map_coordinates(values.astype(float), at, order=1, mode="nearest")


def test_sampling_errors_fall_as_the_square_of_the_cells() -> None:
    field = GaussianSphere(width=PARSEC)
    points = np.random.default_rng(1).normal(size=(400, 3)) * PARSEC
    errors = [
        np.abs(Sampled(field=field, cells=n).density(points) - field.density(points)).max() for n in (32, 64, 128)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.35)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.35)


def test_a_field_is_sampled_once() -> None:
    a, b = (Sampled(field=GaussianSphere(width=1.0), cells=8) for _ in range(2))
    assert a.grid() is b.grid()
