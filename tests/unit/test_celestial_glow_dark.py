"""The dark sky as a whole: brightness and colours of zodiacal light, stars and airglow beside what sites report."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.celestial.airglow import airglow_radiance
from skyscatter.celestial.starlight import starlight_radiance
from skyscatter.celestial.zodiacal import S10_MAGNITUDE, zodiacal_radiance
from skyscatter.image.filters import filter_curve
from skyscatter.image.photometry import VEGA_ZERO

ARCSEC2 = (np.pi / 648000.0) ** 2
WIDE = np.arange(300.0, 951.0, 1.0)


def direction(longitude, latitude):
    lon, lat = np.broadcast_arrays(np.radians(longitude), np.radians(latitude))
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def magnitudes(radiance):
    return {
        band: float(-2.5 * np.log10(filter_curve(band).weights(WIDE)[0] @ radiance * ARCSEC2 / zero))
        for band, zero in VEGA_ZERO.items()
    }


def parts(from_sun, ecliptic_latitude, solar_flux):
    """Zodiacal light, starlight at 50 degrees and more from the Milky Way, and the airglow of the zenith."""
    latitude = np.array([50.0, 60.0, 70.0, 80.0])
    stars = starlight_radiance(direction(np.arange(0.0, 360.0, 10.0)[:, None], np.append(latitude, -latitude)), WIDE)
    zodiacal = zodiacal_radiance(direction(from_sun, ecliptic_latitude), 0.0, WIDE)
    return zodiacal, stars.mean(axis=(0, 1)), airglow_radiance(1.0, WIDE, solar_flux=solar_flux)


def test_zenith_of_a_dark_site() -> None:
    """Sites without lamps have 21.6 to 22.0 in V where the zodiacal light and the Milky Way are weak.  Outside the air,
    with what scattering brings and takes left out: 0.1 mag at most in V."""
    light = parts(120.0, 60.0, 100.0)
    assert 21.6 < magnitudes(sum(light))["V"] < 22.0
    # By component, in stars of tenth magnitude per square degree, beside Leinert et al. (1998): 60 at the ecliptic's
    # pole (table 16), 30 to 45 with scattered light near the galactic poles, 145 of airglow (the last two from memory).
    split = [10 ** (0.4 * (S10_MAGNITUDE - magnitudes(one)["V"])) for one in light]
    assert split == pytest.approx([60.0, 40.0, 145.0], rel=0.15)


def test_beside_paranal_in_the_maximum_of_the_sun() -> None:
    """Means of 174 nights in 2000 and 2001 (Patat 2003, A&A 400, 1183): 22.3, 22.6, 21.6, 20.9, 19.7 in U to I.  The
    solar radio flux was some 180 sfu, the fields at middling latitudes in the ecliptic.

    Allowed: 0.2 in B - V and V - R (published sites differ by that) and in V; 0.3 in U, which the air would dim.  I is
    the worst, 0.4 too bright: OH is shared out by one temperature, and the instrument's filter ends where its detector
    does.
    """
    ours = magnitudes(sum(parts(150.0, 30.0, 180.0)))
    seen = {"U": 22.3, "B": 22.6, "V": 21.6, "R": 20.9, "I": 19.7}
    assert ours["V"] == pytest.approx(seen["V"], abs=0.2)
    assert ours["U"] == pytest.approx(seen["U"], abs=0.3)
    for blue, red in ("BV", "VR"):
        assert ours[blue] - ours[red] == pytest.approx(seen[blue] - seen[red], abs=0.2)
    assert ours["I"] == pytest.approx(seen["I"], abs=0.5)
