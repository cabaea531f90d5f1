"""The glow of towns in the sky of an observer.

Air and planet are the same in all directions, and so is the light of a town about its vertical.  So what an observer
sees per unit of a lamp's power is a function of three numbers only: the distance d of the lamp, the elevation e of the
line of sight, and the azimuth a between them,

    L(e, a) = sum over lamps  P K(d, e, a - a_lamp).                                                          (1)

K is found at a few distances: the light that is scattered once by quadrature, all the rest by walks at fewer nodes,
between which its logarithm is joined by splines.  The sum (1) is a convolution over the azimuth, whatever the number of
lamps.  So a map of a hundred thousand of them takes hardly longer than a town.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.kernels.path import BATCHES
from skyscatter.kernels.towns.first import first_rays, make_first_scratch
from skyscatter.kernels.towns.walks import make_walk_scratch, walk_rays
from skyscatter.progress import say
from skyscatter.scene import Scene, Sun
from skyscatter.solvers.base import Array
from skyscatter.solvers.compile import compile_ground, compile_scene
from skyscatter.solvers.run import check_wavelengths
from skyscatter.solvers.skylights import Picture
from skyscatter.solvers.townlamps import Lamps, check_towns, lamps_of
from skyscatter.workers import in_parts, steady_algebra

#: Nodes of elevation above the horizon and below it, and of azimuth from a lamp over 180 degrees, at which light is
#: scattered once; they crowd at the horizon and at the lamp by these powers.
ABOVE, BELOW, AZIMUTHS = 36, 12, 41
CROWDED, CROWDED_AZIMUTH = 2.5, 2.6
#: The same of light that is scattered more often.
WALKED_ABOVE, WALKED_BELOW, WALKED_AZIMUTHS = 12, 6, 8
WALKED_CROWDED, WALKED_CROWDED_AZIMUTH = 2.0, 1.8
#: Walks for each node of the distance that matters most; others have fewer, as they matter less, but so many at least.
WALKS, FEWEST = 512, 32
#: Azimuths at which the sky is kept.
TURNS = 1440
#: Quadrature's tolerance, and the share of the light by which tables and splines may miss it, which the error holds.
TOLERANCE, JOINED = 1e-3, 0.005
#: Distances of lamps are joined between nodes no further apart than by this factor, as this power of the distance.
STEP, FALL = 1.25, -2.5
#: The same for light scattered more often; of one town, this is how it falls with the distance, roughly.
WALKED_STEP, WALKED_FALL = 1.6, -2.0
#: Distances of one town that are as good as one.
NARROW = 1.03
#: Rays that a thread does at once.
TOGETHER, WALKED_TOGETHER = 64, 4
#: Elevation of rays beside the horizon [rad], so that it is clear on which side they are.
HAIR = 1e-7
MOST_ORDERS = 100_000

Progress = Callable[[float], None] | None


def add_towns(picture: Picture, scene: Scene, wavelengths: Array, *, progress: Progress = None) -> None:
    """Add the light of a scene's towns to a picture, in place."""
    if progress is not None:
        say("light of towns")
    glow = kept_glow(scene_of_towns(scene), tuple(float(w) for w in wavelengths))
    for pixels, rays in picture.blocks() if glow is not None else ():
        picture.add("towns", pixels, *glow.at(rays))


def scene_of_towns(scene: Scene) -> Scene:
    """The same without what makes no difference to its towns: one solution serves all hours of a night."""
    site = scene.sun.site
    sun = Sun(elevation_deg=-90.0, site=None if site is None else site.model_copy(update={"time": ""}))
    return scene.model_copy(update={"sun": sun, "lights": None})


@lru_cache(maxsize=4)
def kept_glow(scene: Scene, wavelengths: tuple[float, ...]) -> TownGlow | None:
    """`town_glow`, kept for the frames of a sequence."""
    return town_glow(scene, wavelengths)


