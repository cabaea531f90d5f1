"""OpenEXR files: a picture for every viewer, and the spectra in the published layout for spectral images.

Channels (float32, ZIP; on request R, G, B and A as half floats):

- ``R G B``: scene-linear, sRGB primaries; 1 is a white of 1 cd m-2, or of what the standard attribute
  ``whiteLuminance`` says where another scale was asked for.
  Where the image has pixels outside the camera's field, these are black there and a channel ``A`` is 0 (else 1).
- ``S0.550,000000nm``: radiance at 550 nm, in the layout of Fichet, Pacanowski and Wilkie (2021, J. Comput. Graph. Tech.
  10(3)).  Attributes ``spectralLayoutVersion`` and ``emissiveUnits``; the authors' library knows one string only for
  the latter, so that one is written, and the true unit (per nm) is in ``skyscatterRadianceUnits``.
- ``S1`` to ``S3`` in the same way: the Stokes parameters Q, U and V of a polarised image.  The layout knows ``left``
  and ``right`` for ``polarisationHandedness``; we write ``right``: the axis of Q > 0, that of Q < 0 and the direction
  in which the light travels are right-handed, and V > 0 is right-handed by the IAU's definition.  The layout fixes no
  reference plane; ours is in words in ``skyscatterStokesFrame``.  Files without that attribute keep S1 to S3 as layers
  of these names: they do not say to what plane they refer.
- ``standard_error.550,000000nm`` (``estimated_error`` of the solver ``orders``) and ``layer.NAME.550,000000nm``: our
  own, which readers of that layout pass over.

``skyscatterWavelengths`` keeps the wavelengths to the last digit (names have six decimals), ``skyscatterRecipe`` the
recipe, ``skyscatterSky`` (JSON) where a picture with celestial coordinates stands in the sky.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.colour import SPACES
from skyscatter.image.dataset import UNITS
from skyscatter.image.polarisation import FRAME, STOKES
from skyscatter.image.skyframe import read_sky
from skyscatter.image.spectral import SpectralImage

_MAGIC = b"\x76\x2f\x31\x01"
_LIGHT_NM = 2.99792458e17  # speed of light [nm s-1]
_PREFIX = {
    "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1,
    "": 1.0, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
#: Channel group of each Stokes layer.
_STOKES_GROUPS = {name: f"S{number}" for number, name in enumerate(STOKES, start=1)}
_HANDEDNESS = "right"
_BAND = re.compile(
    r"(?P<group>S[0-3]|(?:standard|estimated)_error|layer\.[A-Za-z0-9_-]+)\."
    r"(?P<number>\d+(?:,\d*)?(?:[eE][+-]?\d+)?)(?P<prefix>Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(?P<unit>m|Hz)"
)


def channel_name(group: str, wavelength_nm: float) -> str:
    """Name of the channel of one wavelength, with the decimal comma of the layout: ``S0.550,000000nm``."""
    return f"{group}.{wavelength_nm:.6f}nm".replace(".", ",").replace(",", ".", group.count(".") + 1)


def parse_channel(name: str) -> tuple[str, float] | None:
    """Group (``S0``, ``standard_error``, ``layer.NAME``) and wavelength [nm] of a channel; None for other channels."""
    match = _BAND.fullmatch(name)
    if match is None:
        return None
    value = float(match["number"].replace(",", "."))
    prefix = match["prefix"] or ""
    if match["unit"] == "Hz":
        return (match["group"], _LIGHT_NM / (value * _PREFIX[prefix])) if value > 0.0 else None
    return match["group"], value if prefix == "n" else value * _PREFIX[prefix] * 1e9


def _groups(image: SpectralImage) -> dict[str, NDArray[Any]]:
    groups = {"S0": image.radiance}
    if image.error is not None:
        groups["estimated_error" if image.error_kind == "estimated" else "standard_error"] = image.error
    for name, values in image.layers.items():
        # Readers of the layout expect all of S1 to S3 or none.
        stokes = image.polarised and name in _STOKES_GROUPS
        groups[_STOKES_GROUPS[name] if stokes else f"layer.{name}"] = values
    return groups


def _float32(values: NDArray[Any]) -> NDArray[Any]:
    return _cast(values, np.float32, "is too large for the float32 of EXR files")


def _cast(values: NDArray[Any], dtype: type, remedy: str) -> NDArray[Any]:
    with np.errstate(over="ignore"):
        cast: NDArray[Any] = np.ascontiguousarray(values, dtype=dtype)
    if np.isinf(cast).any():
        raise DomainError("radiance", float(np.nanmax(np.abs(values))), remedy)
    return cast


def check_scale(scale: float) -> None:
    """Refuse factors from cd m-2 to RGB that make no picture."""
    if not 0.0 < scale < np.inf:
        raise DomainError("scale", scale, "RGB of a white of 1 cd m-2: give a number above 0, such as 0.001")


def _spectral_channels(image: SpectralImage) -> dict[str, NDArray[Any]]:
    channels: dict[str, NDArray[Any]] = {}
    for group, cube in _groups(image).items():
        planes = _float32(np.moveaxis(cube, -1, 0))
        for wavelength, plane in zip(image.wavelengths, planes, strict=True):
            name = channel_name(group, wavelength)
            if name in channels:
                raise DomainError("wavelengths", float(wavelength), "EXR needs them at least 1e-6 nm apart")
            channels[name] = plane
    return channels


def _colour_channels(image: SpectralImage, scale: float, half: bool, opacity: bool) -> dict[str, NDArray[Any]]:
    remedy = "is too large for half floats (65504 at most): give a smaller scale, or leave out the Sun"
    rgb = image.rgb("srgb") * scale
    rgb = _cast(rgb, np.float16, remedy) if half else _float32(rgb)
    outside = np.isnan(rgb).any(axis=-1)
    rgb[outside] = 0.0
    channels: dict[str, NDArray[Any]] = {}
    for c, name in enumerate("RGB"):
        channels[name] = np.ascontiguousarray(rgb[..., c])
    if opacity or outside.any():
        channels["A"] = np.asarray(~outside, dtype=rgb.dtype)
    return channels


def _header(image: SpectralImage, spectral: bool, scale: float) -> dict[str, Any]:
    import OpenEXR

    srgb = SPACES["srgb"]
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": (*srgb.red, *srgb.green, *srgb.blue, *srgb.white),
        "whiteLuminance": 1.0 / scale,
        "software": "skyscatter",
        "skyscatterRecipe": json.dumps(image.recipe),
    }
    if image.sky is not None:
        header["skyscatterSky"] = image.sky.model_dump_json()
    if spectral:
        header["spectralLayoutVersion"] = "1.0"
        header["emissiveUnits"] = "W.m^-2.sr^-1"
        header["skyscatterRadianceUnits"] = UNITS
        header["skyscatterWavelengths"] = json.dumps(image.wavelengths.tolist())
    if spectral and image.polarised:
        header["polarisationHandedness"] = _HANDEDNESS
        header["skyscatterStokesFrame"] = FRAME
    return header


def write(
    image: SpectralImage,
    path: Path,
    spectral: bool = True,
    scale: float = 1.0,
    half: bool = False,
    opacity: bool = False,
) -> None:
    """Write an OpenEXR file.

    Parameters
    ----------
    image : SpectralImage
    path : Path
    spectral : bool
        False writes only R, G, B (and A).
    scale : float
        RGB of a white of 1 cd m-2.
    half : bool
        R, G, B and A as half floats; spectra stay float32.
    opacity : bool
        Write A even where all pixels lie inside the camera's field.
    """
    import OpenEXR

    check_scale(scale)
    channels = _colour_channels(image, scale, half, opacity)
    if spectral:
        channels.update(_spectral_channels(image))
    with atomic_path(path) as temporary:
        try:
            with OpenEXR.File(_header(image, spectral, scale), channels) as file:
                file.write(str(temporary))
        except RuntimeError as error:  # the library's word for whatever the system refused
            raise OSError(str(error)) from error


def _open(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and channels of the first part; never merges R, G, B into one array (see `separate_channels`)."""
    import OpenEXR

    with path.open("rb") as file:
        if file.read(4) != _MAGIC:  # the library would also complain on stderr
            raise DomainError("image file", str(path), "is not an OpenEXR file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            return dict(exr.header()), {name: channel.pixels for name, channel in exr.channels().items()}
    except (RuntimeError, ValueError, TypeError) as error:
        raise DomainError("image file", str(path), f"is a damaged OpenEXR file ({error})") from error


def read(path: Path) -> SpectralImage:
    """Read the spectral layers of an OpenEXR file in the layout of Fichet et al. (2021), ours or another's.

    Stokes channels S1 to S3 become the layers Q, U and V where the file states the frame of this package, else layers
    named S1, S2 and S3.
    """
    header, channels = _open(path)
    groups: dict[str, list[tuple[float, NDArray[Any]]]] = {}
    for name, pixels in channels.items():
        parsed = parse_channel(name)
        if parsed is not None:
            groups.setdefault(parsed[0], []).append((parsed[1], pixels))
    if "S0" not in groups:
        raise DomainError("image file", str(path), "has no spectral channels (S0.<wavelength>nm), only a picture")
    cubes: dict[str, NDArray[Any]] = {}
    named: dict[str, list[float]] = {}
    for group, planes in groups.items():
        planes.sort(key=lambda plane: plane[0])
        named[group] = [wavelength for wavelength, _ in planes]
        if named[group] != named["S0" if "S0" in named else group]:
            raise DomainError("image file", str(path), f"its channels {group} have other wavelengths than S0")
        cubes[group] = np.stack([pixels for _, pixels in planes], axis=-1).astype(np.float32)
    error = cubes.pop("standard_error", None)
    error = cubes.pop("estimated_error", error)
    radiance = cubes.pop("S0")
    return SpectralImage(
        radiance,
        _exact_wavelengths(header, named["S0"]),
        error,
        recipe=_json_attribute(header, "skyscatterRecipe", path) or {},
        layers={_layer_name(header, group): cube for group, cube in cubes.items()},
        sky=read_sky(header.get("skyscatterSky"), path),
    )


def _layer_name(header: dict[str, Any], group: str) -> str:
    ours = (header.get("skyscatterStokesFrame"), header.get("polarisationHandedness")) == (FRAME, _HANDEDNESS)
    names = {group: name for name, group in _STOKES_GROUPS.items()} if ours else {}
    return names.get(group, group.removeprefix("layer."))


def _exact_wavelengths(header: dict[str, Any], named: list[float]) -> list[float]:
    """Take the wavelengths as they were, where the file says so and its channel names still agree."""
    try:
        exact = json.loads(header.get("skyscatterWavelengths", "null"))
        if len(exact) == len(named) and np.allclose(exact, named, rtol=0.0, atol=1e-6):
            return [float(wavelength) for wavelength in exact]
    except (TypeError, ValueError):
        pass
    return named


def _json_attribute(header: dict[str, Any], name: str, path: Path) -> Any:
    try:
        return json.loads(header.get(name, "null"))
    except (TypeError, ValueError) as error:
        raise DomainError("image file", str(path), f"its attribute {name} is not JSON ({error})") from error
