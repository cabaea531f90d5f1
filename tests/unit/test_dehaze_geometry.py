"""Angles over an image: what comes out between nodes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.dehaze.geometry import SceneGeometry, fold_azimuth
from skyscatter.dehaze.options import DehazeOptions, SourceOptions, split_options
from skyscatter.errors import DomainError

#: Of float64 after a dozen operations on angles up to 360.
ROUNDING = 1e-11


def test_one_node_is_the_same_everywhere():
    geometry = SceneGeometry.constant(40.0, 10.0, 250.0)
    assert geometry.is_constant
    found = geometry.at([0.5, 1000.0], [3.0, 4.0, 5.0])
    assert found.sun_zenith_deg.shape == (2, 3)
    np.testing.assert_allclose(found.sun_zenith_deg, 40.0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.view_zenith_deg, 10.0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.relative_azimuth_deg, 110.0, rtol=0, atol=ROUNDING)  # 360 - 250
    np.testing.assert_allclose(geometry.secant_of_sun([0.0], [0.0]), 1 / np.cos(np.radians(40.0)), rtol=1e-14)


def test_azimuths_give_the_relative_one():
    geometry = SceneGeometry.constant(40.0, 10.0, sun_azimuth_deg=350.0, view_azimuth_deg=20.0)
    assert geometry.relative_azimuth_deg[0, 0] == pytest.approx(30.0, abs=ROUNDING)
    assert geometry.to_json() == {"sun_zenith_deg": 40.0, "view_zenith_deg": 10.0, "relative_azimuth_deg": 30.0}


def test_relative_azimuth_is_folded():
    np.testing.assert_allclose(fold_azimuth([0, 180, 190, -10, 370, 540]), [0, 180, 170, 10, 10, 180])


def test_between_nodes_angles_are_bilinear_and_outside_as_at_the_nearest():
    rows, cols = np.array([0.0, 10.0, 30.0]), np.array([5.0, 25.0])
    plane = 20.0 + 0.5 * rows[:, None] + 0.25 * cols
    geometry = SceneGeometry(rows, cols, plane, np.zeros((3, 2)), np.zeros((3, 2)))
    found = geometry.at([2.0, 17.5], [6.0, 20.0]).sun_zenith_deg
    expected = 20.0 + 0.5 * np.array([[2.0], [17.5]]) + 0.25 * np.array([6.0, 20.0])
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
    outside = geometry.at([-5.0, 99.0], [0.0, 99.0]).sun_zenith_deg
    np.testing.assert_allclose(outside, plane[[0, 2]][:, [0, 1]], rtol=0, atol=ROUNDING)


def test_a_view_that_crosses_the_zenith_goes_through_it():
    """Zenith angle 4 on one side and 4 on the other: 0 in the middle, where azimuths jump."""
    geometry = SceneGeometry([0.0], [0.0, 8.0], [[30.0, 30.0]], [[4.0, 4.0]], [[60.0, 240.0]])
    found = geometry.at([0.0], [0.0, 2.0, 4.0, 6.0, 8.0])
    np.testing.assert_allclose(found.view_zenith_deg[0], [4.0, 2.0, 0.0, 2.0, 4.0], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.relative_azimuth_deg[0, [0, 1, 3, 4]], [60, 60, 120, 120], rtol=0, atol=1e-9)


def test_points_do_not_depend_on_their_company():
    """Windows of any size see the same angles, bit by bit."""
    rng = np.random.default_rng(1)
    rows, cols = np.arange(6) * 50.0, np.arange(5) * 60.0
    geometry = SceneGeometry(rows, cols, 30 + rng.random((6, 5)), 5 * rng.random((6, 5)), 300 * rng.random((6, 5)))
    whole = geometry.at(np.arange(200) + 0.5, np.arange(210) + 0.5)
    part = geometry.at(np.arange(33, 97) + 0.5, np.arange(101, 118) + 0.5)
    for a, b in zip(whole, part, strict=True):
        np.testing.assert_array_equal(a[33:97, 101:118], b)
    moved = geometry.relative_to(33.0, 101.0).at(np.arange(64) + 0.5, np.arange(17) + 0.5)
    np.testing.assert_allclose(moved.view_zenith_deg, part.view_zenith_deg, rtol=0, atol=ROUNDING)


def test_the_record_cannot_be_written_to():
    source = np.array([[30.0]])
    geometry = SceneGeometry([0.0], [0.0], source, [[0.0]], [[0.0]])
    source[:] = 50.0
    assert geometry.sun_zenith_deg[0, 0] == 30.0
    with pytest.raises(ValueError, match="read-only"):
        geometry.sun_zenith_deg[0, 0] = 1.0


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        ((90.0, 0.0, 0.0), "the Sun is below the horizon"),
        ((85.1, 0.0, 0.0), "the Sun is too low; the model holds for zenith angles from 0 to 85 degrees"),
        ((-1.0, 0.0, 0.0), "0 or more"),
        ((30.0, 85.5, 0.0), "too oblique"),
        ((30.0, -5.0, 0.0), "0 or more"),
        ((float("nan"), 0.0, 0.0), "every node needs an angle"),
    ],
)
def test_angles_out_of_range_are_refused(angles, message):
    with pytest.raises(DomainError, match=message):
        SceneGeometry.constant(*angles)


def test_nodes_that_do_not_fit_are_refused():
    with pytest.raises(DomainError, match="must have the shape"):
        SceneGeometry([0.0, 1.0], [0.0], [[30.0]], [[0.0]], [[0.0]])
    with pytest.raises(DomainError, match="ascend"):
        SceneGeometry([1.0, 0.0], [0.0], [[30.0], [30.0]], [[0.0], [0.0]], [[0.0], [0.0]])


def test_options_say_the_geometry():
    assert SourceOptions().geometry() is None
    geometry = SourceOptions(sun_zenith_deg=40.0, view_zenith_deg=8.0, sun_azimuth_deg=100.0, view_azimuth_deg=280.0)
    assert geometry.geometry().relative_azimuth_deg[0, 0] == pytest.approx(180.0)
    assert SourceOptions(sun_zenith_deg=40.0).geometry().view_zenith_deg[0, 0] == 0.0


def test_options_of_dehazing_have_limits():
    assert DehazeOptions(aod="auto", alpha=0, strength=0).alpha == 0.0
    for bad in ({"aod": -0.1}, {"aod": "some"}, {"strength": None}, {"strength": 1.5}, {"alpha": 5}, {"ozone_du": -1}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            DehazeOptions(**bad)


def test_options_in_one_go_are_told_apart():
    source, options = split_options({"aod": 0.2, "sun_zenith_deg": 30, "bands": ("red",)})
    assert (source.sun_zenith_deg, source.bands, options.aod) == (30.0, ("red",), 0.2)
    with pytest.raises(DomainError, match="did you mean sun_zenith_deg"):
        split_options({"sun_zenith": 30})
