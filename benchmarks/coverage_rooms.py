"""Do error bars cover in rooms?  `path` and `photons` in a room with a lamp, empty and in fog, with many seeds.

The reference of `path` is a long run of its own; that of `photons` the same one, so that their bias counts.  The fog
scatters all light, evenly or forwards, so that nothing is dim for want of albedo.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from common import machine, parser, report, versions
from error_bars import HEADER, coverage, pooled, table_row
from rooms import FogRoom, surface_room

import skyscatter
from skyscatter.solvers.options import record_of

WAVELENGTHS = np.array([550.0])
#: Extinction [m-1] and mean cosine of the fog; the room is 4 x 5 x 2.6 m.
FOGS = {"empty": (0.0, 0.0), "thin": (0.1, 0.85), "fog": (0.5, 0.85), "dense": (2.0, 0.5), "very dense": (6.0, 0.0)}
#: Looks, all from the eye of the room: a wall, the floor beneath the lamp, a corner, along the ceiling.
LOOKS = np.array([[-0.6, 0.7, 0.0], [0.1, 0.7, -0.4], [0.6, 0.75, -0.3], [0.0, 0.95, 0.3]])
#: Walks along a ray; passes and photons of one.
EFFORT: dict[str, dict[str, Any]] = {
    "path": {"samples": 256},
    "photons": {"samples": 16, "photons": 2000},
}


def rays(room: FogRoom) -> tuple[Any, Any]:
    """Origins and directions of the looks."""
    return np.tile(room.eye, (len(LOOKS), 1)), LOOKS / np.linalg.norm(LOOKS, axis=1)[:, None]


def study(name: str, seeds: int, longer: int) -> list[str]:
    """Rows of the table for one fog: both solvers."""
    extinction, g = FOGS[name]
    room = FogRoom(extinction=extinction, g=g, albedo=0.99, angstrom=0.0)
    scene = surface_room(room, WAVELENGTHS)
    o, d = rays(room)
    long = skyscatter.radiance(scene, o, d, WAVELENGTHS, solver=skyscatter.Path(samples=256 * longer, seed=1))
    rows = []
    for solver, effort in EFFORT.items():
        runs = [
            skyscatter.radiance(scene, o, d, WAVELENGTHS, solver=record_of(solver, seed=1000 + k, **effort))
            for k in range(seeds)
        ]
        found = [
            coverage(
                [a.radiance[n, 0] for a in runs], [a.standard_error[n, 0] for a in runs], long.radiance[n, 0],
                long.standard_error[n, 0],
            )
            for n in range(len(d))
        ]  # fmt: skip
        rows.append(table_row(f"{name} ({extinction:g} per m, g {g:g}), `{solver}`", pooled(found)))
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Run the study and report it."""
    options = parser(__doc__)
    options.add_argument("--seeds", type=int, default=200)
    options.add_argument("--longer", type=int, default=256, help="walks of the reference over those of a run")
    options.add_argument("--fogs", nargs="+", choices=FOGS, default=list(FOGS))
    given = options.parse_args()
    rows = [row for name in given.fogs for row in study(name, given.seeds, given.longer)]
    effort = ", ".join(f"`{solver}` {numbers}" for solver, numbers in EFFORT.items())
    note = f"{given.seeds} seeds, {len(LOOKS)} looks each; {effort}. Looks share photons, not walks."
    report(
        "room-coverage", machine(), versions("skyscatter", "numba"), [note, "\n".join([HEADER, *rows])], sys.argv,
        given.write,
    )  # fmt: skip


if __name__ == "__main__":
    main()
