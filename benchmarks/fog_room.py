"""The shipped room in fog as a picture: the time to a given noise by `path` and by `photons`.

Zhdanov et al. (2013) give 8 hours for their room in fog, in a picture of its own size, on a machine of its time. Their
scene is not public, so this is the same look, not the same scene: a closed diffuse room, thin fog, a bright lamp behind
a door ajar.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from common import machine, parser, processors, report, seconds, table, versions

import skyscatter
from skyscatter.solvers.options import record_of


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--size", default="320x240", help="pixels")
    options.add_argument("--wavelengths", type=int, default=16, help="from 400 to 700 nm")
    options.add_argument("--walks", type=int, default=64, help="of path")
    options.add_argument("--passes", type=int, default=32, help="of photons")
    options.add_argument(
        "--noise", type=float, default=0.05, help="median standard error over the light that is aimed at"
    )
    options.add_argument("--threads", type=int, default=min(2, processors()))
    options.add_argument("--pictures", default=None, help="folder for the pictures")
    given = options.parse_args()
    where = machine()
    wavelengths = np.linspace(400.0, 700.0, given.wavelengths)
    model = skyscatter.load_model("fog-room")
    width, height = (int(word) for word in given.size.split("x"))
    camera = model.camera.model_copy(update={"width": width, "height": height})
    rows = []
    for solver, samples in (("path", given.walks), ("photons", given.passes)):
        skyscatter.render(
            model.scene(),
            camera.model_copy(update={"width": 8, "height": 6}),
            wavelengths,
            solver=record_of(solver, samples=4),
        )
        spent, image = seconds(
            lambda s=solver, n=samples: skyscatter.render(
                model.scene(), camera, wavelengths, solver=record_of(s, samples=n), threads=given.threads
            )
        )
        light, error = image.radiance, image.standard_error
        lit = light.mean(axis=-1) > 0
        noise = float(np.median(error[lit].mean(axis=-1) / light[lit].mean(axis=-1)))
        square = float(np.sqrt((error[lit] ** 2).mean()) / light[lit].mean())
        rows.append([solver, samples, spent, 100 * noise, 100 * square, spent * (noise / given.noise) ** 2 / 60])
        if given.pictures:
            Path(given.pictures).mkdir(parents=True, exist_ok=True)
            image.save(Path(given.pictures) / f"fog-room-{solver}.png")
    header = ["solver", "samples", "seconds", "median noise of a wavelength [%]", "root mean square noise [%]",
              f"minutes to a median of {100 * given.noise:g} %"]  # fmt: skip
    blocks = [
        f"Model fog-room, {width}x{height} pixels, {given.wavelengths} wavelengths, {given.threads} threads; the last "
        "column is scaled by the square of the noise. Reported for the room of the literature: 8 hours.",
        table(header, rows),
    ]
    report(
        "fog-room", where, versions("skyscatter", "numba", "numpy"), blocks, ["fog_room.py", *sys.argv[1:]], given.write
    )


if __name__ == "__main__":
    main()
