"""PNG files with 8 or 16 bits a channel (W3C Portable Network Graphics, third edition).

Pillow does not write 16-bit colour, and the format is zlib and a checksum, both in the standard library; so it is
written here.  The colour space is stated by ``cICP`` (and ``sRGB``, ``gAMA``, ``cHRM`` for older readers), the recipe
stands in an ``iTXt`` chunk with the keyword ``skyscatter-recipe``.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.image import skybrightness as brightness
from skyscatter.image.chart import marked
from skyscatter.image.colour import ColourSpace, display_space
from skyscatter.image.looks import expanded, is_of_planes
from skyscatter.image.palettes import Levels, Planes, plane_picture
from skyscatter.image.polarisation import SCALES, check_shown, painted
from skyscatter.image.spectral import SpectralImage
from skyscatter.kernels.processors import processors
from skyscatter.workers import Workers

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}  # colour type -> channels; palettes (3) are not read
_SRGB_TRANSFER = 13  # ITU-T H.273
LEVEL = 5  #: of compression: one more takes twice the time for 6 % less
PACKED = 1 << 18  #: bytes that a thread compresses at a time, whatever the processors: the file is the same
WINDOW = 1 << 15  #: bytes that a compressor looks back


class Png(NamedTuple):
    """What a PNG file holds: pixels (y, x, channel) as uint8 or uint16, texts by keyword, the code of its primaries."""

    pixels: NDArray[Any]
    texts: dict[str, str]
    cicp: tuple[int, int, int, int] | None


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _colour_chunks(space: ColourSpace) -> bytes:
    corners = (*space.white, *space.red, *space.green, *space.blue)
    # Spaces without a code are told by their corners alone.
    chunks = b"" if space.cicp is None else _chunk(b"cICP", bytes([space.cicp, _SRGB_TRANSFER, 0, 1]))
    if space.name == "srgb":
        chunks += _chunk(b"sRGB", b"\x00")
    chunks += _chunk(b"gAMA", struct.pack(">I", 45455))
    return chunks + _chunk(b"cHRM", struct.pack(">8I", *(round(value * 100000) for value in corners)))


def _filtered(pixels: NDArray[Any]) -> bytes:
    """Rows of big-endian bytes, each with the filter (none, left, up) whose differences are smallest."""
    height = pixels.shape[0]
    rows = pixels.astype(pixels.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    step = pixels.shape[2] * pixels.dtype.itemsize
    left, up = rows.copy(), rows.copy()
    left[:, step:] -= rows[:, :-step]
    up[1:] -= rows[:-1]
    candidates = (rows, left, up)
    costs = [np.abs(candidate.view(np.int8).astype(np.int16)).sum(axis=1) for candidate in candidates]
    choice = np.argmin(costs, axis=0)
    out = np.empty((height, rows.shape[1] + 1), dtype=np.uint8)
    out[:, 0] = choice
    for kind, candidate in enumerate(candidates):
        out[choice == kind, 1:] = candidate[choice == kind]
    return out.tobytes()


def _compressed(data: bytes) -> bytes:
    """A zlib stream (RFC 1950), whose parts threads compress; each knows the end of the part before it."""

    def deflated(start: int) -> bytes:
        packer = zlib.compressobj(LEVEL, zlib.DEFLATED, -15, zdict=data[max(start - WINDOW, 0) : start])
        packed = packer.compress(data[start : start + PACKED])
        return packed + packer.flush(zlib.Z_SYNC_FLUSH if start + PACKED < len(data) else zlib.Z_FINISH)

    with Workers(processors()) as pool:
        parts = list(pool.map(deflated, range(0, len(data), PACKED)))
    return b"\x78\x9c" + b"".join(parts) + struct.pack(">I", zlib.adler32(data))


def _dither(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Thresholds in (0, 1) for rounding, shape (y, x, channel): smooth gradients then have no steps.

    Interleaved gradient noise (Jimenez 2014), whose pattern is as fine as the pixels, moved from channel to channel.
    """
    height, width, channels = shape
    x, y = np.arange(width)[None, :, None], np.arange(height)[:, None, None]
    moved = 5.588238 * np.arange(channels)
    noise = np.modf(52.9829189 * np.modf(0.06711056 * (x + moved) + 0.00583715 * (y + moved))[0])[0]
    return np.asarray(0.002 + 0.996 * noise)  # whole numbers stay what they are, rounding or no rounding


