"""Scene files that put a dome and its Sun into other programs: the sky where it belongs, and the lamp in its unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError
from skyscatter.image.dome import lamp
from skyscatter.image.hdr import WHITE_EFFICACY
from skyscatter.image.spectral import SpectralImage

#: Angle of a Sun that is a point, for programs whose suns have disks [degree].
POINT_DEG = 0.01


def _mitsuba(found: dict[str, Any], dome: Path) -> list[str]:
    """Of Mitsuba 3, to be included: seen from inside its maps have +y up, +z in the middle and +x on the left."""
    azimuth = np.radians(found["dome"]["middle_azimuth_deg"])
    sine, cosine = round(float(np.sin(azimuth)), 12), round(float(np.cos(azimuth)), 12)
    rows: list[list[float]] = [[-cosine, 0, sine, 0], [sine, 0, cosine, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    matrix = " ".join(f"{value:.12g}" for row in rows for value in row)
    sun = found["sun"]
    away = [f'{axis}="{-value:.9g}"' for axis, value in zip("xyz", sun["direction"], strict=True)]
    rgb = ", ".join(f"{value:.7g}" for value in sun["rgb"])
    text = f"""<!-- {dome.name} and its Sun; x is east, y north, z up. Made by skyscatter. -->
<scene version="3.0.0">
    <emitter type="envmap">
        <string name="filename" value="{dome.name}"/>
        <transform name="to_world"><matrix value="{matrix}"/></transform>
    </emitter>
    <emitter type="directional">
        <vector name="direction" {" ".join(away)}/>
        <rgb name="irradiance" value="{rgb}"/>
    </emitter>
</scene>
"""
    return [text]


def _radiance(found: dict[str, Any], dome: Path) -> list[str]:
    """Of Radiance: a picture mapped onto a glow that surrounds the scene, and a light; its unit is W m-2 sr-1."""
    sun, name = found["sun"], dome.stem
    angle = max(sun["angular_diameter_deg"], POINT_DEG)
    solid_angle = 2 * np.pi * (1 - np.cos(np.radians(angle / 2)))
    # What is mapped is the numbers of the file: the EXPOSURE in its header is for programs that show pictures.
    to_watts = 1 / (WHITE_EFFICACY * found["dome"]["rgb_per_cd_m-2"])
    rgb = " ".join(f"{value * to_watts / solid_angle:.7g}" for value in sun["rgb"])
    glow = " ".join([f"{to_watts:.7g}"] * 3)
    direction = " ".join(f"{value:.9g}" for value in sun["direction"])
    scene = f"""# {dome.name} and its Sun; x is east, y north, z up. Made by skyscatter.
void colorpict sky_picture
7 red green blue {dome.name} {name}.cal sky_u sky_v
0
0
sky_picture glow sky_glow
0
0
4 {glow} 0
sky_glow source sky
0
0
4 0 0 1 360
void light sun_light
0
0
3 {rgb}
sun_light source sun
0
0
4 {direction} {angle:.6g}
"""
    turned = found["dome"]["middle_azimuth_deg"] / 360.0
    mapping = f"""{{ Where a direction stands in {dome.name}: azimuth to the right, elevation upwards. }}
sky_x = atan2(Dx, Dy) / (2*PI) + {0.5 - turned:.12g};
sky_u = 2 * (sky_x - floor(sky_x));
sky_v = 0.5 + atan2(Dz, sqrt(Dx*Dx + Dy*Dy)) / PI;
"""
    return [scene, mapping]


class _Program(NamedTuple):
    texts: Callable[[dict[str, Any], Path], list[str]]  #: of what `lamp` found and the dome's file
    suffixes: tuple[str, ...]  #: of the files that they go into
    domes: tuple[str, ...]  #: that it reads


_PROGRAMS = {
    "mitsuba": _Program(_mitsuba, (".mitsuba.xml",), (".exr", ".hdr")),
    "radiance": _Program(_radiance, (".rad", ".cal"), (".hdr",)),
}


def scene_files(dome: Path, program: str) -> list[Path]:
    """Names of the scene files of a program that belong to a dome; `DomainError` where it cannot read that one."""
    if program not in _PROGRAMS:
        rule = f"choose one of {', '.join(_PROGRAMS)}; Blender's angles are in the .sun.json of every dome"
        raise DomainError("for", program, rule)
    known = _PROGRAMS[program]
    if dome.suffix.lower() not in known.domes:
        raise DomainError("for", program, f"takes {' or '.join(known.domes)}: write -o {dome.stem}{known.domes[0]}")
    return [dome.with_suffix(suffix) for suffix in known.suffixes]


def check_dome(program: str, camera: Mapping[str, Any]) -> None:
    """Refuse cameras, as fields of a recipe, that see no whole sphere or not in square pixels."""
    sphere = {"kind": "panorama", "elevation_min_deg": -90.0, "elevation_max_deg": 90.0, "fov_deg": 360.0}
    if any(camera.get(name) != value for name, value in sphere.items()) or camera["width"] != 2 * camera["height"]:
        raise DomainError("for", program, "needs a dome of the whole sphere, twice as wide as high: --view panorama")


def write_scene(image: SpectralImage, dome: Path, program: str, scale: float = 1.0) -> list[Path]:
    """Write the scene files of a program beside a dome.

    Parameters
    ----------
    image : SpectralImage
        Rendered without the Sun's disk, a panorama of the whole sphere.
    dome : Path
        Its file, which the scene names: ``.exr`` or ``.hdr``, for Radiance the latter.
    program : {"mitsuba", "radiance"}
    scale : float
        RGB of a white of 1 cd m-2 in that file.

    Returns
    -------
    list of Path
        ``dome.mitsuba.xml``, or ``dome.rad`` and ``dome.cal``.

    Raises
    ------
    DomainError
        For another program, for a picture that is no dome, and if the image has its Sun.
    """
    files = scene_files(dome, program)
    found = lamp(image, scale)
    check_dome(program, image.recipe["camera"])
    for path, text in zip(files, _PROGRAMS[program].texts(found, dome), strict=True):
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return files
