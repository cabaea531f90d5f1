"""Stars: places against astropy, spectra against Bessell's bands, users' catalogues and what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest

from skyscatter.celestial.frames import Sight
from skyscatter.celestial.stars import stars_at
from skyscatter.celestial.starspectra import colour_temperature, star_spectra
from skyscatter.errors import DomainError, TableFileError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.filters import filter_curve
from skyscatter.image.photometry import VEGA_ZERO
from skyscatter.spectra.vega import BAND_NODES, magnitude

ARCSEC = 206264.8
SIGHT = Sight(-24.6, -70.4, "2024-04-12T03:00Z")
#: Hipparcos, the new reduction: right ascension and declination [rad] at J1991.25, proper motion [mas a year].
PLACES = {
    "Sirius": (1.7677943463, -0.2917513018, -546.01, -1223.07),
    "Arcturus": (3.7335754203, 0.3348810440, -1093.39, -2000.06),
    "Polaris": (0.6622851337, 1.5579531082, 44.48, -11.85),
    "Rigel": (1.3724302998, -0.1431456148, 1.31, 0.50),
}


def test_places_against_astropy() -> None:
    import astropy.units as u
    from astropy.coordinates import AltAz, EarthLocation, SkyCoord
    from astropy.time import Time
    from astropy.utils import iers

    stars = stars_at(SIGHT)
    ra, dec, pm_ra, pm_dec = np.array([PLACES[name] for name in ("Arcturus", "Polaris", "Rigel")]).T
    # so far away that parallax is 0.01 arcsec
    catalogue = SkyCoord(
        ra * u.rad, dec * u.rad, pm_ra_cosdec=pm_ra * u.mas / u.yr, pm_dec=pm_dec * u.mas / u.yr,
        distance=100 * u.pc, radial_velocity=0.0 * u.km / u.s, obstime=Time("J1991.25"),
    )  # fmt: skip
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        moment = Time("2024-04-12T03:00:00")
        site = EarthLocation(lat=-24.6 * u.deg, lon=-70.4 * u.deg, height=0 * u.m)
        judge = catalogue.apply_space_motion(moment).transform_to(AltAz(obstime=moment, location=site))
    expected = direction_from_azimuth_elevation(judge.az.deg, judge.alt.deg)
    ours = stars.directions[[stars.names.index(name) for name in ("Arcturus", "Polaris", "Rigel")]]
    # UT1 was 0.01 s from UTC and the pole 0.4 arcsec from its mean; the bar is 1 arcsec
    assert np.linalg.norm(ours - expected, axis=1).max() * ARCSEC < 0.6


def test_the_brightest() -> None:
    stars = stars_at(SIGHT)
    assert len(stars) == 15507
    assert np.all(np.diff(stars.magnitudes) >= 0)
    # Bright Star Catalogue, Johnson's V and B - V, recalled
    known = {
        "Canopus": (-0.72, 0.15), "Arcturus": (-0.04, 1.23), "Vega": (0.03, 0.0), "Capella": (0.08, 0.80),
        "Procyon": (0.38, 0.42), "Altair": (0.77, 0.22), "Aldebaran": (0.85, 1.54), "Spica": (0.98, -0.23),
        "Pollux": (1.14, 1.00), "Fomalhaut": (1.16, 0.09), "Regulus": (1.35, -0.11), "Gacrux": (1.63, 1.59),
        "Dubhe": (1.79, 1.07), "Polaris": (2.02, 0.60), "Schedar": (2.23, 1.17),
    }  # fmt: skip
    for name, (v, colour) in known.items():
        place = stars.names.index(name)
        # 0.01 from the transformation, 0.02 of the old catalogue, small changes of light; its Canopus was too bright
        assert stars.magnitudes[place] == pytest.approx(v, abs=0.12 if name == "Canopus" else 0.055), name
        assert stars.colours[place] == pytest.approx(colour, abs=0.06), name


def test_fewer_to_a_lower_limit() -> None:
    few = stars_at(SIGHT, limit=2.0)
    assert 40 < len(few) < 55  # the 50 brightest end at 2.0
    assert few.magnitudes.max() < 2.0
    with pytest.raises(DomainError, match="catalogue"):
        stars_at(SIGHT, limit=8.0)


def test_spectra_have_the_magnitudes_and_colours_of_the_catalogue() -> None:
    stars = stars_at(SIGHT, limit=4.0)
    light = stars.irradiance(BAND_NODES)
    v = magnitude(light, "V")
    # averages over cells of 1 nm of a spectrum that is linear between nodes
    assert v == pytest.approx(stars.magnitudes, abs=2e-5)
    inside = stars.colours < 2.5
    # mixing two spectra 0.01 apart
    assert (magnitude(light, "B") - v)[inside] == pytest.approx(stars.colours[inside], abs=1e-4)
    # the same by the filters of pictures, cells of 10 nm: 0.005 mag of the cells' width
    wl = np.arange(460.0, 721.0, 10.0)
    curve = filter_curve("V")
    through = stars.irradiance(wl) @ curve.weights(wl)[0]
    assert -2.5 * np.log10(through / VEGA_ZERO["V"]) == pytest.approx(stars.magnitudes, abs=5e-3)


def test_red_colours_of_standard_stars() -> None:
    """V - R of Cousins over B - V: dwarfs, from 0.9 giants (Bessell 1979, PASP 91, 589), two digits, recalled."""
    b_v = np.array([-0.20, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2])
    standard = np.array([-0.08, 0.0, 0.12, 0.24, 0.34, 0.44, 0.52, 0.61])
    light = star_spectra(b_v, BAND_NODES)
    # as the docstring says
    assert magnitude(light, "V") - magnitude(light, "R") == pytest.approx(standard, abs=0.03)


def test_temperatures_of_known_stars() -> None:
    # the Sun and Vega; the law is good to some per cent
    assert colour_temperature(0.653) == pytest.approx(5772.0, rel=0.01)
    assert colour_temperature(0.0) == pytest.approx(9600.0, rel=0.06)


def test_far_infrared_is_that_of_a_black_body() -> None:
    light = star_spectra([0.65], [2000.0, 4000.0])[0]
    x = 1.43877688e7 / colour_temperature(0.65) / np.array([2000.0, 4000.0])
    ratio = (1 / 2000.0**5 / np.expm1(x[0])) / (1 / 4000.0**5 / np.expm1(x[1]))
    # averages over cells of 2000 nm: one wavelength at a time does without
    single = star_spectra([0.65], [2000.0])[0, 0] / star_spectra([0.65], [4000.0])[0, 0]
    assert single == pytest.approx(ratio, rel=5e-3)  # mixing colours 0.01 apart
    assert light[0] > light[1] > 0


CSV = "# two of mine\nRAJ2000 [deg],DEJ2000 [deg],Vmag,B-V,pmRA [mas/yr],pmDE [mas/yr],epoch\n{}\n"


def test_fainter_stars_of_a_file(tmp_path) -> None:
    file = tmp_path / "mine.csv"
    # 61 Cyg's motion for 24.28 years from 2000: 100 arcsec
    file.write_text(CSV.format("10,20,7.5,0.5,0,0,2000\n10,20,6.0,0.5,0,0,2000\n316.7,38.7,8.0,1.2,4133,3202,2000"))
    stars = stars_at(SIGHT, limit=9.0, catalogue=file)
    assert len(stars) == 15509
    assert stars.magnitudes[-2:].tolist() == [7.5, 8.0]
    assert stars.names[-1] == ""
    assert stars.numbers[-1] == 0
    moved = SIGHT.icrs(stars.directions[-1])
    a, d = np.radians([316.7, 38.7])
    start = np.array([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)])
    years = 24.278  # from 2000 to 12 April 2024
    assert np.linalg.norm(moved - start) * ARCSEC == pytest.approx(years * np.hypot(4.133, 3.202), rel=1e-3)
    assert len(stars_at(SIGHT, limit=7.8, catalogue=file)) == 15508


def test_fainter_stars_of_a_fits_table(tmp_path) -> None:
    from astropy.table import Table

    table = Table(
        {"ra": [10.0], "dec": [20.0], "V": [7.5], "B_V": [0.5], "name": ["mine"]}, units={"ra": "deg", "dec": "deg"}
    )
    file = tmp_path / "mine.fits"
    table.write(file)
    stars = stars_at(SIGHT, limit=9.0, catalogue=file)
    d = SIGHT.icrs(stars.directions[-1])
    assert np.degrees([np.arctan2(d[1], d[0]), np.arcsin(d[2])]) == pytest.approx([10.0, 20.0], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ra [deg],dec [deg],V\n1,2,8\n", "no column B_V"),
        ("ra,dec,V,B_V\n1,2,8,0\n", "unit of ra"),
        ("ra [deg],dec [deg],V,B_V\n1,92,8,0\n", "line 2"),
        ("ra [deg],dec [deg],V,B_V\n1,2,faint,0\n", "not a finite number"),
    ],
)
def test_bad_files_are_named_in_one_line(tmp_path, text, words) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(TableFileError, match=words) as caught:
        stars_at(SIGHT, limit=9.0, catalogue=file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_tables(tmp_path) -> None:
    file = tmp_path / "bad.fits"
    file.write_bytes(b"no FITS at all")
    with pytest.raises(TableFileError, match="FITS"):
        stars_at(SIGHT, limit=9.0, catalogue=file)
    with pytest.raises(TableFileError, match="cannot be read"):
        stars_at(SIGHT, limit=9.0, catalogue=tmp_path / "nothing.csv")
