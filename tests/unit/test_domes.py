"""Domes for other programs: the Sun apart, the scale of RGB, .hdr and half floats, read by OpenImageIO."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image import SpectralImage
from skyscatter.image.colour import spectrum_to_xyz, xyz_to_rgb
from skyscatter.image.dome import lamp
from skyscatter.image.hdr import shared_exponent

WAVELENGTHS = [450.0, 550.0, 650.0]


def by_openimageio(path: Path) -> tuple[np.ndarray, Any]:
    file = OpenImageIO.ImageInput.open(str(path))
    assert file, OpenImageIO.geterror()
    spec = file.spec()
    pixels = file.read_image(0, 0, 0, spec.nchannels, "float")
    names = list(spec.channelnames)
    return pixels[..., [names.index(c) for c in "RGB"]], spec


def picture(width: int = 40, height: int = 9) -> SpectralImage:
    """Light over ten powers of ten, with flat stretches, black pixels and colours outside of sRGB."""
    rng = np.random.default_rng(5)
    radiance = 10 ** rng.uniform(-6, 4, (height, width, 3))
    radiance[2:4, 3:30] = radiance[2, 3]
    radiance[5] = 0.0
    radiance[6, ::2, :2] = 0.0
    return SpectralImage(radiance, WAVELENGTHS, recipe={"name": "Größe"})


@pytest.mark.parametrize("width", [5, 40, 300])
def test_radiance_files(tmp_path: Path, width: int) -> None:
    made = picture(width)
    made.save(tmp_path / "dome.hdr", scale=0.25)
    pixels, spec = by_openimageio(tmp_path / "dome.hdr")
    truth = np.maximum(0.25 * made.rgb(), 0.0)
    # Half a step of 8 bits: the largest component has 128 steps and more.
    assert (np.abs(pixels - truth) <= truth.max(axis=-1, keepdims=True) / 256 * 1.001).all()
    assert spec.getattribute("hdr:exposure") == 0.25 * 179.0
    header = (tmp_path / "dome.hdr").read_bytes().split(b"\n\n")[0].decode()
    assert "# value = 0.25 x cd m-2" in header
    assert "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329" in header
    recipe = next(line for line in header.splitlines() if line.startswith("# recipe="))
    assert json.loads(recipe.removeprefix("# recipe=")) == made.recipe


def test_flat_lines_are_short(tmp_path: Path) -> None:
    SpectralImage(np.ones((20, 1000, 3)), WAVELENGTHS).save(tmp_path / "flat.hdr")
    assert (tmp_path / "flat.hdr").stat().st_size < 20 * 4 * 20
    pixels, _ = by_openimageio(tmp_path / "flat.hdr")
    assert np.unique(pixels.reshape(-1, 3), axis=0).shape == (1, 3)


def test_shared_exponents_round_to_the_nearest() -> None:
    values = np.array([[[1.0, 0.5, 0.0], [255.4 / 256, 0.25, 0.0], [255.6 / 256, 0.25, 0.0], [-1.0, 0.0, 0.0]]])
    found = shared_exponent(values)[0].tolist()
    assert found == [[128, 64, 0, 129], [255, 64, 0, 128], [128, 32, 0, 129], [0, 0, 0, 0]]
    with pytest.raises(DomainError, match="give a smaller scale"):
        shared_exponent(np.full((1, 1, 3), 1e39))


@pytest.mark.parametrize("half", [False, True])
def test_scale_and_half_floats_of_openexr(tmp_path: Path, half: bool) -> None:
    made = SpectralImage(np.random.default_rng(1).uniform(0.01, 1, (4, 6, 3)), WAVELENGTHS)
    made.save(tmp_path / "dome.exr", scale=1e-3, half=half)
    pixels, spec = by_openimageio(tmp_path / "dome.exr")
    np.testing.assert_allclose(pixels, 1e-3 * made.rgb(), rtol=2**-11 if half else 1e-6)
    kinds = {name: str(spec.channelformat(k)) for k, name in enumerate(spec.channelnames)}
    assert {kinds[c] for c in "RGB"} == {"half" if half else "float"}
    assert {kind for name, kind in kinds.items() if name.startswith("S0")} == {"float"}
    assert spec.getattribute("whiteLuminance") == pytest.approx(1000.0)  # cd m-2 of R = G = B = 1
    back = SpectralImage.load(tmp_path / "dome.exr")  # spectra keep their unit
    np.testing.assert_allclose(back.radiance, made.radiance, rtol=1e-6)


def test_what_half_floats_cannot_hold_is_refused(tmp_path: Path) -> None:
    bright = SpectralImage(np.full((1, 1, 3), 1e4), WAVELENGTHS)
    with pytest.raises(DomainError, match="too large for half floats"):
        bright.save(tmp_path / "dome.exr", half=True)
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        for name in ("dome.exr", "dome.hdr"):
            with pytest.raises(DomainError, match="scale"):
                bright.save(tmp_path / name, scale=scale)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def domes() -> dict[str, Any]:
    """A coarse panorama with and without the Sun, and both of the Sun's neighbourhood, by single scattering."""
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=20, sun_azimuth_deg=130)
    cameras = {
        "dome": skyscatter.Panorama(width=60, height=30, centre_azimuth_deg=0.0),
        "close": skyscatter.Perspective(width=24, height=24, azimuth_deg=130, elevation_deg=20, fov_deg=1.0),
    }
    return {
        name: {
            disk: skyscatter.render(scene, camera, WAVELENGTHS, solver="single", sun_disk=disk, parts=True)
            for disk in (True, False)
        }
        | {"solid_angle": camera.pixel_solid_angle()}
        for name, camera in cameras.items()
    }


