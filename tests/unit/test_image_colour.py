"""Spectrum to XYZ to RGB to colour temperature, with colour-science as the judge."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest

from skyscatter.datafiles import data_path
from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage
from skyscatter.image.colour import (
    SPACES,
    cct,
    colour_space,
    display_space,
    dominant_wavelength,
    luminance_weights,
    observer,
    rgb_to_xyz_matrix,
    spectrum_to_xyz,
    xyz_to_rgb,
    xyz_to_rgb_matrix,
    xyz_weights,
)

NAMES = {"srgb": "sRGB", "display-p3": "Display P3", "rec2020": "ITU-R BT.2020", "acescg": "ACEScg"}
C2 = 1.438776877e7  # [nm K]


@pytest.fixture(scope="module")
def judge() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colour-science remarks on optional packages
        import colour
    return colour


def planck(wavelengths: np.ndarray, temperature: float) -> np.ndarray:
    return 1e15 / (wavelengths**5 * np.expm1(C2 / (wavelengths * temperature)))


def judged_xyz(judge: Any, wavelengths: np.ndarray, values: np.ndarray) -> np.ndarray:
    sd = judge.SpectralDistribution(dict(zip(wavelengths, values, strict=True)))
    cmfs = judge.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it says that it aligns the shapes
        return np.asarray(judge.sd_to_XYZ(sd, cmfs, k=683, method="Integration"))


def test_shipped_observer_is_the_one_of_colour_science(judge: Any) -> None:
    wavelengths, functions = observer()
    cmfs = judge.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    np.testing.assert_array_equal(wavelengths, cmfs.wavelengths)
    np.testing.assert_array_equal(functions, cmfs.values)  # the table has every digit
    assert data_path("cie1931.md").is_file()


@pytest.mark.parametrize("temperature", [1500.0, 2856.0, 6500.0, 20000.0])
def test_black_bodies_at_1_nm(judge: Any, temperature: float) -> None:
    wavelengths = np.arange(360.0, 831.0)
    values = planck(wavelengths, temperature)
    # 2e-4: it sums at 1 nm where this integrates the product of two linear pieces.  They differ by f' g' / (6 f g) per
    # step, at most 0.03 x 0.04 / 6 per nm2 for 1500 K in the blue; the hotter bodies differ less.
    np.testing.assert_allclose(spectrum_to_xyz(values, wavelengths), judged_xyz(judge, wavelengths, values), rtol=2e-4)


def test_daylight_at_5_nm(judge: Any) -> None:
    sd = judge.SDS_ILLUMINANTS["D65"]
    inside = (sd.wavelengths >= 360) & (sd.wavelengths <= 830)
    wavelengths, values = sd.wavelengths[inside], sd.values[inside]
    # D65 is defined as linear between its entries (the judge would take a higher order), so it is given every 1 nm.
    fine = np.arange(360.0, 831.0)
    theirs = judged_xyz(judge, fine, np.interp(fine, wavelengths, values))
    # 3e-5: a sum at 1 nm against the integral of linear pieces
    np.testing.assert_allclose(spectrum_to_xyz(values, wavelengths), theirs, rtol=3e-5)
    x, y, z = spectrum_to_xyz(values, wavelengths)
    # CIE 015:2018, table T.3: x, y of D65 to five digits; the interpolation moves the last one.
    assert x / (x + y + z) == pytest.approx(0.31272, abs=2e-5)
    assert y / (x + y + z) == pytest.approx(0.32903, abs=2e-5)


@pytest.mark.parametrize(
    ("wavelengths", "tolerance"),
    [
        (np.linspace(380, 780, 81), 4e-4),  # leaves out 360-377.5 and 782.5-830 nm: 3e-4 of z and less of x, y
        (np.linspace(380, 780, 32), 6e-4),
        (np.array([380, 390, 405, 430, 450, 480, 500, 540, 560, 600, 610, 650, 700, 780.0]), 4e-3),  # uneven
        (np.array([450.0, 550.0, 650.0]), 1e-2),  # ends at 400 and 700 nm
    ],
)
def test_flat_spectrum_has_the_colour_of_flat_light_on_any_grid(wavelengths: np.ndarray, tolerance: float) -> None:
    nodes, functions = observer()
    exact = 683.0 * np.trapezoid(functions, nodes, axis=0)
    np.testing.assert_allclose(xyz_weights(wavelengths).sum(axis=0), exact, rtol=tolerance)


def test_weights_are_the_integral_of_the_interpolated_spectrum() -> None:
    rng = np.random.default_rng(5)
    wavelengths = np.sort(rng.uniform(370.0, 800.0, 17))
    values = rng.random(17)
    nodes, functions = observer()
    fine = np.linspace(360.0, 830.0, 470 * 400 + 1)
    low = wavelengths[0] - 0.5 * (wavelengths[1] - wavelengths[0])
    high = wavelengths[-1] + 0.5 * (wavelengths[-1] - wavelengths[-2])
    spectrum = np.where((fine >= low) & (fine <= high), np.interp(fine, wavelengths, values), 0.0)
    for c in range(3):
        brute = 683.0 * np.trapezoid(spectrum * np.interp(fine, nodes, functions[:, c]), fine)
        # 1e-4: the brute sum has steps of 0.0025 nm and meets a jump of the spectrum at either end.
        assert spectrum_to_xyz(values, wavelengths)[c] == pytest.approx(brute, rel=1e-4)


def test_light_that_nobody_sees_is_dark() -> None:
    assert np.all(xyz_weights([900.0, 950.0, 1000.0]) == 0.0)
    assert np.all(xyz_weights([250.0, 300.0]) == 0.0)


def test_one_wavelength_is_a_grey_picture() -> None:
    image = SpectralImage(np.full((1, 2, 1), 0.01), [550.0])
    rgb = image.rgb()
    # rounding only: the white of the picture is the white of the space
    np.testing.assert_allclose(rgb, rgb[..., :1] * np.ones(3), rtol=1e-12)
    # 683 lm/W times the observer's integral, 106.857 nm (CIE 015:2018), to its printed digits
    assert image.luminance()[0, 0] == pytest.approx(0.01 * 683 * 106.857, rel=1e-5)


@pytest.mark.parametrize("name", list(SPACES))
def test_matrices_of_the_spaces(judge: Any, name: str) -> None:
    theirs = judge.RGB_COLOURSPACES[NAMES[name]]
    derived = judge.normalised_primary_matrix(theirs.primaries, theirs.whitepoint)
    np.testing.assert_allclose(rgb_to_xyz_matrix(SPACES[name]), derived, atol=1e-12)  # rounding
    # 1e-4: published matrices (sRGB) are rounded to four decimals
    np.testing.assert_allclose(rgb_to_xyz_matrix(SPACES[name]), theirs.matrix_RGB_to_XYZ, atol=1e-4)


@pytest.mark.parametrize("name", list(SPACES))
def test_xyz_to_rgb(judge: Any, name: str) -> None:
    xyz = np.array([[0.3, 0.4, 0.9], [0.9504, 1.0, 1.0888], [0.5, 0.3, 0.01]])
    d65 = judge.RGB_COLOURSPACES["sRGB"].whitepoint
    transform = "Bradford" if name == "acescg" else None
    theirs = judge.XYZ_to_RGB(xyz, NAMES[name], illuminant=d65, chromatic_adaptation_transform=transform)
    # 5e-4: the same rounded published matrices, inverted, times values near 1
    np.testing.assert_allclose(xyz_to_rgb(xyz, name), theirs, atol=5e-4)


@pytest.mark.parametrize("name", list(SPACES))
def test_daylight_grey_is_neutral_and_keeps_its_luminance(name: str) -> None:
    white = np.array([0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290])
    np.testing.assert_allclose(xyz_to_rgb(5.0 * white, name), 5.0, rtol=1e-12)  # rounding
    assert luminance_weights(SPACES[name]).sum() == pytest.approx(1.0, abs=1e-12)  # rounding
    matrix = xyz_to_rgb_matrix(SPACES[name])
    back = np.linalg.solve(matrix, [0.2, 0.5, 0.7])
    assert luminance_weights(SPACES[name]) @ [0.2, 0.5, 0.7] == pytest.approx(back[1], rel=1e-12)  # rounding


@pytest.mark.parametrize("temperature", [1200.0, 2856.0, 5000.0, 10000.0, 40000.0])
def test_colour_temperature_of_black_bodies(temperature: float) -> None:
    nodes, functions = observer()
    # 1e-4: isotherms stand 1e-6 K-1 apart and are interpolated
    assert cct(planck(nodes, temperature) @ functions) == pytest.approx(temperature, rel=1e-4)


def test_colour_temperature_away_from_the_locus(judge: Any) -> None:
    xy = np.array([[0.3127, 0.3290], [0.30, 0.33], [0.4476, 0.4074], [0.35, 0.33], [0.27, 0.28]])
    xyz = np.column_stack([xy[:, 0] / xy[:, 1], np.ones(5), (1 - xy.sum(axis=1)) / xy[:, 1]])
    theirs = [judge.temperature.uv_to_CCT(judge.UCS_to_uv(judge.XYZ_to_UCS(v)), method="Ohno 2013")[0] for v in xyz]
    # 1e-3: Ohno's own method is good to about 1 K near the locus and a few K at the distances tried here
    np.testing.assert_allclose(cct(xyz), theirs, rtol=1e-3)


def test_colour_temperature_where_there_is_none() -> None:
    nodes, functions = observer()
    bluer = nodes**-6.0 @ functions
    green = np.array([0.2, 0.9, 0.1])
    values = cct([[bluer, green], [np.zeros(3), np.full(3, np.nan)]])
    assert values.shape == (2, 2)
    assert values[0, 0] == np.inf
    assert np.isnan([values[0, 1], *values[1]]).all()
    assert np.isnan(cct(planck(nodes, 900.0) @ functions))


def test_unknown_space_names_the_four() -> None:
    with pytest.raises(DomainError, match="srgb, display-p3, rec2020, acescg"):
        colour_space("adobe")


def test_the_package_does_not_load_colour_science() -> None:
    import subprocess

    code = (
        "import sys, numpy as np; from skyscatter.image import SpectralImage as S; "
        "S(np.ones((2, 2, 3)), [450, 550, 650]).picture(); "
        "print([m for m in ('colour', 'astropy', 'matplotlib', 'xarray', 'OpenEXR', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_dominant_wavelength(judge: Any) -> None:
    """Of colours all over the diagram, purples among them; colour-science takes the nearest whole nanometre."""
    colours = np.random.default_rng(1).random((200, 3)) + 0.02
    white = np.array([0.3127, 0.3290])
    expected = [float(judge.dominant_wavelength(xyz[:2] / xyz.sum(), white)[0]) for xyz in colours]
    np.testing.assert_allclose(dominant_wavelength(colours), expected, atol=1.01)
    assert min(expected) < -500 < 450 < max(expected)  # purples and others
    grey = [[0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290], [0.0, 0.0, 0.0], [np.nan, 1.0, 1.0]]
    assert np.isnan(dominant_wavelength(grey)).all()


def test_any_space_of_colour_science(judge: Any) -> None:
    """Matrices agree with theirs, with the white adapted as ours are; and grey stays grey."""
    for name, space in judge.RGB_COLOURSPACES.items():
        ours = colour_space(name)
        xyz = np.random.default_rng(2).random((5, 3))
        transform = None if np.allclose(space.whitepoint, (0.3127, 0.3290), atol=1e-4) else "Bradford"
        theirs = judge.XYZ_to_RGB(xyz, space, (0.3127, 0.3290), transform)
        # Some of theirs hold matrices of the four or five digits that a standard prints.
        np.testing.assert_allclose(xyz_to_rgb(xyz, ours.name), theirs, atol=2e-3)
    with pytest.raises(DomainError, match="did you mean prophoto-rgb"):
        colour_space("pro photo rgb")
    with pytest.raises(DomainError, match="scene-linear only"):
        display_space("aces2065-1")


def test_spectra_and_colours_of_an_image(judge: Any) -> None:
    wavelengths = np.arange(400.0, 701.0, 20.0)
    image = SpectralImage(np.random.default_rng(3).random((2, 3, 16)), wavelengths)
    spectra = image.to_colour()
    assert isinstance(spectra, judge.MultiSpectralDistributions)
    np.testing.assert_array_equal(spectra.signals["1,2"].values, image.radiance[1, 2])
    np.testing.assert_array_equal(spectra.wavelengths, wavelengths)
    found = image.mean_colour()
    mean = image.xyz().mean(axis=(0, 1))
    assert found is not None
    assert found["chromaticity"] == pytest.approx((mean[:2] / mean.sum()).tolist(), abs=1e-4)
    assert found["temperature_K"] == pytest.approx(float(cct(mean)), abs=1)
    assert SpectralImage(np.ones((1, 1, 1)), [550]).mean_colour() is None
    assert SpectralImage(np.zeros((1, 1, 3)), [450, 550, 650]).mean_colour() is None


def test_loading_colour_science_leaves_the_program_as_it_was() -> None:
    """Alone it makes numpy print arrays in the manner of 1.13, everywhere."""
    load = "from skyscatter.spectra.library import colour_science; colour_science()"
    code = f"import numpy as np; {load}; print(np.ones(2))"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[1. 1.]\n", "")
