"""Many rays from one place: the light is solved for at nodes over the sky and joined between them.

For an observer the diffuse light of a spherical atmosphere depends on the elevation, and on the azimuth from the Sun
evenly to both sides.  It is solved at nodes that crowd at the horizon, where it has an edge, and at the Sun; between
them go cubics through four nodes each way, below the horizon in the way to the ground (`below_place`); seen from above
the air, where day and night lie side by side, through the logarithms.  Of light scattered once only the sunlight on
each component is joined; its phase functions, with all their peaks and bows, are exact, for the angle from the Sun is
one along a ray; its polarisation is exact likewise, and the rest of Q is even and of U and V odd to both sides.  Some
rays that a picture asks for are then solved themselves and compared: close to the Sun, out to
where the cubics hold, rays are solved one by one, and where they hold nowhere there is no table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.geometry.meridian import meridian_turns
from skyscatter.geometry.seen import seen_zenith
from skyscatter.kernels.skyrows import below_place, join_rays, place_rays
from skyscatter.kernels.sunlight import AUREOLE_END, AUREOLE_FULL, AUREOLE_WAVES
from skyscatter.solvers.base import Array
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.estimate import relative_error
from skyscatter.solvers.sweeps import HAIR, Solution, diffuse_light, off_vertical, same_course, stated_share, view
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.kernels.optics import SceneTable

#: Nodes of elevation below the horizon, even in `below_place`, which is tabulated at so many angles to find them.
BELOW, SOUGHT = 24, 400
#: Optical depth of a way to the ground that counts as short, by the mean extinction below the observer, who stands so
#: high at least [m].
SHORT, LOWEST = 0.01, 1.0
#: Nodes of elevation above the horizon, which crowd there by a power, and on each side of the Sun, at squares.
ABOVE, CROWDED, BESIDE = 64, 2.2, 20
#: More of them for observers aloft, who see layers from the side.
ALOFT = 2
#: Nodes between the horizon and the top of the atmosphere, for those who see it from outside.
LIMB, LIMB_CROWDED = 64, 1.3
#: Share of that way at which the last of them lies: at the top itself there is no light, of which logarithms know.
LIMB_END = 0.999
#: Nodes of azimuth from the Sun over 180 degrees, at squares; from above the air this share is even, for there the
#: terminator may lie anywhere.
TURNS, EVEN = 97, 0.9
#: Shares of all these nodes that are tried, until rays that were solved agree: two thirds miss a fifth of what may be
#: missed, and in deep twilight half of it; planets with their terminator need the last ones.
SHARES = (2 / 3, 1.0, 2.0, 3.0)
#: Nodes of elevation may be no closer than this share of the distance to the next but one.
CLOSEST = 0.15
#: What is left to be solved ray by ray from which on a table, or a finer one, is worth it: so many times its nodes.
FEWEST = 2.0
#: A course from the observer takes as long as so many rays that share it, for it is compared at azimuths of its own;
#: rays share it that lie in one tile, which has some so many.
COURSE, TILE = 100, 8192
#: Rays that are compared, all over the picture and beside the Sun, out to an angle [rad]; from above the air beside
#: the terminator, by the Sun's zenith angle [rad].
COMPARED, BESIDE_SUN, TERMINATOR = 96, math.radians(40.0), math.radians(15.0)
#: Of so many rays, spread evenly over all.
SORTED = 65536
#: What may be missed, in tolerances of the solution; the error that is stated is twice as large at least.
MISSED = 0.2
#: And as a share of the error that is stated, where that is larger: in twilight.
MISSED_OF_ERROR = 0.25
#: Share of the rays that may miss more: seen from aloft, single rays leave their neighbours by more than that.
MISSING = 0.011
#: Light so much fainter than the brightest of the rays that are compared is held as closely as this [its share].
FAINT = 1e-4
#: What counts as no light, in the brightest node: logarithms are joined where day and night are seen at once.
DARKEST = 1e-14
#: Angles from the Sun and from the horizon [degree] within which rays are solved one by one; the first that will do.
NEAR, BAND = (0.0, 0.0, 2.0, 4.0, 8.0), (0.0, 0.2, 0.2, 0.5, 1.0)
#: Rays within so many radii of the Sun's disk are solved one by one in any case.
DISK = 2.0
#: Azimuths at which the error is estimated, of the nodes of a height.
ERROR_TURNS = 6
#: Heights that a thread does at once.
TOGETHER = 4


class Frame(NamedTuple):
    """Axes of an observer: the vertical, the horizontal direction towards the Sun, and that to its left."""

    up: Array
    towards: Array
    beside: Array

    def of(self, directions: Array) -> tuple[Array, Array]:
        """Elevation and azimuth from the Sun, 0 to pi, of rays (ray, 3) [rad]."""
        x, y, z = (directions @ axis for axis in self)
        return np.arctan2(x, np.hypot(y, z)), np.arctan2(np.abs(z), y)

    def rays(self, elevation: Array, turn: Array) -> Array:
        """Unit vectors (elevation, turn, 3)."""
        level = np.cos(turn)[:, None] * self.towards + np.sin(turn)[:, None] * self.beside
        return np.sin(elevation)[:, None, None] * self.up + np.cos(elevation)[:, None, None] * level


def frame_of(origin: Array, sun: Array) -> Frame:
    """The axes at a place; any two horizontal ones where the Sun is overhead."""
    up = origin / np.linalg.norm(origin)
    level = sun - (sun @ up) * up
    if np.linalg.norm(level) < 1e-9:
        level = np.eye(3)[np.argmin(np.abs(up))]
        level = level - (level @ up) * up
    towards = level / np.linalg.norm(level)
    return Frame(up, towards, np.cross(up, towards))


class Edges(NamedTuple):
    """Where the sky of an observer has edges, as elevations [rad]."""

    horizon: float
    top: float  #: above it there is no air
    aloft: bool
    slant: Array  #: as for `below_place`

    @property
    def above(self) -> bool:
        """Whether that is above the air, from where day and night may be seen at once."""
        return self.top < math.pi / 2

    @classmethod
    def of(cls, table: SceneTable, origin: Array) -> Edges:
        """Those that an observer sees at a place."""
        columns, height = table.columns, float(np.linalg.norm(origin))
        ground, top = columns.radius, columns.radius + columns.top
        low = min(max(height - ground, LOWEST), columns.top)
        lead = slant_columns(columns, 0.0, 1.0), slant_columns(columns, low, 1.0)
        depth = float(np.max((lead[0] - lead[1]) @ table.optics.sigma_t, initial=0.0))  # type: ignore[operator]
        squares = [max((height - r) * (height + r), 0.0) for r in (ground, top)]
        return cls(
            -math.acos(min(ground / height, 1.0)),
            -math.acos(top / height) if height > top else math.pi / 2,
            height > ground * (1 + 1e-6),
            np.array([height, *squares, SHORT * low / max(depth, low / ground)]),
        )


@dataclass(frozen=True)
class Parts:
    """Light along rays or at nodes; (..., wavelength) each."""

    lit: Array  #: (component, ..., wavelength) sunlight that is scattered once, without the phase function
    rest: Array  #: what of light scattered once is not `lit` times the phase function and `SkyTable.lost`
    multiple: Array  #: scattered more often
    ground: Array  #: straight from the ground
    polarised: Array  #: (channel, ..., wavelength) Q, U and V of `multiple`; as shares of it where that is a logarithm

    def take_logarithms(self) -> None:
        """Keep the logarithms of what is positive instead; of next to nothing where there is none."""
        least = DARKEST * self.multiple.max(axis=(-3, -2), keepdims=True, initial=0.0) + np.finfo(float).tiny
        np.divide(self.polarised, np.maximum(self.multiple, least), out=self.polarised)
        for light in (self.lit, self.multiple, self.ground):
            least = DARKEST * light.max(axis=(-3, -2), keepdims=True, initial=0.0) + np.finfo(float).tiny
            np.log(np.maximum(light, least, out=light), out=light)


@dataclass(frozen=True)
class SkyTable:
    """The light at nodes over the sky of an observer.

    Attributes
    ----------
    frame : Frame
    sun : ndarray, shape (3,)
        Direction of the Sun.
    elevation : ndarray, shape (node,)
        Rising [rad]; the first `below` nodes look below the horizon.
    below : int
    turn : ndarray, shape (turn,)
        Nodes of the azimuth from the Sun, 0 to pi [rad].
    edges : Edges
    phase : ndarray, shape (use, component, angle, wavelength)
        Of those that scatter, times scattering per unit density, as `skyscatter.kernels.tabulated.angle_cell` reads it;
        and b1 times it where light is polarised.
    lost : ndarray, shape (component, node, angle, wavelength)
        What of these phase functions is lost close to the Sun, where peaks widen; for the first angles only.
    parts : Parts
        (node, turn, wavelength); logarithms where the observer stands above the air.
    beyond : ndarray, shape (node, wavelength)
        What comes straight from beyond the air where the Sun is not.
    error : ndarray, shape (node, wavelength)
        Estimated relative error of the diffuse light.
    disk : float
        Rays within this angle of the Sun's middle are solved themselves in any case [rad].
    near, band : float
        Rays within this angle of the Sun's middle, and rays so close to the horizon, are to be solved themselves [rad].
    """

    frame: Frame
    sun: Array
    elevation: Array
    below: int
    turn: Array
    edges: Edges
    phase: Array
    lost: Array
    parts: Parts
    beyond: Array
    error: Array
    disk: float
    near: float
    band: float = 0.0

    def alone(self, directions: Array) -> NDArray[np.bool_]:
        """Which rays are to be solved themselves."""
        beside = np.linalg.norm(directions - self.sun, axis=1) <= 2 * math.sin(0.5 * self.near)
        if self.band > 0:
            beside |= np.abs(self.frame.of(directions)[0] - self.edges.horizon) < self.band
        return np.asarray(beside)

    @cached_property
    def smooth(self) -> Array:
        """All of the diffuse light that no phase function belongs to, (node, turn, wavelength)."""
        return np.asarray(self.parts.rest + np.maximum(self.parts.multiple, 0.0) + self.parts.ground)

    @cached_property
    def axes(self) -> Array:
        """The frame's three axes and the direction of the Sun, (4, 3)."""
        return np.array([*self.frame, self.sun])

    @cached_property
    def places(self) -> Array:
        """What the cubics of the elevation are of, (node,)."""
        below, above = np.split(self.elevation, [self.below])
        return np.concatenate([_below_places(below, self.edges.slant), above])

    def look(self, directions: Array, parts: bool = True) -> Look:
        """Light along rays (ray, 3); without `parts` all diffuse light counts as scattered once."""
        stokes = len(self.parts.polarised) > 0
        if stokes:
            directions = off_vertical(np.broadcast_to(self.frame.up, directions.shape), directions)
        at = self._placed(directions)
        if self.edges.above:
            scattered = self._joined(at, self.parts.rest, self.parts.lit, self.phase[0], self.lost)
            alike = np.ones((1, *self.phase.shape[2:]))
            multiple, ground = (
                self._joined(at, lit=part[None], phase=alike) for part in (self.parts.multiple, self.parts.ground)
            )
        else:
            smooth = self.parts.rest if parts else self.smooth
            scattered = self._joined(at, smooth, self.parts.lit, self.phase[0], self.lost)
            others = (self.parts.multiple, self.parts.ground) if parts else ()
            multiple, ground = [self._joined(at, part) for part in others] or [np.zeros((0, smooth.shape[2]))] * 2
        polarised = self._polarised(at, directions, multiple) if stokes else None
        if self.edges.above and not parts:
            scattered, multiple, ground = scattered + multiple + ground, *np.zeros((2, 0, scattered.shape[1]))
        beyond = weighted(self.beyond, at.row, at.across) if self.beyond.any() else None
        return Look(scattered, np.maximum(multiple, 0.0), ground, beyond, self.error[at.row[:, 1]], polarised)

    def _placed(self, directions: Array) -> _Places:
        """Where rays (ray, 3) lie between the nodes."""
        rays = len(directions)
        row, column, cell = (np.empty((rays, n), np.int64) for n in (4, 4, 2))
        across, along, odd, share, high = (np.empty((rays, n)) for n in (4, 4, 4, 2, 1))
        place_rays(
            np.ascontiguousarray(directions), self.axes, self.places, float(self.elevation[0]),
            float(self.elevation[-1]), self.below, self.edges.horizon, self.edges.slant, _mirrored(self.turn),
            self.phase.shape[2] - 1, row, across, column, along, odd, cell, share, high[:, 0],
        )  # fmt: skip
        return _Places(row, across, column, along, odd, cell, share, high[:, 0] > self.edges.top)

    def _joined(
        self,
        at: _Places,
        smooth: Array | None = None,
        lit: Array | None = None,
        phase: Array | None = None,
        lost: Array | None = None,
        odd: bool = False,
    ) -> Array:
        """What is smooth (node, turn, wavelength), and sunlight times a phase function less what is lost of it."""
        out = np.empty((len(at.row), self.beyond.shape[1]))
        join_rays(
            at.row, at.across, at.column, at.odd if odd else at.along, at.cell, at.share,
            self.parts.rest[:0] if smooth is None else smooth, self.parts.lit[:0] if lit is None else lit,
            self.phase[0, :0] if phase is None else phase, self.lost[:, :, :0] if lost is None else lost,
            int(self.edges.above), np.empty((2, out.shape[1])), out,
        )  # fmt: skip
        if at.dark.any():
            out[at.dark] = 0.0
        return out

    def _polarised(self, at: _Places, directions: Array, multiple: Array) -> Array:
        """Q, U and, where there is any, V along rays, (channel, ray, wavelength)."""
        found = np.stack([self._joined(at, part, odd=k > 0) for k, part in enumerate(self.parts.polarised)])
        if self.edges.above:
            found *= multiple
        once = self._joined(at, lit=self.parts.lit, phase=self.phase[1])
        for light, turned in zip(found, meridian_turns(self.frame.up[None], directions, self.sun).T, strict=False):
            light += turned[:, None] * once
        return found


