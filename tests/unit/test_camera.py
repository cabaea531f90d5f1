"""Cameras: orientation as in docs/conventions.md, the inverse, solid angles, refusals."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from skyscatter.errors import DomainError
from skyscatter.geometry import Camera, Fisheye, Panorama, Perspective, PlanetView, Telescope, camera_from_view
from skyscatter.geometry.vectors import (
    azimuth_elevation_from_direction,
    camera_frame,
    direction_from_azimuth_elevation,
)

FORWARD, RIGHT, ABOVE = camera_frame(30.0, -20.0, 40.0)  # any three orthogonal axes
ORBIT = SimpleNamespace(
    altitude=20_000e3, planet_radius=6371e3, atmosphere_top=100e3, forward=FORWARD, right=RIGHT, up=ABOVE
)
EAST, NORTH, UP = np.eye(3)

CAMERAS = [
    Panorama(width=24, height=12),
    Panorama(width=24, height=7, elevation_min_deg=-5, elevation_max_deg=60, centre_azimuth_deg=10),
    Panorama(width=24, height=9, elevation_min_deg=-8, elevation_max_deg=37, centre_azimuth_deg=350, fov_deg=120),
    Fisheye(width=21, height=17),
    Fisheye(width=16, height=20, projection="equisolid", fov_deg=220, east_left=False),
    Fisheye(width=16, height=16, fov_deg=360, azimuth_deg=30, elevation_deg=-20, roll_deg=15),
    Perspective(width=20, height=11, azimuth_deg=120, elevation_deg=15, fov_deg=70, roll_deg=-20),
    Perspective(width=9, height=9, azimuth_deg=0, elevation_deg=90, fov_deg=150),
    PlanetView(width=15, height=12),
    Telescope(width=14, height=9, pixel_scale_deg=2.0),
]
IDS = [f"{camera.kind}-{number}" for number, camera in enumerate(CAMERAS)]


def test_azimuth_runs_from_north_through_east():
    # exact up to the rounding of sin and cos of a multiple of pi / 2
    np.testing.assert_allclose(direction_from_azimuth_elevation(0, 0), NORTH, atol=1e-15)
    np.testing.assert_allclose(direction_from_azimuth_elevation(90, 0), EAST, atol=1e-15)
    np.testing.assert_allclose(direction_from_azimuth_elevation(123, 90), UP, atol=1e-15)


@given(st.floats(0, 360, exclude_max=True), st.floats(-89.9, 89.9))
def test_azimuth_and_elevation_come_back(azimuth, elevation):
    a, e = azimuth_elevation_from_direction(direction_from_azimuth_elevation(azimuth, elevation))
    # 0.1 degree off the vertical the azimuth loses three digits; both are rounding of degrees up to 360
    assert abs((a - azimuth + 180) % 360 - 180) < 1e-10
    assert abs(e - elevation) < 1e-12
    assert 0 <= a < 360


def test_tiny_negative_azimuth_stays_below_360():
    assert azimuth_elevation_from_direction([-1e-300, 1.0, 0.0])[0] == 0.0


@given(st.floats(-360, 360), st.floats(-90, 90), st.floats(-180, 180))
def test_camera_frame_is_right_handed(azimuth, elevation, roll):
    forward, right, up = camera_frame(azimuth, elevation, roll)
    matrix = np.stack([right, up, -forward])
    # rounding of products of sines and cosines
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=4e-15)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=4e-15)


def test_positive_roll_turns_the_camera_clockwise():
    _, _, up = camera_frame(0.0, 0.0, 90.0)  # looking north: clockwise from above is towards the east
    np.testing.assert_allclose(up, EAST, atol=1e-15)  # rounding of cos(pi / 2)


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
def test_directions_are_unit_vectors_or_nan(camera):
    d = camera.directions(ORBIT)
    assert d.shape == (camera.height, camera.width, 3)
    assert d.dtype == np.float64
    length = np.linalg.norm(d, axis=-1)
    inside = np.isfinite(length)
    assert inside.any()
    np.testing.assert_allclose(length[inside], 1.0, atol=1e-15)  # rounding
    assert np.array_equal(inside, camera.pixel_solid_angle(ORBIT) > 0)
    assert np.array_equal(np.isnan(d).any(axis=-1), np.isnan(d).all(axis=-1))


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
def test_pixel_inverts_directions(camera):
    d = camera.directions(ORBIT)
    x, y = camera.pixel(d, ORBIT)
    j, i = np.mgrid[: camera.height, : camera.width].astype(float)
    outside = np.isnan(d[..., 0])
    # atan2 and asin keep 1e-15 rad; a pixel is 0.01 rad and more, and asin loses half its digits near its end
    np.testing.assert_allclose(x, np.where(outside, np.nan, i), atol=1e-6)
    np.testing.assert_allclose(y, np.where(outside, np.nan, j), atol=1e-6)


@given(
    st.floats(0, 360),
    st.floats(-90, 90),
    st.sampled_from(CAMERAS),
)
def test_a_direction_is_seen_in_the_pixel_nearest_to_it(azimuth, elevation, camera):
    direction = direction_from_azimuth_elevation(azimuth, elevation)
    x, y = camera.pixel(direction, ORBIT)
    assert np.isnan(x) == np.isnan(y)
    if np.isnan(x):
        return
    i, j = round(min(max(float(x), 0), camera.width - 1)), round(min(max(float(y), 0), camera.height - 1))
    nearest = camera.directions(ORBIT)[j, i]
    if np.isnan(nearest[0]):
        return  # the pixel's centre lies outside the circle, its corner inside
    angle = np.degrees(np.arccos(np.clip(nearest @ direction, -1, 1)))
    # half the diagonal of the coarsest pixel: 150 degrees over 9, at the centre atan(sqrt(0.5) tan(75) / 4.5) = 30.4
    assert angle < 30.5


@pytest.mark.parametrize("size", [(64, 32), (33, 9)])
def test_panorama_covers_the_sphere_exactly(size):
    width, height = size
    full = Panorama(width=width, height=height).pixel_solid_angle()
    upper = Panorama(width=width, height=height, elevation_min_deg=0).pixel_solid_angle()
    assert full.sum() == pytest.approx(4 * np.pi, rel=1e-13)  # sum of exact strips: rounding only
    assert upper.sum() == pytest.approx(2 * np.pi, rel=1e-13)


@pytest.mark.parametrize("projection", ["equidistant", "equisolid"])
@pytest.mark.parametrize(("fov", "expected"), [(180, 2 * np.pi), (90, 2 * np.pi * (1 - np.sqrt(0.5)))])
def test_fisheye_solid_angle(projection, fov, expected):
    omega = Fisheye(width=400, height=400, projection=projection, fov_deg=fov).pixel_solid_angle()
    # pixels on the rim count wholly or not at all: the lattice of 125664 points in the circle is off by about 0.03 %
    assert omega.sum() == pytest.approx(expected, rel=1e-3)


def test_equisolid_pixels_are_all_alike():
    omega = Fisheye(width=30, height=30, projection="equisolid").pixel_solid_angle()
    assert np.unique(omega[omega > 0]).size == 1


def test_perspective_solid_angle():
    # a square frame of half-width tan(45 degrees) is one face of a cube: 4 pi / 6; midpoint rule over 200 pixels: 1e-5
    omega = Perspective(width=200, height=200, azimuth_deg=0, fov_deg=90).pixel_solid_angle()
    assert omega.sum() == pytest.approx(4 * np.pi / 6, rel=2e-5)


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
def test_solid_angle_is_the_angle_between_neighbours(camera):
    """Cross product of the steps to the neighbours, on a fine version of the same camera."""
    fine = camera.model_copy(update={"width": camera.width * 32, "height": camera.height * 32})
    d, omega = fine.directions(ORBIT), fine.pixel_solid_angle(ORBIT)
    across, down = (d[1:-1, 2:] - d[1:-1, :-2]) / 2, (d[2:, 1:-1] - d[:-2, 1:-1]) / 2
    area = np.linalg.norm(np.cross(across, down), axis=-1)
    known = np.isfinite(area)
    # central differences: second order in a pixel of 0.03 rad and less, (0.03)^2 / 6 = 1.5e-4, thrice that in corners
    assert np.median(np.abs(area[known] / omega[1:-1, 1:-1][known] - 1)) < 5e-4


def test_fisheye_has_north_up_and_east_left():
    d = Fisheye(width=101, height=101).directions()
    assert d[50, 50] == pytest.approx(UP, abs=1e-15)  # rounding of cos(pi / 2)
    assert d[0, 50] @ NORTH > 0.99
    assert d[50, 0] @ EAST > 0.99
    mirrored = Fisheye(width=101, height=101, east_left=False).directions()
    assert mirrored[50, 100] @ EAST > 0.99
    assert mirrored[0, 50] @ NORTH > 0.99


def test_fisheye_equidistant_angle_grows_with_radius():
    d = Fisheye(width=100, height=100).directions()
    zenith_angle = np.degrees(np.arccos(d[49, 50:, 2]))
    steps = np.hypot(np.arange(50) + 0.5, 0.5) * 1.8
    np.testing.assert_allclose(zenith_angle, steps, atol=1e-10)  # arccos loses some digits near the zenith


def test_panorama_azimuth_grows_to_the_right():
    camera = Panorama(width=36, height=18, centre_azimuth_deg=90)
    azimuth, elevation = azimuth_elevation_from_direction(camera.directions())
    np.testing.assert_allclose(azimuth[9, 18], 95, atol=1e-12)  # rounding of degrees
    np.testing.assert_allclose(azimuth[9, 17], 85, atol=1e-12)
    np.testing.assert_allclose(elevation[:, 0], 85 - 10 * np.arange(18), atol=1e-12)


def test_perspective_looks_where_it_points():
    camera = Perspective(width=81, height=41, azimuth_deg=90, elevation_deg=20, fov_deg=60)
    d = camera.directions()
    np.testing.assert_allclose(d[20, 40], direction_from_azimuth_elevation(90, 20), atol=1e-15)  # rounding
    assert d[0, 40, 2] > d[20, 40, 2]  # up is up
    assert d[20, 80] @ NORTH < 0  # facing east, south is on the right
    left, right = camera.pixel(camera.directions()[20, 0])[0], camera.pixel(camera.directions()[20, 80])[0]
    assert (left, right) == pytest.approx((0, 80), abs=1e-9)  # rounding, times 80 pixels
    edges = np.degrees(np.arctan2(40.5, 40.5 / np.tan(np.radians(30))))
    assert 2 * edges == pytest.approx(60)


def test_planet_fills_the_picture_up_to_the_margin():
    camera = PlanetView(width=201, height=201, margin=0.05)
    d = camera.directions(ORBIT)
    assert d[100, 100] == pytest.approx(-UP, abs=1e-15)  # rounding of cos(pi / 2)
    assert d[0, 100] @ NORTH > 0
    assert d[100, 200] @ EAST > 0
    limb = np.arcsin((6371e3 + 100e3) / (6371e3 + 20_000e3))
    on_limb = np.array([np.sin(limb), 0.0, -np.cos(limb)])
    x, y = camera.pixel(on_limb, ORBIT)
    # half the width is 100.5 pixels, 1.05 times the radius of the limb
    assert x == pytest.approx(100 + 100.5 / 1.05, abs=1e-9)  # rounding, times 100 pixels
    assert y == pytest.approx(100, abs=1e-9)


@pytest.mark.parametrize("altitude", [0.0, 100e3])
def test_planet_view_from_inside_the_air_is_refused(altitude):
    inside = SimpleNamespace(altitude=altitude, planet_radius=6371e3, atmosphere_top=100e3)
    with pytest.raises(DomainError, match="above the atmosphere's top"):
        PlanetView(width=4, height=4).directions(inside)
    with pytest.raises(DomainError, match="observer"):
        PlanetView(width=4, height=4).directions()


def test_telescope_looks_along_the_axes_of_its_view():
    camera = Telescope(width=21, height=11, pixel_scale_deg=1.0 / 60)
    d = camera.directions(ORBIT)
    np.testing.assert_allclose(d[5, 10], FORWARD, atol=1e-15)  # rounding
    # TAN: f tan(angle) pixels from the centre with f = 1 / radians(scale)
    offset = d[5, 20] - FORWARD * (d[5, 20] @ FORWARD)
    assert np.arctan2(offset @ RIGHT, d[5, 20] @ FORWARD) == pytest.approx(np.arctan(10 * np.radians(1 / 60)), rel=1e-9)
    assert d[0, 10] @ ABOVE > 0  # the first row is the top
    assert np.isnan(camera.pixel(-FORWARD, ORBIT)).all()
    # a pixel of one arc minute at the centre, and cos(angle)^3 of it elsewhere
    omega = camera.pixel_solid_angle(ORBIT)
    assert omega[5, 10] == pytest.approx(np.radians(1 / 60) ** 2, rel=1e-12)  # rounding
    assert omega[5, 20] == pytest.approx(np.radians(1 / 60) ** 2 * (d[5, 20] @ FORWARD) ** 3, rel=1e-12)


def test_telescope_follows_the_celestial_tangent_projection():
    """Against astropy's TAN, with the view's axes those of a tangent point."""
    from astropy.wcs import WCS

    ra, dec = np.radians([210.0, 54.0])
    view = SimpleNamespace(
        forward=np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]),
        right=np.array([np.sin(ra), -np.cos(ra), 0.0]),  # west
        up=np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)]),
    )
    camera = Telescope(width=9, height=6, pixel_scale_deg=1.5)
    wcs = WCS(naxis=2)
    wcs.wcs.ctype, wcs.wcs.crval = ["RA---TAN", "DEC--TAN"], [210.0, 54.0]
    wcs.wcs.crpix, wcs.wcs.cdelt = [5.0, 3.5], [-1.5, 1.5]
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    alpha, delta = np.radians(wcs.wcs_pix2world(np.column_stack([x.ravel(), 5 - y.ravel()]), 0)).T
    expected = np.stack([np.cos(delta) * np.cos(alpha), np.cos(delta) * np.sin(alpha), np.sin(delta)], axis=-1)
    # rounding of degrees up to 360 in trigonometric functions
    np.testing.assert_allclose(camera.directions(view).reshape(-1, 3), expected, atol=1e-13)


def test_telescope_by_field_of_view_and_by_length():
    camera = Telescope.from_field_of_view(100, 50, 40.0)
    edges = 2 * np.degrees(np.arctan(50 * np.radians(camera.pixel_scale_deg)))
    assert edges == pytest.approx(40.0, rel=1e-12)  # rounding
    assert (camera.width, camera.height) == (100, 50)
    camera = Telescope.from_length(200, 100, "2 pc", "400 pc")
    assert camera.pixel_scale_deg == pytest.approx(np.degrees(2 / 400) / 200, rel=1e-12)  # rounding
    with pytest.raises(DomainError, match="field_of_view_deg"):
        Telescope.from_field_of_view(10, 10, 180.0)
    with pytest.raises(DomainError, match="distance"):
        Telescope.from_length(10, 10, "1 pc", 0.0)
    with pytest.raises(DomainError, match="needs right, up and forward"):
        camera.directions()


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Panorama, {"width": 0, "height": 4}),
        (Panorama, {"width": 4, "height": 4, "elevation_min_deg": 40, "elevation_max_deg": 30}),
        (Fisheye, {"width": 4, "height": 4, "fov_deg": 361}),
        (Fisheye, {"width": 4, "height": 4, "projection": "square"}),
        (Perspective, {"width": 4, "height": 4, "azimuth_deg": 0, "fov_deg": 180}),
        (Perspective, {"width": 4, "height": 4, "azimuth_deg": float("nan")}),
        (PlanetView, {"width": 4, "height": 4, "margin": -0.1}),
        (PlanetView, {"width": 4, "height": 4, "colour": "blue"}),
        (Telescope, {"width": 4, "height": 4}),
        (Telescope, {"width": 4, "height": 4, "pixel_scale_deg": 0.0}),
    ],
)
def test_bad_values_are_refused(kind, values):
    with pytest.raises(ValidationError):
        kind(**values)


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
def test_cameras_can_be_written_and_read_back(camera):
    assert TypeAdapter(Camera).validate_python(camera.model_dump()) == camera


def test_views_of_the_command_line():
    assert camera_from_view("panorama", 8, 4, 250) == Panorama(width=8, height=4, centre_azimuth_deg=250)
    assert camera_from_view("panorama:0", 8, 4, 250).centre_azimuth_deg == 0
    assert camera_from_view("panorama-upper:-90", 8, 4, 250).centre_azimuth_deg == 270
    upper = camera_from_view("panorama-upper", 8, 4)
    assert (upper.elevation_min_deg, upper.centre_azimuth_deg) == (0, 180)
    assert camera_from_view("fisheye", 8, 4) == Fisheye(width=8, height=4)
    assert camera_from_view("fisheye-equisolid", 8, 4).projection == "equisolid"
    assert camera_from_view("planet", 8, 4) == PlanetView(width=8, height=4)
    expected = Perspective(width=8, height=4, azimuth_deg=90, elevation_deg=-10, fov_deg=45)
    assert camera_from_view("perspective:90,-10,45", 8, 4) == expected


def standing(altitude: float) -> SimpleNamespace:
    return SimpleNamespace(altitude=altitude, planet_radius=6371e3, atmosphere_top=100e3)


@pytest.mark.parametrize(("altitude", "fov", "below"), [(0.0, 120.0, 1 / 6), (10e3, 120.0, 1 / 6), (400e3, 40.0, 0.6)])
def test_a_landscape_has_its_horizon_where_it_should_be(altitude, fov, below):
    camera = camera_from_view("landscape", 120, 60, 250, standing(altitude))
    dip = np.arccos(6371e3 / (6371e3 + altitude))
    _, y = camera.pixel(direction_from_azimuth_elevation(250, np.degrees(-dip)))
    assert y == pytest.approx(60 * (1 - below) - 0.5, abs=1e-6)  # rounding, of a small dip most
    assert (camera.fov_deg, camera.centre_azimuth_deg) == (fov, 250.0)
    # as many degrees to a pixel both ways
    assert camera.elevation_max_deg - camera.elevation_min_deg == pytest.approx(fov / 2, rel=1e-12)


def test_landscapes_of_the_command_line():
    east = camera_from_view("landscape:90", 120, 40, 250, standing(0.0))
    assert (east.centre_azimuth_deg, east.fov_deg) == (90.0, 120.0)
    narrow = camera_from_view("landscape:-10,30", 120, 40, 250, standing(0.0))
    assert (narrow.centre_azimuth_deg, narrow.fov_deg) == (350.0, 30.0)
    # nothing is seen above the zenith, however high the picture
    assert camera_from_view("landscape:0,360", 100, 100, 250, standing(0.0)).elevation_max_deg == 90.0
    for view in ("landscape:", "landscape:north", "landscape:1,2,3", "landscape:nan"):
        with pytest.raises(DomainError, match="such as landscape:90 or landscape:90,60"):
            camera_from_view(view, 8, 4, 250, standing(0.0))
    with pytest.raises(DomainError, match="needs the observer's altitude"):
        camera_from_view("landscape", 8, 4)
    with pytest.raises(ValidationError, match="fov_deg"):
        camera_from_view("landscape:0,400", 8, 4, 250, standing(0.0))


def test_part_of_a_panorama_is_that_part():
    whole = Panorama(width=36, height=18, centre_azimuth_deg=90)
    part = Panorama(width=12, height=18, centre_azimuth_deg=90, fov_deg=120)
    np.testing.assert_allclose(part.directions(), whole.directions()[:, 12:24], atol=1e-15)  # rounding
    np.testing.assert_allclose(part.pixel_solid_angle(), whole.pixel_solid_angle()[:, 12:24], rtol=1e-12)  # rounding
    assert np.isnan(part.pixel(direction_from_azimuth_elevation(151, 0))).all()
    assert np.isfinite(part.pixel(direction_from_azimuth_elevation(149, 0))).all()


@pytest.mark.parametrize("view", ["panorama:", "panorama:north", "panorama-upper:1,2"])
def test_the_middle_of_a_panorama_is_an_azimuth(view):
    with pytest.raises(DomainError, match="give the azimuth in degrees, such as panorama"):
        camera_from_view(view, 8, 4)


@pytest.mark.parametrize("view", ["", "globe", "panoramas:3", "fisheye:", "Planet"])
def test_unknown_views_list_the_choices(view):
    with pytest.raises(DomainError, match=r"panorama-upper\[:AZIMUTH\], fisheye, fisheye-equisolid"):
        camera_from_view(view, 8, 4)


@pytest.mark.parametrize("view", ["perspective", "perspective:1,2", "perspective:a,b,c"])
def test_incomplete_perspective_shows_an_example(view):
    with pytest.raises(DomainError, match="perspective:90,10,60"):
        camera_from_view(view, 8, 4)
