"""Tomography: how well and how fast densities come back from images.

    own      blobs of dust around a star, rendered by skyscatter's own path: the scenes on which SETTINGS were chosen
    cells    the same blobs as codes on cells show them: light and dust constant within each, noise of packets
    blobs    six images by another code, RADMC-3D (reference/inversion_blobs), with the same settings
    voxels   64^3 cells from 8 images of 64x64 with 1 % noise, scattered light and line emission
    pictures those of docs/gallery/inversion

Errors are ||estimate - truth|| / ||truth||, the correlation of the voxels, and the ratio of the masses.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import common
import numpy as np

from skyscatter import Component, Medium, Particles, PointStar, SpaceScene, SpectralTable, View, radiance
from skyscatter.inversion.tomography import reconstruct
from skyscatter.inversion.views import ImageView, Stack
from skyscatter.inversion.voxelimage import VoxelModel
from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics, mean_inverse_square
from skyscatter.optics.phase import Isotropic
from skyscatter.solvers import options as solvers

#: Those of the scenes of `own`; docs/validation-inversion-tomography.md tells what was looked at before.
SETTINGS: dict[str, Any] = {"prior": "tikhonov", "multiple": 2, "samples": 128, "stop": 1e-4}
WAVELENGTH = [550.0]
GALLERY = Path(__file__).parent.parent / "docs" / "gallery" / "inversion"
#: Views of `cells`: inclination and azimuth [deg], three at right angles to an axis of the grid and more oblique ones.
CELL_ANGLES = [(0, 0), (90, 0), (90, 60), (90, 120), (45, 30), (45, 210)]
#: For images made on cells.
CELL_SETTINGS: dict[str, Any] = SETTINGS | {"interpolation": "nearest", "stop": 3e-4, "coarsest": 24}


def dusty_scene(frame: VoxelFrame, density: Any, albedo: float = 0.6, interpolation: str = "linear") -> SpaceScene:
    """Isotropic grains of unit extinction per density around a star of 1 W nm-1 at the origin."""
    grains = Particles(extinction=1.0, single_scattering_albedo=albedo, phase=Isotropic())
    star = PointStar(spectrum=SpectralTable(wavelengths=(500.0,), values=(1.0,)))
    dust = Component(name="dust", density=frame.grid(density, interpolation=interpolation), optics=grains)
    return SpaceScene(medium=Medium(components=(dust,)), stars=(star,), view=View(distance=1000.0))


def random_blobs(frame: VoxelFrame, seed: int, column: float = 0.5, count: int = 6) -> Any:
    """Gaussian blobs in the unit sphere whose largest column along x is `column`."""
    rng, middles, density = np.random.default_rng(seed), frame.middles(), np.zeros(frame.shape)
    for _ in range(count):
        place = rng.normal(size=3)
        place *= rng.uniform(0.1, 0.65) / np.linalg.norm(place)
        width, height = rng.uniform(0.15, 0.35), rng.uniform(0.3, 1.0)
        density += height * np.exp(-((middles - place) ** 2).sum(axis=-1) / (2 * width**2))
    density *= 1 - np.clip((np.linalg.norm(middles, axis=-1) - 0.85) / 0.15, 0, 1)
    return density * column / (density.sum(axis=0) * frame.cell[0]).max()


def axes(inclination: float, azimuth: float) -> tuple[Any, Any]:
    """Towards the observer, and right in the image, of RADMC-3D's cameras; angles in radians."""
    i, p = inclination, azimuth
    towards = np.array([-np.sin(i) * np.sin(p), -np.sin(i) * np.cos(p), np.cos(i)])
    return towards, np.array([np.cos(p), -np.sin(p), 0.0])


def score(estimate: Any, truth: Any) -> tuple[float, float, float]:
    """Relative error, correlation, ratio of masses."""
    error = float(np.linalg.norm(estimate - truth) / np.linalg.norm(truth))
    return error, float(np.corrcoef(estimate.ravel(), truth.ravel())[0, 1]), float(estimate.sum() / truth.sum())


def own_views(frame: VoxelFrame, density: Any, seed: int, pixels: int, walks: int, noise: float) -> list[ImageView]:
    """Six images by path with noise of their own, and `noise` on top."""
    angles = [(0, 0), (60, 0), (60, 120), (60, 240), (90, 60), (90, 150)]
    blank = np.zeros((pixels, pixels))
    views = [ImageView.parallel(blank, 1.0, *axes(*np.radians(a)), 1.7, upwards=True) for a in angles]
    stack, rng = Stack(views), np.random.default_rng(seed + 100)
    found = radiance(
        dusty_scene(frame, density),
        stack.origins,
        stack.directions,
        WAVELENGTH,
        solver=solvers.Path(samples=walks, seed=7),
    )
    added = np.hypot(noise * found.radiance, 0.02 * found.radiance.mean())
    data = found.radiance + added * rng.normal(size=added.shape)
    sigma = np.hypot(added, found.standard_error)
    parts = zip(stack.split(data), stack.split(sigma), views, strict=True)
    return [ImageView.make(d, s, v.origins, v.directions) for d, s, v in parts]


