"""Inverse Abel transforms: errors beside PyAbel's methods, and how often the error bands cover the truth.

The judged pairs are the four of the reference folder (SKYSCATTER_REFERENCE). Settings of PyAbel's methods that need one
(basex, daun) are those with the least mean error on other pairs, tests/abel_pairs_truth.py, at the same noise; ours has
none to choose. Coverage is counted on those other pairs, over many draws of noise. --pictures makes the pictures in
docs/gallery/inversion.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests"))
import abel as pyabel  # noqa: E402
from abel_pairs_truth import TRAINING  # noqa: E402
from common import machine, parser, replace_section, report, rms, seconds, table, versions  # noqa: E402

from skyscatter.inversion import abel_invert  # noqa: E402

Array = np.ndarray
RADIUS = np.linspace(0.0, 1.0, 201)
STEP = 0.005
PAGE = ROOT / "docs" / "validation-inversion-abel.md"
GALLERY = ROOT / "docs" / "gallery" / "inversion"
NUMBERS = (1, 3, 5, 7)


def peers() -> dict[str, Callable[[Array, Any], Array]]:
    """PyAbel's methods for one half of a profile; the second argument is a strength where there is one."""
    quiet = {"dr": STEP, "verbose": False}
    return {
        "two_point": lambda y, _: pyabel.dasch.two_point_transform(y, basis_dir=None, **quiet),
        "three_point": lambda y, _: pyabel.dasch.three_point_transform(y, basis_dir=None, **quiet),
        "onion_peeling": lambda y, _: pyabel.dasch.onion_peeling_transform(y, basis_dir=None, **quiet),
        "hansenlaw": lambda y, _: pyabel.hansenlaw.hansenlaw_transform(y, dr=STEP),
        "direct": lambda y, _: pyabel.direct.direct_transform(y, dr=STEP, backend="Python"),
        "basex": lambda y, reg: pyabel.basex.basex_transform(y, reg=reg, basis_dir=None, **quiet),
        "daun, diff": lambda y, reg: pyabel.daun.daun_transform(
            y, reg=("diff", reg), degree=1, basis_dir=None, **quiet
        ),
        "daun, L2": lambda y, reg: pyabel.daun.daun_transform(y, reg=("L2", reg), degree=1, basis_dir=None, **quiet),
        "daun, nonneg": lambda y, _: pyabel.daun.daun_transform(y, reg="nonneg", degree=1, basis_dir=None, **quiet),
    }


STRENGTHS = {
    "basex": np.geomspace(1, 1e5, 11), "daun, diff": np.geomspace(1, 1e5, 11), "daun, L2": np.geomspace(0.1, 1e4, 11),
}  # fmt: skip


def best_strengths(methods: dict[str, Callable[[Array, Any], Array]], noise: float) -> dict[str, float]:
    """Strengths with the least mean error on the pairs of tests/."""
    best = {}
    for name, strengths in STRENGTHS.items():
        errors = np.zeros(len(strengths))
        for number, pair in enumerate(TRAINING):
            clean = pair.projection(RADIUS)
            y = clean + noise * clean.max() * np.random.default_rng([1, number]).standard_normal(RADIUS.size)
            truth = pair.density(RADIUS)
            errors += [rms(methods[name](y, s) - truth) / truth.max() for s in strengths]
        best[name] = float(strengths[int(np.argmin(errors))])
    return best


def covered(truth: Array, low: Array, high: Array) -> float:
    """Share of the radii at which the truth lies in a band, rounding allowed for."""
    return float(((truth >= low - 1e-12) & (truth <= high + 1e-12)).mean())


def judged(folder: Path) -> tuple[list[str], dict[int, Any]]:
    """Tables of the reference pairs, and our results on the noisy ones."""
    methods = peers()
    strengths = best_strengths(methods, 0.01)
    data = {n: np.loadtxt(folder / f"profile{n}.csv", delimiter=",", skiprows=1).T for n in NUMBERS}
    noisy: list[list[Any]] = []
    clean: list[list[Any]] = []
    kept = {}
    for name in [*methods, "skyscatter"]:
        errors, medians = [], []
        for n in NUMBERS:
            r, truth, exact, measured = data[n]
            if name == "skyscatter":
                kept[n] = abel_invert(r, measured)
                got, plain = kept[n].density, abel_invert(r, exact).density
            else:
                got = methods[name](measured, strengths.get(name))
                plain = (
                    methods[name](exact, 0.0)
                    if name in ("basex", "daun, diff", "daun, L2")
                    else methods[name](exact, None)
                )
            errors.append(rms(got - truth) / truth.max())
            medians.append(float(np.median(np.abs(plain - truth)) / truth.max()))
        label = f"{name} ({strengths[name]:.3g})" if name in strengths else name
        noisy.append(
            [
                f"**{label}**" if name == "skyscatter" else label,
                *errors,
                float(np.mean(errors)),
                float(np.median(errors)),
            ]
        )
        clean.append([f"**{name}**" if name == "skyscatter" else name, *[f"{m:.1e}" for m in medians]])
    head = [f"profile {n}" for n in NUMBERS]
    rows = []
    for n in NUMBERS:
        r, truth, _, _ = data[n]
        found = kept[n]
        d, s = found.density, found.standard_deviation
        rows.append([
            f"profile {n}", covered(truth, found.lower, found.upper), covered(truth, d - s, d + s), found.band_factor,
            float(found.noise[0] / data[n][2].max()), float(found.degrees_of_freedom), str(found.order),
        ])  # fmt: skip
    mean = ["mean", float(np.mean([row[1] for row in rows])), float(np.mean([row[2] for row in rows])), "", "", "", ""]
    return [
        "Reference pairs with 1 % noise: root mean square error over maximum (strength in brackets).",
        table(["method", *head, "mean", "median"], noisy),
        "Reference pairs without noise: median error over maximum (no regularisation).",
        table(["method", *head], clean),
        "Our bands on the four noisy files: share of radii at which they hold the truth.",
        table(["file", "band", "± 1 sd", "band factor", "noise found", "degrees of freedom", "order"], [*rows, mean]),
    ], {n: (data[n], kept[n]) for n in NUMBERS}


