"""The spectrum under a pixel, and the polarisation of a picture, drawn."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import atomic_path
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.geometry.meridian import meridian_frame
from skyscatter.image.polarisation import SCALES, STOKES, STOKES_ERRORS, band_angle, band_degree, band_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from skyscatter.image.spectral import SpectralImage


def plot_spectrum(
    image: SpectralImage, x: int, y: int, ax: Axes | None = None, path: str | os.PathLike[str] | None = None
) -> Axes:
    """Draw radiance over wavelength for one pixel and a line for each layer, with bands of one standard error.

    Parameters
    ----------
    image : SpectralImage
    x, y : int
        Column from the left and row from the top, from 0.
    ax : matplotlib Axes, optional
        Where to draw; a new figure if none is given.
    path : path-like, optional
        Also save the figure there (any format of matplotlib, by extension).

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    DomainError
        If the pixel is not in the image or lies outside the camera's field, or matplotlib does not know the extension.
    """
    from matplotlib.figure import Figure

    rows, columns, _ = image.shape
    if not 0 <= x < columns or not 0 <= y < rows:
        raise DomainError("pixel", (x, y), f"the image has columns 0 to {columns - 1} and rows 0 to {rows - 1}")
    spectrum = image.radiance[y, x]
    if np.isnan(spectrum).any():
        raise DomainError("pixel", (x, y), "lies outside the camera's field")
    if ax is None:
        ax = Figure(figsize=(6.4, 4.0), layout="constrained").add_subplot()
    marker = "." if spectrum.size < 60 else ""
    (line,) = ax.plot(image.wavelengths, spectrum, marker=marker, label="radiance")
    if image.standard_error is not None:
        error = image.standard_error[y, x]
        ax.fill_between(image.wavelengths, spectrum - error, spectrum + error, color=line.get_color(), alpha=0.3, lw=0)
    for name, cube in image.layers.items():
        if image.polarised and name in STOKES_ERRORS:
            continue
        (line,) = ax.plot(image.wavelengths, cube[y, x], lw=1.0, label=name)
        if image.polarised and name in STOKES and f"{name}_error" in image.layers:
            middle, error = cube[y, x], image.layers[f"{name}_error"][y, x]
            ax.fill_between(image.wavelengths, middle - error, middle + error, color=line.get_color(), alpha=0.3, lw=0)
    if image.layers:
        ax.legend()
    ax.set_xlabel("vacuum wavelength [nm]")
    ax.set_ylabel(r"spectral radiance [W m$^{-2}$ sr$^{-1}$ nm$^{-1}$]")
    ax.set_title(f"pixel x = {x}, y = {y}")
    if path is not None:
        _save(ax, path)
    return ax


def plot_polarisation(
    image: SpectralImage,
    show: str = "degree",
    wavelength: float | None = None,
    *,
    bars: int = 0,
    camera: Any = None,
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Axes:
    """Draw degree or angle of linear polarisation with a colour bar and, if asked for, its direction as short bars.

    Parameters
    ----------
    image : SpectralImage
        With Stokes layers.
    show : {"degree", "angle"}
    wavelength : float, optional
        One of the image's wavelengths [nm]; by default all, weighted by luminous efficiency.
    bars : int
        About how many bars to draw along the longer side; 0 for none.  A bar lies as the electric field vibrates in the
        picture; its length is proportional to the degree of linear polarisation.
    camera : Camera, optional
        Needed for bars if the image's recipe does not hold one.
    ax : matplotlib Axes, optional
        Where to draw; a new figure if none is given.
    path : path-like, optional
        Also save the figure there (any format of matplotlib, by extension).

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    DomainError
        If the image has no Stokes layers, for another `show` or `wavelength`, or for bars without a camera.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    values = band_values(image, show, wavelength)
    if isinstance(bars, bool) or not isinstance(bars, (int, np.integer)) or bars < 0:
        raise DomainError("bars", bars, "a number of bars along the longer side, or 0 for none")
    segments = _bars(image, wavelength, int(bars), camera) if bars else None
    rows, columns, _ = image.shape
    wide = rows < 0.6 * columns
    if ax is None:
        width, shape = 7.0, min(rows / columns, 1.5)
        size = (width, 1.3 + width * shape) if wide else (width, 0.9 + 0.82 * width * shape)
        ax = Figure(figsize=size, layout="constrained").add_subplot()
    scale = SCALES[show]
    # Undefined pixels keep the paper's colour, which neither map holds.
    drawn = ax.imshow(values, cmap=colormaps[scale.colours], vmin=scale.low, vmax=scale.high, interpolation="nearest")
    # The label beside a low picture would be longer than the bar.
    place = {"orientation": "horizontal", "shrink": 0.7} if wide else {"fraction": 0.04, "pad": 0.02}
    bar = ax.figure.colorbar(drawn, ax=ax, label=scale.label, **place)
    if show == "angle":
        bar.set_ticks(range(0, 181, 45))
    if segments is not None:
        _draw_bars(ax, segments)
    ax.set_xlim(-0.5, columns - 0.5)
    ax.set_ylim(rows - 0.5, -0.5)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_frame_on(False)
    wl = image.wavelengths
    band = f"{wl[0]:g} to {wl[-1]:g} nm, weighted by luminous efficiency" if wl.size > 1 else f"{wl[0]:g} nm"
    ax.set_title(band if wavelength is None else f"{wavelength:g} nm", fontsize="medium")
    if path is not None:
        _save(ax, path)
    return ax


