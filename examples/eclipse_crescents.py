"""The Sun in an eclipse, under leaves: every gap between them throws its image on the ground, a crescent."""

from __future__ import annotations

import os

import numpy as np

import skyscatter
from skyscatter.solvers.eclipse import eclipse_of
from skyscatter.surfaces import Body, Box, Lambert, Mesh

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "240"))
samples = int(os.environ.get("SKYSCATTER_EXAMPLE_SAMPLES", "32"))
wavelengths = np.arange(400, 701, 100 if width < 200 else 50)

air = skyscatter.load_model("earth")
open_air = air.scene_at(42.85, -106.32, "2017-08-21T17:20:00Z", altitude=1.7)
eclipse = eclipse_of(open_air)
assert eclipse is not None

# A roof of leaves with gaps of two to three centimetres, so high that the Sun's image is six centimetres wide.
high, pitch, half = 5.0, 0.005, np.array([1.6, 1.2])
rng = np.random.default_rng(8)
nodes = [np.arange(-a, a + pitch / 2, pitch) for a in half]
x, y = np.meshgrid(*nodes, indexing="ij")
number = np.arange(x.size).reshape(x.shape)
middle_x, middle_y = x[:-1, :-1] + pitch / 2, y[:-1, :-1] + pitch / 2
leafy = np.ones(middle_x.shape, bool)
for gap_x, gap_y, radius in zip(*(rng.uniform(-a, a, 170) for a in half), rng.uniform(0.008, 0.016, 170), strict=True):
    leafy &= np.hypot(middle_x - gap_x, middle_y - gap_y) > radius
a, b, c, d = (n[leafy] for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])

# The middle of the roof stands where the Sun shines through it on the place that is looked at.
sun, seen = open_air.sun.direction, np.array([0.0, 1.7, 0.0])
above = seen + sun * high / sun[2]
leaf = Lambert(albedo=0.05)
roof = Mesh(
    vertices=np.stack([x + above[0], y + above[1], np.full(x.shape, high)], axis=-1).reshape(-1, 3), faces=faces
)
around = [
    Box(position=(above[0] + sx * (half[0] + 6), above[1], high), size=(12, 24 + 2 * half[1], 0.01)) for sx in (-1, 1)
] + [Box(position=(above[0], above[1] + sy * (half[1] + 6), high), size=(2 * half[0], 12, 0.01)) for sy in (-1, 1)]
bodies = [Body(name="leaves", shape=roof, material=leaf)]
bodies += [Body(name=f"more leaves {n}", shape=box, material=leaf) for n, box in enumerate(around)]

scene = open_air.model_copy(update={"bodies": tuple(bodies), "ground": skyscatter.Ground(albedo="sand")})
camera = skyscatter.Perspective(width=width, height=width * 5 // 8, azimuth_deg=0, elevation_deg=-42, fov_deg=34)
walks = skyscatter.Path(samples=samples, seed=1)
image = skyscatter.render(scene, camera, wavelengths, solver=walks, halves=True)
image.denoised().save("eclipse_crescents.png")
covered, light = 1 - float(eclipse.light([550.0])[0]), image.luminance()
bright = light.max() / np.median(light)
print(
    f"the Moon covers {covered:.0%} of the Sun's light; crescents are up to {bright:.0f} times as bright as the shade"
)
assert 0.6 < covered < 0.75
assert bright > 3