def encode_png(
    picture: ArrayLike, space: str = "srgb", bits: int = 8, texts: dict[str, str] | None = None, dither: bool = False
) -> bytes:
    """PNG file of a display-encoded picture in [0, 1], shape (y, x, 3) or, with opacity, (y, x, 4).

    With `dither`, and 8 bits, a value between two steps becomes the upper one in as many pixels as it is near to it.
    """
    if bits not in (8, 16):
        raise DomainError("bits", bits, "a PNG channel has 8 or 16 bits")
    display = display_space(space)
    values = np.asarray(picture, dtype=float)
    if values.ndim != 3 or values.shape[2] not in (3, 4) or values.size == 0:
        raise DomainError("picture", f"shape {values.shape}", "must be (y, x, 3) or (y, x, 4)")
    if not (np.all(values >= 0.0) and np.all(values <= 1.0)):
        raise DomainError("picture", f"{values.min()} to {values.max()}", "must lie in [0, 1]")
    if dither and bits == 8:
        pixels = np.floor(values * 255.0 + _dither(values.shape)).astype(np.uint8)
    else:
        pixels = np.rint(values * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    height, width, channels = pixels.shape
    kind = 2 if channels == 3 else 6
    file = _SIGNATURE + _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
    file += _colour_chunks(display)
    for keyword, text in {"Software": "skyscatter", **(texts or {})}.items():
        file += _chunk(b"iTXt", keyword.encode("latin-1") + b"\0\0\0\0\0" + text.encode("utf-8"))
    return file + _chunk(b"IDAT", _compressed(_filtered(pixels))) + _chunk(b"IEND", b"")


def write(
    image: SpectralImage,
    path: Path,
    space: str | None = None,
    exposure: float | Literal["auto"] | None = None,
    tone: str | None = None,
    bits: int = 8,
    show: str = "colour",
    wavelength: float | None = None,
    palette: str | None = None,
    filters: str | Iterable[Any] | None = None,
    stretch: float | None = None,
    softening: float | None = None,
    levels: Levels | Literal["auto"] | None = None,
    continuum: str | None = None,
    glare: str | None = None,
    look: str | None = None,
    labels: bool = False,
    lines: bool = False,
) -> None:
    """Write the picture of an image; transparent where it lies outside the camera's field.

    With `show` ``"degree"`` or ``"angle"`` the picture is that of the linear polarisation, of all wavelengths weighted
    by luminous efficiency or of one `wavelength` [nm], and transparent where it is undefined.  With a `palette` or
    three `filters` it shows these as red, green and blue; see `skyscatter.image.palettes`.  With `show`
    ``"magnitudes"`` it is a map of the brightness in the filter V, or in one that `filters` names; see
    `skyscatter.image.skybrightness`.  A `look` stands for several of these (see `skyscatter.image.looks`), `glare` for
    what optics throw around bright lights.  With `labels` and `lines` names and constellations are drawn over it; see
    `skyscatter.image.chart`.
    """
    check_shown(show)
    developed: dict[str, Any] = {"space": space, "exposure": exposure, "tone": tone, "glare": glare}
    planes: dict[str, Any] = {
        **{"palette": palette, "filters": filters, "stretch": stretch, "softening": softening, "levels": levels},
        "continuum": continuum,
    }
    if look is not None:
        if show != "colour":
            raise DomainError("look", look, f"means nothing to show={show!r}, whose colours are fixed; leave it out")
        options = expanded(look, {**developed, **planes})
        developed, planes = ({name: options.get(name) for name in part} for part in (developed, planes))
    if show == "magnitudes":
        name = "V" if filters is None else filters
        others = {**developed, **planes, "filters": None, "wavelength": wavelength}
        _refuse(others, "magnitudes, whose colours are fixed")
        space, (picture, opaque, shown) = "srgb", brightness.painted(image, str(name))
        made = {"show": show, **shown}
    elif is_of_planes(planes):
        _refuse({"wavelength": wavelength, "show": None if show == "colour" else show}, "pictures of filters")
        space, (picture, opaque, made) = "srgb", _of_planes(image, developed, planes)
    elif show == "colour":
        if wavelength is not None:
            raise DomainError("wavelength", wavelength, "is for show='degree' and 'angle'; colour takes all of them")
        _refuse(planes, "natural colour; name a palette or three filters as well")
        (picture, opaque, made) = _natural(image, **developed)
        space = str(made["colour_space"])
    else:
        _refuse({**developed, **planes}, f"show={show!r}, whose colours are fixed; leave it out")
        space, scale = "srgb", SCALES[show]
        picture, opaque = painted(image, show, wavelength)
        made = {"show": show, "wavelength_nm": wavelength, "colours": scale.colours, "range": [scale.low, scale.high]}
    made |= {} if look is None else {"look": look}
    if labels or lines:
        picture = marked(image, picture, labels, lines)
        made |= {"labels": labels, "lines": lines}
    if not opaque.all():
        picture = np.concatenate([picture, np.where(opaque, 1.0, 0.0)[..., None]], axis=-1)
    texts = {"skyscatter-recipe": json.dumps(image.recipe), "skyscatter-picture": json.dumps(made)}
    data = encode_png(picture, space, bits, texts, dither=show == "colour")
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def _of_planes(image: SpectralImage, developed: dict[str, Any], planes: dict[str, Any]) -> Planes:
    """Three filters as red, green and blue."""
    fixed = {name: developed[name] for name in ("space", "exposure")}
    _refuse(fixed, "pictures of filters, which are sRGB and take levels")
    glare = developed["glare"]
    if glare == "lens":
        raise DomainError("glare", glare, "is of natural colour; pictures of filters take none, or an aperture: hubble")
    shown = plane_picture(_through_optics(image, glare), tone=developed["tone"], **planes)
    return shown if glare is None else shown._replace(made={**shown.made, "glare": glare})


def _natural(
    image: SpectralImage,
    space: str | None,
    exposure: float | Literal["auto"] | None,
    tone: str | None,
    glare: str | None,
) -> Planes:
    """The picture in natural colour."""
    if tone == "lupton":
        raise DomainError("tone", tone, "makes a picture of three planes: name a palette or three filters as well")
    space, tone = "srgb" if space is None else space, "photograph" if tone is None else tone
    lens = None if glare is None else glare == "lens"
    seen = _through_optics(image, glare)
    picture, ev100 = seen.developed(space, "auto" if exposure is None else exposure, tone, lens)
    made = {"colour_space": space, "ev100": ev100, "tone": tone, **({} if glare is None else {"glare": glare})}
    return Planes(picture, image.inside, made)


def _through_optics(image: SpectralImage, glare: str | None) -> SpectralImage:
    """The picture with the diffraction of an aperture, where its glare is one: not ``"none"``, and not a ``"lens"``'s.

    That of a lens is added to natural colours as they are developed; see `skyscatter.image.glare`.
    """
    if glare in (None, "none", "lens"):
        return image
    from skyscatter.image.instrument import glared

    return glared(image, str(glare))


def _refuse(options: dict[str, Any], purpose: str) -> None:
    """Options that would otherwise be ignored in silence."""
    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, f"means nothing to {purpose}")


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    position = len(_SIGNATURE)
    while position + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, position)
        kind, body = data[position + 4 : position + 8], data[position + 8 : position + 8 + length]
        check = data[position + 8 + length : position + 12 + length]
        if check != struct.pack(">I", zlib.crc32(kind + body)):
            raise ValueError(f"checksum of chunk {kind!r} is wrong")
        yield kind, body
        position += 12 + length


