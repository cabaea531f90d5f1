"""Radiance files (.hdr): scene-linear RGB with a shared exponent, for lighting other scenes.

Ward (1991, Graphics Gems II, "Real pixels"): each pixel has three mantissas of 8 bits and an exponent, so that its
largest component is right to 0.4 % and the others to 0.4 % of it; there are no negative components, so that colours
outside of sRGB lose them.  Lines of 8 to 32767 pixels are run-length coded, channel by channel.

Values are `scale` times the luminance of white in cd m-2.  ``EXPOSURE`` says so in the format's own way: values over it
are radiances in W m-2 sr-1 at 179 lm W-1, which Radiance's programs turn back to cd m-2.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.colour import SPACES
from skyscatter.image.exr import check_scale
from skyscatter.image.spectral import SpectralImage

#: Efficacy of white light in Radiance [lm W-1].
WHITE_EFFICACY = 179.0


def write(image: SpectralImage, path: Path, scale: float = 1.0) -> None:
    """Write the picture as a Radiance file; black outside the camera's field."""
    check_scale(scale)
    rgb = np.nan_to_num(image.rgb("srgb"), nan=0.0) * scale
    srgb = SPACES["srgb"]
    corners = " ".join(f"{value:g}" for point in (srgb.red, srgb.green, srgb.blue, srgb.white) for value in point)
    lines = [
        "#?RADIANCE",
        "SOFTWARE=skyscatter",
        f"# value = {scale:.9g} x cd m-2",
        f"# recipe={json.dumps(image.recipe)}",
        f"EXPOSURE={WHITE_EFFICACY * scale:.9g}",
        f"PRIMARIES={corners}",
        "FORMAT=32-bit_rle_rgbe",
        "",
        f"-Y {rgb.shape[0]} +X {rgb.shape[1]}",
        "",
    ]
    data = "\n".join(lines).encode("ascii") + b"".join(_line(row) for row in shared_exponent(rgb))
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def shared_exponent(rgb: NDArray[Any]) -> NDArray[np.uint8]:
    """Pixels (y, x, 3) as red, green, blue and exponent, shape (y, x, 4)."""
    positive = np.maximum(rgb, 0.0)
    largest = positive.max(axis=-1)
    if not largest.max(initial=0.0) < 1e38:
        raise DomainError("radiance", float(largest.max()), "is too large for .hdr files; give a smaller scale")
    _, exponent = np.frexp(largest)
    # A mantissa that rounds to 256 takes the next exponent.
    exponent += np.rint(np.ldexp(largest, 8 - exponent)) > 255
    lit = largest > 1e-38
    mantissa = np.where(lit[..., None], np.rint(np.ldexp(positive, (8 - exponent)[..., None])), 0)
    return np.concatenate([mantissa, np.where(lit, exponent + 128, 0)[..., None]], axis=-1).astype(np.uint8)


def _line(pixels: NDArray[np.uint8]) -> bytes:
    """One row (x, 4), run-length coded where the format allows it."""
    width = len(pixels)
    if not 8 <= width <= 32767:
        return pixels.tobytes()
    return bytes([2, 2, width >> 8, width & 255]) + b"".join(_runs(pixels[:, k].tobytes()) for k in range(4))


def _runs(values: bytes) -> bytes:
    """A channel as runs (128 + length, value) of four and more, and literal stretches (length, values) of up to 128."""
    row = np.frombuffer(values, np.uint8)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(row)) + 1, [row.size]])
    out, literal = bytearray(), bytearray()

    def flush() -> None:
        for k in range(0, len(literal), 128):
            out.append(len(literal[k : k + 128]))
            out.extend(literal[k : k + 128])
        literal.clear()

    for start, stop in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        length = stop - start
        if length < 4:
            literal.extend(values[start:stop])
            continue
        flush()
        for k in range(0, length, 127):
            out.extend((128 + min(127, length - k), values[start]))
    flush()
    return bytes(out)
