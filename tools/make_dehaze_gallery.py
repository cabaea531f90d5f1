"""Before and after of dehazing, for docs/gallery: simulated landscapes and made-up veils on pictures.

    python tools/make_dehaze_gallery.py FOLDER_OF_BLIND_SCENES

The folder is the one of `benchmarks/blind_scenes.py`: landscapes rendered by random walks, with their surfaces.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "benchmarks")]

GALLERY = ROOT / "docs" / "gallery"
LANDSCAPES = {"farmland-maritime-0.5": 4, "coast-continental-0.2": 4, "city-urban-0.5": 4}
VEILS = (("city", "white"), ("forest", "front"), ("fields", "blue haze"))


def shown(values: np.ndarray, white: float) -> np.ndarray:
    """Reflectance or light (band, y, x) as numbers of a picture, sRGB, (y, x, band)."""
    light = np.clip(np.moveaxis(values, 0, -1) / white, 0, 1)
    curved = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * curved).astype(np.uint8)


def save(path: Path, parts: list[np.ndarray], zoom: int) -> None:
    """Pictures side by side, with a white line between."""
    height = parts[0].shape[0]
    line = np.full((height, 2, 3), 255, np.uint8)
    row = np.concatenate([x for part in parts for x in (part, line)][:-1], axis=1)
    Image.fromarray(np.repeat(np.repeat(row, zoom, axis=0), zoom, axis=1)).save(path, optimize=True)
    print(path)


def landscapes(folder: Path) -> None:
    """Seen from above, corrected with all found automatically, and the truth."""
    from dehaze_judged import judge

    for name, zoom in LANDSCAPES.items():
        with np.load(next(folder.glob(f"{name}-*.npz"))) as file:
            scene = {key: file[key] for key in file.files}
        found = judge(scene)
        rgb = [3, 2, 1]
        white = float(np.quantile(scene["surface"][rgb], 0.99))
        parts = [shown(v[rgb], white) for v in (scene["reflectance"], found.truth + found.error, scene["surface"])]
        save(GALLERY / f"dehaze-{name.replace('.', '')}.png", parts, zoom)


def pictures() -> None:
    """A made-up picture under a veil, without it, and as it was."""
    import pictures as made

    import skyscatter

    for ground, veil in VEILS:
        clear = made.shown(getattr(made, ground)(256))
        hazy = made.veiled(clear, veil)
        result = skyscatter.dehaze(hazy.astype(np.float32), bands=("red", "green", "blue"), quantity="display")
        parts = [shown(v, 1.0) for v in (hazy, result.reflectance, clear)]
        save(GALLERY / f"dehaze-{ground}-{veil.replace(' ', '-')}.png", parts, 1)
        print(result.diagnostics)


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        raise SystemExit(__doc__)
    pictures()
    landscapes(Path(sys.argv[1]))