class _Places(NamedTuple):
    """Where rays lie between nodes, as for `skyscatter.kernels.skyrows.place_rays`."""

    row: NDArray[np.int64]
    across: Array
    column: NDArray[np.int64]
    along: Array
    odd: Array
    cell: NDArray[np.int64]
    share: Array
    dark: NDArray[np.bool_]  #: where there is no air


class Look(NamedTuple):
    """Light along rays, (ray, wavelength) each."""

    scattered: Array
    multiple: Array
    ground: Array
    beyond: Array | None  #: straight from beyond the air where the Sun is not; None where nothing shines there
    error: Array  #: relative, of the diffuse light
    polarised: Array | None  #: (channel, ray, wavelength) Q, U and, where there is any, V

    @property
    def diffuse(self) -> Array:
        """All but what comes straight from beyond the air."""
        return self.scattered + self.multiple + self.ground if self.ground.size else self.scattered


def make_table(
    fine: Solution,
    coarse: Solution,
    table: SceneTable,
    origin: Array,
    directions: Array,
    tolerance: float,
    threads: int = 1,
) -> SkyTable | None:
    """A table for rays from one place; None where they are few, or where it would not be exact enough.

    Parameters
    ----------
    fine, coarse : Solution
    table : SceneTable
        With the Sun where it stands.
    origin : ndarray, shape (3,)
    directions : ndarray, shape (ray, 3)
    tolerance : float
        Of the solution.
    threads : int
    """
    if len(directions) * (1 + COURSE) < FEWEST * SHARES[0] ** 2 * TURNS * BESIDE:
        return None
    sun = np.asarray(table.optics.disk_axis)
    frame = frame_of(origin, sun)
    seen, _ = frame.of(directions)
    sight = _Sight(fine, coarse, table, origin, directions, tolerance, frame, float(seen.min()), float(seen.max()))
    found, left = None, np.ones(len(directions), bool)
    with Workers(threads) as pool:
        for share in SHARES:
            nodes = _Nodes.of(sight, share)
            wanted = FEWEST * nodes.effort
            if not nodes.enough or (left.sum() < wanted and _effort(sight, left) < wanted):
                break
            found = _table(sight, nodes, pool) or found
            left = left if found is None else found.alone(directions)
    return found


