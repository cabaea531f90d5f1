"""A planet of your own, built in Python, saved as a model file, loaded again and looked at under its red star."""

from __future__ import annotations

import os

import numpy as np

import skyscatter
from skyscatter.media.fields import Exponential, Tent
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import DoubleHenyeyGreenstein
from skyscatter.optics.rayleigh import RayleighPowerLaw

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "192"))

air = skyscatter.Component(
    name="air",
    density=Exponential(scale_height="6 km"),
    optics=RayleighPowerLaw(coefficient=2.5e-5, wavelength="550 nm"),
)
cloud = skyscatter.Component(
    name="high haze",
    density=Tent(base="20 km", peak="25 km", top="40 km"),
    optics=Particles(
        optical_depth=0.2,
        angstrom_exponent=0.5,
        single_scattering_albedo=0.99,
        phase=DoubleHenyeyGreenstein(g_forward=0.8, g_backward=-0.4, forward_fraction=0.9),
    ),
)
model = skyscatter.Model(
    name="my-planet",
    description="A large planet close to a red dwarf.",
    planet=skyscatter.Planet(name="Mine", radius="9000 km"),
    ground=skyscatter.Ground(albedo="sand"),
    star=skyscatter.Star(spectrum="blackbody", temperature=3300, radius=1.4e8, distance="0.05 au"),
    components=(air, cloud),
)
model.save("my-planet.toml")
again = skyscatter.load_model("my-planet.toml")
assert again == model

scene = again.scene(sun_elevation_deg=12)
camera = skyscatter.Perspective(width=width, height=width * 5 // 8, azimuth_deg=180, elevation_deg=20, fov_deg=80)
skyscatter.render(scene, camera, np.arange(380, 781, 10)).save("my-planet.png")

ground = scene.observer.position
tau = skyscatter.optical_depth(scene, ground, ground + np.array([0, 0, again.top]), [550.0])[0]
print(f"my-planet.toml, my-planet.png: vertical optical depth at 550 nm {tau:.4f}")

# By hand: coefficient times scale height, and the haze. The shell ends where 1e-7 of the air is left.
assert abs(tau - (2.5e-5 * 6000 + 0.2)) < 1e-6