def _text(body: bytes) -> tuple[str, str]:
    keyword, _, rest = body.partition(b"\0")
    compressed, rest = rest[0], rest[2:].split(b"\0", 2)[2]
    return keyword.decode("latin-1"), (zlib.decompress(rest) if compressed else rest).decode("utf-8")


def _average_or_paeth(kind: int, row: bytearray, above: bytes, step: int) -> None:
    """Undo filters 3 and 4 in place; other programs write them, we do not, so this may be a plain loop."""
    for i in range(len(row)):
        left, up, corner = (row[i - step], above[i], above[i - step]) if i >= step else (0, above[i], 0)
        if kind == 3:
            guess = (left + up) // 2
        else:
            estimate = left + up - corner
            guess = min((left, up, corner), key=lambda value: abs(estimate - value))
        row[i] = (row[i] + guess) & 255


def _unfiltered(data: bytes, height: int, length: int, step: int) -> NDArray[np.uint8]:
    filtered = np.frombuffer(data, dtype=np.uint8).reshape(height, length + 1)
    rows = np.zeros((height + 1, length), dtype=np.uint8)  # row 0 is the zeros above the first
    for y in range(height):
        kind, row = int(filtered[y, 0]), filtered[y, 1:]
        if kind == 1:
            rows[y + 1] = np.cumsum(row.reshape(-1, step), axis=0, dtype=np.uint8).ravel()
        elif kind in (0, 2):
            rows[y + 1] = row + rows[y] if kind == 2 else row
        elif kind in (3, 4):
            plain = bytearray(row.tobytes())
            _average_or_paeth(kind, plain, rows[y].tobytes(), step)
            rows[y + 1] = np.frombuffer(plain, dtype=np.uint8)
        else:
            raise ValueError(f"row {y} has the unknown filter {kind}")
    return rows[1:]