@pytest.mark.parametrize("name", ["dome", "close"])
def test_dome_and_lamp_are_the_whole_sky(domes: dict[str, Any], name: str) -> None:
    shown, left_out = domes[name][True], domes[name][False]
    missing = np.einsum("yxw,yx->w", shown.radiance - left_out.radiance, domes[name]["solid_angle"])
    np.testing.assert_allclose(missing, left_out.recipe["sun_lamp"]["irradiance"], rtol=1e-3)
    assert "sun_lamp" not in shown.recipe
    assert shown.recipe["scene"] == left_out.recipe["scene"]


@pytest.mark.parametrize("name", ["dome", "close"])
def test_nothing_is_left_of_the_disk(domes: dict[str, Any], name: str) -> None:
    image = domes[name][False]
    parts = image.layers["scattered"] + image.layers["ground"]
    # What is left is rounding, of a disk a hundred thousand times as bright.
    np.testing.assert_allclose(image.radiance, parts, rtol=1e-7)
    assert np.abs(image.layers["direct"]).max() < 1e-7 * image.radiance.max()


def test_light_behind_the_disk_stays() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=60).model_copy(update={"background": 0.01})
    camera = skyscatter.Perspective(width=9, height=9, azimuth_deg=180, elevation_deg=60, fov_deg=2.0)
    image = skyscatter.render(scene, camera, WAVELENGTHS, solver="single", sun_disk=False, parts=True)
    direct = image.layers["direct"]
    np.testing.assert_allclose(direct, np.broadcast_to(direct[:1, :1], direct.shape), rtol=0.02)
    assert 0.005 < direct.min() < direct.max() < 0.01


