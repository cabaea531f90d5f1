"""Numbers of every solver on fixed scenes and seeds, by which a move that should change none of them is held.

    python tests/digests.py [NAME ...]        # writes tests/regression/digests.json anew, all of it or these alone

A change that alters a stream of random numbers writes them anew, after z-tests against the old ones; one that alters
nothing leaves them as they are.
"""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from asking import asked
from nebulae import SHIPPED as NEBULAE
from nebulae import coarse

import skyscatter

Array = Any
FILE = Path(__file__).parent / "regression" / "digests.json"
#: Under this name stands what they were computed on.
PROCESSOR = "processor"
#: Names of what is drawn by chance: on another processor a walk that decides on the edge goes another way.
DRAWN = re.compile("path|photons|flights|quadrature|ratio")
WAVELENGTHS = [450.0, 550.0, 656.0]
SKIES = ("earth", "earth-hazy", "earth-maritime", "earth-simple", "mars", "titan")
ROOMS = ("city-skyglow", "fog-room", "light-guide", "milk-and-water", "searchlight")


def look(scene: Any, rays: tuple[Array, Array], solver: str, **options: Any) -> dict[str, Array]:
    """Radiance, its error and all layers along rays."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = skyscatter.radiance(scene, *rays, WAVELENGTHS, **asked(solver, **options))
    return {"radiance": answer.radiance, "error": answer.error, **answer.layers}


def sky_rays(scene: Any) -> tuple[Array, Array]:
    """From the ground, from within the air and from space; up, level and down."""
    radius = scene.medium.radius
    places = (1.0, 2e4, 2.0 * scene.medium.top)
    directions = np.array([[0.2, 0.3, 0.9], [0.8, -0.6, 0.02], [-0.1, 0.1, -1.0]])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    o = np.array([[0.0, 0.0, radius + h] for h in places for _ in directions])
    d = np.tile(directions, (len(places), 1))
    seen = ~((o[:, 2] < radius + 2) & (d[:, 2] < 0))
    return o[seen], d[seen]


def sky(name: str, solver: str, sun: float = 12.0, **options: Any) -> dict[str, Array]:
    scene = skyscatter.load_model(name).scene(sun_elevation_deg=sun)  # type: ignore[call-overload]
    return look(scene, sky_rays(scene), solver, **options)


def field(name: str, **options: Any) -> dict[str, Array]:
    """A solved field, asked for radiances and fluxes."""
    scene = skyscatter.load_model(name).scene(sun_elevation_deg=25.0)  # type: ignore[call-overload]
    solved = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(20.0, 30.0), tolerance=0.01, **options)
    fluxes = solved.fluxes([0.0, 5e3], sun_elevation_deg=25.0)
    answer = solved.radiance(*(part[:4] for part in sky_rays(scene)))
    return {"radiance": answer.radiance, "error": answer.error, "up": fluxes.diffuse_up, "down": fluxes.diffuse_down}


def nebula_scene(name: str) -> Any:
    """A shipped nebula with fewer cells, and rays through it."""
    scene = coarse(name, 24, 3).scene()
    corners = [part.density.bounds for part in scene.medium.components]
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    middle, size = 0.5 * (low + high), high - low
    rng = np.random.default_rng(3)
    o = middle + 2.0 * np.linalg.norm(size) * np.array([0.36, 0.48, 0.8])
    d = middle + 0.25 * rng.uniform(-1, 1, (6, 3)) * size - o
    return scene, (np.broadcast_to(o, d.shape).copy(), d / np.linalg.norm(d, axis=1)[:, None])


def nebula(name: str, solver: str, **options: Any) -> dict[str, Array]:
    return look(*nebula_scene(name), solver, **options)


def room(name: str, solver: str, **options: Any) -> dict[str, Array]:
    scene = skyscatter.load_model(name).scene()  # type: ignore[call-overload]
    view = scene.viewpoint
    ahead = np.array(view.target) - np.array(view.position)
    d = ahead / np.linalg.norm(ahead) + 0.3 * np.random.default_rng(5).uniform(-1, 1, (6, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    return look(scene, (np.broadcast_to(view.position, d.shape).copy(), d), solver, **options)


def world(held: str, **options: Any) -> dict[str, Array]:
    """A sky with a cloud and a box, or over the sea."""
    model = skyscatter.load_model("earth-simple")
    if held == "sea":
        model = model.model_copy(update={"ground": skyscatter.Ground(material={"kind": "sea"})})
    else:
        optics = {"kind": "particles", "extinction": "10 km-1", "phase": {"kind": "henyey-greenstein", "g": 0.8}}
        puff = {"kind": "gaussian-sphere", "position": [0, "1 km", "2 km"], "width": "300 m"}
        cloud = {"name": "puff", "density": puff, "optics": optics}
        box = {"shape": {"kind": "box", "position": [0, 20, 1], "size": [2, 2, 2]}, "material": {"kind": "lambert"}}
        model = type(model).model_validate(model.model_dump() | {"fields": [cloud], "bodies": [box]})
    scene = model.scene(sun_elevation_deg=12.0)
    return look(scene, sky_rays(scene), "path", **options)


def abel() -> dict[str, Array]:
    radius = np.linspace(0.0, 1.0, 41)
    data = np.exp(-8 * radius**2) + 0.01 * np.random.default_rng(1).normal(size=41)
    found = skyscatter.inversion.abel_invert(radius, data)
    return {"density": found.density, "lower": found.lower, "upper": found.upper}


def picture() -> dict[str, Array]:
    """Haze taken off a plain picture."""
    rng = np.random.default_rng(2)
    scene = np.kron(rng.random((12, 16, 3)), np.ones((6, 6, 1))) * 0.8
    hazy = 0.6 * scene + 0.4 * np.array([0.8, 0.85, 0.9])
    image = np.moveaxis(np.round(255 * hazy).astype(np.uint8), -1, 0)
    found = skyscatter.dehaze(image, quantity="display", bands=["red", "green", "blue"])
    return {name: np.asarray(getattr(found, name))[..., ::7, ::9] for name in ("reflectance", "sigma", "haze_map")}


PATH = {"samples": 48, "seed": 4}
PHOTONS = {"samples": 2, "photons": 1 << 11, "radius": 0.1, "seed": 4}
#: What is computed, by name.
DIGESTS: dict[str, Callable[[], dict[str, Array]]] = {
    **{f"{name}-single": partial(sky, name, "single") for name in SKIES},
    **{f"{name}-orders": partial(sky, name, "orders", tolerance=0.01) for name in SKIES},
    **{f"{name}-path": partial(sky, name, "path", **PATH) for name in SKIES},
    "earth-flights": partial(sky, "earth", "path", sampling="free-flight", **PATH),
    "earth-dusk": partial(sky, "earth", "orders", sun=-5.0, tolerance=0.01),
    "earth-single-stokes": partial(sky, "earth", "single", stokes=True),
    "earth-orders-stokes": partial(sky, "earth", "orders", tolerance=0.01, stokes=True),
    "earth-path-stokes": partial(sky, "earth", "path", stokes=True, **PATH),
    "earth-field": partial(field, "earth"),
    **{f"{name}-single": partial(nebula, name, "single") for name in NEBULAE},
    **{f"{name}-path": partial(nebula, name, "path", **PATH) for name in NEBULAE},
    **{
        f"star-in-dust-{mode}": partial(nebula, "star-in-dust", "path", transmittance=mode, **PATH)
        for mode in ("quadrature", "ratio", "residual-ratio")
    },
    **{f"{name}-path": partial(room, name, "path", **PATH) for name in ROOMS},
    **{f"{name}-photons": partial(room, name, "photons", **PHOTONS) for name in ("fog-room", "milk-and-water")},
    **{f"world-{held}-path": partial(world, held, **PATH) for held in ("cloud", "sea")},
    "fog-room-photons-stokes": partial(room, "fog-room", "photons", stokes=True, **PHOTONS),
    "abel": abel,
    "picture": picture,
}
#: Those that the quick tests run too: one of each solver.
QUICK = (
    "earth-single", "earth-orders", "earth-path", "earth-flights", "earth-path-stokes", "dusty-disk-single",
    "star-in-dust-path", "fog-room-path", "fog-room-photons", "abel", "picture",
)  # fmt: skip


def computed(name: str) -> dict[str, list[float]]:
    """The numbers of a name, flat."""
    return {part: np.asarray(values, float).ravel().tolist() for part, values in sorted(DIGESTS[name]().items())}


def processor() -> str:
    """The kind of this machine's processor: exponentials and cosines have last digits of its own."""
    from llvmlite.binding import get_host_cpu_name

    return str(get_host_cpu_name())


