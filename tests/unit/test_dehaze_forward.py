"""The forward model of a satellite's pixel: its inverse, averages over bands, and what it does at its edges."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from skyscatter.dehaze.bands import load_sensor
from skyscatter.dehaze.forward import (
    BACK,
    DIFFUSE,
    DIRECT,
    PATH,
    Atmosphere,
    BandAverage,
    SolvedAir,
    pressure_at,
    reflectance_above,
    surface_reflectance,
)
from skyscatter.dehaze.passband import Band
from skyscatter.errors import DomainError

BANDS = tuple(load_sensor("landsat-8").band(name) for name in ("B2", "B5"))  # blue, 60 nm wide; near infrared, 28 nm


@lru_cache(maxsize=8)
def solved(aerosol: str = "none", aod: float = 0.0, pressure: float = 1013.25, high: float = 45.0) -> SolvedAir:
    air = Atmosphere(aerosol=aerosol, pressure_hpa=pressure)
    return SolvedAir(air, aod, BandAverage(BANDS), (40.0, high), stokes=False)


def test_the_inverse_returns_the_surface() -> None:
    terms = solved("urban", 0.3).terms(42.0, 20.0, 60.0)
    rho = np.linspace(-0.02, 1.0, 52)[:, None]
    np.testing.assert_allclose(surface_reflectance(terms, reflectance_above(terms, rho)), np.tile(rho, 2), atol=1e-12)
    around = rho[::-1]
    above = reflectance_above(terms, rho, around)
    np.testing.assert_allclose(surface_reflectance(terms, above, around), np.tile(rho, 2), atol=1e-12)
    # Bright surroundings brighten a dark pixel, and the two forms agree where both are the same.
    assert np.all(reflectance_above(terms, 0.0, 0.5) > reflectance_above(terms, 0.0) + 0.01)
    np.testing.assert_allclose(reflectance_above(terms, rho, rho), reflectance_above(terms, rho), atol=1e-15)


def test_averages_are_exact_for_polynomials() -> None:
    """Two wavelengths carry cubics, one carries straight lines; both against the band's samples."""
    average = BandAverage(BANDS)
    assert average.wavelengths.size == 3
    for row, band, degree in zip(average.weights, BANDS, (3, 1), strict=True):
        wl, shares = band.samples()
        for k in range(degree + 1):
            x, nodes = (wl / 500.0) ** k, (average.wavelengths / 500.0) ** k
            assert row @ nodes == pytest.approx(shares @ x, rel=1e-12)
    too_high = (average.wavelengths / 500.0) ** 6
    wl, shares = BANDS[0].samples()
    assert average.weights[0] @ too_high != pytest.approx(shares @ (wl / 500.0) ** 6, rel=1e-6)


def test_bands_share_wavelengths() -> None:
    twice = BandAverage((BANDS[1], BANDS[1]))
    assert twice.wavelengths.size == 1
    np.testing.assert_array_equal(twice.weights, [[1.0], [1.0]])


def test_averages_are_those_of_the_light() -> None:
    """Averaged terms give the average of the reflectance, up to how S varies across the band."""
    air = solved("urban", 0.3)
    single, mean = air.monochromatic(42.0, 20.0, 60.0), air.terms(42.0, 20.0, 60.0)
    assert single.shape == (3, 4)
    assert mean.shape == (2, 4)
    weights = air.average.weights
    light = weights * (single[:, DIRECT] + single[:, DIFFUSE])
    scatter = (light * (single[None, :, BACK] - mean[:, None, BACK]) ** 2).sum(axis=1)
    for rho in (0.0, 0.1, 0.6):
        off = weights @ reflectance_above(single, rho) - reflectance_above(mean, rho)
        # Two terms of the geometric series are exact; the third misses the variance of S over the light, those beyond
        # it add less than half of that.
        assert np.all(off > -1e-14)
        assert np.all(off < 1.5 * rho**3 * scatter + 1e-14)


