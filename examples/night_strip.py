"""A night in one picture: the landscape goes from east to west, and the time with it, from dusk to dawn.

Photographers call it a time slice.  One solution serves all columns: the light of the Sun, the Moon, the stars and the
air's own, each slice with the exposure of its time.
"""

from __future__ import annotations

import os
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

import skyscatter
from skyscatter.image.png import encode_png
from skyscatter.solvers.sequence import Frames, field_for

width = int(os.environ.get("SKYSCATTER_EXAMPLE_SIZE", "320"))
height, slices = width * 3 // 8, max(width // 10, 4)
wavelengths = np.arange(400, 721, 40 if width < 200 else 20)
place, dusk, dawn = (-24.6, -70.4), datetime(2026, 4, 20, 22, 0), datetime(2026, 4, 21, 11, 5)
fov, middle = 200.0, 30.0  # degrees: from the sunset in the west by the north to the sunrise in the east

model = skyscatter.load_model("earth-observatory")
# Time runs slowly at dusk and at dawn, where the light changes by a factor of a hundred thousand.
shares = np.interp(np.linspace(0, 1, slices), [0, 0.3, 0.7, 1], [0, 0.125, 0.875, 1])
moments = [dusk + (dawn - dusk) * float(share) for share in shares]
scenes = tuple(model.scene_at(*place, f"{t.isoformat()}Z", "2635 m", "auto") for t in moments)
columns = width // slices
cameras = [
    skyscatter.Panorama(
        width=columns, height=height, fov_deg=fov / slices, elevation_min_deg=-6, elevation_max_deg=-6 + fov * 3 / 8,
        centre_azimuth_deg=(middle - fov / 2 + fov * (k + 0.5) / slices) % 360,
    )
    for k in range(slices)
]  # fmt: skip

solved = field_for(scenes, cameras[0].model_copy(update={"fov_deg": 360.0}), wavelengths)
frames = Frames(scenes, cameras[0], wavelengths, solved)
images = [frames.image(k, camera) for k, camera in enumerate(cameras)]
# Every slice is as bright as a picture of its time would be by itself, but for steps.
exposures = gaussian_filter1d([image.auto_exposure() for image in images], slices / 40)
slices_of = [image.picture(exposure=float(ev)) for image, ev in zip(images, exposures, strict=True)]
picture = np.concatenate(slices_of, axis=1)
Path("night_strip.png").write_bytes(encode_png(picture, dither=True))
elevations = [scene.sun.elevation_deg for scene in scenes]
print(f"{slices} slices, the Sun from {elevations[0]:.0f} to {min(elevations):.0f} and {elevations[-1]:.0f} degrees")
assert min(elevations) < -18 < max(elevations)
assert max(exposures) - min(exposures) > 8  # EV, from dusk to the dark
assert timedelta(hours=10) < dawn - dusk