def kept() -> dict[str, dict[str, list[float]]]:
    """The numbers that are held."""
    return {name: value for name, value in _content().items() if name != PROCESSOR}


def made_on() -> str:
    """The kind of processor that they were computed on."""
    return str(_content()[PROCESSOR])


def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(FILE.read_text()) if FILE.is_file() else {}
    return content


def written(value: float) -> str:
    """Eleven digits: as many as other processors share."""
    return f"{value:.10e}" if np.isfinite(value) else json.dumps(value)


def main() -> None:
    """Compute and keep."""
    found, names = kept(), sys.argv[1:] or list(DIGESTS)
    here = made_on() if sys.argv[1:] else processor()
    if here != processor() and any(map(DRAWN.search, names)):
        sys.exit(f"walks of others are of a {here}, and this is a {processor()}; write all of them anew")
    for name in names:
        found[name] = computed(name)
        keep(found, here)
        print(name, flush=True)


def keep(found: dict[str, dict[str, list[float]]], processor: str) -> None:
    """Write the file, a line for each layer."""
    ordered = {name: found[name] for name in DIGESTS if name in found}
    parts = [
        f" {json.dumps(name)}: {{\n" + ",\n".join(
            f"  {json.dumps(part)}: [{', '.join(map(written, values))}]" for part, values in digest.items()
        ) + "\n }"
        for name, digest in ordered.items()
    ]  # fmt: skip
    FILE.write_text(f"{{\n {json.dumps(PROCESSOR)}: {json.dumps(processor)},\n" + ",\n".join(parts) + "\n}\n")


if __name__ == "__main__":
    main()