class _Sight(NamedTuple):
    """What `make_table` is asked for."""

    fine: Solution
    coarse: Solution
    table: SceneTable
    origin: Array
    directions: Array
    tolerance: float
    frame: Frame
    low: float  #: elevation of the lowest ray [rad]
    high: float


def _effort(sight: _Sight, left: NDArray[np.bool_]) -> float:
    """What it takes to solve these rays one by one, in rays of one course."""
    courses = 0
    for k in range(0, len(left), TILE):
        some = sight.directions[k : k + TILE][left[k : k + TILE]]
        if len(some):
            origins = np.broadcast_to(sight.origin, some.shape)
            courses += len(same_course(origins, some, sight.table.columns.radius)[1]) - 1
    return float(left.sum() + COURSE * courses)


class _Nodes(NamedTuple):
    """Where a table is solved."""

    edges: Edges
    elevation: Array
    below: int
    turn: Array

    @classmethod
    def of(cls, sight: _Sight, share: float) -> _Nodes:
        """A share of the nodes."""
        edges = Edges.of(sight.table, sight.origin)
        sun = math.asin(float(np.asarray(sight.table.optics.disk_axis) @ sight.frame.up))
        elevation, below = _elevations(edges, sun, sight.low, sight.high, share)
        return cls(edges, elevation, below, _turns(share, edges.above))

    @property
    def effort(self) -> float:
        """What it takes to solve them, in rays of one course."""
        return float(self.elevation.size * (self.turn.size + COURSE))

    @property
    def enough(self) -> bool:
        """Whether there are four for a cubic on each side of the horizon that has any; none where rays miss the air."""
        above = self.elevation.size - self.below
        return self.elevation.size > 0 and min(self.below or 4, above or 4) >= 4


