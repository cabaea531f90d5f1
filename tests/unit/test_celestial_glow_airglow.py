"""Airglow: van Rhijn's law and its other sides, lines that keep their light on any grid, strengths against others'."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from skyscatter.celestial.airglow import (
    RAYLEIGH,
    airglow_layers,
    airglow_paths,
    airglow_radiance,
    airglow_spectra,
    photon_radiance,
)
from skyscatter.celestial.zodiacal import S10_MAGNITUDE
from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError
from skyscatter.image.filters import filter_curve
from skyscatter.image.photometry import VEGA_ZERO
from skyscatter.spectra.cells import cell_edges

EARTH = 6371e3
ARCSEC2 = (np.pi / 648000.0) ** 2
GREEN, RED = 6, 7  # layers
WIDE = np.arange(300.0, 951.0, 1.0)


def s10(radiance):
    """Brightness in V in stars of tenth magnitude per square degree."""
    weights, _ = filter_curve("V").weights(WIDE)
    magnitude = -2.5 * np.log10(radiance @ weights * ARCSEC2 / VEGA_ZERO["V"])
    return 10 ** (0.4 * (S10_MAGNITUDE - magnitude))


def test_rayleigh() -> None:
    assert pytest.approx(7.957747e8, rel=1e-6) == RAYLEIGH
    # Baker & Romick (1976, Appl. Opt. 15, 1966): 1 R = 1.58e-11 / wavelength[nm] W cm-2 sr-1, three digits.
    assert photon_radiance([400.0, 557.9]) == pytest.approx(1.58e-7 / np.array([400.0, 557.9]), rel=1e-3)


def test_van_rhijn_from_the_ground() -> None:
    """The secant of the angle at which the line of sight meets the layer, which the law of sines gives."""
    zenith = np.radians(np.array([0.0, 10.0, 45.0, 70.0, 85.0, 89.9, 90.0]))
    paths = airglow_paths(np.cos(zenith))
    for k, height in enumerate(airglow_layers().height_m):
        secant = 1.0 / np.cos(np.arcsin(EARTH / (EARTH + height) * np.sin(zenith)))
        # The same in other words: rounding, magnified near the horizon by some ten.
        assert paths[:, k] == pytest.approx(secant, rel=1e-12)
    assert np.all(np.diff(paths, axis=0) > 0)
    assert paths[-1, GREEN] > paths[-1, RED]  # low layers brighten more
    mars = airglow_paths(0.2, 0.0, 3390e3)[GREEN]
    assert mars == pytest.approx(1 / np.sqrt(1 - (3390 / 3487) ** 2 * 0.96), rel=1e-12)


def test_the_ground_hides_what_is_below() -> None:
    assert np.all(airglow_paths([-1.0, -0.5, -1e-6]) == 0.0)
    # From 10 km the horizon is lower by acos(R / (R + h)); above it the layer is seen beyond the horizon.
    dip = np.arccos(EARTH / (EARTH + 10e3))
    seen = airglow_paths(np.sin([-0.99 * dip, -1.01 * dip]), 10e3)
    assert np.all(seen[0] > 3.0)
    assert np.all(seen[1] == 0.0)


def light_by_steps(sine, altitude, height, thickness):
    """What a line of sight has of a layer, by going along it in steps of 20 m until it meets the ground."""
    step, radius, deviation = 20.0, EARTH + altitude, thickness / 2.3548
    distance = np.arange(0.5, 3e5) * step
    centre = np.sqrt(radius**2 + distance**2 + 2 * radius * distance * sine)
    free = np.cumsum(centre < EARTH) == 0
    profile = np.exp(-0.5 * ((centre - EARTH - height) / deviation) ** 2) / (np.sqrt(2 * np.pi) * deviation)
    return step * np.sum(free * profile)


@pytest.mark.parametrize("altitude", [96e3, 100e3, 400e3])
@pytest.mark.parametrize("down", [-1.0, -0.5, -0.32, -0.29, -0.17, -0.02, 0.0, 0.02, 0.3, 1.0])
def test_from_within_and_above(altitude, down) -> None:
    """The limb, the layer before the ground and beyond it, and what an observer in the layer sees."""
    layers = airglow_layers()
    ours = airglow_paths(down, altitude)
    for k in (GREEN, 3):
        height, thickness = layers.height_m[k], layers.thickness_m[k]
        if altitude > height - 0.5 * thickness:
            # The steps of 20 m, less than a hundredth of the profile, begin and end somewhere.
            assert ours[k] == pytest.approx(light_by_steps(down, altitude, height, thickness), rel=1e-3, abs=2e-3)


def test_above_the_layer() -> None:
    assert np.all(airglow_paths([0.0, 0.5, 1.0], 400e3)[:, :7] == 0.0)
    # Straight down: the layer once, the ground behind it; of the red one a thousandth lies above.
    ours, above = airglow_paths(-1.0, 400e3), norm.sf(150.0 / (120.0 / 2.3548))
    assert ours == pytest.approx(np.append(np.ones(7), 1.0 - above), abs=1e-5)
    # Just above the ground's edge the layer is seen twice: before and behind, each with van Rhijn's factor at the
    # ground's edge.  The layer's width of 8.6 km changes that by 1e-3 or so.
    edge = -np.sqrt(1 - ((EARTH + 1.0) / (EARTH + 400e3)) ** 2)
    assert airglow_paths(edge, 400e3)[GREEN] == pytest.approx(2 * airglow_paths(0.0)[GREEN], rel=3e-3)
    # The brightest limb of a normal curve of deviation d: sqrt(2 r / d) max_x int t^-1/2 phi(x + t) dt, both halves.
    sines = -np.sqrt(1 - ((EARTH + np.linspace(60e3, 110e3, 2001)) / (EARTH + 400e3)) ** 2)
    limb = airglow_paths(sines, 400e3)[:, GREEN]
    most = max(quad(lambda u, x=x: 2 * norm.pdf(x + u * u), 0, 4)[0] for x in np.linspace(-1.5, 0.0, 61))
    assert limb.max() == pytest.approx(np.sqrt(2 * (EARTH + 97e3) / (8.6e3 / 2.3548)) * most, rel=0.01)
    # And it begins smoothly: no step of 100 m changes it by more than a twentieth of the brightest.
    fine = -np.sqrt(1 - ((EARTH + np.arange(85e3, 115e3, 100.0)) / (EARTH + 400e3)) ** 2)
    assert np.abs(np.diff(airglow_paths(fine, 400e3)[:, GREEN])).max() < limb.max() / 20


def test_nothing_jumps_as_an_observer_rises() -> None:
    """Through all layers in steps of 200 m, which change no line of sight by more than what of a layer comes to lie
    below the observer."""
    step, thickness = 200.0, 8.6e3
    altitudes = np.concatenate([np.arange(60e3, 110e3, step), np.arange(180e3, 320e3, step)])
    paths = np.stack([airglow_paths([-0.05, 0.3, 1.0], altitude) for altitude in altitudes])
    steps = np.abs(np.diff(paths, axis=0))[np.diff(altitudes) == step]
    assert steps[:, 1:].max() < 1.2 * step / thickness / 0.3
    assert steps[:, 0].max() < 1.2 * 2 * np.sqrt(2 * 6.5e6 * step) / thickness  # a whole chord of such a depth
    # Horizontally, below half of the layer: its profile from inside, not a thin shell (7.4 for the red one).
    bottom = [airglow_paths(0.0, altitude)[RED] for altitude in (190e3 - 1.0, 190e3 + 1.0)]
    assert bottom == pytest.approx([light_by_steps(0.0, 190e3, 250e3, 120e3)] * 2, rel=0.01)


GRIDS = {
    "fine": np.arange(500.0, 700.0, 0.25),
    "coarse": np.linspace(450.0, 750.0, 7),
    "three": np.array([450.0, 550.0, 650.0]),
    "downwards": np.linspace(700.0, 500.0, 41),
    "uneven": np.unique(np.random.default_rng(3).uniform(480.0, 720.0, 60)),
}


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_lines_keep_their_light_on_any_grid(grid) -> None:
    low, high = cell_edges(grid)
    lines = read_table("airglow_lines.csv")
    spectra = airglow_spectra(grid) * (high - low)
    for layer in (3, GREEN, RED):
        inside = (
            (lines["class"] == layer + 1) & (lines["wavelength_nm"] > low.min()) & (lines["wavelength_nm"] < high.max())
        )
        light = np.sum((lines["rayleigh"] * photon_radiance(lines["wavelength_nm"]))[inside])
        assert spectra[layer].sum() == pytest.approx(light, rel=1e-12)
    # Continua: exact integrals between the outer edges of the grid.
    nodes = np.union1d(np.arange(300.0, 1001.0, 5.0), [low.min(), high.max()])
    nodes = nodes[(nodes >= low.min()) & (nodes <= high.max())]
    table = read_table("airglow_continuum.csv")
    feo = np.interp(nodes, table["wavelength_nm"], table["feo"] * photon_radiance(table["wavelength_nm"]))
    assert spectra[2].sum() == pytest.approx(np.trapezoid(feo, nodes), rel=1e-12)


def test_a_line_is_in_the_cell_that_holds_it() -> None:
    wl = np.array([570.0, 550.0, 560.0, 540.0])
    green = airglow_spectra(wl)[GREEN]
    assert np.flatnonzero(green).tolist() == [2]
    assert green[2] == pytest.approx(163.0 * photon_radiance(557.889) / 10.0, rel=1e-12)
    assert airglow_spectra([557.6])[GREEN, 0] == pytest.approx(163.0 * photon_radiance(557.889), rel=1e-12)
    assert airglow_spectra([557.0])[GREEN, 0] == 0.0


def test_solar_activity() -> None:
    quiet, mean, active = (airglow_spectra(WIDE, flux).sum(axis=1) for flux in (70.0, 100.0, 170.0))
    assert active / mean == pytest.approx(1 + 70 * airglow_layers().solar_slope, rel=1e-12)
    assert (quiet / mean)[GREEN] == pytest.approx(1 - 30 * 0.00754)
    assert np.argmax(active / mean) == RED


def test_brightness_in_v() -> None:
    """Leinert et al. (1998) give 145 S10 for the airglow of a dark zenith (from memory); ours come from a site and
    years of their own, and such means vary by more than the 10 % allowed here."""
    assert s10(airglow_radiance(1.0, WIDE)) == pytest.approx(145.0, rel=0.1)


def test_hydroxyl_against_photometers() -> None:
    """What photometers in many places report: (8-3) 300 to 500 R, (6-2) 1 to 2 kR (from memory); and the order of the
    bands.  Windows hold the whole of one band and little of others."""
    lines = read_table("airglow_lines.csv")
    bands = {(8, 3): (724, 747), (6, 2): (828, 862), (9, 4): (771, 789), (7, 2): (683, 704)}
    hydroxyl = lines["class"] == 2
    sums = {
        band: lines["rayleigh"][hydroxyl & (lines["wavelength_nm"] > low) & (lines["wavelength_nm"] < high)].sum()
        for band, (low, high) in bands.items()
    }
    assert 300 < sums[8, 3] < 500
    assert 1000 < sums[6, 2] < 2000
    assert sums[7, 2] < sums[8, 3] < sums[9, 4] < sums[6, 2]
    # Strong lines of (8-3) where atlases have them (Osterbrock et al. 1996, from memory): Q1 at 727.6, P1(3) at 734.1
    # nm in air; the splitting by spin, which is left out, is worth 0.5 nm.
    near = lines["wavelength_nm"][hydroxyl & (lines["rayleigh"] > 20)]
    for air in (727.6, 734.1):
        assert np.abs(near - air * 1.000276).min() < 0.6


def test_shapes_and_missing_directions() -> None:
    sine = np.array([[1.0, 0.5, np.nan], [0.1, -0.1, 0.0]])
    light = airglow_radiance(sine, [500.0, 600.0])
    assert light.shape == (2, 3, 2)
    assert np.isnan(light[0, 2]).all()
    assert np.isfinite(np.delete(light.reshape(6, 2), 2, axis=0)).all()
    assert np.isnan(airglow_paths([np.nan], 200e3)).all()
    assert airglow_radiance(1.0 + 1e-14, [500.0]).shape == (1,)


def test_bad_input_is_named() -> None:
    for sine in (1.1, -2.0):
        with pytest.raises(DomainError, match="sine_elevation"):
            airglow_paths(sine)
    with pytest.raises(DomainError, match="observer_altitude_m"):
        airglow_paths(1.0, -1.0)
    with pytest.raises(DomainError, match="planet_radius_m"):
        airglow_paths(1.0, 0.0, 0.0)
    with pytest.raises(DomainError, match="solar_flux"):
        airglow_spectra([500.0], 1000.0)
    for wl in ([290.0], [500.0, 1100.0], []):
        with pytest.raises(DomainError, match="300 to 1000"):
            airglow_spectra(wl)
    with pytest.raises(DomainError, match="twice"):
        airglow_spectra([500.0, 500.0])
