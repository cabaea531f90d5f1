"""PNG: what is written reads back the same, here and in Pillow and OpenImageIO."""

from __future__ import annotations

import io
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from skyscatter.errors import DomainError, MissingDataError
from skyscatter.image import SpectralImage, png
from skyscatter.image.png import _decode, encode_png, read_png

WL = np.arange(400.0, 701.0, 20.0)


def sample(holes: bool = False) -> SpectralImage:
    rng = np.random.default_rng(4)
    radiance = rng.random((20, 31, WL.size)) * np.linspace(0.01, 1.0, 31)[None, :, None]
    if holes:
        radiance[:5, :7] = np.nan
    return SpectralImage(radiance, WL, recipe={"model": "earth", "place": "Zürich"})


def assert_shows(pixels: np.ndarray, picture: np.ndarray, bits: int = 8) -> None:
    """Rounded to 16 bits; with 8 one of the two steps around each value, by dithering."""
    if bits == 16:
        np.testing.assert_array_equal(pixels, np.rint(picture * 65535))
    else:
        assert np.abs(pixels - picture * 255).max() < 1.0


def test_gradients_have_no_steps() -> None:
    values = np.linspace(100.0, 102.0, 9)  # of 255
    picture = np.broadcast_to(values[:, None, None, None] / 255, (9, 64, 64, 3))
    found = np.stack([_decode(encode_png(part, dither=True)).pixels for part in picture]).astype(float)
    # The pattern's thresholds cover (0, 1) evenly: over 4096 pixels to 0.01, as measured; each channel has its own.
    np.testing.assert_allclose(found.mean(axis=(1, 2)), np.repeat(values[:, None], 3, axis=1), atol=0.01)
    assert np.all(found[[0, 4, 8]] == values[[0, 4, 8], None, None, None])  # whole numbers stay
    assert 0.1 < np.mean(found[2, ..., 0] != found[2, ..., 1]) < 0.9
    neighbours = np.corrcoef(found[2, :, 1:, 0].ravel(), found[2, :, :-1, 0].ravel())[0, 1]
    assert neighbours < 0.0  # finer than chance


def test_parts_that_threads_compress_are_one_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = np.random.default_rng(8).random((300, 400, 3)).round(1)
    picture[100:] = picture[:200]  # what parts know of those before them
    file = encode_png(picture, bits=16)
    assert 2 * png.PACKED < 300 * 400 * 6  # three parts at least
    np.testing.assert_array_equal(_decode(file).pixels, np.rint(picture * 65535))
    with Image.open(io.BytesIO(encode_png(picture))) as read:
        np.testing.assert_array_equal(np.asarray(read), np.rint(picture * 255))
    monkeypatch.setattr(png, "processors", lambda: 1)
    assert encode_png(picture, bits=16) == file


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("holes", [False, True])
def test_round_trip(tmp_path: Path, bits: int, holes: bool) -> None:
    made = sample(holes)
    made.save(tmp_path / "sky.png", bits=bits)
    back = read_png(tmp_path / "sky.png")
    assert back.pixels.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert_shows(back.pixels[..., :3], made.picture(), bits)
    if holes:
        np.testing.assert_array_equal(back.pixels[..., 3], np.where(made.inside, 2**bits - 1, 0))
    else:
        assert back.pixels.shape[2] == 3
    assert json.loads(back.texts["skyscatter-recipe"]) == made.recipe
    shown = json.loads(back.texts["skyscatter-picture"])
    assert shown == {"colour_space": "srgb", "ev100": made.auto_exposure(), "tone": "photograph"}


@pytest.mark.parametrize("holes", [False, True])
def test_pillow_sees_the_same_8_bit_picture(tmp_path: Path, holes: bool) -> None:
    made = sample(holes)
    made.save(tmp_path / "sky.png")
    with Image.open(tmp_path / "sky.png") as file:
        assert file.mode == ("RGBA" if holes else "RGB")
        assert_shows(np.asarray(file)[..., :3], made.picture())
        assert json.loads(file.info["skyscatter-recipe"]) == made.recipe
        assert file.info["srgb"] == 0


def test_openimageio_sees_the_same_16_bit_picture(tmp_path: Path) -> None:
    oiio = pytest.importorskip("OpenImageIO", reason="OpenImageIO, the independent reader, is not installed")
    made = sample()
    made.save(tmp_path / "sky.png", bits=16)
    file = oiio.ImageInput.open(str(tmp_path / "sky.png"))
    pixels = file.read_image(oiio.UINT16)
    file.close()
    np.testing.assert_array_equal(pixels, np.rint(made.picture() * 65535))


