"""Taking veils off pictures without metadata, beside the dark-channel prior, in one run.

Three grounds: the pairs of hazy and clear pictures of the reference folder (SKYSCATTER_REFERENCE), clear halves of them
under veils that are made here, and made-up scenes under the same veils.  PSNR in dB and the mean CIEDE2000, before and
after; the depth and the α that were found; the time of fitting and of taking off.

Neither pairs nor scenes are held out: both were in view while the method was made.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, table, versions
from scipy.ndimage import minimum_filter, uniform_filter

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import pictures  # noqa: E402

from skyscatter.dehaze.picture.options import PictureOptions  # noqa: E402
from skyscatter.dehaze.picture.veil import Veil, fit_picture  # noqa: E402

PAGE = ROOT / "docs" / "validation-dehaze-pictures.md"
Picture = np.ndarray


def dark_channel_prior(hazy: Picture, omega: float = 0.95, least: float = 0.1) -> Picture:
    """He, Sun & Tang (CVPR 2009), patches of 15, with their guided filter (ECCV 2010) in the place of matting."""
    bands, height, width = hazy.shape
    dark = minimum_filter(hazy.min(axis=0), 15)
    brightest = np.argsort(dark.ravel())[-max(1, dark.size // 1000) :]
    flat = hazy.reshape(bands, -1)
    light = flat[:, brightest[np.argmax(flat[:, brightest].sum(axis=0))]]
    raw = 1.0 - omega * minimum_filter((hazy / np.maximum(light, 1e-3)[:, None, None]).min(axis=0), 15)
    guide, size = hazy.mean(axis=0), max(9, min(height, width) // 8)

    def mean(x: np.ndarray) -> np.ndarray:
        return uniform_filter(x, size)

    slope = (mean(guide * raw) - mean(guide) * mean(raw)) / (mean(guide * guide) - mean(guide) ** 2 + 1e-3)
    t = np.maximum(mean(slope) * guide + mean(mean(raw) - slope * mean(guide)), least)
    return np.clip((hazy - light[:, None, None]) / t + light[:, None, None], 0.0, 1.0)


def ciede2000(a: Picture, b: Picture) -> float:
    """Mean colour difference of two pictures, taken as sRGB; over every second row and column."""
    import colour

    def lab(x: Picture) -> np.ndarray:
        return colour.XYZ_to_Lab(colour.sRGB_to_XYZ(np.moveaxis(np.clip(x[:, ::2, ::2], 0.0, 1.0), 0, -1)))

    return float(np.mean(colour.delta_E(lab(a), lab(b), method="CIE 2000")))


def after_gain_and_offset(picture: Picture, truth: Picture) -> float:
    """PSNR after the best gain and offset of each band: what is left are errors of structure."""
    error = 0.0
    for a, b in zip(picture.astype(float), truth, strict=True):
        slope = np.mean((a - a.mean()) * (b - b.mean())) / max(np.var(a), 1e-12)
        error += np.mean((slope * (a - a.mean()) + b.mean() - b) ** 2) / len(truth)
    return float(-10 * np.log10(error))


def best_grey_veil(hazy: Picture, truth: Picture) -> Picture:
    """The best that one grey veil can give when the truth is known: one gain and one offset for all bands."""
    slope = np.mean((hazy - hazy.mean()) * (truth - truth.mean())) / np.var(hazy)
    return np.clip(slope * (hazy - hazy.mean()) + truth.mean(), 0.0, 1.0)


def cleaned(hazy: Picture, options: PictureOptions | None = None) -> tuple[Picture, Veil]:
    veil = fit_picture(hazy, options)
    return veil.apply(hazy)[0].astype(float), veil


def pairs(folder: Path) -> Iterable[tuple[str, Picture, Picture]]:
    from PIL import Image

    def load(path: Path) -> Picture:
        return np.moveaxis(np.asarray(Image.open(path).convert("RGB"), dtype=float) / 255.0, 2, 0)

    for path in sorted(folder.glob("*_hazy.png")):
        yield path.name[:3], load(path), load(path.with_name(path.name.replace("hazy", "clear")))


def on_pairs(found: list[tuple[str, Picture, Picture]]) -> list[str]:
    """Tables of the pairs: one row a picture, and the medians."""
    rows, methods = [], {"as it is": [], "dark-channel prior": [], "skyscatter": [], "best grey veil, truth known": []}
    untouched = []
    for name, hazy, clear in found:
        ours, veil = cleaned(hazy)
        for label, picture in zip(
            methods, (hazy, dark_channel_prior(hazy), ours, best_grey_veil(hazy, clear)), strict=True
        ):
            scores = pictures.psnr(picture, clear), ciede2000(picture, clear), after_gain_and_offset(picture, clear)
            methods[label].append(scores)
        untouched.append(ciede2000(cleaned(clear)[0], clear))
        shown = [
            methods[label][-1]
            for label in ("as it is", "dark-channel prior", "skyscatter", "best grey veil, truth known")
        ]
        found_veil = veil.depth.mean(), veil.airlight.mean(), veil.probability, untouched[-1]
        scores_shown = [s[0] for s in shown] + [s[1] for s in shown[:3]] + [shown[2][2]]
        rows.append([name, *(f"{v:.1f}" for v in scores_shown), *(f"{v:.2f}" for v in found_veil)])
    medians = [
        [
            label,
            *(f"{value:.2f}" for value in np.median(scores, axis=0)),
            sum(s[0] < n[0] for s, n in zip(scores, methods["as it is"], strict=True)),
        ]
        for label, scores in methods.items()
    ]
    head = [
        "pair",
        "PSNR as it is",
        "dark channel",
        "ours",
        "best grey",
        "ΔE as it is",
        "dark channel",
        "ours",
        "ours, gain and offset",
        "τ",
        "A",
        "P",
        "clear half: ΔE",
    ]
    return [
        table(
            ["method", "median PSNR", "median CIEDE2000", "median PSNR after gain and offset", "pictures made worse"],
            medians,
        ),
        f"Clear halves given as input: CIEDE2000 {np.median(untouched):.2f} in the median, "
        f"{np.mean(untouched):.2f} in the mean, "
        f"{sum(u < 2 for u in untouched)} of {len(untouched)} below 2, {max(untouched):.1f} at most.",
        table(head, rows),
    ]


def on_veils(grounds: dict[str, list[Picture]]) -> str:
    """Table of made-up veils over grounds: medians over the pictures of a ground."""
    rows = []
    for ground, clear_ones in grounds.items():
        untouched = [ciede2000(cleaned(clear)[0], clear) for clear in clear_ones]
        rows.append([ground, "none", "", "", "", "", "", f"{np.mean(untouched):.1f}", "", "", "", ""])
        for name, (depth, alpha, _, _) in pictures.VEILS.items():
            scores = []
            for clear in clear_ones:
                hazy = pictures.veiled(clear, name)
                ours, veil = cleaned(hazy)
                prior = dark_channel_prior(hazy)
                three = hazy, prior, ours
                rated = [pictures.psnr(x, clear) for x in three] + [ciede2000(x, clear) for x in three]
                scores.append([*rated, veil.alpha, veil.alpha_sigma, veil.depth.mean()])
            s = np.median(scores, axis=0)
            rows.append(
                [
                    ground,
                    name,
                    *(f"{v:.1f}" for v in s[:6]),
                    f"{alpha:g}",
                    f"{s[6]:.1f} ± {s[7]:.1f}",
                    f"{depth:g}",
                    f"{s[8]:.2f}",
                ]
            )
    return table(
        [
            "ground",
            "veil",
            "PSNR before",
            "dark channel",
            "ours",
            "ΔE before",
            "dark channel",
            "ours",
            "α",
            "found",
            "τ",
            "found, mean",
        ],
        rows,
    )


def processor_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median of the processor's time of a call that uses one thread: other work on the machine does not count."""
    times = []
    for _ in range(max(1, repeats)):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return statistics.median(times)


