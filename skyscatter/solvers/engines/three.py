"""Folders that @takram/three-atmosphere loads: textures of half floats, and the parameters that go with them.

The package multiplies what its textures hold by ``skyRadianceToLuminance``, and transmitted sunlight by
``sunRadianceToLuminance``, both divided by the luminance of the latter.  It means radiances at three wavelengths.  Here
textures hold luminances in linear sRGB that were summed over whole spectra, times a power of two that makes the most of
half floats, and ``skyRadianceToLuminance`` takes it back.  The Sun's factors stay those of the package, so that
exposures keep their meaning; ``solarIrradiance`` is such that their product is our Sun's light.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.colour import colour_space, luminance_weights
from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.engines.bruneton import Layout
from skyscatter.solvers.engines.deviation import deviations
from skyscatter.solvers.engines.textures import Source, Textures, hazes, make_textures, textured_top

if TYPE_CHECKING:
    from skyscatter.media.medium import Medium
    from skyscatter.solvers.field import RadianceField

Array = NDArray[np.float64]

#: Version of the package whose loader and shaders this was made for.
PACKAGE = "@takram/three-atmosphere 0.19"
#: Its ``sunRadianceToLuminance``: [lm W-1 nm], so that irradiances at 680, 550 and 440 nm become linear sRGB.
SUN_TO_LUMINANCE = np.array([98242.786222, 69954.398112, 66475.012354])
#: Largest number that textures get: half floats end at 65504.
LARGEST = 32768.0
#: Least transmittance: the package divides by it.
LEAST_TRANSMITTANCE = 1e-6
#: Lowest Sun, in units of the angle under which the top of the air sinks below the horizon.  Sunlight that was
#: scattered once has left the whole sky at 2, the zenith at 1.
LOWEST_SUN = 1.2
#: What wavelengths must cover for colours [nm].
COLOURS = (450.0, 650.0)
#: The package divides by the solid angle of the Sun's disk [rad].
LEAST_SUN_RADIUS = 1e-5


def export_three(
    field: RadianceField,
    folder: str | os.PathLike[str],
    threads: int,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Write five textures and ``atmosphere.json``, and return what the latter holds."""
    layout = _layout(field)
    source = Source.of(field, layout)
    textures = make_textures(source, threads, progress)
    images, gain = packed(textures)
    content = _describe(source, gain, deviations(source, _kept(textures, gain)))
    write_folder(Path(folder), images, content)
    return content


def write_folder(folder: Path, images: dict[str, Array], content: dict[str, Any]) -> None:
    """Textures and what belongs to them: all are written before the first is moved into place."""
    text = json.dumps(content, indent=1, allow_nan=False)
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as files:  # what is opened first is moved last
        files.enter_context(atomic_path(folder / "atmosphere.json")).write_text(text + "\n", encoding="utf-8")
        for name, image in images.items():
            _write(image, files.enter_context(atomic_path(folder / f"{name}.exr")))


def needed_suns(medium: Medium) -> tuple[float, float]:
    """Elevations of the Sun for which a field must be solved, lowest and highest [degree]."""
    return float(np.floor(np.degrees(_lowest_sun(medium)))), 90.0


def _lowest_sun(medium: Medium) -> float:
    return -LOWEST_SUN * float(np.arccos(medium.radius / (medium.radius + medium.top)))


def check_colours(wavelengths: Array) -> None:
    """Refuse wavelengths [nm] without red, green and blue."""
    low, high = COLOURS
    if wavelengths[0] > low or wavelengths[-1] < high or wavelengths.size < 3:
        remedy = f"textures have colours: three or more, from {low:g} nm or less to {high:g} nm or more"
        raise DomainError("wavelengths", wavelengths.tolist(), remedy)


def _layout(field: RadianceField) -> Layout:
    medium = field.scene.medium
    check_colours(field.wavelengths)
    needed = needed_suns(medium)
    # An observer sees air that has other Suns: solved ranges are wider than asked for.
    beyond = 2 * float(np.arccos(medium.radius / (medium.radius + medium.top)))
    if field.zenith[0] > 0 or field.zenith[1] < min(np.pi / 2 - np.radians(needed[0]) + beyond, np.pi) - 1e-6:
        have = tuple(round(90 - float(np.degrees(z)), 1) for z in field.zenith[::-1])
        raise DomainError("sun_elevations_deg", have, f"textures need all Suns: solve with sun_elevations_deg={needed}")
    top = textured_top(field.at(field.sun(90.0, 0.0)))
    return Layout(medium.radius, medium.radius + top, float(np.sin(_lowest_sun(medium))))


def _unit() -> float:
    """Luminance of 1 in the package's pictures [cd m-2]: of radiance 1 at its three wavelengths."""
    # Its weights of red, green and blue are rounded: 0.2126, 0.7152, 0.0722.
    return float(np.round(luminance_weights(colour_space("srgb")), 4) @ SUN_TO_LUMINANCE)