def coverage(draws: int) -> list[str]:
    """Share of radii within the bands, over shapes, noises and draws."""
    rows, every = [], []
    for pair in TRAINING:
        clean, truth = pair.projection(RADIUS), pair.density(RADIUS)
        shares: dict[float, list[float]] = {0.003: [], 0.01: [], 0.03: []}
        plain, errors, noises = [], [], []
        for noise, kept in shares.items():
            for seed in range(draws):
                y = clean + noise * clean.max() * np.random.default_rng([7, seed]).standard_normal(RADIUS.size)
                found = abel_invert(RADIUS, y)
                kept.append(covered(truth, found.lower, found.upper))
                if noise == 0.01:
                    sd = found.standard_deviation
                    plain.append(covered(truth, found.density - sd, found.density + sd))
                    errors.append(rms(found.density - truth) / truth.max())
                    noises.append(found.noise[0] / clean.max())
        rows.append([
            pair.name, *[float(np.mean(kept)) for kept in shares.values()], float(np.mean(plain)),
            float(np.mean(errors)), float(np.mean(noises)),
        ])  # fmt: skip
        every.append([np.mean(kept) for kept in shares.values()])
        print(rows[-1], flush=True)
    means = [float(x) for x in np.mean(every, axis=0)]
    return [
        f"Other pairs, {draws} draws of noise each: share of radii within the band, and, at 1 %, within one standard "
        "deviation, the root mean square error over maximum, and the noise found.",
        table(
            ["pair", "band, 0.3 % noise", "band, 1 %", "band, 3 %", "± 1 sd, 1 %", "error, 1 %", "noise found, 1 %"],
            [*rows, ["**mean**", *means, "", "", ""]],
        ),
    ]  # fmt: skip


def pictures(kept: dict[int, Any]) -> None:
    """Truth, estimate with band, error and residual of the reference pairs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from skyscatter.atomic import atomic_path

    GALLERY.mkdir(parents=True, exist_ok=True)
    fig, axes = plt.subplots(3, 4, figsize=(13, 7.5), sharex=True, layout="constrained")
    for (n, (data, found)), (top, middle, bottom) in zip(kept.items(), axes.T, strict=True):
        r, truth, _, measured = data
        peer = peers()["three_point"](measured, None)
        top.plot(r, peer, color="0.8", lw=0.6, label="PyAbel, three-point")
        top.fill_between(r, found.lower, found.upper, color="tab:orange", alpha=0.5, lw=0, label="68 % band")
        top.plot(r, found.density, color="tab:red", lw=1.2, label="estimate")
        top.plot(r, truth, "k--", lw=1, label="truth")
        top.set(title=f"profile {n}", ylim=(-0.1 * truth.max(), 1.35 * truth.max()))
        middle.fill_between(
            r, found.lower - found.density, found.upper - found.density, color="tab:orange", alpha=0.5, lw=0
        )
        middle.plot(r, found.density - truth, color="tab:red", lw=1)
        middle.axhline(0, color="k", lw=0.6)
        bottom.plot(r, found.residual / found.noise, ".", ms=3, color="tab:blue")
        bottom.axhline(0, color="k", lw=0.6)
        bottom.set(xlabel="radius", ylim=(-4, 4))
    axes[0, 0].set_ylabel("density")
    axes[1, 0].set_ylabel("estimate - truth")
    axes[2, 0].set_ylabel("residual / noise")
    axes[0, 0].legend(fontsize=8, loc="lower left")
    with atomic_path(GALLERY / "abel_pairs.png") as path:
        fig.savefig(path, dpi=80)
    print(f"written to {GALLERY / 'abel_pairs.png'}")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--draws", type=int, default=20, help="draws of noise for the coverage")
    options.add_argument("--pictures", action="store_true", help="make the pictures too")
    given = options.parse_args()
    where = machine()
    reference = Path(os.environ.get("SKYSCATTER_REFERENCE", ROOT.parent / "shared" / "reference")) / "abel_pairs"
    blocks = []
    if reference.is_dir():
        blocks, kept = judged(reference)
        first, again = kept[1][0], seconds(lambda: abel_invert(kept[1][0][0], kept[1][0][3]))[0]
        blocks.append(
            f"One inversion of {len(first[0])} points takes {again:.2f} s (geometry kept from the one before)."
        )
        if given.pictures:
            pictures(kept)
    else:
        blocks.append("No abel_pairs: name the reference folder in SKYSCATTER_REFERENCE.")
    blocks += coverage(given.draws) if given.draws else []
    report(
        "abel",
        where,
        versions("skyscatter", "PyAbel", "numpy", "scipy"),
        blocks,
        ["abel.py", *sys.argv[1:]],
        given.write,
    )
    if given.write:
        replace_section(PAGE, "tables", "\n\n".join(blocks))


if __name__ == "__main__":
    main()
