"""Where the Sun and the sensor stand, as seen from the ground, over an image."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

Array = NDArray[np.float64]

#: Zenith angles [degree] up to which the model of a pixel is tabulated.
MAX_SUN_ZENITH = 85.0
MAX_VIEW_ZENITH = 85.0


class Angles(NamedTuple):
    """Angles [degree] at some pixels, all of one shape; the relative azimuth from 0 (backscatter side) to 180."""

    sun_zenith_deg: Array
    view_zenith_deg: Array
    relative_azimuth_deg: Array


def fold_azimuth(angle_deg: ArrayLike) -> Array:
    """The same relative azimuth between 0 and 180 degrees: air does not tell left from right of the Sun's vertical."""
    turned = np.mod(np.asarray(angle_deg, dtype=np.float64), 360.0)
    return np.minimum(turned, 360.0 - turned)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """Angles of Sun and view on nodes over an image; one node says that they are the same everywhere.

    Pixel coordinates count from the upper left corner of the image: the centre of pixel (r, c) is (r + 0.5, c + 0.5).
    Nodes may lie outside the image.  The arrays cannot be written to.

    Parameters
    ----------
    rows, cols : array_like, shapes (ny,) and (nx,)
        Ascending pixel coordinates of the nodes.
    sun_zenith_deg, view_zenith_deg : array_like, shape (ny, nx)
        Zenith angles [degree], each up to 85.
    relative_azimuth_deg : array_like, shape (ny, nx)
        Azimuth of the sensor less that of the Sun as seen from the ground [degree]: 0 has both on one side
        (backscatter).  Kept between 0 and 180.
    sun_azimuth_deg, view_azimuth_deg : array_like, shape (ny, nx), optional
        From north through east [degree], where they are known.

    Raises
    ------
    DomainError
        If shapes do not fit, an angle is not finite, the Sun is below the horizon, or beyond the model's range.

    Examples
    --------
    A view from the other side of the zenith than the Sun's, the same over all of an image:

    >>> from skyscatter.dehaze import SceneGeometry
    >>> geometry = SceneGeometry.constant(60, 20, sun_azimuth_deg=150, view_azimuth_deg=-80)
    >>> geometry.to_json()  # degrees
    {'sun_zenith_deg': 60.0, 'view_zenith_deg': 20.0, 'relative_azimuth_deg': 130.0}

    Two nodes, 100 rows apart; angles are bilinear between them.

    >>> geometry = SceneGeometry([0, 100], [0], [[30.0], [32.0]], [[5.0], [5.0]], [[170.0], [170.0]])
    >>> geometry.at([25, 50], [0]).sun_zenith_deg.round(2)
    array([[30.5],
           [31. ]])
    """

    rows: Array
    cols: Array
    sun_zenith_deg: Array
    view_zenith_deg: Array
    relative_azimuth_deg: Array
    sun_azimuth_deg: Array | None = None
    view_azimuth_deg: Array | None = None
    # Interpolated instead of the angles: the view as a vector, which azimuths that wrap do not break, and 1 / cos(Sun);
    # behind them the relative azimuth as it was given.
    _nodes: tuple[Array, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rows, cols = _axis("rows", self.rows), _axis("cols", self.cols)
        shape = (rows.size, cols.size)
        sun = _angles("sun_zenith_deg", self.sun_zenith_deg, shape)
        view = _angles("view_zenith_deg", self.view_zenith_deg, shape)
        _check_zeniths(sun, view)
        signed = _angles("relative_azimuth_deg", self.relative_azimuth_deg, shape)
        azimuths = {}
        for name in ("sun_azimuth_deg", "view_azimuth_deg"):
            given = getattr(self, name)
            azimuths[name] = None if given is None else np.mod(_angles(name, given, shape), 360.0)
        turn = np.radians(signed)
        nodes = (sun, view * np.cos(turn), view * np.sin(turn), 1.0 / np.cos(np.radians(sun)), signed)
        values = {"rows": rows, "cols": cols, "sun_zenith_deg": sun, "view_zenith_deg": view, **azimuths}
        for name, value in {**values, "relative_azimuth_deg": fold_azimuth(signed)}.items():
            object.__setattr__(self, name, _frozen(value))
        object.__setattr__(self, "_nodes", tuple(_frozen(node) for node in nodes))

    @classmethod
    def constant(
        cls,
        sun_zenith_deg: float,
        view_zenith_deg: float = 0.0,
        relative_azimuth_deg: float = 0.0,
        *,
        sun_azimuth_deg: float | None = None,
        view_azimuth_deg: float | None = None,
    ) -> SceneGeometry:
        """The same angles [degree] everywhere; two azimuths, if given, settle the relative one."""
        if sun_azimuth_deg is not None and view_azimuth_deg is not None:
            relative_azimuth_deg = view_azimuth_deg - sun_azimuth_deg
        one = np.ones((1, 1))
        return cls(
            np.zeros(1),
            np.zeros(1),
            one * sun_zenith_deg,
            one * view_zenith_deg,
            one * relative_azimuth_deg,
            None if sun_azimuth_deg is None else one * sun_azimuth_deg,
            None if view_azimuth_deg is None else one * view_azimuth_deg,
        )

    @property
    def is_constant(self) -> bool:
        """Whether there is one node only."""
        return self.sun_zenith_deg.size == 1

    def at(self, rows: ArrayLike, cols: ArrayLike) -> Angles:
        """Angles at the points of a grid, bilinear between nodes and as at the nearest one outside of them.

        Parameters
        ----------
        rows, cols : array_like, shapes (n,) and (m,)
            Pixel coordinates.

        Returns
        -------
        Angles
            Arrays of shape (n, m).
        """
        sun, ahead, aside, _ = (self._interpolate(node, rows, cols) for node in self._nodes[:4])
        return Angles(sun, np.hypot(ahead, aside), fold_azimuth(np.degrees(np.arctan2(aside, ahead))))

    def secant_of_sun(self, rows: ArrayLike, cols: ArrayLike) -> Array:
        """1 / cos(Sun's zenith angle) at the points of a grid, interpolated itself; shape (n, m)."""
        return self._interpolate(self._nodes[3], rows, cols)

    def mean(self) -> Angles:
        """Angles of the middle of the nodes, each of shape (1, 1)."""
        return self.at([0.5 * (self.rows[0] + self.rows[-1])], [0.5 * (self.cols[0] + self.cols[-1])])

    def relative_to(self, row0: float, col0: float, step: float = 1.0) -> SceneGeometry:
        """The geometry of a crop that starts at pixel coordinates (row0, col0), with pixels `step` times as wide."""
        return SceneGeometry(
            (self.rows - row0) / step,
            (self.cols - col0) / step,
            self.sun_zenith_deg,
            self.view_zenith_deg,
            self._nodes[4],  # with its sign, without which views on both sides of the zenith would fall together
            self.sun_azimuth_deg,
            self.view_azimuth_deg,
        )

    def to_json(self) -> dict[str, Any]:
        """The angles in the middle of the nodes, for summaries."""
        middle = self.mean()
        return {name: round(float(value[0, 0]), 4) for name, value in middle._asdict().items()}

    def _interpolate(self, node: Array, rows: ArrayLike, cols: ArrayLike) -> Array:
        below, down = _place(self.rows, rows)
        left, right = _place(self.cols, cols)
        above = np.minimum(below + 1, self.rows.size - 1)
        beside = np.minimum(left + 1, self.cols.size - 1)
        # Along columns first: that is done for the few rows of nodes and not for every row of pixels.
        across = node[:, left] * (1.0 - right) + node[:, beside] * right
        return across[below] * (1.0 - down)[:, None] + across[above] * down[:, None]


def _place(nodes: Array, points: ArrayLike) -> tuple[NDArray[np.intp], Array]:
    """Index of the node before each point, and how far on the way to the next one it lies (0 to 1)."""
    where = np.atleast_1d(np.asarray(points, dtype=np.float64))
    if nodes.size == 1:
        return np.zeros(where.size, dtype=np.intp), np.zeros(where.size)
    index = np.clip(np.searchsorted(nodes, where, side="right") - 1, 0, nodes.size - 2)
    return index, np.clip((where - nodes[index]) / (nodes[index + 1] - nodes[index]), 0.0, 1.0)


def _frozen(value: Array | None) -> Array | None:
    if value is not None:
        value = np.array(value)
        value.setflags(write=False)
    return value


def _axis(name: str, values: ArrayLike) -> Array:
    nodes = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if nodes.ndim != 1 or nodes.size == 0 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0.0):
        raise DomainError(name, f"shape {nodes.shape}", "must be finite pixel coordinates that ascend")
    return nodes


