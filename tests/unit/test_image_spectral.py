"""SpectralImage itself: what it checks, what it holds, and how it refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.image import SpectralImage

WL = [400.0, 500.0, 600.0, 700.0]


def image(**changes: object) -> SpectralImage:
    rng = np.random.default_rng(0)
    given = {"radiance": rng.random((3, 5, 4)), "wavelengths": WL, **changes}
    return SpectralImage(**given)  # type: ignore[arg-type]


def test_it_holds_what_it_was_given() -> None:
    error = np.full((3, 5, 4), 0.1, dtype=np.float32)
    made = image(standard_error=error, recipe={"sun": (1, 2), "model": "earth"}, layers={"ground": np.ones((3, 5, 4))})
    assert made.shape == (3, 5, 4)
    assert made.radiance.dtype == np.float64
    assert made.standard_error is not None
    assert made.standard_error.dtype == np.float32
    assert made.recipe == {"sun": [1, 2], "model": "earth"}
    assert list(made.layers) == ["ground"]
    assert "5 x 3 pixels, 4 wavelengths, 400 to 700 nm, layers: ground" in repr(made)


def test_dataset_is_labelled() -> None:
    made = image(standard_error=np.ones((3, 5, 4)), layers={"order-1": np.ones((3, 5, 4))}, recipe={"seed": 3})
    data = made.dataset
    assert data["radiance"].dims == ("y", "x", "wavelength")
    assert data["radiance"].attrs["units"] == "W m-2 sr-1 nm-1"
    assert data["radiance_standard_error"].attrs["units"] == "W m-2 sr-1 nm-1"
    assert data["wavelength"].attrs["units"] == "nm"
    assert data["wavelength"].attrs["standard_name"] == "radiation_wavelength"
    assert data["layer_order-1"].attrs["layer"] == "order-1"
    assert data.attrs["recipe"] == '{"seed": 3}'
    assert np.shares_memory(data["radiance"].values, made.radiance)
    assert float(data["radiance"].sel(wavelength=500.0)[1, 2]) == made.radiance[1, 2, 1]


def test_layer_as_an_image() -> None:
    made = image(layers={"sky": np.full((3, 5, 4), 2.0)}, recipe={"seed": 3})
    part = made.layer("sky")
    assert part.recipe == {"seed": 3, "layer": "sky"}
    np.testing.assert_array_equal(part.radiance, 2.0)
    with pytest.raises(DomainError, match="one of sky"):
        made.layer("sea")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wavelengths": [400, 500, 600]}, "3 wavelengths"),
        ({"wavelengths": [400, 500, 500, 700]}, "ascend"),
        ({"wavelengths": [700, 600, 500, 400]}, "ascend"),
        ({"wavelengths": [-1, 500, 600, 700]}, "positive"),
        ({"wavelengths": [400, 500, 600, np.nan]}, "positive and ascend"),
        ({"wavelengths": []}, "at least one"),
        ({"wavelengths": "blue"}, "must be numbers"),
        ({"radiance": np.ones((3, 4))}, r"\(y, x, wavelength\)"),
        ({"radiance": np.ones((0, 5, 4))}, r"\(y, x, wavelength\)"),
        ({"radiance": "sky"}, "array of numbers"),
        ({"radiance": np.full((3, 5, 4), np.inf)}, "finite"),
        ({"standard_error": np.ones((3, 5, 3))}, "shape of the radiance"),
        ({"standard_error": -np.ones((3, 5, 4))}, "negative"),
        ({"layers": {"a": np.ones((1, 5, 4))}}, "layer a"),
        ({"layers": {"a/b": np.ones((3, 5, 4))}}, "layer name"),
        ({"recipe": {"a": object()}}, "JSON"),
        ({"recipe": {"a": float("nan")}}, "JSON"),
    ],
)
def test_wrong_input_is_one_clear_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(DomainError, match=message) as caught:
        image(**changes)
    assert "\n" not in str(caught.value)


def test_pixels_outside_the_field_are_black() -> None:
    radiance = np.full((2, 2, 4), 0.1)
    radiance[0, 1] = np.nan
    made = image(radiance=radiance)
    np.testing.assert_array_equal(made.inside, [[True, False], [True, True]])
    picture = made.picture()
    np.testing.assert_array_equal(picture[0, 1], 0.0)
    assert np.isnan(made.xyz()[0, 1]).all()
    assert np.all(picture[1] > 0.0)
    assert np.isfinite(made.auto_exposure())


def test_given_exposure_equals_the_automatic_one() -> None:
    made = image()
    np.testing.assert_array_equal(made.picture(), made.picture(exposure=made.auto_exposure()))
    assert made.picture(exposure=made.auto_exposure() - 2).mean() > made.picture().mean()


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("sky.tiff", {}, r"\.exr, \.hdr, \.png, \.fits, \.nc"),
        ("sky", {}, r"\.exr, \.hdr, \.png, \.fits, \.nc"),
        ("sky.png", {"quality": 3}, "space, exposure, tone, bits"),
        ("sky.fits", {"bits": 8}, "files take filters"),
        ("sky.nc", {"bits": 8}, "files take dtype"),
        ("sky.png", {"bits": 12}, "8 or 16"),
        ("sky.png", {"space": "acescg"}, "srgb, display-p3, rec2020"),
        ("sky.png", {"space": "cmyk"}, "srgb, display-p3, rec2020, acescg"),
    ],
)
def test_save_refuses(tmp_path: Path, name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        image().save(tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extension", ["exr", "png", "fits", "nc"])
def test_missing_directory(tmp_path: Path, extension: str) -> None:
    with pytest.raises(SkyscatterError, match="directory does not exist") as caught:
        image().save(tmp_path / "none" / f"sky.{extension}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("extension", ["exr", "fits", "nc"])
def test_load_refuses(tmp_path: Path, extension: str) -> None:
    with pytest.raises(MissingDataError, match="no such file"):
        SpectralImage.load(tmp_path / f"none.{extension}")
    wrong = tmp_path / f"wrong.{extension}"
    wrong.write_bytes(b"this is a poem, not a picture" * 100)
    with pytest.raises(DomainError, match=r"is not a"):
        SpectralImage.load(wrong)
    empty = tmp_path / f"empty.{extension}"
    empty.touch()
    with pytest.raises(DomainError, match=r"is not a"):
        SpectralImage.load(empty)


@pytest.mark.parametrize("extension", ["exr", "fits", "nc"])
def test_truncated_files(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"whole.{extension}"
    SpectralImage(np.random.default_rng(1).random((40, 40, 4)), WL).save(path)
    data = path.read_bytes()
    short = tmp_path / f"short.{extension}"
    short.write_bytes(data[: len(data) // 2])
    with pytest.raises(DomainError, match="damaged") as caught:
        SpectralImage.load(short)
    assert "\n" not in str(caught.value)


def test_png_has_no_spectra_to_load(tmp_path: Path) -> None:
    image().save(tmp_path / "sky.png")
    with pytest.raises(DomainError, match=r"\.exr, \.fits, \.nc"):
        SpectralImage.load(tmp_path / "sky.png")


def test_plot_of_a_spectrum(tmp_path: Path) -> None:
    made = image(standard_error=np.full((3, 5, 4), 0.1), layers={"ground": np.ones((3, 5, 4))})
    axes = made.plot_spectrum(4, 2, path=tmp_path / "spectrum.svg")
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), made.radiance[2, 4])
    np.testing.assert_array_equal(axes.lines[1].get_ydata(), 1.0)
    assert "nm" in axes.get_xlabel()
    assert b"<svg" in (tmp_path / "spectrum.svg").read_bytes()
    assert made.plot_spectrum(0, 0, ax=axes) is axes
    with pytest.raises(DomainError, match="columns 0 to 4 and rows 0 to 2"):
        made.plot_spectrum(5, 0)
    with pytest.raises(DomainError, match="columns 0 to 4 and rows 0 to 2"):
        made.plot_spectrum(0, -1)
    with pytest.raises(DomainError, match="extension"):
        made.plot_spectrum(0, 0, path=tmp_path / "spectrum.xyz")
    outside = image(radiance=np.full((3, 5, 4), np.nan))
    with pytest.raises(DomainError, match="outside"):
        outside.plot_spectrum(0, 0)


def test_plotting_does_not_start_a_window_system() -> None:
    code = (
        "import sys, numpy as np; from skyscatter.image import SpectralImage as S; "
        "S(np.ones((2, 2, 3)), [450, 550, 650]).plot_spectrum(0, 0); print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_disk_that_fills_up_leaves_nothing_behind(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="needs a limit on file sizes, which only unix has")
    assert resource.RLIMIT_FSIZE is not None
    # The limit stays with its process, so it gets one of its own.
    code = (
        "import resource, sys, numpy as np; from skyscatter.image import SpectralImage as S\n"
        "from skyscatter.errors import SkyscatterError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "sky = S(np.random.default_rng(0).random((90, 90, 4)), [400, 500, 600, 700])\n"
        "for extension in ('exr', 'png', 'fits', 'nc'):\n"
        "    try:\n"
        "        sky.save(f'{sys.argv[1]}/a.{extension}', **({'bits': 16} if extension == 'png' else {}))\n"
        "    except SkyscatterError as error:\n"
        "        print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 4
    for line, extension in zip(lines, ("exr", "png", "fits", "nc"), strict=True):
        assert line.startswith(f"{tmp_path}/a.{extension}: cannot be written: ")
    assert list(tmp_path.iterdir()) == []