def _decode(data: bytes) -> Png:
    header, packed, texts, cicp = b"", bytearray(), {}, None
    for kind, body in _chunks(data):
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed += body
        elif kind == b"iTXt":
            keyword, text = _text(body)
            texts[keyword] = text
        elif kind == b"cICP":
            cicp = struct.unpack("4B", body)
    width, height, bits, colour_type, _, _, interlace = struct.unpack(">IIBBBBB", header)
    if bits not in (8, 16) or colour_type not in _CHANNELS or interlace:
        raise ValueError("only pictures of 8 or 16 bits without palette and interlacing are read")
    channels = _CHANNELS[colour_type]
    step = channels * bits // 8
    rows = _unfiltered(zlib.decompress(bytes(packed)), height, width * step, step)
    pixels = rows.view(">u2").astype(np.uint16) if bits == 16 else rows
    return Png(pixels.reshape(height, width, channels), texts, cicp)


def read_png(path: str | Path) -> Png:
    """Read the pixels and texts of a PNG file with 8 or 16 bits (grey or colour, with or without opacity).

    Raises
    ------
    MissingDataError, DomainError
        If there is no such file; if it is not a PNG file, is damaged, or is of another kind.
    """
    file = Path(path)
    if not file.is_file():
        raise MissingDataError(path, "there is no such file; check the path")
    data = file.read_bytes()
    if not data.startswith(_SIGNATURE):
        raise DomainError("picture file", str(path), "is not a PNG file")
    try:
        return _decode(data)
    except (ValueError, struct.error, zlib.error, IndexError) as error:
        raise DomainError("picture file", str(path), f"cannot be read as PNG ({error})") from error