@dataclass(frozen=True)
class TownGlow:
    """The light of towns over elevation and azimuth in an observer's sky.

    Attributes
    ----------
    horizon : float
        Elevation of the horizon, at most 0 [rad].
    logarithm : ndarray, shape (elevation, azimuth, wavelength)
        Of the radiance [W m-2 sr-1 nm-1], at nodes from the nadir to the horizon and from there to the zenith.
    relative : ndarray, shape (elevation, azimuth, wavelength)
        Its standard error, and what the nodes may miss, over it.
    """

    horizon: float
    logarithm: Array
    relative: Array

    def at(self, directions: Array) -> tuple[Array, Array]:
        """Radiance in directions, and its error.

        Parameters
        ----------
        directions : ndarray, shape (ray, 3)
            Unit vectors of the observer's frame (east, north, up).

        Returns
        -------
        radiance, error : ndarray, shape (ray, wavelength)
            [W m-2 sr-1 nm-1]
        """
        from scipy.sparse import csr_array

        count, turns, wavelengths = self.logarithm.shape
        rows, across = self._rows(directions)
        turn = np.arctan2(directions[:, 0], directions[:, 1]) / (2 * np.pi) * turns % turns
        columns = np.floor(turn).astype(np.int64)[:, None] + np.arange(-1, 3)
        along = _smooth(turn - np.floor(turn))
        cells = (rows[:, :, None] * turns + columns[:, None, :] % turns).reshape(len(directions), 16)
        weights = (across[:, :, None] * along[:, None, :]).reshape(len(directions), 16)
        start = np.arange(0, 16 * len(directions) + 1, 16)
        table = csr_array((weights.ravel(), cells.ravel(), start), shape=(len(directions), count * turns))
        radiance = np.exp(np.asarray(table @ self.logarithm.reshape(count * turns, wavelengths)))
        return radiance, radiance * self.relative.reshape(count * turns, wavelengths)[cells[:, 5]]

    def _rows(self, directions: Array) -> tuple[Any, Array]:
        """Four nodes of elevation around each direction and their weights; nothing is joined across the horizon."""
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])) - self.horizon
        up = elevation >= 0
        size = np.where(up, ABOVE - 1, BELOW - 1)
        width = np.where(up, np.pi / 2 - self.horizon, np.pi / 2 + self.horizon)
        u = np.minimum((np.abs(elevation) / width) ** (1 / CROWDED), 1.0) * size
        cell = np.minimum(u.astype(np.int64), size - 1)
        weights = _smooth(u - cell)
        # Beyond the first and the last node the logarithm goes on straight.
        for edge, out, last in ((cell == 0, 0, 1), (cell == size - 1, 3, 2)):
            weights[edge, last] += 2 * weights[edge, out]
            weights[edge, 2 if last == 1 else 1] -= weights[edge, out]
            weights[edge, out] = 0.0
        rows = np.clip(cell[:, None] + np.arange(-1, 3), 0, size[:, None])
        return rows + np.where(up, BELOW, 0)[:, None], weights


def _smooth(x: Array) -> Array:
    """Weights of four neighbours for a place x from 0 to 1 between the middle two: a cubic with continuous slope.

    Catmull & Rom (1974), in Computer Aided Geometric Design, 317.
    """
    return np.stack(
        [
            0.5 * x * (-1 + x * (2 - x)), 1 + 0.5 * x * x * (3 * x - 5),
            0.5 * x * (1 + x * (4 - 3 * x)), 0.5 * x * x * (x - 1),
        ],
        axis=-1,
    )  # fmt: skip


def _side(horizon: float, count: int, crowded: float, sign: int) -> Array:
    share = np.linspace(0, 1, count) ** crowded
    return horizon + sign * np.maximum(share * (np.pi / 2 - sign * horizon), HAIR)


def _elevations(horizon: float, below: int, above: int, crowded: float) -> Array:
    """Elevations on both sides of the horizon, first those below it, each beginning at the horizon [rad]."""
    return np.concatenate([_side(horizon, below, crowded, -1), _side(horizon, above, crowded, 1)])


def _azimuths(count: int, crowded: float) -> Array:
    return np.asarray(np.pi * np.linspace(0, 1, count) ** crowded)


