"""Values with units: what is understood, what is refused, the same in files, in Python and on the command line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from astropy import units as u
from pydantic import ValidationError

from skyscatter import PointStar, Star, Sun, View, units
from skyscatter.cli import parse
from skyscatter.errors import DomainError, UnitsError
from skyscatter.fields import Box, Sphere
from skyscatter.optics.dust import Dust
from skyscatter.optics.particles import Particles
from skyscatter.problems import problem_lines
from skyscatter.spectra.table import SpectralTable
from skyscatter.units import Measure

MEASURES = {name: value for name, value in vars(units).items() if isinstance(value, Measure)}


@pytest.mark.parametrize("name", MEASURES)
def test_every_example_is_understood_and_units_are_astropys(name: str) -> None:
    measure = MEASURES[name]
    assert math.isfinite(measure.read(measure.example, "it"))
    house = {"Lsun": "solLum"}.get(measure.house, measure.house)
    for unit, factor in measure.units.items():
        if unit not in ("%", "DU", "ppm", "ppb", "Rsun", "Lsun", "°", "ly"):
            assert factor == pytest.approx(u.Unit(unit).to(u.Unit(house)), rel=1e-9), unit


@pytest.mark.parametrize(
    ("measure", "text", "expected"),
    [
        (units.LENGTH, "0.3 AU", 0.3 * 149597870700.0),
        (units.LENGTH, "0.1pc", 0.1 * 3.0856775814913673e16),
        (units.LENGTH, "2 earthRad", 2 * 6378100.0),  # by astropy
        (units.LENGTH, "1e3", 1e3),
        (units.ANGLE, "0.5 rad", math.degrees(0.5)),
        (units.ANGLE, "30 arcmin", 0.5),
        (units.TEMPERATURE, "4 kK", 4000.0),
        (units.TIME, "20 min", 1200.0),
        (units.SHARE, "30%", 0.3),
        (units.SHARE, "12.5 %", 0.125),
        (units.NUMBER_DENSITY, "100 cm-3", 1e8),
        (units.NUMBER_DENSITY, "100 / cm3", 1e8),
        (units.EXTINCTION, "20 Mm-1", 2e-5),
        (units.MASS_DENSITY, "1 ug m-3", 1e-9),  # by astropy
        (units.ASTRONOMICAL, "45 Gm", 45e9 / 149597870700.0),  # by astropy
        (units.LUMINOSITY, "3.828e26 W", 1.0),
        (units.IRRADIANCE, "1500 W m-2 um-1", 1.5),
    ],
)
def test_texts(measure: Measure, text: str, expected: float) -> None:
    assert measure.read(text.replace(" / ", " 1/"), "it") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("measure", "value"),
    [
        (units.LENGTH, "30 deg"), (units.LENGTH, "30%"), (units.LENGTH, "km"), (units.LENGTH, True),
        (units.LENGTH, 3 * u.K), (units.ANGLE, "3 m"), (units.TEMPERATURE, "20 deg_C"), (units.SHARE, "0.3 m"),
        (units.NUMBER_DENSITY, "1 cm-2"), (units.TIME, "1 nonsense"), (units.LENGTH, [1, 2]), (units.LENGTH, None),
    ],
)  # fmt: skip
def test_a_wrong_dimension_names_field_value_and_remedy(measure: Measure, value: object) -> None:
    with pytest.raises(UnitsError) as caught:
        measure.read(value, "size")
    message = str(caught.value)
    assert message.startswith("size = ")
    assert measure.example in message
    assert "\n" not in message


def test_records_take_texts_and_quantities_alike() -> None:
    star = Star(spectrum="blackbody", temperature="4000 K", radius=0.7 * u.R_sun, distance="0.3 AU")
    assert (star.temperature, star.distance) == (4000.0, pytest.approx(0.3 * 149597870700.0))
    assert star.radius == pytest.approx(0.7 * 6.957e8)
    assert Sun(elevation_deg=0.5 * u.rad, distance_au="45 Gm").elevation_deg == pytest.approx(math.degrees(0.5))
    assert View(dec_deg="-5 deg", distance="400 pc", inclination_deg="30 arcmin").inclination_deg == 0.5
    assert Sphere(radius=1 * u.km, position=[1, 2, 3] * u.km).position == (1e3, 2e3, 3e3)
    assert Box(half_sizes=np.array([1.0, 2.0, 3.0])).half_sizes == (1.0, 2.0, 3.0)
    assert Dust(hydrogen_density="100 cm-3").hydrogen_density == pytest.approx(1e8)
    assert PointStar(temperature="10 kK", luminosity="3300 Lsun").temperature == 1e4


def test_tables_over_wavelength_take_units_in_every_place() -> None:
    phase = {"kind": "isotropic"}
    table = {"wavelengths": ["0.4 um", 700 * u.nm], "values": ["0.02 km-1", 1e-5]}
    made = Particles(extinction=table, single_scattering_albedo="95%", wavelength="0.5 um", phase=phase)
    assert made.extinction == SpectralTable(wavelengths=(400, 700), values=(2e-5, 1e-5))
    assert (made.single_scattering_albedo, made.wavelength) == (0.95, 500.0)


@pytest.mark.parametrize(
    ("build", "line"),
    [
        (lambda: Sphere(radius="-1 km"), "radius = '-1 km': must be a positive length"),
        (lambda: Sphere(radius=np.float64(-2.0)), "radius = -2.0: must be a positive length"),
        (lambda: Sun(elevation_deg="100 deg"), "elevation_deg = '100 deg': lies between -90 and 90 deg"),
        (lambda: View(ra_deg=360), "ra_deg = 360: must be at least 0 and below 360 deg"),
        (lambda: Star(temperature=0), "temperature = 0: must be a positive temperature"),
        (lambda: Star(radius=float("inf")), "radius = inf: give a finite number"),
        (lambda: Star(spectrum="sunn"), "spectrum = 'sunn': there are astm-g173, blackbody"),
    ],
)
def test_bounds_hold_in_any_unit_and_say_what_was_written(build, line: str) -> None:
    with pytest.raises(ValidationError) as caught:
        build()
    assert problem_lines(caught.value) == [line]


def test_errors_show_plain_numbers() -> None:
    error = DomainError("wavelength", (np.float64(200.0), [np.int64(3)]), "no")
    assert str(error) == "wavelength = (200.0, [3]): no"


def test_the_command_line_reads_the_same_units() -> None:
    assert parse.parse_degrees("0.5 rad", "sun_elevation", 90, 0) == pytest.approx(math.degrees(0.5))
    assert parse.parse_degrees("30deg", "sun_elevation", 90, 0) == 30.0
    assert parse.parse_angle("500 mas", "pixel_scale") == pytest.approx(0.5 / 3600)
    assert parse.parse_time("1 d", "exposure_time") == 86400.0
    assert parse.parse_field("0.3 AU") == ("length", pytest.approx(0.3 * 149597870700.0))
    assert parse.parse_place("48.86 deg, 2.35deg") == (48.86, 2.35)
    with pytest.raises(DomainError, match="angle between -90 and 90"):
        parse.parse_degrees("3 km", "sun_elevation", 90, 0)


@pytest.mark.parametrize("text", ["5e-324", "1e-320", "1e-9", "1e10", "1e300", "nan", "inf"])
def test_wavelengths_beyond_all_light_are_refused_wherever_they_are_asked_for(text, capsys):
    """As logarithms and ratios of them they would be no numbers any more."""
    from skyscatter.cli.main import main
    from skyscatter.errors import SkyscatterError
    from skyscatter.optics.mie import LogNormalMode, MieAerosol
    from skyscatter.solvers.checks import check_wavelengths

    mode = LogNormalMode(median_radius=1e-7, geometric_standard_deviation=2.0)
    given = {"modes": [mode], "material": "water", "optical_depth": 0.1}
    with pytest.raises(ValueError, match="wavelength"):
        MieAerosol(**given, wavelength=float(text))
    with pytest.raises(SkyscatterError, match=r"wavelengths = .*1e-06 to 1e\+09"):
        check_wavelengths([float(text)])
    for words in (text, f"{text}:{text}:1"):
        assert main(["sky", "earth", "--wavelengths", words, "--json"]) == 2
        error = capsys.readouterr().err
        assert error.startswith("skyscatter: error: wavelengths = ")
        assert error.count("\n") == 1
