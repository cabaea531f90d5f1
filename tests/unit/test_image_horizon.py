"""Azimuth and elevation in the files of skies: by astropy.wcs and closed forms that do not know our cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from astropy import units
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS

import skyscatter
from skyscatter.geometry.camera import camera_from_view
from skyscatter.image import FilterImage, SpectralImage
from skyscatter.image.horizon import sky_view
from skyscatter.scene import Site

TIME = "2026-06-21T19:15:00"
W, H = 36, 30
A, B = np.meshgrid(np.arange(W) - (W - 1) / 2, (H - 1) / 2 - np.arange(H))  # right and up from the middle [pixel]


def scene(altitude: float = 250.0) -> Any:
    return skyscatter.load_model("earth-simple").scene_at(48.86, 2.35, TIME + "Z", altitude)


def image(camera: Any, of: Any = None, changes: Any = None) -> SpectralImage:
    recipe = {"scene": (of or scene()).model_dump(mode="json", exclude_none=True), "camera": camera.model_dump()}
    return SpectralImage(
        np.ones((camera.height, camera.width, 2)), [450.0, 650.0], recipe={**recipe, **(changes or {})}
    )


def by_astropy(path: Path, extension: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation of every pixel, first row on top, as astropy.wcs reads the file."""
    with fits.open(path) as hdus:
        wcs = WCS(hdus[extension].header, hdus).celestial
        x, y = np.meshgrid(np.arange(wcs.pixel_shape[0]), np.arange(wcs.pixel_shape[1]))
        azimuth, elevation = wcs.wcs_pix2world(x, y, 0)
    return azimuth[::-1], elevation[::-1]


def about(azimuth: float, elevation: float, right: np.ndarray, up: np.ndarray, angle: np.ndarray) -> SkyCoord:
    """Directions at an angle [degree] from an axis, to the right and up, by astropy's spherical trigonometry.

    Its longitudes grow to the left where azimuths grow to the right: position angles are mirrored with them.
    """
    axis = SkyCoord(-azimuth, elevation, unit="deg")
    return axis.directional_offset_by(np.arctan2(-right, up) * units.rad, angle * units.deg)


def fisheye(equisolid: bool, fov: float) -> np.ndarray:
    rho = np.hypot(A, B) / (min(W, H) / 2)
    if equisolid:
        return 2 * np.degrees(np.arcsin(np.minimum(rho * np.sin(np.radians(fov) / 4), 1.0)))
    return rho * fov / 2


def pinhole(fov: float) -> np.ndarray:
    return np.degrees(np.arctan(np.hypot(A, B) / (W / 2 / np.tan(np.radians(fov) / 2))))


def turned(roll: float) -> tuple[np.ndarray, np.ndarray]:
    """Right and up of the pixels for a camera that is turned clockwise."""
    r = np.radians(roll)
    return A * np.cos(r) + B * np.sin(r), B * np.cos(r) - A * np.sin(r)