def _rays(elevation: Array, azimuth: Array) -> Array:
    """Unit vectors (elevation * azimuth, 3), azimuths from north."""
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1).reshape(-1, 3)


@dataclass(frozen=True)
class Lamplight:
    """What an observer sees per unit of a lamp's power, K of (1).

    Attributes
    ----------
    scene : Scene
    wavelengths : ndarray, shape (wavelength,)
    lobe : ndarray, shape (2, node)
        Cosines of the zenith angle, rising, and radiant intensities over the power [sr-1].
    seed : int
    max_order : int
        Highest order of scattering.
    """

    scene: Scene
    wavelengths: Array
    lobe: Array
    seed: int = 0
    max_order: int = MOST_ORDERS

    @cached_property
    def horizon(self) -> float:
        """Elevation of the horizon, at most 0 [rad]."""
        radius = self.scene.medium.radius
        return -float(np.arccos(radius / (radius + self.scene.altitude)))

    def _places(self, distance: float, rays: int) -> tuple[Array, Array]:
        """The lamp in the north and the observer, once for each ray."""
        radius = self.scene.medium.radius
        lamp = radius * np.array([0.0, np.sin(distance / radius), np.cos(distance / radius)])
        return tuple(np.tile(place, (rays, 1)) for place in (lamp, self.scene.observer.position))  # type: ignore[return-value]

    def once(self, distance: float, directions: Array) -> Array:
        """Light that is scattered once, of a lamp so far in the north [m]; (ray, wavelength) [m-2 sr-1]."""
        table = compile_scene(self.scene, self.wavelengths)
        lamps, origins = self._places(distance, len(directions))
        found = np.empty((len(directions), self.wavelengths.size))

        def work(part: slice) -> None:
            first_rays(
                table, self.lobe, lamps[part], origins[part], directions[part], TOLERANCE,
                make_first_scratch(table), found[part],
            )  # fmt: skip

        in_parts(work, len(directions), TOGETHER)
        return found

    def often(self, distance: float, directions: Array, samples: int) -> tuple[Array, Array]:
        """Light that is scattered or reflected more than once, and its standard error."""
        table, land = compile_scene(self.scene, self.wavelengths), compile_ground(self.scene.ground, self.wavelengths)
        lamps, origins = self._places(distance, len(directions))
        mean, error = np.zeros((2, len(directions), self.wavelengths.size))
        numbers = np.arange(len(directions)) + (np.int64(distance) << 20)

        def work(part: slice) -> None:
            walk_rays(
                table, land, self.lobe, lamps[part], origins[part], directions[part], numbers[part],
                np.int64(self.seed), np.int64(samples), np.int64(self.max_order),
                make_walk_scratch(*table.optics.sigma_s.shape), mean[part], error[part],
            )  # fmt: skip

        if self.max_order > 1:
            in_parts(work, len(directions), WALKED_TOGETHER)
        return mean, error

    def table(self, distance: float) -> Array:
        """Light that is scattered once at the nodes, (elevation, azimuth, wavelength)."""
        azimuth = _azimuths(AZIMUTHS, CROWDED_AZIMUTH)
        rays = _rays(_elevations(self.horizon, BELOW, ABOVE, CROWDED), azimuth)
        return self.once(distance, rays).reshape(BELOW + ABOVE, AZIMUTHS, -1)

    def walked(self, distance: float, samples: int) -> tuple[Array, Array]:
        """Logarithm of all other light, and its relative standard error, at the same nodes."""
        azimuth = _azimuths(WALKED_AZIMUTHS, WALKED_CROWDED_AZIMUTH)
        elevation = _elevations(self.horizon, WALKED_BELOW, WALKED_ABOVE, WALKED_CROWDED)
        # Whoever stands on the ground has it at the feet, alike in all directions.
        first = WALKED_BELOW if self.scene.altitude == 0 else 0
        rays = _rays(elevation[first:], azimuth)
        mean, error = np.zeros((2, elevation.size, azimuth.size, self.wavelengths.size))
        found = self.often(distance, rays, samples)
        mean[first:], error[first:] = (part.reshape(-1, *mean.shape[1:]) for part in found)
        if first:
            mean[:first], error[:first] = self.often(distance, -np.eye(3)[2:], 4 * samples)
        # All azimuths are one at the zenith and the nadir.
        for row in (-1, WALKED_BELOW - 1)[: 1 if first else 2]:
            mean[row], error[row] = mean[row].mean(axis=0), np.sqrt((error[row] ** 2).mean(axis=0) / azimuth.size)
        floor = 1e-9 * np.maximum(mean.max(axis=(0, 1)), 1e-280)  # where ground is black nothing comes from below
        relative = np.divide(error, mean, out=np.zeros_like(mean), where=mean > 0)
        return _joined(np.log(np.maximum(mean, floor)), smooth=True), _joined(relative, smooth=False)