def packet_noise(apart: Any, packets: float, cell: float) -> Any:
    """Relative noise of images made from packets of photons that are counted in cells, in uniform dust of radius 1.

    A cell at the distance r from the star is crossed by packets * 1.5 cell^2 / (4 pi r^2) of them (a convex body's mean
    shadow is a quarter of its surface), each with its own path through it, whose relative mean square is 1.6 for a
    cube.  Along a line of sight the light of the cells goes as 1 / r^2.
    """
    depth = (np.arange(int(2 / cell)) + 0.5) * cell - 1
    r2 = apart[..., None] ** 2 + depth**2
    variance = 1.6 * 4 * np.pi * r2 / (1.5 * cell**2 * packets)
    inside = r2 < 1
    light, spread = np.where(inside, 1 / r2, 0.0), np.where(inside, variance / r2**2, 0.0)
    total = light.sum(axis=-1)
    edge = np.sqrt(1.6 * 4 * np.pi / (1.5 * cell**2 * packets))
    return np.where(total > 0, np.sqrt(spread.sum(axis=-1)) / np.maximum(total, 1e-300), edge)


def smoothed(image: Any, width: float) -> Any:
    """An image without its noise, which an estimate of errors must not follow: dark pixels are no better known."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(image, width, mode="nearest")


def distances(pixels: int, half: float) -> Any:
    """Of the lines of sight from the middle."""
    x = ((np.arange(pixels) + 0.5) / pixels * 2 - 1) * half
    return np.hypot(x[:, None], x)


def cell_views(frame: VoxelFrame, density: Any, seed: int, pixels: int, packets: float) -> list[ImageView]:
    """Six images of light of all orders, made as codes on cells make them: source and dust constant within each.

    The star's light in a cell is the mean over it, with the noise of packets counted there, the same for all views;
    light scattered more than once is that of `path` in the same cells, with the same relative noise.
    """
    rng, cell, half, angles = np.random.default_rng(seed), float(frame.cell[0]), 1.7, CELL_ANGLES
    scene = dusty_scene(frame, density, interpolation="nearest")
    model = VoxelModel.from_scene(dusty_scene(frame, density), WAVELENGTH)
    n = frame.shape[0] + 2
    toward = model.prepare(density).toward.reshape(n, n, n)[1:-1, 1:-1, 1:-1]
    faces = np.linspace(-1, 1, frame.shape[0] + 1)
    far = np.linalg.norm(frame.middles(), axis=-1)
    light = mean_inverse_square(faces, faces, faces) / (4 * np.pi) * np.exp(-toward * far)
    noise = np.sqrt(1.6 * 4 * np.pi * far**2 / (1.5 * cell**2 * packets)) * rng.normal(size=light.shape)
    source = 0.6 / (4 * np.pi) * density * light
    blank, images = np.zeros((pixels, pixels)), []
    rays = Stack([ImageView.parallel(blank, 1.0, *axes(*np.radians(a)), half, upwards=True) for a in angles])
    found = radiance(
        scene, rays.origins, rays.directions, WAVELENGTH, solver=solvers.Path(samples=256, seed=seed), parts=True
    )
    for angle, more in zip(angles, rays.split(found.layers["multiple"]), strict=True):
        clean, noisy = (_through_cells(s, density, angle, pixels, half, cell) for s in (source, source * (1 + noise)))
        images.append(np.where(clean > 0, noisy * (1 + more[..., 0] / np.maximum(clean, 1e-300)), 0.0))
    return [_blob_view(image, angle, half, cell, packets) for image, angle in zip(images, angles, strict=True)]


def _through_cells(source: Any, density: Any, angle: Any, pixels: int, half: float, cell: float) -> Any:
    """What a source and an extinction that are constant within cells show, in short steps."""
    towards, right = axes(*np.radians(angle))
    x = ((np.arange(pixels) + 0.5) / pixels * 2 - 1) * half
    up, depth = np.cross(towards, right), np.linspace(1.75, -1.75, 421)
    image, tau, step = np.zeros((pixels, pixels)), np.zeros((pixels, pixels)), depth[0] - depth[1]
    for t in depth:
        at = x[None, :, None] * right + x[:, None, None] * up + t * towards
        index = np.floor((at + 1) / cell).astype(int)
        inside = np.all((index >= 0) & (index < density.shape[0]), axis=-1)
        i, j, k = np.moveaxis(np.where(inside[..., None], index, 0), -1, 0)
        image += inside * source[i, j, k] * np.exp(-tau - 0.5 * step * density[i, j, k]) * step
        tau += inside * density[i, j, k] * step
    return image


def _blob_view(image: Any, angle: Any, half: float, cell: float, packets: float) -> ImageView:
    """An image on cells with its rays and an estimate of its errors from how it was made."""
    pixels = image.shape[0]
    mean = smoothed(image, cell * pixels / (2 * half))
    sigma = packet_noise(distances(pixels, half), packets, cell) * np.maximum(mean, 0.01 * mean.mean())
    # No light at all: the line of sight misses the cells.
    sigma = np.where(image > 0, sigma, np.inf)
    return ImageView.parallel(image, sigma, *axes(*np.radians(angle)), half, upwards=True)


def blob_views(path: Path, packets: float = 1e5) -> tuple[list[ImageView], Any, VoxelFrame]:
    """The images of reference/inversion_blobs with an estimate of their noise, the truth, and its cells."""
    with np.load(path) as file:
        images, angles, truth = file["images"], file["views_incl_phi_deg"], file["kappa_R"]
        half = float(np.max(np.abs(file["extent_R"])))
    frame = VoxelFrame.cube(truth.shape[0], 1.0)
    cell = float(frame.cell[0])
    views = [_blob_view(image, angle, half, cell, packets) for image, angle in zip(images, angles, strict=True)]
    return views, truth, frame


def solve(views: list[ImageView], frame: VoxelFrame, truth: Any, **options: Any) -> tuple[list[Any], Any]:
    """A row of the table: errors and time."""
    began = time.perf_counter()
    found = reconstruct(views, dusty_scene(frame, np.ones(frame.shape)), WAVELENGTH, frame=frame, **options)
    seconds = time.perf_counter() - began
    return [*score(found.density[0], truth), found.chi2 / found.count, seconds], found


def run_own(seeds: list[int]) -> str:
    """Errors on own scenes."""
    rows, frame = [], VoxelFrame.cube(24, 1.0)
    for seed in seeds:
        truth = random_blobs(frame, seed)
        row, _ = solve(own_views(frame, truth, seed, 48, 64, 0.02), frame, truth, **SETTINGS)
        rows.append([seed, *row])
    return common.table(["seed", "relative L2 error", "correlation", "mass ratio", "chi2 / data", "time [s]"], rows)


def run_cells(seeds: list[int]) -> str:
    """Errors on own images made on cells."""
    rows, frame = [], VoxelFrame.cube(24, 1.0)
    for seed in seeds:
        truth = random_blobs(frame, seed)
        row, _ = solve(cell_views(frame, truth, seed, 48, 1e5), frame, truth, **CELL_SETTINGS)
        rows.append([seed, *row])
    return common.table(["seed", "relative L2 error", "correlation", "mass ratio", "chi2 / data", "time [s]"], rows)


def run_blobs(reference: Path) -> str:
    """Errors on the images by another code, with multiple scattering and without."""
    rows = []
    for path in sorted((reference / "inversion_blobs").glob("blobs_seed*.npz")):
        views, truth, frame = blob_views(path)
        for name, options in (
            ("all orders", CELL_SETTINGS),
            ("single scattering only", CELL_SETTINGS | {"multiple": 0}),
        ):
            row, found = solve(views, frame, truth, **options)
            rows.append([path.stem, name, *row, found.diagnostics["reason"]])
    return common.table(
        ["images", "model", "relative L2 error", "correlation", "mass ratio", "chi2 / data", "time [s]", "stopped"],
        rows,
    )


def voxel_case(kind: str, cells: int, pixels: int, views: int, seed: int) -> tuple[list[ImageView], VoxelModel, Any]:
    """A model of 64^3 cells and its own noisy images from all around."""
    frame = VoxelFrame.cube(cells, 1.0)
    truth = random_blobs(frame, seed, column=1.0, count=10)
    if kind == "emission":
        optics, lights = VoxelOptics.columns(), VoxelLights.none(1)
    else:
        optics, lights = VoxelOptics.make(0.6, 1.0, g=0.3), VoxelLights.stars([[0.03, 0.02, 0.01]], [[1.0]])
    model = VoxelModel(frame, optics, lights, np.zeros(1), step=1.0)
    blank, made, rng = np.zeros((pixels, pixels)), [], np.random.default_rng(seed)
    for k in range(views):
        # Directions spread evenly over half a sphere (a spiral of golden angles).
        tilt, turn = np.arccos(1 - (k + 0.5) / views), k * np.pi * (3 - np.sqrt(5))
        view = ImageView.parallel(blank, 1.0, *axes(tilt, turn), 1.2)
        image = model.image(truth, view.origins.reshape(-1, 3), view.directions.reshape(-1, 3)).reshape(pixels, pixels)
        # 1 % of every pixel, and of the mean pixel where it is dark.
        sigma = 0.01 * np.maximum(image, image.mean())
        made.append(ImageView.make(image + sigma * rng.normal(size=image.shape), sigma, view.origins, view.directions))
    return made, model, truth


def run_voxels(cells: int, pixels: int, views: int) -> str:
    """Errors and times on 64^3 cells."""
    rows = []
    for kind in ("scattered light", "emission"):
        made, model, truth = voxel_case("emission" if kind == "emission" else "dust", cells, pixels, views, 21)
        began = time.perf_counter()
        found = reconstruct(made, model)
        seconds = time.perf_counter() - began
        work = sum(h["iterations"] for h in found.history)
        rows.append([kind, *score(found.density[0], truth), found.chi2 / found.count, work, seconds])
    return common.table(
        ["images", "relative L2 error", "correlation", "mass ratio", "chi2 / data", "iterations", "time [s]"], rows
    )


def picture(kind: str) -> None:
    """Truth, estimate, error, one view, its residual and the standard deviation, for the gallery."""
    import matplotlib.pyplot as plt

    made, model, truth = voxel_case(kind, 32, 48, 8, 5)
    found = reconstruct(made, model, freedom=True, deviation=True)
    where, density = truth.shape[2] // 2, found.density[0]
    error = density - truth
    side = {"origin": "lower", "extent": (-1, 1, -1, 1)}
    worst = float(np.abs(error).max())
    panels = [
        ("truth", truth[:, :, where].T, {"cmap": "magma", "vmax": truth.max(), **side}),
        ("estimate", density[:, :, where].T, {"cmap": "magma", "vmax": truth.max(), **side}),
        ("estimate - truth", error[:, :, where].T, {"cmap": "RdBu_r", "vmin": -worst, "vmax": worst, **side}),
        ("view 1 of 8", made[0].data[..., 0], {"cmap": "magma", "vmax": np.quantile(made[0].data, 0.995)}),
        ("its residual / noise", found.residuals[0][..., 0], {"cmap": "RdBu_r", "vmin": -4, "vmax": 4}),
        ("standard deviation", found.deviation[0][:, :, where].T, {"vmin": 0, **side}),
    ]
    fig, spots = plt.subplots(2, 3, figsize=(9.0, 5.2), layout="constrained")
    for spot, (title, values, options) in zip(spots.flat, panels, strict=True):
        fig.colorbar(spot.imshow(values, **options), ax=spot)
        spot.set(title=title, **({"xlabel": "x [m]", "ylabel": "y [m]"} if "extent" in options else {}))
    words = "Line emission" if kind == "emission" else "Light of a star, scattered by dust"
    fig.suptitle(f"{words}: 32³ cells, 8 views, 1 % noise; relative error {score(density, truth)[0]:.3f}", fontsize=10)
    fig.savefig(GALLERY / f"tomography_{kind}.png", dpi=100)


def main() -> None:
    """Command line."""
    parser = common.parser(__doc__)
    parser.add_argument("--cases", default="own,cells,blobs,voxels")
    parser.add_argument("--seeds", default="11,12,13,14", help="of the own scenes")
    parser.add_argument("--reference", type=Path, help="folder with inversion_blobs")
    parser.add_argument("--cells", type=int, default=64)
    parser.add_argument("--pixels", type=int, default=64)
    parser.add_argument("--views", type=int, default=8)
    given = parser.parse_args()
    where, blocks, seeds = common.machine(), [], [int(s) for s in given.seeds.split(",")]
    for case in given.cases.split(","):
        if case == "own":
            blocks.append("Own scenes, 24^3 cells, six images of 48x48:\n\n" + run_own(seeds))
        elif case == "cells":
            blocks.append("Own scenes as images on cells, all orders:\n\n" + run_cells(seeds))
        elif case == "blobs":
            if given.reference is None:
                raise SystemExit("--reference is missing: the folder with inversion_blobs")
            blocks.append("Images by RADMC-3D, 24^3 cells, six images of 48x48:\n\n" + run_blobs(given.reference))
        elif case == "voxels":
            title = f"{given.cells}^3 cells, {given.views} images of {given.pixels}x{given.pixels}, 1 % noise:\n\n"
            blocks.append(title + run_voxels(given.cells, given.pixels, given.views))
        elif case == "pictures":
            for kind in ("emission", "dust"):
                picture(kind)
        else:
            raise SystemExit(f"--cases {case}: choose from own, cells, blobs, voxels, pictures")
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    common.report("tomography", where, common.versions("numpy", "numba", "scipy"), blocks, words, given.write)


if __name__ == "__main__":
    main()