@pytest.mark.parametrize(("space", "code"), [("srgb", 1), ("display-p3", 12), ("rec2020", 9)])
def test_colour_space_is_stated(tmp_path: Path, space: str, code: int) -> None:
    sample().save(tmp_path / "sky.png", space=space, exposure=12.0, tone="linear")
    back = read_png(tmp_path / "sky.png")
    assert back.cicp == (code, 13, 0, 1)  # ITU-T H.273: primaries, sRGB curve, RGB, full range
    assert_shows(back.pixels, sample().picture(space, 12.0, "linear"))
    with Image.open(tmp_path / "sky.png") as file:
        assert file.info["chromaticity"][:2] == (0.3127, 0.329)
        assert ("srgb" in file.info) == (space == "srgb")


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA"])
def test_files_by_pillow_are_read(tmp_path: Path, mode: str) -> None:
    # A smooth picture makes Pillow use every filter, the two that we never write included.
    y, x = np.mgrid[0:40, 0:50]
    smooth = np.stack([x * y // 8, x * x // 10, y * y // 7, 255 - x], axis=-1) % 256
    channels = len(mode)
    pixels = smooth[..., :channels].astype(np.uint8)
    Image.fromarray(pixels[..., 0] if channels == 1 else pixels, mode=None).save(tmp_path / "p.png")
    np.testing.assert_array_equal(read_png(tmp_path / "p.png").pixels, pixels)


@pytest.mark.parametrize("kind", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("bits", [8, 16])
def test_every_filter_against_its_definition(tmp_path: Path, kind: int, bits: int) -> None:
    """Filter rows by the loop of the standard (section 9.2), and let the reader undo it."""
    pixels = np.random.default_rng(kind).integers(0, 2**bits, (5, 6, 3)).astype(">u2" if bits == 16 else np.uint8)
    raw = [row.tobytes() for row in pixels]
    step, length = 3 * bits // 8, len(raw[0])
    packed = bytearray()
    for y, row in enumerate(raw):
        packed.append(kind)
        for i in range(length):
            a = row[i - step] if i >= step else 0
            b = raw[y - 1][i] if y else 0
            c = raw[y - 1][i - step] if y and i >= step else 0
            nearest = sorted([(abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c)])[0][2]
            packed.append((row[i] - (0, a, b, (a + b) // 2, nearest)[kind]) % 256)
    data = b"\x89PNG\r\n\x1a\n"
    header = struct.pack(">IIBBBBB", 6, 5, bits, 2, 0, 0, 0)
    for name, body in ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(packed))), (b"IEND", b"")):
        data += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    (tmp_path / "p.png").write_bytes(data)
    np.testing.assert_array_equal(read_png(tmp_path / "p.png").pixels, pixels)


def corrupted(data: bytes) -> bytes:
    return data[:60] + bytes([data[60] ^ 255]) + data[61:]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: b"GIF89a" + data, "is not a PNG file"),
        (lambda data: data[: len(data) // 2], "cannot be read as PNG"),
        (corrupted, "checksum"),
    ],
)
def test_unreadable_files(tmp_path: Path, spoil: Any, message: str) -> None:
    path = tmp_path / "p.png"
    path.write_bytes(spoil(encode_png(np.random.default_rng(0).random((9, 9, 3)))))
    with pytest.raises(DomainError, match=message):
        read_png(path)
    with pytest.raises(MissingDataError, match="no such file"):
        read_png(tmp_path / "none.png")


def test_palettes_are_refused(tmp_path: Path) -> None:
    Image.new("P", (4, 4)).save(tmp_path / "p.png")
    with pytest.raises(DomainError, match="without palette"):
        read_png(tmp_path / "p.png")


@pytest.mark.parametrize(
    ("picture", "options", "message"),
    [
        (np.full((2, 2, 3), 1.5), {}, r"in \[0, 1\]"),
        (np.full((2, 2, 3), np.nan), {}, r"in \[0, 1\]"),
        (np.zeros((2, 2)), {}, "must be"),
        (np.zeros((2, 2, 3)), {"bits": 10}, "8 or 16"),
        (np.zeros((2, 2, 3)), {"space": "acescg"}, "no display"),
    ],
)
def test_wrong_pictures(picture: np.ndarray, options: dict[str, Any], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        encode_png(picture, **options)