def _table(sight: _Sight, nodes: _Nodes, pool: Workers) -> SkyTable | None:
    """A table of these nodes; None where it is not exact enough."""
    fine, coarse, table, origin, directions, tolerance, frame, _, _ = sight
    edges, elevation, below, turn = nodes
    kept = np.flatnonzero(fine.problem.diffuse.scatters)
    phase = np.ascontiguousarray(fine.problem.whole[:, kept])
    disk = DISK * float(table.optics.disk_radius)
    # A hair from the vertical, so that each azimuth has a meridian of its own.
    steep = math.pi / 2 - (2 * HAIR if fine.problem.stokes > 1 else 0.0)
    rays = frame.rays(np.clip(elevation, -steep, steep), turn)
    solved = _solved(fine, coarse, table, origin, rays, tolerance, pool)
    if edges.above:
        solved[1].take_logarithms()
    found = SkyTable(
        frame, np.asarray(table.optics.disk_axis), elevation, below, turn, edges, phase, *solved, disk, disk,
    )  # fmt: skip
    return _checked(found, fine, table, origin, directions, tolerance, pool)


def _below_places(elevation: Array, slant: Array) -> Array:
    """`below_place` of some elevations."""
    return np.array([below_place.py_func(float(angle), slant) for angle in elevation])


