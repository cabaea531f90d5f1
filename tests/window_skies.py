"""What tests of the window share: views of a sky, colour differences, and a browser without a screen."""

from __future__ import annotations

import base64
import html
import json
import re
import shutil
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.colour import SPACES, rgb_to_xyz_matrix

SCRIPT = Path(skyscatter.__file__).parent / "window" / "assets" / "sky.js"
WAVELENGTHS = np.arange(380.0, 781.0, 10.0)  # those of `skyscatter sky`
#: Elevations from the horizon, either side, that are no part of a picture's pixel [degree].
EDGE = 0.01


def views(seed: int, suns: int, low: float = -12.0) -> list[tuple[float, np.ndarray]]:
    """Suns at azimuth 0, half of them low, each with directions: all over the sky, at the horizon, about the Sun."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(suns):
        sun = random.uniform(low, 90.0 if k % 2 else 8.0)
        azimuth = np.concatenate([random.uniform(0, 360, 6), random.normal(0, 8, 2)])
        high = np.degrees(np.arcsin(random.uniform(0, 1, 3)))
        horizon = random.uniform(-0.5, 4.0, 2)
        below = random.uniform(-60.0, -2.0, 1)
        beside = np.clip(sun + random.normal(0, 6, 2), 0.5, 89.0)
        elevation = np.concatenate([high, horizon, below, beside])
        elevation[np.abs(elevation + 0.0454) < EDGE] = EDGE  # the horizon of an observer at 2 m on Earth
        found.append((float(sun), direction_from_azimuth_elevation(azimuth, elevation)))
    return found


def judge() -> Any:
    """colour-science."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it remarks on optional packages
        import colour
    return colour


def lab(xyz: np.ndarray) -> np.ndarray:
    """CIELAB of XYZ whose white is D65 of luminance 1."""
    return np.asarray(judge().XYZ_to_Lab(np.maximum(xyz, 0.0), np.array([0.3127, 0.3290])))


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """ΔE 2000 under one Sun; exposed so that the median of `b` is half as light as white, and nothing lighter."""
    scale = np.minimum(0.5 / np.median(b[:, 1]), 1.0 / b[:, 1:2])
    return np.asarray(judge().delta_E(lab(scale * a), lab(scale * b), method="CIE 2000"))


def picture_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """ΔE 2000 of pixels in sRGB, 0 to 1."""
    matrix = rgb_to_xyz_matrix(SPACES["srgb"])
    first, second = (np.where(p <= 0.04045, p / 12.92, ((p + 0.055) / 1.055) ** 2.4) @ matrix.T for p in (a, b))
    return np.asarray(judge().delta_E(lab(first), lab(second), method="CIE 2000"))


def in_browser(table: bytes, script: str, folder: Path, size: tuple[int, int]) -> dict[str, Any]:
    """What a script leaves in `out`, run beside sky.js with `canvas` and the table's `buffer`."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium on this machine: what a browser draws is not tested")
    page = f"""<!doctype html><canvas id="sky" width="{size[0]}" height="{size[1]}"></canvas><pre id="out"></pre>
<script type="module">
{SCRIPT.read_text(encoding="utf-8")}
const buffer = Uint8Array.from(atob("{base64.b64encode(table).decode()}"), c => c.charCodeAt(0)).buffer;
const canvas = document.getElementById("sky"), out = {{}};
try {{ {script} }} catch (error) {{ out.error = `${{error}} ${{error.stack}}`; }}
document.getElementById("out").textContent = JSON.stringify(out);
</script>"""
    path = folder / "page.html"
    path.write_text(page, encoding="utf-8")
    command = [
        chromium, "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader", f"--user-data-dir={folder / 'profile'}", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    shown = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    found = re.search(r'<pre id="out">(.*?)</pre>', shown.stdout, re.DOTALL)
    assert found, shown.stderr[-2000:]
    out: dict[str, Any] = json.loads(html.unescape(found.group(1)))
    assert "error" not in out, out
    return out


def pixels(url: str, folder: Path) -> np.ndarray:
    """Pixels (y, x, 4) of a canvas, 0 to 1, from its data URL."""
    from PIL import Image

    path = folder / "canvas.png"
    path.write_bytes(base64.b64decode(url.split(",")[1]))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGBA"), float) / 255
