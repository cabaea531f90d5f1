"""The polarisation of the clear sky at sunset, and its neutral points: where light scattered again undoes the first.

Light scattered once is polarised across the plane of scattering everywhere; what is scattered again comes mostly from
along the horizon and is polarised upright.  Above the Sun (Babinet) and above the point opposite (Arago) they cancel.
"""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "360"))
wavelengths = [550.0]

scene = skyscatter.load_model("earth").scene(sun_elevation_deg=0, sun_azimuth_deg=270)
here = scene.observer.position
# One solution answers for the line of the neutral points and for the picture.
field = skyscatter.solve(scene, wavelengths, sun_elevations_deg=(-20, 20), stokes=True)

# The solar meridian, from the Sun over the zenith to the opposite horizon: there U = 0, and Q changes sign.
arc = np.arange(1.25, 179.0, 0.5)  # not the zenith itself, which has no meridian plane of its own
meridian = direction_from_azimuth_elevation(270.0, arc)
answer = field.radiance(here, meridian)
q = (answer.stokes[..., 1] / answer.stokes[..., 0])[:, 0]
at = np.flatnonzero(q[:-1] * q[1:] < 0)
neutral = arc[at] + 0.5 * q[at] / (q[at] - q[at + 1])

camera = skyscatter.Fisheye(width=width, height=width)
grid = camera.directions()
inside = np.isfinite(grid[..., 0])
seen = field.radiance(here, grid[inside])


def picture(values: np.ndarray) -> np.ndarray:
    """Values along rays as a picture, NaN outside the circle."""
    cube = np.full((width, width, len(wavelengths)), np.nan)
    cube[inside] = values
    return cube


sky = skyscatter.SpectralImage(picture(seen.radiance), wavelengths, layers={n: picture(seen.layers[n]) for n in "QUV"})
figure = Figure(figsize=(12.0, 5.4), layout="constrained")
for axes, show, bars in zip(figure.subplots(1, 2), ("degree", "angle"), (24, 0), strict=True):
    sky.plot_polarisation(show, bars=bars, camera=camera, ax=axes)
    marks = [(0.0, "Sun", -8)] + [(e, f"Babinet {e:.1f}°" if e < 90 else f"Arago {180 - e:.1f}°", 8) for e in neutral]
    for elevation, name, rise in marks:
        x, y = camera.pixel(direction_from_azimuth_elevation(270.0, elevation + 0.01))
        axes.plot(x, y, "o", mfc="gold" if name == "Sun" else "none", mec="red", ms=9, mew=2, clip_on=False)
        axes.annotate(name, (x, y), (0, 2 * rise), textcoords="offset points", ha="center", color="white",
                      bbox={"fc": "black", "alpha": 0.6, "lw": 0, "pad": 2}, va="center")  # fmt: skip
figure.savefig("neutral_points.png", dpi=80)

print(f"neutral points {neutral[0]:.1f}° above the Sun and {180 - neutral[-1]:.1f}° above the point opposite")
assert neutral.size == 2
assert all(10 < height < 30 for height in (neutral[0], 180 - neutral[-1]))