def _joined(values: Array, smooth: bool) -> Array:
    """Values at the nodes of walks (elevation, azimuth, ...) at those of light scattered once."""
    from scipy.interpolate import CubicSpline, make_interp_spline

    def along(part: Array, old: Array, new: Array, flat: bool) -> Array:
        if smooth:
            ends = "clamped" if flat else "not-a-knot"
            return np.asarray(CubicSpline(old, part, bc_type=ends)(new))
        return np.asarray(make_interp_spline(old, part, k=1)(new))

    # In the numbers of the nodes, which rise evenly where the light changes evenly.
    turned = np.linspace(0, 1, AZIMUTHS) ** (CROWDED_AZIMUTH / WALKED_CROWDED_AZIMUTH)
    values = np.moveaxis(values, 1, 0)
    values = np.moveaxis(along(values, np.linspace(0, 1, WALKED_AZIMUTHS), turned, True), 0, 1)
    sides = []
    for part, count in ((values[:WALKED_BELOW], BELOW), (values[WALKED_BELOW:], ABOVE)):
        at = np.linspace(0, 1, count) ** (CROWDED / WALKED_CROWDED)
        sides.append(along(part, np.linspace(0, 1, len(part)), at, False))
    return np.concatenate(sides)


def cell_rule() -> tuple[Array, Array, Array]:
    """Azimuths at which K is looked up for its means over cells from 0 to pi, the cells, and the weights.

    Cells near the lamp, where K has its peak, have more of them, crowding in the one at the lamp.
    """
    width = 2 * np.pi / TURNS
    x, w = np.polynomial.legendre.leggauss(16)
    x, w = 0.5 * (x + 1), 0.5 * w
    at, cell, weight = [0.5 * width * x**3], [np.zeros(16, np.int64)], [3 * x * x * w]
    for first, last, count in ((1, 12, 8), (12, TURNS // 2 + 1, 2)):
        x, w = np.polynomial.legendre.leggauss(count)
        number = np.arange(first, last)
        at.append((width * (number[:, None] + 0.5 * x)).ravel())
        cell.append(np.repeat(number, count))
        weight.append(np.tile(0.5 * w, number.size))
    folded = np.concatenate(at)
    return np.where(folded > np.pi, 2 * np.pi - folded, folded), np.concatenate(cell), np.concatenate(weight)


def cell_means(values: Array, logarithmic: bool) -> Array:
    """Means over cells of azimuth from 0 to 2 pi of an even function at nodes; (elevation, azimuth, wavelength)."""
    from scipy.interpolate import CubicSpline, make_interp_spline
    from scipy.sparse import csr_array

    at, cell, weight = cell_rule()
    number, place = np.linspace(0, 1, AZIMUTHS), (at / np.pi) ** (1 / CROWDED_AZIMUTH)
    across = np.moveaxis(values, 1, 0)
    if logarithmic:
        floor = 1e-12 * np.maximum(across.max(axis=(0, 1)), 1e-280)
        fine = np.exp(CubicSpline(number, np.log(np.maximum(across, floor)), bc_type="clamped")(place))
    else:
        fine = make_interp_spline(number, across, k=1)(place)
    half = TURNS // 2
    rule = csr_array((weight, (cell, np.arange(at.size))), shape=(half + 1, at.size))
    means = np.asarray(rule @ fine.reshape(at.size, -1)).reshape(half + 1, *fine.shape[1:])
    return np.moveaxis(np.concatenate([means, means[half - 1 : 0 : -1]]), 0, 1)


@dataclass(frozen=True)
class Ring:
    """Lamps of one lobe about one distance.

    Attributes
    ----------
    distance : float
        [m]
    power : ndarray, shape (azimuth, wavelength)
        Of the lamps in cells about azimuths from north [W nm-1].
    """

    distance: float
    power: Array

    @property
    def worth(self) -> float:
        """How much it matters, roughly."""
        return float(self.power.sum() * self.distance**FALL)


def rings_of(lamps: list[Lamps]) -> list[Ring]:
    """Lamps of one lobe in rings, each shared by the two distances beside it."""
    nodes = distance_nodes(*_amounts(lamps))
    power = np.zeros((nodes.size, TURNS, lamps[0].spectrum.size))
    for some in lamps:
        turn = some.azimuth / (2 * np.pi) * TURNS % TURNS
        left = np.floor(turn).astype(np.int64) % TURNS
        ring = np.clip(np.searchsorted(nodes, some.distance) - 1, 0, max(nodes.size - 2, 0))
        upper = np.minimum(ring + 1, nodes.size - 1)
        step = np.log(nodes[upper] / nodes[ring])
        share = np.divide(np.log(some.distance / nodes[ring]), step, out=np.zeros_like(step), where=step > 0)
        share = np.clip(share, 0.0, 1.0)
        held = np.zeros((nodes.size, TURNS))
        for node, part in ((ring, 1 - share), (upper, share)):
            light = some.weight * part * ((some.distance / nodes[node]) ** FALL if nodes.size > 1 else 1.0)
            for cell, side in ((left, 1 - (turn - np.floor(turn))), ((left + 1) % TURNS, turn - np.floor(turn))):
                np.add.at(held, (node, cell), light * side)
        power += held[:, :, None] * some.spectrum
    return [Ring(float(d), p) for d, p in zip(nodes, power, strict=True) if p.any()]


def _amounts(lamps: list[Lamps]) -> tuple[Array, Array]:
    """Distances of lamps, and how much they shine."""
    return (
        np.concatenate([some.distance for some in lamps]),
        np.concatenate([some.weight * some.spectrum.sum() for some in lamps]),
    )


@dataclass
class Walked:
    """Light that is scattered more than once, of lamps in rings about the observer, from walks for fewer of them.

    Attributes
    ----------
    light : Lamplight
    rings : list of Ring
        Rising.
    samples : int
        Walks for each node of the distance that matters most.
    """

    light: Lamplight
    rings: list[Ring]
    samples: int

    def __post_init__(self) -> None:
        low, high = self.rings[0].distance, self.rings[-1].distance
        if high <= WALKED_STEP * low:
            worth = [ring.worth for ring in self.rings]
            self.nodes = np.array([np.average([ring.distance for ring in self.rings], weights=worth)])
        else:
            self.nodes = np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(WALKED_STEP))) + 1)
        self.found: dict[int, tuple[Array, Array]] = {}

    def _node(self, number: int) -> tuple[Array, Array]:
        """What walks find at a node; as many of them as its rings are worth, for errors of equal weight."""
        if number not in self.found:
            nearest = [int(np.argmin(np.abs(np.log(self.nodes / ring.distance)))) for ring in self.rings]
            worth = np.bincount(nearest, [ring.worth for ring in self.rings], self.nodes.size)
            walks = int(self.samples * np.sqrt(worth[number] / worth.max())) // BATCHES * BATCHES
            self.found[number] = self.light.walked(float(self.nodes[number]), max(walks, FEWEST))
        return self.found[number]

    def at(self, distance: float) -> tuple[Array, Array]:
        """The light of a lamp so far away [m] at the nodes over the sky, and its relative standard error."""
        if self.nodes.size == 1:
            logarithm, relative = self._node(0)
            return np.exp(logarithm + WALKED_FALL * np.log(distance / self.nodes[0])), relative
        low = int(np.clip(np.searchsorted(self.nodes, distance) - 1, 0, self.nodes.size - 2))
        share = np.log(distance / self.nodes[low]) / np.log(self.nodes[low + 1] / self.nodes[low])
        (one, one_error), (other, other_error) = self._node(low), self._node(low + 1)
        share = float(np.clip(share, 0.0, 1.0))
        return np.exp((1 - share) * one + share * other), (1 - share) * one_error + share * other_error