SIZE = {"width": W, "height": H}
# Camera, its axis, right and up, angle from the axis.  North is on top of a fisheye, with east on the left: it faces
# south and leans back.
ZENITHAL = {
    "fisheye": (skyscatter.Fisheye(**SIZE), 180.0, 90.0, (A, B), fisheye(False, 180.0)),
    "equisolid": (skyscatter.Fisheye(**SIZE, projection="equisolid"), 180.0, 90.0, (A, B), fisheye(True, 180.0)),
    "mirrored": (skyscatter.Fisheye(**SIZE, east_left=False), 180.0, 90.0, (-A, B), fisheye(False, 180.0)),
    "leaning": (
        skyscatter.Fisheye(**SIZE, azimuth_deg=-70, elevation_deg=25, roll_deg=33, fov_deg=220, projection="equisolid"),
        290.0, 25.0, turned(33.0), fisheye(True, 220.0),
    ),
    "perspective": (
        skyscatter.Perspective(**SIZE, azimuth_deg=350, elevation_deg=12, fov_deg=75),
        350.0, 12.0, (A, B), pinhole(75.0),
    ),
    "rolled": (
        skyscatter.Perspective(**SIZE, azimuth_deg=100, elevation_deg=-40, fov_deg=120, roll_deg=-25),
        100.0, -40.0, turned(-25.0), pinhole(120.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("name", ZENITHAL)
def test_fits_of_fisheyes_and_pinholes(tmp_path: Path, name: str, compress: bool) -> None:
    camera, azimuth, elevation, (right, up), angle = ZENITHAL[name]
    image(camera).save(tmp_path / "sky.fits", compress=compress)
    found = SkyCoord(*by_astropy(tmp_path / "sky.fits", int(compress)), unit="deg")
    truth = about(azimuth, elevation, right, up, angle)
    mirrored = SkyCoord(-found.ra, found.dec)
    inside = angle < 89.0 if name == "perspective" else np.full(angle.shape, True)
    if isinstance(camera, skyscatter.Fisheye):
        inside &= np.hypot(A, B) <= min(W, H) / 2
    assert mirrored.separation(truth).deg[inside].max() < 1e-6


@pytest.mark.parametrize(("view", "centre", "low"), [("panorama:0", 0.0, -90.0), ("panorama-upper:215.5", 215.5, 0.0)])
def test_fits_of_panoramas(tmp_path: Path, view: str, centre: float, low: float) -> None:
    image(camera_from_view(view, W, H)).save(tmp_path / "sky.fits")
    azimuth, elevation = by_astropy(tmp_path / "sky.fits")
    error = (azimuth - (centre + 360.0 * A / W) + 180.0) % 360.0 - 180.0
    assert np.abs(error).max() < 1e-6
    np.testing.assert_allclose(elevation, (low + 90) / 2 + (90 - low) * B / H, rtol=0, atol=1e-6)


def test_fits_of_a_landscape(tmp_path: Path) -> None:
    made = skyscatter.Panorama(
        **SIZE, fov_deg=90.0, centre_azimuth_deg=20.0, elevation_min_deg=-9, elevation_max_deg=36
    )
    image(made).save(tmp_path / "sky.fits")
    azimuth, elevation = by_astropy(tmp_path / "sky.fits")
    assert np.abs((azimuth - (20.0 + 90.0 * A / W) + 180.0) % 360.0 - 180.0).max() < 1e-6
    np.testing.assert_allclose(elevation, 13.5 + 45.0 * B / H, rtol=0, atol=1e-6)


def test_fits_of_a_planet(tmp_path: Path) -> None:
    of = scene(2000e3)
    image(skyscatter.PlanetView(**SIZE), of).save(tmp_path / "sky.fits")
    azimuth, elevation = by_astropy(tmp_path / "sky.fits")
    # North on top, east on the right; the limb of the air touches 1 / 1.05 of the half height.
    np.testing.assert_allclose(azimuth, np.degrees(np.arctan2(A, B)) % 360.0, rtol=0, atol=1e-6)
    radius, top = of.observer.planet_radius, of.observer.atmosphere_top
    limb = np.tan(np.arcsin((radius + top) / (radius + 2000e3)))
    nadir = np.degrees(np.arctan(np.hypot(A, B) / (H / 2) * 1.05 * limb))
    np.testing.assert_allclose(elevation, nadir - 90.0, rtol=0, atol=1e-6)


def test_cards_of_the_place_are_consistent(tmp_path: Path) -> None:
    """astropy makes geodetic of geocentric places, and days of dates, and warns where they do not agree."""
    made = image(skyscatter.Fisheye(**SIZE))
    made.save(tmp_path / "sky.fits")
    with fits.open(tmp_path / "sky.fits") as hdus:
        header = hdus[0].header
        assert (header["DATE-OBS"], header["TIMESYS"], header["ALT-OBS"]) == (TIME, "UTC", 250.0)
        sun = sky_view(made).scene.sun
        assert (header["SUNAZIM"], header["SUNELEV"]) == (sun.azimuth_deg, sun.elevation_deg)
        assert header["TELESCOP"] == "simulated"
        assert header["INSTRUME"] == "fisheye"
        from astropy.coordinates import EarthLocation

        place = EarthLocation(*(header[f"OBSGEO-{axis}"] for axis in "XYZ"), unit="m")
        assert place.lat.deg == pytest.approx(48.86, abs=1e-9)
        assert place.lon.deg == pytest.approx(2.35, abs=1e-9)
        assert place.height.value == pytest.approx(250.0, abs=1e-6)
        assert all(len(str(card).rstrip()) <= 80 for card in header.cards)
        assert WCS(header, hdus).wcs.mjdobs == pytest.approx(61212.80208333, abs=1e-7)


def test_filter_images_have_the_same_axes(tmp_path: Path) -> None:
    made = image(skyscatter.Panorama(**SIZE, centre_azimuth_deg=90.0))
    wide = SpectralImage(np.ones((H, W, 9)), np.linspace(380, 780, 9), recipe=made.recipe)
    wide.save(tmp_path / "bands.fits", filters="B,V", compress=True)
    assert FilterImage.load(tmp_path / "bands.fits").names == ("B", "V")
    azimuth, _ = by_astropy(tmp_path / "bands.fits", 1)
    assert np.abs((azimuth - (90.0 + 360.0 * A / W) + 180.0) % 360.0 - 180.0).max() < 1e-6


@pytest.mark.parametrize("name", ["fisheye", "perspective"])
def test_coordinates_of_netcdf(tmp_path: Path, name: str) -> None:
    camera, azimuth, elevation, (right, up), angle = ZENITHAL[name]
    made = image(camera)
    made.save(tmp_path / "sky.nc")
    with xarray.open_dataset(tmp_path / "sky.nc") as data:
        data.load()
    inside = np.isfinite(data["azimuth"].values)
    truth = about(azimuth, elevation, right, up, angle)[inside]
    found = SkyCoord(-data["azimuth"].values[inside], data["elevation"].values[inside], unit="deg")
    assert found.separation(truth).deg.max() < 1e-6
    sun = SkyCoord(-float(data["sun_azimuth"]), float(data["sun_elevation"]), unit="deg")
    np.testing.assert_allclose(data["scattering_angle"].values[inside], sun.separation(truth).deg, rtol=0, atol=1e-6)
    if name == "fisheye":  # a half sphere, but for what the rim's pixels cut off or add
        assert float(data["solid_angle"].sum()) == pytest.approx(2 * np.pi, rel=0.03)
    assert data["azimuth"].attrs["units"] == data["elevation"].attrs["units"] == "degree"
    assert data["sun_elevation"].attrs["standard_name"] == "solar_elevation_angle"
    assert (float(data["latitude"]), float(data["longitude"]), float(data["observer_altitude"])) == (48.86, 2.35, 250.0)
    assert data["time"].values == np.datetime64(TIME)
    assert "azimuth" in data["radiance"].sel(wavelength=450.0).coords
    assert SpectralImage.load(tmp_path / "sky.nc").recipe == made.recipe


def test_pictures_of_planets_are_data_too() -> None:
    """Their camera frames the air's top, which it asks the observer of the recipe."""
    from skyscatter.inversion.images import sky_image

    camera, of = skyscatter.PlanetView(**SIZE), scene(2000e3)
    look = sky_image(image(camera, of), noise=0.01, pixels=20).looks[0]
    seen = camera.directions(of.observer).reshape(-1, 3)
    assert np.abs(look.directions[:, None] - seen).max(axis=-1).min(axis=1).max() < 1e-12


def test_pictures_that_do_not_say_have_no_such_axes() -> None:
    camera = skyscatter.Fisheye(**SIZE)
    good = image(camera)
    assert sky_view(good) is not None
    cut = SpectralImage(good.radiance[:10], good.wavelengths, recipe=good.recipe)
    nebula = {"scene": {"medium": {"components": []}}, "camera": camera.model_dump()}
    for bad in (cut, *(image(camera, None, c) for c in ({"scene": None}, {"camera": {"kind": "eye"}}, nebula))):
        assert sky_view(bad) is None
        assert "azimuth" not in bad.dataset.coords
    # A planet seen from within its air: no such view.
    assert sky_view(image(skyscatter.PlanetView(**SIZE))) is None


def test_a_sun_that_was_moved_forgets_place_and_time() -> None:
    from skyscatter.solvers.field import RadianceField

    of = scene()
    assert of.sun.site == Site(latitude_deg=48.86, longitude_deg=2.35, time=TIME)

    class Field:
        scene = of

    moved = RadianceField.sun(Field(), 20.0, None)  # type: ignore[arg-type]
    assert (moved.elevation_deg, moved.azimuth_deg, moved.site) == (20.0, of.sun.azimuth_deg, None)
    assert RadianceField.sun(Field(), None, None) == of.sun  # type: ignore[arg-type]
