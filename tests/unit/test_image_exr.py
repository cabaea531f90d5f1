"""OpenEXR: round trips, and what two independent readers see."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skyscatter.errors import DomainError
from skyscatter.image import SpectralImage
from skyscatter.image.exr import channel_name, parse_channel

WL = np.array([380.0, 412.3456789012, 550.0, 700.0])  # uneven, one with more digits than a channel name has


def sample(dtype: type = np.float32, holes: bool = True) -> SpectralImage:
    rng = np.random.default_rng(2)
    radiance = rng.random((6, 9, 4)).astype(dtype)
    if holes:
        radiance[0, :3] = np.nan
    layers = {"direct": 0.25 * radiance, "a-layer-whose-name-is-longer-than-most": 0.75 * radiance}
    recipe = {"model": "earth", "solver": "path", "sun": [12.5, 180.0], "name": "Größe 'x' & \"y\""}
    return SpectralImage(radiance, WL, 0.01 * radiance, recipe=recipe, layers=layers)


@pytest.fixture(scope="module")
def oiio() -> Any:
    return pytest.importorskip("OpenImageIO", reason="OpenImageIO, the independent reader, is not installed")


def test_round_trip_is_exact_in_float32(tmp_path: Path) -> None:
    made = sample()
    made.save(tmp_path / "sky.exr")
    back = SpectralImage.load(tmp_path / "sky.exr")
    assert back.radiance.dtype == np.float32
    np.testing.assert_array_equal(back.radiance, made.radiance)
    np.testing.assert_array_equal(back.standard_error, made.standard_error)
    np.testing.assert_array_equal(back.wavelengths, made.wavelengths)
    assert sorted(back.layers) == sorted(made.layers)
    for name, cube in made.layers.items():
        np.testing.assert_array_equal(back.layers[name], cube)
    assert back.recipe == made.recipe
    assert [p.name for p in tmp_path.iterdir()] == ["sky.exr"]


def test_float64_is_rounded_once(tmp_path: Path) -> None:
    made = sample(np.float64)
    made.save(tmp_path / "sky.exr")
    np.testing.assert_array_equal(SpectralImage.load(tmp_path / "sky.exr").radiance, made.radiance.astype(np.float32))


def test_header_is_that_of_the_published_layout(tmp_path: Path) -> None:
    import OpenEXR

    sample().save(tmp_path / "sky.exr")
    with OpenEXR.File(str(tmp_path / "sky.exr"), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert header["spectralLayoutVersion"] == "1.0"
    assert header["emissiveUnits"] == "W.m^-2.sr^-1"
    assert header["skyscatterRadianceUnits"] == "W m-2 sr-1 nm-1"
    assert header["whiteLuminance"] == 1.0
    assert {"R", "G", "B", "A", "S0.550,000000nm", "S0.412,345679nm", "standard_error.550,000000nm"} <= set(channels)
    np.testing.assert_array_equal(channels["A"][0], [0, 0, 0, 1, 1, 1, 1, 1, 1])
    # float32 rounding of a sum of four terms
    np.testing.assert_allclose(channels["G"][1:], sample().rgb()[1:, :, 1], rtol=1e-5)


def test_opened_by_openimageio(tmp_path: Path, oiio: Any) -> None:
    made = sample()
    made.save(tmp_path / "sky.exr")
    file = oiio.ImageInput.open(str(tmp_path / "sky.exr"))
    spec = file.spec()
    pixels = file.read_image(oiio.FLOAT)
    file.close()
    assert (spec.height, spec.width) == (6, 9)
    assert spec.get_string_attribute("spectralLayoutVersion") == "1.0"
    for band, wavelength in enumerate(WL):
        index = spec.channelnames.index(f"S0.{wavelength:.6f}nm".replace(".", ",").replace("S0,", "S0."))
        np.testing.assert_array_equal(pixels[..., index], made.radiance[..., band])


@pytest.mark.skipif("OpenImageIO" not in sys.modules and not __import__("importlib").util.find_spec("OpenImageIO"),
                    reason="colour-science reads EXR through OpenImageIO, which is not installed")  # fmt: skip
def test_read_as_a_spectral_image_by_colour_science(tmp_path: Path) -> None:
    made = sample(holes=False)
    made.save(tmp_path / "sky.exr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colour-science remarks on optional packages
        import colour

        components, specification = colour.read_spectral_image_Fichet2021(tmp_path / "sky.exr", additional_data=True)
    assert list(components) == ["S0"]
    assert specification.is_emissive
    assert not specification.is_polarised
    np.testing.assert_allclose(components["S0"][0], WL, atol=5e-7)  # six decimals in the names
    np.testing.assert_array_equal(components["S0"][1], made.radiance)


def test_files_by_others_are_read() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    folder = Path(colour.__file__).parent / "io" / "tests" / "resources"
    if not (folder / "D65.exr").is_file():
        pytest.skip("this colour-science comes without its test files")
    image = SpectralImage.load(folder / "D65.exr")
    daylight = colour.SDS_ILLUMINANTS["D65"]
    np.testing.assert_allclose(image.wavelengths, daylight.wavelengths)
    # 1e-3: that file holds half floats (11 bits)
    np.testing.assert_allclose(image.radiance[0, 0] / image.radiance[0, 0, 52], daylight.values / 100.0, rtol=1e-3)
    polarised = SpectralImage.load(folder / "Polarised.exr")
    assert sorted(polarised.layers) == ["S1", "S2", "S3"]
    with pytest.raises(DomainError, match="no spectral channels"):
        SpectralImage.load(folder / "Ohta1997.exr")  # reflectances, not light


def test_picture_only(tmp_path: Path) -> None:
    sample().save(tmp_path / "sky.exr", spectral=False)
    with pytest.raises(DomainError, match="no spectral channels"):
        SpectralImage.load(tmp_path / "sky.exr")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("S0.550,000000nm", ("S0", 550.0)),
        ("S0.550nm", ("S0", 550.0)),
        ("S3.0,55um", ("S3", 550.0)),
        ("S0.5,5e-7m", ("S0", 550.0)),
        ("S0.500THz", ("S0", 599.584916)),
        ("standard_error.380,500000nm", ("standard_error", 380.5)),
        ("layer.order-1.380,500000nm", ("layer.order-1", 380.5)),
    ],
)
def test_channel_names(name: str, expected: tuple[str, float]) -> None:
    parsed = parse_channel(name)
    assert parsed is not None
    assert parsed[0] == expected[0]
    assert parsed[1] == pytest.approx(expected[1], rel=1e-12)  # rounding of the powers of ten


def test_other_channels_are_not_bands() -> None:
    for name in ("R", "A", "T.550,0nm", "S4.550nm", "S0.550.0nm", "S0.nm", "S0.0Hz", "depth.Z"):
        assert parse_channel(name) is None
    for group in ("S0", "layer.sky", "standard_error"):
        assert parse_channel(channel_name(group, 412.5)) == (group, 412.5)


def test_what_float32_names_and_values_cannot_hold(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match="1e-6 nm apart"):
        SpectralImage(np.ones((1, 1, 2)), [500.0, 500.0000001]).save(tmp_path / "a.exr")
    with pytest.raises(DomainError, match="float32"):
        SpectralImage(np.full((1, 1, 2), 1e300), [500.0, 600.0]).save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []
