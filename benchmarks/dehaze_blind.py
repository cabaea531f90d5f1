"""Blind scenes dehazed and compared with their truth: per scene, per band, and whether the uncertainties hold.

    python benchmarks/dehaze_blind.py FOLDER [--only coast] [--write]

FOLDER holds what `benchmarks/blind_scenes.py` renders.  Each scene is dehazed three times: amount and kind of the
aerosol given, kind given and amount estimated, both estimated.  Tables of the atmosphere are kept on disk: the first
run takes about a minute for each scene and model, later ones seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, rms, table, versions

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from dehaze_judged import WANTED, WANTED_PART, Judged, apu, given, judge, pooled, with_true_surroundings  # noqa: E402

from skyscatter.dehaze.flags import Flag  # noqa: E402

PAGE = ROOT / "docs" / "validation-dehaze-blind.md"
GIVEN, AMOUNT, AUTO = "all given", "kind given", "automatic"
SETTINGS = (GIVEN, AMOUNT, AUTO)
CLEAR = 0.5  #: optical depth up to which the share of good pixels is asked for
NEAR = 0.002  #: error that is asked for where the haze is given
PROBABILITIES = (0.68, 0.95)
EDGES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0)  #: classes of surface reflectance

Content = Mapping[str, Any]


class Scene:
    """One scene, all that was found of it."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        self.name = path.stem.rsplit("-", 1)[0]
        self.bands = content["bands"]
        self.aerosol = str(content["aerosol"])
        self.aod = float(content["aod"])
        self.noise = rms(content["standard_error"])
        self.known = with_true_surroundings(content)
        self.of: dict[str, Judged] = {
            GIVEN: judge(content, **given(content)),
            AMOUNT: judge(content, aerosol=self.aerosol),
            AUTO: judge(content),
        }


def percent(share: float) -> str:
    """A share as a percentage, never rounded up to all."""
    return "100" if share == 1.0 else f"{np.floor(1000 * share) / 10:.1f}"


def short(value: float) -> str:
    """A reflectance error in units of 0.0001."""
    return f"{1e4 * value:+.0f}"


def scene_table(scenes: Sequence[Scene], setting: str) -> str:
    """One line a scene."""
    rows = []
    for scene in scenes:
        j = scene.of[setting]
        by_band = j.good.mean(axis=(1, 2))
        worst = int(by_band.argmin())
        clear = percent(j.good[:, ~j.cloud].mean()) if not j.cloud.all() else "none left"
        row: list[Any] = [scene.name]
        if setting != GIVEN:
            off = (j.aod - j.true_aod) / j.aod_sigma
            row += [f"{j.aod:.3f} ± {j.aod_sigma:.3f}", f"{off:+.1f}"]
        if setting == AUTO:
            row += [j.aerosol, f"{j.probabilities[scene.aerosol]:.2f}"]
        row += [
            percent(j.good.mean()), f"{percent(by_band[worst])} ({scene.bands[worst]:.0f} nm)", percent(j.within(NEAR)),
            f"{1e4 * rms(j.error):.0f}", *(percent(j.covered(p)) for p in PROBABILITIES),
            percent(j.cloud.mean()), clear, percent(float(((j.mask & Flag.UNCERTAIN) != 0).mean())),
        ]  # fmt: skip
        rows.append(row)
    head = ["scene"]
    head += ["AOD found", "off, σ"] if setting != GIVEN else []
    head += ["model", "P(true)"] if setting == AUTO else []
    head += [
        "good", "worst band", "within 0.002", "rms, 1e-4", "in 68 %", "in 95 %", "taken for cloud", "good without them",
        "flagged uncertain",
    ]  # fmt: skip
    return table(head, rows)


def surroundings_table(scenes: Sequence[Scene]) -> str:
    """What is left with everything given, and what of it is the ground beyond the picture."""
    rows = []
    for scene in scenes:
        j, known = scene.of[GIVEN], scene.known
        bias = known.mean(axis=(1, 2))
        worst = int(np.abs(bias).argmax())
        rows.append(
            [
                scene.name, percent(j.within(NEAR)), f"{1e4 * rms(j.error):.1f}",
                percent(float((np.abs(known) <= NEAR).mean())), f"{1e4 * rms(known):.1f}",
                f"{short(bias[worst])} ({scene.bands[worst]:.0f} nm)", f"{1e4 * scene.noise:.1f}",
            ]
        )  # fmt: skip
    head = [
        "scene", "within 0.002", "rms, 1e-4", "the same, true surroundings", "rms, 1e-4",
        "greatest mean error of a band", "rendered to, 1e-4",
    ]  # fmt: skip
    return table(head, rows)


def band_table(scenes: Sequence[Scene]) -> str:
    """Accuracy, precision and uncertainty of every band over all pixels of some scenes."""
    columns = []
    for setting in SETTINGS:
        found = [scene.of[setting] for scene in scenes]
        good = pooled(j.good.astype(float) for j in found).mean(axis=1)
        columns.append((*apu(pooled(j.error for j in found)), good))
    rows = []
    for k, wl in enumerate(scenes[0].bands):
        row = [f"{wl:.0f}"]
        for accuracy, precision, uncertainty, good in columns:
            row += [short(accuracy[k]), f"{1e4 * precision[k]:.0f}", f"{1e4 * uncertainty[k]:.0f}", percent(good[k])]
        rows.append(row)
    head = ["band, nm", *(f"{what}, {setting}" for setting in SETTINGS for what in ("A", "P", "U", "good"))]
    return table(head, rows)


def reflectance_table(scenes: Sequence[Scene]) -> str:
    """The same over classes of surface reflectance, all bands together, beside what is asked for."""
    rows = []
    for low, high in pairwise(EDGES):
        row, truths = [f"{low:g} to {high:g}"], None
        for setting in SETTINGS:
            found = [scene.of[setting] for scene in scenes]
            truth, error = (pooled(parts).ravel() for parts in ([j.truth for j in found], [j.error for j in found]))
            chosen = (truth >= low) & (truth < high)
            truths = truth[chosen]
            accuracy, precision, uncertainty = (float(v[0]) for v in apu(error[chosen][None]))
            row += [short(accuracy), f"{1e4 * precision:.0f}", f"{1e4 * uncertainty:.0f}"]
        assert truths is not None
        row[1:1] = [f"{truths.size / 1e3:.0f}", f"{1e4 * (WANTED + WANTED_PART * truths.mean()):.0f}"]
        rows.append(row)
    head = ["reflectance", "thousand values", "asked for", *(f"{w}, {s}" for s in SETTINGS for w in "APU")]
    return table(head, rows)


def coverage_table(scenes: Sequence[Scene]) -> str:
    """How often the truth lies inside of what was said, for the ground and for the amount of haze."""
    rows = []
    for setting in SETTINGS:
        found = [scene.of[setting] for scene in scenes]
        row = [setting]
        row += [percent(float(np.mean([j.covered(p) for j in found]))) for p in PROBABILITIES]
        row += [percent(float(np.min([j.covered(p) for j in found]))) for p in PROBABILITIES]
        scaled = np.concatenate([(j.error / j.sigma).ravel() for j in found])
        row += [f"{rms(scaled):.2f}"]
        if setting == GIVEN:
            row += ["", "", "", ""]
        else:
            off = np.array([(j.aod - j.true_aod) / j.aod_sigma for j in found])
            row += [f"{int((np.abs(off) <= limit).sum())} of {off.size}" for limit in (1.0, 2.0)]
            row += [f"{rms(off):.2f}", f"{off.mean():+.2f}"]
        rows.append(row)
    head = [
        "setting", "in 68 %", "in 95 %", "least of a scene, 68 %", "95 %", "rms of error / σ", "AOD within σ", "2 σ",
        "rms of AOD error / σ", "mean",
    ]  # fmt: skip
    return table(head, rows)


