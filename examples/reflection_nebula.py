"""A reflection nebula, dust around a hot star, through a telescope: a picture, and FITS with sky coordinates."""

from __future__ import annotations

import os

import numpy as np

import skyscatter

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "128"))
wavelengths = np.array([400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0])

model = skyscatter.load_model("reflection-nebula")
scene = model.scene()
camera = skyscatter.Telescope.from_field_of_view(width, width, 0.2)  # 12 arc minutes
image = skyscatter.render(scene, camera, wavelengths, solver=skyscatter.Path(samples=8))
image = image.placed(skyscatter.SkyFrame.seen(scene.view, camera, model.name))
image = skyscatter.observe(image, psf="gaussian:8")  # arc seconds
image.save("reflection_nebula.png", exposure=-6.5)
image.save("reflection_nebula.fits")

# Colour of the nebula, without the star in the middle of the picture, against that of the star itself.
light = np.array(image.radiance)
middle = slice(width // 2 - width // 8, width // 2 + width // 8)
light[middle, middle] = 0.0
nebula = light.sum(axis=(0, 1))
star = model.stars[0].spectral_luminosity(wavelengths)
bluer = (nebula[0] / nebula[-1]) / (star[0] / star[-1])
print(f"reflection_nebula.png: 400 over 700 nm is {bluer:.2f} times that of the star")

# Dust scatters blue light more than red; what crosses much of it reddens again.
assert 0.5 < bluer < 4.0