def speed(repeats: int) -> str:
    """Million pixels times bands a second of one processor."""
    hazy = pictures.veiled(np.tile(pictures.shown(pictures.fields(256)), (1, 8, 8)), "white").astype(np.float32)
    rows = []
    for transfer in ("linear", "srgb"):
        options = PictureOptions(transfer=transfer)
        veil = fit_picture(hazy, options)
        work: dict[str, Callable[[], Any]] = {
            "fit": lambda o=options: fit_picture(hazy, o),
            "take off": lambda v=veil: v.apply(hazy),
        }
        for what, call in work.items():
            rows.append([f"{what}, {transfer}", f"{hazy.size / 1e6 / processor_seconds(call, repeats):.0f}"])
    rows.append(
        ["dark-channel prior", f"{hazy.size / 1e6 / processor_seconds(lambda: dark_channel_prior(hazy), 1):.1f}"]
    )
    return table(["work, 2048 x 2048 x 3", "Mpx-bands / s"], rows)


def main() -> None:
    made = parser(__doc__, repeats=3)
    given = made.parse_args()
    folder = Path(os.environ.get("SKYSCATTER_REFERENCE", ROOT.parent / "shared" / "reference")) / "imagery" / "rice1"
    parts = [f"Machine: {machine()}; {versions('numpy', 'numba', 'scipy', 'colour-science')}."]
    grounds = {name: [pictures.shown(scene())] for name, scene in pictures.SCENES.items()}
    if folder.is_dir():
        found = list(pairs(folder))
        parts += ["## Pairs", *on_pairs(found)]
        grounds["clear halves of every third pair"] = [clear for _, _, clear in found[::3]]
    else:
        parts.append(f"No pairs in {folder.name}: name the reference folder in SKYSCATTER_REFERENCE.")
    parts += ["## Made-up veils", on_veils(grounds), "## Speed, one thread", speed(given.repeats)]
    text = "\n\n".join(parts)
    print(text)
    if given.write:
        page = PAGE.read_text(encoding="utf-8")
        before, rest = page.split("<!-- begin table -->")
        PAGE.write_text(
            f"{before}<!-- begin table -->\n\n{text}\n\n<!-- end table -->{rest.split('<!-- end table -->')[1]}",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
