"""Colours of tables for the window beside the solver's own at its usual accuracy, and what derivatives are good for."""

from __future__ import annotations

import numpy as np
import pytest
from window_skies import WAVELENGTHS, difference, views

from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.colour import spectrum_to_xyz
from skyscatter.solvers.field import solve_range
from skyscatter.window.solved import zenith_of
from skyscatter.window.table import SkySettings, SkyTableFile, default_table, make_table


def solver_differences(table: SkyTableFile, tolerance: float) -> np.ndarray:
    """ΔE of 200 views from what ``skyscatter sky`` would compute at a tolerance."""
    scene = table.settings.scene()
    zenith = zenith_of(scene, WAVELENGTHS)
    field = solve_range(scene, WAVELENGTHS, zenith, tolerance, False, None, 2)
    found = []
    for sun, directions in views(1, 25):
        origins = np.tile(scene.observer.position, (len(directions), 1))
        answer = field.along(origins, directions, field.at(field.sun(sun, 0.0)), True)
        light = answer.radiance - answer.layers["direct"]
        found.append(difference(table.xyz(directions, sun, 0.0, disk=False), spectrum_to_xyz(light, WAVELENGTHS)))
    return np.concatenate(found)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["earth", "earth-hazy", "mars"])
def test_colours_are_those_of_the_solver(model: str) -> None:
    """At the default tolerance of ``skyscatter sky``; that of the Earth is the shipped table."""
    table = SkyTableFile.from_bytes(default_table()) if model == "earth" else make_table(SkySettings(model))
    found = solver_differences(table, 0.005)
    assert found.size == 200
    # What the eye hardly tells apart is 1; what was asked for is a median of 0.5 and 2 at most.
    assert np.median(found) < 0.5
    assert found.max() < 2.0


@pytest.mark.slow
def test_more_haze_at_once_is_nearly_what_the_solver_makes_of_it() -> None:
    before = SkyTableFile.from_bytes(default_table())
    for change, most in (({"haze": 1.3}, (0.3, 2.0)), ({"ozone": 1.3}, (0.3, 2.5)), ({"haze": 0.7}, (0.5, 6.0))):
        after = make_table(SkySettings(**change))
        shown, plain = [], []
        for sun, directions in views(2, 25):
            exact = after.xyz(directions, sun, 0.0, disk=False)
            shown.append(difference(before.xyz(directions, sun, 0.0, disk=False, change=change), exact))
            plain.append(difference(before.xyz(directions, sun, 0.0, disk=False), exact))
        found, without = np.concatenate(shown), np.concatenate(plain)
        # First order: measured at the factor 1.25 of the differences it is exact, below 1 it is an extrapolation.
        assert np.median(found) < most[0], change
        assert found.max() < most[1], change
        assert np.median(found) < 0.3 * np.median(without), change


@pytest.mark.slow
def test_more_ground_light_at_once() -> None:
    """An albedo of 0.39 from derivatives at 0.3."""
    before, after = make_table(SkySettings(ground=0.3)), make_table(SkySettings(ground=0.39))
    for sun, directions in views(3, 10):
        exact = after.xyz(directions, sun, 0.0, disk=False)
        # The light of the ground goes in proportion, that of the air nearly.
        assert difference(before.xyz(directions, sun, 0.0, disk=False, change={"ground": 1.3}), exact).max() < 1.0


@pytest.mark.slow
def test_from_a_mountain_and_an_aeroplane() -> None:
    """Three kilometres and eleven up: the horizon lies low, the ground has haze before it."""
    for height in (3e3, 11e3):
        table = make_table(SkySettings(altitude_m=height))
        scene = table.settings.scene()
        field = solve_range(scene, WAVELENGTHS, zenith_of(scene, WAVELENGTHS), 0.01, False, None, 2)
        dip = np.degrees(-table.header["horizon"])
        random = np.random.default_rng(4)
        found = []
        for sun in (60.0, 12.0, 3.0, -2.0, -6.0):
            elevation = np.concatenate([random.uniform(-dip + 0.05, 60, 6), -dip - random.uniform(0.05, 30, 6)])
            directions = direction_from_azimuth_elevation(random.uniform(0, 360, 12), elevation)
            origins = np.tile(scene.observer.position, (12, 1))
            answer = field.along(origins, directions, field.at(field.sun(sun, 0.0)), True)
            exact = spectrum_to_xyz(answer.radiance - answer.layers["direct"], WAVELENGTHS)
            found.append(difference(table.xyz(directions, sun, 0.0, disk=False), exact))
        assert np.median(np.concatenate(found)) < 0.5
        assert np.concatenate(found).max() < 3.0  # the solution at 1 % that it is compared with differs by so much
