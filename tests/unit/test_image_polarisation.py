"""Degree and angle of polarisation, their files, pictures and figures, on skies known in closed form."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from rayleigh_sky import SUN, WAVELENGTHS, expected_degree, rayleigh_sky

from skyscatter.errors import DomainError
from skyscatter.geometry.camera import Fisheye, Panorama, Perspective, PlanetView
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image import SpectralImage
from skyscatter.image.colour import xyz_weights
from skyscatter.image.png import read_png
from skyscatter.image.polarisation import FRAME, band, band_angle, band_degree

LAYERS = ["Q", "U", "V", "Q_error", "U_error", "V_error"]
PANORAMA = Panorama(width=24, height=12)
UP = (0.0, 0.0, 1.0)  # where the observer stands
FISHEYE = Fisheye(width=21, height=21)


def single(i: float, q: float, u: float, v: float = 0.0) -> SpectralImage:
    """One pixel, one wavelength."""
    layers = {name: np.full((1, 1, 1), value) for name, value in zip("QUV", (q, u, v), strict=True)}
    return SpectralImage(np.full((1, 1, 1), i), [550.0], layers=layers)


@pytest.mark.parametrize("chi", [0.0, 22.5, 45.0, 67.5, 90.0, 112.5, 135.0, 179.0])
def test_degree_and_angle_of_one_pixel(chi: float) -> None:
    """Q = P I cos 2 chi, U = P I sin 2 chi."""
    made = single(4.0, 2.0 * np.cos(np.radians(2 * chi)), 2.0 * np.sin(np.radians(2 * chi)), 1.5)
    # 1e-12: rounding; at 0 a rounding error below zero would be 180
    assert made.degree_of_linear_polarisation[0, 0, 0] == pytest.approx(0.5, rel=1e-12)
    assert made.degree_of_polarisation[0, 0, 0] == pytest.approx(0.625, rel=1e-12)
    assert made.angle_of_linear_polarisation[0, 0, 0] == pytest.approx(chi, rel=1e-12, abs=1e-12)


def test_the_angle_never_reaches_180() -> None:
    assert single(1.0, 1.0, -1e-300).angle_of_linear_polarisation[0, 0, 0] == 0.0


@pytest.mark.parametrize(("i", "q", "u"), [(0.0, 0.0, 0.0), (np.nan, np.nan, np.nan), (-1.0, 0.5, 0.5)])
def test_without_light_nothing_is_defined(i: float, q: float, u: float) -> None:
    made = single(i, q, u)
    for values in (
        made.degree_of_linear_polarisation,
        made.degree_of_polarisation,
        made.angle_of_linear_polarisation,
        band_degree(made),
        band_angle(made),
    ):
        assert np.isnan(values).all()


def test_unpolarised_light_has_a_degree_but_no_angle() -> None:
    made = single(1.0, 0.0, 0.0)
    assert made.degree_of_linear_polarisation[0, 0, 0] == 0.0
    assert np.isnan(made.angle_of_linear_polarisation).all()


@pytest.mark.parametrize("name", ["degree_of_linear_polarisation", "degree_of_polarisation"])
def test_images_without_stokes_layers_say_so(name: str) -> None:
    plain = SpectralImage(np.ones((2, 2, 1)), [550.0], layers={"Q": np.ones((2, 2, 1)), "sky": np.ones((2, 2, 1))})
    assert not plain.polarised
    with pytest.raises(DomainError, match=r"layers = 'Q, sky': .*stokes=True") as caught:
        getattr(plain, name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("camera", [PANORAMA, FISHEYE, Perspective(width=9, height=7, azimuth_deg=120)])
def test_a_rayleigh_sky(camera: Any) -> None:
    made = rayleigh_sky(camera, circular=0.1)
    expected = expected_degree(camera.directions())
    seen = np.isfinite(expected)
    # rounding
    np.testing.assert_allclose(made.degree_of_linear_polarisation[seen, 1], expected[seen], rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(
        made.degree_of_polarisation[seen, 1], np.hypot(expected[seen], 0.1), rtol=1e-10, atol=1e-14
    )
    # The field vibrates across the plane of Sun and line of sight.
    v, left = meridian_frame(UP, camera.directions())
    chi = np.radians(made.angle_of_linear_polarisation[..., 1])
    field = np.cos(chi)[..., None] * v + np.sin(chi)[..., None] * left
    assert np.nanmax(np.abs(field @ SUN)) < 1e-10
    assert np.nanmax(np.abs(np.sum(field * camera.directions(), axis=-1))) < 1e-14
    assert np.isnan(made.degree_of_linear_polarisation[~seen]).all()


def test_the_meridian_frame() -> None:
    """Right-handed with the direction of flight, upwards and to the left; north at zenith and nadir."""
    d = direction_from_azimuth_elevation([0.0, 90.0, 33.0, 200.0], [0.0, 0.0, 50.0, -70.0])
    v, left = meridian_frame(UP, d)
    np.testing.assert_allclose(v[:2], [[0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(left[:2], [[-1, 0, 0], [0, 1, 0]], atol=1e-15)  # north: west; east: north
    np.testing.assert_allclose(np.cross(v, left), -d, atol=1e-15)
    assert np.all(v[:, 2] > 0)
    np.testing.assert_allclose(left[:, 2], 0, atol=1e-15)
    np.testing.assert_array_equal(meridian_frame(UP, [0.0, 0.0, 1.0]), [[0, 1, 0], [1, 0, 0]])
    np.testing.assert_array_equal(meridian_frame(UP, [0.0, 0.0, -1.0]), [[0, 1, 0], [-1, 0, 0]])
    assert np.isnan(meridian_frame(UP, [np.nan, np.nan, np.nan])).all()


@pytest.mark.parametrize(
    ("azimuth", "elevation", "q", "u"),
    [(0, 60, -1, 0), (180, 90, -0.6, 0), (90, 0, 0.5, 0.8660), (270, 0, 0.5, -0.8660), (90, 30, 0.5294, 0.7059)],
)
def test_the_example_of_the_conventions(azimuth: float, elevation: float, q: float, u: float) -> None:
    """The table in docs/conventions.md, and its formulas for v and l."""
    a, e = np.radians([azimuth, elevation])
    d = direction_from_azimuth_elevation(azimuth, elevation)
    v, left = meridian_frame(UP, d)
    np.testing.assert_allclose(v, [-np.sin(e) * np.sin(a), -np.sin(e) * np.cos(a), np.cos(e)], atol=1e-15)
    np.testing.assert_allclose(left, [-np.cos(a), np.sin(a), 0], atol=1e-15)
    sun = direction_from_azimuth_elevation(180.0, 30.0)
    field = np.cross(d, sun)  # across the plane of scattering
    mu, ev, el = d @ sun, field @ v, field @ left
    # half of the last digit printed
    np.testing.assert_allclose([ev**2 - el**2, 2 * ev * el], np.array([q, u]) * (1 + mu**2), atol=5e-5 * (1 + mu**2))


def test_the_band_is_weighted_by_luminous_efficiency() -> None:
    made = rayleigh_sky(PANORAMA, share=(1.0, 0.5, 0.0))
    weights = xyz_weights(WAVELENGTHS)[:, 1] * [3.0, 2.0, 1.0]  # the sky's spectrum
    mean = weights @ [1.0, 0.5, 0.0] / weights.sum()
    expected = mean * expected_degree(PANORAMA.directions())
    np.testing.assert_allclose(band_degree(made), expected, rtol=1e-10)  # rounding
    np.testing.assert_allclose(band(made).i, made.luminance() / xyz_weights(WAVELENGTHS)[:, 1].sum(), rtol=1e-12)


def test_one_wavelength_on_request() -> None:
    made = rayleigh_sky(PANORAMA, share=(1.0, 0.5, 0.0))
    np.testing.assert_array_equal(band_degree(made, 550.0), made.degree_of_linear_polarisation[..., 1])
    np.testing.assert_array_equal(band_angle(made, 450.0), made.angle_of_linear_polarisation[..., 0])
    with pytest.raises(DomainError, match="3 wavelengths from 450 to 650 nm; the nearest is 550 nm"):
        band_degree(made, 560.0)


def test_invisible_light_has_no_band() -> None:
    layers = dict.fromkeys("QUV", np.full((1, 1, 2), 0.5))
    made = SpectralImage(np.ones((1, 1, 2)), [1000.0, 1100.0], layers=layers)
    with pytest.raises(DomainError, match="none is visible: name the one"):
        band_degree(made)
    assert band_degree(made, 1100.0)[0, 0] == pytest.approx(np.sqrt(0.5))


def test_dataset() -> None:
    made = rayleigh_sky(PANORAMA, circular=0.1)
    data = made.dataset
    for name in "QUV":
        variable = data[f"stokes_{name}"]
        assert variable.dims == ("y", "x", "wavelength")
        assert variable.attrs["units"] == "W m-2 sr-1 nm-1"
        assert variable.attrs["comment"] == FRAME
        assert data[variable.attrs["ancillary_variables"]].attrs["units"] == "W m-2 sr-1 nm-1"
        assert np.shares_memory(variable.values, made.layers[name])
    for name, unit in (
        ("degree_of_linear_polarisation", "1"),
        ("degree_of_polarisation", "1"),
        ("angle_of_linear_polarisation", "degree"),
    ):
        assert data[name].attrs["units"] == unit
        assert data[name].attrs["long_name"]
        np.testing.assert_array_equal(data[name].values, getattr(made, name))
    assert not [name for name in data if str(name).startswith("layer_")]


def test_layers_that_happen_to_be_named_so_stay_plain() -> None:
    plain = SpectralImage(np.ones((2, 2, 1)), [550.0], layers={"Q": np.ones((2, 2, 1))})
    assert set(plain.dataset) == {"radiance", "layer_Q"}


@pytest.mark.parametrize("extension", ["exr", "fits", "nc"])
@pytest.mark.parametrize("errors", [False, True])
@pytest.mark.parametrize("camera", [PANORAMA, FISHEYE])
def test_files_keep_the_stokes_layers(tmp_path: Path, extension: str, errors: bool, camera: Any) -> None:
    made = rayleigh_sky(camera, circular=-0.1)
    layers = {name: cube.astype(np.float32) for name, cube in made.layers.items() if errors or "error" not in name}
    layers["order-1"] = made.radiance.astype(np.float32)
    made = SpectralImage(made.radiance.astype(np.float32), WAVELENGTHS, layers=layers, recipe=made.recipe)
    made.save(tmp_path / f"sky.{extension}")
    back = SpectralImage.load(tmp_path / f"sky.{extension}")
    assert sorted(back.layers) == sorted(layers)
    for name, cube in layers.items():
        np.testing.assert_array_equal(back.layers[name], cube)
    assert back.recipe == made.recipe
    np.testing.assert_array_equal(back.angle_of_linear_polarisation, made.angle_of_linear_polarisation)
    assert back.layers["V"][camera.height // 2, camera.width // 2, 0] < 0


def test_exr_is_in_the_published_layout(tmp_path: Path) -> None:
    import OpenEXR

    made = rayleigh_sky(PANORAMA)
    made.save(tmp_path / "sky.exr")
    with OpenEXR.File(str(tmp_path / "sky.exr"), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert header["polarisationHandedness"] == "right"
    assert header["skyscatterStokesFrame"] == FRAME
    for number, name in enumerate("QUV", start=1):
        plane = channels[f"S{number}.550,000000nm"]
        np.testing.assert_array_equal(plane, made.layers[name][..., 1].astype(np.float32))
    assert not [name for name in channels if name.startswith("layer.Q.")]


def test_unpolarised_exr_says_nothing_of_handedness(tmp_path: Path) -> None:
    import OpenEXR

    SpectralImage(np.ones((2, 2, 1)), [550.0], layers={"Q": np.ones((2, 2, 1))}).save(tmp_path / "sky.exr")
    with OpenEXR.File(str(tmp_path / "sky.exr"), separate_channels=True) as file:
        assert "polarisationHandedness" not in file.header()
        assert "layer.Q.550,000000nm" in file.channels()
    assert list(SpectralImage.load(tmp_path / "sky.exr").layers) == ["Q"]


@pytest.mark.parametrize(("name", "value"), [("polarisationHandedness", "left"), ("skyscatterStokesFrame", None)])
def test_stokes_channels_in_another_frame_keep_their_names(tmp_path: Path, name: str, value: str | None) -> None:
    import OpenEXR

    rayleigh_sky(PANORAMA).save(tmp_path / "sky.exr")
    with OpenEXR.File(str(tmp_path / "sky.exr"), separate_channels=True) as file:
        header, channels = dict(file.header()), {key: channel.pixels for key, channel in file.channels().items()}
    header.pop(name)
    if value is not None:
        header[name] = value
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "other.exr"))
    back = SpectralImage.load(tmp_path / "other.exr")
    assert {"S1", "S2", "S3"} <= set(back.layers)
    assert not back.polarised


def test_exr_is_polarised_for_colour_science(tmp_path: Path) -> None:
    pytest.importorskip("OpenImageIO", reason="colour-science reads EXR through OpenImageIO, which is not installed")
    made = rayleigh_sky(PANORAMA, circular=0.1)
    made.save(tmp_path / "sky.exr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colour-science remarks on optional packages
        import colour

        components, specification = colour.read_spectral_image_Fichet2021(tmp_path / "sky.exr", additional_data=True)
    assert specification.is_polarised
    assert sorted(components) == ["S0", "S1", "S2", "S3"]
    for component, name in zip(("S1", "S2", "S3"), "QUV", strict=True):
        np.testing.assert_array_equal(components[component][1], made.layers[name].astype(np.float32))


def test_fits_extensions(tmp_path: Path) -> None:
    from astropy import units
    from astropy.io import fits

    made = rayleigh_sky(PANORAMA)
    made.save(tmp_path / "sky.fits")
    with fits.open(tmp_path / "sky.fits", checksum=True) as hdus:
        hdus.verify("exception")
        for name in "QUV":
            for hdu in (hdus[name], hdus[f"{name}_STDERR"]):
                header = hdu.header
                assert units.Unit(header["BUNIT"]) == units.Unit("W m-2 sr-1 nm-1")
                assert (header["STOKES"], header["POLCCONV"], header["POLFRAME"]) == (name, "IAU", "ZENITH")
                assert header["CTYPE3"] == "WAVE"
                words = " ".join(str(line) for line in header["COMMENT"])
                assert "meridian plane" in words
            # Row 1 of FITS is the bottom of the picture.
            np.testing.assert_array_equal(hdus[name].data[1, 0], made.layers[name][-1, :, 1])


def test_pictures(tmp_path: Path) -> None:
    made = rayleigh_sky(FISHEYE)
    inside = np.isfinite(expected_degree(FISHEYE.directions()))
    for show, values, name in (
        ("degree", made.degree_of_linear_polarisation[..., 2], "viridis"),
        ("angle", made.angle_of_linear_polarisation[..., 2] / 180, "twilight"),
    ):
        made.save(tmp_path / f"{show}.png", show=show, wavelength=650.0, bits=16)
        back = read_png(tmp_path / f"{show}.png")
        expected = matplotlib.colormaps[name](np.where(inside, values, 0.0))[..., :3]
        np.testing.assert_array_equal(back.pixels[inside, :3], np.rint(expected * 65535)[inside])
        np.testing.assert_array_equal(back.pixels[..., 3], np.where(inside, 65535, 0))
        np.testing.assert_array_equal(back.pixels[~inside, :3], 0)
        shown = json.loads(back.texts["skyscatter-picture"])
        assert (shown["show"], shown["wavelength_nm"], shown["colours"]) == (show, 650.0, name)
    made.save(tmp_path / "band.png", show="degree")
    assert json.loads(read_png(tmp_path / "band.png").texts["skyscatter-picture"])["wavelength_nm"] is None


def test_noise_beyond_one_is_shown_as_one(tmp_path: Path) -> None:
    single(1.0, 1.2, 0.9).save(tmp_path / "a.png", show="degree")
    pixel = read_png(tmp_path / "a.png").pixels[0, 0]
    np.testing.assert_array_equal(pixel, np.rint(np.array(matplotlib.colormaps["viridis"](1.0)[:3]) * 255))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"show": "phase"}, "one of colour, degree, angle"),
        ({"show": "degree", "tone": "filmic"}, "tone = 'filmic': means nothing"),
        ({"show": "angle", "exposure": 3.0}, "exposure = 3.0: means nothing"),
        ({"show": "angle", "space": "srgb"}, "space = 'srgb': means nothing"),
        ({"wavelength": 550.0}, "wavelength = 550.0: is for show='degree'"),
        ({"show": "angle", "wavelength": 500.0}, "the nearest is 450 nm"),
    ],
)
def test_pictures_refuse(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(DomainError, match=words):
        rayleigh_sky(PANORAMA).save(tmp_path / "a.png", **options)
    with pytest.raises(DomainError, match="stokes=True"):
        SpectralImage(np.ones((2, 2, 1)), [550.0]).save(tmp_path / "a.png", show="degree")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("show", ["degree", "angle"])
def test_figures(tmp_path: Path, show: str) -> None:
    made = rayleigh_sky(FISHEYE)
    axes = made.plot_polarisation(show, 550.0, bars=7, path=tmp_path / "figure.svg")
    expected = {"degree": made.degree_of_linear_polarisation, "angle": made.angle_of_linear_polarisation}[show][..., 1]
    np.testing.assert_array_equal(np.ma.filled(axes.images[0].get_array(), np.nan), expected)
    assert axes.images[0].get_clim() == ((0, 1) if show == "degree" else (0, 180))
    text = (tmp_path / "figure.svg").read_text()
    assert "<svg" in text
    assert f"{show} of linear polarisation" in axes.images[0].colorbar.ax.get_ylabel()
    assert axes.get_title() == "550 nm"
    assert rayleigh_sky(PANORAMA).plot_polarisation(show).images[0].colorbar.orientation == "horizontal"
    assert made.plot_polarisation(show, ax=axes) is axes
    assert "luminous efficiency" in axes.get_title()


def drawn_bars(image: SpectralImage, **options: Any) -> np.ndarray:
    """Ends of the bars (bar, 2, 2) in pixels."""
    axes = image.plot_polarisation(**options)
    return np.array(axes.collections[-1].get_segments())


@pytest.mark.parametrize("east_left", [True, False])
def test_bars_on_a_fisheye_circle_the_sun(east_left: bool) -> None:
    """With the Sun in the zenith the field is everywhere across the radius, mirrored or not."""
    camera = Fisheye(width=41, height=41, east_left=east_left)
    d = camera.directions()
    mu = d[..., 2:]
    light = 1 + mu**2
    layers = {"Q": mu**2 - 1, "U": 0 * mu, "V": 0 * mu}
    made = SpectralImage(light, [550.0], layers=layers, recipe={"camera": camera.model_dump(mode="json")})
    bars = drawn_bars(made, bars=8)
    assert len(bars) > 30
    middle, along = bars.mean(axis=1) - 20, bars[:, 1] - bars[:, 0]
    # 1e-3: the tangent is a difference over 1e-4 rad; the bar at the centre itself has no length
    cosine = np.sum(middle * along, axis=1) / (np.hypot(*middle.T) * np.hypot(*along.T))
    assert np.max(np.abs(cosine)) < 1e-3
    # Length grows with the degree of polarisation.
    np.testing.assert_allclose(np.hypot(*along.T), 0.9 * 41 / 8 * degree_at(made, middle + 20), rtol=1e-6)


def degree_at(image: SpectralImage, pixels: np.ndarray) -> np.ndarray:
    x, y = np.rint(pixels).astype(int).T
    return image.degree_of_linear_polarisation[y, x, 0]


@pytest.mark.parametrize("chi", [0.0, 30.0, 90.0, 135.0])
def test_bars_lean_as_the_angle_says(chi: float) -> None:
    """At the horizon of a panorama and in the middle of a photograph: chi anticlockwise from upright."""
    for camera in (
        Panorama(width=36, height=3, elevation_min_deg=-15, elevation_max_deg=15),
        Perspective(width=3, height=3, azimuth_deg=70, fov_deg=2),
    ):
        ones = np.ones((camera.height, camera.width, 1))
        q, u = np.cos(np.radians(2 * chi)), np.sin(np.radians(2 * chi))
        layers = {"Q": q * ones, "U": u * ones, "V": 0 * ones}
        made = SpectralImage(ones, [550.0], layers=layers)
        bars = drawn_bars(made, bars=max(made.shape[:2]), camera=camera)
        middle = bars[np.abs(bars.mean(axis=1)[:, 1] - 1) < 1e-6]  # the horizon
        along = middle[:, 1] - middle[:, 0]
        seen = np.degrees(np.arctan2(-along[:, 0], -along[:, 1])) % 180  # picture: x to the right, y down
        assert len(seen) == camera.width
        # 0.02 degrees: columns beside the middle of the photograph look 0.7 degrees aside
        np.testing.assert_allclose((seen - chi + 90) % 180 - 90, 0, atol=0.02)


def test_bars_need_a_camera() -> None:
    made = rayleigh_sky(PANORAMA, recipe={})
    with pytest.raises(DomainError, match="recipe holds none"):
        made.plot_polarisation(bars=5)
    with pytest.raises(DomainError, match="another size"):
        made.plot_polarisation(bars=5, camera=FISHEYE)
    with pytest.raises(DomainError, match="observer's altitude"):
        made.plot_polarisation(bars=5, camera=PlanetView(width=24, height=12))
    with pytest.raises(DomainError, match="bars"):
        made.plot_polarisation(bars=-1)
    assert made.plot_polarisation(bars=5, camera=PANORAMA).collections


def test_spectrum_of_a_polarised_pixel() -> None:
    axes = rayleigh_sky(PANORAMA).plot_spectrum(3, 4)
    assert [line.get_label() for line in axes.lines] == ["radiance", "Q", "U", "V"]
    assert len(axes.collections) == 4  # bands of one standard error


def test_matplotlib_is_loaded_only_for_pictures_of_polarisation(tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, 'tests')\n"
        "import numpy as np; from skyscatter.image import SpectralImage as S\n"
        "one = np.ones((2, 2, 3)); sky = S(one, [450, 550, 650], layers=dict.fromkeys('QUV', one / 2))\n"
        "sky.degree_of_polarisation; sky.save(sys.argv[1] + '/a.png'); print('matplotlib' in sys.modules)\n"
        "sky.save(sys.argv[1] + '/b.png', show='angle')\n"
        "print('matplotlib' in sys.modules, 'matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True", "False"]