def _elevations(edges: Edges, sun: float, low: float, high: float, share: float) -> tuple[Array, int]:
    """Nodes of elevation [rad] that rays between two elevations need, and how many look below the horizon."""
    horizon, top, aloft, slant = edges
    many = (ALOFT if aloft else 1) * share
    hair = 1e-7  # so that it is clear on which side of the horizon a node lies
    down = horizon - hair - (math.pi / 2 + horizon - hair) * np.linspace(1, 0, SOUGHT) ** 4
    places = _below_places(down, slant)
    down = np.interp(np.linspace(places[0], places[-1], round(many * BELOW)), places, down)
    if edges.above:
        up = horizon + LIMB_END * (top - horizon) * np.linspace(0, 1, round(share * LIMB)) ** LIMB_CROWDED
    else:
        step = np.linspace(-1, 1, 2 * round(share * BESIDE) + 1)
        up = horizon + (top - horizon) * np.linspace(0, 1, round(many * ABOVE)) ** CROWDED
        up = np.concatenate([up, sun + math.pi / 2 * step * np.abs(step)])
    up = _thinned(np.clip(np.sort(up[(up >= horizon) & (up <= top)]), horizon + hair, top))
    down, up = _within(down, low, min(high, horizon - hair)), _within(up, max(low, horizon + hair), min(high, top))
    return np.concatenate([down, up]), down.size


