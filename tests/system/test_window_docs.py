"""The readers in docs/howto-sky-table.md: they run, and give the table's own numbers."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from window_skies import in_browser, views

from skyscatter.window.table import SkySettings, SkyTableFile, default_table, make_table

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto-sky-table.md"


def block(language: str, beginning: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return next(text for text in found if beginning in text)


def reader() -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(block("python", "def read"), names)
    return names


@pytest.mark.parametrize("model", ["earth", "mars"])
def test_the_reader_in_numpy(model: str, tmp_path: Path) -> None:
    """Of the shipped table and a quick one of Mars, whose dust has a peak that widens."""
    table = SkyTableFile.from_bytes(default_table()) if model == "earth" else make_table(SkySettings(model), quick=True)
    table.save(tmp_path / "sky.bin")
    names = reader()
    read = names["read"](tmp_path / "sky.bin")
    for sun, directions in views(7, 6):
        own = table.xyz(directions, sun, 0.0, disk=False)
        found = [names["sky"](read, direction, sun, 0.0) for direction in directions]
        np.testing.assert_allclose(found, own, rtol=1e-9)


GLSL = """
const gl = canvas.getContext("webgl2");
if (!gl || !gl.getExtension("EXT_color_buffer_float")) out.skipped = true;
else {
  const program = gl.createProgram();
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, `#version 300 es
      void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }`],
    [gl.FRAGMENT_SHADER, `#version 300 es
      precision highp float; precision highp int; precision highp sampler2D; precision highp sampler2DArray;
      ${reader}
      uniform vec3 rays[64];
      out vec4 found;
      void main() { found = vec4(sky(rays[int(gl_FragCoord.x)]), 1.0); }`],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  const place = name => gl.getUniformLocation(program, name);
  const bound = (unit, kind) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(kind, gl.createTexture());
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(kind, gl[name], gl.NEAREST);
  };
  bound(0, gl.TEXTURE_2D_ARRAY);
  gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA32F, size[0], size[1], size[2], 0, gl.RGBA, gl.FLOAT,
    new Float32Array(logs));
  bound(1, gl.TEXTURE_2D);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32F, phases.length / (size[2] - 1), size[2] - 1, 0, gl.RED, gl.FLOAT,
    new Float32Array(phases));
  gl.uniform1i(place("phases"), 1);
  gl.uniform1fv(place("elevations"), elevations);
  gl.uniform1fv(place("turns"), turns);
  gl.uniform3fv(place("rays"), rays.flat());
  gl.uniform3fv(place("sun"), sun);
  gl.uniform1f(place("horizon"), horizon);
  for (const [name, value] of Object.entries({below, columns: size[0], rows: size[1], blocks: size[2]})) {
    gl.uniform1i(place(name), value);
  }
  bound(2, gl.TEXTURE_2D);
  const target = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 64, 1, 0, gl.RGBA, gl.FLOAT, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, 64, 1);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = new Float32Array(64 * 4);
  gl.readPixels(0, 0, 64, 1, gl.RGBA, gl.FLOAT, pixels);
  out.found = Array.from(pixels);
}
"""


def test_the_reader_in_a_shader(tmp_path: Path) -> None:
    table = SkyTableFile.from_bytes(default_table())
    elevation, azimuth = 14.0, 0.0
    directions = np.concatenate([d for _, d in views(9, 8)])
    under = np.moveaxis(table._under(elevation, {}), 1, -1)  # (block, elevation, turn, 3)
    logs = np.concatenate([under, np.zeros((*under.shape[:3], 1))], axis=-1)
    given = {
        "reader": block("glsl", "vec3 sky"),
        "size": [logs.shape[2], logs.shape[1], logs.shape[0]],
        "logs": logs.ravel().tolist(),
        "phases": table.arrays["phase"].ravel().tolist(),
        "elevations": table.arrays["elevation"].tolist(),
        "turns": table.arrays["turn"].tolist(),
        "rays": directions.tolist(),
        "sun": [0.0, float(np.cos(np.radians(elevation))), float(np.sin(np.radians(elevation)))],
        "horizon": table.header["horizon"],
        "below": table.header["below"],
    }
    script = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items()) + GLSL
    out = in_browser(b"", script, tmp_path, (64, 1))
    if "skipped" in out:
        pytest.skip("this chromium draws no floats with WebGL2: the shader is not tested")
    own = table.xyz(directions, elevation, azimuth, disk=False)
    # Single precision: the arc of the elevation to 1e-7, and light that falls by ratios of it beside the horizon.
    np.testing.assert_allclose(np.reshape(out["found"], (64, 4))[:, :3], own, rtol=3e-3)
