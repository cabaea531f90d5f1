"""The irradiance of the Sun's disk in pictures: every camera, any size of pixels, a disk half set."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import skyscatter
from skyscatter import Component, Fisheye, Medium, Panorama, Perspective, PlanetView, Scene, Star, Sun
from skyscatter.media.fields import Exponential
from skyscatter.optics.rayleigh import RayleighPowerLaw
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.direct import slant_columns

WAVELENGTHS = np.array([400.0, 700.0])
AIR = Component(
    name="air",
    density=Exponential(scale_height=8e3, top=80e3),
    optics=RayleighPowerLaw(coefficient=1.2e-5, wavelength=550.0),
)
#: What is asked for: a tenth of a per cent.  Cells on edges, 1/200 of the disk's radius, may miss half of it.
TOLERANCE = 1e-3


def scene(elevation: float, azimuth: float = 180.0, altitude: float = 0.0, limb_darkening: bool = True) -> Scene:
    return Scene(
        medium=Medium(planet_radius=6371e3, components=(AIR,)),
        star=Star(spectrum=1.0, limb_darkening=limb_darkening),
        sun=Sun(elevation_deg=elevation, azimuth_deg=azimuth),
        altitude=altitude,
    )


def disk_irradiance(it: Scene, low: float = -90.0) -> NDArray[np.float64]:
    """Light of the part of the disk above the horizon, and above an elevation [degree], dimmed by the air.

    Rows of one elevation e, in which the air is the same and whose ends have closed forms: the distance d from the
    middle at an azimuth a is cos d = sin e sin e0 + cos e cos e0 cos a.  The substitutions e, a ~ sin(u) take the roots
    at the ends away, so that 400 midpoints are right to 1e-5.
    """
    table = compile_scene(it, WAVELENGTHS)
    position = np.asarray(it.observer.position)
    radius = np.linalg.norm(position)
    e0, disk = np.radians(it.sun.elevation_deg), np.arcsin(it.star.radius / it.star_distance)
    bottom = max(e0 - disk, -np.arccos(min(6371e3 / radius, 1.0)), np.radians(low))
    top = min(e0 + disk, np.pi / 2)
    if bottom >= top:
        return np.zeros(WAVELENGTHS.size)
    u = (np.arange(400) + 0.5) / 400 * np.pi - np.pi / 2
    e = ((bottom + top) + (top - bottom) * np.sin(u))[:, None] / 2
    end = np.arccos(np.clip((np.cos(disk) - np.sin(e) * np.sin(e0)) / (np.cos(e) * np.cos(e0)), -1.0, 1.0))
    cosine = np.sin(e) * np.sin(e0) + np.cos(e) * np.cos(e0) * np.cos(end * np.sin(u))
    square = (1 - cosine**2) / np.sin(disk) ** 2
    solid_angle = (top - bottom) / 2 * np.cos(u)[:, None] * np.cos(e) * end * np.cos(u) * (np.pi / 400) ** 2
    mean = it.star.irradiance(WAVELENGTHS, it.star_distance) / (np.pi * np.sin(disk) ** 2)
    columns = np.array([slant_columns(table.columns, float(radius - 6371e3), float(mu)) for mu in np.sin(e[:, 0])])
    limb = it.star.limb(np.sqrt(np.clip(1 - square, 0, 1)).ravel(), WAVELENGTHS).reshape(*square.shape, -1)
    rows = np.sum(limb * mean * solid_angle[..., None], axis=1)
    return np.asarray(np.sum(rows * np.exp(-columns @ table.optics.sigma_t), axis=0))


def direct_light(it: Scene, camera: Any) -> NDArray[np.float64]:
    """Irradiance [W m-2 nm-1] that each pixel of a picture holds of the Sun's disk."""
    made = skyscatter.render(it, camera, WAVELENGTHS, solver=skyscatter.Single(tolerance=0.1), parts=True)
    return np.asarray(np.nan_to_num(made.layers["direct"]) * camera.pixel_solid_angle(it.observer)[..., None])


def assert_whole(it: Scene, *cameras: Any) -> None:
    expected = disk_irradiance(it)
    assert expected.min() > 0
    for camera in cameras:
        got = direct_light(it, camera).sum(axis=(0, 1))
        np.testing.assert_allclose(got, expected, rtol=TOLERANCE, err_msg=repr(camera))