def test_a_band_in_the_mean_of_many_wavelengths() -> None:
    """What two nodes are worth for a broad blue band, against twelve: Rayleigh's law and all orders."""
    blue = BANDS[0]
    at = (42.0, 20.0, 60.0)

    class Fine(BandAverage):
        def __init__(self, band: Band) -> None:
            self.wavelengths, weights = band.nodes(12)
            self.weights = weights[None]

    fine = SolvedAir(Atmosphere(aerosol="none"), 0.0, Fine(blue), (40.0, 45.0), stokes=False).terms(*at)
    np.testing.assert_allclose(solved().terms(*at)[:1], fine, rtol=1e-3, atol=1e-5)


def test_no_haze_is_no_aerosol() -> None:
    at = (42.0, np.array([0.0, 50.0]), 130.0)
    np.testing.assert_array_equal(solved("urban", 0.0).terms(*at), solved().terms(*at))


def test_the_azimuth_has_no_side() -> None:
    azimuths = np.array([30.0, 120.0])
    one, other = (solved("urban", 0.3).terms(42.0, 35.0, a) for a in (azimuths, -azimuths))
    np.testing.assert_allclose(one, other, rtol=1e-9)
    back, forward = solved("urban", 0.3).terms(42.0, 42.0, np.array([0.0, 180.0]))[..., PATH]
    assert np.all(back != pytest.approx(forward, rel=0.05))  # but it does have a front and a back


def test_pressure_scales_the_air() -> None:
    """Half the air: half its light where it is thin, less than half taken from the beam where it is not."""
    at = (42.0, 20.0, 60.0)
    whole, half = solved().terms(*at), solved(pressure=0.5 * 1013.25).terms(*at)
    # Optical depth 0.016 in the near infrared: what is not in proportion is of its order times the air mass.
    assert half[1, PATH] / whole[1, PATH] == pytest.approx(0.5, abs=0.01)
    assert 0.5 < half[0, PATH] / whole[0, PATH] < 0.58
    # T_down t_dir: the direct part of the way up is a power of the pressure.
    assert np.all(half[:, DIRECT] > whole[:, DIRECT])
    assert np.all(half[:, [DIFFUSE, BACK]] < whole[:, [DIFFUSE, BACK]])


@pytest.mark.parametrize(("height", "pressure"), [(0.0, 1013.25), (1000.0, 898.76), (5000.0, 540.48), (10000.0, 265.0)])
def test_pressure_of_the_standard_atmosphere(height: float, pressure: float) -> None:
    """Table I of the US Standard Atmosphere 1976."""
    assert pressure_at(height) == pytest.approx(pressure, rel=1e-4)


def test_the_sun_at_85_degrees() -> None:
    """Low Sun and oblique view, where a flat Earth would have an air mass of 11.5: all terms stay physical."""
    terms = solved(high=85.0).terms(np.array([40.0, 85.0])[:, None], np.array([0.0, 85.0]), 90.0)
    assert np.all(np.isfinite(terms))
    assert np.all((terms > 0) & (terms < 1.0) | (np.arange(4) == PATH))
    # Air that is thick both ways, lit and seen at a cosine m: 3/4 / (8 m) by the first order, and what others add.
    single = 0.75 / (8 * np.cos(np.radians(85.0)))
    assert 0.7 * single < terms[1, 1, 0, PATH] < 1.5 * single
    assert np.all((terms[..., DIRECT] + terms[..., DIFFUSE])[1] < (terms[..., DIRECT] + terms[..., DIFFUSE])[0])
    # At one wavelength the ground's light has the same way up under every Sun: T_down is in both parts alike.
    share = (terms[..., DIRECT] / terms[..., DIFFUSE])[..., 1]
    np.testing.assert_allclose(share[0], share[1], rtol=1e-9)


@pytest.mark.parametrize("pressure", [0.0, 2000.0])
def test_pressures_out_of_range(pressure: float) -> None:
    with pytest.raises(ValueError, match=rf"pressure = {pressure}.*between 50 and 1200"):
        Atmosphere(pressure_hpa=pressure)


def test_heights_out_of_range() -> None:
    with pytest.raises(DomainError, match="ground_height = 20000"):
        pressure_at(20000)


def test_unknown_aerosols() -> None:
    with pytest.raises(ValueError, match=r"aerosol = 'urbane'.*urban"):
        Atmosphere(aerosol="urbane")


def test_suns_that_were_not_solved() -> None:
    with pytest.raises(DomainError, match="sun_elevation_deg"):
        solved().terms(70.0, 0.0, 0.0)
