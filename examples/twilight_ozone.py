"""Why the zenith is blue after sunset: ozone in its Chappuis bands takes the orange out of the long grazing paths.

Two fisheye skies with the Sun 6 degrees below the horizon, with ozone on the left and without on the right.
"""

from __future__ import annotations

import os

import numpy as np

import skyscatter
from skyscatter.image.colour import spectrum_to_xyz

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "192"))

wavelengths = np.arange(380, 781, 20)
scene = skyscatter.load_model("earth").scene(sun_elevation_deg=-6, sun_azimuth_deg=270)
bare = scene.model_copy(update={"medium": scene.medium.without("ozone")})
camera = skyscatter.Fisheye(width=width, height=width)

skies = [skyscatter.render(s, camera, wavelengths).radiance for s in (scene, bare)]
pair = skyscatter.SpectralImage(np.concatenate(skies, axis=1), wavelengths)
pair.save("twilight_ozone.png")


def zenith_chromaticity(one: skyscatter.Scene) -> np.ndarray:
    """CIE 1931 x, y of the zenith."""
    answer = skyscatter.radiance(one, one.observer.position, [0.0, 0.0, 1.0], wavelengths)
    xyz = spectrum_to_xyz(answer.radiance, wavelengths)
    return xyz[:2] / xyz.sum()


with_ozone, without = zenith_chromaticity(scene), zenith_chromaticity(bare)
print(f"zenith with ozone    x, y = {with_ozone.round(3)}")
print(f"zenith without ozone x, y = {without.round(3)}  (daylight white: 0.313, 0.329)")

# Without ozone the zenith is nearly white; with it, deep blue. The estimated error of x is below 0.005.
assert with_ozone[0] < without[0] - 0.05