@pytest.mark.parametrize("size", [(1, 1), (4, 2), (36, 18), (120, 60), (360, 20)])
def test_panoramas_wherever_the_sun_stands(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    camera = Panorama(width=size[0], height=size[1])
    for elevation in (*np.degrees(np.arcsin(rng.uniform(0.01, 1.0, 5))), 89.9, 90.0):
        assert_whole(scene(float(elevation), rng.uniform(0, 360)), camera)


def test_all_other_cameras() -> None:
    """Disks of 0.003 to 53 pixels across, in the middle, at the rim and in the corner of what cameras see."""
    it = scene(25.3, 77.1)
    toward: dict[str, Any] = {"azimuth_deg": 77.1, "elevation_deg": 25.3}
    assert_whole(
        it,
        Panorama(width=50, height=20, elevation_min_deg=-5.0, elevation_max_deg=60.0),
        Fisheye(width=61, height=61),
        Fisheye(width=20, height=35, projection="equisolid", east_left=False),
        Fisheye(width=3, height=3, fov_deg=360.0),
        Fisheye(width=40, height=40, fov_deg=40.0, azimuth_deg=77.1, elevation_deg=5.6, roll_deg=10.0),
        Perspective(width=3, height=2, fov_deg=150.0, azimuth_deg=70.0, elevation_deg=10.0),
        Perspective(width=64, height=48, fov_deg=60.0, azimuth_deg=50.0, elevation_deg=5.0),
        Perspective(width=33, height=22, fov_deg=1.0, **toward),
        Perspective(width=100, height=100, fov_deg=1.0, **toward),
        Perspective(width=1, height=1, fov_deg=90.0, **toward),
    )


@pytest.mark.parametrize("limb_darkening", [False, True])
@pytest.mark.parametrize(("altitude", "elevation"), [(0.0, 0.1), (0.0, -0.1), (20e3, -4.6), (700e3, -25.7)])
def test_a_disk_half_behind_the_horizon(altitude: float, elevation: float, limb_darkening: bool) -> None:
    it = scene(elevation, 180.0, altitude, limb_darkening)
    toward: dict[str, Any] = {"azimuth_deg": 180.0, "elevation_deg": elevation}
    cameras = [
        Panorama(width=120, height=60),
        Panorama(width=360, height=20),
        Fisheye(width=100, height=100, fov_deg=180.0 if altitude == 0.0 else 250.0),
        Perspective(width=60, height=60, fov_deg=1.0, **toward),
    ]
    assert_whole(it, *cameras, *([PlanetView(width=60, height=60)] if altitude > 80e3 else []))


def test_none_below_the_horizon() -> None:
    assert not direct_light(scene(-0.28), Panorama(width=36, height=18)).any()


def test_a_disk_that_the_frame_cuts_is_shared() -> None:
    """Two pictures that meet at an elevation within the disk hold its parts, and together all of it."""
    it = scene(30.0)
    for border in (29.8, 30.0, 30.1):
        upper = direct_light(it, Panorama(width=36, height=6, elevation_min_deg=border)).sum(axis=(0, 1))
        lower = direct_light(it, Panorama(width=36, height=12, elevation_max_deg=border)).sum(axis=(0, 1))
        np.testing.assert_allclose(upper, disk_irradiance(it, border), rtol=2 * TOLERANCE)  # a part of the disk
        np.testing.assert_allclose(upper + lower, disk_irradiance(it), rtol=TOLERANCE)


def test_edges_are_as_in_a_picture_that_is_finer_by_16() -> None:
    it = scene(30.0)
    fov = {"fov_deg": 1.0, "azimuth_deg": 180.1, "elevation_deg": 30.07}
    coarse = direct_light(it, Perspective(width=16, height=16, **fov))
    fine = direct_light(it, Perspective(width=256, height=256, **fov))
    binned = fine.reshape(16, 16, 16, 16, -1).sum(axis=(1, 3))
    # Shares of the brightest pixel: cells at edges are 1/16 of a pixel here and straight.
    np.testing.assert_allclose(coarse, binned, atol=3e-3 * coarse.max())
