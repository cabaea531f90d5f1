"""Names of stars, planets and the Moon, and lines of the constellations, drawn over pictures of a sky."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.celestial.frames import SkyFrame
    from skyscatter.image.horizon import SkyView
    from skyscatter.image.spectral import SpectralImage

Array = NDArray[np.float64]

#: Colour and opacity of names and lines.
NAMES, LINES = ("#f2e6c9", 0.9), ("#8fb4e8", 0.45)
#: Names stand this far from what they name, and are this high, for a picture of 720 rows [pixel].
GAP, HEIGHT, ROWS = 7.0, 13.0, 720
#: Dots to the inch and points to the inch, as matplotlib has them.
DPI, POINTS = 100.0, 72.0
#: Points on a line between two stars: it is a part of a great circle.
STEPS = 24
#: Stars fainter than this have no name, for there are many; planets that no eye sees have none either [mag].
FAINTEST, VISIBLE = 3.0, 6.0
#: A line that goes on across this share of the picture has left it at one side and come in at the other.
JUMP = 0.5


def marked(image: SpectralImage, picture: Array, names: bool, lines: bool) -> Array:
    """A picture with names or lines drawn over it.

    Parameters
    ----------
    image : SpectralImage
        Whose recipe says where it looks, and from where on Earth and when.
    picture : ndarray, shape (y, x, 3)
        Display-encoded, in [0, 1].
    names : bool
        Of the Moon, the planets and stars of V below 3 that have one.
    lines : bool
        Of the constellations.

    Returns
    -------
    ndarray, shape (y, x, 3)

    Raises
    ------
    DomainError
        If the recipe does not say place and time.

    Examples
    --------
    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.image.chart import marked
    >>> scene = skyscatter.sky_at((48.86, 2.35), "2026-01-12T22:00Z")
    >>> camera = skyscatter.Fisheye(width=64, height=64)
    >>> recipe = {"scene": scene.model_dump(mode="json"), "camera": camera.model_dump(mode="json")}
    >>> image = skyscatter.SpectralImage(np.zeros((64, 64, 1)), [550], recipe=recipe)
    >>> drawn = marked(image, np.zeros((64, 64, 3)), names=False, lines=True)
    >>> drawn.shape, bool(drawn.max() > 0.3)
    ((64, 64, 3), True)
    """
    from skyscatter.image.horizon import sky_view

    view = sky_view(image)
    sight = None if view is None else view.scene.sight
    if view is None or sight is None:
        what = "labels" if names else "lines"
        raise DomainError(what, True, "are for skies of a place and a time; give --place and --time, or leave it out")
    over = _drawn(view, sight, names, lines) / 255.0
    opacity = over[..., 3:]
    return np.asarray(picture * (1.0 - opacity) + over[..., :3] * opacity)


def _drawn(view: SkyView, sight: SkyFrame, names: bool, lines: bool) -> NDArray[np.uint8]:
    """A transparent picture of the marks alone, shape (y, x, 4)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    width, height = view.camera.width, view.camera.height
    scale = max(height / ROWS, 0.6) * POINTS / DPI
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="none")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False, xticks=[], yticks=[])
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    if lines:
        axes.add_collection(LineCollection(courses(view, sight), colors=LINES[0], alpha=LINES[1], linewidths=scale))
    if names:
        written: list[Any] = []
        for name, x, y in named(view, sight):
            # Towards the middle, else it is cut off.
            side, align = (-1.0, "right") if x > 0.5 * width else (1.0, "left")
            text = axes.annotate(
                name, (x, y), (side * GAP * scale, 0.0), textcoords="offset points", ha=align, va="center",
                color=NAMES[0], alpha=NAMES[1], fontsize=HEIGHT * scale, annotation_clip=True,
            )  # fmt: skip
            box = text.get_window_extent(canvas.get_renderer())
            if any(box.overlaps(other) for other in written):  # what comes first is brighter
                text.remove()
            else:
                written.append(box)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), np.uint8)


def named(view: SkyView, sight: SkyFrame) -> list[tuple[str, float, float]]:
    """What has a name and is in the picture, and its pixel: moons, planets, then stars, brightest first."""
    from skyscatter.celestial.heavens import moons_of
    from skyscatter.celestial.planets import planets_at
    from skyscatter.celestial.stars import stars_at

    stars = stars_at(sight, limit=FAINTEST)
    planets = [planet for planet in planets_at(sight) if planet.magnitude < VISIBLE]
    found = [*moons_of(sight), *((planet.name, planet.direction) for planet in planets)]
    found += [(name, towards) for name, towards in zip(stars.names, stars.directions, strict=True) if name]
    x, y = pixels(view, np.array([towards for _, towards in found]))
    seen = np.flatnonzero(np.isfinite(x))
    return [(found[k][0], float(x[k]), float(y[k])) for k in seen]


def courses(view: SkyView, sight: SkyFrame) -> list[Array]:
    """Lines of the constellations in pixels, each of shape (point, 2), in pieces that lie within the picture."""
    from skyscatter.celestial.constellations import constellation_lines

    ends = constellation_lines(sight)
    share = np.linspace(0.0, 1.0, STEPS)[:, None]
    arcs = ends[:, :1] * (1.0 - share) + ends[:, 1:] * share
    arcs /= np.linalg.norm(arcs, axis=-1, keepdims=True)
    found = []
    for arc in arcs:
        line = np.stack(pixels(view, arc), axis=1)
        gone = ~np.isfinite(line[:, 0])
        far = np.abs(np.diff(line[:, 0], prepend=line[0, 0])) > JUMP * view.camera.width
        for piece in np.split(line, np.flatnonzero(gone | far | np.concatenate([[False], gone[:-1]]))):
            kept = piece[np.isfinite(piece[:, 0])]
            if len(kept) > 1:
                found.append(kept)
    return found


def pixels(view: SkyView, directions: Array) -> tuple[Array, Array]:
    """Where directions (..., 3) are in the picture [pixel]; NaN outside of it and below the horizon."""
    observer = view.scene.observer
    x, y = view.camera.pixel(directions, observer)
    horizon = -np.arccos(observer.planet_radius / (observer.planet_radius + observer.altitude))
    hidden = directions[..., 2] < np.sin(horizon)
    return np.where(hidden, np.nan, x), np.where(hidden, np.nan, y)
