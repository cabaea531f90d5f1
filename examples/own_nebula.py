"""A nebula of your own: an analytic core, a turbulent halo on a grid and particles, in one density field."""

from __future__ import annotations

import os

import numpy as np

import skyscatter
from skyscatter import fields

PC = 3.0857e16  # metres
width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "128"))
random = np.random.default_rng(1)

core = fields.Plummer(radius="0.1 pc", cut="0.5 pc")
clouds = fields.Turbulence(outer_scale="0.5 pc", inner_scale="0.05 pc", seed=3)
ball = fields.GaussianSphere(width="0.25 pc")
halo = fields.VoxelGrid.from_field(ball * clouds, cells=48, low=[-PC] * 3, high=[PC] * 3)
knots = fields.ParticleSet(
    positions=random.normal([0.4, 0.2, 0.0], 0.08, (400, 3)),
    length_unit="1 pc",
    factor=0.5 * (0.08 * PC) ** 3 / 400 * (2 * np.pi) ** 1.5,  # a density of one half in the middle
)
density = core + 0.1 * halo + knots

scene = skyscatter.SpaceScene(
    medium=skyscatter.Medium(
        components=(skyscatter.Component(name="dust", density=density, optics=skyscatter.Dust(hydrogen_density=3e10)),)
    ),
    stars=(skyscatter.PointStar(position=("0.25 pc", "0 pc", "0.2 pc"), temperature=12000, luminosity=500),),
    background="interstellar",
    view=skyscatter.View(ra_deg=84.0, dec_deg=-2.0, distance="400 pc", inclination_deg=30),
)
camera = skyscatter.Telescope.from_length(width, width, 1.6 * PC, scene.view.distance)
image = skyscatter.render(scene, camera, [450, 550, 650], solver=skyscatter.Path(samples=8))
image = image.placed(skyscatter.SkyFrame.seen(scene.view, camera, "own nebula"))
image.save("own_nebula.png")
image.save("own_nebula.fits")

# The parts add up: the column of the whole is the sum of theirs.
line = ([-0.3 * PC, 0.1 * PC, -PC], [0.5 * PC, 0.2 * PC, PC])
parts = core.column(*line) + 0.1 * halo.column(*line) + knots.column(*line)
print(f"own_nebula.png: a column of {density.column(*line) / PC:.4f} pc, of its parts {parts / PC:.4f} pc")
assert abs(density.column(*line) / parts - 1) < 1e-6
