"""A picture's place in the sky as cards of a FITS header, and back (Calabretta & Greisen 2002, A&A 395, 1077).

Nebulae have right ascension and declination, skies of planets azimuth and elevation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from skyscatter.image.horizon import sky_view
from skyscatter.image.skyframe import SkyFrame
from skyscatter.units import PARSEC

if TYPE_CHECKING:
    from skyscatter.image.horizon import SkyView
    from skyscatter.scene import Scene

Card = tuple[str, Any, str]

#: Cards of the orientation of the model, which the WCS does not know.
_TURNS = {
    "inclination_deg": ("INCLINAT", "[deg] tilt of the model's axis to north"),
    "azimuth_deg": ("AZIMUTH", "[deg] turn of the model about its axis"),
    "position_angle_deg": ("POSANGLE", "[deg] turn in the sky, N through E"),
}


def axes_cards(image: Any) -> list[Card]:
    """Header cards of the first two axes of a `SpectralImage` or `FilterImage`; none where it does not say."""
    if image.sky is None:
        return horizontal_cards(sky_view(image))
    height, width = image.radiance.shape[:2]
    return celestial_cards(image.sky, width, height)


def celestial_cards(sky: SkyFrame | None, width: int, height: int) -> list[Card]:
    """Header cards of the first two axes; none without a frame.

    Row 1 of FITS is the bottom of the picture, so that declination grows with the row; east is left, so that right
    ascension falls with the column.
    """
    if sky is None:
        return []
    cards: list[Card] = [
        ("CTYPE1", "RA---TAN", "right ascension, gnomonic"),
        ("CTYPE2", "DEC--TAN", "declination, gnomonic"),
        ("CUNIT1", "deg", ""),
        ("CUNIT2", "deg", ""),
        ("CRPIX1", (width + 1) / 2, "middle of the picture"),
        ("CRPIX2", (height + 1) / 2, "middle of the picture"),
        ("CRVAL1", sky.ra_deg, "[deg]"),
        ("CRVAL2", sky.dec_deg, "[deg]"),
        ("CDELT1", -sky.pixel_scale_deg, "[deg] east is left"),
        ("CDELT2", sky.pixel_scale_deg, "[deg] north is up"),
        ("LONPOLE", 180.0, "[deg] no rotation"),
        ("RADESYS", sky.frame.upper(), "frame of the coordinates"),
    ]
    if sky.name:
        cards.append(("OBJECT", sky.name, ""))
    if sky.distance is not None:
        cards.append(("DISTANCE", sky.distance / PARSEC, "[pc] distance of the object"))
    for name, (keyword, comment) in _TURNS.items():
        if getattr(sky, name) is not None:
            cards.append((keyword, getattr(sky, name), comment))
    return cards


def read_celestial(header: Any) -> SkyFrame | None:
    """Frame that a header describes; None where it has no celestial axes, or others than a `SkyFrame` can say.

    Other projections, rotated or oblong pixels, a reference pixel away from the middle, and frames other than the ICRS
    are of that kind: the pixels are read all the same.
    """
    if (header.get("CTYPE1", "").strip(), header.get("CTYPE2", "").strip()) != ("RA---TAN", "DEC--TAN"):
        return None
    turned = any(header.get(f"{kind}{axes}") for kind in ("PC", "CD") for axes in ("1_2", "2_1"))
    middle = tuple((header.get(f"NAXIS{axis}", 0) + 1) / 2 for axis in (1, 2))
    # Either a step and a matrix or their product.
    scale = header.get("CD2_2", header.get("CDELT2", 0.0) * header.get("PC2_2", 1.0))
    across = header.get("CD1_1", header.get("CDELT1", 0.0) * header.get("PC1_1", 1.0))
    plain = (
        not turned
        and ("CD1_1" in header) == ("CD2_2" in header)
        and (header.get("CRPIX1"), header.get("CRPIX2")) == middle
        and scale > 0.0
        and abs(across + scale) <= 1e-9 * scale
        and header.get("CUNIT1", "deg").strip() == "deg" == header.get("CUNIT2", "deg").strip()
        and header.get("RADESYS", "ICRS").strip() == "ICRS"
        and header.get("LONPOLE", 180.0) == 180.0
    )
    if not plain:
        return None
    distance = header.get("DISTANCE")
    try:
        return SkyFrame(
            ra_deg=header["CRVAL1"] % 360.0,
            dec_deg=header["CRVAL2"],
            pixel_scale_deg=scale,
            distance=None if distance is None else distance * PARSEC,
            name=str(header.get("OBJECT", "")),
            **{name: header.get(keyword) for name, (keyword, _) in _TURNS.items()},
        )
    except (KeyError, TypeError, ValidationError):
        return None


def horizontal_cards(view: SkyView | None) -> list[Card]:
    """Header cards of azimuth (from north through east) and elevation as the first two axes, and of Sun and observer.

    FITS names no horizontal coordinates; of the free names ``xLON`` and ``xLAT`` of its celestial axes, ``ALON`` and
    ``ALAT`` are the ones in use for them.  Azimuth grows to the right where one looks at the horizon, unlike right
    ascension, so that its step is positive.
    """
    if view is None:
        return []
    return [*_projection(view.camera, view.scene.observer), *_place(view.scene)]


def _projection(camera: Any, observer: Any) -> list[Card]:
    matrix, axis = np.eye(2), (0.0, 0.0)
    middle = [(camera.width + 1) / 2, (camera.height + 1) / 2]
    if camera.kind == "panorama":
        low, high = camera.elevation_min_deg, camera.elevation_max_deg
        code, steps, pole = "CAR", (camera.fov_deg / camera.width, (high - low) / camera.height), 0.0
        # A cylinder that is not oblique has its reference point at the horizon, in the picture or not.
        middle[1] -= (low + high) / 2 / steps[1]
        axis = (camera.centre_azimuth_deg % 360.0, 0.0)
    else:
        code, step = _zenithal(camera, observer)
        steps, pole = (step, step), 180.0
        axis = (0.0, -90.0) if camera.kind == "planet" else (camera.azimuth_deg % 360.0, camera.elevation_deg)
        roll = np.radians(getattr(camera, "roll_deg", 0.0))
        matrix = np.array([[np.cos(roll), np.sin(roll)], [-np.sin(roll), np.cos(roll)]])
        if not getattr(camera, "east_left", True):
            matrix[:, 0] *= -1.0
    return [
        ("WCSNAME", "horizontal", "azimuth and elevation at the observer"),
        ("CTYPE1", f"ALON-{code}", "azimuth, from north through east"),
        ("CTYPE2", f"ALAT-{code}", "elevation, not refracted"),
        ("CUNIT1", "deg", ""),
        ("CUNIT2", "deg", ""),
        ("CRPIX1", middle[0], ""),
        ("CRPIX2", middle[1], ""),
        ("CRVAL1", axis[0], "[deg] azimuth of the reference point"),
        ("CRVAL2", axis[1], "[deg] elevation of the reference point"),
        ("CDELT1", steps[0], "[deg]"),
        ("CDELT2", steps[1], "[deg]"),
        *((f"PC{i + 1}_{j + 1}", float(matrix[i, j]), "") for i in range(2) for j in range(2)),
        ("LONPOLE", pole, "[deg]"),
    ]


def _zenithal(camera: Any, observer: Any) -> tuple[str, float]:
    """Code of the projection about the camera's axis, and its scale [degree per pixel]."""
    if camera.kind == "fisheye":
        radius, half = min(camera.width, camera.height) / 2, np.radians(camera.fov_deg) / 2
        if camera.projection == "equidistant":
            return "ARC", float(np.degrees(half / radius))
        return "ZEA", float(np.degrees(2 * np.sin(half / 2) / radius))
    return "TAN", float(np.degrees(1.0 / camera.focal_length(observer)))