def _angles(name: str, values: ArrayLike, shape: tuple[int, int]) -> Array:
    angles = np.asarray(values, dtype=np.float64)
    if angles.shape != shape:
        raise DomainError(name, f"shape {angles.shape}", f"must have the shape (rows, cols) = {shape} of the nodes")
    if not np.all(np.isfinite(angles)):
        raise DomainError(name, "not finite", "every node needs an angle in degrees")
    return angles


def _check_zeniths(sun: Array, view: Array) -> None:
    for name, angles in (("sun_zenith_deg", sun), ("view_zenith_deg", view)):
        if np.any(angles < 0.0):
            raise DomainError(name, float(angles.min()), "a zenith angle is 0 or more degrees")
    if np.any(sun >= 90.0):
        raise DomainError(
            "sun_zenith_deg", float(sun.max()), "the Sun is below the horizon: there is no sunlight to take haze out of"
        )
    if np.any(sun > MAX_SUN_ZENITH):
        rule = f"the Sun is too low; the model holds for zenith angles from 0 to {MAX_SUN_ZENITH:g} degrees"
        raise DomainError("sun_zenith_deg", float(sun.max()), rule)
    if np.any(view > MAX_VIEW_ZENITH):
        rule = f"the view is too oblique; the model holds for zenith angles from 0 to {MAX_VIEW_ZENITH:g} degrees"
        raise DomainError("view_zenith_deg", float(view.max()), rule)
