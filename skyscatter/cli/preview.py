"""The picture growing in the terminal while it is made: two pixels a character, of what the run has finished."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from skyscatter.solvers.state import RenderState

Array = NDArray[np.float64]

#: Lines of the terminal that are left to others.
FREE = 4
#: The upper half of a character's cell; its ground is the lower one.
HALF = "\u2580"


class Preview:
    """Looks at a run's state, which it never changes, and draws what is finished; the rest is black.

    Parameters
    ----------
    state : callable
        Gives the state of the run, or None before it has begun.
    scene : Scene, SpaceScene or SurfaceScene
    camera : Camera
    wavelengths : ndarray, shape (wavelength,)
        [nm]
    tone : str
        One of `skyscatter.image.tone.TONES`; the exposure is automatic.
    """

    def __init__(
        self, state: Callable[[], RenderState | None], scene: Any, camera: Any, wavelengths: Array, tone: str
    ) -> None:
        self._state, self._scene, self._camera = state, scene, camera
        self._wavelengths, self._tone = wavelengths, tone
        self._rays: NDArray[np.int64] | None = None
        self._size = (0, 0)

    def text(self, columns: int, lines: int) -> Any:
        """What is finished, as rich text for a terminal of so many columns and lines; empty before there is light."""
        from rich.text import Text

        picture = self.picture(columns, 2 * max(lines - FREE, 1))
        return Text.from_ansi("" if picture is None else ansi(picture), end="")

    def picture(self, width: int, height: int) -> Array | None:
        """Display values (y, x, 3) of what is finished, at most so large; None where nothing is."""
        state = self._state()
        if state is None or not (state.passes or state.done.any()):
            return None
        rays = self._chosen(len(state.done), width, height)
        inside = rays >= 0
        if state.passes:
            light, there = state.sums["radiance"][rays] / state.passes, inside
        else:
            light, there = state.radiance[rays], inside & state.done[rays]
        if not there.any():
            return None
        from skyscatter.image.spectral import SpectralImage

        light = np.where(there[..., None] & np.isfinite(light), light, np.nan)
        image = SpectralImage(light, self._wavelengths, recipe={"scene": state.recipe.get("scene", {})})
        return image.picture(tone=self._tone)

    def _chosen(self, count: int, width: int, height: int) -> NDArray[np.int64]:
        """Numbers of the rays that are shown, (y, x), an even number of rows; -1 outside of the camera's field."""
        if self._rays is not None and self._size == (width, height):
            return self._rays
        wide, high = self._camera.width, self._camera.height
        step = max(wide / width, high / height, 1.0)
        columns = ((np.arange(int(wide / step)) + 0.5) * step).astype(int)
        rows = ((np.arange(max(int(high / step) // 2 * 2, 2)) + 0.5) * step).astype(int).clip(0, high - 1)
        numbers = np.arange(wide * high)
        if count != numbers.size:
            from skyscatter.solvers.render import seen

            inside = np.isfinite(seen(self._scene, self._camera)[..., 0]).ravel()
            numbers = np.where(inside, np.cumsum(inside) - 1, -1)
        self._size = (width, height)
        self._rays = numbers.reshape(high, wide)[np.ix_(rows, columns)]
        return self._rays


def ansi(picture: Array) -> str:
    """A picture (y, x, 3) of display values, of an even number of rows, as characters with 24-bit colours."""
    values = np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(int)
    lines = []
    for upper, lower in zip(values[::2], values[1::2], strict=True):
        cells = (
            f"\x1b[38;2;{a[0]};{a[1]};{a[2]};48;2;{b[0]};{b[1]};{b[2]}m{HALF}"
            for a, b in zip(upper.tolist(), lower.tolist(), strict=True)
        )
        lines.append("".join(cells) + "\x1b[0m")
    return "\n".join(lines)