def distance_nodes(distance: Array, weight: Array) -> Array:
    """Distances [m], rising, between which those of lamps lie; one, where they hardly differ."""
    low, high = float(distance.min()), float(distance.max())
    if high <= NARROW * low:
        return np.array([np.average(distance, weights=weight)])
    return np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)


def town_glow(
    scene: Scene,
    wavelengths: ArrayLike,
    *,
    samples: int = WALKS,
    seed: int = 0,
    max_order: int | None = None,
    progress: Progress = None,
) -> TownGlow | None:
    """Solve for the light of a scene's towns; None where there is none that reaches the observer's sky.

    Parameters
    ----------
    scene : Scene
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising; each stands for its cell, as everywhere.
    samples : int
        Walks for each node of the distance that matters most.
    seed : int
        Same seed, same numbers.
    max_order : int, optional
        Leave out light that was scattered or reflected more often than this.
    progress : callable, optional
        Called with the finished share.

    Returns
    -------
    TownGlow
        Radiance over the observer's sky, with an error: a standard error of the walks, to which a part in 200 of the
        light is added for what tables and splines miss.

    Raises
    ------
    DomainError
        For ground with a map.

    Examples
    --------
    Ten kilometres from a town of 50000, by night: its light is brightest low above it.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.solvers.towns import town_glow
    >>> from skyscatter.surfaces import Town
    >>> town = Town.of_people(50_000, distance="10 km", azimuth_deg=90, spectrum="led-4000k")
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=-30)
    >>> scene = scene.model_copy(update={"towns": (town,)})
    >>> glow = town_glow(scene, [450, 550], samples=32)
    >>> low, zenith = glow.at(np.array([[0.98, 0.0, 0.199], [0.0, 0.0, 1.0]]))[0][:, 1]
    >>> bool(low > 5 * zenith)
    True
    """
    return _solved(scene, check_wavelengths(wavelengths), samples, seed, max_order, progress)


