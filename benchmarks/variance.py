"""Where the variance of a pixel comes from: orders of scattering, sources, spread over wavelengths, and the tail.

Each scene is rendered again and again with other seeds.  Shares are of the variance summed over pixels, of light
averaged over wavelengths, each relative to its mean over the picture:

- of an order: its covariance with the sum of all over the variance of that sum, so that shares add up to 1;
- spread: what the variance of a single wavelength is more than that of the average;
- tail: of the hundredth of the pixels that have most of it;
- gas and stars: the variance of the picture in which nothing else shines, beside that of the whole.
"""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
from common import machine, parser, report, table, versions, view

import skyscatter

Array = Any
SCENES = (
    "reflection-nebula",
    "turbulent-pillar",
    "hii-region",
    "ring-nebula",
    "dark-globule",
    "fog-room",
    "milk-and-water",
)
WAVELENGTHS = [450.0, 500.8, 550.0, 600.0, 656.5]
#: Orders that are told apart; the sixth share is that of all higher ones and of emission that is seen directly.
ORDERS = 5


def runs(scene: Any, camera: Any, walks: int, count: int) -> tuple[Array, Array]:
    """Light (run, y, x, wavelength) and its orders (run, order, y, x, wavelength), relative to its mean."""
    light, parts = [], []
    for seed in range(count):
        image = skyscatter.render(
            scene, camera, WAVELENGTHS, solver=skyscatter.Path(samples=walks, seed=seed + 1), orders=ORDERS
        )
        orders = [image.layers[f"order{k + 1}"] for k in range(ORDERS)]
        light.append(np.asarray(image.radiance))
        parts.append(np.stack([*orders, image.radiance - sum(orders)]))
    mean = np.mean(light, axis=(0, 1, 2))
    scale = np.where(mean > 0.0, mean, 1.0)
    return np.stack(light) / scale, np.stack(parts) / scale


def summed_variance(light: Array) -> float:
    """Variance over runs of light (run, y, x), summed over pixels."""
    return float(light.var(axis=0, ddof=1).sum())


def sources(scene: Any) -> dict[str, Any]:
    """The scene with nothing but its gas shining, and with nothing but its stars."""
    if not hasattr(scene, "stars"):
        return {}
    gas = [c.optics.kind == "gas-lines" for c in scene.medium.components]
    dust = tuple(c for c, emits in zip(scene.medium.components, gas, strict=True) if not emits)
    if not any(gas) or not dust or not scene.stars:
        return {}
    bare = {name: getattr(scene, name) for name in type(scene).model_fields}
    return {
        "gas": type(scene)(**{**bare, "stars": ()}),
        "stars": type(scene)(**{**bare, "medium": skyscatter.Medium(components=dust)}),
    }


def row_of(name: str, side: int, walks: int, count: int) -> list[Any]:
    """A row of the table."""
    scene, camera = view(name, side)
    light, parts = runs(scene, camera, walks, count)
    grey, orders = light.mean(axis=-1), parts.mean(axis=-1)
    each = grey.var(axis=0, ddof=1)
    whole = float(each.sum())
    away = grey - grey.mean(axis=0)
    shares = [
        float((away * (orders[:, k] - orders[:, k].mean(axis=0))).sum() / (count - 1) / whole)
        for k in range(ORDERS + 1)
    ]
    single = np.mean([summed_variance(light[..., k]) for k in range(len(WAVELENGTHS))])
    worst = np.sort(each.ravel())[::-1][: max(each.size // 100, 1)].sum() / whole
    bright = np.maximum(grey.mean(axis=0), 1e-300)
    units = np.mean(light, axis=0).mean()
    alone = {
        what: summed_variance((runs_of * ratio).mean(axis=-1)) / whole
        for what, (runs_of, ratio) in sourced(scene, camera, walks, count, light).items()
    }
    noise = float(np.median(np.sqrt(each) / bright)), float(np.sqrt(each.mean()) / units)
    numbers = [*noise, *shares, (single - whole) / single, worst, *(alone.get(what) for what in ("gas", "stars"))]
    return [name, *("" if number is None else f"{100 * number:.0f} %" for number in numbers)]


def sourced(scene: Any, camera: Any, walks: int, count: int, light: Array) -> dict[str, tuple[Array, Array]]:
    """Light of each source alone and its share of all, by wavelength."""
    found = {}
    for what, other in sources(scene).items():
        images = [
            np.asarray(
                skyscatter.render(
                    other, camera, WAVELENGTHS, solver=skyscatter.Path(samples=walks, seed=k + 1)
                ).radiance
            )
            for k in range(count)
        ]
        whole = skyscatter.render(scene, camera, WAVELENGTHS, solver=skyscatter.Path(samples=walks, seed=1)).radiance
        scale = np.asarray(whole).mean(axis=(0, 1)) / light[0].mean(axis=(0, 1))
        found[what] = (np.stack(images), 1.0 / scale)
    return found


def main() -> None:
    """Render, split and report."""
    made = parser(__doc__)
    made.add_argument("--side", type=int, default=40, help="side of the pictures [pixel]")
    made.add_argument("--walks", type=int, default=8, help="walks a pixel")
    made.add_argument("--runs", type=int, default=16, help="runs, each with its own seed")
    made.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME")
    options = made.parse_args()
    where = machine()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scenes in which walks are rare are meant
        rows = [row_of(name, options.side, options.walks, options.runs) for name in options.scenes]
    header = ["scene", "noise of a pixel, median", "root mean square", *(f"order {k + 1}" for k in range(ORDERS)),
              "higher, and seen directly", "spread", "tail", "gas alone", "stars alone"]  # fmt: skip
    size = f"Pictures of {options.side}x{options.side} pixels, {options.walks} walks, {options.runs} runs."
    report("variance", where, versions("skyscatter", "numba"), [size, table(header, rows)], sys.argv, options.write)


if __name__ == "__main__":
    main()
