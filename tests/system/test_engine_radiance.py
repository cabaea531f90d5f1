"""Domes and their Suns in Radiance: sensors of every tilt get the light that skyscatter says.

Tolerance 1 %: Radiance reads a mantissa of 8 bits as half a step more than it says, 0.2 to 0.4 % of the brightest
channel of a pixel and more of the others.  All planes are too bright by that.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from domes import SUNS, make_dome, normals, own_irradiances
from numpy.typing import NDArray

from skyscatter.image.hdr import WHITE_EFFICACY

Array = NDArray[np.float64]
TOLERANCE = 0.01
#: Of the indirect light, which the sky is to Radiance: one bounce, so many directions, no interpolation.
OPTIONS = ("-h", "-I", "-ab", "1", "-ad", "262144", "-as", "0", "-aa", "0", "-lr", "4", "-lw", "0",
           "-u-")  # fmt: skip


@pytest.fixture(scope="module")
def programs() -> Path:
    """The folder of Radiance's programs: of an installation, or of the package pyradiance."""
    if found := shutil.which("rtrace"):
        return Path(found).parent
    spec = find_spec("pyradiance")
    if spec is None or spec.origin is None:
        pytest.skip("Radiance is not installed (pip install pyradiance)")
    return Path(spec.origin).parent / "bin"


def illuminances(programs: Path, folder: Path, scene: str) -> Array:
    """What sensors at the origin get from a scene in a folder, in its RGB [lx]; (normal, 3)."""
    path = [str(folder), os.environ.get("RAYPATH", ""), str(programs.parent / "lib")]
    environment = os.environ | {"RAYPATH": ":".join(filter(None, path))}
    octree = folder / "scene.oct"
    octree.write_bytes(
        subprocess.run([programs / "oconv", scene], cwd=folder, env=environment, check=True, stdout=-1).stdout
    )
    rays = "".join(f"0 0 0 {x:.12g} {y:.12g} {z:.12g}\n" for x, y, z in normals())
    command = [programs / "rtrace", *OPTIONS, octree.name]
    done = subprocess.run(command, cwd=folder, env=environment, check=True, input=rays.encode(), stdout=-1)
    return WHITE_EFFICACY * np.array([[float(x) for x in line.split()] for line in done.stdout.decode().splitlines()])


@pytest.mark.slow
@pytest.mark.parametrize("sun", sorted(SUNS))
def test_dome_and_sun_light_sensors_of_every_tilt(programs: Path, sun: str, tmp_path: Path) -> None:
    make_dome(tmp_path, sun, "dome.hdr", program="radiance")
    own = own_irradiances(sun)
    found = illuminances(programs, tmp_path, "dome.rad")
    off = found / own - 1
    print(sun, "greatest", np.abs(off).max(axis=0), "mean", off.mean(axis=0))
    np.testing.assert_allclose(found, own, rtol=TOLERANCE)
    mapping = tmp_path / "dome.cal"
    mapping.write_text(mapping.read_text().replace("atan2(Dx, Dy)", "atan2(-Dx, Dy)"))  # east and west exchanged
    assert np.abs(illuminances(programs, tmp_path, "dome.rad") / own - 1).max() > 0.05
