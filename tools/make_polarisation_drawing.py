"""Draws docs/polarisation.svg: the axes to which Stokes parameters refer, in space and as the observer sees them.

python tools/make_polarisation_drawing.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from skyscatter.geometry.meridian import meridian_frame
from skyscatter.geometry.vectors import direction_from_azimuth_elevation

TARGET = Path(__file__).resolve().parent.parent / "docs" / "polarisation.svg"
AZIMUTH, ELEVATION = 62.0, 30.0  # of the line of sight that is drawn [degree]
CAMERA = direction_from_azimuth_elevation(200.0, 24.0)  # from where the drawing in space is looked at
GREY, BLUE, RED = "0.55", "#1f5fa8", "#b3261e"


def flat(points: Any) -> np.ndarray:
    """Parallel projection of points (..., 3) onto the paper, (..., 2)."""
    right = np.cross([0.0, 0.0, 1.0], CAMERA)
    right /= np.linalg.norm(right)
    return np.stack([points @ right, points @ np.cross(CAMERA, right)], axis=-1)


def beside(point: np.ndarray, x: float, y: float) -> np.ndarray:
    """Place on the paper at an offset from a point in space."""
    return flat(point) + np.array([x, y])


def arrow(axes: Any, start: Any, end: Any, text: str, offset: tuple[float, float], colour: str = "black") -> None:
    a, b = flat(np.asarray(start, dtype=float)), flat(np.asarray(end, dtype=float))
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", b, a, arrowprops=style)
    axes.text(b[0] + offset[0], b[1] + offset[1], text, color=colour, ha="center", va="center")


def curve(axes: Any, azimuth: Any, elevation: Any, radius: float = 1.0, **style: Any) -> None:
    xy = flat(radius * direction_from_azimuth_elevation(azimuth, elevation))
    axes.plot(xy[:, 0], xy[:, 1], **{"color": GREY, "lw": 1.0, **style})


def draw_space(axes: Any) -> None:
    """Observer, horizon, meridian plane of the line of sight, and v, l, k where the light comes from."""
    turn = np.linspace(0.0, 360.0, 361)
    rise = np.linspace(0.0, 90.0, 91)
    d = direction_from_azimuth_elevation(AZIMUTH, ELEVATION)
    v, left = meridian_frame([0.0, 0.0, 1.0], d)
    plane = direction_from_azimuth_elevation(AZIMUTH, rise)
    axes.fill(*flat(np.vstack([plane, [[0.0, 0.0, 0.0]]])).T, color=BLUE, alpha=0.10, lw=0)
    curve(axes, turn, 0.0)
    curve(axes, AZIMUTH, rise, color=BLUE)
    axes.plot(*flat(np.array([[0.0, 0.0, 0.0], plane[0]])).T, color=BLUE, lw=1.0)
    for end, text, offset in (
        ([1.25, 0, 0], "x east", (0.04, -0.1)),
        ([0, 1.25, 0], "y north", (-0.02, 0.08)),
        ([0, 0, 1.25], "z zenith", (0.0, 0.07)),
    ):
        arrow(axes, [0, 0, 0], end, text, offset)
    arrow(axes, [0, 0, 0], d, "", (0, 0))
    axes.text(*beside(0.62 * d, -0.06, 0.06), "d", ha="center", va="center", fontweight="bold")
    arrow(axes, d, d + 0.5 * v, "v", (0.0, 0.08), RED)
    arrow(axes, d, d + 0.5 * left, "l", (-0.06, 0.04), RED)
    arrow(axes, 1.6 * d, 1.02 * d, "", (0, 0), RED)
    axes.text(*beside(1.45 * d, 0.06, -0.04), "k = −d (light)", color=RED, ha="left", va="center")
    curve(axes, np.linspace(0.0, AZIMUTH, 40), 0.0, 0.42, color="black", lw=0.8)
    axes.text(*flat(0.54 * direction_from_azimuth_elevation(AZIMUTH * 0.45, 0.0)), "A", ha="center", va="center")
    curve(axes, AZIMUTH, np.linspace(0.0, ELEVATION, 40), 0.6, color="black", lw=0.8)
    axes.text(*flat(0.70 * direction_from_azimuth_elevation(AZIMUTH, 0.45 * ELEVATION)), "e", ha="center", va="center")
    axes.plot(0, 0, "o", color="black", ms=5)
    axes.text(-0.06, -0.09, "observer", ha="right", va="center")
    axes.text(*beside(plane[0], 0.04, -0.02), "meridian plane", color=BLUE, ha="left", va="center")
    axes.set_title("Line of sight d and its meridian plane", fontsize=11)
    axes.set(xlim=(-1.1, 1.85), ylim=(-0.5, 1.5))


def draw_seen(axes: Any) -> None:
    """The plane across the line of sight, as the observer sees it: v up, l to the left."""
    style = {"arrowstyle": "-|>", "color": RED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    for end, text, at in (
        ((0, 1.0), "v  (up: towards the zenith)", (0.06, 1.04)),
        ((-1.0, 0), "l = v × d  (left)", (-1.0, -0.12)),
    ):
        axes.annotate("", end, (0, 0), arrowprops=style)
        axes.text(*at, text, color=RED, ha="left" if end[1] else "center", va="center")
    chi = np.radians(30.0)
    e = np.array([-np.sin(chi), np.cos(chi)])  # from v towards l
    axes.plot(*np.array([-0.8 * e, 0.8 * e]).T, color=BLUE, lw=3, solid_capstyle="round")
    axes.text(*(0.92 * e + [-0.02, 0.03]), "E", color=BLUE, ha="center", va="center", fontweight="bold")
    arc = np.radians(np.linspace(0.0, 30.0, 30))
    axes.plot(-0.45 * np.sin(arc), 0.45 * np.cos(arc), color="black", lw=0.9)
    axes.text(-0.15, 0.56, "χ", ha="center", va="center")
    axes.plot(0, 0, "o", ms=10, mfc="white", mec="black")
    axes.plot(0, 0, "o", ms=3, color="black")
    axes.text(0.12, -0.13, "light comes out of the paper (k)", ha="left", va="center")
    axes.set_title("As the observer sees it, looking along d", fontsize=11)
    axes.set(xlim=(-1.3, 1.5), ylim=(-0.75, 1.15))


def draw_signs(axes: Any) -> None:
    """What the signs mean, seen as in the panel above."""
    cases = (("Q > 0", "χ = 0°"), ("Q < 0", "χ = 90°"), ("U > 0", "χ = 45°"), ("U < 0", "χ = 135°"))
    for number, (sign, text) in enumerate(cases):
        chi = np.radians((0.0, 90.0, 45.0, 135.0)[number])
        e = 0.32 * np.array([-np.sin(chi), np.cos(chi)])
        axes.plot(*np.add([-e, e], [number, 0]).T, color=BLUE, lw=3, solid_capstyle="round")
        axes.text(number, 0.55, sign, ha="center", va="center")
        axes.text(number, -0.55, text, ha="center", va="center", fontsize=9)
    for number, sign in ((4.1, 1.0), (5.4, -1.0)):
        turn = np.radians(np.linspace(20.0, 320.0, 80)) * sign + np.pi / 2
        x, y = number + 0.27 * np.cos(turn), 0.27 * np.sin(turn)
        axes.plot(x, y, color=BLUE, lw=1.6)
        head = {"arrowstyle": "-|>", "color": BLUE, "lw": 1.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 14}
        axes.annotate("", (x[-1], y[-1]), (x[-6], y[-6]), arrowprops=head)
        axes.text(number, 0.55, f"V {'>' if sign > 0 else '<'} 0", ha="center", va="center")
        axes.text(number, -0.55, "anticlockwise" if sign > 0 else "clockwise", ha="center", va="center", fontsize=9)
    axes.set(xlim=(-0.6, 6.1), ylim=(-0.75, 0.75))


def main() -> None:
    # The same bytes from every run, apart from matplotlib's version.
    matplotlib.rcParams.update({"svg.hashsalt": "skyscatter", "font.family": "DejaVu Sans", "font.size": 10})
    figure = Figure(figsize=(9.4, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(2.7, 1.0))
    for place, draw in ((grid[0, 0], draw_space), (grid[0, 1], draw_seen), (grid[1, :], draw_signs)):
        axes = figure.add_subplot(place)
        axes.set_aspect("equal")
        axes.axis("off")
        draw(axes)
    figure.savefig(TARGET, metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    main()