@steady_algebra()
def _solved(
    scene: Scene, wavelengths: Array, samples: int, seed: int, max_order: int | None, progress: Progress
) -> TownGlow | None:
    check_towns(scene)
    groups: dict[bytes, list[Lamps]] = {}
    for lamps in lamps_of(scene, wavelengths):
        groups.setdefault(lamps.lobe.tobytes(), []).append(lamps)
    if not groups:
        return None
    count = sum(distance_nodes(*_amounts(some)).size for some in groups.values())
    total = variance = 0.0
    done = 0
    for some in groups.values():
        light = Lamplight(scene, wavelengths, some[0].lobe, seed, max_order or MOST_ORDERS)
        rings = rings_of(some)
        walked = Walked(light, rings, samples)
        for ring in rings:
            turned = np.fft.rfft(ring.power, axis=0)
            often, relative = walked.at(ring.distance)
            total = total + _convolved(cell_means(light.table(ring.distance) + often, True), turned)
            variance = variance + _convolved(cell_means(often * relative, False), turned) ** 2
            done += 1
            if progress is not None:
                progress(min(done / count, 1.0))
    total = np.maximum(total, 1e-12 * np.maximum(np.max(total, axis=(0, 1)), 1e-280))
    return TownGlow(light.horizon, np.log(total), np.sqrt(variance) / total + JOINED)


def _convolved(means: Array, turned: Array) -> Array:
    """Sum over the azimuths of lamps, whose Fourier coefficients are given; never negative."""
    found = np.fft.irfft(np.fft.rfft(means, axis=1) * turned, n=TURNS, axis=1)
    return np.asarray(np.maximum(found, 0.0))