def _draw_bars(ax: Axes, segments: NDArray[np.float64]) -> None:
    from matplotlib.collections import LineCollection

    # White on black: seen on every colour of both maps.
    for colour, width in (("black", 2.2), ("white", 1.1)):
        ax.add_collection(LineCollection(list(segments), colors=colour, linewidths=width, capstyle="round"))


def _recipe_camera(image: SpectralImage, camera: Any) -> tuple[Any, Any]:
    """The camera and the observer (None if unknown) that an image was made with."""
    from pydantic import TypeAdapter, ValidationError

    from skyscatter.geometry.camera import Camera
    from skyscatter.scene import Scene

    if camera is None:
        try:
            camera = TypeAdapter(Camera).validate_python(image.recipe["camera"])
        except (KeyError, ValidationError) as error:
            raise DomainError("camera", None, "the image's recipe holds none: give the one it was made with") from error
    if (camera.height, camera.width) != image.shape[:2]:
        raise DomainError("camera", f"{camera.width}x{camera.height}", "has another size than the image")
    try:
        observer = Scene.model_validate(image.recipe["scene"]).observer
    except (KeyError, ValidationError, SkyscatterError):
        observer = None  # which only a view of the planet needs, and it says so
    return camera, observer


def _bars(image: SpectralImage, wavelength: float | None, number: int, camera: Any) -> NDArray[np.float64]:
    """Ends of the bars in pixel coordinates, shape (bar, 2, 2), in the order x, y."""
    camera, observer = _recipe_camera(image, camera)
    rows, columns, _ = image.shape
    step = max(rows, columns) / number
    x = np.unique(np.floor(np.arange(step / 2, columns, step)).astype(int))
    y = np.unique(np.floor(np.arange(step / 2, rows, step)).astype(int))
    at = np.ix_(y, x)
    degree, chi = band_degree(image, wavelength)[at], np.radians(band_angle(image, wavelength)[at])
    d = camera.directions(observer)[at]
    v, left = meridian_frame([0.0, 0.0, 1.0], d)  # the observer stands on the z axis
    field = np.cos(chi)[..., None] * v + np.sin(chi)[..., None] * left
    small = 1e-4  # [rad]; a tangent in the picture, well above rounding
    ends = [np.stack(camera.pixel(d + sign * small * field, observer), axis=-1) for sign in (-1.0, 1.0)]
    along = ends[1] - ends[0]
    with np.errstate(invalid="ignore"):
        length = np.hypot(along[..., 0], along[..., 1])
        # A pair of ends on both sides of a panorama's seam is far apart; at the rim one end may lie outside.
        good = np.isfinite(length) & (length > 0.0) & (length < min(rows, columns) / 2) & np.isfinite(degree)
    middle = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)[good]
    half = 0.45 * step * np.clip(degree[good], 0.0, 1.0)[:, None] * along[good] / length[good][:, None]
    return np.stack([middle - half, middle + half], axis=1)


def _save(ax: Axes, path: str | os.PathLike[str]) -> None:
    figure = ax.get_figure(root=True)
    assert figure is not None  # axes that were just drawn on belong to a figure
    extension = os.path.splitext(path)[1].lstrip(".").lower()
    known = figure.canvas.get_supported_filetypes()
    if extension not in known:
        raise DomainError("plot file", str(path), f"the extension must be one of {', '.join(sorted(known))}")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format=extension)