def _place(scene: Scene) -> list[Card]:
    """Where the Sun and the observer stand, and when."""
    cards: list[Card] = [
        ("SUNAZIM", float(scene.sun.azimuth_deg) % 360.0, "[deg] azimuth of the Sun"),
        ("SUNELEV", float(scene.sun.elevation_deg), "[deg] elevation of the Sun, not refracted"),
        ("ALT-OBS", float(scene.altitude), "[m] height of the observer above the ground"),
    ]
    site = scene.sun.site
    if site is None:
        return cards
    import erfa
    from astropy.time import Time

    moment: list[Card] = [
        ("TIMESYS", "UTC", ""),
        ("DATE-OBS", site.time, "moment of the sky"),
        ("MJD-OBS", float(Time(site.time, scale="utc").mjd), "the same as a modified Julian date"),
    ]
    if site.body != "Earth":  # the standard has no keywords for places elsewhere
        planet = ("PLANET", site.body, "on which the observer stands")
        latitude = ("LAT-OBS", float(site.latitude_deg), "[deg] planetocentric, north positive")
        longitude = ("LON-OBS", float(site.longitude_deg), "[deg] east positive")
        return [*cards, planet, latitude, longitude, *moment]
    angles = np.radians([site.longitude_deg, site.latitude_deg])
    place = erfa.gd2gc(1, *angles, scene.altitude)  # WGS84
    # The standard's own ellipsoid for these keywords is an older one (IAU 1976), on which heights are 3 m less.
    geodetic = erfa.gc2gde(6378140.0, 1 / 298.2577, place)
    return [
        *cards,
        ("OBSGEO-B", float(np.degrees(geodetic[1])), "[deg] latitude of the observer, north positive"),
        ("OBSGEO-L", float(np.degrees(geodetic[0])), "[deg] longitude of the observer, east positive"),
        ("OBSGEO-H", float(geodetic[2]), "[m] height of the observer, ellipsoid IAU 1976"),
        *((f"OBSGEO-{axis}", float(x), "[m] the same place, geocentric") for axis, x in zip("XYZ", place, strict=True)),
        *moment,
    ]
