"""Pictures of a retrieval for docs/gallery/inversion: sky, fit and residual, and the corner plot of the posterior.

python tools/make_retrieval_gallery.py          # retrieval.png and retrieval-corner.png, some minutes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import skyscatter
from skyscatter.atomic import atomic_path
from skyscatter.inversion import sky_image, with_values

GALLERY = Path(__file__).resolve().parent.parent / "docs" / "gallery" / "inversion"
WAVELENGTHS = (440.0, 670.0, 870.0)
NOISE = 0.03
TRUTH = {
    "haze.optical_depth": 0.30, "haze.single_scattering_albedo": 0.92, "haze.asymmetry": 0.65, "ground.albedo": 0.20,
}  # fmt: skip
TOLERANCE = 0.01


def main() -> None:
    """Make both."""
    start = skyscatter.load_model("earth-hazy")
    camera = skyscatter.Fisheye(width=48, height=48)

    def sky(model: skyscatter.Model) -> skyscatter.SpectralImage:
        scene = model.scene(sun_elevation_deg=40, sun_azimuth_deg=215)
        return skyscatter.render(scene, camera, WAVELENGTHS, solver=skyscatter.Orders(tolerance=TOLERANCE))

    true = sky(with_values(start, TRUTH))
    noise = 1 + NOISE * np.random.default_rng(5).standard_normal(true.radiance.shape)
    measured = skyscatter.SpectralImage(true.radiance * noise, WAVELENGTHS, recipe=true.recipe)
    data = sky_image(measured, noise=NOISE, pixels=120)
    result = skyscatter.fit(
        start, data, dict.fromkeys(TRUTH), solver=skyscatter.Orders(tolerance=TOLERANCE), model_error=0.003
    )
    print(result)
    fitted, band = sky(result.model), 1
    panels = (
        (np.log10(measured.radiance[..., band]), "measured, log₁₀ of W m⁻² sr⁻¹ nm⁻¹", "magma", None),
        (np.log10(fitted.radiance[..., band]), "fitted", "magma", None),
        (100 * (fitted.radiance / true.radiance - 1)[..., band], "error: fitted over true - 1 [%]", "RdBu_r", 1.0),
        (100 * (measured.radiance / fitted.radiance - 1)[..., band], "residual: measured over fitted - 1 [%]",
         "RdBu_r", 300 * NOISE),
    )  # fmt: skip
    figure = Figure(figsize=(13, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    for ax, (plane, title, colours, limit) in zip(figure.subplots(1, 4), panels, strict=True):
        low, high = np.nanpercentile(panels[0][0], [1, 99.5]) if limit is None else (-limit, limit)
        shown = ax.imshow(plane, cmap=colours, vmin=low, vmax=high)
        ax.set_title(title, fontsize=9)
        ax.axis("off")
        figure.colorbar(shown, ax=ax, shrink=0.8)
    rows, columns = (data.coordinates()[name][:: len(WAVELENGTHS)] for name in ("row", "column"))
    figure.axes[0].plot(columns, rows, ".", ms=1.5, color="white")
    GALLERY.mkdir(parents=True, exist_ok=True)
    with atomic_path(GALLERY / "retrieval.png") as temporary:
        figure.savefig(temporary, dpi=110)
    result.corner(GALLERY / "retrieval-corner.png", truth=TRUTH)


if __name__ == "__main__":
    main()