def test_the_lamp_in_the_units_of_the_dome(domes: dict[str, Any], tmp_path: Path) -> None:
    image = domes["dome"][False]
    content = lamp(image, 0.5)
    sun = content["sun"]
    np.testing.assert_allclose(sun["direction"], direction_from_azimuth_elevation(130.0, 20.0), atol=1e-15)
    xyz = spectrum_to_xyz(np.array(image.recipe["sun_lamp"]["irradiance"]), WAVELENGTHS)
    assert sun["illuminance_lx"] == pytest.approx(xyz[1])
    np.testing.assert_allclose(sun["rgb"], 0.5 * xyz_to_rgb(xyz))
    blender = content["blender"]
    np.testing.assert_allclose(blender["sun_strength"] * np.array(blender["sun_colour"]), sun["rgb"])
    # A lamp of Blender shines along its own -z, turned about x and then about z.
    x, _, z = np.radians(blender["sun_rotation_euler_deg"])
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    np.testing.assert_allclose(about_z @ about_x @ [0, 0, 1], sun["direction"], atol=1e-12)
    # Its environment has +x in the middle; ours has north, the y axis.
    assert blender["world_mapping_rotation_z_deg"] == -90.0
    with pytest.raises(DomainError, match="--no-sun"):
        lamp(domes["dome"][True])


def test_a_sun_below_the_horizon_lights_nothing() -> None:
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=-5)
    camera = skyscatter.Panorama(width=8, height=4)
    image = skyscatter.render(scene, camera, WAVELENGTHS, solver="single", sun_disk=False)
    assert image.recipe["sun_lamp"]["irradiance"] == [0.0, 0.0, 0.0]
    content = lamp(image)
    assert content["blender"]["sun_strength"] == 0.0
    json.dumps(content, allow_nan=False)


def test_only_planets_have_a_sun_to_leave_out() -> None:
    scene = skyscatter.load_model("reflection-nebula").scene()
    camera = skyscatter.Telescope(width=4, height=4, pixel_scale_deg=0.01)
    with pytest.raises(DomainError, match="skies of planets"):
        skyscatter.render(scene, camera, WAVELENGTHS, solver="single", sun_disk=False)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    options = "--north --no-sun --scale 0.01 --half --no-spectra --float32 --compress --size 24x12 --solver single"
    options += " -q --json"
    outputs = ["-o", "dome.exr", "-o", "other.hdr", "-o", "sky.fits", "-o", "sky.nc"]
    assert main(["sky", "earth-simple", "--wavelengths", "450,550,650", *options.split(), *outputs]) == 0
    names = {"dome.exr", "dome.sun.json", "other.hdr", "other.sun.json", "sky.fits", "sky.nc"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert set(json.loads(capsys.readouterr().out)["outputs"]) == names
    content = json.loads((tmp_path / "dome.sun.json").read_text())
    assert content["dome"] == {"rgb_per_cd_m-2": 0.01, "view": "panorama", "middle_azimuth_deg": 0.0}
    spectra = SpectralImage.load("sky.fits")
    assert spectra.radiance.dtype == SpectralImage.load("sky.nc").radiance.dtype == np.float32
    pixels, spec = by_openimageio(tmp_path / "dome.exr")
    np.testing.assert_allclose(pixels, 0.01 * spectra.rgb(), rtol=1e-3, atol=1e-3)
    assert not any(name.startswith("S0") for name in spec.channelnames)


def test_a_lamp_is_not_replaced_either(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("dome.sun.json").write_text("mine")
    assert main(["sky", "earth-simple", "--no-sun", "--no-clobber", "-o", "dome.exr"]) == 2
    assert "dome.sun.json" in capsys.readouterr().err
    assert Path("dome.sun.json").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--scale", "2", "-o", "a.fits"], "is for .exr and .hdr files"),
        (["--half", "-o", "a.hdr"], "is for .exr files"),
        (["--no-spectra", "-o", "a.png"], "is for .exr files"),
        (["--float32", "-o", "a.exr"], "is for .fits, .nc and .zarr files"),
        (["--compress", "-o", "a.nc"], "is for .fits files"),
        (["--scale", "0", "-o", "a.exr"], "give a number above 0"),
        (["--north", "--view", "fisheye", "-o", "a.exr"], "fisheyes have north on top"),
        (["--north", "--view", "panorama:3", "-o", "a.exr"], "is for --view panorama"),
    ],
)
def test_options_without_effect_are_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sky", *options]) == 2
    line = capsys.readouterr().err
    assert word in line
    assert line.count("\n") == 1