def _thinned(nodes: Array) -> Array:
    """Rising nodes without those that crowd where two sorts of them meet."""
    kept = [nodes[0]]
    for here, following in pairwise(nodes[1:]):
        if here - kept[-1] > CLOSEST * (following - kept[-1]) and here > kept[-1]:
            kept.append(here)
    if nodes[-1] > kept[-1]:
        kept.append(nodes[-1])
    return np.array(kept)


def _within(nodes: Array, low: float, high: float) -> Array:
    """Nodes that cubics between two elevations need; none where there are no such elevations."""
    if low > high:
        return nodes[:0]
    first, last = np.searchsorted(nodes, [low, high])
    return nodes[max(min(int(first) - 2, nodes.size - 4), 0) : max(int(last) + 2, 4)]


def _solved(
    fine: Solution,
    coarse: Solution,
    table: SceneTable,
    origin: Array,
    rays: Array,
    tolerance: float,
    pool: Workers,
) -> tuple[Array, Parts, Array, Array]:
    """Of rays (node, turn, 3): what peaks lose, light, that from beyond the air opposite to the Sun, relative error."""
    turns = rays.shape[1]
    compared = np.linspace(0, turns - 1, ERROR_TURNS).astype(int)
    kept = np.flatnonzero(fine.problem.diffuse.scatters)
    components, wavelengths = table.optics.sigma_s.shape
    shape = (*rays.shape[:2], wavelengths)
    rest, more, surface = (np.empty(shape) for _ in range(3))
    parts = Parts(np.empty((kept.size, *shape)), rest, more, surface, np.empty((fine.problem.stokes - 1, *shape)))
    beyond, error = np.empty((2, len(rays), wavelengths))
    angles = lost_peaks(fine, np.zeros((0, components, wavelengths)), kept).shape[2]
    lost = np.empty((kept.size, len(rays), angles, wavelengths))
    told = stated_share(fine.problem, coarse.problem)
    toward = rays @ np.asarray(table.optics.disk_axis)

    def work(some: slice) -> None:
        here = (-1, turns, wavelengths)
        lit = np.empty((rays[some].size // 3, components, wavelengths), np.float32)
        chain = np.empty(lit.shape)
        viewed = _viewed(fine, table, origin, rays[some].reshape(-1, 3), lit, chain)
        scattered, multiple, ground, direct = viewed[0][:, 0], viewed[1][:, 0], *viewed[2:]
        lost[:, some] = lost_peaks(fine, chain.reshape(-1, turns, components, wavelengths)[:, 0], kept)
        cell, share = angle_cells(toward[some].ravel(), fine.problem.whole.shape[2] - 1)
        inner = cell[:, 1] < lost.shape[2]
        node = np.repeat(np.arange(some.start, some.stop), turns)[inner]
        once = np.zeros_like(scattered)
        for k, c in enumerate(kept):
            chance = weighted(fine.problem.whole[0, c], cell, share)
            chance[inner] -= sum(share[inner, j, None] * lost[k, node, cell[inner, j]] for j in range(2))
            once += chance * lit[:, c]
            parts.lit[k, some] = lit[:, c].reshape(here)
        for part, values in ((parts.rest, scattered - once), (parts.multiple, multiple), (parts.ground, ground)):
            part[some] = values.reshape(here)
        for k, part in enumerate(parts.polarised, 1):
            part[some] = viewed[1][:, k].reshape(here)
        beyond[some] = direct.reshape(here)[:, -1]
        diffuse = diffuse_light(*viewed)[:, 0].reshape(here)[:, compared]
        rough = _viewed(coarse, table, origin, rays[some][:, compared].reshape(-1, 3))
        other = diffuse_light(*rough)[:, 0].reshape(diffuse.shape)
        for k, number in enumerate(range(some.start, some.stop)):
            error[number] = relative_error(diffuse[k], other[k], tolerance, ERROR_TURNS, told)

    _share(pool, work, len(rays))
    return lost, parts, beyond, error


@lru_cache(maxsize=4)
def _aureole_functions(last: int, degrees: int) -> Array:
    """Legendre polynomials at the nodes of angle that are near the Sun, faded out as `narrow_aureole` does."""
    angles = math.ceil(last * math.sqrt(0.5 * (1 - AUREOLE_END))) + 1
    cosine = 1 - 2 * (np.arange(angles) / last) ** 2
    share = np.clip((cosine - AUREOLE_END) / (AUREOLE_FULL - AUREOLE_END), 0.0, 1.0)
    legendre = np.polynomial.legendre.legvander(cosine, degrees - 1) * (share * share * (3 - 2 * share))[:, None]
    gone = np.clip(2 * np.arange(degrees) * np.arccos(cosine)[:, None] / AUREOLE_WAVES - 1, 0.0, 1.0)
    return np.asarray(legendre * (1 - gone * gone * (3 - 2 * gone)))


def lost_peaks(fine: Solution, columns: Array, kept: NDArray[np.int64]) -> Array:
    """What phase functions lose of their peaks close to the Sun, (component, node, angle, wavelength).

    The law is that of `skyscatter.kernels.sunlight.spread_peaks` and `narrow_aureole`; what is made of it here need not
    agree with them in all digits, for the difference is joined too.  `columns` are those of the chains of scatterings,
    (node, component, wavelength) [m]; none on rays to the ground.
    """
    peaks = fine.problem.diffuse.peaks
    _, degrees, wavelengths = peaks.shape
    last = fine.problem.whole.shape[2] - 1
    if not degrees or not peaks.any():
        return np.zeros((kept.size, len(columns), 0, wavelengths))
    legendre = _aureole_functions(last, degrees)
    found = np.zeros((kept.size, len(columns), len(legendre), wavelengths))
    peaked = [(k, c) for k, c in enumerate(kept) if peaks[c].any()]
    for node in np.flatnonzero(columns.any(axis=(1, 2))):
        peak = 4 * math.pi * np.einsum("cw,cw->w", columns[node], peaks[:, 0])
        moment = 4 * math.pi * np.einsum("cw,cdw->dw", columns[node], peaks) / (2 * np.arange(degrees)[:, None] + 1)
        moment = np.maximum(moment, 1e-12)
        gone = 1 - np.exp(-peak) * np.expm1(moment) / moment
        for k, c in peaked:
            found[k, node] = legendre @ (gone * peaks[c])
    return found


def _viewed(
    solution: Solution,
    table: SceneTable,
    origin: Array,
    directions: Array,
    lit: NDArray[np.float32] | None = None,
    chain: Array | None = None,
) -> tuple[Array, Array, Array, Array]:
    """`view` of rays from one place."""
    origins = np.broadcast_to(origin, directions.shape).copy()
    return view(solution.problem, solution.loaded, table, origins, directions, lit, chain)


def _checked(
    found: SkyTable,
    fine: Solution,
    table: SceneTable,
    origin: Array,
    directions: Array,
    tolerance: float,
    pool: Workers,
) -> SkyTable | None:
    """The same table, with the least angle around the Sun beyond which rays that were solved agree with it."""
    directions = directions[:: max(len(directions) // SORTED, 1)]
    angle = 2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(directions - found.sun, axis=1), 1.0))
    order = np.argsort(angle, kind="stable")
    order = order[np.searchsorted(angle[order], found.near, side="right") :]
    beside = order[: np.searchsorted(angle[order], BESIDE_SUN)]
    if found.edges.above:
        sight = np.broadcast_to(origin, directions.shape), directions
        low, _ = seen_zenith(*sight, found.sun, table.columns.radius, table.columns.top)
        beside = np.flatnonzero(np.abs(low - 0.5 * math.pi) < TERMINATOR)
    chosen = [some[np.linspace(0, some.size - 1, min(COMPARED, some.size)).astype(int)] for some in (order, beside)]
    tested = np.unique(np.concatenate(chosen))
    exact = np.empty((1 + len(found.parts.polarised), tested.size, found.beyond.shape[1]))

    def work(some: slice) -> None:
        light = _viewed(fine, table, origin, np.ascontiguousarray(directions[tested[some]]))
        exact[:, some] = np.moveaxis(diffuse_light(*light), 1, 0)

    _share(pool, work, tested.size)
    looked = found.look(directions[tested])
    joined = looked.diffuse[None]
    if looked.polarised is not None:
        joined = np.concatenate([joined, looked.polarised])
    allowed = np.maximum(MISSED * tolerance, MISSED_OF_ERROR * looked.error)
    allowed = allowed * np.maximum(np.abs(exact[0]), FAINT * np.abs(exact[0]).max(axis=0))
    # Where all that is seen lies in the depth of night nothing is promised.
    allowed = np.maximum(allowed, MISSED * fine.unseen)
    missed = np.any(np.abs(joined - exact) > allowed, axis=(0, 2))
    high = np.abs(found.frame.of(directions[tested])[0] - found.edges.horizon)
    for near, band in zip(NEAR, BAND, strict=True):
        if np.mean(missed & (angle[tested] > np.radians(near)) & (high >= np.radians(band))) <= MISSING:
            return replace(found, near=max(found.near, float(np.radians(near))), band=float(np.radians(band)))
    return None


def _share(pool: Workers, work: Callable[[slice], None], count: int) -> None:
    """Do work on some items at a time."""
    for done in [pool.submit(work, slice(k, min(k + TOGETHER, count))) for k in range(0, count, TOGETHER)]:
        done.result()


def _turns(share: float, above: bool) -> Array:
    """A share of the nodes of azimuth from the Sun [rad]; `above` the air they are nearly even."""
    even = EVEN if above else 0.0
    x = np.linspace(0, 1, round(share * TURNS))
    return np.asarray(math.pi * x * (even + (1 - even) * x))


def _mirrored(turn: Array) -> Array:
    """Nodes of azimuth and one more beyond either end."""
    return np.concatenate([[-turn[1]], turn, [2 * math.pi - turn[-2]]])


def angle_cells(cosine: Array, last: int) -> tuple[NDArray[np.int64], Array]:
    """As `skyscatter.kernels.tabulated.angle_cell`: the two angles of a table beside each, and their weights."""
    at = np.clip(cosine, -1.0, 1.0)
    k = np.minimum((np.sqrt(np.maximum(0.5 * (1.0 - at), 0.0)) * last).astype(np.int64), last - 1)
    scale = 2.0 / (last * last)
    w = np.clip((1.0 - scale * k * k - at) / (scale * (2 * k + 1)), 0.0, 1.0)
    return np.stack([k, k + 1], axis=1), np.stack([1.0 - w, w], axis=1)


def weighted(table: Array, rows: NDArray[np.int64], weights: Array) -> Array:
    """A few rows of a table for each place (place, few), times their weights, added up: (place, wavelength)."""
    found = weights[:, 0, None] * table[rows[:, 0]]
    for k in range(1, rows.shape[1]):
        found += weights[:, k, None] * table[rows[:, k]]
    return np.asarray(found)
