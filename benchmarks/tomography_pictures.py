"""Pictures of inversions for docs/gallery/inversion: truth, estimate, error, residual.

python benchmarks/tomography_pictures.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tomography import voxel_case

from skyscatter.atomic import atomic_path
from skyscatter.inversion.tomography import reconstruct

CELLS, PIXELS, VIEWS = 32, 48, 8


def picture(kind: str, folder: Path) -> None:
    """One inversion, cut through its middle, and what one view is left with."""
    views, model, truth = voxel_case(kind, CELLS, PIXELS, VIEWS, 5)
    found = reconstruct(views, model, freedom=True, deviation=8)
    estimate, deviation, cut = found.density[0], np.asarray(found.deviation)[0], CELLS // 2
    fig, axes = plt.subplots(2, 3, figsize=(10.5, 6.4), layout="constrained")
    box: dict[str, Any] = {"origin": "lower", "extent": (-1, 1, -1, 1)}
    top, worst = float(truth[:, :, cut].max()), float(np.abs(estimate - truth)[:, :, cut].max())
    image = views[0].data[..., 0]
    bright = float(np.quantile(image, 0.995))  # next to a star the light has no bound
    spread, most = deviation[:, :, cut].T, float(deviation[:, :, cut].max())
    panels = [
        ("truth", truth[:, :, cut].T, "magma", (0, top), box, "density"),
        ("estimate", estimate[:, :, cut].T, "magma", (0, top), box, "density"),
        ("estimate - truth", (estimate - truth)[:, :, cut].T, "RdBu_r", (-worst, worst), box, "density"),
        ("view 1 of 8", image, "magma", (0, bright), {}, "W m$^{-2}$ sr$^{-1}$ nm$^{-1}$"),
        ("residual of view 1", found.residuals[0][..., 0], "RdBu_r", (-4, 4), {}, "standard deviations"),
        ("standard deviation", spread, "viridis", (0, most), box, "density"),
    ]  # fmt: skip
    for ax, (name, values, colours, (low, high), how, unit) in zip(axes.flat, panels, strict=True):
        drawn = ax.imshow(values, cmap=colours, vmin=low, vmax=high, interpolation="nearest", **how)
        label = ("x [m]", "y [m]") if how else ("column of pixels", "row")
        ax.set(title=name, xlabel=label[0], ylabel=label[1])
        fig.colorbar(drawn, ax=ax, shrink=0.85, label=unit)
    error = np.linalg.norm(estimate - truth) / np.linalg.norm(truth)
    light = "Line emission" if kind == "emission" else "Light of a star, scattered by dust"
    fig.suptitle(f"{light}: {CELLS}³ cells, {VIEWS} views, 1 % noise; relative error {error:.3f}")
    with atomic_path(folder / f"tomography_{kind}.png") as temporary:
        fig.savefig(temporary, dpi=80)
    plt.close(fig)
    print(kind, error, found.chi2 / found.count)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "gallery" / "inversion")
    target.mkdir(parents=True, exist_ok=True)
    for sort in ("emission", "dust"):
        picture(sort, target)