def packed(textures: Textures) -> tuple[dict[str, Array], float]:
    """Pictures (row, column, channel) of the files, from the top, by their names; and the factor that they hold."""
    light = textures[1:]
    largest = max(float(np.abs(x).max()) for x in light) / _unit()
    if not largest > 0:
        raise DomainError("star", largest, "gives no light that eyes see: textures would be black")
    gain = float(2.0 ** np.floor(np.log2(LARGEST / largest)))
    a, b, higher, irradiance = (x * (gain / _unit()) for x in light)
    images = {
        "transmittance": _with_alpha(np.maximum(textures.transmittance, LEAST_TRANSMITTANCE), 1.0),
        # For programs that load no single_mie_scattering: red of B, from which the package guesses the rest.
        "scattering": _with_alpha(_slices(a), _slices(b)[..., :1]),
        "single_mie_scattering": _with_alpha(_slices(b), 1.0),
        "higher_order_scattering": _with_alpha(_slices(higher), 0.0),
        "irradiance": _with_alpha(irradiance, 1.0),
    }
    # The first texel of a texture is the lowest one, the first row of a file the highest.
    return {name: image[::-1] for name, image in images.items()}, gain


def _slices(texture: Array) -> Array:
    """Scattering (r, mu, mu_s, nu, channel) as slices over r below each other, with blocks over nu side by side."""
    r, mu, mu_s, nu, channels = texture.shape
    return np.moveaxis(texture, 3, 2).reshape(r * mu, nu * mu_s, channels)


def _with_alpha(rgb: Array, alpha: Array | float) -> Array:
    return np.concatenate([rgb, np.broadcast_to(alpha, (*rgb.shape[:-1], 1))], axis=-1)


def _kept(textures: Textures, gain: float) -> Textures:
    """Textures as half floats keep them."""
    factor = gain / _unit()
    return Textures(textures[0], *((x * factor).astype(np.float16).astype(float) / factor for x in textures[1:]))


def _write(image: Array, path: Path) -> None:
    import OpenEXR

    half = image.astype(np.float16)
    channels = {name: np.ascontiguousarray(half[..., k]) for k, name in enumerate("RGBA")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "software": "skyscatter"}
    try:
        with OpenEXR.File(header, channels) as file:
            file.write(str(path))
    except RuntimeError as error:  # the library's word for whatever the system refused
        raise OSError(str(error)) from error


def _describe(source: Source, gain: float, found: list[dict[str, float]]) -> dict[str, Any]:
    """What ``atmosphere.json`` holds; vectors and colours as the package's classes have them."""
    from skyscatter import __version__

    optics, scene = source.table.optics, source.field.scene
    whole = source.sunlight @ source.rgb
    haze = hazes(source.table)
    depth = outward_profile(source.table.columns)[0][:, None]
    columns = (depth[~haze].T @ optics.sigma_s[~haze], depth[haze].T @ optics.sigma_s[haze],
               depth[haze].T @ optics.sigma_t[haze])  # fmt: skip
    # The package has lengths in km, and uses these only to tell hazes from air where it loads no texture of B.
    rayleigh, mie, mie_extinction = (
        ((source.sunlight * x[0]) @ source.rgb / whole) / (source.layout.top - source.layout.bottom) * 1e3
        for x in columns
    )
    albedo = (source.sunlight * optics.albedo) @ source.rgb / whole
    sky = _unit() / gain
    return {
        "skyscatter": __version__,
        "for": PACKAGE,
        "scene": scene.model_dump(mode="json", exclude={"sun", "altitude"}, exclude_none=True),
        "wavelengths_nm": source.field.wavelengths.tolist(),
        "loader": {"format": "exr", "combinedScattering": False, "higherOrderScattering": True},
        "atmosphere": {
            "solarIrradiance": _vector(whole / SUN_TO_LUMINANCE),
            "sunAngularRadius": max(float(optics.disk_radius), LEAST_SUN_RADIUS),
            "bottomRadius": source.layout.bottom,
            "topRadius": source.layout.top,
            "rayleighScattering": _vector(rayleigh),
            "mieScattering": _vector(mie),
            "mieExtinction": _vector(mie_extinction),
            "miePhaseFunctionG": source.asymmetry,
            "groundAlbedo": dict(zip("rgb", np.clip(albedo, 0.0, 1.0).tolist(), strict=True)),
            "muSMin": source.layout.mu_s_min,
            "sunRadianceToLuminance": _vector(SUN_TO_LUMINANCE),
            "skyRadianceToLuminance": _vector(np.full(3, sky)),
        },
        "cd_per_m2_of_1": _unit(),
        "deviations": found,
    }


def _vector(values: Array) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))