def bars(scenes: Sequence[Scene]) -> str:
    """What is asked for, and whether it is met."""
    low = [scene for scene in scenes if scene.aod <= CLEAR]
    rows = []

    def line(what: str, value: float, met: bool) -> None:
        rows.append([what, percent(value), "yes" if met else "**no**"])

    every = np.concatenate([s.of[GIVEN].error.ravel() for s in scenes])
    line(
        "all given: error at most 0.002, all values",
        float((np.abs(every) <= NEAR).mean()),
        bool(np.abs(every).max() <= NEAR),
    )
    for setting in (AMOUNT, AUTO):
        shares = [s.of[setting].good.mean() for s in low]
        line(
            f"{setting}, AOD to {CLEAR:g}: good, all values; 90 % asked", float(np.mean(shares)), np.mean(shares) >= 0.9
        )
        line("the same, worst scene", float(np.min(shares)), np.min(shares) >= 0.9)
    for setting in SETTINGS:
        for p in PROBABILITIES:
            share = float(np.mean([s.of[setting].covered(p) for s in scenes]))
            line(f"{setting}: inside of {100 * p:.0f} %, within 5 points", share, abs(share - p) <= 0.05)
    return table(["asked for", "found, %", "met"], rows)


def text_of(scenes: Sequence[Scene], where: str) -> str:
    """The page's part between the markers."""
    low = [scene for scene in scenes if scene.aod <= CLEAR]
    pixels = sum(scene.known[0].size for scene in scenes)
    parts = [
        f"Machine: {where}; {versions('numpy', 'numba', 'scipy')}. {len(scenes)} scenes, {pixels} pixels, "
        f"{len(scenes[0].bands)} bands.",
        "### What is asked for", bars(scenes),
        "### Amount and kind given", scene_table(scenes, GIVEN), surroundings_table(scenes),
        "### Kind given, amount estimated", scene_table(scenes, AMOUNT),
        "### Automatic", scene_table(scenes, AUTO),
        f"### Bands, AOD to {CLEAR:g} ({len(low)} scenes), errors in 1e-4", band_table(low),
        f"### Bands, all {len(scenes)} scenes, errors in 1e-4", band_table(scenes),
        f"### Classes of reflectance, AOD to {CLEAR:g}, errors in 1e-4", reflectance_table(low),
        "### Are the uncertainties right?", coverage_table(scenes),
    ]  # fmt: skip
    return "\n\n".join(parts)


def main() -> None:
    """Judge the scenes of a folder."""
    made = parser(__doc__)
    made.add_argument("folder", type=Path)
    made.add_argument("--only", default="", help="scenes whose name holds this")
    chosen = made.parse_args()
    where = machine()
    scenes = []
    for path in sorted(chosen.folder.glob("*.npz")):
        if chosen.only in path.name:
            scenes.append(Scene(path))
            shares = ", ".join(f"{s} {percent(scenes[-1].of[s].good.mean())}" for s in SETTINGS)
            print(f"{scenes[-1].name}: good {shares}", file=sys.stderr, flush=True)
    if not scenes:
        raise SystemExit(f"{chosen.folder}: no scenes; render them with benchmarks/blind_scenes.py")
    scenes.sort(key=lambda scene: (scene.aerosol, scene.aod))
    text = text_of(scenes, where)
    print(text)
    if chosen.write:
        from skyscatter.atomic import atomic_path

        before, rest = PAGE.read_text(encoding="utf-8").split("<!-- begin table -->")
        after = rest.split("<!-- end table -->")[1]
        with atomic_path(PAGE) as temporary:
            temporary.write_text(
                f"{before}<!-- begin table -->\n\n{text}\n\n<!-- end table -->{after}", encoding="utf-8"
            )


if __name__ == "__main__":
    main()
